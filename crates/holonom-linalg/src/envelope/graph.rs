//! Which blocks of a symmetric block matrix differ from zero, as a graph.

use std::collections::BTreeSet;

/// Most rows of a block.
pub const LARGEST_BLOCK: usize = 6;

/// The graph of a symmetric block matrix: one vertex for each diagonal block, an edge for each pair
/// of blocks (i, j), (j, i) off the diagonal that can differ from zero.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct BlockGraph {
    sizes: Vec<usize>,
    /// Ascending, without the vertex itself.
    neighbours: Vec<Vec<usize>>,
}

impl BlockGraph {
    /// The graph of diagonal blocks with these numbers of rows. Edges may be given more than once and
    /// in both directions.
    ///
    /// # Panics
    /// If a block has no row or more than [`LARGEST_BLOCK`], or an edge names no block.
    pub fn new(sizes: &[usize], edges: &[[usize; 2]]) -> Self {
        for &size in sizes {
            assert!((1..=LARGEST_BLOCK).contains(&size), "a block of {size} rows");
        }
        let mut neighbours = vec![Vec::new(); sizes.len()];
        for &[i, j] in edges.iter().filter(|[i, j]| i != j) {
            neighbours[i].push(j);
            neighbours[j].push(i);
        }
        for list in &mut neighbours {
            list.sort_unstable();
            list.dedup();
        }
        Self { sizes: sizes.to_vec(), neighbours }
    }

    /// The graph with block `order[p]` as number p.
    ///
    /// # Panics
    /// If `order` is no permutation of the blocks.
    #[must_use]
    pub fn renumbered(&self, order: &[usize]) -> Self {
        let position = positions(order, self.len());
        let neighbours = |&i: &usize| {
            let mut list: Vec<usize> = self.neighbours[i].iter().map(|&j| position[j]).collect();
            list.sort_unstable();
            list
        };
        let sizes = order.iter().map(|&i| self.sizes[i]).collect();
        Self { sizes, neighbours: order.iter().map(neighbours).collect() }
    }

    /// Number of diagonal blocks.
    pub fn len(&self) -> usize {
        self.sizes.len()
    }

    /// Whether there is no block.
    pub fn is_empty(&self) -> bool {
        self.sizes.is_empty()
    }

    /// Rows of each diagonal block.
    pub fn sizes(&self) -> &[usize] {
        &self.sizes
    }

    /// Blocks that share an edge with block `i`, ascending.
    pub fn neighbours(&self, i: usize) -> &[usize] {
        &self.neighbours[i]
    }

    /// Number of edges: pairs of blocks off the diagonal.
    pub fn edges(&self) -> usize {
        self.neighbours.iter().map(Vec::len).sum::<usize>() / 2
    }

    pub(super) fn degree(&self, i: usize) -> usize {
        self.neighbours[i].len()
    }

    /// β by position: how far the first block of each block row is from the diagonal when block
    /// `order[p]` stands at position p.
    ///
    /// # Panics
    /// If `order` is no permutation of the blocks.
    pub fn widths(&self, order: &[usize]) -> Vec<usize> {
        let position = positions(order, self.len());
        let width = |(p, &i): (usize, &usize)| {
            let first = self.neighbours[i].iter().map(|&j| position[j]).min();
            p - first.unwrap_or(p).min(p)
        };
        order.iter().enumerate().map(width).collect()
    }

    /// Blocks beside the diagonal one in each column of the factors, of an elimination in this order that stores single
    /// blocks in place of an envelope.
    ///
    /// # Panics
    /// If `order` is no permutation of the blocks.
    pub fn factor_widths(&self, order: &[usize]) -> Vec<usize> {
        assert_eq!(order.len(), self.len(), "an order of all blocks");
        let mut rest: Vec<BTreeSet<usize>> =
            self.neighbours.iter().map(|list| list.iter().copied().collect()).collect();
        let width = |&i: &usize| {
            let width = rest[i].len();
            eliminate(&mut rest, i);
            width
        };
        order.iter().map(width).collect()
    }
}

/// Eliminates a vertex: its neighbours become a clique. Returns the block operations.
pub(super) fn eliminate(rest: &mut [BTreeSet<usize>], i: usize) -> usize {
    let around = std::mem::take(&mut rest[i]);
    for &j in &around {
        rest[j].extend(around.iter().copied().filter(|&k| k != j));
        rest[j].remove(&i);
    }
    around.len() * (around.len() + 3) / 2
}

/// Position of every block.
pub(super) fn positions(order: &[usize], count: usize) -> Vec<usize> {
    assert_eq!(order.len(), count, "an order of all blocks");
    let mut position = vec![usize::MAX; count];
    for (p, &i) in order.iter().enumerate() {
        assert!(position[i] == usize::MAX, "block {i} stands in the order twice");
        position[i] = p;
    }
    position
}
