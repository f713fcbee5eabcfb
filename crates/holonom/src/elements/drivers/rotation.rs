use crate::elements::joints::{planar_turn, spatial_twist};
use crate::elements::row::Axis::H;
use crate::elements::row::RowKind::{PlanarRotation, Rotation};
use crate::elements::space::Triad;
use crate::elements::{planar, spatial};
use crate::math::TimeFunction;

/// Planar prescribed angle of the second frame from the first, rad.
pub(in crate::elements) fn planar(
    frames: &[Triad<2>; 2],
    motion: TimeFunction,
) -> planar::Constraint {
    planar::Constraint::of_driver(frames, planar_turn(frames), &[PlanarRotation], motion)
}

/// Spatial prescribed twist about h, rad. Its value is the principal angle; whole turns of
/// u − s(t) are dropped by the caller (`Constraint::wraps`), so motions over many turns are smooth.
pub(in crate::elements) fn spatial(
    frames: &[Triad<3>; 2],
    motion: TimeFunction,
) -> spatial::Constraint {
    spatial::Constraint::of_driver(frames, spatial_twist(frames), &[Rotation(H)], motion)
}
