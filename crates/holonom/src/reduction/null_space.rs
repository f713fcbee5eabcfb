//! Accelerations and multipliers with the factors of [G; P] and a dense matrix of order ndof.

use super::chart::Chart;
use super::refinement::refine;
use crate::math::vector::larger;
use holonom_linalg::{BlockMatrix, BlockPattern, Cholesky, NotPositiveDefinite, gram_add};

/// Buffers of
///
/// ```text
/// M̂ v̈ = Dᵀ(Q − M S τ)    M̂ = DᵀMD    q̈ = D v̈ + S τ    λ = Sᵀ(Q − M q̈)
/// ```
///
/// Source: thesis (3.13), (3.14), (3.30). Matrices by rows.
#[derive(Debug, Clone)]
pub(super) struct NullSpace {
    /// D, n×ndof.
    pub(super) d: Vec<f64>,
    /// M D.
    inertia: Vec<f64>,
    mass: Vec<f64>,
    factor: Cholesky,
    rate: Vec<f64>,
    correction: Vec<f64>,
    zero: Vec<f64>,
    force: Vec<f64>,
}

// Parts of a multiplication in a sparse elimination, measured in `benchmarks/accelerations`: to read an entry
// for a group of right-hand sides, to multiply it with one of them, and to multiply dense matrices.
const ENTRY: f64 = 0.4;
const LANE: f64 = 0.08;
const DENSE: f64 = 0.05;
/// Right-hand sides that are taken together.
const GROUP: f64 = 24.0;
/// Calls of dense kernels, as many multiplications.
const CALLS: f64 = 400.0;

impl NullSpace {
    /// Predicted operations of one solve, in multiplications of a sparse elimination.
    pub(super) fn cost(chart: &Chart, mass: &BlockPattern) -> f64 {
        let (n, ndof) = (mass.n_rows() as f64, chart.ndof() as f64);
        let entries = 2.0 * chart.fill() as f64 + mass.len() as f64;
        let columns = entries * (ENTRY * (ndof / GROUP).ceil() + LANE * ndof);
        let columns = columns + 2.0 * n * ndof;
        CALLS + columns + DENSE * ndof * ndof * (n + ndof / 3.0)
    }

    pub(super) fn new(n: usize, ndof: usize) -> Self {
        Self {
            d: vec![0.0; n * ndof],
            inertia: vec![0.0; n * ndof],
            mass: vec![0.0; ndof * ndof],
            factor: Cholesky::new(ndof),
            rate: vec![0.0; ndof],
            correction: vec![0.0; ndof],
            zero: vec![0.0; ndof],
            force: vec![0.0; n],
        }
    }

    /// D at the chart's factors.
    pub(super) fn update(&mut self, chart: &mut Chart) {
        chart.null_space(&mut self.d);
    }

    /// x += D p.
    pub(super) fn add(&self, p: &[f64], x: &mut [f64]) {
        for (x, row) in x.iter_mut().zip(self.d.chunks_exact(p.len().max(1))) {
            *x += row.iter().zip(p).map(|(d, p)| d * p).sum::<f64>();
        }
    }

    /// Accelerations for the forces Q and right-hand sides τ at the configuration of the last
    /// [`NullSpace::update`], the chart's factors and `mass`. Returns the relative size of the next correction
    /// as forecast: far above round-off it says that M̂ is too ill-conditioned here.
    ///
    /// # Errors
    /// When M̂ is not positive definite.
    pub(super) fn accelerate(
        &mut self,
        chart: &mut Chart,
        mass: &BlockMatrix,
        force: &[f64],
        tau: &[f64],
        a: &mut [f64],
    ) -> Result<f64, NotPositiveDefinite> {
        let (n, ndof) = (force.len(), self.rate.len());
        chart.solve(tau, &self.zero, a);
        if ndof == 0 {
            return Ok(0.0);
        }
        self.inertia.fill(0.0);
        mass.multiply_many_add(1.0, &self.d, ndof, &mut self.inertia);
        self.mass.fill(0.0);
        gram_add(n, ndof, &self.d, &self.inertia, &mut self.mass);
        self.factor.factor(&self.mass)?;
        self.rate.fill(0.0);
        // Dᵀ(Q − M S τ) = DᵀQ − (M D)ᵀ S τ, as M is symmetric.
        let rows = self.d.chunks_exact(ndof).zip(self.inertia.chunks_exact(ndof));
        for ((d, inertia), (f, a)) in rows.zip(force.iter().zip(&*a)) {
            for (rate, (d, m)) in self.rate.iter_mut().zip(d.iter().zip(inertia)) {
                *rate += d * f - m * a;
            }
        }
        let diagonal = self.mass.iter().step_by(ndof + 1);
        let forces = self.rate.iter().zip(diagonal).map(|(f, m)| f * f / m).fold(0.0, larger);
        self.factor.solve(&mut self.rate);
        self.add(&self.rate, a);
        Ok(self.refine(mass, force, a, forces.sqrt()))
    }

    /// Corrects v̈ by what q̈ leaves of the equations of motion in the directions of D; M̂ has the square of the
    /// condition of M^½D. `forces` is the size of its right-hand side, over roots of masses.
    fn refine(&mut self, mass: &BlockMatrix, force: &[f64], a: &mut [f64], forces: f64) -> f64 {
        let ndof = self.rate.len();
        let size = |x: &[f64], of: &[f64]| {
            let squares = x.iter().zip(of.iter().step_by(ndof + 1)).map(|(x, m)| x * x * m);
            squares.fold(0.0, larger).sqrt()
        };
        refine(|| {
            self.force.copy_from_slice(force);
            mass.multiply_add(-1.0, a, &mut self.force);
            self.correction.fill(0.0);
            for (d, f) in self.d.chunks_exact(ndof).zip(&self.force) {
                self.correction.iter_mut().zip(d).for_each(|(x, d)| *x += d * f);
            }
            self.factor.solve(&mut self.correction);
            self.add(&self.correction, a);
            self.rate.iter_mut().zip(&self.correction).for_each(|(x, d)| *x += d);
            (size(&self.correction, &self.mass), larger(forces, size(&self.rate, &self.mass)))
        })
    }

    /// Multipliers for the forces Q at accelerations that belong to them; dropped rows get λ = 0.
    pub(super) fn multipliers(
        &mut self,
        chart: &mut Chart,
        mass: &BlockMatrix,
        force: &[f64],
        a: &[f64],
        lambda: &mut [f64],
    ) {
        self.force.copy_from_slice(force);
        mass.multiply_add(-1.0, a, &mut self.force);
        // What is left in the directions of D is round-off.
        chart.solve_transposed(&self.force, lambda, &mut self.rate);
    }
}
