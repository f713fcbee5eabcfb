use super::{SpatialMeasure, points};
use crate::elements::space::Triad;
use crate::elements::spatial;

/// Spherical joint: the points coincide.
///
/// ```text
/// d = 0     3 rows, m
/// ```
///
/// Source: Haug (1989), 9.4.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let measure = SpatialMeasure::new(points(frames), true, Vec::new());
    let names = &["translation along x", "translation along y", "translation along z"];
    spatial::Constraint::of_joint(frames, measure, names, Vec::new())
}
