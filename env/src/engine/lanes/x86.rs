//! Vectors of AVX2 and AVX-512, and the step compiled for them.
//!
//! This is the only module of the engine with `unsafe`: calls of vector intrinsics. They are sound because a vector
//! type is only used after [`super::Simd::is_available`] has found its instruction set (checked where a batch is made),
//! and the casts between a vector and an array of the same size and scalar are plain bit copies.

use std::arch::x86_64::*;
use std::mem::transmute;

use super::group::{Group, State};
use super::kinematics;
use super::lane::{Kernel, Lane, operators};
use super::model::Model;
use super::pair::Pair;
use super::step;
use super::work::{Timer, Work};
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

const NEAREST: i32 = _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC;

macro_rules! vector {
    ($lane:ident, $doc:literal, $raw:ty, $scalar:ty, $width:literal, $set1:ident, $add:ident, $sub:ident,
     $mul:ident, $div:ident, $fmadd:ident, $fnmadd:ident, $min:ident, $max:ident, $sqrt:ident, $round:expr,
     $select:expr, $any_lt:expr, $any_ne:expr) => {
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
                unsafe { $any_lt(self.0, other.0) }
            }
            #[inline(always)]
            fn any_ne(self, other: Self) -> bool {
                unsafe { $any_ne(self.0, other.0) }
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
            // In memory, as a start of an episode sets a thousand numbers: through a register every one would wait for the last.
            #[inline(always)]
            fn get(&self, i: usize) -> f64 {
                let lanes = unsafe { &*(&raw const self.0).cast::<[$scalar; $width]>() };
                f64::from(lanes[i])
            }
            #[inline(always)]
            fn set(&mut self, i: usize, x: f64) {
                let lanes = unsafe { &mut *(&raw mut self.0).cast::<[$scalar; $width]>() };
                lanes[i] = x as $scalar;
            }
        }
    };
}

vector!(
    Ps16,
    "Sixteen numbers in `f32` (AVX-512).",
    __m512,
    f32,
    16,
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
    |a, b| _mm512_cmp_ps_mask::<_CMP_LT_OQ>(a, b) != 0,
    |a, b| _mm512_cmp_ps_mask::<_CMP_NEQ_UQ>(a, b) != 0
);
vector!(
    Pd8,
    "Eight numbers in `f64` (AVX-512).",
    __m512d,
    f64,
    8,
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
    |a, b| _mm512_cmp_pd_mask::<_CMP_LT_OQ>(a, b) != 0,
    |a, b| _mm512_cmp_pd_mask::<_CMP_NEQ_UQ>(a, b) != 0
);
vector!(
    Ps8,
    "Eight numbers in `f32` (AVX2).",
    __m256,
    f32,
    8,
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
    |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_LT_OQ>(a, b)) != 0,
    |a, b| _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_NEQ_UQ>(a, b)) != 0
);
vector!(
    Pd4,
    "Four numbers in `f64` (AVX2).",
    __m256d,
    f64,
    4,
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
    |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_LT_OQ>(a, b)) != 0,
    |a, b| _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_NEQ_UQ>(a, b)) != 0
);

/// Two vectors a number, so that one works while the other waits for its last result.
macro_rules! kernel {
    ($lane:ident, $vector:ident, $features:literal) => {
        pub type $lane = Pair<$vector>;

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

kernel!(F32x16, Ps16, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma");
kernel!(F64x8, Pd8, "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma");
kernel!(F32x8, Ps8, "avx2,fma");
kernel!(F64x4, Pd4, "avx2,fma");
