//! Accelerations at the start of a step of formulas in second-order form.

use super::counted::Counted;
use super::ode::EvaluationFailure;
use super::stages::Step;

/// Where the accelerations of the step's start come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Source {
    /// From the equations at the linearization point.
    Evaluated,
    /// From the end of the last step, as the formula left them: evaluating them anew would multiply
    /// what is left of the iteration error by the stiffness.
    Continued,
}

/// The start of a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    source: Source,
    /// The accelerations are at hand, in the present parametrization.
    known: bool,
    /// The system has to be told that the end of the last step is the start of this one.
    advance: bool,
}

impl Start {
    /// Nothing comes before.
    pub(super) const FIRST: Self = Self { source: Source::Evaluated, known: false, advance: false };

    /// The end of the last step has become the start.
    pub(super) fn commit(&mut self) {
        *self = Self { source: Source::Continued, known: false, advance: true };
    }

    /// The meaning of w has changed.
    pub(super) fn invalidate(&mut self) {
        self.known = false;
    }

    /// What came before does not continue.
    pub(super) fn restart(&mut self) {
        self.source = Source::Evaluated;
    }

    /// Unknown and slopes (v̇, v̈, ż) at the start of the step; the linearization must be there.
    pub(super) fn find(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        x: &mut [f64],
        slopes: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = ode.second_order_split();
        let system = ode.second_order()?;
        if std::mem::take(&mut self.advance) {
            system.start_step();
        }
        if std::mem::replace(&mut self.known, true) {
            return Ok(());
        }
        match self.source {
            Source::Evaluated => {
                system.linearized_unknown(x);
                slopes[2 * ndof..].copy_from_slice(&step.g[2 * ndof..]);
            }
            Source::Continued => system.start_unknown(x),
        }
        slopes[..ndof].copy_from_slice(&step.w[ndof..2 * ndof]);
        system.acceleration(x, &mut slopes[ndof..2 * ndof]);
        Ok(())
    }
}
