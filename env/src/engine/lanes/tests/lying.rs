//! A fallen robot on the points that `[[contact]]` gives links that are no feet.

use nalgebra::UnitQuaternion;

use super::reference::Reference;
use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Kernel, Single};
use crate::engine::lanes::reset::get_vector;
use crate::ground::Ground;

const DT: f64 = 0.005;
/// Over which forces are averaged, s.
const MEAN: f64 = 0.5;

/// The project's humanoid with the corners of its trunk and the ends of its arms among its contact points.
fn with_more_points() -> Robot {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../robots/nimbro_op2x");
    let folder = tempfile::tempdir().expect("a folder");
    let urdf = "nimbro_op2x.urdf";
    std::fs::copy(own.join(urdf), folder.path().join(urdf)).expect("copied");
    let mut text = std::fs::read_to_string(own.join("robot.toml")).expect("read");
    let corners = [-0.081, 0.089].map(|x| [-0.11, 0.11].map(|y| [-0.045, 0.295].map(|z| [x, y, z])));
    text += &format!(
        "\n[[contact]]\nlink = \"trunk_link\"\npoints = {:?}\n",
        corners.as_flattened().as_flattened()
    );
    for side in ["left", "right"] {
        text += &format!("\n[[contact]]\nlink = \"{side}_elbow_pitch_link\"\npoints = [[0.0, 0.0, -0.22]]\n");
    }
    std::fs::write(folder.path().join("robot.toml"), text).expect("written");
    crate::robot::load(folder.path()).expect("the robot loads")
}

/// What lies: the mean force on every body with contact points, and what it should be in all.
struct Lying {
    forces: Vec<Vector3<f64>>,
    expected: Vector3<f64>,
}

/// Lets the robot fall onto its back and lie for 6 s.
fn lying<L: Kernel>(robot: &Robot) -> Lying {
    let own = world(robot);
    let begin = Start {
        position: Vector3::z() * 0.15,
        orientation: UnitQuaternion::from_scaled_axis(Vector3::y() * -std::f64::consts::FRAC_PI_2),
        ..Start::nominal(robot)
    };
    let drive = hold(robot);
    let mut engine = Batch::<L>::new(&Ground::Plane, robot, DT, 1);
    engine.reset(0, &begin, &own);
    let steps = |seconds: f64| (seconds / DT).round() as usize;
    (0..steps(6.0)).for_each(|_| engine.step(&drive));
    let momentum = |engine: &Batch<L>| {
        let base = engine.base(0);
        let now = Start {
            position: base.position,
            orientation: base.orientation,
            linear_velocity: base.linear_velocity,
            angular_velocity: base.angular_velocity,
            joints: engine.joints().position.clone(),
            joint_velocities: engine.joints().velocity.clone(),
        };
        Reference::new(robot, &now, &own).momentum
    };
    let before = momentum(&engine);
    let mut forces = vec![Vector3::zeros(); engine.model.bodies.len()];
    for _ in 0..steps(MEAN) {
        engine.step(&drive);
        for (mean, force) in forces.iter_mut().zip(&engine.groups[0].state.ground_force) {
            *mean += get_vector(force, 0) / steps(MEAN) as f64;
        }
    }
    Lying {
        forces,
        expected: Vector3::z() * robot.mass() * GRAVITY + (momentum(&engine) - before) / MEAN,
    }
}

fn check<L: Kernel>(level: Simd) {
    let robot = with_more_points();
    let Lying { forces, expected } = lying::<L>(&robot);
    let total: Vector3<f64> = forces.iter().sum();
    // Forces of the weight's size make up for it joint by joint; every one of them is rounded.
    let bound = robot.dofs.len() as f64 * rounding(level) * robot.mass() * GRAVITY;
    let off = (total - expected).norm();
    assert!(
        off < bound,
        "{}: off by {off} N of {expected}, {bound} N by rounding",
        level.name()
    );
    let feet: f64 = (0..robot.feet.len())
        .map(|foot| robot.feet[foot].link)
        .map(|link| link_force(&robot, &forces, link).z)
        .sum();
    let trunk = link_force(&robot, &forces, 0).z;
    assert!(
        trunk > feet,
        "{}: the trunk carries {trunk} N, the feet {feet} N",
        level.name()
    );
}

/// The force on `link`: bodies are the links that have points, in their order.
fn link_force(robot: &Robot, forces: &[Vector3<f64>], link: usize) -> Vector3<f64> {
    let before = robot.links[..link]
        .iter()
        .filter(|link| !link.contact_points.is_empty());
    forces[before.count()]
}

#[test]
fn a_fallen_robot_presses_with_its_weight_on_the_points_of_all_its_links() {
    check::<Single>(Simd::Scalar);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn a_fallen_robot_presses_with_its_weight_in_every_width() {
    use crate::engine::lanes::x86::{F32x8, F32x16, F64x4, F64x8};
    for level in levels() {
        match level {
            Simd::F32x16 => check::<F32x16>(level),
            Simd::F32x8 => check::<F32x8>(level),
            Simd::F64x8 => check::<F64x8>(level),
            Simd::F64x4 => check::<F64x4>(level),
            Simd::Scalar => {}
        }
    }
}
