//! Sliding, spinning, rolling and falling bodies on the ground against analytic results.

use nalgebra::Point3;

use super::order::{agree, distance};
use super::robots;
use super::*;
use crate::engine::lanes::contact::{DAMPING, STIFFNESS};
use crate::engine::lanes::friction::{SLIP_DAMPING, TURN_DAMPING};

/// Semi-implicit Euler moves with the velocity at the end of a step: of a stop at constant deceleration that is half a step at the
/// first speed too little, and what the last step is cut short by is at most what the deceleration does in a step. `give` is
/// how far the contact's springs let the body settle meanwhile.
fn assert_stops(name: &str, way: f64, exact: f64, speed: f64, dt: f64, give: f64) {
    let deceleration = speed * speed / (2.0 * exact);
    let expected = exact - 0.5 * speed * dt;
    let bound = deceleration * dt * dt + give;
    assert!(
        (way - expected).abs() < bound,
        "{name}: {way}, not {expected} within {bound}"
    );
}

/// As deep as its weight presses the block's four points: the normal force is there from the first step on.
fn pressed(robot: &Robot) -> Start {
    let mut begin = Start::nominal(robot);
    begin.position.z -= robot.mass() * GRAVITY / (4.0 * STIFFNESS);
    begin
}

#[test]
fn block_stops_after_the_distance_that_friction_gives() {
    let robot = robots::block(3.0, [0.3, 0.2, 0.1]);
    let (speed, mu, weight) = (1.0, 0.5, 3.0 * GRAVITY);
    let exact = speed * speed / (2.0 * mu * GRAVITY);
    for level in levels() {
        for dt in [0.004, 0.002, 0.001] {
            let name = format!("{} at {dt} s", level.name());
            let mut begin = pressed(&robot);
            let heading = Vector3::new(0.8, 0.6, 0.0);
            begin.linear_velocity = heading * speed;
            let world = World::nominal(&robot, friction(mu, 0.01, 0.01));
            let mut engine = single(&robot, dt, level, &begin, &world);
            for _ in 0..(1.0 / dt) as usize {
                engine.step(&Drive::idle(0, 1));
            }
            let way = engine.base(0).position - begin.position;
            // It nods as it brakes, by no more than two points sink in when they carry it alone.
            let nod = weight / (2.0 * STIFFNESS);
            assert_stops(&name, way.dot(&heading), exact, speed, dt, nod);
            assert!(way.cross(&heading).xy().norm() < nod);
            // What its points hold against one another when it has stopped creeps.
            let creep = mu * weight / SLIP_DAMPING;
            assert!(engine.base(0).linear_velocity.norm() < creep);
        }
    }
}

#[test]
fn spinning_block_stops_after_the_angle_that_torsional_friction_gives() {
    let (mass, size) = (3.0, [0.3, 0.3, 0.1]);
    let robot = robots::block(mass, size);
    let (rate, mu) = (2.0, 0.03);
    let inertia = robot.links[0].inertial.inertia[(2, 2)];
    let exact = 0.5 * inertia * rate * rate / (mu * mass * GRAVITY);
    for level in levels() {
        for dt in [0.004, 0.002, 0.001] {
            let name = format!("{} at {dt} s", level.name());
            let mut begin = pressed(&robot);
            begin.angular_velocity = Vector3::z() * rate;
            let world = World::nominal(&robot, friction(0.0, mu, 0.0));
            let mut engine = single(&robot, dt, level, &begin, &world);
            for _ in 0..(1.0 / dt) as usize {
                engine.step(&Drive::idle(0, 1));
            }
            let angle = engine.base(0).orientation.scaled_axis().z;
            assert_stops(&name, angle, exact, rate, dt, 0.0);
            let creep = mu * mass * GRAVITY / TURN_DAMPING;
            assert!(engine.base(0).angular_velocity.norm() < creep);
        }
    }
}

/// A body whose only contact point is its centre of mass turns about it against rolling friction alone.
#[test]
fn rolling_body_stops_after_the_angle_that_rolling_friction_gives() {
    let (mass, size) = (3.0, [0.3, 0.2, 0.1]);
    let mut robot = robots::block(mass, size);
    robot.links[0].contact_points = vec![Point3::origin()];
    let (rate, mu) = (2.0, 0.03);
    for level in levels() {
        for (axis, moment) in [(Vector3::x(), (0, 0)), (Vector3::y(), (1, 1))] {
            let inertia = robot.links[0].inertial.inertia[moment];
            let exact = 0.5 * inertia * rate * rate / (mu * mass * GRAVITY);
            for dt in [0.004, 0.002, 0.001] {
                let name = format!("{} at {dt} s", level.name());
                let begin = Start {
                    // As deep as its weight presses the point.
                    position: Vector3::z() * (-mass * GRAVITY / STIFFNESS),
                    angular_velocity: axis * rate,
                    ..Start::nominal(&robot)
                };
                let world = World::nominal(&robot, friction(0.5, 0.0, mu));
                let mut engine = single(&robot, dt, level, &begin, &world);
                for _ in 0..(1.0 / dt) as usize {
                    engine.step(&Drive::idle(0, 1));
                }
                let angle = engine.base(0).orientation.scaled_axis().dot(&axis);
                assert_stops(&name, angle, exact, rate, dt, 0.0);
                let creep = mu * mass * GRAVITY / TURN_DAMPING;
                assert!(engine.base(0).angular_velocity.norm() < creep);
            }
        }
    }
}

/// Speed (m/s) and spin (rad/s) every 4 ms of a body that slides and spins at once on the one point that is its centre of mass,
/// in the engine.
fn slides_and_spins(robot: &Robot, level: Simd, coefficients: [f64; 2], begin: [f64; 2], dt: f64) -> Vec<f64> {
    let own = Start {
        // As deep as its weight presses the point.
        position: Vector3::z() * (-robot.mass() * GRAVITY / STIFFNESS),
        linear_velocity: Vector3::x() * begin[0],
        angular_velocity: Vector3::z() * begin[1],
        ..Start::nominal(robot)
    };
    let world = World::nominal(robot, friction(coefficients[0], coefficients[1], 0.0));
    let mut engine = single(robot, dt, level, &own, &world);
    let mut samples = vec![];
    for _ in 0..40 {
        (0..(0.004 / dt).round() as usize).for_each(|_| engine.step(&Drive::idle(0, 1)));
        let base = engine.base(0);
        samples.extend([base.linear_velocity.x, base.angular_velocity.z]);
    }
    samples
}

/// The same by the one cone in steps far too small to matter. Of all (force f, moment t) with
/// `(f / mu)^2 + (t / mu_z)^2 <= N^2` friction takes the one that takes most power from speed v and spin w:
/// `f = -N mu^2 v / s`, `t = -N mu_z^2 w / s` with `s^2 = (mu v)^2 + (mu_z w)^2`. The point's share of either speed that is its
/// creep does not count.
fn by_one_cone(robot: &Robot, [mu, mu_z]: [f64; 2], [mut v, mut w]: [f64; 2]) -> Vec<f64> {
    let (weight, inertia) = (robot.mass() * GRAVITY, robot.links[0].inertial.inertia[(2, 2)]);
    let steps = 10_000;
    let dt = 0.004 / f64::from(steps);
    let (mut force, mut moment) = (0.0, 0.0);
    let mut samples = vec![];
    for _ in 0..40 {
        for _ in 0..steps {
            // The mean of a step's ends. Creep is that of the force just before: it is as good as still.
            let mut slope = |v: f64, w: f64| {
                let (slip, turn) = (v + force / SLIP_DAMPING, w + moment / TURN_DAMPING);
                let share = weight / (mu * slip).hypot(mu_z * turn);
                (force, moment) = (-share * mu * mu * slip, -share * mu_z * mu_z * turn);
                (force / robot.mass(), moment / inertia)
            };
            let (a, b) = slope(v, w);
            let (c, d) = slope(v + dt * a, w + dt * b);
            (v, w) = (v + 0.5 * dt * (a + c), w + 0.5 * dt * (b + d));
        }
        samples.extend([v, w]);
    }
    samples
}

/// Sliding and spinning share one cone: each is braked less than it would be alone, as the ellipse says.
#[test]
fn friction_is_shared_between_sliding_and_spinning_along_one_ellipse() {
    let mut robot = robots::block(3.0, [0.3, 0.3, 0.1]);
    robot.links[0].contact_points = vec![Point3::origin()];
    let gyration = robot.links[0].inertial.inertia[(2, 2)] / robot.mass();
    // The first mostly slides, the second mostly spins.
    for coefficients in [[0.4, 0.03], [0.2, 0.06]] {
        let begin = [1.0, 8.0];
        let exact = by_one_cone(&robot, coefficients, begin);
        agree(&[0.004, 0.002, 0.001].map(|dt| {
            let own = slides_and_spins(&robot, Simd::Scalar, coefficients, begin, dt);
            [own, exact.clone()]
        }));
        let [v, w] = [exact[exact.len() - 2], exact[exact.len() - 1]];
        let seconds = 0.16;
        let alone = [coefficients[0] * GRAVITY, coefficients[1] * GRAVITY / gyration].map(|rate| rate * seconds);
        let lost = [begin[0] - v, begin[1] - w];
        assert!(lost[0] < alone[0] && lost[1] < alone[1], "{lost:?} of {alone:?} alone");
        // What a step rounds is carried on as a start that is off.
        let (dt, off) = (0.004, 1e-6);
        let scalar = slides_and_spins(&robot, Simd::Scalar, coefficients, begin, dt);
        let moved = slides_and_spins(&robot, Simd::Scalar, coefficients, begin.map(|x| x + off), dt);
        let growth = distance(&moved, &scalar) / off;
        for level in levels() {
            let error = distance(&slides_and_spins(&robot, level, coefficients, begin, dt), &scalar);
            let bound = growth * rounding(level) * begin[1] * 40.0;
            assert!(error <= bound, "{}: {error}, {bound} by rounding", level.name());
        }
    }
}

/// In flight semi-implicit Euler's parabola; then the ground's impulse is what the weight gave and the block has not, and the
/// springs of the four points carry it. All but for rounding, at whatever step. Friction may hold it askew, with two points
/// carrying it, and what it holds so creeps.
#[test]
fn dropped_block_falls_freely_and_comes_to_rest_on_its_springs() {
    let size = [0.3, 0.2, 0.1];
    let robot = robots::block(3.0, size);
    let (height, weight, seconds) = (0.5, 3.0 * GRAVITY, 2.0);
    let ground = Start::nominal(&robot).position.z;
    for (level, mu) in levels().flat_map(|level| [(level, 0.0), (level, 0.6)]) {
        for dt in [0.005, 0.001] {
            let name = format!("{} at {dt} s, coefficient {mu}", level.name());
            let mut begin = Start::nominal(&robot);
            begin.position.z += height;
            let world = World::nominal(&robot, friction(mu, 0.0, 0.0));
            let mut engine = single(&robot, dt, level, &begin, &world);
            let (mut impulse, steps) = (0.0, (seconds / dt) as usize);
            for n in 1..=steps {
                engine.step(&Drive::idle(0, 1));
                impulse += engine.foot_force(0, 0).z * dt;
                let flight = begin.position.z - 0.5 * GRAVITY * dt * dt * (n * (n + 1)) as f64;
                if flight > ground {
                    let error = (engine.base(0).position.z - flight).abs();
                    let bound = rounding(level) * n as f64 * height;
                    assert!(error < bound, "{name}: {error} m in flight, {bound} m by rounding");
                }
            }
            let base = engine.base(0);
            let missing = impulse - weight * seconds - 3.0 * base.linear_velocity.z;
            // Of the sum, and of every step's share of it.
            let bound = (rounding(level) + steps as f64 * f64::EPSILON) * weight * seconds;
            assert!(missing.abs() < bound, "{name}: {missing} N s, {bound} N s by rounding");

            let tilt = if mu > 0.0 {
                weight / (2.0 * STIFFNESS) / size[1]
            } else {
                0.0
            };
            let error = ground - base.position.z - weight / (4.0 * STIFFNESS);
            let rounded = rounding(level) * ground;
            let bound = rounded + 0.5 * ground * tilt * tilt;
            assert!(error.abs() < bound, "{name}: off by {error} m, {bound} m known");
            let (speed, creep) = (base.linear_velocity.norm(), mu * weight / SLIP_DAMPING);
            assert!(speed < rounded / dt + creep, "{name}: {speed} m/s");
        }
    }
}

/// A soft landing, at which the springs and dampers of the four points never let go: `m x'' = m g - 4 k x - 4 d x'`. Twice the
/// depth at half the step less that at the whole one is off by second order; what halving both steps changes of that is
/// three times what is left.
#[test]
fn landing_block_sinks_in_as_its_springs_and_dampers_say() {
    let (mass, speed) = (3.0, 0.3);
    let robot = robots::block(mass, [0.3, 0.2, 0.1]);
    let (decay, rest) = (2.0 * DAMPING / mass, mass * GRAVITY / (4.0 * STIFFNESS));
    let root = (decay * decay - 4.0 * STIFFNESS / mass).sqrt();
    let (slow, fast) = (root - decay, -root - decay);
    let share = (speed + rest * fast) / (slow - fast);
    let exact = |t: f64| rest + share * (slow * t).exp() - (rest + share) * (fast * t).exp();
    let depths = |dt: f64| -> Vec<f64> {
        let mut begin = Start::nominal(&robot);
        let ground = begin.position.z;
        begin.linear_velocity.z = -speed;
        let mut engine = single(&robot, dt, Simd::Scalar, &begin, &world(&robot));
        let every = (0.001 / dt).round() as usize;
        let sample = |_| {
            (0..every).for_each(|_| engine.step(&Drive::idle(0, 1)));
            ground - engine.base(0).position.z
        };
        (0..30).map(sample).collect()
    };
    let [coarse, middle, fine] = [2e-4, 1e-4, 5e-5].map(depths);
    let (mut error, mut known) = (0.0_f64, 0.0_f64);
    for n in 0..coarse.len() {
        let (first, second) = (2.0 * middle[n] - coarse[n], 2.0 * fine[n] - middle[n]);
        known = known.max((second - first).abs());
        error = error.max((second - exact(0.001 * (n + 1) as f64)).abs());
    }
    assert!(error < known, "{error} m, {known} m known");
}
