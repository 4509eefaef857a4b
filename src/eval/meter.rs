//! What is measured of a walking robot between two resets, from its true state after each control step.

use omniwalk_env::robot::Robot;
use omniwalk_env::task::episode::End;
use omniwalk_env::task::gait::Gait;
use omniwalk_env::task::shared::Shared;
use omniwalk_env::task::tracking::{Tracking, TrackingMeter};

use super::trial::Seen;

/// A joint counts as saturated from this share of its torque limit on.
const SATURATED: f64 = 0.99;

/// How a robot walked from one reset to a fall or to the end of what was asked.
#[derive(Clone, Debug, PartialEq)]
pub struct Record {
    /// How it fell; `None` if it did not.
    pub end: Option<End>,
    /// Duration, s.
    pub seconds: f64,
    /// How well commands were held.
    pub tracking: Option<Tracking>,
    /// Steps, contacts, slip.
    pub gait: Gait,
    /// Effort and regularity.
    pub effort: Effort,
    /// Horizontal distance from where it started, m.
    pub drift: f64,
}

/// Effort and regularity of a gait, of the policy's joints, sampled once a control step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Effort {
    /// Root mean square over joints and time of the torque against its limit.
    pub torque_rms: f64,
    /// Share of joints and time with the torque at its limit.
    pub torque_saturated: f64,
    /// Largest joint speed against its limit.
    pub speed_max: f64,
    /// Mean square change of the action per step, in half ranges.
    pub action_change: f64,
    /// Positive mechanical work of the joints over weight times way along the command; only while the command
    /// moves the robot along the ground.
    pub cost_of_transport: Option<f64>,
    /// Root mean square over the joints of how much mean and standard deviation of their positions differ from those
    /// of the mirrored joint, rad or m: nought for any gait that does on the right what it does on the left, at whatever
    /// time. Only for robots with a mirror map.
    pub asymmetry: Option<f64>,
}

/// Sums for a [`Record`].
pub struct Meter {
    tracking: CommandMeter,
    joints: Vec<JointSums>,
    previous_action: Vec<f32>,
    steps: u32,
    action_change: f64,
    work: f64,
    way: f64,
    start: Option<[f64; 2]>,
    position: [f64; 2],
}

#[derive(Clone, Default)]
struct JointSums {
    position: f64,
    position_squared: f64,
    torque_squared: f64,
    saturated: u32,
    speed_max: f64,
}

/// A [`TrackingMeter`] that reads what it needs.
pub struct CommandMeter(TrackingMeter);

impl CommandMeter {
    /// With a window of a second at `control_hz`.
    pub fn new(control_hz: u32) -> Self {
        Self(TrackingMeter::new(control_hz as usize))
    }

    /// Takes in a step.
    pub fn step(&mut self, seen: &Seen<'_>) {
        let commanded = seen.environment.pipeline().commanded().map(f64::from);
        let desired = seen.environment.desired();
        let reached = (0..3).all(|k| (commanded[k] - desired[k]).abs() < 1e-4);
        self.0.step(seen.velocity(), commanded, reached);
    }

    /// Forgets what was; gives how well commands were held until then.
    pub fn take(&mut self) -> Option<Tracking> {
        let tracking = self.0.tracking();
        self.0.reset();
        tracking
    }
}

impl Meter {
    /// A meter at rest, for a control rate of `control_hz`.
    pub fn new(control_hz: u32) -> Self {
        Self {
            tracking: CommandMeter::new(control_hz),
            joints: Vec::new(),
            previous_action: Vec::new(),
            steps: 0,
            action_change: 0.0,
            work: 0.0,
            way: 0.0,
            start: None,
            position: [0.0; 2],
        }
    }

    /// Takes in a step that did not end the episode.
    pub fn step(&mut self, seen: &Seen<'_>) {
        let robot = &seen.shared.robot;
        self.joints.resize(robot.policy.len(), JointSums::default());
        self.tracking.step(seen);
        let change = |(a, b): (&f32, &f32)| f64::from(2.0 * (a - b)).powi(2);
        let changes: f64 = seen.action.iter().zip(&self.previous_action).map(change).sum();
        self.action_change += changes / seen.action.len() as f64;
        self.previous_action.clear();
        self.previous_action.extend_from_slice(seen.action);
        let power = self.joints(seen);
        let (velocity, desired) = (seen.velocity(), seen.environment.desired());
        let speed = desired[0].hypot(desired[1]);
        if speed > 0.0 {
            let dt = seen.shared.config.control_dt();
            self.work += power * dt;
            self.way += (velocity[0] * desired[0] + velocity[1] * desired[1]) / speed * dt;
        }
        let p = seen.base().position;
        self.position = [p.x, p.y];
        self.start.get_or_insert(self.position);
        self.steps += 1;
    }

    /// Takes in the joints; gives their positive power, W.
    fn joints(&mut self, seen: &Seen<'_>) -> f64 {
        let (robot, state, worlds) = (&seen.shared.robot, seen.engine.joints(), seen.engine.worlds());
        let mut power = 0.0;
        for (i, (sums, &d)) in self.joints.iter_mut().zip(&robot.policy).enumerate() {
            let k = d * worlds + seen.world;
            let (position, velocity, torque) = (state.position[k], state.velocity[k], state.torque[k]);
            sums.position += position;
            sums.position_squared += position * position;
            power += (torque * velocity).max(0.0);
            if let Some(motor) = robot.policy_joint(i).actuator {
                let share = torque.abs() / motor.torque_limit;
                sums.torque_squared += share * share;
                sums.saturated += u32::from(share >= SATURATED);
                sums.speed_max = sums.speed_max.max(velocity.abs() / motor.speed_limit);
            }
        }
        power
    }

    /// What was measured until the step `seen`, with which this ends; the meter starts anew.
    pub fn record(&mut self, seen: &Seen<'_>) -> Record {
        let config = &seen.shared.config;
        let mut done = std::mem::replace(self, Self::new(config.engine.control_hz));
        let start = done.start.unwrap_or(done.position);
        Record {
            end: seen.ended.map(|episode| episode.end),
            seconds: f64::from(done.steps) * config.control_dt(),
            tracking: done.tracking.take(),
            gait: seen
                .ended
                .map_or_else(|| seen.environment.gait().gait(), |episode| episode.gait),
            effort: done.effort(seen.shared),
            drift: (done.position[0] - start[0]).hypot(done.position[1] - start[1]),
        }
    }

    fn effort(&self, shared: &Shared) -> Effort {
        let n = f64::from(self.steps.max(1));
        let joints = &self.joints;
        let all = n * joints.len().max(1) as f64;
        Effort {
            torque_rms: (joints.iter().map(|j| j.torque_squared).sum::<f64>() / all).sqrt(),
            torque_saturated: joints.iter().map(|j| f64::from(j.saturated)).sum::<f64>() / all,
            speed_max: joints.iter().map(|j| j.speed_max).fold(0.0, f64::max),
            action_change: self.action_change / n,
            cost_of_transport: (self.way > 0.0).then(|| self.work / (shared.weight * self.way)),
            asymmetry: asymmetry(joints, n, &shared.robot),
        }
    }
}

fn asymmetry(joints: &[JointSums], n: f64, robot: &Robot) -> Option<f64> {
    let map = robot.mirror.as_ref().filter(|map| map.len() == joints.len())?;
    let moments = |j: &JointSums| {
        let mean = j.position / n;
        (mean, (j.position_squared / n - mean * mean).max(0.0).sqrt())
    };
    let differences = joints.iter().zip(map).map(|(joint, source)| {
        let ((mean, spread), (other, other_spread)) = (moments(joint), moments(&joints[source.joint]));
        (mean - source.sign * other).powi(2) + (spread - other_spread).powi(2)
    });
    Some((differences.sum::<f64>() / joints.len() as f64).sqrt())
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    /// Sums of joints that swing with the given means and amplitudes.
    fn swinging(of: impl Fn(usize) -> (f64, f64, f64), joints: usize) -> Vec<JointSums> {
        let position = |i: usize, k: u32| {
            let (mean, amplitude, phase) = of(i);
            mean + amplitude * (std::f64::consts::TAU * (f64::from(k) / 40.0 + phase)).sin()
        };
        (0..joints)
            .map(|i| JointSums {
                position: (0..400).map(|k| position(i, k)).sum(),
                position_squared: (0..400).map(|k| position(i, k).powi(2)).sum(),
                ..JointSums::default()
            })
            .collect()
    }

    #[test]
    fn legs_in_opposite_phase_are_symmetric_and_a_limp_is_not() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("robots/nimbro_op2x");
        let robot = omniwalk_env::robot::load(&path).unwrap();
        let map = robot.mirror.as_ref().unwrap();
        let joints = robot.policy.len();
        // The joint with the smaller index of each pair leads by half a cycle.
        let even = swinging(
            |i| {
                let source = map[i];
                let first = i <= source.joint;
                let sign = if first { 1.0 } else { source.sign };
                // A joint that is its own mirror image with the sign turned must be centred.
                let centre = if i == source.joint && source.sign < 0.0 {
                    0.0
                } else {
                    0.3
                };
                (sign * centre, 0.2, if first { 0.0 } else { 0.5 })
            },
            joints,
        );
        assert!(asymmetry(&even, 400.0, &robot).unwrap() < 1e-7);
        // One joint swings 0.1 rad less: the deviation of a sine is its amplitude over the root of two, and the
        // difference shows in both joints of the pair.
        let pair = (0..joints).find(|&i| map[i].joint != i).unwrap();
        let limp = swinging(|i| (0.0, if i == pair { 0.1 } else { 0.2 }, 0.0), joints);
        let expected = (2.0 * (0.1_f64.powi(2) / 2.0) / joints as f64).sqrt();
        assert!((asymmetry(&limp, 400.0, &robot).unwrap() - expected).abs() < 1e-9);
    }
}
