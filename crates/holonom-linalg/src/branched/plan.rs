//! Numbering and places of a branched matrix and of the constraint rows of its cuts.

use super::operations::{Operations, Stages};
use std::ops::Range;

/// No coordinate above.
const NONE: u32 = u32::MAX;

/// Numbers that are taken together.
pub(super) const BLOCK: usize = 4;

/// Constraint rows that close a loop between two nodes of the tree, or hold one to the root's own support.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct CutRows {
    /// The nodes it connects; none stands for what the roots hang on.
    pub nodes: [Option<usize>; 2],
    /// Number of rows.
    pub rows: usize,
}

/// The symbolic part of [`super::BranchedCholesky`]: made once for a tree.
///
/// Nodes are numbered by the caller, each with a number of coordinates and a node it hangs on. The plan
/// numbers coordinates so that those of children come before those of their parents; all vectors stand in
/// this order. Column c of the lower triangle, and of its factor, holds the coordinates on its path from the
/// root down to c itself, side by side: what elimination of c changes in the column of a coordinate above
/// it is the beginning of that column, so that no list of indices is walked. Columns begin at, and are filled
/// up to, multiples of four places, as are the constraint rows of a coordinate, so that loops over them have
/// no remainder.
#[derive(Debug, Clone)]
pub struct BranchedPlan {
    /// First coordinate of each node.
    first: Vec<u32>,
    sizes: Vec<u32>,
    /// The coordinate above each.
    above: Vec<u32>,
    /// Places of the entries of each column.
    columns: Vec<Range<usize>>,
    /// The coordinate at each place; 0 where none is.
    path: Vec<u32>,
    /// First row of each cut, and the number of rows behind them.
    rows: Vec<Range<usize>>,
    row_count: usize,
    /// Runs of constraint rows that each coordinate may appear in, and where those of each begin.
    runs: Vec<[u32; 2]>,
    first_run: Vec<u32>,
    /// Coordinates side by side that appear in the same blocks of rows, and the list of those blocks.
    panels: Vec<Panel>,
    panel_blocks: Vec<u32>,
}

/// Coordinates side by side that may appear in the same blocks of constraint rows.
#[derive(Debug, Clone)]
pub(super) struct Panel {
    pub coordinates: Range<usize>,
    /// Where the list of blocks stands.
    blocks: Range<usize>,
    /// Blocks of T, which has those of a panel side by side, one block of rows after the other.
    pub places: Range<usize>,
}

impl BranchedPlan {
    /// For nodes with `sizes` coordinates that hang on `parents`, and the cuts between them.
    ///
    /// # Panics
    /// If the lists differ in length, the parents form a circle, or a node of a cut is not there.
    pub fn new(parents: &[Option<usize>], sizes: &[usize], cuts: &[CutRows]) -> Self {
        assert_eq!(parents.len(), sizes.len(), "a size per node");
        let order = children_first(parents);
        let mut first = vec![0u32; parents.len()];
        let mut count = 0;
        for &node in &order {
            first[node] = count as u32;
            count += sizes[node];
        }
        // The first coordinate on the way up that is not of the node itself; a node may have none.
        let mut beyond = vec![NONE; parents.len()];
        for &node in order.iter().rev() {
            if let Some(parent) = parents[node] {
                beyond[node] = if sizes[parent] > 0 { first[parent] } else { beyond[parent] };
            }
        }
        let mut above = vec![NONE; count];
        for (node, &size) in sizes.iter().enumerate() {
            for i in 0..size {
                let c = first[node] as usize + i;
                above[c] = if i + 1 < size { c as u32 + 1 } else { beyond[node] };
            }
        }
        let mut columns = vec![0..1usize; count];
        for c in (0..count).rev() {
            if above[c] != NONE {
                columns[c].end += columns[above[c] as usize].end;
            }
        }
        let mut places = 0;
        for column in &mut columns {
            *column = places..places + column.end;
            places = column.end.next_multiple_of(BLOCK);
        }
        let mut path = vec![0; places];
        for (c, column) in columns.iter().enumerate() {
            let mut up = c as u32;
            for place in column.clone().rev() {
                path[place] = up;
                up = above[up as usize];
            }
        }
        let mut plan = Self {
            first,
            sizes: sizes.iter().map(|&s| s as u32).collect(),
            above,
            columns,
            path,
            rows: Vec::new(),
            row_count: 0,
            runs: Vec::new(),
            first_run: Vec::new(),
            panels: Vec::new(),
            panel_blocks: Vec::new(),
        };
        plan.place_rows(cuts, &beyond);
        plan.collect_panels();
        plan
    }

    /// Numbers constraint rows along the coordinates, so that those of a branch lie side by side, and finds
    /// which coordinates they may have (Lemma 3).
    fn place_rows(&mut self, cuts: &[CutRows], beyond: &[u32]) {
        let entrance = |node: usize| {
            if self.sizes[node] > 0 { self.first[node] } else { beyond[node] }
        };
        let entrances: Vec<[u32; 2]> = cuts
            .iter()
            .map(|cut| {
                let mut ends = cut.nodes.map(|node| node.map_or(NONE, entrance));
                ends.sort_unstable();
                ends
            })
            .collect();
        let mut order: Vec<usize> = (0..cuts.len()).collect();
        order.sort_by_key(|&cut| entrances[cut]);
        self.rows = vec![0..0; cuts.len()];
        let mut of_coordinate: Vec<Vec<[u32; 2]>> = vec![Vec::new(); self.len()];
        for cut in order {
            let rows = self.row_count..self.row_count + cuts[cut].rows;
            let run = [rows.start as u32, rows.end as u32];
            for end in entrances[cut] {
                let mut c = end;
                while c != NONE {
                    match of_coordinate[c as usize].last_mut() {
                        // Both paths have come together.
                        Some(last) if last[1] == run[1] => break,
                        Some(last) if last[1] == run[0] => last[1] = run[1],
                        _ => of_coordinate[c as usize].push(run),
                    }
                    c = self.above[c as usize];
                }
            }
            self.row_count = rows.end;
            self.rows[cut] = rows;
        }
        self.first_run = vec![0];
        for runs in of_coordinate {
            self.runs.extend(runs.iter().filter(|run| run[0] < run[1]));
            self.first_run.push(self.runs.len() as u32);
        }
    }

    /// Finds coordinates side by side that appear in the same blocks of rows.
    fn collect_panels(&mut self) {
        let mut known = Vec::new();
        for c in 0..self.len() {
            let mut blocks: Vec<u32> = self
                .runs(c)
                .flat_map(|run| (run.start / BLOCK) as u32..run.end.div_ceil(BLOCK) as u32)
                .collect();
            blocks.dedup();
            if blocks.is_empty() {
                continue;
            }
            let behind = self.panels.last().map_or(0, |panel| panel.places.end);
            match self.panels.last_mut() {
                Some(last) if last.coordinates.end == c && known == blocks => {
                    last.coordinates.end += 1;
                    last.places.end += blocks.len();
                }
                _ => {
                    let list = self.panel_blocks.len();
                    self.panels.push(Panel {
                        coordinates: c..c + 1,
                        blocks: list..list + blocks.len(),
                        places: behind..behind + blocks.len(),
                    });
                    self.panel_blocks.extend(&blocks);
                    known = blocks;
                }
            }
        }
    }

    /// Panels of T, with the blocks of rows of each.
    #[inline]
    pub(super) fn panels(&self) -> impl Iterator<Item = (&Panel, &[u32])> {
        self.panels.iter().map(|panel| (panel, &self.panel_blocks[panel.blocks.clone()]))
    }

    /// Blocks of T.
    pub(super) fn row_places(&self) -> usize {
        self.panels.last().map_or(0, |panel| panel.places.end)
    }

    /// Number of coordinates, n.
    pub fn len(&self) -> usize {
        self.above.len()
    }

    /// Whether there are no coordinates.
    pub fn is_empty(&self) -> bool {
        self.above.is_empty()
    }

    /// Number of constraint rows, m.
    pub fn rows(&self) -> usize {
        self.row_count
    }

    /// Coordinates of a node, in the order of the plan.
    pub fn coordinates(&self, node: usize) -> Range<usize> {
        let first = self.first[node] as usize;
        first..first + self.sizes[node] as usize
    }

    /// Number of entries of the lower triangle, which is that of the factor.
    pub fn entries(&self) -> usize {
        self.columns.iter().map(Range::len).sum()
    }

    /// Places of the lower triangle, those that fill up its columns among them.
    pub fn places(&self) -> usize {
        self.path.len()
    }

    /// Place of the entry of two coordinates; none where it is zero for any values.
    pub fn entry(&self, i: usize, j: usize) -> Option<usize> {
        let (low, high) = (i.min(j), i.max(j));
        let column = &self.columns[low];
        let place = column.start + self.columns[high].len() - 1;
        (column.contains(&place) && self.path[place] as usize == high).then_some(place)
    }

    /// Places of a column's entries: the coordinates of [`Self::path`], the last of which is `c` itself.
    #[inline]
    pub fn column(&self, c: usize) -> Range<usize> {
        self.columns[c].clone()
    }

    /// Blocks of a column.
    #[inline]
    pub(super) fn blocks(&self, c: usize) -> Range<usize> {
        let column = &self.columns[c];
        column.start / BLOCK..column.end.div_ceil(BLOCK)
    }

    /// Places of the coordinates above, and these coordinates.
    #[inline]
    pub(super) fn above(&self, c: usize) -> (Range<usize>, &[u32]) {
        let column = &self.columns[c];
        let above = column.start..column.end - 1;
        (above.clone(), &self.path[above])
    }

    /// Coordinates from the root down to `c` itself.
    #[inline]
    pub fn path(&self, c: usize) -> &[u32] {
        &self.path[self.column(c)]
    }

    /// Rows of a cut among all constraint rows, which are numbered anew: row r of Φ has the entry
    /// c·[`Self::width`] + r for the coordinate c.
    pub fn cut_rows(&self, cut: usize) -> Range<usize> {
        self.rows[cut].clone()
    }

    /// Numbers that Φ has for each coordinate: its rows, filled up to a multiple of four.
    #[inline]
    pub fn width(&self) -> usize {
        self.row_count.next_multiple_of(BLOCK)
    }

    /// Constraint rows that a coordinate may appear in, in Φ and T, as runs from a row to before another.
    pub fn runs(&self, c: usize) -> impl Iterator<Item = Range<usize>> + '_ {
        let runs = &self.runs[self.first_run[c] as usize..self.first_run[c + 1] as usize];
        runs.iter().map(|&[from, to]| from as usize..to as usize)
    }

    /// Operations of one factorization and solution, by the steps of Algorithm 4.
    pub fn operations(&self) -> Stages {
        let n = self.len();
        let mut stages = Stages::default();
        for column in &self.columns {
            let below = column.len() - 1;
            stages.factor += Operations {
                additions: below * (below + 1) / 2,
                multiplications: below * (below + 1) / 2,
                divisions: below,
                roots: 1,
            };
            let solve =
                Operations { additions: below, multiplications: below, divisions: 1, roots: 0 };
            stages.force += solve;
            stages.accelerations += solve;
        }
        for c in 0..n {
            let (below, rows) =
                (self.columns[c].len() - 1, self.runs(c).map(|run| run.len()).sum());
            stages.columns += Operations {
                additions: below * rows,
                multiplications: below * rows,
                divisions: rows,
                roots: 0,
            };
            stages.right_side += Operations::products(rows);
            stages.back += Operations::products(rows);
            stages.products += Operations::products(rows * (rows + 1) / 2);
        }
        stages.multipliers =
            Operations::cholesky(self.row_count) + Operations::triangular(self.row_count) * 2;
        stages
    }

    /// Entries that elimination in another order of the nodes would fill in: the zeros of the lower triangle
    /// that a Cholesky factorization makes nonzero, diagonal blocks excluded.
    ///
    /// # Panics
    /// If `order` is not one of all nodes.
    pub fn fill(parents: &[Option<usize>], sizes: &[usize], order: &[usize]) -> usize {
        let n = parents.len();
        let mut position = vec![usize::MAX; n];
        for (at, &node) in order.iter().enumerate() {
            position[node] = at;
        }
        assert!(position.iter().all(|&p| p != usize::MAX), "an order of all nodes");
        let mut later: Vec<Vec<usize>> = vec![Vec::new(); n];
        for node in 0..n {
            let mut up = parents[node];
            while let Some(other) = up {
                let (a, b) =
                    (position[node].min(position[other]), position[node].max(position[other]));
                later[a].push(b);
                up = parents[other];
            }
        }
        let entries = |later: &[Vec<usize>]| -> usize {
            let size = |at: usize| sizes[order[at]];
            later
                .iter()
                .enumerate()
                .map(|(a, l)| l.iter().map(|&b| size(a) * size(b)).sum::<usize>())
                .sum()
        };
        let before = entries(&later);
        for at in 0..n {
            let mut row = std::mem::take(&mut later[at]);
            row.sort_unstable();
            row.dedup();
            if let Some((&next, rest)) = row.split_first() {
                let known = &mut later[next];
                known.extend(rest);
                known.sort_unstable();
                known.dedup();
            }
            later[at] = row;
        }
        entries(&later) - before
    }
}

/// An order in which children come before their parents.
fn children_first(parents: &[Option<usize>]) -> Vec<usize> {
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); parents.len()];
    let mut stack = Vec::new();
    for (node, parent) in parents.iter().enumerate() {
        parent.map_or_else(|| stack.push(node), |p| children[p].push(node));
    }
    let mut order = Vec::with_capacity(parents.len());
    while let Some(node) = stack.pop() {
        order.push(node);
        stack.extend(&children[node]);
    }
    assert_eq!(order.len(), parents.len(), "the parents form a circle");
    order.reverse();
    order
}
