//! Servos and limits that a URDF does not give, guessed from the robot's weight.

use nalgebra::{Isometry3, Point3};
use omniwalk_env::robot::{Joint, JointKind, Kinematics, Robot};

use super::legs::Leg;

/// Stiffness of each leg joint over weight times height of the centre of mass. Two legs of three such joints in series then
/// hold the robot up with a margin: it topples below 1/2 on two stiff legs.
const STIFFNESS: f64 = 2.0;
/// Torque of a leg's servos over weight times height of the centre of mass, where the URDF has none. NimbRo-OP2X has
/// 0.44, Unitree G1 0.23 to 0.64.
const STRENGTH: f64 = 0.45;
/// kd over kp, s: that of NimbRo-OP2X's pitch joints.
const DAMPING_TIME: f64 = 0.035;
/// Reflected inertia over torque, kg m^2 / (N m): that of a Dynamixel XM540.
const ROTOR: f64 = 0.0015;
/// Position error at which a joint outside the legs gives its full torque, rad.
const REACH: f64 = 0.5;
/// Torque of a joint outside the legs over that which holds level what hangs on it.
const LIFTS: f64 = 4.0;
/// Speed without load, rad/s.
const SPEED: f64 = 5.0;
/// Range to either side of zero, rad; a knee's in the direction in which it bends, and in the other.
const RANGE: f64 = 1.5;
const KNEE: [f64; 2] = [2.2, 0.1];

/// What `robot.toml` says about a joint. `None` where the URDF says it.
#[derive(Clone, Debug)]
pub(super) struct Servo {
    pub joint: String,
    pub kp: f64,
    pub kd: f64,
    pub torque_limit: Option<f64>,
    pub speed_limit: Option<f64>,
    pub armature: f64,
    pub limits: Option<[f64; 2]>,
    pub in_leg: bool,
}

impl Servo {
    /// The same with other gains; arms stay as they are.
    pub fn stiffer(&self, factor: f64) -> Self {
        let factor = if self.in_leg { factor } else { 1.0 };
        Self {
            kp: factor * self.kp,
            kd: factor * self.kd,
            ..self.clone()
        }
    }
}

/// A servo for each degree of freedom, in their order.
pub(super) fn guess(robot: &Robot, legs: &[Leg]) -> Vec<Servo> {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &Isometry3::identity(), &vec![0.0; robot.dofs.len()]);
    let centre = kinematics.center_of_mass(robot.links.iter().map(|link| &link.inertial));
    let sole = |leg: &Leg| (kinematics.pose(leg.foot.link) * leg.foot.sole).translation.z;
    let height = legs.iter().map(|leg| centre.z - sole(leg)).fold(0.0, f64::max);
    let topples = robot.mass() * G * height;
    (0..robot.dofs.len())
        .map(|dof| servo(robot, &kinematics, legs, dof, topples))
        .collect()
}

/// Standard gravity, m/s^2.
const G: f64 = 9.81;

fn servo(robot: &Robot, kinematics: &Kinematics, legs: &[Leg], dof: usize, topples: f64) -> Servo {
    let index = robot.dofs[dof];
    let joint = &robot.joints[index];
    let in_leg = legs.iter().any(|leg| leg.joints.contains(&index));
    let given = joint.actuator.map(|actuator| actuator.torque_limit);
    let torque = given.unwrap_or(match in_leg {
        true => STRENGTH * topples,
        false => LIFTS * hangs(robot, kinematics, index),
    });
    let kp = match in_leg {
        true => (STIFFNESS * topples).max(torque / REACH),
        false => torque / REACH,
    };
    Servo {
        joint: joint.name.clone(),
        kp,
        kd: DAMPING_TIME * kp,
        torque_limit: given.is_none().then_some(torque),
        speed_limit: joint.actuator.is_none().then_some(SPEED),
        armature: ROTOR * torque,
        limits: range(joint, legs, dof),
        in_leg,
    }
}

/// Torque (N m) or force (N) that holds level what hangs on a joint, at least that of 10 g at 10 cm.
fn hangs(robot: &Robot, kinematics: &Kinematics, joint: usize) -> f64 {
    let at = kinematics.pose(joint + 1).translation.vector;
    let carried = |mut link: usize| loop {
        match robot.links[link].parent {
            _ if link == joint + 1 => return true,
            Some(parent) => link = parent,
            None => return false,
        }
    };
    let load = (0..robot.links.len()).filter(|&link| carried(link)).map(|link| {
        let body = &robot.links[link].inertial;
        let arm = (kinematics.pose(link) * Point3::from(body.com)).coords - at;
        match robot.joints[joint].kind {
            JointKind::Revolute => body.mass * G * arm.norm(),
            JointKind::Prismatic => body.mass * G,
        }
    });
    load.sum::<f64>().max(0.01 * G * 0.1)
}

/// Limits for a joint that turns and has none.
fn range(joint: &Joint, legs: &[Leg], dof: usize) -> Option<[f64; 2]> {
    if joint.limits.0.is_finite() || joint.kind == JointKind::Prismatic {
        return None;
    }
    let knee = legs
        .iter()
        .find_map(|leg| leg.pitch.get(1).filter(|(knee, _)| *knee == dof));
    Some(match knee {
        Some((_, axis)) if *axis > 0.0 => [-KNEE[1], KNEE[0]],
        Some(_) => [-KNEE[0], KNEE[1]],
        None => [-RANGE, RANGE],
    })
}
