//! Helpers of the tests across rooms: models of the library by name, runs, channels, references.

#![allow(dead_code, reason = "each test binary uses a part of it")]

pub(crate) mod integrate;
pub(crate) mod table;

use holonom::io::{Document, Syntax};
use holonom::method::Code;
use holonom::model::{Model, Tolerance};
use holonom::simulation::{Memory, Options, OutputTimes, Problem, Status, Summary, run};
use holonom::system::State;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Every folder of the library.
pub(crate) const LIBRARY: &[&str] = &[
    "simple_pendulum",
    "double_pendulum",
    "double_pendulum_w10",
    "double_pendulum_rest",
    "andrews",
    "chain50",
    "chain50_free",
    "slider_crank",
    "spatial_four_bar",
    "stiff_slider",
    "hmmwv14",
    "hmmwv14_bushing",
];

fn library() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../models")
}

/// A model of the library, as text merged with what it extends.
pub(crate) fn document(name: &str) -> Document {
    let read =
        |file: &str| std::fs::read_to_string(library().join(file)).map_err(|e| e.to_string());
    let file = format!("{name}/model.toml");
    let text = read(&file).unwrap_or_else(|e| panic!("{file}: {e}"));
    let mut resolver = |file: &str| read(file);
    let mut bytes =
        |file: &str| std::fs::read(library().join(file)).map_err(|error| error.to_string());
    Document::parse(&text, Syntax::Toml, &file, &mut resolver)
        .and_then(|document| document.with_meshes(&mut bytes))
        .unwrap_or_else(|errors| panic!("{}", errors.render()))
}

/// A model of the library. None of them may give cause for a warning.
pub(crate) fn model(name: &str) -> Model {
    let (model, warnings) =
        document(name).build().unwrap_or_else(|errors| panic!("{}", errors.render()));
    assert!(warnings.is_empty(), "{name}: {warnings:?}");
    model
}

/// A model from text of this test.
pub(crate) fn model_of(text: &str) -> Model {
    let mut none = |_: &str| Err("no other file".to_owned());
    Document::parse(text, Syntax::Toml, "model.toml", &mut none)
        .and_then(|document| document.build())
        .unwrap_or_else(|errors| panic!("{}", errors.render()))
        .0
}

/// Options of a run without output.
pub(crate) fn options(code: Code, tolerance: f64, end_time: f64) -> Options {
    Options {
        code,
        tolerance: Tolerance::uniform(tolerance),
        output: OutputTimes::Listed(Vec::new()),
        ..Options::new(end_time)
    }
}

/// A finished run with the asked channels.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) summary: Summary,
    pub(crate) rows: Memory,
    /// Name and number of components of each channel kept.
    channels: Vec<(String, usize)>,
}

impl Outcome {
    /// Component `index` of a channel over the output times.
    pub(crate) fn series(&self, channel: &str, index: usize) -> Vec<f64> {
        let place = self.channels.iter().position(|(name, _)| name == channel);
        let place = place.unwrap_or_else(|| panic!("the channel `{channel}` was not asked for"));
        let size = self.channels[place].1;
        self.rows.all.channels[place].iter().skip(index).step_by(size).copied().collect()
    }

    /// Output times, s.
    pub(crate) fn times(&self) -> &[f64] {
        &self.rows.all.time
    }
}

/// Runs to the end; anything else fails the test.
#[track_caller]
pub(crate) fn run_model(model: &Model, options: &Options) -> Outcome {
    let outcome = try_run(model, options);
    let summary = &outcome.summary;
    assert_eq!(summary.status, Status::Completed, "{:?} {:?}", options.code, summary.stop);
    outcome
}

/// Runs as far as it goes.
#[track_caller]
pub(crate) fn try_run(model: &Model, options: &Options) -> Outcome {
    run_from(model, options, None)
}

/// Runs as far as it goes from a state, or from the assembled start.
#[track_caller]
pub(crate) fn run_from(model: &Model, options: &Options, start: Option<&State>) -> Outcome {
    let problem = Problem::new(model.clone());
    let size_of = |name: &String| {
        let channel = problem.channels().iter().find(|c| c.name == *name);
        (name.clone(), channel.unwrap_or_else(|| panic!("no channel `{name}`")).size())
    };
    let channels = options.channels.iter().map(size_of).collect();
    let mut rows = Memory::default();
    let summary = run(&problem, options, start, &mut rows)
        .unwrap_or_else(|error| panic!("{:?}: {error}", options.code));
    Outcome { summary, rows, channels }
}

/// The table of a `reference.csv`: columns `time` and `channel` or `channel[index]`.
#[derive(Debug)]
pub(crate) struct Reference {
    pub(crate) columns: Vec<(String, usize)>,
    pub(crate) times: Vec<f64>,
    /// Per column its values at the times.
    pub(crate) values: Vec<Vec<f64>>,
}

/// Reads the reference of a model.
pub(crate) fn reference(name: &str) -> Reference {
    let file = library().join(name).join("reference.csv");
    let text = std::fs::read_to_string(&file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
    let mut lines = text.lines().filter(|line| !line.starts_with('#'));
    let header = lines.next().expect("a header").split(',');
    let columns: Vec<_> = header
        .map(|column| match column.split_once('[') {
            Some((name, index)) => {
                (name.to_owned(), index.trim_end_matches(']').parse().expect("an index"))
            }
            None => (column.to_owned(), 0),
        })
        .collect();
    assert_eq!(columns[0].0, "time", "{name}: the first column");
    let mut values = vec![Vec::new(); columns.len()];
    for line in lines {
        for (column, field) in values.iter_mut().zip(line.split(',')) {
            column.push(field.parse::<f64>().unwrap_or_else(|_| panic!("{name}: {field:?}")));
        }
    }
    let times = values.remove(0);
    assert!(values.iter().all(|column| column.len() == times.len()), "{name}: ragged rows");
    Reference { columns: columns[1..].to_vec(), times, values }
}

impl Reference {
    /// The part up to a time.
    pub(crate) fn until(mut self, time: f64) -> Self {
        let kept = self.times.iter().take_while(|&&t| t <= time).count();
        self.times.truncate(kept);
        self.values.iter_mut().for_each(|column| column.truncate(kept));
        self
    }

    /// Runs the model over the times of the reference.
    #[track_caller]
    pub(crate) fn run(&self, model: &Model, code: Code, tolerance: f64) -> Outcome {
        let mut channels: Vec<String> = self.columns.iter().map(|(name, _)| name.clone()).collect();
        channels.dedup();
        let end = *self.times.last().expect("times");
        let options = Options {
            channels,
            output: OutputTimes::Listed(self.times.clone()),
            ..options(code, tolerance, end)
        };
        run_model(model, &options)
    }

    /// Largest difference per column, `(column, difference)`.
    pub(crate) fn differences(&self, outcome: &Outcome) -> Vec<(String, f64)> {
        self.columns
            .iter()
            .zip(&self.values)
            .map(|((name, index), expected)| {
                let found = outcome.series(name, *index);
                assert_eq!(found.len(), expected.len(), "{name}: rows");
                let error = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
                (format!("{name}[{index}]"), error.fold(0.0, f64::max))
            })
            .collect()
    }
}

/// A four-bar of unequal links; its crank `left` can turn round.
pub(crate) const FOUR_BAR: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
left = { mass = 1.0, inertia = 0.1, position = [0.0, 0.5], angle = 1.5707963267948966 }
top = { mass = 1.0, inertia = 0.4, position = [1.0, 1.25], angle = 0.24497866312686414 }
right = { mass = 1.0, inertia = 0.2, position = [2.0, 0.75], angle = 1.5707963267948966 }
[joints]
a = { type = "revolute", between = ["ground", "left"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["left", "top"], point = [0.0, 1.0] }
c = { type = "revolute", between = ["top", "right"], point = [2.0, 1.5] }
d = { type = "revolute", between = ["ground", "right"], point = [2.0, 0.0] }
"#;

/// A pendulum on a cart that a driver moves to and fro: a moving constraint with one degree of
/// freedom. Cart: 0.3 m sin(4 t); rod 0.8 m with its mass in the middle.
pub(crate) const DRIVEN_PENDULUM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
cart = { mass = 2.0, inertia = 0.1, position = [0.0, 0.0] }
rod = { mass = 1.5, inertia = 0.08, position = [0.4, 0.0] }
[joints]
track = { type = "translational", between = ["ground", "cart"], point = [0.0, 0.0], axis = [1.0, 0.0] }
hinge = { type = "revolute", between = ["cart", "rod"], point = [0.0, 0.0] }
[drivers]
shaker = { joint = "track", coordinate = "translation", motion = { type = "harmonic", amplitude = 0.3, angular_frequency = 4.0 } }
[forces]
damper = { type = "rsda", between = ["cart", "rod"], damping = 0.2 }
"#;

/// A spatial slider-crank: crank of 0.08 m about x, rod of 0.3 m between a ball and a universal
/// joint, slider along x with a spring. One degree of freedom.
pub(crate) const SPATIAL_SLIDER_CRANK: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
crank = { mass = 0.12, inertia = [[1.0e-4, 0.0, 0.0], [0.0, 1.0e-4, 0.0], [0.0, 0.0, 2.0e-5]], position = [0.0, 0.1, 0.16] }
rod = { mass = 0.5, inertia = [[4.0e-3, 1.0e-4, 0.0], [1.0e-4, 4.0e-3, 0.0], [0.0, 0.0, 4.0e-3]], position = [0.1, 0.05, 0.1] }
slider = { mass = 2.0, inertia = [[1.0e-3, 0.0, 0.0], [0.0, 1.0e-3, 0.0], [0.0, 0.0, 1.0e-3]], position = [0.2, 0.0, 0.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.1, 0.12], axis = [1.0, 0.0, 0.0] }
ball = { type = "spherical", between = ["crank", "rod"], point = [0.0, 0.1, 0.2] }
cardan = { type = "universal", between = ["rod", "slider"], point = [0.2, 0.0, 0.0], axes = [[-0.1, -0.2, 0.0], [0.0, 0.0, 1.0]] }
guide = { type = "translational", between = ["ground", "slider"], point = [0.2, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[forces]
spring = { type = "tsda", between = ["ground", "slider"], points = [[0.6, 0.0, 0.0], [0.2, 0.0, 0.0]], stiffness = 200.0, damping = 1.0, free_length = 0.4 }
motor = { type = "torque", between = ["ground", "crank"], torque = { type = "harmonic", amplitude = 0.5, angular_frequency = 9.0 }, axis = [1.0, 0.0, 0.0] }
[initial.bodies]
crank = { angular_velocity = [6.0, 0.0, 0.0] }
"#;

/// A boom on a cardan joint with a telescope that a driver moves: a driver along an axis that
/// turns in space. Two degrees of freedom.
pub(crate) const DRIVEN_TELESCOPE: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
boom = { mass = 3.0, inertia = [[0.05, 0.0, 0.0], [0.0, 0.3, 0.01], [0.0, 0.01, 0.31]], position = [0.6, 0.0, 0.0] }
tip = { mass = 1.2, inertia = [[0.01, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]], position = [1.1, 0.0, 0.0] }
[joints]
cardan = { type = "universal", between = ["ground", "boom"], point = [0.0, 0.0, 0.0], axes = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0]] }
telescope = { type = "translational", between = ["boom", "tip"], point = [1.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
[drivers]
ram = { joint = "telescope", coordinate = "translation", motion = { type = "harmonic", amplitude = 0.25, angular_frequency = 3.0 } }
[forces]
cable = { type = "tsda", between = ["ground", "boom"], points = [[0.0, 0.3, 1.0], [0.9, 0.0, 0.05]], stiffness = 150.0, damping = 4.0, free_length = 1.0 }
[initial.bodies]
boom = { angular_velocity = [0.0, 0.5, 1.2] }
"#;

/// A platform on three parallel cranks, one of them redundant, with an extra state in a Maxwell element.
pub(crate) const PLATFORM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
left = { mass = 1.0, inertia = 0.02, position = [0.0, 0.2] }
middle = { mass = 1.0, inertia = 0.02, position = [0.5, 0.2] }
right = { mass = 1.0, inertia = 0.02, position = [1.0, 0.2] }
platform = { mass = 2.0, inertia = 0.2, position = [0.5, 0.4] }
[joints]
left_foot = { type = "revolute", between = ["ground", "left"], point = [0.0, 0.0] }
middle_foot = { type = "revolute", between = ["ground", "middle"], point = [0.5, 0.0] }
right_foot = { type = "revolute", between = ["ground", "right"], point = [1.0, 0.0] }
left_head = { type = "revolute", between = ["left", "platform"], point = [0.0, 0.4] }
middle_head = { type = "revolute", between = ["middle", "platform"], point = [0.5, 0.4] }
right_head = { type = "revolute", between = ["right", "platform"], point = [1.0, 0.4] }
[forces]
spring = { type = "rsda", between = ["ground", "left"], stiffness = 60.0, damping = 0.3, free_angle = 0.2 }
creep = { type = "maxwell", between = ["ground", "platform"], points = [[-1.0, 0.4], [0.0, 0.4]], stiffness = 100.0, damping = 30.0, free_length = 1.0 }
"#;

/// Bars on hinges with springs, bar i hanging from bar `parent(i)`, bar 0 being the ground, all stretched out; with
/// `loops` the ends of some keep their distances from points, with `relaxing` some have Maxwell elements.
pub(crate) fn bars(
    planar: bool,
    count: usize,
    parent: impl Fn(usize) -> usize,
    [loops, relaxing]: [bool; 2],
) -> Model {
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
        if relaxing && i % 5 == 3 {
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

/// Turns the four-bar at 9 rad/s: nothing is independent.
pub(crate) const MOTOR: &str = r#"
[drivers]
motor = { joint = "a", coordinate = "rotation", motion = { type = "polynomial", coefficients = [1.5707963267948966, 9.0] } }
"#;

/// What turns many times, and what is measured by directions and rotations: a free wheel, a tumbling body, a bob on a rod,
/// another one for a spring.
pub(crate) const TURNING: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
wheel = { mass = 2.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.06, 0.0], [0.0, 0.0, 0.06]], position = [0.0, 0.0, 0.0] }
top = { mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.12, 0.0], [0.0, 0.0, 0.07]], position = [0.0, 3.0, 0.0] }
bob = { mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]], position = [3.0, 0.0, 0.0] }
hung = { mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]], position = [6.0, 0.0, -1.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "wheel"], point = [0.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
rod = { type = "distance", between = ["ground", "bob"], points = [[2.0, 0.0, 0.0], [3.0, 0.0, 0.0]] }
[initial.bodies]
wheel = { angular_velocity = [40.0, 0.0, 0.0] }
top = { angular_velocity = [3.0, 0.1, 8.0] }
bob = { velocity = [0.0, 1.5, 2.8] }
hung = { velocity = [1.5, 0.6, 0.0] }
"#;

/// Two bodies on viscoelastic bushings: blocks of extra states.
pub(crate) const RUBBER_MOUNTS: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
a = { mass = 2.0, inertia = [[0.2, 0.0, 0.0], [0.0, 0.3, 0.0], [0.0, 0.0, 0.4]], position = [0.5, 0.0, 0.0] }
b = { mass = 1.0, inertia = [[0.2, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [1.0, 0.2, 0.0] }
[forces.first]
type = "bushing"
between = ["ground", "a"]
point = [0.2, 0.1, 0.0]
stiffness = [900.0, 800.0, 700.0]
rotational_stiffness = [90.0, 80.0, 70.0]
[forces.first.branches.coupled]
stiffness_matrix = [[400.0, 90.0, 0.0, 0.0, 30.0, 0.0], [90.0, 300.0, 0.0, 0.0, 20.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [30.0, 20.0, 0.0, 0.0, 20.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
damping_matrix = [[60.0, -10.0, 0.0, 0.0, 5.0, 0.0], [-10.0, 40.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [5.0, 0.0, 0.0, 0.0, 10.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]]
[forces.second]
type = "bushing"
between = ["a", "b"]
point = [0.8, 0.1, 0.0]
stiffness = [500.0, 500.0, 500.0]
rotational_stiffness = [50.0, 50.0, 50.0]
branches.fast = { stiffness = [200.0, 0.0, 0.0], damping = [3.0, 0.0, 0.0] }
branches.slow = { rotational_stiffness = [0.0, 40.0, 30.0], rotational_damping = [0.0, 50.0, 60.0] }
[initial.bodies]
b = { angular_velocity = [1.0, -0.5, 2.0] }
"#;
