//! What a formula leaves where the slope of what it integrates has a kink within the step.

/// Places of the kink that stand for all.
const PLACES: u32 = 1000;

/// The error of a Runge-Kutta formula with abscissas `c` and weights `b` against its estimate with weights `error`, where
/// the derivative of a slope jumps within the step: root mean squares over the places of the jump.
///
/// ```text
/// error    Σ bᵢ (cᵢ − θ)₊ − ½ (1 − θ)²        estimate    Σ eᵢ (cᵢ − θ)₊        0 < θ < 1
/// ```
///
/// Both are of order 2 there, whatever their orders are. Source: `docs/theory/formula.md` (17).
pub fn error_at_kinks(c: &[f64], b: &[f64], error: &[f64]) -> f64 {
    estimated_at_kinks(c, b, |sum| sum(error))
}

/// The same for an `estimate` that is made of sums Σ eᵢ (cᵢ − θ)₊ with weights eᵢ.
pub(super) fn estimated_at_kinks(
    c: &[f64],
    b: &[f64],
    estimate: impl Fn(&dyn Fn(&[f64]) -> f64) -> f64,
) -> f64 {
    let mut squares = [0.0; 2];
    for place in 0..PLACES {
        let theta = (f64::from(place) + 0.5) / f64::from(PLACES);
        let sum = |weights: &[f64]| -> f64 {
            c.iter().zip(weights).map(|(c, weight)| weight * (c - theta).max(0.0)).sum()
        };
        squares[0] += (sum(b) - 0.5 * (1.0 - theta).powi(2)).powi(2);
        squares[1] += estimate(&sum).powi(2);
    }
    (squares[0] / squares[1]).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::{DOP853, DOPRI5, ExplicitRungeKutta};

    #[test] // truth: ½ θ (1 − θ) against ½ (1 − θ), whose squares have the integrals 1/120 and 1/12
    fn the_trapezoidal_rule_leaves_less_than_euler_says() {
        let ratio = error_at_kinks(&[0.0, 1.0], &[0.5, 0.5], &[-0.5, 0.5]);
        assert!((ratio - 0.1_f64.sqrt()).abs() < 1e-6, "{ratio}");
    }

    #[test] // truth: steps over the kink of ẏ = max(0, t − θ), by the stages as they are
    fn dormand_and_prince_leave_many_times_their_estimate() {
        for (formula, expected) in [(DOPRI5, 13.0..14.0), (DOP853, 3.0..3.1)] {
            let mut squares = [0.0; 2];
            for k in 0..97 {
                let theta = (f64::from(k) + 0.5) / 97.0;
                let along = |weights: &[f64]| -> f64 {
                    weights.iter().zip(formula.c).map(|(w, c)| w * (c - theta).max(0.0)).sum()
                };
                squares[0] += (along(formula.weights()) - (1.0 - theta).powi(2) / 2.0).powi(2);
                let (estimate, lower) = (along(formula.e), formula.lower.map_or(0.0, along));
                squares[1] += (ExplicitRungeKutta::part(estimate, lower) * estimate).powi(2);
            }
            let found = formula.error_at_kinks();
            assert!((found * found / (squares[0] / squares[1]) - 1.0).abs() < 0.02, "{found}");
            assert!(expected.contains(&found), "{}: {found}", formula.name);
        }
    }
}
