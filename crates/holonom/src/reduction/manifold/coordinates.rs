//! Joint coordinates in place of those of the system, and what of the latter waits until it is asked for.

use super::Manifold;
use crate::error::EvaluationFailure;
use crate::reduction::joint::{ReducedDerivatives, joint_form};
use crate::system::{DerivativeBlocks, State};
use crate::threads::Threads;

impl Manifold {
    /// Recovers in joint coordinates from now on, in other parametrizations too; at the configuration q whose factors
    /// are at hand. Returns whether it can: lines are no edges there, and it does not where more than `together` equations
    /// that close loops are to be solved together.
    pub fn use_joint_coordinates(&mut self, q: &[f64], together: usize) -> bool {
        self.at = q.to_vec();
        self.stale = false;
        self.moves_along = false;
        self.joint = joint_form(&self.system, self.chart.parametrization(), q)
            .filter(|form| form.largest_closure() <= together);
        if self.joint.is_some() && self.refactor_joint().is_err() {
            self.joint = None;
        }
        self.share_joint();
        self.joint.is_some()
    }

    /// These threads share accelerations in joint coordinates from now on, where there is enough of them; in other
    /// parametrizations too.
    pub fn share_among(&mut self, threads: &Threads) {
        self.threads = threads.clone();
        self.share_joint();
    }

    fn share_joint(&mut self) {
        if let Some(joint) = &mut self.joint {
            joint.share_among(&self.threads);
        }
    }

    /// Whether it does.
    pub fn has_joint_coordinates(&self) -> bool {
        self.joint.is_some()
    }

    /// Coordinates along the tree, rows of cut joints and of drivers on the tree, and entries of the factor of the composite
    /// inertia matrix, which has no fill.
    pub fn joint_sizes(&self) -> Option<[usize; 3]> {
        self.joint.as_ref().map(|joint| joint.sizes())
    }

    /// Whether derivatives at the state last evaluated come along the tree, by [`Manifold::linearize`]: its accelerations did.
    pub fn linearizes(&self) -> bool {
        self.moves_along
    }

    /// M̂, M̂₁, M̂₂ and what extra states add at the state whose accelerations were the last to be evaluated, in joint
    /// coordinates; of extra states what concerns themselves and time into `blocks`. Multipliers of closures are all that it
    /// asks the state for.
    pub fn linearize(
        &mut self,
        state: &State,
        blocks: &mut DerivativeBlocks,
        out: &mut ReducedDerivatives<'_>,
    ) {
        if let Some(joint) = &mut self.joint {
            joint.linearize(self.chart.parametrization(), state, blocks, out);
        }
    }

    /// M̂ v̈_t and ż_t at fixed v, v̇, z, at the state of the last [`Manifold::linearize`].
    pub fn time_derivative(
        &mut self,
        state: &State,
        blocks: &DerivativeBlocks,
        force: &mut [f64],
        z_rate: &mut [f64],
    ) {
        if let Some(joint) = &mut self.joint {
            joint.time_derivative(state, blocks, force, z_rate);
        }
    }

    pub(super) fn refactor_joint(&mut self) -> Result<(), EvaluationFailure> {
        let Some(joint) = &mut self.joint else { return Ok(()) };
        joint.factor(self.chart.parametrization(), &self.edges, &self.at)?;
        self.orientation = joint.determinant_sign();
        Ok(())
    }

    /// Makes chart, G and M those of the last evaluation.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub fn catch_up(&mut self) -> Result<(), EvaluationFailure> {
        if !std::mem::take(&mut self.stale) {
            return Ok(());
        }
        self.accelerator.forget();
        self.g.restore();
        self.system.constraint_jacobian(&self.at, &mut self.g);
        self.accelerator.evaluate_mass(self.system.as_ref(), &self.at);
        self.chart.refactor(self.system.as_ref(), &self.at, &self.g)
    }

    /// Condition of what independent variables and joints leave to solve for.
    pub fn condition(&mut self) -> f64 {
        match &mut self.joint {
            Some(joint) => joint.condition(),
            None => self.chart.condition(),
        }
    }
}
