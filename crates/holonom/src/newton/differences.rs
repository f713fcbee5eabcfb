//! The integration Jacobian by differences of accelerations.

use super::blocks::ReducedBlocks;
use crate::error::EvaluationFailure;
use crate::reduction::{Manifold, Point, Projection};
use crate::system::Measure;

/// Forward differences over the entries of w = (v, v̇, z):
///
/// ```text
/// M̂₂ = −M̂ v̈_v   M̂₁ = −M̂ v̈_v̇   Ẑ = −M̂ v̈_z   ż_v, ż_v̇, ż_z
/// ```
///
/// The increment is √ε of the entry, or of a metre scaled to the model, a radian, or either per
/// second where the entry is smaller. A linearization takes 2·ndof + n_z + 1 evaluations.
#[derive(Debug, Clone)]
pub(super) struct Differences {
    /// What counts as a movement of size one, per entry of v.
    scale: Vec<f64>,
    point: Vec<f64>,
    base: Vec<f64>,
    base_z_rate: Vec<f64>,
    base_v: Vec<f64>,
    slope: Vec<f64>,
}

impl Differences {
    pub(super) fn new(manifold: &Manifold) -> Self {
        let system = manifold.system();
        let sizes = system.structure().sizes;
        let ndof = manifold.chart().ndof();
        let parametrization = manifold.chart().parametrization();
        let scale = |k: usize| match parametrization.measure(system.as_ref(), k) {
            Measure::Length => system.characteristic_length(),
            Measure::Angle => 1.0,
        };
        let scale = match &parametrization.projection {
            Projection::Basis(_) => vec![1.0; ndof],
            _ => (0..ndof).map(scale).collect(),
        };
        Self {
            scale,
            point: vec![0.0; 2 * ndof + sizes.extra_states],
            base: vec![0.0; ndof],
            base_z_rate: vec![0.0; sizes.extra_states],
            base_v: vec![0.0; sizes.coordinates],
            slope: vec![0.0; ndof],
        }
    }

    /// Fills `blocks` and q̇_v at fixed v̇ at a complete point, whose independent variables, rates and
    /// extra states are `w`, and leaves the point there.
    pub(super) fn evaluate(
        &mut self,
        b: &mut ReducedBlocks,
        rate_map: &mut [f64],
        point: &mut Point,
        w: &[f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = self.base.len();
        b.evaluate_mass(&mut point.manifold);
        point.manifold.independent_acceleration(&point.state, &mut self.base);
        self.base_z_rate.copy_from_slice(&point.z_rate);
        self.base_v.copy_from_slice(&point.state.v);
        self.point.copy_from_slice(w);
        for k in 0..w.len() {
            let size = if k < 2 * ndof { self.scale[k % ndof] } else { 1.0 };
            let moved = w[k] + f64::EPSILON.sqrt() * w[k].abs().max(size);
            let inverse = 1.0 / (moved - w[k]);
            self.point[k] = moved;
            evaluate(point, &self.point, ndof)?;
            self.point[k] = w[k];
            point.manifold.independent_acceleration(&point.state, &mut self.slope);
            for (slope, base) in self.slope.iter_mut().zip(&self.base) {
                *slope = -inverse * (*slope - base);
            }
            for (row, mass) in b.mass.chunks_exact(ndof.max(1)).enumerate() {
                let x = mass.iter().zip(&self.slope).map(|(m, s)| m * s).sum();
                match k {
                    k if k < ndof => b.stiffness[row * ndof + k] = x,
                    k if k < 2 * ndof => b.damping[row * ndof + k - ndof] = x,
                    k => b.force_extra[(k - 2 * ndof) * ndof + row] = x,
                }
            }
            for (j, (rate, base)) in point.z_rate.iter().zip(&self.base_z_rate).enumerate() {
                let x = inverse * (rate - base);
                match k {
                    k if k < ndof => b.extra_position[j * ndof + k] = x,
                    k if k < 2 * ndof => b.extra_velocity[j * ndof + k - ndof] = x,
                    // Those of different elements do not act on each other directly.
                    k => {
                        if let Some(entry) = b.extra_extra.entry_mut(j, k - 2 * ndof) {
                            *entry = x;
                        }
                    }
                }
            }
            if k < ndof {
                let column = rate_map[k..].iter_mut().step_by(ndof);
                for (out, (v, base)) in column.zip(point.state.v.iter().zip(&self.base_v)) {
                    *out = inverse * (v - base);
                }
            }
        }
        if !w.is_empty() {
            // The factors of the point itself are wanted by what follows.
            point.return_to_anchor();
            evaluate(point, w, ndof)?;
            point.complete();
        }
        Ok(())
    }
}

/// The point at the same time with independent variables, rates and extra states `w`.
fn evaluate(point: &mut Point, w: &[f64], ndof: usize) -> Result<(), EvaluationFailure> {
    let (positions, rest) = w.split_at(ndof);
    let (rates, z) = rest.split_at(ndof);
    point.evaluate(point.state.t, positions, rates, z, true)
}
