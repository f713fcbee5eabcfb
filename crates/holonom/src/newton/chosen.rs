//! Which representation a run uses.

use super::descriptor::Unknowns;
use super::differences::JacobianSource;
use super::forest::ForestElimination;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions, Representation};
use super::sparse::SparseMatrix;
use crate::error::EvaluationFailure;
use crate::reduction::{Manifold, Point};
use holonom_linalg::{Complex64, SingularMatrix};

/// A matrix with dense blocks of order ndof, or the sparse one, as asked for or by predicted cost.
#[derive(Debug, Clone)]
pub enum Chosen<D> {
    /// Made of reduced blocks.
    Dense(D),
    /// With the graph of the mechanism.
    Sparse(Box<SparseMatrix>),
}

/// Operations with vectors cost about this part of single ones.
const LANE_COST: f64 = 0.25;
/// Cost of a factorization that follows entries, with its solves, per entry and entry of a row, in the operations of a dense
/// one, about: equal costs were measured for planar ladders of 145 loops with the simplified and of 280 with the inflated matrix.
const ELIMINATION: f64 = 15.0;
/// The same of the elimination of a tree per body and cube of its coordinates: equal costs were measured for
/// chains of 36 links in a plane and of about 70 in space.
const TREE_ELIMINATION: f64 = 60.0;
/// Factorizations to one linearization, and solves to one factorization, about.
const FACTORIZATIONS: f64 = 5.0;
const SOLVES: f64 = 6.0;
/// Iterations with the simplified matrix to those with the inflated one, about.
const SLOWER: f64 = 1.2;

/// Predicted cost where a matrix of this order has so many entries.
fn elimination(entries: f64, order: f64) -> f64 {
    ELIMINATION * entries * entries / order.max(1.0)
}

/// The predicted cost of a linearization with what follows it, of the inflated and of the simplified matrix.
fn sparse_costs(manifold: &Manifold) -> [f64; 2] {
    let structure = manifold.system().structure();
    let (chart, n) = (manifold.chart(), structure.sizes.coordinates as f64);
    let ndof = chart.ndof() as f64;
    let of_g = structure.constraint_pattern.len() as f64;
    let of_k = structure.stiffness_pattern.len() as f64;
    if ForestElimination::fits(manifold) {
        // From body to body nothing fills: the inflated matrix costs about what the simplified one does by its entries.
        let square = (structure.sizes.per_body * structure.sizes.per_body) as f64;
        return [FACTORIZATIONS * TREE_ELIMINATION * n * square, f64::INFINITY];
    }
    let entries = 3.0 * chart.fill() as f64 + 3.0 * of_g + 2.0 * of_k + 3.0 * ndof;
    let simplified = SLOWER * elimination(of_k + 2.0 * of_g, 2.0 * n - ndof);
    [elimination(entries, 4.0 * n), simplified].map(|cost| FACTORIZATIONS * cost)
}

/// Whether the simplified matrix is predicted to cost less than the inflated one.
pub(super) fn prefers_simplified(manifold: &Manifold) -> bool {
    let [inflated, simplified] = sparse_costs(manifold);
    simplified < inflated
}

/// The predicted cost of a linearization with what follows it: dense, and sparse, simplified where that may serve.
fn costs(manifold: &Manifold, exact: bool) -> (f64, f64) {
    let structure = manifold.system().structure();
    let (chart, n) = (manifold.chart(), structure.sizes.coordinates as f64);
    let ndof = chart.ndof() as f64;
    let of_g = structure.constraint_pattern.len() as f64;
    let of_k = structure.stiffness_pattern.len() as f64;
    let blocks = 3.0 * (2.0 * of_k + 3.0 * of_g);
    let reduction = ndof * (2.0 * 4.0 * chart.fill() as f64 + 2.0 * blocks + 2.0 * n * ndof);
    let factor = ndof.powi(3) * 2.0 / 3.0;
    let dense = LANE_COST * (reduction + FACTORIZATIONS * (factor + SOLVES * 2.0 * ndof * ndof));
    let [inflated, simplified] = sparse_costs(manifold);
    (dense, if exact { inflated } else { inflated.min(simplified) })
}

impl<D: Matrix> Matrix for Chosen<D> {
    fn new(manifold: &Manifold, q: &[f64], options: &MatrixOptions) -> Self {
        let sparse = match options.representation {
            Representation::Auto => {
                let (dense, sparse) = costs(manifold, options.exact);
                sparse < dense
            }
            stated => stated.is_sparse(),
        };
        if sparse && options.source == JacobianSource::Analytic {
            Self::Sparse(Box::new(SparseMatrix::new(manifold, q, options)))
        } else {
            Self::Dense(D::new(manifold, q, options))
        }
    }

    fn simplify(&mut self, simplify: bool) {
        match self {
            Self::Dense(matrix) => matrix.simplify(simplify),
            Self::Sparse(matrix) => matrix.simplify(simplify),
        }
    }

    fn is_simplified(&self) -> bool {
        match self {
            Self::Dense(matrix) => matrix.is_simplified(),
            Self::Sparse(matrix) => matrix.is_simplified(),
        }
    }

    fn is_reduced(&self) -> bool {
        match self {
            Self::Dense(matrix) => matrix.is_reduced(),
            Self::Sparse(matrix) => matrix.is_reduced(),
        }
    }

    fn goes_along(&self) -> bool {
        match self {
            Self::Dense(matrix) => matrix.goes_along(),
            Self::Sparse(matrix) => matrix.goes_along(),
        }
    }

    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point) {
        match self {
            Self::Dense(matrix) => matrix.linearize(parts, point),
            Self::Sparse(matrix) => matrix.linearize(parts, point),
        }
    }

    fn take_blocks(&mut self, parts: &Linearization, manifold: &Manifold) {
        match self {
            Self::Dense(matrix) => matrix.take_blocks(parts, manifold),
            Self::Sparse(matrix) => matrix.take_blocks(parts, manifold),
        }
    }

    fn factor(&mut self, parts: &Linearization) -> Result<u64, SingularMatrix> {
        match self {
            Self::Dense(matrix) => matrix.factor(parts),
            Self::Sparse(matrix) => matrix.factor(parts),
        }
    }

    fn respond(
        &mut self,
        parts: &mut Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        match self {
            Self::Dense(matrix) => matrix.respond(parts, p, v, z, rate),
            Self::Sparse(matrix) => matrix.respond(parts, p, v, z, rate),
        }
    }
}

impl<D: FirstOrderMatrix> FirstOrderMatrix for Chosen<D> {
    fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]) {
        match self {
            Self::Dense(matrix) => matrix.correct(parts, z, rate),
            Self::Sparse(matrix) => matrix.correct(parts, z, rate),
        }
    }

    fn solve(&mut self, parts: &mut Linearization, p: &mut [f64], v: &mut [f64], z: &[f64]) {
        match self {
            Self::Dense(matrix) => matrix.solve(parts, p, v, z),
            Self::Sparse(matrix) => matrix.solve(parts, p, v, z),
        }
    }

    fn factor_complex(
        &mut self,
        parts: &Linearization,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix> {
        match self {
            Self::Dense(matrix) => matrix.factor_complex(parts, gamma_h),
            Self::Sparse(matrix) => matrix.factor_complex(parts, gamma_h),
        }
    }

    fn solve_complex(&mut self, parts: &mut Linearization, x: &mut [f64], y: &mut [f64]) {
        match self {
            Self::Dense(matrix) => matrix.solve_complex(parts, x, y),
            Self::Sparse(matrix) => matrix.solve_complex(parts, x, y),
        }
    }

    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        match self {
            Self::Dense(matrix) => matrix.weigh(parts, v),
            Self::Sparse(matrix) => matrix.weigh(parts, v),
        }
    }

    fn time_derivative(
        &mut self,
        parts: &mut Linearization,
        point: &mut Point,
        v_rate: &mut [f64],
        z_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        match self {
            Self::Dense(matrix) => matrix.time_derivative(parts, point, v_rate, z_rate),
            Self::Sparse(matrix) => matrix.time_derivative(parts, point, v_rate, z_rate),
        }
    }
}

impl<D: DescriptorForm> DescriptorForm for Chosen<D> {
    fn correct_unknowns(&mut self, parts: &mut Linearization, z: &[f64], x: &mut Unknowns) {
        match self {
            Self::Dense(matrix) => matrix.correct_unknowns(parts, z, x),
            Self::Sparse(matrix) => matrix.correct_unknowns(parts, z, x),
        }
    }
}
