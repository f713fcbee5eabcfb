//! Time of the dense kernels at the sizes of integration Jacobians.

#![allow(missing_docs)] // of the functions that criterion's macros make

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use holonom_linalg::{BlockMatrix, Cholesky, DenseLu, gram_add};

/// A matrix of deterministic noise with `diagonal` added: 0 for a matrix that needs exchanges.
fn matrix(n: usize, diagonal: f64) -> Vec<f64> {
    let mut state = 88172645463325252u64;
    let mut a: Vec<f64> = (0..n * n)
        .map(|_| {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        })
        .collect();
    for i in 0..n {
        a[i * n + i] += diagonal;
    }
    a
}

fn dense_lu(c: &mut Criterion) {
    for n in [6, 12, 18, 24, 32, 40, 60, 80, 178] {
        let a = matrix(n, 0.0);
        let mut lu = DenseLu::new(n);
        let mut x = vec![0.0; n * 18];
        let mut group = c.benchmark_group(format!("dense LU {n}"));
        group.bench_function("factor", |b| b.iter(|| lu.factor(black_box(&a))));
        group.bench_function("solve", |b| {
            b.iter(|| {
                x[..n].fill(1.0);
                lu.solve(black_box(&mut x[..n]));
            });
        });
        group.bench_function("solve 18", |b| {
            b.iter(|| {
                x.fill(1.0);
                lu.solve_many(black_box(&mut x), 18);
            });
        });
        group.bench_function("factor and solve 18", |b| {
            b.iter(|| {
                lu.factor(black_box(&a)).expect("regular");
                x.fill(1.0);
                lu.solve_many(black_box(&mut x), 18);
            });
        });
        group.finish();
    }
}

fn cholesky(c: &mut Criterion) {
    for n in [18, 80] {
        let half = matrix(n, 2.0);
        let mut a = vec![0.0; n * n];
        gram_add(n, n, &half, &half, &mut a);
        let mut factor = Cholesky::new(n);
        c.bench_function(&format!("Cholesky {n}"), |b| b.iter(|| factor.factor(black_box(&a))));
    }
}

fn products(c: &mut Criterion) {
    for (n_rows, k) in [(98, 6), (98, 18), (300, 80)] {
        let a = matrix(n_rows.max(k), 0.0);
        let mut out = vec![0.0; k * k];
        c.bench_function(&format!("gram {n_rows}×{k}"), |b| {
            b.iter(|| {
                gram_add(n_rows, k, black_box(&a[..n_rows * k]), &a[1..=n_rows * k], &mut out);
            });
        });
    }
    // Stiffness of a vehicle: 14 diagonal blocks and 30 pairs of coupled bodies.
    let mut blocks: Vec<_> = (0..14).map(|i| (7 * i, 7 * i, 7, 7)).collect();
    for e in 0..30 {
        let (i, j) = (e % 14, (e * 5 + 3) % 14);
        blocks.extend([(7 * i, 7 * j, 7, 7), (7 * j, 7 * i, 7, 7)]);
    }
    let (mut matrix_of_blocks, _) = BlockMatrix::new(98, 98, &blocks);
    for (e, v) in matrix_of_blocks.values_mut().iter_mut().enumerate() {
        *v = e as f64;
    }
    let x = vec![1.0; 98 * 18];
    let mut y = vec![0.0; 98 * 18];
    let entries = matrix_of_blocks.values().len();
    c.bench_function(&format!("blocks × 1, {entries} entries"), |b| {
        b.iter(|| matrix_of_blocks.multiply_add(1.0, black_box(&x[..98]), &mut y[..98]));
    });
    c.bench_function(&format!("blocks × 18, {entries} entries"), |b| {
        b.iter(|| matrix_of_blocks.multiply_many_add(1.0, black_box(&x), 18, &mut y));
    });
    c.bench_function(&format!("blocks transposed × 18, {entries} entries"), |b| {
        b.iter(|| matrix_of_blocks.multiply_transposed_many_add(1.0, black_box(&x), 18, &mut y));
    });
}

criterion_group!(benches, dense_lu, cholesky, products);
criterion_main!(benches);
