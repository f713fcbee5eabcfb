//! The step loop allocates nothing outside re-parametrization and the sink. Independent truth: a
//! counting allocator. Set-up allocates the same whatever the run's length, so two runs that differ
//! in length must differ in steps only.

mod common;

use allocation_counter::{measure, opt_out};
use common::{ALL_CODES, model, options};
use holonom::method::Code;
use holonom::model::Model;
use holonom::simulation::{
    Chunk, Flow, Options, OutputTimes, Problem, Sink, Statistics, Status, run,
};

/// Takes rows and keeps none; what a sink allocates is its own affair.
#[derive(Default)]
struct Discard {
    rows: usize,
    attempts: Vec<usize>,
}

impl Sink for Discard {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        self.rows += chunk.time.len();
        opt_out(|| self.attempts.push(chunk.steps.len()));
        Ok(())
    }

    fn progress(&mut self, _: f64, _: f64, _: u64) -> Flow {
        Flow::Continue
    }
}

/// Allocations of one run.
#[track_caller]
fn allocations(problem: &Problem, options: &Options) -> (u64, Statistics) {
    let mut sink = Discard::default();
    let mut summary = None;
    let count = measure(|| summary = Some(run(problem, options, None, &mut sink))).count_total;
    let summary = summary.expect("the run has ended").expect("the run starts");
    let stop = &summary.stop;
    assert_eq!(summary.status, Status::Completed, "{:?}: {}", options.code, stop.message);
    let s = summary.statistics;
    assert_eq!(sink.rows as u64, s.outputs);
    assert_eq!(s.reparametrizations, 0, "{:?}: this test is about steps", options.code);
    (count, s)
}

/// Runs to `end` and to a quarter of it.
#[track_caller]
fn assert_steps_do_not_allocate(name: &str, model: &Model, code: Code, tolerance: f64, end: f64) {
    let problem = Problem::new(model.clone());
    problem.assemble().expect("assembles");
    let until = |end_time: f64| {
        let options = Options {
            // Rows belong to the sink's chunks; this test is about steps.
            output: OutputTimes::Listed(Vec::new()),
            // No change of the partition, which may allocate.
            repartition_factor: 1e12,
            ..options(code, tolerance, end_time)
        };
        allocations(&problem, &options)
    };
    until(0.01 * end); // what is made once for the process
    let (few, short) = until(0.25 * end);
    let (many, long) = until(end);
    assert!(long.steps >= short.steps + 10, "{name}: {} and {} steps", short.steps, long.steps);
    // The list of attempted steps in a chunk grows by doubling; a step that allocated would show as
    // hundreds. New pivot orders (Andrews' mechanism needs some) are symbolic work and may allocate.
    let repivoted = long.analyses - short.analyses;
    assert!(
        many <= few + 12 + 400 * repivoted,
        "{name} by {code:?}: {} steps with {few} allocations, {} with {many}",
        short.steps,
        long.steps
    );
}

#[test]
fn the_counter_counts() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0.0; 3]))).count_total, 1);
}

#[test]
fn planar_models() {
    for code in ALL_CODES {
        for (name, end) in [("simple_pendulum", 2.0), ("andrews", 0.02), ("slider_crank", 0.2)] {
            assert_steps_do_not_allocate(name, &model(name), code, 1e-6, end);
        }
    }
}

#[test]
fn the_vehicle() {
    for (code, end) in
        [(Code::ForSdirk, 2.0), (Code::ForRosen, 1.0), (Code::Deabm, 4e-3), (Code::Dopri5, 2e-3)]
    {
        assert_steps_do_not_allocate("hmmwv14", &model("hmmwv14"), code, 1e-3, end);
    }
}
