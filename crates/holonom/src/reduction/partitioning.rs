//! Choice of kept rows and independent coordinates.

use super::parametrization::{Parametrization, Projection};
use crate::system::{Measure, System};
use holonom_linalg::{BlockMatrix, full_pivot_elimination};

/// A pivot below this fraction of the first marks a redundant row.
pub const RANK_TOLERANCE: f64 = 1e-9;
/// Columns of translations weigh this much more than the characteristic length alone gives them, so
/// that translations become dependent and rotations stay independent: stiff elements are nearly
/// linear in rotations, and the stiff directions then stay put during a step. On a double pendulum
/// with a stiff joint this saves nine tenths of the steps.
pub(super) const TRANSLATION_BIAS: f64 = 8.0;

/// Partitions the coordinates at a configuration with Jacobian `g`, by elimination with full
/// pivoting on the scaled Jacobian; the largest Euler parameter of each body is dependent. Rows of which less than
/// `rank_tolerance` is left are redundant; [`RANK_TOLERANCE`] is the usual one.
///
/// Source: R. A. Wehage, E. J. Haug, *Generalized coordinate partitioning for dimension reduction in
/// analysis of constrained dynamic systems*, J. Mech. Design 104 (1982).
pub fn partition(
    system: &dyn System,
    q: &[f64],
    g: &BlockMatrix,
    rank_tolerance: f64,
) -> Parametrization {
    let structure = system.structure();
    let sizes = &structure.sizes;
    let (m, n) = (sizes.rows, sizes.coordinates);
    let mut a = scaled_jacobian(system, g);
    let mut fixed = Vec::new();
    for (body, row) in (structure.normalization_start..m).enumerate() {
        let own = sizes.rotations_of(body);
        let larger = |best: usize, i: usize| if q[i].abs() > q[best].abs() { i } else { best };
        let largest = own.clone().fold(own.start, larger);
        fixed.push((row, largest));
    }
    let pivots = full_pivot_elimination(m, n, &mut a, &fixed, rank_tolerance);
    let rank = pivots.rank;
    let mut kept = pivots.row_order[..rank].to_vec();
    let mut dropped = pivots.row_order[rank..].to_vec();
    let mut independent = pivots.column_order[rank..].to_vec();
    kept.sort_unstable();
    dropped.sort_unstable();
    independent.sort_unstable();
    let free = &pivots.pivots[fixed.len().min(rank)..rank];
    let pivot_ratio = match (free.first(), free.last()) {
        (Some(first), Some(last)) => (last / first).abs(),
        _ => 1.0,
    };
    let projection = Projection::Selection(independent);
    Parametrization { kept: kept.into(), dropped, projection, ndof: n - rank, pivot_ratio }
}

/// G with columns in metres multiplied by the characteristic length and a bias, then every row divided by its largest entry; m×n by rows.
pub fn scaled_jacobian(system: &dyn System, g: &BlockMatrix) -> Vec<f64> {
    let structure = system.structure();
    let n = structure.sizes.coordinates;
    let length = TRANSLATION_BIAS * system.characteristic_length();
    let mut a = g.to_dense();
    for row in a.chunks_exact_mut(n.max(1)) {
        let mut largest = 0.0f64;
        for (i, x) in row.iter_mut().enumerate() {
            if structure.coordinate_measure(i) == Measure::Length {
                *x *= length;
            }
            largest = largest.max(x.abs());
        }
        if largest > 0.0 {
            row.iter_mut().for_each(|x| *x /= largest);
        }
    }
    a
}
