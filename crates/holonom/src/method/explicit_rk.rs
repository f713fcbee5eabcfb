//! Stepper of explicit Runge-Kutta pairs: DOPRI5, DOP853.

use crate::control::{StepControl, StepHistory, StepVerdict};
use crate::formula::ExplicitRungeKutta;
use crate::method::ode::{EvaluationFailure, LinearizedOde};
use crate::method::stepper::{
    Norm, Rejection, Slope, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics,
    add_scaled,
};
use std::ops::Range;

/// Terms of dense output that follow from the ends of a step.
const OF_ENDS: usize = 3;
/// Parts of a step at which dense output is held against the equations: the cubic polynomial of the ends misses their slope most there.
/// The second one where the first does not tell, as where something sudden is there.
const LOOKED_AT: [f64; 2] = [0.21, 0.79];
/// Part of the defect of all terms that that of the first ones must be, to be taken instead.
const BETTER: f64 = 0.1;
/// The largest degree of dense output.
const LARGEST_DEGREE: usize = 7;

/// An accepted step: start, difference of the ends, and the further terms of dense output.
#[derive(Debug, Clone)]
struct Segment {
    start: Vec<f64>,
    end: Vec<f64>,
    slope: Vec<f64>,
    /// Δ, hk₁ − Δ, 2Δ − hk₁ − hg₁ and the Dₘ of the formula.
    terms: Vec<Vec<f64>>,
}

impl Segment {
    fn new(n: usize, terms: usize) -> Self {
        let vector = || vec![0.0; n];
        let terms = (0..terms).map(|_| vector()).collect();
        Self { start: vector(), end: vector(), slope: vector(), terms }
    }
}

/// Stepper of an explicit Runge-Kutta pair.
#[derive(Debug, Clone)]
pub struct ExplicitRungeKuttaStepper {
    formula: &'static ExplicitRungeKutta,
    options: StepperOptions,
    control: StepControl,
    history: StepHistory,
    history_before: StepHistory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    /// The step of it, from where to where, whose stages are kept for dense output.
    open: Option<(f64, f64)>,
    k: Vec<Vec<f64>>,
    state: Vec<f64>,
    work: Vec<f64>,
    room: Vec<f64>,
    error_at_kinks: f64,
    strictness: f64,
    current: Segment,
    previous: Segment,
    statistics: StepperStatistics,
}

impl ExplicitRungeKuttaStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(
        formula: &'static ExplicitRungeKutta,
        dimension: usize,
        options: StepperOptions,
    ) -> Self {
        let vector = || vec![0.0; dimension];
        Self {
            formula,
            options,
            control: StepControl::explicit(formula.embedded_order),
            history: StepHistory::default(),
            history_before: StepHistory::default(),
            pending: false,
            open: None,
            k: formula.a.iter().map(|_| vector()).collect(),
            state: vector(),
            work: vector(),
            room: vector(),
            error_at_kinks: formula.error_at_kinks(),
            strictness: 1.0,
            current: Segment::new(dimension, OF_ENDS + formula.d.len()),
            previous: Segment::new(dimension, OF_ENDS + formula.d.len()),
            statistics: StepperStatistics::default(),
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        self.open = None;
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
        }
    }

    /// The last accepted step.
    fn last(&self) -> &Segment {
        if self.pending { &self.current } else { &self.previous }
    }

    /// The slopes `stages` of the step h from (t, w).
    fn evaluate(
        &mut self,
        slope: &mut Slope<'_>,
        t: f64,
        h: f64,
        w: &[f64],
        stages: Range<usize>,
    ) -> Result<(), EvaluationFailure> {
        for i in stages {
            self.state.copy_from_slice(w);
            for (k, a) in self.k.iter().zip(self.formula.a[i]) {
                add_scaled(&mut self.state, h * a, k);
            }
            self.statistics.derivatives += 1;
            slope(t + self.formula.c[i] * h, &self.state, &mut self.k[i])?;
        }
        Ok(())
    }

    /// All stages and their judgement; `state` is then the end of the step.
    fn advance(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> Result<(f64, StepVerdict), Rejection> {
        let formula = self.formula;
        self.k[0].copy_from_slice(g);
        let slope = &mut |t: f64, w: &[f64], g: &mut [f64]| ode.derivative(t, w, g);
        self.evaluate(slope, t, h, w, 1..formula.end + 1).map_err(Rejection::Evaluation)?;
        if let Some(lower) = formula.lower {
            combine(&mut self.work, h, lower, &self.k);
            let lower = ode.norm(&self.work);
            combine(&mut self.work, h, formula.e, &self.k);
            let part = ExplicitRungeKutta::part(ode.norm(&self.work), lower);
            self.work.iter_mut().for_each(|x| *x *= part);
        } else {
            combine(&mut self.work, h, formula.e, &self.k);
        }
        let error = self.options.caution * self.strictness * ode.norm(&self.work);
        if self.options.fixed_step && error.is_finite() {
            return Ok((error, StepVerdict::Accept { next: h }));
        }
        Ok((error, self.control.judge(h, error, &self.history)))
    }

    /// h|λ| of what is fastest, from the two slopes at the end of a step, and the size that the system has there:
    /// the smaller one of ‖Δk‖/‖Δw‖ of rates and, as λ², of positions, whose second derivatives k of rates are.
    fn fastness(&mut self, ode: &mut dyn LinearizedOde, h: f64) -> f64 {
        let split = ode.second_order_split();
        let rates = if split == 0 { 0..self.state.len() } else { split..2 * split };
        let ExplicitRungeKutta { a, end, .. } = *self.formula;
        let (last, before) = (a[end], a[end - 1]);
        let Self { k, room, .. } = self;
        let change = |i: usize| {
            let weights = last.iter().enumerate();
            weights.map(|(j, b)| (b - before.get(j).unwrap_or(&0.0)) * k[j][i]).sum::<f64>()
        };
        // All as rates, so that what they count does not depend on units.
        let mut size = |of: &dyn Fn(usize) -> f64| {
            room.fill(0.0);
            rates.clone().for_each(|i| room[i] = of(i));
            ode.norm(room)
        };
        let slopes = size(&|i| k[end][i] - k[end - 1][i]);
        let plain = slopes / size(&|i| h * change(i));
        if split == 0 {
            return h * plain;
        }
        h * plain.min((slopes / size(&|i| h * change(i - split))).sqrt())
    }

    /// How far the polynomial of the first terms misses the slope of the equations inside the step just accepted, as a
    /// change over it; infinite where there is none. Source: `docs/theory/formula.md` (16b).
    fn defect(
        &mut self,
        terms: usize,
        slope: &mut Slope<'_>,
        norm: &mut Norm<'_>,
        (t, h): (f64, f64),
        theta: f64,
    ) -> f64 {
        let [mut w, mut rate, mut found] = [1, 2, 3].map(|k| std::mem::take(&mut self.k[k]));
        w.fill(0.0);
        rate.fill(0.0);
        for (m, term) in self.current.terms[..terms].iter().enumerate().rev() {
            let (factor, sign) = if m % 2 == 0 { (theta, 1.0) } else { (1.0 - theta, -1.0) };
            for ((w, rate), term) in w.iter_mut().zip(&mut rate).zip(term) {
                let inner = *w + term;
                *rate = sign * inner + factor * *rate;
                *w = factor * inner;
            }
        }
        add_scaled(&mut w, 1.0, &self.current.start);
        self.statistics.derivatives += 1;
        let outcome = slope(t + theta * h, &w, &mut found);
        add_scaled(&mut rate, -h, &found);
        let defect = if outcome.is_ok() { norm(&rate) } else { f64::INFINITY };
        [self.k[1], self.k[2], self.k[3]] = [w, rate, found];
        defect
    }

    /// Stores the end of the step, and its dense output where no further stages are needed.
    fn finish(&mut self, t: f64, h: f64, w: &[f64]) {
        let formula = self.formula;
        let Segment { start, end, slope, terms } = &mut self.current;
        start.copy_from_slice(w);
        end.copy_from_slice(&self.state);
        slope.copy_from_slice(&self.k[formula.end]);
        let [difference, second, third, further @ ..] = &mut terms[..] else { return };
        for i in 0..w.len() {
            difference[i] = self.state[i] - w[i];
            second[i] = h * self.k[0][i] - difference[i];
            third[i] = difference[i] - h * slope[i] - second[i];
        }
        if formula.a.len() == formula.end + 1 {
            for (term, d) in further.iter_mut().zip(formula.d) {
                combine(term, h, d, &self.k);
            }
        } else {
            self.open = Some((t, h));
        }
        self.pending = true;
    }
}

/// h Σ weightᵢ kᵢ
fn combine(sum: &mut [f64], h: f64, weights: &[f64], k: &[Vec<f64>]) {
    sum.fill(0.0);
    for (k, &weight) in k.iter().zip(weights) {
        add_scaled(sum, h * weight, k);
    }
}

impl Stepper for ExplicitRungeKuttaStepper {
    fn order(&self) -> u32 {
        self.formula.order
    }

    fn starting_order(&self) -> u32 {
        self.formula.embedded_order
    }

    /// Estimates count whole: steps are so long that the error of the formula is no small part of them.
    fn orders_of_error(&self) -> [u32; 2] {
        [self.formula.order; 2]
    }

    fn explicit(&self) -> bool {
        true
    }

    fn evaluations(&self) -> u64 {
        self.formula.end as u64
    }

    fn restart(&mut self) {
        self.invalidate();
        self.history = StepHistory::default();
    }

    fn invalidate(&mut self) {
        self.commit();
    }

    fn begin_trend(&mut self, h: f64) {
        self.history.accept(h, 1.0);
    }

    fn discard(&mut self) {
        self.open = None;
        if std::mem::take(&mut self.pending) {
            self.history = self.history_before;
        }
    }

    fn attempt(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> StepReport {
        self.commit();
        self.history_before = self.history;
        let mut report = StepReport::rejected(0.5 * h);
        match self.advance(ode, t, h, w, g) {
            Ok((error, StepVerdict::Accept { next })) => {
                self.finish(t, h, w);
                self.history.accept(h, error);
                report.accept(error, next.min(self.options.max_step));
                // What may grow is not held by anything.
                if !self.options.fixed_step
                    && next < 2.0 * h
                    && self.fastness(ode, h) > self.formula.stiff
                {
                    self.statistics.stiff_steps += 1;
                }
            }
            Ok((error, StepVerdict::Reject { retry })) => {
                (report.error, report.next_step) = (error, retry);
                report.cause = Some(Rejection::ErrorTooLarge);
            }
            Err(cause) => report.cause = Some(cause),
        }
        if !report.accepted {
            self.history.reject();
        }
        report
    }

    fn end(&self) -> StepEnd<'_> {
        let last = self.last();
        StepEnd { w: &last.end, slope: &last.slope }
    }

    /// Steps that something stiff holds back end in what it damps, but slopes inside them may tell nothing of the motion: where the
    /// cubic polynomial through both ends misses the equations by far less, it is the dense output.
    fn complete_step(
        &mut self,
        slope: &mut Slope<'_>,
        norm: &mut Norm<'_>,
    ) -> Result<(), EvaluationFailure> {
        let Some((t, h)) = self.open.take() else { return Ok(()) };
        let formula = self.formula;
        let start = std::mem::take(&mut self.current.start);
        let found = self.evaluate(slope, t, h, &start, formula.end + 1..formula.a.len());
        self.current.start = start;
        for (term, d) in self.current.terms[OF_ENDS..].iter_mut().zip(formula.d) {
            combine(term, h, d, &self.k);
        }
        if found.is_ok() {
            for theta in LOOKED_AT {
                let all = self.defect(self.current.terms.len(), slope, norm, (t, h), theta);
                if all <= 1.0 {
                    break;
                }
                let mut better = || self.defect(OF_ENDS, slope, norm, (t, h), theta) < BETTER * all;
                if all.is_nan() || better() {
                    self.current.terms[OF_ENDS..].iter_mut().for_each(|term| term.fill(0.0));
                    break;
                }
            }
        }
        found
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        let Segment { start, terms, .. } = self.last();
        w.fill(0.0);
        for (m, term) in terms.iter().enumerate().rev() {
            let factor = if m % 2 == 0 { theta } else { 1.0 - theta };
            w.iter_mut().zip(term).for_each(|(w, term)| *w = factor * (*w + term));
        }
        w.iter_mut().zip(start).for_each(|(w, start)| *w += start);
    }

    fn largest_degree(&self) -> usize {
        self.last().terms.len()
    }

    /// [`Stepper::interpolate`] from the inside out: times θ, or times 1 − θ.
    fn polynomial(&self, coefficients: &mut [f64]) -> usize {
        let Segment { start, terms, .. } = self.last();
        let (n, degree) = (start.len(), terms.len());
        for i in 0..n {
            let mut powers = [0.0; LARGEST_DEGREE + 1];
            for (m, term) in terms.iter().enumerate().rev() {
                powers[0] += term[i];
                for k in (0..degree).rev() {
                    let product = powers[k];
                    powers[k + 1] = if m % 2 == 0 { product } else { powers[k + 1] - product };
                }
                if m % 2 == 0 {
                    powers[0] = 0.0;
                }
            }
            powers[0] += start[i];
            for (j, x) in powers[..=degree].iter().enumerate() {
                coefficients[j * n + i] = *x;
            }
        }
        degree
    }

    fn error_at_kinks(&self) -> f64 {
        self.error_at_kinks
    }

    fn last_change(&self) -> &[f64] {
        &self.work
    }

    fn shorten(&mut self, by: f64) {
        self.strictness = by.powi(self.formula.embedded_order as i32 + 1);
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
