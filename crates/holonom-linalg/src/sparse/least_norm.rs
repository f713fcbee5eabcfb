//! Underdetermined sparse systems.

use super::{SparseLu, SparsePattern};
use crate::error::SingularMatrix;

/// What rows that depend on others are damped by, against the square of a row's size.
const DAMPING: f64 = 1e-12;

/// The shortest x with A x = b for a sparse m×n matrix of `entries` (row, column, value), which add up:
///
/// ```text
/// [1  Aᵀ; A  −ε] (x, y) = (0, b)
/// ```
///
/// with every row scaled to size one and ε = 1e-12, so that consistent dependent rows do no harm; where
/// singular values of A lie near √ε the solution falls short, which an iteration makes up for.
///
/// # Errors
/// [`SingularMatrix`] when a number is not finite.
pub fn sparse_least_norm(
    m: usize,
    n: usize,
    entries: &[(usize, usize, f64)],
    b: &[f64],
) -> Result<Vec<f64>, SingularMatrix> {
    let mut square = vec![0.0f64; m];
    for &(i, _, x) in entries {
        square[i] += x * x;
    }
    let scale: Vec<f64> =
        square.iter().map(|s| if *s > 0.0 { 1.0 / s.sqrt() } else { 1.0 }).collect();
    let mut places: Vec<(usize, usize)> = (0..n + m).map(|k| (k, k)).collect();
    for &(i, j, _) in entries {
        places.extend([(n + i, j), (j, n + i)]);
    }
    let (pattern, slots) = SparsePattern::new(n + m, n + m, &places);
    let mut values = vec![0.0; pattern.len()];
    for (k, slot) in slots[..n + m].iter().enumerate() {
        values[*slot] = if k < n { 1.0 } else { -DAMPING };
    }
    for (pair, &(i, _, x)) in slots[n + m..].chunks_exact(2).zip(entries) {
        pair.iter().for_each(|slot| values[*slot] += x * scale[i]);
    }
    let mut right = vec![0.0; n + m];
    for ((out, b), scale) in right[n..].iter_mut().zip(b).zip(&scale) {
        *out = b * scale;
    }
    SparseLu::analyze(&pattern, &values)?.solve_refined(&pattern, &values, &mut right);
    right.truncate(n);
    Ok(right)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::least_norm;

    #[test] // truth: the dense solution by singular values
    fn the_shortest_solution_also_where_rows_repeat() {
        let rows =
            [[1.0, 2.0, 0.0, 0.0, 0.5], [0.0, 1e3, -4e3, 1e3, 0.0], [2.0, 4.0, 0.0, 0.0, 1.0]];
        let b = [3.0, 2e3, 6.0];
        let dense: Vec<f64> = rows.concat();
        let mut entries = Vec::new();
        for (i, row) in rows.iter().enumerate() {
            // In two parts: entries at one place add up.
            entries.extend(row.iter().enumerate().map(|(j, x)| (i, j, 0.25 * x)));
            entries.extend(row.iter().enumerate().map(|(j, x)| (i, j, 0.75 * x)));
        }
        let x = sparse_least_norm(3, 5, &entries, &b).unwrap();
        let truth = least_norm(3, 5, &dense, &b, 1e-10).unwrap().x;
        for (x, truth) in x.iter().zip(&truth) {
            assert!((x - truth).abs() < 1e-10, "{x} ≠ {truth}");
        }
    }
}
