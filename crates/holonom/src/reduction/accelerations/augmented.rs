//! Solvers of the augmented system [M Gᵀ; G 0] (q̈, λ) = (Q, τ).

use super::{AccelerationSolver, IndexOneEquations};
use crate::error::EvaluationFailure;
use crate::reduction::saddle::{Saddle, singular};
use crate::reduction::structural::structural_nonzeros;
use crate::system::System;
use holonom_linalg::DenseLu;
#[cfg(feature = "general-sparse")]
use holonom_linalg::GeneralSparseLu;

fn saddle(system: &dyn System, q: &[f64], kept: &[usize]) -> Saddle {
    let (nonzero_g, nonzero_m) = structural_nonzeros(system, q);
    Saddle::new(system, q, kept, &nonzero_g, &nonzero_m)
}

/// By a sparse LU.
#[derive(Debug)]
pub(super) struct AugmentedSparse {
    saddle: Saddle,
    pivoting: bool,
}

impl AugmentedSparse {
    pub(super) fn new(system: &dyn System, q: &[f64], kept: &[usize], pivoting: bool) -> Self {
        Self { saddle: saddle(system, q, kept), pivoting }
    }
}

impl AccelerationSolver for AugmentedSparse {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        if self.pivoting {
            self.saddle.forget_pivots();
        }
        self.saddle.set_mass(equations.mass);
        let IndexOneEquations { jacobian, force, tau, .. } = equations;
        self.saddle.solve(system, jacobian, force, tau, a, lambda)
    }

    fn order(&self) -> usize {
        self.saddle.order()
    }

    fn multiplications(&self) -> Option<usize> {
        self.saddle.multiplications()
    }
}

/// By a dense LU.
#[derive(Debug)]
pub(super) struct AugmentedDense {
    saddle: Saddle,
    matrix: Vec<f64>,
    lu: DenseLu,
}

impl AugmentedDense {
    pub(super) fn new(system: &dyn System, q: &[f64], kept: &[usize]) -> Self {
        let saddle = saddle(system, q, kept);
        let n = saddle.order();
        Self { saddle, matrix: vec![0.0; n * n], lu: DenseLu::new(n) }
    }
}

impl AccelerationSolver for AugmentedDense {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.saddle.set_mass(equations.mass);
        self.saddle.load(equations.jacobian);
        self.saddle.write_dense(&mut self.matrix);
        self.lu.factor(&self.matrix).map_err(|e| singular(system, e, a.len()))?;
        self.lu.solve(self.saddle.right_side(equations.force, equations.tau));
        self.saddle.hand_out(a, lambda);
        Ok(())
    }

    fn order(&self) -> usize {
        self.lu.n()
    }

    fn multiplications(&self) -> Option<usize> {
        let n = self.lu.n();
        Some(n * (n * n - 1) / 3 + n * n)
    }
}

/// By a library's general sparse LU.
#[cfg(feature = "general-sparse")]
#[derive(Debug)]
pub(super) struct AugmentedGeneral {
    saddle: Saddle,
    lu: Option<GeneralSparseLu>,
}

#[cfg(feature = "general-sparse")]
impl AugmentedGeneral {
    pub(super) fn new(system: &dyn System, q: &[f64], kept: &[usize]) -> Self {
        Self { saddle: saddle(system, q, kept), lu: None }
    }
}

#[cfg(feature = "general-sparse")]
impl AccelerationSolver for AugmentedGeneral {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.saddle.set_mass(equations.mass);
        self.saddle.load(equations.jacobian);
        self.saddle.right_side(equations.force, equations.tau);
        let (pattern, values, b) = self.saddle.parts();
        let refused = |e| singular(system, e, a.len());
        let lu = match self.lu.take() {
            Some(lu) => lu,
            None => GeneralSparseLu::new(pattern).map_err(refused)?,
        };
        lu.solve(pattern, values, b).map_err(refused)?;
        self.lu = Some(lu);
        self.saddle.hand_out(a, lambda);
        Ok(())
    }

    fn order(&self) -> usize {
        self.saddle.order()
    }

    fn multiplications(&self) -> Option<usize> {
        None
    }
}
