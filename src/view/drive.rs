//! A policy's controller and the robot it walks, a control step at a time.

use nalgebra::{Isometry3, Translation3, Vector3};
use omniwalk_controller::{Controller, Fault, Mode, Sensors, Status};
use omniwalk_env::plant::Plant;
use omniwalk_env::sensors::History;
use omniwalk_env::truth::Truth;
use omniwalk_sim2real::log::Message;

use super::orders::{Condition, Limits, MOST_PUSH, Order, PUSH_SECONDS, Range};
use super::row::Moment;
use crate::deployed::Deployed;
use crate::telemetry::{Telemetry, odometry};

/// A velocity is walked at for this long after it was ordered last, s.
const PATIENCE: f64 = 0.5;
/// A robot that has fallen lies for this long before it stands again, s.
const LIE: f64 = 2.0;
/// A foot with more than this share of the robot's weight on it is on the ground.
const CONTACT: f64 = 0.02;

/// The simulated robot under its controller.
pub struct Drive {
    plant: Plant,
    controller: Controller,
    history: History,
    telemetry: Telemetry,
    limits: Limits,
    weight: f64,
    friction: f64,
    latency: f64,
    payload: f64,
    desired: [f32; 3],
    /// Control steps until the robot stops by itself.
    patience: u64,
    /// The push and the control steps it still lasts.
    push: ([f64; 2], u64),
    targets: Vec<f32>,
    joint_targets: Vec<f64>,
    substeps: u32,
    step: u64,
    status: Option<Status>,
    falls: u32,
    /// Control steps until it stands up again.
    lies: Option<u64>,
}

impl Drive {
    /// The robot of `deployed`, standing.
    ///
    /// # Errors
    /// When policy, robot and engine do not fit together.
    pub fn new(deployed: &Deployed, seed: u64) -> miette::Result<Self> {
        let Deployed {
            policy,
            robot,
            settings,
        } = deployed;
        let plant = Plant::new(robot, &settings.env, seed)?;
        let controller = Controller::new(policy).map_err(|error| miette::miette!("{error}"))?;
        let weight = robot.mass() * omniwalk_env::engine::GRAVITY;
        let identity = policy.identity();
        let trained = identity.latency.map(f64::from);
        let friction = plant.world().friction.tangential;
        let limits = Limits {
            velocity: [identity.curriculum.lower, identity.curriculum.upper],
            friction: range(0.05, 1.5_f64.max(friction), friction),
            latency: range(0.0, 0.15_f64.max(trained[1]), 0.5 * (trained[0] + trained[1])),
            payload: range(0.0, (5.0 * robot.mass()).round() / 10.0, 0.0),
            push: MOST_PUSH * weight,
        };
        let joints = robot.policy.len();
        let longest = limits.latency.upper * f64::from(settings.env.engine.control_hz);
        let mut drive = Self {
            plant,
            controller,
            history: History::new(joints, longest),
            telemetry: Telemetry::new(robot),
            weight,
            friction,
            latency: limits.latency.start,
            payload: 0.0,
            limits,
            desired: [0.0; 3],
            patience: 0,
            push: ([0.0; 2], 0),
            targets: vec![0.0; joints],
            joint_targets: robot.nominal(),
            substeps: settings.env.substeps(),
            step: 0,
            status: None,
            falls: 0,
            lies: None,
        };
        drive.start();
        Ok(drive)
    }

    /// What orders may ask for.
    pub fn limits(&self) -> &Limits {
        &self.limits
    }

    /// The control period, ns.
    pub fn period(&self) -> u64 {
        self.controller.period()
    }

    /// Simulated time, ns.
    pub fn now(&self) -> u64 {
        self.step * self.period()
    }

    /// What the controller is doing, and what keeps it from walking.
    pub fn mode(&self) -> (&'static str, Option<&'static str>) {
        let Some(status) = &self.status else {
            return ("resting", None);
        };
        let mode = match status.mode {
            Mode::Walking => "walking",
            Mode::Holding => "holding",
            Mode::Ramping => "ramping",
            Mode::Resting => "resting",
        };
        let fault = status.fault.map(|fault| match fault {
            Fault::Stale { .. } => "readings are too old",
            Fault::NotFinite { .. } => "a reading is not a number",
            Fault::Absurd { .. } => "a reading cannot be",
            Fault::Fallen => "fallen",
            Fault::OverRate => "too many steps",
        });
        (mode, fault)
    }

    /// How often it has fallen.
    pub fn falls(&self) -> u32 {
        self.falls
    }

    /// The value of a condition now.
    pub fn condition(&self, condition: Condition) -> f64 {
        match condition {
            Condition::Friction => self.friction,
            Condition::Latency => self.latency,
            Condition::Payload => self.payload,
        }
    }

    /// Does what is ordered; a recording is not its business.
    pub fn obey(&mut self, order: Order) {
        match order {
            Order::Walk { velocity } => {
                self.desired = velocity;
                self.patience = self.steps(PATIENCE);
            }
            Order::Push { force } => self.push = (force, self.steps(PUSH_SECONDS)),
            Order::Set { condition, value } => self.set(condition, value),
            Order::Stand {} => self.stand(),
            Order::Record { .. } => {}
        }
    }

    /// One control step: the controller acts on the readings that have reached it, physics goes on, sensors are read.
    pub fn step(&mut self) {
        if self.patience == 0 {
            self.desired = [0.0; 3];
        }
        self.patience = self.patience.saturating_sub(1);
        let now = self.now();
        let measured = now.saturating_sub((self.latency * 1e9) as u64);
        let reading = self.history.delayed(0.0);
        let sensors = Sensors {
            position: &reading.position,
            velocity: &reading.velocity,
            attitude: reading.attitude,
            gyro: reading.gyro,
            base_velocity: None,
        };
        let status = self
            .controller
            .step(now, measured, &sensors, self.desired, &mut self.targets);
        self.status = Some(status);
        self.plant.set_targets(&self.targets);
        let [x, y] = self.force();
        self.plant.push(Vector3::new(x, y, 0.0));
        (0..self.substeps).for_each(|_| self.plant.step());
        self.push.1 = self.push.1.saturating_sub(1);
        self.step += 1;
        let reading = self.plant.measure();
        self.history.record(|newest| newest.clone_from(reading));
        self.look();
    }

    /// The moment after the last step, as a row for the page.
    pub fn row(&mut self, out: &mut Vec<u8>) {
        let base = self.plant.base();
        let truth = Truth::new(&base);
        let [along, left] = truth.velocity_along(truth.heading);
        for (d, target) in self.joint_targets.iter_mut().enumerate() {
            *target = self.plant.target(d);
        }
        let joints = self.plant.joints();
        let moment = Moment {
            time: self.now() as f64 * 1e-9,
            base: Isometry3::from_parts(Translation3::from(base.position), base.orientation),
            command: self.desired.map(f64::from),
            velocity: [along, left, truth.vertical_turn],
            push: self.force(),
            joints: [&joints.position, &joints.velocity, &joints.torque, &self.joint_targets],
        };
        let loads = self.plant.foot_loads().iter();
        moment.write(loads.map(|&load| load > CONTACT * self.weight), out);
    }

    /// What a robot would log of the last step, which ended at `now`, each with its time, ns.
    pub fn messages(&self, now: u64) -> Vec<(u64, Message)> {
        let base = self.plant.base();
        let began = now - self.period();
        let mut messages = vec![(began, self.telemetry.targets(began, &self.targets))];
        let reading = self.history.newest();
        let torques = self.plant.torques();
        let readings = self.telemetry.reading(now, reading, torques, &base, self.desired);
        messages.extend(readings.map(|message| (now, message)));
        let positions = &self.plant.joints().position;
        messages.push((now, self.telemetry.transforms(now, &base, positions)));
        messages.push((now, odometry(now, &base)));
        messages
    }

    /// The robot's description.
    pub fn description(&self) -> Message {
        self.telemetry.description()
    }

    /// The push now, N.
    fn force(&self) -> [f64; 2] {
        match self.push {
            (force, 1..) => force,
            _ => [0.0; 2],
        }
    }

    fn steps(&self, seconds: f64) -> u64 {
        (seconds * 1e9 / self.period() as f64).round() as u64
    }

    fn set(&mut self, condition: Condition, value: f64) {
        match condition {
            Condition::Friction => self.friction = value,
            Condition::Payload => self.payload = value,
            Condition::Latency => {
                self.latency = value;
                return self.history.set_delay(self.delay());
            }
        }
        let mut world = self.plant.nominal().clone();
        world.friction.tangential = self.friction;
        world.links[0].mass += self.payload;
        self.plant.change_world(world);
    }

    /// Latency in control steps.
    fn delay(&self) -> f64 {
        self.latency * 1e9 / self.period() as f64
    }

    /// Notices a fall, and stands a fallen robot up again after a while.
    fn look(&mut self) {
        if !self.plant.is_finite() {
            self.falls += 1;
            return self.stand();
        }
        match self.lies {
            None if !self.plant.stands() => {
                self.falls += 1;
                self.lies = Some(self.steps(LIE));
            }
            None => {}
            Some(0) => self.stand(),
            Some(left) => self.lies = Some(left - 1),
        }
    }

    /// The robot stands where it is, or where it began if it is nowhere.
    fn stand(&mut self) {
        let truth = self.plant.truth();
        let here = [truth.position.x, truth.position.y];
        let [x, y] = truth.heading;
        match here.iter().chain(&truth.heading).all(|x| x.is_finite()) && self.plant.is_finite() {
            true => self.plant.stand(here, y.atan2(x)),
            false => self.plant.stand([0.0; 2], 0.0),
        }
        self.start();
    }

    fn start(&mut self) {
        self.lies = None;
        self.push.1 = 0;
        self.desired = [0.0; 3];
        self.controller.reset(self.controller.reset_phase());
        let delay = self.delay();
        let reading = self.plant.measure();
        self.history.reset(delay, |first| first.clone_from(reading));
    }
}

fn range(lower: f64, upper: f64, start: f64) -> Range {
    Range { lower, upper, start }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// The policy of the repository, that walks.
    fn drive(engine: &str) -> Drive {
        let home = Path::new(env!("CARGO_MANIFEST_DIR"));
        let policy = home.join("runs/nimbro_op2x_omni/policy.omni");
        let changes = ["friction.enabled=false".to_owned(), format!("engine.kind={engine}")];
        let robot = home.join("robots/nimbro_op2x");
        Drive::new(&Deployed::open(&policy, Some(&robot), &changes).unwrap(), 1).unwrap()
    }

    fn play(drive: &mut Drive, velocity: [f32; 3], seconds: f64) {
        for _ in 0..drive.steps(seconds) {
            drive.obey(Order::Walk { velocity });
            drive.step();
        }
    }

    fn x(drive: &Drive) -> f64 {
        drive.plant.base().position.x
    }

    #[test]
    fn it_walks_while_it_is_told_and_stops_when_nothing_is_heard() {
        for engine in ["rapier", "lanes"] {
            let mut drive = drive(engine);
            play(&mut drive, [0.3, 0.0, 0.0], 5.0);
            let walked = x(&drive);
            assert!(
                (0.8..2.0).contains(&walked),
                "{engine}: {walked} m in 5 s at 0.3 m/s with a start"
            );
            (0..drive.steps(3.0)).for_each(|_| drive.step());
            let stopped = x(&drive);
            (0..drive.steps(2.0)).for_each(|_| drive.step());
            assert!((x(&drive) - stopped).abs() < 0.2, "{engine}: it goes on");
            assert_eq!((drive.falls(), drive.mode()), (0, ("walking", None)), "{engine}");
        }
    }

    #[test]
    fn conditions_change_under_the_walking_robot() {
        let mut drive = drive("rapier");
        play(&mut drive, [0.2, 0.0, 0.0], 2.0);
        for (condition, value) in [
            (Condition::Payload, 2.0),
            (Condition::Friction, 0.4),
            (Condition::Latency, 0.04),
        ] {
            let before = drive.plant.base();
            drive.obey(Order::Set { condition, value });
            let after = drive.plant.base();
            assert!(
                (after.position - before.position).norm() < 1e-9,
                "{condition:?} moves the robot"
            );
            assert!((after.linear_velocity - before.linear_velocity).norm() < 1e-9);
            assert_eq!(drive.condition(condition), value);
            play(&mut drive, [0.2, 0.0, 0.0], 2.0);
        }
        let nominal = drive.plant.nominal().clone();
        let world = drive.plant.world();
        assert_eq!(world.links[0].mass, nominal.links[0].mass + 2.0);
        assert_eq!(world.friction.tangential, 0.4);
        assert_eq!(drive.falls(), 0);
        // Older than the controller takes: it holds, and says why.
        drive.obey(Order::Set {
            condition: Condition::Latency,
            value: 0.15,
        });
        drive.step();
        assert_eq!(drive.mode().1, Some("readings are too old"));
    }

    #[test]
    fn a_robot_that_was_pushed_over_stands_up_again() {
        let mut drive = drive("lanes");
        drive.obey(Order::Push {
            force: [0.0, drive.limits().push],
        });
        play(&mut drive, [0.0; 3], 2.0);
        assert_eq!((drive.falls(), drive.mode().1), (1, Some("fallen")));
        play(&mut drive, [0.0; 3], 3.0);
        assert_eq!((drive.falls(), drive.mode()), (1, ("walking", None)));
        assert!(drive.plant.stands());
    }

    #[test]
    fn a_row_has_a_number_for_each_field() {
        let mut drive = drive("lanes");
        drive.step();
        let mut row = Vec::new();
        drive.row(&mut row);
        let robot = omniwalk_env::robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x"));
        assert_eq!(row.len(), 4 * super::super::row::fields(&robot.unwrap()).len());
    }
}
