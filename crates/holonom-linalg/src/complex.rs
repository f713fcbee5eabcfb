use crate::error::SingularMatrix;
use crate::scalar::Scalar;

pub use num_complex::Complex64;

/// A pivot below this fraction of its column's largest entry is cancellation noise.
const NEGLIGIBLE: f64 = 4.0 * f64::EPSILON;

/// LU factorisation with row exchanges of a dense complex n×n matrix; its storage is reused.
///
/// Sizes are measured by |Re| + |Im|, which is within √2 of the modulus and needs no root.
#[derive(Debug, Clone)]
pub struct DenseComplexLu {
    n: usize,
    lu: Vec<Complex64>,
    inverse_pivot: Vec<Complex64>,
    /// Row `exchange[i] ≥ i` took the place of row i at step i.
    exchange: Vec<usize>,
}

impl DenseComplexLu {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        let zero = Complex64::new(0.0, 0.0);
        Self { n, lu: vec![zero; n * n], inverse_pivot: vec![zero; n], exchange: vec![0; n] }
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
        self.lu.copy_from_slice(a);
        for p in 0..n {
            let mut at = p;
            for i in p + 1..n {
                if self.lu[i * n + p].size() > self.lu[at * n + p].size() {
                    at = i;
                }
            }
            let pivot = self.lu[at * n + p].size();
            self.exchange[p] = at;
            // What elimination has subtracted in this column tells the size of round-off.
            let peak = (0..n).fold(0.0f64, |m, i| m.max(self.lu[i * n + p].size()));
            if !(pivot > NEGLIGIBLE * peak && (1.0 / pivot).is_finite()) {
                return Err(SingularMatrix { row: p, column: p, pivot });
            }
            if at != p {
                let (upper, lower) = self.lu.split_at_mut(at * n);
                upper[p * n..(p + 1) * n].swap_with_slice(&mut lower[..n]);
            }
            let inverse = self.lu[p * n + p].reciprocal();
            self.inverse_pivot[p] = inverse;
            let (upper, lower) = self.lu.split_at_mut((p + 1) * n);
            let pivot_row = &upper[p * n + p + 1..];
            for row in lower.chunks_exact_mut(n) {
                let l = row[p] * inverse;
                row[p] = l;
                for (a, u) in row[p + 1..].iter_mut().zip(pivot_row) {
                    *a -= l * u;
                }
            }
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
            let (done, rest) = b.split_at_mut(i);
            for (l, x) in self.lu[i * n..i * n + i].iter().zip(done) {
                rest[0] -= l * *x;
            }
        }
        for i in (0..n).rev() {
            let (rest, done) = b.split_at_mut(i + 1);
            for (u, x) in self.lu[i * n + i + 1..(i + 1) * n].iter().zip(done) {
                rest[i] -= u * *x;
            }
            rest[i] *= self.inverse_pivot[i];
        }
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
