//! What stays constant: constraints at every accepted step, energy with its ledger.

use crate::common::{LIBRARY, Outcome, model, options, run_from, run_model};
use holonom::method::Code;
use holonom::model::Tolerance;
use holonom::simulation::{Options, OutputTimes, Status};

/// Simulated time of a model, s. For explicit codes a time that stability lets them reach in a few
/// thousand steps, from a state (at the first number) that is not at rest.
fn spans(name: &str) -> (f64, [f64; 2]) {
    match name {
        "simple_pendulum" => (10.0, [0.0, 10.0]),
        "andrews" => (0.03, [0.0, 0.03]),
        "slider_crank" | "spatial_four_bar" => (2.0, [0.0, 2.0]),
        "chain50_free" => (0.5, [0.0, 0.5]),
        "chain50" => (1.0, [0.1, 0.105]),
        "hmmwv14" | "hmmwv14_bushing" => (2.5, [0.55, 0.5502]),
        _ => (2.0, [0.1, 0.12]),
    }
}

/// Every constraint within its bound, and the ledger closed: kinetic and potential energy, what was
/// dissipated and what was supplied add up within twenty times the tolerance of all that moved.
#[track_caller]
fn assert_kept(what: &str, outcome: &Outcome, tolerance: f64) {
    let (summary, energy) = (&outcome.summary, &outcome.summary.energy);
    assert_eq!(summary.status, Status::Completed, "{what}: {:?}", summary.stop);
    let statistics = &summary.statistics;
    assert!(statistics.steps > 0, "{what}");
    assert!(statistics.residual_ratio <= 1.0, "{what}: {:e}", statistics.residual_ratio);
    let moved = energy.range + energy.dissipated.abs() + energy.supplied.abs();
    let ratio = energy.largest_imbalance / (tolerance * moved);
    assert!(
        ratio <= 20.0,
        "{what}: {:.2e} J of {moved:.2e} J are not accounted for, {ratio:.1} tolerances",
        energy.largest_imbalance
    );
}

#[track_caller]
fn assert_library_kept(tolerance: f64) {
    for name in LIBRARY {
        let (model, (end, explicit)) = (model(name), spans(name));
        for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau] {
            let outcome = run_from(&model, &options(code, tolerance, end), None);
            assert_kept(&format!("{name} by {code:?}"), &outcome, tolerance);
        }
        if *name == "stiff_slider" {
            // At their limit of stability explicit codes leave noise, which this damper of 1e5 N s/m
            // dissipates: 0.6 W at velocities of 1e-3 m/s.
            continue;
        }
        let [begin, end] = explicit;
        let start = (begin > 0.0)
            .then(|| run_model(&model, &options(Code::ForSdirk, tolerance, begin)).summary.end);
        for code in [Code::Deabm, Code::Dopri5, Code::Dop853] {
            let outcome = run_from(&model, &options(code, tolerance, end), start.as_ref());
            assert_kept(&format!("{name} by {code:?}"), &outcome, tolerance);
        }
    }
}

#[test] // independent truth: the joints as stated, and the first law
fn constraints_and_energy_are_kept_by_every_code_on_every_model() {
    assert_library_kept(1e-4);
}

#[cfg(feature = "long")]
#[test] // independent truth: as above, at tight tolerance
fn constraints_and_energy_are_kept_at_tight_tolerance() {
    assert_library_kept(1e-6);
}

#[test] // independent truth: a conservative mechanism
fn the_pendulum_keeps_its_energy() {
    for tolerance in [1e-3, 1e-4, 1e-6] {
        let outcome =
            run_model(&model("simple_pendulum"), &options(Code::ForSdirk, tolerance, 10.0));
        let energy = &outcome.summary.energy;
        assert!(energy.range > 9.5, "it swings through: {:.2} J", energy.range);
        let drift = energy.largest_imbalance / (tolerance * energy.range);
        assert!(drift <= 20.0, "{drift:.1} tolerances of the energy range at {tolerance:e}");
        // Without springs, dampers and drivers the ledger is the energy itself.
        assert_eq!((energy.dissipated, energy.supplied), (0.0, 0.0));
    }
}

#[test] // independent truth: the value ½ m v² + m g z computed here from the channels
fn energy_channels_are_those_of_the_motion() {
    let mut options = options(Code::ForSdirk, 1e-6, 2.0);
    options.output = OutputTimes::Interval(0.1);
    options.tolerance = Tolerance::uniform(1e-6);
    options.channels = ["bob.position", "bob.velocity", "energy.kinetic", "energy.potential"]
        .map(str::to_owned)
        .to_vec();
    let outcome = run_model(&model("simple_pendulum"), &options);
    let column = |name: &str, k| outcome.series(name, k);
    let (height, vx, vy) =
        (column("bob.position", 1), column("bob.velocity", 0), column("bob.velocity", 1));
    let (kinetic, potential) = (column("energy.kinetic", 0), column("energy.potential", 0));
    assert_eq!(height.len(), 21);
    for i in 0..height.len() {
        assert!((kinetic[i] - 0.5 * (vx[i] * vx[i] + vy[i] * vy[i])).abs() < 1e-12);
        assert!((potential[i] - 9.81 * height[i]).abs() < 1e-12);
    }
}

/// A point of a body, in ground axes, from the body's pose: position and Euler parameters.
fn point(position: [f64; 3], e: [f64; 4], s: [f64; 3]) -> [f64; 3] {
    let [w, x, y, z] = e;
    let rows = [
        [w * w + x * x - y * y - z * z, 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), w * w - x * x + y * y - z * z, 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ];
    std::array::from_fn(|i| position[i] + (0..3).map(|j| rows[i][j] * s[j]).sum::<f64>())
}

#[test] // independent truth: points turned here, lengths of the design configuration
fn the_vehicle_keeps_its_joints_between_steps_too() {
    let model = model("hmmwv14");
    let joint = |name: &str| model.joints.iter().find(|j| j.name == name).expect("a joint");
    let names = ["upper_ball_front_right", "lower_ball_rear_left", "tie_rod_front_right"];
    let mut channels = Vec::new();
    for frame in names.iter().flat_map(|name| joint(name).frames) {
        let body = &model.bodies[frame.body.expect("a moving body")].name;
        channels.push(format!("{body}.position"));
        channels.push(format!("{body}.euler_parameters"));
    }
    for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau] {
        let options = Options {
            output: OutputTimes::Interval(0.013),
            channels: channels.clone(),
            ..options(code, 1e-3, 1.0)
        };
        let outcome = run_model(&model, &options);
        let row = |channel: &str, row: usize| -> Vec<f64> {
            let size = if channel.ends_with("position") { 3 } else { 4 };
            (0..size).map(|k| outcome.series(channel, k)[row]).collect()
        };
        let mut largest = 0.0f64;
        for i in 0..outcome.times().len() {
            for name in names {
                let ends = joint(name).frames.map(|frame| {
                    let body = &model.bodies[frame.body.expect("a moving body")].name;
                    let r = row(&format!("{body}.position"), i).try_into().expect("three");
                    let e = row(&format!("{body}.euler_parameters"), i).try_into().expect("four");
                    point(r, e, frame.point)
                });
                let [a, b] = ends;
                let distance = (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
                let length = if name.starts_with("tie_rod") { 0.386537060632121 } else { 0.0 };
                largest = largest.max((distance - length).abs());
            }
        }
        assert!(largest < 1e-10, "{code:?}: a joint is open by {largest:.1e} m");
    }
}
