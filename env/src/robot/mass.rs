//! Mass properties: moving them between frames, adding them, and whether they are those of a real body.

use nalgebra::{Isometry3, Matrix3, Vector3};

use super::Inertial;

/// By how much (relative to the largest principal moment) a published inertia may break the triangle inequality
/// before it is taken for an error rather than for rounding.
const TRIANGLE_TOLERANCE: f64 = 0.1;

/// Smallest mass of a link that has one, kg: a microgram, less than the smallest screw. Frames without mass say 0 or nothing.
const SMALLEST_MASS: f64 = 1e-9;

/// What is wrong with an inertia.
pub(super) enum Flaw {
    /// No body has it.
    Impossible(String),
    /// Slightly impossible, as many published ones are.
    Slight(String),
}

impl Inertial {
    /// No mass at all.
    pub const MASSLESS: Self = Self {
        mass: 0.0,
        com: Vector3::new(0.0, 0.0, 0.0),
        inertia: Matrix3::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    };

    /// The same body in the frame in which the body's frame has the pose `pose`.
    pub fn transformed(&self, pose: &Isometry3<f64>) -> Self {
        let rotation = pose.rotation.to_rotation_matrix();
        Self {
            mass: self.mass,
            com: pose.translation.vector + rotation * self.com,
            inertia: rotation.matrix() * self.inertia * rotation.matrix().transpose(),
        }
    }

    /// Both bodies welded together, given in the same frame (parallel axis theorem).
    pub fn combined(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass == 0.0 {
            return Self::MASSLESS;
        }
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        Self {
            mass,
            com,
            inertia: self.inertia_about(&com) + other.inertia_about(&com),
        }
    }

    /// Inertia about `point` of the body's frame, kg m^2.
    pub fn inertia_about(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        let r = self.com - point;
        self.inertia + self.mass * (r.norm_squared() * Matrix3::identity() - r * r.transpose())
    }

    /// Checks mass and inertia of a published link; a point mass (no inertia) passes.
    pub(super) fn flaw(&self) -> Option<Flaw> {
        let moments = self.inertia.symmetric_eigenvalues();
        let (smallest, largest) = (moments.min(), moments.amax());
        if self.mass < 0.0 {
            return Some(Flaw::Impossible(format!("a negative mass of {} kg", self.mass)));
        }
        if self.mass > 0.0 && self.mass < SMALLEST_MASS {
            let mass = self.mass;
            return Some(Flaw::Impossible(format!(
                "a mass of {mass:e} kg, which is neither a body's nor 0"
            )));
        }
        if self.mass == 0.0 && largest > 0.0 {
            return Some(Flaw::Impossible("an inertia but no mass".into()));
        }
        if largest == 0.0 {
            return None;
        }
        let list = format!(
            "principal moments {:.3e}, {:.3e}, {:.3e} kg m^2",
            moments[0], moments[1], moments[2]
        );
        if smallest <= 0.0 {
            return Some(Flaw::Impossible(format!(
                "an inertia that is not positive definite ({list})"
            )));
        }
        // No principal moment of a body exceeds the sum of the others.
        let excess = (2.0 * largest - moments.sum()) / largest;
        let text = format!("an inertia that breaks the triangle inequality ({list})");
        match excess {
            x if x > TRIANGLE_TOLERANCE => Some(Flaw::Impossible(text)),
            x if x > 1e-6 => Some(Flaw::Slight(text)),
            _ => None,
        }
    }
}
