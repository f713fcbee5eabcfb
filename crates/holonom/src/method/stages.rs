//! What a family of implicit formulas is to the shell that all of them share.

use super::counted::Counted;
use super::iteration::{Failure, Iteration};
use super::ode::EvaluationFailure;
use super::segment::Segment;
use super::stepper::{StepEnd, add_scaled};
use std::fmt::Debug;

/// A step to be tried: from (t, w) with slope g over h.
#[derive(Debug, Clone, Copy)]
pub struct Step<'a> {
    pub(super) t: f64,
    pub(super) h: f64,
    pub(super) w: &'a [f64],
    pub(super) g: &'a [f64],
    /// Its length cannot be changed.
    pub(super) is_fixed: bool,
}

impl Step<'_> {
    /// What w changes by until c h is foreseen to be: the step `before`, continued, or else constant rates of `n` positions, which
    /// turns take around but no vibration anywhere. A step that cannot be made shorter starts from nothing instead, its last resort.
    pub(super) fn predict(&self, c: f64, n: usize, before: Option<&Segment>, change: &mut [f64]) {
        if let Some(before) = before {
            before.continue_by(c * self.h, change);
        } else {
            change.fill(0.0);
            let n = if self.is_fixed { 0 } else { n };
            add_scaled(&mut change[..n], c * self.h, &self.w[n..2 * n]);
        }
    }
}

/// x ← (I − F)² x, `filter` multiplying by F = (I − γhJ)⁻¹: what follows forces stays, and next to nothing of what is smooth. Source:
/// `docs/theory/method.md` (14).
pub(super) fn keep_stiff(x: &mut [f64], filtered: &mut [f64], mut filter: impl FnMut(&mut [f64])) {
    for _ in 0..2 {
        filtered.copy_from_slice(x);
        filter(filtered);
        add_scaled(x, -1.0, filtered);
    }
}

/// The stages of an implicit formula and its buffers.
///
/// The shell, [`super::attempt::ImplicitStepper`], calls `linearize`, `factor`, `iterate`, `estimate` and, for
/// an accepted step, `finish`, each when those before have succeeded. In place of `linearize`, where stages are
/// iterated, it may linearize the system itself in the middle of the step.
pub trait Stages: Debug + Send {
    /// Degree of the dense output.
    const DEGREE: usize;
    /// The part of an error that its filter leaves at least, for formulas whose errors on stiff
    /// components do not vanish as the filtered estimate does.
    const LEAST_FILTERED: Option<f64> = None;
    /// Whether stages that cannot be evaluated are tried again as those that do not converge are:
    /// with a fresh linearization.
    const REPEATS_EVALUATIONS: bool = false;

    /// Whether stages are iterated: the matrix decides how fast, not what is found.
    const ITERATES: bool = true;

    /// Order of the formula.
    fn order(&self) -> u32;

    /// Order of the embedded solution.
    fn embedded_order(&self) -> u32;

    /// Linearizes at the start of the step, where nothing better is known.
    ///
    /// # Errors
    /// When the system cannot be evaluated there.
    fn linearize(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<(), EvaluationFailure> {
        ode.linearize(step.t, step.w)
    }

    /// Factors the matrices of a step of length h.
    ///
    /// # Errors
    /// When one is singular.
    fn factor(&mut self, ode: &mut Counted<'_>, h: f64) -> Result<(), EvaluationFailure>;

    /// Predicts and solves all stages. Returns the iterations of the last one; 1 where none are made.
    ///
    /// # Errors
    /// When an iteration fails or the system cannot be evaluated.
    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        iteration: &mut Iteration<'_>,
    ) -> Result<u32, Failure>;

    /// Finds the end of the step and estimates its error, not yet filtered.
    ///
    /// # Errors
    /// When the system cannot be evaluated at the end, where that is tried.
    fn estimate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> Result<(), EvaluationFailure>;

    /// Error against estimate where a law passes a knot within the step.
    fn error_at_kinks(&self) -> f64 {
        1.0
    }

    /// Places θ at which the dense output satisfies the equations, the last one the end of the step; none where it need not.
    fn collocation_places(&self) -> Option<&'static [f64; 3]> {
        None
    }

    /// Places within the step where the dense output is in balance, as far as it is stiff, ascending.
    fn balanced_places(&self) -> &[f64] {
        &[]
    }

    /// Whether rates of the dense output are lines.
    fn rates_are_lines(&self) -> bool {
        false
    }

    /// γ of the matrix.
    fn gamma(&self) -> f64;

    /// Multiplies an error by (I − γhJ)⁻¹.
    fn filter(&mut self, ode: &mut Counted<'_>, error: &mut [f64]) {
        ode.solve(error);
    }

    /// Turns the filtered `error` into an estimate in which transients of the step's start count for
    /// less, to be filtered once more; false if there is none. As it stands it is one.
    fn estimate_again(
        &mut self,
        _ode: &mut Counted<'_>,
        _step: &Step<'_>,
        _error: &mut [f64],
    ) -> bool {
        true
    }

    /// After `estimate`: how far from balance stiff components are at the end; false where the formula leaves them in it.
    fn imbalance(&mut self, _ode: &mut Counted<'_>, _step: &Step<'_>, _error: &mut [f64]) -> bool {
        false
    }

    /// After `estimate`: finds the error that the formula itself leaves at the end of a step of length h; false where it cannot tell.
    fn own_error(&mut self, _ode: &mut Counted<'_>, _h: f64, _error: &mut [f64]) -> bool {
        false
    }

    /// After `finish`, where stages are not iterated: what the equations' slope at the end has beyond that of the step, times γh.
    fn end_defect(&mut self, _ode: &Counted<'_>, _step: &Step<'_>, _defect: &mut [f64]) {}

    /// The end of the step, after `estimate`; its slope after `finish`.
    fn end(&self) -> StepEnd<'_>;

    /// Makes the slope at the end and the dense output of an accepted step.
    fn finish(&mut self, ode: &mut Counted<'_>, step: &Step<'_>, segment: &mut Segment);

    /// After `own_error` and `finish`, where the former can tell: leads what is stiff of the dense output through stages less their
    /// errors, if it is more than a tolerance off anywhere, and finds how far off it is `left` between them. Source: `docs/theory/method.md` (14).
    fn correct_inside(&mut self, _ode: &mut Counted<'_>, _output: &mut Segment, _left: &mut [f64]) {
    }

    /// The end of the accepted step becomes the start of the next one.
    fn commit(&mut self) {}

    /// The meaning of w has changed.
    fn invalidate(&mut self) {}

    /// What came before does not continue.
    fn restart(&mut self) {}
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: what moves by 3 and −2 m/s for 0.2 of half a second
    fn what_nothing_foresees_goes_on_at_constant_rates() {
        let (w, g) = ([7.0, 8.0, 3.0, -2.0, 5.0], [9.0; 5]);
        let predicted = |is_fixed: bool| {
            let mut change = [f64::NAN; 5];
            Step { t: 0.0, h: 0.5, w: &w, g: &g, is_fixed }.predict(0.2, 2, None, &mut change);
            change
        };
        let expected = [0.3, -0.2, 0.0, 0.0, 0.0];
        for (found, expected) in predicted(false).iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} instead of {expected}");
        }
        assert_eq!(predicted(true), [0.0; 5], "a step that cannot be made shorter");
    }
}
