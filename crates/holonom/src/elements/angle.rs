//! The relative angle of two frames, planar and about an axis in space, with its derivatives.

use std::f64::consts::TAU;
use std::fmt::Debug;

use super::measure::{Dot, Measure};
use super::space::{Planar, Space, Spatial, Triad};
use super::{PairBlocks, RowBlocks};
use crate::math::Real;

/// Angle θ(q) of the second frame from the first, rad.
pub trait Angle<const N: usize>: Debug + Clone + PartialEq {
    /// Whether only the principal value in (−π, π] is known from a pose.
    const COUNTS_TURNS: bool;

    /// θ; the principal value where turns must be counted.
    fn value<T: Real>(&self, q: [&[T; N]; 2]) -> T;
    /// θ_q.
    fn gradient<T: Real>(&self, q: [&[T; N]; 2]) -> [[T; N]; 2];
    /// (θ_q w)_q.
    fn directional<T: Real>(&self, q: [&[T; N]; 2], w: [&[T; N]; 2]) -> [[T; N]; 2];
    /// (θ_q v)_q v.
    fn curvature<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2]) -> T;
    /// (θ_q v)_q, and (θ_q a)_q + ((θ_q v)_q v)_q.
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[[T; N]; 2]; 2];
    /// out += c θ_qq.
    fn add_hessian<T: Real>(&self, q: [&[T; N]; 2], c: T, out: &mut PairBlocks<T, N>);

    /// θ on the branch nearest to `winding`.
    fn nearest<T: Real>(&self, q: [&[T; N]; 2], winding: f64) -> T {
        let angle = self.value(q);
        if Self::COUNTS_TURNS { on_branch(angle, winding) } else { angle }
    }
}

/// An angle that is known up to whole turns, on the branch nearest to `winding`.
pub(super) fn on_branch<T: Real>(angle: T, winding: f64) -> T {
    angle + TAU * ((winding - angle.value()) / TAU).round()
}

/// θ = θ_j − θ_i + offset; exact over any number of turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlanarAngle {
    offset: f64,
}

impl PlanarAngle {
    pub(super) fn new(frames: &[Triad<2>; 2]) -> Self {
        let [i, j] = frames.map(|frame| frame.axes[0][1].atan2(frame.axes[0][0]));
        Self { offset: j - i }
    }

    /// The angle of the second body from the first.
    pub(super) fn of_bodies() -> Self {
        Self { offset: 0.0 }
    }
}

impl Angle<3> for PlanarAngle {
    const COUNTS_TURNS: bool = false;

    fn value<T: Real>(&self, q: [&[T; 3]; 2]) -> T {
        q[1][2] - q[0][2] + self.offset
    }

    fn gradient<T: Real>(&self, _q: [&[T; 3]; 2]) -> [[T; 3]; 2] {
        let (o, one) = (T::zero(), T::one());
        [[o, o, -one], [o, o, one]]
    }

    fn directional<T: Real>(&self, _q: [&[T; 3]; 2], _w: [&[T; 3]; 2]) -> [[T; 3]; 2] {
        [[T::zero(); 3]; 2]
    }

    fn curvature<T: Real>(&self, _q: [&[T; 3]; 2], _v: [&[T; 3]; 2]) -> T {
        T::zero()
    }

    fn rate_blocks<T: Real>(
        &self,
        _q: [&[T; 3]; 2],
        _v: [&[T; 3]; 2],
        _a: [&[T; 3]; 2],
    ) -> [[[T; 3]; 2]; 2] {
        [[[T::zero(); 3]; 2]; 2]
    }

    fn add_hessian<T: Real>(&self, _q: [&[T; 3]; 2], _c: T, _out: &mut PairBlocks<T, 3>) {}
}

/// θ = atan2(s, c) of two measures c and s.
///
/// With z = c + i s this is Im log z, and its derivatives follow from those of log:
///
/// ```text
/// θ_q           = Im(z_q / z)
/// (θ_q w)_q     = Im((z_q w)_q / z − (z_q w) z_q / z²)
/// (θ_q v)_q v   = Im(z₂ / z − z₁² / z²)                        z₁ = z_q v, z₂ = (z_q v)_q v
/// its gradient  = Im(z₂_q / z − (z₂ z_q + 2 z₁ z₁_q) / z² + 2 z₁² z_q / z³)
/// θ_qq          = Im(z_qq / z − z_qᵀ z_q / z²)
/// ```
///
/// Undefined where z = 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Argument<S, const D: usize, const N: usize, const R: usize> {
    /// Rows c, s, or two such pairs, which are added.
    z: Measure<S, D, N, R>,
}

/// Angle of two frames about an axis.
pub(super) type SpatialAngle = Argument<Spatial, 3, 7, 4>;

/// Angle of the line between two points of the plane, from the ground's x axis: z = d. Undefined where
/// the points coincide.
pub(super) type LineAngle = Argument<Planar, 2, 3, 1>;

impl SpatialAngle {
    /// The angle about an axis that two frames share: c = f_iᵀf_j, s = g_iᵀf_j, |z| = 1.
    pub(super) fn new(frames: &[Triad<3>; 2]) -> Self {
        Self::of_axis(frames, 0)
    }

    /// The twist of two frames about axes that need not be one: c = f_iᵀf_j + g_iᵀg_j, s = g_iᵀf_j − f_iᵀg_j. It depends on
    /// h_i and h_j alone. Undefined where these are opposite; on a common axis |z| = 2.
    pub(super) fn twist(frames: &[Triad<3>; 2]) -> Self {
        let [[f_i, g_i, _], [f_j, g_j, _]] = frames.map(|frame| frame.axes);
        let minus_f_i = f_i.map(|x| -x);
        let pairs = [(f_i, f_j), (g_i, f_j), (g_i, g_j), (minus_f_i, g_j)];
        let dots = pairs.map(|(first, second)| Dot::axes(first, second)).to_vec();
        Self { z: Measure::new([[0.0; 3]; 2], false, dots) }
    }

    /// The angle about h of the first frame of axis `k` of the second.
    pub(super) fn of_axis(frames: &[Triad<3>; 2], k: usize) -> Self {
        let ([f, g, _], along) = (frames[0].axes, frames[1].axes[k]);
        let dots = vec![Dot::axes(f, along), Dot::axes(g, along)];
        Self { z: Measure::new([[0.0; 3]; 2], false, dots) }
    }

    /// The angle about h of the second frame of h of the first.
    pub(super) fn of_cross(frames: &[Triad<3>; 2]) -> Self {
        let ([_, _, h], [f, g, _]) = (frames[0].axes, frames[1].axes);
        let dots = vec![Dot::axes(h, f), Dot::axes(h, g)];
        Self { z: Measure::new([[0.0; 3]; 2], false, dots) }
    }
}

impl LineAngle {
    pub(super) fn between(points: [[f64; 2]; 2]) -> Self {
        Self { z: Measure::new(points, true, Vec::new()) }
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Argument<S, D, N, R> {
    #[inline(always)]
    fn z<T: Real>(&self, q: [&[T; N]; 2]) -> Complex<T> {
        let mut u = [T::zero(); 6];
        self.z.value(q, &mut u);
        sum(&u)
    }

    #[inline(always)]
    fn z_q<T: Real>(&self, q: [&[T; N]; 2]) -> RowBlocks<T, N> {
        let mut rows = RowBlocks::zero();
        self.z.jacobian(q, &mut rows);
        self.add_pairs(&mut rows);
        rows
    }

    /// Adds the second pair of rows, where there is one, to the first.
    #[inline(always)]
    fn add_pairs<T: Real>(&self, rows: &mut RowBlocks<T, N>) {
        if self.z.rows() > 2 {
            for side in &mut rows.0 {
                let [c, s, more_c, more_s, ..] = side;
                for k in 0..N {
                    c[k] += more_c[k];
                    s[k] += more_s[k];
                }
            }
        }
    }
}

/// c + i s of both pairs of rows; those that are not there are zero.
#[inline(always)]
fn sum<T: Real>(u: &[T; 6]) -> Complex<T> {
    Complex(u[0] + u[2], u[1] + u[3])
}

#[derive(Clone, Copy)]
struct Complex<T>(T, T);

impl<T: Real> Complex<T> {
    #[inline(always)]
    fn times(self, other: Self) -> Self {
        Self(self.0 * other.0 - self.1 * other.1, self.0 * other.1 + self.1 * other.0)
    }

    #[inline(always)]
    fn inverse(self) -> Self {
        // the smallest number keeps an undefined angle free of 0/0
        let square = (self.0 * self.0 + self.1 * self.1 + f64::MIN_POSITIVE).recip();
        Self(self.0 * square, -self.1 * square)
    }

    #[inline(always)]
    fn scaled(self, factor: f64) -> Self {
        Self(self.0 * factor, self.1 * factor)
    }

    #[inline(always)]
    fn minus(self, other: Self) -> Self {
        Self(self.0 - other.0, self.1 - other.1)
    }
}

/// A complex row over both poses.
struct Rows<'a, T, const N: usize>(&'a RowBlocks<T, N>);

impl<T: Real, const N: usize> Rows<'_, T, N> {
    #[inline(always)]
    fn times(&self, w: [&[T; N]; 2]) -> Complex<T> {
        let part = |row: usize| {
            let mut sum = T::zero();
            for side in 0..2 {
                for k in 0..N {
                    sum += self.0.0[side][row][k] * w[side][k];
                }
            }
            sum
        };
        Complex(part(0), part(1))
    }

    /// row += Im(factor · self).
    #[inline(always)]
    fn add_imaginary(&self, factor: Complex<T>, row: &mut [[T; N]; 2]) {
        for side in 0..2 {
            for k in 0..N {
                row[side][k] += factor.0 * self.0.0[side][1][k] + factor.1 * self.0.0[side][0][k];
            }
        }
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Angle<N>
    for Argument<S, D, N, R>
{
    const COUNTS_TURNS: bool = true;

    fn value<T: Real>(&self, q: [&[T; N]; 2]) -> T {
        let Complex(c, s) = self.z(q);
        s.atan2(c)
    }

    fn gradient<T: Real>(&self, q: [&[T; N]; 2]) -> [[T; N]; 2] {
        let mut row = [[T::zero(); N]; 2];
        Rows(&self.z_q(q)).add_imaginary(self.z(q).inverse(), &mut row);
        row
    }

    fn directional<T: Real>(&self, q: [&[T; N]; 2], w: [&[T; N]; 2]) -> [[T; N]; 2] {
        let inverse = self.z(q).inverse();
        let z_q = self.z_q(q);
        let z_q = Rows(&z_q);
        let mut second = RowBlocks::zero();
        self.z.directional(q, w, &mut second);
        self.add_pairs(&mut second);
        let mut row = [[T::zero(); N]; 2];
        Rows(&second).add_imaginary(inverse, &mut row);
        let factor = z_q.times(w).times(inverse).times(inverse).scaled(-1.0);
        z_q.add_imaginary(factor, &mut row);
        row
    }

    fn curvature<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2]) -> T {
        let inverse = self.z(q).inverse();
        let mut second = [T::zero(); 6];
        self.z.curvature(q, v, &mut second);
        let ratio = Rows(&self.z_q(q)).times(v).times(inverse);
        sum(&second).times(inverse).minus(ratio.times(ratio)).1
    }

    #[inline(always)]
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[[T; N]; 2]; 2] {
        let mut rows = [RowBlocks::zero(); 3];
        let z = self.z.rate_blocks(q, v, a, &mut rows);
        rows.iter_mut().for_each(|rows| self.add_pairs(rows));
        let inverse = sum(&z).inverse();
        let [change, bend, z_q] = [Rows(&rows[0]), Rows(&rows[1]), Rows(&rows[2])];
        let first = z_q.times(v).times(inverse); // z₁ / z
        let second = change.times(v).times(inverse); // z₂ / z
        let along = z_q.times(a).times(inverse);
        let [mut of_v, mut of_a] = [[[T::zero(); N]; 2]; 2];
        change.add_imaginary(inverse, &mut of_v);
        z_q.add_imaginary(first.times(inverse).scaled(-1.0), &mut of_v);
        bend.add_imaginary(inverse, &mut of_a);
        change.add_imaginary(first.times(inverse).scaled(-2.0), &mut of_a);
        let square = first.times(first).scaled(2.0);
        z_q.add_imaginary(square.minus(second).minus(along).times(inverse), &mut of_a);
        [of_v, of_a]
    }

    #[inline(always)]
    fn add_hessian<T: Real>(&self, q: [&[T; N]; 2], c: T, out: &mut PairBlocks<T, N>) {
        let inverse = self.z(q).inverse();
        let RowBlocks(z_q) = self.z_q(q);
        let o = T::zero();
        let (cosine, sine) = (inverse.1 * c, inverse.0 * c);
        let weights = [cosine, sine, cosine, sine, o, o];
        // Im(z_qq / z): the imaginary part of 1/z weighs row c, the real part row s
        self.z.add_hessian(q, &weights, out);
        // −Im(z_qᵀ z_q / z²)
        let square = inverse.times(inverse).scaled(-1.0);
        for s in 0..2 {
            for i in 0..N {
                let a = Complex(z_q[s][0][i], z_q[s][1][i]).times(square);
                for t in 0..2 {
                    for j in 0..N {
                        out.0[s][t][i][j] += (a.0 * z_q[t][1][j] + a.1 * z_q[t][0][j]) * c;
                    }
                }
            }
        }
    }
}
