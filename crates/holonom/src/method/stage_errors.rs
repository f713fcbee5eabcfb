//! The error of an SDIRK formula itself, as far as its stages tell it.
//!
//! ```text
//! Δᵢ = u(cᵢ) − u(0) − h Σⱼ aᵢⱼ u'(cⱼ)        u(θ): dense output
//! rᵢ = −Δᵢ + Σ_{j<i} (aᵢⱼ/γ)(Eⱼ − rⱼ)        Eᵢ = (I − γhJ)⁻¹ rᵢ        E₅: error at the end
//! ```
//!
//! Source: `docs/theory/method.md` (11a); B-convergence in Hairer & Wanner, *Solving ODEs II*, section IV.15, with u for the solution.

use super::stepper::add_scaled;

/// Stages of SDIRK formulas.
pub(super) const STAGES: usize = 5;

/// Errors of the stages of an SDIRK formula, from the defects of its dense output.
#[derive(Debug, Clone)]
pub(super) struct StageErrors {
    /// Defect Δᵢ by what the stages give.
    defects: [[f64; STAGES]; STAGES],
    /// aᵢⱼ/γ, j < i.
    coupling: [[f64; STAGES]; STAGES],
    /// Eⱼ − rⱼ.
    found: [Vec<f64>; STAGES - 1],
}

impl StageErrors {
    /// For a formula with the matrix `a`, nodes `c` and powers 1 to 4 of θ of what each stage gives to its dense
    /// output.
    pub(super) fn new(
        a: &[[f64; STAGES]; STAGES],
        c: &[f64; STAGES],
        dense: &[[f64; 4]; STAGES],
        dimension: usize,
    ) -> Self {
        let defect = |i: usize, power: i32| -> f64 {
            let slopes = (0..STAGES).map(|j| a[i][j] * c[j].powi(power - 1));
            c[i].powi(power) - f64::from(power) * slopes.sum::<f64>()
        };
        let of_stage = |i: usize, m: usize| {
            (1..=4).zip(dense[m]).map(|(power, weight)| defect(i, power) * weight).sum()
        };
        Self {
            defects: std::array::from_fn(|i| std::array::from_fn(|m| of_stage(i, m))),
            coupling: std::array::from_fn(|i| std::array::from_fn(|j| a[i][j] / a[i][i])),
            found: std::array::from_fn(|_| vec![0.0; dimension]),
        }
    }

    /// The error at the end of a step. `stages` times `scale` are what the dense output is made of; `filter`
    /// multiplies by (I − γhJ)⁻¹.
    pub(super) fn at_end(
        &mut self,
        scale: f64,
        stages: &[Vec<f64>],
        error: &mut [f64],
        mut filter: impl FnMut(&mut [f64]),
    ) {
        for i in 0..STAGES {
            error.fill(0.0);
            for (stage, defect) in stages.iter().zip(self.defects[i]) {
                add_scaled(error, -scale * defect, stage);
            }
            for (found, weight) in self.found[..i].iter().zip(self.coupling[i]) {
                add_scaled(error, weight, found);
            }
            if let Some(found) = self.found.get_mut(i) {
                found.copy_from_slice(error);
            }
            filter(error);
            if let Some(found) = self.found.get_mut(i) {
                for (found, &error) in found.iter_mut().zip(&*error) {
                    *found = error - *found;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::{SDIRK4_15, SDIRK4_16, Sdirk};
    use holonom_linalg::Complex64;

    /// The error of a step of ẏ = λ(y − cos t) − sin t from (1, cos 1), by [`StageErrors`] and as it is.
    fn found_and_true(f: &Sdirk, h: f64, lambda: Complex64) -> [Complex64; 2] {
        let (start, matrix) = (1.0_f64, 1.0 - f.gamma * h * lambda);
        let mut stages = Vec::new();
        for i in 0..STAGES {
            let t = start + f.c[i] * h;
            let past: Complex64 = stages.iter().zip(f.zeta[i]).map(|(z, weight)| weight * z).sum();
            let forced = lambda * (start.cos() - t.cos()) - t.sin();
            stages.push((past + f.gamma * h * forced) / matrix);
        }
        let error = start.cos() + stages[STAGES - 1] - (start + h).cos();
        // In two components, as real and imaginary parts.
        let stages: Vec<_> = stages.iter().map(|z| vec![z.re, z.im]).collect();
        let mut errors = StageErrors::new(&f.a, &f.c, &f.dense, 2);
        let mut found = [0.0; 2];
        errors.at_end(1.0, &stages, &mut found, |x| {
            let solved = Complex64::new(x[0], x[1]) / matrix;
            x.copy_from_slice(&[solved.re, solved.im]);
        });
        [Complex64::new(found[0], found[1]), error]
    }

    #[test] // truth: the solution cos t
    fn errors_are_those_of_steps_whose_order_is_reduced() {
        let damped = Complex64::new(-1.0, 0.0);
        let oblique = Complex64::new(-0.5_f64.sqrt(), 0.5_f64.sqrt());
        let undamped = Complex64::new(0.0, 1.0);
        for f in [&SDIRK4_15, &SDIRK4_16] {
            for h in [0.02, 0.01, 0.005] {
                let assert_within = |product: Complex64, least: f64, most: f64| {
                    let [found, error] = found_and_true(f, h, product / h);
                    let ratio = found.norm() / error.norm();
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

    #[test] // truth: a polynomial of degree 1 is integrated without an error
    fn linear_motions_have_no_defect() {
        for f in [&SDIRK4_15, &SDIRK4_16] {
            let mut errors = StageErrors::new(&f.a, &f.c, &f.dense, 1);
            let stages: Vec<_> = f.c.iter().map(|&c| vec![c]).collect();
            let mut error = [1.0];
            errors.at_end(1.0, &stages, &mut error, |_| ());
            assert!(error[0].abs() < 1e-12, "{}: {}", f.name, error[0]);
        }
    }
}
