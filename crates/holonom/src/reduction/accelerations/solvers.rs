//! Solvers of the reduced system B λ = G M⁻¹ Q − τ.

use super::{AccelerationSolver, Equations, Numbering, ReducedMatrix};
use crate::error::EvaluationFailure;
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
    rest: Rest,
}

/// What a solution leaves of the equations, and the correction.
#[derive(Debug, Clone, Default)]
struct Rest {
    force: Vec<f64>,
    tau: Vec<f64>,
    a: Vec<f64>,
    lambda: Vec<f64>,
}

/// Solutions are refined where a pivot is below this part of its diagonal entry: B has the square of the
/// condition of G.
const REFINE: f64 = 1e-2;
const MOST_REFINEMENTS: u32 = 4;
/// A correction of this part of the accelerations is the last one.
const REFINED: f64 = 1e-13;

impl ReducedEnvelope {
    /// Numbers the joints and plans the factorisation.
    pub fn new(system: &dyn System, mut matrix: ReducedMatrix, numbering: &Numbering) -> Self {
        let sizes = system.structure().sizes;
        let (n, m) = (sizes.coordinates, sizes.rows);
        let plan = Arc::new(EnvelopePlan::new(matrix.graph(), &numbering.order(matrix.graph())));
        let rows = matrix.graph().sizes().to_vec();
        matrix.place(|i, j| plan.in_order(i, j), |i, j| (plan.block(i, j).start, rows[j]));
        Self {
            lambda: vec![0.0; matrix.n()],
            values: vec![0.0; plan.len()],
            factor: EnvelopeCholesky::new(plan),
            matrix,
            rest: Rest {
                force: vec![0.0; n],
                tau: vec![0.0; m],
                a: vec![0.0; n],
                lambda: vec![0.0; m],
            },
        }
    }

    /// Places and counts.
    pub fn plan(&self) -> &EnvelopePlan {
        self.factor.plan()
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
        self.solve_once(equations, a, lambda);
        if self.factor.least_pivot() < REFINE {
            self.refine(equations, a, lambda);
        }
    }

    fn solve_once(&mut self, equations: &Equations, a: &mut [f64], lambda: &mut [f64]) {
        self.matrix.right_side(equations, &mut self.lambda);
        self.factor.solve(&mut self.lambda);
        self.matrix.recover(equations, &self.lambda, a, lambda);
    }

    /// Corrections by what is left of the augmented system, while they fall tenfold.
    fn refine(&mut self, equations: &Equations, a: &mut [f64], lambda: &mut [f64]) {
        let mut rest = std::mem::take(&mut self.rest);
        let mut before = f64::INFINITY;
        for _ in 0..MOST_REFINEMENTS {
            rest.force.copy_from_slice(equations.force);
            equations.mass.multiply_add(-1.0, a, &mut rest.force);
            equations.jacobian.multiply_transposed_add(-1.0, lambda, &mut rest.force);
            rest.tau.copy_from_slice(equations.tau);
            equations.jacobian.multiply_add(-1.0, a, &mut rest.tau);
            let left = Equations { force: &rest.force, tau: &rest.tau, ..*equations };
            self.solve_once(&left, &mut rest.a, &mut rest.lambda);
            let (mut correction, mut size) = (0.0f64, 0.0f64);
            for (a, d) in a.iter_mut().zip(&rest.a) {
                *a += d;
                correction = correction.max(d.abs());
                size = size.max(a.abs());
            }
            for (l, d) in lambda.iter_mut().zip(&rest.lambda) {
                *l += d;
            }
            // Written so that a NaN ends it.
            let goes_on = correction > REFINED * size && correction <= 0.1 * before;
            if !goes_on {
                break;
            }
            before = correction;
        }
        self.rest = rest;
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
