//! How long do accelerations in Cartesian coordinates take, by which solver? Prints one line of
//! comma-separated values per table, model and solver: `cargo run --release -p holonom --example accelerations
//! --features general-sparse`; of some tables alone where they are named, `-- evaluation dense`.
//! `benchmarks/accelerations` asks and answers.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use cpu_time::ThreadTime;
use holonom::io::{Document, Syntax};
use holonom::model::{Dimension, Model, Orientation};
use holonom::newton::ReducedBlocks;
use holonom::reduction::Point;
use holonom::reduction::accelerations::{
    AccelerationSolver, Accelerations, IndexOneEquations, Numbering, ReducedMatrix, SolverKind,
};
use holonom::simulation::Problem;
use holonom::system::{State, System};
use holonom::threads::Threads;
#[cfg(feature = "general-sparse")]
use holonom_linalg::GeneralSparseLu;
use holonom_linalg::{
    BlockMatrix, Cholesky, DenseLu, EnvelopeCholesky, EnvelopePlan, SparseLu, SparsePattern,
};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

const TABLES: [&str; 5] = ["2", "evaluation", "dense", "3", "4"];
const ROUNDS: usize = 9;
const SOLVES: usize = 1000;
/// Longest time of one round of one solver, s; slow solvers make fewer solves.
const ROUND_SECONDS: f64 = 0.3;

/// A model at a state in motion.
struct Case {
    name: &'static str,
    system: Arc<dyn System>,
    kept: Vec<usize>,
    state: State,
    mass: BlockMatrix,
    jacobian: BlockMatrix,
    force: Vec<f64>,
    tau: Vec<f64>,
    point: Point,
    /// Independent variables and their rates.
    p: Vec<f64>,
    rates: Vec<f64>,
}

impl Case {
    fn new(name: &'static str, model: Model) -> Result<Self, Box<dyn Error>> {
        let problem = Problem::new(model);
        let assembled = problem.assemble().map_err(|e| e.to_string())?;
        let system = assembled.manifold().system().clone();
        let chart = assembled.parametrization().clone();
        let (mut p, mut rates) = (vec![0.0; chart.ndof], vec![0.0; chart.ndof]);
        assembled.manifold().independent_state(&assembled.state, &mut p, &mut rates);
        let rates: Vec<f64> = (0..chart.ndof).map(|k| 1.0 + 0.1 * (k as f64).sin()).collect();
        let mut point = Point::new(assembled.manifold(), &assembled.state);
        point
            .evaluate(assembled.state.t, &p, &rates, &assembled.state.z, true)
            .map_err(|e| e.message)?;
        let (state, structure) = (point.state.clone(), system.structure());
        let mut out = Self {
            name,
            kept: chart.kept.to_vec(),
            mass: structure.mass_pattern.zeros(),
            jacobian: structure.constraint_pattern.zeros(),
            force: vec![0.0; structure.sizes.coordinates],
            tau: vec![0.0; structure.sizes.rows],
            system: system.clone(),
            state,
            point,
            p,
            rates,
        };
        let mut z_rate = vec![0.0; structure.sizes.extra_states];
        system.mass_matrix(&out.state.q, &mut out.mass);
        system.constraint_jacobian(&out.state.q, &mut out.jacobian);
        system.forces(&out.state, &mut out.force, &mut z_rate);
        system.acceleration_rhs(out.state.t, &out.state.q, &out.state.v, &mut out.tau);
        Ok(out)
    }

    fn equations(&self) -> IndexOneEquations<'_> {
        IndexOneEquations {
            q: &self.state.q,
            mass: &self.mass,
            jacobian: &self.jacobian,
            force: &self.force,
            tau: &self.tau,
        }
    }
}

/// One thing to time: what it is, its order, what it solves.
struct Entry<'a> {
    solver: String,
    numbering: &'static str,
    order: usize,
    multiplications: Option<usize>,
    /// (blocks of the envelope, block operations, their bound).
    counts: Option<(usize, usize, usize)>,
    run: Box<dyn FnMut() -> Vec<f64> + 'a>,
}

/// Times all entries in turn and prints them, relative to the first one's solution.
fn measure(table: &str, model: &str, mut entries: Vec<Entry>) {
    let truth = (entries[0].run)();
    let size = truth.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let mut seconds = vec![Vec::new(); entries.len()];
    let mut count = vec![SOLVES; entries.len()];
    for round in 0..=ROUNDS {
        for (k, entry) in entries.iter_mut().enumerate() {
            let solves = if round == 0 { 3 } else { count[k] };
            let start = ThreadTime::now();
            for _ in 0..solves {
                std::hint::black_box((entry.run)());
            }
            let each = start.elapsed().as_secs_f64() / solves as f64;
            if round == 0 {
                count[k] = ((ROUND_SECONDS / each) as usize).clamp(3, SOLVES);
            } else {
                seconds[k].push(each);
            }
        }
    }
    for (entry, seconds) in entries.iter_mut().zip(&mut seconds) {
        seconds.sort_by(f64::total_cmp);
        let found = (entry.run)();
        let off = found.iter().zip(&truth).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / size;
        let [blocks, operations, bound] = match entry.counts {
            Some((a, b, c)) => [a, b, c].map(|x| x.to_string()),
            None => [const { String::new() }; 3],
        };
        println!(
            "{table},{model},{},{},{},{},{blocks},{operations},{bound},{:.3},{off:.1e}",
            entry.solver,
            entry.numbering,
            entry.order,
            entry.multiplications.map_or(String::new(), |x| x.to_string()),
            // Microseconds of one solve are milliseconds of 1,000.
            1e6 * seconds[seconds.len() / 2],
        );
    }
}

/// Everything from G, M, Q and τ to the accelerations and multipliers: Table 2.
fn accelerations(case: &Case, bad: &Numbering) -> Result<(), Box<dyn Error>> {
    let graph = ReducedMatrix::new(case.system.as_ref(), &case.kept)?.graph().clone();
    let counts = |numbering: &Numbering| {
        let plan = EnvelopePlan::new(&graph, &numbering.order(&graph));
        (plan.envelope(), plan.operations(), plan.operation_bound())
    };
    let list: Vec<(&str, &str, SolverKind)> = vec![
        ("augmented dense LU", "", SolverKind::AugmentedDense),
        ("augmented sparse LU (pivoting)", "", SolverKind::AugmentedSparsePivoting),
        #[cfg(feature = "general-sparse")]
        ("augmented sparse LU (faer)", "", SolverKind::AugmentedGeneral),
        ("augmented sparse LU (frozen pivots)", "", SolverKind::AugmentedSparse),
        ("reduced dense LU", "", SolverKind::ReducedDenseLu),
        ("reduced dense Cholesky", "", SolverKind::ReducedDenseCholesky),
        ("reduced envelope Cholesky", "bad", SolverKind::ReducedEnvelope(bad.clone())),
        ("reduced envelope Cholesky", "given", SolverKind::ReducedEnvelope(Numbering::Given)),
        ("reduced envelope Cholesky", "good", SolverKind::ReducedEnvelope(Numbering::Least)),
    ];
    let system = case.system.as_ref();
    let mut entries = Vec::new();
    for (solver, numbering, kind) in list {
        let mut prepared: Box<dyn AccelerationSolver> =
            kind.prepare(system, &case.state.q, &case.kept)?;
        let (mut a, mut lambda) = (case.state.a.clone(), case.state.lambda.clone());
        prepared.solve(system, &case.equations(), &mut a, &mut lambda).map_err(|e| e.message)?;
        entries.push(Entry {
            solver: solver.to_owned(),
            numbering,
            order: prepared.order(),
            multiplications: prepared.multiplications(),
            counts: match &kind {
                SolverKind::ReducedEnvelope(numbering) => Some(counts(numbering)),
                _ => None,
            },
            run: Box::new(move || {
                // The copy of the accelerations is the same for all.
                let outcome = prepared.solve(system, &case.equations(), &mut a, &mut lambda);
                outcome.expect("solved before");
                a.clone()
            }),
        });
    }
    measure("2", case.name, entries);
    Ok(())
}

/// A whole evaluation of accelerations from independent variables, each way; multipliers are not asked for.
fn evaluation(case: &Case) -> Result<(), Box<dyn Error>> {
    let (p, rates, z, t) = (&case.p, &case.rates, &case.state.z, case.state.t);
    let cheapest = case.point.manifold.accelerator().way();
    let costs = *case.point.manifold.accelerator().costs();
    let mut entries = Vec::new();
    for (way, cost) in [
        (Accelerations::Recursive, costs.recursive),
        (Accelerations::NullSpace, costs.null_space),
        (Accelerations::Reduced, costs.reduced),
        (Accelerations::Augmented, costs.augmented),
    ] {
        if cost.is_infinite() {
            // Loops are not along a tree.
            continue;
        }
        let mut point = case.point.clone();
        point.manifold.set_accelerations(way)?;
        entries.push(Entry {
            solver: format!("evaluation by {}", way.name().replace('_', " ")),
            numbering: if way == cheapest { "chosen" } else { "" },
            order: case.kept.len(),
            multiplications: Some(cost as usize),
            counts: None,
            run: Box::new(move || {
                point.evaluate(t, p, rates, z, true).expect("evaluated before");
                point.state.a.clone()
            }),
        });
    }
    measure("evaluation", case.name, entries);
    Ok(())
}

/// A dense matrix of deterministic noise with right-hand sides.
fn noise(n: usize) -> Vec<f64> {
    let mut state = 88_172_645_463_325_252_u64;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..n * n).map(|_| next()).collect()
}

/// Accelerations and an integration Jacobian against dense LU factorisations of the order of the constraints,
/// which a formulation without structure needs: for the Jacobian with a right-hand side for each degree of
/// freedom.
fn against_dense(case: &Case) -> Result<(), Box<dyn Error>> {
    let rows = case.kept.len();
    let ndof = case.p.len();
    let matrix = noise(rows);
    let (mut first, mut second) = (DenseLu::new(rows), DenseLu::new(rows));
    let mut right = vec![0.0; rows * ndof];
    let (p, rates, z, t) = (&case.p, &case.rates, &case.state.z, case.state.t);
    let mut point = case.point.clone();
    point.evaluate(t, p, rates, z, true).map_err(|e| e.message)?;
    point.complete();
    let mut blocks = ReducedBlocks::new(&point.manifold, &Threads::default());
    let mut psi = vec![0.0; ndof * ndof];
    let mut factor = DenseLu::new(ndof);
    let (system, state) = (case.system.as_ref(), point.state.clone());
    let mut manifold = point.manifold;
    let kind = SolverKind::ReducedEnvelope(Numbering::Least);
    let mut solver = kind.prepare(system, &case.state.q, &case.kept)?;
    let (mut a, mut lambda) = (case.state.a.clone(), case.state.lambda.clone());
    let matrix = &matrix;
    let runs: Vec<(&str, Box<dyn FnMut()>)> = vec![
        ("dense LU", Box::new(move || first.factor(matrix).expect("regular"))),
        (
            "accelerations",
            Box::new(move || {
                let outcome = solver.solve(system, &case.equations(), &mut a, &mut lambda);
                outcome.expect("solved before");
            }),
        ),
        (
            "dense LU with right-hand sides",
            Box::new(move || {
                second.factor(matrix).expect("regular");
                right.fill(1.0);
                second.solve_many(&mut right, ndof);
            }),
        ),
        (
            "integration Jacobian",
            Box::new(move || {
                let gamma_h = std::hint::black_box(1e-3);
                blocks.evaluate(&mut manifold, &state);
                let b = &blocks;
                let parts = b.mass.iter().zip(&b.damping).zip(&b.stiffness);
                for (psi, ((m, m1), m2)) in psi.iter_mut().zip(parts) {
                    *psi = m + gamma_h * (m1 + gamma_h * m2);
                }
                factor.factor(&psi).expect("regular");
            }),
        ),
    ];
    let entries = runs.into_iter().map(|(solver, mut run)| Entry {
        solver: solver.to_owned(),
        numbering: "",
        order: rows,
        multiplications: None,
        counts: None,
        run: Box::new(move || {
            run();
            vec![1.0]
        }),
    });
    measure("dense", case.name, entries.collect());
    Ok(())
}

/// Factorisation of the reduced matrix and one solve with it: Tables 3 (bad numbering) and 4 (good).
fn reduced(table: &str, case: &Case, numbering: &Numbering) -> Result<(), Box<dyn Error>> {
    let mut matrix = ReducedMatrix::new(case.system.as_ref(), &case.kept)?;
    let order = numbering.order(matrix.graph());
    let (n, rows, begin) = (matrix.n(), matrix.graph().sizes().to_vec(), matrix.begins());
    let mut place = vec![0; order.len()];
    order.iter().fold(0, |at, &joint| {
        place[joint] = at;
        at + rows[joint]
    });
    // Dense, in the numbering; the right-hand side, too.
    let mut dense = vec![0.0; n * n];
    matrix.place(|i, j| place[i] <= place[j], |i, j| (place[i] * n + place[j], n));
    matrix.assemble(&case.state.q, &case.jacobian, &mut dense);
    let mut given = vec![0.0; n];
    matrix.right_side(&case.equations(), &mut given);
    let mut right = vec![0.0; n];
    for (joint, &at) in place.iter().enumerate() {
        right[at..at + rows[joint]].copy_from_slice(&given[begin[joint]..begin[joint + 1]]);
    }
    for i in 0..n {
        for j in 0..i {
            dense[i * n + j] = dense[j * n + i];
        }
    }
    let entries: Vec<(usize, usize)> = (0..n * n).map(|k| (k / n, k % n)).collect();
    let entries: Vec<(usize, usize)> =
        entries.into_iter().filter(|&(i, j)| dense[i * n + j] != 0.0).collect();
    let (pattern, _) = SparsePattern::new(n, n, &entries);
    let values: Vec<f64> = entries.iter().map(|&(i, j)| dense[i * n + j]).collect();

    let plan = Arc::new(EnvelopePlan::new(matrix.graph(), &order));
    let mut skyline = vec![0.0; plan.len()];
    matrix.place(|i, j| plan.in_order(i, j), |i, j| (plan.block(i, j).start, rows[j]));
    matrix.assemble(&case.state.q, &case.jacobian, &mut skyline);
    // The envelope has its own numbering inside: the right-hand side is in the one of the joints.
    let to_numbering = |x: &[f64]| {
        let mut out = vec![0.0; n];
        for (joint, &at) in place.iter().enumerate() {
            out[at..at + rows[joint]].copy_from_slice(&x[begin[joint]..begin[joint + 1]]);
        }
        out
    };
    let (mut lu, mut cholesky) = (DenseLu::new(n), Cholesky::new(n));
    let mut frozen = SparseLu::analyze(&pattern, &values)?;
    let mut envelope = EnvelopeCholesky::new(plan.clone());
    #[cfg(feature = "general-sparse")]
    let general = GeneralSparseLu::new(&pattern)?;
    let (dense, right, values, pattern) = (&dense, &right, &values, &pattern);
    let runs: Vec<(&str, Box<dyn FnMut() -> Vec<f64>>)> = vec![
        (
            "dense LU",
            Box::new(move || {
                let mut x = right.clone();
                lu.factor(dense).expect("regular");
                lu.solve(&mut x);
                x
            }),
        ),
        (
            "dense Cholesky",
            Box::new(move || {
                let mut x = right.clone();
                cholesky.factor(dense).expect("definite");
                cholesky.solve(&mut x);
                x
            }),
        ),
        (
            "sparse LU (pivoting)",
            Box::new(move || {
                let mut x = right.clone();
                SparseLu::analyze(pattern, values).expect("regular").solve(&mut x);
                x
            }),
        ),
        #[cfg(feature = "general-sparse")]
        (
            "sparse LU (faer)",
            Box::new(move || {
                let mut x = right.clone();
                general.solve(pattern, values, &mut x).expect("regular");
                x
            }),
        ),
        (
            "sparse LU (frozen pivots)",
            Box::new(move || {
                let mut x = right.clone();
                frozen.refactor(values).expect("regular");
                frozen.solve(&mut x);
                x
            }),
        ),
        (
            "envelope Cholesky",
            Box::new(move || {
                let mut x = given.clone();
                envelope.factor_solve(&skyline, &mut x).expect("definite");
                to_numbering(&x)
            }),
        ),
    ];
    let numbering = if table == "3" { "bad" } else { "good" };
    let entries = runs.into_iter().map(|(solver, run)| Entry {
        solver: solver.to_owned(),
        numbering,
        order: n,
        multiplications: (solver == "envelope Cholesky").then(|| plan.multiplications()),
        counts: (solver == "envelope Cholesky")
            .then(|| (plan.envelope(), plan.operations(), plan.operation_bound())),
        run,
    });
    measure(table, case.name, entries.collect());
    Ok(())
}

/// Of many random numberings the one with the greatest bound; for long chains the alternating one.
fn bad_numbering(case: &Case) -> Result<Numbering, Box<dyn Error>> {
    let matrix = ReducedMatrix::new(case.system.as_ref(), &case.kept)?;
    let graph = matrix.graph();
    let bound = |order: &[usize]| EnvelopePlan::new(graph, order).operation_bound();
    let mut worst = Numbering::Alternating.order(graph);
    if graph.len() > 30 {
        return Ok(Numbering::Alternating);
    }
    let mut seed = 88_172_645_463_325_252_u64;
    let mut order = worst.clone();
    for _ in 0..20_000 {
        for i in (1..order.len()).rev() {
            seed ^= seed << 13;
            seed ^= seed >> 7;
            seed ^= seed << 17;
            order.swap(i, (seed % (i as u64 + 1)) as usize);
        }
        if bound(&order) > bound(&worst) {
            worst.clone_from(&order);
        }
    }
    Ok(Numbering::Listed(worst))
}

fn model(name: &str) -> Result<Model, Box<dyn Error>> {
    let library = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../models");
    let folder = library.join(name);
    let text = std::fs::read_to_string(folder.join("model.toml"))?;
    let mut none = |_: &str| Err("no other file".to_owned());
    let mut bytes = |file: &str| std::fs::read(folder.join(file)).map_err(|e| e.to_string());
    let document = Document::parse(&text, Syntax::Toml, "model.toml", &mut none)
        .and_then(|document| document.with_meshes(&mut bytes))
        .and_then(|document| document.build())
        .map_err(|errors| errors.render())?;
    Ok(document.0)
}

/// A planar model with bodies, joints and forces in space; what this makes redundant is dropped.
fn in_space(mut model: Model) -> Model {
    let orientation = |old: Orientation| match old {
        Orientation::Angle(angle) => {
            let (sin, cos) = (0.5 * angle).sin_cos();
            Orientation::EulerParameters([cos, 0.0, 0.0, sin])
        }
        spatial @ Orientation::EulerParameters(_) => spatial,
    };
    model.dimension = Dimension::Spatial;
    for body in &mut model.bodies {
        let j = body.inertia[2][2];
        body.inertia = [[j, 0.0, 0.0], [0.0, j, 0.0], [0.0, 0.0, j]];
        body.orientation = orientation(body.orientation);
    }
    for body in &mut model.initial.bodies {
        body.orientation = body.orientation.map(orientation);
    }
    model
}

fn main() -> Result<(), Box<dyn Error>> {
    let tables: Vec<String> = std::env::args().skip(1).collect();
    if let Some(other) = tables.iter().find(|table| !TABLES.contains(&table.as_str())) {
        return Err(format!("there is no table `{other}`; there are {}", TABLES.join(", ")).into());
    }
    let is_asked_for = |table: &str| tables.is_empty() || tables.iter().any(|asked| asked == table);
    println!(
        "table,model,solver,numbering,order,multiplications,envelope,block_operations,bound,\
         ms_per_1000,difference"
    );
    let cases = vec![
        Case::new("seven-body", model("andrews")?)?,
        Case::new("chain of 50", model("chain50")?)?,
        Case::new("seven-body in space", in_space(model("andrews")?))?,
        Case::new("chain of 50 in space", in_space(model("chain50")?))?,
        Case::new("spatial four-bar", model("spatial_four_bar")?)?,
        Case::new("14-body vehicle", model("hmmwv14")?)?,
    ];
    for case in cases.iter().filter(|_| is_asked_for("2")) {
        accelerations(case, &bad_numbering(case)?)?;
    }
    for case in cases.iter().filter(|_| is_asked_for("evaluation")) {
        evaluation(case)?;
    }
    if is_asked_for("dense") {
        against_dense(&cases[5])?;
    }
    for case in &cases {
        if is_asked_for("3") {
            reduced("3", case, &bad_numbering(case)?)?;
        }
        if is_asked_for("4") {
            reduced("4", case, &Numbering::Least)?;
        }
    }
    Ok(())
}
