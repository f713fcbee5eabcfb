use super::{law, quantity};
use crate::elements::angle::Angle;
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, Quantity, product,
};
use crate::math::Real;
use crate::math::vector::scaled;
use crate::model::ElasticLaw;

const QUANTITIES: &[Quantity] = &[
    quantity("angle", "rad", "", 1),
    quantity("rate", "rad/s", "", 1),
    quantity("torque", "N m", "along", 1),
];

/// Rotational spring-damper, planar or about h of the first frame. Its torque t resists growing θ:
/// it acts as −t on the second body.
///
/// ```text
/// t = law(θ − θ₀) + c θ̇,   Q = −t θ_qᵀ
/// −Q_q = t θ_qq + θ_qᵀ (law' θ_q + c (θ_q v)_q),   −Q_q̇ = c θ_qᵀ θ_q
/// ```
///
/// Source: Haug (1989), 4.3 and 11.2; θ and its derivatives in `angle.rs`.
#[derive(Debug, Clone, PartialEq)]
pub struct Rsda<A> {
    pub(in crate::elements) angle: A,
    law: ElasticLaw,
    damping: f64,
    free_angle: f64,
}

impl<A> Rsda<A> {
    pub(in crate::elements) fn new(
        angle: A,
        law: ElasticLaw,
        damping: f64,
        free_angle: f64,
    ) -> Self {
        Self { angle, law, damping, free_angle }
    }

    /// t and law'.
    #[inline(always)]
    fn torque<T: Real>(&self, angle: T, rate: T) -> (T, T) {
        let (torque, slope) = law::value_and_slope(&self.law, angle - self.free_angle);
        (torque + rate * self.damping, slope)
    }
}

impl<A: Angle<N>, const N: usize> ForceElement<N> for Rsda<A> {
    fn counts_turns(&self) -> bool {
        A::COUNTS_TURNS
    }

    fn angle(&self, q: [&[f64; N]; 2], winding: f64) -> f64 {
        if A::COUNTS_TURNS { self.angle.nearest(q, winding) } else { 0.0 }
    }

    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceOutput<T, N>) {
        let gradient = self.angle.gradient(input.q);
        let angle = self.angle.nearest(input.q, input.winding);
        let (torque, _) = self.torque(angle, product(&gradient, input.v));
        out.q = gradient.map(|row| scaled(&row, -torque));
        out.z_rate = T::zero();
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceBlocks<T, N>) {
        *out = ForceBlocks::zero();
        let gradient = self.angle.gradient(input.q);
        let angle = self.angle.nearest(input.q, input.winding);
        let (torque, slope) = self.torque(angle, product(&gradient, input.v));
        self.angle.add_hessian(input.q, torque, &mut out.k);
        out.k.add_outer(slope, &gradient, &gradient);
        if self.damping != 0.0 {
            let damping = T::from(self.damping);
            out.k.add_outer(damping, &gradient, &self.angle.directional(input.q, input.v));
            out.c.add_outer(damping, &gradient, &gradient);
        }
    }

    fn energy(&self, input: &ForceInput<'_, f64, N>) -> Energy {
        let angle = self.angle.nearest(input.q, input.winding);
        let rate = product(&self.angle.gradient(input.q), input.v);
        Energy {
            potential: law::energy(&self.law, angle - self.free_angle),
            dissipated: self.damping * rate * rate,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        law::knots(&self.law)
    }

    fn argument(&self, _: usize, input: &ForceInput<'_, f64, N>) -> [f64; 3] {
        let angle = self.angle.nearest(input.q, input.winding);
        let rate = product(&self.angle.gradient(input.q), input.v);
        [angle - self.free_angle, rate, 0.0]
    }

    fn profile(&self, _: usize, argument: f64) -> f64 {
        law::value_and_slope(&self.law, argument).0
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<'_, f64, N>, out: &mut [f64]) {
        let angle = self.angle.nearest(input.q, input.winding);
        let rate = product(&self.angle.gradient(input.q), input.v);
        out[0] = match index {
            0 => angle,
            1 => rate,
            _ => self.torque(angle, rate).0,
        };
    }
}
