//! One solution of the augmented system of the thesis's vehicle in joint coordinates (27 coordinates, 16 cut
//! equations), by every way: Gauss, Alg-D, Alg-S, and Alg-S for 4 and 8 variants of the vehicle at once.

#![allow(missing_docs)] // of the functions that criterion's macros make

#[path = "../tests/common/vehicle.rs"]
mod vehicle;

use criterion::{
    BenchmarkGroup, Criterion, criterion_group, criterion_main, measurement::WallTime,
};
use holonom_linalg::{BranchedCholesky, BranchedPlan, DenseAugmented, DenseLu};
use std::hint::black_box;
use std::sync::Arc;

/// Deterministic numbers in (-1, 1).
fn noise(index: usize) -> f64 {
    let mixed = (index as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15);
    ((mixed ^ (mixed >> 29)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Φᵀ by rows of `width` numbers.
fn constraints(plan: &BranchedPlan, width: usize) -> Vec<f64> {
    let mut out = vec![0.0; plan.len() * width];
    for c in 0..plan.len() {
        plan.runs(c).flatten().for_each(|r| out[c * width + r] = noise(c * plan.rows() + r + 500));
    }
    out
}

fn branched<const W: usize>(group: &mut BenchmarkGroup<'_, WallTime>, plan: &Arc<BranchedPlan>) {
    let mut mass: Vec<[f64; W]> = (0..plan.places()).map(|i| [0.3 * noise(i); W]).collect();
    (0..plan.len()).for_each(|c| mass[plan.column(c).end - 1] = [10.0; W]);
    let rows: Vec<[f64; W]> = constraints(plan, plan.width()).iter().map(|&x| [x; W]).collect();
    let mut cholesky = BranchedCholesky::<W>::new(plan.clone());
    let mut force = vec![[1.0; W]; plan.len()];
    let mut tau = vec![[1.0; W]; plan.rows()];
    group.bench_function(format!("Alg-S, {W} at once"), |b| {
        b.iter(|| {
            cholesky.factor(black_box(&mass)).expect("positive definite");
            cholesky.factor_rows(black_box(&rows)).expect("full rank");
            force.fill([1.0; W]);
            tau.fill([1.0; W]);
            cholesky.solve(&mut force, &mut tau);
        });
    });
}

fn vehicle_in_joint_coordinates(c: &mut Criterion) {
    let (parents, sizes, cuts) = vehicle::vehicle();
    let plan = Arc::new(BranchedPlan::new(&parents, &sizes, &cuts));
    let (n, m) = (plan.len(), plan.rows());
    let mut group = c.benchmark_group("vehicle in joint coordinates");
    branched::<1>(&mut group, &plan);
    branched::<4>(&mut group, &plan);
    branched::<8>(&mut group, &plan);

    let mut mass = vec![0.0; n * n];
    for i in 0..n {
        for j in 0..=i {
            let value = plan.entry(i, j).map_or(0.0, |at| 0.3 * noise(at));
            (mass[i * n + j], mass[j * n + i]) = (value, value);
        }
        mass[i * n + i] = 10.0;
    }
    let transposed = constraints(&plan, m);
    let mut dense = DenseAugmented::new(n, m);
    let (mut force, mut tau) = (vec![1.0; n], vec![1.0; m]);
    group.bench_function("Alg-D", |b| {
        b.iter(|| {
            dense.factor(black_box(&mass), black_box(&transposed)).expect("positive definite");
            force.fill(1.0);
            tau.fill(1.0);
            dense.solve(&mut force, &mut tau);
        });
    });

    let size = n + m;
    let mut augmented = vec![0.0; size * size];
    for i in 0..n {
        augmented[i * size..i * size + n].copy_from_slice(&mass[i * n..(i + 1) * n]);
        for r in 0..m {
            augmented[i * size + n + r] = transposed[i * m + r];
            augmented[(n + r) * size + i] = transposed[i * m + r];
        }
    }
    let mut lu = DenseLu::new(size);
    let mut x = vec![1.0; size];
    group.bench_function("Gauss", |b| {
        b.iter(|| {
            lu.factor(black_box(&augmented)).expect("regular");
            x.fill(1.0);
            lu.solve(&mut x);
        });
    });
    group.finish();
}

criterion_group!(benches, vehicle_in_joint_coordinates);
criterion_main!(benches);
