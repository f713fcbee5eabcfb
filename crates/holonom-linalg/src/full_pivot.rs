/// Result of [`full_pivot_elimination`].
#[derive(Debug, Clone, PartialEq)]
pub struct FullPivot {
    /// All rows of the matrix, those with a pivot first, in the order of elimination.
    pub row_order: Vec<usize>,
    /// All columns of the matrix, those with a pivot first, in the order of elimination.
    pub column_order: Vec<usize>,
    /// The pivots, in the order of elimination; `rank` of them.
    pub pivots: Vec<f64>,
    /// Number of pivots taken.
    pub rank: usize,
}

/// An entry below this fraction of the largest number its row was made of is cancellation noise.
const NEGLIGIBLE: f64 = 1024.0 * f64::EPSILON;

/// Gaussian elimination with complete pivoting of an m×n matrix `a` (by rows), in place.
///
/// The pivots `fixed` (row, column) are taken first and in this order, but for one that elimination
/// has reduced to round-off: its row and column then stay free. After them the largest remaining
/// entry is the pivot; elimination ends when that is round-off or not above `relative_tolerance`
/// times the first of these free pivots. Of equal entries the first by row, then column, is taken.
///
/// On return `a` holds the factors in pivot order: row i of it is row `row_order[i]` of the matrix
/// with columns in `column_order`; multipliers of the unit lower triangle left of the diagonal,
/// the upper triangle from the diagonal on, and what is left of the matrix beyond the rank.
///
/// # Panics
/// If `a` has not m·n entries.
pub fn full_pivot_elimination(
    m: usize,
    n: usize,
    a: &mut [f64],
    fixed: &[(usize, usize)],
    relative_tolerance: f64,
) -> FullPivot {
    assert_eq!(a.len(), m * n, "the matrix has m·n entries");
    let mut row_peak: Vec<f64> = (0..m).map(|i| largest(&a[i * n..(i + 1) * n])).collect();
    let mut result = FullPivot {
        row_order: (0..m).collect(),
        column_order: (0..n).collect(),
        pivots: Vec::with_capacity(m.min(n)),
        rank: 0,
    };
    for &(row, column) in fixed {
        let p = result.rank;
        let i = (p..m).find(|&i| result.row_order[i] == row);
        let j = (p..n).find(|&j| result.column_order[j] == column);
        if let (Some(i), Some(j)) = (i, j)
            && a[i * n + j].abs() > NEGLIGIBLE * row_peak[i]
        {
            result.eliminate(n, a, &mut row_peak, i, j);
        }
    }
    let mut smallest_allowed = None;
    while result.rank < m.min(n) {
        let p = result.rank;
        let (mut at, mut size) = ((p, p), 0.0f64);
        for i in p..m {
            for j in p..n {
                if a[i * n + j].abs() > size.max(NEGLIGIBLE * row_peak[i]) {
                    (at, size) = ((i, j), a[i * n + j].abs());
                }
            }
        }
        if size <= *smallest_allowed.get_or_insert(relative_tolerance * size) {
            break;
        }
        result.eliminate(n, a, &mut row_peak, at.0, at.1);
    }
    result
}

impl FullPivot {
    /// Brings the entry now at (i, j) to the diagonal and eliminates below it.
    fn eliminate(&mut self, n: usize, a: &mut [f64], row_peak: &mut [f64], i: usize, j: usize) {
        let p = self.rank;
        self.row_order.swap(p, i);
        self.column_order.swap(p, j);
        row_peak.swap(p, i);
        if p != i {
            let (upper, lower) = a.split_at_mut(i * n);
            upper[p * n..(p + 1) * n].swap_with_slice(&mut lower[..n]);
        }
        if p != j {
            for row in a.chunks_exact_mut(n) {
                row.swap(p, j);
            }
        }
        let (upper, lower) = a.split_at_mut((p + 1) * n);
        let pivot_row = &upper[p * n..];
        let size = largest(&pivot_row[p..]);
        for (row, peak) in lower.chunks_exact_mut(n).zip(&mut row_peak[p + 1..]) {
            let l = row[p] / pivot_row[p];
            row[p] = l;
            *peak = peak.max(l.abs() * size);
            if l != 0.0 {
                for (a, u) in row[p + 1..].iter_mut().zip(&pivot_row[p + 1..]) {
                    *a -= l * u;
                }
            }
        }
        self.pivots.push(pivot_row[p]);
        self.rank += 1;
    }
}

fn largest(row: &[f64]) -> f64 {
    row.iter().fold(0.0, |m, v| m.max(v.abs()))
}
