//! What turns about axes: wheels, doors, satellites with wheels, cardan shafts, point masses on rods. However far
//! it turns, the tolerance holds, and what turns steadily is exact.

use crate::common::integrate::space::{
    Vector, cross, dot, pose, pose_rate, scaled, sum, turned, unturned, vector,
};
use crate::common::integrate::{solve, tight};
use crate::common::table::{
    Bounds, Case, DEFAULT, Kind, Table, all_codes, implicit, line, measure, run_everything, times,
    truth,
};
use crate::common::{SPATIAL_SLIDER_CRANK, model, model_of, options, run_model, try_run};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes, Status};
use std::f64::consts::{PI, TAU};

/// Allowed error of a steady rotation: rad and rad/s, relative for what is above 1.
const STEADY: f64 = 1e-9;
const ALL_TOLERANCES: [f64; 4] = [1e-2, 1e-3, 1e-4, 1e-6];

/// An unbalanced wheel on a skew axis.
fn wheel(rate: f64) -> String {
    let [x, y, z] = [1.0, 2.0, 2.0].map(|a| a / 3.0 * rate);
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
wheel = {{ mass = 1.0, inertia = [[0.2, 0.01, 0.0], [0.01, 0.1, 0.0], [0.0, 0.0, 0.15]], position = [0.1, 0.0, 0.0] }}
[joints]
bearing = {{ type = "revolute", between = ["ground", "wheel"], point = [0.0, 0.0, 0.0], axis = [1.0, 2.0, 2.0] }}
[initial.bodies]
wheel = {{ angular_velocity = [{x:e}, {y:e}, {z:e}] }}
"#
    )
}

/// The angle `rate` t and its rate.
fn steady_case(text: &str, joint: [&'static str; 2], rate: f64, end: f64) -> Case {
    let times = times(end, 20);
    let angle = truth(joint[0], Kind::Angle, times.iter().map(|t| vec![rate * t]));
    let rates = truth(joint[1], Kind::Velocity, times.iter().map(|_| vec![rate]));
    Case { max_steps: 2000, ..Case::new(text, end, vec![angle, rates]) }
}

/// Every code at every tolerance: what turns steadily is exact. `steps` implicit codes may take; `angle` at the end,
/// of which [`STEADY`] is a part where it is larger than 1.
fn assert_steady(name: &str, case: &Case, rate: f64, angle: f64, steps: u64) {
    let mut table = Table::new(name);
    // Rounding of centripetal terms is ε ω² of an angular acceleration.
    let steady = STEADY * (rate / 100.0).max(1.0).powi(2);
    for code in all_codes() {
        for tolerance in ALL_TOLERANCES {
            let run = measure(case, DEFAULT, code, tolerance);
            let line = line(name, DEFAULT, code);
            // `measure` divides by the tolerance and 1 + movement, which is at most π.
            let bounds = Bounds {
                position: steady * angle.max(1.0) / (1.0 + angle.min(PI)) / tolerance,
                velocity: steady / tolerance,
                or_warned: false,
                or_stopped: false,
            };
            table.run(&line, &format!("{tolerance:.0e}"), &run, bounds);
            let few = run.steps <= steps || code.is_explicit();
            table.claim(few, || format!("{line} at {tolerance:.0e}: {} steps", run.steps));
        }
    }
    table.finish();
}

#[test] // independent truth: the angle grows evenly
fn a_free_wheel_is_exact_after_sixty_turns() {
    let case = steady_case(&wheel(TAU), ["bearing.angle", "bearing.rate"], TAU, 60.0);
    assert_steady("free wheel of 60 turns", &case, TAU, 60.0 * TAU, 200);
}

#[test] // independent truth: the angle grows evenly
fn a_fast_wheel_takes_as_few_steps_as_a_slow_one() {
    let case = steady_case(&wheel(300.0), ["bearing.angle", "bearing.rate"], 300.0, 60.0);
    assert_steady("wheel at 300 rad per s", &case, 300.0, 300.0 * 60.0, 60);
}

#[test] // independent truth: no torque acts about a vertical hinge, so angle and energy are known
fn a_door_turns_evenly_and_keeps_its_energy() {
    let text = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
door = { mass = 20.0, inertia = [[6.7, 0.0, 0.3], [0.0, 8.0, 0.0], [0.3, 0.0, 1.4]], position = [0.4, 0.0, 1.0] }
[joints]
hinge = { type = "revolute", between = ["ground", "door"], point = [0.0, 0.0, 1.0], axis = [0.0, 0.0, 1.0] }
[initial.bodies]
door = { angular_velocity = [0.0, 0.0, 1.0] }
"#;
    let mut case = steady_case(text, ["hinge.angle", "hinge.rate"], 1.0, 3.0);
    let energy = 0.5 * (1.4 + 20.0 * 0.16);
    case.truths.push(truth("energy.kinetic", Kind::Point, (0..=20).map(|_| vec![energy])));
    assert_steady("door", &case, 1.0, 3.0, 30);
}

/// Satellite of 50 kg with a reaction wheel of 1 kg beside its centre of mass.
const SATELLITE: [[f64; 3]; 3] = [[8.0, 0.3, 0.0], [0.3, 10.0, -0.2], [0.0, -0.2, 12.0]];
const MASSES: [f64; 2] = [50.0, 1.0];
/// Of the wheel: moments about its axis and across, kg m²; place and axis.
const WHEEL: [f64; 2] = [0.02, 0.011];
const PLACE: Vector = [0.3, 0.1, -0.2];
const AXIS: Vector = [1.0 / 3.0, 2.0 / 3.0, 2.0 / 3.0];
const SPIN: f64 = 300.0;
const TUMBLING: Vector = [0.05, 0.1, -0.08];

/// Inertia of both bodies about their common centre of mass.
fn gyrostat() -> [[f64; 3]; 3] {
    let reduced = MASSES[0] * MASSES[1] / (MASSES[0] + MASSES[1]);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let unit = f64::from(u8::from(i == j));
            let wheel = WHEEL[1] * unit + (WHEEL[0] - WHEEL[1]) * AXIS[i] * AXIS[j];
            let apart = reduced * (dot(&PLACE, &PLACE) * unit - PLACE[i] * PLACE[j]);
            SATELLITE[i][j] + wheel + apart
        })
    })
}

/// Angular momentum in body axes.
fn momentum(w: Vector, spin: f64) -> Vector {
    sum(gyrostat().map(|row| dot(&row, &w)), scaled(AXIS, WHEEL[0] * spin))
}

/// Equations of a gyrostat with a free wheel: Euler parameters, angular velocity in body axes, angle and rate of
/// the wheel. The wheel's own axial momentum J (Ω + a·ω) is constant.
fn gyrostat_rate(_: f64, y: &[f64]) -> Vec<f64> {
    let (p, w) = (pose(&y[..4]), vector(&y[4..7]));
    let inertia = gyrostat();
    let matrix = (0..3)
        .map(|i| (0..3).map(|j| inertia[i][j] - WHEEL[0] * AXIS[i] * AXIS[j]).collect())
        .collect();
    let turning = solve(matrix, cross(momentum(w, y[8]), w).to_vec());
    let mut out = pose_rate(p, w).to_vec();
    out.extend(&turning);
    out.extend([y[8], -dot(&AXIS, &turning)]);
    out
}

#[test] // independent truth: the equations of a gyrostat by DOP853; its angular momentum is constant in the ground
fn a_satellite_with_a_reaction_wheel_keeps_the_tolerance() {
    let end = 60.0;
    let offset = scaled(PLACE, -MASSES[1] / (MASSES[0] + MASSES[1]));
    let start: Vec<f64> = [&[1.0, 0.0, 0.0, 0.0][..], &TUMBLING[..], &[0.0, SPIN][..]].concat();
    let rows = tight(&gyrostat_rate, &start, &times(end, 20));
    let ground = |y: &[f64]| turned(pose(&y[..4]), momentum(vector(&y[4..7]), y[8]));
    let [first, last] = [&rows[0], &rows[20]].map(|y| ground(y));
    assert!(first.iter().zip(&last).all(|(a, b)| (a - b).abs() < 1e-10), "{first:?} {last:?}");
    let spin = sum(TUMBLING, scaled(AXIS, SPIN));
    // The common centre of mass rests: the satellite's centre, which is its origin, moves about it.
    let [body, hub] = [offset, sum(offset, PLACE)].map(|place| cross(TUMBLING, place));
    let tensor = |axial: f64, across: f64| -> Vec<Vec<f64>> {
        let entry = |i: usize, j: usize| {
            across * f64::from(u8::from(i == j)) + (axial - across) * AXIS[i] * AXIS[j]
        };
        (0..3).map(|i| (0..3).map(|j| entry(i, j)).collect()).collect()
    };
    let text = format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
body = {{ mass = {}, inertia = {SATELLITE:?}, position = {offset:?} }}
wheel = {{ mass = {}, inertia = {:?}, position = {:?} }}
[joints]
bearing = {{ type = "revolute", between = ["body", "wheel"], point = {:?}, axis = [1.0, 2.0, 2.0] }}
[initial.bodies]
body = {{ velocity = {body:?}, angular_velocity = {TUMBLING:?} }}
wheel = {{ velocity = {hub:?}, angular_velocity = {spin:?} }}
"#,
        MASSES[0],
        MASSES[1],
        tensor(WHEEL[0], WHEEL[1]),
        sum(offset, PLACE),
        sum(offset, PLACE),
    );
    let ground_rate = |y: &Vec<f64>| turned(pose(&y[..4]), vector(&y[4..7])).to_vec();
    let place = |y: &Vec<f64>| turned(pose(&y[..4]), offset).to_vec();
    let case = Case::new(
        &text,
        end,
        vec![
            truth("body.position", Kind::Point, rows.iter().map(place)),
            truth("body.euler_parameters", Kind::Orientation, rows.iter().map(|y| y[..4].to_vec())),
            truth("body.angular_velocity", Kind::Velocity, rows.iter().map(ground_rate)),
            truth("bearing.angle", Kind::Angle, rows.iter().map(|y| vec![y[7]])),
            truth("bearing.rate", Kind::Velocity, rows.iter().map(|y| vec![y[8]])),
        ],
    );
    let mut table = Table::new("satellite with a reaction wheel");
    run_everything(&mut table, "satellite", &case);
    table.finish();
}

/// A point mass on a rod of 1 m, from the horizontal at 8 rad/s; its body turns at 1 rad/s beside that.
fn on_a_rod(gravity: f64) -> Case {
    let end = 5.0;
    let rate = |_: f64, y: &[f64]| vec![y[1], -gravity * y[0].cos()];
    let rows = tight(&rate, &[0.0, 8.0], &times(end, 50));
    let text = format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -{gravity:?}]
[bodies]
bob = {{ mass = 1.0, inertia = 0.01, position = [1.0, 0.0] }}
[joints]
rod = {{ type = "distance", between = ["ground", "bob"], points = [[0.0, 0.0], [1.0, 0.0]] }}
[initial.bodies]
bob = {{ velocity = [0.0, 8.0], angular_velocity = 1.0 }}
"#
    );
    let place = |y: &Vec<f64>| vec![y[0].cos(), y[0].sin()];
    let speed = |y: &Vec<f64>| vec![-y[1] * y[0].sin(), y[1] * y[0].cos()];
    Case::new(
        &text,
        end,
        vec![
            truth("bob.position", Kind::Point, rows.iter().map(place)),
            truth("bob.velocity", Kind::Velocity, rows.iter().map(speed)),
            truth("bob.angle", Kind::Angle, times(end, 50).iter().map(|t| vec![*t])),
        ],
    )
}

#[test] // independent truth: without gravity even rotation, with it one equation by DOP853
fn a_point_mass_on_a_distance_joint_keeps_the_tolerance() {
    let mut table = Table::new("point mass on a distance joint");
    run_everything(&mut table, "no gravity", &on_a_rod(0.0));
    run_everything(&mut table, "gravity", &on_a_rod(9.81));
    table.finish();
}

/// Bend of the cardan shaft, rad.
const BEND: f64 = 0.6;
/// Axial moments of inertia of input, middle and output, kg m².
const SHAFT: [f64; 3] = [0.01, 0.05, 0.02];

/// Angle of the middle shaft, tan γ = cos β tan α, without jumps, and its transmission γ′ = dγ/dα.
fn cardan(angle: f64) -> (f64, f64) {
    let (s, c) = angle.sin_cos();
    let bend = BEND.cos();
    let more = ((bend - 1.0) * s * c).atan2(c * c + bend * s * s);
    (angle + more, bend / (c * c + bend * bend * s * s))
}

#[test] // independent truth: the cardan joint's law tan γ = cos β tan α, and constant kinetic energy
fn a_cardan_shaft_keeps_the_tolerance() {
    let (end, speed) = (3.0, 20.0);
    let inertia = |angle: f64| SHAFT[0] + SHAFT[2] + SHAFT[1] * cardan(angle).1.powi(2);
    let rate = |_: f64, y: &[f64]| vec![speed * (inertia(0.0) / inertia(y[0])).sqrt()];
    let times = times(end, 60);
    let angles: Vec<f64> = tight(&rate, &[0.0], &times).iter().map(|y| y[0]).collect();
    let (s, c) = BEND.sin_cos();
    let entry = |i: usize, j: usize| {
        let axis = [c, s, 0.0];
        0.03 * f64::from(u8::from(i == j)) + (SHAFT[1] - 0.03) * axis[i] * axis[j]
    };
    let middle: Vec<Vec<f64>> = (0..3).map(|i| (0..3).map(|j| entry(i, j)).collect()).collect();
    let text = format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
input = {{ mass = 1.0, inertia = [[{}, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]], position = [-0.2, 0.0, 0.0] }}
middle = {{ mass = 2.0, inertia = {middle:?}, position = [{}, {}, 0.0] }}
output = {{ mass = 1.0, inertia = [[{}, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.02]], position = [{}, {}, 0.0] }}
[joints]
bearing = {{ type = "revolute", between = ["ground", "input"], point = [-0.2, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}
front = {{ type = "universal", between = ["input", "middle"], point = [0.0, 0.0, 0.0], axes = [[0.0, 0.0, 1.0], [{}, {c}, 0.0]] }}
rear = {{ type = "universal", between = ["middle", "output"], point = [{}, {}, 0.0], axes = [[{}, {c}, 0.0], [0.0, 0.0, 1.0]] }}
sleeve = {{ type = "cylindrical", between = ["ground", "output"], point = [{}, {}, 0.0], axis = [1.0, 0.0, 0.0] }}
[initial.bodies]
input = {{ angular_velocity = [{speed:?}, 0.0, 0.0] }}
"#,
        SHAFT[0],
        0.25 * c,
        0.25 * s,
        SHAFT[2],
        0.5 * c + 0.2,
        0.5 * s,
        -s,
        0.5 * c,
        0.5 * s,
        -s,
        0.5 * c + 0.2,
        0.5 * s,
    );
    let speeds: Vec<f64> = angles.iter().map(|&a| rate(0.0, &[a])[0]).collect();
    let half = |angle: f64| {
        let (sin, cos) = (0.5 * cardan(angle).0).sin_cos();
        vec![cos, c * sin, s * sin, 0.0]
    };
    let turning = |(&angle, &rate): (&f64, &f64)| {
        let w = cardan(angle).1 * rate;
        vec![w * c, w * s, 0.0]
    };
    let case = Case::new(
        &text,
        end,
        vec![
            truth("bearing.angle", Kind::Angle, angles.iter().map(|&a| vec![a])),
            truth("sleeve.angle", Kind::Angle, angles.iter().map(|&a| vec![a])),
            truth("middle.euler_parameters", Kind::Orientation, angles.iter().map(|&a| half(a))),
            truth("bearing.rate", Kind::Velocity, speeds.iter().map(|&w| vec![w])),
            truth(
                "middle.angular_velocity",
                Kind::Velocity,
                angles.iter().zip(&speeds).map(turning),
            ),
        ],
    );
    let mut table = Table::new("cardan shaft at 20 rad per s");
    run_everything(&mut table, "cardan shaft", &case);
    table.finish();
}

#[test]
fn spatial_linkages_keep_their_coordinates() {
    let mut table = Table::new("re-parametrizations of spatial linkages");
    for (name, model) in [
        ("spatial slider-crank", model_of(SPATIAL_SLIDER_CRANK)),
        ("spatial four-bar", model("spatial_four_bar")),
    ] {
        for code in all_codes() {
            let outcome = try_run(&model, &options(code, 1e-4, 2.0));
            let count = outcome.summary.statistics.reparametrizations;
            let done = outcome.summary.status == Status::Completed;
            let line = line(name, DEFAULT, code);
            table.claim(done && count == 0, || format!("{line}: {count} times, ended {done}"));
            table.note(&line, format!("{count}"));
        }
    }
    table.finish();
}

#[test] // the truth of the satellite in axes of its own: a gyrostat without a wheel is a free body
fn the_gyrostat_conserves_energy_and_momentum() {
    let start: Vec<f64> = [&[1.0, 0.0, 0.0, 0.0][..], &TUMBLING[..], &[0.0, SPIN][..]].concat();
    let rows = tight(&gyrostat_rate, &start, &[5.0, 60.0]);
    let energy = |y: &[f64]| {
        let w = vector(&y[4..7]);
        let turning = dot(&w, &gyrostat().map(|row| dot(&row, &w)));
        0.5 * turning + WHEEL[0] * y[8] * (0.5 * y[8] + dot(&AXIS, &w))
    };
    for y in &rows {
        assert!((energy(y) - energy(&start)).abs() < 1e-9, "{} {}", energy(y), energy(&start));
        let axial = |y: &[f64]| y[8] + dot(&AXIS, &y[4..7]);
        assert!((axial(y) - axial(&start)).abs() < 1e-10);
        let still = unturned(pose(&y[..4]), momentum(TUMBLING, SPIN));
        let now = momentum(vector(&y[4..7]), y[8]);
        assert!(still.iter().zip(&now).all(|(a, b)| (a - b).abs() < 1e-10));
    }
    assert_eq!(implicit().len() + 3, all_codes().len());
}

/// An unbalanced rotor on a sprung block that a constant torque runs up through its resonance.
const RUN_UP: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 4.46, inertia = 0.4, position = [0.0, 0.0] }
rotor = { mass = 0.458, inertia = 0.0229, position = [0.0, 0.0], center_of_mass = [0.00434, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
shaft = { type = "revolute", between = ["block", "rotor"], point = [0.0, 0.0] }
[forces]
mount = { type = "tsda", between = ["ground", "block"], points = [[0.0, -1.0], [0.0, 0.0]], stiffness = 194.6, damping = 2.32, free_length = 1.0 }
motor = { type = "torque", between = ["block", "rotor"], torque = 0.00994 }
drag = { type = "rsda", between = ["block", "rotor"], damping = 8.58e-5 }
"#;

/// Accelerations of its block and rotor; y = [x, θ, ẋ, θ̇].
fn run_up_rate(_: f64, y: &[f64]) -> Vec<f64> {
    let (sin, cos) = y[1].sin_cos();
    let unbalance = 0.458 * 0.00434;
    let mass =
        vec![vec![4.918, unbalance * cos], vec![unbalance * cos, 0.0229 + unbalance * 0.00434]];
    let block = unbalance * y[3] * y[3] * sin - 194.6 * y[0] - 2.32 * y[2];
    let a = solve(mass, vec![block, 0.00994 - 8.58e-5 * y[3]]);
    vec![y[2], y[3], a[0], a[1]]
}

#[test] // independent truth: two equations in minimal coordinates, DOP853
fn a_rotor_that_is_not_balanced_runs_up_through_its_resonance() {
    const END: f64 = 50.0;
    let times = times(END, 100);
    let truth = tight(&run_up_rate, &[0.0; 4], &times);
    let model = model_of(RUN_UP);
    for code in all_codes() {
        for tolerance in [1e-2, 1e-3, 1e-4] {
            let options = Options {
                channels: vec!["shaft.angle".to_owned()],
                output: OutputTimes::Interval(END / 100.0),
                ..options(code, tolerance, END)
            };
            let outcome = try_run(&model, &options);
            assert_eq!(outcome.summary.status, Status::Completed);
            let angles = outcome.series("shaft.angle", 0);
            let worst = angles.iter().zip(&truth).map(|(angle, y)| {
                let turn = y[1].rem_euclid(TAU);
                (angle - y[1]).abs() / (tolerance * (1.0 + turn.min(TAU - turn)))
            });
            let worst = worst.fold(0.0, f64::max);
            let tells = ["simulation/amplified-error", "simulation/energy-imbalance"];
            let warned = outcome.summary.warnings.iter().any(|w| tells.contains(&w.code));
            assert!(worst < 50.0 || warned, "{code:?} at {tolerance:e}: {worst:.0} tolerances");
        }
    }
}

#[test] // a balanced rotor moves nothing: nothing is to be seen
fn a_rotor_that_is_balanced_runs_up_in_long_steps() {
    let balanced = RUN_UP.replace("0.00434", "0.0");
    let model = model_of(&balanced);
    for code in all_codes() {
        let statistics = run_model(&model, &options(code, 1e-3, 50.0)).summary.statistics;
        // Codes of second order follow its slow speeding up with hundreds.
        let most = if code.is_trapezoidal() { 600 } else { 40 };
        assert!(statistics.steps < most, "{code:?}: {} steps", statistics.steps);
    }
}

/// A rotor whose shaft is driven ever more slowly through the resonance of its block of 10 kg, rad: 10 t − 2.6525e-4 t².
const DRIVEN: &str = r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = { mass = 9.0, inertia = 1.0, position = [0.0, 0.0] }
rotor = { mass = 1.0, inertia = 100.0, position = [0.0, 0.0], center_of_mass = [2e-3, 0.0] }
[joints]
guide = { type = "translational", between = ["ground", "block"], point = [0.0, 0.0], axis = [0.0, 1.0] }
shaft = { type = "revolute", between = ["block", "rotor"], point = [0.0, 0.0] }
[drivers]
motor = { joint = "shaft", coordinate = "rotation", motion = { type = "polynomial", coefficients = [0.0, 10.0, -2.6525e-4] } }
[forces]
mount = { type = "tsda", between = ["ground", "block"], points = [[0.0, -50.0], [0.0, 0.0]], stiffness = 1000.0, free_length = 50.0 }
[initial.joints]
shaft = { angular_velocity = 10.0 }
"#;

#[test] // independent truth: the one equation of the block, DOP853
fn a_driven_rotor_that_is_not_balanced_passes_the_resonance() {
    const END: f64 = 188.5;
    let rate = |t: f64, y: &[f64]| {
        let (angle, rate, acceleration) =
            (10.0 * t - 2.6525e-4 * t * t, 10.0 - 5.305e-4 * t, -5.305e-4);
        let unbalance = 2e-3 * (angle.sin() * rate * rate - angle.cos() * acceleration);
        vec![y[1], (unbalance - 1000.0 * y[0]) / 10.0]
    };
    let times = times(END, 400);
    let truth = tight(&rate, &[0.0; 2], &times);
    let model = model_of(DRIVEN);
    for code in all_codes() {
        let options = Options {
            channels: vec!["block.position".to_owned()],
            output: OutputTimes::Interval(END / 400.0),
            ..options(code, 1e-3, END)
        };
        let outcome = try_run(&model, &options);
        assert_eq!(outcome.summary.status, Status::Completed);
        let places = outcome.series("block.position", 1);
        let worst = places.iter().zip(&truth).map(|(place, y)| (place - y[0]).abs() / 1e-3);
        let worst = worst.fold(0.0, f64::max);
        let warned =
            outcome.summary.warnings.iter().any(|w| w.code == "simulation/amplified-error");
        assert!(worst < 30.0 || warned, "{code:?}: {worst:.0} tolerances");
    }
}

/// An arm that turns freely, whose tip touches the road with a small tyre for four degrees of each turn.
const TOUCHES: &str = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
arm = { mass = 1.0, inertia = [[0.5, 0.0, 0.0], [0.0, 0.5, 0.0], [0.0, 0.0, 0.5]], position = [0.0, 0.0, 1.048] }
[joints]
axle = { type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 1.048], axis = [0.0, 1.0, 0.0] }
[roads]
road = { type = "flat" }
[forces]
tip = { type = "tyre", on = "arm", point = [1.0, 0.0, 1.048], radius = 0.05, stiffness = 5e4, damping = 15.8, smoothing = 1e-5, road = "road" }
[initial.joints]
axle = { angular_velocity = 30.0 }
"#;

#[test] // independent truth: its one equation by DOP853 in steps of a millisecond
fn what_touches_for_a_few_degrees_of_each_turn_is_not_jumped_over() {
    const END: f64 = 10.0;
    const FINE: usize = 100;
    let rate = |_: f64, y: &[f64]| {
        let (sin, cos) = y[0].sin_cos();
        let deflection = sin - 0.998;
        let root = deflection.hypot(1e-5);
        let force = 2.5e4 * (deflection + root) + 7.9 * (1.0 + deflection / root) * cos * y[1];
        vec![y[1], -2.0 * force * cos]
    };
    let truth = tight(&rate, &[0.0, 30.0], &times(END, 100 * FINE));
    let model = model_of(TOUCHES);
    for code in all_codes() {
        for tolerance in [1e-3, 1e-4] {
            let options = Options {
                channels: vec!["axle.angle".to_owned()],
                output: OutputTimes::Interval(END / 100.0),
                ..options(code, tolerance, END)
            };
            let outcome = try_run(&model, &options);
            let angles = outcome.series("axle.angle", 0);
            let off = angles
                .iter()
                .zip(truth.iter().step_by(FINE))
                .map(|(angle, y)| (angle - y[0]).abs() / (tolerance * (1.0 + y[0].abs().min(PI))));
            let worst = off.fold(0.0, f64::max);
            let tells = ["simulation/amplified-error", "simulation/energy-imbalance"];
            let warned = outcome.summary.warnings.iter().any(|w| tells.contains(&w.code));
            assert!(worst < 50.0 || warned, "{code:?} at {tolerance:e}: {worst:.0} tolerances");
        }
    }
}

#[test] // independent truth: a balanced disc on its pin does not know how fast it turns, nor does its arm
fn balanced_discs_on_an_arm_that_swings_leave_it_its_steps() {
    let model = |rate: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -9.81]
[bodies]
arm = {{ mass = 2.0, inertia = 0.5, position = [0.5, 0.0] }}
disc = {{ mass = 0.1, inertia = 0.0005, position = [0.9, 0.0] }}
wheel = {{ mass = 0.2, inertia = 0.001, position = [0.5, 0.0] }}
[joints]
pivot = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }}
pin = {{ type = "revolute", between = ["arm", "disc"], point = [0.9, 0.0] }}
hub = {{ type = "revolute", between = ["arm", "wheel"], point = [0.5, 0.0] }}
[initial.joints]
pivot = {{ angular_velocity = 1.0 }}
pin = {{ angular_velocity = {rate:?} }}
hub = {{ angular_velocity = {:?} }}
"#,
            1.3 * rate
        ))
    };
    for code in [Code::ForRadau, Code::ForSdirk, Code::Deabm, Code::Dop853] {
        let steps = |rate: f64| {
            let outcome = run_model(&model(rate), &options(code, 1e-5, 10.0));
            outcome.summary.statistics.steps as f64
        };
        let still = steps(0.0);
        for rate in [47.0, 310.0] {
            let turning = steps(rate);
            assert!(turning < 1.15 * still + 2.0, "{code:?} at {rate}: {turning} of {still}");
        }
    }
}

#[test] // truth: turning the springs of a block, and with them nothing but the view, changes no motion
fn springs_askew_hide_no_unbalanced_rotor() {
    let steps = |skew: f64| {
        let (sin, cos) = skew.sin_cos();
        // From so far away that their directions stay.
        let [soft, stiff] = [[-1e3 * cos, -1e3 * sin], [1e3 * sin, -1e3 * cos]];
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
block = {{ mass = 0.99, inertia = 1.0, position = [0.0, 0.0] }}
rotor = {{ mass = 0.01, inertia = 5.0, position = [0.0, 0.0], center_of_mass = [0.05, 0.0] }}
[joints]
shaft = {{ type = "revolute", between = ["block", "rotor"], point = [0.0, 0.0] }}
[forces]
soft = {{ type = "tsda", between = ["ground", "block"], points = [{soft:?}, [0.0, 0.0]], stiffness = 1.0, damping = 0.01, free_length = 1000.0 }}
stiff = {{ type = "tsda", between = ["ground", "block"], points = [{stiff:?}, [0.0, 0.0]], stiffness = 25.0, damping = 0.05, free_length = 1000.0 }}
upright = {{ type = "rsda", between = ["ground", "block"], stiffness = 1000.0, damping = 10.0 }}
[initial.bodies]
rotor = {{ angular_velocity = 1.2 }}
"#
        ));
        run_model(&model, &options(Code::ForRadau, 1e-3, 200.0)).summary.statistics.steps as f64
    };
    let straight = steps(0.0);
    assert!(straight > 100.0, "{straight} steps: it is not seen");
    for skew in [0.4, PI / 4.0, 2.0, 3.0 * PI / 4.0] {
        let turned = steps(skew);
        assert!(turned > 0.8 * straight, "{turned} steps at {skew} rad, {straight} at 0");
    }
}
