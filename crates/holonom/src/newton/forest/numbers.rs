//! Coefficients of a step and the factors of a tree's matrix for them, real or complex.

use super::plan::{Extra, NONE, Plan};
use super::{Column, GRAIN, Motion};
use crate::newton::blocks::ReducedBlocks;
use crate::newton::sparse_pattern::Sum;
use crate::system::Structure;
use crate::threads::Threads;
use holonom_linalg::small::{
    Square, add_own_times, add_product, add_transposed_product, add_transposed_times, factor,
    scaled, solve,
};
use holonom_linalg::{BlockMatrix, Scalar, SingularMatrix};
use std::ops::Range;

/// Coefficients of a step, and the factors for them; bodies by their positions in the tree.
#[derive(Debug, Clone)]
pub(super) struct Numbers<T, const N: usize> {
    pub(super) step: Step<T>,
    pub(super) bodies: Vec<Body<T, N>>,
    /// Ψ of each body, factored, with its row exchanges.
    pub(super) psi: Vec<T>,
    pub(super) exchanges: Vec<u8>,
    pub(super) free: Vec<Free<T, N>>,
    /// Of each independent variable its column of ℬ.
    pub(super) columns: Vec<[[T; N]; 3]>,
    /// K (b, p), C (b, p), K (p, b), C (p, b), scaled, where extra states add to them; else none.
    pub(super) extra: Vec<[Square<T, N>; 4]>,
    /// What the parts of the plan add to their parents.
    additions: Vec<Addition<T, N>>,
    /// φ, w and r of a solution.
    pub(super) phi: Vec<[T; N]>,
    pub(super) w: Vec<[[T; N]; 3]>,
    pub(super) r: Vec<T>,
}

/// γh, βh² and their ratio βh²/γh.
#[derive(Debug, Clone, Copy)]
pub(super) struct Step<T> {
    pub(super) gamma_h: T,
    pub(super) beta_h2: T,
    pub(super) ratio: T,
}

/// H of the three levels.
#[derive(Debug, Clone)]
pub(super) struct Body<T, const N: usize> {
    pub(super) h: [Square<T, N>; 3],
}

/// Of an independent variable the size of what children add to its diagonal of Ψ before anything is taken from
/// it, its row of Z = Ψ⁻¹BᵀA, and its column of V.
#[derive(Debug, Clone)]
pub(super) struct Free<T, const N: usize> {
    size: f64,
    pub(super) z: [[T; N]; 3],
    pub(super) v: [T; N],
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

/// The block of `matrix` with this first value, times a number; zero where there is none.
#[inline(always)]
fn block<T: Scalar, const N: usize>(matrix: &BlockMatrix, at: usize, scale: T) -> Square<T, N> {
    if at == NONE {
        return [[T::ZERO; N]; N];
    }
    let values = &matrix.values()[at..at + N * N];
    std::array::from_fn(|i| std::array::from_fn(|j| scale.scaled(values[i * N + j])))
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
    /// βh²κ + 2γhη μ: what a does with x of the parent.
    #[inline(always)]
    pub(super) fn bend_of<const N: usize>(&self, motion: &Motion<N>) -> Square<T, N> {
        let twice = (self.gamma_h * self.ratio).scaled(2.0);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                self.beta_h2.scaled(motion.kappa[i][j]) + twice.scaled(motion.mu[i][j])
            })
        })
    }

    /// A column of ℬ.
    #[inline(always)]
    fn column_of<const N: usize>(&self, c: &Column<N>) -> [[T; N]; 3] {
        let twice = self.gamma_h.scaled(2.0);
        let both = twice * self.ratio;
        [
            std::array::from_fn(|i| T::from(c.b[i])),
            std::array::from_fn(|i| T::from(c.b[i]) + self.ratio.scaled(c.alpha[i])),
            std::array::from_fn(|i| {
                T::from(c.b[i])
                    + twice.scaled(c.alpha[i])
                    + self.beta_h2.scaled(c.kappa[i])
                    + both.scaled(c.mu[i])
            }),
        ]
    }
}

/// K and C between the body at a position and its parent, scaled: (b, p) or (p, b).
#[inline(always)]
pub(super) fn coupling<T: Scalar, const N: usize>(
    plan: &Plan,
    step: &Step<T>,
    extra: &[[Square<T, N>; 4]],
    at: usize,
    upper: bool,
    blocks: &ReducedBlocks,
) -> Option<[Square<T, N>; 2]> {
    let from = plan.blocks[at][if upper { 2 } else { 1 }];
    if from == NONE && extra.is_empty() {
        return None;
    }
    let mut out = [
        block(&blocks.blocks.stiffness, from, step.beta_h2),
        block(&blocks.blocks.damping, from, step.gamma_h),
    ];
    if let Some(extra) = extra.get(at) {
        for (out, extra) in out.iter_mut().zip(&extra[if upper { 2 } else { 0 }..]) {
            add(out, extra);
        }
    }
    Some(out)
}

/// H of bodies alone, from position `first` on, and their columns of ℬ.
fn begin<T: Scalar, const N: usize>(
    plan: &Plan,
    threads: &Threads,
    sum: &Sum<'_, T>,
    step: &Step<T>,
    made: &[Column<N>],
    first: usize,
    bodies: &mut [Body<T, N>],
    columns: &mut [[[T; N]; 3]],
) {
    let tree = &plan.tree;
    if bodies.len() > GRAIN && threads.are_several() {
        let half = bodies.len() / 2;
        let (left, right) = bodies.split_at_mut(half);
        let middle = tree.free_before(first + half) - tree.free_before(first);
        let (left_columns, right_columns) = columns.split_at_mut(middle);
        threads.join(
            || begin(plan, threads, sum, step, made, first, left, left_columns),
            || begin(plan, threads, sum, step, made, first + half, right, right_columns),
        );
        return;
    }
    for (column, made) in columns.iter_mut().zip(&made[tree.free_before(first)..]) {
        *column = step.column_of(made);
    }
    let b = &sum.blocks.blocks;
    for (at, body) in (first..).zip(bodies) {
        let from = plan.blocks[at][0];
        body.h = [
            block(&b.stiffness, from, sum.beta_h2),
            block(&b.damping, from, sum.gamma_h),
            tree.mass(at, sum.mass),
        ];
    }
}

/// Everything that an elimination reads.
struct Given<'a, T, const N: usize> {
    plan: &'a Plan,
    threads: &'a Threads,
    motions: &'a [Motion<N>],
    made: &'a [Column<N>],
    columns: &'a [[[T; N]; 3]],
    extra: &'a [[Square<T, N>; 4]],
    step: Step<T>,
    blocks: &'a ReducedBlocks,
}

/// The factors of consecutive bodies.
struct Factors<'a, T, const N: usize> {
    first: usize,
    bodies: &'a mut [Body<T, N>],
    psi: &'a mut [T],
    exchanges: &'a mut [u8],
    free: &'a mut [Free<T, N>],
}

impl<T: Scalar, const N: usize> Factors<'_, T, N> {
    /// Those before a position, and those from it on.
    fn split_at(&mut self, plan: &Plan, at: usize) -> [Factors<'_, T, N>; 2] {
        let tree = &plan.tree;
        let (bodies, later_bodies) = self.bodies.split_at_mut(at - self.first);
        let middle = tree.pivots_before(at) - tree.pivots_before(self.first);
        let (psi, later_psi) = self.psi.split_at_mut(middle);
        let middle = tree.free_before(at) - tree.free_before(self.first);
        let (exchanges, later_exchanges) = self.exchanges.split_at_mut(middle);
        let (free, later_free) = self.free.split_at_mut(middle);
        [
            Factors { first: self.first, bodies, psi, exchanges, free },
            Factors {
                first: at,
                bodies: later_bodies,
                psi: later_psi,
                exchanges: later_exchanges,
                free: later_free,
            },
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
    ) -> Result<Growth, SingularMatrix> {
        let bodies = parts.last().map_or(0, |last| last.end) - parts.first().map_or(0, |p| p.start);
        if parts.len() > 1 && bodies > GRAIN {
            let half = parts.len() / 2;
            let (left, right) = parts.split_at(half);
            let (left_additions, right_additions) = additions.split_at_mut(half);
            let [first, second] = factors.split_at(self.plan, right[0].start);
            let (one, other) = self.threads.join(
                || self.parts(left, first, left_additions),
                || self.parts(right, second, right_additions),
            );
            return Ok(larger(other?, one?));
        }
        let mut growth = (0.0, 0);
        let mut addition = Addition::ZERO;
        for (part, outwards) in parts.iter().zip(additions).rev() {
            *outwards = Addition::ZERO;
            for at in part.clone().rev() {
                growth = larger(growth, self.eliminate(&mut factors, at, &mut addition)?);
                match self.plan.tree.parent(at) {
                    Some(parent) if parent >= part.start => self.add(&mut factors, at, &addition),
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
    ) -> Result<Growth, SingularMatrix> {
        let (mut growth, mut addition) = ((0.0, 0), Addition::ZERO);
        let mut end = self.plan.tree.len();
        for (part, made) in parts.iter().zip(additions).rev() {
            for at in (part.end..end).rev() {
                growth = larger(growth, self.eliminate(factors, at, &mut addition)?);
                self.add(factors, at, &addition);
            }
            self.add(factors, part.start, made);
            end = part.start;
        }
        for at in (0..end).rev() {
            growth = larger(growth, self.eliminate(factors, at, &mut addition)?);
            self.add(factors, at, &addition);
        }
        Ok(growth)
    }

    /// Gives to the parent of the body at a position what that adds.
    fn add(&self, factors: &mut Factors<'_, T, N>, at: usize, addition: &Addition<T, N>) {
        let tree = &self.plan.tree;
        let Some(parent) = tree.parent(at) else { return };
        let to = &mut factors.bodies[parent - factors.first].h;
        to.iter_mut().zip(&addition.h).for_each(|(to, h)| add(to, h));
        let above = tree.free(parent);
        let before = tree.free_before(factors.first);
        let above = &mut factors.free[above.start - before..above.end - before];
        above.iter_mut().zip(addition.sizes).for_each(|(free, size)| free.size += size);
    }

    /// Eliminates the body at a position, whose children are; what it adds to its parent replaces `addition`.
    fn eliminate(
        &self,
        factors: &mut Factors<'_, T, N>,
        at: usize,
        addition: &mut Addition<T, N>,
    ) -> Result<Growth, SingularMatrix> {
        let tree = &self.plan.tree;
        let (motion, step) = (&self.motions[at], &self.step);
        let range = tree.free(at);
        let k = range.len();
        let (columns, made) = (&self.columns[range.clone()], &self.made[range.clone()]);
        let before = tree.free_before(factors.first);
        let local = range.start - before..range.end - before;
        let (free, exchanges) = (&mut factors.free[local.clone()], &mut factors.exchanges[local]);
        let pivots = tree.pivots_before(at) - tree.pivots_before(factors.first);
        let psi = &mut factors.psi[pivots..pivots + k * k];
        let body = &mut factors.bodies[at - factors.first];
        let twice = step.gamma_h.scaled(2.0);
        let has_parent = tree.parent(at).is_some();
        let between = |upper| {
            has_parent
                .then(|| coupling(self.plan, step, self.extra, at, upper, self.blocks))
                .flatten()
        };
        // A = H 𝒯 + L
        let mut a = [[[T::ZERO; N]; N]; 3];
        if has_parent {
            let bend = step.bend_of(motion);
            let h = &body.h;
            let (turned, twice_a) = (scaled(step.ratio, &h[1]), scaled(twice, &h[2]));
            for level in 0..3 {
                add_product(&mut a[level], &h[level], &motion.t);
            }
            add_product(&mut a[0], &turned, &motion.alpha);
            add_product(&mut a[1], &twice_a, &motion.alpha);
            for i in 0..N {
                for l in 0..N {
                    for j in 0..N {
                        a[0][i][j] = a[0][i][j] + h[2][i][l] * bend[l][j];
                    }
                }
            }
            if let Some(lower) = between(false) {
                a.iter_mut().zip(&lower).for_each(|(a, lower)| add(a, lower));
            }
        }
        let upper = between(true);
        // Ψ = BᵀHℬ, Z before the solution, V = Uℬ + TᵀHℬ
        let mut sizes = [0.0f64; N];
        for (c, levels) in columns.iter().enumerate() {
            let mut force = [T::ZERO; N];
            let mut size = [0.0f64; N];
            for (h, x) in body.h.iter().zip(levels) {
                add_own_times(&mut force, h, x);
                for i in 0..N {
                    size[i] = (0..N).fold(size[i], |s, j| s + h[i][j].size() * x[j].size());
                }
            }
            for (r, row) in made.iter().enumerate() {
                psi[r * k + c] = (0..N).fold(T::ZERO, |s, i| s + force[i].scaled(row.b[i]));
            }
            let (b, free) = (&made[c].b, &mut free[c]);
            sizes[c] = (0..N).fold(free.size, |s, i| s + size[i] * b[i].abs());
            for (z, a) in free.z.iter_mut().zip(&a) {
                *z = [T::ZERO; N];
                for i in 0..N {
                    for j in 0..N {
                        z[j] = z[j] + a[i][j].scaled(b[i]);
                    }
                }
            }
            free.v = [T::ZERO; N];
            add_transposed_times(&mut free.v, &motion.t, &force);
            if let Some(upper) = &upper {
                for (u, x) in upper.iter().zip(levels) {
                    add_own_times(&mut free.v, u, x);
                }
            }
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
            add_transposed_product(&mut addition.h[level], &motion.t, &a[level]);
        }
        let above = tree.free(parent);
        let above = self.made[above.clone()].iter().zip(&self.columns[above]);
        for (to, (made, levels)) in addition.sizes.iter_mut().zip(above) {
            for (h, x) in addition.h.iter().zip(levels) {
                for i in 0..N {
                    let row = (0..N).fold(0.0, |s, j| s + h[i][j].size() * x[j].size());
                    *to += row * made.b[i].abs();
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
            add_product(&mut addition.h[0], stiff, &motion.t);
            add_product(&mut addition.h[0], &scaled(step.ratio, damped), &motion.alpha);
            add_product(&mut addition.h[1], damped, &motion.t);
        }
        Ok((growth, at))
    }
}

impl<T: Scalar, const N: usize> Numbers<T, N> {
    pub(super) fn new(plan: &Plan) -> Self {
        let (count, free) = (plan.tree.len(), plan.tree.free_before(plan.tree.len()));
        let zero = [[T::ZERO; N]; N];
        let unknown = Free { size: 0.0, z: [[T::ZERO; N]; 3], v: [T::ZERO; N] };
        Self {
            step: Step { gamma_h: T::ZERO, beta_h2: T::ZERO, ratio: T::ZERO },
            bodies: vec![Body { h: [zero; 3] }; count],
            psi: vec![T::ZERO; plan.tree.pivots_before(count)],
            exchanges: vec![0; free],
            free: vec![unknown; free],
            columns: vec![[[T::ZERO; N]; 3]; free],
            extra: vec![[zero; 4]; if plan.extra.is_empty() { 0 } else { count }],
            additions: vec![Addition::ZERO; plan.parts.len()],
            phi: vec![[T::ZERO; N]; count],
            w: vec![[[T::ZERO; N]; 3]; count],
            r: vec![T::ZERO; free],
        }
    }

    /// F_z E⁻¹ g_q and F_z E⁻¹ g_q̇ into H and the couplings.
    fn add_extra_states(&mut self, plan: &Plan, structure: &Structure, sum: &Sum<'_, T>) {
        let per_body = structure.sizes.per_body;
        let b = &sum.blocks.blocks;
        self.extra.fill([[[T::ZERO; N]; N]; 4]);
        for Extra { state, bodies, child } in &plan.extra {
            let scale = sum.gamma_h * sum.inverse_e[*state];
            let part =
                |values: &[f64], side: usize, i: usize| values[(2 * state + side) * per_body + i];
            for (side, row) in bodies.iter().enumerate() {
                for (other, column) in bodies.iter().enumerate() {
                    let (Some(row), Some(column)) = (row, column) else { continue };
                    for (level, rates, power) in
                        [(0, &b.extra_position, sum.beta_h2), (1, &b.extra_velocity, sum.gamma_h)]
                    {
                        let to = match (row == column, row == child) {
                            (true, _) => &mut self.bodies[*row].h[level],
                            (false, true) => &mut self.extra[*child][level],
                            (false, false) => &mut self.extra[*child][2 + level],
                        };
                        for i in 0..N {
                            let force = (scale * power).scaled(part(&b.force_extra, side, i));
                            for j in 0..N {
                                to[i][j] = to[i][j] + force.scaled(part(rates, other, j));
                            }
                        }
                    }
                }
            }
        }
    }

    /// Eliminates children before parents; returns the largest growth of numbers and the position it was at.
    pub(super) fn factor(
        &mut self,
        plan: &Plan,
        threads: &Threads,
        motions: &[Motion<N>],
        made: &[Column<N>],
        structure: &Structure,
        sum: &Sum<'_, T>,
    ) -> Result<Growth, SingularMatrix> {
        let step = Step { gamma_h: sum.gamma_h, beta_h2: sum.beta_h2, ratio: sum.ratio };
        self.step = step;
        begin(plan, threads, sum, &step, made, 0, &mut self.bodies, &mut self.columns);
        self.free.iter_mut().for_each(|free| free.size = 0.0);
        if !plan.extra.is_empty() {
            self.add_extra_states(plan, structure, sum);
        }
        let Self { bodies, psi, exchanges, free, columns, extra, additions, .. } = self;
        let given =
            Given { plan, threads, motions, made, columns, extra, step, blocks: sum.blocks };
        let mut factors = Factors { first: 0, bodies, psi, exchanges, free };
        let [all, _] = factors.split_at(plan, plan.tree.len());
        let growth = given.parts(&plan.parts, all, additions)?;
        Ok(larger(growth, given.rest(&plan.parts, &mut factors, additions)?))
    }
}
