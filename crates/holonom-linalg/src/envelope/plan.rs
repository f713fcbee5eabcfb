//! What an envelope factorisation knows before it sees numbers.

use super::graph::{BlockGraph, positions};
use std::ops::Range;

/// Places and counts of a block envelope: block rows from their first block to the diagonal.
///
/// Position p holds block `order[p]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EnvelopePlan {
    order: Vec<usize>,
    position: Vec<usize>,
    pub(super) lines: Vec<Line>,
    /// Row of the matrix at each scalar position.
    pub(super) row_at: Vec<usize>,
    /// Blocks are numbered as they stand.
    pub(super) natural: bool,
    operations: usize,
    multiplications: usize,
}

/// Block row at one position. Entry (r, c), c counted from `start`, stands at `offset + c * rows + r`: by columns,
/// so that the rows of a block lie side by side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Line {
    /// First block of the envelope, and its first scalar column.
    pub(super) first: usize,
    pub(super) start: usize,
    /// First scalar row, and number of rows.
    pub(super) begin: usize,
    pub(super) rows: usize,
    /// First value.
    pub(super) offset: usize,
}

impl Line {
    /// Columns left of the diagonal block.
    #[inline(always)]
    pub(super) fn left(&self) -> usize {
        self.begin - self.start
    }

    /// Its values.
    #[inline(always)]
    pub(super) fn values(&self) -> Range<usize> {
        self.offset..self.offset + self.rows * (self.left() + self.rows)
    }
}

impl EnvelopePlan {
    /// The plan for the blocks of `graph` when block `order[p]` stands at position p.
    ///
    /// # Panics
    /// If `order` is no permutation of the blocks.
    pub fn new(graph: &BlockGraph, order: &[usize]) -> Self {
        let count = graph.len();
        let position = positions(order, count);
        let mut lines: Vec<Line> = Vec::with_capacity(count);
        let (mut begin, mut offset) = (0, 0);
        let (mut operations, mut multiplications) = (0, 0);
        for (p, (&i, width)) in order.iter().zip(graph.widths(order)).enumerate() {
            let (first, rows) = (p - width, graph.sizes()[i]);
            let start = lines.get(first).map_or(begin, |line| line.begin);
            for (j, before) in lines.iter().enumerate().skip(first) {
                operations += j - first.max(before.first) + 2; // products, a solve, and one for the diagonal
                let columns = before.begin..before.begin + before.rows;
                let common = start.max(before.start);
                multiplications += columns.map(|c| rows * (c - common)).sum::<usize>();
            }
            multiplications += (0..rows).map(|d| (rows - d) * (begin + d - start)).sum::<usize>();
            lines.push(Line { first, start, begin, rows, offset });
            (begin, offset) = (begin + rows, lines[p].values().end);
        }
        let mut rows = vec![0; count + 1];
        for (i, size) in graph.sizes().iter().enumerate() {
            rows[i + 1] = rows[i] + size;
        }
        let row_at = order.iter().flat_map(|&i| rows[i]..rows[i + 1]).collect();
        let natural = order.is_sorted();
        let order = order.to_vec();
        Self { order, position, lines, row_at, natural, operations, multiplications }
    }

    /// The plan of the same matrix with its blocks numbered as they stand here: vectors need no reordering then.
    #[must_use]
    pub fn renumbered(self) -> Self {
        let blocks: Vec<usize> = (0..self.order.len()).collect();
        let row_at = (0..self.n()).collect();
        Self { order: blocks.clone(), position: blocks, row_at, natural: true, ..self }
    }

    /// Number of rows of the matrix.
    pub fn n(&self) -> usize {
        self.row_at.len()
    }

    /// Number of stored values: the length of a value slice.
    pub fn len(&self) -> usize {
        self.lines.last().map_or(0, |line| line.values().end)
    }

    /// Whether nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Block at each position.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// β: blocks left of the diagonal in the envelope of each position.
    pub fn widths(&self) -> impl Iterator<Item = usize> + '_ {
        self.lines.iter().enumerate().map(|(p, line)| p - line.first)
    }

    /// Blocks of the envelope left of the diagonal.
    pub fn envelope(&self) -> usize {
        self.widths().sum()
    }

    /// Products of two blocks and triangular solves with a block that one factorisation makes; the
    /// factorisations of the diagonal blocks are not counted.
    pub fn operations(&self) -> usize {
        self.operations
    }

    /// Σ β(β + 3)/2, never less than [`operations`](Self::operations) and the same where every row is full.
    ///
    /// Source: D. Negrut's thesis (1998), (3.126).
    pub fn operation_bound(&self) -> usize {
        self.widths().map(|b| b * (b + 3) / 2).sum()
    }

    /// Multiplications of one factorisation.
    pub fn multiplications(&self) -> usize {
        self.multiplications
    }

    /// Whether block `i` stands before block `j`, or is the same.
    pub fn in_order(&self, i: usize, j: usize) -> bool {
        self.position[i] <= self.position[j]
    }

    /// Where the values of block (i, j) stand, by rows, i before j in the order or the same. Of a
    /// diagonal block only entries (r, c ≥ r) are read.
    ///
    /// # Panics
    /// If (i, j) is not in the envelope or j stands before i.
    pub fn block(&self, i: usize, j: usize) -> Range<usize> {
        let (p, q) = (self.position[i], self.position[j]);
        let (block, line) = (&self.lines[p], &self.lines[q]);
        assert!(line.first <= p && p <= q, "block ({i}, {j}) is not in the envelope");
        let start = line.offset + (block.begin - line.start) * line.rows;
        start..start + block.rows * line.rows
    }
}
