//! What a suite draws of its own: velocities over time (figure 7.9). All else is drawn from `eval.json`, see [`crate::report::evaluation`].

use super::tour::Moment;
use super::tracking::Tracked;
use crate::report::ReportError;
use crate::report::canvas::{COLOURS, Canvas, INK, PALE};
use crate::report::commands::AXES;
use crate::report::plot::{Line, Panel, framed, running_mean};

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
                Line::new("measured", PALE, 1, raw),
                Line::new("mean of a second", COLOURS[0], 4, mean),
                Line::new("desired", INK, 4, over_time(|moment| moment.desired)),
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
