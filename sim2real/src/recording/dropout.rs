//! Time in which commands were given that are not in the log: a recorder that stopped for a while, or lost messages.

use super::pace::Pace;
use super::{CommandKind, JointRecord, Series};

/// Share of the intervals that may be twice the usual one: a sender with more sends when something changes, and what it sends holds.
const IRREGULAR: f64 = 0.05;
/// A joint that moves by less than this share of its range, in the second half of a gap, was told to stay.
const REST: f64 = 0.02;
/// Fewer readings in the second half of a gap do not show that.
const SHOWN: usize = 3;

impl JointRecord {
    /// Where commands are missing, s from the log's start, from the last one before to the first one after: a sender that is regular
    /// otherwise pauses while its motor is on, and the joint is not seen to come to rest where it was told last.
    pub fn lost_commands(&self) -> Vec<(f64, f64)> {
        let Pace { intervals, usual, gap } = self.command.pace();
        let irregular = intervals.iter().filter(|length| **length > 2.0 * usual).count();
        if intervals.len() < SHOWN || irregular as f64 > IRREGULAR * intervals.len() as f64 {
            return Vec::new();
        }
        let lost = |&(from, to): &(f64, f64)| to - from > gap && self.is_on(from) && !self.stays(from, to);
        let pairs = self.command.time.windows(2).map(|pair| (pair[0], pair[1]));
        pairs.filter(lost).collect()
    }

    /// Whether readings show that the joint comes to rest between commands at two times, s, and no nearer to the second than to the first.
    fn stays(&self, from: f64, to: f64) -> bool {
        let range = |series: &Series, from: f64, to: f64| {
            let own = series.time.partition_point(|t| *t < from)..series.time.partition_point(|t| *t < to);
            let own = &series.value[own];
            let [low, high] = [f64::min, f64::max].map(|pick| own.iter().copied().reduce(pick));
            (own.len() >= SHOWN).then_some((low?, high?))
        };
        let all = range(&self.position, f64::NEG_INFINITY, f64::INFINITY);
        let own = range(&self.position, 0.5 * (from + to), to);
        let (Some((lowest, highest)), Some((low, high))) = (all, own) else {
            return false;
        };
        let still = REST * (highest - lowest);
        let told = [from, to].map(|time| self.command.held_at(time).copied().unwrap_or_default());
        let off = told.map(|told| (told - low).abs());
        let is_told = self.command_kind == CommandKind::Effort || off[0] <= off[1] + still;
        high - low <= still && is_told
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A joint that is told at 100 Hz, and read, for 6 s; `kept` says which commands and which readings are there.
    fn joint(kept: impl Fn(f64) -> (bool, bool), position: impl Fn(f64) -> f64) -> JointRecord {
        let series = |keep: &dyn Fn(f64) -> bool, value: &dyn Fn(f64) -> f64| {
            let time: Vec<f64> = (0..600).map(|k| f64::from(k) * 0.01).filter(|t| keep(*t)).collect();
            let value = time.iter().map(|t| value(*t)).collect();
            Series { time, value }
        };
        JointRecord {
            command: series(&|t| kept(t).0, &f64::sin),
            position: series(&|t| kept(t).1, &position),
            ..JointRecord::default()
        }
    }

    #[test]
    fn commands_are_lost_where_a_joint_moves_on_without_any_or_nothing_is_known_of_it() {
        let outside = |t: f64| !(2.0..3.0).contains(&t);
        let whole = joint(|_| (true, true), f64::sin);
        assert_eq!(whole.lost_commands(), []);
        let near = |lost: Vec<(f64, f64)>| {
            let [(from, to)] = lost[..] else { panic!("{lost:?}") };
            assert!((from - 1.99).abs() < 1e-9 && (to - 3.0).abs() < 1e-9, "{from} {to}");
        };
        let both = joint(|t| (outside(t), outside(t)), f64::sin);
        near(both.lost_commands());
        near(joint(|t| (outside(t), true), f64::sin).lost_commands());
        let held = joint(|t| (outside(t), true), |t| t.min(2.2).sin());
        assert_eq!(held.lost_commands(), [], "it stays where it was told to be");
        let mut stepped = joint(|t| (outside(t), true), |t| if t < 2.2 { 0.0 } else { 1.0 });
        stepped.command.value = stepped.command.time.iter().map(|t| f64::from(*t > 2.1)).collect();
        near(stepped.lost_commands());
        let off = JointRecord {
            enabled: Series {
                time: vec![1.5],
                value: vec![0.0],
            },
            ..both
        };
        assert_eq!(off.lost_commands(), [], "a motor that is off is told nothing");
        let rarely = joint(|t| ((t * 100.0).round() as u32 % 100 < 15, true), f64::sin);
        assert_eq!(rarely.lost_commands(), [], "what is sent when something changes holds");
    }
}
