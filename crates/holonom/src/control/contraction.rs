//! How fast iterations converged.

use serde::{Deserialize, Serialize};

/// The factors θ by which corrections of converged iterations fell, the largest of each iteration. Iterations of a
/// single correction tell none, nor do corrections that are noise.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Contractions {
    /// Iterations that told theirs.
    pub count: u64,
    /// Largest of them; 0 where there is none.
    pub largest: f64,
    sum: f64,
}

impl Contractions {
    /// An iteration that converged had this factor.
    pub fn observe(&mut self, theta: f64) {
        self.count += 1;
        self.sum += theta;
        self.largest = self.largest.max(theta);
    }

    /// Of these and of others.
    #[must_use]
    pub fn plus(&self, other: &Self) -> Self {
        Self {
            count: self.count + other.count,
            largest: self.largest.max(other.largest),
            sum: self.sum + other.sum,
        }
    }

    /// Mean of them; 0 where there is none.
    pub fn mean(&self) -> f64 {
        if self.count > 0 { self.sum / self.count as f64 } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_of_a_run_add_up() {
        let of = |factors: &[f64]| {
            let mut all = Contractions::default();
            factors.iter().for_each(|&theta| all.observe(theta));
            all
        };
        let parts = of(&[0.25, 0.5]).plus(&of(&[0.125])).plus(&Contractions::default());
        assert_eq!(parts, of(&[0.25, 0.5, 0.125]));
        assert_eq!((parts.count, parts.largest, parts.mean()), (3, 0.5, 0.875 / 3.0));
        assert_eq!(Contractions::default().mean(), 0.0);
    }
}
