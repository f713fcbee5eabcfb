//! By which residuals stages are iterated: by forces or by accelerations.

/// Attempts after which forces are tried again, at most.
const LONGEST_TERM: u32 = 1024;
/// Failures that pass before the others are tried again, at most.
const MOST_PATIENCE: u32 = 63;

/// Whether residuals are accelerations. Forces are the rule: accelerations take over where iterations by forces fail with a
/// matrix of their step and converge by accelerations, and forces are tried again after one attempt by accelerations, after two
/// where they failed at once, after four, and so on. Where both fail the step is too long, which says nothing of either: then the
/// others are tried at ever fewer failures. In an attempt the choice changes once. Equations: `docs/theory/newton.md`, "By
/// forces or by accelerations".
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Residuals {
    /// By which attempts have converged, and by which this one goes.
    settled: bool,
    present: bool,
    /// This attempt has changed them.
    changed: bool,
    /// Attempts that have converged since they were settled.
    served: u32,
    /// Of accelerations, those after which forces are due.
    term: u32,
    /// Failures since both have failed, and how many are to pass.
    failures: u32,
    patience: u32,
}

impl Residuals {
    /// Nothing is known.
    pub(super) const START: Self = Self {
        settled: false,
        present: false,
        changed: false,
        served: 0,
        term: 0,
        failures: 0,
        patience: 0,
    };

    /// An attempt begins.
    pub(super) fn begin(&mut self) {
        self.changed = false;
        self.present = self.settled && (self.served < self.term || self.patience > 0);
    }

    /// Whether they are accelerations.
    pub(super) fn are_accelerations(&self) -> bool {
        self.present
    }

    /// The stages of an attempt have converged.
    pub(super) fn converge(&mut self) {
        if self.changed && self.present {
            let at_once = self.settled || self.served <= self.term;
            self.term = if at_once { (2 * self.term).clamp(1, LONGEST_TERM) } else { 1 };
            self.served = 0;
        } else if self.present != self.settled {
            self.served = 0;
        }
        self.settled = self.present;
        self.served = self.served.saturating_add(1);
        if self.changed || self.present {
            (self.failures, self.patience) = (0, 0);
        }
    }

    /// They have not, with a matrix of this step; whether they are to be tried by the others.
    pub(super) fn fail(&mut self) -> bool {
        if self.changed {
            (self.failures, self.patience) = (0, (2 * self.patience + 1).min(MOST_PATIENCE));
            return false;
        }
        self.failures += 1;
        if self.failures <= self.patience {
            return false;
        }
        (self.changed, self.present) = (true, !self.present);
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An attempt in which iterations converge or not: by forces, by accelerations. Returns by which they have, if any, and
    /// whether both were tried.
    fn attempt(rule: &mut Residuals, converges: [bool; 2]) -> (Option<bool>, bool) {
        rule.begin();
        for tries in 1..=2 {
            let by = rule.are_accelerations();
            if converges[usize::from(by)] {
                rule.converge();
                return (Some(by), tries == 2);
            }
            if !rule.fail() {
                return (None, tries == 2);
            }
        }
        panic!("more than one change in an attempt");
    }

    #[test]
    fn accelerations_take_over_where_forces_fail_and_forces_where_accelerations_do() {
        let mut rule = Residuals::START;
        let mut all = |converges, count, by| {
            for _ in 0..count {
                assert_eq!(attempt(&mut rule, converges).0, Some(by));
            }
        };
        all([true, false], 3, false);
        all([false, true], 40, true);
        all([true, false], 40, false);
        all([false, true], 1, true);
        all([true, true], 3, false);
    }

    #[test]
    fn what_fails_is_tried_ever_more_rarely() {
        // By forces again after 1, 2, 4, … attempts; and where both fail after 1, 3, 7, … failures.
        for (before, converges, most) in [
            (None, [false, true], 11),
            (None, [false, false], 14),
            (Some([false, true]), [false, false], 14),
        ] {
            let mut rule = Residuals::START;
            before.map(|converges| attempt(&mut rule, converges));
            let tried = (0..500).filter(|_| attempt(&mut rule, converges).1).count();
            assert!(tried <= most, "{before:?} {converges:?}: {tried}");
        }
    }

    #[test]
    fn where_both_fail_no_term_grows() {
        let mut rule = Residuals::START;
        attempt(&mut rule, [false, true]);
        (0..50).for_each(|_| assert_eq!(attempt(&mut rule, [false, false]).0, None));
        let back = (0..500).position(|_| attempt(&mut rule, [true, true]).0 == Some(false));
        assert!(back.is_some_and(|attempts| attempts <= 2), "{back:?}");
    }

    #[test]
    fn failures_of_forces_among_successes_make_no_try_more_often() {
        let mut rule = Residuals::START;
        let tried = (0..1000).filter(|k| attempt(&mut rule, [k % 2 == 0, false]).1).count();
        assert!(tried <= 14, "{tried}");
    }
}
