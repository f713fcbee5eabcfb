//! Forests of blocks against Gaussian elimination on the dense matrix.

mod common;

use common::{dense_solve, largest_difference, noise, transpose};
use holonom_linalg::{BlockForest, ForestLu};
use std::sync::Arc;

/// A matrix with blocks on a random forest and rows in a random order.
struct Sample {
    forest: BlockForest,
    values: Vec<f64>,
    dense: Vec<f64>,
}

fn sample(seed: u64, size: usize, count: usize) -> Sample {
    let n = size * count;
    let random = noise(seed, 3 * n * 2 * size + 2 * count);
    let pick = |k: usize, below: usize| ((random[k] + 1.0) * 0.5 * below as f64) as usize % below;
    // Numbers of blocks say nothing about who hangs on whom.
    let mut label: Vec<usize> = (0..count).collect();
    (0..count).for_each(|k| label.swap(k, k + pick(k, count - k)));
    let mut parents = vec![None; count];
    for k in 1..count {
        parents[label[k]] = Some(pick(count + k, k + 1)).filter(|p| *p < k).map(|p| label[p]);
    }
    let mut rows: Vec<usize> = (0..n).collect();
    (0..n).for_each(|k| rows.swap(k, k + pick(2 * count + k, n - k)));
    let mut entries = Vec::new();
    for block in 0..count {
        for i in 0..size {
            for b in [Some(block), parents[block]].into_iter().flatten() {
                // A row of zeros but one is a row of its block all the same.
                entries.extend((0..size).map(|j| (rows[block * size + i], b * size + j)));
            }
        }
    }
    let forest = BlockForest::find(size, &parents, &label, entries.iter().copied()).unwrap();
    let (mut values, mut dense) = (vec![0.0; forest.values()], vec![0.0; n * n]);
    for (e, &(i, j)) in entries.iter().enumerate() {
        let x = random[2 * count + n + e];
        values[forest.slot(i, j)] = x;
        dense[i * n + j] = x;
    }
    Sample { forest, values, dense }
}

#[test]
fn solves_like_dense_elimination() {
    for (seed, (size, count)) in
        [(3, 1), (3, 2), (3, 17), (7, 1), (7, 5), (7, 12)].into_iter().cycle().take(60).enumerate()
    {
        let Sample { forest, values, dense } = sample(seed as u64, size, count);
        let n = size * count;
        let mut lu = ForestLu::new(Arc::new(forest));
        lu.factor(&values).unwrap();
        for k in [1, 2, 5, 31] {
            let b = noise(seed as u64 + 1000, n * k);
            for (transposed, matrix) in [(false, dense.clone()), (true, transpose(n, n, &dense))] {
                let exact = dense_solve(n, &matrix, &b, k).unwrap();
                let mut x = b.clone();
                if transposed {
                    lu.solve_transposed_many(&values, &mut x, k);
                } else {
                    lu.solve_many(&values, &mut x, k);
                }
                let bound = 1e-12 / exact.ratio;
                assert!(
                    largest_difference(&x, &exact.x) < bound,
                    "{size} {count} {k} {transposed}"
                );
                assert_eq!(lu.determinant_sign(), exact.sign);
            }
        }
        let inverse = dense_solve(n, &dense, &identity(n), n).unwrap().x;
        let true_condition = one_norm(n, &dense) * one_norm(n, &inverse);
        let estimate = lu.condition_estimate(&values);
        assert!(estimate <= true_condition * (1.0 + 1e-9) && estimate > 0.1 * true_condition);
    }
}

#[test] // truth: the factors before, to the last bit
fn factors_that_were_given_up_come_back() {
    let Sample { forest, values, .. } = sample(5, 7, 6);
    let mut lu = ForestLu::new(Arc::new(forest));
    let b = noise(6, 42);
    let mut solved = || {
        lu.factor(&values).unwrap();
        let (mut x, mut y) = (b.clone(), b.clone());
        lu.solve_many(&values, &mut x, 1);
        lu.solve_transposed_many(&values, &mut y, 1);
        let told = (x, y, lu.condition_estimate(&values), lu.determinant_sign());
        lu.release();
        told
    };
    assert_eq!(solved(), solved());
}

fn identity(n: usize) -> Vec<f64> {
    (0..n * n).map(|e| f64::from(u8::from(e / n == e % n))).collect()
}

fn one_norm(n: usize, a: &[f64]) -> f64 {
    (0..n).map(|j| (0..n).map(|i| a[i * n + j].abs()).sum()).fold(0.0, f64::max)
}

#[test]
fn other_shapes_are_refused() {
    let find = |parents: &[Option<usize>], order: &[usize], entries: &[(usize, usize)]| {
        BlockForest::find(3, parents, order, entries.iter().copied())
    };
    let own = |b: usize| (0..3).map(move |i| (3 * b + i, 3 * b + i));
    let mut entries: Vec<_> = own(0).chain(own(1)).chain(own(2)).collect();
    let parents = [None, Some(0), Some(1)];
    assert!(find(&parents, &[0, 1, 2], &entries).is_some());
    // A row that ties a body to its parent's parent closes a loop.
    entries.push((8, 0));
    assert!(find(&parents, &[0, 1, 2], &entries).is_none());
    entries.pop();
    // A body with four rows and one with two.
    entries[3] = (3, 6);
    assert!(find(&parents, &[0, 1, 2], &entries).is_none());
    assert!(BlockForest::find(4, &parents, &[0, 1, 2], entries.into_iter()).is_none());
}

#[test]
fn a_singular_block_is_named() {
    let Sample { forest, mut values, .. } = sample(7, 7, 4);
    let size = 7;
    // The third column of the second block is a copy of the first.
    for i in 0..size {
        values[2 * size * size + i * size + 2] = values[2 * size * size + i * size];
    }
    let rows = forest.rows(1).to_vec();
    let error = ForestLu::new(Arc::new(forest)).factor(&values).unwrap_err();
    assert_eq!(error.column / size, 1);
    assert!(rows.contains(&(error.row as u32)));
}
