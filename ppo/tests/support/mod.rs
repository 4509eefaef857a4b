//! A configuration and a small world for the tests.
#![allow(dead_code, reason = "each test uses a part")]

use omniwalk_ppo::{Activation, Agent, Config, End, Head, Inference, Mirror, Rollout, Schedule, UpdateStats};

pub fn config() -> Config {
    Config {
        hidden: vec![32, 32],
        activation: Activation::Tanh,
        policy: Head::Beta,
        learning_rate: 3e-4,
        schedule: Schedule::Adaptive {
            kl_target: 0.02,
            settle: 0,
            minimum: 1e-5,
            maximum: 1e-2,
        },
        gamma: 0.95,
        lambda: 0.95,
        clip: 0.2,
        dual_clip: 3.0,
        epochs: 5,
        minibatch: 256,
        entropy_weight: 0.0,
        mode_weight: 0.0,
        value_weight: 1.0,
        max_gradient_norm: 1.0,
        normalise_observations: true,
        observation_clip: 10.0,
    }
}

/// Uniform in [-1, 1), a hash of the arguments.
pub fn noise(a: u64, b: u64) -> f32 {
    let mut x = a.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ b.wrapping_mul(0xd1b5_4a32_d192_ed03) ^ 0x1234_5678;
    for _ in 0..3 {
        x = (x ^ (x >> 31)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    }
    (x >> 40) as f32 / (1 << 23) as f32 - 1.0
}

/// Points on a plane that are to come to the origin: observation (x, y, vx, vy), action their acceleration.
pub struct Points {
    states: Vec<[f32; 4]>,
    ages: Vec<u32>,
    clock: u64,
    buffers: Inference,
    pub rollout: Rollout,
}

impl Points {
    pub const EPISODE: u32 = 40;

    pub fn new(count: usize, steps: usize) -> Self {
        let mut points = Self {
            states: vec![[0.0; 4]; count],
            ages: (0..count as u32).map(|i| i % Self::EPISODE).collect(),
            clock: 0,
            buffers: Inference::default(),
            rollout: Rollout::new(steps, count, 4, 2),
        };
        (0..count).for_each(|i| points.reset(i));
        points
    }

    fn reset(&mut self, i: usize) {
        let key = self.clock * 1000 + i as u64;
        self.states[i] = [noise(key, 1), noise(key, 2), 0.0, 0.0];
    }

    pub fn mirror() -> Mirror {
        Mirror {
            observation: vec![(0, 1.0), (1, -1.0), (2, 1.0), (3, -1.0)],
            action: vec![(0, 1.0), (1, -1.0)],
        }
    }

    /// Moves all points; the mean reward.
    pub fn collect(&mut self, agent: &Agent) -> f32 {
        let count = self.states.len();
        let mut total = 0.0;
        for step in 0..self.rollout.steps {
            let rows = step * count..(step + 1) * count;
            let flat: Vec<f32> = self.states.iter().flatten().copied().collect();
            let keys: Vec<u64> = (0..count as u64).map(|i| self.clock * 1000 + i).collect();
            self.rollout.observations[rows.start * 4..rows.end * 4].copy_from_slice(&flat);
            let actions = &mut self.rollout.actions[rows.start * 2..rows.end * 2];
            let values = &mut self.rollout.values[rows.clone()];
            agent.act(&mut self.buffers, &flat, &keys, actions, values);
            self.clock += 1;
            for i in 0..count {
                let at = rows.start + i;
                let [x, y, vx, vy] = &mut self.states[i];
                *vx = 0.9 * *vx + 0.2 * (2.0 * self.rollout.actions[at * 2] - 1.0).clamp(-2.0, 2.0);
                *vy = 0.9 * *vy + 0.2 * (2.0 * self.rollout.actions[at * 2 + 1] - 1.0).clamp(-2.0, 2.0);
                (*x, *y) = (*x + 0.2 * *vx, *y + 0.2 * *vy);
                let reward = -(*x * *x + *y * *y).sqrt();
                self.rollout.rewards[at] = reward;
                total += reward;
                self.ages[i] += 1;
                self.rollout.ends[at] = End::None;
                if reward < -3.0 {
                    self.rollout.ends[at] = End::Terminated;
                } else if self.ages[i] >= Self::EPISODE {
                    let mut value = [0.0];
                    agent.values(&mut self.buffers, &self.states[i], &mut value);
                    self.rollout.bootstrap_values[at] = value[0];
                    self.rollout.ends[at] = End::TimeOut;
                }
                if self.rollout.ends[at] != End::None {
                    self.ages[i] = 0;
                    self.reset(i);
                }
            }
        }
        let flat: Vec<f32> = self.states.iter().flatten().copied().collect();
        agent.values(&mut self.buffers, &flat, &mut self.rollout.last_values);
        total / self.rollout.samples() as f32
    }

    /// Collects and learns; the mean reward and what the update did.
    pub fn iterate(&mut self, agent: &mut Agent, mirror: Option<&Mirror>, key: u64) -> (f32, UpdateStats) {
        let reward = self.collect(agent);
        (reward, agent.update(&self.rollout, mirror, key))
    }
}
