//! When a simplified Newton iteration has converged, and when to give it up.

/// Constants of the iteration test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonControl {
    /// Allowed iteration error in units of the tolerance; 0 iterates to round-off.
    pub kappa: f64,
    /// Largest number of iterations.
    pub max_iterations: u32,
    /// Contraction θ from which the iteration counts as divergent.
    pub divergence: f64,
}

impl Default for NewtonControl {
    /// Values of Hairer & Wanner's code SDIRK4.
    fn default() -> Self {
        Self { kappa: 0.03, max_iterations: 7, divergence: 0.99 }
    }
}

impl NewtonControl {
    /// Iterates until corrections stop falling: for fixed steps and order studies.
    pub fn to_round_off() -> Self {
        Self { kappa: 0.0, max_iterations: 50, divergence: 0.99 }
    }
}

/// What to do after a correction has been applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum IterationVerdict {
    /// Iterate again.
    Continue,
    /// The iterate is good enough.
    Converged,
    /// Corrections do not fall; halve the step.
    Diverged,
    /// The allowed error will not be met within the limit; multiply the step by `ratio`.
    Slow {
        /// Factor for the step, below 1.
        ratio: f64,
    },
}

/// Judges one iteration from the weighted norms of its corrections δ⁽¹⁾, δ⁽²⁾, …
///
/// ```text
/// θₖ = ‖δ⁽ᵏ⁾‖ / ‖δ⁽ᵏ⁻¹⁾‖        ηₖ = θₖ / (1 − θₖ)        stop: ηₖ ‖δ⁽ᵏ⁾‖ ≤ κ
/// give up: θₖ ≥ 0.99, or θₖ^(k_max−k) / (1 − θₖ) ‖δ⁽ᵏ⁾‖ > κ
/// ```
///
/// The first correction is judged with η₀ = max(η_old, ε)^0.8, η_old the last η of the same stage.
/// What is kept for later steps, η and the largest θ, comes from corrections above the noise of evaluations.
/// Where stages start from nothing that foresees them, the first correction is most of the movement, which may be found at
/// once, and θ₂ tells little of how what is left of it falls: η₂ is at least min(η₀, 0.1), or what it is where the first
/// correction has a tolerance of what falls slowly, ‖δ⁽²⁾‖; with less of it little is left.
/// Corrections that stop falling are convergence, not divergence, when they are at round-off
/// (`floor`) or so small that even η = 100 leaves the allowed error.
/// Source: thesis (4.89)-(4.91); Hairer & Wanner, *Solving ODEs II*, section IV.8.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewtonMonitor {
    control: NewtonControl,
    floor: f64,
    /// Whether the fall from the first correction to the second tells how later ones fall.
    foreseen: bool,
    iterations: u32,
    last: f64,
    eta: f64,
    contraction: Option<f64>,
}

/// Tolerances below which corrections that do not fall are noise whatever the state is: one at rest has no round-off of
/// its own.
const NEGLIGIBLE: f64 = 1e-9;

/// The weighted norm up to which changes may be noise: that of an evaluation is some thousand times that of the state, `floor`, at most.
pub fn noise(floor: f64) -> f64 {
    (1e5 * floor).max(NEGLIGIBLE)
}

/// η of a matrix made for the step of which nothing is known yet.
const UNTOLD: f64 = 0.1;
/// Fall of a correction to noise that tells a good matrix.
const TELLING: f64 = 0.01;

impl NewtonMonitor {
    /// Starts an iteration from what is `foreseen` of its result, or from nothing. `eta` is that of the same stage of
    /// the step before (1 if there is none), `floor` the weighted norm of a change by round-off.
    pub fn start(control: NewtonControl, eta: f64, floor: f64, foreseen: bool) -> Self {
        let eta = eta.max(f64::EPSILON).powf(0.8);
        Self { control, floor, foreseen, iterations: 0, last: f64::NAN, eta, contraction: None }
    }

    /// Judges the next correction.
    pub fn observe(&mut self, correction: f64) -> IterationVerdict {
        let NewtonControl { kappa, max_iterations, divergence } = self.control;
        self.iterations += 1;
        let last = std::mem::replace(&mut self.last, correction);
        if !correction.is_finite() {
            self.eta = 1.0;
            return IterationVerdict::Diverged;
        }
        if correction <= self.floor {
            return IterationVerdict::Converged;
        }
        let mut eta = self.eta;
        let left =
            i32::try_from(max_iterations.saturating_sub(self.iterations)).unwrap_or(i32::MAX);
        if self.iterations > 1 {
            let tells = self.foreseen || self.iterations > 2;
            let theta = correction / last;
            let noise = noise(self.floor);
            // A ratio of noise says nothing about the matrix, a fall into noise how good it is at least.
            let seen = correction.max(noise) / last;
            if (tells || seen > UNTOLD) && (correction > noise || seen < TELLING) {
                self.contraction = Some(self.contraction.map_or(seen, |c| c.max(seen)));
            }
            if theta >= divergence {
                let stagnates = correction <= (0.01 * kappa).max(noise);
                self.eta = 1.0;
                return if stagnates {
                    IterationVerdict::Converged
                } else {
                    IterationVerdict::Diverged
                };
            }
            let least = if tells { 0.0 } else { self.eta.min(UNTOLD) };
            eta = (theta / (1.0 - theta)).max(least.min(correction));
            // What later steps begin with.
            if seen < divergence {
                self.eta = (seen / (1.0 - seen)).max(least);
            }
            if tells && eta * correction > kappa && kappa > 0.0 && left > 0 {
                let forecast = eta * correction * theta.powi(left - 1) / kappa;
                if forecast > 1.0 {
                    let q = forecast.clamp(1e-4, 16.0);
                    return IterationVerdict::Slow { ratio: 0.8 * q.powf(-1.0 / f64::from(left)) };
                }
            }
        }
        if eta * correction <= kappa {
            IterationVerdict::Converged
        } else if left == 0 {
            IterationVerdict::Slow { ratio: 0.5 }
        } else {
            IterationVerdict::Continue
        }
    }

    /// Number of corrections seen.
    pub fn iterations(&self) -> u32 {
        self.iterations
    }

    /// η after the last correction, to be kept for the same stage of the next step.
    pub fn eta(&self) -> f64 {
        self.eta
    }

    /// Largest θ seen; none after a single iteration.
    pub fn contraction(&self) -> Option<f64> {
        self.contraction
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use IterationVerdict::{Continue, Converged, Diverged, Slow};

    #[test]
    fn judges_a_table_of_iterations() {
        let control = NewtonControl::default();
        for (name, eta, corrections, expected) in [
            ("no history: the first must be below κ", 1.0, &[0.02][..], Converged),
            ("no history, larger", 1.0, &[0.04], Continue),
            ("fast stage before: η₀ = 1e-4^0.8", 1e-4, &[40.0], Converged),
            ("θ = 0.1, error left 0.1/9", 1.0, &[1.0, 0.1], Converged),
            ("θ = 0.45: five more iterations are enough", 1.0, &[1.0, 0.45], Continue),
            (
                "θ = 0.9: forecast too slow",
                1.0,
                &[1.0, 0.9],
                Slow { ratio: 0.8 * 16_f64.powf(-0.2) },
            ),
            ("grows", 1.0, &[1.0, 1.2], Diverged),
            ("not a number", 1.0, &[f64::NAN], Diverged),
            ("stagnates far below the tolerance", f64::INFINITY, &[2e-4, 2e-4], Converged),
            ("round-off", f64::INFINITY, &[1e-12], Converged),
        ] {
            let mut monitor = NewtonMonitor::start(control, eta, 1e-12, true);
            let mut found = Continue;
            for &correction in corrections {
                assert_eq!(found, Continue, "{name}: stopped too early");
                found = monitor.observe(correction);
            }
            match (found, expected) {
                (Slow { ratio: a }, Slow { ratio: b }) => {
                    assert!((a - b).abs() < 1e-12, "{name}: {a}");
                }
                _ => assert_eq!(found, expected, "{name}"),
            }
        }
    }

    #[test] // truth: what is left of a movement of 1e6 of which 10 fall by a tenth each time
    fn a_movement_that_is_found_at_once_hides_what_falls_slowly() {
        let judged = |foreseen: bool| {
            let mut monitor = NewtonMonitor::start(NewtonControl::default(), 1.0, 1e-9, foreseen);
            let verdicts = [1e6, 1.0, 0.1, 0.01].map(|correction| monitor.observe(correction));
            (verdicts, monitor.contraction())
        };
        let (verdicts, contraction) = judged(false);
        assert_eq!(verdicts, [Continue, Continue, Converged, Converged]);
        assert_eq!(contraction, Some(0.1));
        assert_eq!(judged(true).0[1], Converged, "what foresees the stages has the movement");
        // A little movement beside the first correction is left as it is.
        let mut monitor = NewtonMonitor::start(NewtonControl::default(), 1.0, 0.0, false);
        assert_eq!(
            [1e7, 5e-3].map(|correction| monitor.observe(correction)),
            [Continue, Converged]
        );
        assert!(monitor.eta() >= UNTOLD && monitor.contraction().is_none());
    }

    #[test]
    fn the_last_allowed_iteration_is_judged_and_halves_the_step() {
        let mut monitor = NewtonMonitor::start(
            NewtonControl { max_iterations: 2, ..NewtonControl::default() },
            1.0,
            0.0,
            true,
        );
        assert_eq!(monitor.observe(1.0), Continue);
        assert_eq!(monitor.observe(0.2), Slow { ratio: 0.5 });
        assert_eq!(monitor.contraction(), Some(0.2));
        assert_eq!(monitor.iterations(), 2);
    }

    #[test]
    fn to_round_off_stops_where_corrections_stop_falling() {
        let mut monitor = NewtonMonitor::start(NewtonControl::to_round_off(), 1.0, 1e-14, true);
        for correction in [1.0, 1e-3, 1e-6, 1e-9, 1e-12] {
            assert_eq!(monitor.observe(correction), Continue);
        }
        assert_eq!(monitor.observe(2e-12), Converged);
    }

    #[test]
    fn what_is_kept_of_a_matrix_does_not_depend_on_noise() {
        // Round-off of 1e-12 of the state: noise of evaluations up to 1e-7.
        let kept = |corrections: [f64; 2]| {
            let mut monitor =
                NewtonMonitor::start(NewtonControl::default(), f64::INFINITY, 1e-12, true);
            for correction in corrections {
                monitor.observe(correction);
            }
            (monitor.eta(), monitor.contraction())
        };
        assert_eq!(kept([1.0, 1e-9]), kept([1.0, 9e-8]));
        assert_eq!(kept([1e-6, 1e-9]), kept([1e-6, 9e-8]));
        assert_eq!(kept([1.0, 1e-9]).1, Some(1e-7));
        assert_eq!(kept([1e-6, 9e-8]).1, None);
        assert_eq!(kept([1.0, 0.5]).1, Some(0.5));
    }

    #[test] // at rest the floor is zero, and accelerations are found to their round-off only
    fn noise_about_a_state_at_rest_is_no_divergence() {
        let mut monitor = NewtonMonitor::start(NewtonControl::to_round_off(), 1.0, 0.0, true);
        for correction in [1.0, 1e-6, 1e-12] {
            assert_eq!(monitor.observe(correction), Continue);
        }
        assert_eq!(monitor.observe(3e-12), Converged);
    }
}
