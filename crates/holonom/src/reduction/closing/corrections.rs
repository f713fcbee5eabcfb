//! Corrections that close positions and velocities.

use super::least_change::{
    PLAIN, RATES, Solve, USUAL, Unknowns, largest, least_change, limited, scale,
};
use crate::model::Model;
use crate::reduction::assembly::PROJECTED;
use crate::reduction::parametrization::largest_index;
use crate::system::{Measure, State, System};
use holonom_linalg::BlockMatrix;
use std::cmp::Ordering::Less;

/// Iterations at most.
const MAX_ITERATIONS: usize = 60;
/// Residual from which on an iteration has come near.
const NEAR: f64 = 1e-9;
/// Turning by less, against how far bodies slide, is round-off.
const NO_TURN: f64 = 1e-9;
/// Halvings of a step that makes a residual no smaller, and what is smaller.
const HALVINGS: i32 = 12;
const LESS: f64 = 1.0 - 1e-6;

/// Least-change solves over a set of free unknowns.
pub(super) struct Solver<'a> {
    pub(super) system: &'a dyn System,
    pub(super) model: &'a Model,
}

impl Solver<'_> {
    /// Gauss-Newton with minimum-norm corrections on Φ(q) = 0; returns the largest residual and its
    /// row. Without progress it stops; the residual then tells.
    pub(super) fn close(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
    ) -> (f64, usize) {
        let mut phi = vec![0.0; self.system.structure().sizes.rows];
        // Corrections find what is near; to what is far leads a path.
        let start = state.q.clone();
        if !self.approach(state, unknowns, g, &mut phi) {
            let left = self.left(state, &mut phi);
            let stuck = std::mem::replace(&mut state.q, start);
            self.follow(state, unknowns, g, &mut phi);
            self.approach(state, unknowns, g, &mut phi);
            if !matches!(self.left(state, &mut phi).partial_cmp(&left), Some(Less)) {
                state.q = stuck;
            }
        }
        self.system.position_constraints(state.t, &state.q, &mut phi);
        let mut worst = largest_index(&phi);
        // Parameters of another length than one hide which joint is open.
        let joint_rows = self.system.structure().sizes.joint_rows;
        if worst >= joint_rows && phi.get(worst).is_some_and(|x| x.abs() > PROJECTED) {
            self.restore_lengths(state, unknowns);
            self.system.position_constraints(state.t, &state.q, &mut phi);
            worst = largest_index(&phi);
        }
        if phi.is_empty() { (0.0, 0) } else { (phi[worst].abs(), worst) }
    }

    /// Size of what is left, lengths against the characteristic one; `phi` is room for all rows.
    pub(super) fn left(&self, state: &State, phi: &mut [f64]) -> f64 {
        self.system.position_constraints(state.t, &state.q, phi);
        let scale = scale(self.system, 0);
        let rows = phi.iter().zip(&self.system.structure().row_measure);
        let squares = rows.map(|(x, measure)| match measure {
            Measure::Length => (scale * x).powi(2),
            Measure::Angle => x * x,
        });
        squares.sum::<f64>().sqrt()
    }

    /// The iteration; whether it has come near. `phi` is room for Φ.
    fn approach(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        phi: &mut [f64],
    ) -> bool {
        let mut best = f64::INFINITY;
        let mut stalled = 0;
        for _ in 0..MAX_ITERATIONS {
            self.system.position_constraints(state.t, &state.q, phi);
            let size = phi.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            if size < 1e-14 || unknowns.free.is_empty() {
                return true;
            }
            if !size.is_finite() {
                return false;
            }
            stalled = if size < 0.9 * best { 0 } else { stalled + 1 };
            best = best.min(size);
            if stalled > if best < NEAR { 1 } else { 12 } {
                break;
            }
            let step = self.least_change(&state.q, unknowns, g, phi, USUAL);
            let Some(mut step) = step else { break };
            let [slid, turned] = largest(self.system, &step, 1.0);
            // What only slides is linear.
            if turned > NO_TURN * slid {
                step = limited(self.system, step, 1.0);
            }
            self.subtract(state, unknowns, &step);
        }
        best < NEAR
    }

    /// Goes to where no small change makes what is left smaller, if anything is: which rows contradict each other shows there.
    pub(super) fn settle(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        phi: &mut [f64],
    ) {
        let mut left = self.left(state, phi);
        for _ in 0..MAX_ITERATIONS {
            if !(NEAR..f64::INFINITY).contains(&left) {
                return;
            }
            let step = self.least_change(&state.q, unknowns, g, phi, PLAIN);
            let Some(mut step) = step.map(|step| limited(self.system, step, 1.0)) else { return };
            let from = state.q.clone();
            let mut least = f64::INFINITY;
            for _ in 0..HALVINGS {
                self.subtract(state, unknowns, &step);
                least = self.left(state, phi);
                if least < LESS * left {
                    break;
                }
                state.q.copy_from_slice(&from);
                step.iter_mut().for_each(|x| *x *= 0.5);
            }
            if least >= LESS * left {
                return;
            }
            left = least;
        }
    }

    /// The shortest step at a configuration that would take a residual away, found as [`least_change`] says.
    pub(super) fn least_change(
        &self,
        q: &[f64],
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        residual: &[f64],
        by: Solve,
    ) -> Option<Vec<f64>> {
        self.system.constraint_jacobian(q, g);
        least_change(self.system, g, residual, unknowns, q, by)
    }

    pub(super) fn subtract(&self, state: &mut State, unknowns: &Unknowns, step: &[f64]) {
        for (q, x) in state.q.iter_mut().zip(step) {
            *q -= x;
        }
        self.restore_origins(state, unknowns);
    }

    /// Gives free Euler parameters unit length.
    fn restore_lengths(&self, state: &mut State, unknowns: &Unknowns) {
        let sizes = self.system.structure().sizes;
        let places = unknowns.free.iter().map(|&i| sizes.place_of(i));
        for (body, _) in places.filter(|(_, own)| *own == sizes.translations) {
            let p = &mut state.q[sizes.rotations_of(body)];
            let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
            if length > 0.0 {
                p.iter_mut().for_each(|x| *x /= length);
            }
        }
        self.restore_origins(state, unknowns);
    }

    /// Minimum-norm correction of velocities; returns the largest residual left and its row.
    pub(super) fn close_velocities(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &BlockMatrix,
    ) -> (f64, usize) {
        let rows = self.system.structure().sizes.rows;
        let mut residual = vec![0.0; rows];
        let evaluate = |v: &[f64], residual: &mut Vec<f64>| {
            self.system.velocity_rhs(state.t, residual);
            residual.iter_mut().for_each(|x| *x = -*x);
            g.multiply_add(1.0, v, residual);
        };
        // Twice: the second solve removes the round-off of the first.
        for _ in 0..2 {
            evaluate(&state.v, &mut residual);
            if unknowns.free.is_empty() || residual.iter().all(|x| x.abs() < 1e-14) {
                break;
            }
            let Some(step) = least_change(self.system, g, &residual, unknowns, &state.q, RATES)
            else {
                break;
            };
            for (v, x) in state.v.iter_mut().zip(&step) {
                *v -= x;
            }
        }
        evaluate(&state.v, &mut residual);
        let worst = largest_index(&residual);
        if rows == 0 { (0.0, 0) } else { (residual[worst].abs(), worst) }
    }

    /// Puts the origins of coupled bodies back to their stated places.
    fn restore_origins(&self, state: &mut State, unknowns: &Unknowns) {
        for &b in &unknowns.coupled {
            let stated = self.model.initial.bodies.get(b);
            let Some(position) = stated.and_then(|own| own.position) else { continue };
            let mut pose = self.system.body(b, &state.q, &state.v);
            pose.position = position;
            let mut v = state.v.clone();
            self.system.set_body(b, &pose, &mut state.q, &mut v);
        }
    }
}
