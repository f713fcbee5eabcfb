//! Solutions with the factors of a tree's matrix: inwards, and outwards again.

use super::numbers::{Numbers, coupling};
use super::plan::Plan;
use super::{Column, Motion};
use crate::newton::blocks::ReducedBlocks;
use holonom_linalg::Scalar;
use holonom_linalg::small::{Square, add_own_times, add_times, add_transposed_times, solve};

impl<T: Scalar, const N: usize> Numbers<T, N> {
    pub(super) fn solve(
        &mut self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        right: &mut [T],
        blocks: &ReducedBlocks,
        multipliers: bool,
    ) {
        let (tree, step) = (&plan.tree, self.step);
        let n = tree.len() * N;
        let given = right[..3 * n].iter().any(|x| x.size() != 0.0);
        let twice = step.gamma_h.scaled(2.0);
        let one = T::from(1.0);
        for (at, phi) in self.phi.iter_mut().enumerate() {
            let body = tree.body(at);
            *phi = std::array::from_fn(|i| right[3 * n + body * N + i]);
        }
        for at in (0..tree.len()).rev() {
            let motion = &motions[at];
            let range = tree.free(at);
            let parent = tree.parent(at);
            let mut g = [[T::ZERO; N]; 3];
            let mut phi = self.phi[at];
            if given {
                let rows = tree.rows(at);
                for (level, g) in g.iter_mut().enumerate() {
                    let f: [T; N] = std::array::from_fn(|i| right[level * n + rows[i] as usize]);
                    add_times(g, one, &motion.inverse, &f);
                }
                let [x, y, a] = &mut g;
                add_times(y, step.ratio.scaled(-1.0), &motion.q0, x);
                add_times(a, step.beta_h2.scaled(-1.0), &motion.q1, x);
                add_times(a, twice.scaled(-1.0), &motion.q0, y);
                for (h, g) in self.bodies[at].h.iter().zip(&g) {
                    let minus: [T; N] = std::array::from_fn(|i| g[i].scaled(-1.0));
                    add_own_times(&mut phi, h, &minus);
                }
            }
            for (k, column) in range.clone().zip(&columns[range.clone()]) {
                self.r[k] = (0..N).fold(T::ZERO, |s, i| s + phi[i].scaled(column.b[i]));
            }
            let psi = &self.psi[tree.pivots_before(at)..tree.pivots_before(at + 1)];
            let exchanges = &self.exchanges[range.clone()];
            let mut r = &mut self.r[range.clone()];
            solve(psi, exchanges, range.len(), &mut r, |r, c| &mut r[c]);
            if let Some(parent) = parent {
                let mut add = [T::ZERO; N];
                add_transposed_times(&mut add, &motion.t, &phi);
                for k in range {
                    for i in 0..N {
                        add[i] = add[i] - self.free[k].v[i] * self.r[k];
                    }
                }
                if given && let Some(upper) = coupling(plan, &step, &self.extra, at, true, blocks) {
                    for (u, g) in upper.iter().zip(&g) {
                        let minus: [T; N] = std::array::from_fn(|i| g[i].scaled(-1.0));
                        add_own_times(&mut add, u, &minus);
                    }
                }
                for (phi, add) in self.phi[parent].iter_mut().zip(add) {
                    *phi = *phi + add;
                }
            }
            self.w[at] = g;
        }
        for at in 0..tree.len() {
            let motion = &motions[at];
            let range = tree.free(at);
            let mut w = self.w[at];
            let parent = tree.parent(at);
            if let Some(parent) = parent {
                let above = self.w[parent];
                for k in range.clone() {
                    let terms = self.free[k].z.iter().zip(&above);
                    self.r[k] =
                        terms.fold(self.r[k], |r, (z, w)| (0..N).fold(r, |r, j| r - z[j] * w[j]));
                }
                for (w, above) in w.iter_mut().zip(&above) {
                    add_times(w, one, &motion.t, above);
                }
                add_times(&mut w[1], step.ratio, &motion.alpha, &above[0]);
                add_times(&mut w[2], twice, &motion.alpha, &above[1]);
                add_own_times(&mut w[2], &step.bend_of(motion), &above[0]);
            }
            for k in range.clone() {
                for (w, x) in w.iter_mut().zip(&self.columns[k]) {
                    for i in 0..N {
                        w[i] = w[i] + x[i] * self.r[k];
                    }
                }
            }
            self.w[at] = w;
            for (level, w) in w.iter().enumerate() {
                right[level * n + tree.body(at) * N..][..N].copy_from_slice(w);
            }
            let rows = tree.rows(at);
            let last = N - range.len();
            if multipliers {
                let mut force = self.phi[at];
                let mut subtract = |a: &Square<T, N>, x: &[T; N]| {
                    let minus: [T; N] = std::array::from_fn(|i| x[i].scaled(-1.0));
                    add_own_times(&mut force, a, &minus);
                };
                for (h, w) in self.bodies[at].h.iter().zip(&w) {
                    subtract(h, w);
                }
                if let Some(parent) = parent
                    && let Some(lower) = coupling(plan, &step, &self.extra, at, false, blocks)
                {
                    for (l, w) in lower.iter().zip(&self.w[parent]) {
                        subtract(l, w);
                    }
                }
                let mut lambda = [T::ZERO; N];
                add_transposed_times(&mut lambda, &motion.inverse, &force);
                for (row, x) in rows[..last].iter().zip(lambda) {
                    right[3 * n + *row as usize] = x;
                }
            }
            for (row, k) in rows[last..].iter().zip(range) {
                right[3 * n + *row as usize] = self.r[k];
            }
        }
    }
}
