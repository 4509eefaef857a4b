//! `filmstrip.png`: the robot in even moments of a gait cycle, or of a second where there is none, a row a rollout (thesis, figure 7.7), its collision
//! shapes ray-cast in parallel projection.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use omniwalk_env::robot::{Geometry, Kinematics, Robot};
use plotters::style::RGBColor;
use rayon::prelude::*;

use super::ReportError;
use super::canvas::{COLOURS, Canvas, GREY, INK, OVERSAMPLING, px, text, write};
use super::motion::{Frame, Motion, heading};
use super::ray::{Hit, Ray};

/// Moments that are shown.
const FRAMES: usize = 10;
/// Size of a frame and height of the title, pixels.
const CELL: (u32, u32) = (126, 310);
const HEAD: u32 = 72;
/// Height of the lines above and below the frames of a rollout, pixels.
const LABEL: u32 = 28;
const FOOT: u32 = 30;
/// The camera looks from the right of where the robot goes, from this far ahead and above, rad.
const AZIMUTH: f64 = 0.35;
const ELEVATION: f64 = 0.2;
/// Half width of the strip of ground that is drawn, and the distance of its marks, m.
const GROUND: f64 = 0.3;
const MARK: f64 = 0.1;
/// Radius of the bones between joints, m.
const BONE: f64 = 0.022;
const BONE_COLOUR: RGBColor = RGBColor(92, 99, 110);
const TRUNK_COLOUR: RGBColor = RGBColor(190, 196, 204);

/// Most rollouts that are shown, one below the other.
pub const ROWS: usize = 6;

/// Draws a gait cycle of each of the first [`ROWS`] of `motions`, episodes of `robot`, or a second of those that have none.
///
/// # Errors
/// [`ReportError::Draw`].
pub fn draw(motions: &[Motion], robot: &Robot) -> Result<Canvas, ReportError> {
    let rows: Vec<Row> = motions
        .iter()
        .take(ROWS)
        .map(|motion| Row::new(motion, robot))
        .collect();
    let height = HEAD + rows.len() as u32 * (LABEL + CELL.1 + FOOT);
    let mut canvas = Canvas::new(CELL.0 * FRAMES as u32, height);
    let columns = canvas.columns();
    let cell = (CELL.0 * OVERSAMPLING) as usize;
    for (r, row) in rows.iter().enumerate() {
        let top = ((row_top(r) + LABEL) * OVERSAMPLING) as usize;
        let lines = (CELL.1 * OVERSAMPLING) as usize;
        let body = &mut canvas.samples()[3 * columns * top..3 * columns * (top + lines)];
        body.par_chunks_exact_mut(3 * columns)
            .enumerate()
            .for_each(|(y, line)| {
                for (x, sample) in line.chunks_exact_mut(3).enumerate() {
                    let colour = row.scenes[x / cell].colour((x % cell) as f64 + 0.5, y as f64 + 0.5);
                    sample.copy_from_slice(&colour);
                }
            });
    }
    canvas.draw(|area| {
        let title = format!("How {} walks", robot.name);
        write(area, &title, &text(24, INK), (px(12), px(8)))?;
        let below =
            "even moments of a gait cycle; marks on the ground every 10 cm; below each moment time and metres walked";
        write(area, below, &text(15, GREY), (px(12), px(42)))?;
        for (r, row) in rows.iter().enumerate() {
            let top = row_top(r);
            write(area, &row.label, &text(17, INK), (px(12), px(top as i32 + 4)))?;
            for (i, (scene, time)) in row.scenes.iter().zip(&row.times).enumerate() {
                let x = px(i as i32 * CELL.0 as i32);
                let label = format!("{time:.2} s  {:.2} m", scene.walked);
                write(
                    area,
                    &label,
                    &text(15, INK),
                    (x + px(8), px((top + LABEL + CELL.1 + 4) as i32)),
                )?;
            }
        }
        Ok(())
    })?;
    Ok(canvas)
}

/// Where row `r` begins, pixels.
fn row_top(r: usize) -> u32 {
    HEAD + r as u32 * (LABEL + CELL.1 + FOOT)
}

/// A rollout's moments.
struct Row {
    label: String,
    scenes: Vec<Scene>,
    /// Since the first of them, s.
    times: Vec<f64>,
}

impl Row {
    fn new(motion: &Motion, robot: &Robot) -> Self {
        let cycle = motion.cycle(robot);
        let (from, to) = cycle.unwrap_or_else(|| motion.second());
        let moments: Vec<&Frame> = (0..FRAMES)
            .map(|i| motion.at(from + (to - from) * i as f64 / (FRAMES - 1) as f64))
            .collect();
        let [x, y, turn] = moments[0].command;
        let ahead = heading(&moments[0].base);
        // What goes sideways is seen from the front.
        let sideways = y.abs() > x.abs();
        let forward = if sideways { Vector3::z().cross(&ahead) } else { ahead };
        let origin = motion.frames[0].base.translation.vector;
        // With room for both arms, or for the feet ahead of the base.
        let height = robot.base_pose.translation.z + if sideways { 1.25 } else { 0.85 };
        let shift = if sideways { 0.0 } else { 0.085 };
        let what = if cycle.is_some() { "a cycle" } else { "no gait cycle" };
        Self {
            label: format!("({x:.2} m/s, {y:.2} m/s, {turn:.2} rad/s): {what}, {:.2} s", to - from),
            times: moments.iter().map(|moment| moment.time - from).collect(),
            scenes: moments
                .into_iter()
                .map(|moment| Scene::new(robot, moment, forward, origin, (height, shift)))
                .collect(),
        }
    }
}

/// A shape in the world.
struct Solid {
    inverse: Isometry3<f64>,
    geometry: Geometry,
    colour: RGBColor,
}

/// A moment, seen by a camera that walks along.
struct Scene {
    solids: Vec<Solid>,
    /// Where the top left sample's ray begins, the steps to the next sample right and below, and where rays go.
    corner: Point3<f64>,
    right: Vector3<f64>,
    down: Vector3<f64>,
    view: Vector3<f64>,
    light: Vector3<f64>,
    forward: Vector3<f64>,
    origin: Vector3<f64>,
    /// The camera's distance along `forward` from where the episode began, m.
    walked: f64,
    /// Distance of the camera's path across from the origin, m.
    across: f64,
}

impl Scene {
    /// The frame is `height` high and its middle `shift` ahead of the base, m.
    fn new(
        robot: &Robot,
        frame: &Frame,
        forward: Vector3<f64>,
        origin: Vector3<f64>,
        (height, shift): (f64, f64),
    ) -> Self {
        let left = Vector3::z().cross(&forward);
        let toward =
            (forward * AZIMUTH.sin() - left * AZIMUTH.cos()) * ELEVATION.cos() + Vector3::z() * ELEVATION.sin();
        let right = Vector3::z().cross(&toward).normalize();
        let up = toward.cross(&right);
        let sample = height / f64::from(CELL.1 * OVERSAMPLING);
        let base = frame.base.translation.vector;
        let middle = Point3::new(base.x, base.y, 0.0) + forward * shift + Vector3::z() * (height / 2.0 - 0.14);
        let (w, h) = (f64::from(CELL.0 * OVERSAMPLING), f64::from(CELL.1 * OVERSAMPLING));
        Self {
            solids: solids(robot, frame),
            corner: middle + toward * 5.0 - right * (sample * w / 2.0) + up * (sample * h / 2.0),
            right: right * sample,
            down: -up * sample,
            view: -toward,
            light: (toward + up * 1.2 - right * 0.5).normalize(),
            forward,
            origin,
            walked: (base - origin).dot(&forward),
            across: (base - origin).dot(&left),
        }
    }

    /// What is seen at a sample of the frame.
    fn colour(&self, x: f64, y: f64) -> [u8; 3] {
        let ray = Ray {
            origin: self.corner + self.right * x + self.down * y,
            direction: self.view,
        };
        match self.first(&ray) {
            Some((hit, solid)) => {
                let edge = if hit.edge < 0.004 { 0.6 } else { 1.0 };
                let bright = 0.5 + 0.55 * hit.normal.dot(&self.light).max(0.0);
                shade(solid.colour, edge * bright)
            }
            None => self.ground(&ray),
        }
    }

    fn first(&self, ray: &Ray) -> Option<(Hit, &Solid)> {
        let hits = self.solids.iter().filter_map(|solid| {
            let hit = ray.seen_from(&solid.inverse).enters(&solid.geometry)?;
            let normal = solid.inverse.inverse_transform_vector(&hit.normal);
            Some((Hit { normal, ..hit }, solid))
        });
        hits.min_by(|a, b| a.0.distance.total_cmp(&b.0.distance))
    }

    /// A strip along the way with marks, and the robot's shadow on it.
    fn ground(&self, ray: &Ray) -> [u8; 3] {
        let point = ray.origin + ray.direction * (ray.origin.z / -ray.direction.z);
        let offset = point.coords - self.origin;
        let along = offset.dot(&self.forward);
        let across = offset.dot(&Vector3::z().cross(&self.forward)) - self.across;
        if across.abs() > GROUND {
            return [255; 3];
        }
        let nearest = (along / MARK).round();
        let half_width = if nearest.rem_euclid(5.0) == 0.0 { 0.009 } else { 0.003 };
        let paint = if (along - nearest * MARK).abs() < half_width {
            RGBColor(150, 157, 168)
        } else {
            RGBColor(234, 236, 240)
        };
        let sun = Ray {
            origin: point,
            direction: (self.light + Vector3::z() * 1.5).normalize(),
        };
        shade(paint, if self.first(&sun).is_some() { 0.82 } else { 1.0 })
    }
}

/// The robot's shapes, those of each leg in the colour of its foot, and bones from link to link.
fn solids(robot: &Robot, frame: &Frame) -> Vec<Solid> {
    let mut kinematics = Kinematics::new(robot);
    kinematics.set_pose(robot, &frame.base, &frame.positions);
    let colours = colours(robot);
    let mut solids = Vec::new();
    for (index, link) in robot.links.iter().enumerate() {
        let pose = kinematics.pose(index);
        solids.extend(link.shapes.iter().map(|shape| Solid {
            inverse: (pose * shape.pose).inverse(),
            geometry: shape.geometry,
            colour: colours[index],
        }));
        if let Some(parent) = link.parent {
            let ends = [kinematics.pose(parent), pose].map(|end| end.translation.vector);
            solids.push(bone(ends[0], ends[1]));
        }
    }
    solids
}

fn bone(from: Vector3<f64>, to: Vector3<f64>) -> Solid {
    let along = to - from;
    let turn = UnitQuaternion::rotation_between(&Vector3::z(), &along);
    // Straight down, or no length at all: z is its axis as well.
    let turn = turn.unwrap_or_else(UnitQuaternion::identity);
    Solid {
        inverse: Isometry3::from_parts(Translation3::from((from + to) / 2.0), turn).inverse(),
        geometry: Geometry::Capsule(BONE, along.norm() / 2.0),
        colour: BONE_COLOUR,
    }
}

fn colours(robot: &Robot) -> Vec<RGBColor> {
    let mut colours = vec![TRUNK_COLOUR; robot.links.len()];
    for (foot, about) in robot.feet.iter().enumerate() {
        let mut link = about.link;
        while link > 0 {
            colours[link] = COLOURS[foot % COLOURS.len()];
            link = robot.joints[link - 1].parent;
        }
    }
    colours
}

fn shade(RGBColor(r, g, b): RGBColor, brightness: f64) -> [u8; 3] {
    [r, g, b].map(|channel| (f64::from(channel) * brightness).round().min(255.0) as u8)
}
