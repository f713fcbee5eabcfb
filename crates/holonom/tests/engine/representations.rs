//! Two representations of one matrix: the sparse one gives what the dense reduced one gives.

use crate::common::model_of;
use holonom::method::ode::{LinearizedOde, Ode};
use holonom::method::{CODES, Code, FirstOrder, Weights};
use holonom::model::Tolerance;
use holonom::newton::{Chosen, Complex64, MatrixOptions, ReducedMatrix, Representation};
use holonom::reduction::{Coordinates, ParametrizationKind};
use holonom::simulation::{Options, Problem};
use std::fmt::Write as _;

fn implicit() -> impl Iterator<Item = Code> {
    CODES.iter().filter(|info| !info.code.is_explicit()).map(|info| info.code)
}

/// What two representations may differ by at tolerance 1e-4, against the largest entry of a state. Round-off does as much
/// after some thousand steps, when it decides upon an iteration more or less: the tolerance changed in its last digit, with the
/// dense matrix, moves the vehicle with bushings by 1e-9 after 0.5 s and by 3e-7 after 4 s.
const SAME: f64 = 1e-9;
/// The same for codes of second order, and a part of their steps: at most of these one correction is nearly too much, so that
/// somewhere round-off decides upon a second one, and each of those is a ten-thousandth of the tolerance.
const NEARLY_SAME: (f64, u64) = (5e-6, 400);

/// Truth: the same run with the dense matrix. Steps are the same, and results agree.
fn agree(name: &str, end: f64, charts: &[ParametrizationKind]) {
    let model = crate::common::model(name);
    for code in implicit() {
        for &parametrization in charts {
            // The sparse matrix belongs to the Cartesian form.
            let coordinates = Coordinates::Cartesian;
            let run = |newton| {
                let options = Options {
                    newton,
                    parametrization,
                    coordinates,
                    ..crate::common::options(code, 1e-4, end)
                };
                crate::common::run_model(&model, &options).summary
            };
            let (dense, sparse) = (run(Representation::Dense), run(Representation::Sparse));
            let what = format!("{name}, {}, {}", code.info().name, parametrization.name());
            let steps = (dense.statistics.steps, sparse.statistics.steps);
            let low = matches!(code, Code::SspTrap | Code::InflTrap);
            // Where the bump or a stop is what ends steps, one correction more may end one elsewhere.
            let corrected = dense.statistics.iterations != sparse.statistics.iterations;
            let (same, others) = if low {
                (NEARLY_SAME.0, steps.0 / NEARLY_SAME.1)
            } else if corrected && steps.0 != steps.1 {
                (NEARLY_SAME.0, 1)
            } else {
                (SAME, 0)
            };
            assert!(steps.0.abs_diff(steps.1) <= others, "{what}: steps {steps:?}");
            let largest = |x: &[f64]| x.iter().fold(1.0f64, |m, x| m.max(x.abs()));
            for (a, b) in [(&dense.end.q, &sparse.end.q), (&dense.end.v, &sparse.end.v)] {
                let error = a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
                assert!(error <= same * largest(a), "{what}: {error:.1e}, steps {steps:?}");
            }
        }
    }
}

#[test]
fn all_codes_take_the_same_steps_on_the_library() {
    let mut models = Vec::new();
    for (name, end) in [
        ("simple_pendulum", 2.0),
        ("double_pendulum", 1.0),
        ("double_pendulum_w10", 1.0),
        ("double_pendulum_rest", 2.0),
        ("slider_crank", 1.0),
        ("spatial_four_bar", 2.0),
        ("andrews", 0.02),
        ("stiff_slider", 1.0),
        ("chain50", 0.5),
        ("chain50_free", 0.2),
        ("hmmwv14", 1.0),
        ("hmmwv14_bushing", 0.2),
    ] {
        agree(name, end, &[ParametrizationKind::Tree]);
        models.push(name);
    }
    assert!(crate::common::LIBRARY.iter().all(|name| models.contains(name)), "a model is missing");
}

#[test]
fn on_all_charts() {
    for (name, end) in [("slider_crank", 0.1), ("spatial_four_bar", 0.3)] {
        agree(
            name,
            end,
            &ParametrizationKind::ALL.iter().map(|(chart, _)| *chart).collect::<Vec<_>>(),
        );
    }
}

/// Largest difference against the largest entry.
fn difference(a: &[f64], b: &[f64]) -> f64 {
    let size = a.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    let error = a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    if size > 0.0 { error / size } else { error }
}

#[test] // independent truth: the dense matrix at the same state
fn one_solve_agrees_on_random_mechanisms() {
    let (mut solved, mut with_extra_states) = (0, 0);
    for seed in 0..150 {
        let model = model_of(&crate::random::Mechanism::new(seed, 0.0).text());
        let problem = Problem::new(model);
        let Ok(assembled) = problem.assemble() else { continue };
        let (manifold, state) = (assembled.manifold(), &assembled.state);
        let weights = || Weights::new(Tolerance::uniform(1e-4), problem.system().as_ref(), state);
        let mut dense = FirstOrder::new(manifold.clone(), weights(), state);
        let mut sparse =
            FirstOrder::<Chosen<ReducedMatrix>>::with_matrix(manifold, weights(), state);
        sparse.set_matrix(MatrixOptions {
            representation: Representation::Sparse,
            ..MatrixOptions::default()
        });
        let n = dense.dimension();
        if n == state.z.len() {
            continue;
        }
        let mut w = vec![0.0; n];
        dense.pack(state, &mut w);
        let right: Vec<f64> = (0..n).map(|i| ((i * i + 1) as f64).sin()).collect();
        let other: Vec<f64> = (0..n).map(|i| ((i * i + 2) as f64).cos()).collect();
        let solve = |form: &mut dyn LinearizedOde, gamma_h: f64| -> Option<Vec<f64>> {
            let (mut g_t, mut x) = (vec![0.0; n], right.clone());
            form.linearize(state.t, &w).ok()?;
            form.factor(gamma_h).ok()?;
            form.solve(&mut x);
            let (mut re, mut im) = (right.clone(), other.clone());
            form.factor_complex(Complex64::new(gamma_h, 0.7 * gamma_h)).ok()?;
            form.solve_complex(&mut re, &mut im);
            form.time_derivative(&mut g_t).ok()?;
            Some([x, re, im, g_t].concat())
        };
        for gamma_h in [1e-5, 1e-3, 0.1] {
            let pair = (solve(&mut dense, gamma_h), solve(&mut sparse, gamma_h));
            let (Some(a), Some(b)) = pair else { continue };
            solved += 1;
            with_extra_states += usize::from(!state.z.is_empty());
            for (part, (a, b)) in a.chunks_exact(n).zip(b.chunks_exact(n)).enumerate() {
                let error = difference(a, b);
                assert!(error < 1e-6, "seed {seed}, γh {gamma_h}, part {part}: {error:.1e}");
            }
        }
    }
    assert!(solved > 300 && with_extra_states > 30, "{solved}, {with_extra_states}");
}

/// Links of 1 m and 1 kg without springs or dampers that are let go horizontally.
fn free_chain(links: usize) -> String {
    let mut text = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n".to_owned();
    for i in 1..=links {
        let (before, end) =
            if i == 1 { ("ground".to_owned(), 0.0) } else { (format!("link_{}", i - 1), 0.5) };
        writeln!(
            text,
            "bodies.link_{i} = {{ mass = 1.0, inertia = \"=1/12\", position = [{}, 0.0] }}\n\
             joints.joint_{i} = {{ type = \"revolute\", between = [\"{before}\", \"link_{i}\"], \
             points_in_body = [[{end:?}, 0.0], [-0.5, 0.0]] }}",
            i as f64 - 0.5
        )
        .unwrap();
    }
    text
}

#[test] // iterations contract as fast as steps that follow the motion let them, with either matrix
fn iterations_on_a_free_chain_contract_below_a_tenth() {
    let model = model_of(&free_chain(20));
    for tolerance in [1e-3, 1e-4, 1e-5] {
        for newton in [Representation::Dense, Representation::Sparse] {
            let options = Options {
                newton,
                coordinates: Coordinates::Cartesian,
                ..crate::common::options(Code::ForSdirk16, tolerance, 2.0)
            };
            let told = crate::common::run_model(&model, &options).summary.statistics.contractions;
            assert!(told.count > 100 && told.mean() < 0.1, "{tolerance:e}: {told:?}");
        }
    }
}

/// Bodies in a square, each tied to its neighbours by a bushing whose damping is the same in all directions, and one to the
/// ground.
fn plate(side: usize) -> String {
    let mut text = "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, -9.81]\n".to_owned();
    let mut bushing = |first: &str, i: usize, j: usize, [x, y]: [f64; 2]| {
        writeln!(
            text,
            "forces.{first}_to_{i}_{j} = {{ type = \"bushing\", between = [\"{first}\", \"body_{i}_{j}\"], \
             point = [{x:?}, {y:?}, 0.0], \
             stiffness = [1e5, 1e5, 1e5], rotational_stiffness = [1e3, 1e3, 1e3], \
             damping = [1e2, 1e2, 1e2], rotational_damping = [1.0, 1.0, 1.0] }}"
        )
        .unwrap();
    };
    bushing("ground", 0, 0, [0.0, -0.5]);
    let places = || (0..side).flat_map(|i| (0..side).map(move |j| (i, j)));
    for (i, j) in places() {
        let [x, y] = [i as f64, j as f64];
        if i > 0 {
            bushing(&format!("body_{}_{j}", i - 1), i, j, [x - 0.5, y]);
        }
        if j > 0 {
            bushing(&format!("body_{i}_{}", j - 1), i, j, [x, y - 0.5]);
        }
    }
    for (i, j) in places() {
        writeln!(
            text,
            "bodies.body_{i}_{j} = {{ mass = 1.0, position = [{i}.0, {j}.0, 0.0], \
             inertia = [[0.1, 0.0, 0.0], [0.0, 0.12, 0.0], [0.0, 0.0, 0.15]] }}"
        )
        .unwrap();
    }
    text
}

#[test] // independent truth: run times; the other matrix takes 1.25 times as long with 4 bodies, 1.35 times with 25
fn plates_of_free_bodies_are_dense_or_sparse_by_their_size() {
    for (side, is_sparse) in [(2, false), (5, true)] {
        let options = Options {
            coordinates: Coordinates::Cartesian,
            ..crate::common::options(Code::ForSdirk16, 1e-3, 0.01)
        };
        let statistics =
            crate::common::run_model(&model_of(&plate(side)), &options).summary.statistics;
        assert_eq!(statistics.simplified_factorizations > 0, is_sparse, "{side}: {statistics:?}");
    }
}

#[test] // independent truth: the dense matrix, which has no pattern, needs one analysis less
fn neither_round_off_nor_an_unloaded_element_is_analysed_anew() {
    let unloaded = "forces.maxwell = { type = \"maxwell\", between = [\"ground\", \"link_3\"], \
        points_in_body = [[1.5, 1.0], [0.5, 0.0]], stiffness = 1e4, damping = 1e2, free_length = 1.0 }";
    for (name, text) in [("plate", plate(2)), ("row", free_chain(3) + unloaded)] {
        let model = model_of(&text);
        let run = |newton| {
            let options = Options {
                newton,
                coordinates: Coordinates::Cartesian,
                ..crate::common::options(Code::ForSdirk16, 1e-4, 0.5)
            };
            crate::common::run_model(&model, &options).summary
        };
        let dense = run(Representation::Dense);
        for newton in [Representation::Simplified, Representation::Sparse] {
            let sparse = run(newton);
            let (one, other) = (dense.statistics, sparse.statistics);
            let told = format!("{name}, {newton:?}: {one:?}, {other:?}");
            // The full matrix of a row is eliminated along its forest, without any.
            let own = u64::from(name == "plate" || newton == Representation::Simplified);
            assert_eq!(other.analyses, one.analyses + own, "{told}");
            assert!(difference(&dense.end.q, &sparse.end.q) < 1e-6, "{told}");
        }
    }
}
