//! The matrices that an attempt iterates with: how old they are, and when they are made anew.

use super::counted::Counted;
use super::iteration::Failure;
use super::residuals::Residuals;
use super::segment::Segment;
use super::simplification::Simplification;
use super::stages::{Stages, Step};
use super::stepper::add_scaled;

/// Age of the linearization.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Linearization {
    /// There is none.
    None,
    /// Of the start of an earlier step.
    Old,
    /// Of the predicted middle of this step, or of one that it takes the place of.
    Predicted,
    /// Of the start of this step.
    Current,
}

/// Where in a step it is linearized.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Place {
    /// Its start.
    Start,
    /// Its predicted middle.
    Middle,
}

/// Growth of the step beyond which a linearization is not believed any more, however small corrections are. Large forces and
/// accelerations of a transient make it large; kept when they are gone, it would leave corrections so small that nothing
/// seems to be left to correct.
const MOST_GROWTH: f64 = 10.0;

/// Linearization and factors that a stepper has.
#[derive(Debug, Clone, Copy)]
pub(super) struct Matrices {
    linearization: Linearization,
    /// Step that it was made for.
    reach: f64,
    /// Steps that it has served.
    pub(super) served: u32,
    /// Step of the last factorization.
    factored: Option<f64>,
    simplification: Simplification,
    residuals: Residuals,
}

/// The middle of a step as the step before predicts it.
#[derive(Debug, Clone)]
pub(super) struct Ahead {
    w: Vec<f64>,
    slope: Vec<f64>,
}

impl Ahead {
    pub(super) fn new(dimension: usize) -> Self {
        Self { w: vec![0.0; dimension], slope: vec![0.0; dimension] }
    }

    /// Continues the step before into `step`; whether the system could be linearized there.
    fn linearize(&mut self, ode: &mut Counted<'_>, before: &Segment, step: &Step<'_>) -> bool {
        before.continue_by(0.5 * step.h, &mut self.w);
        before.slope_beyond(0.5 * step.h, &mut self.slope);
        add_scaled(&mut self.w, 1.0, step.w);
        ode.linearize_ahead(step.t + 0.5 * step.h, &self.w, &self.slope).is_ok()
    }
}

impl Matrices {
    /// None yet, and nothing is known of what they may be.
    pub(super) const NONE: Self = Self {
        linearization: Linearization::None,
        reach: 0.0,
        served: 0,
        factored: None,
        simplification: Simplification::START,
        residuals: Residuals::START,
    };

    /// Those there are hold no longer.
    pub(super) fn forget(&mut self) {
        let Self { simplification, residuals, .. } = *self;
        *self = Self { simplification, residuals, ..Self::NONE };
    }

    /// There are now those of another moment, factored for steps of length h.
    pub(super) fn take(&mut self, h: f64) {
        (self.linearization, self.served) = (Linearization::Old, 0);
        (self.reach, self.factored) = (h, Some(h));
    }

    /// An attempt begins.
    pub(super) fn begin(&mut self, ode: &mut Counted<'_>) {
        if ode.has_accelerations() {
            self.residuals.begin();
            ode.take_accelerations(self.residuals.are_accelerations());
        }
    }

    /// Iterations converged with this factor; 0 where none was seen. Where the linearization is old that says
    /// nothing of what was left out.
    pub(super) fn observe(&mut self, ode: &mut Counted<'_>, contraction: f64) {
        self.residuals.converge();
        let tells = self.linearization != Linearization::Old && ode.is_simplified();
        if tells && self.simplification.observe(contraction) {
            self.complete(ode);
        }
    }

    /// After iterations have failed: whether another linearization may serve better, and if so whether it is to be where the last
    /// one was, or at the start of the step. With one from there, `others` may be tried for residuals.
    pub(super) fn remedy(&mut self, ode: &mut Counted<'_>, others: bool) -> Option<Place> {
        let last = self.linearization;
        // An old one says nothing of what was left out.
        if last != Linearization::Old && self.complete_after_failure(ode) {
            let ahead = last == Linearization::Predicted;
            return Some(if ahead { Place::Middle } else { Place::Start });
        }
        if matches!(last, Linearization::Old | Linearization::Predicted) {
            return Some(Place::Start);
        }
        let again = others && ode.has_accelerations() && self.residuals.fail();
        ode.take_accelerations(self.residuals.are_accelerations());
        again.then_some(Place::Start)
    }

    /// Whether it is a simplified matrix that fails, in whose place comes the full one.
    fn complete_after_failure(&mut self, ode: &mut Counted<'_>) -> bool {
        let simplified = ode.is_simplified();
        if simplified {
            self.simplification.end();
            self.complete(ode);
        }
        simplified
    }

    fn complete(&mut self, ode: &mut Counted<'_>) {
        ode.statistics.changes_to_full += 1;
        self.forget();
    }

    /// The start of the step that they belong to is past.
    pub(super) fn grow_old(&mut self) {
        if self.linearization != Linearization::None {
            self.linearization = Linearization::Old;
            self.served += 1;
        }
    }

    /// What the next linearization is.
    fn simplify(&mut self, ode: &mut Counted<'_>) {
        ode.simplify(self.simplification.begin());
    }

    /// Makes what is missing for a step; with `reuse` an old linearization serves. A new one is made in the
    /// middle of the step where `ahead` can be evaluated, otherwise at its start.
    pub(super) fn prepare<S: Stages>(
        &mut self,
        stages: &mut S,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        reuse: bool,
        ahead: Option<(&mut Ahead, &Segment)>,
    ) -> Result<(), Failure> {
        let reuse = reuse && step.h <= MOST_GROWTH * self.reach;
        let fresh = match self.linearization {
            Linearization::Current => true,
            // Of a rejected attempt, whose middle is not far from the one of this.
            Linearization::Predicted => ahead.is_some() || reuse,
            Linearization::Old => reuse,
            Linearization::None => false,
        };
        // The full matrix has served its term: the simplified one is tried again.
        let returns = self.factored != Some(step.h) && self.simplification.is_over();
        if !fresh || returns {
            self.forget();
            self.reach = step.h;
            self.simplify(ode);
            let made = ahead.is_some_and(|(ahead, before)| ahead.linearize(ode, before, step));
            self.linearization = if made {
                Linearization::Predicted
            } else {
                stages.linearize(ode, step)?;
                Linearization::Current
            };
        }
        if self.factored != Some(step.h) {
            self.factored = None;
            self.simplification.serve();
            let mut factored = stages.factor(ode, step.h);
            if factored.is_err() {
                // At the start, where the matrix may choose another order of elimination.
                if self.complete_after_failure(ode) {
                    self.reach = step.h;
                    self.simplify(ode);
                    self.simplification.serve();
                }
                stages.linearize(ode, step)?;
                (self.linearization, self.served) = (Linearization::Current, 0);
                factored = stages.factor(ode, step.h);
            }
            factored.map_err(Failure::singular)?;
            self.factored = Some(step.h);
        }
        Ok(())
    }
}
