//! Where the points of a measured table are.

use omniwalk_env::effect::{Table, Variable};

use super::torque::{Form, Moment, knots};

/// Moments between two points of a table, as a share of what they were were they even, from which on a point is worth having.
const SPARSE: f64 = 0.2;

/// A table of no torque with at most so many `points` over what the moments have of a variable that simulations know, as a torque or as dry
/// friction; `None` where it is constant.
pub fn empty_table(moments: &[Moment], (variable, form): (usize, Form), points: usize) -> Option<Table> {
    let quantiles = knots(moments, variable, points);
    let (first, last) = (*quantiles.first()?, *quantiles.last()?);
    let steps = (quantiles.len() - 1).max(1) as f64;
    // Half way to equal distances: much can be seldom.
    let between = |(k, quantile): (usize, &f64)| 0.5 * (quantile + first + (last - first) * k as f64 / steps);
    let grid: Vec<f64> = quantiles.iter().enumerate().map(between).collect();
    let grid = without_sparse(grid, moments, variable, points);
    (grid.len() > 1).then(|| Table {
        values: vec![0.0; grid.len()],
        axes: vec![(Variable::ALL[variable], grid)],
        friction: form == Form::Friction,
    })
}

/// A `grid` of so many `points` over a variable without those points that fewer moments than [`SPARSE`] of an even share part from the one
/// before: what a few moments tell of a point of their own is noise.
fn without_sparse(grid: Vec<f64>, moments: &[Moment], variable: usize, points: usize) -> Vec<f64> {
    let mut values: Vec<f64> = moments.iter().map(|m| m.values[variable]).collect();
    values.sort_by(f64::total_cmp);
    let least = SPARSE * values.len() as f64 / points as f64;
    let below = |x: f64| values.partition_point(|value| *value < x) as f64;
    let mut kept: Vec<f64> = Vec::with_capacity(grid.len());
    for (k, &x) in grid.iter().enumerate() {
        let is_last = k + 1 == grid.len();
        let sparse = kept.last().is_some_and(|before| below(x) - below(*before) < least);
        if sparse && is_last && kept.len() > 1 {
            kept.pop();
        }
        if !sparse || is_last {
            kept.push(x);
        }
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_have_no_points_where_hardly_any_moments_are() {
        let at = |value: f64| Moment {
            trial: 0,
            log: 0,
            block: 0,
            torque: 0.0,
            values: vec![value],
        };
        // Nearly all between 0 and 1; a few farther off.
        let mut moments: Vec<Moment> = (0..1000).map(|k| at(f64::from(k) * 1e-3)).collect();
        moments.extend((1..9).map(|k| at(1.0 + 0.25 * f64::from(k))));
        let table = empty_table(&moments, (0, Form::Plain), 9).expect("a table");
        let grid = &table.axes[0].1;
        assert_eq!((grid.first(), grid.last()), (Some(&0.0), Some(&3.0)));
        let between = |pair: &[f64]| {
            moments
                .iter()
                .filter(|m| (pair[0]..pair[1]).contains(&m.values[0]))
                .count()
        };
        assert!(grid.windows(2).all(|pair| between(pair) >= 20), "{grid:?}");
        let even: Vec<Moment> = (0..1000).map(|k| at(f64::from(k) * 1e-3)).collect();
        let table = empty_table(&even, (0, Form::Plain), 9).expect("a table");
        assert_eq!(table.values.len(), 9);
    }
}
