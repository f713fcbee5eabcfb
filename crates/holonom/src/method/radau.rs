//! Stepper of Radau IIA: ForRadau for ẇ = g(t, w). Three coupled stages, split by z = T y into one
//! real and one complex system of the size of w.
//!
//! ```text
//! (I − h/γ̂ J) δ₁ = h/γ̂ r₁                            rᵢ = Σⱼ (T⁻¹)ᵢⱼ g(w₀ + zⱼ) − (Λ y)ᵢ / h
//! (I − h/(α̂+iβ̂) J) (δ₂ + iδ₃) = h/(α̂+iβ̂) (r₂ + ir₃)        y ← y + δ,  Λ = T⁻¹A⁻¹T
//! ```
//!
//! Source: Hairer & Wanner, *Solving ODEs II*, section IV.8.

use crate::control::{
    IterationVerdict, NewtonMonitor, StepControl, StepHistory, StepLaw, StepVerdict,
};
use crate::formula::Radau;
use crate::method::ode::{Complex64, LinearizedOde};
use crate::method::second_order::Residual;
use crate::method::segment::Segment;
use crate::method::stepper::{
    Linearization, Rejection, StageFailure, StageQuadrature, StepEnd, StepReport, Stepper,
    StepperOptions, StepperStatistics, add_scaled, lost,
};

const STAGES: usize = 3;

/// What attempts leave behind for the judgement of later ones.
#[derive(Debug, Clone, Copy)]
struct Memory {
    history: StepHistory,
    /// Last known contraction θ.
    contraction: f64,
    eta: f64,
}

impl Default for Memory {
    fn default() -> Self {
        Self { history: StepHistory::default(), contraction: f64::INFINITY, eta: 1.0 }
    }
}

/// Stepper of the three-stage Radau IIA formula.
#[derive(Debug, Clone)]
pub struct RadauStepper {
    formula: &'static Radau,
    options: StepperOptions,
    control: StepControl,
    memory: Memory,
    /// The memory before the last attempt, for [`Stepper::discard`].
    before: Memory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    linearization: Linearization,
    factored: Option<f64>,
    defect: Residual,
    /// The segment before this step predicts the stages.
    predict: bool,
    /// Weighted norm of round-off in w₀.
    floor: f64,
    z: [Vec<f64>; STAGES],
    y: [Vec<f64>; STAGES],
    slopes: [Vec<f64>; STAGES],
    defects: [Vec<f64>; STAGES],
    residual: [Vec<f64>; STAGES],
    state: Vec<f64>,
    end: Vec<f64>,
    end_slope: Vec<f64>,
    current: Segment,
    previous: Segment,
    statistics: StepperStatistics,
}

impl RadauStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Radau, dimension: usize, options: StepperOptions) -> Self {
        let law = if options.predictive { StepLaw::Predictive } else { StepLaw::Standard };
        let vector = || vec![0.0; dimension];
        let stages = || std::array::from_fn(|_| vector());
        Self {
            formula,
            options,
            control: StepControl { law, ..StepControl::implicit(formula.embedded_order) },
            memory: Memory::default(),
            before: Memory::default(),
            pending: false,
            linearization: Linearization::None,
            factored: None,
            defect: options.residual,
            predict: false,
            floor: 0.0,
            z: stages(),
            y: stages(),
            slopes: stages(),
            defects: stages(),
            residual: stages(),
            state: vector(),
            end: vector(),
            end_slope: vector(),
            current: Segment::new(dimension, STAGES),
            previous: Segment::new(dimension, STAGES),
            statistics: StepperStatistics::default(),
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
            self.predict = true;
            if self.linearization == Linearization::Current {
                self.linearization = Linearization::Old;
            }
        }
    }

    /// The last accepted step.
    fn last(&self) -> &Segment {
        if self.pending { &self.current } else { &self.previous }
    }

    fn linearize(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        w: &[f64],
        g: &[f64],
    ) -> Result<(), StageFailure> {
        self.statistics.linearizations += 1;
        self.factored = None;
        self.linearization = Linearization::None;
        ode.linearize(t, w, g).map_err(|failure| (Rejection::Evaluation(failure), 0.5))?;
        self.linearization = Linearization::Current;
        Ok(())
    }

    fn factor(&mut self, ode: &mut dyn LinearizedOde, h: f64) -> Result<(), StageFailure> {
        if self.factored == Some(h) {
            return Ok(());
        }
        self.statistics.factorizations += 2;
        self.factored = None;
        let eigenvalue = Complex64::new(self.formula.complex.0, self.formula.complex.1);
        ode.factor(h / self.formula.real)
            .and_then(|()| ode.factor_complex(h / eigenvalue))
            .map_err(|failure| (Rejection::SingularMatrix(failure), 0.5))?;
        self.factored = Some(h);
        Ok(())
    }

    /// Start values: the polynomial of the step before, continued.
    fn predict(&mut self, h: f64) {
        for (i, z) in self.z.iter_mut().enumerate() {
            z.fill(0.0);
            if self.predict {
                self.previous.continue_by(self.formula.c[i] * h, z);
            }
        }
        transform(&self.formula.t_inverse, &self.z, &mut self.y);
    }

    /// Newton iteration. Returns the number of iterations.
    fn iterate(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        report: &mut StepReport,
    ) -> Result<u32, StageFailure> {
        self.predict(h);
        let mut monitor =
            NewtonMonitor::start(self.options.iteration(), self.memory.eta, self.floor);
        let verdict = loop {
            self.implied_slopes(h);
            for i in 0..STAGES {
                for ((state, &w), &z) in self.state.iter_mut().zip(w).zip(&self.z[i]) {
                    *state = w + z;
                }
                self.statistics.derivatives += 1;
                let at = t + self.formula.c[i] * h;
                let (slope, defect) = (&self.slopes[i], &mut self.defects[i]);
                if let Err(failure) = ode.defect(self.defect, at, &self.state, slope, defect) {
                    self.memory.eta = 1.0;
                    return Err((Rejection::Evaluation(failure), 0.5));
                }
            }
            self.correct(ode, h);
            self.statistics.iterations += 1;
            report.iterations += 1;
            let square: f64 = self.residual.iter().map(|r| ode.norm(r).powi(2)).sum();
            let verdict = monitor.observe((square / STAGES as f64).sqrt());
            for (y, delta) in self.y.iter_mut().zip(&self.residual) {
                add_scaled(y, 1.0, delta);
            }
            transform(&self.formula.t, &self.y, &mut self.z);
            if verdict != IterationVerdict::Continue {
                break verdict;
            }
        };
        self.memory.eta = monitor.eta();
        report.contraction = report.contraction.max(monitor.contraction().unwrap_or(0.0));
        match verdict {
            IterationVerdict::Slow { ratio } => Err((Rejection::NewtonSlow, ratio)),
            IterationVerdict::Diverged => {
                self.memory.eta = 1.0;
                Err((Rejection::NewtonDivergence, 0.5))
            }
            IterationVerdict::Converged | IterationVerdict::Continue => Ok(monitor.iterations()),
        }
    }

    /// The slopes A⁻¹z / h = T Λy / h that the iterate ascribes to its stages.
    fn implied_slopes(&mut self, h: f64) {
        let f = self.formula;
        let (re, im) = f.complex;
        let [s1, s2, s3] = &mut self.residual;
        let [y1, y2, y3] = &self.y;
        for i in 0..s1.len() {
            s1[i] = f.real * y1[i] / h;
            s2[i] = (re * y2[i] - im * y3[i]) / h;
            s3[i] = (im * y2[i] + re * y3[i]) / h;
        }
        transform(&f.t, &self.residual, &mut self.slopes);
    }

    /// Correction of y from the defects at the stages, into `residual`.
    fn correct(&mut self, ode: &mut dyn LinearizedOde, h: f64) {
        let f = self.formula;
        transform(&f.t_inverse, &self.defects, &mut self.residual);
        let [r1, r2, r3] = &mut self.residual;
        let (re, im) = f.complex;
        let scale = h / (re * re + im * im);
        for i in 0..r1.len() {
            r1[i] *= h / f.real;
            let (a, b) = (r2[i], r3[i]);
            r2[i] = scale * (re * a + im * b);
            r3[i] = scale * (re * b - im * a);
        }
        self.statistics.solves += 2;
        ode.solve_defect(r1);
        ode.solve_complex_defect(r2, r3);
    }

    /// Linearization, factorization and iteration. An iteration that fails is repeated with a fresh
    /// linearization, then with the other residual, before the step is made shorter.
    fn stages(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        g: &[f64],
        report: &mut StepReport,
    ) -> Result<u32, StageFailure> {
        let stale = match self.linearization {
            Linearization::Current => false,
            Linearization::None => true,
            Linearization::Old => self.memory.contraction > self.options.reuse_contraction,
        };
        if stale {
            self.linearize(ode, t, w, g)?;
        }
        self.factor(ode, h)?;
        let mut outcome = self.iterate(ode, t, h, w, report);
        if lost(&outcome) && self.linearization == Linearization::Old {
            self.linearize(ode, t, w, g)?;
            self.factor(ode, h)?;
            report.contraction = 0.0;
            outcome = self.iterate(ode, t, h, w, report);
        }
        if lost(&outcome) && self.options.adapt_iteration {
            let before = self.defect;
            self.defect = before.other();
            let other = self.iterate(ode, t, h, w, report);
            if other.is_ok() {
                return other;
            }
            self.defect = before;
        }
        outcome
    }

    /// Scaled error (I − γ₀hJ)⁻¹ (γ₀h g₀ + Σ eᵢ zᵢ). Where a first or repeated attempt would fail,
    /// g is taken at w₀ + error instead, because transients there are not what the step has to
    /// follow.
    fn error(&mut self, ode: &mut dyn LinearizedOde, t: f64, h: f64, w: &[f64], g: &[f64]) -> f64 {
        let gamma_h = h / self.formula.real;
        let estimate = |slope: &[f64], z: &[Vec<f64>; STAGES], e: &[f64; 3], out: &mut [f64]| {
            out.fill(0.0);
            add_scaled(out, gamma_h, slope);
            for (z, &e) in z.iter().zip(e) {
                add_scaled(out, e, z);
            }
        };
        let [work, slope, _] = &mut self.residual;
        estimate(g, &self.z, &self.formula.e, work);
        self.end.copy_from_slice(w);
        add_scaled(&mut self.end, 1.0, &self.z[STAGES - 1]);
        if !self.options.filter_error {
            return ode.error_norm(work, &self.end);
        }
        self.statistics.solves += 1;
        ode.solve(work);
        let error = ode.error_norm(work, &self.end);
        let fragile = self.memory.history.accepted.is_none() || self.memory.history.rejected;
        if !(error > 1.0 && fragile && !self.options.fixed_step) {
            return error;
        }
        for ((state, &w), &e) in self.state.iter_mut().zip(w).zip(&*work) {
            *state = w + e;
        }
        self.statistics.derivatives += 1;
        if ode.derivative(t, &self.state, slope).is_err() {
            return error;
        }
        estimate(slope, &self.z, &self.formula.e, work);
        self.statistics.solves += 1;
        ode.solve(work);
        ode.error_norm(work, &self.end)
    }

    /// Stores the end of the step and its dense output.
    fn finish(&mut self, h: f64, w: &[f64]) {
        // From the formula and not by a new evaluation: that would multiply what is left of the
        // iteration error by the stiffness.
        self.end_slope.fill(0.0);
        for (z, &a) in self.z.iter().zip(&self.formula.a_inverse[STAGES - 1]) {
            add_scaled(&mut self.end_slope, a / h, z);
        }
        self.current.begin(h, w);
        for (z, weights) in self.z.iter().zip(&self.formula.dense) {
            self.current.add(1.0, weights, z);
        }
        self.pending = true;
    }

    /// Judges the attempt: whether it is accepted, and the next step.
    fn judge(&mut self, h: f64, error: f64, iterations: u32) -> StepVerdict {
        if self.options.fixed_step && error.is_finite() {
            return StepVerdict::Accept { next: h };
        }
        // More iterations than the shortest possible: be more careful.
        let limit = 2.0 * f64::from(self.options.newton.max_iterations);
        let safety = self.control.safety * (1.0 + limit) / (f64::from(iterations) + limit);
        let reuse = self.memory.contraction <= self.options.reuse_contraction;
        let dead_band = if reuse { self.options.dead_band } else { 1.0 };
        StepControl { safety, dead_band, ..self.control }.judge(h, error, &self.memory.history)
    }
}

/// out = M x over the stages.
fn transform(m: &[[f64; STAGES]; STAGES], x: &[Vec<f64>; STAGES], out: &mut [Vec<f64>; STAGES]) {
    for (row, out) in m.iter().zip(out) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = row[0] * x[0][i] + row[1] * x[1][i] + row[2] * x[2][i];
        }
    }
}

impl Stepper for RadauStepper {
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
        self.memory = Memory::default();
    }

    fn invalidate(&mut self, keep_history: bool) {
        self.commit();
        if !keep_history {
            self.predict = false;
            self.memory.eta = 1.0;
        }
        self.linearization = Linearization::None;
        self.factored = None;
        self.memory.contraction = f64::INFINITY;
    }

    fn discard(&mut self) {
        if std::mem::take(&mut self.pending) {
            self.memory = self.before;
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
        // A step without error control may start at w = 0; elsewhere |w| alone is the safe scale.
        let movement = if self.options.fixed_step { h } else { 0.0 };
        for ((scale, &w), &g) in self.state.iter_mut().zip(w).zip(g) {
            *scale = w.abs() + movement * g.abs();
        }
        self.floor = f64::EPSILON * ode.norm(&self.state);
        let mut report = StepReport::rejected(h);
        self.before = self.memory;
        match self.stages(ode, t, h, w, g, &mut report) {
            Err((cause, ratio)) => {
                self.predict = false;
                self.memory.history.reject();
                self.memory.contraction = f64::INFINITY;
                report.next_step = h * ratio;
                report.cause = Some(cause);
            }
            Ok(iterations) => {
                if report.contraction > 0.0 {
                    self.memory.contraction = report.contraction;
                }
                let error = self.error(ode, t, h, w, g);
                match self.judge(h, error, iterations) {
                    StepVerdict::Accept { next } => {
                        self.finish(h, w);
                        self.memory.history.accept(h, error);
                        report.accept(error, next.min(self.options.max_step));
                    }
                    StepVerdict::Reject { retry } => {
                        self.memory.history.reject();
                        (report.error, report.next_step) = (error, retry);
                        report.cause = Some(Rejection::ErrorTooLarge);
                    }
                }
            }
        }
        self.statistics.count(report.cause.as_ref());
        report
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.end, slope: &self.end_slope, evaluated: false }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        self.last().interpolate(theta, w);
    }

    fn quadrature(&self) -> Option<StageQuadrature<'_>> {
        Some(StageQuadrature { abscissas: &self.formula.c, weights: self.formula.b() })
    }

    fn stage(&self, i: usize, w: &mut [f64]) {
        self.last().interpolate(0.0, w);
        add_scaled(w, 1.0, &self.z[i]);
    }

    fn last_change(&self) -> &[f64] {
        &self.residual[0]
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
