use super::{PlanarMeasure, SpatialMeasure, planar_slide, points, spatial_slide};
use crate::elements::measure::Dot;
use crate::elements::row::Axis::{F, G, H};
use crate::elements::row::RowKind::{PlanarRotation, Rotation, Translation};
use crate::elements::space::Triad;
use crate::elements::{planar, spatial};

/// Planar translational joint: slides along f, no turning.
///
/// ```text
/// g_iᵀd = 0     1 row, m
/// g_iᵀf_j = 0   1 row, direction cosine
/// ```
///
/// Source: Haug (1989), 3.3.
pub(in crate::elements) fn planar(frames: &[Triad<2>; 2]) -> planar::Constraint {
    let g = frames[0].axes[1];
    let dots = vec![Dot::along(g), Dot::axes(g, frames[1].axes[0])];
    let measure = PlanarMeasure::new(points(frames), false, dots);
    let kinds = &[Translation(G), PlanarRotation];
    planar::Constraint::of_joint(frames, measure, kinds, vec![planar_slide(frames)])
}

/// Spatial translational joint: slides along h, no turning.
///
/// ```text
/// f_iᵀd = g_iᵀd = 0               2 rows, m
/// f_iᵀh_j = g_iᵀh_j = g_iᵀf_j = 0   3 rows, direction cosines
/// ```
///
/// Source: Haug (1989), 9.4: a cylindrical joint with its rotation removed.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let ([f, g, _], [along, _, h]) = (frames[0].axes, frames[1].axes);
    let dots =
        vec![Dot::along(f), Dot::along(g), Dot::axes(f, h), Dot::axes(g, h), Dot::axes(g, along)];
    let measure = SpatialMeasure::new(points(frames), false, dots);
    let kinds = &[Translation(F), Translation(G), Rotation(G), Rotation(F), Rotation(H)];
    spatial::Constraint::of_joint(frames, measure, kinds, vec![spatial_slide(frames)])
}
