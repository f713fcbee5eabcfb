//! Which solver accelerations come from: chosen, stated, refused, and left to the augmented system at run
//! time. Independent truths: statics, the other solvers, a counting allocator.

use crate::common::{model, model_of, options};
use allocation_counter::measure;
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::newton::Representation;
use holonom::reduction::accelerations::{Accelerations, Refusal};
use holonom::reduction::{Manifold, Point};
use holonom::simulation::{Memory, Options, Problem, RunError, Status, run};
use holonom::system::State;
use std::fmt::Write as _;

fn start(problem: &Problem) -> (Manifold, State) {
    let assembled = problem.assemble().expect("assembles");
    let (manifold, state) = (&assembled.manifold(), &assembled.state);
    let ndof = manifold.chart().ndof();
    let (mut p, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
    manifold.independent_state(state, &mut p, &mut rates);
    let mut point = Point::new(manifold.clone(), state);
    point.evaluate(state.t, &p, &rates, &state.z, true).expect("assembled");
    (point.manifold, point.state)
}

fn chosen(model: Model) -> Accelerations {
    Problem::new(model).assemble().expect("assembles").accelerator().way()
}

#[test] // independent truth: the times of benchmarks/accelerations
fn the_fastest_solver_is_chosen() {
    assert_eq!(chosen(model("andrews")), Accelerations::NullSpace);
    assert_eq!(chosen(model("spatial_four_bar")), Accelerations::NullSpace);
    assert_eq!(chosen(model("chain50")), Accelerations::Recursive);
    assert_eq!(chosen(model("hmmwv14")), Accelerations::Reduced);
}

#[test] // independent truth: an implicit run at a hundredth of the tolerance with the augmented system
fn trajectories_are_within_the_tolerance_whatever_way_is_taken() {
    let cases = [
        ("andrews", model("andrews"), 0.005),
        ("chain50", model("chain50"), 0.01),
        ("spatial four-bar", model("spatial_four_bar"), 0.1),
        ("vehicle", model("hmmwv14"), 0.002),
        ("platform, redundant", model_of(crate::common::PLATFORM), 0.1),
        ("driven telescope", model_of(crate::common::DRIVEN_TELESCOPE), 0.1),
    ];
    let tolerance = 1e-7;
    for (name, model, end) in cases {
        let problem = Problem::new(model);
        let run = |code: Code, tolerance: f64, accelerations: Accelerations| {
            let options = Options { accelerations, ..options(code, tolerance, end) };
            let summary = match run(&problem, &options, None, &mut Memory::default()) {
                Err(RunError::Accelerations { stated: "recursive", .. }) => return None,
                outcome => outcome.unwrap_or_else(|e| panic!("{name}: {e}")),
            };
            assert_eq!(summary.status, Status::Completed, "{name}: {}", summary.stop.message);
            Some(summary.end)
        };
        let truth = run(Code::ForRadau, 1e-2 * tolerance, Accelerations::Augmented).unwrap();
        for code in [Code::Deabm, Code::ForSdirk] {
            for (way, _) in Accelerations::ALL {
                let Some(end) = run(code, tolerance, *way) else { continue };
                let off = |a: &[f64], b: &[f64]| {
                    let each = a.iter().zip(b).map(|(a, b)| (a - b).abs() / (1.0 + b.abs()));
                    each.fold(0.0, f64::max)
                };
                let largest = off(&end.q, &truth.q).max(off(&end.v, &truth.v));
                assert!(largest <= tolerance, "{name} by {code:?}, {way:?}: {largest:.1e}");
            }
        }
    }
}

/// A bar on the ground, 2 kg and 1 m from its hinge, with or without a light washer in the hinge that turns
/// freely between the two.
fn bar(washer: &str) -> String {
    let (inner, washer) = if washer.is_empty() {
        ("ground", String::new())
    } else {
        let joint = "type = \"revolute\"\nbetween = [\"ground\", \"washer\"]\npoint = [0.0, 0.0]";
        ("washer", format!("[bodies.washer]\n{washer}\n[joints.inner]\n{joint}\n"))
    };
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
{washer}
[bodies.bar]
mass = 2.0
inertia = 0.5
position = [1.0, 0.0]
[joints.hinge]
type = "revolute"
between = ["{inner}", "bar"]
point = [0.0, 0.0]
"#
    )
}

const WASHER: &str = "mass = 1e-6\ninertia = 1e-9\nposition = [0.0, 0.0]";

#[test] // independent truth: the closed form θ̈ = −mgl cos θ/(I + ml²) at θ = 0
fn a_recursion_that_cannot_tell_a_body_is_left_to_the_augmented_system() {
    let problem = Problem::new(model_of(&bar(WASHER)));
    let (mut manifold, state) = start(&problem);
    manifold.set_accelerations(Accelerations::Recursive).expect("a tree");
    let ndof = manifold.chart().ndof();
    let (mut p, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
    manifold.independent_state(&state, &mut p, &mut rates);
    let mut point = Point::new(manifold, &state);
    point.evaluate(0.0, &p, &rates, &[], true).expect("has accelerations");
    assert_eq!(point.manifold.accelerator().way(), Accelerations::Recursive);
    assert!(point.manifold.accelerator().fallbacks() > 0, "the washer was told from nothing");
    let truth = -2.0 * 9.81 / (0.5 + 2.0);
    let bar = &point.state.a[3..6];
    assert!((bar[2] - truth).abs() < 1e-9 * truth.abs(), "{} and {truth}", bar[2]);
    assert!(bar[0].abs() < 1e-9 && (bar[1] - truth).abs() < 1e-9 * truth.abs(), "{bar:?}");
}

#[test] // independent truth: the bar without the washer; for fixed steps the dense matrix, which needs no order
fn an_elimination_that_cannot_tell_a_body_is_left_to_another_order() {
    let end = |text: &str, options: &Options| {
        let problem = Problem::new(model_of(text));
        let summary = run(&problem, options, None, &mut Memory::default()).unwrap();
        assert_eq!(
            summary.status,
            Status::Completed,
            "{:?}: {}",
            options.code,
            summary.stop.message
        );
        let bar = summary.end.q.len() - 3;
        (summary.end.q[bar + 2], summary.end.v[bar + 2])
    };
    let off = |a: (f64, f64), b: (f64, f64)| (a.0 - b.0).abs().max((a.1 - b.1).abs());
    let truth = end(&bar(""), &options(Code::ForRadau, 1e-9, 1.0));
    for code in CODES.iter().filter(|info| !info.code.is_explicit()).map(|info| info.code) {
        let tolerance = 1e-6;
        let with = |newton: Representation, fixed_step: Option<f64>| {
            end(&bar(WASHER), &Options { newton, fixed_step, ..options(code, tolerance, 1.0) })
        };
        for newton in [Representation::Dense, Representation::Sparse] {
            let off = off(with(newton, None), truth);
            assert!(off < tolerance, "{code:?}, {newton:?}: {off:.1e}");
        }
        let fixed = |newton| with(newton, Some(0.01));
        let off = off(fixed(Representation::Sparse), fixed(Representation::Dense));
        assert!(off < 1e-12, "{code:?}, fixed steps: {off:.1e}");
    }
}

/// A body on the ground and one on it, the second without inertia, which nothing needs.
const MASSLESS: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [1.0, 0.0] }
bob = { mass = 1.0, inertia = 0.0, position = [2.0, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }
weld = { type = "revolute", between = ["arm", "bob"], point = [1.5, 0.0] }
"#;

#[test]
fn a_body_without_inertia_leaves_the_reduced_matrix_out() {
    let problem = Problem::new(model_of(MASSLESS));
    let way = problem.assemble().expect("assembles").accelerator().way();
    assert_ne!(way, Accelerations::Reduced);
    let stated = |accelerations| Options { accelerations, ..options(Code::ForSdirk, 1e-6, 0.1) };
    let refused = run(&problem, &stated(Accelerations::Reduced), None, &mut Memory::default());
    let error = refused.expect_err("there is no inverse of M");
    assert!(matches!(error, RunError::Accelerations { .. }), "{error}");
    let message = error.to_string();
    assert!(message.contains("`accelerations` is reduced") && message.contains("body `bob`"));
    let summary = problem.summary(problem.assemble().unwrap()).accelerations;
    assert!(summary.refusal.is_some_and(|reason| reason.contains("body `bob`")));
    for way in [
        Accelerations::Auto,
        Accelerations::Recursive,
        Accelerations::NullSpace,
        Accelerations::Augmented,
    ] {
        let summary = run(&problem, &stated(way), None, &mut Memory::default()).expect("starts");
        assert_eq!(summary.status, Status::Completed, "{way:?}: {}", summary.stop.message);
    }
}

#[test] // independent truth: a counting allocator
fn a_hub_never_fills_the_memory() {
    let spokes = 6000;
    let mut text = "holonom = 1\ndimension = \"planar\"\n[bodies]\n\
        hub = { mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }\n"
        .to_owned();
    let at = |k: usize| (k as f64 * 1e-3).sin_cos();
    for k in 0..spokes {
        let (y, x) = at(k);
        writeln!(text, "s{k} = {{ mass = 0.1, inertia = 0.1, position = [{x}, {y}] }}").unwrap();
    }
    text.push_str("[joints]\n");
    for k in 0..spokes {
        let (y, x) = at(k);
        let head = format!("r{k} = {{ type = \"revolute\", between = [\"hub\", \"s{k}\"]");
        writeln!(text, "{head}, point = [{x}, {y}] }}").unwrap();
    }
    let problem = Problem::new(model_of(&text));
    let (mut manifold, _) = start(&problem);
    assert_ne!(manifold.accelerator().way(), Accelerations::Reduced);
    for stated in [Accelerations::Auto, Accelerations::Reduced] {
        let mut outcome = Ok(());
        let used = measure(|| outcome = manifold.set_accelerations(stated)).bytes_max;
        // The matrix would take 576 MB.
        assert!(used < 10_000_000, "{stated:?}: {used} bytes");
        let refused = stated == Accelerations::Reduced;
        assert_eq!(matches!(outcome, Err(Refusal::Large { .. })), refused);
    }
}

/// Two rods that are parallel but for 2e-8 rad: a condition of 1e8, and of 1e16 of the reduced matrix.
const NEARLY_PARALLEL: &str = r#"
holonom = 1
dimension = "planar"
gravity = [3.0, -9.81]
[bodies]
bob = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
left = { type = "distance", between = ["ground", "bob"], points = [[0.0, 1.0], [0.0, 0.0]] }
right = { type = "distance", between = ["ground", "bob"], points = [[2e-8, 1.0], [0.0, 0.0]] }
"#;

#[test] // independent truth: a point held by two rods does not move, and they carry its load
fn an_ill_conditioned_reduced_matrix_is_left_to_the_augmented_one() {
    let problem = Problem::new(model_of(NEARLY_PARALLEL));
    let (mut manifold, mut state) = start(&problem);
    assert!(manifold.chart().parametrization().dropped.is_empty());
    manifold.set_accelerations(Accelerations::Reduced).expect("masses are there");
    let (mut z_rate, before) = (Vec::new(), manifold.accelerator().fallbacks());
    manifold.accelerate(&mut state, &mut z_rate).expect("accelerations");
    manifold.multipliers(&mut state);
    assert_eq!(manifold.accelerator().fallbacks(), before + 1);
    let mut left = state.q.clone();
    problem.system().forces(&state, &mut left, &mut z_rate);
    assert!(state.a.iter().all(|a| a.abs() < 1e-7), "{:?}", state.a);
    let size = state.lambda.iter().fold(0.0f64, |m, x| m.max(x.abs()));
    assert!((1e8..2e8).contains(&size), "3 N over 2e-8: {size}");
    manifold.mass().multiply_add(-1.0, &state.a, &mut left);
    manifold.jacobian().multiply_transposed_add(-1.0, &state.lambda, &mut left);
    assert!(left.iter().all(|x| x.abs() < 1e-14 * size), "{left:?}");
}

#[test] // changed values share the plan of the first model, and the choice
fn changed_values_keep_the_choice() {
    let base = Problem::new(model("hmmwv14"));
    base.assemble().expect("assembles");
    let mut changed = model("hmmwv14");
    changed.bodies[0].mass *= 2.0;
    let other = base.with_model(changed);
    let accelerator = other.assemble().expect("assembles").accelerator();
    assert_eq!(accelerator.way(), Accelerations::Reduced);
    assert_eq!(accelerator.costs(), base.assemble().unwrap().accelerator().costs());
    // A mass that vanishes takes the reduced matrix away, and only there.
    let mut massless = model("hmmwv14");
    massless.bodies[7].inertia = [[0.0; 3]; 3];
    let other = base.with_model(massless);
    let accelerator = other.assemble().expect("assembles").accelerator();
    assert_ne!(accelerator.way(), Accelerations::Reduced);
    assert_eq!(accelerator.costs().refusal, Some(Refusal::Massless { body: 7 }));
}

#[test] // independent truth: the same model set up by itself
fn a_mass_that_is_changed_to_none_is_missed() {
    let text = |mass: f64| {
        format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
arm = {{ mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }}
bob = {{ mass = {mass:?}, inertia = 0.0, position = [2.0, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }}
slide = {{ type = "translational", between = ["ground", "bob"], point = [2.0, 0.0], axis = [1.0, 0.0] }}
"#
        )
    };
    let base = Problem::new(model_of(&text(1.0)));
    base.assemble().expect("assembles");
    let massless = Problem::new(model_of(&text(0.0)));
    let alone = massless.assemble().expect_err("no mass");
    assert_eq!(alone.code(), "assembly/singular-mass");
    let changed = base.with_model(model_of(&text(0.0))).assemble().err();
    assert_eq!(changed.map(|error| error.to_string()), Some(alone.to_string()));
}
