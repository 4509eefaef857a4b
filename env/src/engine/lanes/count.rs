//! What a step computes, counted instead of estimated: a lane type whose operations count themselves.
//!
//! An addition, subtraction, multiplication, division or square root is one floating-point operation a lane, a fused
//! multiply-add two; comparisons, selections, minima, maxima, roundings and changes of sign are none. What a group
//! skips because no lane needs it is not counted, and what it does for lanes that do not need it is.

use std::cell::Cell;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::group::{Group, State};
use super::kinematics;
use super::lane::{Kernel, Lane, operators};
use super::model::Model;
use super::step;
use super::work::{Timer, Work};

/// Robots in a group of the fastest level, whose steps are counted.
const WIDTH: usize = 32;

thread_local! {
    /// Operations of this thread so far.
    static DONE: Cell<u64> = const { Cell::new(0) };
}

/// Operations of this thread so far.
pub fn done() -> u64 {
    DONE.get()
}

fn count(operations: u64) {
    DONE.set(DONE.get() + operations * WIDTH as u64);
}

/// Numbers in `f32` that count what is done with them. Nothing is inlined: this is not for speed.
#[derive(Clone, Copy)]
pub struct Counted([f32; WIDTH]);

impl Counted {
    #[inline(never)]
    fn each(self, b: Self, operations: u64, f: fn(f32, f32) -> f32) -> Self {
        count(operations);
        Self(std::array::from_fn(|i| f(self.0[i], b.0[i])))
    }
}

operators!(
    Counted,
    a,
    b,
    a.each(b, 1, |a, b| a + b),
    a.each(b, 1, |a, b| a - b),
    a.each(b, 1, |a, b| a * b),
    a.each(b, 1, |a, b| a / b),
    a.each(a, 0, |a, _| -a)
);

impl Lane for Counted {
    type Scalar = f32;
    const WIDTH: usize = WIDTH;
    const DOUBLE: bool = false;
    const COUNTS: bool = true;

    fn scalar(x: f64) -> f32 {
        x as f32
    }
    fn splat(x: f32) -> Self {
        Self([x; WIDTH])
    }
    #[inline(never)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        count(2);
        Self(std::array::from_fn(|i| self.0[i].mul_add(b.0[i], c.0[i])))
    }
    #[inline(never)]
    fn neg_mul_add(self, b: Self, c: Self) -> Self {
        count(2);
        Self(std::array::from_fn(|i| (-self.0[i]).mul_add(b.0[i], c.0[i])))
    }
    fn min(self, other: Self) -> Self {
        self.each(other, 0, |a, b| if a < b { a } else { b })
    }
    fn max(self, other: Self) -> Self {
        self.each(other, 0, |a, b| if a > b { a } else { b })
    }
    fn sqrt(self) -> Self {
        self.each(self, 1, |a, _| a.sqrt())
    }
    fn round(self) -> Self {
        self.each(self, 0, |a, _| a.round_ties_even())
    }
    #[inline(never)]
    fn select_lt(self, other: Self, yes: Self, no: Self) -> Self {
        Self(std::array::from_fn(|i| {
            if self.0[i] < other.0[i] { yes.0[i] } else { no.0[i] }
        }))
    }
    fn any_lt(self, other: Self) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a < b)
    }
    fn any_ne(self, other: Self) -> bool {
        self.0.iter().zip(&other.0).any(|(a, b)| a != b)
    }
    fn load(from: &[f64]) -> Self {
        Self(std::array::from_fn(|i| from[i] as f32))
    }
    fn store(self, to: &mut [f64]) {
        for (x, lane) in to.iter_mut().zip(self.0) {
            *x = lane.into();
        }
    }
    fn get(&self, i: usize) -> f64 {
        self.0[i].into()
    }
    fn set(&mut self, i: usize, x: f64) {
        self.0[i] = x as f32;
    }
}

impl Kernel for Counted {
    fn step(model: &Model<Self>, group: &mut Group<Self>, work: &mut Work<Self>, timer: &mut Timer) {
        step::step(model, group, work, timer);
    }
    fn place(model: &Model<Self>, state: &State<Self>, work: &mut Work<Self>) {
        kinematics::place_links(model, state, work);
    }
}
