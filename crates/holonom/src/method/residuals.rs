//! By which residuals stages are iterated: by forces or by accelerations.

/// Steps after which forces are tried again, at most.
const LONGEST_TERM: u32 = 1024;
/// Failures that pass before accelerations are tried again, at most.
const MOST_PATIENCE: u32 = 63;

/// Whether residuals are accelerations. Forces are the rule: accelerations take over where iterations by forces fail with a
/// matrix of their step, and forces are tried again after one step by accelerations, after two where they failed at
/// once, after four, and so on. Where accelerations fail as well, they are tried at ever fewer failures. In an attempt the
/// choice changes once. Equations: `docs/theory/newton.md`, "By forces or by accelerations".
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Residuals {
    by_accelerations: bool,
    /// Nothing has converged by these since the last change.
    on_trial: bool,
    /// The choice has changed in this attempt.
    changed: bool,
    /// Steps since the last change.
    served: u32,
    /// Steps that accelerations serve, or have served the last time.
    term: u32,
    /// Failures by forces since accelerations have failed, and how many are to pass.
    failures: u32,
    patience: u32,
}

impl Residuals {
    /// Nothing is known.
    pub(super) const START: Self = Self {
        by_accelerations: false,
        on_trial: false,
        changed: false,
        served: 0,
        term: 0,
        failures: 0,
        patience: 0,
    };

    /// An attempt begins.
    pub(super) fn begin(&mut self) {
        self.changed = false;
        if self.by_accelerations && self.served >= self.term {
            self.turn_to(false);
        }
    }

    /// Whether they are accelerations.
    pub(super) fn are_accelerations(&self) -> bool {
        self.by_accelerations
    }

    /// The stages of an attempt have converged.
    pub(super) fn converge(&mut self) {
        self.served = self.served.saturating_add(1);
        self.on_trial = false;
        if self.by_accelerations {
            (self.failures, self.patience) = (0, 0);
        }
    }

    /// They have not, with a matrix of this step; whether they are to be tried by the others.
    pub(super) fn fail(&mut self) -> bool {
        let (first, on_trial) = (!self.changed, self.on_trial);
        if self.by_accelerations {
            if on_trial {
                self.patience = (2 * self.patience + 1).min(MOST_PATIENCE);
            }
            self.turn_to(false);
            // Those that have served until now may do so again.
            self.on_trial &= !on_trial;
            return first && !on_trial;
        }
        if !on_trial {
            self.failures += 1;
            if self.failures <= self.patience {
                return false;
            }
        }
        let at_once = self.served <= self.term;
        let term = if at_once { (2 * self.term).clamp(1, LONGEST_TERM) } else { 1 };
        self.failures = 0;
        self.turn_to(true);
        (self.term, self.on_trial) = (term, !on_trial);
        first
    }

    fn turn_to(&mut self, by_accelerations: bool) {
        *self = Self { by_accelerations, on_trial: true, changed: true, served: 0, ..*self };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Attempts, by each of which iterations converge or not: by forces, by accelerations. Returns by which they have.
    fn run(rule: &mut Residuals, attempts: &[[bool; 2]]) -> Vec<Option<bool>> {
        let attempt = |converges: &[bool; 2]| {
            rule.begin();
            let mut tries = 0;
            loop {
                tries += 1;
                assert!(tries <= 2);
                let by = rule.are_accelerations();
                if converges[usize::from(by)] {
                    rule.converge();
                    return Some(by);
                }
                if !rule.fail() {
                    return None;
                }
            }
        };
        attempts.iter().map(attempt).collect()
    }

    #[test]
    fn accelerations_take_over_where_forces_fail_and_forces_where_accelerations_do() {
        let mut rule = Residuals::START;
        assert_eq!(run(&mut rule, &[[true, false]; 3]), [Some(false); 3]);
        assert_eq!(run(&mut rule, &[[false, true]; 40]), [Some(true); 40]);
        assert_eq!(run(&mut rule, &[[true, false]; 40]), [Some(false); 40]);
        assert_eq!(run(&mut rule, &[[false, true], [true, true]]), [Some(true), Some(false)]);
    }

    /// Attempts that have tried the other residuals as well.
    fn tries(rule: &mut Residuals, attempts: usize, converges: [bool; 2]) -> usize {
        let tried = |_: &usize| {
            rule.begin();
            let first = converges[usize::from(rule.are_accelerations())];
            let again = !first && rule.fail();
            let second = again && converges[usize::from(rule.are_accelerations())];
            if first || second {
                rule.converge();
            } else if again {
                assert!(!rule.fail());
            }
            again
        };
        (0..attempts).filter(tried).count()
    }

    #[test]
    fn what_fails_is_tried_ever_more_rarely() {
        let mut rule = Residuals::START;
        // By forces again after 1, 2, 4, … steps.
        assert!(tries(&mut rule, 500, [false, true]) <= 10);
        let mut rule = Residuals::START;
        assert!(tries(&mut rule, 500, [false, false]) <= 14);
    }
}
