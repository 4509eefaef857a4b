//! One push of the `push` suite: where it comes from, when it comes, whether the robot recovers.
//!
//! A push is a horizontal force on the origin of the base link for 0.2 s. It is named by where it comes from: a front
//! push drives the robot backward, a push from the left drives it to its right, along the heading it has when the push
//! begins. (So table 7.2 reads: walking to the left, the robot survives less from the right, the push along its motion, as
//! walking forward it survives less from the back.) The robot starts standing and has 4 s to walk as commanded. The
//! push then comes spread over the gait cycle: push k of n begins k/n of a cycle after the next touchdown of the first
//! foot, a cycle being the time between that foot's last two touchdowns. The robot has recovered if it has not fallen 5 s
//! after the push has ended. One that falls before the push stands up again and is pushed then; after three such falls it
//! counts as not recovered.

use nalgebra::Vector3;
use omniwalk_env::task::episode::End;
use omniwalk_env::truth::Truth;

use super::meter::{Meter, Record};
use super::suites::Plan;
use super::trial::{Ask, Seen, Stage, Trial};

/// Where a push comes from, in the order of table 7.2.
pub const DIRECTIONS: [Direction; 4] = [Direction::Front, Direction::Back, Direction::Right, Direction::Left];

/// Duration of a push, s.
const DURATION: f64 = 0.2;
/// Time to walk as commanded before it, s.
const WARM_UP: f64 = 4.0;
/// Time after it that the robot must not fall in, s.
const WATCHED: f64 = 5.0;
/// Times a robot may fall before it is pushed.
const FALLS_BEFORE: usize = 3;
/// A touchdown is waited for this long, s.
const PATIENCE: f64 = 2.0;
/// Durations a gait cycle can have, s, and the one of a robot that takes no steps.
const CYCLE: std::ops::RangeInclusive<f64> = 0.2..=2.0;
const NO_CYCLE: f64 = 0.8;

/// Where a push comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Against the heading.
    Front,
    /// Along the heading.
    Back,
    /// To the left.
    Right,
    /// To the right.
    Left,
}

impl Direction {
    /// Its name in `eval.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Front => "front",
            Self::Back => "back",
            Self::Right => "right",
            Self::Left => "left",
        }
    }

    /// Unit vector, world frame, of the force on a robot that heads for `yaw`, rad.
    fn force(self, yaw: f64) -> Vector3<f64> {
        let forward = Vector3::new(yaw.cos(), yaw.sin(), 0.0);
        let left = Vector3::new(-yaw.sin(), yaw.cos(), 0.0);
        match self {
            Self::Front => -forward,
            Self::Back => forward,
            Self::Right => left,
            Self::Left => -left,
        }
    }
}

/// When a push begins, in control steps.
struct Timing {
    warm_up: u32,
    share: f64,
    hz: f64,
    step: u32,
    contact: bool,
    touchdown: Option<u32>,
    cycle: Option<u32>,
    begin: Option<u32>,
}

impl Timing {
    /// `share` of a gait cycle after the first touchdown past the warm-up.
    fn new(share: f64, control_hz: u32) -> Self {
        let hz = f64::from(control_hz);
        Self {
            warm_up: (WARM_UP * hz) as u32,
            share,
            hz,
            step: 0,
            contact: true,
            touchdown: None,
            cycle: None,
            begin: None,
        }
    }

    /// Takes in whether the foot is in contact after a step; whether the push begins with the next.
    fn step(&mut self, contact: bool) -> bool {
        self.step += 1;
        let touchdown = contact && !self.contact;
        self.contact = contact;
        if touchdown {
            self.cycle = self.touchdown.map(|last| self.step - last);
            self.touchdown = Some(self.step);
        }
        let overdue = f64::from(self.step - self.warm_up.min(self.step)) >= PATIENCE * self.hz;
        if self.step >= self.warm_up && (touchdown || overdue) && self.begin.is_none() {
            let cycle = self.cycle.map_or(NO_CYCLE, |steps| f64::from(steps) / self.hz);
            let cycle = cycle.clamp(*CYCLE.start(), *CYCLE.end());
            self.begin = Some(self.step + (self.share * cycle * self.hz).round() as u32);
        }
        self.begin.is_some_and(|begin| self.step >= begin)
    }
}

/// One push: what is done to the robot and what came of it.
pub struct Push {
    command: [f64; 3],
    /// Force while it acts, along the direction of the push, N.
    force: f64,
    direction: Direction,
    /// Phase of the gait at which it begins, cycles.
    share: f64,
    timing: Timing,
    /// The force of the next step, world frame, N.
    acting: Vector3<f64>,
    /// Steps since the push began.
    since: Option<usize>,
    duration: usize,
    watched: usize,
    meter: Meter,
    before: Vec<Record>,
    recovered: Option<bool>,
    /// Whether the legs passed through each other after the push.
    overlapped: bool,
}

impl Push {
    /// A push of `force` N from `direction` at `command`, `share` of a gait cycle after a touchdown.
    pub fn new(
        command: [f64; 3],
        direction: Direction,
        force: f64,
        share: f64,
        stage: &Stage<'_>,
        plan: &Plan,
    ) -> Self {
        let hz = stage.config.engine.control_hz;
        let duration = stage.steps(DURATION);
        Self {
            command,
            force,
            direction,
            share,
            timing: Timing::new(share, hz),
            acting: Vector3::zeros(),
            since: None,
            duration,
            watched: duration + stage.steps(plan.seconds.unwrap_or(WATCHED)),
            meter: Meter::new(hz),
            before: Vec::new(),
            recovered: None,
            overlapped: false,
        }
    }

    /// Whether the robot recovered.
    pub fn recovered(&self) -> bool {
        self.recovered == Some(true)
    }

    /// Whether the push ended in legs that passed through each other.
    pub fn overlapped(&self) -> bool {
        self.overlapped
    }

    /// The desired velocity and how the robot walked before the push: one record for each time it stood up.
    pub fn before(self) -> ([f64; 3], Vec<Record>) {
        (self.command, self.before)
    }

    fn fall(&mut self, seen: &Seen<'_>) {
        self.overlapped = self.since.is_some() && seen.ended.is_some_and(|episode| episode.end == End::Overlap);
        if self.since.is_none() {
            self.before.push(self.meter.record(seen));
            self.timing = Timing::new(self.share, seen.shared.config.engine.control_hz);
        }
        if self.since.is_some() || self.before.len() == FALLS_BEFORE {
            self.recovered = Some(false);
        }
    }
}

impl Trial for Push {
    fn ask(&mut self) -> Option<Ask> {
        let ask = Ask {
            velocity: self.command,
            force: self.acting,
        };
        self.recovered.is_none().then_some(ask)
    }

    fn see(&mut self, seen: &Seen<'_>) {
        if seen.ended.is_some() {
            self.fall(seen);
            return;
        }
        if let Some(since) = &mut self.since {
            *since += 1;
            if *since == self.duration {
                self.acting = Vector3::zeros();
            }
            if *since == self.watched {
                self.recovered = Some(true);
            }
            return;
        }
        self.meter.step(seen);
        if self.timing.step(seen.environment.gait().contact(0)) {
            let [x, y] = Truth::new(&seen.base()).heading;
            self.acting = self.force * self.direction.force(y.atan2(x));
            self.since = Some(0);
            self.before.push(self.meter.record(seen));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The step, counted from 1, after which a push begins on a robot whose foot touches down every `cycle` steps.
    fn begins(share: f64, cycle: u32) -> u32 {
        let mut timing = Timing::new(share, 40);
        let half = (cycle / 2).max(1);
        (1..)
            .find(|step| timing.step(cycle == 0 || (step / half).is_multiple_of(2)))
            .unwrap()
    }

    #[test]
    fn pushes_are_spread_over_the_gait_cycle() {
        // Contact comes back at multiples of 32 steps; the first past 4 s, 160 steps, is at 160.
        assert_eq!(begins(0.0, 32), 160);
        let ten: Vec<u32> = (0..10).map(|k| begins(f64::from(k) / 10.0, 32) - 160).collect();
        assert_eq!(ten, [0, 3, 6, 10, 13, 16, 19, 22, 26, 29]);
        // The first past 160 of a cycle of 24 steps is at 168.
        assert_eq!(begins(0.5, 24), 168 + 12);
        // A robot that stands is pushed 2 s later, spread over 0.8 s.
        assert_eq!(begins(0.0, 0), 240);
        assert_eq!(begins(0.5, 0), 240 + 16);
    }

    #[test]
    fn a_push_drives_the_robot_away_from_where_it_comes() {
        let quarter = std::f64::consts::FRAC_PI_2;
        // Heading for y: forward is y, left is -x.
        let expected = [[0.0, -1.0], [0.0, 1.0], [-1.0, 0.0], [1.0, 0.0]];
        for (direction, [x, y]) in DIRECTIONS.into_iter().zip(expected) {
            assert!((direction.force(quarter) - Vector3::new(x, y, 0.0)).norm() < 1e-12);
        }
    }
}
