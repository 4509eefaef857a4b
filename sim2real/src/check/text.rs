//! A check for the terminal.

use std::fmt;

use super::{Check, Finding, JointCheck, LogCheck};

/// Joints, over all logs, that are listed; the report holds all.
const LISTED: usize = 60;

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "  joint                  read Hz  jitter  gap s  repeats  command Hz  lag ms   range             fastest  coverage"
        )?;
        let mut left = LISTED;
        for log in &self.logs {
            if left == 0 {
                break;
            }
            writeln!(
                f,
                "{}: {} s, joints: {}{}",
                log.name,
                fixed(log.seconds, 2),
                log.joints.len(),
                stamps(log)
            )?;
            for joint in log.joints.iter().take(left) {
                row(f, joint)?;
            }
            left -= log.joints.len().clamp(1, left);
        }
        let all: usize = self.logs.iter().map(|log| log.joints.len()).sum();
        if all > LISTED {
            writeln!(f, "... {all} joints in {} logs; the report has all", self.logs.len())?;
        }
        for (findings, word) in [(&self.remarks, "note"), (&self.refusals, "refused")] {
            for finding in findings {
                writeln!(f, "{word}: {finding}")?;
            }
        }
        Ok(())
    }
}

/// By how much the stamps of a log's topics lie before log time; their differences are what clocks are apart.
fn stamps(log: &LogCheck) -> String {
    let known = log
        .clocks
        .iter()
        .filter_map(|(topic, before)| Some((topic, (*before)?)));
    let known: Vec<String> = known
        .map(|(topic, before)| format!("{topic} {}", fixed(1000.0 * before, 1)))
        .collect();
    if known.is_empty() {
        return String::new();
    }
    format!("; stamps before log time, ms: {}", known.join(", "))
}

fn row(f: &mut fmt::Formatter<'_>, joint: &JointCheck) -> fmt::Result {
    let lag = joint
        .following
        .map_or_else(|| "-".to_owned(), |relation| fixed(1000.0 * relation.lag, 0));
    let [lower, upper] = joint.excitation.range.map(|value| fixed(value, 3));
    writeln!(
        f,
        "  {:<22} {:>7.1} {:>7.2} {:>6.3} {:>8} {:>11.1} {:>7} {:>8}..{:<8} {:>8.2} {:>8.0} %",
        joint.name,
        joint.position.rate,
        joint.position.jitter,
        joint.position.longest_gap,
        joint.repeated,
        joint.command.rate,
        lag,
        lower,
        upper,
        joint.excitation.fastest,
        100.0 * joint.excitation.coverage,
    )
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(log) = &self.log {
            match self.others {
                0 => write!(f, "{log}: ")?,
                1 => write!(f, "{log} and 1 other log: ")?,
                others => write!(f, "{log} and {others} other logs: ")?,
            }
        }
        if let Some(joint) = &self.joint {
            write!(f, "{joint}: ")?;
        }
        f.write_str(&self.message)
    }
}

/// Largest number that is written out.
const WRITTEN_OUT: f64 = 1e12;

/// `value` with so many digits; a zero has no sign.
pub(super) fn fixed(value: f64, digits: usize) -> String {
    if value.abs() >= WRITTEN_OUT {
        return format!("{value:.digits$e}");
    }
    let text = format!("{value:.digits$}");
    if text.bytes().all(|byte| b"-0.".contains(&byte)) {
        return text.trim_start_matches('-').to_owned();
    }
    text
}
