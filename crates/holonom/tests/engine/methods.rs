//! The methods against each other: one step, one matrix, one filter; rejected steps; special systems.

use crate::common::{LIBRARY, model, model_of, options, run_model};
use holonom::formula::{Nystrom, SDIRK4_16};
use holonom::method::nystrom::NystromStepper;
use holonom::method::ode::{LinearizedOde, Ode, SecondOrder};
use holonom::method::stepper::{Stepper, StepperOptions};
use holonom::method::{
    CODES, Code, CodeInfo, Descriptor, EquationForm, FirstOrder, Iterate, Profile, Weights,
    build_form, build_stepper,
};
use holonom::model::{Model, Tolerance};
use holonom::newton::{JacobianSource, MatrixOptions};
use holonom::reduction::{ParametrizationKind, choose};
use holonom::simulation::{Options, OutputTimes, Problem};
use holonom::system::State;

/// A crank with a rod and a slider, a Maxwell element in place of a damper, on a shaken foundation:
/// a closed loop with an extra state and explicit time.
const LOOP_WITH_MAXWELL: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
foundation = { mass = 5.0, inertia = 0.1, position = [0.0, -0.1] }
crank = { mass = 0.5, inertia = 1.2e-3, position = [0.0, 0.075], angle = 1.5707963267948966 }
rod = { mass = 0.8, inertia = 6.0e-3, position = [0.1, 0.075], angle = -0.6435011087932844 }
slider = { mass = 0.4, inertia = 2.0e-4, position = [0.2, 0.0] }
[joints]
rail = { type = "translational", between = ["ground", "foundation"], point = [0.0, -0.1], axis = [1.0, 0.0] }
bearing = { type = "revolute", between = ["foundation", "crank"], point = [0.0, 0.0] }
pin = { type = "revolute", between = ["crank", "rod"], point = [0.0, 0.15] }
wrist = { type = "revolute", between = ["rod", "slider"], point = [0.2, 0.0] }
guide = { type = "translational", between = ["foundation", "slider"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
return_spring = { type = "tsda", between = ["foundation", "slider"], points = [[0.8, 0.0], [0.2, 0.0]], stiffness = 400.0, damping = 4.0, free_length = 0.5 }
series = { type = "maxwell", between = ["ground", "slider"], points = [[0.9, 0.0], [0.2, 0.0]], stiffness = 300.0, damping = 20.0, free_length = 0.7 }
[drivers]
shake = { joint = "rail", coordinate = "translation", motion = { type = "harmonic", amplitude = 0.02, angular_frequency = 12.0 } }
[initial.bodies]
crank = { angular_velocity = 8.0 }
[initial]
extra_states = { series = 0.01 }
"#;

/// A spatial body on a cardan joint with a bushing, a viscoelastic one that closes a loop, and a Maxwell element.
const SPATIAL: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
rod = { mass = 2.0, inertia = [[0.167, 0.0, 0.0], [0.0, 0.18, 0.0], [0.0, 0.0, 0.02]], position = [0.1, 0.0, -0.5] }
end = { mass = 1.0, inertia = [[0.02, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.04]], position = [0.1, 0.2, -1.0] }
[joints]
cardan = { type = "universal", between = ["ground", "rod"], point = [0.0, 0.0, 0.0], axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] }
hinge = { type = "revolute", between = ["rod", "end"], point = [0.1, 0.0, -1.0], axis = [0.0, 1.0, 0.0] }
[forces]
mount = { type = "bushing", between = ["ground", "rod"], point = [0.1, 0.0, -0.9], stiffness = [2.0e3, 3.0e3, 5.0e3], damping = [20.0, 20.0, 50.0] }
series = { type = "maxwell", between = ["ground", "end"], points = [[0.5, 0.2, -1.0], [0.1, 0.2, -1.0]], stiffness = 3.0e2, damping = 30.0, free_length = 0.3 }
[forces.rubber]
type = "bushing"
between = ["rod", "end"]
point = [0.1, 0.1, -1.0]
stiffness = [0.0, 0.0, 0.0]
rotational_stiffness = [5.0, 5.0, 5.0]
[forces.rubber.branches.coupled]
stiffness_matrix = [[900.0, 100.0, 0.0, 0.0, 30.0, 0.0], [100.0, 700.0, 0.0, 0.0, 20.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [30.0, 20.0, 0.0, 0.0, 20.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
damping_matrix = [[30.0, -5.0, 0.0, 0.0, 1.0, 0.0], [-5.0, 20.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
[forces.rubber.branches.fast]
stiffness = [0.0, 0.0, 500.0]
damping = [0.0, 0.0, 2.0]
[initial.bodies]
rod = { angular_velocity = [0.5, 0.2, 0.0] }
"#;

/// Everything is driven; a Maxwell element still has its state.
const KINEMATIC: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
arm = { mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }
[forces]
series = { type = "maxwell", between = ["ground", "arm"], points = [[2.0, 0.0], [1.0, 0.0]], stiffness = 300.0, damping = 20.0, free_length = 0.9 }
[drivers]
turn = { joint = "hinge", coordinate = "rotation", motion = { type = "harmonic", amplitude = 0.5, angular_frequency = 3.0 } }
"#;

/// No joint at all.
const FREE: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
plate = { mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "plate"], points = [[0.0, 1.0], [0.3, 0.1]], stiffness = 80.0, damping = 2.0, free_length = 0.7 }
series = { type = "maxwell", between = ["ground", "plate"], points = [[1.0, 1.0], [0.8, 0.1]], stiffness = 300.0, damping = 20.0, free_length = 0.9 }
"#;

fn implicit() -> impl Iterator<Item = &'static CodeInfo> {
    CODES.iter().filter(|info| !info.code.is_explicit())
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs() / b.abs().max(1.0)).fold(0.0, f64::max)
}

/// A model with its forms of the equations at one state, a little after its start.
struct Case {
    state: State,
    first_order: FirstOrder,
    descriptors: [Descriptor; 2],
    w: Vec<f64>,
    g: Vec<f64>,
}

fn case(model: Model) -> Case {
    let start = Options { fixed_step: Some(1e-3), ..options(Code::ForSdirk, 1e-8, 0.02) };
    let state = run_model(&model, &start).summary.end;
    let problem = Problem::new(model);
    let (manifold, state) = problem.start_from(&state).unwrap();
    let system = problem.system().clone();
    let weights = || Weights::new(Tolerance::uniform(1e-6), system.as_ref(), &state);
    let descriptor = |iterate| Descriptor::new(manifold.clone(), weights(), &state, iterate);
    let descriptors = [descriptor(Iterate::Plain), descriptor(Iterate::Consistent)];
    let mut first_order = FirstOrder::new(manifold.clone(), weights(), &state);
    let mut w = vec![0.0; first_order.dimension()];
    let mut g = w.clone();
    first_order.pack(&state, &mut w);
    first_order.derivative(state.t, &w, &mut g).unwrap();
    Case { state, first_order, descriptors, w, g }
}

fn cases() -> Vec<(&'static str, Case)> {
    [
        ("slider_crank", model("slider_crank")),
        ("double_pendulum", model("double_pendulum")),
        ("andrews", model("andrews")),
        ("loop with Maxwell element", model_of(LOOP_WITH_MAXWELL)),
        ("spatial", model_of(SPATIAL)),
        ("hmmwv14", model("hmmwv14")),
    ]
    .map(|(name, model)| (name, case(model)))
    .into()
}

/// One trapezoidal step of ẇ = g(t, w) by Newton's iteration to round-off.
fn trapezoid(ode: &mut FirstOrder, t: f64, h: f64, w: &[f64], g: &[f64]) -> Vec<f64> {
    ode.linearize(t, w).unwrap();
    ode.factor(0.5 * h).unwrap();
    let mut end: Vec<f64> = w.iter().zip(g).map(|(w, g)| w + h * g).collect();
    let mut slope = g.to_vec();
    for _ in 0..50 {
        ode.derivative(t + h, &end, &mut slope).unwrap();
        let mut delta: Vec<f64> =
            (0..w.len()).map(|i| w[i] + 0.5 * h * (g[i] + slope[i]) - end[i]).collect();
        ode.solve(&mut delta);
        end.iter_mut().zip(&delta).for_each(|(e, d)| *e += d);
    }
    end
}

#[test] // truth: each other; the first-order reduction iterates on another equation
fn one_trapezoidal_step_is_the_same_by_all_three_methods() {
    for (name, mut case) in cases() {
        let h = if name == "andrews" { 1e-5 } else { 1e-3 };
        let t = case.state.t;
        let first = trapezoid(&mut case.first_order.clone(), t, h, &case.w, &case.g);
        let step = |form: &mut dyn EquationForm| {
            form.begin_step(&case.state);
            let unknowns = form.second_order().unwrap().unknowns();
            let options = StepperOptions { fixed_step: true, ..StepperOptions::thesis() };
            let mut stepper =
                NystromStepper::new(Nystrom::trapezoidal(), case.w.len(), unknowns, options);
            stepper.restart();
            let report = stepper.attempt(form, t, h, &case.w, &case.g);
            assert!(report.accepted, "{name}: {:?}", report.cause);
            stepper.end().w.to_vec()
        };
        let state_space = step(&mut case.first_order);
        let [plain, consistent] = case.descriptors.each_mut().map(|form| step(form));
        let moved = distance(&first, &case.w);
        for (method, found) in
            [("state-space", state_space), ("plain", plain), ("consistent", consistent)]
        {
            let gap = distance(&found, &first);
            assert!(gap < 1e-12, "{name}: {method} differs by {gap:.1e} of {moved:.1e}");
        }
        assert!(moved > 1e-6, "{name} does not move");
    }
}

#[test] // truth: central differences of ψ along the formula, everything recovered anew
fn the_matrix_of_the_state_space_method_is_that_of_the_first_order_reduction() {
    for (name, case) in cases().into_iter().filter(|(_, c)| c.state.z.is_empty()) {
        let mut form = case.first_order;
        let ndof = form.point().manifold.chart().ndof();
        let (t, (gamma, h)) = (case.state.t, (0.3, 2e-3));
        form.linearize(t, &case.w).unwrap();
        let b = form.newton().blocks();
        let matrix: Vec<f64> = (0..ndof * ndof)
            .map(|i| b.mass[i] + gamma * h * (b.damping[i] + gamma * h * b.stiffness[i]))
            .collect();
        let rate = &case.g[ndof..2 * ndof];
        let mut psi = |column: usize, change: f64| {
            let mut w = case.w.clone();
            w[column] += (gamma * h).powi(2) * change;
            w[ndof + column] += gamma * h * change;
            let mut rate = rate.to_vec();
            rate[column] += change;
            let mut state = form.evaluate(t, &w, false).unwrap().clone();
            let mut psi = vec![0.0; ndof];
            form.point_mut().manifold.reduced_residual(&mut state, &rate, &mut [], &mut psi);
            psi
        };
        for column in 0..ndof {
            let size = (0..ndof).map(|i| matrix[i * ndof + column].abs()).fold(0.0, f64::max);
            // Changes of positions of about 1e-6; Richardson removes the next term.
            let e = 1e-6 / (gamma * h).powi(2);
            let mut difference = |e: f64| -> Vec<f64> {
                let (plus, minus) = (psi(column, e), psi(column, -e));
                plus.iter().zip(&minus).map(|(p, m)| (p - m) / (2.0 * e)).collect()
            };
            let (coarse, fine) = (difference(e), difference(0.5 * e));
            for row in 0..ndof {
                let seen = (4.0 * fine[row] - coarse[row]) / 3.0;
                let expected = matrix[row * ndof + column];
                assert!(
                    (seen - expected).abs() < 1e-6 * size,
                    "{name}, entry ({row}, {column}): {expected:e} instead of {seen:e}"
                );
            }
        }
    }
}

#[test] // truth: each other: dense with two solves, dense with one, sparse
fn all_methods_filter_errors_alike() {
    for (name, mut case) in cases() {
        let (t, h) = (case.state.t, 5e-3);
        let ndof = case.first_order.point().manifold.chart().ndof();
        let error: Vec<f64> = (0..case.w.len())
            .map(|i| (1.0 + (i as f64 * 1.7).sin()) * if i < ndof { 1e-6 } else { 1e-4 })
            .collect();
        let filtered = |form: &mut dyn SecondOrder, one_solve: bool| {
            let mut x = error.clone();
            form.linearize(t, &case.w).unwrap();
            if one_solve {
                form.factor_stage(0.25 * h, 0.0625 * h * h).unwrap();
                form.filter(&mut x);
            } else {
                form.factor(0.25 * h).unwrap();
                form.solve(&mut x);
            }
            x.iter().enumerate().map(|(i, x)| x * if i < ndof { 1e6 } else { 1e4 }).collect()
        };
        let truth: Vec<f64> = filtered(&mut case.first_order, false);
        let state_space = filtered(&mut case.first_order, true);
        assert!(distance(&state_space, &truth) < 1e-10, "{name}: {state_space:?} ≠ {truth:?}");
        for form in &mut case.descriptors {
            let descriptor = filtered(form, true);
            assert!(distance(&descriptor, &truth) < 1e-10, "{name}: {descriptor:?} ≠ {truth:?}");
        }
    }
}

#[test] // truth: the analytic matrix
fn jacobians_by_differences_filter_errors_almost_alike() {
    for (name, mut case) in cases() {
        let (t, h) = (case.state.t, 1e-3);
        let ndof = case.first_order.point().manifold.chart().ndof();
        let error: Vec<f64> = (0..case.w.len())
            .map(|i| (1.0 + (i as f64 * 1.7).sin()) * if i < ndof { 1e-6 } else { 1e-4 })
            .collect();
        let filtered = |form: &mut dyn SecondOrder| -> Vec<f64> {
            let mut x = error.clone();
            form.linearize(t, &case.w).unwrap();
            form.factor_stage(0.25 * h, 0.0625 * h * h).unwrap();
            form.filter(&mut x);
            x.iter().enumerate().map(|(i, x)| x * if i < ndof { 1e6 } else { 1e4 }).collect()
        };
        let truth = filtered(&mut case.first_order);
        case.first_order.set_matrix(MatrixOptions {
            source: JacobianSource::Differences,
            ..MatrixOptions::default()
        });
        let state_space = filtered(&mut case.first_order);
        assert!(distance(&state_space, &truth) < 1e-4, "{name}: {state_space:?} ≠ {truth:?}");
        let form = &mut case.descriptors[1];
        form.set_matrix(MatrixOptions {
            source: JacobianSource::Differences,
            ..MatrixOptions::default()
        });
        let descriptor = filtered(form);
        assert!(distance(&descriptor, &state_space) < 1e-9, "{name}: {descriptor:?}");
    }
}

/// Error over tolerance against a reference, largest over ten times: coordinates and velocities.
fn measure(model: &Model, options: Options, truth: &[Vec<f64>; 2]) -> [f64; 2] {
    let tolerance = options.tolerance.relative;
    let found = solution(model, options);
    [0, 1].map(|k| {
        assert_eq!(found[k].len(), truth[k].len());
        let error = |(a, b): (&f64, &f64)| (a - b).abs() / (tolerance * (1.0 + b.abs()));
        found[k].iter().zip(&truth[k]).map(error).fold(0.0, f64::max)
    })
}

fn solution(model: &Model, options: Options) -> [Vec<f64>; 2] {
    let end = options.end_time;
    let times = (1..=10).map(|k| end * f64::from(k) / 10.0).collect();
    let rows = run_model(model, &Options { output: OutputTimes::Listed(times), ..options }).rows;
    let mut q = rows.all.q;
    q.extend_from_slice(&rows.all.z);
    [q, rows.all.v]
}

/// Truth: `reference` at a tolerance far below those tested.
#[track_caller]
fn assert_all_agree(name: &str, model: &Model, reference: Code, end: f64, bounds: [f64; 2]) {
    let truth = solution(model, options(reference, 1e-8, end));
    for info in implicit() {
        for tolerance in [1e-3, 1e-5] {
            let found = measure(model, options(info.code, tolerance, end), &truth);
            assert!(
                found[0] < bounds[0] && found[1] < bounds[1],
                "{} on {name} at {tolerance:e}: {found:.1?} tolerances, allowed {bounds:?}",
                info.name
            );
        }
    }
}

/// For a model of the library: an end time, a code for the truth, and how many tolerances the codes
/// may be off in coordinates and velocities.
fn agreement(name: &str) -> (f64, Code, [f64; 2]) {
    match name {
        "simple_pendulum" => (3.0, Code::Deabm, [30.0, 60.0]),
        // Accelerations of 1e6 rad/s²: velocities are sensitive.
        "andrews" => (0.03, Code::Deabm, [30.0, f64::INFINITY]),
        "slider_crank" => (1.0, Code::Deabm, [30.0, 60.0]),
        "spatial_four_bar" => (2.0, Code::Deabm, [30.0, 60.0]),
        "chain50" => (0.1, Code::ForRadau, [30.0, 60.0]),
        "chain50_free" => (0.05, Code::Deabm, [30.0, 60.0]),
        "hmmwv14" => (0.6, Code::ForRadau, [30.0, 60.0]),
        "hmmwv14_bushing" => (0.03, Code::ForRadau, [30.0, 60.0]),
        _ => (2.0, Code::ForSdirk, [30.0, 60.0]),
    }
}

#[test] // truth: one code at 1e-8; partitioning and tangent plane against it too
fn all_codes_agree_on_every_model_of_the_library() {
    for name in LIBRARY {
        let (end, reference, bounds) = agreement(name);
        let model = model(name);
        assert_all_agree(name, &model, reference, end, bounds);
        let truth = solution(&model, options(reference, 1e-8, end));
        for &(parametrization, choice) in ParametrizationKind::ALL {
            let run = Options { parametrization, ..options(Code::ForSdirk, 1e-4, end) };
            let found = measure(&model, run, &truth);
            let bounds =
                if parametrization == ParametrizationKind::default() { bounds } else { [100.0; 2] };
            assert!(found[0] < bounds[0] && found[1] < bounds[1], "{name}, {choice}: {found:.1?}");
        }
    }
}

#[test]
fn extra_states_drivers_and_special_sizes_work_under_every_method() {
    for (name, text, ndof) in [
        ("loop with Maxwell element", LOOP_WITH_MAXWELL, 1),
        ("spatial", SPATIAL, 3),
        ("kinematic", KINEMATIC, 0),
        ("free", FREE, 3),
    ] {
        let model = model_of(text);
        let summary = run_model(&model, &options(Code::Deabm, 1e-4, 0.01)).summary;
        assert_eq!(summary.ndof, ndof, "{name}");
        assert_all_agree(name, &model, Code::Deabm, 1.0, [30.0, 60.0]);
    }
}

#[test] // truth: the explicit Adams code
fn parametrizations_jacobians_and_profiles_go_with_every_method() {
    for (name, text) in [("loop with Maxwell element", LOOP_WITH_MAXWELL), ("spatial", SPATIAL)] {
        let model = model_of(text);
        let truth = solution(&model, options(Code::Deabm, 1e-10, 0.5));
        for info in implicit() {
            for &(parametrization, choice) in ParametrizationKind::ALL {
                for &(jacobian, source) in JacobianSource::ALL {
                    for &(profile, profile_name) in Profile::ALL {
                        if info.code == Code::ForRosen && jacobian == JacobianSource::Differences {
                            continue;
                        }
                        let run = Options {
                            parametrization,
                            jacobian,
                            profile,
                            ..options(info.code, 1e-4, 0.5)
                        };
                        let found = solution(&model, run);
                        for k in 0..2 {
                            let gap = distance(&found[k], &truth[k]);
                            assert!(
                                gap < 60.0 * 1e-4,
                                "{} on {name}, {choice}, {source}, {profile_name}: {gap:.1e}",
                                info.name
                            );
                        }
                    }
                }
            }
        }
    }
}

#[test] // truth: counts of the thesis profile
fn a_rejected_step_costs_no_jacobian() {
    for (name, end) in [("double_pendulum", 2.0), ("andrews", 0.03), ("slider_crank", 2.0)] {
        let model = model(name);
        for info in implicit() {
            let options = Options { profile: Profile::Thesis, ..options(info.code, 1e-3, end) };
            let s = run_model(&model, &options).summary.statistics;
            let rejected = s.rejected_error + s.rejected_newton + s.rejected_evaluation;
            // A failed recovery may change the partition, which needs new matrices.
            assert!(
                s.jacobians <= s.steps + s.rejected_evaluation && s.jacobians >= s.steps,
                "{} on {name}: {} Jacobians in {} steps",
                info.name,
                s.jacobians,
                s.steps
            );
            assert!(rejected > 0 || info.code.is_trapezoidal(), "{} on {name}", info.name);
            if !info.code.is_explicit() {
                assert!(s.factorizations >= s.jacobians + s.rejected_error, "{}", info.name);
            }
        }
    }
}

/// Steps of given lengths; before each of them an attempt `detour` times as long, which is taken back
/// if it was not rejected. Returns the end and the number of rejected attempts.
fn prescribed(model: &Model, code: Code, steps: &[f64], detour: Option<f64>) -> (Vec<f64>, u32) {
    let problem = Problem::new(model.clone());
    let assembled = problem.assemble().unwrap();
    let (mut manifold, mut state) = (assembled.manifold(), assembled.state.clone());
    let (profile, tolerance) = (Profile::Thesis, Tolerance::uniform(1e-9));
    let (system, g) = (problem.system().as_ref(), manifold.jacobian());
    let chart = choose(profile.parametrization(), &manifold, &state, g)
        .and_then(|p| manifold.chart().with_parametrization(system, p, &state.q, g));
    manifold.set_chart(chart.unwrap());
    let mut form = build_form(code, profile, manifold, tolerance, &state, &state.q);
    let mut stepper =
        build_stepper(code, profile, form.as_mut(), tolerance, None, false, f64::INFINITY);
    let mut w = vec![0.0; form.dimension()];
    let mut g = w.clone();
    form.begin_step(&state);
    form.pack(&state, &mut w);
    form.derivative(state.t, &w, &mut g).unwrap();
    stepper.restart();
    let mut rejected = 0;
    for &h in steps {
        if let Some(detour) = detour {
            if stepper.attempt(form.as_mut(), state.t, detour * h, &w, &g).accepted {
                stepper.discard();
            } else {
                rejected += 1;
            }
        }
        let report = stepper.attempt(form.as_mut(), state.t, h, &w, &g);
        assert!(report.accepted, "{code:?}: {:?}", report.cause);
        w.copy_from_slice(stepper.end().w);
        form.derivative(state.t + h, &w, &mut g).unwrap();
        state = form.point().state.clone();
        form.begin_step(&state);
    }
    (w, rejected)
}

#[test] // truth: the same steps without the detours
fn a_step_rejected_and_repeated_gives_the_same_trajectory() {
    let model = model("slider_crank");
    for info in implicit() {
        let h = if info.code.is_trapezoidal() { 1e-6 } else { 2e-4 };
        let steps: Vec<f64> = (0..40).map(|k| h * (1.0 + 0.3 * f64::from(k % 3))).collect();
        let (straight, _) = prescribed(&model, info.code, &steps, None);
        let (detour, rejected) = prescribed(&model, info.code, &steps, Some(40.0));
        let gap = distance(&detour, &straight);
        assert!(rejected > 30, "{}: {rejected} rejections", info.name);
        // Iterations end within a fraction of the tolerance, 1e-9 of rates of some 100 rad/s.
        assert!(gap < 1e-8, "{}: {gap:.1e}", info.name);
    }
}

#[test]
fn unknown_pairs_are_refused_with_the_list() {
    assert_eq!(Code::find("state_space", Some("sdirk4_15")).unwrap(), Code::SspSdirk15);
    assert_eq!(Code::find("infltrap", None).unwrap(), Code::InflTrap);
    let message = Code::find("state_space", Some("rosenbrock4")).unwrap_err().to_string();
    for info in CODES {
        assert!(message.contains(info.name) && message.contains(info.formula), "{message}");
    }
}

#[test] // truth: the trapezoid, γ = ½, β = ¼; numerical damping beyond
fn newmark_formulas_are_data() {
    let case = case(model("slider_crank"));
    let (t, h) = (case.state.t, 1e-4);
    let end = |formula: Nystrom| {
        let mut form = case.first_order.clone();
        let options = StepperOptions { fixed_step: true, ..StepperOptions::thesis() };
        let mut stepper = NystromStepper::new(formula, case.w.len(), form.unknowns(), options);
        assert!(stepper.attempt(&mut form, t, h, &case.w, &case.g).accepted);
        stepper.end().w.to_vec()
    };
    let trapezoid = end(Nystrom::trapezoidal());
    assert_eq!(end(Nystrom::newmark(0.5, 0.25)), trapezoid);
    let damped = distance(&end(Nystrom::newmark(0.6, 0.3025)), &trapezoid);
    let accurate = distance(&end(Nystrom::sdirk(&SDIRK4_16)), &trapezoid);
    assert!(accurate < 2e-2 * damped && damped < 1e-2, "{accurate:e}, {damped:e}");
}

/// Formulas that damp nothing leave accelerations of stiff components that change their sign at every step: what
/// continues these leads thousands of radians away.
#[test]
fn fixed_steps_over_a_stiff_transient_converge_under_every_code() {
    let model = model("double_pendulum_w10");
    for info in implicit() {
        for h in [0.02, 0.01, 0.005] {
            let options = Options { fixed_step: Some(h), ..options(info.code, 1e-4, 2.0) };
            let work = run_model(&model, &options).summary.statistics;
            assert_eq!(work.rejected_newton + work.rejected_evaluation, 0, "{} {h}", info.name);
        }
    }
}

/// Steps so short that one correction is enough show no contraction.
#[test]
fn a_matrix_serves_where_one_correction_is_enough() {
    for code in [Code::SspTrap, Code::InflTrap] {
        let work =
            run_model(&model("double_pendulum"), &options(code, 1e-9, 0.02)).summary.statistics;
        assert!(work.jacobians * 5 <= work.steps, "{code:?} {work:?}");
        assert!(work.steps >= 1000, "{code:?} {work:?}");
    }
}
