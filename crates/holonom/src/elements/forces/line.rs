//! Length of the line between two points, for the forces along it.

use std::marker::PhantomData;

use crate::elements::body::{Body, Link, Rigid};
use crate::elements::space::Triad;
use crate::elements::{ForceInput, PairBlocks};
use crate::math::Real;
use crate::math::vector::{add_scaled, dot, scaled};

/// The length below which a line counts as vanished, relative to the element's size.
const VANISHING: f64 = 1e-9;

/// The line from a point of the first to a point of the second body, x the link between them.
///
/// ```text
/// l = √(xᵀx + η²),  n = x / l,  δl = nᵀδx,  l̇ = nᵀẋ
/// δl̇ = (ẋ − l̇ n)ᵀδx / l + nᵀδẋ
/// δn = (I − n nᵀ) δx / l
/// ```
///
/// η is 1e-9 of the element's size: nothing at ordinary lengths, and everything stays finite where
/// the points meet. There n = 0: no force acts, and a spring without free length is exactly k x.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Line<S, const D: usize, const N: usize, const W: usize> {
    points: [[f64; D]; 2],
    vanishing_square: f64,
    space: PhantomData<S>,
}

/// A line in one configuration.
pub(super) struct Span<T, const D: usize> {
    pub(super) length: T,
    pub(super) rate: T,
    unit: [T; D],
    speed: [T; D],
    link: Link<T, D>,
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> Line<S, D, N, W> {
    pub(super) fn new(frames: &[Triad<D>; 2], free_length: f64) -> Self {
        let points = [frames[0].point, frames[1].point];
        let arm = |a: &[f64; D]| a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let size = free_length.max(arm(&points[0])).max(arm(&points[1]));
        let vanishing = VANISHING * if size > 0.0 { size } else { 1.0 };
        Self { points, vanishing_square: vanishing * vanishing, space: PhantomData }
    }

    /// l and l̇.
    #[inline(always)]
    pub(super) fn span<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2]) -> Span<T, D> {
        let link = Link::new(&self.points, bodies);
        let length = (dot(&link.x, &link.x) + self.vanishing_square).sqrt();
        let unit = scaled(&link.x, length.recip());
        let speed = link.speed::<S, N, W>(bodies);
        Span { length, rate: dot(&unit, &speed), unit, speed, link }
    }

    /// How fast the direction may turn seen from the first body, rad/s: the speed of the line's end over its length.
    pub(super) fn turning(span: &Span<f64, D>, input: &ForceInput<f64, D, N, W>) -> f64 {
        let carried = S::spin(&input.bodies[0].twist, &span.link.x);
        let square: f64 = span.speed.iter().zip(carried).map(|(s, c)| (s - c) * (s - c)).sum();
        square.sqrt() / span.length
    }

    /// Rows of l̇ on both twists, and of δl on displacements: a pull f has the wrenches −f of them.
    #[inline(always)]
    pub(super) fn rows<T: Real>(span: &Span<T, D>) -> [[T; W]; 2] {
        span.link.rows::<S, N, W>(&span.unit)
    }

    /// Rows of δl̇ on displacements.
    #[inline(always)]
    pub(super) fn rate_rows<T: Real>(
        span: &Span<T, D>,
        bodies: [&Body<T, D, N, W>; 2],
    ) -> [[T; W]; 2] {
        let inverse = span.length.recip();
        let across = std::array::from_fn(|d| (span.speed[d] - span.rate * span.unit[d]) * inverse);
        span.link.rows_at_rest::<S, N, W>(&span.unit, &across, bodies)
    }

    /// What a pull resists with that grows by `slope` with the length.
    #[inline(always)]
    pub(super) fn set_stiffness<T: Real>(
        span: &Span<T, D>,
        pull: T,
        slope: T,
        out: &mut PairBlocks<T, W>,
    ) {
        let across = pull / span.length;
        let along = slope - across;
        let mut m: [[T; D]; D] = [[T::zero(); D]; D];
        for d in 0..D {
            add_scaled(&mut m[d], along * span.unit[d], &span.unit);
            m[d][d] += across;
        }
        span.link.set_stiffness::<S, N, W>(&m, &mut out.0);
        span.link.add_swing::<S, N, W>(&scaled(&span.unit, pull), &mut out.0);
    }
}
