//! Eigenvalues of the linearized motion.

use super::blocks::ReducedBlocks;
use crate::error::EvaluationFailure;
use crate::reduction::Manifold;
use crate::system::{RelativeKind, State};
use holonom_linalg::{DecompositionError, eigenvalues};
use std::ops::Range;

/// Why there is no spectrum.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// The equations could not be evaluated.
    #[error(transparent)]
    Evaluation(#[from] EvaluationFailure),
    /// The eigenvalue iteration failed.
    #[error("the eigenvalues could not be computed: {0}")]
    Decomposition(#[from] DecompositionError),
}

/// Small rotations θ in place of rotation vectors x, whose reference goes along with the motion, in axes of the body from
/// which they are measured: in these the linearized equations of a rotor that is the same about its axis have constant
/// coefficients, in x they have not. Equation: `docs/theory/newton.md` (26).
#[derive(Debug, Clone, Default)]
pub struct SmallRotations {
    ndof: usize,
    /// The first of three variables, Ḣ and Ḧ.
    turning: Vec<(usize, [[[f64; 3]; 3]; 2])>,
}

impl SmallRotations {
    /// Of the rotation vectors among the independent variables of a manifold that stands at a complete state, where all three
    /// numbers are independent.
    pub fn new(manifold: &Manifold, state: &State) -> Self {
        let ndof = manifold.chart().ndof();
        let mut turning = Vec::new();
        if let Some(relatives) = manifold.chart().parametrization().relatives() {
            let [mut p, mut rates, mut accelerations] = [(); 3].map(|()| vec![0.0; ndof]);
            manifold.independent_state(state, &mut p, &mut rates);
            manifold.independent_acceleration(state, &mut accelerations);
            let groups = manifold.system().relative_groups();
            let whole = |(group, range): &(usize, Range<usize>)| {
                groups[*group].kind == RelativeKind::Rotation && range.len() == 3
            };
            for (_, range) in relatives.runs().filter(whole) {
                let [rate, second] = [&rates, &accelerations].map(|x| skew(&x[range.clone()]));
                let entry = |r: usize, c: usize| {
                    let square: f64 = (0..3).map(|k| rate[r][k] * rate[k][c]).sum();
                    0.5 * second[r][c] + square / 3.0
                };
                let curved = [0, 1, 2].map(|r| [0, 1, 2].map(|c| entry(r, c)));
                turning.push((range.start, [rate.map(|row| row.map(|x| 0.5 * x)), curved]));
            }
        }
        Self { ndof, turning }
    }

    /// (δθ, δθ̇) become (δx, δẋ).
    pub fn to_vectors(&self, change: &mut [f64]) {
        for (at, [first, _]) in &self.turning {
            for (r, row) in first.iter().enumerate() {
                let turned: f64 = row.iter().zip(&change[*at..]).map(|(h, x)| h * x).sum();
                change[self.ndof + at + r] -= turned;
            }
        }
    }

    /// (δẋ, δẍ) of the change (δx, δẋ) become (δθ̇, δθ̈).
    pub fn to_rotations(&self, change: &[f64], rates: &mut [f64]) {
        for (at, [first, second]) in &self.turning {
            for r in 0..3 {
                for c in 0..3 {
                    let [x, rate] = [0, self.ndof].map(|level| change[level + at + c]);
                    rates[at + r] += first[r][c] * x;
                    rates[self.ndof + at + r] += 2.0 * first[r][c] * rate + second[r][c] * x;
                }
            }
        }
    }

    /// J of order n by rows, of (x, ẋ, …), becomes that of (θ, θ̇, …).
    fn change(&self, n: usize, j: &mut [f64]) {
        for (at, [first, second]) in &self.turning {
            let level = |k: usize| k * self.ndof + at;
            for (r, c) in (0..9).map(|k| (k / 3, k % 3)) {
                j[(level(0) + r) * n + level(0) + c] += first[r][c];
                j[(level(1) + r) * n + level(0) + c] += second[r][c];
                j[(level(1) + r) * n + level(1) + c] += 2.0 * first[r][c];
            }
        }
        for (at, [first, _]) in &self.turning {
            for row in j.chunks_exact_mut(n) {
                for c in 0..3 {
                    let turned: f64 = (0..3).map(|r| row[self.ndof + at + r] * first[r][c]).sum();
                    row[at + c] -= turned;
                }
            }
        }
    }
}

/// x×.
fn skew(x: &[f64]) -> [[f64; 3]; 3] {
    [[0.0, -x[2], x[1]], [x[2], 0.0, -x[0]], [-x[1], x[0], 0.0]]
}

impl ReducedBlocks {
    /// Real and imaginary parts of the eigenvalues of J = g_w, 1/s, in small `rotations`.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues(
        &self,
        rotations: &SmallRotations,
    ) -> Result<Vec<(f64, f64)>, SpectrumError> {
        let mut j = self.jacobian()?;
        let ndof = self.order();
        let n = 2 * ndof + self.extra_extra.states();
        rotations.change(n, &mut j);
        // In time of the fastest vibration all entries are of one size; its square would be round-off in all the others.
        let stiffest = (0..ndof)
            .flat_map(|row| &j[(ndof + row) * n..(ndof + row) * n + ndof])
            .fold(0.0f64, |most, x| most.max(x.abs()));
        let rate = if stiffest > 0.0 && stiffest.is_finite() { stiffest.sqrt() } else { 1.0 };
        let is_rate = |k: usize| (ndof..2 * ndof).contains(&k);
        for (e, x) in j.iter_mut().enumerate() {
            match [is_rate(e / n), is_rate(e % n)] {
                [true, false] => *x /= rate,
                [false, true] => *x *= rate,
                _ => {}
            }
        }
        Ok(eigenvalues(n, &j)?)
    }
}
