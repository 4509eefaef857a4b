//! Errors of every effect fitted at once, as JSON, for `python -m sealed baseline`: what `omniwalk identify --compare` says of it, without the
//! identification.
//!
//! `all_effects ROBOT FIT_FOLDER HELDOUT_FOLDER`, folders of MCAP files.

use std::error::Error;
use std::path::Path;

use omniwalk_sim2real::identify::all_at_once;
use omniwalk_sim2real::recording::{Recording, read};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [robot, fit, heldout] = arguments.as_slice() else {
        return Err("usage: all_effects ROBOT FIT_FOLDER HELDOUT_FOLDER".into());
    };
    let robot = omniwalk_env::robot::load(Path::new(robot))?;
    let sets = all_at_once(&robot, &logs(Path::new(fit))?, &logs(Path::new(heldout))?)?;
    println!("{}", serde_json::to_string(&sets)?);
    Ok(())
}

/// Every recording in a folder, in the order of names.
fn logs(folder: &Path) -> Result<Vec<Recording>, Box<dyn Error>> {
    let mut files: Vec<_> = std::fs::read_dir(folder)?
        .map(|entry| entry.map(|entry| entry.path()))
        .collect::<Result<_, _>>()?;
    files.sort();
    let mut all = Vec::new();
    for file in files {
        all.extend(read(&file, None)?);
    }
    Ok(all)
}
