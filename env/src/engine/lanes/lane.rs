//! SIMD vectors of one scalar per robot.
//!
//! [`Lane`] is what the algorithms are written in; the types are newtypes over `core::arch` vectors. All
//! algorithm code is `#[inline(always)]` and generic over [`Lane`]; [`Kernel::step`] instantiates it once per type
//! inside a function with the matching `#[target_feature]`, so the portable binary holds every width.
//!
//! This is the only module of the engine with `unsafe`: calls of vector intrinsics. They are sound because a vector
//! type is only used after [`super::Simd::is_available`] has found its instruction set (checked where a batch is made),
//! and the casts between a vector and an array of the same size and scalar are plain bit copies.

use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

use super::group::{Group, State};
use super::kinematics;
use super::model::Model;
use super::step;
use super::work::{Timer, Work};

/// The widest lane type.
pub const MAX_WIDTH: usize = 16;

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
    fn get(self, i: usize) -> f64;
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
    fn load(from: &[f64]) -> Self {
        Self(from[0])
    }
    #[inline(always)]
    fn store(self, to: &mut [f64]) {
        to[0] = self.0;
    }
    #[inline(always)]
    fn get(self, _: usize) -> f64 {
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

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;
    use std::mem::transmute;

    use super::*;

    const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

    macro_rules! vector {
        ($lane:ident, $doc:literal, $raw:ty, $scalar:ty, $width:literal, $features:literal, $set1:ident, $add:ident, $sub:ident,
         $mul:ident, $div:ident, $fmadd:ident, $fnmadd:ident, $min:ident, $max:ident, $sqrt:ident, $round:expr,
         $select:expr, $any:expr) => {
            #[doc = $doc]
            #[derive(Clone, Copy)]
            #[repr(transparent)]
            pub struct $lane($raw);

            operators!(
                $lane,
                a,
                b,
                $lane(unsafe { $add(a.0, b.0) }),
                $lane(unsafe { $sub(a.0, b.0) }),
                $lane(unsafe { $mul(a.0, b.0) }),
                $lane(unsafe { $div(a.0, b.0) }),
                $lane(unsafe { $sub($set1(-0.0), a.0) })
            );

            impl Lane for $lane {
                type Scalar = $scalar;
                const WIDTH: usize = $width;
                const DOUBLE: bool = size_of::<$scalar>() == 8;

                #[inline(always)]
                fn scalar(x: f64) -> $scalar {
                    x as $scalar
                }
                #[inline(always)]
                fn splat(x: $scalar) -> Self {
                    Self(unsafe { $set1(x) })
                }
                #[inline(always)]
                fn mul_add(self, b: Self, c: Self) -> Self {
                    Self(unsafe { $fmadd(self.0, b.0, c.0) })
                }
                #[inline(always)]
                fn neg_mul_add(self, b: Self, c: Self) -> Self {
                    Self(unsafe { $fnmadd(self.0, b.0, c.0) })
                }
                #[inline(always)]
                fn min(self, other: Self) -> Self {
                    Self(unsafe { $min(self.0, other.0) })
                }
                #[inline(always)]
                fn max(self, other: Self) -> Self {
                    Self(unsafe { $max(self.0, other.0) })
                }
                #[inline(always)]
                fn sqrt(self) -> Self {
                    Self(unsafe { $sqrt(self.0) })
                }
                #[inline(always)]
                fn round(self) -> Self {
                    Self(unsafe { $round(self.0) })
                }
                #[inline(always)]
                fn select_lt(self, other: Self, yes: Self, no: Self) -> Self {
                    Self(unsafe { $select(self.0, other.0, yes.0, no.0) })
                }
                #[inline(always)]
                fn any_lt(self, other: Self) -> bool {
                    unsafe { $any(self.0, other.0) }
                }
                #[inline(always)]
                fn load(from: &[f64]) -> Self {
                    let mut lanes = [0.0 as $scalar; $width];
                    for (lane, x) in lanes.iter_mut().zip(&from[..$width]) {
                        *lane = *x as $scalar;
                    }
                    Self(unsafe { transmute::<[$scalar; $width], $raw>(lanes) })
                }
                #[inline(always)]
                fn store(self, to: &mut [f64]) {
                    let lanes = unsafe { transmute::<$raw, [$scalar; $width]>(self.0) };
                    for (x, lane) in to[..$width].iter_mut().zip(lanes) {
                        *x = f64::from(lane);
                    }
                }
                #[inline(always)]
                fn get(self, i: usize) -> f64 {
                    let lanes = unsafe { transmute::<$raw, [$scalar; $width]>(self.0) };
                    f64::from(lanes[i])
                }
                fn set(&mut self, i: usize, x: f64) {
                    let mut lanes = unsafe { transmute::<$raw, [$scalar; $width]>(self.0) };
                    lanes[i] = x as $scalar;
                    self.0 = unsafe { transmute::<[$scalar; $width], $raw>(lanes) };
                }
            }

            impl Kernel for $lane {
                fn step(model: &Model<Self>, group: &mut Group<Self>, work: &mut Work<Self>, timer: &mut Timer) {
                    #[target_feature(enable = $features)]
                    fn run(model: &Model<$lane>, group: &mut Group<$lane>, work: &mut Work<$lane>, timer: &mut Timer) {
                        step::step(model, group, work, timer);
                    }
                    unsafe { run(model, group, work, timer) }
                }
                fn place(model: &Model<Self>, state: &State<Self>, work: &mut Work<Self>) {
                    #[target_feature(enable = $features)]
                    fn run(model: &Model<$lane>, state: &State<$lane>, work: &mut Work<$lane>) {
                        kinematics::place_links(model, state, work);
                    }
                    unsafe { run(model, state, work) }
                }
            }
        };
    }

    vector!(
        F32x16,
        "Sixteen robots in `f32` (AVX-512).",
        __m512,
        f32,
        16,
        "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma",
        _mm512_set1_ps,
        _mm512_add_ps,
        _mm512_sub_ps,
        _mm512_mul_ps,
        _mm512_div_ps,
        _mm512_fmadd_ps,
        _mm512_fnmadd_ps,
        _mm512_min_ps,
        _mm512_max_ps,
        _mm512_sqrt_ps,
        |a| _mm512_roundscale_ps::<NEAREST>(a),
        |a, b, yes, no| _mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b), no, yes),
        |a, b| _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) != 0
    );
    vector!(
        F64x8,
        "Eight robots in `f64` (AVX-512).",
        __m512d,
        f64,
        8,
        "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma",
        _mm512_set1_pd,
        _mm512_add_pd,
        _mm512_sub_pd,
        _mm512_mul_pd,
        _mm512_div_pd,
        _mm512_fmadd_pd,
        _mm512_fnmadd_pd,
        _mm512_min_pd,
        _mm512_max_pd,
        _mm512_sqrt_pd,
        |a| _mm512_roundscale_pd::<NEAREST>(a),
        |a, b, yes, no| _mm512_mask_blend_pd(_mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b), no, yes),
        |a, b| _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b) != 0
    );
    vector!(
        F32x8,
        "Eight robots in `f32` (AVX2).",
        __m256,
        f32,
        8,
        "avx2,fma",
        _mm256_set1_ps,
        _mm256_add_ps,
        _mm256_sub_ps,
        _mm256_mul_ps,
        _mm256_div_ps,
        _mm256_fmadd_ps,
        _mm256_fnmadd_ps,
        _mm256_min_ps,
        _mm256_max_ps,
        _mm256_sqrt_ps,
        |a| _mm256_round_ps::<NEAREST>(a),
        |a, b, yes, no| _mm256_blendv_ps(no, yes, _mm256_cmp_ps::<_CMP_LT_OQ>(a, b)),
        |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) != 0
    );
    vector!(
        F64x4,
        "Four robots in `f64` (AVX2).",
        __m256d,
        f64,
        4,
        "avx2,fma",
        _mm256_set1_pd,
        _mm256_add_pd,
        _mm256_sub_pd,
        _mm256_mul_pd,
        _mm256_div_pd,
        _mm256_fmadd_pd,
        _mm256_fnmadd_pd,
        _mm256_min_pd,
        _mm256_max_pd,
        _mm256_sqrt_pd,
        |a| _mm256_round_pd::<NEAREST>(a),
        |a, b, yes, no| _mm256_blendv_pd(no, yes, _mm256_cmp_pd::<_CMP_LT_OQ>(a, b)),
        |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) != 0
    );
}

#[cfg(target_arch = "x86_64")]
pub use x86::{F32x8, F32x16, F64x4, F64x8};
