//! Where the base of a robot that walks freely was, as far as its log tells.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use omniwalk_env::engine::Start;
use omniwalk_env::robot::{Kinematics, Robot};

use crate::recording::{Recording, Samples};

/// Corners of soles that are hardly higher than this above the lowest stand on the ground, m.
const STANDING: f64 = 2e-3;

/// The base at an instant. Where it is and how it moves along is not measured: the lowest corners of the soles rest on the ground.
#[derive(Clone, Copy, Debug)]
pub struct MeasuredBase {
    /// Orientation in the world; the angle about the vertical means nothing.
    pub orientation: UnitQuaternion<f64>,
    /// Angular velocity in the world, rad/s.
    pub angular_velocity: Vector3<f64>,
}

impl MeasuredBase {
    /// The base at `time` (s) of `recording`, by its inertial measurement unit, or by odometry where that has no orientation;
    /// `None` where neither has, or not then.
    pub fn at(recording: &Recording, time: f64) -> Option<Self> {
        let unit = recording.imu.as_ref().and_then(|imu| {
            let orientation = between(&imu.orientation, time, |a, b, s| a.slerp(b, s))?;
            Some((orientation, linear(&imu.angular_velocity, time)?))
        });
        let (orientation, turning) = unit.or_else(|| {
            let odometry = recording.odometry.as_ref()?;
            let pose = between(&odometry.pose, time, |a, b, s| a.lerp_slerp(b, s))?;
            Some((pose.rotation, linear(&odometry.angular_velocity, time)?))
        })?;
        Some(Self {
            orientation,
            angular_velocity: orientation * turning,
        })
    }

    /// First and last time at which [`MeasuredBase::at`] knows it, s.
    pub fn known(recording: &Recording) -> Option<(f64, f64)> {
        let span = |times: &[f64]| Some((*times.first()?, *times.last()?));
        let imu = recording.imu.as_ref().and_then(|imu| {
            let (a, b) = (span(&imu.orientation.time)?, span(&imu.angular_velocity.time)?);
            Some((a.0.max(b.0), a.1.min(b.1)))
        });
        imu.or_else(|| {
            let odometry = recording.odometry.as_ref()?;
            let (a, b) = (span(&odometry.pose.time)?, span(&odometry.angular_velocity.time)?);
            Some((a.0.max(b.0), a.1.min(b.1)))
        })
    }

    /// Puts the base of `start`, whose joints are set, where the lowest corners of the soles touch the ground and rest on it.
    pub fn place(&self, robot: &Robot, start: &mut Start) {
        let mut kinematics = Kinematics::new(robot);
        let upright = Isometry3::from_parts(Vector3::zeros().into(), self.orientation);
        kinematics.set_pose(robot, &upright, &start.joints);
        kinematics.set_velocity(
            robot,
            &Vector3::zeros(),
            &self.angular_velocity,
            &start.joint_velocities,
        );
        let corner = |link: usize, corner: Point3<f64>| {
            let at = kinematics.pose(link) * corner;
            (at.z, kinematics.velocity_at(link, &at))
        };
        let corners: Vec<(f64, Vector3<f64>)> = robot
            .feet
            .iter()
            .flat_map(|foot| foot.corners().map(|own| corner(foot.link, own)))
            .collect();
        let lowest = corners.iter().map(|(z, _)| *z).fold(f64::INFINITY, f64::min);
        // Without a bound that a corner passes at once, the state is a smooth function of what was measured.
        let (mut moving, mut standing) = (Vector3::zeros(), 0.0);
        for (z, velocity) in &corners {
            let share = 1.0 / (1.0 + ((z - lowest) / STANDING).powi(4));
            moving += share * velocity;
            standing += share;
        }
        start.position = Vector3::new(0.0, 0.0, -lowest);
        start.orientation = self.orientation;
        start.angular_velocity = self.angular_velocity;
        start.linear_velocity = -moving / standing;
    }
}

fn linear(samples: &Samples<Vector3<f64>>, time: f64) -> Option<Vector3<f64>> {
    between(samples, time, |a, b, s| a.lerp(b, s))
}

/// The samples about `time`, mixed; `None` outside of them.
fn between<T: Copy>(samples: &Samples<T>, time: f64, mix: impl Fn(&T, &T, f64) -> T) -> Option<T> {
    let next = samples.time.partition_point(|&t| t < time);
    let (b, at) = (samples.value.get(next)?, samples.time[next]);
    if at == time {
        return Some(*b);
    }
    let before = next.checked_sub(1)?;
    let share = (time - samples.time[before]) / (at - samples.time[before]);
    Some(mix(&samples.value[before], b, share))
}
