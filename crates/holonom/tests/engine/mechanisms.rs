//! Models of the library against their references.

use crate::common::{model, reference};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes};

/// Fails when a column differs from the reference by more than `allowed`.
#[track_caller]
fn assert_agrees(name: &str, code: Code, tolerance: f64, allowed: impl Fn(&str) -> f64) {
    let reference = reference(name);
    let outcome = reference.run(&model(name), code, tolerance);
    for (column, difference) in reference.differences(&outcome) {
        let allowed = allowed(&column);
        assert!(
            difference <= allowed,
            "{name} by {code:?} at {tolerance:e}: {column} differs by {difference:.2e}, \
             allowed {allowed:.0e}"
        );
    }
}

#[test] // independent truth: Jacobi elliptic functions
fn the_simple_pendulum_follows_its_exact_solution() {
    for code in crate::common::table::all_codes() {
        assert_agrees("simple_pendulum", code, 1e-9, |_| 1e-6);
    }
}

#[test] // independent truth: minimal coordinates, Radau IIA and DOP853
fn the_stiff_double_pendulum_follows_minimal_coordinates() {
    for name in ["double_pendulum", "double_pendulum_w10", "double_pendulum_rest"] {
        assert_agrees(name, Code::ForSdirk, 1e-9, |_| 1e-7);
    }
}

#[test] // independent truth: 30-digit extrapolation of the published equations
fn andrews_has_its_reference_end_values() {
    let reference = reference("andrews");
    let outcome = reference.run(&model("andrews"), Code::ForSdirk, 1e-10);
    for (((column, _), expected), (_, difference)) in
        reference.columns.iter().zip(&reference.values).zip(reference.differences(&outcome))
    {
        let digits = if column.ends_with("velocity") { 6 } else { 8 };
        // Published are the angles of K2, K4 and K6 from K1, K5 and K7 (Theta, Phi, Omega); the
        // absolute ones nearly cancel.
        let published = match column.as_str() {
            "K2.angle" => 15.756,
            "K4.angle" | "K6.angle" => 0.5347,
            _ => expected[0].abs(),
        };
        let allowed = 0.5 * 10f64.powi(-digits) * published;
        assert!(difference <= allowed, "{column}: {difference:.2e}, allowed {allowed:.2e}");
    }
}

#[test] // independent truth: two equations in elongation and angle, Radau IIA
fn the_stiff_slider_follows_its_polar_coordinates() {
    for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau, Code::SspSdirk15] {
        assert_agrees("stiff_slider", code, 1e-8, |_| 1e-6);
    }
}

#[test] // independent truth: one equation in the crank angle, DOP853
fn the_slider_crank_follows_its_minimal_coordinate() {
    for code in crate::common::table::all_codes() {
        assert_agrees("slider_crank", code, 1e-8, |_| 1e-5);
    }
}

#[test] // independent truth: one equation in the crank angle, DOP853
fn the_spatial_four_bar_follows_its_minimal_coordinate() {
    for code in crate::common::table::all_codes() {
        assert_agrees("spatial_four_bar", code, 1e-8, |_| 1e-5);
    }
}

#[test] // independent truth: minimal coordinates, DOP853
fn the_chains_follow_minimal_coordinates() {
    assert_agrees("chain50", Code::ForSdirk, 1e-8, |_| 1e-6);
    assert_agrees("chain50_free", Code::ForSdirk, 1e-8, |_| 1e-6);
}

/// Fails when chassis height, wheel height (m) or pitch (rad) leave the reference by more than
/// `allowed`.
#[track_caller]
fn assert_vehicle(code: Code, tolerance: f64, end: f64, allowed: f64) {
    let reference = reference("hmmwv14").until(end + 1e-9);
    let outcome = reference.run(&model("hmmwv14"), code, tolerance);
    let bounded = [
        "chassis.position[2]",
        "chassis.yaw_pitch_roll[1]",
        "spindle_front_right.wheel_center.position[2]",
    ];
    let differences = reference.differences(&outcome);
    for (column, difference) in differences.iter().filter(|(c, _)| bounded.contains(&c.as_str())) {
        assert!(*difference <= allowed, "{code:?} at {tolerance:e}: {column} by {difference:.2e}");
    }
    // The bump is there: it lifts the wheel by centimetres.
    let wheel = outcome.series("spindle_front_right.wheel_center.position", 2);
    let (low, high) = wheel.iter().fold((f64::MAX, f64::MIN), |(a, b), &z| (a.min(z), b.max(z)));
    assert!(high - low > 0.02, "the wheel moves by {:.3} m", high - low);
}

#[test] // independent truth: tangent-space coordinates, Radau IIA
fn the_vehicle_follows_its_reference_over_the_bump() {
    for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau] {
        assert_vehicle(code, 1e-3, 2.0, 1e-3);
        assert_vehicle(code, 1e-6, 2.0, 1e-5);
        assert_vehicle(code, 1e-6, 2.5, 1e-4);
    }
}

#[test] // independent truth: bushings of infinite stiffness, 2e7 N/m in the base model
fn the_vehicle_with_bushings_rides_like_the_one_with_stays() {
    let reference = reference("hmmwv14").until(2.0 + 1e-9);
    let outcome = reference.run(&model("hmmwv14_bushing"), Code::ForSdirk, 1e-4);
    let height = reference.differences(&outcome)[1].clone();
    assert_eq!(height.0, "chassis.position[2]");
    assert!(height.1 < 2e-3, "chassis height differs by {:.1e} m", height.1);
}

#[test] // independent truth: the files themselves
fn every_model_runs_as_its_file_says() {
    for name in crate::common::LIBRARY {
        let model = model(name);
        let (stated, outputs) = (&model.simulation, &model.outputs);
        let end = stated.end_time.unwrap_or_else(|| panic!("{name} states no end time"));
        let interval = outputs.interval.unwrap_or_else(|| panic!("{name} states no interval"));
        assert!(!outputs.channels.is_empty() && !model.title.is_empty(), "{name}");
        let mut options = Options::new(end);
        options.tolerance = stated.tolerance.unwrap_or(options.tolerance);
        options.output = OutputTimes::Interval(interval);
        options.channels.clone_from(&outputs.channels);
        let outcome = crate::common::run_model(&model, &options);
        assert_eq!(outcome.times().len(), (end / interval).round() as usize + 1, "{name}");
        assert_eq!(outcome.times().last(), Some(&end), "{name}");
        for channel in &outputs.channels {
            let values = outcome.series(channel, 0);
            assert!(values.iter().all(|x| x.is_finite()), "{name}: {channel}");
        }
    }
}

/// The N four-bar mechanism of the IFToMM library (problem A02) for N = 2: three upright rods of
/// 1 m, joined by two horizontal ones. It passes positions in which all rods lie in one line.
fn two_four_bars() -> String {
    let mut text = String::from(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n[initial.bodies]\n\
         upright_0 = { angular_velocity = -1.0 }\n[bodies]\n",
    );
    let rod = |name: String, x: f64, y: f64| {
        format!(
            "{name} = {{ mass = 1.0, inertia = 0.08333333333333333, position = [{x:?}, {y:?}] }}\n"
        )
    };
    let pin = |name: String, first: String, second: String, x: i32, y: i32| {
        format!(
            "{name} = {{ type = \"revolute\", between = [\"{first}\", \"{second}\"], \
             point = [{x}.0, {y}.0] }}\n"
        )
    };
    for k in 0..3 {
        text += &rod(format!("upright_{k}"), f64::from(k), 0.5);
    }
    for k in 1..3 {
        text += &rod(format!("bar_{k}"), f64::from(k) - 0.5, 1.0);
    }
    text += "[joints]\n";
    for k in 0..3 {
        text += &pin(format!("foot_{k}"), "ground".into(), format!("upright_{k}"), k, 0);
    }
    for k in 1..3 {
        let (left, bar) = (format!("upright_{}", k - 1), format!("bar_{k}"));
        text += &pin(format!("left_{k}"), left, bar.clone(), k - 1, 1);
        text += &pin(format!("right_{k}"), format!("upright_{k}"), bar, k, 1);
    }
    text
}

#[test] // independent truth: the one equation of the parallelogram branch, DOP853
fn the_four_bars_pass_their_singular_positions_on_the_same_branch() {
    let model = crate::common::model_of(&two_four_bars());
    // x of the upper end of the first rod, twice that of its middle, at 1, 2, … 8 s
    let expected = [
        -0.19502030194949888,
        0.05781579576768689,
        -0.5493397392986787,
        0.11761610237563318,
        -0.8113104610002243,
        0.18138112622086816,
        -0.9582707548885849,
        0.2510559146237836,
    ];
    for code in crate::common::table::all_codes() {
        // Steps as short as those of second order at 1e-6 end where round-off beside the singular position is all there is.
        let second_order = code.is_trapezoidal();
        let options = Options {
            output: OutputTimes::Interval(1.0),
            channels: vec!["upright_0.position".into()],
            ..crate::common::options(code, if second_order { 1e-5 } else { 1e-6 }, 8.0)
        };
        let outcome = crate::common::run_model(&model, &options);
        let found = outcome.series("upright_0.position", 0);
        for (k, (x, expected)) in found[1..].iter().zip(expected).enumerate() {
            let error = (2.0 * x - expected).abs();
            assert!(error < 1e-3, "{code:?} at {} s: {error:.1e} m", k + 1);
        }
    }
}
