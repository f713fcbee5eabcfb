//! All coordinates for explicit formulas: W = (q, q̇, z, dissipated energy, supplied work).
//!
//! The formula advances every coordinate; only P of them count, the others are recovered from the
//! joints at each evaluation. So the history of a multistep formula belongs to all coordinates and a
//! re-parametrization leaves it untouched.

use super::JacobianSource;
use super::ode::{EvaluationFailure, LinearizedOde, Ode};
use super::weights::Weights;
use crate::reduction::Manifold;
use crate::system::State;

/// Ẇ = (q̇, q̈, ż, powers) on the constraint manifold.
#[derive(Debug, Clone)]
pub struct FullOrder {
    manifold: Manifold,
    weights: Weights,
    state: State,
    anchor: Vec<f64>,
    positions: Vec<f64>,
    rates: Vec<f64>,
    z_rate: Vec<f64>,
}

/// Energy components at the end of W.
const POWERS: usize = 2;

impl FullOrder {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State) -> Self {
        let ndof = manifold.chart().ndof();
        Self {
            weights,
            anchor: state.q.clone(),
            positions: vec![0.0; ndof],
            rates: vec![0.0; ndof],
            z_rate: vec![0.0; state.z.len()],
            state: state.clone(),
            manifold,
        }
    }

    /// Explicit formulas have no Jacobian: nothing changes.
    pub fn set_jacobian(&mut self, _source: JacobianSource) {}

    /// The manifold with its factors at the last evaluation.
    pub fn manifold(&self) -> &Manifold {
        &self.manifold
    }

    /// The same, for changes of the parametrization.
    pub fn manifold_mut(&mut self) -> &mut Manifold {
        &mut self.manifold
    }

    /// State of the last successful evaluation.
    pub fn state(&self) -> &State {
        &self.state
    }

    /// The state that the next step starts from.
    pub fn begin_step(&mut self, state: &State) {
        self.anchor.copy_from_slice(&state.q);
        self.state.winding.copy_from_slice(&state.winding);
        self.weights.set(state);
    }

    /// W of a state.
    pub fn pack(&self, state: &State, w: &mut [f64]) {
        let n = state.q.len();
        w[..n].copy_from_slice(&state.q);
        w[n..2 * n].copy_from_slice(&state.v);
        let end = 2 * n + state.z.len();
        w[2 * n..end].copy_from_slice(&state.z);
        w[end] = state.ledger.dissipated;
        w[end + 1] = state.ledger.supplied;
    }

    /// After a re-parametrization.
    pub fn reparametrized(&mut self) {
        let ndof = self.manifold.chart().ndof();
        self.positions.resize(ndof, 0.0);
        self.rates.resize(ndof, 0.0);
    }

    /// Multipliers of the state of the last evaluation.
    pub fn complete(&mut self) {
        self.manifold.multipliers(&mut self.state);
    }

    /// Recovers the state at (t, W) with accelerations (`full`) or without.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    pub fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure> {
        let n = self.state.q.len();
        let (q, rest) = w.split_at(n);
        let (v, rest) = rest.split_at(n);
        let (z, powers) = rest.split_at(self.state.z.len());
        if !q.iter().chain(v).sum::<f64>().is_finite() {
            return Err(EvaluationFailure {
                code: "simulation/not-finite",
                message: format!("the prediction ran away at t = {t:.6} s"),
            });
        }
        self.state.t = t;
        self.state.q.copy_from_slice(q);
        self.state.v.copy_from_slice(v);
        self.manifold.independent_state(&self.state, &mut self.positions, &mut self.rates);
        self.state.z.copy_from_slice(z);
        self.state.ledger.dissipated = powers[0];
        self.state.ledger.supplied = powers[1];
        let recovered = self
            .manifold
            .recover_position(t, &self.positions, &mut self.state.q)
            .and_then(|()| {
                let (q, v) = (&self.state.q, &mut self.state.v);
                self.manifold.recover_velocity(t, q, &self.rates, v, full)
            })
            .and_then(|()| {
                if full {
                    self.manifold.accelerate(&mut self.state, &mut self.z_rate)
                } else {
                    Ok(())
                }
            });
        if let Err(failure) = recovered {
            self.state.q.copy_from_slice(&self.anchor);
            self.manifold.go_back(&self.anchor);
            return Err(failure);
        }
        if full && self.manifold.system().has_drivers() {
            self.complete(); // the power of drivers
        }
        Ok(&self.state)
    }
}

impl Ode for FullOrder {
    fn dimension(&self) -> usize {
        2 * self.state.q.len() + self.state.z.len() + POWERS
    }

    fn second_order_split(&self) -> usize {
        self.state.q.len()
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        self.evaluate(t, w, true)?;
        let n = self.state.q.len();
        let energy = self.manifold.system().energy(&self.state);
        g[..n].copy_from_slice(&self.state.v);
        g[n..2 * n].copy_from_slice(&self.state.a);
        let end = 2 * n + self.z_rate.len();
        g[2 * n..end].copy_from_slice(&self.z_rate);
        g[end] = energy.dissipated;
        g[end + 1] = energy.supplied;
        Ok(())
    }

    fn norm(&mut self, change: &[f64]) -> f64 {
        let n = self.state.q.len();
        let end = 2 * n + self.z_rate.len();
        self.weights.norm(&change[..n], &change[n..2 * n], &change[2 * n..end])
    }
}

/// Explicit formulas never linearize.
impl LinearizedOde for FullOrder {
    fn linearize(&mut self, _: f64, _: &[f64], _: &[f64]) -> Result<(), EvaluationFailure> {
        Err(explicit_only())
    }

    fn factor(&mut self, _: f64) -> Result<(), EvaluationFailure> {
        Err(explicit_only())
    }

    fn solve(&mut self, x: &mut [f64]) {
        x.fill(f64::NAN);
    }

    fn time_derivative(&mut self, _: &mut [f64]) -> Result<(), EvaluationFailure> {
        Err(explicit_only())
    }
}

fn explicit_only() -> EvaluationFailure {
    EvaluationFailure {
        code: "simulation/explicit-only",
        message: "this form of the equations serves explicit formulas only".into(),
    }
}
