use crate::scalar::Scalar;

/// Which entries of a sparse matrix may differ from zero, in compressed rows.
///
/// The values live in a slice of the caller, one per stored entry ("slot"), rows one after the
/// other and columns ascending within a row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SparsePattern {
    n_rows: usize,
    n_cols: usize,
    row_pointers: Vec<usize>,
    columns: Vec<usize>,
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
        let mut order: Vec<usize> = (0..entries.len()).collect();
        order.sort_unstable_by_key(|&e| entries[e]);
        let mut row_pointers = vec![0; n_rows + 1];
        let mut columns: Vec<usize> = Vec::with_capacity(entries.len());
        let mut slots = vec![0; entries.len()];
        let mut last = None;
        for e in order {
            if last != Some(entries[e]) {
                last = Some(entries[e]);
                columns.push(entries[e].1);
                row_pointers[entries[e].0 + 1] = columns.len();
            }
            slots[e] = columns.len() - 1;
        }
        for i in 0..n_rows {
            row_pointers[i + 1] = row_pointers[i + 1].max(row_pointers[i]);
        }
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
    pub fn row_pointers(&self) -> &[usize] {
        &self.row_pointers
    }

    /// Column of every slot.
    pub fn columns(&self) -> &[usize] {
        &self.columns
    }

    /// Slots of row `i` with their columns.
    pub fn row(&self, i: usize) -> impl Iterator<Item = (usize, usize)> + '_ {
        (self.row_pointers[i]..self.row_pointers[i + 1]).map(|slot| (slot, self.columns[slot]))
    }

    /// y += α A x, with x of `n_cols` and y of `n_rows`.
    pub fn multiply_add<T: Scalar>(&self, values: &[T], alpha: f64, x: &[T], y: &mut [T]) {
        for (i, y) in y.iter_mut().enumerate() {
            let row = self.row_pointers[i]..self.row_pointers[i + 1];
            let products = values[row.clone()].iter().zip(&self.columns[row]);
            let dot = products.fold(T::ZERO, |sum, (a, &j)| sum + *a * x[j]);
            *y = *y + dot.scaled(alpha);
        }
    }
}
