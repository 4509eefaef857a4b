//! `gait.png`: how a rollout walks: contacts, sole heights, velocities, the joints of a leg and their phase plot.

use omniwalk_env::robot::Robot;
use plotters::style::RGBColor;

use super::ReportError;
use super::canvas::{Area, COLOURS, Canvas, GREY, INK, PALE, px, text, write};
use super::motion::{CONTACT_HEIGHT, Frame, Motion, leg, pitch};
use super::plot::{Line, Panel, running_mean};

/// Size of the picture, pixels.
const SIZE: (u32, u32) = (1260, 1010);
/// Heights of title, contacts, soles and velocities, pixels; the leg has the rest.
const ROWS: [i32; 4] = [76, 120, 230, 250];
/// Steps and joints are shown for this long, so that single steps can be seen, s.
const WINDOW: f64 = 5.0;

/// Draws the gait of `motion`, an episode of `robot`.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn draw(motion: &Motion, robot: &Robot) -> Result<Canvas, ReportError> {
    let start = ((motion.seconds() - WINDOW) / 2.0).max(0.0);
    let view = View {
        motion,
        robot,
        start,
        end: (start + WINDOW).min(motion.seconds()),
    };
    let mut canvas = Canvas::new(SIZE.0, SIZE.1);
    canvas.draw(|area| {
        let (head, rest) = area.split_vertically(px(ROWS[0]));
        let (contacts, rest) = rest.split_vertically(px(ROWS[1]));
        let (soles, rest) = rest.split_vertically(px(ROWS[2]));
        let (velocities, joints) = rest.split_vertically(px(ROWS[3]));
        view.head(&head)?;
        view.contacts().draw(&contacts)?;
        view.name_rows(&contacts)?;
        view.soles().draw(&soles)?;
        for (axis, cell) in velocities.split_evenly((1, 3)).iter().enumerate() {
            view.velocity(axis).draw(cell)?;
        }
        let (joints, phase) = joints.split_horizontally(px(SIZE.0 as i32 * 2 / 3));
        let chain = leg(robot);
        let title = match robot.feet.first().map(|foot| foot.name.as_str()) {
            Some(side @ ("left" | "right")) => format!("{side} leg, rad"),
            _ => "leg, rad".to_owned(),
        };
        view.joints(&title, &chain).draw(&joints)?;
        match pitch(robot, &chain)[..] {
            [hip, knee, ..] => view.phase(hip, knee).draw(&phase),
            _ => Ok(()),
        }
    })?;
    Ok(canvas)
}

struct View<'a> {
    motion: &'a Motion,
    robot: &'a Robot,
    start: f64,
    end: f64,
}

impl View<'_> {
    fn head(&self, area: &Area<'_>) -> Result<(), ReportError> {
        let [x, y, turn] = self.motion.at(self.motion.seconds() / 2.0).command;
        let title = format!("Gait at the command ({x:.2} m/s, {y:.2} m/s, {turn:.2} rad/s)");
        write(area, &title, &text(24, INK), (px(12), px(8)))?;
        let mm = 1000.0 * CONTACT_HEIGHT;
        let below = format!(
            "forward kinematics of the measured joint positions; in contact: a sole's lowest corner is below {mm:.0} mm"
        );
        write(area, &below, &text(15, GREY), (px(12), px(46))).map(drop)
    }

    /// A strip a foot, the first one above.
    fn contacts(&self) -> Panel<'static> {
        let feet = self.robot.feet.len();
        let mut panel = self.in_window("contact with the ground");
        for foot in 0..feet {
            let low = (feet - 1 - foot) as f64;
            let stances = self.motion.stances(foot).into_iter();
            let seen = stances.filter(|&(from, to)| to > self.start && from < self.end);
            panel.blocks.extend(seen.map(|(from, to)| {
                let corners = [(from.max(self.start), low + 0.15), (to.min(self.end), low + 0.85)];
                (corners, COLOURS[foot % COLOURS.len()])
            }));
        }
        panel.y = Some(0.0..feet as f64);
        panel.y_label = |_, _| String::new();
        panel
    }

    /// The name of each foot to the left of its strip.
    fn name_rows(&self, area: &Area<'_>) -> Result<(), ReportError> {
        let feet = &self.robot.feet;
        // Between the title and the labels of the panel.
        let height = (ROWS[1] - 52) / feet.len().max(1) as i32;
        (0..).zip(feet).try_for_each(|(row, foot)| {
            let top = 26 + row * height + height / 2 - 5;
            let colour = COLOURS[row as usize % COLOURS.len()];
            write(area, &of_foot(&foot.name), &text(12, colour), (px(4), px(top))).map(drop)
        })
    }

    fn soles(&self) -> Panel<'static> {
        let mut panel = self.in_window("height of the lowest sole corner, mm");
        panel.below = "time, s";
        for (foot, about) in self.robot.feet.iter().enumerate() {
            let points = self.points(|frame| 1000.0 * frame.soles[foot]);
            panel.lines.push(line(&of_foot(&about.name), foot, points));
        }
        let threshold = 1000.0 * CONTACT_HEIGHT;
        panel.lines.push(Line {
            name: "in contact below".to_owned(),
            colour: GREY,
            width: 2,
            points: vec![(self.start, threshold), (self.end, threshold)],
        });
        panel
    }

    /// Command and measurement over the whole episode, as it is and as a mean over a gait cycle.
    fn velocity(&self, axis: usize) -> Panel<'static> {
        let frames = &self.motion.frames;
        let all = |value: fn(&Frame) -> [f64; 3]| frames.iter().map(|f| (f.time, value(f)[axis])).collect::<Vec<_>>();
        let raw = all(|frame| frame.velocity);
        let cycle = self.motion.cycle(self.robot);
        let (from, to) = cycle.unwrap_or_else(|| self.motion.second());
        let mean = ["mean of a second", "mean of a cycle"][usize::from(cycle.is_some())];
        let mut measured = coloured("measured", PALE, raw.clone());
        measured.width = 2;
        Panel {
            title: ["forward, m/s", "to the left, m/s", "turning, rad/s"][axis],
            below: "time, s",
            x: Some(0.0..self.motion.seconds()),
            lines: vec![
                measured,
                line(mean, 0, running_mean(&raw, to - from)),
                coloured("command", INK, all(|frame| frame.command)),
            ],
            ..Panel::default()
        }
    }

    fn joints<'t>(&self, title: &'t str, leg: &[usize]) -> Panel<'t> {
        let mut panel = self.in_window(title);
        panel.below = "time, s";
        for (i, &dof) in leg.iter().enumerate() {
            let points = self.points(|frame| frame.positions[dof]);
            panel.lines.push(line(&self.name(dof), i, points));
        }
        panel
    }

    /// The whole episode in the plane of two joints.
    fn phase(&self, hip: usize, knee: usize) -> Panel<'static> {
        let point = |frame: &Frame| (frame.positions[hip], frame.positions[knee]);
        let points: Vec<_> = self.motion.frames.iter().map(point).collect();
        let range = |axis: fn(&(f64, f64)) -> f64| {
            let (low, high) = points
                .iter()
                .map(axis)
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| {
                    (low.min(x), high.max(x))
                });
            low - 0.05..high + 0.05
        };
        let (x, y) = (range(|(x, _)| *x), range(|(_, y)| *y));
        let mut path = coloured("", COLOURS[0], points);
        path.width = 1;
        Panel {
            title: "knee over hip pitch, rad",
            below: "hip pitch, rad",
            x: Some(x),
            y: Some(y),
            lines: vec![path],
            ..Panel::default()
        }
    }

    fn in_window<'t>(&self, title: &'t str) -> Panel<'t> {
        Panel {
            title,
            x: Some(self.start..self.end),
            ..Panel::default()
        }
    }

    /// A quantity in the window.
    fn points(&self, value: impl Fn(&Frame) -> f64) -> Vec<(f64, f64)> {
        let seen = |frame: &&Frame| (self.start..=self.end).contains(&frame.time);
        let frames = self.motion.frames.iter().filter(seen);
        frames.map(|frame| (frame.time, value(frame))).collect()
    }

    /// Name of a joint without the side of the foot it belongs to.
    fn name(&self, dof: usize) -> String {
        let name = &self.robot.dof(dof).name;
        let side = self.robot.feet.first().map_or("", |foot| &foot.name);
        let rest = name.strip_prefix(side).unwrap_or(name);
        rest.trim_start_matches('_').replace('_', " ")
    }
}

/// What a foot is called in the picture: those of two legs are `left` and `right` alone.
fn of_foot(name: &str) -> String {
    match name {
        "left" | "right" => format!("{name} foot"),
        _ => name.to_owned(),
    }
}

fn line(name: &str, index: usize, points: Vec<(f64, f64)>) -> Line {
    coloured(name, COLOURS[index % COLOURS.len()], points)
}

fn coloured(name: &str, colour: RGBColor, points: Vec<(f64, f64)>) -> Line {
    Line {
        name: name.to_owned(),
        colour,
        width: 4,
        points,
    }
}
