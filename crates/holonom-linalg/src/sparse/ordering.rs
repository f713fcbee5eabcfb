//! Choice of the pivots of a sparse LU: least local fill with threshold pivoting.

use crate::error::SingularMatrix;
use crate::sparse::SparsePattern;
use crate::sparse::elimination::NEGLIGIBLE;
use crate::sparse::wide_search::WideSearch;
use crate::watch::checkpoint;

/// A pivot sequence: position p eliminates row `rows[p]` with column `columns[p]`.
pub(super) struct PivotOrder {
    pub(super) rows: Vec<usize>,
    pub(super) columns: Vec<usize>,
}

/// A pivot is at least this fraction of the largest entry of its row (of the scaled matrix).
const THRESHOLD: f64 = 0.1;

/// Where a pivot is looked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Search {
    /// In the few rows and columns of least count.
    Near,
    /// In many columns of least count, one row each.
    Wide,
}

/// How many rows and columns a near search looks at before the best entry is taken.
const SEARCH: usize = 4;

/// A row longer than this is not searched for what it has in common with others, which would make
/// the choice quadratic where one body meets thousands; all or nothing is told by its signature.
const LONG: usize = 128;
/// Rows of a column in which an entry that may be the pivot is looked for: in a full block all are alike.
const ROWS: usize = 64;

const NONE: u32 = u32::MAX;
/// Numbers in whose time a pivot is chosen, about.
const PER_PIVOT: usize = 200;

/// Eliminates the matrix once, choosing at each step, among the large enough entries that are looked at, the one
/// that causes least fill.
///
/// Entries are structural: one that happens to be zero still counts and still causes fill, since it
/// may be different from zero when the matrix is factored again. Numbers only decide what may be a
/// pivot. Source: Duff, Erisman & Reid, *Direct Methods for Sparse Matrices*, 2nd ed., ch. 7 and 10
/// (threshold pivoting, minimum fill-in, search of Zlatev). On matrices of vehicles least fill needs
/// 10 to 20 % fewer operations than the product of counts of Markowitz.
pub(super) fn choose_pivots(
    pattern: &SparsePattern,
    scaled_values: &[f64],
    search: Search,
) -> Result<PivotOrder, SingularMatrix> {
    let mut active = Active::new(pattern, scaled_values);
    let n = pattern.n_rows();
    let mut order = PivotOrder { rows: Vec::with_capacity(n), columns: Vec::with_capacity(n) };
    let mut wide = (search == Search::Wide).then(|| WideSearch::new(n));
    for _ in 0..n {
        checkpoint(PER_PIVOT);
        let found = match &mut wide {
            Some(wide) => wide.best_pivot(&mut active),
            None => active.best_pivot(),
        };
        let Some(pivot) = found else { return Err(active.obstacle()) };
        let eliminated = active.eliminate(pivot.row, pivot.column);
        if let Some(wide) = &mut wide {
            wide.note(&active, &eliminated);
        }
        order.rows.push(pivot.row);
        order.columns.push(pivot.column);
    }
    Ok(order)
}

/// An entry that may be the next pivot.
#[derive(Clone, Copy)]
pub(super) struct Candidate {
    row: usize,
    pub(super) column: usize,
    /// New entries its elimination would cause.
    pub(super) fill: usize,
    /// (row count − 1)(column count − 1): updates its elimination would make.
    updates: usize,
    /// Its magnitude relative to the largest of its row.
    size: f64,
}

impl Candidate {
    fn is_better_than(&self, other: &Self) -> bool {
        (self.fill, self.updates).cmp(&(other.fill, other.updates)).is_lt()
            || ((self.fill, self.updates) == (other.fill, other.updates) && self.size > other.size)
    }

    pub(super) fn or_better(a: Self, b: Self) -> Self {
        if b.is_better_than(&a) { b } else { a }
    }
}

/// Row and column of a pivot as they were when it was eliminated.
pub(super) struct Eliminated {
    pub(super) row: Vec<(u32, f64)>,
    pub(super) column: Vec<u32>,
}

/// The part of the matrix that is not eliminated yet.
pub(super) struct Active {
    n: usize,
    rows: Vec<Vec<(u32, f64)>>,
    columns: Vec<Vec<u32>>,
    /// Largest magnitude in the row now, and the largest it ever was.
    row_max: Vec<f64>,
    row_peak: Vec<f64>,
    /// Rows (0..n) and columns (n..2n) in doubly linked lists by count.
    lists: CountLists,
    /// Tells rows with the same columns from others, but for one case in 2⁶⁴.
    signatures: Vec<u64>,
    /// Position of a column in the pivot row while it is eliminated.
    place: Vec<u32>,
    /// Columns of the row looked at: those with the current stamp.
    marked: Vec<u64>,
    stamp: u64,
}

impl Active {
    fn new(pattern: &SparsePattern, values: &[f64]) -> Self {
        let n = pattern.n_rows();
        let rows: Vec<Vec<(u32, f64)>> = (0..n)
            .map(|i| {
                checkpoint(PER_PIVOT);
                pattern.row(i).map(|(s, j)| (j as u32, values[s])).collect()
            })
            .collect();
        let mut columns = vec![Vec::new(); n];
        for (i, row) in rows.iter().enumerate() {
            checkpoint(4 * row.len());
            for &(j, _) in row {
                columns[j as usize].push(i as u32);
            }
        }
        let row_max: Vec<f64> = rows.iter().map(|row| largest(row)).collect();
        let signed = |row: &Vec<(u32, f64)>| row.iter().fold(0, |sum, &(j, _)| sum ^ signature(j));
        let signatures = rows.iter().map(signed).collect();
        let mut lists = CountLists::new(n);
        // Backwards, so that each list begins with its smallest index.
        for i in (0..n).rev() {
            lists.insert(n + i, columns[i].len());
            lists.insert(i, rows[i].len());
        }
        Self {
            n,
            rows,
            columns,
            row_peak: row_max.clone(),
            row_max,
            lists,
            signatures,
            place: vec![NONE; n],
            marked: vec![0; n],
            stamp: 0,
        }
    }

    fn best_pivot(&mut self) -> Option<Candidate> {
        let mut best: Option<Candidate> = None;
        let mut looked_at = 0;
        for count in 1..=self.n {
            for kind in [self.n, 0] {
                let mut line = self.lists.first(kind, count);
                while line != NONE {
                    let found = if kind == 0 {
                        self.best_in_row(line as usize, best)
                    } else {
                        self.best_in_column(line as usize - self.n, best)
                    };
                    if let Some(found) = found {
                        let leader = best.map_or(found, |b| Candidate::or_better(b, found));
                        best = Some(leader);
                        looked_at += 1;
                        if looked_at >= SEARCH || leader.fill == 0 {
                            return best;
                        }
                    }
                    line = self.lists.next[line as usize];
                }
            }
        }
        best
    }

    /// Columns of a row.
    pub(super) fn columns_of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        self.rows[i].iter().map(|&(j, _)| j as usize)
    }

    /// Rows with a single entry.
    pub(super) fn single_row(&self) -> Option<usize> {
        Some(self.lists.first(0, 1) as usize).filter(|&i| i < self.n)
    }

    /// Columns that are left, those with the fewest entries first.
    pub(super) fn next_column(&self, after: Option<usize>) -> Option<usize> {
        let n = self.n;
        let mut line = after.map_or(NONE, |j| self.lists.next[n + j]);
        let mut count = after.map_or(0, |j| self.lists.count[n + j] as usize);
        while line == NONE && count < n {
            count += 1;
            line = self.lists.first(n, count);
        }
        (line != NONE).then(|| line as usize - n)
    }

    /// The best entry of a row; how much fill it causes is told only as far as it matters beside `leader`.
    pub(super) fn best_in_row(&mut self, i: usize, leader: Option<Candidate>) -> Option<Candidate> {
        self.mark(i);
        let mut best = None;
        for &(j, v) in &self.rows[i] {
            let rated = self.rate(i, j as usize, v, least_fill(leader, best));
            best = best.into_iter().chain(rated).reduce(Candidate::or_better);
        }
        best
    }

    /// The entry of a column in the shortest of its rows in which it may be the pivot; where there are several, of the first [`ROWS`] the
    /// one in which it is the largest.
    pub(super) fn shortest_in_column(&mut self, j: usize) -> Option<Candidate> {
        let column = &self.columns[j];
        let length = |i: u32| self.rows[i as usize].len();
        let mut shortest: Option<(usize, f64)> = None;
        let mut least = column.iter().map(|&i| length(i)).min()?;
        loop {
            let mut looked_at = 0;
            for &i in column.iter().filter(|&&i| length(i) == least) {
                checkpoint(least);
                let row = &self.rows[i as usize];
                let entry = row.iter().find(|&&(c, _)| c as usize == j);
                let &(_, v) = entry.expect("column is listed");
                let size = |v: f64, i: usize| v.abs() / self.row_max[i];
                if !self.admits(i as usize, j, v) {
                    continue;
                }
                if shortest.is_none_or(|(k, of_k)| size(v, i as usize) > size(of_k, k)) {
                    shortest = Some((i as usize, v));
                }
                looked_at += 1;
                if looked_at == ROWS {
                    break;
                }
            }
            if shortest.is_some() {
                break;
            }
            least = column.iter().map(|&i| length(i)).filter(|&n| n > least).min()?;
        }
        let (i, v) = shortest?;
        self.mark(i);
        self.rate(i, j, v, usize::MAX)
    }

    /// The best entry of a column, as [`Active::best_in_row`].
    fn best_in_column(&mut self, j: usize, leader: Option<Candidate>) -> Option<Candidate> {
        let mut best: Option<Candidate> = None;
        for at in 0..self.columns[j].len() {
            let i = self.columns[j][at] as usize;
            let entry = self.rows[i].iter().find(|&&(c, _)| c as usize == j);
            let &(_, v) = entry.expect("column is listed");
            if self.admits(i, j, v) {
                self.mark(i);
                let rated = self.rate(i, j, v, least_fill(leader, best));
                best = best.into_iter().chain(rated).reduce(Candidate::or_better);
            }
        }
        best
    }

    /// Whether an entry is large enough to be a pivot.
    ///
    /// The only entry of a row or column is a factor of the determinant: it is taken at any size
    /// that is not noise, since no later choice could avoid it and it causes no growth.
    fn admits(&self, i: usize, j: usize, value: f64) -> bool {
        value.abs() > NEGLIGIBLE * self.row_peak[i]
            && (value.abs() >= THRESHOLD * self.row_max[i] || self.columns[j].len() == 1)
    }

    /// Judges an entry of the marked row `i`; none if it is too small. Fill beyond `most` is not counted to its end.
    fn rate(&self, i: usize, j: usize, value: f64, most: usize) -> Option<Candidate> {
        if !self.admits(i, j, value) {
            return None;
        }
        let others = self.rows[i].len() - 1;
        let mut fill = 0;
        for &r in self.columns[j].iter().filter(|&&r| r as usize != i) {
            let row = &self.rows[r as usize];
            let common = if self.signatures[r as usize] == self.signatures[i] {
                others + 1
            } else if row.len() > LONG {
                1
            } else {
                row.iter().filter(|&&(c, _)| self.marked[c as usize] == self.stamp).count()
            };
            fill += others + 1 - common;
            if fill > most {
                break;
            }
        }
        let updates = others * (self.columns[j].len() - 1);
        let size = value.abs() / self.row_max[i];
        Some(Candidate { row: i, column: j, fill, updates, size })
    }

    /// Marks the columns of row `i`.
    fn mark(&mut self, i: usize) {
        self.stamp += 1;
        for &(j, _) in &self.rows[i] {
            self.marked[j as usize] = self.stamp;
        }
    }

    fn eliminate(&mut self, p: usize, q: usize) -> Eliminated {
        self.lists.remove(p);
        self.lists.remove(self.n + q);
        let pivot_row = std::mem::take(&mut self.rows[p]);
        let pivot_column = std::mem::take(&mut self.columns[q]);
        let mut pivot = 1.0;
        for (at, &(j, v)) in pivot_row.iter().enumerate() {
            if j as usize == q {
                pivot = v;
            } else {
                self.place[j as usize] = at as u32;
                let column = &mut self.columns[j as usize];
                let here = column.iter().position(|&i| i as usize == p).expect("row is listed");
                column.swap_remove(here);
            }
        }
        checkpoint(pivot_row.len() * pivot_column.len());
        let mut touched = vec![false; pivot_row.len()];
        for &i in pivot_column.iter().filter(|&&i| i as usize != p) {
            touched.fill(false);
            let row = &mut self.rows[i as usize];
            let here = row.iter().position(|&(j, _)| j as usize == q).expect("column is listed");
            let factor = row.swap_remove(here).1 / pivot;
            let mut signed = self.signatures[i as usize] ^ signature(q as u32);
            let mut size = 0.0;
            for (j, v) in row.iter_mut() {
                let at = self.place[*j as usize];
                if at != NONE {
                    touched[at as usize] = true;
                    *v -= factor * pivot_row[at as usize].1;
                }
                if v.abs() > size {
                    size = v.abs();
                }
            }
            for (at, &(j, v)) in pivot_row.iter().enumerate() {
                if j as usize != q && !touched[at] {
                    row.push((j, -factor * v));
                    signed ^= signature(j);
                    size = size.max((factor * v).abs());
                    self.columns[j as usize].push(i);
                }
            }
            self.signatures[i as usize] = signed;
            self.row_max[i as usize] = size;
            self.row_peak[i as usize] = self.row_peak[i as usize].max(size);
            self.lists.remove(i as usize);
            self.lists.insert(i as usize, self.rows[i as usize].len());
        }
        for &(j, _) in pivot_row.iter().filter(|&&(j, _)| j as usize != q) {
            self.place[j as usize] = NONE;
            self.lists.remove(self.n + j as usize);
            self.lists.insert(self.n + j as usize, self.columns[j as usize].len());
        }
        Eliminated { row: pivot_row, column: pivot_column }
    }

    /// Where elimination came to a stop: the remaining row with the largest entry.
    fn obstacle(&self) -> SingularMatrix {
        let mut worst = SingularMatrix { row: 0, column: 0, pivot: 0.0 };
        let mut found = false;
        for i in (0..self.n).filter(|&i| self.lists.contains(i)) {
            let entry = self.rows[i].iter().copied().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
            let remaining = (0..self.n).find(|&j| self.lists.contains(self.n + j)).unwrap_or(0);
            let (column, pivot) = entry.map_or((remaining, 0.0), |(j, v)| (j as usize, v));
            if !found || pivot.abs() > worst.pivot.abs() {
                worst = SingularMatrix { row: i, column, pivot };
                found = true;
            }
        }
        worst
    }
}

/// A number for a column, all of whose digits depend on all of its own. Source: Steele, Lea & Flood, Fast splittable pseudorandom
/// number generators, 2014.
fn signature(column: u32) -> u64 {
    let mut z = (u64::from(column) + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

fn least_fill(a: Option<Candidate>, b: Option<Candidate>) -> usize {
    a.into_iter().chain(b).map(|found| found.fill).min().unwrap_or(usize::MAX)
}

fn largest(row: &[(u32, f64)]) -> f64 {
    row.iter().fold(0.0, |m, &(_, v)| m.max(v.abs()))
}

/// Doubly linked lists of lines (rows 0..n, columns n..2n) with equal count.
struct CountLists {
    n: usize,
    head: Vec<u32>, // row counts 0..=n, then column counts 0..=n
    next: Vec<u32>,
    previous: Vec<u32>,
    count: Vec<u32>,
}

impl CountLists {
    fn new(n: usize) -> Self {
        Self {
            n,
            head: vec![NONE; 2 * (n + 1)],
            next: vec![NONE; 2 * n],
            previous: vec![NONE; 2 * n],
            count: vec![NONE; 2 * n],
        }
    }

    fn bucket(&self, line: usize, count: usize) -> usize {
        if line < self.n { count } else { self.n + 1 + count }
    }

    fn first(&self, kind: usize, count: usize) -> u32 {
        self.head[self.bucket(kind, count)]
    }

    fn contains(&self, line: usize) -> bool {
        self.count[line] != NONE
    }

    fn insert(&mut self, line: usize, count: usize) {
        let bucket = self.bucket(line, count);
        let next = self.head[bucket];
        self.next[line] = next;
        self.previous[line] = NONE;
        if next != NONE {
            self.previous[next as usize] = line as u32;
        }
        self.head[bucket] = line as u32;
        self.count[line] = count as u32;
    }

    fn remove(&mut self, line: usize) {
        let (previous, next) = (self.previous[line], self.next[line]);
        if previous == NONE {
            let bucket = self.bucket(line, self.count[line] as usize);
            self.head[bucket] = next;
        } else {
            self.next[previous as usize] = next;
        }
        if next != NONE {
            self.previous[next as usize] = previous;
        }
        self.count[line] = NONE;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sparse::SparsePattern;

    /// A matrix with `per_row` entries in each row beside its diagonal, and their values.
    fn scattered(n: usize, per_row: usize) -> (SparsePattern, Vec<f64>) {
        let mut seed = 7u64;
        let mut next = |below: usize| {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 33) as usize % below
        };
        let mut entries: Vec<(usize, usize)> =
            (0..n).flat_map(|i| (0..per_row).map(move |_| i)).map(|i| (i, next(n))).collect();
        entries.extend((0..n).map(|i| (i, i)));
        entries.sort_unstable();
        entries.dedup();
        let values = entries.iter().map(|_| 0.05 + next(1000) as f64 / 1000.0).collect();
        (SparsePattern::new(n, n, &entries).0, values)
    }

    #[test] // independent truth: nothing can fill a full matrix
    fn long_rows_of_a_full_block_cause_no_fill() {
        let n = LONG + ROWS;
        let entries: Vec<(usize, usize)> =
            (0..n).flat_map(|i| (0..n).map(move |j| (i, j))).collect();
        let pattern = SparsePattern::new(n, n, &entries).0;
        let values: Vec<f64> = (0..n * n).map(|k| 1.0 + (k % 97) as f64).collect();
        let mut active = Active::new(&pattern, &values);
        assert_eq!(active.shortest_in_column(n / 2).map(|found| found.fill), Some(0));
    }

    #[test] // independent truth: all rows of the column, and all columns of the row, one by one
    fn pivots_and_signatures_are_those_of_the_rows_that_are_left() {
        let (pattern, values) = scattered(60, 3);
        let mut active = Active::new(&pattern, &values);
        let mut wide = WideSearch::new(60);
        for left in (1..=60).rev() {
            for i in (0..60).filter(|&i| active.lists.contains(i)) {
                let signed = active.rows[i].iter().fold(0, |sum, &(j, _)| sum ^ signature(j));
                assert_eq!(active.signatures[i], signed);
            }
            let columns: Vec<usize> = (0..60).filter(|j| active.lists.contains(60 + j)).collect();
            for j in columns {
                let best = {
                    let active = &active;
                    let size = |i: usize| {
                        let entry = active.rows[i].iter().find(|entry| entry.0 as usize == j);
                        entry.map_or(0.0, |entry| entry.1)
                    };
                    let rows = active.columns[j].iter().map(|&i| i as usize);
                    let admitted = rows.filter(|&i| active.admits(i, j, size(i)));
                    let order =
                        |i: usize| (active.rows[i].len(), -size(i).abs() / active.row_max[i]);
                    admitted.map(order).min_by(|a, b| a.partial_cmp(b).unwrap())
                };
                let found = active.shortest_in_column(j);
                let found = found.map(|found| (active.rows[found.row].len(), -found.size));
                assert_eq!(found, best, "column {j}, {left} left");
            }
            let pivot = wide.best_pivot(&mut active).unwrap();
            let eliminated = active.eliminate(pivot.row, pivot.column);
            wide.note(&active, &eliminated);
        }
    }
}
