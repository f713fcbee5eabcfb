//! The error estimate of a step against its true local error: the step repeated at a tiny tolerance from the state
//! that it started from.

use crate::common::table::{Table, all_codes};
use crate::common::{
    DRIVEN_PENDULUM, DRIVEN_TELESCOPE, LIBRARY, SPATIAL_SLIDER_CRANK, model, model_of, options,
};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::model::{Dimension, Model};
use holonom::simulation::{Chunk, Memory, Options, OutputTimes, Problem, Status, StepOutcome, run};
use holonom::system::State;

const TOLERANCE: f64 = 1e-4;
/// Tolerance of the repetition.
const TINY: f64 = 1e-10;
/// Estimates below this are not compared: both are far inside the tolerance.
const SMALL: f64 = 0.1;
/// The largest true error over the estimate, and the part of all steps that may be above it.
const RATIO: f64 = 3.0;
const PART: f64 = 0.01;
/// Steps looked at per run.
const SAMPLES: usize = if cfg!(feature = "long") { 150 } else { 20 };

/// Row `k` as a state.
fn state(rows: &Chunk, k: usize) -> State {
    let count = rows.time.len();
    let row = |all: &[f64]| {
        let width = all.len() / count;
        all[k * width..(k + 1) * width].to_vec()
    };
    State {
        t: rows.time[k],
        q: row(&rows.q),
        v: row(&rows.v),
        a: row(&rows.a),
        lambda: row(&rows.lambda),
        z: row(&rows.z),
        winding: row(&rows.winding),
        ..State::default()
    }
}

fn length(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|v| v * v).sum::<f64>().sqrt()
}

/// The measure of errors of the documentation: per body translation, rotation and their velocities, root mean
/// square within a body, largest over the bodies. `from` is the start of the step, `start` that of the run.
fn distance(dimension: Dimension, a: &State, b: &State, from: &State, start: &State) -> f64 {
    let (n, d, angles) = if dimension == Dimension::Planar { (3, 2, 1.0) } else { (7, 3, 2.0) };
    let mut worst = 0.0f64;
    for body in 0..a.q.len() / n {
        let at = |x: &[f64]| {
            [x[body * n..body * n + d].to_vec(), x[body * n + d..(body + 1) * n].to_vec()]
        };
        let apart = |a: &[f64], b: &[f64], part: usize| {
            length(at(a)[part].iter().zip(&at(b)[part]).map(|(x, y)| x - y))
        };
        let turned = if angles == 1.0 {
            let angle = apart(&from.q, &start.q, 1) % std::f64::consts::TAU;
            angle.min(std::f64::consts::TAU - angle)
        } else {
            let cosine: f64 = at(&from.q)[1].iter().zip(&at(&start.q)[1]).map(|(x, y)| x * y).sum();
            2.0 * cosine.abs().min(1.0).acos()
        };
        let speed = |part: usize| length(at(&from.v)[part].iter().copied());
        let parts = [
            apart(&a.q, &b.q, 0) / (1.0 + apart(&from.q, &start.q, 0)),
            angles * apart(&a.q, &b.q, 1) / (1.0 + turned),
            apart(&a.v, &b.v, 0) / (1.0 + speed(0)),
            angles * apart(&a.v, &b.v, 1) / (1.0 + angles * speed(1)),
        ];
        worst = worst.max(0.5 * length(parts.into_iter()) / TOLERANCE);
    }
    worst
}

/// Steps looked at, those whose true error is too far above the estimate, and the largest ratio.
fn judge(model: &Model, code: Code, end: f64) -> (usize, usize, f64) {
    let problem = Problem::new(model.clone());
    let go = |options: &Options, from: Option<&State>| {
        let mut rows = Memory::default();
        let summary = run(&problem, options, from, &mut rows).unwrap();
        (summary, rows.all)
    };
    let base = Options { max_steps: 5000, ..options(code, TOLERANCE, end) };
    let (summary, first) = go(&base, None);
    let accepted: Vec<_> =
        first.steps.iter().filter(|s| s.outcome == StepOutcome::Accepted).collect();
    // The same run once more with a row at the ends of all steps.
    let mut times: Vec<f64> = accepted.iter().map(|step| step.t).collect();
    times.push(summary.end.t);
    let with_rows = Options { output: OutputTimes::Listed(times.clone()), ..base };
    let (_, rows) = go(&with_rows, None);
    let same = rows.steps.iter().zip(&first.steps).all(|(a, b)| a.t == b.t && a.h == b.h);
    assert!(same, "rows at the ends of steps change the steps of {code:?}");
    let start = state(&rows, 0);
    let (mut count, mut above, mut worst) = (0, 0, 0.0f64);
    let every = accepted.len().div_ceil(SAMPLES).max(1);
    for k in (0..accepted.len()).step_by(every) {
        let (from, to) = (state(&rows, k), state(&rows, k + 1));
        let tight = Options { max_steps: 20_000, ..options(Code::ForRadau, TINY, times[k + 1]) };
        let (truth, _) = go(&tight, Some(&from));
        if truth.status != Status::Completed {
            continue;
        }
        let found = distance(model.dimension, &to, &truth.end, &from, &start);
        let ratio = found / accepted[k].error.max(SMALL);
        count += 1;
        above += usize::from(ratio > RATIO);
        worst = worst.max(ratio);
    }
    (count, above, worst)
}

/// A heavy top that nutates.
const TOP: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
body = { mass = 0.5, inertia = [[4e-4, 0.0, 0.0], [0.0, 4e-4, 0.0], [0.0, 0.0, 5e-4]], position = [0.0, 0.015, 0.0477] }
[joints]
pivot = { type = "spherical", between = ["ground", "body"], point = [0.0, 0.0, 0.0] }
[initial.bodies]
body = { angular_velocity = [0.0, 20.0, 100.0] }
"#;

const FREE: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
body = { mass = 1.0, inertia = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.8]], position = [0.0, 0.0, 0.0] }
[initial.bodies]
body = { angular_velocity = [3.0, 1.0, 2.5] }
"#;

const ROD: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
bob = { mass = 1.0, inertia = 0.01, position = [1.0, 0.0] }
[joints]
rod = { type = "distance", between = ["ground", "bob"], points = [[0.0, 0.0], [1.0, 0.0]] }
[initial.bodies]
bob = { velocity = [0.0, 8.0] }
"#;

/// A point mass that whirls on a rod in space.
const WHIRL: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
bob = { mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]], position = [0.8, 0.0, -0.6] }
[joints]
rod = { type = "distance", between = ["ground", "bob"], points = [[0.0, 0.0, 0.0], [0.8, 0.0, -0.6]] }
[initial.bodies]
bob = { velocity = [0.0, 9.0, 0.0] }
"#;

fn spring(k: f64, c: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
body = {{ mass = 1.0, inertia = 0.02, position = [1.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "body"], points_in_body = [[0.0, 0.0], [0.0, 0.0]], stiffness = {k:e}, damping = {c:e}, free_length = 1.0 }}
[initial.bodies]
body = {{ velocity = [0.0, 4.0] }}
"#
    )
}

fn bushing(k: f64, c: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, -9.81, 0.0]
[bodies]
crank = {{ mass = 2.0, inertia = [[0.6, 0.0, 0.0], [0.0, 0.6, 0.0], [0.0, 0.0, 0.6]], position = [0.0, 0.0, 0.0] }}
body = {{ mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.015]], position = [0.8, 0.0, 0.0] }}
[joints]
bearing = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
[forces]
bushing = {{ type = "bushing", between = ["crank", "body"], point = [0.5, 0.0, 0.0], stiffness = [{k:e}, {k:e}, {k:e}], damping = [{c:e}, {c:e}, {c:e}] }}
[initial.bodies]
crank = {{ angular_velocity = [0.0, 0.0, 8.0] }}
body = {{ velocity = [0.0, 6.4, 0.0], angular_velocity = [0.0, 0.0, 8.0] }}
"#
    )
}

#[test] // independent truth: the same step at a tiny tolerance
fn the_estimate_holds_what_it_says() {
    let mut cases: Vec<(String, Model, f64)> = [
        ("spinning top", TOP.to_owned()),
        ("free body", FREE.to_owned()),
        ("rod in the plane", ROD.to_owned()),
        ("rod in space", WHIRL.to_owned()),
        ("spatial slider-crank", SPATIAL_SLIDER_CRANK.to_owned()),
        ("driven pendulum", DRIVEN_PENDULUM.to_owned()),
        ("driven telescope", DRIVEN_TELESCOPE.to_owned()),
        ("spring 1e5", spring(1e5, 1e4)),
        ("spring 1e9", spring(1e9, 1e6)),
        ("bushing 1e5", bushing(1e5, 1e4)),
        ("bushing 1e8", bushing(1e8, 1e5)),
    ]
    .into_iter()
    .map(|(name, text)| (name.to_owned(), model_of(&text), 1.0))
    .collect();
    let own = cases.len();
    for name in LIBRARY {
        let model = model(name);
        let end = model.simulation.end_time.unwrap_or(1.0);
        let large = matches!(*name, "chain50" | "chain50_free" | "hmmwv14" | "hmmwv14_bushing");
        // Of large models the first part serves: a repetition costs twenty steps of them.
        if !large || cfg!(feature = "long") {
            cases.push(((*name).to_owned(), model, if large { 0.5 * end } else { end }));
        }
    }
    let mut table = Table::new("true local error over the estimate");
    let codes =
        if cfg!(feature = "long") { all_codes() } else { vec![DEFAULT_CODE, Code::ForSdirk] };
    for code in codes {
        let explicit = code.is_explicit();
        let (mut count, mut above) = (0, 0);
        for (i, (name, model, end)) in cases.iter().enumerate() {
            let stiff = name.contains("1e")
                || i >= own
                    && !matches!(
                        &**name,
                        "andrews" | "slider_crank" | "spatial_four_bar" | "simple_pendulum"
                    );
            let large = model.bodies.len() > 13;
            if explicit && stiff || large && code != DEFAULT_CODE {
                continue;
            }
            let (n, m, worst) = judge(model, code, *end);
            table.note(code.info().name, format!("{name} {worst:.2} ({m} of {n})"));
            (count, above) = (count + n, above + m);
        }
        table.claim(above as f64 <= PART * count as f64, || {
            format!(
                "{}: {above} of {count} steps above {RATIO} times the estimate",
                code.info().name
            )
        });
    }
    table.finish();
}
