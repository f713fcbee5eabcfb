//! When a matrix may leave out what slows iterations little, and when it is the full one.

/// Contraction from which an iteration is slow.
const SLOW: f64 = 0.3;

/// Whether linearizations are simplified. The full matrix takes over after a failed stage, or where iterations were slow in two
/// steps running. What made that necessary passes with the motion, and only the simplified matrix can tell when: it is tried
/// again after one factorization of the full one, after two where that failed at once, after four, and so on. So what is
/// spent on tries that fail is about the logarithm of what the full matrix costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Simplification {
    simplified: bool,
    /// Factorizations since the last change.
    served: u32,
    /// How many of them the full matrix serves, or has served the last time.
    term: u32,
    /// The last step was slow.
    slow: bool,
}

impl Simplification {
    /// Nothing is known.
    pub(super) const START: Self = Self { simplified: true, served: 0, term: 0, slow: false };

    /// The full matrix has served its term.
    pub(super) fn is_over(&self) -> bool {
        !self.simplified && self.served >= self.term
    }

    /// A linearization is due: whether it is to be simplified.
    pub(super) fn begin(&mut self) -> bool {
        if self.is_over() {
            *self = Self { simplified: true, served: 0, slow: false, ..*self };
        }
        self.simplified
    }

    /// The matrix is factored.
    pub(super) fn serve(&mut self) {
        self.served = self.served.saturating_add(1);
    }

    /// The next linearizations are of the full matrix.
    pub(super) fn end(&mut self) {
        let at_once = self.served <= self.term;
        let term = if at_once { self.term.saturating_mul(2) } else { 1 };
        *self = Self { simplified: false, served: 0, term, slow: false };
    }

    /// Iterations of a step with a simplified matrix converged with this factor; whether the full one takes over.
    pub(super) fn observe(&mut self, contraction: f64) -> bool {
        let was_slow = std::mem::replace(&mut self.slow, contraction > SLOW);
        let ends = was_slow && self.slow;
        if ends {
            self.end();
        }
        ends
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Factorizations up to the next simplified one, that one included.
    fn wait(rule: &mut Simplification) -> u32 {
        let mut count = 0;
        loop {
            let simplified = rule.begin();
            rule.serve();
            count += 1;
            if simplified {
                return count;
            }
        }
    }

    #[test]
    fn it_ends_after_two_slow_steps_running() {
        let mut rule = Simplification::START;
        assert_eq!(wait(&mut rule), 1);
        let ends = [0.31, 0.29, 0.31, 0.0, 0.9, 0.31].map(|theta| rule.observe(theta));
        assert_eq!(ends, [false, false, false, false, false, true]);
        assert!(!rule.begin());
    }

    #[test]
    fn tries_that_fail_at_once_are_ever_rarer() {
        let mut rule = Simplification::START;
        assert_eq!(wait(&mut rule), 1);
        let waits = [(); 4].map(|()| {
            rule.end();
            wait(&mut rule)
        });
        // One factorization of the full matrix, then two, four and eight, each with the try that follows.
        assert_eq!(waits, [2, 3, 5, 9]);
    }

    #[test]
    fn a_try_that_has_served_begins_anew() {
        let mut rule = Simplification::START;
        wait(&mut rule);
        for _ in 0..4 {
            rule.end();
            wait(&mut rule);
        }
        // As long as the full matrix served before.
        for _ in 0..8 {
            assert!(rule.begin());
            rule.serve();
        }
        rule.end();
        assert_eq!(wait(&mut rule), 2);
    }
}
