//! How fast an update is, and how fast it could be.

use std::{
    hint::black_box,
    time::{Duration, Instant},
};

use rayon::prelude::*;

use crate::{
    agent::{Agent, Inference},
    config::{Config, InvalidConfig},
    rollout::Rollout,
    simd::{self, FmaLoop},
};

/// Rounds of a measurement, of which the fastest counts: whatever else runs on the machine only slows it down.
const ROUNDS: usize = 10;
/// Time of a round, at least.
const ROUND: Duration = Duration::from_millis(100);

/// Throughput of [`Agent::update`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BenchResult {
    /// Threads that shared the work.
    pub threads: usize,
    /// Samples of a minibatch.
    pub batch: usize,
    /// Samples that passed forward and back through both networks, per second.
    pub samples_per_second: f64,
    /// Floating-point operations of their matrix products per second, 10^9. What is not a product (activations,
    /// distributions, optimiser, advantages, the old distributions) takes time but is not counted.
    pub gflops: f64,
    /// Operations per second of a loop of nothing but fused multiply-adds in `f32` on as many threads, 10^9.
    pub peak_gflops: f64,
    /// `gflops / peak_gflops`.
    pub ratio: f64,
    /// Rows that [`Agent::act`] handles per second, at 64 rows a call.
    pub actions_per_second: f64,
}

/// Measures updates of minibatches of `batch` samples, with everything that belongs to them, on invented samples.
///
/// # Errors
/// If the configuration with this minibatch is not valid or a length is zero.
///
/// # Panics
/// If the threads cannot be started.
pub fn bench(
    config: Config,
    observation_len: usize,
    action_len: usize,
    batch: usize,
    threads: usize,
) -> Result<BenchResult, InvalidConfig> {
    let config = Config {
        minibatch: batch,
        ..config
    };
    let mut agent = Agent::new(config, observation_len, action_len, 1)?;
    let environments = 64;
    let steps = (2 * batch).max(1920).div_ceil(environments);
    let mut rollout = Rollout::new(steps, environments, observation_len, action_len);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .expect("threads can be started");
    let (update, act, peak) = pool.install(|| {
        collect(&agent, &mut rollout);
        let mut key = 0;
        let mut learn = || {
            key += 1;
            let stats = agent.update(&rollout, None, key);
            assert_eq!(stats.skipped, 0, "the invented samples are finite");
        };
        let [update, peak] = rates([&mut learn, &mut || multiply_add(threads)]);
        let [act] = rates([&mut || collect(&agent, &mut rollout)]);
        (update, act, peak * multiply_add_operations(threads))
    });
    let samples_per_second = update * (rollout.samples() * agent.config().epochs) as f64;
    let gflops = samples_per_second * operations_per_sample(&agent) * 1e-9;
    Ok(BenchResult {
        threads,
        batch,
        samples_per_second,
        gflops,
        peak_gflops: peak * 1e-9,
        ratio: gflops / (peak * 1e-9),
        actions_per_second: act * rollout.samples() as f64,
    })
}

/// The processor's measured peak: floating-point operations per second of a loop of nothing but fused multiply-adds in
/// `f32` on `threads` threads of the present pool, 10^9.
pub fn peak_gflops(threads: usize) -> f64 {
    let [peak] = rates([&mut || multiply_add(threads)]);
    peak * multiply_add_operations(threads) * 1e-9
}

const MULTIPLY_ADD_ROUNDS: u64 = 1 << 20;

fn multiply_add(threads: usize) {
    (0..threads).into_par_iter().with_max_len(1).for_each(|_| {
        black_box(simd::dispatch(FmaLoop {
            rounds: MULTIPLY_ADD_ROUNDS,
        }));
    });
}

fn multiply_add_operations(threads: usize) -> f64 {
    MULTIPLY_ADD_ROUNDS as f64 * threads as f64 * FmaLoop::operations_per_round()
}

/// Calls per second of each function in its fastest round; the rounds take turns, so that all meet the same machine.
fn rates<const N: usize>(mut calls: [&mut dyn FnMut(); N]) -> [f64; N] {
    let mut best = [0.0_f64; N];
    for _ in 0..ROUNDS {
        for (call, best) in calls.iter_mut().zip(&mut best) {
            let (start, mut count) = (Instant::now(), 0);
            while count == 0 || start.elapsed() < ROUND {
                call();
                count += 1;
            }
            *best = best.max(f64::from(count) / start.elapsed().as_secs_f64());
        }
    }
    best
}

/// Fills a rollout with the agent's actions on waves.
fn collect(agent: &Agent, rollout: &mut Rollout) {
    let (environments, width, actions) = (rollout.environments, agent.observation_len(), agent.action_len());
    for (i, x) in rollout.observations.iter_mut().enumerate() {
        *x = (i as f32 * 0.618_034).fract() - 0.5;
    }
    let (mut keys, mut buffers) = ([0; 64], Inference::default());
    for step in 0..rollout.steps {
        let rows = step * environments..(step + 1) * environments;
        for (row, key) in keys.iter_mut().enumerate() {
            *key = (rows.start + row) as u64;
        }
        agent.act(
            &mut buffers,
            &rollout.observations[rows.start * width..rows.end * width],
            &keys[..environments],
            &mut rollout.actions[rows.start * actions..rows.end * actions],
            &mut rollout.values[rows.clone()],
        );
        for row in rows {
            rollout.rewards[row] = rollout.actions[row * actions] - 0.5;
        }
    }
}

/// Operations of the matrix products for one sample: forward, by the weights, and (not in the first layer) by the
/// inputs, two for each weight.
fn operations_per_sample(agent: &Agent) -> f64 {
    let of = |widths: &[usize]| {
        let weights = |pair: &[usize]| pair[0] * pair[1];
        6 * widths.windows(2).map(weights).sum::<usize>() - 2 * weights(&widths[..2])
    };
    (of(&agent.actor.widths) + of(&agent.critic.widths)) as f64
}
