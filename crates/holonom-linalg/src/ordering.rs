//! Choice of the pivots of a sparse LU: Markowitz counts with threshold pivoting.

use crate::error::SingularMatrix;
use crate::pattern::SparsePattern;

/// A pivot sequence: position p eliminates row `rows[p]` with column `columns[p]`.
pub(crate) struct PivotOrder {
    pub(crate) rows: Vec<usize>,
    pub(crate) columns: Vec<usize>,
}

/// What may be chosen as a pivot.
#[derive(Clone, Copy)]
pub(crate) struct PivotRule {
    /// A pivot is at least this fraction of the largest entry of its row (of the scaled matrix).
    pub(crate) threshold: f64,
    /// How many rows and columns are looked at before the best entry so far is taken.
    pub(crate) search: usize,
}

/// A pivot below this fraction of the largest number its row ever held is cancellation noise.
pub(crate) const NEGLIGIBLE: f64 = 32.0 * f64::EPSILON;

const NONE: u32 = u32::MAX;

/// Eliminates the matrix once, choosing at each step, among the entries the rule admits, the one
/// with the smallest Markowitz product (row count − 1)(column count − 1).
///
/// Entries are structural: one that happens to be zero still counts and still causes fill, since it
/// may be different from zero when the matrix is factored again. Numbers only decide what may be a
/// pivot. Source: Duff, Erisman & Reid, *Direct Methods for Sparse Matrices*, 2nd ed., ch. 7, 10
/// (search of Zlatev over few rows and columns of least count).
pub(crate) fn markowitz(
    pattern: &SparsePattern,
    scaled_values: &[f64],
    rule: PivotRule,
) -> Result<PivotOrder, SingularMatrix> {
    let mut active = Active::new(pattern, scaled_values);
    let n = pattern.n_rows();
    let mut order = PivotOrder { rows: Vec::with_capacity(n), columns: Vec::with_capacity(n) };
    for _ in 0..n {
        let (row, column) = active.best_pivot(rule).ok_or_else(|| active.obstacle())?;
        active.eliminate(row, column);
        order.rows.push(row);
        order.columns.push(column);
    }
    Ok(order)
}

/// The part of the matrix that is not eliminated yet.
struct Active {
    n: usize,
    rows: Vec<Vec<(u32, f64)>>,
    columns: Vec<Vec<u32>>,
    /// Largest magnitude in the row now, and the largest it ever was.
    row_max: Vec<f64>,
    row_peak: Vec<f64>,
    /// Rows (0..n) and columns (n..2n) in doubly linked lists by count.
    lists: CountLists,
    /// Position of a column in the pivot row while it is eliminated.
    place: Vec<u32>,
}

impl Active {
    fn new(pattern: &SparsePattern, values: &[f64]) -> Self {
        let n = pattern.n_rows();
        let rows: Vec<Vec<(u32, f64)>> =
            (0..n).map(|i| pattern.row(i).map(|(s, j)| (j as u32, values[s])).collect()).collect();
        let mut columns = vec![Vec::new(); n];
        for (i, row) in rows.iter().enumerate() {
            for &(j, _) in row {
                columns[j as usize].push(i as u32);
            }
        }
        let row_max: Vec<f64> = rows.iter().map(|row| largest(row)).collect();
        let mut lists = CountLists::new(n);
        // Backwards, so that each list begins with its smallest index.
        for i in (0..n).rev() {
            lists.insert(n + i, columns[i].len());
            lists.insert(i, rows[i].len());
        }
        Self { n, rows, columns, row_peak: row_max.clone(), row_max, lists, place: vec![NONE; n] }
    }

    fn best_pivot(&self, rule: PivotRule) -> Option<(usize, usize)> {
        let mut best: Option<(usize, f64, usize, usize)> = None; // cost, quality, row, column
        let mut looked_at = 0;
        for count in 1..=self.n {
            for kind in [self.n, 0] {
                let mut line = self.lists.first(kind, count);
                while line != NONE {
                    let found = if kind == 0 {
                        self.best_in_row(line as usize, rule.threshold)
                    } else {
                        self.best_in_column(line as usize - self.n, rule.threshold)
                    };
                    if let Some(candidate) = found {
                        if best.is_none_or(|b| {
                            candidate.0 < b.0 || (candidate.0 == b.0 && candidate.1 > b.1)
                        }) {
                            best = Some(candidate);
                        }
                        looked_at += 1;
                    }
                    if let Some(b) = best
                        && (looked_at >= rule.search || b.0 <= (count - 1) * (count - 1))
                    {
                        return Some((b.2, b.3));
                    }
                    line = self.lists.next[line as usize];
                }
            }
        }
        best.map(|b| (b.2, b.3))
    }

    /// Rating of one entry: Markowitz cost, size relative to its row, row, column.
    ///
    /// The only entry of a row or column is a factor of the determinant: it is taken at any size
    /// that is not noise, since no later choice could avoid it and it causes no growth.
    fn rate(&self, i: usize, j: usize, value: f64, t: f64) -> Option<(usize, f64, usize, usize)> {
        let size = value.abs();
        let cost = (self.rows[i].len() - 1) * (self.columns[j].len() - 1);
        let admitted = size > NEGLIGIBLE * self.row_peak[i]
            && (size >= t * self.row_max[i] || self.columns[j].len() == 1);
        admitted.then(|| (cost, size / self.row_max[i], i, j))
    }

    fn best_in_row(&self, i: usize, threshold: f64) -> Option<(usize, f64, usize, usize)> {
        let rated =
            self.rows[i].iter().filter_map(|&(j, v)| self.rate(i, j as usize, v, threshold));
        better_of(rated)
    }

    fn best_in_column(&self, j: usize, threshold: f64) -> Option<(usize, f64, usize, usize)> {
        let rated = self.columns[j].iter().filter_map(|&i| {
            let &(_, v) = self.rows[i as usize].iter().find(|&&(c, _)| c as usize == j)?;
            self.rate(i as usize, j, v, threshold)
        });
        better_of(rated)
    }

    fn eliminate(&mut self, p: usize, q: usize) {
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
        let mut touched = vec![false; pivot_row.len()];
        for &i in pivot_column.iter().filter(|&&i| i as usize != p) {
            touched.fill(false);
            let row = &mut self.rows[i as usize];
            let here = row.iter().position(|&(j, _)| j as usize == q).expect("column is listed");
            let factor = row.swap_remove(here).1 / pivot;
            for (j, v) in row.iter_mut() {
                let at = self.place[*j as usize];
                if at != NONE {
                    touched[at as usize] = true;
                    *v -= factor * pivot_row[at as usize].1;
                }
            }
            for (at, &(j, v)) in pivot_row.iter().enumerate() {
                if j as usize != q && !touched[at] {
                    row.push((j, -factor * v));
                    self.columns[j as usize].push(i);
                }
            }
            let size = largest(row);
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

fn better_of(
    rated: impl Iterator<Item = (usize, f64, usize, usize)>,
) -> Option<(usize, f64, usize, usize)> {
    rated.reduce(|a, b| if b.0 < a.0 || (b.0 == a.0 && b.1 > a.1) { b } else { a })
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
