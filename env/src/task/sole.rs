//! Where the soles are: the rigid part of gait measures and foot reward.

use nalgebra::{Isometry3, IsometryMatrix3, Vector3};

use super::gait::Sole;
use crate::ground::Ground;
use crate::robot::Foot;

/// A sole in its link's frame.
pub struct SoleShape {
    centre: Vector3<f64>,
    /// The sole's y axis.
    sideways: Vector3<f64>,
    corners: [Vector3<f64>; 4],
}

impl SoleShape {
    /// The sole of `foot`.
    pub fn new(foot: &Foot) -> Self {
        Self {
            centre: foot.sole.translation.vector,
            sideways: foot.sole.rotation * Vector3::y(),
            corners: foot.corners().map(|corner| corner.coords),
        }
    }

    /// The sole when its link is at `link` in the world; heights are above the `ground` under the point.
    pub fn at(&self, link: &IsometryMatrix3<f64>, ground: &Ground) -> Sole {
        let rotation = link.rotation.matrix();
        let height = |v: &Vector3<f64>| rotation[(2, 0)] * v.x + rotation[(2, 1)] * v.y + rotation[(2, 2)] * v.z;
        let centre = rotation * self.centre + link.translation.vector;
        let lowest = if *ground == Ground::Plane {
            self.corners.iter().map(height).fold(f64::INFINITY, f64::min) + link.translation.z
        } else {
            let corners = self
                .corners
                .iter()
                .map(|corner| rotation * corner + link.translation.vector);
            corners
                .map(|corner| corner.z - ground.height(corner.x, corner.y))
                .fold(f64::INFINITY, f64::min)
        };
        Sole {
            centre: [centre.x, centre.y, centre.z - ground.height(centre.x, centre.y)],
            lowest,
            // The tilt of the sole's y axis against the horizontal is its rotation about the forward direction.
            roll: height(&self.sideways).clamp(-1.0, 1.0).asin(),
        }
    }
}

/// A pose with its rotation as a matrix: worth it where several points are to be moved.
pub fn with_matrix(pose: &Isometry3<f64>) -> IsometryMatrix3<f64> {
    IsometryMatrix3::from_parts(pose.translation, pose.rotation.to_rotation_matrix())
}
