//! Legs that pass through each other: engines collide links with the ground only, so the distance of soles and
//! shanks is checked here, once a control step, for every engine alike.

use nalgebra::{Isometry3, Point3};
use rapier3d_f64::parry::math::{Pose, Rotation, Vector};
use rapier3d_f64::parry::query;
use rapier3d_f64::parry::shape::SharedShape;

use crate::robot::{Geometry, Robot, Shape};

/// The pairs of shapes of one robot that must not overlap.
pub struct Overlap {
    pairs: Vec<Pair>,
}

struct Pair {
    links: [usize; 2],
    shapes: [SharedShape; 2],
    poses: [Isometry3<f64>; 2],
    /// Sum of the bounding radii, m: farther apart, nothing needs to be computed.
    reach: f64,
}

impl Overlap {
    /// Every pair of shapes of the robot's overlap pairs.
    pub fn new(robot: &Robot) -> Self {
        let mut pairs = Vec::new();
        for &(a, b) in &robot.overlap_pairs {
            for left in &robot.links[a].shapes {
                for right in &robot.links[b].shapes {
                    pairs.push(Pair {
                        links: [a, b],
                        shapes: [shared(left), shared(right)],
                        poses: [left.pose, right.pose],
                        reach: radius(left) + radius(right),
                    });
                }
            }
        }
        Self { pairs }
    }

    /// Whether any pair overlaps when link `i` is at `pose(i)`.
    pub fn any<'a>(&self, pose: impl Fn(usize) -> &'a Isometry3<f64>) -> bool {
        self.pairs.iter().any(|pair| {
            let [a, b] = [0, 1].map(|k| pose(pair.links[k]) * pair.poses[k]);
            (a.translation.vector - b.translation.vector).norm() < pair.reach
                && query::intersection_test(&convert(&a), &*pair.shapes[0], &convert(&b), &*pair.shapes[1])
                    .is_ok_and(|test| test.intersecting)
        })
    }
}

fn shared(shape: &Shape) -> SharedShape {
    match shape.geometry {
        Geometry::Box(half) => SharedShape::cuboid(half.x, half.y, half.z),
        Geometry::Sphere(radius) => SharedShape::ball(radius),
        // A cylinder counts with round caps: cheaper, and a little cautious at its ends.
        Geometry::Cylinder(radius, half) | Geometry::Capsule(radius, half) => {
            SharedShape::capsule(Vector::new(0.0, 0.0, -half), Vector::new(0.0, 0.0, half), radius)
        }
    }
}

fn radius(shape: &Shape) -> f64 {
    match shape.geometry {
        Geometry::Box(half) => half.norm(),
        Geometry::Sphere(radius) => radius,
        Geometry::Cylinder(radius, half) | Geometry::Capsule(radius, half) => radius + half,
    }
}

fn convert(pose: &Isometry3<f64>) -> Pose {
    let (t, q) = (Point3::from(pose.translation.vector), pose.rotation);
    Pose::from_parts(Vector::new(t.x, t.y, t.z), Rotation::from_xyzw(q.i, q.j, q.k, q.w))
}
