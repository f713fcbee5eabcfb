//! The simplified matrix leaves out how joints turn: what it solves, how fast that converges, and when the full one takes over.

use crate::common::{model, model_of, options, run_model};
use holonom::method::ode::{LinearizedOde, Ode};
use holonom::method::{CODES, Code, FirstOrder, Weights};
use holonom::model::{Model, Tolerance};
use holonom::newton::{
    Chosen, Complex64, JacobianSource, MatrixOptions, ReducedBlocks, ReducedMatrix, Representation,
};
use holonom::reduction::{Coordinates, Manifold};
use holonom::simulation::{Memory, Options, Problem, RunError, Status, Summary, run};
use holonom::system::State;
use holonom::threads::Threads;
use holonom_linalg::DenseLu;
use std::fmt::Write as _;

/// A mechanism at its start, with the simplified matrix.
struct Case {
    manifold: Manifold,
    state: State,
    form: FirstOrder<Chosen<ReducedMatrix>>,
    w: Vec<f64>,
}

impl Case {
    /// Linearized at a state; none without degrees of freedom.
    fn new(problem: &Problem, mut manifold: Manifold, state: State) -> Option<Self> {
        if manifold.chart().ndof() == 0 {
            return None;
        }
        let weights = Weights::new(Tolerance::uniform(1e-4), problem.system().as_ref(), &state);
        let mut form = FirstOrder::with_matrix(manifold.clone(), weights, &state);
        form.set_matrix(MatrixOptions {
            representation: Representation::Simplified,
            ..MatrixOptions::default()
        });
        let mut w = vec![0.0; form.dimension()];
        form.pack(&state, &mut w);
        form.simplify(true);
        form.linearize(state.t, &w).ok()?;
        assert!(form.is_simplified());
        manifold.go_back(&state.q);
        manifold.evaluate_mass(&state.q);
        Some(Self { manifold, state, form, w })
    }
}

/// Random mechanisms that can be assembled.
fn cases() -> impl Iterator<Item = (u64, Case)> {
    (0..150).filter_map(|seed| {
        let problem = Problem::new(model_of(&crate::random::Mechanism::new(seed, 0.0).text()));
        let assembled = problem.assemble().ok()?;
        let (manifold, state) = (assembled.manifold(), assembled.state.clone());
        Some((seed, Case::new(&problem, manifold, state)?))
    })
}

/// y = A x of a matrix by rows.
fn product(a: &[f64], x: &[f64]) -> Vec<f64> {
    a.chunks_exact(x.len()).map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum()).collect()
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// Largest difference against the largest entry of `a`.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs())) / largest(a).max(1e-300)
}

/// DᵀAD for D by rows.
fn reduced(d: &[f64], ndof: usize, a: &holonom_linalg::BlockMatrix) -> Vec<f64> {
    let mut x = vec![0.0; d.len()];
    a.multiply_many_add(1.0, d, ndof, &mut x);
    let mut out = vec![0.0; ndof * ndof];
    for (d, x) in d.chunks_exact(ndof).zip(x.chunks_exact(ndof)) {
        for (row, d) in out.chunks_exact_mut(ndof).zip(d) {
            row.iter_mut().zip(x).for_each(|(out, x)| *out += d * x);
        }
    }
    out
}

#[test] // independent truth: M̂ + γh DᵀCD + γ²h² DᵀKD, made and factored as dense matrices
fn it_solves_the_equations_that_it_stands_for() {
    let mut solved = 0;
    for (seed, Case { mut manifold, state, mut form, w }) in cases() {
        if !state.z.is_empty() {
            continue;
        }
        let n = manifold.chart().ndof();
        let mut blocks = ReducedBlocks::new(&manifold, &Threads::default());
        blocks.evaluate(&mut manifold, &state);
        let c = reduced(&blocks.d, n, &blocks.blocks.damping);
        let k = reduced(&blocks.d, n, &blocks.blocks.stiffness);
        let vector = |shift: usize| -> Vec<f64> {
            (0..2 * n).map(|i| ((i * i + shift) as f64).sin()).collect()
        };
        let (x, y) = (vector(1), vector(2));
        for gh in [1e-5, 1e-3, 0.1] {
            let complex = Complex64::new(gh, 0.7 * gh);
            if form.factor(gh).is_err() || form.factor_complex(complex).is_err() {
                continue;
            }
            // As a real system of twice the order; b = M̂ r_v − γh DᵀKD r_p, with M̂ r_v given.
            for gh in [Complex64::new(gh, 0.0), complex] {
                let gh2 = gh * gh;
                let mut a = vec![0.0; 4 * n * n];
                let mut b = vec![0.0; 2 * n];
                let (kx, ky) = (product(&k, &x[..n]), product(&k, &y[..n]));
                for i in 0..n {
                    let right =
                        Complex64::new(x[n + i], y[n + i]) - gh * Complex64::new(kx[i], ky[i]);
                    (b[i], b[n + i]) = (right.re, right.im);
                    for j in 0..n {
                        let at = i * n + j;
                        let entry = blocks.mass[at] + gh * c[at] + gh2 * k[at];
                        a[2 * i * n + j] = entry.re;
                        a[2 * (n + i) * n + n + j] = entry.re;
                        a[2 * i * n + n + j] = -entry.im;
                        a[2 * (n + i) * n + j] = entry.im;
                    }
                }
                let mut lu = DenseLu::new(2 * n);
                if lu.factor(&a).is_err() {
                    continue;
                }
                lu.solve(&mut b);
                let (mut re, mut im) = (x.clone(), y.clone());
                if gh.im == 0.0 {
                    form.solve_defect(&mut re);
                    form.solve_defect(&mut im);
                } else {
                    form.solve_complex_defect(&mut re, &mut im);
                }
                let mut expected = [x.clone(), y.clone()];
                for i in 0..n {
                    let p = Complex64::new(x[i], y[i]) + gh * Complex64::new(b[i], b[n + i]);
                    (expected[0][i], expected[1][i]) = (p.re, p.im);
                    (expected[0][n + i], expected[1][n + i]) = (b[i], b[n + i]);
                }
                let error = difference(&expected.concat(), &[re, im].concat());
                assert!(error < 1e-6, "seed {seed}, γh {gh}: {error:.1e}");
                solved += 1;
            }
        }
        assert_eq!(w.len(), 2 * n);
    }
    assert!(solved > 300, "{solved}");
}

#[test] // independent truth: I − γhJ with the dense J of the same state
fn its_corrections_and_filters_lead_to_those_of_the_jacobian() {
    let (mut solved, mut with_extra_states, mut filtered) = (0, 0, 0);
    for (seed, Case { mut manifold, state, mut form, w }) in cases() {
        let (n, ndof) = (w.len(), manifold.chart().ndof());
        let mut blocks = ReducedBlocks::new(&manifold, &Threads::default());
        blocks.evaluate(&mut manifold, &state);
        let Ok(jacobian) = blocks.jacobian() else { continue };
        for gh in [1e-5, 1e-3] {
            let mut a: Vec<f64> = jacobian.iter().map(|x| -gh * x).collect();
            (0..n).for_each(|i| a[i * n + i] += 1.0);
            let mut lu = DenseLu::new(n);
            if lu.factor(&a).is_err() || form.factor(gh).is_err() {
                continue;
            }
            let right: Vec<f64> = (0..n).map(|i| ((i * i + 1) as f64).sin()).collect();
            let mut expected = right.clone();
            lu.solve(&mut expected);
            // x ← x + (I − γhJ')⁻¹ (r − (I − γhJ) x).
            let mut x = vec![0.0; n];
            let mut errors = Vec::new();
            for _ in 0..12 {
                let mut defect: Vec<f64> =
                    right.iter().zip(product(&a, &x)).map(|(r, ax)| r - ax).collect();
                let forces = product(&blocks.mass, &defect[ndof..2 * ndof]);
                defect[ndof..2 * ndof].copy_from_slice(&forces);
                form.solve_defect(&mut defect);
                x.iter_mut().zip(&defect).for_each(|(x, d)| *x += d);
                errors.push(difference(&expected, &x));
            }
            let told = format!("seed {seed}, γh {gh}: {errors:?}");
            // Not where what is left out is too much, as it may be at a start that is none of a motion.
            if errors[3] < 0.1 * errors[0] || errors[0] < 1e-6 {
                assert!(errors[11] < 1e-5, "{told}");
                solved += 1;
                with_extra_states += usize::from(!state.z.is_empty());
            }
            let mut filtered_error = right.clone();
            form.solve(&mut filtered_error);
            if errors[0] < 0.1 {
                let error = difference(&expected, &filtered_error);
                assert!(error < 0.3 * errors[0] + 1e-6, "{told}, filtered {error:.1e}");
                filtered += 1;
            }
        }
    }
    assert!(
        solved > 180 && with_extra_states > 20 && filtered > 150,
        "{solved}, {with_extra_states}, {filtered}"
    );
}

/// Links that hang on each other, the angles ±`bend` by turns, at rest.
fn chain_text(links: usize, [length, mass]: [f64; 2], bend: f64) -> String {
    let mut text = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n".to_owned();
    let inertia = mass * length * length / 12.0;
    let mut hinge = [0.0, 0.0];
    for i in 1..=links {
        let before = if i == 1 { "ground".to_owned() } else { format!("link_{}", i - 1) };
        let end = if i == 1 { 0.0 } else { 0.5 * length };
        let angle = if i % 2 == 1 { bend } else { -bend };
        let [x, y] = [angle.cos(), angle.sin()].map(|part| 0.5 * length * part);
        writeln!(
            text,
            "bodies.link_{i} = {{ mass = {mass:?}, inertia = {inertia:?}, \
             position = [{:?}, {:?}], angle = {angle:?} }}\n\
             joints.joint_{i} = {{ type = \"revolute\", between = [\"{before}\", \"link_{i}\"], \
             points_in_body = [[{end:?}, 0.0], [{:?}, 0.0]] }}",
            hinge[0] + x,
            hinge[1] + y,
            -0.5 * length,
        )
        .unwrap();
        hinge = [hinge[0] + 2.0 * x, hinge[1] + 2.0 * y];
    }
    text
}

fn with(model: &Model, newton: Representation, options: Options) -> Summary {
    run_model(model, &Options { newton, coordinates: Coordinates::Cartesian, ..options }).summary
}

#[test] // where steps follow the motion, what is left out slows iterations little
fn iterations_on_a_free_chain_contract_below_a_tenth() {
    let chain = model_of(&chain_text(20, [1.0, 1.0], 0.0));
    for tolerance in [1e-3, 1e-4, 1e-5] {
        let options = options(Code::ForSdirk16, tolerance, 2.0);
        let [simplified, sparse] = [Representation::Simplified, Representation::Sparse]
            .map(|newton| with(&chain, newton, options.clone()).statistics);
        let told = simplified.contractions;
        assert!(told.count > 100 && told.mean() < 0.1, "{tolerance:e}: {told:?}");
        assert!(simplified.simplified_factorizations * 10 > 9 * simplified.factorizations);
        assert_eq!(sparse.simplified_factorizations + sparse.changes_to_full, 0);
    }
}

/// Links of 0.5 kg and 0.2 m at rest, between whose first two a motor of 200 N m begins to turn.
fn jump(links: usize, bend: f64) -> Model {
    let mut text = chain_text(links, [0.2, 0.5], bend);
    let motor = "type = \"torque\", between = [\"link_1\", \"link_2\"], torque = 200.0";
    writeln!(text, "forces.motor = {{ {motor} }}").unwrap();
    model_of(&text)
}

#[test] // independent truth: the growth of a vector by 1 − (I − γhJ')⁻¹(I − γhJ), with the dense J
fn after_a_load_jump_what_is_left_out_is_too_much() {
    let problem = Problem::new(jump(2, 0.2));
    let assembled = problem.assemble().unwrap();
    let Case { mut manifold, state, mut form, w } =
        Case::new(&problem, assembled.manifold(), assembled.state.clone()).unwrap();
    let (n, ndof) = (w.len(), manifold.chart().ndof());
    let mut blocks = ReducedBlocks::new(&manifold, &Threads::default());
    blocks.evaluate(&mut manifold, &state);
    let jacobian = blocks.jacobian().unwrap();
    let growth = [0.002, 0.01, 0.02].map(|h| {
        let gh = 0.25 * h;
        let mut a: Vec<f64> = jacobian.iter().map(|x| -gh * x).collect();
        (0..n).for_each(|i| a[i * n + i] += 1.0);
        form.factor(gh).unwrap();
        let mut x: Vec<f64> = (0..n).map(|i| ((i * i + 1) as f64).sin()).collect();
        let mut growth = 0.0;
        for power in 0..80 {
            let mut defect = product(&a, &x);
            let forces = product(&blocks.mass, &defect[ndof..2 * ndof]);
            defect[ndof..2 * ndof].copy_from_slice(&forces);
            form.solve_defect(&mut defect);
            x.iter_mut().zip(&defect).for_each(|(x, d)| *x -= d);
            let size = largest(&x);
            x.iter_mut().for_each(|x| *x /= size);
            growth += if power >= 40 { size.ln() / 40.0 } else { 0.0 };
        }
        growth.exp()
    });
    assert!(growth[0] < 0.02 && growth[1] > 0.3 && growth[2] > 1.0, "{growth:?}");
}

#[test] // independent truth: the same steps with the full matrix alone
fn after_a_load_jump_the_full_matrix_takes_over() {
    for (links, code, h) in [
        (2, Code::ForSdirk16, 3e-3),
        (3, Code::ForSdirk16, 3e-3),
        (3, Code::SspSdirk16, 2e-3),
        (6, Code::ForRadau, 2e-3),
    ] {
        let options = Options { fixed_step: Some(h), ..options(code, 1e-4, 3.0 * h) };
        let [simplified, sparse] = [Representation::Simplified, Representation::Sparse]
            .map(|newton| with(&jump(links, 0.0), newton, options.clone()));
        let told = format!("{links} links, {code:?}: {:?}", simplified.statistics);
        assert_eq!(simplified.status, Status::Completed, "{told}");
        let s = simplified.statistics;
        let full = s.factorizations - s.simplified_factorizations;
        assert!(s.changes_to_full > 0 && full > 0 && s.simplified_factorizations > 0, "{told}");
        assert!(difference(&sparse.end.q, &simplified.end.q) < 1e-9, "{told}");
        assert!(difference(&sparse.end.v, &simplified.end.v) < 1e-9, "{told}");
    }
    // Steps that follow the motion are as many.
    let options = options(Code::ForRadau, 1e-3, 0.05);
    let [simplified, sparse] = [Representation::Simplified, Representation::Sparse]
        .map(|newton| with(&jump(6, 0.5), newton, options.clone()).statistics);
    assert!(simplified.changes_to_full > 0, "{simplified:?}");
    assert!(simplified.steps * 10 <= 11 * sparse.steps, "{simplified:?}, {sparse:?}");
}

/// Models of the library, the last one alone without loops, with a time and a step that they can take.
const MODELS: [(&str, f64, f64); 6] = [
    ("slider_crank", 1.0, 1e-3),
    ("spatial_four_bar", 2.0, 1e-2),
    ("andrews", 0.02, 1e-4),
    ("hmmwv14", 1.0, 2e-3),
    ("hmmwv14_bushing", 0.2, 1e-3),
    ("stiff_slider", 1.0, 1e-2),
];

/// Codes whose matrix may be simplified.
fn iterated() -> impl Iterator<Item = Code> {
    CODES.iter().map(|info| info.code).filter(|code| !code.needs_full_jacobian())
}

#[test] // independent truth: the dense matrix at the same steps, with iterations to round-off
fn iterations_lead_to_the_same_end() {
    for (name, _, h) in MODELS {
        let model = model(name);
        for code in iterated() {
            let options = Options { fixed_step: Some(h), ..options(code, 1e-4, 10.0 * h) };
            let [dense, simplified] = [Representation::Dense, Representation::Simplified]
                .map(|newton| with(&model, newton, options.clone()));
            assert_eq!((dense.status, simplified.status), (Status::Completed, Status::Completed));
            assert!(simplified.statistics.simplified_factorizations > 0, "{name}, {code:?}");
            for (a, b) in [(&dense.end.q, &simplified.end.q), (&dense.end.v, &simplified.end.v)] {
                let error = difference(a, b);
                assert!(error < 1e-9, "{name}, {code:?}: {error:.1e}");
            }
        }
    }
}

#[test] // independent truth: a run at a hundredth of the tolerance with the dense matrix
fn results_are_as_far_off_as_with_the_dense_matrix() {
    // Without loops iterations contract worse; only who states it has the simplified matrix there.
    for &(name, end, _) in &MODELS[..5] {
        let model = model(name);
        for code in iterated() {
            let tolerance = if matches!(code, Code::SspTrap) { 1e-3 } else { 1e-4 };
            let run =
                |newton, part: f64| with(&model, newton, options(code, part * tolerance, end));
            let truth = run(Representation::Dense, 0.01).end.q;
            let [dense, simplified] =
                [Representation::Dense, Representation::Simplified].map(|newton| run(newton, 1.0));
            let off = |end: &[f64]| {
                let errors = truth.iter().zip(end).map(|(a, b)| (a - b).abs());
                errors.fold(0.0, f64::max) / largest(&truth).max(1.0) / tolerance
            };
            let (a, b) = (off(&dense.end.q), off(&simplified.end.q));
            let (s, d) = (simplified.statistics, dense.statistics);
            let told = format!("{name}, {code:?}: {a:.2} and {b:.2} tolerances off, {d:?}, {s:?}");
            assert!(b < 1.5 * a + 0.1, "{told}");
            assert!(s.steps.abs_diff(d.steps) * 20 <= d.steps.max(20), "{told}");
            assert!(s.contractions.mean() < 0.1, "{told}");
        }
    }
}

#[test]
fn what_needs_the_full_jacobian_refuses_it() {
    let problem = Problem::new(model("slider_crank"));
    for info in CODES {
        let options =
            Options { newton: Representation::Simplified, ..options(info.code, 1e-3, 0.01) };
        let outcome = run(&problem, &options, None, &mut Memory::default());
        // Explicit codes have no matrix that this could be said of.
        if info.code == Code::ForRosen || info.family == "descriptor" {
            let error = outcome.unwrap_err();
            assert_eq!(error, RunError::SimplifiedJacobian { code: info.name });
        } else {
            assert!(outcome.is_ok(), "{}", info.name);
        }
    }
    for newton in [Representation::Simplified, Representation::Sparse] {
        let jacobian = JacobianSource::Differences;
        let options = Options { newton, jacobian, ..options(Code::ForRadau, 1e-3, 0.01) };
        let error = run(&problem, &options, None, &mut Memory::default()).unwrap_err();
        assert_eq!(error, RunError::SparseDifferences { newton: newton.name() });
    }
}
