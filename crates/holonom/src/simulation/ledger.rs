//! Energy bookkeeping along a run. Equations: `docs/theory/simulation.md` (3), (3a), (3b), (3e).

use crate::system::{EnergyBalance, Ledger};
use serde::{Deserialize, Serialize};

/// Moments θ inside a step at which powers are taken where drivers move; elsewhere only in the middle.
pub(super) const QUARTERS: [f64; 3] = [0.25, 0.5, 0.75];

/// Powers along a step, and their integral.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct StepPowers {
    /// (dissipated, supplied) at θ = 0, ¼, ½, ¾, 1, W.
    pub(super) at: [[f64; 2]; 5],
}

pub(super) fn powers(energy: &EnergyBalance) -> [f64; 2] {
    [energy.dissipated, energy.supplied]
}

impl StepPowers {
    /// Powers from one end of a step to the other, through those `inside`: at all [`QUARTERS`], in the middle, or none. What
    /// is not known is that of a parabola or a line.
    pub(super) fn through(start: [f64; 2], inside: &[[f64; 2]], end: [f64; 2]) -> Self {
        let among = |theta: f64, middle: [f64; 2]| -> [f64; 2] {
            std::array::from_fn(|k| {
                let [a, m, b] = [start[k], middle[k], end[k]];
                let (slope, curve) = (-3.0 * a + 4.0 * m - b, 2.0 * a - 4.0 * m + 2.0 * b);
                a + theta * (slope + theta * curve)
            })
        };
        let [q, m, r] = match *inside {
            [q, m, r] => [q, m, r],
            [m, ..] => [among(0.25, m), m, among(0.75, m)],
            [] => {
                let m = std::array::from_fn(|k| 0.5 * (start[k] + end[k]));
                [among(0.25, m), m, among(0.75, m)]
            }
        };
        Self { at: [start, q, m, r, end] }
    }

    /// Means by Boole's rule, W.
    pub(super) fn mean(&self) -> [f64; 2] {
        let mean = self.advance(&Ledger::default(), 1.0, 1.0);
        [mean.dissipated, mean.supplied]
    }

    /// Moves the powers inside the step alike, so that they have these means.
    pub(super) fn set_mean(&mut self, means: [f64; 2]) {
        let own = self.mean();
        for powers in &mut self.at[1..4] {
            for k in 0..2 {
                powers[k] += 90.0 / 76.0 * (means[k] - own[k]);
            }
        }
    }

    /// By how much the mean of a power by Simpson's rule differs from that by Boole's, W.
    fn differs(&self, k: usize) -> f64 {
        let [a, q, m, r, b] = self.at.map(|powers| powers[k]);
        4.0 / 45.0 * (a - 4.0 * q + 6.0 * m - 4.0 * r + b)
    }

    /// ∫ from 0 to θ of the quartic through the five values, times the step h: at θ = 1 Boole's rule, exact for degree
    /// five.
    pub(super) fn advance(&self, ledger: &Ledger, h: f64, theta: f64) -> Ledger {
        // ∫ of Newton's polynomials s (s − 1) … (s − k + 1)/k! from 0 to s = 4θ, divided by s.
        let s = 4.0 * theta;
        let weights = [
            1.0,
            s / 2.0,
            s * (s / 6.0 - 1.0 / 4.0),
            s * (s * (s / 24.0 - 1.0 / 6.0) + 1.0 / 6.0),
            s * (s * (s * (s / 120.0 - 1.0 / 16.0) + 11.0 / 72.0) - 1.0 / 8.0),
        ];
        let integral = |k: usize| {
            let mut differences = self.at.map(|powers| powers[k]);
            let mut sum = 0.0;
            for (order, weight) in weights.into_iter().enumerate() {
                sum += weight * differences[0];
                for i in 0..4 - order {
                    differences[i] = differences[i + 1] - differences[i];
                }
            }
            h * theta * sum
        };
        Ledger {
            initial: ledger.initial,
            dissipated: ledger.dissipated + integral(0),
            supplied: ledger.supplied + integral(1),
        }
    }
}

/// Means by Boole's rule in parts of four of moments in equal distances, W.
pub(super) fn mean_of_parts(moments: &[[f64; 2]]) -> [f64; 2] {
    let parts = (moments.len() - 1) / 4;
    let mut sum = [0.0; 2];
    for part in 0..parts {
        let mean = StepPowers { at: std::array::from_fn(|k| moments[4 * part + k]) }.mean();
        sum = std::array::from_fn(|k| sum[k] + mean[k]);
    }
    sum.map(|x| x / parts as f64)
}

/// Twice what was looked for in vain is not looked for again; this part of that limit is left after each step.
const FORGOTTEN: f64 = 0.95;

/// How many tolerances of a power Simpson's rule may miss of what the longest steps let drivers do:
/// [`step_length::driven`](super::step_length::driven).
pub(super) const WAVES: f64 = 10.0;

/// How well the energy ledger follows powers that no error tells, by what Simpson's rule differs from Boole's.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub(super) struct Quadrature {
    /// The largest powers so far, W.
    largest: [f64; 2],
    /// Those that were believed.
    seen: [f64; 2],
    /// What may be missing after a step without being looked for, J: some was, in vain.
    #[serde(default)]
    unexplained: f64,
}

impl Quadrature {
    /// Whether what is missing after a step, J, is to be looked for.
    pub(super) fn is_to_be_found(&mut self, missing: f64) -> bool {
        self.unexplained *= FORGOTTEN;
        missing > self.unexplained
    }

    /// It was not found.
    pub(super) fn give_up(&mut self, missing: f64) {
        self.unexplained = 2.0 * missing;
    }

    /// Powers along a step, as [`StepPowers::through`] gives them. At quarters they are believed up to twice what drivers make
    /// of them: what is stiff, which only implicit codes step over, makes much of the error of a state inside a step.
    pub(super) fn along(
        &mut self,
        [start, end]: [[f64; 2]; 2],
        inside: &[[f64; 2]],
        tolerance: f64,
    ) -> StepPowers {
        let step = StepPowers::through(start, inside, end);
        let largest = |seen: [f64; 2], step: &StepPowers| -> [f64; 2] {
            let all = step.at.iter();
            all.fold(seen, |seen, powers| std::array::from_fn(|k| seen[k].max(powers[k].abs())))
        };
        let allowed = largest(self.seen, &step).map(|power| 2.0 * WAVES * tolerance * power);
        let believed = (0..2).all(|k| step.differs(k).abs() <= allowed[k]);
        let step = if believed { step } else { StepPowers::through(start, &[step.at[2]], end) };
        self.seen = largest(self.seen, &step);
        step
    }

    /// How many times the tolerance Simpson's rule misses in a step; powers below `negligible`, W, are none.
    pub(super) fn missed(&mut self, step: &StepPowers, negligible: f64, tolerance: f64) -> f64 {
        let mut missed = 0.0f64;
        for k in 0..2 {
            let largest =
                step.at.iter().fold(self.largest[k], |most, powers| most.max(powers[k].abs()));
            self.largest[k] = largest;
            if largest > 0.0 {
                missed = missed.max(step.differs(k).abs() / (tolerance * largest).max(negligible));
            }
        }
        missed
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
        let step = StepPowers::through(at[0], &at[1..4], at[4]);
        let integral = step.advance(&Ledger::default(), 0.2, 1.0);
        let truth = 0.2 * (1.0 - 1.5 + 0.5 + 1.0 - 2.0 / 3.0);
        assert!((integral.dissipated - truth).abs() < 1e-15);
        assert_eq!(integral.supplied, 0.0);
        // Simpson's rule misses h f⁗/2880, here with the mean of f⁗.
        let simpson: f64 = 0.2 * (5.0 * 24.0 - 4.0 * 120.0 * 0.5) / 2880.0;
        let largest = at.iter().fold(0.0f64, |most, p| most.max(p[0].abs()));
        let missed = Quadrature::default().missed(&step, 0.0, 1e-3);
        assert!((missed / (simpson.abs() / (0.2 * largest * 1e-3)) - 1.0).abs() < 1e-9);
    }

    #[test] // truth: the mean asked for, and the ends as they were
    fn means_are_set_without_moving_the_ends() {
        let ends = [[1.0, -2.0], [3.0, 5.0]];
        let mut step = StepPowers::through(ends[0], &[[2.0, 0.5]], ends[1]);
        step.set_mean([7.0, -1.0]);
        let [dissipated, supplied] = step.mean();
        assert!((dissipated - 7.0).abs() < 1e-14 && (supplied + 1.0).abs() < 1e-14);
        assert_eq!([step.at[0], step.at[4]], ends);
    }

    #[test] // independent truth: the integral of 1 + 2s − 6s² + s³ − 3s⁴ in closed form
    fn a_quartic_is_integrated_exactly_to_any_part_of_the_step() {
        let p = |s: f64| 1.0 + s * (2.0 + s * (-6.0 + s * (1.0 - 3.0 * s)));
        let [a, q, m, r, b] = [0.0, 0.25, 0.5, 0.75, 1.0].map(|s| [p(s), 2.0 * p(s)]);
        let step = StepPowers::through(a, &[q, m, r], b);
        for theta in [0.0, 0.1, 0.3, 0.5, 0.9, 1.0f64] {
            let terms = [1.0, 1.0, -2.0, 0.25, -0.6].into_iter().zip(1..);
            let expected = 2.0 * terms.map(|(c, k)| c * theta.powi(k)).sum::<f64>();
            let found = step.advance(&Ledger::default(), 2.0, theta);
            assert!((found.dissipated - expected).abs() < 1e-14, "{theta}");
            assert!((found.supplied - 2.0 * expected).abs() < 1e-14, "{theta}");
        }
    }

    #[test] // truth: a wave of 2 rad in a step is what drivers may do at 1e-3, a spike at a quarter is not
    fn quarters_are_believed_as_far_as_drivers_explain_them() {
        let wave = [0.0, 0.25, 0.5, 0.75, 1.0].map(|s: f64| [(2.0 * s).cos(), 0.0]);
        let ends = [wave[0], wave[4]];
        let mut quadrature = Quadrature::default();
        assert_eq!(quadrature.along(ends, &wave[1..4], 1e-3).at, wave);
        let spiked = [[5.0, 0.0], wave[2], wave[3]];
        let parabola = StepPowers::through(wave[0], &wave[2..3], wave[4]);
        assert_eq!(quadrature.along(ends, &spiked, 1e-3), parabola);
    }

    #[test] // independent truth: the integrals of 1 + 2s − 6s² and of 1 − 4s in closed form
    fn a_parabola_is_integrated_exactly_by_its_middle_and_a_line_by_its_ends() {
        let parabola = |s: f64| [1.0 + 2.0 * s - 6.0 * s * s, 0.0];
        let line = |s: f64| [1.0 - 4.0 * s, 0.0];
        let bent = StepPowers::through(parabola(0.0), &[parabola(0.5)], parabola(1.0));
        let straight = StepPowers::through(line(0.0), &[], line(1.0));
        for theta in [0.3, 0.5, 1.0f64] {
            let expected = 2.0 * (theta + theta.powi(2) - 2.0 * theta.powi(3));
            let found = bent.advance(&Ledger::default(), 2.0, theta).dissipated;
            assert!((found - expected).abs() < 1e-14);
            let expected = 2.0 * (theta - 2.0 * theta.powi(2));
            let found = straight.advance(&Ledger::default(), 2.0, theta).dissipated;
            assert!((found - expected).abs() < 1e-14);
        }
    }
}
