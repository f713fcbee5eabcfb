//! Rosenbrock formulas: linearly implicit, one linear solve per stage and no iteration.

/// Coefficients of a four-stage Rosenbrock formula, transformed so that a stage is one solve.
///
/// For ẇ = g(t, w), J = g_w and g_t at (t₀, w₀), a step h and U = Γk:
///
/// ```text
/// (I − γhJ) uᵢ = γh g(t₀ + αᵢh, w₀ + Σ_{j<i} aᵢⱼ uⱼ) + γ Σ_{j<i} cᵢⱼ uⱼ + γ εᵢ h² g_t
/// w₁ = w₀ + Σ mᵢ uᵢ                     error ≈ Σ eᵢ uᵢ
/// a = 𝒜Γ⁻¹    c = I/γ − Γ⁻¹    m = bΓ⁻¹    e = m − m̂    αᵢ = Σⱼ 𝒜ᵢⱼ    εᵢ = Σⱼ Γᵢⱼ
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rosenbrock {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution.
    pub embedded_order: u32,
    /// γ, the diagonal of Γ.
    pub gamma: f64,
    /// a, strictly lower triangular. A row equal to the one before reuses its evaluation of g.
    pub a: [[f64; 4]; 4],
    /// c, strictly lower triangular.
    pub c: [[f64; 4]; 4],
    /// m, weights of the solution.
    pub m: [f64; 4],
    /// e = m − m̂, weights of the error.
    pub e: [f64; 4],
    /// α, abscissas.
    pub alpha: [f64; 4],
    /// ε, weights of g_t.
    pub epsilon: [f64; 4],
}

/// Rosenbrock-Nyström 4: order 4, estimate of order 3, L-stable, three evaluations of g.
///
/// γ is the root 0.5728… of x⁴ − 4x³ + 3x² − ⅔x + 1/24, which makes R(∞) = 0 exactly. The
/// Jacobian must be exact.
///
/// Source: Hairer & Wanner, *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section
/// IV.7, the L-stable set of their code ROS4 (which rounds γ to 0.57282).
#[rustfmt::skip] // one row of a table on one line
pub const ROSENBROCK_NYSTROM_4: Rosenbrock = Rosenbrock {
    name: "Rosenbrock-Nyström 4",
    order: 4,
    embedded_order: 3,
    gamma: 0.5728160624821349,
    a: [
        [0.0, 0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0, 0.0],
        [1.8679481466559784, 0.23444556814091008, 0.0, 0.0],
        [1.8679481466559784, 0.23444556814091008, 0.0, 0.0],
    ],
    c: [
        [0.0, 0.0, 0.0, 0.0],
        [-7.137649921358897, 0.0, 0.0, 0.0],
        [2.580923530693604, 0.6516298653277064, 0.0, 0.0],
        [-2.1371152877552757, -0.3214695297257359, -0.6949660544490378, 0.0],
    ],
    m: [2.2555662310268403, 0.28705505957984145, 0.43531196714727793, 1.0935076529988494],
    e: [0.2815440852509084, 0.0727656418713687, 0.10821291065572, 1.0935076529988494],
    alpha: [0.0, 1.1456321249642698, 0.655214977162467, 0.655214977162467],
    epsilon: [0.5728160624821349, -1.7691770777109208, 0.7592939450021206, -0.10489462620786676],
};

#[cfg(test)]
mod tests {
    use super::*;

    type Matrix = [[f64; 4]; 4];

    fn product(a: &Matrix, b: &Matrix) -> Matrix {
        std::array::from_fn(|i| std::array::from_fn(|k| (0..4).map(|j| a[i][j] * b[j][k]).sum()))
    }

    /// Inverse of a lower triangular matrix.
    fn inverse(l: &Matrix) -> Matrix {
        let mut x = [[0.0; 4]; 4];
        for k in 0..4 {
            for i in k..4 {
                let sum: f64 = (k..i).map(|j| l[i][j] * x[j][k]).sum();
                x[i][k] = (f64::from(i == k) - sum) / l[i][i];
            }
        }
        x
    }

    #[test] // a wrong digit breaks one of these sums: they are the table's checksum
    fn satisfies_the_order_conditions() {
        // Back from the transformed to the defining coefficients.
        let r = ROSENBROCK_NYSTROM_4;
        let g = r.gamma;
        let identity_part = |i: usize, j: usize| f64::from(i == j) / g;
        let gamma_inverse: Matrix =
            std::array::from_fn(|i| std::array::from_fn(|j| identity_part(i, j) - r.c[i][j]));
        let gamma = inverse(&gamma_inverse);
        let alpha = product(&r.a, &gamma);
        let weights = |m: [f64; 4]| -> [f64; 4] {
            std::array::from_fn(|j| (0..4).map(|i| m[i] * gamma[i][j]).sum())
        };
        let b = weights(r.m);
        let b_hat = weights(std::array::from_fn(|i| r.m[i] - r.e[i]));
        let beta = |i: usize, j: usize| alpha[i][j] + gamma[i][j];
        let beta_sum: [f64; 4] = std::array::from_fn(|i| (0..i).map(|j| beta(i, j)).sum());
        let sum = |f: &dyn Fn(usize) -> f64| (0..4).map(f).sum::<f64>();
        let below = |i: usize, f: &dyn Fn(usize) -> f64| (0..i).map(f).sum::<f64>();
        for i in 0..4 {
            assert!((below(i, &|j| alpha[i][j]) - r.alpha[i]).abs() < 1e-14, "α{i}");
            assert!((sum(&|j| gamma[i][j]) - r.epsilon[i]).abs() < 1e-14, "ε{i}");
        }
        let third = |b: [f64; 4]| {
            [
                (sum(&|i| b[i]), 1.0),
                (sum(&|i| b[i] * beta_sum[i]), 0.5 - g),
                (sum(&|i| b[i] * r.alpha[i].powi(2)), 1.0 / 3.0),
                (sum(&|i| b[i] * below(i, &|j| beta(i, j) * beta_sum[j])), 1.0 / 6.0 - g + g * g),
            ]
        };
        let fourth = [
            (sum(&|i| b[i] * r.alpha[i].powi(3)), 0.25),
            (
                sum(&|i| b[i] * r.alpha[i] * below(i, &|j| alpha[i][j] * beta_sum[j])),
                1.0 / 8.0 - g / 3.0,
            ),
            (sum(&|i| b[i] * below(i, &|j| beta(i, j) * r.alpha[j].powi(2))), 1.0 / 12.0 - g / 3.0),
            (
                b[3] * beta(3, 2) * beta(2, 1) * beta_sum[1],
                1.0 / 24.0 - g / 2.0 + 1.5 * g * g - g.powi(3),
            ),
            (g.powi(4) - 4.0 * g.powi(3) + 3.0 * g * g - g / 1.5 + 1.0 / 24.0, 0.0), // R(∞) = 0
        ];
        let conditions = third(b).into_iter().chain(third(b_hat)).chain(fourth);
        for (n, (found, expected)) in conditions.enumerate() {
            assert!((found - expected).abs() < 1e-14, "condition {n}: {found} ≠ {expected}");
        }
        assert_eq!(r.a[2], r.a[3], "stage 4 reuses the evaluation of stage 3");
    }
}
