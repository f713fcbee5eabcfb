//! What the closures leave at a configuration, of its rates and of its accelerations, and what they exert.

use super::algebra::Algebra;
use super::closures::{Closures, Origin};
use super::engine::{Engine, add, dot, pose};
use crate::reduction::parametrization::Parametrization;
use crate::system::System;
use std::f64::consts::TAU;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// N at q.
    pub(super) fn evaluate_closures(&mut self, parametrization: &Parametrization, q: &[f64]) {
        let n = self.closures.coordinates;
        let Closures { all, matrix, .. } = &mut self.closures;
        let mut rest = self.gradients.as_mut_slice();
        for closure in all.iter() {
            let (gradient, later) = rest.split_at_mut(closure.count * 2 * N);
            rest = later;
            gradient_of(self.system.as_ref(), parametrization, closure.origin, q, gradient);
            for (at, (row, _)) in closure.rows.iter().enumerate() {
                let line = &mut matrix[(closure.first + at) * n..][..n];
                let own = &gradient[row * 2 * N..][..2 * N];
                let mut felt = [[0.0; W]; 2];
                for (side, felt) in felt.iter_mut().enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    *felt = A::wrench(pose(q, b), &self.origin[b], pose(own, side));
                }
                for &(k, side) in &closure.path {
                    line[k] = dot(&felt[side], &self.columns[k]);
                }
            }
        }
    }

    /// Residuals of the closures at a configuration: Φ, and deformations less what they should be.
    pub(super) fn evaluate_residual(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        q: &[f64],
    ) {
        let relatives = Self::relatives(parametrization);
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            match closure.origin {
                Origin::Joint(joint) => self.system.joint_value(joint, t, q, &mut value),
                Origin::Deformations(group) => {
                    let reference = &relatives.references[group];
                    self.system.relative_value(group, reference, q, &mut value[..closure.count]);
                    for &(row, k) in &closure.rows {
                        value[row] -= p[k];
                        if counts_turns(self.system.as_ref(), group) {
                            value[row] -= TAU * (value[row] / TAU).round();
                        }
                    }
                }
            }
            for (out, (row, _)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = value[*row];
            }
        }
    }

    /// Residuals of the closures' rates (`level` 1) or accelerations (2), `a` being q̇ or q̈ of all bodies, v their q̇.
    pub(super) fn evaluate_rate_residual(
        &mut self,
        parametrization: Option<&Parametrization>,
        t: f64,
        level: usize,
        p: &[f64],
        [q, v, a]: [&[f64]; 3],
    ) {
        let relatives = parametrization.map(Self::relatives);
        let mut rest = self.gradients.as_slice();
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            value.fill(0.0);
            match closure.origin {
                Origin::Joint(joint) => {
                    if level == 2 {
                        self.system.joint_curvature(joint, q, v, &mut value);
                    }
                    let row = self.system.structure().joints[joint].row;
                    value[0] -= self.system.drive(row, t)[level];
                }
                Origin::Deformations(group) => {
                    // Without references deformations are left out.
                    let Some(relatives) = relatives else { continue };
                    if level == 2 {
                        let (reference, out) =
                            (&relatives.references[group], &mut value[..closure.count]);
                        self.system.relative_curvature(group, reference, q, v, out);
                    }
                    for (row, k) in &closure.rows {
                        value[*row] -= p[*k];
                    }
                }
            }
            for (out, (row, _)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = value[*row];
                let own = &gradient[row * 2 * N..][..2 * N];
                for (side, own) in own.chunks_exact(N).enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    *out += own.iter().zip(pose::<N>(a, b)).map(|(g, a)| g * a).sum::<f64>();
                }
            }
        }
    }

    /// Adds what the joints that close loops exert to the wrenches of their bodies.
    pub(super) fn add_closure_forces(&mut self, q: &[f64], lambda: &[f64]) {
        let mut rest = self.gradients.as_slice();
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            if let Origin::Deformations(_) = closure.origin {
                continue;
            }
            for (row, global) in &closure.rows {
                let own = &gradient[row * 2 * N..][..2 * N];
                for (side, own) in own.chunks_exact(N).enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    let felt = A::wrench(pose(q, b), &self.origin[b], pose(own, 0));
                    add(&mut self.wrench[b], lambda[*global], &felt);
                }
            }
        }
    }
}

/// Gradient of a closure over the coordinates of its two bodies.
fn gradient_of(
    system: &dyn System,
    parametrization: &Parametrization,
    origin: Origin,
    q: &[f64],
    out: &mut [f64],
) {
    match origin {
        Origin::Joint(joint) => system.joint_gradient(joint, q, out),
        Origin::Deformations(group) => {
            let Some(relatives) = parametrization.relatives() else { return };
            system.relative_gradient(group, &relatives.references[group], q, out);
        }
    }
}

/// Whether a coordinate is known up to whole turns only.
pub(super) fn counts_turns(system: &dyn System, group: usize) -> bool {
    let info = &system.relative_groups()[group];
    info.kind.turns() && info.reach.is_infinite()
}
