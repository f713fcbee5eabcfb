//! What must not matter: where a model stands, how its ground frame is turned, how its bodies are
//! numbered, which way an axis is stated; for units see `unit_invariance.rs`. The independent truth is
//! the run of the untouched model.

use crate::common::table::all_codes;
use crate::common::{DRIVEN_TELESCOPE, SPATIAL_SLIDER_CRANK, model, model_of, options, run_model};
use holonom::method::Code;
use holonom::model::{
    Dimension, DriverKind, ForceKind, Frame, Model, Orientation, Road, Tolerance,
};
use holonom::newton::Representation;
use holonom::reduction::Coordinates;
use holonom::simulation::{Options, OutputTimes, Problem};

/// A rotation by Euler parameters, about z for planar models, and a translation.
#[derive(Clone, Copy)]
struct Placement {
    turn: [f64; 4],
    shift: [f64; 3],
}

impl Placement {
    fn turned(self, v: [f64; 3]) -> [f64; 3] {
        let [w, x, y, z] = self.turn;
        let cross = |a: [f64; 3], b: [f64; 3]| {
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
        };
        let once = cross([x, y, z], v);
        let twice = cross([x, y, z], once);
        std::array::from_fn(|k| v[k] + 2.0 * (w * once[k] + twice[k]))
    }

    fn placed(self, point: [f64; 3]) -> [f64; 3] {
        let turned = self.turned(point);
        std::array::from_fn(|k| turned[k] + self.shift[k])
    }

    fn angle(self) -> f64 {
        2.0 * self.turn[3].atan2(self.turn[0])
    }

    fn orientation(self, orientation: Orientation) -> Orientation {
        match orientation {
            Orientation::Angle(angle) => Orientation::Angle(angle + self.angle()),
            Orientation::EulerParameters([b0, b1, b2, b3]) => {
                let [a0, a1, a2, a3] = self.turn;
                Orientation::EulerParameters([
                    a0 * b0 - a1 * b1 - a2 * b2 - a3 * b3,
                    a0 * b1 + a1 * b0 + a2 * b3 - a3 * b2,
                    a0 * b2 - a1 * b3 + a2 * b0 + a3 * b1,
                    a0 * b3 + a1 * b2 - a2 * b1 + a3 * b0,
                ])
            }
        }
    }

    fn frame(self, frame: &mut Frame) {
        if frame.body.is_none() {
            frame.point = self.placed(frame.point);
            for column in 0..3 {
                let axis = self.turned([0, 1, 2].map(|row| frame.axes[row][column]));
                (0..3).for_each(|row| frame.axes[row][column] = axis[row]);
            }
        }
    }

    /// The whole model, its ground and its gravity, placed elsewhere.
    fn model(self, model: &Model) -> Model {
        let mut out = model.clone();
        out.gravity = self.turned(out.gravity);
        for body in &mut out.bodies {
            body.position = self.placed(body.position);
            body.orientation = self.orientation(body.orientation);
        }
        for stated in &mut out.initial.bodies {
            stated.position = stated.position.map(|p| self.placed(p));
            stated.orientation = stated.orientation.map(|o| self.orientation(o));
            stated.velocity = stated.velocity.map(|v| self.turned(v));
            stated.angular_velocity = stated.angular_velocity.map(|v| self.turned(v));
        }
        out.joints.iter_mut().flat_map(|j| &mut j.frames).for_each(|f| self.frame(f));
        for driver in &mut out.drivers {
            let between_frames = model.dimension == Dimension::Spatial;
            let shifted = !between_frames && driver.kind == DriverKind::Rotation;
            assert!(!shifted, "angles would need a shift");
            driver.frames.iter_mut().for_each(|f| self.frame(f));
        }
        for force in &mut out.forces {
            match &mut force.kind {
                ForceKind::Tsda { frames, .. }
                | ForceKind::Rsda { frames, .. }
                | ForceKind::Maxwell { frames, .. }
                | ForceKind::Bushing { frames, .. } => {
                    frames.iter_mut().for_each(|f| self.frame(f));
                }
                ForceKind::Tyre(tyre) => match &mut tyre.road {
                    Road::SmoothBump { center, .. } => *center += self.shift[0],
                    road => panic!("no placement of {road:?}"),
                },
                ForceKind::Torque { .. } => assert_eq!(model.dimension, Dimension::Planar),
                ForceKind::PointForce { .. } => panic!("components would have to be turned"),
            }
        }
        out
    }
}

/// Positions of all body origins at ten times, and the number of steps.
pub(crate) fn positions(
    model: &Model,
    code: Code,
    tolerance: f64,
    end: f64,
) -> (Vec<[f64; 3]>, u64) {
    positions_within(model, code, Tolerance::uniform(tolerance), end, Representation::Auto)
}

pub(crate) fn positions_within(
    model: &Model,
    code: Code,
    tolerance: Tolerance,
    end: f64,
    newton: Representation,
) -> (Vec<[f64; 3]>, u64) {
    let names: Vec<String> = model.bodies.iter().map(|b| format!("{}.position", b.name)).collect();
    let options = Options {
        output: OutputTimes::Interval(end / 10.0),
        channels: names.clone(),
        tolerance,
        initial_step: model.simulation.initial_step,
        newton,
        ..options(code, tolerance.relative, end)
    };
    let outcome = run_model(model, &options);
    let size = if model.dimension == Dimension::Planar { 2 } else { 3 };
    let rows = outcome.times().len();
    let mut out = Vec::new();
    for name in &names {
        let columns: Vec<_> = (0..size).map(|k| outcome.series(name, k)).collect();
        let component = |row: usize, k: usize| columns.get(k).map_or(0.0, |c| c[row]);
        out.extend((0..rows).map(|row| [0, 1, 2].map(|k| component(row, k))));
    }
    (out, outcome.summary.statistics.steps)
}

pub(crate) fn distance(a: [f64; 3], b: [f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

fn steps_agree(a: u64, b: u64) -> bool {
    a.abs_diff(b) as f64 <= (0.05 * a as f64).max(1.0)
}

#[track_caller]
fn assert_invariant(model: &Model, placement: Placement, code: Code, tolerance: f64, end: f64) {
    assert_invariant_within(10.0, model, placement, code, tolerance, end);
}

/// Positions may differ by `allowed` tolerances.
#[track_caller]
fn assert_invariant_within(
    allowed: f64,
    model: &Model,
    placement: Placement,
    code: Code,
    tolerance: f64,
    end: f64,
) {
    let (here, steps) = positions(model, code, tolerance, end);
    let (there, steps_there) = positions(&placement.model(model), code, tolerance, end);
    assert!(steps_agree(steps, steps_there), "{code:?}: {steps} steps, elsewhere {steps_there}");
    let difference =
        here.iter().zip(there).map(|(&a, b)| distance(placement.placed(a), b)).fold(0.0, f64::max);
    assert!(difference < allowed * tolerance, "{code:?}: {difference:.2e} m at {tolerance:e}");
}

const FAR_AND_TURNED: Placement = Placement {
    turn: [0.939_372_712_847_378_9, 0.0, 0.0, 0.342_897_807_455_451_4], // 0.7 rad about z
    shift: [1e4, -0.7e4, 0.0],
};

/// Codes that reach the end of stiff models in a short time.
const IMPLICIT: [Code; 3] = [Code::ForSdirk, Code::ForRosen, Code::ForRadau];

#[test]
fn planar_models_run_alike_everywhere() {
    let models = [
        ("simple_pendulum", 3.0),
        ("double_pendulum", 2.0),
        ("andrews", 0.03),
        ("slider_crank", 0.6),
    ];
    for (name, end) in models {
        for code in IMPLICIT {
            assert_invariant(&model(name), FAR_AND_TURNED, code, 1e-5, end);
        }
    }
    for code in [Code::Deabm, Code::Dopri5, Code::Dop853] {
        assert_invariant(&model("slider_crank"), FAR_AND_TURNED, code, 1e-5, 0.6);
    }
}

#[test]
fn a_spatial_model_runs_alike_everywhere() {
    // About (1, 2, 2)/3 by 2 rad.
    let (sin, cos) = 1f64.sin_cos();
    let turn = [cos, sin / 3.0, 2.0 * sin / 3.0, 2.0 * sin / 3.0];
    let placement = Placement { turn, shift: [1e4, -0.7e4, 0.3e4] };
    // In a turned frame other coordinates are independent. The explicit code's own error is then
    // another one of the same size, up to twenty tolerances here.
    for (code, allowed) in [(Code::ForSdirk, 10.0), (Code::ForRosen, 10.0), (Code::Deabm, 30.0)] {
        let telescope = model_of(DRIVEN_TELESCOPE);
        assert_invariant_within(allowed, &telescope, placement, code, 1e-5, 3.0);
    }
}

#[test] // truth: the start of the untouched model, turned; what is unstated is far from its design
fn what_is_found_from_the_joints_turns_with_the_model() {
    let turns = [[0.0, 0.0, 1.0], [1.0, 2.0, -0.5], [0.0, 3.0, 0.0], [1e-3, 0.0, 0.0]];
    for off in [[0.2, 0.1, -0.3], [0.0, 0.0, -0.05], [1.0, -2.0, 0.5]] {
        for (angle, far) in
            [(0.01, 0.0), (0.4, 0.0), (1.5, 0.0), (3.0, 0.0), (0.4, 2.0), (9.0, 200.0)]
        {
            let [x, y, z] = off;
            let body = "mass = 1.0\ninertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]";
            let model = model_of(&format!(
                r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies.arm]
{body}
position = [0.3, 0.0, 0.0]
[bodies.rod]
{body}
position = [{:?}, {y:?}, {z:?}]
[joints]
pin = {{ type = "cylindrical", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
ball = {{ type = "spherical", between = ["arm", "rod"], point = [0.6, 0.0, 0.0] }}
[drivers]
turn = {{ joint = "pin", coordinate = "rotation", motion = {angle:?} }}
lift = {{ joint = "pin", coordinate = "translation", motion = {far:?} }}
"#,
                0.6 + x
            ));
            let start = |model: &Model| {
                let problem = Problem::new(model.clone());
                let state = problem.assemble().expect("every angle can be met").state.clone();
                [0, 1].map(|b| problem.system().body(b, &state.q, &state.v).position)
            };
            let here = start(&model);
            for axis in turns {
                let size = distance(axis, [0.0; 3]);
                let (sin, cos) = (0.5 * size).sin_cos();
                let [x, y, z] = axis.map(|a| a / size * sin);
                let placement = Placement { turn: [cos, x, y, z], shift: [0.0; 3] };
                let there = start(&placement.model(&model));
                for (here, there) in here.iter().zip(there) {
                    let difference = distance(placement.placed(*here), there);
                    assert!(
                        difference < 1e-12 * (far + 10.0),
                        "{off:?} {angle} {far}: {difference:.2e} m"
                    );
                }
            }
        }
    }
}

#[test]
fn the_vehicle_rides_alike_on_another_stretch_of_road() {
    let placement = Placement { turn: [1.0, 0.0, 0.0, 0.0], shift: [1e4, -0.7e4, 0.0] };
    let mut vehicle = model("hmmwv14");
    // It starts in equilibrium, where a first step of the code's own is found from round-off; where steps
    // stand when the bump comes follows from it.
    vehicle.simulation.initial_step = Some(0.02);
    for code in IMPLICIT {
        assert_invariant(&vehicle, placement, code, 1e-3, 5.0);
    }
}

/// The model with its bodies in reverse order.
fn renumbered(model: &Model) -> Model {
    let mut out = model.clone();
    let last = out.bodies.len() - 1;
    out.bodies.reverse();
    out.initial.bodies.reverse();
    let frame = |frame: &mut Frame| frame.body = frame.body.map(|b| last - b);
    out.joints.iter_mut().flat_map(|j| &mut j.frames).for_each(frame);
    out.drivers.iter_mut().flat_map(|d| &mut d.frames).for_each(frame);
    for force in &mut out.forces {
        match &mut force.kind {
            ForceKind::Tsda { frames, .. }
            | ForceKind::Rsda { frames, .. }
            | ForceKind::Maxwell { frames, .. }
            | ForceKind::Bushing { frames, .. } => frames.iter_mut().for_each(frame),
            ForceKind::Tyre(tyre) => frame(&mut tyre.frame),
            ForceKind::PointForce { frame: point, .. } => frame(point),
            ForceKind::Torque { body, reaction, .. } => {
                *body = body.map(|b| last - b);
                *reaction = reaction.map(|b| last - b);
            }
        }
    }
    out
}

#[test]
fn numbering_of_bodies_does_not_matter() {
    let mut vehicle = model("hmmwv14");
    // As above: its first step would be found from round-off.
    vehicle.simulation.initial_step = Some(0.02);
    let models = [
        ("andrews", model("andrews"), 1e-5, 0.03),
        ("double pendulum", model("double_pendulum"), 1e-5, 2.0),
        ("slider-crank in space", model_of(SPATIAL_SLIDER_CRANK), 1e-6, 1.0),
        ("vehicle", vehicle, 1e-3, 5.0),
    ];
    for (name, model, tolerance, end) in models {
        let (mut here, steps) = positions(&model, Code::ForSdirk, tolerance, end);
        let (there, steps_there) = positions(&renumbered(&model), Code::ForSdirk, tolerance, end);
        assert!(steps_agree(steps, steps_there), "{name}: {steps} steps, {steps_there}");
        // Rows come body by body.
        let rows = here.len() / model.bodies.len();
        here = here.chunks(rows).rev().flatten().copied().collect();
        let difference = here.iter().zip(there).map(|(&a, b)| distance(a, b)).fold(0.0, f64::max);
        assert!(difference < 10.0 * tolerance, "{name}: {difference:.2e} m at {tolerance:e}");
    }
}

#[test] // with prescribed steps and iterations to round-off nothing but round-off is left
fn numbering_of_bodies_changes_round_off_only_where_steps_and_partition_are_prescribed() {
    let models = [
        ("double pendulum", model("double_pendulum"), 1e-3, 1.0),
        ("slider-crank in space", model_of(SPATIAL_SLIDER_CRANK), 2e-3, 1.0),
        ("spatial four-bar", model("spatial_four_bar"), 2e-3, 1.0),
        ("vehicle", model("hmmwv14"), 2e-3, 0.1),
    ];
    for (name, model, step, end) in models {
        for code in [Code::ForSdirk, Code::ForRosen, Code::ForRadau, Code::SspTrap, Code::InflSdirk]
        {
            let fixed = |model: &Model| {
                // The formula's own error depends on the partition: it stays.
                let options = Options {
                    fixed_step: Some(step),
                    repartition_factor: Some(1e12),
                    ..options(code, 1e-6, end)
                };
                let end = run_model(model, &options).summary.end;
                let bodies: Vec<Vec<f64>> =
                    end.q.chunks(end.q.len() / model.bodies.len()).map(<[f64]>::to_vec).collect();
                bodies
            };
            let (here, mut there) = (fixed(&model), fixed(&renumbered(&model)));
            there.reverse();
            let size = here.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
            let pairs = here.iter().flatten().zip(there.iter().flatten());
            let difference = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(difference < 1e-9 * size, "{name}, {code:?}: {difference:.1e}");
        }
    }
}

#[test] // truth: an axis is a line; the same hinge with that of its second body stated the other way
fn springs_and_drivers_turn_about_axes_that_are_stated_either_way() {
    let end = |second: f64, rest: &str| {
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
arm = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.5, 0.0, 0.0] }}
[joints]
pin = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axes_in_body = [[0.0, 1.0, 0.0], [0.0, {second:?}, 0.0]] }}
{}
"#,
            rest.replace("SECOND", &format!("{second:?}"))
        ));
        let channels = vec!["pin.angle".to_owned()];
        let options = Options {
            channels,
            output: OutputTimes::Interval(0.5),
            ..options(Code::ForRadau, 1e-6, 1.0)
        };
        run_model(&model, &options).series("pin.angle", 0)
    };
    let spring = "[forces]\nspring = { type = \"rsda\", between = [\"ground\", \"arm\"], \
                  axes_in_body = [[0.0, 1.0, 0.0], [0.0, SECOND, 0.0]], stiffness = 20.0 }\n";
    let driver = "[drivers]\nmotor = { joint = \"pin\", coordinate = \"rotation\", \
                  motion = { type = \"harmonic\", amplitude = 0.5, angular_frequency = 3.0 } }\n";
    for rest in ["", spring, driver] {
        let (same, opposite) = (end(1.0, rest), end(-1.0, rest));
        assert!(same[2].abs() > 0.05, "{rest} {same:?}");
        for (a, b) in same.iter().zip(&opposite) {
            assert!((a - b).abs() < 1e-6, "{rest} {same:?} {opposite:?}");
        }
    }
}

#[test] // truth: turning the hinge and the start about the axis of the spring turns the motion, and nothing else
fn a_spring_about_another_axis_than_its_joint_s_does_not_know_what_is_across_it() {
    let angles = |azimuth: f64| {
        let (s, c) = azimuth.sin_cos();
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
rotor = {{ mass = 2.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.0, 0.0, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "rotor"], point = [0.0, 0.0, 0.0], axis = [{c:?}, {s:?}, 1.0] }}
[forces]
spring = {{ type = "rsda", between = ["ground", "rotor"], axis = [0.0, 0.0, 1.0], stiffness = 5.0 }}
[initial.joints]
hinge = {{ angle = 1.2 }}
"#
        ));
        let channels = vec!["hinge.angle".to_owned(), "spring.angle".to_owned()];
        let options = Options {
            channels,
            output: OutputTimes::Interval(0.1),
            ..options(Code::ForRadau, 1e-8, 0.4)
        };
        let run = run_model(&model, &options);
        [run.series("hinge.angle", 0), run.series("spring.angle", 0)]
    };
    let first = angles(0.0);
    assert!((first[0][4] - first[0][0]).abs() > 0.5, "{first:?}");
    for azimuth in [0.8, 1.6, 4.0] {
        for (a, b) in first.iter().flatten().zip(angles(azimuth).iter().flatten()) {
            assert!((a - b).abs() < 1e-6, "{azimuth}: {a} {b}");
        }
    }
}

#[test] // truth: what is stiff about one axis of a ball joint is that coordinate alone, however stiff
fn a_stiff_spring_about_one_axis_of_a_ball_joint_is_a_coordinate() {
    let steps = |stiffness: f64| {
        let damping = 1e-3 * stiffness;
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
bob = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.05]], position = [0.3, 0.0, -0.8] }}
[joints]
ball = {{ type = "spherical", between = ["ground", "bob"], point = [0.0, 0.0, 0.0] }}
[forces]
spring = {{ type = "rsda", between = ["ground", "bob"], axis = [0.0, 0.0, 1.0], stiffness = {stiffness:?}, damping = {damping:?} }}
[initial.bodies]
bob = {{ angular_velocity = [0.5, 1.0, 0.0] }}
"#
        ));
        let options = options(Code::ForRadau, 1e-4, 5.0);
        run_model(&model, &options).summary.statistics.steps
    };
    let (soft, stiff) = (steps(1e4), steps(1e7));
    assert!(stiff < 2 * soft && stiff < 400, "{soft} {stiff}");
}

/// A four-bar of three centimetres whose crank turns.
const SMALL_FOUR_BAR: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 0.02, inertia = 1.67e-7, position = [0.00270151, 0.00420735] }
coupler = { mass = 0.02, inertia = 1.5e-6, position = [0.01812560, 0.01636053] }
rocker = { mass = 0.02, inertia = 1.04e-6, position = [0.02792409, 0.01215318] }
[joints]
a = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "coupler"], point = [0.00540302, 0.00841471] }
c = { type = "revolute", between = ["coupler", "rocker"], point = [0.03084817, 0.02430635] }
d = { type = "revolute", between = ["ground", "rocker"], point = [0.025, 0.0] }
[forces]
spring = { type = "rsda", between = ["ground", "rocker"], stiffness = 0.02, damping = 1e-5 }
[initial.bodies]
crank = { angular_velocity = 20.0 }
"#;

#[test] // truth: the linkage at the origin; at a thousand kilometres the last digit of a place is 1e-8 of a link
fn a_small_loop_moves_alike_where_places_have_few_digits() {
    let near = model_of(SMALL_FOUR_BAR);
    for code in all_codes() {
        for coordinates in [Coordinates::Joint, Coordinates::Cartesian] {
            let turned = |model: &Model| {
                let options = Options {
                    output: OutputTimes::Interval(0.05),
                    channels: vec!["crank.angle".into()],
                    coordinates,
                    ..options(code, 1e-4, 0.5)
                };
                run_model(model, &options).series("crank.angle", 0)
            };
            let expected = turned(&near);
            for far in [1e5, 1e6] {
                let shift = [far, 0.7 * far, 0.0];
                let there = Placement { turn: [1.0, 0.0, 0.0, 0.0], shift }.model(&near);
                for (found, expected) in turned(&there).iter().zip(&expected) {
                    let error = (found - expected).abs();
                    assert!(
                        error < 1e-3,
                        "{code:?}, {coordinates:?} at {far:e} m: {error:.1e} rad"
                    );
                }
            }
        }
    }
}
