//! A forest of bodies in the order of a walk, for recursions along it.

use super::chart::Chart;
use holonom_linalg::small::Square;
use holonom_linalg::{BlockForest, BlockMatrix, BlockPattern, Scalar};
use std::ops::Range;
use std::sync::Arc;

const NONE: u32 = u32::MAX;
/// A part has at most this share of all bodies, so that a few threads get about the same.
const SHARE: usize = 16;

/// Items that belong to the positions of a walk.
#[derive(Debug)]
pub struct ByPosition<T> {
    starts: Vec<u32>,
    items: Vec<T>,
}

impl<T: Copy> ByPosition<T> {
    /// From items with their positions, of which there are `count`; those of one position keep their order.
    pub fn new(count: usize, items: impl IntoIterator<Item = (usize, T)>) -> Self {
        let mut items: Vec<(usize, T)> = items.into_iter().collect();
        items.sort_by_key(|item| item.0);
        let starts = (0..=count).map(|at| items.partition_point(|item| item.0 < at) as u32);
        Self { starts: starts.collect(), items: items.iter().map(|item| item.1).collect() }
    }

    /// The items of a position.
    pub fn at(&self, position: usize) -> &[T] {
        &self.items[self.starts[position] as usize..self.starts[position + 1] as usize]
    }
}

/// Ranges of subtrees that hang on the same body, as large as a share of all bodies allows, if together they have most of
/// these: what can be done at the same time in a forest of `count` bodies in the order of a walk, of which each hangs on the one
/// at position `parent`. None where too little is in them.
pub fn parts_of_forest(count: usize, parent: impl Fn(usize) -> Option<usize>) -> Vec<Range<usize>> {
    let mut ends: Vec<usize> = (1..=count).collect();
    for at in (0..count).rev() {
        if let Some(parent) = parent(at) {
            ends[parent] = ends[parent].max(ends[at]);
        }
    }
    let most = count.div_ceil(SHARE);
    let (mut parts, mut at) = (Vec::<Range<usize>>::new(), 0);
    while at < count {
        let end = ends[at];
        if end - at > most {
            at += 1;
            continue;
        }
        match parts.last_mut() {
            Some(last)
                if last.end == at
                    && parent(last.start) == parent(at)
                    && end - last.start <= most =>
            {
                last.end = end;
            }
            _ => parts.push(at..end),
        }
        at = end;
    }
    // Smaller ones are not worth the place of what they add to the rest.
    parts.retain(|part| SHARE * part.len() >= most);
    let inside: usize = parts.iter().map(Range::len).sum();
    if 2 * inside < count { Vec::new() } else { parts }
}

/// Bodies of which every row of [G; P] touches one and its parent only, in the order of a walk that goes on
/// from each body to its descendants: the bodies that hang on one stand right behind it.
#[derive(Debug)]
pub struct BodyTree {
    forest: Arc<BlockForest>,
    /// Body at each position, and the other way round.
    order: Vec<u32>,
    position: Vec<u32>,
    /// Position of each one's parent.
    parent: Vec<u32>,
    /// Blocks of M on the diagonal: first row in the body, order, first value.
    masses: ByPosition<[usize; 3]>,
    /// First independent variable of the body at each position in a numbering of their own, and one more.
    first: Vec<usize>,
    /// First value of a square matrix of the order of each one's independent variables, and one more.
    pivots: Vec<usize>,
}

impl BodyTree {
    /// Of a chart's [G; P] and of M, if these have that shape.
    pub fn new(chart: &Chart, mass: &BlockPattern) -> Option<Self> {
        let forest = chart.forest()?.clone();
        let rank = chart.parametrization().kept.len();
        let (n, count) = (forest.size(), forest.len());
        // Parents first, subtree after subtree: see `topology::Forest::walk`.
        let order: Vec<u32> = forest.order().map(|body| body as u32).collect();
        let mut position = vec![NONE; count];
        order.iter().enumerate().for_each(|(at, &body)| position[body as usize] = at as u32);
        let parent = order
            .iter()
            .map(|&body| forest.parent(body as usize).map_or(NONE, |parent| position[parent]));
        let parent = parent.collect();
        let mut masses = Vec::new();
        let mut offset = 0;
        for (row, column, rows, columns) in mass.shapes() {
            if (row, rows) != (column, columns) || row / n != (row + rows - 1) / n {
                return None;
            }
            masses.push((position[row / n] as usize, [row % n, rows, offset]));
            offset += rows * columns;
        }
        let (mut first, mut pivots) = (vec![0], vec![0]);
        for (at, &body) in order.iter().enumerate() {
            // Rows of a block ascend: those of P come last.
            let rows = forest.rows(body as usize);
            let free = rows.iter().filter(|row| **row as usize >= rank).count();
            first.push(first[at] + free);
            pivots.push(pivots[at] + free * free);
        }
        let masses = ByPosition::new(count, masses);
        Some(Self { forest, order, position, parent, masses, first, pivots })
    }

    /// The shape of [G; P].
    pub fn forest(&self) -> &BlockForest {
        &self.forest
    }

    /// Number of bodies.
    #[allow(clippy::len_without_is_empty, reason = "a number of bodies, not a collection")]
    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// Body at a position.
    pub fn body(&self, at: usize) -> usize {
        self.order[at] as usize
    }

    /// Position of a body.
    pub fn position(&self, body: usize) -> usize {
        self.position[body] as usize
    }

    /// Position of the parent of the body at a position.
    pub fn parent(&self, at: usize) -> Option<usize> {
        Some(self.parent[at]).filter(|parent| *parent != NONE).map(|parent| parent as usize)
    }

    /// Rows of [G; P] of the body at a position, those of P last.
    pub fn rows(&self, at: usize) -> &[u32] {
        self.forest.rows(self.body(at))
    }

    /// Independent variables of the body at a position, in a numbering of their own.
    pub fn free(&self, at: usize) -> Range<usize> {
        self.first[at]..self.first[at + 1]
    }

    /// Number of independent variables before a position.
    pub fn free_before(&self, at: usize) -> usize {
        self.first[at]
    }

    /// Number of values before a position, of square matrices of the order of the independent variables of each.
    pub fn pivots_before(&self, at: usize) -> usize {
        self.pivots[at]
    }

    /// M of the body at a position.
    #[inline(always)]
    pub fn mass<T: Scalar, const N: usize>(&self, at: usize, mass: &BlockMatrix) -> Square<T, N> {
        let mut out = [[T::ZERO; N]; N];
        for &[first, order, start] in self.masses.at(at) {
            let values = &mass.values()[start..start + order * order];
            for (i, row) in values.chunks_exact(order).enumerate() {
                for (j, x) in row.iter().enumerate() {
                    out[first + i][first + j] = T::from(*x);
                }
            }
        }
        out
    }
}
