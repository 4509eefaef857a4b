//! The moving load of both engines' benches: NimbRo-OP2X with random targets, every world reset when it has fallen.

use std::path::Path;

use omniwalk_env::engine::{Drive, Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Physics step, s.
pub const DT: f64 = 0.005;
/// Physics steps between targets: 25 ms.
pub const STEPS_PER_TARGET: usize = 5;
/// Targets are uniform within this distance of the nominal pose, rad, as in `python/bench_mujoco.py`.
pub const TARGET_RANGE: f64 = 0.3;
/// In every joint, N m: the robot file has none.
pub const DRY_FRICTION: f64 = 0.5;

/// The project's NimbRo-OP2X.
pub fn nimbro() -> Robot {
    robot::load(&Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x")).expect("NimbRo-OP2X")
}

/// An engine with the load that drives it.
pub struct Load<'a, E> {
    pub engine: E,
    pub drive: Drive,
    pub start: Start,
    pub world: World,
    robot: &'a Robot,
    random: ChaCha8Rng,
}

impl<'a, E: Engine> Load<'a, E> {
    /// Every world of `engine` in the nominal pose, with `dry_friction` in every joint, N m.
    pub fn new(robot: &'a Robot, mut engine: E, friction: Friction, dry_friction: f64) -> Self {
        let worlds = engine.worlds();
        let mut drive = Drive::idle(robot.dofs.len(), worlds);
        for d in 0..robot.dofs.len() {
            let Some(actuator) = robot.dof(d).actuator else {
                continue;
            };
            let all = d * worlds..(d + 1) * worlds;
            drive.stiffness[all.clone()].fill(actuator.kp);
            drive.damping[all.clone()].fill(actuator.kd);
            drive.torque_min[all.clone()].fill(-actuator.torque_limit);
            drive.torque_max[all.clone()].fill(actuator.torque_limit);
            drive.friction[all].fill(dry_friction);
        }
        let (start, world) = (Start::nominal(robot), World::nominal(robot, friction));
        (0..worlds).for_each(|w| engine.reset(w, &start, &world));
        Self {
            engine,
            drive,
            start,
            world,
            robot,
            random: ChaCha8Rng::seed_from_u64(1),
        }
    }

    /// Draws new targets within `range` of the nominal pose, rad.
    pub fn draw_targets(&mut self, range: f64) {
        let worlds = self.engine.worlds();
        for (i, target) in self.drive.target.iter_mut().enumerate() {
            *target = self.robot.dof(i / worlds).nominal + range * self.random.random_range(-1.0..=1.0);
        }
    }

    /// Steps under the targets of the last draw.
    pub fn step(&mut self) {
        (0..STEPS_PER_TARGET).for_each(|_| self.engine.step(&self.drive));
    }

    /// Starts the worlds anew whose base is lower than this share of where it started; says how many.
    pub fn reset_fallen(&mut self, share: f64) -> usize {
        let mut fallen = 0;
        for w in 0..self.engine.worlds() {
            if !self.engine.is_finite(w) || self.engine.base(w).position.z < share * self.start.position.z {
                self.engine.reset(w, &self.start, &self.world);
                fallen += 1;
            }
        }
        fallen
    }
}
