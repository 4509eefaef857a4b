//! Levenberg-Marquardt over whole rollouts ([`Data`]), which may be stopped and gone on with.

use nalgebra::{DMatrix, DVector};
use omniwalk_env::random::Stream;

use super::fit::{Data, Fit, LANES, Loss, Slope, total};
use super::model::{Free, Model};
use super::scales::Scales;

/// Most iterations of a fit.
const ITERATIONS: usize = 10;
/// Relative fall of the loss below which a fit has converged.
const CONVERGED: f64 = 5e-4;
/// Iterations after which ways that are hopeless are seen.
const FIRST: usize = 4;
/// Share of the loss below which an iteration of one way among many takes too little to go on: a tenth of what makes an effect worth having.
const NEAR: f64 = 2e-3;
/// Damping beyond which nothing moves.
const STRONGEST: f64 = 1e8;
/// Strengths of damping that are tried side by side, which costs no more than one.
const STRENGTHS: i32 = 8;
/// Spreads of new starts about the end of a fit, as shares of each number.
const SHAKEN: [f64; 2] = [0.03, 0.1];
/// Times that new starts are tried.
const SHAKES: usize = 2;
/// Share of the loss below which another minimum is the same.
const SAME: f64 = 5e-3;

/// A fit on its way.
#[derive(Clone)]
pub struct Descent {
    /// As far as it is.
    pub fit: Fit,
    /// Share of the loss that the last iteration took.
    pub fell: f64,
    damping: f64,
    /// Iterations that are left.
    left: usize,
}

impl Descent {
    /// From the present values of `model`.
    pub fn new(data: &Data, model: &Model, scales: &Scales) -> Self {
        let (losses, slopes) = data.slopes(model, scales);
        let model = model.clone();
        Self {
            left: if model.get(scales).is_empty() { 0 } else { ITERATIONS },
            fit: Fit { model, losses, slopes },
            fell: 1.0,
            damping: 1e-3,
        }
    }

    /// The same after the first iterations, which show whether the way is hopeless.
    pub fn begun(data: &Data, model: &Model, scales: &Scales) -> Self {
        let mut descent = Self::new(data, model, scales);
        descent.advance((data, scales), &|_| true, FIRST, NEAR);
        descent
    }

    /// Goes on to where one way among many may end.
    pub fn go_on(&mut self, data: &Data, scales: &Scales) {
        self.advance((data, scales), &|_| true, ITERATIONS, NEAR);
    }

    /// The loss, over all blocks.
    pub fn loss(&self) -> f64 {
        total(&self.fit.losses)
    }

    /// Does at most `most` iterations over the blocks that `used` names, until one takes less than the share `little` of the loss.
    fn advance(&mut self, (data, scales): (&Data, &Scales), used: &dyn Fn(usize) -> bool, most: usize, little: f64) {
        let blocks: Vec<usize> = (0..data.blocks).filter(|&b| used(b)).collect();
        let here = (&self.fit.model, self.damping, self.left, blocks, most, little);
        let journal = data.journal(&("descent", here));
        let known = journal.and_then(|(journal, key)| journal.known(key));
        if known.is_some_and(|known| self.is_put(known, data, scales)) {
            return;
        }
        self.descend((data, scales), used, most, little);
        if let Some((journal, key)) = journal {
            journal.keep(key, &self.numbers());
        }
    }

    /// All that an advance changes, less what follows from it.
    fn numbers(&self) -> Vec<f64> {
        let way = [self.fell, self.damping, self.left as f64];
        way.into_iter().chain(self.fit.model.values()).collect()
    }

    /// Puts [`Self::numbers`] in the place of what is there; false where they are none of this model's.
    fn is_put(&mut self, numbers: &[f64], data: &Data, scales: &Scales) -> bool {
        let own = self.numbers();
        let ([fell, damping, left, values @ ..], true) = (numbers, numbers.len() == own.len()) else {
            return false;
        };
        (self.fell, self.damping, self.left) = (*fell, *damping, *left as usize);
        if *values != own[own.len() - values.len()..] {
            self.fit.model.put_values(values);
            (self.fit.losses, self.fit.slopes) = data.slopes(&self.fit.model, scales);
        }
        true
    }

    /// [`Self::advance`], computed.
    fn descend(&mut self, (data, scales): (&Data, &Scales), used: &dyn Fn(usize) -> bool, most: usize, little: f64) {
        for _ in 0..most.min(self.left) {
            let moved = self.iterate(data, scales, used);
            self.left -= 1;
            if self.damping > STRONGEST || moved && self.fell < little {
                self.left = 0;
                return;
            }
        }
    }

    /// An iteration; whether the model moved.
    fn iterate(&mut self, data: &Data, scales: &Scales, used: &dyn Fn(usize) -> bool) -> bool {
        let loss_of = |losses: &[Loss]| {
            let kept: Vec<Loss> = (0..losses.len()).filter(|&b| used(b)).map(|b| losses[b]).collect();
            total(&kept)
        };
        let Fit { model, losses, slopes } = &mut self.fit;
        let (x, free) = (model.get(scales), model.free(scales));
        let (gradient, curvature) = sum(slopes, used, x.len());
        let before = loss_of(losses);
        let strengths: Vec<f64> = (0..STRENGTHS).map(|k| self.damping * 10.0_f64.powi(k - 3)).collect();
        let trials: Vec<Model> = strengths
            .iter()
            .map(|&damping| model.at(&newton(&x, &free, &gradient, &curvature, damping), scales))
            .collect();
        let predictions = data.predict(&trials);
        let tried = data.block_losses(&predictions, trials.len());
        let best = (0..trials.len())
            .map(|k| (loss_of(&tried[k]), k))
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .unwrap_or((f64::INFINITY, 0));
        if best.0 >= before {
            self.damping *= 1e4;
            self.fell = 0.0;
            return false;
        }
        *model = trials[best.1].clone();
        self.damping = strengths[best.1].clamp(1e-9, 1e6);
        (*losses, *slopes) = data.slopes_at((&predictions, best.1), model, scales);
        self.fell = 1.0 - best.0 / before;
        true
    }
}

impl Data {
    /// Fits `model` from its present values over the blocks that `used` names.
    pub fn fit(&self, model: &Model, scales: &Scales, used: &dyn Fn(usize) -> bool) -> Fit {
        let mut descent = Descent::new(self, model, scales);
        descent.advance((self, scales), used, ITERATIONS, CONVERGED);
        descent.fit
    }

    /// The best of fits from `models` and from starts about where that ends. Little decides where a joint sticks after a step: a log in which
    /// it sticks in another place than it did makes a minimum of its own, from which no slope leads out.
    /// Stretches of robots that walk are too short for that, and their fits too dear.
    pub fn fit_shaken(&self, models: &[Model], scales: &Scales) -> Fit {
        let fits = models.iter().map(|model| self.fit(model, scales, &|_| true));
        let mut best = fits
            .min_by(|a, b| total(&a.losses).total_cmp(&total(&b.losses)))
            .unwrap_or_else(|| self.fit(&Model::default(), scales, &|_| true));
        let shakes = if self.is_free() { 0 } else { SHAKES };
        for shake in 0..shakes {
            let begun = SHAKEN.iter().enumerate().map(|(k, &spread)| {
                let about = about(&best.model, scales, spread, (SHAKEN.len() * shake + k) as u64);
                let losses = self.losses(&about);
                let order = (0..about.len()).min_by(|&a, &b| total(&losses[a]).total_cmp(&total(&losses[b])));
                Descent::begun(self, &about[order.unwrap_or(0)], scales)
            });
            let other = begun.min_by(|a, b| a.loss().total_cmp(&b.loss()));
            let Some(mut other) = other.filter(|other| other.loss() < (1.0 - SAME) * total(&best.losses)) else {
                break;
            };
            other.advance((self, scales), &|_| true, ITERATIONS, CONVERGED);
            best = other.fit;
        }
        best
    }
}

/// As many models about `model` as one rollout takes, each number off by `spread` of itself or so; the same for the same `seed`.
fn about(model: &Model, scales: &Scales, spread: f64, seed: u64) -> Vec<Model> {
    let mut random = Stream::new(seed, 0, 0);
    let (x, free) = (model.get(scales), model.free(scales));
    let mut near = || {
        let moved = x.iter().zip(&free);
        let moved = moved.map(|(x, free)| (x * (1.0 + random.normal(spread))).clamp(free.lower, free.upper));
        model.at(&moved.collect::<Vec<_>>(), scales)
    };
    (0..LANES).map(|_| near()).collect()
}

/// Gradient and curvature over the blocks that `used` names.
pub fn sum(slopes: &[Slope], used: &dyn Fn(usize) -> bool, n: usize) -> (DVector<f64>, DMatrix<f64>) {
    let mut gradient = DVector::zeros(n);
    let mut curvature = DMatrix::zeros(n, n);
    for (_, slope) in slopes.iter().enumerate().filter(|(b, _)| used(*b)) {
        gradient += &slope.gradient;
        curvature += &slope.curvature;
    }
    (gradient, curvature)
}

/// The damped Newton step from `x` within the bounds: numbers that would leave them stay on them and the others are
/// solved again.
pub fn newton(x: &[f64], free: &[Free], gradient: &DVector<f64>, curvature: &DMatrix<f64>, damping: f64) -> Vec<f64> {
    let n = x.len();
    let mut held = vec![None; n];
    for _ in 0..=n {
        let moving: Vec<usize> = (0..n).filter(|&i| held[i].is_none()).collect();
        if moving.is_empty() {
            break;
        }
        let fixed: Vec<f64> = (0..n).map(|i| held[i].map_or(0.0, |to: f64| to - x[i])).collect();
        let m = moving.len();
        let largest = (0..n).map(|i| curvature[(i, i)]).fold(0.0, f64::max);
        let matrix = DMatrix::from_fn(m, m, |a, b| {
            let (i, j) = (moving[a], moving[b]);
            let extra = if i == j {
                damping * curvature[(i, i)] + 1e-12 * largest + 1e-300
            } else {
                0.0
            };
            curvature[(i, j)] + extra
        });
        let right = DVector::from_fn(m, |a, _| {
            let i = moving[a];
            -gradient[i] - (0..n).map(|j| curvature[(i, j)] * fixed[j]).sum::<f64>()
        });
        let Some(factor) = matrix.cholesky() else {
            return x.to_vec();
        };
        let step = factor.solve(&right);
        let mut left = false;
        for (a, &i) in moving.iter().enumerate() {
            let to = x[i] + step[a];
            if to < free[i].lower || to > free[i].upper {
                held[i] = Some(to.clamp(free[i].lower, free[i].upper));
                left = true;
            }
        }
        if !left {
            let mut out: Vec<f64> = (0..n).map(|i| held[i].unwrap_or(x[i])).collect();
            moving.iter().enumerate().for_each(|(a, &i)| out[i] += step[a]);
            return out;
        }
    }
    (0..n).map(|i| held[i].unwrap_or(x[i])).collect()
}
