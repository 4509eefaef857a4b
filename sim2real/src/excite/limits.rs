//! What a robot on a stand may be told: room of each joint, overlaps, torque.

use nalgebra::{Point3, Vector3};
use omniwalk_env::engine::GRAVITY;
use omniwalk_env::robot::{Joint, JointKind, Kinematics, Robot};
use omniwalk_env::task::overlap::Overlap;

use super::wave::Room;
use super::{COMMAND_RATE, Information, apart};

/// Share of a limit that is used.
const MARGIN: f64 = 0.8;
/// Share of the torque limit that acceleration may take, beside gravity.
const ACCELERATION_SHARE: f64 = 0.4;
/// Amplitude over speed at most, s: of what is farther, staircases would not get from level to level, nor chirps begin, within the speed.
const REACH: f64 = 0.8;
/// Smallest amplitude (rad or m) of a joint that moves, and its smallest speed a second.
const LEAST_AMPLITUDE: f64 = 1e-3;
/// Amplitude of a joint without limits, rad and m.
const FREE: [f64; 2] = [1.5, 0.1];
/// Least distance of a motion's middle from a limit, as a share of the range.
const EDGE: f64 = 0.35;
/// Commands between poses whose overlap and torque are checked: 50 ms.
const STRIDE: usize = 5;

/// A robot with what bounds its motions. Joints are those of the policy, in its order.
pub(super) struct Limits<'r> {
    robot: &'r Robot,
    overlap: Overlap,
    middles: Vec<f64>,
    /// Largest torque of gravity on each joint near its middle, N m or N.
    gravity: Vec<f64>,
    /// Inertia that each joint moves with the others at their middles, kg m^2 or kg.
    inertia: Vec<f64>,
}

impl<'r> Limits<'r> {
    pub fn new(robot: &'r Robot) -> Self {
        let mut limits = Self {
            robot,
            overlap: Overlap::new(&apart::watched(robot), 0.0),
            middles: (0..robot.policy.len()).map(|i| middle(robot.policy_joint(i))).collect(),
            gravity: Vec::new(),
            inertia: Vec::new(),
        };
        let middles = limits.middles.clone();
        limits.inertia = (0..middles.len())
            .map(|joint| limits.moved_inertia(joint, &middles))
            .collect();
        limits.gravity = limits.gravity_torques(&middles);
        limits
    }

    pub fn name(&self, joint: usize) -> &str {
        &self.robot.policy_joint(joint).name
    }

    /// Nominal positions of the joints.
    pub fn nominal(&self) -> Vec<f64> {
        (0..self.middles.len())
            .map(|i| self.robot.policy_joint(i).nominal)
            .collect()
    }

    pub fn middle(&self, joint: usize) -> f64 {
        self.middles[joint]
    }

    /// Whether a joint can move by enough for any effect to show.
    pub fn can_move(&self, joint: usize) -> bool {
        let room = self.room(joint, 1.0);
        room.amplitude >= LEAST_AMPLITUDE && room.speed >= LEAST_AMPLITUDE
    }

    /// What a joint can do about its middle, with `scale` of the amplitude that is there.
    pub fn room(&self, joint: usize, scale: f64) -> Room {
        let spec = self.robot.policy_joint(joint);
        let middle = self.middles[joint];
        let free = FREE[usize::from(spec.kind == JointKind::Prismatic)];
        let side = (middle - spec.limits.0).min(spec.limits.1 - middle);
        let amplitude = scale * MARGIN * if side.is_finite() { side } else { free };
        // Without a motor's data, a second for the whole range.
        let Some(motor) = spec.actuator else {
            return Room {
                amplitude,
                speed: 2.0 * amplitude,
                acceleration: 4.0 * amplitude,
                jump: amplitude,
            };
        };
        let left = (motor.torque_limit - self.gravity[joint]).max(0.1 * motor.torque_limit);
        let speed = MARGIN * motor.speed_limit;
        let amplitude = amplitude.min(REACH * speed);
        Room {
            amplitude,
            speed,
            acceleration: ACCELERATION_SHARE * left / self.inertia[joint],
            jump: scale * MARGIN * left / motor.stiffness(),
        }
    }

    /// What forbids the trajectory, if anything does.
    pub fn fault(&self, targets: &[Vec<f64>]) -> Option<String> {
        let mut kinematics = Kinematics::new(self.robot);
        for at in (0..targets.len()).step_by(STRIDE) {
            self.pose(&mut kinematics, &targets[at]);
            let seconds = at as f64 / COMMAND_RATE;
            let poses = apart::poses(self.robot, &kinematics);
            if self.overlap.any(|link| &poses[link]) {
                return Some(format!("links overlap at {seconds:.2} s"));
            }
            for (joint, torque) in self.gravity_torques(&targets[at]).into_iter().enumerate() {
                let spec = self.robot.policy_joint(joint);
                if spec.actuator.is_some_and(|motor| torque > MARGIN * motor.torque_limit) {
                    return Some(format!("gravity takes {torque:.1} of {} at {seconds:.2} s", spec.name));
                }
            }
        }
        None
    }

    /// What a trajectory shows of a joint.
    pub fn information(&self, joint: usize, targets: &[Vec<f64>]) -> Information {
        let spec = self.robot.policy_joint(joint);
        let position: Vec<f64> = targets.iter().map(|targets| targets[joint]).collect();
        let (speed_limit, torque_limit) = spec.actuator.map_or((f64::INFINITY, f64::INFINITY), |motor| {
            (motor.speed_limit, motor.torque_limit)
        });
        let speeds: Vec<f64> = position
            .windows(2)
            .map(|pair| (pair[1] - pair[0]) * COMMAND_RATE)
            .collect();
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0_f64, |most, value| most.max(value.abs()));
        // What no motor follows is a jump.
        let smooth: Vec<f64> = speeds
            .iter()
            .copied()
            .filter(|speed| speed.abs() <= speed_limit)
            .collect();
        let jumps = speeds
            .iter()
            .filter(|speed| speed.abs() > speed_limit)
            .map(|speed| speed / COMMAND_RATE);
        let moving: Vec<f64> = smooth.iter().copied().filter(|speed| speed.abs() > 1e-6).collect();
        let slow = moving.iter().filter(|speed| speed.abs() < 0.1 * speed_limit).count();
        let directions: Vec<bool> = moving.iter().map(|speed| *speed > 0.0).collect();
        let accelerations = smooth.windows(2).map(|pair| (pair[1] - pair[0]) * COMMAND_RATE);
        let square = accelerations.map(|a| a * a).sum::<f64>() / smooth.len().max(1) as f64;
        let loads: Vec<f64> = targets
            .iter()
            .step_by(STRIDE)
            .map(|targets| self.signed_gravity(joint, targets))
            .collect();
        let fold = |range: [f64; 2], value: &f64| [range[0].min(*value), range[1].max(*value)];
        let [lightest, heaviest] = loads.iter().fold([f64::INFINITY, f64::NEG_INFINITY], fold);
        Information {
            joint: spec.name.clone(),
            range: position.iter().fold([f64::INFINITY, f64::NEG_INFINITY], fold),
            reversals: directions.windows(2).filter(|pair| pair[0] != pair[1]).count(),
            speed_share: largest(&mut smooth.iter().copied()) / speed_limit,
            slow_share: slow as f64 / moving.len().max(1) as f64,
            jump: largest(&mut jumps.into_iter()),
            inertia_share: self.inertia[joint] * square.sqrt() / torque_limit,
            load_share: (heaviest - lightest) / torque_limit,
            shows: std::collections::BTreeMap::new(),
        }
    }

    /// Poses the robot with the policy's joints at `targets`, all others nominal.
    fn pose(&self, kinematics: &mut Kinematics, targets: &[f64]) {
        let mut positions = self.robot.nominal();
        for (dof, target) in self.robot.policy.iter().zip(targets) {
            positions[*dof] = *target;
        }
        kinematics.set_pose(self.robot, &self.robot.base_pose, &positions);
    }

    /// Torque of gravity on each joint, without sign.
    fn gravity_torques(&self, targets: &[f64]) -> Vec<f64> {
        (0..targets.len())
            .map(|joint| self.signed_gravity(joint, targets).abs())
            .collect()
    }

    /// What gravity does on a joint: the power of the links' weights for each unit of the joint's velocity.
    fn signed_gravity(&self, joint: usize, targets: &[f64]) -> f64 {
        let moving = self.unit_velocity(joint, targets);
        let links = self.robot.links.iter().enumerate();
        let power =
            links.map(|(link, body)| -GRAVITY * body.inertial.mass * velocity(&moving, link, body.inertial.com).z);
        power.sum()
    }

    /// Twice the kinetic energy of the robot for unit velocity of a joint.
    fn moved_inertia(&self, joint: usize, targets: &[f64]) -> f64 {
        let moving = self.unit_velocity(joint, targets);
        let links = self.robot.links.iter().enumerate();
        let energy = links.map(|(link, body)| {
            let turning = moving.pose(link).rotation.inverse() * moving.angular_velocity(link);
            let speed = velocity(&moving, link, body.inertial.com);
            body.inertial.mass * speed.norm_squared() + turning.dot(&(body.inertial.inertia * turning))
        });
        let armature = self.robot.policy_joint(joint).passive.armature;
        (energy.sum::<f64>() + armature).max(1e-9)
    }

    fn unit_velocity(&self, joint: usize, targets: &[f64]) -> Kinematics {
        let mut kinematics = Kinematics::new(self.robot);
        self.pose(&mut kinematics, targets);
        let mut velocities = vec![0.0; self.robot.dofs.len()];
        velocities[self.robot.policy[joint]] = 1.0;
        kinematics.set_velocity(self.robot, &Vector3::zeros(), &Vector3::zeros(), &velocities);
        kinematics
    }
}

fn velocity(kinematics: &Kinematics, link: usize, com: Vector3<f64>) -> Vector3<f64> {
    kinematics.velocity_at(link, &(kinematics.pose(link) * Point3::from(com)))
}

/// Where a joint moves about: its nominal position, away from the limits.
fn middle(joint: &Joint) -> f64 {
    let (lower, upper) = joint.limits;
    if !(upper - lower).is_finite() {
        return joint.nominal;
    }
    let edge = EDGE * (upper - lower);
    joint.nominal.clamp(lower + edge, upper - edge)
}
