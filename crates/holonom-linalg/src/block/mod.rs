mod products;

use crate::lanes::{Span, run_quads};
use products::{Product, TransposedProduct};
use std::ops::Range;
use std::sync::Arc;

/// Names one block of a [`BlockMatrix`]; blocks are numbered from zero in order of first mention.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BlockId(u32);

impl BlockId {
    /// Number of the block in its matrix.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Block {
    row: u32,
    column: u32,
    rows: u32,
    columns: u32,
    offset: u32,
}

impl Block {
    /// First row and column, rows and columns.
    fn place(self) -> (usize, usize, usize, usize) {
        (self.row as usize, self.column as usize, self.rows as usize, self.columns as usize)
    }

    /// Where its values are among those of the matrix.
    fn values(self) -> Range<usize> {
        let start = self.offset as usize;
        start..start + self.rows as usize * self.columns as usize
    }
}

/// Places are kept in half a word.
fn narrow(x: usize) -> u32 {
    u32::try_from(x).expect("a matrix of less than 2³² values")
}

/// Dense blocks at fixed places, one after the other: what matrices of one shape share.
///
/// Blocks may overlap; a matrix is the sum of its blocks.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockPattern {
    n_rows: usize,
    n_cols: usize,
    blocks: Arc<[Block]>,
    values: usize,
}

impl BlockPattern {
    /// Blocks given as (first row, first column, rows, columns).
    ///
    /// Equal blocks are one block. The second result names the block of each request.
    ///
    /// # Panics
    /// If a block reaches beyond the matrix.
    pub fn new(
        n_rows: usize,
        n_cols: usize,
        blocks: &[(usize, usize, usize, usize)],
    ) -> (Self, Vec<BlockId>) {
        let mut order: Vec<usize> = (0..blocks.len()).collect();
        order.sort_by_key(|&e| (blocks[e], e));
        // The first request of each group of equal ones stands for the group.
        let mut first = vec![0; blocks.len()];
        for (at, &e) in order.iter().enumerate() {
            let same = at > 0 && blocks[order[at - 1]] == blocks[e];
            first[e] = if same { first[order[at - 1]] } else { e };
        }
        let mut places = Vec::new();
        let mut ids = Vec::with_capacity(blocks.len());
        let mut offset = 0;
        for (e, &(row, column, rows, columns)) in blocks.iter().enumerate() {
            assert!(
                row + rows <= n_rows && column + columns <= n_cols,
                "block {rows}×{columns} at ({row}, {column}) is outside {n_rows}×{n_cols}"
            );
            if first[e] == e {
                ids.push(BlockId(narrow(places.len())));
                let [row, column, rows, columns] = [row, column, rows, columns].map(narrow);
                let block = Block { row, column, rows, columns, offset: narrow(offset) };
                offset = block.values().end;
                places.push(block);
            } else {
                ids.push(ids[first[e]]);
            }
        }
        (Self { n_rows, n_cols, blocks: places.into(), values: offset }, ids)
    }

    /// A matrix of zeros with these blocks.
    pub fn zeros(&self) -> BlockMatrix {
        BlockMatrix { pattern: self.clone(), values: vec![0.0; self.values] }
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Number of columns.
    pub fn n_cols(&self) -> usize {
        self.n_cols
    }

    /// Number of values of all blocks.
    #[allow(clippy::len_without_is_empty, reason = "a number of values, as of the matrix")]
    pub fn len(&self) -> usize {
        self.values
    }

    /// Place of one block: (first row, first column, rows, columns).
    pub fn shape(&self, id: BlockId) -> (usize, usize, usize, usize) {
        self.blocks[id.index()].place()
    }

    /// Where the values of one block are among those of the matrix.
    pub fn place(&self, id: BlockId) -> Range<usize> {
        self.blocks[id.index()].values()
    }

    /// Places of all blocks in the order of their values: (first row, first column, rows, columns).
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize, usize, usize)> + '_ {
        self.blocks.iter().map(|b| b.place())
    }

    /// Number of different blocks.
    pub fn n_blocks(&self) -> usize {
        self.blocks.len()
    }

    /// For every block the columns in which its rows of X can differ from zero, which are known by a bit each; columns of AᵀX
    /// are added to `reached`.
    pub fn transposed_spans(&self, columns: &[u32], reached: &mut [u32], spans: &mut Vec<Span>) {
        spans.clear();
        spans.extend(self.shapes().map(|(row, column, rows, width)| {
            let all = columns[row..row + rows].iter().fold(0, |all, x| all | x);
            reached[column..column + width].iter_mut().for_each(|x| *x |= all);
            Span::of(all)
        }));
    }

    /// (row, column) of every value, block after block, moved by the offsets: the entries of a matrix as a part of a
    /// larger [`SparsePattern`].
    ///
    /// Where blocks overlap a pair comes more than once; its values add up.
    ///
    /// [`SparsePattern`]: crate::SparsePattern
    pub fn entries(&self, row_offset: usize, column_offset: usize) -> Vec<(usize, usize)> {
        let mut entries = Vec::with_capacity(self.values);
        for (row, column, rows, columns) in self.shapes() {
            for i in 0..rows {
                for j in 0..columns {
                    entries.push((row_offset + row + i, column_offset + column + j));
                }
            }
        }
        entries
    }
}

/// A matrix made of dense blocks at fixed places; everything outside the blocks is zero.
///
/// Values of a block are stored by rows, blocks one after the other. Blocks may overlap; the
/// matrix is their sum.
#[derive(Debug, Clone, PartialEq)]
pub struct BlockMatrix {
    /// Shared by copies.
    pattern: BlockPattern,
    values: Vec<f64>,
}

impl BlockMatrix {
    /// A zero matrix with blocks given as (first row, first column, rows, columns).
    ///
    /// Equal blocks are one block. The second result names the block of each request.
    ///
    /// # Panics
    /// If a block reaches beyond the matrix.
    pub fn new(
        n_rows: usize,
        n_cols: usize,
        blocks: &[(usize, usize, usize, usize)],
    ) -> (Self, Vec<BlockId>) {
        let (pattern, ids) = BlockPattern::new(n_rows, n_cols, blocks);
        (pattern.zeros(), ids)
    }

    /// Its blocks.
    pub fn pattern(&self) -> &BlockPattern {
        &self.pattern
    }

    /// Number of rows.
    pub fn n_rows(&self) -> usize {
        self.pattern.n_rows
    }

    /// Number of columns.
    pub fn n_cols(&self) -> usize {
        self.pattern.n_cols
    }

    /// Sets every value to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }

    /// Gives up the room of the values, which are not to be asked for before [`restore`](Self::restore).
    pub fn release(&mut self) {
        self.values = Vec::new();
    }

    /// Makes room for the values again where it was given up.
    pub fn restore(&mut self) {
        self.values.resize(self.pattern.values, 0.0);
    }

    /// Values of one block, by rows.
    pub fn block(&self, id: BlockId) -> &[f64] {
        &self.values[self.pattern.blocks[id.index()].values()]
    }

    /// Values of one block, by rows.
    pub fn block_mut(&mut self, id: BlockId) -> &mut [f64] {
        &mut self.values[self.pattern.blocks[id.index()].values()]
    }

    /// All blocks, to be parted.
    pub fn blocks_mut(&mut self) -> BlocksMut<'_> {
        BlocksMut { blocks: &self.pattern.blocks, first: 0, values: &mut self.values }
    }

    /// Place of one block: (first row, first column, rows, columns).
    pub fn shape(&self, id: BlockId) -> (usize, usize, usize, usize) {
        self.pattern.shape(id)
    }

    /// Places of all blocks in the order of their values: (first row, first column, rows, columns).
    pub fn shapes(&self) -> impl Iterator<Item = (usize, usize, usize, usize)> + '_ {
        self.pattern.shapes()
    }

    /// Number of different blocks.
    pub fn n_blocks(&self) -> usize {
        self.pattern.n_blocks()
    }

    /// Adds `values` (by rows) to one block.
    ///
    /// # Panics
    /// If `values` has not the block's length.
    pub fn add(&mut self, id: BlockId, values: &[f64]) {
        let block = self.block_mut(id);
        assert_eq!(block.len(), values.len(), "as many values as the block has");
        for (a, v) in block.iter_mut().zip(values) {
            *a += v;
        }
    }

    /// All stored values, block after block.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// All stored values, block after block.
    pub fn values_mut(&mut self) -> &mut [f64] {
        &mut self.values
    }

    /// (row, column) of every stored value; see [`BlockPattern::entries`].
    pub fn entries(&self, row_offset: usize, column_offset: usize) -> Vec<(usize, usize)> {
        self.pattern.entries(row_offset, column_offset)
    }

    /// y += α A x, with x of `n_cols` and y of `n_rows`.
    ///
    /// # Panics
    /// If a vector has not the length of the matrix.
    pub fn multiply_add(&self, alpha: f64, x: &[f64], y: &mut [f64]) {
        self.multiply_many_add(alpha, x, 1, y);
    }

    /// y += α Aᵀ x, with x of `n_rows` and y of `n_cols`.
    ///
    /// # Panics
    /// If a vector has not the length of the matrix.
    pub fn multiply_transposed_add(&self, alpha: f64, x: &[f64], y: &mut [f64]) {
        self.multiply_transposed_many_add(alpha, x, 1, y);
    }

    /// Y += α A X, with X of `n_cols`×k and Y of `n_rows`×k, both by rows.
    ///
    /// # Panics
    /// If X or Y has not that many entries.
    pub fn multiply_many_add(&self, alpha: f64, x: &[f64], k: usize, y: &mut [f64]) {
        assert_eq!(
            (x.len(), y.len()),
            (self.n_cols() * k, self.n_rows() * k),
            "entries of X and Y"
        );
        run_quads(k, &mut Product { matrix: self, alpha, x, k, y });
    }

    /// Y += α Aᵀ X, with X of `n_rows`×k and Y of `n_cols`×k, both by rows.
    ///
    /// # Panics
    /// If X or Y has not that many entries.
    pub fn multiply_transposed_many_add(&self, alpha: f64, x: &[f64], k: usize, y: &mut [f64]) {
        self.multiply_transposed_spans_add(alpha, x, k, &[], y);
    }

    /// The same where X has zeros outside of these columns for one block after the other, as
    /// [`BlockPattern::transposed_spans`] tells them, with the same bits; of all columns where there are no `spans`.
    ///
    /// # Panics
    /// If X or Y has not that many entries.
    pub fn multiply_transposed_spans_add(
        &self,
        alpha: f64,
        x: &[f64],
        k: usize,
        spans: &[Span],
        y: &mut [f64],
    ) {
        assert_eq!(
            (x.len(), y.len()),
            (self.n_rows() * k, self.n_cols() * k),
            "entries of X and Y"
        );
        assert!(spans.is_empty() || k <= Span::MOST, "columns of spans");
        let Some(block) = self.pattern.blocks.first() else { return };
        run_quads(k, &mut TransposedProduct { matrix: self, alpha, x, k, spans, block, y });
    }

    /// The matrix with all its zeros, `n_rows`×`n_cols` by rows.
    pub fn to_dense(&self) -> Vec<f64> {
        let mut dense = vec![0.0; self.n_rows() * self.n_cols()];
        for ((i, j), v) in self.entries(0, 0).into_iter().zip(&self.values) {
            dense[i * self.n_cols() + j] += v;
        }
        dense
    }
}

/// Consecutive blocks of a [`BlockMatrix`].
#[derive(Debug)]
pub struct BlocksMut<'a> {
    blocks: &'a [Block],
    /// Number of values before theirs.
    first: usize,
    values: &'a mut [f64],
}

impl BlocksMut<'_> {
    /// The blocks whose values come before a value of the matrix (in the order of [`BlockMatrix::values`]), and the others.
    ///
    /// # Panics
    /// If that value is not among theirs.
    pub fn split_at(&mut self, value: usize) -> [BlocksMut<'_>; 2] {
        let (values, later) = self.values.split_at_mut(value - self.first);
        [
            BlocksMut { blocks: self.blocks, first: self.first, values },
            BlocksMut { blocks: self.blocks, first: value, values: later },
        ]
    }

    /// Values of one of the blocks, by rows.
    ///
    /// # Panics
    /// If it is none of them.
    #[inline]
    pub fn block_mut(&mut self, id: BlockId) -> &mut [f64] {
        let Range { start, end } = self.blocks[id.index()].values();
        &mut self.values[start - self.first..end - self.first]
    }

    /// Sets every value to zero.
    pub fn clear(&mut self) {
        self.values.fill(0.0);
    }
}
