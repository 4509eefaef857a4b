//! Cross-validation by blocks of time.

use std::collections::BTreeMap;

use super::descent::{newton, sum};
use super::fit::{Data, Fit, Loss, total};
use super::gain::Gain;
use super::model::Model;
use super::scales::Scales;

/// Most folds.
const FOLDS: usize = 5;
/// Logs from which on folds are made of logs, and whole logs are drawn in the bootstrap.
const MANY_LOGS: usize = 12;
/// Dampings of the step to the fit without a fold that are tried, the strongest last: with five folds they fill the lanes.
const DAMPINGS: [f64; 3] = [1e-3, 0.1, 10.0];
/// Stronger ones for a fold without which all of those lead uphill on the logs they are made from: at a kink, as where a limit is only just
/// reached, the slope of one side says nothing of the other.
const STRONGER: [f64; 3] = [1e2, 1e3, 1e5];
/// Numbers of the weakest damping that is allowed: one of these, the same in every fold.
const HELD: [usize; 2] = [0, 1];
/// A number of the nominal model is held without a fold that has all but this share of what the logs tell of it: a limit that is reached there
/// alone has next to no slope elsewhere, and a step along that ends anywhere.
const TOLD: f64 = 0.1;
/// A loss within this share of the least is as good: the strongest damping of those, as a step that gains the logs it is made from no
/// more than that is theirs alone.
const AS_GOOD: f64 = 0.01;
/// A block whose residual is so many times that of most is far off.
const FAR: f64 = 2.0;

/// Which blocks are left out together.
#[derive(Clone, Debug)]
pub struct Folds {
    /// Number of folds.
    pub count: usize,
    /// Fold of each block.
    pub of_block: Vec<usize>,
    /// Blocks that are not used for fitting either when a fold is left out: those beside it in the same log.
    guard: Vec<[Option<usize>; 2]>,
    /// What draws of the bootstrap are made of: the cluster of each block.
    cluster: Vec<usize>,
    /// What folds are, for the report.
    pub by: String,
}

impl Folds {
    /// Folds by log, or by stretches of time within the logs where there are few: an effect that only one of them shows
    /// must be learnt from it and predicted in it.
    pub fn new(data: &Data) -> Self {
        let log_of = block_logs(data);
        let logs = 1 + log_of.iter().copied().max().unwrap_or(0);
        let fold_of_log = by_log(logs);
        let mut folds = Self {
            count: 0,
            of_block: vec![0; data.blocks],
            guard: vec![[None; 2]; data.blocks],
            cluster: (0..data.blocks).collect(),
            by: "log".into(),
        };
        if let Some(fold_of_log) = fold_of_log {
            folds.count = 1 + fold_of_log.iter().copied().max().unwrap_or(0);
            folds.of_block = log_of.iter().map(|&log| fold_of_log[log]).collect();
        } else {
            folds.by_time(data, &log_of);
            // In logs of a block or three nothing is left to fit to between what is left out and its guard.
            if !folds.all_have_others() {
                folds = folds.of_logs(data);
                folds.by = "log".into();
            }
        }
        if logs >= MANY_LOGS {
            folds.cluster = log_of;
        }
        folds
    }

    /// The same with folds that are whole logs wherever there are several: what goes with the time since the start of a log is in all of
    /// them at the same time.
    pub fn of_logs(&self, data: &Data) -> Self {
        let log_of = block_logs(data);
        let logs = 1 + log_of.iter().copied().max().unwrap_or(0);
        if logs < 2 {
            return self.clone();
        }
        Self {
            count: logs.min(FOLDS),
            of_block: log_of.iter().map(|log| log % FOLDS).collect(),
            guard: vec![[None; 2]; data.blocks],
            ..self.clone()
        }
    }

    /// The blocks of every cluster that draws are made of.
    pub fn clusters(&self) -> Vec<Vec<usize>> {
        let mut clusters: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
        for (b, cluster) in self.cluster.iter().enumerate() {
            clusters.entry(*cluster).or_default().push(b);
        }
        clusters.into_values().collect()
    }

    /// Whether a cluster is a whole log.
    pub fn whole_logs(&self) -> bool {
        self.cluster.windows(2).any(|pair| pair[0] == pair[1])
    }

    /// Contiguous stretches of each log, guarded by a block on either side.
    fn by_time(&mut self, data: &Data, log_of: &[usize]) {
        self.count = FOLDS;
        self.by = "stretches of time, guarded by a block on either side".into();
        let mut start = 0;
        while start < data.blocks {
            let end = (start..data.blocks)
                .find(|&b| log_of[b] != log_of[start])
                .unwrap_or(data.blocks);
            for b in start..end {
                self.of_block[b] = (b - start) * FOLDS / (end - start);
            }
            for b in start + 1..end {
                let (left, right) = (self.of_block[b - 1], self.of_block[b]);
                if left != right {
                    (self.guard[b][0], self.guard[b - 1][1]) = (Some(left), Some(right));
                }
            }
            start = end;
        }
    }

    /// Whether blocks are left to fit to whichever fold is left out.
    fn all_have_others(&self) -> bool {
        let blocks = 0..self.of_block.len();
        let left = |fold: &usize| blocks.clone().any(|b| self.trains(b, *fold));
        self.of_block.iter().all(left)
    }

    /// Whether block `b` is fitted to when `fold` is left out.
    fn trains(&self, b: usize, fold: usize) -> bool {
        self.of_block[b] != fold && !self.guard[b].contains(&Some(fold))
    }

    /// Loss of every block, by degree of freedom ([`Data::cells`]), under the model fitted without it: one Gauss-Newton step from the fit
    /// to all blocks, which is where the fit to the others ends, to second order, and a rollout of that. Where the loss is far from a
    /// parabola, as it is where joints stick, the step is damped as strongly as suits the others. What is far off counts less.
    pub fn cross(&self, data: &Data, fit: &Fit, scales: &Scales) -> Vec<Loss> {
        let without = |fold: usize, dampings: &[f64]| -> Vec<Model> {
            let step = |&damping: &f64| self.step_without(fit, scales, fold, damping);
            dampings.iter().map(step).collect()
        };
        let models: Vec<_> = (0..self.count).flat_map(|fold| without(fold, &DAMPINGS)).collect();
        let mut losses = data.cells(&models);
        self.mend_uphill(data, fit, &mut losses, &|fold| without(fold, &STRONGER));
        // What only the fold tells, the others let go anywhere: such numbers are held by as much as predicts best.
        let held = HELD.map(|held| self.predicted(data, &losses, held));
        let best = held
            .map(|losses| robust(data, losses))
            .into_iter()
            .min_by(|a, b| total(a).total_cmp(&total(b)));
        best.unwrap_or_default()
    }

    /// The damped step from `fit` to the fit without `fold`.
    fn step_without(&self, fit: &Fit, scales: &Scales, fold: usize, damping: f64) -> Model {
        let x = fit.model.get(scales);
        let (_, whole) = sum(&fit.slopes, &|_| true, x.len());
        let (mut gradient, mut curvature) = sum(&fit.slopes, &|b| self.trains(b, fold), x.len());
        let tuned = fit.model.tuned.iter().filter(|tuned| !tuned.held).count();
        for i in 0..tuned {
            if curvature[(i, i)] >= TOLD * whole[(i, i)] {
                continue;
            }
            gradient[i] = 0.0;
            curvature.row_mut(i).fill(0.0);
            curvature.column_mut(i).fill(0.0);
        }
        let stepped = newton(&x, &fit.model.free(scales), &gradient, &curvature, damping);
        fit.model.at(&stepped, scales)
    }

    /// Puts, for each fold without which every step of [`DAMPINGS`] leads uphill, the weakest of `stronger` steps that does not in their place.
    fn mend_uphill(&self, data: &Data, fit: &Fit, losses: &mut [Vec<Loss>], stronger: &dyn Fn(usize) -> Vec<Model>) {
        let usual = DAMPINGS.len();
        let least = |fold: usize| (1.0 + AS_GOOD) * self.others(&fit.losses, fold);
        let is_uphill = |fold: &usize| {
            let own = &losses[fold * usual..(fold + 1) * usual];
            own.iter().all(|losses| self.others(losses, *fold) > least(*fold))
        };
        let uphill: Vec<usize> = (0..self.count).filter(is_uphill).collect();
        if uphill.is_empty() {
            return;
        }
        let models: Vec<Model> = uphill.iter().flat_map(|&fold| stronger(fold)).collect();
        for (&fold, own) in uphill.iter().zip(data.cells(&models).chunks(STRONGER.len())) {
            let weakest = own.iter().find(|losses| self.others(losses, fold) <= least(fold));
            let mended = weakest.unwrap_or(&own[STRONGER.len() - 1]);
            losses[fold * usual..(fold + 1) * usual].fill(mended.clone());
        }
    }

    /// Sum of `losses` (by block, or by block and degree of freedom) over the blocks that are fitted to when `fold` is left out.
    fn others(&self, losses: &[Loss], fold: usize) -> f64 {
        let cells = losses.len() / self.of_block.len().max(1);
        let trained = losses
            .iter()
            .enumerate()
            .filter(|(cell, _)| self.trains(cell / cells, fold));
        total(&trained.map(|(_, loss)| *loss).collect::<Vec<_>>())
    }

    /// Losses of every block where its fold was left out, of steps with the damping number `held` or a stronger one.
    fn predicted(&self, data: &Data, losses: &[Vec<Loss>], held: usize) -> Vec<Loss> {
        let dofs = data.weights.len();
        let of = |losses: &Vec<Loss>, b: usize| losses[b * dofs..(b + 1) * dofs].to_vec();
        let best = |fold: usize| {
            let own = &losses[fold * DAMPINGS.len() + held..(fold + 1) * DAMPINGS.len()];
            let others = |losses: &Vec<Loss>| self.others(losses, fold);
            let least = own.iter().map(others).fold(f64::INFINITY, f64::min);
            let good = own.iter().rfind(|losses| others(losses) <= (1.0 + AS_GOOD) * least);
            good.unwrap_or(&own[0])
        };
        let best: Vec<&Vec<Loss>> = (0..self.count).map(best).collect();
        (0..data.blocks).flat_map(|b| of(best[self.of_block[b]], b)).collect()
    }

    /// Whether `after` predicts better than `before`, losses of [`Folds::cross`].
    pub fn gain(&self, before: &[Loss], after: &[Loss]) -> Gain {
        Gain::of(&self.cluster, before, after)
    }
}

/// Losses by block and degree of freedom as Huber (1964) has them, of the norm of each: where joints stick, one hold can be as far off as
/// one likes, with the right effects too. Beyond [`FAR`] times the typical residual they grow with the residual, not its square.
pub fn robust(data: &Data, mut cells: Vec<Loss>) -> Vec<Loss> {
    for (cell, loss) in cells.iter_mut().enumerate() {
        let far = FAR * FAR * data.typical[cell % data.weights.len()] * loss.count;
        if loss.squares > far {
            loss.squares = 2.0 * (far * loss.squares).sqrt() - far;
        }
    }
    cells
}

/// The log of each block.
pub fn block_logs(data: &Data) -> Vec<usize> {
    let ends = data.first_block.iter().skip(1).copied().chain([data.blocks]);
    let mut out = Vec::with_capacity(data.blocks);
    for (trial, end) in data.trials.iter().zip(ends) {
        out.resize(end, trial.log);
    }
    out
}

/// Folds of whole logs, every so many of them one, where there are so many that what one log shows others show too.
fn by_log(logs: usize) -> Option<Vec<usize>> {
    (logs >= MANY_LOGS).then(|| (0..logs).map(|log| log % FOLDS).collect())
}

#[cfg(test)]
mod tests {
    use super::super::cut::Lengths;
    use super::super::hinge::{robot, swings};
    use super::*;

    #[test]
    fn steps_that_lead_uphill_give_way_to_the_weakest_that_does_not() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let data = swings(
            &robot,
            3,
            Lengths {
                block: 1.0,
                piece: 60.0,
            },
        );
        let folds = Folds::new(&data);
        let scales = Scales::new(&robot, &data.trials);
        let near = Model::nominal(&robot, &data.trials);
        let fit = data.fit(&near, &scales, &|_| true);
        let mut far = fit.model.clone();
        far.tuned[0].value *= 0.02;
        let [as_fitted, uphill] =
            [&fit.model, &far].map(|model| data.cells(std::slice::from_ref(model)).swap_remove(0));
        let mut losses = vec![as_fitted.clone(); folds.count * DAMPINGS.len()];
        losses[DAMPINGS.len()..2 * DAMPINGS.len()].fill(uphill.clone());
        // One that does not is enough.
        losses[3 * DAMPINGS.len()] = uphill.clone();
        let before = losses.clone();
        let stronger = |fold: usize| {
            assert_eq!(fold, 1);
            vec![far.clone(), fit.model.clone(), near.clone()]
        };
        folds.mend_uphill(&data, &fit, &mut losses, &stronger);
        let squares = |losses: &[Vec<Loss>]| losses.iter().map(|own| total(own)).collect::<Vec<_>>();
        let mut expected = squares(&before);
        expected[DAMPINGS.len()..2 * DAMPINGS.len()].fill(total(&as_fitted));
        assert!(total(&uphill) > 2.0 * total(&as_fitted));
        assert_eq!(squares(&losses), expected);
        // Where all lead uphill, the strongest.
        losses.clone_from(&before);
        folds.mend_uphill(&data, &fit, &mut losses, &|_| vec![far.clone(); STRONGER.len()]);
        assert_eq!(squares(&losses), squares(&before));
    }

    #[test]
    fn a_number_that_only_a_fold_tells_is_held_without_it() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let data = swings(
            &robot,
            3,
            Lengths {
                block: 1.0,
                piece: 60.0,
            },
        );
        let (folds, scales) = (Folds::new(&data), Scales::new(&robot, &data.trials));
        let nominal = Model::nominal(&robot, &data.trials);
        let mut fit = data.fit(&nominal, &scales, &|_| true);
        // The others have next to no slope along the first number, and a step along that leads far.
        for (block, slope) in fit.slopes.iter_mut().enumerate() {
            if folds.of_block[block] != 0 {
                let little = 1e-6 * slope.curvature[(0, 0)];
                slope.curvature.row_mut(0).fill(0.0);
                slope.curvature.column_mut(0).fill(0.0);
                (slope.curvature[(0, 0)], slope.gradient[0]) = (little, little);
            }
        }
        let moved = |fold: usize| {
            let stepped = folds.step_without(&fit, &scales, fold, DAMPINGS[0]);
            (stepped.get(&scales)[0] - fit.model.get(&scales)[0]).abs()
        };
        assert_eq!(moved(0), 0.0);
        assert!((1..folds.count).all(|fold| moved(fold) > 0.0));
    }

    #[test]
    fn what_is_beside_a_stretch_that_is_left_out_is_not_fitted_to() {
        let robot = robot("kp = 30.0\nkd = 1.0\n");
        let folds = |block| {
            let data = swings(&robot, 3, Lengths { block, piece: 60.0 });
            (Folds::new(&data), block_logs(&data))
        };
        let (by_time, logs) = folds(1.0);
        assert!(by_time.by.starts_with("stretches"));
        for (b, _) in logs.windows(2).enumerate().filter(|(_, pair)| pair[0] == pair[1]) {
            let [left, right] = [b, b + 1].map(|b| by_time.of_block[b]);
            assert!(!by_time.trains(b, right) && !by_time.trains(b + 1, left), "{b}");
        }
        assert!(by_time.all_have_others());
        // Two blocks a log: beside either there is nothing left but its guard.
        let (whole, logs) = folds(4.0);
        assert_eq!((whole.by.as_str(), whole.count), ("log", 3));
        assert!(whole.all_have_others() && whole.of_block == logs);
    }
}
