//! What the environments produced, and how it looks in a mirror.

/// How a step ended.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum End {
    /// The episode goes on.
    #[default]
    None,
    /// The episode ended for good: no reward follows.
    Terminated,
    /// The episode was cut off: its value goes on, see [`Rollout::bootstrap_values`].
    TimeOut,
    /// The world broke: what the action led to is not known, and the sample is not learned from.
    Lost,
}

/// Steps of a batch of environments, flat and row-major, first index step, second environment. Allocated once, filled
/// again for every update.
#[derive(Clone, Debug, Default)]
pub struct Rollout {
    /// Steps.
    pub steps: usize,
    /// Environments.
    pub environments: usize,
    /// Observations the actions were chosen on, `steps x environments x observation length`, not normalised.
    pub observations: Vec<f32>,
    /// Actions, `steps x environments x action length`.
    pub actions: Vec<f32>,
    /// Values of the observations, `steps x environments`.
    pub values: Vec<f32>,
    /// Rewards of the steps, `steps x environments`.
    pub rewards: Vec<f32>,
    /// How the steps ended, `steps x environments`.
    pub ends: Vec<End>,
    /// Value of the observation an episode was cut off at, `steps x environments`; read at [`End::TimeOut`] only.
    pub bootstrap_values: Vec<f32>,
    /// Values of the observations after the last step, `environments`; not read where that step ended an episode.
    pub last_values: Vec<f32>,
}

impl Rollout {
    /// Zeroed buffers.
    pub fn new(steps: usize, environments: usize, observation_len: usize, action_len: usize) -> Self {
        let samples = steps * environments;
        Self {
            steps,
            environments,
            observations: vec![0.0; samples * observation_len],
            actions: vec![0.0; samples * action_len],
            values: vec![0.0; samples],
            rewards: vec![0.0; samples],
            ends: vec![End::None; samples],
            bootstrap_values: vec![0.0; samples],
            last_values: vec![0.0; environments],
        }
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.steps * self.environments
    }

    /// Copies a rollout of as many steps of some of the environments, from `first` on.
    ///
    /// # Panics
    /// If its lengths do not fit.
    pub fn insert(&mut self, part: &Self, first: usize) {
        assert_eq!(self.steps, part.steps, "as many steps");
        let (here, there) = (self.environments, part.environments);
        copy_rows(
            &mut self.observations,
            &part.observations,
            self.steps,
            first,
            [here, there],
        );
        copy_rows(&mut self.actions, &part.actions, self.steps, first, [here, there]);
        copy_rows(&mut self.values, &part.values, self.steps, first, [here, there]);
        copy_rows(&mut self.rewards, &part.rewards, self.steps, first, [here, there]);
        copy_rows(&mut self.ends, &part.ends, self.steps, first, [here, there]);
        copy_rows(
            &mut self.bootstrap_values,
            &part.bootstrap_values,
            self.steps,
            first,
            [here, there],
        );
        copy_rows(&mut self.last_values, &part.last_values, 1, first, [here, there]);
    }

    /// Whether every buffer has the length that the others and the agent ask for.
    pub(crate) fn fits(&self, observation_len: usize, action_len: usize) -> bool {
        let samples = self.samples();
        self.observations.len() == samples * observation_len
            && self.actions.len() == samples * action_len
            && self.last_values.len() == self.environments
            && self.ends.len() == samples
            && [&self.values, &self.rewards, &self.bootstrap_values]
                .iter()
                .all(|values| values.len() == samples)
    }

    /// Whether every number that an update reads is finite.
    pub(crate) fn is_finite(&self) -> bool {
        let finite = |values: &[f32]| values.iter().all(|x| x.is_finite());
        let bootstraps = self.ends.iter().zip(&self.bootstrap_values);
        finite(&self.observations)
            && finite(&self.actions)
            && finite(&self.values)
            && finite(&self.rewards)
            && finite(&self.last_values)
            && bootstraps
                .into_iter()
                .all(|(&end, value)| end != End::TimeOut || value.is_finite())
    }
}

/// Copies the rows of `there` environments, in every step, to those from `first` on of `here`.
fn copy_rows<T: Copy>(to: &mut [T], from: &[T], steps: usize, first: usize, [here, there]: [usize; 2]) {
    let width = to.len() / (steps * here);
    let rows = to.chunks_exact_mut(here * width).zip(from.chunks_exact(there * width));
    for (to, from) in rows {
        to[first * width..(first + there) * width].copy_from_slice(from);
    }
}

/// A symmetry: element `i` of a mirrored vector is `sign * x[index]`. An action of a Beta policy or of a Gaussian one
/// is centred on 0.5: with sign -1 it becomes `1 - x[index]`.
#[derive(Clone, Debug, PartialEq)]
pub struct Mirror {
    /// (index, sign) for each element of the observation.
    pub observation: Vec<(u32, f32)>,
    /// (index, sign) for each element of the action.
    pub action: Vec<(u32, f32)>,
}

impl Mirror {
    /// Whether the lengths fit, every index exists and every sign is 1 or -1.
    pub fn fits(&self, observation_len: usize, action_len: usize) -> bool {
        let fits = |map: &[(u32, f32)], len: usize| {
            map.len() == len
                && map
                    .iter()
                    .all(|&(index, sign)| (index as usize) < len && sign.abs() == 1.0)
        };
        fits(&self.observation, observation_len) && fits(&self.action, action_len)
    }

    pub(crate) fn observation(&self, from: &[f32], to: &mut [f32]) {
        to.iter_mut()
            .zip(&self.observation)
            .for_each(|(to, &(index, sign))| *to = sign * from[index as usize]);
    }

    pub(crate) fn action(&self, from: &[f32], to: &mut [f32]) {
        to.iter_mut().zip(&self.action).for_each(|(to, &(index, sign))| {
            let x = from[index as usize];
            *to = if sign < 0.0 { 1.0 - x } else { x };
        });
    }
}
