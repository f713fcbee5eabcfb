//! Numerical elimination with frozen pivots, row by row, in the places where the factors stay.

use crate::scalar::Scalar;
use crate::sparse::symbolic::FactorPattern;
use crate::watch::checkpoint;
use std::sync::{Arc, OnceLock};

/// A pivot below this fraction of the largest number its row holds is cancellation noise.
pub(super) const NEGLIGIBLE: f64 = 32.0 * f64::EPSILON;

/// Rows that are eliminated between two checkpoints, which small matrices should not notice.
const WATCHED_ROWS: usize = 256;

/// One entry of the scaled and permuted matrix: its slot among the values, its place in the row of
/// the factors, its scale.
#[derive(Debug, Clone, Copy)]
struct Load {
    slot: u32,
    place: u32,
    scale: f64,
}

/// One row of the factors: L up to the pivot, then U.
#[derive(Debug, Clone, Copy)]
pub(super) struct Row {
    pub(super) start: u32,
    pub(super) pivot: u32,
    pub(super) end: u32,
}

/// The numbers of L or U in a row that has some.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    pub(super) row: u32,
    pub(super) start: u32,
    pub(super) end: u32,
}

/// Part of a row of L whose columns follow one another and whose rows of U agree beyond them.
#[derive(Debug, Clone, Copy)]
struct Segment {
    /// First column, and how many.
    first: u32,
    count: u32,
    /// Place of the first multiple in the row.
    place: u32,
    /// Columns that the rows of U share beyond the segment.
    shared: u32,
}

/// The factors of Â = P L U, with pivots P and unit diagonals of L and U.
#[derive(Debug, Clone)]
pub(super) struct Factors<T> {
    pub(super) plan: Arc<Plan>,
    /// L, a place for the pivot, U, row by row.
    pub(super) numbers: Vec<T>,
    pub(super) inverse_pivot: Vec<T>,
}

/// Where the numbers of the factors stand, and what elimination does for each row.
#[derive(Debug)]
pub(super) struct Plan {
    pub(super) rows: Vec<Row>,
    /// Column of every number.
    pub(super) columns: Vec<u32>,
    pub(super) left: Vec<Side>,
    pub(super) right: Vec<Side>,
    loads: Vec<Load>,
    segments: Vec<Segment>,
    /// Places in the row of the columns that the rows of U of a segment share.
    targets: Targets,
    /// Entries of the matrix and segments of each row.
    counts: Vec<(u32, u32)>,
    by_columns: OnceLock<Columns>,
}

/// The factors column by column, for solves with the transpose: a column of U from its top, one of L from its end.
#[derive(Debug)]
pub(super) struct Columns {
    /// Row and place of every number.
    pub(super) entries: Vec<(u32, u32)>,
    /// What stands in a column that has some, where its number is that of a row in [`Side`].
    pub(super) left: Vec<Side>,
    pub(super) right: Vec<Side>,
}

/// Places in rows. There are several to a number of the factors, and two bytes hold those of all but very long rows.
#[derive(Debug)]
enum Targets {
    Narrow(Vec<u16>),
    Wide(Vec<u32>),
}

impl Targets {
    fn new(places: Vec<u32>) -> Self {
        let narrow: Result<_, _> = places.iter().map(|&place| u16::try_from(place)).collect();
        narrow.map_or_else(|_| Self::Wide(places), Self::Narrow)
    }
}

/// A place in a row.
trait Target: Copy {
    fn place(self) -> usize;
}

impl Target for u16 {
    fn place(self) -> usize {
        usize::from(self)
    }
}

impl Target for u32 {
    fn place(self) -> usize {
        self as usize
    }
}

/// A row that could not be eliminated.
pub(super) struct Stopped {
    pub(super) position: usize,
    pub(super) pivot: f64,
}

impl Plan {
    /// Plans the elimination of a matrix whose scaled and permuted rows have the entries (column,
    /// slot, scale).
    ///
    /// Rows p and p + 1 of U belong together when the pattern of p is p + 1 and the pattern of
    /// p + 1. A row of L that uses p then also uses p + 1, since elimination with p fills it.
    pub(super) fn new<E: Iterator<Item = (u32, usize, f64)>>(
        pattern: &FactorPattern,
        n_entries: usize,
        entries: impl Fn(usize) -> E,
    ) -> Self {
        let n = pattern.n();
        let right = |p: usize| &pattern.u_column[pattern.u_range(p)];
        let joined: Vec<bool> = (0..n)
            .map(|p| {
                p + 1 < n
                    && right(p).first() == Some(&(p as u32 + 1))
                    && right(p)[1..] == *right(p + 1)
            })
            .collect();
        let mut out = Self {
            rows: Vec::with_capacity(n),
            columns: Vec::with_capacity(n + pattern.l_column.len() + pattern.u_column.len()),
            left: Vec::new(),
            right: Vec::new(),
            loads: Vec::with_capacity(n_entries),
            segments: Vec::new(),
            targets: Targets::Narrow(Vec::new()),
            counts: Vec::with_capacity(n),
            by_columns: OnceLock::new(),
        };
        let mut targets = Vec::new();
        let mut place = vec![u32::MAX; n];
        for i in 0..n {
            let left = &pattern.l_column[pattern.l_range(i)];
            checkpoint(8 * left.len());
            let start = out.columns.len();
            out.columns.extend(left);
            out.columns.push(i as u32);
            out.columns.extend(right(i));
            for (at, &column) in out.columns[start..].iter().enumerate() {
                place[column as usize] = at as u32;
            }
            let row = Row {
                start: start as u32,
                pivot: (start + left.len()) as u32,
                end: out.columns.len() as u32,
            };
            for (side, start, end) in
                [(&mut out.left, row.start, row.pivot), (&mut out.right, row.pivot + 1, row.end)]
            {
                if start < end {
                    side.push(Side { row: i as u32, start, end });
                }
            }
            out.rows.push(row);
            let loads = out.loads.len();
            out.loads.extend(entries(i).map(|(column, slot, scale)| Load {
                slot: slot as u32,
                place: place[column as usize],
                scale,
            }));
            let from = out.segments.len();
            for (at, &j) in left.iter().enumerate() {
                match out.segments[from..].last_mut() {
                    Some(s) if s.first + s.count == j && joined[j as usize - 1] => s.count += 1,
                    _ => out.segments.push(Segment {
                        first: j,
                        count: 1,
                        place: at as u32,
                        shared: 0,
                    }),
                }
            }
            for segment in &mut out.segments[from..] {
                let columns = right((segment.first + segment.count - 1) as usize);
                segment.shared = columns.len() as u32;
                targets.extend(columns.iter().map(|&k| place[k as usize]));
            }
            out.counts.push(((out.loads.len() - loads) as u32, (out.segments.len() - from) as u32));
        }
        out.left.shrink_to_fit();
        out.right.shrink_to_fit();
        out.segments.shrink_to_fit();
        out.targets = Targets::new(targets);
        out
    }

    /// The factors by columns, listed when they are first asked for.
    pub(super) fn by_columns(&self) -> &Columns {
        self.by_columns.get_or_init(|| {
            let n = self.rows.len();
            let mut out = Columns { entries: Vec::new(), left: Vec::new(), right: Vec::new() };
            for (from, sides) in [(&self.right, &mut out.right), (&self.left, &mut out.left)] {
                let mut start = vec![0; n + 1];
                for side in from {
                    for &j in &self.columns[side.start as usize..side.end as usize] {
                        start[j as usize + 1] += 1;
                    }
                }
                let first = out.entries.len() as u32;
                start[0] = first;
                (0..n).for_each(|j| start[j + 1] += start[j]);
                for (j, range) in start.windows(2).enumerate().filter(|(_, r)| r[0] < r[1]) {
                    sides.push(Side { row: j as u32, start: range[0], end: range[1] });
                }
                out.entries.resize(start[n] as usize, (0, 0));
                for side in from {
                    for place in side.start..side.end {
                        let at = &mut start[self.columns[place as usize] as usize];
                        out.entries[*at as usize] = (side.row, place);
                        *at += 1;
                    }
                }
            }
            for side in &out.left {
                out.entries[side.start as usize..side.end as usize].reverse();
            }
            out
        })
    }
}

impl<T: Scalar> Factors<T> {
    /// Room for the numbers of a plan.
    pub(super) fn new(plan: Arc<Plan>) -> Self {
        let (numbers, pivots) = (plan.columns.len(), plan.rows.len());
        Self { plan, numbers: vec![T::ZERO; numbers], inverse_pivot: vec![T::ZERO; pivots] }
    }

    /// Eliminates the matrix with these values; returns the largest growth of a number in its row.
    ///
    /// Stops at a row whose pivot is negligible or not finite.
    pub(super) fn eliminate(&mut self, values: &[T]) -> Result<f64, Stopped> {
        let plan = self.plan.clone();
        match &plan.targets {
            Targets::Narrow(targets) => self.eliminate_by(&plan, targets, values),
            Targets::Wide(targets) => self.eliminate_by(&plan, targets, values),
        }
    }

    fn eliminate_by<P: Target>(
        &mut self,
        plan: &Plan,
        mut targets: &[P],
        values: &[T],
    ) -> Result<f64, Stopped> {
        let mut loads = &plan.loads[..];
        let mut segments = &plan.segments[..];
        let mut growth = 0.0f64;
        for (i, (row, &(n_loads, n_segments))) in plan.rows.iter().zip(&plan.counts).enumerate() {
            if i % WATCHED_ROWS == 0 {
                checkpoint(WATCHED_ROWS * 64);
            }
            let (above, rest) = self.numbers.split_at_mut(row.start as usize);
            let here = &mut rest[..(row.end - row.start) as usize];
            if here.len() > n_loads as usize {
                here.fill(T::ZERO);
            }
            let mut size = Peak(0);
            for load in split_off(&mut loads, n_loads) {
                let a = values[load.slot as usize].scaled(load.scale);
                here[load.place as usize] = a;
                size.see(a);
            }
            for segment in split_off(&mut segments, n_segments) {
                let targets = split_off(&mut targets, segment.shared);
                segment.subtract(here, targets, &plan.rows, above);
            }
            let mut peak = Peak(size.0);
            for &x in &*here {
                peak.see(x);
            }
            let (peak, size) = (peak.value(), size.value());
            let found = here[(row.pivot - row.start) as usize];
            let inverse = found.reciprocal();
            self.inverse_pivot[i] = inverse;
            for x in here {
                *x = *x * inverse;
            }
            growth = growth.max(peak / size);
            // Written so that a NaN fails.
            let good =
                found.size() > NEGLIGIBLE * peak && inverse.size().is_finite() && peak.is_finite();
            if !good {
                return Err(Stopped { position: i, pivot: found.signed_size() });
            }
        }
        Ok(growth)
    }
}

impl Segment {
    /// Subtracts from the row its multiples of the rows of U of this segment.
    #[inline(always)]
    fn subtract<T: Scalar, P: Target>(
        &self,
        here: &mut [T],
        targets: &[P],
        rows: &[Row],
        above: &[T],
    ) {
        let (place, count) = (self.place as usize, self.count as usize);
        let rows = &rows[self.first as usize..][..count];
        let right = |k: usize| &above[rows[k].pivot as usize + 1..rows[k].end as usize];
        if count == 1 {
            let multiple = here[place];
            for (&t, u) in targets.iter().zip(right(0)) {
                here[t.place()] = here[t.place()] - multiple * *u;
            }
            return;
        }
        // The triangle: columns of the segment itself.
        for k in 0..count {
            let multiple = here[place + k];
            for (r, u) in here[place + k + 1..place + count].iter_mut().zip(right(k)) {
                *r = *r - multiple * *u;
            }
        }
        // The columns that its rows share, four rows at a time.
        let shared = |k: usize| &right(k)[count - 1 - k..][..targets.len()];
        let mut k = 0;
        while k + 4 <= count {
            let l: [T; 4] = std::array::from_fn(|s| here[place + k + s]);
            let (u0, u1, u2, u3) = (shared(k), shared(k + 1), shared(k + 2), shared(k + 3));
            for (t, &at) in targets.iter().enumerate() {
                here[at.place()] = here[at.place()]
                    - ((l[0] * u0[t] + l[1] * u1[t]) + (l[2] * u2[t] + l[3] * u3[t]));
            }
            k += 4;
        }
        if k + 2 <= count {
            let (l0, l1) = (here[place + k], here[place + k + 1]);
            let (u0, u1) = (shared(k), shared(k + 1));
            for (t, &at) in targets.iter().enumerate() {
                here[at.place()] = here[at.place()] - (l0 * u0[t] + l1 * u1[t]);
            }
            k += 2;
        }
        if k < count {
            let l = here[place + k];
            for (&at, u) in targets.iter().zip(shared(k)) {
                here[at.place()] = here[at.place()] - l * *u;
            }
        }
    }
}

/// Takes the first `count` items off the front of a slice.
#[inline(always)]
fn split_off<'a, T>(slice: &mut &'a [T], count: u32) -> &'a [T] {
    let (first, rest) = slice.split_at(count as usize);
    *slice = rest;
    first
}

/// Largest magnitude seen; a NaN counts as larger than every number. On bits, since that costs one
/// cycle an entry where `f64::max` waits for four instructions.
struct Peak(u64);

impl Peak {
    #[inline(always)]
    fn see(&mut self, x: impl Scalar) {
        self.0 = self.0.max(x.size().to_bits());
    }

    fn value(&self) -> f64 {
        f64::from_bits(self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::Targets;

    #[test] // truth: the limits of two bytes
    fn places_are_as_wide_as_they_must_be() {
        let narrow = Targets::new(vec![0, 7, 65_535]);
        assert!(matches!(narrow, Targets::Narrow(places) if places == [0, 7, 65_535]));
        let wide = Targets::new(vec![0, 65_536]);
        assert!(matches!(wide, Targets::Wide(places) if places == [0, 65_536]));
    }
}
