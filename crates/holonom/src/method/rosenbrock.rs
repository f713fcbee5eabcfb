//! Stepper of Rosenbrock formulas: ForRosen for ẇ = g(t, w). Every accepted step linearizes.

use crate::control::{StepControl, StepHistory, StepLaw, StepVerdict};
use crate::formula::Rosenbrock;
use crate::method::ode::LinearizedOde;
use crate::method::stepper::{
    Rejection, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics, add_scaled,
};

const STAGES: usize = 4;

/// Passes of the filter of the slopes of dense output.
const SMOOTHING: usize = 6;

/// Both ends of an accepted step.
#[derive(Debug, Clone)]
struct Segment {
    step: f64,
    w: [Vec<f64>; 2],
    slope: [Vec<f64>; 2],
    /// Slopes without the error of the state times the stiffness.
    smooth: [Vec<f64>; 2],
}

impl Segment {
    fn new(n: usize) -> Self {
        let pair = || [vec![0.0; n], vec![0.0; n]];
        Self { step: 0.0, w: pair(), slope: pair(), smooth: pair() }
    }
}

/// Stepper of a Rosenbrock formula.
///
/// Dense output is the cubic Hermite polynomial of states and slopes; positions, where the system
/// names them ([`crate::method::ode::Ode::second_order_split`]), take the quintic one with second
/// derivatives as well. A slope g carries the error of the state multiplied by the stiffness; its
/// place is taken by g − (I − F)⁶ g with F = (I − γhJ)⁻¹, which differs from g by O(h⁶) on smooth
/// components and is 6 F g, of the size of the error over h, on stiff ones.
#[derive(Debug, Clone)]
pub struct RosenbrockStepper {
    formula: &'static Rosenbrock,
    options: StepperOptions,
    control: StepControl,
    history: StepHistory,
    history_before: StepHistory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    /// The linearization is that of the step's start.
    linearized: bool,
    split: usize,
    u: [Vec<f64>; STAGES],
    time_slope: Vec<f64>,
    stage_slope: Vec<f64>,
    state: Vec<f64>,
    /// The step just accepted, and the one before it.
    current: Segment,
    previous: Segment,
    statistics: StepperStatistics,
}

impl RosenbrockStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Rosenbrock, dimension: usize, options: StepperOptions) -> Self {
        let law = if options.predictive { StepLaw::Predictive } else { StepLaw::Standard };
        let vector = || vec![0.0; dimension];
        Self {
            formula,
            options,
            control: StepControl { law, ..StepControl::implicit(formula.embedded_order) },
            history: StepHistory::default(),
            history_before: StepHistory::default(),
            pending: false,
            linearized: false,
            split: 0,
            u: std::array::from_fn(|_| vector()),
            time_slope: vector(),
            stage_slope: vector(),
            state: vector(),
            current: Segment::new(dimension),
            previous: Segment::new(dimension),
            statistics: StepperStatistics::default(),
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
            self.linearized = false;
        }
    }

    /// The last accepted step.
    fn last(&self) -> &Segment {
        if self.pending { &self.current } else { &self.previous }
    }

    /// Computes the four stages; `stage_slope` holds the last evaluation of g.
    fn stages(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> Result<(), Rejection> {
        let f = self.formula;
        if !self.linearized {
            self.statistics.linearizations += 1;
            ode.linearize(t, w, g)
                .and_then(|()| ode.time_derivative(&mut self.time_slope))
                .map_err(Rejection::Evaluation)?;
            self.linearized = true;
        }
        self.statistics.factorizations += 1;
        ode.factor(f.gamma * h).map_err(Rejection::SingularMatrix)?;
        self.stage_slope.copy_from_slice(g);
        for i in 0..STAGES {
            let (known, rest) = self.u.split_at_mut(i);
            let u = &mut rest[0];
            if i > 0 && f.a[i] != f.a[i - 1] {
                self.state.copy_from_slice(w);
                for (j, known) in known.iter().enumerate() {
                    add_scaled(&mut self.state, f.a[i][j], known);
                }
                self.statistics.derivatives += 1;
                ode.derivative(t + f.alpha[i] * h, &self.state, &mut self.stage_slope)
                    .map_err(Rejection::Evaluation)?;
            }
            u.fill(0.0);
            add_scaled(u, f.gamma * h, &self.stage_slope);
            add_scaled(u, f.gamma * f.epsilon[i] * h * h, &self.time_slope);
            for (j, known) in known.iter().enumerate() {
                add_scaled(u, f.gamma * f.c[i][j], known);
            }
            self.statistics.solves += 1;
            ode.solve(u);
        }
        Ok(())
    }

    /// Scaled error Σ eᵢ uᵢ, filtered. The formula is not stiffly accurate: on stiff components its
    /// error does not vanish with 1/λ (Prothero and Robinson's problem) while the filtered estimate
    /// does. So the filter may reduce the estimate tenfold at most.
    fn error(&mut self, ode: &mut dyn LinearizedOde) -> f64 {
        self.state.fill(0.0);
        for (u, &e) in self.u.iter().zip(&self.formula.e) {
            add_scaled(&mut self.state, e, u);
        }
        let end = &self.current.w[1];
        let raw = ode.error_norm(&self.state, end);
        if !self.options.filter_error {
            return raw;
        }
        self.statistics.solves += 1;
        ode.solve(&mut self.state);
        ode.error_norm(&self.state, end).max(0.1 * raw)
    }

    /// The attempt up to its judgement: error and next step, or why there is none.
    fn advance(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
    ) -> Result<(f64, StepVerdict), Rejection> {
        self.stages(ode, t, h, w, g)?;
        let end = &mut self.current.w[1];
        end.copy_from_slice(w);
        for (u, &m) in self.u.iter().zip(&self.formula.m) {
            add_scaled(end, m, u);
        }
        // Dense output needs this slope, and it is the first stage of the next step. The error of a step
        // whose end cannot be evaluated is worth nothing.
        self.statistics.derivatives += 1;
        let Segment { w: ends, slope, .. } = &mut self.current;
        ode.derivative(t + h, &ends[1], &mut slope[1]).map_err(Rejection::Evaluation)?;
        let error = self.error(ode);
        let verdict = if self.options.fixed_step && error.is_finite() {
            StepVerdict::Accept { next: h }
        } else {
            self.control.judge(h, error, &self.history)
        };
        if let StepVerdict::Accept { .. } = verdict {
            let Segment { step, w: ends, slope, smooth } = &mut self.current;
            *step = h;
            ends[0].copy_from_slice(w);
            slope[0].copy_from_slice(g);
            for (slope, smooth) in slope.iter().zip(smooth) {
                self.state.copy_from_slice(slope);
                for _ in 0..SMOOTHING {
                    self.stage_slope.copy_from_slice(&self.state);
                    self.statistics.solves += 1;
                    ode.solve(&mut self.stage_slope);
                    add_scaled(&mut self.state, -1.0, &self.stage_slope);
                }
                smooth.copy_from_slice(slope);
                add_scaled(smooth, -1.0, &self.state);
            }
        }
        Ok((error, verdict))
    }
}

impl Stepper for RosenbrockStepper {
    fn order(&self) -> u32 {
        self.formula.order
    }

    fn starting_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn explicit(&self) -> bool {
        false
    }

    fn restart(&mut self) {
        self.invalidate(false);
        self.history = StepHistory::default();
    }

    fn invalidate(&mut self, _keep_history: bool) {
        self.commit();
        self.linearized = false;
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
        self.split = ode.second_order_split();
        self.history_before = self.history;
        let mut report = StepReport::rejected(0.5 * h);
        match self.advance(ode, t, h, w, g) {
            Ok((error, StepVerdict::Accept { next })) => {
                self.pending = true;
                self.history.accept(h, error);
                report.accept(error, next.min(self.options.max_step));
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
        StepEnd { w: &last.w[1], slope: &last.slope[1], evaluated: true }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        let Segment { step: h, w: ends, slope, smooth } = self.last();
        let (s, r) = (theta, 1.0 - theta);
        for (i, w) in w.iter_mut().enumerate() {
            let (w0, w1) = (ends[0][i], ends[1][i]);
            *w = if i < self.split {
                let j = self.split + i;
                let (g0, g1) = (h * slope[0][i], h * slope[1][i]);
                let (a0, a1) = (0.5 * h * h * smooth[0][j], 0.5 * h * h * smooth[1][j]);
                r.powi(3) * (w0 + s * (3.0 * w0 + g0) + s * s * (6.0 * w0 + 3.0 * g0 + a0))
                    + s.powi(3) * (w1 + r * (3.0 * w1 - g1) + r * r * (6.0 * w1 - 3.0 * g1 + a1))
            } else {
                let (g0, g1) = (h * smooth[0][i], h * smooth[1][i]);
                r * r * (w0 + s * (2.0 * w0 + g0)) + s * s * (w1 + r * (2.0 * w1 - g1))
            };
        }
    }

    fn last_change(&self) -> &[f64] {
        &self.state
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::ROSENBROCK_NYSTROM_4;

    #[test] // truth: polynomials and their derivatives
    fn dense_output_reproduces_quintic_positions_and_cubic_states() {
        // x = t⁵ − 2t³ + t with v = ẋ and a = v̇; y is a cubic without a second derivative.
        let x = |t: f64| t.powi(5) - 2.0 * t.powi(3) + t;
        let v = |t: f64| 5.0 * t.powi(4) - 6.0 * t * t + 1.0;
        let a = |t: f64| 20.0 * t.powi(3) - 12.0 * t;
        let y = |t: f64| 3.0 * t.powi(3) - t * t + 7.0;
        let y_rate = |t: f64| 9.0 * t * t - 2.0 * t;
        let (t0, h) = (0.4, 0.7);
        let mut stepper =
            RosenbrockStepper::new(&ROSENBROCK_NYSTROM_4, 3, StepperOptions::default());
        stepper.split = 1;
        stepper.pending = true;
        stepper.current.step = h;
        for (end, t) in [t0, t0 + h].into_iter().enumerate() {
            stepper.current.w[end] = vec![x(t), v(t), y(t)];
            stepper.current.slope[end] = vec![v(t), a(t), y_rate(t)];
            stepper.current.smooth[end] = vec![v(t), a(t), y_rate(t)];
        }
        let mut w = vec![0.0; 3];
        for theta in [0.0, 0.3, 0.6, 1.0] {
            let t = t0 + theta * h;
            stepper.interpolate(theta, &mut w);
            assert!((w[0] - x(t)).abs() < 1e-14, "position at θ = {theta}");
            assert!((w[2] - y(t)).abs() < 1e-14, "state at θ = {theta}");
        }
        // Without the split positions are cubic only, and the difference is seen.
        stepper.split = 0;
        stepper.interpolate(0.3, &mut w);
        assert!((w[0] - x(t0 + 0.3 * h)).abs() > 1e-3);
    }
}
