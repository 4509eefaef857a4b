//! Logs that cannot carry an answer are refused with a reason; logs that can are not.

mod commands;

use std::path::Path;

use omniwalk_env::robot::{Base, Robot, load};

use super::text::fixed;
use super::*;
use crate::recording::{CommandKind, Series};

/// Two hinges, one below the other.
const ARM: &str = r#"<robot name="arm"><link name="world"/>
<joint name="shoulder" type="revolute"><parent link="world"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="5" velocity="8"/></joint>
<link name="upper"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><axis xyz="0 1 0"/><origin xyz="0 0 -0.2"/>
<limit lower="-2" upper="2" effort="5" velocity="8"/></joint>
<link name="lower"><inertial><origin xyz="0 0 -0.1"/><mass value="0.3"/>
<inertia ixx="0.001" iyy="0.001" izz="0.001" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"#;

fn arm() -> Robot {
    robot(ARM)
}

fn robot(urdf: &str) -> Robot {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.urdf"), urdf).unwrap();
    std::fs::write(
        folder.path().join("robot.toml"),
        "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 20.0\nkd = 0.5\n",
    )
    .unwrap();
    load(Path::new(folder.path())).unwrap()
}

/// A series of `value` at 100 Hz for `seconds`.
fn series(seconds: f64, value: impl Fn(f64) -> f64) -> Series {
    let time: Vec<f64> = (0..(seconds * 100.0) as usize).map(|i| i as f64 * 0.01).collect();
    Series {
        value: time.iter().map(|t| value(*t)).collect(),
        time,
    }
}

/// Noise, evenly between -1 and 1 mrad, that is the same every time.
fn noise(t: f64) -> f64 {
    let mut hash = ((t * 1e4).round() as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    hash = (hash ^ (hash >> 29)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    1e-3 * ((hash >> 32) as f64 / f64::from(u32::MAX) * 2.0 - 1.0)
}

fn told(joint: &str, t: f64) -> f64 {
    let frequency = if joint == "elbow" { 0.83 } else { 0.5 };
    (std::f64::consts::TAU * frequency * t + 0.1 * t * t).sin()
}

/// A joint that follows its commands 50 ms later.
fn joint(name: &str, seconds: f64) -> JointRecord {
    let did = |t: f64| told(name, t - 0.05);
    JointRecord {
        name: name.into(),
        command: series(seconds, |t| told(name, t)),
        position: series(seconds, |t| did(t) + noise(t)),
        velocity: series(seconds, |t| (did(t + 1e-4) - did(t - 1e-4)) / 2e-4),
        ..JointRecord::default()
    }
}

fn good(seconds: f64) -> Recording {
    Recording {
        name: "log".into(),
        joints: vec![joint("shoulder", seconds), joint("elbow", seconds)],
        ..Recording::default()
    }
}

fn scaled(series: &mut Series, factor: f64) {
    series.value.iter_mut().for_each(|value| *value *= factor);
}

#[test]
fn a_good_log_is_usable_and_its_figures_are_right() {
    let check = Check::new(&[good(6.0)], &arm());
    assert!(check.usable(), "{check}");
    let elbow = &check.logs[0].joints[1];
    assert!((elbow.position.rate - 100.0).abs() < 1e-6 && elbow.position.jitter < 1e-6);
    let following = elbow.following.unwrap();
    assert!((following.lag - 0.05).abs() < 0.011 && following.best_correlation > 0.99);
    assert!((elbow.velocity_to_slope.unwrap().ratio - 1.0).abs() < 0.05);
    // The noise is uniform between -1 and 1 mrad.
    assert!(
        (elbow.position.noise / (1e-3 / 3_f64.sqrt()) - 1.0).abs() < 0.3,
        "{}",
        elbow.position.noise
    );
    assert!((elbow.excitation.range[1] - 1.0).abs() < 0.01 && elbow.excitation.coverage > 0.1);
    serde_json::to_string(&check).unwrap();
}

#[test]
fn of_twenty_logs_that_carry_nothing_none_is_usable() {
    type Spoil = (Fault, fn(&mut Recording));
    let spoiled: [Spoil; 20] = [
        (Fault::Empty, |log| log.joints.clear()),
        (Fault::TooShort, |log| *log = good(2.9)),
        (Fault::TooShort, |log| {
            for joint in &mut log.joints {
                *joint = JointRecord {
                    position: series(0.2, |t| t.sin()),
                    ..joint.clone()
                };
            }
        }),
        (Fault::NoExcitation, |log| {
            for joint in &mut log.joints {
                joint.command = series(6.0, |_| 0.3);
                joint.position = series(6.0, |_| 0.29);
                joint.velocity = series(6.0, |_| 0.0);
            }
        }),
        (Fault::NoExcitation, |log| {
            for joint in &mut log.joints {
                joint.command = series(6.0, |_| 0.3);
                joint.position = series(6.0, |t| 0.29 + noise(t));
                joint.velocity = Series::default();
            }
        }),
        (Fault::MissingJoint, |log| drop(log.joints.pop())),
        (Fault::WrongRobot, |log| {
            log.joints
                .iter_mut()
                .for_each(|joint| joint.name = format!("{}_2", joint.name))
        }),
        (Fault::Stuck, |log| log.joints[0].position = series(6.0, |_| 0.5)),
        (Fault::NoMeasurement, |log| log.joints[1].position = Series::default()),
        (Fault::NoMeasurement, |log| {
            log.joints
                .iter_mut()
                .for_each(|joint| joint.position = Series::default())
        }),
        (Fault::NoCommand, |log| log.joints[0].command = Series::default()),
        (Fault::Units, |log| {
            for joint in &mut log.joints {
                scaled(&mut joint.command, 57.3);
                scaled(&mut joint.position, 57.3);
                scaled(&mut joint.velocity, 57.3);
            }
        }),
        (Fault::Units, |log| scaled(&mut log.joints[0].command, 57.3)),
        (Fault::Units, |log| scaled(&mut log.joints[0].velocity, 57.3)),
        (Fault::SignFlipped, |log| {
            scaled(&mut log.joints[1].position, -1.0);
            scaled(&mut log.joints[1].velocity, -1.0);
        }),
        (Fault::SignFlipped, |log| scaled(&mut log.joints[1].velocity, -1.0)),
        (Fault::Swapped, |log| {
            let (one, other) = log.joints.split_at_mut(1);
            std::mem::swap(&mut one[0].command, &mut other[0].command);
        }),
        (Fault::ClockOffset, |log| {
            log.joints[0].command.time.iter_mut().for_each(|time| *time += 100.0)
        }),
        (Fault::Unrelated, |log| {
            log.joints[0].position = series(6.0, |t| 300.0 * noise(t))
        }),
        (Fault::Gaps, |log| {
            for joint in &mut log.joints {
                joint.position.time.iter_mut().skip(300).for_each(|time| *time += 20.0);
            }
        }),
    ];
    let robot = arm();
    for (fault, spoil) in spoiled {
        let mut log = good(6.0);
        spoil(&mut log);
        let check = Check::new(&[log], &robot);
        assert!(
            check.refusals.iter().any(|finding| finding.fault == fault),
            "{fault:?} in {check}"
        );
        assert!(!check.usable());
    }
}

#[test]
fn positions_a_robot_cannot_have_and_no_logs_at_all_are_refused() {
    let mut log = good(6.0);
    log.joints[0].position.value.iter_mut().for_each(|value| *value += 4.0);
    let check = Check::new(&[log], &arm());
    assert_eq!(check.refusals[0].fault, Fault::OutOfRange, "{check}");
    assert!(!Check::new(&[], &arm()).usable());
}

#[test]
fn targets_that_stand_for_none_are_refused_and_efforts_may_be_large() {
    let mut log = good(6.0);
    log.joints[0].command.value[40] = -1e9;
    let check = Check::new(std::slice::from_ref(&log), &arm());
    assert_eq!(check.refusals[0].fault, Fault::OutOfRange, "{check}");
    log.joints[0].command_kind = CommandKind::Effort;
    let check = Check::new(&[log], &arm());
    assert!(
        check.refusals.iter().all(|own| own.fault != Fault::OutOfRange),
        "{check}"
    );
}

#[test]
fn overrides_that_are_not_used_are_remarked() {
    let mut log = good(6.0);
    for key in ["kp", "payload.mass", "joint.elbow.supply_voltage", "kd"] {
        log.overrides.insert(key.into(), 2.0);
    }
    let check = Check::new(&[log.clone(), log], &arm());
    let unused = |finding: &&Finding| finding.fault == Fault::UnusedOverride;
    let said: Vec<String> = check.remarks.iter().filter(unused).map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].contains("`joint.elbow.supply_voltage` is not used") && said[0].contains("match = [\"elbow\"]"));
    assert!(
        said[1].contains("`kd` holds in `replay`; `identify` re-tunes kd"),
        "{said:?}"
    );
}

#[test]
fn zeros_have_no_sign() {
    let written = [(-0.001, 2), (-0.0, 0), (-0.0, 3), (-1.5, 1), (0.25, 2)].map(|(value, digits)| fixed(value, digits));
    assert_eq!(written, ["0.00", "0", "0.000", "-1.5", "0.25"]);
    let mut log = good(6.0);
    log.joints[0].position = series(6.0, |_| -0.0);
    let check = Check::new(&[log], &arm());
    assert!(check.to_string().contains("the position reads 0 throughout"), "{check}");
    assert!(!check.to_string().contains("-0.000"), "{check}");
}

#[test]
fn an_encoder_that_saturates_is_refused_and_a_joint_that_sticks_or_stops_at_its_limit_is_not() {
    let refused = |log: Recording| {
        let check = Check::new(&[log], &arm());
        check.refusals.iter().any(|finding| finding.fault == Fault::Saturated)
    };
    let told = |t: f64| (0.8 + 0.04 * t) * (3.0 * t).sin();
    let log = |position: &dyn Fn(f64) -> f64| {
        let mut log = good(6.0);
        log.joints[0].command = series(6.0, told);
        log.joints[0].position = series(6.0, position);
        log.joints[0].velocity = Series::default();
        log
    };
    let clipped = |t: f64| (told(t - 0.03) + noise(t)).min(0.7);
    assert!(refused(log(&clipped)));
    let low = |t: f64| (told(t - 0.03) + noise(t)).max(-0.5);
    assert!(refused(log(&low)));
    // Every time it is told to go as far.
    let mut even = log(&|t| (0.8 * (3.0 * (t - 0.03)).sin() + noise(t)).clamp(-0.4, 0.4));
    even.joints[0].command = series(6.0, |t| 0.8 * (3.0 * t).sin());
    assert!(refused(even));
    // Once to either side, by less than a step of its encoder from one reading to the next.
    let slow = |t: f64| 1.5 * ((t / 6.0 + 0.25).fract() * 4.0 - 2.0).abs() - 1.5 * 1.0;
    let mut once = log(&|t| (slow(t - 0.03).clamp(-0.6, 0.6) / 0.005).round() * 0.005);
    once.joints[0].command = series(6.0, slow);
    assert!(refused(once));
    // It stays where it turned round until the command has gone back by 0.2 rad; a coarse encoder.
    let coarse = |at: f64| (at * 600.0).round() / 600.0;
    let sticks = |t: f64| {
        let at = (0..=(t * 1000.0) as usize).fold(0.0_f64, |at, k| {
            let told = told(k as f64 * 1e-3 - 0.03);
            at.clamp(told - 0.1, told + 0.1)
        });
        coarse(at)
    };
    assert!(!refused(log(&sticks)));
    // Its load holds it up.
    let stalls = |t: f64| {
        let at = (0..=(t * 1000.0) as usize).fold(0.0_f64, |at, k| {
            let told = told(k as f64 * 1e-3);
            at + 1e-3 * (30.0 * (told - at).min(0.7 - at))
        });
        coarse(at)
    };
    assert!(!refused(log(&stalls)));
    // The limit is 2 rad.
    let mut stop = log(&|t| (2.4 * (3.0 * (t - 0.03)).sin()).clamp(-2.0, 2.0));
    stop.joints[0].command = series(6.0, |t| 2.4 * (3.0 * t).sin());
    assert!(!refused(stop));
}

#[test]
fn one_column_for_two_joints_and_readings_that_are_too_slow_are_refused() {
    let refused = |log: Recording, fault: Fault| {
        let check = Check::new(&[log], &arm());
        check.refusals.iter().any(|finding| finding.fault == fault)
    };
    let mut twice = good(6.0);
    twice.joints[1] = JointRecord {
        name: "elbow".into(),
        ..twice.joints[0].clone()
    };
    assert!(refused(twice, Fault::SameReadings) && !refused(good(6.0), Fault::SameReadings));
    let mut both = good(6.0);
    both.joints[0].command = both.joints[0].position.clone();
    assert!(refused(both, Fault::SameReadings));
    let check = Check::new(&[good(6.0), good(6.0)], &arm());
    assert!(
        check.refusals.iter().any(|finding| finding.fault == Fault::Copy),
        "{check}"
    );
    let every = |n: usize| {
        let mut slow = good(20.0);
        for joint in &mut slow.joints {
            for own in [&mut joint.position, &mut joint.velocity] {
                own.time = own.time.iter().copied().step_by(n).collect();
                own.value = own.value.iter().copied().step_by(n).collect();
            }
        }
        slow
    };
    assert!(refused(every(10), Fault::LowRate) && !refused(every(6), Fault::LowRate));
}

#[test]
fn what_was_left_out_is_not_there_or_does_not_agree_is_remarked() {
    let mut log = good(6.0);
    log.joints[0].outliers = 3;
    log.joints[0].missing = 20;
    log.joints[1].missing = 5000;
    scaled(&mut log.joints[1].velocity, 0.77);
    let check = Check::new(&[log], &arm());
    let said: Vec<String> = check.remarks.iter().map(ToString::to_string).collect();
    let has = |text: &str| said.iter().any(|said| said.contains(text));
    assert!(check.usable() && said.len() == 3, "{said:?}");
    assert!(has(
        "shoulder: readings of the position that are far off those before and after, and are left out: 3"
    ));
    assert!(has("shoulder: 20 of 623 rows have no number"));
    assert!(has("elbow: the velocity is 0.77 times the slope"));
    let small = good(6.0);
    let mut small = Recording {
        joints: small.joints,
        ..Recording::default()
    };
    for joint in &mut small.joints {
        for own in [&mut joint.command, &mut joint.position, &mut joint.velocity] {
            scaled(own, 0.02);
        }
    }
    let check = Check::new(&[small], &arm());
    assert!(
        check
            .remarks
            .iter()
            .any(|finding| finding.message.contains("only: what shows farther off")),
        "{check}"
    );
}

#[test]
fn a_nominal_robot_that_is_off_by_more_than_joints_move_is_remarked() {
    let mut check = Check::new(&[good(6.0)], &arm());
    let errors = [("elbow", 0.9), ("shoulder", 0.3), ("overall", 0.7)].map(|(name, error)| (name.to_owned(), error));
    let far = check.far_off(&errors.into_iter().collect());
    assert_eq!(far.len(), 1, "{far:?}");
    assert!(
        far[0]
            .to_string()
            .starts_with("elbow: the nominal robot is off by 0.9000"),
        "{far:?}"
    );
    assert_eq!(check.remarks, far);
}
