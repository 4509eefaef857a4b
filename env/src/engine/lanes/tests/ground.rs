//! Ground that is no level plane.

use std::sync::Arc;

use nalgebra::UnitQuaternion;

use super::robots;
use super::*;
use crate::ground::{CELLS, Field, Ground};

const MASS: f64 = 3.0;
const SIZE: [f64; 3] = [0.3, 0.2, 0.1];
/// Normal stiffness of a contact point, N/m, and the force with which it creeps at 1 m/s.
const STIFFNESS: f64 = 1e5;
const SLIP_DAMPING: f64 = 2e6;
/// How deep a corner may be when two of them carry everything, m.
const SETTLING: f64 = MASS * GRAVITY / (2.0 * STIFFNESS);

/// A field of the height that `height` gives, 10 cm a cell.
fn field(height: impl Fn(f64, f64) -> f64) -> Ground {
    let at = |i: usize| (i as f64 - 0.5 * CELLS as f64) * 0.1;
    let corners = (0..=CELLS).flat_map(|i| (0..=CELLS).map(move |j| (i, j)));
    Ground::Field(Arc::new(Field {
        cell: 0.1,
        heights: corners.map(|(i, j)| height(at(i), at(j))).collect(),
    }))
}

fn on(ground: &Ground, robot: &Robot, dt: f64, level: Simd, start: &Start, world: &World) -> Lanes {
    let mut engine = Lanes::on(ground, robot, dt, 1, level).expect("level is available");
    engine.reset(0, start, world);
    engine
}

/// A block that lies on a slope.
fn lying(robot: &Robot, ground: &Ground) -> Start {
    let normal = ground.at(0.0, 0.0).normal();
    let orientation = UnitQuaternion::rotation_between(&Vector3::z(), &normal).expect("not upside down");
    Start {
        position: normal * (0.5 * SIZE[2]),
        orientation,
        ..Start::nominal(robot)
    }
}

/// Where a block is after a second on `ground`, from where it started.
fn slid(ground: &Ground, tangential: f64, dt: f64, level: Simd) -> Vector3<f64> {
    let robot = robots::block(MASS, SIZE);
    let mut world = world(&robot);
    world.friction.tangential = tangential;
    let start = lying(&robot, ground);
    let mut engine = on(ground, &robot, dt, level, &start, &world);
    for _ in 0..(1.0 / dt) as usize {
        engine.step(&Drive::idle(0, 1));
    }
    engine.base(0).position - start.position
}

#[test]
fn block_on_a_slope_slides_only_beyond_its_friction_and_then_as_it_should() {
    let angle = 0.2_f64;
    for (ground, downhill) in [
        (
            Ground::Slope([angle.tan(), 0.0]),
            Vector3::new(-angle.cos(), 0.0, -angle.sin()),
        ),
        (
            Ground::Slope([0.0, -angle.tan()]),
            Vector3::new(0.0, angle.cos(), -angle.sin()),
        ),
        (
            field(|x, _| angle.tan() * x),
            Vector3::new(-angle.cos(), 0.0, -angle.sin()),
        ),
    ] {
        for level in levels() {
            for dt in [0.005, 0.002] {
                let pull = GRAVITY * angle.sin();
                let margin = 0.02;
                let holds = slid(&ground, (1.0 + margin) * angle.tan(), dt, level);
                // At worst there is no friction yet in the first step, and its slip ends by what friction has to spare.
                let slip = (pull * dt).powi(2) / (2.0 * margin * pull);
                let creep = MASS * pull / SLIP_DAMPING;
                assert!(
                    holds.norm() < SETTLING + slip + creep,
                    "{} at {dt}: {holds}",
                    level.name()
                );
                let mu = 0.5 * angle.tan();
                let way = slid(&ground, mu, dt, level);
                let acceleration = pull - mu * GRAVITY * angle.cos();
                // Semi-implicit Euler is half a step of the final speed ahead; one more for a first step without friction.
                let error = way.dot(&downhill) - 0.5 * acceleration;
                let bound = (0.5 * acceleration + mu * GRAVITY * angle.cos()) * dt + SETTLING;
                assert!(error.abs() < bound, "{} at {dt}: {way}", level.name());
                let aside = (way - downhill * way.dot(&downhill)).norm();
                assert!(aside < SETTLING, "{} at {dt}: {way}", level.name());
            }
        }
    }
}

#[test]
fn block_at_rest_on_a_slope_presses_with_its_weight() {
    let robot = robots::block(MASS, SIZE);
    let ground = Ground::Slope([0.1, -0.15]);
    for level in levels() {
        let mut engine = on(&ground, &robot, 0.005, level, &lying(&robot, &ground), &world(&robot));
        (0..600).for_each(|_| engine.step(&Drive::idle(0, 1)));
        let error = engine.foot_force(0, 0) - Vector3::z() * MASS * GRAVITY;
        assert!(error.norm() < 1e-3 * MASS * GRAVITY, "{}: off by {error}", level.name());
    }
}

/// Base positions of a biped that comes down on `ground`.
fn coming_down(ground: &Ground, level: Simd, begin: &Start, steps: usize) -> Vec<Vector3<f64>> {
    let robot = robots::biped();
    let mut world = world(&robot);
    (world.friction.torsional, world.friction.rolling) = (0.02, 0.01);
    let drive = hold(&robot);
    let mut engine = on(ground, &robot, 0.005, level, begin, &world);
    let position = |_| {
        engine.step(&drive);
        engine.base(0).position
    };
    (0..steps).map(position).collect()
}

#[test]
fn a_field_of_no_height_is_the_plane() {
    let robot = robots::biped();
    let mut begin = Start::nominal(&robot);
    begin.position.z += 0.05;
    begin.linear_velocity = Vector3::new(0.3, 0.2, 0.0);
    let [flat, field] = [Ground::Plane, field(|_, _| 0.0)];
    let apart = |a: &[Vector3<f64>], b: &[Vector3<f64>]| {
        a.iter().zip(b).fold(0.0_f64, |worst, (a, b)| worst.max((a - b).norm()))
    };
    let exact = coming_down(&flat, Simd::Scalar, &begin, 400);
    assert!(exact == coming_down(&field, Simd::Scalar, &begin, 400));
    // Heights above the ground are found in f64 there, so only lanes in f64 can agree to the bit. In others a point's height is
    // the sum of the base's and its own below that, rounded. Points at one end of a sole that are off are a robot that is tilted.
    let (off, steps) = (1e-6, 40);
    let sole = robot.feet[0].half_extents;
    let mut growth = 0.0_f64;
    for turn in [Vector3::zeros(), Vector3::x() / sole[1], Vector3::y() / sole[0]] {
        let mut moved = begin.clone();
        moved.position.z += off;
        moved.orientation = UnitQuaternion::from_scaled_axis(turn * off) * moved.orientation;
        growth = growth.max(apart(&coming_down(&flat, Simd::Scalar, &moved, steps), &exact) / off);
    }
    for level in levels() {
        let error = apart(
            &coming_down(&flat, level, &begin, steps),
            &coming_down(&field, level, &begin, steps),
        );
        let bound = growth * 2.0 * epsilon(level) * begin.position.z * steps as f64;
        assert!(error <= bound, "{}: {error} m, {bound} m by rounding", level.name());
    }
}

#[test]
fn a_block_dropped_on_rough_ground_comes_to_rest_above_it() {
    let robot = robots::block(MASS, SIZE);
    let steepest = 0.02 * 7.0_f64.hypot(9.0);
    let ground = field(|x, y| 0.02 * ((7.0 * x).sin() + (9.0 * y + 1.0).cos()));
    let mut begin = Start::nominal(&robot);
    begin.position.z += 0.1;
    let (own, weight, dt) = (world(&robot), MASS * GRAVITY, 0.005);
    // No point can press with more than the weight over the share of its force that is upwards where its friction pulls it down
    // the steepest place.
    let share = |gradient: f64| (1.0 - own.friction.tangential * gradient) / gradient.hypot(1.0);
    let largest = weight / share(steepest);
    for level in levels() {
        let mut engine = on(&ground, &robot, dt, level, &begin, &own);
        (0..1000).for_each(|_| engine.step(&Drive::idle(0, 1)));
        // A block that lies creeps; its points share what holds it, each pressed at most like this.
        let before = engine.base(0).linear_velocity;
        let creep = own.friction.tangential * largest / SLIP_DAMPING;
        assert!(before.norm() < 2.0 * creep, "{}: {before}", level.name());
        let (mut force, steps) = (Vector3::zeros(), 200);
        for _ in 0..steps {
            engine.step(&Drive::idle(0, 1));
            force += engine.foot_force(0, 0) / f64::from(steps);
        }
        // The mean force is the weight and the change of momentum; a sum in single precision of forces of the weight's size.
        let base = engine.base(0);
        let expected = Vector3::z() * weight + (base.linear_velocity - before) * MASS / (f64::from(steps) * dt);
        let rounding = f64::from(f32::EPSILON) * 16.0 * weight;
        let off = (force - expected).norm();
        assert!(off < rounding, "{}: {force}, not {expected}", level.name());
        for corner in robot.feet[0].corners() {
            let corner = base.orientation * corner.coords + base.position;
            // Depth is along the normal, and this is upright.
            let depth = ground.height(corner.x, corner.y) - corner.z;
            let bound = largest / STIFFNESS * steepest.hypot(1.0);
            assert!(depth < bound, "{}: {depth} m deep", level.name());
        }
    }
}
