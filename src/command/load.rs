//! What several commands begin with: settings from layers, the robot of a configuration or of a run.

use std::ffi::OsStr;
use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use miette::{IntoDiagnostic, WrapErr, miette};
use omniwalk_controller::Policy;
use omniwalk_controller::file::MAX_LEN;
use omniwalk_env::config::EnvConfig;
use omniwalk_env::effect::{ROTORS_HZ, sprung};
use omniwalk_env::robot::{self, Base, Robot};
use omniwalk_sim2real::recording::{self, Map, Recording, RecordingError};

use crate::config::{ConfigError, Layers};
use crate::files;
use crate::run::checkpoints::Latest;
use crate::run::{RunFolder, create_folder, write_atomic};
use crate::settings::{DEFAULT, Settings};
use crate::terminal::tell;
use crate::train::origin::Source;

/// Settings from the defaults, a file and single changes, and the whole of them as TOML.
pub fn settings(file: Option<&Path>, changes: &[String]) -> Result<(Settings, String), ConfigError> {
    let mut layers = Layers::new(DEFAULT)?;
    if let Some(file) = file {
        layers = layers.file(file)?;
    }
    for change in changes {
        layers = layers.set(change)?;
    }
    layers.build()
}

/// The changes of `set` for a policy that is played: in `engine`, else in what `set` says, else in rapier, where policies are judged.
pub fn played(engine: Option<&str>, set: &[String]) -> Vec<String> {
    let kind = |engine: &str| format!("engine.kind={engine}");
    let ahead = [kind("rapier")].into_iter();
    ahead.chain(set.iter().cloned()).chain(engine.map(kind)).collect()
}

/// The robot at `path`.
pub fn robot(path: &Path) -> miette::Result<Arc<Robot>> {
    if path.is_relative() && !path.exists() {
        return Err(miette!(
            help = "give a robot's folder, with its .urdf and robot.toml, or a .urdf file; it is looked for from where omniwalk is started",
            "{}: does not exist",
            path.display()
        ));
    }
    Ok(Arc::new(robot::load(path)?))
}

/// The robot at `path`, on a stand if `stand`.
pub fn held(path: &Path, stand: bool) -> miette::Result<Arc<Robot>> {
    let robot = robot(path)?;
    if stand && robot.base == Base::Fixed {
        tell("note: --stand changes nothing: the base of this robot is held already");
    }
    Ok(if stand { Arc::new(robot.on_a_stand()) } else { robot })
}

/// Warns of a physics too slow for what the robot has between motors and joints.
pub fn warn_of_long_steps(robot: &Robot, config: &EnvConfig) {
    let (joints, rate) = (sprung(robot), config.engine.physics_hz);
    let [first, others @ ..] = joints.as_slice() else {
        return;
    };
    if rate < ROTORS_HZ {
        let more = if others.is_empty() {
            String::new()
        } else {
            format!(" and {} more", others.len())
        };
        tell(format_args!(
            "warning: play or springs between motor and joint ({first}{more}) move otherwise at {rate} Hz than at {ROTORS_HZ} and above: --set engine.physics_hz={ROTORS_HZ}"
        ));
    }
}

/// The recordings in the logs at `paths`.
pub fn recordings(paths: &[PathBuf], map: Option<&Map>) -> Result<Vec<Recording>, RecordingError> {
    let mut all = Vec::new();
    for path in paths {
        all.extend(recording::read(path, map)?);
    }
    Ok(all)
}

/// Whether each of `outputs` may be written: it replaces none of the `inputs` nor another of them, and no folder or device.
pub fn writable(outputs: &[&Path], inputs: &[&Path]) -> miette::Result<()> {
    let place = |path: &Path| fs::canonicalize(path).or_else(|_| std::path::absolute(path));
    let read: Vec<PathBuf> = inputs.iter().filter_map(|path| fs::canonicalize(path).ok()).collect();
    let mut written: Vec<PathBuf> = Vec::new();
    for output in outputs {
        let own = place(output)
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot write {}", output.display()))?;
        // Of a robot's folder, its URDF and TOML are read.
        let of_robot = |input: &PathBuf| input.is_dir() && own.starts_with(input) && is_robot_file(&own);
        let why = if read.iter().any(|input| *input == own || of_robot(input)) {
            "would be written over what is read"
        } else if written.contains(&own) {
            "is given for two results"
        } else if own.exists() && !own.is_file() {
            "is no file"
        } else {
            written.push(own);
            continue;
        };
        return Err(miette!(
            help = "give a file of its own for each result",
            "{} {why}",
            output.display()
        ));
    }
    Ok(())
}

/// Writes a file as a whole or not at all.
pub fn write(path: &Path, text: &str) -> miette::Result<()> {
    write_atomic(path, text.as_bytes())
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot write {}", path.display()))
}

/// The newest whole checkpoint of `run`, with a warning of damaged newer ones.
pub fn latest(run: &RunFolder) -> miette::Result<Latest> {
    let latest = run.checkpoints().latest()?.ok_or_else(|| {
        miette!(
            help = "start it again in another folder",
            "{} holds no checkpoint yet",
            run.path().display()
        )
    })?;
    latest
        .skipped
        .iter()
        .for_each(|error| tell(format_args!("warning: {error}")));
    Ok(latest)
}

/// The policy in the file at `path`.
pub fn policy(path: &Path) -> miette::Result<Policy> {
    if path.is_dir() {
        return Err(miette!(
            help = "give a policy file; `omniwalk export RUN --out walk.omni` makes one of a run",
            "{} is a folder, not a policy file",
            path.display()
        ));
    }
    let mut bytes = Vec::new();
    files::open(path)
        .and_then(|file| file.take(MAX_LEN as u64 + 1).read_to_end(&mut bytes))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot read {}", path.display()))?;
    Policy::from_bytes(&bytes).map_err(|error| miette!("{}: {error}", path.display()))
}

/// The run in `folder` as the source of another run's weights.
pub fn source(folder: &Path) -> miette::Result<Source> {
    if folder.is_file() {
        return Err(miette!(
            help = "give the run folder, such as runs/forward-1: it has the critic and the normaliser's statistics too, \
                    which a policy file does not hold",
            "--from takes a run folder; {} is a file",
            folder.display()
        ));
    }
    let run = RunFolder::open(folder)?;
    let (settings, _) = settings(Some(&run.config()), &[])?;
    let latest = latest(&run)?;
    Ok(Source {
        run: folder.to_owned(),
        settings,
        robot: robot(&run.robot())?,
        checkpoint: latest.checkpoint,
        path: latest.path,
    })
}

/// Copies the files of the robot at `path` into `folder`, so that a run stays what it was.
pub fn copy_robot(path: &Path, folder: &Path) -> miette::Result<()> {
    create_folder(folder)
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot create {}", folder.display()))?;
    let (urdf, toml) = robot::files(path)?;
    let name = urdf
        .file_name()
        .ok_or_else(|| miette!("{} has no file name", urdf.display()))?;
    // In another folder a TOML that is called like its own would not be found.
    let toml = toml.as_deref().map(|toml| (toml, OsStr::new("robot.toml")));
    for (file, name) in [(urdf.as_path(), name)].into_iter().chain(toml) {
        fs::read(file)
            .and_then(|bytes| write_atomic(&folder.join(name), &bytes))
            .into_diagnostic()
            .wrap_err_with(|| format!("cannot copy {} to {}", file.display(), folder.display()))?;
    }
    Ok(())
}

fn is_robot_file(file: &Path) -> bool {
    matches!(file.extension().and_then(|e| e.to_str()), Some("urdf" | "toml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_toml_that_is_called_like_its_folder_goes_with_the_run() {
        const URDF: &str = r#"<robot name="rig"><link name="base"/><link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>"#;
        let folder = tempfile::tempdir().unwrap();
        let [from, to] = ["rig", "run/robot"].map(|name| folder.path().join(name));
        fs::create_dir(&from).unwrap();
        fs::write(from.join("model.urdf"), URDF).unwrap();
        let toml =
            "base = \"fixed\"\n[[joint]]\nmatch = [\"hinge\"]\nkp = 7.0\ntorque_limit = 1.0\nspeed_limit = 5.0\n";
        fs::write(from.join("rig.toml"), toml).unwrap();
        copy_robot(&from, &to).unwrap();
        let kp = |path: &Path| robot(path).unwrap().joints[0].actuator.unwrap().kp;
        assert_eq!((kp(&from), kp(&to)), (7.0, 7.0));
    }
}
