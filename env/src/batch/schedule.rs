//! Who steps which group: threads change groups, so that all of them are done at the same time however unlike their cores are.
//!
//! Two groups on two cores, one of which is slowed down by other work or made for saving power, would take as long as the
//! slow one takes. So whoever is well ahead of a group half way takes that one over, and its thread goes on with another.

use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};

/// Most groups that are scheduled: of more there are enough for every core to find another when it is done with one.
pub const GROUPS: usize = 16;

/// Steps by which a group must be ahead of another to be exchanged for it.
///
/// An exchange costs the threads two steps: a group's numbers go from one core's cache to the other's. Chance leads of a few steps are
/// better left alone, and between cores that differ once, half way, does: the lead of the first half is made up for in the second
/// (docs/performance.md: 1.37 of one core instead of 0.95 where the other takes twice as long). What is left over is looked at half way
/// through what is left, and so on.
const LEAD: usize = 8;

/// Which steps are done and who is at what.
pub struct Schedule {
    steps: usize,
    board: Mutex<Board>,
    changed: Condvar,
}

struct Board {
    groups: usize,
    /// Steps done by group.
    done: [usize; GROUPS],
    /// Whether a thread has the group.
    held: [bool; GROUPS],
    /// Whether a thread waits for the group.
    wanted: [bool; GROUPS],
    /// Whether a thread has panicked.
    broken: bool,
}

impl Schedule {
    /// `steps` steps of each of at most [`GROUPS`] groups.
    pub fn new(groups: usize, steps: usize) -> Self {
        let groups_beyond = |group| if group < groups { 0 } else { steps };
        Self {
            steps,
            board: Mutex::new(Board {
                groups,
                done: std::array::from_fn(groups_beyond),
                held: [false; GROUPS],
                wanted: [false; GROUPS],
                broken: false,
            }),
            changed: Condvar::new(),
        }
    }

    /// Does steps until there are none left for the thread that calls: `step` is given the group and the step's number.
    pub fn work(&self, step: impl Fn(usize, usize)) {
        let guard = BreakOnPanic(self);
        let mut turn = self.begin();
        while let Some((group, number)) = turn {
            step(group, number);
            turn = self.proceed(group);
        }
        drop(guard);
    }

    /// A group nobody has, and the step that is next in it.
    fn begin(&self) -> Option<(usize, usize)> {
        let mut board = self.board();
        let group = board.free(self.steps)?;
        Some(board.take(group))
    }

    /// After a step of `group`, what the thread goes on with.
    fn proceed(&self, group: usize) -> Option<(usize, usize)> {
        let mut board = self.board();
        board.done[group] += 1;
        if board.done[group] == self.steps || board.wanted[group] && board.free(self.steps).is_some() {
            return self.change(board, group);
        }
        let behind = (0..board.groups)
            .filter(|&other| board.done[other] + LEAD <= board.done[group] && !board.wanted[other])
            .filter(|_| self.is_half_way(board.done[group]))
            .min_by_key(|&other| board.done[other]);
        match behind {
            None => Some((group, board.done[group])),
            Some(other) => self.exchange(board, group, other),
        }
    }

    /// Whether half of the steps, or of what a half left, and so on, is left after `done`.
    fn is_half_way(&self, done: usize) -> bool {
        let left = self.steps - done;
        (1..=self.steps.ilog2()).any(|halvings| self.steps >> halvings == left)
    }

    /// Leaves `group` to others and takes one that nobody has.
    fn change(&self, mut board: MutexGuard<'_, Board>, group: usize) -> Option<(usize, usize)> {
        let next = board.free(self.steps);
        board.held[group] = false;
        self.changed.notify_all();
        next.map(|next| board.take(next))
    }

    /// Leaves `group` to others and takes `other`, which is behind, as soon as its thread has done its step.
    fn exchange(&self, mut board: MutexGuard<'_, Board>, group: usize, other: usize) -> Option<(usize, usize)> {
        board.held[group] = false;
        if board.held[other] {
            board.wanted[other] = true;
            while board.held[other] && !board.broken {
                board = self.changed.wait(board).unwrap_or_else(PoisonError::into_inner);
            }
            board.wanted[other] = false;
        }
        let unfinished = board.done[other] < self.steps;
        let next = if unfinished {
            Some(other)
        } else {
            board.free(self.steps)
        };
        next.filter(|_| !board.broken).map(|next| board.take(next))
    }

    fn board(&self) -> MutexGuard<'_, Board> {
        self.board.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Board {
    /// The group that is furthest behind of those that nobody has or waits for.
    fn free(&self, steps: usize) -> Option<usize> {
        (0..self.groups)
            .filter(|&group| self.done[group] < steps && !self.held[group] && !self.wanted[group])
            .min_by_key(|&group| self.done[group])
    }

    fn take(&mut self, group: usize) -> (usize, usize) {
        self.held[group] = true;
        (group, self.done[group])
    }
}

/// Lets nobody wait for a thread that has panicked.
struct BreakOnPanic<'a>(&'a Schedule);

impl Drop for BreakOnPanic<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.board().broken = true;
            self.0.changed.notify_all();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn every_step_of_every_group_is_done_once_and_in_order() {
        for (groups, threads) in [(1, 1), (1, 3), (2, 1), (2, 2), (3, 2), (5, 3), (16, 4)] {
            let schedule = Schedule::new(groups, 200);
            let done: Vec<_> = (0..groups).map(|_| Mutex::new(0)).collect();
            std::thread::scope(|scope| {
                for _ in 0..threads {
                    scope.spawn(|| {
                        schedule.work(|group, number| {
                            let mut done = done[group].try_lock().expect("one thread a group");
                            assert_eq!(*done, number, "steps in order");
                            *done += 1;
                            std::thread::yield_now();
                        });
                    });
                }
            });
            assert!(done.iter().all(|done| *done.lock().unwrap() == 200));
        }
    }

    #[test]
    fn a_thread_that_is_ahead_exchanges_groups_with_one_that_is_behind() {
        let schedule = Schedule::new(2, 2 * LEAD);
        assert_eq!(schedule.begin(), Some((0, 0)));
        std::thread::scope(|scope| {
            let fast = scope.spawn(|| {
                let mut turn = schedule.begin();
                for step in 0..LEAD {
                    assert_eq!(turn, Some((1, step)));
                    turn = schedule.proceed(1);
                }
                turn
            });
            while !schedule.board().wanted[0] {
                std::thread::yield_now();
            }
            assert_eq!(schedule.proceed(0), Some((1, LEAD)));
            assert_eq!(fast.join().unwrap(), Some((0, 1)));
        });
    }

    #[test]
    fn groups_are_exchanged_half_way_through_what_is_left_and_not_in_between() {
        let schedule = Schedule::new(2, 100);
        let half_way: Vec<_> = (0..100).filter(|&done| schedule.is_half_way(done)).collect();
        assert_eq!(half_way, [50, 75, 88, 94, 97, 99]);
        assert_eq!((schedule.begin(), schedule.begin()), (Some((0, 0)), Some((1, 0))));
        for step in 1..50 {
            assert_eq!(schedule.proceed(1), Some((1, step)));
        }
        assert!(!schedule.board().wanted[0]);
    }

    #[test]
    fn a_panic_in_a_step_leaves_nobody_waiting() {
        let schedule = Schedule::new(2, 1000);
        let panicked = std::thread::scope(|scope| {
            let work = |fails: bool| {
                schedule.work(|_, number| {
                    std::thread::sleep(Duration::from_micros(if fails { 2000 } else { 10 }));
                    assert!(!(fails && number > 3), "meant to happen");
                });
            };
            let threads = [true, false].map(|fails| scope.spawn(move || work(fails)));
            threads.map(|thread| thread.join().is_err())
        });
        assert_eq!(panicked, [true, false]);
    }
}
