//! Energy bookkeeping along a run.

use crate::system::{EnergyBalance, Ledger};

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

#[cfg(test)]
mod tests {
    use super::*;

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
