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

/// What the engine's world 0 does now.
fn state(robot: &Robot, engine: &Lanes) -> Start {
    let base = engine.base(0);
    Start {
        position: base.position,
        orientation: base.orientation,
        linear_velocity: base.linear_velocity,
        angular_velocity: base.angular_velocity,
        joints: engine.joints().position[..robot.dofs.len()].to_vec(),
        joint_velocities: engine.joints().velocity[..robot.dofs.len()].to_vec(),
    }
}

/// Drift of energy, momentum and angular momentum about the centre of mass after `steps` steps of free flight, relative.
fn drift(robot: &Robot, begin: &Start, level: Simd, dt: f64, seconds: f64) -> [f64; 3] {
    let world = world(robot);
    let mut engine = single(robot, dt, level, begin, &world);
    let first = Reference::new(robot, &state(robot, &engine), &world);
    for _ in 0..(seconds / dt).round() as usize {
        engine.step(&Drive::idle(robot.dofs.len(), 1));
    }
    let last = Reference::new(robot, &state(robot, &engine), &world);
    let about_com = |r: &Reference| r.angular_momentum - r.com.cross(&r.momentum);
    let energy = |r: &Reference| r.kinetic + r.potential;
    let expected = first.momentum + world.gravity * (robot.mass() * seconds);
    [
        (energy(&last) - energy(&first)).abs() / first.kinetic,
        (last.momentum - expected).norm() / first.momentum.norm(),
        (about_com(&last) - about_com(&first)).norm() / about_com(&first).norm(),
    ]
}

#[test]
fn free_flight_conserves_energy_and_momentum_to_first_order_in_the_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for robot in [
        robots::random(1, Base::Floating, 8),
        robots::random(5, Base::Floating, 12),
    ] {
        let mut begin = random_start(&robot, &mut rng);
        begin.position.z = 100.0;
        begin.joint_velocities.iter_mut().for_each(|v| *v *= 0.3);
        let drifts = [4e-4, 2e-4, 1e-4].map(|dt| drift(&robot, &begin, Simd::Scalar, dt, 0.2));
        for (coarse, fine) in [(drifts[0], drifts[1]), (drifts[1], drifts[2])] {
            for (coarse, fine) in coarse.iter().zip(fine) {
                assert!(*coarse < 0.02 && fine < 0.6 * coarse, "drifts {drifts:?}");
            }
        }
        for level in levels() {
            let rounded = drift(&robot, &begin, level, 4e-4, 0.2);
            for (own, exact) in rounded.iter().zip(drifts[0]) {
                assert!((own - exact).abs() < 1e-3, "{}: {own} beside {exact}", level.name());
            }
        }
    }
}
