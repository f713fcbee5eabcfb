//! Algorithm 4: Cholesky factors without fill, and the solution with constraint rows.

use super::plan::{BranchedPlan, NONE};
use crate::error::NotPositiveDefinite;
use std::sync::Arc;

/// Pivots below this part of their diagonal entry are round-off.
const NEGLIGIBLE: f64 = 16.0 * f64::EPSILON;

/// Numbers of `W` systems of one topology side by side; a loop over them becomes vector instructions.
type Lanes<const W: usize> = [f64; W];

/// Solves M q̈ + Φᵀλ = Q, Φ q̈ = τ for `W` systems of one topology at once (Algorithm 4, Alg-S).
///
/// M is given by the columns of its lower triangle at the places of the [`BranchedPlan`], Φ as an n×m matrix by
/// coordinates in the plan's numbering of both. Nothing is exchanged for size: M must be positive definite and Φ have full rank, which
/// the pivots show. The same input gives the same bits on every processor, whatever `W`.
#[derive(Debug, Clone)]
pub struct BranchedCholesky<const W: usize> {
    plan: Arc<BranchedPlan>,
    /// L by columns.
    l: Vec<Lanes<W>>,
    /// Inverse diagonal of L.
    inverse: Vec<Lanes<W>>,
    /// T = L⁻¹Φᵀ, n×m by rows.
    t: Vec<Lanes<W>>,
    /// TᵀT = UᵀU by rows of U, the upper triangle.
    s: Vec<Lanes<W>>,
    /// Inverse diagonal of that.
    s_inverse: Vec<Lanes<W>>,
    z: Vec<Lanes<W>>,
}

impl<const W: usize> BranchedCholesky<W> {
    /// Room for the numbers.
    pub fn new(plan: Arc<BranchedPlan>) -> Self {
        let (n, m) = (plan.len(), plan.rows());
        let zeros = |count: usize| vec![[0.0; W]; count];
        Self {
            l: zeros(plan.entries()),
            inverse: zeros(n),
            t: zeros(n * m),
            s: zeros(m * m),
            s_inverse: zeros(m),
            z: zeros(n),
            plan,
        }
    }

    /// Places and patterns.
    pub fn plan(&self) -> &Arc<BranchedPlan> {
        &self.plan
    }

    /// L by the columns of the plan, after [`Self::factor`].
    pub fn factor_values(&self) -> &[Lanes<W>] {
        &self.l
    }

    /// T, n×m by rows, after [`Self::factor_rows`].
    pub fn row_values(&self) -> &[Lanes<W>] {
        &self.t
    }

    /// M = L Lᵀ (step 1).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] at the first pivot of one of the systems that is not above round-off.
    ///
    /// # Panics
    /// If M has not the entries of the plan.
    pub fn factor(&mut self, m: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        self.l.copy_from_slice(m);
        self.run(Task::Factor(m))
    }

    #[inline(always)]
    fn eliminate(&mut self, m: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        let plan = &*self.plan;
        for c in 0..plan.len() {
            let column = plan.column(c);
            // Those above stand behind.
            let (known, rest) = self.l.split_at_mut(column.end);
            let own = &mut known[column.start..];
            self.inverse[c] = pivot(&mut own[0], &m[column.start], c)?;
            let inverse = self.inverse[c];
            own[1..].iter_mut().for_each(|x| multiply(x, &inverse));
            let mut i = plan.above[c];
            for a in 1..own.len() {
                let from = plan.start[i as usize] - column.end;
                let target = &mut rest[from..from + own.len() - a];
                let l = own[a];
                for (x, y) in target.iter_mut().zip(&own[a..]) {
                    subtract_product(x, &l, y);
                }
                i = plan.above[i as usize];
            }
        }
        Ok(())
    }

    /// T = L⁻¹Φᵀ and TᵀT = its factors (steps 3.1, 3.3 and the factors of 3.4).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] at the first constraint row that depends on those before it.
    ///
    /// # Panics
    /// If Φ has not n·m entries.
    pub fn factor_rows(&mut self, rows: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        self.t.copy_from_slice(rows);
        self.run(Task::FactorRows)
    }

    #[inline(always)]
    fn solve_rows(&mut self) {
        let plan = &*self.plan;
        let m = plan.rows();
        for c in 0..plan.len() {
            let (known, rest) = self.t.split_at_mut((c + 1) * m);
            let own = &mut known[c * m..];
            for run in plan.runs(c) {
                own[run].iter_mut().for_each(|x| multiply(x, &self.inverse[c]));
            }
            let mut up = plan.above[c];
            for l in &self.l[plan.column(c)][1..] {
                let above = &mut rest[(up as usize - c - 1) * m..][..m];
                for run in plan.runs(c) {
                    for (x, y) in above[run.clone()].iter_mut().zip(&own[run]) {
                        subtract_product(x, l, y);
                    }
                }
                up = plan.above[up as usize];
            }
        }
    }

    #[inline(always)]
    fn factor_products(&mut self) -> Result<(), NotPositiveDefinite> {
        let plan = &*self.plan;
        let m = plan.rows();
        self.s.fill([0.0; W]);
        for (c, t) in self.t.chunks_exact(m.max(1)).enumerate() {
            for rows in plan.runs(c) {
                for r in rows {
                    let (x, row) = (t[r], &mut self.s[r * m..(r + 1) * m]);
                    for run in plan.runs(c).filter(|run| run.end > r) {
                        let run = run.start.max(r)..run.end;
                        for (s, y) in row[run.clone()].iter_mut().zip(&t[run]) {
                            add_product(s, &x, y);
                        }
                    }
                }
            }
        }
        for r in 0..m {
            self.s_inverse[r] = self.s[r * m + r];
        }
        for p in 0..m {
            let (known, rest) = self.s.split_at_mut((p + 1) * m);
            let own = &mut known[p * m + p..];
            let given = self.s_inverse[p];
            self.s_inverse[p] = pivot(&mut own[0], &given, p)?;
            let own = &mut own[1..];
            own.iter_mut().for_each(|x| multiply(x, &self.s_inverse[p]));
            for (i, row) in rest.chunks_exact_mut(m).enumerate() {
                let u = own[i];
                for (x, y) in row[p + 1 + i..].iter_mut().zip(&own[i..]) {
                    subtract_product(x, &u, y);
                }
            }
        }
        Ok(())
    }

    /// Accelerations and multipliers for the factored matrices (steps 2, 3.2, 3.4, 3.5 and 4): `force` is Q and
    /// becomes q̈, `tau` becomes λ.
    ///
    /// # Panics
    /// If the vectors have not n and m entries.
    pub fn solve(&mut self, force: &mut [Lanes<W>], tau: &mut [Lanes<W>]) {
        assert_eq!((force.len(), tau.len()), (self.plan.len(), self.plan.rows()));
        let solved = self.run(Task::Solve(force, tau));
        debug_assert!(solved.is_ok(), "substitution meets no pivots");
    }

    fn run(&mut self, task: Task<'_, W>) -> Result<(), NotPositiveDefinite> {
        pulp::Arch::new().dispatch(Run { on: self, task })
    }

    #[inline(always)]
    fn substitute(&mut self, force: &mut [Lanes<W>], tau: &mut [Lanes<W>]) {
        let plan = &*self.plan;
        let (z, m) = (&mut self.z, plan.rows());
        z.copy_from_slice(force);
        for c in 0..z.len() {
            multiply(&mut z[c], &self.inverse[c]);
            let own = z[c];
            let mut i = plan.above[c];
            for l in &self.l[plan.column(c)][1..] {
                subtract_product(&mut z[i as usize], l, &own);
                i = plan.above[i as usize];
            }
        }
        tau.iter_mut().flatten().for_each(|x| *x = -*x);
        for (c, t) in self.t.chunks_exact(m.max(1)).enumerate() {
            for run in plan.runs(c) {
                for (x, t) in tau[run.clone()].iter_mut().zip(&t[run]) {
                    add_product(x, t, &z[c]);
                }
            }
        }
        for r in 0..m {
            multiply(&mut tau[r], &self.s_inverse[r]);
            let (known, rest) = tau.split_at_mut(r + 1);
            for (x, u) in rest.iter_mut().zip(&self.s[r * m + r + 1..]) {
                subtract_product(x, u, &known[r]);
            }
        }
        for r in (0..m).rev() {
            let (rest, known) = tau.split_at_mut(r + 1);
            for (u, x) in self.s[r * m + r + 1..].iter().zip(known) {
                subtract_product(&mut rest[r], u, x);
            }
            multiply(&mut rest[r], &self.s_inverse[r]);
        }
        for (c, t) in self.t.chunks_exact(m.max(1)).enumerate() {
            for run in plan.runs(c) {
                for (t, x) in t[run.clone()].iter().zip(&tau[run]) {
                    subtract_product(&mut z[c], t, x);
                }
            }
        }
        for c in (0..z.len()).rev() {
            let mut sum = z[c];
            let mut i = plan.above[c];
            for l in &self.l[plan.column(c)][1..] {
                subtract_product(&mut sum, l, &z[i as usize]);
                i = plan.above[i as usize];
            }
            debug_assert_eq!(i, NONE);
            multiply(&mut sum, &self.inverse[c]);
            z[c] = sum;
        }
        force.copy_from_slice(z);
    }
}

/// What is run with the widest vectors this processor has. A closure in place of this type would be compiled
/// for the plain processor.
struct Run<'a, const W: usize> {
    on: &'a mut BranchedCholesky<W>,
    task: Task<'a, W>,
}

enum Task<'a, const W: usize> {
    Factor(&'a [Lanes<W>]),
    FactorRows,
    Solve(&'a mut [Lanes<W>], &'a mut [Lanes<W>]),
}

impl<const W: usize> pulp::WithSimd for Run<'_, W> {
    type Output = Result<(), NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        match self.task {
            Task::Factor(m) => self.on.eliminate(m),
            Task::FactorRows => {
                self.on.solve_rows();
                self.on.factor_products()
            }
            Task::Solve(force, tau) => {
                self.on.substitute(force, tau);
                Ok(())
            }
        }
    }
}

/// Replaces a pivot by its root and returns the inverse of that.
#[inline(always)]
fn pivot<const W: usize>(
    x: &mut Lanes<W>,
    given: &Lanes<W>,
    index: usize,
) -> Result<Lanes<W>, NotPositiveDefinite> {
    for (pivot, given) in x.iter().zip(given) {
        // Written so that a NaN fails.
        let good = *pivot > NEGLIGIBLE * given && pivot.is_finite();
        if !good {
            return Err(NotPositiveDefinite { index, pivot: *pivot });
        }
    }
    *x = x.map(f64::sqrt);
    Ok(x.map(|x| 1.0 / x))
}

#[inline(always)]
fn multiply<const W: usize>(x: &mut Lanes<W>, y: &Lanes<W>) {
    for w in 0..W {
        x[w] *= y[w];
    }
}

#[inline(always)]
fn add_product<const W: usize>(x: &mut Lanes<W>, a: &Lanes<W>, b: &Lanes<W>) {
    for w in 0..W {
        x[w] += a[w] * b[w];
    }
}

#[inline(always)]
fn subtract_product<const W: usize>(x: &mut Lanes<W>, a: &Lanes<W>, b: &Lanes<W>) {
    for w in 0..W {
        x[w] -= a[w] * b[w];
    }
}
