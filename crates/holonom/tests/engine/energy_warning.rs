//! The warning of an energy balance that does not close, on a model whose imbalance is known.
//!
//! Newmark's formula with γ > ½ damps an undamped oscillator: at a fixed step the energy that is lost
//! follows from the recurrence of one scalar, written out here.

use crate::common::integrate::tight;
use crate::common::table::all_codes;
use crate::common::{model_of, options, run_model};
use holonom::method::{Code, Newmark};
use holonom::model::{Model, Tolerance};
use holonom::simulation::{Options, OutputTimes, Summary};

/// s
const STEP: f64 = 0.01;
/// Mass, kg; of two bodies tied to each other 1/(1/m₁ + 1/m₂) is the same.
const MASS: f64 = 2.0;
/// N/m
const STIFFNESS: f64 = 200.0;
/// m
const STRETCH: f64 = 0.1;
const NEWMARK: Newmark = Newmark { gamma: 0.501, beta: 0.2505 };

/// A block on the ground's rail, and its twin: two blocks that fly at 300 m/s, tied to each other.
fn oscillators() -> [Model; 2] {
    let on_rail = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 2.0, inertia = 0.1, position = [0.1, 0.0] }
[joints]
rail = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "block"], points = [[-1.0, 0.0], [0.1, 0.0]], stiffness = 200.0, free_length = 1.0 }
"#;
    let flying = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
sledge = { mass = 3.0, inertia = 0.1, position = [-1.0, 0.0] }
block = { mass = 6.0, inertia = 0.1, position = [0.1, 0.0] }
[joints]
rail = { type = "translational", between = ["sledge", "block"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["sledge", "block"], points = [[-1.0, 0.0], [0.1, 0.0]], stiffness = 200.0, free_length = 1.0 }
[initial]
velocity = [300.0, 0.0]
"#;
    [model_of(on_rail), model_of(flying)]
}

/// Largest energy lost and largest energy moved, J: x and v by Newmark (1959), ẍ = −(k/m) x.
fn known(steps: u32) -> (f64, f64) {
    let Newmark { gamma, beta } = NEWMARK;
    let (h, w2) = (STEP, STIFFNESS / MASS);
    let (mut x, mut v) = (STRETCH, 0.0);
    let kinetic = |v: f64| 0.5 * MASS * v * v;
    let potential = |x: f64| 0.5 * STIFFNESS * x * x;
    let start = potential(x);
    let (mut lost, mut moved, mut lowest) = (0.0f64, 0.0f64, start);
    for _ in 0..steps {
        let a = -w2 * x;
        x = (x + h * v + h * h * (0.5 - beta) * a) / (1.0 + beta * h * h * w2);
        v += h * ((1.0 - gamma) * a - gamma * w2 * x);
        lost = lost.max((kinetic(v) + potential(x) - start).abs());
        lowest = lowest.min(potential(x));
        moved = moved.max(kinetic(v)).max(start - lowest);
    }
    (lost, moved)
}

fn steps_by_newmark(model: &Model, steps: u32, relative: f64) -> Summary {
    let options = Options {
        fixed_step: Some(STEP),
        newmark: Some(NEWMARK),
        tolerance: Tolerance { relative, translation: 1e-6, rotation: 1e-6 },
        ..options(Code::SspTrap, 1e-6, STEP * f64::from(steps))
    };
    run_model(model, &options).summary
}

/// The text of the warning, if it is given.
fn warning(summary: &Summary) -> Option<&str> {
    let mut found = summary.warnings.iter().filter(|w| w.code == "simulation/energy-imbalance");
    found.next().map(|w| w.message.as_str())
}

/// Steps after which about so much of the energy is lost: γ − ½ damps by (γ − ½) ω² h per second.
fn steps_to_lose(share: f64) -> u32 {
    let rate = (NEWMARK.gamma - 0.5) * STIFFNESS / MASS * STEP;
    (share / rate / STEP) as u32
}

#[test] // independent truth: the recurrence of one scalar
fn an_imbalance_is_warned_of_from_half_a_percent_and_from_ten_tolerances() {
    for (share, relative, warns) in [
        (0.0045, 1e-6, false),
        (0.0055, 1e-6, true),
        (0.0055, 1e-3, false), // ten tolerances are 1 %
        (0.009, 1e-3, false),
        (0.011, 1e-3, true),
    ] {
        let steps = steps_to_lose(share);
        let (lost, moved) = known(steps);
        assert!((lost / moved / share - 1.0).abs() < 0.05, "{} of {share}", lost / moved);
        for (model, name) in oscillators().iter().zip(["on a rail", "flying"]) {
            let summary = steps_by_newmark(model, steps, relative);
            let energy = &summary.energy;
            let close = |found: f64, known: f64| (found / known - 1.0).abs() < 1e-4;
            assert!(close(energy.largest_imbalance, lost), "{name}: {energy:?}, known {lost}");
            assert!(close(energy.moved, moved), "{name}: {energy:?}, known {moved}");
            let text = warning(&summary);
            assert_eq!(text.is_some(), warns, "{name}, {share}, {relative}: {text:?}");
            if let Some(text) = text {
                let figures = [format!("{lost:.1e} J"), format!("{moved:.1e} J")];
                assert!(figures.iter().all(|figure| text.contains(figure)), "{text}");
            }
        }
    }
}

#[test] // independent truth: nothing moves, and 1e5 J of height know round-off only
fn a_body_at_rest_high_above_the_origin_is_not_warned_of() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
weight = { mass = 10.0, inertia = 0.1, position = [0.3, 1000.0] }
[joints]
rail = { type = "translational", between = ["ground", "weight"], point = [0.3, 1000.0], axis = [0.0, 1.0] }
[forces]
spring = { type = "tsda", between = ["ground", "weight"], points = [[0.3, 1001.0], [0.3, 1000.0]], stiffness = 9810.0, damping = 10.0, free_length = 0.99 }
"#,
    );
    let summary = run_model(&model, &options(Code::ForRadau, 1e-4, 5.0)).summary;
    assert!(summary.energy.moved < 1e-7, "{:?}", summary.energy);
    assert_eq!(warning(&summary), None, "{:?}", summary.energy);
}

#[test] // truth: an undamped torsional oscillator of 1 rad; within 3 tolerances of 1 rad to either side
fn what_swings_to_and_fro_is_not_taken_for_what_turns() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
disc = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "disc"], point = [0.0, 0.0] }
[forces]
spring = { type = "rsda", between = ["ground", "disc"], stiffness = 10.0 }
[initial.bodies]
disc = { angle = 1.0 }
"#,
    );
    let run = Options {
        channels: vec!["disc.angle".into()],
        output: OutputTimes::Interval(1.0),
        ..options(Code::ForRadau, 1e-4, 60.0)
    };
    let outcome = run_model(&model, &run);
    for (t, angle) in outcome.rows.all.time.iter().zip(&outcome.rows.all.channels[0]) {
        assert!((angle - (10.0 * t).cos()).abs() < 3.0 * 3e-4, "{angle} at {t}");
    }
    assert!(outcome.summary.warnings.is_empty(), "{:?}", outcome.summary.warnings);
}

#[test] // independent truth: M ẍ + c ẋ + k x = m e ω² cos ωt by DOP853
fn what_a_start_has_lost_is_not_taken_for_what_turns() {
    const SPEED: f64 = 60.0;
    const END: f64 = 20.0;
    let model = model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
hub = {{ mass = 1.0, inertia = 0.01, position = [0.0, 0.0] }}
rotor = {{ mass = 2.0, inertia = 0.1, position = [0.0, 0.0], center_of_mass = [0.01, 0.0] }}
[joints]
rail = {{ type = "translational", between = ["ground", "hub"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
shaft = {{ type = "revolute", between = ["hub", "rotor"], point = [0.0, 0.0] }}
[forces]
mount = {{ type = "tsda", between = ["ground", "hub"], points = [[-1.0, 0.0], [0.0, 0.0]], stiffness = 5e5, damping = 100.0, free_length = 1.0 }}
[drivers]
motor = {{ joint = "shaft", coordinate = "rotation", motion = {{ type = "polynomial", coefficients = [0.0, {SPEED:?}] }} }}
"#
    ));
    let times: Vec<f64> = (0..=400).map(|k| END / 400.0 * f64::from(k)).collect();
    let rate = |t: f64, y: &[f64]| {
        let force = 2.0 * 0.01 * SPEED * SPEED * (SPEED * t).cos();
        vec![y[1], (force - 100.0 * y[1] - 5e5 * y[0]) / 3.0]
    };
    let truth = tight(&rate, &[0.0, 0.0], &times);
    for (code, tolerance) in [
        (Code::ForRadau, 1e-3),
        (Code::ForSdirk, 1e-2),
        (Code::ForSdirk, 1e-3),
        (Code::ForSdirk, 1e-4),
    ] {
        let options = Options {
            channels: vec!["hub.position".to_owned()],
            output: OutputTimes::Interval(END / 400.0),
            ..options(code, tolerance, END)
        };
        let outcome = run_model(&model, &options);
        let found = outcome.series("hub.position", 0);
        let off = found.iter().zip(&truth).fold(0.0f64, |most, (x, y)| most.max((x - y[0]).abs()));
        assert!(off < tolerance, "{code:?} at {tolerance:e}: {off:e} m");
        assert_eq!(warning(&outcome.summary), None, "{code:?} at {tolerance:e}");
    }
}

#[test] // independent truth: what nothing bends flies and turns as one rigid body, uniformly
fn what_flies_fast_and_hardly_moves_in_itself_is_not_warned_of() {
    const RATE: f64 = -3.8;
    const END: f64 = 5.0;
    let links = [(0.005, 2.0), (0.0186, 1.5), (0.0389, 0.06)];
    let mass: f64 = links.iter().map(|link| link.1).sum();
    let center: f64 = links.iter().map(|(x, m)| x * m / mass).sum();
    let velocity = |x: f64| [-17.0, -6.0 + RATE * (x - center)];
    let starts = links.map(|(x, _)| velocity(x));
    let model = model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
first = {{ mass = 2.0, inertia = 1.7e-5, position = [0.005, 0.0] }}
second = {{ mass = 1.5, inertia = 3.7e-5, position = [0.0186, 0.0] }}
third = {{ mass = 0.06, inertia = 2.7e-6, position = [0.0389, 0.0] }}
[joints]
elbow = {{ type = "revolute", between = ["first", "second"], point = [0.01, 0.0] }}
wrist = {{ type = "revolute", between = ["second", "third"], point = [0.0272, 0.0] }}
[forces]
elbow_spring = {{ type = "rsda", between = ["first", "second"], stiffness = 12.0 }}
wrist_spring = {{ type = "rsda", between = ["second", "third"], stiffness = 0.08 }}
[initial.bodies]
first = {{ velocity = {:?}, angular_velocity = {RATE:?} }}
second = {{ velocity = {:?}, angular_velocity = {RATE:?} }}
third = {{ velocity = {:?}, angular_velocity = {RATE:?} }}
"#,
        starts[0], starts[1], starts[2]
    ));
    for code in all_codes() {
        for tolerance in [1e-2, 1e-3, 1e-4] {
            let options = Options {
                channels: vec!["third.position".to_owned()],
                output: OutputTimes::Interval(END / 50.0),
                ..options(code, tolerance, END)
            };
            let outcome = run_model(&model, &options);
            let times = &outcome.rows.all.time;
            let (x, y) = (outcome.series("third.position", 0), outcome.series("third.position", 1));
            let arm = links[2].0 - center;
            let off = times.iter().zip(x).zip(y).fold(0.0f64, |most, ((t, x), y)| {
                let (sin, cos) = (RATE * t).sin_cos();
                let dx = x - (center - 17.0 * t + arm * cos);
                let dy = y - (-6.0 * t + arm * sin);
                most.max(dx.hypot(dy))
            });
            // They come to places 90 m away.
            assert!(off < tolerance * 90.0, "{code:?} at {tolerance:e}: {off:e} m");
            assert_eq!(warning(&outcome.summary), None, "{code:?} at {tolerance:e}");
        }
    }
}

#[test] // independent truth: an undamped oscillator keeps its 4.5 J, wherever it stands and flies
fn a_vibration_that_is_lost_is_warned_of_at_any_height_and_speed() {
    let on_guide = |height: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
block = {{ mass = 1.0, inertia = 0.1, position = [0.5, {height:?}] }}
[joints]
guide = {{ type = "translational", between = ["ground", "block"], point = [0.5, {height:?}], axis = [1.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "block"], points = [[-0.5, {height:?}], [0.5, {height:?}]], stiffness = 1e6, free_length = 0.997 }}
"#
        ))
    };
    let flying = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
sledge = { mass = 2.0, inertia = 0.1, position = [-0.5, 0.0] }
block = { mass = 2.0, inertia = 0.1, position = [0.5, 0.0] }
[joints]
rail = { type = "translational", between = ["sledge", "block"], point = [0.5, 0.0], axis = [1.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["sledge", "block"], points = [[-0.5, 0.0], [0.5, 0.0]], stiffness = 1e6, free_length = 0.997 }
[initial]
velocity = [50.0, 0.0]
"#,
    );
    for (name, model) in [("low", on_guide(0.0)), ("high", on_guide(3000.0)), ("flying", flying)] {
        let summary = run_model(&model, &options(Code::ForRadau, 1e-2, 3.0)).summary;
        assert!(summary.energy.largest_imbalance > 2.0, "{name}: {:?}", summary.energy);
        assert!(warning(&summary).is_some(), "{name}: {:?}", summary.energy);
    }
}
