//! What the suites draw: velocities over time (figure 7.9), errors by command (figure 7.8), maps of the grid, limits of
//! the pushes.

use plotters::style::RGBColor;

use super::hold::Row;
use super::push::{Pushes, THESIS};
use super::pushing::DIRECTIONS;
use super::stats::Estimate;
use super::summary::Errors;
use super::tour::Moment;
use super::tracking::Tracked;
use crate::report::ReportError;
use crate::report::canvas::{Area, COLOURS, Canvas, FAINT, GREY, INK, PALE, px, text, write};
use crate::report::plot::{Line, Panel, running_mean, short};

/// Width of every picture, pixels.
const WIDTH: u32 = 1260;
/// Height of the title, pixels.
const HEAD: u32 = 76;
/// Names of the axes of a command.
const AXES: [&str; 3] = ["forward, m/s", "to the left, m/s", "turning, rad/s"];

/// A title and what is below it.
fn framed(
    height: u32,
    title: &str,
    below: &str,
    draw: impl FnOnce(&Area<'_>) -> Result<(), ReportError>,
) -> Result<Canvas, ReportError> {
    let mut canvas = Canvas::new(WIDTH, HEAD + height);
    canvas.draw(|area| {
        write(area, title, &text(24, INK), (px(12), px(8)))?;
        write(area, below, &text(15, GREY), (px(12), px(46)))?;
        draw(&area.split_vertically(px(HEAD as i32)).1)
    })?;
    Ok(canvas)
}

fn line(name: &str, colour: RGBColor, width: u32, points: Vec<(f64, f64)>) -> Line {
    Line {
        name: name.to_owned(),
        colour,
        width,
        points,
    }
}

/// Commanded and measured velocity over the sequence of figure 7.9.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn velocity(tracked: &Tracked) -> Result<Canvas, ReportError> {
    let end = tracked.trace.len() as f64 * tracked.dt;
    let panel = |axis: usize| {
        let over_time = |value: fn(&Moment) -> [f64; 3]| {
            let moments = tracked.trace.iter().enumerate();
            moments
                .map(|(i, m)| (i as f64 * tracked.dt, value(m)[axis]))
                .collect::<Vec<_>>()
        };
        let raw = over_time(|moment| moment.velocity);
        let mean = running_mean(&raw, 1.0);
        Panel {
            title: AXES[axis],
            below: if axis == 2 { "time, s" } else { "" },
            x: Some(0.0..end),
            lines: vec![
                line("measured", PALE, 1, raw),
                line("mean of a second", COLOURS[0], 4, mean),
                line("desired", INK, 4, over_time(|moment| moment.desired)),
            ],
            ..Panel::default()
        }
    };
    let below = "the first sequence; a gap is a fall, after which the robot stands again for the next command";
    framed(600, "Velocities over a sequence of commands", below, |area| {
        let cells = area.split_evenly((3, 1));
        (0..3).zip(&cells).try_for_each(|(axis, cell)| panel(axis).draw(cell))
    })
}

/// Error by commanded velocity along each axis.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn error(tracked: &Tracked) -> Result<Canvas, ReportError> {
    let panel = |axis: usize| {
        let alone = |row: &&Row| (0..3).all(|k| k == axis || row.command[k] == 0.0);
        let mut rows: Vec<(f64, Errors)> = tracked
            .rows
            .iter()
            .filter(alone)
            .map(|row| (row.command[axis], Errors::of_row(row)))
            .collect();
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut lines = Vec::new();
        for (kind, (name, colour)) in ["m/s", "rad/s"].into_iter().zip(COLOURS).enumerate() {
            let points = |end: fn(Estimate) -> f64| {
                let estimates = rows.iter().map(|(x, e)| (*x, [e.xy, e.yaw][kind]));
                estimates.map(|(x, estimate)| (x, end(estimate))).collect::<Vec<_>>()
            };
            lines.push(line(name, colour, 5, points(|e| e.value)));
            lines.push(line("", colour, 1, points(|e| e.low)));
            lines.push(line("", colour, 1, points(|e| e.high)));
        }
        lines
    };
    let lines = [0, 1, 2].map(panel);
    let points = lines.iter().flatten().flat_map(|line| &line.points);
    let highest = points.map(|p| p.1).filter(|y| y.is_finite()).fold(0.1, f64::max);
    let below = "norm of command minus velocity averaged over a second, mean and its 95 % interval over sequences";
    framed(360, "Error by commanded velocity", below, |area| {
        let cells = area.split_evenly((1, 3));
        lines
            .into_iter()
            .zip(&cells)
            .enumerate()
            .try_for_each(|(axis, (lines, cell))| {
                let panel = Panel {
                    title: "error,",
                    below: AXES[axis],
                    y: Some(0.0..1.05 * highest),
                    lines,
                    ..Panel::default()
                };
                panel.draw(cell)
            })
    })
}

/// What a map shows.
struct Quantity {
    unit: &'static str,
    /// Values from here on have the darkest colour.
    darkest: f64,
    value: fn(&Row) -> f64,
}

const QUANTITIES: [Quantity; 3] = [
    Quantity {
        unit: "m/s",
        darkest: 0.3,
        value: |row| Errors::of_row(row).xy.value,
    },
    Quantity {
        unit: "rad/s",
        darkest: 0.3,
        value: |row| Errors::of_row(row).yaw.value,
    },
    Quantity {
        unit: "fell",
        darkest: 1.0,
        value: |row| row.falls() as f64 / row.records.len() as f64,
    },
];

impl Quantity {
    fn shade(&self, row: &Row) -> RGBColor {
        shade((self.value)(row) / self.darkest)
    }
}

/// Maps of errors and falls over the grid, one column for each turn rate.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn grid(tracked: &Tracked) -> Result<Canvas, ReportError> {
    let [xs, ys, turns] = &tracked.axes;
    let below = "across: forward, m/s; upward: to the left, m/s; error of the velocity, error of turning, share that fell; \
                 grey: never held";
    framed(690, "Errors and falls over the commands", below, |area| {
        for (band, quantity) in area.split_evenly((3, 1)).iter().zip(&QUANTITIES) {
            let (maps, scale) = band.split_horizontally(px(WIDTH as i32 - 100));
            let slices = tracked.grid.chunks(xs.len() * ys.len()).zip(turns);
            for (cell, (rows, turn)) in maps.split_evenly((1, turns.len())).iter().zip(slices) {
                let title = format!("turning {turn:.2} rad/s");
                map(&title, rows, [xs, ys], |row| quantity.shade(row)).draw(cell)?;
            }
            legend(quantity).draw(&scale)?;
        }
        Ok(())
    })
}

fn map<'a>(title: &'a str, rows: &[Row], axes: [&Vec<f64>; 2], colour: impl Fn(&Row) -> RGBColor) -> Panel<'a> {
    let half = axes.map(|values| match values[..] {
        [first, second, ..] => (second - first) / 2.0,
        _ => 0.1,
    });
    let ends = [0, 1].map(|k| axes[k][0] - half[k]..axes[k][axes[k].len() - 1] + half[k]);
    let block = |row: &Row| {
        let [x, y, _] = row.command;
        ([(x - half[0], y - half[1]), (x + half[0], y + half[1])], colour(row))
    };
    let [x, y] = ends;
    Panel {
        title,
        x: Some(x),
        y: Some(y),
        blocks: rows.iter().map(block).collect(),
        ..Panel::default()
    }
}

fn legend(quantity: &Quantity) -> Panel<'static> {
    let darkest = quantity.darkest;
    let steps = 32;
    let at = |i: usize| i as f64 / steps as f64;
    let block = |i: usize| ([(0.0, darkest * at(i)), (1.0, darkest * at(i + 1))], shade(at(i)));
    Panel {
        title: quantity.unit,
        x: Some(0.0..1.0),
        y: Some(0.0..darkest),
        x_label: |_| String::new(),
        blocks: (0..steps).map(block).collect(),
        ..Panel::default()
    }
}

/// From nearly white at nought to dark at one and beyond.
fn shade(share: f64) -> RGBColor {
    if !share.is_finite() {
        return FAINT;
    }
    let share = share.clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + (to - from) * share).round() as u8;
    RGBColor(mix(250.0, 120.0), mix(250.0, 20.0), mix(240.0, 30.0))
}

/// The strongest pushes that are recovered, with those of table 7.2.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn push(pushes: &Pushes) -> Result<Canvas, ReportError> {
    let highest = THESIS.iter().flatten().flatten().copied();
    let highest = pushes
        .cells
        .iter()
        .map(|cell| cell.any())
        .chain(highest)
        .fold(0.0, f64::max);
    let below = "highest force for 0.2 s with all pushes recovered (dark) and with any (pale), N, by command";
    framed(560, "Pushes recovered", below, |area| {
        for (i, cell) in area.split_evenly((2, 2)).iter().enumerate() {
            let mut panel = pushed_from(i, pushes);
            panel.y = Some(0.0..1.08 * highest);
            panel.draw(cell)?;
        }
        Ok(())
    })
}

fn pushed_from(direction: usize, pushes: &Pushes) -> Panel<'static> {
    let cells = pushes
        .cells
        .iter()
        .filter(|cell| cell.direction == DIRECTIONS[direction]);
    let mut blocks = Vec::new();
    let mut thesis = Vec::new();
    for (i, cell) in cells.enumerate() {
        let (left, right) = (i as f64 - 0.35, i as f64 + 0.35);
        blocks.push(([(left, 0.0), (right, cell.any())], PALE));
        blocks.push(([(left, 0.0), (right, cell.all())], COLOURS[0]));
        for force in THESIS[i][direction] {
            thesis.extend([(left, force), (right, force), (f64::NAN, f64::NAN)]);
        }
    }
    Panel {
        title: [
            "from the front, N",
            "from the back, N",
            "from the right, N",
            "from the left, N",
        ][direction],
        x: Some(-0.5..4.5),
        x_label: command,
        y_label: short,
        lines: vec![
            line("all", COLOURS[0], 1, Vec::new()),
            line("any", PALE, 1, Vec::new()),
            line("thesis", COLOURS[1], 4, thesis),
        ],
        blocks,
        ..Panel::default()
    }
}

/// What the command at `index` of the suite is called.
fn command(index: &f64) -> String {
    let names = ["in place", "0.3 forward", "0.6 forward", "0.25 left", "0.5 left"];
    let whole = index.round();
    let name = names
        .get(whole as usize)
        .filter(|_| (index - whole).abs() < 1e-6 && whole >= 0.0);
    name.copied().unwrap_or_default().to_owned()
}
