//! Counts of operations.

use std::ops::{Add, AddAssign, Mul};

/// Counts of scalar operations.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
#[allow(missing_docs, reason = "they say what they are")]
pub struct Operations {
    pub additions: usize,
    pub multiplications: usize,
    pub divisions: usize,
    pub roots: usize,
}

impl Operations {
    /// Of as many products that are summed.
    pub(super) fn products(count: usize) -> Self {
        Self { additions: count, multiplications: count, ..Self::default() }
    }

    /// Of the Cholesky factorization of a full n×n matrix.
    pub fn cholesky(n: usize) -> Self {
        let inner = (0..n).map(|i| i * (i + 1) / 2).sum();
        Self {
            additions: inner,
            multiplications: inner,
            divisions: n * n.saturating_sub(1) / 2,
            roots: n,
        }
    }

    /// Of a solution with a full triangular n×n matrix.
    pub fn triangular(n: usize) -> Self {
        let inner = n * n.saturating_sub(1) / 2;
        Self { additions: inner, multiplications: inner, divisions: n, roots: 0 }
    }

    /// Of elimination with a full n×n matrix and one right-hand side.
    pub fn gauss(n: usize) -> Self {
        let inner: usize = (0..n).map(|i| i * i + i).sum::<usize>() + n * n.saturating_sub(1) / 2;
        let divisions = n * n.saturating_sub(1) / 2 + n;
        Self { additions: inner, multiplications: inner, divisions, roots: 0 }
    }
}

impl Add for Operations {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            additions: self.additions + other.additions,
            multiplications: self.multiplications + other.multiplications,
            divisions: self.divisions + other.divisions,
            roots: self.roots + other.roots,
        }
    }
}

impl AddAssign for Operations {
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl Mul<usize> for Operations {
    type Output = Self;

    fn mul(self, factor: usize) -> Self {
        Self {
            additions: self.additions * factor,
            multiplications: self.multiplications * factor,
            divisions: self.divisions * factor,
            roots: self.roots * factor,
        }
    }
}

/// Operations by the steps of Algorithm 4 of Negrut's thesis.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Stages {
    /// Step 1, M = L Lᵀ.
    pub factor: Operations,
    /// Step 2, L zₙ = Q.
    pub force: Operations,
    /// Step 3.1, L T = Φᵀ.
    pub columns: Operations,
    /// Step 3.2, zₘ = Tᵀzₙ − τ.
    pub right_side: Operations,
    /// Step 3.3, TᵀT.
    pub products: Operations,
    /// Step 3.4, TᵀT λ = zₘ.
    pub multipliers: Operations,
    /// Step 3.5, T λ.
    pub back: Operations,
    /// Step 4, Lᵀ q̈ = zₙ − T λ.
    pub accelerations: Operations,
}

impl Stages {
    /// Of full matrices with n coordinates and m rows (Alg-D).
    pub fn full(n: usize, m: usize) -> Self {
        Self {
            factor: Operations::cholesky(n),
            force: Operations::triangular(n),
            columns: Operations::triangular(n) * m,
            right_side: Operations::products(n * m),
            products: Operations::products(n * m * (m + 1) / 2),
            multipliers: Operations::cholesky(m) + Operations::triangular(m) * 2,
            back: Operations::products(n * m),
            accelerations: Operations::triangular(n),
        }
    }

    /// Of all steps.
    pub fn total(&self) -> Operations {
        self.factor
            + self.force
            + self.columns
            + self.right_side
            + self.products
            + self.multipliers
            + self.back
            + self.accelerations
    }
}
