//! Explicit Runge-Kutta formulas.

/// Coefficients of an explicit seven-stage pair whose last stage is the end of the step.
///
/// For ẇ = g(t, w) and a step h:
///
/// ```text
/// kᵢ = g(t₀ + cᵢh, w₀ + h Σ_{j<i} aᵢⱼ kⱼ)        w₁ = w₀ + h Σ a₇ⱼ kⱼ        error ≈ h Σ eᵢ kᵢ
/// w(θ) = w₀ + θ (Δ + (1−θ) (hk₁ − Δ + θ (2Δ − hk₁ − hk₇ + (1−θ) h Σ dᵢ kᵢ)))      Δ = w₁ − w₀
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplicitRungeKutta {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution.
    pub embedded_order: u32,
    /// Runge-Kutta matrix; its last row is b.
    pub a: [[f64; 7]; 7],
    /// Abscissas.
    pub c: [f64; 7],
    /// b − b̂.
    pub e: [f64; 7],
    /// Weights of the last term of dense output.
    pub d: [f64; 7],
}

/// DOPRI5: order 5, estimate of order 4, dense output of order 4.
///
/// Source: Dormand & Prince (1980); Hairer, Nørsett & Wanner, *Solving Ordinary Differential
/// Equations I*, 2nd ed. (1993), tables II.5.2 and section II.6.
#[rustfmt::skip] // one row of a table on one line
pub const DOPRI5: ExplicitRungeKutta = ExplicitRungeKutta {
    name: "DOPRI5",
    order: 5,
    embedded_order: 4,
    a: [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1.0 / 5.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0 / 40.0, 9.0 / 40.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0, 0.0, 0.0, 0.0, 0.0],
        [19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0, 0.0, 0.0, 0.0],
        [9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0, 0.0, 0.0],
        [35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0, 0.0],
    ],
    c: [0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0],
    e: [71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0],
    d: [-12_715_105_075.0 / 11_282_082_432.0, 0.0, 87_487_479_700.0 / 32_700_410_799.0, -10_690_763_975.0 / 1_880_347_072.0, 701_980_252_875.0 / 199_316_789_632.0, -1_453_857_185.0 / 822_651_844.0, 69_997_945.0 / 29_380_423.0],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::trees::assert_order;

    #[test] // a wrong digit breaks one of these sums: they are the table's checksum
    fn satisfies_its_order_conditions() {
        let ExplicitRungeKutta { a, c, e, d, .. } = DOPRI5;
        let b = a[6];
        assert_order(&a, &b, 1.0, 5);
        assert_order(&a, &std::array::from_fn(|i| b[i] - e[i]), 1.0, 4);
        for i in 0..7 {
            assert!((a[i].iter().sum::<f64>() - c[i]).abs() < 1e-14, "c{i}");
        }
        for theta in [0.0, 0.2, 0.7, 1.0] {
            let rest = 1.0 - theta;
            let weights = std::array::from_fn(|i| {
                let second = f64::from(i == 0) - b[i];
                let third = b[i] - f64::from(i == 6) - second;
                theta * (b[i] + rest * (second + theta * (third + rest * d[i])))
            });
            assert_order(&a, &weights, theta, 4);
        }
    }
}
