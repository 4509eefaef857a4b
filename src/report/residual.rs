//! Pictures of a residual: measured and simulated motion of a joint, the spectrum and the autocorrelation of what is between them, and the
//! torque that the simulation lacks over everything it may depend on.

use std::f64::consts::TAU;
use std::ops::Range;

use omniwalk_sim2real::identify::{DT, Lacking, Moment, Trial};
use plotters::style::RGBColor;

use super::ReportError;
use super::canvas::{COLOURS, Canvas, GREY, INK};
use super::plot::{Line, Panel};

/// Size of a panel, pixels.
const PANEL: (u32, u32) = (1200, 240);
/// Logs that are drawn.
const DRAWN: usize = 3;
/// Points of a mean over a variable.
const BINS: usize = 40;
/// Longest stretch of a spectrum, s.
const STRETCH: f64 = 2.0;
/// Longest lag of an autocorrelation, s.
const LONGEST: f64 = 0.5;

/// A model's predictions: its name, what it predicts of every reading of every trial, its colour.
pub struct Predicted<'a> {
    /// Name in the legend.
    pub name: &'static str,
    /// Of every trial.
    pub of: &'a [Vec<f64>],
    /// Its colour.
    pub colour: RGBColor,
}

/// A picture and what it shows.
pub type Picture = (String, Vec<u8>);

/// The pictures of degree of freedom `dof`, which lacks `lacking`.
///
/// # Errors
/// When a picture cannot be drawn.
pub fn pictures(
    trials: &[Trial],
    dof: usize,
    models: &[Predicted<'_>],
    lacking: &Lacking,
) -> Result<Vec<Picture>, ReportError> {
    let mut out = Vec::new();
    let read: Vec<usize> = (0..trials.len())
        .filter(|&t| trials[t].readings.iter().any(|reading| reading.dof == dof))
        .collect();
    for &t in read.iter().take(DRAWN) {
        let title = format!("measured and simulated {}, {}", lacking.joint, trials[t].name);
        out.push((title, overlay(trials, t, dof, models)?));
    }
    if !read.is_empty() {
        let title = format!("spectrum and autocorrelation of what {} leaves", lacking.joint);
        out.push((title, colour_of_noise(trials, dof, models)?));
    }
    if !lacking.moments.is_empty() {
        let title = format!("torque that the simulation of {} lacks", lacking.joint);
        out.push((title, torques(lacking)?));
    }
    Ok(out)
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

/// Times (s in the log) and values of a trial's readings of a degree of freedom.
fn of_dof(trial: &Trial, dof: usize, value: impl Fn(usize, f64) -> f64) -> Vec<(f64, f64)> {
    let own = trial.readings.iter().enumerate().filter(|(_, r)| r.dof == dof);
    own.map(|(i, r)| (trial.start + r.at * DT, value(i, r.position)))
        .collect()
}

/// Measured and simulated positions in trial `t`, and their difference.
fn overlay(trials: &[Trial], t: usize, dof: usize, models: &[Predicted<'_>]) -> Result<Vec<u8>, ReportError> {
    let trial = &trials[t];
    let lines = |value: &dyn Fn(f64, f64) -> f64| -> Vec<Line> {
        let line = |model: &Predicted<'_>| {
            let points = of_dof(trial, dof, |i, q| value(model.of[t][i], q));
            Line::new(model.name, model.colour, 3, points)
        };
        models.iter().map(line).collect()
    };
    let mut positions = lines(&|p, _| p);
    // Last, so that it is seen where all agree.
    positions.push(Line::new("measured", INK, 2, of_dof(trial, dof, |_, q| q)));
    let times: Vec<f64> = positions[0].points.iter().map(|p| p.0).collect();
    let x = times.first().copied().unwrap_or(0.0)..times.last().copied().unwrap_or(1.0);
    let title = format!("{}, rad (m)", trial.name);
    stack(&[
        Panel {
            title: &title,
            x: Some(x.clone()),
            lines: positions,
            ..Panel::default()
        },
        Panel {
            title: "simulated less measured",
            below: "s",
            x: Some(x),
            lines: lines(&|p, q| p - q),
            ..Panel::default()
        },
    ])
}

/// Residuals of a degree of freedom at equal distances, one list a trial, and that distance, s.
fn even(trials: &[Trial], dof: usize, predicted: &[Vec<f64>]) -> (Vec<Vec<f64>>, f64) {
    let all: Vec<Vec<(f64, f64)>> = trials
        .iter()
        .zip(predicted)
        .map(|(trial, predicted)| of_dof(trial, dof, |i, q| predicted[i] - q))
        .filter(|own| own.len() > 3)
        .collect();
    let span = |own: &Vec<(f64, f64)>| own[own.len() - 1].0 - own[0].0;
    let count: usize = all.iter().map(|own| own.len() - 1).sum();
    let every = all.iter().map(span).sum::<f64>() / count.max(1) as f64;
    let resampled = |own: &Vec<(f64, f64)>| {
        let mut next = 0;
        let steps = (span(own) / every) as usize;
        let at = |k: usize| {
            let time = own[0].0 + k as f64 * every;
            while next + 2 < own.len() && own[next + 1].0 < time {
                next += 1;
            }
            let (a, b) = (own[next], own[next + 1]);
            a.1 + ((time - a.0) / (b.0 - a.0).max(1e-9)).clamp(0.0, 1.0) * (b.1 - a.1)
        };
        (0..=steps).map(at).collect()
    };
    (all.iter().map(resampled).collect(), every)
}

fn colour_of_noise(trials: &[Trial], dof: usize, models: &[Predicted<'_>]) -> Result<Vec<u8>, ReportError> {
    let (mut spectra, mut correlations) = (Vec::new(), Vec::new());
    let (mut readings, mut longest) = (0, 0.0_f64);
    for model in models {
        let (residuals, every) = even(trials, dof, model.of);
        readings = residuals.iter().map(Vec::len).sum();
        longest = longest.max(LONGEST.min(residuals.iter().map(Vec::len).max().unwrap_or(0) as f64 * every));
        spectra.push(Line::new(model.name, model.colour, 3, spectrum(&residuals, every)));
        correlations.push(Line::new(
            model.name,
            model.colour,
            3,
            autocorrelation(&residuals, every),
        ));
    }
    // What 95 % of white noise stays within.
    let bound = 1.96 / f64::max(readings as f64, 1.0).sqrt();
    for sign in [1.0, -1.0] {
        correlations.push(Line::new(
            "",
            GREY,
            1,
            vec![(0.0, sign * bound), (longest, sign * bound)],
        ));
    }
    stack(&[
        Panel {
            title: "spectrum of simulated less measured, dB of 1 rad^2/Hz (m^2/Hz)",
            below: "Hz",
            lines: spectra,
            ..Panel::default()
        },
        Panel {
            title: "its autocorrelation; white noise stays within the grey lines",
            below: "lag, s",
            lines: correlations,
            ..Panel::default()
        },
    ])
}

/// Power over frequency (Welch 1967: Hann windows that overlap by half), dB of one unit squared per Hz.
fn spectrum(residuals: &[Vec<f64>], every: f64) -> Vec<(f64, f64)> {
    let longest = residuals.iter().map(Vec::len).max().unwrap_or(0);
    let n = ((STRETCH / every.max(1e-9)) as usize).min(longest) & !1;
    if n < 8 {
        return Vec::new();
    }
    let window: Vec<f64> = (0..n).map(|i| 0.5 - 0.5 * (TAU * i as f64 / n as f64).cos()).collect();
    let weight: f64 = window.iter().map(|w| w * w).sum();
    let table: Vec<(f64, f64)> = (0..n).map(|i| (TAU * i as f64 / n as f64).sin_cos()).collect();
    let mut power = vec![0.0; n / 2];
    let mut stretches = 0.0;
    for own in residuals.iter().filter(|own| own.len() >= n) {
        for first in (0..=own.len() - n).step_by(n / 2) {
            let stretch = &own[first..first + n];
            let mean = stretch.iter().sum::<f64>() / n as f64;
            for (k, power) in power.iter_mut().enumerate() {
                let (mut s, mut c) = (0.0, 0.0);
                for (i, (value, window)) in stretch.iter().zip(&window).enumerate() {
                    let (sin, cos) = table[i * k % n];
                    s += window * (value - mean) * sin;
                    c += window * (value - mean) * cos;
                }
                *power += s * s + c * c;
            }
            stretches += 1.0;
        }
    }
    let density = |p: f64| {
        10.0 * (2.0 * every * p / (weight * f64::max(stretches, 1.0)))
            .max(1e-30)
            .log10()
    };
    let points = power.iter().enumerate().skip(1);
    points
        .map(|(k, p)| (k as f64 / (n as f64 * every), density(*p)))
        .collect()
}

/// Autocorrelation over the lag, over all trials.
fn autocorrelation(residuals: &[Vec<f64>], every: f64) -> Vec<(f64, f64)> {
    let mean = |own: &[f64]| own.iter().sum::<f64>() / own.len().max(1) as f64;
    let centred: Vec<Vec<f64>> = residuals
        .iter()
        .map(|own| own.iter().map(|x| x - mean(own)).collect())
        .collect();
    let longest = centred.iter().map(Vec::len).max().unwrap_or(0);
    let lags = ((LONGEST / every.max(1e-9)) as usize).min(longest.saturating_sub(1));
    let shifted = |lag: usize| -> f64 {
        let own = |own: &Vec<f64>| own.iter().zip(own.iter().skip(lag)).map(|(a, b)| a * b).sum::<f64>();
        centred.iter().map(own).sum()
    };
    let power = shifted(0).max(f64::MIN_POSITIVE);
    (0..=lags)
        .map(|lag| (lag as f64 * every, shifted(lag) / power))
        .collect()
}

/// The torque that is lacking, as its mean over every variable.
fn torques(lacking: &Lacking) -> Result<Vec<u8>, ReportError> {
    let below: Vec<String> = lacking
        .names
        .iter()
        .map(|name| format!("over {}, {}", name.replace('_', " "), unit(name)))
        .collect();
    let panels = below.iter().enumerate().map(|(variable, below)| {
        let lines = vec![
            mean(&lacking.moments, variable, "forward", true),
            mean(&lacking.moments, variable, "backward", false),
        ];
        Panel {
            title: "torque that is lacking, N m (N): mean of moments that move",
            below,
            x: extent(&lines),
            lines,
            ..Panel::default()
        }
    });
    stack(&panels.collect::<Vec<_>>())
}

/// Smallest and largest x of `lines`, where they differ: temperatures and voltages are far from zero.
fn extent(lines: &[Line]) -> Option<Range<f64>> {
    let all = lines.iter().flat_map(|line| line.points.iter().map(|point| point.0));
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
        (low.min(x), high.max(x))
    });
    (low < high).then_some(low..high)
}

/// Unit of a variable that torque may depend on; what else a log has is in its own.
fn unit(name: &str) -> &'static str {
    match name {
        "position" | "target" => "rad (m)",
        "velocity" => "rad/s (m/s)",
        "acceleration" => "rad/s^2 (m/s^2)",
        "torque" => "N m (N)",
        "time" => "s",
        "voltage" => "V",
        _ => "in the log's unit",
    }
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
    let points = own.chunks(size).map(middle).collect();
    Line::new(name, COLOURS[usize::from(!forward)], 3, points)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers between -1 and 1 without any pattern.
    fn noise(n: usize) -> Vec<f64> {
        let mut state = 1_u64;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (state >> 33) as f64 / f64::from(1_u32 << 30) - 1.0
        };
        (0..n).map(|_| next()).collect()
    }

    #[test]
    fn the_spectrum_of_a_sine_peaks_at_its_frequency_and_holds_its_power() {
        let every = 0.005;
        let sine: Vec<f64> = (0..2000)
            .map(|i| 0.3 * (TAU * 7.0 * f64::from(i) * every).sin())
            .collect();
        let found = spectrum(&[sine], every);
        let peak = found.iter().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((peak.0 - 7.0).abs() < 0.3, "{peak:?}");
        let power: f64 = found.iter().map(|(_, db)| 10_f64.powf(db / 10.0)).sum::<f64>() * found[0].0;
        assert!((power - 0.045).abs() < 0.002, "{power}");
    }

    #[test]
    fn noise_is_white_and_a_slow_motion_is_not() {
        let every = 0.005;
        let white = autocorrelation(&[noise(4000)], every);
        let bound = 4.0 / 4000_f64.sqrt();
        assert!(white.iter().skip(1).all(|(_, r)| r.abs() < bound));
        let slow: Vec<f64> = (0..4000).map(|i| (0.01 * f64::from(i)).sin()).collect();
        assert!(autocorrelation(&[slow], every)[20].1 > 0.9);
        let flat = spectrum(&[noise(40_000)], every);
        let (low, high) = flat
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), p| (l.min(p.1), h.max(p.1)));
        assert!(high - low < 6.0, "{low} {high}");
    }
}
