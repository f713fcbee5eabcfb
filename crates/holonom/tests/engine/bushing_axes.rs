//! Along which body's axes the deformations of bushings are variables, and what that is worth.

use crate::common::table::{Bounds, Case, DEFAULT, Table, implicit, line, measure};
use crate::common::{model_of, options};
use crate::random::numbers::{M3, Random, apply, euler_parameters, product, transpose};
use crate::stiff_systems::Motion::Turning;
use crate::stiff_systems::{Stiffness, hinge as stiff_hinge};
use holonom::method::Code;
use holonom::model::{ForceKind, Frame, InitialBody, Model, Orientation};
use holonom::reduction::Coordinates;
use holonom::simulation::{Memory, Options, Problem, Status, run};
use holonom::system::compile;
use std::fmt::Write as _;

/// A bushing between two bodies: its place and its laws.
#[derive(Clone)]
struct Stated {
    between: [&'static str; 2],
    point: [f64; 3],
    laws: String,
}

impl Stated {
    /// By its stiffness along its axes and about them, and dampers like springs.
    fn of(between: [&'static str; 2], point: [f64; 3], along: [f64; 3], around: [f64; 3]) -> Self {
        let damping = along.map(|k| 0.01 * k);
        let laws = format!(
            "stiffness = {along:?}, damping = {damping:?}, rotational_stiffness = {around:?}"
        );
        Self { between, point, laws }
    }

    fn with(mut self, field: &str) -> Self {
        self.laws += ", ";
        self.laws += field;
        self
    }

    /// By the matrix of springs whose centre is at `arm` from the point and resist displacements alike, in all directions.
    fn off_centre(between: [&'static str; 2], arm: [f64; 3], k: f64, around: [f64; 3]) -> Self {
        let [x, y, z] = arm;
        let moved = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]];
        let mut matrix = [[0.0; 6]; 6];
        for i in 0..3 {
            matrix[i][i] = k;
            matrix[3 + i][3 + i] = around[i];
            for j in 0..3 {
                (matrix[i][3 + j], matrix[3 + j][i]) = (k * moved[i][j], k * moved[i][j]);
                for row in moved {
                    matrix[3 + i][3 + j] += k * row[i] * row[j];
                }
            }
        }
        Self { between, point: [0.0; 3], laws: format!("stiffness_matrix = {matrix:?}") }
    }
}

/// Bodies that joints and bushings hold; numbers in `units` of length and mass.
fn model(bodies: &str, joints: &str, bushings: &[Stated], [length, mass]: [&str; 2]) -> Model {
    let mut text = format!(
        "holonom = 1\ndimension = \"spatial\"\nunits = {{ length = {length:?}, mass = {mass:?} }}\n\
         [bodies]\n{bodies}\n[joints]\n{joints}\n[forces]\n"
    );
    for (k, Stated { between, point, laws }) in bushings.iter().enumerate() {
        let _ = writeln!(
            text,
            "b{k} = {{ type = \"bushing\", between = {between:?}, point = {point:?}, {laws} }}"
        );
    }
    model_of(&text)
}

/// The body along whose axes each bushing is measured.
fn carriers(model: &Model) -> Vec<String> {
    let system = compile(model);
    let tree = system.tree();
    let groups = tree.elastic.iter().map(|elastic| elastic.groups[0]);
    groups
        .map(|group| {
            let body = system.relative_groups()[group].bodies[0];
            body.map_or("ground".to_owned(), |b| model.bodies[b].name.clone())
        })
        .collect()
}

/// A body with its centre of mass at x.
fn body(name: &str, x: f64, mass: f64) -> String {
    format!(
        "{name} = {{ mass = {mass:?}, inertia = [[{:?}, 0.0, 0.0], [0.0, {:?}, 0.0], [0.0, 0.0, {:?}]], \
         position = [{x:?}, 0.0, 0.1] }}\n",
        0.02 * mass,
        0.05 * mass,
        0.06 * mass
    )
}

/// The same machine turned in space, its bodies with other axes.
fn turned(model: &Model, random: &mut Random) -> Model {
    let mut out = model.clone();
    let whole = random.rotation(false);
    let axes: Vec<M3> = model.bodies.iter().map(|_| random.rotation(false)).collect();
    // From the axes of before, which are those of the ground.
    let into = |body: Option<usize>| body.map_or(whole, |b| product(&transpose(&axes[b]), &whole));
    out.gravity = apply(&whole, &model.gravity);
    for (b, body) in out.bodies.iter_mut().enumerate() {
        let own = into(Some(b));
        body.position = apply(&whole, &body.position);
        body.orientation = Orientation::EulerParameters(euler_parameters(&axes[b]));
        body.inertia = product(&product(&own, &body.inertia), &transpose(&own));
        body.center_of_mass = apply(&own, &body.center_of_mass);
    }
    let frame = |frame: &mut Frame| {
        let own = into(frame.body);
        frame.point = apply(&own, &frame.point);
        frame.axes = product(&own, &frame.axes);
    };
    out.joints.iter_mut().flat_map(|joint| &mut joint.frames).for_each(frame);
    for force in &mut out.forces {
        let ForceKind::Bushing { frames, .. } = &mut force.kind else { panic!() };
        frames.iter_mut().for_each(frame);
    }
    out
}

const NONE: [f64; 3] = [0.0; 3];
const TOP: [f64; 3] = [0.0, 0.0, 0.4];

/// Two bushings about a vertical axis.
fn hinge(between: [&'static str; 2], stiffness: [f64; 3]) -> Vec<Stated> {
    [NONE, TOP].map(|point| Stated::of(between, point, stiffness, NONE)).into()
}

#[test] // independent truth: by hand, where the load of the bushing rests in the long run
fn bushings_are_measured_where_their_load_rests() {
    const FIRST: &str = "the first body";
    const ALL: [f64; 3] = [1e6; 3];
    let ground = ["ground", "arm"];
    let (arm, rotor) = (body("arm", 0.3, 1.0), body("arm", 0.0, 1.0));
    let one = |along, around| vec![Stated::of(ground, NONE, along, around)];
    let each = |bushings: Vec<Stated>, field: &str| -> Vec<Stated> {
        bushings.into_iter().map(|bushing| bushing.with(field)).collect()
    };
    let upon = |x: f64| body("platform", -0.2, 100.0) + &body("arm", x, 1.0);
    let rods = body("platform", -0.3, 1.0) + &body("arm", 0.3, 1.0);
    let mut platform = hinge(["platform", "arm"], ALL);
    platform.push(Stated::of(["ground", "platform"], [-0.2, 0.0, 0.1], ALL, [1e5; 3]));
    let [carried_arm, carried_rotor] = [upon(0.3), upon(0.0)];
    let with_bracket = |mass| body("platform", -0.1, mass) + &arm;
    let [bracket, heavy_bracket] = [with_bracket(0.01), with_bracket(1000.0)];
    let welded = "weld = { type = \"fixed\", between = [\"ground\", \"platform\"], point = [0.0, 0.0, 0.0] }";
    let slides = "slide = { type = \"translational\", between = [\"ground\", \"platform\"], \
                  point = [0.0, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }";
    let payload = rotor.clone() + &body("payload", 0.2, 5.0);
    let carries =
        "weld = { type = \"fixed\", between = [\"arm\", \"payload\"], point = [0.0, 0.0, 0.0] }";
    let unlike = [1e6, 3e5, 1e6];
    let slightly = [1e6, 9e5, 1e6];
    let viscous = |damping: [f64; 3]| {
        let laws = format!("damping = {damping:?}");
        [NONE, TOP].map(|point| Stated { between: ground, point, laws: laws.clone() }).to_vec()
    };
    let off_centre = |arm| vec![Stated::off_centre(ground, arm, 1e6, [1e5, 1e5, 0.0])];
    let branch = "branches.b = { stiffness = [2e6, 1e6, 1e6], damping = [2e4, 1e4, 1e4] }";
    let tiny = "rotational_damping = [1e-9, 0.0, 0.0]";
    let oblique = "axes = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]";
    let cases: Vec<(&str, &str, &str, Vec<Stated>, &str)> = vec![
        ("an arm swings", &arm, "", hinge(ground, ALL), "arm"),
        ("softer along the axis of its turns", &arm, "", hinge(ground, [1e6, 1e6, 1e4]), "arm"),
        (
            "much softer across it: the law turns with its axes",
            &arm,
            "",
            hinge(ground, unlike),
            FIRST,
        ),
        ("a little softer", &arm, "", hinge(ground, slightly), "arm"),
        ("oblique axes", &arm, "", each(hinge(ground, slightly), oblique), "arm"),
        ("what is small beside the rest", &arm, "", each(hinge(ground, ALL), tiny), "arm"),
        ("a stiff branch that is unlike", &arm, "", each(hinge(ground, ALL), branch), FIRST),
        ("dampers alone", &arm, "", viscous([1e4; 3]), "arm"),
        ("dampers that are unlike", &arm, "", viscous([1e4, 2e3, 1e4]), FIRST),
        ("a balanced rotor bears its weight", &rotor, "", hinge(ground, ALL), "ground"),
        ("one bushing that is a hinge", &arm, "", one(ALL, [1e5, 1e5, 0.0]), "arm"),
        ("of which rotations are unlike about it", &arm, "", one(ALL, [3e5, 0.0, 1e3]), FIRST),
        ("stated elsewhere on its axis", &arm, "", off_centre([0.0, 0.0, 0.3]), "arm"),
        ("beside its axis, where it turns", &rotor, "", off_centre([0.0, 0.2, 0.0]), FIRST),
        ("a ball", &arm, "", one(ALL, NONE), "arm"),
        ("a ball that is softer along one axis", &arm, "", one([1e6, 1e6, 1e4], NONE), FIRST),
        ("what is on a heavy platform swings", &carried_arm, "", platform.clone(), "arm"),
        ("a balanced rotor on it", &carried_rotor, "", platform, "platform"),
        (
            "a dumbbell: the order of the forest",
            &rods,
            "",
            hinge(["platform", "arm"], ALL),
            "platform",
        ),
        ("a light bracket on the ground", &bracket, welded, hinge(["platform", "arm"], ALL), "arm"),
        ("a heavy one", &heavy_bracket, welded, hinge(["platform", "arm"], ALL), "arm"),
        ("one that slides on the ground", &bracket, slides, hinge(["platform", "arm"], ALL), "arm"),
        ("a hub with a payload", &payload, carries, hinge(ground, ALL), "arm"),
    ];
    let mut random = Random::new(3);
    for (name, bodies, joints, bushings, expected) in cases {
        let mut reversed = bushings.clone();
        reversed.iter_mut().for_each(|bushing| bushing.between.reverse());
        for bushings in [bushings, reversed] {
            let expected = if expected == FIRST { bushings[0].between[0] } else { expected };
            for units in [["m", "kg"], ["mm", "t"], ["m", "g"]] {
                let stated = model(bodies, joints, &bushings, units);
                for model in [turned(&stated, &mut random), stated] {
                    let found = carriers(&model);
                    let hung = bushings.iter().zip(&found);
                    for (bushing, found) in hung.filter(|(b, _)| b.between.contains(&"arm")) {
                        let between = bushing.between;
                        assert_eq!(found, expected, "{name}: {between:?} in units of {units:?}");
                    }
                }
            }
        }
    }
}

#[test] // independent truth: Lagrange's equations in six coordinates, Radau IIA
fn a_turning_hinge_is_exact_in_either_order_of_its_bodies() {
    let mut table = Table::new("a turning hinge of bushings in either order of its bodies");
    // Without dampers the order of the bodies is no matter of physics.
    let cases: Vec<[Case; 2]> = [1e4, 1e5, 1e8]
        .map(|k| {
            let stated = stiff_hinge(&Stiffness { k, seconds: 0.0, on: true }, Turning);
            let mut reversed = stated.clone();
            for force in &mut reversed.model.forces {
                let ForceKind::Bushing { frames, .. } = &mut force.kind else { panic!() };
                frames.reverse();
            }
            [stated, reversed]
        })
        .into();
    for code in implicit() {
        for tolerance in [1e-3, 1e-5] {
            let line = format!("{} {tolerance:.0e}", line("hinge", DEFAULT, code));
            for (cases, k) in cases.iter().zip(["1e4", "1e5", "1e8"]) {
                // Along axes of the ground SDIRK codes were up to 80 tolerances off, in up to four times the steps.
                let bounds = Bounds { position: 3.0, velocity: 10.0, ..Bounds::usual() };
                let [stated, reversed] =
                    cases.each_ref().map(|case| measure(case, DEFAULT, code, tolerance));
                table.run(&line, k, &stated, bounds);
                table.run(&line, &format!("{k} reversed"), &reversed, bounds);
                // Forces differ in their last bits.
                table.claim(stated.steps.abs_diff(reversed.steps) <= 2, || {
                    format!("{line}: {} steps, reversed {}", stated.steps, reversed.steps)
                });
            }
        }
    }
    table.finish();
}

#[test] // independent truth: the model read anew
fn numbers_that_change_the_axes_make_another_system() {
    let of = |x, mass: f64, across| {
        let bodies = body("arm", x, 1.0) + &body("platform", -0.2, mass);
        let mut bushings = hinge(["platform", "arm"], [1e6, across, 1e6]);
        bushings.push(Stated::of(["ground", "platform"], NONE, [1e6; 3], [1e5; 3]));
        let mut model = model(&bodies, "", &bushings, ["m", "kg"]);
        let start = InitialBody {
            velocity: Some([0.0, 20.0 * x, 0.0]),
            angular_velocity: Some([0.0, 0.0, 20.0]),
            ..InitialBody::default()
        };
        model.initial.bodies = vec![start, InitialBody::default()];
        model
    };
    let swings = (0.3, 100.0, 1e6);
    let others =
        [("a law", (0.3, 100.0, 3e5)), ("a place", (0.0, 100.0, 1e6)), ("a mass", (0.3, 0.5, 1e6))];
    for coordinates in [Coordinates::Cartesian, Coordinates::Joint] {
        let options = Options { coordinates, ..options(Code::ForRadau, 1e-6, 0.2) };
        let end = |problem: &Problem| {
            let start = problem.assemble().unwrap().state.v.clone();
            let summary = run(problem, &options, None, &mut Memory::default()).unwrap();
            assert_eq!(summary.status, Status::Completed, "{:?}", summary.stop);
            (start, summary.statistics.steps, summary.end)
        };
        for (what, other) in others {
            for [from, to] in [[swings, other], [other, swings]] {
                let [from, to] = [from, to].map(|(x, mass, across)| of(x, mass, across));
                assert_ne!(carriers(&from), carriers(&to), "{what}");
                let changed = Problem::new(from).with_model(to.clone());
                assert_eq!(end(&changed), end(&Problem::new(to)), "{what} {coordinates:?}");
            }
        }
    }
}
