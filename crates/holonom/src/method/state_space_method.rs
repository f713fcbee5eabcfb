//! The state-space method: Newton's iteration on v̈, everything else recovered from the joints.
//!
//! ```text
//! ψ(v̈) = Dᵀ(M q̈ − Q) = 0        q̈ = D v̈ + S τ        Ψ δv̈ = −ψ
//! Ψ = M̂ + γh M̂₁' + βh² M̂₂'      M̂₁', M̂₂' with the extra states eliminated, see `FirstOrder`
//! ```
//!
//! Unknown x = v̈. Ψ is the matrix Π of the first-order reduction (proposition 1, `docs/theory/method.md`), so
//! both methods are one form of the equations. Source: thesis section 3.2, (3.30), (3.46).

use super::FirstOrder;
use super::first_order::{dot, multiply_add, require_finite};
use super::ode::EvaluationFailure;
use super::second_order::{SecondOrder, Stage};
use crate::system::Sizes;

/// What stages with accelerations as unknowns need beside the first-order form.
#[derive(Debug, Clone)]
pub(super) struct AccelerationBuffers {
    /// Iterate w.
    pub(super) trial: Vec<f64>,
    correction: Vec<f64>,
    /// βh² of the last factor.
    pub(super) beta_h2: f64,
    /// q, q̇ and q̈ at the start of the step and at its end.
    ends: [[Vec<f64>; 3]; 2],
}

impl AccelerationBuffers {
    pub(super) fn new(ndof: usize, sizes: &Sizes) -> Self {
        let all = || std::array::from_fn(|_| vec![0.0; sizes.coordinates]);
        Self {
            trial: vec![0.0; 2 * ndof + sizes.extra_states],
            correction: vec![0.0; ndof],
            beta_h2: 0.0,
            ends: [all(), all()],
        }
    }

    pub(super) fn resize(&mut self, ndof: usize) {
        let extra = self.trial.len() - 2 * self.correction.len();
        self.trial.resize(2 * ndof + extra, 0.0);
        self.correction.resize(ndof, 0.0);
    }
}

impl FirstOrder {
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
            .and_then(|()| self.evaluate(stage.t, &trial, false).map(|_| ()));
        self.stage.trial = trial;
        outcome
    }
}

impl SecondOrder for FirstOrder {
    fn unknowns(&self) -> usize {
        self.point.manifold.chart().ndof()
    }

    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure> {
        self.stage.beta_h2 = beta_h2;
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
        manifold.reduced_residual(state, x, &mut self.point.z_rate, delta);
        delta.iter_mut().for_each(|r| *r = -*r);
        let (head, dz) = change.split_at_mut(2 * ndof);
        let (dp, dv) = head.split_at_mut(ndof);
        // ρ = z̃ + γh ż − z is carried into Ψ δv̈ = −ψ − Ẑ E⁻¹ ρ.
        for (k, dz) in dz.iter_mut().enumerate() {
            let past = stage.past[2 * ndof + k];
            *dz = self.inverse_e[k] * (past + stage.gamma_h * self.point.z_rate[k] - z[k]);
            for (r, zeta) in delta.iter_mut().zip(&self.blocks.force_extra[k * ndof..]) {
                *r -= zeta * *dz;
            }
        }
        if ndof > 0 {
            self.lu.solve(delta);
        }
        for (((x, delta), dp), dv) in x.iter_mut().zip(&*delta).zip(&mut *dp).zip(&mut *dv) {
            *x += delta;
            *dp = stage.beta_h2 * delta;
            *dv = stage.gamma_h * delta;
        }
        for (k, (z, dz)) in z.iter_mut().zip(dz).enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by = dot(&self.blocks.extra_position[range.clone()], dp)
                + dot(&self.blocks.extra_velocity[range], dv);
            *dz += self.inverse_e[k] * stage.gamma_h * by;
            *z += *dz;
        }
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
        q.copy_from_slice(&self.point.state.q);
        v.copy_from_slice(&self.point.state.v);
        self.point.manifold.extend_acceleration(x, a);
    }

    fn start_step(&mut self) {
        self.stage.ends.swap(0, 1);
    }

    fn start_unknown(&self, x: &mut [f64]) {
        let ([q, v, a], system) = (&self.stage.ends[0], self.point.manifold.system().as_ref());
        self.point.manifold.chart().parametrization().accelerations(system, q, v, a, x);
    }

    /// One solve: with ẽ_p = e_p + (β/γ)h e_v, Ψ a = −(M̂₁' e_v + M̂₂' ẽ_p + Ẑ E⁻¹ e_z), the result is
    /// ẽ_p + βh² a, e_v + γh a, and E⁻¹(e_z + γh (ż_v · + ż_v̇ ·)).
    fn filter(&mut self, error: &mut [f64]) {
        let ndof = self.unknowns();
        let (gh, bh2) = (self.gamma_h, self.stage.beta_h2);
        let (head, ez) = error.split_at_mut(2 * ndof);
        let (ep, ev) = head.split_at_mut(ndof);
        for (p, v) in ep.iter_mut().zip(&*ev) {
            *p += bh2 / gh * v;
        }
        let a = &mut self.stage.correction;
        a.fill(0.0);
        multiply_add(&self.m1, -1.0, ev, a);
        multiply_add(&self.m2, -1.0, ep, a);
        for (k, z) in ez.iter_mut().enumerate() {
            *z *= self.inverse_e[k];
            for (a, zeta) in a.iter_mut().zip(&self.blocks.force_extra[k * ndof..]) {
                *a -= zeta * *z;
            }
        }
        if ndof > 0 {
            self.lu.solve(a);
        }
        for ((p, v), a) in ep.iter_mut().zip(&mut *ev).zip(&*a) {
            *p += bh2 * a;
            *v += gh * a;
        }
        for (k, z) in ez.iter_mut().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by = dot(&self.blocks.extra_position[range.clone()], ep)
                + dot(&self.blocks.extra_velocity[range], ev);
            *z += self.inverse_e[k] * gh * by;
        }
    }
}
