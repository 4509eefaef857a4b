//! `omniwalk init`.

use std::path::{Path, PathBuf};

use miette::{IntoDiagnostic, WrapErr, miette};

use super::load;
use crate::init::{Draft, draft};
use crate::run::{create_folder, write_atomic};
use crate::terminal::say;

/// Writes a robot folder from a URDF: a robot.toml to fill in, and a configuration that trains the robot.
///
/// Finds feet, left and right, a standing pose and servos that hold it, and says what of that is guessed.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The robot's URDF.
    #[arg(value_name = "URDF")]
    urdf: PathBuf,
    /// Folder to write; it must not exist [default: robots/NAME, NAME being the URDF's].
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When the URDF makes no robot, the folder exists, or it cannot be written.
pub fn run(args: &Args) -> miette::Result<()> {
    if args.urdf.extension().is_none_or(|extension| extension != "urdf") {
        return Err(miette!(
            help = "give a .urdf file",
            "{} is not a .urdf file",
            args.urdf.display()
        ));
    }
    let name = args.urdf.file_stem().map(Path::new).unwrap_or(Path::new("robot"));
    let folder = args.out.clone().unwrap_or_else(|| Path::new("robots").join(name));
    if folder.exists() {
        return Err(miette!(
            help = "choose another folder with --out DIR",
            "{} is there already",
            folder.display()
        ));
    }
    let (defaults, _) = load::settings(None, &[])?;
    let draft = draft(&args.urdf, &folder, &defaults)?;
    write(&draft, &args.urdf, &folder)
        .inspect_err(|_| {
            // Half of it would be in the way of the next attempt.
            let _ = std::fs::remove_dir_all(unfinished(&folder));
        })
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", folder.display()))?;
    for note in &draft.notes {
        say(format_args!("{note}"))?;
    }
    say(format_args!(
        "wrote {}: look through robot.toml, then",
        folder.display()
    ))?;
    say(format_args!("  omniwalk inspect {}", folder.display()))?;
    if draft.training.is_some() {
        say(format_args!("  omniwalk train {}", folder.join("train.toml").display()))?;
    }
    Ok(())
}

/// Where `folder` is written until it is whole.
fn unfinished(folder: &Path) -> PathBuf {
    let mut name = folder.as_os_str().to_owned();
    name.push(".unfinished");
    name.into()
}

fn write(draft: &Draft, urdf: &Path, folder: &Path) -> std::io::Result<()> {
    let urdf_name = urdf.file_name().unwrap_or("robot.urdf".as_ref());
    let text = std::fs::read(urdf)?;
    // A folder with half of it would be a robot, another one.
    let unfinished = unfinished(folder);
    // Of an attempt that was killed, with another URDF perhaps.
    if unfinished.is_dir() {
        std::fs::remove_dir_all(&unfinished)?;
    }
    create_folder(&unfinished)?;
    write_atomic(&unfinished.join(urdf_name), &text)?;
    write_atomic(&unfinished.join("robot.toml"), draft.settings.as_bytes())?;
    if let Some(training) = &draft.training {
        write_atomic(&unfinished.join("train.toml"), training.as_bytes())?;
    }
    std::fs::rename(unfinished, folder)
}
