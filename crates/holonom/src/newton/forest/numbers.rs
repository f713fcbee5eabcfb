//! Coefficients of a step and the factors of a tree's matrix for them, real or complex.

use super::plan::{Extra, NONE, Plan};
use super::{Column, Motion};
use crate::newton::blocks::ReducedBlocks;
use crate::newton::sparse_pattern::Sum;
use crate::system::Structure;
use holonom_linalg::small::{
    Square, add_own_times, add_product, add_times, add_transposed_product, add_transposed_times,
    factor, scaled, solve,
};
use holonom_linalg::watch::checkpoint;
use holonom_linalg::{BlockMatrix, Scalar, SingularMatrix};

/// Coefficients of a step, and the factors for them.
#[derive(Debug, Clone)]
pub(super) struct Numbers<T, const N: usize> {
    gamma_h: T,
    beta_h2: T,
    ratio: T,
    /// H of the three levels, and βh²κ + 2γhη μ: what a does with x of the parent.
    h: Vec<[Square<T, N>; 3]>,
    bend: Vec<Square<T, N>>,
    /// Ψ of each body, factored, with its row exchanges.
    psi: Vec<T>,
    exchanges: Vec<u8>,
    /// Per independent variable: its column of ℬ, the size of what children add to its diagonal of Ψ before anything is taken
    /// from it, its row of Z = Ψ⁻¹BᵀA, and its column of V.
    columns: Vec<[[T; N]; 3]>,
    sizes: Vec<f64>,
    z: Vec<[[T; N]; 3]>,
    v: Vec<[T; N]>,
    /// K (b, p), C (b, p), K (p, b), C (p, b), scaled, where extra states add to them; else none.
    extra: Vec<[Square<T, N>; 4]>,
    /// φ, w and r of a solution.
    phi: Vec<[T; N]>,
    w: Vec<[[T; N]; 3]>,
    r: Vec<T>,
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

impl<T: Scalar, const N: usize> Numbers<T, N> {
    pub(super) fn new(plan: &Plan) -> Self {
        let (count, free) = (plan.forest.len(), plan.first[plan.forest.len()]);
        let zero = [[T::ZERO; N]; N];
        Self {
            gamma_h: T::ZERO,
            beta_h2: T::ZERO,
            ratio: T::ZERO,
            h: vec![[zero; 3]; count],
            bend: vec![zero; count],
            columns: vec![[[T::ZERO; N]; 3]; free],
            psi: vec![T::ZERO; plan.pivots[count]],
            exchanges: vec![0; free],
            sizes: vec![0.0; free],
            z: vec![[[T::ZERO; N]; 3]; free],
            v: vec![[T::ZERO; N]; free],
            extra: vec![[zero; 4]; if plan.extra.is_empty() { 0 } else { count }],
            phi: vec![[T::ZERO; N]; count],
            w: vec![[[T::ZERO; N]; 3]; count],
            r: vec![T::ZERO; free],
        }
    }

    /// K and C between a body and its parent, scaled: (b, p) or (p, b).
    #[inline(always)]
    fn coupling(
        &self,
        plan: &Plan,
        b: usize,
        upper: bool,
        blocks: &ReducedBlocks,
    ) -> Option<[Square<T, N>; 2]> {
        let at = plan.blocks[b][if upper { 2 } else { 1 }];
        if at == NONE && self.extra.is_empty() {
            return None;
        }
        let mut out = [
            block(&blocks.blocks.stiffness, at, self.beta_h2),
            block(&blocks.blocks.damping, at, self.gamma_h),
        ];
        if let Some(extra) = self.extra.get(b) {
            let from = if upper { 2 } else { 0 };
            for (out, extra) in out.iter_mut().zip(&extra[from..]) {
                for i in 0..N {
                    for j in 0..N {
                        out[i][j] = out[i][j] + extra[i][j];
                    }
                }
            }
        }
        Some(out)
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
                            (true, _) => &mut self.h[*row][level],
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

    #[inline(always)]
    fn bend_of(&self, motion: &Motion<N>) -> Square<T, N> {
        let twice = (self.gamma_h * self.ratio).scaled(2.0);
        std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                self.beta_h2.scaled(motion.kappa[i][j]) + twice.scaled(motion.mu[i][j])
            })
        })
    }

    /// A column of ℬ.
    #[inline(always)]
    fn column_of(&self, c: &Column<N>) -> [[T; N]; 3] {
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

    /// Eliminates children before parents; returns the largest growth of numbers and the body it was at.
    pub(super) fn factor(
        &mut self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        structure: &Structure,
        sum: &Sum<'_, T>,
    ) -> Result<(f64, usize), SingularMatrix> {
        checkpoint(plan.forest.len() * N * N * N);
        (self.gamma_h, self.beta_h2, self.ratio) = (sum.gamma_h, sum.beta_h2, sum.ratio);
        let b = &sum.blocks.blocks;
        for (h, at) in self.h.iter_mut().zip(&plan.blocks) {
            *h = [
                block(&b.stiffness, at[0], sum.beta_h2),
                block(&b.damping, at[0], sum.gamma_h),
                [[T::ZERO; N]; N],
            ];
        }
        for &[body, first, order, at] in &plan.masses {
            let values = &sum.mass.values()[at..at + order * order];
            for (i, row) in values.chunks_exact(order).enumerate() {
                for (j, x) in row.iter().enumerate() {
                    self.h[body][2][first + i][first + j] = T::from(*x);
                }
            }
        }
        if !plan.extra.is_empty() {
            self.add_extra_states(plan, structure, sum);
        }
        for at in 0..columns.len() {
            self.columns[at] = self.column_of(&columns[at]);
        }
        let twice = self.gamma_h.scaled(2.0);
        self.sizes.fill(0.0);
        let mut growth = (0.0f64, 0);
        for body in plan.forest.order().rev() {
            let motion = &motions[body];
            let free = plan.free(body);
            let k = free.len();
            let parent = plan.forest.parent(body);
            // A = H 𝒯 + L
            let mut a = [[[T::ZERO; N]; N]; 3];
            if parent.is_some() {
                let bend = self.bend_of(motion);
                self.bend[body] = bend;
                let h = &self.h[body];
                let (turned, twice_a) = (scaled(self.ratio, &h[1]), scaled(twice, &h[2]));
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
                if let Some(lower) = self.coupling(plan, body, false, sum.blocks) {
                    for (a, lower) in a.iter_mut().zip(&lower) {
                        for i in 0..N {
                            for j in 0..N {
                                a[i][j] = a[i][j] + lower[i][j];
                            }
                        }
                    }
                }
            }
            let upper = parent.and_then(|_| self.coupling(plan, body, true, sum.blocks));
            // Ψ = BᵀHℬ, Z before the solution, V = Uℬ + TᵀHℬ
            let psi = plan.pivots[body]..plan.pivots[body + 1];
            let mut sizes = [0.0f64; N];
            for (c, at) in free.clone().enumerate() {
                let levels = self.columns[at];
                let mut force = [T::ZERO; N];
                let mut size = [0.0f64; N];
                for (h, x) in self.h[body].iter().zip(&levels) {
                    add_own_times(&mut force, h, x);
                    for i in 0..N {
                        size[i] = (0..N).fold(size[i], |s, j| s + h[i][j].size() * x[j].size());
                    }
                }
                for (r, row) in free.clone().enumerate() {
                    let b = &columns[row].b;
                    let entry = (0..N).fold(T::ZERO, |s, i| s + force[i].scaled(b[i]));
                    self.psi[psi.start + r * k + c] = entry;
                }
                let b = &columns[at].b;
                sizes[c] = (0..N).fold(self.sizes[at], |s, i| s + size[i] * b[i].abs());
                let z = &mut self.z[at];
                for (z, a) in z.iter_mut().zip(&a) {
                    *z = [T::ZERO; N];
                    for i in 0..N {
                        for j in 0..N {
                            z[j] = z[j] + a[i][j].scaled(b[i]);
                        }
                    }
                }
                let v = &mut self.v[at];
                *v = [T::ZERO; N];
                add_transposed_times(v, &motion.t, &force);
                if let Some(upper) = &upper {
                    for (u, x) in upper.iter().zip(&levels) {
                        add_own_times(v, u, x);
                    }
                }
            }
            let (factors, exchanges) = (&mut self.psi[psi], &mut self.exchanges[free.clone()]);
            let here = factor(factors, exchanges, k, &sizes).map_err(|c| SingularMatrix {
                row: plan.forest.rows(body)[N - k + c] as usize,
                column: body * N,
                pivot: 0.0,
            })?;
            if here > growth.0 {
                growth = (here, body);
            }
            for level in 0..3 {
                for j in 0..N {
                    let z = &mut self.z[free.clone()];
                    solve(factors, exchanges, k, &mut (z, level, j), |(z, level, j), c| {
                        &mut z[c][*level][*j]
                    });
                }
            }
            // What it adds to its parent: U 𝒯 + TᵀA − V Z.
            let Some(parent) = parent else { continue };
            let mut add = [[[T::ZERO; N]; N]; 3];
            for level in 0..3 {
                add_transposed_product(&mut add[level], &motion.t, &a[level]);
            }
            for at in plan.free(parent) {
                let (b, levels) = (&columns[at].b, &self.columns[at]);
                for (add, x) in add.iter().zip(levels) {
                    for i in 0..N {
                        let row = (0..N).fold(0.0, |s, j| s + add[i][j].size() * x[j].size());
                        self.sizes[at] += row * b[i].abs();
                    }
                }
            }
            let to = &mut self.h[parent];
            for level in 0..3 {
                for i in 0..N {
                    for j in 0..N {
                        to[level][i][j] = to[level][i][j] + add[level][i][j];
                    }
                }
                for at in free.clone() {
                    let (v, z) = (&self.v[at], &self.z[at][level]);
                    for i in 0..N {
                        for j in 0..N {
                            to[level][i][j] = to[level][i][j] - v[i] * z[j];
                        }
                    }
                }
            }
            if let Some([stiff, damped]) = &upper {
                add_product(&mut to[0], stiff, &motion.t);
                add_product(&mut to[0], &scaled(self.ratio, damped), &motion.alpha);
                add_product(&mut to[1], damped, &motion.t);
            }
        }
        Ok(growth)
    }

    pub(super) fn solve(
        &mut self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        right: &mut [T],
        blocks: &ReducedBlocks,
        multipliers: bool,
    ) {
        let n = plan.forest.len() * N;
        let given = right[..3 * n].iter().any(|x| x.size() != 0.0);
        let twice = self.gamma_h.scaled(2.0);
        let one = T::from(1.0);
        for (body, phi) in self.phi.iter_mut().enumerate() {
            *phi = std::array::from_fn(|i| right[3 * n + body * N + i]);
        }
        for body in plan.forest.order().rev() {
            let motion = &motions[body];
            let free = plan.free(body);
            let parent = plan.forest.parent(body);
            let mut g = [[T::ZERO; N]; 3];
            let mut phi = self.phi[body];
            if given {
                let rows = plan.forest.rows(body);
                for (level, g) in g.iter_mut().enumerate() {
                    let f: [T; N] = std::array::from_fn(|i| right[level * n + rows[i] as usize]);
                    add_times(g, one, &motion.inverse, &f);
                }
                let [x, y, a] = &mut g;
                add_times(y, self.ratio.scaled(-1.0), &motion.q0, x);
                add_times(a, self.beta_h2.scaled(-1.0), &motion.q1, x);
                add_times(a, twice.scaled(-1.0), &motion.q0, y);
                for (h, g) in self.h[body].iter().zip(&g) {
                    let minus: [T; N] = std::array::from_fn(|i| g[i].scaled(-1.0));
                    add_own_times(&mut phi, h, &minus);
                }
            }
            for (at, column) in free.clone().zip(&columns[free.clone()]) {
                self.r[at] = (0..N).fold(T::ZERO, |s, i| s + phi[i].scaled(column.b[i]));
            }
            let psi = &self.psi[plan.pivots[body]..plan.pivots[body + 1]];
            let exchanges = &self.exchanges[free.clone()];
            let mut r = &mut self.r[free.clone()];
            solve(psi, exchanges, free.len(), &mut r, |r, c| &mut r[c]);
            if let Some(parent) = parent {
                let mut add = [T::ZERO; N];
                add_transposed_times(&mut add, &motion.t, &phi);
                for at in free {
                    for i in 0..N {
                        add[i] = add[i] - self.v[at][i] * self.r[at];
                    }
                }
                if given && let Some(upper) = self.coupling(plan, body, true, blocks) {
                    for (u, g) in upper.iter().zip(&g) {
                        let minus: [T; N] = std::array::from_fn(|i| g[i].scaled(-1.0));
                        add_own_times(&mut add, u, &minus);
                    }
                }
                for (phi, add) in self.phi[parent].iter_mut().zip(add) {
                    *phi = *phi + add;
                }
            }
            self.w[body] = g;
        }
        for body in plan.forest.order() {
            let motion = &motions[body];
            let free = plan.free(body);
            let mut w = self.w[body];
            let parent = plan.forest.parent(body);
            if let Some(parent) = parent {
                let above = self.w[parent];
                for at in free.clone() {
                    let terms = self.z[at].iter().zip(&above);
                    self.r[at] =
                        terms.fold(self.r[at], |r, (z, w)| (0..N).fold(r, |r, j| r - z[j] * w[j]));
                }
                for (w, above) in w.iter_mut().zip(&above) {
                    add_times(w, one, &motion.t, above);
                }
                add_times(&mut w[1], self.ratio, &motion.alpha, &above[0]);
                add_times(&mut w[2], twice, &motion.alpha, &above[1]);
                add_own_times(&mut w[2], &self.bend[body], &above[0]);
            }
            for at in free.clone() {
                for (w, x) in w.iter_mut().zip(&self.columns[at]) {
                    for i in 0..N {
                        w[i] = w[i] + x[i] * self.r[at];
                    }
                }
            }
            self.w[body] = w;
            for (level, w) in w.iter().enumerate() {
                right[level * n + body * N..][..N].copy_from_slice(w);
            }
            let rows = plan.forest.rows(body);
            let k = free.len();
            if multipliers {
                let mut force = self.phi[body];
                let mut subtract = |a: &Square<T, N>, x: &[T; N]| {
                    let minus: [T; N] = std::array::from_fn(|i| x[i].scaled(-1.0));
                    add_own_times(&mut force, a, &minus);
                };
                for (h, w) in self.h[body].iter().zip(&w) {
                    subtract(h, w);
                }
                if let Some(parent) = parent
                    && let Some(lower) = self.coupling(plan, body, false, blocks)
                {
                    for (l, w) in lower.iter().zip(&self.w[parent]) {
                        subtract(l, w);
                    }
                }
                let mut lambda = [T::ZERO; N];
                add_transposed_times(&mut lambda, &motion.inverse, &force);
                for (row, x) in rows[..N - k].iter().zip(lambda) {
                    right[3 * n + *row as usize] = x;
                }
            }
            for (row, at) in rows[N - k..].iter().zip(free) {
                right[3 * n + *row as usize] = self.r[at];
            }
        }
    }
}
