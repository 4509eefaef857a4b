//! Where a ray meets a primitive shape: exact solutions of the ray's equation in the shape's frame.

use nalgebra::{Isometry3, Point3, Vector3};
use omniwalk_env::robot::Geometry;

/// A half line `origin + t direction`, t >= 0.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Where it begins, m.
    pub origin: Point3<f64>,
    /// Unit direction.
    pub direction: Vector3<f64>,
}

/// The nearest point of a shape on a ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Distance from the origin, m.
    pub distance: f64,
    /// Outward unit normal of the surface.
    pub normal: Vector3<f64>,
    /// Distance from the nearest edge of a box on its surface, m; infinite for round shapes.
    pub edge: f64,
}

impl Ray {
    /// The ray in the frame whose pose is the inverse of `inverse`.
    pub fn seen_from(&self, inverse: &Isometry3<f64>) -> Self {
        Self {
            origin: inverse * self.origin,
            direction: inverse * self.direction,
        }
    }

    /// Where the ray enters `geometry`, whose centre is the origin; `None` if it does not, or begins inside.
    pub fn enters(&self, geometry: &Geometry) -> Option<Hit> {
        match *geometry {
            Geometry::Box(half) => self.enters_box(&half),
            Geometry::Sphere(radius) => self.enters_sphere(Point3::origin(), radius),
            Geometry::Cylinder(radius, half) => {
                nearest([self.enters_tube(radius, half), self.enters_lids(radius, half)])
            }
            Geometry::Capsule(radius, half) => {
                let cap = |z| self.enters_sphere(Point3::new(0.0, 0.0, z), radius);
                nearest([self.enters_tube(radius, half), nearest([cap(half), cap(-half)])])
            }
        }
    }

    fn at(&self, distance: f64) -> Point3<f64> {
        self.origin + self.direction * distance
    }

    fn enters_box(&self, half: &Vector3<f64>) -> Option<Hit> {
        // The last of the three slabs that is entered, if that is before the first is left.
        let (mut enter, mut leave, mut axis) = (f64::NEG_INFINITY, f64::INFINITY, 0);
        for i in 0..3 {
            let (o, d) = (self.origin[i], self.direction[i]);
            let (a, b) = ((-half[i] - o) / d, (half[i] - o) / d);
            if d == 0.0 && o.abs() > half[i] {
                return None;
            }
            if d != 0.0 && a.min(b) > enter {
                (enter, axis) = (a.min(b), i);
            }
            if d != 0.0 {
                leave = leave.min(a.max(b));
            }
        }
        let point = self.at(enter);
        let edge = (0..3).filter(|&i| i != axis).map(|i| half[i] - point[i].abs());
        (enter < leave && enter >= 0.0).then(|| Hit {
            distance: enter,
            normal: Vector3::ith(axis, -self.direction[axis].signum()),
            edge: edge.fold(f64::INFINITY, f64::min),
        })
    }

    fn enters_sphere(&self, centre: Point3<f64>, radius: f64) -> Option<Hit> {
        let o = self.origin - centre;
        let distance = first_root(
            self.direction.norm_squared(),
            o.dot(&self.direction),
            o.norm_squared() - radius * radius,
        )?;
        Some(round(distance, (self.at(distance) - centre) / radius))
    }

    /// The side of a cylinder.
    fn enters_tube(&self, radius: f64, half: f64) -> Option<Hit> {
        let (o, d) = (self.origin.coords.xy(), self.direction.xy());
        let distance = first_root(d.norm_squared(), o.dot(&d), o.norm_squared() - radius * radius)?;
        let point = self.at(distance);
        let normal = Vector3::new(point.x, point.y, 0.0) / radius;
        (point.z.abs() <= half).then(|| round(distance, normal))
    }

    /// The flat ends of a cylinder.
    fn enters_lids(&self, radius: f64, half: f64) -> Option<Hit> {
        let side = -self.direction.z.signum();
        let distance = (side * half - self.origin.z) / self.direction.z;
        let inside = distance.is_finite() && distance >= 0.0 && self.at(distance).coords.xy().norm() <= radius;
        inside.then(|| round(distance, Vector3::z() * side))
    }
}

/// The smaller root of `a t^2 + 2 b t + c`, if it is real and not negative.
fn first_root(a: f64, b: f64, c: f64) -> Option<f64> {
    let root = (-b - (b * b - a * c).sqrt()) / a;
    (root >= 0.0 && root.is_finite()).then_some(root)
}

fn round(distance: f64, normal: Vector3<f64>) -> Hit {
    Hit {
        distance,
        normal,
        edge: f64::INFINITY,
    }
}

/// The hit that comes first.
pub fn nearest(hits: impl IntoIterator<Item = Option<Hit>>) -> Option<Hit> {
    hits.into_iter()
        .flatten()
        .min_by(|a, b| a.distance.total_cmp(&b.distance))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Signed distance of a point from the surface: another way to say what a shape is.
    fn outside(geometry: &Geometry, p: &Point3<f64>) -> f64 {
        let tube = |half: f64| p.coords.xy().norm().hypot((p.z.abs() - half).max(0.0));
        match *geometry {
            Geometry::Box(half) => (p.coords.abs() - half).max(),
            Geometry::Sphere(radius) => p.coords.norm() - radius,
            Geometry::Cylinder(radius, half) => (p.coords.xy().norm() - radius).max(p.z.abs() - half),
            Geometry::Capsule(radius, half) => tube(half) - radius,
        }
    }

    proptest! {
        #[test]
        fn a_ray_ends_on_the_surface_and_passes_only_empty_space(
            kind in 0..4usize, origin in prop::array::uniform3(-3.0..3.0f64), aim in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let geometry = [
                Geometry::Box(Vector3::new(0.5, 0.3, 0.8)),
                Geometry::Sphere(0.6),
                Geometry::Cylinder(0.4, 0.7),
                Geometry::Capsule(0.3, 0.6),
            ][kind];
            let origin = Point3::from(origin);
            prop_assume!(outside(&geometry, &origin) > 0.01);
            let direction = (Point3::from(aim) - origin).normalize();
            let ray = Ray { origin, direction };
            let hit = ray.enters(&geometry);
            let end = hit.map_or(8.0, |hit| hit.distance);
            for step in 0..400 {
                let t = end * f64::from(step) / 400.0;
                prop_assert!(outside(&geometry, &ray.at(t)) > -1e-9);
            }
            if let Some(hit) = hit {
                prop_assert!(outside(&geometry, &ray.at(hit.distance)).abs() < 1e-9);
                prop_assert!((hit.normal.norm() - 1.0).abs() < 1e-9 && hit.normal.dot(&direction) <= 0.0);
                let above = ray.at(hit.distance) + hit.normal * 1e-4;
                prop_assert!(outside(&geometry, &above) > 0.0);
            }
        }
    }
}
