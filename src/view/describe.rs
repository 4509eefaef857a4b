//! The robot as the page draws it.

use nalgebra::{Isometry3, SymmetricEigen, Translation3, UnitQuaternion, Vector3};
use omniwalk_env::robot::{Geometry, Inertial, JointKind, Link, Robot, Shape};
use serde_json::{Value, json};

use super::row::fields;

/// A JSON object: whether the robot can be driven, links with their shapes, joints with what drives them, feet, and the fields of a row.
pub fn robot(robot: &Robot, drives: bool) -> Value {
    let drivers = robot.drivers();
    let joints = robot.joints.iter().zip(&drivers).enumerate();
    let joints: Vec<Value> = joints
        .map(|(i, (joint, &(dof, multiplier, offset)))| {
            let limit = joint
                .actuator
                .map(|actuator| [actuator.torque_limit, actuator.speed_limit]);
            json!({
                "name": joint.name,
                "parent": joint.parent,
                "child": i + 1,
                "origin": pose(&joint.origin),
                "axis": joint.axis.as_slice(),
                "slides": joint.kind == JointKind::Prismatic,
                "dof": dof,
                "multiplier": multiplier,
                "offset": offset,
                "limits": [finite(joint.limits.0), finite(joint.limits.1)],
                "motor": limit,
            })
        })
        .collect();
    let links: Vec<Value> = robot
        .links
        .iter()
        .map(|link| json!({ "name": link.name, "parent": link.parent, "shapes": shapes(link) }))
        .collect();
    let feet: Vec<Value> = robot
        .feet
        .iter()
        .map(|foot| {
            json!({ "name": foot.name, "link": foot.link, "sole": pose(&foot.sole), "half_extents": foot.half_extents })
        })
        .collect();
    json!({
        "name": robot.name,
        "drives": drives,
        "mass": robot.mass(),
        "height": robot.base_pose.translation.z,
        "base": pose(&robot.base_pose),
        "nominal": robot.nominal(),
        "dofs": (0..robot.dofs.len()).map(|d| robot.dof(d).name.as_str()).collect::<Vec<_>>(),
        "links": links,
        "joints": joints,
        "feet": feet,
        "fields": fields(robot),
    })
}

/// What shows a link: its visual primitives, or those it collides with, or a box of its inertia.
fn shapes(link: &Link) -> Vec<Value> {
    let given = if link.visuals.is_empty() {
        &link.shapes
    } else {
        &link.visuals
    };
    if given.is_empty() {
        return inertia_box(&link.inertial).iter().map(shape).collect();
    }
    given.iter().map(shape).collect()
}

fn shape(shape: &Shape) -> Value {
    let (kind, size) = match shape.geometry {
        Geometry::Box(half) => ("box", (half * 2.0).as_slice().to_vec()),
        Geometry::Sphere(radius) => ("sphere", vec![radius]),
        Geometry::Cylinder(radius, half) => ("cylinder", vec![radius, 2.0 * half]),
        Geometry::Capsule(radius, half) => ("capsule", vec![radius, 2.0 * half]),
    };
    json!({ "kind": kind, "size": size, "pose": pose(&shape.pose) })
}

/// The solid box with the inertia of a link; none for a link without mass or extent.
fn inertia_box(inertial: &Inertial) -> Option<Shape> {
    if inertial.mass <= 0.0 {
        return None;
    }
    let SymmetricEigen {
        eigenvalues: moments,
        mut eigenvectors,
    } = inertial.inertia.symmetric_eigen();
    // I_x = m/12 (y^2 + z^2) and so on, so x^2 = 6/m (I_y + I_z - I_x).
    let sum = moments.sum();
    let size = moments.map(|moment| (6.0 / inertial.mass * (sum - 2.0 * moment)).max(0.0).sqrt());
    if !(size.min() > 0.0 && size.max().is_finite()) {
        return None;
    }
    if eigenvectors.determinant() < 0.0 {
        eigenvectors.set_column(2, &-eigenvectors.column(2));
    }
    let rotation = UnitQuaternion::from_matrix(&eigenvectors);
    Some(Shape {
        geometry: Geometry::Box(size / 2.0),
        pose: Isometry3::from_parts(Translation3::from(inertial.com), rotation),
    })
}

/// Position (m) and quaternion (x, y, z, w).
fn pose(pose: &Isometry3<f64>) -> Value {
    let Vector3 { data, .. } = pose.translation.vector;
    let q = &pose.rotation;
    json!([data.0[0], [q.i, q.j, q.k, q.w]])
}

/// JSON has no infinity.
fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix3;

    use super::*;

    #[test]
    fn a_solid_box_is_drawn_from_its_inertia() {
        let (mass, size) = (3.0, Vector3::new(0.1, 0.2, 0.4));
        let square = size.component_mul(&size);
        let moments = square.map(|x| mass / 12.0 * (square.sum() - x));
        let turn = UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9).to_rotation_matrix();
        let inertial = Inertial {
            mass,
            com: Vector3::new(1.0, 2.0, 3.0),
            inertia: turn * Matrix3::from_diagonal(&moments) * turn.transpose(),
        };
        let shape = inertia_box(&inertial).unwrap();
        let Geometry::Box(half) = shape.geometry else { panic!() };
        // The same points are inside: the ends of the longest edge.
        let end = |half: &Vector3<f64>| Vector3::ith(half.imax(), half.max());
        let (expected, found) = (turn * end(&(size / 2.0)), shape.pose.rotation * end(&half));
        assert!((expected.dot(&found).abs() - 0.04).abs() < 1e-9, "{expected} {found}");
        let mut sorted: Vec<f64> = half.iter().map(|x| 2.0 * x).collect();
        sorted.sort_by(f64::total_cmp);
        assert!(
            sorted.iter().zip(size.iter()).all(|(a, b)| (a - b).abs() < 1e-9),
            "{sorted:?}"
        );
        assert_eq!(shape.pose.translation.vector, inertial.com);
        let massless = Inertial { mass: 0.0, ..inertial };
        assert!(inertia_box(&massless).is_none());
    }
}
