//! The controller's process: reads the newest measurement, steps, sends targets, at the policy's rate.

use std::path::Path;
use std::time::{Duration, Instant};

use miette::{IntoDiagnostic, WrapErr};
use omniwalk_controller::{Controller, Fault, Policy};

use super::clock::{now, sleep_until};
use super::wire::{Commanded, Measured, Socket};
use super::{BRAIN, ROBOT};

/// How long the robot may be silent before the process ends: whoever started it is gone.
const ABANDONED: Duration = Duration::from_secs(20);

/// Controls the robot at the other end of the sockets in `folder` until it has been silent for long.
///
/// # Errors
/// When the policy or the sockets cannot be used.
pub fn run(policy: &Policy, folder: &Path) -> miette::Result<()> {
    let mut socket = Socket::open(&folder.join(BRAIN), &folder.join(ROBOT))
        .into_diagnostic()
        .wrap_err_with(|| format!("cannot open a socket in {}", folder.display()))?;
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
        while let Some(measured) = socket.receive::<Measured>().filter(fits) {
            newest = Some(measured);
            heard = Instant::now();
        }
        if let Some(measured) = &newest {
            if first {
                controller.take_over(&measured.position);
            }
            step(&mut controller, measured, &mut command);
            socket.send(&command);
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
    };
    command.out_of_range = u32::from(status.out_of_range.is_some());
    command.velocity = controller.pipeline().velocity().1;
    command.duration = now() - begin;
}
