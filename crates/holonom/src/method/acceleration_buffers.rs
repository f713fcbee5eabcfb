//! What a form keeps for stages that have accelerations as unknowns.

use crate::system::Sizes;

/// What stages with accelerations as unknowns need beside the first-order form.
#[derive(Debug, Clone)]
pub(super) struct AccelerationBuffers {
    /// Iterate w.
    pub(super) trial: Vec<f64>,
    pub(super) correction: Vec<f64>,
    /// q, q̇ and q̈ at the start of the step and at its end; they have room from the first step that has such stages.
    pub(super) ends: [[Vec<f64>; 3]; 2],
}

impl AccelerationBuffers {
    pub(super) fn new(ndof: usize, sizes: &Sizes) -> Self {
        Self {
            trial: vec![0.0; 2 * ndof + sizes.extra_states],
            correction: vec![0.0; ndof],
            ends: Default::default(),
        }
    }

    pub(super) fn resize(&mut self, ndof: usize) {
        let extra = self.trial.len() - 2 * self.correction.len();
        self.trial.resize(2 * ndof + extra, 0.0);
        self.correction.resize(ndof, 0.0);
    }
}
