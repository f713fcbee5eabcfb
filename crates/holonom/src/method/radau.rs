//! Stepper of Radau IIA: ForRadau for ẇ = g(t, w). Three coupled stages, split by z = T y into one
//! real and one complex system of the size of w.
//!
//! ```text
//! (I − h/γ̂ J) δ₁ = h/γ̂ r₁                            rᵢ = Σⱼ (T⁻¹)ᵢⱼ g(w₀ + zⱼ) − (Λ y)ᵢ / h
//! (I − h/(α̂+iβ̂) J) (δ₂ + iδ₃) = h/(α̂+iβ̂) (r₂ + ir₃)        y ← y + δ,  Λ = T⁻¹A⁻¹T
//! ```
//!
//! Source: Hairer & Wanner, *Solving ODEs II*, section IV.8.

use super::attempt::ImplicitStepper;
use super::counted::Counted;
use super::iteration::{Failure, Iteration};
use super::ode::{Complex64, EvaluationFailure};
use super::segment::Segment;
use super::stages::{Stages, Step};
use super::stepper::{StepEnd, StepperOptions, add_scaled};
use crate::formula::Radau;

const STAGES: usize = 3;

/// Stepper of the three-stage Radau IIA formula.
pub type RadauStepper = ImplicitStepper<RadauStages>;

impl RadauStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Radau, dimension: usize, options: StepperOptions) -> Self {
        let vector = || vec![0.0; dimension];
        let stages = || std::array::from_fn(|_| vector());
        let stages = RadauStages {
            formula,
            z: stages(),
            y: stages(),
            slopes: stages(),
            defects: stages(),
            corrections: stages(),
            state: vector(),
            end: vector(),
            end_slope: vector(),
        };
        Self::of(stages, dimension, options)
    }
}

/// The three stages, z, and their transforms y.
#[derive(Debug, Clone)]
pub struct RadauStages {
    formula: &'static Radau,
    z: [Vec<f64>; STAGES],
    y: [Vec<f64>; STAGES],
    slopes: [Vec<f64>; STAGES],
    defects: [Vec<f64>; STAGES],
    /// δ.
    corrections: [Vec<f64>; STAGES],
    state: Vec<f64>,
    end: Vec<f64>,
    end_slope: Vec<f64>,
}

impl RadauStages {
    /// Start values of the stages of `step`.
    fn predict(&mut self, ode: &Counted<'_>, step: &Step<'_>, before: Option<&Segment>) {
        for (z, c) in self.z.iter_mut().zip(&self.formula.c) {
            step.predict(*c, ode.second_order_split(), before, z);
        }
        transform(&self.formula.t_inverse, &self.z, &mut self.y);
    }

    /// One correction of all stages. Returns its norm.
    fn correct(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        change: &mut [f64],
    ) -> Result<f64, EvaluationFailure> {
        self.implied_slopes(step.h);
        for i in 0..STAGES {
            for ((state, &w), &z) in self.state.iter_mut().zip(step.w).zip(&self.z[i]) {
                *state = w + z;
            }
            let at = step.t + self.formula.c[i] * step.h;
            ode.defect(i, at, &self.state, &self.slopes[i], &mut self.defects[i])?;
        }
        self.solve(ode, step.h);
        let square: f64 = self.corrections.iter().map(|delta| ode.norm(delta).powi(2)).sum();
        for (y, delta) in self.y.iter_mut().zip(&self.corrections) {
            add_scaled(y, 1.0, delta);
        }
        transform(&self.formula.t, &self.y, &mut self.z);
        change.copy_from_slice(&self.corrections[0]);
        if ode.turns() {
            self.turn(ode, step);
        }
        Ok((square / STAGES as f64).sqrt())
    }

    /// The slopes A⁻¹z / h = T Λy / h that the iterate ascribes to its stages.
    fn implied_slopes(&mut self, h: f64) {
        let f = self.formula;
        let (re, im) = f.complex;
        let [s1, s2, s3] = &mut self.corrections;
        let [y1, y2, y3] = &self.y;
        for i in 0..s1.len() {
            s1[i] = f.real * y1[i] / h;
            s2[i] = (re * y2[i] - im * y3[i]) / h;
            s3[i] = (im * y2[i] + re * y3[i]) / h;
        }
        transform(&f.t, &self.corrections, &mut self.slopes);
    }

    /// Turns the corrections that z has got to their stages. Positions follow from rates: those equations are linear.
    fn turn(&mut self, ode: &mut Counted<'_>, step: &Step<'_>) {
        let (f, n) = (self.formula, ode.second_order_split());
        transform(&f.t, &self.corrections, &mut self.slopes);
        for (i, (z, correction)) in self.z.iter_mut().zip(&mut self.slopes).enumerate() {
            add_scaled(z, -1.0, correction);
            ode.turn(i, correction);
            add_scaled(z, 1.0, correction);
        }
        for k in 0..n {
            let rates: [f64; STAGES] = std::array::from_fn(|j| step.w[n + k] + self.z[j][n + k]);
            for (z, a) in self.z.iter_mut().zip(&f.a) {
                z[k] = step.h * (a[0] * rates[0] + a[1] * rates[1] + a[2] * rates[2]);
            }
        }
        transform(&f.t_inverse, &self.z, &mut self.y);
    }

    /// Corrections of y from the defects at the stages.
    fn solve(&mut self, ode: &mut Counted<'_>, h: f64) {
        let f = self.formula;
        transform(&f.t_inverse, &self.defects, &mut self.corrections);
        let [r1, r2, r3] = &mut self.corrections;
        let (re, im) = f.complex;
        let scale = h / (re * re + im * im);
        for i in 0..r1.len() {
            r1[i] *= h / f.real;
            let (a, b) = (r2[i], r3[i]);
            r2[i] = scale * (re * a + im * b);
            r3[i] = scale * (re * b - im * a);
        }
        ode.solve_defect(r1);
        ode.solve_complex_defect(r2, r3);
    }

    /// γ₀h g + Σ eᵢ zᵢ.
    fn combine(&self, h: f64, slope: &[f64], error: &mut [f64]) {
        error.fill(0.0);
        add_scaled(error, h / self.formula.real, slope);
        for (z, &e) in self.z.iter().zip(&self.formula.e) {
            add_scaled(error, e, z);
        }
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

impl Stages for RadauStages {
    const DEGREE: usize = STAGES;

    fn order(&self) -> u32 {
        self.formula.order
    }

    fn collocation_places(&self) -> Option<&'static [f64; 3]> {
        Some(&self.formula.c)
    }

    fn balanced_places(&self) -> &[f64] {
        &self.formula.c[..STAGES - 1]
    }

    fn gamma(&self) -> f64 {
        1.0 / self.formula.real
    }

    fn embedded_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn factor(&mut self, ode: &mut Counted<'_>, h: f64) -> Result<(), EvaluationFailure> {
        let eigenvalue = Complex64::new(self.formula.complex.0, self.formula.complex.1);
        ode.factor(h / self.formula.real)?;
        ode.factor_complex(h / eigenvalue)
    }

    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        iteration: &mut Iteration<'_>,
    ) -> Result<u32, Failure> {
        self.predict(ode, step, iteration.before);
        let foreseen = iteration.before.is_some();
        iteration.converge(0, 1.0, foreseen, |change| self.correct(ode, step, change))
    }

    /// γ₀h g₀ + Σ eᵢ zᵢ, to be multiplied by (I − γ₀hJ)⁻¹.
    fn estimate(
        &mut self,
        _ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.combine(step.h, step.g, error);
        self.end.copy_from_slice(step.w);
        add_scaled(&mut self.end, 1.0, &self.z[STAGES - 1]);
        Ok(())
    }

    /// With g at w₀ + error in place of g₀.
    fn estimate_again(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> bool {
        for ((state, &w), &e) in self.state.iter_mut().zip(step.w).zip(&*error) {
            *state = w + e;
        }
        let evaluated = ode.derivative(step.t, &self.state, &mut self.end_slope).is_ok();
        if evaluated {
            self.combine(step.h, &self.end_slope, error);
        }
        evaluated
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.end, slope: &self.end_slope }
    }

    fn finish(&mut self, _ode: &mut Counted<'_>, step: &Step<'_>, segment: &mut Segment) {
        // From the formula and not by a new evaluation: that would multiply what is left of the
        // iteration error by the stiffness.
        self.end_slope.fill(0.0);
        for (z, &a) in self.z.iter().zip(&self.formula.a_inverse[STAGES - 1]) {
            add_scaled(&mut self.end_slope, a / step.h, z);
        }
        segment.begin(step.h, step.w);
        for (z, weights) in self.z.iter().zip(&self.formula.dense) {
            segment.add(1.0, weights, z);
        }
    }
}
