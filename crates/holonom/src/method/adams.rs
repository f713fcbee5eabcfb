//! Stepper of Adams formulas of variable order (1 to 12) and step in PECE mode: DEABM.
//!
//! Order and step selection of Shampine & Gordon, *Computer Solution of Ordinary Differential
//! Equations* (1975), chapter 7: local extrapolation, estimates at orders k−2 … k+1, doubling at
//! the start, steps kept constant unless they can be doubled or must shrink. Two evaluations per
//! step, of which the second tells also what the first correction has left: `docs/theory/formula.md` (15a).

use super::adams_history::History;
use crate::formula::{ADAMS_GAMMA_STAR, ADAMS_MAX_ORDER, AdamsCoefficients};
use crate::method::ode::LinearizedOde;
use crate::method::stepper::{
    Rejection, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics, add_scaled,
};

/// A refused step is made shorter by this factor at most: an error estimate of a step that is far too
/// long says little.
const LEAST_RATIO: f64 = 0.01;
/// Steps at order 4 or less, or whose error one correction has left, after which stiffness is suspected.
const STIFF_STEPS: u32 = 50;

/// Outcome of a step that could be computed.
struct Judgement {
    error: f64,
    accepted: bool,
    /// Order and length of the next step or attempt.
    order: usize,
    step: f64,
}

/// Stepper of Adams PECE formulas.
#[derive(Debug, Clone)]
pub struct AdamsStepper {
    options: StepperOptions,
    /// Up to the start of the step.
    history: History,
    /// Up to its end.
    trial: History,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    failures: u32,
    predicted: Vec<f64>,
    /// Of the slope there from the predicted one, then the estimated error.
    difference: Vec<f64>,
    /// Whether the estimated error is what one correction has left, (15a), and not that of a lower order, (15).
    unfinished: bool,
    work: Vec<f64>,
    slope: Vec<f64>,
    shortening: f64,
    statistics: StepperStatistics,
}

impl AdamsStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(dimension: usize, options: StepperOptions) -> Self {
        let vector = || vec![0.0; dimension];
        Self {
            options,
            history: History::new(dimension),
            trial: History::new(dimension),
            pending: false,
            failures: 0,
            predicted: vector(),
            difference: vector(),
            unfinished: false,
            work: vector(),
            slope: vector(),
            shortening: 1.0,
            statistics: StepperStatistics::default(),
        }
    }

    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.history, &mut self.trial);
            self.failures = 0;
        }
    }

    /// The last accepted step.
    fn last(&self) -> &History {
        if self.pending { &self.trial } else { &self.history }
    }

    /// What norms of differences are multiplied by before they are judged.
    fn caution(&self) -> f64 {
        self.options.caution * self.shortening.powi(self.trial.order as i32 + 1)
    }

    /// Norm of the difference d plus a column of φ.
    fn norm_with(&mut self, ode: &mut dyn LinearizedOde, column: usize) -> f64 {
        let phi = &self.trial.phi[column];
        for ((work, &d), &phi) in self.work.iter_mut().zip(&self.difference).zip(phi) {
            *work = d + phi;
        }
        self.caution() * ode.norm(&self.work)
    }

    /// Predicts, evaluates, estimates and, if the error allows, corrects and evaluates again.
    fn advance(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
    ) -> Result<Judgement, Rejection> {
        self.trial.copy_from(&self.history);
        let trial = &mut self.trial;
        let k = trial.order;
        if h != trial.last_step {
            trial.same_steps = 0;
        }
        if trial.same_steps <= trial.last_order {
            trial.same_steps += 1;
        }
        let c = AdamsCoefficients::new(k, h, &trial.psi);

        // Predict: column i becomes φᵖᵢ, column k+1 keeps φ_{k+1}(n) for the estimate at k+1.
        trial.phi.swap(k, k + 1);
        self.predicted.copy_from_slice(w);
        for i in 0..k {
            let beta = c.beta[i];
            if beta != 1.0 {
                trial.phi[i].iter_mut().for_each(|phi| *phi *= beta);
            }
            add_scaled(&mut self.predicted, h * c.g[i], &trial.phi[i]);
        }
        for i in (1..k).rev() {
            let (low, high) = trial.phi.split_at_mut(i);
            add_scaled(&mut low[i - 1], 1.0, &high[0]);
        }
        self.statistics.derivatives += 1;
        ode.derivative(t + h, &self.predicted, &mut self.difference)
            .map_err(Rejection::Evaluation)?;
        add_scaled(&mut self.difference, -1.0, &trial.phi[0]);

        // Errors at orders k, k−1, k−2; lower orders must win clearly.
        let size = self.caution() * h * ode.norm(&self.difference);
        let error = size * (c.g[k - 1] - c.g[k]);
        let at_k = size * c.sigma[k] * ADAMS_GAMMA_STAR[k].abs();
        let weight = |m: usize| h * c.sigma[m] * ADAMS_GAMMA_STAR[m].abs();
        let mut below = 0.0;
        let mut order = k;
        let mut rest = 1.0;
        if k >= 2 {
            let lower = h * self.norm_with(ode, k - 1);
            rest = rest_of_series(size / lower, (c.g[0] - c.g[1]) / (c.g[k - 1] - c.g[k]));
            below = weight(k - 1) / h * lower;
            let lower = if k == 2 {
                below <= 0.5 * at_k
            } else {
                below <= at_k && weight(k - 2) * self.norm_with(ode, k - 2) <= at_k
            };
            if lower {
                order = k - 1;
            }
        }
        let error = rest * error;
        let acceptable = error <= 1.0 || (self.options.fixed_step && error.is_finite());
        let part = rest * h * (c.g[k - 1] - c.g[k]);
        if !acceptable {
            scale(&mut self.difference, part);
            return Ok(self.after_failure(h, error, rest * at_k, order));
        }

        let trial = &mut self.trial;
        trial.end.copy_from_slice(&self.predicted);
        add_scaled(&mut trial.end, h * c.g[k], &self.difference);
        self.statistics.derivatives += 1;
        ode.derivative(t + h, &trial.end, &mut self.slope).map_err(Rejection::Evaluation)?;
        // Against what another correction would make of the end.
        let slopes = self.slope.iter().zip(&trial.phi[0]).zip(&self.difference);
        for (work, ((&slope, &phi), &d)) in self.work.iter_mut().zip(slopes) {
            *work = h * c.g[k] * (d - (slope - phi));
        }
        let left = ode.norm(&self.work);
        scale(&mut self.difference, part);
        self.unfinished = left > error;
        if self.unfinished {
            std::mem::swap(&mut self.difference, &mut self.work);
            if left > 1.0 && !self.options.fixed_step {
                return Ok(self.after_failure(h, left, rest * at_k, order));
            }
        }
        let trial = &mut self.trial;
        // Differences of the slopes up to the new one.
        for (i, &slope) in self.slope.iter().enumerate() {
            let new = slope - trial.phi[0][i];
            trial.phi[k + 1][i] = new - trial.phi[k + 1][i];
            trial.phi[k][i] = new;
            for column in trial.phi.iter_mut().take(k) {
                column[i] += new;
            }
        }
        trial.psi = c.psi;
        (trial.last_order, trial.last_step) = (k, h);
        trial.suspect = if k > 4 && !self.unfinished { 0 } else { trial.suspect + 1 };
        Ok(self.after_success(ode, h, k, order, [error, left, rest], at_k, below))
    }

    /// Halves the step, or falls back to order 1 after three failures in a row.
    fn after_failure(&self, h: f64, error: f64, at_k: f64, order: usize) -> Judgement {
        let mut ratio = 0.5;
        if self.failures > 2 && 0.5 < 0.25 * at_k {
            ratio = (0.5 / at_k).sqrt().max(LEAST_RATIO);
        }
        if !error.is_finite() {
            ratio = 0.25;
        }
        let order = if self.failures >= 2 { 1 } else { order };
        Judgement { error, accepted: false, order, step: ratio * h }
    }

    /// Order and length of the next step; `order` is k − 1 if that already won. The errors are that of order k and
    /// what another correction would change, and by how much the rest of their series makes estimates larger.
    fn after_success(
        &mut self,
        ode: &mut dyn LinearizedOde,
        h: f64,
        k: usize,
        order: usize,
        [error, left, rest]: [f64; 3],
        at_k: f64,
        below: f64,
    ) -> Judgement {
        let trial = &mut self.trial;
        if order < k || k == ADAMS_MAX_ORDER {
            trial.starting = false;
        }
        let mut order = order;
        let mut estimate = if order < k { below } else { at_k };
        if trial.starting {
            order = k + 1; // its error is not known; the step doubles anyway
        } else if order == k && k < trial.same_steps {
            // The last k + 1 steps were equal: the difference of order k + 2 can be trusted.
            self.work.copy_from_slice(&trial.phi[k + 1]);
            let size = self.caution() * ode.norm(&self.work);
            let above = h * ADAMS_GAMMA_STAR[k + 1].abs() * size;
            if k > 1 && below <= at_k.min(above) {
                (order, estimate) = (k - 1, below);
            } else if k < ADAMS_MAX_ORDER && above < if k > 1 { at_k } else { 0.5 * at_k } {
                (order, estimate) = (k + 1, above);
            }
        }
        let power = order as f64 + 1.0;
        let estimate = (rest * estimate).max(left);
        let ratio = if self.trial.starting || 0.5 >= estimate * power.exp2() {
            2.0
        } else if 0.5 >= estimate {
            1.0
        } else {
            (0.5 / estimate).powf(1.0 / power).clamp(0.5, 0.9)
        };
        self.trial.order = order;
        let error = error.max(left);
        Judgement { error, accepted: true, order, step: ratio * h }
    }
}

/// Differences of one order are `ratio` times those of the order before: an estimate is the first term of a series, and says
/// little of the rest where they are alike, as all are where only the last slope is another. By how much the rest makes it
/// larger; what a formula of order 1 would have as error, `largest` times as much, is the most that the last slope has
/// shown. Differences of noise, and of what is at the limit of stability, grow by more than a half.
fn rest_of_series(ratio: f64, largest: f64) -> f64 {
    (0.5 / (1.0 - ratio).abs()).min(largest).max(1.0)
}

fn scale(x: &mut [f64], part: f64) {
    x.iter_mut().for_each(|x| *x *= part);
}

impl Stepper for AdamsStepper {
    fn order(&self) -> u32 {
        self.last().last_order.max(1) as u32
    }

    fn starting_order(&self) -> u32 {
        1
    }

    fn orders_of_error(&self) -> [u32; 2] {
        [self.order() + u32::from(!self.unfinished), self.order()]
    }

    fn explicit(&self) -> bool {
        true
    }

    fn multistep(&self) -> bool {
        true
    }

    fn restart(&mut self) {
        self.invalidate();
    }

    fn invalidate(&mut self) {
        self.commit();
        self.history.order = 0;
        self.failures = 0;
    }

    fn discard(&mut self) {
        self.pending = false;
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
        self.history.end_at(g);
        let mut report = StepReport::rejected(0.5 * h);
        match self.advance(ode, t, h, w) {
            Ok(judgement) if judgement.accepted => {
                self.pending = true;
                let next = if self.options.fixed_step { h } else { judgement.step };
                report.accept(judgement.error, next.min(self.options.max_step));
                if self.trial.suspect >= STIFF_STEPS {
                    self.statistics.stiff_steps += 1;
                }
            }
            Ok(judgement) => {
                report.error = judgement.error;
                report.next_step = judgement.step;
                report.cause = Some(Rejection::ErrorTooLarge);
                self.history.order = judgement.order;
            }
            Err(cause) => report.cause = Some(cause),
        }
        if !report.accepted {
            self.failures += 1;
            self.history.starting = false;
        }
        report
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.last().end, slope: &self.slope }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        self.last().interpolate(theta, w);
    }

    fn largest_degree(&self) -> usize {
        ADAMS_MAX_ORDER + 1
    }

    fn polynomial(&self, coefficients: &mut [f64]) -> usize {
        self.last().polynomial(coefficients)
    }

    fn history(&self) -> Vec<f64> {
        self.last().numbers()
    }

    fn recall(&mut self, numbers: &[f64]) -> bool {
        self.pending = false;
        self.history.recall(numbers)
    }

    fn shorten(&mut self, by: f64) {
        self.shortening = by;
    }

    fn last_change(&self) -> &[f64] {
        &self.difference
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
