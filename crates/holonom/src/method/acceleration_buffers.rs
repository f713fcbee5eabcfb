//! What a form keeps for stages that have accelerations as unknowns.

use crate::system::Sizes;

/// What stages with accelerations as unknowns need beside the first-order form.
#[derive(Debug, Clone)]
pub(super) struct AccelerationBuffers {
    /// Iterate w.
    pub(super) trial: Vec<f64>,
    pub(super) correction: Vec<f64>,
    /// q, q̇ and q̈ at the start of the step and at its end.
    pub(super) ends: [[Vec<f64>; 3]; 2],
}

impl AccelerationBuffers {
    pub(super) fn new(ndof: usize, sizes: &Sizes) -> Self {
        let all = || std::array::from_fn(|_| vec![0.0; sizes.coordinates]);
        Self {
            trial: vec![0.0; 2 * ndof + sizes.extra_states],
            correction: vec![0.0; ndof],
            ends: [all(), all()],
        }
    }

    pub(super) fn resize(&mut self, ndof: usize) {
        let extra = self.trial.len() - 2 * self.correction.len();
        self.trial.resize(2 * ndof + extra, 0.0);
        self.correction.resize(ndof, 0.0);
    }
}
