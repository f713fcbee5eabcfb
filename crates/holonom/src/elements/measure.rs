//! Rows of joints composed of basic measures: d = 0 (linear) and xᵀy = c (bilinear), with all their
//! derivative blocks.
//!
//! With x₁ = D_x v, x₂ = D²_x\[v] v, and the same for y, the bilinear row u = xᵀy has
//!
//! ```text
//! G             = xᵀD_y + yᵀD_x                      G v = xᵀy₁ + yᵀx₁
//! (G w)_q       = xᵀD²_y[w] + yᵀD²_x[w] + (D_y w)ᵀD_x + (D_x w)ᵀD_y
//! (G v)_q v     = xᵀy₂ + yᵀx₂ + 2 x₁ᵀy₁
//! ((G v)_q v)_q = y₂ᵀD_x + x₂ᵀD_y + 2 y₁ᵀD²_x[v] + 2 x₁ᵀD²_y[v] + xᵀD³_y[v] + yᵀD³_x[v]
//! H             = K_x(y) + K_y(x) + D_xᵀD_y + D_yᵀD_x
//! ```
//!
//! Source: basic constraints after E. J. Haug, *Computer Aided Kinematics and Dynamics of
//! Mechanical Systems* (1989), 3.2 and 9.4; derivatives by the product rule.

use std::marker::PhantomData;

use super::space::Space;
use super::vector_function::{Jet, Vector};
use super::{PairBlocks, RowBlocks};
use crate::math::Real;
use crate::math::vector::{dot, scaled};

/// One row u = scale (xᵀy − offset).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Dot<const D: usize> {
    pub(super) x: Vector<D>,
    pub(super) y: Vector<D>,
    pub(super) scale: f64,
    pub(super) offset: f64,
}

impl<const D: usize> Dot<D> {
    /// a_iᵀ a_j.
    pub(super) fn axes(first: [f64; D], second: [f64; D]) -> Self {
        Self { x: Vector::First(first), y: Vector::Second(second), scale: 1.0, offset: 0.0 }
    }

    /// a_iᵀ d.
    pub(super) fn along(first: [f64; D]) -> Self {
        Self { x: Vector::First(first), y: Vector::Link, scale: 1.0, offset: 0.0 }
    }

    /// dᵀd.
    pub(super) fn square() -> Self {
        Self { x: Vector::Link, y: Vector::Link, scale: 1.0, offset: 0.0 }
    }

    /// (dᵀd − length²) / (2 length).
    pub(super) fn distance(length: f64) -> Self {
        let scale = 0.5 / length;
        Self { x: Vector::Link, y: Vector::Link, scale, offset: length * length }
    }
}

/// Rows between two bodies: first d = 0 (D rows) if the points coincide, then the dot products.
#[derive(Debug, Clone, PartialEq)]
pub struct Measure<S, const D: usize, const N: usize, const R: usize> {
    pub(super) points: [[f64; D]; 2],
    pub(super) coincide: bool,
    pub(super) dots: Vec<Dot<D>>,
    pub(super) uses_link: bool,
    space: PhantomData<S>,
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Measure<S, D, N, R> {
    pub(super) fn new(points: [[f64; D]; 2], coincide: bool, dots: Vec<Dot<D>>) -> Self {
        let uses_link =
            coincide || dots.iter().any(|dot| dot.x == Vector::Link || dot.y == Vector::Link);
        Self { points, coincide, dots, uses_link, space: PhantomData }
    }

    pub(super) fn rows(&self) -> usize {
        self.first_dot() + self.dots.len()
    }

    pub(super) fn first_dot(&self) -> usize {
        if self.coincide { D } else { 0 }
    }

    #[inline(always)]
    fn link<T: Real>(&self, q: [&[T; N]; 2]) -> Option<Jet<T, D, R>> {
        self.uses_link.then(|| Vector::Link.jet::<T, S, N, R>(&self.points, q))
    }

    /// Value and derivative of a vector function; the link's are computed once per call.
    #[inline(always)]
    fn jet<T: Real>(
        &self,
        x: &Vector<D>,
        q: [&[T; N]; 2],
        link: Option<&Jet<T, D, R>>,
    ) -> Jet<T, D, R> {
        match (x, link) {
            (Vector::Link, Some(jet)) => *jet,
            _ => x.jet::<T, S, N, R>(&self.points, q),
        }
    }

    #[inline(always)]
    pub(super) fn value<T: Real>(&self, q: [&[T; N]; 2], u: &mut [T; 6]) {
        *u = [T::zero(); 6];
        let link = if self.uses_link {
            Vector::Link.value::<T, S, N, R>(&self.points, q)
        } else {
            [T::zero(); D]
        };
        if self.coincide {
            u[..D].copy_from_slice(&link);
        }
        let pick = |x: &Vector<D>| match x {
            Vector::Link => link,
            _ => x.value::<T, S, N, R>(&self.points, q),
        };
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            u[row] = (dot(&pick(&d.x), &pick(&d.y)) - d.offset) * d.scale;
        }
    }

    #[inline(always)]
    pub(super) fn jacobian<T: Real>(&self, q: [&[T; N]; 2], out: &mut RowBlocks<T, N>) {
        *out = RowBlocks::zero();
        let link = self.link(q);
        if let (true, Some(link)) = (self.coincide, &link) {
            for d in 0..D {
                out.set(d, &link.d.row(d));
            }
        }
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (self.jet(&d.x, q, link.as_ref()), self.jet(&d.y, q, link.as_ref()));
            let scale = T::from(d.scale);
            let mut values = [[T::zero(); N]; 2];
            y.d.add_to(&scaled(&x.x, scale), &mut values);
            x.d.add_to(&scaled(&y.x, scale), &mut values);
            out.set(row, &values);
        }
    }

    #[inline(always)]
    pub(super) fn rate<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]) {
        *out = [T::zero(); 6];
        let link = self.link(q);
        if let (true, Some(link)) = (self.coincide, &link) {
            out[..D].copy_from_slice(&link.d.times(v));
        }
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (self.jet(&d.x, q, link.as_ref()), self.jet(&d.y, q, link.as_ref()));
            out[row] = (dot(&x.x, &y.d.times(v)) + dot(&y.x, &x.d.times(v))) * d.scale;
        }
    }

    /// u, G v, and G a + (G v)_q v, from the same vectors.
    #[inline(always)]
    pub(super) fn value_and_rates<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[T; 6]; 3] {
        let mut out = [[T::zero(); 6]; 3];
        let along = |x: &Vector<D>| x.along::<T, S, N, R>(&self.points, q, v, a);
        let link = if self.uses_link { along(&Vector::Link) } else { [[T::zero(); D]; 3] };
        if self.coincide {
            out.iter_mut().zip(&link).for_each(|(out, link)| out[..D].copy_from_slice(link));
        }
        let pick = |x: &Vector<D>| if *x == Vector::Link { link } else { along(x) };
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (pick(&d.x), pick(&d.y));
            out[0][row] = (dot(&x[0], &y[0]) - d.offset) * d.scale;
            out[1][row] = (dot(&x[0], &y[1]) + dot(&x[1], &y[0])) * d.scale;
            let mixed = dot(&x[1], &y[1]) * 2.0;
            out[2][row] = (dot(&x[0], &y[2]) + dot(&x[2], &y[0]) + mixed) * d.scale;
        }
        out
    }

    #[inline(always)]
    pub(super) fn directional<T: Real>(
        &self,
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
        out: &mut RowBlocks<T, N>,
    ) {
        *out = RowBlocks::zero();
        let second = |x: &Vector<D>| x.second::<T, S, N, R>(&self.points, q, w);
        if self.coincide {
            let link = second(&Vector::Link);
            for d in 0..D {
                out.set(d, &link.row(d));
            }
        }
        if self.dots.is_empty() {
            return;
        }
        let link = self.link(q);
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (self.jet(&d.x, q, link.as_ref()), self.jet(&d.y, q, link.as_ref()));
            let scale = T::from(d.scale);
            let mut values = [[T::zero(); N]; 2];
            second(&d.y).add_to(&scaled(&x.x, scale), &mut values);
            second(&d.x).add_to(&scaled(&y.x, scale), &mut values);
            x.d.add_to(&scaled(&y.d.times(w), scale), &mut values);
            y.d.add_to(&scaled(&x.d.times(w), scale), &mut values);
            out.set(row, &values);
        }
    }

    #[inline(always)]
    pub(super) fn curvature<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]) {
        *out = [T::zero(); 6];
        let second = |x: &Vector<D>| x.second::<T, S, N, R>(&self.points, q, v).times(v);
        let bent = if self.uses_link { second(&Vector::Link) } else { [T::zero(); D] };
        if self.coincide {
            out[..D].copy_from_slice(&bent);
        }
        if self.dots.is_empty() {
            return;
        }
        let second = |x: &Vector<D>| if *x == Vector::Link { bent } else { second(x) };
        let link = self.link(q);
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (self.jet(&d.x, q, link.as_ref()), self.jet(&d.y, q, link.as_ref()));
            let mixed = dot(&x.d.times(v), &y.d.times(v)) * 2.0;
            out[row] = (dot(&x.x, &second(&d.y)) + dot(&y.x, &second(&d.x)) + mixed) * d.scale;
        }
    }

    /// (G v)_q and (G a)_q + ((G v)_q v)_q, and G where a third is asked for, from the same vectors; returns u.
    #[inline(always)]
    pub(super) fn rate_blocks<T: Real, const K: usize>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        out: &mut [RowBlocks<T, N>; K],
    ) -> [T; 6] {
        *out = [RowBlocks::zero(); K];
        let mut u = [T::zero(); 6];
        if self.coincide {
            let link = Vector::Link.moved::<T, S, N, R>(&self.points, q, v, a);
            u[..D].copy_from_slice(&link.x[0]);
            for (out, order) in out.iter_mut().zip([1, 2, 0]) {
                for d in 0..D {
                    out.set(d, &link.d[order].row(d));
                }
            }
        }
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let scale = T::from(d.scale);
            let mut values = [[[T::zero(); N]; 2]; K];
            let x = d.x.moved::<T, S, N, R>(&self.points, q, v, a);
            let product = if d.x == d.y {
                x.add_to(&x.x, scale * 2.0, &mut values);
                dot(&x.x[0], &x.x[0])
            } else {
                let y = d.y.moved::<T, S, N, R>(&self.points, q, v, a);
                y.add_to(&x.x, scale, &mut values);
                x.add_to(&y.x, scale, &mut values);
                dot(&x.x[0], &y.x[0])
            };
            u[row] = (product - d.offset) * d.scale;
            for (out, values) in out.iter_mut().zip(&values) {
                out.set(row, values);
            }
        }
        u
    }

    /// Whether a Hessian couples the bodies: coinciding points bend with each for itself.
    pub(super) fn couples(&self) -> bool {
        !self.dots.is_empty()
    }

    /// out += Σ c_k H_k.
    #[inline(always)]
    pub(super) fn add_hessian<T: Real>(
        &self,
        q: [&[T; N]; 2],
        c: &[T; 6],
        out: &mut PairBlocks<T, N>,
    ) {
        let bend = |x: &Vector<D>, c: &[T; D], out: &mut PairBlocks<T, N>| {
            x.add_bend::<T, S, N, R>(&self.points, q, c, out);
        };
        if self.coincide {
            bend(&Vector::Link, &std::array::from_fn(|d| c[d]), out);
        }
        for (row, d) in (self.first_dot()..).zip(&self.dots) {
            let factor = c[row] * d.scale;
            let x = d.x.jet::<T, S, N, R>(&self.points, q);
            if d.x == d.y {
                bend(&d.x, &scaled(&x.x, factor * 2.0), out);
                x.d.add_symmetric(factor, &x.d, out);
                continue;
            }
            let y = d.y.jet::<T, S, N, R>(&self.points, q);
            bend(&d.x, &scaled(&y.x, factor), out);
            bend(&d.y, &scaled(&x.x, factor), out);
            x.d.add_symmetric(factor, &y.d, out);
        }
    }
}
