//! Angles over many turns: joints and rotational springs in space, driven and free.

use crate::common::integrate::tight;
use crate::common::table::all_codes;
use crate::common::{model_of, options, run_model};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::{Model, Tolerance};
use holonom::reduction::{Coordinates, ParametrizationKind};
use holonom::simulation::{Options, OutputTimes};
use std::f64::consts::{PI, TAU};

/// A wheel on the x axis of a frame that stands askew, turned by `motion`, with a rotational spring
/// along the bearing and one that measures the other way round.
fn driven(motion: &str) -> Model {
    model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
wheel = {{ mass = 1.0, inertia = [[0.2, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.0, 0.0, 0.0] }}
[joints]
bearing = {{ type = "revolute", between = ["ground", "wheel"], point = [0.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
[drivers]
turn = {{ joint = "bearing", coordinate = "rotation", motion = {motion} }}
[forces]
coil = {{ type = "rsda", between = ["ground", "wheel"], axis = [1.0, 0.0, 0.0], stiffness = 3.0 }}
mirror = {{ type = "rsda", between = ["wheel", "ground"], axis = [1.0, 0.0, 0.0], stiffness = 1.0 }}
"#
    ))
}

fn with_output(end: f64, rows: f64, channels: &[&str]) -> Options {
    Options {
        output: OutputTimes::Interval(end / rows),
        channels: channels.iter().map(|&name| name.to_owned()).collect(),
        ..options(Code::ForSdirk, 1e-6, end)
    }
}

#[test] // independent truth: the driver's motion
fn a_driven_angle_starts_with_the_turns_of_its_driver() {
    // 7 rad is more than a turn; 40 rad/s is more than half a turn per step of a kinematic run.
    for (start, rate) in [(7.0, 2.0), (7.0, -3.0), (-7.0, 40.0), (3.2, 0.0)] {
        let motion =
            format!(r#"{{ type = "polynomial", coefficients = [{start:.1}, {rate:.1}] }}"#);
        let channels =
            ["bearing.angle", "coil.angle", "coil.torque", "mirror.angle", "energy.imbalance"];
        let outcome = run_model(&driven(&motion), &with_output(20.0, 100.0, &channels));
        let series = |name: &str| outcome.series(name, 0);
        for (k, t) in outcome.times().iter().enumerate() {
            let angle = start + rate * t;
            assert!((series("bearing.angle")[k] - angle).abs() < 1e-9, "{start} {rate} {t}");
            assert!((series("coil.angle")[k] - angle).abs() < 1e-9, "{start} {rate} {t}");
            assert!((series("mirror.angle")[k] + angle).abs() < 1e-9, "{start} {rate} {t}");
            assert!((series("coil.torque")[k] - 3.0 * angle).abs() < 1e-8, "{start} {rate} {t}");
            // The driver winds up both springs: ½ (3 + 1) (θ² − θ₀²).
            let work = 2.0 * (angle * angle - start * start);
            assert!(series("energy.imbalance")[k].abs() <= 1e-8 * work.abs().max(1.0), "{t}");
        }
    }
}

#[test]
fn a_driven_run_goes_on_with_its_turns() {
    let model = driven(r#"{ type = "polynomial", coefficients = [7.0, 2.0] }"#);
    let part = run_model(&model, &with_output(3.0, 10.0, &["coil.angle"])).summary.end;
    let rest =
        crate::common::run_from(&model, &with_output(6.0, 10.0, &["coil.angle"]), Some(&part));
    for (t, angle) in rest.times().iter().zip(rest.series("coil.angle", 0)) {
        assert!((angle - (7.0 + 2.0 * t)).abs() < 1e-9);
    }
}

#[test] // independent truth: the driver's motion
fn a_driven_angle_keeps_its_turns_in_every_chart() {
    // A block rests on its spring, so that steps are as long as may be.
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 9.0, inertia = 1.0, position = [0.0, 0.0] }
rotor = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
shaft = { type = "revolute", between = ["block", "rotor"], point = [0.0, 0.0] }
[drivers]
motor = { joint = "shaft", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 10.0, -0.05] } }
[forces]
mount = { type = "tsda", between = ["ground", "block"], points = [[0.0, -1.0], [0.0, 0.0]], stiffness = 1000.0, free_length = 1.0 }
"#,
    );
    for parametrization in [
        ParametrizationKind::Tree,
        ParametrizationKind::Partitioning,
        ParametrizationKind::TangentPlane,
        ParametrizationKind::TangentPlaneSvd,
    ] {
        for code in all_codes() {
            let asked = Options {
                code,
                parametrization,
                tolerance: Tolerance::uniform(1e-3),
                ..with_output(60.0, 60.0, &["shaft.angle"])
            };
            let outcome = run_model(&model, &asked);
            for (t, angle) in outcome.times().iter().zip(outcome.series("shaft.angle", 0)) {
                let truth = 10.0 * t - 0.05 * t * t;
                let name = parametrization.name();
                assert!((angle - truth).abs() < 1e-9, "{name} {code:?} {t}: {angle}");
            }
        }
    }
}

/// A rod on a pin about z, spun over the top.
fn pendulum(
    dimension: &str,
    vector: fn([&str; 2]) -> String,
    rate: &str,
    inertia: &str,
    axis: &str,
) -> Model {
    model_of(&format!(
        r#"
holonom = 1
dimension = "{dimension}"
gravity = {}
[bodies]
rod = {{ mass = 2.0, inertia = {inertia}, position = {} }}
[joints]
pin = {{ type = "revolute", between = ["ground", "rod"], point = {}{axis} }}
[initial.bodies]
rod = {{ angular_velocity = {rate} }}
"#,
        vector(["0.0", "-9.81"]),
        vector(["0.8", "0.0"]),
        vector(["0.0", "0.0"]),
    ))
}

#[test] // independent truth: the planar model, whose coordinate is the angle itself
fn a_free_angle_counts_turns_in_space_as_in_the_plane() {
    let planar = pendulum("planar", |[x, y]| format!("[{x}, {y}]"), "9.0", "0.1", "");
    let spatial = pendulum(
        "spatial",
        |[x, y]| format!("[{x}, {y}, 0.0]"),
        "[0.0, 0.0, 9.0]",
        "[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]",
        ", axis = [0.0, 0.0, 1.0]",
    );
    let options = with_output(10.0, 50.0, &["pin.angle"]);
    let [flat, deep] = [planar, spatial].map(|model| run_model(&model, &options));
    let (flat, deep) = (flat.series("pin.angle", 0), deep.series("pin.angle", 0));
    assert!(deep.last().unwrap() > &(5.0 * TAU), "{deep:?}");
    for (a, b) in flat.iter().zip(&deep) {
        assert!((a - b).abs() < 1e-3, "{a} {b}");
    }
}

/// Two shafts whose axes meet at an angle `bend`, rad, on a universal joint; the second one has this moment of inertia, kg m²; the first
/// one turns at `rate`, rad/s, and a constant torque acts on it, N m.
fn hooke(rate: f64, bend: f64, inertia: f64, torque: f64) -> Model {
    let (s, c) = bend.sin_cos();
    model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
[bodies]
first = {{ mass = 5.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [-0.2, 0.0, 0.0] }}
second = {{ mass = 1e-3, inertia = [[{inertia:e}, 0.0, 0.0], [0.0, {inertia:e}, 0.0], [0.0, 0.0, {inertia:e}]], position = [{x:e}, 0.0, {z:e}] }}
[joints]
inlet = {{ type = "revolute", between = ["ground", "first"], point = [-0.2, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
cross = {{ type = "universal", between = ["first", "second"], point = [0.0, 0.0, 0.0], axes = [[0.0, 1.0, 0.0], [{s:e}, 0.0, {minus:e}]] }}
outlet = {{ type = "revolute", between = ["ground", "second"], point = [{x:e}, 0.0, {z:e}], axis = [{c:e}, 0.0, {s:e}] }}
[forces]
drive = {{ type = "torque", on = "first", axis = [1.0, 0.0, 0.0], torque = {torque:.1} }}
[initial.joints]
inlet = {{ angular_velocity = {rate:.1} }}
"#,
        x = 0.3 * c,
        z = 0.3 * s,
        minus = -c,
    ))
}

#[test] // independent truth: Hooke's tan φ₂ = cos β tan φ₁, or its inverse
fn no_turn_of_a_shaft_in_a_loop_is_lost() {
    for bend in [5.0f64, 20.0, 45.0, 75.0].map(f64::to_radians) {
        for (rate, inertia) in [(3.0, 1e-9), (60.0, 1e-3), (-300.0, 1e-9)] {
            let model = hooke(rate, bend, inertia, 0.0);
            for (code, coordinates, choice) in [
                (DEFAULT_CODE, Coordinates::Joint, ParametrizationKind::Tree),
                (DEFAULT_CODE, Coordinates::Cartesian, ParametrizationKind::Tree),
                (DEFAULT_CODE, Coordinates::Cartesian, ParametrizationKind::Partitioning),
                (Code::Dopri5, Coordinates::Joint, ParametrizationKind::Tree),
                (Code::SspTrap, Coordinates::Joint, ParametrizationKind::Tree),
            ] {
                let options = Options {
                    coordinates,
                    parametrization: choice,
                    output: OutputTimes::Interval(0.02),
                    channels: ["inlet.angle", "outlet.angle"].map(String::from).to_vec(),
                    ..options(code, 1e-2, 2.0)
                };
                let outcome = run_model(&model, &options);
                let off = |ratio: f64| {
                    let angles = outcome.series("inlet.angle", 0);
                    let pairs = angles.iter().zip(outcome.series("outlet.angle", 0));
                    let errors = pairs.map(|(&first, second)| {
                        let angle = (ratio * first.sin()).atan2(first.cos());
                        (second - angle - TAU * ((first - angle) / TAU).round()).abs()
                    });
                    errors.fold(0.0, f64::max)
                };
                let off = off(bend.cos()).min(off(1.0 / bend.cos()));
                let case = format!("{bend:.2} rad, {rate} rad/s, {inertia:e} kg m²");
                assert!(off < 1e-6, "{case}, {code:?}, {coordinates:?}, {choice:?}: {off}");
            }
        }
    }
}

#[test] // independent truth: as above, of shafts that a torque sets in motion
fn no_turn_of_a_shaft_that_is_sped_up_is_lost() {
    let bend = 0.3f64;
    for torque in [10.0, 100.0] {
        let model = hooke(0.0, bend, 1e-6, torque);
        for coordinates in [Coordinates::Joint, Coordinates::Cartesian] {
            for tolerance in [1e-2, 1e-3] {
                let options = Options {
                    coordinates,
                    output: OutputTimes::Interval(0.01),
                    channels: ["inlet.angle", "outlet.angle"].map(String::from).to_vec(),
                    ..options(DEFAULT_CODE, tolerance, 1.0)
                };
                let outcome = run_model(&model, &options);
                let angles = ["inlet.angle", "outlet.angle"].map(|name| outcome.series(name, 0));
                for (first, second) in angles[0].iter().zip(&angles[1]) {
                    // By how much the second shaft may lead or lag: less than half of the bend's square.
                    assert!(
                        (first - second).abs() < 0.5 * bend * bend,
                        "{torque}: {first} {second}"
                    );
                }
            }
        }
    }
}

#[test] // independent truth: 105 rad are 117 steps of 0.9 rad
fn shafts_with_two_cardan_joints_turn_far_in_a_step() {
    let (s, c) = 20.0f64.to_radians().sin_cos();
    let at = |length: f64, x: f64| format!("[{:e}, 0.0, {:e}]", length * c + x, length * s);
    let middle = "mass = 2.0, inertia = [[0.004, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.03]]";
    let turned = "axis_angle = { axis = [0.0, -1.0, 0.0], angle = 0.3490658503988659 }";
    let across = format!("[{:e}, 0.0, {c:e}]", -s);
    let text = format!(
        r#"
holonom = 1
dimension = "spatial"
[bodies]
inlet = {{ mass = 5.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [-0.2, 0.0, 0.0] }}
tube = {{ {middle}, position = {}, {turned} }}
rod = {{ {middle}, position = {}, {turned} }}
outlet = {{ mass = 5.0, inertia = [[0.2, 0.0, 0.0], [0.0, 0.15, 0.0], [0.0, 0.0, 0.15]], position = {end} }}
[joints]
near = {{ type = "revolute", between = ["ground", "inlet"], point = [-0.2, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
first = {{ type = "universal", between = ["inlet", "tube"], point = [0.0, 0.0, 0.0], axes = [[0.0, 1.0, 0.0], {across}] }}
spline = {{ type = "translational", between = ["tube", "rod"], point = {}, axis = [{c:e}, 0.0, {s:e}] }}
second = {{ type = "universal", between = ["rod", "outlet"], point = {}, axes = [{across}, [0.0, 1.0, 0.0]] }}
far = {{ type = "revolute", between = ["ground", "outlet"], point = {end}, axis = [1.0, 0.0, 0.0] }}
[forces]
load = {{ type = "rsda", between = ["ground", "outlet"], axis = [1.0, 0.0, 0.0], damping = 0.05 }}
[initial.joints]
near = {{ angular_velocity = 60.0 }}
"#,
        at(0.15, 0.0),
        at(0.45, 0.0),
        at(0.3, 0.0),
        at(0.6, 0.0),
        end = at(0.6, 0.3),
    );
    let model = model_of(&text);
    for coordinates in [Coordinates::Joint, Coordinates::Cartesian] {
        let options = Options { coordinates, ..options(DEFAULT_CODE, 1e-3, 2.0) };
        let s = run_model(&model, &options).summary.statistics;
        // 275 and 272 refused where a first correction by new factors was held against one by old ones.
        assert!(s.steps <= 150, "{coordinates:?}: {} steps", s.steps);
        assert!(s.rejected_evaluation <= 5, "{coordinates:?}: {} refused", s.rejected_evaluation);
    }
}

/// More rubber, whose moment turns over at half a turn; it takes little energy.
pub(crate) const BRANCH: &str = ", branches = { slow = { rotational_stiffness = [0.0, 0.0, 0.01], \
                                 rotational_damping = [0.0, 0.0, 0.1] } }";

/// A body that spins at 8 rad/s on rubber with this rotational stiffness about its axis, N m/rad, and more of it.
pub(crate) fn on_rubber(stiffness: f64, more: &str) -> Model {
    model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
disc = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.0, 0.0, 0.0] }}
[forces]
rubber = {{ type = "bushing", between = ["ground", "disc"], point = [0.0, 0.0, 0.0], stiffness = [50.0, 50.0, 50.0], rotational_stiffness = [0.0, 0.0, {stiffness}]{more} }}
[initial.bodies]
disc = {{ angular_velocity = [0.0, 0.0, 8.0] }}
"#
    ))
}

#[test] // independent truth: ½ k (2 sin ½θ)² is 2 k at half a turn, and the disc has 3.2 J; k sin θ is smooth there
fn a_bushing_that_turns_over_at_half_a_turn_is_told() {
    for code in all_codes() {
        for (stiffness, more, expected) in
            [(1.5, BRANCH, true), (1.7, BRANCH, false), (1.5, "", false)]
        {
            let options = Options { max_steps: 100_000, ..options(code, 1e-4, 1.5) };
            let summary = run_model(&on_rubber(stiffness, more), &options).summary;
            let told: Vec<_> =
                summary.warnings.iter().filter(|w| w.code == "simulation/turned-over").collect();
            assert_eq!(told.len(), usize::from(expected), "{code:?} {stiffness}{more}");
            assert!(told.iter().all(|w| w.message.contains("`rubber`")), "{told:?}");
        }
    }
}

#[test] // independent truth: θ̈ = −k sin θ / J of a disc that comes to rest beyond half a turn, by DOP853
fn what_does_not_turn_over_is_as_exact_beyond() {
    let (stiffness, inertia) = (1.5, 0.1);
    let rate = |_: f64, y: &[f64]| vec![y[1], -stiffness * y[0].sin() / inertia];
    let truth = tight(&rate, &[0.0, 8.0], &[1.5]).remove(0);
    for code in all_codes() {
        let options = Options {
            channels: vec!["disc.euler_parameters".to_owned()],
            output: OutputTimes::Listed(vec![1.5]),
            max_steps: 100_000,
            ..options(code, 1e-4, 1.5)
        };
        let run = run_model(&on_rubber(stiffness, ""), &options);
        let [cosine, sine] =
            [0, 3].map(|k| *run.series("disc.euler_parameters", k).last().unwrap());
        let off = (2.0 * sine.atan2(cosine) - truth[0] + PI).rem_euclid(TAU) - PI;
        assert!(off.abs() < 30.0 * 1e-4 * PI, "{code:?}: {off:.1e} rad");
    }
}
