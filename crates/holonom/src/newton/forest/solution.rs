//! Solutions with the factors of a tree's matrix: inwards, and outwards again.

use super::numbers::Numbers;
use super::plan::Plan;
use super::{Column, Elimination, Motion, Right};
use holonom_linalg::Scalar;
use holonom_linalg::small::solve;

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
            // Of a root T is zero.
            let mut add = motions[at].felt(&phi);
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
        let [mut p, mut v, mut rate] = [[T::ZERO; N]; 3];
        for j in 0..N {
            let (t, alpha, nu) = (&self.t[j], &self.alpha[j], &self.nu[j]);
            let (x, y, twice, a) = (x[j], y[j], y[j].scaled(2.0), a[j]);
            for i in 0..N {
                p[i] = p[i] + x.scaled(t[i]);
                v[i] = v[i] + y.scaled(t[i]) + x.scaled(alpha[i]);
                rate[i] = rate[i] + a.scaled(t[i]) + twice.scaled(alpha[i]) + x.scaled(nu[i]);
            }
        }
        [p, v, rate]
    }

    /// Tᵀ φ.
    #[inline(always)]
    fn felt<T: Scalar>(&self, phi: &[T; N]) -> [T; N] {
        std::array::from_fn(|i| (0..N).fold(T::ZERO, |sum, j| sum + phi[j].scaled(self.t[i][j])))
    }
}

impl<const N: usize> Elimination<N> {
    /// x = D p: how bodies move at given rates of the independent variables.
    pub(super) fn spread(&self, p: &[f64], x: &mut [f64]) {
        let tree = &self.plan.tree;
        for at in 0..tree.len() {
            let body = tree.body(at) * N;
            let mut own = [0.0; N];
            if let Some(parent) = tree.parent(at) {
                let above = &x[tree.body(parent) * N..][..N];
                for (t, x) in self.motions[at].t.iter().zip(above) {
                    own.iter_mut().zip(t).for_each(|(own, t)| *own += t * x);
                }
            }
            let range = tree.free(at);
            let rows = &tree.rows(at)[N - range.len()..];
            for (row, column) in rows.iter().zip(&self.columns[range]) {
                let p = p[*row as usize - self.plan.rank];
                own.iter_mut().zip(&column.b).for_each(|(own, b)| *own += b * p);
            }
            x[body..body + N].copy_from_slice(&own);
        }
    }

    /// p = Dᵀ f: what forces on bodies do along the independent variables.
    pub(super) fn gather(&self, force: &mut [f64], p: &mut [f64]) {
        let tree = &self.plan.tree;
        for at in (0..tree.len()).rev() {
            let body = tree.body(at) * N;
            let own: [f64; N] = std::array::from_fn(|i| force[body + i]);
            let range = tree.free(at);
            let rows = &tree.rows(at)[N - range.len()..];
            for (row, column) in rows.iter().zip(&self.columns[range]) {
                p[*row as usize - self.plan.rank] =
                    (0..N).fold(0.0, |sum, i| sum + own[i] * column.b[i]);
            }
            if let Some(parent) = tree.parent(at) {
                let above = &mut force[tree.body(parent) * N..][..N];
                let felt = self.motions[at].felt(&own);
                above.iter_mut().zip(felt).for_each(|(out, x)| *out += x);
            }
        }
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
