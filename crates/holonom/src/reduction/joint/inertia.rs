//! Inertias as symmetric matrices that make wrenches of rates of twists (`docs/theory/joint.md` (11), (12)).

use super::algebra::{joined, parts};
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

/// f = M v + H ω, n = Hᵀ v + J ω.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct SpatialInertia {
    m: [[f64; 3]; 3],
    h: [[f64; 3]; 3],
    j: [[f64; 3]; 3],
}

fn add_up(out: &mut [[f64; 3]; 3], x: &[[f64; 3]; 3]) {
    for (out, x) in out.iter_mut().zip(x) {
        *out = sum(out, x);
    }
}

impl Inertia<6> for SpatialInertia {
    fn of_body(mass: f64, inertia: &[[f64; 3]; 3], arm: &[f64; 3]) -> Self {
        let [x, y, z] = arm.map(|x| mass * x);
        let square = dot(arm, &[x, y, z]);
        let mut out = Self { h: [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]], ..Self::default() };
        for i in 0..3 {
            out.m[i][i] = mass;
            for j in 0..3 {
                out.j[i][j] = inertia[i][j] - mass * arm[i] * arm[j];
            }
            out.j[i][i] += square;
        }
        out
    }

    #[inline(always)]
    fn moved(&self, arm: &[f64; 3]) -> Self {
        // H' = H − M r̃, J' = J + Hᵀ·(−r̃) + r̃ H'
        let h: [[f64; 3]; 3] = std::array::from_fn(|i| {
            let turned = cross(&self.m[i], arm);
            std::array::from_fn(|j| self.h[i][j] - turned[j])
        });
        let column = |h: &[[f64; 3]; 3], k: usize| cross(arm, &[h[0][k], h[1][k], h[2][k]]);
        let [before, after]: [[[f64; 3]; 3]; 2] =
            [&self.h, &h].map(|h| std::array::from_fn(|k| column(h, k)));
        let mut j = self.j;
        for i in 0..3 {
            for k in 0..=i {
                j[i][k] += before[i][k] + after[k][i];
                j[k][i] = j[i][k];
            }
        }
        Self { m: self.m, h, j }
    }

    #[inline(always)]
    fn add(&mut self, other: &Self) {
        add_up(&mut self.m, &other.m);
        add_up(&mut self.h, &other.h);
        add_up(&mut self.j, &other.j);
    }

    #[inline(always)]
    fn subtract_square(&mut self, u: &[f64; 6]) {
        for i in 0..3 {
            for k in 0..3 {
                self.m[i][k] -= u[i] * u[k];
                self.h[i][k] -= u[i] * u[3 + k];
                self.j[i][k] -= u[3 + i] * u[3 + k];
            }
        }
    }

    #[inline(always)]
    fn times(&self, y: &[f64; 6]) -> [f64; 6] {
        let (v, w) = parts(y);
        let Self { m, h, j } = self;
        std::array::from_fn(|i| {
            if i < 3 {
                dot(&m[i], &v) + dot(&h[i], &w)
            } else {
                let k = i - 3;
                h[0][k] * v[0] + h[1][k] * v[1] + h[2][k] * v[2] + dot(&j[k], &w)
            }
        })
    }

    fn diagonal(&self) -> [f64; 6] {
        let Self { m, j, .. } = self;
        [m[0][0], m[1][1], m[2][2], j[0][0], j[1][1], j[2][2]]
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
        let (mut l, mut force) = (j, [0.0; 3]);
        for i in 0..3 {
            force[i] = -wrench[3 + i];
            felt[i] = [h[0][i], h[1][i], h[2][i], 0.0, 0.0, 0.0];
        }
        if !factor(&mut l, 3) || (0..3).any(|i| is_lost(l[i][i], sizes[3 + i])) {
            return false;
        }
        Pivot::keep(pivots, &l, &force);
        *self = Self { m, ..Self::default() };
        let size: [f64; 3] = std::array::from_fn(|i| m[i][i]);
        *sizes = joined(&size, &[0.0; 3]);
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
            for w in 0..3 {
                sizes[w] += halves[i][w] * halves[i][w];
                wrench[w] += rates[i] * halves[i][w];
                wrench[3 + w] = 0.0;
                for k in 0..3 {
                    self.m[w][k] -= halves[i][w] * halves[i][k];
                }
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
