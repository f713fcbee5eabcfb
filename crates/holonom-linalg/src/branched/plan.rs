//! Numbering and places of a branched matrix and of the constraint rows of its cuts.

use super::operations::{Operations, Stages};

/// No coordinate above.
pub(super) const NONE: u32 = u32::MAX;

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
/// this order. Column c of the lower triangle, and of its factor, holds c itself and then the coordinates
/// above it up to the root, side by side: what elimination of c changes in the column of a coordinate above
/// it is a run of that column, so that no list of indices is walked.
#[derive(Debug, Clone)]
pub struct BranchedPlan {
    /// First coordinate of each node.
    first: Vec<u32>,
    sizes: Vec<u32>,
    /// The coordinate above each.
    pub(super) above: Vec<u32>,
    /// Entries of each column.
    pub(super) depth: Vec<u32>,
    /// Place of each diagonal entry.
    pub(super) start: Vec<usize>,
    entries: usize,
    /// First row of each cut, and the number of rows behind them.
    rows: Vec<std::ops::Range<usize>>,
    row_count: usize,
    /// Runs of constraint rows that each coordinate may appear in, and where those of each begin.
    runs: Vec<[u32; 2]>,
    first_run: Vec<u32>,
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
        let mut depth = vec![1u32; count];
        for c in (0..count).rev() {
            if above[c] != NONE {
                depth[c] += depth[above[c] as usize];
            }
        }
        let mut entries = 0;
        let start = depth
            .iter()
            .map(|&d| {
                entries += d as usize;
                entries - d as usize
            })
            .collect();
        let mut plan = Self {
            first,
            sizes: sizes.iter().map(|&s| s as u32).collect(),
            above,
            depth,
            start,
            entries,
            rows: Vec::new(),
            row_count: 0,
            runs: Vec::new(),
            first_run: Vec::new(),
        };
        plan.place_rows(cuts, &beyond);
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
    pub fn coordinates(&self, node: usize) -> std::ops::Range<usize> {
        let first = self.first[node] as usize;
        first..first + self.sizes[node] as usize
    }

    /// Number of entries of the lower triangle, which is that of the factor.
    pub fn entries(&self) -> usize {
        self.entries
    }

    /// Place of the entry of two coordinates; none where it is zero for any values.
    pub fn entry(&self, i: usize, j: usize) -> Option<usize> {
        let (low, high) = (i.min(j), i.max(j));
        let steps = self.depth[low].checked_sub(self.depth[high])?;
        // Coordinates above follow each other at falling depth, so that at most one has the right one.
        let mut c = low;
        for _ in 0..steps {
            c = self.above[c] as usize;
        }
        (c == high).then(|| self.start[low] + steps as usize)
    }

    /// Places of a column's entries: the coordinate itself, then those above it.
    pub fn column(&self, c: usize) -> std::ops::Range<usize> {
        self.start[c]..self.start[c] + self.depth[c] as usize
    }

    /// The coordinate above, on the way to the root.
    pub fn above(&self, c: usize) -> Option<usize> {
        (self.above[c] != NONE).then(|| self.above[c] as usize)
    }

    /// Rows of a cut among all constraint rows, which are numbered anew. Φ and T are stored as n×m matrices by
    /// coordinates: row r has the entry c·m + r for the coordinate c.
    pub fn cut_rows(&self, cut: usize) -> std::ops::Range<usize> {
        self.rows[cut].clone()
    }

    /// Constraint rows that a coordinate may appear in, in Φ and T, as runs from a row to before another.
    pub fn runs(&self, c: usize) -> impl Iterator<Item = std::ops::Range<usize>> + '_ {
        let runs = &self.runs[self.first_run[c] as usize..self.first_run[c + 1] as usize];
        runs.iter().map(|&[from, to]| from as usize..to as usize)
    }

    /// Operations of one factorization and solution, by the steps of Algorithm 4.
    pub fn operations(&self) -> Stages {
        let n = self.len();
        let mut stages = Stages::default();
        for &depth in &self.depth {
            let below = depth as usize - 1;
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
                (self.depth[c] as usize - 1, self.runs(c).map(|run| run.len()).sum());
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
