//! faer's general sparse LU, to compare with.

use crate::error::SingularMatrix;
use crate::sparse::SparsePattern;
use faer::MatMut;
use faer::linalg::solvers::SolveCore;
use faer::sparse::linalg::solvers::{Lu, SymbolicLu};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};

/// A sparse LU with partial pivoting at every factorisation; its order of columns is chosen once, from the
/// pattern. It allocates at every factorisation.
#[derive(Debug, Clone)]
pub struct GeneralSparseLu {
    symbolic: SymbolicLu<u32>,
}

fn view(pattern: &SparsePattern) -> SymbolicSparseColMatRef<'_, u32> {
    // Compressed rows of A are compressed columns of its transpose.
    let (rows, columns) = (pattern.row_pointers(), pattern.columns());
    SymbolicSparseColMatRef::new_checked(pattern.n_cols(), pattern.n_rows(), rows, None, columns)
}

fn singular() -> SingularMatrix {
    SingularMatrix { row: 0, column: 0, pivot: 0.0 }
}

impl GeneralSparseLu {
    /// The symbolic part.
    ///
    /// # Errors
    /// [`SingularMatrix`] without a place when the library refuses the pattern.
    pub fn new(pattern: &SparsePattern) -> Result<Self, SingularMatrix> {
        let symbolic = SymbolicLu::try_new(view(pattern)).map_err(|_| singular())?;
        Ok(Self { symbolic })
    }

    /// Factors the matrix with these values and solves A x = b in place.
    ///
    /// # Errors
    /// [`SingularMatrix`] without a place when the library finds no pivot.
    pub fn solve(
        &self,
        pattern: &SparsePattern,
        values: &[f64],
        b: &mut [f64],
    ) -> Result<(), SingularMatrix> {
        let matrix = SparseColMatRef::new(view(pattern), values);
        let lu =
            Lu::try_new_with_symbolic(self.symbolic.clone(), matrix).map_err(|_| singular())?;
        let n = b.len();
        lu.solve_transpose_in_place_with_conj(
            faer::Conj::No,
            MatMut::from_column_major_slice_mut(b, n, 1),
        );
        Ok(())
    }
}
