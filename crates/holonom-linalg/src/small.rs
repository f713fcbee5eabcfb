//! Products and factors of matrices of a few rows, known when compiled; real ones with real or complex ones.

use crate::scalar::Scalar;

/// N×N by rows.
pub type Square<T, const N: usize> = [[T; N]; N];

/// out += A B.
#[inline(always)]
pub fn add_product<T: Scalar, const N: usize>(
    out: &mut Square<T, N>,
    a: &Square<T, N>,
    b: &Square<f64, N>,
) {
    for i in 0..N {
        for l in 0..N {
            for j in 0..N {
                out[i][j] = out[i][j] + a[i][l].scaled(b[l][j]);
            }
        }
    }
}

/// out += Aᵀ B.
#[inline(always)]
pub fn add_transposed_product<T: Scalar, const N: usize>(
    out: &mut Square<T, N>,
    a: &Square<f64, N>,
    b: &Square<T, N>,
) {
    for l in 0..N {
        for i in 0..N {
            for j in 0..N {
                out[i][j] = out[i][j] + b[l][j].scaled(a[l][i]);
            }
        }
    }
}

/// A B.
#[inline(always)]
pub fn product<const N: usize>(a: &Square<f64, N>, b: &Square<f64, N>) -> Square<f64, N> {
    let mut out = [[0.0; N]; N];
    add_product(&mut out, a, b);
    out
}

/// s A.
#[inline(always)]
pub fn scaled<T: Scalar, const N: usize>(s: T, a: &Square<T, N>) -> Square<T, N> {
    std::array::from_fn(|i| std::array::from_fn(|j| s * a[i][j]))
}

/// Aᵀ.
#[inline(always)]
pub fn transposed<T: Scalar, const N: usize>(a: &Square<T, N>) -> Square<T, N> {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// out += s A x.
#[inline(always)]
pub fn add_times<T: Scalar, const N: usize>(
    out: &mut [T; N],
    s: T,
    a: &Square<f64, N>,
    x: &[T; N],
) {
    for i in 0..N {
        let sum = (0..N).fold(T::ZERO, |sum, j| sum + x[j].scaled(a[i][j]));
        out[i] = out[i] + s * sum;
    }
}

/// out += A x for a matrix of the kind of x.
#[inline(always)]
pub fn add_own_times<T: Scalar, const N: usize>(out: &mut [T; N], a: &Square<T, N>, x: &[T; N]) {
    for i in 0..N {
        out[i] = (0..N).fold(out[i], |sum, j| sum + a[i][j] * x[j]);
    }
}

/// out += A x for a real x.
#[inline(always)]
pub fn add_times_real<T: Scalar, const N: usize>(out: &mut [T; N], a: &Square<T, N>, x: &[f64; N]) {
    for i in 0..N {
        out[i] = (0..N).fold(out[i], |sum, j| sum + a[i][j].scaled(x[j]));
    }
}

/// out += Aᵀ x.
#[inline(always)]
pub fn add_transposed_times<T: Scalar, const N: usize>(
    out: &mut [T; N],
    a: &Square<f64, N>,
    x: &[T; N],
) {
    for j in 0..N {
        for i in 0..N {
            out[i] = out[i] + x[j].scaled(a[j][i]);
        }
    }
}

/// The inverse by elimination with pivots that are large in their rows; none of a singular matrix.
#[inline(always)]
pub fn inverse<const N: usize>(a: &Square<f64, N>) -> Option<Square<f64, N>> {
    let mut a = *a;
    let mut out: Square<f64, N> =
        std::array::from_fn(|i| std::array::from_fn(|j| f64::from(u8::from(i == j))));
    let mut size: [f64; N] = std::array::from_fn(|i| a[i].iter().fold(0.0, |m, x| x.abs().max(m)));
    for k in 0..N {
        let (mut best, mut ratio) = (k, 0.0);
        for i in k..N {
            let here = a[i][k].abs() / size[i];
            if here > ratio {
                (best, ratio) = (i, here);
            }
        }
        // Written so that a NaN fails.
        let good = ratio > 32.0 * f64::EPSILON && ratio.is_finite();
        if !good {
            return None;
        }
        a.swap(best, k);
        out.swap(best, k);
        size.swap(best, k);
        let inverse = 1.0 / a[k][k];
        a[k].iter_mut().chain(&mut out[k]).for_each(|x| *x *= inverse);
        let (row, own) = (a[k], out[k]);
        for i in (0..N).filter(|i| *i != k) {
            let l = a[i][k];
            for j in 0..N {
                a[i][j] -= l * row[j];
                out[i][j] -= l * own[j];
            }
        }
    }
    Some(out)
}

/// LU of a k×k matrix by rows in place, with row exchanges in `pivots`; the diagonal of U holds inverse
/// pivots. `sizes` are those of the numbers that its diagonal was summed from. Returns how far pivots are
/// below these.
///
/// # Errors
/// The place of a pivot that vanishes or is not finite.
#[inline(always)]
pub fn factor<T: Scalar, const N: usize>(
    a: &mut [T],
    pivots: &mut [u8],
    k: usize,
    sizes: &[f64; N],
) -> Result<f64, usize> {
    let columns: [f64; N] = std::array::from_fn(|i| sizes[i].sqrt());
    let mut rows = columns;
    let mut growth = 0.0f64;
    for p in 0..k {
        let mut best = p;
        for i in p + 1..k {
            if a[i * k + p].size() * rows[best] > a[best * k + p].size() * rows[i] {
                best = i;
            }
        }
        pivots[p] = best as u8;
        if best != p {
            rows.swap(p, best);
            for j in 0..k {
                a.swap(p * k + j, best * k + j);
            }
        }
        let inverse = a[p * k + p].reciprocal();
        let here = inverse.size() * rows[p] * columns[p];
        // Written so that a NaN fails.
        if !here.is_finite() {
            return Err(p);
        }
        growth = growth.max(here);
        a[p * k + p] = inverse;
        for i in p + 1..k {
            let l = a[i * k + p] * inverse;
            a[i * k + p] = l;
            for j in p + 1..k {
                a[i * k + j] = a[i * k + j] - l * a[p * k + j];
            }
        }
    }
    Ok(growth)
}

/// Solves with the factors of [`factor`] in place: x(i) is read and written by `at(x, i)`.
#[inline(always)]
pub fn solve<T: Scalar, X>(
    a: &[T],
    pivots: &[u8],
    k: usize,
    x: &mut X,
    at: impl Fn(&mut X, usize) -> &mut T,
) {
    for p in 0..k {
        let best = usize::from(pivots[p]);
        if best != p {
            let (here, other) = (*at(x, p), *at(x, best));
            (*at(x, p), *at(x, best)) = (other, here);
        }
    }
    for i in 0..k {
        for j in 0..i {
            let other = *at(x, j);
            *at(x, i) = *at(x, i) - a[i * k + j] * other;
        }
    }
    for i in (0..k).rev() {
        for j in i + 1..k {
            let other = *at(x, j);
            *at(x, i) = *at(x, i) - a[i * k + j] * other;
        }
        *at(x, i) = *at(x, i) * a[i * k + i];
    }
}
