//! What the tests of several files need: deterministic numbers and an independent dense solver.

#![allow(dead_code)] // no file uses all of it

use proptest::test_runner::{Config, RngSeed};

/// The same random cases at every run; LINALG_CASES asks for more, and for other ones.
pub(crate) fn cases(count: u32) -> Config {
    let more = std::env::var("LINALG_CASES").ok().and_then(|c| c.parse().ok());
    let rng_seed = if more.is_some() { RngSeed::Random } else { RngSeed::Fixed(1) };
    let cases = more.unwrap_or(count);
    Config {
        cases,
        max_global_rejects: 4 * cases, // the ratio of proptest's own numbers
        rng_seed,
        failure_persistence: None,
        ..Config::default()
    }
}

/// Deterministic numbers in (−1, 1).
pub(crate) fn noise(seed: u64, count: usize) -> Vec<f64> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    for _ in 0..8 {
        next();
    }
    (0..count).map(|_| next()).collect()
}

/// What dense elimination finds.
pub(crate) struct DenseSolution {
    /// Solution of A X = B, n×k by rows.
    pub(crate) x: Vec<f64>,
    /// Smallest pivot relative to the largest.
    pub(crate) ratio: f64,
    /// Sign of det A.
    pub(crate) sign: f64,
}

/// Gauss-Jordan elimination with complete pivoting; none for a matrix without a last pivot.
pub(crate) fn dense_solve(n: usize, a: &[f64], b: &[f64], k: usize) -> Option<DenseSolution> {
    let mut a = a.to_vec();
    let mut b = b.to_vec();
    let mut columns: Vec<usize> = (0..n).collect();
    let (mut largest, mut smallest, mut sign) = (0.0f64, f64::INFINITY, 1.0f64);
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
        largest = largest.max(pivot.abs());
        smallest = smallest.min(pivot.abs());
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
        sign *= if p == i0 { 1.0 } else { -1.0 };
        sign *= if p == j0 { 1.0 } else { -1.0 };
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
    Some(DenseSolution { x, ratio: if n == 0 { 1.0 } else { smallest / largest }, sign })
}

/// The transpose of an m×n matrix by rows.
pub(crate) fn transpose(m: usize, n: usize, a: &[f64]) -> Vec<f64> {
    (0..m * n).map(|e| a[(e % m) * n + e / m]).collect()
}

/// A B for A m×n and B n×k, by rows.
pub(crate) fn product(m: usize, n: usize, k: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut c = vec![0.0; m * k];
    for i in 0..m {
        for j in 0..n {
            for l in 0..k {
                c[i * k + l] += a[i * n + j] * b[j * k + l];
            }
        }
    }
    c
}

/// max |a − b| relative to max |b|.
pub(crate) fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    let size = b.iter().fold(1e-300f64, |m, v| m.max(v.abs()));
    let difference = a.iter().zip(b).map(|(a, b)| (a - b).abs());
    // A NaN must not be swallowed by max.
    difference.fold(0.0f64, |m, d| if d > m || d.is_nan() { d } else { m }) / size
}

/// A matrix by rows with few columns in each, and these by a bit each.
pub(crate) fn sparse_columns(seed: u64, n_rows: usize, k: usize) -> (Vec<f64>, Vec<u32>) {
    let (mut x, choice) = (noise(seed, n_rows * k), noise(seed ^ 5, n_rows * k));
    let mut columns = vec![0; n_rows];
    for (at, x) in x.iter_mut().enumerate() {
        if choice[at] > 0.6 {
            columns[at / k] |= 1 << (at % k);
        } else {
            *x = 0.0;
        }
    }
    (x, columns)
}

/// Whether rows have no other columns than these.
pub(crate) fn are_zero_elsewhere(x: &[f64], columns: &[u32], k: usize) -> bool {
    x.iter().enumerate().all(|(at, x)| *x == 0.0 || columns[at / k] >> (at % k) & 1 == 1)
}
