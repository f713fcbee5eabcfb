//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{BodyInertia, Engine, add, dot, pose};
use super::inertia::Inertia;
use super::small::{factor, substitute};
use crate::math::vector::difference;

/// Growth of numbers in the elimination of an edge that leaves ten digits; beyond it other solvers answer.
const LARGEST_GROWTH: f64 = 1e-10 / f64::EPSILON;

/// What is left of a coordinate once it is eliminated.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Pivot {
    /// Row of the factor of its edge's Bᵀ K B.
    factor: [f64; 6],
    /// Of Bᵀ's right-hand side.
    force: f64,
}

impl Pivot {
    /// Those of an edge.
    pub(super) fn keep<const M: usize>(
        pivots: &mut [Self],
        factor: &[[f64; M]; M],
        force: &[f64; M],
    ) {
        for (pivot, (row, force)) in pivots.iter_mut().zip(factor.iter().zip(force)) {
            pivot.factor[..M].copy_from_slice(row);
            pivot.force = *force;
        }
    }

    /// Solution where the base moves by `motion`.
    #[inline(always)]
    fn rates<const M: usize, const W: usize>(
        pivots: &[Self],
        felt: &[[f64; W]],
        motion: &[f64; W],
    ) -> [f64; M] {
        let pivots: &[Self; M] = pivots.first_chunk().expect("M coordinates");
        let factor = pivots.map(|pivot| *pivot.factor.first_chunk().expect("six at most"));
        let mut rate = std::array::from_fn(|i| pivots[i].force - dot(&felt[i], motion));
        substitute(&factor, M, &mut rate);
        rate
    }
}

/// Whether a pivot summed from terms of that size, the inverse of its root given, is round-off: of a light body between two
/// hinges of one axis.
pub(super) fn is_lost(inverse: f64, size: f64) -> bool {
    size * inverse * inverse > LARGEST_GROWTH
}

/// Articulated inertia of a body K and its wrench, less what its edge takes of them once that is eliminated, about the point
/// that the edge turns about: about the root's place, what is far out would be a small difference of what is long.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<I, const W: usize> {
    pub(super) inertia: I,
    wrench: [f64; W],
    /// Sizes of what the diagonal of the inertia is summed from.
    size: [f64; W],
}

impl<I: Inertia<W>, const W: usize> Articulated<I, W> {
    pub(super) fn zero() -> Self {
        Self { inertia: I::default(), wrench: [0.0; W], size: [0.0; W] }
    }

    /// By the number of an edge's coordinates: loops of known lengths are worth it.
    const ELIMINATE: [fn(&mut Self, &mut [Pivot], &[[f64; W]], u8, &mut [[f64; W]], bool) -> bool;
        7] = [
        Self::eliminate::<0>,
        Self::eliminate::<1>,
        Self::eliminate::<2>,
        Self::eliminate::<3>,
        Self::eliminate::<4>,
        Self::eliminate::<5>,
        Self::eliminate::<6>,
    ];
    const RESPOND: [fn(&[Pivot], &[[f64; W]], &[[f64; W]], &mut [f64; W], &mut [f64]); 7] = [
        Self::respond::<0>,
        Self::respond::<1>,
        Self::respond::<2>,
        Self::respond::<3>,
        Self::respond::<4>,
        Self::respond::<5>,
        Self::respond::<6>,
    ];

    /// U = K B into `felt` and, where the body hangs on another one, K ← K − U (BᵀU)⁻¹Uᵀ and the wrench with what the edge's
    /// own forces make of it; `false` where too few digits are left. What is driven moves as it is told: it is not eliminated,
    /// and feels nothing.
    fn eliminate<const M: usize>(
        &mut self,
        pivots: &mut [Pivot],
        columns: &[[f64; W]],
        driven: u8,
        felt: &mut [[f64; W]],
        hangs: bool,
    ) -> bool {
        let columns: &[[f64; W]; M] = columns.first_chunk().expect("M coordinates");
        let felt: &mut [[f64; W]; M] = felt.first_chunk_mut().expect("M coordinates");
        let Self { inertia, wrench, size } = self;
        let (mut l, mut force) = ([[0.0; M]; M], [0.0; M]);
        for i in 0..M {
            felt[i] = inertia.times(&columns[i]);
            force[i] = -dot(&columns[i], wrench);
            for j in 0..=i {
                l[i][j] = dot(&columns[i], &felt[j]);
            }
        }
        let is_driven = |i: usize| driven >> i & 1 == 1;
        for i in (0..M).filter(|&i| is_driven(i)) {
            felt[i] = [0.0; W];
            force[i] = 0.0;
            for j in 0..M {
                l[i.max(j)][i.min(j)] = f64::from(u8::from(i == j));
            }
        }
        let served = factor(&mut l, M);
        Pivot::keep(pivots, &l, &force);
        let lost = columns.iter().enumerate().any(|(i, column)| {
            if is_driven(i) {
                return false;
            }
            let terms = column.iter().zip(&*size).map(|(x, size)| x * x * size);
            is_lost(l[i][i], terms.sum())
        });
        if !served || lost || !hangs {
            return served && !lost;
        }
        *size = inertia.diagonal();
        let (mut halves, mut rate) = (*felt, [0.0; M]);
        for i in 0..M {
            rate[i] = force[i];
            for j in 0..i {
                let half = halves[j];
                add(&mut halves[i], -l[i][j], &half);
                rate[i] -= l[i][j] * rate[j];
            }
            let inverse = l[i][i];
            halves[i] = halves[i].map(|x| x * inverse);
            rate[i] *= inverse;
            inertia.subtract_square(&halves[i]);
            for w in 0..W {
                size[w] += halves[i][w] * halves[i][w];
                wrench[w] += rate[i] * halves[i][w];
            }
        }
        true
    }

    /// Adds accelerations of the edge's coordinates where its base moves by `motion`, which becomes that of the body.
    fn respond<const M: usize>(
        pivots: &[Pivot],
        columns: &[[f64; W]],
        felt: &[[f64; W]],
        motion: &mut [f64; W],
        rates: &mut [f64],
    ) {
        let rate: [f64; M] = Pivot::rates(pivots, felt, motion);
        for (i, column) in columns[..M].iter().enumerate() {
            rates[i] += rate[i];
            add(motion, rate[i], column);
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Accelerations of a tree, those of its drivers left out; the rates of twists are those of drivers alone. Source: Featherstone,
    /// *Rigid Body Dynamics Algorithms* (2008), section 9.2, hybrid dynamics.
    pub(super) fn articulate(&mut self, q: &[f64], v: &[f64]) -> bool {
        for (b, BodyInertia { mass, turned, .. }) in self.inertias.iter().enumerate() {
            let (center, wrench) = (&self.center[b], self.inertia_force(b, q, v));
            let wrench = std::array::from_fn(|i| wrench[i] - self.applied[b][i]);
            let own = &mut self.articulated[b];
            own.wrench = A::moved(&wrench, &self.origin[b], center);
            let arm = difference(&A::center(pose(q, b)), center);
            own.inertia = A::Inertia::of_body(*mass, turned, &arm);
            own.size = own.inertia.diagonal();
        }
        for edge in self.edges.iter().rev() {
            let b = edge.body;
            let own = &mut self.articulated[b];
            let columns = &self.own_columns[edge.range.clone()];
            let felt = &mut self.felt[edge.range.clone()];
            let pivots = &mut self.pivots[edge.range.clone()];
            let served = if edge.turns_freely() {
                let Articulated { inertia, wrench, size } = own;
                inertia.release(pivots, size, felt, wrench)
            } else {
                let (driven, hangs) = (edge.driven, edge.base.is_some());
                Articulated::ELIMINATE[edge.range.len()](own, pivots, columns, driven, felt, hangs)
            };
            if !served {
                return false;
            }
            let Some(base) = edge.base else { continue };
            let (from, to) = (&self.center[b], &self.center[base]);
            let inertia = own.inertia.moved(&difference(from, to));
            let wrench = A::moved(&own.wrench, from, to);
            let size = A::moved_sizes(&own.size, from, to);
            let carrier = &mut self.articulated[base];
            carrier.inertia.add(&inertia);
            add(&mut carrier.wrench, 1.0, &wrench);
            add(&mut carrier.size, 1.0, &size);
        }
        for edge in &*self.edges {
            let b = edge.body;
            let mut motion = edge.base.map_or([0.0; W], |base| {
                A::moved_twist(&self.motion[base], &self.center[base], &self.center[b])
            });
            let columns = &self.own_columns[edge.range.clone()];
            let felt = &self.felt[edge.range.clone()];
            let rates = &mut self.accelerations[edge.range.clone()];
            let pivots = &self.pivots[edge.range.clone()];
            if edge.turns_freely() {
                let angular = Pivot::rates(pivots, felt, &motion);
                A::Inertia::turn(&mut motion, angular, columns, rates);
            } else {
                let respond = Articulated::<A::Inertia, W>::RESPOND[edge.range.len()];
                respond(pivots, columns, felt, &mut motion, rates);
            }
            self.motion[b] = motion;
        }
        true
    }
}
