//! Joints against analytic results: period, step response, clamp, limits, dry friction.

use super::order::{agree, distance};
use super::reference::Reference;
use super::robots;
use super::*;
use crate::engine::lanes::engine::Batch;
use crate::engine::lanes::joint::LIMIT_RECOVERY;
use crate::engine::lanes::lane::Single;
use crate::engine::lanes::model::SWEEPS;
use crate::ground::Ground;

/// A pendulum's engine with its joint at `angle`.
fn swinging(robot: &Robot, dt: f64, level: Simd, angle: f64) -> Lanes {
    let mut begin = Start::nominal(robot);
    begin.joints[0] = angle;
    single(robot, dt, level, &begin, &world(robot))
}

#[test]
fn pendulum_swings_with_its_period() {
    let robot = robots::pendulum();
    let own = &robot.links[1].inertial;
    let inertia = own.inertia[(1, 1)] + own.mass * own.com.norm_squared();
    let small = std::f64::consts::TAU * (inertia / (own.mass * GRAVITY * own.com.norm())).sqrt();
    let amplitude = 0.05_f64;
    let period = small * (1.0 + amplitude * amplitude / 16.0);
    for level in levels() {
        let (dt, steps) = (0.001, 20_000);
        let mut engine = swinging(&robot, dt, level, amplitude);
        let mut crossings = vec![];
        let mut before = amplitude;
        for step in 0..steps {
            engine.step(&Drive::idle(1, 1));
            let q = engine.joints().position[0];
            if before > 0.0 && q <= 0.0 {
                crossings.push((step as f64 + before / (before - q)) * dt);
            }
            before = q;
        }
        let count = (crossings.len() - 1) as f64;
        let measured = (crossings[crossings.len() - 1] - crossings[0]) / count;
        // Semi-implicit Euler is symplectic: its period is off by (w dt)^2 / 24. The amplitude's next order is 11 / 3072. What is
        // rounded of the phase in a step, at random, adds up as the root of the steps.
        let angle = std::f64::consts::TAU / period * dt;
        let random = rounding(level) / (angle * f64::from(steps).sqrt());
        let bound = angle.powi(2) / 24.0 + 11.0 / 3072.0 * amplitude.powi(4) + random;
        assert!(
            (measured / period - 1.0).abs() < bound,
            "{}: {measured} s of {period} s",
            level.name()
        );
    }
}

/// Positions of a slider every 4 ms of a step response of half a second, and its largest position or velocity, m or m/s; at the
/// start position and velocity are off by `off`.
fn step_response(level: Simd, gains: (f64, f64), dt: f64, off: f64) -> (Vec<f64>, f64) {
    let robot = robots::slider();
    let weightless = World {
        gravity: Vector3::zeros(),
        ..world(&robot)
    };
    let mut begin = Start::nominal(&robot);
    (begin.joints[0], begin.joint_velocities[0]) = (off, off);
    let mut engine = single(&robot, dt, level, &begin, &weightless);
    let mut drive = Drive::idle(1, 1);
    (drive.target[0], drive.stiffness[0], drive.damping[0]) = (0.1, gains.0, gains.1);
    (drive.torque_min[0], drive.torque_max[0]) = (-1e3, 1e3);
    let (mut samples, mut largest) = (vec![], 0.0_f64);
    for step in 1..=(0.5 / dt).round() as usize {
        engine.step(&drive);
        let (q, v) = (engine.joints().position[0], engine.joints().velocity[0]);
        largest = largest.max(q.abs()).max(v.abs());
        if step % (0.004 / dt).round() as usize == 0 {
            samples.push(q);
        }
    }
    (samples, largest)
}

#[test]
fn step_response_approaches_the_analytic_one_in_proportion_to_the_step() {
    let (mass, k, d): (f64, f64, f64) = (2.0, 200.0, 30.0);
    let decay = d / (2.0 * mass);
    let rate = (k / mass - decay * decay).sqrt();
    let exact = |t: f64| 0.1 * (1.0 - (-decay * t).exp() * ((rate * t).cos() + decay / rate * (rate * t).sin()));
    let exact: Vec<_> = (1..=125).map(|n| exact(0.004 * f64::from(n))).collect();
    let steps = [0.004, 0.002, 0.001];
    let motions = steps.map(|dt| step_response(Simd::Scalar, (k, d), dt, 0.0).0);
    agree(&motions.clone().map(|motion| [motion, exact.clone()]));
    // What a step rounds of position and velocity is carried on as a start that is off.
    let off = 1e-6;
    let growth = distance(&step_response(Simd::Scalar, (k, d), steps[0], off).0, &motions[0]) / off;
    for level in levels() {
        let (motion, largest) = step_response(level, (k, d), steps[0], 0.0);
        let bound = growth * rounding(level) * largest * motion.len() as f64;
        let error = distance(&motion, &motions[0]);
        assert!(error <= bound, "{}: {error} m, {bound} m by rounding", level.name());
    }
}

/// The drive's law at the end of a step.
fn law(drive: &Drive, q: f64, v: f64) -> f64 {
    let free = drive.stiffness[0] * (drive.target[0] - q) - drive.damping[0] * v + drive.feed_forward[0];
    free.clamp(drive.torque_min[0], drive.torque_max[0])
}

#[test]
fn torque_obeys_the_clamped_law_at_the_end_of_every_step() {
    let robot = robots::slider();
    for level in levels() {
        let mut engine = single(&robot, 0.005, level, &Start::nominal(&robot), &world(&robot));
        let mut drive = Drive::idle(1, 1);
        (drive.stiffness[0], drive.damping[0], drive.feed_forward[0]) = (2000.0, 120.0, 5.0);
        (drive.torque_min[0], drive.torque_max[0]) = (-40.0, 60.0);
        let mut saturated = 0;
        for step in 0..1000 {
            drive.target[0] = if step / 100 % 2 == 0 { 0.1 } else { -0.1 };
            let before = engine.joints().velocity[0];
            engine.step(&drive);
            let joints = engine.joints();
            let (q, v, torque) = (joints.position[0], joints.velocity[0], joints.torque[0]);
            // All but rounding of the terms.
            let terms =
                drive.stiffness[0] * (drive.target[0].abs() + q.abs()) + drive.damping[0] * v.abs() + torque.abs();
            assert!(
                (torque - law(&drive, q, v)).abs() < rounding(level) * terms,
                "{}: {torque} at {step}",
                level.name()
            );
            let needed = 2.0 * ((v - before) / 0.005 + GRAVITY);
            let terms = 2.0 * (v.abs() + before.abs()) / 0.005 + 2.0 * GRAVITY + torque.abs();
            assert!(
                (needed - torque).abs() < rounding(level) * terms,
                "{}: {needed} instead of {torque} at {step}",
                level.name()
            );
            saturated += usize::from(!(-39.99..=59.99).contains(&torque));
        }
        assert!((100..900).contains(&saturated), "{saturated} saturated steps");
    }
}

/// Two rods that are pulled sideways onto their limits, and the world that does it.
fn leaning() -> (Robot, World) {
    let mut robot = robots::double_pendulum();
    robot.joints[0].limits = (-0.3, 0.4);
    robot.joints[1].limits = (-0.5, 0.2);
    let mut tilted = world(&robot);
    tilted.gravity = Vector3::new(9.0, 0.0, 0.0);
    (robot, tilted)
}

/// By how much each joint is beyond its limits now.
fn beyond(robot: &Robot, engine: &impl Engine) -> [f64; 2] {
    let of = |d: usize| {
        let (q, (lower, upper)) = (engine.joints().position[d], robot.joints[d].limits);
        (lower - q).max(q - upper)
    };
    [of(0), of(1)]
}

#[test]
fn joint_comes_no_farther_than_its_limit() {
    let (robot, tilted) = leaning();
    let (dt, steps, farthest) = (0.005, 2000, 0.5);
    // A step that is solved ends at the limit, but for the rounding of the position.
    let mut engine = Batch::<Single>::new(&Ground::Plane, &robot, dt, 1);
    engine.model.sweeps = 1000;
    engine.reset(0, &Start::nominal(&robot), &tilted);
    for step in 0..steps {
        engine.step(&Drive::idle(2, 1));
        let (beyond, rounded) = (beyond(&robot, &engine), rounding(Simd::Scalar) * farthest);
        assert!(
            beyond.iter().all(|&b| b < rounded),
            "{beyond:?} rad, {rounded} by rounding at {step}"
        );
    }
    // A sweep ends with the second joint, so that one is where it should be after any number of them. What stops the second moves
    // the first by the quotient of their entries of the mass matrix, and every sweep leaves of the first's error as much as the
    // matrix couples the two, most when the rods are in line.
    let mass = Reference::new(&robot, &Start::nominal(&robot), &tilted).mass_matrix;
    let moved = mass[(0, 1)] / mass[(0, 0)];
    let coupling = moved * mass[(0, 1)] / mass[(1, 1)];
    let left = coupling.powi(SWEEPS as i32);
    for level in levels() {
        let mut engine = single(&robot, dt, level, &Start::nominal(&robot), &tilted);
        let rounded = rounding(level) * farthest;
        let (mut before, mut changed, mut error, mut known) = ([0.0; 2], [0.0; 2], 0.0, 0.0);
        for step in 0..steps {
            engine.step(&Drive::idle(2, 1));
            // A step begins with the impulses of the one before: what the sweeps have to find is by how much the speeds change
            // otherwise than in that one, and what that one has left. Of what is beyond, a share is undone.
            let speed = [0, 1].map(|d| engine.joints().velocity[d]);
            let change = [0, 1].map(|d| speed[d] - before[d]);
            let [first, second] = [0, 1].map(|d: usize| f64::abs(change[d] - changed[d]));
            error = left * (first + error) + left / coupling * moved * second;
            known = (1.0 - LIMIT_RECOVERY) * known + dt * error;
            (before, changed) = (speed, change);
            let [first, second] = beyond(&robot, &engine);
            let name = format!("{} at {step}", level.name());
            assert!(
                first < known + rounded,
                "{name}: {first} rad, {known} rad by the sweeps"
            );
            assert!(second < rounded, "{name}: {second} rad, {rounded} rad by rounding");
        }
    }
}

#[test]
fn joint_rests_on_its_limit() {
    let (robot, tilted) = leaning();
    let dt = 0.005;
    for level in levels() {
        let mut engine = single(&robot, dt, level, &Start::nominal(&robot), &tilted);
        (0..2000).for_each(|_| engine.step(&Drive::idle(2, 1)));
        let joints = engine.joints();
        for (d, limit) in [-0.3_f64, -0.5].into_iter().enumerate() {
            // A step undoes a share of what is beyond the limit, which is known but for the rounding of the position: as fast as
            // rounding moves it in a step, and by what stays when rounding adds as much as is undone.
            let (off, speed) = ((joints.position[d] - limit).abs(), joints.velocity[d].abs());
            let rounded = rounding(level) * limit.abs();
            let name = format!("{}, joint {d}", level.name());
            assert!(off < rounded / LIMIT_RECOVERY, "{name}: {off} rad off {rounded}");
            assert!(speed < rounded / dt, "{name}: {speed} rad/s");
        }
    }
}

#[test]
fn dry_friction_holds_up_to_its_bound_and_slides_beyond() {
    let robot = robots::slider();
    let (weight, dt) = (2.0 * GRAVITY, 0.002);
    for level in levels() {
        for (share, seconds) in [(1.05, 2.0), (0.8, 0.5)] {
            let mut engine = single(&robot, dt, level, &Start::nominal(&robot), &world(&robot));
            let mut drive = Drive::idle(1, 1);
            drive.friction[0] = share * weight;
            let steps = (seconds / dt) as usize;
            for _ in 0..steps {
                engine.step(&drive);
            }
            // Semi-implicit Euler moves with the velocity at the end of a step.
            let n = steps as f64;
            let acceleration = (1.0 - share).max(0.0) * GRAVITY;
            let expected = -0.5 * acceleration * dt * dt * n * (n + 1.0);
            let q = engine.joints().position[0];
            // Every step rounds what gravity and friction make of the velocity. Where friction holds, the next step takes it away;
            // where it slides, it stays, and of the way every step rounds too.
            let speed = rounding(level) * GRAVITY * dt;
            let bound = if share > 1.0 {
                speed * seconds
            } else {
                0.5 * n * speed * seconds + n * rounding(level) * expected.abs()
            };
            assert!(
                (q - expected).abs() < bound,
                "{}: {q} of {expected}, {bound} by rounding",
                level.name()
            );
        }
    }
}
