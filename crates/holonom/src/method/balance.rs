//! Where a dense output is in balance, and where it need not be.

/// Most places within a step.
const MOST: usize = 3;

/// Places of a step where its dense output is in balance, as far as it is stiff, and what is between them. Source:
/// `docs/theory/method.md` (15).
#[derive(Debug, Clone, Copy)]
pub(super) struct Balance {
    /// Both ends and what is within, ascending.
    places: [f64; MOST + 2],
    count: usize,
    /// The last two within the step.
    pub(super) last: [f64; 2],
    /// Where a polynomial through all places may be farthest off: half way between two, twice.
    pub(super) between: [f64; 2],
    /// The largest Π |θ − places| within the step.
    largest: f64,
}

impl Balance {
    /// For two or three places within the step, ascending; none for others.
    pub(super) fn new(inner: &[f64]) -> Option<Self> {
        if !(2..=MOST).contains(&inner.len()) {
            return None;
        }
        let count = inner.len() + 2;
        let mut places = [1.0; MOST + 2];
        places[0] = 0.0;
        places[1..=inner.len()].copy_from_slice(inner);
        let last = [inner[inner.len() - 2], inner[inner.len() - 1]];
        let mut balance = Self { places, count, last, between: [0.0; 2], largest: 0.0 };
        let mut halves: Vec<f64> =
            places[..count].windows(2).map(|pair| 0.5 * (pair[0] + pair[1])).collect();
        halves.sort_by(|a, b| balance.product(*b).total_cmp(&balance.product(*a)));
        balance.between = [halves[0], halves[1]];
        balance.largest = (1..20).map(|k| balance.product(0.05 * f64::from(k))).fold(0.0, f64::max);
        Some(balance)
    }

    /// Π |θ − places|.
    fn product(&self, theta: f64) -> f64 {
        self.places[..self.count].iter().map(|place| (theta - place).abs()).product()
    }

    /// What a polynomial through all places misses within the step at most, over what it misses at θ, if the next power is what it lacks.
    pub(super) fn most(&self, theta: f64) -> f64 {
        self.largest / self.product(theta)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::RADAU_IIA_5;

    #[test] // truth: θ (θ − c₁)(θ − c₂)(θ − 1) itself is what a cubic through its roots lacks
    fn the_next_power_is_told_from_anywhere() {
        let c = RADAU_IIA_5.c;
        let balance = Balance::new(&c[..2]).expect("two places");
        let power = |theta: f64| (theta * (theta - c[0]) * (theta - c[1]) * (theta - 1.0)).abs();
        let most = (0..=1000).map(|k| power(1e-3 * f64::from(k))).fold(0.0, f64::max);
        for theta in [-2.0, -0.3, -1e-3, 0.4] {
            let told = balance.most(theta) * power(theta);
            assert!((0.97..=1.0).contains(&(told / most)), "{told} of {most} by {theta}");
        }
        let found = balance.between.map(|theta| power(theta) / most);
        assert!(found[0] > 0.9 && found[1] > 0.7, "{found:?} of it between places");
        assert_eq!(balance.last, [c[0], c[1]]);
        assert!(Balance::new(&c[..1]).is_none());
    }
}
