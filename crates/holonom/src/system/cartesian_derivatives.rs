//! Derivatives of the equations, part by part.

use super::cartesian::Cartesian;
use super::passage::Passage;
use super::placed::{Elements, Part, PlacedForce};
use super::space::Space;
use super::{DerivativeBlocks, State};
use crate::elements::{
    ConstraintElement, ForceBlocks, ForceElement, ForceInput, PairBlocks, RowBlocks,
};
use crate::threads::Threads;
use holonom_linalg::{Arithmetic, BlockId, BlocksMut, Wide, run_wide};
use std::marker::PhantomData;

/// The blocks of consecutive parts.
struct Target<'a> {
    stiffness: BlocksMut<'a>,
    damping: BlocksMut<'a>,
    a0: BlocksMut<'a>,
    a1: BlocksMut<'a>,
    /// Place in the walk of the first body, and F_t in the order of the walk.
    first: usize,
    time: &'a mut [f64],
}

impl Target<'_> {
    /// What belongs to a part and those before it, and the others.
    fn split_after(&mut self, part: &Part, per_body: usize) -> [Target<'_>; 2] {
        let [body, of_k, of_g] = part.end;
        let [stiffness, later_stiffness] = self.stiffness.split_at(of_k);
        let [damping, later_damping] = self.damping.split_at(of_k);
        let [a0, later_a0] = self.a0.split_at(of_g);
        let [a1, later_a1] = self.a1.split_at(of_g);
        let (time, later_time) = self.time.split_at_mut((body - self.first) * per_body);
        [
            Target { stiffness, damping, a0, a1, first: self.first, time },
            Target {
                stiffness: later_stiffness,
                damping: later_damping,
                a0: later_a0,
                a1: later_a1,
                first: body,
                time: later_time,
            },
        ]
    }
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Cartesian<S, D, N, W> {
    /// All derivative blocks; the same sums in the same order for any number of threads.
    pub(super) fn add_up(&self, state: &State, out: &mut DerivativeBlocks) {
        for f in self.forces.iter().filter(|f| f.extra.count > 0) {
            Self::set_extra_rows(f, state, out);
        }
        let mut target = Target {
            stiffness: out.stiffness.blocks_mut(),
            damping: out.damping.blocks_mut(),
            a0: out.a0.blocks_mut(),
            a1: out.a1.blocks_mut(),
            first: 0,
            time: &mut out.time,
        };
        if let Some(last) = self.slots.parts.last() {
            let [all, _] = target.split_after(last, N);
            self.parts(&out.threads, &self.slots.parts, state, all);
        }
        self.elements(&self.slots.rest, state, &mut target);
        out.velocity_rhs_time.fill(0.0);
        out.acceleration_rhs_time.fill(0.0);
        for c in &self.constraints {
            if let Some(s) = c.element.drive(state.t) {
                out.velocity_rhs_time[c.row] = s[2];
                out.acceleration_rhs_time[c.row] = s[3];
            }
        }
        for (body, time) in self.slots.walk.iter().zip(out.time.chunks_exact(N)) {
            out.force_time[*body as usize * N..][..N].copy_from_slice(time);
        }
    }

    fn parts(&self, threads: &Threads, parts: &[Part], state: &State, mut target: Target<'_>) {
        if parts.len() > 1 {
            let (left, right) = parts.split_at(parts.len() / 2);
            let [first, second] = target.split_after(&left[left.len() - 1], N);
            threads.join(
                || self.parts(threads, left, state, first),
                || self.parts(threads, right, state, second),
            );
            return;
        }
        let slots = &self.slots;
        for blocks in [&mut target.stiffness, &mut target.damping] {
            blocks.clear();
        }
        target.time.fill(0.0);
        let bodies = target.first..target.first + target.time.len() / N;
        for &b in &slots.walk[bodies] {
            let b = b as usize;
            let (v, a) = (Self::rate(&state.v, Some(b)), Self::rate(&state.a, Some(b)));
            let (k, c) = (slots.diagonal[b], slots.diagonal[b]);
            let (k, c) = (target.stiffness.block_mut(k), target.damping.block_mut(c));
            let (inertia, q) = (&self.bodies[b].inertia, Self::pose(&state.q, Some(b)));
            let space = PhantomData::<S>;
            run_wide(OfInertia::<S, D, N, W> { space, inertia, at: [q, v, a], k, c });
            let Some(id) = slots.normalization.get(b) else { continue };
            let l = 2.0 * state.lambda[self.structure.normalization_start + b];
            let (a0, a1) = (target.a0.block_mut(*id), target.a1.block_mut(*id));
            for i in D..N {
                a0[i - D] = 2.0 * v[i];
                a1[i - D] = 2.0 * a[i];
                k[i * N + i] += l;
            }
        }
        for part in parts {
            self.elements(&part.elements, state, &mut target);
        }
    }

    /// F_z, g_q, g_q̇, g_z and g_t of the extra states of a force.
    fn set_extra_rows(force: &PlacedForce<S::Force>, state: &State, out: &mut DerivativeBlocks) {
        let input = Self::input(force, state);
        force.element.extra_rows(&input, &mut out.extra_rows(force.extra));
        let passages = Self::passages(state, force.bodies);
        for k in force.extra.states() {
            for (side, own) in passages.iter().enumerate() {
                let [force, by_x, by_y] = out.extra_motion.each_ref().map(|rows| {
                    rows[(2 * k + side) * W..].first_chunk().expect("W numbers on each side")
                });
                let at = (2 * k + side) * N..(2 * k + side + 1) * N;
                out.force_extra[at.clone()].copy_from_slice(&own.force(force));
                out.extra_position[at.clone()].copy_from_slice(&own.position_row(by_x, by_y));
                out.extra_velocity[at].copy_from_slice(&own.force(by_y));
            }
        }
    }

    /// Adds constraints, then forces.
    fn elements(&self, elements: &Elements, state: &State, target: &mut Target<'_>) {
        let (mut blocks, mut others) = (ForceBlocks::zero(), ForceBlocks::zero());
        let mut rows = [RowBlocks::zero(); 2];
        let mut pairs = PairBlocks::zero();
        for &k in &elements.constraints {
            let k = k as usize;
            let c = &self.constraints[k];
            let q = Self::pair(&state.q, c.bodies);
            let (v, a) = (Self::rates(&state.v, c.bodies), Self::rates(&state.a, c.bodies));
            let (count, slots) = (c.element.rows(), &self.slots.jacobian[k]);
            run_wide(OfConstraint::<_, D, N> {
                element: &c.element,
                at: [q, v, a],
                multipliers: &Self::multipliers(c, &state.lambda),
                rows: &mut rows,
                pairs: &mut pairs,
                slots: &self.slots.constraint_pairs[k],
                stiffness: &mut target.stiffness,
            });
            set_rows(&mut target.a0, slots, count, &rows[0]);
            set_rows(&mut target.a1, slots, count, &rows[1]);
        }
        let mut forces = elements.forces.iter().map(|&k| k as usize).peekable();
        while let Some(k) = forces.next() {
            let (f, slots) = (&self.forces[k], &self.slots.force_pairs[k]);
            let mut input = Self::input(f, state);
            let (element, out) = (&f.element, &mut blocks);
            run_wide(OfForce { element, input: &input, out, sum: None });
            // Those next to each other between the same bodies go on to the coordinates as one.
            let along = |k: &usize| self.forces[*k].bodies == f.bodies;
            while let Some(k) = forces.next_if(along) {
                Self::tell_own(&self.forces[k], state, &mut input);
                let element = &self.forces[k].element;
                let (out, sum) = (&mut others, Some(&mut blocks));
                run_wide(OfForce { element, input: &input, out, sum });
            }
            let passages = Self::passages(state, f.bodies);
            run_wide(OnCoordinates::<_, N, W> {
                blocks: &blocks,
                passages: &passages,
                slots,
                stiffness: &mut target.stiffness,
                damping: &mut target.damping,
            });
            for felt in 0..2 {
                let Some(b) = f.bodies[felt] else { continue };
                let at = (self.slots.position[b] as usize - target.first) * N;
                let time = passages[felt].force(&blocks.t[felt]);
                target.time[at..at + N].iter_mut().zip(&time).for_each(|(out, x)| *out += x);
            }
        }
    }
}

/// What a body's inertia adds to its own blocks.
struct OfInertia<'a, S, const D: usize, const N: usize, const W: usize> {
    space: PhantomData<S>,
    inertia: &'a [[f64; 3]; 3],
    /// q, q̇ and q̈.
    at: [&'a [f64; N]; 3],
    k: &'a mut [f64],
    c: &'a mut [f64],
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Wide
    for OfInertia<'_, S, D, N, W>
{
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let [q, v, a] = self.at;
        S::inertia_blocks(self.inertia, q, v, a, self.k, self.c);
    }
}

/// The blocks of a constraint: of its rows, and, added up, of its forces at these multipliers.
struct OfConstraint<'a, 'b, C, const D: usize, const N: usize> {
    element: &'a C,
    /// q, q̇ and q̈ of both bodies.
    at: [[&'a [f64; N]; 2]; 3],
    multipliers: &'a [f64; 6],
    rows: &'a mut [RowBlocks<f64, N>; 2],
    pairs: &'a mut PairBlocks<f64, N>,
    slots: &'a [[Option<BlockId>; 2]; 2],
    stiffness: &'a mut BlocksMut<'b>,
}

impl<C: ConstraintElement<N>, const D: usize, const N: usize> Wide
    for OfConstraint<'_, '_, C, D, N>
{
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let [q, v, a] = self.at;
        self.element.rate_blocks(q, v, a, self.rows);
        self.element.hessian(q, self.multipliers, self.pairs);
        add_pairs::<D, N>(self.stiffness, self.slots, self.pairs, self.element.couples());
    }
}

/// The blocks of a force on motions, and a sum to which they are added.
struct OfForce<'a, F, const D: usize, const N: usize, const W: usize> {
    element: &'a F,
    input: &'a ForceInput<'a, f64, D, N, W>,
    out: &'a mut ForceBlocks<f64, W>,
    sum: Option<&'a mut ForceBlocks<f64, W>>,
}

impl<F: ForceElement<D, N, W>, const D: usize, const N: usize, const W: usize> Wide
    for OfForce<'_, F, D, N, W>
{
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        self.element.blocks(self.input, self.out);
        if let Some(sum) = self.sum {
            sum.add(self.out);
        }
    }
}

/// These on coordinates, added up.
struct OnCoordinates<'a, 'b, P, const N: usize, const W: usize> {
    blocks: &'a ForceBlocks<f64, W>,
    passages: &'a [P; 2],
    slots: &'a [[Option<BlockId>; 2]; 2],
    stiffness: &'a mut BlocksMut<'b>,
    damping: &'a mut BlocksMut<'b>,
}

impl<P: Passage<N, W>, const N: usize, const W: usize> Wide for OnCoordinates<'_, '_, P, N, W> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { blocks, passages, slots, .. } = self;
        for felt in 0..2 {
            let own = &passages[felt];
            for (moved, other) in passages.iter().enumerate() {
                let Some(id) = slots[felt][moved] else { continue };
                let (k, c) = (&blocks.k.0[felt][moved], &blocks.c.0[felt][moved]);
                let c = blocks.damped.then_some(c);
                let stiffness = self.stiffness.block_mut(id);
                own.add_stiffness(other, k, c, stiffness);
                if felt == moved {
                    own.add_bend(&blocks.wrenches[felt], stiffness);
                }
                if let Some(c) = c {
                    own.add_damping(other, c, self.damping.block_mut(id));
                }
            }
        }
    }
}

/// Makes the rows of a constraint those of `source`.
pub(super) fn set_rows<const N: usize>(
    target: &mut BlocksMut<'_>,
    slots: &[Option<BlockId>; 2],
    rows: usize,
    source: &RowBlocks<f64, N>,
) {
    for side in 0..2 {
        let Some(id) = slots[side] else { continue };
        let block = target.block_mut(id);
        for (out, row) in block.chunks_exact_mut(N).zip(&source.0[side]).take(rows) {
            out.copy_from_slice(row);
        }
    }
}

/// Adds blocks; where the two bodies are not coupled, how each bends for itself, with its rotation alone.
#[inline(always)]
fn add_pairs<const D: usize, const N: usize>(
    target: &mut BlocksMut<'_>,
    slots: &[[Option<BlockId>; 2]; 2],
    source: &PairBlocks<f64, N>,
    coupled: bool,
) {
    for i in 0..2 {
        for j in 0..2 {
            let Some(id) = slots[i][j].filter(|_| coupled || i == j) else { continue };
            let (rows, _) = target.block_mut(id).as_chunks_mut::<N>();
            let rows = rows.iter_mut().zip(&source.0[i][j]);
            if coupled {
                for (out, row) in rows {
                    for k in 0..N {
                        out[k] += row[k];
                    }
                }
            } else {
                for (out, row) in rows.skip(D) {
                    for k in D..N {
                        out[k] += row[k];
                    }
                }
            }
        }
    }
}
