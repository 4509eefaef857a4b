//! Does the physics make sense before anything is learned? A robot that holds its nominal pose stands, its weight
//! equals the contact force, a mirrored start gives a mirrored motion.

use std::sync::Arc;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::actuators::Actuators;
use crate::config::EnvConfig;
use crate::engine::{self, Engine, Start};
use crate::error::EnvError;
use crate::random::Stream;
use crate::robot::Robot;
use crate::task::shared::Shared;

/// How a robot stood.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Standing {
    /// Time until the base had sunk below 70 % of its height or tilted by more than 0.7 rad, s; `None` if never.
    pub fell_after: Option<f64>,
    /// Change of the base's height, m.
    pub sunk: f64,
    /// Tilt of the base against the vertical at the end, rad.
    pub tilt: f64,
    /// Horizontal distance the base moved, m.
    pub moved: f64,
    /// Mean vertical ground force of the last second over the weight.
    pub force_over_weight: f64,
}

/// How targets follow the robot in a probe.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// Targets stay at the nominal pose.
    Nominal,
    /// Each control step sets the targets to the measured positions: what a zero increment does. The robot yields.
    Measured,
}

/// Lets the robot stand for `seconds` under its position servos alone.
///
/// # Errors
/// [`EnvError`] when the engine does not take the robot.
pub fn stand(robot: &Arc<Robot>, config: &EnvConfig, hold: Hold, seconds: f64) -> Result<Standing, EnvError> {
    let mut rig = Rig::new(robot, config, 1)?;
    let start = rig.nominal_start();
    rig.start(0, &start);
    let (steps, substeps) = (
        (seconds * f64::from(config.engine.control_hz)) as u32,
        config.substeps(),
    );
    let first = rig.engine.base(0);
    let (mut fell_after, mut force, mut counted) = (None, 0.0, 0.0);
    for step in 0..steps {
        if hold == Hold::Measured {
            rig.hold_measured();
        }
        for _ in 0..substeps {
            rig.step();
            if step + config.engine.control_hz >= steps {
                force += (0..robot.feet.len())
                    .map(|f| rig.engine.foot_force(0, f).z)
                    .sum::<f64>();
                counted += 1.0;
            }
        }
        let base = rig.engine.base(0);
        let fallen = base.position.z < 0.7 * first.position.z || tilt(&base.orientation) > 0.7;
        if fallen && fell_after.is_none() {
            fell_after = Some(f64::from(step + 1) * config.control_dt());
        }
    }
    let last = rig.engine.base(0);
    let moved = (last.position - first.position).xy().norm();
    Ok(Standing {
        fell_after,
        sunk: first.position.z - last.position.z,
        tilt: tilt(&last.orientation),
        moved,
        force_over_weight: force / counted / rig.shared.weight,
    })
}

/// Largest difference, rad or m, between a motion from a disturbed start and the mirror image of the motion from
/// the mirrored start, over `seconds`; `None` for a robot without a mirror map.
///
/// # Errors
/// [`EnvError`] when the engine does not take the robot.
pub fn mirror_difference(robot: &Arc<Robot>, config: &EnvConfig, seconds: f64) -> Result<Option<f64>, EnvError> {
    let Some(map) = &robot.mirror else { return Ok(None) };
    let mut rig = Rig::new(robot, config, 2)?;
    let mut start = rig.nominal_start();
    let mut stream = Stream::new(1, 0, 0);
    for &d in &robot.policy {
        start.joints[d] += stream.normal(0.02);
        start.joint_velocities[d] += stream.normal(0.1);
    }
    start.position.z += 0.02;
    start.linear_velocity = Vector3::new(0.1, 0.05, 0.0);
    start.angular_velocity = Vector3::new(0.1, 0.05, 0.1);
    let mut mirrored = start.clone();
    mirrored.linear_velocity.y *= -1.0;
    mirrored.angular_velocity = Vector3::new(-0.1, 0.05, -0.1);
    mirrored.orientation = mirror_orientation(&start.orientation);
    for (i, source) in map.iter().enumerate() {
        let (to, from) = (robot.policy[i], robot.policy[source.joint]);
        mirrored.joints[to] = source.sign * start.joints[from];
        mirrored.joint_velocities[to] = source.sign * start.joint_velocities[from];
    }
    rig.start(0, &start);
    rig.start(1, &mirrored);
    let mut largest = 0.0_f64;
    for _ in 0..(seconds * f64::from(config.engine.physics_hz)) as u32 {
        rig.step();
        let q = &rig.engine.joints().position;
        for (i, source) in map.iter().enumerate() {
            let image = source.sign * q[robot.policy[source.joint] * 2];
            largest = largest.max((q[robot.policy[i] * 2 + 1] - image).abs());
        }
        let [a, b] = [0, 1].map(|w| rig.engine.base(w));
        let image = Vector3::new(a.position.x, -a.position.y, a.position.z);
        largest = largest.max((b.position - image).amax());
        largest = largest.max(b.orientation.angle_to(&mirror_orientation(&a.orientation)));
    }
    Ok(Some(largest))
}

/// An orientation seen in a mirror that swaps left and right.
fn mirror_orientation(q: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(q.w, -q.i, q.j, -q.k))
}

fn tilt(orientation: &UnitQuaternion<f64>) -> f64 {
    (orientation * Vector3::z()).z.clamp(-1.0, 1.0).acos()
}

/// An engine with actuators and nothing else around it.
struct Rig {
    shared: Shared,
    engine: Box<dyn Engine>,
    actuators: Actuators,
}

impl Rig {
    fn new(robot: &Arc<Robot>, config: &EnvConfig, worlds: usize) -> Result<Self, EnvError> {
        let shared = Shared::new(robot.clone(), config, 0)?;
        let engine = engine::build(robot, &shared.ground, config, worlds)?;
        Ok(Self {
            actuators: Actuators::new(robot, config.physics_dt(), worlds),
            engine,
            shared,
        })
    }

    fn nominal_start(&self) -> Start {
        Start::nominal(&self.shared.robot)
    }

    fn start(&mut self, world: usize, start: &Start) {
        self.engine.reset(world, start, &self.shared.nominal);
        for d in 0..self.shared.robot.dofs.len() {
            let state = (start.joints[d], start.joint_velocities[d]);
            self.actuators.start(d, world, state, self.shared.robot.dof(d).nominal);
        }
    }

    fn step(&mut self) {
        self.engine.step(self.actuators.drive(self.engine.joints()));
        self.actuators.sense(self.engine.joints());
    }

    fn hold_measured(&mut self) {
        for &d in &self.shared.robot.policy {
            self.actuators.set_target(d, 0, self.engine.joints().position[d]);
        }
    }
}
