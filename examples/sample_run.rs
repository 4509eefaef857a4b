//! Writes a small run folder with one of every file that other programs read: `cargo run --example sample_run -- DIR`.
//!
//! The numbers are those of a two-joint robot that swings its joints; the Python tests read them back with the
//! packages that users have.

use std::path::PathBuf;

use miette::{IntoDiagnostic, Result, miette};
use omniwalk::run::RunFolder;
use omniwalk::run::checkpoint::Checkpoint;
use omniwalk::run::events::EventWriter;
use omniwalk::run::metrics::MetricsWriter;
use omniwalk_sim2real::log::messages::{Header, Imu, JointState, Odometry, PolicyStep, Quaternion, Twist, Vector3};
use omniwalk_sim2real::log::{LogWriter, Message};

const CONTROL_HZ: u64 = 40;
const COLUMNS: [&str; 2] = ["return/total", "gait/alternation"];

fn main() -> Result<()> {
    let folder = std::env::args_os()
        .nth(1)
        .map(PathBuf::from)
        .ok_or_else(|| miette!("which folder?"))?;
    let run = RunFolder::create(&folder, "[train]\nseed = 7\n")?;
    train(&run, None, 1..=6)?;
    // A stop at 600 and a start from the checkpoint of step 300.
    train(&run, Some(300), 4..=8)?;
    std::fs::create_dir_all(run.rollouts()).into_diagnostic()?;
    rollout(&run.rollouts().join("swing.mcap"))
}

fn train(run: &RunFolder, resumed_at: Option<u64>, updates: std::ops::RangeInclusive<u64>) -> Result<()> {
    let mut metrics = match resumed_at {
        Some(step) => MetricsWriter::resume(&run.metrics(), &COLUMNS, step)?,
        None => MetricsWriter::create(&run.metrics(), &COLUMNS)?,
    };
    let mut events = EventWriter::create(run.path(), resumed_at).into_diagnostic()?;
    for update in updates {
        let step = update * 100;
        let values = [step as f64 / 8.0, if update % 2 == 0 { 0.5 } else { f64::NAN }];
        metrics.append(step, &values)?;
        events
            .scalars(step, COLUMNS.into_iter().zip(values))
            .into_diagnostic()?;
        let mut checkpoint = Checkpoint::new(step);
        checkpoint.insert("actor.0.weight", &[2, 3], &[0.5_f32, -1.0, 0.25, 2.0, 0.0, 1e-3]);
        checkpoint.insert("optimiser.step", &[], &[update]);
        checkpoint.metadata.insert("seed".to_owned(), 7.into());
        run.checkpoints().save(&checkpoint, 2)?;
    }
    Ok(())
}

fn rollout(path: &std::path::Path) -> Result<()> {
    let mut log = LogWriter::create(path)?;
    log.metadata("omniwalk", [("seed".to_owned(), "7".to_owned())].into())?;
    for step in 0..2 * CONTROL_HZ {
        let time = step * 1_000_000_000 / CONTROL_HZ;
        let phase = step as f64 / CONTROL_HZ as f64;
        let joints = |position: [f64; 2], velocity: Vec<f64>| JointState {
            header: Header::new(time, "base"),
            name: vec!["left_hip_pitch".to_owned(), "right_hip_pitch".to_owned()],
            position: position.to_vec(),
            velocity,
            effort: Vec::new(),
        };
        let upright = Quaternion {
            w: 1.0,
            ..Quaternion::default()
        };
        let forward = Twist {
            linear: Vector3 {
                x: 0.4,
                ..Vector3::default()
            },
            ..Twist::default()
        };
        let mut odom = Odometry {
            header: Header::new(time, "world"),
            child_frame_id: "base".to_owned(),
            ..Odometry::default()
        };
        odom.pose.pose.position.x = 0.4 * phase;
        odom.pose.pose.orientation = upright.clone();
        odom.twist.twist = forward.clone();
        let imu = Imu {
            header: Header::new(time, "imu"),
            orientation: upright,
            linear_acceleration: Vector3 {
                z: 9.81,
                ..Vector3::default()
            },
            ..Imu::default()
        };
        let policy = PolicyStep {
            observation: vec![phase.sin(), -phase.sin()],
            action: vec![0.5, 0.75],
            reward: [("velocity".to_owned(), 0.9.into())].into_iter().collect(),
        };
        log.write(
            time,
            &Message::JointStates(joints([phase.sin(), -phase.sin()], vec![phase.cos(), -phase.cos()])),
        )?;
        log.write(time, &Message::JointCommands(joints([0.1, -0.1], Vec::new())))?;
        log.write(time, &Message::Imu(imu))?;
        log.write(time, &Message::CmdVel(forward))?;
        log.write(time, &Message::Odom(Box::new(odom)))?;
        log.write(time, &Message::Policy(policy))?;
    }
    log.finish()?;
    Ok(())
}
