//! Joint coordinates as the manifold sees them.

use super::algebra::Algebra;
use super::closures::Origin;
use super::engine::{BodyInertia, Engine, add, pose, pose_mut};
use super::{JointForm, ReducedDerivatives};
use crate::error::EvaluationFailure;
use crate::reduction::parametrization::Parametrization;
use crate::reduction::relatives::Relatives;
use crate::system::{DerivativeBlocks, State};
use crate::threads::Threads;
use std::any::Any;

impl<A: Algebra<N, W>, const N: usize, const W: usize> JointForm for Engine<A, N, W> {
    fn boxed(&self) -> Box<dyn JointForm> {
        Box::new(self.clone())
    }

    fn recover_position(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        x: &mut [[f64; 6]],
        q: &mut [f64],
    ) -> Result<u64, EvaluationFailure> {
        let closures = &mut self.closures;
        self.recent.go_near(t, |numbers| closures.exchange(numbers), q, x);
        self.follow(parametrization, t, p, x, q)
    }

    fn forget_recent(&mut self) {
        self.recent.forget();
    }

    fn read(&self, parametrization: &Parametrization, q: &[f64], x: &mut [[f64; 6]]) {
        self.read_coordinates(parametrization, q, x);
    }

    fn factor(
        &mut self,
        parametrization: &Parametrization,
        x: &[[f64; 6]],
        q: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.recent.keep_factors(|numbers| self.closures.exchange(numbers));
        self.evaluate_columns(x, q);
        self.evaluate_closures(parametrization, q);
        self.closures.factor().map_err(|e| {
            let (group, row) = self.names[self.closures.dependent[e.column]];
            let name = Relatives::name_of(self.system.as_ref(), group, row);
            let message = format!("the joints leave `{name}` undetermined here");
            EvaluationFailure::new("simulation/singular-configuration", message).of_group(group)
        })
    }

    fn take_factors(&mut self, other: &dyn JointForm) -> bool {
        let other: &dyn Any = other;
        let Some(other) = other.downcast_ref::<Self>() else { return false };
        // Nothing but corrections of closures asks for columns before they are evaluated.
        if self.closures.rows() > 0 {
            self.copy_columns(other);
            self.closures.copy_from(&other.closures);
            self.gradients.copy_from_slice(&other.gradients);
        }
        true
    }

    fn determinant_sign(&self) -> f64 {
        self.closures.determinant_sign()
    }

    fn condition(&mut self) -> f64 {
        self.closures.condition()
    }

    fn recover_velocity(&mut self, t: f64, p_rate: &[f64], v: &mut [f64], q: &[f64]) {
        let mut rates = std::mem::take(&mut self.rates);
        self.tell(t, Some(1), p_rate, &mut rates);
        self.rows.fill(0.0);
        for closure in &self.closures.all {
            let rows = self.rows[closure.first..].iter_mut().zip(&closure.rows);
            match closure.origin {
                Origin::Joint(joint) => {
                    let Some(drive) = self.system.joint_drive(joint, t) else { continue };
                    for (out, _) in rows.filter(|(_, (row, _))| *row == 0) {
                        *out = -drive[1];
                    }
                }
                Origin::Deformations(_) => rows.for_each(|(out, (_, k))| *out = -p_rate[*k]),
            }
        }
        self.complete(&mut rates);
        self.rates = rates;
        for edge in &*self.edges {
            let b = edge.body;
            let mut relative = [0.0; W];
            let columns = &self.columns[edge.range.clone()];
            for (column, x) in columns.iter().zip(&self.rates[edge.range.clone()]) {
                add(&mut relative, *x, column);
            }
            let mut twist = relative;
            if let Some(base) = edge.base {
                add(&mut twist, 1.0, &self.twist[base]);
            }
            *pose_mut(v, b) = A::rates(pose(q, b), &self.origin[b], &twist);
            (self.relative[b], self.twist[b]) = (relative, twist);
        }
    }

    fn residual(
        &mut self,
        parametrization: &Parametrization,
        p_rate: &[f64],
        state: &mut State,
        z_rate: &mut [f64],
        psi: &mut [f64],
    ) {
        self.evaluate_forces(state, z_rate);
        let State { t, q, v, a, lambda, .. } = state;
        self.take_accelerations(parametrization, *t, p_rate, [q, v]);
        self.tell_second_rates(q, v, a);
        self.evaluate_wrenches(q, a);
        self.gather();
        self.project(psi);
        lambda.fill(0.0);
        self.tell_multipliers(lambda);
    }

    fn mass_times(&mut self, p: &[f64], q: &[f64], out: &mut [f64]) {
        let mut change = std::mem::take(&mut self.change);
        self.multiply_null_space(p, &mut change);
        let mut motion = std::mem::take(&mut self.motion);
        self.carry(&change, &mut motion);
        for (b, BodyInertia { mass, turned, .. }) in self.inertias.iter().enumerate() {
            let (q, o) = (pose(q, b), &self.origin[b]);
            self.wrench[b] = A::inertia_times(*mass, turned, q, o, &motion[b]);
        }
        self.motion = motion;
        self.change = change;
        self.gather();
        self.project(out);
    }

    fn accelerate(&mut self, state: &mut State, z_rate: &mut [f64]) -> bool {
        self.accelerations_of(state, z_rate)
    }

    fn independent_acceleration(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        p_rate: &mut [f64],
    ) {
        let still = std::mem::take(&mut self.zero_rates);
        let State { t, q, v, .. } = state;
        self.evaluate_second_residual(Some(parametrization), *t, &still, [q, v]);
        self.zero_rates = still;
        self.independent.iter().for_each(|&(k, at)| p_rate[at] = self.accelerations[k]);
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (x, (_, k)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    p_rate[*k] = *x;
                }
            }
        }
    }

    fn turn_rates(&mut self) -> bool {
        Self::turn_rates(self)
    }

    fn independent_motion(
        &self,
        parametrization: &Parametrization,
        State { q, v, a, .. }: &State,
        [p_rate, p_second]: [&mut [f64]; 2],
    ) {
        for &(k, at) in &*self.independent {
            (p_rate[at], p_second[at]) = (self.rates[k], self.accelerations[k]);
        }
        let (system, relatives) = (self.system.as_ref(), Self::relatives(parametrization));
        for closure in &self.closures.all {
            let Origin::Deformations(group) = closure.origin else { continue };
            let rows = || closure.rows.iter().copied();
            relatives.group_rates(system, group, rows(), [q, v], p_rate);
            relatives.group_rates(system, group, rows(), [q, a], p_second);
            relatives.add_group_curvature(system, group, rows(), [q, v], p_second);
        }
    }

    fn complete_multipliers(&mut self, state: &mut State) -> bool {
        self.tree_multipliers(state)
    }

    fn displace(&mut self, dp: &[f64], q: &[f64], dq: &mut [f64]) {
        Self::displace(self, dp, q, dq);
    }

    fn displace_rates(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        dp_rate: &[f64],
        dq: &[f64],
        dv: &mut [f64],
    ) {
        Self::displace_rates(self, parametrization, state, dp_rate, dq, dv);
    }

    fn share_among(&mut self, threads: &Threads) {
        Self::share_among(self, threads);
    }

    fn keep_room_for_derivatives(&mut self, keep: bool) {
        if keep {
            self.make_room_for_derivatives();
        } else {
            self.derivatives = None;
        }
    }

    fn linearize(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        blocks: &mut DerivativeBlocks,
        out: &mut ReducedDerivatives<'_>,
    ) {
        self.linearize_motion(parametrization, state, blocks, out);
    }

    fn time_derivative(
        &mut self,
        state: &State,
        blocks: &DerivativeBlocks,
        force: &mut [f64],
        z_rate: &mut [f64],
    ) {
        self.vary_time(state, blocks, force, z_rate);
    }

    fn sizes(&self) -> [usize; 3] {
        self.matrix_sizes()
    }

    fn largest_closure(&self) -> usize {
        self.closures.largest()
    }
}
