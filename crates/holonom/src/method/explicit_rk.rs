//! Stepper of explicit Runge-Kutta pairs: DOPRI5.

use crate::control::{StepControl, StepHistory, StepVerdict};
use crate::formula::{ExplicitRungeKutta, error_at_kinks};
use crate::method::ode::LinearizedOde;
use crate::method::stepper::{
    Rejection, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics, add_scaled,
};

const STAGES: usize = 7;
/// h|λ| beyond which steps are unstable where λ is real: a step there is held by stability (Hairer & Wanner,
/// *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section IV.2).
const STIFF: f64 = 3.25;

/// An accepted step: start, difference of the ends, and the further terms of dense output.
#[derive(Debug, Clone)]
struct Segment {
    start: Vec<f64>,
    end: Vec<f64>,
    slope: Vec<f64>,
    /// Δ, hk₁ − Δ, 2Δ − hk₁ − hk₇, h Σ dᵢ kᵢ.
    terms: [Vec<f64>; 4],
}

impl Segment {
    fn new(n: usize) -> Self {
        let vector = || vec![0.0; n];
        let terms = std::array::from_fn(|_| vector());
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
    k: [Vec<f64>; STAGES],
    state: Vec<f64>,
    work: Vec<f64>,
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
            k: std::array::from_fn(|_| vector()),
            state: vector(),
            work: vector(),
            error_at_kinks: error_at_kinks(&formula.c, &formula.a[STAGES - 1], &formula.e),
            strictness: 1.0,
            current: Segment::new(dimension),
            previous: Segment::new(dimension),
            statistics: StepperStatistics::default(),
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
        }
    }

    /// The last accepted step.
    fn last(&self) -> &Segment {
        if self.pending { &self.current } else { &self.previous }
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
        self.k[0].copy_from_slice(g);
        for i in 1..STAGES {
            self.state.copy_from_slice(w);
            for (j, k) in self.k[..i].iter().enumerate() {
                add_scaled(&mut self.state, h * self.formula.a[i][j], k);
            }
            self.statistics.derivatives += 1;
            ode.derivative(t + self.formula.c[i] * h, &self.state, &mut self.k[i])
                .map_err(Rejection::Evaluation)?;
        }
        Self::combine(&mut self.work, h, &self.formula.e, &self.k);
        let error = self.options.caution * self.strictness * ode.norm(&self.work);
        if self.options.fixed_step && error.is_finite() {
            return Ok((error, StepVerdict::Accept { next: h }));
        }
        Ok((error, self.control.judge(h, error, &self.history)))
    }

    fn combine(work: &mut [f64], h: f64, weights: &[f64; STAGES], k: &[Vec<f64>; STAGES]) {
        work.fill(0.0);
        for (k, &weight) in k.iter().zip(weights) {
            add_scaled(work, h * weight, k);
        }
    }

    /// h|λ| of what is fastest, from the two slopes at the end of a step, and the size that the system has there:
    /// the smaller one of |Δk|/|Δw| of rates and, as λ², of positions, whose second derivatives k of rates are.
    fn fastness(&self, h: f64, split: usize) -> f64 {
        let rates = if split == 0 { 0..self.state.len() } else { split..2 * split };
        let a = &self.formula.a;
        let [mut slopes, mut changes, mut positions] = [0.0; 3];
        let change = |i: usize| {
            (0..STAGES - 1)
                .map(|j| (a[STAGES - 1][j] - a[STAGES - 2][j]) * self.k[j][i])
                .sum::<f64>()
        };
        for i in rates {
            slopes += (self.k[STAGES - 1][i] - self.k[STAGES - 2][i]).powi(2);
            changes += (h * change(i)).powi(2);
            positions += (h * change(i.wrapping_sub(split))).powi(2);
        }
        let plain = (slopes / changes).sqrt();
        let second = if split == 0 { plain } else { (slopes / positions).sqrt().sqrt() };
        h * plain.min(second)
    }

    /// Stores the end of the step and its dense output.
    fn finish(&mut self, h: f64, w: &[f64]) {
        let Segment { start, end, slope, terms } = &mut self.current;
        start.copy_from_slice(w);
        end.copy_from_slice(&self.state);
        slope.copy_from_slice(&self.k[STAGES - 1]);
        let [difference, second, third, fourth] = terms;
        for i in 0..w.len() {
            difference[i] = self.state[i] - w[i];
            second[i] = h * self.k[0][i] - difference[i];
            third[i] = difference[i] - h * slope[i] - second[i];
        }
        Self::combine(fourth, h, &self.formula.d, &self.k);
        self.pending = true;
    }
}

impl Stepper for ExplicitRungeKuttaStepper {
    fn order(&self) -> u32 {
        self.formula.order
    }

    fn starting_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn explicit(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.invalidate(false);
        self.history = StepHistory::default();
    }

    fn invalidate(&mut self, _keep_history: bool) {
        self.commit();
    }

    fn discard(&mut self) {
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
                self.finish(h, w);
                self.history.accept(h, error);
                report.accept(error, next.min(self.options.max_step));
                // What may grow is not held by anything.
                if !self.options.fixed_step
                    && next < 2.0 * h
                    && self.fastness(h, ode.second_order_split()) > STIFF
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
        self.statistics.count(report.cause.as_ref());
        report
    }

    fn end(&self) -> StepEnd<'_> {
        let last = self.last();
        StepEnd { w: &last.end, slope: &last.slope }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        let Segment { start, terms: [a, b, c, d], .. } = self.last();
        let rest = 1.0 - theta;
        for (i, w) in w.iter_mut().enumerate() {
            *w = start[i] + theta * (a[i] + rest * (b[i] + theta * (c[i] + rest * d[i])));
        }
    }

    fn largest_degree(&self) -> usize {
        4
    }

    fn polynomial(&self, coefficients: &mut [f64]) -> usize {
        let Segment { start, terms: [a, b, c, d], .. } = self.last();
        let n = start.len();
        for i in 0..n {
            let powers = [start[i], a[i] + b[i], c[i] + d[i] - b[i], -(c[i] + 2.0 * d[i]), d[i]];
            for (j, x) in powers.into_iter().enumerate() {
                coefficients[j * n + i] = x;
            }
        }
        4
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
