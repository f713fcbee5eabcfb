//! The step loop allocates nothing outside re-parametrization; what a sink does with its chunks is its
//! own affair. Independent truth: a counting allocator. Set-up allocates the same whatever the run's
//! length, so two runs that differ in length must allocate the same number of times.

#[path = "engine/common/mod.rs"]
mod common;

use allocation_counter::measure;
use common::{PLATFORM, model, model_of, options};
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::newton::{JacobianSource, Representation};
use holonom::reduction::accelerations::Accelerations;
use holonom::simulation::{
    Chunk, Flow, Options, OutputTimes, Problem, Sink, Statistics, Status, run,
};

/// Counts rows and keeps none.
#[derive(Default)]
struct Discard {
    rows: u64,
    steps: u64,
}

impl Sink for Discard {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        self.rows += chunk.time.len() as u64;
        self.steps += chunk.dense.len() as u64;
        Ok(())
    }

    fn progress(&mut self, _: f64, _: f64, _: u64) -> Flow {
        Flow::Continue
    }
}

/// Allocations of one run up to its last attempt, without those of the warnings in its summary. What long steps may hide is
/// looked for after the end of a run, with room of its own.
#[track_caller]
fn allocations(problem: &Problem, options: &Options) -> (u64, Statistics) {
    let whole = run(problem, options, None, &mut Discard::default()).expect("the run starts");
    let stop = &whole.stop;
    assert_eq!(whole.status, Status::Completed, "{:?}: {}", options.code, stop.message);
    let s = whole.statistics;
    let attempts = s.steps + s.rejected_error + s.rejected_newton + s.rejected_evaluation;
    let options = &Options { max_steps: (attempts - 1).max(1), ..options.clone() };
    let mut sink = Discard::default();
    let mut summary = None;
    let count = measure(|| summary = Some(run(problem, options, None, &mut sink))).count_total;
    let summary = summary.expect("the run has ended").expect("the run starts");
    let warnings = summary.warnings.len() as u64;
    let count = count - warnings - warnings.min(1);
    assert!(summary.status == Status::Limit || attempts == 1, "{:?}", options.code);
    let s = summary.statistics;
    assert_eq!((sink.rows, sink.steps), (s.outputs, s.steps));
    assert_eq!(s.reparametrizations, 0, "{:?}: this test is about steps", options.code);
    (count, s)
}

/// Runs to `end` and to a quarter of it, with rows of all channels and dense output.
#[track_caller]
fn assert_steps_do_not_allocate(
    name: &str,
    model: &Model,
    code: Code,
    jacobian: JacobianSource,
    (tolerance, end): (f64, f64),
) {
    let problem = Problem::new(model.clone());
    problem.assemble().expect("assembles");
    let until = |end_time: f64| {
        let options = Options {
            output: OutputTimes::Interval(0.01 * end),
            channels: problem.channels().iter().map(|channel| channel.name.clone()).collect(),
            jacobian,
            dense_output: Some(true),
            // At rest one step might be all.
            initial_step: Some(1e-4 * end),
            // No change of the partition, which may allocate.
            repartition_factor: Some(1e12),
            // A checkpoint sets everything up anew.
            checkpoint_steps: Some(u64::MAX),
            ..options(code, tolerance, end_time)
        };
        allocations(&problem, &options)
    };
    until(0.02 * end); // what is made once for the process
    let (few, short) = until(0.25 * end);
    let (many, long) = until(end);
    assert!(long.steps >= short.steps + 10, "{name}: {} and {} steps", short.steps, long.steps);
    assert!(long.outputs >= short.outputs + 70, "{name}: {} rows", long.outputs);
    assert_eq!(
        many, few,
        "{name} by {code:?}, {jacobian:?}: {} steps with {few} allocations, {} with {many}",
        short.steps, long.steps
    );
}

/// All codes with every source of the Jacobian that they take.
fn everything() -> impl Iterator<Item = (Code, JacobianSource)> {
    CODES.iter().flat_map(|info| {
        let choice = !info.code.is_explicit() && info.code != Code::ForRosen;
        let sources = JacobianSource::ALL.iter().take(if choice { 2 } else { 1 });
        sources.map(|&(source, _)| (info.code, source))
    })
}

#[test]
fn every_way_to_accelerations() {
    for &(accelerations, way) in Accelerations::ALL {
        for (name, end) in [("andrews", 0.02), ("chain50", 0.2), ("hmmwv14", 1.0)] {
            let problem = Problem::new(model(name));
            let assembled = problem.assemble().expect("assembles");
            if assembled.manifold().set_accelerations(accelerations).is_err() {
                // Loops are not along a tree.
                assert_eq!(way, "recursive", "{name}");
                continue;
            }
            let until = |end_time: f64| {
                let output = OutputTimes::Interval(0.01 * end);
                let options =
                    Options { accelerations, output, ..options(Code::ForSdirk, 1e-3, end_time) };
                allocations(&problem, &options)
            };
            until(0.02 * end);
            let ((few, short), (many, long)) = (until(0.25 * end), until(end));
            assert!(long.steps > short.steps);
            assert_eq!(many, few, "{name} by {way}");
        }
    }
}

#[test]
fn every_sparse_matrix() {
    let sparse = [Representation::Simplified, Representation::Sparse];
    let codes = CODES.iter().map(|info| info.code).filter(|code| !code.needs_full_jacobian());
    for code in codes {
        for (newton, (name, end)) in sparse
            .iter()
            .flat_map(|&newton| [("andrews", 0.02), ("hmmwv14", 0.5)].map(|m| (newton, m)))
        {
            let problem = Problem::new(model(name));
            problem.assemble().expect("assembles");
            let until = |end_time: f64| {
                let output = OutputTimes::Interval(0.01 * end);
                let checkpoint_steps = Some(u64::MAX);
                let options =
                    Options { newton, output, checkpoint_steps, ..options(code, 1e-5, end_time) };
                allocations(&problem, &options)
            };
            until(0.02 * end);
            let ((few, short), (many, long)) = (until(0.5 * end), until(end));
            assert!(long.steps > short.steps);
            // The first change to the full matrix makes room for it.
            assert_eq!(long.changes_to_full, 0, "{name} by {code:?}: this test is about steps");
            let more = long.simplified_factorizations > short.simplified_factorizations;
            assert_eq!(more, newton == Representation::Simplified);
            assert_eq!(many, few, "{name} by {code:?}, {newton:?}");
        }
    }
}

#[test]
fn the_counter_counts() {
    assert_eq!(measure(|| drop(std::hint::black_box(vec![0.0; 3]))).count_total, 1);
}

#[test]
fn planar_models() {
    for (code, source) in everything() {
        for (name, end) in [("simple_pendulum", 4.0), ("andrews", 0.02), ("slider_crank", 0.2)] {
            assert_steps_do_not_allocate(name, &model(name), code, source, (1e-5, end));
        }
    }
}

#[test]
fn redundant_joints_drivers_and_extra_states() {
    for (code, source) in everything() {
        for (name, text, limits) in [
            ("platform", PLATFORM, (1e-6, 2.0)),
            ("driven pendulum", common::DRIVEN_PENDULUM, (1e-6, 2.0)),
            ("driven telescope", common::DRIVEN_TELESCOPE, (1e-8, 1.0)),
            ("rubber mounts", common::RUBBER_MOUNTS, (1e-5, 1.0)),
        ] {
            assert_steps_do_not_allocate(name, &model_of(text), code, source, limits);
        }
    }
}

/// Its turns are looked at again and again.
const UNBALANCED: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 4.0, inertia = 0.4, position = [0.0, 0.0] }
rotor = { mass = 0.5, inertia = 0.02, position = [0.0, 0.0], center_of_mass = [0.02, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
shaft = { type = "revolute", between = ["block", "rotor"], point = [0.0, 0.0] }
[forces]
mount = { type = "tsda", between = ["ground", "block"], points = [[0.0, -1.0], [0.0, 0.0]], stiffness = 20.0, damping = 10.0, free_length = 1.0 }
[initial.joints]
shaft = { angular_velocity = 60.0 }
"#;

const DRIVEN: &str = r#"
[drivers]
motor = { joint = "shaft", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 60.0] } }
"#;

#[test]
fn an_unbalanced_rotor() {
    for (code, source) in everything() {
        assert_steps_do_not_allocate("rotor", &model_of(UNBALANCED), code, source, (1e-2, 2.0));
        let driven = format!("{UNBALANCED}{DRIVEN}");
        assert_steps_do_not_allocate("driven rotor", &model_of(&driven), code, source, (1e-2, 2.0));
    }
}

/// At whose knots formulas that evaluate forces at the ends of steps alone begin with shorter ones.
const TABLE: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
rod = { mass = 2.0, inertia = 0.1, position = [0.8, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "rod"], point = [0.0, 0.0] }
[tables.torques]
x = [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2, 1.4, 1.6, 1.8, 2.0]
y = [0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0, -1.0, 0.0, 1.0, 0.0]
[forces]
twist = { type = "torque", on = "rod", torque = { type = "table", table = "torques" } }
"#;

#[test]
fn a_table_of_torques() {
    for (code, source) in everything() {
        assert_steps_do_not_allocate("rod", &model_of(TABLE), code, source, (1e-4, 2.0));
    }
}

#[test]
fn the_vehicle() {
    for (code, source) in everything() {
        let end = match code {
            Code::Deabm => 4e-3,
            Code::Dopri5 | Code::Dop853 => 2e-3,
            _ => 1.0,
        };
        assert_steps_do_not_allocate("hmmwv14", &model("hmmwv14"), code, source, (1e-3, end));
    }
}

/// A row of links with stiff hinges, of which the first one may be driven.
fn row(links: usize, is_driven: bool) -> Model {
    let driver = r#"
[drivers]
hand = { joint = "joint_1", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 0.1] } }
"#;
    model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[patterns.row]
over.i = {{ from = 1, to = {links} }}
bodies."link_{{i}}" = {{ mass = 1.0, inertia = "=1/12", position = ["=i - 0.5", 0.0] }}
joints."joint_{{i}}" = {{ type = "revolute", between = ["link_{{i - 1}}", "link_{{i}}"],
  points_in_body = [[0.5, 0.0], [-0.5, 0.0]] }}
forces."spring_{{i}}" = {{ type = "rsda", between = ["link_{{i - 1}}", "link_{{i}}"], stiffness = 1e5, damping = 1e3 }}
[joints]
joint_1 = {{ between = ["ground", "link_1"], points_in_body = [[0.0, 0.0], [-0.5, 0.0]] }}
[forces]
spring_1 = {{ between = ["ground", "link_1"] }}
{}"#,
        if is_driven { driver } else { "" }
    ))
}

#[test] // ten times as many bodies, ten times as much; what is dense has a hundred times
fn memory_of_a_tree_grows_like_its_bodies() {
    for is_driven in [false, true] {
        let [few, many] = [300, 3000].map(|links| {
            let model = row(links, is_driven);
            let options = options(Code::ForRadau, 1e-3, 0.01);
            measure(|| {
                let end = run(&Problem::new(model), &options, None, &mut Discard::default());
                assert_eq!(end.expect("the run starts").status, Status::Completed);
            })
            .bytes_max
        });
        assert!(many < 12 * few, "driven: {is_driven}: {few} and {many} bytes");
    }
}
