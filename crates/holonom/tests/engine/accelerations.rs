//! Solvers of the accelerations in Cartesian coordinates against each other. Independent truth: a dense LU of
//! the augmented system, which knows no structure, and published accelerations.

use crate::common::{model, model_of};
use crate::random::{Mechanism, numbers::Random};
use holonom::model::Model;
use holonom::reduction::accelerations::{
    Accelerations, IndexOneEquations, Numbering, ReducedEnvelope, ReducedMatrix, Refusal,
    SolverKind,
};
use holonom::reduction::assembly::Assembled;
use holonom::reduction::{Manifold, Parametrization, Point};
use holonom::simulation::Problem;
use holonom::system::{Measure, State, System};
use holonom_linalg::{BlockMatrix, singular_values};
use std::fmt::Write as _;
use std::sync::Arc;

/// A model at one state with everything that stands in its equations.
struct Case {
    name: String,
    system: Arc<dyn System>,
    kept: Vec<usize>,
    state: State,
    mass: BlockMatrix,
    jacobian: BlockMatrix,
    force: Vec<f64>,
    tau: Vec<f64>,
    /// Factored there.
    manifold: Manifold,
}

impl Case {
    fn new(name: &str, point: &Point, chart: &Parametrization) -> Self {
        let (state, system) = (&point.state, point.manifold.system());
        let structure = system.structure();
        let mut out = Self {
            name: name.to_owned(),
            system: system.clone(),
            kept: chart.kept.to_vec(),
            state: state.clone(),
            mass: structure.mass_pattern.zeros(),
            jacobian: structure.constraint_pattern.zeros(),
            force: vec![0.0; structure.sizes.coordinates],
            tau: vec![0.0; structure.sizes.rows],
            manifold: point.manifold.clone(),
        };
        system.mass_matrix(&state.q, &mut out.mass);
        system.constraint_jacobian(&state.q, &mut out.jacobian);
        let mut z_rate = vec![0.0; structure.sizes.extra_states];
        system.forces(state, &mut out.force, &mut z_rate);
        system.acceleration_rhs(state.t, &state.q, &state.v, &mut out.tau);
        out
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

    /// Accelerations and multipliers of a solver, lengths over the characteristic length.
    fn solve(&self, kind: &SolverKind) -> Result<[Vec<f64>; 2], Refusal> {
        let structure = self.system.structure();
        let system = self.system.as_ref();
        let mut solver = kind.prepare(system, &self.state.q, &self.kept)?;
        let mut a = vec![f64::NAN; structure.sizes.coordinates];
        let mut lambda = vec![f64::NAN; structure.sizes.rows];
        let mut solve = |equations: &IndexOneEquations, a: &mut [f64], lambda: &mut [f64]| {
            solver
                .solve(system, equations, a, lambda)
                .unwrap_or_else(|e| panic!("{} by {kind:?}: {}", self.name, e.message));
        };
        // The second solve is the one with frozen pivots, in room that was used.
        for _ in 0..2 {
            solve(&self.equations(), &mut a, &mut lambda);
        }
        if *kind == SolverKind::AugmentedDense {
            // The truth is refined: its own round-off grows with the condition of M, G and Gᵀ together.
            for _ in 0..3 {
                let (mut force, mut tau) = (self.force.clone(), self.tau.clone());
                self.mass.multiply_add(-1.0, &a, &mut force);
                self.jacobian.multiply_transposed_add(-1.0, &lambda, &mut force);
                self.jacobian.multiply_add(-1.0, &a, &mut tau);
                let (mut da, mut dl) = (a.clone(), lambda.clone());
                let left = IndexOneEquations { force: &force, tau: &tau, ..self.equations() };
                solve(&left, &mut da, &mut dl);
                a.iter_mut().zip(&da).for_each(|(a, d)| *a += d);
                lambda.iter_mut().zip(&dl).for_each(|(l, d)| *l += d);
            }
        }
        self.scale(&mut a, &mut lambda);
        Ok([a, lambda])
    }

    /// Accelerations and multipliers as the engine computes them, by a stated way; the way that was taken.
    fn solve_in_engine(
        &self,
        way: Accelerations,
    ) -> Result<(Accelerations, [Vec<f64>; 2]), Refusal> {
        let (mut manifold, mut state) = (self.manifold.clone(), self.state.clone());
        manifold.set_accelerations(way)?;
        for _ in 0..2 {
            state.a.fill(f64::NAN);
            state.lambda.fill(f64::NAN);
            let mut z_rate = state.z.clone();
            let outcome = manifold.accelerate(&mut state, &mut z_rate);
            outcome.unwrap_or_else(|e| panic!("{} by {way:?}: {}", self.name, e.message));
            manifold.multipliers(&mut state);
        }
        self.scale(&mut state.a, &mut state.lambda);
        Ok((manifold.accelerator().way(), [state.a, state.lambda]))
    }

    /// Lengths over the characteristic length.
    fn scale(&self, a: &mut [f64], lambda: &mut [f64]) {
        let structure = self.system.structure();
        let length = self.system.characteristic_length();
        for (i, a) in a.iter_mut().enumerate() {
            if structure.coordinate_measure(i) == Measure::Length {
                *a /= length;
            }
        }
        for (lambda, measure) in lambda.iter_mut().zip(&structure.row_measure) {
            if *measure == Measure::Length {
                *lambda *= length;
            }
        }
    }

    /// The condition of G, translations in characteristic lengths, rows of length one.
    fn condition(&self) -> f64 {
        let structure = self.system.structure();
        let n = structure.sizes.coordinates;
        let dense = self.jacobian.to_dense();
        let mut a = Vec::with_capacity(self.kept.len() * n);
        for &row in &self.kept {
            let mut line = dense[row * n..(row + 1) * n].to_vec();
            for (i, x) in line.iter_mut().enumerate() {
                if structure.coordinate_measure(i) == Measure::Length {
                    *x *= self.system.characteristic_length();
                }
            }
            let norm = line.iter().map(|x| x * x).sum::<f64>().sqrt();
            a.extend(line.iter().map(|x| x / norm));
        }
        let values = singular_values(self.kept.len(), n, &a).unwrap();
        values.first().map_or(1.0, |first| first / values[values.len() - 1])
    }

    /// The condition of B with a diagonal of ones.
    fn reduced_condition(&self) -> f64 {
        let mut matrix = ReducedMatrix::new(self.system.as_ref(), &self.kept).unwrap();
        let (n, begin) = (matrix.n(), matrix.begins());
        let mut b = vec![0.0; n * n];
        matrix.place(|i, j| i <= j, |i, j| (begin[i] * n + begin[j], n));
        matrix.assemble(&self.state.q, &self.jacobian, &mut b);
        let scaled: Vec<f64> = (0..n * n)
            .map(|at| (at / n, at % n))
            .map(|(i, j)| b[i.min(j) * n + i.max(j)] / (b[i * n + i] * b[j * n + j]).sqrt())
            .collect();
        let values = singular_values(n, n, &scaled).unwrap();
        values.first().map_or(1.0, |first| first / values[n - 1])
    }

    /// Sizes of the accelerations that forces alone would give and of the multipliers that would balance
    /// them. Where forces cancel, round-off of every solver is that of these.
    fn sizes_of_terms(&self) -> [f64; 2] {
        let sizes = self.system.structure().sizes;
        let (n, length) = (sizes.per_body, self.system.characteristic_length());
        let mut largest = [0.0f64; 2];
        for (b, force) in self.force.chunks_exact(n).enumerate() {
            let (mass, inertia) = (self.system.mass(b), self.system.least_inertia(b));
            for (k, f) in force.iter().enumerate() {
                let terms = if k < sizes.translations {
                    [f / mass / length, f * length]
                } else {
                    [f / inertia / if n == 7 { 4.0 } else { 1.0 }, *f]
                };
                (0..2).for_each(|i| largest[i] = largest[i].max(terms[i].abs()));
            }
        }
        largest
    }

    /// Every solver gives what the dense augmented one gives, in the engine too.
    #[track_caller]
    fn assert_agreement(&self) {
        let expected = self.solve(&SolverKind::AugmentedDense).unwrap();
        let condition = self.condition();
        for kind in KINDS {
            // The dense factors of the reduced matrix are not refined.
            let plain =
                [SolverKind::ReducedDenseLu, SolverKind::ReducedDenseCholesky].contains(kind);
            let condition = if plain { self.reduced_condition().sqrt() } else { condition };
            let found = self.solve(kind).unwrap();
            self.assert_close(&format!("{kind:?}"), &found, &expected, condition, plain);
        }
        for &(stated, name) in Accelerations::ALL {
            let (way, found) = match self.solve_in_engine(stated) {
                Err(Refusal::Loops) if stated == Accelerations::Recursive => continue,
                outcome => outcome.unwrap(),
            };
            assert!(stated == Accelerations::Auto || way == stated, "{}: {way:?}", self.name);
            self.assert_close(name, &found, &expected, condition, false);
        }
    }

    #[track_caller]
    fn assert_close(
        &self,
        solver: &str,
        found: &[Vec<f64>; 2],
        expected: &[Vec<f64>; 2],
        condition: f64,
        plain: bool,
    ) {
        let squared = 1e-14 * condition * condition;
        let allowed = if plain || condition > 1e4 { squared.max(1e-10) } else { 1e-10 };
        let both = found.iter().zip(expected).zip(self.sizes_of_terms());
        for (what, ((found, expected), terms)) in ["accelerations", "multipliers"].iter().zip(both)
        {
            let size = expected.iter().fold(terms, |m, x| m.max(x.abs()));
            let off = found.iter().zip(expected).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            let relative = off / size.max(f64::MIN_POSITIVE);
            assert!(
                relative <= allowed || off == 0.0,
                "{}: {what} by {solver} differ by {relative:.1e}, condition {condition:.1e}",
                self.name
            );
        }
    }
}

/// Every solver but the one that is the truth here.
const KINDS: &[SolverKind] = &[
    SolverKind::AugmentedSparse,
    SolverKind::AugmentedSparsePivoting,
    SolverKind::ReducedDenseLu,
    SolverKind::ReducedDenseCholesky,
    SolverKind::ReducedEnvelope(Numbering::Given),
    SolverKind::ReducedEnvelope(Numbering::Alternating),
    SolverKind::ReducedEnvelope(Numbering::ReverseCuthillMckee),
    SolverKind::ReducedEnvelope(Numbering::GibbsKing),
    SolverKind::ReducedEnvelope(Numbering::Least),
];

/// The start of a model, evaluated.
fn start(assembled: &Assembled) -> Point {
    let (manifold, state) = (&assembled.manifold(), &assembled.state);
    let ndof = manifold.chart().ndof();
    let (mut p, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
    manifold.independent_state(state, &mut p, &mut rates);
    let mut point = Point::new(manifold.clone(), state);
    point.evaluate(state.t, &p, &rates, &state.z, true).expect("assembled");
    point
}

/// The start of a model and states away from it with random rates; none where it does not assemble.
fn cases(name: &str, model: Model, seed: u64, states: usize) -> Vec<Case> {
    let problem = Problem::new(model);
    let Ok(assembled) = problem.assemble() else { return Vec::new() };
    let system = assembled.manifold().system().clone();
    let chart = assembled.parametrization().clone();
    let mut out = vec![Case::new(name, &start(assembled), &chart)];
    let (mut p, mut rates) = (vec![0.0; chart.ndof], vec![0.0; chart.ndof]);
    assembled.manifold().independent_state(&assembled.state, &mut p, &mut rates);
    let mut random = Random::new(seed);
    for k in 0..states {
        let mut point = Point::new(assembled.manifold(), &assembled.state);
        let length = system.characteristic_length();
        let scale = |i: usize| match chart.measure(system.as_ref(), i) {
            Measure::Length => length,
            Measure::Angle => 1.0,
        };
        let reach = [0.0, 0.1, 0.02, 0.004][k % 4];
        let there: Vec<f64> = p
            .iter()
            .enumerate()
            .map(|(i, p)| p + reach * scale(i) * random.range(-1.0, 1.0))
            .collect();
        let speed: Vec<f64> =
            (0..chart.ndof).map(|i| 3.0 * scale(i) * random.range(-1.0, 1.0)).collect();
        let t = assembled.state.t;
        // A loop may not reach as far.
        if point.evaluate(t, &there, &speed, &assembled.state.z, true).is_ok() {
            out.push(Case::new(&format!("{name}, state {k}"), &point, &chart));
        }
    }
    out
}

#[test]
fn every_solver_agrees_on_the_library() {
    for name in
        ["andrews", "chain50", "double_pendulum", "slider_crank", "spatial_four_bar", "hmmwv14"]
    {
        let cases = cases(name, model(name), 7, 4);
        assert!(cases.len() >= 3, "{name}: {} states", cases.len());
        cases.iter().for_each(Case::assert_agreement);
    }
}

#[test] // redundant rows, drivers, an axis that turns, telescopes
fn every_solver_agrees_on_redundant_and_driven_models() {
    for (name, text) in [
        ("platform", crate::common::PLATFORM),
        ("driven pendulum", crate::common::DRIVEN_PENDULUM),
        ("driven telescope", crate::common::DRIVEN_TELESCOPE),
        ("spatial slider-crank", crate::common::SPATIAL_SLIDER_CRANK),
    ] {
        for case in cases(name, model_of(text), 11, 3) {
            case.assert_agreement();
        }
    }
}

#[test] // every joint and driver, masses and stiffnesses over decades
fn every_solver_agrees_on_random_mechanisms() {
    let mut count = 0;
    for seed in 0..if cfg!(feature = "long") { 2000 } else { 150 } {
        let text = Mechanism::new(seed, 0.0).text();
        for case in cases(&format!("seed {seed}"), model_of(&text), seed, 2) {
            case.assert_agreement();
            count += 1;
        }
    }
    assert!(count > 250, "{count} states");
}

/// Accelerations and multipliers of a manifold that takes them from there, at (v, v̇) = (`p`, `rates`).
fn along(assembled: &Assembled, way: Accelerations, p: &[f64], rates: &[f64]) -> Option<Point> {
    let mut point = Point::new(assembled.manifold(), &assembled.state);
    point.manifold.set_accelerations(way).ok()?;
    point.evaluate(assembled.state.t, p, rates, &assembled.state.z, true).ok()?;
    point.complete();
    let accelerator = point.manifold.accelerator();
    assert_eq!((accelerator.way(), accelerator.fallbacks()), (way, 0));
    Some(point)
}

#[test] // independent truth: the augmented system, which knows no tree
fn articulated_bodies_agree_on_trees() {
    let named = ["double_pendulum", "chain50", "simple_pendulum"].map(|name| (name, model(name)));
    let random = (0..400).map(|seed| ("random", model_of(&Mechanism::new(seed, 0.0).text())));
    let mut trees = 0;
    for (seed, (name, model)) in named.into_iter().chain(random).enumerate() {
        let problem = Problem::new(model);
        let Ok(assembled) = problem.assemble() else { continue };
        let ndof = assembled.parametrization().ndof;
        let (mut p, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
        assembled.manifold().independent_state(&assembled.state, &mut p, &mut rates);
        let mut random = Random::new(seed as u64);
        rates.iter_mut().for_each(|x| *x += 3.0 * random.range(-1.0, 1.0));
        let Some(found) = along(assembled, Accelerations::Recursive, &p, &rates) else { continue };
        let truth = along(assembled, Accelerations::Augmented, &p, &rates).unwrap();
        let chart = assembled.parametrization();
        let [of_a, of_lambda] = Case::new(name, &truth, chart).sizes_of_terms();
        let (found, truth) = (found.state, truth.state);
        for (what, found, truth, terms) in [
            ("accelerations", &found.a, &truth.a, of_a),
            ("multipliers", &found.lambda, &truth.lambda, of_lambda),
        ] {
            let size = truth.iter().fold(terms, |m, x| m.max(x.abs()));
            let off = found.iter().zip(truth).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
            assert!(off <= 1e-10 * size, "{name} {seed}: {what} differ by {:.1e}", off / size);
        }
        trees += 1;
    }
    assert!(trees > 60, "{trees} trees");
}

/// Bodies in a random tree of joints and so many joints more that close loops, all in one design
/// configuration.
fn with_loops(seed: u64, loops: usize) -> String {
    let mut random = Random::new(seed);
    let r = &mut random;
    let planar = r.chance(0.5);
    let bodies = 3 + loops + r.below(4);
    let vector = |v: [f64; 3]| {
        if planar {
            format!("[{}, {}]", v[0], v[1])
        } else {
            format!("[{}, {}, {}]", v[0], v[1], v[2])
        }
    };
    let place = |r: &mut Random| [0; 3].map(|_| r.range(-1.0, 1.0));
    let centers: Vec<[f64; 3]> = (0..bodies).map(|_| place(r)).collect();
    let name = |body: Option<usize>| body.map_or("ground".to_owned(), |b| format!("b{b}"));
    let mut text = format!(
        "holonom = 1\ndimension = \"{}\"\ngravity = {}\n[bodies]\n",
        if planar { "planar" } else { "spatial" },
        vector(if planar { [0.0, -9.81, 0.0] } else { [0.0, 0.0, -9.81] })
    );
    for (b, center) in centers.iter().enumerate() {
        let mass = r.logarithmic(0.1, 10.0);
        let j = mass * r.logarithmic(0.01, 0.1);
        let inertia = if planar {
            format!("{j}")
        } else {
            format!(
                "[[{}, {}, 0.0], [{}, {j}, 0.0], [0.0, 0.0, {}]]",
                1.2 * j,
                0.1 * j,
                0.1 * j,
                0.9 * j
            )
        };
        let at = vector(*center);
        writeln!(text, "b{b} = {{ mass = {mass}, inertia = {inertia}, position = {at} }}").unwrap();
    }
    text.push_str("[joints]\n");
    let mut joint = |r: &mut Random, name: String, between: [String; 2], closes: bool| {
        let [first, second] = between;
        let head = format!("{name} = {{ between = [\"{first}\", \"{second}\"], type = ");
        let point = vector(place(r));
        let axis = vector(r.unit(planar));
        let line = if closes && r.chance(if planar { 0.8 } else { 0.6 }) {
            let other = vector(place(r));
            format!("{head}\"distance\", points = [{point}, {other}] }}")
        } else if !planar && (closes || r.chance(0.5)) {
            format!("{head}\"spherical\", point = {point} }}")
        } else if planar && r.chance(0.8) {
            format!("{head}\"revolute\", point = {point} }}")
        } else {
            let kind = if r.chance(0.7) && !planar { "revolute" } else { "translational" };
            format!("{head}\"{kind}\", point = {point}, axis = {axis} }}")
        };
        writeln!(text, "{line}").unwrap();
    };
    for b in 0..bodies {
        let parent = if b == 0 || r.chance(0.2) { None } else { Some(r.below(b)) };
        joint(r, format!("tree{b}"), [name(parent), name(Some(b))], false);
    }
    for k in 0..loops {
        let second = r.below(bodies);
        let first = Some(r.below(bodies)).filter(|&b| b != second && r.chance(0.8));
        joint(r, format!("loop{k}"), [name(first), name(Some(second))], true);
    }
    text
}

#[test]
fn every_solver_agrees_with_no_loop_to_ten() {
    let mut count = 0;
    for loops in 0..=10 {
        for seed in 0..46 {
            let seed = 100 * loops as u64 + seed;
            let model = model_of(&with_loops(seed, loops));
            let cases = cases(&format!("{loops} loops, seed {seed}"), model, seed, 1);
            count += usize::from(!cases.is_empty());
            cases.iter().for_each(Case::assert_agreement);
        }
    }
    assert!(count >= 500, "{count} mechanisms");
}

#[test] // independent truth: the publication
fn andrews_has_its_published_accelerations() {
    let case = &cases("andrews", model("andrews"), 1, 0)[0];
    for kind in KINDS {
        let [a, _] = case.solve(kind).unwrap();
        let (crank, coupler) = (14222.4439199541, 14222.4439199541 - 10666.8329399656);
        assert!((a[2] / crank - 1.0).abs() < 1e-11, "{kind:?}: {}", a[2]);
        assert!((a[5] / coupler - 1.0).abs() < 1e-11, "{kind:?}: {}", a[5]);
    }
}

#[test] // independent truth: the matrix by dense products in the plane
fn the_blocks_are_those_of_the_product() {
    let case = &cases("andrews", model("andrews"), 3, 1)[1];
    let n = case.state.q.len();
    let (g, m) = (case.jacobian.to_dense(), case.mass.to_dense());
    let mut matrix = ReducedMatrix::new(case.system.as_ref(), &case.kept).unwrap();
    let (rows, begin) = (matrix.n(), matrix.begins());
    let mut b = vec![0.0; rows * rows];
    matrix.place(|i, j| i <= j, |i, j| (begin[i] * rows + begin[j], rows));
    matrix.assemble(&case.state.q, &case.jacobian, &mut b);
    for r in 0..rows {
        for c in r..rows {
            let (i, j) = (matrix.row(r) * n, matrix.row(c) * n);
            let expected: f64 = (0..n).map(|k| g[i + k] * g[j + k] / m[k * n + k]).sum();
            assert!((b[r * rows + c] - expected).abs() <= 1e-13 * expected.abs(), "({r}, {c})");
        }
    }
}

#[test] // by hand: 49 blocks in a row, and the numbers 1, 50, 2, 49, …
fn the_chain_is_a_matrix_of_three_diagonals() {
    let case = &cases("chain50", model("chain50"), 1, 0)[0];
    let matrix = ReducedMatrix::new(case.system.as_ref(), &case.kept).unwrap();
    assert_eq!((matrix.graph().len(), matrix.graph().edges()), (50, 49));
    for (numbering, envelope, operations) in [
        (Numbering::Given, 49, 98),
        (Numbering::Least, 49, 98),
        (Numbering::Alternating, 625, 6150),
    ] {
        let solver = ReducedEnvelope::new(matrix.clone(), &numbering);
        assert_eq!((solver.plan().envelope(), solver.plan().operations()), (envelope, operations));
    }
}

#[test]
fn a_body_without_mass_or_inertia_is_refused_at_set_up() {
    let pendulum = |mass: f64, inertia: &str, dimension: &str, zero: &str, joint: &str| {
        model_of(&format!(
            "holonom = 1\ndimension = \"{dimension}\"\n[bodies]\n\
             a = {{ mass = 1.0, inertia = {inertia}, position = [1.0, 0.0{zero}] }}\n\
             b = {{ mass = {mass}, inertia = {inertia}, position = [2.0, 0.0{zero}] }}\n[joints]\n\
             p = {{ type = \"{joint}\", between = [\"ground\", \"a\"], point = [0.0, 0.0{zero}] }}\n\
             r = {{ type = \"{joint}\", between = [\"a\", \"b\"], point = [1.5, 0.0{zero}] }}\n"
        ))
    };
    let rod = "[[0.0, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]";
    for (model, body) in [
        (pendulum(0.0, "0.1", "planar", "", "revolute"), 1),
        (pendulum(1.0, "0.0", "planar", "", "revolute"), 0),
        (pendulum(1.0, rod, "spatial", ", 0.0", "spherical"), 0),
    ] {
        let problem = Problem::new(model);
        let system = holonom::system::compile(problem.model());
        let kept: Vec<usize> = (0..system.structure().sizes.rows).collect();
        assert_eq!(
            ReducedMatrix::new(system.as_ref(), &kept).unwrap_err(),
            Refusal::Massless { body }
        );
        let q = vec![0.5; system.structure().sizes.coordinates];
        for kind in KINDS {
            let augmented =
                [SolverKind::AugmentedSparse, SolverKind::AugmentedSparsePivoting].contains(kind);
            let solver = kind.prepare(system.as_ref(), &q, &kept);
            assert_eq!(solver.is_ok(), augmented, "{kind:?}");
        }
    }
}

#[test] // else a wrong acceleration would be silent
fn dependent_rows_are_refused_with_their_name() {
    let case = &cases("platform", model_of(crate::common::PLATFORM), 1, 0)[0];
    let all: Vec<usize> = (0..case.system.structure().sizes.rows).collect();
    assert!(all.len() > case.kept.len());
    let kind = SolverKind::ReducedEnvelope(Numbering::Least);
    let mut solver = kind.prepare(case.system.as_ref(), &case.state.q, &all).unwrap();
    let (mut a, mut lambda) = (case.state.q.clone(), vec![0.0; all.len()]);
    let failure =
        solver.solve(case.system.as_ref(), &case.equations(), &mut a, &mut lambda).unwrap_err();
    assert_eq!(failure.code, "simulation/singular-configuration");
    assert!(failure.row.is_some() && failure.message.contains("joint `"), "{}", failure.message);
}
