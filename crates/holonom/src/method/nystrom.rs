//! Stepper of diagonally implicit formulas in second-order form: stages are solved for accelerations.
//!
//! Source: thesis sections 3.2.2, 3.3, 4.1, 4.2 and 5.5.

use super::attempt::ImplicitStepper;
use super::counted::Counted;
use super::iteration::{Failure, Iteration, MAX_SYSTEMS};
use super::nystrom_start::Start;
use super::ode::{EvaluationFailure, Stage};
use super::segment::Segment;
use super::stage_errors::{StageErrors, StepFilter};
use super::stages::{Stages, Step};
use super::stepper::{StepEnd, StepperOptions, add_scaled};
use crate::formula::{Continuation, Nystrom, error_at_kinks};

/// Stepper of a diagonally implicit formula in second-order form, for systems with
/// [`crate::method::ode::LinearizedOde::second_order`].
pub type NystromStepper = ImplicitStepper<NystromStages>;

impl NystromStepper {
    /// A stepper for systems of `dimension` entries of w and `unknowns` per stage.
    pub fn new(
        formula: Nystrom,
        dimension: usize,
        unknowns: usize,
        options: StepperOptions,
    ) -> Self {
        let vector = || vec![0.0; dimension];
        let stages = NystromStages {
            predictors: std::array::from_fn(|i| {
                if i > 0 { formula.predictor(i) } else { [0.0; MAX_SYSTEMS] }
            }),
            continues: options.improves(),
            errors: match &formula.continuation {
                Continuation::Stages(dense) => {
                    Some(StageErrors::new(&formula.a, &formula.c, dense, &formula.a, dimension))
                }
                Continuation::Hermite => None,
            },
            start: Start::FIRST,
            x: vec![vec![0.0; unknowns]; formula.stages + 1],
            slopes: vec![vector(); formula.stages + 1],
            earlier: vec![0.0; unknowns],
            past: vector(),
            extra: vector(),
            movement: vector(),
            end: vector(),
            formula,
        };
        Self::of(stages, dimension, options)
    }
}

/// Movements beyond this multiple of those continued from the step before are no continuation of it.
const FARTHER: f64 = 4.0;

/// Stages of a formula in second-order form.
#[derive(Debug, Clone)]
pub struct NystromStages {
    formula: Nystrom,
    predictors: [[f64; MAX_SYSTEMS]; MAX_SYSTEMS],
    /// The first stage is predicted from the step before.
    continues: bool,
    errors: Option<StageErrors>,
    start: Start,
    /// Unknowns at the start and of every stage.
    x: Vec<Vec<f64>>,
    /// Slopes (v̇, v̈, ż) at the start and of every stage.
    slopes: Vec<Vec<f64>>,
    /// The first unknown of the last step that was solved for, or its start.
    earlier: Vec<f64>,
    past: Vec<f64>,
    extra: Vec<f64>,
    /// Predicted change of w up to a stage.
    movement: Vec<f64>,
    end: Vec<f64>,
}

impl NystromStages {
    /// Past part and start value of stage `i`.
    fn predict(&mut self, i: usize, ndof: usize, step: &Step<'_>, before: Option<&Segment>) {
        let (f, h, w) = (&self.formula, step.h, step.w);
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
        if let Some(before) = before.filter(|_| self.continues && i == f.implicit_stages().start) {
            let ratio = f.c[i] * h / (before.step * (1.0 - f.c[0]));
            add_scaled(x, ratio, &x_known[0]);
            add_scaled(x, -ratio, &self.earlier);
        }
        let scale = f.gamma * h;
        for (z, past) in self.extra[extra.clone()].iter_mut().zip(&self.past[extra]) {
            *z = past + scale * *z;
        }
    }

    /// Starts stage `i` where the step before, continued, would be, if accelerations lead much farther. Formulas
    /// that damp nothing leave accelerations of stiff components that change their sign at every step, while
    /// the motion hardly does.
    fn stay_near(&mut self, i: usize, ode: &mut Counted<'_>, step: &Step<'_>, before: &Segment) {
        let (f, h, ndof) = (&self.formula, step.h, ode.second_order_split());
        let (gamma_h, beta_h2) = (f.gamma * h, f.beta * h * h);
        let x = &mut self.x[i + 1];
        let first = x.len() - ndof;
        let rates = &mut x[first..];
        self.movement.fill(0.0);
        for k in 0..ndof {
            self.movement[k] = self.past[k] + beta_h2 * rates[k] - step.w[k];
            self.movement[ndof + k] = self.past[ndof + k] + gamma_h * rates[k] - step.w[ndof + k];
        }
        let farther = ode.norm(&self.movement);
        before.continue_by(f.c[i] * h, &mut self.movement);
        self.movement[2 * ndof..].fill(0.0);
        if farther > FARTHER * ode.norm(&self.movement) {
            for k in 0..ndof {
                let v = step.w[ndof + k] + self.movement[ndof + k];
                rates[k] = (v - self.past[ndof + k]) / gamma_h;
            }
        }
    }

    /// One correction of stage `i`. Returns its norm.
    fn correct(
        &mut self,
        i: usize,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        change: &mut [f64],
    ) -> Result<f64, EvaluationFailure> {
        let f = &self.formula;
        let stage = Stage {
            t: step.t + f.c[i] * step.h,
            gamma_h: f.gamma * step.h,
            beta_h2: f.beta * step.h * step.h,
            past: &self.past,
        };
        let z = &mut self.extra[2 * ode.second_order_split()..];
        ode.correct(&stage, &mut self.x[i + 1], z, change)?;
        Ok(ode.norm(change))
    }

    /// Slopes and end of a stage whose accelerations are found.
    fn finish_stage(
        &mut self,
        i: usize,
        ode: &mut Counted<'_>,
        h: f64,
    ) -> Result<(), EvaluationFailure> {
        let (gamma_h, beta_h2) = (self.formula.gamma * h, self.formula.beta * h * h);
        let ndof = ode.second_order_split();
        let (v, rest) = self.slopes[i + 1].split_at_mut(ndof);
        let (rate, z_rate) = rest.split_at_mut(ndof);
        ode.second_order()?.acceleration(&self.x[i + 1], rate);
        for k in 0..ndof {
            v[k] = self.past[ndof + k] + gamma_h * rate[k];
            self.end[k] = self.past[k] + beta_h2 * rate[k];
            self.end[ndof + k] = v[k];
        }
        for (k, rate) in (2 * ndof..).zip(z_rate) {
            self.end[k] = self.extra[k];
            *rate = (self.extra[k] - self.past[k]) / gamma_h;
        }
        Ok(())
    }
}

impl Stages for NystromStages {
    const DEGREE: usize = 4;
    const REPEATS_EVALUATIONS: bool = true;

    fn order(&self) -> u32 {
        self.formula.order
    }

    fn rates_are_lines(&self) -> bool {
        matches!(self.formula.continuation, Continuation::Hermite)
    }

    fn balanced_places(&self) -> &[f64] {
        self.errors.as_ref().map_or(&[], StageErrors::places)
    }

    fn gamma(&self) -> f64 {
        self.formula.gamma
    }

    fn embedded_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn factor(&mut self, ode: &mut Counted<'_>, h: f64) -> Result<(), EvaluationFailure> {
        ode.factor_stage(self.formula.gamma * h, self.formula.beta * h * h)
    }

    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        iteration: &mut Iteration<'_>,
    ) -> Result<u32, Failure> {
        self.start.find(ode, step, &mut self.x[0], &mut self.slopes[0])?;
        let ndof = ode.second_order_split();
        if self.formula.explicit_first {
            for known in [&mut self.slopes, &mut self.x] {
                let (start, stages) = known.split_at_mut(1);
                stages[0].copy_from_slice(&start[0]);
            }
        }
        iteration.report.contraction = 0.0;
        let mut last_stage = 0;
        for i in self.formula.implicit_stages() {
            self.predict(i, ndof, step, iteration.before);
            if let Some(before) = iteration.before.filter(|_| self.continues) {
                self.stay_near(i, ode, step, before);
            }
            let effect = self.formula.effect(i);
            let correct = |change: &mut [f64]| self.correct(i, ode, step, change);
            // From accelerations, at the start if nowhere else.
            last_stage = iteration.converge(i, effect, true, correct)?;
            self.finish_stage(i, ode, step.h)?;
        }
        Ok(last_stage)
    }

    fn estimate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let (f, h, ndof) = (&self.formula, step.h, ode.second_order_split());
        error.fill(0.0);
        let (position, rates) = error.split_at_mut(ndof);
        for i in 0..f.stages {
            let slope = &self.slopes[i + 1][ndof..];
            add_scaled(position, h * h * f.position_error[i], &slope[..ndof]);
            add_scaled(rates, h * f.velocity_error[i], slope);
        }
        Ok(())
    }

    fn error_at_kinks(&self) -> f64 {
        let Nystrom { a, c, stages, velocity_error, .. } = &self.formula;
        error_at_kinks(&c[..*stages], &a[stages - 1][..*stages], &velocity_error[..*stages])
    }

    fn filter(&mut self, ode: &mut Counted<'_>, error: &mut [f64]) {
        ode.filter(error);
    }

    fn own_error(&mut self, ode: &mut Counted<'_>, h: f64, error: &mut [f64]) -> bool {
        let Some(errors) = &mut self.errors else { return false };
        let mut filter = StepFilter { ode, end: &self.end, by: Counted::filter };
        errors.at_end(h, &self.slopes[1..], error, &mut filter);
        true
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.end, slope: &self.slopes[self.formula.stages] }
    }

    fn finish(&mut self, ode: &mut Counted<'_>, step: &Step<'_>, segment: &mut Segment) {
        let (h, w, ndof) = (step.h, step.w, ode.second_order_split());
        ode.end_step(&self.x[self.formula.stages]);
        segment.begin(h, w);
        match &self.formula.continuation {
            Continuation::Stages(dense) => {
                for (slope, weights) in self.slopes[1..].iter().zip(dense) {
                    segment.add(h, weights, slope);
                }
            }
            Continuation::Hermite => {
                for k in 0..w.len() {
                    let change = self.end[k] - w[k];
                    if k < ndof {
                        let slopes = [h * w[ndof + k], h * self.end[ndof + k]];
                        segment.set_cubic(k, change, slopes);
                    } else {
                        segment.set_linear(k, change);
                    }
                }
            }
        }
    }

    fn correct_inside(&mut self, ode: &mut Counted<'_>, output: &mut Segment, left: &mut [f64]) {
        if let Some(errors) = &mut self.errors {
            let mut filter = StepFilter { ode, end: &self.end, by: Counted::filter };
            errors.correct(output, left, &mut filter);
        }
    }

    fn commit(&mut self) {
        self.start.commit();
        let (start, stages) = self.slopes.split_at_mut(1);
        start[0].copy_from_slice(&stages[self.formula.stages - 1]);
        self.earlier.copy_from_slice(&self.x[usize::from(!self.formula.explicit_first)]);
    }

    fn invalidate(&mut self) {
        self.start.invalidate();
    }

    fn restart(&mut self) {
        self.start.restart();
    }
}
