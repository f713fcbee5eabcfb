//! Pattern of the LU factors for a given pivot sequence.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use crate::sparse::SparsePattern;
use crate::sparse::ordering::PivotOrder;
use crate::watch::checkpoint;

/// Pattern of L (without its unit diagonal) and U (without its diagonal) by rows, in pivot
/// positions, columns ascending.
#[derive(Debug, Clone)]
pub(super) struct FactorPattern {
    pub(super) l_start: Vec<u32>,
    pub(super) l_column: Vec<u32>,
    pub(super) u_start: Vec<u32>,
    pub(super) u_column: Vec<u32>,
}

impl FactorPattern {
    /// Unites the rows of A with the rows of U that eliminate them.
    pub(super) fn new(pattern: &SparsePattern, order: &PivotOrder) -> Self {
        let n = order.rows.len();
        let mut position = vec![0u32; n];
        for (p, &j) in order.columns.iter().enumerate() {
            position[j] = p as u32;
        }
        let mut result =
            Self { l_start: vec![0], l_column: Vec::new(), u_start: vec![0], u_column: Vec::new() };
        let mut row = Row { p: 0, seen: vec![u32::MAX; n], left: BinaryHeap::new() };
        let mut right = Vec::new();
        let mut counted = 0;
        for (p, &i) in order.rows.iter().enumerate() {
            checkpoint(8 * (result.u_column.len() - counted));
            counted = result.u_column.len();
            row.p = p as u32;
            for (_, j) in pattern.row(i) {
                row.mark(position[j], &mut right);
            }
            while let Some(Reverse(k)) = row.left.pop() {
                result.l_column.push(k);
                for at in result.u_range(k as usize) {
                    row.mark(result.u_column[at], &mut right);
                }
            }
            result.l_start.push(result.l_column.len() as u32);
            right.sort_unstable();
            result.u_column.append(&mut right);
            result.u_start.push(result.u_column.len() as u32);
        }
        result
    }

    pub(super) fn n(&self) -> usize {
        self.l_start.len() - 1
    }

    pub(super) fn l_range(&self, i: usize) -> std::ops::Range<usize> {
        self.l_start[i] as usize..self.l_start[i + 1] as usize
    }

    pub(super) fn u_range(&self, i: usize) -> std::ops::Range<usize> {
        self.u_start[i] as usize..self.u_start[i + 1] as usize
    }

    /// Entries stored in both factors, the diagonal counted once.
    pub(super) fn fill(&self) -> usize {
        self.l_column.len() + self.u_column.len() + self.n()
    }

    /// Additions and multiplications of one elimination.
    pub(super) fn operations(&self) -> usize {
        self.l_column.iter().map(|&j| 2 * self.u_range(j as usize).len() + 1).sum()
    }

    /// The same pivots in an order with the same fill, in which a pivot follows at once the one
    /// that made it ready where that is possible. Rows of U with equal patterns become neighbours.
    pub(super) fn gather(&self, order: &PivotOrder) -> PivotOrder {
        let n = order.rows.len();
        // p must stay before q when U(p, q) or L(q, p) is stored.
        let mut after: Vec<Vec<u32>> = vec![Vec::new(); n];
        let mut waiting_for = vec![0u32; n];
        let mut link = |p: u32, q: u32| {
            after[p as usize].push(q);
            waiting_for[q as usize] += 1;
        };
        for i in 0..n {
            checkpoint(8 * self.u_range(i).len());
            for at in self.u_range(i) {
                link(i as u32, self.u_column[at]);
            }
            for at in self.l_range(i) {
                link(self.l_column[at], i as u32);
            }
        }
        let mut ready: Vec<u32> =
            (0..n as u32).rev().filter(|&p| waiting_for[p as usize] == 0).collect();
        let mut result = PivotOrder { rows: Vec::new(), columns: Vec::new() };
        while let Some(p) = ready.pop() {
            checkpoint(8 * after[p as usize].len());
            result.rows.push(order.rows[p as usize]);
            result.columns.push(order.columns[p as usize]);
            let from = ready.len();
            for &q in &after[p as usize] {
                waiting_for[q as usize] -= 1;
                if waiting_for[q as usize] == 0 {
                    ready.push(q);
                }
            }
            ready[from..].sort_unstable_by_key(|&q| Reverse(q));
        }
        result
    }
}

/// Pattern of one row while it is found.
struct Row {
    p: u32,
    seen: Vec<u32>,
    left: BinaryHeap<Reverse<u32>>,
}

impl Row {
    fn mark(&mut self, k: u32, right: &mut Vec<u32>) {
        if self.seen[k as usize] != self.p {
            self.seen[k as usize] = self.p;
            if k < self.p {
                self.left.push(Reverse(k));
            } else if k > self.p {
                right.push(k);
            }
        }
    }
}
