use super::{PlanarMeasure, SpatialMeasure, points};
use crate::elements::measure::Dot;
use crate::elements::row::Axis::{F, G, H, X, Y, Z};
use crate::elements::row::RowKind::{PlanarRotation, Rotation, Translation};
use crate::elements::space::Triad;
use crate::elements::{planar, spatial};

/// Planar fixed joint: the frames coincide.
///
/// ```text
/// d = 0         2 rows, m
/// g_iᵀf_j = 0   1 row, the sine of the relative angle: insensitive to whole turns
/// ```
///
/// Source: Haug (1989), 3.3.
pub(in crate::elements) fn planar(frames: &[Triad<2>; 2]) -> planar::Constraint {
    let dots = vec![Dot::axes(frames[0].axes[1], frames[1].axes[0])];
    let measure = PlanarMeasure::new(points(frames), true, dots);
    let kinds = &[Translation(X), Translation(Y), PlanarRotation];
    planar::Constraint::of_joint(frames, measure, kinds, Vec::new())
}

/// Spatial fixed joint: the frames coincide.
///
/// ```text
/// d = 0                           3 rows, m
/// f_iᵀh_j = g_iᵀh_j = g_iᵀf_j = 0   3 rows, direction cosines
/// ```
///
/// Source: Haug (1989), 9.4: a revolute joint with its rotation removed.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let ([f, g, _], [along, _, h]) = (frames[0].axes, frames[1].axes);
    let dots = vec![Dot::axes(f, h), Dot::axes(g, h), Dot::axes(g, along)];
    let measure = SpatialMeasure::new(points(frames), true, dots);
    let kinds =
        &[Translation(X), Translation(Y), Translation(Z), Rotation(G), Rotation(F), Rotation(H)];
    spatial::Constraint::of_joint(frames, measure, kinds, Vec::new())
}
