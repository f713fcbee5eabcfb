//! Iterative refinement of solutions by a matrix whose condition is the square of the one that counts.

const MOST_CORRECTIONS: u32 = 5;

/// Repeats `correct`, which tells the size of a correction and that of the corrected solution, while
/// corrections fall tenfold and the next one would be above round-off. The first one is also the only measure
/// of what the square of the condition has cost, so it is always made. Returns the relative size of the next
/// correction as forecast.
pub(super) fn refine(mut correct: impl FnMut() -> (f64, f64)) -> f64 {
    let (mut before, mut left) = (1.0, 0.0);
    for _ in 0..MOST_CORRECTIONS {
        let (correction, whole) = correct();
        if whole == 0.0 {
            break;
        }
        let relative = correction / whole;
        let rate = relative / before;
        left = relative * rate.min(1.0);
        before = relative;
        // Written so that a NaN ends it.
        let goes_on = left > f64::EPSILON && rate <= 0.1;
        if !goes_on {
            break;
        }
    }
    left
}

/// The larger one, a NaN if one of them is.
pub(super) fn larger(a: f64, b: f64) -> f64 {
    if a >= b || a.is_nan() { a } else { b }
}
