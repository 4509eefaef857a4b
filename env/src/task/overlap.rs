//! Legs that pass through each other: engines collide links with the ground only, so the distance of soles and
//! shanks is checked here, once a control step, for every engine alike.

use nalgebra::{IsometryMatrix3, UnitQuaternion, Vector3};
use rapier3d_f64::parry::math::{Pose, Rotation, Vector};
use rapier3d_f64::parry::query;
use rapier3d_f64::parry::shape::SharedShape;

use super::sole::with_matrix;
use crate::robot::{Geometry, Robot, Shape};

/// The pairs of shapes of one robot that must not overlap.
pub struct Overlap {
    pairs: Vec<[Part; 2]>,
}

/// A shape on a link.
struct Part {
    link: usize,
    pose: IsometryMatrix3<f64>,
    geometry: Geometry,
    shape: SharedShape,
    /// Bounding radius, m.
    radius: f64,
}

impl Overlap {
    /// Every pair of shapes of the robot's overlap pairs, which count as overlapping from `margin` m apart.
    pub fn new(robot: &Robot, margin: f64) -> Self {
        let mut pairs = Vec::new();
        for &(a, b) in &robot.overlap_pairs {
            for left in &robot.links[a].shapes {
                for right in &robot.links[b].shapes {
                    pairs.push([Part::new(a, left, margin / 2.0), Part::new(b, right, margin / 2.0)]);
                }
            }
        }
        Self { pairs }
    }

    /// Whether any pair overlaps when link `i` is at `pose(i)`.
    pub fn any<'a>(&self, pose: impl Fn(usize) -> &'a IsometryMatrix3<f64>) -> bool {
        self.pairs
            .iter()
            .any(|[a, b]| overlap(a, pose(a.link), b, pose(b.link)))
    }
}

/// Whether two shapes overlap with their links at the given poses.
fn overlap(a: &Part, a_link: &IsometryMatrix3<f64>, b: &Part, b_link: &IsometryMatrix3<f64>) -> bool {
    let centre = |part: &Part, link: &IsometryMatrix3<f64>| {
        link.rotation * part.pose.translation.vector + link.translation.vector
    };
    let between = centre(b, b_link) - centre(a, a_link);
    let square = between.norm_squared();
    let reach = a.radius + b.radius;
    // The bounding spheres are apart, or the plane across the line between the centres separates the shapes.
    square < reach * reach
        && square <= a.extent(a_link, &between) + b.extent(b_link, &between)
        && query::intersection_test(&a.at(a_link), &*a.shape, &b.at(b_link), &*b.shape)
            .is_ok_and(|test| test.intersecting)
}

impl Part {
    /// `shape` on link `link`, larger by `coat` m on every side.
    fn new(link: usize, shape: &Shape, coat: f64) -> Self {
        let geometry = match shape.geometry {
            Geometry::Box(half) => Geometry::Box(half.add_scalar(coat)),
            Geometry::Sphere(radius) => Geometry::Sphere(radius + coat),
            Geometry::Cylinder(radius, half) => Geometry::Cylinder(radius + coat, half),
            Geometry::Capsule(radius, half) => Geometry::Capsule(radius + coat, half),
        };
        let (shared, radius) = match geometry {
            Geometry::Box(half) => (SharedShape::cuboid(half.x, half.y, half.z), half.norm()),
            Geometry::Sphere(radius) => (SharedShape::ball(radius), radius),
            // A cylinder counts with round caps: cheaper, and a little cautious at its ends.
            Geometry::Cylinder(radius, half) | Geometry::Capsule(radius, half) => {
                let end = Vector::new(0.0, 0.0, half);
                (SharedShape::capsule(-end, end, radius), radius + half)
            }
        };
        Self {
            link,
            pose: with_matrix(&shape.pose),
            geometry,
            shape: shared,
            radius,
        }
    }

    /// How far the shape reaches from its centre along `direction` (world frame), times the length of that.
    fn extent(&self, link: &IsometryMatrix3<f64>, direction: &Vector3<f64>) -> f64 {
        let along = self
            .pose
            .rotation
            .inverse_transform_vector(&link.rotation.inverse_transform_vector(direction));
        match self.geometry {
            Geometry::Box(half) => half.dot(&along.abs()),
            Geometry::Sphere(radius) => radius * along.norm(),
            Geometry::Cylinder(radius, half) | Geometry::Capsule(radius, half) => {
                half * along.z.abs() + radius * along.norm()
            }
        }
    }

    fn at(&self, link: &IsometryMatrix3<f64>) -> Pose {
        let pose = link * self.pose;
        let (t, q) = (
            pose.translation.vector,
            UnitQuaternion::from_rotation_matrix(&pose.rotation),
        );
        Pose::from_parts(Vector::new(t.x, t.y, t.z), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, Translation3};
    use proptest::prelude::*;

    use super::*;

    fn part(kind: u8) -> Part {
        let geometry = match kind {
            0 => Geometry::Box(Vector3::new(0.13, 0.07, 0.02)),
            1 => Geometry::Sphere(0.1),
            _ => Geometry::Capsule(0.05, 0.15),
        };
        let pose = Isometry3::new(Vector3::new(0.02, -0.01, 0.03), Vector3::new(0.1, 0.4, -0.3));
        Part::new(0, &Shape { pose, geometry }, 0.0)
    }

    #[test]
    fn shapes_within_the_margin_count_as_overlapping() {
        let sphere = Geometry::Sphere(0.1);
        let apart = |gap: f64, margin: f64| {
            let [a, b] = [0.0, 0.2 + gap].map(|x| {
                let pose = Isometry3::translation(x, 0.0, 0.0);
                Part::new(0, &Shape { pose, geometry: sphere }, margin / 2.0)
            });
            let still = with_matrix(&Isometry3::identity());
            !overlap(&a, &still, &b, &still)
        };
        assert!(apart(0.001, 0.0) && !apart(-0.001, 0.0));
        assert!(apart(0.011, 0.01) && !apart(0.009, 0.01));
    }

    proptest! {
        #[test]
        fn what_the_cheap_tests_sort_out_does_not_overlap(
            kinds in prop::array::uniform2(0u8..3), turns in prop::array::uniform6(-2.0f64..2.0),
            offset in prop::array::uniform3(-0.4f64..0.4),
        ) {
            let [a, b] = kinds.map(part);
            let link = |turn: &[f64], offset: Vector3<f64>| {
                let turned = UnitQuaternion::from_scaled_axis(Vector3::from_column_slice(turn));
                with_matrix(&Isometry3::from_parts(Translation3::from(offset), turned))
            };
            let (one, two) = (link(&turns[..3], Vector3::zeros()), link(&turns[3..], Vector3::from(offset)));
            let exact = query::intersection_test(&a.at(&one), &*a.shape, &b.at(&two), &*b.shape).unwrap();
            prop_assert_eq!(overlap(&a, &one, &b, &two), exact.intersecting);
        }
    }
}
