//! What a run refuses before it starts, and what it keeps when it ends early.

use crate::common::{model, model_of, options, run_model};
use holonom::io::{Document, Syntax};
use holonom::method::Code;
use holonom::model::{Model, Tolerance};
use holonom::simulation::{
    Chunk, Flow, Memory, Options, OutputTimes, Problem, RunError, Sink, Status, run,
};
use holonom::system::{Sample, State};

/// Refusal of a run of the slider-crank.
fn refusal(change: impl FnOnce(&mut Options)) -> RunError {
    let mut options = Options::new(1.0);
    change(&mut options);
    let problem = Problem::new(model("slider_crank"));
    run(&problem, &options, None, &mut Memory::default()).unwrap_err()
}

/// What a run of a model from a state says.
fn start(model: &Model, state: &State) -> Result<Status, RunError> {
    let options = options(Code::ForSdirk, 1e-4, state.t + 0.01);
    let summary = run(&Problem::new(model.clone()), &options, Some(state), &mut Memory::default());
    summary.map(|s| s.status)
}

fn reached(model: &Model) -> State {
    run_model(model, &options(Code::ForSdirk, 1e-4, 0.05)).summary.end
}

#[test] // independent truth: a pin moved by 1e-3 m is open by 1e-3 m
fn a_start_state_with_an_open_joint_is_refused_with_joint_and_residual() {
    let model = model("slider_crank");
    let good = reached(&model);
    assert_eq!(start(&model, &good), Ok(Status::Completed));
    let mut open = good.clone();
    open.q[0] += 1e-3; // x of the crank
    let error = start(&model, &open).unwrap_err();
    assert_eq!(error.code(), "simulation/start-state");
    let RunError::InconsistentState { level, item, residual, allowed, .. } = &error else {
        panic!("{error}")
    };
    assert_eq!(*level, "position");
    assert!(item == "bearing" || item == "pin", "{error}");
    assert!((residual.abs() - 1e-3).abs() < 1e-12, "{error}");
    assert!(error.to_string().contains(" m, allowed "), "{error}");
    assert!(*allowed <= 1e-6 && error.to_string().contains(item) && !error.help().is_empty());

    let mut moving = good.clone();
    moving.v[0] += 0.1 * (1.0 + moving.v[0].abs());
    let error = start(&model, &moving).unwrap_err();
    let RunError::InconsistentState { level, residual, .. } = &error else { panic!("{error}") };
    assert_eq!(*level, "velocity");
    assert!((residual.abs() - 0.1 * (1.0 + good.v[0].abs())).abs() < 1e-9, "{error}");
    assert!(error.to_string().contains(" m/s, allowed "), "{error}");

    let mut nearly = good;
    nearly.q[0] += 1e-8;
    assert_eq!(start(&model, &nearly), Ok(Status::Completed));
}

#[test]
fn a_start_state_of_another_time_contradicts_its_driver() {
    let model = model_of(DRIVEN);
    let mut state = reached(&model);
    assert_eq!(start(&model, &state), Ok(Status::Completed));
    state.t += 0.01;
    let error = start(&model, &state).unwrap_err();
    assert_eq!(error.item(), Some("turn"), "{error}");
}

#[test]
fn a_start_state_with_wrong_lengths_or_numbers_is_refused() {
    let model = model("slider_crank");
    let good = reached(&model);
    let wrong: [(fn(&mut State), &str); 6] = [
        (|s| s.q.truncate(4), "coordinates"),
        (|s| s.v.push(0.0), "velocities"),
        (|s| s.lambda.clear(), "multipliers"),
        (|s| s.q[2] = f64::NAN, "coordinates[2]"),
        (|s| s.v[1] = f64::INFINITY, "velocities[1]"),
        (|s| s.t = f64::NAN, "time"),
    ];
    for (change, words) in wrong {
        let mut state = good.clone();
        change(&mut state);
        let options = options(Code::ForSdirk, 1e-4, 0.1);
        let problem = Problem::new(model.clone());
        let error = run(&problem, &options, Some(&state), &mut Memory::default()).unwrap_err();
        assert_eq!(error.code(), "simulation/start-state", "{error}");
        assert!(error.to_string().contains(words), "{error}");
    }
}

#[test]
fn tolerances_that_cannot_be_kept_are_refused() {
    for value in [0.0, -1e-3, f64::NAN, f64::INFINITY, 1e-14, 1e-300] {
        for part in 0..3 {
            let error = refusal(|o| {
                let t = &mut o.tolerance;
                *[&mut t.relative, &mut t.translation, &mut t.rotation][part] = value;
            });
            let name = ["relative", "translation", "rotation"][part];
            assert_eq!(error.code(), "simulation/option");
            assert!(error.to_string().contains(&format!("tolerance.{name}")), "{error}");
        }
    }
    let error = refusal(|o| o.tolerance = Tolerance::uniform(1e-15));
    assert!(error.to_string().contains("round-off"), "{error}");
}

#[test]
fn output_times_outside_of_the_run_are_refused() {
    for (times, index) in [
        (vec![-0.1, 0.5], 0),
        (vec![0.0, 0.5, 1.5], 2),
        (vec![0.0, f64::NAN], 1),
        (vec![0.0, 0.5, 0.5], 2),
        (vec![0.5, 0.25], 1),
    ] {
        let error = refusal(|o| o.output = OutputTimes::Listed(times));
        assert_eq!(error.code(), "simulation/option");
        assert!(error.to_string().contains(&format!("output_times[{index}]")), "{error}");
    }
    // The end of a computed grid is the end of the run.
    let end = 0.3;
    let beyond = 0.1 + 0.2;
    assert!(beyond > end);
    let output = OutputTimes::Listed(vec![0.0, beyond]);
    let outcome = run_model(&model("slider_crank"), &Options { output, ..Options::new(end) });
    assert_eq!(outcome.times(), [0.0, end]);
}

#[test]
fn an_absurd_number_of_rows_is_refused_with_the_number() {
    let error = refusal(|o| o.output = OutputTimes::Interval(1e-9));
    assert!(error.to_string().contains("1000000001"), "{error}");
}

/// A crank turned by a table.
const DRIVEN: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
crank = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
[tables.lift]
x = [0.0, 0.5, 1.0]
y = [0.0, 1.0, 4.0]
[drivers]
turn = { joint = "bearing", coordinate = "rotation", motion = { type = "table", table = "lift" } }
[simulation]
end_time = 1.0
"#;

#[test]
fn a_run_longer_than_the_table_of_a_motion_is_refused() {
    let problem = Problem::new(model_of(DRIVEN));
    let mut sink = Memory::default();
    let error = run(&problem, &Options::new(1.5), None, &mut sink).unwrap_err();
    assert_eq!(
        (error.code(), error.item()),
        ("simulation/short-table", Some("drivers.turn.motion"))
    );
    for part in ["tables.lift", "from 0 s to 1 s", "from 0 s to 1.5 s"] {
        assert!(error.to_string().contains(part), "{error}");
    }
    let error = run(&problem.starting_at(-0.5), &Options::new(1.0), None, &mut sink).unwrap_err();
    assert_eq!(error.code(), "simulation/short-table");
    assert!(sink.all.time.is_empty());
    assert_eq!(
        run(&problem, &Options::new(1.0), None, &mut sink).unwrap().status,
        Status::Completed
    );
}

/// Keeps rows and stops after so many steps.
struct StopAfter(Memory, u64);

impl Sink for StopAfter {
    fn chunk(&mut self, chunk: &Chunk) -> Result<(), String> {
        self.0.chunk(chunk)
    }

    fn progress(&mut self, _: f64, _: f64, steps: u64) -> Flow {
        if steps >= self.1 { Flow::Interrupt } else { Flow::Continue }
    }
}

/// The last row is the state in which the run ended, and the motion goes on from there.
#[track_caller]
fn assert_goes_on(model: &Model, rows: &Chunk, end: &State) {
    assert_eq!(rows.time.last(), Some(&end.t));
    assert!(rows.time.windows(2).all(|w| w[0] < w[1]), "{:?}", rows.time);
    let n = end.q.len();
    assert_eq!(rows.q[rows.q.len() - n..], end.q[..]);
    assert_eq!(rows.v[rows.v.len() - n..], end.v[..]);
    assert_eq!(start(model, end), Ok(Status::Completed));
}

#[test]
fn a_run_that_ends_early_keeps_its_last_state() {
    let model = model("slider_crank");
    let problem = Problem::new(model.clone());
    let sparse = |max_steps, max_seconds| Options {
        output: OutputTimes::Listed(vec![0.0, 1.0]),
        max_step: 1e-3,
        max_steps,
        max_seconds,
        ..Options::new(1.0)
    };
    let mut rows = Memory::default();
    let summary = run(&problem, &sparse(20, f64::INFINITY), None, &mut rows).unwrap();
    assert_eq!(summary.stop.code, "simulation/max-steps");
    assert!(summary.end.t > 0.0);
    assert_goes_on(&model, &rows.all, &summary.end);

    // A row that is an output time is not repeated.
    let mut rows = Memory::default();
    let h = 1.0 / 1024.0; // sums of it are exact
    let output = OutputTimes::Interval(h);
    let every = Options { output, fixed_step: Some(h), ..sparse(20, f64::INFINITY) };
    let summary = run(&problem, &every, None, &mut rows).unwrap();
    assert_eq!(rows.all.time.len(), 21);
    assert_goes_on(&model, &rows.all, &summary.end);

    let mut sink = StopAfter(Memory::default(), 1);
    let slow = Options { max_step: 1e-7, ..sparse(u64::MAX, f64::INFINITY) };
    let summary = run(&problem, &slow, None, &mut sink).unwrap();
    assert_eq!(summary.status, Status::Interrupted);
    assert_goes_on(&model, &sink.0.all, &summary.end);

    let mut rows = Memory::default();
    let summary =
        run(&problem, &Options { max_step: 1e-7, ..sparse(u64::MAX, 0.02) }, None, &mut rows);
    let summary = summary.unwrap();
    assert_eq!(summary.stop.code, "simulation/max-seconds");
    assert_goes_on(&model, &rows.all, &summary.end);
}

/// Every kind of item of a planar model.
const PLANAR: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
a = { mass = 1.0, inertia = 0.1, position = [0.5, 0.0], markers = { tip = { point = [0.5, 0.0] } } }
b = { mass = 1.0, inertia = 0.1, position = [1.5, 0.0] }
c = { mass = 1.0, inertia = 0.1, position = [3.0, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "a"], point = [0.0, 0.0] }
slide = { type = "translational", between = ["a", "b"], point = [1.0, 0.0], axis = [1.0, 0.0] }
rod = { type = "distance", between = ["ground", "c"], points = [[3.0, 1.0], [3.0, 0.0]] }
[drivers]
push = { joint = "slide", coordinate = "translation", motion = 0.0 }
[forces]
pull = { type = "point_force", on = "c", point = [3.2, 0.0], force = [{ type = "harmonic", amplitude = 2.0, angular_frequency = 3.0, phase = 0.5 }, -4.0] }
twist = { type = "torque", on = "c", torque = 5.0 }
spring = { type = "tsda", between = ["ground", "c"], points = [[4.0, 0.0], [3.0, 0.0]], stiffness = 10.0, free_length = 1.0 }
coil = { type = "rsda", between = ["ground", "a"], stiffness = 10.0 }
[simulation]
end_time = 1.0
"#;

#[test] // independent truth: the components stated in the file
fn vectors_of_planar_models_have_two_components_and_angular_ones_one() {
    let problem = Problem::new(model_of(PLANAR));
    for channel in problem.channels() {
        let vector =
            channel.frame == "ground" && !channel.unit.contains("rad") && channel.unit != "N m";
        let expected: &[usize] = if vector { &[2] } else { &[] };
        assert_eq!(channel.shape, expected, "{channel:?}");
    }
    let state = &problem.assemble().unwrap().state;
    let value = |name: &str| {
        let channel = problem.channels().iter().find(|c| c.name == name).unwrap();
        let mut out = vec![f64::NAN; channel.size()];
        problem.system().channel(channel, &Sample::new(state), &mut out);
        out
    };
    assert_eq!(value("pull.force"), [2.0 * 0.5f64.sin(), -4.0]);
    assert_eq!(value("twist.torque"), [5.0]);
}

#[test] // independent truth: 90 rad are 14.3 turns, 1.57 a quarter
fn angles_in_degrees_are_noticed_wherever_bodies_are_turned() {
    let warnings = |stated: &str, initial: &str| {
        let text = format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.body]
mass = 1.0
position = [0.0, 0.0, 0.0]
inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
{stated}
[initial.bodies.body]
angular_velocity = [0.0, 0.0, 1.0]
{initial}
"#
        );
        let mut none = |_: &str| Err("no other file".to_owned());
        let document = Document::parse(&text, Syntax::Toml, "model.toml", &mut none);
        let (_, warnings) =
            document.and_then(|d| d.build()).unwrap_or_else(|e| panic!("{}", e.render()));
        warnings.into_iter().map(|w| w.path).collect::<Vec<_>>()
    };
    for (angle, seen) in [("90.0", true), ("1.57", false)] {
        for (field, path) in [
            (format!("yaw_pitch_roll = [0.0, {angle}, 0.0]"), "yaw_pitch_roll[1]"),
            (
                format!("axis_angle = {{ axis = [0.0, 0.0, 1.0], angle = {angle} }}"),
                "axis_angle.angle",
            ),
            (
                format!(r#"euler_angles = {{ sequence = "zxz", angles = [0.0, 0.0, {angle}] }}"#),
                "euler_angles.angles[2]",
            ),
        ] {
            let expected = |item: &str| if seen { vec![format!("{item}.{path}")] } else { vec![] };
            assert_eq!(warnings(&field, ""), expected("bodies.body"));
            assert_eq!(warnings("", &field), expected("initial.bodies.body"));
        }
    }
}

#[test] // truth: zero is a number, of which a sweep may have one
fn elements_that_are_stated_to_be_zero_are_taken() {
    let text = |force: &str| {
        format!(
            "holonom = 1\ndimension = \"spatial\"\n[bodies.block]\nmass = 1.0\ninertia = [[1.0, 0.0, 0.0], [0.0, \
             1.0, 0.0], [0.0, 0.0, 1.0]]\nposition = [1.0, 0.0, 0.0]\n[forces.element]\nbetween = [\"ground\", \
             \"block\"]\n{force}\n"
        )
    };
    for force in [
        "type = \"tsda\"\npoints = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]\ndamping = 0.0",
        "type = \"rsda\"\naxis = [0.0, 0.0, 1.0]\ndamping = 0.0",
        "type = \"bushing\"\npoint = [1.0, 0.0, 0.0]\ndamping = [0.0, 0.0, 0.0]",
        "type = \"bushing\"\npoint = [1.0, 0.0, 0.0]\nstiffness = [0.0, 0.0, 0.0]",
    ] {
        assert_eq!(model_of(&text(force)).forces.len(), 1, "{force}");
    }
}

#[test]
fn the_last_row_of_an_interval_is_the_end() {
    let model = model("simple_pendulum");
    for (from, to, rows) in [(-1.0, 0.2, 200), (0.1, 0.7, 3), (0.0, 0.3, 7)] {
        let options = Options {
            output: OutputTimes::Interval((to - from) / f64::from(rows)),
            ..options(Code::ForRadau, 1e-3, to)
        };
        let problem = Problem::new(model.clone());
        let start = State { t: from, ..problem.assemble().unwrap().state.clone() };
        let mut memory = Memory::default();
        run(&problem, &options, Some(&start), &mut memory).unwrap();
        let times = &memory.all.time;
        assert_eq!(times.len(), rows as usize + 1, "{from} to {to}");
        assert_eq!([times[0], times[times.len() - 1]], [from, to]);
    }
}

#[test]
fn a_run_of_the_shortest_time_there_is_has_two_rows() {
    assert_eq!(OutputTimes::between(0.0, 5e-324), OutputTimes::Listed(vec![0.0, 5e-324]));
}

#[test] // independent truth: an angle of 1e10 rad has no digits below 1e-6 rad
fn joints_that_numbers_cannot_keep_are_warned_of() {
    let crank = |angle: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = {{ mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }}
rod = {{ mass = 1.0, inertia = 0.1, position = [2.0, 0.0] }}
slider = {{ mass = 1.0, inertia = 0.1, position = [3.0, 0.0] }}
[joints]
bearing = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }}
pin = {{ type = "revolute", between = ["crank", "rod"], point = [1.0, 0.0] }}
wrist = {{ type = "revolute", between = ["rod", "slider"], point = [3.0, 0.0] }}
guide = {{ type = "translational", between = ["ground", "slider"], point = [3.0, 0.0], axis = [1.0, 0.0] }}
[drivers]
motor = {{ joint = "bearing", coordinate = "rotation", motion = {{ type = "polynomial", coefficients = [{angle:?}, 1.0] }} }}
"#
        ))
    };
    for (angle, expected) in [(1e10, true), (1e3, false)] {
        let summary = run_model(&crank(angle), &options(Code::ForRadau, 1e-3, 1.0)).summary;
        let told = summary.warnings.iter().any(|w| w.code == "simulation/residuals");
        assert_eq!(told, expected, "{:e}", summary.statistics.residual_ratio);
    }
}
