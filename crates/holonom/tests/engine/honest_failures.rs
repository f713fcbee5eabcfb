//! Models that cannot be run to their end, and what the run says: status, code, joint, coordinate, time,
//! advice. The texts beside the files were read by a person when they were committed;
//! `HOLONOM_WRITE=1 cargo test` rewrites them after a change: read them again then.

use crate::common::table::all_codes;
use crate::common::{model_of, options};
use holonom::method::Code;
use holonom::model::{Model, Orientation};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, Status, Summary, run};
use std::path::PathBuf;

fn folder() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/engine/failures")
}

fn model(name: &str) -> Model {
    model_of(&std::fs::read_to_string(folder().join(format!("{name}.toml"))).unwrap())
}

fn choices(model: &Model) -> Options {
    let end = model.simulation.end_time.unwrap();
    let code = match &model.simulation.method {
        Some(name) => Code::find(name, None).unwrap(),
        None => Code::ForSdirk,
    };
    Options { output: OutputTimes::Interval(end / 10.0), ..options(code, 1e-4, end) }
}

/// Numbers that round-off changes are left out of the texts.
fn without_figures(text: &str) -> String {
    let figure = |word: &str| {
        let core = word.trim_end_matches([',', ';', '.', ')']);
        let is = core.contains("e-") || core.contains("e+") || core.contains('.');
        let number = is && core.trim_start_matches(['(', '-']).parse::<f64>().is_ok();
        if number { word.replacen(core, "…", 1) } else { word.to_owned() }
    };
    text.split(' ').map(figure).collect::<Vec<_>>().join(" ")
}

fn told(summary: &Summary) -> String {
    let stop = &summary.stop;
    let none = "none".to_owned();
    let (item, coordinate) =
        (stop.item.as_ref().unwrap_or(&none), stop.coordinate.as_ref().unwrap_or(&none));
    format!(
        "status: {}\ncode: {}\nmessage: {}\nitem: {item}\ncoordinate: {coordinate}\nhelp: {}\n",
        summary.status.name(),
        stop.code,
        without_figures(&stop.message),
        stop.help
    )
}

#[test]
fn every_failure_is_told_as_it_was_read() {
    let mut names: Vec<String> = std::fs::read_dir(folder())
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "toml"))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .collect();
    names.sort();
    let mut different = Vec::new();
    for name in names {
        let model = model(&name);
        let mut rows = Memory::default();
        let found = match run(&Problem::new(model.clone()), &choices(&model), None, &mut rows) {
            Ok(summary) => told(&summary),
            Err(e) => format!(
                "refused\ncode: {}\nmessage: {e}\nitem: {}\nhelp: {}\n",
                e.code(),
                e.item().unwrap_or("none"),
                e.help()
            ),
        };
        let beside = folder().join(format!("{name}.toml.txt"));
        if std::env::var_os("HOLONOM_WRITE").is_some() {
            std::fs::write(&beside, &found).unwrap();
        }
        if std::fs::read_to_string(&beside).unwrap_or_default() != found {
            different.push(format!("{name}:\n{found}"));
        }
    }
    assert!(different.is_empty(), "{}", different.join("\n"));
}

#[test] // independent truth: exp(100 t) is too large for numbers at about 7.1 s, its square at 3.58 s
fn what_runs_away_does_so_however_many_steps_that_takes() {
    let model = model("runs_away");
    // Checkpoints come after every 1,000 steps: movements go on to be measured from the start of the run.
    for (code, tolerance) in [
        (Code::ForRadau, 1e-3),
        (Code::ForRadau, 1e-6),
        (Code::ForSdirk, 1e-6),
        (Code::SspTrap, 1e-2),
    ] {
        let problem = Problem::new(model.clone());
        let options = options(code, tolerance, 100.0);
        let summary = run(&problem, &options, None, &mut Memory::default()).unwrap();
        let (stop, steps) = (&summary.stop, summary.statistics.steps);
        assert_eq!(stop.code, "simulation/not-finite", "{code:?} {tolerance:e}: {steps} steps");
        assert!((stop.time - 3.58).abs() < 0.01, "{code:?} {tolerance:e}: {} s", stop.time);
    }
}

#[test] // independent truth: geometry and the fall of a pushed block, worked out by hand
fn failures_come_at_the_moment_they_must_and_keep_the_last_good_state() {
    use std::f64::consts::PI;
    for (name, moment) in [
        ("four_bar_dead_point", 0.04f64.acos() - PI / 3.0),
        ("parallelogram_laid_flat", PI / 3.0),
        ("parallelogram_driven_flat", PI / 3.0),
        ("slider_beyond_reach", 0.4),
        ("rigid_stop", 1.0), // ½ t² = 0.5 m
        ("rigid_stop_explicit", 1.0),
        ("jump_of_a_driver", 0.5),
    ] {
        let model = model(name);
        let problem = Problem::new(model.clone());
        let mut rows = Memory::default();
        let summary = run(&problem, &choices(&model), None, &mut rows).unwrap();
        assert_eq!(summary.status, Status::Failed, "{name}");
        let end = &summary.end;
        assert!((end.t - moment).abs() < 2e-6, "{name}: {} {moment}", end.t);
        assert_eq!(summary.stop.time, end.t, "{name}");
        assert!(summary.stop.item.is_some() && summary.stop.coordinate.is_some(), "{name}");
        assert!(!summary.stop.help.is_empty(), "{name}");
        // The last row is that state, and it is a state to start from.
        assert_eq!(rows.all.time.last(), Some(&end.t), "{name}");
        assert_eq!(rows.all.q[rows.all.q.len() - end.q.len()..], end.q[..], "{name}");
        assert!(summary.statistics.residual_ratio < 1.0, "{name}");
        let still = Options {
            output: OutputTimes::Listed(vec![end.t]),
            ..options(Code::ForSdirk, 1e-4, end.t)
        };
        let again = run(&problem, &still, Some(end), &mut Memory::default());
        // Within what decides on ranks of a dead point no acceleration is determined, or rows contradict each other that
        // seem redundant, and the run says so.
        let dead_point = name.starts_with("parallelogram") || name.starts_with("four_bar");
        let code = match &again {
            Ok(summary) if summary.status == Status::Completed => continue,
            Ok(summary) => summary.stop.code,
            Err(error) => error.code(),
        };
        assert!(dead_point && (end.t - moment).abs() < 1e-8, "{name}: {code}");
        let singular = ["simulation/singular-configuration", "assembly/contradiction"];
        assert!(singular.contains(&code), "{name}: {code}");
    }
}

#[test] // independent truth: the links fall with g·(lever): they leave the line by gt²/2 of metres
fn a_row_that_is_no_longer_redundant_ends_the_run_before_it_opens() {
    let model = model("parallelogram_started_flat");
    let mut rows = Memory::default();
    let summary = run(&Problem::new(model.clone()), &choices(&model), None, &mut rows).unwrap();
    assert_eq!(summary.stop.code, "simulation/singular-configuration");
    assert!(summary.end.t < 0.1, "{}", summary.end.t);
    assert!(summary.statistics.position_residual < 1e-6, "{:?}", summary.statistics);
    assert_eq!(rows.all.time.last(), Some(&summary.end.t));
}

#[test] // truth: the advice, followed, helps
fn a_fixed_step_that_is_too_long_is_told_as_such() {
    let problem = Problem::new(crate::common::model("slider_crank"));
    for (code, step) in [(Code::ForSdirk, 0.3), (Code::SspTrap, 0.3), (Code::Dopri5, 0.3)] {
        let fixed = |h: f64| Options { fixed_step: Some(h), ..options(code, 1e-4, 0.3) };
        let long = run(&problem, &fixed(step), None, &mut Memory::default()).unwrap();
        assert_eq!(long.status, Status::Failed, "{code:?}");
        assert!(long.stop.help.contains("smaller `fixed_step`"), "{:?}", long.stop);
        assert!(!long.stop.message.contains("fell to"), "{:?}", long.stop);
        let short = run(&problem, &fixed(1e-3), None, &mut Memory::default()).unwrap();
        assert_eq!(short.status, Status::Completed, "{:?}", short.stop);
    }
}

#[test] // independent truth: the slider is asked for 0.6 m, rod and crank reach 0.4 m
fn a_recovery_out_of_reach_names_residual_and_last_correction() {
    let problem = Problem::new(model("slider_beyond_reach"));
    let assembled = problem.assemble().unwrap();
    let mut manifold = assembled.manifold();
    let mut q = assembled.state.q.clone();
    let failure = manifold.recover_position(0.8, &[], &mut q).unwrap_err();
    assert_eq!(failure.code, "simulation/position-recovery");
    for words in ["largest residual", "is in joint `", "last correction", "was of `"] {
        assert!(failure.message.contains(words), "{}", failure.message);
    }
}

#[test] // independent truth: from 120° at 1 rad/s all links lie on one line after π/3 s
fn no_run_crawls_into_a_singular_configuration() {
    let model = model("parallelogram_laid_flat");
    let problem = Problem::new(model);
    for code in all_codes() {
        let options = options(code, 1e-4, 2.0);
        let summary = run(&problem, &options, None, &mut Memory::default()).unwrap();
        let steps = summary.statistics.steps;
        assert_eq!(summary.status, Status::Failed, "{code:?}");
        assert!((summary.end.t - std::f64::consts::FRAC_PI_3).abs() < 2e-6, "{code:?}");
        assert!(summary.stop.item.is_some(), "{code:?}: {:?}", summary.stop);
        assert!(steps < 5_000, "{code:?}: {steps}");
    }
}

#[test] // independent truth: both links are locked, whatever the driver asks for
fn a_driver_of_what_joints_lock_is_named() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
a = { mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }
b = { mass = 1.0, inertia = 0.1, position = [1.0, 0.5] }
[joints]
pin = { type = "revolute", between = ["ground", "a"], point = [0.0, 0.0] }
knee = { type = "revolute", between = ["a", "b"], point = [1.0, 0.0] }
foot = { type = "revolute", between = ["b", "ground"], point = [1.0, 1.0] }
[drivers]
crank = { joint = "pin", coordinate = "rotation", motion = { type = "smooth_step", from = 0.0, to = 0.5, start = 0.2, end = 0.6 } }
"#,
    );
    let mut rows = Memory::default();
    let summary = run(&Problem::new(model), &options(Code::ForRadau, 1e-4, 1.0), None, &mut rows);
    let stop = summary.unwrap().stop;
    assert!(stop.time >= 0.2 && stop.time < 0.6, "{stop:?}");
    assert!(stop.message.contains("`crank`"), "{}", stop.message);
}

#[test] // independent truth: the body falls over by more than half a turn's swing; θ̇ = nᵀω, n = (h₁ + h₂)/(1 + h₁ᵀh₂)
fn a_twist_whose_axes_become_opposite_is_told() {
    let coil = "[forces]\ncoil = { type = \"rsda\", between = [\"ground\", \"top\"], axis = [0.0, 0.0, 1.0], \
                stiffness = 1.0, damping = 0.05 }";
    let turn = "[drivers]\nturn = { between = [\"ground\", \"top\"], coordinate = \"rotation\", axis = [0.0, 0.0, 1.0], \
                motion = { type = \"polynomial\", coefficients = [0.0, 0.3] } }";
    for (name, text) in [("coil", coil), ("turn", turn)] {
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
top = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.12, 0.0], [0.0, 0.0, 0.08]], position = [0.0, 0.0, 0.5] }}
[joints]
ball = {{ type = "spherical", between = ["ground", "top"], point = [0.0, 0.0, 0.0] }}
[initial.bodies]
top = {{ angular_velocity = [1.0, 0.0, 0.3] }}
{text}
"#
        ));
        let mut rows = Memory::default();
        let options = options(Code::ForRadau, 1e-6, 5.0);
        let mut upside_down = model.clone();
        upside_down.initial.bodies[0].orientation =
            Some(Orientation::EulerParameters([0.0, 1.0, 0.0, 0.0]));
        upside_down.initial.bodies[0].position = Some([0.0, 0.0, -0.5]);
        let summary = run(&Problem::new(model), &options, None, &mut rows).unwrap();
        let error = Problem::new(upside_down).assemble().expect_err("a twist of no value");
        assert_eq!((error.code(), error.item()), ("assembly/opposite-axes", Some(name)));
        assert_eq!(summary.status, Status::Failed, "{name}");
        let stop = &summary.stop;
        let said = format!("the axes of `{name}` have become opposite");
        assert!(stop.message.starts_with(&said), "{}", stop.message);
        assert_eq!(stop.item.as_deref(), Some(name));
        // The axis of the top is the third column of its rotation.
        let [_, e1, e2, _] = [3, 4, 5, 6].map(|k| summary.end.q[k]);
        assert!(2.0 - 2.0 * (e1 * e1 + e2 * e2) < 1e-6, "{name}: {:?}", summary.end.q);
    }
}

/// An arm that a spring pulls to a point on the circle of its end.
fn pulled_together(law: &str) -> Model {
    model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
arm = {{ mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }}
[tables]
pull = {{ x = [-2.0, 2.0], y = [1000.0, 1000.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "arm"], points = [[0.0, -1.0], [1.0, 0.0]], damping = 5.0, {law} }}
"#
    ))
}

#[test] // independent truth: a pull of 1,000 N at every length ends where the length does
fn a_spring_whose_ends_have_met_is_told_as_what_slows_a_run() {
    for (law, met) in [
        ("force = { table = \"pull\" }, free_length = 0.5", true),
        ("stiffness = 1000.0, free_length = 0.0", false),
    ] {
        for code in [Code::ForSdirk, Code::ForRadau, Code::Dopri5] {
            let options = Options { max_steps: 20_000, ..options(code, 1e-4, 60.0) };
            let mut rows = Memory::default();
            let problem = Problem::new(pulled_together(law));
            let summary = run(&problem, &options, None, &mut rows).unwrap();
            let stop = &summary.stop;
            let said = stop.message.contains("the ends of `spring` have met");
            assert_eq!(said, met, "{code:?}: {}", stop.message);
            assert_eq!(stop.item.as_deref() == Some("spring"), met, "{code:?}");
            assert_eq!(summary.status == Status::Limit, met, "{code:?}");
        }
    }
}
