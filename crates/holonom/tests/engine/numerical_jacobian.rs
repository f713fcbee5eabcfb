//! The integration Jacobian by differences, against the analytic one.

use crate::common::{RUBBER_MOUNTS, model, model_of, options, run_model};
use holonom::method::ode::{LinearizedOde, Ode};
use holonom::method::{Code, FirstOrder, Weights};
use holonom::model::{Model, Tolerance};
use holonom::newton::{JacobianSource, MatrixOptions, Representation};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, RunError, run};

/// A mass on a Maxwell element beside a spring: one extra state.
const MAXWELL: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
rod = { mass = 2.0, inertia = 0.3, position = [0.5, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
[forces]
creep = { type = "maxwell", between = ["ground", "rod"], points = [[1.0, 1.0], [1.0, 0.0]], stiffness = 4.0e3, damping = 50.0, free_length = 1.0 }
spring = { type = "tsda", between = ["ground", "rod"], points = [[0.2, 1.0], [0.8, 0.0]], stiffness = 900.0, damping = 3.0, free_length = 1.0 }
[initial.bodies]
rod = { angular_velocity = -2.0 }
"#;

fn library() -> Vec<(&'static str, Model)> {
    let mut all: Vec<_> =
        ["double_pendulum_w10", "andrews", "slider_crank"].map(|n| (n, model(n))).into();
    all.push(("maxwell", model_of(MAXWELL)));
    all.push(("rubber", model_of(RUBBER_MOUNTS)));
    all
}

#[test] // independent truth: the derivatives of the equations
fn differences_agree_with_the_analytic_blocks() {
    for (name, model) in library() {
        let problem = Problem::new(model);
        let assembled = problem.assemble().unwrap();
        let system = problem.system().clone();
        let form = |source| {
            let weights = Weights::new(Tolerance::uniform(1e-4), system.as_ref(), &assembled.state);
            let mut form = FirstOrder::new(assembled.manifold(), weights, &assembled.state);
            form.set_matrix(MatrixOptions { source, ..MatrixOptions::default() });
            form.begin_step(&assembled.state);
            let mut w = vec![0.0; form.dimension()];
            let mut g = w.clone();
            form.pack(&assembled.state, &mut w);
            form.derivative(assembled.state.t, &w, &mut g).unwrap();
            form.linearize(assembled.state.t, &w).unwrap();
            form
        };
        let mut analytic = form(JacobianSource::Analytic);
        let mut numeric = form(JacobianSource::Differences);
        let (a, n) = (analytic.newton().blocks().clone(), numeric.newton().blocks().clone());
        for (what, a, n) in [
            ("M̂", &a.mass, &n.mass),
            ("M̂₁", &a.damping, &n.damping),
            ("M̂₂", &a.stiffness, &n.stiffness),
            ("Ẑ", &a.force_extra, &n.force_extra),
            ("ż_v", &a.extra_position, &n.extra_position),
            ("ż_v̇", &a.extra_velocity, &n.extra_velocity),
            ("ż_z", &a.extra_extra.values, &n.extra_extra.values),
        ] {
            // Forward differences of quantities of size 1 leave about √ε.
            let size = a.iter().fold(1e-2f64, |m, x| m.max(x.abs()));
            for (a, n) in a.iter().zip(n) {
                assert!((a - n).abs() < 1e-5 * size, "{name}, {what}: {n:e} instead of {a:e}");
            }
        }
        // The norm's velocities follow from positions by q̇_v in both.
        let change: Vec<f64> = (0..analytic.dimension()).map(|i| 1e-5 * (1.0 + i as f64)).collect();
        let (a, n) = (analytic.norm(&change), numeric.norm(&change));
        assert!((a / n - 1.0).abs() < 1e-5, "{name}: norm {n} instead of {a}");
    }
}

#[test] // independent truth: the run with the analytic Jacobian
fn runs_with_either_jacobian_agree() {
    for (name, model) in library() {
        for code in [Code::ForSdirk, Code::ForRadau] {
            let end = if name == "andrews" { 0.01 } else { 0.5 };
            let tolerance = 1e-6;
            let ends = JacobianSource::ALL.iter().map(|&(jacobian, _)| {
                let options = Options { jacobian, ..options(code, tolerance, end) };
                run_model(&model, &options).summary
            });
            let [analytic, numeric] = &ends.collect::<Vec<_>>()[..] else { unreachable!() };
            for (i, (a, n)) in analytic.end.q.iter().zip(&numeric.end.q).enumerate() {
                let allowed = 300.0 * tolerance * a.abs().max(1.0);
                assert!((a - n).abs() < allowed, "{name}, {code:?}: q{i} {n} instead of {a}");
            }
            let (a, n) = (analytic.statistics, numeric.statistics);
            assert!(
                n.steps < a.steps + a.steps / 4 + 5,
                "{name}, {code:?}: {} for {}",
                n.steps,
                a.steps
            );
        }
    }
}

#[test]
fn rosenbrock_formulas_refuse_an_inexact_jacobian() {
    let options = Options {
        jacobian: JacobianSource::Differences,
        output: OutputTimes::Listed(Vec::new()),
        ..options(Code::ForRosen, 1e-4, 1.0)
    };
    let problem = Problem::new(model("simple_pendulum"));
    let error = run(&problem, &options, None, &mut Memory::default()).unwrap_err();
    assert_eq!(error, RunError::InexactJacobian { code: "ForRosen" });
    assert!(error.to_string().contains("analytic"), "{error}");
}

#[test]
fn differences_are_refused_for_the_sparse_matrix() {
    let sparse = Options {
        jacobian: JacobianSource::Differences,
        newton: Representation::Sparse,
        ..crate::common::options(Code::ForRadau, 1e-4, 0.1)
    };
    let problem = Problem::new(crate::common::model("double_pendulum"));
    let error = run(&problem, &sparse, None, &mut Memory::default()).unwrap_err();
    assert_eq!(error, RunError::SparseDifferences { newton: "sparse" });
}
