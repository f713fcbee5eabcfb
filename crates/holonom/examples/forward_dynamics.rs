//! How long does one evaluation of accelerations in joint coordinates take? Prints microseconds and counts as
//! comma-separated values and writes the states with their accelerations, for other codes to compare with: `cargo run
//! --release -p holonom --example forward_dynamics -- model.toml 1.0 states.txt`. The number is how far
//! independent variables swing, m and rad. `benchmarks/pinocchio` asks and answers.

#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use cpu_time::ThreadTime;
use holonom::io::{Document, Syntax};
use holonom::reduction::Point;
use holonom::simulation::Problem;
use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write;

const STATES: usize = 64;
const ROUNDS: usize = 9;
/// Of one round, s.
const ROUND_SECONDS: f64 = 0.02;

/// Deterministic numbers in (-1, 1).
fn noise() -> impl FnMut() -> f64 {
    let mut state = 88_172_645_463_325_252_u64;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Microseconds of processor time of this thread for one state.
fn microseconds(work: &mut dyn FnMut()) -> f64 {
    let mut passes = 1;
    let mut times = Vec::new();
    while times.len() < ROUNDS {
        let start = ThreadTime::now();
        (0..passes).for_each(|_| work());
        let seconds = start.elapsed().as_secs_f64();
        if seconds < ROUND_SECONDS {
            passes *= 2;
        } else {
            times.push(1e6 * seconds / (passes * STATES) as f64);
        }
    }
    times.sort_by(f64::total_cmp);
    times[ROUNDS / 2]
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().collect();
    let [_, model, swing, states] = arguments.as_slice() else {
        return Err("a model, a number and a file of states".into());
    };
    let (swing, text) = (swing.parse::<f64>()?, std::fs::read_to_string(model)?);
    let mut none = |_: &str| Err("no other file".to_owned());
    let (model, _) = Document::parse(&text, Syntax::Toml, model, &mut none)
        .and_then(|document| document.build())
        .map_err(|errors| errors.render())?;
    let problem = Problem::new(model);
    let assembled = problem.assemble().map_err(|e| e.to_string())?;
    let mut manifold = assembled.manifold();
    if !manifold.use_joint_coordinates(&assembled.state.q, usize::MAX) {
        return Err("no joint coordinates".into());
    }
    let [coordinates, rows, _] = manifold.joint_sizes().unwrap_or_default();
    let ndof = manifold.chart().ndof();
    let (mut start, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
    manifold.independent_state(&assembled.state, &mut start, &mut rates);

    // A closed way at random: each state is near the one before, as in a run; rates of its own.
    let mut noise = noise();
    let phases: Vec<f64> = (0..ndof).map(|_| 0.5 * TAU * noise()).collect();
    let given: Vec<[Vec<f64>; 2]> = (0..STATES)
        .map(|k| {
            let turn = TAU * k as f64 / STATES as f64;
            let way = start.iter().zip(&phases);
            let p = way.map(|(p, phase)| p + swing * (turn + phase).sin());
            [p.collect(), (0..ndof).map(|_| noise()).collect()]
        })
        .collect();

    let mut point = Point::new(manifold, &assembled.state);
    let mut text = format!("{}\n", point.manifold.system().structure().sizes.per_body);
    for [p, rates] in &given {
        point.evaluate(0.0, p, rates, &[], true).map_err(|e| e.message)?;
        let state = &point.state;
        for x in state.q.iter().chain(&state.v).chain(&state.a) {
            write!(text, "{x:e} ")?;
        }
        text.push('\n');
    }
    std::fs::write(states, text)?;

    let before = point.manifold.counters;
    let (mut z_rate, mut v) = (point.z_rate.clone(), point.state.v.clone());
    let whole = microseconds(&mut || {
        for [p, rates] in &given {
            point.evaluate(0.0, p, rates, &[], true).expect("evaluated before");
        }
    });
    // The same with all but the positions once more.
    let twice = microseconds(&mut || {
        for [p, rates] in &given {
            point.evaluate(0.0, p, rates, &[], true).expect("evaluated before");
            let Point { manifold, state, .. } = &mut point;
            manifold
                .recover_velocity(0.0, &state.q, rates, &mut v, true)
                .and_then(|()| manifold.accelerate(state, &mut z_rate))
                .expect("evaluated before");
        }
    });
    let after = point.manifold.counters;
    let corrections = after.corrections - before.corrections;
    let corrections = corrections as f64 / (after.recoveries - before.recoveries) as f64;
    println!("coordinates,rows,evaluation,at known positions,corrections,left_to_others");
    println!(
        "{coordinates},{rows},{whole:.3},{:.3},{corrections:.1},{}",
        twice - whole,
        after.left_to_cartesian
    );
    Ok(())
}
