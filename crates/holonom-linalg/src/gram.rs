//! Products AᵀB of tall matrices.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::linalg::triangular_solve;
use faer::{Accum, MatMut, MatRef, Par};

use crate::lanes::{
    Arithmetic, MOST_LANES, QuadKernel, Span, add_transposed, marks, rows_of, run_quads,
};

/// Rows that [`gram_add`] takes at a time: as many as a body in space has, whose zeros are in the same columns.
pub const GRAM_ROWS: usize = 7;

/// C += AᵀB for so few columns that they are one group: less work than the way into the library, and what a variable does
/// not move costs nothing.
struct GramProduct<'a> {
    k: usize,
    a: &'a [f64],
    b: &'a [f64],
    spans: &'a [Span],
    /// Rows that are multiplied.
    rows: Range<usize>,
    c: &'a mut [f64],
}

impl GramProduct<'_> {
    /// What N rows add.
    #[inline(always)]
    fn add_rows<A: Arithmetic, const H: usize, const N: usize>(&mut self, at: [usize; 2]) {
        let Self { k, a, b, rows: Range { start, .. }, ref mut c, .. } = *self;
        let b = rows_of::<H, N>(b, k, start, at);
        let (row, mut rest) = a[start * k..].split_at(k);
        let mut rows = [row; N];
        for i in 1..N {
            (rows[i], rest) = rest.split_at(k);
        }
        for next in (0..k).step_by(4) {
            // Some of the last four were among the others.
            let from = next.min(k - 4);
            let mut four = [[0.0; 4]; N];
            for i in 0..N {
                four[i] = *rows[i][from..].first_chunk().expect("four columns");
                for j in 0..next - from {
                    four[i][j] = 0.0;
                }
            }
            add_transposed::<A, H, N, 4>(
                1.0,
                (&four, &marks(&four)),
                &b,
                &mut c[from * k..],
                k,
                at,
            );
        }
    }
}

impl QuadKernel for GramProduct<'_> {
    #[inline(always)]
    fn run_group<A: Arithmetic>(&mut self, from: usize, group: Span) {
        let count = self.a.len() / self.k;
        let whole = count - count % GRAM_ROWS;
        for (part, first) in (0..whole).step_by(GRAM_ROWS).enumerate() {
            self.rows = first..first + GRAM_ROWS;
            self.spans.get(part).unwrap_or(&group).run::<A>(from, self);
        }
        for row in whole..count {
            self.rows = row..row + 1;
            group.run::<A>(from, self);
        }
    }

    #[inline(always)]
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize) {
        if self.rows.len() == GRAM_ROWS {
            self.add_rows::<A, H, GRAM_ROWS>([from, width]);
        } else {
            self.add_rows::<A, H, 1>([from, width]);
        }
    }

    fn run_few<const W: usize>(&mut self) {
        let ((a, _), (b, _)) = (self.a.as_chunks::<W>(), self.b.as_chunks::<W>());
        for (a, b) in a.iter().zip(b) {
            for (c, a) in self.c.chunks_exact_mut(W).zip(a) {
                c.iter_mut().zip(b).for_each(|(c, b)| *c += a * b);
            }
        }
    }
}

/// C += Aᵀ B with A and B of `n_rows`×k and C of k×k, all by rows.
///
/// # Panics
/// If a matrix has not that many entries.
pub fn gram_add(n_rows: usize, k: usize, a: &[f64], b: &[f64], c: &mut [f64]) {
    gram_spans_add(n_rows, k, a, b, &[], c);
}

/// The same where B has zeros outside of these columns for [`GRAM_ROWS`] rows each, with the same bits; of all columns where
/// there are no `spans`.
///
/// # Panics
/// If a matrix has not that many entries.
pub fn gram_spans_add(
    n_rows: usize,
    k: usize,
    a: &[f64],
    b: &[f64],
    spans: &[Span],
    c: &mut [f64],
) {
    assert_eq!(
        (a.len(), b.len(), c.len()),
        (n_rows * k, n_rows * k, k * k),
        "entries of A, B and C"
    );
    if k <= MOST_LANES {
        return run_quads(k, &mut GramProduct { k, a, b, spans, rows: 0..0, c });
    }
    let a = MatRef::from_row_major_slice(a, n_rows, k);
    let b = MatRef::from_row_major_slice(b, n_rows, k);
    let c = MatMut::from_row_major_slice_mut(c, k, k);
    matmul(c, Accum::Add, a.transpose(), b, 1.0, Par::Seq);
    // A large product leaves the wide registers in use, and from then on a call of a sine takes twenty times as long.
    // Every other function of the library ends that.
    let one = MatRef::from_column_major_slice(&[1.0], 1, 1);
    let mut x = [0.0];
    let x = MatMut::from_column_major_slice_mut(&mut x, 1, 1);
    triangular_solve::solve_lower_triangular_in_place(one, x, Par::Seq);
}
