//! Stepper of SDIRK formulas in z-form: ForSDIRK for ẇ = g(t, w).
//!
//! ```text
//! z̃ = Σ_{j<i} ζᵢⱼ zⱼ    r = γh [g(t₀ + cᵢh, w₀ + zᵢ) − (zᵢ − z̃)/γh]    (I − γhJ) δ = r    zᵢ ← zᵢ + δ
//! ```
//!
//! Source: thesis sections 4.3 and 5.5; Hairer & Wanner, *Solving ODEs II*, section IV.8.

use super::attempt::ImplicitStepper;
use super::counted::Counted;
use super::iteration::{Failure, Iteration};
use super::ode::EvaluationFailure;
use super::segment::Segment;
use super::stage_errors::{STAGES, StageErrors, StepFilter, UNIT};
use super::stages::{Stages, Step};
use super::stepper::{StepEnd, StepperOptions, add_scaled};
use crate::formula::{Sdirk, error_at_kinks};

/// Stepper of an SDIRK formula.
pub type SdirkStepper = ImplicitStepper<SdirkStages>;

impl SdirkStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Sdirk, dimension: usize, options: StepperOptions) -> Self {
        let vector = || vec![0.0; dimension];
        let stages = SdirkStages {
            formula,
            errors: StageErrors::new(&formula.a, &formula.c, &formula.dense, &UNIT, dimension),
            z: std::array::from_fn(|_| vector()),
            past: vector(),
            state: vector(),
            end: vector(),
            slope: vector(),
        };
        Self::of(stages, dimension, options)
    }
}

/// Stages of an SDIRK formula.
#[derive(Debug, Clone)]
pub struct SdirkStages {
    formula: &'static Sdirk,
    errors: StageErrors,
    z: [Vec<f64>; STAGES],
    past: Vec<f64>,
    state: Vec<f64>,
    end: Vec<f64>,
    slope: Vec<f64>,
}

impl SdirkStages {
    /// Start value of stage `i` and its past part.
    fn predict(&mut self, i: usize, ode: &Counted<'_>, step: &Step<'_>, before: Option<&Segment>) {
        let (known, rest) = self.z.split_at_mut(i);
        let z = &mut rest[0];
        self.past.fill(0.0);
        if i == 0 {
            step.predict(self.formula.c[0], ode.second_order_split(), before, z);
            return;
        }
        z.fill(0.0);
        let weights =
            if i == STAGES - 1 { &self.formula.d_hat } else { &self.formula.predictor[i] };
        for (j, known) in known.iter().enumerate() {
            add_scaled(z, weights[j], known);
            add_scaled(&mut self.past, self.formula.zeta[i][j], known);
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
        let gamma_h = self.formula.gamma * step.h;
        let z = &mut self.z[i];
        for ((state, &w), &z) in self.state.iter_mut().zip(step.w).zip(&*z) {
            *state = w + z;
        }
        for ((slope, &past), &z) in self.slope.iter_mut().zip(&self.past).zip(&*z) {
            *slope = (z - past) / gamma_h;
        }
        let at = step.t + self.formula.c[i] * step.h;
        ode.defect(0, at, &self.state, &self.slope, change)?;
        change.iter_mut().for_each(|r| *r *= gamma_h);
        ode.solve_defect(change);
        let norm = ode.norm(change);
        let turns = ode.turns();
        ode.turn(0, change);
        add_scaled(z, 1.0, change);
        // Positions follow from rates: those equations are linear.
        let n = if turns { ode.second_order_split() } else { 0 };
        for k in 0..n {
            z[k] = self.past[k] + gamma_h * (step.w[n + k] + z[n + k]);
        }
        Ok(norm)
    }
}

impl Stages for SdirkStages {
    const DEGREE: usize = 4;

    fn order(&self) -> u32 {
        self.formula.order
    }

    fn error_at_kinks(&self) -> f64 {
        let Sdirk { a, b_hat, c, .. } = self.formula;
        let b = &a[STAGES - 1];
        let error: [f64; STAGES] = std::array::from_fn(|i| b[i] - b_hat[i]);
        error_at_kinks(c, b, &error)
    }

    fn balanced_places(&self) -> &[f64] {
        self.errors.places()
    }

    fn gamma(&self) -> f64 {
        self.formula.gamma
    }

    fn embedded_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn factor(&mut self, ode: &mut Counted<'_>, h: f64) -> Result<(), EvaluationFailure> {
        ode.factor(self.formula.gamma * h)
    }

    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        iteration: &mut Iteration<'_>,
    ) -> Result<u32, Failure> {
        let mut last_stage = 0;
        for i in 0..STAGES {
            self.predict(i, ode, step, iteration.before);
            let effect = self.formula.effect(i);
            let correct = |change: &mut [f64]| self.correct(i, ode, step, change);
            // Later stages start from those before.
            let foreseen = i > 0 || iteration.before.is_some();
            last_stage = iteration.converge(i, effect, foreseen, correct)?;
        }
        Ok(last_stage)
    }

    /// z₅ − Σ d̂ⱼ zⱼ.
    fn estimate(
        &mut self,
        _ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let last = &self.z[STAGES - 1];
        error.copy_from_slice(last);
        for (z, &d) in self.z.iter().zip(&self.formula.d_hat) {
            add_scaled(error, -d, z);
        }
        self.end.copy_from_slice(step.w);
        add_scaled(&mut self.end, 1.0, last);
        Ok(())
    }

    fn own_error(&mut self, ode: &mut Counted<'_>, _h: f64, error: &mut [f64]) -> bool {
        let mut filter = StepFilter { ode, end: &self.end, by: Counted::solve };
        self.errors.at_end(1.0, &self.z, error, &mut filter);
        true
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.end, slope: &self.slope }
    }

    fn finish(&mut self, _ode: &mut Counted<'_>, step: &Step<'_>, segment: &mut Segment) {
        let gamma_h = self.formula.gamma * step.h;
        // From the formula and not by a new evaluation: that would multiply what is left of the
        // iteration error by the stiffness, this divides it by γh. It costs nothing, either.
        for ((slope, last), past) in self.slope.iter_mut().zip(&self.z[STAGES - 1]).zip(&self.past)
        {
            *slope = (last - past) / gamma_h;
        }
        segment.begin(step.h, step.w);
        for (z, weights) in self.z.iter().zip(&self.formula.dense) {
            segment.add(1.0, weights, z);
        }
    }

    fn correct_inside(&mut self, ode: &mut Counted<'_>, output: &mut Segment, left: &mut [f64]) {
        let mut filter = StepFilter { ode, end: &self.end, by: Counted::solve };
        self.errors.correct(output, left, &mut filter);
    }
}
