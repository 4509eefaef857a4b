//! A measured torque, or dry friction, over one or two variables: what is left when no model of the catalogue explains it.

use super::catalogue::{Info, Place, Site};

pub(super) const RESIDUAL: Info = Info {
    id: "residual_torque",
    site: Site::Joint,
    place: Place::Table,
    parameters: &[],
    what: "a measured table of torque, or of dry friction, over position, velocity, target, motor torque or time, linear between its points",
};

/// What a table is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Variable {
    /// Joint position, rad or m.
    Position,
    /// Joint velocity, rad/s or m/s.
    Velocity,
    /// Position target, rad or m.
    Target,
    /// Motor torque of the last step, N m or N.
    Torque,
    /// Time since the start of the log or episode, s.
    Time,
}

impl Variable {
    /// Every variable.
    pub const ALL: [Self; 5] = [Self::Position, Self::Velocity, Self::Target, Self::Torque, Self::Time];

    /// Its name in files and reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Target => "target",
            Self::Torque => "torque",
            Self::Time => "time",
        }
    }
}

/// Torque over variables, linear between grid points and constant beyond the outermost.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// One or two variables, each with its grid points in ascending order.
    pub axes: Vec<(Variable, Vec<f64>)>,
    /// Torque at the grid points, N m or N; the last axis runs fastest.
    pub values: Vec<f64>,
    /// Whether it is dry friction, which comes on top of the joint's (both together are no less than none), and not a torque.
    pub friction: bool,
}

impl Table {
    /// Most points of an axis.
    pub const MOST_POINTS: usize = 256;

    /// What makes this no table, if anything does.
    pub fn fault(&self) -> Option<String> {
        if !(1..=2).contains(&self.axes.len()) {
            return Some(format!("a table over {} variables", self.axes.len()));
        }
        for (variable, grid) in &self.axes {
            let ascends = grid.windows(2).all(|pair| pair[0] < pair[1]) && grid.iter().all(|x| x.is_finite());
            if grid.len() < 2 || grid.len() > Self::MOST_POINTS || !ascends {
                let name = variable.name();
                return Some(format!("the grid over {name} is not 2 to 256 ascending numbers"));
            }
        }
        let points: usize = self.axes.iter().map(|(_, grid)| grid.len()).product();
        if self.values.len() != points || self.values.iter().any(|v| !v.is_finite()) {
            return Some(format!("{} values for {points} grid points", self.values.len()));
        }
        None
    }

    /// Torque where `value` gives the variables.
    pub fn torque(&self, value: impl Fn(Variable) -> f64) -> f64 {
        let at = |axis: usize| {
            let (variable, grid) = &self.axes[axis];
            place(grid, value(*variable))
        };
        let (i, s) = at(0);
        if self.axes.len() == 1 {
            return self.values[i] + s * (self.values[i + 1] - self.values[i]);
        }
        let (j, t) = at(1);
        let width = self.axes[1].1.len();
        let row = |i: usize| {
            let [a, b] = [self.values[i * width + j], self.values[i * width + j + 1]];
            a + t * (b - a)
        };
        row(i) + s * (row(i + 1) - row(i))
    }
}

/// The cell of `grid` that holds `x`, and where in it, from 0 to 1.
fn place(grid: &[f64], x: f64) -> (usize, f64) {
    let i = grid.partition_point(|&g| g <= x).clamp(1, grid.len() - 1) - 1;
    (i, ((x - grid[i]) / (grid[i + 1] - grid[i])).clamp(0.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_is_linear_between_its_points_and_constant_beyond() {
        let table = Table {
            axes: vec![
                (Variable::Position, vec![0.0, 1.0]),
                (Variable::Velocity, vec![-1.0, 1.0]),
            ],
            values: vec![0.0, 2.0, 4.0, 6.0],
            friction: false,
        };
        let at = |q: f64, v: f64| table.torque(|x| if x == Variable::Position { q } else { v });
        assert_eq!(at(0.5, 0.0), 3.0);
        assert_eq!(at(-5.0, -5.0), 0.0);
        assert_eq!(at(5.0, 5.0), 6.0);
        assert_eq!(table.fault(), None);
    }
}
