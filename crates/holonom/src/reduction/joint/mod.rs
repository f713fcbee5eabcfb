//! The equations in the relative coordinates of the spanning tree: joint coordinates.
//!
//! Everything between the independent variables and the motions of the bodies goes along the tree: twists outwards,
//! wrenches inwards. Joints of the tree need no equations and have no multipliers; only what closes loops does.
//! States stay poses of bodies with their rates, so that channels, outputs and restarts know nothing of it.
//!
//! Equations: `docs/theory/joint.md`; source: thesis section 3.4.3.

mod accelerations;
mod algebra;
mod articulated;
mod branched;
mod closures;
mod clusters;
mod columns;
mod derivatives;
mod directions;
mod engine;
mod form;
mod inertia;
mod interactions;
mod multipliers;
mod own_motion;
mod positions;
mod residuals;
mod small;
mod stances;
mod subtrees;
mod variation;
mod varied;

use super::parametrization::Parametrization;
use crate::error::EvaluationFailure;
use crate::system::{DerivativeBlocks, State, System};
use crate::threads::Threads;
use engine::Engine;
use std::any::Any;
use std::sync::Arc;

/// Where derivatives of the reduced equations go: square of order ndof by rows, or for each extra state one number per
/// independent variable.
#[derive(Debug)]
pub struct ReducedDerivatives<'a> {
    /// M̂.
    pub mass: &'a mut [f64],
    /// M̂₁.
    pub damping: &'a mut [f64],
    /// M̂₂.
    pub stiffness: &'a mut [f64],
    /// Ẑ.
    pub force_extra: &'a mut [f64],
    /// ż_v.
    pub extra_position: &'a mut [f64],
    /// ż_v̇.
    pub extra_velocity: &'a mut [f64],
    /// For each variable q_v, then q̇_v at fixed v̇; of bodies that it does not move they stay what they are.
    pub columns: &'a mut [f64],
}

impl ReducedDerivatives<'_> {
    fn clear(&mut self) {
        let Self { mass, damping, stiffness, force_extra, extra_position, extra_velocity, .. } =
            self;
        let all = [mass, damping, stiffness, force_extra, extra_position, extra_velocity];
        all.into_iter().for_each(|x| x.fill(0.0));
    }
}

/// Joint coordinates of one parametrization.
pub(super) trait JointForm: std::fmt::Debug + Send + Sync + Any {
    /// A copy.
    fn boxed(&self) -> Box<dyn JointForm>;

    /// Reads the coordinates of the edges from a configuration; angles on the branch of what `x` has.
    fn read(&self, parametrization: &Parametrization, q: &[f64], x: &mut [[f64; 6]]);

    /// Solves Φ(q, t) = 0, v(q) = p, going on from the evaluation nearest in time, or the last one, whose coordinates of
    /// the edges are `x`.
    ///
    /// # Errors
    /// `simulation/position-recovery`, `simulation/branch`, `simulation/chart-reach`.
    fn recover_position(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        x: &mut [[f64; 6]],
        q: &mut [f64],
    ) -> Result<u64, EvaluationFailure>;

    /// Configurations recovered before serve no longer.
    fn forget_recent(&mut self);

    /// Evaluates the columns of all coordinates at q and factors the closures.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    fn factor(
        &mut self,
        parametrization: &Parametrization,
        x: &[[f64; 6]],
        q: &[f64],
    ) -> Result<(), EvaluationFailure>;

    /// Takes over what another form of the same parametrization has factored; `false` where it is not of the same kind.
    fn take_factors(&mut self, other: &dyn JointForm) -> bool;

    /// Sign of the determinant of the closures.
    fn determinant_sign(&self) -> f64;

    /// Condition of the closures, 1-norm.
    fn condition(&mut self) -> f64;

    /// q̇ for independent rates at the configuration last factored.
    fn recover_velocity(&mut self, t: f64, p_rate: &[f64], v: &mut [f64], q: &[f64]);

    /// ψ = Dᵀ(M q̈ − Q) for independent accelerations, and ż. q̈ and the multipliers of the closures into the
    /// state, all others are zero.
    fn residual(
        &mut self,
        parametrization: &Parametrization,
        p_rate: &[f64],
        state: &mut State,
        z_rate: &mut [f64],
        psi: &mut [f64],
    );

    /// q̈ and the multipliers of what closes loops and of drivers on the tree, all others zero, and ż at a state whose
    /// velocities were just recovered; `false` where it cannot tell them.
    fn accelerate(&mut self, state: &mut State, z_rate: &mut [f64]) -> bool;

    /// v̈ of the state whose accelerations were the last to be evaluated.
    fn independent_acceleration(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        p_rate: &mut [f64],
    );

    /// Rotations are about to be measured from the configuration last factored: rates and accelerations of the state last
    /// evaluated there become those of the new coordinates. Returns whether there are any rotations.
    fn turn_rates(&mut self) -> bool;

    /// Rates and accelerations of the independent variables in the state whose accelerations were the last to be evaluated.
    fn independent_motion(
        &self,
        parametrization: &Parametrization,
        state: &State,
        motion: [&mut [f64]; 2],
    );

    /// Multipliers of the joints of the tree and of normalizations, where those of the closures are known, for the forces last
    /// evaluated; `false` where the rows of a joint do not tell them.
    fn complete_multipliers(&mut self, state: &mut State) -> bool;

    /// A change δp of independent variables on the coordinates of all bodies, δq.
    fn displace(&mut self, dp: &[f64], q: &[f64], dq: &mut [f64]);

    /// δq̇ of a change of independent variables and their rates, after [`JointForm::displace`] for the former.
    fn displace_rates(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        dp_rate: &[f64],
        dq: &[f64],
        dv: &mut [f64],
    );

    /// Joint coordinates, rows of cut joints and drivers on the tree, and entries of the factor of the composite inertia
    /// matrix.
    fn sizes(&self) -> [usize; 3];

    /// Equations in the largest of the systems that close loops, each with dependent coordinates of its own.
    fn largest_closure(&self) -> usize;

    /// These threads share accelerations from now on, where there is enough of them.
    fn share_among(&mut self, threads: &Threads);

    /// Makes room for [`JointForm::linearize`], or gives it up.
    fn keep_room_for_derivatives(&mut self, keep: bool);

    /// M̂, M̂₁, M̂₂ and what extra states add, at the state whose accelerations and multipliers of closures were the
    /// last to be told; ż_z and ż_t into `blocks`.
    fn linearize(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        blocks: &mut DerivativeBlocks,
        out: &mut ReducedDerivatives<'_>,
    );

    /// M̂ v̈_t and ż_t, the effect of explicit time at fixed v, v̇, z, at the state of the last
    /// [`JointForm::linearize`].
    fn time_derivative(
        &mut self,
        state: &State,
        blocks: &DerivativeBlocks,
        force: &mut [f64],
        z_rate: &mut [f64],
    );

    /// M̂ p at the configuration last factored.
    fn mass_times(&mut self, p: &[f64], q: &[f64], out: &mut [f64]);
}

impl Clone for Box<dyn JointForm> {
    fn clone(&self) -> Self {
        self.boxed()
    }
}

/// Joint coordinates for a parametrization by relative coordinates at a configuration; `None` where the tree has edges
/// that no screws describe (lines of fixed or free length), or another parametrization is in use.
pub(super) fn joint_form(
    system: &Arc<dyn System>,
    parametrization: &Parametrization,
    q: &[f64],
) -> Option<Box<dyn JointForm>> {
    if system.structure().sizes.is_planar() {
        let engine = Engine::<algebra::Planar, 3, 3>::new(system, parametrization, q)?;
        Some(Box::new(engine))
    } else {
        let engine = Engine::<algebra::Spatial, 7, 6>::new(system, parametrization, q)?;
        Some(Box::new(engine))
    }
}
