//! NimbRo-OP2X under its position servos alone, in both engines: what `omniwalk inspect` shows of a robot.

mod support;

use omniwalk_env::config::EngineKind;
use omniwalk_env::probe::{Hold, mirror_difference, stand};
use support::{config, robot};

#[test]
fn nimbro_stands_for_ten_seconds_at_every_rate_and_presses_with_its_weight() {
    let robot = robot("nimbro_op2x");
    for engine in EngineKind::ALL {
        for rate in [200, 400, 1000] {
            let mut config = config(engine);
            config.engine.physics_hz = rate;
            let standing = stand(&robot, &config, Hold::Nominal, 10.0).unwrap();
            assert_eq!(standing.fell_after, None, "{engine:?} at {rate} Hz");
            assert!((standing.force_over_weight - 1.0).abs() < 1e-3, "{standing:?}");
            // Servos yield to the weight by torque / kp, less than 0.05 rad at any joint.
            assert!(
                standing.tilt < 0.05 && standing.sunk.abs() < 0.03 && standing.moved < 0.03,
                "{standing:?}"
            );
        }
    }
}

#[test]
fn a_zero_increment_yields() {
    let robot = robot("nimbro_op2x");
    for engine in EngineKind::ALL {
        let standing = stand(&robot, &config(engine), Hold::Measured, 10.0).unwrap();
        assert!(standing.fell_after.is_some_and(|after| after < 10.0), "{standing:?}");
    }
}

/// What may differ are roundings and the order in which an engine sweeps over its constraints. A sign or a side that is
/// wrong anywhere would show as twice the start's deviations, 0.02 rad; the bound is a tenth of that.
#[test]
fn a_mirrored_start_gives_a_mirrored_motion() {
    let robot = robot("nimbro_op2x");
    for engine in EngineKind::ALL {
        for rate in [200, 400, 1000] {
            let mut config = config(engine);
            config.engine.physics_hz = rate;
            let difference = mirror_difference(&robot, &config, 1.0).unwrap();
            assert!(
                difference.is_some_and(|d| d < 4e-3),
                "{difference:?} in {engine:?} at {rate} Hz"
            );
        }
    }
}

#[test]
fn a_wrong_sign_in_the_mirror_map_is_noticed() {
    let mut robot = (*robot("nimbro_op2x")).clone();
    let map = robot.mirror.as_mut().expect("a mirror map");
    map[1].sign *= -1.0;
    let difference = mirror_difference(&robot.into(), &config(EngineKind::ALL[0]), 1.0).unwrap();
    assert!(difference.is_some_and(|d| d > 0.02), "{difference:?}");
}
