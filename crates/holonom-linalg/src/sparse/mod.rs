//! Sparse matrices with a fixed pattern and their LU factorisation.

mod assembly;
mod elimination;
mod frozen;
mod inverse;
mod least_norm;
mod ordering;
mod pattern;
mod reach;
mod substitution;
mod symbolic;
mod wide_search;

use crate::complex::Complex64;
use crate::condition::condition_estimate;
use crate::error::SingularMatrix;
use crate::lanes::{LaneKernel, MOST_LANES, Plain, run_lanes};
use crate::scalar::Scalar;
use crate::watch::{checkpoint, stage};
use std::sync::Arc;

pub use assembly::{Assembly, Terms};
use elimination::{Factors, Plan};
pub use frozen::FrozenLu;
pub use least_norm::sparse_least_norm;
use ordering::{PivotOrder, Search};
pub use pattern::SparsePattern;
pub use reach::Pivots;
use substitution::Substitution;
use symbolic::FactorPattern;

/// Most corrections of an iterative refinement.
const MAX_REFINEMENTS: u32 = 5;
/// Numbers that could be computed while a row is listed, about.
const PER_ROW: usize = 50;

/// LU factors of a square sparse matrix whose pattern never changes.
///
/// ```text
/// Â = P R A C Q = L U        Â of scaled and permuted entries
/// ```
///
/// [`analyze`](Self::analyze) or [`analyze_for_many`](Self::analyze_for_many) chooses pivots and scales
/// (powers of two) from actual numbers and allocates everything; [`refactor`](Self::refactor) repeats the
/// elimination with these pivots on new numbers, row by row. Rows and columns are numbered as in the
/// original matrix everywhere.
#[derive(Debug, Clone)]
pub struct SparseLu<T = f64> {
    n: usize,
    n_values: usize,
    factors: Factors<T>,
    order: Arc<Order>,
    growth: f64,
    operations: usize,
    /// Right-hand sides in the order of Â.
    work: Vec<T>,
    residual: Vec<T>,
    right: Vec<T>,
}

/// Row and column of A at each position of Â, and their scales.
#[derive(Debug)]
struct Order {
    row_at: Vec<usize>,
    column_at: Vec<usize>,
    row_scale: Vec<f64>,
    column_scale: Vec<f64>,
    permutation_sign: f64,
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
        Self::analyzed(pattern, values, None, |pattern, scaled| {
            let order = ordering::choose_pivots(pattern, scaled, Search::Near)?;
            Ok(FactorPattern::new(pattern, &order).gather(&order))
        })
    }

    /// The same for a matrix that will be factored many times: of two orders the one with fewer operations is taken, which
    /// costs about as much again.
    ///
    /// # Errors
    /// As [`analyze`](Self::analyze).
    ///
    /// # Panics
    /// As [`analyze`](Self::analyze).
    pub fn analyze_for_many(
        pattern: &SparsePattern,
        values: &[f64],
    ) -> Result<Self, SingularMatrix> {
        Self::analyzed(pattern, values, None, least_work)
    }

    /// The same for a matrix whose entry (i, j) is of the size of 1 once it is multiplied by `units[0][i] * units[1][j]`: what
    /// its unknowns are measured in is not for its entries to tell.
    ///
    /// # Errors
    /// As [`analyze`](Self::analyze).
    ///
    /// # Panics
    /// As [`analyze`](Self::analyze), and if there is not a unit for every row and column.
    pub fn analyze_in_units(
        pattern: &SparsePattern,
        values: &[f64],
        units: &[Vec<f64>; 2],
    ) -> Result<Self, SingularMatrix> {
        assert_eq!(units.each_ref().map(Vec::len), [pattern.n_rows(), pattern.n_cols()]);
        Self::analyzed(pattern, values, Some(units), least_work)
    }

    fn analyzed(
        pattern: &SparsePattern,
        values: &[f64],
        units: Option<&[Vec<f64>; 2]>,
        choose: impl FnOnce(&SparsePattern, &[f64]) -> Result<PivotOrder, SingularMatrix>,
    ) -> Result<Self, SingularMatrix> {
        assert_eq!(pattern.n_rows(), pattern.n_cols(), "only a square matrix has an LU here");
        assert_eq!(values.len(), pattern.len(), "one value for each slot of the pattern");
        stage("analysing", || Self::planned(pattern, values, units, choose))
    }

    fn planned(
        pattern: &SparsePattern,
        values: &[f64],
        units: Option<&[Vec<f64>; 2]>,
        choose: impl FnOnce(&SparsePattern, &[f64]) -> Result<PivotOrder, SingularMatrix>,
    ) -> Result<Self, SingularMatrix> {
        let n = pattern.n_rows();
        let (row_scale, column_scale) = scales(pattern, values, units)?;
        let mut a_scale = vec![1.0; pattern.len()];
        for i in 0..n {
            checkpoint(PER_ROW);
            for (slot, j) in pattern.row(i) {
                a_scale[slot] = row_scale[i] * column_scale[j];
            }
        }
        let scaled: Vec<f64> = values.iter().zip(&a_scale).map(|(v, s)| v * s).collect();
        let order = choose(pattern, &scaled)?;
        drop(scaled);
        let factors = FactorPattern::new(pattern, &order);
        let mut position = vec![0u32; n];
        for (p, &j) in order.columns.iter().enumerate() {
            position[j] = p as u32;
        }
        let entries = |p: usize| {
            let row = pattern.row(order.rows[p]);
            row.map(|(slot, j)| (position[j], slot, a_scale[slot]))
        };
        let plan = Plan::new(&factors, pattern.len(), entries);
        let mut lu = Self {
            n,
            n_values: values.len(),
            factors: Factors::new(Arc::new(plan)),
            operations: factors.operations(),
            order: Arc::new(Order {
                row_scale: order.rows.iter().map(|&i| row_scale[i]).collect(),
                column_scale: order.columns.iter().map(|&j| column_scale[j]).collect(),
                permutation_sign: parity(&order.rows) * parity(&order.columns),
                row_at: order.rows,
                column_at: order.columns,
            }),
            growth: 1.0,
            work: vec![0.0; n],
            residual: vec![0.0; n],
            right: vec![0.0; n],
        };
        lu.refactor(values)?;
        Ok(lu)
    }

    /// The same plan, pivots included, for complex values of this pattern; nothing is factored yet.
    pub fn complex(&self) -> SparseLu<Complex64> {
        let n = self.n;
        SparseLu {
            n,
            n_values: self.n_values,
            factors: Factors::new(self.factors.plan.clone()),
            order: self.order.clone(),
            growth: 1.0,
            operations: self.operations,
            work: vec![Complex64::ZERO; n],
            residual: vec![Complex64::ZERO; n],
            right: vec![Complex64::ZERO; n],
        }
    }

    /// Sign of det A: 1 or −1.
    pub fn determinant_sign(&self) -> f64 {
        let pivots = &self.factors.inverse_pivot;
        pivots.iter().fold(self.order.permutation_sign, |sign, pivot| sign * pivot.signum())
    }

    /// Estimate of the condition number ‖A‖₁‖A⁻¹‖₁ of the matrix last factored: never above the
    /// true number (but for round-off), seldom below a third of it.
    pub fn condition_estimate(&mut self, pattern: &SparsePattern, values: &[f64]) -> f64 {
        let mut x = std::mem::take(&mut self.residual);
        x.fill(0.0);
        for i in 0..self.n {
            for (slot, j) in pattern.row(i) {
                x[j] += values[slot].abs();
            }
        }
        let estimate = condition_estimate(&mut x, |x, transposed| {
            if transposed {
                self.solve_transposed(x);
            } else {
                self.solve(x);
            }
        });
        self.residual = x;
        estimate
    }
}

impl<T: Scalar> SparseLu<T> {
    /// Makes room for several right-hand sides at a time; else the first solve for several does.
    pub fn reserve_lanes(&mut self) {
        self.work.resize(self.n * MOST_LANES, T::ZERO);
        self.factors.plan.by_columns();
    }

    /// Factors the matrix with new `values` by the pivots chosen in [`analyze`](Self::analyze).
    ///
    /// Whether these pivots are still good for the matrix is told by [`growth`](Self::growth), or
    /// by what [`solve_refined`](Self::solve_refined) leaves.
    ///
    /// # Errors
    /// [`SingularMatrix`] when a pivot vanishes or is not finite; the caller then analyzes again.
    /// The factors must not be used after an error.
    pub fn refactor(&mut self, values: &[T]) -> Result<(), SingularMatrix> {
        assert_eq!(values.len(), self.n_values, "one value for each slot of the pattern");
        let outcome = self.factors.eliminate(values);
        self.growth = outcome.map_err(|stop| SingularMatrix {
            row: self.order.row_at[stop.position],
            column: self.order.column_at[stop.position],
            pivot: stop.pivot
                / (self.order.row_scale[stop.position] * self.order.column_scale[stop.position]),
        })?;
        Ok(())
    }

    /// Solves A x = b in place.
    pub fn solve(&mut self, b: &mut [T]) {
        self.solve_many(b, 1);
    }

    /// Solves Aᵀ x = b in place.
    pub fn solve_transposed(&mut self, b: &mut [T]) {
        self.solve_transposed_many(b, 1);
    }

    /// Solves A X = B in place; `b` is n×k by rows: row i at `b[i * k..(i + 1) * k]`.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&mut self, b: &mut [T], k: usize) {
        self.substitute(b, k, false, None);
    }

    /// Solves Aᵀ X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_transposed_many(&mut self, b: &mut [T], k: usize) {
        self.substitute(b, k, true, None);
    }

    /// The same two for right-hand sides whose rows count times the first `scales`; rows of solutions come times the second.
    ///
    /// # Panics
    /// If `b` has not n·k entries, or there is not a number for every row.
    pub fn solve_scaled_many(
        &mut self,
        b: &mut [T],
        k: usize,
        transposed: bool,
        scales: [&[f64]; 2],
    ) {
        self.substitute(b, k, transposed, Some(scales));
    }

    fn substitute(&mut self, b: &mut [T], k: usize, transposed: bool, scales: Option<[&[f64]; 2]>) {
        assert_eq!(b.len(), self.n * k, "right-hand sides of a matrix of {} rows", self.n);
        checkpoint(self.fill() * k);
        let room = self.n * k.min(MOST_LANES);
        if self.work.len() < room {
            self.work.resize(room, T::ZERO);
        }
        let rows = (&self.order.row_at[..], &self.order.row_scale[..]);
        let columns = (&self.order.column_at[..], &self.order.column_scale[..]);
        let (source, target) = if transposed { (columns, rows) } else { (rows, columns) };
        let (factors, work) = (&self.factors, &mut self.work[..]);
        let columns = (transposed && k > 1).then(|| factors.plan.by_columns());
        let mut kernel =
            Substitution { factors, source, target, scales, transposed, columns, b, k, work };
        if k == 1 {
            kernel.run::<Plain, 1>(0);
        } else {
            run_lanes(k, &mut kernel);
        }
    }

    /// Solves A x = b in place with iterative refinement.
    ///
    /// `pattern` and `values` are those of the last factorisation. Corrections go on while they fall
    /// tenfold and the next one would be above round-off. Returns the size of the next correction as
    /// forecast, ‖δx‖∞ / ‖x‖∞: far above that of fresh pivots it says that the pivots are bad for
    /// this matrix.
    pub fn solve_refined(&mut self, pattern: &SparsePattern, values: &[T], b: &mut [T]) -> f64 {
        let mut right = std::mem::take(&mut self.right);
        let mut r = std::mem::take(&mut self.residual);
        right.copy_from_slice(b);
        self.solve(b);
        let mut before = 1.0;
        let mut left = 0.0;
        for _ in 0..MAX_REFINEMENTS {
            r.copy_from_slice(&right);
            pattern.multiply_add(values, -1.0, b, &mut r);
            self.solve(&mut r);
            let (mut correction, mut size) = (0.0f64, 0.0f64);
            for (x, d) in b.iter_mut().zip(&r) {
                *x = *x + *d;
                correction = correction.max(d.size());
                size = size.max(x.size());
            }
            if size == 0.0 {
                break;
            }
            correction /= size;
            let rate = correction / before;
            left = correction * rate.min(1.0);
            before = correction;
            if left <= f64::EPSILON || rate > 0.1 {
                break;
            }
        }
        self.right = right;
        self.residual = r;
        left
    }

    /// Largest factor by which numbers of a row grew in the last factorisation: near 1 with fresh
    /// pivots; each power of ten costs a digit of a solution without refinement.
    pub fn growth(&self) -> f64 {
        self.growth
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
        self.factors.numbers.len()
    }
}

/// Of the orders that are tried the one with the fewest operations. Local choices of least fill come to ends that are far
/// apart: where loops are closed beside each other in great number a wide search finds half as many operations, with
/// the large blocks of bodies in space one that looks at a few lines only finds fewer.
fn least_work(pattern: &SparsePattern, scaled: &[f64]) -> Result<PivotOrder, SingularMatrix> {
    let near = ordering::choose_pivots(pattern, scaled, Search::Near)?;
    let factors = FactorPattern::new(pattern, &near);
    if factors.fill() == pattern.len() {
        return Ok(factors.gather(&near));
    }
    if let Ok(wide) = ordering::choose_pivots(pattern, scaled, Search::Wide) {
        let others = FactorPattern::new(pattern, &wide);
        if others.operations() < factors.operations() {
            return Ok(others.gather(&wide));
        }
    }
    Ok(factors.gather(&near))
}

/// Powers of two that bring the largest entry of every row, then of every column, into (½, 1], from those that undo
/// the units on.
fn scales(
    pattern: &SparsePattern,
    values: &[f64],
    units: Option<&[Vec<f64>; 2]>,
) -> Result<(Vec<f64>, Vec<f64>), SingularMatrix> {
    let n = pattern.n_rows();
    let [mut row_scale, mut column_scale] = match units {
        Some(units) => {
            units.each_ref().map(|units| units.iter().map(|x| power_of_two(*x)).collect())
        }
        None => [vec![1.0; n], vec![1.0; n]],
    };
    let mut column_size = vec![0.0f64; n];
    for i in 0..n {
        checkpoint(PER_ROW);
        let mut size = 0.0f64;
        for (slot, j) in pattern.row(i) {
            if !values[slot].is_finite() {
                return Err(SingularMatrix { row: i, column: j, pivot: values[slot] });
            }
            size = size.max(values[slot].abs() * row_scale[i] * column_scale[j]);
        }
        row_scale[i] *= power_of_two(1.0 / size);
        for (slot, j) in pattern.row(i) {
            let scaled = values[slot].abs() * row_scale[i] * column_scale[j];
            column_size[j] = column_size[j].max(scaled);
        }
    }
    for (scale, size) in column_scale.iter_mut().zip(column_size) {
        *scale *= power_of_two(1.0 / size);
    }
    Ok((row_scale, column_scale))
}

/// The largest power of two that is not above a number; 1 for what is none.
fn power_of_two(x: f64) -> f64 {
    if x > 0.0 && x.is_finite() {
        2f64.powi((x.log2().floor() as i32).clamp(-500, 500))
    } else {
        1.0
    }
}

/// Sign of a permutation.
pub(crate) fn parity(order: &[usize]) -> f64 {
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of a strip of `width` by `length` nodes with `size` unknowns each, which couple with those of neighbours.
    fn strip(width: usize, length: usize, size: usize) -> (SparsePattern, Vec<f64>) {
        let node = |i: usize, j: usize| (i * width + j) * size;
        let mut entries = Vec::new();
        for (i, j) in (0..length).flat_map(|i| (0..width).map(move |j| (i, j))) {
            let ahead = [(i, j), (i + 1, j), (i, j + 1)];
            for (k, l) in ahead.into_iter().filter(|&(k, l)| k < length && l < width) {
                for (a, b) in (0..size).flat_map(|a| (0..size).map(move |b| (a, b))) {
                    entries.push((node(i, j) + a, node(k, l) + b));
                    entries.push((node(k, l) + b, node(i, j) + a));
                }
            }
        }
        let n = width * length * size;
        let (pattern, _) = SparsePattern::new(n, n, &entries);
        let values = (0..pattern.len()).map(|k| ((k * k + 1) as f64).sin()).collect();
        (pattern, values)
    }

    #[test] // truth: every order by itself, and what was multiplied
    fn the_order_with_the_fewest_operations_is_taken() {
        let mut wide_is_better = 0;
        for (width, length, size) in [(1, 40, 3), (2, 60, 2), (4, 20, 1), (6, 12, 3), (12, 12, 2)] {
            let (pattern, values) = strip(width, length, size);
            let (rows, columns) = scales(&pattern, &values, None).unwrap();
            let mut scaled = values.clone();
            for i in 0..pattern.n_rows() {
                pattern.row(i).for_each(|(slot, j)| scaled[slot] *= rows[i] * columns[j]);
            }
            let [near, wide] = [Search::Near, Search::Wide].map(|search| {
                let order = ordering::choose_pivots(&pattern, &scaled, search).unwrap();
                FactorPattern::new(&pattern, &order).operations()
            });
            wide_is_better += usize::from(wide < near);
            let mut lu = SparseLu::analyze_for_many(&pattern, &values).unwrap();
            assert_eq!(lu.operations(), near.min(wide), "{width}×{length}×{size}");
            let expected: Vec<f64> = (0..pattern.n_rows()).map(|i| (i as f64).cos()).collect();
            let mut x = vec![0.0; expected.len()];
            pattern.multiply_add(&values, 1.0, &expected, &mut x);
            lu.solve_refined(&pattern, &values, &mut x);
            let error = x.iter().zip(&expected).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(error < 1e-9, "{width}×{length}×{size}: {error:.1e}");
        }
        assert!(wide_is_better > 0);
    }
}
