//! Forward and backward substitution with several right-hand sides at a time.

use crate::lanes::{Arithmetic, LaneKernel, lanes, lanes_mut};
use crate::scalar::Scalar;
use crate::sparse::elimination::{Columns, Factors, Side};

/// Solution in place for the n×k right-hand sides `b`, with the factors or their transposes.
pub(super) struct Substitution<'a, T> {
    pub(super) factors: &'a Factors<T>,
    /// Row of `b` and its scale at each position, for right-hand sides and for solutions.
    pub(super) source: (&'a [usize], &'a [f64]),
    pub(super) target: (&'a [usize], &'a [f64]),
    /// More scales, of the rows of `b` before and after.
    pub(super) scales: Option<[&'a [f64]; 2]>,
    pub(super) transposed: bool,
    /// Of several right-hand sides with the transpose.
    pub(super) columns: Option<&'a Columns>,
    pub(super) b: &'a mut [T],
    pub(super) k: usize,
    pub(super) work: &'a mut [T],
}

impl<T: Scalar> LaneKernel for Substitution<'_, T> {
    #[inline(always)]
    fn run<A: Arithmetic, const W: usize>(&mut self, from: usize) {
        let (f, transposed) = (self.factors, self.transposed);
        let (x, _) = self.work[..f.inverse_pivot.len() * W].as_chunks_mut::<W>();
        let [before, after] = self.scales.unwrap_or_default();
        let places = self.source.0.iter().zip(self.source.1).zip(&f.inverse_pivot);
        for (x, ((&i, scale), inverse)) in x.iter_mut().zip(places) {
            let b: &[T; W] = lanes(self.b, self.k, i, from);
            let scale = before.get(i).map_or(*scale, |before| scale * before);
            let scale = if transposed { T::from(scale) } else { inverse.scaled(scale) };
            *x = multiple(b, scale);
        }
        // Loops, as closures would be compiled for the plain processor.
        if !transposed {
            for side in &f.plan.left {
                subtract_row::<A, T, W>(f, side, x);
            }
            for side in f.plan.right.iter().rev() {
                subtract_row::<A, T, W>(f, side, x);
            }
        } else if let Some(columns) = self.columns {
            let (numbers, entries) = (&f.numbers[..], &columns.entries[..]);
            for side in &columns.right {
                subtract_listed::<A, T, W>(numbers, entries, side, x);
            }
            for side in columns.left.iter().rev() {
                subtract_listed::<A, T, W>(numbers, entries, side, x);
            }
        } else {
            for side in &f.plan.right {
                subtract_column::<A, T, W>(f, side, x);
            }
            for side in f.plan.left.iter().rev() {
                subtract_column::<A, T, W>(f, side, x);
            }
        }
        let places = self.target.0.iter().zip(self.target.1).zip(&f.inverse_pivot);
        for (x, ((&i, scale), inverse)) in x.iter().zip(places) {
            let b: &mut [T; W] = lanes_mut(self.b, self.k, i, from);
            let scale = after.get(i).map_or(*scale, |after| scale * after);
            let scale = if transposed { inverse.scaled(scale) } else { T::from(scale) };
            *b = multiple(x, scale);
        }
    }
}

/// a x, from numbers of its own: of slices the processor is not told that they do not overlap.
#[inline(always)]
fn multiple<T: Scalar, const W: usize>(x: &[T; W], a: T) -> [T; W] {
    let mut out = *x;
    for w in 0..W {
        out[w] = out[w] * a;
    }
    out
}

#[inline(always)]
fn entries<'a, T>(f: &'a Factors<T>, side: &Side) -> (&'a [u32], &'a [T]) {
    let range = side.start as usize..side.end as usize;
    (&f.plan.columns[range.clone()], &f.numbers[range])
}

/// xᵢ ← xᵢ − Σ valueⱼ xⱼ for the row i.
#[inline(always)]
fn subtract_row<A: Arithmetic, T: Scalar, const W: usize>(
    f: &Factors<T>,
    side: &Side,
    x: &mut [[T; W]],
) {
    let (columns, values) = entries(f, side);
    let mut row = x[side.row as usize];
    if W == 1 && columns.len() >= 8 {
        // Four sums, or the latency of one addition after the other would be waited for.
        let mut sums = [T::ZERO; 4];
        let (columns, last_columns) = columns.as_chunks::<4>();
        let (values, last_values) = values.as_chunks::<4>();
        for (j, a) in columns.iter().zip(values) {
            for s in 0..4 {
                sums[s] = sums[s].minus_product::<A>(a[s], x[j[s] as usize][0]);
            }
        }
        for (s, (&j, a)) in last_columns.iter().zip(last_values).enumerate() {
            sums[s] = sums[s].minus_product::<A>(*a, x[j as usize][0]);
        }
        row[0] = row[0] + ((sums[0] + sums[1]) + (sums[2] + sums[3]));
    } else {
        for (&j, a) in columns.iter().zip(values) {
            let other = &x[j as usize];
            for w in 0..W {
                row[w] = row[w].minus_product::<A>(*a, other[w]);
            }
        }
    }
    x[side.row as usize] = row;
}

/// xⱼ ← xⱼ − valueⱼ xᵢ for the row i.
#[inline(always)]
fn subtract_column<A: Arithmetic, T: Scalar, const W: usize>(
    f: &Factors<T>,
    side: &Side,
    x: &mut [[T; W]],
) {
    let (columns, values) = entries(f, side);
    let row = x[side.row as usize];
    for (&j, a) in columns.iter().zip(values) {
        let other = &mut x[j as usize];
        for w in 0..W {
            other[w] = other[w].minus_product::<A>(*a, row[w]);
        }
    }
}

/// The same for all rows i of one column j: several right-hand sides are not stored in between.
#[inline(always)]
fn subtract_listed<A: Arithmetic, T: Scalar, const W: usize>(
    numbers: &[T],
    entries: &[(u32, u32)],
    side: &Side,
    x: &mut [[T; W]],
) {
    let mut own = x[side.row as usize];
    for &(i, place) in &entries[side.start as usize..side.end as usize] {
        let (a, other) = (numbers[place as usize], &x[i as usize]);
        for w in 0..W {
            own[w] = own[w].minus_product::<A>(a, other[w]);
        }
    }
    x[side.row as usize] = own;
}
