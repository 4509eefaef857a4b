//! Steps a controller for very long and says how long steps took; `python/studies/soak.py` watches its memory meanwhile.
//!
//!     cargo run --release -p omniwalk-controller --example soak -- POLICY STEPS
//!
//! Prints a line a hundredth of the way: steps so far, mean and largest time of a step since the last line, us.

use std::time::Instant;

use omniwalk_controller::{Controller, Policy};

fn main() -> Result<(), String> {
    let mut arguments = std::env::args().skip(1);
    let (Some(path), Some(steps)) = (arguments.next(), arguments.next()) else {
        return Err("give a policy file and a number of steps".into());
    };
    let steps: u64 = steps.parse().map_err(|_| format!("{steps} is no number of steps"))?;
    let bytes = std::fs::read(&path).map_err(|error| format!("{path}: {error}"))?;
    let policy = Policy::from_bytes(&bytes).map_err(|error| error.to_string())?;
    drop(bytes);
    let mut controller = Controller::new(&policy).map_err(|error| error.to_string())?;
    let mut targets = vec![0.0; policy.spec().action_len()];
    let readings: Vec<_> = policy
        .golden()
        .steps
        .iter()
        .map(|step| (step.sensors(), step.desired))
        .collect();
    let stretch = steps.div_ceil(100).max(1);
    let (mut now, mut sum, mut most) = (0, 0, 0);
    for step in 1..=steps {
        let (sensors, desired) = &readings[step as usize % readings.len()];
        now += controller.period();
        let begin = Instant::now();
        controller.step(now, now, sensors, *desired, &mut targets);
        let took = begin.elapsed().as_nanos();
        (sum, most) = (sum + took, most.max(took));
        if step % stretch == 0 || step == steps {
            let since = (step - 1) % stretch + 1;
            println!(
                "{step} {:.3} {:.1}",
                sum as f64 * 1e-3 / since as f64,
                most as f64 * 1e-3
            );
            (sum, most) = (0, 0);
        }
    }
    Ok(())
}
