//! Where the entries of a tree's matrix stand, found once.

use crate::reduction::{BodyTree, ByPosition, Manifold, Projection, parts_of_forest};
use std::ops::Range;

/// Places, found once; bodies by their positions in the tree.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) tree: BodyTree,
    /// (value of G, A₀ or A₁; place), (value of the moving rows, place), (constant, place) among the values of
    /// E, then F, both by rows.
    pub(super) jacobian: ByPosition<(u32, u32)>,
    pub(super) moving: ByPosition<(u32, u32)>,
    pub(super) constants: ByPosition<(f64, u32)>,
    /// First values of the blocks of K and C (b, b), (b, p), (p, b); none is `usize::MAX`.
    pub(super) blocks: Vec<[usize; 3]>,
    /// Extra states of each body.
    pub(super) extra: ByPosition<Extra>,
    /// Rows of G among those of G̃; those of P come after them.
    pub(super) rank: usize,
    /// Where w of each body is kept until what hangs on it has it. The last of these takes its parent's place: with the
    /// largest subtree last, a forest needs no more places than the logarithm of its bodies.
    pub(super) places: Vec<u32>,
    /// Ranges of subtrees that can be eliminated at the same time, ascending; none where too little is in them.
    pub(super) parts: Vec<Range<usize>>,
}

/// An extra state of a body, which is this one of its two; `coupled` at the child of the two.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extra {
    pub(super) state: u32,
    pub(super) side: u8,
    pub(super) coupled: bool,
}

/// No block.
pub(super) const NONE: usize = usize::MAX;

impl Plan {
    pub(super) fn new(manifold: &Manifold) -> Option<Self> {
        let (structure, chart) = (manifold.system().structure(), manifold.chart());
        let tree = BodyTree::new(chart, &structure.mass_pattern)?;
        let forest = tree.forest();
        let (n, count) = (structure.sizes.per_body, tree.len());
        let parametrization = chart.parametrization();
        let rank = parametrization.kept.len();
        let mut blocks = vec![[NONE; 3]; count];
        let mut offset = 0;
        for (row, column, rows, columns) in structure.stiffness_pattern.shapes() {
            let [(i, first), (j, first_of_j)] =
                [row, column].map(|at| structure.sizes.place_of(at));
            if (rows, columns, first, first_of_j) != (n, n, 0, 0) {
                return None;
            }
            let (block, at) = match (i == j, forest.parent(i) == Some(j)) {
                (true, _) => (i, 0),
                (false, true) => (i, 1),
                (false, false) if forest.parent(j) == Some(i) => (j, 2),
                _ => return None,
            };
            blocks[tree.position(block)][at] = offset;
            offset += rows * columns;
        }
        let mut extra = Vec::new();
        for (state, ends) in structure.extra_bodies.iter().enumerate() {
            let child = match *ends {
                [Some(a), Some(b)] if forest.parent(a) == Some(b) => Some(a),
                [Some(a), Some(b)] if forest.parent(b) == Some(a) => Some(b),
                [Some(_), Some(_)] => return None,
                _ => None,
            };
            for (side, &body) in ends.iter().enumerate() {
                let Some(body) = body else { continue };
                let coupled = child == Some(body);
                let item = Extra { state: state as u32, side: side as u8, coupled };
                extra.push((tree.position(body), item));
            }
        }
        let mut kept = vec![None; structure.sizes.rows];
        for (k, &row) in parametrization.kept.iter().enumerate() {
            kept[row] = Some(k);
        }
        // Position, and place among the values of E and F.
        let place = |row: usize, column: usize| {
            let slot = forest.slot(row, column);
            (tree.position(slot / (2 * n * n)), (slot % (2 * n * n)) as u32)
        };
        let jacobian = structure.constraint_pattern.entries(0, 0).into_iter().enumerate();
        let jacobian = jacobian.filter_map(|(at, (row, column))| {
            let row = kept[row]?;
            // What cannot differ from zero may lie elsewhere.
            let (block, own) = (forest.place(row).0, column / n);
            let inside = own == block || forest.parent(block) == Some(own);
            let (position, place) = inside.then(|| place(row, column))?;
            Some((position, (at as u32, place)))
        });
        let linear = parametrization.linear();
        let moving = chart.moving().entries().map(|(at, row, column)| {
            let (position, place) = place(rank + linear + row, column);
            (position, (at as u32, place))
        });
        let mut constants = Vec::new();
        let mut constant = |row: usize, column: usize, x: f64| {
            let (position, place) = place(rank + row, column);
            constants.push((position, (x, place)));
        };
        match &parametrization.projection {
            Projection::Selection(independent) => {
                independent.iter().enumerate().for_each(|(k, &i)| constant(k, i, 1.0));
            }
            Projection::Basis(rows) => {
                for (k, row) in rows.chunks_exact(count * n).enumerate() {
                    let entries = row.iter().enumerate().filter(|(_, x)| **x != 0.0);
                    entries.for_each(|(i, &x)| constant(k, i, x));
                }
            }
            Projection::Relative(_) => {}
        }
        Some(Self {
            jacobian: ByPosition::new(count, jacobian),
            moving: ByPosition::new(count, moving),
            constants: ByPosition::new(count, constants),
            blocks,
            extra: ByPosition::new(count, extra),
            rank,
            places: places(&tree),
            parts: parts_of_forest(tree.len(), |at| tree.parent(at)),
            tree,
        })
    }

    /// Whether others hang on the body at a position.
    pub(super) fn carries(&self, at: usize) -> bool {
        at + 1 < self.tree.len() && self.tree.parent(at + 1) == Some(at)
    }
}

/// See [`Plan::places`].
fn places(tree: &BodyTree) -> Vec<u32> {
    let mut last = vec![usize::MAX; tree.len()];
    for at in 0..tree.len() {
        if let Some(parent) = tree.parent(at) {
            last[parent] = at;
        }
    }
    let mut places = vec![0; tree.len()];
    for at in 0..tree.len() {
        if let Some(parent) = tree.parent(at) {
            places[at] = places[parent] + u32::from(last[parent] != at);
        }
    }
    places
}
