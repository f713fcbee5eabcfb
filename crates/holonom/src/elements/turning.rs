//! Directions and rotations with their references: the relative coordinates that turn.
//!
//! A direction is the turn of the line between two points from a reference direction, in ground axes; a rotation the
//! rotation vector of the second body from a reference orientation against the first. In the plane both are angles that
//! count turns. Source: the kernel of `math::turn` and the chain rule.

use super::angle::{Angle, LineAngle, PlanarAngle};
use super::space::{Spatial, euler};
use super::vector_function::{Columns, Moved, Vector};
use super::{RowBlocks, set_first};
use crate::math::Real;
use crate::math::spatial::{self, conjugate, cross};
use crate::math::turn::Turn;
use crate::math::vector::{dot, lift};

/// What a relative coordinate is measured from.
///
/// Angle: the branch, rad, in the first entry. Rotation: Euler parameters of the reference orientation.
/// Direction in space: reference unit vector and the first of two normals, ground axes.
pub type Reference = [f64; 6];

/// The services of a direction or rotation, with one to three rows; as
/// [`ConstraintElement`](super::ConstraintElement), with a reference.
pub trait Turning<const N: usize>: std::fmt::Debug + Clone + PartialEq {
    /// Number of coordinates.
    const ROWS: usize;
    /// Largest turn from the reference that is regular, rad; infinite where turns are counted.
    const REACH: f64;

    /// Whether they are along other axes than those of the first body.
    fn has_own_axes(&self) -> bool {
        false
    }
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
    /// (G v)_q, and (G a)_q + ((G v)_q v)_q.
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        reference: &Reference,
        out: &mut [RowBlocks<T, N>; 2],
    );
    /// The reference at which the coordinates vanish at q, as near as can be to the old one.
    fn reference(&self, q: [&[f64; N]; 2], old: &Reference) -> Reference;
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

            fn rate_blocks<T: Real>(
                &self,
                q: [&[T; 3]; 2],
                v: [&[T; 3]; 2],
                a: [&[T; 3]; 2],
                _reference: &Reference,
                out: &mut [RowBlocks<T, 3>; 2],
            ) {
                set_first(&Angle::rate_blocks(self, q, v, a), out);
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

/// θ = t(e), e = ā∘p̄ᵢ∘pⱼ∘ē_ref with constant a, which is bilinear in the Euler parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialRotation {
    /// How the axes of θ are turned in the first body; none where they are its own.
    axes: Option<[f64; 4]>,
}

impl SpatialRotation {
    /// Along the axes of the first body.
    pub(super) fn new() -> Self {
        Self { axes: None }
    }

    /// Along these axes of the first body, orthonormal.
    pub(super) fn along(axes: &[[f64; 3]; 3]) -> Self {
        let columns = std::array::from_fn(|i| std::array::from_fn(|j| axes[j][i]));
        let axes = spatial::euler_parameters(&columns);
        Self { axes: Some(axes).filter(|axes| axes[1..] != [0.0; 3]) }
    }

    /// pᵢ∘a and pⱼ.
    #[inline(always)]
    fn pair<T: Real>(&self, q: [&[T; 7]; 2]) -> [[T; 4]; 2] {
        let [first, second] = q.map(euler);
        [self.axes.map_or(first, |a| spatial::product(&first, &lift(&a))), second]
    }

    #[inline(always)]
    fn relative<T: Real>(first: &[T; 4], second: &[T; 4], reference: &Reference) -> [T; 4] {
        let r: [T; 4] = lift(&[reference[0], reference[1], reference[2], reference[3]]);
        spatial::product(&spatial::product(&conjugate(first), second), &conjugate(&r))
    }

    /// ∂(relative(p_i∘a, p_j))/∂(p_i, p_j), by bodies and their Euler parameters.
    #[inline(always)]
    fn slopes<T: Real>(
        &self,
        [first, second]: [&[T; 4]; 2],
        reference: &Reference,
    ) -> [[[T; 4]; 4]; 2] {
        let back: [T; 4] = lift(&[reference[0], -reference[1], -reference[2], -reference[3]]);
        // ū∘s and l∘u for the four units u.
        let [s0, s1, s2, s3] = spatial::product(second, &back);
        let mut by_first =
            [[s0, s1, s2, s3], [s1, -s0, s3, -s2], [s2, -s3, -s0, s1], [s3, s2, -s1, -s0]];
        if let Some(a) = self.axes {
            let turned = conjugate(&lift(&a));
            by_first = by_first.map(|slope| spatial::product(&turned, &slope));
        }
        let [l0, l1, l2, l3] = conjugate(first);
        let turned = [[l0, l1, l2, l3], [-l1, l0, l3, -l2], [-l2, -l3, l0, l1], [-l3, l2, -l1, l0]];
        let mut by_second = turned;
        for (slope, turned) in by_second.iter_mut().zip(&turned) {
            *slope = spatial::product(turned, &back);
        }
        [by_first, by_second]
    }

    /// out_k += cₖ · slopes for the rows cₖ.
    #[inline(always)]
    fn add_rows<T: Real>(c: &[[T; 4]; 3], slopes: &[[[T; 4]; 4]; 2], out: &mut RowBlocks<T, 7>) {
        for (rows, slopes) in out.0.iter_mut().zip(slopes) {
            for (row, c) in rows.iter_mut().zip(c) {
                for (out, slope) in row[3..].iter_mut().zip(slopes) {
                    *out += dot(c, slope);
                }
            }
        }
    }

    /// Change of e along w.
    #[inline(always)]
    fn rate<T: Real>(&self, q: [&[T; 7]; 2], w: [&[T; 7]; 2], reference: &Reference) -> [T; 4] {
        let ([pi, pj], [wi, wj]) = (self.pair(q), self.pair(w));
        let (a, b) = (Self::relative(&wi, &pj, reference), Self::relative(&pi, &wj, reference));
        std::array::from_fn(|k| a[k] + b[k])
    }

    #[inline(always)]
    fn turn<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference) -> Turn<T> {
        let [pi, pj] = self.pair(q);
        Turn::new(&Self::relative(&pi, &pj, reference))
    }
}

impl Turning<7> for SpatialRotation {
    const ROWS: usize = 3;
    const REACH: f64 = std::f64::consts::TAU;

    fn has_own_axes(&self) -> bool {
        self.axes.is_some()
    }

    fn value<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, u: &mut [T; 6]) {
        *u = [T::zero(); 6];
        u[..3].copy_from_slice(&self.turn(q, reference).value());
    }

    fn jacobian<T: Real>(&self, q: [&[T; 7]; 2], reference: &Reference, out: &mut RowBlocks<T, 7>) {
        *out = RowBlocks::zero();
        let turn = self.turn(q, reference);
        let [pi, pj] = self.pair(q);
        let slopes = self.slopes([&pi, &pj], reference);
        Self::add_rows(&turn.first_matrix(), &slopes, out);
    }

    fn directional<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        w: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut RowBlocks<T, 7>,
    ) {
        *out = RowBlocks::zero();
        let turn = self.turn(q, reference);
        let rate = self.rate(q, w, reference);
        let ([pi, pj], [wi, wj]) = (self.pair(q), self.pair(w));
        let slopes = self.slopes([&pi, &pj], reference);
        Self::add_rows(&turn.second_matrix(&rate), &slopes, out);
        let slopes = self.slopes([&wi, &wj], reference);
        Self::add_rows(&turn.first_matrix(), &slopes, out);
    }

    fn curvature<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut [T; 6],
    ) {
        *out = [T::zero(); 6];
        let turn = self.turn(q, reference);
        let rate = self.rate(q, v, reference);
        let [vi, vj] = self.pair(v);
        let second = Self::relative(&vi, &vj, reference).map(|x| x * 2.0);
        let (a, b) = (turn.second(&rate, &rate), turn.first(&second));
        for k in 0..3 {
            out[k] = a[k] + b[k];
        }
    }

    #[inline(always)]
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        a: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut [RowBlocks<T, 7>; 2],
    ) {
        *out = [RowBlocks::zero(); 2];
        let [of_v, of_a] = out;
        let turn = self.turn(q, reference);
        let (rate, along) = (self.rate(q, v, reference), self.rate(q, a, reference));
        let ([pi, pj], [vi, vj], [ai, aj]) = (self.pair(q), self.pair(v), self.pair(a));
        let bent = Self::relative(&vi, &vj, reference);
        let second: [T; 4] = std::array::from_fn(|k| bent[k] * 2.0 + along[k]);
        let (mut bend, other) = (turn.third_matrix(&rate), turn.second_matrix(&second));
        for (bend, other) in bend.iter_mut().zip(&other) {
            bend.iter_mut().zip(other).for_each(|(x, y)| *x += *y);
        }
        let first = turn.first_matrix();
        let mut change = turn.second_matrix(&rate);
        let slopes = self.slopes([&pi, &pj], reference);
        Self::add_rows(&change, &slopes, of_v);
        Self::add_rows(&bend, &slopes, of_a);
        let slopes = self.slopes([&vi, &vj], reference);
        Self::add_rows(&first, &slopes, of_v);
        change.as_flattened_mut().iter_mut().for_each(|x| *x *= 2.0);
        Self::add_rows(&change, &slopes, of_a);
        Self::add_rows(&first, &self.slopes([&ai, &aj], reference), of_a);
    }

    fn reference(&self, q: [&[f64; 7]; 2], _old: &Reference) -> Reference {
        let [pi, pj] = self.pair(q);
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
        let c = Self::against_link(&turn.first_matrix(), reference);
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
        let c = Self::against_link(&turn.second_matrix(&rate), reference);
        Self::add_rows(&c, &link.d, out);
        let c = Self::against_link(&turn.first_matrix(), reference);
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

    #[inline(always)]
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; 7]; 2],
        v: [&[T; 7]; 2],
        a: [&[T; 7]; 2],
        reference: &Reference,
        out: &mut [RowBlocks<T, 7>; 2],
    ) {
        *out = [RowBlocks::zero(); 2];
        let [of_v, of_a] = out;
        let Moved { x: [x, x1, x2], d: [d, by_v, by_a] } =
            Vector::Link.moved::<T, Spatial, 7, 4>(&self.points, q, v, a);
        let turn = Turn::new(&Self::lifted(&x, reference));
        let (rate, acceleration) = (Self::lifted(&x1, reference), Self::lifted(&x2, reference));
        let (mut bend, other) = (turn.third_matrix(&rate), turn.second_matrix(&acceleration));
        for (bend, other) in bend.iter_mut().zip(&other) {
            bend.iter_mut().zip(other).for_each(|(x, y)| *x += *y);
        }
        let first = Self::against_link(&turn.first_matrix(), reference);
        let change = Self::against_link(&turn.second_matrix(&rate), reference);
        Self::add_rows(&change, &d, of_v);
        Self::add_rows(&first, &by_v, of_v);
        Self::add_rows(&Self::against_link(&bend, reference), &d, of_a);
        Self::add_rows(&change.map(|row| row.map(|x| x * 2.0)), &by_v, of_a);
        Self::add_rows(&first, &by_a, of_a);
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
