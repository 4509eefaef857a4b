//! How commands were held: a table in colours, errors along each axis (figure 7.8), maps of a grid.

use plotters::style::RGBColor;

use super::ReportError;
use super::canvas::{Area, COLOURS, Canvas, FAINT, INK, px, text, write};
use super::evaluation::{Grid, Held};
use super::plot::{Line, Panel, WIDTH, framed};

/// Names of the axes of a command.
pub const AXES: [&str; 3] = ["forward, m/s", "to the left, m/s", "turning, rad/s"];

/// A quantity that is shown as a colour.
struct Quantity {
    unit: &'static str,
    /// Values from here on have the darkest colour.
    darkest: f64,
}

const QUANTITIES: [Quantity; 3] = [
    Quantity {
        unit: "m/s",
        darkest: 0.3,
    },
    Quantity {
        unit: "rad/s",
        darkest: 0.3,
    },
    Quantity {
        unit: "fell",
        darkest: 1.0,
    },
];

/// From nearly white at nought to dark at one and beyond.
fn shade(share: f64) -> RGBColor {
    if !share.is_finite() {
        return FAINT;
    }
    let share = share.clamp(0.0, 1.0);
    let mix = |from: f64, to: f64| (from + (to - from) * share).round() as u8;
    RGBColor(mix(250.0, 120.0), mix(250.0, 20.0), mix(240.0, 30.0))
}

/// Height of a command in [`list`], pixels.
const LINE: i32 = 26;

/// Errors and falls command by command, as numbers on their colours.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn list(rows: &[Held]) -> Result<Canvas, ReportError> {
    // A picture of more is no picture; the page has them all as a table.
    let rows = &rows[..rows.len().min(100)];
    let below = "forward, m/s; to the left, m/s; turning, rad/s; grey: never held for long enough to measure an error";
    framed(
        (LINE * (rows.len() as i32 + 2)) as u32,
        "Falls and errors by command",
        below,
        |area| {
            let heads = ["command", "fell", "error, m/s", "error, rad/s"];
            for (head, left) in heads.iter().zip(LEFTS) {
                write(area, head, &text(15, INK), (px(left), px(4)))?;
            }
            (1..).zip(rows).try_for_each(|(i, row)| held(area, row, LINE * i))
        },
    )
}

/// Left ends of the columns of [`list`], and width of those in colour, pixels.
const LEFTS: [i32; 4] = [12, 260, 580, 900];
const CELL: i32 = 300;

fn held(area: &Area<'_>, row: &Held, top: i32) -> Result<(), ReportError> {
    let [x, y, turn] = row.command;
    let named = format!("({x:>5.2}, {y:>5.2}, {turn:>5.2})");
    write(area, &named, &text(15, INK), (px(LEFTS[0]), px(top + 6)))?;
    let fell = row.falls / row.episodes;
    let error = |error: Option<f64>| error.map_or(("-".to_owned(), f64::NAN), |x| (format!("{x:.3}"), x));
    let cells = [
        (format!("{} of {}", row.falls, row.episodes), fell, &QUANTITIES[2]),
        {
            let (shown, x) = error(row.error_xy_mps);
            (shown, x, &QUANTITIES[0])
        },
        {
            let (shown, x) = error(row.error_yaw_radps);
            (shown, x, &QUANTITIES[1])
        },
    ];
    for ((shown, value, quantity), left) in cells.iter().zip(&LEFTS[1..]) {
        let share = value / quantity.darkest;
        let cell = area
            .clone()
            .shrink((px(*left), px(top)), (px(CELL) as u32, px(LINE - 2) as u32));
        cell.fill(&shade(share)).map_err(ReportError::draw)?;
        let ink = if share > 0.5 { RGBColor(255, 255, 255) } else { INK };
        write(&cell, shown, &text(15, ink), (px(8), px(6)))?;
    }
    Ok(())
}

/// Error by commanded velocity along each axis.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn along_axes(rows: &[Held]) -> Result<Canvas, ReportError> {
    let lines = [0, 1, 2].map(|axis| errors(rows, axis));
    let points = lines.iter().flatten().flat_map(|line| &line.points);
    let highest = points.map(|p| p.1).filter(|y| y.is_finite()).fold(0.1, f64::max);
    let below = "norm of command minus velocity averaged over a second, mean and its 95 % interval over sequences";
    framed(360, "Error by commanded velocity", below, |area| {
        let cells = area.split_evenly((1, 3));
        let axes = lines.into_iter().zip(AXES).zip(&cells);
        axes.into_iter().try_for_each(|((lines, below), cell)| {
            let panel = Panel {
                title: "error,",
                below,
                y: Some(0.0..1.05 * highest),
                lines,
                ..Panel::default()
            };
            panel.draw(cell)
        })
    })
}

/// Both errors, each with its interval, at the commands along `axis` alone.
fn errors(rows: &[Held], axis: usize) -> Vec<Line> {
    let alone = |row: &&Held| (0..3).all(|k| k == axis || row.command[k] == 0.0);
    let mut rows: Vec<&Held> = rows.iter().filter(alone).collect();
    rows.sort_by(|a, b| a.command[axis].total_cmp(&b.command[axis]));
    let mut lines = Vec::new();
    for (kind, (name, colour)) in ["m/s", "rad/s"].into_iter().zip(COLOURS).enumerate() {
        let mut add = |name, width, value: fn(Option<f64>, [Option<f64>; 2]) -> Option<f64>| {
            let of = |row: &Held| match kind {
                0 => value(row.error_xy_mps, row.error_xy_ci95.unwrap_or_default()),
                _ => value(row.error_yaw_radps, row.error_yaw_ci95.unwrap_or_default()),
            };
            let points = rows.iter().map(|row| (row.command[axis], of(row).unwrap_or(f64::NAN)));
            lines.push(Line::new(name, colour, width, points.collect()));
        };
        add(name, 5, |error, _| error);
        add("", 1, |_, [low, _]| low);
        add("", 1, |_, [_, high]| high);
    }
    lines
}

/// Maps of errors and falls over the grid, one column for each turn rate.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn grid(grid: &Grid) -> Result<Canvas, ReportError> {
    let cells = &grid.cells;
    let fallen = 1.0 / grid.episodes;
    let bands = [
        (&cells.error_xy_mps, 1.0),
        (&cells.error_yaw_radps, 1.0),
        (&cells.falls, fallen),
    ];
    let below = "across: forward, m/s; upward: to the left, m/s; error of the velocity, error of turning, share that fell; \
                 grey: never held";
    framed(690, "Errors and falls over the commands", below, |area| {
        let areas = area.split_evenly((3, 1));
        for ((band, quantity), (slices, factor)) in areas.iter().zip(&QUANTITIES).zip(bands) {
            let (maps, scale) = band.split_horizontally(px(WIDTH as i32 - 100));
            let slices = slices.iter().zip(&grid.omega_z);
            for (cell, (slice, turn)) in maps.split_evenly((1, grid.omega_z.len())).iter().zip(slices) {
                let title = format!("turning {turn:.2} rad/s");
                let colour = |value: Option<f64>| shade(factor * value.unwrap_or(f64::NAN) / quantity.darkest);
                map(&title, [&grid.v_x, &grid.v_y], slice, colour).draw(cell)?;
            }
            legend(quantity).draw(&scale)?;
        }
        Ok(())
    })
}

fn map<'a>(
    title: &'a str,
    axes: [&Vec<f64>; 2],
    slice: &[Vec<Option<f64>>],
    colour: impl Fn(Option<f64>) -> RGBColor,
) -> Panel<'a> {
    let half = axes.map(|values| match values[..] {
        [first, second, ..] => (second - first) / 2.0,
        _ => 0.1,
    });
    let [x, y] = [0, 1].map(|k| axes[k][0] - half[k]..axes[k][axes[k].len() - 1] + half[k]);
    let mut blocks = Vec::new();
    for (y, row) in axes[1].iter().zip(slice) {
        blocks.extend(axes[0].iter().zip(row).map(|(x, value)| {
            let corners = [(x - half[0], y - half[1]), (x + half[0], y + half[1])];
            (corners, colour(*value))
        }));
    }
    Panel {
        title,
        x: Some(x),
        y: Some(y),
        blocks,
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
        x_label: |_, _| String::new(),
        blocks: (0..steps).map(block).collect(),
        ..Panel::default()
    }
}
