//! The view of a system that integration formulas have: ẇ = g(t, w) with its linearization.

use super::second_order::SecondOrder;
pub use crate::error::EvaluationFailure;
pub use holonom_linalg::Complex64;

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
    /// Evaluates the h-independent parts of J at the accepted state (t, w) with slope g. The
    /// system may use what `derivative` left behind if that was at this point; often it was not
    /// (a fresh linearization after a failed iteration with an old one, a state changed by the
    /// caller, formulas that do not evaluate at the end of a step).
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn linearize(&mut self, t: f64, w: &[f64], g: &[f64]) -> Result<(), EvaluationFailure>;

    /// Factors I − γh J from the parts of the last `linearize`.
    ///
    /// # Errors
    /// When the matrix is singular.
    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure>;

    /// x ← (I − γh J)⁻¹ x with the last factor.
    fn solve(&mut self, x: &mut [f64]);

    /// How far `slope` is from g at a stage (t, w): g − slope, or that multiplied by a matrix in
    /// which iterations converge from farther away. [`LinearizedOde::solve_defect`] undoes it.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    fn defect(
        &mut self,
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
        Err(EvaluationFailure {
            code: "simulation/no-complex-solve",
            message: "this form of the equations has no complex solve".into(),
        })
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
