//! Model files to models. The independent truth is geometry done by hand.

use holonom::error::{Code, ModelErrors};
use holonom::io::{Document, Syntax};
use holonom::method::Profile;
use holonom::model::{
    DriverKind, ElasticLaw, ForceKind, Frame, InitialExtraState, JointKind, Model, Orientation,
    Road, SimulationDefaults,
};
use holonom::newton::{JacobianSource, Representation};
use holonom::reduction::accelerations::Accelerations;
use holonom::reduction::{Coordinates, ParametrizationKind};
use holonom::simulation::Problem;
use serde_json::json;

fn document(text: &str) -> Result<Document, ModelErrors> {
    let mut none = |_: &str| Err("no other file".to_owned());
    Document::parse(text, Syntax::Toml, "model.toml", &mut none)
}

fn build(text: &str) -> Result<Model, ModelErrors> {
    Ok(document(text)?.build()?.0)
}

fn model(text: &str) -> Model {
    build(text).unwrap_or_else(|errors| panic!("{}", errors.render()))
}

fn joint<'a>(m: &'a Model, name: &str) -> (JointKind, &'a [Frame; 2]) {
    let joint = m.joints.iter().find(|j| j.name == name).unwrap();
    (joint.kind, &joint.frames)
}

fn force<'a>(m: &'a Model, name: &str) -> &'a ForceKind {
    &m.forces.iter().find(|f| f.name == name).unwrap().kind
}

fn column(a: &[[f64; 3]; 3], c: usize) -> [f64; 3] {
    [a[0][c], a[1][c], a[2][c]]
}

#[track_caller]
fn assert_near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < 1e-13, "{found:?} ≠ {expected:?}");
    }
}

const DOUBLE_PENDULUM: &str = include_str!("files/double_pendulum.toml");

#[test]
fn a_planar_model_has_its_points_in_body_axes() {
    let m = model(DOUBLE_PENDULUM);
    let (kind, [a, b]) = joint(&m, "elbow");
    assert_eq!(kind, JointKind::Revolute);
    // The elbow is at the end of the upper rod and, half length 1.5, at (-1.5, 0) of the lower.
    assert_near(&a.point, &[1.0, 0.0, 0.0]);
    assert_near(&b.point, &[-1.5, 0.0, 0.0]);
    let ForceKind::Rsda { frames, law, free_angle, .. } = force(&m, "shoulder_spring") else {
        panic!()
    };
    // The relative angle is the difference of the body angles: axes parallel to the body axes.
    assert_eq!(frames[1].axes, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    assert_eq!((law, *free_angle), (&ElasticLaw::Linear(400.0), 4.71238898038469));
    assert_eq!(m.bodies[0].orientation, Orientation::Angle(std::f64::consts::TAU));
    assert_eq!(m.initial.bodies[1].angular_velocity, Some([0.0, 0.0, 10.0]));
    assert_eq!(m.initial.bodies[0].velocity, None);
}

const SPATIAL: &str = include_str!("files/spatial.toml");

#[test]
fn a_spatial_model_has_its_frames_in_body_axes() {
    let m = model(SPATIAL);
    // The base is turned by 90 degrees about z: (x, y, z) of the ground is (y, -x, z) of the body.
    let (_, [a, b]) = joint(&m, "hinge");
    assert_near(&a.point, &[2.0, 0.0, 0.0]);
    assert_near(&b.point, &[0.0, 0.0, 0.0]);
    assert_near(&column(&a.axes, 2), &[0.0, 0.0, 1.0]);
    assert_near(&column(&b.axes, 2), &[0.0, 0.0, 1.0]);
    // The relative angle is zero in the design configuration: f of both is the same direction.
    let fa = column(&a.axes, 0);
    assert_near(&[-fa[1], fa[0], fa[2]], &column(&b.axes, 0));

    let (_, [a, b]) = joint(&m, "slide");
    assert_near(&a.point, &[0.0, 0.0, 0.0]);
    assert_near(&b.point, &[-2.0, 1.0, -3.0]);
    assert_near(&column(&a.axes, 2), &[0.0, 1.0, 0.0]);
    assert_near(&column(&b.axes, 2), &[1.0, 0.0, 0.0]);

    let (_, [a, b]) = joint(&m, "screw");
    assert_near(&b.point, &[0.0, 0.0, -1.0]);
    assert_near(&column(&a.axes, 2), &[0.0, 0.0, 1.0]);

    let (_, [a, b]) = joint(&m, "cross");
    assert_near(&column(&a.axes, 2), &[0.0, -1.0, 0.0]);
    assert_near(&column(&b.axes, 2), &[0.0, 1.0, 0.0]);

    let (kind, [a, b]) = joint(&m, "rod");
    assert_eq!(kind, JointKind::Distance { length: 4.0 });
    assert_near(&a.point, &[1.0, 4.0, 0.0]);
    assert_near(&b.point, &[0.0, 0.0, 1.0]);
    assert_eq!(joint(&m, "weld").0, JointKind::Fixed);
    assert_eq!(joint(&m, "ball").0, JointKind::Spherical);

    let ForceKind::Tsda { frames, law: ElasticLaw::Table(law), .. } = force(&m, "spring") else {
        panic!()
    };
    assert_near(&frames[0].point, &[0.5, 0.0, 0.0]);
    assert_near(&frames[1].point, &[0.0, 0.0, 0.5]);
    assert_eq!(law.values(), &[-200.0, 0.0, 300.0]);

    let ForceKind::Bushing { stiffness, damping, frames, .. } = force(&m, "rubber") else {
        panic!()
    };
    let diagonal = |a: &[[f64; 6]; 6]| [0, 1, 2, 3, 4, 5].map(|i| a[i][i]);
    assert_eq!(diagonal(stiffness), [7.0e7, 6.0e7, 5.0e7, 1.0e3, 2.0e3, 3.0e3]);
    assert_eq!(diagonal(damping), [3.5e4, 3.5e4, 3.5e4, 0.0, 0.0, 0.0]);
    // Bushing axes are ground axes in the design configuration: x of the ground is -y of the base.
    assert_near(&column(&frames[0].axes, 0), &[0.0, -1.0, 0.0]);
    assert_near(&column(&frames[1].axes, 0), &[1.0, 0.0, 0.0]);

    let ForceKind::Tyre(tyre) = force(&m, "wheel") else { panic!() };
    assert_eq!(tyre.road, Road::SmoothBump { height: 0.05, half_length: 0.35, center: 4.2335 });
    assert_eq!(tyre.smoothing, 1e-3);
    assert_near(&tyre.lateral.unwrap().axis, &[0.0, 1.0, 0.0]);

    let ForceKind::PointForce { force: push, .. } = force(&m, "push") else { panic!() };
    let at = push.clone().map(|f| f.derivatives(0.2)[0]);
    let size = 10.0 * f64::sin(0.6);
    assert_near(&at, &[0.0, 0.6 * size, 0.8 * size]);
    let ForceKind::Torque { body, reaction, torque, .. } = force(&m, "motor") else { panic!() };
    assert_eq!((*reaction, *body), (Some(0), Some(1)));
    assert_near(&torque.clone().map(|f| f.derivatives(2.0)[0]), &[0.0, 1.0, 2.0]);

    assert_eq!(m.drivers[0].kind, DriverKind::Translation);
    assert_eq!(m.drivers[0].frames, *joint(&m, "slide").1);
    assert_eq!(m.drivers[1].frames[0].body, None);
    assert_near(&column(&m.drivers[1].frames[1].axes, 2), &[1.0, 0.0, 0.0]);
    assert_near(&[m.drivers[1].motion.derivatives(3.0)[0]], &[6.0]);

    assert_eq!(m.initial.bodies[0].velocity, Some([4.4704, 0.0, 0.0]));
    assert_eq!(m.initial.bodies[1].velocity, Some([0.0; 3]));
    assert_eq!(m.initial.bodies[1].position, Some([1.0, 4.0, 3.1]));
    assert_eq!(m.initial.extra_states, [("series".to_owned(), InitialExtraState::Spring(0.01))]);
    assert_eq!(m.simulation.tolerance.unwrap().rotation, 1e-5);
    assert_eq!(m.simulation.max_steps, Some(1000));
    assert_eq!(m.outputs.channels.len(), 3);
}

#[test]
fn a_planar_slide_has_its_axis_in_both_bodies() {
    let m = model(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 1.0, inertia = 1.0, position = [1.0, 1.0], angle = 0.5235987755982988 }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [1.0, 1.0], axis = [0.0, 2.0] }
[drivers]
push = { on = "block", coordinate = "translation", point = [1.0, 1.0], axis = [1.0, 1.0], motion = { type = "table", x = [0.0, 1.0, 2.0], y = [0.0, 1.0, 0.0] } }
"#,
    );
    let (_, [a, b]) = joint(&m, "guide");
    assert_near(&column(&a.axes, 0), &[0.0, 1.0, 0.0]);
    assert_near(&column(&a.axes, 1), &[-1.0, 0.0, 0.0]);
    // Seen from a body turned by 30 degrees, the vertical is at 60 degrees.
    assert_near(&column(&b.axes, 0), &[0.5, 0.75_f64.sqrt(), 0.0]);
    assert_near(&column(&m.drivers[0].frames[0].axes, 0), &[0.5_f64.sqrt(), 0.5_f64.sqrt(), 0.0]);
    assert!((m.drivers[0].motion.derivatives(1.0)[0] - 1.0).abs() < 1e-15);
}

#[test]
fn the_merged_text_gives_the_same_model() {
    for text in [DOUBLE_PENDULUM, SPATIAL] {
        let first = document(text).unwrap();
        let mut none = |_: &str| Err(String::new());
        let again = Document::parse(&first.to_json(), Syntax::Json, "x", &mut none).unwrap();
        assert_eq!(first.build().unwrap().0, again.build().unwrap().0);
        assert_eq!(first.to_json(), again.to_json());
    }
}

#[test]
fn values_are_set_by_path() {
    let d = document(SPATIAL).unwrap();
    let changed = d
        .with_values(&[
            ("forces.rubber.stiffness[2]", json!(2.0e7)),
            ("parameters.speed", json!(9.0)),
            ("simulation.start_time", json!(0.5)),
            ("simulation.tolerance", json!(1e-6)),
            ("initial.bodies.base.velocity", json!([1.0, 2.0, 3.0])),
            ("forces.torsion.damping", json!(0.25)),
            ("joints.weld.enabled", json!(false)),
            ("bodies.arm.mass", json!("=speed")),
        ])
        .unwrap();
    let m = changed.build().unwrap().0;
    let ForceKind::Bushing { stiffness, .. } = force(&m, "rubber") else { panic!() };
    assert_eq!(stiffness[2][2], 2.0e7);
    let ForceKind::Rsda { damping, .. } = force(&m, "torsion") else { panic!() };
    assert_eq!(*damping, 0.25);
    assert_eq!(m.bodies[1].mass, 9.0);
    assert_eq!(m.simulation.start_time, Some(0.5));
    assert_eq!(m.simulation.tolerance.unwrap().relative, 1e-6);
    assert_eq!(m.initial.bodies[0].velocity, Some([1.0, 2.0, 3.0]));
    assert!(m.joints.iter().all(|j| j.name != "weld"));
    // The document itself is unchanged.
    assert_eq!(d.build().unwrap().0, model(SPATIAL));
}

#[test]
fn paths_that_lead_nowhere_are_refused_with_the_nearest() {
    let d = document(SPATIAL).unwrap();
    for (path, nearest) in [
        ("forces.ruber.stiffness[2]", "`rubber`"),
        ("forces.rubber.stifness", "`stiffness`"),
        ("parameters.sped", "`speed`"),
        ("force.rubber.stiffness", "`forces`"),
        ("simulation.endtime", "`end_time`"),
        ("initial.bodies.bse.velocity", "`base`"),
        ("forces.rubber.stiffness[3]", "3 entries"),
        ("forces.rubber.stiffness[2].x", "number"),
        ("forces..x", "not a path"),
        ("", "not a path"),
        ("extends", "takes no value"),
        ("bodies.base.mass[0]", "number"),
    ] {
        let errors = d.with_values(&[(path, json!(1.0))]).unwrap_err();
        assert_eq!(errors.errors[0].code, Code::UnknownPath, "{path}");
        assert!(errors.render().contains(nearest), "{path}: {}", errors.render());
    }
    let errors =
        d.with_values(&[("bodies.base.mass", json!("heavy"))]).unwrap().build().unwrap_err();
    assert_eq!(
        (errors.errors[0].code, errors.errors[0].location.is_none()),
        (Code::WrongType, true)
    );
}

#[test] // truth: what is said to switch the item off does
fn null_is_no_value_and_the_way_to_remove_is_told() {
    let d = document(SPATIAL).unwrap();
    for (path, value, way) in [
        ("joints.weld", json!(null), Some("joints.weld")),
        ("forces.rubber.stiffness", json!([1.0, null, 1.0]), Some("forces.rubber")),
        ("forces.rubber.stiffness[1]", json!(null), Some("forces.rubber")),
        ("parameters.speed", json!(null), None),
        ("gravity", json!(null), None),
    ] {
        let errors = d.with_values(&[(path, value)]).unwrap_err();
        let [error] = &errors.errors[..] else { panic!("{errors:?}") };
        assert_eq!((error.code, error.path.as_str()), (Code::UnusableValue, path));
        assert!(error.message.contains("null"), "{error:?}");
        let told = error.help.split('`').find_map(|part| part.strip_suffix(".enabled = false"));
        assert_eq!(told, way, "{error:?}");
        if let Some(item) = told {
            let off = d.with_values(&[(format!("{item}.enabled"), json!(false))]).unwrap();
            let name = item.split('.').nth(1).unwrap();
            let model = off.build().unwrap().0;
            assert!(model.joints.iter().all(|j| j.name != name));
            assert!(model.forces.iter().all(|f| f.name != name));
        }
    }
    let errors = d.with_values(&[("bodies.base.mass", json!(1e200))]).unwrap_err();
    assert_eq!(errors.errors[0].code, Code::NotFinite);
}

#[test] // truth: the channels that docs/conventions.md lists
fn an_output_channel_that_is_not_there_is_refused_at_its_place() {
    let with = |channels: &str| {
        let text =
            format!("{DOUBLE_PENDULUM}[outputs]\nchannels = [\"energy.total\", {channels}]\n");
        let d = document(&text).unwrap();
        let problem = Problem::new(d.build().unwrap().0);
        d.check_channels(&problem)
    };
    for known in [
        "upper.position",
        "upper.*",
        "*.position",
        "*.*",
        "upper.position[1]",
        "pivot.a*",
        "pivot.force",
        "constraint.position",
    ] {
        assert!(with(&format!("\"{known}\"")).is_ok(), "{known}");
    }
    for (unknown, help) in [
        ("upper.velocityy", "did you mean `upper.velocity`?"),
        ("upper.positon[1]", "did you mean `upper.position[1]`?"),
        ("upper.positon[2]", "did you mean `upper.position`?"),
        ("upper.yaw_pitch_roll", "`angle`"),
        ("upper.position[2]", "up to 1"),
        ("upper.angle[0]", "leave the index out"),
        ("*.positon", "did you mean `*.position`?"),
        ("zz*.position", "no item has a name like `zz*`"),
        ("zz*.position[0]", "no item has a name like `zz*`"),
        ("pivot.x*", "`angle`"),
        ("[upper.position", "its `[` has no `]`"),
        ("upper.[ax*", "its `[` has no `]`"),
    ] {
        let errors = with(&format!("\n  \"{unknown}\"")).unwrap_err();
        let [error] = &errors.errors[..] else { panic!("{errors:?}") };
        assert_eq!((error.code, error.path.as_str()), (Code::UnknownName, "outputs.channels[1]"));
        let place = error.location.as_ref().unwrap();
        let line = DOUBLE_PENDULUM.lines().count() + 3;
        assert_eq!((place.file.as_str(), place.line), ("model.toml", line), "{error:?}");
        assert!(error.message.contains(unknown) && error.help.contains(help), "{error:?}");
    }
}

#[test] // truth: the codes of docs/methods.md, and docs/model-file.md
fn a_wrong_word_of_the_run_is_refused_at_its_place() {
    for (line, field, help) in [
        ("method = \"ForRadu\"", "method", "did you mean \"ForRadau\"?"),
        ("method = \"RK45\"", "method", "did you mean \"DOPRI5\"?"),
        ("method = \"statespace\"", "method", "did you mean \"state_space\"?"),
        ("formula = \"radau6\"", "formula", "did you mean \"radau5\"?"),
        ("formula = \"newmark\"", "formula", ""),
        ("parametrization = \"trees\"", "parametrization", "did you mean \"tree\"?"),
        ("newton = \"spars\"", "newton", "did you mean \"sparse\"?"),
        ("coordinates = \"joints\"", "coordinates", "did you mean \"joint\"?"),
    ] {
        let errors = build(&format!("{DOUBLE_PENDULUM}{line}\n")).unwrap_err();
        let [error] = &errors.errors[..] else { panic!("{errors:?}") };
        let path = format!("simulation.{field}");
        assert_eq!((error.code, error.path.as_str()), (Code::UnknownChoice, path.as_str()));
        let place = error.location.as_ref().unwrap();
        let at = DOUBLE_PENDULUM.lines().count() + 1;
        assert_eq!((place.file.as_str(), place.line), ("model.toml", at), "{error:?}");
        assert!(error.help.contains(help), "{error:?}");
    }
    for line in [
        "method = \"forsdirk\"",
        "method = \"state_space\"\nformula = \"newmark\"",
        "formula = \"sdirk4_16\"",
    ] {
        assert!(build(&format!("{DOUBLE_PENDULUM}{line}\n")).is_ok(), "{line}");
    }
}

#[test] // truth: docs/conventions.md, what is not stated of a tolerance in parts is 1e-4
fn a_tolerance_may_be_stated_in_part() {
    let with = |tolerance: &str| build(&format!("{DOUBLE_PENDULUM}tolerance = {tolerance}\n"));
    let parts = |tolerance: &str| {
        let t = with(tolerance).unwrap().simulation.tolerance.unwrap();
        [t.relative, t.translation, t.rotation]
    };
    assert_eq!(parts("{ relative = 1e-6 }"), [1e-6, 1e-4, 1e-4]);
    assert_eq!(parts("{ rotation = 1e-3, translation = 1e-2 }"), [1e-4, 1e-2, 1e-3]);
    assert_eq!(parts("1e-6"), [1e-6; 3]);
    let d = document(DOUBLE_PENDULUM).unwrap();
    let d = d.with_values(&[("simulation.tolerance.translation", json!(1e-5))]).unwrap();
    assert_eq!(d.build().unwrap().0.simulation.tolerance.unwrap().translation, 1e-5);
    let errors = with("{}").unwrap_err();
    assert_eq!(errors.errors[0].path, "simulation.tolerance");
    assert!(with("{ relative = -1.0 }").is_err());
}

#[test]
fn a_variant_changes_what_it_names_and_keeps_the_rest() {
    let variant = r#"
holonom = 1
extends = "../base/model.toml"
title = "softer"
[parameters]
speed = { value = 1.0 }
[joints]
hinge = { axis = [1.0, 0.0, 0.0] }
weld = { enabled = false }
[forces]
rubber = { stiffness = [1.0, 2.0, 3.0] }
spring = { type = "maxwell", between = ["base", "arm"], points = ["base.heel", "base.tip"], stiffness = 1.0, damping = 1.0, free_length = 0.0 }
"#;
    let mut asked = Vec::new();
    let mut files = |path: &str| {
        asked.push(path.to_owned());
        Ok(SPATIAL.to_owned())
    };
    let name = "models/variant/model.toml";
    let d = Document::parse(variant, Syntax::Toml, name, &mut files).unwrap();
    assert_eq!(asked, ["models/base/model.toml"]);
    // The second point must be one of `arm`: the error points into the variant.
    let errors = d.build().unwrap_err();
    assert_eq!(errors.errors[0].path, "forces.spring.points[1]");
    assert_eq!(errors.errors[0].location.as_ref().unwrap().file, name);
    assert_eq!(errors.errors[0].location.as_ref().unwrap().line, 12);
    let d = d.with_values(&[("forces.spring.points[1]", json!([1.0, 4.0, 3.0]))]).unwrap();
    let m = d.build().unwrap().0;
    assert_eq!((m.title.as_str(), m.joints.len()), ("softer", 6));
    assert_near(&column(&joint(&m, "hinge").1[1].axes, 2), &[1.0, 0.0, 0.0]);
    assert_eq!(m.initial.bodies[0].velocity, Some([1.0, 0.0, 0.0]));
    assert!(matches!(force(&m, "spring"), ForceKind::Maxwell { .. }));
    let ForceKind::Bushing { stiffness, damping, .. } = force(&m, "rubber") else { panic!() };
    assert_eq!((stiffness[1][1], damping[1][1]), (2.0, 3.5e4));
    // What is switched off and what was extended is not in the merged text.
    assert!(!d.to_json().contains("weld") && !d.to_json().contains("extends"));
    // An error in the base names the base.
    let mut files = |_: &str| Ok(SPATIAL.replace("mass = 10.0", "mas = 10.0"));
    let d = Document::parse(variant, Syntax::Toml, name, &mut files).unwrap();
    let errors = d.build().unwrap_err();
    assert_eq!(errors.errors[0].location.as_ref().unwrap().file, "models/base/model.toml");
}

#[test]
fn warnings_speak_of_what_is_legal_but_implausible() {
    let text = DOUBLE_PENDULUM
        .replace("-9.81", "-9810.0")
        .replace("mass = 3.0", "mass = 3.0e6")
        .replace("angle = 6.021385919380436", "angle = 345.0")
        .replace("\"=k1\"", "400.0")
        .replace("[-1.0, 0.0]", "[-2000.0, 0.0]");
    let d = document(&text).unwrap();
    let (_, warnings) = d.build().unwrap();
    let found: Vec<_> = warnings.iter().map(|w| (w.code, w.path.as_str())).collect();
    let expected = [
        (Code::UnusedParameter, "parameters.k1"),
        (Code::Implausible, "gravity"),
        (Code::Implausible, "bodies.upper.mass"),
        (Code::Implausible, "bodies.lower.angle"),
        (Code::Implausible, "joints.pivot"),
    ];
    for e in expected {
        assert!(found.contains(&e), "{e:?} {found:?}");
    }
    assert!(warnings.iter().all(|w| w.location.is_some()));
    assert!(document(DOUBLE_PENDULUM).unwrap().build().unwrap().1.is_empty());
    let (_, warnings) =
        document(&DOUBLE_PENDULUM.replace("gravity", "# gravity")).unwrap().build().unwrap();
    assert_eq!(warnings[0].code, Code::NotStated);
}

#[test] // truth: the same crank in millimetres, and with its inertia in kg mm²
fn lengths_and_inertias_in_millimetres_bring_warnings() {
    let crank = |length: f64, inertia: f64| {
        let text = format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = {{ mass = 0.5, inertia = {inertia:e}, position = [{}, 0.0] }}
[joints]
pin = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }}
"#,
            0.5 * length
        );
        let warnings = document(&text).unwrap().build().unwrap().1;
        warnings.into_iter().map(|w| w.path).collect::<Vec<_>>()
    };
    assert_eq!(crank(0.15, 1e-3), [""; 0]);
    assert_eq!(crank(0.15, 1e3), ["bodies.crank.inertia"]);
    assert_eq!(crank(150.0, 1e3), ["bodies.crank"]);
    assert_eq!(
        crank(1e-3, 2e-2),
        [""; 0],
        "a rotor whose axle is half a millimetre beside its middle"
    );
    assert_eq!(crank(1e-9, 1e-3), [""; 0], "a wheel whose axle is in its middle but for round-off");
}

/// Paths of what looks like another unit in a linkage whose values are these.
fn suspected(values: [&str; 6]) -> Vec<String> {
    let [angle, shift, motion, drive, free, rod] = values;
    let text = format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
arm = {{ mass = 1.0, inertia = 0.01, position = [0.25, 0.0] }}
slider = {{ mass = 1.0, inertia = 0.01, position = [0.0, 0.5] }}
car = {{ mass = 1.0, inertia = 0.01, position = [0.0, 1.0] }}
bob = {{ mass = 1.0, inertia = 0.01, position = [1.0, 1.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }}
rail = {{ type = "translational", between = ["ground", "slider"], point = [0.0, 0.75], axis = [1.0, 0.0] }}
road = {{ type = "translational", between = ["ground", "car"], point = [0.0, 1.2], axis = [1.0, 0.0] }}
rod = {{ type = "distance", between = ["arm", "bob"], points = [[0.5, 0.0], [1.0, 1.0]], {rod} }}
[forces]
spring = {{ type = "tsda", between = ["arm", "slider"], points = [[0.0, 0.0], [0.0, 0.25]], stiffness = 10.0, {free} }}
[drivers]
turn = {{ joint = "hinge", coordinate = "rotation", motion = {motion} }}
drive = {{ joint = "road", coordinate = "translation", motion = {drive} }}
[initial.joints]
hinge = {{ angle = {angle} }}
rail = {{ displacement = {shift} }}
"#
    );
    let warnings = document(&text).unwrap().build().unwrap().1;
    assert!(warnings.iter().all(|w| w.code == Code::Implausible && w.location.is_some()));
    warnings.into_iter().map(|w| w.path).collect()
}

#[test] // truth: 9.81 m/s² in each unit
fn gravity_in_metres_of_a_file_in_other_units_brings_a_warning() {
    for (unit, right) in [("mm", 9810.0), ("cm", 981.0), ("in", 386.1), ("ft", 32.17), ("m", 9.81)]
    {
        for (gravity, suspect) in [(right, false), (9.81, unit != "m"), (0.165 * right, false)] {
            let text = format!(
                "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -{gravity:?}]\n[units]\nlength = \"{unit}\"\n[bodies]\n\
                 b = {{ mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }}\n"
            );
            let (_, warnings) = document(&text).unwrap().build().unwrap();
            let found = warnings.iter().any(|w| w.path == "gravity");
            assert_eq!(found, suspect, "{gravity} {unit}/s²: {warnings:?}");
        }
    }
}

#[test] // truth: the same mechanism in metres and radians, and in millimetres and degrees
fn starts_drivers_and_lengths_in_other_units_bring_warnings() {
    let right = ["1.5707963", "0.25", "0.7853982", "0.1", "free_length = 0.2", "length = 1.2"];
    assert_eq!(suspected(right), [""; 0]);
    let wrong = ["90", "250", "45", "200", "free_length = 200", "length = 1200"];
    let expected = [
        "forces.spring.free_length",
        "joints.rod.length",
        "initial.joints.hinge.angle",
        "initial.joints.rail.displacement",
        "drivers.turn.motion",
        "drivers.drive.motion",
    ];
    assert_eq!(suspected(wrong), expected);
    for (at, path) in [4, 5, 0, 1, 2, 3].into_iter().zip(expected) {
        let mut one = right;
        one[at] = wrong[at];
        assert_eq!(suspected(one), [path]);
    }
    for (motion, path) in [
        (r#"{ type = "smooth_step", from = 0.0, to = 90.0, start = 0.0, end = 1.0 }"#, "to"),
        (r#"{ type = "harmonic", amplitude = 30.0, angular_frequency = 2.0 }"#, "amplitude"),
        (
            r#"{ type = "harmonic", amplitude = 0.5, angular_frequency = 2.0, phase = 90.0 }"#,
            "phase",
        ),
        (r#"{ type = "polynomial", coefficients = [45.0, 1.0] }"#, "coefficients[0]"),
    ] {
        let mut one = right;
        one[2] = motion;
        assert_eq!(suspected(one), [format!("drivers.turn.motion.{path}")]);
    }
    // What turns or drives far is no other unit, nor is a few turns more.
    for (at, value) in [
        (2, r#"{ type = "polynomial", coefficients = [0.0, 100.0] }"#),
        (2, "12.566370614359172"),
        (3, r#"{ type = "smooth_step", from = 0.0, to = 500.0, start = 0.0, end = 9.0 }"#),
        (4, "free_length = 5.0"),
        (1, "20.0"),
    ] {
        let mut one = right;
        one[at] = value;
        assert_eq!(suspected(one), [""; 0], "{value}");
    }
}

#[test]
fn a_motion_that_ends_before_the_run_brings_a_warning() {
    let text = DOUBLE_PENDULUM.replace(
        "[initial.bodies]",
        "[drivers]\nturn = { joint = \"pivot\", coordinate = \"rotation\", motion = { type = \"table\", x = [0.0, 1.0], y = [0.0, 1.0] } }\n[initial.bodies]",
    );
    let d = document(&text).unwrap();
    let (_, warnings) = d.build().unwrap();
    let found: Vec<_> = warnings.iter().map(|w| (w.code, w.path.as_str())).collect();
    assert_eq!(found, [(Code::ShortTable, "drivers.turn.motion")]);
    let shorter = d.with_values(&[("simulation.end_time", json!(1.0))]).unwrap();
    assert!(shorter.build().unwrap().1.is_empty());
}

#[test]
fn a_motion_that_swings_far_beyond_its_table_brings_a_warning() {
    let turning = |x: &str, y: &str| {
        let driver = format!(
            "[drivers]\nturn = {{ joint = \"pivot\", coordinate = \"rotation\", motion = {{ type = \"table\", x = {x}, y = {y} }} }}\n[initial.bodies]"
        );
        let (_, warnings) = document(&DOUBLE_PENDULUM.replace("[initial.bodies]", &driver))
            .unwrap()
            .build()
            .unwrap();
        warnings.iter().map(|w| (w.code, w.path.clone())).collect::<Vec<_>>()
    };
    let path = "drivers.turn.motion".to_owned();
    // A tenth of a radian in a tenth of a second, between two rests of five.
    assert_eq!(
        turning("[0.0, 5.0, 5.1, 10.0]", "[0.0, 0.0, 0.1, 0.1]"),
        [(Code::Implausible, path)]
    );
    // A wave at four points of each period, none of which is at its crest.
    let wave =
        turning("[0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0]", "[0.7, 0.7, -0.7, -0.7, 0.7, 0.7, -0.7]");
    assert_eq!(wave, []);
}

#[test]
fn what_is_switched_off_has_to_be_there() {
    let text = format!("{DOUBLE_PENDULUM}\n[forces.sprnig]\nenabled = false\n");
    let errors = document(&text).unwrap().build().unwrap_err().errors;
    let found: Vec<_> = errors.iter().map(|e| (e.code, e.path.as_str())).collect();
    assert_eq!(found, [(Code::UnknownName, "forces.sprnig")]);
}

#[test]
fn a_tiny_model_far_away_brings_a_warning_with_the_numbers() {
    let far = |x: f64| {
        format!(
            "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n[bodies]\n\
             rod = {{ mass = 1.0, inertia = 1.0e-5, position = [{x:e}, 0.0] }}\n[joints]\n\
             pin = {{ type = \"revolute\", between = [\"ground\", \"rod\"], point = [{:.3}, 0.0] }}\n",
            x - 0.01
        )
    };
    let warnings = |x: f64| document(&far(x)).unwrap().build().unwrap().1;
    assert!(warnings(1e3).is_empty());
    let found = warnings(1e6);
    assert_eq!((found[0].code, found[0].path.as_str()), (Code::Implausible, "bodies.rod.position"));
    for part in ["1.0000e6 m", "1.0e8 times", "1.0000e-2 m", "2.2e-10 m"] {
        assert!(found[0].message.contains(part), "{}", found[0].message);
    }
}

#[test]
fn choices_of_a_run_are_the_words_of_the_options() {
    fn words<T>(all: &[(T, &'static str)]) -> Vec<&'static str> {
        all.iter().map(|(_, word)| *word).collect()
    }
    type Stated = fn(&SimulationDefaults) -> Option<&'static str>;
    let with = |field: &str, word: &str| {
        let end = "[simulation]";
        build(&DOUBLE_PENDULUM.replace(end, &format!("{end}\n{field} = \"{word}\"")))
    };
    assert!(DOUBLE_PENDULUM.contains("[simulation]"));
    let fields: [(&str, Vec<&str>, Stated); 6] = [
        ("parametrization", words(ParametrizationKind::ALL), |s| {
            s.parametrization.map(ParametrizationKind::name)
        }),
        ("jacobian", words(JacobianSource::ALL), |s| s.jacobian.map(JacobianSource::name)),
        ("profile", words(Profile::ALL), |s| s.profile.map(Profile::name)),
        ("newton", words(Representation::ALL), |s| s.newton.map(Representation::name)),
        ("accelerations", words(Accelerations::ALL), |s| s.accelerations.map(Accelerations::name)),
        ("coordinates", words(Coordinates::ALL), |s| s.coordinates.map(Coordinates::name)),
    ];
    for (field, words, stated) in fields {
        for word in words {
            assert_eq!(stated(&with(field, word).unwrap().simulation), Some(word));
        }
        let errors = with(field, "something").unwrap_err();
        assert_eq!(errors.errors[0].code, Code::UnknownChoice);
        assert_eq!(errors.errors[0].path, format!("simulation.{field}"));
    }
    assert_eq!(model(DOUBLE_PENDULUM).simulation.profile, None);
}

/// A chain of `n` bodies as text; every joint names a body that is not there when `broken`.
fn long_chain(n: usize, broken: bool) -> String {
    let wrong = if broken { "x" } else { "" };
    let bodies = (0..n).map(|i| {
        format!("link{i} = {{ mass = 0.1, inertia = 1.0e-4, position = [{}, 0.0] }}\n", i as f64)
    });
    let joints = (0..n).map(|i| {
        let first = if i == 0 { "ground".to_owned() } else { format!("link{}{wrong}", i - 1) };
        format!("j{i} = {{ type = \"revolute\", between = [\"{first}\", \"link{i}\"], point = [{}, 0.0] }}\n", i as f64)
    });
    let head = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n".to_owned();
    head + "[bodies]\n" + &bodies.collect::<String>() + "[joints]\n" + &joints.collect::<String>()
}

#[test] // reading is linear in the size: a quadratic step would take minutes here
fn large_files_are_read_in_reasonable_time() {
    let n = 20_000;
    let m = model(&long_chain(n, false));
    assert_eq!((m.bodies.len(), m.joints.len()), (n, n));
    assert_near(&m.joints[n - 1].frames[0].point, &[1.0, 0.0, 0.0]);
    let errors = build(&long_chain(n, true)).unwrap_err();
    assert_eq!(errors.errors.len() + errors.omitted, n - 1);
    assert_eq!(errors.errors[0].path, "joints.j1.between[0]");
}
