//! What the run loop asks of a form of the equations, beyond what a formula asks.

use super::ode::{EvaluationFailure, LinearizedOde};
use super::{FirstOrder, Weights};
use crate::newton::{FirstOrderMatrix, MatrixOptions};
use crate::reduction::Point;
use crate::system::State;

/// A form of the equations that formulas integrate, tied to states of the system.
pub trait EquationForm: LinearizedOde + Send {
    /// The state that the next step starts from: weights, windings and fall-back follow it.
    fn begin_step(&mut self, state: &State);

    /// w of a state.
    fn pack(&self, state: &State, w: &mut [f64]);

    /// Recovers the state at (t, w), with accelerations if `full`.
    ///
    /// # Errors
    /// As [`super::ode::Ode::derivative`].
    fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure>;

    /// The point of the last evaluation.
    fn point(&self) -> &Point;

    /// The same, for changes of the parametrization.
    fn point_mut(&mut self) -> &mut Point;

    /// The point has got another parametrization.
    fn reparametrized(&mut self);

    /// References have been moved at the state last evaluated: its independent variables are now `w`.
    fn references_moved(&mut self, w: &[f64]);

    /// A change of w on the coordinates and velocities of all bodies, with the factors of the last evaluation.
    fn spread(&mut self, change: &[f64]) -> [&[f64]; 2];

    /// The part of it on coordinates.
    fn displace(&mut self, change: &[f64]) -> &[f64];

    /// Error weights at the start of the step.
    fn weights(&self) -> &Weights;

    /// Where the integration Jacobian comes from.
    fn set_matrix(&mut self, options: MatrixOptions);

    /// Whether w holds the energy ledger, so that no quadrature is needed.
    fn integrates_powers(&self) -> bool;
}

// The descriptor form builds on what [`FirstOrder`] has with any matrix.
impl<M: FirstOrderMatrix> EquationForm for FirstOrder<M> {
    fn begin_step(&mut self, state: &State) {
        Self::begin_step(self, state);
    }
    fn pack(&self, state: &State, w: &mut [f64]) {
        Self::pack(self, state, w);
    }
    fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure> {
        Self::evaluate(self, t, w, full)
    }
    fn point(&self) -> &Point {
        Self::point(self)
    }
    fn point_mut(&mut self) -> &mut Point {
        Self::point_mut(self)
    }
    fn reparametrized(&mut self) {
        Self::reparametrized(self);
    }
    fn references_moved(&mut self, w: &[f64]) {
        Self::references_moved(self, w);
    }
    fn spread(&mut self, change: &[f64]) -> [&[f64]; 2] {
        Self::spread(self, change)
    }
    fn displace(&mut self, change: &[f64]) -> &[f64] {
        Self::displace(self, change)
    }
    fn weights(&self) -> &Weights {
        Self::weights(self)
    }
    fn set_matrix(&mut self, options: MatrixOptions) {
        Self::set_matrix(self, options);
    }
    fn integrates_powers(&self) -> bool {
        Self::integrates_powers(self)
    }
}
