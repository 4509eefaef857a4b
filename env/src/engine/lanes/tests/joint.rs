//! Joints against analytic results: period, step response, clamp, limits, dry friction.

use super::robots;
use super::*;

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

#[test]
fn step_response_approaches_the_analytic_one_in_proportion_to_the_step() {
    let robot = robots::slider();
    let (mass, k, d): (f64, f64, f64) = (2.0, 200.0, 30.0);
    let (rate, decay) = (
        (k / mass - (d / (2.0 * mass)) * (d / (2.0 * mass))).sqrt(),
        d / (2.0 * mass),
    );
    let exact = |t: f64| 0.1 * (1.0 - (-decay * t).exp() * ((rate * t).cos() + decay / rate * (rate * t).sin()));
    for level in levels() {
        let error = |dt: f64| {
            let weightless = World {
                gravity: Vector3::zeros(),
                ..world(&robot)
            };
            let mut engine = single(&robot, dt, level, &Start::nominal(&robot), &weightless);
            let mut drive = Drive::idle(1, 1);
            (drive.target[0], drive.stiffness[0], drive.damping[0]) = (0.1, k, d);
            (drive.torque_min[0], drive.torque_max[0]) = (-1e3, 1e3);
            let mut worst = 0.0_f64;
            for step in 1..=(0.5 / dt) as usize {
                engine.step(&drive);
                worst = worst.max((engine.joints().position[0] - exact(step as f64 * dt)).abs());
            }
            worst
        };
        let (coarse, fine) = (error(0.004), error(0.002));
        assert!(
            coarse < 0.01 && (1.7..2.3).contains(&(coarse / fine)),
            "{}: {coarse}, {fine}",
            level.name()
        );
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

#[test]
fn joint_rests_on_its_limit() {
    let mut robot = robots::double_pendulum();
    robot.joints[0].limits = (-0.3, 0.4);
    robot.joints[1].limits = (-0.5, 0.2);
    let mut tilted = world(&robot);
    tilted.gravity = Vector3::new(9.0, 0.0, 0.0);
    for level in levels() {
        let mut engine = single(&robot, 0.005, level, &Start::nominal(&robot), &tilted);
        for step in 0..2000 {
            engine.step(&Drive::idle(2, 1));
            for (q, (lower, upper)) in engine.joints().position.iter().zip([(-0.3, 0.4), (-0.5, 0.2)]) {
                assert!(
                    *q > lower - 1e-3 && *q < upper + 1e-3,
                    "{}: {q} at step {step}",
                    level.name()
                );
            }
        }
        let joints = engine.joints();
        assert!(
            (joints.position[0] + 0.3).abs() < 1e-3,
            "{}: {:?}",
            level.name(),
            joints.position
        );
        assert!(
            (joints.position[1] + 0.5).abs() < 1e-3,
            "{}: {:?}",
            level.name(),
            joints.position
        );
        assert!(joints.velocity.iter().all(|v| v.abs() < 1e-4));
    }
}

#[test]
fn dry_friction_holds_up_to_its_bound_and_slides_beyond() {
    let robot = robots::slider();
    let weight = 2.0 * GRAVITY;
    for level in levels() {
        for (share, seconds) in [(1.05, 2.0), (0.8, 0.5)] {
            let mut engine = single(&robot, 0.002, level, &Start::nominal(&robot), &world(&robot));
            let mut drive = Drive::idle(1, 1);
            drive.friction[0] = share * weight;
            for _ in 0..(seconds / 0.002) as usize {
                engine.step(&drive);
            }
            let expected = if share > 1.0 {
                0.0
            } else {
                -0.5 * (1.0 - share) * GRAVITY * seconds * seconds
            };
            let q = engine.joints().position[0];
            // Semi-implicit Euler is off by half a step's velocity.
            let bound = 0.5 * 0.002 * (1.0 - share).max(0.0) * GRAVITY * seconds + 1e-5;
            assert!((q - expected).abs() < bound, "{}: {q} of {expected}", level.name());
        }
    }
}
