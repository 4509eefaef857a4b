//! The strongest pushes that are recovered, as polygons around the robot.

use plotters::element::PathElement;
use plotters::style::{Color, RGBColor};

use super::ReportError;
use super::canvas::{Area, COLOURS, Canvas, FAINT, px, text, write};
use super::evaluation::Pushed;
use super::plot::{Line, Panel, framed, short};

/// Width over height of what a panel shows, so that circles are round.
const ASPECT: f64 = 0.97;

/// Corners of a polygon in their order around it: where the pushes come from, and where that is in the picture.
const CORNERS: [(&str, [f64; 2]); 4] = [
    ("front", [0.0, 1.0]),
    ("right", [1.0, 0.0]),
    ("back", [0.0, -1.0]),
    ("left", [-1.0, 0.0]),
];

/// Commands side by side.
const COLUMNS: usize = 3;
/// Height of the legend, pixels.
const LEGEND: u32 = 34;
/// Colours of this robot and of the thesis's.
const HERE: RGBColor = COLOURS[0];
const THESIS: RGBColor = COLOURS[1];
/// Widths of the lines through the strongest of which every push was recovered, and through that of which any was, samples.
const ALL: u32 = 2;
const ANY: u32 = 5;

/// The strongest pushes that are recovered under `conditions`, with those of table 7.2: a polygon a command, with a corner where the
/// pushes come from.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn pushes(rows: &[Pushed], conditions: Option<&str>) -> Result<Canvas, ReportError> {
    let mut commands: Vec<[f64; 3]> = rows.iter().map(|row| row.command).collect();
    commands.dedup();
    let highest = rows
        .iter()
        .map(|row| row.max_n.max(row.thesis_max_n))
        .fold(50.0, f64::max);
    let below = "highest force for 0.2 s, N, from where it came: front above, back below, right and left beside; circles each 50 N";
    let lines = commands.len().div_ceil(COLUMNS);
    framed(LEGEND + 410 * lines as u32, "Pushes recovered", below, |area| {
        let (head, area) = area.split_vertically(px(LEGEND as i32));
        legend(&head, conditions)?;
        for (command, area) in commands.iter().zip(&area.split_evenly((lines, COLUMNS))) {
            let own: Vec<&Pushed> = rows.iter().filter(|row| row.command == *command).collect();
            polar(&named(*command), &own, 1.08 * highest).draw(area)?;
        }
        Ok(())
    })
}

fn polar<'a>(title: &'a str, rows: &[&Pushed], reach: f64) -> Panel<'a> {
    // Forces have a bound, but not one that makes circles of 50 N few.
    let apart = 50.0 * (reach / 1000.0).ceil();
    let circles = (1..).map(|i| apart * f64::from(i)).take_while(|&force| force < reach);
    let circles = circles.flat_map(|force| {
        let angles = (0..=72).map(|i| f64::from(i) * std::f64::consts::TAU / 72.0);
        let points = angles.map(move |angle| (force * angle.cos(), force * angle.sin()));
        points.chain([(f64::NAN, f64::NAN)])
    });
    Panel {
        title,
        x: Some(-ASPECT * reach..ASPECT * reach),
        y: Some(-reach..reach),
        x_label: force,
        y_label: force,
        lines: vec![
            Line::new("", FAINT, 2, circles.collect()),
            Line::new("", THESIS, ALL, polygon(rows, |row| row.thesis_all_ten_n)),
            Line::new("", THESIS, ANY, polygon(rows, |row| row.thesis_max_n)),
            Line::new("", HERE, ALL, polygon(rows, |row| row.all_ten_n)),
            Line::new("", HERE, ANY, polygon(rows, |row| row.max_n)),
        ],
        ..Panel::default()
    }
}

/// The closed polygon through a force in each direction; it is open where pushes from one were not played.
fn polygon(rows: &[&Pushed], force: impl Fn(&Pushed) -> f64) -> Vec<(f64, f64)> {
    let corner = |(direction, [x, y]): &(&str, [f64; 2])| {
        let row = rows.iter().find(|row| row.direction == *direction);
        let force = row.map_or(f64::NAN, |row| force(row));
        (x * force, y * force)
    };
    CORNERS.iter().chain(&CORNERS[..1]).map(corner).collect()
}

fn force(newtons: f64, _: f64) -> String {
    short(newtons.abs())
}

/// What the polygons are, each with a piece of its line.
fn legend(area: &Area<'_>, conditions: Option<&str>) -> Result<(), ReportError> {
    let here = match conditions {
        Some("randomised") => "recovered here, randomised",
        Some("nominal") => "recovered here, nominal",
        _ => "recovered here",
    };
    let lines = [("at least once", ANY), ("every time", ALL)];
    let mut x = px(12);
    for (whose, colour) in [(here, HERE), ("in table 7.2 of the thesis", THESIS)] {
        x = write(area, &format!("{whose}:"), &text(15, colour), (x, px(4)))? + px(10);
        for (which, width) in lines {
            let piece = [(x, px(12)), (x + px(34), px(12))];
            area.draw(&PathElement::new(piece, colour.stroke_width(width)))
                .map_err(ReportError::draw)?;
            x = write(area, which, &text(15, colour), (x + px(40), px(4)))? + px(14);
        }
        x += px(20);
    }
    Ok(())
}

/// What a command is called.
fn named([x, y, turn]: [f64; 3]) -> String {
    let parts = [
        (x, ["m/s forward", "m/s backward"]),
        (y, ["m/s to the left", "m/s to the right"]),
        (turn, ["rad/s to the left", "rad/s to the right"]),
    ];
    let moves: Vec<String> = parts
        .iter()
        .filter(|(velocity, _)| *velocity != 0.0)
        .map(|(velocity, [ahead, back])| {
            format!(
                "{} {}",
                short(velocity.abs()),
                if *velocity > 0.0 { ahead } else { back }
            )
        })
        .collect();
    if moves.is_empty() {
        "in place".into()
    } else {
        moves.join(", ")
    }
}
