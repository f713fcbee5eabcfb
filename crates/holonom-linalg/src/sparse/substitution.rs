//! Forward and backward substitution with `W` right-hand sides at a time.
//!
//! The right-hand sides of one unknown lie side by side, so that the compiler turns each loop over
//! `W` into vector instructions and keeps a row in registers.

use crate::sparse::elimination::Numbers;
use crate::sparse::symbolic::FactorPattern;

/// Factors as the substitutions need them.
pub(super) struct Factors<'a> {
    pub(super) pattern: &'a FactorPattern,
    pub(super) numbers: &'a Numbers,
}

impl Factors<'_> {
    /// x ← U⁻¹ L⁻¹ x.
    pub(super) fn solve<const W: usize>(&self, x: &mut [[f64; W]]) {
        let n = self.numbers.inverse_pivot.len();
        for i in 0..n {
            let range = self.pattern.l_range(i);
            let columns = &self.pattern.l_column[range.clone()];
            x[i] = subtract_row(x[i], columns, &self.numbers.l[range], x);
        }
        for i in (0..n).rev() {
            let range = self.pattern.u_range(i);
            let columns = &self.pattern.u_column[range.clone()];
            let mut row = subtract_row(x[i], columns, &self.numbers.u[range], x);
            for v in &mut row {
                *v *= self.numbers.inverse_pivot[i];
            }
            x[i] = row;
        }
    }

    /// x ← L⁻ᵀ U⁻ᵀ x.
    pub(super) fn solve_transposed<const W: usize>(&self, x: &mut [[f64; W]]) {
        let n = self.numbers.inverse_pivot.len();
        for i in 0..n {
            let mut row = x[i];
            for v in &mut row {
                *v *= self.numbers.inverse_pivot[i];
            }
            x[i] = row;
            let range = self.pattern.u_range(i);
            let columns = &self.pattern.u_column[range.clone()];
            subtract_column(row, columns, &self.numbers.u[range], x);
        }
        for i in (0..n).rev() {
            let range = self.pattern.l_range(i);
            let columns = &self.pattern.l_column[range.clone()];
            subtract_column(x[i], columns, &self.numbers.l[range], x);
        }
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
