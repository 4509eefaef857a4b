//! Spatial quantities over lanes.
//!
//! They use world axes and the base link's origin O as reference point: a motion is the velocity of
//! the body's point at O and the angular velocity, a force is the force and its moment about O, so that motions and
//! inertias of different links add without transforms (Featherstone, Rigid Body Dynamics Algorithms, chapter 2).

use super::lane::Lane;
use super::vector::{Sym3, Vec3};

/// A spatial velocity or acceleration.
#[derive(Clone, Copy)]
pub struct Motion<L> {
    /// Of the body's point at the reference point.
    pub linear: Vec3<L>,
    pub angular: Vec3<L>,
}

impl<L: Lane> Motion<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            linear: Vec3::zero(),
            angular: Vec3::zero(),
        }
    }
    #[inline(always)]
    pub fn plus(self, b: Self) -> Self {
        Self {
            linear: self.linear.plus(b.linear),
            angular: self.angular.plus(b.angular),
        }
    }
    #[inline(always)]
    pub fn times(self, s: L) -> Self {
        Self {
            linear: self.linear.times(s),
            angular: self.angular.times(s),
        }
    }
    /// Power of a force along this motion.
    #[inline(always)]
    pub fn dot(self, f: Force<L>) -> L {
        self.linear.dot(f.force) + self.angular.dot(f.moment)
    }
    /// `self x b`, the rate of change of a motion `b` carried by a body that moves with `self`.
    #[inline(always)]
    pub fn cross(self, b: Self) -> Self {
        Self {
            linear: self.angular.cross(b.linear).plus_cross(self.linear, b.angular),
            angular: self.angular.cross(b.angular),
        }
    }
    /// The same motion seen at `point` (relative to the reference point).
    #[inline(always)]
    pub fn at(self, point: Vec3<L>) -> Self {
        Self {
            linear: self.linear.plus_cross(self.angular, point),
            angular: self.angular,
        }
    }
    /// Linear, then angular components.
    #[inline(always)]
    pub fn array(self) -> [L; 6] {
        let ([a, b, c], [d, e, f]) = (self.linear.array(), self.angular.array());
        [a, b, c, d, e, f]
    }
}

/// A spatial force, impulse or momentum.
#[derive(Clone, Copy)]
pub struct Force<L> {
    pub force: Vec3<L>,
    /// About the reference point.
    pub moment: Vec3<L>,
}

impl<L: Lane> Force<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            force: Vec3::zero(),
            moment: Vec3::zero(),
        }
    }
    #[inline(always)]
    pub fn plus(self, b: Self) -> Self {
        Self {
            force: self.force.plus(b.force),
            moment: self.moment.plus(b.moment),
        }
    }
    /// Force, then moment components.
    #[inline(always)]
    pub fn array(self) -> [L; 6] {
        let ([a, b, c], [d, e, f]) = (self.force.array(), self.moment.array());
        [a, b, c, d, e, f]
    }
}

/// A spatial inertia about the reference point.
#[derive(Clone, Copy)]
pub struct Inertia<L> {
    pub mass: L,
    /// Mass times centre of mass.
    pub first_moment: Vec3<L>,
    /// Rotational inertia about the reference point.
    pub second_moment: Sym3<L>,
}

impl<L: Lane> Inertia<L> {
    #[inline(always)]
    pub fn zero() -> Self {
        Self {
            mass: L::zero(),
            first_moment: Vec3::zero(),
            second_moment: Sym3::zero(),
        }
    }
    /// From mass, centre of mass and the inertia about it (parallel-axis theorem).
    #[inline(always)]
    pub fn new(mass: L, com: Vec3<L>, about_com: &Sym3<L>) -> Self {
        let h = com.times(mass);
        let second_moment = Sym3 {
            xx: about_com.xx + h.y.mul_add(com.y, h.z * com.z),
            xy: h.x.neg_mul_add(com.y, about_com.xy),
            xz: h.x.neg_mul_add(com.z, about_com.xz),
            yy: about_com.yy + h.x.mul_add(com.x, h.z * com.z),
            yz: h.y.neg_mul_add(com.z, about_com.yz),
            zz: about_com.zz + h.x.mul_add(com.x, h.y * com.y),
        };
        Self {
            mass,
            first_moment: h,
            second_moment,
        }
    }
    #[inline(always)]
    pub fn plus(&self, b: &Self) -> Self {
        Self {
            mass: self.mass + b.mass,
            first_moment: self.first_moment.plus(b.first_moment),
            second_moment: self.second_moment.plus(&b.second_moment),
        }
    }
    /// The momentum of a motion, or the force of an acceleration.
    #[inline(always)]
    pub fn apply(&self, m: Motion<L>) -> Force<L> {
        Force {
            force: m.linear.times(self.mass).plus_cross(m.angular, self.first_moment),
            moment: self
                .second_moment
                .apply(m.angular)
                .plus_cross(self.first_moment, m.linear),
        }
    }
}
