//! Heavy bodies that hang on light ones, which are held by forces alone: M̂ is small along a direction that turns.

use crate::common::table::all_codes;
use crate::common::{model_of, options, run_model};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::reduction::{Coordinates, ParametrizationKind};
use holonom::simulation::{Options, OutputTimes};

/// Codes that iterate, or solve with a matrix.
fn implicit() -> impl Iterator<Item = Code> {
    all_codes().into_iter().filter(|code| !code.is_explicit())
}

/// A body of `heavy` kg on a ball joint on one of `light` kg, which a bushing holds.
fn pair([heavy, light]: [f64; 2], bushing: &str) -> String {
    let (h, l) = (0.3 * heavy, 0.3 * light);
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [3.0, 1.0, -9.0]
[bodies]
heavy = {{ mass = {heavy:e}, inertia = [[{h:e}, 0.0, 0.0], [0.0, {h:e}, 0.0], [0.0, 0.0, {h:e}]], position = [0.7, 0.2, 0.6] }}
light = {{ mass = {light:e}, inertia = [[{l:e}, 0.0, 0.0], [0.0, {l:e}, 0.0], [0.0, 0.0, {l:e}]], position = [-0.5, -0.2, 0.1] }}
[joints]
ball = {{ type = "spherical", between = ["heavy", "light"], point = [-0.9, -0.3, 0.4] }}
[forces]
bushing = {{ type = "bushing", between = ["light", "ground"], point = [0.1, 0.8, 0.05], {bushing} }}
"#
    )
}

const HELD: &str = "stiffness = [20.0, 20.0, 20.0], damping = [0.1, 0.1, 0.1], rotational_stiffness = [10.0, 10.0, 10.0], rotational_damping = [0.1, 0.1, 0.1]";
const FREE_TO_FALL: &str = "stiffness = [0.0, 0.0, 0.0], damping = [0.0, 0.0, 0.0], rotational_stiffness = [10.0, 10.0, 10.0], rotational_damping = [0.1, 0.1, 0.1]";

/// The same in the plane, on a spring-damper and a rotational one.
fn planar_pair([heavy, light]: [f64; 2]) -> String {
    let (h, l) = (0.3 * heavy, 0.3 * light);
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [3.0, -9.0]
[bodies]
heavy = {{ mass = {heavy:e}, inertia = {h:e}, position = [0.7, 0.2] }}
light = {{ mass = {light:e}, inertia = {l:e}, position = [-0.5, -0.2] }}
[joints]
pin = {{ type = "revolute", between = ["heavy", "light"], point = [-0.9, -0.3] }}
[forces]
spring = {{ type = "tsda", between = ["light", "ground"], points = [[-0.5, -0.2], [0.1, 0.8]], stiffness = 20.0, damping = 0.1, free_length = 1.1 }}
twist = {{ type = "rsda", between = ["ground", "light"], stiffness = 10.0, damping = 0.1 }}
"#
    )
}

/// The place of the heavy body at the end of half a second, with the attempts that it took.
fn fallen(text: &str, code: Code, tolerance: f64) -> (Vec<f64>, u64) {
    fallen_by(text, code, tolerance, None)
}

fn fallen_by(text: &str, code: Code, tolerance: f64, fixed_step: Option<f64>) -> (Vec<f64>, u64) {
    let options = Options {
        fixed_step,
        channels: vec!["heavy.position".to_owned()],
        output: OutputTimes::Listed(vec![0.5]),
        ..options(code, tolerance, 0.5)
    };
    let run = run_model(&model_of(text), &options);
    let components = if text.contains("planar") { 2 } else { 3 };
    let place = (0..components).map(|k| *run.series("heavy.position", k).last().unwrap());
    let place = place.collect();
    let s = &run.summary.statistics;
    (place, s.steps + s.rejected_newton + s.rejected_error)
}

/// Of the heavy body.
const START: [f64; 3] = [0.7, 0.2, 0.6];

fn of_low_order(code: Code) -> bool {
    matches!(code, Code::SspTrap | Code::InflTrap)
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
}

#[test] // truth: DOPRI5 at 1e-10, another formula for the same forces, which iterates nothing
fn iterations_do_not_feel_the_ratio_of_masses() {
    for masses in [[100.0, 1.0], [1e4, 1.0], [1e4, 1e-2]] {
        let text = pair(masses, HELD);
        let (truth, _) = fallen(&text, Code::Dopri5, 1e-10);
        let (_, explicit) = fallen(&text, Code::Dopri5, 1e-4);
        for code in implicit() {
            let (place, attempts) = fallen(&text, code, 1e-4);
            let off = distance(&place, &truth) / (1e-4 * (1.0 + distance(&truth, &START)));
            assert!(off < 30.0, "{masses:?} {code:?}: {off:.1}");
            // The trapezoidal rule is of second order.
            let most = if of_low_order(code) { 400 } else { 2 * explicit + 20 };
            assert!(attempts <= most, "{masses:?} {code:?}: {attempts} {explicit}");
        }
    }
}

#[test] // independent truth: gt²/2
fn a_pair_that_falls_together_takes_few_steps() {
    let (t, g) = (0.5f64, [3.0, 1.0, -9.0]);
    let truth: [f64; 3] = std::array::from_fn(|k| START[k] + 0.5 * g[k] * t * t);
    for masses in [[100.0, 1e-2], [1e4, 1e-2]] {
        for code in implicit() {
            let (place, attempts) = fallen(&pair(masses, FREE_TO_FALL), code, 1e-4);
            assert!(distance(&place, &truth) < 3e-4, "{masses:?} {code:?}: {place:?}");
            let most = if of_low_order(code) { 200 } else { 20 };
            assert!(attempts <= most, "{masses:?} {code:?}: {attempts}");
        }
    }
}

#[test] // truth: DOPRI5 at 1e-10, another formula for the same forces, which iterates nothing
fn nor_do_they_in_the_plane() {
    for masses in [[100.0, 1e-2], [1e4, 1.0], [1e4, 1e-2]] {
        let text = planar_pair(masses);
        let (truth, _) = fallen(&text, Code::Dopri5, 1e-10);
        let (_, explicit) = fallen(&text, Code::Dopri5, 1e-4);
        for code in implicit() {
            let (place, attempts) = fallen(&text, code, 1e-4);
            let off = distance(&place, &truth) / (1e-4 * (1.0 + distance(&truth, &START[..2])));
            assert!(off < 30.0, "{masses:?} {code:?}: {off:.1}");
            let most = if of_low_order(code) { 20 } else { 2 } * explicit + 20;
            assert!(attempts <= most, "{masses:?} {code:?}: {attempts} {explicit}");
        }
    }
}

#[test] // independent truth: the orders of the formulas, of errors against DOPRI5 at 1e-10
fn steps_of_prescribed_length_keep_their_order() {
    let text = pair([1e4, 1.0], HELD);
    let (truth, _) = fallen(&text, Code::Dopri5, 1e-10);
    for code in implicit() {
        let off = |step: f64| distance(&fallen_by(&text, code, 1e-4, Some(step)).0, &truth);
        let order = (off(0.02) / off(0.005)).log2() / 2.0;
        let least = match code {
            Code::SspTrap | Code::InflTrap => 1.8,
            Code::ForRadau => 4.6,
            _ => 3.7,
        };
        assert!(order > least, "{code:?}: {order:.2}");
    }
}

/// A pendulum with an arm of a microgram on its tip, which a damper and a spring hold.
const LIGHT_ARM: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
pendulum = { mass = 1.0, inertia = 0.05, position = [0.5, 0.0] }
arm = { mass = 1e-9, inertia = 1e-11, position = [0.5, -0.3] }
[joints]
hinge = { type = "revolute", between = ["ground", "pendulum"], point = [0.0, 0.0] }
elbow = { type = "revolute", between = ["pendulum", "arm"], point = [0.5, 0.0] }
[forces]
damper = { type = "rsda", between = ["pendulum", "arm"], damping = 2.42 }
spring = { type = "tsda", between = ["ground", "arm"], points = [[-0.6362, 0.4173], [0.5, -0.3]], stiffness = 15.5, damping = 1.0, free_length = 0.2 }
"#;

#[test] // truth: other coordinates; in the spring's length the hinge has no freedom where the spring points at it
fn a_light_arm_passes_where_its_spring_points_at_the_hinge() {
    let model = model_of(LIGHT_ARM);
    let with = |code, tolerance, parametrization, coordinates| Options {
        parametrization,
        coordinates,
        channels: vec!["pendulum.position".to_owned(), "arm.position".to_owned()],
        output: OutputTimes::Listed(vec![0.1]),
        max_steps: 3000,
        ..options(code, tolerance, 0.1)
    };
    let places = |options: &Options| -> Vec<f64> {
        let run = run_model(&model, options);
        let of_channel = |name: &&str| [0, 1].map(|k| *run.series(name, k).last().unwrap());
        ["pendulum.position", "arm.position"].iter().flat_map(of_channel).collect()
    };
    let (partition, tree) = (ParametrizationKind::Partitioning, ParametrizationKind::Tree);
    let truth = places(&with(DEFAULT_CODE, 1e-8, partition, Coordinates::Cartesian));
    // Trapezoidal codes do not damp the arm's vibration, and follow it.
    for code in implicit().filter(|code| !of_low_order(*code)) {
        for form in [Coordinates::Cartesian, Coordinates::Joint] {
            let found = places(&with(code, 1e-4, tree, form));
            let off = distance(&found, &truth) / 1e-4;
            assert!(off < 30.0, "{code:?} {form:?}: {off:.1}");
        }
    }
}
