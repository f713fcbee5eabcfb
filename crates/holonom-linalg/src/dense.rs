use crate::error::{NotPositiveDefinite, SingularMatrix};

/// A pivot below this fraction of its column's largest entry is cancellation noise.
const NEGLIGIBLE: f64 = 4.0 * f64::EPSILON;

/// LU factorisation with row exchanges of a dense n×n matrix; its storage is reused.
#[derive(Debug, Clone)]
pub struct DenseLu {
    n: usize,
    lu: Vec<f64>,
    inverse_pivot: Vec<f64>,
    /// Row `exchange[i] ≥ i` took the place of row i at step i.
    exchange: Vec<usize>,
}

impl DenseLu {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        Self { n, lu: vec![0.0; n * n], inverse_pivot: vec![0.0; n], exchange: vec![0; n] }
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Factors `a` (n×n by rows).
    ///
    /// # Errors
    /// [`SingularMatrix`] when a column has no pivot above round-off; `row` is then the position
    /// of elimination, equal to `column`.
    pub fn factor(&mut self, a: &[f64]) -> Result<(), SingularMatrix> {
        let n = self.n;
        self.lu.copy_from_slice(a);
        for p in 0..n {
            let mut at = p;
            for i in p + 1..n {
                if self.lu[i * n + p].abs() > self.lu[at * n + p].abs() {
                    at = i;
                }
            }
            let pivot = self.lu[at * n + p];
            self.exchange[p] = at;
            // What elimination has subtracted in this column tells the size of round-off.
            let peak = (0..n).fold(0.0f64, |m, i| m.max(self.lu[i * n + p].abs()));
            if !(pivot.abs() > NEGLIGIBLE * peak && (1.0 / pivot).is_finite()) {
                return Err(SingularMatrix { row: p, column: p, pivot });
            }
            if at != p {
                let (upper, lower) = self.lu.split_at_mut(at * n);
                upper[p * n..(p + 1) * n].swap_with_slice(&mut lower[..n]);
            }
            let inverse = 1.0 / pivot;
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
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_many(b, 1);
    }

    /// Solves A X = B in place; `b` is n×k by rows.
    pub fn solve_many(&self, b: &mut [f64], k: usize) {
        let n = self.n;
        for p in 0..n {
            swap_rows(b, k, p, self.exchange[p]);
        }
        for i in 0..n {
            let (done, rest) = b.split_at_mut(i * k);
            for j in 0..i {
                subtract(&mut rest[..k], self.lu[i * n + j], &done[j * k..(j + 1) * k]);
            }
        }
        for i in (0..n).rev() {
            let (rest, done) = b.split_at_mut((i + 1) * k);
            let row = &mut rest[i * k..];
            for j in i + 1..n {
                subtract(row, self.lu[i * n + j], &done[(j - i - 1) * k..(j - i) * k]);
            }
            for x in row.iter_mut() {
                *x *= self.inverse_pivot[i];
            }
        }
    }

    /// Solves Aᵀ x = b in place.
    pub fn solve_transposed(&self, b: &mut [f64]) {
        self.solve_transposed_many(b, 1);
    }

    /// Solves Aᵀ X = B in place; `b` is n×k by rows.
    pub fn solve_transposed_many(&self, b: &mut [f64], k: usize) {
        let n = self.n;
        for i in 0..n {
            let (done, rest) = b.split_at_mut((i + 1) * k);
            let row = &mut done[i * k..];
            for x in row.iter_mut() {
                *x *= self.inverse_pivot[i];
            }
            for j in i + 1..n {
                subtract(&mut rest[(j - i - 1) * k..(j - i) * k], self.lu[i * n + j], row);
            }
        }
        for i in (0..n).rev() {
            let (rest, row) = b.split_at_mut(i * k);
            for j in 0..i {
                subtract(&mut rest[j * k..(j + 1) * k], self.lu[i * n + j], &row[..k]);
            }
        }
        for p in (0..n).rev() {
            swap_rows(b, k, p, self.exchange[p]);
        }
    }
}

fn swap_rows(b: &mut [f64], k: usize, p: usize, q: usize) {
    if p != q {
        let (upper, lower) = b.split_at_mut(q * k);
        upper[p * k..(p + 1) * k].swap_with_slice(&mut lower[..k]);
    }
}

fn subtract(y: &mut [f64], a: f64, x: &[f64]) {
    for (y, x) in y.iter_mut().zip(x) {
        *y -= a * x;
    }
}

/// Cholesky factorisation A = L Lᵀ of a dense symmetric positive definite n×n matrix.
#[derive(Debug, Clone)]
pub struct Cholesky {
    n: usize,
    l: Vec<f64>,
}

impl Cholesky {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        Self { n, l: vec![0.0; n * n] }
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Factors `a` (n×n by rows; only the lower triangle is read).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] when a pivot is not above round-off of its diagonal entry.
    pub fn factor(&mut self, a: &[f64]) -> Result<(), NotPositiveDefinite> {
        let n = self.n;
        for i in 0..n {
            for j in 0..=i {
                let mut sum = a[i * n + j];
                for k in 0..j {
                    sum -= self.l[i * n + k] * self.l[j * n + k];
                }
                if i != j {
                    self.l[i * n + j] = sum / self.l[j * n + j];
                } else if sum > NEGLIGIBLE * a[i * n + i] && sum.is_finite() {
                    self.l[i * n + i] = sum.sqrt();
                } else {
                    return Err(NotPositiveDefinite { index: i, pivot: sum });
                }
            }
        }
        Ok(())
    }

    /// Solves A x = b in place.
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_many(b, 1);
    }

    /// Solves A X = B in place; `b` is n×k by rows.
    pub fn solve_many(&self, b: &mut [f64], k: usize) {
        let n = self.n;
        for i in 0..n {
            let (done, rest) = b.split_at_mut(i * k);
            let row = &mut rest[..k];
            for j in 0..i {
                subtract(row, self.l[i * n + j], &done[j * k..(j + 1) * k]);
            }
            for x in row.iter_mut() {
                *x /= self.l[i * n + i];
            }
        }
        for i in (0..n).rev() {
            let (rest, row) = b.split_at_mut(i * k);
            let row = &mut row[..k];
            for x in row.iter_mut() {
                *x /= self.l[i * n + i];
            }
            for j in 0..i {
                subtract(&mut rest[j * k..(j + 1) * k], self.l[i * n + j], row);
            }
        }
    }
}

/// C += Aᵀ B with A and B of `n_rows`×k and C of k×k, all by rows.
pub fn gram_add(n_rows: usize, k: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
    for r in 0..n_rows {
        let b = &b[r * k..(r + 1) * k];
        for (i, &a) in a[r * k..(r + 1) * k].iter().enumerate() {
            subtract(&mut c[i * k..(i + 1) * k], -a, b);
        }
    }
}
