//! References of relative coordinates, which move with a run.

use super::Manifold;
use crate::error::EvaluationFailure;

impl Manifold {
    /// Recoveries go on from the configuration that references were last moved to.
    pub fn return_to_anchor(&mut self) {
        self.recent.forget();
        if let Some(joint) = &mut self.joint {
            joint.forget_recent();
        }
        self.returned = true;
        if let Some(relatives) = self.chart.parametrization().relatives() {
            for (x, anchor) in self.edges.iter_mut().zip(&relatives.anchors) {
                *x = anchor.x;
            }
        }
    }

    /// Windings that follow the edges of the forest, at the last recovery.
    pub fn tell_turns(&self, winding: &mut [f64]) {
        if let Some(relatives) = self.chart.parametrization().relatives() {
            relatives.tell_turns(self.system.as_ref(), &self.edges, winding);
        }
    }

    /// Whether [`Manifold::move_references`] gives independent variables another meaning.
    pub fn moves_references(&self, p: &[f64], turn: f64) -> bool {
        self.chart.parametrization().relatives().is_some_and(|relatives| {
            relatives.moves && (turn == 0.0 || relatives.turning(self.system.as_ref(), p) > turn)
        })
    }

    /// Moves references to the configuration q last recovered, whose independent variables are `p`; those of
    /// directions and rotations once one of them is `turn` (rad) away. Returns whether v has changed.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub fn move_references(
        &mut self,
        q: &[f64],
        p: &[f64],
        turn: f64,
    ) -> Result<bool, EvaluationFailure> {
        let system = self.system.as_ref();
        let Some(relatives) = self.chart.relatives_mut() else { return Ok(false) };
        self.recent.forget();
        if let Some(joint) = &mut self.joint {
            joint.forget_recent();
        }
        let turning = turn == 0.0 || relatives.turning(system, p) > turn;
        relatives.move_references(system, q, Some(p), &mut self.edges, turning);
        if turning {
            self.anchored.copy_from_slice(q);
        } else {
            self.anchored.fill(f64::NAN);
        }
        let changed = relatives.moves && turning;
        if let Some(joint) = &mut self.joint {
            if (turning && joint.turn_rates()) || changed || self.at != q {
                self.at.copy_from_slice(q);
                self.stale = true;
                self.refactor_joint()?;
            }
            return Ok(changed);
        }
        if !changed {
            return Ok(false);
        }
        self.accelerator.forget();
        self.chart.refactor(system, q, &self.g)?;
        self.orientation = self.chart.determinant_sign();
        Ok(true)
    }

    /// Takes over the references of another manifold in the same parametrization, and what it has factored: what was evaluated
    /// here before leaves no trace.
    pub fn follow(&mut self, other: &Self) {
        let from = other.chart.parametrization().relatives();
        if let (Some(from), Some(to)) = (from, self.chart.relatives_mut()) {
            to.references.copy_from_slice(&from.references);
            to.anchors.copy_from_slice(&from.anchors);
            self.anchored.copy_from_slice(&other.anchored);
        }
        self.orientation = if other.joint.is_some() { 0.0 } else { other.orientation };
        if let (Some(own), Some(joint)) = (&mut self.joint, &other.joint)
            && own.take_factors(joint.as_ref())
        {
            self.at.copy_from_slice(&other.at);
            self.stale = true;
            self.orientation = own.determinant_sign();
        }
        if self.joint.is_none() && other.joint.is_none() {
            self.accelerator.forget();
            self.chart.copy_from(&other.chart);
        }
        self.return_to_anchor();
    }

    /// Stands where a step of another run began: at time t and the configuration q with its windings and
    /// independent variables `p`. References move there, those of directions and rotations if `turning`:
    /// directions then have these normals.
    ///
    /// # Errors
    /// `simulation/chart-reach`, `simulation/singular-configuration`.
    pub fn stand_at(
        &mut self,
        t: f64,
        q: &[f64],
        p: &[f64],
        winding: &[f64],
        turning: bool,
        normals: impl Iterator<Item = (usize, [f64; 3])>,
    ) -> Result<(), EvaluationFailure> {
        let system = self.system.as_ref();
        self.anchored.fill(f64::NAN);
        if let Some(relatives) = self.chart.relatives_mut() {
            relatives.tell_branches(system, t, p, winding, &mut self.edges)?;
            relatives.move_references(system, q, Some(p), &mut self.edges, turning);
            for (group, normal) in normals {
                relatives.references[group][3..].copy_from_slice(&normal);
            }
        }
        self.factor_at(q)?;
        self.orientation = self.chart.determinant_sign();
        self.return_to_anchor();
        Ok(())
    }
}
