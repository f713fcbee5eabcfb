//! References that move with a run, and new independent variables.

use super::Run;
use crate::error::EvaluationFailure;
use crate::reduction::{Chart, ParametrizationKind};
use crate::simulation::carried_error::CarriedError;
use crate::simulation::dense::ChartRecord;
use crate::simulation::reparametrization::{chart_by_condition, new_chart};
use crate::simulation::trajectory::EventKind;

/// The partition is left alone while the condition of [G; P] is below this.
const CONDITION_FLOOR: f64 = 10.0;
/// Largest change of a direction or rotation in a step, rad: what is about to tumble swings about a steady turn as fast as
/// it turns, which no error shows before it has grown.
pub(super) const LONGEST_TURN: f64 = 0.9;
/// References of directions and rotations move at every step; those of a multistep formula, whose history
/// would have to move along, when they are this far, rad, or where variables would be chosen anew and the same come out.
const MULTISTEP_TURN: f64 = 1.5;

impl Run<'_> {
    /// Measures relative orientations and directions from the new state, whose independent variables and
    /// slope are read anew.
    pub(super) fn move_references(&mut self) -> Result<(), EvaluationFailure> {
        self.move_references_beyond(self.longest_turn())
    }

    /// Moves them if a direction or rotation is farther than `turn`, rad, from its reference; all where it is 0.
    fn move_references_beyond(&mut self, turn: f64) -> Result<(), EvaluationFailure> {
        let ndof = self.form.second_order_split();
        let point = self.form.point_mut();
        if !point.move_references(&self.w[..ndof], turn)? {
            return Ok(());
        }
        if self.stepper.multistep() {
            self.stepper.restart();
            self.record_chart();
        }
        let (positions, rest) = self.w.split_at_mut(ndof);
        let (slope, second) = self.g.split_at_mut(ndof);
        let motion = [positions, &mut rest[..ndof], &mut second[..ndof]];
        self.form.point().manifold.independent_motion(&self.state, motion);
        slope.copy_from_slice(&rest[..ndof]);
        self.form.references_moved(&self.w);
        // Those of a multistep formula move rarely and far.
        let far = self.stepper.multistep();
        if let Some(carried) = self.carried.as_mut() {
            if far {
                carried.forget_variables();
            } else {
                // That of an explicit formula is in the variables of before.
                carried.forget_matrix();
            }
            self.express_error();
        }
        Ok(())
    }

    /// How far directions and rotations may be from their references at the end of a step, rad.
    fn longest_turn(&self) -> f64 {
        if self.stepper.multistep() { MULTISTEP_TURN } else { 0.0 }
    }

    /// Whether [`Run::move_references`] will give independent variables another meaning at the end of the step.
    pub(super) fn references_are_to_move(&self) -> bool {
        let ndof = self.form.second_order_split();
        let (manifold, turn) = (&self.form.point().manifold, self.longest_turn());
        manifold.moves_references(&self.w_end[..ndof], turn)
    }

    /// How fast directions and rotations change at the start of the step, rad/s.
    pub(super) fn turning(&self) -> f64 {
        let manifold = &self.form.point().manifold;
        let ndof = manifold.chart().ndof();
        let relatives = manifold.chart().parametrization().relatives();
        relatives.map_or(0.0, |relatives| {
            relatives.turning(self.system.as_ref(), &self.w[ndof..2 * ndof])
        })
    }

    /// Chooses another partition when the present one has become ill-conditioned.
    pub(super) fn check_parametrization(&mut self) -> Result<(), EvaluationFailure> {
        let condition = self.form.point_mut().manifold.condition();
        if let Some(last) = self.output.chunk.steps.last_mut() {
            last.condition = condition;
        }
        // What was the best of bad variables may have become good: it is not kept until it is as bad again.
        self.condition_reference = self.condition_reference.min(condition);
        let relatives = self.form.point().manifold.chart().parametrization().relatives();
        if relatives.is_some_and(|relatives| !relatives.has_alternatives) {
            return Ok(());
        }
        let grown = self.options.repartition_factor() * self.condition_reference;
        let limit = match self.options.parametrization {
            ParametrizationKind::Partitioning => grown.max(CONDITION_FLOOR),
            _ => grown,
        };
        if condition > limit {
            self.reparametrize(condition)?;
        }
        Ok(())
    }

    /// New partition at the present state.
    pub(super) fn reparametrize(&mut self, condition: f64) -> Result<(), EvaluationFailure> {
        match new_chart(self.options, &self.form.point().manifold, &self.state)? {
            Some(chart) => self.set_chart(chart),
            None => {
                self.condition_reference = condition;
                // The same variables are better where they are measured from here.
                if self.stepper.multistep() {
                    self.spread_error();
                    self.move_references_beyond(0.0)?;
                    self.begin_step();
                    self.condition_reference = self.form.point_mut().manifold.condition();
                }
                Ok(())
            }
        }
    }

    pub(super) fn set_chart(&mut self, chart: Chart) -> Result<(), EvaluationFailure> {
        self.statistics.reparametrizations += 1;
        self.note(EventKind::Reparametrization);
        let former = self.form.point().manifold.chart().parametrization();
        self.slowness.set_chart(
            self.system.as_ref(),
            Some((former, &self.state)),
            chart.parametrization(),
            &self.options.tolerance,
        );
        for recorder in std::iter::once(&mut self.recorder).chain(&mut self.inspector) {
            recorder.set_chart(chart.clone());
        }
        self.spread_error();
        self.form.point_mut().manifold.set_chart(chart);
        self.unseen_turns.forget();
        self.form.reparametrized();
        if self.stepper.explicit() {
            self.stepper.restart();
        }
        self.stepper.invalidate();
        self.begin_step();
        self.form.pack(&self.state, &mut self.w);
        self.carried.iter_mut().for_each(CarriedError::forget_variables);
        self.express_error();
        self.record_chart();
        self.evaluate_slope()?;
        self.condition_reference = self.form.point_mut().manifold.condition();
        Ok(())
    }

    /// Hands out the chart of the next steps, for dense output.
    pub(super) fn record_chart(&mut self) {
        if self.options.stores_dense_output() {
            let chart = self.chart_record();
            self.output.chunk.dense.push_chart(self.system.as_ref(), chart);
        }
    }

    /// The chart of the next steps.
    pub(super) fn chart_record(&self) -> ChartRecord {
        ChartRecord {
            t: self.state.t,
            q: self.state.q.clone(),
            forest: self.system.tree().forest.clone(),
            parametrization: self.form.point().manifold.chart().parametrization().clone(),
            follows: !self.stepper.multistep(),
            own_axes: true,
            in_second_axes: self.system.tree().in_second_axes.clone(),
        }
    }

    /// After a failed recovery, or an iteration that fails again and again: another partition at the step's start, if there is a
    /// better one. Where stiff forces keep the present one, that of the best condition.
    pub(super) fn reparametrize_at_start(&mut self) -> Result<(), EvaluationFailure> {
        self.form.begin_step(&self.state);
        self.form.pack(&self.state, &mut self.w);
        self.evaluate_slope()?;
        let condition = self.form.point_mut().manifold.condition();
        let before = self.statistics.reparametrizations;
        self.reparametrize(condition)?;
        if self.statistics.reparametrizations > before {
            return Ok(());
        }
        let manifold = &self.form.point().manifold;
        match chart_by_condition(self.options, manifold, &self.state) {
            Some(chart) => self.set_chart(chart),
            None => Ok(()),
        }
    }
}
