//! The robot with its effects, as files: the URDF as it was, and the TOML with entries behind what was there.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use omniwalk_env::effect::{Kind, Place, Site};
use omniwalk_env::robot::can_vary;

use super::found::Found;
use super::model::Model;
use super::{IdentifyError, Task};

/// Writes the robot with what was found into `robot/` of the task's folder; returns that folder.
pub fn extended(task: &Task<'_>, found: &Found) -> Result<PathBuf, IdentifyError> {
    let folder = task.out.join("robot");
    let failed = |path: &Path| {
        let path = path.display().to_string();
        move |source| IdentifyError::Write { path, source }
    };
    std::fs::create_dir_all(&folder).map_err(failed(&folder))?;
    let (urdf, toml) = &task.files;
    // Always of one name: a folder that holds another robot's from before would hold two.
    std::fs::copy(urdf, folder.join("robot.urdf")).map_err(failed(urdf))?;
    let mut text = match toml {
        Some(toml) => std::fs::read_to_string(toml).map_err(failed(toml))?,
        None => String::new(),
    };
    text += "\n# Identified from logs.\n";
    text += &entries(task, &found.left.model, &found.intervals);
    text += &ranges(task, &found.last, &found.intervals);
    let path = folder.join("robot.toml");
    std::fs::write(&path, text).map_err(failed(&path))?;
    Ok(folder)
}

/// The intervals of the effects that were found, for training to draw from.
fn ranges(task: &Task<'_>, model: &Model, intervals: &[f64]) -> String {
    let mut out = String::new();
    let mut half = intervals.iter().skip(model.tuned.len());
    for term in &model.terms {
        let info = term.kind.info();
        let own: Vec<(usize, f64)> = term.free.iter().copied().zip(half.by_ref().copied()).collect();
        let known = own.iter().filter(|(_, half)| half.is_finite() && *half > 0.0);
        if !can_vary(term.kind) || known.clone().next().is_none() {
            continue;
        }
        let name = &task.robot.dof(term.target).name;
        let _ = write!(out, "\n[[range]]\nid = {:?}\nmatch = [{name:?}]\n", info.id);
        for &(i, half) in known {
            let (value, bounds) = (term.values[i], info.parameters[i].bounds);
            // What is there is there: half of it is left.
            let least = if value > 0.0 { 0.5 * value } else { bounds.lower };
            let lower = (value - half).max(least).max(bounds.lower);
            let _ = writeln!(
                out,
                "{} = [{lower:?}, {:?}]",
                info.parameters[i].name,
                (value + half).min(bounds.upper)
            );
        }
    }
    out
}

/// The numbers of `model`, with the `intervals` of those that are re-tuned and then of effects; what was re-tuned beside a table has none.
fn entries(task: &Task<'_>, model: &Model, intervals: &[f64]) -> String {
    let robot = task.robot;
    let mut out = String::new();
    let mut half = intervals.iter().copied();
    let mut comment = move || match half.next() {
        Some(half) if half.is_finite() => format!(" # +- {half:.2e}"),
        Some(_) => " # the logs do not tell".to_owned(),
        None => String::new(),
    };
    let mut last = None;
    for tuned in &model.tuned {
        if last != Some(tuned.dof) {
            let _ = write!(out, "\n[[joint]]\nmatch = [{:?}]\n", robot.dof(tuned.dof).name);
            last = Some(tuned.dof);
        }
        let said = match (comment(), model.has(Kind::ResidualTorque, tuned.dof)) {
            (_, true) => " # beside the table".to_owned(),
            (interval, false) => interval,
        };
        let _ = writeln!(out, "{} = {:?}{said}", tuned.own.key(), tuned.value);
    }
    for term in &model.terms {
        let info = term.kind.info();
        let name = match info.site {
            Site::Joint => &robot.dof(term.target).name,
            Site::Link => &robot.links[term.target].name,
        };
        match info.place {
            Place::Joint(key) => {
                let _ = write!(
                    out,
                    "\n[[joint]]\nmatch = [{name:?}]\n{key} = {:?}{}\n",
                    term.values[0],
                    comment()
                );
            }
            Place::Table => {
                let _ = write!(out, "\n[[effect]]\nid = {:?}\nmatch = [{name:?}]\n", info.id);
                for (i, parameter) in info.parameters.iter().enumerate() {
                    let said = if term.free.contains(&i) {
                        comment()
                    } else {
                        String::new()
                    };
                    let _ = writeln!(out, "{} = {:?}{said}", parameter.name, term.values[i]);
                }
            }
        }
        if let Some(table) = term.effect().table {
            let over: Vec<&str> = table.axes.iter().map(|(variable, _)| variable.name()).collect();
            let _ = writeln!(out, "over = {over:?}");
            for (variable, grid) in &table.axes {
                let _ = writeln!(out, "{} = {grid:?}", variable.name());
            }
            let _ = writeln!(out, "values = {:?}", table.values);
            if table.friction {
                let _ = writeln!(out, "friction = true");
            }
        }
    }
    out
}
