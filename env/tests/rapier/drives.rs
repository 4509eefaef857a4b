//! Drives against the second-order system they are, with and without torque limits.

use nalgebra::Vector3;
use omniwalk_env::engine::{Engine, Start};

use crate::robots::*;

/// Largest error over 1 s of a servo's step response at a wheel, against the analytic one.
fn step_response_error(stiffness: f64, damping: f64, dt: f64) -> f64 {
    let robot = pendulum();
    let mut model = nominal(&robot);
    model.gravity = Vector3::zeros();
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    let mut drive = servo(&robot, 1, stiffness, damping);
    drive.target[0] = 0.5;
    let decay = damping / (2.0 * PENDULUM_INERTIA);
    let frequency = (stiffness / PENDULUM_INERTIA - decay * decay).sqrt();
    let exact = |t: f64| {
        let phase = frequency * t;
        0.5 * (1.0 - (-decay * t).exp() * (phase.cos() + decay / frequency * phase.sin()))
    };
    (1..=(1.0 / dt).round() as usize).fold(0.0, |worst: f64, step| {
        engine.step(&drive);
        worst.max((engine.joints().position[0] - exact(step as f64 * dt)).abs())
    })
}

#[test]
fn servo_step_response_converges_to_the_analytic_one_in_first_order() {
    for (stiffness, damping) in [(40.0, 1.0), (400.0, 1.7)] {
        let errors = [1e-3, 5e-4, 2.5e-4].map(|dt| step_response_error(stiffness, damping, dt));
        for pair in errors.windows(2) {
            assert!((1.6..2.4).contains(&(pair[0] / pair[1])), "errors {errors:?}");
        }
    }
}

#[test]
fn stiff_servo_is_stable_at_every_rate() {
    for dt in [1e-3, 2e-3, 5e-3] {
        let robot = pendulum();
        let mut engine = single(&robot, dt, &Start::nominal(&robot), &nominal(&robot));
        let mut drive = servo(&robot, 1, 1e5, 10.0);
        drive.target[0] = 0.5;
        (0..(3.0 / dt) as usize).for_each(|_| engine.step(&drive));
        // What gravity bends the servo by: m g l sin(0.5) / kp.
        let sag = 2.0 * G * 0.3 * 0.5f64.sin() / 1e5;
        assert!((engine.joints().position[0] - (0.5 - sag)).abs() < 0.1 * sag);
    }
}

/// The clamped implicit step itself, solved exactly for one joint: the torque at the end of the step is the clamped
/// servo's, whose solution is unique because the servo's torque falls with the speed reached.
fn clamped_implicit(q: &mut f64, v: &mut f64, gains: (f64, f64), limit: f64, target: f64, dt: f64) {
    let load = -2.0 * G * 0.3 * q.sin();
    let resistance = gains.1 + dt * gains.0;
    let free = (PENDULUM_INERTIA * *v + dt * (gains.0 * (target - *q) + load)) / (PENDULUM_INERTIA + dt * resistance);
    let torque = (gains.0 * (target - *q) - resistance * free).clamp(-limit, limit);
    *v += dt * (torque + load) / PENDULUM_INERTIA;
    *q += dt * *v;
}

/// The engine guesses the load from the last step: gravity's torque changes by at most m g l v dt in one, which
/// over the whole motion shifts the end of saturation by a fraction of a step.
#[test]
fn saturated_servo_follows_the_clamped_implicit_step() {
    let robot = pendulum();
    for (gains, limit) in [((200.0, 4.0), 15.0), ((2000.0, 30.0), 12.0), ((2000.0, 1.0), 8.0)] {
        for dt in [5e-3, 1e-3] {
            let mut engine = single(&robot, dt, &Start::nominal(&robot), &nominal(&robot));
            let mut drive = servo(&robot, 1, gains.0, gains.1);
            drive.target[0] = 0.8;
            drive.torque_min[0] = -limit;
            drive.torque_max[0] = limit;
            let (mut q, mut v) = (0.0, 0.0);
            for step in 0..(1.0 / dt) as usize {
                engine.step(&drive);
                clamped_implicit(&mut q, &mut v, gains, limit, 0.8, dt);
                let error = (engine.joints().position[0] - q).abs();
                assert!(error < 0.1 * dt, "{error} rad at {dt} s, step {step}, gains {gains:?}");
            }
        }
    }
}

/// Accelerating in saturation the wheel gains limit / I; the torque reported is the limit.
#[test]
fn torque_stays_within_its_limits() {
    let robot = pendulum();
    let mut model = nominal(&robot);
    model.gravity = Vector3::zeros();
    let dt = 5e-3;
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    let mut drive = servo(&robot, 1, 500.0, 5.0);
    drive.target[0] = 3.0;
    drive.torque_min[0] = -2.0;
    drive.torque_max[0] = 4.0;
    for step in 1..=100 {
        engine.step(&drive);
        let exact = 4.0 / PENDULUM_INERTIA * dt * f64::from(step);
        let joints = engine.joints();
        assert!(joints.torque[0] <= 4.0 + 1e-9 && joints.torque[0] >= -2.0 - 1e-9);
        if joints.position[0] < 2.0 && step < 20 {
            assert!((joints.velocity[0] - exact).abs() < 1e-9);
        }
    }
}

/// The work-energy theorem: what the reported torque works is what the wheel gains, to first order in dt.
#[test]
fn reported_torque_accounts_for_the_motion() {
    let robot = pendulum();
    let mut model = nominal(&robot);
    model.gravity = Vector3::zeros();
    let dt = 1e-3;
    let mut engine = single(&robot, dt, &Start::nominal(&robot), &model);
    let mut drive = servo(&robot, 1, 50.0, 1.0);
    drive.target[0] = 0.7;
    let mut impulse = 0.0;
    for _ in 0..300 {
        engine.step(&drive);
        impulse += engine.joints().torque[0] * dt;
        let momentum = engine.joints().velocity[0] * PENDULUM_INERTIA;
        assert!((impulse - momentum).abs() < 1e-9);
    }
}
