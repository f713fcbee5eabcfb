use super::{SpatialMeasure, points};
use crate::elements::measure::Dot;
use crate::elements::row::Axis::{X, Y, Z};
use crate::elements::row::RowKind::{RotationAboutNormal, Translation};
use crate::elements::space::Triad;
use crate::elements::spatial;

/// Universal joint: the points coincide, h_j stays perpendicular to h_i.
///
/// ```text
/// d = 0         3 rows, m
/// h_iᵀh_j = 0   1 row, direction cosine
/// ```
///
/// Source: Haug (1989), 9.4.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let dots = vec![Dot::axes(frames[0].axes[2], frames[1].axes[2])];
    let measure = SpatialMeasure::new(points(frames), true, dots);
    let kinds = &[Translation(X), Translation(Y), Translation(Z), RotationAboutNormal];
    spatial::Constraint::of_joint(frames, measure, kinds, Vec::new())
}
