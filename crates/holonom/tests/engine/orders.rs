//! Observed orders of every implicit method and formula with fixed steps, the iteration carried to
//! round-off, for coordinates, velocities and multipliers separately.

use crate::common::{model, model_of, options, run_model};
use holonom::method::{CODES, Code, CodeInfo, Newmark};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Memory, Options, OutputTimes, Problem, run};
use std::fmt::Write as _;

/// A bar on a pin: three coordinates, two constraints.
const PENDULUM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
bar = { mass = 2.0, inertia = 0.3, position = [0.8, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "bar"], point = [0.0, 0.0] }
[initial.bodies]
bar = { angular_velocity = 1.0 }
"#;

/// The double pendulum with an elbow of moderate stiffness: its fastest eigenvalue is about -40/s.
const DOUBLE_PENDULUM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
upper = { mass = 3.0, inertia = 1.0, position = [1.0, 0.0] }
lower = { mass = 0.3, inertia = 0.225, position = [3.5, 0.0] }
[joints]
shoulder = { type = "revolute", between = ["ground", "upper"], point = [0.0, 0.0] }
elbow = { type = "revolute", between = ["upper", "lower"], point = [2.0, 0.0] }
[forces]
shoulder_spring = { type = "rsda", between = ["ground", "upper"], stiffness = 400.0, damping = 15.0, free_angle = -1.57 }
elbow_spring = { type = "rsda", between = ["upper", "lower"], stiffness = 200.0, damping = 20.0 }
[initial.bodies]
lower = { angular_velocity = 2.0 }
"#;

/// A slider-crank whose foundation is moved along x: one degree of freedom, explicit time in Φ.
const DRIVEN_SLIDER_CRANK: &str = r#"
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
motor = { type = "torque", on = "crank", torque = { type = "harmonic", amplitude = 0.5, angular_frequency = 10.0 } }
return_spring = { type = "tsda", between = ["foundation", "slider"], points = [[0.8, 0.0], [0.2, 0.0]], stiffness = 100.0, damping = 4.0, free_length = 0.55 }
[drivers]
shake = { joint = "rail", coordinate = "translation", motion = { type = "harmonic", amplitude = 0.02, angular_frequency = 12.0 } }
[initial.bodies]
crank = { angular_velocity = 8.0 }
"#;

/// A point mass on a rod that turns over and over: either of its coordinates is independent in turn.
const WHIRLING: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
bob = { mass = 1.0, inertia = 0.1, position = [1.0, 0.0] }
[joints]
rod = { type = "distance", between = ["ground", "bob"], points = [[0.0, 0.0], [1.0, 0.0]] }
[initial.bodies]
bob = { velocity = [0.0, 8.0] }
"#;

/// Coordinates, velocities and multipliers at eight times, flattened.
fn solution(model: &Model, options: Options) -> [Vec<f64>; 3] {
    let end = options.end_time;
    solution_at((1..=8).map(|k| end * f64::from(k) / 8.0).collect(), model, options)
}

fn solution_at(times: Vec<f64>, model: &Model, options: Options) -> [Vec<f64>; 3] {
    let rows = run_model(model, &Options { output: OutputTimes::Listed(times), ..options }).rows;
    [rows.all.q, rows.all.v, rows.all.lambda]
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

fn implicit() -> impl Iterator<Item = &'static CodeInfo> {
    CODES.iter().filter(|info| !info.code.is_explicit())
}

fn order_of(info: &CodeInfo) -> f64 {
    match info.formula {
        "trapezoidal" => 2.0,
        "radau5" => 5.0,
        _ => 4.0,
    }
}

/// Steps of a run by a formula, where those of order 4 take `steps`: errors well above round-off.
fn steps_of(info: &CodeInfo, steps: u32) -> u32 {
    match info.formula {
        "trapezoidal" => 2 * steps,
        "radau5" => steps / 4,
        _ => steps,
    }
}

/// Independent truth: the explicit Adams code at tolerance 1e-13.
fn assert_orders(name: &str, model: &Model, end: f64, steps: u32) {
    let truth = solution(model, options(Code::Deabm, 1e-13, end));
    let mut faults = String::new();
    for info in implicit() {
        let order = order_of(info);
        let steps = steps_of(info, steps);
        let error = |steps: u32| {
            let fixed = Some(end / f64::from(steps));
            let found =
                solution(model, Options { fixed_step: fixed, ..options(info.code, 1e-6, end) });
            [0, 1, 2].map(|k| distance(&found[k], &truth[k]))
        };
        let (coarse, fine) = (error(steps), error(2 * steps));
        for (k, what) in ["coordinates", "velocities", "multipliers"].into_iter().enumerate() {
            let seen = (coarse[k] / fine[k]).log2();
            if (seen - order).abs() >= 0.2 || seen.is_nan() {
                let _ = writeln!(
                    faults,
                    "{} on {name}, {what}: order {seen:.3} instead of {order} ({:.2e}, {:.2e})",
                    info.name, coarse[k], fine[k]
                );
            }
        }
    }
    assert!(faults.is_empty(), "\n{faults}");
}

#[test]
fn orders_on_a_constrained_pendulum() {
    assert_orders("pendulum", &model_of(PENDULUM), 1.0, 64);
}

#[test]
fn orders_on_a_mildly_stiff_double_pendulum() {
    assert_orders("double pendulum", &model_of(DOUBLE_PENDULUM), 1.0, 320);
}

#[test]
fn orders_on_a_slider_crank_on_a_driven_foundation() {
    assert_orders("driven slider-crank", &model_of(DRIVEN_SLIDER_CRANK), 0.5, 320);
}

#[test]
fn orders_on_a_spatial_four_bar() {
    assert_orders("spatial four-bar", &model("spatial_four_bar"), 1.0, 640);
}

#[test] // truth: the explicit Adams code at tolerance 1e-13
fn dense_output_of_formulas_in_second_order_form_has_their_order() {
    let model = model_of(PENDULUM);
    // Times that lie at different places inside the steps.
    let times: Vec<f64> = (1..=40).map(|k| 0.0247 * f64::from(k)).collect();
    let truth = solution_at(times.clone(), &model, options(Code::Deabm, 1e-13, 1.0));
    for info in implicit().filter(|i| i.family == "state_space" || i.family == "descriptor") {
        let error = |steps: u32| {
            let fixed_step = Some(1.0 / f64::from(steps));
            let fixed = Options { fixed_step, ..options(info.code, 1e-6, 1.0) };
            let found = solution_at(times.clone(), &model, fixed);
            [0, 1].map(|k| distance(&found[k], &truth[k]))
        };
        let (coarse, fine) = (error(80), error(160));
        for k in 0..2 {
            // The places inside the steps differ between the two runs: more than the order is chance.
            let seen = (coarse[k] / fine[k]).log2();
            assert!(seen > order_of(info) - 0.4, "{}: {seen:.3}", info.name);
        }
    }
}

#[test] // truth: the explicit Adams code at tolerance 1e-13
fn formulas_keep_their_order_over_changes_of_the_partition() {
    let model = model_of(WHIRLING);
    let truth = solution(&model, options(Code::Deabm, 1e-13, 1.0));
    for info in implicit() {
        let steps = 4 * steps_of(info, 320);
        let error = |steps: u32| {
            let fixed_step = Some(1.0 / f64::from(steps));
            let parametrization = ParametrizationKind::Partitioning;
            let fixed = Options { fixed_step, parametrization, ..options(info.code, 1e-6, 1.0) };
            let changes = run_model(&model, &fixed).summary.statistics.reparametrizations;
            assert!(changes >= 4, "{}: {changes} changes", info.name);
            let found = solution(&model, fixed);
            [0, 1, 2].map(|k| distance(&found[k], &truth[k]))
        };
        let (coarse, fine) = (error(steps), error(2 * steps));
        for k in 0..3 {
            // The changes come at other times with other steps: the figure varies.
            let seen = (coarse[k] / fine[k]).log2();
            assert!(seen > order_of(info) - 0.4, "{}: {seen:.3}", info.name);
        }
    }
}

#[test] // truth: the explicit Adams code at tolerance 1e-13
fn members_of_newmarks_family_have_their_orders_and_need_fixed_steps_to_damp() {
    let model = model_of(PENDULUM);
    let truth = solution(&model, options(Code::Deabm, 1e-13, 1.0));
    for code in [Code::SspTrap, Code::InflTrap] {
        // Newmark (1959): order 2 for γ = ½ whatever β, else 1.
        for (newmark, order) in [
            (Newmark { gamma: 0.5, beta: 0.25 }, 2.0),
            (Newmark { gamma: 0.5, beta: 0.3 }, 2.0),
            (Newmark::damping(0.6), 1.0),
        ] {
            let error = |steps: u32| {
                let fixed_step = Some(1.0 / f64::from(steps));
                let newmark = Some(newmark);
                let fixed = Options { fixed_step, newmark, ..options(code, 1e-6, 1.0) };
                let found = solution(&model, fixed);
                [0, 1].map(|k| distance(&found[k], &truth[k]))
            };
            let (coarse, fine) = (error(320), error(640));
            for k in 0..2 {
                let seen = (coarse[k] / fine[k]).log2();
                assert!((seen - order).abs() < 0.2, "{code:?}, {newmark:?}: order {seen:.3}");
            }
        }
        let refused = |options: Options| {
            let problem = Problem::new(model.clone());
            run(&problem, &options, None, &mut Memory::default()).unwrap_err().to_string()
        };
        let controlled =
            Options { newmark: Some(Newmark::damping(0.6)), ..options(code, 1e-4, 1.0) };
        assert!(refused(controlled.clone()).contains("fixed_step"));
        let unstable = Newmark { gamma: 0.5, beta: 0.2 };
        assert!(
            refused(Options { newmark: Some(unstable), ..controlled.clone() }).contains("A-stable")
        );
        assert!(refused(Options { code: Code::ForSdirk, ..controlled }).contains("SspTrap"));
    }
}
