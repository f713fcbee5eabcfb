//! Multipliers of a redundant set of constraints.

use super::chart::Chart;
use crate::system::Sizes;
use holonom_linalg::{BlockMatrix, Cholesky};

/// Replaces the multipliers of a redundant set, where dropped rows have none, by those of minimum
/// norm with the same generalized forces: λ = (Gᵀ)⁺(Q − M q̈), normalisation rows left out of the norm.
///
/// With X the coefficients of the dropped rows in the kept ones, G_dᵀ = G_kᵀ X, all solutions are
/// (λ_k − X μ, μ); (1 + XᵀX) μ = Xᵀλ_k gives the shortest.
#[derive(Debug, Clone)]
pub(super) struct Redundant {
    /// Xᵀ, one row of m per dropped row.
    x: Vec<f64>,
    normal: Vec<f64>,
    mu: Vec<f64>,
    factor: Cholesky,
    unit: Vec<f64>,
    row: Vec<f64>,
    independent: Vec<f64>,
}

impl Redundant {
    /// Buffers for a chart's parametrization.
    pub(super) fn new(sizes: &Sizes, chart: &Chart) -> Self {
        let count = chart.parametrization().dropped.len();
        let (m, n) = if count > 0 { (sizes.rows, sizes.coordinates) } else { (0, 0) };
        Self {
            x: vec![0.0; count * m],
            normal: vec![0.0; count * count],
            mu: vec![0.0; count],
            factor: Cholesky::new(count),
            unit: vec![0.0; m],
            row: vec![0.0; n],
            independent: vec![0.0; chart.ndof()],
        }
    }

    /// Changes `lambda` at the configuration of G and the chart's factors; only the first
    /// `joint_rows` rows count in the norm.
    pub(super) fn distribute(
        &mut self,
        chart: &mut Chart,
        g: &BlockMatrix,
        joint_rows: usize,
        lambda: &mut [f64],
    ) {
        let (m, count) = (self.unit.len(), self.mu.len());
        if count == 0 {
            return;
        }
        for (i, x) in self.x.chunks_exact_mut(m).enumerate() {
            self.unit.fill(0.0);
            self.unit[chart.parametrization().dropped[i]] = 1.0;
            self.row.fill(0.0);
            g.multiply_transposed_add(1.0, &self.unit, &mut self.row);
            chart.solve_transposed(&self.row, x, &mut self.independent);
        }
        let dot = |a: &[f64], b: &[f64]| -> f64 {
            a[..joint_rows].iter().zip(&b[..joint_rows]).map(|(p, q)| p * q).sum()
        };
        for (i, xi) in self.x.chunks_exact(m).enumerate() {
            self.mu[i] = dot(xi, lambda);
            for (j, xj) in self.x.chunks_exact(m).enumerate() {
                self.normal[i * count + j] = dot(xi, xj) + f64::from(i == j);
            }
        }
        if self.factor.factor(&self.normal).is_ok() {
            self.factor.solve(&mut self.mu);
            for (i, (mu, x)) in self.mu.iter().zip(self.x.chunks_exact(m)).enumerate() {
                for (l, x) in lambda.iter_mut().zip(x) {
                    *l -= mu * x;
                }
                lambda[chart.parametrization().dropped[i]] = *mu;
            }
        }
    }
}
