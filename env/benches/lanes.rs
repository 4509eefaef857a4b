//! Cost of a physics step of the lanes engine on one core, per SIMD level and phase.
//!
//! `cargo bench -p omniwalk-env --bench lanes [-- worlds]`. The NimbRo-OP2X at 200 Hz under a moving load: random targets every
//! 25 ms, dry friction in every joint, torsional and rolling friction, resets after falls. The levels take turns, so that all see the same machine.

mod load;

use std::time::Instant;

use load::{DRY_FRICTION, DT, Load, STEPS_PER_TARGET, TARGET_RANGE, nimbro};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Engine, Friction};
use omniwalk_env::robot::Robot;

const TARGETS_PER_ROUND: usize = 10;
const ROUNDS: usize = 40;

fn main() {
    let robot = nimbro();
    let worlds = std::env::args().filter_map(|a| a.parse().ok()).next().unwrap_or(128);
    println!(
        "{} degrees of freedom, {} joints, {worlds} worlds",
        robot.dofs.len(),
        robot.joints.len()
    );
    let mut benches: Vec<_> = Simd::ALL
        .into_iter()
        .filter(|level| level.is_available())
        .map(|level| Bench::new(&robot, worlds, level))
        .collect();
    for _ in 0..ROUNDS {
        for bench in &mut benches {
            bench.round();
        }
    }
    println!("{:8} {:>22} {:>10}", "level", "us per robot-step", "falls");
    for bench in &benches {
        println!(
            "{:8} {:>22.3} {:>10}",
            bench.load.engine.level().name(),
            bench.least,
            bench.falls
        );
    }
    for bench in &mut benches {
        println!("\n{}", bench.load.engine.level().name());
        let steps = (worlds * STEPS_PER_TARGET * TARGETS_PER_ROUND) as f64;
        for (name, seconds) in bench.phases() {
            println!("  {name:20} {:.3} us", seconds / steps * 1e6);
        }
    }
}

struct Bench<'a> {
    load: Load<'a, Lanes>,
    falls: usize,
    /// Of the fastest round, us per robot-step: other processes share the processor.
    least: f64,
}

impl<'a> Bench<'a> {
    fn new(robot: &'a Robot, worlds: usize, level: Simd) -> Self {
        let engine = Lanes::new(robot, DT, worlds, level).expect("available");
        let friction = Friction {
            tangential: 0.6,
            torsional: 0.02,
            rolling: 0.01,
        };
        Self {
            load: Load::new(robot, engine, friction, DRY_FRICTION),
            falls: 0,
            least: f64::INFINITY,
        }
    }

    fn round(&mut self) {
        let mut seconds = 0.0;
        for _ in 0..TARGETS_PER_ROUND {
            self.load.draw_targets(TARGET_RANGE);
            let begin = Instant::now();
            self.load.step();
            seconds += begin.elapsed().as_secs_f64();
            self.falls += self.load.reset_fallen(0.7);
        }
        let steps = self.load.engine.worlds() * STEPS_PER_TARGET * TARGETS_PER_ROUND;
        self.least = self.least.min(seconds / steps as f64 * 1e6);
    }

    /// Smallest time of every phase in a round.
    fn phases(&mut self) -> Vec<(&'static str, f64)> {
        let mut smallest: Vec<(&'static str, f64)> = vec![];
        for _ in 0..ROUNDS {
            self.load.engine.time_phases(true);
            self.round();
            let phases = self.load.engine.phases();
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
