//! Relative coordinates of two bodies: scalars of their relative pose that can be independent variables.
//!
//! | kind | value | where it is singular |
//! |---|---|---|
//! | displacement | components of the link d along axes of the first body, m | nowhere |
//! | angle | about an axis; counts turns, rad | nowhere on its joint |
//! | length | \|d\|, m | points coincide |
//! | direction | turn of d from a reference direction, ground axes, rad | half a turn away; points coincide |
//! | rotation | rotation vector of the second body from a reference orientation against the first, axes of the first, of a bushing its own on it, rad | a whole turn away |
//!
//! The references of directions and rotations move with the accepted steps; those of angles name the
//! branch. Source: the kernel of `math::turn` and the chain rule.

use super::angle::{Angle, PlanarAngle, SpatialAngle};
use super::measure::{Dot, Measure};
use super::motion::{Link, Motion, MotionRows, Stance, Varied, Wrench};
use super::space::{Planar, Space, Spatial, Triad};
pub use super::turning::Reference;
use super::turning::Turning;
use super::{RowBlocks, product, set_first};
use crate::math::Real;
use crate::math::vector::{dot, scaled};

/// One to three relative coordinates of the same kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Relative<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> {
    /// Displacements along axes.
    Displacement(Measure<S, D, N, R>),
    /// Angle about an axis.
    Angle(S::Angle),
    /// Distance of two points.
    Length(Length<S, D, N, R>),
    /// Direction of the line between two points.
    Direction(S::Direction),
    /// Relative orientation.
    Rotation(S::Rotation),
}

/// √u of the square u = dᵀd of a link.
#[derive(Debug, Clone, PartialEq)]
pub struct Length<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize>(
    Measure<S, D, N, R>,
);

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> MotionRows
    for Length<S, D, N, R>
{
    fn value_at(&self, bodies: [&Stance; 2], u: &mut [f64; 6]) {
        let Link { x, .. } = self.0.link_at(bodies);
        u[0] = dot(&x, &x).sqrt();
    }

    fn wrenches(&self, bodies: [&Stance; 2], out: &mut [[Wrench; 2]; 6]) {
        let link = self.0.link_at(bodies);
        out[0] = [[[0.0; 3]; 2]; 2];
        let inverse = dot(&link.x, &link.x).sqrt().recip();
        link.add_wrenches(&scaled(&link.x, inverse), &mut out[0]);
    }

    fn rate_changes(&self, bodies: [&Stance; 2], motions: [&Motion; 2], u: &mut [f64; 6]) {
        let Varied { x, rate, moved, change } = self.0.link_at(bodies).carried(motions);
        let inverse = dot(&x, &x).sqrt().recip();
        let along = dot(&x, &rate) * inverse * dot(&x, &moved) * inverse;
        u[0] = (dot(&x, &change) + dot(&rate, &moved) - along) * inverse;
    }
}

/// Kinds of relative coordinates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RelativeKind {
    /// m, linear in the link.
    Displacement,
    /// rad, any number of turns.
    Angle,
    /// m.
    Length,
    /// rad, from a reference.
    Direction,
    /// rad, from a reference.
    Rotation,
}

impl RelativeKind {
    /// Whether the coordinate is an angle.
    pub fn turns(self) -> bool {
        !matches!(self, Self::Displacement | Self::Length)
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Relative<S, D, N, R> {
    /// The length of the line between two points.
    pub(super) fn length(points: [[f64; D]; 2]) -> Self {
        Self::Length(Length(Measure::new(points, false, vec![Dot::square()])))
    }

    /// Components of the link along axes of the first body.
    pub(super) fn link(points: [[f64; D]; 2], axes: &[[f64; D]]) -> Self {
        let dots = axes.iter().map(|axis| Dot::along(*axis)).collect();
        Self::Displacement(Measure::new(points, false, dots))
    }

    /// First three derivatives of √s at the measure s.
    fn root<T: Real>(measure: &Measure<S, D, N, R>, q: [&[T; N]; 2]) -> [T; 3] {
        let mut u = [T::zero(); 6];
        measure.value(q, &mut u);
        root_derivatives(u[0])
    }
}

/// Services of relative coordinates; as [`ConstraintElement`](super::ConstraintElement), with a reference.
pub trait RelativeElement<const N: usize> {
    /// What they are.
    fn kind(&self) -> RelativeKind;
    /// Number of coordinates.
    fn rows(&self) -> usize;
    /// Largest turn from the reference, rad, before the coordinates become singular; infinite where
    /// they do not.
    fn reach(&self) -> f64;
    /// Whether a rotation is along other axes than those of the first body.
    fn has_own_axes(&self) -> bool;
    /// Values; angles on the branch of the reference.
    fn value<T: Real>(&self, q: [&[T; N]; 2], reference: &Reference, u: &mut [T; 6]);
    /// G.
    fn jacobian<T: Real>(&self, q: [&[T; N]; 2], reference: &Reference, out: &mut RowBlocks<T, N>);
    /// (G w)_q.
    fn directional<T: Real>(
        &self,
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, N>,
    );
    /// (G v)_q v.
    fn curvature<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        reference: &Reference,
        out: &mut [T; 6],
    );
    /// (G v)_q, and (G a)_q + ((G v)_q v)_q.
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        reference: &Reference,
        out: &mut [RowBlocks<T, N>; 2],
    );
    /// The reference that suits a pose: directions and rotations vanish there, angles are on the branch of
    /// the old one.
    fn reference(&self, q: [&[f64; N]; 2], old: &Reference) -> Reference;
    /// The values from how the bodies stand and move: displacements and lengths, which know no reference.
    fn on_motions(&self) -> Option<&dyn MotionRows>;
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> RelativeElement<N>
    for Relative<S, D, N, R>
{
    fn kind(&self) -> RelativeKind {
        match self {
            Self::Displacement(_) => RelativeKind::Displacement,
            Self::Angle(_) => RelativeKind::Angle,
            Self::Length(_) => RelativeKind::Length,
            Self::Direction(_) => RelativeKind::Direction,
            Self::Rotation(_) => RelativeKind::Rotation,
        }
    }

    fn rows(&self) -> usize {
        match self {
            Self::Displacement(measure) => measure.rows(),
            Self::Angle(_) | Self::Length(_) => 1,
            Self::Direction(_) => S::Direction::ROWS,
            Self::Rotation(_) => S::Rotation::ROWS,
        }
    }

    fn reach(&self) -> f64 {
        match self {
            Self::Direction(_) => S::Direction::REACH,
            Self::Rotation(_) => S::Rotation::REACH,
            _ => f64::INFINITY,
        }
    }

    fn has_own_axes(&self) -> bool {
        matches!(self, Self::Rotation(rotation) if rotation.has_own_axes())
    }

    fn value<T: Real>(&self, q: [&[T; N]; 2], reference: &Reference, u: &mut [T; 6]) {
        match self {
            Self::Displacement(measure) => measure.value(q, u),
            Self::Length(Length(measure)) => {
                measure.value(q, u);
                u[0] = u[0].sqrt();
            }
            Self::Angle(angle) => {
                *u = [T::zero(); 6];
                u[0] = angle.nearest(q, reference[0]);
            }
            Self::Direction(direction) => direction.value(q, reference, u),
            Self::Rotation(rotation) => rotation.value(q, reference, u),
        }
    }

    fn jacobian<T: Real>(&self, q: [&[T; N]; 2], reference: &Reference, out: &mut RowBlocks<T, N>) {
        match self {
            Self::Displacement(measure) => measure.jacobian(q, out),
            Self::Length(Length(measure)) => {
                let [first, ..] = Self::root(measure, q);
                measure.jacobian(q, out);
                scale_row(out, first);
            }
            Self::Angle(angle) => {
                *out = RowBlocks::zero();
                out.set(0, &angle.gradient(q));
            }
            Self::Direction(direction) => direction.jacobian(q, reference, out),
            Self::Rotation(rotation) => rotation.jacobian(q, reference, out),
        }
    }

    fn directional<T: Real>(
        &self,
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, N>,
    ) {
        match self {
            Self::Displacement(measure) => measure.directional(q, w, out),
            Self::Length(Length(measure)) => {
                let [first, second, _] = Self::root(measure, q);
                let gradient = row_of(measure, q);
                measure.directional(q, w, out);
                scale_row(out, first);
                add_row(out, second * product(&gradient, w), &gradient);
            }
            Self::Angle(angle) => {
                *out = RowBlocks::zero();
                out.set(0, &angle.directional(q, w));
            }
            Self::Direction(direction) => direction.directional(q, w, reference, out),
            Self::Rotation(rotation) => rotation.directional(q, w, reference, out),
        }
    }

    fn curvature<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        reference: &Reference,
        out: &mut [T; 6],
    ) {
        match self {
            Self::Displacement(measure) => measure.curvature(q, v, out),
            Self::Length(Length(measure)) => {
                let [first, second, _] = Self::root(measure, q);
                let mut rate = [T::zero(); 6];
                measure.rate(q, v, &mut rate);
                measure.curvature(q, v, out);
                out[0] = out[0] * first + second * rate[0] * rate[0];
            }
            Self::Angle(angle) => {
                *out = [T::zero(); 6];
                out[0] = angle.curvature(q, v);
            }
            Self::Direction(direction) => direction.curvature(q, v, reference, out),
            Self::Rotation(rotation) => rotation.curvature(q, v, reference, out),
        }
    }

    #[inline(always)]
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        reference: &Reference,
        out: &mut [RowBlocks<T, N>; 2],
    ) {
        match self {
            Self::Displacement(measure) => {
                measure.rate_blocks(q, v, a, out);
            }
            Self::Length(Length(measure)) => {
                let mut rows = [RowBlocks::zero(); 3];
                let u = measure.rate_blocks(q, v, a, &mut rows);
                let [first, second, third] = root_derivatives(u[0]);
                let gradient = rows[2].0.map(|rows| rows[0]);
                *out = [rows[0], rows[1]];
                let (rate, along) = (product(&gradient, v), product(&gradient, a));
                let change = [out[0].0[0][0], out[0].0[1][0]];
                let bend = product(&change, v) + along;
                out.iter_mut().for_each(|rows| scale_row(rows, first));
                add_row(&mut out[0], second * rate, &gradient);
                add_row(&mut out[1], third * rate * rate + second * bend, &gradient);
                add_row(&mut out[1], second * rate * 2.0, &change);
            }
            Self::Angle(angle) => set_first(&angle.rate_blocks(q, v, a), out),
            Self::Direction(direction) => direction.rate_blocks(q, v, a, reference, out),
            Self::Rotation(rotation) => rotation.rate_blocks(q, v, a, reference, out),
        }
    }

    fn reference(&self, q: [&[f64; N]; 2], old: &Reference) -> Reference {
        match self {
            Self::Displacement(_) | Self::Length(_) => *old,
            Self::Angle(angle) => {
                let mut out = [0.0; 6];
                out[0] = angle.nearest(q, old[0]);
                out
            }
            Self::Direction(direction) => direction.reference(q, old),
            Self::Rotation(rotation) => rotation.reference(q, old),
        }
    }

    fn on_motions(&self) -> Option<&dyn MotionRows> {
        match self {
            Self::Displacement(measure) => Some(measure),
            Self::Length(length) => Some(length),
            _ => None,
        }
    }
}

/// First three derivatives of √s.
#[inline(always)]
fn root_derivatives<T: Real>(s: T) -> [T; 3] {
    let over = s.recip();
    let first = s.sqrt().recip() * 0.5;
    let second = first * over * -0.5;
    [first, second, second * over * -1.5]
}

fn row_of<T: Real, S: Space<D, N, R>, const D: usize, const N: usize, const R: usize>(
    measure: &Measure<S, D, N, R>,
    q: [&[T; N]; 2],
) -> [[T; N]; 2] {
    let mut rows = RowBlocks::zero();
    measure.jacobian(q, &mut rows);
    [rows.0[0][0], rows.0[1][0]]
}

#[inline(always)]
fn scale_row<T: Real, const N: usize>(rows: &mut RowBlocks<T, N>, factor: T) {
    for side in &mut rows.0 {
        side[0].iter_mut().for_each(|x| *x *= factor);
    }
}

#[inline(always)]
fn add_row<T: Real, const N: usize>(rows: &mut RowBlocks<T, N>, factor: T, row: &[[T; N]; 2]) {
    for (side, row) in rows.0.iter_mut().zip(row) {
        for (x, y) in side[0].iter_mut().zip(row) {
            *x += factor * *y;
        }
    }
}

impl PlanarRelative {
    /// The angle of two frames.
    pub(crate) fn angle(frames: &[Triad<2>; 2]) -> Self {
        Self::Angle(PlanarAngle::new(frames))
    }
}

impl SpatialRelative {
    /// The twist of two frames about h, the deformation of a rotational spring.
    pub(crate) fn angle(frames: &[Triad<3>; 2]) -> Self {
        Self::Angle(SpatialAngle::twist(frames))
    }
}

/// Relative coordinates of planar bodies.
pub type PlanarRelative = Relative<Planar, 2, 3, 1>;
/// Relative coordinates of spatial bodies.
pub type SpatialRelative = Relative<Spatial, 3, 7, 4>;
