//! Forward and backward substitution with several right-hand sides at a time.

use crate::lanes::{LaneKernel, lanes, lanes_mut};
use crate::sparse::elimination::{Factors, Side};

/// Solution in place for the n×k right-hand sides `b`, with the factors or their transposes.
pub(super) struct Substitution<'a> {
    pub(super) factors: &'a Factors,
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
        let f = self.factors;
        let (x, _) = self.work[..f.inverse_pivot.len() * W].as_chunks_mut::<W>();
        let places = self.source.0.iter().zip(self.source.1).zip(&f.inverse_pivot);
        for (x, ((&i, scale), inverse)) in x.iter_mut().zip(places) {
            let b: &[f64; W] = lanes(self.b, self.k, i, from);
            let scale = if self.transposed { *scale } else { scale * inverse };
            for w in 0..W {
                x[w] = b[w] * scale;
            }
        }
        if self.transposed {
            f.right.iter().for_each(|side| subtract_column(f, side, x));
            f.left.iter().rev().for_each(|side| subtract_column(f, side, x));
        } else {
            f.left.iter().for_each(|side| subtract_row(f, side, x));
            f.right.iter().rev().for_each(|side| subtract_row(f, side, x));
        }
        let places = self.target.0.iter().zip(self.target.1).zip(&f.inverse_pivot);
        for (x, ((&i, scale), inverse)) in x.iter().zip(places) {
            let b: &mut [f64; W] = lanes_mut(self.b, self.k, i, from);
            let scale = if self.transposed { scale * inverse } else { *scale };
            for w in 0..W {
                b[w] = x[w] * scale;
            }
        }
    }
}

#[inline(always)]
fn entries<'a>(f: &'a Factors, side: &Side) -> (&'a [u32], &'a [f64]) {
    let range = side.start as usize..side.end as usize;
    (&f.columns[range.clone()], &f.numbers[range])
}

/// xᵢ ← xᵢ − Σ valueⱼ xⱼ for the row i.
#[inline(always)]
fn subtract_row<const W: usize>(f: &Factors, side: &Side, x: &mut [[f64; W]]) {
    let (columns, values) = entries(f, side);
    let mut row = x[side.row as usize];
    if W == 1 && columns.len() >= 8 {
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
    } else {
        for (&j, a) in columns.iter().zip(values) {
            let other = &x[j as usize];
            for w in 0..W {
                row[w] -= a * other[w];
            }
        }
    }
    x[side.row as usize] = row;
}

/// xⱼ ← xⱼ − valueⱼ xᵢ for the row i.
#[inline(always)]
fn subtract_column<const W: usize>(f: &Factors, side: &Side, x: &mut [[f64; W]]) {
    let (columns, values) = entries(f, side);
    let row = x[side.row as usize];
    for (&j, a) in columns.iter().zip(values) {
        let other = &mut x[j as usize];
        for w in 0..W {
            other[w] -= a * row[w];
        }
    }
}
