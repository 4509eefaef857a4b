//! The strongest pushes that are recovered, as polygons around the robot.

use super::ReportError;
use super::canvas::{COLOURS, Canvas, FAINT};
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

/// The strongest pushes that are recovered, with those of table 7.2: a polygon a command, with a corner where the pushes come from.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn pushes(rows: &[Pushed]) -> Result<Canvas, ReportError> {
    let mut commands: Vec<[f64; 3]> = rows.iter().map(|row| row.command).collect();
    commands.dedup();
    let highest = rows
        .iter()
        .map(|row| row.max_n.max(row.thesis_max_n))
        .fold(50.0, f64::max);
    let below = "highest force for 0.2 s, N, from where it came: front above, back below, right and left beside; circles each 50 N";
    let lines = commands.len().div_ceil(COLUMNS);
    framed(410 * lines as u32, "Pushes recovered", below, |area| {
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
            Line::new("thesis: all", COLOURS[1], 2, polygon(rows, |row| row.thesis_all_ten_n)),
            Line::new("any", COLOURS[1], 4, polygon(rows, |row| row.thesis_max_n)),
            Line::new("here: all", COLOURS[0], 2, polygon(rows, |row| row.all_ten_n)),
            Line::new("any", COLOURS[0], 5, polygon(rows, |row| row.max_n)),
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

fn force(newtons: &f64) -> String {
    short(&newtons.abs())
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
                short(&velocity.abs()),
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
