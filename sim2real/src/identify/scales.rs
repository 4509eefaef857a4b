//! What is typical for a robot and its logs: the units in which fits are well scaled, and physical priors stated.

use omniwalk_env::effect::{Scale, Site};
use omniwalk_env::robot::{Kinematics, Robot};

use super::trial::Trial;

/// What is typical on a joint, from the robot and the logs.
#[derive(Clone, Copy, Debug)]
pub struct JointScale {
    /// Range of motion, rad or m.
    pub position: f64,
    /// Fast motion, rad/s or m/s.
    pub speed: f64,
    /// Large torque, N m or N.
    pub torque: f64,
    /// Inertia the joint moves, kg m^2 or kg.
    pub inertia: f64,
}

/// What is typical for a robot and its logs.
#[derive(Clone, Debug)]
pub struct Scales {
    /// One a degree of freedom.
    pub joints: Vec<JointScale>,
    /// Mass (kg) and size (m) of each link.
    pub links: Vec<(f64, f64)>,
}

impl Scales {
    /// Typical values of `robot` in `trials`.
    pub fn new(robot: &Robot, trials: &[Trial]) -> Self {
        let mut kinematics = Kinematics::new(robot);
        let joint = |d: usize| {
            let joint = robot.dof(d);
            let inertia = kinematics.moved_inertia(robot, d) + joint.passive.armature;
            let (mut low, mut high, mut speed, mut error) = (f64::INFINITY, f64::NEG_INFINITY, 0.0_f64, 0.0_f64);
            for trial in trials {
                let q = &trial.measured[d];
                // Over 20 ms, which noise of the encoder hardly sways.
                let fast = q.windows(21).map(|w| (w[20] - w[0]).abs() / (20.0 * super::trial::DT));
                speed = fast.fold(speed, f64::max);
                (low, high) = q.iter().fold((low, high), |(l, h), &q| (l.min(q), h.max(q)));
                let told = &trial.told[d];
                let stiffness = joint.actuator.map_or(0.0, |a| a.stiffness());
                let wanted = told.command.mean.iter().zip(q);
                let wanted = wanted.map(|(c, q)| {
                    if told.effort {
                        c.abs()
                    } else {
                        stiffness * (c - q).abs()
                    }
                });
                error = wanted.fold(error, f64::max);
            }
            let limit = joint.actuator.map_or(f64::INFINITY, |a| a.torque_limit);
            let position = (high - low).max(1e-6);
            let speed = speed.max(1e-6);
            let moved = inertia * speed * speed / position;
            JointScale {
                position,
                speed,
                torque: error.min(limit).max(moved),
                inertia,
            }
        };
        let link = |link: &omniwalk_env::robot::Link| {
            let size = link.inertial.com.norm().max(0.02);
            (link.inertial.mass.max(1e-3), size)
        };
        Self {
            joints: (0..robot.dofs.len()).map(joint).collect(),
            links: robot.links.iter().map(link).collect(),
        }
    }

    /// A typical value of a quantity on a degree of freedom or link.
    pub fn of(&self, scale: Scale, site: Site, target: usize) -> f64 {
        let joint = || self.joints[if site == Site::Joint { target } else { 0 }];
        match scale {
            Scale::One | Scale::Time | Scale::Voltage => 1.0,
            Scale::Position => joint().position,
            Scale::Speed => joint().speed,
            Scale::Torque => joint().torque,
            Scale::PerTorque => 1.0 / joint().torque,
            Scale::Damping => joint().torque / joint().speed,
            Scale::Compliance => joint().position / joint().torque,
            Scale::Inertia => joint().inertia,
            Scale::Frequency => 1.0 / joint().position,
            Scale::Mass => self.links[target].0,
            Scale::Length => self.links[target].1,
        }
    }
}
