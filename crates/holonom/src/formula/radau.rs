//! Collocation at the Radau points.

/// Coefficients of the three-stage Radau IIA formula, order 5, with the transformation that splits
/// its stages into one real and one complex system of the size of w.
///
/// For ẇ = g(t, w), a step h from (t₀, w₀) and zᵢ = wᵢ − w₀:
///
/// ```text
/// zᵢ = h Σⱼ aᵢⱼ g(t₀ + cⱼh, w₀ + zⱼ)        w₁ = w₀ + z₃        h g(wᵢ) = Σⱼ (A⁻¹)ᵢⱼ zⱼ
/// T⁻¹ A⁻¹ T = diag(γ̂, [α̂ −β̂; β̂ α̂])         z = T y
/// error ≈ (I − γ₀hJ)⁻¹ (γ₀h g(t₀, w₀) + Σ eᵢ zᵢ),  γ₀ = 1/γ̂
/// w(θ) = w₀ + Σᵢ zᵢ Σⱼ Dᵢⱼ θʲ               0 ≤ θ ≤ 1, j = 1…3: the collocation polynomial
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radau {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution.
    pub embedded_order: u32,
    /// Runge-Kutta matrix; its last row is b.
    pub a: [[f64; 3]; 3],
    /// Abscissas.
    pub c: [f64; 3],
    /// A⁻¹.
    pub a_inverse: [[f64; 3]; 3],
    /// T.
    pub t: [[f64; 3]; 3],
    /// T⁻¹.
    pub t_inverse: [[f64; 3]; 3],
    /// γ̂, the real eigenvalue of A⁻¹.
    pub real: f64,
    /// (α̂, β̂), the complex eigenvalue of A⁻¹.
    pub complex: (f64, f64),
    /// e, weights of the error.
    pub e: [f64; 3],
    /// Dense output: powers 1 to 3 of θ per stage.
    pub dense: [[f64; 3]; 3],
}

impl Radau {
    /// Weights of the solution.
    pub fn b(&self) -> &[f64; 3] {
        &self.a[2]
    }
}

/// Radau IIA with three stages: order 5, estimate of order 3, stage order 3, L-stable, stiffly
/// accurate.
///
/// Source: Hairer & Wanner, *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section
/// IV.8 and their code RADAU5.
#[rustfmt::skip] // one row of a table on one line
pub const RADAU_IIA_5: Radau = Radau {
    name: "Radau IIA 5",
    order: 5,
    embedded_order: 3,
    a: [
        [0.1968154772236604, -0.06553542585019839, 0.02377097434822015],
        [0.3944243147390873, 0.2920734116652285, -0.04154875212599793],
        [0.37640306270046725, 0.5124858261884216, 1.0 / 9.0],
    ],
    c: [0.1550510257216822, 0.6449489742783178, 1.0],
    a_inverse: [
        [3.224744871391589, 1.1678400846904056, -0.25319726474218085],
        [-3.5678400846904057, 0.775255128608411, 1.0531972647421808],
        [5.531972647421808, -7.531972647421808, 5.0],
    ],
    t: [
        [0.09123239487089295, -0.1412552950209542, -0.030029194105147424],
        [0.241717932707107, 0.20412935229379994, 0.3829421127572619],
        [0.966048182615093, 1.0, 0.0],
    ],
    t_inverse: [
        [4.325579890063155, 0.33919925181580984, 0.5417705399358749],
        [-4.178718591551905, -0.32768282076106237, 0.47662355450055044],
        [-0.5028726349457868, 2.571926949855605, -0.5960392048282249],
    ],
    real: 3.637834252744496,
    complex: (2.6810828736277523, 3.0504301992474105),
    e: [-2.7623054547485992, 0.3799355982527289, -0.0916296098652258],
    dense: [
        [10.048809399827416, -25.62959144707664, 15.580782047249224],
        [-1.382142733160749, 10.296258113743306, -8.914115380582556],
        [1.0 / 3.0, -8.0 / 3.0, 10.0 / 3.0],
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::trees::assert_order;

    type Matrix = [[f64; 3]; 3];
    const F: &Radau = &RADAU_IIA_5;

    fn product(a: &Matrix, b: &Matrix) -> Matrix {
        std::array::from_fn(|i| std::array::from_fn(|k| (0..3).map(|j| a[i][j] * b[j][k]).sum()))
    }

    #[track_caller]
    fn assert_close(found: &Matrix, expected: &Matrix) {
        for (found, expected) in found.iter().flatten().zip(expected.iter().flatten()) {
            assert!((found - expected).abs() < 1e-14, "{found} ≠ {expected}");
        }
    }

    #[test] // a wrong digit breaks one of these sums: they are the table's checksum
    fn satisfies_its_order_conditions() {
        assert_order(&F.a, F.b(), 1.0, F.order);
        for i in 0..3 {
            // Stage order 3: Σ aᵢⱼ cⱼ^(q−1) = cᵢ^q / q.
            for q in 1..=3 {
                let found: f64 = (0..3).map(|j| F.a[i][j] * F.c[j].powi(q - 1)).sum();
                assert!((found - F.c[i].powi(q) / f64::from(q)).abs() < 1e-15, "stage {i}, {q}");
            }
        }
    }

    #[test] // truth: the inverse, and the eigenvalues 3 + 3^⅔ − 3^⅓, … in closed form
    fn the_transformation_splits_the_stages() {
        const IDENTITY: Matrix = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        assert_close(&product(&F.a, &F.a_inverse), &IDENTITY);
        assert_close(&product(&F.t, &F.t_inverse), &IDENTITY);
        let root = 3f64.cbrt();
        let (alpha, beta) =
            (3.0 + 0.5 * (root - root * root), 0.5 * (3f64.powf(5.0 / 6.0) + 3f64.powf(7.0 / 6.0)));
        let split = [[3.0 + root * root - root, 0.0, 0.0], [0.0, alpha, -beta], [0.0, beta, alpha]];
        assert_close(&product(&product(&F.t_inverse, &F.a_inverse), &F.t), &split);
        assert!((F.real - split[0][0]).abs() < 1e-15);
        assert!((F.complex.0 - alpha).abs() + (F.complex.1 - beta).abs() < 2e-15);
    }

    #[test] // truth: ŵ = w₀ + h(b̂₀ g₀ + Σ b̂ᵢ gᵢ) must integrate polynomials up to degree 2
    fn the_estimate_is_of_order_3() {
        // With zᵢ = h Σ aᵢⱼ gⱼ: (error) = γ₀ h g₀ + h Σⱼ (Σᵢ eᵢ aᵢⱼ) gⱼ vanishes for them.
        for q in 0..3 {
            let start = if q == 0 { 1.0 / F.real } else { 0.0 };
            let rest: f64 = (0..3)
                .map(|j| (0..3).map(|i| F.e[i] * F.a[i][j]).sum::<f64>() * F.c[j].powi(q))
                .sum();
            assert!((start + rest).abs() < 1e-15, "degree {q}: {:e}", start + rest);
        }
    }

    #[test] // truth: Lagrange's conditions of the polynomial through (0, 0) and (cᵢ, zᵢ)
    fn dense_output_is_the_collocation_polynomial() {
        for (i, c) in F.c.into_iter().enumerate() {
            for k in 0..3 {
                let found: f64 = (0..3).map(|j| F.dense[k][j] * c.powi(j as i32 + 1)).sum();
                assert!((found - f64::from(i == k)).abs() < 2e-15, "stage {k} at {c}: {found}");
            }
        }
    }
}
