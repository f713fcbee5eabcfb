//! Algorithm 4 against dense elimination of the augmented matrix, and its counts against those by hand.

mod common;
#[path = "common/vehicle.rs"]
mod vehicle;

use common::{cases, dense_solve, noise};
use holonom_linalg::{
    BranchedCholesky, BranchedPlan, Cholesky, CutRows, DenseAugmented, Operations, Stages,
};
use proptest::prelude::*;
use std::sync::Arc;

/// A tree with numbers: nodes hang on earlier ones.
#[derive(Debug, Clone)]
struct Tree {
    parents: Vec<Option<usize>>,
    sizes: Vec<usize>,
    cuts: Vec<CutRows>,
}

/// The augmented system of a tree, dense by rows, in the plan's order.
struct Dense {
    n: usize,
    m: usize,
    mass: Vec<f64>,
    rows: Vec<f64>,
}

impl Tree {
    fn plan(&self) -> Arc<BranchedPlan> {
        Arc::new(BranchedPlan::new(&self.parents, &self.sizes, &self.cuts))
    }

    fn path(&self, node: Option<usize>) -> Vec<usize> {
        std::iter::successors(node, |&node| self.parents[node]).collect()
    }

    /// M = Σ Jᵀ J over the nodes, where the J of a node has the columns of its path: physics's own way to the
    /// zeros. Φ has the columns of both paths of a cut, without those in common.
    fn dense(&self, plan: &BranchedPlan, seed: u64) -> Dense {
        let (n, m) = (plan.len(), plan.rows());
        let mut mass = vec![0.0; n * n];
        for node in 0..self.parents.len() {
            let columns: Vec<usize> =
                self.path(Some(node)).into_iter().flat_map(|u| plan.coordinates(u)).collect();
            let (rows, seed) = (6, seed.wrapping_add(node as u64 * 977));
            let mut j = noise(seed, rows * columns.len());
            // What a node brings itself leaves its own coordinates well conditioned.
            for (k, _) in plan.coordinates(node).enumerate() {
                j[(k % rows) * columns.len() + k] += 3.0;
            }
            for (a, &ca) in columns.iter().enumerate() {
                for (b, &cb) in columns.iter().enumerate() {
                    mass[ca * n + cb] += (0..rows)
                        .map(|r| j[r * columns.len() + a] * j[r * columns.len() + b])
                        .sum::<f64>();
                }
            }
        }
        let mut rows = vec![0.0; m * n];
        for (index, cut) in self.cuts.iter().enumerate() {
            let [one, other] = cut.nodes.map(|node| self.path(node));
            let apart = one.iter().filter(|u| !other.contains(u));
            let apart = apart.chain(other.iter().filter(|u| !one.contains(u)));
            let columns: Vec<usize> = apart.flat_map(|&u| plan.coordinates(u)).collect();
            let noise = noise(seed ^ (index as u64 + 5), cut.rows * columns.len());
            for (r, row) in plan.cut_rows(index).enumerate() {
                for (k, &c) in columns.iter().enumerate() {
                    rows[row * n + c] = noise[r * columns.len() + k];
                }
            }
        }
        Dense { n, m, mass, rows }
    }
}

impl Dense {
    fn augmented(&self) -> Vec<f64> {
        let size = self.n + self.m;
        let mut a = vec![0.0; size * size];
        for i in 0..self.n {
            a[i * size..i * size + self.n]
                .copy_from_slice(&self.mass[i * self.n..(i + 1) * self.n]);
        }
        for r in 0..self.m {
            for c in 0..self.n {
                a[(self.n + r) * size + c] = self.rows[r * self.n + c];
                a[c * size + self.n + r] = self.rows[r * self.n + c];
            }
        }
        a
    }

    /// M and Φ at the places of the plan, in lane `w`.
    fn store<const W: usize>(
        &self,
        plan: &BranchedPlan,
        w: usize,
        m: &mut [[f64; W]],
        g: &mut [[f64; W]],
    ) {
        for i in 0..self.n {
            for j in 0..=i {
                match plan.entry(i, j) {
                    Some(place) => m[place][w] = self.mass[i * self.n + j],
                    None => assert_eq!(self.mass[i * self.n + j], 0.0, "M has an entry there"),
                }
            }
        }
        for c in 0..if g.is_empty() { 0 } else { self.n } {
            for r in 0..self.m {
                g[c * plan.width() + r][w] = self.rows[r * self.n + c];
                let known = plan.runs(c).any(|run| run.contains(&r));
                assert!(known || self.rows[r * self.n + c] == 0.0, "Φ has an entry there");
            }
        }
    }
}

fn largest_difference(a: &[f64], b: &[f64]) -> f64 {
    let size = b.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size.max(1.0)
}

fn vehicle() -> Tree {
    let (parents, sizes, cuts) = vehicle::vehicle();
    Tree { parents, sizes, cuts }
}

fn tree() -> impl Strategy<Value = Tree> {
    let nodes = proptest::collection::vec((0usize..100, 0usize..5), 1..14);
    let cuts = proptest::collection::vec((0usize..100, 0usize..100, 1usize..4), 0..6);
    (nodes, cuts).prop_map(|(nodes, cuts)| {
        let parent = |(i, &(p, _)): (usize, &(usize, usize))| (p % (i + 1)).checked_sub(1);
        let count = nodes.len();
        let end = |k: usize| (k % (count + 1)).checked_sub(1);
        Tree {
            parents: nodes.iter().enumerate().map(parent).collect(),
            sizes: nodes.iter().map(|&(_, size)| size).collect(),
            cuts: cuts
                .iter()
                .map(|&(a, b, rows)| CutRows { nodes: [end(a), end(b)], rows })
                .collect(),
        }
    })
}

fn compare(tree: &Tree, seed: u64) -> Result<(), TestCaseError> {
    let plan = tree.plan();
    let dense: Vec<Dense> = (0..4).map(|w| tree.dense(&plan, seed + w)).collect();
    let (n, m) = (plan.len(), plan.rows());
    let right: Vec<Vec<f64>> = (0..4).map(|w| noise(seed ^ (99 + w), n + m)).collect();
    let truth: Vec<_> =
        (0..4).map(|w| dense_solve(n + m, &dense[w].augmented(), &right[w], 1)).collect();
    // Random rows of cuts may depend on each other.
    let Some(truth) = truth.into_iter().collect::<Option<Vec<_>>>() else { return Ok(()) };
    prop_assume!(truth.iter().all(|t| t.ratio > 1e-6));

    let mut four = BranchedCholesky::<4>::new(plan.clone());
    let (mut mass, mut rows) = (vec![[0.0; 4]; plan.places()], vec![[0.0; 4]; n * plan.width()]);
    for (w, dense) in dense.iter().enumerate() {
        dense.store(&plan, w, &mut mass, &mut rows);
    }
    four.factor(&mass).expect("positive definite");
    four.factor_rows(&rows).expect("full rank");
    let lanes = |range: std::ops::Range<usize>| -> Vec<[f64; 4]> {
        range.map(|i| std::array::from_fn(|w| right[w][i])).collect()
    };
    let (mut force, mut tau) = (lanes(0..n), lanes(n..n + m));
    four.solve(&mut force, &mut tau);

    for w in 0..4 {
        let found: Vec<f64> = force.iter().chain(&tau).map(|x| x[w]).collect();
        prop_assert!(largest_difference(&found, &truth[w].x) < 1e-8, "{:?}", truth[w].ratio);

        // One system alone has the same bits as in company.
        let mut one = BranchedCholesky::<1>::new(plan.clone());
        let alone = |x: &[[f64; 4]]| x.iter().map(|x| [x[w]]).collect::<Vec<_>>();
        one.factor(&alone(&mass)).expect("positive definite");
        one.factor_rows(&alone(&rows)).expect("full rank");
        let (mut f, mut t) = (alone(&lanes(0..n)), alone(&lanes(n..n + m)));
        one.solve(&mut f, &mut t);
        prop_assert!(f.iter().chain(&t).flatten().eq(found.iter()));

        let mut full = DenseAugmented::new(n, m);
        let transposed: Vec<f64> =
            (0..n * m).map(|k| dense[w].rows[(k % m.max(1)) * n + k / m.max(1)]).collect();
        full.factor(&dense[w].mass, &transposed).expect("positive definite");
        let (mut f, mut t) = (right[w][..n].to_vec(), right[w][n..].to_vec());
        full.solve(&mut f, &mut t);
        f.extend(t);
        prop_assert!(largest_difference(&f, &truth[w].x) < 1e-8);
    }
    Ok(())
}

proptest! {
    #![proptest_config(cases(300))]

    /// Truth: Gauss-Jordan elimination of the augmented matrix with complete pivoting.
    #[test]
    fn all_ways_agree_with_dense_elimination(tree in tree(), seed in 0u64..1000) {
        compare(&tree, seed)?;
    }

    /// Lemma 2: a full Cholesky factorization in this order finds nothing where the plan has no place, and the
    /// same numbers where it has one.
    #[test]
    fn the_factor_has_the_zeros_of_the_matrix(tree in tree(), seed in 0u64..1000) {
        let plan = tree.plan();
        let dense = tree.dense(&plan, seed);
        let n = plan.len();
        let mut full = Cholesky::new(n);
        full.factor(&dense.mass).expect("positive definite");
        // L of the full one by columns of the unit matrix: L⁻¹ inverted would mix; L = M L⁻ᵀ does not.
        let mut inverse = vec![0.0; n * n];
        (0..n).for_each(|i| inverse[i * n + i] = 1.0);
        full.solve_upper(&mut inverse, n);
        let mut branched = BranchedCholesky::<1>::new(plan.clone());
        let mut mass = vec![[0.0]; plan.places()];
        dense.store(&plan, 0, &mut mass, &mut []);
        branched.factor(&mass).expect("positive definite");
        for i in 0..n {
            for j in 0..=i {
                let l: f64 = (0..n).map(|k| dense.mass[i * n + k] * inverse[k * n + j]).sum();
                let own = plan.entry(i, j).map_or(0.0, |at| branched.factor_values()[at][0]);
                prop_assert!((l - own).abs() < 1e-9 * (1.0 + l.abs()), "L[{i}, {j}]");
            }
        }
    }

    /// The count of fill agrees with an elimination of the pattern by entries.
    #[test]
    fn the_predicted_fill_is_that_of_the_pattern(tree in tree(), seed in 0u64..1000) {
        let count = tree.parents.len();
        let mut order: Vec<usize> = (0..count).collect();
        let keys = noise(seed, count);
        order.sort_by(|&a, &b| keys[a].total_cmp(&keys[b]));
        let mut full: Vec<Vec<bool>> = vec![vec![false; count]; count];
        for node in 0..count {
            for other in tree.path(Some(node)) {
                full[node][other] = true;
                full[other][node] = true;
            }
        }
        let mut fill = 0;
        for (at, &p) in order.iter().enumerate() {
            for (later, &i) in order.iter().enumerate().skip(at + 1) {
                for &j in order.iter().skip(later + 1) {
                    if full[i][p] && full[j][p] && !full[i][j] {
                        full[i][j] = true;
                        full[j][i] = true;
                        fill += tree.sizes[i] * tree.sizes[j];
                    }
                }
            }
        }
        prop_assert_eq!(BranchedPlan::fill(&tree.parents, &tree.sizes, &order), fill);
        let children_first: Vec<usize> = (0..count).rev().collect();
        prop_assert_eq!(BranchedPlan::fill(&tree.parents, &tree.sizes, &children_first), 0);
    }
}

#[test]
fn the_vehicle_of_the_thesis_is_solved() {
    let mut solved = 0;
    for seed in 0..40 {
        match compare(&vehicle(), seed) {
            Ok(()) => solved += 1,
            Err(TestCaseError::Reject(_)) => {}
            Err(error) => panic!("{error}"),
        }
    }
    assert!(solved >= 20, "{solved} of 40 were well conditioned");
}

/// Section 3.4.3 of the thesis, counted again by hand: 192 entries of L, 174 of T.
#[test]
fn counts_of_the_vehicle_are_those_by_hand() {
    let plan = vehicle().plan();
    assert_eq!((plan.len(), plan.rows(), plan.len() + plan.rows()), (27, 16, 43));
    let entries_of_t: usize = (0..27).flat_map(|c| plan.runs(c)).map(|run| run.len()).sum();
    assert_eq!((plan.entries(), entries_of_t), (192, 174));
    let stages = plan.operations();
    let counts = |o: Operations| [o.multiplications, o.divisions, o.roots];
    assert_eq!(counts(stages.factor), [660, 165, 27]);
    assert_eq!(counts(stages.columns), [804, 174, 0]);
    assert_eq!(counts(stages.products), [1003, 0, 0]);
    assert_eq!(counts(stages.total()), [4065, 545, 43]);

    let full = Stages::full(27, 16);
    assert_eq!(counts(full.factor), [3276, 351, 27]);
    assert_eq!(counts(full.columns), [5616, 432, 0]);
    assert_eq!(counts(full.products), [3672, 0, 0]);
    assert_eq!(counts(full.total()), [15050, 989, 43]);
    assert_eq!(counts(Operations::gauss(43)), [27391, 946, 0]);
}

/// Blocks that parents first fills in: every pair of unrelated bodies, 74 beside 31 for the vehicle.
#[test]
fn parents_first_fills_every_pair_of_the_vehicle() {
    let tree = vehicle();
    let ones = vec![1; 14];
    let parents_first: Vec<usize> = (0..14).collect();
    assert_eq!(BranchedPlan::fill(&tree.parents, &ones, &parents_first), 74);
}

/// Lemma 3: rows of a cut touch the paths of its two nodes, and no others.
#[test]
fn rows_of_cuts_stand_on_two_paths() {
    let tree = vehicle();
    let plan = tree.plan();
    for (index, cut) in tree.cuts.iter().enumerate() {
        for node in 0..tree.parents.len() {
            let on_path = cut.nodes.iter().any(|&end| tree.path(end).contains(&node));
            for c in plan.coordinates(node) {
                for row in plan.cut_rows(index) {
                    assert_eq!(plan.runs(c).any(|run| run.contains(&row)), on_path);
                }
            }
        }
    }
}

/// Without recursion, and in no time: a star has two entries per branch.
#[test]
fn a_star_of_many_nodes_is_linear() {
    let count = 20_000;
    let parents: Vec<Option<usize>> = (0..count).map(|i: usize| (i > 0).then_some(0)).collect();
    let tree = Tree { parents, sizes: vec![1; count], cuts: Vec::new() };
    let plan = tree.plan();
    assert_eq!(plan.entries(), 2 * count - 1);
    let mut cholesky = BranchedCholesky::<1>::new(plan.clone());
    let mut mass = vec![[1.0]; plan.places()];
    for c in 0..count {
        let above = if c + 1 == count { 2.0 * count as f64 } else { 2.0 };
        mass[plan.column(c).end - 1] = [above];
    }
    cholesky.factor(&mass).expect("positive definite");
    // M·1 = row sums.
    let mut force = vec![[3.0]; count];
    force[count - 1] = [3.0 * count as f64 - 1.0];
    cholesky.solve(&mut force, &mut []);
    assert!(force.iter().all(|x| (x[0] - 1.0).abs() < 1e-10));
}

/// A coordinate without inertia is told by its number, in whichever system it is; a row twice likewise.
#[test]
fn what_has_no_inertia_or_stands_twice_is_told() {
    let tree = Tree {
        parents: vec![None, Some(0)],
        sizes: vec![1, 1],
        cuts: vec![CutRows { nodes: [Some(1), None], rows: 2 }],
    };
    let plan = tree.plan();
    let mut cholesky = BranchedCholesky::<4>::new(plan.clone());
    let mut mass = vec![[2.0; 4]; plan.places()];
    mass[plan.entry(0, 1).expect("on the path")] = [0.5; 4];
    mass[plan.entry(1, 1).expect("diagonal")][2] = 0.125;
    assert_eq!(cholesky.factor(&mass).expect_err("no inertia left").index, 1);
    mass[plan.entry(1, 1).expect("diagonal")][2] = 2.0;
    cholesky.factor(&mass).expect("positive definite");
    let rows = [[1.0; 4], [1.0; 4], [0.0; 4], [0.0; 4]].repeat(2);
    assert_eq!(cholesky.factor_rows(&rows).expect_err("twice").index, 1);
    mass[plan.column(0).end - 1][3] = f64::NAN;
    assert_eq!(cholesky.factor(&mass).expect_err("not a number").index, 0);
}

/// What failed, or was not a number, leaves nothing behind: solved again the bits are the same. Numbers that fill up
/// columns are not looked at.
#[test]
fn failures_leave_nothing_behind() {
    let tree = Tree {
        parents: vec![None, Some(0), Some(0)],
        sizes: vec![3, 2, 1],
        cuts: vec![CutRows { nodes: [Some(1), Some(2)], rows: 2 }],
    };
    let plan = tree.plan();
    let (n, m) = (plan.len(), plan.rows());
    let dense = tree.dense(&plan, 3);
    let (mut mass, mut rows) = (vec![[0.0]; plan.places()], vec![[0.0]; n * plan.width()]);
    dense.store(&plan, 0, &mut mass, &mut rows);
    let solve = |cholesky: &mut BranchedCholesky<1>, mass: &[[f64; 1]], tau: f64| {
        cholesky.factor(mass).expect("positive definite");
        cholesky.factor_rows(&rows).expect("full rank");
        let mut x = (vec![[1.0]; n], vec![[tau]; m]);
        cholesky.solve(&mut x.0, &mut x.1);
        x
    };
    let mut cholesky = BranchedCholesky::<1>::new(plan.clone());
    let truth = solve(&mut cholesky, &mass, 1.0);
    for index in 0..n {
        let (mut wrong, place) = (mass.clone(), plan.column(index).end - 1);
        for value in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
            wrong[place] = [value];
            assert_eq!(cholesky.factor(&wrong).expect_err("no inertia").index, index);
            assert!(solve(&mut cholesky, &mass, 1.0) == truth);
        }
    }
    let mut wrong = rows.clone();
    wrong[0] = [f64::NAN];
    assert_eq!(cholesky.factor_rows(&wrong).expect_err("not a number").index, 0);
    assert!(solve(&mut cholesky, &mass, f64::NAN).1.iter().all(|x| x[0].is_nan()));
    assert!(solve(&mut cholesky, &mass, 1.0) == truth);

    let mut filled = vec![[f64::NAN]; plan.places()];
    (0..n).flat_map(|c| plan.column(c)).for_each(|place| filled[place] = mass[place]);
    assert!(solve(&mut cholesky, &filled, 1.0) == truth);
}
