//! The first gate: a second reader of the policy file, in double precision and written from the page on the format alone,
//! against the controller. Targets over a thousand readings in sequence, with the filter, the clock and the estimator's
//! memory in them. Each reader keeps all of that itself, but for the targets sent last, which are the controller's for both: they go
//! back into the network, and a policy that makes four of a difference of one there would be judged by what it makes of
//! roundings (no walk corrects it: the readings do not follow the targets).

use miette::miette;
use omniwalk_controller::{Controller, Policy, Sensors};
use omniwalk_env::random::Stream;
use serde_json::json;

use super::check::Check;
use super::engine::Workshop;
use super::process::{bytes, numbers};
use super::subject::Subject;

/// Readings in sequence.
const STEPS: usize = 1000;
/// What the project promises, rad or m.
const BOUND: f64 = 1e-5;
/// Control steps between changes of the command.
const COMMAND: usize = 90;

/// One step's readings.
#[derive(Clone, Debug)]
struct Row {
    position: Vec<f32>,
    velocity: Vec<f32>,
    attitude: [f32; 2],
    gyro: [f32; 3],
    desired: [f32; 3],
    base_velocity: [f32; 3],
}

/// The checks of the gate: with the base's velocity estimated, and with it given.
///
/// # Errors
/// When the policy does not fit the controller, or Python refuses it.
pub fn checks(subject: &Subject, workshop: &Workshop) -> miette::Result<Vec<Check>> {
    let rows = readings(&subject.policy);
    [(false, "estimated"), (true, "given")]
        .into_iter()
        .map(|(given, velocity)| {
            let ours = targets(subject.controller()?, &rows, given)?;
            let theirs = second_reading(&subject.policy, &rows, &ours, given, workshop)?;
            if ours.len() != theirs.len() {
                return Err(miette!("{} targets, and {} from Python", ours.len(), theirs.len()));
            }
            let misses = ours.iter().zip(&theirs).map(|(a, b)| (f64::from(*a) - b).abs());
            let name = format!("targets over {STEPS} readings, velocity {velocity}, rad or m");
            Ok(Check::new(name, misses.fold(0.0, largest), BOUND))
        })
        .collect()
}

/// The larger of two; not a number if either is none.
pub fn largest(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

/// A robot that moves all its joints, sways and turns, under changing commands.
fn readings(policy: &Policy) -> Vec<Row> {
    let spec = policy.spec();
    let mut stream = Stream::new(7, 0, 0);
    let joints: Vec<[f64; 4]> = spec
        .joints
        .iter()
        .map(|joint| {
            let (lower, upper) = (f64::from(joint.lower), f64::from(joint.upper));
            let amplitude = (0.45 * (upper - lower)).min(0.4);
            let centre = f64::from(joint.nominal).clamp(lower + amplitude, upper - amplitude);
            [centre, amplitude, stream.uniform(0.5, 12.0), stream.uniform(0.0, 6.0)]
        })
        .collect();
    let mut desired = [0.0; 3];
    let row = |k: usize| {
        if k.is_multiple_of(COMMAND) {
            desired = desired.map(|_: f32| stream.uniform(-0.9, 0.9) as f32);
        }
        let t = k as f64 / f64::from(spec.control_hz);
        let mut of_joints = |value: fn([f64; 4], f64) -> f64, noise: f64| {
            let each = joints
                .iter()
                .map(|&joint| (value(joint, t) + stream.normal(noise)) as f32);
            each.collect()
        };
        let upright = spec.upright.map(f64::from);
        Row {
            position: of_joints(|[c, a, rate, phase], t| c + a * (rate * t + phase).sin(), 1e-3),
            velocity: of_joints(|[_, a, rate, phase], t| a * rate * (rate * t + phase).cos(), 1e-2),
            attitude: [
                (0.9 * upright[0] * (3.0 * t).sin()) as f32,
                (0.9 * upright[1] * (2.0 * t + 1.0).sin()) as f32,
            ],
            gyro: [
                (0.5 * (5.0 * t).sin()) as f32,
                (0.4 * (4.0 * t).sin()) as f32,
                (1.5 * (0.3 * t + 0.5).sin()) as f32,
            ],
            desired,
            base_velocity: std::array::from_fn(|_| stream.normal(0.4) as f32),
        }
    };
    (0..STEPS).map(row).collect()
}

/// What the controller makes of them.
fn targets(mut controller: Controller, rows: &[Row], given: bool) -> miette::Result<Vec<f32>> {
    let joints = controller.spec().action_len();
    let (mut all, mut targets) = (Vec::with_capacity(rows.len() * joints), vec![0.0; joints]);
    controller.reset(0.0);
    for (k, row) in rows.iter().enumerate() {
        let sensors = Sensors {
            position: &row.position,
            velocity: &row.velocity,
            attitude: row.attitude,
            gyro: row.gyro,
            base_velocity: given.then_some(row.base_velocity),
        };
        let now = k as u64 * controller.period();
        let status = controller.step(now, now, &sensors, row.desired, &mut targets);
        if let Some(fault) = status.fault {
            return Err(miette!("the controller does not walk in step {k}: {fault:?}"));
        }
        all.extend(&targets);
    }
    Ok(all)
}

fn second_reading(
    policy: &Policy,
    rows: &[Row],
    sent: &[f32],
    given: bool,
    workshop: &Workshop,
) -> miette::Result<Vec<f64>> {
    let file = policy.to_bytes();
    let head = json!({ "policy": file.len(), "given": given });
    let mut rest = file;
    for (row, sent) in rows.iter().zip(sent.chunks(policy.spec().action_len())) {
        let joints = row.position.iter().chain(&row.velocity);
        let others = row.attitude.iter().chain(&row.gyro).chain(&row.desired);
        let base = row.base_velocity.iter().filter(|_| given);
        let row: Vec<f64> = joints
            .chain(others)
            .chain(base)
            .chain(sent)
            .map(|&x| f64::from(x))
            .collect();
        rest.extend(bytes(&row));
    }
    let asked = workshop.with_process(|process| {
        process
            .ask_with_head(b'n', &head, &rest)
            .map(|it| numbers(it).collect())
    });
    asked.map_err(|why| miette!("the second reader: {why}"))
}
