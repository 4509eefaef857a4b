//! A check for the terminal.

use std::fmt;

use super::{Check, Finding, JointCheck};

/// Joints of a log, and logs, that are listed; the report holds all.
const LISTED: usize = 40;

impl fmt::Display for Check {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(
            f,
            "  joint                  read Hz  jitter  gap s  repeats  command Hz  lag ms   range             fastest  coverage"
        )?;
        for log in self.logs.iter().take(LISTED) {
            writeln!(f, "{}: {:.2} s, joints: {}", log.name, log.seconds, log.joints.len())?;
            for joint in log.joints.iter().take(LISTED) {
                row(f, joint)?;
            }
            if log.joints.len() > LISTED {
                writeln!(f, "  ... and {} more", log.joints.len() - LISTED)?;
            }
        }
        if self.logs.len() > LISTED {
            writeln!(f, "... and {} more logs", self.logs.len() - LISTED)?;
        }
        for (findings, word) in [(&self.remarks, "note"), (&self.refusals, "refused")] {
            for finding in findings {
                writeln!(f, "{word}: {finding}")?;
            }
        }
        Ok(())
    }
}

fn row(f: &mut fmt::Formatter<'_>, joint: &JointCheck) -> fmt::Result {
    let lag = joint
        .following
        .map_or_else(|| "-".to_owned(), |relation| format!("{:.0}", 1000.0 * relation.lag));
    let [lower, upper] = joint.excitation.range;
    writeln!(
        f,
        "  {:<22} {:>7.1} {:>7.2} {:>6.3} {:>8} {:>11.1} {:>7} {:>8.3}..{:<8.3} {:>8.2} {:>8.0} %",
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
        for place in [&self.log, &self.joint].into_iter().flatten() {
            write!(f, "{place}: ")?;
        }
        f.write_str(&self.message)
    }
}
