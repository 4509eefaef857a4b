//! `omniwalk excite`.

use std::collections::BTreeMap;
use std::path::PathBuf;

use miette::miette;
use omniwalk_sim2real::excite::{Plan, commanded, write};

use super::load;
use crate::terminal::{OutputError, say, tell};

/// Writes motions to record, so that effects can be told apart.
///
/// For each joint alone and for all together: slow triangles, staircases, steps, chirps and multisines, within limits of
/// position, speed and torque, and without overlap of the links that the robot names. The robot hangs on a stand. Each
/// motion is an MCAP file with /joint_commands and a CSV; motions.json says what each shows of which joint.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The robot: a folder or a URDF.
    #[arg(long, value_name = "FILE")]
    robot: PathBuf,
    /// Folder for the motions.
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

/// Runs the command.
///
/// # Errors
/// When the robot cannot be loaded or has nothing to move, or the files cannot be written.
pub fn run(args: &Args) -> miette::Result<()> {
    let robot = commanded(&*load::robot(&args.robot)?);
    if robot.policy.is_empty() {
        return Err(omniwalk_env::EnvError::NoPolicyJoints {
            robot: robot.name.clone(),
        }
        .into());
    }
    if args.out.exists() && !args.out.is_dir() {
        return Err(miette!(
            help = "give a folder with --out",
            "{} is no folder",
            args.out.display()
        ));
    }
    // What another robot may do is not left beside it.
    if args.out.join("motions.json").exists() {
        return Err(miette!(
            help = "give another folder with --out, or remove this one",
            "{} holds motions already",
            args.out.display()
        ));
    }
    let mut plan = Plan::new(&robot);
    tell("simulating what the motions show of every effect");
    plan.examine(&robot)?;
    write(&plan, &robot, &args.out)?;
    say("motion                          joints  reversals  speed  slow  jump (rad, m)  inertia  load")?;
    for motion in &plan.motions {
        let joints = &motion.information;
        let largest =
            |value: fn(&omniwalk_sim2real::excite::Information) -> f64| joints.iter().map(value).fold(0.0, f64::max);
        say(format_args!(
            "{:<32} {:>5} {:>10} {:>5.0} % {:>3.0} % {:>13.3} {:>6.0} % {:>3.0} %",
            motion.name,
            joints.len(),
            joints.iter().map(|joint| joint.reversals).max().unwrap_or(0),
            100.0 * largest(|joint| joint.speed_share),
            100.0 * largest(|joint| joint.slow_share),
            largest(|joint| joint.jump),
            100.0 * largest(|joint| joint.inertia_share),
            100.0 * largest(|joint| joint.load_share),
        ))?;
    }
    for note in &plan.notes {
        say(format_args!("note: {note}"))?;
    }
    confused(&plan)?;
    say(format_args!(
        "{} motions, {:.0} s, in {}",
        plan.motions.len(),
        plan.seconds(),
        args.out.display()
    ))?;
    Ok(())
}

/// What the motions do not show apart, joints that have it in common in one line.
fn confused(plan: &Plan) -> Result<(), OutputError> {
    let mut lines: BTreeMap<String, Vec<&str>> = BTreeMap::new();
    for confused in &plan.confused {
        let effects = match confused.effects.as_slice() {
            [one] => format!("{one} from what the model has"),
            more => more.join(" from "),
        };
        let told = match confused.told {
            Some(how) => format!("the same {how} does"),
            None => "nor with the motors off, at another gain or with a weight".to_owned(),
        };
        lines
            .entry(format!("not told: {effects}; {told}"))
            .or_default()
            .push(&confused.joint);
    }
    for (line, joints) in lines {
        say(format_args!("{line} ({})", joints.join(", ")))?;
    }
    Ok(())
}
