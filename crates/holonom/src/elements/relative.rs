//! Relative coordinates of two bodies: scalars of their relative pose that can be independent variables.
//!
//! | kind | value | where it is singular |
//! |---|---|---|
//! | displacement | components of the link d along axes of the first body, m | nowhere |
//! | angle | about an axis; counts turns, rad | nowhere on its joint |
//! | length | \|d\|, m | points coincide |
//! | direction | turn of d from a reference direction, ground axes, rad | half a turn away; points coincide |
//! | rotation | rotation vector of the second body from a reference orientation against the first, axes of the first, rad | a whole turn away |
//!
//! The references of directions and rotations move with the accepted steps; those of angles name the
//! branch. Source: the kernel of `math::turn` and the chain rule.

use super::angle::{Angle, LineAngle, PlanarAngle, SpatialAngle};
use super::measure::{Dot, Measure};
use super::space::{Planar, Space, Spatial, Triad, euler};
use super::vector_function::{Columns, Vector};
use super::{RowBlocks, product};
use crate::math::Real;
use crate::math::spatial::{self, conjugate, cross};
use crate::math::turn::Turn;
use crate::math::vector::{dot, lift};

/// What a relative coordinate is measured from.
///
/// Angle: the branch, rad, in the first entry. Rotation: Euler parameters of the reference orientation.
/// Direction in space: reference unit vector and the first of two normals, ground axes.
pub type Reference = [f64; 6];

/// One to three relative coordinates of the same kind.
#[derive(Debug, Clone, PartialEq)]
pub enum Relative<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> {
    /// Displacements along axes.
    Displacement(Measure<S, D, N, R>),
    /// Angle about an axis.
    Angle(S::Angle),
    /// Distance of two points.
    Length(Measure<S, D, N, R>),
    /// Direction of the line between two points.
    Direction(S::Direction),
    /// Relative orientation.
    Rotation(S::Rotation),
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

/// The services of a direction or rotation, with one to three rows; as
/// [`ConstraintElement`](super::ConstraintElement), with a reference.
pub trait Turning<const N: usize>: std::fmt::Debug + Clone + PartialEq {
    /// Number of coordinates.
    const ROWS: usize;
    /// Largest turn from the reference that is regular, rad; infinite where turns are counted.
    const REACH: f64;

    /// Values.
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
    /// ((G v)_q v)_q.
    fn curvature_gradient<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, N>,
    );
    /// The reference at which the coordinates vanish at q, as near as can be to the old one.
    fn reference(&self, q: [&[f64; N]; 2], old: &Reference) -> Reference;
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Relative<S, D, N, R> {
    /// The length of the line between two points.
    pub(super) fn length(points: [[f64; D]; 2]) -> Self {
        Self::Length(Measure::new(points, false, vec![Dot::square()]))
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
        let over = u[0].recip();
        let first = u[0].sqrt().recip() * 0.5;
        let second = first * over * -0.5;
        [first, second, second * over * -1.5]
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
    /// ((G v)_q v)_q.
    fn curvature_gradient<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, N>,
    );
    /// The reference that suits a pose: directions and rotations vanish there, angles are on the branch of
    /// the old one.
    fn reference(&self, q: [&[f64; N]; 2], old: &Reference) -> Reference;
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

    fn value<T: Real>(&self, q: [&[T; N]; 2], reference: &Reference, u: &mut [T; 6]) {
        match self {
            Self::Displacement(measure) => measure.value(q, u),
            Self::Length(measure) => {
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
            Self::Length(measure) => {
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
            Self::Length(measure) => {
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
            Self::Length(measure) => {
                let [first, second, _] = Self::root(measure, q);
                let rate = product(&row_of(measure, q), v);
                measure.curvature(q, v, out);
                out[0] = out[0] * first + second * rate * rate;
            }
            Self::Angle(angle) => {
                *out = [T::zero(); 6];
                out[0] = angle.curvature(q, v);
            }
            Self::Direction(direction) => direction.curvature(q, v, reference, out),
            Self::Rotation(rotation) => rotation.curvature(q, v, reference, out),
        }
    }

    fn curvature_gradient<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, N>,
    ) {
        match self {
            Self::Displacement(measure) => measure.curvature_gradient(q, v, out),
            Self::Length(measure) => {
                let [first, second, third] = Self::root(measure, q);
                let gradient = row_of(measure, q);
                let rate = product(&gradient, v);
                let (mut bend, mut change) = ([T::zero(); 6], RowBlocks::zero());
                measure.curvature(q, v, &mut bend);
                measure.directional(q, v, &mut change);
                measure.curvature_gradient(q, v, out);
                scale_row(out, first);
                add_row(out, third * rate * rate + second * bend[0], &gradient);
                add_row(out, second * rate * 2.0, &[change.0[0][0], change.0[1][0]]);
            }
            Self::Angle(angle) => {
                *out = RowBlocks::zero();
                out.set(0, &angle.curvature_gradient(q, v));
            }
            Self::Direction(direction) => direction.curvature_gradient(q, v, reference, out),
            Self::Rotation(rotation) => rotation.curvature_gradient(q, v, reference, out),
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
}

fn row_of<T: Real, S: Space<D, N, R>, const D: usize, const N: usize, const R: usize>(
    measure: &Measure<S, D, N, R>,
    q: [&[T; N]; 2],
) -> [[T; N]; 2] {
    let mut rows = RowBlocks::zero();
    measure.jacobian(q, &mut rows);
    [rows.0[0][0], rows.0[1][0]]
}

fn scale_row<T: Real, const N: usize>(rows: &mut RowBlocks<T, N>, factor: T) {
    for side in &mut rows.0 {
        side[0].iter_mut().for_each(|x| *x *= factor);
    }
}

fn add_row<T: Real, const N: usize>(rows: &mut RowBlocks<T, N>, factor: T, row: &[[T; N]; 2]) {
    for (side, row) in rows.0.iter_mut().zip(row) {
        for (x, y) in side[0].iter_mut().zip(row) {
            *x += factor * *y;
        }
    }
}

/// In the plane turns are counted and references name branches only.
macro_rules! counted {
    ($type:ty) => {
        impl Turning<3> for $type {
            const ROWS: usize = 1;
            const REACH: f64 = f64::INFINITY;

            fn value<T: Real>(&self, q: [&[T; 3]; 2], reference: &Reference, u: &mut [T; 6]) {
                *u = [T::zero(); 6];
                u[0] = self.nearest(q, reference[0]);
            }

            fn jacobian<T: Real>(
                &self,
                q: [&[T; 3]; 2],
                _reference: &Reference,
                out: &mut RowBlocks<T, 3>,
            ) {
                *out = RowBlocks::zero();
                out.set(0, &self.gradient(q));
            }

            fn directional<T: Real>(
                &self,
                q: [&[T; 3]; 2],
                w: [&[T; 3]; 2],
                _reference: &Reference,
                out: &mut RowBlocks<T, 3>,
            ) {
                *out = RowBlocks::zero();
                out.set(0, &Angle::directional(self, q, w));
            }

            fn curvature<T: Real>(
                &self,
                q: [&[T; 3]; 2],
                v: [&[T; 3]; 2],
                _reference: &Reference,
                out: &mut [T; 6],
            ) {
                *out = [T::zero(); 6];
                out[0] = Angle::curvature(self, q, v);
            }

            fn curvature_gradient<T: Real>(
                &self,
                q: [&[T; 3]; 2],
                v: [&[T; 3]; 2],
                _reference: &Reference,
                out: &mut RowBlocks<T, 3>,
            ) {
                *out = RowBlocks::zero();
                out.set(0, &Angle::curvature_gradient(self, q, v));
            }

            fn reference(&self, q: [&[f64; 3]; 2], old: &Reference) -> Reference {
                let mut out = [0.0; 6];
                out[0] = self.nearest(q, old[0]);
                out
            }
        }
    };
}

counted!(PlanarAngle);
counted!(LineAngle);

/// θ = t(e), e = p̄ᵢ∘pⱼ∘ē_ref, which is bilinear in the Euler parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialRotation;

impl SpatialRotation {
    #[inline(always)]
    fn relative<T: Real>(first: &[T; 4], second: &[T; 4], reference: &Reference) -> [T; 4] {
        let r: [T; 4] = lift(&[reference[0], reference[1], reference[2], reference[3]]);
        spatial::product(&spatial::product(&conjugate(first), second), &conjugate(&r))
    }

    /// out_k += cₖ · ∂(relative(p_i, p_j))/∂(p_i, p_j) for the rows cₖ.
    #[inline(always)]
    fn add_rows<T: Real>(
        c: &[[T; 4]; 3],
        first: &[T; 4],
        second: &[T; 4],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        for column in 0..4 {
            let mut unit = [T::zero(); 4];
            unit[column] = T::one();
            let by_first = Self::relative(&unit, second, reference);
            let by_second = Self::relative(first, &unit, reference);
            for (k, c) in c.iter().enumerate() {
                out.0[0][k][3 + column] += dot(c, &by_first);
                out.0[1][k][3 + column] += dot(c, &by_second);
            }
        }
    }

    /// Change of e along w.
    #[inline(always)]
    fn rate<T: Real>(q: [&[T; 7]; 2], w: [&[T; 7]; 2], reference: &Reference) -> [T; 4] {
        let ([pi, pj], [wi, wj]) = (q.map(euler), w.map(euler));
        let (a, b) = (Self::relative(&wi, &pj, reference), Self::relative(&pi, &wj, reference));
        std::array::from_fn(|k| a[k] + b[k])
    }

    #[inline(always)]
    fn turn<T: Real>(q: [&[T; 7]; 2], reference: &Reference) -> Turn<T> {
        let [pi, pj] = q.map(euler);
        Turn::new(&Self::relative(&pi, &pj, reference))
    }
}

impl Turning<7> for SpatialRotation {
    const ROWS: usize = 3;
    const REACH: f64 = std::f64::consts::TAU;

    fn value<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, u: &mut [T; 6]) {
        *u = [T::zero(); 6];
        u[..3].copy_from_slice(&Self::turn(q, reference).value());
    }

    fn jacobian<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, out: &mut RowBlocks<T, 7>) {
        *out = RowBlocks::zero();
        let turn = Self::turn(q, reference);
        let [pi, pj] = q.map(euler);
        Self::add_rows(&Turn::matrix(|b| turn.first(b)), &pi, &pj, reference, out);
    }

    fn directional<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        w: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        *out = RowBlocks::zero();
        let turn = Self::turn(q, reference);
        let rate = Self::rate(q, w, reference);
        let ([pi, pj], [wi, wj]) = (q.map(euler), w.map(euler));
        Self::add_rows(&Turn::matrix(|b| turn.second(&rate, b)), &pi, &pj, reference, out);
        Self::add_rows(&Turn::matrix(|b| turn.first(b)), &wi, &wj, reference, out);
    }

    fn curvature<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut [T; 6],
    ) {
        *out = [T::zero(); 6];
        let turn = Self::turn(q, reference);
        let rate = Self::rate(q, v, reference);
        let [vi, vj] = v.map(euler);
        let second = Self::relative(&vi, &vj, reference).map(|x| x * 2.0);
        let (a, b) = (turn.second(&rate, &rate), turn.first(&second));
        for k in 0..3 {
            out[k] = a[k] + b[k];
        }
    }

    fn curvature_gradient<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        *out = RowBlocks::zero();
        let turn = Self::turn(q, reference);
        let rate = Self::rate(q, v, reference);
        let ([pi, pj], [vi, vj]) = (q.map(euler), v.map(euler));
        let second = Self::relative(&vi, &vj, reference).map(|x| x * 2.0);
        let bend = |b: &[T; 4]| {
            let (third, second) = (turn.third(&rate, b), turn.second(&second, b));
            std::array::from_fn(|k| third[k] + second[k])
        };
        Self::add_rows(&Turn::matrix(bend), &pi, &pj, reference, out);
        let twice = |b: &[T; 4]| turn.second(&rate, b).map(|x| x * 2.0);
        Self::add_rows(&Turn::matrix(twice), &vi, &vj, reference, out);
    }

    fn reference(&self, q: [&[f64; 7]; 2], _old: &Reference) -> Reference {
        let [pi, pj] = q.map(euler);
        let e = spatial::product(&conjugate(&pi), &pj);
        let size = dot(&e, &e).sqrt();
        [e[0] / size, e[1] / size, e[2] / size, e[3] / size, 0.0, 0.0]
    }
}

/// ½ t(u₀·d, u₀×d) along two normals of u₀.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialDirection {
    points: [[f64; 3]; 2],
}

impl SpatialDirection {
    pub(super) fn new(points: [[f64; 3]; 2]) -> Self {
        Self { points }
    }

    /// The arguments (u₀·x, u₀×x).
    #[inline(always)]
    fn lifted<T: Real>(x: &[T; 3], reference: &Reference) -> [T; 4] {
        let u: [T; 3] = lift(&[reference[0], reference[1], reference[2]]);
        let n = cross(&u, x);
        [dot(&u, x), n[0], n[1], n[2]]
    }

    /// Both normals of the reference.
    #[inline(always)]
    fn normals<T: Real>(reference: &Reference) -> [[T; 3]; 2] {
        let u = [reference[0], reference[1], reference[2]];
        let b = [reference[3], reference[4], reference[5]];
        [lift(&b), lift(&cross(&u, &b))]
    }

    #[inline(always)]
    fn components<T: Real>(t: &[T; 3], reference: &Reference) -> [T; 2] {
        Self::normals(reference).map(|b: [T; 3]| dot(&b, t) * 0.5)
    }

    /// The rows of a function of t, linear in the arguments, against d: two vectors.
    #[inline(always)]
    fn against_link<T: Real>(matrix: &[[T; 4]; 3], reference: &Reference) -> [[T; 3]; 2] {
        let u: [T; 3] = lift(&[reference[0], reference[1], reference[2]]);
        Self::normals(reference).map(|b: [T; 3]| {
            let w: [T; 4] = std::array::from_fn(|a| {
                (b[0] * matrix[0][a] + b[1] * matrix[1][a] + b[2] * matrix[2][a]) * 0.5
            });
            // w₁₂₃·(u₀×d) = d·(w₁₂₃×u₀)
            let turned = cross(&[w[1], w[2], w[3]], &u);
            std::array::from_fn(|k| w[0] * u[k] + turned[k])
        })
    }

    #[inline(always)]
    fn add_rows<T: Real>(c: &[[T; 3]; 2], columns: &Columns<T, 3, 4>, out: &mut RowBlocks<T, 7>) {
        for (k, c) in c.iter().enumerate() {
            let mut row = [out.0[0][k], out.0[1][k]];
            columns.add_to(c, &mut row);
            out.set(k, &row);
        }
    }
}

impl Turning<7> for SpatialDirection {
    const ROWS: usize = 2;
    const REACH: f64 = std::f64::consts::PI;

    fn value<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, u: &mut [T; 6]) {
        *u = [T::zero(); 6];
        let d = Vector::Link.value::<T, Spatial, 7, 4>(&self.points, q);
        let t = Turn::new(&Self::lifted(&d, reference)).value();
        u[..2].copy_from_slice(&Self::components(&t, reference));
    }

    fn jacobian<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, out: &mut RowBlocks<T, 7>) {
        *out = RowBlocks::zero();
        let link = Vector::Link.jet::<T, Spatial, 7, 4>(&self.points, q);
        let turn = Turn::new(&Self::lifted(&link.x, reference));
        let c = Self::against_link(&Turn::matrix(|b| turn.first(b)), reference);
        Self::add_rows(&c, &link.d, out);
    }

    fn directional<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        w: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        *out = RowBlocks::zero();
        let link = Vector::Link.jet::<T, Spatial, 7, 4>(&self.points, q);
        let second = Vector::Link.second::<T, Spatial, 7, 4>(&self.points, q, w);
        let turn = Turn::new(&Self::lifted(&link.x, reference));
        let rate = Self::lifted(&link.d.times(w), reference);
        let c = Self::against_link(&Turn::matrix(|b| turn.second(&rate, b)), reference);
        Self::add_rows(&c, &link.d, out);
        let c = Self::against_link(&Turn::matrix(|b| turn.first(b)), reference);
        Self::add_rows(&c, &second, out);
    }

    fn curvature<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut [T; 6],
    ) {
        *out = [T::zero(); 6];
        let link = Vector::Link.jet::<T, Spatial, 7, 4>(&self.points, q);
        let second = Vector::Link.second::<T, Spatial, 7, 4>(&self.points, q, v);
        let turn = Turn::new(&Self::lifted(&link.x, reference));
        let rate = Self::lifted(&link.d.times(v), reference);
        let acceleration = Self::lifted(&second.times(v), reference);
        let (a, b) = (turn.second(&rate, &rate), turn.first(&acceleration));
        let t = std::array::from_fn(|k| a[k] + b[k]);
        out[..2].copy_from_slice(&Self::components(&t, reference));
    }

    fn curvature_gradient<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        *out = RowBlocks::zero();
        let link = Vector::Link.jet::<T, Spatial, 7, 4>(&self.points, q);
        let second = Vector::Link.second::<T, Spatial, 7, 4>(&self.points, q, v);
        let third = Vector::Link.third::<T, Spatial, 7, 4>(&self.points, q, v);
        let turn = Turn::new(&Self::lifted(&link.x, reference));
        let rate = Self::lifted(&link.d.times(v), reference);
        let acceleration = Self::lifted(&second.times(v), reference);
        let bend = |b: &[T; 4]| {
            let (third, second) = (turn.third(&rate, b), turn.second(&acceleration, b));
            std::array::from_fn(|k| third[k] + second[k])
        };
        let c = Self::against_link(&Turn::matrix(bend), reference);
        Self::add_rows(&c, &link.d, out);
        let twice = |b: &[T; 4]| turn.second(&rate, b).map(|x| x * 2.0);
        let c = Self::against_link(&Turn::matrix(twice), reference);
        Self::add_rows(&c, &second, out);
        let c = Self::against_link(&Turn::matrix(|b| turn.first(b)), reference);
        Self::add_rows(&c, &third, out);
    }

    /// The old normal is carried along the shortest turn, so that components keep their meaning.
    fn reference(&self, q: [&[f64; 7]; 2], old: &Reference) -> Reference {
        let d = Vector::Link.value::<f64, Spatial, 7, 4>(&self.points, q);
        let size = dot(&d, &d).sqrt().max(f64::MIN_POSITIVE);
        let u = d.map(|x| x / size);
        let before = [old[0], old[1], old[2]];
        let mut b = [old[3], old[4], old[5]];
        if dot(&before, &before) == 0.0 {
            let least = (0..3).fold(0, |k, j| if u[j].abs() < u[k].abs() { j } else { k });
            b = [0.0; 3];
            b[least] = 1.0;
        } else if dot(&before, &u) > -0.5 {
            // R b for the turn from `before` to u: b − (b·u)(before + u)/(1 + before·u).
            let factor = dot(&b, &u) / (1.0 + dot(&before, &u));
            b = std::array::from_fn(|k| b[k] - factor * (before[k] + u[k]));
        }
        let along = dot(&b, &u);
        let b: [f64; 3] = std::array::from_fn(|k| b[k] - along * u[k]);
        let size = dot(&b, &b).sqrt();
        [u[0], u[1], u[2], b[0] / size, b[1] / size, b[2] / size]
    }
}

impl PlanarRelative {
    /// The angle of two frames.
    pub(crate) fn angle(frames: &[Triad<2>; 2]) -> Self {
        Self::Angle(PlanarAngle::new(frames))
    }
}

impl SpatialRelative {
    /// The angle of two frames about h of the first.
    pub(crate) fn angle(frames: &[Triad<3>; 2]) -> Self {
        Self::Angle(SpatialAngle::new(frames))
    }
}

/// Relative coordinates of planar bodies.
pub type PlanarRelative = Relative<Planar, 2, 3, 1>;
/// Relative coordinates of spatial bodies.
pub type SpatialRelative = Relative<Spatial, 3, 7, 4>;
