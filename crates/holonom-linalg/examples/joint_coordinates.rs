//! How long does the augmented system [M Φᵀ; Φ 0] of a mechanism in joint coordinates take, by which solver?
//! Prints one line of comma-separated values per model and solver: `cargo run --release -p holonom-linalg
//! --example joint_coordinates --features general-sparse`. `benchmarks/joint_coordinates` asks and answers.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

#[path = "../tests/common/vehicle.rs"]
mod vehicle;

use cpu_time::ThreadTime;
use faer::linalg::solvers::{Lblt, Solve};
use faer::{MatMut, MatRef, Side};
#[cfg(feature = "general-sparse")]
use holonom_linalg::GeneralSparseLu;
use holonom_linalg::{
    BranchedCholesky, BranchedPlan, CutRows, DenseAugmented, DenseLu, Operations, SparseLu,
    SparsePattern, Stages,
};
use std::sync::Arc;

const ROUNDS: usize = 9;
/// Of one round of one solver, s.
const ROUND_SECONDS: f64 = 0.02;

/// The topology of a mechanism with numbers that have its zeros.
struct Case {
    name: &'static str,
    plan: Arc<BranchedPlan>,
    /// n×n, by rows.
    mass: Vec<f64>,
    /// Φᵀ, n×m by rows.
    rows: Vec<f64>,
}

impl Case {
    /// M = Σ Jᵀ J, where the J of a node has the columns of its path.
    fn new(
        name: &'static str,
        parents: &[Option<usize>],
        sizes: &[usize],
        cuts: &[CutRows],
    ) -> Self {
        let plan = Arc::new(BranchedPlan::new(parents, sizes, cuts));
        let (n, m) = (plan.len(), plan.rows());
        let mut mass = vec![0.0; n * n];
        let mut noise = noise(7);
        for node in 0..parents.len() {
            let path = std::iter::successors(Some(node), |&node| parents[node]);
            let columns: Vec<usize> = path.flat_map(|u| plan.coordinates(u)).collect();
            for row in 0..6 {
                let j: Vec<f64> = (0..columns.len())
                    .map(|k| noise() + if k == row { 3.0 } else { 0.0 })
                    .collect();
                for (x, &a) in j.iter().zip(&columns) {
                    for (y, &b) in j.iter().zip(&columns) {
                        mass[a * n + b] += x * y;
                    }
                }
            }
        }
        let mut rows = vec![0.0; n * m];
        for c in 0..n {
            plan.runs(c).flatten().for_each(|r| rows[c * m + r] = noise());
        }
        Self { name, plan, mass, rows }
    }

    fn augmented(&self) -> Vec<f64> {
        let (n, m) = (self.plan.len(), self.plan.rows());
        let size = n + m;
        let mut a = vec![0.0; size * size];
        for i in 0..n {
            a[i * size..i * size + n].copy_from_slice(&self.mass[i * n..(i + 1) * n]);
            for r in 0..m {
                a[i * size + n + r] = self.rows[i * m + r];
                a[(n + r) * size + i] = self.rows[i * m + r];
            }
        }
        a
    }

    fn print(
        &self,
        solver: &str,
        operations: Option<Operations>,
        solve: &mut dyn FnMut(&mut [f64]) -> usize,
    ) {
        let (n, m) = (self.plan.len(), self.plan.rows());
        let mut x = vec![1.0; n + m];
        let systems = solve(&mut x);
        let residual = self.residual(&x);
        let microseconds = median_microseconds(&mut || {
            x.fill(1.0);
            solve(std::hint::black_box(&mut x));
        });
        let count =
            |f: fn(Operations) -> usize| operations.map_or(String::new(), |o| f(o).to_string());
        println!(
            "{},{n},{m},{solver},{},{},{},{:.3},{residual:.1e}",
            self.name,
            count(|o| o.additions),
            count(|o| o.multiplications),
            count(|o| o.divisions),
            microseconds / systems as f64
        );
    }

    /// |A x - 1| / (|A| |x|), largest entries.
    fn residual(&self, x: &[f64]) -> f64 {
        let (a, size) = (self.augmented(), x.len());
        let largest = |v: &[f64]| v.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let left = (0..size).map(|i| {
            (a[i * size..(i + 1) * size].iter().zip(x).map(|(a, x)| a * x).sum::<f64>() - 1.0).abs()
        });
        left.fold(0.0f64, f64::max) / (largest(&a) * largest(x))
    }
}

fn branched<const W: usize>(case: &Case) {
    let plan = &case.plan;
    let (n, m) = (plan.len(), plan.rows());
    let mut mass = vec![[0.0; W]; plan.places()];
    for i in 0..n {
        for j in 0..=i {
            if let Some(at) = plan.entry(i, j) {
                mass[at] = [case.mass[i * n + j]; W];
            }
        }
    }
    let mut rows = vec![[0.0; W]; n * plan.width()];
    for (k, &x) in case.rows.iter().enumerate() {
        rows[k / m * plan.width() + k % m] = [x; W];
    }
    let mut cholesky = BranchedCholesky::<W>::new(plan.clone());
    let (mut force, mut tau) = (vec![[0.0; W]; n], vec![[0.0; W]; m]);
    let name = if W == 1 { "Alg-S".to_owned() } else { format!("Alg-S of {W} at once") };
    case.print(&name, Some(plan.operations().total()), &mut |x| {
        cholesky.factor(&mass).expect("positive definite");
        cholesky.factor_rows(&rows).expect("full rank");
        force.iter_mut().zip(&*x).for_each(|(f, &x)| *f = [x; W]);
        tau.iter_mut().zip(&x[n..]).for_each(|(t, &x)| *t = [x; W]);
        cholesky.solve(&mut force, &mut tau);
        x.iter_mut().zip(force.iter().chain(&tau)).for_each(|(x, y)| *x = y[0]);
        W
    });
}

fn measure(case: &Case) {
    let (n, m) = (case.plan.len(), case.plan.rows());
    let size = n + m;
    let a = case.augmented();

    let mut lu = DenseLu::new(size);
    case.print("Gauss", Some(Operations::gauss(size)), &mut |x| {
        lu.factor(&a).expect("regular");
        lu.solve(x);
        1
    });
    case.print("symmetric indefinite", None, &mut |x| {
        let factors = Lblt::new(MatRef::from_row_major_slice(&a, size, size), Side::Lower);
        factors.solve_in_place(MatMut::from_column_major_slice_mut(x, size, 1));
        1
    });
    let entries: Vec<(usize, usize)> =
        (0..size * size).filter(|&k| a[k] != 0.0).map(|k| (k / size, k % size)).collect();
    let (pattern, places) = SparsePattern::new(size, size, &entries);
    let mut values = vec![0.0; pattern.len()];
    for (&(i, j), &at) in entries.iter().zip(&places) {
        values[at] = a[i * size + j];
    }
    #[cfg(feature = "general-sparse")]
    {
        let general = GeneralSparseLu::new(&pattern).expect("analyzed");
        case.print("general sparse", None, &mut |x| {
            general.solve(&pattern, &values, x).expect("regular");
            1
        });
    }
    let mut frozen = SparseLu::analyze(&pattern, &values).expect("regular");
    case.print("sparse with frozen pivots", None, &mut |x| {
        frozen.refactor(&values).expect("regular");
        frozen.solve(x);
        1
    });
    let mut full = DenseAugmented::new(n, m);
    case.print("Alg-D", Some(Stages::full(n, m).total()), &mut |x| {
        full.factor(&case.mass, &case.rows).expect("positive definite");
        let (force, tau) = x.split_at_mut(n);
        full.solve(force, tau);
        1
    });
    branched::<1>(case);
    branched::<4>(case);
    branched::<8>(case);
}

/// Microseconds of this thread's processor time for one call.
fn median_microseconds(work: &mut dyn FnMut()) -> f64 {
    let mut calls = 1;
    let mut times = Vec::new();
    while times.len() < ROUNDS {
        let start = ThreadTime::now();
        (0..calls).for_each(|_| work());
        let seconds = start.elapsed().as_secs_f64();
        if seconds < ROUND_SECONDS {
            calls *= 2;
        } else {
            times.push(seconds * 1e6 / f64::from(calls));
        }
    }
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}

/// Deterministic numbers in (-1, 1).
fn noise(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

fn main() {
    println!(
        "model,coordinates,rows,solver,additions,multiplications,divisions,microseconds,residual"
    );
    let (parents, sizes, cuts) = vehicle::vehicle();
    measure(&Case::new("vehicle", &parents, &sizes, &cuts));
    let chain: Vec<Option<usize>> = (0..50usize).map(|i| i.checked_sub(1)).collect();
    measure(&Case::new("chain of 50", &chain, &[1; 50], &[]));
    let binary: Vec<Option<usize>> =
        (0..127usize).map(|i| (i + 1).checked_div(2)?.checked_sub(1)).collect();
    measure(&Case::new("binary tree of 127", &binary, &[1; 127], &[]));
    // Forty bodies behind earlier ones at random, eight loops between random pairs.
    let mut noise = noise(11);
    let mut below = |count: usize| ((noise() + 1.0) * 0.5 * count as f64) as usize;
    let random: Vec<Option<usize>> = (0..40).map(|i| below(i + 1).checked_sub(1)).collect();
    let cuts: Vec<CutRows> = (0..8)
        .map(|_| CutRows { nodes: [Some(below(40)), Some(below(40))], rows: 2 })
        .filter(|cut| cut.nodes[0] != cut.nodes[1])
        .collect();
    measure(&Case::new("random tree of 40", &random, &[1; 40], &cuts));
}
