//! `omniwalk export`.

use std::io::Read;
use std::path::{Path, PathBuf};

use clap::ValueEnum;
use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_controller::file::MAGIC;
use omniwalk_controller::{Policy, Precision};

use super::load;
use crate::export::{self, c, onnx};
use crate::files::{self, can_write};
use crate::run::transfer::{self, Transferred};
use crate::run::{RunFolder, write_atomic};
use crate::terminal::say;

/// Writes the policy of a run for the robot.
///
/// The file holds all that a robot needs and is checked before this ends: it is read again and reproduces its golden
/// vectors. docs/to-the-robot.md says what to do with it.
#[derive(clap::Args, Debug)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true).args(["out", "onnx", "c"]))]
pub struct Args {
    /// Run folder, of which the newest checkpoint is taken, or a policy file in f32: what f16 and int8 have lost is not in them.
    source: PathBuf,
    /// Policy file to write (.omni).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How the policy file and the C sources store the weights.
    #[arg(long, default_value = "f32")]
    format: Format,
    /// Also writes an ONNX model, from observation to joint targets, in f32; docs/policy-file.md says what goes in and out.
    #[arg(long, value_name = "FILE")]
    onnx: Option<PathBuf>,
    /// Of a run: the checkpoint that walks best in MuJoCo, as `train --crosscheck-every` measured, instead of the newest.
    #[arg(long)]
    best_transfer: bool,
    /// Also writes header, examples and the policy as a C array into DIR.
    #[arg(long, value_name = "DIR")]
    c: Option<PathBuf>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    F32,
    F16,
    Int8,
}

/// Runs the command.
///
/// # Errors
/// Whatever is wrong with the source, or a file that cannot be written.
pub fn run(args: &Args) -> miette::Result<()> {
    let best = args.best_transfer.then(|| best_transfer(&args.source)).transpose()?;
    let full = if args.source.is_file() {
        in_full(load::policy(&args.source)?, &args.source)?
    } else {
        export::policy(&args.source, best.as_ref().map(|best| best.path.as_path()))?
    };
    check_targets(args)?;
    if let Some(best) = best {
        say(format_args!(
            "best of those cross-checked: step {}, survival {:.3}, error {:.3} m/s in MuJoCo",
            best.step, best.survival, best.error
        ))?;
    }
    let policy = in_format(&full, args.format)?;
    let bytes = policy.to_bytes();
    let read = Policy::from_bytes(&bytes).map_err(|error| miette!("the file would not be readable: {error}"))?;
    if read != policy {
        return Err(miette!("the file would not hold the policy"));
    }
    if let Some(path) = &args.out {
        write(path, &bytes)?;
        let error = policy.golden_error(&full);
        say(format_args!(
            "policy: {} ({} bytes, {} steps, actions within {error:.1e} of f32)",
            path.display(),
            bytes.len(),
            policy.identity().steps
        ))?;
    }
    if let Some(path) = &args.onnx {
        write(path, &onnx::model(&full))?;
        say(format_args!("model:  {}", path.display()))?;
    }
    if let Some(folder) = &args.c {
        std::fs::create_dir_all(folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
        for (name, text) in c::files(&bytes) {
            write(&folder.join(name), text.as_bytes())?;
        }
        say(format_args!("C:      {}", folder.display()))?;
    }
    Ok(())
}

/// The policy of a file, if its weights are those of training: all others are measured against them.
fn in_full(policy: Policy, source: &Path) -> miette::Result<Policy> {
    match policy.precision() {
        Precision::F32 => Ok(policy),
        precision => Err(miette!(
            help = "give the run folder it was exported from, or a policy file in f32",
            "the weights in {} are rounded to {precision}; what that lost is not in the file",
            source.display()
        )),
    }
}

fn best_transfer(source: &Path) -> miette::Result<Transferred> {
    if source.is_file() {
        return Err(miette!(
            help = "give the run folder it was exported from",
            "--best-transfer chooses among the checkpoints of a run; {} is a policy file",
            source.display()
        ));
    }
    transfer::best(&RunFolder::open(source)?)
}

/// The files to write are different ones, can be written, and what they would replace is of their own kind: a slip on the
/// command line costs no run and no other policy.
fn check_targets(args: &Args) -> miette::Result<()> {
    let named = [("--out", &args.out), ("--onnx", &args.onnx)];
    let files: Vec<(&str, &PathBuf)> = named
        .into_iter()
        .filter_map(|(option, file)| file.as_ref().map(|file| (option, file)))
        .collect();
    if let [(_, out), (_, onnx)] = files[..]
        && place(out) == place(onnx)
    {
        return Err(miette!("--out and --onnx are the same file, {}", out.display()));
    }
    for (option, file) in files {
        can_write(file)?;
        if place(file) == place(&args.source) {
            return Err(miette!(
                help = "choose another file",
                "{option} would write over {}, which is read",
                file.display()
            ));
        }
        if !is_replaceable(option, file)? {
            return Err(miette!(
                help = "choose another file, or remove it first",
                "{option} would write over {}, which is none that export has written",
                file.display()
            ));
        }
    }
    Ok(())
}

/// Where a file is or would be, whatever it is called.
fn place(file: &Path) -> PathBuf {
    let folder = file.parent().filter(|folder| !folder.as_os_str().is_empty());
    let folder = folder.unwrap_or(Path::new(".")).canonicalize();
    let placed = folder
        .ok()
        .zip(file.file_name())
        .map(|(folder, name)| folder.join(name));
    file.canonicalize().ok().or(placed).unwrap_or_else(|| file.to_owned())
}

/// Whether there is nothing at `file`, or an empty file, or one of the kind that `option` writes.
fn is_replaceable(option: &str, file: &Path) -> miette::Result<bool> {
    if !file.exists() {
        return Ok(true);
    }
    let mut start = Vec::new();
    files::open(file)
        .and_then(|opened| opened.take(64).read_to_end(&mut start))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", file.display()))?;
    let own = match option {
        "--out" => start.starts_with(&MAGIC),
        _ => start.starts_with(onnx::START),
    };
    Ok(start.is_empty() || own)
}

fn in_format(policy: &Policy, format: Format) -> miette::Result<Policy> {
    let precision = match format {
        Format::F32 => Precision::F32,
        Format::F16 => Precision::F16,
        Format::Int8 => Precision::Int8,
    };
    if policy.precision() == precision {
        return Ok(policy.clone());
    }
    policy
        .with_precision(precision)
        .map_err(|error| miette!("the weights cannot be stored so: {error}"))
}

fn write(path: &Path, bytes: &[u8]) -> miette::Result<()> {
    write_atomic(path, bytes)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}
