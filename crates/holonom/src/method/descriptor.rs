//! The descriptor form: Newton's iteration on q̈ and λ of the inflated index-1 system.
//!
//! ```text
//! M q̈ + Gᵀλ − Q = 0        G q̈ − τ = 0        P q̈ + curvature − v̈ = 0        unknown x = (q̈, λ, v̈)
//! ```
//!
//! Only v̈ is integrated, q and q̇ are recovered from the joints: a true state-space method. The
//! curvature (P q̇)_q q̇ is that of relative coordinates among the independent variables.
//!
//! With [`Iterate::Consistent`] the dependent accelerations and the multipliers of an iterate are
//! recovered as well, q̈ = D v̈ + S τ and λ = Sᵀ(Q − M q̈), which leaves the residual (Pᵀψ, 0). In the
//! plain iteration they converge only as fast as the frozen matrix allows, slowly where G turns
//! during the step; this one converges like the state-space method.
//! Source: thesis section 3.3.

use super::descriptor_matrix::{DescriptorMatrix, singular};
use super::first_order::dot;
use super::ode::{EvaluationFailure, LinearizedOde, Ode};
use super::second_order::{SecondOrder, Stage};
use super::{FirstOrder, JacobianSource, StateSpace, Weights};
use crate::reduction::{Manifold, Point};
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
    /// x at the start of the step and at its end, with q and q̇ there.
    ends: [[Vec<f64>; 3]; 2],
}

impl Descriptor {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State, iterate: Iterate) -> Self {
        let (n, m) = (state.q.len(), state.lambda.len());
        let matrix = DescriptorMatrix::new(&manifold, &state.q, false);
        let rate = vec![0.0; manifold.chart().ndof()];
        let unknowns = n + m + rate.len();
        let end = || [vec![0.0; unknowns], vec![0.0; n], vec![0.0; n]];
        Self {
            base: FirstOrder::new(manifold, weights, state),
            matrix,
            iterate,
            force: vec![0.0; n],
            rows: vec![0.0; m],
            psi: rate.clone(),
            rate,
            ends: [end(), end()],
        }
    }

    /// Finds the pattern of the matrix anew.
    fn place(&mut self) {
        let (manifold, q) = (&self.base.point.manifold, &self.base.point.anchor);
        self.matrix = DescriptorMatrix::new(manifold, q, self.base.uses_differences());
    }

    /// Effect of the correction δv̈ in `rate`: βh² δv̈ and γh δv̈, and the rest of δz.
    fn spread(&mut self, gamma_h: f64, beta_h2: f64, x: &mut [f64], add: bool) {
        let ndof = self.rate.len();
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
        self.force.len() + self.rows.len() + self.rate.len()
    }

    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure> {
        let base = &mut self.base;
        (base.gamma_h, base.stage.beta_h2) = (gamma_h, beta_h2);
        for (out, by_z) in base.inverse_e.iter_mut().zip(&base.blocks.extra_extra) {
            *out = 1.0 / (1.0 - gamma_h * by_z);
        }
        let analysed = self
            .matrix
            .factor(&base.point.manifold, &base.blocks, &base.inverse_e, gamma_h, beta_h2)
            .map_err(|e| singular(&e, gamma_h))?;
        base.point.manifold.counters.analyses += u64::from(analysed);
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
        let (head, rate) = x.split_at_mut(n + self.rows.len());
        let (a, lambda) = head.split_at_mut(n);
        base.evaluate_stage(stage, rate, z)?;
        self.rate.fill(0.0);
        let (state, z_rate) = (&mut base.point.state, &mut base.point.z_rate);
        match self.iterate {
            Iterate::Plain => {
                state.a.copy_from_slice(a);
                state.lambda.copy_from_slice(lambda);
                let (force, rows) = (&mut self.force, &mut self.rows);
                base.point.manifold.descriptor_residual(state, z_rate, force, rows);
                base.point.manifold.independent_acceleration(state, &mut self.rate);
                for (out, rate) in self.rate.iter_mut().zip(&*rate) {
                    *out -= rate;
                }
            }
            Iterate::Consistent => {
                base.point.manifold.reduced_residual(state, rate, z_rate, &mut self.psi);
                // With P of the matrix, for which DᵀPᵀ = 1.
                base.start.extend(&self.psi, &mut self.force);
                self.rows.fill(0.0);
                a.copy_from_slice(&state.a);
                lambda.copy_from_slice(&state.lambda);
            }
        }
        let dz = &mut change[2 * ndof..];
        for (k, dz) in dz.iter_mut().enumerate() {
            let past = stage.past[2 * ndof + k];
            *dz = base.inverse_e[k] * (past + stage.gamma_h * base.point.z_rate[k] - z[k]);
        }
        let scale = |e: usize| dz[e];
        let (manifold, blocks) = (&base.point.manifold, &base.blocks);
        self.matrix.add_extra_force(manifold, blocks, scale, &mut self.force, 1);
        self.matrix.solve(&base.point.manifold, &mut self.force, &mut self.rows, &mut self.rate);
        for (x, delta) in x.iter_mut().zip(self.force.iter().chain(&self.rows).chain(&self.rate)) {
            *x += delta;
        }
        self.spread(stage.gamma_h, stage.beta_h2, change, false);
        for (z, dz) in z.iter_mut().zip(&change[2 * ndof..]) {
            *z += dz;
        }
        Ok(())
    }

    fn acceleration(&self, x: &[f64], v_rate: &mut [f64]) {
        v_rate.copy_from_slice(&x[x.len() - self.rate.len()..]);
    }

    fn linearized_unknown(&self, x: &mut [f64]) {
        let (a, rest) = x.split_at_mut(self.force.len());
        let (lambda, rate) = rest.split_at_mut(self.rows.len());
        a.copy_from_slice(&self.base.point.state.a);
        lambda.copy_from_slice(&self.base.point.state.lambda);
        self.base.point.manifold.independent_acceleration(&self.base.point.state, rate);
    }

    fn end_step(&mut self, x: &[f64]) {
        let [end, q, v] = &mut self.ends[1];
        end.copy_from_slice(x);
        let manifold = &mut self.base.point.manifold;
        if manifold.chart().moving().len() > 0 {
            // q̈ that has v̈ in the state it belongs to: the corrections of q̈ have it only to first
            // order, which would come back as an error of the next start.
            let (head, rate) = x.split_at(self.force.len() + self.rows.len());
            manifold.extend_acceleration(rate, &mut end[..self.force.len()]);
            debug_assert_eq!(head.len() + rate.len(), end.len());
        }
        q.copy_from_slice(&self.base.point.state.q);
        v.copy_from_slice(&self.base.point.state.v);
    }

    fn start_step(&mut self) {
        self.ends.swap(0, 1);
    }

    fn start_unknown(&self, x: &mut [f64]) {
        let ([end, q, v], manifold) = (&self.ends[0], &self.base.point.manifold);
        x.copy_from_slice(end);
        let (head, rate) = x.split_at_mut(self.force.len() + self.rows.len());
        let parametrization = manifold.chart().parametrization();
        let a = &head[..self.force.len()];
        parametrization.accelerations(manifold.system().as_ref(), q, v, a, rate);
    }

    fn filter(&mut self, error: &mut [f64]) {
        let ndof = self.rate.len();
        let (gh, bh2) = (self.base.gamma_h, self.base.stage.beta_h2);
        let (head, ez) = error.split_at_mut(2 * ndof);
        let (ep, ev) = head.split_at_mut(ndof);
        for (p, v) in ep.iter_mut().zip(&*ev) {
            *p += bh2 / gh * v;
        }
        self.matrix.respond(ep, ev, &mut self.force, &mut self.rows, &mut self.rate);
        let (manifold, blocks) = (&self.base.point.manifold, &self.base.blocks);
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
        self.matrix.solve(manifold, &mut self.force, &mut self.rows, &mut self.rate);
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
            self.matrix.take_reduced(&base.point.manifold, &base.blocks);
            return Ok(());
        }
        base.return_to(t, w)?;
        self.matrix.linearize(&mut base.point.manifold, &base.point.state, &mut base.blocks);
        base.start.copy_from(base.point.manifold.chart());
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

    fn point(&self) -> &Point {
        self.base.point()
    }

    fn point_mut(&mut self) -> &mut Point {
        self.base.point_mut()
    }

    fn references_moved(&mut self, w: &[f64]) {
        self.base.references_moved(w);
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

    fn integrates_powers(&self) -> bool {
        false
    }
}
