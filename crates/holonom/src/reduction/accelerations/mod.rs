//! Accelerations and multipliers in Cartesian coordinates, by several solvers of the same equations.

mod accelerator;
mod articulated;
mod augmented;
mod choice;
mod products;
mod reduced;
mod solvers;

pub use crate::model::Accelerations;
pub use accelerator::Accelerator;
pub(in crate::reduction) use accelerator::Known;
pub use choice::AccelerationCosts;
pub use reduced::{ReducedMatrix, Refusal};

use crate::error::EvaluationFailure;
use crate::system::System;
#[cfg(feature = "general-sparse")]
use augmented::AugmentedGeneral;
use augmented::{AugmentedDense, AugmentedSparse};
use holonom_linalg::{BlockGraph, BlockMatrix, gibbs_king, least_envelope, reverse_cuthill_mckee};
pub use solvers::{DenseFactor, ReducedDense, ReducedEnvelope};

/// The equations M q̈ + Gᵀλ = Q, G q̈ = τ at one state.
#[derive(Debug, Clone, Copy)]
pub struct IndexOneEquations<'a> {
    /// Coordinates.
    pub q: &'a [f64],
    /// M(q).
    pub mass: &'a BlockMatrix,
    /// G(q).
    pub jacobian: &'a BlockMatrix,
    /// Q.
    pub force: &'a [f64],
    /// τ.
    pub tau: &'a [f64],
}

/// Solves the equations of one structure again and again; symbolic work is done before.
pub trait AccelerationSolver: std::fmt::Debug {
    /// Accelerations and multipliers; dropped rows get λ = 0.
    ///
    /// # Errors
    /// `simulation/singular-mass`, `simulation/singular-configuration` where nothing is determined.
    fn solve(
        &mut self,
        system: &dyn System,
        equations: &IndexOneEquations,
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure>;

    /// Order of the matrix that is factored.
    fn order(&self) -> usize;

    /// Multiplications of one solve, assembly and factorisation included; none before the first solve
    /// where numbers decide.
    fn multiplications(&self) -> Option<usize>;
}

/// A numbering of joints.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Numbering {
    /// As in the model, drivers last.
    Given,
    /// The first joint, the last, the second, the last but one, …: bad on purpose.
    Alternating,
    /// Reverse Cuthill-McKee.
    ReverseCuthillMckee,
    /// Gibbs-King.
    GibbsKing,
    /// The best of the given one, Gibbs-King and reverse Cuthill-McKee.
    Least,
    /// The joint at each position.
    Listed(Vec<usize>),
}

impl Numbering {
    /// The joint at each position.
    pub fn order(&self, graph: &BlockGraph) -> Vec<usize> {
        let count = graph.len();
        match self {
            Self::Given => (0..count).collect(),
            Self::Alternating => {
                // Numbers 1, n, 2, n − 1, … go to the joints in turn.
                let mut order = vec![0; count];
                for k in 0..count {
                    order[if k % 2 == 0 { k / 2 } else { count - 1 - k / 2 }] = k;
                }
                order
            }
            Self::ReverseCuthillMckee => reverse_cuthill_mckee(graph),
            Self::GibbsKing => gibbs_king(graph),
            Self::Least => least_envelope(graph),
            Self::Listed(order) => order.clone(),
        }
    }
}

/// The solvers that can be compared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum SolverKind {
    /// Dense LU of the augmented matrix.
    AugmentedDense,
    /// Sparse LU of the augmented matrix, pivots chosen at the first solve and where they no longer serve.
    AugmentedSparse,
    /// Sparse LU of the augmented matrix, pivots chosen anew at every solve.
    AugmentedSparsePivoting,
    /// A library's general sparse LU of the augmented matrix: pivots chosen at every solve, the order of
    /// columns once.
    #[cfg(feature = "general-sparse")]
    AugmentedGeneral,
    /// Dense LU of the reduced matrix.
    ReducedDenseLu,
    /// Dense Cholesky factorisation of the reduced matrix.
    ReducedDenseCholesky,
    /// Envelope Cholesky factorisation of the reduced matrix: the topology-based solver.
    ReducedEnvelope(Numbering),
}

impl SolverKind {
    /// The solver for a system and its kept rows.
    ///
    /// # Errors
    /// [`Refusal`] where there is no reduced matrix; the augmented ones take every system.
    pub fn prepare(
        &self,
        system: &dyn System,
        q: &[f64],
        kept: &[usize],
    ) -> Result<Box<dyn AccelerationSolver>, Refusal> {
        let reduced = || ReducedMatrix::new(system, kept);
        let dense = |factor| Ok(Box::new(ReducedDense::new(reduced()?, factor)) as Box<_>);
        match self {
            Self::AugmentedDense => Ok(Box::new(AugmentedDense::new(system, q, kept))),
            Self::AugmentedSparse => Ok(Box::new(AugmentedSparse::new(system, q, kept, false))),
            Self::AugmentedSparsePivoting => {
                Ok(Box::new(AugmentedSparse::new(system, q, kept, true)))
            }
            #[cfg(feature = "general-sparse")]
            Self::AugmentedGeneral => Ok(Box::new(AugmentedGeneral::new(system, q, kept))),
            Self::ReducedDenseLu => dense(DenseFactor::Lu),
            Self::ReducedDenseCholesky => dense(DenseFactor::Cholesky),
            Self::ReducedEnvelope(numbering) => {
                Ok(Box::new(ReducedEnvelope::new(reduced()?, numbering)))
            }
        }
    }
}
