//! First variations of motions with independent variables and their rates.

use super::algebra::Algebra;
use super::closures::Origin;
use super::engine::{Engine, add, pose, pose_mut};
use super::residuals::{gradient_of, on_motions};
use super::stances::Variation;
use crate::reduction::parametrization::Parametrization;
use crate::system::State;

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// δq of δv; keeps the displacements of the coordinates in `change` and those of bodies in `motion`.
    pub(super) fn displace(&mut self, dp: &[f64], q: &[f64], dq: &mut [f64]) {
        let mut change = std::mem::take(&mut self.change);
        self.multiply_null_space(dp, &mut change);
        let mut motion = std::mem::take(&mut self.motion);
        self.carry(&change, &mut motion);
        for (b, twist) in motion.iter().enumerate() {
            *pose_mut(dq, b) = A::rates(pose(q, b), &self.origin[b], twist);
        }
        self.motion = motion;
        self.change = change;
    }

    /// δq̇ of δv and δv̇ after [`Engine::displace`] of the same δv.
    pub(super) fn displace_rates(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        dp_rate: &[f64],
        dq: &[f64],
        dv: &mut [f64],
    ) {
        let mut rates = std::mem::take(&mut self.rate_change);
        self.tell(0.0, None, dp_rate, &mut rates);
        for at in 0..self.edges.len() {
            self.bias_change[at] = self.column_change(at, &self.motion, &self.change);
        }
        self.change_twists(&rates);
        if self.closures.rows() > 0 {
            self.evaluate_rate_change(parametrization, state, dp_rate, dq);
            self.closures.solve(&mut self.rows);
            for (x, &k) in self.rows.iter().zip(&self.closures.dependent) {
                rates[k] = *x;
            }
            self.change_twists(&rates);
        }
        self.rate_change = rates;
        for b in 0..self.twist_change.len() {
            *pose_mut(dv, b) = self.changed_rates(b, &state.q, dq);
        }
    }

    /// Changes of twists for those of the coordinates' rates.
    fn change_twists(&mut self, rates: &[f64]) {
        for (edge, bias) in self.edges.iter().zip(&self.bias_change) {
            let mut change = edge.base.map_or([0.0; W], |base| self.twist_change[base]);
            add(&mut change, 1.0, bias);
            for k in edge.range.clone() {
                add(&mut change, rates[k], &self.columns[k]);
            }
            self.twist_change[edge.body] = change;
        }
    }

    /// δq̇ of a body.
    fn changed_rates(&self, b: usize, q: &[f64], dq: &[f64]) -> [f64; N] {
        let own = A::rates(pose(q, b), &self.origin[b], &self.twist_change[b]);
        let moved = A::rates_change(pose(dq, b), &self.twist[b]);
        std::array::from_fn(|i| own[i] + moved[i])
    }

    /// Changes of the closures' rates with δq and δq̇, less what those of deformations should be.
    fn evaluate_rate_change(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        dp_rate: &[f64],
        dq: &[f64],
    ) {
        let Some(relatives) = parametrization.relatives() else { return };
        self.evaluate_motions(Variation::OfVariables);
        let mut value = [0.0; 6];
        let [mut gradient, mut bend, mut bend_rate] = [[0.0; 6 * 14]; 3];
        for closure in &self.closures.all {
            if let Some(rows) = on_motions(self.system.as_ref(), closure.origin) {
                let motions = self.motions_of(closure);
                rows.rate_changes(self.stances_of(closure), motions, &mut value);
            } else {
                let size = closure.count * 2 * N;
                let (gradient, bend) = (&mut gradient[..size], &mut bend[..size]);
                let (system, q) = (self.system.as_ref(), &state.q);
                gradient_of(system, Some(parametrization), closure.origin, q, gradient);
                match closure.origin {
                    Origin::Joint(joint) => {
                        system.joint_blocks(joint, state, bend, &mut bend_rate[..size]);
                    }
                    Origin::Deformations(group) => {
                        let reference = &relatives.references[group];
                        system.relative_rate_gradient(group, reference, q, &state.v, bend);
                    }
                }
                for (row, _) in &closure.rows {
                    value[*row] = 0.0;
                    for (side, end) in closure.ends.iter().enumerate() {
                        let Some(b) = *end else { continue };
                        let range = row * 2 * N + side * N..row * 2 * N + (side + 1) * N;
                        let dv = self.changed_rates(b, q, dq);
                        let dq: &[f64; N] = pose(dq, b);
                        let bent = bend[range.clone()].iter().zip(dq).map(|(a, x)| a * x);
                        let along = gradient[range].iter().zip(&dv).map(|(a, x)| a * x);
                        value[*row] += bent.sum::<f64>() + along.sum::<f64>();
                    }
                }
            }
            for (out, (row, k)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = match closure.origin {
                    Origin::Joint(_) => value[*row],
                    Origin::Deformations(_) => value[*row] - dp_rate[*k],
                };
            }
        }
    }
}
