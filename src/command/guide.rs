//! `omniwalk completions` and `omniwalk man`: what the command line says of itself, for shells and for `man`.

use std::fs;
use std::path::PathBuf;

use clap_complete::Shell;
use miette::{IntoDiagnostic, WrapErr};

use crate::terminal::say;

/// Prints the completions for a shell.
///
/// For bash `omniwalk completions bash > ~/.local/share/bash-completion/completions/omniwalk`; the shell's manual says where others look.
#[derive(clap::Args, Debug)]
pub struct Completions {
    /// The shell.
    shell: Shell,
}

/// Writes the manual pages: omniwalk.1 and one a command.
///
/// For example `omniwalk man ~/.local/share/man/man1`, then `man omniwalk-train`.
#[derive(clap::Args, Debug)]
pub struct Man {
    /// The folder they go into; made if it does not exist.
    folder: PathBuf,
}

/// Prints the completions of `command`.
///
/// # Errors
/// When nothing can be written to stdout.
pub fn completions(args: &Completions, mut command: clap::Command) -> miette::Result<()> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command, "omniwalk", &mut script);
    Ok(say(String::from_utf8_lossy(&script).trim_end())?)
}

/// Writes the manual pages of `command`.
///
/// # Errors
/// When the folder cannot be made or written.
pub fn man(args: &Man, command: clap::Command) -> miette::Result<()> {
    let folder = &args.folder;
    fs::create_dir_all(folder)
        .and_then(|()| clap_mangen::generate_to(command, folder))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write manual pages to {}", folder.display()))
}
