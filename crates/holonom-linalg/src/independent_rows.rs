//! Choice of rows of a tall sparse matrix that make it square and regular.

use crate::envelope::{BlockGraph, least_degree};
use crate::error::SingularMatrix;
use std::ops::Range;

/// What decides whether a row is taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Claim {
    /// It is taken unless other rows of this kind imply it, those of a smaller class first.
    Required(u8),
    /// Of preferred rows of which, against others of their kind, enough is left beside the rows taken before, the one
    /// whose rest times this weight is the largest is taken.
    Preferred(f64),
    /// The same of another kind, for all of which the first stands.
    InTurn(f64),
    /// Preferred by itself, and one of those that wait for their turn, for which it stands when it is the first.
    PreferredInTurn(f64),
}

/// A row on offer to [`independent_rows`].
#[derive(Debug, Clone, PartialEq)]
pub struct OfferedRow {
    /// Columns, each once, and numbers.
    pub entries: Vec<(usize, f64)>,
    /// What decides.
    pub claim: Claim,
}

/// Result of [`independent_rows`].
#[derive(Debug, Clone, PartialEq)]
pub struct IndependentRows {
    /// Rows taken, ascending: as many as there are columns.
    pub taken: Vec<usize>,
    /// Required rows that others imply, ascending.
    pub redundant: Vec<usize>,
    /// The least part of a required row that was left of it when it was taken.
    pub least_left: f64,
    /// Multiplications of numbers.
    pub operations: usize,
}

/// Part of the best at which a required row of a smaller class is taken.
const THRESHOLD: f64 = 0.1;
/// Numbers below this part of the largest that their row was made of are round-off.
const ROUND_OFF: f64 = 64.0 * f64::EPSILON;
/// A row below this part of the largest that it ever was is cancellation noise.
const NOISE: f64 = 1024.0 * f64::EPSILON;

/// Chooses rows of a matrix of `blocks`·`width` columns that form a regular square matrix: required ones
/// unless they depend on others, then preferred ones, by weight among those of which at least the part `nearly` of
/// the best of their kind is left. A row is dependent when less than `tolerance` of it is left, or only round-off.
///
/// Blocks of columns are eliminated in an order of least degree, each by its rows alone, as in a
/// multifrontal factorisation: reflections of its columns make one entry of a taken row, whose multiples
/// are subtracted from the others. Whatever the order of the blocks, a row with an entry in a column where all
/// taken ones vanish may be taken there: of those the choice is local. A row that depends on others that wait
/// in the same blocks, and are preferred to it, is out, so that no more rows wait than there are columns in their
/// blocks. With numbers, multiples of required rows are at most ten, and those of preferred rows at most
/// 1/`nearly`, for a row of the other kind times the ratio of their weights.
///
/// # Errors
/// [`SingularMatrix`] with a column in which no row has an entry left.
pub fn independent_rows(
    blocks: usize,
    width: usize,
    rows: &[OfferedRow],
    tolerance: f64,
    nearly: f64,
) -> Result<IndependentRows, SingularMatrix> {
    let mut work = Elimination::new(blocks, width, rows, tolerance, nearly);
    for block in work.order(rows) {
        work.eliminate(block)?;
    }
    let mut out = work.out;
    out.taken.sort_unstable();
    // A row without a column left to be taken in.
    let idle = (0..rows.len()).filter(|&i| work.rows[i].waits && work.rows[i].required().is_some());
    out.redundant.extend(idle);
    out.redundant.sort_unstable();
    Ok(out)
}

/// What is left of a row.
struct Row {
    claim: Claim,
    entries: Vec<(usize, f64)>,
    /// Its size at the beginning, and the largest since.
    first: f64,
    peak: f64,
    waits: bool,
}

impl Row {
    fn required(&self) -> Option<u8> {
        if let Claim::Required(class) = self.claim { Some(class) } else { None }
    }

    /// Size below which nothing is left of it.
    fn nothing(&self, tolerance: f64) -> f64 {
        (tolerance * self.first).max(NOISE * self.peak)
    }
}

struct Elimination {
    width: usize,
    tolerance: f64,
    nearly: f64,
    rows: Vec<Row>,
    /// Rows that stand in each block; some more than once, some no longer.
    at: Vec<Vec<usize>>,
    /// Place of a column in the present front.
    place: Vec<usize>,
    out: IndependentRows,
}

impl Elimination {
    fn new(blocks: usize, width: usize, rows: &[OfferedRow], tolerance: f64, nearly: f64) -> Self {
        let mut at = vec![Vec::new(); blocks];
        for (i, row) in rows.iter().enumerate() {
            for &(column, _) in &row.entries {
                if at[column / width].last() != Some(&i) {
                    at[column / width].push(i);
                }
            }
        }
        let start = |row: &OfferedRow| {
            let size = row.entries.iter().map(|(_, x)| x * x).sum::<f64>().sqrt();
            let entries = row.entries.clone();
            Row { claim: row.claim, entries, first: size, peak: size, waits: true }
        };
        Self {
            width,
            tolerance,
            nearly,
            rows: rows.iter().map(start).collect(),
            at,
            place: vec![0; blocks * width],
            out: IndependentRows {
                taken: Vec::with_capacity(blocks * width),
                redundant: Vec::new(),
                least_left: 1.0,
                operations: 0,
            },
        }
    }

    /// Blocks in the order of their elimination.
    fn order(&self, rows: &[OfferedRow]) -> Vec<usize> {
        let mut pairs = Vec::new();
        for row in rows {
            let mut blocks: Vec<usize> = row.entries.iter().map(|e| e.0 / self.width).collect();
            blocks.sort_unstable();
            blocks.dedup();
            for (k, &i) in blocks.iter().enumerate() {
                pairs.extend(blocks[k + 1..].iter().map(|&j| [i, j]));
            }
        }
        least_degree(&BlockGraph::new(&vec![1; self.at.len()], &pairs))
    }

    fn eliminate(&mut self, block: usize) -> Result<(), SingularMatrix> {
        let first = block * self.width;
        let here = first..first + self.width;
        let mut ids = std::mem::take(&mut self.at[block]);
        ids.sort_unstable();
        ids.dedup();
        ids.retain(|&i| self.rows[i].waits);
        let entries = ids.iter().flat_map(|&i| &self.rows[i].entries);
        let mut columns: Vec<usize> = entries.map(|e| e.0).filter(|c| !here.contains(c)).collect();
        columns.sort_unstable();
        columns.dedup();
        for (at, column) in here.clone().chain(columns.iter().copied()).enumerate() {
            self.place[column] = at;
        }
        let mut front = Front::new(&self.rows, &ids, &self.place, self.width + columns.len());
        for k in 0..self.width {
            let Some(pick) = front.pick(&self.rows, k..self.width, self.tolerance, self.nearly)
            else {
                return Err(SingularMatrix { row: 0, column: first + k, pivot: 0.0 });
            };
            let row = &mut self.rows[ids[pick]];
            if row.required().is_some() {
                let left = front.size(pick, k) / row.first;
                self.out.least_left = self.out.least_left.min(left);
            }
            row.waits = false;
            self.out.taken.push(ids[pick]);
            front.take(pick, k, self.width);
            front.see_peaks(&mut self.rows, k + 1);
        }
        self.out.operations += front.operations;
        self.pass_on(block, &front, &columns);
        Ok(())
    }

    /// Hands what is left of the rows to the other blocks of a front.
    fn pass_on(&mut self, block: usize, front: &Front, columns: &[usize]) {
        for (local, &id) in front.ids.iter().enumerate().filter(|(local, _)| front.live[*local]) {
            let row = &mut self.rows[id];
            let mut known: Vec<usize> = row.entries.iter().map(|e| e.0 / self.width).collect();
            known.push(block);
            let left = &front.row(local)[self.width..];
            let kept = columns.iter().zip(left).filter(|(_, x)| x.abs() > ROUND_OFF * row.peak);
            row.entries = kept.map(|(column, x)| (*column, *x)).collect();
            for &(column, _) in &row.entries {
                let other = column / self.width;
                if !known.contains(&other) {
                    known.push(other);
                    self.at[other].push(id);
                }
            }
        }
        // Which of them are still of use, by the same choice among all their columns.
        let mut rest = front.beyond(self.width);
        for k in 0..rest.columns {
            let Some(pick) = rest.pick(&self.rows, k..rest.columns, self.tolerance, self.nearly)
            else {
                break;
            };
            rest.take(pick, k, rest.columns);
        }
        self.out.operations += rest.operations;
        for (&id, _) in rest.ids.iter().zip(&rest.live).filter(|(_, live)| **live) {
            self.rows[id].waits = false;
            if self.rows[id].required().is_some() {
                self.out.redundant.push(id);
            }
        }
    }
}

/// The rows of a block with all their columns, those of the block first.
struct Front {
    ids: Vec<usize>,
    live: Vec<bool>,
    columns: usize,
    /// By rows.
    a: Vec<f64>,
    operations: usize,
}

impl Front {
    fn new(rows: &[Row], ids: &[usize], place: &[usize], columns: usize) -> Self {
        let mut a = vec![0.0; ids.len() * columns];
        for (row, &id) in a.chunks_exact_mut(columns).zip(ids) {
            for &(column, x) in &rows[id].entries {
                row[place[column]] = x;
            }
        }
        Self { ids: ids.to_vec(), live: vec![true; ids.len()], columns, a, operations: 0 }
    }

    /// Its live rows without the first columns.
    fn beyond(&self, width: usize) -> Self {
        let live: Vec<usize> = (0..self.ids.len()).filter(|&local| self.live[local]).collect();
        Self {
            ids: live.iter().map(|&local| self.ids[local]).collect(),
            live: vec![true; live.len()],
            columns: self.columns - width,
            a: live.iter().flat_map(|&local| &self.row(local)[width..]).copied().collect(),
            operations: 0,
        }
    }

    fn row(&self, local: usize) -> &[f64] {
        &self.a[local * self.columns..(local + 1) * self.columns]
    }

    /// Size of a row from column `from` on.
    fn size(&self, local: usize, from: usize) -> f64 {
        size(&self.row(local)[from..])
    }

    fn see_peaks(&self, rows: &mut [Row], from: usize) {
        for local in (0..self.ids.len()).filter(|&local| self.live[local]) {
            let peak = &mut rows[self.ids[local]].peak;
            *peak = peak.max(self.size(local, from));
        }
    }

    /// The row to be taken in a range of columns; none where no row has a number left.
    fn pick(
        &mut self,
        rows: &[Row],
        columns: Range<usize>,
        tolerance: f64,
        nearly: f64,
    ) -> Option<usize> {
        self.operations += self.a.len();
        let (mut required, mut offers) = (Vec::new(), Vec::new());
        for local in (0..self.ids.len()).filter(|&local| self.live[local]) {
            let row = &rows[self.ids[local]];
            let here = size(&self.row(local)[columns.clone()]);
            if here.is_nan() {
                return None;
            }
            if here > row.nothing(tolerance) {
                let (weight, [by_itself, in_turn]) = match row.claim {
                    Claim::Required(class) => {
                        required.push((here / row.first, class, local));
                        continue;
                    }
                    Claim::Preferred(weight) => (weight, [true, false]),
                    Claim::InTurn(weight) => (weight, [false, true]),
                    Claim::PreferredInTurn(weight) => (weight, [true, true]),
                };
                offers.push((here, weight, [by_itself, in_turn], local));
            }
        }
        let best = required.iter().fold(0.0f64, |best, offer| best.max(offer.0));
        let large = required.into_iter().filter(|offer| offer.0 >= THRESHOLD * best);
        if let Some((_, _, local)) = large.min_by(|a, b| a.1.cmp(&b.1).then(b.0.total_cmp(&a.0))) {
            return Some(local);
        }
        // Only rows of one kind are measured by each other: between lengths and angles their unit would decide.
        let enough = [0, 1].map(|kind| {
            let of_kind = offers.iter().filter(|offer| offer.2[kind]);
            nearly * of_kind.fold(0.0f64, |best, offer| best.max(offer.0))
        });
        let mut taken: Option<(f64, usize)> = None;
        let mut first = true;
        for (here, weight, [by_itself, in_turn], local) in offers {
            let has_turn = in_turn && here >= enough[1] && std::mem::replace(&mut first, false);
            let stands = has_turn || by_itself && here >= enough[0];
            if stands && taken.is_none_or(|(size, _)| here * weight > size) {
                taken = Some((here * weight, local));
            }
        }
        taken.map(|(_, local)| local)
    }

    /// Takes a row in columns `from` to `to`, which are reflected so that only the first of them has an entry
    /// of it; the others lose that column.
    fn take(&mut self, pick: usize, from: usize, to: usize) {
        let columns = self.columns;
        let mut axis = self.row(pick)[from..to].to_vec();
        let pivot = -size(&axis).copysign(axis[0]);
        axis[0] -= pivot;
        let half = 0.5 * dot(&axis, &axis);
        for local in 0..self.ids.len() {
            let part = &mut self.a[local * columns + from..local * columns + to];
            let along = if half > 0.0 && self.live[local] { dot(part, &axis) / half } else { 0.0 };
            part.iter_mut().zip(&axis).for_each(|(x, a)| *x -= along * a);
        }
        self.live[pick] = false;
        let taken = self.row(pick)[from..].to_vec();
        for local in (0..self.ids.len()).filter(|&local| self.live[local]) {
            let row = &mut self.a[local * columns + from..(local + 1) * columns];
            let multiple = row[0] / taken[0];
            row[0] = 0.0;
            // The reflection left nothing of the taken row in the other columns of the block.
            row[to - from..]
                .iter_mut()
                .zip(&taken[to - from..])
                .for_each(|(x, t)| *x -= multiple * t);
        }
        self.operations += 2 * self.a.len();
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}

fn size(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}
