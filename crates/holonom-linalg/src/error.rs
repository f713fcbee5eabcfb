use thiserror::Error;

/// A square matrix that cannot be factored: no usable pivot was left.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("matrix is singular to working precision: pivot {pivot:.3e} at row {row}, column {column}")]
pub struct SingularMatrix {
    /// Row of the matrix (original numbering) where elimination stopped.
    pub row: usize,
    /// Column of the matrix (original numbering) where elimination stopped.
    pub column: usize,
    /// The pivot that was found there; zero, negligible, or not finite.
    pub pivot: f64,
}

/// A symmetric matrix that is not positive definite.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
#[error("matrix is not positive definite: pivot {pivot:.3e} at index {index}")]
pub struct NotPositiveDefinite {
    /// Row (and column) of the first pivot that is not positive.
    pub index: usize,
    /// That pivot: what is left of the diagonal entry after eliminating the rows before it.
    pub pivot: f64,
}

/// Why a dense decomposition of set-up gave no result.
#[derive(Debug, Clone, Copy, PartialEq, Error)]
pub enum DecompositionError {
    /// An entry of the matrix is infinite or not a number.
    #[error("matrix entry ({row}, {column}) is {value}; every entry must be finite")]
    NotFinite {
        /// Row of the entry.
        row: usize,
        /// Column of the entry.
        column: usize,
        /// The entry.
        value: f64,
    },
    /// The iteration for singular values or eigenvalues did not converge.
    #[error("the iteration for singular values or eigenvalues did not converge")]
    NoConvergence,
}
