use super::quantity;
use crate::elements::space::euler;
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, Quantity, product,
};
use crate::math::spatial::{
    e_transposed_slope, e_transposed_times, g_transposed_slope, g_transposed_times, rotate, slope,
};
use crate::math::{Real, TimeFunction};
use crate::model::ForceAxes;

const PLANAR: &[Quantity] = &[quantity("torque", "N m", "ground", 1)];
const SPATIAL: &[Quantity] = &[quantity("torque", "N m", "ground", 3)];

/// Planar torque on the second body, the opposite on the first: Q_θj = n(t), Q_θi = −n(t).
#[derive(Debug, Clone, PartialEq)]
pub struct PlanarTorque {
    torque: TimeFunction,
}

impl PlanarTorque {
    pub(in crate::elements) fn new(torque: &[TimeFunction; 3]) -> Self {
        Self { torque: torque[2].clone() }
    }
}

impl ForceElement<3> for PlanarTorque {
    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, 3>, out: &mut ForceOutput<T, 3>) {
        let (torque, _) = self.torque.value_and_slope(input.t);
        *out = ForceOutput::zero();
        out.q[0][2] = -torque;
        out.q[1][2] = torque;
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, 3>, out: &mut ForceBlocks<T, 3>) {
        let (_, rate) = self.torque.value_and_slope(input.t);
        *out = ForceBlocks::zero();
        out.t[0][2] = rate;
        out.t[1][2] = -rate;
    }

    fn energy(&self, input: &ForceInput<'_, f64, 3>) -> Energy {
        supplied(self, input)
    }

    fn quantities(&self) -> &'static [Quantity] {
        PLANAR
    }

    fn quantity(&self, _index: usize, input: &ForceInput<'_, f64, 3>, out: &mut [f64]) {
        out[0] = self.torque.derivatives(input.t)[0];
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.torque.breakpoints()
    }
}

/// Spatial torque on the second body, the opposite on the first.
///
/// ```text
/// ground axes   Q_pj = 2 E(p_j)ᵀ n(t)      Q_pi = −2 E(p_i)ᵀ n(t)
/// body axes     Q_pj = 2 G(p_j)ᵀ n'(t)     Q_pi = −2 E(p_i)ᵀ A(p_j) n'(t)
/// ```
///
/// Both are linear in the p they belong to; on |p| = 1 they are the virtual work n·δπ.
/// Source: Haug (1989), 11.2.
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialTorque {
    torque: [TimeFunction; 3],
    axes: ForceAxes,
}

impl SpatialTorque {
    pub(in crate::elements) fn new(torque: &[TimeFunction; 3], axes: ForceAxes) -> Self {
        Self { torque: torque.clone(), axes }
    }

    #[inline(always)]
    fn components<T: Real>(&self, t: T) -> ([T; 3], [T; 3]) {
        let mut out = ([T::zero(); 3], [T::zero(); 3]);
        for d in 0..3 {
            (out.0[d], out.1[d]) = self.torque[d].value_and_slope(t);
        }
        out
    }

    /// Q from components of the torque, in which it is linear.
    #[inline(always)]
    fn generalized<T: Real>(&self, q: [&[T; 7]; 2], n: &[T; 3]) -> [[T; 7]; 2] {
        let [first, second] = q.map(euler);
        let (on_second, ground) = match self.axes {
            ForceAxes::Ground => (e_transposed_times(&second, n), *n),
            ForceAxes::Body => (g_transposed_times(&second, n), rotate(&second, n)),
        };
        let on_first = e_transposed_times(&first, &ground);
        let mut out = [[T::zero(); 7]; 2];
        for k in 0..4 {
            out[0][3 + k] = on_first[k] * -2.0;
            out[1][3 + k] = on_second[k] * 2.0;
        }
        out
    }
}

impl ForceElement<7> for SpatialTorque {
    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, 7>, out: &mut ForceOutput<T, 7>) {
        out.q = self.generalized(input.q, &self.components(input.t).0);
        out.z_rate = T::zero();
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, 7>, out: &mut ForceBlocks<T, 7>) {
        *out = ForceBlocks::zero();
        let [first, second] = input.q.map(euler);
        let (n, rate) = self.components(input.t);
        out.t = self.generalized(input.q, &rate).map(|row| row.map(|x| -x));
        let (on_second, ground) = match self.axes {
            ForceAxes::Ground => (e_transposed_slope(&n), n),
            ForceAxes::Body => (g_transposed_slope(&n), rotate(&second, &n)),
        };
        let on_first = e_transposed_slope(&ground);
        for i in 0..4 {
            for j in 0..4 {
                out.k.0[0][0][3 + i][3 + j] = on_first[i][j] * 2.0;
                out.k.0[1][1][3 + i][3 + j] = on_second[i][j] * -2.0;
            }
        }
        if self.axes == ForceAxes::Body {
            let turn = slope(&second, &n);
            for j in 0..4 {
                let column = e_transposed_times(&first, &turn.map(|row| row[j]));
                for i in 0..4 {
                    out.k.0[0][1][3 + i][3 + j] = column[i] * 2.0;
                }
            }
        }
    }

    fn energy(&self, input: &ForceInput<'_, f64, 7>) -> Energy {
        supplied(self, input)
    }

    fn quantities(&self) -> &'static [Quantity] {
        SPATIAL
    }

    fn quantity(&self, _index: usize, input: &ForceInput<'_, f64, 7>, out: &mut [f64]) {
        let n = self.components(input.t).0;
        let ground = match self.axes {
            ForceAxes::Ground => n,
            ForceAxes::Body => rotate(&euler(input.q[1]), &n),
        };
        out[..3].copy_from_slice(&ground);
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.torque.iter().flat_map(TimeFunction::breakpoints).collect()
    }
}

/// All power of an applied force is supplied.
fn supplied<const N: usize>(
    force: &impl ForceElement<N>,
    input: &ForceInput<'_, f64, N>,
) -> Energy {
    let mut out = ForceOutput::zero();
    force.evaluate(input, &mut out);
    Energy { supplied: product(&out.q, input.v), ..Energy::default() }
}
