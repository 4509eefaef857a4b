//! Logs that cannot carry an answer get none.

use omniwalk_env::effect::{self, Effect, Kind};
use omniwalk_env::robot::Robot;
use omniwalk_sim2real::check::Fault;
use omniwalk_sim2real::identify::{Verdict, replay};
use omniwalk_sim2real::recording::{Recording, Series};

use crate::record::{NOISE, record};
use crate::rig::{Files, identify, identify_files, load, logs, rig};

/// What is done to good logs, by name.
type Spoil = fn(&mut Vec<Recording>);

fn cut(logs: &mut Vec<Recording>, seconds: f64) {
    logs.truncate(1);
    let joint = &mut logs[0].joints[0];
    for series in [&mut joint.command, &mut joint.position] {
        let keep = series.time.partition_point(|&t| t < seconds);
        series.time.truncate(keep);
        series.value.truncate(keep);
    }
}

fn each(logs: &mut [Recording], mut change: impl FnMut(usize, &mut f64)) {
    for log in logs {
        log.joints[0]
            .position
            .value
            .iter_mut()
            .enumerate()
            .for_each(|(i, q)| change(i, q));
    }
}

fn thin(logs: &mut [Recording], keep: usize) {
    for log in logs {
        let own = &mut log.joints[0].position;
        own.time = own.time.iter().copied().step_by(keep).collect();
        own.value = own.value.iter().copied().step_by(keep).collect();
    }
}

/// What is done from the middle of a log on to the times of all that is in it.
fn late(logs: &mut [Recording], seconds: f64) {
    for log in logs {
        let joint = &mut log.joints[0];
        for series in [&mut joint.command, &mut joint.position] {
            series.time.iter_mut().skip(400).for_each(|t| *t += seconds);
        }
    }
}

#[test]
fn logs_that_carry_no_answer_get_none() {
    let spoils: [(&str, Spoil); 27] = [
        ("half a second", |logs| cut(logs, 0.5)),
        ("two seconds", |logs| cut(logs, 2.0)),
        ("two readings", |logs| cut(logs, 0.012)),
        ("the same log twice", |logs| logs.push(logs[0].clone())),
        ("its motion given as its commands", |logs| {
            for log in logs {
                let joint = &mut log.joints[0];
                joint.command = joint.position.clone();
            }
        }),
        ("at rest", |logs| each(logs, |_, q| *q = 0.0)),
        ("at rest elsewhere", |logs| each(logs, |_, q| *q = 0.7)),
        ("noise alone", |logs| {
            each(logs, |i, q| *q = ((i * 7919 % 1000) as f64 / 1000.0 - 0.5) * 1e-3)
        }),
        ("no command changes", |logs| {
            logs.iter_mut().for_each(|log| log.joints[0].command.value.fill(0.0));
        }),
        ("one reading in a hundred", |logs| thin(logs, 100)),
        ("nonsense values", |logs| each(logs, |i, q| *q = 1e6 * i as f64)),
        ("not finite", |logs| {
            each(logs, |i, q| {
                if i % 7 == 0 {
                    *q = f64::INFINITY
                }
            })
        }),
        ("readings in random order", |logs| {
            each(logs, |i, q| *q = ((i * 7919 % 1009) as f64 / 1009.0 - 0.5) * 2.0);
        }),
        ("degrees", |logs| each(logs, |_, q| *q = q.to_degrees())),
        ("the sign turned", |logs| each(logs, |_, q| *q = -*q)),
        ("readings of other commands", |logs| {
            let first = logs[0].joints[0].position.clone();
            let others: Vec<_> = logs.iter().skip(1).map(|log| log.joints[0].position.clone()).collect();
            let turned = others.into_iter().chain([first]);
            logs.iter_mut()
                .zip(turned)
                .for_each(|(log, own)| log.joints[0].position = own);
        }),
        ("a second late", |logs| {
            let late = |log: &mut Recording| log.joints[0].position.time.iter_mut().for_each(|t| *t += 1.0);
            logs.iter_mut().for_each(late);
        }),
        ("four tenths of a second late", |logs| {
            let late = |log: &mut Recording| log.joints[0].position.time.iter_mut().for_each(|t| *t += 0.4);
            logs.iter_mut().for_each(late);
        }),
        ("commands in the place of readings", |logs| {
            for log in logs {
                let joint = &mut log.joints[0];
                joint.position.time.iter_mut().for_each(|t| *t += 0.1);
                std::mem::swap(&mut joint.command, &mut joint.position);
            }
        }),
        ("stuck from a second on", |logs| {
            for log in logs {
                let held = log.joints[0].position.value[200];
                log.joints[0].position.value[200..].fill(held);
            }
        }),
        ("rounded to half a rad", |logs| {
            each(logs, |_, q| *q = (2.0 * *q).round() / 2.0)
        }),
        ("every third reading lost and zero", |logs| {
            each(logs, |i, q| {
                if i % 3 == 0 {
                    *q = 0.0
                }
            })
        }),
        ("time that goes backwards", |logs| late(logs, -1.0)),
        ("a clock that is set", |logs| late(logs, 1.7e9)),
        ("another robot's log", |logs| {
            logs.iter_mut().for_each(|log| log.joints[0].name = "knee".into());
        }),
        ("commands without measurements", |logs| {
            logs.iter_mut()
                .for_each(|log| log.joints[0].position = Series::default());
        }),
        ("a walk by chance", |logs| {
            let mut at = 0.0;
            each(logs, |i, q| {
                at += ((i * 7919 % 1009) as f64 / 1009.0 - 0.5) * 0.05;
                *q = at;
            });
        }),
    ];
    for (name, spoil) in spoils {
        let mut spoilt = logs(&rig(&[]), 4, 1);
        spoil(&mut spoilt);
        let outcome = identify(&rig(&[]), spoilt, None);
        assert_eq!(
            outcome.verdict,
            Verdict::InsufficientData,
            "{name}: {:?}",
            outcome.accepted
        );
        assert!(outcome.accepted.is_empty() && !outcome.reasons.is_empty(), "{name}");
        // A sum of nothing is written as minus zero.
        assert!(
            outcome.reasons.iter().all(|reason| !reason.contains("-0.00 s")),
            "{name}"
        );
    }
}

/// It rests where it is told to go on, as a joint that sticks does: what is left is structure, and no effect is named.
#[test]
fn an_encoder_that_saturates_is_not_explained() {
    let mut spoilt = logs(&rig(&[]), 4, 1);
    each(&mut spoilt, |_, q| *q = q.clamp(-0.1, 0.1));
    let outcome = identify(&rig(&[]), spoilt, None);
    assert_ne!(outcome.verdict, Verdict::Explained, "{:?}", outcome.accepted);
}

/// Two arms on one base.
const PAIR: &str = r#"<robot name="pair"><link name="base"><inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="other_arm"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/><inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="other" type="continuous"><parent link="base"/><child link="other_arm"/><axis xyz="0 1 0"/></joint></robot>"#;
const TOML: &str = "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 3.0\nkd = 0.05\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\n";
const FILES: Files = (PAIR, TOML);
/// The same with the nominal voltage that the check asks for.
const WITH_SUPPLY: Files = (
    PAIR,
    "base = \"fixed\"\n[[joint]]\nmatch = [\"*\"]\nkp = 3.0\nkd = 0.05\ntorque_limit = 1.5\nspeed_limit = 12.0\narmature = 0.003\n\
     [[effect]]\nid = \"supply_voltage\"\nmatch = [\"*\"]\nactual = 7.4\nnominal = 7.4\n",
);

#[test]
fn a_log_without_one_of_the_robot_s_joints_gets_no_answer() {
    let folder = tempfile::tempdir().expect("a folder");
    let one = logs(&rig(&[]), 4, 1);
    let outcome = identify_files(folder.path(), FILES, &load(FILES), one, None);
    assert_eq!(outcome.verdict, Verdict::InsufficientData);
    let reason = &outcome.reasons[0];
    assert!(
        reason.contains("log-1 and 3 other logs: other: ") && reason.contains("not in the log"),
        "{reason}"
    );
}

/// The reason why `logs` cannot be replayed with the rig.
fn refused(logs: &[Recording]) -> String {
    replay(&rig(&[]), logs).map(|_| ()).expect_err("a refusal").to_string()
}

/// Each would take as much memory as the time between its readings, by the millisecond.
#[test]
fn a_clock_that_jumps_is_refused_with_its_place_wherever_logs_are_cut() {
    for (seconds, words) in [
        (1.7e9, "of 19675.9 days, is after 2.00 s"),
        (30.0 * 86_400.0, "of 30.0 days, is after 2.00 s"),
        (-1.0, "time goes backwards after 2.00 s"),
    ] {
        let mut jumped = logs(&rig(&[]), 1, 1);
        late(&mut jumped, seconds);
        let text = refused(&jumped);
        assert!(
            text.starts_with("log log-1: joint `hinge`: time ") && text.contains(words),
            "{text}"
        );
        let outcome = identify(&rig(&[]), jumped, None);
        let reason = &outcome.reasons[0];
        assert!(
            reason.contains(words) && reason.contains("split the log there"),
            "{reason}"
        );
    }
    let mut last = logs(&rig(&[]), 1, 1);
    *last[0].joints[0].position.time.last_mut().expect("a reading") = 1e300;
    assert!(refused(&last).contains("1.0e300 s"));
}

#[test]
fn overrides_that_cannot_be_are_refused_with_log_and_key() {
    for (key, value, words) in [
        ("kp", -3.0, "override `kp` cannot be -3"),
        ("joint.hinge.kd", f64::NAN, "override `joint.hinge.kd` cannot be NaN"),
        ("torque_limit", 0.0, "override `torque_limit` cannot be 0"),
        ("payload.mass", 1e12, "override `payload.mass` cannot be 1000000000000"),
        ("speed", 3.0, "no parameter `speed`"),
        ("joint.knee.kp", 3.0, "no joint `knee`"),
    ] {
        let mut own = logs(&rig(&[]), 1, 1);
        own[0].overrides.insert(key.into(), value);
        let text = refused(&own);
        assert!(text.starts_with("log log-1: ") && text.contains(words), "{text}");
    }
}

#[test]
fn a_voltage_is_used_once_the_robot_has_the_nominal_one_that_the_check_asks_for() {
    let supplied = |actual: f64| {
        let mut truth: Robot = load(FILES);
        (0..2).for_each(|d| effect::apply(&mut truth, &Effect::new(Kind::SupplyVoltage, d, &[actual, 7.4])));
        let mut log = record(&truth, 1, |_, t| 0.6 * (3.0 * t).sin() + 0.4 * (8.0 * t).sin());
        log.overrides.insert("supply_voltage".into(), actual);
        log
    };
    let logs = [supplied(7.4), supplied(5.0)];
    let [without, with] = [FILES, WITH_SUPPLY].map(|files| replay(&load(files), &logs).expect("a replay"));
    let unused = |finding: &&omniwalk_sim2real::check::Finding| finding.fault == Fault::UnusedOverride;
    let said = without.check.remarks.iter().find(unused).expect("a remark").to_string();
    assert!(
        said.starts_with("log-1: the override `supply_voltage` is not used"),
        "{said}"
    );
    for words in [
        "`[[effect]]`",
        "`id = \"supply_voltage\"`",
        "`match = [\"*\"]`",
        "`nominal = V`",
    ] {
        assert!(said.contains(words), "{said}");
    }
    assert!(!with.check.remarks.iter().any(|finding| unused(&finding)));
    let errors = [without.measure.overall(), with.measure.overall()];
    assert!(errors[1] < 3.0 * NOISE && errors[0] > 10.0 * errors[1], "{errors:?}");
}
