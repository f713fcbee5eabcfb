//! Second runs: what asks for one, what they are held against, and what is told of them.

use crate::amplified_errors::{AMPLIFIED, RIGHT, TOLERANCE, WRONG, asked, standing, warned};
use crate::common::integrate::tight;
use crate::common::table::{all_codes, times};
use crate::common::{model_of, options, run_model};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::Model;
use holonom::simulation::{Options, OutputTimes, RunWarning};

#[test] // independent truth: the same run by a tolerance of 1e-9
fn what_is_fast_after_the_run_has_become_suspicious_is_held_against_its_own_speed() {
    // A bar that swings far asks for the second run, long before a torque sets the rotor on its spring in motion.
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
bar = { mass = 1.0, inertia = 0.1, position = [0.0, -0.5] }
rotor = { mass = 1.0, inertia = 1.0, position = [3.0, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "bar"], point = [0.0, 0.0] }
shaft = { type = "revolute", between = ["ground", "rotor"], point = [3.0, 0.0] }
[initial.joints]
hinge = { angle = 2.5 }
[forces]
spring = { type = "rsda", between = ["ground", "rotor"], stiffness = 1e4 }
shock = { type = "torque", on = "rotor", torque = { type = "smooth_step", from = 0.0, to = 2e5, start = 18.0, end = 18.02 } }
"#,
    );
    let asked = |code: Code, tolerance: f64| Options {
        channels: vec!["rotor.angular_velocity".to_owned()],
        output: OutputTimes::Interval(0.02),
        ..options(code, tolerance, 20.0)
    };
    let truth = run_model(&model, &asked(DEFAULT_CODE, 1e-9));
    let truth = truth.series("rotor.angular_velocity", 0);
    let fastest = truth.iter().fold(0.0f64, |most, v| most.max(v.abs()));
    for (code, tolerance) in [(Code::ForSdirk, 1e-5), (DEFAULT_CODE, 1e-3)] {
        let outcome = run_model(&model, &asked(code, tolerance));
        let velocities = outcome.series("rotor.angular_velocity", 0);
        let off = velocities.iter().zip(&truth).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
        let error = off / (tolerance * (1.0 + fastest));
        assert!(error < RIGHT, "{code:?}: {error} tolerances");
        let vain = |w: &RunWarning| w.message.contains("the velocity of `rotor`");
        assert!(!outcome.summary.warnings.iter().any(vain), "{:?}", outcome.summary.warnings);
    }
}

#[test] // independent truth: the run by another formula at 1e-12, whose steps are not limited
fn what_limited_steps_leave_is_found_by_shorter_ones() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
upper = { mass = 1.0, inertia = 0.02, position = [0.25, 0.0] }
lower = { mass = 1.0, inertia = 0.02, position = [0.75, 0.0] }
[joints]
shoulder = { type = "revolute", between = ["ground", "upper"], point = [0.0, 0.0] }
elbow = { type = "revolute", between = ["upper", "lower"], point = [0.5, 0.0] }
[initial.bodies]
upper = { angular_velocity = 3.0 }
"#,
    );
    let places = |options: Options| {
        let channels = vec!["lower.position".to_owned()];
        let output = OutputTimes::Interval(0.5);
        let outcome = run_model(&model, &Options { channels, output, ..options });
        let series = [0, 1].map(|k| outcome.series("lower.position", k));
        (series, outcome.summary)
    };
    let (truth, _) = places(options(Code::Dopri5, 1e-12, 25.0));
    let limited = Options { max_step: 0.005, ..options(Code::Dop853, 1e-3, 25.0) };
    let (found, summary) = places(limited);
    let off = found.iter().flatten().zip(truth.iter().flatten()).map(|(a, b)| (a - b).abs());
    let off = off.fold(0.0, f64::max) / 1e-3;
    assert!(off > WRONG && warned(&summary), "{off:.0} tolerances: {:?}", summary.warnings);
}

#[test] // independent truth: by construction
fn a_second_run_that_does_not_end_is_told() {
    // Suspicious, but off by less than what is far, so that the second run goes on until it is stopped.
    let told = [0.3, 0.2, 0.15, 0.1].into_iter().find_map(|lean| {
        let model = standing(lean);
        let whole = run_model(&model, &asked(DEFAULT_CODE, 12.0)).summary;
        let s = whole.statistics;
        // Enough for the first run alone.
        let attempts = s.steps + s.rejected_error + s.rejected_newton + s.rejected_evaluation;
        let options = Options { max_steps: attempts, ..asked(DEFAULT_CODE, 12.0) };
        let found = run_model(&model, &options).summary.warnings;
        found.into_iter().find(|warning| !warned(&whole) && warning.code == AMPLIFIED)
    });
    let told = told.expect("one");
    for part in ["did not reach its end", "max_steps"] {
        assert!(told.message.contains(part), "{}", told.message);
    }
}

#[test] // truth: the motion is chaotic, so that a longer run is no nearer to it
fn a_longer_chaotic_run_keeps_its_warning() {
    let pendulum = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
upper = { mass = 1.0, inertia = 0.0833, position = [0.5, 0.0] }
lower = { mass = 1.0, inertia = 0.0833, position = [1.5, 0.0] }
[joints]
pivot = { type = "revolute", between = ["ground", "upper"], point = [0.0, 0.0] }
elbow = { type = "revolute", between = ["upper", "lower"], point = [1.0, 0.0] }
"#,
    );
    for end in [20.0, 300.0] {
        let options =
            Options { output: OutputTimes::Interval(end), ..options(DEFAULT_CODE, TOLERANCE, end) };
        assert!(warned(&run_model(&pendulum, &options).summary), "{end} s");
    }
}

/// A crank that goes round at 5 rad/s from this angle, coupler and rocker, which lie on one line with the ground but for `missed`, m: there the
/// rocker's velocity changes its sign within 1e-3 s or so.
fn change_point(missed: f64, crank: f64) -> Model {
    let (a, b, d) = (0.3, 0.8, 1.0);
    let c = a + d - b + missed;
    let pivot = [d, 0.0];
    let pin = [a * crank.cos(), a * crank.sin()];
    let [x, y] = [pivot[0] - pin[0], pivot[1] - pin[1]];
    let length = x.hypot(y);
    let along = (length * length + b * b - c * c) / (2.0 * length);
    let across = (b * b - along * along).sqrt();
    let joint =
        [pin[0] + (along * x - across * y) / length, pin[1] + (along * y + across * x) / length];
    let bar = |name: &str, from: [f64; 2], to: [f64; 2]| {
        let [x, y] = [to[0] - from[0], to[1] - from[1]];
        let place = [0.5 * (from[0] + to[0]), 0.5 * (from[1] + to[1])];
        let (inertia, angle) = ((x * x + y * y) / 12.0, y.atan2(x));
        format!(
            "{name} = {{ mass = 1.0, inertia = {inertia:e}, position = {place:?}, angle = {angle:e} }}\n"
        )
    };
    let hinge = |name: &str, between: [&str; 2], point: [f64; 2]| {
        format!("{name} = {{ type = \"revolute\", between = {between:?}, point = {point:?} }}\n")
    };
    let bodies =
        [bar("crank", [0.0; 2], pin), bar("coupler", pin, joint), bar("rocker", joint, pivot)];
    let joints = [
        hinge("shaft", ["ground", "crank"], [0.0; 2]),
        hinge("pin", ["crank", "coupler"], pin),
        hinge("joint", ["coupler", "rocker"], joint),
        hinge("pivot", ["ground", "rocker"], pivot),
    ];
    model_of(&format!(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\n{}[joints]\n{}[initial.joints]\n\
         shaft = {{ angular_velocity = 5.0 }}\n",
        bodies.concat(),
        joints.concat()
    ))
}

#[test] // independent truth: the same run by a tolerance of 1e-9
fn velocities_that_are_off_for_moments_are_not_warned_of() {
    const ROWS: u32 = 1000;
    let asked = |tolerance| Options {
        channels: vec!["rocker.angular_velocity".to_owned(), "rocker.angle".to_owned()],
        output: OutputTimes::Interval(4.0 / f64::from(ROWS)),
        ..options(DEFAULT_CODE, tolerance, 4.0)
    };
    let (mut off_for_moments, mut off_for_longer) = (0, 0);
    // How far a step ends from the change point is a matter of where the crank starts: of 252 runs from 21 angles 20 are off
    // in a hundredth of the rows or more.
    let starts = [1.1, 1.3].into_iter();
    for (missed, crank) in starts.flat_map(|crank| [1e-5, 1e-6, 1e-7].map(|missed| (missed, crank)))
    {
        let model = change_point(missed, crank);
        let truth = run_model(&model, &asked(1e-9));
        for tolerance in [1e-3, 1e-4, 1e-5, 1e-6] {
            let outcome = run_model(&model, &asked(tolerance));
            let errors = |channel: &str, scale: f64| -> Vec<f64> {
                let (found, truth) = (outcome.series(channel, 0), truth.series(channel, 0));
                let apart = found.iter().zip(&truth).map(|(a, b)| (a - b).abs());
                apart.map(|error| error / (tolerance * scale)).collect()
            };
            let fastest = truth.series("rocker.angular_velocity", 0);
            let fastest = fastest.iter().fold(0.0f64, |most, v| most.max(v.abs()));
            let angle = errors("rocker.angle", 1.0).into_iter().fold(0.0, f64::max);
            assert!(angle < RIGHT, "{missed:e} m, {tolerance:e}: {angle}");
            let velocities = errors("rocker.angular_velocity", 1.0 + fastest);
            let off = velocities.iter().filter(|&&error| error > RIGHT).count();
            assert!(off < ROWS as usize / 20, "{missed:e} m, {tolerance:e}: {off} rows");
            off_for_longer += usize::from(off >= ROWS as usize / 100);
            off_for_moments += usize::from(off > 0);
            assert!(!warned(&outcome.summary), "{missed:e} m, {tolerance:e}: {off} rows");
        }
    }
    assert!(off_for_moments > 3, "{off_for_moments}");
    assert!(off_for_longer <= 2, "{off_for_longer} of 24");
}

/// A rod upright on a hinge with a spring and a damper, started 1e-3 rad off, whose load at the tip grows past what the spring
/// holds: it stands the straighter for 20 s, and longer steps, and buckles then.
const BUCKLES: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
rod = { mass = 1.0, inertia = 0.75, position = [0.0, 0.5] }
[joints]
hinge = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
[forces]
spring = { type = "rsda", between = ["ground", "rod"], stiffness = 10.0, damping = 2.0 }
load = { type = "point_force", on = "rod", point = [0.0, 1.0], force = [0.0, { type = "polynomial", coefficients = [0.0, -0.5] }] }
[initial.joints]
hinge = { angle = 1e-3 }
"#;

#[test] // independent truth: its one equation by DOP853
fn what_starts_to_grow_while_steps_are_long_is_warned_of() {
    const END: f64 = 60.0;
    let rate = |t: f64, y: &[f64]| vec![y[1], -10.0 * y[0] - 2.0 * y[1] + 0.5 * t * y[0].sin()];
    let times = times(END, 200);
    let truth = tight(&rate, &[1e-3, 0.0], &times);
    let model = model_of(BUCKLES);
    for code in all_codes() {
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-5, 1e-6] {
            let asked = Options {
                channels: vec!["hinge.angle".to_owned()],
                output: OutputTimes::Interval(END / 200.0),
                ..options(code, tolerance, END)
            };
            let outcome = run_model(&model, &asked);
            let angles = outcome.series("hinge.angle", 0);
            let off = angles.iter().zip(&truth).map(|(angle, y)| (angle - y[0]).abs() / tolerance);
            let worst = off.fold(0.0, f64::max);
            let tells = ["simulation/amplified-error", "simulation/energy-imbalance"];
            let told = outcome.summary.warnings.iter().any(|w| tells.contains(&w.code));
            assert!(worst < 50.0 || told, "{code:?} at {tolerance:e}: {worst:.0} tolerances");
        }
    }
}
