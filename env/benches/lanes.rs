//! Cost of a physics step of the lanes engine on one core, per SIMD level and phase.
//!
//! `cargo bench -p omniwalk-env --bench lanes [-- worlds]`. The NimbRo-OP2X at 200 Hz under a moving load: random targets every
//! 25 ms, dry friction in every joint, torsional and rolling friction, resets after falls. The levels take turns, so that all see the same machine.

use std::path::Path;
use std::time::Instant;

use nalgebra::Vector3;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Drive, Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DT: f64 = 0.005;
const STEPS_PER_TARGET: usize = 5;
const TARGETS_PER_ROUND: usize = 10;
const ROUNDS: usize = 40;
/// Targets are uniform within this distance of the nominal pose, rad, as in `python/bench_mujoco.py`.
const TARGET_RANGE: f64 = 0.3;
/// In every joint, N m: the robot file has none.
const DRY_FRICTION: f64 = 0.5;

fn main() {
    let robot = robot::load(Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x"))).expect("robot");
    let worlds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(128);
    println!(
        "{} degrees of freedom, {} joints, {worlds} worlds",
        robot.dofs.len(),
        robot.joints.len()
    );
    let mut loads: Vec<_> = Simd::ALL
        .into_iter()
        .filter(|level| level.is_available())
        .map(|level| Load::new(&robot, worlds, level))
        .collect();
    for _ in 0..ROUNDS {
        for load in &mut loads {
            load.round();
        }
    }
    println!("{:8} {:>22} {:>10}", "level", "us per robot-step", "falls");
    for load in &loads {
        println!(
            "{:8} {:>22.3} {:>10}",
            load.engine.level().name(),
            load.least,
            load.falls
        );
    }
    for load in &mut loads {
        println!("\n{}", load.engine.level().name());
        let steps = (worlds * STEPS_PER_TARGET * TARGETS_PER_ROUND) as f64;
        for (name, seconds) in load.phases() {
            println!("  {name:20} {:.3} us", seconds / steps * 1e6);
        }
    }
}

/// An engine with the load that drives it.
struct Load<'a> {
    robot: &'a Robot,
    engine: Lanes,
    drive: Drive,
    start: Start,
    world: World,
    rng: ChaCha8Rng,
    falls: usize,
    /// Of the fastest round, us per robot-step: other processes share the processor.
    least: f64,
}

impl<'a> Load<'a> {
    fn new(robot: &'a Robot, worlds: usize, level: Simd) -> Self {
        let dofs = robot.dofs.len();
        let start = Start {
            position: robot.base_pose.translation.vector,
            orientation: robot.base_pose.rotation,
            linear_velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            joints: robot.nominal(),
            joint_velocities: vec![0.0; dofs],
        };
        let world = World {
            friction: Friction {
                tangential: 0.6,
                torsional: 0.02,
                rolling: 0.01,
            },
            gravity: Vector3::new(0.0, 0.0, -9.81),
            links: robot.links.iter().map(|link| link.inertial).collect(),
            joints: robot.joints.iter().map(|joint| joint.passive).collect(),
        };
        let mut drive = Drive::idle(dofs, worlds);
        for d in 0..dofs {
            let joint = robot.dof(d);
            let Some(actuator) = joint.actuator else { continue };
            let all = d * worlds..(d + 1) * worlds;
            drive.stiffness[all.clone()].fill(actuator.kp);
            drive.damping[all.clone()].fill(actuator.kd);
            drive.torque_min[all.clone()].fill(-actuator.torque_limit);
            drive.torque_max[all.clone()].fill(actuator.torque_limit);
            drive.friction[all].fill(DRY_FRICTION);
        }
        let mut engine = Lanes::new(robot, DT, worlds, level).expect("available");
        for w in 0..worlds {
            engine.reset(w, &start, &world);
        }
        let rng = ChaCha8Rng::seed_from_u64(1);
        Self {
            robot,
            engine,
            drive,
            start,
            world,
            rng,
            falls: 0,
            least: f64::INFINITY,
        }
    }

    fn round(&mut self) {
        let worlds = self.engine.worlds();
        let mut seconds = 0.0;
        for _ in 0..TARGETS_PER_ROUND {
            for d in 0..self.robot.dofs.len() {
                for w in 0..worlds {
                    self.drive.target[d * worlds + w] =
                        self.robot.dof(d).nominal + self.rng.random_range(-TARGET_RANGE..TARGET_RANGE);
                }
            }
            let begin = Instant::now();
            for _ in 0..STEPS_PER_TARGET {
                self.engine.step(&self.drive);
            }
            seconds += begin.elapsed().as_secs_f64();
            for w in 0..worlds {
                let height = self.engine.base(w).position.z;
                if !self.engine.is_finite(w) || height < 0.7 * self.start.position.z {
                    self.engine.reset(w, &self.start, &self.world);
                    self.falls += 1;
                }
            }
        }
        self.least = self
            .least
            .min(seconds / (worlds * STEPS_PER_TARGET * TARGETS_PER_ROUND) as f64 * 1e6);
    }
    /// Smallest time of every phase in a round.
    fn phases(&mut self) -> Vec<(&'static str, f64)> {
        let mut smallest: Vec<(&'static str, f64)> = vec![];
        for _ in 0..ROUNDS {
            self.engine.time_phases();
            self.round();
            let phases = self.engine.phases();
            if smallest.is_empty() {
                smallest = phases.iter().map(|p| (p.name, p.seconds)).collect();
            }
            for (least, phase) in smallest.iter_mut().zip(phases) {
                least.1 = least.1.min(phase.seconds);
            }
        }
        smallest
    }
}
