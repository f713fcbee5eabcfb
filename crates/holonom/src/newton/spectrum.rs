//! Eigenvalues of the linearized motion.

use super::blocks::ReducedBlocks;
use crate::error::EvaluationFailure;
use holonom_linalg::{DecompositionError, eigenvalues};

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

impl ReducedBlocks {
    /// Real and imaginary parts of the eigenvalues of J = g_w, 1/s.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues(&self) -> Result<Vec<(f64, f64)>, SpectrumError> {
        let mut j = self.jacobian()?;
        let ndof = self.order();
        let n = 2 * ndof + self.extra_extra.states();
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
