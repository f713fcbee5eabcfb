//! Singly diagonally implicit Runge-Kutta formulas.

/// Coefficients of a five-stage SDIRK formula of order 4, in z-form.
///
/// For ẇ = g(t, w) and a step h from (t₀, w₀), with zᵢ = h Σⱼ aᵢⱼ gⱼ and stage values w₀ + zᵢ:
///
/// ```text
/// zᵢ = Σ_{j<i} ζᵢⱼ zⱼ + γh g(t₀ + cᵢh, w₀ + zᵢ)       ζᵢⱼ = −γ (A⁻¹)ᵢⱼ
/// w₁ = w₀ + z₅                                        error ≈ z₅ − Σ d̂ⱼ zⱼ,  d̂ = b̂ᵀA⁻¹
/// w(θ) = w₀ + Σᵢ zᵢ Σⱼ Dᵢⱼ θʲ                         0 ≤ θ ≤ 1, j = 1…4
/// ```
///
/// The formula is stiffly accurate: the last row of A is b. The ζ form replaces sums of slopes,
/// which would amplify the iteration error by the stiffness.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sdirk {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution.
    pub embedded_order: u32,
    /// Diagonal of A.
    pub gamma: f64,
    /// Runge-Kutta matrix; its last row is b.
    pub a: [[f64; 5]; 5],
    /// Weights of the embedded solution.
    pub b_hat: [f64; 5],
    /// Abscissas.
    pub c: [f64; 5],
    /// Embedded solution in terms of z; also the predictor of stage 5.
    pub d_hat: [f64; 5],
    /// Past part of a stage in terms of z.
    pub zeta: [[f64; 5]; 5],
    /// Predictors of stages 2 to 4 in terms of z: Σ αⱼcⱼ = cᵢ, Σ αⱼ(Ac)ⱼ = (Ac)ᵢ. Stage 1 is
    /// predicted from the step before.
    pub predictor: [[f64; 5]; 4],
    /// Dense output: powers 1 to 4 of θ per stage. Order 3 uniformly in θ.
    pub dense: [[f64; 4]; 5],
}

impl Sdirk {
    /// How many times as large iteration errors of stage `i` reach the end of the step, |bᵢ|/γ: up to 31.
    /// Where that is above 1, corrections are judged by it.
    pub fn effect(&self, i: usize) -> f64 {
        (self.a[4][i] / self.gamma).abs().max(1.0)
    }
}

impl Sdirk {
    /// Weights of the solution.
    pub fn b(&self) -> &[f64; 5] {
        &self.a[4]
    }
}

/// SDIRK4/16: γ = 1/4, order 4, estimate of order 3, L-stable, stiffly accurate.
///
/// Source: Hairer & Wanner, *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section
/// IV.6; dense output from the order conditions for every θ and Σ bᵢ(θ)cᵢ³ = θ⁴/4.
#[rustfmt::skip] // one row of a table on one line
pub const SDIRK4_16: Sdirk = Sdirk {
    name: "SDIRK4/16",
    order: 4,
    embedded_order: 3,
    gamma: 1.0 / 4.0,
    a: [
        [1.0 / 4.0, 0.0, 0.0, 0.0, 0.0],
        [1.0 / 2.0, 1.0 / 4.0, 0.0, 0.0, 0.0],
        [17.0 / 50.0, -1.0 / 25.0, 1.0 / 4.0, 0.0, 0.0],
        [371.0 / 1360.0, -137.0 / 2720.0, 15.0 / 544.0, 1.0 / 4.0, 0.0],
        [25.0 / 24.0, -49.0 / 48.0, 125.0 / 16.0, -85.0 / 12.0, 1.0 / 4.0],
    ],
    b_hat: [59.0 / 48.0, -17.0 / 96.0, 225.0 / 32.0, -85.0 / 12.0, 0.0],
    c: [1.0 / 4.0, 3.0 / 4.0, 11.0 / 20.0, 1.0 / 2.0, 1.0],
    d_hat: [-23.0 / 6.0, -17.0 / 12.0, 125.0 / 4.0, -85.0 / 3.0, 0.0],
    zeta: [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [2.0, 0.0, 0.0, 0.0, 0.0],
        [42.0 / 25.0, -4.0 / 25.0, 0.0, 0.0, 0.0],
        [89.0 / 68.0, -25.0 / 136.0, 15.0 / 136.0, 0.0, 0.0],
        [-37.0 / 12.0, -103.0 / 24.0, 275.0 / 8.0, -85.0 / 3.0, 0.0],
    ],
    predictor: [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [3.0, 0.0, 0.0, 0.0, 0.0],
        [22.0 / 25.0, 11.0 / 25.0, 0.0, 0.0, 0.0],
        [3.0 / 17.0, 0.0, 155.0 / 187.0, 0.0, 0.0],
    ],
    dense: [
        [61.0 / 27.0, 2315.0 / 81.0, -6178.0 / 81.0, 3680.0 / 81.0],
        [-185.0 / 54.0, 1049.0 / 162.0, -1607.0 / 81.0, 1360.0 / 81.0],
        [2525.0 / 18.0, -27725.0 / 54.0, 20075.0 / 27.0, -10000.0 / 27.0],
        [-3740.0 / 27.0, 40460.0 / 81.0, -56440.0 / 81.0, 27200.0 / 81.0],
        [-44.0 / 9.0, 557.0 / 27.0, -718.0 / 27.0, 320.0 / 27.0],
    ],
};

/// SDIRK4/15: γ = 4/15, order 4, estimate of order 3, L-stable, stiffly accurate. Its error constant
/// is half that of SDIRK4/16.
///
/// Source: Hairer & Wanner, *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section
/// IV.6 and their code SDIRK4. Entries without an exact quotient of doubles are rounded rationals.
#[rustfmt::skip] // one row of a table on one line
pub const SDIRK4_15: Sdirk = Sdirk {
    name: "SDIRK4/15",
    order: 4,
    embedded_order: 3,
    gamma: 4.0 / 15.0,
    a: [
        [4.0 / 15.0, 0.0, 0.0, 0.0, 0.0],
        [1.0 / 2.0, 4.0 / 15.0, 0.0, 0.0, 0.0],
        [51069.0 / 144_200.0, -7809.0 / 144_200.0, 4.0 / 15.0, 0.0, 0.0],
        [0.08515494131138653, -0.06484332287891555, 0.07915325296404206, 4.0 / 15.0, 0.0],
        [181_513.0 / 86430.0, -89074.0 / 116_015.0, 83636.0 / 34851.0, -69_863_904_375_173.0 / 23_297_141_763_930.0, 4.0 / 15.0],
    ],
    b_hat: [33_665_407.0 / 11_668_050.0, -2_284_766.0 / 15_662_025.0, 11_244_716.0 / 4_704_885.0, -96_203_066_666_797.0 / 23_297_141_763_930.0, 0.0],
    c: [4.0 / 15.0, 23.0 / 30.0, 17.0 / 30.0, 707.0 / 1931.0, 1.0],
    d_hat: [7_752_107_607.0 / 11_393_456_128.0, -17_881_415_427.0 / 11_470_078_208.0, 2_433_277_665.0 / 179_459_416.0, -96_203_066_666_797.0 / 6_212_571_137_048.0, 0.0],
    zeta: [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [15.0 / 8.0, 0.0, 0.0, 0.0, 0.0],
        [1_577_061.0 / 922_880.0, -23427.0 / 115_360.0, 0.0, 0.0, 0.0],
        [0.2680325578937784, -593_512_117_011_179.0 / 3_245_291_041_943_520.0, 559_907_973_726_451.0 / 1_886_325_418_129_671.0, 0.0, 0.0],
        [724_545_451.0 / 796_538_880.0, -830_832_077.0 / 267_298_560.0, 30_957_577.0 / 2_509_272.0, -69_863_904_375_173.0 / 6_212_571_137_048.0, 0.0],
    ],
    predictor: [
        [0.0, 0.0, 0.0, 0.0, 0.0],
        [23.0 / 8.0, 0.0, 0.0, 0.0, 0.0],
        [907_973.0 / 922_880.0, 45789.0 / 115_360.0, 0.0, 0.0, 0.0],
        [4_349_295_166_479_305.0 / 6_626_614_847_094_348.0, 0.0, 558_706_165_466_680.0 / 1_656_653_711_773_587.0, 0.0, 0.0],
    ],
    dense: [
        [264_288_555_637_595.0 / 10_680_842_944_512.0, -51.98245719616864, 762_462_182_266_591.0 / 23_004_892_495_872.0, -392_450_447_604_375.0 / 66_458_578_321_408.0],
        [-15_503_117_207_965.0 / 3_584_224_210_944.0, 704_181_908_771_699.0 / 66_905_518_604_288.0, -152_311_966_563_257.0 / 7_719_867_531_264.0, 905_246_655_991_875.0 / 66_905_518_604_288.0],
        [535_722_773_425.0 / 12_941_152_128.0, -5_321_636_152_745.0 / 34_509_739_008.0, 11_931_113_333_855.0 / 51_764_608_512.0, -1_353_677_821_875.0 / 11_503_246_336.0],
        [-61.041446199017855, 214.30821253198255, -287.6629744338197, 134.39620810085503],
        [-682_119.0 / 201_136.0, 165_706_491.0 / 11_263_616.0, -8_230_811.0 / 433_216.0, 97_756_875.0 / 11_263_616.0],
    ],
};
#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::trees::assert_order;

    const FORMULAS: [&Sdirk; 2] = [&SDIRK4_15, &SDIRK4_16];

    #[test] // a wrong digit breaks one of these sums: they are the tables' checksum
    fn both_satisfy_their_order_conditions() {
        for f in FORMULAS {
            assert_order(&f.a, f.b(), 1.0, f.order);
            assert_order(&f.a, &f.b_hat, 1.0, f.embedded_order);
            for i in 0..5 {
                assert_eq!(f.a[i][i], f.gamma);
                assert!((f.a[i].iter().sum::<f64>() - f.c[i]).abs() < 1e-14, "{} c{i}", f.name);
            }
        }
    }

    #[test] // truth: the z-form is the Butcher form in the variables z = hAk
    fn z_form_agrees_with_the_butcher_form() {
        for f in FORMULAS {
            let through_a = |z_weights: &[f64; 5]| -> [f64; 5] {
                std::array::from_fn(|j| (0..5).map(|i| z_weights[i] * f.a[i][j]).sum())
            };
            let close = |x: [f64; 5], y: [f64; 5], what: &str| {
                for (x, y) in x.into_iter().zip(y) {
                    assert!((x - y).abs() < 1e-12, "{} {what}: {x} ≠ {y}", f.name);
                }
            };
            close(through_a(&f.d_hat), f.b_hat, "embedded");
            for i in 0..5 {
                let past = std::array::from_fn(|j| if j < i { f.a[i][j] } else { 0.0 });
                close(through_a(&f.zeta[i]), past, "past part");
            }
            for i in 1..4 {
                let sum = |x: &dyn Fn(usize) -> f64| (0..5).map(x).sum::<f64>();
                let ac = |i: usize| sum(&|j| f.a[i][j] * f.c[j]);
                let predicted = f.predictor[i];
                assert!((sum(&|j| predicted[j] * f.c[j]) - f.c[i]).abs() < 1e-14);
                // Stage 2 has one weight only.
                assert!(i == 1 || (sum(&|j| predicted[j] * ac(j)) - ac(i)).abs() < 1e-14);
            }
            for theta in [0.0, 0.3, 0.8, 1.0] {
                let weights = std::array::from_fn(|i| {
                    (0..4).map(|j| f.dense[i][j] * f64::powi(theta, j as i32 + 1)).sum()
                });
                assert_order(&f.a, &through_a(&weights), theta, 3);
                if theta == 1.0 {
                    close(weights, [0.0, 0.0, 0.0, 0.0, 1.0], "end of dense output");
                }
            }
        }
    }

    #[test] // L-stability on the imaginary axis: |R(iy)| ≤ 1, R(∞) = 0
    fn both_are_stable_on_the_imaginary_axis() {
        for f in FORMULAS {
            for exponent in -20..40 {
                let y = 1.3_f64.powi(exponent);
                // Stage by stage for ẇ = iyw, w₀ = 1: (1 − iyγ) z = ζ z + iyγ.
                let mut z = [(0.0, 0.0); 5];
                for i in 0..5 {
                    let (mut re, mut im) = (0.0, y * f.gamma);
                    for j in 0..i {
                        re += f.zeta[i][j] * z[j].0;
                        im += f.zeta[i][j] * z[j].1;
                    }
                    let d = y * f.gamma;
                    z[i] = ((re - im * d) / (1.0 + d * d), (im + re * d) / (1.0 + d * d));
                }
                let size = (1.0 + z[4].0).hypot(z[4].1);
                assert!(size <= 1.0 + 1e-12, "{}: |R| = {size} at {y}", f.name);
                assert!(y < 1e4 || size < 10.0 / y);
            }
        }
    }
}
