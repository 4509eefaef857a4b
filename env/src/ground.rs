//! The ground under a robot: its height and its slope everywhere.
//!
//! A rough ground is a square field of [`CELLS`] cells a side around the origin. Each cell is two triangles, split from its
//! corner of smallest x and y to the opposite one: what rapier's height field is, so that both engines stand on one surface. Beyond the
//! field `lanes` goes on with the border's height; in rapier there is nothing. `lanes` sees the ground at the robot's contact
//! points only, rapier under the whole of every shape: an edge or a tip of the ground within a sole holds the robot in rapier
//! and not in `lanes`, so rough ground should change little over a foot's length.
//!
//! Starts, falls and the heights of soles (reward, clearance) are relative to the ground below; slip is horizontal. The estimator
//! of the controller knows of no ground but a level one, and tilts at which a robot counts as fallen are against gravity.

use std::sync::Arc;

use nalgebra::Vector3;

use crate::config::{GroundConfig, GroundKind};
use crate::random::Stream;

/// Cells a side of a rough ground.
pub const CELLS: usize = 256;

/// Height (m) of the ground as a function of the horizontal position.
#[derive(Clone, Debug, PartialEq)]
pub enum Ground {
    /// The plane z = 0.
    Plane,
    /// The plane z = g . (x, y) with the gradient g.
    Slope([f64; 2]),
    /// A field of heights.
    Field(Arc<Field>),
}

/// Heights on a square grid, with triangles between them.
#[derive(Debug, PartialEq)]
pub struct Field {
    /// Side of a cell, m.
    pub cell: f64,
    /// Heights of the corners, m: entry `i * (CELLS + 1) + j` is at `x = (i - CELLS / 2) cell`, `y = (j - CELLS / 2) cell`.
    pub heights: Vec<f64>,
}

/// The ground under a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Height, m.
    pub height: f64,
    /// Its derivatives along x and y.
    pub gradient: [f64; 2],
}

impl Surface {
    /// Unit normal, upwards.
    pub fn normal(&self) -> Vector3<f64> {
        let [x, y] = self.gradient;
        Vector3::new(-x, -y, 1.0).normalize()
    }
}

impl Ground {
    /// The ground of the configuration; the same seed gives the same field.
    pub fn new(config: &GroundConfig) -> Self {
        match config.kind {
            GroundKind::Plane => Self::Plane,
            GroundKind::Slope => Self::Slope(config.slope.map(f64::tan)),
            GroundKind::Rough => {
                let mut stream = Stream::new(config.seed, 0, 0);
                let mut draw = || stream.uniform(-config.amplitude, config.amplitude);
                Self::Field(Arc::new(Field {
                    cell: config.cell,
                    heights: (0..(CELLS + 1) * (CELLS + 1)).map(|_| draw()).collect(),
                }))
            }
        }
    }

    /// Height and gradient at (x, y), m.
    pub fn at(&self, x: f64, y: f64) -> Surface {
        match self {
            Self::Plane => Surface {
                height: 0.0,
                gradient: [0.0; 2],
            },
            Self::Slope([a, b]) => Surface {
                height: a * x + b * y,
                gradient: [*a, *b],
            },
            Self::Field(field) => field.at(x, y),
        }
    }

    /// Height at (x, y), m.
    pub fn height(&self, x: f64, y: f64) -> f64 {
        self.at(x, y).height
    }
}

impl Field {
    fn at(&self, x: f64, y: f64) -> Surface {
        // As an index, what is not a number is zero.
        let place = |x: f64| {
            let inside = (x / self.cell + 0.5 * CELLS as f64).clamp(0.0, CELLS as f64);
            let index = (inside as usize).min(CELLS - 1);
            (index, inside - index as f64)
        };
        let ((i, u), (j, v)) = (place(x), place(y));
        let corner = |i: usize, j: usize| self.heights[i * (CELLS + 1) + j];
        let (near, far) = (corner(i, j), corner(i + 1, j + 1));
        // Rises over a cell, along the edges of the triangle.
        let (along_x, along_y) = if u >= v {
            let right = corner(i + 1, j);
            (right - near, far - right)
        } else {
            let left = corner(i, j + 1);
            (far - left, left - near)
        };
        Surface {
            height: near + u * along_x + v * along_y,
            gradient: [along_x / self.cell, along_y / self.cell],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rough(amplitude: f64) -> Ground {
        Ground::new(&GroundConfig {
            kind: GroundKind::Rough,
            slope: [0.0; 2],
            amplitude,
            cell: 0.2,
            seed: 3,
        })
    }

    #[test]
    fn a_field_is_continuous_and_rises_by_its_gradient() {
        let ground = rough(0.03);
        let mut stream = Stream::new(1, 2, 3);
        for _ in 0..1000 {
            let (x, y) = (stream.uniform(-20.0, 20.0), stream.uniform(-20.0, 20.0));
            let here = ground.at(x, y);
            let step = 1e-9;
            let along = [ground.height(x + step, y), ground.height(x, y + step)];
            for next in along {
                // No edge is steeper than two corners at opposite bounds.
                assert!((next - here.height).abs() <= 2.0 * 0.03 / 0.2 * step + 1e-15);
            }
            assert!(here.height.abs() <= 0.03);
        }
        let (here, next) = (ground.at(0.03, 0.04), ground.at(0.05, 0.07));
        let rise = 0.02 * here.gradient[0] + 0.03 * here.gradient[1];
        assert!((next.height - here.height - rise).abs() < 1e-15);
    }

    #[test]
    fn a_field_goes_through_its_corners() {
        let ground = rough(0.03);
        let Ground::Field(field) = &ground else {
            panic!("a field")
        };
        for (i, j) in [(0, 0), (128, 128), (7, 250), (256, 256)] {
            let at = |i: usize| (i as f64 - 0.5 * CELLS as f64) * 0.2;
            let error = ground.height(at(i), at(j)) - field.heights[i * (CELLS + 1) + j];
            assert!(error.abs() < 1e-12, "{error}");
        }
    }

    #[test]
    fn beyond_the_field_and_at_no_number_there_is_still_ground() {
        let ground = rough(0.03);
        for x in [1e6, -1e6, f64::INFINITY, f64::NAN] {
            let _ = ground.at(x, -x);
        }
        assert_eq!(ground.height(1e6, 0.05), ground.height(25.6, 0.05));
    }
}
