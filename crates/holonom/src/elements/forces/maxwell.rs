use super::line::Line;
use super::quantity;
use crate::elements::space::{Space, Triad};
use crate::elements::{Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, Quantity};
use crate::math::Real;
use crate::math::vector::scaled;

const QUANTITIES: &[Quantity] = &[
    quantity("length", "m", "", 1),
    quantity("rate", "m/s", "", 1),
    quantity("force", "N", "along", 1),
    quantity("damper_extension", "m", "", 1),
];

/// A spring and a damper in series, planar or spatial; extra state z: the spring's extension, m.
///
/// ```text
/// f = k z,   Q = −f l_qᵀ,   ż = l̇ − (k/c) z
/// −Q_q = f l_qq,   −Q_z = k l_qᵀ,   ż_q = l̇_q,   ż_q̇ = l_q,   ż_z = −k/c
/// ```
///
/// With the damper's extension l − l₀ − z as the state, a stiff spring would turn every error of the
/// length into a force; like this the element tends to the damper c alone as k grows, and the
/// equations with it.
///
/// Source: J. C. Maxwell's series model; l and its derivatives in `line.rs`.
#[derive(Debug, Clone, PartialEq)]
pub struct Maxwell<S, const D: usize, const N: usize, const R: usize> {
    line: Line<S, D, N, R>,
    stiffness: f64,
    damping: f64,
    free_length: f64,
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Maxwell<S, D, N, R> {
    pub(in crate::elements) fn new(
        frames: &[Triad<D>; 2],
        stiffness: f64,
        damping: f64,
        free_length: f64,
    ) -> Self {
        Self { line: Line::new(frames, free_length), stiffness, damping, free_length }
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> ForceElement<N>
    for Maxwell<S, D, N, R>
{
    fn has_extra_state(&self) -> bool {
        true
    }

    fn extra_state_scale(&self) -> f64 {
        (self.damping / self.stiffness).min(1.0)
    }

    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceOutput<T, N>) {
        let span = self.line.span(input.q, input.v);
        let force = input.z * self.stiffness;
        out.q = span.gradient().map(|row| scaled(&row, -force));
        out.z_rate = span.rate - force / self.damping;
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceBlocks<T, N>) {
        *out = ForceBlocks::zero();
        let span = self.line.span(input.q, input.v);
        let stiffness = T::from(self.stiffness);
        let force = input.z * stiffness;
        let gradient = span.gradient();
        self.line.add_stiffness(&span, input.q, force, T::zero(), &mut out.k);
        out.z = gradient.map(|row| scaled(&row, stiffness));
        out.rate_q = self.line.rate_gradient(&span, input.q, input.v);
        out.rate_v = gradient;
        out.rate_z = -(stiffness / self.damping);
    }

    fn energy(&self, input: &ForceInput<'_, f64, N>) -> Energy {
        let force = self.stiffness * input.z;
        Energy {
            potential: 0.5 * force * input.z,
            dissipated: force * force / self.damping,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }

    fn argument(&self, _: usize, input: &ForceInput<'_, f64, N>) -> [f64; 3] {
        let span = self.line.span(input.q, input.v);
        [span.length, span.rate, Line::<S, D, N, R>::turning(&span, input)]
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<'_, f64, N>, out: &mut [f64]) {
        let span = self.line.span(input.q, input.v);
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            2 => self.stiffness * input.z,
            _ => span.length - self.free_length - input.z,
        };
    }
}
