//! The inside of a step of an implicit formula: its dense output is brought to where the equations are, as far as stages, the step
//! before and evaluations tell. Source: `docs/theory/method.md` (13) to (15).

use super::attempt::{AtEnd, ImplicitStepper, Inside};
use super::balance::Balance;
use super::counted::Counted;
use super::ode::EvaluationFailure;
use super::stages::{Stages, Step, keep_stiff};
use crate::math::vector::larger;

/// Tolerances that stiff rates may be off where they are looked at and nothing but the length of steps makes them better. One rate
/// alone counts half in a norm, and places that are looked at need not be the worst: rows are within about four times that, by the speed there.
const ROWS: f64 = 15.0;
/// By how many tolerances the next power is at least missed where rates may be off by [`ROWS`]: in steps as long as the one before, stages of
/// vibrations with up to six radians in a step miss about an eighth of what these are off inside, wherever in a period they are.
const TELLS: f64 = ROWS / 8.0;
/// What much shorter steps before miss falls with their length.
const SHORTER: f64 = 0.5;

impl<S: Stages> ImplicitStepper<S> {
    /// All that is done about the inside of a step that is accepted otherwise.
    pub(super) fn settle_inside(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> Inside {
        let stages = self.correct_inside(ode, step.h);
        let between = larger(stages, self.miss_between(ode, step));
        let middle = self.balance_inside(ode, step);
        // What cannot be evaluated inside is found where the step is taken.
        let parabolas = larger(middle, self.bend_rates(ode, step).unwrap_or(0.0));
        // A parabola is off like the third power of the step.
        let of_output = between.powf(1.0 / (S::DEGREE + 1) as f64);
        Inside { off: larger(between, parabolas), ratio: 0.9 / larger(of_output, parabolas.cbrt()) }
    }

    /// Leads the dense output through stages less their errors, where these are known. Returns how far off it is left between them,
    /// scaled. Source: `docs/theory/method.md` (14).
    fn correct_inside(&mut self, ode: &mut Counted<'_>, h: f64) -> f64 {
        let left = &mut self.at_end.change;
        if !(self.knows_own || self.stages.own_error(ode, h, left)) {
            return 0.0;
        }
        self.stages.correct_inside(ode, &mut self.current, left);
        ode.error_norm(left, self.stages.end().w)
    }

    /// How far off stiff rates are between the places that they are led through, scaled and over [`ROWS`], if they may be off by that at all.
    /// Source: `docs/theory/method.md` (15), (15a).
    fn miss_between(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) -> f64 {
        // A step that is not refused need not be looked at.
        let Some(balance) = self.balance.filter(|_| !self.options.fixed_step) else { return 0.0 };
        let may_miss = if self.predicts {
            self.goes_on_otherwise(&balance, ode, step)
        } else {
            self.change_stiffly(&balance, ode, step)
        };
        if !may_miss {
            return 0.0;
        }
        let miss = self.find_miss(&balance, ode, step).unwrap_or(f64::INFINITY);
        // What was evaluated last is the end, as it would be without this; what is wrong there shows where the step is taken.
        let _ = ode.derivative(step.t + step.h, self.stages.end().w, &mut self.at_end.slope);
        miss / ROWS
    }

    /// Whether the polynomial of the step, continued to two places of the one before, misses it there by as much as the next power
    /// would if it were [`TELLS`] tolerances inside, in stiff rates. Two, as one is met by chance.
    fn goes_on_otherwise(
        &mut self,
        balance: &Balance,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> bool {
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        let Self { stages, previous, current, at_end, .. } = self;
        let AtEnd { change, state, answer, .. } = at_end;
        let mut miss = |ode: &mut Counted<'_>, keeps_stiff: bool| {
            let of = |place: f64| {
                let theta = (place - 1.0) * previous.step / step.h;
                previous.interpolate(place, answer);
                current.interpolate(theta, state);
                let weight = balance.most(theta);
                change.fill(0.0);
                for k in rates.clone() {
                    change[k] = weight * (state[k] - answer[k]);
                }
                if keeps_stiff {
                    keep_stiff(change, state, |x| stages.filter(ode, x));
                }
                ode.error_norm(change, stages.end().w)
            };
            balance.last.map(of).into_iter().fold(0.0, f64::hypot)
        };
        let tells = TELLS * (previous.step / (SHORTER * step.h)).min(1.0);
        // Written so that a NaN is left alone.
        miss(ode, false) > tells && miss(ode, true) > tells
    }

    /// Whether stiff rates change by more than [`ROWS`] tolerances up to one of the last places, where no step before tells.
    fn change_stiffly(
        &mut self,
        balance: &Balance,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> bool {
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        let Self { stages, current, at_end: AtEnd { change, state, .. }, .. } = self;
        balance.last.into_iter().chain([1.0]).any(|place| {
            current.interpolate(place, state);
            change.fill(0.0);
            for k in rates.clone() {
                change[k] = state[k] - step.w[k];
            }
            let mut counts = ode.error_norm(change, stages.end().w) > ROWS;
            if counts {
                keep_stiff(change, state, |x| stages.filter(ode, x));
                counts = ode.error_norm(change, stages.end().w) > ROWS;
            }
            counts
        })
    }

    /// How far stiff rates are from balance between places, scaled.
    fn find_miss(
        &mut self,
        balance: &Balance,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        let mut miss = 0.0;
        for theta in balance.between {
            self.evaluate_defect_at(theta, ode, step)?;
            let Self { stages, at_end: AtEnd { defect, state, .. }, .. } = self;
            miss = larger(miss, stiff_rates(stages, ode, defect, state));
            let is_right = miss <= ROWS;
            if !is_right {
                break;
            }
        }
        Ok(miss)
    }

    /// Brings the middle of rates that the dense output takes for lines into balance where they are stiff and bend by more than
    /// the tolerance: they follow forces and not what came before, and no estimate sees what they do inside. How much they bend is told by
    /// the step before; without one, by their change. Returns how far off they are left beside the middle, scaled and over [`ROWS`].
    /// Source: `docs/theory/method.md` (13), (14a), behind (14).
    fn bend_rates(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        if !self.stages.rates_are_lines() {
            return Ok(0.0);
        }
        let mut bend = self.bend(self.predicts, ode, step);
        // What follows forces may bend where two steps are in line.
        if self.predicts && self.memory.rates_follow {
            bend = larger(bend, self.bend(false, ode, step));
        }
        // Written so that a NaN is left alone.
        let counts = bend > 1.0;
        if !counts {
            return Ok(0.0);
        }
        let bent = self.bend_middle(ode, step);
        self.memory.rates_follow = bend > TELLS && matches!(bent, Ok(true));
        let left = match bent {
            Ok(_) if self.memory.rates_follow && !self.options.fixed_step => {
                self.left_beside_middle(ode, step)
            }
            bent => bent.map(|_| 0.0),
        };
        // What was evaluated last is the end, as it would be without this.
        ode.derivative(step.t + step.h, self.stages.end().w, &mut self.at_end.slope)?;
        left.map(|left| left / ROWS)
    }

    /// How far stiff rates may be from lines in the middle, scaled: as the step `before` says, or by their change.
    fn bend(&mut self, before: bool, ode: &mut Counted<'_>, step: &Step<'_>) -> f64 {
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        let Self { stages, at_end: AtEnd { change, state, slope, answer, .. }, .. } = self;
        self.current.slope_beyond(0.0, slope);
        let mut weight = 0.125 * step.h;
        answer.fill(0.0);
        if before {
            weight = 0.25 * step.h * step.h / (step.h + self.previous.step);
            // What was bent there has no slope in its middle.
            self.previous.slope_beyond(-0.5 * self.previous.step, answer);
        }
        change.fill(0.0);
        for k in rates {
            change[k] = weight * (slope[k] - answer[k]);
        }
        let bend = ode.error_norm(change, stages.end().w);
        if bend > 1.0 {
            keep_stiff(change, state, |x| stages.filter(ode, x));
            return ode.error_norm(change, stages.end().w);
        }
        bend
    }

    /// How far stiff rates are from balance a quarter and three quarters into the step, scaled, beyond the parabola of what they are at both
    /// ends and in the middle, where they are in it: a formula that does not damp leaves ends off balance, and that is no matter of the inside.
    fn left_beside_middle(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<f64, EvaluationFailure> {
        let rates = ode.second_order_split()..2 * ode.second_order_split();
        self.at_end.change.fill(0.0);
        self.at_end.answer.fill(0.0);
        for (theta, first, second) in
            [(0.0, -0.375, 0.125), (0.25, 1.0, 0.0), (0.75, 0.0, 1.0), (1.0, 0.125, -0.375)]
        {
            self.evaluate_defect_at(theta, ode, step)?;
            let AtEnd { change, answer, defect, .. } = &mut self.at_end;
            for k in rates.clone() {
                change[k] += first * defect[k];
                answer[k] += second * defect[k];
            }
        }
        let Self { stages, at_end: AtEnd { change, answer, state, .. }, .. } = self;
        let [first, second] =
            [change, answer].map(|defect| stiff_rates(stages, ode, defect, state));
        Ok(larger(first, second))
    }

    /// [`Self::bend_rates`] where it counts. Forces that do not answer to rates leave the defect of these as it was, and rates are not what balances
    /// them: an undamped vibration is no such motion, and is left alone. Returns whether rates are bent.
    fn bend_middle(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<bool, EvaluationFailure> {
        let n = ode.second_order_split();
        let before = self.defect_of_rates(ode, step)?;
        let Self { stages, at_end: AtEnd { defect, change, .. }, .. } = self;
        stages.filter(ode, defect);
        defect[..n].fill(0.0);
        defect[2 * n..].fill(0.0);
        change.copy_from_slice(defect);
        if !ode.error_norm(change, stages.end().w).is_finite() {
            return Ok(false);
        }
        self.current.bulge(&self.at_end.change);
        let answers = self.defect_of_rates(ode, step).map(|after| after <= 0.5 * before);
        if !matches!(answers, Ok(true)) {
            self.at_end.change.iter_mut().for_each(|x| *x = -*x);
            self.current.bulge(&self.at_end.change);
        }
        answers
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

/// Scaled size of the stiff rates that would bring a `defect` into balance, as far as the matrix tells: (I − F)² F of it, which is left there.
fn stiff_rates<S: Stages>(
    stages: &mut S,
    ode: &mut Counted<'_>,
    defect: &mut [f64],
    room: &mut [f64],
) -> f64 {
    let n = ode.second_order_split();
    stages.filter(ode, defect);
    keep_stiff(defect, room, |x| stages.filter(ode, x));
    defect[..n].fill(0.0);
    defect[2 * n..].fill(0.0);
    ode.error_norm(defect, stages.end().w)
}
