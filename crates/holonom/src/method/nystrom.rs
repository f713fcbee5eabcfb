//! Stepper of diagonally implicit formulas in second-order form: stages are solved for accelerations.
//!
//! Source: thesis sections 3.2.2, 3.3, 4.1, 4.2 and 5.5.

use crate::control::{
    IterationVerdict, NewtonMonitor, StepControl, StepHistory, StepLaw, StepVerdict,
};
use crate::formula::{Continuation, Nystrom};
use crate::method::ode::{EvaluationFailure, LinearizedOde};
use crate::method::second_order::{Residual, SecondOrder, Stage};
use crate::method::segment::Segment;
use crate::method::stepper::{
    Linearization, Rejection, StageFailure, StepEnd, StepReport, Stepper, StepperOptions,
    StepperStatistics, add_scaled,
};

const MAX_STAGES: usize = 5;

/// What attempts leave behind for the judgement of later ones.
#[derive(Debug, Clone, Copy)]
struct Memory {
    history: StepHistory,
    /// Last known contraction θ.
    contraction: f64,
    /// η per stage.
    eta: [f64; MAX_STAGES],
}

impl Default for Memory {
    fn default() -> Self {
        Self { history: StepHistory::default(), contraction: f64::INFINITY, eta: [1.0; MAX_STAGES] }
    }
}

/// Where the accelerations of the step's start come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Start {
    /// From the equations at the linearization point.
    Evaluated,
    /// From the end of the last step, as the formula left them: evaluating them anew would multiply
    /// what is left of the iteration error by the stiffness.
    Continued,
}

/// Stepper of a diagonally implicit formula in second-order form, for systems with
/// [`LinearizedOde::second_order`].
#[derive(Debug, Clone)]
pub struct NystromStepper {
    formula: Nystrom,
    predictors: [[f64; MAX_STAGES]; MAX_STAGES],
    /// Iteration errors of a stage reach the end of the step |bᵢ|/γ times as large: up to 31 for
    /// SDIRK4/16. Where that is above 1, corrections are judged by it.
    effect: [f64; MAX_STAGES],
    options: StepperOptions,
    control: StepControl,
    memory: Memory,
    /// The memory before the last attempt, for [`Stepper::discard`].
    before: Memory,
    /// The last attempt was accepted and nothing has been built on it yet.
    pending: bool,
    /// The system has to be told that the end of the last step is the start of this one.
    advance: bool,
    start: Start,
    /// Whether they are at hand, in the present parametrization.
    start_known: bool,
    linearization: Linearization,
    /// Step of the last factorization.
    factored: Option<f64>,
    residual: Residual,
    /// Weighted norm of round-off in w₀.
    floor: f64,
    /// Unknowns at the start and of every stage.
    x: Vec<Vec<f64>>,
    /// Slopes (v̇, v̈, ż) at the start and of every stage.
    slopes: Vec<Vec<f64>>,
    /// An unknown of the last step with its distance from the end of that step.
    earlier: (Vec<f64>, f64),
    past: Vec<f64>,
    extra: Vec<f64>,
    work: Vec<f64>,
    end: Vec<f64>,
    current: Segment,
    previous: Segment,
    statistics: StepperStatistics,
}

impl NystromStepper {
    /// A stepper for systems of `dimension` entries of w and `unknowns` per stage.
    pub fn new(
        formula: Nystrom,
        dimension: usize,
        unknowns: usize,
        options: StepperOptions,
    ) -> Self {
        let law = if options.predictive { StepLaw::Predictive } else { StepLaw::Standard };
        let vector = || vec![0.0; dimension];
        let predictors =
            std::array::from_fn(|i| if i > 0 { formula.predictor(i) } else { [0.0; MAX_STAGES] });
        let effect = std::array::from_fn(|i| {
            (formula.a[formula.stages - 1][i] / formula.gamma).abs().max(1.0)
        });
        Self {
            predictors,
            effect,
            options,
            control: StepControl { law, ..StepControl::implicit(formula.embedded_order) },
            memory: Memory::default(),
            before: Memory::default(),
            pending: false,
            advance: false,
            start: Start::Evaluated,
            start_known: false,
            linearization: Linearization::None,
            factored: None,
            residual: Residual::Forces,
            floor: 0.0,
            x: vec![vec![0.0; unknowns]; formula.stages + 1],
            slopes: vec![vector(); formula.stages + 1],
            earlier: (vec![0.0; unknowns], 0.0),
            past: vector(),
            extra: vector(),
            work: vector(),
            end: vector(),
            current: Segment::new(dimension, 4),
            previous: Segment::new(dimension, 4),
            statistics: StepperStatistics::default(),
            formula,
        }
    }

    /// Makes the accepted step the past.
    fn commit(&mut self) {
        if std::mem::take(&mut self.pending) {
            std::mem::swap(&mut self.current, &mut self.previous);
            self.advance = true;
            self.start = Start::Continued;
            self.start_known = false;
            let (start, stages) = self.slopes.split_at_mut(1);
            start[0].copy_from_slice(&stages[self.formula.stages - 1]);
            let node = usize::from(!self.formula.explicit_first);
            let h = self.memory.history.accepted.map_or(0.0, |(h, _)| h);
            self.earlier.0.copy_from_slice(&self.x[node]);
            self.earlier.1 = h * (1.0 - self.formula.c[0]);
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
        system: &mut dyn SecondOrder,
        t: f64,
        w: &[f64],
        g: &[f64],
    ) -> Result<(), StageFailure> {
        self.statistics.linearizations += 1;
        self.factored = None;
        self.linearization = Linearization::None;
        system.linearize(t, w, g).map_err(|failure| (Rejection::Evaluation(failure), 0.5))?;
        self.linearization = Linearization::Current;
        Ok(())
    }

    fn factor(&mut self, system: &mut dyn SecondOrder, h: f64) -> Result<(), StageFailure> {
        if self.factored != Some(h) {
            self.statistics.factorizations += 1;
            self.factored = None;
            system
                .factor_stage(self.formula.gamma * h, self.formula.beta * h * h)
                .map_err(|failure| (Rejection::SingularMatrix(failure), 0.5))?;
            self.factored = Some(h);
        }
        Ok(())
    }

    /// Accelerations at the start of the step; the linearization must be there if they are evaluated.
    fn find_start(&mut self, system: &mut dyn SecondOrder, w: &[f64], g: &[f64]) {
        if std::mem::replace(&mut self.start_known, true) {
            return;
        }
        let ndof = system.second_order_split();
        let slopes = &mut self.slopes[0];
        match self.start {
            Start::Evaluated => {
                system.linearized_unknown(&mut self.x[0]);
                slopes[2 * ndof..].copy_from_slice(&g[2 * ndof..]);
            }
            Start::Continued => system.start_unknown(&mut self.x[0]),
        }
        slopes[..ndof].copy_from_slice(&w[ndof..2 * ndof]);
        system.acceleration(&self.x[0], &mut slopes[ndof..2 * ndof]);
    }

    /// Past part and start value of stage `i`.
    fn predict(&mut self, i: usize, h: f64, ndof: usize, w: &[f64]) {
        let f = &self.formula;
        let (x_known, x_rest) = self.x.split_at_mut(i + 1);
        let x = &mut x_rest[0];
        let (v, rates) = (0..ndof, ndof..w.len());
        self.past.copy_from_slice(w);
        add_scaled(&mut self.past[v.clone()], f.c[i] * h, &w[ndof..2 * ndof]);
        self.extra.fill(0.0);
        for j in 0..i {
            let slope = &self.slopes[j + 1][rates.clone()];
            add_scaled(&mut self.past[v.clone()], h * h * f.mu[i][j], &slope[..ndof]);
            add_scaled(&mut self.past[rates.clone()], h * f.a[i][j], slope);
        }
        let extra = 2 * ndof..w.len();
        if i == 0 {
            x.copy_from_slice(&x_known[0]);
            add_scaled(&mut self.extra[extra.clone()], 1.0, &self.slopes[0][extra.clone()]);
        } else {
            x.fill(0.0);
            for (k, weight) in self.predictors[i].iter().enumerate().take(i + 1) {
                add_scaled(x, *weight, &x_known[k]);
                add_scaled(&mut self.extra[extra.clone()], *weight, &self.slopes[k][extra.clone()]);
            }
        }
        // The first solved stage may go on from the step before.
        let first = f.implicit_stages().start == i;
        if first && self.options.adapt_iteration && self.earlier.1 > 0.0 {
            let ratio = f.c[i] * h / self.earlier.1;
            add_scaled(x, ratio, &x_known[0]);
            add_scaled(x, -ratio, &self.earlier.0);
        }
        let scale = f.gamma * h;
        for (z, past) in self.extra[extra.clone()].iter_mut().zip(&self.past[extra]) {
            *z = past + scale * *z;
        }
    }

    /// Newton iteration of all stages. Returns the iterations of the last stage.
    fn iterate(
        &mut self,
        system: &mut dyn SecondOrder,
        t: f64,
        h: f64,
        w: &[f64],
        report: &mut StepReport,
    ) -> Result<u32, StageFailure> {
        let ndof = system.second_order_split();
        let (gamma_h, beta_h2) = (self.formula.gamma * h, self.formula.beta * h * h);
        let mut last_stage = 0;
        report.contraction = 0.0;
        if self.formula.explicit_first {
            let (start, rest) = self.slopes.split_at_mut(1);
            rest[0].copy_from_slice(&start[0]);
            let (start, rest) = self.x.split_at_mut(1);
            rest[0].copy_from_slice(&start[0]);
        }
        for i in self.formula.implicit_stages() {
            self.predict(i, h, ndof, w);
            let mut monitor = NewtonMonitor::start(
                self.options.iteration(),
                self.memory.eta[i],
                self.effect[i] * self.floor,
            );
            let at = t + self.formula.c[i] * h;
            let verdict = loop {
                self.statistics.derivatives += 1;
                let stage =
                    Stage { t: at, gamma_h, beta_h2, past: &self.past, residual: self.residual };
                let (x, z) = (&mut self.x[i + 1], &mut self.extra[2 * ndof..]);
                if let Err(failure) = system.correct(&stage, x, z, &mut self.work) {
                    self.memory.eta[i] = 1.0;
                    return Err((Rejection::Evaluation(failure), 0.5));
                }
                self.statistics.solves += 1;
                self.statistics.iterations += 1;
                report.iterations += 1;
                let verdict = monitor.observe(self.effect[i] * system.norm(&self.work));
                if verdict != IterationVerdict::Continue {
                    break verdict;
                }
            };
            self.memory.eta[i] = monitor.eta();
            report.contraction = report.contraction.max(monitor.contraction().unwrap_or(0.0));
            match verdict {
                IterationVerdict::Slow { ratio } => return Err((Rejection::NewtonSlow, ratio)),
                IterationVerdict::Diverged => {
                    self.memory.eta = [1.0; MAX_STAGES];
                    return Err((Rejection::NewtonDivergence, 0.5));
                }
                IterationVerdict::Converged | IterationVerdict::Continue => {}
            }
            last_stage = monitor.iterations();
            self.finish_stage(system, i, gamma_h, beta_h2, ndof);
        }
        Ok(last_stage)
    }

    /// Slopes and end of a stage whose accelerations are found.
    fn finish_stage(
        &mut self,
        system: &mut dyn SecondOrder,
        i: usize,
        gamma_h: f64,
        beta_h2: f64,
        ndof: usize,
    ) {
        let (v, rest) = self.slopes[i + 1].split_at_mut(ndof);
        let (rate, z_rate) = rest.split_at_mut(ndof);
        system.acceleration(&self.x[i + 1], rate);
        for k in 0..ndof {
            v[k] = self.past[ndof + k] + gamma_h * rate[k];
            self.end[k] = self.past[k] + beta_h2 * rate[k];
            self.end[ndof + k] = v[k];
        }
        for (k, rate) in (2 * ndof..).zip(z_rate) {
            self.end[k] = self.extra[k];
            *rate = (self.extra[k] - self.past[k]) / gamma_h;
        }
    }

    /// Linearization, factorization and stages. An iteration that fails is repeated with a fresh
    /// linearization, then with the other residual, before the step is made shorter.
    fn stages(
        &mut self,
        system: &mut dyn SecondOrder,
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
            self.linearize(system, t, w, g)?;
        }
        self.find_start(system, w, g);
        self.factor(system, h)?;
        let mut outcome = self.iterate(system, t, h, w, report);
        if outcome.is_err() && self.linearization == Linearization::Old {
            self.linearize(system, t, w, g)?;
            self.factor(system, h)?;
            outcome = self.iterate(system, t, h, w, report);
        }
        if outcome.is_err() && self.options.adapt_iteration {
            let before = self.residual;
            self.residual = before.other();
            let other = self.iterate(system, t, h, w, report);
            if other.is_ok() {
                return other;
            }
            self.residual = before;
        }
        outcome
    }

    /// Scaled error, filtered; filtered once more where a first or repeated attempt would fail,
    /// because transients there are not what the step has to follow.
    fn error(&mut self, system: &mut dyn SecondOrder, h: f64) -> f64 {
        let f = &self.formula;
        let ndof = system.second_order_split();
        self.work.fill(0.0);
        let (position, rates) = self.work.split_at_mut(ndof);
        for i in 0..f.stages {
            let slope = &self.slopes[i + 1][ndof..];
            add_scaled(position, h * h * f.position_error[i], &slope[..ndof]);
            add_scaled(rates, h * f.velocity_error[i], slope);
        }
        if !self.options.filter_error {
            return system.error_norm(&self.work, &self.end);
        }
        self.statistics.solves += 1;
        system.filter(&mut self.work);
        let error = system.error_norm(&self.work, &self.end);
        let fragile = self.memory.history.accepted.is_none() || self.memory.history.rejected;
        if !(error > 1.0 && fragile && !self.options.fixed_step) {
            return error;
        }
        self.statistics.solves += 1;
        system.filter(&mut self.work);
        system.error_norm(&self.work, &self.end)
    }

    /// Stores the dense output of an accepted step.
    fn finish(&mut self, system: &mut dyn SecondOrder, h: f64, w: &[f64]) {
        system.end_step(&self.x[self.formula.stages]);
        self.current.begin(h, w);
        match &self.formula.continuation {
            Continuation::Stages(dense) => {
                for (slope, weights) in self.slopes[1..].iter().zip(dense) {
                    self.current.add(h, weights, slope);
                }
            }
            Continuation::Hermite => {
                let ndof = system.second_order_split();
                for k in 0..w.len() {
                    let change = self.end[k] - w[k];
                    if k < ndof {
                        let slopes = [h * w[ndof + k], h * self.end[ndof + k]];
                        self.current.set_cubic(k, change, slopes);
                    } else {
                        self.current.set_linear(k, change);
                    }
                }
            }
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

impl Stepper for NystromStepper {
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
        self.start = Start::Evaluated;
    }

    fn invalidate(&mut self, keep_history: bool) {
        self.commit();
        if !keep_history {
            self.earlier.1 = 0.0;
            self.memory.eta = [1.0; MAX_STAGES];
        }
        self.start_known = false;
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
        let mut report = StepReport::rejected(0.5 * h);
        let Some(system) = ode.second_order() else {
            report.cause = Some(Rejection::Evaluation(EvaluationFailure {
                code: "simulation/second-order-only",
                message: "this form of the equations has no accelerations to solve for".into(),
            }));
            return report;
        };
        if std::mem::take(&mut self.advance) {
            system.start_step();
        }
        // A step without error control may start at w = 0; elsewhere |w| alone is the safe scale.
        let movement = if self.options.fixed_step { h } else { 0.0 };
        for ((scale, &w), &g) in self.work.iter_mut().zip(w).zip(g) {
            *scale = w.abs() + movement * g.abs();
        }
        self.floor = f64::EPSILON * system.norm(&self.work);
        self.before = self.memory;
        match self.stages(system, t, h, w, g, &mut report) {
            Err((cause, ratio)) => {
                self.earlier.1 = 0.0;
                self.memory.history.reject();
                self.memory.contraction = f64::INFINITY;
                report.next_step = h * ratio;
                report.cause = Some(cause);
            }
            Ok(last_stage) => {
                if report.contraction > 0.0 {
                    self.memory.contraction = report.contraction;
                }
                let error = self.error(system, h);
                match self.judge(h, error, last_stage) {
                    StepVerdict::Accept { next } => {
                        self.finish(system, h, w);
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
        let slope = &self.slopes[self.formula.stages];
        StepEnd { w: &self.end, slope, evaluated: false }
    }

    fn interpolate(&mut self, theta: f64, w: &mut [f64]) {
        self.last().interpolate(theta, w);
    }

    fn last_change(&self) -> &[f64] {
        &self.work
    }

    fn statistics(&self) -> &StepperStatistics {
        &self.statistics
    }
}
