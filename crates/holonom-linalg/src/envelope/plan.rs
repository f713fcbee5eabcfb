//! What an envelope factorisation knows before it sees numbers.

use super::graph::{BlockGraph, positions};
use std::ops::Range;

/// Places and counts of a block envelope: block rows from their first block to the diagonal.
///
/// Position p holds block `order[p]`. Entry (r, c) of block row p, c counted from the first column of
/// the row's envelope, stands at `offset[p] + c * rows + r`: by columns, so that the rows of a block lie
/// side by side.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EnvelopePlan {
    pub(super) order: Vec<usize>,
    position: Vec<usize>,
    /// First block of each block row.
    pub(super) first: Vec<usize>,
    /// First scalar row of each position, and the number of rows.
    pub(super) begin: Vec<usize>,
    /// First value of each block row, and the number of values.
    pub(super) offset: Vec<usize>,
    /// Row of the matrix at each scalar position.
    pub(super) row_at: Vec<usize>,
    operations: usize,
    multiplications: usize,
}

impl EnvelopePlan {
    /// The plan for the blocks of `graph` when block `order[p]` stands at position p.
    ///
    /// # Panics
    /// If `order` is no permutation of the blocks.
    pub fn new(graph: &BlockGraph, order: &[usize]) -> Self {
        let count = graph.len();
        let position = positions(order, count);
        let first: Vec<usize> =
            graph.widths(order).into_iter().enumerate().map(|(p, width)| p - width).collect();
        let mut begin = vec![0; count + 1];
        for (p, &i) in order.iter().enumerate() {
            begin[p + 1] = begin[p] + graph.sizes()[i];
        }
        let mut offset = vec![0; count + 1];
        let (mut operations, mut multiplications) = (0, 0);
        for p in 0..count {
            let rows = begin[p + 1] - begin[p];
            offset[p + 1] = offset[p] + rows * (begin[p + 1] - begin[first[p]]);
            for j in first[p]..p {
                let common = first[p].max(first[j]);
                operations += j - common + 2; // products, a solve, and one for the diagonal
                let columns = begin[j]..begin[j + 1];
                multiplications += columns.map(|c| rows * (c - begin[common])).sum::<usize>();
            }
            multiplications +=
                (0..rows).map(|d| (rows - d) * (begin[p] + d - begin[first[p]])).sum::<usize>();
        }
        let mut rows = vec![0; count + 1];
        for (i, size) in graph.sizes().iter().enumerate() {
            rows[i + 1] = rows[i] + size;
        }
        let row_at = order.iter().flat_map(|&i| rows[i]..rows[i + 1]).collect();
        let order = order.to_vec();
        Self { order, position, first, begin, offset, row_at, operations, multiplications }
    }

    /// Number of rows of the matrix.
    pub fn n(&self) -> usize {
        self.row_at.len()
    }

    /// Number of stored values: the length of a value slice.
    pub fn len(&self) -> usize {
        self.offset[self.order.len()]
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
        self.first.iter().enumerate().map(|(p, first)| p - first)
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
        assert!(self.first[q] <= p && p <= q, "block ({i}, {j}) is not in the envelope");
        let rows = self.begin[q + 1] - self.begin[q];
        let start = self.offset[q] + (self.begin[p] - self.begin[self.first[q]]) * rows;
        start..start + (self.begin[p + 1] - self.begin[p]) * rows
    }
}
