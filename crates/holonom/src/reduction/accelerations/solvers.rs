//! Solvers of the reduced system B λ = G M⁻¹ Q − τ.

use super::{AccelerationSolver, Equations, Numbering, ReducedMatrix};
use crate::error::EvaluationFailure;
use crate::reduction::saddle::Saddle;
use crate::system::System;
use holonom_linalg::{Cholesky, DenseLu, EnvelopeCholesky, EnvelopePlan};
use std::sync::Arc;

/// By a Cholesky factorisation in the envelope of a numbering of the joints.
///
/// Source: thesis, Algorithm 3 of chapter 3.4.
#[derive(Debug, Clone)]
pub struct ReducedEnvelope {
    matrix: ReducedMatrix,
    factor: EnvelopeCholesky,
    values: Vec<f64>,
    lambda: Vec<f64>,
    correction: Vec<f64>,
}

/// Solutions are refined where a pivot is below this part of its diagonal entry: B has the square of the
/// condition of H.
const REFINE: f64 = 1e-2;
const MOST_REFINEMENTS: u32 = 4;
/// A multiplication in a block takes about this part of the time of one in a sparse elimination
/// (`benchmarks/accelerations`: 0.2 to 0.45).
const BLOCK_COST: f64 = 0.4;
/// A correction of this part of the multipliers is the last one.
const REFINED: f64 = 1e-13;

impl ReducedEnvelope {
    /// Numbers the joints and plans the factorisation.
    pub fn new(mut matrix: ReducedMatrix, numbering: &Numbering) -> Self {
        let plan = Arc::new(EnvelopePlan::new(matrix.graph(), &numbering.order(matrix.graph())));
        let rows = matrix.graph().sizes().to_vec();
        matrix.place(|i, j| plan.in_order(i, j), |i, j| (plan.block(i, j).start, rows[j]));
        Self {
            lambda: vec![0.0; matrix.n()],
            correction: vec![0.0; matrix.n()],
            values: vec![0.0; plan.len()],
            factor: EnvelopeCholesky::new(plan),
            matrix,
        }
    }

    /// Places and counts.
    pub fn plan(&self) -> &EnvelopePlan {
        self.factor.plan()
    }

    /// Whether this costs less than the index-1 matrix with the pivots it has; no where it has none yet.
    pub fn pays(&self, saddle: &Saddle) -> bool {
        let own = BLOCK_COST * self.multiplications().unwrap_or(usize::MAX) as f64;
        saddle.multiplications().is_some_and(|other| own < other as f64)
    }

    /// Factors B at a configuration with this Jacobian.
    ///
    /// # Errors
    /// `simulation/singular-configuration` naming a row that depends on others.
    pub fn factor(
        &mut self,
        system: &dyn System,
        equations: &Equations,
    ) -> Result<(), EvaluationFailure> {
        self.matrix.assemble(equations.q, equations.jacobian, &mut self.values);
        self.factor.factor(&self.values).map_err(|e| self.matrix.singular(system, e.index))
    }

    /// Accelerations and multipliers with the factors at hand.
    pub fn solve_factored(&mut self, equations: &Equations, a: &mut [f64], lambda: &mut [f64]) {
        self.matrix.right_side(equations, &mut self.lambda);
        self.factor.solve(&mut self.lambda);
        self.matrix.subtract_reactions(&self.lambda);
        if self.factor.least_pivot() < REFINE {
            self.refine(equations);
        }
        self.matrix.recover(equations, &self.lambda, a, lambda);
    }

    /// Corrections of y and λ by what y leaves of its constraints, while they fall tenfold: corrected
    /// seminormal equations.
    ///
    /// Source: Å. Björck, Linear Algebra Appl. 88/89 (1987).
    fn refine(&mut self, equations: &Equations) {
        let size = |x: &[f64]| x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let mut before = f64::INFINITY;
        for _ in 0..MOST_REFINEMENTS {
            self.matrix.residual(equations, &mut self.correction);
            self.factor.solve(&mut self.correction);
            let correction = size(&self.correction);
            // Written so that a NaN ends it.
            let falls = correction <= 0.1 * before;
            if !falls {
                break;
            }
            self.matrix.subtract_reactions(&self.correction);
            for (l, d) in self.lambda.iter_mut().zip(&self.correction) {
                *l += d;
            }
            if correction <= REFINED * size(&self.lambda) {
                break;
            }
            before = correction;
        }
    }
}

impl AccelerationSolver for ReducedEnvelope {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &Equations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.factor(system, equations)?;
        self.solve_factored(equations, a, lambda);
        Ok(())
    }

    fn order(&self) -> usize {
        self.matrix.n()
    }

    fn multiplications(&self) -> Option<usize> {
        let plan = self.plan();
        Some(self.matrix.multiplications() + plan.multiplications() + 2 * plan.len())
    }
}

/// How a dense reduced matrix is factored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DenseFactor {
    /// LU with partial pivoting.
    Lu,
    /// Cholesky.
    Cholesky,
}

#[derive(Debug, Clone)]
enum Factor {
    Lu(DenseLu),
    Cholesky(Cholesky),
}

/// By a dense factorisation.
#[derive(Debug, Clone)]
pub struct ReducedDense {
    matrix: ReducedMatrix,
    factor: Factor,
    /// B by rows.
    values: Vec<f64>,
    lambda: Vec<f64>,
}

impl ReducedDense {
    /// Room for a dense matrix.
    pub fn new(mut matrix: ReducedMatrix, factor: DenseFactor) -> Self {
        let (n, begin) = (matrix.n(), matrix.begins());
        matrix.place(|i, j| i <= j, |i, j| (begin[i] * n + begin[j], n));
        let factor = match factor {
            DenseFactor::Lu => Factor::Lu(DenseLu::new(n)),
            DenseFactor::Cholesky => Factor::Cholesky(Cholesky::new(n)),
        };
        Self { lambda: vec![0.0; n], values: vec![0.0; n * n], factor, matrix }
    }
}

impl AccelerationSolver for ReducedDense {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &Equations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let matrix = &mut self.matrix;
        matrix.assemble(equations.q, equations.jacobian, &mut self.values);
        matrix.right_side(equations, &mut self.lambda);
        match &mut self.factor {
            Factor::Lu(lu) => {
                let n = lu.n();
                for i in 1..n {
                    for j in 0..i {
                        self.values[i * n + j] = self.values[j * n + i];
                    }
                }
                lu.factor(&self.values).map_err(|e| matrix.singular(system, e.row))?;
                lu.solve(&mut self.lambda);
            }
            Factor::Cholesky(cholesky) => {
                cholesky.factor(&self.values).map_err(|e| matrix.singular(system, e.index))?;
                cholesky.solve(&mut self.lambda);
            }
        }
        matrix.subtract_reactions(&self.lambda);
        matrix.recover(equations, &self.lambda, a, lambda);
        Ok(())
    }

    fn order(&self) -> usize {
        self.matrix.n()
    }

    fn multiplications(&self) -> Option<usize> {
        let n = self.matrix.n();
        let factor = match self.factor {
            Factor::Lu(_) => n * (n * n).saturating_sub(1) / 3,
            Factor::Cholesky(_) => n * (n * n).saturating_sub(1) / 6,
        };
        Some(self.matrix.multiplications() + factor + n * n)
    }
}
