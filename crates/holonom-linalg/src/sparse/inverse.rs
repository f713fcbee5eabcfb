//! Some entries of the inverse of a sparse matrix.

use super::{SparseLu, SparsePattern};

impl SparseLu {
    /// The entries of A⁻¹ at the places of Aᵀ: for every slot (i, j) of the matrix last factored, (A⁻¹)ⱼᵢ.
    ///
    /// With Â = P L U, unit diagonals, W = (L U)⁻¹ follows backwards from W L = U⁻¹ and U W = L⁻¹,
    ///
    /// ```text
    /// Wᵢⱼ = −Σ Uᵢₖ Wₖⱼ      Wⱼᵢ = −Σ Wⱼₖ Lₖᵢ      Wᵢᵢ = 1 − Σ Uᵢₖ Wₖᵢ      j, k > i
    /// ```
    ///
    /// which for places of the factors take no others: about as much work as the elimination. Source:
    /// A. M. Erisman, W. F. Tinney, *On computing certain elements of the inverse of a sparse matrix*,
    /// Comm. ACM 18 (1975).
    pub fn inverse_entries(&self, pattern: &SparsePattern) -> Vec<f64> {
        let (plan, numbers) = (&self.factors.plan, &self.factors.numbers);
        let n = self.n;
        // Places of L by columns.
        let mut below: Vec<Vec<(u32, u32)>> = vec![Vec::new(); n];
        for side in &plan.left {
            for place in side.start..side.end {
                below[plan.columns[place as usize] as usize].push((side.row, place));
            }
        }
        // W transposed, in the places of the factors.
        let mut w = vec![0.0; numbers.len()];
        let mut upper = Vec::new();
        for i in (0..n).rev() {
            let row = plan.rows[i];
            let right = row.pivot as usize + 1..row.end as usize;
            upper.clear();
            upper.resize(right.len(), 0.0);
            for &(j, place) in &below[i] {
                let other = plan.rows[j as usize];
                let mut at = other.start as usize;
                let mut sum = 0.0;
                for (u, k) in right.clone().enumerate() {
                    at += find(&plan.columns[at..other.end as usize], plan.columns[k]);
                    sum -= numbers[k] * w[at];
                    upper[u] -= w[at] * numbers[place as usize];
                }
                w[place as usize] = sum;
            }
            let mut diagonal = 1.0;
            for (u, k) in right.enumerate() {
                w[k] = upper[u];
                diagonal -= numbers[k] * upper[u];
            }
            w[row.pivot as usize] = diagonal;
        }
        let order = &self.order;
        let mut column_position = vec![0u32; n];
        for (p, &j) in order.column_at.iter().enumerate() {
            column_position[j] = p as u32;
        }
        let mut out = vec![0.0; pattern.len()];
        for (p, &i) in order.row_at.iter().enumerate() {
            let scale = order.row_scale[p] * self.factors.inverse_pivot[p];
            for (slot, j) in pattern.row(i) {
                let q = column_position[j];
                let row = plan.rows[p].start as usize..plan.rows[p].end as usize;
                let at = row.start + find(&plan.columns[row], q);
                out[slot] = w[at] * scale * order.column_scale[q as usize];
            }
        }
        out
    }
}

/// Where a column stands among those of a row, which has it.
fn find(columns: &[u32], column: u32) -> usize {
    columns.partition_point(|&c| c < column)
}
