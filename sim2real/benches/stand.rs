//! How long identification takes for a log of ten minutes of NimbRo-OP2X on a stand, one of whose knees rubs under load and one of
//! whose shoulders is told late:
//! `cargo bench -p omniwalk-sim2real --bench stand`.

use std::path::Path;
use std::time::Instant;

use omniwalk_env::actuators::Actuators;
use omniwalk_env::effect::{self, Effect, Kind};
use omniwalk_env::engine::lanes::{Lanes, Simd};
use omniwalk_env::engine::{Engine, Friction, Start, World};
use omniwalk_env::random::Stream;
use omniwalk_env::robot::{self, Robot};
use omniwalk_sim2real::identify::{self, Task};
use omniwalk_sim2real::recording::{JointRecord, Recording};

/// Length of the log, s.
const SECONDS: f64 = 600.0;
/// Physics step of what stands for the robot, s.
const DT: f64 = 2.5e-4;
/// Between commands, and between readings, s.
const EVERY: f64 = 0.01;
/// Noise of the encoders, rad.
const NOISE: f64 = 5e-4;
/// Each joint moves alone for its share of the first half, and all of them together in the second.
const ALONE: f64 = 0.5;

/// Target of degree of freedom `d` of `count` at `t`, less where it rests.
fn target(d: usize, count: usize, t: f64) -> f64 {
    let share = ALONE * SECONDS / count as f64;
    let own = t - share * d as f64;
    // Triangles and steps: what is smooth alone, other gains would explain.
    let triangle = |t: f64| ((t / (2.9 + 0.1 * d as f64) + 0.25).fract() - 0.5).abs() * 4.0 - 1.0;
    let swing = |t: f64| 0.15 * triangle(t) + 0.08 * ((4.1 + 0.2 * d as f64) * t).sin().signum();
    match t < ALONE * SECONDS {
        true if (0.0..share).contains(&own) => swing(own) * (own * (share - own)).clamp(0.0, 1.0),
        true => 0.0,
        false => swing(t - ALONE * SECONDS) * (t - ALONE * SECONDS).min(1.0),
    }
}

fn record(truth: &Robot) -> Recording {
    let mut engine = Lanes::new(truth, DT, 1, Simd::Scalar).expect("an engine");
    let mut actuators = Actuators::new(truth, DT, 1);
    let mut noise = Stream::new(1, 0, 0);
    let (start, count) = (Start::nominal(truth), truth.dofs.len());
    let ground = Friction {
        tangential: 1.0,
        torsional: 0.0,
        rolling: 0.0,
    };
    engine.reset(0, &start, &World::nominal(truth, ground));
    (0..count).for_each(|d| actuators.start(d, 0, (start.joints[d], 0.0), start.joints[d]));
    let joint = |d: usize| JointRecord {
        name: truth.dof(d).name.clone(),
        ..JointRecord::default()
    };
    let mut joints: Vec<JointRecord> = (0..count).map(joint).collect();
    for step in 0..(SECONDS / DT) as usize {
        if step % (EVERY / DT).round() as usize == 0 {
            let time = step as f64 * DT;
            for (d, joint) in joints.iter_mut().enumerate() {
                let told = start.joints[d] + target(d, count, time);
                actuators.set_target(d, 0, told);
                let seen = actuators.read(d, 0, &engine.joints().position) + noise.normal(NOISE);
                for (samples, value) in [(&mut joint.command, told), (&mut joint.position, seen)] {
                    samples.time.push(time);
                    samples.value.push(value);
                }
            }
        }
        engine.step(actuators.drive(engine.joints()));
        actuators.sense(engine.joints());
    }
    Recording {
        name: "stand".into(),
        joints,
        ..Recording::default()
    }
}

fn main() {
    let folder = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../robots/nimbro_op2x"));
    let nominal = robot::load(folder).expect("the robot").on_a_stand();
    let mut truth = nominal.clone();
    let faults: [(&str, Kind, &[f64]); 2] = [
        ("left_knee_pitch", Kind::LoadDependentFriction, &[0.5, 0.0, 0.0, 0.1]),
        ("right_shoulder_pitch", Kind::CommandDelay, &[0.03]),
    ];
    for (joint, kind, values) in faults {
        let at = (0..truth.dofs.len()).find(|&d| truth.dof(d).name == joint);
        effect::apply(&mut truth, &Effect::new(kind, at.expect("a joint"), values));
    }
    let log = record(&truth);
    let out = tempfile::tempdir().expect("a folder");
    let task = Task {
        robot: &nominal,
        files: (folder.join("nimbro_op2x.urdf"), Some(folder.join("robot.toml"))),
        logs: vec![log],
        heldout: None,
        compare: false,
        out: out.path(),
    };
    let begin = Instant::now();
    let outcome = identify::run(&task, &|line| println!("{line}")).expect("an outcome");
    let named = outcome.accepted.iter().map(|a| format!("{} of {}", a.effect, a.target));
    let [nominal_error, refit, last] =
        [&outcome.nominal, &outcome.refit, &outcome.last].map(|sets| sets.heldout.overall());
    let floor = outcome.noise_floor.value.unwrap_or(0.0);
    println!("off by {nominal_error:.5} rad, re-tuned {refit:.5}, at last {last:.5}, floor {floor:.5}");
    println!(
        "{} joints, {SECONDS} s: {:?} ({}) after {:.0} s",
        nominal.dofs.len(),
        outcome.verdict,
        named.collect::<Vec<_>>().join(", "),
        begin.elapsed().as_secs_f64()
    );
}
