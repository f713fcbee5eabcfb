//! Stops, contacts and bumps that a step could jump over: what flies or turns freely makes steps as long as the run,
//! and the stages of a formula see force laws at a few moments only.
//!
//! Truth: DOPRI5 at 1e-9 whose steps are shorter than any of these passages.

use crate::common::table::{
    Bounds, Case, DEFAULT, Kind, TOLERANCES, Table, all_codes, measure, times, truth,
};
use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes};

/// Longest step of the truth, s.
const FINE: f64 = 1e-3;

/// A block that bounces on a spring; the spring's line begins where the block would fall to, so that a step that
/// misses it finds no force beyond.
const BLOCK: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
block = { mass = 1.0, inertia = 0.01, position = [0.0, 1.6] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
[forces.stop]
type = "tsda"
between = ["ground", "block"]
points_in_body = [[0.0, 0.0], [0.0, 0.0]]
force = { x = [-1.0, 0.0, 0.001, 1.0], y = [-4000.0, 0.0, 0.0, 0.0] }
free_length = 1.0
"#;

/// The same on a stop that reaches as deep as one likes.
const DEEP: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
block = { mass = 1.0, inertia = 0.01, position = [0.0, 1.6] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
[forces.stop]
type = "tsda"
between = ["ground", "block"]
points_in_body = [[0.0, -99.0], [0.0, 0.0]]
force = { x = [-1.0, -0.5, 0.0, 1.0], y = [-4000.0, -2000.0, 0.0, 0.0] }
free_length = 100.0
"#;

/// A slide that passes a detent of 2 cm at 2 m/s.
const DETENT: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
block = { mass = 1.0, inertia = 0.01, position = [0.0, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces.detent]
type = "tsda"
between = ["ground", "block"]
points_in_body = [[-10.0, 0.0], [0.0, 0.0]]
force = { x = [0.0, 2.0, 2.005, 2.01, 2.015, 2.02, 6.0], y = [0.0, 0.0, 150.0, 0.0, -50.0, 0.0, 0.0] }
free_length = 10.0
[initial.bodies]
block = { velocity = [2.0, 0.0] }
"#;

/// A rotor that is pressed on during a seventh of each turn.
const CAM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
rotor = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
axle = { type = "revolute", between = ["ground", "rotor"], point = [0.0, 0.0] }
[forces.cam]
type = "tsda"
between = ["ground", "rotor"]
points_in_body = [[1.2, 0.0], [1.0, 0.0]]
force = { x = [-0.3, -0.2, -0.1, 0.0, 0.05, 3.0], y = [-20.0, -10.0, -5.0, 0.0, 0.0, 0.0] }
free_length = 0.5
[initial.bodies]
rotor = { angle = 2.0, angular_velocity = 10.0 }
"#;

/// A wheel that bounces on the road, hardly damped.
const WHEEL: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
wheel = { mass = 50.0, inertia = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 2.0]], position = [0.0, 0.0, 1.0] }
[roads]
flat = { type = "flat", height = 0.0 }
[forces.tyre]
type = "tyre"
on = "wheel"
point = [0.0, 0.0, 1.0]
radius = 0.4
stiffness = 3.0e5
damping = 20.0
smoothing = 1.0e-3
road = "flat"
[initial.bodies]
wheel = { velocity = [5.0, 0.0, 0.0] }
"#;

/// A wheel that rolls smoothly at 20 m/s over a bump of 20 cm, 1 s ahead.
const BUMP: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
wheel = { mass = 500.0, inertia = [[2.0, 0.0, 0.0], [0.0, 3.0, 0.0], [0.0, 0.0, 2.0]], position = [0.0, 0.0, 0.38365] }
[roads]
bump = { type = "smooth_bump", height = 0.02, half_length = 0.1, center = 20.0 }
[forces.tyre]
type = "tyre"
on = "wheel"
point = [0.0, 0.0, 0.38365]
radius = 0.4
stiffness = 3.0e5
damping = 2000.0
smoothing = 1.0e-3
road = "bump"
[initial.bodies]
wheel = { velocity = [20.0, 0.0, 0.0] }
"#;

/// A door between two stops.
const DOOR: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
door = { mass = 20.0, inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.5]], position = [0.5, 0.0, 0.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "door"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }
[forces.stops]
type = "rsda"
between = ["ground", "door"]
axis = [0.0, 0.0, 1.0]
torque = { x = [-2.0, -1.6, -1.5, 0.0, 1.5, 1.6, 2.0], y = [-6000.0, -1200.0, 0.0, 0.0, 0.0, 1200.0, 6000.0] }
[initial.joints]
hinge = { angular_velocity = 1.5 }
"#;

/// A puck that slides past a peg at 1 cm from its way: the length of the line has nearly a cusp there.
fn puck(start: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
puck = {{ mass = 1.0, inertia = 0.01, position = [0.0, 0.0] }}
[joints]
guide = {{ type = "translational", between = ["ground", "puck"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
[forces.peg]
type = "tsda"
between = ["ground", "puck"]
points_in_body = [[0.0, 0.01], [0.0, 0.0]]
force = {{ x = [-0.05, -0.03, 0.0, 0.05, 9.0], y = [-2.0, -2.0, 0.0, 0.0, 0.0] }}
free_length = 0.05
[initial.bodies]
puck = {{ position = [{start:?}, 0.0], velocity = [0.917, 0.0] }}
"#
    )
}

/// A case whose truth is computed with short steps.
fn case(text: &str, end: f64, channel: &'static str, size: usize, kind: Kind) -> Case {
    let n = 60;
    let fine = Options {
        channels: vec![channel.to_owned()],
        output: OutputTimes::Interval(end / n as f64),
        max_step: FINE,
        ..options(Code::Dopri5, 1e-9, end)
    };
    let outcome = run_model(&model_of(text), &fine);
    let rows = outcome.rows.all.channels[0].chunks_exact(size).map(<[f64]>::to_vec);
    let case = Case::new(text, end, vec![truth(channel, kind, rows)]);
    assert_eq!(case.truths[0].rows.len(), times(end, n).len());
    Case { max_steps: 60_000, ..case }
}

/// Errors of each bounce add up, and the time of the next one tells of all before it: a nudge grows 20-fold in six
/// seconds of bouncing.
const BOUNDS: Bounds =
    Bounds { position: 150.0, velocity: 150.0, or_warned: true, or_stopped: false };

/// Runs a case by a code and claims that nothing of it is lost.
fn look(table: &mut Table, name: &str, case: &Case, code: Code, tolerance: f64) {
    let run = measure(case, DEFAULT, code, tolerance);
    let line = format!("{name}, {}", code.info().name);
    table.run(&line, &format!("{tolerance:.0e}"), &run, BOUNDS);
    // A step that jumped over something would be off by the size of the motion, warned or not.
    let lost = 0.1 / tolerance;
    table.claim(run.position < lost, || format!("{line}, {tolerance:.0e}: lost"));
}

#[test]
fn nothing_is_jumped_over() {
    let mut table = Table::new("what steps could jump over");
    for (name, case) in [
        ("block on a spring", case(BLOCK, 6.0, "block.position", 2, Kind::Point)),
        ("block on a deep stop", case(DEEP, 6.0, "block.position", 2, Kind::Point)),
        ("detent", case(DETENT, 4.0, "block.position", 2, Kind::Point)),
        ("rotor and cam", case(CAM, 5.0, "rotor.angle", 1, Kind::Angle)),
        ("bouncing wheel", case(WHEEL, 4.0, "wheel.position", 3, Kind::Point)),
        ("bump ahead", case(BUMP, 3.0, "wheel.position", 3, Kind::Point)),
        ("door between stops", case(DOOR, 10.0, "door.position", 3, Kind::Point)),
    ] {
        for code in all_codes() {
            for &tolerance in TOLERANCES {
                look(&mut table, name, &case, code, tolerance);
            }
        }
    }
    table.finish();
}

/// Codes of high order, for which a long flight is one step at any tolerance.
fn of_high_order() -> impl Iterator<Item = Code> {
    all_codes().into_iter().filter(|code| !matches!(code, Code::SspTrap | Code::InflTrap))
}

#[test]
fn nothing_is_jumped_over_wherever_a_step_begins() {
    let mut table = Table::new("a puck past a peg");
    for k in 0..12 {
        let start = -3.9 - 0.2 * f64::from(k);
        let case = case(&puck(start), 10.0, "puck.position", 2, Kind::Point);
        for code in of_high_order() {
            for tolerance in [1e-4, 1e-8] {
                look(&mut table, &format!("from {start}"), &case, code, tolerance);
            }
        }
    }
    table.finish();
}

#[test] // truth: without damping the block rises to its start, 1.6 m, again and again
fn a_block_bounces_for_ever() {
    for code in of_high_order() {
        let long = Options {
            channels: vec!["block.position".to_owned()],
            output: OutputTimes::Interval(0.05),
            ..options(code, 1e-6, 300.0)
        };
        let outcome = run_model(&model_of(BLOCK), &long);
        let heights = outcome.series("block.position", 1);
        let (low, high) =
            heights.iter().fold((f64::INFINITY, 0.0f64), |(l, h), &y| (l.min(y), h.max(y)));
        assert!(low > 0.8 && high < 1.61, "{code:?}: {low} to {high} m");
    }
}
