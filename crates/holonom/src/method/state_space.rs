//! What the run loop asks of a form of the equations, beyond what a formula asks.

use super::ode::{EvaluationFailure, LinearizedOde};
use super::{FirstOrder, FullOrder, JacobianSource};
use crate::reduction::Manifold;
use crate::system::State;

/// A form of the equations that formulas integrate, tied to states of the system.
pub trait StateSpace: LinearizedOde + Send {
    /// The state that the next step starts from: weights, windings and fall-back follow it.
    fn begin_step(&mut self, state: &State);

    /// w of a state.
    fn pack(&self, state: &State, w: &mut [f64]);

    /// Recovers the state at (t, w), with accelerations if `full`.
    ///
    /// # Errors
    /// As [`super::ode::Ode::derivative`].
    fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure>;

    /// Multipliers of the state of the last evaluation, which was a full one or that of a slope.
    fn complete(&mut self);

    /// State of the last successful evaluation.
    fn state(&self) -> &State;

    /// The manifold with its factors at the last evaluation.
    fn manifold(&self) -> &Manifold;

    /// The same, for changes of the parametrization.
    fn manifold_mut(&mut self) -> &mut Manifold;

    /// The manifold has got another parametrization.
    fn reparametrized(&mut self);

    /// Where the integration Jacobian comes from.
    fn set_jacobian(&mut self, source: JacobianSource);

    /// Whether w holds all coordinates and the energy ledger, so that histories outlive a
    /// re-parametrization and no quadrature is needed.
    fn full_order(&self) -> bool;
}

macro_rules! state_space {
    ($type:ty, $full:expr) => {
        impl StateSpace for $type {
            fn begin_step(&mut self, state: &State) {
                Self::begin_step(self, state);
            }
            fn pack(&self, state: &State, w: &mut [f64]) {
                Self::pack(self, state, w);
            }
            fn evaluate(
                &mut self,
                t: f64,
                w: &[f64],
                full: bool,
            ) -> Result<&State, EvaluationFailure> {
                Self::evaluate(self, t, w, full)
            }
            fn complete(&mut self) {
                Self::complete(self);
            }
            fn state(&self) -> &State {
                Self::state(self)
            }
            fn manifold(&self) -> &Manifold {
                Self::manifold(self)
            }
            fn manifold_mut(&mut self) -> &mut Manifold {
                Self::manifold_mut(self)
            }
            fn reparametrized(&mut self) {
                Self::reparametrized(self);
            }
            fn set_jacobian(&mut self, source: JacobianSource) {
                Self::set_jacobian(self, source);
            }
            fn full_order(&self) -> bool {
                $full
            }
        }
    };
}

state_space!(FirstOrder, false);
state_space!(FullOrder, true);
