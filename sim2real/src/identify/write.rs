//! The robot with its effects, as files: the URDF as it was, and the TOML with entries behind what was there.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use omniwalk_env::effect::{Kind, Parameter, Place, Site};
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
        let _ = write!(out, "\n[[range]]\nid = {:?}\nmatch = [{}]\n", info.id, quoted(name));
        for &(i, half) in known {
            let [lower, upper] = drawn(&info.parameters[i], term.values[i], half);
            let _ = writeln!(out, "{} = [{lower:?}, {upper:?}]", info.parameters[i].name);
        }
    }
    out
}

/// What training draws a `parameter` from that was found to be `value`, with half an interval of `half`.
///
/// What is there is there: half of its way from doing nothing is left. A size that is open down to none stays so, as one of its effect is not
/// ([`drop_doubtful`](super::select::Selector::drop_doubtful)): of a ripple, sine or cosine.
fn drawn(parameter: &Parameter, value: f64, half: f64) -> [f64; 2] {
    let [mut lower, mut upper] = [value - half, value + half];
    let nothing = parameter.neutral.unwrap_or(0.0);
    let open = parameter.neutral.is_some() && half > (value - nothing).abs();
    if !open {
        let middle = 0.5 * (value + nothing);
        if value > nothing {
            lower = lower.max(middle);
        } else {
            upper = upper.min(middle);
        }
    }
    [lower.max(parameter.bounds.lower), upper.min(parameter.bounds.upper)]
}

/// A name as a string of TOML, which knows other escapes than Rust.
fn quoted(name: &str) -> String {
    toml::Value::from(name).to_string()
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
            let joint = robot.dof(tuned.dof);
            let _ = write!(out, "\n[[joint]]\nmatch = [{}]\n", quoted(&joint.name));
            // Where no file has it, it is guessed from the torque limit, which may be another now.
            if let Some(actuator) = &joint.actuator {
                let _ = writeln!(out, "kp = {:?}", actuator.kp);
            }
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
        let name = quoted(match info.site {
            Site::Joint => &robot.dof(term.target).name,
            Site::Link => &robot.links[term.target].name,
        });
        match info.place {
            Place::Joint(key) => {
                let _ = write!(
                    out,
                    "\n[[joint]]\nmatch = [{name}]\n{key} = {:?}{}\n",
                    term.values[0],
                    comment()
                );
            }
            Place::Table => {
                let _ = write!(out, "\n[[effect]]\nid = {:?}\nmatch = [{name}]\n", info.id);
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

#[cfg(test)]
mod tests {
    use super::*;

    fn of(kind: Kind, name: &str) -> &'static Parameter {
        let mut parameters = kind.info().parameters.iter();
        parameters
            .find(|parameter| parameter.name == name)
            .expect("a parameter")
    }

    #[test]
    fn names_are_read_as_they_were_written() {
        for name in [
            "hip_yaw",
            "a \"knee\"",
            "it's",
            "back\\slash",
            "tab\t, bell\u{7}, delete\u{7f}",
            "Hüfte",
        ] {
            let table: toml::Table = toml::from_str(&format!("match = [{}]", quoted(name))).expect("TOML");
            assert_eq!(table["match"][0].as_str(), Some(name));
        }
    }

    #[test]
    fn half_of_what_was_found_is_left_of_whichever_sign_and_from_whatever_does_nothing() {
        let (torque, gain) = (of(Kind::ExternalForce, "torque"), of(Kind::CommandGain, "gain"));
        assert_eq!(drawn(torque, 0.5, 0.125), [0.375, 0.625], "a narrow interval stays");
        assert_eq!(drawn(torque, 0.5, 0.375), [0.25, 0.875]);
        assert_eq!(drawn(torque, -0.5, 0.375), [-0.875, -0.25]);
        assert_eq!(drawn(gain, 0.5, 0.375), [0.125, 0.75], "a gain of one does nothing");
        assert_eq!(drawn(gain, 1.5, 0.375), [1.25, 1.875]);
        let velocity = of(Kind::StribeckFriction, "velocity");
        assert_eq!(drawn(velocity, 0.5, 2.0), [0.25, 2.5], "no velocity is none");
    }

    #[test]
    fn a_size_that_is_open_down_to_none_stays_open() {
        assert_eq!(drawn(of(Kind::PositionRipple, "cosine"), 0.125, 0.5), [-0.375, 0.625]);
    }

    #[test]
    fn nothing_is_drawn_that_a_robot_may_not_have() {
        let gap = of(Kind::Backlash, "gap");
        assert_eq!(
            drawn(gap, gap.bounds.upper, 0.5 * gap.bounds.upper)[1],
            gap.bounds.upper
        );
        assert_eq!(drawn(gap, 0.125, 1.0)[0], 0.0);
    }
}
