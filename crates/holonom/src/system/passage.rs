//! From wrenches on bodies and their blocks on motions to generalized forces on poses and theirs.
//!
//! Source: `docs/theory/elements.md` (25)-(27).

use crate::math::Real;
use crate::math::spatial::e_transposed_slope;
use crate::math::vector::{dot, scaled};

/// How changes of a pose and its rates move a body: δξ = T δq, δy = T δq̇ + Z δq.
pub(super) trait Passage<const N: usize, const W: usize> {
    /// At a pose with its rates.
    fn at(q: &[f64; N], v: &[f64; N]) -> Self;

    /// Tᵀw: the generalized force of a wrench, or the row on q̇ of one on the twist.
    fn force(&self, w: &[f64; W]) -> [f64; N];

    /// Tᵀ`by_x` + Zᵀ`by_y`: the row on q of rows on displacement and twist.
    fn position_row(&self, by_x: &[f64; W], by_y: &[f64; W]) -> [f64; N];

    /// Adds `self`ᵀ(k T + c Z) to `stiffness`, T and Z of the body that moves, N×N by rows.
    fn add_stiffness(
        &self,
        moved: &Self,
        k: &[[f64; W]; W],
        c: Option<&[[f64; W]; W]>,
        stiffness: &mut [f64],
    );

    /// Adds `self`ᵀc T to `damping`.
    fn add_damping(&self, moved: &Self, c: &[[f64; W]; W], damping: &mut [f64]);

    /// Adds −(Tᵀw)_q, w fixed.
    fn add_bend(&self, w: &[f64; W], stiffness: &mut [f64]);
}

/// In the plane poses are motions.
pub(super) struct Direct;

impl Passage<3, 3> for Direct {
    fn at(_: &[f64; 3], _: &[f64; 3]) -> Self {
        Self
    }

    fn force(&self, w: &[f64; 3]) -> [f64; 3] {
        *w
    }

    fn position_row(&self, by_x: &[f64; 3], _: &[f64; 3]) -> [f64; 3] {
        *by_x
    }

    fn add_stiffness(
        &self,
        _: &Self,
        k: &[[f64; 3]; 3],
        _: Option<&[[f64; 3]; 3]>,
        stiffness: &mut [f64],
    ) {
        stiffness.iter_mut().zip(k.as_flattened()).for_each(|(out, x)| *out += x);
    }

    fn add_damping(&self, _: &Self, c: &[[f64; 3]; 3], damping: &mut [f64]) {
        damping.iter_mut().zip(c.as_flattened()).for_each(|(out, x)| *out += x);
    }

    fn add_bend(&self, _: &[f64; 3], _: &mut [f64]) {}
}

/// In space, by Euler parameters of any length, which count by their direction alone.
///
/// ```text
/// δφ = t δp,  ω = t ṗ,  t = 2 E(p) / |p|²       δω = t δṗ + z δp,  z = −2 (E(ṗ) + ω pᵀ) / |p|²
/// Q_p = tᵀn       −(tᵀn)_p = 2 (Q_p pᵀ − (Eᵀn)_p) / |p|²
/// ```
pub(super) struct ByEuler<T> {
    p: [T; 4],
    turn: [[T; 4]; 3],
    bend: [[T; 4]; 3],
    /// 2 / |p|².
    factor: T,
}

/// E(p).
#[inline(always)]
fn e_matrix<T: Real>([e0, e1, e2, e3]: [T; 4]) -> [[T; 4]; 3] {
    [[-e1, e0, -e3, e2], [-e2, e3, e0, -e1], [-e3, -e2, e1, e0]]
}

impl<T: Real> ByEuler<T> {
    #[inline(always)]
    fn new(q: &[T; 7], v: &[T; 7]) -> Self {
        let (p, rate) = ([q[3], q[4], q[5], q[6]], [v[3], v[4], v[5], v[6]]);
        let factor = dot(&p, &p).recip() * 2.0;
        let turn = e_matrix(p).map(|row| scaled(&row, factor));
        let own = e_matrix(rate);
        let bend = std::array::from_fn(|k| {
            let spin = dot(&turn[k], &rate);
            std::array::from_fn(|l| -(own[k][l] + spin * p[l]) * factor)
        });
        Self { p, turn, bend, factor }
    }

    #[inline(always)]
    fn generalized(&self, w: &[T; 6]) -> [T; 7] {
        let o = T::zero();
        let mut out = [w[0], w[1], w[2], o, o, o, o];
        let [a, b, c] = &self.turn;
        for k in 0..4 {
            out[3 + k] = a[k] * w[3] + b[k] * w[4] + c[k] * w[5];
        }
        out
    }
}

/// Σ factorₖ rowₖ.
#[inline(always)]
fn combined(factors: [f64; 3], rows: &[[f64; 4]; 3]) -> [f64; 4] {
    let ([a, b, c], mut out) = (factors, [0.0; 4]);
    for l in 0..4 {
        out[l] = a * rows[0][l] + b * rows[1][l] + c * rows[2][l];
    }
    out
}

/// out += t_feltᵀ of rows over displacements, of which the first three numbers count, and over Euler parameters: by fours,
/// which are added side by side.
#[inline(always)]
fn add_rows(turn: &[[f64; 4]; 3], rows: &[[f64; 6]; 6], turns: &[[f64; 4]; 6], out: &mut [f64]) {
    let out = out.as_chunks_mut::<7>().0.first_chunk_mut::<7>().expect("a block of two bodies");
    for k in 0..3 {
        for l in 0..3 {
            out[k][l] += rows[k][l];
        }
        for l in 0..4 {
            out[k][3 + l] += turns[k][l];
        }
    }
    let torques = [turns[3], turns[4], turns[5]];
    for k in 0..4 {
        let [a, b, c] = [turn[0][k], turn[1][k], turn[2][k]];
        for l in 0..3 {
            out[3 + k][l] += a * rows[3][l] + b * rows[4][l] + c * rows[5][l];
        }
        let sums = combined([a, b, c], &torques);
        for l in 0..4 {
            out[3 + k][3 + l] += sums[l];
        }
    }
}

impl Passage<7, 6> for ByEuler<f64> {
    #[inline(always)]
    fn at(q: &[f64; 7], v: &[f64; 7]) -> Self {
        Self::new(q, v)
    }

    #[inline(always)]
    fn force(&self, w: &[f64; 6]) -> [f64; 7] {
        self.generalized(w)
    }

    #[inline(always)]
    fn position_row(&self, by_x: &[f64; 6], by_y: &[f64; 6]) -> [f64; 7] {
        let mut out = self.generalized(by_x);
        let [a, b, c] = &self.bend;
        for k in 0..4 {
            out[3 + k] += a[k] * by_y[3] + b[k] * by_y[4] + c[k] * by_y[5];
        }
        out
    }

    #[inline(always)]
    fn add_stiffness(
        &self,
        moved: &Self,
        k: &[[f64; 6]; 6],
        c: Option<&[[f64; 6]; 6]>,
        stiffness: &mut [f64],
    ) {
        // Loops: what makes arrays by closures calls these.
        let mut turns = [[0.0; 4]; 6];
        for row in 0..6 {
            turns[row] = combined([k[row][3], k[row][4], k[row][5]], &moved.turn);
        }
        if let Some(c) = c {
            for row in 0..6 {
                let bent = combined([c[row][3], c[row][4], c[row][5]], &moved.bend);
                for l in 0..4 {
                    turns[row][l] += bent[l];
                }
            }
        }
        add_rows(&self.turn, k, &turns, stiffness);
    }

    #[inline(always)]
    fn add_damping(&self, moved: &Self, c: &[[f64; 6]; 6], damping: &mut [f64]) {
        let mut turns = [[0.0; 4]; 6];
        for row in 0..6 {
            turns[row] = combined([c[row][3], c[row][4], c[row][5]], &moved.turn);
        }
        add_rows(&self.turn, c, &turns, damping);
    }

    #[inline(always)]
    fn add_bend(&self, w: &[f64; 6], stiffness: &mut [f64]) {
        let force = self.generalized(w);
        let slope = e_transposed_slope(&[w[3], w[4], w[5]]);
        for (k, row) in slope.iter().enumerate() {
            let out = &mut stiffness[(3 + k) * 7 + 3..][..4];
            for (l, out) in out.iter_mut().enumerate() {
                *out += (force[3 + k] * self.p[l] - row[l]) * self.factor;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::elements::body::Rigid;
    use crate::elements::space::Spatial;
    use crate::elements::spatial::Force;
    use crate::elements::{ExtraRows, ForceBlocks, ForceElement, ForceInput};
    use crate::math::spatial::rotation_matrix;
    use crate::model::{self, ForceKind, Frame};
    use crate::testing::{Random, richardson};
    use num_dual::Dual64;

    type Pair<T> = [[T; 7]; 2];

    fn input<'a, T: Real>(q: &Pair<T>, v: &Pair<T>, z: &'a [T]) -> ForceInput<'a, T, 3, 7, 6> {
        let bodies = [0, 1].map(|side| Spatial::body(&q[side], &v[side]));
        ForceInput { t: T::zero(), bodies, z, winding: 0.0 }
    }

    /// Generalized forces on both bodies, and ż.
    fn force<T: Real>(element: &Force, q: &Pair<T>, v: &Pair<T>, z: T) -> Vec<T> {
        let (mut wrenches, mut rate) = ([[T::zero(); 6]; 2], [T::zero()]);
        element.evaluate(&input(q, v, &[z]), &mut wrenches, &mut rate);
        let side = |s: usize| ByEuler::new(&q[s], &v[s]).generalized(&wrenches[s]);
        [side(0).as_slice(), &side(1), &rate].concat()
    }

    fn frame(random: &mut Random) -> Frame {
        let axes = rotation_matrix(&random.unit::<4>());
        Frame { body: Some(0), point: random.array(0.5), axes }
    }

    /// A bushing, which has everything but an extra state, and a Maxwell element, which has one.
    fn elements(random: &mut Random) -> [Force; 2] {
        let frames = [frame(random), frame(random)];
        let mut square = |size: f64| Box::new([0; 6].map(|_| random.array::<6>(size)));
        let (stiffness, damping, branches) = (square(100.0), square(10.0), Vec::new());
        let bushing = ForceKind::Bushing { frames, stiffness, damping, branches };
        let maxwell =
            ForceKind::Maxwell { frames, stiffness: 300.0, damping: 20.0, free_length: 0.6 };
        [bushing, maxwell].map(|kind| {
            let force = model::Force { name: "force".into(), kind };
            Force::new(&force, [[0.1, 0.2, -0.1], [0.0, 0.1, 0.3]])
        })
    }

    /// Rows of forces and ż by columns of q, or of q̇.
    fn blocks(element: &Force, q: &Pair<f64>, v: &Pair<f64>, z: f64) -> [Vec<Vec<f64>>; 2] {
        let mut of = ForceBlocks::zero();
        element.blocks(&input(q, v, &[z]), &mut of);
        let mut rows = [[[0.0; 6]; 2]; 3];
        let [force, by_displacement, by_twist] = rows.each_mut().map(std::slice::from_mut);
        let (own, time) = (&mut [0.0], &mut [0.0]);
        let mut extra = ExtraRows { force, by_displacement, by_twist, own, time };
        element.extra_rows(&input(q, v, &[z]), &mut extra);
        let [_, rate_x, rate_y] = rows;
        let passages = [0, 1].map(|side| ByEuler::at(&q[side], &v[side]));
        let mut out = [vec![vec![0.0; 14]; 15], vec![vec![0.0; 14]; 15]];
        for felt in 0..2 {
            for moved in 0..2 {
                let (k, c) = (&of.k.0[felt][moved], &of.c.0[felt][moved]);
                let (mut by_q, mut by_v) = ([0.0; 49], [0.0; 49]);
                let (own, other) = (&passages[felt], &passages[moved]);
                own.add_stiffness(other, k, of.damped.then_some(c), &mut by_q);
                own.add_damping(other, c, &mut by_v);
                if felt == moved {
                    own.add_bend(&of.wrenches[felt], &mut by_q);
                }
                for (out, block) in out.iter_mut().zip([&by_q, &by_v]) {
                    for (k, x) in block.iter().enumerate() {
                        out[felt * 7 + k / 7][moved * 7 + k % 7] = -x;
                    }
                }
            }
            let own = &passages[felt];
            out[0][14][felt * 7..][..7]
                .copy_from_slice(&own.position_row(&rate_x[felt], &rate_y[felt]));
            out[1][14][felt * 7..][..7].copy_from_slice(&own.force(&rate_y[felt]));
        }
        out
    }

    fn changed<T: Real>(x: &Pair<T>, column: usize, by: T) -> Pair<T> {
        let mut out = *x;
        out[column / 7][column % 7] += by;
        out
    }

    #[test] // independent truth: differences of generalized forces, and dual numbers through them
    fn blocks_are_derivatives_of_generalized_forces_for_every_p() {
        let mut random = Random::new(3);
        for _ in 0..20 {
            for element in elements(&mut random) {
                let mut q: Pair<f64> = [random.array(1.0), random.array(1.0)];
                let v: Pair<f64> = [random.array(2.0), random.array(2.0)];
                for side in &mut q {
                    let (p, length) = (random.unit::<4>(), random.range(0.7, 1.4));
                    (0..4).for_each(|k| side[3 + k] = length * p[k]);
                }
                let z = random.range(-0.5, 0.5);
                let [by_q, by_v] = blocks(&element, &q, &v, z);
                let (of_q, of_v) = (q.map(|x| x.map(Dual64::from)), v.map(|x| x.map(Dual64::from)));
                for column in 0..14 {
                    let one = Dual64::new(0.0, 1.0);
                    let near = [
                        richardson(1e-4, |s| force(&element, &changed(&q, column, s), &v, z)),
                        richardson(1e-4, |s| force(&element, &q, &changed(&v, column, s), z)),
                    ];
                    let exact = [
                        force(&element, &changed(&of_q, column, one), &of_v, z.into()),
                        force(&element, &of_q, &changed(&of_v, column, one), z.into()),
                    ];
                    for (block, (near, exact)) in
                        [&by_q, &by_v].into_iter().zip(near.iter().zip(&exact))
                    {
                        let size = block.iter().flatten().fold(1.0_f64, |m, x| m.max(x.abs()));
                        for (row, (near, exact)) in block.iter().zip(near.iter().zip(exact)) {
                            let found = row[column];
                            assert!((found - exact.eps).abs() < 1e-12 * size, "{found} {exact}");
                            assert!((found - near).abs() < 1e-7 * size, "{found} {near}");
                        }
                    }
                }
            }
        }
    }

    #[test] // independent truth: the power of the wrench
    fn generalized_forces_have_the_power_of_their_wrenches() {
        let mut random = Random::new(4);
        for _ in 0..20 {
            let (q, v): ([f64; 7], [f64; 7]) = (random.array(1.0), random.array(1.0));
            let w: [f64; 6] = random.array(3.0);
            let power = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let found = power(&ByEuler::at(&q, &v).force(&w), &v);
            let expected = power(&w, &Spatial::body(&q, &v).twist);
            assert!((found - expected).abs() < 1e-12 * (1.0 + expected.abs()));
        }
    }
}
