//! What runs in a step loop allocates nothing after set-up. Truth: a counting allocator.

mod common;

#[path = "../benches/vehicle/mod.rs"]
mod vehicle;

use common::noise;
use holonom_linalg::{
    BlockGraph, BlockMatrix, BranchedCholesky, BranchedPlan, Cholesky, CutRows, DenseLu,
    EnvelopeCholesky, EnvelopePlan, SparseLu, gram_add,
};
use std::sync::Arc;

#[track_caller]
fn assert_no_allocation(what: &str, run: impl FnOnce()) {
    let count = allocation_counter::measure(run).count_total;
    assert_eq!(count, 0, "{what}: {count} allocations");
}

#[test]
fn the_counter_counts() {
    let info = allocation_counter::measure(|| drop(std::hint::black_box(vec![1.0; 10])));
    assert_eq!(info.count_total, 1);
}

#[test]
fn sparse_factors_do_not_allocate() {
    for (pattern, values) in [vehicle::saddle(), vehicle::constraints_and_partition()] {
        let n = pattern.n_rows();
        let mut lu = SparseLu::analyze(&pattern, &values).unwrap();
        lu.reserve_lanes();
        let zeros = vec![0.0; values.len()];
        for k in [1, 2, 5, 18, 80] {
            let mut b = noise(1, n * k);
            assert_no_allocation("sparse LU", || {
                lu.refactor(&zeros).unwrap_err();
                lu.refactor(&values).unwrap();
                lu.solve(&mut b[..n]);
                lu.solve_transposed(&mut b[..n]);
                lu.solve_refined(&pattern, &values, &mut b[..n]);
                lu.solve_many(&mut b, k);
                lu.solve_transposed_many(&mut b, k);
                lu.condition_estimate(&pattern, &values);
            });
        }
    }
}

#[test]
fn block_products_do_not_allocate() {
    let (mut matrix, ids) = BlockMatrix::new(14, 21, &[(0, 0, 7, 7), (7, 7, 7, 7), (7, 14, 7, 7)]);
    let block = noise(1, 49);
    for k in [1, 18, 80] {
        let (x, mut y) = (noise(2, 21 * k), vec![0.0; 14 * k]);
        let mut z = vec![0.0; 21 * k];
        assert_no_allocation("block matrix", || {
            matrix.clear();
            matrix.add(ids[1], &block);
            matrix.multiply_many_add(1.0, &x, k, &mut y);
            matrix.multiply_transposed_many_add(1.0, &y, k, &mut z);
        });
    }
}

#[test]
fn envelope_factors_do_not_allocate() {
    let graph = BlockGraph::new(&[2, 5, 3], &[[0, 1], [1, 2]]);
    let plan = Arc::new(EnvelopePlan::new(&graph, &[1, 0, 2]));
    let mut cholesky = EnvelopeCholesky::new(plan.clone());
    let mut values = vec![0.0; plan.len()];
    for (i, rows) in [2, 5, 3].into_iter().enumerate() {
        values[plan.block(i, i)].iter_mut().step_by(rows + 1).for_each(|x| *x = 1.0);
    }
    for k in [3, 18, 80] {
        let mut b = noise(1, 10 * k);
        cholesky.solve_many(&mut b, k); // makes room
        assert_no_allocation("envelope Cholesky", || {
            cholesky.factor(&values).unwrap();
            cholesky.solve(&mut b[..10]);
            cholesky.factor_solve(&values, &mut b[..10]).unwrap();
            cholesky.solve_many(&mut b, k);
        });
    }
}

#[test]
fn dense_factors_do_not_allocate() {
    for n in [1, 6, 18, 40, 80, 150, 178] {
        let (mut lu, mut cholesky) = (DenseLu::new(n), Cholesky::new(n));
        let mut a = noise(n as u64, n * n);
        let mut c = vec![0.0; n * n];
        for k in [1, 18, 80] {
            let mut b = noise(1, n * k);
            assert_no_allocation(&format!("dense {n}, {k} right-hand sides"), || {
                c.fill(0.0);
                gram_add(n, n, &a, &a, &mut c);
                lu.factor(&a).unwrap();
                lu.solve(&mut b[..n]);
                lu.solve_transposed(&mut b[..n]);
                lu.solve_many(&mut b, k);
                lu.solve_transposed_many(&mut b, k);
                cholesky.factor(&c).unwrap();
                cholesky.solve_many(&mut b, k);
                c[n * n - 1] = -1.0;
                cholesky.factor(&c).unwrap_err();
            });
            a[0] += 1.0;
        }
    }
}

#[test]
fn branched_factors_do_not_allocate() {
    let cuts = [CutRows { nodes: [Some(1), Some(2)], rows: 3 }];
    let plan = Arc::new(BranchedPlan::new(&[None, Some(0), Some(0)], &[6, 4, 3], &cuts));
    let mut cholesky = BranchedCholesky::<1>::new(plan.clone());
    let (zeros, mut mass) = (vec![[0.0]; plan.places()], vec![[0.0]; plan.places()]);
    (0..plan.len()).for_each(|c| mass[plan.column(c).end - 1] = [1.0]);
    let mut rows = vec![[0.0]; plan.len() * plan.width()];
    (0..plan.rows()).for_each(|r| rows[r * plan.width() + r] = [1.0]);
    let (mut force, mut tau) = (vec![[1.0]; plan.len()], vec![[1.0]; plan.rows()]);
    assert_no_allocation("branched", || {
        cholesky.factor(&zeros).unwrap_err();
        cholesky.factor(&mass).unwrap();
        cholesky.factor_rows(&rows).unwrap();
        cholesky.solve(&mut force, &mut tau);
    });
}
