//! The examples in C and C++ are built by the system's compiler against both libraries, and reproduce a policy file.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

use omniwalk_controller::*;

/// A policy of two joints with a network of the thesis's size, a clock and a filter.
fn policy() -> Policy {
    let joint = |name: &str| JointSpec {
        name: name.into(),
        nominal: 0.1,
        lower: -1.0,
        upper: 1.0,
        kp: 100.0,
        kd: 2.0,
        torque_limit: 20.0,
        action_scale: 0.3,
    };
    let spec = Spec {
        control_hz: 40.0,
        joints: vec![joint("left"), joint("right")],
        observation: vec![
            Block::JointPosition,
            Block::Attitude,
            Block::DesiredVelocity,
            Block::Clock,
        ],
        action: ActionSpec {
            law: ActionLaw::IncrementOnMeasured,
            filter: Some(FilterSpec::Butterworth { cutoff_hz: 10.0 }),
            torque_clamp: true,
        },
        clock: Some(ClockSpec {
            period: 0.8,
            reset_phase: 0.0,
        }),
        symmetry: None,
        command: CommandSpec {
            rate: [1.0; 3],
            lower: [-0.5; 3],
            upper: [0.5; 3],
        },
        legs: Vec::new(),
        inertial_frame_period: 2.0,
        upright: [0.7; 2],
    };
    let layer = |inputs: usize, outputs: usize| Dense {
        inputs,
        weights: Weights::F32((0..inputs * outputs).map(|i| 0.1 * (i as f32).sin()).collect()),
        bias: vec![0.0; outputs],
    };
    let actor = Actor {
        mean: vec![0.0; 9],
        deviation: vec![1.0; 9],
        clip: 10.0,
        layers: vec![layer(9, 512), layer(512, 512), layer(512, 4)],
        activation: Activation::Tanh,
        head: Head::Beta,
    };
    let bounds = Bounds {
        lower: vec![-1.0; 9],
        upper: vec![1.0; 9],
    };
    let identity = Identity {
        config_hash: [0; 32],
        seed: 0,
        steps: 0,
        program: "test".into(),
        latency: [0.0; 2],
        curriculum: Curriculum {
            lower: [-0.5; 3],
            upper: [0.5; 3],
            velocity_factor: 1.0,
            foot_factor: 1.0,
        },
    };
    Policy::new(spec, actor, bounds, identity).expect("the parts fit")
}

/// Where cargo puts the libraries of this package: beside the test's own executable.
fn libraries() -> PathBuf {
    let test = std::env::current_exe().expect("a test has a path");
    test.parent().expect("a folder").to_owned()
}

#[track_caller]
fn run(command: &mut Command) -> String {
    let Output { status, stdout, stderr } = command.output().expect("the program starts");
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    assert!(status.success(), "{command:?}\n{}{}", text(&stdout), text(&stderr));
    text(&stdout)
}

fn build(compiler: &str, options: &[&str], source: &str, libraries: &[&str], program: &Path) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut command = Command::new(compiler);
    command.args(["-Wall", "-Wextra", "-Werror", "-O1"]).args(options);
    command
        .arg("-I")
        .arg(folder.join("include"))
        .arg(folder.join("examples").join(source));
    run(command
        .args(libraries)
        .args(["-lpthread", "-ldl", "-lm", "-o"])
        .arg(program));
}

#[test]
fn both_examples_reproduce_the_golden_steps() {
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("policy.omni");
    fs::write(&file, policy().to_bytes()).expect("writes");
    let found = libraries();
    let fixed = found.join("libomniwalk_c.a");
    let program = folder.path().join("golden_c");
    build(
        "cc",
        &["-std=c99", "-pedantic"],
        "golden.c",
        &[fixed.to_str().expect("text")],
        &program,
    );
    assert_eq!(
        run(Command::new(&program).arg(&file)),
        "reproduced 60 golden steps of 2 joints\n"
    );

    let program = folder.path().join("golden_cpp");
    let search = format!("-L{}", found.display());
    build(
        "c++",
        &["-std=c++17"],
        "golden.cpp",
        &[&search, "-lomniwalk_c"],
        &program,
    );
    let text = run(Command::new(&program).arg(&file).env("LD_LIBRARY_PATH", &found));
    assert!(
        text.contains("refused: joint `left` expected at index 0, robot has it at 1"),
        "{text}"
    );
    assert!(text.contains("reproduced 60 golden steps"), "{text}");

    // A damaged file ends in a message, not in a crash.
    let mut bytes = policy().to_bytes();
    bytes[1000] ^= 1;
    fs::write(&file, bytes).expect("writes");
    let output = Command::new(&program)
        .arg(&file)
        .env("LD_LIBRARY_PATH", &found)
        .output()
        .expect("starts");
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("damaged"));
}
