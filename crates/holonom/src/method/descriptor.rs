//! The descriptor form: Newton's iteration on q̈ and λ of the inflated index-1 system.
//!
//! ```text
//! M q̈ + Gᵀλ − Q = 0        G q̈ − τ = 0        unknown x = (q̈, λ)
//! ```
//!
//! Only v̈ = P q̈ is integrated, q and q̇ are recovered from the joints: a true state-space method.
//!
//! With [`Iterate::Consistent`] the dependent accelerations and the multipliers of an iterate are
//! recovered as well, q̈ = D v̈ + S τ and λ = Sᵀ(Q − M q̈), which leaves the residual (Pᵀψ, 0). In the
//! plain iteration they converge only as fast as the frozen matrix allows, slowly where G turns
//! during the step; this one converges like the state-space method.
//! Source: thesis section 3.3.

use super::descriptor_matrix::{DescriptorMatrix, singular};
use super::first_order::dot;
use super::ode::{EvaluationFailure, LinearizedOde, Ode};
use super::second_order::{Residual, SecondOrder, Stage};
use super::{FirstOrder, JacobianSource, StateSpace, Weights};
use crate::reduction::Manifold;
use crate::system::State;

/// What an iterate is before it is corrected.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Iterate {
    /// q̈ and λ as the last correction left them.
    Plain,
    /// Dependent accelerations and multipliers recovered from the independent accelerations.
    Consistent,
}

/// w = (v, v̇, z) on the constraint manifold, with stages solved for accelerations and multipliers.
#[derive(Debug, Clone)]
pub struct Descriptor {
    /// Recovery, norm and slopes are those of the first-order form; its reduced matrices stay empty.
    base: FirstOrder,
    matrix: DescriptorMatrix,
    iterate: Iterate,
    force: Vec<f64>,
    rows: Vec<f64>,
    rate: Vec<f64>,
    psi: Vec<f64>,
    /// x at the start of the step and at its end.
    ends: [Vec<f64>; 2],
}

impl Descriptor {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State, iterate: Iterate) -> Self {
        let (n, m) = (state.q.len(), state.lambda.len());
        let matrix = DescriptorMatrix::new(&manifold, &state.q, false);
        let rate = vec![0.0; manifold.chart().ndof()];
        Self {
            base: FirstOrder::new(manifold, weights, state),
            matrix,
            iterate,
            force: vec![0.0; n],
            rows: vec![0.0; m],
            psi: rate.clone(),
            rate,
            ends: [vec![0.0; n + m], vec![0.0; n + m]],
        }
    }

    /// Finds the pattern of the matrix anew.
    fn place(&mut self) {
        let (manifold, q) = (&self.base.manifold, &self.base.anchor);
        self.matrix = DescriptorMatrix::new(manifold, q, self.base.uses_differences());
    }

    /// v̈ effect of the correction in `force`: βh² δv̈ and γh δv̈, and the rest of δz.
    fn spread(&mut self, gamma_h: f64, beta_h2: f64, x: &mut [f64], add: bool) {
        let ndof = self.rate.len();
        let parametrization = self.base.manifold.chart().parametrization();
        parametrization.project(&self.force, &mut self.rate);
        let (head, z) = x.split_at_mut(2 * ndof);
        let (p, v) = head.split_at_mut(ndof);
        for ((p, v), a) in p.iter_mut().zip(&mut *v).zip(&self.rate) {
            let (dp, dv) = (beta_h2 * a, gamma_h * a);
            (*p, *v) = if add { (*p + dp, *v + dv) } else { (dp, dv) };
        }
        for (k, z) in z.iter_mut().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by = dot(&self.base.blocks.extra_position[range.clone()], p)
                + dot(&self.base.blocks.extra_velocity[range], v);
            *z += self.base.inverse_e[k] * gamma_h * by;
        }
    }
}

impl SecondOrder for Descriptor {
    fn unknowns(&self) -> usize {
        self.force.len() + self.rows.len()
    }

    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure> {
        let base = &mut self.base;
        (base.gamma_h, base.stage.beta_h2) = (gamma_h, beta_h2);
        for (out, by_z) in base.inverse_e.iter_mut().zip(&base.blocks.extra_extra) {
            *out = 1.0 / (1.0 - gamma_h * by_z);
        }
        let analysed = self
            .matrix
            .factor(&base.manifold, &base.blocks, &base.inverse_e, gamma_h, beta_h2)
            .map_err(|e| singular(&e, gamma_h))?;
        base.manifold.counters.analyses += u64::from(analysed);
        Ok(())
    }

    fn correct(
        &mut self,
        stage: &Stage<'_>,
        x: &mut [f64],
        z: &mut [f64],
        change: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let (n, ndof) = (self.force.len(), self.rate.len());
        let base = &mut self.base;
        base.manifold.chart().parametrization().project(&x[..n], &mut self.rate);
        base.evaluate_stage(stage, &self.rate, z)?;
        let (state, z_rate) = (&mut base.state, &mut base.z_rate);
        match (self.iterate, stage.residual) {
            (Iterate::Plain, _) => {
                state.a.copy_from_slice(&x[..n]);
                state.lambda.copy_from_slice(&x[n..]);
                let (force, rows) = (&mut self.force, &mut self.rows);
                base.manifold.descriptor_residual(state, z_rate, force, rows);
            }
            (Iterate::Consistent, Residual::Forces) => {
                base.manifold.reduced_residual(state, &self.rate, z_rate, &mut self.psi);
                base.manifold.chart().parametrization().extend(&self.psi, &mut self.force);
                self.rows.fill(0.0);
                x[..n].copy_from_slice(&state.a);
                x[n..].copy_from_slice(&state.lambda);
            }
            (Iterate::Consistent, Residual::Accelerations) => {
                base.manifold.accelerate(state, z_rate)?;
                base.manifold.chart().parametrization().project(&state.a, &mut self.psi);
                for (f, a) in self.psi.iter_mut().zip(&self.rate) {
                    *f = a - *f;
                }
                base.manifold.extend_acceleration(&self.rate, &mut x[..n]);
                x[n..].copy_from_slice(&state.lambda);
                self.matrix.inertia_force(&base.blocks.d, &self.psi, &mut self.force);
                self.rows.fill(0.0);
            }
        }
        let dz = &mut change[2 * ndof..];
        for (k, dz) in dz.iter_mut().enumerate() {
            let past = stage.past[2 * ndof + k];
            *dz = base.inverse_e[k] * (past + stage.gamma_h * base.z_rate[k] - z[k]);
        }
        let scale = |e: usize| dz[e];
        let (manifold, blocks) = (&base.manifold, &base.blocks);
        self.matrix.add_extra_force(manifold, blocks, scale, &mut self.force, 1);
        self.matrix.solve(&mut self.force, &mut self.rows);
        for (x, delta) in x.iter_mut().zip(self.force.iter().chain(&self.rows)) {
            *x += delta;
        }
        self.spread(stage.gamma_h, stage.beta_h2, change, false);
        for (z, dz) in z.iter_mut().zip(&change[2 * ndof..]) {
            *z += dz;
        }
        Ok(())
    }

    fn acceleration(&self, x: &[f64], v_rate: &mut [f64]) {
        let parametrization = self.base.manifold.chart().parametrization();
        parametrization.project(&x[..self.force.len()], v_rate);
    }

    fn linearized_unknown(&self, x: &mut [f64]) {
        let (a, lambda) = x.split_at_mut(self.force.len());
        a.copy_from_slice(&self.base.state.a);
        lambda.copy_from_slice(&self.base.state.lambda);
    }

    fn end_step(&mut self, x: &[f64]) {
        self.ends[1].copy_from_slice(x);
    }

    fn start_step(&mut self) {
        self.ends.swap(0, 1);
    }

    fn start_unknown(&self, x: &mut [f64]) {
        x.copy_from_slice(&self.ends[0]);
    }

    fn filter(&mut self, error: &mut [f64]) {
        let ndof = self.rate.len();
        let (gh, bh2) = (self.base.gamma_h, self.base.stage.beta_h2);
        let (head, ez) = error.split_at_mut(2 * ndof);
        let (ep, ev) = head.split_at_mut(ndof);
        for (p, v) in ep.iter_mut().zip(&*ev) {
            *p += bh2 / gh * v;
        }
        self.matrix.respond(ep, ev, &mut self.force, &mut self.rows);
        let (manifold, blocks) = (&self.base.manifold, &self.base.blocks);
        for (z, inverse_e) in ez.iter_mut().zip(&self.base.inverse_e) {
            *z *= inverse_e;
        }
        let effect = |e: usize| {
            let range = e * ndof..(e + 1) * ndof;
            let by = dot(&blocks.extra_position[range.clone()], ep)
                + dot(&blocks.extra_velocity[range], ev);
            ez[e] + self.base.inverse_e[e] * gh * by
        };
        self.matrix.add_extra_force(manifold, blocks, effect, &mut self.force, 1);
        self.matrix.solve(&mut self.force, &mut self.rows);
        self.spread(gh, bh2, error, true);
    }
}

impl Ode for Descriptor {
    fn dimension(&self) -> usize {
        self.base.dimension()
    }

    fn second_order_split(&self) -> usize {
        self.base.second_order_split()
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        self.base.derivative(t, w, g)
    }

    fn norm(&mut self, change: &[f64]) -> f64 {
        self.base.norm(change)
    }

    fn error_norm(&mut self, error: &[f64], w_end: &[f64]) -> f64 {
        self.base.error_norm(error, w_end)
    }
}

impl LinearizedOde for Descriptor {
    fn linearize(&mut self, t: f64, w: &[f64], g: &[f64]) -> Result<(), EvaluationFailure> {
        let base = &mut self.base;
        if base.uses_differences() {
            base.linearize(t, w, g)?;
            self.matrix.take_reduced(&base.manifold, &base.blocks);
            return Ok(());
        }
        base.return_to(t, w)?;
        self.matrix.linearize(&mut base.manifold, &base.state, &mut base.blocks);
        base.start.copy_from(base.manifold.chart());
        base.linearized = true;
        Ok(())
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.factor_stage(gamma_h, gamma_h * gamma_h)
    }

    fn solve(&mut self, x: &mut [f64]) {
        self.filter(x);
    }

    fn time_derivative(&mut self, _g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        Err(EvaluationFailure {
            code: "simulation/second-order-only",
            message: "the descriptor form serves formulas that solve for accelerations".into(),
        })
    }

    fn second_order(&mut self) -> Option<&mut dyn SecondOrder> {
        Some(self)
    }
}

impl StateSpace for Descriptor {
    fn begin_step(&mut self, state: &State) {
        self.base.begin_step(state);
    }

    fn pack(&self, state: &State, w: &mut [f64]) {
        self.base.pack(state, w);
    }

    fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure> {
        self.base.evaluate(t, w, full)
    }

    fn state(&self) -> &State {
        self.base.state()
    }

    fn manifold(&self) -> &Manifold {
        self.base.manifold()
    }

    fn manifold_mut(&mut self) -> &mut Manifold {
        self.base.manifold_mut()
    }

    fn reparametrized(&mut self) {
        self.base.reparametrized();
        self.place();
        let ndof = self.base.second_order_split();
        self.rate.resize(ndof, 0.0);
        self.psi.resize(ndof, 0.0);
    }

    fn set_jacobian(&mut self, source: JacobianSource) {
        self.base.set_jacobian(source);
        self.place();
    }

    fn full_order(&self) -> bool {
        false
    }
}
