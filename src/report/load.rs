//! `load.png`: what a rollout asks of the joints: torque over speed, with what the servo can do.

use omniwalk_env::robot::{Actuator, Joint, Robot};

use super::ReportError;
use super::canvas::{COLOURS, Canvas, GREY, INK, px, text, write};
use super::motion::Motion;
use super::plot::{Line, Panel};

/// Panels side by side.
const COLUMNS: usize = 3;
/// Size of a panel, pixels.
const PANEL: (u32, u32) = (420, 250);
/// Height of the title, pixels.
const HEAD: u32 = 76;

/// Draws the joints with a motor in `motion`, an episode of `robot`; `None` where the log has no torques.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn draw(motion: &Motion, robot: &Robot) -> Result<Option<Canvas>, ReportError> {
    let panels: Vec<Panel<'_>> = (0..robot.dofs.len())
        .filter_map(|dof| panel(motion, robot.dof(dof), dof))
        .collect();
    if panels.is_empty() {
        return Ok(None);
    }
    let rows = panels.len().div_ceil(COLUMNS);
    let mut canvas = Canvas::new(PANEL.0 * COLUMNS as u32, HEAD + PANEL.1 * rows as u32);
    canvas.draw(|area| {
        let (head, cells) = area.split_vertically(px(HEAD as i32));
        write(
            &head,
            "Torque over speed of the joints",
            &text(24, INK),
            (px(12), px(8)),
        )?;
        let below =
            "N m over rad/s (N over m/s where a joint slides) at each reading, within what the servo has to give";
        write(&head, below, &text(15, GREY), (px(12), px(46)))?;
        let cells = cells.split_evenly((rows, COLUMNS));
        panels.iter().zip(&cells).try_for_each(|(panel, cell)| panel.draw(cell))
    })?;
    Ok(Some(canvas))
}

/// A joint, if it has a motor and the log its torques.
fn panel<'a>(motion: &Motion, joint: &'a Joint, dof: usize) -> Option<Panel<'a>> {
    let actuator = joint.actuator.as_ref()?;
    let readings = motion
        .frames
        .iter()
        .map(|frame| (frame.velocities[dof], frame.efforts[dof]));
    let readings: Vec<_> = readings
        .filter(|(v, torque)| v.is_finite() && torque.is_finite())
        .collect();
    let fastest = readings.iter().map(|(v, _)| v.abs()).reduce(f64::max)?;
    let line = |name: &str, colour, width, points| Line {
        name: name.to_owned(),
        colour,
        width,
        points,
    };
    let mut lines = vec![
        line("measured", COLOURS[0], 1, readings),
        line("limit", COLOURS[1], 4, limit(actuator, fastest)),
    ];
    let below = limit(actuator, fastest).into_iter().map(|(v, torque)| (-v, -torque));
    lines.push(line("", COLOURS[1], 4, below.collect()));
    Some(Panel {
        title: &joint.name,
        lines,
        ..Panel::default()
    })
}

/// The most a servo has upward: all of it against the motion, less along it, down to none at its highest speed.
fn limit(actuator: &Actuator, fastest: f64) -> Vec<(f64, f64)> {
    let (torque, speed) = (actuator.torque_limit, actuator.speed_limit);
    vec![(-fastest.max(speed), torque), (0.0, torque), (speed, 0.0)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_falls_to_none_at_the_highest_speed_along_the_motion_only() {
        let actuator = Actuator {
            kp: 1.0,
            kp_scale: 1.0,
            kd: 0.0,
            torque_limit: 8.0,
            speed_limit: 4.0,
        };
        assert_eq!(limit(&actuator, 6.0), [(-6.0, 8.0), (0.0, 8.0), (4.0, 0.0)]);
        assert_eq!(limit(&actuator, 1.0)[0], (-4.0, 8.0));
    }
}
