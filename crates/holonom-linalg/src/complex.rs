use crate::error::SingularMatrix;
use crate::lanes::{Arithmetic, Wide, run_wide};
use crate::scalar::Scalar;
use std::ops::Range;

pub use num_complex::Complex64;

/// A pivot below this fraction of its column's largest entry is cancellation noise.
const NEGLIGIBLE: f64 = 4.0 * f64::EPSILON;

/// LU factorisation with row exchanges of a dense complex n×n matrix; its storage is reused.
///
/// Real and imaginary parts stand apart, so that loops along rows become vector instructions. Sizes are measured by
/// |Re| + |Im|, which is within √2 of the modulus and needs no root.
#[derive(Debug, Clone)]
pub struct DenseComplexLu {
    n: usize,
    re: Vec<f64>,
    im: Vec<f64>,
    inverse_pivot: Vec<Complex64>,
    /// Row `exchange[i] ≥ i` took the place of row i at step i.
    exchange: Vec<usize>,
}

impl DenseComplexLu {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        let zero = Complex64::new(0.0, 0.0);
        Self {
            n,
            re: vec![0.0; n * n],
            im: vec![0.0; n * n],
            inverse_pivot: vec![zero; n],
            exchange: vec![0; n],
        }
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Factors `a` (n×n by rows).
    ///
    /// # Errors
    /// [`SingularMatrix`] when a column has no pivot above round-off; `row` is then the position
    /// of elimination, equal to `column`, and `pivot` the size of what was found.
    pub fn factor(&mut self, a: &[Complex64]) -> Result<(), SingularMatrix> {
        let n = self.n;
        let Self { re, im, .. } = self;
        for ((re, im), a) in re.iter_mut().zip(&mut *im).zip(a) {
            (*re, *im) = (a.re, a.im);
        }
        for p in 0..n {
            // What elimination has subtracted in this column tells the size of round-off.
            let (mut at, mut pivot, mut peak) = (p, 0.0, 0.0f64);
            for i in 0..n {
                let size = re[i * n + p].abs() + im[i * n + p].abs();
                peak = peak.max(size);
                if i == p || (i > p && size > pivot) {
                    (at, pivot) = (i, size);
                }
            }
            self.exchange[p] = at;
            if !(pivot > NEGLIGIBLE * peak && (1.0 / pivot).is_finite()) {
                return Err(SingularMatrix { row: p, column: p, pivot });
            }
            let parts = [&mut *re, &mut *im].map(|part| {
                let (upper, lower) = part.split_at_mut((p + 1) * n);
                if at != p {
                    upper[p * n..].swap_with_slice(&mut lower[(at - p - 1) * n..(at - p) * n]);
                }
                (&upper[p * n + p..], lower)
            });
            let [(pivots_re, lower_re), (pivots_im, lower_im)] = parts;
            let inverse = Complex64::new(pivots_re[0], pivots_im[0]).reciprocal();
            self.inverse_pivot[p] = inverse;
            let pivots = [&pivots_re[1..], &pivots_im[1..]];
            run_wide(Elimination { rows: [lower_re, lower_im], n, p, inverse, pivots });
        }
        Ok(())
    }

    /// Solves A x = b in place.
    pub fn solve(&self, b: &mut [Complex64]) {
        let n = self.n;
        for p in 0..n {
            b.swap(p, self.exchange[p]);
        }
        for i in 0..n {
            b[i] -= self.times(i * n..i * n + i, &b[..i]);
        }
        for i in (0..n).rev() {
            let rest = b[i] - self.times(i * n + i + 1..(i + 1) * n, &b[i + 1..]);
            b[i] = rest * self.inverse_pivot[i];
        }
    }

    /// Sum of these entries of the factors times x.
    fn times(&self, entries: Range<usize>, x: &[Complex64]) -> Complex64 {
        let (mut re, mut im) = (0.0, 0.0);
        for ((a, b), x) in self.re[entries.clone()].iter().zip(&self.im[entries]).zip(x) {
            re += a * x.re - b * x.im;
            im += a * x.im + b * x.re;
        }
        Complex64::new(re, im)
    }
}

/// Elimination with the entries `pivots` behind a pivot at p, in rows of n entries.
struct Elimination<'a> {
    rows: [&'a mut [f64]; 2],
    n: usize,
    p: usize,
    inverse: Complex64,
    pivots: [&'a [f64]; 2],
}

impl Wide for Elimination<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { rows: [re, im], n, p, inverse, pivots } = self;
        for (re, im) in re.chunks_exact_mut(n).zip(im.chunks_exact_mut(n)) {
            if re[p] != 0.0 || im[p] != 0.0 {
                let l = Complex64::new(re[p], im[p]) * inverse;
                (re[p], im[p]) = (l.re, l.im);
                subtract::<A>(&mut re[p + 1..], &mut im[p + 1..], l, pivots);
            }
        }
    }
}

/// x −= l y, real and imaginary parts apart.
#[inline(always)]
fn subtract<A: Arithmetic>(
    re: &mut [f64],
    im: &mut [f64],
    l: Complex64,
    [y_re, y_im]: [&[f64]; 2],
) {
    for ((re, im), (y_re, y_im)) in re.iter_mut().zip(im).zip(y_re.iter().zip(y_im)) {
        *re = A::multiply_add(l.im, *y_im, A::multiply_add(-l.re, *y_re, *re));
        *im = A::multiply_add(-l.im, *y_re, A::multiply_add(-l.re, *y_im, *im));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn c(re: f64, im: f64) -> Complex64 {
        Complex64::new(re, im)
    }

    /// A matrix without structure, its entries of all sizes.
    fn sample(n: usize, seed: f64) -> Vec<Complex64> {
        (0..n * n)
            .map(|e| {
                let x = (seed + 0.3 * (e * e) as f64).sin();
                let y = (seed + 0.7 * (e * e) as f64).cos();
                c(x, y) * 10f64.powi((e % 5) as i32 - 2)
            })
            .collect()
    }

    #[test] // truth: the product of the matrix with the solution
    fn solves_what_it_factored() {
        for n in [0, 1, 2, 3, 7, 20] {
            let mut lu = DenseComplexLu::new(n);
            for seed in [0.1, 0.37] {
                let a = sample(n, seed);
                lu.factor(&a).unwrap();
                let x: Vec<_> = (0..n).map(|i| c(1.0 + i as f64, 2.0 - i as f64)).collect();
                let mut b: Vec<_> =
                    (0..n).map(|i| (0..n).map(|j| a[i * n + j] * x[j]).sum()).collect();
                lu.solve(&mut b);
                for (b, x) in b.iter().zip(&x) {
                    assert!((b - x).norm() < 1e-10 * (1.0 + x.norm()), "{n}: {b} ≠ {x}");
                }
            }
        }
    }

    #[test]
    fn a_singular_matrix_is_refused_and_a_badly_scaled_one_is_not() {
        let mut lu = DenseComplexLu::new(2);
        let singular = [c(1.0, 2.0), c(2.0, 4.0), c(0.1, 0.2), c(0.2, 0.4)];
        assert_eq!(lu.factor(&singular).unwrap_err().column, 1);
        lu.factor(&[c(1e200, -1e200), c(0.0, 0.0), c(0.0, 0.0), c(0.0, 1e-200)]).unwrap();
        let mut b = [c(2e200, 0.0), c(1e-200, 0.0)];
        lu.solve(&mut b);
        assert!((b[0] - c(1.0, 1.0)).norm() < 1e-14 && (b[1] - c(0.0, -1.0)).norm() < 1e-14);
    }
}
