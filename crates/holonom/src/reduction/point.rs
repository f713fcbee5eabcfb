//! A point on the constraint manifold: a state with the factors computed there.

use super::manifold::Manifold;
use crate::error::EvaluationFailure;
use crate::system::State;

/// A state that follows from independent variables, with the factors that belong to it. It is never shared:
/// the stages of a step own one, outputs and the energy ledger another, so that what is written out
/// cannot change what is computed.
#[derive(Debug, Clone)]
pub struct Point {
    /// Factors of the last evaluation.
    pub manifold: Manifold,
    /// State of the last evaluation.
    pub state: State,
    /// ż there.
    pub z_rate: Vec<f64>,
    /// Configuration that evaluations start again from after a failure.
    pub anchor: Vec<f64>,
}

impl Point {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(mut manifold: Manifold, state: &State) -> Self {
        manifold.keep_recent();
        let z_rate = vec![0.0; state.z.len()];
        Self { manifold, state: state.clone(), z_rate, anchor: state.q.clone() }
    }

    /// A copy for evaluations beside those of steps.
    pub fn beside(&self) -> Self {
        let (state, z_rate) = (self.state.clone(), self.z_rate.clone());
        Self { manifold: self.manifold.beside(), state, z_rate, anchor: self.anchor.clone() }
    }

    /// Evaluations go on from this state, the start of a step.
    pub fn begin_step(&mut self, state: &State) {
        self.anchor.copy_from_slice(&state.q);
        self.state.q.copy_from_slice(&state.q);
        self.state.winding.copy_from_slice(&state.winding);
        self.state.ledger = state.ledger;
        self.manifold.return_to_anchor();
    }

    /// The next evaluation starts from the anchor.
    pub fn return_to_anchor(&mut self) {
        self.state.q.copy_from_slice(&self.anchor);
        self.manifold.return_to_anchor();
    }

    /// The state for independent variables `p` with their `rates` and extra states z, with accelerations
    /// if `full`, starting from the configuration of the last evaluation.
    ///
    /// # Errors
    /// Where dependent coordinates or accelerations are not found; evaluations then start from the anchor.
    pub fn evaluate(
        &mut self,
        t: f64,
        p: &[f64],
        rates: &[f64],
        z: &[f64],
        full: bool,
    ) -> Result<(), EvaluationFailure> {
        let (manifold, state) = (&mut self.manifold, &mut self.state);
        state.t = t;
        state.z.copy_from_slice(z);
        let recovered = manifold
            .recover_position(t, p, &mut state.q)
            .and_then(|()| {
                manifold.tell_turns(&mut state.winding);
                manifold.recover_velocity(t, &state.q, rates, &mut state.v, full)
            })
            .and_then(
                |()| {
                    if full { manifold.accelerate(state, &mut self.z_rate) } else { Ok(()) }
                },
            );
        if recovered.is_err() {
            // Do not carry a failed iterate into the next attempt.
            state.q.copy_from_slice(&self.anchor);
            manifold.go_back(&self.anchor);
        }
        recovered
    }

    /// A change of independent variables, their rates, and whatever follows them, on all coordinates, as
    /// [`Manifold::spread`].
    pub fn spread(
        &mut self,
        change: &[f64],
        dq: &mut [f64],
        dv: &mut [f64],
        rows: &mut [f64],
        rates: &mut [f64],
    ) {
        let (dp, rest) = change.split_at(rates.len());
        let dp_rate = &rest[..rates.len()];
        self.manifold.spread(&self.state, [dp, dp_rate], [dq, dv], [rows, rates]);
    }

    /// A change of independent variables on all coordinates, as [`Manifold::displace`].
    pub fn displace(&mut self, dp: &[f64], dq: &mut [f64], rows: &mut [f64]) {
        self.manifold.displace(&self.state.q, dp, dq, rows);
    }

    /// Multipliers of the state of the last evaluation.
    pub fn complete(&mut self) {
        self.manifold.multipliers(&mut self.state);
    }

    /// Moves references to the state last evaluated, whose independent variables are `p`, those of directions
    /// and rotations once one of them is `turn` (rad) away; returns whether the meaning of the independent
    /// variables has changed.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub fn move_references(&mut self, p: &[f64], turn: f64) -> Result<bool, EvaluationFailure> {
        // A linearization may follow at this very state, and the factors that its multipliers follow from are lost.
        if !self.manifold.has_joint_coordinates() && self.manifold.moves_references(p, turn) {
            self.complete();
        }
        self.manifold.move_references(&self.state.q, p, turn)
    }
}
