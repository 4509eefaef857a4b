//! Mass matrix, bias force and free motion.

use std::path::PathBuf;

use nalgebra::{DMatrix, Point3, Unit, UnitQuaternion, Vector3};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

use super::reference::Reference;
use super::robots;
use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::lane::{Kernel, Single};
use crate::engine::lanes::model::ContactBody;
use crate::engine::lanes::{contact, dynamics, factor, one_joint};
use crate::ground::Ground;
use crate::robot::{Base, JointKind, Robot};

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

/// What the engine computes of a state before it solves anything.
struct Terms {
    mass_matrix: DMatrix<f64>,
    bias: DMatrix<f64>,
    /// `L^T L` of the factor.
    product: DMatrix<f64>,
    /// Of every contact body's twist at the mean of its points.
    jacobians: Vec<DMatrix<f64>>,
}

/// The terms of every lane of a group, each in its own state.
fn terms<L: Kernel>(robot: &Robot, starts: &[Start], world: &World) -> Vec<Terms> {
    let mut batch = Batch::<L>::new(&Ground::Plane, robot, 0.001, L::WIDTH);
    for (lane, start) in starts.iter().enumerate() {
        batch.reset(lane, start, world);
    }
    let Batch {
        model, groups, work, ..
    } = &mut batch;
    let group = &groups[0];
    dynamics::outward(model, group, work);
    dynamics::inward(model, work);
    let matrix = work.mass_matrix.clone();
    factor::factor(
        &model.rows,
        &model.outward,
        &mut work.mass_matrix,
        &mut work.inverse_diagonal,
    );
    let columns: Vec<_> = model
        .bodies
        .iter()
        .map(|body| contact::body_jacobian(model, body, work))
        .collect();
    let unpack = |lane: usize| {
        let unpacked = |packed: &[L], symmetric: bool| {
            let mut full = DMatrix::zeros(model.dofs(), model.dofs());
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
        let mut l = unpacked(&work.mass_matrix, false);
        for (d, inverse) in work.inverse_diagonal.iter().enumerate() {
            l[(d, d)] = 1.0 / inverse.get(lane);
        }
        let jacobian = |(body, columns): (&ContactBody<L>, &Vec<[L; 6]>)| {
            let mut full = DMatrix::zeros(6, model.dofs());
            for (&d, column) in body.path.iter().zip(columns) {
                for (r, x) in column.iter().enumerate() {
                    full[(r, d)] = x.get(lane);
                }
            }
            full
        };
        Terms {
            mass_matrix: unpacked(&matrix, true),
            bias: DMatrix::from_iterator(model.dofs(), 1, work.bias.iter().map(|b| b.get(lane))),
            product: l.transpose() * l,
            jacobians: model.bodies.iter().zip(&columns).map(jacobian).collect(),
        }
    };
    (0..starts.len()).map(unpack).collect()
}

/// Largest difference relative to the largest entry.
fn error(a: &DMatrix<f64>, b: &DMatrix<f64>) -> f64 {
    (a - b).amax() / b.amax()
}

/// Robots of files: the NimbRo-OP2X, and published descriptions where `OMNIWALK_SHARED` says where they are.
fn published() -> Vec<Robot> {
    let shared = std::env::var_os("OMNIWALK_SHARED").map(|folder| Path::new(&folder).join("robots/urdf"));
    if shared.is_none() {
        println!("OMNIWALK_SHARED is not set: only robots of the project are tried");
    }
    let files = [
        "igus_op/igus_op.urdf",
        "booster_t1/T1_locomotion.urdf",
        "unitree_g1/g1_12dof.urdf",
    ];
    let others = shared.iter().flat_map(|folder| files.map(|file| folder.join(file)));
    let load = |file: PathBuf| crate::robot::load(&file).expect("the robot loads");
    [nimbro()].into_iter().chain(others.map(load)).collect()
}

fn check<L: Kernel>(bound: f64) {
    const STATES: usize = 500;
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let mut pendulum = robots::pendulum();
    pendulum.links[1].contact_points = vec![Point3::new(0.01, 0.0, -1.0)];
    let mut robots = vec![
        pendulum,
        robots::slider(),
        robots::double_pendulum(),
        robots::biped(),
        robots::random(1, Base::Floating, 20),
        robots::random(2, Base::Fixed, 12),
        robots::random(3, Base::Floating, 60),
        robots::block(3.0, [0.2, 0.3, 0.4]),
    ];
    robots.extend(published());
    for (n, robot) in robots.iter().enumerate() {
        let world = world(robot);
        let starts: Vec<_> = (0..STATES).map(|_| random_start(robot, &mut rng)).collect();
        for starts in starts.chunks(L::WIDTH) {
            for (start, own) in starts.iter().zip(terms::<L>(robot, starts, &world)) {
                let reference = Reference::new(robot, start, &world);
                let named = [
                    ("mass matrix", &own.mass_matrix, &reference.mass_matrix),
                    ("bias", &own.bias, &DMatrix::from_columns(&[reference.bias])),
                    ("factor", &own.product, &reference.mass_matrix),
                ];
                let contacts = own.jacobians.iter().zip(&reference.contact_jacobians);
                assert_eq!(own.jacobians.len(), reference.contact_jacobians.len());
                for (name, own, exact) in named
                    .into_iter()
                    .chain(contacts.map(|(a, b)| ("contact Jacobian", a, b)))
                {
                    let error = error(own, exact);
                    assert!(error < bound, "{name} of robot {n}, {}: {error}", robot.name);
                }
            }
        }
    }
}

#[test]
fn matrices_bias_and_contact_jacobians_agree_with_geometric_ones_in_f64() {
    check::<Single>(1e-10);
}

#[cfg(target_arch = "x86_64")]
#[test]
fn matrices_bias_and_contact_jacobians_agree_with_geometric_ones_in_every_width() {
    use crate::engine::lanes::x86::{F32x8, F32x16, F64x4, F64x8};
    for level in levels() {
        match level {
            Simd::F32x16 => check::<F32x16>(1e-4),
            Simd::F32x8 => check::<F32x8>(1e-4),
            Simd::F64x8 => check::<F64x8>(1e-10),
            Simd::F64x4 => check::<F64x4>(1e-10),
            Simd::Scalar => {}
        }
    }
}

/// Bias force and mass of a robot of one joint, by what is constant and by the links' algorithms, in one world of `batch` after the other.
fn of_one_joint<L: Kernel>(batch: &mut Batch<L>) -> Vec<[[f64; 2]; 2]> {
    let Batch {
        model, groups, work, ..
    } = batch;
    assert!(model.one_joint);
    let (mass, bias) = one_joint::mass_and_bias(model, &mut groups[0], work);
    let quick = (bias, mass);
    dynamics::outward(model, &groups[0], work);
    dynamics::inward(model, work);
    let lane =
        |lane: usize| [quick, (work.bias[0], work.mass_matrix[0])].map(|(bias, mass)| [bias.get(lane), mass.get(lane)]);
    (0..L::WIDTH).map(lane).collect()
}

#[test]
fn bias_and_mass_of_one_joint_are_those_of_its_links_whatever_the_world_becomes() {
    let mut rng = ChaCha8Rng::seed_from_u64(13);
    let mut slide = robots::pendulum();
    slide.joints[0].kind = JointKind::Prismatic;
    for mut robot in [robots::pendulum(), slide] {
        robot.joints[0].axis = Unit::new_normalize(Vector3::new(0.5, -0.3, 0.8));
        robot.joints[0].origin.rotation = UnitQuaternion::from_scaled_axis(robots::vector(&mut rng, 2.0));
        robot.links[1].inertial.com = [0.1, 0.2, -0.9].into();
        let mut batch = Batch::<Single>::new(&Ground::Plane, &robot, 0.001, 1);
        let mut saved = Vec::new();
        for round in 0..200 {
            let mut world = world(&robot);
            world.links[1].mass *= 1.0 + 0.01 * f64::from(round);
            world.gravity += robots::vector(&mut rng, 3.0);
            batch.reset(0, &random_start(&robot, &mut rng), &world);
            if round == 0 {
                batch.save(0, &mut saved);
            }
            let before = of_one_joint(&mut batch);
            for _ in 0..100 {
                batch.step(&Drive::idle(1, 1));
            }
            let after = of_one_joint(&mut batch);
            let turns = robot.joints[0].kind == JointKind::Revolute;
            assert_eq!(before != after, turns, "a slide weighs the same everywhere");
            batch.load(0, &saved).expect("its own state");
            for [quick, exact] in before.into_iter().chain(after).chain(of_one_joint(&mut batch)) {
                let scale = exact[1] * 10.0;
                assert!((quick[0] - exact[0]).abs() < 1e-12 * scale, "{quick:?} {exact:?}");
                assert!((quick[1] - exact[1]).abs() < 1e-12 * scale, "{quick:?} {exact:?}");
            }
        }
    }
}

#[test]
fn one_joint_is_moved_as_joints_are_that_are_one_of_many() {
    let mut rng = ChaCha8Rng::seed_from_u64(14);
    for mut robot in [robots::pendulum(), robots::slider()] {
        robot.joints[0].limits = (-1.4, 1.4);
        let world = world(&robot);
        let [mut quick, mut general] = [true, false].map(|own| {
            let mut batch = Batch::<Single>::new(&Ground::Plane, &robot, 0.002, 1);
            batch.model.one_joint = own;
            batch
        });
        let (mut stuck, mut clamped, mut stopped) = (0, 0, 0);
        for _ in 0..300 {
            let start = random_start(&robot, &mut rng);
            let mut drive = Drive::idle(1, 1);
            let mut number = |scale: f64| vec![rng.random_range(0.0..scale)];
            (drive.stiffness, drive.damping, drive.friction) = (number(200.0), number(5.0), number(12.0));
            (drive.target, drive.feed_forward, drive.torque_max) = (number(2.0), number(4.0), number(20.0));
            drive.torque_min = vec![-drive.torque_max[0]];
            for batch in [&mut quick, &mut general] {
                batch.reset(0, &start, &world);
            }
            for _ in 0..100 {
                [&mut quick, &mut general]
                    .into_iter()
                    .for_each(|batch| batch.step(&drive));
            }
            let [own, other] = [&quick, &general].map(|batch| (*batch.joints()).clone());
            for (a, b) in [
                (&own.position, &other.position),
                (&own.velocity, &other.velocity),
                (&own.torque, &other.torque),
            ] {
                assert!((a[0] - b[0]).abs() < 1e-9 * (1.0 + b[0].abs()), "{own:?} {other:?}");
            }
            stuck += u32::from(own.velocity[0].abs() < 1e-12);
            clamped += u32::from(own.torque[0].abs() == drive.torque_max[0]);
            stopped += u32::from(own.position[0].abs() > 1.4 - 1e-6);
        }
        // Every branch of a row was taken.
        assert!(
            stuck > 10 && clamped > 10 && stopped > 10,
            "{stuck} {clamped} {stopped}"
        );
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

/// With a drift of `a h + b h^2`, twice that at half the step less that at the whole one is `-b h^2 / 2`, and a quarter of it is
/// left when the step is halved again. Of anything that does not vanish with the step, or no faster, at least half would be left.
#[test]
fn free_flight_conserves_energy_and_momentum_to_first_order_in_the_step() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    let seconds = 0.2;
    for robot in [
        robots::random(1, Base::Floating, 8),
        robots::random(5, Base::Floating, 12),
    ] {
        let mut begin = random_start(&robot, &mut rng);
        begin.position.z = 100.0;
        begin.joint_velocities.iter_mut().for_each(|v| *v *= 0.3);
        let steps = [4e-4, 2e-4, 1e-4];
        let drifts = steps.map(|dt| drift(&robot, &begin, Simd::Scalar, dt, seconds));
        for i in 0..3 {
            let [coarse, middle, fine] = drifts.map(|drift| drift[i]);
            let (first, second) = ((2.0 * middle - coarse).abs(), (2.0 * fine - middle).abs());
            let rounded = rounding(Simd::Scalar) * seconds / steps[2];
            assert!(second < 0.5 * first + rounded, "quantity {i}: {drifts:?}");
        }
        // What every step rounds away is carried on like a start that is off by as much in every step.
        let off = 1e-6;
        let mut moved = begin.clone();
        moved.joint_velocities.iter_mut().for_each(|v| *v += off);
        moved.angular_velocity.iter_mut().for_each(|v| *v += off);
        let growth = drift(&robot, &moved, Simd::Scalar, steps[0], seconds)
            .iter()
            .zip(drifts[0])
            .map(|(moved, drift)| (moved - drift).abs() / off)
            .fold(1.0, f64::max);
        for level in levels() {
            let bound = growth * rounding(level) * seconds / steps[0];
            let rounded = drift(&robot, &begin, level, steps[0], seconds);
            for (own, exact) in rounded.iter().zip(drifts[0]) {
                let error = (own - exact).abs();
                assert!(error <= bound, "{}: {error}, {bound} by rounding", level.name());
            }
        }
    }
}

#[test]
fn velocities_of_links_are_rates_of_their_poses() {
    let mut rng = ChaCha8Rng::seed_from_u64(11);
    for base in [Base::Floating, Base::Fixed] {
        let robot = robots::random(5, base, 12);
        let start = random_start(&robot, &mut rng);
        let (world, links): (_, Vec<_>) = (world(&robot), (0..robot.links.len()).collect());
        // Where the links are when the state has moved on for a time.
        let poses = |time: f64| {
            let mut moved = start.clone();
            moved.position += time * start.linear_velocity;
            moved.orientation = UnitQuaternion::from_scaled_axis(time * start.angular_velocity) * start.orientation;
            for (joint, velocity) in moved.joints.iter_mut().zip(&start.joint_velocities) {
                *joint += time * velocity;
            }
            let mut poses = vec![nalgebra::IsometryMatrix3::identity(); links.len()];
            single(&robot, 1e-3, Simd::Scalar, &moved, &world).link_poses(&links, &mut poses);
            poses
        };
        let h = 1e-5;
        let (before, after) = (poses(-h), poses(h));
        for level in levels() {
            let found = single(&robot, 1e-3, level, &start, &world).link_velocities(0);
            assert_eq!(found.len(), links.len());
            for (link, [origin, turn]) in found.into_iter().enumerate() {
                let moved = (after[link].translation.vector - before[link].translation.vector) / (2.0 * h);
                // The sine of so small an angle instead of the angle, of which a cosine knows too little.
                let turn_matrix = (after[link].rotation * before[link].rotation.inverse()).into_inner();
                let skew = (turn_matrix - turn_matrix.transpose()) / (4.0 * h);
                let turned = Vector3::new(skew.m32, skew.m13, skew.m21);
                // Of some m/s and rad/s over twelve joints; the differences' own error goes with h^2.
                let bound = 1e-6 + 100.0 * rounding(level);
                assert!((origin - moved).norm() < bound, "{level:?} {link}: {origin} {moved}");
                assert!((turn - turned).norm() < bound, "{level:?} {link}: {turn} {turned}");
            }
        }
    }
}
