//! Logarithm, exponential and the gamma family in `f64`, without branches, so that loops over them vectorise.

use crate::simd::Simd;

/// Natural logarithm of a positive, normal number (fdlibm's method).
#[inline(always)]
pub(crate) fn ln<S: Simd>(x: f64) -> f64 {
    const SQRT_HALF: u64 = 0x3fe6_a09e_667f_3bcd;
    let bits = x.to_bits();
    let power = (bits.wrapping_sub(SQRT_HALF) as i64) >> 52;
    let f = f64::from_bits(bits.wrapping_sub((power as u64) << 52)) - 1.0;
    let power = power as f64;
    let s = f / (2.0 + f);
    let z = s * s;
    let mut r = 1.479_819_860_511_658_6e-1;
    for coefficient in [
        1.531_383_769_920_937_3e-1,
        1.818_357_216_161_805e-1,
        2.222_219_843_214_978_4e-1,
        2.857_142_874_366_239e-1,
        3.999_999_999_940_942e-1,
        6.666_666_666_666_735e-1,
    ] {
        r = S::fma64(r, z, coefficient);
    }
    r *= z;
    let half = 0.5 * f * f;
    let low = S::fma64(s, half + r, power * 1.908_214_929_270_587_7e-10);
    S::fma64(power, 6.931_471_803_691_238e-1, f - (half - low))
}

/// Exponential of a number from -700 to 0; below, that of -700.
#[inline(always)]
pub(crate) fn exp<S: Simd>(x: f64) -> f64 {
    const ROUND: f64 = 6_755_399_441_055_744.0; // 1.5 * 2^52: adding it rounds to an integer
    let x = x.max(-700.0);
    let shifted = S::fma64(x, std::f64::consts::LOG2_E, ROUND);
    let power = shifted - ROUND;
    let r = S::fma64(power, -6.931_471_803_691_238e-1, x);
    let r = S::fma64(power, -1.908_214_929_270_587_7e-10, r);
    // Taylor series; |r| <= ln(2) / 2.
    let mut p = 1.0 / 6_227_020_800.0;
    for factorial in [
        479_001_600.0,
        39_916_800.0,
        3_628_800.0,
        362_880.0,
        40_320.0,
        5_040.0,
        720.0,
        120.0,
        24.0,
        6.0,
        2.0,
        1.0,
        1.0,
    ] {
        p = S::fma64(p, r, 1.0 / factorial);
    }
    p * f64::from_bits((shifted.to_bits() << 52).wrapping_add(1023 << 52))
}

/// `ln(1 + exp(z))` and its derivative, the logistic function. The former is not a number if `z` is not.
#[inline(always)]
pub(crate) fn softplus<S: Simd>(z: f64) -> (f64, f64) {
    let u = exp::<S>(-z.abs());
    let inverse = 1.0 / (1.0 + u);
    // ln(1 + u) loses the digits of a small u; the series does not.
    let series = u * S::fma64(u, S::fma64(u, 1.0 / 3.0, -0.5), 1.0);
    let log = if u < 1e-5 { series } else { ln::<S>(1.0 + u) };
    (0.5 * (z + z.abs()) + log, if z >= 0.0 { inverse } else { u * inverse })
}

/// `ln Gamma(x)`, its first derivative (digamma) and its second (trigamma).
#[derive(Clone, Copy)]
pub(crate) struct LogGamma {
    /// `ln Gamma(x)`.
    pub value: f64,
    /// Digamma.
    pub first: f64,
    /// Trigamma.
    pub second: f64,
}

/// The gamma family for `x >= 1`: the asymptotic series at `x + 8`, and the recurrence back through the product
/// `p = x (x + 1) ... (x + 7)` and its derivatives (Abramowitz and Stegun 6.1.40, 6.3.18, 6.4.12 and 6.1.16).
#[inline(always)]
pub(crate) fn log_gamma<S: Simd>(x: f64) -> LogGamma {
    let (mut p, mut dp, mut ddp) = (x, 1.0, 0.0);
    for i in 1..8 {
        let t = x + f64::from(i);
        ddp = S::fma64(ddp, t, 2.0 * dp);
        dp = S::fma64(dp, t, p);
        p *= t;
    }
    let p_inverse = 1.0 / p;
    let ratio = dp * p_inverse;
    let y = x + 8.0;
    let inverse = 1.0 / y;
    let square = inverse * inverse;
    // Bernoulli terms B(2k) / (2k (2k - 1)) y^(1 - 2k) and their derivatives.
    let (mut value, mut first, mut second) = (0.0, 0.0, 0.0);
    for (k, coefficient) in [
        (8.0, -3617.0 / 122_400.0),
        (7.0, 1.0 / 156.0),
        (6.0, -691.0 / 360_360.0),
        (5.0, 1.0 / 1_188.0),
        (4.0, -1.0 / 1_680.0),
        (3.0, 1.0 / 1_260.0),
        (2.0, -1.0 / 360.0),
        (1.0, 1.0 / 12.0),
    ] {
        value = S::fma64(value, square, coefficient);
        first = S::fma64(first, square, coefficient * (2.0 * k - 1.0));
        second = S::fma64(second, square, coefficient * (2.0 * k - 1.0) * 2.0 * k);
    }
    let log = ln::<S>(y);
    const HALF_LN_TAU: f64 = 0.918_938_533_204_672_8;
    LogGamma {
        value: S::fma64(y - 0.5, log, S::fma64(value, inverse, HALF_LN_TAU) - y) - ln::<S>(p),
        first: log - 0.5 * inverse - first * square - ratio,
        second: S::fma64(second * square, inverse, S::fma64(0.5, square, inverse)) + ratio * ratio - ddp * p_inverse,
    }
}
