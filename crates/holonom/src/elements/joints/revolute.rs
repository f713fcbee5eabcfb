use super::{PlanarMeasure, SpatialMeasure, planar_turn, points, spatial_turn};
use crate::elements::measure::Dot;
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
    let names = &["translation along x", "translation along y"];
    planar::Constraint::of_joint(frames, measure, names, vec![planar_turn(frames)])
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
    let names = &[
        "translation along x",
        "translation along y",
        "translation along z",
        "rotation about g",
        "rotation about f",
    ];
    spatial::Constraint::of_joint(frames, measure, names, vec![spatial_turn(frames)])
}
