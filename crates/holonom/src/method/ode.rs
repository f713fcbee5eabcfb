//! The view of a system that integration formulas have: ẇ = g(t, w) with its linearization, or with
//! v̈ as the unknown of a stage.

pub use crate::error::EvaluationFailure;
pub use crate::newton::Complex64;

/// A first-order system ẇ = g(t, w).
pub trait Ode {
    /// Length of w.
    fn dimension(&self) -> usize;

    /// g(t, w) into `g`.
    ///
    /// # Errors
    /// When the state cannot be evaluated: dependent coordinates not found, non-finite values.
    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure>;

    /// Weighted norm of a change of w; 1 is on tolerance. The weights belong to the step's start.
    fn norm(&mut self, change: &[f64]) -> f64;

    /// Norm of an error estimate of a step that ends at `w_end`; differs from [`Ode::norm`] where
    /// weights take the larger of both ends.
    fn error_norm(&mut self, error: &[f64], _w_end: &[f64]) -> f64 {
        self.norm(error)
    }

    /// Number k of leading entries of w whose derivatives are the entries k..2k, so that dense
    /// output may use second derivatives; 0 if there are none.
    fn second_order_split(&self) -> usize {
        0
    }
}

/// A system that can solve with I − γh J, J = g_w at the point last given to `linearize`.
pub trait LinearizedOde: Ode {
    /// Evaluates the h-independent parts of J at the accepted state (t, w). The
    /// system may use what `derivative` left behind if that was at this point; often it was not
    /// (a fresh linearization after a failed iteration with an old one, a state changed by the
    /// caller, formulas that do not evaluate at the end of a step).
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure>;

    /// Linearizes at a predicted (t, w) on whose solution the slope is about `slope`, without evaluating g: on
    /// stiff components that would multiply the error of the prediction.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn linearize_ahead(
        &mut self,
        t: f64,
        w: &[f64],
        _slope: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.linearize(t, w)
    }

    /// From the next linearization on the J of corrections may be without what slows iterations little and costs much.
    fn simplify(&mut self, _simplify: bool) {}

    /// Whether that of the last one is.
    fn is_simplified(&self) -> bool {
        false
    }

    /// Whether defects and residuals of stages can be accelerations in place of forces.
    fn has_accelerations(&self) -> bool {
        false
    }

    /// From the next iteration on they are, or they are forces again.
    fn take_accelerations(&mut self, _take: bool) {}

    /// Factors I − γh J from the parts of the last `linearize`.
    ///
    /// # Errors
    /// When the matrix is singular.
    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure>;

    /// x ← (I − γh J)⁻¹ x with the last factor; J is all of it.
    fn solve(&mut self, x: &mut [f64]);

    /// How far `slope` is from g at a stage (t, w), by its place among those that are corrected together: g − slope, or
    /// that multiplied by a matrix in which iterations converge from farther away. [`LinearizedOde::solve_defect`] and
    /// [`LinearizedOde::turn`] undo it.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn defect(
        &mut self,
        _stage: usize,
        t: f64,
        w: &[f64],
        slope: &[f64],
        defect: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.derivative(t, w, defect)?;
        defect.iter_mut().zip(slope).for_each(|(g, s)| *g -= s);
        Ok(())
    }

    /// x ← (I − γh J)⁻¹ x for an x made of defects.
    fn solve_defect(&mut self, x: &mut [f64]) {
        self.solve(x);
    }

    /// Whether [`LinearizedOde::turn`] does anything.
    fn turns(&self) -> bool {
        false
    }

    /// Turns a correction from where the matrix belongs to the stage whose defect was the last of that place.
    fn turn(&mut self, _stage: usize, _change: &mut [f64]) {}

    /// Turns a change from the middle of the step to where the matrix belongs; [`LinearizedOde::turn`] of the first stage
    /// undoes it.
    fn turn_back(&mut self, _change: &mut [f64]) {}

    /// x + iy ← (I − γh J)⁻¹ (x + iy) for x, y made of defects, with the complex factor.
    fn solve_complex_defect(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.solve_complex(x, y);
    }

    /// Factors I − γh J for a complex γh, beside the real factor; formulas that need it are refused
    /// for forms without it.
    ///
    /// # Errors
    /// When the matrix is singular, or the form has no complex solve.
    fn factor_complex(&mut self, _gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        Err(EvaluationFailure::new(
            "simulation/no-complex-solve",
            "this form of the equations has no complex solve",
        ))
    }

    /// x + iy ← (I − γh J)⁻¹ (x + iy) with the last complex factor.
    fn solve_complex(&mut self, _x: &mut [f64], _y: &mut [f64]) {}

    /// g_t (explicit time dependence) at the linearization point, for Rosenbrock formulas.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn time_derivative(&mut self, g_t: &mut [f64]) -> Result<(), EvaluationFailure>;

    /// The same system for formulas that solve for accelerations, where it is of second order.
    fn second_order(&mut self) -> Option<&mut dyn SecondOrder> {
        None
    }
}

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
/// change of w is written as (δv, δv̇, δz), so that [`Ode::norm`] weighs it.
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
    /// As [`Ode::derivative`].
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

/// Refuses an iterate that is not a number.
pub(super) fn require_finite(t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
    if w.iter().sum::<f64>().is_finite() {
        return Ok(());
    }
    Err(EvaluationFailure::new(
        "simulation/not-finite",
        format!("the iteration ran away at t = {t:.6} s"),
    ))
}
