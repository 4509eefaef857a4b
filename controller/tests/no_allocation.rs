//! The loop on a robot must not allocate: an allocator is the one thing in it whose time has no bound.

mod support;

use omniwalk_controller::{Controller, Mode, Sensors};
use support::policy;

#[global_allocator]
static ALLOCATOR: omniwalk_allocations::Counting = omniwalk_allocations::Counting::new();

#[test]
fn a_step_allocates_nothing() {
    let mut controller = Controller::new(&policy(80)).expect("valid");
    let mut targets = [0.0; 2];
    let mut sensors = Sensors {
        position: &[0.1, -0.1],
        velocity: &[0.5, -0.5],
        attitude: [0.02, 0.05],
        gyro: [0.1, 0.2, 0.3],
        base_velocity: None,
    };
    let mut modes = Vec::with_capacity(8);
    let before = ALLOCATOR.count();
    let period = controller.period();
    for step in 0..2_000 {
        if step % 900 == 0 {
            controller.reset(0.5);
        }
        // Good readings, then none for long enough to end in the nominal pose, then good ones again.
        let now = step * period;
        let measured = if (300..600).contains(&step) { 0 } else { now };
        sensors.gyro[2] = if step == 200 { f32::NAN } else { 0.3 };
        let status = controller.step(now, measured, &sensors, [0.4, 0.0, 0.1], &mut targets);
        if modes.last() != Some(&status.mode) && modes.len() < modes.capacity() {
            modes.push(status.mode);
        }
    }
    assert_eq!(ALLOCATOR.count(), before);
    assert!(before > 0, "the counter counts");
    assert!(targets.iter().all(|target| target.is_finite()));
    for mode in [Mode::Walking, Mode::Holding, Mode::Ramping, Mode::Resting] {
        assert!(modes.contains(&mode), "{mode:?} was not seen");
    }
}
