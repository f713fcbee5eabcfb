//! Runs that do not come on. Equations: `docs/theory/simulation.md` (8d).

/// Steps over which it is seen whether a run comes on.
const STEPS: u64 = 500;
/// Attempts at which the equations could not be evaluated, for each of these steps.
const LOST: f64 = 0.25;
/// Part of the longest step of a run that it comes on by, at most, where it stalls.
const PART: f64 = 1e-6;

/// What a run has done in the present [`STEPS`] steps.
///
/// Beside a singular configuration almost no step may be possible, and never quite none: no attempt fails for good.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stall {
    steps: u64,
    lost: u64,
    /// s
    since: f64,
}

impl Stall {
    /// The equations could not be evaluated along an attempt.
    pub(super) fn lose(&mut self) {
        self.lost += 1;
    }

    /// Counts an accepted step that ends at `t`, s, of a run whose longest one is `longest`; whether the run stalls.
    pub(super) fn step(&mut self, t: f64, longest: f64) -> bool {
        if self.steps == 0 {
            self.since = t;
        }
        self.steps += 1;
        if self.steps <= STEPS {
            return false;
        }
        let Self { lost, since, .. } = std::mem::take(self);
        lost as f64 >= LOST * STEPS as f64 && t - since < PART * longest
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: the definition
    fn only_what_is_lost_over_and_over_and_stands_still_stalls() {
        for (every, step, stalls) in [(2, 1e-12, true), (2, 1e-8, false), (100, 1e-12, false)] {
            let mut stall = Stall::default();
            let found = (0..3000).any(|k| {
                if k % every == 0 {
                    stall.lose();
                }
                stall.step(1.0 + step * f64::from(k), 0.5)
            });
            assert_eq!(found, stalls, "every {every} of {step:e} s");
        }
    }
}
