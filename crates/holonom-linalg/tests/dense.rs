//! Dense kernels against elimination written in the tests, known roots and known null spaces.

mod common;

use common::{cases, dense_solve, largest_difference, noise, product, sparse_columns, transpose};
use holonom_linalg::{
    Cholesky, DecompositionError, DenseLu, GRAM_ROWS, Span, eigenvalues, full_pivot_elimination,
    gram_add, gram_spans_add, least_norm, orthonormal_null_space, singular_values,
};
use proptest::prelude::*;

proptest! {
    #![proptest_config(cases(100))]

    #[test] // truth: Gauss-Jordan elimination with complete pivoting
    fn lu_solves_as_elimination_does(n in 1usize..70, k in 1usize..40, seed in any::<u64>()) {
        let mut a = noise(seed, n * n);
        for i in 0..n {
            a[i * n + i] = 0.0; // exchanges are needed from the first step on
        }
        let b = noise(seed ^ 5, n * k);
        let mut lu = DenseLu::new(n);
        let Some(truth) = dense_solve(n, &a, &b, k) else {
            prop_assert!(lu.factor(&a).is_err());
            return Ok(());
        };
        prop_assume!(truth.ratio > 1e-6);
        lu.factor(&noise(seed ^ 9, n * n)).ok(); // an earlier matrix leaves nothing behind
        lu.factor(&a).unwrap();
        prop_assert_eq!(lu.determinant_sign(), truth.sign);
        let allowed = 1e-12 / truth.ratio;
        let mut x = b.clone();
        lu.solve_many(&mut x, k);
        prop_assert!(largest_difference(&x, &truth.x) < allowed);
        let transposed = dense_solve(n, &transpose(n, n, &a), &b, k).unwrap();
        let mut x = b.clone();
        lu.solve_transposed_many(&mut x, k);
        prop_assert!(largest_difference(&x, &transposed.x) < allowed);
        let column = |m: &[f64]| (0..n).map(|i| m[i * k]).collect::<Vec<f64>>();
        let mut x = column(&b);
        lu.solve(&mut x);
        prop_assert!(largest_difference(&x, &column(&truth.x)) < allowed);
        let mut x = column(&b);
        lu.solve_transposed(&mut x);
        prop_assert!(largest_difference(&x, &column(&transposed.x)) < allowed);
    }

    #[test] // truth: elimination of the same matrix; BᵀB + I is positive definite by construction
    fn cholesky_solves_as_elimination_does(n in 1usize..70, k in 1usize..20, seed in any::<u64>()) {
        let half = noise(seed, n * n);
        let mut a = product(n, n, n, &transpose(n, n, &half), &half);
        for i in 0..n {
            a[i * n + i] += 1.0;
        }
        let b = noise(seed ^ 5, n * k);
        let truth = dense_solve(n, &a, &b, k).unwrap();
        let mut cholesky = Cholesky::new(n);
        cholesky.factor(&a).unwrap();
        let mut x = b.clone();
        cholesky.solve_many(&mut x, k);
        prop_assert!(largest_difference(&x, &truth.x) < 1e-11);
        let mut x: Vec<f64> = (0..n).map(|i| b[i * k]).collect();
        cholesky.solve(&mut x);
        let first: Vec<f64> = (0..n).map(|i| truth.x[i * k]).collect();
        prop_assert!(largest_difference(&x, &first) < 1e-11);
    }

    #[test] // truth: A x solves AᵀA x = Aᵀb, and x is orthogonal to the null space of A
    fn least_norm_satisfies_the_normal_equations(
        m in 1usize..15,
        n in 1usize..15,
        rank in 1usize..15,
        seed in any::<u64>(),
    ) {
        let rank = rank.min(m).min(n);
        let a = product(m, rank, n, &noise(seed, m * rank), &noise(seed ^ 3, rank * n));
        let b = noise(seed ^ 4, m);
        let s = singular_values(m, n, &a).unwrap();
        prop_assume!(s[rank - 1] > 1e-3 * s[0]);
        let found = least_norm(m, n, &a, &b, 1e-9).unwrap();
        prop_assert_eq!(found.rank, rank);
        let residual: Vec<f64> =
            product(m, n, 1, &a, &found.x).iter().zip(&b).map(|(ax, b)| ax - b).collect();
        let norm = residual.iter().map(|r| r * r).sum::<f64>().sqrt();
        prop_assert!((norm - found.residual_norm).abs() < 1e-12 * (1.0 + norm));
        let gradient = product(n, m, 1, &transpose(m, n, &a), &residual);
        let size = found.x.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        prop_assert!(gradient.iter().all(|g| g.abs() < 1e-13 * (m * n) as f64 * size));
        let (basis, dimension) = orthonormal_null_space(m, n, &a, 1e-9).unwrap();
        prop_assert_eq!(dimension, n - rank);
        let along = product(dimension, n, 1, &transpose(n, dimension, &basis), &found.x);
        prop_assert!(along.iter().all(|g| g.abs() < 1e-11 * size));
        let image = product(m, n, dimension, &a, &basis);
        prop_assert!(image.iter().all(|v| v.abs() < 1e-12));
        let square = product(dimension, n, dimension, &transpose(n, dimension, &basis), &basis);
        for (e, v) in square.iter().enumerate() {
            prop_assert!((v - f64::from(e % (dimension + 1) == 0)).abs() < 1e-13);
        }
    }

    #[test] // truth: P A Q − L U, multiplied out here, and the rank the matrix was made with
    fn full_pivot_elimination_factors_and_finds_the_rank(
        m in 1usize..12,
        n in 1usize..12,
        rank in 1usize..12,
        seed in any::<u64>(),
        fixed in 0usize..4,
    ) {
        let rank = rank.min(m).min(n);
        let a = product(m, rank, n, &noise(seed, m * rank), &noise(seed ^ 3, rank * n));
        let s = singular_values(m, n, &a).unwrap();
        prop_assume!(s[rank - 1] > 1e-4 * s[0]);
        // Diagonal entries, as far as their leading minors are safe.
        let fixed: Vec<_> = (0..fixed.min(rank)).map(|i| (m - 1 - i, n - 1 - i)).collect();
        let mut factors = a.clone();
        let result = full_pivot_elimination(m, n, &mut factors, &fixed, 1e-10);
        prop_assume!((0..fixed.len()).all(|p| result.pivots[p].abs() > 0.03));
        prop_assert_eq!(result.rank, rank);
        prop_assert_eq!(result.pivots.len(), rank);
        for (p, &(i, j)) in fixed.iter().enumerate() {
            prop_assert_eq!((result.row_order[p], result.column_order[p]), (i, j));
        }
        for i in 0..m {
            for j in 0..n {
                let lu: f64 = (0..rank.min(i + 1).min(j + 1))
                    .map(|p| {
                        let l = if p == i { 1.0 } else { factors[i * n + p] };
                        l * factors[p * n + j]
                    })
                    .sum();
                let entry = a[result.row_order[i] * n + result.column_order[j]];
                prop_assert!((entry - lu).abs() < 1e-9, "({i}, {j}): {entry} ≠ {lu}");
            }
        }
        let mut rows = result.row_order.clone();
        rows.sort_unstable();
        prop_assert!(rows.into_iter().eq(0..m));
        let free = &result.pivots[fixed.len()..];
        prop_assert!(free.iter().all(|p| p.abs() > 1e-10 * free[0].abs()));
    }

    #[test] // truth: the triple loop of the definition
    fn gram_is_the_product_of_the_transpose(n in 0usize..40, k in 0usize..40, seed in any::<u64>()) {
        let (a, b) = (noise(seed, n * k), noise(seed ^ 1, n * k));
        let start = noise(seed ^ 2, k * k);
        let mut c = start.clone();
        gram_add(n, k, &a, &b, &mut c);
        let mut truth = product(k, n, k, &transpose(n, k, &a), &b);
        truth.iter_mut().zip(&start).for_each(|(t, s)| *t += s);
        prop_assert!(c.iter().zip(&truth).all(|(c, t)| (c - t).abs() < 1e-15 * (n + 4) as f64));
    }

    #[test] // truth: the product of all columns
    fn gram_within_spans_is_that_of_all_columns(
        n in 0usize..40,
        k in 1..=Span::MOST,
        seed in any::<u64>(),
    ) {
        let [(a, _), (b, columns)] = [seed, seed ^ 1].map(|seed| sparse_columns(seed, n, k));
        let parts = columns.chunks(GRAM_ROWS).map(|rows| rows.iter().fold(0, |all, x| all | x));
        let spans: Vec<Span> = parts.map(Span::of).collect();
        let (mut some, mut all) = (vec![0.0; k * k], vec![0.0; k * k]);
        gram_spans_add(n, k, &a, &b, &spans, &mut some);
        gram_add(n, k, &a, &b, &mut all);
        prop_assert_eq!(some, all);
    }
}

#[test] // truth: row 2 is the sum of rows 0 and 1
fn lu_names_where_a_singular_matrix_stops() {
    let a = [1.0, 2.0, 3.0, -4.0, 5.0, 6.5, -3.0, 7.0, 9.5];
    let mut lu = DenseLu::new(3);
    let error = lu.factor(&a).unwrap_err();
    assert_eq!(error.row, 2);
    assert!(error.pivot.abs() < 1e-14);
    let mut poisoned = [1.0, 2.0, 0.0, 1.0];
    poisoned[2] = f64::NAN;
    assert!(DenseLu::new(2).factor(&poisoned).is_err());
}

#[test] // truth: diag(1, 2, −3, 4) turned in the plane of axes 1 and 2 keeps its eigenvalues
fn cholesky_refuses_an_indefinite_matrix() {
    let (c, s) = (0.8, 0.6);
    #[rustfmt::skip]
    let a = [
        1.0, 0.0, 0.0, 0.0,
        0.0, 2.0 * c * c - 3.0 * s * s, (2.0 + 3.0) * c * s, 0.0,
        0.0, (2.0 + 3.0) * c * s, 2.0 * s * s - 3.0 * c * c, 0.0,
        0.0, 0.0, 0.0, 4.0,
    ];
    let error = Cholesky::new(4).factor(&a).unwrap_err();
    assert_eq!(error.index, 2);
    // The determinant 1·2·(−3) of the leading minor is the product of its pivots.
    let pivot = -6.0 / (2.0 * c * c - 3.0 * s * s);
    assert!((error.pivot - pivot).abs() < 1e-13, "{} ≠ {pivot}", error.pivot);
    let singular = Cholesky::new(2).factor(&[1.0, 1.0, 1.0, 1.0]).unwrap_err();
    assert_eq!(singular.index, 1);
    assert!(Cholesky::new(1).factor(&[f64::NAN]).is_err());
}

#[test] // truth: (x − 1)(x − 2)(x + 3)(x² − 2x + 5) has roots 1, 2, −3, 1 ± 2i
fn eigenvalues_of_a_companion_matrix_are_the_roots() {
    // x⁵ − 2x⁴ − 2x³ + 20x² − 47x + 30, multiplied out by hand.
    let coefficients = [30.0, -47.0, 20.0, -2.0, -2.0];
    let mut a = [0.0; 25];
    for i in 0..5 {
        if i > 0 {
            a[i * 5 + i - 1] = 1.0;
        }
        a[i * 5 + 4] = -coefficients[i];
    }
    let mut found = eigenvalues(5, &a).unwrap();
    found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let mut truth = vec![(-3.0, 0.0), (1.0, -2.0), (1.0, 0.0), (1.0, 2.0), (2.0, 0.0)];
    for (re, im) in found {
        let near = truth.iter().position(|t| (t.0 - re).hypot(t.1 - im) < 1e-10);
        truth.remove(near.unwrap_or_else(|| panic!("{re} + {im}i is no root left of {truth:?}")));
    }
    assert!(truth.is_empty());
}

#[test] // truth: rows 3 and 4 repeat rows 0 and 1
fn full_pivot_elimination_sees_duplicated_rows() {
    let mut a = noise(11, 3 * 6);
    let copy: Vec<f64> = a[..12].to_vec();
    a.extend(copy);
    let result = full_pivot_elimination(5, 6, &mut a, &[], 1e-10);
    assert_eq!(result.rank, 3);
    // Of each pair of equal rows one is kept.
    let kept = &result.row_order[..3];
    assert!(kept.contains(&2));
    assert!(kept.contains(&0) != kept.contains(&3));
    assert!(kept.contains(&1) != kept.contains(&4));
}

#[test] // truth: after the pivot (0, 0) the entry (1, 1) of this matrix is exactly zero
fn a_fixed_pivot_that_vanishes_is_left_to_the_free_ones() {
    let mut a = [1.0, 1.0, 0.0, 1.0, 1.0, 2.0, 0.0, 3.0, 1.0];
    let result = full_pivot_elimination(3, 3, &mut a, &[(0, 0), (1, 1)], 1e-10);
    assert_eq!((result.rank, result.row_order[0], result.column_order[0]), (3, 0, 0));
    assert_eq!((result.row_order[1], result.column_order[1]), (2, 1)); // the largest: 3
    let mut zero = [0.0; 6];
    assert_eq!(full_pivot_elimination(2, 3, &mut zero, &[], 1e-10).rank, 0);
}

#[test] // truth: singular values of diag(3, 2) with a zero column are 3 and 2
fn singular_values_descend() {
    let s = singular_values(2, 3, &[0.0, 2.0, 0.0, 3.0, 0.0, 0.0]).unwrap();
    assert!(largest_difference(&s, &[3.0, 2.0]) < 1e-15);
}

#[test] // truth: a matrix without rows constrains nothing
fn empty_matrices_have_full_null_spaces() {
    assert_eq!(orthonormal_null_space(0, 2, &[], 1e-9), Ok((vec![1.0, 0.0, 0.0, 1.0], 2)));
    assert_eq!(least_norm(0, 2, &[], &[], 1e-9).unwrap().x, [0.0, 0.0]);
    assert_eq!(singular_values(0, 2, &[]), Ok(vec![]));
    assert_eq!(eigenvalues(0, &[]), Ok(vec![]));
    DenseLu::new(0).factor(&[]).unwrap();
    Cholesky::new(0).factor(&[]).unwrap();
}

#[test] // truth: the place of the NaN
fn entries_that_are_not_finite_are_named() {
    let a = [1.0, 2.0, 3.0, f64::NAN];
    let at = |e: DecompositionError| match e {
        DecompositionError::NotFinite { row, column, .. } => (row, column),
        DecompositionError::NoConvergence => panic!("not what is wrong"),
    };
    assert_eq!(at(eigenvalues(2, &a).unwrap_err()), (1, 1));
    assert_eq!(at(singular_values(2, 2, &a).unwrap_err()), (1, 1));
    assert_eq!(at(orthonormal_null_space(2, 2, &a, 1e-9).unwrap_err()), (1, 1));
    assert_eq!(at(least_norm(2, 2, &a, &[0.0; 2], 1e-9).unwrap_err()), (1, 1));
}
