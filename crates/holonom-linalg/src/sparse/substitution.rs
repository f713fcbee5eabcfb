//! Forward and backward substitution with several right-hand sides at a time.

use crate::lanes::{LaneKernel, lanes, lanes_mut};
use crate::sparse::elimination::Numbers;
use crate::sparse::symbolic::FactorPattern;

/// Solution in place for the n×k right-hand sides `b`, with the factors or their transposes.
pub(super) struct Substitution<'a> {
    pub(super) pattern: &'a FactorPattern,
    pub(super) numbers: &'a Numbers,
    /// Row of `b` and its scale at each position, for right-hand sides and for solutions.
    pub(super) source: (&'a [usize], &'a [f64]),
    pub(super) target: (&'a [usize], &'a [f64]),
    pub(super) transposed: bool,
    pub(super) b: &'a mut [f64],
    pub(super) k: usize,
    pub(super) work: &'a mut [f64],
}

impl LaneKernel for Substitution<'_> {
    #[inline(always)]
    fn run<const W: usize>(&mut self, from: usize) {
        let n = self.numbers.inverse_pivot.len();
        let (x, _) = self.work[..n * W].as_chunks_mut::<W>();
        for ((x, &i), scale) in x.iter_mut().zip(self.source.0).zip(self.source.1) {
            let b: &[f64; W] = lanes(self.b, self.k, i, from);
            for w in 0..W {
                x[w] = b[w] * scale;
            }
        }
        if self.transposed {
            solve_transposed(self.pattern, self.numbers, x);
        } else {
            solve(self.pattern, self.numbers, x);
        }
        for ((x, &i), scale) in x.iter().zip(self.target.0).zip(self.target.1) {
            let b: &mut [f64; W] = lanes_mut(self.b, self.k, i, from);
            for w in 0..W {
                b[w] = x[w] * scale;
            }
        }
    }
}

/// x ← U⁻¹ L⁻¹ x.
#[inline(always)]
fn solve<const W: usize>(pattern: &FactorPattern, numbers: &Numbers, x: &mut [[f64; W]]) {
    for i in 0..x.len() {
        let range = pattern.l_range(i);
        x[i] = subtract_row(x[i], &pattern.l_column[range.clone()], &numbers.l[range], x);
    }
    for i in (0..x.len()).rev() {
        let range = pattern.u_range(i);
        let mut row = subtract_row(x[i], &pattern.u_column[range.clone()], &numbers.u[range], x);
        for v in &mut row {
            *v *= numbers.inverse_pivot[i];
        }
        x[i] = row;
    }
}

/// x ← L⁻ᵀ U⁻ᵀ x.
#[inline(always)]
fn solve_transposed<const W: usize>(
    pattern: &FactorPattern,
    numbers: &Numbers,
    x: &mut [[f64; W]],
) {
    for i in 0..x.len() {
        let mut row = x[i];
        for v in &mut row {
            *v *= numbers.inverse_pivot[i];
        }
        x[i] = row;
        let range = pattern.u_range(i);
        subtract_column(row, &pattern.u_column[range.clone()], &numbers.u[range], x);
    }
    for i in (0..x.len()).rev() {
        let range = pattern.l_range(i);
        subtract_column(x[i], &pattern.l_column[range.clone()], &numbers.l[range], x);
    }
}

/// row − Σ valueⱼ xⱼ.
#[inline(always)]
fn subtract_row<const W: usize>(
    mut row: [f64; W],
    columns: &[u32],
    values: &[f64],
    x: &[[f64; W]],
) -> [f64; W] {
    if W == 1 {
        // Four sums, or the latency of one addition after the other would be waited for.
        let mut sums = [0.0; 4];
        let (columns, last_columns) = columns.as_chunks::<4>();
        let (values, last_values) = values.as_chunks::<4>();
        for (j, a) in columns.iter().zip(values) {
            for s in 0..4 {
                sums[s] += a[s] * x[j[s] as usize][0];
            }
        }
        for (s, (&j, a)) in last_columns.iter().zip(last_values).enumerate() {
            sums[s] += a * x[j as usize][0];
        }
        row[0] -= (sums[0] + sums[1]) + (sums[2] + sums[3]);
        return row;
    }
    for (&j, a) in columns.iter().zip(values) {
        let other = &x[j as usize];
        for w in 0..W {
            row[w] -= a * other[w];
        }
    }
    row
}

/// xⱼ ← xⱼ − valueⱼ row.
#[inline(always)]
fn subtract_column<const W: usize>(
    row: [f64; W],
    columns: &[u32],
    values: &[f64],
    x: &mut [[f64; W]],
) {
    for (&j, a) in columns.iter().zip(values) {
        let other = &mut x[j as usize];
        for w in 0..W {
            other[w] -= a * row[w];
        }
    }
}
