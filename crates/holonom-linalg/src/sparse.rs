use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::error::SingularMatrix;
use crate::ordering::{NEGLIGIBLE, PivotOrder, PivotRule, markowitz};
use crate::pattern::SparsePattern;

/// Growth of numbers during elimination beyond which frozen pivots are given up.
const GROWTH_LIMIT: f64 = 1e6;

/// LU factors of a square sparse matrix whose pattern never changes.
///
/// ```text
/// Â = P R A C Q = L U        Â of scaled and permuted entries
/// ```
///
/// [`analyze`](Self::analyze) chooses pivots and scales (powers of two) from actual numbers and
/// allocates everything; [`refactor`](Self::refactor) repeats the elimination with these pivots on
/// new numbers, row by row. Rows and columns are numbered as in the original matrix everywhere.
#[derive(Debug, Clone)]
pub struct SparseLu {
    n: usize,
    /// Entries of A by row of Â: range per row; column in Â, slot in A's values, scale.
    a_start: Vec<u32>,
    a_column: Vec<u32>,
    a_slot: Vec<u32>,
    a_scale: Vec<f64>,
    /// L without its unit diagonal and U without its diagonal, in compressed rows.
    l_start: Vec<u32>,
    l_column: Vec<u32>,
    l_value: Vec<f64>,
    u_start: Vec<u32>,
    u_column: Vec<u32>,
    u_value: Vec<f64>,
    inverse_pivot: Vec<f64>,
    /// Row and column of A at each position of Â, and their scales.
    row_at: Vec<u32>,
    column_at: Vec<u32>,
    row_scale: Vec<f64>,
    column_scale: Vec<f64>,
    permutation_sign: f64,
    growth_limit: f64,
    operations: usize,
    /// One row of Â during elimination; zero between calls.
    row: Vec<f64>,
    /// Right-hand sides in the order of Â.
    work: Vec<f64>,
    residual: Vec<f64>,
}

impl SparseLu {
    /// Chooses the pivots for a matrix with these `values`, then factors it.
    ///
    /// # Errors
    /// [`SingularMatrix`] when no usable pivot is left at some step, structurally or in numbers.
    ///
    /// # Panics
    /// If the pattern is not square or `values` has not the pattern's length.
    pub fn analyze(pattern: &SparsePattern, values: &[f64]) -> Result<Self, SingularMatrix> {
        let n = pattern.n_rows();
        assert_eq!(n, pattern.n_cols(), "only a square matrix has an LU factorisation here");
        assert_eq!(values.len(), pattern.len(), "one value for each slot of the pattern");
        let (row_scale, column_scale) = scales(pattern, values)?;
        let mut scaled = values.to_vec();
        for i in 0..n {
            for (slot, j) in pattern.row(i) {
                scaled[slot] *= row_scale[i] * column_scale[j];
            }
        }
        let order = markowitz(pattern, &scaled, PivotRule { threshold: 0.1, search: 8 })?;
        let mut lu = Self::symbolic(pattern, &order, &row_scale, &column_scale);
        let growth = lu.eliminate(values, f64::INFINITY)?;
        lu.growth_limit = GROWTH_LIMIT.max(1e3 * growth);
        Ok(lu)
    }

    /// Pattern of the factors for given pivots: union of rows, ascending.
    fn symbolic(
        pattern: &SparsePattern,
        order: &PivotOrder,
        row_scale: &[f64],
        column_scale: &[f64],
    ) -> Self {
        let n = pattern.n_rows();
        let mut position = vec![0u32; n];
        for (p, &j) in order.columns.iter().enumerate() {
            position[j] = p as u32;
        }
        let mut lu = Self {
            n,
            a_start: vec![0],
            a_column: Vec::with_capacity(pattern.len()),
            a_slot: Vec::with_capacity(pattern.len()),
            a_scale: Vec::with_capacity(pattern.len()),
            l_start: vec![0],
            l_column: Vec::new(),
            l_value: Vec::new(),
            u_start: vec![0],
            u_column: Vec::new(),
            u_value: Vec::new(),
            inverse_pivot: vec![0.0; n],
            row_at: order.rows.iter().map(|&i| i as u32).collect(),
            column_at: order.columns.iter().map(|&j| j as u32).collect(),
            row_scale: order.rows.iter().map(|&i| row_scale[i]).collect(),
            column_scale: order.columns.iter().map(|&j| column_scale[j]).collect(),
            permutation_sign: parity(&order.rows) * parity(&order.columns),
            growth_limit: f64::INFINITY,
            operations: 0,
            row: vec![0.0; n],
            work: vec![0.0; n],
            residual: vec![0.0; n],
        };
        let mut seen = vec![u32::MAX; n];
        let mut left = BinaryHeap::new();
        let mut right = Vec::new();
        for (p, &i) in order.rows.iter().enumerate() {
            let mark =
                |k: u32, left: &mut BinaryHeap<_>, right: &mut Vec<u32>, seen: &mut [u32]| {
                    if seen[k as usize] != p as u32 {
                        seen[k as usize] = p as u32;
                        match (k as usize).cmp(&p) {
                            std::cmp::Ordering::Less => left.push(Reverse(k)),
                            std::cmp::Ordering::Equal => {}
                            std::cmp::Ordering::Greater => right.push(k),
                        }
                    }
                };
            let from = lu.a_column.len();
            for (slot, j) in pattern.row(i) {
                lu.a_column.push(position[j]);
                lu.a_slot.push(slot as u32);
                lu.a_scale.push(row_scale[i] * column_scale[j]);
                mark(position[j], &mut left, &mut right, &mut seen);
            }
            debug_assert!(from < lu.a_column.len());
            lu.a_start.push(lu.a_column.len() as u32);
            while let Some(Reverse(k)) = left.pop() {
                lu.l_column.push(k);
                let fill = lu.u_start[k as usize] as usize..lu.u_start[k as usize + 1] as usize;
                lu.operations += 2 * fill.len() + 1;
                for at in fill {
                    mark(lu.u_column[at], &mut left, &mut right, &mut seen);
                }
            }
            lu.l_start.push(lu.l_column.len() as u32);
            right.sort_unstable();
            lu.u_column.append(&mut right);
            lu.u_start.push(lu.u_column.len() as u32);
        }
        lu.l_value = vec![0.0; lu.l_column.len()];
        lu.u_value = vec![0.0; lu.u_column.len()];
        lu
    }

    /// Factors the matrix with new `values` by the pivots chosen in [`analyze`](Self::analyze).
    ///
    /// # Errors
    /// [`SingularMatrix`] when a pivot vanishes or is not finite, or numbers grow so much that
    /// these pivots are no longer good for the matrix; the caller then analyzes again. The factors
    /// must not be used after an error.
    pub fn refactor(&mut self, values: &[f64]) -> Result<(), SingularMatrix> {
        self.eliminate(values, self.growth_limit).map(|_| ())
    }

    /// Elimination row by row; returns the largest growth of a number within its row.
    fn eliminate(&mut self, values: &[f64], growth_limit: f64) -> Result<f64, SingularMatrix> {
        let mut growth = 0.0f64;
        for i in 0..self.n {
            let (from, to) = (self.a_start[i] as usize, self.a_start[i + 1] as usize);
            let mut size = 0.0f64;
            for e in from..to {
                let a = values[self.a_slot[e] as usize] * self.a_scale[e];
                self.row[self.a_column[e] as usize] = a;
                size = size.max(a.abs());
            }
            let mut peak = size;
            for e in self.l_start[i] as usize..self.l_start[i + 1] as usize {
                let j = self.l_column[e] as usize;
                let numerator = std::mem::take(&mut self.row[j]);
                peak = peak.max(numerator.abs());
                let l = numerator * self.inverse_pivot[j];
                self.l_value[e] = l;
                let u = self.u_start[j] as usize..self.u_start[j + 1] as usize;
                for (&k, &u) in self.u_column[u.clone()].iter().zip(&self.u_value[u]) {
                    self.row[k as usize] -= l * u;
                }
            }
            let u = self.u_start[i] as usize..self.u_start[i + 1] as usize;
            for (&k, u) in self.u_column[u.clone()].iter().zip(&mut self.u_value[u]) {
                *u = std::mem::take(&mut self.row[k as usize]);
                peak = peak.max(u.abs());
            }
            let pivot = std::mem::take(&mut self.row[i]);
            peak = peak.max(pivot.abs());
            self.inverse_pivot[i] = 1.0 / pivot;
            growth = growth.max(peak / size);
            // Written so that a NaN fails.
            let good = pivot.abs() > NEGLIGIBLE * peak
                && peak <= growth_limit * size
                && self.inverse_pivot[i].is_finite()
                && peak.is_finite();
            if !good {
                self.row.fill(0.0);
                return Err(SingularMatrix {
                    row: self.row_at[i] as usize,
                    column: self.column_at[i] as usize,
                    pivot: pivot / (self.row_scale[i] * self.column_scale[i]),
                });
            }
        }
        Ok(growth)
    }

    /// Solves A x = b in place.
    pub fn solve(&mut self, b: &mut [f64]) {
        for (p, y) in self.work.iter_mut().enumerate().take(self.n) {
            *y = b[self.row_at[p] as usize] * self.row_scale[p];
        }
        for i in 0..self.n {
            let l = self.l_start[i] as usize..self.l_start[i + 1] as usize;
            let mut sum = self.work[i];
            for (&j, &l) in self.l_column[l.clone()].iter().zip(&self.l_value[l]) {
                sum -= l * self.work[j as usize];
            }
            self.work[i] = sum;
        }
        for i in (0..self.n).rev() {
            let u = self.u_start[i] as usize..self.u_start[i + 1] as usize;
            let mut sum = self.work[i];
            for (&k, &u) in self.u_column[u.clone()].iter().zip(&self.u_value[u]) {
                sum -= u * self.work[k as usize];
            }
            self.work[i] = sum * self.inverse_pivot[i];
        }
        for p in 0..self.n {
            b[self.column_at[p] as usize] = self.work[p] * self.column_scale[p];
        }
    }

    /// Solves Aᵀ x = b in place.
    pub fn solve_transposed(&mut self, b: &mut [f64]) {
        for p in 0..self.n {
            self.work[p] = b[self.column_at[p] as usize] * self.column_scale[p];
        }
        for i in 0..self.n {
            let y = self.work[i] * self.inverse_pivot[i];
            self.work[i] = y;
            let u = self.u_start[i] as usize..self.u_start[i + 1] as usize;
            for (&k, &u) in self.u_column[u.clone()].iter().zip(&self.u_value[u]) {
                self.work[k as usize] -= u * y;
            }
        }
        for i in (0..self.n).rev() {
            let y = self.work[i];
            let l = self.l_start[i] as usize..self.l_start[i + 1] as usize;
            for (&j, &l) in self.l_column[l.clone()].iter().zip(&self.l_value[l]) {
                self.work[j as usize] -= l * y;
            }
        }
        for p in 0..self.n {
            b[self.row_at[p] as usize] = self.work[p] * self.row_scale[p];
        }
    }

    /// Solves A X = B in place; `b` is n×k by rows: row i at `b[i * k..(i + 1) * k]`.
    pub fn solve_many(&mut self, b: &mut [f64], k: usize) {
        let mut column = vec![0.0; self.n];
        for c in 0..k {
            for i in 0..self.n {
                column[i] = b[i * k + c];
            }
            self.solve(&mut column);
            for i in 0..self.n {
                b[i * k + c] = column[i];
            }
        }
    }

    /// Solves Aᵀ X = B in place; `b` is n×k by rows.
    pub fn solve_transposed_many(&mut self, b: &mut [f64], k: usize) {
        let mut column = vec![0.0; self.n];
        for c in 0..k {
            for i in 0..self.n {
                column[i] = b[i * k + c];
            }
            self.solve_transposed(&mut column);
            for i in 0..self.n {
                b[i * k + c] = column[i];
            }
        }
    }

    /// Solves A x = b in place with one step of iterative refinement.
    ///
    /// `pattern` and `values` are those of the last factorisation. Returns the size of the
    /// correction relative to the solution, ‖δx‖∞ / ‖x‖∞: far above 1e-10 it says that the pivots
    /// are bad for this matrix or the matrix is nearly singular.
    pub fn solve_refined(&mut self, pattern: &SparsePattern, values: &[f64], b: &mut [f64]) -> f64 {
        let mut r = std::mem::take(&mut self.residual);
        r.copy_from_slice(b);
        self.solve(b);
        pattern.multiply_add(values, -1.0, b, &mut r);
        self.solve(&mut r);
        let (mut correction, mut size) = (0.0f64, 0.0f64);
        for (x, d) in b.iter_mut().zip(&r) {
            *x += d;
            correction = correction.max(d.abs());
            size = size.max(x.abs());
        }
        self.residual = r;
        if size > 0.0 { correction / size } else { 0.0 }
    }

    /// Sign of det A: 1 or −1.
    pub fn determinant_sign(&self) -> f64 {
        self.inverse_pivot.iter().fold(self.permutation_sign, |s, p| s * p.signum())
    }

    /// Estimate of the condition number ‖A‖₁‖A⁻¹‖₁ of the matrix last factored: never above the
    /// true number (but for round-off), seldom below a third of it.
    ///
    /// Source: Hager (1984), Higham, *ACM Trans. Math. Softw.* 14 (1988), algorithm 674.
    pub fn condition_estimate(&mut self, pattern: &SparsePattern, values: &[f64]) -> f64 {
        let n = self.n;
        if n == 0 {
            return 1.0;
        }
        let mut x = std::mem::take(&mut self.residual);
        x.fill(0.0);
        for i in 0..n {
            for (slot, j) in pattern.row(i) {
                x[j] += values[slot].abs();
            }
        }
        let norm = x.iter().fold(0.0f64, |m, v| m.max(*v));
        x.fill(1.0 / n as f64);
        let mut inverse_norm = 0.0f64;
        let mut last = usize::MAX;
        for _ in 0..5 {
            self.solve(&mut x);
            let size: f64 = x.iter().map(|v| v.abs()).sum();
            if size <= inverse_norm {
                break;
            }
            inverse_norm = size;
            for v in &mut x {
                *v = v.signum();
            }
            self.solve_transposed(&mut x);
            let at = (0..n).fold(0, |m, i| if x[i].abs() > x[m].abs() { i } else { m });
            if at == last {
                break;
            }
            last = at;
            x.fill(0.0);
            x[at] = 1.0;
        }
        // A second lower bound that is not fooled by cancellation in the first.
        for i in 0..n {
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            x[i] = sign * (1.0 + i as f64 / (n.max(2) - 1) as f64);
        }
        self.solve(&mut x);
        let size: f64 = x.iter().map(|v| v.abs()).sum();
        self.residual = x;
        norm * inverse_norm.max(2.0 * size / (3.0 * n as f64))
    }

    /// Additions and multiplications of one refactorisation.
    pub fn operations(&self) -> usize {
        self.operations
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Entries stored in both factors, the diagonal counted once.
    pub fn fill(&self) -> usize {
        self.l_value.len() + self.u_value.len() + self.n
    }
}

/// Powers of two that bring the largest entry of every row, then of every column, into (½, 1].
fn scales(pattern: &SparsePattern, values: &[f64]) -> Result<(Vec<f64>, Vec<f64>), SingularMatrix> {
    let n = pattern.n_rows();
    let mut row_scale = vec![1.0; n];
    let mut column_size = vec![0.0f64; n];
    for i in 0..n {
        let mut size = 0.0f64;
        for (slot, j) in pattern.row(i) {
            if !values[slot].is_finite() {
                return Err(SingularMatrix { row: i, column: j, pivot: values[slot] });
            }
            size = size.max(values[slot].abs());
        }
        row_scale[i] = power_of_two_below_inverse(size);
        for (slot, j) in pattern.row(i) {
            column_size[j] = column_size[j].max(values[slot].abs() * row_scale[i]);
        }
    }
    let column_scale = column_size.into_iter().map(power_of_two_below_inverse).collect();
    Ok((row_scale, column_scale))
}

fn power_of_two_below_inverse(size: f64) -> f64 {
    if size > 0.0 { 2f64.powi(-(size.log2().ceil() as i32).clamp(-500, 500)) } else { 1.0 }
}

/// Sign of a permutation.
fn parity(order: &[usize]) -> f64 {
    let mut seen = vec![false; order.len()];
    let mut sign = 1.0;
    for start in 0..order.len() {
        let mut length = 0;
        let mut at = start;
        while !seen[at] {
            seen[at] = true;
            at = order[at];
            length += 1;
        }
        if length > 0 && length % 2 == 0 {
            sign = -sign;
        }
    }
    sign
}
