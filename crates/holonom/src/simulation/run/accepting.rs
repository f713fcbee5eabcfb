//! What an attempt that its formula has accepted becomes: looked at where nothing else tells, rows, ledger, the present state.

use super::{Run, failed};
use crate::error::EvaluationFailure;
use crate::reduction::assembly::PROJECTED;
use crate::simulation::diagnosis::Stop;
use crate::simulation::ledger::{QUARTERS, StepPowers, largest, powers};
use crate::simulation::passage::Place;
use crate::simulation::recorder::Inside;
use crate::simulation::reparametrization::no_longer_redundant;
use crate::simulation::step_length;
use crate::system::{EnergyBalance, State, System};
use crate::watch::unwatched;
use std::time::Instant;

/// A position residual may reach this times max(1, L).
const POSITION_RESIDUAL_BOUND: f64 = 1e-10;
/// A velocity residual may reach this times max(1, ‖q̇‖∞).
const VELOCITY_RESIDUAL_BOUND: f64 = 1e-10;
/// The place of the middle among [`QUARTERS`].
const MIDDLE: usize = 1;
/// How many times what is missed of the squared rates of drivers may be missed of powers: these have other phases, and may be small
/// all over a step.
const OF_DRIVERS: f64 = 100.0;
/// The shortest step that powers make, as a part of the longest that such a run takes.
const SHORTEST_OF_USUAL: f64 = 1e-3;

impl Run<'_> {
    /// Takes over the end of an accepted attempt from `t` over `step`: state with accelerations at `t_end`.
    pub(super) fn accept(
        &mut self,
        t: f64,
        step: f64,
        t_end: f64,
    ) -> Result<(), EvaluationFailure> {
        self.w_end.copy_from_slice(self.stepper.end().w);
        if let Err(failure) = self.form.derivative(t_end, &self.w_end, &mut self.g_end) {
            self.stepper.discard();
            return Err(failure);
        }
        self.check_residuals().inspect_err(|_| self.stepper.discard())?;
        self.look_inside(t, step, t_end);
        Ok(())
    }

    /// Looks into the accepted step: powers, where the ledger needs them, and in its middle arguments of force laws.
    fn look_inside(&mut self, t: f64, step: f64, t_end: f64) {
        self.inside.clear();
        self.halfway.clear();
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
        let quarters = driven || powered && no_error;
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
        for (k, time) in times.into_iter().enumerate() {
            let in_middle = k == MIDDLE;
            if !quarters && !in_middle {
                continue;
            }
            // One that is not found is a rare thing: the middle serves, or a line.
            let theta = QUARTERS[k];
            let Ok(state) = recorder.state(interpolate, t, step, theta, driven) else { continue };
            found[k] = powered.then(|| powers(&system.energy(state)));
            if looks && in_middle {
                let places = system.law_arguments().iter();
                self.halfway.extend(places.map(|a| Place::of(system.as_ref(), a, time, state)));
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

    /// How many tolerances of its energies the accepted step of a run of `span` seconds misses. Nothing where one cannot look
    /// into it.
    pub(super) fn missed_powers(&mut self, t: f64, step: f64, span: f64) -> f64 {
        // Where a power jumps, nothing else ends the refinement.
        let shortest = SHORTEST_OF_USUAL * span / step_length::KINEMATIC_STEPS;
        if step < shortest || self.inside.len() < QUARTERS.len() {
            return 0.0;
        }
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let end = self.recorder.state(interpolate, t, step, 1.0, true);
        let end = end.map(|state| powers(&self.system.energy(state)));
        self.recorder.begin_again(&self.state);
        let Ok(end) = end else { return 0.0 };
        let along = StepPowers::through(self.powers.at[4], &self.inside, end);
        let (tolerance, negligible) = self.power_tolerances(span);
        self.quadrature.missed(&along, negligible, tolerance)
    }

    /// The relative tolerance of powers, and what of them is negligible, W, in a run of `span` seconds.
    fn power_tolerances(&self, span: f64) -> (f64, f64) {
        // Powers are those of joints that are met to so much.
        let tolerance = self.options.tolerance.relative.max(POSITION_RESIDUAL_BOUND);
        // What turns steadily has powers of round-off only, and what is heavy large ones.
        let scale = &self.energy_scale;
        let negligible = scale.negligible(self.system.as_ref(), &self.options.tolerance);
        (tolerance, (tolerance * scale.moved()).max(negligible) / span)
    }

    /// Powers along the accepted step from `t`, with those at its ends, once `self.row` is the state at its start.
    fn powers_along(&mut self, t: f64, step: f64, [start, end]: [[f64; 2]; 2]) -> StepPowers {
        let along = StepPowers::through(start, &self.inside, end);
        if self.stepper.explicit() {
            return along;
        }
        let (tolerance, negligible) = self.power_tolerances(self.options.end_time - self.started);
        let Some(&places) = self.stepper.collocation_places() else {
            return self.quadrature.along([start, end], &self.inside, tolerance);
        };
        if self.inside.len() < QUARTERS.len() || along.is_sure(tolerance, negligible) {
            return along;
        }
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let mut at = |theta: f64| {
            let state = self.recorder.state(interpolate, t, step, theta, true).ok()?;
            Some(powers(&self.system.energy(state)))
        };
        let [first, second, _] = places;
        let found = [at(first), at(second)];
        self.recorder.begin_again(&self.row);
        let [Some(first), Some(second)] = found else { return along };
        // At its stages forces are those of the formula's slopes; between them, where they are stiff, the error of a state times
        // a stiffness. But what drivers do in a step may be more than the formula's order tells.
        let at_stages = [first, second, end];
        let collocated = StepPowers::collocated(places, at_stages);
        let missed =
            step_length::missed_of_drivers(self.system.as_ref(), &self.drivers, [t, step], places);
        let tolerance = tolerance.max(OF_DRIVERS * missed);
        let (differ, largest) = (along.differ(&collocated), largest(&at_stages, [0.0; 2]));
        let agree = (0..2).all(|k| differ[k] <= (tolerance * largest[k]).max(negligible));
        if agree { along } else { collocated }
    }

    /// Residuals of the state just evaluated, whose Jacobian is at hand.
    ///
    /// Redundant rows are left out of all solves: a row that is no longer redundant, as when a linkage
    /// leaves a flat position, shows by its residual only.
    fn check_residuals(&mut self) -> Result<(), EvaluationFailure> {
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
        let s = &mut self.statistics;
        s.position_residual = s.position_residual.max(position);
        s.velocity_residual = s.velocity_residual.max(velocity);
        s.residual_ratio = s
            .residual_ratio
            .max(position / (POSITION_RESIDUAL_BOUND * length))
            .max(velocity / (VELOCITY_RESIDUAL_BOUND * speed));
        Ok(())
    }

    /// Output rows inside the step, then the new state. Returns the energy at its end.
    pub(super) fn emit(&mut self, t: f64, step: f64) -> Result<EnergyBalance, Stop> {
        let begun = Instant::now();
        // Here a step counts, in whole: nothing is given up before it is among the steps that are stored.
        self.row.copy_from(&self.form.point().state);
        std::mem::swap(&mut self.row, &mut self.state);
        self.complete = false;
        // Powers of drivers are those of their multipliers.
        let t_end = self.state.t;
        if self.system.drivers_move(t_end) || t_end >= self.options.end_time {
            self.take_multipliers();
        }
        self.w.copy_from_slice(&self.w_end);
        self.g.copy_from_slice(&self.g_end);
        // `self.row` is now the state at the start, `self.state` the one at the end.
        self.system.update_windings(t_end, &self.state.q, &mut self.state.winding);
        if let Some(longest) = self.carried.as_mut().and_then(|carried| carried.longest.as_mut()) {
            longest.take(self.options.end_time - self.started, &self.row, &self.state);
        }
        let energy = self.system.energy(&self.state);
        let ends = [self.powers.at[4], powers(&energy)];
        self.powers = self.powers_along(t, step, ends);
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
        let part = self.energy_scale.part_of_velocities(imbalance);
        self.drift.follow(system, &self.state, step, part, tolerance);
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
