//! Ground that is no level plane: every contact point has axes of its own, two tangents and the normal of the ground
//! under it.
//!
//! On the level plane these are the world's axes, and nothing of this module runs. Elsewhere the surface under every point of
//! every lane is looked up once a step, one after the other and in `f64`; `omniwalk bench env --set ground.kind=rough` shows what that costs.

use super::group::State;
use super::lane::{Lane, MAX_WIDTH};
use super::spatial::Force;
use super::vector::{Mat3, Sym3, Vec3};
use crate::ground::Ground;

/// A contact point's axes.
#[derive(Clone, Copy)]
pub struct Tilt<L> {
    /// Rows: the tangent above the x axis, the other tangent, the normal.
    axes: Mat3<L>,
    /// Turning velocity per unit of moment in the point's axes and scaled coordinates.
    pub turning: Sym3<L>,
}

impl<L: Lane> Tilt<L> {
    pub fn level() -> Self {
        Self {
            axes: Mat3::identity(),
            turning: Sym3::zero(),
        }
    }

    /// Looks the ground up under `position`, relative to the base link's origin. The axes are stored; what is
    /// returned is the distance of the point along the normal, from the plane of the ground there.
    #[inline(always)]
    pub fn place(&mut self, ground: &Ground, state: &State<L>, position: Vec3<L>) -> L {
        let mut point = [[0.0; MAX_WIDTH]; 3];
        for (numbers, lanes) in point.iter_mut().zip(position.array()) {
            lanes.store(numbers);
        }
        let [mut gaps, mut along_x, mut along_y] = [[0.0; MAX_WIDTH]; 3];
        for lane in 0..L::WIDTH {
            let [x, y, z] = [0, 1, 2].map(|axis| state.position[axis][lane] + point[axis][lane]);
            let surface = ground.at(x, y);
            gaps[lane] = (z - surface.height) * surface.normal().z;
            [along_x[lane], along_y[lane]] = surface.gradient;
        }
        self.axes = axes(L::load(&along_x), L::load(&along_y));
        L::load(&gaps)
    }

    /// A vector of the world in the point's axes.
    #[inline(always)]
    fn seen(&self, v: Vec3<L>) -> Vec3<L> {
        self.axes.apply(v)
    }

    /// A twist of the world, or a row over wrenches of the world, in the point's axes.
    #[inline(always)]
    pub fn twist(&self, twist: &[L; 6]) -> [L; 6] {
        let [x, y, z, a, b, c] = *twist;
        let (linear, angular) = (self.seen(Vec3::new(x, y, z)), self.seen(Vec3::new(a, b, c)));
        [linear.x, linear.y, linear.z, angular.x, angular.y, angular.z]
    }

    /// Rows of the world's axes mixed to rows of the point's.
    #[inline(always)]
    pub fn rows(&self, rows: &[[L; 6]; 3]) -> [[L; 6]; 3] {
        let mut mixed = *rows;
        for c in 0..6 {
            let column = self.seen(Vec3::new(rows[0][c], rows[1][c], rows[2][c]));
            [mixed[0][c], mixed[1][c], mixed[2][c]] = column.array();
        }
        mixed
    }

    /// A symmetric matrix of the world in the point's axes.
    #[inline(always)]
    pub fn matrix(&self, m: &Sym3<L>) -> Sym3<L> {
        m.rotated(&self.axes)
    }

    /// A vector of the point's axes in the world.
    #[inline(always)]
    pub fn in_world(&self, v: Vec3<L>) -> Vec3<L> {
        self.axes.combined(v)
    }

    /// A force and a moment of the point's axes in the world's.
    #[inline(always)]
    pub fn force(&self, f: Force<L>) -> Force<L> {
        Force {
            force: self.in_world(f.force),
            moment: self.in_world(f.moment),
        }
    }
}

/// The axes of a surface that rises by these gradients.
#[inline(always)]
fn axes<L: Lane>(along_x: L, along_y: L) -> Mat3<L> {
    let (o, i) = (L::zero(), L::of(1.0));
    let tangent = unit(Vec3::new(i, o, along_x));
    let normal = unit(Vec3::new(-along_x, -along_y, i));
    Mat3([tangent, normal.cross(tangent), normal])
}

#[inline(always)]
fn unit<L: Lane>(v: Vec3<L>) -> Vec3<L> {
    v.times(v.dot(v).sqrt().recip())
}
