//! Less data where fits are dear: to begin with, not to end with.

use std::sync::Arc;

use super::fit::Data;

/// Stretches of a robot that walks freely that suffice to get near a fit: more than ten seconds of them.
const STRETCHES: usize = 48;
/// By how much the physics step is coarser. What a much coarser one leaves is its own, and every effect takes as much of that.
const COARSER: usize = 4;

impl Data {
    /// Less to compute: at a coarser physics step; of a robot that walks freely no more than [`STRETCHES`] of its stretches,
    /// evenly spread. Fits that begin far off get near by it, and end with all.
    pub fn rough(&self) -> Self {
        let mut rough = Self {
            finer: (self.finer / COARSER).max(1),
            ..self.clone()
        };
        if self.is_free() {
            let every = self.trials.len().div_ceil(STRETCHES);
            rough.trials = Arc::new(self.trials.iter().step_by(every).cloned().collect());
            rough.robots = Arc::new(self.robots.iter().step_by(every).cloned().collect());
            rough.first_block = self.first_block.iter().step_by(every).copied().collect();
        }
        rough
    }

    /// Whether a fit takes so long that it is begun with [`Self::rough`] data.
    pub fn is_dear(&self) -> bool {
        self.finer > 1 || self.is_free()
    }

    /// Whether the base is not held.
    pub fn is_free(&self) -> bool {
        self.trials.iter().any(|trial| trial.base.is_some())
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::super::base::MeasuredBase;
    use super::super::cut::Lengths;
    use super::super::hinge::{robot, swings};
    use super::*;

    #[test]
    fn rough_data_of_a_robot_that_walks_are_stretches_spread_over_all_its_logs() {
        let held = swings(&robot(""), 2, Lengths { block: 0.1, piece: 0.1 });
        assert_eq!(held.rough().trials.len(), held.trials.len());
        let mut free = held;
        for trial in Arc::make_mut(&mut free.trials) {
            trial.base = Some(MeasuredBase {
                orientation: UnitQuaternion::identity(),
                angular_velocity: Vector3::zeros(),
            });
        }
        let rough = free.rough();
        let kept = rough.trials.len();
        assert!(
            (STRETCHES / 2..=STRETCHES).contains(&kept),
            "{kept} of {}",
            free.trials.len()
        );
        assert_eq!((rough.robots.len(), rough.first_block.len()), (kept, kept));
        let of_log = |log| rough.trials.iter().filter(|trial| trial.log == log).count();
        assert!(of_log(0).abs_diff(of_log(1)) <= 1);
        let every = free.trials.len().div_ceil(STRETCHES);
        for (k, (trial, first)) in rough.trials.iter().zip(&rough.first_block).enumerate() {
            let (same, own) = (&free.trials[k * every], free.first_block[k * every]);
            assert_eq!(
                (trial.log, trial.start.to_bits(), *first),
                (same.log, same.start.to_bits(), own)
            );
        }
    }
}
