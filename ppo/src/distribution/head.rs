//! The policy's loss over a chunk of samples, from network outputs to their gradient.

use super::{Differentiated, Head, Terms, beta, gaussian};
use crate::{
    matrix::Panels,
    simd::{self, Kernel, Simd},
};

/// Samples of a chunk: row-major actions (`rows x actions`) and what each sample was worth.
pub(crate) struct Samples<'a> {
    pub actions: &'a [f32],
    pub advantages: &'a [f32],
    /// Old log-probability of each sample's action.
    pub log_probabilities: &'a [f64],
    /// Old distributions, one for each action dimension, see [`reference`].
    pub references: &'a [[f64; 3]],
}

/// Constants of the loss.
#[derive(Clone, Copy)]
pub(crate) struct LossCoefficients {
    /// Range of the probability ratio: `1 - clip` to `1 + clip`.
    pub clip: f64,
    /// Ratio beyond which a sample with a negative advantage teaches nothing more; infinity: none.
    pub dual_clip: f64,
    pub entropy_weight: f64,
    pub mode_weight: f64,
    /// One over the samples of the minibatch.
    pub scale: f64,
}

/// Sums over samples.
#[derive(Clone, Copy, Default)]
pub(crate) struct LossSums {
    pub policy_loss: f64,
    pub entropy: f64,
    /// Squared distances of mode and mean.
    pub skew: f64,
    pub kl: f64,
    pub clipped: f64,
}

impl LossSums {
    /// Adds those over other samples.
    pub(crate) fn add(&mut self, other: Self) {
        self.policy_loss += other.policy_loss;
        self.entropy += other.entropy;
        self.skew += other.skew;
        self.kl += other.kl;
        self.clipped += other.clipped;
    }
}

/// Buffers of [`loss`], by elements (`rows x actions`): outputs, and terms in arrays of their own.
#[derive(Default)]
pub(crate) struct HeadScratch {
    first: Vec<f32>,
    second: Vec<f32>,
    log_probability: [Vec<f64>; 3],
    entropy: [Vec<f64>; 3],
    skew: [Vec<f64>; 3],
    kl: Vec<f64>,
}

impl HeadScratch {
    pub(crate) fn new(rows: usize, actions: usize) -> Self {
        let buffer = || vec![0.0; rows * actions];
        Self {
            first: vec![0.0; rows * actions],
            second: vec![0.0; rows * actions],
            log_probability: std::array::from_fn(|_| buffer()),
            entropy: std::array::from_fn(|_| buffer()),
            skew: std::array::from_fn(|_| buffer()),
            kl: buffer(),
        }
    }

    /// Collects the two parameters of every element from rows of network outputs.
    fn gather(&mut self, outputs: &Panels, rows: usize, actions: usize) {
        let elements = self
            .first
            .chunks_exact_mut(actions)
            .zip(self.second.chunks_exact_mut(actions));
        for (row, (first, second)) in elements.take(rows).enumerate() {
            first
                .iter_mut()
                .enumerate()
                .for_each(|(i, to)| *to = outputs.get(row, i));
            second
                .iter_mut()
                .enumerate()
                .for_each(|(i, to)| *to = outputs.get(row, actions + i));
        }
    }
}

/// One pass over elements.
struct Elements<'a> {
    head: Head,
    scratch: &'a mut HeadScratch,
    actions: &'a [f32],
    references: &'a [[f64; 3]],
}

impl Elements<'_> {
    #[inline(always)]
    fn each<S: Simd>(self, terms: impl Fn(f32, f32, f32, [f64; 3]) -> Terms) {
        let count = self.actions.len();
        let HeadScratch {
            first,
            second,
            log_probability: [l, l1, l2],
            entropy: [e, e1, e2],
            skew: [s, s1, s2],
            kl,
        } = self.scratch;
        let (first, second, references) = (&first[..count], &second[..count], &self.references[..count]);
        let (l, l1, l2) = (&mut l[..count], &mut l1[..count], &mut l2[..count]);
        let (e, e1, e2) = (&mut e[..count], &mut e1[..count], &mut e2[..count]);
        let (s, s1, s2) = (&mut s[..count], &mut s1[..count], &mut s2[..count]);
        let kl = &mut kl[..count];
        for i in 0..count {
            let terms = terms(first[i], second[i], self.actions[i], references[i]);
            let Differentiated {
                value,
                by_first,
                by_second,
            } = terms.log_probability;
            (l[i], l1[i], l2[i]) = (value, by_first, by_second);
            let Differentiated {
                value,
                by_first,
                by_second,
            } = terms.entropy;
            (e[i], e1[i], e2[i]) = (value, by_first, by_second);
            let Differentiated {
                value,
                by_first,
                by_second,
            } = terms.skew;
            (s[i], s1[i], s2[i]) = (value, by_first, by_second);
            kl[i] = terms.kl;
        }
    }
}

impl Kernel for Elements<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        match self.head {
            Head::Beta => self.each::<S>(|a, b, x, old| beta::terms::<S>(a, b, x, old)),
            Head::Gaussian => self.each::<S>(|a, b, x, old| gaussian::terms::<S>(a, b, x, old)),
        }
    }
}

/// PPO's clipped surrogate with entropy (Schulman et al. 2017, eq. 7 and 9): writes the gradient by the network's
/// outputs (`rows x 2 actions`) and returns the sums of the parts.
pub(crate) fn loss(
    head: Head,
    outputs: &Panels,
    gradient: &mut Panels,
    samples: Samples,
    coefficients: LossCoefficients,
    scratch: &mut HeadScratch,
) -> LossSums {
    let rows = samples.advantages.len();
    if rows == 0 {
        return LossSums::default();
    }
    let actions = samples.actions.len() / rows;
    scratch.gather(outputs, rows, actions);
    simd::dispatch(Elements {
        head,
        scratch,
        actions: samples.actions,
        references: samples.references,
    });
    let mut sums = LossSums::default();
    for row in 0..rows {
        let of = row * actions..(row + 1) * actions;
        let advantage = f64::from(samples.advantages[row]);
        let log_probability: f64 = scratch.log_probability[0][of.clone()].iter().sum();
        let ratio = (log_probability - samples.log_probabilities[row]).exp();
        let bounded = ratio.clamp(1.0 - coefficients.clip, 1.0 + coefficients.clip);
        // The gradient passes where the unclipped term is the smaller one.
        let runaway = advantage < 0.0 && ratio > coefficients.dual_clip;
        let active = ratio * advantage <= bounded * advantage && !runaway;
        sums.policy_loss -= (ratio.min(coefficients.dual_clip) * advantage).min(bounded * advantage);
        sums.entropy += scratch.entropy[0][of.clone()].iter().sum::<f64>();
        sums.skew += scratch.skew[0][of.clone()].iter().sum::<f64>();
        sums.kl += scratch.kl[of.clone()].iter().sum::<f64>();
        sums.clipped += f64::from(u8::from(bounded != ratio));
        let by_log_probability = if active {
            -coefficients.scale * advantage * ratio
        } else {
            0.0
        };
        let by_entropy = -coefficients.scale * coefficients.entropy_weight;
        let by_skew = coefficients.scale * coefficients.mode_weight;
        for parameter in 0..2 {
            let log_probability = &scratch.log_probability[1 + parameter][of.clone()];
            let entropy = &scratch.entropy[1 + parameter][of.clone()];
            let skew = &scratch.skew[1 + parameter][of.clone()];
            for (i, ((l, e), s)) in log_probability.iter().zip(entropy).zip(skew).enumerate() {
                gradient.set(
                    row,
                    parameter * actions + i,
                    (by_log_probability * l + by_entropy * e + by_skew * s) as f32,
                );
            }
        }
    }
    sums
}

struct References<'a> {
    head: Head,
    first: &'a [f32],
    second: &'a [f32],
    references: &'a mut [[f64; 3]],
}

impl Kernel for References<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self) {
        let elements = self.references.iter_mut().zip(self.first.iter().zip(self.second));
        match self.head {
            Head::Beta => elements.for_each(|(to, (&a, &b))| *to = beta::reference::<S>(a, b)),
            Head::Gaussian => elements.for_each(|(to, (&a, &b))| *to = gaussian::reference::<S>(a, b)),
        }
    }
}

/// Records the distributions that `outputs` describe, for the divergence of later ones from them, and the
/// log-probabilities of the actions under them.
pub(crate) fn reference(
    head: Head,
    outputs: &Panels,
    actions: &[f32],
    references: &mut [[f64; 3]],
    log_probabilities: &mut [f64],
    scratch: &mut HeadScratch,
) {
    let rows = log_probabilities.len();
    if rows == 0 {
        return;
    }
    let width = actions.len() / rows;
    scratch.gather(outputs, rows, width);
    let (first, second) = (&scratch.first, &scratch.second);
    simd::dispatch(References {
        head,
        first,
        second,
        references: &mut *references,
    });
    simd::dispatch(Elements {
        head,
        scratch,
        actions,
        references,
    });
    for (row, to) in log_probabilities.iter_mut().enumerate() {
        *to = scratch.log_probability[0][row * width..(row + 1) * width].iter().sum();
    }
}
