//! Explicit Runge-Kutta formulas of Dormand and Prince.

use super::kinks::estimated_at_kinks;

/// Coefficients of an explicit pair with a stage at the end of the step, which is the first one of the next step.
///
/// For ẇ = g(t, w) and a step h:
///
/// ```text
/// kᵢ = g(t₀ + cᵢh, w₀ + h Σ_{j<i} aᵢⱼ kⱼ)        w₁ = w₀ + h Σ bⱼ kⱼ        error ≈ h Σ eᵢ kᵢ
/// w(θ) = w₀ + θ (Δ + (1−θ) (hk₁ − Δ + θ (2Δ − hk₁ − hg₁ + (1−θ) (D₁ + θ (D₂ + (1−θ) (D₃ + …))))))
/// Δ = w₁ − w₀        Dₘ = h Σ dₘᵢ kᵢ        g₁ the slope at the end
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExplicitRungeKutta {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution, of the two estimates together where there are two.
    pub embedded_order: u32,
    /// h|λ| beyond which steps are unstable where λ is real: a step there is held by stability (Hairer & Wanner,
    /// *Solving Ordinary Differential Equations II*, 2nd ed. (1996), section IV.2).
    pub stiff: f64,
    /// The stage at the end of the step; those after it are for dense output alone.
    pub end: usize,
    /// Weights of the stages before each; those of the end are b.
    pub a: &'static [&'static [f64]],
    /// Abscissas.
    pub c: &'static [f64],
    /// b − b̂, of the stages up to the end.
    pub e: &'static [f64],
    /// The same of an estimate of lower order, which keeps the other one from being small by chance.
    pub lower: Option<&'static [f64]>,
    /// Weights of the last terms of dense output.
    pub d: &'static [&'static [f64]],
}

impl ExplicitRungeKutta {
    /// b: weights of the stages in the end of the step.
    pub fn weights(&self) -> &'static [f64] {
        self.a[self.end]
    }

    /// The part of its estimate, of size `estimate`, that counts beside the one of lower order, of size `lower`.
    pub fn part(estimate: f64, lower: f64) -> f64 {
        if lower == 0.0 { 1.0 } else { estimate / estimate.hypot(0.1 * lower) }
    }

    /// The error against the estimate where the derivative of a slope jumps within the step, as
    /// [`super::error_at_kinks`] has it.
    pub fn error_at_kinks(&self) -> f64 {
        estimated_at_kinks(self.c, self.weights(), |sum| {
            let (estimate, lower) = (sum(self.e), self.lower.map_or(0.0, sum));
            Self::part(estimate, lower) * estimate
        })
    }
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
    stiff: 3.25,
    end: 6,
    a: &[
        &[],
        &[1.0 / 5.0],
        &[3.0 / 40.0, 9.0 / 40.0],
        &[44.0 / 45.0, -56.0 / 15.0, 32.0 / 9.0],
        &[19372.0 / 6561.0, -25360.0 / 2187.0, 64448.0 / 6561.0, -212.0 / 729.0],
        &[9017.0 / 3168.0, -355.0 / 33.0, 46732.0 / 5247.0, 49.0 / 176.0, -5103.0 / 18656.0],
        &[35.0 / 384.0, 0.0, 500.0 / 1113.0, 125.0 / 192.0, -2187.0 / 6784.0, 11.0 / 84.0],
    ],
    c: &[0.0, 1.0 / 5.0, 3.0 / 10.0, 4.0 / 5.0, 8.0 / 9.0, 1.0, 1.0],
    e: &[71.0 / 57600.0, 0.0, -71.0 / 16695.0, 71.0 / 1920.0, -17253.0 / 339_200.0, 22.0 / 525.0, -1.0 / 40.0],
    lower: None,
    d: &[&[-12_715_105_075.0 / 11_282_082_432.0, 0.0, 87_487_479_700.0 / 32_700_410_799.0, -10_690_763_975.0 / 1_880_347_072.0, 701_980_252_875.0 / 199_316_789_632.0, -1_453_857_185.0 / 822_651_844.0, 69_997_945.0 / 29_380_423.0]],
};

/// DOP853: order 8, estimates of order 5 and 3 that act as one of order 7, dense output of order 7 by three stages more.
///
/// Source: Dormand & Prince; Hairer, Nørsett & Wanner, *Solving Ordinary Differential Equations I*, 2nd ed. (1993),
/// sections II.5, II.6 and II.10, and the numbers of their code DOP853.
#[rustfmt::skip] // one row of a table on one line
pub const DOP853: ExplicitRungeKutta = ExplicitRungeKutta {
    name: "DOP853",
    order: 8,
    embedded_order: 7,
    stiff: 6.1,
    end: 12,
    a: &[
        &[],
        &[0.05260015195876773],
        &[0.0197250569845379, 0.0591751709536137],
        &[0.02958758547680685, 0.0, 0.08876275643042054],
        &[0.2413651341592667, 0.0, -0.8845494793282861, 0.924834003261792],
        &[0.037037037037037035, 0.0, 0.0, 0.17082860872947386, 0.12546768756682242],
        &[0.037109375, 0.0, 0.0, 0.17025221101954405, 0.06021653898045596, -0.017578125],
        &[0.03709200011850479, 0.0, 0.0, 0.17038392571223998, 0.10726203044637328, -0.015319437748624402, 0.008273789163814023],
        &[0.6241109587160757, 0.0, 0.0, -3.3608926294469414, -0.868219346841726, 27.59209969944671, 20.154067550477894, -43.48988418106996],
        &[0.47766253643826434, 0.0, 0.0, -2.4881146199716677, -0.590290826836843, 21.230051448181193, 15.279233632882423, -33.28821096898486, -0.020331201708508627],
        &[-0.9371424300859873, 0.0, 0.0, 5.186372428844064, 1.0914373489967295, -8.149787010746927, -18.52006565999696, 22.739487099350505, 2.4936055526796523, -3.0467644718982196],
        &[2.273310147516538, 0.0, 0.0, -10.53449546673725, -2.0008720582248625, -17.9589318631188, 27.94888452941996, -2.8589982771350235, -8.87285693353063, 12.360567175794303, 0.6433927460157636],
        &[0.054293734116568765, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, 0.3111643669578199, -0.1521609496625161, 0.20136540080403034, 0.04471061572777259],
        &[0.056167502283047954, 0.0, 0.0, 0.0, 0.0, 0.0, 0.25350021021662483, -0.2462390374708025, -0.12419142326381637, 0.15329179827876568, 0.00820105229563469, 0.007567897660545699, -0.008298],
        &[0.03183464816350214, 0.0, 0.0, 0.0, 0.0, 0.028300909672366776, 0.053541988307438566, -0.05492374857139099, 0.0, 0.0, -0.00010834732869724932, 0.0003825710908356584, -0.00034046500868740456, 0.1413124436746325],
        &[-0.42889630158379194, 0.0, 0.0, 0.0, 0.0, -4.697621415361164, 7.683421196062599, 4.06898981839711, 0.3567271874552811, 0.0, 0.0, 0.0, -0.0013990241651590145, 2.9475147891527724, -9.15095847217987],
    ],
    c: &[0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0, 1.0, 0.1, 0.2, 0.7777777777777778],
    e: &[0.01312004499419488, 0.0, 0.0, 0.0, 0.0, -1.2251564463762044, -0.4957589496572502, 1.6643771824549864, -0.35032884874997366, 0.3341791187130175, 0.08192320648511571, -0.022355307863886294, 0.0],
    lower: Some(&[-0.18980075407240762, 0.0, 0.0, 0.0, 0.0, 4.450312892752409, 1.8915178993145003, -5.801203960010585, -0.4226823213237919, -0.1521609496625161, 0.20136540080403034, 0.02265179219836082, 0.0]),
    d: &[
        &[-8.428938276109013, 0.0, 0.0, 0.0, 0.0, 0.5667149535193777, -3.0689499459498917, 2.38466765651207, 2.117034582445028, -0.871391583777973, 2.2404374302607883, 0.6315787787694688, -0.08899033645133331, 18.148505520854727, -9.194632392478356, -4.436036387594894],
        &[10.427508642579134, 0.0, 0.0, 0.0, 0.0, 242.28349177525817, 165.20045171727028, -374.5467547226902, -22.113666853125306, 7.733432668472264, -30.674084731089398, -9.332130526430229, 15.697238121770845, -31.139403219565178, -9.35292435884448, 35.81684148639408],
        &[19.985053242002433, 0.0, 0.0, 0.0, 0.0, -387.0373087493518, -189.17813819516758, 527.8081592054236, -11.57390253995963, 6.8812326946963, -1.0006050966910838, 0.7777137798053443, -2.778205752353508, -60.19669523126412, 84.32040550667716, 11.99229113618279],
        &[-25.69393346270375, 0.0, 0.0, 0.0, 0.0, -154.18974869023643, -231.5293791760455, 357.6391179106141, 93.40532418362432, -37.45832313645163, 104.0996495089623, 29.8402934266605, -43.53345659001114, 96.32455395918828, -39.17726167561544, -149.72683625798564],
    ],
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::trees::assert_order;

    /// Weights of `S` stages, as the conditions take them.
    fn full<const S: usize>(weights: &[f64]) -> [f64; S] {
        std::array::from_fn(|i| weights.get(i).copied().unwrap_or(0.0))
    }

    fn square<const S: usize>(formula: &ExplicitRungeKutta) -> [[f64; S]; S] {
        assert_eq!(formula.a.len(), S);
        std::array::from_fn(|i| full(formula.a[i]))
    }

    /// A wrong digit breaks one of these sums: they are the table's checksum.
    fn assert_conditions<const S: usize>(
        formula: &ExplicitRungeKutta,
        embedded: &[u32],
        dense: u32,
    ) {
        let (a, b) = (square::<S>(formula), full::<S>(formula.weights()));
        assert_order(&a, &b, 1.0, formula.order);
        for (e, &order) in [Some(formula.e), formula.lower].into_iter().flatten().zip(embedded) {
            let e = full::<S>(e);
            assert_order(&a, &std::array::from_fn(|i| b[i] - e[i]), 1.0, order);
        }
        for (i, (row, c)) in a.iter().zip(formula.c).enumerate() {
            assert!((row.iter().sum::<f64>() - c).abs() < 1e-14, "c{i}");
        }
        for theta in [0.0, 0.2, 0.7, 1.0] {
            let rest = 1.0 - theta;
            let weights = std::array::from_fn(|i| {
                let second = f64::from(i == 0) - b[i];
                let third = b[i] - f64::from(i == formula.end) - second;
                let last = formula.d.iter().enumerate().rev().fold(0.0, |sum, (m, d)| {
                    let factor = if m % 2 == 0 { theta } else { rest };
                    d[i] + factor * sum
                });
                theta * (b[i] + rest * (second + theta * (third + rest * last)))
            });
            assert_order(&a, &weights, theta, dense);
        }
    }

    #[test]
    fn dopri5_satisfies_its_order_conditions() {
        assert_conditions::<7>(&DOPRI5, &[4], 4);
    }

    #[test]
    fn dop853_satisfies_its_order_conditions() {
        assert_conditions::<16>(&DOP853, &[5, 3], 7);
    }

    #[test] // truth: of sizes of order h⁶ and h⁴ the part of the first is of order h²
    fn two_estimates_act_as_one_of_order_seven() {
        let [coarse, fine] =
            [1e-3_f64, 5e-4].map(|h| h.powi(6) * ExplicitRungeKutta::part(h.powi(6), h.powi(4)));
        assert!(((coarse / fine).log2() - 8.0).abs() < 1e-3);
    }
}
