//! A system as implicit formulas use it: every call that costs something is counted.

use super::ode::{Complex64, EvaluationFailure, LinearizedOde, SecondOrder, Stage};
use super::stepper::StepperStatistics;

/// A system with the work done on it. Each method is that of [`LinearizedOde`] or [`SecondOrder`].
pub struct Counted<'a> {
    ode: &'a mut dyn LinearizedOde,
    pub(super) statistics: StepperStatistics,
}

impl<'a> Counted<'a> {
    /// Goes on counting from `statistics`.
    pub(super) fn new(ode: &'a mut dyn LinearizedOde, statistics: StepperStatistics) -> Self {
        Self { ode, statistics }
    }

    pub(super) fn norm(&mut self, change: &[f64]) -> f64 {
        self.ode.norm(change)
    }

    pub(super) fn error_norm(&mut self, error: &[f64], w_end: &[f64]) -> f64 {
        self.ode.error_norm(error, w_end)
    }

    pub(super) fn second_order_split(&self) -> usize {
        self.ode.second_order_split()
    }

    pub(super) fn derivative(
        &mut self,
        t: f64,
        w: &[f64],
        g: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.statistics.derivatives += 1;
        self.ode.derivative(t, w, g)
    }

    pub(super) fn defect(
        &mut self,
        stage: usize,
        t: f64,
        w: &[f64],
        slope: &[f64],
        defect: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.statistics.derivatives += 1;
        self.ode.defect(stage, t, w, slope, defect)
    }

    pub(super) fn turns(&self) -> bool {
        self.ode.turns()
    }

    pub(super) fn turn_back(&mut self, change: &mut [f64]) {
        self.ode.turn_back(change);
    }

    pub(super) fn turn(&mut self, stage: usize, change: &mut [f64]) {
        self.ode.turn(stage, change);
    }

    pub(super) fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        self.statistics.linearizations += 1;
        self.ode.linearize(t, w)
    }

    pub(super) fn linearize_ahead(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.statistics.linearizations += 1;
        self.ode.linearize_ahead(t, w, slope)
    }

    pub(super) fn simplify(&mut self, simplify: bool) {
        self.ode.simplify(simplify);
    }

    pub(super) fn is_simplified(&self) -> bool {
        self.ode.is_simplified()
    }

    pub(super) fn has_accelerations(&self) -> bool {
        self.ode.has_accelerations()
    }

    pub(super) fn take_accelerations(&mut self, take: bool) {
        self.ode.take_accelerations(take);
    }

    fn count_factorization(&mut self) {
        self.statistics.factorizations += 1;
        self.statistics.simplified_factorizations += u64::from(self.ode.is_simplified());
    }

    pub(super) fn time_derivative(&mut self, g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        self.ode.time_derivative(g_t)
    }

    pub(super) fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.count_factorization();
        self.ode.factor(gamma_h)
    }

    pub(super) fn factor_complex(&mut self, gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        self.count_factorization();
        self.ode.factor_complex(gamma_h)
    }

    pub(super) fn solve(&mut self, x: &mut [f64]) {
        self.statistics.solves += 1;
        self.ode.solve(x);
    }

    pub(super) fn solve_defect(&mut self, x: &mut [f64]) {
        self.statistics.solves += 1;
        self.ode.solve_defect(x);
    }

    pub(super) fn solve_complex_defect(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.statistics.solves += 1;
        self.ode.solve_complex_defect(x, y);
    }

    /// The same system with accelerations as unknowns; what is called on it is not counted.
    pub(super) fn second_order(&mut self) -> Result<&mut dyn SecondOrder, EvaluationFailure> {
        self.ode.second_order().ok_or_else(|| {
            EvaluationFailure::new(
                "simulation/second-order-only",
                "this form of the equations has no accelerations to solve for",
            )
        })
    }

    pub(super) fn factor_stage(
        &mut self,
        gamma_h: f64,
        beta_h2: f64,
    ) -> Result<(), EvaluationFailure> {
        self.count_factorization();
        self.second_order()?.factor_stage(gamma_h, beta_h2)
    }

    pub(super) fn correct(
        &mut self,
        stage: &Stage<'_>,
        x: &mut [f64],
        z: &mut [f64],
        change: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.statistics.derivatives += 1;
        self.second_order()?.correct(stage, x, z, change)?;
        self.statistics.solves += 1;
        Ok(())
    }

    pub(super) fn filter(&mut self, error: &mut [f64]) {
        if let Some(system) = self.ode.second_order() {
            self.statistics.solves += 1;
            system.filter(error);
        }
    }

    pub(super) fn end_step(&mut self, x: &[f64]) {
        if let Some(system) = self.ode.second_order() {
            system.end_step(x);
        }
    }
}
