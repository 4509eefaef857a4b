//! A moment of a robot as the page takes it: a row of numbers, the same for logs and for what is live.
//!
//! Rows are 32-bit floats, little-endian, in the order of [`fields`].

use nalgebra::Isometry3;
use omniwalk_env::robot::Robot;

use crate::report::motion::{CONTACT_HEIGHT, Frame};

/// Names of the numbers of a row.
pub fn fields(robot: &Robot) -> Vec<String> {
    let base = [
        "time",
        "x",
        "y",
        "z",
        "qx",
        "qy",
        "qz",
        "qw",
        "command_x",
        "command_y",
        "command_turn",
        "velocity_x",
        "velocity_y",
        "velocity_turn",
        "push_x",
        "push_y",
    ];
    let mut names: Vec<String> = base.map(str::to_owned).to_vec();
    for quantity in ["position", "velocity", "effort", "target"] {
        names.extend((0..robot.dofs.len()).map(|d| format!("{quantity}/{}", robot.dof(d).name)));
    }
    names.extend(robot.feet.iter().map(|foot| format!("contact/{}", foot.name)));
    names
}

/// A moment.
pub struct Moment<'a> {
    /// Since the beginning, s.
    pub time: f64,
    /// Pose of the base link in the world.
    pub base: Isometry3<f64>,
    /// Desired velocity, m/s, m/s, rad/s.
    pub command: [f64; 3],
    /// Velocity in the heading frame, m/s, m/s, rad/s.
    pub velocity: [f64; 3],
    /// Horizontal push in the world, N.
    pub push: [f64; 2],
    /// Position, velocity, effort and target of each degree of freedom.
    pub joints: [&'a [f64]; 4],
}

impl Moment<'_> {
    /// Appends the row to `out`; `contacts` says of each foot whether it is on the ground.
    pub fn write(&self, contacts: impl Iterator<Item = bool>, out: &mut Vec<u8>) {
        let (at, q) = (&self.base.translation, &self.base.rotation);
        let pose = [self.time, at.x, at.y, at.z, q.i, q.j, q.k, q.w];
        let rest = self.command.iter().chain(&self.velocity).chain(&self.push);
        let numbers = pose
            .iter()
            .chain(rest)
            .chain(self.joints.into_iter().flatten())
            .copied();
        let contacts = contacts.map(|contact| f64::from(u8::from(contact)));
        for x in numbers.chain(contacts) {
            out.extend_from_slice(&(x as f32).to_le_bytes());
        }
    }
}

/// Appends the row of a log's moment.
pub fn write_frame(frame: &Frame, out: &mut Vec<u8>) {
    let moment = Moment {
        time: frame.time,
        base: frame.base,
        command: frame.command,
        velocity: frame.velocity,
        push: [0.0; 2],
        joints: [&frame.positions, &frame.velocities, &frame.efforts, &frame.targets],
    };
    moment.write(frame.soles.iter().map(|&height| height < CONTACT_HEIGHT), out);
}
