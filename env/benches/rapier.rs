//! Physics steps per second of the rapier engine on one core: NimbRo-OP2X at 200 Hz with random joint targets
//! every 25 ms, each world reset when its trunk falls below half its height. `cargo bench -p omniwalk-env --bench rapier`

use std::path::Path;
use std::time::Instant;

use nalgebra::Vector3;
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Drive, Engine, Friction, Start, World};
use omniwalk_env::robot::{self, Robot};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

const DT: f64 = 5e-3;
const WORLDS: usize = 8;
const STEPS_PER_TARGET: usize = 5;

fn main() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x");
    let robot = robot::load(&folder).expect("NimbRo-OP2X");
    for (name, friction, amplitude) in [
        ("stand", 0.0, 0.0),
        ("move", 0.0, 0.3),
        ("move, dry friction", 0.5, 0.3),
    ] {
        let mut bench = Bench::new(&robot, friction, amplitude);
        bench.run(200);
        let best = (0..5).map(|_| bench.run(200)).fold(f64::INFINITY, f64::min);
        println!("{name:20} {:7.1} us/step {:8.0} steps/s", best * 1e6, 1.0 / best);
    }
    let mut bench = Bench::new(&robot, 0.0, 0.0);
    let begin = Instant::now();
    (0..500).for_each(|_| bench.engine.reset(0, &bench.start, &bench.model));
    println!("{:20} {:7.1} us", "reset", begin.elapsed().as_secs_f64() / 500.0 * 1e6);
    let mut bytes = Vec::new();
    bench.engine.save(0, &mut bytes);
    println!("{:20} {:7} bytes", "saved world", bytes.len());
}

struct Bench {
    engine: Rapier,
    start: Start,
    model: World,
    drive: Drive,
    nominal: Vec<f64>,
    amplitude: f64,
    random: ChaCha8Rng,
}

impl Bench {
    fn new(robot: &Robot, friction: f64, amplitude: f64) -> Self {
        let dofs = robot.dofs.len();
        let mut drive = Drive::idle(dofs, WORLDS);
        for d in 0..dofs {
            let Some(actuator) = robot.dof(d).actuator else {
                continue;
            };
            for i in d * WORLDS..(d + 1) * WORLDS {
                drive.stiffness[i] = actuator.kp;
                drive.damping[i] = actuator.kd;
                drive.torque_min[i] = -actuator.torque_limit;
                drive.torque_max[i] = actuator.torque_limit;
                drive.friction[i] = friction;
            }
        }
        let start = Start {
            position: robot.base_pose.translation.vector,
            orientation: robot.base_pose.rotation,
            linear_velocity: Vector3::zeros(),
            angular_velocity: Vector3::zeros(),
            joints: robot.nominal(),
            joint_velocities: vec![0.0; dofs],
        };
        let model = World {
            friction: Friction {
                tangential: 0.8,
                torsional: 0.01,
                rolling: 1e-3,
            },
            gravity: Vector3::new(0.0, 0.0, -9.81),
            links: robot.links.iter().map(|link| link.inertial).collect(),
            joints: robot.joints.iter().map(|joint| joint.passive).collect(),
        };
        let mut engine = Rapier::new(robot, DT, WORLDS).expect("engine");
        (0..WORLDS).for_each(|world| engine.reset(world, &start, &model));
        Self {
            engine,
            start,
            model,
            drive,
            nominal: robot.nominal(),
            amplitude,
            random: ChaCha8Rng::seed_from_u64(1),
        }
    }

    /// Seconds per step of one world over `targets` random targets.
    fn run(&mut self, targets: usize) -> f64 {
        let begin = Instant::now();
        for _ in 0..targets {
            for (i, target) in self.drive.target.iter_mut().enumerate() {
                *target = self.nominal[i / WORLDS] + self.amplitude * self.random.random_range(-1.0..=1.0);
            }
            (0..STEPS_PER_TARGET).for_each(|_| self.engine.step(&self.drive));
            for world in 0..WORLDS {
                let fallen = self.engine.base(world).position.z < 0.5 * self.start.position.z;
                if fallen || !self.engine.is_finite(world) {
                    self.engine.reset(world, &self.start, &self.model);
                }
            }
        }
        begin.elapsed().as_secs_f64() / (targets * STEPS_PER_TARGET * WORLDS) as f64
    }
}
