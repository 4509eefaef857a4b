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

/// Columns of the metrics, their title, and whether the axis counts powers of ten.
const PANELS: [(&[&str], &str, bool); 29] = [
    (&["reward/total"], "reward a second, all terms", false),
    (&["reward/velocity"], "reward a second for velocity", false),
    (&["reward/foot"], "reward a second for feet", false),
    (&["reward/pose"], "reward a second for pose", false),
    (&["reward/alive"], "reward a second for being alive", false),
    (&["reward/action_rate"], "reward a second for calm actions", false),
    (&["reward/slip"], "reward a second for slip", false),
    (&["episode/steps"], "episode length, control steps", false),
    (&["episode/fallen"], "share of episodes ended by a fall", false),
    (&["episode/leg_overlap"], "share ended by crossed legs", false),
    (&["tracking/error_xy_mps"], "velocity error, m/s", false),
    (&["tracking/error_yaw_radps"], "turning error, rad/s", false),
    (&["gait/touchdowns_per_second"], "touchdowns a second", false),
    (&["gait/alternation"], "touchdowns that alternate, share", false),
    (&["gait/air_time_s"], "air time of a swing, s", false),
    (&["gait/clearance_m"], "clearance, m", false),
    (&["gait/slip_mps"], "slip of loaded soles, m/s", false),
    (&["curriculum/level"], "curriculum level", false),
    (
        &["curriculum/lower_x", "curriculum/upper_x"],
        "commands forward, from and to, m/s",
        false,
    ),
    (
        &["curriculum/lower_y", "curriculum/upper_y"],
        "commands to the left, from and to, m/s",
        false,
    ),
    (
        &["curriculum/lower_yaw", "curriculum/upper_yaw"],
        "commands to turn left, from and to, rad/s",
        false,
    ),
    (&["curriculum/velocity_factor"], "curriculum factor C_v", false),
    (&["curriculum/foot_factor"], "curriculum factor C_foot", false),
    (&["ppo/kl"], "KL divergence of an update, nats", false),
    (&["ppo/entropy"], "entropy of the actions, nats", false),
    (
        &["ppo/mode_distance"],
        "mode from mean, share of an action's range",
        false,
    ),
    (&["ppo/value_loss"], "loss of the critic", false),
    (&["ppo/explained_variance"], "returns the critic explains, share", false),
    (&["ppo/learning_rate"], "learning rate", true),
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

fn panel<'a>(
    &(columns, title, logarithmic): &(&[&str], &'a str, bool),
    runs: &[Curves],
    end: f64,
) -> Option<Panel<'a>> {
    let line = |i: usize, column: &str| {
        let mut points = runs[i].column(column);
        if logarithmic {
            points.iter_mut().for_each(|(_, y)| *y = y.log10());
        }
        Line::new("", colour(i), 3, points)
    };
    let of_run = |i| columns.iter().map(move |column| line(i, column));
    let lines: Vec<Line> = (0..runs.len()).flat_map(of_run).collect();
    // What ended episodes, and what did not.
    let ends = ["episode/fallen", "episode/leg_overlap"];
    let worth = if ends.contains(&columns[0]) {
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
            ["share of episodes ended by a fall", "share ended by crossed legs"]
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
