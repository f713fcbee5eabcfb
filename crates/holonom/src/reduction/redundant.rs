//! Multipliers of a redundant set of constraints.

use super::chart::Chart;
use holonom_linalg::{BlockMatrix, SparseLu, SparsePattern};

/// What rows of Gᵀ that depend on others are damped by, against the square of their size.
const DAMPING: f64 = 1e-12;
/// The second solve removes what damping left of the first.
const PASSES: usize = 2;
/// Growth of numbers with frozen pivots that refinement makes up for.
const MOST_GROWTH: f64 = 1e6;

/// Replaces the multipliers of a redundant set, where dropped rows have none, by those of minimum norm over
/// the rows of joints and drivers with the same generalized forces Gᵀλ = f:
///
/// ```text
/// [J G; Gᵀ −ε] (λ, w) = (0, f)      J = 1 in the rows of the norm, 0 in others
/// ```
#[derive(Debug, Clone)]
pub(super) struct Redundant {
    pattern: SparsePattern,
    values: Vec<f64>,
    /// (value of G, row, coordinate, slots of the two entries).
    copies: Vec<(u32, u32, u32, [u32; 2])>,
    /// Slots of the diagonal.
    diagonal: Vec<u32>,
    lu: Option<SparseLu>,
    /// Scales of the rows of Gᵀ.
    scale: Vec<f64>,
    force: Vec<f64>,
    work: Vec<f64>,
    lambda: Vec<f64>,
}

impl Redundant {
    /// For the rows of a chart's parametrization; none where no row is redundant.
    pub(super) fn new(chart: &Chart, g: &BlockMatrix) -> Option<Self> {
        if chart.parametrization().dropped.is_empty() {
            return None;
        }
        let (m, n) = (g.n_rows(), g.n_cols());
        let mut entries: Vec<(usize, usize)> = (0..m + n).map(|k| (k, k)).collect();
        let mut copies = Vec::new();
        for (at, (row, j)) in g.entries(0, 0).into_iter().enumerate() {
            if chart.nonzero()[at] {
                entries.extend([(row, m + j), (m + j, row)]);
                copies.push((at as u32, row as u32, j as u32, [0; 2]));
            }
        }
        let (pattern, slots) = SparsePattern::new(m + n, m + n, &entries);
        for (copy, slots) in copies.iter_mut().zip(slots[m + n..].chunks_exact(2)) {
            copy.3 = [slots[0] as u32, slots[1] as u32];
        }
        Some(Self {
            values: vec![0.0; pattern.len()],
            pattern,
            copies,
            diagonal: slots[..m + n].iter().map(|&slot| slot as u32).collect(),
            lu: None,
            scale: vec![0.0; n],
            force: vec![0.0; n],
            work: vec![0.0; m + n],
            lambda: vec![0.0; m],
        })
    }

    /// Changes `lambda` at the configuration of G; only the first `joint_rows` rows count in the norm.
    pub(super) fn distribute(&mut self, g: &BlockMatrix, joint_rows: usize, lambda: &mut [f64]) {
        let m = self.lambda.len();
        let values = g.values();
        self.scale.fill(0.0);
        for &(at, _, j, _) in &self.copies {
            self.scale[j as usize] += values[at as usize].powi(2);
        }
        for scale in &mut self.scale {
            *scale = if *scale > 0.0 { 1.0 / scale.sqrt() } else { 1.0 };
        }
        self.values.fill(0.0);
        for &(at, _, j, slots) in &self.copies {
            let x = values[at as usize] * self.scale[j as usize];
            slots.iter().for_each(|&slot| self.values[slot as usize] += x);
        }
        for (k, &slot) in self.diagonal.iter().enumerate() {
            self.values[slot as usize] += match k {
                k if k < joint_rows => 1.0,
                k if k < m => 0.0,
                _ => -DAMPING,
            };
        }
        let factored = match &mut self.lu {
            Some(lu) => lu.refactor(&self.values).is_ok() && lu.growth() <= MOST_GROWTH,
            None => false,
        };
        if !factored {
            self.lu = SparseLu::analyze(&self.pattern, &self.values).ok();
        }
        let Some(lu) = &mut self.lu else { return };
        self.force.fill(0.0);
        g.multiply_transposed_add(1.0, lambda, &mut self.force);
        self.lambda.fill(0.0);
        for _ in 0..PASSES {
            self.work[..m].fill(0.0);
            for ((out, f), scale) in self.work[m..].iter_mut().zip(&self.force).zip(&self.scale) {
                *out = f * scale;
            }
            lu.solve_refined(&self.pattern, &self.values, &mut self.work);
            g.multiply_transposed_add(-1.0, &self.work[..m], &mut self.force);
            self.lambda.iter_mut().zip(&self.work).for_each(|(sum, x)| *sum += x);
        }
        lambda.copy_from_slice(&self.lambda);
    }
}
