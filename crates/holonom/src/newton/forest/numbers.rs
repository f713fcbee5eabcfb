//! Coefficients of a step and the factors of a tree's matrix for them, real or complex.

use super::plan::{NONE, Plan};
use super::{Column, GRAIN, Motion};
use crate::newton::sparse_pattern::Sum;
use crate::threads::Threads;
use holonom_linalg::small::{
    Square, add_product, add_times_real, add_transposed_product, add_transposed_times, factor,
    scaled, solve, transposed,
};
use holonom_linalg::{BlockMatrix, Scalar, SingularMatrix};
use std::ops::Range;

/// Coefficients of a step, and the factors for them; bodies by their positions in the tree.
#[derive(Debug, Clone)]
pub(super) struct Numbers<T, const N: usize> {
    pub(super) step: Step<T>,
    /// Of each body Ψ, factored, and BᵀHe of its e₁ and e₂, see [`Free`].
    small: Vec<T>,
    /// Row exchanges of Ψ.
    pub(super) exchanges: Vec<u8>,
    pub(super) free: Vec<Free<T, N>>,
    /// What the parts of the plan add to their parents.
    additions: Vec<Addition<T, N>>,
    /// Bodies of which some children are eliminated, of each part and of the rest; grows in the first elimination only.
    open: Vec<Vec<Open<T, N>>>,
    /// w of bodies on which others hang.
    pub(super) w: Vec<[[T; N]; 3]>,
}

/// γh and βh².
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<T> {
    pub(super) gamma_h: T,
    pub(super) beta_h2: T,
}

/// Of an independent variable its row of Z = Ψ⁻¹BᵀA, its column of V, and with e₁ = βh² (b, α, ν) and
/// e₂ = γh (0, b, 2α), its first two parts of ℬ, the force (TᵀH + U) e that they make at the parent.
#[derive(Debug, Clone)]
pub(super) struct Free<T, const N: usize> {
    pub(super) z: [[T; N]; 3],
    pub(super) v: [T; N],
    pub(super) given: [[T; N]; 2],
}

/// A body with what its children add: H, and the sizes of what these add to the diagonal of Ψ before anything is taken
/// from it.
#[derive(Debug, Clone)]
struct Open<T, const N: usize> {
    at: usize,
    all: Addition<T, N>,
}

/// What a body adds to H of its parent, and to the sizes of its parent's independent variables.
#[derive(Debug, Clone)]
struct Addition<T, const N: usize> {
    h: [Square<T, N>; 3],
    sizes: [f64; N],
}

impl<T: Scalar, const N: usize> Addition<T, N> {
    const ZERO: Self = Self { h: [[[T::ZERO; N]; N]; 3], sizes: [0.0; N] };

    fn take(&mut self, other: &Self) {
        self.h.iter_mut().zip(&other.h).for_each(|(h, other)| add(h, other));
        self.sizes.iter_mut().zip(other.sizes).for_each(|(size, other)| *size += other);
    }
}

/// Growth of numbers and the position it was at.
type Growth = (f64, usize);

fn larger(one: Growth, other: Growth) -> Growth {
    if other.0 > one.0 { other } else { one }
}

/// The block of `matrix` with this first value; zero where there is none.
#[inline(always)]
fn block<T: Scalar, const N: usize>(matrix: &BlockMatrix, at: usize) -> Square<T, N> {
    if at == NONE {
        return [[T::ZERO; N]; N];
    }
    let values = &matrix.values()[at..at + N * N];
    std::array::from_fn(|i| std::array::from_fn(|j| T::from(values[i * N + j])))
}

#[inline(always)]
fn add<T: Scalar, const N: usize>(out: &mut Square<T, N>, a: &Square<T, N>) {
    for i in 0..N {
        for j in 0..N {
            out[i][j] = out[i][j] + a[i][j];
        }
    }
}

impl<T: Scalar> Step<T> {
    /// A column of ℬ.
    #[inline(always)]
    fn column_of<const N: usize>(&self, column: &Column<N>) -> [[T; N]; 3] {
        let mut out = [[T::ZERO; N]; 3];
        column.add_motion(&mut out, [self.beta_h2, self.gamma_h, T::from(1.0)]);
        out
    }
}

/// Everything that an elimination reads.
struct Given<'a, T, const N: usize> {
    plan: &'a Plan,
    threads: &'a Threads,
    motions: &'a [Motion<N>],
    columns: &'a [Column<N>],
    step: Step<T>,
    sum: &'a Sum<'a, T>,
}

/// The factors of consecutive bodies.
struct Factors<'a, T, const N: usize> {
    first: usize,
    small: &'a mut [T],
    exchanges: &'a mut [u8],
    free: &'a mut [Free<T, N>],
}

/// Numbers of a body in [`Numbers::small`], in squares of the order of its independent variables.
const SMALL: usize = 3;

impl<T: Scalar, const N: usize> Factors<'_, T, N> {
    /// Those before a position, and those from it on.
    fn split_at(&mut self, plan: &Plan, at: usize) -> [Factors<'_, T, N>; 2] {
        let tree = &plan.tree;
        let middle = tree.pivots_before(at) - tree.pivots_before(self.first);
        let (small, later_small) = self.small.split_at_mut(SMALL * middle);
        let middle = tree.free_before(at) - tree.free_before(self.first);
        let (exchanges, later_exchanges) = self.exchanges.split_at_mut(middle);
        let (free, later_free) = self.free.split_at_mut(middle);
        [
            Factors { first: self.first, small, exchanges, free },
            Factors { first: at, small: later_small, exchanges: later_exchanges, free: later_free },
        ]
    }
}

impl<T: Scalar, const N: usize> Given<'_, T, N> {
    /// Eliminates parts of the tree; what each adds to the parent of its first bodies is left in `additions`.
    fn parts(
        &self,
        parts: &[Range<usize>],
        mut factors: Factors<'_, T, N>,
        additions: &mut [Addition<T, N>],
        open: &mut [Vec<Open<T, N>>],
    ) -> Result<Growth, SingularMatrix> {
        let bodies = parts.last().map_or(0, |last| last.end) - parts.first().map_or(0, |p| p.start);
        if parts.len() > 1 && bodies > GRAIN {
            let half = parts.len() / 2;
            let (left, right) = parts.split_at(half);
            let (left_additions, right_additions) = additions.split_at_mut(half);
            let (left_open, right_open) = open.split_at_mut(half);
            let [first, second] = factors.split_at(self.plan, right[0].start);
            let (one, other) = self.threads.join(
                || self.parts(left, first, left_additions, left_open),
                || self.parts(right, second, right_additions, right_open),
            );
            return Ok(larger(other?, one?));
        }
        let mut growth = (0.0, 0);
        let mut addition = Addition::ZERO;
        for ((part, outwards), open) in parts.iter().zip(additions).zip(open).rev() {
            *outwards = Addition::ZERO;
            open.clear();
            for at in part.clone().rev() {
                growth = larger(growth, self.eliminate(&mut factors, open, at, &mut addition)?);
                match self.plan.tree.parent(at) {
                    Some(parent) if parent >= part.start => self.add(open, parent, &addition),
                    Some(_) => outwards.take(&addition),
                    None => {}
                }
            }
        }
        Ok(growth)
    }

    /// Eliminates children before parents, parts that are eliminated already left out.
    fn rest(
        &self,
        parts: &[Range<usize>],
        factors: &mut Factors<'_, T, N>,
        additions: &[Addition<T, N>],
        open: &mut Vec<Open<T, N>>,
    ) -> Result<Growth, SingularMatrix> {
        let (mut growth, mut addition) = ((0.0, 0), Addition::ZERO);
        let mut end = self.plan.tree.len();
        let none = (0..0, &Addition::ZERO);
        let parts = parts.iter().cloned().zip(additions).rev();
        open.clear();
        for (part, made) in parts.chain([none]) {
            for at in (part.end..end).rev() {
                growth = larger(growth, self.eliminate(factors, open, at, &mut addition)?);
                if let Some(parent) = self.plan.tree.parent(at) {
                    self.add(open, parent, &addition);
                }
            }
            end = part.start;
            if end > 0
                && let Some(parent) = self.plan.tree.parent(end)
            {
                self.add(open, parent, made);
            }
        }
        Ok(growth)
    }

    /// Gives to a body what one that hangs on it adds. A walk against the order of the tree closes a body before it goes on to one
    /// that was opened before.
    fn add(&self, open: &mut Vec<Open<T, N>>, parent: usize, addition: &Addition<T, N>) {
        if open.last().is_none_or(|last| last.at != parent) {
            open.push(Open { at: parent, all: self.alone(parent) });
        }
        if let Some(last) = open.last_mut() {
            last.all.take(addition);
        }
    }

    /// H of a body alone.
    fn alone(&self, at: usize) -> Addition<T, N> {
        let (plan, sum) = (self.plan, self.sum);
        let (from, b) = (plan.blocks[at][0], &sum.blocks.blocks);
        let mut h =
            [block(&b.stiffness, from), block(&b.damping, from), plan.tree.mass(at, sum.mass)];
        for extra in plan.extra.at(at) {
            let side = usize::from(extra.side);
            self.add_extra_state(&mut h, extra.state as usize, side, side);
        }
        Addition { h, sizes: [0.0; N] }
    }

    /// K and C between the body at a position and its parent: (b, p) or (p, b).
    #[inline(always)]
    fn coupling(&self, at: usize, upper: bool) -> Option<[Square<T, N>; 2]> {
        let extra = self.plan.extra.at(at);
        let from = self.plan.blocks[at][if upper { 2 } else { 1 }];
        if from == NONE && extra.is_empty() {
            return None;
        }
        let b = &self.sum.blocks.blocks;
        let mut out = [block(&b.stiffness, from), block(&b.damping, from)];
        for extra in extra.iter().filter(|extra| extra.coupled) {
            let own = usize::from(extra.side);
            let (row, column) = if upper { (1 - own, own) } else { (own, 1 - own) };
            self.add_extra_state(&mut out, extra.state as usize, row, column);
        }
        Some(out)
    }

    /// Adds γh F_z E⁻¹ g_q and γh F_z E⁻¹ g_q̇ of a state, in the coordinates of these two of its bodies.
    fn add_extra_state(&self, to: &mut [Square<T, N>], state: usize, row: usize, column: usize) {
        let b = &self.sum.blocks.blocks;
        let (first, extra) = (2 * state * N, self.sum.extra);
        let forces = &b.force_extra[first + row * N..][..N];
        for (to, rates) in to.iter_mut().zip([&extra.by_position, &extra.by_velocity]) {
            let rates = &rates[first + column * N..][..N];
            for (to, force) in to.iter_mut().zip(forces) {
                let force = self.sum.gamma_h.scaled(*force);
                to.iter_mut().zip(rates).for_each(|(to, rate)| *to = *to + force * *rate);
            }
        }
    }

    /// Eliminates the body at a position, whose children are; what it adds to its parent replaces `addition`.
    fn eliminate(
        &self,
        factors: &mut Factors<'_, T, N>,
        open: &mut Vec<Open<T, N>>,
        at: usize,
        addition: &mut Addition<T, N>,
    ) -> Result<Growth, SingularMatrix> {
        let tree = &self.plan.tree;
        let step = &self.step;
        let Motion { t, alpha, nu } = &self.motions[at];
        let [t, turned, bent] = [t, alpha, nu].map(transposed);
        let range = tree.free(at);
        let k = range.len();
        let columns = &self.columns[range.clone()];
        let before = tree.free_before(factors.first);
        let local = range.start - before..range.end - before;
        let (free, exchanges) = (&mut factors.free[local.clone()], &mut factors.exchanges[local]);
        let small = SMALL * (tree.pivots_before(at) - tree.pivots_before(factors.first));
        let small = &mut factors.small[small..small + SMALL * k * k];
        let (psi, felt) = small.split_at_mut(k * k);
        let own = match open.pop_if(|last| last.at == at) {
            Some(open) => open.all,
            None => self.alone(at),
        };
        let h = &own.h;
        let twice_mass = scaled(T::from(2.0), &h[2]);
        let has_parent = tree.parent(at).is_some();
        let between = |upper| has_parent.then(|| self.coupling(at, upper)).flatten();
        // A = H 𝒯 + L
        let mut a = [[[T::ZERO; N]; N]; 3];
        if has_parent {
            for level in 0..3 {
                add_product(&mut a[level], &h[level], &t);
            }
            add_product(&mut a[0], &h[1], &turned);
            add_product(&mut a[0], &h[2], &bent);
            add_product(&mut a[1], &twice_mass, &turned);
            if let Some(lower) = between(false) {
                a.iter_mut().zip(&lower).for_each(|(a, lower)| add(a, lower));
            }
        }
        let upper = between(true);
        // ℬ = e₁ + e₂ + e₃ makes Ψ = BᵀHℬ and V = Uℬ + TᵀHℬ; Z before the solution.
        let scales = [step.beta_h2, step.gamma_h];
        let mut sizes = [0.0f64; N];
        for (c, column) in columns.iter().enumerate() {
            let Column { b, alpha, nu } = column;
            let mut forces = [[T::ZERO; N]; 3];
            add_times_real(&mut forces[0], &h[0], b);
            add_times_real(&mut forces[0], &h[1], alpha);
            add_times_real(&mut forces[0], &h[2], nu);
            add_times_real(&mut forces[1], &h[1], b);
            add_times_real(&mut forces[1], &twice_mass, alpha);
            add_times_real(&mut forces[2], &h[2], b);
            let at_variables = |force: &[T; N], row: &Column<N>| {
                (0..N).fold(T::ZERO, |s, i| s + force[i].scaled(row.b[i]))
            };
            for (r, row) in columns.iter().enumerate() {
                let [p, v] = [0, 1].map(|level| scales[level] * at_variables(&forces[level], row));
                psi[r * k + c] = p + v + at_variables(&forces[2], row);
                (felt[r * k + c], felt[(k + r) * k + c]) = (p, v);
            }
            let mut size = [0.0f64; N];
            for (h, x) in h.iter().zip(&step.column_of(column)) {
                for i in 0..N {
                    size[i] = (0..N).fold(size[i], |s, j| s + h[i][j].size() * x[j].size());
                }
            }
            sizes[c] = (0..N).fold(own.sizes[c], |s, i| s + size[i] * b[i].abs());
            let free = &mut free[c];
            for (z, a) in free.z.iter_mut().zip(&a) {
                *z = [T::ZERO; N];
                for i in 0..N {
                    for j in 0..N {
                        z[j] = z[j] + a[i][j].scaled(b[i]);
                    }
                }
            }
            let mut felt = [[T::ZERO; N]; 3];
            for (out, force) in felt.iter_mut().zip(&forces) {
                add_transposed_times(out, &t, force);
            }
            if let Some([stiff, damped]) = &upper {
                add_times_real(&mut felt[0], stiff, b);
                add_times_real(&mut felt[0], damped, alpha);
                add_times_real(&mut felt[1], damped, b);
            }
            free.given = [0, 1].map(|level| felt[level].map(|x| scales[level] * x));
            let [p, v] = &free.given;
            free.v = std::array::from_fn(|i| p[i] + v[i] + felt[2][i]);
        }
        let growth = factor(psi, exchanges, k, &sizes).map_err(|c| SingularMatrix {
            row: tree.rows(at)[N - k + c] as usize,
            column: tree.body(at) * N,
            pivot: 0.0,
        })?;
        for level in 0..3 {
            for j in 0..N {
                let mut z = (&mut *free, level, j);
                solve(psi, exchanges, k, &mut z, |(free, level, j), c| &mut free[c].z[*level][*j]);
            }
        }
        // What it adds to its parent: U 𝒯 + TᵀA − V Z.
        let Some(parent) = tree.parent(at) else { return Ok((growth, at)) };
        *addition = Addition::ZERO;
        for level in 0..3 {
            add_transposed_product(&mut addition.h[level], &t, &a[level]);
        }
        for (to, above) in addition.sizes.iter_mut().zip(&self.columns[tree.free(parent)]) {
            for (h, x) in addition.h.iter().zip(&step.column_of(above)) {
                for i in 0..N {
                    let row = (0..N).fold(0.0, |s, j| s + h[i][j].size() * x[j].size());
                    *to += row * above.b[i].abs();
                }
            }
        }
        for free in &*free {
            for (h, z) in addition.h.iter_mut().zip(&free.z) {
                for i in 0..N {
                    for j in 0..N {
                        h[i][j] = h[i][j] - free.v[i] * z[j];
                    }
                }
            }
        }
        if let Some([stiff, damped]) = &upper {
            add_product(&mut addition.h[0], stiff, &t);
            add_product(&mut addition.h[0], damped, &turned);
            add_product(&mut addition.h[1], damped, &t);
        }
        Ok((growth, at))
    }
}

impl<T: Scalar, const N: usize> Numbers<T, N> {
    pub(super) fn new(plan: &Plan) -> Self {
        let (count, free) = (plan.tree.len(), plan.tree.free_before(plan.tree.len()));
        let zero = [T::ZERO; N];
        let unknown = Free { z: [zero; 3], v: zero, given: [zero; 2] };
        let places = plan.places.iter().max().map_or(0, |last| *last as usize + 1);
        Self {
            step: Step { gamma_h: T::ZERO, beta_h2: T::ZERO },
            small: vec![T::ZERO; SMALL * plan.tree.pivots_before(count)],
            exchanges: vec![0; free],
            free: vec![unknown; free],
            additions: vec![Addition::ZERO; plan.parts.len()],
            open: vec![Vec::new(); plan.parts.len() + 1],
            w: vec![[zero; 3]; places],
        }
    }

    /// Ψ of a body, and BᵀH times its e₁ and e₂.
    pub(super) fn small(&self, plan: &Plan, at: usize) -> (&[T], [&[T]; 2]) {
        let [from, to] = [at, at + 1].map(|at| plan.tree.pivots_before(at));
        let size = to - from;
        let [psi, p, v] = [0, 1, 2].map(|k| &self.small[SMALL * from + k * size..][..size]);
        (psi, [p, v])
    }

    /// Eliminates children before parents; returns the largest growth of numbers and the position it was at.
    pub(super) fn factor(
        &mut self,
        plan: &Plan,
        threads: &Threads,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        sum: &Sum<'_, T>,
    ) -> Result<Growth, SingularMatrix> {
        let step = Step { gamma_h: sum.gamma_h, beta_h2: sum.beta_h2 };
        self.step = step;
        let Self { small, exchanges, free, additions, open, .. } = self;
        let given = Given { plan, threads, motions, columns, step, sum };
        let mut factors = Factors { first: 0, small, exchanges, free };
        let [all, _] = factors.split_at(plan, plan.tree.len());
        let (rest, parts) = open.split_last_mut().expect("one for the rest");
        let growth = given.parts(&plan.parts, all, additions, parts)?;
        Ok(larger(growth, given.rest(&plan.parts, &mut factors, additions, rest)?))
    }
}
