use super::line::Line;
use super::quantity;
use crate::elements::body::Rigid;
use crate::elements::space::Triad;
use crate::elements::{
    Energy, ExtraRows, ExtraStateScale, ForceBlocks, ForceElement, ForceInput, LawPlace, Quantity,
    Wrenches,
};
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
    fn extra_states(&self) -> usize {
        1
    }

    fn extra_state_scales(&self) -> Vec<ExtraStateScale> {
        vec![ExtraStateScale { angle: false, one: (self.damping / self.stiffness).min(1.0) }]
    }

    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, D, N, W>,
        wrenches: &mut Wrenches<T, W>,
        z_rate: &mut [T],
    ) {
        let span = self.line.span(input.pair());
        let pull = input.z[0] * self.stiffness;
        *wrenches = Line::<S, D, N, W>::rows(&span).map(|row| scaled(&row, -pull));
        z_rate[0] = span.rate - pull / self.damping;
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>) {
        out.begin(false);
        let span = self.line.span(input.pair());
        let pull = input.z[0] * self.stiffness;
        out.wrenches = Line::<S, D, N, W>::rows(&span).map(|row| scaled(&row, -pull));
        Line::<S, D, N, W>::set_stiffness(&span, pull, T::zero(), &mut out.k);
    }

    fn extra_rows<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ExtraRows<'_, T, W>) {
        let span = self.line.span(input.pair());
        let (rows, stiffness) = (Line::<S, D, N, W>::rows(&span), T::from(self.stiffness));
        out.force[0] = rows.map(|row| scaled(&row, stiffness));
        out.by_displacement[0] = Line::<S, D, N, W>::rate_rows(&span, input.pair());
        out.by_twist[0] = rows;
        (out.own[0], out.time[0]) = (-(stiffness / self.damping), T::zero());
    }

    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy {
        let force = self.stiffness * input.z[0];
        Energy {
            potential: 0.5 * force * input.z[0],
            dissipated: force * force / self.damping,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        vec![Vec::new()]
    }

    fn arguments(&self, input: &ForceInput<f64, D, N, W>, out: &mut [LawPlace]) {
        let span = self.line.span(input.pair());
        let turning = Line::<S, D, N, W>::turning(&span, input);
        let place = LawPlace { value: span.length, rate: span.rate, turning, smooth: 0.0 };
        out.iter_mut().for_each(|out| *out = place);
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]) {
        let span = self.line.span(input.pair());
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            2 => self.stiffness * input.z[0],
            _ => span.length - self.free_length - input.z[0],
        };
    }
}
