//! Two vectors as one: twice the robots a group.
//!
//! A step is a chain of short sums that wait for each other. With two vectors a number every operation has an
//! independent twin that fills the wait, whatever the compiler makes of it.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::lane::Lane;

/// The first half of a group's robots and the second.
#[derive(Clone, Copy)]
pub struct Pair<V>(V, V);

macro_rules! operator {
    ($trait:ident, $call:ident, $assign_trait:ident, $assign:ident) => {
        impl<V: Lane> $trait for Pair<V> {
            type Output = Self;
            #[inline(always)]
            fn $call(self, other: Self) -> Self {
                Self(self.0.$call(other.0), self.1.$call(other.1))
            }
        }
        impl<V: Lane> $assign_trait for Pair<V> {
            #[inline(always)]
            fn $assign(&mut self, other: Self) {
                *self = self.$call(other);
            }
        }
    };
}

operator!(Add, add, AddAssign, add_assign);
operator!(Sub, sub, SubAssign, sub_assign);
operator!(Mul, mul, MulAssign, mul_assign);

impl<V: Lane> Div for Pair<V> {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        Self(self.0 / other.0, self.1 / other.1)
    }
}

impl<V: Lane> Neg for Pair<V> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(-self.0, -self.1)
    }
}

impl<V: Lane> Lane for Pair<V> {
    type Scalar = V::Scalar;
    const WIDTH: usize = 2 * V::WIDTH;
    const DOUBLE: bool = V::DOUBLE;

    #[inline(always)]
    fn scalar(x: f64) -> V::Scalar {
        V::scalar(x)
    }
    #[inline(always)]
    fn splat(x: V::Scalar) -> Self {
        Self(V::splat(x), V::splat(x))
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0.mul_add(b.0, c.0), self.1.mul_add(b.1, c.1))
    }
    #[inline(always)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        Self(self.0.neg_mul_add(b.0, c.0), self.1.neg_mul_add(b.1, c.1))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.min(other.1))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Self(self.0.max(other.0), self.1.max(other.1))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(self.0.sqrt(), self.1.sqrt())
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self(self.0.round(), self.1.round())
    }
    #[inline(always)]
    fn select_lt(self, other: Self, yes: Self, no: Self) -> Self {
        Self(
            self.0.select_lt(other.0, yes.0, no.0),
            self.1.select_lt(other.1, yes.1, no.1),
        )
    }
    #[inline(always)]
    fn any_lt(self, other: Self) -> bool {
        self.0.any_lt(other.0) | self.1.any_lt(other.1)
    }
    #[inline(always)]
    fn any_ne(self, other: Self) -> bool {
        self.0.any_ne(other.0) | self.1.any_ne(other.1)
    }
    #[inline(always)]
    fn load(from: &[f64]) -> Self {
        Self(V::load(from), V::load(&from[V::WIDTH..]))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        let (first, second) = to.split_at_mut(V::WIDTH);
        self.0.store(first);
        self.1.store(second);
    }
    #[inline(always)]
    fn get(&self, i: usize) -> f64 {
        if i < V::WIDTH {
            self.0.get(i)
        } else {
            self.1.get(i - V::WIDTH)
        }
    }
    fn set(&mut self, i: usize, x: f64) {
        if i < V::WIDTH {
            self.0.set(i, x);
        } else {
            self.1.set(i - V::WIDTH, x);
        }
    }
}
