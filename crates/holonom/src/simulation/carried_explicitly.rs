//! Errors of steps of explicit formulas, which have no matrix of their own, carried along. Equations:
//! `docs/theory/simulation.md` (13).

use super::carried_error::{Carried, CarriedError};
use crate::method::StateSpace;
use serde::{Deserialize, Serialize};

/// Evaluations of an explicit formula after which a matrix is made at the latest: it costs as much as some of them.
pub(super) const MOST_EVALUATIONS: u64 = 6;
/// Steps that may wait for a matrix in what is stored: runs before let that many.
pub(super) const MOST_WAITING: u64 = 20;
/// Part of the mean length of the steps that a matrix is to serve from which a step is of another kind.
const SHORTER: f64 = 0.5;
/// Growth of the error over these steps that a matrix is good for.
const GROWTH: f64 = 2.0;

/// The steps of an explicit formula since the last matrix.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Serving {
    pub(super) steps: u64,
    /// s
    pub(super) span: f64,
    /// Steps after which the next matrix is due.
    pub(super) most: u64,
    /// Whether the last matrix is one of the present equations and variables.
    pub(super) known: bool,
}

impl Serving {
    pub(super) const NEW: Self = Self { steps: 0, span: 0.0, most: 1, known: false };
}

impl CarriedError {
    /// Where a step of an explicit formula is much shorter than those that wait for a matrix, what makes it short was not
    /// there before: they get the matrix of their time.
    pub(super) fn part_with_longer_steps(
        &mut self,
        form: &mut dyn StateSpace,
        power: &mut [f64],
        step: f64,
    ) {
        let Serving { steps, span, known, .. } = self.serving;
        let abrupt = known && steps > 0 && step < SHORTER * span / steps as f64;
        // Where the matrix cannot be factored for them, they go on waiting.
        if abrupt && self.carry_over(form, power, (steps, span)).is_some() {
            self.serving = Serving { known: true, ..Serving::NEW };
        }
    }

    /// Carries it over the steps of an explicit formula that there is no matrix for yet, if they are many enough; false
    /// where that cannot be done. Source: `docs/theory/simulation.md` (13).
    pub(super) fn carry_if_due(
        &mut self,
        evaluations: u64,
        form: &mut dyn StateSpace,
        power: &mut [f64],
        (t, step, w): (f64, f64, &[f64]),
    ) -> bool {
        let largest = (MOST_EVALUATIONS / evaluations).max(1);
        let Serving { steps, span, most, .. } = &mut self.serving;
        (*steps, *span) = (*steps + 1, *span + step);
        let (steps, span, most) = (*steps, *span, (*most).min(largest));
        if steps < most {
            return true;
        }
        let before = self.size(form, power, span);
        if form.linearize(t, w).is_err() || self.carry_over(form, power, (steps, span)).is_none() {
            return false;
        }
        let grows = self.size(form, power, span) > GROWTH * before;
        let next = if grows { most / 2 } else { 2 * most };
        let most = next.clamp(1, largest);
        self.serving = Serving { most, known: true, ..Serving::NEW };
        true
    }

    /// Carries it over a number of steps with the matrix at hand, if that can be factored for them.
    pub(super) fn carry_over(
        &mut self,
        form: &mut dyn StateSpace,
        power: &mut [f64],
        (steps, span): (u64, f64),
    ) -> Option<()> {
        let parts = steps.div_ceil(2);
        form.factor(0.5 * span / parts as f64).ok()?;
        self.sums.iter_mut().for_each(|sum| take_over(&mut sum.error, parts, form, power));
        Some(())
    }

    /// Of the places that it makes, in tolerances, with those that its rates make within `span`, s. `room` is for a change
    /// of w.
    fn size(&mut self, form: &mut dyn StateSpace, room: &mut [f64], span: f64) -> f64 {
        let ndof = form.second_order_split();
        let [Carried { error, spread: [places, _] }, _] = &mut self.sums;
        let mut of = |part: &[f64]| {
            room[..ndof].copy_from_slice(part);
            places.copy_from_slice(form.displace(room));
            form.weights().displacement(places)
        };
        of(&error[..ndof]) + span * of(&error[ndof..2 * ndof])
    }
}

/// (2S − 1)ⁿ of an error, with the factors at hand.
fn take_over(error: &mut [f64], parts: u64, form: &mut dyn StateSpace, power: &mut [f64]) {
    for _ in 0..parts {
        power.copy_from_slice(error);
        form.solve(power);
        for (e, s) in error.iter_mut().zip(&*power) {
            *e = 2.0 * s - *e;
        }
    }
}
