//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{BodyInertia, Engine, add, dot, pose};
use super::small::{factor, substitute};

/// Growth of numbers in the elimination of an edge that leaves ten digits; beyond it other solvers answer.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// Articulated inertia of a body K, its wrench, the factor of Bᵀ K B of its edge and Bᵀ's right-hand side, all about the
/// body's own place: about the root's, what is far out would be a small difference of what is long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<const W: usize> {
    pub(super) inertia: [[f64; W]; W],
    place: [f64; 3],
    wrench: [f64; W],
    /// Sizes of what its diagonal is summed from.
    size: [f64; W],
    pivots: [[f64; 6]; 6],
    force: [f64; 6],
}

impl<const W: usize> Articulated<W> {
    pub(super) fn zero() -> Self {
        Self {
            inertia: [[0.0; W]; W],
            place: [0.0; 3],
            wrench: [0.0; W],
            size: [0.0; W],
            pivots: [[0.0; 6]; 6],
            force: [0.0; 6],
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Inertia of every body about its own place.
    pub(super) fn evaluate_inertias(&mut self, q: &[f64]) {
        for (b, BodyInertia { mass, turned, .. }) in self.inertias.iter().enumerate() {
            let own = &mut self.articulated[b];
            own.place = A::center(pose(q, b));
            own.inertia = A::own_inertia(*mass, turned);
        }
    }

    /// Accelerations of a tree; the wrenches are those at zero accelerations, the inertias those of the bodies alone.
    pub(super) fn articulate(&mut self) -> bool {
        for edge in &self.edges {
            let (b, o) = (edge.body, &self.origin[edge.body]);
            let own = &mut self.articulated[b];
            own.size = std::array::from_fn(|k| own.inertia[k][k]);
            own.wrench = A::moved(&self.wrench[b], o, &own.place);
            for k in edge.range.clone() {
                self.own_columns[k] = A::moved_twist(&self.columns[k], o, &own.place);
            }
        }
        for edge in self.edges.iter().rev() {
            let (b, n) = (edge.body, edge.range.len());
            let own = &mut self.articulated[b];
            let columns = &self.own_columns[edge.range.clone()];
            let felt = &mut self.felt[edge.range.clone()];
            for (felt, column) in felt.iter_mut().zip(columns) {
                for (out, row) in felt.iter_mut().zip(&own.inertia) {
                    *out = dot(row, column);
                }
            }
            for i in 0..n {
                own.force[i] = -dot(&columns[i], &own.wrench);
                for j in 0..=i {
                    own.pivots[i][j] = dot(&columns[i], &felt[j]);
                }
            }
            let factored = factor(&mut own.pivots, n);
            // What the pivots were summed from: a light body between two hinges of one axis leaves round-off.
            let lost = columns.iter().enumerate().any(|(i, column)| {
                let terms = column.iter().zip(&own.size).map(|(x, size)| x * x * size);
                let pivot = own.pivots[i][i];
                terms.sum::<f64>() > LARGEST_GROWTH * pivot * pivot
            });
            if !factored || lost {
                return false;
            }
            let Some(base) = edge.base else { continue };
            // K − U (BᵀU)⁻¹Uᵀ, U = K B, and the wrench with what the edge's own forces make of it.
            let (mut rest, mut size, mut wrench) = (own.inertia, [0.0; W], own.wrench);
            for w in 0..W {
                size[w] = rest[w][w];
            }
            let mut halves = [[0.0; W]; 6];
            for i in 0..n {
                let mut half = felt[i];
                for j in 0..i {
                    add(&mut half, -own.pivots[i][j], &halves[j]);
                }
                half.iter_mut().for_each(|x| *x /= own.pivots[i][i]);
                for w in 0..W {
                    size[w] += half[w] * half[w];
                    add(&mut rest[w], -half[w], &half);
                }
                halves[i] = half;
            }
            let mut rate = own.force;
            substitute(&own.pivots, n, &mut rate);
            for (felt, rate) in felt.iter().zip(&rate) {
                add(&mut wrench, *rate, felt);
            }
            let from = own.place;
            let carrier = &mut self.articulated[base];
            let to = &carrier.place;
            add(&mut carrier.wrench, 1.0, &A::moved(&wrench, &from, to));
            let rest = A::moved_inertia(&rest, &from, to);
            carrier.inertia.iter_mut().zip(&rest).for_each(|(out, row)| add(out, 1.0, row));
            add(&mut carrier.size, 1.0, &A::moved_sizes(&size, &from, to));
        }
        for edge in &self.edges {
            let own = &self.articulated[edge.body];
            let mut motion = edge.base.map_or([0.0; W], |base| {
                A::moved_twist(&self.motion[base], &self.articulated[base].place, &own.place)
            });
            let mut rate = own.force;
            for (rate, felt) in rate.iter_mut().zip(&self.felt[edge.range.clone()]) {
                *rate -= dot(felt, &motion);
            }
            substitute(&own.pivots, edge.range.len(), &mut rate);
            for (k, rate) in edge.range.clone().zip(rate) {
                self.accelerations[k] = rate;
                add(&mut motion, rate, &self.own_columns[k]);
            }
            self.motion[edge.body] = motion;
        }
        true
    }
}
