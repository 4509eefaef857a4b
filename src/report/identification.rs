//! The pages of an identification and of a replay: what is missing, errors before and after, and pictures of what is left.

use std::fmt::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine};
use omniwalk_sim2real::check::Check;
use omniwalk_sim2real::identify::{Alternative, Lacking, Measure, Outcome, Parameter, Replay, Trial, Verdict};

use super::ReportError;
use super::canvas::{COLOURS, PALE};
use super::html::{HEAD, STYLE, escaped};
use super::residual::{Predicted, pictures};

/// The page of an identification.
///
/// # Errors
/// When a picture cannot be drawn.
pub fn page(outcome: &Outcome) -> Result<String, ReportError> {
    let mut out = head(&outcome.robot, &said(outcome.verdict));
    for reason in &outcome.reasons {
        let _ = writeln!(out, "<p class=\"warning\">{}</p>", escaped(reason));
    }
    check(&outcome.check, &mut out);
    if outcome.verdict == Verdict::InsufficientData {
        return Ok(out + "</html>\n");
    }
    information(outcome, &mut out);
    errors(outcome, &mut out);
    effects(outcome, &mut out);
    alike(outcome, &mut out);
    retuned(outcome, &mut out);
    left(outcome, &mut out);
    rejected(outcome, &mut out);
    let models = [
        ("nominal", &outcome.nominal.heldout, PALE),
        ("re-tuned", &outcome.refit.heldout, COLOURS[4]),
        ("final", &outcome.last.heldout, COLOURS[0]),
    ];
    let models = models.map(|(name, measure, colour)| Predicted {
        name,
        of: &measure.predictions,
        colour,
    });
    joints(&outcome.trials[1], &models, &outcome.lacking, &mut out)?;
    Ok(out + "</html>\n")
}

/// The page of a replay of `robot`.
///
/// # Errors
/// When a picture cannot be drawn.
pub fn replay(robot: &str, replay: &Replay) -> Result<String, ReportError> {
    let mut out = head(robot, "measured and simulated");
    check(&replay.check, &mut out);
    out += "<table><tr><th>position error, rad or m</th><th>rms</th><th>mean absolute</th></tr>\n";
    for (joint, rmse) in &replay.measure.rmse.0 {
        row(&mut out, joint, &[*rmse, replay.measure.mae.0[joint]]);
    }
    out += "</table>\n";
    quantities(&[("", [&replay.measure].as_slice())], &mut out);
    let simulated = [Predicted {
        name: "simulated",
        of: &replay.measure.predictions,
        colour: COLOURS[0],
    }];
    joints(&replay.trials, &simulated, &replay.lacking, &mut out)?;
    Ok(out + "</html>\n")
}

fn head(robot: &str, what: &str) -> String {
    format!("{HEAD}<style>{STYLE}</style>\n<h1>{}: {what}</h1>\n", escaped(robot))
}

/// A verdict in words.
pub fn said(verdict: Verdict) -> String {
    let name = serde_json::to_value(verdict).unwrap_or_default();
    name.as_str().unwrap_or_default().replace('_', " ")
}

/// What something unexplained is a share of, in words.
pub fn left_by(outcome: &Outcome) -> &'static str {
    match (
        outcome.accepted.is_empty() && outcome.alternatives.is_empty(),
        outcome.tables.is_empty(),
    ) {
        (true, _) => "re-tuning leaves",
        (false, true) => "is left",
        (false, false) => "is left without a table",
    }
}

/// A figure in three digits.
pub fn figure(value: f64) -> String {
    match value.abs() {
        _ if !value.is_finite() => "-".to_owned(),
        0.0 => "0".to_owned(),
        x if !(1e-6..1e6).contains(&x) => format!("{value:.2e}"),
        x => {
            let digits = (2.0 - x.log10().floor()).clamp(0.0, 9.0) as usize;
            format!("{value:.digits$}")
        }
    }
}

fn row(out: &mut String, name: &str, values: &[f64]) {
    let cells: Vec<String> = values.iter().map(|x| format!("<td>{}</td>", figure(*x))).collect();
    let _ = writeln!(out, "<tr><td>{}</td>{}</tr>", escaped(name), cells.concat());
}

/// What the logs can carry.
fn check(check: &Check, out: &mut String) {
    let open = if check.usable() { "" } else { " open" };
    let _ = writeln!(
        out,
        "<details{open}><summary>the logs</summary><pre>{}</pre></details>",
        escaped(&check.to_string())
    );
}

/// What the logs can tell of the nominal model.
fn information(outcome: &Outcome, out: &mut String) {
    *out += "<details><summary>what they can tell of the nominal model</summary>\n<table><tr><th>joint</th><th>parameter</th>\
        <th>nominal</th><th>known at best to</th></tr>\n";
    for own in &outcome.information {
        let known = own.deviation.map_or("not, or not from others".to_owned(), figure);
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{:.4} {}</td><td>{known}</td></tr>",
            escaped(&own.joint),
            own.parameter,
            own.value,
            own.unit
        );
    }
    *out += "</table></details>\n";
}

fn errors(outcome: &Outcome, out: &mut String) {
    let _ = writeln!(
        out,
        "<p>Held out: {}. Folds of the cross-validation: {}. Effects tried in a step: {}. Physics steps a second: {}.</p>",
        escaped(&outcome.heldout),
        escaped(&outcome.folds),
        outcome.tried,
        outcome.physics_hz,
    );
    let mut models = vec![
        ("nominal", &outcome.nominal),
        ("re-tuned", &outcome.refit),
        ("final", &outcome.last),
    ];
    models.extend(outcome.all_effects.as_ref().map(|sets| ("all effects at once", sets)));
    let names: Vec<String> = models.iter().map(|(name, _)| format!("<th>{name}</th>")).collect();
    let _ = writeln!(
        out,
        "<table><tr><th>position error, rms, rad or m</th>{}<th>floor</th><th>gap closed, %</th></tr>",
        names.concat()
    );
    let of = |heldout: bool| -> Vec<&Measure> {
        let own = models
            .iter()
            .map(|(_, sets)| if heldout { &sets.heldout } else { &sets.fit });
        own.collect()
    };
    for (name, sets) in [("held out", of(true)), ("fitted", of(false))] {
        for joint in sets[0].rmse.0.keys() {
            let mut values: Vec<f64> = sets
                .iter()
                .map(|set| set.rmse.0.get(joint).copied().unwrap_or(f64::NAN))
                .collect();
            if name == "held out" {
                values.extend(near(outcome, joint));
            }
            row(out, &format!("{joint}, {name}"), &values);
        }
    }
    *out += "</table>\n";
    let _ = writeln!(
        out,
        "<p>The floor is that of {}.</p>",
        floor_of(outcome.noise_floor.source)
    );
    quantities(&[("held out", &of(true)), ("fitted", &of(false))], out);
}

/// The floor of a joint, or of all, and how much of the gap to it is closed, %.
fn near(outcome: &Outcome, joint: &str) -> [f64; 2] {
    let (floor, closed) = match outcome.by_joint.get(joint) {
        Some(own) => (own.noise_floor, own.gap_closed),
        None => (outcome.noise_floor.value.unwrap_or(f64::NAN), outcome.gap_closed),
    };
    [floor, closed.map_or(f64::NAN, |share| 100.0 * share)]
}

fn floor_of(source: &str) -> &'static str {
    match source {
        "repeats" => "repeats of the same motion",
        "sensor" => "the encoders' noise and of the simulation's steps",
        _ => "no noise at all",
    }
}

/// Errors of what else was measured, of several models in several sets of logs.
fn quantities(sets: &[(&str, &[&Measure])], out: &mut String) {
    let position = "joint_position";
    let Some((_, first)) = sets
        .first()
        .filter(|(_, models)| models[0].by_quantity.keys().any(|own| own != position))
    else {
        return;
    };
    let _ = writeln!(
        out,
        "<table><tr><th>rms of what is not fitted</th><th colspan=\"{}\">in the order above</th></tr>",
        first.len()
    );
    for (set, models) in sets {
        for name in models[0].by_quantity.keys().filter(|own| *own != position) {
            let unit = match name.as_str() {
                "joint_velocity" => "rad/s (m/s)",
                "orientation" => "rad",
                _ => "rad/s",
            };
            let of = |model: &&Measure| model.by_quantity.get(name).and_then(|own| own.get("rmse")).copied();
            let values: Vec<f64> = models.iter().map(|model| of(model).unwrap_or(f64::NAN)).collect();
            let title = format!("{}, {unit} {set}", name.replace('_', " "));
            row(out, title.trim_end(), &values);
        }
    }
    *out += "</table>\n";
}

fn listed<'a>(parameters: impl Iterator<Item = (&'a &'static str, &'a Parameter)>) -> String {
    let values: Vec<String> = parameters.map(|(name, value)| format!("{name} {value}")).collect();
    escaped(&values.join(", "))
}

fn effects(outcome: &Outcome, out: &mut String) {
    if outcome.accepted.is_empty() {
        return;
    }
    *out += "<h2>Missing effects</h2>\n<table><tr><th>effect</th><th>at</th><th>parameters (95 % interval)</th>\
        <th>held-out error without</th><th>with</th><th>p</th></tr>\n";
    for accepted in &outcome.accepted {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{:.1e}</td></tr>",
            accepted.effect,
            escaped(&accepted.target),
            listed(accepted.parameters.iter()),
            figure(accepted.heldout_rmse_before),
            figure(accepted.heldout_rmse_after),
            accepted.p_value
        );
    }
    *out += "</table>\n";
}

/// What cannot be told apart, what each would be, and what would tell.
fn alike(outcome: &Outcome, out: &mut String) {
    for set in &outcome.indistinguishable {
        let _ = writeln!(
            out,
            "<p>These logs cannot tell apart: {}.</p>",
            escaped(&set.join(", "))
        );
    }
    for set in &outcome.alternatives {
        *out += "<table><tr><th>either</th><th>at</th><th>parameters (95 % interval)</th><th></th></tr>\n";
        for Alternative {
            effect,
            target,
            parameters,
            in_robot,
        } in set
        {
            let _ = writeln!(
                out,
                "<tr><td>{effect}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escaped(target),
                listed(parameters.iter()),
                if *in_robot { "in the robot that was written" } else { "" }
            );
        }
        *out += "</table>\n";
    }
    for separation in &outcome.separation {
        let _ = writeln!(out, "<p>{}.</p>", escaped(&separation.to_string()));
    }
}

/// The nominal model's own parameters as they came out.
fn retuned(outcome: &Outcome, out: &mut String) {
    *out += "<details><summary>re-tuned values of what the nominal model has</summary>\n<table><tr><th>joint</th><th>parameter</th>\
        <th>value (95 % interval)</th></tr>\n";
    for (joint, parameters) in &outcome.retuned {
        for (name, value) in parameters {
            let _ = writeln!(
                out,
                "<tr><td>{}</td><td>{name}</td><td>{}</td></tr>",
                escaped(joint),
                escaped(&value.to_string())
            );
        }
    }
    *out += "</table></details>\n";
}

/// What is left, and what predicts it.
fn left(outcome: &Outcome, out: &mut String) {
    if outcome.verdict == Verdict::Unexplained {
        let left = &outcome.unexplained;
        let named = left.depends_on.iter().map(|name| match left.of_nominal.contains(name) {
            true => format!("{name} (of what the robot lacks before it is re-tuned)"),
            false => name.clone(),
        });
        let over = named.collect::<Vec<_>>().join(", ");
        let over = if over.is_empty() {
            "nothing that was measured"
        } else {
            &over
        };
        let _ = writeln!(
            out,
            "<p class=\"warning\">Unexplained: {:.0} % of what {}, over {}.</p>",
            100.0 * outcome.unexplained.fraction,
            left_by(outcome),
            escaped(over)
        );
    }
    for table in &outcome.tables {
        let _ = writeln!(
            out,
            "<p>In the robot that was written: {}.</p>",
            escaped(&table.to_string())
        );
    }
    *out += "<table><tr><th>joint</th><th>autocorrelation of what is left over 0.1 s</th></tr>\n";
    for (joint, value) in &outcome.unexplained.autocorrelation {
        row(out, joint, &[*value]);
    }
    *out += "</table>\n";
}

fn rejected(outcome: &Outcome, out: &mut String) {
    if outcome.rejected.is_empty() {
        return;
    }
    *out += "<details><summary>tried and not taken</summary>\n<table><tr><th>effect</th><th>at</th><th>why</th></tr>\n";
    for rejected in &outcome.rejected {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td></tr>",
            rejected.effect,
            escaped(&rejected.target),
            escaped(&rejected.reason)
        );
    }
    *out += "</table></details>\n";
}

/// What predicts the torque that a joint lacks, and its pictures.
fn joints(
    trials: &[Trial],
    models: &[Predicted<'_>],
    lacking: &[Lacking],
    out: &mut String,
) -> Result<(), ReportError> {
    for (d, own) in lacking.iter().enumerate() {
        let _ = writeln!(out, "<h2>{}</h2>", escaped(&own.joint));
        let by = own.predicted.iter().map(|predicted| {
            let how = match (predicted.friction, predicted.past) {
                (true, _) => " against the motion",
                (_, true) => " over the last 0.2 s",
                _ => "",
            };
            format!("{}{how} ({:.0} %)", predicted.by, 100.0 * predicted.share)
        });
        let by: Vec<String> = by.collect();
        let by = if by.is_empty() {
            "nothing that was measured".to_owned()
        } else {
            by.join(", then ")
        };
        if let Some(root) = own.root() {
            let _ = writeln!(
                out,
                "<p>It lacks {} N m (N), root mean square; predicted, where that was not fitted, by {}.</p>",
                figure(root),
                escaped(&by)
            );
        }
        for (title, png) in pictures(trials, d, models, own)? {
            let data = BASE64_STANDARD.encode(png);
            let title = escaped(&title);
            let _ = writeln!(out, "<p><img alt=\"{title}\" src=\"data:image/png;base64,{data}\"></p>");
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_have_three_digits_whatever_their_size() {
        let cases = [
            (4.28e-5, "0.0000428"),
            (0.00804, "0.00804"),
            (12.345, "12.3"),
            (-1234.5, "-1234"),
            (1e-9, "1.00e-9"),
            (0.0, "0"),
            (f64::NAN, "-"),
        ];
        for (value, written) in cases {
            assert_eq!(figure(value), written);
        }
    }
}
