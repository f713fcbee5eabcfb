//! The inside of a step of an implicit formula: its dense output is brought to where the equations are, as far as stages, the step
//! before and evaluations tell. Source: `docs/theory/method.md` (13) to (15).

use super::attempt::{AtEnd, ImplicitStepper, Inside};
use super::counted::Counted;
use super::ode::EvaluationFailure;
use super::stages::{Stages, Step, keep_stiff};
use super::weights::keep_larger;

/// Tolerances that rates in rows may be off where nothing but the length of steps makes them better.
const ROWS: f64 = 20.0;

impl<S: Stages> ImplicitStepper<S> {
    /// All that is done about the inside of a step that is accepted otherwise.
    pub(super) fn settle_inside(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> Inside {
        let stages = self.correct_inside(ode, step.h);
        let between = keep_larger(stages, self.miss_between(ode, step));
        let middle = self.balance_inside(ode, step);
        // What cannot be evaluated inside is found where the step is taken.
        let _ = self.bend_rates(ode, step);
        // A parabola is off like the third power of the step.
        let of_output = between.powf(1.0 / (S::DEGREE + 1) as f64);
        Inside {
            off: keep_larger(between, middle),
            ratio: 0.9 / keep_larger(of_output, middle.cbrt()),
        }
    }

    /// Leads the dense output through stages less their errors, where these are known. Returns how far off it is left between them,
    /// scaled. Source: `docs/theory/method.md` (14).
    fn correct_inside(&mut self, ode: &mut Counted<'_>, h: f64) -> f64 {
        let left = &mut self.at_end.change;
        if !(self.knows_own || self.stages.own_error(ode, h, left)) {
            return 0.0;
        }
        self.stages.correct_inside(ode, 1.0, &mut self.current, left);
        ode.error_norm(left, self.stages.end().w)
    }

    /// How far off stiff rates may be between the stages of a collocation formula, scaled and over [`ROWS`]: by how much the polynomial,
    /// continued to the last stage inside the step before, misses that. Source: `docs/theory/method.md` (15).
    fn miss_between(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> f64 {
        let (true, Some(places)) = (self.predicts, self.stages.collocation_places()) else {
            return 0.0;
        };
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        let Self { stages, at_end: AtEnd { change, state, answer, .. }, .. } = self;
        let inner = places[places.len() - 2];
        let theta = (inner - 1.0) * self.previous.step / step.h;
        self.previous.interpolate(inner, answer);
        self.current.interpolate(theta, state);
        let product = |theta: f64| places.iter().fold(theta, |all, c| all * (theta - c)).abs();
        let largest = (1..20).map(|k| product(0.05 * f64::from(k))).fold(0.0, f64::max);
        let weight = largest / (ROWS * product(theta));
        change.fill(0.0);
        for k in rates {
            change[k] = weight * (state[k] - answer[k]);
        }
        // Written so that a NaN is left alone.
        let counts = ode.error_norm(change, stages.end().w) > 1.0;
        if !counts {
            return 0.0;
        }
        keep_stiff(change, state, |x| stages.filter(ode, x));
        ode.error_norm(change, stages.end().w)
    }

    /// Brings the middle of rates that the dense output takes for lines into balance where they are stiff and bend by more than
    /// the tolerance: they follow forces and not what came before, and no estimate sees what they do inside. How much they bend is told by
    /// the step before; without one, by their change. Source: `docs/theory/method.md` (13), behind (14).
    fn bend_rates(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<(), EvaluationFailure> {
        if !self.stages.rates_are_lines() {
            return Ok(());
        }
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        let Self { stages, at_end: AtEnd { change, state, slope, answer, .. }, .. } = self;
        self.current.slope_beyond(0.0, slope);
        let mut weight = 0.125 * step.h;
        answer.fill(0.0);
        if self.predicts {
            weight = 0.25 * step.h * step.h / (step.h + self.previous.step);
            // What was bent there has no slope in its middle.
            self.previous.slope_beyond(-0.5 * self.previous.step, answer);
        }
        change.fill(0.0);
        for k in rates {
            change[k] = weight * (slope[k] - answer[k]);
        }
        // Written so that a NaN is left alone.
        let mut counts = ode.error_norm(change, stages.end().w) > 1.0;
        if counts {
            keep_stiff(change, state, |x| stages.filter(ode, x));
            counts = ode.error_norm(change, stages.end().w) > 1.0;
        }
        if !counts {
            return Ok(());
        }
        let bent = self.bend_middle(ode, step);
        // What was evaluated last is the end, as it would be without this.
        ode.derivative(step.t + step.h, self.stages.end().w, &mut self.at_end.slope)?;
        bent
    }

    /// [`Self::bend_rates`] where it counts. Forces that do not answer to rates leave the defect of these as it was, and rates are not what balances
    /// them: an undamped vibration is no such motion.
    fn bend_middle(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<(), EvaluationFailure> {
        let n = ode.second_order_split();
        let before = self.defect_of_rates(ode, step)?;
        let Self { stages, at_end: AtEnd { defect, change, .. }, .. } = self;
        stages.filter(ode, defect);
        defect[..n].fill(0.0);
        defect[2 * n..].fill(0.0);
        change.copy_from_slice(defect);
        if !ode.error_norm(change, stages.end().w).is_finite() {
            return Ok(());
        }
        self.current.bulge(&self.at_end.change);
        let after = self.defect_of_rates(ode, step);
        if !after.as_ref().is_ok_and(|after| *after <= 0.5 * before) {
            self.at_end.change.iter_mut().for_each(|x| *x = -*x);
            self.current.bulge(&self.at_end.change);
        }
        after.map(drop)
    }

    /// Scaled size of γh (g − v̇) in the middle, rates alone. It is left in full.
    fn defect_of_rates(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        self.evaluate_defect_at(0.5, ode, step)?;
        let n = ode.second_order_split();
        let AtEnd { defect, answer, .. } = &mut self.at_end;
        answer.fill(0.0);
        answer[n..2 * n].copy_from_slice(&defect[n..2 * n]);
        Ok(ode.error_norm(answer, self.stages.end().w))
    }

    /// Brings the middle of the dense output nearer to what the equations say, where rates that are right within the tolerance
    /// would not tell where positions are inside: a step of many times what motions take. Returns how far off it is
    /// inside then, scaled; 0 where rates do tell. Source: `docs/theory/method.md` (13).
    fn balance_inside(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> f64 {
        let (split, end) = (ode.second_order_split(), self.stages.end().w);
        let change = &mut self.at_end.change;
        change.fill(0.0);
        for k in 0..split {
            let [first, last] = [step.w, end].map(|w| w[split + k].abs());
            let mean = (end[k] - step.w[k]).abs() / step.h;
            change[split + k] = first.max(last).max(mean);
        }
        let of_rates = ode.error_norm(change, end);
        let (positions, rates) = change.split_at_mut(split);
        for (position, rate) in positions.iter_mut().zip(rates) {
            *position = 0.125 * step.h * std::mem::take(rate);
        }
        // Written so that a NaN is left alone.
        let counts = ode.error_norm(change, end) > of_rates.max(1.0);
        if !counts {
            return 0.0;
        }
        let left = self.balance_middle(ode, step);
        // What was evaluated last is the end, as it would be without this; what is wrong there shows where the step is taken.
        let _ = ode.derivative(step.t + step.h, self.stages.end().w, &mut self.at_end.slope);
        left.unwrap_or(f64::INFINITY)
    }

    /// [`Self::balance_inside`] where it counts.
    fn balance_middle(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        let middle = self.find_defect_at(0.5, ode, step)?;
        // Where the dense output passes through stages that are in balance, there is nothing to correct.
        if self.stages.collocation_places().is_some() {
            return Ok(middle);
        }
        if middle <= 1.0 {
            return Ok(middle.max(self.find_defect_at(0.25, ode, step)?));
        }
        // Rates stay: they add up to what positions change by, or the work of forces would not be that of the motion.
        let split = ode.second_order_split();
        self.at_end.defect[split..2 * split].fill(0.0);
        self.current.bulge(&self.at_end.defect);
        self.find_defect_at(0.25, ode, step)
    }

    /// What would bring the dense output into balance at θ, as far as the matrix tells. Returns its scaled size.
    fn find_defect_at(
        &mut self,
        theta: f64,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        self.evaluate_defect_at(theta, ode, step)?;
        let Self { stages, at_end: AtEnd { defect, .. }, .. } = self;
        stages.filter(ode, defect);
        Ok(ode.error_norm(defect, stages.end().w))
    }

    /// γh (g − u̇) at θ.
    fn evaluate_defect_at(
        &mut self,
        theta: f64,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<(), EvaluationFailure> {
        let Self { stages, at_end: AtEnd { defect, state, slope, .. }, current, .. } = self;
        current.interpolate(theta, state);
        current.slope_beyond((theta - 1.0) * step.h, slope);
        ode.derivative(step.t + theta * step.h, state, defect)?;
        let gamma_h = stages.gamma() * step.h;
        for (defect, slope) in defect.iter_mut().zip(&*slope) {
            *defect = gamma_h * (*defect - slope);
        }
        Ok(())
    }
}
