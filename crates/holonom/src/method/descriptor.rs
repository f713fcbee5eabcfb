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

use super::first_order::residual_rates;
use super::ode::{EvaluationFailure, LinearizedOde, Ode, SecondOrder, Stage};
use super::state_space_method::add;
use super::{EquationForm, FirstOrder, Weights};
use crate::newton::{Chosen, DescriptorMatrix, MatrixOptions, Unknowns};
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
    /// Recovery, norm and slopes are those of the first-order form.
    base: FirstOrder<Chosen<DescriptorMatrix>>,
    iterate: Iterate,
    /// Residuals of an iterate, then its correction.
    correction: Unknowns,
    psi: Vec<f64>,
    /// x at the start of the step and at its end, with q and q̇ there.
    ends: [[Vec<f64>; 3]; 2],
}

impl Descriptor {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State, iterate: Iterate) -> Self {
        let (n, ndof) = (state.q.len(), manifold.chart().ndof());
        let unknowns = n + state.lambda.len() + ndof;
        let end = || [vec![0.0; unknowns], vec![0.0; n], vec![0.0; n]];
        Self {
            correction: Unknowns::new(&manifold),
            base: FirstOrder::with_matrix(manifold, weights, state),
            iterate,
            psi: vec![0.0; ndof],
            ends: [end(), end()],
        }
    }
}

impl SecondOrder for Descriptor {
    fn unknowns(&self) -> usize {
        self.ends[0][0].len()
    }

    fn factor_stage(&mut self, gamma_h: f64, beta_h2: f64) -> Result<(), EvaluationFailure> {
        self.base.factor_matrix(gamma_h, beta_h2)
    }

    fn correct(
        &mut self,
        stage: &Stage<'_>,
        x: &mut [f64],
        z: &mut [f64],
        change: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let (base, residual) = (&mut self.base, &mut self.correction);
        let (n, m, ndof) = (residual.force.len(), residual.rows.len(), residual.rate.len());
        let (head, rate) = x.split_at_mut(n + m);
        let (a, lambda) = head.split_at_mut(n);
        base.evaluate_stage(stage, rate, z)?;
        let Point { manifold, state, z_rate, .. } = &mut base.point;
        match self.iterate {
            Iterate::Plain => {
                state.a.copy_from_slice(a);
                state.lambda.copy_from_slice(lambda);
                let (force, rows) = (&mut residual.force, &mut residual.rows);
                manifold.descriptor_residual(state, z_rate, force, rows);
                residual.rate.fill(0.0);
                manifold.independent_acceleration(state, &mut residual.rate);
                for (out, rate) in residual.rate.iter_mut().zip(&*rate) {
                    *out -= rate;
                }
            }
            Iterate::Consistent => {
                base.newton.align(0, manifold, &state.q);
                if base.by_accelerations {
                    residual_rates(manifold, state, rate, &mut self.psi);
                    base.newton.turn_back(0, &mut self.psi);
                    base.newton.weigh_rates(&mut self.psi);
                } else {
                    manifold.reduced_residual(state, rate, z_rate, &mut self.psi);
                    base.newton.take_forces(0, &mut self.psi);
                }
                base.newton.extend(&self.psi, residual);
                if base.by_accelerations {
                    manifold.multipliers(state);
                    manifold.extend_acceleration(&state.q, &state.v, rate, &mut state.a);
                    // The accelerations are those of the iterate, no longer those of the equations.
                    base.at_time = f64::NAN;
                }
                a.copy_from_slice(&state.a);
                lambda.copy_from_slice(&state.lambda);
            }
        }
        for (k, dz) in change[2 * ndof..].iter_mut().enumerate() {
            let past = stage.past[2 * ndof + k];
            *dz = past + stage.gamma_h * z_rate[k] - z[k];
        }
        base.newton.correct_unknowns(residual, change);
        if self.iterate == Iterate::Consistent {
            base.newton.turn(0, &mut residual.rate);
        }
        for (x, delta) in x.iter_mut().zip(residual.iter()) {
            *x += delta;
        }
        add(z, &change[2 * ndof..]);
        Ok(())
    }

    fn acceleration(&self, x: &[f64], v_rate: &mut [f64]) {
        v_rate.copy_from_slice(&x[x.len() - self.psi.len()..]);
    }

    fn linearized_unknown(&self, x: &mut [f64]) {
        let (a, rest) = x.split_at_mut(self.correction.force.len());
        let (lambda, rate) = rest.split_at_mut(self.correction.rows.len());
        a.copy_from_slice(&self.base.point.state.a);
        lambda.copy_from_slice(&self.base.point.state.lambda);
        self.base.point.manifold.independent_acceleration(&self.base.point.state, rate);
    }

    fn end_step(&mut self, x: &[f64]) {
        let [end, q, v] = &mut self.ends[1];
        end.copy_from_slice(x);
        q.copy_from_slice(&self.base.point.state.q);
        v.copy_from_slice(&self.base.point.state.v);
        let manifold = &mut self.base.point.manifold;
        if manifold.chart().moving().len() > 0 {
            // q̈ that has v̈ in the state it belongs to: the corrections of q̈ have it only to first
            // order, which would come back as an error of the next start.
            let rate = &x[x.len() - self.psi.len()..];
            manifold.extend_acceleration(q, v, rate, &mut end[..q.len()]);
        }
    }

    fn start_step(&mut self) {
        self.ends.swap(0, 1);
    }

    fn start_unknown(&self, x: &mut [f64]) {
        let ([end, q, v], manifold) = (&self.ends[0], &self.base.point.manifold);
        x.copy_from_slice(end);
        let (head, rate) = x.split_at_mut(x.len() - self.psi.len());
        let parametrization = manifold.chart().parametrization();
        let a = &head[..q.len()];
        parametrization.accelerations(manifold.system().as_ref(), q, v, a, rate);
    }

    fn filter(&mut self, error: &mut [f64]) {
        self.base.newton.filter(error);
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
    fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        self.base.linearize_at(t, w)
    }

    fn linearize_ahead(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.base.linearize_by(t, w, slope)
    }

    fn has_accelerations(&self) -> bool {
        self.iterate == Iterate::Consistent
    }

    fn take_accelerations(&mut self, take: bool) {
        self.base.by_accelerations = take;
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.factor_stage(gamma_h, gamma_h * gamma_h)
    }

    fn solve(&mut self, x: &mut [f64]) {
        self.filter(x);
    }

    fn turns(&self) -> bool {
        self.base.newton.aligns()
    }

    fn turn(&mut self, stage: usize, change: &mut [f64]) {
        self.base.turn_to(stage, change);
    }

    fn turn_back(&mut self, change: &mut [f64]) {
        self.base.turn_from_halfway(change);
    }

    fn time_derivative(&mut self, _g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        Err(EvaluationFailure::new(
            "simulation/second-order-only",
            "the descriptor form serves formulas that solve for accelerations",
        ))
    }

    fn second_order(&mut self) -> Option<&mut dyn SecondOrder> {
        Some(self)
    }
}

impl EquationForm for Descriptor {
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
        self.correction = Unknowns::new(&self.base.point.manifold);
        self.psi.resize(self.correction.rate.len(), 0.0);
    }

    fn spread(&mut self, change: &[f64]) -> [&[f64]; 2] {
        self.base.spread(change)
    }

    fn displace(&mut self, change: &[f64]) -> &[f64] {
        self.base.displace(change)
    }

    fn weights(&self) -> &Weights {
        self.base.weights()
    }

    fn set_matrix(&mut self, options: MatrixOptions) {
        self.base.set_matrix(options);
    }

    fn integrates_powers(&self) -> bool {
        false
    }
}
