//! What gates are made of: a figure with the bound it must not reach.

use std::fmt::Write as _;

use serde_json::{Value, json};

use crate::eval::table::number;

/// A figure and its bound.
#[derive(Clone, Debug, PartialEq)]
pub struct Check {
    /// What is compared, in words.
    pub name: String,
    /// The largest difference.
    pub found: f64,
    /// What it must stay below.
    pub bound: f64,
}

impl Check {
    /// A check of that name.
    pub fn new(name: impl Into<String>, found: f64, bound: f64) -> Self {
        Self {
            name: name.into(),
            found,
            bound,
        }
    }

    /// Whether the figure is below its bound; one that is not a number is not.
    pub fn passes(&self) -> bool {
        self.found < self.bound
    }
}

/// A gate as `crosscheck.json` has it: it passes if every check does.
pub fn gate(checks: &[Check]) -> Value {
    let each = checks.iter().map(|check| {
        json!({
            "check": check.name, "found": number(check.found), "bound": number(check.bound), "pass": check.passes(),
        })
    });
    json!({ "pass": checks.iter().all(Check::passes), "checks": each.collect::<Vec<_>>() })
}

/// The checks for people, under `title`.
pub fn text(title: &str, checks: &[Check]) -> String {
    let mut out = format!("{title:<58}    found    bound\n");
    for check in checks {
        let verdict = if check.passes() { "pass" } else { "FAIL" };
        let _ = writeln!(
            out,
            "{:<58} {:>8.1e} {:>8.1e}  {verdict}",
            check.name, check.found, check.bound
        );
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_gate_with_one_figure_beyond_its_bound_or_none_at_all_does_not_pass() {
        let good = || Check::new("a", 1e-9, 1e-6);
        assert_eq!(gate(&[good(), good()])["pass"], true);
        for found in [1e-6, 1.0, f64::NAN] {
            let checks = [good(), Check::new("b", found, 1e-6)];
            assert_eq!(gate(&checks)["pass"], false);
            assert!(text("gate", &checks).contains("FAIL"));
        }
    }
}
