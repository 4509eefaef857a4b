//! Mass matrix, bias force and free motion.

use nalgebra::{DMatrix, DVector, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::reference::Reference;
use super::robots;
use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Kernel, Single};
use crate::engine::lanes::{dynamics, factor, kinematics};
use crate::robot::{Base, Robot};

fn random_start(robot: &Robot, rng: &mut ChaCha8Rng) -> Start {
    let mut numbers = |scale: f64| (0..robot.dofs.len()).map(|_| rng.random_range(-scale..scale)).collect();
    let (joints, joint_velocities) = (numbers(1.5), numbers(3.0));
    Start {
        position: Vector3::new(0.3, -0.2, 3.0),
        orientation: UnitQuaternion::from_scaled_axis(robots::vector(rng, 2.0)),
        linear_velocity: robots::vector(rng, 2.0),
        angular_velocity: robots::vector(rng, 3.0),
        joints,
        joint_velocities,
    }
}

/// Mass matrix, bias and the product of the factor at `start` in lane `lane`.
fn terms<L: Kernel>(robot: &Robot, start: &Start, world: &World, lane: usize) -> [DMatrix<f64>; 3] {
    let mut batch = Batch::<L>::new(robot, 0.001, L::WIDTH);
    batch.reset(lane, start, world);
    let Batch {
        model, groups, work, ..
    } = &mut batch;
    let group = &groups[0];
    kinematics::place_links(model, &group.state, work);
    dynamics::bias_force(model, group, work);
    dynamics::mass_matrix(model, work);
    let dofs = model.dofs();
    let unpacked = |packed: &[L], symmetric: bool| {
        let mut full = DMatrix::zeros(dofs, dofs);
        for (r, row) in model.rows.iter().enumerate() {
            for (i, c) in row.ancestors.iter().copied().chain([r]).enumerate() {
                full[(r, c)] = packed[row.start + i].get(lane);
                if symmetric {
                    full[(c, r)] = full[(r, c)];
                }
            }
        }
        full
    };
    let matrix = unpacked(&work.mass_matrix, true);
    factor::factor(&model.rows, &mut work.mass_matrix, &mut work.inverse_diagonal);
    let mut l = unpacked(&work.mass_matrix, false);
    for (d, inverse) in work.inverse_diagonal.iter().enumerate() {
        l[(d, d)] = 1.0 / inverse.get(lane);
    }
    let bias = DVector::from_iterator(dofs, work.bias.iter().map(|b| b.get(lane)));
    [matrix, DMatrix::from_columns(&[bias]), l.transpose() * l]
}

/// Largest difference relative to the largest entry.
fn error(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax() / b.amax()
}

fn check<L: Kernel>(bound: f64, states: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let robots = [
        robots::pendulum(),
        robots::slider(),
        robots::double_pendulum(),
        robots::biped(),
        robots::random(1, Base::Floating, 20),
        robots::random(2, Base::Fixed, 12),
        robots::random(3, Base::Floating, 60),
        robots::block(3.0, [0.2, 0.3, 0.4]),
    ];
    for (n, robot) in robots.iter().enumerate() {
        for i in 0..states {
            let start = random_start(robot, &mut rng);
            let world = world(robot);
            let reference = Reference::new(robot, &start, &world);
            let [matrix, bias, product] = terms::<L>(robot, &start, &world, i % L::WIDTH);
            assert!(
                error(&matrix, &reference.mass_matrix) < bound,
                "mass matrix of robot {n}"
            );
            let scale = DMatrix::from_columns(&[reference.bias]);
            assert!(
                error(&bias, &scale) < bound,
                "bias of robot {n}: {}",
                error(&bias, &scale)
            );
            assert!(error(&product, &reference.mass_matrix) < bound, "factor of robot {n}");
        }
    }
}

#[test]
fn mass_matrix_bias_and_factor_agree_with_geometric_jacobians_in_f64() {
    check::<Single>(1e-10, 100);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn mass_matrix_bias_and_factor_agree_with_geometric_jacobians_in_every_width() {
    use crate::engine::lanes::lane::{F32x8, F32x16, F64x4, F64x8};
    for level in levels() {
        match level {
            Simd::F32x16 => check::<F32x16>(1e-4, 20),
            Simd::F32x8 => check::<F32x8>(1e-4, 20),
            Simd::F64x8 => check::<F64x8>(1e-10, 20),
            Simd::F64x4 => check::<F64x4>(1e-10, 20),
            Simd::Scalar => {}
        }
    }
}
