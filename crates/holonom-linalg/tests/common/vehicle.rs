//! The thesis's vehicle in joint coordinates, for tests, the benchmark and the example.

use holonom_linalg::CutRows;

/// Parents and coordinates of its bodies, and its cuts: chassis, four upper arms with their spindles, rack, four
/// lower arms; ball joints of the lower arms and rods are cut. Source: Negrut's thesis, section 3.4.3, with the
/// edges that satisfy all its counts.
pub(crate) fn vehicle() -> (Vec<Option<usize>>, Vec<usize>, Vec<CutRows>) {
    let mut parents = vec![None];
    let mut sizes = vec![6];
    for _ in 0..4 {
        parents.extend([Some(0), Some(parents.len())]);
        sizes.extend([1, 3]);
    }
    parents.extend([Some(0); 5]);
    sizes.extend([1; 5]);
    let spindle = |corner: usize| Some(2 + 2 * corner);
    let mut cuts: Vec<CutRows> =
        (0..4).map(|i| CutRows { nodes: [spindle(i), Some(10 + i)], rows: 3 }).collect();
    cuts.extend(
        (0..4).map(|i| CutRows { nodes: [spindle(i), Some(if i < 2 { 9 } else { 0 })], rows: 1 }),
    );
    (parents, sizes, cuts)
}
