//! What does the integration Jacobian of the 14-body vehicle cost? One evaluation makes all derivative
//! blocks, G, the factors of [G; P], M̂, M̂₁, M̂₂ and Ψ = M̂ + γh M̂₁ + γ²h² M̂₂ of order 18, and factors Ψ.
//! The measure is one dense LU of order 80, the number of constraints, with 18 right-hand sides, which a
//! formulation without structure needs for the dependent coordinates alone.
//!
//! `cargo bench -p holonom --bench vehicle` times both and prints the ratio of their medians, taken in
//! turn. Bound: 8; see `benchmarks/accelerations` for what is measured.

#![allow(missing_docs)] // of the functions that criterion's macros make
#![allow(clippy::print_stdout, reason = "the ratio is for the reader")]

use std::hint::black_box;
use std::path::Path;
use std::time::Instant;

use criterion::Criterion;
use holonom::io::{Document, Syntax};
use holonom::newton::ReducedBlocks;
use holonom::reduction::Manifold;
use holonom::simulation::Problem;
use holonom::system::State;
use holonom::threads::Threads;
use holonom_linalg::{BlockMatrix, DenseLu};

/// The vehicle at its start and buffers for its integration Jacobian.
struct Vehicle {
    manifold: Manifold,
    state: State,
    g: BlockMatrix,
    blocks: ReducedBlocks,
    psi: Vec<f64>,
    factor: DenseLu,
}

impl Vehicle {
    fn new() -> Self {
        let file = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/hmmwv14/model.toml");
        let text = std::fs::read_to_string(file).expect("the model is there");
        let mut none = |_: &str| Err("no other file".to_owned());
        let folder = Path::new(file).parent().expect("a file in a folder");
        let mut bytes = |name: &str| std::fs::read(folder.join(name)).map_err(|e| e.to_string());
        let document = Document::parse(&text, Syntax::Toml, file, &mut none).expect("reads");
        let document = document.with_meshes(&mut bytes).expect("its shapes are there");
        let problem = Problem::new(document.build().expect("is valid").0);
        let assembled = problem.assemble().expect("assembles");
        let (manifold, state) = (assembled.manifold(), assembled.state.clone());
        let ndof = manifold.chart().ndof();
        Self {
            g: manifold.jacobian().clone(),
            blocks: ReducedBlocks::new(&manifold, &Threads::default()),
            psi: vec![0.0; ndof * ndof],
            factor: DenseLu::new(ndof),
            manifold,
            state,
        }
    }

    /// Everything of one integration Jacobian with γh = 1 ms.
    fn jacobian(&mut self) {
        let gamma_h = black_box(1e-3);
        let system = self.manifold.system().clone();
        system.constraint_jacobian(&self.state.q, &mut self.g);
        let chart = self.manifold.chart_mut();
        chart.refactor(system.as_ref(), &self.state.q, &self.g).expect("regular");
        self.blocks.evaluate(&mut self.manifold, &self.state);
        let b = &self.blocks;
        let parts = b.mass.iter().zip(&b.damping).zip(&b.stiffness);
        for (psi, ((m, m1), m2)) in self.psi.iter_mut().zip(parts) {
            *psi = m + gamma_h * (m1 + gamma_h * m2);
        }
        self.factor.factor(&self.psi).expect("regular");
    }
}

/// A dense matrix of deterministic noise with right-hand sides.
struct Dense {
    a: Vec<f64>,
    x: Vec<f64>,
    lu: DenseLu,
}

impl Dense {
    fn new(n: usize, k: usize) -> Self {
        let mut state = 88_172_645_463_325_252_u64;
        let mut noise = || {
            state ^= state << 13;
            state ^= state >> 7;
            state ^= state << 17;
            (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let a = (0..n * n).map(|_| noise()).collect();
        Self { a, x: vec![0.0; n * k], lu: DenseLu::new(n) }
    }

    fn factor_and_solve(&mut self) {
        self.lu.factor(black_box(&self.a)).expect("regular");
        self.x.fill(1.0);
        self.lu.solve_many(black_box(&mut self.x), 18);
    }
}

/// Median time of one call, s, of two kernels timed in turn.
fn medians(mut first: impl FnMut(), mut second: impl FnMut()) -> (f64, f64) {
    const ROUNDS: usize = 201;
    const CALLS: u32 = 20;
    let mut times = [Vec::with_capacity(ROUNDS), Vec::with_capacity(ROUNDS)];
    for _ in 0..ROUNDS {
        for (side, times) in times.iter_mut().enumerate() {
            let begun = Instant::now();
            for _ in 0..CALLS {
                if side == 0 { first() } else { second() }
            }
            times.push(begun.elapsed().as_secs_f64() / f64::from(CALLS));
        }
    }
    let [first, second] = times.map(|mut times| {
        times.sort_by(f64::total_cmp);
        times[ROUNDS / 2]
    });
    (first, second)
}

fn main() {
    let (mut vehicle, mut dense) = (Vehicle::new(), Dense::new(80, 18));
    let mut criterion = Criterion::default().configure_from_args();
    criterion.bench_function("vehicle: integration Jacobian", |b| b.iter(|| vehicle.jacobian()));
    criterion.bench_function("dense LU 80 with 18 right-hand sides", |b| {
        b.iter(|| dense.factor_and_solve());
    });
    criterion.final_summary();
    let (jacobian, lu) = medians(|| vehicle.jacobian(), || dense.factor_and_solve());
    println!(
        "integration Jacobian {:.1} µs, dense LU {:.1} µs: ratio {:.2}, bound 8",
        jacobian * 1e6,
        lu * 1e6,
        jacobian / lu
    );
}
