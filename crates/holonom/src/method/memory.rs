//! What attempts leave behind, and the judgement of the next one by it.

use super::iteration::MAX_SYSTEMS;
use super::stepper::StepperOptions;
use crate::control::{StepControl, StepHistory, StepVerdict};

/// What attempts leave behind for the judgement of later ones.
#[derive(Debug, Clone, Copy)]
pub(super) struct Memory {
    pub(super) history: StepHistory,
    /// Last known contraction θ; infinite where none is known.
    pub(super) contraction: f64,
    /// η per system of stages.
    pub(super) eta: [f64; MAX_SYSTEMS],
}

impl Default for Memory {
    fn default() -> Self {
        Self {
            history: StepHistory::default(),
            contraction: f64::INFINITY,
            eta: [1.0; MAX_SYSTEMS],
        }
    }
}

impl Memory {
    /// Whether iterations are so fast that the linearization may serve further steps.
    pub(super) fn reuses(&self, options: &StepperOptions) -> bool {
        self.contraction <= options.reuse_contraction
    }

    /// Whether the attempt is a first or a repeated one.
    pub(super) fn is_fragile(&self) -> bool {
        self.history.accepted.is_none() || self.history.rejected
    }

    /// Whether an attempt with this scaled error is accepted, and the next step. `last_stage` is the
    /// number of iterations of its last stage.
    pub(super) fn judge(
        &self,
        control: StepControl,
        options: &StepperOptions,
        h: f64,
        error: f64,
        last_stage: u32,
    ) -> StepVerdict {
        if options.fixed_step && error.is_finite() {
            return StepVerdict::Accept { next: h };
        }
        // More iterations than the shortest possible: be more careful.
        let limit = 2.0 * f64::from(options.newton.max_iterations);
        let safety = control.safety * (1.0 + limit) / (f64::from(last_stage) + limit);
        let dead_band = if self.reuses(options) { options.dead_band } else { 1.0 };
        StepControl { safety, dead_band, ..control }.judge(h, error, &self.history)
    }
}
