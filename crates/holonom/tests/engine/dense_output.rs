//! States at any time of a run from its stored steps: as good as output rows at these times.

use crate::common::integrate::tight;
use crate::common::table::{
    Bounds, Case, DEFAULT, Kind, OTHERS, Table, all_codes, implicit, line, measure, times, truth,
};
use crate::common::{
    DRIVEN_TELESCOPE, FOUR_BAR, MOTOR, PLATFORM, SPATIAL_SLIDER_CRANK, TURNING, model, model_of,
    options, run_from, run_model,
};
use holonom::method::{CODES, Code, DEFAULT_CODE, Profile};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{
    ChartRecord, Chunk, DenseOutput, Flow, Options, OutputTimes, Problem, Segments, Sink, run,
};
use holonom::system::{Sample, State};

/// Forces of the model that turns: a stiff spring.
const STIFF: &str = r#"
[forces]
coil = { type = "rsda", between = ["wheel", "ground"], axis = [1.0, 0.0, 0.0], stiffness = 0.0, damping = 0.0 }
spring = { type = "tsda", between = ["ground", "hung"], points = [[6.0, 0.0, 0.0], [6.0, 0.0, -1.0]], stiffness = 2.0e5, damping = 500.0, free_length = 1.0 }
"#;

fn turning() -> Model {
    model_of(&format!("{TURNING}{STIFF}"))
}

/// Times without a pattern, ascending, in (0, end).
fn scattered(count: usize, end: f64) -> Vec<f64> {
    let golden = 0.618_033_988_749_895;
    let mut times: Vec<f64> = (1..=count).map(|k| (k as f64 * golden).fract() * end).collect();
    times.sort_by(f64::total_cmp);
    times
}

fn with(code: Code, choice: ParametrizationKind, tolerance: f64, end: f64) -> Options {
    Options {
        parametrization: choice,
        dense_output: Some(true),
        max_steps: 200_000,
        ..options(code, tolerance, end)
    }
}

/// Dense output of a run that starts at the model's start.
fn dense(model: &Model, options: &Options) -> (DenseOutput, u64) {
    let outcome = run_from(model, options, None);
    let summary = &outcome.summary;
    assert_eq!(summary.stop.code, "simulation/end-time", "{:?}", options.code);
    let problem = Problem::new(model.clone());
    let dense = DenseOutput::new(&problem, outcome.rows.all.dense).expect("steps of the model");
    assert_eq!(dense.span(), Some((0.0, options.end_time)));
    (dense, summary.statistics.reparametrizations)
}

fn largest(x: &[f64]) -> f64 {
    x.iter().fold(0.0, |m, x| m.max(x.abs()))
}

/// A part of a state with its output rows.
type Part<'a> = (&'static str, &'a [f64], fn(&State) -> Vec<f64>);

/// Largest difference between parts of states and output rows, against the largest value of the part.
fn apart(states: &[State], parts: &[Part<'_>]) -> (f64, &'static str) {
    let mut worst = (0.0, "nothing");
    for (name, rows, part) in parts {
        let values: Vec<f64> = states.iter().flat_map(part).collect();
        assert_eq!(values.len(), rows.len(), "{name}");
        let scale = largest(rows).max(1e-3);
        let apart = values.iter().zip(*rows).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max);
        if apart / scale > worst.0 {
            worst = (apart / scale, *name);
        }
    }
    worst
}

/// Compares states at scattered times with output rows there, and their residuals with zero.
fn compare(
    table: &mut Table,
    name: &str,
    model: &Model,
    code: Code,
    choice: ParametrizationKind,
    end: f64,
) -> u64 {
    let line = format!("{name}, {choice:?}, {}", code.info().name);
    let options = with(code, choice, 1e-4, end);
    let times = scattered(40, end);
    let (mut dense, changes) = dense(model, &options);
    let states: Vec<State> = times.iter().map(|&t| dense.state(t).expect("a state")).collect();
    let again = Options { output: OutputTimes::Listed(times.clone()), ..options };
    let rows = run_from(model, &again, None).rows.all;
    let ledger = |s: &State| vec![s.ledger.initial, s.ledger.dissipated, s.ledger.supplied];
    let (difference, part) = apart(
        &states,
        &[
            ("time", &rows.time, |s| vec![s.t]),
            ("q", &rows.q, |s| s.q.clone()),
            ("velocities", &rows.v, |s| s.v.clone()),
            ("extra states", &rows.z, |s| s.z.clone()),
            ("windings", &rows.winding, |s| s.winding.clone()),
            ("ledger", &rows.ledger, ledger),
        ],
    );
    let (forces, of) = apart(
        &states,
        &[
            ("accelerations", &rows.a, |s| s.a.clone()),
            ("multipliers", &rows.lambda, |s| s.lambda.clone()),
        ],
    );
    let system = Problem::new(model.clone()).system().clone();
    let sizes = system.structure().sizes;
    let (mut position, mut velocity) = (0.0f64, 0.0f64);
    let mut g = system.structure().constraint_pattern.zeros();
    let (mut phi, mut rate) = (vec![0.0; sizes.rows], vec![0.0; sizes.rows]);
    for state in &states {
        system.position_constraints(state.t, &state.q, &mut phi);
        position = position.max(largest(&phi) / system.characteristic_length().max(1.0));
        system.velocity_rhs(state.t, &mut rate);
        rate.iter_mut().for_each(|x| *x = -*x);
        system.constraint_jacobian(&state.q, &mut g);
        g.multiply_add(1.0, &state.v, &mut rate);
        velocity = velocity.max(largest(&rate) / largest(&state.v).max(1.0));
    }
    table.note(
        &line,
        format!(
            "{changes} changes; {difference:.1e} ({part}), {forces:.1e} ({of}); joints {position:.1e}, \
             {velocity:.1e}"
        ),
    );
    table.claim(difference < 1e-12, || format!("{line}: {part} differ by {difference:.1e}"));
    // One ulp of a stiff bushing's length is this part of the largest acceleration.
    table.claim(forces < 1e-8, || format!("{line}: {of} differ by {forces:.1e}"));
    table.claim(position < 1e-10, || format!("{line}: joints are open by {position:.1e}"));
    table.claim(velocity < 1e-10, || format!("{line}: joints open at {velocity:.1e}"));
    changes
}

#[test] // independent truth: output rows at these times, and the joints
fn states_at_any_time_are_the_rows_of_a_run_with_output_there() {
    let mut table = Table::new("dense output against rows");
    for (name, model, end) in [
        ("spatial slider-crank", model_of(SPATIAL_SLIDER_CRANK), 1.0),
        ("driven telescope", model_of(DRIVEN_TELESCOPE), 1.0),
        ("turning", turning(), 1.0),
    ] {
        for code in all_codes() {
            for &(choice, _) in ParametrizationKind::ALL {
                let changes = compare(&mut table, name, &model, code, choice, end);
                // Charts change within these runs, or on the tree never.
                assert_eq!(
                    changes == 0,
                    choice == ParametrizationKind::Tree,
                    "{name}, {code:?}, {choice:?}"
                );
            }
        }
    }
    for (name, text) in [("redundant", PLATFORM), ("kinematic", &format!("{FOUR_BAR}{MOTOR}"))] {
        for code in all_codes() {
            for &(choice, _) in ParametrizationKind::ALL {
                compare(&mut table, name, &model_of(text), code, choice, 1.0);
            }
        }
    }
    for (name, end) in [("slider_crank", 0.3), ("hmmwv14", 1.0), ("hmmwv14_bushing", 0.5)] {
        compare(&mut table, name, &model(name), DEFAULT_CODE, ParametrizationKind::default(), end);
    }
    table.finish();
}

#[test] // independent truth: 40 rad/s, and a run at a tolerance ten thousand times tighter
fn states_between_steps_are_as_accurate_as_at_steps() {
    let model = turning();
    let (end, tolerance) = (2.0, 1e-6);
    let problem = Problem::new(model.clone());
    let channel = |name: &str| {
        let found = problem.channels().iter().find(|c| c.name == name);
        found.unwrap_or_else(|| panic!("no channel {name}")).clone()
    };
    let names = ["bob.position", "bob.velocity", "top.angular_velocity", "hung.position"];
    let truth = |times: &[f64]| {
        let options = Options {
            output: OutputTimes::Listed(times.to_vec()),
            channels: names.map(str::to_owned).to_vec(),
            dense_output: Some(false),
            ..with(Code::Dopri5, ParametrizationKind::Tree, 1e-10, end)
        };
        run_from(&model, &options, None).rows.all.channels
    };
    let between = scattered(60, end);
    let truth_between = truth(&between);
    let (angle, mirror) = (channel("bearing.angle"), channel("coil.angle"));
    for code in all_codes() {
        let options = with(code, ParametrizationKind::Tree, tolerance, end);
        let outcome = run_from(&model, &options, None);
        let log = &outcome.rows.all.steps;
        let starts: Vec<f64> =
            log.iter().filter(|s| s.outcome.name() == "accepted").map(|s| s.t).collect();
        let every = starts.len().div_ceil(60);
        let at_steps: Vec<f64> = starts.iter().step_by(every).copied().collect();
        let segments = outcome.rows.all.dense.clone();
        let mut dense = DenseOutput::new(&problem, segments).expect("steps of the model");
        for &t in &between {
            let state = dense.state(t).expect("a state");
            for (channel, expected) in [(&angle, 40.0 * t), (&mirror, -40.0 * t)] {
                let mut found = [0.0];
                problem.system().channel(channel, &Sample::new(&state), &mut found);
                let error = (found[0] - expected).abs();
                assert!(error < 1e-9, "{code:?}, {}: {error:.1e} rad at {t} s", channel.name);
            }
        }
        let mut errors = |times: &[f64], truth: &[Vec<f64>]| -> Vec<f64> {
            let states: Vec<State> = times.iter().map(|&t| dense.state(t).unwrap()).collect();
            let error = |(name, truth): (&&str, &Vec<f64>)| {
                let channel = channel(name);
                let mut found = vec![0.0; channel.size()];
                let mut worst = 0.0f64;
                for (state, expected) in states.iter().zip(truth.chunks_exact(channel.size())) {
                    problem.system().channel(&channel, &Sample::new(state), &mut found);
                    for (x, y) in found.iter().zip(expected) {
                        worst = worst.max((x - y).abs());
                    }
                }
                worst
            };
            names.iter().zip(truth).map(error).collect()
        };
        let inside = errors(&between, &truth_between);
        let ends = errors(&at_steps, &truth(&at_steps));
        for ((name, inside), ends) in names.iter().zip(&inside).zip(&ends) {
            assert!(
                *inside < ends + 5.0 * tolerance, // of order 3 for SDIRK formulas
                "{code:?}, {name}: {inside:.1e} between steps, {ends:.1e} at steps"
            );
        }
    }
}

#[test] // independent truth: the run that was not interrupted
fn a_run_goes_on_from_a_state_inside_a_step() {
    let model = model_of(SPATIAL_SLIDER_CRANK);
    let (end, tolerance) = (1.0, 1e-6);
    for code in all_codes() {
        for &(choice, _) in ParametrizationKind::ALL {
            let options = with(code, choice, tolerance, end);
            let outcome = run_from(&model, &options, None);
            let problem = Problem::new(model.clone());
            let segments = outcome.rows.all.dense.clone();
            let t = segments.t[segments.len() / 2] + 0.37 * segments.h[segments.len() / 2];
            let mut dense = DenseOutput::new(&problem, segments).expect("steps of the model");
            let middle = dense.state(t).expect("a state");
            let rest = run_from(&model, &options, Some(&middle));
            let (a, b) = (&outcome.summary.end, &rest.summary.end);
            let apart = |x: &[f64], y: &[f64]| {
                x.iter().zip(y).map(|(x, y)| (x - y).abs()).fold(0.0, f64::max)
            };
            let (positions, velocities) = (apart(&a.q, &b.q), apart(&a.v, &b.v) / largest(&a.v));
            assert!(
                positions.max(velocities) < 100.0 * tolerance,
                "{code:?}, {choice:?}: {positions:.1e}, {velocities:.1e}"
            );
            // The ledger goes on too.
            let whole = outcome.summary.energy;
            let parts = rest.summary.energy;
            let (supplied, total) = (whole.supplied - parts.supplied, whole.supplied.abs());
            assert!(supplied.abs() < 1e-3 * total, "{code:?}, {choice:?}: {supplied:.1e} J");
        }
    }
}

#[test] // independent truth: the same states, asked for otherwise
fn a_state_does_not_depend_on_what_was_asked_before() {
    for (model, code) in [
        (turning(), Code::Deabm),
        (turning(), DEFAULT_CODE),
        (model_of(SPATIAL_SLIDER_CRANK), DEFAULT_CODE),
    ] {
        for &(choice, _) in ParametrizationKind::ALL {
            let times = scattered(30, 1.0);
            let (mut dense, _) = dense(&model, &with(code, choice, 1e-4, 1.0));
            let up: Vec<State> = times.iter().map(|&t| dense.state(t).unwrap()).collect();
            let down: Vec<State> = times.iter().rev().map(|&t| dense.state(t).unwrap()).collect();
            assert!(up.iter().eq(down.iter().rev()), "{code:?}, {choice:?}");
        }
    }
}

/// Keeps the steps of each chunk by themselves, with the charts that they use.
#[derive(Default)]
struct Pieces {
    pieces: Vec<Segments>,
    charts: Vec<ChartRecord>,
}

impl Sink for Pieces {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        self.charts.extend_from_slice(&chunk.dense.charts);
        if !chunk.dense.is_empty() {
            let first = *chunk.dense.chart.iter().min().expect("steps");
            let mut piece = chunk.dense.clone();
            piece.charts = self.charts[first..].to_vec();
            piece.charts_before = first;
            self.pieces.push(piece);
        }
        Ok(())
    }

    fn progress(&mut self, _: f64, _: f64, _: u64) -> Flow {
        Flow::Continue
    }
}

#[test] // independent truth: all steps together
fn chunks_serve_by_themselves() {
    let model = model_of(SPATIAL_SLIDER_CRANK);
    let options = Options {
        fixed_step: Some(4e-4),
        ..with(Code::Deabm, ParametrizationKind::Partitioning, 1e-6, 1.0)
    };
    let problem = Problem::new(model.clone());
    let mut pieces = Pieces::default();
    let steps = run(&problem, &options, None, &mut pieces).expect("runs").statistics.steps;
    let (mut whole, changes) = dense(&model, &options);
    assert!(changes > 0 && pieces.pieces.len() > 1, "{} chunks", pieces.pieces.len());
    let mut counted = 0;
    let mut end = 0.0;
    for piece in pieces.pieces {
        counted += piece.len() as u64;
        assert!(piece.t[0] == end && piece.end > end, "{end} s");
        end = piece.end;
        let times = [piece.t[0], 0.5 * (piece.t[0] + piece.end)];
        let mut part = DenseOutput::new(&problem, piece).expect("steps of the model");
        for t in times {
            let (found, expected) = (part.state(t).unwrap(), whole.state(t).unwrap());
            let expected: [Part<'_>; 2] =
                [("q", &expected.q, |s| s.q.clone()), ("velocities", &expected.v, |s| s.v.clone())];
            let (difference, name) = apart(&[found], &expected);
            assert!(difference < 1e-13, "{t} s: {name} differ by {difference:.1e}");
        }
    }
    assert_eq!((counted, end), (steps, 1.0));
}

#[test]
fn what_is_not_there_is_refused() {
    let model = model_of(SPATIAL_SLIDER_CRANK);
    let options = with(DEFAULT_CODE, ParametrizationKind::Tree, 1e-4, 0.1);
    let (mut there, _) = dense(&model, &options);
    for t in [-1e-9, 0.1 + 1e-9, f64::NAN] {
        assert_eq!(there.state(t).unwrap_err().code, "simulation/dense-output", "{t}");
    }
    let segments = run_from(&model, &options, None).rows.all.dense;
    let other = Problem::new(turning());
    let refused = DenseOutput::new(&other, segments.clone()).unwrap_err();
    assert_eq!(refused.code, "simulation/dense-output");
    let mut cut = segments;
    cut.w.pop();
    assert!(DenseOutput::new(&Problem::new(model), cut).is_err());
}

#[test] // independent truth: the run with the changed values
fn a_model_with_other_values_keeps_its_forest() {
    // The softer of two springs is the edge of the forest that was found before their values changed.
    let text = |first: f64, second: f64| {
        format!(
            r#"
holonom = 1
dimension = "spatial"
[bodies]
a = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [1.0, 0.0, 0.0] }}
[forces]
left = {{ type = "bushing", between = ["ground", "a"], point = [0.5, 0.0, 0.0], stiffness = [{first:.1}, {first:.1}, {first:.1}], rotational_stiffness = [10.0, 10.0, 10.0] }}
right = {{ type = "bushing", between = ["ground", "a"], point = [1.5, 0.0, 0.0], stiffness = [{second:.1}, {second:.1}, {second:.1}], rotational_stiffness = [10.0, 10.0, 10.0] }}
[initial.bodies]
a = {{ velocity = [0.1, 0.2, 0.3], angular_velocity = [0.5, 0.2, 0.1] }}
"#
        )
    };
    let changed = model_of(&text(50.0, 400.0));
    let sweep = Problem::new(model_of(&text(400.0, 50.0))).with_model(changed.clone());
    let alone = Problem::new(changed);
    assert_ne!(sweep.system().tree().forest, alone.system().tree().forest);
    let mut rows = holonom::simulation::Memory::default();
    let times = scattered(20, 1.0);
    let options = Options {
        output: OutputTimes::Listed(times.clone()),
        ..with(DEFAULT_CODE, ParametrizationKind::Tree, 1e-6, 1.0)
    };
    run(&sweep, &options, None, &mut rows).expect("runs");
    let mut dense = DenseOutput::new(&alone, rows.all.dense).expect("steps of the model");
    let states: Vec<State> = times.iter().map(|&t| dense.state(t).unwrap()).collect();
    let (difference, _) = apart(&states, &[("q", &rows.all.q, |s| s.q.clone())]);
    assert!(difference < 1e-13, "{difference:.1e}");
}

/// A block of 1 kg on two springs without damping, places in m.
fn on_two_springs(start: [f64; 2], speed: f64, springs: [([f64; 2], f64, f64); 2]) -> Model {
    let spring = |name: &str, (anchor, stiffness, free): ([f64; 2], f64, f64)| {
        format!(
            "{name} = {{ type = \"tsda\", between = [\"ground\", \"block\"], points = [{anchor:?}, {start:?}], \
             stiffness = {stiffness}, free_length = {free} }}\n"
        )
    };
    model_of(&format!(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\n\
         block = {{ mass = 1.0, inertia = 1.0, position = {start:?} }}\n[forces]\n{}{}\
         [initial.bodies]\nblock = {{ velocity = [{speed}, 0.0] }}\n",
        spring("first", springs[0]),
        spring("second", springs[1]),
    ))
}

#[test] // independent truth: the equations of the block by DOP853
fn rows_that_are_far_apart_are_on_the_branch_of_the_motion() {
    let cases = [
        (
            [-5.303_161_222_313_22, 0.011_009_058_657_291_657],
            2.972_284_191_490_276,
            [
                ([0.0, 0.0], 14.066_547_482_176_777, 0.766_648_727_222_179_8),
                (
                    [0.795_040_210_366_749_5, 0.256_201_709_729_813_7],
                    18.897_100_196_380_446,
                    0.367_778_793_019_382_3,
                ),
            ],
            (4.650_917_976_115_57, 100),
        ),
        (
            [-1.434_963_047_829_133_8, 0.003_030_243_221_567_908_3],
            0.576_620_357_201_063,
            [
                ([0.0, 0.0], 1.246_185_926_227_538_5, 1.052_739_047_307_197_1),
                (
                    [3.514_247_971_579_252, -0.958_706_290_411_425],
                    1.280_850_727_641_330_3,
                    1.366_982_255_014_781_4,
                ),
            ],
            (13.2, 13),
        ),
    ];
    for (start, speed, springs, (end, rows)) in cases {
        let model = on_two_springs(start, speed, springs);
        let interval = end / f64::from(rows);
        let rate = |_: f64, y: &[f64]| {
            let mut force = [0.0; 2];
            for (anchor, stiffness, free) in springs {
                let d = [y[0] - anchor[0], y[1] - anchor[1]];
                let length = d[0].hypot(d[1]);
                for k in 0..2 {
                    force[k] -= stiffness * (length - free) * d[k] / length;
                }
            }
            vec![y[2], y[3], force[0], force[1]]
        };
        for code in CODES.iter().map(|info| info.code) {
            let outcome = run_model(
                &model,
                &Options {
                    channels: vec!["block.position".to_owned()],
                    output: OutputTimes::Interval(interval),
                    ..options(code, 1e-6, end)
                },
            );
            let truth = tight(&rate, &[start[0], start[1], speed, 0.0], outcome.times());
            let place = |k| outcome.series("block.position", k);
            for (row, y) in truth.iter().enumerate() {
                let off = (place(0)[row] - y[0]).hypot(place(1)[row] - y[1]);
                // What is off by a step's errors is some thousandths of that.
                assert!(off < 1e-2, "{code:?} at {}: {off}", outcome.times()[row]);
            }
        }
    }
}

#[test] // independent truth: which axes the rotation of a bushing was along; 53° apart, places between rows were 29 mm off
fn steps_whose_rotations_were_along_other_axes_are_refused() {
    for (axes, refused) in [
        ("axes = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]", true),
        ("axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]", false),
    ] {
        let model = model_of(&format!(
            "holonom = 1\ndimension = \"spatial\"\n[bodies]\nb = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], \
             [0.0, 0.0, 0.15]], position = [0.3, 0.0, 0.0] }}\n[forces]\nm = {{ type = \"bushing\", between = [\"ground\", \
             \"b\"], point = [0.0, 0.0, 0.0], {axes}, stiffness = [1e3, 2e3, 1e3], rotational_stiffness = [10.0, 20.0, 5.0] }}\n"
        ));
        let problem = Problem::new(model.clone());
        let outcome = run_model(&model, &with(DEFAULT_CODE, ParametrizationKind::Tree, 1e-4, 0.2));
        let mut segments = outcome.rows.all.dense;
        assert!(DenseOutput::new(&problem, segments.clone()).is_ok(), "{axes}");
        segments.charts.iter_mut().for_each(|chart| chart.own_axes = false);
        assert_eq!(DenseOutput::new(&problem, segments).is_err(), refused, "{axes}");
    }
}

#[test] // independent truth: the axes of which body a swinging arm's bushing was measured along
fn steps_whose_bushings_were_along_axes_of_the_other_body_are_refused() {
    for (between, refused) in [(["ground", "b"], true), (["b", "ground"], false)] {
        let model = model_of(&format!(
            "holonom = 1\ndimension = \"spatial\"\n[bodies]\nb = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], \
             [0.0, 0.0, 0.1]], position = [0.3, 0.0, 0.0] }}\n[forces]\nm = {{ type = \"bushing\", between = {between:?}, \
             point = [0.0, 0.0, 0.0], stiffness = [1e4, 1e4, 1e4] }}\n"
        ));
        let problem = Problem::new(model.clone());
        let outcome = run_model(&model, &with(DEFAULT_CODE, ParametrizationKind::Tree, 1e-4, 0.2));
        let mut segments = outcome.rows.all.dense;
        assert!(DenseOutput::new(&problem, segments.clone()).is_ok(), "{between:?}");
        segments.charts.iter_mut().for_each(|chart| chart.in_second_axes.clear());
        assert_eq!(DenseOutput::new(&problem, segments).is_err(), refused, "{between:?}");
    }
}

#[test] // independent truth: two links thrown as one body turn as one, at 1 rad/s
fn rows_of_explicit_codes_are_right_where_something_stiff_is_at_rest() {
    let pair = |damping: f64, inertia: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
a = {{ mass = 0.94, inertia = {inertia:e}, position = [0.01, 0.0] }}
b = {{ mass = 20.0, inertia = 5e-4, position = [0.03, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["a", "b"], point = [0.02, 0.0] }}
[forces]
spring = {{ type = "rsda", between = ["a", "b"], stiffness = 1.3, damping = {damping:e} }}
[initial.bodies]
a = {{ velocity = [-2.0, 6.0], angular_velocity = 1.0 }}
b = {{ velocity = [-2.0, 6.02], angular_velocity = 1.0 }}
"#
        ))
    };
    let mut table = Table::new("two links that turn as one, by explicit codes");
    for (damping, inertia) in [(0.1, 2e-5), (0.02, 2e-5), (0.3, 5e-5), (0.1, 1e-4)] {
        let model = pair(damping, inertia);
        for code in CODES.iter().filter(|info| info.code.is_explicit()).map(|info| info.code) {
            for tolerance in [1e-2, 1e-3, 1e-4, 1e-5] {
                let asked = Options {
                    channels: vec!["a.angular_velocity".to_owned(), "a.angle".to_owned()],
                    output: OutputTimes::Interval(2e-3),
                    ..options(code, tolerance, 0.8)
                };
                let outcome = run_model(&model, &asked);
                let worst = |channel: &str, truth: &dyn Fn(f64) -> f64| {
                    let rows = outcome.times().iter().zip(outcome.series(channel, 0));
                    rows.fold(0.0f64, |most, (t, x)| most.max((x - truth(*t)).abs())) / tolerance
                };
                let off = [worst("a.angle", &|t| t), worst("a.angular_velocity", &|_| 1.0)];
                table.claim(off[0] < 1.0 && off[1] < 60.0, || {
                    format!("{code:?} at {tolerance:e}, damping {damping}: {off:?} tolerances")
                });
            }
        }
    }
    table.finish();
}

/// A slider of that mass on a spring with that stiffness and damping, under a force A sin ωt.
fn pushed_slider(mass: f64, [stiffness, damping]: [f64; 2], [a, w]: [f64; 2]) -> String {
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
slider = {{ mass = {mass:e}, inertia = 1e-4, position = [0.0, 0.0] }}
[joints]
slide = {{ type = "translational", between = ["ground", "slider"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "slider"], points = [[9.0, 0.0], [0.0, 0.0]], stiffness = {stiffness:e}, damping = {damping:e}, free_length = 9.0 }}
push = {{ type = "point_force", on = "slider", point = [0.0, 0.0], direction = [1.0, 0.0], force = {{ type = "harmonic", amplitude = {a:e}, angular_frequency = {w:e} }} }}
"#
    )
}

/// A slider of mass m that a damper rules under a force A sin ωt: its model, and m v̇ + c v = A sin ωt from rest.
fn ruled_by_a_damper(mass: f64, amplitude: f64, frequency: f64, end: f64) -> Case {
    let damping = 20.0;
    let text = pushed_slider(mass, [0.0, damping], [amplitude, frequency]);
    let lag = mass * frequency;
    let scale = amplitude / (damping * damping + lag * lag);
    let motion = |t: f64| {
        let (sin, cos) = (frequency * t).sin_cos();
        let left = (-damping * t / mass).exp();
        let place = damping * (1.0 - cos) / frequency - mass * sin;
        let place = place + lag * mass / damping * (1.0 - left);
        [scale * place, scale * (damping * sin + lag * (left - cos))]
    };
    let rows = |k: usize| times(end, 400).into_iter().map(move |t| vec![motion(t)[k], 0.0]);
    let place = truth("slider.position", Kind::Point, rows(0));
    Case::new(&text, end, vec![place, truth("slider.velocity", Kind::Velocity, rows(1))])
}

#[test] // independent truth: m v̇ + c v = A sin ωt; of slopes summed up, velocities were up to 2,000 tolerances off between steps
fn velocities_that_dampers_rule_are_right_between_steps() {
    let mut table = Table::new("a slider ruled by a damper");
    let bounds = Bounds { position: 10.0, velocity: 30.0, ..Bounds::usual() };
    for (mass, frequency) in [(1e-6, 50.0), (1e-4, 5.0)] {
        let case = ruled_by_a_damper(mass, 20.0, frequency, 60.0 / frequency);
        let case = Case { max_steps: 100_000, ..case };
        for manner in std::iter::once(DEFAULT).chain(OTHERS) {
            for code in implicit() {
                if manner.profile == Profile::Thesis && code == Code::ForRosen {
                    continue; // Its errors there are those of ends of steps.
                }
                let line = format!("{mass:e} kg, {}", line("slider", manner, code));
                for tolerance in [1e-3, 1e-4, 1e-6] {
                    let run = measure(&case, manner, code, tolerance);
                    table.run(&line, &format!("{tolerance:.0e}"), &run, bounds);
                }
            }
        }
    }
    table.finish();
}

#[test] // independent truth: m v̇ + c v = A sin ωt; steps that are as long as periods passed by chance, with rows up to 9,000 tolerances off
fn fast_forces_are_followed_between_steps() {
    let mut table = Table::new("a slider ruled by a damper, under fast forces");
    let bounds = Bounds { position: 10.0, velocity: 60.0, ..Bounds::usual() };
    for (mass, speed, frequency, end) in
        [(4e-8, 0.18278, 5619.7, 0.1), (1e-8, 1.0, 7210.0, 0.02), (1e-6, 1.0, 1000.0, 0.1)]
    {
        let case = ruled_by_a_damper(mass, 20.0 * speed, frequency, end);
        let case = Case { max_steps: 100_000, ..case };
        for manner in std::iter::once(DEFAULT).chain(OTHERS) {
            for code in implicit().into_iter().filter(|code| *code != Code::ForRosen) {
                let line = format!("{frequency} rad/s, {}", line("slider", manner, code));
                for tolerance in [1e-3, 1e-4, 1e-5] {
                    let run = measure(&case, manner, code, tolerance);
                    table.run(&line, &format!("{tolerance:.0e}"), &run, bounds);
                }
            }
        }
    }
    table.finish();
}

#[test] // independent truth: the trapezoidal rule, by which what rings goes on along lines; what a damper rules is led to balance
fn rates_that_ring_stay_lines() {
    let moving = "[initial.bodies]\nslider = { velocity = [1.0, 0.0] }\n";
    let rail = |stiffness: f64, damping: f64, mass: f64| {
        model_of(&(pushed_slider(mass, [stiffness, damping], [20.0, 50.0]) + moving))
    };
    // How far rates are from lines in the middles of steps, m/s.
    let bend = |model: &Model, code: Code| {
        let h = 0.02;
        let asked = Options {
            fixed_step: Some(h),
            channels: vec!["slider.velocity".to_owned()],
            output: OutputTimes::Listed((0..=100).map(|k| 0.5 * h * f64::from(k)).collect()),
            ..options(code, 1e-4, 50.0 * h)
        };
        let rates = run_model(model, &asked).series("slider.velocity", 0);
        let bend = |step: &[f64]| (step[1] - 0.5 * (step[0] + step[2])).abs();
        rates.windows(3).step_by(2).map(bend).fold(0.0, f64::max)
    };
    for code in [Code::SspTrap, Code::InflTrap] {
        let (rings, follows) =
            (bend(&rail(1e6, 0.0, 1.0), code), bend(&rail(0.0, 20.0, 1e-6), code));
        assert!(rings < 1e-9, "{code:?}: a vibration bends by {rings}");
        assert!(follows > 0.05, "{code:?}: what follows a force bends by {follows}");
    }
}
