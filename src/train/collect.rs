//! Collecting a rollout: each group of environments by itself, on whichever core is free.

use std::ops::Range;
use std::time::Instant;

use omniwalk_env::batch::{Collect, Outcomes};
use omniwalk_env::task::episode::{End, Fault};
use omniwalk_env::task::reward::Terms;
use omniwalk_ppo::{self as ppo, Agent, Inference, Rollout};

/// A group's part of a rollout.
pub struct Part {
    environments: Range<usize>,
    rollout: Rollout,
    terms: Vec<Terms>,
    lost: u64,
    falls: u64,
    /// The step of the first fault, and the fault.
    fault: Option<(usize, (usize, Fault))>,
    buffers: Inference,
    keys: Vec<u64>,
    /// Since when the environments step.
    stepping: Instant,
    /// Time spent stepping and in the networks, s.
    seconds: [f64; 2],
}

/// Sums over the steps of a rollout.
#[derive(Default)]
pub struct Collected {
    pub terms: Terms,
    pub lost: u64,
    pub falls: u64,
    pub fault: Option<(usize, Fault)>,
    /// Time of a thread spent stepping the environments, and in the networks, s.
    pub seconds: [f64; 2],
}

/// How the actions of a rollout are drawn.
pub struct Sampling<'a> {
    pub agent: &'a Agent,
    pub seed: u64,
    /// Steps of all environments before this rollout.
    pub done: u64,
    /// Environments of the batch.
    pub environments: usize,
    /// Factor on rewards.
    pub reward_scale: f64,
}

impl Part {
    pub fn new(steps: usize, environments: Range<usize>, agent: &Agent) -> Self {
        let n = environments.len();
        Self {
            rollout: Rollout::new(steps, n, agent.observation_len(), agent.action_len()),
            terms: vec![Terms::default(); steps * n],
            lost: 0,
            falls: 0,
            fault: None,
            buffers: Inference::default(),
            keys: vec![0; n],
            stepping: Instant::now(),
            seconds: [0.0; 2],
            environments,
        }
    }
}

/// Gathers the parts, and begins them anew. The sums are taken in the order of steps and environments, however
/// these are grouped.
pub fn gather(parts: &mut [Part], rollout: &mut Rollout) -> Collected {
    let mut sum = Collected::default();
    for step in 0..rollout.steps {
        for part in &*parts {
            let n = part.environments.len();
            part.terms[step * n..(step + 1) * n]
                .iter()
                .for_each(|terms| sum.terms.add(terms));
        }
    }
    let threads = rayon::current_num_threads().min(parts.len()) as f64;
    let mut first = usize::MAX;
    for part in parts {
        rollout.insert(&part.rollout, part.environments.start);
        sum.lost += std::mem::take(&mut part.lost);
        sum.falls += std::mem::take(&mut part.falls);
        if let Some((step, fault)) = part.fault.take()
            && step < first
        {
            (first, sum.fault) = (step, Some(fault));
        }
        for (sum, seconds) in sum.seconds.iter_mut().zip(std::mem::take(&mut part.seconds)) {
            *sum += seconds / threads;
        }
    }
    sum
}

impl Collect for Sampling<'_> {
    type Part = Part;

    fn act<'p>(&self, part: &'p mut Part, step: usize, observations: &[f32]) -> &'p [f32] {
        let start = Instant::now();
        let n = part.environments.len();
        let first = self.done + (step * self.environments + part.environments.start) as u64;
        for (key, counter) in part.keys.iter_mut().zip(first..) {
            *key = mix(self.seed, counter);
        }
        let rollout = &mut part.rollout;
        rows(
            &mut rollout.observations,
            step * n..(step + 1) * n,
            self.agent.observation_len(),
        )
        .copy_from_slice(observations);
        let actions = rows(&mut rollout.actions, step * n..(step + 1) * n, self.agent.action_len());
        let values = &mut rollout.values[step * n..(step + 1) * n];
        self.agent
            .act(&mut part.buffers, observations, &part.keys, actions, values);
        part.stepping = Instant::now();
        part.seconds[1] += (part.stepping - start).as_secs_f64();
        actions
    }

    fn take(&self, part: &mut Part, step: usize, outcomes: &Outcomes<'_>) {
        let stepped = Instant::now();
        let (n, rollout) = (part.environments.len(), &mut part.rollout);
        let judged = outcomes.terms.iter().zip(outcomes.ends);
        for (k, (terms, end)) in (step * n..).zip(judged) {
            rollout.rewards[k] = (self.reward_scale * terms.total()) as f32;
            rollout.ends[k] = learner_end(*end);
            part.terms[k] = *terms;
            part.lost += u64::from(*end == Some(End::Lost));
            part.falls += u64::from(matches!(end, Some(End::Fallen | End::Overlap)));
        }
        let fault = outcomes.faults.first();
        part.fault = part.fault.or(fault.map(|fault| (step, *fault)));
        // At time-outs, which are not falls, the return goes on behind them.
        let lasts = outcomes.final_observations.chunks_exact(self.agent.observation_len());
        for (k, last) in (step * n..).zip(lasts) {
            if rollout.ends[k] == ppo::End::TimeOut {
                let value = &mut rollout.bootstrap_values[k..=k];
                self.agent.values(&mut part.buffers, last, value);
            }
        }
        if step + 1 == rollout.steps {
            self.agent
                .values(&mut part.buffers, outcomes.observations, &mut rollout.last_values);
        }
        part.seconds[0] += (stepped - part.stepping).as_secs_f64();
        part.seconds[1] += stepped.elapsed().as_secs_f64();
    }
}

fn rows(all: &mut [f32], rows: Range<usize>, len: usize) -> &mut [f32] {
    &mut all[rows.start * len..rows.end * len]
}

fn learner_end(end: Option<End>) -> ppo::End {
    match end {
        None => ppo::End::None,
        Some(End::Fallen | End::Overlap) => ppo::End::Terminated,
        Some(End::TimeOut) => ppo::End::TimeOut,
        Some(End::Lost) => ppo::End::Lost,
    }
}

/// A random key from a seed and a counter (splitmix64's finaliser).
pub fn mix(seed: u64, counter: u64) -> u64 {
    let mut z = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ counter.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}
