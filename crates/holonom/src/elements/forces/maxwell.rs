use super::line::Line;
use super::quantity;
use crate::elements::body::Rigid;
use crate::elements::space::Triad;
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
/// f = k z,   w = −f l_ξᵀ,   ż = l̇ − (k/c) z
/// −w_ξ = f (l_ξᵀ)_ξ,   −w_z = k l_ξᵀ,   ż_ξ = l̇_ξ,   ż_y = l_ξ,   ż_z = −k/c
/// ```
///
/// With the damper's extension l − l₀ − z as the state, a stiff spring would turn every error of the
/// length into a force; like this the element tends to the damper c alone as k grows, and the
/// equations with it.
///
/// Source: J. C. Maxwell's series model; l and its derivatives in `line.rs`.
#[derive(Debug, Clone, PartialEq)]
pub struct Maxwell<S, const D: usize, const N: usize, const W: usize> {
    line: Line<S, D, N, W>,
    stiffness: f64,
    damping: f64,
    free_length: f64,
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> Maxwell<S, D, N, W> {
    pub(in crate::elements) fn new(
        frames: &[Triad<D>; 2],
        stiffness: f64,
        damping: f64,
        free_length: f64,
    ) -> Self {
        Self { line: Line::new(frames, free_length), stiffness, damping, free_length }
    }
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> ForceElement<D, N, W>
    for Maxwell<S, D, N, W>
{
    fn has_extra_state(&self) -> bool {
        true
    }

    fn extra_state_scale(&self) -> f64 {
        (self.damping / self.stiffness).min(1.0)
    }

    fn evaluate<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceOutput<T, W>) {
        let span = self.line.span(input.pair());
        let pull = input.z * self.stiffness;
        out.wrenches = Line::<S, D, N, W>::rows(&span).map(|row| scaled(&row, -pull));
        out.z_rate = span.rate - pull / self.damping;
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>) {
        *out = ForceBlocks::zero();
        let span = self.line.span(input.pair());
        let stiffness = T::from(self.stiffness);
        let pull = input.z * stiffness;
        let rows = Line::<S, D, N, W>::rows(&span);
        out.wrenches = rows.map(|row| scaled(&row, -pull));
        Line::<S, D, N, W>::set_stiffness(&span, pull, T::zero(), &mut out.k);
        out.z = rows.map(|row| scaled(&row, stiffness));
        out.rate_x = Line::<S, D, N, W>::rate_rows(&span, input.pair());
        out.rate_y = rows;
        out.rate_z = -(stiffness / self.damping);
    }

    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy {
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

    fn argument(&self, _: usize, input: &ForceInput<f64, D, N, W>) -> [f64; 3] {
        let span = self.line.span(input.pair());
        [span.length, span.rate, Line::<S, D, N, W>::turning(&span, input)]
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]) {
        let span = self.line.span(input.pair());
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            2 => self.stiffness * input.z,
            _ => span.length - self.free_length - input.z,
        };
    }
}
