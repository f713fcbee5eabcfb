//! Algorithm 4: Cholesky factors without fill, and the solution with constraint rows.

use super::blocks::{
    Block, Lanes, Pivot, Tile, add_products, add_scaled, multiply, pivot, scaled, spread,
    subtract_product, subtract_scaled, subtract_sum, sum, take,
};
use super::plan::{BLOCK, BranchedPlan};
use crate::error::NotPositiveDefinite;
use crate::lanes::Arithmetic;
use std::array;
use std::sync::Arc;

/// Solves M q̈ + Φᵀλ = Q, Φ q̈ = τ for `W` systems of one topology at once (Algorithm 4, Alg-S).
///
/// M is given by the columns of its lower triangle at the places of the [`BranchedPlan`], Φ by coordinates in
/// the plan's numbering of both: [`BranchedPlan::width`] numbers for each, zero where the coordinate cannot appear
/// and where a last block is filled up. What fills up columns of M is not looked at. Nothing is exchanged for size:
/// M must be positive definite and Φ have full rank, which the pivots show. The same input gives the same bits
/// whatever `W`.
#[derive(Debug, Clone)]
pub struct BranchedCholesky<const W: usize> {
    plan: Arc<BranchedPlan>,
    /// Entries of the longest column.
    depth: usize,
    /// L by columns.
    l: Vec<Block<W>>,
    /// Inverse diagonal of L.
    inverse: Vec<Lanes<W>>,
    /// What eliminations so far change in the columns of the coordinates above, by blocks along the columns and then
    /// by depth: children come before their parents, so that of those at a depth only one at a time waits for
    /// changes. Zero between factorizations.
    change: Vec<Block<W>>,
    /// The same for blocks of rows.
    row_change: Vec<Block<W>>,
    /// T = L⁻¹Φᵀ by the panels of the plan.
    t: Vec<Block<W>>,
    /// TᵀT = UᵀU by rows of tiles of U, the upper triangle.
    s: Vec<Tile<W>>,
    /// Inverse diagonal of that.
    s_inverse: Vec<Block<W>>,
    z: Vec<Lanes<W>>,
    lambda: Vec<Block<W>>,
}

impl<const W: usize> BranchedCholesky<W> {
    const ZERO: Block<W> = [[0.0; W]; BLOCK];

    /// Room for the numbers.
    pub fn new(plan: Arc<BranchedPlan>) -> Self {
        let depth = (0..plan.len()).map(|c| plan.path(c).len()).max().unwrap_or(1);
        let rows = plan.width() / BLOCK;
        let zeros = |count: usize| vec![Self::ZERO; count];
        Self {
            depth,
            l: zeros(plan.places() / BLOCK),
            inverse: vec![[0.0; W]; plan.len()],
            change: zeros(depth.div_ceil(BLOCK) * depth),
            row_change: zeros(rows * depth),
            t: zeros(plan.row_places()),
            s: vec![[Self::ZERO; BLOCK]; rows * (rows + 1) / 2],
            s_inverse: zeros(rows),
            z: vec![[0.0; W]; plan.len()],
            lambda: zeros(rows),
            plan,
        }
    }

    /// Places and patterns.
    pub fn plan(&self) -> &Arc<BranchedPlan> {
        &self.plan
    }

    /// L at the places of the plan, after [`Self::factor`].
    pub fn factor_values(&self) -> &[Lanes<W>] {
        self.l.as_flattened()
    }

    /// M = L Lᵀ (step 1).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] at the first pivot of one of the systems that is not above round-off.
    ///
    /// # Panics
    /// If M has not the places of the plan.
    pub fn factor(&mut self, m: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        assert_eq!(m.len(), self.plan.places());
        let factored = self.run(Task::Factor(m));
        if factored.is_err() {
            self.change.fill(Self::ZERO);
        }
        factored
    }

    #[inline(always)]
    fn eliminate<A: Arithmetic>(&mut self, m: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        let (plan, depth) = (&*self.plan, self.depth);
        let m = m.as_chunks::<BLOCK>().0;
        for c in 0..plan.len() {
            let (own, m) = (&mut self.l[plan.blocks(c)], &m[plan.blocks(c)]);
            let above = plan.above(c).1.len();
            for ((x, m), change) in own.iter_mut().zip(m).zip(self.change.chunks_exact_mut(depth)) {
                *x = sum(m, &take(&mut change[above]));
            }
            let pivot = pivot(&own.as_flattened()[above], &m.as_flattened()[above], c)?;
            self.inverse[c] = pivot.root;
            for (j, change) in self.change.chunks_exact_mut(depth).take(own.len()).enumerate() {
                let x = own[j];
                let from = (j * BLOCK).min(above);
                let factors = &own.as_flattened()[from..above];
                spread::<A, W>(&mut change[from..above], factors, scaled(&x, &pivot.inverse));
                own[j] = scaled(&x, &pivot.root);
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
    /// If Φ has not n times the plan's width of entries.
    pub fn factor_rows(&mut self, rows: &[Lanes<W>]) -> Result<(), NotPositiveDefinite> {
        assert_eq!(rows.len(), self.plan.len() * self.plan.width());
        self.run(Task::FactorRows(rows))
    }

    #[inline(always)]
    fn solve_rows<A: Arithmetic>(&mut self, rows: &[Lanes<W>]) {
        let plan = &*self.plan;
        let (depth, width) = (self.depth, plan.width() / BLOCK);
        let rows = rows.as_chunks::<BLOCK>().0;
        for (panel, blocks) in plan.panels() {
            let count = panel.coordinates.len();
            let mut rest = &mut self.t[panel.places.clone()];
            for &b in blocks {
                let (t, behind) = rest.split_at_mut(count);
                rest = behind;
                let change = &mut self.row_change[b as usize * depth..][..depth];
                for (t, c) in t.iter_mut().zip(panel.coordinates.clone()) {
                    let l = &self.l.as_flattened()[plan.above(c).0];
                    let above = l.len();
                    let x = sum(&rows[c * width + b as usize], &take(&mut change[above]));
                    *t = scaled(&x, &self.inverse[c]);
                    spread::<A, W>(&mut change[..above], l, *t);
                }
            }
        }
    }

    #[inline(always)]
    fn multiply_rows<A: Arithmetic>(&mut self) {
        let plan = &*self.plan;
        let width = plan.width() / BLOCK;
        self.s.fill([Self::ZERO; BLOCK]);
        for (panel, blocks) in plan.panels() {
            let count = panel.coordinates.len();
            let t = &self.t[panel.places.clone()];
            for (i, &p) in blocks.iter().enumerate() {
                let row = &mut self.s[row_start(p as usize, width)..];
                for (j, &q) in blocks.iter().enumerate().skip(i) {
                    let tile = &mut row[(q - p) as usize];
                    let mut sum = *tile;
                    for (x, y) in t[i * count..][..count].iter().zip(&t[j * count..][..count]) {
                        for k in 0..BLOCK {
                            add_scaled::<A, W>(&mut sum[k], &x[k], y);
                        }
                    }
                    *tile = sum;
                }
            }
        }
    }

    #[inline(always)]
    fn factor_products<A: Arithmetic>(&mut self) -> Result<(), NotPositiveDefinite> {
        let width = self.plan.width() / BLOCK;
        for p in 0..width {
            let diagonal = &self.s[row_start(p, width)];
            self.s_inverse[p] = array::from_fn(|k| diagonal[k][k]);
        }
        let mut rest = &mut self.s[..];
        for p in 0..width {
            let (own, behind) = rest.split_at_mut(width - p);
            let inverse = &mut self.s_inverse[p];
            let (diagonal, own) = own.split_first_mut().expect("of this row");
            let used = (self.plan.rows() - p * BLOCK).min(BLOCK);
            let mut tile = *diagonal;
            for k in 0..BLOCK {
                // What fills up the last block has no pivot.
                let x = tile[k];
                let pivot = if k < used {
                    pivot(&x[k], &inverse[k], p * BLOCK + k)?
                } else {
                    Pivot { inverse: [0.0; W], root: [0.0; W] }
                };
                let factors = scaled(&x, &pivot.inverse);
                for r in k + 1..BLOCK {
                    subtract_scaled::<A, W>(&mut tile[r], &factors[r], &x);
                }
                tile[k] = scaled(&x, &pivot.root);
                inverse[k] = pivot.root;
            }
            *diagonal = tile;
            for tile in own.iter_mut() {
                for k in 0..BLOCK {
                    let x = scaled(&tile[k], &inverse[k]);
                    for r in k + 1..BLOCK {
                        subtract_scaled::<A, W>(&mut tile[r], &diagonal[k][r], &x);
                    }
                    tile[k] = x;
                }
            }
            let own = &*own;
            let mut targets = behind.iter_mut();
            for (i, x) in own.iter().enumerate() {
                for (y, target) in own[i..].iter().zip(&mut targets) {
                    let mut sum = *target;
                    for k in 0..BLOCK {
                        for r in 0..BLOCK {
                            subtract_scaled::<A, W>(&mut sum[r], &x[k][r], &y[k]);
                        }
                    }
                    *target = sum;
                }
            }
            rest = behind;
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
        self.z.copy_from_slice(force);
        let (lambda, fill) = self.lambda.as_flattened_mut().split_at_mut(tau.len());
        lambda.copy_from_slice(tau);
        fill.fill([0.0; W]);
        let solved = self.run(Task::Solve);
        debug_assert!(solved.is_ok(), "substitution meets no pivots");
        force.copy_from_slice(&self.z);
        tau.copy_from_slice(&self.lambda.as_flattened()[..tau.len()]);
    }

    fn run(&mut self, task: Task<'_, W>) -> Result<(), NotPositiveDefinite> {
        pulp::Arch::new().dispatch(Run { on: self, task })
    }

    #[inline(always)]
    fn substitute<A: Arithmetic>(&mut self) {
        let plan = &*self.plan;
        let (z, l) = (&mut self.z, self.l.as_flattened());
        for c in 0..z.len() {
            multiply(&mut z[c], &self.inverse[c]);
            let own = z[c];
            let (places, path) = plan.above(c);
            for (l, &i) in l[places].iter().zip(path) {
                subtract_product::<A, W>(&mut z[i as usize], l, &own);
            }
        }
        self.lambda.as_flattened_mut().as_flattened_mut().iter_mut().for_each(|x| *x = -*x);
        for (panel, blocks) in plan.panels() {
            let z = &z[panel.coordinates.clone()];
            let mut rest = &self.t[panel.places.clone()];
            for &b in blocks {
                let (t, behind) = rest.split_at(z.len());
                rest = behind;
                let mut sum = self.lambda[b as usize];
                for (t, z) in t.iter().zip(z) {
                    add_scaled::<A, W>(&mut sum, z, t);
                }
                self.lambda[b as usize] = sum;
            }
        }
        substitute_products::<A, W>(&self.s, &self.s_inverse, &mut self.lambda);
        for (panel, blocks) in plan.panels() {
            let z = &mut z[panel.coordinates.clone()];
            let t = &self.t[panel.places.clone()];
            for i in 0..z.len() {
                let mut sum = Self::ZERO;
                for (t, &b) in t[i..].iter().step_by(z.len()).zip(blocks) {
                    add_products::<A, W>(&mut sum, t, &self.lambda[b as usize]);
                }
                subtract_sum(&mut z[i], &sum);
            }
        }
        for c in (0..z.len()).rev() {
            let mut sum = z[c];
            let (places, path) = plan.above(c);
            for (l, &i) in l[places].iter().zip(path) {
                subtract_product::<A, W>(&mut sum, l, &z[i as usize]);
            }
            multiply(&mut sum, &self.inverse[c]);
            z[c] = sum;
        }
    }
}

/// UᵀU x = y in place.
#[inline(always)]
fn substitute_products<A: Arithmetic, const W: usize>(
    s: &[Tile<W>],
    inverse: &[Block<W>],
    x: &mut [Block<W>],
) {
    let width = x.len();
    let mut row = s;
    for p in 0..width {
        let (own, rest) = row.split_at(width - p);
        row = rest;
        let mut y = x[p];
        for k in 0..BLOCK {
            multiply(&mut y[k], &inverse[p][k]);
            for r in k + 1..BLOCK {
                let known = y[k];
                subtract_product::<A, W>(&mut y[r], &own[0][k][r], &known);
            }
        }
        x[p] = y;
        for (x, tile) in x[p + 1..].iter_mut().zip(&own[1..]) {
            for k in 0..BLOCK {
                subtract_scaled::<A, W>(x, &y[k], &tile[k]);
            }
        }
    }
    for p in (0..width).rev() {
        let own = &s[row_start(p, width)..][..width - p];
        let mut sums = [[[0.0; W]; BLOCK]; BLOCK];
        for (x, tile) in x[p + 1..].iter().zip(&own[1..]) {
            for k in 0..BLOCK {
                add_products::<A, W>(&mut sums[k], &tile[k], x);
            }
        }
        let mut y = x[p];
        for k in (0..BLOCK).rev() {
            subtract_sum(&mut y[k], &sums[k]);
            for r in k + 1..BLOCK {
                let known = y[r];
                subtract_product::<A, W>(&mut y[k], &own[0][k][r], &known);
            }
            multiply(&mut y[k], &inverse[p][k]);
        }
        x[p] = y;
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
    FactorRows(&'a [Lanes<W>]),
    Solve,
}

impl<const W: usize> pulp::WithSimd for Run<'_, W> {
    type Output = Result<(), NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        match self.task {
            Task::Factor(m) => self.on.eliminate::<S>(m),
            Task::FactorRows(rows) => {
                self.on.solve_rows::<S>(rows);
                self.on.multiply_rows::<S>();
                self.on.factor_products::<S>()
            }
            Task::Solve => {
                self.on.substitute::<S>();
                Ok(())
            }
        }
    }
}

/// First tile of a row of an upper triangle.
fn row_start(p: usize, width: usize) -> usize {
    p * width - p * p.saturating_sub(1) / 2
}
