//! What a model must gain on another to be worth having.

use std::ops::Range;

use omniwalk_env::robot::Robot;

use super::super::contact;
use super::super::cross::block_logs;
use super::super::fit::{Fit, Loss, total};
use super::super::gain::Gain;
use super::super::leftover;
use super::{Judged, Selector};

/// Probability of a false alarm in a step, over all effects tried.
const FALSE_ALARM: f64 = 0.05;
/// Least fall of the cross-validated loss that makes an effect worth having.
pub(super) const WORTH: f64 = 0.02;
/// The same as a share of what noise and integrator leave to be explained.
pub(super) const WORTH_OF_GAP: f64 = 0.05;
/// What is left is more than noise when the loss is so many times the floor's.
const ABOVE_FLOOR: f64 = 1.5;
/// Where all that is left is negligible an effect must take this share of it.
const WORTH_OF_LITTLE: f64 = 0.5;
/// Effects are told apart when the difference is this unlikely by chance ...
pub(super) const APART: f64 = 0.02;
/// ... and at least this share of the loss.
const APART_SHARE: f64 = 0.01;
/// Blocks that one hold reaches into.
const HOLD: usize = 3;
/// How far a joint that sticks may be from where it did, in units of what its friction holds against its servo: from one side to the other.
const STICKING: f64 = 2.0;
/// An effect is none of the ground's when it takes so many times what it would take were nothing missing and the ground another.
const BEYOND_CONTACT: f64 = 2.0;

impl Selector<'_> {
    /// Of which degrees of freedom `fit` leaves more than noise.
    pub(super) fn above_floor(&self, fit: &Fit) -> Vec<bool> {
        let left = leftover::squares(self.data, &fit.model);
        let own = left.iter().zip(&self.floors);
        own.map(|(left, floor)| *left > ABOVE_FLOOR * floor).collect()
    }

    /// Whether `after` predicts better than `before` by what is worth it, and beyond chance for the best of `count` in every limb.
    pub(super) fn is_better(&self, before: &Judged, after: &Judged, count: usize) -> bool {
        let gain = self.folds.gain(&before.cross, &after.cross);
        self.worth(before, after, &gain) && gain.p * (count * self.limbs) as f64 <= FALSE_ALARM
    }

    /// Whether `after` predicts so much better than `before` (by `gain`) that it is worth having; what the fits to all do not
    /// show, their cross-validation shows by accident.
    pub(super) fn worth(&self, before: &Judged, after: &Judged, gain: &Gain) -> bool {
        if total(&after.fit.losses) > (1.0 - WORTH) * total(&before.fit.losses) {
            return false;
        }
        let beyond = self.beyond_negligible(&before.cross);
        let takes = |share: f64, counts: &dyn Fn(usize) -> bool| {
            let [loss, left] = [&before.cross, &after.cross].map(|losses| self.sum_of(losses, counts));
            let dofs = self.floors.iter().enumerate().filter(|(d, _)| counts(*d));
            let gap = loss - dofs.map(|(_, floor)| floor).sum::<f64>();
            loss - left >= share * gap
        };
        let enough = if beyond.contains(&true) {
            takes(WORTH_OF_GAP, &|d| beyond[d])
        } else {
            // Of one joint: what others leave above their floors is none of its effect's.
            let above = |d: &usize| self.sum_of(&before.cross, |own| own == *d) > ABOVE_FLOOR * self.floors[*d];
            (0..self.floors.len())
                .filter(above)
                .any(|joint| takes(WORTH_OF_LITTLE, &|d| d == joint))
        };
        gain.share >= WORTH && enough
    }

    /// Sum of losses by block and degree of freedom over those degrees of freedom that `counts` names.
    pub(super) fn sum_of(&self, losses: &[Loss], counts: impl Fn(usize) -> bool) -> f64 {
        let dofs = self.floors.len();
        let own = losses.iter().enumerate().filter(|(cell, _)| counts(cell % dofs));
        own.map(|(_, loss)| loss.squares).sum()
    }

    /// Of which degrees of freedom more is left than what is negligible.
    fn beyond_negligible(&self, losses: &[Loss]) -> Vec<bool> {
        let dofs = self.floors.len();
        let bound: Vec<f64> = self.floors.iter().zip(&self.negligible).map(|(a, b)| a + b).collect();
        (0..dofs)
            .map(|d| self.sum_of(losses, |own| own == d) > bound[d])
            .collect()
    }

    /// Whether `better` fits and predicts better than `worse` beyond chance. What fits all logs as well is no worse for what one step from
    /// there does in a fold: friction that differs between the directions by as much as there is bends where one of them has none left, and
    /// a constant torque, which does the same, does not.
    pub(super) fn is_worse(&self, worse: &Judged, better: &Judged) -> bool {
        total(&worse.fit.losses) > (1.0 + APART_SHARE) * total(&better.fit.losses)
            && self.apart(&worse.cross, &better.cross)
    }

    /// Whether `better` predicts better than `worse` beyond chance. What is off by no more than noise cannot be ruled out,
    /// whatever predicts better; nor can what is off by more than that in one hold alone.
    pub(super) fn apart(&self, worse: &[Loss], better: &[Loss]) -> bool {
        let is_better = |worse: &[Loss], better: &[Loss]| {
            let gain = self.folds.gain(worse, better);
            gain.share >= APART_SHARE && gain.p <= APART
        };
        if total(worse) <= self.floor || !is_better(worse, better) {
            return false;
        }
        let Some(hold) = self.hold(worse, better) else {
            return true;
        };
        let dofs = self.floors.len();
        let rest = |losses: &[Loss]| {
            let mut losses = losses.to_vec();
            losses[hold.start * dofs..hold.end * dofs].fill(Loss::default());
            losses
        };
        let (worse_rest, better_rest) = (rest(worse), rest(better));
        let share = count(&worse_rest) / count(worse);
        total(&worse_rest) > ABOVE_FLOOR * self.floor * share && is_better(&worse_rest, &better_rest)
    }

    /// The stretch of time of a log, of the length of a hold, in which `better` gains most on `worse`, where `worse` is off by no more there
    /// than a joint that sticks in another place than it did: little decides where, with the right effects too. As blocks.
    pub(super) fn hold(&self, worse: &[Loss], better: &[Loss]) -> Option<Range<usize>> {
        let dofs = self.floors.len();
        let logs = block_logs(self.data);
        let ranges = (0..logs.len()).filter_map(|first| {
            let last = (first + HOLD).min(logs.len());
            (logs[first] == logs[last - 1]).then_some(first..last)
        });
        let cells = |blocks: &Range<usize>| blocks.start * dofs..blocks.end * dofs;
        let gain = |blocks: &Range<usize>| total(&worse[cells(blocks)]) - total(&better[cells(blocks)]);
        let most = ranges.max_by(|a, b| gain(a).total_cmp(&gain(b)))?;
        let sticks = |cell: usize| {
            let reach = STICKING * self.data.weights[cell % dofs] * sticking(self.robot, cell % dofs);
            worse[cell].squares <= reach * reach * worse[cell].count
        };
        cells(&most).all(sticks).then_some(most)
    }

    /// Whether what `after` takes is more than another model of ground contact would let it take.
    pub(super) fn beyond_contact(&self, before: &Judged, after: &Judged) -> bool {
        if !self.data.is_free() {
            return true;
        }
        let there = contact::elsewhere(self.data, &before.fit.model);
        let nothing = total(&there.losses(std::slice::from_ref(&before.fit.model))[0]);
        let made = nothing - total(&there.fit(&after.fit.model, self.scales, &|_| true).losses);
        total(&before.fit.losses) - total(&after.fit.losses) > BEYOND_CONTACT * made
    }

    /// Why an effect with `gain` was not taken, of `count` that were tried.
    pub(super) fn reason(&self, gain: &Gain, count: usize) -> String {
        if gain.share < WORTH {
            format!("cross-validated loss falls by {:.1} %", 100.0 * gain.share.max(-9.99))
        } else if gain.p * count as f64 > FALSE_ALARM {
            let p = (gain.p * count as f64).min(1.0);
            format!("not significant: p = {p:.2} over {count} effects tried")
        } else {
            "needless beside what was accepted".to_owned()
        }
    }
}

/// Readings that losses are of.
fn count(losses: &[Loss]) -> f64 {
    losses.iter().map(|loss| loss.count).sum()
}

/// How far from its target dry friction holds degree of freedom `dof` of `robot` against its servo, rad or m; nowhere without either.
fn sticking(robot: &Robot, dof: usize) -> f64 {
    let joint = robot.dof(dof);
    let stiffness = joint.actuator.map_or(0.0, |actuator| actuator.stiffness());
    if stiffness > 0.0 {
        joint.passive.friction / stiffness
    } else {
        0.0
    }
}

/// Whether `loss` is more than noise, and more than what is `negligible` beside it.
pub fn is_above(loss: f64, floor: f64, negligible: f64) -> bool {
    loss > ABOVE_FLOOR * floor && loss > floor + negligible
}

#[cfg(test)]
mod tests {
    use super::super::super::cross::Folds;
    use super::super::super::cut::Lengths;
    use super::super::super::floor::Floor;
    use super::super::super::hinge::{chain, robot, swings};
    use super::super::super::model::Model;
    use super::super::super::scales::Scales;
    use super::*;

    #[test]
    fn an_effect_takes_half_of_what_is_negligible_at_its_own_joint() {
        let robot = chain(&["upper", "lower"], "kp = 30.0\nkd = 1.0\n");
        let data = swings(
            &robot,
            2,
            Lengths {
                block: 0.5,
                piece: 60.0,
            },
        );
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let nominal = Model::nominal(&robot, &data.trials);
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let mut selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        (selector.floors, selector.negligible) = (vec![100.0, 100.0], vec![200.0, 200.0]);
        let fit = data.fit(&nominal, &scales, &|_| true);
        let blocks = data.blocks as f64;
        // Losses of each joint, in units of its floor; what is fitted falls with what is predicted.
        let judged = |joints: [f64; 2]| {
            let loss = |own: f64| Loss {
                squares: 100.0 * own / blocks,
                count: 1.0,
            };
            let mut fit = fit.clone();
            fit.losses = vec![loss(joints[0] + joints[1]); data.blocks];
            let cross = (0..data.blocks).flat_map(|_| joints.map(loss)).collect();
            Judged { fit, cross }
        };
        let is_worth = |before: [f64; 2], after: [f64; 2]| {
            let (before, after) = (judged(before), judged(after));
            selector.worth(&before, &after, &folds.gain(&before.cross, &after.cross))
        };
        assert!(is_worth([2.5, 2.5], [1.6, 2.5]), "three fifths of its gap");
        assert!(!is_worth([2.5, 2.5], [1.9, 2.5]), "two fifths of it");
        assert!(
            !is_worth([1.4, 1.4], [1.0, 1.4]),
            "of a joint that leaves no more than noise"
        );
        assert!(is_worth([3.5, 3.5], [3.0, 3.5]), "a fifth of what is not negligible");
    }

    #[test]
    fn what_fits_all_logs_as_well_is_no_worse_for_its_folds() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let lengths = Lengths {
            block: 0.5,
            piece: 60.0,
        };
        let data = swings(&robot, 2, lengths);
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let nominal = Model::nominal(&robot, &data.trials);
        let floor = Floor::new(&data, &nominal, &scales).expect("a floor");
        let mut selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        selector.floor = 1.0;
        let fit = data.fit(&nominal, &scales, &|_| true);
        let losses = |squares: f64| vec![Loss { squares, count: 1.0 }; data.blocks];
        let judged = |fitted: f64, predicted: f64| Judged {
            fit: Fit {
                losses: losses(fitted),
                ..fit.clone()
            },
            cross: losses(predicted),
        };
        let best = judged(1.0, 1.1);
        assert!(selector.is_worse(&judged(1.05, 1.2), &best));
        assert!(!selector.is_worse(&judged(1.005, 1.2), &best), "its fit is as good");
        assert!(!selector.is_worse(&judged(1.05, 1.1), &best), "it predicts as well");
    }

    #[test]
    fn a_hold_is_where_a_joint_sticks_elsewhere_and_nowhere_else() {
        // Dry friction holds it within 0.01 rad of its target.
        let robot = robot("kp = 30.0\nkd = 1.0\nfriction = 0.3\n");
        let data = swings(
            &robot,
            2,
            Lengths {
                block: 0.5,
                piece: 60.0,
            },
        );
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let floor = Floor::new(&data, &Model::default(), &scales).expect("a floor");
        let selector = Selector::new(&robot, &data, &scales, &folds, &floor);
        // Off by this in three blocks, or in others by less.
        let losses = |off: f64| {
            let own = |block: usize| match block {
                20..23 => off,
                _ => 1e-4,
            };
            let loss = |block: usize| Loss {
                squares: 100.0 * own(block) * own(block),
                count: 100.0,
            };
            (0..data.blocks).map(loss).collect::<Vec<_>>()
        };
        let good = losses(1e-4);
        assert_eq!(selector.hold(&losses(0.015), &good), Some(20..23));
        assert_eq!(
            selector.hold(&losses(0.025), &good),
            None,
            "farther off than it can stick"
        );
        let last_of_first = block_logs(&data).iter().filter(|log| **log == 0).count();
        assert!(last_of_first < 20, "the hold is one of the second log");
    }
}
