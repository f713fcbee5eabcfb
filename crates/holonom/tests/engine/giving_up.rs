//! Work that is watched: it can be given up in every stage, what was computed stays readable, and being
//! watched changes no bit.

use holonom::error::ModelErrors;
use holonom::io::{Document, Syntax};
use holonom::method::Code;
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Memory, Options, OutputTimes, Problem, RunError, Status, Summary, run};
use holonom::watch::{Flow, GivenUp, Observer, observed};
use std::cell::Cell;
use std::rc::Rc;
use std::time::Duration;

const LINKS: usize = 400;

/// A hanging chain with stiff springs, written as a pattern.
fn chain(links: usize) -> String {
    format!(
        r#"
        holonom = 1
        title = "chain"
        dimension = "planar"
        gravity = [0.0, -9.81]
        [patterns.chain]
        over.i = {{ from = 1, to = {links} }}
        bodies."link_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 0.0] }}
        joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
          points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
        forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i - 1}}", "link_{{i}}"],
          stiffness = 1e5, damping = 1e3 }}
        [joints]
        joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [-0.5, 0.0]] }}
        [forces]
        spring_1 = {{ between = ["ground", "link_1"] }}
        "#
    )
}

/// Cranks that pass their dead points closely, beside a mass on a spring.
const CRANKS: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[patterns.row]
over.i = { from = 1, to = 40 }
bodies."crank_{i}" = { mass = 1.0, inertia = 0.1, position = [0.25, "=i"] }
bodies."rod_{i}" = { mass = 0.5, inertia = 0.02, position = [0.755, "=i"] }
bodies."slider_{i}" = { mass = 1.0, inertia = 0.1, position = [1.01, "=i"] }
joints."bearing_{i}" = { type = "revolute", between = ["ground", "crank_{i}"], point = [0.0, "=i"] }
joints."pin_{i}" = { type = "revolute", between = ["crank_{i}", "rod_{i}"], point = [0.5, "=i"] }
joints."wrist_{i}" = { type = "revolute", between = ["rod_{i}", "slider_{i}"], point = [1.01, "=i"] }
joints."guide_{i}" = { type = "translational", between = ["ground", "slider_{i}"], point = [1.01, "=i"], axis = [1.0, 0.0] }
drivers."motor_{i}" = { joint = "bearing_{i}", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 3.0] } }
[bodies]
free = { mass = 1.0, inertia = 0.1, position = [0.0, -5.0] }
[joints]
rail = { type = "translational", between = ["ground", "free"], point = [0.0, -5.0], axis = [1.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "free"], points = [[-5.0, -5.0], [0.0, -5.0]], stiffness = 4.0, free_length = 5.0 }
[initial.bodies]
free = { velocity = [1.0, 0.0] }
"#;

fn read(text: &str) -> Result<Model, ModelErrors> {
    let mut none = |_: &str| Err("the chain extends nothing".to_owned());
    Ok(Document::parse(text, Syntax::Toml, "chain.toml", &mut none)?.build()?.0)
}

fn options() -> Options {
    let newton = holonom::newton::Representation::Sparse;
    Options { output: OutputTimes::Interval(2e-3), newton, ..Options::new(0.1) }
}

fn simulate(problem: &Problem, options: &Options) -> (Result<Summary, RunError>, Memory) {
    let mut rows = Memory::default();
    (run(problem, options, None, &mut rows), rows)
}

/// Asks for the end of the work at the look after so many.
fn after(looks: u64) -> Observer {
    let left = Cell::new(looks);
    Rc::new(move |_| match left.get().checked_sub(1) {
        Some(fewer) => {
            left.set(fewer);
            Flow::Continue
        }
        None => Flow::Interrupt,
    })
}

/// Asks for it in a stage.
fn in_stage(wanted: &'static str) -> Observer {
    Rc::new(move |stage| if stage == wanted { Flow::Interrupt } else { Flow::Continue })
}

/// Looks that work has.
fn looks(work: impl FnOnce()) -> u64 {
    let count = Rc::new(Cell::new(0));
    let counted = count.clone();
    let observer: Observer = Rc::new(move |_| {
        counted.set(counted.get() + 1);
        Flow::Continue
    });
    assert_eq!(observed(Duration::ZERO, observer, work), Ok(()));
    count.get()
}

#[test]
fn every_stage_before_a_run_can_be_given_up_and_done_again() {
    let text = chain(LINKS);
    let reading = observed(Duration::ZERO, in_stage("reading"), || read(&text));
    assert_eq!(reading.err(), Some(GivenUp::Asked));
    let model = read(&text).unwrap();

    let compiling = observed(Duration::ZERO, in_stage("compiling"), || Problem::new(model.clone()));
    assert_eq!(compiling.err(), Some(GivenUp::Asked));
    let problem = Problem::new(model);

    // Nothing is analysed of a tree.
    let closed = text.replace(
        "[joints]\n",
        &format!(
            "[joints]\n        rod = {{ type = \"distance\", between = [\"ground\", \"link_{LINKS}\"], \
             points = [[{LINKS}.0, 5.0], [{LINKS}.0, 0.0]] }}\n"
        ),
    );
    let closed = Problem::new(read(&closed).unwrap());
    for (problem, stage) in [(&problem, "assembling"), (&closed, "analysing")] {
        let assembly = observed(Duration::ZERO, in_stage(stage), || problem.assemble().is_ok());
        assert_eq!(assembly.err(), Some(GivenUp::Asked), "{stage}");
    }
    let (outcome, rows) =
        observed(Duration::ZERO, in_stage("assembling"), || simulate(&problem, &options()))
            .unwrap();
    assert_eq!(outcome.err(), Some(RunError::Interrupted));
    assert!(rows.all.time.is_empty());

    // Nothing was left behind that an undisturbed run would meet.
    let (outcome, _) = simulate(&problem, &options());
    assert_eq!(outcome.unwrap().status, Status::Completed);
}

#[test]
fn time_counts_from_the_call_of_a_run_and_ends_its_set_up_too() {
    let problem = Problem::new(read(&chain(LINKS)).unwrap());
    let soon = Options { max_seconds: 1e-4, ..options() };
    let (outcome, rows) = simulate(&problem, &soon);
    assert_eq!(outcome.err(), Some(RunError::MaxSeconds { limit: 1e-4 }));
    assert!(rows.all.time.is_empty());
    assert!(problem.assemble().is_ok());
}

#[test] // independent truth: the run that nobody watched
fn a_run_given_up_anywhere_keeps_what_the_whole_run_has_up_to_there() {
    let stiff = Problem::new(read(&chain(LINKS)).unwrap());
    given_up_anywhere(&stiff, &options());
    // Explicit codes, which carry their error by matrices of their own.
    let text = chain(30).replace("1e5, damping = 1e3", "10.0, damping = 0.1");
    let soft = Problem::new(read(&text).unwrap());
    for code in [Code::Deabm, Code::Dopri5, Code::Dop853] {
        let longer = Options { end_time: 1.0, output: OutputTimes::Interval(0.02), ..options() };
        given_up_anywhere(&soft, &Options { code, dense_output: Some(true), ..longer });
    }
    // Drivers whose powers are looked at after a step has been accepted.
    let driven = Problem::new(read(CRANKS).unwrap());
    for code in [Code::ForRadau, Code::InflSdirk] {
        let asked = Options { output: OutputTimes::Interval(0.05), code, ..Options::new(6.0) };
        given_up_anywhere(&driven, &asked);
    }
}

fn given_up_anywhere(problem: &Problem, options: &Options) {
    problem.assemble().unwrap();
    let (whole, all) = simulate(problem, options);
    let (whole, all) = (whole.unwrap(), all.all);
    let n = whole.end.q.len();

    let total = looks(|| {
        let (watched, rows) = simulate(problem, options);
        // Being watched changes no bit.
        assert_eq!(watched.unwrap().end, whole.end);
        assert_eq!((&rows.all.q, &rows.all.ledger), (&all.q, &all.ledger));
    });
    assert!(total > 100, "{total} looks: too few to hide in");

    let mut random = 20_260_101u64;
    let mut ended_inside = 0;
    for _ in 0..20 {
        random = random.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        let at = (random >> 33) % total;
        let (outcome, rows) =
            observed(Duration::ZERO, after(at), || simulate(problem, options)).unwrap();
        let summary = match outcome {
            Err(RunError::Interrupted) => continue, // before the first step
            outcome => outcome.unwrap(),
        };
        let rows = rows.all;
        assert_eq!(summary.status, Status::Interrupted, "look {at}");
        assert_eq!(rows.time.last(), Some(&summary.end.t), "look {at}");
        assert_eq!(rows.q.len(), n * rows.time.len(), "look {at}");
        assert_eq!(rows.q[rows.q.len() - n..], summary.end.q, "look {at}");
        // Rows before the one it ended with are those of the whole run.
        let same = rows.time.len() - 1;
        assert_eq!(rows.time[..same], all.time[..same], "look {at}");
        assert_eq!(rows.q[..n * same], all.q[..n * same], "look {at}");
        assert_eq!(rows.ledger[..3 * same], all.ledger[..3 * same], "look {at}");
        // Steps that are stored end where the run did, and are those of the whole run.
        let steps = rows.dense.t.len();
        assert_eq!(rows.dense.t, all.dense.t[..steps], "look {at}");
        assert_eq!(rows.dense.w[..], all.dense.w[..rows.dense.w.len()], "look {at}");
        if steps > 0 {
            assert_eq!(rows.dense.end, summary.end.t, "look {at}");
            ended_inside += 1;
        }
        // It balances its energy as well as the whole run, and the motion goes on from there.
        let scale = whole.energy.largest_imbalance.max(1e-9);
        assert!(summary.energy.imbalance.abs() <= 2.0 * scale, "{:?}", summary.energy);
        if summary.end.t > 0.0 {
            let rest = run(problem, options, Some(&summary.end), &mut Memory::default());
            assert_eq!(rest.unwrap().status, Status::Completed, "look {at}");
        }
    }
    assert!(ended_inside >= 5, "{ended_inside}");
}

#[test] // truth: 16,000 constraints by 24,000 coordinates of 8 bytes are 3.1 GB
fn a_parametrization_that_takes_too_much_memory_is_refused() {
    let problem = Problem::new(read(&chain(8000)).unwrap());
    let dense = Options { parametrization: ParametrizationKind::Partitioning, ..options() };
    let Err(error) = simulate(&problem, &dense).0 else { panic!("it is not refused") };
    assert_eq!(error.code(), "simulation/option");
    let message = error.to_string();
    assert!(
        message.contains("`parametrization = \"partitioning\"`") && message.contains("3.1 GB"),
        "{message}"
    );
}
