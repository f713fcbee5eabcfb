//! The error of an SDIRK formula itself, as far as its stages tell it, and dense output through stages without theirs.
//!
//! ```text
//! Δᵢ = u(cᵢ) − u(0) − h Σⱼ aᵢⱼ u'(cⱼ)        u(θ): dense output
//! rᵢ = −Δᵢ + Σ_{j<i} (aᵢⱼ/γ)(Eⱼ − rⱼ)        Eᵢ = (I − γhJ)⁻¹ rᵢ        E₅: error at the end
//! Yᵢ − Eᵢ − u(cᵢ)                            what u lacks at stage Yᵢ
//! ```
//!
//! Source: `docs/theory/method.md` (11a), (14); B-convergence in Hairer & Wanner, *Solving ODEs II*, section IV.15, with u for the solution.

use super::counted::Counted;
use super::segment::Segment;
use super::stages::keep_stiff;
use super::stepper::add_scaled;

/// Stages of SDIRK formulas.
pub(super) const STAGES: usize = 5;
/// Stages within the step.
const INNER: usize = STAGES - 1;
/// Stages by themselves.
#[rustfmt::skip] // one row on one line
pub(super) const UNIT: [[f64; STAGES]; STAGES] = [
    [1.0, 0.0, 0.0, 0.0, 0.0],
    [0.0, 1.0, 0.0, 0.0, 0.0],
    [0.0, 0.0, 1.0, 0.0, 0.0],
    [0.0, 0.0, 0.0, 1.0, 0.0],
    [0.0, 0.0, 0.0, 0.0, 1.0],
];

/// What stage errors are found by.
pub(super) trait Filter {
    /// Multiplies by (I − γhJ)⁻¹.
    fn filter(&mut self, x: &mut [f64]);

    /// Scaled size of an error.
    fn norm(&mut self, x: &[f64]) -> f64;
}

/// That of a step with this end, by its system.
pub(super) struct StepFilter<'a, 'b> {
    pub(super) ode: &'a mut Counted<'b>,
    pub(super) end: &'a [f64],
    /// How the system does it.
    pub(super) by: fn(&mut Counted<'b>, &mut [f64]),
}

impl Filter for StepFilter<'_, '_> {
    fn filter(&mut self, x: &mut [f64]) {
        (self.by)(self.ode, x);
    }

    fn norm(&mut self, x: &[f64]) -> f64 {
        self.ode.error_norm(x, self.end)
    }
}

/// Powers 1 to 4 of θ.
type Powers = [f64; 4];

/// Errors of the stages of an SDIRK formula, from the defects of its dense output.
#[derive(Debug, Clone)]
pub(super) struct StageErrors {
    /// Defect Δᵢ by what the stages give.
    defects: [[f64; STAGES]; STAGES],
    /// Yᵢ − u(cᵢ) by what the stages give.
    gaps: [[f64; STAGES]; INNER],
    /// aᵢⱼ/γ, j < i.
    coupling: [[f64; STAGES]; STAGES],
    /// What is one at this inner stage, and zero at both ends and at two other stages; of one stage, nothing.
    bumps: [Powers; INNER],
    /// Their values at that one, which no correction passes through, and −1 for itself.
    at_left_out: [f64; INNER],
    /// Where the other three are, ascending.
    places: [f64; INNER - 1],
    /// Eⱼ − rⱼ.
    found: [Vec<f64>; INNER],
    /// What u lacks at inner stages.
    corrections: [Vec<f64>; INNER],
    filtered: Vec<f64>,
}

impl StageErrors {
    /// For a formula with the matrix `a`, nodes `c` and powers 1 to 4 of θ of what each stage gives to its dense
    /// output; `values` is what stages are by the same, less the start.
    pub(super) fn new(
        a: &[[f64; STAGES]; STAGES],
        c: &[f64; STAGES],
        dense: &[Powers; STAGES],
        values: &[[f64; STAGES]; STAGES],
        dimension: usize,
    ) -> Self {
        let defect = |i: usize, powers: &Powers| -> f64 {
            let slopes: Powers = std::array::from_fn(|k| {
                (0..STAGES).map(|j| a[i][j] * (k + 1) as f64 * c[j].powi(k as i32)).sum()
            });
            value(powers, c[i]) - powers.iter().zip(slopes).map(|(p, slope)| p * slope).sum::<f64>()
        };
        let (bumps, left_out) = bumps(c);
        let mut at_left_out = bumps.map(|bump| value(&bump, c[left_out]));
        at_left_out[left_out] = -1.0;
        let mut places = std::array::from_fn(|i| c[if i < left_out { i } else { i + 1 }]);
        places.sort_by(f64::total_cmp);
        let vectors = || std::array::from_fn(|_| vec![0.0; dimension]);
        Self {
            defects: std::array::from_fn(|i| std::array::from_fn(|m| defect(i, &dense[m]))),
            gaps: std::array::from_fn(|i| {
                std::array::from_fn(|m| values[i][m] - value(&dense[m], c[i]))
            }),
            coupling: std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] / a[i][i])),
            bumps,
            at_left_out,
            places,
            found: vectors(),
            corrections: vectors(),
            filtered: vec![0.0; dimension],
        }
    }

    /// Where the dense output is led through stages, ascending.
    pub(super) fn places(&self) -> &[f64] {
        &self.places
    }

    /// The error at the end of a step. `stages` times `scale` are what the dense output is made of.
    pub(super) fn at_end(
        &mut self,
        scale: f64,
        stages: &[Vec<f64>],
        error: &mut [f64],
        system: &mut impl Filter,
    ) {
        for i in 0..STAGES {
            error.fill(0.0);
            for (stage, defect) in stages.iter().zip(self.defects[i]) {
                add_scaled(error, -scale * defect, stage);
            }
            for (found, weight) in self.found[..i].iter().zip(self.coupling[i]) {
                add_scaled(error, weight, found);
            }
            if i == INNER {
                system.filter(error);
                break;
            }
            self.found[i].copy_from_slice(error);
            system.filter(error);
            for (found, &error) in self.found[i].iter_mut().zip(&*error) {
                *found = error - *found;
            }
            let correction = &mut self.corrections[i];
            correction.fill(0.0);
            for (stage, weight) in stages.iter().zip(self.gaps[i]) {
                add_scaled(correction, scale * weight, stage);
            }
            add_scaled(correction, -1.0, error);
        }
    }

    /// After [`Self::at_end`]: leads the stiff part of the dense output through three stages less their errors, where it is more than
    /// a tolerance off. What is smooth stays; what is stiff is where the equations say, of which slopes that are summed up know nothing. Finds
    /// what is `left` at the fourth stage.
    pub(super) fn correct(
        &mut self,
        output: &mut Segment,
        left: &mut [f64],
        system: &mut impl Filter,
    ) {
        left.fill(0.0);
        if !self.corrections.iter().any(|correction| system.norm(correction) > 1.0) {
            return;
        }
        for (i, correction) in self.corrections.iter_mut().enumerate() {
            // One matrix does not know the errors of smooth stages well enough.
            keep_stiff(correction, &mut self.filtered, |x| system.filter(x));
            output.add(1.0, &self.bumps[i], correction);
            add_scaled(left, self.at_left_out[i], correction);
        }
    }
}

/// A polynomial at θ.
fn value(powers: &Powers, theta: f64) -> f64 {
    powers.iter().rev().fold(0.0, |sum, power| theta * (power + sum))
}

/// Polynomials through the ends and the three inner stages that are spread best: of the largest product of all distances
/// (Fekete points). Also, which one is left out.
fn bumps(c: &[f64; STAGES]) -> ([Powers; INNER], usize) {
    let without = |left_out: usize| (0..INNER).filter(move |&i| i != left_out);
    let spread = |left_out: usize| -> f64 {
        let apart = |i| without(left_out).filter(move |&j| j > i).map(move |j| (c[i] - c[j]).abs());
        without(left_out).map(|i| c[i] * (1.0 - c[i]) * apart(i).product::<f64>()).product()
    };
    let left_out = (0..INNER).max_by(|&i, &j| spread(i).total_cmp(&spread(j))).unwrap_or(0);
    let mut bumps = [[0.0; 4]; INNER];
    for i in without(left_out) {
        // θ (1 − θ) Π (θ − cⱼ), multiplied out, over its value at cᵢ.
        let mut powers = [1.0, -1.0, 0.0, 0.0];
        for j in without(left_out).filter(|&j| j != i) {
            for power in (0..4).rev() {
                let lower = if power > 0 { powers[power - 1] } else { 0.0 };
                powers[power] = lower - c[j] * powers[power];
            }
        }
        bumps[i] = powers.map(|power| power / value(&powers, c[i]));
    }
    (bumps, left_out)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::{SDIRK4_15, SDIRK4_16, Sdirk};
    use holonom_linalg::Complex64;

    /// 1 − γhλ, for real and imaginary parts.
    struct Matrix(Complex64);

    impl Filter for Matrix {
        fn filter(&mut self, x: &mut [f64]) {
            let solved = Complex64::new(x[0], x[1]) / self.0;
            x.copy_from_slice(&[solved.re, solved.im]);
        }

        /// By a tolerance that all is far beyond.
        fn norm(&mut self, x: &[f64]) -> f64 {
            1e12 * x[0].hypot(x[1])
        }
    }

    /// Stages of ẏ = λ(y − cos t) − sin t from (1, cos 1) in two components, real and imaginary parts, less the start.
    fn stages(f: &Sdirk, h: f64, lambda: Complex64) -> Vec<Vec<f64>> {
        let mut stages: Vec<Complex64> = Vec::new();
        for i in 0..STAGES {
            let t = 1.0 + f.c[i] * h;
            let past: Complex64 = stages.iter().zip(f.zeta[i]).map(|(z, weight)| weight * z).sum();
            let forced = lambda * (1.0_f64.cos() - t.cos()) - t.sin();
            stages.push((past + f.gamma * h * forced) / (1.0 - f.gamma * h * lambda));
        }
        stages.iter().map(|z| vec![z.re, z.im]).collect()
    }

    /// The error of that step by [`StageErrors`] over the true one, and what it has found.
    fn found(f: &Sdirk, h: f64, lambda: Complex64) -> (Complex64, StageErrors) {
        let stages = stages(f, h, lambda);
        let mut errors = StageErrors::new(&f.a, &f.c, &f.dense, &UNIT, 2);
        let mut found = [0.0; 2];
        let mut matrix = Matrix(1.0 - f.gamma * h * lambda);
        errors.at_end(1.0, &stages, &mut found, &mut matrix);
        let end = &stages[STAGES - 1];
        let error = 1.0_f64.cos() + Complex64::new(end[0], end[1]) - (1.0 + h).cos();
        (Complex64::new(found[0], found[1]) / error, errors)
    }

    const DIRECTIONS: [Complex64; 3] = [
        Complex64::new(-1.0, 0.0),
        Complex64::new(-std::f64::consts::FRAC_1_SQRT_2, std::f64::consts::FRAC_1_SQRT_2),
        Complex64::new(0.0, 1.0),
    ];

    #[test] // truth: the solution cos t
    fn errors_are_those_of_steps_whose_order_is_reduced() {
        let [damped, oblique, undamped] = DIRECTIONS;
        for f in [&SDIRK4_15, &SDIRK4_16] {
            for h in [0.02, 0.01, 0.005] {
                let assert_within = |product: Complex64, least: f64, most: f64| {
                    let ratio = found(f, h, product / h).0.norm();
                    let inside = least < ratio && ratio < most;
                    assert!(inside, "{}, h = {h}, hλ = {product}: {ratio}", f.name);
                };
                for size in [0.1, 0.3, 1.0, 3.0] {
                    assert_within(size * damped, 0.65, 1.4);
                }
                for size in [0.1, 1.0, 10.0, 100.0, 1e4] {
                    assert_within(size * undamped, 0.95, 1.9);
                    assert_within(size * oblique, 0.5, 1.9);
                }
                assert_within(1e4 * damped, 1.0, 1.9);
            }
        }
    }

    #[test] // truth: the solution cos t; without corrections stiff ones are off by h² where they are not stiff by h⁵
    fn dense_output_is_right_where_the_system_is_stiff() {
        let h = 0.1;
        for f in [&SDIRK4_15, &SDIRK4_16] {
            for direction in DIRECTIONS {
                for size in [0.1, 1.0, 10.0, 100.0, 1e4] {
                    let lambda = size / h * direction;
                    let (_, mut errors) = found(f, h, lambda);
                    let mut matrix = Matrix(1.0 - f.gamma * h * lambda);
                    let mut output = Segment::new(2, 4);
                    output.begin(h, &[1.0_f64.cos(), 0.0]);
                    for (z, weights) in stages(f, h, lambda).iter().zip(&f.dense) {
                        output.add(1.0, weights, z);
                    }
                    let off = |output: &Segment| -> f64 {
                        let at = |theta: f64| {
                            let mut y = [0.0; 2];
                            output.interpolate(theta, &mut y);
                            (y[0] - (1.0 + theta * h).cos()).hypot(y[1])
                        };
                        (1..10).map(|k| at(0.1 * f64::from(k))).fold(0.0, f64::max)
                    };
                    let before = off(&output);
                    let mut left = [0.0; 2];
                    errors.correct(&mut output, &mut left, &mut matrix);
                    let after = off(&output);
                    // Far beyond the step (I − F)² leaves 2/γhλ of each gap, which the polynomial may double between stages.
                    // Where it is as fast as the step, the end is off by as much.
                    let most = if size > 1e3 { 6.0 / (f.gamma * size) } else { 1.6 };
                    assert!(after < most * before, "{}, λ = {lambda}: {before} {after}", f.name);
                }
            }
        }
    }

    #[test] // truth: a polynomial of degree 1 is integrated without an error
    fn linear_motions_have_no_defect() {
        for f in [&SDIRK4_15, &SDIRK4_16] {
            let mut errors = StageErrors::new(&f.a, &f.c, &f.dense, &UNIT, 2);
            let stages: Vec<_> = f.c.iter().map(|&c| vec![c, 0.0]).collect();
            let mut error = [1.0; 2];
            errors.at_end(1.0, &stages, &mut error, &mut Matrix(Complex64::new(1.0, 0.0)));
            assert!(error[0].abs() < 1e-12, "{}: {}", f.name, error[0]);
        }
    }
}
