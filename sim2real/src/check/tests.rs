//! Logs that cannot carry an answer are refused with a reason; logs that can are not.

use std::path::Path;

use omniwalk_env::robot::{Robot, load};

use super::text::fixed;
use super::*;
use crate::recording::Series;

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
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("arm.urdf"), ARM).unwrap();
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
fn a_clock_that_is_set_and_commands_that_outlast_it_are_refused_once() {
    let mut log = good(6.0);
    for joint in &mut log.joints {
        joint.position.time.iter_mut().skip(300).for_each(|time| *time += 1.7e9);
    }
    let mut told = good(6.0);
    told.joints[1]
        .command
        .time
        .iter_mut()
        .skip(300)
        .for_each(|time| *time += 1.7e9);
    let mut other = log.clone();
    scaled(&mut other.joints[0].position, 0.9);
    let check = Check::new(&[log, other, told], &arm());
    let said: Vec<String> = check.refusals.iter().map(ToString::to_string).collect();
    assert_eq!(said.len(), 2, "{said:?}");
    assert!(said[0].starts_with("log: shoulder: time jumps: the longest pause, of 19675.9 days, is after 2.99 s"));
    assert!(
        said[0].contains("and 1 more joints jump: split the log there"),
        "{}",
        said[0]
    );
    assert!(
        said[1].contains("elbow: commands are from 0.000 s to 1700000005.990 s"),
        "{}",
        said[1]
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
fn a_motor_that_is_off_need_not_follow_and_what_is_odd_is_noted() {
    let mut log = good(6.0);
    let shoulder = &mut log.joints[0];
    shoulder.enabled = Series {
        time: vec![0.0],
        value: vec![0.0],
    };
    shoulder.command = Series::default();
    log.joints[1].velocity = series(6.0, |_| 0.0);
    log.joints[1].effort = series(6.0, |t| told("elbow", t).clamp(-0.5, 0.5));
    log.notes.push("another clock".into());
    log.joints.push(joint("wrist", 6.0));
    let check = Check::new(&[log], &arm());
    assert!(check.usable(), "{check}");
    let faults: Vec<Fault> = check.remarks.iter().map(|finding| finding.fault).collect();
    for fault in [Fault::Stuck, Fault::Saturated, Fault::Note, Fault::UnknownJoint] {
        assert!(faults.contains(&fault), "{fault:?} in {check}");
    }
}

#[test]
fn a_joint_that_follows_while_its_motor_is_said_to_be_off_is_refused() {
    let mut log = good(6.0);
    log.joints[0].enabled = Series {
        time: vec![0.0],
        value: vec![0.0],
    };
    let check = Check::new(&[log], &arm());
    let faults: Vec<Fault> = check.refusals.iter().map(|finding| finding.fault).collect();
    assert_eq!(faults, [Fault::Switch], "{check}");
}

#[test]
fn commands_that_are_missing_are_remarked_and_where_most_are_refused() {
    let without = |from: f64, to: f64| {
        let mut log = good(6.0);
        let command = &mut log.joints[0].command;
        let kept: Vec<(f64, f64)> = command
            .time
            .iter()
            .copied()
            .zip(command.value.iter().copied())
            .collect();
        (command.time, command.value) = kept.into_iter().filter(|(t, _)| !(from..to).contains(t)).unzip();
        Check::new(&[log], &arm())
    };
    let some = without(2.0, 3.5);
    assert!(some.usable(), "{some}");
    let said = some.remarks.iter().map(ToString::to_string).collect::<String>();
    assert!(
        said.contains("shoulder: commands are missing, for 1.51 s at most, from 1.99 s on"),
        "{said}"
    );
    let most = without(1.0, 5.0);
    assert!(
        most.refusals.iter().any(|finding| finding.fault == Fault::NoCommand),
        "{most}"
    );
}

#[test]
fn clocks_that_are_far_apart_are_refused_with_how_far_or_that_it_is_farther() {
    let said = |apart: f64| {
        let mut log = good(12.0);
        for joint in &mut log.joints {
            joint.command.time.iter_mut().for_each(|time| *time += apart);
        }
        let check = Check::new(&[log], &arm());
        let refused = check
            .refusals
            .iter()
            .find(|finding| finding.fault == Fault::ClockOffset);
        refused.map(ToString::to_string).unwrap_or_default()
    };
    // Joints follow 50 ms later.
    for apart in [-0.1, 0.0, 0.06] {
        assert_eq!(said(apart), "", "{apart}");
    }
    assert!(said(0.15).contains("moves 100 ms before its command"), "{}", said(0.15));
    assert!(
        said(-0.35).contains("moves 400 ms after its command"),
        "{}",
        said(-0.35)
    );
    assert!(said(-0.99).contains("at least 1000 ms after"), "{}", said(-0.99));
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

#[test]
fn a_position_ahead_of_its_command_is_noted_unless_the_motion_is_too_slow_to_tell() {
    let noted = |log: Recording| {
        let check = Check::new(&[log], &arm());
        check.remarks.iter().any(|finding| finding.fault == Fault::ClockOffset)
    };
    let mut late = good(6.0);
    for joint in &mut late.joints {
        joint.command.time.iter_mut().for_each(|time| *time += 0.08);
    }
    assert!(noted(late) && !noted(good(6.0)));
    // A lift that comes to rest early, where the joint sticks.
    let mut slow = good(6.0);
    for joint in &mut slow.joints {
        joint.command = series(6.0, |t| (0.3 * t).min(1.5) - 0.1 * (t - 4.0).max(0.0));
        joint.position = series(6.0, |t| (0.3 * t).min(0.9) + noise(t));
        joint.velocity = Series::default();
    }
    assert!(!noted(slow));
}
