//! Stepper of SDIRK formulas in z-form: ForSDIRK for ẇ = g(t, w).
//!
//! ```text
//! z̃ = Σ_{j<i} ζᵢⱼ zⱼ    r = γh [g(t₀ + cᵢh, w₀ + zᵢ) − (zᵢ − z̃)/γh]    (I − γhJ) δ = r    zᵢ ← zᵢ + δ
//! ```
//!
//! Source: thesis sections 4.3 and 5.5; Hairer & Wanner, *Solving ODEs II*, section IV.8.

use crate::control::{
    IterationVerdict, NewtonMonitor, StepControl, StepHistory, StepLaw, StepVerdict,
};
use crate::formula::Sdirk;
use crate::method::ode::LinearizedOde;
use crate::method::second_order::Residual;
use crate::method::segment::Segment;
use crate::method::stepper::{
    Linearization, Rejection, StageFailure, StageQuadrature, StepEnd, StepReport, Stepper,
    StepperOptions, StepperStatistics, add_scaled, lost,
};

const STAGES: usize = 5;

/// What attempts leave behind for the judgement of later ones.
#[derive(Debug, Clone, Copy)]
struct Memory {
    history: StepHistory,
    /// Last known contraction θ.
    contraction: f64,
    /// η per stage.
    eta: [f64; STAGES],
}

impl Default for Memory {
    fn default() -> Self {
        Self { history: StepHistory::default(), contraction: f64::INFINITY, eta: [1.0; STAGES] }
    }
}

/// Stepper of an SDIRK formula.
#[derive(Debug, Clone)]
pub struct SdirkStepper {
    formula: &'static Sdirk,
    options: StepperOptions,
    control: StepControl,
    memory: Memory,
    /// The memory before the last attempt, for [`Stepper::discard`].
    before: Memory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    linearization: Linearization,
    factored: Option<f64>,
    residual: Residual,
    /// The segment before this step predicts its first stage.
    predict: bool,
    /// Weighted norm of round-off in w₀.
    floor: f64,
    z: [Vec<f64>; STAGES],
    past: Vec<f64>,
    state: Vec<f64>,
    work: Vec<f64>,
    end: Vec<f64>,
    slope: Vec<f64>,
    current: Segment,
    previous: Segment,
    statistics: StepperStatistics,
}

impl SdirkStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Sdirk, dimension: usize, options: StepperOptions) -> Self {
        let law = if options.predictive { StepLaw::Predictive } else { StepLaw::Standard };
        let vector = || vec![0.0; dimension];
        Self {
            formula,
            options,
            control: StepControl { law, ..StepControl::implicit(formula.embedded_order) },
            memory: Memory::default(),
            before: Memory::default(),
            pending: false,
            linearization: Linearization::None,
            factored: None,
            residual: options.residual,
            predict: false,
            floor: 0.0,
            z: std::array::from_fn(|_| vector()),
            past: vector(),
            state: vector(),
            work: vector(),
            end: vector(),
            slope: vector(),
            current: Segment::new(dimension, 4),
            previous: Segment::new(dimension, 4),
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
        let gamma_h = self.formula.gamma * h;
        if self.factored != Some(gamma_h) {
            self.statistics.factorizations += 1;
            self.factored = None;
            ode.factor(gamma_h).map_err(|failure| (Rejection::SingularMatrix(failure), 0.5))?;
            self.factored = Some(gamma_h);
        }
        Ok(())
    }

    /// Start value of stage `i` and its past part.
    fn predict(&mut self, i: usize, h: f64) {
        let (known, rest) = self.z.split_at_mut(i);
        let z = &mut rest[0];
        z.fill(0.0);
        self.past.fill(0.0);
        if i == 0 {
            if self.predict {
                self.previous.continue_by(self.formula.c[0] * h, z);
            }
            return;
        }
        let weights =
            if i == STAGES - 1 { &self.formula.d_hat } else { &self.formula.predictor[i] };
        for (j, known) in known.iter().enumerate() {
            add_scaled(z, weights[j], known);
            add_scaled(&mut self.past, self.formula.zeta[i][j], known);
        }
    }

    /// Newton iteration of all stages. Returns the iterations of the last stage.
    fn iterate(
        &mut self,
        ode: &mut dyn LinearizedOde,
        t: f64,
        h: f64,
        w: &[f64],
        report: &mut StepReport,
    ) -> Result<u32, StageFailure> {
        let gamma_h = self.formula.gamma * h;
        let mut last_stage = 0;
        for i in 0..STAGES {
            self.predict(i, h);
            let mut monitor =
                NewtonMonitor::start(self.options.iteration(), self.memory.eta[i], self.floor);
            let verdict = loop {
                let z = &mut self.z[i];
                for ((state, &w), &z) in self.state.iter_mut().zip(w).zip(&*z) {
                    *state = w + z;
                }
                self.statistics.derivatives += 1;
                let at = t + self.formula.c[i] * h;
                for ((slope, &past), &z) in self.slope.iter_mut().zip(&self.past).zip(&*z) {
                    *slope = (z - past) / gamma_h;
                }
                let (residual, slope, work) = (self.residual, &self.slope, &mut self.work);
                if let Err(failure) = ode.defect(residual, at, &self.state, slope, work) {
                    self.memory.eta[i] = 1.0;
                    return Err((Rejection::Evaluation(failure), 0.5));
                }
                work.iter_mut().for_each(|r| *r *= gamma_h);
                self.statistics.solves += 1;
                ode.solve_defect(work);
                self.statistics.iterations += 1;
                report.iterations += 1;
                let verdict = monitor.observe(ode.norm(&self.work));
                add_scaled(z, 1.0, &self.work);
                if verdict != IterationVerdict::Continue {
                    break verdict;
                }
            };
            self.memory.eta[i] = monitor.eta();
            report.contraction = report.contraction.max(monitor.contraction().unwrap_or(0.0));
            match verdict {
                IterationVerdict::Slow { ratio } => return Err((Rejection::NewtonSlow, ratio)),
                IterationVerdict::Diverged => {
                    self.memory.eta = [1.0; STAGES];
                    return Err((Rejection::NewtonDivergence, 0.5));
                }
                IterationVerdict::Converged | IterationVerdict::Continue => {}
            }
            last_stage = monitor.iterations();
        }
        Ok(last_stage)
    }

    /// Linearization, factorization and stages. An iteration that fails is repeated with a fresh
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
            let before = self.residual;
            self.residual = before.other();
            let other = self.iterate(ode, t, h, w, report);
            if other.is_ok() {
                return other;
            }
            self.residual = before;
        }
        outcome
    }

    /// Scaled error z₅ − Σ d̂ⱼ zⱼ, filtered; filtered once more where a first or repeated attempt
    /// would fail, because transients there are not what the step has to follow.
    fn error(&mut self, ode: &mut dyn LinearizedOde, w: &[f64]) -> f64 {
        self.work.copy_from_slice(&self.z[STAGES - 1]);
        for (z, &d) in self.z.iter().zip(&self.formula.d_hat) {
            add_scaled(&mut self.work, -d, z);
        }
        self.end.copy_from_slice(w);
        add_scaled(&mut self.end, 1.0, &self.z[STAGES - 1]);
        if !self.options.filter_error {
            return ode.error_norm(&self.work, &self.end);
        }
        self.statistics.solves += 1;
        ode.solve(&mut self.work);
        let error = ode.error_norm(&self.work, &self.end);
        let fragile = self.memory.history.accepted.is_none() || self.memory.history.rejected;
        if !(error > 1.0 && fragile && !self.options.fixed_step) {
            return error;
        }
        self.statistics.solves += 1;
        ode.solve(&mut self.work);
        ode.error_norm(&self.work, &self.end)
    }

    /// Stores the end of the step and its dense output.
    fn finish(&mut self, h: f64, w: &[f64]) {
        let gamma_h = self.formula.gamma * h;
        let last = &self.z[STAGES - 1];
        for i in 0..w.len() {
            // From the formula and not by a new evaluation: that would multiply what is left of the
            // iteration error by the stiffness, this divides it by γh. It costs nothing, either.
            self.slope[i] = (last[i] - self.past[i]) / gamma_h;
        }
        self.current.begin(h, w);
        for (z, weights) in self.z.iter().zip(&self.formula.dense) {
            self.current.add(1.0, weights, z);
        }
        self.pending = true;
    }

    /// Judges the attempt: whether it is accepted, and the next step.
    fn judge(&mut self, h: f64, error: f64, last_stage: u32) -> StepVerdict {
        if self.options.fixed_step && error.is_finite() {
            return StepVerdict::Accept { next: h };
        }
        // More iterations than the shortest possible: be more careful.
        let limit = 2.0 * f64::from(self.options.newton.max_iterations);
        let safety = self.control.safety * (1.0 + limit) / (f64::from(last_stage) + limit);
        let reuse = self.memory.contraction <= self.options.reuse_contraction;
        let dead_band = if reuse { self.options.dead_band } else { 1.0 };
        StepControl { safety, dead_band, ..self.control }.judge(h, error, &self.memory.history)
    }
}

impl Stepper for SdirkStepper {
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
            self.memory.eta = [1.0; STAGES];
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
        for ((scale, &w), &g) in self.work.iter_mut().zip(w).zip(g) {
            *scale = w.abs() + movement * g.abs();
        }
        self.floor = f64::EPSILON * ode.norm(&self.work);
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
            Ok(last_stage) => {
                if report.contraction > 0.0 {
                    self.memory.contraction = report.contraction;
                }
                let error = self.error(ode, w);
                match self.judge(h, error, last_stage) {
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
        StepEnd { w: &self.end, slope: &self.slope, evaluated: false }
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
        &self.work
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
