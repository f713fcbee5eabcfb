//! Solvers of the reduced system B λ = G M⁻¹ Q − τ.

use super::{AccelerationSolver, IndexOneEquations, Numbering, ReducedMatrix, Refusal};
use crate::error::EvaluationFailure;
use crate::math::vector::larger;
use crate::reduction::refinement::{largest, refine};
use crate::system::System;
use holonom_linalg::{Cholesky, DenseLu, EnvelopeCholesky, EnvelopePlan, NotPositiveDefinite};
use std::sync::Arc;

/// By a Cholesky factorisation in the envelope of a numbering of the joints.
///
/// Source: thesis, Algorithm 3 of chapter 3.4.
#[derive(Debug)]
pub struct ReducedEnvelope {
    matrix: ReducedMatrix,
    plan: Arc<EnvelopePlan>,
    /// There from the first factorisation on, in copies too: many of them never come to one.
    numbers: Option<Box<EnvelopeNumbers>>,
}

#[derive(Debug)]
struct EnvelopeNumbers {
    values: Vec<f64>,
    factor: EnvelopeCholesky,
    lambda: Vec<f64>,
    correction: Vec<f64>,
}

impl Clone for ReducedEnvelope {
    fn clone(&self) -> Self {
        Self { matrix: self.matrix.clone(), plan: self.plan.clone(), numbers: None }
    }
}

impl ReducedEnvelope {
    /// Numbers the joints and plans the factorisation.
    pub fn new(matrix: ReducedMatrix, numbering: &Numbering) -> Self {
        let plan = EnvelopePlan::new(matrix.graph(), &numbering.order(matrix.graph()));
        Self::with_plan(matrix, plan)
    }

    /// For what a plan places. Joints are renumbered as they stand there.
    pub fn with_plan(mut matrix: ReducedMatrix, plan: EnvelopePlan) -> Self {
        matrix.renumber(plan.order());
        let plan = Arc::new(plan.renumbered());
        let rows = matrix.graph().sizes().to_vec();
        matrix.place(|i, j| i <= j, |i, j| (plan.block(i, j).start, rows[j]));
        Self { numbers: None, plan, matrix }
    }

    /// A copy with this plan for other numbers of the same structure.
    ///
    /// # Errors
    /// [`Refusal::Massless`].
    pub fn with_values(&self, system: &dyn System) -> Result<Self, Refusal> {
        Ok(Self { matrix: self.matrix.with_values(system)?, ..self.clone() })
    }

    /// Gives up its numbers until the next factorisation.
    pub(super) fn release(&mut self) {
        self.matrix.release();
        self.numbers = None;
    }

    /// Places and counts.
    pub fn plan(&self) -> &EnvelopePlan {
        &self.plan
    }

    /// Accelerations and multipliers. Returns the relative size of the next correction as forecast: far above
    /// round-off it says that B is too ill-conditioned here.
    ///
    /// # Errors
    /// At a reduced row that depends on others.
    pub fn accelerate(
        &mut self,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<f64, NotPositiveDefinite> {
        let Self { matrix, plan, numbers } = self;
        let numbers = numbers.get_or_insert_with(|| {
            Box::new(EnvelopeNumbers {
                values: vec![0.0; plan.len()],
                factor: EnvelopeCholesky::new(plan.clone()),
                lambda: vec![0.0; matrix.n()],
                correction: vec![0.0; matrix.n()],
            })
        });
        matrix.assemble(equations.q, equations.jacobian, &mut numbers.values);
        let forces = matrix.right_side(equations, &mut numbers.lambda);
        numbers.factor.factor_solve(&numbers.values, &mut numbers.lambda)?;
        matrix.subtract_reactions(&numbers.lambda);
        let left = numbers.refine(matrix, equations, forces);
        matrix.recover(equations, &numbers.lambda, a, lambda);
        Ok(left)
    }
}

impl EnvelopeNumbers {
    /// Corrects y and λ by what y leaves of its constraints: corrected seminormal equations. Sizes are those of
    /// forces over roots of masses: of λ by the diagonal of B, of `forces` alone.
    ///
    /// Source: Å. Björck, Linear Algebra Appl. 88/89 (1987).
    fn refine(
        &mut self,
        matrix: &mut ReducedMatrix,
        equations: &IndexOneEquations,
        forces: f64,
    ) -> f64 {
        let Self { factor, lambda, correction, .. } = self;
        refine(|| {
            matrix.residual(equations, correction);
            factor.solve(correction);
            let size = |x: &[f64]| largest(x, factor.diagonal(), |x, b| x * x * b).sqrt();
            matrix.subtract_reactions(correction);
            lambda.iter_mut().zip(&*correction).for_each(|(l, d)| *l += d);
            (size(correction), larger(forces, size(lambda)))
        })
    }
}

impl AccelerationSolver for ReducedEnvelope {
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let outcome = self.accelerate(equations, a, lambda);
        outcome.map(|_| ()).map_err(|e| self.matrix.singular(system, e.index))
    }

    fn order(&self) -> usize {
        self.matrix.n()
    }

    fn multiplications(&self) -> Option<usize> {
        Some(self.matrix.multiplications() + envelope_multiplications(self.plan()))
    }
}

/// Multiplications of a factorisation, a solve and a correction.
pub(super) fn envelope_multiplications(plan: &EnvelopePlan) -> usize {
    plan.multiplications() + 4 * plan.len()
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
        equations: &IndexOneEquations,
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
