//! Angles over many turns: joints and rotational springs in space, driven and free.

use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::model::Model;
use holonom::simulation::{Options, OutputTimes};
use std::f64::consts::TAU;

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
