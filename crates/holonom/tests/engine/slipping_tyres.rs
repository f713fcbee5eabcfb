//! Tyres that slip: dry friction, and wheels that turn past their own direction.

use crate::common::integrate::tight;
use crate::common::table::{implicit, times};
use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes};

const DEFLECTION: f64 = 0.02;
const SMOOTHING: f64 = 1e-4;
const ROWS: usize = 200;

/// σ of a tyre pressed in by [`DEFLECTION`].
fn onset() -> f64 {
    0.5 * (1.0 + DEFLECTION / DEFLECTION.hypot(SMOOTHING))
}

/// A block on a rail and a spring, which a force pulls to and fro: the lateral force of a tyre without forward speed is dry
/// friction, all but a jump.
#[derive(Debug, Clone, Copy)]
struct Block {
    /// kg.
    mass: f64,
    /// Of the force, N and rad/s.
    force: [f64; 2],
    /// Of the friction, N and m/s.
    cornering: f64,
    regular: f64,
    /// N/m.
    stiffness: f64,
    /// Speed at the start, m/s.
    start: f64,
}

impl Block {
    /// Place and speed, each in tolerances of a run over `end` seconds.
    fn errors(&self, end: f64, code: Code, tolerance: f64, truth: &[Vec<f64>]) -> [f64; 2] {
        let Self { mass, force: [amplitude, rate], cornering, regular, stiffness, start } = self;
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.block]
mass = {mass}
inertia = [[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]]
position = [0.0, 0.0, {z}]
[roads]
road = {{ type = "flat" }}
[joints]
way = {{ type = "translational", between = ["ground", "block"], point = [0.0, 0.0, {z}], axis = [0.0, 1.0, 0.0] }}
[forces.friction]
type = "tyre"
on = "block"
point = [0.0, 0.0, {z}]
radius = 0.3
stiffness = 0.0
smoothing = {SMOOTHING}
road = "road"
lateral = {{ cornering_stiffness = {cornering}, regularization_speed = {regular}, axis = [0.0, 1.0, 0.0] }}
[forces.pull]
type = "point_force"
on = "block"
point = [0.0, 0.0, {z}]
force = [0.0, {{ type = "harmonic", amplitude = {amplitude}, angular_frequency = {rate} }}, 0.0]
[forces.spring]
type = "tsda"
between = ["ground", "block"]
points = [[0.0, -100.0, {z}], [0.0, 0.0, {z}]]
free_length = 100.0
stiffness = {stiffness}
[initial.bodies.block]
velocity = [0.0, {start}, 0.0]
"#,
            z = 0.3 - DEFLECTION
        ));
        let asked = Options {
            channels: ["block.position", "block.velocity"].map(str::to_owned).to_vec(),
            output: OutputTimes::Interval(end / ROWS as f64),
            ..options(code, tolerance, end)
        };
        let outcome = run_model(&model, &asked);
        let places = outcome.series("block.position", 1);
        let speeds = outcome.series("block.velocity", 1);
        assert_eq!(places.len(), truth.len());
        let fastest = truth.iter().fold(0.0f64, |most, y| most.max(y[1].abs()));
        let mut worst = [0.0f64; 2];
        for ((x, v), y) in places.iter().zip(&speeds).zip(truth) {
            worst[0] = worst[0].max((x - y[0]).abs() / (tolerance * (1.0 + y[0].abs())));
            worst[1] = worst[1].max((v - y[1]).abs() / (tolerance * (1.0 + fastest)));
        }
        worst
    }

    /// Its one equation by an explicit code of order 8.
    fn truth(&self, end: f64) -> Vec<Vec<f64>> {
        let Self { mass, force: [amplitude, rate], cornering, regular, stiffness, start } = *self;
        let slope = |t: f64, y: &[f64]| {
            let friction = cornering * onset() * y[1].atan2(regular);
            let pull = amplitude * (rate * t).sin();
            vec![y[1], (pull - friction - stiffness * y[0]) / mass]
        };
        tight(&slope, &[0.0, start], &times(end, ROWS))
    }
}

#[test] // independent truth: the block's one equation by DOP853
fn a_block_that_sticks_and_breaks_loose_is_seen() {
    for (regular, tolerances) in [(1e-2, &[1e-3, 1e-4][..]), (1e-3, &[1e-4])] {
        let block = Block {
            mass: 100.0,
            force: [4e4, 9.0],
            cornering: 2e4,
            regular,
            stiffness: 0.0,
            start: 3.0,
        };
        let truth = block.truth(6.0);
        for code in implicit() {
            for &tolerance in tolerances {
                let worst = block.errors(6.0, code, tolerance, &truth);
                assert!(
                    worst[0] <= 30.0 && worst[1] <= 60.0,
                    "{code:?} at {tolerance:e}, {regular:e} m/s: {worst:?} tolerances"
                );
            }
        }
    }
}

#[test] // independent truth: the block's one equation by DOP853
fn no_step_passes_over_a_change_of_direction() {
    let block = |[cornering, regular, amplitude, rate, stiffness]: [f64; 5], start: f64| Block {
        mass: 1.0,
        force: [amplitude, rate],
        cornering,
        regular,
        stiffness,
        start,
    };
    for block in [
        block([3.0, 5e-4, 15.0, 3.5, 2.0], 1.0),
        block([3.5, 1e-3, 17.0, 3.6, 5.0], 1.0),
        block([1.5, 3e-5, 7.0, 1.9, 1.0], 1.0),
        // Sticks at the start and breaks loose for a while.
        block([3.694, 1.14e-4, 6.178, 0.6487, 0.78], 1.0),
    ] {
        let truth = block.truth(12.0);
        for code in implicit() {
            for tolerance in [1e-3, 1e-4, 1e-5] {
                let worst = block.errors(12.0, code, tolerance, &truth);
                assert!(
                    worst[0] <= 30.0 && worst[1] <= 60.0,
                    "{code:?} at {tolerance:e}, {block:?}: {worst:?} tolerances"
                );
            }
        }
    }
}

#[test] // independent truth: three equations by DOP853
fn a_body_that_spins_on_its_tyres_is_right_or_warned_of() {
    const ENDS: [f64; 2] = [0.6, -0.5];
    const END: f64 = 8.0;
    for [cornering, regular, spin, speed] in
        [[10.0, 0.02, 13.0, 8.0], [2.0, 0.005, 14.0, 7.0], [5.0, 0.05, 8.0, 5.0]]
    {
        let z = 0.3 - DEFLECTION;
        let tyre = |name: &str, x: f64| {
            format!(
                r#"
[forces.{name}]
type = "tyre"
on = "car"
point = [{x}, 0.0, {z}]
radius = 0.3
stiffness = 0.0
smoothing = {SMOOTHING}
road = "road"
lateral = {{ cornering_stiffness = {cornering}, regularization_speed = {regular}, axis = [0.0, 1.0, 0.0] }}
"#
            )
        };
        let [front, rear] = [tyre("front", ENDS[0]), tyre("rear", ENDS[1])];
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
first = {{ mass = 0.0, inertia = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], position = [0.0, 0.0, {z}] }}
second = {{ mass = 0.0, inertia = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], position = [0.0, 0.0, {z}] }}
car = {{ mass = 100.0, inertia = [[30.0, 0.0, 0.0], [0.0, 30.0, 0.0], [0.0, 0.0, 30.0]], position = [0.0, 0.0, {z}] }}
[roads]
road = {{ type = "flat" }}
[joints]
x = {{ type = "translational", between = ["ground", "first"], point = [0.0, 0.0, {z}], axis = [1.0, 0.0, 0.0] }}
y = {{ type = "translational", between = ["first", "second"], point = [0.0, 0.0, {z}], axis = [0.0, 1.0, 0.0] }}
yaw = {{ type = "revolute", between = ["second", "car"], point = [0.0, 0.0, {z}], axis = [0.0, 0.0, 1.0] }}
{front}{rear}
[initial.bodies.car]
velocity = [{speed}, 0.0, 0.0]
angular_velocity = [0.0, 0.0, {spin}]
"#
        ));
        let slope = |_: f64, y: &[f64]| {
            let (sin, cos) = y[2].sin_cos();
            let mut rate = vec![y[3], y[4], y[5], 0.0, 0.0, 0.0];
            for x in ENDS {
                let (u, v) = (y[3] - sin * x * y[5], y[4] + cos * x * y[5]);
                let (along, across) = (u * cos + v * sin, v * cos - u * sin);
                let force = -cornering * onset() * across.atan2(along.hypot(regular));
                rate[3] -= sin * force / 100.0;
                rate[4] += cos * force / 100.0;
                rate[5] += x * force / 30.0;
            }
            rate
        };
        let truth = tight(&slope, &[0.0, 0.0, 0.0, speed, 0.0, spin], &times(END, ROWS));
        for tolerance in [1e-3, 1e-4, 1e-5, 1e-6] {
            let asked = Options {
                channels: vec!["yaw.angle".to_owned()],
                output: OutputTimes::Interval(END / ROWS as f64),
                ..options(Code::ForRadau, tolerance, END)
            };
            let outcome = run_model(&model, &asked);
            let angles = outcome.series("yaw.angle", 0);
            assert_eq!(angles.len(), truth.len());
            let off = angles.iter().zip(&truth).map(|(angle, y)| {
                (angle - y[2]).abs() / (tolerance * (1.0 + y[2].abs().min(std::f64::consts::PI)))
            });
            let worst = off.fold(0.0, f64::max);
            let warnings = &outcome.summary.warnings;
            let warned = warnings.iter().any(|w| w.code == "simulation/amplified-error");
            assert!(
                worst <= 30.0 || (warned && worst <= 400.0),
                "{spin} rad/s at {tolerance:e}: {worst} tolerances, warned {warned}"
            );
        }
    }
}

#[test] // truth: a picometre per second along the wheels changes nothing
fn round_off_of_a_wheel_that_stands_is_no_slip() {
    let steps = |along: f64, code: Code| {
        let z = 0.28;
        let mut text = format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies.car]
mass = 1000.0
inertia = [[300.0, 0.0, 0.0], [0.0, 900.0, 0.0], [0.0, 0.0, 1000.0]]
position = [0.0, 0.0, {z}]
[roads]
road = {{ type = "half_cylinder", radius = 0.05, center = 1000.0 }}
[forces.pull]
type = "point_force"
on = "car"
point = [0.0, 0.0, {z}]
force = [0.0, {{ type = "harmonic", amplitude = 3e3, angular_frequency = 2.0 }}, 0.0]
[initial.bodies.car]
velocity = [{along:e}, 0.0, 0.0]
"#
        );
        for (name, x, y) in [("a", 1.2, 0.7), ("b", 1.2, -0.7), ("c", -1.2, 0.7), ("d", -1.2, -0.7)]
        {
            let tyre = format!(
                r#"
[forces.{name}]
type = "tyre"
on = "car"
point = [{x}, {y}, {z}]
radius = 0.3
stiffness = 5e4
damping = 500.0
smoothing = 1e-4
road = "road"
lateral = {{ cornering_stiffness = 2e4, regularization_speed = 0.5, axis = [0.0, 1.0, 0.0] }}
"#
            );
            text += &tyre;
        }
        run_model(&model_of(&text), &options(code, 1e-5, 5.0)).summary.statistics.steps
    };
    for code in [Code::InflTrap, Code::ForSdirk, Code::ForRadau] {
        assert_eq!(steps(0.0, code), steps(1e-12, code), "{code:?}");
    }
}
