//! Matrices for Holonom. This crate knows blocks, patterns and permutations; it knows no bodies.
//!
//! | matrix | type | made for |
//! |---|---|---|
//! | dense blocks at fixed places | [`BlockMatrix`] | assembly, products |
//! | general sparse, fixed pattern | [`SparsePattern`], [`SparseLu`], [`FrozenLu`] | factor again and again |
//! | sums of values of other matrices | [`Terms`], [`Assembly`] | which value goes where, found once |
//! | blocks that hang on each other like a forest | [`BlockForest`], [`ForestLu`] | trees of bodies, without fill |
//! | symmetric, small blocks, in an envelope | [`BlockGraph`], [`EnvelopePlan`], [`EnvelopeCholesky`] | reduced matrices of mechanisms |
//! | symmetric, zeros along the branches of a tree | [`BranchedPlan`], [`BranchedCholesky`] | inertia in joint coordinates, without fill |
//! | tall sparse, at set-up | [`independent_rows`] | rank, independent variables |
//! | dense, square | [`DenseLu`], [`Cholesky`], [`DenseComplexLu`] | integration Jacobians |
//! | dense, of a few rows | [`small`] | blocks of bodies |
//! | dense, any shape, at set-up | [`least_norm`], [`full_pivot_elimination`], … | rank, assembly |
//!
//! At the interface a matrix is a slice of `f64` stored by rows: entry (i, j) of an m×n matrix is
//! at `i * n + j`, and k right-hand sides of n rows are an n×k matrix. What runs in a step loop
//! (`factor`, `refactor`, `solve…`, `multiply…`) allocates nothing after set-up.

mod block;
mod branched;
mod complex;
mod condition;
mod dense;
mod envelope;
mod error;
mod few_rows;
mod forest;
mod full_pivot;
#[cfg(feature = "general-sparse")]
mod general;
mod gram;
mod independent_rows;
mod lanes;
mod rank;
mod scalar;
pub mod small;
mod sparse;
pub mod threads;
pub mod watch;

pub use block::{BlockId, BlockMatrix, BlockPattern, BlocksMut};
pub use branched::{BranchedCholesky, BranchedPlan, CutRows, DenseAugmented, Operations, Stages};
pub use complex::{Complex64, DenseComplexLu};
pub use dense::{Cholesky, DenseLu, add_product};
pub use envelope::{
    BlockGraph, EnvelopeCholesky, EnvelopePlan, LARGEST_BLOCK, gibbs_king, least_degree,
    least_envelope, reverse_cuthill_mckee,
};
pub use error::{DecompositionError, NotPositiveDefinite, SingularMatrix};
pub use forest::{BlockForest, ForestLu};
pub use full_pivot::{FullPivot, full_pivot_elimination};
#[cfg(feature = "general-sparse")]
pub use general::GeneralSparseLu;
pub use gram::{GRAM_ROWS, gram_add, gram_spans_add};
pub use independent_rows::{Claim, IndependentRows, OfferedRow, independent_rows};
pub use lanes::{Arithmetic, Span, Wide, add_entries, dot, run_wide, scale_rows};
pub use rank::{
    LeastNorm, ThinSvd, eigenvalues, least_norm, orthonormal_null_space, orthonormal_null_space_qr,
    singular_values, thin_svd,
};
pub use scalar::Scalar;
pub use sparse::{Assembly, FrozenLu, Pivots, SparseLu, SparsePattern, Terms, sparse_least_norm};
