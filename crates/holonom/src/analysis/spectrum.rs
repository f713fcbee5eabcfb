//! Eigenvalues of the motion linearized at a state.

use crate::error::EvaluationFailure;
use crate::method::ode::{LinearizedOde, Ode};
use crate::method::{FirstOrder, Weights};
use crate::model::Tolerance;
use crate::reduction::assembly::Assembled;
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

/// Eigenvalues (real, imaginary part, 1/s) of J = g_w of the first-order form at an assembled state,
/// fastest first. Accelerations and multipliers are those of the state.
///
/// # Errors
/// [`SpectrumError`].
pub fn spectrum(assembled: &Assembled) -> Result<Vec<(f64, f64)>, SpectrumError> {
    let system = assembled.manifold.system().clone();
    let weights = Weights::new(Tolerance::uniform(1.0), system.as_ref(), &assembled.state);
    let mut form = FirstOrder::new(assembled.manifold.clone(), weights, &assembled.state);
    let n = form.dimension();
    let mut w = vec![0.0; n];
    form.pack(&assembled.state, &mut w);
    form.linearize(assembled.state.t, &w)?;
    let mut values = eigenvalues(n, &form.newton().blocks().jacobian()?)?;
    values.sort_by(|a, b| b.0.hypot(b.1).total_cmp(&a.0.hypot(a.1)).then(b.1.total_cmp(&a.1)));
    Ok(values)
}
