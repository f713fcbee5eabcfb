//! Errors of steps of explicit formulas, which have no matrix of their own, carried along. Equations:
//! `docs/theory/simulation.md` (13).

use super::carried_error::{Carried, CarriedError, Stepped};
use crate::method::EquationForm;
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
    /// By how many seconds both errors were ahead when the first of these steps began.
    #[serde(default)]
    pub(super) ahead: [f64; 2],
}

impl Serving {
    pub(super) const NEW: Self =
        Self { steps: 0, span: 0.0, most: 1, known: false, ahead: [0.0; 2] };
}

impl CarriedError {
    /// Where a step of an explicit formula is much shorter than those that wait for a matrix, what makes it short was not
    /// there before: they get the matrix of their time.
    pub(super) fn part_with_longer_steps(
        &mut self,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        stepped: Stepped<'_>,
    ) {
        let Serving { steps, span, known, .. } = self.serving;
        let abrupt = known && steps > 0 && stepped.step < SHORTER * span / steps as f64;
        let along = stepped.along(stepped.slopes[0]);
        // Where the matrix cannot be factored for them, they go on waiting.
        if abrupt && self.carry_over(form, power, along).is_some() {
            self.serving = Serving { known: true, ..Serving::NEW };
        }
    }

    /// Carries it over the steps of an explicit formula that there is no matrix for yet, if they are many enough; false
    /// where that cannot be done. Source: `docs/theory/simulation.md` (13).
    pub(super) fn carry_if_due(
        &mut self,
        evaluations: u64,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        stepped: Stepped<'_>,
    ) -> bool {
        let Stepped { t, step, w, slopes: [_, slope], .. } = stepped;
        let largest = (MOST_EVALUATIONS / evaluations).max(1);
        let Serving { steps, span, most, known, ahead } = &mut self.serving;
        let (known, ahead) = (*known, *ahead);
        (*steps, *span) = (*steps + 1, *span + step);
        let (span, most) = (*span, (*most).min(largest));
        if *steps < most {
            return true;
        }
        let steps = *steps;
        let before = self.size(form, power, span);
        let along = stepped.along(slope);
        self.add_along(ahead.map(|ahead| -ahead), along);
        // As far as the middle by the matrix of the start.
        let halves = known && self.take_over(form, power, steps.div_ceil(4), 0.5 * span).is_some();
        let (parts, rest) =
            if halves { (steps.div_ceil(4), 0.5 * span) } else { (steps.div_ceil(2), span) };
        if form.linearize(t, w).is_err() || self.take_over(form, power, parts, rest).is_none() {
            return false;
        }
        self.add_along(ahead, along);
        let grows = self.size(form, power, span) > GROWTH * before;
        let next = if grows { most / 2 } else { 2 * most };
        let most = next.clamp(1, largest);
        self.serving = Serving { most, known: true, ..Serving::NEW };
        true
    }

    /// Carries it over the steps that wait for a matrix with the one at hand, if that can be factored for them; what it has `along`
    /// the motion at their end is there already.
    pub(super) fn carry_over(
        &mut self,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        along: Option<&[f64]>,
    ) -> Option<()> {
        let Serving { steps, span, ahead, .. } = self.serving;
        self.add_along(ahead.map(|ahead| -ahead), along);
        let taken = self.take_over(form, power, steps.div_ceil(2), span);
        self.add_along(ahead, along);
        taken
    }

    /// (2S − 1)ⁿ of both errors with n `parts` of a span, s, by the matrix at hand; none where that cannot be factored.
    fn take_over(
        &mut self,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        parts: u64,
        span: f64,
    ) -> Option<()> {
        form.factor(0.5 * span / parts as f64).ok()?;
        for Carried { error, .. } in &mut self.sums {
            for _ in 0..parts {
                power.copy_from_slice(error);
                form.solve(power);
                for (e, s) in error.iter_mut().zip(&*power) {
                    *e = 2.0 * s - *e;
                }
            }
        }
        Some(())
    }

    /// Of the places that it makes, in tolerances, with those that its rates make within `span`, s. `room` is for a change
    /// of w.
    fn size(&mut self, form: &mut dyn EquationForm, room: &mut [f64], span: f64) -> f64 {
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
