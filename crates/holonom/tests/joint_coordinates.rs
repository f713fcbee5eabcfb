//! Joint coordinates against Cartesian ones. Independent truth: the equations with every joint as a constraint, which know
//! no tree.

mod common;
#[path = "random/mod.rs"]
mod random;

use common::{LIBRARY, model, model_of, options, run_model};
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::reduction::{Coordinates, Manifold, Point};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, RunError, Status, run};
use holonom::system::State;
use random::{Mechanism, numbers::Random};

/// Largest difference of two vectors against the largest entry.
fn difference(a: &[f64], b: &[f64], least: f64) -> f64 {
    let size = a.iter().chain(b).fold(least, |m, x| m.max(x.abs()));
    a.iter().zip(b).fold(0.0f64, |m, (x, y)| m.max((x - y).abs())) / size
}

/// Two points in the same parametrization, the second one in joint coordinates; none where the tree has lines.
fn points(model: Model) -> Option<([Point; 2], State)> {
    let problem = Problem::new(model);
    let assembled = problem.assemble().ok()?;
    let (cartesian, state) = (assembled.manifold.clone(), assembled.state.clone());
    let mut joint = cartesian.clone();
    joint
        .use_joint_coordinates(&state.q)
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
        point.spread(&change, &rates, &mut dq, &mut dv, &mut vec![0.0; rows], &mut vec![0.0; n]);
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
            // A stiff spring whose direction is a coordinate.
            assert!(matches!(*name, "stiff_slider" | "slider_crank"), "{name} has no joint form");
            continue;
        };
        for _ in 0..20 {
            if let Some(worst) = compare(&mut points, &state, &mut random) {
                assert!(worst.iter().all(|x| *x < 1e-9), "{name}: {worst:?}");
            }
        }
    }
}

#[test]
fn both_forms_agree_on_random_mechanisms() {
    let (mut compared, mut others, mut loops) = (0, 0, 0);
    for seed in 0..400 {
        let text = Mechanism::new(seed, 0.0).text();
        let Some((mut points, state)) = points(model_of(&text)) else {
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
    }
    assert!(compared > 600 && loops > 60, "{compared} states, {loops} with loops, {others} others");
}

fn with(coordinates: Coordinates, code: Code, tolerance: f64, end: f64) -> Options {
    Options {
        coordinates,
        output: OutputTimes::Interval(end / 10.0),
        ..options(code, tolerance, end)
    }
}

#[test] // independent truth: the Cartesian form at the same tolerance
fn every_code_gives_the_same_motion_in_both_forms() {
    for name in ["double_pendulum_w10", "spatial_four_bar", "hmmwv14_bushing"] {
        let model = model(name);
        for info in CODES {
            if info.family == "explicit" && name != "spatial_four_bar" {
                continue;
            }
            let outcome = |coordinates| {
                let outcome = run_model(&model, &with(coordinates, info.code, 1e-5, 0.2));
                assert_eq!(outcome.summary.status, Status::Completed, "{name} {}", info.name);
                outcome.summary
            };
            let (cartesian, joint) = (outcome(Coordinates::Cartesian), outcome(Coordinates::Joint));
            let [a, b] = [&cartesian.end, &joint.end];
            let worst = [
                difference(&a.q, &b.q, 1.0),
                difference(&a.v, &b.v, 1.0),
                difference(&a.lambda, &b.lambda, 1.0),
            ];
            let allowed = [1e-6, 1e-4, 1e-2];
            let agree = worst.iter().zip(allowed).all(|(x, most)| *x <= most);
            assert!(agree, "{name} by {}: {worst:?}", info.name);
            let (one, other) = (cartesian.statistics.steps, joint.statistics.steps);
            assert!(one.abs_diff(other) <= 2 + one / 10, "{name} by {}: {one} {other}", info.name);
        }
    }
}

#[test]
fn what_has_no_joint_form_is_refused_with_the_reason() {
    let options = with(Coordinates::Joint, Code::ForRadau, 1e-4, 0.1);
    let thesis =
        Options { parametrization: holonom::reduction::Choice::Partitioning, ..options.clone() };
    let problem = Problem::new(model("spatial_four_bar"));
    let error = run(&problem, &thesis, None, &mut Memory::default()).expect_err("refused");
    assert!(
        matches!(&error, RunError::Coordinates { reason } if reason.contains("parametrization"))
    );
}
