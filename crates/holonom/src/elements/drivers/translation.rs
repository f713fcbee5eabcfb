use crate::elements::joints::{planar_slide, spatial_slide};
use crate::elements::row::Axis::{F, H};
use crate::elements::row::RowKind::Translation;
use crate::elements::space::Triad;
use crate::elements::{planar, spatial};
use crate::math::TimeFunction;

/// Planar prescribed displacement: f_iᵀd = s(t), m.
pub(in crate::elements) fn planar(
    frames: &[Triad<2>; 2],
    motion: TimeFunction,
) -> planar::Constraint {
    planar::Constraint::of_driver(frames, planar_slide(frames), &[Translation(F)], motion)
}

/// Spatial prescribed displacement: h_iᵀd = s(t), m.
pub(in crate::elements) fn spatial(
    frames: &[Triad<3>; 2],
    motion: TimeFunction,
) -> spatial::Constraint {
    spatial::Constraint::of_driver(frames, spatial_slide(frames), &[Translation(H)], motion)
}
