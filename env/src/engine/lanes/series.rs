//! Functions by their series, over lanes.

use super::lane::Lane;

/// Horner's rule, the highest power first.
#[inline(always)]
pub fn polynomial<L: Lane, const N: usize>(x: L, coefficients: [f64; N]) -> L {
    let mut sum = L::of(coefficients[0]);
    for c in &coefficients[1..] {
        sum = sum.mul_add(x, L::of(*c));
    }
    sum
}

/// Sine and cosine: Cody-Waite reduction to a quarter turn, then the fdlibm (f64) or Cephes (f32) polynomials.
#[inline(always)]
pub fn sin_cos<L: Lane>(angle: L) -> (L, L) {
    let quarter = (angle * L::of(std::f64::consts::FRAC_2_PI)).round();
    // pi / 2 in three parts whose products with the quarter count are exact.
    let parts = if L::DOUBLE {
        [
            1.570_796_326_734_125_6,
            6.077_100_506_303_966e-11,
            2.022_266_248_795_951e-21,
        ]
    } else {
        [1.570_312_5, 4.837_512_969_970_703e-4, 7.549_789_948_768_648e-8]
    };
    let mut r = angle;
    for part in parts {
        r = quarter.neg_mul_add(L::of(part), r);
    }
    let r2 = r * r;
    let (s, c) = if L::DOUBLE {
        (
            polynomial(
                r2,
                [
                    1.589_690_995_211_55e-10,
                    -2.505_076_025_340_686_3e-8,
                    2.755_731_370_707_006_8e-6,
                    -1.984_126_982_985_795e-4,
                    8.333_333_333_322_49e-3,
                    -1.666_666_666_666_663_2e-1,
                ],
            ),
            polynomial(
                r2,
                [
                    -1.135_964_755_778_819_5e-11,
                    2.087_572_321_298_175e-9,
                    -2.755_731_435_139_066_3e-7,
                    2.480_158_728_947_673e-5,
                    -1.388_888_888_887_411e-3,
                    4.166_666_666_666_66e-2,
                ],
            ),
        )
    } else {
        (
            polynomial(r2, [-1.951_529_6e-4, 8.332_161e-3, -1.666_665_5e-1]),
            polynomial(r2, [2.443_315_7e-5, -1.388_731_6e-3, 4.166_664_6e-2]),
        )
    };
    let sin = (r2 * r).mul_add(s, r);
    let cos = (r2 * r2).mul_add(c, r2.neg_mul_add(L::of(0.5), L::of(1.0)));
    // quadrant = quarter modulo 4 in -2..=2
    let quadrant = (quarter * L::of(0.25)).round().neg_mul_add(L::of(4.0), quarter);
    let turns = quadrant.abs();
    let odd = (turns - L::of(1.0)).abs(); // 0 for an odd quadrant
    let half = L::of(0.5);
    let (a, b) = (odd.select_lt(half, cos, sin), odd.select_lt(half, sin, cos));
    // sin changes sign in quadrants -1, 2, -2; cos in 1, 2, -2
    let opposite = L::of(1.5);
    let sin = opposite.select_lt(turns, -a, quadrant.select_lt(-half, -a, a));
    let cos = opposite.select_lt(turns, -b, half.select_lt(quadrant, -b, b));
    (sin, cos)
}
