//! What is written out cannot change what is computed: whatever the output times and channels, with dense output
//! and without, steps and end are the same to the last bit.

use crate::common::table::{Table, all_codes};
use crate::common::{
    DRIVEN_TELESCOPE, LIBRARY, SPATIAL_SLIDER_CRANK, model, model_of, options, run_from,
};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::Model;
use holonom::reduction::Choice;
use holonom::simulation::{Options, OutputTimes, Problem, StepRecord};

/// Time, length, error and outcome of all attempts, as bits.
fn bits(steps: &[StepRecord]) -> Vec<(u64, u64, u64, &'static str)> {
    let bits = |s: &StepRecord| (s.t.to_bits(), s.h.to_bits(), s.error.to_bits(), s.outcome.name());
    steps.iter().map(bits).collect()
}

/// Runs a model without outputs, with coarse and with fine ones, with no channels and with all; with dense
/// output where there are rows or nothing else is written, and without.
fn compare(table: &mut Table, name: &str, model: &Model, code: Code, choice: Choice, end: f64) {
    let channels: Vec<String> =
        Problem::new(model.clone()).channels().iter().map(|c| c.name.clone()).collect();
    let some = channels.iter().step_by(5).cloned().collect();
    let fine = if cfg!(feature = "long") { 997.0 } else { 97.0 };
    let outputs = [
        (OutputTimes::Listed(Vec::new()), Vec::new(), false),
        (OutputTimes::Listed(Vec::new()), Vec::new(), true),
        (OutputTimes::Interval(end / 7.3), channels, false),
        (OutputTimes::Interval(end / fine), some, true),
    ];
    let runs = outputs.map(|(output, channels, dense)| {
        let base = options(code, 1e-4, end);
        let options = Options {
            output,
            channels,
            parametrization: choice,
            dense_output: Some(dense),
            max_steps: 20_000,
            ..base
        };
        let outcome = run_from(model, &options, None);
        let stored = outcome.rows.all.dense.len() as u64;
        let expected = if dense { outcome.summary.statistics.steps } else { 0 };
        assert_eq!(stored, expected, "{name}, {code:?}: stored steps");
        let end = &outcome.summary.end;
        let state: Vec<u64> = end.q.iter().chain(&end.v).map(|x| x.to_bits()).collect();
        (bits(&outcome.rows.all.steps), state, outcome.summary.stop.code)
    });
    let line = format!("{name}, {choice:?}, {}", code.info().name);
    for (run, what) in runs[1..].iter().zip(["dense", "coarse", "fine"]) {
        let apart = run.0.iter().zip(&runs[0].0).position(|(a, b)| a != b);
        table.note(&line, format!("{what}: {} attempts", run.0.len()));
        table.claim(run == &runs[0], || match apart {
            Some(k) => format!("{line}: {what} outputs change attempt {k} of {}", run.0.len()),
            None => format!("{line}: {what} outputs change the end"),
        });
    }
}

/// How long a model runs: a part of the whole in the ordinary run.
fn end(name: &str, model: &Model) -> f64 {
    let end = model.simulation.end_time.unwrap_or(1.0);
    let part = match name {
        _ if cfg!(feature = "long") => 1.0,
        "chain50" | "chain50_free" => 0.1,
        "hmmwv14" | "hmmwv14_bushing" => 0.25,
        _ => 0.5,
    };
    part * end
}

#[test]
fn outputs_change_no_bit_of_the_library() {
    let mut table = Table::new("outputs over the library");
    for name in LIBRARY {
        let model = model(name);
        let end = end(name, &model);
        compare(&mut table, name, &model, DEFAULT_CODE, Choice::default(), end);
    }
    table.finish();
}

#[test]
fn outputs_change_no_bit_of_any_code() {
    let mut table = Table::new("outputs by all codes");
    for (name, model) in [
        ("spatial slider-crank", model_of(SPATIAL_SLIDER_CRANK)),
        ("driven telescope", model_of(DRIVEN_TELESCOPE)),
        ("slider_crank", model("slider_crank")),
    ] {
        for code in all_codes() {
            compare(&mut table, name, &model, code, Choice::default(), 1.0);
            for &(choice, _) in Choice::ALL {
                if cfg!(feature = "long") && choice != Choice::default() {
                    compare(&mut table, name, &model, code, choice, 1.0);
                }
            }
        }
    }
    table.finish();
}
