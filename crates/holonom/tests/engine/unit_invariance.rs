//! What must not matter: in which units a model is written. The independent truth is the run of the untouched model.

use crate::common::{model, model_of};
use crate::invariance::{distance, positions, positions_within};
use holonom::method::Code;
use holonom::model::{
    DriverKind, ElasticLaw, ForceKind, Frame, JointKind, Model, Orientation, Road, TimeFunction,
    Tolerance,
};
use holonom::newton::Representation;
use holonom::simulation::Problem;
use holonom::system::Measure;

/// Other units: each number is how many of them one metre, kilogram or second is.
#[derive(Clone, Copy)]
struct Units {
    length: f64,
    mass: f64,
    time: f64,
}

impl Units {
    fn force(self) -> f64 {
        self.mass * self.length / self.time.powi(2)
    }

    fn points(self, point: [f64; 3]) -> [f64; 3] {
        point.map(|x| x * self.length)
    }

    fn law(unit: f64, law: &mut ElasticLaw) {
        match law {
            ElasticLaw::Linear(stiffness) => *stiffness *= unit,
            ElasticLaw::Table(_) => panic!("no units of tables"),
        }
    }

    /// A function of time whose values have a unit.
    fn function(self, unit: f64, function: &mut TimeFunction) {
        match function {
            TimeFunction::Constant(value) => *value *= unit,
            TimeFunction::Harmonic { amplitude, angular_frequency, offset, .. } => {
                *amplitude *= unit;
                *offset *= unit;
                *angular_frequency /= self.time;
            }
            other => panic!("no units of {other:?}"),
        }
    }

    /// The same model, written in these units.
    fn model(self, model: &Model) -> Model {
        let Self { length, mass, time } = self;
        let force = self.force();
        let mut out = model.clone();
        out.gravity = out.gravity.map(|g| g * length / time.powi(2));
        for body in &mut out.bodies {
            body.mass *= mass;
            body.inertia = body.inertia.map(|row| row.map(|x| x * mass * length.powi(2)));
            body.position = self.points(body.position);
            body.center_of_mass = self.points(body.center_of_mass);
        }
        for stated in &mut out.initial.bodies {
            stated.position = stated.position.map(|p| self.points(p));
            stated.velocity = stated.velocity.map(|v| v.map(|x| x * length / time));
            stated.angular_velocity = stated.angular_velocity.map(|w| w.map(|x| x / time));
        }
        let frame = |frame: &mut Frame| frame.point = self.points(frame.point);
        for stated in &mut out.initial.joints {
            stated.frames.iter_mut().for_each(frame);
            let unit = if stated.kind == DriverKind::Translation { length } else { 1.0 };
            stated.value *= if stated.is_rate { unit / time } else { unit };
        }
        for joint in &mut out.joints {
            joint.frames.iter_mut().for_each(frame);
            if let JointKind::Distance { length: distance } = &mut joint.kind {
                *distance *= length;
            }
        }
        for driver in &mut out.drivers {
            driver.frames.iter_mut().for_each(frame);
            let unit = if driver.kind == DriverKind::Translation { length } else { 1.0 };
            self.function(unit, &mut driver.motion);
        }
        for item in &mut out.forces {
            match &mut item.kind {
                ForceKind::Tsda { frames, law, damping, free_length } => {
                    frames.iter_mut().for_each(frame);
                    Self::law(force / length, law);
                    *damping *= force / length * time;
                    *free_length *= length;
                }
                ForceKind::Rsda { frames, law, damping, .. } => {
                    frames.iter_mut().for_each(frame);
                    Self::law(force * length, law);
                    *damping *= force * length * time;
                }
                ForceKind::Tyre(tyre) => {
                    frame(&mut tyre.frame);
                    tyre.radius *= length;
                    tyre.smoothing *= length;
                    tyre.stiffness *= force / length;
                    tyre.damping *= force / length * time;
                    match &mut tyre.road {
                        Road::SmoothBump { height, half_length, center } => {
                            for x in [height, half_length, center] {
                                *x *= length;
                            }
                        }
                        road => panic!("no units of {road:?}"),
                    }
                    if let Some(lateral) = &mut tyre.lateral {
                        lateral.cornering_stiffness *= force;
                        lateral.regularization_speed *= length / time;
                    }
                }
                ForceKind::Torque { torque, .. } => {
                    torque.iter_mut().for_each(|f| self.function(force * length, f));
                }
                other => panic!("no units of {other:?}"),
            }
        }
        out
    }
}

const PLANAR_JOINTS: &str = r#"
holonom = 1
dimension = "planar"
[bodies]
a = { mass = 1.0, inertia = 0.1, position = [0.5, 0.0] }
b = { mass = 1.0, inertia = 0.1, position = [1.5, 0.0] }
c = { mass = 1.0, inertia = 0.1, position = [3.0, 0.0] }
[joints]
pin = { type = "revolute", between = ["ground", "a"], point = [0.0, 0.0] }
slide = { type = "translational", between = ["a", "b"], point = [1.0, 0.0], axis = [1.0, 0.0] }
rod = { type = "distance", between = ["ground", "c"], points = [[3.0, 1.0], [3.2, 0.0]] }
[drivers]
push = { joint = "slide", coordinate = "translation", motion = 0.1 }
turn = { joint = "pin", coordinate = "rotation", motion = 0.3 }
"#;

const SPATIAL_JOINTS: &str = r#"
holonom = 1
dimension = "spatial"
[bodies]
a = { mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.5, 0.0, 0.0] }
b = { mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [1.5, 0.0, 0.0] }
c = { mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [3.0, 0.0, 0.0] }
[joints]
cross = { type = "universal", between = ["ground", "a"], point = [0.0, 0.0, 0.0], axes = [[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] }
slide = { type = "cylindrical", between = ["a", "b"], point = [1.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }
rod = { type = "distance", between = ["b", "c"], points = [[1.5, 1.0, 0.0], [3.2, 0.0, 0.0]] }
hinge = { type = "revolute", between = ["ground", "c"], point = [3.0, 0.0, 1.0], axis = [0.0, 1.0, 0.0] }
"#;

#[test] // independent truth: what is in metres has a thousand times the value in millimetres
fn rows_say_whether_they_are_lengths() {
    let millimetres = Units { length: 1e3, mass: 1.0, time: 1.0 };
    for model in [model_of(PLANAR_JOINTS), model_of(SPATIAL_JOINTS)] {
        let rows = |model: &Model, units: f64| {
            let problem = Problem::new(model.clone());
            let (system, mut q) = (problem.system(), vec![0.0; 0]);
            let structure = system.structure();
            for (b, body) in model.bodies.iter().enumerate() {
                let turn = 0.1 * (b + 1) as f64;
                let moved = body.position.map(|x| x + 0.03 * turn * units);
                q.extend(&moved[..structure.sizes.translations]);
                match body.orientation {
                    Orientation::Angle(angle) => q.push(angle + turn),
                    Orientation::EulerParameters(_) => q.extend([1.0, turn, -0.5 * turn, turn]),
                }
            }
            let mut values = vec![0.0; structure.sizes.rows];
            system.position_constraints(0.0, &q, &mut values);
            let names: Vec<String> = (0..values.len()).map(|row| system.row_name(row)).collect();
            (values, names, structure.row_measure.clone())
        };
        let (metres, names, measures) = rows(&model, 1.0);
        let (there, ..) = rows(&millimetres.model(&model), 1e3);
        for (row, measure) in measures.iter().enumerate() {
            let factor = if *measure == Measure::Length { 1e3 } else { 1.0 };
            let (a, b) = (metres[row], there[row]);
            assert!(a.abs() > 1e-6, "{}: {a:e} says nothing", names[row]);
            assert!((b - factor * a).abs() < 1e-9 * b.abs(), "{}: {a:e} m, {b:e} mm", names[row]);
        }
    }
}

#[test]
fn units_do_not_matter() {
    let models = [
        ("double_pendulum", 1e-4, 2.0),
        ("andrews", 1e-4, 0.03),
        ("slider_crank", 1e-4, 0.6),
        ("spatial_four_bar", 1e-4, 2.0),
        ("hmmwv14", 1e-3, 0.8),
    ];
    // Decimetres and grams; a larger and slower world.
    let mechanical = Units { length: 10.0, mass: 1e3, time: 1.0 };
    let all = Units { length: 0.3, mass: 1e-2, time: 2.0 };
    for (name, tolerance, end) in models {
        let model = model(name);
        for code in [Code::SspTrap, Code::InflSdirk, Code::ForSdirk, Code::ForRosen] {
            let (here, steps) = positions(&model, code, tolerance, end);
            for units in [mechanical, all] {
                let scaled = Tolerance {
                    translation: tolerance * units.length,
                    ..Tolerance::uniform(tolerance)
                };
                let (there, steps_there) = positions_within(
                    &units.model(&model),
                    code,
                    scaled,
                    end * units.time,
                    Representation::Auto,
                );
                // A tolerance has one absolute part for metres and metres per second: other seconds
                // shift the weight between positions and velocities.
                let alike = units.time != 1.0 || steps.abs_diff(steps_there) <= 1;
                assert!(alike, "{name}, {code:?}: {steps} steps, {steps_there}");
                let back = there.iter().map(|p| p.map(|x| x / units.length));
                let difference =
                    here.iter().zip(back).map(|(&a, b)| distance(a, b)).fold(0.0, f64::max);
                assert!(
                    difference < 10.0 * tolerance,
                    "{name}, {code:?}: {difference:.2e} m at {tolerance:e}"
                );
            }
        }
    }
}

/// A crank that a belt turns, a coupler on a rocker, and a bar from it to a second rocker.
const LOOM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 1.0, inertia = 8e-4, position = [0.05, 0.0] }
coupler = { mass = 2.0, inertia = 0.03, position = [0.28, 0.25] }
rocker = { mass = 1.0, inertia = 0.01, position = [0.475, 0.125] }
bar = { mass = 1.0, inertia = 0.02, position = [0.525, 0.475] }
sley = { mass = 4.0, inertia = 0.08, position = [0.775, 0.25] }
motor = { mass = 5.0, inertia = 0.2, position = [-0.2, 0.0] }
[joints]
a = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "coupler"], point = [0.1, 0.0] }
c = { type = "revolute", between = ["coupler", "rocker"], point = [0.45, 0.3] }
d = { type = "revolute", between = ["ground", "rocker"], point = [0.5, -0.05] }
e = { type = "revolute", between = ["coupler", "bar"], point = [0.3, 0.45] }
f = { type = "revolute", between = ["bar", "sley"], point = [0.75, 0.5] }
g = { type = "revolute", between = ["ground", "sley"], point = [0.8, 0.0] }
m = { type = "revolute", between = ["ground", "motor"], point = [-0.2, 0.0] }
[forces]
belt = { type = "rsda", between = ["motor", "crank"], stiffness = 400.0, damping = 0.6 }
pull = { type = "torque", on = "motor", torque = 5.0 }
"#;

#[test] // powers of two change no digit
fn heavy_loops_in_joint_coordinates_are_as_light_ones() {
    let model = model_of(LOOM);
    for code in [Code::ForRadau, Code::ForRosen, Code::Dopri5] {
        let steps = [(1.0, 1.0), (8192.0, 1048576.0), (1048576.0, 1.0)].map(|(length, mass)| {
            let tolerance = Tolerance { translation: 1e-4 * length, ..Tolerance::uniform(1e-4) };
            let there = Units { length, mass, time: 1.0 }.model(&model);
            positions_within(&there, code, tolerance, 0.5, Representation::Auto).1
        });
        assert!(steps.iter().all(|n| n.abs_diff(steps[0]) <= 1), "{code:?}: {steps:?}");
    }
}

/// A crank whose speed is stated, and a pendulum on its slider, which has to be found one.
const CRANK: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 1.0, inertia = 0.02, position = [0.1, 0.1] }
rod = { mass = 1.0, inertia = 0.05, position = [0.4, 0.1] }
slider = { mass = 2.0, inertia = 0.01, position = [0.6, 0.0] }
pendulum = { mass = 1.0, inertia = 0.02, position = [0.7, -0.2] }
[joints]
a = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "rod"], point = [0.2, 0.2] }
c = { type = "revolute", between = ["rod", "slider"], point = [0.6, 0.0] }
d = { type = "translational", between = ["ground", "slider"], point = [0.6, 0.0], axis = [1.0, 0.0] }
e = { type = "revolute", between = ["slider", "pendulum"], point = [0.6, 0.0] }
[initial.joints]
a = { angular_velocity = 5.0 }
"#;

#[test] // powers of two change no digit
fn rates_that_nobody_states_are_found_in_all_units() {
    let model = model_of(CRANK);
    let rates = [0, -10, -20, -30, -40, 20].map(|power| {
        let there = Units { length: 2f64.powi(power), mass: 1.0, time: 1.0 }.model(&model);
        let problem = Problem::new(there);
        let v = &problem.assemble().expect("can be assembled").state.v;
        [v[2], v[5], v[11]]
    });
    assert!(rates[0][2].abs() > 0.1, "a pendulum that hangs still says nothing");
    for other in rates {
        let off = (0..3).map(|k| (other[k] - rates[0][k]).abs()).fold(0.0, f64::max);
        assert!(off < 1e-9, "{other:?} and {:?} rad/s", rates[0]);
    }
}

#[test] // beside its joints the masses of a small mechanism are round-off, if all is measured in kilograms and metres
fn a_mechanism_of_micrometres_is_no_harder() {
    let (tolerance, end) = (1e-4, 1.0);
    for name in ["double_pendulum_w10", "spatial_four_bar"] {
        let model = model(name);
        for code in [Code::InflSdirk, Code::InflTrap, Code::ForRadau, Code::SspSdirk16] {
            for newton in [Representation::Dense, Representation::Sparse] {
                let within = |model: &Model, translation: f64| {
                    let tolerance = Tolerance { translation, ..Tolerance::uniform(tolerance) };
                    positions_within(model, code, tolerance, end, newton)
                };
                let (here, steps) = within(&model, tolerance);
                for (length, mass) in [(1e-3, 1e-9), (1e-6, 1e-12), (1e-6, 1e-18), (1e3, 1e9)] {
                    let small = Units { length, mass, time: 1.0 }.model(&model);
                    let (there, steps_there) = within(&small, tolerance * length);
                    let case = format!("{name}, {code:?}, {newton:?}, {length:e} m, {mass:e} kg");
                    assert!(steps.abs_diff(steps_there) <= 1, "{case}: {steps}, {steps_there}");
                    let back = there.iter().map(|p| p.map(|x| x / length));
                    let difference =
                        here.iter().zip(back).map(|(&a, b)| distance(a, b)).fold(0.0, f64::max);
                    assert!(difference < tolerance, "{case}: {difference:.2e}");
                }
            }
        }
    }
}
