//! The inflated matrix of a tree of bodies, eliminated body by body from the leaves inwards.

mod numbers;
mod plan;

use super::blocks::ReducedBlocks;
use super::sparse_pattern::Sum;
use crate::reduction::{BodyRows, Manifold};
use crate::system::Structure;
use holonom_linalg::small::{Square, add_product, add_times, inverse, product, scaled};
use holonom_linalg::{Complex64, SingularMatrix};
use numbers::Numbers;
use plan::Plan;
use std::sync::Arc;

/// Growth of numbers in the elimination of a body that leaves nine digits; beyond it another order of pivots
/// is needed.
const LARGEST_GROWTH: f64 = 1e-9 / f64::EPSILON;

/// Elimination for bodies in a plane or in space.
#[derive(Debug, Clone)]
pub(super) enum ForestElimination {
    Planar(Box<Elimination<3>>),
    Spatial(Box<Elimination<7>>),
}

/// What one body has of the matrix and of its factors:
///
/// ```text
/// w = 𝒯 w_p + ℬ ρ + g      H w + L w_p + Eᵀλ̃ = φ      w = (x, y, a)
/// ```
///
/// with the subscript p for the parent, E and F the body's rows of G̃, T = −E⁻¹F, and λ̃ = 0 in the rows of P.
/// Equations: `docs/theory/newton.md` (15)-(21).
#[derive(Debug, Clone)]
pub(super) struct Elimination<const N: usize> {
    plan: Arc<Plan>,
    /// E and F, and in the same places Ã₀ and Ã₁.
    joints: Vec<f64>,
    a0: Vec<f64>,
    a1: Vec<f64>,
    motions: Vec<Motion<N>>,
    columns: Vec<Column<N>>,
    real: Numbers<f64, N>,
    complex: Option<Numbers<Complex64, N>>,
}

/// How a body follows its parent, apart from its independent variables and from the step: E⁻¹, T, and with
/// Q₀ = E⁻¹Ã₀, Q₁ = E⁻¹Ã₁ of the body and Q₀ₚ, Q₁ₚ of its parent α = −(Q₀T + Q₀ₚ), κ = −(Q₁T + Q₁ₚ), μ = −Q₀α.
#[derive(Debug, Clone)]
struct Motion<const N: usize> {
    inverse: Square<f64, N>,
    t: Square<f64, N>,
    q0: Square<f64, N>,
    q1: Square<f64, N>,
    alpha: Square<f64, N>,
    kappa: Square<f64, N>,
    mu: Square<f64, N>,
}

/// What an independent variable does: its column of E⁻¹, b, with −Q₀b, −Q₁b and Q₀Q₀b.
#[derive(Debug, Clone)]
struct Column<const N: usize> {
    b: [f64; N],
    alpha: [f64; N],
    kappa: [f64; N],
    mu: [f64; N],
}

impl ForestElimination {
    /// Whether there is one for the manifold's present parametrization.
    pub(super) fn fits(manifold: &Manifold) -> bool {
        manifold.chart().forest().is_some_and(|forest| Plan::new(manifold, forest).is_some())
    }

    /// For the manifold's present parametrization, if the bodies form a forest in which forces couple
    /// neighbours only.
    pub(super) fn new(manifold: &Manifold) -> Option<Self> {
        let plan = Arc::new(Plan::new(manifold, manifold.chart().forest()?)?);
        Some(match plan.forest.size() {
            3 => Self::Planar(Box::new(Elimination::new(plan))),
            _ => Self::Spatial(Box::new(Elimination::new(plan))),
        })
    }

    /// Takes the rows of joints and of P with their derivatives.
    pub(super) fn linearize(
        &mut self,
        jacobian: &[f64],
        moving: &BodyRows,
        blocks: &ReducedBlocks,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.linearize(jacobian, moving, blocks),
            Self::Spatial(elimination) => elimination.linearize(jacobian, moving, blocks),
        }
    }

    /// Factors for real coefficients.
    pub(super) fn factor(
        &mut self,
        structure: &Structure,
        sum: &Sum<'_, f64>,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.factor(structure, sum),
            Self::Spatial(elimination) => elimination.factor(structure, sum),
        }
    }

    /// Factors for complex ones, beside the real factor.
    pub(super) fn factor_complex(
        &mut self,
        structure: &Structure,
        sum: &Sum<'_, Complex64>,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Planar(elimination) => elimination.factor_complex(structure, sum),
            Self::Spatial(elimination) => elimination.factor_complex(structure, sum),
        }
    }

    /// Solves in place for the right-hand sides f₁, f₂, f₃, f₄; the solution is x, y, a and below them the
    /// multipliers and ρ. Multipliers only if `multipliers`.
    pub(super) fn solve(&mut self, right: &mut [f64], blocks: &ReducedBlocks, multipliers: bool) {
        match self {
            Self::Planar(elimination) => elimination.solve(right, blocks, multipliers),
            Self::Spatial(elimination) => elimination.solve(right, blocks, multipliers),
        }
    }

    /// The same with the complex factor, without multipliers.
    pub(super) fn solve_complex(&mut self, right: &mut [Complex64], blocks: &ReducedBlocks) {
        match self {
            Self::Planar(elimination) => elimination.solve_complex(right, blocks),
            Self::Spatial(elimination) => elimination.solve_complex(right, blocks),
        }
    }
}

impl<const N: usize> Elimination<N> {
    fn new(plan: Arc<Plan>) -> Self {
        let (count, free) = (plan.forest.len(), plan.first[plan.forest.len()]);
        let zero = [[0.0; N]; N];
        let motion = Motion {
            inverse: zero,
            t: zero,
            q0: zero,
            q1: zero,
            alpha: zero,
            kappa: zero,
            mu: zero,
        };
        let column = Column { b: [0.0; N], alpha: [0.0; N], kappa: [0.0; N], mu: [0.0; N] };
        let values = plan.forest.values();
        Self {
            joints: vec![0.0; values],
            a0: vec![0.0; values],
            a1: vec![0.0; values],
            motions: vec![motion; count],
            columns: vec![column; free],
            real: Numbers::new(&plan),
            complex: None,
            plan,
        }
    }

    fn linearize(
        &mut self,
        jacobian: &[f64],
        moving: &BodyRows,
        blocks: &ReducedBlocks,
    ) -> Result<(), SingularMatrix> {
        let plan = &*self.plan;
        let derivatives = &blocks.blocks;
        let sources = [
            (&mut self.joints, jacobian, moving.values()),
            (&mut self.a0, derivatives.a0.values(), blocks.turning.values()),
            (&mut self.a1, derivatives.a1.values(), blocks.turning_rate.values()),
        ];
        for (to, jacobian, moving) in sources {
            for &(at, slot) in &plan.jacobian {
                to[slot as usize] = jacobian[at as usize];
            }
            for &(at, slot) in &plan.moving {
                to[slot as usize] = moving[at as usize];
            }
        }
        for &(x, slot) in &plan.constants {
            self.joints[slot as usize] = x;
        }
        for (block, motion) in self.motions.iter_mut().enumerate() {
            let at = |values: &[f64], side: usize| -> Square<f64, N> {
                let (rows, _) = values.as_chunks::<N>();
                *rows[(2 * block + side) * N..].first_chunk().expect("N rows")
            };
            let e = at(&self.joints, 0);
            let Some(inverse) = inverse(&e) else {
                let row = plan.forest.rows(block)[0] as usize;
                return Err(SingularMatrix { row, column: block * N, pivot: 0.0 });
            };
            let minus = scaled(-1.0, &inverse);
            motion.inverse = inverse;
            motion.q0 = product(&inverse, &at(&self.a0, 0));
            motion.q1 = product(&inverse, &at(&self.a1, 0));
            if plan.forest.parent(block).is_some() {
                motion.t = product(&minus, &at(&self.joints, 1));
                motion.alpha = product(&minus, &at(&self.a0, 1));
                add_product(&mut motion.alpha, &scaled(-1.0, &motion.q0), &motion.t);
                motion.kappa = product(&minus, &at(&self.a1, 1));
                add_product(&mut motion.kappa, &scaled(-1.0, &motion.q1), &motion.t);
                motion.mu = product(&scaled(-1.0, &motion.q0), &motion.alpha);
            }
            let free = plan.free(block);
            let k = free.len();
            for (c, column) in self.columns[free].iter_mut().enumerate() {
                column.b = std::array::from_fn(|i| inverse[i][N - k + c]);
                (column.alpha, column.kappa, column.mu) = ([0.0; N], [0.0; N], [0.0; N]);
                add_times(&mut column.alpha, -1.0, &motion.q0, &column.b);
                add_times(&mut column.kappa, -1.0, &motion.q1, &column.b);
                add_times(&mut column.mu, -1.0, &motion.q0, &column.alpha);
            }
        }
        Ok(())
    }

    fn factor(&mut self, structure: &Structure, sum: &Sum<'_, f64>) -> Result<(), SingularMatrix> {
        let growth = self.real.factor(&self.plan, &self.motions, &self.columns, structure, sum)?;
        match growth {
            (size, _) if size <= LARGEST_GROWTH => Ok(()),
            (size, block) => {
                let row = self.plan.forest.rows(block)[N - 1] as usize;
                Err(SingularMatrix { row, column: block * N, pivot: 1.0 / size })
            }
        }
    }

    fn factor_complex(
        &mut self,
        structure: &Structure,
        sum: &Sum<'_, Complex64>,
    ) -> Result<(), SingularMatrix> {
        let numbers = self.complex.get_or_insert_with(|| Numbers::new(&self.plan));
        numbers.factor(&self.plan, &self.motions, &self.columns, structure, sum).map(|_| ())
    }

    fn solve(&mut self, right: &mut [f64], blocks: &ReducedBlocks, multipliers: bool) {
        let Self { plan, motions, columns, real, .. } = self;
        real.solve(plan, motions, columns, right, blocks, multipliers);
    }

    fn solve_complex(&mut self, right: &mut [Complex64], blocks: &ReducedBlocks) {
        let Self { plan, motions, columns, complex, .. } = self;
        let numbers = complex.as_mut().expect("factored before");
        numbers.solve(plan, motions, columns, right, blocks, false);
    }
}
