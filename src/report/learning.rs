//! `learning.png`: what changed while runs learned, one colour a run.

use super::ReportError;
use super::canvas::{COLOURS, Canvas, GREY, INK, px, text, write};
use super::curves::Curves;
use super::plot::{Line, Panel, tick};

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
        let below = format!("against control steps of all environments; {}", points(runs));
        write(area, &below, &text(15, GREY), (px(12), px(46)))?;
        let (_, below) = area.split_vertically(px(HEAD as i32));
        let cells = below.split_evenly((rows as usize, COLUMNS));
        panels.iter().zip(&cells).try_for_each(|(panel, cell)| panel.draw(cell))
    })?;
    Ok(canvas)
}

/// What a point is.
fn points(runs: &[Curves]) -> String {
    let most = |count: fn(&Curves) -> usize| runs.iter().map(count).max().unwrap_or(1);
    let point = match most(Curves::updates_per_point) {
        1 => "a point is an update".to_owned(),
        updates => format!("a point is the mean of {updates} updates"),
    };
    match most(Curves::apart) {
        1 => point,
        apart => format!("{point}, and of {apart} updates one was kept in metrics.csv"),
    }
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
    // What ended episodes, and what did not.
    let ends = ["episode/fallen", "episode/leg_overlap"];
    let worth = if ends.contains(&column) {
        runs.iter()
            .any(|run| ends.iter().any(|end| is_something(&run.column(end))))
    } else {
        lines.iter().any(|line| is_something(&line.points))
    };
    worth.then(|| Panel {
        title,
        x: Some(0.0..end),
        y_label: if logarithmic { power } else { tick },
        lines,
        ..Panel::default()
    })
}

fn colour(run: usize) -> plotters::style::RGBColor {
    COLOURS[run % COLOURS.len()]
}

fn is_something(points: &[(f64, f64)]) -> bool {
    points.iter().any(|&(_, y)| y.is_finite() && y != 0.0)
}

/// The number whose decimal logarithm is `exponent`, so that it is another one `step` further.
fn power(exponent: f64, step: f64) -> String {
    let digits = if step < 0.25 { 2 } else { usize::from(step < 0.9) };
    format!("{:.digits$e}", 10f64.powf(exponent))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::run::metrics::MetricsWriter;

    fn curves(columns: &[&str], row: impl Fn(u64) -> Vec<f64>) -> Curves {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.csv");
        let mut writer = MetricsWriter::create(&path, columns).unwrap();
        for i in 1..=400 {
            writer.append(i, &row(i)).unwrap();
        }
        Curves::read(&path, String::new()).unwrap()
    }

    #[test]
    fn what_a_point_is_is_said_as_it_is() {
        let every = |apart: f64| curves(&["update"], |i| vec![apart * i as f64]);
        assert_eq!(points(&[every(1.0)]), "a point is the mean of 2 updates");
        assert_eq!(
            points(&[every(1.0), every(40.0)]),
            "a point is the mean of 2 updates, and of 40 updates one was kept in metrics.csv"
        );
    }

    #[test]
    fn what_never_ended_an_episode_is_shown_beside_what_did() {
        let columns = ["episode/fallen", "episode/leg_overlap", "reward/slip"];
        let titles = |overlap: f64| -> Vec<&str> {
            let runs = [curves(&columns, |_| vec![0.0, overlap, 0.0])];
            let panels = PANELS.iter().filter_map(|entry| panel(entry, &runs, 400.0));
            panels.map(|panel| panel.title).collect()
        };
        assert_eq!(
            titles(1.0),
            ["share of episodes that fell", "share ended by leg overlap"]
        );
        assert!(titles(0.0).is_empty());
    }

    #[test]
    fn powers_of_ten_differ_from_tick_to_tick() {
        assert_eq!(power(-4.0, 1.0), "1e-4");
        assert_eq!((power(-4.0, 0.5), power(-3.5, 0.5)), ("1.0e-4".into(), "3.2e-4".into()));
        assert_ne!(power(-4.0, 0.02), power(-3.98, 0.02));
    }
}
