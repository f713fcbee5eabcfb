//! Stepper of Rosenbrock formulas: ForRosen for ẇ = g(t, w). Every accepted step linearizes, nothing is
//! iterated.

use super::attempt::ImplicitStepper;
use super::counted::Counted;
use super::iteration::{Failure, Iteration};
use super::ode::EvaluationFailure;
use super::segment::Segment;
use super::stages::{Stages, Step};
use super::stepper::{StepEnd, StepperOptions, add_scaled};
use crate::formula::Rosenbrock;

const STAGES: usize = 4;

/// Passes of the filter of the slopes of dense output.
const SMOOTHING: usize = 6;

/// Stepper of a Rosenbrock formula.
///
/// Dense output is the cubic Hermite polynomial of states and slopes; positions, where the system
/// names them ([`crate::method::ode::Ode::second_order_split`]), take the quintic one with second
/// derivatives as well. A slope carries the error of the state multiplied by the stiffness, so that the one
/// of `docs/theory/method.md` (12) takes its place.
pub type RosenbrockStepper = ImplicitStepper<RosenbrockStages>;

impl RosenbrockStepper {
    /// A stepper for systems of `dimension` unknowns.
    pub fn new(formula: &'static Rosenbrock, dimension: usize, options: StepperOptions) -> Self {
        let vector = || vec![0.0; dimension];
        let stages = RosenbrockStages {
            formula,
            u: std::array::from_fn(|_| vector()),
            time_slope: vector(),
            stage_slope: vector(),
            state: vector(),
            end: vector(),
            end_slope: vector(),
            smooth: [vector(), vector()],
            rough: vector(),
            knows_rough: false,
        };
        Self::of(stages, dimension, options)
    }
}

/// Stages of a Rosenbrock formula.
#[derive(Debug, Clone)]
pub struct RosenbrockStages {
    formula: &'static Rosenbrock,
    u: [Vec<f64>; STAGES],
    time_slope: Vec<f64>,
    /// The last evaluation of g.
    stage_slope: Vec<f64>,
    state: Vec<f64>,
    end: Vec<f64>,
    end_slope: Vec<f64>,
    /// Slopes of dense output at both ends.
    smooth: [Vec<f64>; 2],
    /// The rough part of what the slope of rates at an end of the step has beyond the parabola, and whether it is that at the end of
    /// the present attempt.
    rough: Vec<f64>,
    knows_rough: bool,
}

impl RosenbrockStages {
    /// What the slope of rates at the start, or `last`, at the end has beyond the parabola, without what is smooth.
    fn rough_slope(&mut self, ode: &mut Counted<'_>, step: &Step<'_>, last: bool) {
        let split = ode.second_order_split();
        let slope = if last { &self.end_slope[..] } else { step.g };
        self.rough.fill(0.0);
        for k in 0..split {
            self.rough[split + k] =
                slope[split + k] - parabola(step, &self.end, [k, split + k], last);
        }
        self.stage_slope.fill(0.0);
        keep_rough(ode, &mut self.rough, &mut self.stage_slope);
    }
}

impl Stages for RosenbrockStages {
    const DEGREE: usize = 5;
    const ITERATES: bool = false;
    // The formula is not stiffly accurate: on stiff components its error does not vanish with 1/λ
    // (Prothero and Robinson's problem) while the filtered estimate does.
    const LEAST_FILTERED: Option<f64> = Some(0.1);

    fn order(&self) -> u32 {
        self.formula.order
    }

    fn gamma(&self) -> f64 {
        self.formula.gamma
    }

    fn embedded_order(&self) -> u32 {
        self.formula.embedded_order
    }

    fn linearize(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
    ) -> Result<(), EvaluationFailure> {
        ode.linearize(step.t, step.w)?;
        ode.time_derivative(&mut self.time_slope)
    }

    fn factor(&mut self, ode: &mut Counted<'_>, h: f64) -> Result<(), EvaluationFailure> {
        ode.factor(self.formula.gamma * h)
    }

    fn iterate(
        &mut self,
        ode: &mut Counted<'_>,
        &Step { t, h, w, g, .. }: &Step<'_>,
        _iteration: &mut Iteration<'_>,
    ) -> Result<u32, Failure> {
        let f = self.formula;
        self.knows_rough = false;
        self.stage_slope.copy_from_slice(g);
        for i in 0..STAGES {
            let (known, rest) = self.u.split_at_mut(i);
            let u = &mut rest[0];
            if i > 0 && f.a[i] != f.a[i - 1] {
                self.state.copy_from_slice(w);
                for (j, known) in known.iter().enumerate() {
                    add_scaled(&mut self.state, f.a[i][j], known);
                }
                ode.derivative(t + f.alpha[i] * h, &self.state, &mut self.stage_slope)?;
            }
            u.fill(0.0);
            add_scaled(u, f.gamma * h, &self.stage_slope);
            add_scaled(u, f.gamma * f.epsilon[i] * h * h, &self.time_slope);
            for (j, known) in known.iter().enumerate() {
                add_scaled(u, f.gamma * f.c[i][j], known);
            }
            ode.solve(u);
        }
        Ok(1)
    }

    /// Σ eᵢ uᵢ. The error of a step whose end cannot be evaluated would be worth nothing.
    fn estimate(
        &mut self,
        ode: &mut Counted<'_>,
        step: &Step<'_>,
        error: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        error.fill(0.0);
        self.end.copy_from_slice(step.w);
        for (u, (&e, &m)) in self.u.iter().zip(self.formula.e.iter().zip(&self.formula.m)) {
            add_scaled(error, e, u);
            add_scaled(&mut self.end, m, u);
        }
        // Dense output needs this slope, and it is the first stage of the next step.
        ode.derivative(step.t + step.h, &self.end, &mut self.end_slope)
    }

    fn imbalance(&mut self, ode: &mut Counted<'_>, step: &Step<'_>, error: &mut [f64]) -> bool {
        self.rough_slope(ode, step, true);
        self.knows_rough = true;
        for (error, rough) in error.iter_mut().zip(&self.rough) {
            *error = self.formula.gamma * step.h * rough;
        }
        ode.solve(error);
        true
    }

    fn estimate_again(&mut self, _: &mut Counted<'_>, _: &Step<'_>, _: &mut [f64]) -> bool {
        false
    }

    fn end(&self) -> StepEnd<'_> {
        StepEnd { w: &self.end, slope: &self.end_slope }
    }

    fn end_defect(&mut self, ode: &Counted<'_>, step: &Step<'_>, defect: &mut [f64]) {
        let (h, split) = (step.h, ode.second_order_split());
        defect.fill(0.0);
        for k in 0..split {
            let parabola = parabola(step, &self.end, [k, split + k], true);
            let beyond = self.end_slope[split + k] - parabola;
            defect[split + k] = self.formula.gamma * h * beyond;
        }
    }

    fn finish(&mut self, ode: &mut Counted<'_>, step: &Step<'_>, segment: &mut Segment) {
        let &Step { h, w, g, .. } = step;
        let split = ode.second_order_split();
        let own = 2 * split..w.len();
        // The end first: the estimate has left what it needs.
        for last in [true, false] {
            let slope = if last { &self.end_slope[..] } else { g };
            let smooth = &mut self.smooth[usize::from(last)];
            if !own.is_empty() {
                // Its balance with what changes it by itself is a matter of the first pass.
                self.stage_slope.copy_from_slice(&self.time_slope);
                self.stage_slope.iter_mut().for_each(|x| *x *= self.formula.gamma * h);
                self.state.copy_from_slice(slope);
                keep_rough(ode, &mut self.state, &mut self.stage_slope);
                for k in own.clone() {
                    smooth[k] = slope[k] - self.state[k];
                }
            }
            if !(last && self.knows_rough) {
                self.rough_slope(ode, step, last);
            }
            let slope = if last { &self.end_slope[..] } else { g };
            for k in split..2 * split {
                self.smooth[usize::from(last)][k] = slope[k] - self.rough[k];
            }
        }
        segment.begin(h, w);
        let [first, last] = &self.smooth;
        for i in 0..w.len() {
            let change = self.end[i] - w[i];
            if i < split {
                let bends = [h * h * first[split + i], h * h * last[split + i]];
                segment.set_quintic(i, change, [h * g[i], h * self.end_slope[i]], bends);
            } else {
                segment.set_cubic(i, change, [h * first[i], h * last[i]]);
            }
        }
    }
}

/// Slope of a rate at the start or, `last`, at the end of a step: that of the parabola with both rates that makes the change of
/// the position. Both are named by their numbers in w.
fn parabola(step: &Step<'_>, end: &[f64], [position, rate]: [usize; 2], last: bool) -> f64 {
    let v = [step.w[rate], end[rate]];
    let bend = 6.0 * (end[position] - step.w[position]) / step.h - 3.0 * (v[0] + v[1]);
    (v[1] - v[0] + if last { -bend } else { bend }) / step.h
}

/// x ← (I − F)⁶ x with the filter F = (I − γhJ)⁻¹ of [`Counted::solve`], of F (x + y) in place of F x in the first pass.
fn keep_rough(ode: &mut Counted<'_>, x: &mut [f64], y: &mut [f64]) {
    for _ in 0..SMOOTHING {
        add_scaled(y, 1.0, x);
        ode.solve(y);
        add_scaled(x, -1.0, y);
        y.fill(0.0);
    }
}
