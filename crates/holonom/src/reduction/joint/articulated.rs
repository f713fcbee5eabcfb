//! Accelerations of a tree, from the leaves inwards and out again: articulated bodies.

use super::algebra::Algebra;
use super::engine::{BodyInertia, Edge, Engine, add, dot, pose};
use super::inertia::Inertia;
use super::small::{factor, substitute};
use super::subtrees::{Place, Subtrees};
use crate::math::vector::difference;
use crate::threads::Threads;
use std::ops::Range;

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
        let row = |i: usize| *pivots[i].factor.first_chunk().expect("six at most");
        let factor: [[f64; M]; M] = std::array::from_fn(row);
        let mut rate = [0.0; M];
        for ((rate, pivot), felt) in rate.iter_mut().zip(pivots).zip(felt) {
            *rate = pivot.force - dot(felt, motion);
        }
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
    /// What accelerations of coordinates add to that of the body; before it, what its base does where that is another thread's.
    motion: [f64; W],
}

impl<I: Inertia<W>, const W: usize> Articulated<I, W> {
    pub(super) fn zero() -> Self {
        Self { inertia: I::default(), wrench: [0.0; W], size: [0.0; W], motion: [0.0; W] }
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
        let Self { inertia, wrench, size, .. } = self;
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

/// What consecutive edges write, the first of them and its first coordinate.
struct Piece<'a, I, const W: usize> {
    first: usize,
    coordinate: usize,
    bodies: &'a mut [Articulated<I, W>],
    pivots: &'a mut [Pivot],
    felt: &'a mut [[f64; W]],
    rates: &'a mut [f64],
}

impl<I: Inertia<W>, const W: usize> Piece<'_, I, W> {
    /// What edges before a place write, and the others.
    fn split_at(self, edges: &[Edge], at: usize) -> [Self; 2] {
        let coordinate =
            edges.get(at).map_or(self.coordinate + self.pivots.len(), |edge| edge.range.start);
        let middle = coordinate - self.coordinate;
        let (bodies, later_bodies) = self.bodies.split_at_mut(at - self.first);
        let (pivots, later_pivots) = self.pivots.split_at_mut(middle);
        let (felt, later_felt) = self.felt.split_at_mut(middle);
        let (rates, later_rates) = self.rates.split_at_mut(middle);
        [
            Self { first: self.first, coordinate: self.coordinate, bodies, pivots, felt, rates },
            Self {
                first: at,
                coordinate,
                bodies: later_bodies,
                pivots: later_pivots,
                felt: later_felt,
                rates: later_rates,
            },
        ]
    }

    /// The same once more.
    fn again(&mut self) -> Piece<'_, I, W> {
        let Self { first, coordinate, bodies, pivots, felt, rates } = self;
        Piece { first: *first, coordinate: *coordinate, bodies, pivots, felt, rates }
    }

    /// Its edges.
    fn all(&self) -> Range<usize> {
        self.first..self.first + self.bodies.len()
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Accelerations of a tree, those of its drivers left out; the rates of twists are those of drivers alone. Source: Featherstone,
    /// *Rigid Body Dynamics Algorithms* (2008), section 9.2, hybrid dynamics.
    pub(super) fn articulate(&mut self, q: &[f64], v: &[f64]) -> bool {
        let mut bodies = std::mem::take(&mut self.articulated);
        let mut pivots = std::mem::take(&mut self.pivots);
        let mut felt = std::mem::take(&mut self.felt);
        let mut rates = std::mem::take(&mut self.accelerations);
        let piece = Piece {
            first: 0,
            coordinate: 0,
            bodies: &mut bodies,
            pivots: &mut pivots,
            felt: &mut felt,
            rates: &mut rates,
        };
        let served = match &self.subtrees {
            Some((threads, subtrees)) => {
                threads.share(|| self.articulate_shared(threads, subtrees, piece, [q, v]))
            }
            None => self.articulate_piece(piece, [q, v]),
        };
        (self.articulated, self.pivots, self.felt, self.accelerations) =
            (bodies, pivots, felt, rates);
        served
    }

    /// Whole trees.
    fn articulate_piece(&self, mut piece: Piece<'_, A::Inertia, W>, state: [&[f64]; 2]) -> bool {
        let served = self.go_inwards(&mut piece, state);
        if served {
            self.go_outwards(&mut piece);
        }
        served
    }

    /// Parts at the same time, what is near the roots by one thread: the same numbers as from one piece, as what a body is given
    /// comes in the same order.
    fn articulate_shared(
        &self,
        threads: &Threads,
        Subtrees { parts, rest }: &Subtrees,
        mut piece: Piece<'_, A::Inertia, W>,
        state: [&[f64]; 2],
    ) -> bool {
        if !self.each_part(threads, parts, piece.again(), &|own| self.go_inwards(own, state)) {
            return false;
        }
        for place in rest {
            if let Place::Of(at) = *place {
                self.set(&mut piece, at, state);
            }
        }
        for place in rest.iter().rev() {
            match *place {
                Place::Of(at) => {
                    if !self.eliminate(&mut piece, at) {
                        return false;
                    }
                    self.carry_inwards(&mut piece, at);
                }
                Place::Top(at) => self.carry_inwards(&mut piece, at),
            }
        }
        for place in rest {
            match *place {
                Place::Of(at) => self.respond(&mut piece, at),
                Place::Top(at) => {
                    if let Some(carrier) = self.edges[at].carrier {
                        piece.bodies[at].motion = piece.bodies[carrier].motion;
                    }
                }
            }
        }
        self.each_part(threads, parts, piece, &|own| {
            self.go_outwards(own);
            true
        })
    }

    /// Whether work on each part has served.
    fn each_part(
        &self,
        threads: &Threads,
        parts: &[Range<usize>],
        piece: Piece<'_, A::Inertia, W>,
        work: &(impl Fn(&mut Piece<'_, A::Inertia, W>) -> bool + Sync),
    ) -> bool {
        if let [part] = parts {
            let [before, _] = piece.split_at(&self.edges, part.end);
            let [_, mut own] = before.split_at(&self.edges, part.start);
            return work(&mut own);
        }
        let (left, right) = parts.split_at(parts.len() / 2);
        let [first, second] = piece.split_at(&self.edges, right[0].start);
        let (one, other) = threads.join(
            || self.each_part(threads, left, first, work),
            || self.each_part(threads, right, second, work),
        );
        one && other
    }

    /// From the leaves inwards; what the first bodies give to theirs is left to others. Whether enough digits are left.
    fn go_inwards(&self, piece: &mut Piece<'_, A::Inertia, W>, state: [&[f64]; 2]) -> bool {
        let all = piece.all();
        all.clone().for_each(|at| self.set(piece, at, state));
        for at in all.rev() {
            if !self.eliminate(piece, at) {
                return false;
            }
            if self.edges[at].carrier.is_some_and(|carrier| carrier >= piece.first) {
                self.carry_inwards(piece, at);
            }
        }
        true
    }

    /// From the first bodies outwards.
    fn go_outwards(&self, piece: &mut Piece<'_, A::Inertia, W>) {
        piece.all().for_each(|at| self.respond(piece, at));
    }

    /// Inertia and wrench of a body alone.
    #[inline(always)]
    fn set(&self, piece: &mut Piece<'_, A::Inertia, W>, at: usize, [q, v]: [&[f64]; 2]) {
        let b = self.edges[at].body;
        let BodyInertia { mass, turned, .. } = &self.inertias[b];
        let (center, wrench) = (&self.center[b], self.inertia_force_anew(b, q, v));
        let wrench = std::array::from_fn(|i| wrench[i] - self.applied[b][i]);
        let own = &mut piece.bodies[at - piece.first];
        own.wrench = A::moved(&wrench, &self.origin[b], center);
        let arm = difference(&A::center(pose(q, b)), center);
        own.inertia = A::Inertia::of_body(*mass, turned, &arm);
        own.size = own.inertia.diagonal();
    }

    /// Eliminates the coordinates of an edge.
    #[inline(always)]
    fn eliminate(&self, piece: &mut Piece<'_, A::Inertia, W>, at: usize) -> bool {
        let edge = &self.edges[at];
        let own = &mut piece.bodies[at - piece.first];
        let range = edge.range.start - piece.coordinate..edge.range.end - piece.coordinate;
        let (pivots, felt) = (&mut piece.pivots[range.clone()], &mut piece.felt[range]);
        if edge.turns_freely() {
            let Articulated { inertia, wrench, size, .. } = own;
            return inertia.release(pivots, size, felt, wrench);
        }
        let columns = &self.own_columns[edge.range.clone()];
        let (driven, hangs) = (edge.driven, edge.base.is_some());
        Articulated::ELIMINATE[edge.range.len()](own, pivots, columns, driven, felt, hangs)
    }

    /// Gives what is left of a body to its base.
    #[inline(always)]
    fn carry_inwards(&self, piece: &mut Piece<'_, A::Inertia, W>, at: usize) {
        let edge = &self.edges[at];
        let (Some(base), Some(carrier)) = (edge.base, edge.carrier) else { return };
        let (from, to) = (&self.center[edge.body], &self.center[base]);
        let own = &piece.bodies[at - piece.first];
        let arm = difference(from, to);
        let inertia = if edge.turns_freely() {
            own.inertia.released_moved(&arm)
        } else {
            own.inertia.moved(&arm)
        };
        let wrench = A::moved(&own.wrench, from, to);
        let size = A::moved_sizes(&own.size, from, to);
        let carrier = &mut piece.bodies[carrier - piece.first];
        carrier.inertia.add(&inertia);
        add(&mut carrier.wrench, 1.0, &wrench);
        add(&mut carrier.size, 1.0, &size);
    }

    /// Adds the accelerations of an edge for the motion of its base, which stands with the body itself where the base is not in the
    /// piece.
    #[inline(always)]
    fn respond(&self, piece: &mut Piece<'_, A::Inertia, W>, at: usize) {
        let edge = &self.edges[at];
        let mut motion = match (edge.base, edge.carrier) {
            (Some(base), Some(carrier)) => {
                let from = if carrier < piece.first { at } else { carrier };
                let motion = &piece.bodies[from - piece.first].motion;
                A::moved_twist(motion, &self.center[base], &self.center[edge.body])
            }
            _ => [0.0; W],
        };
        let range = edge.range.start - piece.coordinate..edge.range.end - piece.coordinate;
        let (pivots, felt) = (&piece.pivots[range.clone()], &piece.felt[range.clone()]);
        let (columns, rates) = (&self.own_columns[edge.range.clone()], &mut piece.rates[range]);
        if edge.turns_freely() {
            let angular = Pivot::rates(pivots, felt, &motion);
            A::Inertia::turn(&mut motion, angular, columns, rates);
        } else {
            let respond = Articulated::<A::Inertia, W>::RESPOND[edge.range.len()];
            respond(pivots, columns, felt, &mut motion, rates);
        }
        piece.bodies[at - piece.first].motion = motion;
    }
}
