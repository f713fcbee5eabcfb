//! Time of the sparse kernels on matrices with the structure of a vehicle.

#![allow(missing_docs)] // of the functions that criterion's macros make

mod vehicle;

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use holonom_linalg::SparseLu;

use vehicle::{constraints_and_partition, saddle};

fn sparse_lu(c: &mut Criterion) {
    for (name, (pattern, values)) in
        [("saddle 178", saddle()), ("constraints and partition 98", constraints_and_partition())]
    {
        let n = pattern.n_rows();
        let mut group = c.benchmark_group(name);
        let mut lu = SparseLu::analyze(&pattern, &values).expect("regular");
        let label = format!("refactor, {} operations, fill {}", lu.operations(), lu.fill());
        group.bench_function("analyze", |b| {
            b.iter(|| SparseLu::analyze(&pattern, black_box(&values)).expect("regular"));
        });
        group.bench_function(label, |b| b.iter(|| lu.refactor(black_box(&values))));
        let mut x = vec![0.0; n];
        group.bench_function("solve", |b| {
            b.iter(|| {
                x.fill(1.0);
                lu.solve(black_box(&mut x));
            });
        });
        group.bench_function("refactor and solve", |b| {
            b.iter(|| {
                lu.refactor(black_box(&values)).expect("regular");
                x.fill(1.0);
                lu.solve(black_box(&mut x));
            });
        });
        let mut many = vec![0.0; n * 18];
        group.bench_function("solve 18", |b| {
            b.iter(|| {
                many.fill(1.0);
                lu.solve_many(black_box(&mut many), 18);
            });
        });
        group.bench_function("solve transposed 18", |b| {
            b.iter(|| {
                many.fill(1.0);
                lu.solve_transposed_many(black_box(&mut many), 18);
            });
        });
        group.finish();
    }
}

criterion_group!(benches, sparse_lu);
criterion_main!(benches);
