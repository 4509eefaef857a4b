//! Logs of the project's own simulation.

use nalgebra::{UnitQuaternion, Vector3};
use omniwalk_env::actuators::Actuators;
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::rapier::Rapier;
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{Base, Robot};
use omniwalk_sim2real::recording::{ImuRecord, JointRecord, Recording, Samples};

/// Physics step, s: the integrator of what stands for a real machine must be no part of it.
const DT: f64 = 1e-4;
/// Between commands, and between readings, s.
const EVERY: f64 = 5e-3;
/// Length of a log, s.
const SECONDS: f64 = 4.0;
/// Noise of the trunk's inertial unit: of its inclination, which is off by as much all the time too, rad; of its gyroscope, rad/s.
const UNIT_NOISE: (f64, f64) = (3e-3, 0.02);
/// Noise of the encoder, rad.
pub const NOISE: f64 = 5e-4;

fn push<T>(samples: &mut Samples<T>, time: f64, value: T) {
    samples.time.push(time);
    samples.value.push(value);
}

/// Log number `seed` of `truth`, whose degree of freedom `d` is told to be at `target(d, t)`, by the model's own engine.
pub fn record(truth: &Robot, seed: u64, target: impl Fn(usize, f64) -> f64) -> Recording {
    let engine = Lanes::new(truth, DT, 1, Simd::Scalar).expect("an engine");
    record_in(Box::new(engine), DT, truth, seed, target)
}

/// The same on ground of another kind: rigid, as rapier has it at 1 kHz.
pub fn record_on_rigid_ground(truth: &Robot, seed: u64, target: impl Fn(usize, f64) -> f64) -> Recording {
    let dt = 1e-3;
    record_in(
        Box::new(Rapier::new(truth, dt, 1).expect("an engine")),
        dt,
        truth,
        seed,
        target,
    )
}

/// Log number `seed` of `truth`, whose degree of freedom `d` is told to be at `target(d, t)`; of the base too if it is free.
fn record_in(
    mut engine: Box<dyn Engine>,
    dt: f64,
    truth: &Robot,
    seed: u64,
    target: impl Fn(usize, f64) -> f64,
) -> Recording {
    let mut stream = Stream::new(seed, 0, 0);
    let mut actuators = Actuators::new(truth, dt, 1);
    let every = (EVERY / dt).round() as usize;
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
    let mut unit = Stream::new(seed, 1, 0);
    let inclined = |unit: &mut Stream| {
        let about = Vector3::new(unit.normal(UNIT_NOISE.0), unit.normal(UNIT_NOISE.0), 0.0);
        UnitQuaternion::from_scaled_axis(about)
    };
    let always = inclined(&mut unit);
    for step in 0..(SECONDS / dt) as usize {
        let time = step as f64 * dt;
        if step % every == 0 {
            for (d, joint) in joints.iter_mut().enumerate() {
                let told = target(d, time);
                actuators.set_target(d, 0, told);
                push(&mut joint.command, time, told);
                let seen = actuators.read(d, 0, &engine.joints().position);
                push(&mut joint.position, time, seen + stream.normal(NOISE));
                push(&mut joint.velocity, time, engine.joints().velocity[d]);
            }
            let base = engine.base(0);
            let turning = base.orientation.inverse() * base.angular_velocity;
            push(
                &mut imu.orientation,
                time,
                always * inclined(&mut unit) * base.orientation,
            );
            let noise = Vector3::from_fn(|_, _| unit.normal(UNIT_NOISE.1));
            push(&mut imu.angular_velocity, time, turning + noise);
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
