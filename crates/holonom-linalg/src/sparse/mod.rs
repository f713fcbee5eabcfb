//! Sparse matrices with a fixed pattern and their LU factorisation.

mod ordering;
mod pattern;
mod substitution;
mod symbolic;

use crate::error::SingularMatrix;

use ordering::NEGLIGIBLE;
pub use pattern::SparsePattern;
use substitution::Factors;
use symbolic::{FactorPattern, Segment};

/// Most right-hand sides that are substituted together.
const LANES: usize = 16;

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
    /// Pattern of the factors; L in segments.
    pattern: FactorPattern,
    segment_start: Vec<u32>,
    segments: Vec<Segment>,
    l_value: Vec<f64>,
    u_value: Vec<f64>,
    inverse_pivot: Vec<f64>,
    /// Row and column of A at each position of Â, and their scales.
    row_at: Vec<usize>,
    column_at: Vec<usize>,
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
        let mut a_scale = vec![1.0; pattern.len()];
        for i in 0..n {
            for (slot, j) in pattern.row(i) {
                a_scale[slot] = row_scale[i] * column_scale[j];
            }
        }
        let scaled: Vec<f64> = values.iter().zip(&a_scale).map(|(v, s)| v * s).collect();
        let order = ordering::choose_pivots(pattern, &scaled)?;
        let order = FactorPattern::new(pattern, &order).gather(&order);
        let factors = FactorPattern::new(pattern, &order);
        let (segment_start, segments) = factors.segments();
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
            l_value: vec![0.0; factors.l_column.len()],
            u_value: vec![0.0; factors.u_column.len()],
            operations: factors.operations(),
            pattern: factors,
            segment_start,
            segments,
            inverse_pivot: vec![0.0; n],
            row_scale: order.rows.iter().map(|&i| row_scale[i]).collect(),
            column_scale: order.columns.iter().map(|&j| column_scale[j]).collect(),
            permutation_sign: parity(&order.rows) * parity(&order.columns),
            row_at: order.rows,
            column_at: order.columns,
            growth_limit: f64::INFINITY,
            row: vec![0.0; n],
            work: vec![0.0; n * LANES],
            residual: vec![0.0; n],
        };
        for &i in &lu.row_at {
            for (slot, j) in pattern.row(i) {
                lu.a_column.push(position[j]);
                lu.a_slot.push(slot as u32);
                lu.a_scale.push(a_scale[slot]);
            }
            lu.a_start.push(lu.a_column.len() as u32);
        }
        let growth = lu.eliminate(values, f64::INFINITY)?;
        lu.growth_limit = GROWTH_LIMIT.max(1e3 * growth);
        Ok(lu)
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
            let mut peak = size.max(self.subtract_segments(i));
            let u = self.pattern.u_range(i);
            for (&k, u) in self.pattern.u_column[u.clone()].iter().zip(&mut self.u_value[u]) {
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
                    row: self.row_at[i],
                    column: self.column_at[i],
                    pivot: pivot / (self.row_scale[i] * self.column_scale[i]),
                });
            }
        }
        Ok(growth)
    }

    /// Subtracts from the row at hand its multiples of the rows of U above it; returns the largest
    /// number eliminated.
    fn subtract_segments(&mut self, i: usize) -> f64 {
        let mut peak = 0.0f64;
        let mut e = self.pattern.l_start[i] as usize;
        let u_start = &self.pattern.u_start;
        let row = &mut self.row[..];
        let segments = self.segment_start[i] as usize..self.segment_start[i + 1] as usize;
        for segment in &self.segments[segments] {
            let (first, count) = (segment.first as usize, segment.count as usize);
            let l = &mut self.l_value[e..e + count];
            e += count;
            // The triangle of the segment.
            for a in 0..count {
                let j = first + a;
                let numerator = std::mem::take(&mut row[j]);
                peak = peak.max(numerator.abs());
                l[a] = numerator * self.inverse_pivot[j];
                let inside = &self.u_value[u_start[j] as usize..][..count - a - 1];
                for (r, u) in row[j + 1..].iter_mut().zip(inside) {
                    *r -= l[a] * u;
                }
            }
            // What its rows share.
            let last = self.pattern.u_range(first + count - 1);
            let columns = &self.pattern.u_column[last.clone()];
            let shared = last.len();
            let tail = |a: usize| {
                let end = u_start[first + a + 1] as usize;
                &self.u_value[end - shared..end]
            };
            let mut a = 0;
            while a + 4 <= count {
                let (l0, l1, l2, l3) = (l[a], l[a + 1], l[a + 2], l[a + 3]);
                let (u0, u1, u2, u3) = (tail(a), tail(a + 1), tail(a + 2), tail(a + 3));
                for t in 0..shared {
                    let r = &mut row[columns[t] as usize];
                    *r -= (l0 * u0[t] + l1 * u1[t]) + (l2 * u2[t] + l3 * u3[t]);
                }
                a += 4;
            }
            if a + 2 <= count {
                let (l0, l1) = (l[a], l[a + 1]);
                let (u0, u1) = (tail(a), tail(a + 1));
                for t in 0..shared {
                    row[columns[t] as usize] -= l0 * u0[t] + l1 * u1[t];
                }
                a += 2;
            }
            if a < count {
                let (l0, u0) = (l[a], tail(a));
                for t in 0..shared {
                    row[columns[t] as usize] -= l0 * u0[t];
                }
            }
        }
        peak
    }

    /// Solves A x = b in place.
    pub fn solve(&mut self, b: &mut [f64]) {
        self.solve_many(b, 1);
    }

    /// Solves Aᵀ x = b in place.
    pub fn solve_transposed(&mut self, b: &mut [f64]) {
        self.solve_transposed_many(b, 1);
    }

    /// Solves A X = B in place; `b` is n×k by rows: row i at `b[i * k..(i + 1) * k]`.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&mut self, b: &mut [f64], k: usize) {
        self.substitute(b, k, false);
    }

    /// Solves Aᵀ X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_transposed_many(&mut self, b: &mut [f64], k: usize) {
        self.substitute(b, k, true);
    }

    fn substitute(&mut self, b: &mut [f64], k: usize, transposed: bool) {
        assert_eq!(b.len(), self.n * k, "right-hand sides of a matrix of {} rows", self.n);
        let mut from = 0;
        while from < k {
            from += match k - from {
                16.. => self.substitute_lanes::<16>(b, k, from, transposed),
                8.. => self.substitute_lanes::<8>(b, k, from, transposed),
                4.. => self.substitute_lanes::<4>(b, k, from, transposed),
                2.. => self.substitute_lanes::<2>(b, k, from, transposed),
                _ => self.substitute_lanes::<1>(b, k, from, transposed),
            };
        }
    }

    /// Solves for right-hand sides `from..from + W`; returns W.
    fn substitute_lanes<const W: usize>(
        &mut self,
        b: &mut [f64],
        k: usize,
        from: usize,
        transposed: bool,
    ) -> usize {
        let (x, _) = self.work[..self.n * W].as_chunks_mut::<W>();
        let factors = Factors {
            pattern: &self.pattern,
            l_value: &self.l_value,
            u_value: &self.u_value,
            inverse_pivot: &self.inverse_pivot,
        };
        let rows = (&self.row_at, &self.row_scale);
        let columns = (&self.column_at, &self.column_scale);
        let (source, target) = if transposed { (columns, rows) } else { (rows, columns) };
        for ((x, &i), scale) in x.iter_mut().zip(source.0).zip(source.1) {
            let b = &b[i * k + from..][..W];
            for w in 0..W {
                x[w] = b[w] * scale;
            }
        }
        if transposed {
            factors.solve_transposed(x);
        } else {
            factors.solve(x);
        }
        for ((x, &i), scale) in x.iter().zip(target.0).zip(target.1) {
            let b = &mut b[i * k + from..][..W];
            for w in 0..W {
                b[w] = x[w] * scale;
            }
        }
        W
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
