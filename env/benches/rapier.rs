//! Physics steps per second of the rapier engine on one core: NimbRo-OP2X at 200 Hz with random joint targets
//! every 25 ms, each world reset when its trunk falls below half its height. `cargo bench -p omniwalk-env --bench rapier`

mod load;

use std::time::Instant;

use load::{DRY_FRICTION, DT, Load, STEPS_PER_TARGET, TARGET_RANGE, nimbro};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Engine, Friction};
use omniwalk_env::robot::Robot;

const WORLDS: usize = 8;

fn main() {
    let robot = nimbro();
    for (name, friction, range) in [
        ("stand", 0.0, 0.0),
        ("move", 0.0, TARGET_RANGE),
        ("move, dry friction", DRY_FRICTION, TARGET_RANGE),
    ] {
        let mut load = load(&robot, friction);
        run(&mut load, range, 200);
        let best = (0..5).map(|_| run(&mut load, range, 200)).fold(f64::INFINITY, f64::min);
        println!("{name:20} {:7.1} us/step {:8.0} steps/s", best * 1e6, 1.0 / best);
    }
    let mut load = load(&robot, 0.0);
    let begin = Instant::now();
    (0..500).for_each(|_| load.engine.reset(0, &load.start, &load.world));
    println!("{:20} {:7.1} us", "reset", begin.elapsed().as_secs_f64() / 500.0 * 1e6);
    let mut bytes = Vec::new();
    load.engine.save(0, &mut bytes);
    println!("{:20} {:7} bytes", "saved world", bytes.len());
}

fn load(robot: &Robot, dry_friction: f64) -> Load<'_, Rapier> {
    let engine = Rapier::new(robot, DT, WORLDS).expect("engine");
    let friction = Friction {
        tangential: 0.8,
        torsional: 0.01,
        rolling: 1e-3,
    };
    Load::new(robot, engine, friction, dry_friction)
}

/// Seconds per step of one world over `targets` random targets, resets included.
fn run(load: &mut Load<'_, Rapier>, range: f64, targets: usize) -> f64 {
    let begin = Instant::now();
    for _ in 0..targets {
        load.draw_targets(range);
        load.step();
        load.reset_fallen(0.5);
    }
    begin.elapsed().as_secs_f64() / (targets * STEPS_PER_TARGET * WORLDS) as f64
}
