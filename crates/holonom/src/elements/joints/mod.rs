//! One file per kind of joint: its rows as basic measures of the two frames, with their names.
//!
//! f, g, h are the axes of a frame, d the vector from the first to the second point; i is the first
//! body, j the second. Rows are second minus first and independent where the joint is assembled.

pub(super) mod cylindrical;
pub(super) mod distance;
pub(super) mod fixed;
pub(super) mod revolute;
pub(super) mod spherical;
pub(super) mod translational;
pub(super) mod universal;

use super::angle::{PlanarAngle, SpatialAngle};
use super::constraint::Coordinate;
use super::measure::{Dot, Measure};
use super::space::{Planar, Spatial, Triad};

type SpatialMeasure = Measure<Spatial, 3, 7, 4>;
type PlanarMeasure = Measure<Planar, 2, 3, 1>;

fn points<const D: usize>(frames: &[Triad<D>; 2]) -> [[f64; D]; 2] {
    [frames[0].point, frames[1].point]
}

/// Displacement along h of the first frame.
pub(super) fn spatial_slide(frames: &[Triad<3>; 2]) -> Coordinate<Spatial, 3, 7, 4> {
    let along = Dot::along(frames[0].axes[2]);
    Coordinate::Displacement(Measure::new(points(frames), false, vec![along]))
}

/// Displacement along f of the first frame.
pub(super) fn planar_slide(frames: &[Triad<2>; 2]) -> Coordinate<Planar, 2, 3, 1> {
    let along = Dot::along(frames[0].axes[0]);
    Coordinate::Displacement(Measure::new(points(frames), false, vec![along]))
}

/// Angle about h of two frames that share it.
pub(super) fn spatial_turn(frames: &[Triad<3>; 2]) -> Coordinate<Spatial, 3, 7, 4> {
    Coordinate::Angle(SpatialAngle::new(frames))
}

/// Twist about h of two frames that need not share it.
pub(super) fn spatial_twist(frames: &[Triad<3>; 2]) -> Coordinate<Spatial, 3, 7, 4> {
    Coordinate::Angle(SpatialAngle::twist(frames))
}

/// Angle in the plane.
pub(super) fn planar_turn(frames: &[Triad<2>; 2]) -> Coordinate<Planar, 2, 3, 1> {
    Coordinate::Angle(PlanarAngle::new(frames))
}
