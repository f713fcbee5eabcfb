use super::line::Line;
use super::{law, quantity};
use crate::elements::body::Rigid;
use crate::elements::space::Triad;
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, LawPlace, Quantity, Wrenches,
};
use crate::math::Real;
use crate::math::vector::scaled;
use crate::model::ElasticLaw;

const QUANTITIES: &[Quantity] = &[
    quantity("length", "m", "", 1),
    quantity("rate", "m/s", "", 1),
    quantity("force", "N", "along", 1),
];

/// Translational spring-damper, planar or spatial; tension positive.
///
/// ```text
/// f = law(l − l₀) + c l̇,   w = −f l_ξᵀ
/// −w_ξ = f (l_ξᵀ)_ξ + l_ξᵀ (law' l_ξ + c l̇_ξ),   −w_y = c l_ξᵀ l_ξ
/// ```
///
/// Source: Haug (1989), 4.3 and 11.2; l and its derivatives in `line.rs`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tsda<S, const D: usize, const N: usize, const W: usize> {
    line: Line<S, D, N, W>,
    law: ElasticLaw,
    damping: f64,
    free_length: f64,
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> Tsda<S, D, N, W> {
    pub(in crate::elements) fn new(
        frames: &[Triad<D>; 2],
        law: ElasticLaw,
        damping: f64,
        free_length: f64,
    ) -> Self {
        Self { line: Line::new(frames, free_length), law, damping, free_length }
    }

    /// f and law'.
    #[inline(always)]
    fn force<T: Real>(&self, length: T, rate: T) -> (T, T) {
        let (force, slope) = law::value_and_slope(&self.law, length - self.free_length);
        (force + rate * self.damping, slope)
    }
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> ForceElement<D, N, W>
    for Tsda<S, D, N, W>
{
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, D, N, W>,
        wrenches: &mut Wrenches<T, W>,
        _z_rate: &mut [T],
    ) {
        let span = self.line.span(input.pair());
        let (pull, _) = self.force(span.length, span.rate);
        *wrenches = Line::<S, D, N, W>::rows(&span).map(|row| scaled(&row, -pull));
    }

    #[inline(always)]
    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>) {
        let damped = self.damping != 0.0;
        out.begin(damped);
        let span = self.line.span(input.pair());
        let (pull, slope) = self.force(span.length, span.rate);
        let rows = Line::<S, D, N, W>::rows(&span);
        out.wrenches = rows.map(|row| scaled(&row, -pull));
        Line::<S, D, N, W>::set_stiffness(&span, pull, slope, &mut out.k);
        if damped {
            let damping = T::from(self.damping);
            let rate_rows = Line::<S, D, N, W>::rate_rows(&span, input.pair());
            out.k.add_outer(damping, &rows, &rate_rows);
            out.c.set_outer(damping, &rows, &rows);
        }
    }

    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy {
        let span = self.line.span(input.pair());
        Energy {
            potential: law::energy(&self.law, span.length - self.free_length),
            dissipated: self.damping * span.rate * span.rate,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        law::knots_along_line(&self.law)
    }

    fn arguments(&self, input: &ForceInput<f64, D, N, W>, out: &mut [LawPlace]) {
        let span = self.line.span(input.pair());
        let turning = Line::<S, D, N, W>::turning(&span, input);
        let place = LawPlace {
            value: span.length - self.free_length,
            rate: span.rate,
            turning,
            smooth: 0.0,
        };
        out.iter_mut().for_each(|out| *out = place);
    }

    fn profile(&self, _: usize, argument: f64) -> f64 {
        law::value_and_slope(&self.law, argument).0
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]) {
        let span = self.line.span(input.pair());
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            _ => self.force(span.length, span.rate).0,
        };
    }
}
