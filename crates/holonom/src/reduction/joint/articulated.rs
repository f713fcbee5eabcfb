//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{BodyInertia, Engine, add, dot, pose};
use super::small::{factor, substitute};

/// Growth of numbers in the elimination of an edge that leaves ten digits; beyond it other solvers answer.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// Articulated inertia of a body K, less what its edge takes of it once that is eliminated, its wrench, the factor of Bᵀ K B
/// of its edge and Bᵀ's right-hand side, all about the body's own place: about the root's, what is far out would be a small difference of what is long.
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

    /// By the number of an edge's coordinates: loops of known lengths are worth it.
    const ELIMINATE: [fn(&mut Self, &[[f64; W]], &mut [[f64; W]]) -> bool; 7] = [
        Self::eliminate::<0>,
        Self::eliminate::<1>,
        Self::eliminate::<2>,
        Self::eliminate::<3>,
        Self::eliminate::<4>,
        Self::eliminate::<5>,
        Self::eliminate::<6>,
    ];
    const RESPOND: [fn(&Self, &[[f64; W]], &[[f64; W]], &mut [f64; W], &mut [f64]); 7] = [
        Self::respond::<0>,
        Self::respond::<1>,
        Self::respond::<2>,
        Self::respond::<3>,
        Self::respond::<4>,
        Self::respond::<5>,
        Self::respond::<6>,
    ];

    /// U = K B into `felt`, K ← K − U (BᵀU)⁻¹Uᵀ and the wrench with what the edge's own forces make of it; `false` where
    /// too few digits are left.
    fn eliminate<const M: usize>(&mut self, columns: &[[f64; W]], felt: &mut [[f64; W]]) -> bool {
        let columns: &[[f64; W]; M] = columns.first_chunk().expect("M coordinates");
        let felt: &mut [[f64; W]; M] = felt.first_chunk_mut().expect("M coordinates");
        for (felt, column) in felt.iter_mut().zip(columns) {
            *felt = self.inertia.map(|row| dot(&row, column));
        }
        for i in 0..M {
            self.force[i] = -dot(&columns[i], &self.wrench);
            for j in 0..=i {
                self.pivots[i][j] = dot(&columns[i], &felt[j]);
            }
        }
        let factored = factor(&mut self.pivots, M);
        // What the pivots were summed from: a light body between two hinges of one axis leaves round-off.
        let lost = columns.iter().enumerate().any(|(i, column)| {
            let terms = column.iter().zip(&self.size).map(|(x, size)| x * x * size);
            let pivot = self.pivots[i][i];
            terms.sum::<f64>() > LARGEST_GROWTH * pivot * pivot
        });
        if !factored || lost {
            return false;
        }
        self.size = std::array::from_fn(|w| self.inertia[w][w]);
        let (mut halves, mut rate) = ([[0.0; W]; M], [0.0; M]);
        for i in 0..M {
            (halves[i], rate[i]) = (felt[i], self.force[i]);
            for j in 0..i {
                let half = halves[j];
                add(&mut halves[i], -self.pivots[i][j], &half);
                rate[i] -= self.pivots[i][j] * rate[j];
            }
            halves[i] = halves[i].map(|x| x / self.pivots[i][i]);
            rate[i] /= self.pivots[i][i];
            for w in 0..W {
                self.size[w] += halves[i][w] * halves[i][w];
                add(&mut self.inertia[w], -halves[i][w], &halves[i]);
            }
            add(&mut self.wrench, rate[i], &halves[i]);
        }
        true
    }

    /// Accelerations of the edge's coordinates where its base moves by `motion`, which becomes that of the body.
    fn respond<const M: usize>(
        &self,
        columns: &[[f64; W]],
        felt: &[[f64; W]],
        motion: &mut [f64; W],
        rates: &mut [f64],
    ) {
        let mut rate = self.force;
        for (rate, felt) in rate.iter_mut().zip(&felt[..M]) {
            *rate -= dot(felt, motion);
        }
        substitute(&self.pivots, M, &mut rate);
        rates.copy_from_slice(&rate[..M]);
        for (column, rate) in columns[..M].iter().zip(&rate) {
            add(motion, *rate, column);
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
            let own = &mut self.articulated[edge.body];
            let columns = &self.own_columns[edge.range.clone()];
            let felt = &mut self.felt[edge.range.clone()];
            if !Articulated::ELIMINATE[edge.range.len()](own, columns, felt) {
                return false;
            }
            let Some(base) = edge.base else { continue };
            let Articulated { inertia, place, wrench, size, .. } = *own;
            let carrier = &mut self.articulated[base];
            let to = &carrier.place;
            add(&mut carrier.wrench, 1.0, &A::moved(&wrench, &place, to));
            let inertia = A::moved_inertia(&inertia, &place, to);
            carrier.inertia.iter_mut().zip(&inertia).for_each(|(out, row)| add(out, 1.0, row));
            add(&mut carrier.size, 1.0, &A::moved_sizes(&size, &place, to));
        }
        for edge in &self.edges {
            let own = &self.articulated[edge.body];
            let mut motion = edge.base.map_or([0.0; W], |base| {
                A::moved_twist(&self.motion[base], &self.articulated[base].place, &own.place)
            });
            let columns = &self.own_columns[edge.range.clone()];
            let felt = &self.felt[edge.range.clone()];
            let rates = &mut self.accelerations[edge.range.clone()];
            Articulated::RESPOND[edge.range.len()](own, columns, felt, &mut motion, rates);
            self.motion[edge.body] = motion;
        }
        true
    }
}
