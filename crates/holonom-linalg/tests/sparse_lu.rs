//! Sparse LU against Gaussian elimination on the dense matrix, written here on its own.

use holonom_linalg::{SparseLu, SparsePattern};
use proptest::prelude::*;

/// A sparse square matrix with its dense copy.
#[derive(Debug, Clone)]
struct Sample {
    n: usize,
    entries: Vec<(usize, usize)>,
    values: Vec<f64>,
}

impl Sample {
    fn sparse(&self) -> (SparsePattern, Vec<f64>) {
        let (pattern, slots) = SparsePattern::new(self.n, self.n, &self.entries);
        let mut values = vec![0.0; pattern.len()];
        for (&slot, v) in slots.iter().zip(&self.values) {
            values[slot] += v;
        }
        (pattern, values)
    }

    fn dense(&self) -> Vec<f64> {
        let mut a = vec![0.0; self.n * self.n];
        for (&(i, j), v) in self.entries.iter().zip(&self.values) {
            a[i * self.n + j] += v;
        }
        a
    }
}

/// Deterministic numbers in (−1, 1) for right-hand sides and new values.
fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// Solution of A X = B (n×k) by Gauss-Jordan with complete pivoting, and the ratio of the smallest
/// to the largest pivot, negative determinants marked by the second result.
fn dense_solve(n: usize, a: &[f64], b: &[f64], k: usize) -> Option<(Vec<f64>, f64, f64)> {
    let mut a = a.to_vec();
    let mut b = b.to_vec();
    let mut columns: Vec<usize> = (0..n).collect();
    let (mut first, mut last, mut sign) = (0.0f64, 0.0f64, 1.0f64);
    for p in 0..n {
        let (mut i0, mut j0) = (p, p);
        for i in p..n {
            for j in p..n {
                if a[i * n + j].abs() > a[i0 * n + j0].abs() {
                    (i0, j0) = (i, j);
                }
            }
        }
        let pivot = a[i0 * n + j0];
        if pivot == 0.0 {
            return None;
        }
        if p == 0 {
            first = pivot.abs();
        }
        last = pivot.abs();
        for c in 0..n {
            a.swap(p * n + c, i0 * n + c);
        }
        for c in 0..k {
            b.swap(p * k + c, i0 * k + c);
        }
        for r in 0..n {
            a.swap(r * n + p, r * n + j0);
        }
        columns.swap(p, j0);
        sign *= pivot.signum();
        if p != i0 {
            sign = -sign;
        }
        if p != j0 {
            sign = -sign;
        }
        for r in (0..n).filter(|&r| r != p) {
            let l = a[r * n + p] / pivot;
            for c in p..n {
                a[r * n + c] -= l * a[p * n + c];
            }
            for c in 0..k {
                b[r * k + c] -= l * b[p * k + c];
            }
        }
    }
    let mut x = vec![0.0; n * k];
    for p in 0..n {
        for c in 0..k {
            x[columns[p] * k + c] = b[p * k + c] / a[p * n + p];
        }
    }
    Some((x, if n == 0 { 1.0 } else { last / first }, sign))
}

fn transpose(n: usize, a: &[f64]) -> Vec<f64> {
    (0..n * n).map(|e| a[(e % n) * n + e / n]).collect()
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().fold(1e-300f64, |m, v| m.max(v.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size
}

/// Random pattern with a hidden permutation on which entries are never missing, so that most
/// samples are structurally regular while diagonals are mostly zero; some values are exactly zero.
fn sample() -> impl Strategy<Value = Sample> {
    (1usize..28).prop_flat_map(|n| {
        let permutation = Just((0..n).collect::<Vec<_>>()).prop_shuffle();
        let extra = prop::collection::vec((0..n, 0..n), 0..4 * n);
        let seed = any::<u64>();
        (permutation, extra, seed, 0u32..4).prop_map(move |(permutation, extra, seed, zeros)| {
            let mut entries: Vec<_> = permutation.into_iter().enumerate().collect();
            entries.extend(extra);
            let mut values = noise(seed, entries.len());
            for (e, v) in values.iter_mut().enumerate() {
                if e % 7 < zeros as usize {
                    *v = 0.0;
                }
            }
            Sample { n, entries, values }
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(600))]

    #[test] // truth: dense elimination with complete pivoting
    fn solves_what_dense_elimination_solves(sample in sample()) {
        let n = sample.n;
        let k = 5;
        let (pattern, values) = sample.sparse();
        let b = noise(n as u64 + 77, n * k);
        let dense = dense_solve(n, &sample.dense(), &b, k);
        match SparseLu::analyze(&pattern, &values) {
            Err(_) => {
                let ratio = dense.map_or(0.0, |d| d.1);
                prop_assert!(ratio < 1e-10, "refused although pivots differ by {ratio:e} only");
            }
            Ok(mut lu) => {
                let Some((x, ratio, sign)) = dense else { panic!("accepted a singular matrix") };
                prop_assume!(ratio > 1e-7);
                let transposed = transpose(n, &sample.dense());
                let (y, _, _) = dense_solve(n, &transposed, &b, k).unwrap();
                let mut many = b.clone();
                lu.solve_many(&mut many, k);
                prop_assert!(largest_difference(&many, &x) < 1e-13 / ratio);
                let mut many = b.clone();
                lu.solve_transposed_many(&mut many, k);
                prop_assert!(largest_difference(&many, &y) < 1e-13 / ratio);
                let column = |m: &[f64]| (0..n).map(|i| m[i * k]).collect::<Vec<f64>>();
                let mut one = column(&b);
                lu.solve(&mut one);
                prop_assert!(largest_difference(&one, &column(&x)) < 1e-13 / ratio);
                let mut one = column(&b);
                lu.solve_transposed(&mut one);
                prop_assert!(largest_difference(&one, &column(&y)) < 1e-13 / ratio);
                prop_assert_eq!(lu.determinant_sign(), sign);
            }
        }
    }
}
