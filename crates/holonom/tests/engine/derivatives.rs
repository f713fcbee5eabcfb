//! Derivatives of the reduced equations v̈ = f(t, v, v̇) against differences on the constraint
//! manifold: every difference solves for the dependent coordinates anew.

use crate::common::{
    DRIVEN_PENDULUM, DRIVEN_TELESCOPE, SPATIAL_SLIDER_CRANK, model, model_of, options, run_model,
};
use holonom::method::ode::{LinearizedOde, Ode};
use holonom::method::{Code, FirstOrder, Weights};
use holonom::model::{Model, Tolerance};
use holonom::newton::ReducedBlocks;
use holonom::reduction::{ParametrizationKind, choose, disturb};
use holonom::simulation::Problem;
use holonom::threads::Threads;

/// The reduced equations at time `t` of a run.
struct Reduced {
    form: FirstOrder,
    t: f64,
    w: Vec<f64>,
}

impl Reduced {
    /// In one choice of independent variables.
    fn at(model: &Model, t: f64, choice: ParametrizationKind) -> Self {
        let problem = Problem::new(model.clone());
        let end = run_model(model, &options(Code::ForSdirk, 1e-6, t)).summary.end;
        let (mut manifold, state) = problem.start_from(&end).expect("a consistent state");
        let chart = choose(choice, &manifold, &state, manifold.jacobian()).and_then(|p| {
            let (system, g) = (problem.system().as_ref(), manifold.jacobian());
            manifold.chart().with_parametrization(system, p, &state.q, g)
        });
        manifold.set_chart(chart.expect("a chart"));
        let system = problem.system().clone();
        let weights = Weights::new(Tolerance::uniform(1e-6), system.as_ref(), &state);
        let mut form = FirstOrder::new(manifold, weights, &state);
        form.begin_step(&state);
        let mut w = vec![0.0; form.dimension()];
        form.pack(&state, &mut w);
        form.linearize(state.t, &w).expect("blocks");
        Self { form, t: state.t, w }
    }

    fn slope(&mut self, t: f64, w: &[f64]) -> Vec<f64> {
        let mut g = vec![0.0; w.len()];
        self.form.derivative(t, w, &mut g).expect("a derivative");
        g
    }

    /// Derivative of the slope along e_j, or along time for `None`: Richardson extrapolation of
    /// central differences.
    fn difference(&mut self, column: Option<usize>, step: f64) -> Vec<f64> {
        let mut central = |h: f64| -> Vec<f64> {
            let mut ends = [h, -h].map(|s| {
                let (mut t, mut w) = (self.t, self.w.clone());
                match column {
                    Some(j) => w[j] += s,
                    None => t += s,
                }
                self.slope(t, &w)
            });
            let minus = std::mem::take(&mut ends[1]);
            ends[0].iter().zip(minus).map(|(a, b)| (a - b) / (2.0 * h)).collect()
        };
        let (coarse, fine) = (central(step), central(0.5 * step));
        fine.iter().zip(coarse).map(|(f, c)| (4.0 * f - c) / 3.0).collect()
    }

    /// v̈_v = −M̂⁻¹M̂₂ and v̈_v̇ = −M̂⁻¹M̂₁ by rows.
    fn jacobian(&self) -> (Vec<f64>, Vec<f64>) {
        let blocks = self.form.newton().blocks();
        let n = self.w.len() / 2;
        let negative = |m: &[f64]| -> Vec<f64> { m.iter().map(|x| -x).collect() };
        let mut by_position = negative(&blocks.stiffness);
        let mut by_velocity = negative(&blocks.damping);
        solve_in_place(&blocks.mass, &mut by_position, n);
        solve_in_place(&blocks.mass, &mut by_velocity, n);
        (by_position, by_velocity)
    }
}

/// B ← A⁻¹ B for square matrices by rows: Gauss elimination with row pivots.
fn solve_in_place(a: &[f64], b: &mut [f64], n: usize) {
    let mut a = a.to_vec();
    for k in 0..n {
        let pivot = (k..n).max_by(|&i, &j| a[i * n + k].abs().total_cmp(&a[j * n + k].abs()));
        let pivot = pivot.expect("rows left");
        for j in 0..n {
            a.swap(k * n + j, pivot * n + j);
            b.swap(k * n + j, pivot * n + j);
        }
        for i in (0..n).filter(|&i| i != k) {
            let factor = a[i * n + k] / a[k * n + k];
            for j in 0..n {
                a[i * n + j] -= factor * a[k * n + j];
                b[i * n + j] -= factor * b[k * n + j];
            }
        }
    }
    for i in 0..n {
        for j in 0..n {
            b[i * n + j] /= a[i * n + i];
        }
    }
}

fn norm(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|x| x * x).sum::<f64>().sqrt()
}

/// Columns of v̈_v and v̈_v̇ and v̈_t agree with differences to 1e-6 of their length. Differences of a
/// stiff system carry round-off of its stiffest part: 5e-11 of all columns together is allowed.
#[track_caller]
fn assert_derivatives(model: &Model, times: &[f64], step: f64) {
    for (&t, &(choice, name)) in
        times.iter().flat_map(|t| ParametrizationKind::ALL.iter().map(move |c| (t, c)))
    {
        let mut reduced = Reduced::at(model, t, choice);
        let n = reduced.w.len() / 2;
        let (by_position, by_velocity) = reduced.jacobian();
        let all = norm(by_position.iter().chain(&by_velocity).copied());
        let check = |what: &str, column: &[f64], expected: &[f64]| {
            let error = norm(column.iter().zip(expected).map(|(a, b)| a - b));
            let length = norm(column.iter().copied());
            let allowed = 1e-6 * length + 5e-11 * all;
            assert!(error <= allowed, "{name}, t = {t}, {what}: {error:.2e} of {length:.2e}");
        };
        for (what, matrix, offset) in [("v̈_v", &by_position, 0), ("v̈_v̇", &by_velocity, n)] {
            for j in 0..n {
                let expected = reduced.difference(Some(offset + j), step);
                let column: Vec<f64> = (0..n).map(|i| matrix[i * n + j]).collect();
                check(&format!("{what} column {j}"), &column, &expected[n..]);
                // The upper half of J is [0 I]: v̇ does not depend on anything but itself.
                for (i, &entry) in expected[..n].iter().enumerate() {
                    let unit = if offset + j == n + i { 1.0 } else { 0.0 };
                    assert!((entry - unit).abs() < 1e-6, "t = {t}, {what}: v̇ row {i}");
                }
            }
        }
        let expected = reduced.difference(None, step);
        let mut time = vec![0.0; 2 * n];
        let w = reduced.w.clone();
        reduced.form.linearize(reduced.t, &w).expect("blocks");
        reduced.form.time_derivative(&mut time).expect("a time derivative");
        check("v̈_t", &time[n..], &expected[n..]);
        assert_solves(&mut reduced, &by_position, &by_velocity);
    }
}

/// y = (I − γhJ)⁻¹ x satisfies y − γh J y = x for steps short and long against the stiffness.
#[track_caller]
fn assert_solves(reduced: &mut Reduced, by_position: &[f64], by_velocity: &[f64]) {
    let n = reduced.w.len() / 2;
    for gamma_h in [1e-7, 1e-4, 1e-2] {
        reduced.form.factor(gamma_h).expect("a factor");
        let x: Vec<f64> = (0..2 * n).map(|i| ((i * i + 1) as f64).sin()).collect();
        let mut y = x.clone();
        reduced.form.solve(&mut y);
        let product = |matrix: &[f64], row: usize, part: &[f64]| -> f64 {
            matrix[row * n..][..n].iter().zip(part).map(|(a, b)| a * b).sum()
        };
        let (p, v) = y.split_at(n);
        let norm_of = |m: &[f64]| norm(m.iter().copied());
        let scale = 1.0 + gamma_h * (norm_of(by_position) + norm_of(by_velocity));
        for i in 0..n {
            let upper = p[i] - gamma_h * v[i] - x[i];
            let slope = product(by_position, i, p) + product(by_velocity, i, v);
            let lower = v[i] - gamma_h * slope - x[n + i];
            assert!(upper.abs() < 1e-10 * (1.0 + norm_of(&y)), "γh = {gamma_h:e}, v row {i}");
            assert!(lower.abs() < 1e-10 * scale * (1.0 + norm_of(&y)), "γh = {gamma_h:e}, row {i}");
        }
    }
}

#[test]
fn double_pendulum() {
    assert_derivatives(&model("double_pendulum"), &[0.0, 0.7], 1e-3);
}

#[test]
fn andrews() {
    assert_derivatives(&model("andrews"), &[0.0, 0.017, 0.03], 1e-4);
}

#[test]
fn slider_crank_with_a_time_dependent_torque() {
    assert_derivatives(&model("slider_crank"), &[0.3], 1e-3);
}

#[test]
fn pendulum_on_a_moving_driver() {
    assert_derivatives(&model_of(DRIVEN_PENDULUM), &[0.0, 0.7], 1e-3);
}

#[test]
fn telescope_driven_along_an_axis_that_turns() {
    assert_derivatives(&model_of(DRIVEN_TELESCOPE), &[0.0, 0.9], 1e-3);
}

#[test]
fn spatial_closed_loop() {
    assert_derivatives(&model_of(SPATIAL_SLIDER_CRANK), &[0.0, 0.7], 1e-3);
}

#[test]
fn vehicle_in_equilibrium_and_on_the_bump() {
    assert_derivatives(&model("hmmwv14"), &[0.0, 0.55], 1e-4);
    assert_derivatives(&model("hmmwv14_bushing"), &[0.55], 1e-4);
}

#[test] // more bodies than one part of the blocks has, joints between two parts, loops
fn bodies_of_several_parts() {
    let twist = |i: usize| if i.is_multiple_of(3) { i / 3 } else { i / 2 };
    let options = [
        crate::common::bars(true, 70, twist, [true, false]),
        crate::common::bars(false, 40, twist, [false; 2]),
    ];
    for model in options {
        assert_derivatives(&model, &[0.05], 1e-4);
    }
}

/// Bodies on stiff springs along axes that turn, one of them driven.
const TURNING_SPRINGS: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
arm = { mass = 1.0, inertia = [[0.02, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.04]], position = [0.1, 0.0, 0.0] }
sleeve = { mass = 0.7, inertia = [[0.02, 0.001, 0.0], [0.001, 0.01, 0.0], [0.0, 0.0, 0.02]], position = [0.8, 0.1, 0.0] }
bob = { mass = 0.5, inertia = [[0.01, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.01]], position = [0.8, 0.1, -0.6] }
[joints]
pivot = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.6, 0.8] }
slide = { type = "cylindrical", between = ["arm", "sleeve"], point = [0.5, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[drivers]
motor = { joint = "pivot", coordinate = "rotation", motion = { type = "harmonic", amplitude = 0.8, angular_frequency = 3.0 } }
[forces]
radial = { type = "tsda", between = ["arm", "sleeve"], points = [[0.0, 0.0, 0.0], [0.8, 0.1, 0.0]], stiffness = 2.0e3, damping = 30.0, free_length = 0.8 }
rope = { type = "tsda", between = ["sleeve", "bob"], points = [[0.8, 0.1, 0.0], [0.8, 0.12, -0.55]], stiffness = 2.0e4, damping = 5.0, free_length = 0.55 }
creep = { type = "maxwell", between = ["sleeve", "bob"], points = [[0.7, 0.1, 0.0], [0.8, 0.1, -0.6]], stiffness = 50.0, damping = 10.0, free_length = 0.6 }
[initial.bodies]
bob = { angular_velocity = [1.0, 0.4, -2.0] }
"#;

/// A viscoelastic bushing among them: extra states that see each other.
const RUBBER: &str = r#"
[forces.rubber]
type = "bushing"
between = ["sleeve", "bob"]
point = [0.8, 0.05, -0.3]
branches.coupled = { stiffness_matrix = [[40.0, 9.0, 0.0, 0.0, 3.0, 0.0], [9.0, 30.0, 0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [3.0, 2.0, 0.0, 0.0, 2.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]], damping_matrix = [[6.0, -1.0, 0.0, 0.0, 0.5, 0.0], [-1.0, 4.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.5, 0.0, 0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] }
branches.fast = { rotational_stiffness = [3.0, 0.0, 0.0], rotational_damping = [0.2, 0.0, 0.0] }
"#;

#[test]
fn springs_that_turn() {
    let without_creep = TURNING_SPRINGS.lines().filter(|line| !line.starts_with("creep"));
    let model = model_of(&without_creep.collect::<Vec<_>>().join("\n"));
    assert_derivatives(&model, &[0.0, 0.4], 1e-3);
    let reduced = Reduced::at(&model, 0.4, ParametrizationKind::Tree);
    let manifold = &reduced.form.point().manifold;
    let parametrization = manifold.chart().parametrization();
    let name = |k: usize| parametrization.name(manifold.system().as_ref(), k);
    let names: Vec<String> = (0..parametrization.ndof).map(name).collect();
    assert!(names.contains(&"rope.length".to_owned()), "{names:?}");
    assert!(!names.iter().any(|name| name.starts_with("pivot")), "driven: {names:?}");
}

#[test] // independent truth: differences of the whole slope
fn extra_states_on_springs_that_turn() {
    let mut reduced = Reduced::at(
        &model_of(&format!("{TURNING_SPRINGS}{RUBBER}")),
        0.4,
        ParametrizationKind::Tree,
    );
    let jacobian = reduced.form.newton().blocks().jacobian().expect("a regular mass matrix");
    let n = reduced.w.len();
    let size = norm(jacobian.iter().copied());
    for j in 0..n {
        let expected = reduced.difference(Some(j), 1e-3);
        let error = norm((0..n).map(|i| jacobian[i * n + j] - expected[i]));
        assert!(
            error < 1e-6 * norm(expected.iter().copied()) + 1e-11 * size,
            "column {j}: {error:.1e}"
        );
    }
}

#[test] // truth: blocks that have seen no other pivots
fn zeros_of_the_vehicle_are_those_of_the_pivots() {
    let problem = Problem::new(model("hmmwv14"));
    let assembled = problem.assemble().expect("an initial state");
    let (mut manifold, state) = (assembled.manifold(), assembled.state.clone());
    let system = problem.system().as_ref();
    let mut blocks = ReducedBlocks::new(&manifold, &Threads::default());
    let (mut probe, mut g) = (state.q.clone(), manifold.jacobian().clone());
    for round in 0..4 {
        if round > 0 {
            disturb(&state.q, round, &mut probe);
        }
        system.constraint_jacobian(&probe, &mut g);
        let parametrization = manifold.chart().parametrization().clone();
        let chart = manifold.chart().with_parametrization(system, parametrization, &probe, &g);
        let mut chart = chart.expect("a chart of this configuration");
        chart.refactor(system, &state.q, manifold.jacobian()).expect("regular");
        *manifold.chart_mut() = chart;
        blocks.evaluate(&mut manifold, &state);
        let mut fresh = ReducedBlocks::new(&manifold, &Threads::default());
        fresh.evaluate(&mut manifold, &state);
        assert_eq!(blocks.mass, fresh.mass, "{round}");
        assert_eq!(blocks.damping, fresh.damping, "{round}");
        assert_eq!(blocks.stiffness, fresh.stiffness, "{round}");
    }
}
