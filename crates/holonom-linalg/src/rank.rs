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

/// A = U Σ Vᵀ with k = min(m, n) singular values.
#[derive(Debug, Clone, PartialEq)]
pub struct ThinSvd {
    /// U, m×k by rows.
    pub u: Vec<f64>,
    /// Singular values, descending.
    pub s: Vec<f64>,
    /// V, n×k by rows.
    pub v: Vec<f64>,
}

/// Thin singular value decomposition of an m×n matrix by rows.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite or the decomposition does not converge.
pub fn thin_svd(m: usize, n: usize, a: &[f64]) -> Result<ThinSvd, DecompositionError> {
    check_finite(n, a)?;
    let k = m.min(n);
    if k == 0 {
        return Ok(ThinSvd { u: Vec::new(), s: Vec::new(), v: Vec::new() });
    }
    let svd = MatRef::from_row_major_slice(a, m, n)
        .thin_svd()
        .map_err(|_| DecompositionError::NoConvergence)?;
    let by_rows = |x: MatRef<'_, f64>| -> Vec<f64> {
        (0..x.nrows()).flat_map(|i| (0..k).map(move |j| x[(i, j)])).collect()
    };
    let s = svd.S().column_vector();
    Ok(ThinSvd { u: by_rows(svd.U()), s: (0..k).map(|i| s[i]).collect(), v: by_rows(svd.V()) })
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

/// Orthonormal basis of the null space of an m×n matrix of full row rank m ≤ n, by rows, from the
/// QR decomposition of its transpose.
///
/// Returns the basis as an n×(n − m) matrix by rows.
///
/// # Errors
/// [`DecompositionError`] when an entry is not finite.
///
/// # Panics
/// If m > n.
pub fn orthonormal_null_space_qr(
    m: usize,
    n: usize,
    a: &[f64],
) -> Result<Vec<f64>, DecompositionError> {
    assert!(m <= n, "a matrix of full row rank has not more rows than columns");
    check_finite(n, a)?;
    if m == 0 {
        return Ok((0..n * n).map(|e| f64::from(e % (n + 1) == 0)).collect());
    }
    // Rows of A one after the other are columns of Aᵀ.
    let q = MatRef::from_column_major_slice(a, n, m).qr().compute_Q();
    let mut basis = Vec::with_capacity(n * (n - m));
    for i in 0..n {
        basis.extend((m..n).map(|j| q[(i, j)]));
    }
    Ok(basis)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // truth: the product of the factors
    fn the_thin_decomposition_multiplies_to_the_matrix() {
        for (m, n) in [(5, 3), (3, 5), (4, 4)] {
            let a: Vec<f64> = (0..m * n).map(|e| (0.1 + 2.3 * (e * e) as f64).cos()).collect();
            let ThinSvd { u, s, v } = thin_svd(m, n, &a).unwrap();
            let k = m.min(n);
            for i in 0..m {
                for j in 0..n {
                    let found: f64 = (0..k).map(|p| u[i * k + p] * s[p] * v[j * k + p]).sum();
                    assert!((found - a[i * n + j]).abs() < 1e-14, "{m}×{n}");
                }
            }
        }
    }

    #[test] // truth: A V = 0 and VᵀV = I; the SVD spans the same space
    fn both_null_spaces_are_orthonormal_and_agree() {
        for (m, n) in [(0, 3), (1, 3), (3, 3), (4, 9)] {
            let a: Vec<f64> = (0..m * n).map(|e| (0.3 + 1.7 * (e * e) as f64).sin()).collect();
            let d = n - m;
            let v = orthonormal_null_space_qr(m, n, &a).unwrap();
            let (w, dimension) = orthonormal_null_space(m, n, &a, 1e-12).unwrap();
            assert_eq!((v.len(), dimension), (n * d, d));
            let product = |x: &[f64], y: &[f64], i: usize, j: usize| -> f64 {
                (0..n).map(|r| x[r * d + i] * y[r * d + j]).sum()
            };
            for j in 0..d {
                for i in 0..m {
                    let image: f64 = (0..n).map(|r| a[i * n + r] * v[r * d + j]).sum();
                    assert!(image.abs() < 1e-14, "{m}×{n}: {image:e}");
                }
                for i in 0..d {
                    assert!((product(&v, &v, i, j) - f64::from(i == j)).abs() < 1e-14);
                }
                // Every vector of one basis keeps its length when projected on the other.
                let length: f64 = (0..d).map(|i| product(&w, &v, i, j).powi(2)).sum();
                assert!((length - 1.0).abs() < 1e-13, "{m}×{n}: {length}");
            }
        }
    }
}
