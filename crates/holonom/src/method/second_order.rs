//! The view of a system that formulas in second-order form have: v̈ as the unknown of a stage.

use super::ode::{EvaluationFailure, LinearizedOde};

/// What a stage knows before it is solved: v = ṽ + βh² v̈, v̇ = ṽ̇ + γh v̈, z = z̃ + γh ż.
#[derive(Debug, Clone, Copy)]
pub struct Stage<'a> {
    /// Time of the stage, s.
    pub t: f64,
    /// γh.
    pub gamma_h: f64,
    /// βh².
    pub beta_h2: f64,
    /// (ṽ, ṽ̇, z̃).
    pub past: &'a [f64],
}

/// A system M̂ v̈ = Q̂, ż = g whose stages are solved for accelerations.
///
/// The unknown x is what the method iterates on: v̈ (state-space), or q̈ and λ (descriptor form). A
/// change of w is written as (δv, δv̇, δz), so that [`super::ode::Ode::norm`] weighs it.
pub trait SecondOrder: LinearizedOde {
    /// Length of x.
    fn unknowns(&self) -> usize;

    /// Factors the integration Jacobian from the parts of the last `linearize`.
    ///
    /// # Errors
    /// When the matrix is singular.
    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure>;

    /// One Newton correction of x and z; `change` gets its effect (βh² δv̈, γh δv̈, δz).
    ///
    /// # Errors
    /// As [`super::ode::Ode::derivative`].
    fn correct(
        &mut self,
        stage: &Stage<'_>,
        x: &mut [f64],
        z: &mut [f64],
        change: &mut [f64],
    ) -> Result<(), EvaluationFailure>;

    /// v̈ of x.
    fn acceleration(&self, x: &[f64], v_rate: &mut [f64]);

    /// x of the point of the last `linearize`, whose accelerations satisfy the equations.
    fn linearized_unknown(&self, x: &mut [f64]);

    /// Remembers the accelerations x of the end of an accepted step.
    fn end_step(&mut self, x: &[f64]);

    /// That end becomes the start of the next step.
    fn start_step(&mut self);

    /// x of the start, in the present parametrization.
    fn start_unknown(&self, x: &mut [f64]);

    /// Multiplies an error (e_p, e_v, e_z) by (I − γhJ)⁻¹, with the last factor.
    fn filter(&mut self, error: &mut [f64]);
}
