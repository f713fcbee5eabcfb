use super::line::Line;
use super::{law, quantity};
use crate::elements::space::{Space, Triad};
use crate::elements::{Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, Quantity};
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
/// f = law(l − l₀) + c l̇,   Q = −f l_qᵀ
/// −Q_q = f l_qq + l_qᵀ (law' l_q + c l̇_q),   −Q_q̇ = c l_qᵀ l_q
/// ```
///
/// Source: Haug (1989), 4.3 and 11.2; l and its derivatives in `line.rs`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tsda<S, const D: usize, const N: usize, const R: usize> {
    line: Line<S, D, N, R>,
    law: ElasticLaw,
    damping: f64,
    free_length: f64,
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Tsda<S, D, N, R> {
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

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> ForceElement<N>
    for Tsda<S, D, N, R>
{
    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceOutput<T, N>) {
        let span = self.line.span(input.q, input.v);
        let (force, _) = self.force(span.length, span.rate);
        out.q = span.gradient().map(|row| scaled(&row, -force));
        out.z_rate = T::zero();
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceBlocks<T, N>) {
        *out = ForceBlocks::zero();
        let span = self.line.span(input.q, input.v);
        let (force, slope) = self.force(span.length, span.rate);
        let gradient = span.gradient();
        self.line.add_stiffness(&span, input.q, force, slope, &mut out.k);
        if self.damping != 0.0 {
            let rate_gradient = self.line.rate_gradient(&span, input.q, input.v);
            let damping = T::from(self.damping);
            out.k.add_outer(damping, &gradient, &rate_gradient);
            out.c.add_outer(damping, &gradient, &gradient);
        }
    }

    fn energy(&self, input: &ForceInput<'_, f64, N>) -> Energy {
        let span = self.line.span(input.q, input.v);
        Energy {
            potential: law::energy(&self.law, span.length - self.free_length),
            dissipated: self.damping * span.rate * span.rate,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        law::knots_along_line(&self.law)
    }

    fn argument(&self, _: usize, input: &ForceInput<'_, f64, N>) -> [f64; 3] {
        let span = self.line.span(input.q, input.v);
        [span.length - self.free_length, span.rate, Line::<S, D, N, R>::turning(&span, input)]
    }

    fn profile(&self, _: usize, argument: f64) -> f64 {
        law::value_and_slope(&self.law, argument).0
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<'_, f64, N>, out: &mut [f64]) {
        let span = self.line.span(input.q, input.v);
        out[0] = match index {
            0 => span.length,
            1 => span.rate,
            _ => self.force(span.length, span.rate).0,
        };
    }
}
