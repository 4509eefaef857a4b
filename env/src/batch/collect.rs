//! Many steps in one go: every group goes through them by itself.

use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::Batch;
use super::group::Rows;
use super::schedule::{self, Schedule};
use crate::task::episode::{End, Fault};
use crate::task::reward::Terms;

/// Chooses the actions of groups of environments and takes in what they lead to, see [`Batch::roll`]. Threads share it; what
/// belongs to a group is in its part. Neither method may hand work to the rayon pool: a thread that waited for it could
/// be given another group meanwhile.
pub trait Collect: Sync {
    /// What is kept for a group.
    type Part: Send;

    /// The actions of a step, in [0, 1], one row an environment of the group, from as many observations.
    fn act<'p>(&self, part: &'p mut Self::Part, step: usize, observations: &[f32]) -> &'p [f32];

    /// Takes in what the step led to.
    fn take(&self, part: &mut Self::Part, step: usize, outcomes: &Outcomes<'_>);
}

/// What a step gave in a group of environments: rows as in the [`Batch`].
pub struct Outcomes<'a> {
    /// Observations that wait for the next action.
    pub observations: &'a [f32],
    /// The last observation of the episodes that ended; other rows are meaningless.
    pub final_observations: &'a [f32],
    /// Rewards by term.
    pub terms: &'a [Terms],
    /// Which episodes ended, and how.
    pub ends: &'a [Option<End>],
    /// Of the episodes that were lost: the environment's index in the batch, and what was not finite.
    pub faults: &'a [(usize, Fault)],
}

impl<'a> Outcomes<'a> {
    pub(super) fn new(rows: &'a Rows<'_>, faults: &'a [(usize, Fault)]) -> Self {
        Self {
            observations: rows.observations,
            final_observations: rows.final_observations,
            terms: rows.terms,
            ends: rows.ends,
            faults,
        }
    }
}

impl Batch {
    /// `steps` control steps with the actions that `collect` chooses. Every group goes through them by itself, without
    /// waiting for the others; the threads of the current rayon pool exchange groups, so that all are done at the same time
    /// however unlike the cores are. `parts` has one element a group.
    ///
    /// # Panics
    /// If there are not as many parts as groups.
    pub fn roll<C: Collect>(&mut self, steps: usize, collect: &C, parts: &mut [C::Part]) {
        let groups = self.groups.len();
        assert_eq!(parts.len(), groups, "one part a group");
        if groups <= schedule::GROUPS {
            self.roll_together(steps, collect, parts);
        } else {
            self.each_group(parts.par_iter_mut(), |shared, factors, group, rows, part| {
                (0..steps).for_each(|step| group.collect(shared, factors, step, collect, rows, part));
            });
        }
        self.faults.clear();
    }

    fn roll_together<C: Collect>(&mut self, steps: usize, collect: &C, parts: &mut [C::Part]) {
        let (shared, factors, width, groups) = (&self.shared, self.factors, self.width(), self.groups.len());
        let n = shared.spec.observation_len();
        let mut rows = self
            .observations
            .chunks_mut(width * n)
            .zip(self.final_observations.chunks_mut(width * n))
            .zip(self.terms.chunks_mut(width).zip(self.ends.chunks_mut(width)))
            .map(|((observations, final_observations), (terms, ends))| Rows {
                observations,
                final_observations,
                terms,
                ends,
            })
            .zip(self.groups.iter_mut().zip(parts));
        let seats: [_; schedule::GROUPS] = std::array::from_fn(|_| Mutex::new(rows.next()));
        let schedule = Schedule::new(groups, steps);
        let threads = rayon::current_num_threads().min(groups);
        (0..threads).into_par_iter().with_max_len(1).for_each(|_| {
            schedule.work(|group, step| {
                let mut seat = seats[group].lock().unwrap_or_else(PoisonError::into_inner);
                let (rows, (group, part)) = seat.as_mut().expect("a seat for every group");
                group.collect(shared, factors, step, collect, rows, part);
            });
        });
        self.gather();
    }
}
