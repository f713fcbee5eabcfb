//! The first step of a run or after a restart.

/// Length of the explicit Euler trial that measures how fast the slope changes.
///
/// It moves the solution by a tenth of the tolerance, whatever the origin of the coordinates:
/// the size of the state itself does not enter. `slope` = ‖g₀‖ in tolerances per unit of time.
pub fn trial_step(slope: f64, max_step: f64) -> f64 {
    let step = if slope > 0.0 && slope.is_finite() { 0.1 / slope } else { 1e-6 };
    step.min(max_step)
}

/// Proposes the first step of a formula of order `order`.
///
/// ```text
/// τ = ‖g₀‖ / ‖dg/dt‖        error(h) ≈ ‖g₀‖ h (h/τ)ᵖ        error(h) = 0.01
/// ```
///
/// `slope` = ‖g₀‖ and `slope_rate` = ‖(g₁ − g₀)/h_trial‖ are in tolerances per unit of time. This is
/// the rule of Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, section II.4,
/// with the scale of time made explicit, so that it does not depend on the unit of time.
pub fn starting_step(order: u32, slope: f64, slope_rate: f64, max_step: f64) -> f64 {
    if !(slope.is_finite() && slope_rate.is_finite()) {
        return (1e-6_f64).min(max_step);
    }
    if slope_rate <= f64::MIN_POSITIVE {
        return max_step; // nothing moves, or it moves uniformly: control will tell
    }
    let p = f64::from(order);
    if slope <= f64::MIN_POSITIVE {
        return (0.01 / slope_rate).sqrt().min(max_step); // error(h) ≈ h² ‖dg/dt‖
    }
    let tau = slope / slope_rate;
    (tau * (0.01 / (slope * tau)).powf(1.0 / (p + 1.0))).min(max_step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starting_step_meets_the_error_model_and_its_limits() {
        // Independent truth: the error model of the documentation, solved by hand.
        for (name, order, slope, rate, max, expected) in [
            ("order 1, τ = 1 s", 1, 1.0, 1.0, 9.0, 0.1),
            ("order 3, τ = 2 s", 3, 8.0, 4.0, 9.0, 2.0 * (0.01_f64 / 16.0).powf(0.25)),
            (
                "the same in milliseconds",
                3,
                8.0e-3,
                4.0e-6,
                9e3,
                2e3 * (0.01_f64 / 16.0).powf(0.25),
            ),
            ("capped", 1, 1.0, 1.0, 0.05, 0.05),
            ("uniform motion", 4, 3.0, 0.0, 0.7, 0.7),
            ("starts at rest", 4, 0.0, 1.0, 9.0, 0.1),
            ("not a number", 4, f64::NAN, 1.0, 9.0, 1e-6),
        ] {
            let found = starting_step(order, slope, rate, max);
            assert!((found / expected - 1.0).abs() < 1e-12, "{name}: {found} ≠ {expected}");
        }
        assert_eq!(trial_step(50.0, 1.0), 0.002);
        assert_eq!(trial_step(0.0, 1e-7), 1e-7);
    }
}
