//! The acceleration of robots of up to sixty joints in every width: what rounding makes of it.

use nalgebra::DVector;
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::reference::Reference;
use super::robots;
use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Kernel, Single};
use crate::ground::Ground;
use crate::robot::{Base, JointKind, Passive};

const DT: f64 = 0.001;

/// Rods of 0.2 kg and 10 cm in a row, the axis of each hinge turned by a third of a radian against the one before.
fn row(joints: usize) -> Robot {
    let links = (0..=joints).map(|l| robots::link(l.checked_sub(1), 0.2, [0.0, 0.0, -0.05], [0.02, 0.02, 0.1]));
    let hinge = |j: usize| {
        let (sin, cos) = (0.3 * j as f64).sin_cos();
        let at = if j == 0 { 0.0 } else { -0.1 };
        robots::joint(j, [0.0, 0.0, at], [sin, cos, 0.0], JointKind::Revolute)
    };
    robots::robot(Base::Fixed, links.collect(), (0..joints).map(hinge).collect())
}

/// An acceleration's error, relative, in coordinates in which all joints have the same inertia, and what rounding may make it.
struct Error {
    error: f64,
    known: f64,
}

/// Of the first step from a random state.
fn error<L: Kernel>(robot: &Robot, level: Simd, seed: u64) -> Error {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    let mut numbers = |scale: f64| (0..robot.dofs.len()).map(|_| rng.random_range(-scale..scale)).collect();
    let begin = Start {
        position: Vector3::z() * 100.0,
        joints: numbers(0.5),
        joint_velocities: numbers(1.0),
        ..Start::nominal(robot)
    };
    let mut own = world(robot);
    own.joints.fill(Passive::default());
    let mut engine = Batch::<L>::new(&Ground::Plane, robot, DT, 1);
    engine.reset(0, &begin, &own);
    engine.step(&Drive::idle(robot.dofs.len(), 1));
    let change = DVector::from_iterator(engine.model.dofs(), engine.work.change.iter().map(|x| x.get(0)));
    let Reference { mass_matrix, bias, .. } = Reference::new(robot, &begin, &own);
    let inertia = mass_matrix.diagonal().map(f64::sqrt);
    let scaled = mass_matrix.map_with_location(|r, c, m| m / (inertia[r] * inertia[c]));
    let exact = -mass_matrix.cholesky().expect("positive definite").solve(&bias) * DT;
    let size = |v: &DVector<f64>| v.component_mul(&inertia).norm();
    // A factorisation is off by what the condition of the scaled matrix makes of the rounding of its entries (Demmel, On floating
    // point errors in Cholesky, 1989), and every joint on the way to an entry rounds it.
    let moments = scaled.symmetric_eigenvalues();
    let condition = moments.max() / moments.min();
    Error {
        error: size(&(change - &exact)) / size(&exact),
        known: condition * robot.joints.len() as f64 * rounding(level),
    }
}

/// The project's humanoid without limits, which the states here do not care for.
fn humanoid() -> Robot {
    let mut robot = nimbro();
    for joint in &mut robot.joints {
        joint.limits = (f64::NEG_INFINITY, f64::INFINITY);
    }
    robot
}

fn robots() -> [(&'static str, Robot); 5] {
    [
        ("humanoid", humanoid()),
        ("tree of 60", robots::random(3, Base::Floating, 60)),
        ("row of 10", row(10)),
        ("row of 20", row(20)),
        ("row of 60", row(60)),
    ]
}

/// The numbers in the module's text, by `-- --nocapture`.
fn check<L: Kernel>(level: Simd) {
    for (name, robot) in robots() {
        for seed in 0..5 {
            let Error { error, known } = error::<L>(&robot, level, seed);
            println!("{} of {name}: {error:.0e}, at most {known:.0e}", level.name());
            assert!(
                error < known,
                "{} of {name}: {error}, {known} by rounding",
                level.name()
            );
            // In `f64` every digit is right that a number in `f32` has.
            let double = epsilon(level) == f64::EPSILON;
            assert!(
                !double || error < f64::from(f32::EPSILON),
                "{} of {name}: {error}",
                level.name()
            );
        }
    }
}

#[test]
fn accelerations_are_right_but_for_rounding_in_f64() {
    check::<Single>(Simd::Scalar);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn accelerations_are_right_but_for_rounding_in_every_width() {
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
