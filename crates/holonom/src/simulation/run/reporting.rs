//! What a run hands out: the step log, events, chunks, how it ended.

use super::Run;
use crate::method::stepper::{Rejection, StepReport};
use crate::reduction::singular_elements::{coincident_ends, opposite_axes};
use crate::simulation::clock::Stopwatch;
use crate::simulation::diagnosis::{Stop, Suspects, diagnose};
use crate::simulation::output::CHUNK_STEPS;
use crate::simulation::statistics::{Status, StopReason};
use crate::simulation::trajectory::{EventKind, EventRecord, Flow, StepOutcome, StepRecord};
use crate::simulation::warnings::{MissingEnergy, turned_over, warnings};
use crate::watch::within;
use std::time::{Duration, Instant};

const POLL: Duration = Duration::from_millis(50);
const FLUSH: Duration = Duration::from_millis(500);

/// Axes of a twist are opposite when they are nearer to it than this, rad: the last steps come there by themselves.
const OPPOSITE: f64 = 1e-3;

impl Run<'_> {
    pub(super) fn record(
        &mut self,
        t: f64,
        h: f64,
        report: &StepReport,
        rejection: Option<&Rejection>,
    ) {
        let outcome = match rejection {
            None => StepOutcome::Accepted,
            Some(Rejection::ErrorTooLarge) => StepOutcome::Error,
            Some(Rejection::NewtonDivergence | Rejection::NewtonSlow) => StepOutcome::Newton,
            Some(_) => StepOutcome::Evaluation,
        };
        let s = &mut self.statistics;
        match outcome {
            StepOutcome::Accepted => s.steps += 1,
            StepOutcome::Error => s.rejected_error += 1,
            StepOutcome::Newton => s.rejected_newton += 1,
            StepOutcome::Evaluation => s.rejected_evaluation += 1,
        }
        self.output.chunk.steps.push(StepRecord {
            t,
            h,
            error: report.error,
            outcome,
            iterations: report.iterations,
            order: self.stepper.order(),
            condition: 0.0,
        });
    }

    pub(super) fn note(&mut self, kind: EventKind) {
        self.output.chunk.events.push(EventRecord { t: self.state.t, kind });
    }

    pub(super) fn poll(&mut self, h: f64) -> Result<(), Stop> {
        if self.begun.passed().as_secs_f64() > self.options.max_seconds {
            return Err(Stop::MaxSeconds);
        }
        if self.last_poll.elapsed() < POLL {
            return Ok(());
        }
        let begun = Stopwatch::start();
        let flow = self.sink.progress(self.state.t, h, self.statistics.steps);
        self.last_poll = Instant::now();
        self.sink_time += begun.elapsed();
        match flow {
            Flow::Continue => Ok(()),
            Flow::Interrupt => Err(Stop::Interrupted),
        }
    }

    pub(super) fn flush_if_due(&mut self) -> Result<(), Stop> {
        let chunk = &self.output.chunk;
        let full =
            self.output.is_full() || chunk.steps.len() >= CHUNK_STEPS || chunk.dense.is_full();
        if full || self.last_flush.elapsed() >= FLUSH {
            self.flush()?;
        }
        Ok(())
    }

    pub(super) fn flush(&mut self) -> Result<(), Stop> {
        let begun = Stopwatch::start();
        self.statistics.outputs += self.output.chunk.time.len() as u64;
        let result = self.sink.chunk(&self.output.chunk).map_err(Stop::Sink);
        self.output.chunk.clear();
        self.last_flush = Instant::now();
        self.sink_time += begun.elapsed();
        result
    }

    /// Flushes, completes the statistics and says why the run ended.
    pub(super) fn finish(&mut self, stop: Result<(), Stop>) -> (Status, StopReason) {
        self.complete_state();
        // A sink that took no more has no place for what comes behind it.
        let takes = !matches!(stop, Err(Stop::Sink(_)));
        if stop.is_err() && takes {
            self.output.push_last(self.system.as_ref(), &self.state);
        }
        if let Some(carried) = &mut self.carried {
            carried.milestones.end(&self.state);
        }
        let flushed = if takes { self.flush() } else { Ok(()) };
        let counters = self.form.point().manifold.counters;
        let stepper = self.work();
        let s = &mut self.statistics;
        s.evaluations = stepper.derivatives;
        s.jacobians = stepper.linearizations;
        s.factorizations = stepper.factorizations;
        s.simplified_factorizations = stepper.simplified_factorizations;
        s.changes_to_full = stepper.changes_to_full;
        s.iterations = stepper.iterations;
        s.contractions = stepper.contractions;
        s.stiff_steps = stepper.stiff_steps;
        s.recoveries = counters.recoveries;
        s.corrections = counters.corrections;
        s.constraint_factorizations = counters.factorizations;
        s.accelerations = counters.accelerations;
        s.analyses = self.form.point().manifold.analyses();
        if s.steps == 0 {
            s.smallest_step = 0.0;
        }
        let energy = self.system.energy(&self.state);
        let ledger = self.state.ledger;
        let e = &mut self.energy;
        e.end = energy;
        e.dissipated = ledger.dissipated;
        e.supplied = ledger.supplied;
        e.imbalance = ledger.imbalance(&energy) - e.missing;
        e.range = self.kinetic_range.1 - self.kinetic_range.0;
        e.moved = self.energy_scale.moved();
        let chart = self.form.point().manifold.chart();
        let (dropped, ndof) = (&chart.parametrization().dropped, chart.ndof());
        let (system, tolerance) = (self.system.as_ref(), &self.options.tolerance);
        let negligible = self.energy_scale.negligible(system, tolerance);
        self.warnings = warnings(system, dropped, ndof, s);
        self.warnings.extend(
            (self.turned_over).map(|(force, t)| turned_over(&self.model.forces[force].name, t)),
        );
        let drift = self.drift.largest();
        let missing = MissingEnergy::new(e, &self.energy_scale, negligible, drift, self.options);
        self.warnings.extend(missing.told);
        match &mut self.carried {
            Some(carried) => carried.missing = missing.asked,
            None => self.warnings.extend(missing.asked.map(|(warning, _)| warning)),
        }
        let stop = match (stop, flushed) {
            (Err(Stop::Sink(message)), _) | (Ok(()), Err(Stop::Sink(message))) => {
                Err(Stop::Sink(message))
            }
            (stop, _) => stop,
        };
        let mut suspects = match &stop {
            // A search that is given up finds nothing; the run is told as it ended.
            Err(Stop::Failed { .. }) => within(None, || {
                Suspects::find(self.form.as_mut(), self.stepper.as_ref(), &self.state)
            })
            .unwrap_or_default(),
            _ => Suspects::default(),
        };
        if stop.is_err() {
            let near = self.options.tolerance.translation;
            let met = coincident_ends(self.system.as_ref(), self.model, &self.state, near);
            suspects.met = met.map(|(item, _)| item.to_owned());
            let opposite = opposite_axes(self.system.as_ref(), self.model, &self.state, OPPOSITE);
            suspects.opposite = opposite.map(str::to_owned);
        }
        diagnose(stop, self.state.t, self.options, &suspects, self.system.as_ref())
    }
}
