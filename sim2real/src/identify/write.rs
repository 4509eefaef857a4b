//! The robot with its effects, as files: the URDF as it was, and the TOML with entries behind what was there.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use omniwalk_env::effect::{Kind, Parameter, Place, Site};
use omniwalk_env::robot::{EffectRange, can_vary};

use super::found::Found;
use super::model::Model;
use super::own::Own;
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
        Some(toml) => extensible(std::fs::read_to_string(toml).map_err(failed(toml))?),
        None => String::new(),
    };
    text += "\n# Identified from logs.\n";
    text += &entries(task, &found.left.model, &found.intervals);
    text += &ranges(task, &found.last, &found.intervals);
    text += &moved_ranges(task, &found.left.model, &found.intervals);
    let path = folder.join("robot.toml");
    std::fs::write(&path, text).map_err(failed(&path))?;
    Ok(folder)
}

/// The TOML `text` in a form to which entries can be added behind its end: written anew, without its comments, where it has lists in one line in
/// their place (`joint = [{ ... }]`).
fn extensible(text: String) -> String {
    let extended = format!("{text}\n[[joint]]\n[[effect]]\n[[range]]\n");
    match toml::from_str::<toml::Table>(&text) {
        Ok(own) if toml::from_str::<toml::Table>(&extended).is_err() => own.to_string(),
        _ => text,
    }
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

/// Ranges that the robot has, about what their numbers were re-tuned to: the old ones would take these back.
fn moved_ranges(task: &Task<'_>, model: &Model, intervals: &[f64]) -> String {
    let mut out = String::new();
    for (tuned, &half) in model.tuned.iter().zip(intervals) {
        let Some(kind) = tuned.own.kind() else { continue };
        let number = match tuned.own {
            Own::OfEffect { number, .. } => number,
            _ => 0,
        };
        let is_its = |own: &EffectRange| (own.kind, own.target, own.parameter) == (kind, tuned.dof, number);
        if !task.robot.ranges.iter().any(is_its) {
            continue;
        }
        let parameter = &kind.info().parameters[number];
        let is_told = half.is_finite() && !model.has(Kind::ResidualTorque, tuned.dof);
        let [lower, upper] = drawn(parameter, tuned.value, if is_told { half } else { 0.0 });
        let name = quoted(&task.robot.dof(tuned.dof).name);
        let _ = write!(out, "\n[[range]]\nid = {:?}\nmatch = [{name}]\n", kind.id());
        let _ = writeln!(out, "{} = [{lower:?}, {upper:?}]", parameter.name);
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
    let mut of_effects: BTreeMap<(usize, Kind), BTreeMap<usize, String>> = BTreeMap::new();
    for tuned in &model.tuned {
        if let Own::OfEffect { kind, number } = tuned.own {
            let said = of_effects.entry((tuned.dof, kind)).or_default();
            said.insert(number, comment());
            continue;
        }
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
    for effect in model.robot(robot).effects {
        if let Some(said) = of_effects.get(&(effect.target, effect.kind)) {
            let name = quoted(&robot.dof(effect.target).name);
            let said = |i: usize| said.get(&i).cloned().unwrap_or_default();
            out += &effect_entry(effect.kind, &name, &effect.values, said);
        }
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
                let said = |i: usize| {
                    if term.free.contains(&i) {
                        comment()
                    } else {
                        String::new()
                    }
                };
                out += &effect_entry(term.kind, &name, &term.values, said);
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

/// The entry of the effect `kind` on what is called `name`, a string of TOML, with the comments that are `said` of its `values`.
fn effect_entry(kind: Kind, name: &str, values: &[f64], mut said: impl FnMut(usize) -> String) -> String {
    let info = kind.info();
    let mut out = format!("\n[[effect]]\nid = {:?}\nmatch = [{name}]\n", info.id);
    for (i, (parameter, value)) in info.parameters.iter().zip(values).enumerate() {
        let _ = writeln!(out, "{} = {value:?}{}", parameter.name, said(i));
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
    fn entries_can_follow_whatever_form_the_robot_s_own_have() {
        let in_one_line = "base = \"fixed\"\njoint = [{ match = [\"*\"], kp = 3.0 }]\n";
        let own: toml::Table = toml::from_str(in_one_line).expect("TOML");
        let text = extensible(in_one_line.to_owned());
        assert_eq!(toml::from_str::<toml::Table>(&text).expect("the same"), own);
        let extended: toml::Table = toml::from_str(&(text + "\n[[joint]]\nkp = 4.0\n")).expect("TOML");
        assert_eq!(extended["joint"].as_array().map(Vec::len), Some(2));
        let commented = "# As sold.\n[[joint]]\nkp = 3.0\n";
        assert_eq!(extensible(commented.to_owned()), commented);
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
