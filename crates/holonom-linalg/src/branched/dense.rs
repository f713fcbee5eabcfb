//! Algorithm 4 with full matrices (Alg-D).

use crate::dense::Cholesky;
use crate::error::NotPositiveDefinite;
use crate::gram::gram_add;

/// Solves M q̈ + Φᵀλ = Q, Φ q̈ = τ by two Cholesky factorizations of full matrices: faster than one that knows
/// the zeros where a tree is small and has few branches.
#[derive(Debug, Clone)]
pub struct DenseAugmented {
    rows: usize,
    mass: Cholesky,
    products: Cholesky,
    /// T = L⁻¹Φᵀ, n×m by rows.
    t: Vec<f64>,
    s: Vec<f64>,
}

impl DenseAugmented {
    /// Room for n coordinates and m rows.
    pub fn new(n: usize, m: usize) -> Self {
        Self {
            rows: m,
            mass: Cholesky::new(n),
            products: Cholesky::new(m),
            t: vec![0.0; n * m],
            s: vec![0.0; m * m],
        }
    }

    /// Factors M, n×n by rows, and TᵀT; `rows_transposed` is Φᵀ, n×m by rows (steps 1, 3.1, 3.3).
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] where M, or Φ M⁻¹Φᵀ, has no positive pivot.
    pub fn factor(
        &mut self,
        mass: &[f64],
        rows_transposed: &[f64],
    ) -> Result<(), NotPositiveDefinite> {
        self.mass.factor(mass)?;
        self.t.copy_from_slice(rows_transposed);
        if self.rows == 0 {
            return Ok(());
        }
        self.mass.solve_lower(&mut self.t, self.rows);
        self.s.fill(0.0);
        gram_add(self.mass.n(), self.rows, &self.t, &self.t, &mut self.s);
        self.products.factor(&self.s)
    }

    /// Accelerations and multipliers: `force` is Q and becomes q̈, `tau` becomes λ (steps 2, 3.2, 3.4, 3.5, 4).
    ///
    /// # Panics
    /// If the vectors have not n and m entries.
    pub fn solve(&self, force: &mut [f64], tau: &mut [f64]) {
        self.mass.solve_lower(force, 1);
        tau.iter_mut().for_each(|x| *x = -*x);
        for (z, t) in force.iter().zip(self.t.chunks_exact(self.rows.max(1))) {
            tau.iter_mut().zip(t).for_each(|(x, t)| *x += z * t);
        }
        if self.rows > 0 {
            self.products.solve(tau);
        }
        for (z, t) in force.iter_mut().zip(self.t.chunks_exact(self.rows.max(1))) {
            *z -= t.iter().zip(&*tau).map(|(t, x)| t * x).sum::<f64>();
        }
        self.mass.solve_upper(force, 1);
    }
}
