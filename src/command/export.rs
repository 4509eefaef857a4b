//! `omniwalk export`.

use std::path::{Path, PathBuf};

use clap::ValueEnum;
use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_controller::{Policy, Precision};

use super::load;
use crate::export::{self, c, onnx};
use crate::run::write_atomic;

/// Writes the policy of a run for the robot.
///
/// The file holds all that a robot needs and is checked before this ends: it is read again and reproduces its golden
/// vectors. docs/to-the-robot.md says what to do with it.
#[derive(clap::Args, Debug)]
#[command(group = clap::ArgGroup::new("what").required(true).multiple(true).args(["out", "onnx", "c"]))]
pub struct Args {
    /// Run folder, of which the newest checkpoint is taken, or a policy file in f32.
    source: PathBuf,
    /// Policy file to write (.omni).
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// How the policy file and the C sources store the weights.
    #[arg(long, default_value = "f32")]
    format: Format,
    /// Also writes an ONNX model: bounds, normaliser, network, mode, and the joints' displacements; in f32.
    #[arg(long, value_name = "FILE")]
    onnx: Option<PathBuf>,
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
    let full = if args.source.is_file() {
        load::policy(&args.source)?
    } else {
        export::policy(&args.source)?
    };
    let policy = in_format(&full, args.format)?;
    let bytes = policy.to_bytes();
    let read = Policy::from_bytes(&bytes).map_err(|error| miette!("the file would not be readable: {error}"))?;
    if read != policy {
        return Err(miette!("the file would not hold the policy"));
    }
    if let Some(path) = &args.out {
        write(path, &bytes)?;
        let error = policy.golden_error(&full);
        println!(
            "policy: {} ({} bytes, {} steps, actions within {error:.1e} of f32)",
            path.display(),
            bytes.len(),
            policy.identity().steps
        );
    }
    if let Some(path) = &args.onnx {
        write(path, &onnx::model(&full))?;
        println!("model:  {}", path.display());
    }
    if let Some(folder) = &args.c {
        std::fs::create_dir_all(folder)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
        for (name, text) in c::files(&bytes) {
            write(&folder.join(name), text.as_bytes())?;
        }
        println!("C:      {}", folder.display());
    }
    Ok(())
}

fn in_format(policy: &Policy, format: Format) -> miette::Result<Policy> {
    let precision = match format {
        Format::F32 => Precision::F32,
        Format::F16 => Precision::F16,
        Format::Int8 => Precision::Int8,
    };
    let weights = |policy: &Policy| {
        policy
            .actor()
            .layers
            .iter()
            .all(|layer| layer.weights.precision() == precision)
    };
    if weights(policy) {
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
