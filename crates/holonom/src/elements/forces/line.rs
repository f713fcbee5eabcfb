//! Length of the line between two points, for the forces along it.

use std::marker::PhantomData;

use crate::elements::space::{Space, Triad};
use crate::elements::vector_function::{Jet, Vector};
use crate::elements::{ForceInput, PairBlocks};
use crate::math::Real;
use crate::math::vector::{add_scaled, dot};

/// The length below which a line counts as vanished, relative to the element's size.
const VANISHING: f64 = 1e-9;

/// The line from a point of the first to a point of the second body.
///
/// ```text
/// l = √(dᵀd + η²),  n = d / l,  l_q = nᵀD,  l̇ = nᵀ D v,  D = d_q
/// l̇_q  = (D v − l̇ n)ᵀ D / l + nᵀD²[v]
/// l_qq = K_d(n) + Dᵀ (I − n nᵀ) D / l
/// ```
///
/// η is 1e-9 of the element's size: nothing at ordinary lengths, and everything stays finite where
/// the points meet. There n = 0: no force acts, and a spring without free length is exactly k d.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line<S, const D: usize, const N: usize, const R: usize> {
    points: [[f64; D]; 2],
    vanishing_square: f64,
    space: PhantomData<S>,
}

/// A line in one configuration.
pub(super) struct Span<T, const D: usize, const R: usize> {
    pub(super) length: T,
    pub(super) rate: T,
    unit: [T; D],
    speed: [T; D],
    link: Jet<T, D, R>,
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Line<S, D, N, R> {
    pub(super) fn new(frames: &[Triad<D>; 2], free_length: f64) -> Self {
        let points = [frames[0].point, frames[1].point];
        let arm = |a: &[f64; D]| a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let size = free_length.max(arm(&points[0])).max(arm(&points[1]));
        let vanishing = VANISHING * if size > 0.0 { size } else { 1.0 };
        Self { points, vanishing_square: vanishing * vanishing, space: PhantomData }
    }

    /// l and l̇ in one pose.
    #[inline(always)]
    pub(super) fn span<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2]) -> Span<T, D, R> {
        let link = Vector::Link.jet::<T, S, N, R>(&self.points, q);
        let length = (dot(&link.x, &link.x) + self.vanishing_square).sqrt();
        let inverse = length.recip();
        let unit = link.x.map(|x| x * inverse);
        let speed = link.d.times(v);
        Span { length, rate: dot(&unit, &speed), unit, speed, link }
    }

    /// How fast the direction may turn seen from the first body, rad/s: the speed of the line's end over its length.
    pub(super) fn turning(span: &Span<f64, D, R>, input: &ForceInput<'_, f64, N>) -> f64 {
        let carried = S::spin(input.q[0], input.v[0], &span.link.x);
        let square: f64 = span.speed.iter().zip(carried).map(|(s, c)| (s - c) * (s - c)).sum();
        square.sqrt() / span.length
    }

    /// l̇_q.
    #[inline(always)]
    pub(super) fn rate_gradient<T: Real>(
        &self,
        span: &Span<T, D, R>,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
    ) -> [[T; N]; 2] {
        let inverse = span.length.recip();
        let across = std::array::from_fn(|d| (span.speed[d] - span.rate * span.unit[d]) * inverse);
        let mut row = span.link.d.transposed_times(&across);
        let second = Vector::Link.second::<T, S, N, R>(&self.points, q, v);
        second.add_to(&span.unit, &mut row);
        row
    }

    /// out += force · l_qq + slope · l_qᵀ l_q.
    #[inline(always)]
    pub(super) fn add_stiffness<T: Real>(
        &self,
        span: &Span<T, D, R>,
        q: [&[T; N]; 2],
        force: T,
        slope: T,
        out: &mut PairBlocks<T, N>,
    ) {
        let across = force / span.length;
        let along = slope - across;
        let mut m: [[T; D]; D] = [[T::zero(); D]; D];
        for d in 0..D {
            add_scaled(&mut m[d], along * span.unit[d], &span.unit);
            m[d][d] += across;
        }
        span.link.d.add_quadratic(&m, out);
        let c = span.unit.map(|x| x * force);
        Vector::Link.add_bend::<T, S, N, R>(&self.points, q, &c, out);
    }
}

impl<T: Real, const D: usize, const R: usize> Span<T, D, R> {
    /// l_q.
    #[inline(always)]
    pub(super) fn gradient<const N: usize>(&self) -> [[T; N]; 2] {
        self.link.d.transposed_times(&self.unit)
    }
}
