use super::{SpatialMeasure, points, spatial_slide, spatial_turn};
use crate::elements::measure::Dot;
use crate::elements::row::Axis::{F, G};
use crate::elements::row::RowKind::{Rotation, Translation};
use crate::elements::space::Triad;
use crate::elements::spatial;

/// Cylindrical joint: slides along and turns about h.
///
/// ```text
/// f_iᵀd = g_iᵀd = 0       2 rows, m
/// f_iᵀh_j = g_iᵀh_j = 0   2 rows, direction cosines
/// ```
///
/// Source: Haug (1989), 9.4.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let ([f, g, _], [_, _, h]) = (frames[0].axes, frames[1].axes);
    let dots = vec![Dot::along(f), Dot::along(g), Dot::axes(f, h), Dot::axes(g, h)];
    let measure = SpatialMeasure::new(points(frames), false, dots);
    let kinds = &[Translation(F), Translation(G), Rotation(G), Rotation(F)];
    let coordinates = vec![spatial_slide(frames), spatial_turn(frames)];
    spatial::Constraint::of_joint(frames, measure, kinds, coordinates)
}
