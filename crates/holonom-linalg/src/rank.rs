use faer::MatRef;

use crate::error::DecompositionError;

/// Result of [`least_norm`].
#[derive(Debug, Clone, PartialEq)]
pub struct LeastNorm {
    /// The shortest of all x that make ‖A x − b‖₂ least.
    pub x: Vec<f64>,
    /// Number of singular values above the tolerance.
    pub rank: usize,
    /// ‖A x − b‖₂.
    pub residual_norm: f64,
}

/// Least-squares solution of least norm of A x = b, with A m×n by rows, of any rank.
///
/// Singular values up to `relative_rank_tolerance` times the largest count as zero.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite or the decomposition does not converge.
pub fn least_norm(
    m: usize,
    n: usize,
    a: &[f64],
    b: &[f64],
    relative_rank_tolerance: f64,
) -> Result<LeastNorm, DecompositionError> {
    check_finite(n, a)?;
    check_finite(1, b)?;
    let mut x = vec![0.0; n];
    let mut rank = 0;
    if m > 0 && n > 0 {
        let svd = MatRef::from_row_major_slice(a, m, n)
            .thin_svd()
            .map_err(|_| DecompositionError::NoConvergence)?;
        let (u, s, v) = (svd.U(), svd.S().column_vector(), svd.V());
        while rank < m.min(n) && s[rank] > relative_rank_tolerance * s[0] {
            let dot: f64 = (0..m).map(|i| u[(i, rank)] * b[i]).sum();
            for j in 0..n {
                x[j] += v[(j, rank)] * (dot / s[rank]);
            }
            rank += 1;
        }
    }
    let residual = (0..m).map(|i| {
        let row = &a[i * n..(i + 1) * n];
        row.iter().zip(&x).map(|(a, x)| a * x).sum::<f64>() - b[i]
    });
    let residual_norm = residual.map(|r| r * r).sum::<f64>().sqrt();
    Ok(LeastNorm { x, rank, residual_norm })
}

/// Singular values of an m×n matrix by rows, descending.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite or the decomposition does not converge.
pub fn singular_values(m: usize, n: usize, a: &[f64]) -> Result<Vec<f64>, DecompositionError> {
    check_finite(n, a)?;
    if m == 0 || n == 0 {
        return Ok(Vec::new());
    }
    MatRef::from_row_major_slice(a, m, n)
        .singular_values()
        .map_err(|_| DecompositionError::NoConvergence)
}

/// Orthonormal basis of the null space of an m×n matrix by rows.
///
/// Returns the basis as an n×d matrix by rows, and d = n − rank. Singular values up to
/// `relative_rank_tolerance` times the largest count as zero.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite or the decomposition does not converge.
pub fn orthonormal_null_space(
    m: usize,
    n: usize,
    a: &[f64],
    relative_rank_tolerance: f64,
) -> Result<(Vec<f64>, usize), DecompositionError> {
    check_finite(n, a)?;
    if m == 0 || n == 0 {
        let identity = (0..n * n).map(|e| f64::from(e % (n + 1) == 0)).collect();
        return Ok((identity, n));
    }
    let svd = MatRef::from_row_major_slice(a, m, n)
        .svd()
        .map_err(|_| DecompositionError::NoConvergence)?;
    let (s, v) = (svd.S().column_vector(), svd.V());
    let rank = (0..m.min(n)).take_while(|&i| s[i] > relative_rank_tolerance * s[0]).count();
    let dimension = n - rank;
    let mut basis = Vec::with_capacity(n * dimension);
    for i in 0..n {
        basis.extend((rank..n).map(|j| v[(i, j)]));
    }
    Ok((basis, dimension))
}

/// Eigenvalues (real part, imaginary part) of a general real n×n matrix by rows.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite or the iteration does not converge.
pub fn eigenvalues(n: usize, a: &[f64]) -> Result<Vec<(f64, f64)>, DecompositionError> {
    check_finite(n, a)?;
    if n == 0 {
        return Ok(Vec::new());
    }
    let values = MatRef::from_row_major_slice(a, n, n)
        .eigenvalues()
        .map_err(|_| DecompositionError::NoConvergence)?;
    Ok(values.into_iter().map(|z| (z.re, z.im)).collect())
}

fn check_finite(n: usize, a: &[f64]) -> Result<(), DecompositionError> {
    match a.iter().position(|v| !v.is_finite()) {
        Some(e) => Err(DecompositionError::NotFinite { row: e / n, column: e % n, value: a[e] }),
        None => Ok(()),
    }
}
