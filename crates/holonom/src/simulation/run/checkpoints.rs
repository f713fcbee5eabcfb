//! Checkpoints: a run forgets what it could not be taken up with.

use super::set_up::Machinery;
use super::{Run, failed};
use crate::error::EvaluationFailure;
use crate::method::stepper::StepperStatistics;
use crate::reduction::RecoveryCounters;
use crate::reduction::assembly::manifold_of;
use crate::simulation::carried_error::CarriedError;
use crate::simulation::checkpoint::{Checkpoint, Pace, foreign};
use crate::simulation::checks::{RunError, set_coordinates};
use crate::simulation::diagnosis::Stop;
use crate::simulation::ledger::powers;
use crate::simulation::slowness::Slowness;
use crate::simulation::stall::Stall;

impl Run<'_> {
    /// After an accepted step: hands out a checkpoint if it is time for one, and goes on from that alone.
    pub(super) fn checkpoint_if_due(&mut self, pace: Pace) -> Result<(), Stop> {
        let due = self.options.steps_between_checkpoints();
        let unfinished = self.state.t < self.options.end_time;
        if !(unfinished && self.statistics.steps.is_multiple_of(due.max(1))) {
            return Ok(());
        }
        self.complete_state();
        let mut checkpoint = self.checkpoint(pace);
        // Where the equations cannot be set up anew the run goes on as it is, and nobody can begin here.
        let Ok(machinery) = self.machinery(&checkpoint) else { return Ok(()) };
        checkpoint.statistics.outputs += self.output.chunk.time.len() as u64;
        self.output.chunk.checkpoint = Some(checkpoint.clone());
        self.flush()?;
        self.take_over(machinery, &checkpoint);
        Ok(())
    }

    /// The beginning of a run that is taken up.
    pub(super) fn take_up(&mut self, checkpoint: &Checkpoint) -> Result<Pace, Stop> {
        let machinery = self.machinery(checkpoint).map_err(|f| failed(f, 0.0))?;
        self.take_over(machinery, checkpoint);
        Ok(checkpoint.pace)
    }

    fn checkpoint(&mut self, pace: Pace) -> Checkpoint {
        let manifold = &self.form.point().manifold;
        let parametrization = manifold.chart().parametrization();
        let limits = self.slowness.by_name(self.system.as_ref(), parametrization, &self.state);
        let limits = limits.to_vec();
        let mut statistics = self.statistics;
        self.add_times(&mut statistics);
        Checkpoint {
            chart: self.chart_record(),
            w: self.w.clone(),
            history: self.stepper.history(),
            pace,
            condition: self.condition_reference,
            started: self.started,
            origin: self.origin.clone(),
            assembled: self.assembled,
            rows: self.output.position(),
            start_residuals: self.start_residuals,
            counters: RecoveryCounters { analyses: manifold.analyses(), ..manifold.counters },
            work: self.work(),
            statistics,
            turned_over: self.turned_over,
            energy: self.energy,
            kinetic_range: self.kinetic_range,
            energy_scale: self.energy_scale.clone(),
            drift: self.drift.clone(),
            quadrature: self.quadrature,
            carried: self.carried.clone(),
            limits,
            state: self.state.clone(),
        }
    }

    /// Equations and formula as if nothing had been computed before.
    fn machinery(&self, checkpoint: &Checkpoint) -> Result<Machinery, EvaluationFailure> {
        let Checkpoint { state, chart, w, .. } = checkpoint;
        let mut manifold = manifold_of(&self.system, &chart.parametrization, &state.q)?;
        // What cannot be with these rows is made up for by the cheapest way.
        let _ = manifold.set_accelerations(self.options.accelerations);
        let _ = set_coordinates(self.options, &mut manifold, &state.q);
        manifold.counters = checkpoint.counters;
        let mut machinery = Machinery::new(self.options, manifold, state, &self.origin);
        let Machinery { form, stepper, slope, .. } = &mut machinery;
        if w.len() != form.dimension() || !stepper.recall(&checkpoint.history) {
            let message = "the checkpoint is none of this code".to_owned();
            return Err(EvaluationFailure::new("simulation/checkpoint", message));
        }
        form.begin_step(state);
        form.derivative(state.t, w, slope)?;
        Ok(machinery)
    }

    fn take_over(&mut self, machinery: Machinery, checkpoint: &Checkpoint) {
        let Machinery { form, stepper, recorder, inspector, slope } = machinery;
        (self.form, self.stepper, self.g) = (form, stepper, slope);
        (self.recorder, self.inspector) = (recorder, inspector);
        self.carried.iter_mut().for_each(CarriedError::forget_matrix);
        self.w.copy_from_slice(&checkpoint.w);
        self.work_before = checkpoint.work;
        self.begin_beside();
        self.powers.at[4] = powers(&self.system.energy(&self.state));
        self.stage_powers.restart();
        self.stall = Stall::default();
        self.unseen_turns.forget();
        let chart = self.form.point().manifold.chart().parametrization();
        self.slowness.set_chart(self.system.as_ref(), None, chart, &self.options.tolerance);
        self.record_chart();
    }

    /// Work of the formula since the start of the run.
    pub(super) fn work(&self) -> StepperStatistics {
        self.work_before.plus(self.stepper.statistics())
    }

    /// Takes over what a run has counted and bounded up to a checkpoint.
    pub(super) fn go_on_counting(&mut self, checkpoint: &Checkpoint) -> Result<(), RunError> {
        let here = self.statistics;
        let Checkpoint { statistics, energy_scale, drift, carried, w, state, .. } = checkpoint;
        let bodies = self.system.structure().sizes.bodies;
        let unknowns = [self.form.second_order_split(), w.len()];
        let carried_fits =
            carried.as_ref().is_none_or(|carried| carried.fits(unknowns, bodies, state));
        if !(energy_scale.is_like(&self.energy_scale) && drift.is_like(&self.drift) && carried_fits)
        {
            return Err(foreign());
        }
        self.statistics = *statistics;
        self.statistics.assembly_seconds += here.assembly_seconds;
        self.statistics.assembly_cpu_seconds += here.assembly_cpu_seconds;
        self.turned_over = checkpoint.turned_over;
        self.energy = checkpoint.energy;
        self.kinetic_range = checkpoint.kinetic_range;
        (self.energy_scale, self.drift) = (energy_scale.clone(), drift.clone());
        self.quadrature = checkpoint.quadrature;
        self.carried.clone_from(carried);
        self.start_residuals = checkpoint.start_residuals;
        self.condition_reference = checkpoint.condition;
        self.slowness = Slowness::after(checkpoint.limits.clone());
        (self.started, self.assembled) = (checkpoint.started, checkpoint.assembled);
        self.output.go_on(checkpoint.started, checkpoint.rows);
        Ok(())
    }
}
