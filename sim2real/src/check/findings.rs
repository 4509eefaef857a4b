//! Findings, each said once.

use std::collections::HashMap;

use super::{Fault, Finding};

/// What was found.
#[derive(Default)]
pub(super) struct Findings {
    pub refusals: Pile,
    pub remarks: Pile,
}

/// Where a finding is.
#[derive(Clone, Copy, Default)]
pub(super) struct At<'a> {
    pub log: Option<&'a str>,
    pub joint: Option<&'a str>,
}

impl Findings {
    pub fn refuse(&mut self, fault: Fault, at: At<'_>, message: impl Into<String>) {
        self.refusals.add(fault, at, message.into());
    }

    pub fn remark(&mut self, fault: Fault, at: At<'_>, message: impl Into<String>) {
        self.remarks.add(fault, at, message.into());
    }
}

/// Findings of which those that say the same of several logs, numbers aside, are one.
#[derive(Default)]
pub(super) struct Pile {
    findings: Vec<Finding>,
    /// Of each kind the last finding, and the last log that it is true of.
    last: HashMap<Kind, (usize, Option<String>)>,
}

/// What findings have in common that are one: the fault, the joint, and the words.
type Kind = (Fault, Option<String>, String);

impl Pile {
    /// The findings, in the order of their first logs.
    pub fn into_findings(self) -> Vec<Finding> {
        self.findings
    }

    fn add(&mut self, fault: Fault, at: At<'_>, message: String) {
        let (log, joint) = (at.log.map(str::to_owned), at.joint.map(str::to_owned));
        let kind = (fault, joint.clone(), words(&message));
        if let Some((index, last)) = self.last.get_mut(&kind) {
            let old = &mut self.findings[*index];
            if *last != log {
                old.others += 1;
                *last = log;
                return;
            }
            if old.message == message {
                return;
            }
        }
        self.last.insert(kind, (self.findings.len(), log.clone()));
        self.findings.push(Finding {
            fault,
            log,
            others: 0,
            joint,
            message,
        });
    }
}

/// The words of a message without its numbers.
fn words(message: &str) -> String {
    let number = |word: &&str| word.trim_matches(['(', ')', ',', ':', ';']).parse::<f64>().is_ok();
    let words: Vec<&str> = message.split_whitespace().filter(|word| !number(word)).collect();
    words.join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_the_same_of_many_logs_but_for_numbers_is_said_once_with_their_number() {
        let mut found = Findings::default();
        for log in ["a", "b", "c"] {
            let at = At {
                log: Some(log),
                joint: Some("knee"),
            };
            found.refuse(
                Fault::Units,
                at,
                format!("positions from -0.1 to {}.5, not rad", log.len()),
            );
            found.refuse(Fault::Units, at, "the velocity is 57 times the slope");
            found.refuse(Fault::Swapped, at, format!("`j{log}` and `knee` are swapped"));
        }
        let said: Vec<String> = found.refusals.into_findings().iter().map(ToString::to_string).collect();
        assert_eq!(said.len(), 5, "{said:?}");
        assert_eq!(said[0], "a and 2 other logs: knee: positions from -0.1 to 1.5, not rad");
        assert_eq!(said[1], "a and 2 other logs: knee: the velocity is 57 times the slope");
        assert_eq!(said[4], "c: knee: `jc` and `knee` are swapped");
    }
}
