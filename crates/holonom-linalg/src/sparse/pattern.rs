use crate::scalar::Scalar;
use crate::watch::checkpoint;
use std::sync::Arc;

/// Which entries of a sparse matrix may differ from zero, in compressed rows.
///
/// The values live in a slice of the caller, one per stored entry ("slot"), rows one after the
/// other and columns ascending within a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparsePattern {
    n_rows: usize,
    n_cols: usize,
    // Shared by copies: matrices of one pattern are many.
    row_pointers: Arc<[u32]>,
    columns: Arc<[u32]>,
}

impl SparsePattern {
    /// Builds the pattern of an `n_rows`×`n_cols` matrix from (row, column) pairs in any order.
    ///
    /// Equal pairs share one slot. The second result gives the slot of each pair, so that values
    /// are added up by `values[slot[e]] += value_of_entry_e`.
    ///
    /// # Panics
    /// If an entry lies outside the matrix.
    pub fn new(n_rows: usize, n_cols: usize, entries: &[(usize, usize)]) -> (Self, Vec<usize>) {
        for &(i, j) in entries {
            assert!(i < n_rows && j < n_cols, "entry ({i}, {j}) is outside {n_rows}×{n_cols}");
        }
        // Entries by row: those of row i at starts[i]..starts[i + 1].
        let mut starts = vec![0; n_rows + 1];
        for &(i, _) in entries {
            starts[i + 1] += 1;
        }
        for i in 0..n_rows {
            starts[i + 1] += starts[i];
        }
        let mut order = vec![0u32; entries.len()];
        let mut next = starts.clone();
        for (e, &(i, _)) in entries.iter().enumerate() {
            order[next[i]] = e as u32;
            next[i] += 1;
        }
        let mut row_pointers = Vec::with_capacity(n_rows + 1);
        row_pointers.push(0u32);
        let mut columns: Vec<u32> = Vec::new();
        let mut slots = vec![0; entries.len()];
        for row in starts.windows(2) {
            let row = &mut order[row[0]..row[1]];
            checkpoint(4 * row.len());
            row.sort_unstable_by_key(|&e| entries[e as usize].1);
            let first = columns.len();
            for &e in &*row {
                let column = entries[e as usize].1 as u32;
                if columns[first..].last() != Some(&column) {
                    columns.push(column);
                }
                slots[e as usize] = columns.len() - 1;
            }
            row_pointers.push(columns.len() as u32);
        }
        let (row_pointers, columns) = (row_pointers.into(), columns.into());
        (Self { n_rows, n_cols, row_pointers, columns }, slots)
    }

    /// Number of stored entries: the length of a value slice.
    pub fn len(&self) -> usize {
        self.columns.len()
    }

    /// Whether nothing is stored.
    pub fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }

    /// Number of rows of the matrix.
    pub fn n_rows(&self) -> usize {
        self.n_rows
    }

    /// Number of columns of the matrix.
    pub fn n_cols(&self) -> usize {
        self.n_cols
    }

    /// Slots of row i are `row_pointers()[i]..row_pointers()[i + 1]`; length `n_rows + 1`.
    pub fn row_pointers(&self) -> &[u32] {
        &self.row_pointers
    }

    /// Column of every slot.
    pub fn columns(&self) -> &[u32] {
        &self.columns
    }

    fn slots(&self, i: usize) -> std::ops::Range<usize> {
        self.row_pointers[i] as usize..self.row_pointers[i + 1] as usize
    }

    /// Slots of row `i` with their columns.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        self.slots(i).map(|slot| (slot, self.columns[slot] as usize))
    }

    /// y += α A x, with x of `n_cols` and y of `n_rows`.
    pub fn multiply_add<T: Scalar>(&self, values: &[T], alpha: f64, x: &[T], y: &mut [T]) {
        for (i, y) in y.iter_mut().enumerate() {
            let row = self.slots(i);
            let products = values[row.clone()].iter().zip(&self.columns[row]);
            let dot = products.fold(T::ZERO, |sum, (a, &j)| sum + *a * x[j as usize]);
            *y = *y + dot.scaled(alpha);
        }
    }
}
