use super::{PlanarMeasure, SpatialMeasure, planar_turn, points, spatial_turn};
use crate::elements::measure::Dot;
use crate::elements::row::Axis::{F, G, X, Y, Z};
use crate::elements::row::RowKind::{Rotation, Translation};
use crate::elements::space::Triad;
use crate::elements::{planar, spatial};

/// Planar revolute joint: the points coincide.
///
/// ```text
/// d = 0     2 rows, m
/// ```
///
/// Source: Haug (1989), 3.3.
pub(in crate::elements) fn planar(frames: &[Triad<2>; 2]) -> planar::Constraint {
    let measure = PlanarMeasure::new(points(frames), true, Vec::new());
    let kinds = &[Translation(X), Translation(Y)];
    planar::Constraint::of_joint(frames, measure, kinds, vec![planar_turn(frames)])
}

/// Spatial revolute joint: the points coincide, h_j stays along h_i.
///
/// ```text
/// d = 0                 3 rows, m
/// f_iᵀh_j = g_iᵀh_j = 0   2 rows, direction cosines
/// ```
///
/// Source: Haug (1989), 9.4.
pub(in crate::elements) fn spatial(frames: &[Triad<3>; 2]) -> spatial::Constraint {
    let ([f, g, _], [_, _, h]) = (frames[0].axes, frames[1].axes);
    let dots = vec![Dot::axes(f, h), Dot::axes(g, h)];
    let measure = SpatialMeasure::new(points(frames), true, dots);
    let kinds = &[Translation(X), Translation(Y), Translation(Z), Rotation(G), Rotation(F)];
    spatial::Constraint::of_joint(frames, measure, kinds, vec![spatial_turn(frames)])
}
