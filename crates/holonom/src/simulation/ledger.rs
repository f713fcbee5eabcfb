//! Energy bookkeeping along a run. Equations: `docs/theory/simulation.md` (3), (3a), (3b).

use crate::system::{EnergyBalance, Ledger};
use serde::{Deserialize, Serialize};

/// Powers at start, middle and end of a step and their integral by Simpson's rule.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct StepPowers {
    /// (dissipated, supplied) at θ = 0, ½, 1, W.
    pub(super) at: [[f64; 2]; 3],
}

pub(super) fn powers(energy: &EnergyBalance) -> [f64; 2] {
    [energy.dissipated, energy.supplied]
}

impl StepPowers {
    /// ∫ from 0 to θ of the parabola through the three values, times the step h: exact for cubics
    /// at θ = 1.
    pub(super) fn advance(&self, ledger: &Ledger, h: f64, theta: f64) -> Ledger {
        let integral = |k: usize| {
            let [a, m, b] = [self.at[0][k], self.at[1][k], self.at[2][k]];
            let (slope, curve) = (-3.0 * a + 4.0 * m - b, 2.0 * a - 4.0 * m + 2.0 * b);
            h * theta * (a + theta * (slope / 2.0 + theta * curve / 3.0))
        };
        Ledger {
            initial: ledger.initial,
            dissipated: ledger.dissipated + integral(0),
            supplied: ledger.supplied + integral(1),
        }
    }
}

/// The energy ledger of steps whose powers no error tells, without unknowns or where drivers move something past a knot: by
/// Boole's rule, with Simpson's to compare it with.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Quadrature {
    /// The largest powers so far, W.
    largest: [f64; 2],
}

impl Quadrature {
    /// Powers that have, as the middle ones of [`StepPowers`], the integrals of Boole's rule through these at θ = 0, ¼, ½,
    /// ¾, 1 of a step h, and how many times the tolerance Simpson's rule misses; powers below `negligible`, W, are none.
    pub(super) fn middle(
        &mut self,
        at: &[[f64; 2]; 5],
        h: f64,
        negligible: f64,
        tolerance: f64,
    ) -> ([f64; 2], f64) {
        let mut missed = 0.0f64;
        let middle = std::array::from_fn(|k| {
            let [a, q, m, r, b] = at.map(|powers| powers[k]);
            let middle = (8.0 * (q + r) + 3.0 * m - 2.0 * (a + b)) / 15.0;
            let largest = at.iter().fold(self.largest[k], |most, powers| most.max(powers[k].abs()));
            self.largest[k] = largest;
            if largest > 0.0 {
                let allowed = h * (tolerance * largest).max(negligible);
                missed = missed.max(2.0 / 3.0 * h * (middle - m).abs() / allowed);
            }
            middle
        });
        (middle, missed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: integrals in closed form
    fn booles_rule_is_exact_for_polynomials_of_degree_five_and_tells_what_simpsons_misses() {
        let p =
            |s: f64| -> f64 { 1.0 - 3.0 * s + 2.0 * s.powi(3) + 5.0 * s.powi(4) - 4.0 * s.powi(5) };
        let at = [0.0, 0.25, 0.5, 0.75, 1.0].map(|s| [p(s), 0.0]);
        let (middle, missed) = Quadrature::default().middle(&at, 0.2, 0.0, 1e-3);
        let step = StepPowers { at: [at[0], middle, at[4]] };
        let integral = step.advance(&Ledger::default(), 0.2, 1.0);
        let truth = 0.2 * (1.0 - 1.5 + 0.5 + 1.0 - 2.0 / 3.0);
        assert!((integral.dissipated - truth).abs() < 1e-15);
        assert_eq!(integral.supplied, 0.0);
        // Simpson's rule misses h f⁗/2880, here with the mean of f⁗.
        let simpson: f64 = 0.2 * (5.0 * 24.0 - 4.0 * 120.0 * 0.5) / 2880.0;
        let largest = at.iter().fold(0.0f64, |most, p| most.max(p[0].abs()));
        assert!((missed / (simpson.abs() / (0.2 * largest * 1e-3)) - 1.0).abs() < 1e-9);
    }

    #[test] // independent truth: the integral of 1 + 2s − 6s² in closed form
    fn a_parabola_is_integrated_exactly() {
        let p = |s: f64| 1.0 + 2.0 * s - 6.0 * s * s;
        let step = StepPowers { at: [[p(0.0), 0.0], [p(0.5), 0.0], [p(1.0), 0.0]] };
        for theta in [0.3, 0.5, 1.0f64] {
            let expected = 2.0 * (theta + theta.powi(2) - 2.0 * theta.powi(3));
            let found = step.advance(&Ledger::default(), 2.0, theta).dissipated;
            assert!((found - expected).abs() < 1e-14);
        }
    }
}
