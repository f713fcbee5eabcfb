//! Powers along an accepted step, as far as the ledger has to be told them.

use super::Run;
use super::accepting::POSITION_RESIDUAL_BOUND;
use crate::simulation::ledger::{QUARTERS, StepPowers, mean_of_parts, powers};
use crate::simulation::stage_powers::{self, Look, StagePowers};
use crate::simulation::step_length;
use crate::simulation::warnings::missing_share;
use crate::system::EnergyBalance;

/// The shortest step that powers make, as a part of the longest that such a run takes.
const SHORTEST_OF_USUAL: f64 = 1e-3;
/// Part of what is warned of that may be missing after a step before powers are looked at more closely.
const CLOSELY: f64 = 0.02;
/// Most moments of a step by whose powers a balance is closed.
pub(super) const MOST_MOMENTS: usize = 65;
/// Part of what is missing that finer rules must leave less than, so that they are believed.
const CLOSED: f64 = 0.5;

impl Run<'_> {
    /// How many tolerances of its energies the accepted step of a run of `span` seconds misses. Nothing where one cannot look
    /// into it.
    pub(super) fn missed_powers(&mut self, t: f64, step: f64, span: f64) -> f64 {
        // Where a power jumps, nothing else ends the refinement.
        let shortest = SHORTEST_OF_USUAL * span / step_length::KINEMATIC_STEPS;
        let quarters = self.inside.len() == QUARTERS.len();
        if step < shortest || !(quarters || self.stage_powers.inner_are_known()) {
            return 0.0;
        }
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let mut at = |theta: f64| {
            let state = self.recorder.state(interpolate, t, step, theta, true).ok()?;
            Some(powers(&self.system.energy(state)))
        };
        // The stages have no second rule beside theirs.
        let inside = if quarters { [None; 3] } else { QUARTERS.map(&mut at) };
        let end = at(1.0);
        self.recorder.begin_again(&self.state);
        let Some(end) = end else { return 0.0 };
        let along = match inside {
            [Some(before), Some(middle), Some(after)] => {
                StepPowers::through(self.powers.at[4], &[before, middle, after], end)
            }
            _ => StepPowers::through(self.powers.at[4], &self.inside, end),
        };
        // Powers are those of joints that are met to so much.
        let tolerance = self.options.tolerance.relative.max(POSITION_RESIDUAL_BOUND);
        // What turns steadily has powers of round-off only, and what is heavy large ones.
        let negligible =
            self.energy_scale.negligible(self.system.as_ref(), &self.options.tolerance);
        let rate = (tolerance * self.energy_scale.moved()).max(negligible) / span;
        self.quadrature.missed(&along, rate, tolerance)
    }

    /// Nodes in a step at which its formula tells powers.
    pub(super) fn collocation(&self) -> Option<[f64; stage_powers::NODES]> {
        let free = self.form.point().manifold.chart().ndof() > 0;
        self.stepper.collocation_places().filter(|_| free).map(|places| StagePowers::nodes(*places))
    }

    /// Powers along the accepted step from `t`, which ends at the present state with those of `end`.
    pub(super) fn powers_along(&mut self, t: f64, step: f64, end: [f64; 2]) -> StepPowers {
        let ends = [self.powers.at[4], end];
        let known = self.stage_powers.inner_are_known();
        if let Some(nodes) = self.collocation().filter(|_| known) {
            let (system, drivers) = (self.system.as_ref(), &self.drivers[..]);
            let look = Look { system, drivers, t, step, nodes };
            self.stage_powers.take(stage_powers::END, &look, &self.state);
            return self.stage_powers.advance(&look);
        }
        self.stage_powers.restart();
        if self.stepper.explicit() {
            return StepPowers::through(ends[0], &self.inside, ends[1]);
        }
        let tolerance = self.options.tolerance.relative.max(POSITION_RESIDUAL_BOUND);
        self.quadrature.along(ends, &self.inside, tolerance)
    }

    /// Where energy is missing after the step just accepted, from `self.row` to the present state with `energy`, a driver's
    /// power may peak where no node is, as beside a dead point: more of its moments are looked at, and believed as far as
    /// they close the balance. Source: `docs/theory/simulation.md` (3e).
    pub(super) fn close_balance(&mut self, t: f64, step: f64, energy: &EnergyBalance) {
        let driven = !self.form.integrates_powers()
            && self.form.point().manifold.chart().ndof() > 0
            && (self.system.drivers_move(t) || self.system.drivers_move(t + step));
        if !driven {
            return;
        }
        let before = self.system.energy(&self.row);
        let gained = energy.kinetic + energy.potential - before.kinetic - before.potential;
        let missing = |[dissipated, supplied]: [f64; 2]| gained + step * (dissipated - supplied);
        let at_first = missing(self.powers.mean()).abs();
        let tolerance = &self.options.tolerance;
        let negligible = self.energy_scale.negligible(self.system.as_ref(), tolerance);
        let share = CLOSELY * missing_share(tolerance.relative);
        let allowed = (share * self.energy_scale.moved()).max(CLOSELY * negligible);
        if !(self.quadrature.is_to_be_found(at_first) && at_first > allowed) {
            return;
        }
        // At quarters powers may be those of a parabola.
        let [start, .., end] = self.powers.at;
        self.moments.clear();
        self.moments.extend([start, end]);
        let (mut left, mut finest) = (at_first, None);
        while self.moments.len() < MOST_MOMENTS && left > allowed && self.halve_moments(t, step) {
            if self.moments.len() > self.powers.at.len() {
                let mean = mean_of_parts(&self.moments);
                left = missing(mean).abs();
                finest = Some(mean);
            }
        }
        self.recorder.begin_again(&self.row);
        let Some(mean) = finest.filter(|_| left < CLOSED * at_first) else {
            return self.quadrature.give_up(at_first);
        };
        let quarter = self.moments.len() / 4;
        self.powers.at = std::array::from_fn(|k| self.moments[k * quarter]);
        self.powers.set_mean(mean);
    }

    /// Powers between all moments of the step that are known; `false` where a state is not found.
    fn halve_moments(&mut self, t: f64, step: f64) -> bool {
        let Self { stepper, recorder, moments, system, row, .. } = self;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let known = moments.len();
        let spacing = ((2 * known - 2) as f64).recip();
        moments.resize(2 * known - 1, [0.0; 2]);
        for k in (0..known).rev() {
            moments[2 * k] = moments[k];
        }
        recorder.begin_again(row);
        (1..moments.len()).step_by(2).all(|k| {
            let state = recorder.state(interpolate, t, step, k as f64 * spacing, true);
            state.map(|state| moments[k] = powers(&system.energy(state))).is_ok()
        })
    }
}
