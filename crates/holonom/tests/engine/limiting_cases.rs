//! Models at the edges: no freedom, no constraints, an extra state, more constraints than needed,
//! bodies that turn over.

use crate::common::table::all_codes;
use crate::common::{Outcome, model_of, options, run_model};
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Options, OutputTimes, Problem, StepOutcome};

/// Runs with the channels at ten times.
#[track_caller]
fn at_ten_times(model: &Model, code: Code, tolerance: f64, end: f64, channels: &[&str]) -> Outcome {
    let options = Options {
        output: OutputTimes::Interval(end / 10.0),
        channels: channels.iter().map(|&c| c.to_owned()).collect(),
        ..options(code, tolerance, end)
    };
    let outcome = run_model(model, &options);
    assert_eq!(outcome.times().len(), 11);
    assert!(outcome.summary.statistics.residual_ratio <= 1.0);
    outcome
}

/// Largest difference of a channel's component from a function of time.
fn error(outcome: &Outcome, channel: &str, index: usize, truth: impl Fn(f64) -> f64) -> f64 {
    let series = outcome.series(channel, index);
    let errors = outcome.times().iter().zip(series).map(|(&t, x)| (x - truth(t)).abs());
    errors.fold(0.0, f64::max)
}

/// θ at time t of θ̈ = f(θ) from θ₀ at rest: classical Runge-Kutta with 20,000 steps.
fn angle_of(f: impl Fn(f64) -> f64, start: f64, t: f64) -> f64 {
    let steps = 20_000;
    let h = t / f64::from(steps);
    let (mut x, mut v) = (start, 0.0);
    for _ in 0..steps {
        let (v1, a1) = (v, f(x));
        let (v2, a2) = (v + 0.5 * h * a1, f(x + 0.5 * h * v1));
        let (v3, a3) = (v + 0.5 * h * a2, f(x + 0.5 * h * v2));
        let (v4, a4) = (v + h * a3, f(x + h * v3));
        x += h / 6.0 * (v1 + 2.0 * (v2 + v3) + v4);
        v += h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4);
    }
    x
}

#[test] // independent truth: the slider's position as a function of the crank angle
fn a_driven_crank_leaves_no_freedom() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 0.5, inertia = 1.2e-3, position = [0.0, 0.075], angle = 1.5707963267948966 }
rod = { mass = 0.8, inertia = 6.0e-3, position = [0.1, 0.075], angle = -0.6435011087932844 }
slider = { mass = 0.4, inertia = 2.0e-4, position = [0.2, 0.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
pin = { type = "revolute", between = ["crank", "rod"], point = [0.0, 0.15] }
wrist = { type = "revolute", between = ["rod", "slider"], point = [0.2, 0.0] }
guide = { type = "translational", between = ["ground", "slider"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[drivers]
motor = { joint = "bearing", coordinate = "rotation", motion = { type = "polynomial", coefficients = [1.5707963267948966, 0.5, 3.0] } }
"#,
    );
    let angle = |t: f64| std::f64::consts::FRAC_PI_2 + 0.5 * t + 3.0 * t * t;
    let slider = |t: f64| {
        let (sin, cos) = angle(t).sin_cos();
        0.15 * cos + (0.0625 - 0.0225 * sin * sin).sqrt()
    };
    let speed = |t: f64| (slider(t + 1e-5) - slider(t - 1e-5)) / 2e-5;
    let acceleration = |t: f64| (slider(t + 1e-4) - 2.0 * slider(t) + slider(t - 1e-4)) / 1e-8;
    let channels = ["crank.angle", "slider.position", "slider.velocity", "slider.acceleration"];
    for code in all_codes() {
        let outcome = at_ten_times(&model, code, 1e-6, 2.0, &channels);
        assert_eq!(outcome.summary.ndof, 0);
        assert!(error(&outcome, "crank.angle", 0, angle) < 1e-12, "{code:?}");
        assert!(error(&outcome, "slider.position", 0, slider) < 1e-12, "{code:?}");
        assert!(error(&outcome, "slider.velocity", 0, speed) < 1e-7, "{code:?}");
        assert!(error(&outcome, "slider.acceleration", 0, acceleration) < 1e-4, "{code:?}");
        let energy = &outcome.summary.energy;
        let moved = energy.range + energy.supplied.abs();
        assert!(energy.largest_imbalance < 1e-4 * moved, "{code:?}: {energy:?}");
    }
}

#[test] // independent truth: the harmonic oscillation in two dimensions
fn a_free_body_on_a_spring_has_no_constraints() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
ball = { mass = 2.0, inertia = 0.1, position = [0.5, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "ball"], points = [[0.0, 0.0], [0.5, 0.0]], stiffness = 18.0, free_length = 0.0 }
[initial.bodies]
ball = { velocity = [0.0, 0.9], angular_velocity = 0.7 }
"#,
    );
    for code in all_codes() {
        let outcome = at_ten_times(&model, code, 1e-8, 5.0, &["ball.position", "ball.angle"]);
        assert_eq!(outcome.summary.ndof, 3);
        assert!(error(&outcome, "ball.position", 0, |t| 0.5 * (3.0 * t).cos()) < 1e-5, "{code:?}");
        assert!(error(&outcome, "ball.position", 1, |t| 0.3 * (3.0 * t).sin()) < 1e-5, "{code:?}");
        assert!(error(&outcome, "ball.angle", 0, |t| 0.7 * t) < 1e-9, "{code:?}");
    }
}

#[test] // independent truth: the linear equation f̈ + (k/c) ḟ + (k/m) f = 0 of the force
fn a_mass_on_a_maxwell_element_oscillates_and_creeps() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
mass = { mass = 2.0, inertia = 0.1, position = [0.5, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "mass"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
element = { type = "maxwell", between = ["ground", "mass"], points = [[0.0, 0.0], [0.5, 0.0]], stiffness = 50.0, damping = 8.0, free_length = 0.5 }
[initial.bodies]
mass = { velocity = [1.5, 0.0] }
"#,
    );
    let (m, k, c, v0) = (2.0, 50.0, 8.0, 1.5);
    let sigma: f64 = k / (2.0 * c);
    let omega = (k / m - sigma * sigma).sqrt();
    let force = |t: f64| k * v0 / omega * (-sigma * t).exp() * (omega * t).sin();
    let rate = |t: f64| {
        k * v0 / omega
            * (-sigma * t).exp()
            * (omega * (omega * t).cos() - sigma * (omega * t).sin())
    };
    let speed = |t: f64| rate(t) / k + force(t) / c;
    let position = |t: f64| 0.5 + force(t) / k + m * (v0 - speed(t)) / c;
    for code in all_codes() {
        let channels = ["element.force", "mass.position", "mass.velocity"];
        let outcome = at_ten_times(&model, code, 1e-8, 3.0, &channels);
        assert!(error(&outcome, "element.force", 0, force) < 1e-4, "{code:?}");
        assert!(error(&outcome, "mass.position", 0, position) < 1e-6, "{code:?}");
        assert!(error(&outcome, "mass.velocity", 0, speed) < 1e-6, "{code:?}");
        let energy = &outcome.summary.energy;
        assert!(energy.largest_imbalance < 1e-6 * energy.range, "{code:?}: {energy:?}");
    }
}

/// Names of the items whose constraints are reported as redundant.
fn redundant(model: &Model) -> Vec<String> {
    let problem = Problem::new(model.clone());
    let assembled = problem.assemble().expect("an assembly");
    problem.summary(assembled).redundant.into_iter().map(|row| row.item).collect()
}

#[test] // independent truth: the equation of a parallelogram of uniform links
fn a_parallelogram_with_a_third_link_runs_and_is_reported() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies] # three links of 1 m hang from the ground at an angle of 30 degrees, a bar joins them
left = { mass = 1.0, inertia = 0.08333333333333333, position = [0.25, -0.4330127018922193] }
middle = { mass = 1.0, inertia = 0.08333333333333333, position = [1.25, -0.4330127018922193] }
right = { mass = 1.0, inertia = 0.08333333333333333, position = [2.25, -0.4330127018922193] }
bar = { mass = 2.0, inertia = 0.6666666666666666, position = [1.5, -0.8660254037844386] }
[joints]
a = { type = "revolute", between = ["ground", "left"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["ground", "middle"], point = [1.0, 0.0] }
c = { type = "revolute", between = ["ground", "right"], point = [2.0, 0.0] }
d = { type = "revolute", between = ["left", "bar"], point = [0.5, -0.8660254037844386] }
e = { type = "revolute", between = ["middle", "bar"], point = [1.5, -0.8660254037844386] }
f = { type = "revolute", between = ["right", "bar"], point = [2.5, -0.8660254037844386] }
[initial]
angular_velocity = 0.0
"#,
    );
    let dropped = redundant(&model);
    assert_eq!(dropped.len(), 1, "{dropped:?}");
    // (3·⅓ m + M) L² θ̈ = −(3/2 m + M) g L sin θ, θ from the vertical
    let truth = |t: f64| angle_of(|x| -3.5 / 3.0 * 9.81 * x.sin(), std::f64::consts::FRAC_PI_6, t);
    for code in all_codes() {
        let outcome = at_ten_times(&model, code, 1e-8, 3.0, &["bar.position", "bar.angle"]);
        assert_eq!(outcome.summary.ndof, 1);
        let x = error(&outcome, "bar.position", 0, |t| 1.0 + truth(t).sin());
        assert!(x < 1e-5, "{code:?}: {x:e}");
        assert!(error(&outcome, "bar.angle", 0, |_| 0.0) < 1e-12, "{code:?}");
    }
}

#[test] // independent truth: the equation of a parallelogram of uniform links
fn a_spatial_four_bar_with_parallel_hinges_runs_and_is_reported() {
    let model = model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies] # slender links: two of 1 m from the ground, a bar of 2 m between them
left = { mass = 1.0, inertia = [[0.08333333333333333, 0.0, 0.0], [0.0, 0.08333333333333333, 0.0], [0.0, 0.0, 0.02]], position = [0.25, 0.0, -0.4330127018922193] }
right = { mass = 1.0, inertia = [[0.08333333333333333, 0.0, 0.0], [0.0, 0.08333333333333333, 0.0], [0.0, 0.0, 0.02]], position = [2.25, 0.0, -0.4330127018922193] }
bar = { mass = 2.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.6666666666666666, 0.0], [0.0, 0.0, 0.6666666666666666]], position = [1.5, 0.0, -0.8660254037844386] }
[joints]
a = { type = "revolute", between = ["ground", "left"], point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }
c = { type = "revolute", between = ["ground", "right"], point = [2.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }
d = { type = "revolute", between = ["left", "bar"], point = [0.5, 0.0, -0.8660254037844386], axis = [0.0, 1.0, 0.0] }
f = { type = "revolute", between = ["right", "bar"], point = [2.5, 0.0, -0.8660254037844386], axis = [0.0, 1.0, 0.0] }
[initial]
angular_velocity = [0.0, 0.0, 0.0]
"#,
    );
    let dropped = redundant(&model);
    assert_eq!(dropped.len(), 3, "{dropped:?}");
    // (2·⅓ m + M) L² θ̈ = −(m + M) g L sin θ
    let truth =
        |t: f64| angle_of(|x| -3.0 / (8.0 / 3.0) * 9.81 * x.sin(), std::f64::consts::FRAC_PI_6, t);
    for code in all_codes() {
        let outcome = at_ten_times(&model, code, 1e-8, 3.0, &["bar.position"]);
        assert_eq!(outcome.summary.ndof, 1);
        let x = error(&outcome, "bar.position", 0, |t| 1.0 + truth(t).sin());
        assert!(x < 1e-5, "{code:?}: {x:e}");
    }
}

#[test] // independent truth: steady precession of a symmetric body about its angular momentum
fn a_free_symmetric_body_precesses_through_all_orientations() {
    let model = model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
top = { mass = 1.0, inertia = [[0.2, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]], position = [0.0, 0.0, 0.0], markers = { tip = { point = [0.0, 0.0, 1.0] } } }
[initial.bodies]
top = { velocity = [0.0, 0.0, 0.0], angular_velocity = [2.0, 0.0, 1.0] }
"#,
    );
    // H = (0.4, 0, 0.3) is constant; the axis turns about it at |H|/0.2 = 2.5 rad/s.
    let unit = [0.8, 0.0, 0.6];
    let axis = |t: f64| {
        let (sin, cos) = (2.5 * t).sin_cos();
        // Rodrigues: e_z cos + (unit × e_z) sin + unit (unit·e_z)(1 − cos)
        let along = unit[2] * (1.0 - cos);
        [unit[0] * along, -unit[0] * sin, cos + unit[2] * along]
    };
    for code in all_codes() {
        let outcome = at_ten_times(&model, code, 1e-9, 20.0, &["top.tip.position"]);
        assert_eq!(outcome.summary.ndof, 6);
        for k in 0..3 {
            let difference = error(&outcome, "top.tip.position", k, |t| axis(t)[k]);
            assert!(difference < 1e-5, "{code:?}: component {k} by {difference:.1e}");
        }
        // Its rotation vector is measured from the present orientation: nothing is chosen again.
        assert_eq!(outcome.summary.statistics.reparametrizations, 0, "{code:?}");
        // The largest Euler parameter changes: a partition must follow.
        let parametrization = ParametrizationKind::Partitioning;
        let partitioned = Options { parametrization, ..options(code, 1e-6, 20.0) };
        let changes = run_model(&model, &partitioned).summary.statistics.reparametrizations;
        assert!(changes > 2, "{code:?}: {changes}");
    }
}

#[test] // independent truth: the planar pendulum's exact solution, in a tilted plane
fn a_spatial_pendulum_swings_as_the_planar_one() {
    // The simple pendulum with a hinge about y: x as in the plane, z for its y.
    let model = model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
bob = { mass = 1.0, inertia = [[1.0e-3, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0e-3]], position = [1.0, 0.0, 0.0] }
[joints]
pivot = { type = "revolute", between = ["ground", "bob"], point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }
[initial]
angular_velocity = [0.0, 0.0, 0.0]
"#,
    );
    let reference = crate::common::reference("simple_pendulum");
    for code in all_codes() {
        let options = Options {
            output: OutputTimes::Listed(reference.times.clone()),
            channels: vec!["bob.position".into()],
            ..options(code, 1e-9, 10.0)
        };
        let outcome = run_model(&model, &options);
        for (column, index) in [(0, 0), (1, 2)] {
            let found = outcome.series("bob.position", index);
            for ((t, a), b) in reference.times.iter().zip(&found).zip(&reference.values[column]) {
                assert!((a - b).abs() < 1e-6, "{code:?} at {t} s: {a} for {b}");
            }
        }
    }
}

#[test] // independent truth: the damper alone, to which the element tends
fn a_maxwell_element_with_a_stiff_spring_is_a_damper() {
    let bar = |force: &str| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
bar = {{ mass = 2.0, inertia = 0.3, position = [0.8, 0.0] }}
[joints]
pin = {{ type = "revolute", between = ["ground", "bar"], point = [0.0, 0.0] }}
[forces]
element = {{ between = ["ground", "bar"], points = [[0.0, 2.0], [1.6, 0.0]], damping = 50.0, {force} }}
"#
        ))
    };
    let ten =
        |model: &Model, code| at_ten_times(model, code, 1e-5, 1.0, &["element.force", "bar.angle"]);
    let damper = ten(&bar(r#"type = "tsda""#), Code::ForRadau);
    for stiffness in ["1e6", "1e9", "1e12"] {
        let stiff =
            bar(&format!(r#"type = "maxwell", stiffness = {stiffness}, free_length = 2.0"#));
        for info in CODES.iter().filter(|info| !info.code.is_explicit()) {
            let run = ten(&stiff, info.code);
            let steps = run.summary.statistics.steps;
            let most = if info.code.is_trapezoidal() { 400 } else { 60 };
            assert!(steps < most, "{} at {stiffness} N/m: {steps} steps", info.name);
            let last = |outcome: &Outcome, channel| outcome.series(channel, 0).pop().unwrap();
            let (angle, force) = (last(&run, "bar.angle"), last(&run, "element.force"));
            let (true_angle, true_force) =
                (last(&damper, "bar.angle"), last(&damper, "element.force"));
            assert!((angle - true_angle).abs() < 3e-5, "{} at {stiffness}: {angle}", info.name);
            assert!((force / true_force - 1.0).abs() < 1e-3, "{}: {force} N", info.name);
            assert!(run.summary.warnings.is_empty(), "{}: {:?}", info.name, run.summary.warnings);
        }
    }
}

#[test] // independent truth: constant energy, and constant spin about the axle without torque
fn a_fast_rotor_goes_through_every_partition() {
    let model = model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
arm = { mass = 1.0, inertia = [[0.001, 0, 0], [0, 0.02, 0], [0, 0, 0.02]], position = [0.25, 0.0, 0.0] }
wheel = { mass = 2.0, inertia = [[0.01, 0, 0], [0, 0.006, 0], [0, 0, 0.006]], position = [0.5, 0.0, 0.0] }
[joints]
ball = { type = "spherical", between = ["ground", "arm"], point = [0.0, 0.0, 0.0] }
axle = { type = "revolute", between = ["arm", "wheel"], point = [0.5, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[initial.bodies]
wheel = { angular_velocity = [500.0, 0.0, 0.0] }
"#,
    );
    for info in CODES {
        for tolerance in [1e-2, 1e-3, 1e-4] {
            if info.code.is_trapezoidal() && tolerance < 1e-2 {
                continue; // 10⁵ steps
            }
            let channels = ["energy.kinetic", "energy.potential"];
            let run = at_ten_times(&model, info.code, tolerance, 0.3, &channels);
            let energy = |row: usize| {
                run.series("energy.kinetic", 0)[row] + run.series("energy.potential", 0)[row]
            };
            let drift = (energy(10) - energy(0)).abs() / energy(0).abs();
            // The error of a step, some tolerances of the rotation, adds up over 24 turns.
            assert!(drift < 1000.0 * tolerance, "{} at {tolerance:e}: {drift:.1e}", info.name);
        }
    }
}

#[test] // independent truth: the driver's own angle
fn a_kinematic_run_counts_many_turns() {
    let model = model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
wheel = { mass = 2.0, inertia = [[0.01, 0, 0], [0, 0.006, 0], [0, 0, 0.006]], position = [0.5, 0.3, 0.0] }
[joints]
axle = { type = "revolute", between = ["ground", "wheel"], point = [0.5, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[drivers]
spin = { joint = "axle", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 200.0] } }
"#,
    );
    for code in all_codes() {
        let run = at_ten_times(&model, code, 1e-3, 10.0, &["wheel.position"]);
        assert_eq!(run.summary.ndof, 0);
        let height = error(&run, "wheel.position", 2, |t| 0.3 * (200.0 * t).sin());
        assert!(height < 1e-9, "{code:?}: {height:.1e} m");
    }
}

#[test] // independent truth: at 1 m/s the gap of 1 m ends after 1 s
fn a_step_that_is_refused_ends_where_the_stop_begins() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
puck = { mass = 1.0, inertia = 0.01, position = [0.0, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "puck"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
stop = { type = "tsda", between = ["ground", "puck"], points = [[-1.0, 0.0], [0.0, 0.0]], free_length = 1.0, force = { x = [-9.0, 1.0, 1.001, 2.0], y = [0.0, 0.0, 1.0, 1000.0] } }
[initial.joints]
guide = { velocity = 1.0 }
"#,
    );
    // The other codes see the stop from steps that end elsewhere at this tolerance.
    for code in [Code::ForRadau, Code::SspSdirk16, Code::InflSdirk, Code::SspTrap, Code::Dop853] {
        let outcome = run_model(&model, &options(code, 1e-3, 3.0));
        let steps = &outcome.rows.all.steps;
        let accepted = steps.iter().filter(|step| step.outcome == StepOutcome::Accepted);
        let ends = accepted.map(|step| (step.t + step.h - 1.0).abs());
        let nearest = ends.fold(f64::INFINITY, f64::min);
        assert!(nearest < 1e-12, "{code:?}: {nearest:e} s from the stop");
    }
}

/// A bar on equal parallel cranks from these pivots, which coasts: more than two are redundant.
fn coasting(pivots: &[[f64; 2]], rate: f64) -> Model {
    let [x, y] = [0.15, 0.15 * 3f64.sqrt()];
    let mut text = format!(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\nbar = {{ mass = 2.0, inertia = 0.2, \
         position = [{:?}, {:?}] }}\n",
        0.4 + x,
        0.2 + y
    );
    let mut joints = "[joints]\n".to_owned();
    for (k, [px, py]) in pivots.iter().enumerate() {
        let (middle, end) = ([px + 0.5 * x, py + 0.5 * y], [px + x, py + y]);
        let crank = format!("c{k} = {{ mass = 1.0, inertia = 0.01, position = {middle:?} }}\n");
        text.push_str(&crank);
        let hinges = format!(
            "foot{k} = {{ type = \"revolute\", between = [\"ground\", \"c{k}\"], point = [{px:?}, {py:?}] }}\n\
             head{k} = {{ type = \"revolute\", between = [\"c{k}\", \"bar\"], point = {end:?} }}\n"
        );
        joints.push_str(&hinges);
    }
    model_of(&format!("{text}{joints}[initial.bodies]\nc0 = {{ angular_velocity = {rate:?} }}\n"))
}

#[test] // independent truth: all cranks turn steadily
fn redundant_rows_in_use_may_be_singular_where_the_mechanism_is_not() {
    const END: f64 = 3.0;
    let three = [[0.0, 0.0], [1.0, 0.0], [0.4, 0.6]];
    let five = [[-0.08, -0.75], [0.02, -0.21], [0.21, 0.57], [-0.39, -0.77], [-0.55, 0.78]];
    let run = |pivots: &[[f64; 2]], rate: f64, code: Code, tolerance: f64| {
        let options = Options {
            output: OutputTimes::Interval(0.05),
            channels: vec!["c0.angle".to_owned()],
            ..options(code, tolerance, END)
        };
        let outcome = run_model(&coasting(pivots, rate), &options);
        let name = format!("{} cranks at {rate} rad/s, {code:?}, {tolerance:e}", pivots.len());
        let start = outcome.series("c0.angle", 0)[0];
        let off = error(&outcome, "c0.angle", 0, |t| start + rate * t) / tolerance;
        assert!(off < 1.0, "{name}: {off:.1} tolerances");
        let codes: Vec<_> = outcome.summary.warnings.iter().map(|w| w.code).collect();
        assert_eq!(codes, ["simulation/redundant"], "{name}");
    };
    for pivots in [&three[..], &five] {
        for k in 0..20 {
            for tolerance in [1e-2, 1e-3, 1e-4] {
                run(pivots, 2.0 + 1.4 * f64::from(k), Code::ForRadau, tolerance);
            }
        }
        for code in all_codes() {
            run(pivots, 6.9, code, 1e-3);
        }
    }
}
