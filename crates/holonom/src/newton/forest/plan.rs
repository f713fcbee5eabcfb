//! Where the entries of a tree's matrix stand, found once.

use crate::reduction::{Manifold, Projection};
use holonom_linalg::BlockForest;
use std::sync::Arc;

/// Places, found once.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) forest: Arc<BlockForest>,
    /// (value of G, A₀ or A₁; slot), (value of the moving rows, slot), (constant, slot).
    pub(super) jacobian: Vec<(u32, u32)>,
    pub(super) moving: Vec<(u32, u32)>,
    pub(super) constants: Vec<(f64, u32)>,
    /// First values of the blocks of K and C (b, b), (b, p), (p, b); none is `usize::MAX`.
    pub(super) blocks: Vec<[usize; 3]>,
    /// Blocks of M: body, first row and column in it, order, first value.
    pub(super) masses: Vec<[usize; 4]>,
    /// First of the independent variables of each body, in a numbering of their own, and one more.
    pub(super) first: Vec<usize>,
    /// First value of each body's factors of order of its independent variables.
    pub(super) pivots: Vec<usize>,
    /// Extra states, and the child of their two bodies.
    pub(super) extra: Vec<Extra>,
}

/// An extra state and its bodies.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extra {
    pub(super) state: usize,
    pub(super) bodies: [Option<usize>; 2],
    pub(super) child: usize,
}

/// No block.
pub(super) const NONE: usize = usize::MAX;

impl Plan {
    pub(super) fn new(manifold: &Manifold, forest: &Arc<BlockForest>) -> Option<Self> {
        let (structure, chart) = (manifold.system().structure(), manifold.chart());
        let (n, count) = (structure.sizes.per_body, structure.sizes.bodies);
        let parametrization = chart.parametrization();
        let rank = parametrization.kept.len();
        let mut masses = Vec::new();
        let mut offset = 0;
        for (row, column, rows, columns) in structure.mass_pattern.shapes() {
            let inside = row / n == (row + rows - 1) / n;
            if !inside || (row, rows) != (column, columns) {
                return None;
            }
            masses.push([row / n, row % n, rows, offset]);
            offset += rows * columns;
        }
        let mut blocks = vec![[NONE; 3]; count];
        let mut offset = 0;
        for (row, column, rows, columns) in structure.stiffness_pattern.shapes() {
            if (rows, columns, row % n, column % n) != (n, n, 0, 0) {
                return None;
            }
            let (i, j) = (row / n, column / n);
            let (block, at) = match (i == j, forest.parent(i) == Some(j)) {
                (true, _) => (i, 0),
                (false, true) => (i, 1),
                (false, false) if forest.parent(j) == Some(i) => (j, 2),
                _ => return None,
            };
            blocks[block][at] = offset;
            offset += rows * columns;
        }
        let mut position = vec![None; structure.sizes.rows];
        for (k, &row) in parametrization.kept.iter().enumerate() {
            position[row] = Some(k);
        }
        let slot = |row: usize, column: usize| forest.slot(row, column) as u32;
        let jacobian = structure.constraint_pattern.entries(0, 0).into_iter().enumerate();
        let jacobian = jacobian
            .filter_map(|(at, (row, column))| {
                let row = position[row]?;
                // What cannot differ from zero may lie elsewhere.
                let (block, own) = (forest.place(row).0, column / n);
                let inside = own == block || forest.parent(block) == Some(own);
                inside.then(|| (at as u32, slot(row, column)))
            })
            .collect();
        let linear = parametrization.linear();
        let moving = chart.moving().entries();
        let moving = moving.map(|(at, row, column)| (at as u32, slot(rank + linear + row, column)));
        let mut constants = Vec::new();
        match &parametrization.projection {
            Projection::Selection(independent) => {
                let entries = independent.iter().enumerate();
                constants.extend(entries.map(|(k, &i)| (1.0, slot(rank + k, i))));
            }
            Projection::Basis(rows) => {
                for (k, row) in rows.chunks_exact(count * n).enumerate() {
                    let entries = row.iter().enumerate().filter(|(_, x)| **x != 0.0);
                    constants.extend(entries.map(|(i, &x)| (x, slot(rank + k, i))));
                }
            }
            Projection::Relative(_) => {}
        }
        let (mut first, mut pivots) = (vec![0], vec![0]);
        for block in 0..count {
            // Rows of a block ascend: those of P come last.
            let free = forest.rows(block).iter().filter(|row| **row as usize >= rank).count();
            first.push(first[block] + free);
            pivots.push(pivots[block] + free * free);
        }
        let mut extra = Vec::new();
        for (state, ends) in structure.extra_bodies.iter().enumerate() {
            let child = match *ends {
                [Some(a), Some(b)] if forest.parent(a) == Some(b) => a,
                [Some(a), Some(b)] if forest.parent(b) == Some(a) => b,
                [Some(a), None] | [None, Some(a)] => a,
                _ => return None,
            };
            extra.push(Extra { state, bodies: *ends, child });
        }
        let moving = moving.collect();
        let forest = forest.clone();
        Some(Self { forest, jacobian, moving, constants, blocks, masses, first, pivots, extra })
    }

    pub(super) fn free(&self, block: usize) -> std::ops::Range<usize> {
        self.first[block]..self.first[block + 1]
    }
}
