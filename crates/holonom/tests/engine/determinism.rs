//! The same model and options give the same bits.

use crate::common::table::all_codes;
use crate::common::{model, model_of, options, run_model};
use holonom::method::Code;
use holonom::model::Model;
use holonom::newton::Representation;
use holonom::reduction::Point;
use holonom::simulation::{Options, OutputTimes, Problem, Statistics};
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
    for code in all_codes() {
        let andrews = model("andrews");
        assert!(bits(&andrews, code, 0.01) == bits(&andrews, code, 0.01), "{code:?}");
        let telescope = model_of(crate::common::DRIVEN_TELESCOPE);
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

#[test] // independent truth: the calling thread alone
fn threads_give_the_same_bits() {
    let models = [
        ("binary tree", crate::common::bars(true, 1300, |i| i / 2, [false, true])),
        ("star", crate::common::bars(true, 1200, |i| usize::from(i > 1), [false, true])),
        ("separate bars", crate::common::bars(true, 1200, |_| 0, [false, true])),
        (
            "comb",
            crate::common::bars(
                true,
                1200,
                |i| if i % 3 == 1 { i.max(3) - 3 } else { i - 1 },
                [false, true],
            ),
        ),
        ("binary tree in space", crate::common::bars(false, 250, |i| i / 2, [false, true])),
        ("tree with loops", crate::common::bars(true, 1200, |i| i / 2, [true, true])),
    ];
    // Enough of each that threads share the work.
    for (name, model) in &models {
        for code in [Code::ForRadau, Code::ForSdirk] {
            let run = |threads: usize, newton: Representation| {
                let threads = Threads::new(threads);
                bits_of(model, &Options { threads, newton, ..options(code, 1e-3, 0.02) })
            };
            for newton in [Representation::Sparse, Representation::Simplified] {
                let alone = run(1, newton);
                for threads in [2, 4] {
                    let shared = run(threads, newton);
                    assert!(shared == alone, "{name}: {code:?}, {newton:?}, {threads} threads");
                }
            }
        }
    }
}

#[test] // independent truth: the calling thread alone
fn threads_change_nothing_where_the_matrix_is_chosen() {
    for model in [model("hmmwv14"), crate::common::bars(true, 120, |i| i / 2, [true, true])] {
        let run = |threads: usize| {
            let threads = Threads::new(threads);
            bits_of(&model, &Options { threads, ..options(Code::ForRadau, 1e-3, 0.05) })
        };
        assert!(run(2) == run(1));
    }
}

#[test] // independent truth: the calling thread alone
fn threads_give_the_same_accelerations() {
    let parents: [(&str, fn(usize) -> usize); 4] = [
        ("binary tree", |i| i / 2),
        ("trees on four roots", |i| i.saturating_sub(2) / 3),
        ("chains beside each other", |i| i.saturating_sub(20)),
        ("separate bars", |_| 0),
    ];
    for (planar, count) in [(true, 4500), (false, 1200)] {
        for (name, parent) in parents {
            let model = crate::common::bars(planar, count, parent, [false, false]);
            let problem = Problem::new(model);
            let assembled = problem.assemble().expect("assembles");
            let accelerations = |count: usize| {
                let (mut manifold, threads) = (assembled.manifold(), Threads::new(count));
                assert!(manifold.use_joint_coordinates(&assembled.state.q, usize::MAX));
                manifold.share_among(&threads);
                let ndof = manifold.chart().ndof();
                let (mut p, mut rates) = (vec![0.0; ndof], vec![0.0; ndof]);
                manifold.independent_state(&assembled.state, &mut p, &mut rates);
                for (k, (p, rate)) in p.iter_mut().zip(&mut rates).enumerate() {
                    (*p, *rate) = (*p + 0.5 * (k as f64).sin(), (3.0 * k as f64).sin());
                }
                let mut point = Point::new(manifold, &assembled.state);
                point.evaluate(0.0, &p, &rates, &[], true).expect("regular");
                assert!(count == 1 || threads.ask(|| ()).len() == count, "{name}: nobody came");
                assert_eq!(point.manifold.counters.left_to_cartesian, 0, "{name}");
                point.state.a.iter().map(|x| x.to_bits()).collect::<Vec<_>>()
            };
            let alone = accelerations(1);
            for threads in [2, 4] {
                assert!(accelerations(threads) == alone, "{name}: planar {planar}, {threads}");
            }
        }
    }
}
