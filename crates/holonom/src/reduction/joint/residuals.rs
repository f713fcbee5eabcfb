//! What the closures leave at a configuration, of its rates and of its accelerations, and what they exert.

use super::algebra::Algebra;
use super::closures::{Closure, Origin};
use super::engine::{Engine, add, dot, pose};
use super::stances::Variation;
use crate::math::vector::difference;
use crate::reduction::parametrization::Parametrization;
use crate::system::{MotionRows, System};
use std::f64::consts::TAU;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// N at q.
    pub(super) fn evaluate_closures(&mut self, parametrization: &Parametrization, q: &[f64]) {
        let mut matrix = std::mem::take(&mut self.closures.matrix);
        let mut gradients = std::mem::take(&mut self.gradients);
        let mut rest = gradients.as_mut_slice();
        let mut felt = [[[0.0; W]; 2]; MOST_ROWS];
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at_mut(closure.count * 2 * N);
            rest = later;
            self.evaluate_rows(Some(parametrization), closure, q, gradient, &mut felt);
            let columns = matrix[closure.start..].chunks_exact_mut(closure.rows.len().max(1));
            for (out, &(k, side)) in columns.zip(&closure.path) {
                let column = &self.columns[k];
                for (out, (row, _)) in out.iter_mut().zip(&closure.rows) {
                    *out = dot(&felt[*row][side], column);
                }
            }
        }
        (self.closures.matrix, self.gradients) = (matrix, gradients);
    }

    /// Wrenches of the rows of a closure on its bodies, about their reference points; `gradient` is overwritten
    /// where they come from one over the coordinates of poses.
    fn evaluate_rows(
        &self,
        parametrization: Option<&Parametrization>,
        closure: &Closure,
        q: &[f64],
        gradient: &mut [f64],
        felt: &mut [[[f64; W]; 2]; MOST_ROWS],
    ) {
        if let Some(rows) = on_motions(self.system.as_ref(), closure.origin) {
            let stances = self.stances_of(closure);
            let mut wrenches = [[[[0.0; 3]; 2]; 2]; MOST_ROWS];
            rows.wrenches(stances, &mut wrenches);
            for (side, end) in closure.ends.iter().enumerate() {
                let Some(b) = *end else { continue };
                let arm = difference(&stances[side].place, &self.origin[b]);
                for (row, _) in &closure.rows {
                    felt[*row][side] = A::about(&wrenches[*row][side], &arm);
                }
            }
            return;
        }
        gradient_of(self.system.as_ref(), parametrization, closure.origin, q, gradient);
        for (row, _) in &closure.rows {
            let own = &gradient[row * 2 * N..][..2 * N];
            for (side, end) in closure.ends.iter().enumerate() {
                let Some(b) = *end else { continue };
                felt[*row][side] = A::wrench(pose(q, b), &self.origin[b], pose(own, side));
            }
        }
    }

    /// Residuals of the closures of open clusters at a configuration: Φ, and deformations less what they should be. How
    /// bodies stand must belong to it.
    pub(super) fn evaluate_residual(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        q: &[f64],
    ) {
        let relatives = Self::relatives(parametrization);
        let system = self.system.as_ref();
        let mut value = [0.0; MOST_ROWS];
        for closure in self.closures.all.iter().filter(|closure| self.closures.is_open(closure)) {
            match (closure.origin, on_motions(system, closure.origin)) {
                (Origin::Joint(joint), Some(rows)) => {
                    rows.value_at(self.stances_of(closure), &mut value);
                    value[0] -= system.joint_drive(joint, t).map_or(0.0, |s| s[0]);
                }
                (Origin::Joint(joint), None) => system.joint_value(joint, t, q, &mut value),
                (Origin::Deformations(_), Some(rows)) => {
                    rows.value_at(self.stances_of(closure), &mut value);
                    closure.rows.iter().for_each(|&(row, k)| value[row] -= p[k]);
                }
                (Origin::Deformations(group), None) => {
                    let reference = &relatives.references[group];
                    system.relative_value(group, reference, q, &mut value[..closure.count]);
                    for &(row, k) in &closure.rows {
                        value[row] -= p[k];
                        if counts_turns(system, group) {
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

    /// Accelerations of all coordinates and bodies for those of the independent variables.
    pub(super) fn take_accelerations(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        [q, v]: [&[f64]; 2],
    ) {
        let mut accelerations = std::mem::take(&mut self.accelerations);
        self.tell(t, Some(2), p, &mut accelerations);
        self.accelerations = accelerations;
        self.evaluate_bias();
        self.evaluate_twist_rates();
        if self.closures.rows() > 0 {
            self.evaluate_second_residual(Some(parametrization), t, p, [q, v]);
            self.closures.solve(&mut self.rows);
            for (x, &k) in self.rows.iter().zip(&self.closures.dependent) {
                self.accelerations[k] = *x;
            }
            self.evaluate_twist_rates();
        }
    }

    /// Residuals of the closures' accelerations for the present twists and their rates, v being q̇ of all bodies, less
    /// what those of deformations should be.
    pub(super) fn evaluate_second_residual(
        &mut self,
        parametrization: Option<&Parametrization>,
        t: f64,
        p: &[f64],
        [q, v]: [&[f64]; 2],
    ) {
        self.evaluate_motions(Variation::OfTime);
        let relatives = parametrization.map(Self::relatives);
        let system = self.system.as_ref();
        let mut rest = self.gradients.as_slice();
        let mut value = [0.0; MOST_ROWS];
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            if matches!(closure.origin, Origin::Deformations(_)) && relatives.is_none() {
                // Without references deformations are left out.
                continue;
            }
            if let Some(rows) = on_motions(system, closure.origin) {
                let motions = self.motions_of(closure);
                rows.rate_changes(self.stances_of(closure), motions, &mut value);
            } else {
                match (closure.origin, relatives) {
                    (Origin::Deformations(group), Some(relatives)) => {
                        let out = &mut value[..closure.count];
                        system.relative_curvature(group, &relatives.references[group], q, v, out);
                    }
                    (Origin::Joint(joint), _) => system.joint_curvature(joint, q, v, &mut value),
                    _ => {}
                }
                for (side, end) in closure.ends.iter().enumerate() {
                    let Some(b) = *end else { continue };
                    let (y, yd) = (&self.twist[b], &self.twist_rate[b]);
                    let a = A::second_rates(pose(q, b), pose(v, b), &self.origin[b], y, yd);
                    for (row, _) in &closure.rows {
                        let own: &[f64; N] = pose(&gradient[row * 2 * N..], side);
                        value[*row] += own.iter().zip(&a).map(|(g, a)| g * a).sum::<f64>();
                    }
                }
            }
            match closure.origin {
                Origin::Joint(joint) => {
                    value[0] -= system.joint_drive(joint, t).map_or(0.0, |s| s[2]);
                }
                Origin::Deformations(_) => closure.rows.iter().for_each(|(row, k)| {
                    value[*row] -= p[*k];
                }),
            }
            for (out, (row, _)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = value[*row];
            }
        }
    }

    /// Adds what the joints that close loops exert to the wrenches of their bodies.
    pub(super) fn add_closure_forces(&mut self, q: &[f64], lambda: &[f64]) {
        let mut wrench = std::mem::take(&mut self.wrench);
        let mut felt = [[[0.0; W]; 2]; MOST_ROWS];
        let mut gradient = [0.0; MOST_ROWS * 14];
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                continue;
            }
            let gradient = &mut gradient[..closure.count * 2 * N];
            self.evaluate_rows(None, closure, q, gradient, &mut felt);
            for (row, global) in &closure.rows {
                for (side, end) in closure.ends.iter().enumerate() {
                    let Some(b) = *end else { continue };
                    add(&mut wrench[b], lambda[*global], &felt[*row][side]);
                }
            }
        }
        self.wrench = wrench;
    }
}

/// Most rows of an element.
pub(super) const MOST_ROWS: usize = 6;

/// Rows of a closure from how its bodies stand and move, where these tell them.
pub(super) fn on_motions(system: &dyn System, origin: Origin) -> Option<&dyn MotionRows> {
    match origin {
        Origin::Joint(joint) => system.joint_on_motions(joint),
        Origin::Deformations(group) => system.relative_on_motions(group),
    }
}

/// Gradient of a closure over the coordinates of its two bodies.
pub(super) fn gradient_of(
    system: &dyn System,
    parametrization: Option<&Parametrization>,
    origin: Origin,
    q: &[f64],
    out: &mut [f64],
) {
    match origin {
        Origin::Joint(joint) => system.joint_gradient(joint, q, out),
        Origin::Deformations(group) => {
            let Some(relatives) = parametrization.and_then(Parametrization::relatives) else {
                return;
            };
            system.relative_gradient(group, &relatives.references[group], q, out);
        }
    }
}

/// Whether a coordinate is known up to whole turns only.
pub(super) fn counts_turns(system: &dyn System, group: usize) -> bool {
    let info = &system.relative_groups()[group];
    info.kind.turns() && info.reach.is_infinite()
}
