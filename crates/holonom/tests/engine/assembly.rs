//! Models that are well formed but cannot be assembled are refused, naming the item; stated values
//! are kept, unstated ones found, small residuals projected away.

use crate::common::model_of;
use holonom::reduction::assembly::AssemblyError;
use holonom::simulation::{Memory, Options, Problem, run};
use holonom::system::{Sample, State};

const FOUR_BAR: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
crank = { mass = 1.0, inertia = 0.1, position = [0.0, 0.5] }
coupler = { mass = 1.0, inertia = 0.1, position = [1.0, 1.0] }
rocker = { mass = 1.0, inertia = 0.1, position = [2.0, 0.5] }
[joints]
a = { type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "coupler"], point = [0.0, 1.0] }
c = { type = "revolute", between = ["coupler", "rocker"], point = [2.0, 1.0] }
"#;

fn four_bar(rest: &str) -> Problem {
    Problem::new(model_of(&format!("{FOUR_BAR}{rest}")))
}

const CLOSED: &str =
    "d = { type = \"revolute\", between = [\"ground\", \"rocker\"], point = [2.0, 0.0] }\n";

fn refusal(problem: &Problem) -> AssemblyError {
    problem.assemble().expect_err("the model cannot be assembled").clone()
}

#[test] // independent truth: in a parallelogram crank and rocker turn alike, the coupler does not turn
fn unstated_velocities_follow_from_the_joints() {
    let problem =
        four_bar(&format!("{CLOSED}[initial.bodies]\ncrank = {{ angular_velocity = 3.0 }}"));
    let assembled = problem.assemble().unwrap();
    let body = |b| problem.system().body(b, &assembled.state.q, &assembled.state.v);
    assert!((body(0).angular_velocity[2] - 3.0).abs() < 1e-12);
    assert!(body(1).angular_velocity[2].abs() < 1e-12);
    assert!((body(2).angular_velocity[2] - 3.0).abs() < 1e-12);
    assert!((body(1).velocity[0] + 3.0).abs() < 1e-12);
    assert_eq!(problem.summary(assembled).ndof, 1);
}

#[test] // independent truth: the geometry of the parallelogram
fn unstated_positions_follow_from_the_joints() {
    let angle = 0.3_f64;
    let problem = four_bar(&format!("{CLOSED}[initial.bodies]\ncrank = {{ angle = {angle} }}"));
    let assembled = problem.assemble().unwrap();
    let coupler = problem.system().body(1, &assembled.state.q, &assembled.state.v);
    assert!((coupler.position[0] - (1.0 - angle.sin())).abs() < 1e-12);
    assert!((coupler.position[1] - angle.cos()).abs() < 1e-12);
    assert!(coupler.orientation[0].abs() < 1e-12);
}

#[test]
fn a_stated_velocity_against_a_joint_is_refused() {
    let error = refusal(&four_bar(&format!(
        "{CLOSED}[initial.bodies]\ncrank = {{ velocity = [0.0, 0.4], angular_velocity = 0.0 }}"
    )));
    assert_eq!(error.code(), "assembly/inconsistent");
    assert_eq!(error.item(), Some("a"));
    assert!(error.to_string().contains("velocities"), "{error}");
}

#[test] // truth: the body is 0.5 m below the joint, from which it cannot move away
fn a_velocity_away_from_a_joint_in_space_is_told_of_that_joint() {
    for joint in [
        "type = \"spherical\"",
        "type = \"revolute\", axis = [1.0, 0.0, 0.0]",
        "type = \"universal\", axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]",
    ] {
        let problem = Problem::new(model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
bob = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.15]], position = [0.0, 0.0, -0.5] }}
[joints]
pivot = {{ {joint}, between = ["ground", "bob"], point = [0.0, 0.0, 0.0] }}
[initial.bodies]
bob = {{ velocity = [0.0, 0.0, 0.3] }}
"#
        )));
        let error = refusal(&problem);
        assert_eq!((error.code(), error.item()), ("assembly/inconsistent", Some("pivot")));
        assert!(error.to_string().contains("along z: 0.3 m/s"), "{error}");
    }
}

#[test]
fn a_stated_position_against_a_joint_is_refused_and_with_adjust_moved() {
    let stated = "[initial.bodies]\ncrank = { position = [0.1, 0.5], angle = 0.0 }";
    let error = refusal(&four_bar(&format!("{CLOSED}{stated}")));
    assert_eq!(error.code(), "assembly/inconsistent");
    assert!(error.to_string().contains("joint `a`"), "{error}");
    let adjusted =
        stated.replace("[initial.bodies]", "[initial]\nassembly = \"adjust\"\n[initial.bodies]");
    let problem = four_bar(&format!("{CLOSED}{adjusted}"));
    let assembled = problem.assemble().unwrap();
    assert_eq!(assembled.adjustments.len(), 1);
    assert_eq!(assembled.adjustments[0].item, "crank");
    assert!(assembled.adjustments[0].translation > 0.01);
}

#[test] // a residual of a nanometre is rounding in a file, not a contradiction
fn a_small_residual_is_projected_away_and_reported() {
    let stated = "[initial.bodies]\ncrank = { position = [1.0e-9, 0.5], angle = 0.0 }";
    let problem = four_bar(&format!("{CLOSED}{stated}"));
    let assembled = problem.assemble().unwrap();
    assert!((assembled.stated_residuals.0 - 1e-9).abs() < 1e-12);
    let mut phi = vec![0.0; 8];
    problem.system().position_constraints(0.0, &assembled.state.q, &mut phi);
    assert!(phi.iter().all(|x| x.abs() < 1e-14));
}

#[test] // independent truth: two links of 1 m cannot span 5 m
fn a_loop_that_cannot_close_is_refused() {
    let rod = "far = { type = \"distance\", between = [\"ground\", \"rocker\"], \
               points = [[9.0, 0.0], [2.0, 0.0]], length = 0.5 }\n";
    let error = refusal(&four_bar(rod));
    assert_eq!(error.code(), "assembly/unreachable");
    assert_eq!(error.item(), Some("far"));
    assert!(error.help().contains("assembled configuration"));
    assert!(!explains_axes(&error), "{error}: {}", error.help());
}

/// Whether the advice says what the letters of axes in the names of rows mean.
fn explains_axes(error: &AssemblyError) -> bool {
    error.help().contains("f, g and h are axes") || error.help().contains("f and g are axes")
}

#[test] // truth: a guide along x and a pin 0.1 m above it; planar frames have no third axis
fn a_guide_that_cannot_be_met_is_told_with_its_axes() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [1.0, 0.0] }
pin = { type = "revolute", between = ["ground", "block"], points_in_body = [[0.0, 0.1], [0.0, 0.0]] }
"#,
    );
    let error = refusal(&Problem::new(model));
    assert!(error.to_string().contains("translation along g"), "{error}");
    assert!(error.help().contains("f and g are axes"), "{}", error.help());
}

/// Items that a refusal names.
fn named(error: &AssemblyError) -> Vec<String> {
    let text = error.to_string();
    let mut names: Vec<String> = text.split('`').skip(1).step_by(2).map(str::to_owned).collect();
    names.sort();
    names
}

#[test] // truth: two drivers turn one crank by other angles, rates or accelerations; the joints are innocent
fn drivers_that_contradict_each_other_are_both_named() {
    let motion = |coefficients: &str| {
        format!(
            "{{ coordinate = \"rotation\", joint = \"a\", motion = {{ type = \"polynomial\", coefficients = \
             {coefficients} }} }}"
        )
    };
    for (slow, fast, code) in [
        ("[0.0]", "[0.1]", "assembly/unreachable"),
        ("[0.0, 1.0]", "[0.0, 2.0]", "assembly/contradiction"),
        ("[0.0, 1.0]", "[0.0, 1.0, 1.0]", "assembly/contradiction"),
    ] {
        let drivers = format!("[drivers]\nslow = {}\nfast = {}\n", motion(slow), motion(fast));
        // A stated velocity is not what they contradict.
        for stated in ["", "[initial.bodies]\nrocker = { angular_velocity = 1.0 }\n"] {
            let error = refusal(&four_bar(&format!("{CLOSED}{drivers}{stated}")));
            assert_eq!(error.code(), code, "{error}");
            assert_eq!(named(&error), ["fast", "slow"], "{error}");
        }
    }
    // The other way round a stated velocity contradicts drivers that agree.
    let drivers = format!("[drivers]\nslow = {0}\nfast = {0}\n", motion("[0.0, 1.0]"));
    let stated = "[initial.bodies]\ncrank = { angular_velocity = 7.0 }\n";
    let error = refusal(&four_bar(&format!("{CLOSED}{drivers}{stated}")));
    assert_eq!(error.code(), "assembly/inconsistent", "{error}");
}

#[test] // truth: one degree of freedom, which two drivers move
fn what_contradicts_is_named_however_short_its_lever_is() {
    let error = refusal(&Problem::new(model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
eccentric = { mass = 1.0, inertia = 1e-3, position = [0.0, 0.0] }
rod = { mass = 1.0, inertia = 0.1, position = [0.5, 0.005] }
slider = { mass = 1.0, inertia = 0.1, position = [1.0, 0.0] }
[joints]
bearing = { type = "revolute", between = ["ground", "eccentric"], point = [0.0, 0.0] }
pin = { type = "revolute", between = ["eccentric", "rod"], point = [0.0, 0.01] }
wrist = { type = "revolute", between = ["rod", "slider"], point = [1.0, 0.0] }
guide = { type = "translational", between = ["ground", "slider"], point = [1.0, 0.0], axis = [1.0, 0.0] }
[drivers]
turn = { joint = "bearing", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 1.0] } }
hold = { joint = "guide", coordinate = "translation", motion = { type = "constant", value = 0.0 } }
"#,
    )));
    assert_eq!(error.code(), "assembly/contradiction", "{error}");
    let named = named(&error);
    assert!(named.iter().any(|name| name == "turn"), "{error}");
    assert!(named.iter().any(|name| name == "hold"), "{error}");
}

#[test] // truth: four joints with parallel axes keep a loop in a plane; the pendulum hangs beside it
fn a_loop_in_space_that_cannot_close_names_its_joints() {
    for last in [
        "points_in_body = [[0.5, 0.1, 0.0], [0.0, 0.0, -0.15]], axis = [0.0, 1.0, 0.0]",
        "points_in_body = [[0.5, 1.1, 0.0], [0.0, 0.0, -0.15]], axis = [0.0, 1.0, 0.0]",
        "points_in_body = [[2.5, 0.0, 0.0], [0.0, 0.0, -0.15]], axis = [0.0, 1.0, 0.0]",
        "point = [0.5, 0.0, 0.0], axes_in_body = [[0.0, 1.0, 1.0], [0.0, 1.0, 0.0]]",
    ] {
        let pendulum = "pendulum = { type = \"spherical\", between = [\"coupler\", \"bob\"], point = [0.25, 0.0, \
            0.25] }\n[bodies.bob]\nmass = 1.0\ninertia = [[0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.01]]\n\
            position = [0.25, 0.0, 0.1]\n";
        let text = spatial_four_bar(last) + pendulum;
        let error = refusal(&Problem::new(model_of(&text)));
        assert_eq!(error.code(), "assembly/unreachable");
        assert_eq!(named(&error), ["a", "b", "c", "d"], "{error}");
        let text = error.to_string();
        let speaks = ["f", "g", "h"]
            .iter()
            .any(|axis| text.split([' ', ';', ':']).any(|word| word == *axis));
        assert_eq!(explains_axes(&error), speaks, "{text}: {}", error.help());
    }
}

#[test]
fn a_direction_without_mass_is_refused_and_a_held_one_is_not() {
    let text = |mass: f64, joint: &str| {
        format!(
            "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n[bodies]\n\
             ghost = {{ mass = {mass:?}, inertia = 0.0, position = [0.0, 0.0] }}\n[joints]\n{joint}"
        )
    };
    let free = Problem::new(model_of(&text(0.0, "")));
    let error = refusal(&free);
    assert_eq!((error.code(), error.item()), ("assembly/singular-mass", Some("ghost")));
    assert!(error.to_string().contains("ghost."), "{error}");
    // A point mass may not spin freely, but on a pin away from its centre it has inertia.
    let spinning =
        "pin = { type = \"revolute\", between = [\"ground\", \"ghost\"], point = [0.0, 0.0] }";
    let error = refusal(&Problem::new(model_of(&text(1.0, spinning))));
    assert!(error.to_string().contains("ghost.angle"), "{error}");
    let swinging =
        "pin = { type = \"revolute\", between = [\"ground\", \"ghost\"], point = [1.0, 0.0] }";
    assert!(Problem::new(model_of(&text(1.0, swinging))).assemble().is_ok());
}

#[test] // independent truth: free fall; the block is the same a rounding further to the side
fn a_joint_that_misses_a_centre_of_mass_by_round_off_changes_nothing() {
    for missed in [0.0, 5.6e-17, 1e-13] {
        let model = model_of(&format!(
            "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n[bodies]\n\
             block = {{ mass = 2.0, inertia = 0.5, position = [0.3, 0.0] }}\n[joints]\n\
             guide = {{ type = \"translational\", between = [\"ground\", \"block\"], \
             point = [{:?}, 0.0], axis = [0.0, 1.0] }}",
            0.3 + missed
        ));
        assert_eq!(missed == 0.0, model.joints[0].frames[1].point == [0.0; 3]);
        assert_eq!(model.characteristic_length(), 0.5, "the radius of gyration, m");
        let problem = Problem::new(model);
        let mut rows = Memory::default();
        let summary = run(&problem, &Options::new(1.0), None, &mut rows).unwrap();
        assert!((summary.end.q[1] + 0.5 * 9.81).abs() < 1e-9, "{missed:e}: {:?}", summary.end.q);
    }
}

#[test] // independent truth: the reaction forces of a door on two hinges, worked out by hand
fn reactions_of_redundant_joints_are_those_of_minimum_norm() {
    // A door of 2 kg on two vertical revolute hinges at z = ±0.5, its centre 0.4 m from their axis:
    // five of ten rows are redundant. Weight is carried half by each hinge; the moment about y by a
    // couple of horizontal forces and torques, the shortest combination.
    let problem = Problem::new(model_of(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -10.0]
[bodies.door]
mass = 2.0
inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]
position = [0.4, 0.0, 0.0]
[joints]
low = { type = "revolute", between = ["ground", "door"], point = [0.0, 0.0, -0.5], axis = [0.0, 0.0, 1.0] }
high = { type = "revolute", between = ["ground", "door"], point = [0.0, 0.0, 0.5], axis = [0.0, 0.0, 1.0] }
"#,
    ));
    let assembled = problem.assemble().unwrap();
    let summary = problem.summary(assembled);
    assert_eq!((summary.ndof, summary.redundant.len()), (1, 5));
    // Each is named by joint and axis, and the axes of the frames are those of the ground or along z.
    for row in &summary.redundant {
        assert!(["low", "high"].contains(&row.item.as_str()), "{row:?}");
        let ground = row.direction.contains("the ground's") && row.row.contains("along");
        let turned =
            row.direction.contains("of its frame, [") && row.row.starts_with("rotation about");
        assert!(ground || turned, "{row:?}");
    }
    let mut rows = Memory::default();
    let run = run(&problem, &Options::new(0.1), None, &mut rows).unwrap();
    let warning = run.warnings.iter().find(|w| w.code == "simulation/redundant").unwrap();
    for row in &summary.redundant {
        let name = format!("`{}`, {}", row.item, row.row);
        assert!(warning.message.contains(&name), "{name}: {}", warning.message);
    }
    let mut manifold = assembled.manifold();
    let mut state = assembled.state.clone();
    manifold.minimum_norm_multipliers(&mut state.lambda);
    let read = |name: &str| {
        let channel = problem.channels().iter().find(|c| c.name == name).unwrap().clone();
        let mut out = vec![0.0; channel.size()];
        problem.system().channel(&channel, &Sample::new(&state), &mut out);
        out
    };
    let (low, high) = (read("low.force"), read("high.force"));
    let (turn_low, turn_high) = (read("low.torque"), read("high.torque"));
    assert!((low[2] - 10.0).abs() < 1e-9 && (high[2] - 10.0).abs() < 1e-9);
    // A couple of forces ±F at 1 m distance and two torques T balance m g · 0.4 m = 8 N m about y:
    // F + 2T = 8. The shortest (F, F, T, T) has T = 2F, so F = 1.6 N and T = 3.2 N m.
    assert!((low[0] + high[0]).abs() < 1e-9);
    assert!((low[0].abs() - 1.6).abs() < 1e-6, "{low:?} {turn_low:?}");
    assert!((turn_low[1] - turn_high[1]).abs() < 1e-9);
    assert!((turn_low[1].abs() - 3.2).abs() < 1e-6, "{turn_low:?}");
}

/// A four-bar in space whose last joint has this point or axis.
fn spatial_four_bar(last: &str) -> String {
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
crank = {{ mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]], position = [0.0, 0.0, 0.1] }}
coupler = {{ mass = 2.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.05, 0.0], [0.0, 0.0, 0.05]], position = [0.25, 0.0, 0.25] }}
rocker = {{ mass = 1.0, inertia = [[0.02, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.01]], position = [0.5, 0.0, 0.15] }}
[joints]
a = {{ type = "revolute", between = ["ground", "crank"], point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }}
b = {{ type = "revolute", between = ["crank", "coupler"], point = [0.0, 0.0, 0.2], axis = [0.0, 1.0, 0.0] }}
c = {{ type = "revolute", between = ["coupler", "rocker"], point = [0.5, 0.0, 0.3], axis = [0.0, 1.0, 0.0] }}
d = {{ type = "revolute", between = ["ground", "rocker"], {last} }}
"#
    )
}

fn warned(last: &str) -> Vec<&'static str> {
    let problem = Problem::new(model_of(&spatial_four_bar(last)));
    let summary = run(&problem, &Options::new(0.1), None, &mut Memory::default()).unwrap();
    summary.warnings.iter().map(|w| w.code).collect()
}

#[test] // truth: parallel axes move, others do not; what redundant rows contradict each other by is left
fn what_is_a_little_off_is_said() {
    let exact = "point = [0.5, 0.0, 0.0], axis = [0.0, 1.0, 0.0]";
    assert_eq!(warned(exact), ["simulation/redundant"]);
    let tilted = "point = [0.5, 0.0, 0.0], axis = [0.0, 1.0, 0.001]";
    assert_eq!(warned(tilted), ["simulation/redundant", "simulation/immobile"]);
    let beside = "points_in_body = [[0.5, 1.0e-8, 0.0], [0.0, 0.0, -0.15]], axis = [0.0, 1.0, 0.0]";
    assert_eq!(warned(beside), ["simulation/redundant", "simulation/contradiction"]);
}

#[test] // truth: the driver and the joint agree at any distance
fn a_driver_far_from_the_design_is_met() {
    for far in [10.0, 5000.0] {
        let text = format!(
            "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\n\
             car = {{ mass = 4.0, inertia = 1.0, position = [0.0, 0.0] }}\n[joints]\n\
             shaft = {{ type = \"translational\", between = [\"ground\", \"car\"], point = [0.0, 0.0], \
             axis = [0.0, 1.0] }}\n[drivers]\n\
             lift = {{ joint = \"shaft\", coordinate = \"translation\", motion = {{ type = \"smooth_step\", \
             from = {far:?}, to = 0.0, start = 0.0, end = 20.0 }} }}\n"
        );
        let problem = Problem::new(model_of(&text));
        let height = problem.assemble().expect("it can be met").state.q[1];
        assert!((height - far).abs() < 1e-9 * far, "{height} m");
    }
}

/// Drivers of x and y of a point of `on` to `shift` from its place in the design, and of its angle.
fn carried(on: &str, point: [f64; 2], shift: [f64; 2], angle: f64) -> String {
    let slide = |name: &str, axis: &str, by: f64| {
        format!(
            "{name} = {{ on = \"{on}\", coordinate = \"translation\", point = {point:?}, axis = {axis}, motion = \
             {by:?} }}\n"
        )
    };
    format!(
        "[drivers]\n{}{}angle = {{ on = \"{on}\", coordinate = \"rotation\", motion = {angle:?} }}\n",
        slide("x", "[1.0, 0.0]", shift[0]),
        slide("y", "[0.0, 1.0]", shift[1])
    )
}

/// v turned by an angle.
fn turned(angle: f64, [x, y]: [f64; 2]) -> [f64; 2] {
    let (sin, cos) = angle.sin_cos();
    [cos * x - sin * y, sin * x + cos * y]
}

/// Where an origin is that stands at zero in the design and whose body is [`carried`].
fn origin(point: [f64; 2], shift: [f64; 2], angle: f64) -> [f64; 2] {
    let arm = turned(angle, point);
    [0, 1].map(|k| point[k] + shift[k] - arm[k])
}

/// Angles up to some ten turns on either side.
fn angles() -> impl Iterator<Item = f64> {
    (-20..=20).map(|k| 3.0 * f64::from(k))
}

#[track_caller]
fn assert_near(found: [f64; 3], wanted: [f64; 3], allowed: f64, what: &str) {
    let off = found.iter().zip(wanted).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
    assert!(off <= allowed, "{what}: {found:?} for {wanted:?}");
}

#[test] // truth: x, y and the angle of a body are independent, its pose is a formula
fn a_body_is_carried_to_any_pose() {
    for unit in [1e-3, 1.0, 1e3] {
        for point in [[0.5, 0.0], [-3.0, 40.0]] {
            for far in [0.0, 1.0, 10.0, 100.0, 1e3, 1e6] {
                for angle in angles() {
                    let point = point.map(|x| unit * x);
                    let shift = [unit * far, -0.3 * unit * far];
                    let drivers = carried("b", point, shift, angle);
                    let text = format!(
                        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\nb = {{ mass = 1.0, \
                         inertia = {:?}, position = [0.0, 0.0] }}\n{drivers}",
                        unit * unit
                    );
                    let what = format!("{point:?} by {shift:?} and {angle}");
                    let problem = Problem::new(model_of(&text));
                    let assembled = problem.assemble().unwrap_or_else(|e| panic!("{what}: {e}"));
                    let q = &assembled.state.q;
                    let [x, y] = origin(point, shift, angle);
                    let size = unit * (far + 50.0);
                    assert_near([q[0], q[1], 0.0], [x, y, 0.0], 1e-12 * size, &what);
                    assert!((q[2].sin() - angle.sin()).abs() < 1e-11, "{what}");
                    assert!((q[2].cos() - angle.cos()).abs() < 1e-11, "{what}");
                }
            }
        }
    }
}

#[test] // truth: a parallelogram on a frame that is carried; what is pinned at its coupler keeps its distance
fn a_loop_and_a_chain_are_carried_along() {
    let rest = r#"
[bodies]
frame = { mass = 1.0, inertia = 0.1, position = [0.0, 0.0] }
crank = { mass = 1.0, inertia = 0.1, position = [0.0, 0.5] }
coupler = { mass = 1.0, inertia = 0.1, position = [1.0, 1.0] }
rocker = { mass = 1.0, inertia = 0.1, position = [2.0, 0.5] }
bob = { mass = 1.0, inertia = 0.1, position = [1.0, 0.6] }
last = { mass = 1.0, inertia = 0.1, position = [1.0, 0.1] }
[joints]
a = { type = "revolute", between = ["frame", "crank"], point = [0.0, 0.0] }
b = { type = "revolute", between = ["crank", "coupler"], point = [0.0, 1.0] }
c = { type = "revolute", between = ["coupler", "rocker"], point = [2.0, 1.0] }
d = { type = "revolute", between = ["frame", "rocker"], point = [2.0, 0.0] }
e = { type = "revolute", between = ["coupler", "bob"], point = [1.0, 1.0] }
f = { type = "revolute", between = ["bob", "last"], point = [1.0, 0.2] }
"#;
    let (point, crank) = ([0.5, 0.2], 0.4);
    for far in [0.0, 10.0, 1e3] {
        for angle in angles() {
            let shift = [far, 0.7 * far];
            let text = format!(
                "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n{rest}{}turn = {{ joint = \"a\", \
                 coordinate = \"rotation\", motion = {crank:?} }}\n",
                carried("frame", point, shift, angle)
            );
            let problem = Problem::new(model_of(&text));
            let what = format!("{shift:?} and {angle}");
            let assembled = problem.assemble().unwrap_or_else(|e| panic!("{what}: {e}"));
            let at = |b: usize| problem.system().body(b, &assembled.state.q, &assembled.state.v);
            let start = origin(point, shift, angle);
            let pin = turned(angle + crank, [0.0, 1.0]);
            let middle = turned(angle, [1.0, 0.0]);
            let coupler = [0, 1].map(|k| start[k] + pin[k] + middle[k]);
            let allowed = 1e-12 * (far + 50.0);
            assert_near(at(0).position, [start[0], start[1], 0.0], allowed, &what);
            assert_near(at(2).position, [coupler[0], coupler[1], 0.0], allowed, &what);
            let bob = at(4).position;
            let length = (bob[0] - coupler[0]).hypot(bob[1] - coupler[1]);
            assert!((length - 0.4).abs() < allowed, "{what}: {length} m");
            let last = at(5).position;
            let hinge = [0, 1].map(|k| coupler[k] + 2.0 * (bob[k] - coupler[k]));
            let length = (last[0] - hinge[0]).hypot(last[1] - hinge[1]);
            assert!((length - 0.1).abs() < allowed, "{what}: {length} m");
        }
    }
}

#[test] // truth: a screw-like motion along and about z, with an arm welded on that turns another one about its own axis
fn bodies_in_space_are_carried_to_any_pose() {
    let inertia = "mass = 1.0\ninertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]";
    for far in [0.0, 1.0, 10.0, 100.0, 1e3, 1e5] {
        for angle in angles() {
            let own = 0.5 * angle;
            let text = format!(
                r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.lift]
{inertia}
position = [0.5, 0.0, 0.0]
[bodies.arm]
{inertia}
position = [1.0, 0.0, 0.0]
[bodies.hand]
{inertia}
position = [2.0, 0.0, 0.3]
[bodies.ball]
{inertia}
position = [2.0, 0.5, 0.3]
[joints]
screw = {{ type = "cylindrical", between = ["ground", "lift"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
weld = {{ type = "fixed", between = ["lift", "arm"], point = [0.7, 0.0, 0.0] }}
wrist = {{ type = "revolute", between = ["arm", "hand"], point = [2.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
hang = {{ type = "spherical", between = ["hand", "ball"], point = [2.0, 0.0, 0.3] }}
[drivers]
up = {{ joint = "screw", coordinate = "translation", motion = {far:?} }}
around = {{ joint = "screw", coordinate = "rotation", motion = {angle:?} }}
own = {{ joint = "wrist", coordinate = "rotation", motion = {own:?} }}
"#
            );
            let problem = Problem::new(model_of(&text));
            let what = format!("{far} m, {angle} rad");
            let assembled = problem.assemble().unwrap_or_else(|e| panic!("{what}: {e}"));
            let at = |b: usize| {
                problem.system().body(b, &assembled.state.q, &assembled.state.v).position
            };
            let allowed = 1e-12 * (far + 50.0);
            let [x, y] = turned(angle, [1.0, 0.0]);
            assert_near(at(0), [0.5 * x, 0.5 * y, far], allowed, &what);
            assert_near(at(1), [x, y, far], allowed, &what);
            let [side, up] = turned(own, [0.0, 0.3]);
            let [x, y] = turned(angle, [2.0, side]);
            let hand = [x, y, far + up];
            assert_near(at(2), hand, allowed, &what);
            let arm = at(3).iter().zip(hand).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
            assert!((arm - 0.5).abs() < allowed, "{what}: {arm} m");
        }
    }
}

#[test] // truth: a point at two rods stands where two circles meet, from wherever it starts
fn rods_are_met_from_far_and_near() {
    for place in [[300.0, 200.0], [-5000.0, 10.0], [0.3, 1e-3], [1e-6, -1e-6], [0.5, 0.5]] {
        let [x, y] = place;
        let rod = |name: &str, ground: &str, length: f64| {
            format!(
                "{name} = {{ type = \"distance\", between = [\"ground\", \"b\"], points = [{ground}, {place:?}], length \
                 = {length:?} }}\n"
            )
        };
        let text = format!(
            "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, 0.0]\n[bodies]\nb = {{ mass = 1.0, inertia = 0.1, \
             position = [{x:?}, {y:?}] }}\n[joints]\n{}{}",
            rod("one", "[0.0, 0.0]", 0.8),
            rod("two", "[1.0, 0.0]", 0.6)
        );
        let problem = Problem::new(model_of(&text));
        let assembled = problem.assemble().unwrap_or_else(|e| panic!("{place:?}: {e}"));
        let q = &assembled.state.q;
        assert_near([q[0], q[1].abs(), 0.0], [0.64, 0.48, 0.0], 1e-12, &format!("{place:?}"));
        // The nearer one.
        assert!(q[1] * y > 0.0, "{q:?} from {place:?}");
    }
}

/// A chain of links of 1 m whose angles are driven, from link to link or against the ground.
fn driven_chain(spatial: bool, of_joints: bool, angles: &[f64]) -> String {
    let (dimension, inertia, zero, axis) = if spatial {
        let inertia = "[[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]]";
        ("spatial", inertia, ", 0.0", "axis = [0.0, 0.0, 1.0], ")
    } else {
        ("planar", "0.1", "", "")
    };
    let [mut bodies, mut joints, mut drivers] =
        ["bodies", "joints", "drivers"].map(|table| vec![format!("[{table}]")]);
    for (k, angle) in angles.iter().enumerate() {
        let (start, middle) = (k as f64, k as f64 + 0.5);
        let before = k.checked_sub(1).map_or("ground".to_owned(), |k| format!("b{k}"));
        let driven =
            if of_joints { format!("joint = \"j{k}\"") } else { format!("{axis}on = \"b{k}\"") };
        bodies.push(format!(
            "b{k} = {{ mass = 1.0, inertia = {inertia}, position = [{middle:?}, 0.0{zero}] }}"
        ));
        joints.push(format!(
            "j{k} = {{ type = \"revolute\", {axis}between = [\"{before}\", \"b{k}\"], point = [{start:?}, \
             0.0{zero}] }}"
        ));
        drivers
            .push(format!("d{k} = {{ {driven}, coordinate = \"rotation\", motion = {angle:?} }}"));
    }
    let [bodies, joints, drivers] = [bodies, joints, drivers].map(|lines| lines.join("\n"));
    format!(
        "holonom = 1\ndimension = \"{dimension}\"\ngravity = [0.0, 0.0{zero}]\n{bodies}\n{joints}\n{drivers}\n"
    )
}

#[test] // truth: the links of a chain, placed one after the other by the angles of their drivers
fn a_chain_with_every_joint_driven_is_met_at_any_angles() {
    // Multiples of the golden section: as good as random, and the same everywhere.
    let angle =
        |k: usize, most: f64| most * (2.0 * (0.618_033_988_749_894_9 * k as f64).fract() - 1.0);
    for (spatial, of_joints) in [(false, true), (false, false), (true, true), (true, false)] {
        for (links, most) in
            [(3_usize, 3.0), (6, 1.5), (6, 10.0), (12, 3.0), (60, 0.03), (200, 0.03)]
        {
            if spatial && links > 12 {
                continue;
            }
            let angles: Vec<f64> = (1..=links).map(|k| angle(k, most)).collect();
            let text = driven_chain(spatial, of_joints, &angles);
            let what = format!("{links} links, {most} rad, {spatial}, of joints: {of_joints}");
            let problem = Problem::new(model_of(&text));
            let assembled = problem.assemble().unwrap_or_else(|e| panic!("{what}: {e}"));
            let State { q, v, .. } = &assembled.state;
            let (mut heading, mut end) = (0.0, [0.0, 0.0]);
            for (k, own) in angles.iter().enumerate() {
                heading = if of_joints { heading + own } else { *own };
                let arm = turned(heading, [0.5, 0.0]);
                let place = [end[0] + arm[0], end[1] + arm[1]];
                let pose = problem.system().body(k, q, v);
                assert_near(pose.position, [place[0], place[1], 0.0], 1e-9, &what);
                if !spatial {
                    let found = pose.orientation[0];
                    assert!((found - heading).abs() < 1e-9, "{what}: {found} for {heading} rad");
                }
                end = [place[0] + arm[0], place[1] + arm[1]];
            }
        }
    }
}

#[test] // truth: 2 − 1 m/s, whatever else contradicts itself elsewhere
fn velocities_that_contradict_each_other_differ_by_all_of_their_difference() {
    let text = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
a = { mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }
b = { mass = 1.0, inertia = 1.0, position = [5.0, 0.0] }
[joints]
ga = { type = "translational", between = ["ground", "a"], point = [0.0, 0.0], axis = [1.0, 0.0] }
gb = { type = "translational", between = ["ground", "b"], point = [5.0, 0.0], axis = [1.0, 0.0] }
[drivers]
a1 = { joint = "ga", coordinate = "translation", motion = { type = "polynomial", coefficients = [0.0, 1.0] } }
a2 = { joint = "ga", coordinate = "translation", motion = { type = "polynomial", coefficients = [0.0, 2.0] } }
b1 = { joint = "gb", coordinate = "translation", motion = { type = "polynomial", coefficients = [0.0, 1.0] } }
b2 = { joint = "gb", coordinate = "translation", motion = { type = "polynomial", coefficients = [0.0, 1.75] } }
"#;
    let error = Problem::new(model_of(text)).assemble().unwrap_err().to_string();
    assert!(error.contains("at velocity level they differ by 1 m/s"), "{error}");
}
