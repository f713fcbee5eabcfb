//! Which representation a run uses.

use super::descriptor::Unknowns;
use super::forest::ForestElimination;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions};
use super::sparse::SparseMatrix;
use crate::error::EvaluationFailure;
use crate::model::{JacobianSource, Representation};
use crate::reduction::{Manifold, Point};
use crate::system::Structure;
use holonom_linalg::{BlockGraph, Complex64, SingularMatrix, least_degree};

/// A matrix with dense blocks of order ndof, or the sparse one, as asked for or by predicted cost.
#[derive(Debug, Clone)]
pub enum Chosen<D> {
    /// Made of reduced blocks.
    Dense(D),
    /// With the graph of the mechanism.
    Sparse(Box<SparseMatrix>),
}

/// Operations with vectors, in dense products and factorizations, cost about this part of those of a substitution; those with
/// a sparse matrix, and of what a solution with it has beside, this multiple.
const LANE_COST: f64 = 0.07;
const SPARSE_COST: f64 = 2.0;
/// Factorizations to one linearization, and solves to one factorization, about: 3 to 6, and 9 to 27.
const FACTORIZATIONS: f64 = 4.0;
const SOLVES: f64 = 20.0;
/// An analysis costs about 200 solves with its factors, shared by some 25 factorizations of a run.
const ANALYSIS: f64 = 8.0;
/// The inflated matrix to the simplified one, about: 110 links and 280 loops.
const INFLATED: f64 = 1.6;
/// Cost of the elimination of a tree per coordinate, with vectors along the rows of its blocks: equal costs were measured for
/// chains of about 32 links in a plane and of 45 to 60 in space.
const TREE_ELIMINATION: f64 = 700.0;

/// Whether the simplified matrix may serve: not on trees, where nothing fills from body to body, and the inflated
/// one costs no more.
pub(super) fn prefers_simplified(manifold: &Manifold) -> bool {
    !ForestElimination::fits(manifold)
}

/// How many bodies each one is tied to when it is eliminated with its rows of joints, in an order of least degree.
fn widths(structure: &Structure) -> Vec<usize> {
    let bodies = structure.sizes.bodies;
    let body = |coordinate: usize| structure.sizes.place_of(coordinate).0;
    let mut touched = vec![Vec::new(); structure.sizes.rows];
    for (row, column, rows, _) in structure.constraint_pattern.shapes() {
        touched[row..row + rows].iter_mut().for_each(|bodies| bodies.push(body(column)));
    }
    let by_forces = structure.stiffness_pattern.shapes().map(|(i, j, ..)| [body(i), body(j)]);
    let by_joints = touched.iter().flat_map(|ends| ends.windows(2).map(|pair| [pair[0], pair[1]]));
    let edges: Vec<[usize; 2]> = by_forces.chain(by_joints).collect();
    let graph = BlockGraph::new(&vec![1; bodies], &edges);
    graph.factor_widths(&least_degree(&graph))
}

/// The predicted cost of what follows a linearization with a sparse matrix, in operations of a substitution: of a simplified
/// one, unless all of the Jacobian is needed.
fn sparse_cost(manifold: &Manifold, exact: bool) -> f64 {
    let structure = manifold.system().structure();
    let (n, bodies) = (structure.sizes.per_body as f64, structure.sizes.bodies as f64);
    if ForestElimination::fits(manifold) {
        return FACTORIZATIONS * TREE_ELIMINATION * bodies * n;
    }
    // A body has its coordinates and the rows of joints that others do not imply; where it is eliminated it leaves changes of its
    // neighbours' coordinates.
    let pivots = 2.0 * n - manifold.chart().ndof() as f64 / bodies;
    let (mut numbers, mut operations) = (0.0, 0.0);
    for width in widths(structure) {
        let width = width as f64;
        numbers += n * (2.0 * pivots - n + 2.0 * pivots * width);
        operations += n * n * pivots * (1.0 + width).powi(2);
    }
    let matrix = if exact { INFLATED } else { 1.0 };
    let solves = (SOLVES + ANALYSIS) * 2.0 * SPARSE_COST * numbers;
    FACTORIZATIONS * matrix * (operations + solves)
}

/// The predicted cost of a linearization with what follows it, with a dense matrix.
fn dense_cost(manifold: &Manifold) -> f64 {
    let structure = manifold.system().structure();
    let (chart, n) = (manifold.chart(), structure.sizes.coordinates as f64);
    let ndof = chart.ndof() as f64;
    let of_g = structure.constraint_pattern.len() as f64;
    let of_k = structure.stiffness_pattern.len() as f64;
    let blocks = 3.0 * (2.0 * of_k + 3.0 * of_g);
    let reduction = ndof * (2.0 * 4.0 * chart.fill() as f64 + 2.0 * blocks + 2.0 * n * ndof);
    let factor = ndof.powi(3) * 2.0 / 3.0;
    LANE_COST * (reduction + FACTORIZATIONS * factor) + FACTORIZATIONS * SOLVES * 2.0 * ndof * ndof
}

impl<D: Matrix> Matrix for Chosen<D> {
    fn new(manifold: &Manifold, q: &[f64], options: &MatrixOptions) -> Self {
        let sparse = match options.representation {
            Representation::Auto => sparse_cost(manifold, options.exact) < dense_cost(manifold),
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

    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        match self {
            Self::Dense(matrix) => matrix.weigh(parts, v),
            Self::Sparse(matrix) => matrix.weigh(parts, v),
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
