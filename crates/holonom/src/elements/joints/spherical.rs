use super::{SpatialMeasure, points};
use crate::elements::row::Axis::{X, Y, Z};
use crate::elements::row::RowKind::Translation;
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
    let kinds = &[Translation(X), Translation(Y), Translation(Z)];
    spatial::Constraint::of_joint(frames, measure, kinds, Vec::new())
}
