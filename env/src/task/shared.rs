//! What all environments of a batch have in common: robot, layout, configuration and what follows from them.

use std::sync::Arc;

use nalgebra::Vector3;
use omniwalk_controller::{ActionSpec, Block, ClockSpec, CommandSpec, Spec};

use super::overlap::Overlap;
use super::sole::{SoleShape, with_matrix};
use crate::config::EnvConfig;
use crate::engine::{Friction, GRAVITY, Start, World};
use crate::error::EnvError;
use crate::ground::Ground;
use crate::random::Stream;
use crate::robot::{Kinematics, Robot, matches};
use crate::truth::Truth;

/// Shared, immutable context of a batch.
pub struct Shared {
    /// The robot.
    pub robot: Arc<Robot>,
    /// Configuration.
    pub config: EnvConfig,
    /// What the robots walk on.
    pub ground: Ground,
    /// Layout of observation and action.
    pub spec: Spec,
    /// Seed of every environment's random streams.
    pub seed: u64,
    /// The policy's joints in its order.
    pub joints: Vec<PolicyJoint>,
    /// Soles of the robot's feet.
    pub soles: Vec<SoleShape>,
    /// Policy joints that the pose term regularises.
    pub pose_joints: Vec<usize>,
    /// Leg pairs that must not overlap.
    pub overlap: Overlap,
    /// Weight of the robot, N.
    pub weight: f64,
    /// A world without randomisation.
    pub nominal: World,
    /// Sine of the largest fused roll and pitch of a standing robot.
    tilt: [f64; 2],
}

/// What a control step needs of a joint of the policy.
pub struct PolicyJoint {
    /// Its degree of freedom.
    pub dof: usize,
    /// Lower and upper position limit, rad or m.
    pub limits: (f64, f64),
    /// Position in the nominal pose, rad or m.
    pub nominal: f64,
}

impl Shared {
    /// Derives everything from robot and configuration.
    ///
    /// # Errors
    /// [`EnvError`] when a configured joint name matches no joint, or the task needs what the robot does not have.
    pub fn new(robot: Arc<Robot>, config: &EnvConfig, seed: u64) -> Result<Self, EnvError> {
        if robot.policy.is_empty() {
            return Err(EnvError::NoPolicyJoints {
                robot: robot.name.clone(),
            });
        }
        Ok(Self {
            spec: spec(&robot, config),
            joints: policy_joints(&robot),
            soles: robot.feet.iter().map(SoleShape::new).collect(),
            tilt: [config.task.max_roll, config.task.max_pitch].map(f64::sin),
            pose_joints: pose_joints(&robot, &config.reward.pose_joints)?,
            overlap: Overlap::new(&robot, config.task.overlap_margin),
            weight: robot.mass() * GRAVITY,
            nominal: nominal_world(&robot, config),
            ground: Ground::new(&config.ground),
            config: config.clone(),
            seed,
            robot,
        })
    }

    /// Draws the physical parameters of an episode (thesis 7.4, dynamics randomisation) into `world`.
    pub fn draw_world(&self, stream: &mut Stream, world: &mut World) {
        world.clone_from(&self.nominal);
        let f = &self.config.friction;
        if f.enabled {
            world.friction = Friction {
                tangential: stream.uniform(f.tangential[0], f.tangential[1]),
                torsional: stream.uniform(f.torsional[0], f.torsional[1]),
                rolling: stream.uniform(f.rolling[0], f.rolling[1]),
            };
        }
        let r = &self.config.randomise;
        if r.mass > 0.0 {
            for link in &mut world.links {
                let factor = stream.uniform(1.0 - r.mass, 1.0 + r.mass);
                link.mass *= factor;
                link.inertia *= factor;
            }
        }
        if r.centre_of_mass > 0.0 {
            let mut shift = || stream.uniform(-r.centre_of_mass, r.centre_of_mass);
            world.links[0].com += Vector3::new(shift(), shift(), shift());
        }
    }

    /// Whether a robot stands: its base is high enough above the ground under it and its fused roll and pitch are within their bounds.
    pub fn stands(&self, truth: &Truth) -> bool {
        let [roll, pitch] = self.tilt;
        let lowest = self.config.task.min_height * self.robot.base_pose.translation.z;
        let up = &truth.up;
        // Fused roll and pitch are asin(up_y) and asin(-up_x).
        let height = truth.position.z - self.ground.height(truth.position.x, truth.position.y);
        height > lowest && up.z > 0.0 && up.y.abs() < roll && up.x.abs() < pitch
    }

    /// The robot's nominal start, with the lowest corner of the soles on the ground.
    pub fn nominal_start(&self) -> Start {
        let mut start = Start::nominal(&self.robot);
        if self.ground != Ground::Plane && !self.robot.feet.is_empty() {
            let kinematics = Kinematics::new(&self.robot);
            let feet = self.robot.feet.iter().zip(&self.soles);
            start.position.z -= feet
                .map(|(foot, shape)| shape.at(&with_matrix(kinematics.pose(foot.link)), &self.ground).lowest)
                .fold(f64::INFINITY, f64::min);
        }
        start
    }

    /// Draws the latency of an episode, in control steps.
    pub fn draw_latency(&self, stream: &mut Stream) -> f64 {
        let l = &self.config.latency;
        if l.enabled {
            stream.uniform(l.lower, l.upper) * f64::from(self.config.engine.control_hz)
        } else {
            0.0
        }
    }

    /// Draws by how much a single reading comes later than the latency, in control steps.
    pub fn draw_jitter(&self, stream: &mut Stream) -> f64 {
        let l = &self.config.latency;
        // Nothing is drawn where there is none, so that the other draws of an episode are the same.
        if l.enabled && l.jitter > 0.0 {
            stream.uniform(0.0, l.jitter) * f64::from(self.config.engine.control_hz)
        } else {
            0.0
        }
    }

    /// The longest latency there can be, in control steps.
    pub fn longest_latency(&self) -> f64 {
        self.config.latency.longest() * f64::from(self.config.engine.control_hz)
    }
}

/// The layout of observation and action that robot and configuration give.
pub fn spec(robot: &Robot, config: &EnvConfig) -> Spec {
    let mut observation = config.observation.blocks.clone();
    if config.clock.enabled {
        observation.push(Block::Clock);
    }
    let single = |v: [f64; 3]| v.map(|x| x as f32);
    Spec {
        control_hz: config.engine.control_hz as f32,
        joints: robot.joint_specs(config.action.scale),
        observation,
        action: ActionSpec {
            law: config.action.law,
            filter: config.action.filter.spec(),
            torque_clamp: config.action.torque_clamp,
        },
        clock: config.clock.enabled.then_some(ClockSpec {
            period: config.clock.period as f32,
            reset_phase: 0.0,
        }),
        symmetry: (config.clock.enabled && config.clock.symmetric)
            .then(|| robot.mirror_map())
            .flatten(),
        command: CommandSpec {
            rate: single(config.command.rate),
            lower: single(config.command.lower),
            upper: single(config.command.upper),
        },
        legs: robot.legs(),
        inertial_frame_period: config.observation.inertial_frame_period as f32,
        upright: [config.task.max_roll as f32, config.task.max_pitch as f32],
    }
}

fn nominal_world(robot: &Robot, config: &EnvConfig) -> World {
    let middle = |range: [f64; 2]| 0.5 * (range[0] + range[1]);
    let friction = Friction {
        tangential: middle(config.friction.tangential),
        torsional: middle(config.friction.torsional),
        rolling: middle(config.friction.rolling),
    };
    World::nominal(robot, friction)
}

fn policy_joints(robot: &Robot) -> Vec<PolicyJoint> {
    let joint = |(i, &dof): (usize, &usize)| {
        let joint = robot.policy_joint(i);
        PolicyJoint {
            dof,
            limits: joint.limits,
            nominal: joint.nominal,
        }
    };
    robot.policy.iter().enumerate().map(joint).collect()
}

fn pose_joints(robot: &Robot, patterns: &[String]) -> Result<Vec<usize>, EnvError> {
    let names: Vec<&str> = (0..robot.policy.len())
        .map(|i| robot.policy_joint(i).name.as_str())
        .collect();
    for pattern in patterns {
        if !names.iter().any(|name| matches(pattern, name)) {
            return Err(EnvError::UnknownJoint {
                key: "reward.pose_joints",
                name: pattern.clone(),
                known: names.join(", "),
            });
        }
    }
    let chosen = |&i: &usize| patterns.iter().any(|pattern| matches(pattern, names[i]));
    Ok((0..names.len()).filter(chosen).collect())
}
