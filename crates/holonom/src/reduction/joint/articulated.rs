//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{Engine, add, dot, pose};
use super::small::{factor, substitute};

/// Growth of numbers in the elimination of an edge that leaves ten digits; beyond it other solvers answer.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// Articulated inertia of an edge: U = K B, the factor of BᵀU, and BᵀU's right-hand side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<const W: usize> {
    pub(super) inertia: [[f64; W]; W],
    /// Sizes of what its diagonal is summed from.
    size: [f64; W],
    felt: [[f64; W]; 6],
    pivots: [[f64; 6]; 6],
    force: [f64; 6],
}

impl<const W: usize> Articulated<W> {
    pub(super) fn zero() -> Self {
        Self {
            inertia: [[0.0; W]; W],
            size: [0.0; W],
            felt: [[0.0; W]; 6],
            pivots: [[0.0; 6]; 6],
            force: [0.0; 6],
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Inertia of every body about its reference point, by rows.
    pub(super) fn evaluate_inertias(&mut self, q: &[f64]) {
        for (b, (mass, inertia)) in self.inertias.iter().enumerate() {
            let own = &mut self.articulated[b].inertia;
            for (k, row) in own.iter_mut().enumerate() {
                let unit = std::array::from_fn(|i| f64::from(u8::from(i == k)));
                *row = A::inertia_times(*mass, inertia, pose(q, b), &self.origin[b], &unit);
            }
            self.articulated[b].size = std::array::from_fn(|k| self.articulated[b].inertia[k][k]);
        }
    }

    /// Accelerations of a tree; the wrenches are those at zero accelerations.
    pub(super) fn articulate(&mut self) -> bool {
        for edge in self.edges.iter().rev() {
            let (b, n) = (edge.body, edge.range.len());
            let mut own = self.articulated[b];
            let columns = &self.columns[edge.range.clone()];
            for (felt, column) in own.felt.iter_mut().zip(columns) {
                for (out, row) in felt.iter_mut().zip(&own.inertia) {
                    *out = dot(row, column);
                }
            }
            for i in 0..n {
                own.force[i] = -dot(&columns[i], &self.wrench[b]);
                for j in 0..=i {
                    own.pivots[i][j] = dot(&columns[i], &own.felt[j]);
                }
            }
            // What the pivots were summed from: a light body between two hinges of one axis leaves round-off.
            let terms = |column: &[f64; W]| {
                column.iter().zip(&own.size).map(|(x, size)| x * x * size).sum::<f64>()
            };
            let sizes: [f64; 6] = std::array::from_fn(|i| columns.get(i).map_or(0.0, terms));
            let factored = factor(&mut own.pivots, n);
            let lost = |i: usize| sizes[i] > LARGEST_GROWTH * own.pivots[i][i] * own.pivots[i][i];
            if !factored || (0..n).any(lost) {
                return false;
            }
            if let Some(base) = edge.base {
                // K − U (BᵀU)⁻¹Uᵀ, and the wrench with what the edge's own forces make of it.
                let mut half = own.felt;
                for w in 0..W {
                    for i in 0..n {
                        let mut x = half[i][w];
                        for j in 0..i {
                            x -= own.pivots[i][j] * half[j][w];
                        }
                        half[i][w] = x / own.pivots[i][i];
                    }
                }
                let mut rate = own.force;
                substitute(&own.pivots, n, &mut rate);
                let mut wrench = self.wrench[b];
                for (felt, rate) in own.felt.iter().zip(&rate).take(n) {
                    add(&mut wrench, *rate, felt);
                }
                add(&mut self.wrench[base], 1.0, &wrench);
                for (i, (out, row)) in
                    self.articulated[base].inertia.iter_mut().zip(&own.inertia).enumerate()
                {
                    add(out, 1.0, row);
                    for half in half.iter().take(n) {
                        add(out, -half[i], half);
                    }
                }
                for (w, size) in self.articulated[base].size.iter_mut().enumerate() {
                    *size += own.size[w] + half.iter().take(n).map(|h| h[w] * h[w]).sum::<f64>();
                }
            }
            self.articulated[b] = own;
        }
        for edge in &self.edges {
            let own = &self.articulated[edge.body];
            let mut motion = edge.base.map_or([0.0; W], |base| self.motion[base]);
            let n = edge.range.len();
            let mut rate = own.force;
            for (rate, felt) in rate.iter_mut().zip(&own.felt).take(n) {
                *rate -= dot(felt, &motion);
            }
            substitute(&own.pivots, n, &mut rate);
            for (k, rate) in edge.range.clone().zip(rate) {
                self.accelerations[k] = rate;
                add(&mut motion, rate, &self.columns[k]);
            }
            self.motion[edge.body] = motion;
        }
        true
    }
}
