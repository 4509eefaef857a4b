//! The latest finished episodes, averaged for whoever watches a run.

use std::collections::VecDeque;

use omniwalk_env::task::episode::{End, Episode};
use serde::{Deserialize, Serialize};

/// Episodes that are averaged over.
const LENGTH: usize = 100;

/// A ring of finished episodes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Window {
    episodes: VecDeque<Episode>,
    /// Episodes of the whole run.
    total: u64,
    /// Falls of the whole run.
    falls: u64,
}

impl Window {
    /// Takes in finished episodes.
    pub fn extend(&mut self, episodes: impl Iterator<Item = Episode>) {
        for episode in episodes {
            self.total += 1;
            self.falls += u64::from(matches!(episode.end, End::Fallen | End::Overlap));
            if self.episodes.len() == LENGTH {
                self.episodes.pop_front();
            }
            self.episodes.push_back(episode);
        }
    }

    /// Episodes of the whole run.
    pub fn total(&self) -> u64 {
        self.total
    }

    /// Falls of the whole run.
    pub fn falls(&self) -> u64 {
        self.falls
    }

    /// Mean of `value` over the window's episodes for which there is one; NaN without any.
    pub fn mean(&self, value: impl Fn(&Episode) -> Option<f64>) -> f64 {
        let (mut sum, mut n) = (0.0, 0.0);
        for x in self.episodes.iter().filter_map(value) {
            sum += x;
            n += 1.0;
        }
        sum / n
    }

    /// Share of the window's episodes that ended with `end`.
    pub fn share(&self, end: End) -> f64 {
        self.mean(|episode| Some(f64::from(u8::from(episode.end == end))))
    }
}
