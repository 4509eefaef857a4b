//! Residuals of whole rollouts, their losses and slopes by finite differences, every candidate a SIMD lane.
//!
//! Loss, gradient and curvature are kept by block of time, so that folds of a cross-validation and errors that respect
//! autocorrelation come from the same rollouts. Sums have a fixed order: threads change no bit.

use std::fmt::Debug;
use std::sync::Arc;

use nalgebra::{DMatrix, DMatrixView, DVector};
use omniwalk_env::engine::EngineError;
use omniwalk_env::robot::Robot;
use rayon::prelude::*;

use super::journal::{self, Journal};
use super::model::{Free, Model};
use super::own::Logged;
use super::scales::Scales;
use super::starts;
use super::trial::{Reading, Trial};

/// Candidates in one rollout: a group of the widest lanes.
pub const LANES: usize = 16;

/// The data of a fit: trials with the robot as it was in each, and the weights of their readings.
#[derive(Clone, Debug)]
pub struct Data {
    /// Pieces of logs.
    pub trials: Arc<Vec<Trial>>,
    /// The nominal robot as it was in each trial's log.
    pub robots: Arc<Vec<Logged>>,
    /// One a degree of freedom: residuals are multiplied with it.
    pub weights: Vec<f64>,
    /// Median over the blocks of the weighted mean square residual of each degree of freedom under the re-tuned model.
    pub typical: Vec<f64>,
    /// Index of the first block of each trial's log among those of all logs.
    pub first_block: Vec<usize>,
    /// Blocks of all logs.
    pub blocks: usize,
    /// Physics steps a millisecond.
    pub finer: usize,
    /// What is known already of fits to these data, and to others.
    pub journal: Option<Arc<Journal>>,
}

/// Of every trial, of every [`LANES`] models: entry `reading * models + m`.
pub type Predictions = Vec<Vec<Vec<f64>>>;

/// How many parts slopes are kept in, and the part of a trial's reading.
type Parts<'a> = (usize, &'a dyn Fn(usize, &Reading) -> usize);

/// What model `m` predicts for reading `i` of a trial with so many readings and these parts of [`Predictions`].
fn at(parts: &[Vec<f64>], readings: usize, i: usize, m: usize) -> f64 {
    let part = &parts[m / LANES];
    part[i * (part.len() / readings) + m % LANES]
}

/// `model` with each of its fitted numbers moved by a step of finite differences, and those steps, scaled.
fn beside(model: &Model, scales: &Scales) -> (Vec<Model>, Vec<f64>) {
    let (x, free) = (model.get(scales), model.free(scales));
    // Towards the inside where the upper bound is near.
    let step = |(x, free): (&f64, &Free)| {
        if x + free.step > free.upper {
            -free.step
        } else {
            free.step
        }
    };
    let steps: Vec<f64> = x.iter().zip(&free).map(step).collect();
    let moved = |(i, step): (usize, &f64)| {
        let mut moved = x.clone();
        moved[i] += step;
        model.at(&moved, scales)
    };
    (steps.iter().enumerate().map(moved).collect(), steps)
}

/// Sums over the readings of a block.
#[derive(Clone, Copy, Debug, Default)]
pub struct Loss {
    /// Of squared weighted residuals.
    pub squares: f64,
    /// Readings.
    pub count: f64,
}

/// Gradient and Gauss-Newton curvature of half the squared residuals of a block.
#[derive(Clone, Debug)]
pub struct Slope {
    /// Gradient.
    pub gradient: DVector<f64>,
    /// Curvature.
    pub curvature: DMatrix<f64>,
}

/// Rows of slopes whose products are not in the curvature yet: many at a time are a matrix product.
#[derive(Default)]
struct Rows {
    /// A column a row, one after the other.
    columns: Vec<f64>,
}

impl Rows {
    /// Rows of one product.
    const MANY: usize = 64;

    fn add(&mut self, row: &DVector<f64>, curvature: &mut DMatrix<f64>) {
        self.columns.extend_from_slice(row.as_slice());
        if self.columns.len() >= Self::MANY * row.len() {
            self.flush(curvature);
        }
    }

    /// Adds the products to `curvature`.
    fn flush(&mut self, curvature: &mut DMatrix<f64>) {
        let n = curvature.nrows();
        let columns = DMatrixView::from_slice(&self.columns, n, self.columns.len() / n.max(1));
        curvature.gemm(1.0, &columns, &columns.transpose(), 1.0);
        self.columns.clear();
    }
}

/// A fitted model.
#[derive(Clone, Debug)]
pub struct Fit {
    /// The model with its values.
    pub model: Model,
    /// Loss of every block.
    pub losses: Vec<Loss>,
    /// At the solution, by block.
    pub slopes: Vec<Slope>,
}

/// Sum of squares over blocks; infinite where a simulation broke.
pub fn total(losses: &[Loss]) -> f64 {
    let sum: f64 = losses.iter().map(|loss| loss.squares).sum();
    if sum.is_finite() { sum } else { f64::INFINITY }
}

impl Data {
    /// Trials of `robot`, all weights one.
    ///
    /// # Errors
    /// An override that names nothing.
    pub fn new(robot: &Robot, trials: Vec<Trial>) -> Result<Self, super::trial::TrialError> {
        let robots = trials
            .iter()
            .map(|trial| trial.robot(robot))
            .collect::<Result<Vec<_>, _>>()?;
        let mut first_block = Vec::with_capacity(trials.len());
        let (mut first, mut blocks) = (0, 0);
        for (t, trial) in trials.iter().enumerate() {
            // Pieces of a log share its blocks.
            if t > 0 && trials[t - 1].log != trial.log {
                first = blocks;
            }
            first_block.push(first);
            let own = trial.readings.iter().map(|r| r.block + 1).max().unwrap_or(0);
            blocks = blocks.max(first + own);
        }
        Ok(Self {
            trials: Arc::new(trials),
            robots: Arc::new(robots),
            weights: vec![1.0; robot.dofs.len()],
            typical: vec![f64::INFINITY; robot.dofs.len()],
            first_block,
            blocks,
            finer: 1,
            journal: None,
        })
    }

    /// Fits the starts of trials whose base is not held, under `model`.
    ///
    /// # Errors
    /// When an engine does not take the robot.
    pub fn fit_starts(&mut self, model: &Model) -> Result<(), EngineError> {
        if !self.is_free() {
            return Ok(());
        }
        let noise = starts::noise(&self.trials, self.weights.len());
        let robots: Vec<Robot> = self.robots.iter().map(|robot| robot.with(model)).collect();
        let trials: &mut Vec<Trial> = Arc::make_mut(&mut self.trials);
        starts::fit(trials, &robots, &noise, self.finer)
    }

    /// Predictions of all `models` for every trial.
    pub fn predict(&self, models: &[Model]) -> Predictions {
        let tasks: Vec<(usize, &[Model])> = (0..self.trials.len())
            .flat_map(|t| models.chunks(LANES).map(move |chunk| (t, chunk)))
            .collect();
        let parts: Vec<Vec<f64>> = tasks
            .par_iter()
            .map(|&(t, chunk)| self.predict_trial(t, chunk))
            .collect();
        let mut out: Predictions = vec![Vec::new(); self.trials.len()];
        for ((t, _), part) in tasks.iter().zip(parts) {
            out[*t].push(part);
        }
        out
    }

    /// Predictions of up to [`LANES`] `models` for trial `t`: entry `reading * models + m`.
    fn predict_trial(&self, t: usize, models: &[Model]) -> Vec<f64> {
        let robots: Vec<Robot> = models.iter().map(|model| self.robots[t].with(model)).collect();
        // An engine that takes the nominal robot takes all of them.
        starts::predict(&self.trials[t], &robots, self.finer)
            .unwrap_or_else(|_| vec![f64::NAN; self.trials[t].readings.len() * models.len()])
    }

    /// The journal, if there is one, and the key there of what follows from these data and from `of`.
    pub fn journal(&self, of: &dyn Debug) -> Option<(&Journal, u64)> {
        let journal = self.journal.as_deref()?;
        let of_trial = |trial: &Trial| {
            let numbers = trial.shift.iter().copied().chain([trial.start]);
            journal::hash_of_numbers(numbers.chain(trial.readings.iter().map(|reading| reading.position)))
        };
        let trials: Vec<u64> = self.trials.iter().map(of_trial).collect();
        Some((journal, journal::hash(&(trials, self.finer, &self.weights, of))))
    }

    /// Sums over all readings of the products of columns that are weighted: the residual of the first of `models`, and by how much
    /// each other one changes its predictions. Not finite in the row and column of a model that breaks.
    pub fn products(&self, models: &[Model]) -> DMatrix<f64> {
        let n = models.len();
        let journal = self.journal(&("products", models));
        let known = journal.and_then(|(journal, key)| journal.known(key));
        if let Some(known) = known.filter(|known| known.len() == n * n) {
            return DMatrix::from_column_slice(n, n, known);
        }
        let products = self.compute_products(models);
        if let Some((journal, key)) = journal {
            journal.keep(key, products.as_slice());
        }
        products
    }

    fn compute_products(&self, models: &[Model]) -> DMatrix<f64> {
        let of_trial = |t: usize| {
            let readings = &self.trials[t].readings;
            let mut columns = DMatrix::zeros(readings.len(), models.len());
            for (c, chunk) in models.chunks(LANES).enumerate() {
                let predicted = self.predict_trial(t, chunk);
                for (i, row) in predicted.chunks(chunk.len()).enumerate() {
                    for (w, p) in row.iter().enumerate() {
                        columns[(i, c * LANES + w)] = *p;
                    }
                }
            }
            for (reading, mut row) in readings.iter().zip(columns.row_iter_mut()) {
                let (first, weight) = (row[0], self.weights[reading.dof]);
                row.add_scalar_mut(-first);
                row[0] = first - reading.position;
                row.scale_mut(weight);
            }
            columns.tr_mul(&columns)
        };
        let parts: Vec<DMatrix<f64>> = (0..self.trials.len()).into_par_iter().map(of_trial).collect();
        let n = models.len();
        parts.into_iter().fold(DMatrix::zeros(n, n), |sum, part| sum + part)
    }

    /// Losses by block of every model.
    pub fn losses(&self, models: &[Model]) -> Vec<Vec<Loss>> {
        self.block_losses(&self.predict(models), models.len())
    }

    /// Losses by block of `count` models with these predictions.
    pub fn block_losses(&self, predictions: &Predictions, count: usize) -> Vec<Vec<Loss>> {
        let of_block = |cells: &[Loss]| Loss {
            squares: cells.iter().map(|loss| loss.squares).sum(),
            count: cells.iter().map(|loss| loss.count).sum(),
        };
        let cells = self.cells_of(predictions, count).into_iter();
        let dofs = self.weights.len().max(1);
        cells.map(|cells| cells.chunks(dofs).map(of_block).collect()).collect()
    }

    /// Losses of every model by block and degree of freedom: those of a block stand together.
    pub fn cells(&self, models: &[Model]) -> Vec<Vec<Loss>> {
        self.cells_of(&self.predict(models), models.len())
    }

    fn cells_of(&self, predictions: &Predictions, count: usize) -> Vec<Vec<Loss>> {
        let dofs = self.weights.len();
        let mut losses = vec![vec![Loss::default(); self.blocks * dofs]; count];
        for ((trial, parts), &first) in self.trials.iter().zip(predictions).zip(&self.first_block) {
            for (chunk, part) in parts.iter().enumerate() {
                let width = part.len() / trial.readings.len().max(1);
                for (i, reading) in trial.readings.iter().enumerate() {
                    for w in 0..width {
                        let residual = self.weights[reading.dof] * (part[i * width + w] - reading.position);
                        let loss = &mut losses[chunk * LANES + w][(first + reading.block) * dofs + reading.dof];
                        loss.squares += residual * residual;
                        loss.count += 1.0;
                    }
                }
            }
        }
        losses
    }

    /// Median over the blocks of the weighted mean square residual of each degree of freedom under `model`.
    pub fn typical_under(&self, model: &Model) -> Vec<f64> {
        let (dofs, cells) = (
            self.weights.len(),
            self.cells(std::slice::from_ref(model)).swap_remove(0),
        );
        let of = |d: usize| {
            let read = cells.iter().skip(d).step_by(dofs).filter(|loss| loss.count > 0.0);
            let mut means: Vec<f64> = read.map(|loss| loss.squares / loss.count).collect();
            means.sort_by(f64::total_cmp);
            means.get(means.len() / 2).copied().unwrap_or(f64::INFINITY)
        };
        (0..dofs).map(of).collect()
    }

    /// Residuals (prediction less measurement, not weighted) of `model` at the readings of every trial.
    pub fn residuals(&self, model: &Model) -> Vec<Vec<f64>> {
        let predictions = self.predict(std::slice::from_ref(model));
        let of_trial = |(trial, parts): (&Trial, &Vec<Vec<f64>>)| {
            let readings = trial.readings.iter().zip(&parts[0]);
            readings.map(|(reading, p)| p - reading.position).collect()
        };
        self.trials.iter().zip(&predictions).map(of_trial).collect()
    }

    /// Losses and slopes of `model` by block.
    pub fn slopes(&self, model: &Model, scales: &Scales) -> (Vec<Loss>, Vec<Slope>) {
        let (predictions, steps) = self.predict_beside(model, scales);
        self.by_block((&predictions, 0), (&predictions, 1), &steps)
    }

    /// Predictions of `model` (first) and of [`beside`] it, with the steps.
    fn predict_beside(&self, model: &Model, scales: &Scales) -> (Predictions, Vec<f64>) {
        let (moved, steps) = beside(model, scales);
        let models: Vec<Model> = [model.clone()].into_iter().chain(moved).collect();
        (self.predict(&models), steps)
    }

    /// The same where `model` is number `m` of those with predictions `known`.
    pub fn slopes_at(
        &self,
        (known, m): (&Predictions, usize),
        model: &Model,
        scales: &Scales,
    ) -> (Vec<Loss>, Vec<Slope>) {
        let (moved, steps) = beside(model, scales);
        self.by_block((known, m), (&self.predict(&moved), 0), &steps)
    }

    fn by_block(
        &self,
        known: (&Predictions, usize),
        moved: (&Predictions, usize),
        steps: &[f64],
    ) -> (Vec<Loss>, Vec<Slope>) {
        let block = |t: usize, reading: &Reading| self.first_block[t] + reading.block;
        self.differences(known, moved, steps, (self.blocks, &block))
    }

    /// Losses and slopes, in as many parts as `parts` has, of which it tells that of a trial's reading, of the model number `m` of `known` from
    /// the models of `moved`, from number `first` on, whose numbers are moved by `steps`.
    fn differences(
        &self,
        (known, m): (&Predictions, usize),
        (moved, first): (&Predictions, usize),
        steps: &[f64],
        parts: Parts<'_>,
    ) -> (Vec<Loss>, Vec<Slope>) {
        let n = steps.len();
        let mut losses = vec![Loss::default(); parts.0];
        let zero = Slope {
            gradient: DVector::zeros(n),
            curvature: DMatrix::zeros(n, n),
        };
        let mut slopes = vec![zero; parts.0];
        let mut rows: Vec<Rows> = (0..parts.0).map(|_| Rows::default()).collect();
        let mut row = DVector::zeros(n);
        for (t, trial) in self.trials.iter().enumerate() {
            let readings = trial.readings.len();
            for (i, reading) in trial.readings.iter().enumerate() {
                let base = at(&known[t], readings, i, m);
                let weight = self.weights[reading.dof];
                let residual = weight * (base - reading.position);
                for (j, step) in steps.iter().enumerate() {
                    let change = at(&moved[t], readings, i, first + j) - base;
                    row[j] = if change.is_finite() {
                        weight * change / step
                    } else {
                        0.0
                    };
                }
                let part = parts.1(t, reading);
                losses[part].squares += residual * residual;
                losses[part].count += 1.0;
                slopes[part].gradient.axpy(residual, &row, 1.0);
                rows[part].add(&row, &mut slopes[part].curvature);
            }
        }
        for (rows, slope) in rows.iter_mut().zip(&mut slopes) {
            rows.flush(&mut slope.curvature);
        }
        (losses, slopes)
    }

    /// Slopes of `model`'s loss against readings as the simulation has them at half the physics step, by degree of freedom.
    pub fn slopes_against_half_the_step(&self, model: &Model, scales: &Scales) -> Vec<Slope> {
        let mut halved = self.clone();
        Arc::make_mut(&mut halved.trials)
            .par_iter_mut()
            .zip(&*self.robots)
            .for_each(|(trial, robot)| {
                let half = starts::perfect(trial, &robot.with(model), 2 * self.finer);
                let half = half.unwrap_or_else(|_| vec![f64::NAN; trial.readings.len()]);
                for (reading, position) in trial.readings.iter_mut().zip(half) {
                    reading.position = position;
                }
            });
        let (predictions, steps) = halved.predict_beside(model, scales);
        let dof = |_: usize, reading: &Reading| reading.dof;
        let (_, slopes) = halved.differences((&predictions, 0), (&predictions, 1), &steps, (self.weights.len(), &dof));
        slopes
    }
}
