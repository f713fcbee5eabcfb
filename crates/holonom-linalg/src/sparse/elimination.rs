//! Numerical elimination with frozen pivots, row by row.

use crate::sparse::symbolic::FactorPattern;

/// A pivot below this fraction of the largest number its row ever held is cancellation noise.
pub(super) const NEGLIGIBLE: f64 = 32.0 * f64::EPSILON;

/// One entry of the scaled and permuted matrix: its column, its slot among the values, its scale.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub(super) column: u32,
    pub(super) slot: u32,
    pub(super) scale: f64,
}

/// Part of a row of L whose columns follow one another and whose rows of U agree beyond them.
#[derive(Debug, Clone, Copy)]
struct Segment {
    /// First column, and how many.
    first: u32,
    count: u32,
    /// Where the first of these rows of U begins, and where the columns they share.
    block: u32,
    shared_start: u32,
    shared: u32,
}

/// What elimination does for each row: how many entries it reads, how many segments it subtracts.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    entries: Vec<Entry>,
    segments: Vec<Segment>,
    counts: Vec<(u32, u32)>,
}

/// The factors' numbers, and one row while it is eliminated (zero between calls).
#[derive(Debug, Clone)]
pub(super) struct Numbers {
    pub(super) l: Vec<f64>,
    pub(super) u: Vec<f64>,
    pub(super) inverse_pivot: Vec<f64>,
    row: Vec<f64>,
}

/// A row that could not be eliminated.
pub(super) struct Stopped {
    pub(super) position: usize,
    pub(super) pivot: f64,
}

impl Numbers {
    pub(super) fn new(pattern: &FactorPattern) -> Self {
        let n = pattern.n();
        Self {
            l: vec![0.0; pattern.l_column.len()],
            u: vec![0.0; pattern.u_column.len()],
            inverse_pivot: vec![0.0; n],
            row: vec![0.0; n],
        }
    }
}

impl Plan {
    /// Cuts every row of L into segments.
    ///
    /// Rows p and p + 1 of U belong together when the pattern of p is p + 1 and the pattern of
    /// p + 1. A row of L that uses p then also uses p + 1, since elimination with p fills it.
    pub(super) fn new(pattern: &FactorPattern, rows: &[Vec<Entry>]) -> Self {
        let joined: Vec<bool> = (0..pattern.n())
            .map(|p| {
                p + 1 < pattern.n() && {
                    let (this, next) = (pattern.u_range(p), pattern.u_range(p + 1));
                    this.len() == next.len() + 1
                        && pattern.u_column[this.start] as usize == p + 1
                        && pattern.u_column[this.start + 1..this.end] == pattern.u_column[next]
                }
            })
            .collect();
        let mut plan = Self { entries: rows.concat(), segments: Vec::new(), counts: Vec::new() };
        for (i, entries) in rows.iter().enumerate() {
            let from = plan.segments.len();
            for &j in &pattern.l_column[pattern.l_range(i)] {
                let range = pattern.u_range(j as usize);
                match plan.segments[from..].last_mut() {
                    Some(s) if s.first + s.count == j && joined[j as usize - 1] => {
                        s.count += 1;
                        s.shared_start = range.start as u32;
                        s.shared = range.len() as u32;
                    }
                    _ => plan.segments.push(Segment {
                        first: j,
                        count: 1,
                        block: range.start as u32,
                        shared_start: range.start as u32,
                        shared: range.len() as u32,
                    }),
                }
            }
            plan.counts.push((entries.len() as u32, (plan.segments.len() - from) as u32));
        }
        plan
    }

    /// Eliminates the matrix with these values; returns the largest growth of a number in its row.
    ///
    /// Stops at a row whose pivot is negligible or not finite, or whose numbers grow beyond
    /// `growth_limit`.
    pub(super) fn eliminate(
        &self,
        pattern: &FactorPattern,
        values: &[f64],
        growth_limit: f64,
        numbers: &mut Numbers,
    ) -> Result<f64, Stopped> {
        let row = &mut numbers.row[..];
        let mut entries = &self.entries[..];
        let mut segments = &self.segments[..];
        let mut l = &mut numbers.l[..];
        let mut growth = 0.0f64;
        for (i, &(n_entries, n_segments)) in self.counts.iter().enumerate() {
            let mut peak = Peak(0);
            for entry in split_off(&mut entries, n_entries) {
                let a = values[entry.slot as usize] * entry.scale;
                row[entry.column as usize] = a;
                peak.see(a);
            }
            let size = peak.value();
            for segment in split_off(&mut segments, n_segments) {
                let (here, rest) = std::mem::take(&mut l).split_at_mut(segment.count as usize);
                l = rest;
                let range = segment.first as usize..(segment.first + segment.count) as usize;
                let inverse = &numbers.inverse_pivot[range];
                segment.subtract(row, here, inverse, &numbers.u, &pattern.u_column, &mut peak);
            }
            let u = pattern.u_range(i);
            for (&k, u) in pattern.u_column[u.clone()].iter().zip(&mut numbers.u[u]) {
                *u = std::mem::take(&mut row[k as usize]);
                peak.see(*u);
            }
            let pivot = std::mem::take(&mut row[i]);
            peak.see(pivot);
            let peak = peak.value();
            numbers.inverse_pivot[i] = 1.0 / pivot;
            growth = growth.max(peak / size);
            // Written so that a NaN fails.
            let good = pivot.abs() > NEGLIGIBLE * peak
                && peak <= growth_limit * size
                && numbers.inverse_pivot[i].is_finite()
                && peak.is_finite();
            if !good {
                row.fill(0.0);
                return Err(Stopped { position: i, pivot });
            }
        }
        Ok(growth)
    }
}

impl Segment {
    /// Subtracts from the row its multiples of the rows of U of this segment, and keeps these
    /// multiples in `l`.
    #[inline(always)]
    fn subtract(
        &self,
        row: &mut [f64],
        l: &mut [f64],
        inverse_pivot: &[f64],
        u: &[f64],
        u_column: &[u32],
        peak: &mut Peak,
    ) {
        let (first, shared) = (self.first as usize, self.shared as usize);
        let columns = &u_column[self.shared_start as usize..][..shared];
        if let ([l], [inverse]) = (&mut *l, inverse_pivot) {
            let numerator = std::mem::take(&mut row[first]);
            peak.see(numerator);
            *l = numerator * inverse;
            let u = &u[self.shared_start as usize..][..shared];
            for (&k, u) in columns.iter().zip(u) {
                row[k as usize] -= *l * u;
            }
            return;
        }
        let count = l.len();
        // The triangle: columns of the segment itself.
        let inside = &mut row[first..first + count];
        let mut block = &u[self.block as usize..];
        for a in 0..count {
            let numerator = std::mem::take(&mut inside[a]);
            peak.see(numerator);
            let multiple = numerator * inverse_pivot[a];
            l[a] = multiple;
            let (triangle, rest) = block.split_at(count - 1 - a);
            for (r, u) in inside[a + 1..].iter_mut().zip(triangle) {
                *r -= multiple * u;
            }
            block = &rest[shared..];
        }
        // The columns that its rows share, four rows at a time.
        let mut block = &u[self.block as usize..];
        let mut triangle = count;
        let mut next_row = || {
            triangle -= 1;
            let (this, rest) = block[triangle..].split_at(shared);
            block = rest;
            this
        };
        let (fours, mut l) = l.as_chunks::<4>();
        for l in fours {
            let (u0, u1, u2, u3) = (next_row(), next_row(), next_row(), next_row());
            for t in 0..shared {
                row[columns[t] as usize] -=
                    (l[0] * u0[t] + l[1] * u1[t]) + (l[2] * u2[t] + l[3] * u3[t]);
            }
        }
        if let [l0, l1, rest @ ..] = l {
            l = rest;
            let (u0, u1) = (next_row(), next_row());
            for t in 0..shared {
                row[columns[t] as usize] -= l0 * u0[t] + l1 * u1[t];
            }
        }
        if let [l0] = l {
            let u0 = next_row();
            for t in 0..shared {
                row[columns[t] as usize] -= l0 * u0[t];
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
    fn see(&mut self, x: f64) {
        self.0 = self.0.max(x.to_bits() & !(1 << 63));
    }

    fn value(&self) -> f64 {
        f64::from_bits(self.0)
    }
}
