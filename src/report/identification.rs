//! The page of an identification: what was missing, errors before and after, and pictures of them.

use std::fmt::Write as _;

use base64::prelude::{BASE64_STANDARD, Engine};
use omniwalk_sim2real::identify::{DT, Moment, Outcome, Trial};

use super::ReportError;
use super::canvas::{COLOURS, Canvas, INK, PALE};
use super::html::{STYLE, escaped};
use super::plot::{Line, Panel};

/// Size of a panel, pixels.
const PANEL: (u32, u32) = (1200, 240);
/// Held-out logs that are drawn.
const DRAWN: usize = 3;
/// Points of a mean over a variable.
const BINS: usize = 40;

/// The page.
///
/// # Errors
/// When a picture cannot be drawn.
pub fn page(outcome: &Outcome) -> Result<String, ReportError> {
    let mut out =
        "<!DOCTYPE html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>omniwalk identify</title>\n".to_owned();
    let verdict = serde_json::to_value(outcome.verdict).unwrap_or_default();
    let _ = writeln!(
        out,
        "<style>{STYLE}</style>\n<h1>{}: {}</h1>",
        escaped(&outcome.robot),
        escaped(&verdict.as_str().unwrap_or_default().replace('_', " "))
    );
    let _ = writeln!(
        out,
        "<details><summary>the logs</summary><pre>{}</pre></details>",
        escaped(&outcome.check.to_string())
    );
    information(outcome, &mut out);
    errors(outcome, &mut out);
    effects(outcome, &mut out);
    for (d, (joint, moments)) in outcome.torque.iter().enumerate() {
        let pictures = [overlays(outcome, d)?, torques(moments)?];
        let _ = writeln!(out, "<h2>{}</h2>", escaped(joint));
        for (title, png) in ["measured and simulated, held-out logs", "torque the last model lacks"]
            .iter()
            .zip(pictures)
        {
            let data = BASE64_STANDARD.encode(png);
            let _ = writeln!(out, "<p><img alt=\"{title}\" src=\"data:image/png;base64,{data}\"></p>");
        }
    }
    Ok(out + "</html>\n")
}

/// What the logs can tell of the nominal model.
fn information(outcome: &Outcome, out: &mut String) {
    *out += "<details><summary>what they can tell of the nominal model</summary>\n<table><tr><th>joint</th><th>parameter</th>\
        <th>nominal</th><th>known at best to</th></tr>\n";
    for own in &outcome.information {
        let known = own.deviation.map_or("not, or not from others".to_owned(), |deviation| {
            format!("{deviation:.2e}")
        });
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
        "<p>Held out: {}. Folds of the cross-validation: {}. Effects tried in a step: {}.</p>",
        escaped(&outcome.heldout),
        escaped(&outcome.folds),
        outcome.tried
    );
    *out += "<table><tr><th>position error, rms, rad or m</th><th>nominal</th><th>re-tuned</th><th>final</th></tr>\n";
    let models = [&outcome.nominal, &outcome.refit, &outcome.last];
    for (name, sets) in [
        ("held out", models.map(|model| &model.heldout)),
        ("fitted", models.map(|model| &model.fit)),
    ] {
        for joint in sets[0].rmse.0.keys() {
            let _ = write!(out, "<tr><td>{}, {name}</td>", escaped(joint));
            for set in sets {
                let value = set.rmse.0.get(joint).copied().unwrap_or(f64::NAN);
                let _ = write!(out, "<td>{value:.6}</td>");
            }
            *out += "</tr>\n";
        }
    }
    *out += "</table>\n";
    if let Some(floor) = outcome.noise_floor.value {
        let closed = outcome.gap_closed.map_or(String::new(), |x| {
            format!("; {:.0} % of the gap to it closed", 100.0 * x)
        });
        let _ = writeln!(
            out,
            "<p>Floor ({}): {floor:.6}{closed}.</p>",
            outcome.noise_floor.source
        );
    }
}

fn effects(outcome: &Outcome, out: &mut String) {
    if !outcome.accepted.is_empty() {
        *out += "<h2>Missing effects</h2>\n<table><tr><th>effect</th><th>at</th><th>parameters</th><th>held-out error without</th>\
            <th>with</th><th>p</th></tr>\n";
    }
    for accepted in &outcome.accepted {
        let parameters = accepted.parameters.iter();
        let values: Vec<String> = parameters.map(|(name, value)| format!("{name} {value}")).collect();
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td><td>{:.6}</td><td>{:.6}</td><td>{:.1e}</td></tr>",
            accepted.effect,
            escaped(&accepted.target),
            escaped(&values.join(", ")),
            accepted.heldout_rmse_before,
            accepted.heldout_rmse_after,
            accepted.p_value
        );
    }
    if !outcome.accepted.is_empty() {
        *out += "</table>\n";
    }
    for set in &outcome.indistinguishable {
        let _ = writeln!(
            out,
            "<p>These logs cannot tell apart: {}.</p>",
            escaped(&set.join(", "))
        );
    }
    if !outcome.unexplained.depends_on.is_empty() {
        let _ = writeln!(
            out,
            "<p>Unexplained: {:.0} % of what is left, over {}.</p>",
            100.0 * outcome.unexplained.fraction,
            escaped(&outcome.unexplained.depends_on.join(", "))
        );
    }
    *out += "<h2>Tried and not taken</h2>\n<table><tr><th>effect</th><th>at</th><th>why</th></tr>\n";
    for rejected in &outcome.rejected {
        let _ = writeln!(
            out,
            "<tr><td>{}</td><td>{}</td><td>{}</td></tr>",
            rejected.effect,
            escaped(&rejected.target),
            escaped(&rejected.reason)
        );
    }
    *out += "</table>\n";
}

/// Draws panels below each other.
fn stack(panels: &[Panel<'_>]) -> Result<Vec<u8>, ReportError> {
    let mut canvas = Canvas::new(PANEL.0, PANEL.1 * panels.len().max(1) as u32);
    canvas.draw(|area| {
        let areas = area.split_evenly((panels.len().max(1), 1));
        panels.iter().zip(&areas).try_for_each(|(panel, area)| panel.draw(area))
    })?;
    canvas.png()
}

/// Measured and simulated positions of degree of freedom `dof`, and their difference.
fn overlays(outcome: &Outcome, dof: usize) -> Result<Vec<u8>, ReportError> {
    let models = [
        ("nominal", &outcome.nominal.heldout, PALE),
        ("re-tuned", &outcome.refit.heldout, COLOURS[4]),
        ("final", &outcome.last.heldout, COLOURS[0]),
    ];
    let trials: Vec<(usize, &Trial)> = outcome.trials[1].iter().enumerate().take(DRAWN).collect();
    let mut panels = Vec::new();
    let titles: Vec<String> = trials
        .iter()
        .map(|(_, trial)| format!("{}, rad (m)", trial.name))
        .collect();
    for ((t, trial), title) in trials.into_iter().zip(&titles) {
        let own = |values: &dyn Fn(usize, f64) -> f64| -> Vec<(f64, f64)> {
            let readings = trial.readings.iter().enumerate().filter(|(_, r)| r.dof == dof);
            readings
                .map(|(i, r)| (trial.start + r.at * DT, values(i, r.position)))
                .collect()
        };
        let line = |name: &str, colour, points| Line {
            name: name.to_owned(),
            colour,
            width: 3,
            points,
        };
        let mut lines = vec![line("measured", INK, own(&|_, q| q))];
        let mut differences = Vec::new();
        for (name, measure, colour) in models {
            let predicted = &measure.predictions[t];
            lines.push(line(name, colour, own(&|i, _| predicted[i])));
            differences.push(line(name, colour, own(&|i, q| predicted[i] - q)));
        }
        panels.push(Panel {
            title,
            lines,
            ..Panel::default()
        });
        panels.push(Panel {
            title: "simulated less measured",
            below: "s",
            lines: differences,
            ..Panel::default()
        });
    }
    stack(&panels)
}

/// The torque a model lacks, as its mean over position, velocity, motor torque and time.
fn torques(moments: &[Moment]) -> Result<Vec<u8>, ReportError> {
    let over = [
        (0, "over position, rad (m)"),
        (1, "over velocity"),
        (3, "over motor torque"),
        (5, "over time, s"),
    ];
    let panel = |&(variable, below): &(usize, &'static str)| Panel {
        title: "torque the last model lacks, N m (N): mean of those that move forward and backward",
        below,
        lines: vec![
            mean(moments, variable, "forward", true),
            mean(moments, variable, "backward", false),
        ],
        ..Panel::default()
    };
    stack(&over.iter().map(panel).collect::<Vec<_>>())
}

/// Mean torque in bins of equally many moments.
fn mean(moments: &[Moment], variable: usize, name: &str, forward: bool) -> Line {
    let mut own: Vec<(f64, f64)> = moments
        .iter()
        .filter(|m| (m.values[1] > 0.0) == forward)
        .map(|m| (m.values[variable], m.torque))
        .collect();
    own.sort_by(|a, b| a.0.total_cmp(&b.0));
    let size = own.len().div_ceil(BINS).max(1);
    let middle = |bin: &[(f64, f64)]| {
        let n = bin.len() as f64;
        (
            bin.iter().map(|p| p.0).sum::<f64>() / n,
            bin.iter().map(|p| p.1).sum::<f64>() / n,
        )
    };
    Line {
        name: name.to_owned(),
        colour: COLOURS[usize::from(!forward)],
        width: 3,
        points: own.chunks(size).map(middle).collect(),
    }
}
