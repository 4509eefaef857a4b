//! What the suites draw: velocities over time (figure 7.9), errors by command (figure 7.8), maps of the grid, limits of
//! the pushes.

use plotters::style::RGBColor;

use super::hold::Row;
use super::push::{Cell, Pushes, THESIS};
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

/// Width over height of what a panel of the pushes shows, so that circles are round.
const ASPECT: f64 = 0.97;

/// Where the corners of a polygon of [`DIRECTIONS`] are, with the front above.
const BEARINGS: [(f64, f64); 4] = [(0.0, 1.0), (0.0, -1.0), (1.0, 0.0), (-1.0, 0.0)];

/// The strongest pushes that are recovered, with those of table 7.2: a polygon a command, with a corner where the pushes come from.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn push(pushes: &Pushes) -> Result<Canvas, ReportError> {
    let thesis = THESIS.iter().flatten().flatten().copied();
    let reached = pushes.cells.iter().map(Cell::any);
    let highest = reached.chain(thesis).fold(0.0, f64::max);
    let below = "highest force for 0.2 s, N, from where it came: front above, back below, right and left beside; circles each 50 N";
    framed(820, "Pushes recovered", below, |area| {
        let panels = pushes.cells.chunks(DIRECTIONS.len()).zip(&THESIS);
        for ((cells, thesis), area) in panels.zip(&area.split_evenly((2, 3))) {
            polar(cells, thesis, 1.08 * highest).draw(area)?;
        }
        Ok(())
    })
}

fn polar(cells: &[Cell], thesis: &[[f64; 2]; 4], reach: f64) -> Panel<'static> {
    let circles = (1..).map(|i| 50.0 * f64::from(i)).take_while(|&force| force < reach);
    let circles = circles.flat_map(|force| {
        let angles = (0..=72).map(|i| f64::from(i) * std::f64::consts::TAU / 72.0);
        let points = angles.map(move |angle| (force * angle.cos(), force * angle.sin()));
        points.chain([(f64::NAN, f64::NAN)])
    });
    Panel {
        title: command(cells[0].command),
        x: Some(-ASPECT * reach..ASPECT * reach),
        y: Some(-reach..reach),
        x_label: force,
        y_label: force,
        lines: vec![
            line("", FAINT, 2, circles.collect()),
            line(
                "thesis, all",
                COLOURS[1],
                2,
                polygon(thesis.iter().map(|[all, _]| *all)),
            ),
            line("any", COLOURS[1], 4, polygon(thesis.iter().map(|[_, any]| *any))),
            line("all", COLOURS[0], 2, polygon(cells.iter().map(Cell::all))),
            line("any", COLOURS[0], 5, polygon(cells.iter().map(Cell::any))),
        ],
        ..Panel::default()
    }
}

/// The closed polygon through a force in each of [`DIRECTIONS`].
fn polygon(forces: impl Iterator<Item = f64>) -> Vec<(f64, f64)> {
    let corners = BEARINGS.iter().zip(forces);
    let [front, back, right, left] = corners
        .map(|((x, y), force)| (x * force, y * force))
        .collect::<Vec<_>>()[..]
    else {
        return Vec::new();
    };
    vec![front, right, back, left, front]
}

fn force(newtons: &f64) -> String {
    short(&newtons.abs())
}

/// What a command of the suite is called.
fn command(command: [f64; 3]) -> &'static str {
    match command {
        [0.0, 0.0, _] => "in place",
        [0.3, ..] => "0.3 m/s forward",
        [0.6, ..] => "0.6 m/s forward",
        [_, 0.25, _] => "0.25 m/s to the left",
        _ => "0.5 m/s to the left",
    }
}
