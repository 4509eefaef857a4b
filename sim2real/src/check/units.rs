//! Units of positions and velocities, by the robot's limits and by each other.

use omniwalk_env::robot::{Joint, JointKind};

use super::findings::{At, Findings};
use super::text::fixed;
use super::{Fault, JointCheck};

/// Positions may lie beyond the limits by this share of the range: stops give, zeros are off.
const BEYOND_LIMITS: f64 = 0.25;
/// Degrees per radian, millimetres per metre.
const FACTORS: [(JointKind, f64, &str); 2] = [
    (
        JointKind::Revolute,
        180.0 / std::f64::consts::PI,
        "degrees, not radians",
    ),
    (JointKind::Prismatic, 1000.0, "millimetres, not metres"),
];
/// A ratio within this factor of one of those above is one of units.
const NEAR: f64 = 2.0;
/// Targets are no farther than this from where a joint is, rad or m: what is stands for none.
const FARTHEST: f64 = 1e4;
/// Velocity and slope of the position agree within this factor.
const AGREE: f64 = 1.1;

impl Findings {
    /// Targets that no joint is meant to follow.
    pub(super) fn far_targets(&mut self, check: &JointCheck, at: At<'_>) {
        let ranges = check.command.range.zip(check.position.range);
        let Some(([lowest, highest], [from, to])) = ranges else {
            return;
        };
        if lowest < from - FARTHEST || highest > to + FARTHEST {
            let message = format!(
                "targets from {lowest:.3e} to {highest:.3e}, positions from {from:.3} to {to:.3}: where there is no command, log none"
            );
            self.refuse(Fault::OutOfRange, at, message);
        }
    }

    /// Positions beyond the limits, and ratios of about 57 between quantities that should agree.
    pub(super) fn units(&mut self, check: &JointCheck, joint: &Joint, at: At<'_>) {
        let factor = FACTORS.iter().find(|(kind, ..)| *kind == joint.kind);
        let Some((_, factor, words)) = factor else { return };
        let near = |ratio: f64| (factor / NEAR..factor * NEAR).contains(&ratio);
        if let Some(relation) = check.following.filter(|relation| relation.best_correlation > 0.7) {
            for (ratio, what) in [(relation.ratio, "the position"), (1.0 / relation.ratio, "the command")] {
                if near(ratio) {
                    self.refuse(
                        Fault::Units,
                        at,
                        format!(
                            "{what} is {ratio:.0} times the other of command and position: it seems to be in {words}"
                        ),
                    );
                }
            }
        }
        if let Some(relation) = check
            .velocity_to_slope
            .filter(|relation| relation.correlation.abs() > 0.7)
        {
            if near(relation.ratio) {
                self.refuse(
                    Fault::Units,
                    at,
                    format!(
                        "the velocity is {:.0} times the slope of the position: it seems to be in {words}, per second",
                        relation.ratio
                    ),
                );
            } else if !(0.5..2.0).contains(&relation.ratio) {
                self.refuse(
                    Fault::Units,
                    at,
                    format!(
                        "the velocity is {:.3} times the slope of the position: its unit or scale is another",
                        relation.ratio
                    ),
                );
            } else if relation.best_correlation > 0.95 && !(1.0 / AGREE..AGREE).contains(&relation.ratio) {
                let message = format!(
                    "the velocity is {:.2} times the slope of the position: one of the two is scaled, or the velocity is filtered; \
                     what depends on the position's scale (gains, masses, sensor_scale) is doubtful if that is the one",
                    relation.ratio
                );
                self.remark(Fault::Units, at, message);
            }
        }
        let (lower, upper) = joint.limits;
        let slack = BEYOND_LIMITS * (upper - lower);
        let Some([smallest, largest]) = check.position.range.filter(|_| slack.is_finite()) else {
            return;
        };
        if smallest >= lower - slack && largest <= upper + slack {
            return;
        }
        let fits = smallest / factor >= lower - slack && largest / factor <= upper + slack;
        let [a, b, c, d] = [smallest, largest, lower, upper].map(|value| fixed(value, 3));
        let range = format!("positions from {a} to {b}, limits {c} to {d}");
        if fits && (smallest.abs().max(largest.abs())) > 3.0 * lower.abs().max(upper.abs()) {
            self.refuse(Fault::Units, at, format!("{range}: they seem to be in {words}"));
        } else {
            self.refuse(
                Fault::OutOfRange,
                at,
                format!("{range}: another robot, another zero, or another unit"),
            );
        }
    }
}
