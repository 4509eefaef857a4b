//! Logs that cannot carry an answer get none.

use omniwalk_sim2real::identify::Verdict;
use omniwalk_sim2real::recording::Recording;

use crate::rig::{identify, logs, rig};

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

#[test]
fn logs_that_carry_no_answer_are_not_explained() {
    let spoils: [(&str, Spoil); 20] = [
        ("half a second", |logs| cut(logs, 0.5)),
        ("two seconds", |logs| cut(logs, 2.0)),
        ("two readings", |logs| cut(logs, 0.012)),
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
        ("saturated", |logs| each(logs, |_, q| *q = q.clamp(-0.1, 0.1))),
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
        assert_ne!(outcome.verdict, Verdict::Explained, "{name}: {:?}", outcome.accepted);
        assert_eq!(
            outcome.reasons.is_empty(),
            outcome.verdict != Verdict::InsufficientData,
            "{name}"
        );
    }
}
