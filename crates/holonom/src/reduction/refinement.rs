//! Iterative refinement of solutions by a matrix whose condition is the square of the one that counts.

use crate::math::vector::larger;

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

/// The largest size of a number with its weight, a NaN if one of them is: in lanes, which need not wait for each other.
pub(super) fn largest(x: &[f64], weights: &[f64], size: impl Fn(f64, f64) -> f64) -> f64 {
    let mut lanes = [0.0; 4];
    let ((x, x_rest), (weights, rest)) = (x.as_chunks::<4>(), weights.as_chunks::<4>());
    for (x, w) in x.iter().zip(weights) {
        for k in 0..4 {
            lanes[k] = larger(size(x[k], w[k]), lanes[k]);
        }
    }
    for (lane, (x, w)) in lanes.iter_mut().zip(x_rest.iter().zip(rest)) {
        *lane = larger(size(*x, *w), *lane);
    }
    lanes.into_iter().fold(0.0, larger)
}
