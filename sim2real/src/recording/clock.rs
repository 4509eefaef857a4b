//! One clock for all topics of an MCAP file.
//!
//! A header's stamp says when something was measured; log time says when the recorder got it. Stamps are used
//! where every message of a topic has one. They may count from another moment than log time does (a robot's
//! uptime, a simulation's clock): all times are brought to the clock of log time by the median of log time minus
//! stamp of the first stamped topic, so that topics keep their distance to each other.

use super::TopicClock;

/// Stamps of two topics that are further apart than this, ns, come from clocks that do not know each other; the
/// delay between measuring and recording on one machine stays far below it.
const OTHER_CLOCK: i128 = 500_000_000;

/// When the messages of one topic were logged and stamped, ns.
#[derive(Debug, Default)]
pub(super) struct Times {
    log: Vec<u64>,
    stamp: Vec<u64>,
}

impl Times {
    pub fn push(&mut self, log: u64, stamp: Option<u64>) {
        self.log.push(log);
        self.stamp.extend(stamp);
    }

    pub fn len(&self) -> usize {
        self.log.len()
    }

    /// Median of log time minus stamp, ns, if every message is stamped.
    fn offset(&self) -> Option<i128> {
        if self.log.is_empty() || self.stamp.len() != self.log.len() {
            return None;
        }
        let differences = self.log.iter().zip(&self.stamp);
        let mut differences: Vec<i128> = differences
            .map(|(&log, &stamp)| i128::from(log) - i128::from(stamp))
            .collect();
        let middle = differences.len() / 2;
        Some(*differences.select_nth_unstable(middle).1)
    }
}

/// The topics on one clock.
pub(super) struct Clocks {
    /// Per topic, the time of each message, s from the first message of all.
    pub times: Vec<Vec<f64>>,
    /// Where they came from, for topics that have messages.
    pub topics: Vec<TopicClock>,
    /// What had to be assumed.
    pub notes: Vec<String>,
}

/// Brings topics, given by name with their times, to one clock; the first stamped one leads.
pub(super) fn align(topics: &[(&str, &Times)]) -> Clocks {
    let offsets: Vec<Option<i128>> = topics.iter().map(|(_, times)| times.offset()).collect();
    let lead = offsets.iter().position(Option::is_some);
    let mut notes = Vec::new();
    let mut on_log_clock = Vec::with_capacity(topics.len());
    for ((name, times), offset) in topics.iter().zip(&offsets) {
        let Some((own, lead_topic, common)) = offset.and_then(|own| Some((own, topics[lead?].0, offsets[lead?]?)))
        else {
            on_log_clock.push(times.log.iter().map(|&time| i128::from(time)).collect::<Vec<_>>());
            continue;
        };
        let mut shift = common;
        if (own - common).abs() > OTHER_CLOCK {
            shift = own;
            notes.push(format!(
                "the stamps of {name} are {:.3} s off those of {lead_topic}: another clock; they were aligned by log time",
                (common - own) as f64 * 1e-9,
            ));
        }
        on_log_clock.push(times.stamp.iter().map(|&time| i128::from(time) + shift).collect());
    }
    let start = on_log_clock
        .iter()
        .filter_map(|times| times.first())
        .min()
        .copied()
        .unwrap_or(0);
    let seconds = |times: Vec<i128>| times.into_iter().map(|time| (time - start) as f64 * 1e-9).collect();
    let present = topics.iter().zip(&offsets).filter(|((_, times), _)| times.len() > 0);
    Clocks {
        topics: present
            .map(|((name, _), offset)| TopicClock {
                topic: (*name).to_owned(),
                log_minus_stamp: offset.map(|offset| offset as f64 * 1e-9),
            })
            .collect(),
        times: on_log_clock.into_iter().map(seconds).collect(),
        notes,
    }
}
