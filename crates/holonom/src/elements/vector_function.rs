//! Vector functions of two poses, x = A a or x = point on second − point on first, and what is
//! needed of them: D_x, D²_x\[w], D³_x\[w], K_x(c).

use super::PairBlocks;
use super::space::Space;
use crate::math::Real;
use crate::math::vector::{lift, scaled};

/// A vector function of two poses.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Vector<const D: usize> {
    /// A a, with a in axes of the first body.
    First([f64; D]),
    /// A a, with a in axes of the second body.
    Second([f64; D]),
    /// d = r_j + A_j s_j − r_i − A_i s_i, with the points of the measure.
    Link,
}

/// A matrix with D rows over the coordinates of both poses: rotational columns per side where they
/// do not vanish, translational columns −I and I if `shift`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Columns<T, const D: usize, const R: usize> {
    pub(super) shift: bool,
    pub(super) turn: [Option<[[T; R]; D]>; 2],
}

impl<T: Real, const D: usize, const R: usize> Columns<T, D, R> {
    /// The product with a vector over both poses.
    #[inline(always)]
    pub(super) fn times<const N: usize>(&self, w: [&[T; N]; 2]) -> [T; D] {
        let mut out =
            if self.shift { std::array::from_fn(|d| w[1][d] - w[0][d]) } else { [T::zero(); D] };
        for side in 0..2 {
            if let Some(turn) = &self.turn[side] {
                for d in 0..D {
                    for k in 0..R {
                        out[d] += turn[d][k] * w[side][D + k];
                    }
                }
            }
        }
        out
    }

    /// row += cᵀ (matrix).
    #[inline(always)]
    pub(super) fn add_to<const N: usize>(&self, c: &[T; D], row: &mut [[T; N]; 2]) {
        if self.shift {
            for d in 0..D {
                row[0][d] -= c[d];
                row[1][d] += c[d];
            }
        }
        for side in 0..2 {
            if let Some(turn) = &self.turn[side] {
                for d in 0..D {
                    for k in 0..R {
                        row[side][D + k] += c[d] * turn[d][k];
                    }
                }
            }
        }
    }

    /// Adds the rotational columns of another one.
    #[inline(always)]
    pub(super) fn add(&mut self, other: &Self) {
        for (turn, other) in self.turn.iter_mut().zip(&other.turn) {
            match (turn, other) {
                (Some(turn), Some(other)) => {
                    for (row, other) in turn.iter_mut().zip(other) {
                        row.iter_mut().zip(other).for_each(|(x, y)| *x += *y);
                    }
                }
                (turn, Some(_)) => *turn = *other,
                (_, None) => {}
            }
        }
    }

    /// The matrix as D rows over both poses.
    #[inline(always)]
    pub(super) fn row<const N: usize>(&self, d: usize) -> [[T; N]; 2] {
        let mut row = [[T::zero(); N]; 2];
        if self.shift {
            row[0][d] = -T::one();
            row[1][d] = T::one();
        }
        for side in 0..2 {
            if let Some(turn) = &self.turn[side] {
                row[side][D..].copy_from_slice(&turn[d]);
            }
        }
        row
    }

    /// out += factor (XᵀY + YᵀX), X this matrix.
    #[inline(always)]
    pub(super) fn add_symmetric<const N: usize>(
        &self,
        factor: T,
        other: &Self,
        out: &mut PairBlocks<T, N>,
    ) {
        for s in 0..2 {
            for t in 0..2 {
                let mut add = |i: usize, j: usize, value: T| {
                    out.0[s][t][i][j] += value;
                    out.0[t][s][j][i] += value;
                };
                if self.shift && other.shift {
                    let value = if s == t { factor } else { -factor };
                    for d in 0..D {
                        add(d, d, value);
                    }
                }
                if let (true, Some(y)) = (self.shift, &other.turn[t]) {
                    let signed = if s == 0 { -factor } else { factor };
                    for d in 0..D {
                        for k in 0..R {
                            add(d, D + k, signed * y[d][k]);
                        }
                    }
                }
                if let (Some(x), true) = (&self.turn[s], other.shift) {
                    let signed = if t == 0 { -factor } else { factor };
                    for d in 0..D {
                        for k in 0..R {
                            add(D + k, d, signed * x[d][k]);
                        }
                    }
                }
                if let (Some(x), Some(y)) = (&self.turn[s], &other.turn[t]) {
                    for i in 0..R {
                        for j in 0..R {
                            let mut value = x[0][i] * y[0][j];
                            for d in 1..D {
                                value += x[d][i] * y[d][j];
                            }
                            add(D + i, D + j, factor * value);
                        }
                    }
                }
            }
        }
    }
}

/// Value and first derivative.
#[derive(Debug, Clone, Copy)]
pub(super) struct Jet<T, const D: usize, const R: usize> {
    pub(super) x: [T; D],
    pub(super) d: Columns<T, D, R>,
}

/// What velocities and accelerations make of a vector function.
#[derive(Debug, Clone, Copy)]
pub(super) struct Moved<T, const D: usize, const R: usize> {
    /// x, x₁ = D_x v, and x₂ = D²_x\[v] v + D_x a.
    pub(super) x: [[T; D]; 3],
    /// D_x, D²_x\[v], and D²_x\[a] + D³_x\[v].
    pub(super) d: [Columns<T, D, R>; 3],
}

impl<T: Real, const D: usize, const R: usize> Moved<T, D, R> {
    /// Adds what xᵀy, times a factor, has of the derivatives of y to (G v)_q, to (G a)_q + ((G v)_q v)_q, and to a third, G.
    #[inline(always)]
    pub(super) fn add_to<const N: usize, const K: usize>(
        &self,
        x: &[[T; D]; 3],
        factor: T,
        out: &mut [[[T; N]; 2]; K],
    ) {
        let ([x, x1, x2], [d, d1, d2]) = (x.map(|x| scaled(&x, factor)), &self.d);
        d1.add_to(&x, &mut out[0]);
        d.add_to(&x1, &mut out[0]);
        d2.add_to(&x, &mut out[1]);
        d1.add_to(&scaled(&x1, T::from(2.0)), &mut out[1]);
        d.add_to(&x2, &mut out[1]);
        for gradient in &mut out[2..] {
            d.add_to(&x, gradient);
        }
    }
}

/// `sign` times the derivative of A a of the given order.
#[inline(always)]
fn turn<T: Real, S, const D: usize, const N: usize, const R: usize, const ORDER: u8>(
    q: &[T; N],
    w: &[T; N],
    a: &[f64; D],
    sign: T,
) -> Option<[[T; R]; D]>
where
    S: Space<D, N, R>,
{
    let mut out = match ORDER {
        1 => S::slope(q, &lift(a)),
        2 => S::second(q, w, &lift(a)),
        _ => S::third(q, w, &lift(a))?,
    };
    for row in &mut out {
        for x in row {
            *x *= sign;
        }
    }
    Some(out)
}

impl<const D: usize> Vector<D> {
    #[inline(always)]
    pub(super) fn value<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
    ) -> [T; D]
    where
        S: Space<D, N, R>,
    {
        match self {
            Self::First(a) => S::rotate(q[0], &lift(a)),
            Self::Second(a) => S::rotate(q[1], &lift(a)),
            Self::Link => {
                let first = S::rotate(q[0], &lift(&points[0]));
                let second = S::rotate(q[1], &lift(&points[1]));
                // centres first: far from the origin their difference is exact where arms are not
                let mut out = [T::zero(); D];
                for d in 0..D {
                    out[d] = (q[1][d] - q[0][d]) + (second[d] - first[d]);
                }
                out
            }
        }
    }

    /// x and D_x.
    #[inline(always)]
    pub(super) fn jet<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
    ) -> Jet<T, D, R>
    where
        S: Space<D, N, R>,
    {
        let x = self.value::<T, S, N, R>(points, q);
        Jet { x, d: self.columns::<T, S, N, R, 1>(points, q, q) }
    }

    /// x, D_x v, and D²_x\[v] v + D_x a.
    #[inline(always)]
    pub(super) fn along<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[T; D]; 3]
    where
        S: Space<D, N, R>,
    {
        let Jet { x, d } = self.jet::<T, S, N, R>(points, q);
        let bent = self.second::<T, S, N, R>(points, q, v).times(v);
        let along = d.times(a);
        [x, d.times(v), std::array::from_fn(|k| bent[k] + along[k])]
    }

    /// D²_x\[w].
    #[inline(always)]
    pub(super) fn second<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
    ) -> Columns<T, D, R>
    where
        S: Space<D, N, R>,
    {
        self.columns::<T, S, N, R, 2>(points, q, w)
    }

    /// D³_x\[w].
    #[inline(always)]
    pub(super) fn third<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
    ) -> Columns<T, D, R>
    where
        S: Space<D, N, R>,
    {
        self.columns::<T, S, N, R, 3>(points, q, w)
    }

    /// All that (G v)_q and (G a)_q + ((G v)_q v)_q take of it.
    #[inline(always)]
    pub(super) fn moved<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> Moved<T, D, R>
    where
        S: Space<D, N, R>,
    {
        let Jet { x, d } = self.jet::<T, S, N, R>(points, q);
        let by_v = self.second::<T, S, N, R>(points, q, v);
        let mut by_a = self.second::<T, S, N, R>(points, q, a);
        by_a.add(&self.third::<T, S, N, R>(points, q, v));
        let (bent, along) = (by_v.times(v), d.times(a));
        Moved {
            x: [x, d.times(v), std::array::from_fn(|k| bent[k] + along[k])],
            d: [d, by_v, by_a],
        }
    }

    /// The derivative of the given order; no closures, which would be compiled by themselves and
    /// turn the same vectors again.
    #[inline(always)]
    fn columns<T: Real, S, const N: usize, const R: usize, const ORDER: u8>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        w: [&[T; N]; 2],
    ) -> Columns<T, D, R>
    where
        S: Space<D, N, R>,
    {
        match self {
            Self::First(a) => Columns {
                shift: false,
                turn: [turn::<T, S, D, N, R, ORDER>(q[0], w[0], a, T::one()), None],
            },
            Self::Second(a) => Columns {
                shift: false,
                turn: [None, turn::<T, S, D, N, R, ORDER>(q[1], w[1], a, T::one())],
            },
            Self::Link => Columns {
                shift: ORDER == 1,
                turn: [
                    turn::<T, S, D, N, R, ORDER>(q[0], w[0], &points[0], -T::one()),
                    turn::<T, S, D, N, R, ORDER>(q[1], w[1], &points[1], T::one()),
                ],
            },
        }
    }

    /// out += K_x(c).
    #[inline(always)]
    pub(super) fn add_bend<T: Real, S, const N: usize, const R: usize>(
        &self,
        points: &[[f64; D]; 2],
        q: [&[T; N]; 2],
        c: &[T; D],
        out: &mut PairBlocks<T, N>,
    ) where
        S: Space<D, N, R>,
    {
        let mut add = |side: usize, a: &[f64; D], c: &[T; D]| {
            let k = S::bend(q[side], &lift(a), c);
            for i in 0..R {
                for j in 0..R {
                    out.0[side][side][D + i][D + j] += k[i][j];
                }
            }
        };
        match self {
            Self::First(a) => add(0, a, c),
            Self::Second(a) => add(1, a, c),
            Self::Link => {
                add(0, &points[0], &c.map(|x| -x));
                add(1, &points[1], c);
            }
        }
    }
}
