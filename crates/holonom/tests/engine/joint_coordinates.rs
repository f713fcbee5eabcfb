//! Joint coordinates against Cartesian ones. Independent truth: the equations with every joint as a constraint, which know
//! no tree.

use crate::common::{LIBRARY, model, model_of, options, run_from};
use crate::random::{Mechanism, numbers::Random};
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::newton::Representation;
use holonom::reduction::{Coordinates, Manifold, ParametrizationKind, Point};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, RunError, Status, Summary, run};
use holonom::system::State;
use std::fmt::Write;

/// Largest difference of two vectors against the largest entry.
fn difference(a: &[f64], b: &[f64], least: f64) -> f64 {
    let size = a.iter().chain(b).fold(least, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / size
}

/// Two points in the same parametrization, the second one in joint coordinates; none where the tree has lines.
fn points(model: Model) -> Option<([Point; 2], State)> {
    let problem = Problem::new(model);
    let assembled = problem.assemble().ok()?;
    let (cartesian, state) = (assembled.manifold(), assembled.state.clone());
    let mut joint = cartesian.clone();
    joint
        .use_joint_coordinates(&state.q, usize::MAX)
        .then(|| ([Point::new(cartesian, &state), Point::new(joint, &state)], state))
}

fn ndof(manifold: &Manifold) -> usize {
    manifold.chart().ndof()
}

/// Worst differences of what a point computes near its start: q, q̇, q̈, λ, ψ, M̂ p, δq, δq̇, and what is
/// left of the equations of motion.
fn compare(points: &mut [Point; 2], state: &State, random: &mut Random) -> Option<[f64; 9]> {
    let n = ndof(&points[0].manifold);
    let mut p = vec![0.0; n];
    let mut rates = vec![0.0; n];
    points[0].manifold.independent_state(state, &mut p, &mut rates);
    for (p, rate) in p.iter_mut().zip(&mut rates) {
        *p += random.range(-0.02, 0.02);
        *rate += random.range(-1.0, 1.0);
    }
    let z: Vec<f64> = state.z.clone();
    for point in &mut *points {
        point.evaluate(state.t, &p, &rates, &z, true).ok()?;
        point.complete();
    }
    let mut worst = [0.0f64; 9];
    let balance;
    {
        let [a, b] = &*points;
        worst[0] = difference(&a.state.q, &b.state.q, 1.0);
        worst[1] = difference(&a.state.v, &b.state.v, 1.0);
        worst[2] = difference(&a.state.a, &b.state.a, 1.0);
        // Multipliers are sums of forces, which stiff elements let nearly cancel.
        let mut force = vec![0.0; state.q.len()];
        a.manifold.system().forces(&a.state, &mut force, &mut vec![0.0; z.len()]);
        let largest = force.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        worst[3] = difference(&a.state.lambda, &b.state.lambda, largest);
        // Where rows nearly depend on each other multipliers are not unique; they balance the forces all the same.
        let mut at = b.clone();
        let mut left = vec![0.0; state.lambda.len()];
        at.manifold.descriptor_residual(&b.state, &mut vec![0.0; z.len()], &mut force, &mut left);
        balance = force.iter().fold(0.0f64, |m, x| m.max(x.abs())) / largest;
    }
    let change: Vec<f64> = (0..n).map(|_| random.range(-1.0, 1.0)).collect();
    let guess: Vec<f64> = (0..n).map(|_| random.range(-10.0, 10.0)).collect();
    let mut found = Vec::new();
    for point in &mut *points {
        let (coordinates, rows) = (state.q.len(), state.lambda.len());
        let (mut dq, mut dv) = (vec![0.0; coordinates], vec![0.0; coordinates]);
        let both = [&*change, &*rates].concat();
        point.spread(&both, &mut dq, &mut dv, &mut vec![0.0; rows], &mut vec![0.0; n]);
        let (mut psi, mut felt) = (vec![0.0; n], vec![0.0; n]);
        let Point { manifold, state, z_rate, .. } = point;
        manifold.reduced_residual(state, &guess, z_rate, &mut psi);
        manifold.reduced_mass_times(&change, &mut felt);
        found.push([psi, felt, dq, dv, state.a.clone()]);
    }
    for (worst, (a, b)) in worst[4..8].iter_mut().zip(found[0].iter().zip(&found[1])) {
        *worst = difference(a, b, 1.0);
    }
    worst[2] = worst[2].max(difference(&found[0][4], &found[1][4], 1.0));
    worst[8] = balance;
    Some(worst)
}

#[test]
fn both_forms_agree_on_the_library() {
    let mut random = Random::new(11);
    for name in LIBRARY {
        let Some((mut points, state)) = points(model(name)) else {
            panic!("{name} has no joint form");
        };
        let mut compared = 0;
        for _ in 0..20 {
            if let Some(worst) = compare(&mut points, &state, &mut random) {
                compared += 1;
                assert!(worst.iter().all(|x| *x < 1e-9), "{name}: {worst:?}");
            }
        }
        assert!(compared >= 15, "{name}: {compared} states");
        assert_eq!(
            points[1].manifold.counters.left_to_cartesian, 0,
            "{name}: left to the Cartesian solvers"
        );
    }
}

#[test]
fn both_forms_agree_on_random_mechanisms() {
    let (mut compared, mut others, mut loops, mut left) = (0, 0, 0, 0);
    for seed in 0..400 {
        let text = Mechanism::new(seed, 0.0).text();
        let mut model = model_of(&text);
        if seed % 4 == 0 && !model.joints.is_empty() {
            model.simulation.cut = vec![seed as usize / 4 % model.joints.len()];
        }
        let Some((mut points, state)) = points(model) else {
            others += 1;
            continue;
        };
        let mut random = Random::new(seed);
        let condition = points.iter_mut().map(|p| p.manifold.condition()).fold(1.0, f64::max);
        if condition > 1e5 || ndof(&points[0].manifold) == 0 {
            continue;
        }
        loops += usize::from(!points[0].manifold.system().tree().closures.is_empty());
        for _ in 0..3 {
            let Some(mut worst) = compare(&mut points, &state, &mut random) else { continue };
            compared += 1;
            worst[3] = 0.0; // the balance tells them, unique or not
            assert!(worst.iter().all(|x| *x < 1e-9), "seed {seed}: {worst:?}\n{text}");
        }
        left += points[1].manifold.counters.left_to_cartesian;
    }
    assert!(left <= 5, "{left} accelerations left to the Cartesian solvers"); // nearly singular ones
    assert!(
        compared > 600 && loops > 120,
        "{compared} states, {loops} with loops, {others} others"
    );
}

fn with(coordinates: Coordinates, code: Code, tolerance: f64, end: f64) -> Options {
    Options {
        coordinates,
        output: OutputTimes::Interval(end / 10.0),
        ..options(code, tolerance, end)
    }
}

/// Largest differences of q, q̇ and λ at the end of two runs.
fn apart(a: &State, b: &State) -> [f64; 3] {
    [(&a.q, &b.q), (&a.v, &b.v), (&a.lambda, &b.lambda)].map(|(a, b)| difference(a, b, 1.0))
}

#[track_caller]
fn end(model: &Model, options: &Options, from: Option<&State>) -> Summary {
    let outcome = run_from(model, options, from);
    let stop = &outcome.summary.stop.message;
    assert_eq!(outcome.summary.status, Status::Completed, "{:?}: {stop}", options.code);
    outcome.summary
}

/// Explicit codes go where nothing is stiff.
#[test] // independent truth: the Cartesian form at the same tolerance
fn all_codes_give_the_same_motion_in_both_forms() {
    let stiff = ["double_pendulum_w10", "hmmwv14_bushing"];
    for name in ["spatial_four_bar", "slider_crank", "double_pendulum_w10", "hmmwv14_bushing"] {
        let model = model(name);
        for info in CODES {
            if info.code.is_explicit() && stiff.contains(&name) {
                continue;
            }
            let run = |form| end(&model, &with(form, info.code, 1e-5, 0.2), None);
            let (cartesian, joint) = (run(Coordinates::Cartesian), run(Coordinates::Joint));
            let [q, v, multipliers] = apart(&cartesian.end, &joint.end);
            // A tenth of the tolerance, where round-off decides a step otherwise; multipliers of stiff bushings magnify it.
            let worst = format!("{name} {}: {q} {v} {multipliers}", info.name);
            assert!(q < 1e-6 && v < 1e-6 && multipliers < 1e-4, "{worst}");
            let [a, b] = [cartesian, joint].map(|run| run.statistics.steps as i64);
            assert!((a - b).abs() <= 1 + a / 100, "{name} {}: {a} and {b} steps", info.name);
        }
    }
}

#[test] // independent truth: the Cartesian form at a hundredth of the tolerance
fn the_library_moves_alike_in_both_forms() {
    for name in LIBRARY {
        let model = model(name);
        let until = if *name == "andrews" { 0.01 } else { 0.3 };
        let truth = end(&model, &with(Coordinates::Cartesian, Code::ForRadau, 1e-7, until), None);
        let run = |form| end(&model, &with(form, Code::ForRadau, 1e-5, until), None);
        let [cartesian, joint] = [Coordinates::Cartesian, Coordinates::Joint].map(run);
        for found in [&cartesian, &joint] {
            let worst = apart(&truth.end, &found.end);
            assert!(worst.iter().all(|x| *x < 1e-6), "{name}: {worst:?}");
        }
        let worst = apart(&cartesian.end, &joint.end);
        assert!(worst.iter().all(|x| *x < 1e-9), "{name}: {worst:?} apart");
    }
}

#[test] // independent truth: the run that stays in one form
fn a_run_goes_on_in_the_other_form() {
    for name in ["spatial_four_bar", "hmmwv14_bushing", "slider_crank"] {
        let model = model(name);
        let until = |form, time| with(form, Code::ForRadau, 1e-6, time);
        let whole = end(&model, &until(Coordinates::Cartesian, 0.4), None);
        for [first, second] in [
            [Coordinates::Cartesian, Coordinates::Joint],
            [Coordinates::Joint, Coordinates::Cartesian],
        ] {
            let half = end(&model, &until(first, 0.2), None);
            let rest = end(&model, &until(second, 0.4), Some(&half.end));
            let worst = apart(&whole.end, &rest.end);
            assert!(worst.iter().all(|x| *x < 2e-8), "{name}: {worst:?}");
        }
    }
}

#[test] // independent truth: the closed form θ̈ = −mgl/(I + ml²), and the Cartesian form, which falls back as well
fn a_body_that_a_recursion_cannot_tell_is_left_to_other_solvers() {
    let text = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
washer = { mass = 1e-6, inertia = 1e-9, position = [0.0, 0.0] }
bar = { mass = 2.0, inertia = 0.5, position = [1.0, 0.0] }
[joints]
inner = { type = "revolute", between = ["ground", "washer"], point = [0.0, 0.0] }
hinge = { type = "revolute", between = ["washer", "bar"], point = [0.0, 0.0] }
"#;
    let ([_, mut joint], state) = points(model_of(text)).expect("a joint form");
    let (mut p, mut rates) = ([0.0; 2], [0.0; 2]);
    joint.manifold.independent_state(&state, &mut p, &mut rates);
    joint.evaluate(0.0, &p, &rates, &[], true).expect("has accelerations");
    let truth = -2.0 * 9.81 / (0.5 + 2.0);
    let found = joint.state.a[5];
    assert!((found - truth).abs() < 1e-9 * truth.abs(), "{found} and {truth}");
    assert_eq!(joint.manifold.counters.left_to_cartesian, 1);
}

#[test] // independent truth: what falls freely accelerates by g and leaves its slides alone
fn what_balances_to_nothing_is_no_lost_digit() {
    for (angle, axis) in [(0.3, [0.0, 1.0, 0.0]), (1.1, [1.0, 0.0, 0.0]), (-2.0, [0.0, 1.0, 0.0])] {
        let (s, c) = f64::sin_cos(0.5 * angle);
        let text = format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies.frame]
mass = 7.3
inertia = [[1.3, 0.1, 0.2], [0.1, 2.1, 0.3], [0.2, 0.3, 1.7]]
position = [0.3, 0.1, 0.7]
euler_parameters = [{c:?}, {:?}, 0.0, {:?}]
[bodies.rack]
mass = 0.9
inertia = [[0.02, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.02]]
position = [1.1, 0.2, 0.7]
[joints.guide]
type = "translational"
between = ["frame", "rack"]
point = [1.1, 0.2, 0.7]
axis = {axis:?}
"#,
            0.6 * s,
            0.8 * s
        );
        let ([_, mut joint], state) = points(model_of(&text)).expect("a joint form");
        let (mut p, mut rates) = ([0.0; 7], [0.0; 7]);
        joint.manifold.independent_state(&state, &mut p, &mut rates);
        joint.evaluate(0.0, &p, &rates, &[], true).expect("has accelerations");
        let a = &joint.state.a;
        assert!([a[2], a[9]].iter().all(|a| (a + 9.81).abs() < 1e-9), "{a:?}");
        assert_eq!(joint.manifold.counters.left_to_cartesian, 0, "{angle} {axis:?}");
    }
}

#[test] // independent truth: Lagrange's equation of a short pendulum at the end of an arm that a driver turns
fn what_is_small_and_far_out_keeps_its_digits() {
    let (short, mass, inertia, angle) = (0.01, 1.0, 1e-6, 0.4);
    let (rate, growth) = (1.0, 0.8);
    for far in [1.0, 1e3, 1e4] {
        let text = format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
arm = {{ mass = 10.0, inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], position = [{:?}, 0.0, 0.0] }}
bob = {{ mass = {mass:?}, inertia = [[{inertia:?}, 0.0, 0.0], [0.0, {inertia:?}, 0.0], [0.0, 0.0, {inertia:?}]], position = [{far:?}, {short:?}, 0.0] }}
[joints]
base = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
tip = {{ type = "revolute", between = ["arm", "bob"], point = [{far:?}, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
[drivers.turn]
joint = "base"
coordinate = "rotation"
motion = {{ type = "polynomial", coefficients = [0.0, {rate:?}, {:?}] }}
[initial.joints]
tip = {{ angle = {angle:?}, angular_velocity = 0.3 }}
"#,
            0.5 * far,
            0.5 * growth
        );
        let ([_, mut joint], state) = points(model_of(&text)).expect("a joint form");
        let (mut p, mut rates) = ([0.0; 1], [0.0; 1]);
        joint.manifold.independent_state(&state, &mut p, &mut rates);
        joint.evaluate(0.0, &p, &rates, &[], true).expect("has accelerations");
        let (sin, cos) = f64::sin_cos(angle);
        let torque =
            mass * short * (growth * far * sin - 9.81 * cos - short * rate * rate * sin * cos);
        let truth = torque / (mass * short * short + inertia);
        let (e, a) = (&joint.state.q[10..14], &joint.state.a[10..14]);
        let found = 2.0 * (e[0] * a[1] - e[1] * a[0] - e[3] * a[2] + e[2] * a[3]);
        assert!((found - truth).abs() < 1e-9 * truth.abs(), "{far} m: {found} and {truth}");
    }
}

/// A chain of links in the plane, its first hinge driven or not.
fn chain(links: usize, driven: bool) -> Model {
    let link = |k: usize| {
        let base = if k == 0 { "ground".to_owned() } else { format!("b{}", k - 1) };
        format!(
            "[bodies.b{k}]\nmass = 1.0\ninertia = 0.1\nposition = [{k}.5, 0.0]\n[joints.j{k}]\ntype = \"revolute\"\n\
             between = [\"{base}\", \"b{k}\"]\npoint = [{k}.0, 0.0]\n"
        )
    };
    let mut text = String::from("holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n");
    text.extend((0..links).map(link));
    if driven {
        text += "[drivers.d]\njoint = \"j0\"\ncoordinate = \"rotation\"\n";
        text += "motion = { type = \"polynomial\", coefficients = [0.0, 1.0, 2.0] }\n";
    }
    model_of(&text)
}

#[test] // independent truth: the Cartesian form, to which the recursion leaves nothing to answer
fn long_chains_are_solved_along_the_tree() {
    for (links, driven) in [(40, false), (40, true), (300, false), (300, true)] {
        let (mut points, state) = points(chain(links, driven)).expect("a joint form");
        let mut random = Random::new(3);
        for _ in 0..3 {
            let mut worst = compare(&mut points, &state, &mut random).expect("has accelerations");
            // Tensions exceed the applied forces, against which the balance is held, by far.
            let tension = points[0].state.lambda.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            worst[8] *= 9.81 / tension;
            assert!(worst.iter().all(|x| *x < 1e-8), "{links}, {driven}: {worst:?}");
        }
        assert_eq!(
            points[1].manifold.counters.left_to_cartesian, 0,
            "{links} links, driven: {driven}"
        );
    }
}

#[test] // independent truth: the Cartesian form at a hundredth of the tolerance
fn drivers_move_joints_that_close_loops() {
    for (name, joint, cut) in [
        ("slider_crank", "bearing", true),
        ("slider_crank", "wrist", false),
        ("spatial_four_bar", "bearing", true),
    ] {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../models/");
        let text = std::fs::read_to_string(format!("{folder}{name}/model.toml")).expect("a model");
        // What the driver tells is not stated.
        let text = text.replace("crank = { angular_velocity", "#crank = { angular_velocity");
        let driver = format!(
            "\n[drivers]\nhand = {{ joint = \"{joint}\", coordinate = \"rotation\", motion = {{ type = \"harmonic\", \
             amplitude = 0.3, angular_frequency = 5.0 }} }}\n"
        );
        let mut model = model_of(&format!("{text}{driver}"));
        if cut {
            let at = model.joints.iter().position(|other| other.name == joint).expect("a joint");
            model.simulation.cut = vec![at];
        }
        let truth = end(&model, &with(Coordinates::Cartesian, Code::ForRadau, 1e-7, 0.4), None);
        for code in [Code::ForRadau, Code::Deabm] {
            let options = Options { max_steps: 2000, ..with(Coordinates::Joint, code, 1e-5, 0.4) };
            let [q, v, _] = apart(&truth.end, &end(&model, &options, None).end);
            assert!(q < 1e-4 && v < 1e-4, "{name}, {joint}: {q} {v}");
        }
    }
}

#[test] // independent truth: the same model read anew
fn another_cut_is_another_tree() {
    let own = model("slider_crank");
    let mut other = own.clone();
    other.simulation.cut = vec![0];
    let closures = |problem: &Problem| problem.system().tree().closures.clone();
    let changed = Problem::new(own.clone()).with_model(other.clone());
    assert_eq!(closures(&changed), closures(&Problem::new(other)));
    assert_ne!(closures(&changed), closures(&Problem::new(own)));
}

#[test] // independent truth: the dense matrix in the same form
fn the_sparse_matrix_serves_in_joint_coordinates() {
    let model = model("spatial_four_bar");
    let run = |newton| {
        let options = with(Coordinates::Joint, Code::ForRadau, 1e-5, 0.5);
        end(&model, &Options { newton, ..options }, None)
    };
    let (dense, sparse) = (run(Representation::Dense), run(Representation::Sparse));
    assert_eq!(dense.statistics.steps, sparse.statistics.steps);
    assert!(apart(&dense.end, &sparse.end).iter().all(|x| *x < 1e-6));
}

#[test]
fn what_has_no_joint_form_is_refused_with_the_reason() {
    let options = with(Coordinates::Joint, Code::ForRadau, 1e-4, 0.1);
    let thesis = Options {
        parametrization: holonom::reduction::ParametrizationKind::Partitioning,
        ..options.clone()
    };
    let problem = Problem::new(model("spatial_four_bar"));
    let error = run(&problem, &thesis, None, &mut Memory::default()).expect_err("refused");
    assert!(
        matches!(&error, RunError::Coordinates { reason } if reason.contains("parametrization"))
    );
}

#[test] // independent truth: the motion that the forest of the engine's own choice gives
fn joints_are_cut_where_the_file_says_so() {
    for (name, cut, ways) in [
        ("spatial_four_bar", "bearing", [Coordinates::Cartesian, Coordinates::Joint]),
        ("slider_crank", "bearing", [Coordinates::Cartesian, Coordinates::Joint]),
        ("simple_pendulum", "pivot", [Coordinates::Cartesian, Coordinates::Joint]),
    ] {
        let own = model(name);
        let at = own.joints.iter().position(|joint| joint.name == cut).expect("a joint");
        let mut other = own.clone();
        other.simulation.cut = vec![at];
        let closes = |model: &Model| {
            let problem = Problem::new(model.clone());
            let system = problem.system();
            let row = system.structure().joints[at].row;
            system.tree().closures.iter().any(|closure| closure.row == row)
        };
        assert!(!closes(&own) && closes(&other), "{name}");
        let truth = end(&own, &with(Coordinates::Cartesian, Code::ForRadau, 1e-7, 0.5), None);
        for way in ways {
            let found = end(&other, &with(way, Code::ForRadau, 1e-7, 0.5), None);
            let worst = apart(&truth.end, &found.end);
            assert!(worst.iter().all(|x| *x < 1e-6), "{name}: {worst:?}");
        }
    }
}

/// A row of `count` planar four-bars, each moved by the one before, or each for itself.
pub(crate) fn four_bars(count: usize, coupled: bool) -> Model {
    let mut text = String::from("holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n");
    for k in 0..count {
        let x = 3.0 * k as f64;
        let body = |name: &str, x: f64, y: f64| {
            format!("[bodies.{name}{k}]\nmass = 1.0\ninertia = 0.2\nposition = [{x:?}, {y:?}]\n")
        };
        let joint = |name: &str, a: String, b: String, x: f64, y: f64| {
            format!(
                "[joints.{name}{k}]\ntype = \"revolute\"\nbetween = [\"{a}\", \"{b}\"]\npoint = [{x:?}, {y:?}]\n"
            )
        };
        let of = |name: &str, k: usize| format!("{name}{k}");
        text += &body("crank", x, 0.5);
        text += &body("coupler", x + 1.25, 1.25);
        text += &body("rocker", x + 2.5, 0.75);
        text += &joint("a", "ground".into(), of("crank", k), x, 0.0);
        text += &joint("b", of("crank", k), of("coupler", k), x, 1.0);
        text += &joint("c", of("coupler", k), of("rocker", k), x + 2.5, 1.5);
        text += &joint("d", "ground".into(), of("rocker", k), x + 2.5, 0.0);
        if coupled && k > 0 {
            text += &body("link", x - 0.25, 0.9);
            text += &joint("e", of("rocker", k - 1), of("link", k), x - 0.5, 0.8);
            text += &joint("f", of("link", k), of("crank", k), x, 1.0);
        }
    }
    model_of(&(text + "[initial.joints.a0]\nangular_velocity = 1.0\n"))
}

#[test] // independent truth: the run in the form that is asked for, bit for bit
fn joint_coordinates_are_taken_where_few_equations_are_solved_together() {
    for (model, form) in [
        (four_bars(2, true), Coordinates::Joint),
        (four_bars(10, false), Coordinates::Joint),
        (four_bars(10, true), Coordinates::Cartesian),
        (chain(5, true), Coordinates::Joint),
    ] {
        let run = |form| end(&model, &with(form, Code::ForRadau, 1e-4, 0.2), None);
        let states = [form, Coordinates::Auto].map(|form| run(form).end);
        assert_eq!(states[0], states[1], "{} bodies", model.bodies.len());
        let other = match form {
            Coordinates::Joint => Coordinates::Cartesian,
            _ => Coordinates::Joint,
        };
        assert_ne!(run(other).end, states[1], "{} bodies", model.bodies.len());
    }
}

/// A row of links in space on cylindrical joints, of every third of which a driver moves one coordinate and of every
/// fifth the other one, with masses from grams to tonnes.
fn driven_row(links: usize) -> String {
    let mut bodies = "[bodies]\n".to_owned();
    let (mut joints, mut drivers) = ("[joints]\n".to_owned(), "[drivers]\n".to_owned());
    for i in 0..links {
        let mass = [1e-3, 1.0, 1e3][i % 3];
        let [a, b, c] = [0.1, 0.12, 0.07].map(|x| x * mass);
        let (x, base) =
            (i as f64, i.checked_sub(1).map_or("ground".to_owned(), |i| format!("b{i}")));
        writeln!(
            bodies,
            "b{i} = {{ mass = {mass:?}, position = [{:?}, 0.1, 0.2], \
             inertia = [[{a:?}, 0.0, 0.0], [0.0, {b:?}, 0.0], [0.0, 0.0, {c:?}]] }}",
            x + 0.5
        )
        .expect("a text");
        writeln!(
            joints,
            "j{i} = {{ type = \"cylindrical\", between = [\"{base}\", \"b{i}\"], \
             point = [{x:?}, 0.0, 0.0], axis = [{:?}, 1.0, {:?}] }}",
            0.2 * x,
            (i % 2) as f64
        )
        .expect("a text");
        for (every, coordinate) in [(3, "rotation"), (5, "translation")] {
            if i % every == 1 {
                writeln!(
                    drivers,
                    "{coordinate}_{i} = {{ coordinate = \"{coordinate}\", joint = \"j{i}\", \
                     motion = {{ type = \"polynomial\", coefficients = [0.0, 0.3, 1.5] }} }}"
                )
                .expect("a text");
            }
        }
    }
    let head = "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, -9.81]\n";
    format!("{head}{bodies}{joints}{drivers}")
}

#[test] // independent truth: the Cartesian form
fn trees_with_drivers_are_eliminated_body_by_body() {
    let mut random = Random::new(23);
    for links in [2, 5, 17] {
        let (mut points, state) = points(model_of(&driven_row(links))).expect("no lines");
        for _ in 0..20 {
            let worst = compare(&mut points, &state, &mut random).expect("evaluated");
            assert!(worst.iter().all(|x| *x < 1e-9), "{links}: {worst:?}");
        }
        assert_eq!(points[1].manifold.counters.left_to_cartesian, 0, "{links}");
    }
}

#[test] // independent truth: the joints' own equations in Cartesian coordinates
fn a_slow_loop_is_closed_beside_what_turns_fast() {
    for spin in [0.0, 3.0, 800.0] {
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = {{ mass = 1.0, inertia = 0.1, position = [0.0, 0.5] }}
coupler = {{ mass = 1.0, inertia = 0.8, position = [1.5, 1.5] }}
rocker = {{ mass = 1.0, inertia = 0.4, position = [3.5, 1.0] }}
wheel = {{ mass = 1.0, inertia = 0.1, position = [9.0, 0.0] }}
[joints]
a = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }}
b = {{ type = "revolute", between = ["crank", "coupler"], point = [0.0, 1.0] }}
c = {{ type = "revolute", between = ["coupler", "rocker"], point = [3.0, 2.0] }}
d = {{ type = "revolute", between = ["ground", "rocker"], point = [4.0, 0.0] }}
w = {{ type = "revolute", between = ["ground", "wheel"], point = [9.0, 0.0] }}
[initial.joints]
w = {{ angular_velocity = {spin:?} }}
"#
        ));
        for info in CODES {
            let options = with(Coordinates::Joint, info.code, 1e-4, 1.0);
            let residual = end(&model, &options, None).statistics.position_residual;
            assert!(residual < 1e-13, "{} {spin}: {residual:.1e}", info.name);
        }
    }
}

/// Two bodies that fly on a ball joint, turned by a spring across it; the spring's length is one of their coordinates.
const ACROSS_A_BALL: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.8]
[bodies]
base = { mass = 6.8, inertia = [[0.46, 0.043, 0.05], [0.043, 0.57, 0.092], [0.05, 0.092, 0.45]], position = [-1.3, 1.3, -0.24], center_of_mass = [0.37, -0.095, 0.13] }
arm = { mass = 0.49, inertia = [[0.059, 0.0072, 0.0039], [0.0072, 0.071, 0.012], [0.0039, 0.012, 0.067]], position = [-0.74, 2.7, 0.066], center_of_mass = [-0.21, 0.099, -0.13] }
[joints]
ball = { type = "spherical", between = ["base", "arm"], point = [-1.2, 2.2, 0.7] }
[forces.spring]
type = "tsda"
between = ["base", "arm"]
points = [[-0.88, -1.2, 0.24], [-0.25, -0.56, -0.32]]
free_length = 1.6
force = { x = [-1.0, -0.1, 0.0, 0.1, 1.0], y = [-420.0, -280.0, 0.0, 280.0, 420.0] }
damping = 1.6
[initial.bodies]
base = { velocity = [1.3, 4.9, -1.9], angular_velocity = [4.2, -0.89, -0.78] }
arm = { angular_velocity = [-3.6, -0.83, 3.0] }
"#;

#[test] // independent truth: coordinates of the ground in Cartesian form, which know no references
fn references_of_a_multistep_formula_move_where_the_same_coordinates_serve_better_from_there() {
    let model = model_of(ACROSS_A_BALL);
    let ground = Options {
        parametrization: ParametrizationKind::Partitioning,
        ..with(Coordinates::Cartesian, Code::Dopri5, 1e-10, 0.6)
    };
    let truth = end(&model, &ground, None).end;
    for form in [Coordinates::Cartesian, Coordinates::Joint] {
        for tolerance in [1e-4, 1e-6] {
            let found = end(&model, &with(form, Code::Deabm, tolerance, 0.6), None).end;
            let [q, v, _] = apart(&truth, &found);
            assert!(
                q < 20.0 * tolerance && v < 40.0 * tolerance,
                "{tolerance:e}: {q:.1e}, {v:.1e}"
            );
        }
    }
}

#[test] // truth: the run with fewer rows, bit for bit
fn rows_are_told_by_the_references_that_moved_last() {
    let text = ACROSS_A_BALL.replace(
        "force = { x = [-1.0, -0.1, 0.0, 0.1, 1.0], y = [-420.0, -280.0, 0.0, 280.0, 420.0] }",
        "stiffness = 2800.0",
    );
    let model = model_of(&text);
    for form in [Coordinates::Cartesian, Coordinates::Joint] {
        let run = |interval: f64| {
            let output = OutputTimes::Interval(interval);
            end(&model, &Options { output, ..with(form, Code::Deabm, 1e-4, 0.6) }, None)
        };
        let (few, many) = (run(0.06), run(3e-5));
        assert_eq!(few.statistics.steps, many.statistics.steps);
        assert_eq!(few.end.q, many.end.q);
    }
}
