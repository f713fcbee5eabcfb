//! Acceptance of a step and the size of the next one.

/// How the next step follows from errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepLaw {
    /// h⁺ = h · e^(−1/k).
    Standard,
    /// h⁺ = h · e^(−1/k + 0.75 β) e₋^β: the proportional-integral law for explicit formulas.
    ProportionalIntegral {
        /// β, about 0.04 to 0.08.
        beta: f64,
    },
    /// The smaller of the standard proposal and h⁺ = h · (h/h₋) e^(−1/k) (e₋/e)^(1/k), Gustafsson's
    /// predictive law for implicit formulas.
    Predictive,
}

/// Proposes the next step from the scaled error of the last one (1 = on tolerance).
///
/// The ratio of every law is multiplied by a safety factor and clamped; k is the order of the
/// estimate plus 1, e₋ and h₋ belong to the accepted step before. After a rejection, and without
/// a step before, the law is the standard one.
/// Source: thesis (4.8); Hairer & Wanner, *Solving ODEs II*, sections IV.2 and IV.8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepControl {
    /// Order of the estimate plus 1.
    pub k: f64,
    /// Safety factor.
    pub safety: f64,
    /// Smallest ratio of a step to the one before.
    pub min_ratio: f64,
    /// Largest ratio.
    pub max_ratio: f64,
    /// Ratio after a failure of the very first step.
    pub first_ratio: f64,
    /// Ratios from 1 to this one keep the step (and with it a factorization).
    pub dead_band: f64,
    /// The law.
    pub law: StepLaw,
}

/// What a step leaves behind for the judgement of the next.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct StepHistory {
    /// Length and error of the last accepted step.
    pub accepted: Option<(f64, f64)>,
    /// Whether the attempt before this one was rejected.
    pub rejected: bool,
}

impl StepHistory {
    /// Notes an accepted step.
    pub fn accept(&mut self, step: f64, error: f64) {
        *self = Self { accepted: Some((step, error)), rejected: false };
    }

    /// Notes a rejected attempt.
    pub fn reject(&mut self) {
        self.rejected = true;
    }
}

/// Outcome of an attempt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum StepVerdict {
    /// Go on with the step `next`.
    Accept {
        /// Length of the next step.
        next: f64,
    },
    /// Try again with the step `retry`.
    Reject {
        /// Length of the next attempt.
        retry: f64,
    },
}

impl StepControl {
    /// Control of a one-step implicit formula with an estimate of order `embedded_order`.
    pub fn implicit(embedded_order: u32) -> Self {
        Self {
            k: f64::from(embedded_order) + 1.0,
            safety: 0.9,
            min_ratio: 0.25,
            max_ratio: 4.0,
            first_ratio: 0.1,
            dead_band: 1.0,
            law: StepLaw::Standard,
        }
    }

    /// Control of an explicit Runge-Kutta formula with an estimate of order `embedded_order`.
    pub fn explicit(embedded_order: u32) -> Self {
        Self {
            min_ratio: 0.2,
            max_ratio: 10.0,
            law: StepLaw::ProportionalIntegral { beta: 0.04 },
            ..Self::implicit(embedded_order)
        }
    }

    /// Judges a step of length `step` with the scaled `error`.
    pub fn judge(&self, step: f64, error: f64, history: &StepHistory) -> StepVerdict {
        let e = error.max(1e-10); // a vanishing error must not give an infinite ratio
        let standard = e.powf(-1.0 / self.k);
        let limit = |raw: f64| (self.safety * raw).clamp(self.min_ratio, self.max_ratio);
        if !error.is_finite() || error > 1.0 {
            let ratio = if history.accepted.is_none() && !history.rejected {
                self.first_ratio
            } else if error.is_finite() {
                limit(standard)
            } else {
                self.min_ratio
            };
            return StepVerdict::Reject { retry: step * ratio.min(1.0) };
        }
        let raw = match (self.law, history.accepted) {
            _ if history.rejected => standard,
            (StepLaw::Standard, _) | (_, None) => standard,
            (StepLaw::ProportionalIntegral { beta }, Some((_, before))) => {
                e.powf(0.75 * beta - 1.0 / self.k) * before.max(1e-4).powf(beta)
            }
            (StepLaw::Predictive, Some((length, before))) => {
                let trend = step / length * (before.max(1e-2) / e).powf(1.0 / self.k);
                standard * trend.min(1.0)
            }
        };
        let ratio = match limit(raw) {
            r if history.rejected => r.min(1.0), // no growth right after a failure
            r if (1.0..=self.dead_band).contains(&r) => 1.0,
            r => r,
        };
        StepVerdict::Accept { next: step * ratio }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use StepVerdict::{Accept, Reject};

    #[test]
    fn judges_a_table_of_cases() {
        let plain = StepControl::implicit(3);
        let banded = StepControl { dead_band: 1.2, ..plain };
        let predictive = StepControl { law: StepLaw::Predictive, ..plain };
        let pi = StepControl { law: StepLaw::ProportionalIntegral { beta: 0.04 }, ..plain };
        let fresh = StepHistory::default();
        let after = |step, error| StepHistory { accepted: Some((step, error)), rejected: false };
        let failed = StepHistory { rejected: true, ..after(1.0, 1.0) };
        let tiny = 1.0 / 256.0; // standard ratio 4
        for (name, control, error, history, expected) in [
            ("on tolerance", plain, 1.0, fresh, Accept { next: 0.9 }),
            ("no error at all", plain, 0.0, fresh, Accept { next: 4.0 }),
            ("first step fails", plain, 2.0, fresh, Reject { retry: 0.1 }),
            ("sixteen times too big", plain, 16.0, after(1.0, 1.0), Reject { retry: 0.45 }),
            ("hopeless", plain, 1e9, after(1.0, 1.0), Reject { retry: 0.25 }),
            ("barely too big: never grows", plain, 1.0 + 1e-9, failed, Reject { retry: 0.9 }),
            ("not a number", plain, f64::NAN, failed, Reject { retry: 0.25 }),
            ("infinite", plain, f64::INFINITY, after(1.0, 1.0), Reject { retry: 0.25 }),
            ("no growth after a failure", plain, tiny, failed, Accept { next: 1.0 }),
            ("dead band keeps the step", banded, 0.5, after(1.0, 1.0), Accept { next: 1.0 }),
            ("beyond the dead band", banded, 1.0 / 16.0, after(1.0, 1.0), Accept { next: 1.8 }),
            (
                "predictive: error grows fourfold",
                predictive,
                1.0 / 16.0,
                after(1.0, 1.0 / 64.0),
                Accept { next: 0.9 * 2.0 / 2_f64.sqrt() },
            ),
            (
                "predictive: error falls",
                predictive,
                1.0 / 16.0,
                after(1.0, 1.0),
                Accept { next: 1.8 },
            ),
            ("PI", pi, 1.0 / 16.0, after(1.0, 1.0), Accept { next: 0.9 * 16_f64.powf(0.22) }),
        ] {
            let found = control.judge(1.0, error, &history);
            assert_eq!(format!("{found:.9?}"), format!("{expected:.9?}"), "{name}");
        }
    }
}
