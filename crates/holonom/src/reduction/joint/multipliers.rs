//! Multipliers: of closures and drivers with the accelerations, of the joints of the tree and of normalizations where
//! they are asked for.

use super::algebra::Algebra;
use super::closures::Origin;
use super::engine::{BodyInertia, Engine, add, dot, pose};
use super::small::{factor, substitute};
use crate::system::State;

/// Most rows of joint and driver of an edge.
const MOST_ROWS: usize = 7;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Multipliers of closures and of drivers on the tree, after [`Engine::project`].
    pub(super) fn tell_multipliers(&self, lambda: &mut [f64]) {
        for closure in &self.closures.all {
            if let Origin::Joint(_) = closure.origin {
                for (y, (_, row)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    lambda[*row] = -y;
                }
            }
        }
        self.driven.iter().for_each(|&(k, row, sign, _)| lambda[row] = -sign * self.along[k]);
    }

    /// Multipliers of the joints and drivers of the tree and of the normalizations, beside those of the closures, for the
    /// present rates of twists; `false` where the rows of a joint depend on each other.
    pub(super) fn tree_multipliers(&mut self, state: &mut State) -> bool {
        let State { q, a, lambda, .. } = state;
        self.evaluate_wrenches(q, a);
        self.add_closure_forces(q, lambda);
        self.gather();
        let system = self.system.clone();
        let structure = system.structure();
        // What joints exert along Euler parameters, which bodies do not feel, is up to the normalizations.
        let normalized = structure.normalization_start < structure.sizes.rows;
        self.generalized.fill(0.0);
        let mut gradients = [[0.0; 6 * 14]; 2];
        let mut places = [0; 2];
        for edge in &*self.edges {
            let Some(joint) = edge.joint else { continue };
            let o = A::center(pose(q, edge.body));
            let mut felt = [[0.0; W]; MOST_ROWS];
            let mut rows = [0; MOST_ROWS];
            let mut count = 0;
            let both = [Some(joint), edge.driver];
            for (joint, gradient) in both.into_iter().flatten().zip(&mut gradients) {
                places[usize::from(count > 0)] = joint;
                let placed = &structure.joints[joint];
                let gradient = &mut gradient[..placed.rows * 2 * N];
                system.joint_gradient(joint, q, gradient);
                let side = usize::from(placed.bodies[1] == Some(edge.body));
                for (k, own) in gradient.chunks_exact(2 * N).enumerate() {
                    felt[count] = A::wrench(pose(q, edge.body), &o, pose(own, side));
                    rows[count] = placed.row + k;
                    count += 1;
                }
            }
            let length = system.characteristic_length();
            let wrench = A::moved(&self.wrench[edge.body], &self.origin[edge.body], &o);
            let weigh = |w: &[f64; W]| A::scaled(w, 1.0 / length);
            let (felt, wrench) = (felt.map(|w| weigh(&w)), weigh(&wrench));
            let mut square = [[0.0; MOST_ROWS]; MOST_ROWS];
            let mut right = [0.0; MOST_ROWS];
            for i in 0..count {
                right[i] = -dot(&felt[i], &wrench);
                for j in 0..=i {
                    square[i][j] = dot(&felt[i], &felt[j]);
                }
            }
            if !factor(&mut square, count) {
                return false;
            }
            substitute(&square, count, &mut right);
            // Once more with what is left: the square has lost half the digits.
            let mut left = wrench;
            for (felt, x) in felt.iter().zip(&right).take(count) {
                add(&mut left, *x, felt);
            }
            let mut again = [0.0; MOST_ROWS];
            for (again, felt) in again.iter_mut().zip(&felt).take(count) {
                *again = -dot(felt, &left);
            }
            substitute(&square, count, &mut again);
            for k in 0..count {
                lambda[rows[k]] = right[k] + again[k];
            }
            let used = if normalized { both.iter().flatten().count() } else { 0 };
            for (gradient, joint) in gradients.iter().zip(places).take(used) {
                let placed = &structure.joints[joint];
                let rows = gradient.chunks_exact(2 * N).take(placed.rows).enumerate();
                for (k, own) in rows {
                    subtract::<N>(
                        &mut self.generalized,
                        placed.bodies,
                        lambda[placed.row + k],
                        own,
                    );
                }
            }
        }
        if !normalized {
            return true;
        }
        for closure in &self.closures.all {
            if let Origin::Joint(joint) = closure.origin {
                let gradient = &mut gradients[0][..closure.count * 2 * N];
                system.joint_gradient(joint, q, gradient);
                for (row, global) in &closure.rows {
                    let own = &gradient[row * 2 * N..][..2 * N];
                    subtract::<N>(&mut self.generalized, closure.ends, lambda[*global], own);
                }
            }
        }
        let first = structure.sizes.translations;
        for b in 0..structure.sizes.bodies {
            let (p, force) = (&q[b * N + first..(b + 1) * N], &self.generalized[b * N + first..]);
            let along = p.iter().zip(force).map(|(p, f)| p * f).sum::<f64>();
            // Twice the energy of the turning, for which p̈ has a part along p.
            let (y, BodyInertia { turned, .. }) = (&self.twist[b], &self.inertias[b]);
            let turning = dot(y, &A::inertia_about_center(0.0, turned, y));
            lambda[structure.normalization_start + b] = 0.5 * along + turning;
        }
        true
    }
}

/// Takes λ times a row from the forces on its two bodies.
fn subtract<const N: usize>(out: &mut [f64], ends: [Option<usize>; 2], lambda: f64, row: &[f64]) {
    for (own, body) in row.chunks_exact(N).zip(ends) {
        let Some(b) = body else { continue };
        for (out, x) in out[b * N..].iter_mut().zip(own) {
            *out -= lambda * x;
        }
    }
}
