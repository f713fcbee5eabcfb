//! The same model and options give the same bits.

mod common;

use std::fmt::Write as _;

use common::{ALL_CODES, model, model_of, options, run_model};
use holonom::method::Code;
use holonom::model::Model;
use holonom::newton::Representation;
use holonom::simulation::{Options, OutputTimes, Statistics};
use holonom::threads::Threads;

/// Every bit of the rows, the step log and the counted work of a run.
fn bits(model: &Model, code: Code, end: f64) -> (Vec<u64>, Vec<u64>) {
    bits_of(model, &options(code, 1e-4, end))
}

fn bits_of(model: &Model, options: &Options) -> (Vec<u64>, Vec<u64>) {
    let channels = vec!["energy.imbalance".to_owned(), "constraint.acceleration".to_owned()];
    let output = OutputTimes::Interval(options.end_time / 20.0);
    let options = Options { output, channels, ..options.clone() };
    let outcome = run_model(model, &options);
    let all = &outcome.rows.all;
    let steps = all.steps.iter().flat_map(|s| [s.t, s.h, s.error, s.condition]);
    let rows = [&all.time, &all.q, &all.v, &all.a, &all.lambda, &all.z, &all.ledger];
    let values = rows.into_iter().chain(&all.channels).flatten().copied();
    assert!(all.q.len() > 20);
    // Wall times are the only thing that may differ.
    let Statistics { steps: accepted, evaluations, jacobians, iterations, corrections, .. } =
        outcome.summary.statistics;
    let work = vec![accepted, evaluations, jacobians, iterations, corrections];
    (values.chain(steps).map(f64::to_bits).collect(), work)
}

#[test] // independent truth: the first of the two runs
fn two_runs_give_the_same_bits() {
    for code in ALL_CODES {
        let andrews = model("andrews");
        assert!(bits(&andrews, code, 0.01) == bits(&andrews, code, 0.01), "{code:?}");
        let telescope = model_of(common::DRIVEN_TELESCOPE);
        assert!(bits(&telescope, code, 1.0) == bits(&telescope, code, 1.0), "{code:?}");
    }
    let vehicle = model("hmmwv14");
    for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau] {
        assert!(bits(&vehicle, code, 0.7) == bits(&vehicle, code, 0.7), "{code:?}");
    }
}

#[test] // independent truth: the run on this thread
fn a_run_on_another_thread_gives_the_same_bits() {
    let here = bits(&model("andrews"), Code::ForSdirk, 0.01);
    let threads: Vec<_> = (0..3)
        .map(|_| std::thread::spawn(|| bits(&model("andrews"), Code::ForSdirk, 0.01)))
        .collect();
    for thread in threads {
        assert!(thread.join().expect("the run ends") == here);
    }
}

/// Bars on hinges with springs, some with Maxwell elements, bar i hanging from bar `parent(i)`, the first from the
/// ground, all stretched out; at the ends of some a bar more closes a loop.
fn bars(planar: bool, count: usize, parent: impl Fn(usize) -> usize, loops: bool) -> Model {
    let (dimension, zero) = if planar { ("planar", "") } else { ("spatial", ", 0.0") };
    let inertia = if planar { "0.1" } else { "[[0.01, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]" };
    let mut depth = vec![0; count + 1];
    let mut text = format!("holonom = 1\ntitle = \"bars\"\ndimension = \"{dimension}\"\n");
    writeln!(text, "gravity = [0.0, -9.81{zero}]").unwrap();
    for i in 1..=count {
        let above = parent(i);
        depth[i] = depth[above] + 1;
        let other = if above == 0 { "ground".into() } else { format!("bar_{above}") };
        let end = if above == 0 { 0.0 } else { 0.5 };
        let axis = match (planar, i % 2) {
            (true, _) => "",
            (false, 0) => "axis = [0.0, 0.0, 1.0]\n",
            (false, _) => "axis = [0.0, 1.0, 0.0]\n",
        };
        let x = f64::from(depth[i]) - 0.5;
        write!(
            text,
            "[bodies.bar_{i}]\nmass = 1.0\ninertia = {inertia}\nposition = [{x}, 0.0{zero}]\n\
             [joints.hinge_{i}]\ntype = \"revolute\"\nbetween = [\"{other}\", \"bar_{i}\"]\n\
             points_in_body = [[{end}, 0.0{zero}], [-0.5, 0.0{zero}]]\n{axis}\
             [forces.spring_{i}]\ntype = \"rsda\"\nbetween = [\"{other}\", \"bar_{i}\"]\n\
             stiffness = {stiffness}\ndamping = 10.0\n{axis}",
            stiffness = 1e3 * (1.0 + (i % 7) as f64),
        )
        .unwrap();
        if i % 5 == 3 {
            write!(
                text,
                "[forces.relaxing_{i}]\ntype = \"maxwell\"\nbetween = [\"{other}\", \"bar_{i}\"]\n\
                 points_in_body = [[0.1, 0.2{zero}], [0.0, 0.3{zero}]]\nstiffness = 1e4\n\
                 damping = 50.0\nfree_length = 0.9\n",
            )
            .unwrap();
        }
        if loops && i % 10 == 0 {
            let x = f64::from(depth[i]);
            write!(
                text,
                "[joints.link_{i}]\ntype = \"distance\"\nbetween = [\"ground\", \"bar_{i}\"]\n\
                 points_in_body = [[{x}, 3.0{zero}], [0.5, 0.0{zero}]]\nlength = 3.0\n",
            )
            .unwrap();
        }
    }
    model_of(&text)
}

#[test] // independent truth: the calling thread alone
fn threads_give_the_same_bits() {
    let models = [
        ("binary tree", bars(true, 600, |i| i / 2, false)),
        ("star", bars(true, 500, |i| usize::from(i > 1), false)),
        ("separate bars", bars(true, 450, |_| 0, false)),
        ("comb", bars(true, 450, |i| if i % 3 == 1 { i.max(3) - 3 } else { i - 1 }, false)),
        ("binary tree in space", bars(false, 250, |i| i / 2, false)),
        ("tree with loops", bars(true, 420, |i| i / 2, true)),
    ];
    for (name, model) in &models {
        for code in [Code::ForRadau, Code::ForSdirk] {
            let run = |threads: usize| {
                let threads = Threads::new(threads).unwrap();
                let newton = Representation::Sparse;
                bits_of(model, &Options { threads, newton, ..options(code, 1e-3, 0.02) })
            };
            let alone = run(1);
            for threads in [2, 4] {
                assert!(run(threads) == alone, "{name} with {code:?} and {threads} threads");
            }
        }
    }
}
