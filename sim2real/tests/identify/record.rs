//! Logs of the project's own simulation.

use omniwalk_env::actuators::Actuators;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{Base, Robot};
use omniwalk_sim2real::recording::{ImuRecord, JointRecord, Recording, Samples};

/// Physics step, s: the integrator of what stands for a real machine must be no part of it.
const DT: f64 = 1e-4;
/// Steps between commands, and between readings.
const EVERY: usize = 50;
/// Length of a log, s.
const SECONDS: f64 = 4.0;
/// Noise of the encoder, rad.
pub const NOISE: f64 = 5e-4;

fn push<T>(samples: &mut Samples<T>, time: f64, value: T) {
    samples.time.push(time);
    samples.value.push(value);
}

/// Log number `seed` of `truth`, whose degree of freedom `d` is told to be at `target(d, t)`; of the base too if it is free.
pub fn record(truth: &Robot, seed: u64, target: impl Fn(usize, f64) -> f64) -> Recording {
    let mut stream = Stream::new(seed, 0, 0);
    let mut engine = Lanes::new(truth, DT, 1, Simd::Scalar).expect("an engine");
    let mut actuators = Actuators::new(truth, DT, 1);
    let ground = Friction {
        tangential: 1.0,
        torsional: 0.01,
        rolling: 0.001,
    };
    let start = Start::nominal(truth);
    engine.reset(0, &start, &World::nominal(truth, ground));
    let joint = |d: usize| JointRecord {
        name: truth.dof(d).name.clone(),
        ..JointRecord::default()
    };
    let mut joints: Vec<JointRecord> = (0..truth.dofs.len()).map(joint).collect();
    (0..joints.len()).for_each(|d| actuators.start(d, 0, (start.joints[d], 0.0), start.joints[d]));
    let mut imu = ImuRecord::default();
    for step in 0..(SECONDS / DT) as usize {
        let time = step as f64 * DT;
        if step % EVERY == 0 {
            for (d, joint) in joints.iter_mut().enumerate() {
                let told = target(d, time);
                actuators.set_target(d, 0, told);
                push(&mut joint.command, time, told);
                let seen = actuators.read(d, 0, &engine.joints().position);
                push(&mut joint.position, time, seen + stream.normal(NOISE));
            }
            let base = engine.base(0);
            let turning = base.orientation.inverse() * base.angular_velocity;
            push(&mut imu.orientation, time, base.orientation);
            push(&mut imu.angular_velocity, time, turning);
        }
        engine.step(actuators.drive(engine.joints()));
        actuators.sense(engine.joints());
    }
    Recording {
        name: format!("log-{seed}"),
        joints,
        imu: (truth.base == Base::Floating).then_some(imu),
        ..Recording::default()
    }
}
