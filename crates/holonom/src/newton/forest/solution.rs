//! Solutions with the factors of a tree's matrix: inwards, and outwards again.

use super::numbers::Numbers;
use super::plan::Plan;
use super::{Column, Motion, Right};
use holonom_linalg::Scalar;
use holonom_linalg::small::{Square, add_transposed_times, solve};

impl<T: Scalar, const N: usize> Numbers<T, N> {
    pub(super) fn solve(
        &mut self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        right: Right<'_, T>,
    ) {
        self.go_inwards(plan, motions, columns, &mut *right.force, right.rate, right.given);
        self.go_outwards(plan, motions, columns, right.rate, right.given, right.change);
    }

    /// r of every body in the places of ρ.
    fn go_inwards(
        &self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        force: &mut [T],
        rate: &mut [T],
        given: [Option<&[T]>; 2],
    ) {
        let tree = &plan.tree;
        for at in (0..tree.len()).rev() {
            let range = tree.free(at);
            let (k, body) = (range.len(), tree.body(at) * N);
            let rows = &tree.rows(at)[N - k..];
            let place = |c: usize| rows[c] as usize - plan.rank;
            let phi: [T; N] = std::array::from_fn(|i| force[body + i]);
            let mut add = [T::ZERO; N];
            let has_parent = tree.parent(at).is_some();
            if has_parent {
                add_transposed_times(&mut add, &motions[at].t, &phi);
            }
            for (c, column) in columns[range.clone()].iter().enumerate() {
                rate[place(c)] = (0..N).fold(T::ZERO, |s, i| s + phi[i].scaled(column.b[i]));
            }
            let (psi, felt) = self.small(plan, at);
            for (level, (given, felt)) in given.iter().zip(felt).enumerate() {
                let Some(given) = given else { continue };
                for (c, free) in self.free[range.clone()].iter().enumerate() {
                    let x = given[place(c)];
                    for r in 0..k {
                        rate[place(r)] = rate[place(r)] - felt[r * k + c] * x;
                    }
                    subtract(&mut add, &free.given[level], x);
                }
            }
            let exchanges = &self.exchanges[range.clone()];
            let mut r = &mut *rate;
            solve(psi, exchanges, k, &mut r, |r, c| &mut r[place(c)]);
            if let Some(parent) = tree.parent(at) {
                for (c, free) in self.free[range].iter().enumerate() {
                    subtract(&mut add, &free.v, rate[place(c)]);
                }
                let above = &mut force[tree.body(parent) * N..][..N];
                above.iter_mut().zip(add).for_each(|(phi, add)| *phi = *phi + add);
            }
        }
    }

    /// ρ of every body, and with it how the body moves, for those that hang on it.
    fn go_outwards(
        &mut self,
        plan: &Plan,
        motions: &[Motion<N>],
        columns: &[Column<N>],
        rate: &mut [T],
        given: [Option<&[T]>; 2],
        mut change: Option<&mut [T]>,
    ) {
        let (tree, step) = (&plan.tree, self.step);
        let n = tree.len() * N;
        for at in 0..tree.len() {
            let range = tree.free(at);
            let rows = &tree.rows(at)[N - range.len()..];
            let place = |c: usize| rows[c] as usize - plan.rank;
            let above = tree.parent(at).map(|parent| self.w[plan.places[parent] as usize]);
            if let Some(above) = &above {
                for (c, free) in self.free[range.clone()].iter().enumerate() {
                    let terms = free.z.iter().zip(above);
                    let r = &mut rate[place(c)];
                    *r = terms.fold(*r, |r, (z, w)| (0..N).fold(r, |r, j| r - z[j] * w[j]));
                }
            }
            if change.is_none() && !plan.carries(at) {
                continue;
            }
            let mut w = above.map_or([[T::ZERO; N]; 3], |above| motions[at].carry(&above));
            for (c, column) in columns[range].iter().enumerate() {
                let rho = rate[place(c)];
                let [p, v] = given.map(|given| given.map_or(rho, |given| rho + given[place(c)]));
                column.add_motion(&mut w, [step.beta_h2 * p, step.gamma_h * v, rho]);
            }
            self.w[plan.places[at] as usize] = w;
            if let Some(change) = &mut change {
                for (level, w) in w.iter().enumerate() {
                    change[level * n + tree.body(at) * N..][..N].copy_from_slice(w);
                }
            }
        }
    }
}

/// out −= a x.
#[inline(always)]
fn subtract<T: Scalar, const N: usize>(out: &mut [T; N], a: &[T; N], x: T) {
    for i in 0..N {
        out[i] = out[i] - a[i] * x;
    }
}

impl<const N: usize> Motion<N> {
    /// 𝒯 w of the parent's w.
    #[inline(always)]
    fn carry<T: Scalar>(&self, [x, y, a]: &[[T; N]; 3]) -> [[T; N]; 3] {
        let twice: [T; N] = std::array::from_fn(|j| y[j].scaled(2.0));
        let row = |m: &Square<f64, N>, i: usize, w: &[T; N], sum: T| {
            (0..N).fold(sum, |sum, j| sum + w[j].scaled(m[i][j]))
        };
        let mut out = [[T::ZERO; N]; 3];
        for i in 0..N {
            out[0][i] = row(&self.t, i, x, T::ZERO);
            out[1][i] = row(&self.alpha, i, x, row(&self.t, i, y, T::ZERO));
            let sum = row(&self.alpha, i, &twice, row(&self.t, i, a, T::ZERO));
            out[2][i] = row(&self.nu, i, x, sum);
        }
        out
    }
}

impl<const N: usize> Column<N> {
    /// Adds to w what the variable's position, velocity and acceleration do.
    #[inline(always)]
    pub(super) fn add_motion<T: Scalar>(&self, w: &mut [[T; N]; 3], [p, v, a]: [T; 3]) {
        let twice = v.scaled(2.0);
        for i in 0..N {
            let (b, alpha, nu) = (self.b[i], self.alpha[i], self.nu[i]);
            w[0][i] = w[0][i] + p.scaled(b);
            w[1][i] = w[1][i] + v.scaled(b) + p.scaled(alpha);
            w[2][i] = w[2][i] + a.scaled(b) + twice.scaled(alpha) + p.scaled(nu);
        }
    }
}
