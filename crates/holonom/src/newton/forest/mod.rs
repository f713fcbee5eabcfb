//! The inflated matrix of a tree of bodies, eliminated body by body from the leaves inwards.

mod numbers;
mod plan;
mod solution;

use super::blocks::ReducedBlocks;
use super::sparse_pattern::Sum;
use crate::reduction::Manifold;
use crate::threads::Threads;
use holonom_linalg::small::{Square, add_product, add_times, inverse, product, scaled, transposed};
use holonom_linalg::watch::checkpoint;
use holonom_linalg::{Complex64, SingularMatrix};
use numbers::Numbers;
use plan::Plan;
use std::sync::Arc;

/// Growth of numbers in the elimination of a body that leaves nine digits; beyond it another order of pivots
/// is needed.
const LARGEST_GROWTH: f64 = 1e-9 / f64::EPSILON;
/// Bodies times the square of their coordinates from which threads share the work: with two of them equal times
/// were measured for binary trees of 1,000 bodies in a plane and of 200 in space.
const SHARED: usize = 10_000;
/// Bodies of the smallest piece of work.
const GRAIN: usize = 32;

/// Elimination for bodies in a plane or in space.
#[derive(Debug, Clone)]
pub(super) enum ForestElimination {
    Planar(Box<Elimination<3>>),
    Spatial(Box<Elimination<7>>),
}

/// What one body has of the matrix and of its factors:
///
/// ```text
/// w = 𝒯 w_p + ℬ ρ + g      H w + L w_p + Eᵀλ̃ = φ      w = (δq, δq̇, δq̈)
/// ```
///
/// with the subscript p for the parent, E and F the body's rows of G̃, T = −E⁻¹F, and λ̃ = 0 in the rows of P.
/// Bodies are numbered by their positions in the tree. Equations: `docs/theory/newton.md` (15)-(21).
#[derive(Debug, Clone)]
pub(super) struct Elimination<const N: usize> {
    plan: Arc<Plan>,
    threads: Threads,
    motions: Vec<Motion<N>>,
    columns: Vec<Column<N>>,
    real: Numbers<f64, N>,
    complex: Option<Numbers<Complex64, N>>,
}

/// How a body follows its parent, apart from its independent variables: 𝒯 = [T 0 0; α T 0; ν 2α T]. With
/// Q₀ = E⁻¹Ã₀, Q₁ = E⁻¹Ã₁ of the body and Q₀ₚ, Q₁ₚ of its parent, α = −(Q₀T + Q₀ₚ), ν = −(Q₁T + Q₁ₚ) − 2Q₀α. Stored by
/// columns, so that products with vectors are vector instructions.
#[derive(Debug, Clone)]
struct Motion<const N: usize> {
    t: Square<f64, N>,
    alpha: Square<f64, N>,
    nu: Square<f64, N>,
}

/// What an independent variable does: its column of E⁻¹, b, with α = −Q₀b and ν = −Q₁b − 2Q₀α.
#[derive(Debug, Clone)]
struct Column<const N: usize> {
    b: [f64; N],
    alpha: [f64; N],
    nu: [f64; N],
}

/// A right-hand side of the inflated matrix and its solution.
pub(super) struct Right<'a, T> {
    /// f₁ and f₂ in the rows of P, where they do not vanish; they do in all others, and so does f₃.
    pub(super) given: [Option<&'a [T]>; 2],
    /// f₄; overwritten.
    pub(super) force: &'a mut [T],
    /// ρ.
    pub(super) rate: &'a mut [T],
    /// δq, δq̇ and δq̈, one after the other, where they are wanted.
    pub(super) change: Option<&'a mut [T]>,
}

impl ForestElimination {
    /// Whether there is one for the manifold's present parametrization.
    pub(super) fn fits(manifold: &Manifold) -> bool {
        Plan::new(manifold).is_some()
    }

    /// For the manifold's present parametrization, if the bodies form a forest in which forces couple
    /// neighbours only.
    pub(super) fn new(manifold: &Manifold, threads: &Threads) -> Option<Self> {
        let plan = Arc::new(Plan::new(manifold)?);
        Some(match plan.tree.forest().size() {
            3 => Self::Planar(Box::new(Elimination::new(plan, threads.clone()))),
            _ => Self::Spatial(Box::new(Elimination::new(plan, threads.clone()))),
        })
    }

    /// Takes the values of the rows of joints and of the moving ones of P, with their derivatives.
    pub(super) fn linearize(
        &mut self,
        rows: [&[f64]; 2],
        blocks: &ReducedBlocks,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.linearize(rows, blocks),
            Self::Spatial(elimination) => elimination.linearize(rows, blocks),
        }
    }

    /// Factors for real coefficients.
    pub(super) fn factor(&mut self, sum: &Sum<'_, f64>) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.factor(sum),
            Self::Spatial(elimination) => elimination.factor(sum),
        }
    }

    /// Factors for complex ones, beside the real factor.
    pub(super) fn factor_complex(
        &mut self,
        sum: &Sum<'_, Complex64>,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.factor_complex(sum),
            Self::Spatial(elimination) => elimination.factor_complex(sum),
        }
    }

    /// Solves with the real factor.
    pub(super) fn solve(&mut self, right: Right<'_, f64>) {
        match self {
            Self::Planar(elimination) => elimination.solve(right),
            Self::Spatial(elimination) => elimination.solve(right),
        }
    }

    /// Solves with the complex one.
    pub(super) fn solve_complex(&mut self, right: Right<'_, Complex64>) {
        match self {
            Self::Planar(elimination) => elimination.solve_complex(right),
            Self::Spatial(elimination) => elimination.solve_complex(right),
        }
    }

    /// x = D p.
    pub(super) fn spread(&self, p: &[f64], x: &mut [f64]) {
        match self {
            Self::Planar(elimination) => elimination.spread(p, x),
            Self::Spatial(elimination) => elimination.spread(p, x),
        }
    }

    /// p = Dᵀ f; f is overwritten.
    pub(super) fn gather(&self, force: &mut [f64], p: &mut [f64]) {
        match self {
            Self::Planar(elimination) => elimination.gather(force, p),
            Self::Spatial(elimination) => elimination.gather(force, p),
        }
    }
}

impl<const N: usize> Elimination<N> {
    fn new(plan: Arc<Plan>, threads: Threads) -> Self {
        let (count, free) = (plan.tree.len(), plan.tree.free_before(plan.tree.len()));
        let zero = [[0.0; N]; N];
        let motion = Motion { t: zero, alpha: zero, nu: zero };
        let column = Column { b: [0.0; N], alpha: [0.0; N], nu: [0.0; N] };
        // Work too small to be shared is the calling thread's.
        let shared = threads.are_several() && count * N * N >= SHARED;
        Self {
            threads: if shared { threads } else { Threads::default() },
            motions: vec![motion; count],
            columns: vec![column; free],
            real: Numbers::new(&plan),
            complex: None,
            plan,
        }
    }

    fn linearize(
        &mut self,
        [jacobian, moving]: [&[f64]; 2],
        blocks: &ReducedBlocks,
    ) -> Result<(), SingularMatrix> {
        let derivatives = &blocks.blocks;
        let at = Sources {
            plan: &self.plan,
            threads: &self.threads,
            rows: [jacobian, derivatives.a0.values(), derivatives.a1.values()],
            moving: [moving, blocks.turning.values(), blocks.turning_rate.values()],
        };
        let (motions, columns) = (&mut self.motions, &mut self.columns);
        self.threads.share(|| at.linearize(0, motions, columns))
    }

    fn factor(&mut self, sum: &Sum<'_, f64>) -> Result<(), SingularMatrix> {
        let Self { plan, threads, motions, columns, real, .. } = self;
        checkpoint(plan.tree.len() * N * N * N);
        let (growth, at) = threads.share(|| real.factor(plan, threads, motions, columns, sum))?;
        if growth <= LARGEST_GROWTH {
            return Ok(());
        }
        let row = plan.tree.rows(at)[N - 1] as usize;
        Err(SingularMatrix { row, column: plan.tree.body(at) * N, pivot: 1.0 / growth })
    }

    fn factor_complex(&mut self, sum: &Sum<'_, Complex64>) -> Result<(), SingularMatrix> {
        let Self { plan, threads, motions, columns, complex, .. } = self;
        checkpoint(plan.tree.len() * N * N * N);
        let numbers = complex.get_or_insert_with(|| Numbers::new(plan));
        let factor = || numbers.factor(plan, threads, motions, columns, sum);
        threads.share(factor).map(|_| ())
    }

    fn solve(&mut self, right: Right<'_, f64>) {
        let Self { plan, motions, columns, real, .. } = self;
        real.solve(plan, motions, columns, right);
    }

    fn solve_complex(&mut self, right: Right<'_, Complex64>) {
        let Self { plan, motions, columns, complex, .. } = self;
        complex.as_mut().expect("factored before").solve(plan, motions, columns, right);
    }
}

/// Where the rows of joints and of P come from, and (G q̇)_q, (G q̈ − τ)_q with what belongs to them in P.
struct Sources<'a> {
    plan: &'a Plan,
    threads: &'a Threads,
    rows: [&'a [f64]; 3],
    moving: [&'a [f64]; 3],
}

impl Sources<'_> {
    /// How the bodies from position `first` on follow their parents.
    fn linearize<const N: usize>(
        &self,
        first: usize,
        motions: &mut [Motion<N>],
        columns: &mut [Column<N>],
    ) -> Result<(), SingularMatrix> {
        let tree = &self.plan.tree;
        if motions.len() > GRAIN && self.threads.are_several() {
            let half = motions.len() / 2;
            let (left, right) = motions.split_at_mut(half);
            let middle = tree.free_before(first + half) - tree.free_before(first);
            let (left_columns, right_columns) = columns.split_at_mut(middle);
            let (left, right) = self.threads.join(
                || self.linearize(first, left, left_columns),
                || self.linearize(first + half, right, right_columns),
            );
            return left.and(right);
        }
        let before = tree.free_before(first);
        for (at, motion) in (first..).zip(motions) {
            // E and F, and in the same places Ã₀ and Ã₁.
            let mut values = [[[[0.0; N]; N]; 2]; 3];
            for (values, (rows, moving)) in
                values.iter_mut().zip(self.rows.iter().zip(&self.moving))
            {
                let values = values.as_flattened_mut().as_flattened_mut();
                for &(from, to) in self.plan.jacobian.at(at) {
                    values[to as usize] = rows[from as usize];
                }
                for &(from, to) in self.plan.moving.at(at) {
                    values[to as usize] = moving[from as usize];
                }
            }
            let [[e, f], [a0, a0_parent], [a1, a1_parent]] = &mut values;
            for &(x, to) in self.plan.constants.at(at) {
                let to = to as usize;
                let side = if to < N * N { &mut *e } else { &mut *f };
                side.as_flattened_mut()[to % (N * N)] = x;
            }
            let Some(inverse) = inverse(e) else {
                let row = tree.rows(at)[0] as usize;
                return Err(SingularMatrix { row, column: tree.body(at) * N, pivot: 0.0 });
            };
            let minus = scaled(-1.0, &inverse);
            let (minus_q0, minus_q1) = (product(&minus, a0), product(&minus, a1));
            if tree.parent(at).is_some() {
                let t = product(&minus, f);
                let mut alpha = product(&minus, a0_parent);
                add_product(&mut alpha, &minus_q0, &t);
                let mut nu = product(&minus, a1_parent);
                add_product(&mut nu, &minus_q1, &t);
                add_product(&mut nu, &scaled(2.0, &minus_q0), &alpha);
                let [t, alpha, nu] = [t, alpha, nu].map(|m| transposed(&m));
                *motion = Motion { t, alpha, nu };
            }
            let free = tree.free(at);
            let k = free.len();
            let columns = &mut columns[free.start - before..free.end - before];
            for (c, Column { b, alpha, nu }) in columns.iter_mut().enumerate() {
                *b = std::array::from_fn(|i| inverse[i][N - k + c]);
                (*alpha, *nu) = ([0.0; N], [0.0; N]);
                add_times(alpha, 1.0, &minus_q0, b);
                add_times(nu, 1.0, &minus_q1, b);
                add_times(nu, 2.0, &minus_q0, alpha);
            }
        }
        Ok(())
    }
}
