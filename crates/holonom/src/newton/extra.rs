//! Extra states, eliminated before all else, element by element.

use crate::system::{ExtraBlock, ExtraSquares, Structure};
use holonom_linalg::{Scalar, dot};

/// E = I − γh g_z, factored element by element, with the rows E⁻¹ g_q and E⁻¹ g_q̇:
///
/// ```text
/// δz = E⁻¹ r_z + γh (E⁻¹ g_q δq + E⁻¹ g_q̇ δq̇)
/// ```
///
/// With r_z ← E⁻¹ r_z done first no other E⁻¹ is left: F_z, F_z E⁻¹ g_q and F_z E⁻¹ g_q̇ are sums over single states.
///
/// Source: `docs/theory/newton.md` (2), (4), (6).
#[derive(Debug, Clone)]
pub(super) struct Elimination<T> {
    blocks: Vec<ExtraBlock>,
    /// L without its unit diagonal, and U with the inverses of its diagonal.
    factors: Vec<T>,
    /// The row that each row of its element was exchanged with.
    exchanges: Vec<usize>,
    pub(super) by_position: Vec<T>,
    pub(super) by_velocity: Vec<T>,
}

impl<T: Scalar> Elimination<T> {
    /// For the elements of a system.
    pub(super) fn new(structure: &Structure) -> Self {
        let blocks = &structure.extra_blocks;
        let last = blocks.last().copied().unwrap_or_default();
        Self {
            blocks: blocks.clone(),
            factors: vec![T::ZERO; last.own().end],
            exchanges: vec![0; last.states().end],
            by_position: Vec::new(),
            by_velocity: Vec::new(),
        }
    }

    /// Whether there is nothing to eliminate.
    pub(super) fn is_empty(&self) -> bool {
        self.blocks.is_empty()
    }

    /// Factors E and multiplies the rows of g_q and g_q̇ by E⁻¹.
    pub(super) fn factor(&mut self, gamma_h: T, by_z: &ExtraSquares, rates: [&[f64]; 2]) {
        for block in &self.blocks {
            let (n, e) = (block.count, &mut self.factors[block.own()]);
            for (k, (e, g)) in e.iter_mut().zip(&by_z.values[block.own()]).enumerate() {
                let own = if k % (n + 1) == 0 { T::from(1.0) } else { T::ZERO };
                *e = own - gamma_h.scaled(*g);
            }
            factor(n, e, &mut self.exchanges[block.states()]);
        }
        let mut all = [&mut self.by_position, &mut self.by_velocity].map(std::mem::take);
        for (rows, source) in all.iter_mut().zip(rates) {
            rows.clear();
            rows.extend(source.iter().map(|x| T::from(*x)));
            self.solve(rows);
        }
        [self.by_position, self.by_velocity] = all;
    }

    /// E⁻¹ (g_q δq + g_q̇ δq̇) of state `k`, where rows are by coordinates.
    pub(super) fn rate(&self, structure: &Structure, k: usize, dq: &[T], dv: &[T]) -> T {
        structure.extra_entries(k).fold(T::ZERO, |sum, (at, j)| {
            sum + self.by_position[at] * dq[j] + self.by_velocity[at] * dv[j]
        })
    }

    /// x ← E⁻¹ x for rows of numbers, as many for each state.
    pub(super) fn solve(&self, x: &mut [T]) {
        let width = x.len() / self.exchanges.len().max(1);
        for block in &self.blocks {
            let x = &mut x[block.first * width..block.states().end * width];
            solve(&self.factors[block.own()], &self.exchanges[block.states()], x);
        }
    }
}

impl Elimination<f64> {
    /// E⁻¹ (ż_v δv + ż_v̇ δv̇) of state `k`, from reduced rows.
    pub(super) fn reduced_rate(&self, k: usize, p: &[f64], v: &[f64]) -> f64 {
        let range = k * p.len()..(k + 1) * p.len();
        dot(&self.by_position[range.clone()], p) + dot(&self.by_velocity[range], v)
    }
}

/// A ← its factors in place, by rows, with the largest entry of each column as pivot.
fn factor<T: Scalar>(n: usize, a: &mut [T], exchanges: &mut [usize]) {
    for k in 0..n {
        let size = |row: &usize| a[row * n + k].size();
        let pivot = (k..n).max_by(|i, j| size(i).total_cmp(&size(j))).unwrap_or(k);
        exchanges[k] = pivot;
        for j in 0..n {
            a.swap(k * n + j, pivot * n + j);
        }
        let inverse = a[k * n + k].reciprocal();
        a[k * n + k] = inverse;
        for i in k + 1..n {
            let multiple = a[i * n + k] * inverse;
            a[i * n + k] = multiple;
            for j in k + 1..n {
                a[i * n + j] = a[i * n + j] - multiple * a[k * n + j];
            }
        }
    }
}

/// x ← A⁻¹ x for rows of numbers.
fn solve<T: Scalar>(a: &[T], exchanges: &[usize], x: &mut [T]) {
    let n = exchanges.len();
    let width = x.len() / n;
    let subtract = |x: &mut [T], i: usize, multiple: T, j: usize| {
        for k in 0..width {
            x[i * width + k] = x[i * width + k] - multiple * x[j * width + k];
        }
    };
    for (i, &other) in exchanges.iter().enumerate() {
        for k in 0..if other == i { 0 } else { width } {
            x.swap(i * width + k, other * width + k);
        }
    }
    for i in 0..n {
        for j in 0..i {
            subtract(x, i, a[i * n + j], j);
        }
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            subtract(x, i, a[i * n + j], j);
        }
        x[i * width..(i + 1) * width].iter_mut().for_each(|x| *x = *x * a[i * n + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;
    use holonom_linalg::Complex64;

    /// Largest entry of E E⁻¹x − x over all elements, for rows of three numbers.
    fn residual<T: Scalar>(blocks: &[ExtraBlock], gamma_h: T, random: &mut Random) -> f64 {
        let last = blocks.last().expect("an element");
        let mut by_z = ExtraSquares::new(blocks);
        by_z.values.iter_mut().for_each(|x| *x = random.range(-1.0, 1.0));
        // Without exchanges of rows the first block could not be factored.
        by_z.values[0] = 1.0;
        let mut elimination = Elimination {
            blocks: blocks.to_vec(),
            factors: vec![T::ZERO; last.own().end],
            exchanges: vec![0; last.states().end],
            by_position: Vec::new(),
            by_velocity: Vec::new(),
        };
        let rows: Vec<f64> = (0..3 * by_z.states()).map(|_| random.range(-1.0, 1.0)).collect();
        elimination.factor(gamma_h, &by_z, [&rows, &[]]);
        let found = &elimination.by_position;
        let mut worst = 0.0f64;
        for state in 0..by_z.states() {
            for k in 0..3 {
                let mut left = found[3 * state + k] - T::from(rows[3 * state + k]);
                for (other, x) in by_z.row(state) {
                    left = left - gamma_h * found[3 * other + k].scaled(x);
                }
                worst = worst.max(left.size());
            }
        }
        worst
    }

    #[test] // independent truth: the product with E
    fn rows_are_multiplied_by_the_inverse_of_each_element() {
        let counts = [3, 1, 6, 12];
        let (mut first, mut square) = (0, 0);
        let blocks = counts.map(|count| {
            let block = ExtraBlock { first, count, square };
            (first, square) = (block.states().end, block.own().end);
            block
        });
        let mut random = Random::new(5);
        for _ in 0..50 {
            assert!(residual(&blocks, 1.0, &mut random) < 1e-9);
            assert!(residual(&blocks, Complex64::new(0.6, 0.8), &mut random) < 1e-9);
        }
    }
}
