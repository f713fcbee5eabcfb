//! What an attempt that its formula has accepted becomes: looked at where nothing else tells, rows, ledger, the present state.

use super::{Run, failed};
use crate::error::EvaluationFailure;
use crate::reduction::assembly::PROJECTED;
use crate::simulation::diagnosis::Stop;
use crate::simulation::ledger::{QUARTERS, powers};
use crate::simulation::recorder::Inside;
use crate::simulation::reparametrization::no_longer_redundant;
use crate::simulation::stage_powers::{self, Look};
use crate::system::{EnergyBalance, State, System};
use crate::watch::unwatched;
use std::time::Instant;

/// A position residual may reach this times max(1, L).
pub(super) const POSITION_RESIDUAL_BOUND: f64 = 1e-10;
/// A velocity residual may reach this times max(1, ‖q̇‖∞).
const VELOCITY_RESIDUAL_BOUND: f64 = 1e-10;
/// Residuals that differ by less than this factor may be one contradiction.
const SAME: f64 = 10.0;
/// The place of the middle among [`QUARTERS`].
const MIDDLE: usize = 1;

impl Run<'_> {
    /// Takes over the end of an accepted attempt from `t` over `step`: state with accelerations at `t_end`. Where another end may
    /// be `better`, it is refused if joints are met there by what is left of singular constraints alone, and `false` is returned.
    pub(super) fn accept(
        &mut self,
        t: f64,
        step: f64,
        t_end: f64,
        better: bool,
    ) -> Result<bool, EvaluationFailure> {
        self.w_end.copy_from_slice(self.stepper.end().w);
        if let Err(failure) = self.form.derivative(t_end, &self.w_end, &mut self.g_end) {
            self.stepper.discard();
            return Err(failure);
        }
        if !self.check_residuals(better).inspect_err(|_| self.stepper.discard())? {
            self.stepper.discard();
            return Ok(false);
        }
        if self.is_looked_into(t, step, t_end) {
            self.complete_step().inspect_err(|_| self.stepper.discard())?;
        }
        self.look_inside(t, step, t_end);
        Ok(true)
    }

    /// Whether more is asked of the accepted step than its end.
    fn is_looked_into(&self, t: f64, step: f64, t_end: f64) -> bool {
        self.options.stores_dense_output()
            || self.output.time() < t_end
            || !self.form.integrates_powers()
            || self.may_pass_over(t, step, t_end)
            // Where that may fail, and the step with it, it does so whatever is written out.
            || !self.is_always_found()
    }

    /// Whether a configuration follows from any independent variables.
    fn is_always_found(&self) -> bool {
        let parametrization = self.form.point().manifold.chart().parametrization();
        parametrization.relatives().is_some_and(|relatives| relatives.exact)
    }

    /// Makes what the dense output of the accepted step needs beyond its stages.
    fn complete_step(&mut self) -> Result<(), EvaluationFailure> {
        let Self { stepper, recorder, state, form, .. } = self;
        let norm = &mut |change: &[f64]| form.norm(change);
        let slope = &mut |t: f64, w: &[f64], g: &mut [f64]| recorder.slope_at(t, w, g);
        let completed = stepper.complete_step(slope, norm);
        recorder.begin_again(state);
        completed
    }

    /// Keeps places within the step from `t` before it becomes the past, where it is long, for the comparison with a second run. One
    /// that is not found is left out.
    pub(super) fn keep_places(&mut self, t: f64, step: f64, t_end: f64) {
        let Some(carried) = &self.carried else { return };
        let parts = carried.milestones.parts(step, self.options.end_time);
        let completed =
            parts > 1 && (self.is_looked_into(t, step, t_end) || self.complete_step().is_ok());
        let Some(carried) = self.carried.as_mut().filter(|_| completed) else { return };
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        for part in 1..parts {
            let theta = f64::from(part) / f64::from(parts);
            let found = self.recorder.state(interpolate, t, step, theta, false);
            found.into_iter().for_each(|state| carried.milestones.pass_inside(state));
        }
        self.recorder.begin_again(&self.state);
    }

    /// Looks into the accepted step: powers, where the ledger needs them, and in its middle arguments of force laws.
    fn look_inside(&mut self, t: f64, step: f64, t_end: f64) {
        self.inside.clear();
        self.stage_powers.begin();
        self.law_places[1].clear();
        let powered = !self.form.integrates_powers();
        let looks = self.may_pass_over(t, step, t_end);
        if !powered && !looks {
            return;
        }
        let system = &self.system;
        let times = QUARTERS.map(|theta| t + theta * step);
        // Driver power needs multipliers; without drivers the recovery is enough.
        let driven = powered && times.iter().any(|&t| system.drivers_move(t));
        let no_error = self.form.point().manifold.chart().ndof() == 0 || self.stepper.explicit();
        let collocation = self.collocation().filter(|_| driven);
        let quarters = driven && collocation.is_none() || powered && no_error;
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let recorder = match &mut self.inspector {
            Some(inspector) if looks => {
                inspector.begin_again(&self.state);
                inspector
            }
            _ => &mut self.recorder,
        };
        let mut found = [None; QUARTERS.len()];
        for (k, theta) in QUARTERS.into_iter().enumerate() {
            let in_middle = k == MIDDLE;
            if !quarters && !(in_middle && (looks || collocation.is_none())) {
                continue;
            }
            // One that is not found is a rare thing: the middle serves, or a line.
            let full = driven && collocation.is_none();
            let Ok(state) = recorder.state(interpolate, t, step, theta, full) else { continue };
            found[k] = powered.then(|| powers(&system.energy(state)));
            if looks && in_middle {
                system.law_places(state, &mut self.law_places[1]);
            }
        }
        if let Some(nodes) = collocation {
            let (system, drivers) = (system.as_ref(), &self.drivers[..]);
            let look = Look { system, drivers, t, step, nodes };
            let stages = &mut self.stage_powers;
            let more = stages.needs_more(&look, self.options.tolerance.relative);
            for node in 1..stage_powers::END {
                if more || !stage_powers::BETWEEN.contains(&node) {
                    let state = recorder.state(interpolate, t, step, nodes[node], true);
                    state.into_iter().for_each(|state| stages.take(node, &look, state));
                }
            }
        }
        match found {
            [Some(before), Some(middle), Some(after)] => {
                self.inside.extend([before, middle, after]);
            }
            [_, middle, _] => self.inside.extend(middle),
        }
        self.recorder.begin_again(&self.state);
    }

    /// Residuals of the state just evaluated, whose Jacobian is at hand; `false` where another state is asked for: see
    /// [`Run::accept`].
    ///
    /// Redundant rows are left out of all solves: a row that is no longer redundant, as when a linkage
    /// leaves a flat position, shows by its residual only.
    fn check_residuals(&mut self, better: bool) -> Result<bool, EvaluationFailure> {
        let state = &self.form.point().state;
        let (position, velocity) = residuals(self.system.as_ref(), state, &mut self.residual_rows);
        let speed = state.v.iter().fold(1.0f64, |m, v| m.max(v.abs()));
        let length = self.system.characteristic_length().max(1.0);
        let allowed = [
            10.0 * self.start_residuals.0 + PROJECTED * length,
            10.0 * self.start_residuals.1 + PROJECTED * speed,
        ];
        if position > allowed[0] || velocity > allowed[1] {
            let dropped = &self.form.point().manifold.chart().parametrization().dropped;
            if let Some(failure) = no_longer_redundant(self.system.as_ref(), dropped, state) {
                return Err(failure);
            }
        }
        let ratio = self.of_bounds(position, velocity, state);
        let manifold = &mut self.form.point_mut().manifold;
        if better
            && ratio > 1.0
            && !manifold.chart().parametrization().dropped.is_empty()
            && manifold.condition() > self.options.repartition_factor() * self.condition_reference
        {
            // Where the step began about as far beyond them, constraints contradict each other: no other end cures that.
            let start = residuals(self.system.as_ref(), &self.state, &mut self.residual_rows);
            let start = self.of_bounds(start.0, start.1, &self.state);
            if start <= 1.0 || ratio > SAME * start {
                return Ok(false);
            }
        }
        let s = &mut self.statistics;
        s.position_residual = s.position_residual.max(position);
        s.velocity_residual = s.velocity_residual.max(velocity);
        s.residual_ratio = s.residual_ratio.max(ratio);
        Ok(true)
    }

    /// The larger of residuals in parts of their bounds.
    fn of_bounds(&self, position: f64, velocity: f64, state: &State) -> f64 {
        let speed = state.v.iter().fold(1.0f64, |m, v| m.max(v.abs()));
        let length = self.system.characteristic_length().max(1.0);
        (position / (POSITION_RESIDUAL_BOUND * length))
            .max(velocity / (VELOCITY_RESIDUAL_BOUND * speed))
    }

    /// Output rows inside the step, then the new state. Returns the energy at its end.
    pub(super) fn emit(&mut self, t: f64, step: f64) -> Result<EnergyBalance, Stop> {
        let begun = Instant::now();
        // Here a step counts, in whole: nothing is given up before it is among the steps that are stored.
        self.row.copy_from(&self.form.point().state);
        std::mem::swap(&mut self.row, &mut self.state);
        self.complete = false;
        if self.turned_over.is_none() {
            let force = self.system.turned_over(&self.row.q, &self.state.q);
            self.turned_over = force.map(|force| (force, self.state.t));
        }
        // Powers of drivers are those of their multipliers.
        let t_end = self.state.t;
        let by_stages = self.stage_powers.inner_are_known();
        if by_stages || self.system.drivers_move(t_end) || t_end >= self.options.end_time {
            self.take_multipliers();
        }
        // `self.row` is now the state at the start, `self.state` the one at the end.
        self.system.update_windings(t_end, &self.state.q, &mut self.state.winding);
        if let Some(longest) = self.carried.as_mut().and_then(|carried| carried.longest.as_mut()) {
            let ndof = self.form.second_order_split();
            let independent = [&self.w[..ndof], &self.w_end[..ndof]];
            let whole = [self.started, self.options.end_time];
            longest.take(whole, [&self.row, &self.state], independent);
        }
        self.w.copy_from_slice(&self.w_end);
        self.g.copy_from_slice(&self.g_end);
        let energy = self.system.energy(&self.state);
        self.powers = self.powers_along(t, step, powers(&energy));
        unwatched(|| self.close_balance(t, step, &energy));
        let ledger = self.row.ledger;
        if !self.form.integrates_powers() {
            self.state.ledger = self.powers.advance(&ledger, step, 1.0);
        }
        self.state.ledger.initial = ledger.initial;
        if self.options.stores_dense_output() {
            let powers = (!self.form.integrates_powers()).then_some(&self.powers);
            let dense = &mut self.output.chunk.dense;
            let chart = self.form.point().manifold.chart();
            dense.push(&self.row, chart, step, t_end, powers, self.stepper.as_ref());
        }
        while self.output.time() < t_end {
            let time = self.output.time();
            let powers = self.powers;
            let stepper = &mut self.stepper;
            let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
            let mut inside = Inside { t, step, interpolate, ledger, powers };
            let found = self.recorder.row(&mut inside, time, &mut self.row);
            found.map_err(|f| failed(f, step))?;
            self.output.push(self.system.as_ref(), &self.row);
            // A step may hold any number of rows: they go out in chunks, and the run can be stopped.
            if self.output.is_full() {
                // Its record is not complete before the end of the step.
                let record = self.output.chunk.steps.pop();
                let flushed = self.flush();
                self.output.chunk.steps.extend(record);
                flushed?;
                self.poll(step)?;
            }
        }
        while self.output.time() <= t_end {
            self.take_multipliers();
            self.output.push(self.system.as_ref(), &self.state);
        }
        self.move_references().map_err(|f| failed(f, step))?;
        self.begin_step();
        self.statistics.output_seconds += begun.elapsed().as_secs_f64();
        Ok(energy)
    }

    /// Multipliers of the end of the step just accepted, where the form of the equations still stands.
    fn take_multipliers(&mut self) {
        if self.complete {
            return;
        }
        let (point, state) = (self.form.point_mut(), &mut self.state);
        // The step counts by now: a state in part must not be its end.
        unwatched(|| {
            point.complete();
            state.lambda.copy_from_slice(&point.state.lambda);
            point.manifold.minimum_norm_multipliers(&mut state.lambda);
        });
        self.complete = true;
    }

    /// Multipliers of the present state, wherever the form stands; also where the run is given up.
    pub(super) fn complete_state(&mut self) {
        if !std::mem::replace(&mut self.complete, true) {
            unwatched(|| self.recorder.complete(&self.w, &mut self.state));
        }
    }

    /// Step sizes and energy of the new state.
    pub(super) fn account(&mut self, step: f64, energy: &EnergyBalance) {
        let s = &mut self.statistics;
        s.smallest_step = s.smallest_step.min(step);
        s.largest_step = s.largest_step.max(step);
        let e = &mut self.energy;
        let imbalance = self.state.ledger.imbalance(energy) - e.missing;
        e.largest_imbalance = e.largest_imbalance.max(imbalance.abs());
        let (low, high) = self.kinetic_range;
        self.kinetic_range = (low.min(energy.kinetic), high.max(energy.kinetic));
        let (system, tolerance) = (self.system.as_ref(), &self.options.tolerance);
        self.energy_scale.take(system, &self.state, energy);
        // Where all is prescribed nothing can be behind.
        if self.form.second_order_split() > 0 {
            let part = self.energy_scale.part_of_velocities(imbalance);
            self.drift.follow(system, &self.state, step, part, tolerance);
        }
    }
}

/// ‖Φ‖∞ and ‖G q̇ − ν‖∞ over all rows (redundant ones too) at a state; `rows` is room for them.
pub(super) fn residuals(system: &dyn System, state: &State, rows: &mut [f64]) -> (f64, f64) {
    let State { t, q, v, .. } = state;
    let largest = |x: &[f64]| x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    system.position_constraints(*t, q, rows);
    let position = largest(rows);
    system.velocity_constraints(*t, q, v, rows);
    (position, largest(rows))
}
