//! Order of the formulas on constrained mechanisms: fixed steps, Newton to round-off, steps short
//! against the stiffest eigenvalue.

use crate::common::{
    DRIVEN_PENDULUM, SPATIAL_SLIDER_CRANK, document, model_of, options, reference, run_model,
};
use holonom::method::Code;
use holonom::model::Model;
use holonom::simulation::{Options, OutputTimes};
use serde_json::json;

/// Values of the channels at eight times, which fixed steps hit.
fn series(model: &Model, options: &Options, end: f64, channels: &[&str]) -> Vec<f64> {
    let options = Options {
        output: OutputTimes::Listed((1..=8).map(|k| f64::from(k) * end / 8.0).collect()),
        channels: channels.iter().map(|&c| c.to_owned()).collect(),
        ..options.clone()
    };
    let outcome = run_model(model, &options);
    channels.iter().flat_map(|channel| outcome.series(channel, 0)).collect()
}

fn difference(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Halves the step twice from `steps` steps and compares with a run by an explicit code.
#[track_caller]
fn assert_order_4(model: &Model, end: f64, steps: u32, channels: &[&str]) {
    let truth = series(model, &options(Code::Dopri5, 1e-13, end), end, channels);
    for code in [Code::ForSdirk, Code::ForRosen] {
        let error = |steps: u32| {
            let fixed_step = Some(end / f64::from(steps));
            let options = Options { fixed_step, ..options(code, 1e-3, end) };
            difference(&series(model, &options, end, channels), &truth)
        };
        let (coarse, fine) = (error(steps), error(4 * steps));
        let order = (coarse / fine).log2() / 2.0;
        assert!((order - 4.0).abs() < 0.2, "{code:?}: {order:.2} from {coarse:.1e} to {fine:.1e}");
    }
}

#[test] // independent truth: the exact solution by elliptic functions at t = 1, 2 s
fn order_4_on_the_pendulum_against_its_exact_solution() {
    let reference = reference("simple_pendulum").until(2.0);
    let model = crate::common::model("simple_pendulum");
    for code in [Code::ForSdirk, Code::ForRosen] {
        let error = |steps: u32| {
            let options = Options {
                fixed_step: Some(2.0 / f64::from(steps)),
                output: OutputTimes::Listed(reference.times.clone()),
                channels: vec!["bob.position".into()],
                ..options(code, 1e-3, 2.0)
            };
            let differences = reference.differences(&run_model(&model, &options));
            differences.iter().map(|(_, d)| *d).fold(0.0, f64::max)
        };
        let (coarse, fine) = (error(64), error(256));
        let order = (coarse / fine).log2() / 2.0;
        assert!((order - 4.0).abs() < 0.2, "{code:?}: {order:.2} from {coarse:.1e} to {fine:.1e}");
    }
}

// Independent truth of the following: explicit Runge-Kutta steps at tolerance 1e-13.

#[test]
fn order_4_on_a_mildly_stiff_double_pendulum() {
    let softer = [("parameters.k2", json!(400.0)), ("parameters.c2", json!(20.0))];
    let document = document("double_pendulum").with_values(&softer).expect("paths");
    let model = document.build().expect("a model").0;
    let channels = ["upper.angle", "lower.angle", "upper.angular_velocity"];
    assert_order_4(&model, 1.0, 256, &channels);
}

#[test]
fn order_4_on_a_closed_loop() {
    let channels = ["crank.angle", "crank.angular_velocity", "slider.position"];
    assert_order_4(&crate::common::model("slider_crank"), 0.5, 512, &channels);
}

#[test]
fn order_4_on_a_spatial_closed_loop() {
    let channels = ["slider.position", "crank.angular_velocity"];
    assert_order_4(&model_of(SPATIAL_SLIDER_CRANK), 1.0, 2048, &channels);
}

#[test]
fn order_4_with_a_moving_driver() {
    assert_order_4(&model_of(DRIVEN_PENDULUM), 2.0, 64, &["rod.angle", "rod.angular_velocity"]);
}
