//! Products of a block matrix with several columns.

use super::{Block, BlockMatrix};
use crate::lanes::{
    Arithmetic, QuadKernel, Span, add_column, add_multiple, add_quads, add_transposed, marks,
    quads, rows_of,
};

/// Y += α A X for k columns.
pub(super) struct Product<'a> {
    pub(super) matrix: &'a BlockMatrix,
    pub(super) alpha: f64,
    pub(super) x: &'a [f64],
    pub(super) k: usize,
    pub(super) y: &'a mut [f64],
}

// Loops of a known length cost a fraction of those over blocks of any size.
impl QuadKernel for Product<'_> {
    #[inline(always)]
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize) {
        for &b in self.matrix.pattern.blocks.iter() {
            match b.columns {
                0 => {}
                1 => self.add_block::<A, H, 1>(b, [from, width]),
                2 => self.add_block::<A, H, 2>(b, [from, width]),
                3 => self.add_block::<A, H, 3>(b, [from, width]),
                4 => self.add_block::<A, H, 4>(b, [from, width]),
                7 => self.add_block::<A, H, 7>(b, [from, width]),
                _ => self.add_any::<A, H>(b, [from, width]),
            }
        }
    }

    fn run_few<const W: usize>(&mut self) {
        if W == 1 {
            return self.of_vector();
        }
        let ((x, _), (y, _)) = (self.x.as_chunks::<W>(), self.y.as_chunks_mut::<W>());
        for b in self.matrix.pattern.blocks.iter().filter(|b| b.columns > 0) {
            let (first_row, first_column, rows, columns) = b.place();
            let x = &x[first_column..first_column + columns];
            let values = self.matrix.values[b.values()].chunks_exact(columns);
            for (y, row) in y[first_row..first_row + rows].iter_mut().zip(values) {
                let mut sum = [0.0; W];
                for (a, x) in row.iter().zip(x) {
                    sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += a * x);
                }
                y.iter_mut().zip(&sum).for_each(|(y, sum)| *y += self.alpha * sum);
            }
        }
    }
}

/// y += α A x for a block of N columns.
#[inline(always)]
fn add_rows<const N: usize>(alpha: f64, values: &[f64], x: &[f64], y: &mut [f64]) {
    let (rows, _) = values.as_chunks::<N>();
    for (y, row) in y.iter_mut().zip(rows) {
        *y += alpha * row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
    }
}

impl Product<'_> {
    /// The product with X of one column.
    pub(super) fn of_vector(&mut self) {
        for b in self.matrix.pattern.blocks.iter().filter(|b| b.columns > 0) {
            let (first_row, first_column, rows, columns) = b.place();
            let values = &self.matrix.values[b.values()];
            let x = &self.x[first_column..first_column + columns];
            let y = &mut self.y[first_row..first_row + rows];
            match columns {
                1 => add_rows::<1>(self.alpha, values, x, y),
                2 => add_rows::<2>(self.alpha, values, x, y),
                3 => add_rows::<3>(self.alpha, values, x, y),
                4 => add_rows::<4>(self.alpha, values, x, y),
                7 => add_rows::<7>(self.alpha, values, x, y),
                _ => {
                    for (y, row) in y.iter_mut().zip(values.chunks_exact(columns)) {
                        *y += self.alpha * row.iter().zip(x).map(|(a, x)| a * x).sum::<f64>();
                    }
                }
            }
        }
    }

    /// The product with a block of N columns.
    #[inline(always)]
    fn add_block<A: Arithmetic, const H: usize, const N: usize>(
        &mut self,
        b: Block,
        at: [usize; 2],
    ) {
        let (first_row, first_column, _, _) = b.place();
        let (rows, _) = self.matrix.values[b.values()].as_chunks::<N>();
        // Numbers of its own, which are not read again after every store.
        let Self { alpha, k, x, ref mut y, .. } = *self;
        let x = rows_of::<H, N>(x, k, first_column, at);
        for (i, row) in rows.iter().enumerate() {
            let (mut sums, mut end) = ([[0.0; 4]; H], [0.0; 4]);
            for j in 0..N {
                for h in 0..H {
                    add_multiple::<A>(&mut sums[h], row[j], &x[j].0[h]);
                }
                add_multiple::<A>(&mut end, row[j], x[j].1);
            }
            add_quads::<A, H>(alpha, (&sums, &end), y, k, first_row + i, at);
        }
    }

    #[inline(always)]
    fn add_any<A: Arithmetic, const H: usize>(&mut self, b: Block, at: [usize; 2]) {
        let (first_row, first_column, _, columns) = b.place();
        for (i, row) in self.matrix.values[b.values()].chunks_exact(columns).enumerate() {
            let (mut sums, mut end) = ([[0.0; 4]; H], [0.0; 4]);
            for (j, a) in row.iter().enumerate() {
                let x = quads::<H>(self.x, self.k, first_column + j, at);
                for h in 0..H {
                    add_multiple::<A>(&mut sums[h], *a, &x.0[h]);
                }
                add_multiple::<A>(&mut end, *a, x.1);
            }
            add_quads::<A, H>(self.alpha, (&sums, &end), self.y, self.k, first_row + i, at);
        }
    }
}

/// Y += α AᵀX, of some columns for one block after the other.
pub(super) struct TransposedProduct<'a> {
    pub(super) matrix: &'a BlockMatrix,
    pub(super) alpha: f64,
    pub(super) x: &'a [f64],
    pub(super) k: usize,
    pub(super) spans: &'a [Span],
    /// The block that is multiplied.
    pub(super) block: &'a Block,
    pub(super) y: &'a mut [f64],
}

impl QuadKernel for TransposedProduct<'_> {
    #[inline(always)]
    fn run_group<A: Arithmetic>(&mut self, from: usize, group: Span) {
        let matrix = self.matrix;
        for (k, block) in matrix.pattern.blocks.iter().enumerate() {
            self.block = block;
            self.spans.get(k).unwrap_or(&group).run::<A>(from, self);
        }
    }

    #[inline(always)]
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize) {
        let (b, at) = (*self.block, [from, width]);
        match (b.rows, b.columns) {
            (1, 3) => self.add_block::<A, H, 1, 3>(b, at),
            (2, 3) => self.add_block::<A, H, 2, 3>(b, at),
            (3, 3) => self.add_block::<A, H, 3, 3>(b, at),
            (1, 4) => self.add_block::<A, H, 1, 4>(b, at),
            (4, 4) => self.add_block::<A, H, 4, 4>(b, at),
            (1, 7) => self.add_block::<A, H, 1, 7>(b, at),
            (2, 7) => self.add_block::<A, H, 2, 7>(b, at),
            (3, 7) => self.add_block::<A, H, 3, 7>(b, at),
            (4, 7) => self.add_block::<A, H, 4, 7>(b, at),
            (5, 7) => self.add_block::<A, H, 5, 7>(b, at),
            (6, 7) => self.add_block::<A, H, 6, 7>(b, at),
            (7, 7) => self.add_block::<A, H, 7, 7>(b, at),
            (0, _) | (_, 0) => {}
            _ => self.add_any::<A, H>(b, at),
        }
    }

    fn run_few<const W: usize>(&mut self) {
        for b in self.matrix.pattern.blocks.iter().filter(|b| b.rows > 0 && b.columns > 0) {
            let (first_row, first_column, rows, columns) = b.place();
            let values = &self.matrix.values[b.values()];
            if W == 1 && [3, 4, 7].contains(&columns) {
                let x = &self.x[first_row..first_row + rows];
                let y = &mut self.y[first_column..first_column + columns];
                match columns {
                    3 => add_columns::<3>(self.alpha, values, x, y),
                    4 => add_columns::<4>(self.alpha, values, x, y),
                    _ => add_columns::<7>(self.alpha, values, x, y),
                }
                continue;
            }
            let ((x, _), (y, _)) = (self.x.as_chunks::<W>(), self.y.as_chunks_mut::<W>());
            let x = &x[first_row..first_row + rows];
            for (j, y) in y[first_column..first_column + columns].iter_mut().enumerate() {
                let mut sum = *y;
                for (a, x) in values[j..].iter().step_by(columns).zip(x) {
                    sum.iter_mut().zip(x).for_each(|(sum, x)| *sum += self.alpha * a * x);
                }
                *y = sum;
            }
        }
    }
}

/// y += α Aᵀ x for a block of N columns.
#[inline(always)]
fn add_columns<const N: usize>(alpha: f64, values: &[f64], x: &[f64], y: &mut [f64]) {
    let (rows, _) = values.as_chunks::<N>();
    let y: &mut [f64; N] = y.first_chunk_mut().expect("N columns");
    let mut sums = *y;
    for (row, x) in rows.iter().zip(x) {
        sums.iter_mut().zip(row).for_each(|(sum, a)| *sum += alpha * a * x);
    }
    *y = sums;
}

impl TransposedProduct<'_> {
    /// The product with a block of N rows and M columns.
    #[inline(always)]
    fn add_block<A: Arithmetic, const H: usize, const N: usize, const M: usize>(
        &mut self,
        b: Block,
        at: [usize; 2],
    ) {
        let (first_row, first_column, _, _) = b.place();
        let values = self.matrix.values[b.values()].as_chunks::<M>().0.first_chunk::<N>();
        let values = values.expect("a block of N rows");
        let marks = marks(values);
        let mut any = 0;
        for j in 0..M {
            any |= marks[j];
        }
        // Of bodies that are not coupled here.
        if any == 0 {
            return;
        }
        let Self { alpha, k, x, ref mut y, .. } = *self;
        let x = rows_of::<H, N>(x, k, first_row, at);
        add_transposed::<A, H, N, M>(
            alpha,
            (values, &marks),
            &x,
            &mut y[first_column * k..],
            k,
            at,
        );
    }

    #[inline(always)]
    fn add_any<A: Arithmetic, const H: usize>(&mut self, b: Block, at: [usize; 2]) {
        let (first_row, first_column, _, columns) = b.place();
        let Self { alpha, k, x, ref mut y, .. } = *self;
        for (i, row) in self.matrix.values[b.values()].chunks_exact(columns).enumerate() {
            let x = rows_of::<H, 1>(x, k, first_row + i, at);
            for (j, a) in row.iter().enumerate().filter(|(_, a)| **a != 0.0) {
                add_column::<A, H, 1>(&[alpha * a], &x, y, k, first_column + j, at);
            }
        }
    }
}
