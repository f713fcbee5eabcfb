//! Planar and spatial bodies behind one trait, so that what does not depend on the dimension is
//! written once: D components of a point, N coordinates of a pose, R = N − D of them rotational.

use std::fmt::Debug;

use super::angle::{Angle, LineAngle, PlanarAngle, SpatialAngle};
use super::turning::{SpatialDirection, SpatialRotation, Turning};
use crate::math::{Real, planar, spatial};
use crate::model;

/// How a body vector a (body axes) follows from a pose, with derivatives.
///
/// Source: `docs/theory/elements.md` (2)-(5) and `docs/theory/math.md` (4), (5); B and K after Haug (1989).
pub trait Space<const D: usize, const N: usize, const R: usize>:
    Debug + Clone + Copy + PartialEq + 'static
{
    /// The relative angle of two frames in this space.
    type Angle: Angle<N>;
    /// The direction of the line between two points.
    type Direction: Turning<N>;
    /// The relative orientation of two bodies.
    type Rotation: Turning<N>;

    /// A a.
    fn rotate<T: Real>(q: &[T; N], a: &[T; D]) -> [T; D];
    /// B = (A a)_rot.
    fn slope<T: Real>(q: &[T; N], a: &[T; D]) -> [[T; R]; D];
    /// (B w)_rot with w = rates, of which the rotational part is used.
    fn second<T: Real>(q: &[T; N], w: &[T; N], a: &[T; D]) -> [[T; R]; D];
    /// ((B w)_rot w)_rot; `None` where it vanishes.
    fn third<T: Real>(q: &[T; N], w: &[T; N], a: &[T; D]) -> Option<[[T; R]; D]>;
    /// (Bᵀ c)_rot, symmetric.
    fn bend<T: Real>(q: &[T; N], a: &[T; D], c: &[T; D]) -> [[T; R]; R];
}

/// Coordinates x, y, θ.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planar;

impl Space<2, 3, 1> for Planar {
    type Angle = PlanarAngle;
    type Direction = LineAngle;
    type Rotation = PlanarAngle;

    #[inline(always)]
    fn rotate<T: Real>(q: &[T; 3], a: &[T; 2]) -> [T; 2] {
        planar::rotate(q[2], a)
    }

    #[inline(always)]
    fn slope<T: Real>(q: &[T; 3], a: &[T; 2]) -> [[T; 1]; 2] {
        let [x, y] = planar::quarter_turn(&Self::rotate(q, a));
        [[x], [y]]
    }

    #[inline(always)]
    fn second<T: Real>(q: &[T; 3], w: &[T; 3], a: &[T; 2]) -> [[T; 1]; 2] {
        let [x, y] = Self::rotate(q, a);
        [[-w[2] * x], [-w[2] * y]]
    }

    #[inline(always)]
    fn third<T: Real>(q: &[T; 3], w: &[T; 3], a: &[T; 2]) -> Option<[[T; 1]; 2]> {
        let f = -w[2] * w[2];
        let [[x], [y]] = Self::slope(q, a);
        Some([[f * x], [f * y]])
    }

    #[inline(always)]
    fn bend<T: Real>(q: &[T; 3], a: &[T; 2], c: &[T; 2]) -> [[T; 1]; 1] {
        let turned = Self::rotate(q, a);
        [[-(c[0] * turned[0] + c[1] * turned[1])]]
    }
}

/// Coordinates r and Euler parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Spatial;

/// The Euler parameters of a pose or their rates.
#[inline(always)]
pub(super) fn euler<T: Real>(q: &[T; 7]) -> [T; 4] {
    [q[3], q[4], q[5], q[6]]
}

impl Space<3, 7, 4> for Spatial {
    type Angle = SpatialAngle;
    type Direction = SpatialDirection;
    type Rotation = SpatialRotation;

    #[inline(always)]
    fn rotate<T: Real>(q: &[T; 7], a: &[T; 3]) -> [T; 3] {
        spatial::rotate(&euler(q), a)
    }

    #[inline(always)]
    fn slope<T: Real>(q: &[T; 7], a: &[T; 3]) -> [[T; 4]; 3] {
        spatial::slope(&euler(q), a)
    }

    #[inline(always)]
    fn second<T: Real>(_q: &[T; 7], w: &[T; 7], a: &[T; 3]) -> [[T; 4]; 3] {
        spatial::slope(&euler(w), a)
    }

    #[inline(always)]
    fn third<T: Real>(_q: &[T; 7], _w: &[T; 7], _a: &[T; 3]) -> Option<[[T; 4]; 3]> {
        None
    }

    #[inline(always)]
    fn bend<T: Real>(_q: &[T; 7], a: &[T; 3], c: &[T; 3]) -> [[T; 4]; 4] {
        spatial::bend(a, c)
    }
}

/// A frame of a joint in the kernels: point from the centre of mass, unit axes f, g, (h) in body
/// axes, `axes[k]` the k-th.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Triad<const D: usize> {
    pub(crate) point: [f64; D],
    pub(crate) axes: [[f64; D]; D],
}

/// The first D components.
pub(super) fn leading<const D: usize>(a: &[f64; 3]) -> [f64; D] {
    std::array::from_fn(|k| a[k])
}

/// Both frames of a joint, with points from the centres of mass.
pub(crate) fn triads<const D: usize>(
    frames: &[model::Frame; 2],
    centers: &[[f64; 3]; 2],
) -> [Triad<D>; 2] {
    std::array::from_fn(|side| Triad {
        point: leading(&from_center(&frames[side].point, &centers[side])),
        axes: std::array::from_fn(|k| std::array::from_fn(|row| frames[side].axes[row][k])),
    })
}

pub(super) fn from_center(point: &[f64; 3], center: &[f64; 3]) -> [f64; 3] {
    std::array::from_fn(|k| point[k] - center[k])
}
