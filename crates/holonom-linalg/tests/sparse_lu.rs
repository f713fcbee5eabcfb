//! Sparse LU against Gaussian elimination on the dense matrix.

mod common;

use common::{
    are_zero_elsewhere, cases, dense_solve, largest_difference, noise, sparse_columns, transpose,
};
use holonom_linalg::{SparseLu, SparsePattern, scale_rows};
use proptest::prelude::*;

/// A sparse square matrix: entries (equal ones add up) with their numbers.
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

/// Random pattern over a hidden permutation whose entries are never left out, so that most samples
/// are structurally regular although their diagonals are mostly zero. `zeros` of seven values are
/// exactly zero, and rows and columns are scaled over six powers of ten.
fn sample() -> impl Strategy<Value = Sample> {
    (1usize..28).prop_flat_map(|n| {
        let permutation = Just((0..n).collect::<Vec<_>>()).prop_shuffle();
        let extra = prop::collection::vec((0..n, 0..n), 0..4 * n);
        (permutation, extra, any::<u64>(), 0usize..4).prop_map(
            move |(order, extra, seed, zeros)| {
                let mut entries: Vec<_> = order.into_iter().enumerate().collect();
                entries.extend(extra);
                let mut values = noise(seed, entries.len());
                let scale = noise(seed ^ 1, 2 * n);
                for (e, v) in values.iter_mut().enumerate() {
                    let (i, j) = entries[e];
                    *v *= 10f64.powf(1.5 * (scale[i] + scale[n + j]));
                    if e % 7 < zeros {
                        *v = 0.0;
                    }
                }
                Sample { n, entries, values }
            },
        )
    })
}

/// Compares every kind of solution with dense elimination; `lu` is factored for this sample.
///
/// Errors grow with the condition, here 1/`ratio`, and with what elimination makes of the numbers:
/// little with pivots chosen for them, up to six digits with frozen ones.
fn check(sample: &Sample, lu: &mut SparseLu, k: usize, accuracy: f64) -> Result<(), TestCaseError> {
    let n = sample.n;
    let b = noise(n as u64 + 77, n * k);
    let Some(truth) = dense_solve(n, &sample.dense(), &b, k) else {
        return Err(TestCaseError::fail("a singular matrix was accepted"));
    };
    prop_assume!(truth.ratio > 1e-8);
    let allowed = accuracy / truth.ratio;
    let transposed = dense_solve(n, &transpose(n, n, &sample.dense()), &b, k).expect("regular");
    let mut x = b.clone();
    lu.solve_many(&mut x, k);
    prop_assert!(largest_difference(&x, &truth.x) < allowed);
    let mut x = b.clone();
    lu.solve_transposed_many(&mut x, k);
    prop_assert!(largest_difference(&x, &transposed.x) < allowed);
    // Of right-hand sides scaled beforehand and solutions scaled afterwards.
    let scales = [noise(3, n), noise(4, n)];
    let mut scaled = b.clone();
    scale_rows(&scales[0], k, &mut scaled);
    for backward in [false, true] {
        let mut x = scaled.clone();
        if backward {
            lu.solve_transposed_many(&mut x, k);
        } else {
            lu.solve_many(&mut x, k);
        }
        scale_rows(&scales[1], k, &mut x);
        let mut y = b.clone();
        lu.solve_scaled_many(&mut y, k, backward, [&scales[0], &scales[1]]);
        prop_assert!(largest_difference(&x, &y) < allowed);
    }
    // What the pattern does not reach is exactly zero.
    let few = k.min(32);
    let (right, columns) = sparse_columns(n as u64 + 78, n, few);
    for backward in [false, true] {
        let (mut x, mut reached) = (right.clone(), columns.clone());
        lu.reach(backward, &mut reached, &mut Vec::new());
        if backward {
            lu.solve_transposed_many(&mut x, few);
        } else {
            lu.solve_many(&mut x, few);
        }
        prop_assert!(are_zero_elsewhere(&x, &reached, few));
    }
    let column = |m: &[f64]| (0..n).map(|i| m[i * k + k - 1]).collect::<Vec<f64>>();
    let mut x = column(&b);
    lu.solve(&mut x);
    prop_assert!(largest_difference(&x, &column(&truth.x)) < allowed);
    let mut x = column(&b);
    lu.solve_transposed(&mut x);
    prop_assert!(largest_difference(&x, &column(&transposed.x)) < allowed);
    prop_assert_eq!(lu.determinant_sign(), truth.sign);
    Ok(())
}

/// Refinement gives back the digits that frozen pivots lost, where it says that it has converged.
fn check_refined(sample: &Sample, lu: &mut SparseLu) -> Result<(), TestCaseError> {
    let b = noise(5, sample.n);
    let truth = dense_solve(sample.n, &sample.dense(), &b, 1).expect("regular");
    let (pattern, values) = sample.sparse();
    let mut x = b.clone();
    let correction = lu.solve_refined(&pattern, &values, &mut x);
    prop_assert!(correction < 1e-8 / truth.ratio);
    if correction < 1e-7 {
        prop_assert!(largest_difference(&x, &truth.x) < 1e-13 / truth.ratio);
    }
    Ok(())
}

/// Only a singular matrix may be refused.
fn analyze_and_check(
    sample: &Sample,
    pattern: &SparsePattern,
    values: &[f64],
    k: usize,
) -> Result<(), TestCaseError> {
    if let Ok(mut lu) = SparseLu::analyze(pattern, values) {
        return check(sample, &mut lu, k, 1e-13);
    }
    let ratio = dense_solve(sample.n, &sample.dense(), &[], 0).map_or(0.0, |t| t.ratio);
    prop_assert!(ratio < 1e-12, "refused although its pivots differ by {ratio:e} only");
    Ok(())
}

proptest! {
    #![proptest_config(cases(500))]

    #[test] // truth: dense elimination with complete pivoting
    fn solves_what_dense_elimination_solves(sample in sample(), k in 1usize..60) {
        let (pattern, values) = sample.sparse();
        analyze_and_check(&sample, &pattern, &values, k)?;
    }

    #[test] // truth: dense elimination of the new matrix; zeros at analysis are no zeros later
    fn refactors_with_other_numbers(sample in sample(), seed in any::<u64>(), k in 1usize..5) {
        let (pattern, values) = sample.sparse();
        let Ok(mut lu) = SparseLu::analyze(&pattern, &values) else { return Ok(()) };
        let mut other = sample.clone();
        for (v, change) in other.values.iter_mut().zip(noise(seed, sample.values.len())) {
            // Also where the old value is zero: the entry was structural all along.
            *v = 1.2 * *v + 0.1 * change;
        }
        let (_, values) = other.sparse();
        if lu.refactor(&values).is_ok() && lu.growth() < 1e6 {
            check(&other, &mut lu, k, 1e-8)?;
            check_refined(&other, &mut lu)?;
        } else {
            // Frozen pivots may be bad for the new numbers.
            analyze_and_check(&other, &pattern, &values, k)?;
        }
    }

    #[test] // truth: column and row counts of the pattern itself
    fn refuses_structurally_singular_matrices(sample in sample(), at in any::<prop::sample::Index>()) {
        let n = sample.n;
        let empty = at.index(n);
        for by_row in [true, false] {
            let kept: Vec<usize> = (0..sample.entries.len())
                .filter(|&e| empty != if by_row { sample.entries[e].0 } else { sample.entries[e].1 })
                .collect();
            let holed = Sample {
                n,
                entries: kept.iter().map(|&e| sample.entries[e]).collect(),
                values: kept.iter().map(|&e| sample.values[e]).collect(),
            };
            let (pattern, values) = holed.sparse();
            prop_assert!(SparseLu::analyze(&pattern, &values).is_err());
        }
    }

    #[test] // truth: 1-norms of the matrix and of its inverse by dense elimination
    fn condition_estimate_is_a_good_lower_bound(sample in sample()) {
        let n = sample.n;
        let (pattern, values) = sample.sparse();
        let Ok(mut lu) = SparseLu::analyze(&pattern, &values) else { return Ok(()) };
        let identity: Vec<f64> = (0..n * n).map(|e| f64::from(e % (n + 1) == 0)).collect();
        let Some(inverse) = dense_solve(n, &sample.dense(), &identity, n) else { return Ok(()) };
        prop_assume!(inverse.ratio > 1e-8);
        let norm = |m: &[f64]| {
            (0..n).map(|j| (0..n).map(|i| m[i * n + j].abs()).sum::<f64>()).fold(0.0, f64::max)
        };
        let condition = norm(&sample.dense()) * norm(&inverse.x);
        let estimate = lu.condition_estimate(&pattern, &values);
        prop_assert!(estimate < condition * (1.0 + 1e-6), "{estimate:e} of {condition:e}");
        prop_assert!(estimate > 0.1 * condition, "{estimate:e} of {condition:e}");
    }
}

/// Entries and values of a dense matrix, all structural.
fn full(n: usize, a: &[f64]) -> (SparsePattern, Vec<f64>) {
    let entries: Vec<_> = (0..n * n).map(|e| (e / n, e % n)).collect();
    (SparsePattern::new(n, n, &entries).0, a.to_vec())
}

#[test] // truth: the residual, computed here from the matrix
fn refinement_leaves_a_small_residual_at_condition_1e8() {
    // Two orthogonal reflections around a diagonal from 1 to 1e-8, with a hidden permutation.
    let n = 30;
    let reflect = |seed: u64, a: &mut [f64], left: bool| {
        let v = noise(seed, n);
        let square: f64 = v.iter().map(|x| x * x).sum();
        for c in 0..n {
            let at = |i: usize| if left { i * n + c } else { c * n + i };
            let dot: f64 = (0..n).map(|i| v[i] * a[at(i)]).sum();
            for i in 0..n {
                a[at(i)] -= 2.0 * v[i] * dot / square;
            }
        }
    };
    let mut a = vec![0.0; n * n];
    for i in 0..n {
        a[i * n + (i * 7) % n] = 10f64.powf(-8.0 * i as f64 / (n - 1) as f64);
    }
    reflect(1, &mut a, true);
    reflect(2, &mut a, false);
    let (pattern, values) = full(n, &a);
    let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
    let condition = lu.condition_estimate(&pattern, &values);
    assert!((1e7..1e10).contains(&condition), "{condition:e}");
    let b = noise(3, n);
    let mut x = b.clone();
    let correction = lu.solve_refined(&pattern, &values, &mut x);
    assert!(correction < 1e-6, "{correction:e}");
    let size = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    for i in 0..n {
        let residual: f64 = (0..n).map(|j| a[i * n + j] * x[j]).sum::<f64>() - b[i];
        assert!(residual.abs() < 1e-15 * n as f64 * size, "row {i}: {residual:e}, x {size:e}");
    }
}

#[test] // truth: a 2×2 matrix whose frozen pivot goes to zero has solution (1, 1) by inspection
fn a_vanishing_or_bad_pivot_asks_for_a_new_analysis() {
    let (pattern, values) = full(2, &[1.0, 0.2, 0.2, 1.0]);
    let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
    for bad in [0.0, 1e-12] {
        let values = [bad, 1.0, 1.0, bad];
        let right = [1.0 + bad, 1.0 + bad];
        match lu.refactor(&values) {
            Err(error) => assert!(bad == 0.0 && error.row < 2 && error.column < 2),
            Ok(()) => {
                assert!(bad > 0.0 && lu.growth() > 1e11);
                let mut x = right;
                assert!(lu.solve_refined(&pattern, &values, &mut x) < 1e-15);
                assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15);
            }
        }
        let mut x = right;
        SparseLu::analyze(&pattern, &values).unwrap().solve(&mut x);
        assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15);
    }
    // A refused matrix leaves nothing behind.
    lu.refactor(&values).unwrap();
    assert_eq!(lu.growth(), 1.0); // 1 − 0.04 is no growth
    lu.refactor(&[0.01, 1.0, 1.0, 0.01]).unwrap();
    assert!((lu.growth() - 99.99).abs() < 1e-10); // 0.01 − 100 beside 1
    lu.refactor(&values).unwrap();
    let mut x = [1.2, 1.2];
    lu.solve(&mut x);
    assert!((x[0] - 1.0).abs() < 1e-15 && (x[1] - 1.0).abs() < 1e-15);
}

#[test] // truth: a NaN or an infinity is no number
fn numbers_that_are_not_finite_are_refused() {
    let good = [2.0, 1.0, 1.0, 3.0];
    for at in 0..4 {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut values = good;
            values[at] = bad;
            let (pattern, _) = full(2, &good);
            assert!(SparseLu::analyze(&pattern, &values).is_err());
            let mut lu = SparseLu::analyze(&pattern, &good).unwrap();
            assert!(lu.refactor(&values).is_err(), "{bad} at {at}");
        }
    }
}

#[test] // truth: a bidiagonal chain has one elimination per row and its solution by recursion
fn a_long_chain_has_no_fill_and_no_deep_recursion() {
    let n = 50_000;
    let entries: Vec<_> =
        (0..n).flat_map(|i| [(i, i), (i, (i + 1).min(n - 1)), ((i + 1).min(n - 1), i)]).collect();
    let (pattern, slots) = SparsePattern::new(n, n, &entries);
    let mut values = vec![0.0; pattern.len()];
    for (e, &slot) in slots.iter().enumerate() {
        values[slot] = if e % 3 == 0 { 4.0 } else { -1.0 };
    }
    values[slots[3 * (n - 1)]] = 4.0;
    let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
    assert_eq!(lu.fill(), 3 * n - 2);
    let mut x = vec![2.0; n];
    x[0] = 3.0;
    x[n - 1] = 3.0;
    lu.solve(&mut x); // 4 − 1 − 1 inside, 4 − 1 at the ends: all ones
    assert!(x.iter().all(|v| (v - 1.0).abs() < 1e-14));
}

#[test] // truth: there is exactly one matrix without rows
fn an_empty_matrix_is_regular() {
    let (pattern, _) = SparsePattern::new(0, 0, &[]);
    let mut lu = SparseLu::analyze(&pattern, &[]).unwrap();
    lu.refactor(&[]).unwrap();
    lu.solve(&mut []);
    assert_eq!(lu.determinant_sign(), 1.0);
}
