//! Stepper of Rosenbrock formulas: ForRosen for ẇ = g(t, w). Every accepted step linearizes.

use crate::control::{StepControl, StepHistory, StepLaw, StepVerdict};
use crate::formula::Rosenbrock;
use crate::method::ode::LinearizedOde;
use crate::method::segment::Segment;
use crate::method::stepper::{
    Rejection, StepEnd, StepReport, Stepper, StepperOptions, StepperStatistics, add_scaled,
};

const STAGES: usize = 4;

/// Passes of the filter of the slopes of dense output.
const SMOOTHING: usize = 6;

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
    u: [Vec<f64>; STAGES],
    time_slope: Vec<f64>,
    stage_slope: Vec<f64>,
    state: Vec<f64>,
    end: Vec<f64>,
    end_slope: Vec<f64>,
    /// Slopes of dense output at both ends.
    smooth: [Vec<f64>; 2],
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
            u: std::array::from_fn(|_| vector()),
            time_slope: vector(),
            stage_slope: vector(),
            state: vector(),
            end: vector(),
            end_slope: vector(),
            smooth: [vector(), vector()],
            current: Segment::new(dimension, 5),
            previous: Segment::new(dimension, 5),
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
        let raw = ode.error_norm(&self.state, &self.end);
        if !self.options.filter_error {
            return raw;
        }
        self.statistics.solves += 1;
        ode.solve(&mut self.state);
        ode.error_norm(&self.state, &self.end).max(0.1 * raw)
    }

    /// Stores the dense output of an accepted step.
    fn finish(&mut self, ode: &mut dyn LinearizedOde, h: f64, w: &[f64], g: &[f64]) {
        for (slope, smooth) in [g, &self.end_slope].into_iter().zip(&mut self.smooth) {
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
        self.current.begin(h, w);
        let ([first, last], split) = (&self.smooth, ode.second_order_split());
        for i in 0..w.len() {
            let change = self.end[i] - w[i];
            if i < split {
                let bends = [h * h * first[split + i], h * h * last[split + i]];
                self.current.set_quintic(i, change, [h * g[i], h * self.end_slope[i]], bends);
            } else {
                self.current.set_cubic(i, change, [h * first[i], h * last[i]]);
            }
        }
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
        self.end.copy_from_slice(w);
        for (u, &m) in self.u.iter().zip(&self.formula.m) {
            add_scaled(&mut self.end, m, u);
        }
        // Dense output needs this slope, and it is the first stage of the next step. The error of a step
        // whose end cannot be evaluated is worth nothing.
        self.statistics.derivatives += 1;
        ode.derivative(t + h, &self.end, &mut self.end_slope).map_err(Rejection::Evaluation)?;
        let error = self.error(ode);
        let verdict = if self.options.fixed_step && error.is_finite() {
            StepVerdict::Accept { next: h }
        } else {
            self.control.judge(h, error, &self.history)
        };
        if let StepVerdict::Accept { .. } = verdict {
            self.finish(ode, h, w, g);
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
        StepEnd { w: &self.end, slope: &self.end_slope, evaluated: true }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        self.last().interpolate(theta, w);
    }

    fn last_change(&self) -> &[f64] {
        &self.state
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
