//! Products of block matrices against products of their dense copies, made here entry by entry.

mod common;

use common::{
    are_zero_elsewhere, cases, largest_difference, noise, product, sparse_columns, transpose,
};
use holonom_linalg::{BlockMatrix, BlockPattern, Span, SparseLu, SparsePattern};
use proptest::prelude::*;

/// Blocks that may repeat and overlap, in a matrix large enough for them; values by request.
fn blocks() -> impl Strategy<Value = (usize, usize, Vec<(usize, usize, usize, usize)>)> {
    prop::collection::vec((0usize..9, 0usize..9, 0usize..8, 0usize..8), 0..12).prop_map(|blocks| {
        let n_rows = blocks.iter().map(|b| b.0 + b.2).max().unwrap_or(0) + 1;
        let n_cols = blocks.iter().map(|b| b.1 + b.3).max().unwrap_or(0) + 2;
        (n_rows, n_cols, blocks)
    })
}

proptest! {
    #![proptest_config(cases(200))]

    #[test] // truth: the dense matrix, summed up and multiplied here
    fn products_are_those_of_the_dense_matrix(
        (n_rows, n_cols, blocks) in blocks(),
        k in 1usize..60,
        alpha in -2.0..2.0,
    ) {
        let (mut matrix, ids) = BlockMatrix::new(n_rows, n_cols, &blocks);
        let mut dense = vec![0.0; n_rows * n_cols];
        for (e, (&(row, column, rows, columns), &id)) in blocks.iter().zip(&ids).enumerate() {
            let values = noise(e as u64, rows * columns);
            matrix.add(id, &values);
            for i in 0..rows {
                for j in 0..columns {
                    dense[(row + i) * n_cols + column + j] += values[i * columns + j];
                }
            }
        }
        prop_assert!(largest_difference(&matrix.to_dense(), &dense) < 1e-15);

        let x = noise(91, n_cols * k);
        let start = noise(92, n_rows * k);
        let mut y = start.clone();
        matrix.multiply_many_add(alpha, &x, k, &mut y);
        let mut truth = product(n_rows, n_cols, k, &dense, &x);
        truth.iter_mut().zip(&start).for_each(|(t, s)| *t = alpha * *t + s);
        prop_assert!(largest_difference(&y, &truth) < 1e-13);

        let x = noise(93, n_rows * k);
        let start = noise(94, n_cols * k);
        let mut y = start.clone();
        matrix.multiply_transposed_many_add(alpha, &x, k, &mut y);
        let transposed = transpose(n_rows, n_cols, &dense);
        let mut truth = product(n_cols, n_rows, k, &transposed, &x);
        truth.iter_mut().zip(&start).for_each(|(t, s)| *t = alpha * *t + s);
        prop_assert!(largest_difference(&y, &truth) < 1e-13);

        // Fewer columns give the same as many; all are sums in the same order.
        let mut many = vec![0.0; n_cols * k];
        matrix.multiply_transposed_many_add(alpha, &x, k, &mut many);
        let columns_of = |all: &[f64], few: usize| -> Vec<f64> {
            all.chunks_exact(k).flat_map(|row| row[..few].to_vec()).collect()
        };
        // From four columns on products and sums may be rounded once.
        for (few, exact) in [(1, k < 4), (k.min(4), true)] {
            let mut these = vec![0.0; n_cols * few];
            matrix.multiply_transposed_many_add(alpha, &columns_of(&x, few), few, &mut these);
            let off = largest_difference(&these, &columns_of(&many, few));
            prop_assert!(off <= if exact { 0.0 } else { 1e-14 }, "{few} of {k} columns: {off:e}");
        }

        matrix.clear();
        prop_assert!(matrix.values().iter().all(|&v| v == 0.0));
    }

    #[test] // truth: the product with all columns
    fn products_within_spans_are_those_of_all_columns(
        (n_rows, n_cols, blocks) in blocks(),
        k in 1..=Span::MOST,
        seed in any::<u64>(),
    ) {
        let (mut matrix, ids) = BlockMatrix::new(n_rows, n_cols, &blocks);
        for (&(.., rows, columns), &id) in blocks.iter().zip(&ids) {
            matrix.block_mut(id).copy_from_slice(&noise(seed, rows * columns));
        }
        let (x, columns) = sparse_columns(seed, n_rows, k);
        let (mut reached, mut spans) = (vec![0; n_cols], Vec::new());
        matrix.pattern().transposed_spans(&columns, &mut reached, &mut spans);
        let (mut all, mut some) = (vec![0.0; n_cols * k], vec![0.0; n_cols * k]);
        matrix.multiply_transposed_many_add(-2.0, &x, k, &mut all);
        matrix.multiply_transposed_spans_add(-2.0, &x, k, &spans, &mut some);
        prop_assert!(are_zero_elsewhere(&all, &reached, k));
        prop_assert_eq!(some, all);
    }
}

#[test] // truth: one column after the other
fn spans_have_the_columns_that_they_are_made_of() {
    let (mut matrix, ids) = BlockMatrix::new(1, 1, &[(0, 0, 1, 1)]);
    matrix.block_mut(ids[0])[0] = 1.0;
    for columns in 0u32..1 << 14 {
        let columns = columns << (columns % 11);
        let x: Vec<f64> = (0..24).map(|j| f64::from(columns >> j & 1)).collect();
        let mut y = vec![0.0; 24];
        matrix.multiply_transposed_spans_add(1.0, &x, 24, &[Span::of(columns)], &mut y);
        assert_eq!(x, y, "{columns:b}");
    }
}

#[test] // truth: counted by hand
fn equal_blocks_are_one_block() {
    let requests = [(0, 0, 2, 2), (2, 2, 1, 3), (0, 0, 2, 2), (0, 0, 2, 3)];
    let (mut matrix, ids) = BlockMatrix::new(3, 5, &requests);
    assert_eq!(ids[0], ids[2]);
    assert_eq!(matrix.n_blocks(), 3);
    assert_eq!(matrix.values().len(), 4 + 3 + 6);
    assert_eq!(ids.iter().map(|id| id.index()).collect::<Vec<_>>(), [0, 1, 0, 2]);
    assert_eq!(matrix.shape(ids[3]), (0, 0, 2, 3));
    matrix.add(ids[0], &[1.0, 2.0, 3.0, 4.0]);
    matrix.add(ids[2], &[1.0, 0.0, 0.0, 0.0]);
    matrix.block_mut(ids[1])[2] = 7.0;
    assert_eq!(matrix.block(ids[0]), [2.0, 2.0, 3.0, 4.0]);
    #[rustfmt::skip]
    assert_eq!(matrix.to_dense(), [
        2.0, 2.0, 0.0, 0.0, 0.0,
        3.0, 4.0, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, 0.0, 7.0,
    ]);
}

#[test] // truth: counted by hand
fn matrices_of_one_pattern_are_zeros_in_its_blocks() {
    let (pattern, ids) = BlockPattern::new(3, 5, &[(0, 0, 2, 2), (2, 2, 1, 3), (0, 0, 2, 2)]);
    assert_eq!((pattern.n_rows(), pattern.n_cols(), pattern.len()), (3, 5, 4 + 3));
    assert_eq!(pattern.n_blocks(), 2);
    let mut matrix = pattern.zeros();
    assert_eq!(matrix.values(), [0.0; 7]);
    assert_eq!(*matrix.pattern(), pattern);
    matrix.add(ids[2], &[1.0, 2.0, 3.0, 4.0]);
    matrix.release();
    assert!(matrix.values().is_empty());
    matrix.restore();
    assert_eq!(matrix.values(), [0.0; 7]);
    matrix.add(ids[1], &[5.0, 6.0, 7.0]);
    matrix.restore();
    assert_eq!(matrix.block(ids[1]), [5.0, 6.0, 7.0]);
}

#[test] // truth: A [1 2]ᵀ = b by hand for the assembled matrix [4 1; 1 3] at offset 1
fn entries_place_blocks_in_a_larger_sparse_matrix() {
    let (mut blocks, ids) = BlockMatrix::new(2, 2, &[(0, 0, 2, 2), (1, 1, 1, 1)]);
    blocks.add(ids[0], &[4.0, 1.0, 1.0, 1.0]);
    blocks.add(ids[1], &[2.0]);
    let mut entries = blocks.entries(1, 1);
    entries.push((0, 0));
    let (pattern, slots) = SparsePattern::new(3, 3, &entries);
    let mut values = vec![0.0; pattern.len()];
    for (&slot, v) in slots.iter().zip(blocks.values().iter().chain(&[5.0])) {
        values[slot] += v;
    }
    let mut b = [10.0, 6.0, 7.0];
    SparseLu::analyze(&pattern, &values).unwrap().solve(&mut b);
    assert!(largest_difference(&b, &[2.0, 1.0, 2.0]) < 1e-15);
}
