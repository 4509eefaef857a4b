//! Two motions that differ in proportion to the step, judged by halving it twice.

#[path = "motion.rs"]
mod motion;

pub use motion::{Motion, distance, extrapolated};

/// Asserts that what shrinks with the step, at steps h, h/2 and h/4, is of first order in it.
///
/// With `a h + b h^2`, twice the value at half the step less that at the whole one is `-b h^2 / 2`: a quarter of it is left when
/// the step is halved again. Of anything else that is no smaller than first order, and of what does not go away at all, at
/// least half would be left.
pub fn first_order(name: &str, values: &[Motion; 3]) {
    let [coarse, middle, fine] = values;
    let zero = vec![0.0; fine.len()];
    let [first, second] = [(coarse, middle), (middle, fine)].map(|(c, f)| distance(&extrapolated(c, f), &zero));
    assert!(
        second < 0.5 * first,
        "{name}: beyond first order {first}, and {second} with half the step"
    );
}

/// Asserts that two programs that mean the same move alike: `motions` are both at steps h, h/2 and h/4.
pub fn agree(motions: &[[Motion; 2]; 3]) {
    let apart = |[a, b]: &[Motion; 2]| -> Motion { a.iter().zip(b).map(|(a, b)| a - b).collect() };
    first_order("difference", &motions.each_ref().map(apart));
    // Of the finer extrapolation's error, its distance to the coarser one is three times as much.
    let [coarse, middle, fine] = motions;
    let [one, other] = [0, 1].map(|e| {
        let (first, second) = (extrapolated(&coarse[e], &middle[e]), extrapolated(&middle[e], &fine[e]));
        (distance(&first, &second), second)
    });
    let (error, bound) = (distance(&one.1, &other.1), one.0 + other.0);
    assert!(error < bound, "{error} rad apart without a step, {bound} rad known");
}
