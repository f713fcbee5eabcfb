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
    /// Length at which iterations failed last, until a step as long is accepted.
    pub(super) failed: f64,
    /// Rates that a dense output takes for lines followed forces, when that was asked last, and were bent by much.
    pub(super) rates_follow: bool,
}

/// Contraction that steps are to have, by which the most iterations make twelve tolerances as small as they are to become.
const REFERENCE: f64 = 0.2;

impl Default for Memory {
    fn default() -> Self {
        Self {
            history: StepHistory::default(),
            contraction: f64::INFINITY,
            eta: [1.0; MAX_SYSTEMS],
            failed: f64::INFINITY,
            rates_follow: false,
        }
    }
}

impl Memory {
    /// Whether iterations are so fast that the linearization may serve further steps.
    pub(super) fn reuses(&self, options: &StepperOptions) -> bool {
        self.contraction <= options.reuse_contraction
    }

    /// The longest step that may follow an accepted one of length `h` whose iterations contracted so; 0 where it was not seen.
    /// Source: `docs/theory/control.md` (4a).
    pub(super) fn longest_after(&mut self, h: f64, contraction: f64) -> f64 {
        if h >= self.failed {
            self.failed = f64::INFINITY;
        }
        if self.failed.is_finite() && contraction > 0.0 {
            h * (REFERENCE / contraction).cbrt().max(1.0)
        } else {
            f64::INFINITY
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: contractions that grow like h³ and fail from a half on, at 1 s
    fn lengths_come_to_where_iterations_contract_as_they_are_to() {
        let contraction = |h: f64| 0.5 * h.powi(3);
        let (mut memory, mut h, mut failures) = (Memory::default(), 1e-6, 0);
        for _ in 0..60 {
            while contraction(h) > 0.5 {
                memory.failed = h;
                failures += 1;
                h *= 0.5;
            }
            h = memory.longest_after(h, contraction(h)).min(4.0 * h);
        }
        assert_eq!(failures, 1);
        assert!((h - 0.4f64.cbrt()).abs() < 1e-6, "{h}");
    }

    #[test]
    fn nothing_is_held_back_once_lengths_serve_that_failed() {
        let mut memory = Memory { failed: 1.0, ..Memory::default() };
        assert_eq!(memory.longest_after(0.5, 0.2), 0.5);
        assert!(memory.longest_after(0.5, 0.9) >= 0.5, "steps do not become shorter by it");
        assert_eq!(memory.longest_after(0.5, 0.0), f64::INFINITY);
        assert_eq!(memory.longest_after(1.0, 0.2), f64::INFINITY);
        assert_eq!(memory.longest_after(0.5, 0.2), f64::INFINITY);
    }
}
