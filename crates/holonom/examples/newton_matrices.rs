//! What does the simplified matrix [M + γhC + βh²K, Gᵀ; G, 0] save in place of the inflated one, and how do
//! iterations with it contract? Prints one line of comma-separated values per tolerance: `cargo run --release -p holonom
//! --example newton_matrices -- model.toml END_TIME`. `benchmarks/newton_matrices` asks and answers.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use holonom::io::{Document, Syntax};
use holonom::method::Code;
use holonom::model::{Model, Tolerance};
use holonom::newton::{ReducedBlocks, Representation};
use holonom::reduction::{Chart, Coordinates, Projection};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, StepOutcome, run};
use holonom::threads::Threads;
use holonom_linalg::{BlockMatrix, DenseLu, SingularMatrix, SparseLu, SparsePattern};
use std::error::Error;

/// γ of SDIRK4/16, and β = γ².
const GAMMA: f64 = 0.25;
const TOLERANCES: [f64; 3] = [1e-3, 1e-4, 1e-5];
/// Steps of a run at which matrices are looked at.
const SAMPLES: usize = 12;
/// Multiplications of a vector with an iteration matrix; the growth of the last half is the contraction.
const POWERS: usize = 60;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [file, end] = &arguments[..] else {
        return Err("usage: newton_matrices FILE END_TIME".into());
    };
    let text = std::fs::read_to_string(file)?;
    let mut read = |name: &str| std::fs::read_to_string(name).map_err(|e| e.to_string());
    let mut bytes = |name: &str| std::fs::read(name).map_err(|e| e.to_string());
    let document = Document::parse(&text, Syntax::of_file(file), file, &mut read)
        .and_then(|document| document.with_meshes(&mut bytes))
        .map_err(|e| e.render())?;
    let (model, _) = document.build().map_err(|e| e.render())?;
    for tolerance in TOLERANCES {
        println!("{tolerance:e},{}", measured(&model, tolerance, end.parse()?)?);
    }
    Ok(())
}

/// One run with the inflated matrix, and both matrices at some of its steps.
fn measured(model: &Model, tolerance: f64, end: f64) -> Result<String, Box<dyn Error>> {
    let options = |output| Options {
        code: Code::ForSdirk16,
        tolerance: Tolerance::uniform(tolerance),
        coordinates: Coordinates::Cartesian,
        newton: Representation::Sparse,
        output,
        ..Options::new(end)
    };
    let problem = Problem::new(model.clone());
    let mut rows = Memory::default();
    let summary = run(&problem, &options(OutputTimes::Listed(Vec::new())), None, &mut rows)?;
    let accepted: Vec<[f64; 2]> = (rows.all.steps.iter())
        .filter(|step| step.outcome == StepOutcome::Accepted)
        .map(|step| [step.t, step.h])
        .collect();
    // Not the first ones, which are short.
    let chosen: Vec<[f64; 2]> =
        (1..=SAMPLES).map(|k| accepted[k * (accepted.len() - 1) / SAMPLES]).collect();
    let times = chosen.iter().map(|step| step[0]).collect();
    let mut states = Memory::default();
    run(&problem, &options(OutputTimes::Listed(times)), None, &mut states)?;
    let assembled = problem.assemble().map_err(|e| e.to_string())?;
    let mut manifold = assembled.manifold();
    let (sizes, ndof) = (problem.system().structure().sizes, assembled.parametrization().ndof);
    let mut blocks = ReducedBlocks::new(&manifold, &Threads::default());
    let mut state = assembled.state.clone();
    let mut found = Vec::new();
    let mut costs = [[0; 2]; 2];
    let mut one_order = 0;
    for (k, &[t, h]) in chosen.iter().enumerate() {
        let n = sizes.coordinates;
        let m = sizes.rows;
        state.t = t;
        state.q.copy_from_slice(&states.all.q[k * n..(k + 1) * n]);
        state.v.copy_from_slice(&states.all.v[k * n..(k + 1) * n]);
        state.a.copy_from_slice(&states.all.a[k * n..(k + 1) * n]);
        state.lambda.copy_from_slice(&states.all.lambda[k * m..(k + 1) * m]);
        manifold.go_back(&state.q);
        manifold.evaluate_mass(&state.q);
        blocks.evaluate(&mut manifold, &state);
        let mass = manifold.mass().clone();
        found.push(contraction(&blocks, &mass, GAMMA * h)?);
        let jacobian = manifold.jacobian().clone();
        let chart = manifold.chart();
        let matrices = Matrices { blocks: &blocks, mass, jacobian, chart, gamma_h: GAMMA * h };
        let both = [matrices.inflated(), matrices.simplified()];
        one_order = one_order.max(analysed(&both[0], SparseLu::analyze)?.operations());
        for (cost, matrix) in costs.iter_mut().zip(&both) {
            let lu = analysed(matrix, SparseLu::analyze_for_many)?;
            *cost = [cost[0].max(lu.operations()), cost[1].max(lu.fill())];
        }
    }
    let mean = |x: &[f64]| x.iter().sum::<f64>() / x.len() as f64;
    let told = summary.statistics.contractions;
    let largest = found.iter().copied().fold(0.0, f64::max);
    Ok(format!(
        "{},{ndof},{},{one_order},{},{},{},{},{:.4},{:.4},{:.4},{:.4}",
        sizes.bodies,
        summary.statistics.steps,
        costs[0][0],
        costs[0][1],
        costs[1][0],
        costs[1][1],
        told.mean(),
        told.largest,
        mean(&found),
        largest
    ))
}

/// Spectral radius of 1 − Ψ'⁻¹Ψ, Ψ = M̂ + γh M̂₁ + γ²h² M̂₂ and Ψ' = Dᵀ(M + γhC + γ²h²K)D: by that, iterations
/// with the simplified matrix contract on the linear problem for which those with Ψ converge at once.
fn contraction(b: &ReducedBlocks, mass: &BlockMatrix, gamma_h: f64) -> Result<f64, SingularMatrix> {
    let ndof = (b.mass.len() as f64).sqrt() as usize;
    let mut product = vec![0.0; b.d.len()];
    let terms =
        [(1.0, mass), (gamma_h, &b.blocks.damping), (gamma_h * gamma_h, &b.blocks.stiffness)];
    for (scale, matrix) in terms {
        matrix.multiply_many_add(scale, &b.d, ndof, &mut product);
    }
    let mut simplified = vec![0.0; ndof * ndof];
    for (d, x) in b.d.chunks_exact(ndof).zip(product.chunks_exact(ndof)) {
        for (row, d) in simplified.chunks_exact_mut(ndof).zip(d) {
            row.iter_mut().zip(x).for_each(|(out, x)| *out += d * x);
        }
    }
    let full: Vec<f64> = (b.mass.iter().zip(&b.damping).zip(&b.stiffness))
        .map(|((m, m1), m2)| m + gamma_h * m1 + gamma_h * gamma_h * m2)
        .collect();
    let mut lu = DenseLu::new(ndof);
    lu.factor(&simplified)?;
    let mut x: Vec<f64> = (0..ndof).map(|k| 1.0 + (k as f64).sin()).collect();
    let mut growth = 0.0;
    for power in 0..POWERS {
        let mut y: Vec<f64> = (full.chunks_exact(ndof))
            .map(|row| row.iter().zip(&x).map(|(a, x)| a * x).sum())
            .collect();
        lu.solve(&mut y);
        y.iter_mut().zip(&x).for_each(|(y, x)| *y = x - *y);
        let size = y.iter().fold(0.0f64, |m, y| m.max(y.abs()));
        if size == 0.0 {
            return Ok(0.0);
        }
        let before = x.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if power >= POWERS / 2 {
            growth += (size / before).ln();
        }
        x = y.iter().map(|y| y / size).collect();
    }
    Ok((growth / (POWERS / 2) as f64).exp())
}

/// An entry's row, column and value.
type Entry = (usize, usize, f64);

/// What both matrices are made of.
struct Matrices<'a> {
    blocks: &'a ReducedBlocks,
    mass: BlockMatrix,
    jacobian: BlockMatrix,
    chart: &'a Chart,
    gamma_h: f64,
}

impl Matrices<'_> {
    /// Entries that differ from zero, the kept rows only where the matrix has those of G.
    fn entries(&self, matrix: &BlockMatrix, rows_of_g: bool) -> Vec<Entry> {
        let kept = &self.chart.parametrization().kept;
        let all = matrix.entries(0, 0).into_iter().zip(matrix.values());
        let differing = all.filter(|(_, x)| **x != 0.0);
        differing
            .filter_map(|((i, j), &x)| {
                let row = if rows_of_g { kept.binary_search(&i).ok()? } else { i };
                Some((row, j, x))
            })
            .collect()
    }

    /// (11) to (14) of `docs/theory/newton.md`.
    fn inflated(&self) -> (usize, Vec<Entry>) {
        let parametrization = self.chart.parametrization();
        let (rank, linear) = (parametrization.kept.len(), parametrization.linear());
        let n = rank + parametrization.ndof;
        let g = self.entries(&self.jacobian, true);
        let mut p = Vec::new();
        match &parametrization.projection {
            Projection::Selection(chosen) => {
                p.extend(chosen.iter().enumerate().map(|(k, &i)| (rank + k, i, 1.0)));
            }
            Projection::Basis(rows) => {
                let all = rows.iter().enumerate().filter(|(_, x)| **x != 0.0);
                p.extend(all.map(|(at, &x)| (rank + at / n, at % n, x)));
            }
            Projection::Relative(_) => {}
        }
        let moving = |rows: &holonom::reduction::BodyRows| -> Vec<Entry> {
            let all = rows.entries().map(|(at, row, j)| (rank + linear + row, j, rows.value(at)));
            all.filter(|e| e.2 != 0.0).collect()
        };
        p.extend(moving(self.chart.moving()));
        let (h1, h2) = (self.gamma_h, self.gamma_h * self.gamma_h);
        let b = &self.blocks.blocks;
        let a0 = [self.entries(&b.a0, true), moving(&self.blocks.turning)].concat();
        let a1 = [self.entries(&b.a1, true), moving(&self.blocks.turning_rate)].concat();
        let mut out = Vec::new();
        let mut add = |entries: &[Entry], row: usize, column: usize, scale: f64| {
            out.extend(entries.iter().map(|(i, j, x)| (row + i, column + j, scale * x)));
        };
        let minus: Vec<Entry> =
            (0..parametrization.ndof).map(|k| (rank + k, rank + k, -1.0)).collect();
        for level in 0..3 {
            add(&g, level * n, level * n, 1.0);
            add(&p, level * n, level * n, 1.0);
            add(&minus, level * n, 3 * n, 1.0);
        }
        add(&a0, n, 0, h1);
        add(&a1, 2 * n, 0, h2);
        add(&a0, 2 * n, n, 2.0 * h1);
        add(&self.entries(&b.stiffness, false), 3 * n, 0, h2);
        add(&self.entries(&b.damping, false), 3 * n, n, h1);
        add(&self.entries(&self.mass, false), 3 * n, 2 * n, 1.0);
        let transposed: Vec<Entry> = g.iter().map(|&(i, j, x)| (j, i, x)).collect();
        add(&transposed, 3 * n, 3 * n, 1.0);
        (4 * n, out)
    }

    /// [M + γhC + γ²h²K, Gᵀ; G, 0].
    fn simplified(&self) -> (usize, Vec<Entry>) {
        let parametrization = self.chart.parametrization();
        let rank = parametrization.kept.len();
        let n = rank + parametrization.ndof;
        let b = &self.blocks.blocks;
        let mut out = self.entries(&self.mass, false);
        for (matrix, scale) in
            [(&b.damping, self.gamma_h), (&b.stiffness, self.gamma_h * self.gamma_h)]
        {
            out.extend(self.entries(matrix, false).iter().map(|&(i, j, x)| (i, j, scale * x)));
        }
        for (i, j, x) in self.entries(&self.jacobian, true) {
            out.extend([(n + i, j, x), (j, n + i, x)]);
        }
        (n + rank, out)
    }
}

/// The factored matrix of these entries.
fn analysed(
    (order, entries): &(usize, Vec<Entry>),
    analyze: impl Fn(&SparsePattern, &[f64]) -> Result<SparseLu, SingularMatrix>,
) -> Result<SparseLu, SingularMatrix> {
    let places: Vec<(usize, usize)> = entries.iter().map(|&(i, j, _)| (i, j)).collect();
    let (pattern, slots) = SparsePattern::new(*order, *order, &places);
    let mut values = vec![0.0; pattern.len()];
    for (&slot, (_, _, x)) in slots.iter().zip(entries) {
        values[slot] += x;
    }
    analyze(&pattern, &values)
}
