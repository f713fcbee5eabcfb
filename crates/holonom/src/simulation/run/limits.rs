//! What limits a step, and refuses an attempt, beside the error of its formula.

use super::Run;
use super::charts::LONGEST_TURN;
use crate::reduction::ParametrizationKind;
use crate::simulation::options::Options;
use crate::simulation::step_length;

/// Part of the step at which energies would be on tolerance, and the least of one, that follow a step of a run without unknowns.
const SAFE_PART: f64 = 0.9;
const SHORTEST_PART: f64 = 0.1;
/// The order of the rule that integrates powers in explicit steps.
const LEDGER_ORDER: u32 = 6;

/// An attempt.
pub(super) struct Attempted {
    /// Its start, length and end, s.
    pub(super) t: f64,
    pub(super) step: f64,
    pub(super) t_end: f64,
    /// Where time functions have their next kink, s.
    pub(super) next: f64,
}

/// What refuses an attempt that its formula has accepted.
pub(super) struct Veto {
    /// The error that it makes, 1 = on tolerance.
    pub(super) error: f64,
    /// Length of the next attempt, s.
    pub(super) retry: f64,
    /// Whether the coordinate with the largest error is to blame.
    pub(super) blames: bool,
}

impl Run<'_> {
    /// Shortens a step `h` from the present state to what turns, force laws, drivers and ramps allow, and to `longest` where there is
    /// nothing to integrate. Time functions have their next kink at `next`, s, and one here if it `begins_at_kink`.
    pub(super) fn longest_admissible(
        &self,
        h: f64,
        longest: f64,
        next: f64,
        begins_at_kink: bool,
        ramps: &[[f64; 2]],
    ) -> f64 {
        let Options { end_time, parametrization, code, tolerance, .. } = self.options;
        let (system, state, part) = (self.system.as_ref(), &self.state, self.turn_part);
        let t = state.t;
        let mut h = h;
        // Formulas that evaluate forces at the ends of steps alone.
        let ends_only = self.stepper.multistep() || code.is_trapezoidal();
        if ends_only && begins_at_kink {
            // A curve may begin and end with nothing and be large between.
            h = h.min(0.5 * (next - t));
        }
        let tree = *parametrization == ParametrizationKind::Tree;
        h = h.min(step_length::longest(system, state, tree, h, part));
        if !tree {
            h = h.min(part * self.longest_to_tell());
        }
        h = h
            .min(self.longest_to_see())
            .min(part * LONGEST_TURN / self.turning())
            .min(step_length::ramped(ramps, t, *end_time));
        if !self.drivers.is_empty() {
            let most = h.min(next - t);
            h = step_length::driven(system, &self.drivers, t, most, tolerance.relative);
        }
        if self.is_kinematic() {
            let most = step_length::kinematic(system, state, end_time - self.started);
            h = h.min(most).min(longest);
        }
        h
    }

    /// Whether there is nothing to integrate: drivers prescribe all.
    pub(super) fn is_kinematic(&self) -> bool {
        self.form.point().manifold.chart().ndof() == 0
    }

    /// What refuses an attempt that its formula has accepted; else how far the next step may grow. `seen` is whether nothing
    /// was passed over since the last step.
    pub(super) fn veto(&mut self, attempted: &Attempted, seen: &mut bool) -> Result<f64, Veto> {
        let &Attempted { t, step, t_end, next } = attempted;
        if let Some(passed) = self.passed_over(t, step, t_end) {
            // The next attempt ends where it sees what this one did not, the one after that is shorter still.
            let most = if std::mem::replace(seen, false) { step } else { 0.5 * step };
            return Err(Veto {
                error: passed.error,
                retry: (passed.time - t).min(most),
                blames: true,
            });
        }
        if self.options.fixed_step.is_some() {
            return Ok(f64::INFINITY);
        }
        if self.options.parametrization == ParametrizationKind::Tree {
            let states = [&self.state, &self.form.point().state];
            let turned = step_length::turned(self.system.as_ref(), states, step);
            if turned > 1.0 {
                let retry = step * (0.5 / turned).max(0.1);
                return Err(Veto { error: turned, retry, blames: true });
            }
        }
        if let Some(part) = self.unseen_turn(t_end, step, next) {
            return Err(Veto { error: part.recip(), retry: part * step, blames: false });
        }
        // Steps of one-step formulas of high order are longer than what integrates the powers in them is good for.
        let one_step = self.stepper.explicit() && !self.stepper.multistep();
        let long = one_step && self.stepper.order() > LEDGER_ORDER;
        // Nothing else tells of a bump under a wheel that is driven over it.
        let follows =
            self.is_kinematic() || (self.passes_knot || long) && self.system.drivers_move(t);
        if !follows {
            return Ok(f64::INFINITY);
        }
        let missed = self.missed_powers(t, step, self.options.end_time - self.started);
        let growth = (SAFE_PART * missed.powf(-0.25)).max(SHORTEST_PART);
        if missed > 1.0 {
            return Err(Veto { error: missed, retry: growth * step, blames: true });
        }
        Ok(growth)
    }
}
