//! SIMD vectors of one scalar per robot.
//!
//! [`Lane`] is what the algorithms are written in; the types are newtypes over `core::arch` vectors, two at a time. All
//! algorithm code is `#[inline(always)]` and generic over [`Lane`]; [`Kernel::step`] instantiates it once per type
//! inside a function with the matching `#[target_feature]`, so the portable binary holds every width. What is not inlined there
//! is compiled for any processor, and calls a function for every operation: closures over lanes and iterator adapters that the
//! compiler may leave alone (`map`, `skip`, `fill`) do not belong into a step.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::group::{Group, State};
use super::kinematics;
use super::model::Model;
use super::step;
use super::work::{Timer, Work};

/// The widest lane type.
pub const MAX_WIDTH: usize = 32;

/// One number per robot of a group.
pub trait Lane:
    Copy
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// The scalar.
    type Scalar: Copy + Send + Sync + 'static;
    /// Robots in a group.
    const WIDTH: usize;
    /// Whether the scalar is `f64`.
    const DOUBLE: bool;
    /// Whether the operations count themselves, see [`super::count`].
    const COUNTS: bool = false;

    /// Rounds to the scalar type.
    fn scalar(x: f64) -> Self::Scalar;
    /// The same number in every lane.
    fn splat(x: Self::Scalar) -> Self;
    /// `self * b + c`
    fn mul_add(self, b: Self, c: Self) -> Self;
    /// `c - self * b`
    fn neg_mul_add(self, b: Self, c: Self) -> Self;
    /// The smaller; the argument where either is NaN.
    fn min(self, other: Self) -> Self;
    /// The larger; the argument where either is NaN.
    fn max(self, other: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Nearest integer.
    fn round(self) -> Self;
    /// `yes` where `self < other`, else `no` (also where either is NaN).
    fn select_lt(self, other: Self, yes: Self, no: Self) -> Self;
    /// Whether `self < other` in any lane.
    fn any_lt(self, other: Self) -> bool;
    /// Whether `self != other` in any lane, or either is NaN.
    fn any_ne(self, other: Self) -> bool;
    /// Rounds the first `WIDTH` numbers of `from` into lanes.
    fn load(from: &[f64]) -> Self;
    /// Writes the lanes to the first `WIDTH` numbers of `to`.
    fn store(self, to: &mut [f64]);

    /// A constant, rounded to the scalar type.
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self::splat(Self::scalar(x))
    }
    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::of(0.0)
    }
    /// `1 / self`
    #[inline(always)]
    fn recip(self) -> Self {
        Self::of(1.0) / self
    }
    /// Between `low` and `high`.
    #[inline(always)]
    fn clamp(self, low: Self, high: Self) -> Self {
        self.max(low).min(high)
    }
    /// The magnitude.
    #[inline(always)]
    fn abs(self) -> Self {
        self.max(-self)
    }
    /// The number in lane `i`.
    fn get(&self, i: usize) -> f64;
    /// Replaces the number in lane `i`, leaving the bits of the others.
    fn set(&mut self, i: usize, x: f64);
}

/// A lane type with the step compiled for its instruction set.
pub trait Kernel: Lane {
    /// [`step::step`] of one group.
    fn step(model: &Model<Self>, group: &mut Group<Self>, work: &mut Work<Self>, timer: &mut Timer);
    /// [`kinematics::place_links`] of one group.
    fn place(model: &Model<Self>, state: &State<Self>, work: &mut Work<Self>);
}

macro_rules! operators {
    ($lane:ident, $a:ident, $b:ident, $add:expr, $sub:expr, $mul:expr, $div:expr, $neg:expr) => {
        impl Add for $lane {
            type Output = Self;
            #[inline(always)]
            fn add(self, other: Self) -> Self {
                let ($a, $b) = (self, other);
                $add
            }
        }
        impl Sub for $lane {
            type Output = Self;
            #[inline(always)]
            fn sub(self, other: Self) -> Self {
                let ($a, $b) = (self, other);
                $sub
            }
        }
        impl Mul for $lane {
            type Output = Self;
            #[inline(always)]
            fn mul(self, other: Self) -> Self {
                let ($a, $b) = (self, other);
                $mul
            }
        }
        impl Div for $lane {
            type Output = Self;
            #[inline(always)]
            fn div(self, other: Self) -> Self {
                let ($a, $b) = (self, other);
                $div
            }
        }
        impl Neg for $lane {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                let $a = self;
                $neg
            }
        }
        impl AddAssign for $lane {
            #[inline(always)]
            fn add_assign(&mut self, other: Self) {
                *self = *self + other;
            }
        }
        impl SubAssign for $lane {
            #[inline(always)]
            fn sub_assign(&mut self, other: Self) {
                *self = *self - other;
            }
        }
        impl MulAssign for $lane {
            #[inline(always)]
            fn mul_assign(&mut self, other: Self) {
                *self = *self * other;
            }
        }
    };
}

pub(super) use operators;

/// One robot at a time in `f64`, on any processor.
#[derive(Clone, Copy)]
pub struct Single(f64);

operators!(
    Single,
    a,
    b,
    Single(a.0 + b.0),
    Single(a.0 - b.0),
    Single(a.0 * b.0),
    Single(a.0 / b.0),
    Single(-a.0)
);

impl Lane for Single {
    type Scalar = f64;
    const WIDTH: usize = 1;
    const DOUBLE: bool = true;

    #[inline(always)]
    fn scalar(x: f64) -> f64 {
        x
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self(x)
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0 * b.0 + c.0)
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(c.0 - self.0 * b.0)
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(if self.0 < other.0 { self.0 } else { other.0 })
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(if self.0 > other.0 { self.0 } else { other.0 })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt())
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.round_ties_even())
    }
    #[inline(always)]
    fn select_lt(self, other: Self, yes: Self, no: Self) -> Self {
        if self.0 < other.0 { yes } else { no }
    }
    #[inline(always)]
    fn any_lt(self, other: Self) -> bool {
        self.0 < other.0
    }
    #[inline(always)]
    fn any_ne(self, other: Self) -> bool {
        self.0 != other.0
    }
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        Self(from[0])
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self.0;
    }
    #[inline(always)]
    fn get(&self, _: usize) -> f64 {
        self.0
    }
    fn set(&mut self, _: usize, x: f64) {
        self.0 = x;
    }
}

impl Kernel for Single {
    fn step(model: &Model<Self>, group: &mut Group<Self>, work: &mut Work<Self>, timer: &mut Timer) {
        step::step(model, group, work, timer);
    }
    fn place(model: &Model<Self>, state: &State<Self>, work: &mut Work<Self>) {
        kinematics::place_links(model, state, work);
    }
}
