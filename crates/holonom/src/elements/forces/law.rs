//! Elastic laws.

use crate::math::Real;
use crate::model::ElasticLaw;

/// Force (or torque) and stiffness at the deformation `x`.
#[inline(always)]
pub(super) fn value_and_slope<T: Real>(law: &ElasticLaw, x: T) -> (T, T) {
    match law {
        ElasticLaw::Linear(stiffness) => (x * *stiffness, T::from(*stiffness)),
        ElasticLaw::Table(table) => table.value_and_slope(x),
    }
}

/// Knots of the law as [`ForceElement::knots`](crate::elements::ForceElement::knots).
pub(super) fn knots(law: &ElasticLaw) -> Vec<Vec<f64>> {
    match law {
        ElasticLaw::Linear(_) => Vec::new(),
        ElasticLaw::Table(table) => vec![table.knots().to_vec()],
    }
}

/// The same where the deformation is that of a line, whose length has a cusp next to its other end whatever the law.
pub(super) fn knots_along_line(law: &ElasticLaw) -> Vec<Vec<f64>> {
    let mut all = knots(law);
    all.resize(1, Vec::new());
    all
}

/// Stored energy ∫ force dx, J.
pub(super) fn energy(law: &ElasticLaw, x: f64) -> f64 {
    match law {
        ElasticLaw::Linear(stiffness) => 0.5 * stiffness * x * x,
        ElasticLaw::Table(table) => table.integral(x),
    }
}
