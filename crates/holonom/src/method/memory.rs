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
    /// The length of steps that have no end.
    pub(super) barrier: Barrier,
}

/// The length of step at which attempts find no end, as iterations fail, where errors would allow it. Each time one fails again
/// it is tried anew after twice as many shorter ones, each time it serves after half as many. Source:
/// `docs/theory/method.md`, the shell.
#[derive(Debug, Clone, Copy)]
pub(super) struct Barrier {
    /// The shortest of the attempts that failed one after the other last, s; infinite where one as long has served since.
    length: f64,
    /// Accepted steps from one failure to the next attempt as long, and how many are left of them.
    patience: u32,
    left: u32,
}

impl Barrier {
    const NONE: Self = Self { length: f64::INFINITY, patience: 0, left: 0 };

    /// An attempt of length `h` has failed, perhaps right after a longer one.
    pub(super) fn fail(&mut self, h: f64, right_after: bool) {
        if right_after {
            self.length = self.length.min(h);
            return;
        }
        let again = self.length.is_finite() || self.patience > 0;
        self.patience = if again { self.patience.saturating_mul(2).max(1) } else { 0 };
        (self.length, self.left) = (h, self.patience);
    }

    /// A step of length `h` was accepted. Returns the longest one that may follow.
    pub(super) fn pass(&mut self, h: f64) -> f64 {
        if h >= self.length {
            *self = Self { patience: self.patience / 2, ..Self::NONE };
        }
        self.left = self.left.saturating_sub(1);
        match (self.patience, self.left) {
            (0, _) => f64::INFINITY,
            (_, 0) => self.length,
            _ => BELOW * self.length,
        }
    }
}

/// Part of a length that failed, which iterations are expected to serve: they contract by less than two thirds as much.
const BELOW: f64 = 0.8;

impl Default for Memory {
    fn default() -> Self {
        Self {
            history: StepHistory::default(),
            contraction: f64::INFINITY,
            eta: [1.0; MAX_SYSTEMS],
            barrier: Barrier::NONE,
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

#[cfg(test)]
mod tests {
    use super::Barrier;

    #[test]
    fn lengths_that_fail_again_are_tried_less_and_less_often() {
        // Independent truth: the rule, by hand; iterations fail from 1 s on.
        let mut barrier = Barrier::NONE;
        let mut tries = Vec::new();
        let mut h = 4.0f64;
        for step in 0..40 {
            let mut right_after = false;
            while h >= 1.0 {
                barrier.fail(h, right_after);
                tries.push(step);
                (h, right_after) = (0.5 * h, true);
            }
            h = barrier.pass(h).min(4.0 * h);
        }
        tries.dedup();
        assert_eq!(tries[..2], [0, 1], "nothing is held against a first failure");
        let apart: Vec<_> = tries.windows(2).skip(1).map(|pair| pair[1] - pair[0]).collect();
        assert!(apart.windows(2).all(|pair| pair[1] >= 2 * pair[0] - 1), "{apart:?}");
        assert!(apart.len() >= 3 && apart.len() <= 6, "{apart:?}");
        // From now on all lengths serve.
        let steps = (0..).take_while(|_| {
            let small = h < 64.0;
            h = barrier.pass(h).min(4.0 * h);
            small
        });
        assert!(steps.count() <= 40, "as many as it took to learn");
    }
}
