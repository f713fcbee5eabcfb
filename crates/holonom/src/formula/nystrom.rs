//! Diagonally implicit formulas in second-order (Nyström) form, whose unknowns are accelerations.

use super::sdirk::Sdirk;

const MAX_STAGES: usize = 5;

/// Polynomials of the dense output.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Continuation {
    /// v(θ) = v₀ + h Σᵢ bᵢ(θ) v̇⁽ⁱ⁾, v̇(θ) = v̇₀ + h Σᵢ bᵢ(θ) v̈⁽ⁱ⁾: powers 1 to 4 of θ per stage.
    Stages([[f64; 4]; MAX_STAGES]),
    /// v(θ) cubic through positions and velocities at both ends; v̇(θ) linear between both ends, so
    /// that accelerations which ring on stiff components do not show inside a step.
    Hermite,
}

/// A diagonally implicit formula for v̈ = f(t, v, v̇).
///
/// ```text
/// v̇⁽ⁱ⁾ = v̇₀ + h Σ_{j≤i} aᵢⱼ v̈⁽ʲ⁾              aᵢᵢ = γ
/// v⁽ⁱ⁾ = v₀ + cᵢ h v̇₀ + h² Σ_{j≤i} μᵢⱼ v̈⁽ʲ⁾     μᵢᵢ = β
/// e_v = h Σ (b − b̂)ᵢ v̈⁽ⁱ⁾                      e_p = h² Σ (φ − φ̂)ᵢ v̈⁽ⁱ⁾
/// ```
///
/// The last stage is the end of the step. Extra states of first order, ż = g, take the weights of
/// v̇. An explicit first stage is the start of the step.
/// Source: thesis (3.59)-(3.62), (4.1), (4.2).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nystrom {
    /// Name used in options and reports.
    pub name: &'static str,
    /// Order of the solution.
    pub order: u32,
    /// Order of the embedded solution.
    pub embedded_order: u32,
    /// Number of stages, an explicit first one included.
    pub stages: usize,
    /// Whether the first stage is the start of the step.
    pub explicit_first: bool,
    /// γ.
    pub gamma: f64,
    /// β.
    pub beta: f64,
    /// Abscissas.
    pub c: [f64; MAX_STAGES],
    /// Weights of accelerations in velocities.
    pub a: [[f64; MAX_STAGES]; MAX_STAGES],
    /// Weights of accelerations in positions.
    pub mu: [[f64; MAX_STAGES]; MAX_STAGES],
    /// b − b̂.
    pub velocity_error: [f64; MAX_STAGES],
    /// φ − φ̂.
    pub position_error: [f64; MAX_STAGES],
    /// Dense output.
    pub continuation: Continuation,
}

impl Nystrom {
    /// Newmark's formula: v₁ = v₀ + h v̇₀ + h² [(½ − β) v̈₀ + β v̈₁], v̇₁ = v̇₀ + h [(1 − γ) v̈₀ + γ v̈₁].
    ///
    /// Order 2 for γ = ½, else 1. The embedded solution is the backward Euler formula with the slopes
    /// at the end: e_p = v₁ − v₀ − h v̇₁, e_v = (1 − γ) h (v̈₀ − v̈₁).
    /// Source: Newmark (1959), *J. Eng. Mech. Div. ASCE* 85; thesis section 4.1.
    pub fn newmark(gamma: f64, beta: f64) -> Self {
        let pad = |x: [f64; 2]| [x[0], x[1], 0.0, 0.0, 0.0];
        let zero = [0.0; MAX_STAGES];
        let b = [1.0 - gamma, gamma];
        let phi = [0.5 - beta, beta];
        Self {
            name: "Newmark",
            order: if gamma == 0.5 { 2 } else { 1 },
            embedded_order: 1,
            stages: 2,
            explicit_first: true,
            gamma,
            beta,
            c: pad([0.0, 1.0]),
            a: [zero, pad(b), zero, zero, zero],
            mu: [zero, pad(phi), zero, zero, zero],
            velocity_error: pad([b[0], b[1] - 1.0]),
            position_error: pad([phi[0] - b[0], phi[1] - b[1]]),
            continuation: Continuation::Hermite,
        }
    }

    /// The trapezoidal rule: Newmark's formula with γ = ½, β = ¼. A-stable, R(∞) = −1.
    pub fn trapezoidal() -> Self {
        Self { name: "trapezoidal", ..Self::newmark(0.5, 0.25) }
    }

    /// An SDIRK formula applied to v̇ and v alike: μ = A², φ = bᵀA, β = γ².
    pub fn sdirk(f: &Sdirk) -> Self {
        let times_a = |row: &[f64; MAX_STAGES]| -> [f64; MAX_STAGES] {
            std::array::from_fn(|j| (0..MAX_STAGES).map(|k| row[k] * f.a[k][j]).sum())
        };
        let error: [f64; MAX_STAGES] = std::array::from_fn(|i| f.b()[i] - f.b_hat[i]);
        Self {
            name: f.name,
            order: f.order,
            embedded_order: f.embedded_order,
            stages: MAX_STAGES,
            explicit_first: false,
            gamma: f.gamma,
            beta: f.gamma * f.gamma,
            c: f.c,
            a: f.a,
            mu: f.a.map(|row| times_a(&row)),
            velocity_error: error,
            position_error: times_a(&error),
            // bᵢ(θ) = Σₖ aₖᵢ (weights of zₖ).
            continuation: Continuation::Stages(std::array::from_fn(|i| {
                std::array::from_fn(|j| (0..MAX_STAGES).map(|k| f.a[k][i] * f.dense[k][j]).sum())
            })),
        }
    }

    /// How many times as large as at stage `i` iteration errors reach the end of the step: |bᵢ|/γ, up
    /// to 31 for SDIRK4/16, but not less than at the stage.
    pub fn effect(&self, i: usize) -> f64 {
        (self.a[self.stages - 1][i] / self.gamma).abs().max(1.0)
    }

    /// Stages that are solved for.
    pub fn implicit_stages(&self) -> std::ops::Range<usize> {
        usize::from(self.explicit_first)..self.stages
    }

    /// Weights of the start and of the first three stages before stage `i` in the polynomial through
    /// their accelerations, taken at that stage.
    pub fn predictor(&self, i: usize) -> [f64; MAX_STAGES] {
        if self.explicit_first {
            return [1.0, 0.0, 0.0, 0.0, 0.0]; // two stages: the start is the first one
        }
        let known = i.min(3);
        let node = |k: usize| if k == 0 { 0.0 } else { self.c[k - 1] };
        std::array::from_fn(|k| {
            if k > known {
                return 0.0;
            }
            let others = (0..=known).filter(|&j| j != k);
            others.map(|j| (self.c[i] - node(j)) / (node(k) - node(j))).product()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::formula::trees::assert_order;
    use crate::formula::{SDIRK4_15, SDIRK4_16};

    /// Coefficients of v̈ = −v − 2 d v̇ over one step, by stages with exact solves.
    fn step(f: &Nystrom, h: f64, damping: f64) -> [f64; 4] {
        let (v0, r0) = (1.0, 0.3);
        let mut a = [-v0 - 2.0 * damping * r0, 0.0, 0.0, 0.0, 0.0];
        let (mut v, mut r) = (v0, r0);
        for i in f.implicit_stages() {
            v = v0 + f.c[i] * h * r0 + h * h * (0..i).map(|j| f.mu[i][j] * a[j]).sum::<f64>();
            r = r0 + h * (0..i).map(|j| f.a[i][j] * a[j]).sum::<f64>();
            let matrix = 1.0 + 2.0 * damping * f.gamma * h + f.beta * h * h;
            a[i] = (-v - 2.0 * damping * r) / matrix;
            v += f.beta * h * h * a[i];
            r += f.gamma * h * a[i];
        }
        let sum = |w: &[f64; 5]| w.iter().zip(&a).map(|(w, a)| w * a).sum::<f64>();
        [v, r, h * h * sum(&f.position_error), h * sum(&f.velocity_error)]
    }

    /// The exact solution for damping below 1.
    fn exact(h: f64, damping: f64) -> [f64; 2] {
        let omega = (1.0 - damping * damping).sqrt();
        let b = (0.3 + damping) / omega;
        let (s, c) = (omega * h).sin_cos();
        let e = (-damping * h).exp();
        let (v, rate) = (c + b * s, omega * (b * c - s));
        [e * v, e * (rate - damping * v)]
    }

    #[test] // truth: the closed form of the damped oscillator
    fn local_errors_and_estimates_have_their_orders() {
        for (f, order, embedded) in [
            (Nystrom::trapezoidal(), 2, 1),
            (Nystrom::newmark(0.6, 0.3025), 1, 1),
            (Nystrom::sdirk(&SDIRK4_15), 4, 3),
            (Nystrom::sdirk(&SDIRK4_16), 4, 3),
        ] {
            assert_eq!((f.order, f.embedded_order), (order, embedded));
            let seen = |k: usize| {
                let error = |h: f64| {
                    let found = step(&f, h, 0.2);
                    if k < 2 { (found[k] - exact(h, 0.2)[k]).abs() } else { found[k].abs() }
                };
                (error(0.05) / error(0.025)).log2()
            };
            let name = f.name;
            // Positions of Newmark's formula gain one order in a single step.
            assert!((seen(1) - f64::from(order) - 1.0).abs() < 0.25, "{name}: {}", seen(1));
            assert!(seen(0) > f64::from(order) + 0.75, "{name}: {}", seen(0));
            for k in [2, 3] {
                assert!((seen(k) - f64::from(embedded) - 1.0).abs() < 0.3, "{name}: {}", seen(k));
            }
        }
    }

    #[test] // truth: thesis section 4.1: the pair of the trapezoid and the backward Euler formula
    fn the_trapezoidal_estimate_is_that_of_the_thesis() {
        let f = Nystrom::trapezoidal();
        assert_eq!((f.gamma, f.beta), (0.5, 0.25));
        assert_eq!(f.position_error[..2], [-0.25, -0.25]);
        assert_eq!(f.velocity_error[..2], [0.5, -0.5]);
    }

    #[test] // truth: published fractions of φ and φ̂ of SDIRK4/16
    fn position_weights_are_those_of_bta() {
        let f = Nystrom::sdirk(&SDIRK4_16);
        let phi = [47.0 / 64.0, -179.0 / 384.0, 475.0 / 128.0, -85.0 / 24.0, 1.0 / 16.0];
        let phi_hat = [65.0 / 96.0, 1.0 / 32.0, 25.0 / 16.0, -85.0 / 48.0, 0.0];
        for j in 0..5 {
            assert!((f.mu[4][j] - phi[j]).abs() < 1e-14);
            assert!((f.position_error[j] - (phi[j] - phi_hat[j])).abs() < 1e-14);
        }
    }

    #[test] // truth: order conditions for every θ; polynomials for the predictors
    fn dense_output_and_predictors_are_consistent() {
        for table in [&SDIRK4_15, &SDIRK4_16] {
            let f = Nystrom::sdirk(table);
            let Continuation::Stages(dense) = f.continuation else { unreachable!() };
            for theta in [0.3, 0.8, 1.0] {
                let weights = std::array::from_fn(|i| {
                    (0..4).map(|j| dense[i][j] * f64::powi(theta, j as i32 + 1)).sum()
                });
                assert_order(&f.a, &weights, theta, 3);
            }
            for i in 1..5 {
                let weights = f.predictor(i);
                let cubic = |t: f64, p: i32| if p == 0 { 1.0 } else { t.powi(p) };
                for power in 0..=(i.min(3) as i32) {
                    let found: f64 = (0..5)
                        .map(|k| weights[k] * cubic(if k == 0 { 0.0 } else { f.c[k - 1] }, power))
                        .sum();
                    assert!((found - cubic(f.c[i], power)).abs() < 1e-12, "stage {i}, {power}");
                }
            }
        }
    }
}
