//! `learning.png`: what changed while runs learned, one colour a run.

use super::ReportError;
use super::canvas::{COLOURS, Canvas, GREY, INK, px, text, write};
use super::curves::Curves;
use super::plot::{Line, Panel, short};

/// Panels side by side.
const COLUMNS: usize = 3;
/// Size of a panel, pixels.
const PANEL: (u32, u32) = (420, 190);
/// Height of the title, pixels.
const HEAD: u32 = 76;

/// Column of the metrics, its title, and whether its axis counts powers of ten.
const PANELS: [(&str, &str, bool); 28] = [
    ("reward/total", "reward, all terms", false),
    ("reward/velocity", "reward for velocity", false),
    ("reward/foot", "reward for feet", false),
    ("reward/pose", "reward for pose", false),
    ("reward/alive", "reward for being alive", false),
    ("reward/action_rate", "reward for calm actions", false),
    ("reward/slip", "reward for slip", false),
    ("episode/steps", "episode length, control steps", false),
    ("episode/fallen", "share of episodes that fell", false),
    ("episode/leg_overlap", "share ended by leg overlap", false),
    ("tracking/error_xy_mps", "velocity error, m/s", false),
    ("tracking/error_yaw_radps", "turning error, rad/s", false),
    ("gait/touchdowns_per_second", "touchdowns a second", false),
    ("gait/alternation", "touchdowns that alternate, share", false),
    ("gait/air_time_s", "air time of a swing, s", false),
    ("gait/clearance_m", "clearance, m", false),
    ("gait/slip_mps", "slip of loaded soles, m/s", false),
    ("curriculum/level", "curriculum level", false),
    ("curriculum/upper_x", "bound of commands forward, m/s", false),
    ("curriculum/lower_x", "bound of commands backward, m/s", false),
    ("curriculum/upper_y", "bound of commands to the left, m/s", false),
    ("curriculum/lower_y", "bound of commands to the right, m/s", false),
    ("curriculum/upper_yaw", "bound of turning left, rad/s", false),
    ("curriculum/lower_yaw", "bound of turning right, rad/s", false),
    ("curriculum/velocity_factor", "curriculum factor C_v", false),
    ("curriculum/foot_factor", "curriculum factor C_foot", false),
    ("ppo/kl", "KL divergence of an update", false),
    ("ppo/learning_rate", "learning rate", true),
];

/// Draws the learning curves of `runs`. Quantities that are zero or missing in all of them get no panel.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn draw(runs: &[Curves]) -> Result<Canvas, ReportError> {
    let end = runs.iter().map(Curves::steps).max().unwrap_or(1).max(1) as f64;
    let panels: Vec<Panel<'_>> = PANELS.iter().filter_map(|entry| panel(entry, runs, end)).collect();
    let rows = panels.len().div_ceil(COLUMNS) as u32;
    let (width, height) = (PANEL.0 * COLUMNS as u32, HEAD + PANEL.1 * rows);
    let mut canvas = Canvas::new(width, height);
    canvas.draw(|area| {
        write(area, "Learning curves", &text(24, INK), (px(12), px(8)))?;
        let mut x = px(230);
        for (i, run) in runs.iter().enumerate() {
            x = write(area, &run.name, &text(17, colour(i)), (x, px(14)))? + px(18);
        }
        let updates = runs.iter().map(Curves::updates_per_point).max().unwrap_or(1);
        let below = format!("against control steps of all environments; a point is the mean of {updates} updates");
        write(area, &below, &text(15, GREY), (px(12), px(46)))?;
        let (_, below) = area.split_vertically(px(HEAD as i32));
        let cells = below.split_evenly((rows as usize, COLUMNS));
        panels.iter().zip(&cells).try_for_each(|(panel, cell)| panel.draw(cell))
    })?;
    Ok(canvas)
}

fn panel<'a>(&(column, title, logarithmic): &(&str, &'a str, bool), runs: &[Curves], end: f64) -> Option<Panel<'a>> {
    let line = |(i, run): (usize, &Curves)| {
        let mut points = run.column(column);
        if logarithmic {
            points.iter_mut().for_each(|(_, y)| *y = y.log10());
        }
        Line {
            name: String::new(),
            colour: colour(i),
            width: 3,
            points,
        }
    };
    let lines: Vec<Line> = runs.iter().enumerate().map(line).collect();
    let something = |&(_, y): &(f64, f64)| y.is_finite() && y != 0.0;
    let worth = lines.iter().any(|line| line.points.iter().any(something));
    worth.then(|| Panel {
        title,
        x: Some(0.0..end),
        y_label: if logarithmic { power } else { short },
        lines,
        ..Panel::default()
    })
}

fn colour(run: usize) -> plotters::style::RGBColor {
    COLOURS[run % COLOURS.len()]
}

/// The number whose decimal logarithm is `exponent`.
fn power(exponent: &f64) -> String {
    format!("{:.0e}", 10f64.powf(*exponent))
}
