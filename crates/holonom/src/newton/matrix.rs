//! What a representation of the matrix supplies.

use super::descriptor::Unknowns;
use super::linearization::Linearization;
use crate::error::EvaluationFailure;
use crate::model::{JacobianSource, Representation};
use crate::reduction::{Manifold, Point};
use crate::threads::Threads;
use holonom_linalg::{Complex64, SingularMatrix};

/// What is asked of a matrix.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct MatrixOptions {
    /// Where the parts come from.
    pub source: JacobianSource,
    /// Where there is a choice of representations.
    pub representation: Representation,
    /// Whether formulas need the Jacobian itself, and not only a matrix that their iterations contract with.
    pub exact: bool,
    /// Who shares the work where there is enough of it.
    pub threads: Threads,
}

impl Representation {
    /// Whether it is one with the pattern of the mechanism.
    pub fn is_sparse(self) -> bool {
        !matches!(self, Self::Auto | Self::Dense)
    }
}

/// A representation of the integration Jacobian: what it must supply for stages that have
/// accelerations as unknowns.
pub trait Matrix: std::fmt::Debug + Clone + Send + 'static {
    /// For the manifold's present parametrization; patterns are found at the configuration `q`.
    fn new(manifold: &Manifold, q: &[f64], options: &MatrixOptions) -> Self;

    /// Whether it is made of reduced blocks, dense of order ndof.
    fn is_reduced(&self) -> bool {
        true
    }

    /// From the next linearization on the matrix may leave out of the Jacobian what slows iterations little.
    fn simplify(&mut self, _simplify: bool) {}

    /// Whether the last linearization has left that out.
    fn is_simplified(&self) -> bool {
        false
    }

    /// Whether its parts come along the tree where accelerations did: it needs neither [G; P] nor multipliers of the
    /// tree's joints then.
    fn goes_along(&self) -> bool {
        false
    }

    /// Evaluates the parts that do not depend on the step at a complete point, and of the blocks what
    /// the solves need.
    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point);

    /// Takes the parts from reduced blocks that were found by differences at a complete point.
    fn take_blocks(&mut self, parts: &Linearization, manifold: &Manifold);

    /// Sums and factors for the coefficients γh and βh² of `parts`; returns the number of symbolic
    /// analyses made.
    ///
    /// # Errors
    /// When the matrix is singular.
    fn factor(&mut self, parts: &Linearization) -> Result<u64, SingularMatrix>;

    /// δv̈ = −Ψ⁻¹ (M̂₁' δv̇ + M̂₂' δv + Ẑ δz) into `rate`; `z` holds δz at fixed v and v̇.
    fn respond(
        &mut self,
        parts: &mut Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    );

    /// v ← M̂ v.
    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]);
}

/// What it must supply beyond that for stages that have q̈ and λ as unknowns too.
pub trait DescriptorForm: Matrix {
    /// Residuals in `x` become corrections; `z` holds δz at fixed v and v̇.
    fn correct_unknowns(&mut self, parts: &mut Linearization, z: &[f64], x: &mut Unknowns);
}

/// What it must supply beyond that for formulas of first-order equations.
pub trait FirstOrderMatrix: Matrix {
    /// δv̈ = −Ψ⁻¹ (ψ + Ẑ δz), ψ and then δv̈ in `rate`; an empty `z` stands for zeros.
    fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]);

    /// The first two of (5) in `docs/theory/newton.md`, for M̂ r_v in `v` and E⁻¹ r_z in `z`.
    fn solve(&mut self, parts: &mut Linearization, p: &mut [f64], v: &mut [f64], z: &[f64]);

    /// Factors for a complex γh, beside the real factor.
    ///
    /// # Errors
    /// When the matrix is singular.
    fn factor_complex(
        &mut self,
        parts: &Linearization,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix>;

    /// x + iy ← (I − γhJ)⁻¹ (x + iy), with M̂ r_v in the velocity entries.
    fn solve_complex(&mut self, parts: &mut Linearization, x: &mut [f64], y: &mut [f64]);

    /// Explicit time dependence of v̈ and ż at the point.
    ///
    /// # Errors
    /// When M̂ is singular.
    fn time_derivative(
        &mut self,
        parts: &mut Linearization,
        point: &mut Point,
        v_rate: &mut [f64],
        z_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure>;
}
