//! The state-space method: Newton's iteration on v̈, everything else recovered from the joints.
//!
//! ```text
//! ψ(v̈) = Dᵀ(M q̈ − Q) = 0        q̈ = D v̈ + S τ        Ψ δv̈ = −ψ
//! Ψ = M̂ + γh M̂₁' + βh² M̂₂'      M̂₁', M̂₂' with the extra states eliminated, see `FirstOrder`
//! ```
//!
//! or M̂₀ (v̈ − f) in place of ψ, with M̂₀ of the linearization and the accelerations f of the equations.
//!
//! Unknown x = v̈. Ψ is the matrix Π of the first-order reduction (proposition 1, `docs/theory/newton.md`), so
//! both methods are one form of the equations. Source: thesis section 3.2, (3.30), (3.46).

use super::FirstOrder;
use super::first_order::residual_rates;
use super::ode::{EvaluationFailure, SecondOrder, Stage, require_finite};
use crate::newton::{FirstOrderMatrix, Matrix};

impl<M: Matrix> FirstOrder<M> {
    /// Recovers the state of an iterate whose independent accelerations are `v_rate`.
    pub(super) fn evaluate_stage(
        &mut self,
        stage: &Stage<'_>,
        v_rate: &[f64],
        z: &[f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = v_rate.len();
        let mut trial = std::mem::take(&mut self.stage.trial);
        for k in 0..ndof {
            trial[k] = stage.past[k] + stage.beta_h2 * v_rate[k];
            trial[ndof + k] = stage.past[ndof + k] + stage.gamma_h * v_rate[k];
        }
        trial[2 * ndof..].copy_from_slice(z);
        let outcome = require_finite(stage.t, &trial)
            .and_then(|()| self.evaluate(stage.t, &trial, self.by_accelerations).map(|_| ()));
        self.stage.trial = trial;
        outcome
    }
}

impl<M: FirstOrderMatrix> SecondOrder for FirstOrder<M> {
    fn unknowns(&self) -> usize {
        self.point.manifold.chart().ndof()
    }

    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure> {
        self.factor_matrix(gamma_h, beta_h2)
    }

    fn correct(
        &mut self,
        stage: &Stage<'_>,
        x: &mut [f64],
        z: &mut [f64],
        change: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = x.len();
        self.evaluate_stage(stage, x, z)?;
        let delta = &mut self.stage.correction;
        let (manifold, state) = (&mut self.point.manifold, &mut self.point.state);
        self.newton.align(0, manifold, &state.q);
        if self.by_accelerations {
            residual_rates(manifold, state, x, delta);
            self.newton.turn_back(0, delta);
            self.newton.weigh_rates(delta);
        } else {
            manifold.reduced_residual(state, x, &mut self.point.z_rate, delta);
            self.newton.take_forces(0, delta);
        }
        for (k, dz) in change[2 * ndof..].iter_mut().enumerate() {
            let past = stage.past[2 * ndof + k];
            *dz = past + stage.gamma_h * self.point.z_rate[k] - z[k];
        }
        self.newton.correct(delta, change);
        self.newton.turn(0, delta);
        add(x, delta);
        add(z, &change[2 * ndof..]);
        Ok(())
    }

    fn acceleration(&self, x: &[f64], v_rate: &mut [f64]) {
        v_rate.copy_from_slice(x);
    }

    fn linearized_unknown(&self, x: &mut [f64]) {
        self.point.manifold.independent_acceleration(&self.point.state, x);
    }

    fn end_step(&mut self, x: &[f64]) {
        let [q, v, a] = &mut self.stage.ends[1];
        q.clone_from(&self.point.state.q);
        v.clone_from(&self.point.state.v);
        a.resize(q.len(), 0.0);
        self.point.manifold.extend_acceleration(q, v, x, a);
    }

    fn start_step(&mut self) {
        self.stage.ends.swap(0, 1);
    }

    fn start_unknown(&self, x: &mut [f64]) {
        let ([q, v, a], system) = (&self.stage.ends[0], self.point.manifold.system().as_ref());
        self.point.manifold.chart().parametrization().accelerations(system, q, v, a, x);
    }

    fn filter(&mut self, error: &mut [f64]) {
        self.newton.filter(error);
    }
}

/// x += y.
pub(super) fn add(x: &mut [f64], y: &[f64]) {
    x.iter_mut().zip(y).for_each(|(x, y)| *x += y);
}
