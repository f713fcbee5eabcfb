//! Initial states stated by coordinates of joints, and orientations stated by angles.

use crate::common::{model_of, options, run_model};
use holonom::io::{Document, Syntax};
use holonom::method::DEFAULT_CODE;
use holonom::reduction::assembly::AssemblyError;
use holonom::simulation::{Options, OutputTimes, Problem};
use holonom::system::Sample;
use std::f64::consts::TAU;

const PENDULUM: &str = r#"
holonom = 1
dimension = "DIMENSION"
gravity = GRAVITY
[bodies]
upper = { mass = 1.0, inertia = INERTIA, position = POINT(0.0, -0.5) }
lower = { mass = 1.0, inertia = INERTIA, position = POINT(0.0, -1.5) }
[joints]
top = { type = "revolute", between = ["ground", "upper"], point = POINT(0.0, 0.0)AXIS }
middle = { type = "revolute", between = ["upper", "lower"], point = POINT(0.0, -1.0)AXIS }
"#;

/// A double pendulum in the plane, or in space about the ground's z axis, with more text.
fn pendulum(spatial: bool, rest: &str) -> Problem {
    let text = format!("{PENDULUM}{rest}");
    let (dimension, gravity, inertia, axis, zero) = if spatial {
        let inertia = "[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]";
        ("spatial", "[0.0, -9.81, 0.0]", inertia, ", axis = [0.0, 0.0, 1.0]", ", 0.0]")
    } else {
        ("planar", "[0.0, -9.81]", "0.1", "", "]")
    };
    let text = text.replace("DIMENSION", dimension).replace("GRAVITY", gravity);
    let text = text.replace("INERTIA", inertia).replace("AXIS", axis).replace("POINT(", "[");
    Problem::new(model_of(&text.replace(')', zero)))
}

/// A channel at the assembled start.
fn read(problem: &Problem, name: &str) -> Vec<f64> {
    let assembled = problem.assemble().unwrap();
    let channel = problem.channel(name).unwrap_or_else(|| panic!("no channel {name}"));
    let mut out = vec![0.0; channel.size()];
    problem.system().channel(&channel, &Sample::new(&assembled.state), &mut out);
    out
}

fn near(found: &[f64], expected: &[f64]) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!((a - b).abs() < 1e-11, "{found:?} is not {expected:?}");
    }
}

#[test] // independent truth: the geometry of two rods, with angles beyond half a turn
fn angles_of_hinges_place_a_double_pendulum() {
    let (a, b) = (2.5_f64, -4.0_f64);
    for spatial in [false, true] {
        let rest = format!(
            "[initial.joints]\ntop = {{ angle = {a}, angular_velocity = 2.0 }}\nmiddle = {{ angle = {b} }}\n"
        );
        let problem = pendulum(spatial, &rest);
        near(&read(&problem, "top.angle"), &[a]);
        near(&read(&problem, "middle.angle"), &[b]);
        near(&read(&problem, "top.rate"), &[2.0]);
        // What is not stated beyond the stated hinge is carried along.
        near(&read(&problem, "middle.rate"), &[0.0]);
        let end = [a.sin(), -a.cos()];
        let lower = [end[0] + 0.5 * (a + b).sin(), end[1] - 0.5 * (a + b).cos()];
        near(&read(&problem, "lower.position")[..2], &lower);
        near(&read(&problem, "lower.velocity")[..2], &[-2.0 * lower[1], 2.0 * lower[0]]);
    }
}

#[test] // independent truth: twenty hinges of three radians each, far from the design
fn many_hinges_far_from_the_design_are_placed() {
    let mut text = "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n".to_owned();
    text += "[patterns.chain]\nover.i = { from = 1, to = 20 }\n";
    text += "bodies.\"link_{i}\" = { mass = 1.0, inertia = 0.1, position = [\"=i\", 0.0] }\n";
    text += "joints.\"pin_{i}\" = { type = \"revolute\", between = [\"link_{i - 1}\", \"link_{i}\"], \
             point = [\"=i\", 0.0] }\n";
    text += "initial.joints.\"pin_{i}\" = { angle = \"=3.0 - 0.1*i\", angular_velocity = \"=0.1*i\" }\n";
    text += "[bodies.link_0]\nmass = 1.0\ninertia = 0.1\nposition = [0.0, 0.0]\n";
    text +=
        "[joints.root]\ntype = \"fixed\"\nbetween = [\"ground\", \"link_0\"]\npoint = [0.0, 0.0]\n";
    let problem = Problem::new(model_of(&text));
    let (mut angle, mut rate) = (0.0, 0.0);
    for i in 1..=20 {
        near(&read(&problem, &format!("pin_{i}.angle")), &[3.0 - 0.1 * f64::from(i)]);
        near(&read(&problem, &format!("pin_{i}.rate")), &[0.1 * f64::from(i)]);
        angle += 3.0 - 0.1 * f64::from(i);
        rate += 0.1 * f64::from(i);
    }
    near(&read(&problem, "link_20.angle"), &[angle]);
    near(&read(&problem, "link_20.angular_velocity"), &[rate]);
}

#[test] // independent truth: a crank of 1 m and a rod of 2 m, the slider on the x axis
fn a_stated_slider_places_the_crank_of_a_loop() {
    let text = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 1.0, inertia = 0.1, position = [0.0, 0.5], angle = 1.5707963267948966 }
rod = { mass = 1.0, inertia = 0.1, position = [0.8660254037844386, 0.5], angle = -0.5235987755982988 }
slider = { mass = 1.0, inertia = 0.1, position = [1.7320508075688772, 0.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
pin = { type = "revolute", between = ["crank", "rod"], point = [0.0, 1.0] }
wrist = { type = "revolute", between = ["rod", "slider"], point = [1.7320508075688772, 0.0] }
guide = { type = "translational", between = ["ground", "slider"], point = [1.7320508075688772, 0.0], axis = [1.0, 0.0] }
[initial.joints]
guide = { displacement = 0.4, velocity = 0.5 }
"#;
    let problem = Problem::new(model_of(text));
    near(&read(&problem, "guide.displacement"), &[0.4]);
    near(&read(&problem, "guide.rate"), &[0.5]);
    let x = 3f64.sqrt() + 0.4;
    let angle = ((1.0 + x * x - 4.0) / (2.0 * x)).acos(); // law of cosines
    near(&read(&problem, "crank.angle"), &[angle]);
    // x = cos φ + √(4 − sin² φ)
    let (s, c) = angle.sin_cos();
    near(&read(&problem, "crank.angular_velocity"), &[0.5 / (-s - s * c / (4.0 - s * s).sqrt())]);
}

#[test] // independent truth: a screw motion by hand, and turns about the two axes of a cardan joint
fn cylindrical_and_universal_joints_are_stated() {
    let text = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.nut]
mass = 1.0
inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
position = [1.0, 0.0, 0.0]
[bodies.arm]
mass = 1.0
inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
position = [0.0, 0.0, 1.0]
[joints]
rod = { type = "cylindrical", between = ["ground", "nut"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 2.0] }
cross = { type = "universal", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] }
[initial.joints]
rod = { angle = 7.0, displacement = 0.3, angular_velocity = 2.0, velocity = -0.1 }
cross = { angles = [0.4, -0.7], angular_velocities = [1.5, 0.5] }
"#;
    let problem = Problem::new(model_of(text));
    for (name, expected) in
        [("angle", 7.0), ("displacement", 0.3), ("angle_rate", 2.0), ("displacement_rate", -0.1)]
    {
        near(&read(&problem, &format!("rod.{name}")), &[expected]);
    }
    let (s, c) = 7f64.sin_cos();
    near(&read(&problem, "nut.position"), &[c, s, 0.3]);
    near(&read(&problem, "nut.velocity"), &[-2.0 * s, 2.0 * c, -0.1]);
    // R_x(0.4) R_y(−0.7) e_z
    let ((sa, ca), (sb, cb)) = (0.4f64.sin_cos(), (-0.7f64).sin_cos());
    near(&read(&problem, "arm.position"), &[sb, -sa * cb, ca * cb]);
    near(&read(&problem, "arm.angular_velocity"), &[1.5, 0.5 * ca, 0.5 * sa]);
}

#[test]
fn conflicts_name_the_joint_and_its_value() {
    let both =
        "[initial.bodies]\nupper = { angle = 0.2 }\n[initial.joints]\ntop = { angle = 0.5 }\n";
    let error = pendulum(false, both).assemble().unwrap_err().clone();
    let AssemblyError::StatedJoint { item, field, value, .. } = &error else { panic!("{error}") };
    assert_eq!((item.as_str(), field.as_str(), *value), ("top", "angle", 0.5));
    let text = error.to_string();
    assert!(text.starts_with("the stated angle of joint `top`, 0.5 rad, contradicts"), "{text}");
    assert!(text.contains(" m are left, ") || text.contains(" rad are left, "), "{text}");
    let rate = "[initial.bodies]\nlower = { angular_velocity = 1.0 }\nupper = { angular_velocity = 1.0 }\n\
                [initial.joints]\nmiddle = { angular_velocity = 0.5 }\n";
    let error = pendulum(false, rate).assemble().unwrap_err().clone();
    assert_eq!((error.code(), error.item()), ("assembly/inconsistent", Some("middle")));
    assert!(error.to_string().contains(" rad/s are left, "), "{error}");
    // As guesses they move, and how far is told.
    let adjusted = pendulum(false, &format!("[initial]\nassembly = \"adjust\"\n{both}"));
    let moved = &adjusted.assemble().unwrap().adjustments;
    assert!(moved.iter().any(|a| a.rotation > 1e-3), "{moved:?}");
}

#[test]
fn fields_that_a_joint_has_not_are_refused() {
    let message = |rest: &str| {
        let text = PENDULUM.replace("DIMENSION", "planar").replace("GRAVITY", "[0.0, 0.0]");
        let text = text.replace("INERTIA", "0.1").replace("AXIS", "").replace("POINT(", "[");
        let text = text.replace(')', "]") + rest;
        let document =
            Document::parse(&text, Syntax::Toml, "m", &mut |_| Err(String::new())).unwrap();
        document.build().unwrap_err().render()
    };
    let text = message("[initial.joints]\ntop = { displacement = 0.5 }\n");
    assert!(
        text.contains("the joint `top` of `initial.joints.top` has no `displacement`"),
        "{text}"
    );
    assert!(text.contains("help: revolute joints have `angle`"), "{text}");
    let text = message("[initial.joints]\ntip = { angle = 0.5 }\n");
    assert!(text.contains("did you mean `top`?"), "{text}");
}

#[test] // independent truth: the value that the path names
fn values_of_joints_are_set_by_path() {
    let text = PENDULUM.replace("DIMENSION", "planar").replace("GRAVITY", "[0.0, 0.0]");
    let text = text.replace("INERTIA", "0.1").replace("AXIS", "").replace("POINT(", "[");
    let text = text.replace(')', "]");
    let document = Document::parse(&text, Syntax::Toml, "m", &mut |_| Err(String::new())).unwrap();
    let set = |path: &str| document.with_values(&[(path, serde_json::json!(0.25))]);
    let problem = Problem::new(set("initial.joints.top.angle").unwrap().build().unwrap().0);
    near(&read(&problem, "top.angle"), &[0.25]);
    assert!(set("initial.joints.tap.angle").unwrap_err().render().contains("`top`"));
}

#[test] // independent truth: the same turn in four ways
fn orientations_are_stated_by_axis_and_angle_and_by_euler_angles() {
    let half = 0.5 * 0.8_f64;
    let expected = [half.cos(), 0.0, half.sin(), 0.0];
    let ways = [
        format!("euler_parameters = [{}, 0.0, {}, 0.0]", half.cos(), half.sin()),
        "axis_angle = { axis = [0.0, 3.0, 0.0], angle = 0.8 }".to_owned(),
        "yaw_pitch_roll = [0.0, 0.8, 0.0]".to_owned(),
        "euler_angles = { sequence = \"xyx\", angles = [0.0, 0.8, 0.0] }".to_owned(),
    ];
    for way in &ways {
        for initial in [false, true] {
            let (design, start) = if initial {
                (String::new(), format!("[initial.bodies.b]\n{way}\n"))
            } else {
                (way.clone(), String::new())
            };
            let text = format!(
                "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, 0.0]\n[bodies.b]\nmass = 1.0\n\
                 inertia = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]\n\
                 position = [0.0, 0.0, 0.0]\n{design}\n{start}"
            );
            near(&read(&Problem::new(model_of(&text)), "b.euler_parameters"), &expected);
        }
    }
}

#[test] // independent truth: angles by hand; a spring turns with each of them
fn drivers_begin_with_the_turns_that_they_prescribe() {
    // Of the upper body against the ground, of the lower one against the upper one.
    for (a, b) in [(5.0, 0.5), (-20.0, 0.5), (5.0, -8.0), (1.0, 40.0)] {
        for spatial in [false, true] {
            let axis = if spatial { ", axis = [0.0, 0.0, 1.0]" } else { "" };
            let rest = format!(
                r#"
[drivers]
turn = {{ joint = "top", coordinate = "rotation", motion = {a} }}
bend = {{ joint = "middle", coordinate = "rotation", motion = {b} }}
[forces]
upper_spring = {{ type = "rsda", between = ["ground", "upper"], stiffness = 2.0{axis} }}
lower_spring = {{ type = "rsda", between = ["upper", "lower"], stiffness = 2.0{axis} }}
"#
            );
            let problem = pendulum(spatial, &rest);
            near(&read(&problem, "top.angle"), &[a]);
            near(&read(&problem, "middle.angle"), &[b]);
            near(&read(&problem, "upper_spring.torque"), &[2.0 * a]);
            near(&read(&problem, "lower_spring.torque"), &[2.0 * b]);
            if !spatial {
                near(&read(&problem, "lower.angle"), &[a + b]);
            }
        }
        // What hangs on a driven body keeps its angle against it.
        let rest = format!(
            "[drivers]\nturn = {{ on = \"upper\", coordinate = \"rotation\", motion = {a} }}\n\
             [initial.joints]\nmiddle = {{ angle = 0.25 }}\n"
        );
        let problem = pendulum(false, &rest);
        near(&read(&problem, "upper.angle"), &[a]);
        near(&read(&problem, "middle.angle"), &[0.25]);
        near(&read(&problem, "lower.angle"), &[a + 0.25]);
    }
}

#[test] // independent truth: whole turns by hand
fn stated_turns_that_a_driver_does_not_make_are_refused() {
    let angle = 0.5;
    for spatial in [false, true] {
        for (driver, sign) in [
            ("joint = \"top\"", 1.0),
            ("between = [\"ground\", \"upper\"]AXIS", 1.0),
            ("between = [\"upper\", \"ground\"]AXIS", -1.0),
        ] {
            for turns in [0.0, 1.0, -2.0] {
                let stated = angle + turns * TAU;
                let rest = |assembly: &str, motion: f64| {
                    format!(
                        "[drivers]\nturn = {{ {driver}, coordinate = \"rotation\", motion = {motion} }}\n\
                         {assembly}[initial.joints]\ntop = {{ angle = {stated} }}\n"
                    )
                };
                let problem = pendulum(spatial, &rest("", sign * angle));
                if turns == 0.0 {
                    near(&read(&problem, "top.angle"), &[angle]);
                    continue;
                }
                let error = problem.assemble().expect_err("turns contradict").clone();
                assert_eq!((error.code(), error.item()), ("assembly/inconsistent", Some("top")));
                assert!(error.to_string().contains("driver `turn`"), "{error}");
                // The other way round, and where both agree.
                near(&read(&pendulum(spatial, &rest("", sign * stated)), "top.angle"), &[stated]);
                let guess = rest("[initial]\nassembly = \"adjust\"\n", sign * angle);
                near(&read(&pendulum(spatial, &guess), "top.angle"), &[angle]);
            }
        }
    }
}

#[test] // independent truth: angles by hand
fn turns_of_drivers_do_not_depend_on_their_order() {
    let line = |name: &str, of: &str, motion: f64| {
        format!("{name} = {{ {of}, coordinate = \"rotation\", motion = {motion} }}\n")
    };
    let low = line("low", "on = \"lower\"", 0.5);
    let up = line("up", "on = \"upper\"", 5.0);
    // The lower body is the first one of this driver.
    let bend = line("bend", "between = [\"lower\", \"upper\"]", 12.0);
    for [one, other] in [[&low, &up], [&up, &low], [&bend, &low], [&low, &bend], [&up, &bend]] {
        let problem = pendulum(false, &format!("[drivers]\n{one}{other}"));
        let names = [one, other].map(|line| line.split(' ').next().unwrap_or_default());
        let angles = match names {
            ["low", "up"] | ["up", "low"] => [5.0, 0.5],
            ["up", "bend"] => [5.0, -7.0],
            _ => [12.5, 0.5],
        };
        near(&read(&problem, "upper.angle"), &angles[..1]);
        near(&read(&problem, "lower.angle"), &angles[1..]);
    }
    // Stated angles that agree with a driven body that they are fixed to are not turned again.
    let fixed = PENDULUM.replace("DIMENSION", "planar").replace("GRAVITY", "[0.0, 0.0]");
    let fixed = fixed.replace("INERTIA", "0.1").replace("AXIS", "").replace("POINT(", "[");
    let fixed = fixed
        .replace(')', "]")
        .replace("middle = { type = \"revolute\"", "middle = { type = \"fixed\"");
    let rest = format!("[drivers]\n{up}[initial.bodies]\nlower = {{ angle = 5.0 }}\n");
    let problem = Problem::new(model_of(&format!("{fixed}{rest}")));
    near(&read(&problem, "upper.angle"), &[5.0]);
    near(&read(&problem, "lower.angle"), &[5.0]);
    // A stated angle is kept, beside a driven body that it hangs on.
    let rest = format!("[drivers]\n{up}[initial.bodies]\nlower = {{ angle = 0.3 }}\n");
    let problem = pendulum(false, &rest);
    near(&read(&problem, "upper.angle"), &[5.0]);
    near(&read(&problem, "lower.angle"), &[0.3]);
}

#[test] // independent truth: a run from where the driver begins within half a turn
fn a_loop_begins_as_if_its_driver_had_come_there() {
    let model = |start: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
crank = {{ mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }}
hand = {{ mass = 1.0, inertia = 1.0, position = [0.5, 0.0] }}
rod = {{ mass = 1.0, inertia = 1.0, position = [2.0, 0.0] }}
slider = {{ mass = 1.0, inertia = 1.0, position = [4.0, 0.0] }}
[joints]
shaft = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }}
pin = {{ type = "revolute", between = ["crank", "rod"], point = [1.0, 0.0] }}
head = {{ type = "revolute", between = ["rod", "slider"], point = [4.0, 0.0] }}
guide = {{ type = "translational", between = ["ground", "slider"], point = [4.0, 0.0], axis = [1.0, 0.0] }}
grip = {{ type = "fixed", between = ["crank", "hand"], point = [0.5, 0.0] }}
[drivers]
turn = {{ joint = "shaft", coordinate = "rotation", motion = {{ type = "polynomial", coefficients = [0.0, 1.0] }} }}
[forces]
spring = {{ type = "rsda", between = ["rod", "slider"], stiffness = 2.0 }}
[simulation]
start_time = {start}
"#
        ))
    };
    let names = ["crank.angle", "hand.angle", "rod.angle", "slider.angle", "spring.torque"];
    let options = Options {
        channels: names.map(str::to_owned).to_vec(),
        output: OutputTimes::Listed(vec![0.0, 4.0, 9.0]),
        ..options(DEFAULT_CODE, 1e-8, 9.0)
    };
    let whole = run_model(&model(0.0), &options);
    for (row, start) in [(1, 4.0), (2, 9.0)] {
        let problem = Problem::new(model(start));
        for name in names {
            let (found, truth) = (read(&problem, name)[0], whole.series(name, 0)[row]);
            assert!((found - truth).abs() < 1e-6, "{name} at {start} s: {found}, not {truth}");
        }
    }
}
