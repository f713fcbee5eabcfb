//! Symmetric matrices of an edge: a few numbers, of a size known where the code is made.

/// Cholesky factor of the leading block of a matrix whose lower triangle is given, its diagonal inverted.
#[inline(always)]
pub(super) fn factor<const M: usize>(a: &mut [[f64; M]; M], n: usize) -> bool {
    for i in 0..n {
        let given = a[i][i];
        for j in 0..=i {
            let mut x = a[i][j];
            for k in 0..j {
                x -= a[i][k] * a[j][k];
            }
            if i == j {
                if x.is_nan() || x <= 32.0 * f64::EPSILON * given {
                    return false;
                }
                a[i][i] = x.sqrt().recip();
            } else {
                a[i][j] = x * a[j][j];
            }
        }
    }
    true
}

/// Solves with the factor in place.
#[inline(always)]
pub(super) fn substitute<const M: usize>(l: &[[f64; M]; M], n: usize, b: &mut [f64; M]) {
    for i in 0..n {
        for j in 0..i {
            b[i] -= l[i][j] * b[j];
        }
        b[i] *= l[i][i];
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] -= l[j][i] * b[j];
        }
        b[i] *= l[i][i];
    }
}
