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
];

/// A spring and a damper in series, planar or spatial; extra state z: the damper's extension, m.
///
/// ```text
/// f = k (l − l₀ − z),   Q = −f l_qᵀ,   ż = f / c
/// −Q_q = f l_qq + k l_qᵀ l_q,   −Q_z = −k l_qᵀ,   ż_q = (k/c) l_q,   ż_z = −k/c
/// ```
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

    #[inline(always)]
    fn force<T: Real>(&self, length: T, z: T) -> T {
        (length - self.free_length - z) * self.stiffness
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> ForceElement<N>
    for Maxwell<S, D, N, R>
{
    fn has_extra_state(&self) -> bool {
        true
    }

    fn unloaded_state(&self, q: [&[f64; N]; 2]) -> f64 {
        self.line.length(q) - self.free_length
    }

    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceOutput<T, N>) {
        let span = self.line.span(input.q, input.v);
        let force = self.force(span.length, input.z);
        out.q = span.gradient().map(|row| scaled(&row, -force));
        out.z_rate = force / self.damping;
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceBlocks<T, N>) {
        *out = ForceBlocks::zero();
        let span = self.line.span(input.q, input.v);
        let force = self.force(span.length, input.z);
        let stiffness = T::from(self.stiffness);
        let ratio = stiffness / self.damping;
        let gradient = span.gradient();
        self.line.add_stiffness(&span, input.q, force, stiffness, &mut out.k);
        out.z = gradient.map(|row| scaled(&row, -stiffness));
        out.rate_q = gradient.map(|row| scaled(&row, ratio));
        out.rate_z = -ratio;
    }

    fn energy(&self, input: &ForceInput<'_, f64, N>) -> Energy {
        let force = self.force(self.line.length(input.q), input.z);
        Energy {
            potential: 0.5 * force * force / self.stiffness,
            dissipated: force * force / self.damping,
            supplied: 0.0,
        }
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<'_, f64, N>, out: &mut [f64]) {
        let span = self.line.span(input.q, input.v);
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            _ => self.force(span.length, input.z),
        };
    }
}
