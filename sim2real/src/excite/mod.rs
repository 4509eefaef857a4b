//! What to record: command trajectories that show a robot's effects apart, within its limits.
//!
//! Every joint makes slow triangles and staircases (friction by direction and position, play, gravity), steps (delay,
//! torque limit, elasticity), and chirps and multisines (inertia, viscous friction, delay): alone with the others
//! held, and all together. Amplitudes are such that position, speed and an estimate of the torque stay below the
//! limits, and that no pair of links that the robot says may overlap does. The base is taken to be on a stand.

mod apart;
mod examine;
mod limits;
mod wave;
mod write;

use std::collections::BTreeMap;

use omniwalk_env::robot::{Base, Robot};
use serde::Serialize;

use crate::identify::Confused;

use limits::Limits;
use wave::{Shape, Wave};
pub use write::write;

/// Commands per second.
pub const COMMAND_RATE: f64 = 100.0;
/// Time to go from the nominal pose to the middle of a motion, and back, s.
const APPROACH: f64 = 1.0;
/// Amplitudes are halved this often to be free of overlaps and within torque limits, before a motion is given up.
const HALVINGS: usize = 6;

/// A motion to command.
#[derive(Clone, Debug)]
pub struct Motion {
    /// What it is: shape and joint, or `all`.
    pub name: String,
    /// Targets of the policy's joints, at [`COMMAND_RATE`], rad or m.
    pub targets: Vec<Vec<f64>>,
    /// What it shows of the joints that move.
    pub information: Vec<Information>,
}

/// What a motion shows of a joint: how much it has of what effects depend on.
#[derive(Clone, Debug, Serialize)]
pub struct Information {
    /// The joint.
    pub joint: String,
    /// Smallest and largest target, rad or m: what offset, gravity and ripple depend on.
    pub range: [f64; 2],
    /// Times the direction changes: what shows play and dry friction.
    pub reversals: usize,
    /// Largest speed over the motor's limit: what viscous friction and the torque-speed line depend on. Jumps of
    /// the target are left out.
    pub speed_share: f64,
    /// Share of the moving time below a tenth of the speed limit: what Stribeck friction depends on.
    pub slow_share: f64,
    /// Largest jump of the target, rad or m: what shows delay and limits.
    pub jump: f64,
    /// Root mean square torque that acceleration takes over the torque limit: what inertia depends on.
    pub inertia_share: f64,
    /// Range of the gravity torque over the torque limit: what load-dependent friction and mass depend on.
    pub load_share: f64,
    /// By effect of the library, at a typical size: root mean square of what it changes of the joint's readings that re-tuning the nominal model
    /// does not, rad or m. Of motions of this joint alone, once they were [examined](Plan::examine).
    pub shows: BTreeMap<String, f64>,
}

/// The motions for a robot, and joints that are left out with the reason.
#[derive(Clone, Debug, Default)]
pub struct Plan {
    /// To be recorded one by one, from the nominal pose and back to it.
    pub motions: Vec<Motion>,
    /// What could not be done.
    pub notes: Vec<String>,
    /// Effects that the motions of their joint do not show apart, once they were [examined](Self::examine).
    pub confused: Vec<Confused>,
}

/// `robot`, all of whose joints with an actuator are commanded where it has none for a policy: a rig's turn without limits.
pub fn commanded(robot: &Robot) -> Robot {
    let mut robot = robot.clone();
    if robot.policy.is_empty() {
        let actuated = |&dof: &usize| robot.dof(dof).actuator.is_some();
        robot.policy = (0..robot.dofs.len()).filter(actuated).collect();
    }
    robot
}

/// `robot` as it is excited: on a stand, if its base is not held anyway.
pub fn held(robot: &Robot) -> Robot {
    match robot.base {
        Base::Floating => robot.on_a_stand(),
        Base::Fixed => robot.clone(),
    }
}

impl Plan {
    /// The motions of one of the policy's joints of `robot`, the others held.
    pub fn alone(robot: &Robot, joint: usize) -> Self {
        let limits = Limits::new(robot);
        let mut plan = Self::default();
        for shape in Shape::ALL {
            plan.add(&limits, shape, &[joint]);
        }
        plan
    }

    /// The motions for the policy's joints of `robot`.
    pub fn new(robot: &Robot) -> Self {
        let limits = Limits::new(robot);
        let mut plan = Self::default();
        let (able, unable): (Vec<usize>, Vec<usize>) =
            (0..robot.policy.len()).partition(|&joint| limits.can_move(joint));
        for joint in unable {
            plan.notes.push(format!(
                "{} is left out: between its limits, or at its speed, it hardly moves",
                limits.name(joint)
            ));
        }
        for shape in Shape::ALL {
            let alone = able.iter().map(|&joint| vec![joint]);
            let all = (able.len() > 1).then(|| able.clone());
            for moving in alone.chain(all) {
                plan.add(&limits, shape, &moving);
            }
        }
        plan
    }

    /// Total time of the motions, s.
    pub fn seconds(&self) -> f64 {
        let commands: usize = self.motions.iter().map(|motion| motion.targets.len()).sum();
        commands as f64 / COMMAND_RATE
    }

    fn add(&mut self, limits: &Limits<'_>, shape: Shape, moving: &[usize]) {
        let name = match moving {
            // Names of joints may hold what ends a folder's name.
            [joint] => format!("{}-{}", shape.name(), limits.name(*joint).replace(['/', '\\'], "_")),
            _ => format!("{}-all", shape.name()),
        };
        let mut scale = 1.0;
        let mut why = None;
        for _ in 0..HALVINGS {
            let targets = trajectory(limits, shape, moving, scale);
            why = limits.fault(&targets);
            if why.is_none() {
                if scale < 1.0 {
                    self.notes
                        .push(format!("{name}: {scale} of the amplitude that joint limits allow"));
                }
                let information = moving
                    .iter()
                    .map(|joint| limits.information(*joint, &targets))
                    .collect();
                self.motions.push(Motion {
                    name,
                    targets,
                    information,
                });
                return;
            }
            scale *= 0.5;
        }
        self.notes
            .push(format!("{name} is left out: {}", why.unwrap_or_default()));
    }
}

/// Targets over time: from the nominal pose to the middle, the motion, and back.
fn trajectory(limits: &Limits<'_>, shape: Shape, moving: &[usize], scale: f64) -> Vec<Vec<f64>> {
    let waves: Vec<(usize, Wave)> = moving
        .iter()
        .enumerate()
        .map(|(place, joint)| (*joint, Wave::new(shape, &limits.room(*joint, scale), place)))
        .collect();
    let seconds = shape.seconds();
    let count = ((2.0 * APPROACH + seconds) * COMMAND_RATE).round() as usize;
    let nominal = limits.nominal();
    let at = |step: usize| {
        let time = step as f64 / COMMAND_RATE - APPROACH;
        let way = smooth((time / APPROACH + 1.0).min((seconds - time) / APPROACH + 1.0));
        let mut targets = nominal.clone();
        for (joint, wave) in &waves {
            targets[*joint] += way * (limits.middle(*joint) - nominal[*joint]) + wave.at(time.clamp(0.0, seconds));
        }
        targets
    };
    (0..=count).map(at).collect()
}

/// From 0 to 1 without jerks at the ends.
fn smooth(share: f64) -> f64 {
    let x = share.clamp(0.0, 1.0);
    x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)
}

#[cfg(test)]
mod tests;
