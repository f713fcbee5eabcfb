//! The equations for explicit formulas: w = (v, v̇, z, dissipated energy, supplied work), the last two at rest where drivers
//! move.

use super::equation_form::EquationForm;
use super::first_order::new_matrix;
use super::ode::{EvaluationFailure, LinearizedOde, Ode, require_finite};
use super::weights::Weights;
use crate::newton::{Chosen, MatrixOptions, Newton, ReducedMatrix};
use crate::reduction::{Manifold, Point};
use crate::system::State;

/// ẇ = (v̇, v̈, ż, powers) on the constraint manifold.
#[derive(Debug, Clone)]
pub struct ExplicitForm {
    point: Point,
    weights: Weights,
    dq: Vec<f64>,
    dv: Vec<f64>,
    rows: Vec<f64>,
    rates: Vec<f64>,
    /// Whether the powers of drivers are too much for the formula.
    powers_apart: bool,
    /// Where the slope was evaluated last, NaN where that point is no longer at hand, and the slope: the last
    /// stage of a formula is where its step ends.
    at_time: f64,
    at: Vec<f64>,
    slope: Vec<f64>,
    /// What errors are carried along with, where they are; formulas have no use for it.
    newton: Option<Box<Newton<Chosen<ReducedMatrix>>>>,
}

/// Energy components at the end of w.
const POWERS: usize = 2;

impl ExplicitForm {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State) -> Self {
        let dimension = 2 * manifold.chart().ndof() + state.z.len() + POWERS;
        let system = manifold.system();
        let powers_apart = system.has_moving_drivers();
        Self {
            weights,
            dq: vec![0.0; state.q.len()],
            dv: vec![0.0; state.q.len()],
            rows: vec![0.0; state.lambda.len()],
            rates: vec![0.0; manifold.chart().ndof()],
            powers_apart,
            at_time: f64::NAN,
            at: vec![0.0; dimension],
            slope: vec![0.0; dimension],
            newton: None,
            point: Point::new(manifold, state),
        }
    }
}

impl EquationForm for ExplicitForm {
    /// Makes room for a matrix, which no formula needs but the error that is carried along.
    fn set_matrix(&mut self, options: MatrixOptions) {
        let Point { manifold, anchor, .. } = &mut self.point;
        self.newton = Some(Box::new(new_matrix(manifold, anchor, options)));
    }

    fn point(&self) -> &Point {
        &self.point
    }

    fn point_mut(&mut self) -> &mut Point {
        self.at_time = f64::NAN;
        &mut self.point
    }

    fn spread(&mut self, change: &[f64]) -> [&[f64]; 2] {
        let Self { point, dq, dv, rows, rates, .. } = self;
        point.spread(change, dq, dv, rows, rates);
        [dq, dv]
    }

    fn displace(&mut self, change: &[f64]) -> &[f64] {
        let Self { point, dq, rows, rates, .. } = self;
        point.displace(&change[..rates.len()], dq, rows);
        dq
    }

    fn weights(&self) -> &Weights {
        &self.weights
    }

    fn begin_step(&mut self, state: &State) {
        self.at_time = f64::NAN;
        self.point.begin_step(state);
        self.weights.set(state);
    }

    fn pack(&self, state: &State, w: &mut [f64]) {
        let ndof = self.rates.len();
        let (positions, rest) = w.split_at_mut(ndof);
        let (rates, rest) = rest.split_at_mut(ndof);
        let (z, powers) = rest.split_at_mut(state.z.len());
        self.point.manifold.independent_state(state, positions, rates);
        z.copy_from_slice(&state.z);
        powers.copy_from_slice(&[state.ledger.dissipated, state.ledger.supplied]);
    }

    fn reparametrized(&mut self) {
        self.rates.resize(self.point.manifold.chart().ndof(), 0.0);
        if let Some(options) = self.newton.as_ref().map(|newton| newton.options()) {
            self.set_matrix(options);
        }
    }

    /// Not where a driver is to move: no error of the motion tells that power, and a formula of high order through those of
    /// the steps before makes anything of a sudden one.
    fn integrates_powers(&self) -> bool {
        !self.rates.is_empty() && !self.powers_apart
    }

    fn references_moved(&mut self, _w: &[f64]) {}

    fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure> {
        self.at_time = f64::NAN;
        require_finite(t, w)?;
        let ndof = self.rates.len();
        let (positions, rest) = w.split_at(ndof);
        let (rates, rest) = rest.split_at(ndof);
        let (z, powers) = rest.split_at(self.point.z_rate.len());
        self.point.evaluate(t, positions, rates, z, full)?;
        self.point.state.ledger.dissipated = powers[0];
        self.point.state.ledger.supplied = powers[1];
        Ok(&self.point.state)
    }
}

impl Ode for ExplicitForm {
    fn dimension(&self) -> usize {
        2 * self.rates.len() + self.point.z_rate.len() + POWERS
    }

    fn second_order_split(&self) -> usize {
        self.rates.len()
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        if t == self.at_time && w == self.at {
            g.copy_from_slice(&self.slope);
            return Ok(());
        }
        self.evaluate(t, w, true)?;
        let ndof = self.rates.len();
        let Point { manifold, state, z_rate, .. } = &mut self.point;
        g[..ndof].copy_from_slice(&w[ndof..2 * ndof]);
        manifold.independent_acceleration_anew(state, &mut g[ndof..2 * ndof]);
        let end = 2 * ndof + z_rate.len();
        g[2 * ndof..end].copy_from_slice(z_rate);
        g[end..].fill(0.0);
        if !self.powers_apart {
            let energy = manifold.system().energy(state);
            g[end..].copy_from_slice(&[energy.dissipated, energy.supplied]);
        }
        self.at_time = t;
        w.clone_into(&mut self.at);
        g.clone_into(&mut self.slope);
        Ok(())
    }

    /// On all coordinates, with the factors of the last evaluation; energies have no part in it.
    fn norm(&mut self, change: &[f64]) -> f64 {
        self.spread(change);
        let Self { point, dq, dv, rates, weights, .. } = self;
        let at = [&*point.state.q, &*point.state.v];
        weights.norm(Some(at), [dq, dv], &change[2 * rates.len()..][..point.z_rate.len()])
    }
}

/// For the error that is carried along, where there is a matrix; energies have no part in it.
impl LinearizedOde for ExplicitForm {
    fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        if !(t == self.at_time && w == self.at) {
            self.evaluate(t, w, true)?;
        }
        self.point.complete();
        let Self { newton, point, .. } = self;
        let newton = newton.as_mut().ok_or_else(no_matrix)?;
        newton.linearize(point, &w[..w.len() - POWERS])
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        let newton = self.newton.as_mut().ok_or_else(no_matrix)?;
        self.point.manifold.counters.analyses += newton.factor(gamma_h, gamma_h * gamma_h)?;
        Ok(())
    }

    fn solve(&mut self, x: &mut [f64]) {
        let within = x.len() - POWERS;
        match &mut self.newton {
            Some(newton) => newton.filter(&mut x[..within]),
            None => x.fill(f64::NAN),
        }
    }

    fn time_derivative(&mut self, _: &mut [f64]) -> Result<(), EvaluationFailure> {
        Err(no_matrix())
    }
}

fn no_matrix() -> EvaluationFailure {
    EvaluationFailure::new(
        "simulation/explicit-only",
        "this form of the equations serves explicit formulas only",
    )
}
