//! Envelope Cholesky against dense elimination, and its counts against those by hand.

mod common;

use common::{cases, dense_solve, noise};
use holonom_linalg::{
    BlockGraph, EnvelopeCholesky, EnvelopePlan, gibbs_king, least_degree, least_envelope,
    reverse_cuthill_mckee,
};
use proptest::prelude::*;
use std::sync::Arc;

/// A symmetric positive definite matrix with the blocks of a graph, dense by rows.
fn matrix(graph: &BlockGraph, seed: u64) -> Vec<f64> {
    let rows = starts(graph);
    let n = rows[graph.len()];
    let noise = noise(seed, n * n);
    let mut a = vec![0.0; n * n];
    for i in 0..graph.len() {
        for &j in graph.neighbours(i).iter().chain([&i]).filter(|&&j| j <= i) {
            for r in rows[i]..rows[i + 1] {
                for c in rows[j]..rows[j + 1] {
                    a[r * n + c] = noise[r * n + c];
                    a[c * n + r] = a[r * n + c];
                }
            }
        }
    }
    for r in 0..n {
        a[r * n + r] = 0.1 + a[r * n..(r + 1) * n].iter().map(|x| x.abs()).sum::<f64>();
    }
    a
}

fn starts(graph: &BlockGraph) -> Vec<usize> {
    let mut rows = vec![0];
    for size in graph.sizes() {
        rows.push(rows[rows.len() - 1] + size);
    }
    rows
}

/// The values of a dense matrix in an envelope.
fn values(graph: &BlockGraph, plan: &EnvelopePlan, a: &[f64]) -> Vec<f64> {
    let rows = starts(graph);
    let n = rows[graph.len()];
    let mut out = vec![0.0; plan.len()];
    for i in 0..graph.len() {
        for &j in graph.neighbours(i).iter().chain([&i]).filter(|&&j| plan.in_order(i, j)) {
            let block = &mut out[plan.block(i, j)];
            let width = rows[j + 1] - rows[j];
            for (r, line) in block.chunks_exact_mut(width).enumerate() {
                let from = (rows[i] + r) * n + rows[j];
                line.copy_from_slice(&a[from..from + width]);
            }
        }
    }
    out
}

/// Solves with several right-hand sides, and with the first of them alone.
#[track_caller]
fn assert_solves(graph: &BlockGraph, order: &[usize], seed: u64) {
    let plan = Arc::new(EnvelopePlan::new(graph, order));
    let natural: Vec<usize> = (0..order.len()).collect();
    let renumbered = EnvelopePlan::new(&graph.renumbered(order), &natural);
    assert_eq!(EnvelopePlan::clone(&plan).renumbered(), renumbered);
    let (n, k) = (plan.n(), 3);
    let a = matrix(graph, seed);
    let mut cholesky = EnvelopeCholesky::new(plan.clone());
    cholesky.factor(&values(graph, &plan, &a)).unwrap();
    let mut x = noise(seed + 1, n * k);
    let expected = dense_solve(n, &a, &x, k).unwrap().x;
    let mut one: Vec<f64> = x.iter().step_by(k).copied().collect();
    let mut at_once = one.clone();
    cholesky.solve_many(&mut x, k);
    cholesky.solve(&mut one);
    cholesky.factor_solve(&values(graph, &plan, &a), &mut at_once).unwrap();
    assert_eq!(at_once, one, "the same operations");
    for (r, (x, expected)) in x.chunks(k).zip(expected.chunks(k)).enumerate() {
        for (x, expected) in x.iter().chain([&one[r]]).zip(expected.iter().chain([&expected[0]])) {
            assert!((x - expected).abs() < 1e-11, "row {r}: {x} and {expected}");
        }
    }
}

/// A chain: each block is next to the one before.
fn chain(count: usize) -> BlockGraph {
    let edges: Vec<[usize; 2]> = (1..count).map(|i| [i - 1, i]).collect();
    BlockGraph::new(&vec![2; count], &edges)
}

/// 0, n−1, 1, n−2, … : the number of each block, put into the order of numbers.
fn alternating(count: usize) -> Vec<usize> {
    let mut order = vec![0; count];
    for k in 0..count {
        order[if k % 2 == 0 { k / 2 } else { count - 1 - k / 2 }] = k;
    }
    order
}

/// The ten pins of the seven-body mechanism; a pin with three bodies more is three joints in a chain.
fn seven_bodies() -> BlockGraph {
    let joints: [[usize; 2]; 10] =
        [[1, 0], [1, 2], [2, 3], [3, 0], [3, 4], [4, 6], [4, 5], [5, 0], [6, 7], [7, 0]];
    let mut edges = Vec::new();
    for (i, a) in joints.iter().enumerate() {
        for (j, b) in joints.iter().enumerate().take(i) {
            if a.iter().any(|body| *body != 0 && b.contains(body)) {
                edges.push([i, j]);
            }
        }
    }
    BlockGraph::new(&[2; 10], &edges)
}

/// (envelope, operations, bound).
fn counts(graph: &BlockGraph, order: &[usize]) -> (usize, usize, usize) {
    let plan = EnvelopePlan::new(graph, order);
    (plan.envelope(), plan.operations(), plan.operation_bound())
}

#[test] // by hand: β = 1 in every row but the first; the alternating numbers give β = 0, 0, 1, 2, …
fn a_chain_has_one_block_beside_the_diagonal_or_an_envelope_of_625() {
    let graph = chain(50);
    let given: Vec<usize> = (0..50).collect();
    for order in [&given, &reverse_cuthill_mckee(&graph), &gibbs_king(&graph)] {
        assert_eq!(counts(&graph, order), (49, 98, 98));
    }
    let bad = alternating(50);
    assert_eq!(counts(&graph, &bad), (625, 6150, 11350));
    assert_eq!(single_block_operations(&graph, &given), 98);
    // The orders do not depend on how the chain was numbered.
    let mut position = [0; 50];
    bad.iter().enumerate().for_each(|(p, &i)| position[i] = p);
    let edges: Vec<[usize; 2]> = (1..50).map(|i| [position[i - 1], position[i]]).collect();
    let renumbered = BlockGraph::new(&[2; 50], &edges);
    assert_eq!(counts(&renumbered, &given), (625, 6150, 11350));
    for order in [reverse_cuthill_mckee(&renumbered), gibbs_king(&renumbered)] {
        assert_eq!(counts(&renumbered, &order), (49, 98, 98));
    }
}

/// Products of two blocks and triangular solves of an elimination that stores single blocks.
fn single_block_operations(graph: &BlockGraph, order: &[usize]) -> usize {
    graph.factor_widths(order).iter().map(|width| width * (width + 3) / 2).sum()
}

#[test] // independent truth: the same counts by a separate program
fn the_seven_body_mechanism_has_its_known_counts() {
    let graph = seven_bodies();
    let given: Vec<usize> = (0..10).collect();
    assert_eq!(counts(&graph, &given), (13, 30, 31));
    assert_eq!(counts(&graph, &reverse_cuthill_mckee(&graph)), (13, 30, 31));
    // One block fewer than the numbering of the pins along the links.
    assert_eq!(counts(&graph, &gibbs_king(&graph)), (12, 27, 29));
    assert_eq!(counts(&graph, &least_envelope(&graph)), (12, 27, 29));
    assert_eq!(single_block_operations(&graph, &least_degree(&graph)), 24);
}

#[test] // independent truth: the formula Σ β(β + 3)/2
fn the_bound_of_operations_is_reached_where_rows_are_full() {
    let count = 9;
    let edges: Vec<[usize; 2]> = (0..count).flat_map(|i| (0..i).map(move |j| [i, j])).collect();
    let graph = BlockGraph::new(&vec![1; count], &edges);
    let order: Vec<usize> = (0..count).collect();
    let bound = (0..count).map(|b| b * (b + 3) / 2).sum();
    assert_eq!(counts(&graph, &order), (36, bound, bound));
    assert!(graph.factor_widths(&order).into_iter().eq((0..count).rev()));
    // Multiplications and scalings of a dense Cholesky factorisation of order n: n(n²−1)/6.
    assert_eq!(EnvelopePlan::new(&graph, &order).multiplications(), 9 * 80 / 6);
}

#[test]
fn a_matrix_that_is_not_definite_is_refused_with_its_row() {
    let graph = chain(4);
    let plan = Arc::new(EnvelopePlan::new(&graph, &alternating(4)));
    let mut a = matrix(&graph, 5);
    let mut cholesky = EnvelopeCholesky::new(plan.clone());
    a[5 * 8 + 5] = -1.0;
    let error = cholesky.factor(&values(&graph, &plan, &a)).unwrap_err();
    assert_eq!(error.index, 5);
    assert!(error.pivot < 0.0);
    a[5 * 8 + 5] = f64::NAN;
    assert_eq!(cholesky.factor(&values(&graph, &plan, &a)).unwrap_err().index, 5);
    // A row twice: nothing is left of the second but round-off.
    let pair = BlockGraph::new(&[1, 1], &[[0, 1]]);
    let plan = Arc::new(EnvelopePlan::new(&pair, &[0, 1]));
    let mut cholesky = EnvelopeCholesky::new(plan.clone());
    cholesky.factor(&values(&pair, &plan, &[0.1, 0.1, 0.1, 0.1])).unwrap_err();
    // By hand: 1 − 0.9² of the diagonal is left.
    cholesky.factor(&values(&pair, &plan, &[4.0, 3.6, 3.6, 4.0])).unwrap();
    assert!((cholesky.least_pivot() - 0.19).abs() < 1e-15);
}

#[test]
fn an_empty_matrix_is_no_trouble() {
    let graph = BlockGraph::new(&[], &[]);
    assert!(reverse_cuthill_mckee(&graph).is_empty() && gibbs_king(&graph).is_empty());
    let mut cholesky = EnvelopeCholesky::new(Arc::new(EnvelopePlan::new(&graph, &[])));
    cholesky.factor(&[]).unwrap();
    cholesky.solve(&mut []);
    cholesky.solve_many(&mut [], 3);
}

proptest! {
    #![proptest_config(cases(64))]

    #[test] // independent truth: dense elimination with complete pivoting
    fn random_graphs_are_solved_in_every_order(
        sizes in prop::collection::vec(1usize..=6, 1..14),
        ends in prop::collection::vec((0usize..14, 0usize..14), 0..24),
        seed in 0u64..1000,
    ) {
        let count = sizes.len();
        let edges: Vec<[usize; 2]> = ends.iter().map(|(i, j)| [i % count, j % count]).collect();
        let graph = BlockGraph::new(&sizes, &edges);
        let given: Vec<usize> = (0..count).collect();
        let orders = [
            given.clone(),
            reverse_cuthill_mckee(&graph),
            gibbs_king(&graph),
            least_degree(&graph),
            alternating(count),
        ];
        for order in &orders {
            let mut sorted = order.clone();
            sorted.sort_unstable();
            prop_assert_eq!(&sorted, &given);
            let (envelope, operations, bound) = counts(&graph, order);
            prop_assert!(operations <= bound);
            prop_assert_eq!(envelope, graph.widths(order).iter().sum::<usize>());
            assert_solves(&graph, order, seed);
        }
        let best = counts(&graph, &least_envelope(&graph)).2;
        prop_assert!(orders[..3].iter().all(|order| best <= counts(&graph, order).2));
    }
}
