//! Newton iterations of one attempt: what they start from, their judgement and bookkeeping.

use super::ode::EvaluationFailure;
use super::segment::Segment;
use super::stepper::{Rejection, StepReport};
use crate::control::{IterationVerdict, NewtonControl, NewtonMonitor};

/// Systems of stages that are solved one after the other, at most.
pub(super) const MAX_SYSTEMS: usize = 5;

/// Why an attempt has no end to judge, and the ratio of the next attempt to it.
#[derive(Debug, Clone, PartialEq)]
pub struct Failure {
    pub(super) cause: Rejection,
    pub(super) ratio: f64,
}

impl Failure {
    /// The matrices of the step could not be factored.
    pub(super) fn singular(failure: EvaluationFailure) -> Self {
        Self { cause: Rejection::SingularMatrix(failure), ratio: 0.5 }
    }

    /// Whether an iteration did not converge.
    pub(super) fn is_of_newton(&self) -> bool {
        matches!(self.cause, Rejection::NewtonDivergence | Rejection::NewtonSlow)
    }
}

impl From<EvaluationFailure> for Failure {
    fn from(failure: EvaluationFailure) -> Self {
        Self { cause: Rejection::Evaluation(failure), ratio: 0.5 }
    }
}

/// The iterations of one attempt.
pub struct Iteration<'a> {
    /// The step before, where it may predict this one.
    pub(super) before: Option<&'a Segment>,
    pub(super) control: NewtonControl,
    /// Weighted norm of round-off in w₀.
    pub(super) floor: f64,
    /// η per system, kept from step to step.
    pub(super) eta: &'a mut [f64; MAX_SYSTEMS],
    /// The last correction.
    pub(super) change: &'a mut [f64],
    pub(super) report: &'a mut StepReport,
}

impl Iteration<'_> {
    /// Corrects system `i` until the iteration has converged or failed, and returns the number of
    /// corrections. It starts from what is `foreseen` of it, or from nothing. `correct` makes one, writes it and returns
    /// its weighted norm, which reaches the end of the step `effect` times as large.
    pub(super) fn converge(
        &mut self,
        i: usize,
        effect: f64,
        foreseen: bool,
        mut correct: impl FnMut(&mut [f64]) -> Result<f64, EvaluationFailure>,
    ) -> Result<u32, Failure> {
        let mut monitor =
            NewtonMonitor::start(self.control, self.eta[i], effect * self.floor, foreseen);
        let verdict = loop {
            let norm = correct(self.change).inspect_err(|_| self.eta[i] = 1.0)?;
            self.report.iterations += 1;
            let verdict = monitor.observe(effect * norm);
            if verdict != IterationVerdict::Continue {
                break verdict;
            }
        };
        self.eta[i] = monitor.eta();
        let seen = monitor.contraction();
        self.report.contraction = self.report.contraction.max(seen.unwrap_or(0.0));
        if let (IterationVerdict::Converged, Some(theta)) = (verdict, seen) {
            self.report.contractions.observe(theta);
        }
        match verdict {
            IterationVerdict::Slow { ratio } => {
                Err(Failure { cause: Rejection::NewtonSlow, ratio })
            }
            IterationVerdict::Diverged => {
                self.eta.fill(1.0);
                Err(Failure { cause: Rejection::NewtonDivergence, ratio: 0.5 })
            }
            IterationVerdict::Converged | IterationVerdict::Continue => Ok(monitor.iterations()),
        }
    }
}
