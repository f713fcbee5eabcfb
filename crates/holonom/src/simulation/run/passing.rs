//! What a step that was accepted by its formula has passed over: stops, contacts, bumps of the road.

use super::Run;
use crate::error::EvaluationFailure;
use crate::simulation::passage::{Looking, Passage, Place, Way};
use crate::simulation::recorder::Recorder;
use crate::system::{LawArgument, Measure};

/// Parts of a law that accelerations are compared in; they stand for the others.
const LOOKED_AT: usize = 2;

/// A part of a force law that a step has not seen, and that counts.
pub(super) struct PassedOver {
    /// Where a step would see it, s.
    pub(super) time: f64,
    /// Error that it makes, 1 = on tolerance.
    pub(super) error: f64,
}

impl Run<'_> {
    /// The first part of a force law that the attempt from `t` over `step` has passed over, if the error that this
    /// makes exceeds the tolerance.
    ///
    /// The formula's own estimate knows of the laws what its stages see. Where the argument of a law passes two knots
    /// or more, the accelerations of the equations between these are set against those of the dense output.
    pub(super) fn passed_over(&mut self, t: f64, step: f64, t_end: f64) -> Option<PassedOver> {
        let system = self.system.clone();
        let mut inspector = self.inspector.take()?;
        let mut way = std::mem::take(&mut self.way);
        let mut found: Option<PassedOver> = None;
        for (k, argument) in system.law_arguments().iter().enumerate() {
            // A state inside an accepted step that cannot be recovered is told where a row asks for it.
            let Some(&halfway) = self.halfway.get(k) else { break };
            let times = [t, step, t_end];
            if self.follow(&mut way, &mut inspector, argument, halfway, times).is_err() {
                continue;
            }
            let passages = way.passages(system.as_ref(), argument);
            if let Some(passed) = self.missed(&mut inspector, t, step, passages)
                && found.as_ref().is_none_or(|first| passed.time < first.time)
            {
                found = Some(passed);
            }
        }
        (self.way, self.inspector) = (way, Some(inspector));
        found
    }

    /// Follows the argument of a law through the attempt.
    fn follow(
        &mut self,
        way: &mut Way,
        inspector: &mut Recorder,
        argument: &LawArgument,
        halfway: Place,
        [t, step, t_end]: [f64; 3],
    ) -> Result<(), EvaluationFailure> {
        let system = self.system.as_ref();
        let tolerance = &self.options.tolerance;
        let negligible = match argument.measure {
            Measure::Length => tolerance.translation,
            Measure::Angle => tolerance.rotation,
        };
        let end = &self.form.point().state;
        let [first, last] = [(t, &self.state), (t_end, end)]
            .map(|(time, state)| Place::of(system, argument, time, state));
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let inside = &mut |time: f64| {
            let state = inspector.state(interpolate, t, step, (time - t) / step, false)?;
            Ok(Place::of(system, argument, time, state))
        };
        let knots = &argument.knots;
        way.follow(Looking { knots, negligible, inside }, [first, halfway, last])
    }

    /// Where the attempt misses most of what it passes over, if that exceeds the tolerance.
    fn missed(
        &mut self,
        inspector: &mut Recorder,
        t: f64,
        step: f64,
        passages: &[Passage],
    ) -> Option<PassedOver> {
        let time = passages.first()?.time;
        self.scratch[0].fill(0.0);
        let mut seen = 0.0;
        for passage in passages.iter().take(LOOKED_AT) {
            if self.miss(inspector, t, step, passage).is_ok() {
                seen += passage.duration * passage.deviation;
            }
        }
        let whole: f64 = passages.iter().map(|p| p.duration * p.deviation).sum();
        let missed = &mut self.scratch[0];
        self.stepper.filter(self.form.as_mut(), missed);
        let error = whole / seen * self.form.error_norm(missed, &self.w_end);
        (error > 1.0).then_some(PassedOver { time, error })
    }

    /// Adds what the end of the attempt misses if its accelerations miss those of the equations all along a passage as
    /// they do in its middle.
    fn miss(
        &mut self,
        inspector: &mut Recorder,
        t: f64,
        step: f64,
        &Passage { time, duration, .. }: &Passage,
    ) -> Result<(), EvaluationFailure> {
        let theta = ((time - t) / step).clamp(0.0, 1.0);
        let [missed, slope] = &mut self.scratch;
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        inspector.slope(interpolate, t, step, theta, slope)?;
        let (n, degree, ndof) =
            (missed.len(), self.stepper.largest_degree(), self.form.second_order_split());
        self.coefficients.resize((degree + 1) * n, 0.0);
        let degree = self.stepper.polynomial(&mut self.coefficients);
        let powers = self.coefficients.chunks_exact(n.max(1)).take(degree + 1);
        let mut weight = 1.0 / step;
        for (j, power) in powers.enumerate().skip(1) {
            for (slope, power) in slope[ndof..2 * ndof].iter_mut().zip(&power[ndof..]) {
                *slope -= j as f64 * weight * power;
            }
            weight *= theta;
        }
        for k in 0..ndof {
            let change = duration * slope[ndof + k];
            missed[ndof + k] += change;
            missed[k] += (t + step - time) * change;
        }
        Ok(())
    }
}
