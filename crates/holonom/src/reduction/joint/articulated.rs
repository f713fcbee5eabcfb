//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{Engine, add, dot, pose};
use super::small::{factor, substitute};

/// Growth of numbers in the elimination of an edge that leaves ten digits; beyond it other solvers answer.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// Articulated inertia of an edge: U = K B, the factor of BᵀU, and BᵀU's right-hand side, all about the body's own place:
/// about the root's, what is far out would be a small difference of what is long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<const W: usize> {
    pub(super) inertia: [[f64; W]; W],
    place: [f64; 3],
    columns: [[f64; W]; 6],
    wrench: [f64; W],
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
            place: [0.0; 3],
            columns: [[0.0; W]; 6],
            wrench: [0.0; W],
            size: [0.0; W],
            felt: [[0.0; W]; 6],
            pivots: [[0.0; 6]; 6],
            force: [0.0; 6],
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Inertia, wrench and columns of every body about its own place.
    pub(super) fn evaluate_inertias(&mut self, q: &[f64]) {
        for edge in &self.edges {
            let b = edge.body;
            let ((mass, inertia), own) = (&self.inertias[b], &mut self.articulated[b]);
            let (q, o) = (pose(q, b), &self.origin[b]);
            own.place = A::center(q);
            own.inertia = A::own_inertia(*mass, inertia, q);
            own.size = std::array::from_fn(|k| own.inertia[k][k]);
            own.wrench = A::moved(&self.wrench[b], o, &own.place);
            for (out, column) in own.columns.iter_mut().zip(&self.columns[edge.range.clone()]) {
                *out = A::moved_twist(column, o, &own.place);
            }
        }
    }

    /// Accelerations of a tree; the wrenches are those at zero accelerations.
    pub(super) fn articulate(&mut self) -> bool {
        for edge in self.edges.iter().rev() {
            let (b, n) = (edge.body, edge.range.len());
            let mut own = self.articulated[b];
            let columns = &own.columns[..n];
            for (felt, column) in own.felt.iter_mut().zip(columns) {
                for (out, row) in felt.iter_mut().zip(&own.inertia) {
                    *out = dot(row, column);
                }
            }
            for i in 0..n {
                own.force[i] = -dot(&columns[i], &own.wrench);
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
                let mut wrench = own.wrench;
                for (felt, rate) in own.felt.iter().zip(&rate).take(n) {
                    add(&mut wrench, *rate, felt);
                }
                let (mut rest, mut size) = (own.inertia, [0.0; W]);
                for (i, row) in rest.iter_mut().enumerate() {
                    size[i] = row[i];
                    for half in half.iter().take(n) {
                        size[i] += half[i] * half[i];
                        add(row, -half[i], half);
                    }
                }
                let carrier = &mut self.articulated[base];
                let (from, to) = (&own.place, &carrier.place);
                add(&mut carrier.wrench, 1.0, &A::moved(&wrench, from, to));
                let rest = A::moved_inertia(&rest, from, to);
                carrier.inertia.iter_mut().zip(&rest).for_each(|(out, row)| add(out, 1.0, row));
                add(&mut carrier.size, 1.0, &A::moved_sizes(&size, from, to));
            }
            self.articulated[b] = own;
        }
        for edge in &self.edges {
            let own = &self.articulated[edge.body];
            let mut motion = edge.base.map_or([0.0; W], |base| {
                A::moved_twist(&self.motion[base], &self.articulated[base].place, &own.place)
            });
            let n = edge.range.len();
            let mut rate = own.force;
            for (rate, felt) in rate.iter_mut().zip(&own.felt).take(n) {
                *rate -= dot(felt, &motion);
            }
            substitute(&own.pivots, n, &mut rate);
            for (k, rate) in edge.range.clone().zip(rate) {
                self.accelerations[k] = rate;
                add(&mut motion, rate, &own.columns[k - edge.range.start]);
            }
            self.motion[edge.body] = motion;
        }
        true
    }
}
