//! How forces see a body, and what they exert on it: motions and wrenches about the centre of mass, in axes of the
//! ground, in which joint coordinates carry them on.

use std::fmt::Debug;

use super::space::{Planar, Spatial, euler};
use crate::math::spatial::{cross, e_times, rotation_matrix};
use crate::math::vector::{dot, lift, scaled};
use crate::math::{Real, planar};

/// How a body stands and moves: D components of a point, N coordinates of a pose, W of a twist or wrench. A twist is
/// the velocity of the centre of mass (m/s), then the angular velocity (rad/s); a displacement, a wrench likewise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Body<T, const D: usize, const N: usize, const W: usize> {
    /// Centre of mass, m, then Euler parameters of unit length, in the plane the angle, counted over turns, rad.
    pub pose: [T; N],
    /// A, `[row][column]`.
    pub axes: [[T; D]; D],
    /// Its twist.
    pub twist: [T; W],
}

impl<T: Real, const D: usize, const N: usize, const W: usize> Body<T, D, N, W> {
    /// Centre of mass, m.
    #[inline(always)]
    pub(super) fn place(&self) -> [T; D] {
        std::array::from_fn(|d| self.pose[d])
    }

    /// A a.
    #[inline(always)]
    pub(super) fn turn(&self, a: &[f64; D]) -> [T; D] {
        let a = lift(a);
        self.axes.map(|row| dot(&row, &a))
    }
}

/// Motions and wrenches of rigid bodies in the plane or in space.
///
/// Source: `docs/theory/elements.md` (22a), (22b), (24).
pub trait Rigid<const D: usize, const N: usize, const W: usize>:
    Debug + Clone + Copy + PartialEq + 'static
{
    /// A body at a pose with its rates. Euler parameters count by their direction alone: all there is to a body
    /// stays what it is along them.
    fn body<T: Real>(q: &[T; N], v: &[T; N]) -> Body<T, D, N, W>;

    /// ω × a.
    fn spin<T: Real>(twist: &[T; W], a: &[T; D]) -> [T; D];

    /// The wrench of a force at an arm from the centre of mass, and the row of cᵀδx on the displacement of the body that
    /// carries x there.
    fn wrench<T: Real>(c: &[T; D], arm: &[T; D]) -> [T; W];

    /// Rows of such wrenches from rows of the force.
    fn wrenches<T: Real>(c: &[[T; W]; D], arm: &[T; D]) -> [[T; W]; W];

    /// block += factor × what the moment a × c changes by as the body turns with its arm a.
    fn add_swing<T: Real>(arm: &[T; D], c: &[T; D], factor: f64, block: &mut [[T; W]; W]);
}

impl Rigid<2, 3, 3> for Planar {
    #[inline(always)]
    fn body<T: Real>(q: &[T; 3], v: &[T; 3]) -> Body<T, 2, 3, 3> {
        let (sin, cos) = q[2].sine_cosine();
        Body { pose: *q, axes: [[cos, -sin], [sin, cos]], twist: *v }
    }

    #[inline(always)]
    fn spin<T: Real>(twist: &[T; 3], a: &[T; 2]) -> [T; 2] {
        planar::quarter_turn(a).map(|x| twist[2] * x)
    }

    #[inline(always)]
    fn wrench<T: Real>(c: &[T; 2], arm: &[T; 2]) -> [T; 3] {
        [c[0], c[1], arm[0] * c[1] - arm[1] * c[0]]
    }

    #[inline(always)]
    fn wrenches<T: Real>(c: &[[T; 3]; 2], arm: &[T; 2]) -> [[T; 3]; 3] {
        let [x, y] = c;
        [*x, *y, std::array::from_fn(|k| arm[0] * y[k] - arm[1] * x[k])]
    }

    #[inline(always)]
    fn add_swing<T: Real>(arm: &[T; 2], c: &[T; 2], factor: f64, block: &mut [[T; 3]; 3]) {
        block[2][2] -= dot(arm, c) * factor;
    }
}

impl Rigid<3, 7, 6> for Spatial {
    #[inline(always)]
    fn body<T: Real>(q: &[T; 7], v: &[T; 7]) -> Body<T, 3, 7, 6> {
        let p = euler(q);
        let inverse = dot(&p, &p).sqrt().recip();
        let p = scaled(&p, inverse);
        let w = scaled(&e_times(&p, &euler(v)), inverse * 2.0);
        Body {
            pose: [q[0], q[1], q[2], p[0], p[1], p[2], p[3]],
            axes: rotation_matrix(&p),
            twist: [v[0], v[1], v[2], w[0], w[1], w[2]],
        }
    }

    #[inline(always)]
    fn spin<T: Real>(twist: &[T; 6], a: &[T; 3]) -> [T; 3] {
        cross(&angular(twist), a)
    }

    #[inline(always)]
    fn wrench<T: Real>(c: &[T; 3], arm: &[T; 3]) -> [T; 6] {
        let n = cross(arm, c);
        [c[0], c[1], c[2], n[0], n[1], n[2]]
    }

    #[inline(always)]
    fn wrenches<T: Real>(c: &[[T; 6]; 3], arm: &[T; 3]) -> [[T; 6]; 6] {
        let [x, y, z] = c;
        let row = |a: T, u: &[T; 6], b: T, v: &[T; 6]| -> [T; 6] {
            std::array::from_fn(|k| a * u[k] - b * v[k])
        };
        let [a, b, c] = *arm;
        [*x, *y, *z, row(b, z, c, y), row(c, x, a, z), row(a, y, b, x)]
    }

    /// (δθ × a) × c = a (c·δθ) − δθ (a·c).
    #[inline(always)]
    fn add_swing<T: Real>(arm: &[T; 3], c: &[T; 3], factor: f64, block: &mut [[T; 6]; 6]) {
        let along = dot(arm, c) * factor;
        for k in 0..3 {
            let a = arm[k] * factor;
            for l in 0..3 {
                block[3 + k][3 + l] += a * c[l];
            }
            block[3 + k][3 + k] -= along;
        }
    }
}

/// ω of a twist, the moment of a wrench.
#[inline(always)]
pub(super) fn angular<T: Real>(twist: &[T; 6]) -> [T; 3] {
    [twist[3], twist[4], twist[5]]
}

/// Force on a link between a point of the first and a point of the second body.
#[derive(Debug, Clone, Copy)]
pub(super) struct Link<T, const D: usize> {
    /// Points from the centres of mass.
    pub(super) arms: [[T; D]; 2],
    /// Second point from the first one.
    pub(super) x: [T; D],
}

impl<T: Real, const D: usize> Link<T, D> {
    #[inline(always)]
    pub(super) fn new<const N: usize, const W: usize>(
        points: &[[f64; D]; 2],
        bodies: [&Body<T, D, N, W>; 2],
    ) -> Self {
        let arms = [bodies[0].turn(&points[0]), bodies[1].turn(&points[1])];
        // Centres first: far from the origin their difference is exact where arms are not.
        let x = std::array::from_fn(|d| {
            (bodies[1].pose[d] - bodies[0].pose[d]) + (arms[1][d] - arms[0][d])
        });
        Self { arms, x }
    }

    /// ẋ.
    #[inline(always)]
    pub(super) fn speed<S: Rigid<D, N, W>, const N: usize, const W: usize>(
        &self,
        bodies: [&Body<T, D, N, W>; 2],
    ) -> [T; D] {
        let [first, second] = bodies.map(|body| &body.twist);
        let (a, b) = (S::spin(first, &self.arms[0]), S::spin(second, &self.arms[1]));
        std::array::from_fn(|d| (second[d] - first[d]) + (b[d] - a[d]))
    }

    /// Rows of cᵀẋ on both twists: wrenches of a pull −c.
    #[inline(always)]
    pub(super) fn rows<S: Rigid<D, N, W>, const N: usize, const W: usize>(
        &self,
        c: &[T; D],
    ) -> [[T; W]; 2] {
        [S::wrench(&c.map(|x| -x), &self.arms[0]), S::wrench(c, &self.arms[1])]
    }

    /// Rows of cᵀδẋ on displacements at fixed twists, for a row `also` of cᵀδx on the link: the arms turn.
    #[inline(always)]
    pub(super) fn rows_at_rest<S: Rigid<D, N, W>, const N: usize, const W: usize>(
        &self,
        c: &[T; D],
        also: &[T; D],
        bodies: [&Body<T, D, N, W>; 2],
    ) -> [[T; W]; 2] {
        std::array::from_fn(|side| {
            let sign = if side == 0 { -1.0 } else { 1.0 };
            let turned = S::spin(&bodies[side].twist, c);
            let at = std::array::from_fn(|d| (also[d] - turned[d]) * sign);
            let mut row = S::wrench(&at, &self.arms[side]);
            for d in 0..D {
                row[d] = also[d] * sign;
            }
            row
        })
    }

    /// What the wrenches −[`rows`](Self::rows) resist with where c changes by M δx, `[felt][moved]`.
    #[inline(always)]
    pub(super) fn set_stiffness<S: Rigid<D, N, W>, const N: usize, const W: usize>(
        &self,
        m: &[[T; D]; D],
        out: &mut [[[[T; W]; W]; 2]; 2],
    ) {
        for moved in 0..2 {
            let rows = m.map(|row| S::wrench(&row, &self.arms[moved]));
            for felt in 0..2 {
                let block = S::wrenches(&rows, &self.arms[felt]);
                let out = &mut out[felt][moved];
                for (out, row) in out.iter_mut().zip(&block) {
                    for (out, x) in out.iter_mut().zip(row) {
                        *out = if felt == moved { *x } else { -*x };
                    }
                }
            }
        }
    }

    /// Adds the same where c stays as it is and the arms turn.
    #[inline(always)]
    pub(super) fn add_swing<S: Rigid<D, N, W>, const N: usize, const W: usize>(
        &self,
        c: &[T; D],
        out: &mut [[[[T; W]; W]; 2]; 2],
    ) {
        S::add_swing(&self.arms[0], c, -1.0, &mut out[0][0]);
        S::add_swing(&self.arms[1], c, 1.0, &mut out[1][1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, richardson};

    /// Checks that the axes of a body turn with its twist along q + s v, off |p| = 1 too.
    fn turns_with_its_twist<S, const D: usize, const N: usize, const W: usize>(random: &mut Random)
    where
        S: Rigid<D, N, W>,
    {
        let (q, v): ([f64; N], [f64; N]) = (random.array(1.0), random.array(2.0));
        let a: [f64; D] = random.array(1.0);
        let body = S::body(&q, &v);
        let found = richardson(1e-4, |s| {
            S::body(&std::array::from_fn(|k| q[k] + s * v[k]), &v).turn(&a).to_vec()
        });
        let carried = S::spin(&body.twist, &body.turn(&a));
        let size = carried.iter().fold(1.0_f64, |m, x| m.max(x.abs()));
        assert!(found.iter().zip(carried).all(|(x, y)| (x - y).abs() < 1e-7 * size));
        assert_eq!(body.twist[..D], v[..D]);
    }

    #[test] // independent truth: differences of the turned vector along the motion
    fn a_body_turns_with_its_twist() {
        let mut random = Random::new(11);
        for _ in 0..20 {
            turns_with_its_twist::<Planar, 2, 3, 3>(&mut random);
            turns_with_its_twist::<Spatial, 3, 7, 6>(&mut random);
        }
    }
}
