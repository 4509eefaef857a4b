//! The controller's process: reads the newest measurement, steps, sends targets, at the policy's rate.

use std::time::{Duration, Instant};

use miette::IntoDiagnostic;
use omniwalk_controller::{Controller, Fault, Policy};

use super::clock::{now, sleep_until};
use super::wire::{Commanded, Line, Measured};

/// How long the robot may be silent before the process ends: whoever started it is stuck.
const ABANDONED: Duration = Duration::from_secs(20);

/// Controls the robot at the other end of `line` until that has ended or been silent for long.
///
/// # Errors
/// When the policy cannot be used.
pub fn run(policy: &Policy, mut line: Line) -> miette::Result<()> {
    let mut controller = Controller::new(policy).into_diagnostic()?;
    let joints = policy.spec().action_len();
    let fits = |measured: &Measured| measured.position.len() == joints && measured.velocity.len() == joints;
    let mut newest: Option<Measured> = None;
    let mut command = Commanded {
        targets: vec![0.0; joints],
        ..Commanded::default()
    };
    let (mut heard, mut due) = (Instant::now(), now());
    while heard.elapsed() < ABANDONED {
        sleep_until(due);
        let first = newest.is_none();
        while let Some(measured) = line.receive::<Measured>().filter(fits) {
            newest = Some(measured);
            heard = Instant::now();
        }
        if let Some(measured) = &newest {
            if first {
                // What it refuses it says in the status of every step until it can begin.
                let _ = controller.take_over(&measured.position);
            }
            step(&mut controller, measured, &mut command);
            if line.send(&command).is_err() {
                break;
            }
        }
        due = next(due, controller.period());
    }
    Ok(())
}

/// The next time of the grid that has not passed: what was missed is not made up for.
fn next(due: u64, period: u64) -> u64 {
    let missed = now().saturating_sub(due) / period;
    due + (missed + 1) * period
}

fn step(controller: &mut Controller, measured: &Measured, command: &mut Commanded) {
    let begin = now();
    let sensors = measured.sensors();
    let status = controller.step(begin, measured.time, &sensors, measured.desired, &mut command.targets);
    command.sequence = measured.sequence;
    command.late = status.late;
    command.mode = status.mode as u32;
    command.fault = match status.fault {
        None => 0,
        Some(Fault::Stale { .. }) => 1,
        Some(Fault::NotFinite { .. }) => 2,
        Some(Fault::Fallen) => 3,
        Some(Fault::OverRate) => 4,
        Some(Fault::Absurd { .. }) => 5,
    };
    command.out_of_range = u32::from(status.out_of_range.is_some());
    command.velocity = controller.pipeline().velocity().1;
    command.duration = now() - begin;
}

#[cfg(test)]
mod tests {
    use std::thread::{scope, sleep};

    use omniwalk_controller::Mode;

    use super::*;

    /// Sends readings of a robot whose joints are `away` from the nominal pose for `seconds`; returns the modes that came.
    fn live(line: &mut Line, policy: &Policy, away: f32, seconds: f32) -> Vec<u32> {
        let position: Vec<f32> = policy.spec().joints.iter().map(|joint| joint.nominal + away).collect();
        let mut modes = Vec::new();
        for _ in 0..(seconds * 200.0) as usize {
            let measured = Measured {
                time: now(),
                velocity: vec![0.0; position.len()],
                position: position.clone(),
                ..Measured::default()
            };
            line.send(&measured).expect("the controller lives");
            while let Some(command) = line.receive::<Commanded>() {
                if modes.last() != Some(&command.mode) {
                    modes.push(command.mode);
                }
            }
            sleep(Duration::from_millis(5));
        }
        modes
    }

    /// A robot's computer that died and is started again: the line is the same, the readings stop and go on from elsewhere.
    #[test]
    fn a_robot_that_is_started_again_is_brought_to_the_nominal_pose_and_walks_and_one_that_is_gone_ends_the_controller()
    {
        let path = concat!(env!("CARGO_MANIFEST_DIR"), "/runs/nimbro_op2x_omni/policy.omni");
        let policy = Policy::from_bytes(&std::fs::read(path).expect("a policy")).expect("a policy");
        let (mut line, other) = Line::pair().expect("a line");
        let other = Line::new(other).expect("its end");
        let last = |modes: &[u32]| modes.last().copied();
        scope(|scope| {
            let controller = scope.spawn(|| run(&policy, other));
            let begin = live(&mut line, &policy, 0.0, 2.0);
            assert_eq!(last(&begin), Some(Mode::Walking as u32), "{begin:?}");
            sleep(Duration::from_secs(1));
            // What the controller said until there was no room for more.
            while line.receive::<Commanded>().is_some() {}
            let again = live(&mut line, &policy, 0.05, 4.0);
            assert_ne!(again[0], Mode::Walking as u32, "{again:?}");
            assert_eq!(last(&again), Some(Mode::Walking as u32), "{again:?}");
            let modes = live(&mut line, &policy, 0.05, 0.5);
            assert_eq!(modes, [Mode::Walking as u32]);
            drop(line);
            let begin = Instant::now();
            controller.join().expect("no panic").expect("no error");
            assert!(begin.elapsed() < Duration::from_secs(2));
        });
    }
}
