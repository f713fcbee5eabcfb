//! Adams formulas of variable order and step in terms of modified divided differences.

/// Highest order of the predictor.
pub const ADAMS_MAX_ORDER: usize = 12;

/// Number of the arrays below: orders 1 to 13, since the corrector is one order higher.
const LENGTH: usize = ADAMS_MAX_ORDER + 1;

/// γ*₀ … γ*₁₃, the constant-step coefficients of the correctors: Σⱼ γ*ⱼ/(m + 1 − j) = 0 for m > 0.
/// Their sizes scale the error estimates.
pub const ADAMS_GAMMA_STAR: [f64; LENGTH + 1] = gamma_star();

const fn gamma_star() -> [f64; LENGTH + 1] {
    let mut gamma = [1.0; LENGTH + 1];
    let mut m = 1;
    while m <= LENGTH {
        let mut sum = 0.0;
        let mut j = 0;
        while j < m {
            sum += gamma[j] / (m + 1 - j) as f64;
            j += 1;
        }
        gamma[m] = -sum;
        m += 1;
    }
    gamma
}

/// Coefficients of one step h from t_n with the predictor of order k. Arrays are indexed from 0:
/// entry i belongs to i + 1 of the source.
///
/// With ψᵢ = t_{n+1} − t_{n+1−i} and the differences φᵢ of the slopes (φ₁ = g_n):
///
/// ```text
/// φ*ᵢ = βᵢ φᵢ(n)          p = w_n + h Σ_{i≤k} gᵢ φ*ᵢ           φᵖᵢ = Σ_{j=i}^{k} φ*ⱼ
/// d = g(t_{n+1}, p) − φᵖ₁       w_{n+1} = p + h g_{k+1} d
/// error of order k ≈ h (g_k − g_{k+1}) d;  at constant step orders k, k−1: h σ γ* d
/// ```
///
/// Source: Shampine & Gordon, *Computer Solution of Ordinary Differential Equations* (1975),
/// chapters 5 and 7.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamsCoefficients {
    /// ψᵢ(n+1), i = 1…k.
    pub psi: [f64; LENGTH],
    /// βᵢ(n+1), i = 1…k.
    pub beta: [f64; LENGTH],
    /// gᵢ, i = 1…k+1.
    pub g: [f64; LENGTH],
    /// σᵢ, i = 1…k+1: (i−1)! h^(i−1) / (ψ₁ … ψ_{i−1}).
    pub sigma: [f64; LENGTH],
}

impl AdamsCoefficients {
    /// Coefficients for order `k` from ψᵢ(n) of the step before, of which k − 1 are used.
    pub fn new(k: usize, h: f64, psi_before: &[f64; LENGTH]) -> Self {
        let mut c =
            Self { psi: [h; LENGTH], beta: [1.0; LENGTH], g: [1.0; LENGTH], sigma: [1.0; LENGTH] };
        for i in 1..k {
            c.psi[i] = psi_before[i - 1] + h;
            c.beta[i] = c.beta[i - 1] * c.psi[i - 1] / psi_before[i - 1];
        }
        // row[q] = g_{i,q+1}; g_{1,q} = 1/q, g_{2,q} = 1/(q(q+1))
        let mut row: [f64; LENGTH + 1] = std::array::from_fn(|q| 1.0 / (q + 1) as f64);
        for i in 1..=k {
            let alpha = h / c.psi[i - 1];
            c.sigma[i] = i as f64 * alpha * c.sigma[i - 1];
            for q in 0..=k - i {
                row[q] -= alpha * row[q + 1];
            }
            c.g[i] = row[0];
        }
        c
    }
}

/// Weights gᵢ, i = 1…k+1, of the interpolant through the last step and the k before it:
/// w(t_{n+1} + s) = w_{n+1} + s Σ gᵢ φᵢ(n+1), for the step with ψᵢ(n+1) and order `k`.
pub fn adams_interpolation(k: usize, s: f64, psi: &[f64; LENGTH]) -> [f64; LENGTH] {
    let mut g = [1.0; LENGTH];
    let mut row: [f64; LENGTH + 1] = std::array::from_fn(|q| 1.0 / (q + 1) as f64);
    let mut before = 0.0;
    for i in 1..=k {
        let gamma = (s + before) / psi[i - 1];
        let eta = s / psi[i - 1];
        for q in 0..=k - i {
            row[q] = gamma * row[q] - eta * row[q + 1];
        }
        g[i] = row[0];
        before = psi[i - 1];
    }
    g
}

/// The same interpolant in powers of θ = 1 + s/h over a step of length `h` = ψ₁: row i holds the
/// coefficients of s gᵢ, in s, from θ⁰ to θᵏ⁺¹.
///
/// ```text
/// s gᵢ = h ∫ from 1 to θ of Π_{m<i} (h (η − 1) + ψ_{m−1})/ψ_m dη,   ψ₀ = 0
/// ```
///
/// All factors but the first have coefficients that are not negative and add up to 1 at most, so that
/// powers of θ cost no digits.
pub fn adams_polynomials(k: usize, h: f64, psi: &[f64; LENGTH]) -> [[f64; LENGTH + 1]; LENGTH] {
    let mut rows = [[0.0; LENGTH + 1]; LENGTH];
    let mut product = [0.0; LENGTH + 1];
    product[0] = 1.0;
    let mut before = 0.0;
    for i in 0..=k {
        if i > 0 {
            let (slope, constant) = (h / psi[i - 1], (before - h) / psi[i - 1]);
            for j in (0..=i).rev() {
                let lower = if j > 0 { product[j - 1] } else { 0.0 };
                product[j] = constant * product[j] + slope * lower;
            }
            before = psi[i - 1];
        }
        let mut at_end = 0.0;
        for j in 0..=i {
            let coefficient = h * product[j] / (j + 1) as f64;
            rows[i][j + 1] = coefficient;
            at_end += coefficient;
        }
        rows[i][0] = -at_end;
    }
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() <= 1e-13 * b.abs().max(1.0)
    }

    #[test] // truth: the classical constants, as exact fractions
    fn constant_steps_give_the_classical_coefficients() {
        let h = 0.25;
        let psi = std::array::from_fn(|i| h * (i + 1) as f64);
        let c = AdamsCoefficients::new(6, h, &psi);
        let bashforth =
            [1.0, 1.0 / 2.0, 5.0 / 12.0, 3.0 / 8.0, 251.0 / 720.0, 95.0 / 288.0, 19087.0 / 60480.0];
        let moulton = [
            1.0,
            -1.0 / 2.0,
            -1.0 / 12.0,
            -1.0 / 24.0,
            -19.0 / 720.0,
            -3.0 / 160.0,
            -863.0 / 60480.0,
        ];
        for i in 0..7 {
            assert!(close(c.g[i], bashforth[i]), "g[{i}] = {}", c.g[i]);
            assert!(close(ADAMS_GAMMA_STAR[i], moulton[i]), "γ*[{i}] = {}", ADAMS_GAMMA_STAR[i]);
            assert!(close(c.sigma[i], 1.0) && close(c.beta[i], 1.0));
        }
        assert!((ADAMS_GAMMA_STAR[13] + 0.00468).abs() < 5e-6, "{}", ADAMS_GAMMA_STAR[13]);
    }

    /// φᵢ(n), i = 1…count, from their definition φᵢ = ψ₁(n)…ψᵢ₋₁(n) f[t_n, …, t_{n−i+1}];
    /// `times` run backwards from t_n.
    fn differences(times: &[f64], f: impl Fn(f64) -> f64, count: usize) -> Vec<f64> {
        let mut divided: Vec<f64> = times.iter().map(|&t| f(t)).collect();
        let mut phi = vec![divided[0]];
        let mut product = 1.0;
        for i in 1..count {
            for j in 0..times.len() - i {
                divided[j] = (divided[j] - divided[j + 1]) / (times[j] - times[j + i]);
            }
            product *= times[0] - times[i];
            phi.push(product * divided[0]);
        }
        phi
    }

    #[test] // truth: integrals of polynomials
    fn any_steps_integrate_polynomials_of_their_order_exactly() {
        let times = [2.0, 1.83, 1.5, 1.42, 1.1, 0.7, 0.65]; // t_n, t_{n−1}, …
        let h = 0.31;
        let k = 6;
        let psi_before = std::array::from_fn(|i| 2.0 - times.get(i + 1).copied().unwrap_or(0.0));
        let c = AdamsCoefficients::new(k, h, &psi_before);
        for degree in 0..k as i32 {
            let f = |t: f64| t.powi(degree);
            let integral =
                |a: f64, b: f64| (b.powi(degree + 1) - a.powi(degree + 1)) / f64::from(degree + 1);
            let phi = differences(&times, f, k);
            let found: f64 = (0..k).map(|i| h * c.g[i] * c.beta[i] * phi[i]).sum();
            assert!(close(found, integral(2.0, 2.0 + h)), "degree {degree}: {found}");
            // The new differences, and the interpolant of degree k + 1 back into the step.
            let mut after = vec![2.0 + h];
            after.extend(times);
            let phi = differences(&after, f, k + 1);
            for theta in [0.0, 0.4, 1.0] {
                let s = (theta - 1.0) * h;
                let g = adams_interpolation(k, s, &c.psi);
                let found: f64 = (0..=k).map(|i| s * g[i] * phi[i]).sum();
                assert!(close(found, integral(2.0 + h, 2.0 + h + s)), "θ = {theta}: {found}");
            }
        }
    }

    #[test] // independent truth: the recursion at a point
    fn polynomials_are_the_interpolant() {
        for k in [1, 2, 5, 12] {
            let h = 0.3;
            // Steps of all lengths, growing and falling.
            let mut psi = [h; LENGTH];
            for i in 1..LENGTH {
                psi[i] = psi[i - 1] + h * [0.5, 1.0, 0.3, 0.8][i % 4];
            }
            let rows = adams_polynomials(k, h, &psi);
            for theta in [0.0, 0.2, 0.7, 1.0] {
                let s = (theta - 1.0) * h;
                let g = adams_interpolation(k, s, &psi);
                for i in 0..=k {
                    let powers = (0..).map(|j| f64::powi(theta, j));
                    let sum: f64 = rows[i].iter().zip(powers).map(|(c, x)| c * x).sum();
                    let apart = (sum - s * g[i]).abs();
                    assert!(apart < 1e-15, "k = {k}, i = {i}, θ = {theta}: {apart:.1e}");
                }
            }
        }
    }
}
