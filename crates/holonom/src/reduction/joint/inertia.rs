//! Inertias as symmetric matrices that make wrenches of rates of twists (`docs/theory/joint.md` (11), (12)).

use super::algebra::parts;
use super::articulated::{Pivot, is_lost};
use super::small::factor;
use crate::math::spatial::cross;
use crate::math::vector::{difference, dot, sum};

/// A symmetric matrix that makes wrenches of rates of twists about one point.
pub(super) trait Inertia<const W: usize>:
    std::fmt::Debug + Clone + Copy + Default + Send + Sync + 'static
{
    /// Of a body whose centre of mass is at `arm` from the point, from its inertia about it in axes of the ground.
    fn of_body(mass: f64, inertia: &[[f64; 3]; 3], arm: &[f64; 3]) -> Self;

    /// About another point, from which this one is at `arm`.
    fn moved(&self, arm: &[f64; 3]) -> Self;

    /// The same where no rotation about the point feels anything.
    fn released_moved(&self, arm: &[f64; 3]) -> Self {
        self.moved(arm)
    }

    /// K += another one about the same point.
    fn add(&mut self, other: &Self);

    /// K −= u uᵀ.
    fn subtract_square(&mut self, u: &[f64; W]);

    /// K y.
    fn times(&self, y: &[f64; W]) -> [f64; W];

    /// Its diagonal.
    fn diagonal(&self) -> [f64; W];

    /// What a body that turns freely about the point takes of this inertia, the `size` of its terms and its wrench: the three
    /// rotations eliminated, whose moments and factor of J it leaves in `pivots` and H in `felt`; `false` where too few digits are left, and in a
    /// plane.
    fn release(
        &mut self,
        pivots: &mut [Pivot],
        size: &mut [f64; W],
        felt: &mut [[f64; W]],
        wrench: &mut [f64; W],
    ) -> bool;

    /// Rates of a rotation, by their columns, for which a body that moves by `motion` turns by `angular`.
    fn turn(motion: &mut [f64; W], angular: [f64; 3], columns: &[[f64; W]], rates: &mut [f64]);
}

/// f = M v + H ω, n = Hᵀ v + J ω, M and J by their entries xx, xy, xz, yy, yz, zz.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SpatialInertia {
    m: [f64; 6],
    h: [[f64; 3]; 3],
    j: [f64; 6],
}

/// Rows of a symmetric matrix.
#[inline(always)]
fn rows([xx, xy, xz, yy, yz, zz]: &[f64; 6]) -> [[f64; 3]; 3] {
    [[*xx, *xy, *xz], [*xy, *yy, *yz], [*xz, *yz, *zz]]
}

/// Entries of u uᵀ.
#[inline(always)]
fn square([x, y, z]: &[f64; 3]) -> [f64; 6] {
    [x * x, x * y, x * z, y * y, y * z, z * z]
}

#[inline(always)]
fn add_up<const K: usize>(out: &mut [f64; K], x: &[f64; K]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out += x);
}

#[inline(always)]
fn take_away<const K: usize>(out: &mut [f64; K], x: &[f64; K]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out -= x);
}

impl Inertia<6> for SpatialInertia {
    #[inline(always)]
    fn of_body(mass: f64, inertia: &[[f64; 3]; 3], arm: &[f64; 3]) -> Self {
        let [x, y, z] = arm.map(|x| mass * x);
        let square = dot(arm, &[x, y, z]);
        let entry = |i: usize, k: usize| inertia[i][k] - mass * arm[i] * arm[k];
        let [xx, yy, zz] = std::array::from_fn(|i| entry(i, i) + square);
        Self {
            m: [mass, 0.0, 0.0, mass, 0.0, mass],
            h: [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]],
            j: [xx, entry(0, 1), entry(0, 2), yy, entry(1, 2), zz],
        }
    }

    #[inline(always)]
    fn moved(&self, arm: &[f64; 3]) -> Self {
        // H' = H − M r̃, J' = J + Hᵀ·(−r̃) + r̃ H'
        let m = rows(&self.m);
        let h: [[f64; 3]; 3] = std::array::from_fn(|i| difference(&self.h[i], &cross(&m[i], arm)));
        let column = |h: &[[f64; 3]; 3], k: usize| cross(arm, &[h[0][k], h[1][k], h[2][k]]);
        let [a, b]: [[[f64; 3]; 3]; 2] =
            [&self.h, &h].map(|h| std::array::from_fn(|k| column(h, k)));
        let mut j = self.j;
        let by = |i: usize, k: usize| a[i][k] + b[k][i];
        add_up(&mut j, &[by(0, 0), by(1, 0), by(2, 0), by(1, 1), by(2, 1), by(2, 2)]);
        Self { m: self.m, h, j }
    }

    #[inline(always)]
    fn released_moved(&self, arm: &[f64; 3]) -> Self {
        let h = rows(&self.m).map(|row| cross(arm, &row));
        let [x, y, z] = std::array::from_fn(|k| cross(arm, &[h[0][k], h[1][k], h[2][k]]));
        Self { m: self.m, h, j: [x[0], x[1], x[2], y[1], y[2], z[2]] }
    }

    #[inline(always)]
    fn add(&mut self, other: &Self) {
        add_up(&mut self.m, &other.m);
        self.h.iter_mut().zip(&other.h).for_each(|(out, x)| add_up(out, x));
        add_up(&mut self.j, &other.j);
    }

    #[inline(always)]
    fn subtract_square(&mut self, u: &[f64; 6]) {
        let (f, n) = parts(u);
        take_away(&mut self.m, &square(&f));
        for (out, f) in self.h.iter_mut().zip(f) {
            take_away(out, &n.map(|n| f * n));
        }
        take_away(&mut self.j, &square(&n));
    }

    #[inline(always)]
    fn times(&self, y: &[f64; 6]) -> [f64; 6] {
        let (v, w) = parts(y);
        let (m, h, j) = (rows(&self.m), &self.h, rows(&self.j));
        std::array::from_fn(|i| {
            if i < 3 {
                dot(&m[i], &v) + dot(&h[i], &w)
            } else {
                let k = i - 3;
                h[0][k] * v[0] + h[1][k] * v[1] + h[2][k] * v[2] + dot(&j[k], &w)
            }
        })
    }

    #[inline(always)]
    fn diagonal(&self) -> [f64; 6] {
        let Self { m, j, .. } = self;
        [m[0], m[3], m[5], j[0], j[3], j[5]]
    }

    /// M ← M − H J⁻¹Hᵀ, f ← f − H J⁻¹n; H, J and n vanish.
    fn release(
        &mut self,
        pivots: &mut [Pivot],
        sizes: &mut [f64; 6],
        felt: &mut [[f64; 6]],
        wrench: &mut [f64; 6],
    ) -> bool {
        let Self { m, h, j } = *self;
        let (mut l, mut force) = (rows(&j), [0.0; 3]);
        for i in 0..3 {
            force[i] = -wrench[3 + i];
            felt[i] = [h[0][i], h[1][i], h[2][i], 0.0, 0.0, 0.0];
        }
        if !factor(&mut l, 3) || (0..3).any(|i| is_lost(l[i][i], sizes[3 + i])) {
            return false;
        }
        Pivot::keep(pivots, &l, &force);
        *self = Self { m, ..Self::default() };
        *sizes = [m[0], m[3], m[5], 0.0, 0.0, 0.0];
        let (mut halves, mut rates) = ([[0.0; 3]; 3], [0.0; 3]);
        for i in 0..3 {
            (halves[i], rates[i]) = ([h[0][i], h[1][i], h[2][i]], force[i]);
            for k in 0..i {
                rates[i] -= l[i][k] * rates[k];
                for w in 0..3 {
                    halves[i][w] -= l[i][k] * halves[k][w];
                }
            }
            rates[i] *= l[i][i];
            halves[i] = halves[i].map(|x| x * l[i][i]);
            take_away(&mut self.m, &square(&halves[i]));
            for w in 0..3 {
                sizes[w] += halves[i][w] * halves[i][w];
                wrench[w] += rates[i] * halves[i][w];
                wrench[3 + w] = 0.0;
            }
        }
        true
    }

    fn turn(motion: &mut [f64; 6], angular: [f64; 3], columns: &[[f64; 6]], rates: &mut [f64]) {
        let (_, before) = parts(motion);
        motion[3..].copy_from_slice(&angular);
        let change = difference(&angular, &before);
        let [a, b, c] = std::array::from_fn(|k| parts(&columns[k]).1);
        let (bc, ca, ab) = (cross(&b, &c), cross(&c, &a), cross(&a, &b));
        let inverse = dot(&a, &bc).recip();
        for (rate, row) in rates.iter_mut().zip([bc, ca, ab]) {
            *rate = inverse * dot(&row, &change);
        }
    }
}

/// The same in a plane, M by its entries xx, xy, yy.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct PlanarInertia {
    m: [f64; 3],
    h: [f64; 2],
    j: f64,
}

impl Inertia<3> for PlanarInertia {
    fn of_body(mass: f64, inertia: &[[f64; 3]; 3], arm: &[f64; 3]) -> Self {
        let [x, y] = [mass * arm[0], mass * arm[1]];
        let j = inertia[2][2] + arm[0] * x + arm[1] * y;
        Self { m: [mass, 0.0, mass], h: [-y, x], j }
    }

    #[inline(always)]
    fn moved(&self, arm: &[f64; 3]) -> Self {
        let (m, [x, y, _]) = (self.m, *arm);
        let h = [self.h[0] - m[0] * y + m[1] * x, self.h[1] - m[1] * y + m[2] * x];
        let j = self.j + x * (self.h[1] + h[1]) - y * (self.h[0] + h[0]);
        Self { m, h, j }
    }

    #[inline(always)]
    fn add(&mut self, other: &Self) {
        self.m = sum(&self.m, &other.m);
        self.h = [self.h[0] + other.h[0], self.h[1] + other.h[1]];
        self.j += other.j;
    }

    #[inline(always)]
    fn subtract_square(&mut self, u: &[f64; 3]) {
        let [x, y, z] = *u;
        self.m = difference(&self.m, &[x * x, x * y, y * y]);
        self.h = [self.h[0] - x * z, self.h[1] - y * z];
        self.j -= z * z;
    }

    #[inline(always)]
    fn times(&self, y: &[f64; 3]) -> [f64; 3] {
        let ([xx, xy, yy], [u, v]) = (self.m, self.h);
        [
            xx * y[0] + xy * y[1] + u * y[2],
            xy * y[0] + yy * y[1] + v * y[2],
            u * y[0] + v * y[1] + self.j * y[2],
        ]
    }

    fn diagonal(&self) -> [f64; 3] {
        [self.m[0], self.m[2], self.j]
    }

    fn release(
        &mut self,
        _: &mut [Pivot],
        _: &mut [f64; 3],
        _: &mut [[f64; 3]],
        _: &mut [f64; 3],
    ) -> bool {
        false
    }

    fn turn(_: &mut [f64; 3], _: [f64; 3], _: &[[f64; 3]], _: &mut [f64]) {}
}
