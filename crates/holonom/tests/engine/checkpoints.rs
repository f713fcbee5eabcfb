//! Runs that are taken up at a checkpoint. Independent truth: the run that was not interrupted, bit for bit.

use crate::common::table::all_codes;
use crate::common::{
    DRIVEN_TELESCOPE, FOUR_BAR, LIBRARY, MOTOR, TURNING, model, model_of, options, run_model,
};
use crate::turns::{BRANCH, on_rubber};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::Model;
use holonom::newton::Representation;
use holonom::reduction::ParametrizationKind;
use holonom::reduction::accelerations::Accelerations;
use holonom::simulation::{
    Checkpoint, Chunk, Flow, LimitedBy, Memory, Options, OutputTimes, Problem, Sink, Statistics,
    Status, Summary, resume, run,
};
use std::fmt::Debug;

/// Forces of the model that turns: extra states, a kink, a table.
const EVERYTHING: &str = r#"
[forces]
coil = { type = "rsda", between = ["wheel", "ground"], axis = [1.0, 0.0, 0.0], stiffness = 0.5, damping = 0.01 }
damper = { type = "maxwell", between = ["bob", "hung"], points = [[3.0, 0.0, 0.0], [6.0, 0.0, -1.0]], stiffness = 40.0, damping = 8.0, free_length = 3.0 }
spring = { type = "tsda", between = ["ground", "hung"], points = [[6.0, 0.0, 0.0], [6.0, 0.0, -1.0]], stiffness = 900.0, damping = 5.0, free_length = 1.0 }
rubber = { type = "bushing", between = ["ground", "hung"], point = [6.0, 0.0, -1.0], damping = [1.0, 1.0, 1.0], branches = { slow = { stiffness = [300.0, 200.0, 100.0], damping = [30.0, 30.0, 30.0] }, about = { rotational_stiffness = [5.0, 0.0, 4.0], rotational_damping = [0.3, 0.0, 2.0] } } }
push = { type = "point_force", on = "hung", point = [6.0, 0.0, -1.0], force = { type = "smooth_step", from = 0.0, to = 4.0, start = 0.2, end = 0.5 }, direction = [0.0, 1.0, 0.0] }
"#;

fn everything() -> Model {
    model_of(&format!("{TURNING}{EVERYTHING}"))
}

/// Keeps everything, and where it stood at each checkpoint.
#[derive(Default)]
struct Kept {
    memory: Memory,
    stops: Vec<Stop>,
}

/// A checkpoint with what the run had handed out until then.
struct Stop {
    checkpoint: Checkpoint,
    rows: usize,
    steps: usize,
    events: usize,
    segments: usize,
    charts: usize,
}

impl Sink for Kept {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        self.memory.chunk(chunk)?;
        let all = &self.memory.all;
        if let Some(checkpoint) = chunk.checkpoint.clone() {
            self.stops.push(Stop {
                checkpoint,
                rows: all.time.len(),
                steps: all.steps.len(),
                events: all.events.len(),
                segments: all.dense.len(),
                charts: all.dense.charts.len(),
            });
        }
        Ok(())
    }

    fn progress(&mut self, _: f64, _: f64, _: u64) -> Flow {
        Flow::Continue
    }
}

/// What of the statistics is no time.
fn work(statistics: &Statistics) -> Statistics {
    Statistics {
        assembly_seconds: 0.0,
        assembly_cpu_seconds: 0.0,
        run_seconds: 0.0,
        run_cpu_seconds: 0.0,
        output_seconds: 0.0,
        ..*statistics
    }
}

/// Numbers that differ in any bit are told apart, also two zeros.
#[track_caller]
fn same(found: &[f64], expected: &[f64], what: &dyn Debug) {
    let bits = |x: &[f64]| x.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
    assert_eq!(found.len(), expected.len(), "{what:?}");
    let other = found.iter().zip(expected).position(|(a, b)| a.to_bits() != b.to_bits());
    assert!(bits(found) == bits(expected), "{what:?}: number {other:?} of {}", found.len());
}

/// Runs `model` with a checkpoint every so many steps and takes it up at all of them, or every few.
#[track_caller]
fn assert_taken_up(name: &str, model: &Model, options: &Options, least: usize) {
    let problem = Problem::new(model.clone());
    let all: Vec<String> = problem.channels().iter().map(|channel| channel.name.clone()).collect();
    let options = &Options { channels: all, ..options.clone() };
    let mut kept = Kept::default();
    let whole = run(&problem, options, None, &mut kept).expect("starts");
    let told = (name, options.code, options.parametrization);
    assert_eq!(whole.status, Status::Completed, "{told:?}: {:?}", whole.stop);
    assert!(kept.stops.len() >= least, "{told:?}: {} checkpoints", kept.stops.len());
    for stop in kept.stops.iter().step_by(kept.stops.len().div_ceil(8)) {
        let text = stop.checkpoint.to_text();
        let checkpoint = Checkpoint::from_text(&text).expect("reads what it wrote");
        assert_eq!(checkpoint.to_text(), text);
        let mut rest = Memory::default();
        // Compiled anew, as another process does.
        let again = Problem::new(model.clone());
        let summary = resume(&again, options, &checkpoint, &mut rest).expect("is taken up");
        let (all, rest) = (&kept.memory.all, &rest.all);
        let told = (told, checkpoint.time());
        same(&rest.time, &all.time[stop.rows..], &(told, "time"));
        let rows = all.time.len();
        for (what, rest, all) in [
            ("q", &rest.q, &all.q),
            ("v", &rest.v, &all.v),
            ("a", &rest.a, &all.a),
            ("lambda", &rest.lambda, &all.lambda),
            ("z", &rest.z, &all.z),
            ("winding", &rest.winding, &all.winding),
            ("ledger", &rest.ledger, &all.ledger),
        ] {
            same(rest, &all[all.len() / rows * stop.rows..], &(told, what));
        }
        for ((rest, all), name) in rest.channels.iter().zip(&all.channels).zip(&options.channels) {
            same(rest, &all[all.len() / rows * stop.rows..], &(told, name));
        }
        assert_eq!(rest.steps, all.steps[stop.steps..], "{told:?}");
        assert_eq!(rest.events, all.events[stop.events..], "{told:?}");
        let (dense, whole_dense) = (&rest.dense, &all.dense);
        same(&dense.t, &whole_dense.t[stop.segments..], &(told, "segments"));
        same(&dense.h, &whole_dense.h[stop.segments..], &(told, "lengths"));
        same(&dense.w, &whole_dense.w[whole_dense.w.len() - dense.w.len()..], &(told, "w"));
        assert_eq!(dense.charts.len(), whole_dense.charts.len() - stop.charts, "{told:?}");
        assert_same_summary(&summary, &whole, &problem, &told);
    }
}

#[track_caller]
fn assert_same_summary(summary: &Summary, whole: &Summary, problem: &Problem, told: &dyn Debug) {
    assert_eq!(work(&summary.statistics), work(&whole.statistics), "{told:?}");
    assert_eq!(summary.energy, whole.energy, "{told:?}");
    assert_eq!(summary.warnings, whole.warnings, "{told:?}");
    assert_eq!(summary.end, whole.end, "{told:?}");
    assert_eq!((summary.status, &summary.stop), (whole.status, &whole.stop), "{told:?}");
    let limited = |s: &Summary| -> LimitedBy { s.limited_by(problem.system().as_ref()) };
    assert_eq!(limited(summary), limited(whole), "{told:?}");
}

fn with_rows(code: Code, tolerance: f64, end: f64, steps: u64) -> Options {
    Options {
        output: OutputTimes::Interval(end / 60.0),
        checkpoint_steps: Some(steps),
        dense_output: Some(true),
        ..options(code, tolerance, end)
    }
}

#[test] // a warning of what was before a checkpoint
fn what_has_turned_over_before_is_told() {
    let (model, options) = (on_rubber(1.5, BRANCH), with_rows(DEFAULT_CODE, 1e-3, 3.0, 1));
    let told = |summary: &Summary| {
        summary.warnings.iter().any(|warning| warning.code == "simulation/turned-over")
    };
    assert!(told(&run_model(&model, &options).summary));
    assert_taken_up("turned over", &model, &options, 3);
}

#[test]
fn every_code_goes_on_as_if_nothing_had_happened() {
    let cases = [
        ("spatial_four_bar", model("spatial_four_bar"), 1.0, 3),
        ("chain50", model("chain50"), 0.2, 3),
        ("hmmwv14", model("hmmwv14"), 0.4, 1),
        ("everything", everything(), 1.0, 3),
        ("driven", model_of(DRIVEN_TELESCOPE), 1.0, 3),
    ];
    for (name, model, end, steps) in &cases {
        for code in all_codes() {
            // Explicit ones take thousands of steps of a stiff model.
            let explicit = code.is_explicit() && *name == "hmmwv14";
            let (end, steps) = if explicit { (0.01, 20) } else { (*end, *steps) };
            assert_taken_up(name, model, &with_rows(code, 1e-3, end, steps), 1);
        }
    }
}

#[test]
fn every_choice_of_variables_and_solvers_is_taken_up() {
    let four_bar = model_of(FOUR_BAR);
    let everything = everything();
    for &(parametrization, _) in ParametrizationKind::ALL {
        for code in [DEFAULT_CODE, Code::SspTrap, Code::Deabm] {
            let options = Options { parametrization, ..with_rows(code, 1e-4, 1.0, 2) };
            assert_taken_up("four-bar", &four_bar, &options, 2);
            assert_taken_up("everything", &everything, &options, 2);
        }
    }
    let vehicle = model("hmmwv14");
    for &(accelerations, name) in Accelerations::ALL {
        if name != "recursive" {
            let options = Options { accelerations, ..with_rows(DEFAULT_CODE, 1e-3, 1.0, 3) };
            assert_taken_up(name, &vehicle, &options, 2);
        }
    }
}

#[test]
fn every_sparse_matrix_is_taken_up() {
    for newton in [Representation::Simplified, Representation::Sparse] {
        for code in all_codes().into_iter().filter(|code| !code.needs_full_jacobian()) {
            let options = Options { newton, ..with_rows(code, 1e-4, 0.3, 7) };
            // Which the simplified matrix of the SDIRK codes fails on now and then.
            let crank = model("slider_crank");
            assert_taken_up("slider-crank", &crank, &options, 2);
            if newton == Representation::Simplified && code == Code::ForSdirk {
                let whole = run_model(&crank, &options).summary.statistics;
                assert!(whole.changes_to_full > 0, "nothing to be taken up");
            }
            // And one without degrees of freedom.
            assert_taken_up("motor", &model_of(&format!("{FOUR_BAR}{MOTOR}")), &options, 1);
        }
    }
}

#[test]
fn fixed_steps_and_driven_mechanisms_are_taken_up() {
    let driven = model_of(&format!("{FOUR_BAR}{MOTOR}"));
    for code in all_codes() {
        assert_taken_up("motor", &driven, &with_rows(code, 1e-4, 2.0, 5), 2);
        let fixed = Options { fixed_step: Some(2e-3), ..with_rows(code, 1e-4, 0.2, 9) };
        assert_taken_up("fixed", &model("spatial_four_bar"), &fixed, 5);
    }
}

#[test]
fn the_library_is_taken_up() {
    for name in LIBRARY {
        let model = model(name);
        let end = model.simulation.end_time.unwrap_or(1.0).min(1.0);
        assert_taken_up(name, &model, &with_rows(DEFAULT_CODE, 1e-4, end, 11), 1);
    }
}

#[test] // what is written out changes no step, and no checkpoint either
fn checkpoints_do_not_depend_on_outputs() {
    let model = model("spatial_four_bar");
    let with = |output: OutputTimes| {
        let options = Options { output, ..with_rows(DEFAULT_CODE, 1e-4, 1.0, 10) };
        run_model(&model, &options)
    };
    let (few, many) = (with(OutputTimes::Listed(vec![])), with(OutputTimes::Interval(1e-3)));
    assert_eq!(few.rows.all.steps, many.rows.all.steps);
    assert_eq!(few.summary.end, many.summary.end);
}

#[test] // a run that is shorter knows nothing of checkpoints
fn nothing_changes_before_the_first_checkpoint() {
    let model = model("spatial_four_bar");
    for code in all_codes() {
        let with = |checkpoint_steps| {
            let options = Options { checkpoint_steps, ..with_rows(code, 1e-4, 0.5, 1) };
            run_model(&model, &options)
        };
        let never = with(Some(u64::MAX));
        let count = never.summary.statistics.steps;
        let late = with(Some(count));
        assert_eq!(late.rows.all.steps, never.rows.all.steps, "{code:?}");
        same(&late.rows.all.q, &never.rows.all.q, &code);
        let often = with(Some(count / 2));
        let first = never.rows.all.steps[..count as usize / 2].to_vec();
        assert_eq!(often.rows.all.steps[..first.len()], first, "{code:?}");
    }
}

#[test] // independent truth: the same formula at a fixed step that is not interrupted
fn a_multistep_formula_keeps_its_history() {
    let model = model("simple_pendulum");
    let with = |steps| {
        let options =
            Options { fixed_step: Some(1e-3), ..with_rows(Code::Deabm, 1e-9, 1.0, steps) };
        run_model(&model, &options)
    };
    let (never, often) = (with(u64::MAX), with(20));
    let difference =
        |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
    // A restart at order 1 would leave h²/2 q̈, 1e-5, every time.
    let left = difference(&never.rows.all.q, &often.rows.all.q);
    assert!(left < 1e-10, "{left:e}");
}

#[test]
fn foreign_checkpoints_are_refused() {
    let (four_bar, pendulum) = (model("spatial_four_bar"), model("double_pendulum"));
    let options = with_rows(DEFAULT_CODE, 1e-4, 1.0, 10);
    let mut kept = Kept::default();
    run(&Problem::new(four_bar.clone()), &options, None, &mut kept).expect("runs");
    let checkpoint = &kept.stops[0].checkpoint;
    let refused = |model: &Model, options: &Options, checkpoint: &Checkpoint| {
        let outcome =
            resume(&Problem::new(model.clone()), options, checkpoint, &mut Memory::default());
        outcome.err().map(|error| error.code())
    };
    assert_eq!(refused(&four_bar, &options, checkpoint), None);
    assert_eq!(refused(&pendulum, &options, checkpoint), Some("simulation/checkpoint"));
    let text = checkpoint.to_text();
    for broken in [
        String::new(),
        text[..text.len() / 2].to_owned(),
        text.replace("\"w\":[", "\"w\":[null,"),
        text.replace("\"forest\":{\"edge\":[", "\"forest\":{\"edge\":[900,"),
    ] {
        let error = Checkpoint::from_text(&broken).expect_err("is no checkpoint");
        assert_eq!(error.code(), "simulation/checkpoint");
    }
    let longer = Checkpoint::from_text(&text.replace("\"w\":[", "\"w\":[0.0,")).expect("is text");
    assert_eq!(refused(&four_bar, &options, &longer), Some("simulation/checkpoint"));
    for [numbers, more] in [
        ["\"carried\":{\"sums\":[{\"error\":[", "0.0,"],
        ["\"spread\":[[", "0.0,"],
        ["\"places\":[", "0.0,"],
        ["\"times\":[", "0.0,"],
    ] {
        assert!(text.contains(numbers), "{numbers}");
        let longer = Checkpoint::from_text(&text.replace(numbers, &format!("{numbers}{more}")));
        let code = refused(&four_bar, &options, &longer.expect("is text"));
        assert_eq!(code, Some("simulation/checkpoint"), "{numbers}");
    }
    // Another code has other unknowns.
    let explicit = Options { code: Code::Deabm, ..options.clone() };
    assert_eq!(refused(&four_bar, &explicit, checkpoint), Some("simulation/checkpoint"));
}
