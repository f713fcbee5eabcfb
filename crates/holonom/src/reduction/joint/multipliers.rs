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
        let first = structure.sizes.translations;
        self.normal.fill(0.0);
        let length = system.characteristic_length();
        let mut gradient = [0.0; 6 * 14];
        let mut felt = [[0.0; W]; MOST_ROWS];
        let mut forces = [0.0; MOST_ROWS];
        let mut normal = [[0.0; 2]; MOST_ROWS];
        for edge in &*self.edges {
            let Some(joint) = edge.joint else { continue };
            let place = pose(q, edge.body);
            let o = A::center(place);
            let both = [Some(joint), edge.driver];
            let mut count = 0;
            for joint in both.into_iter().flatten() {
                let placed = &structure.joints[joint];
                let gradient = &mut gradient[..placed.rows * 2 * N];
                system.joint_gradient(joint, q, gradient);
                let side = usize::from(placed.bodies[1] == Some(edge.body));
                for own in gradient.chunks_exact(2 * N) {
                    felt[count] = A::scaled(&A::wrench(place, &o, pose(own, side)), 1.0 / length);
                    if normalized {
                        normal[count] = normal_parts::<N>(first, q, placed.bodies, own);
                    }
                    count += 1;
                }
            }
            let wrench = A::moved(&self.wrench[edge.body], &self.origin[edge.body], &o);
            let wrench = A::scaled(&wrench, 1.0 / length);
            let forces = &mut forces[..count];
            if !hold(&felt, wrench, forces) {
                return false;
            }
            let mut rest = forces.iter().zip(&normal);
            for joint in both.into_iter().flatten() {
                let placed = &structure.joints[joint];
                let own = &mut lambda[placed.row..][..placed.rows];
                for (lambda, (force, normal)) in own.iter_mut().zip(rest.by_ref()) {
                    *lambda = *force;
                    if normalized {
                        take(&mut self.normal, placed.bodies, *force, normal);
                    }
                }
            }
        }
        if !normalized {
            return true;
        }
        for closure in &self.closures.all {
            let Origin::Joint(joint) = closure.origin else { continue };
            let gradient = &mut gradient[..closure.count * 2 * N];
            system.joint_gradient(joint, q, gradient);
            for (row, global) in &closure.rows {
                let own = &gradient[row * 2 * N..][..2 * N];
                let normal = normal_parts::<N>(first, q, closure.ends, own);
                take(&mut self.normal, closure.ends, lambda[*global], &normal);
            }
        }
        for (b, along) in self.normal.iter().enumerate() {
            // Twice the energy of the turning, for which p̈ has a part along p.
            let (y, BodyInertia { turned, .. }) = (&self.twist[b], &self.inertias[b]);
            let turning = dot(y, &A::inertia_about_center(0.0, turned, y));
            lambda[structure.normalization_start + b] = 0.5 * along + turning;
        }
        true
    }
}

/// Multipliers by which rows hold a body against a wrench; `false` where they depend on each other.
fn hold<const W: usize>(
    rows: &[[f64; W]; MOST_ROWS],
    wrench: [f64; W],
    multipliers: &mut [f64],
) -> bool {
    match multipliers.len() {
        0 => true,
        1 => hold_by::<1, W>(rows, wrench, multipliers),
        2 => hold_by::<2, W>(rows, wrench, multipliers),
        3 => hold_by::<3, W>(rows, wrench, multipliers),
        4 => hold_by::<4, W>(rows, wrench, multipliers),
        5 => hold_by::<5, W>(rows, wrench, multipliers),
        6 => hold_by::<6, W>(rows, wrench, multipliers),
        _ => hold_by::<MOST_ROWS, W>(rows, wrench, multipliers),
    }
}

fn hold_by<const C: usize, const W: usize>(
    rows: &[[f64; W]; MOST_ROWS],
    wrench: [f64; W],
    multipliers: &mut [f64],
) -> bool {
    let mut square = [[0.0; C]; C];
    for i in 0..C {
        for j in 0..=i {
            square[i][j] = dot(&rows[i], &rows[j]);
        }
    }
    if !factor(&mut square, C) {
        return false;
    }
    // Once more with what is left: the square has lost half the digits.
    let (mut left, mut sum) = (wrench, [0.0; C]);
    for _ in 0..2 {
        let mut right: [f64; C] = std::array::from_fn(|i| -dot(&rows[i], &left));
        substitute(&square, C, &mut right);
        for i in 0..C {
            sum[i] += right[i];
            add(&mut left, right[i], &rows[i]);
        }
    }
    multipliers.copy_from_slice(&sum);
    true
}

/// Parts along the Euler parameters, which begin at `first`, of the bodies of a row on their coordinates.
fn normal_parts<const N: usize>(
    first: usize,
    q: &[f64],
    ends: [Option<usize>; 2],
    row: &[f64],
) -> [f64; 2] {
    std::array::from_fn(|side| {
        let Some(b) = ends[side] else { return 0.0 };
        let (p, own): (&[f64; N], &[f64; N]) = (pose(q, b), pose(row, side));
        p[first..].iter().zip(&own[first..]).map(|(p, x)| p * x).sum()
    })
}

/// Takes λ times the parts of a row from those of the forces on its two bodies.
fn take(out: &mut [f64], ends: [Option<usize>; 2], lambda: f64, parts: &[f64; 2]) {
    for (part, body) in parts.iter().zip(ends) {
        if let Some(b) = body {
            out[b] -= lambda * part;
        }
    }
}
