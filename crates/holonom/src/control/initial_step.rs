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
/// τ = min(‖g₀‖ / ‖dg/dt‖, 1 s)        error(h) ≈ ‖g₀‖ h (h/τ)ᵖ        error(h) = 0.01
/// ```
///
/// `slope` = ‖g₀‖ and `slope_rate` = ‖(g₁ − g₀)/h_trial‖ are in tolerances per unit of time. This is
/// the rule of Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, section II.4,
/// with the scale of time made explicit: theirs is 1 throughout. Here it is the limit, because a
/// slope that happens not to change says nothing about the motion to come. Nor does one that happens to be next to
/// nothing: where next to nothing has moved when τ is over, what moves is its change, h² ‖dg/dt‖ = 0.01.
pub fn starting_step(order: u32, slope: f64, slope_rate: f64, max_step: f64) -> f64 {
    if !(slope.is_finite() && slope_rate.is_finite()) {
        return (1e-6_f64).min(max_step);
    }
    if slope.max(slope_rate) <= f64::MIN_POSITIVE {
        return (1e-3_f64).min(max_step); // nothing moves yet
    }
    let tau = if slope < slope_rate { slope / slope_rate } else { 1.0 };
    let moved = slope * tau;
    let power = 1.0 / (f64::from(order) + 1.0);
    let by_slope = if moved > f64::MIN_POSITIVE { tau * (0.01 / moved).powf(power) } else { 0.0 };
    let by_change =
        if moved < 0.01 && tau < 1.0 { (0.01 / slope_rate).sqrt().min(1.0) } else { 0.0 };
    by_slope.max(by_change).min(max_step)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn starting_step_meets_the_error_model_and_its_limits() {
        // Independent truth: the error model of the documentation, solved by hand.
        for (name, order, slope, rate, max, expected) in [
            ("order 1, τ = 1 s", 1, 1.0, 1.0, 9.0, 0.1),
            ("order 3, τ = 0.5 s", 3, 8.0, 16.0, 9.0, 0.5 * (0.01_f64 / 4.0).powf(0.25)),
            (
                "the same per hour",
                3,
                8.0 * 3600.0,
                16.0 * 3600.0_f64.powi(2),
                9.0,
                0.5 / 3600.0 * (0.01_f64 / 4.0).powf(0.25),
            ),
            ("uniform motion", 3, 100.0, 0.0, 9.0, 0.1),
            ("capped", 1, 1.0, 1.0, 0.05, 0.05),
            ("starts at rest", 4, 0.0, 1.0, 9.0, 0.1),
            ("starts next to rest", 4, 1e-80, 1.0, 9.0, 0.1),
            ("starts next to rest, slowly", 4, 1e-200, 1e-4, 9.0, 1.0),
            ("nothing has moved after τ", 4, 1e-3, 1.0, 9.0, 0.1),
            ("stays at rest", 4, 0.0, 0.0, 9.0, 1e-3),
            ("not a number", 4, f64::NAN, 1.0, 9.0, 1e-6),
        ] {
            let found = starting_step(order, slope, rate, max);
            assert!((found / expected - 1.0).abs() < 1e-12, "{name}: {found} ≠ {expected}");
        }
        assert_eq!(trial_step(50.0, 1.0), 0.002);
        assert_eq!(trial_step(0.0, 1e-7), 1e-7);
    }
}
