//! What is written out cannot change what is computed: whatever the output times and channels, with dense output
//! and without, steps and end are the same to the last bit.

use crate::common::table::{Table, all_codes};
use crate::common::{
    DRIVEN_TELESCOPE, LIBRARY, SPATIAL_SLIDER_CRANK, model, model_of, options, run_from,
};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::Model;
use holonom::reduction::accelerations::Accelerations;
use holonom::reduction::{Coordinates, ParametrizationKind};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, StepRecord, run};

/// Time, length, error and outcome of all attempts, as bits.
fn bits(steps: &[StepRecord]) -> Vec<(u64, u64, u64, &'static str)> {
    let bits = |s: &StepRecord| (s.t.to_bits(), s.h.to_bits(), s.error.to_bits(), s.outcome.name());
    steps.iter().map(bits).collect()
}

/// Runs a model without outputs, with coarse and with fine ones, with no channels and with all; with dense
/// output where there are rows or nothing else is written, and without.
fn compare(
    table: &mut Table,
    name: &str,
    model: &Model,
    code: Code,
    choice: ParametrizationKind,
    end: f64,
) {
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
        compare(&mut table, name, &model, DEFAULT_CODE, ParametrizationKind::default(), end);
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
            compare(&mut table, name, &model, code, ParametrizationKind::default(), 1.0);
            for &(choice, _) in ParametrizationKind::ALL {
                if cfg!(feature = "long") && choice != ParametrizationKind::default() {
                    compare(&mut table, name, &model, code, choice, 1.0);
                }
            }
        }
    }
    table.finish();
}

/// Three links that hang on balls.
const LINKS: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
a = { mass = 1.0, inertia = [[0.02, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.06]], position = [0.5, 0.0, 0.0] }
b = { mass = 0.7, inertia = [[0.01, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.045]], position = [1.5, 0.0, 0.0] }
c = { mass = 0.5, inertia = [[0.01, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.035]], position = [2.5, 0.0, 0.0] }
[joints]
first = { type = "spherical", between = ["ground", "a"], point = [0.0, 0.0, 0.0] }
second = { type = "spherical", between = ["a", "b"], point = [1.0, 0.0, 0.0] }
third = { type = "spherical", between = ["b", "c"], point = [2.0, 0.0, 0.0] }
[initial.bodies]
a = { angular_velocity = [1.0, 0.5, 2.0] }
b = { angular_velocity = [0.5, -1.0, 1.0] }
c = { angular_velocity = [0.3, 0.7, -1.0] }
"#;

/// And a rod from the last one to the ground.
const ROD: &str = r#"
[joints.rod]
type = "distance"
between = ["ground", "c"]
points = [[3.0, 1.0, 0.0], [3.0, 0.0, 0.0]]
"#;

#[test] // long steps of what turns fast fail now and then, or what rows need of them does
fn outputs_change_no_bit_where_positions_may_not_be_found() {
    let mut table = Table::new("outputs beside steps that fail");
    let model = model_of(&LINKS.replace("[1.0, 0.5, 2.0]", "[10.0, 1.0, 2.0]"));
    for code in all_codes() {
        for &(choice, _) in ParametrizationKind::ALL {
            compare(&mut table, "links that turn fast", &model, code, choice, 0.5);
        }
    }
    table.finish();
}

#[test] // rows at the ends of steps ask for reactions there, whichever way accelerations were found
fn rows_at_the_ends_of_steps_change_no_bit() {
    let mut table = Table::new("rows at the ends of steps");
    for (name, model) in [
        ("links on balls", model_of(LINKS)),
        ("links on balls and a rod", model_of(&format!("{LINKS}\n{ROD}"))),
        ("spatial_four_bar", model("spatial_four_bar")),
        ("double_pendulum", model("double_pendulum")),
    ] {
        let ways = [
            Accelerations::Auto,
            Accelerations::Recursive,
            Accelerations::NullSpace,
            Accelerations::Reduced,
            Accelerations::Augmented,
        ];
        let ways = ways.map(|way| (Coordinates::Cartesian, way));
        for (coordinates, accelerations) in
            [(Coordinates::Joint, Accelerations::Auto)].into_iter().chain(ways)
        {
            for code in all_codes() {
                let step = 1.0 / 64.0;
                let ends =
                    [OutputTimes::Listed(Vec::new()), OutputTimes::Interval(step)].map(|output| {
                        let options = Options {
                            output,
                            coordinates,
                            accelerations,
                            fixed_step: Some(step),
                            ..options(code, 1e-4, 0.5)
                        };
                        let outcome = run(
                            &Problem::new(model.clone()),
                            &options,
                            None,
                            &mut Memory::default(),
                        );
                        // What cannot be with loops is refused.
                        outcome.ok().map(|summary| {
                            let end = summary.end;
                            end.q.iter().chain(&end.v).map(|x| x.to_bits()).collect::<Vec<_>>()
                        })
                    });
                let line =
                    format!("{name}, {coordinates:?}, {accelerations:?}, {}", code.info().name);
                table.note(&line, if ends[0].is_some() { "runs" } else { "refused" }.to_owned());
                table.claim(ends[0] == ends[1], || format!("{line}: rows change the end"));
            }
        }
    }
    table.finish();
}
