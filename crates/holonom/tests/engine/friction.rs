//! Steep friction: what sticks in one step and slides in the next.

use crate::common::integrate::tight;
use crate::common::table::{implicit, times};
use crate::common::{model_of, options, run_model};
use holonom::simulation::{Options, OutputTimes};

/// Of the block, kg, of the force to and fro, N and rad/s, and of the friction, N.
const MASS: f64 = 100.0;
const FORCE: f64 = 4e4;
const RATE: f64 = 9.0;
const CORNERING: f64 = 2e4;
const DEFLECTION: f64 = 0.02;
const SMOOTHING: f64 = 1e-4;
const END: f64 = 6.0;

#[test] // independent truth: the block's one equation by DOP853
fn a_block_that_sticks_and_breaks_loose_is_seen() {
    let times = times(END, 200);
    let onset = 0.5 * (1.0 + DEFLECTION / DEFLECTION.hypot(SMOOTHING));
    for regular in [1e-2, 1e-3] {
        // The lateral force of a tyre without forward speed is dry friction, all but a jump.
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies.block]
mass = {MASS}
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
lateral = {{ cornering_stiffness = {CORNERING}, regularization_speed = {regular}, axis = [0.0, 1.0, 0.0] }}
[forces.pull]
type = "point_force"
on = "block"
point = [0.0, 0.0, {z}]
force = [0.0, {{ type = "harmonic", amplitude = {FORCE}, angular_frequency = {RATE} }}, 0.0]
[initial.bodies.block]
velocity = [0.0, 3.0, 0.0]
"#,
            z = 0.3 - DEFLECTION
        ));
        let rate = |t: f64, y: &[f64]| {
            let friction = CORNERING * onset * y[1].atan2(regular);
            vec![y[1], (FORCE * (RATE * t).sin() - friction) / MASS]
        };
        let truth = tight(&rate, &[0.0, 3.0], &times);
        let fastest = truth.iter().fold(0.0f64, |most, y| most.max(y[1].abs()));
        for code in implicit() {
            for tolerance in [1e-3, 1e-4] {
                let asked = Options {
                    channels: ["block.position", "block.velocity"].map(str::to_owned).to_vec(),
                    output: OutputTimes::Interval(END / 200.0),
                    ..options(code, tolerance, END)
                };
                let outcome = run_model(&model, &asked);
                let places = outcome.series("block.position", 1);
                let speeds = outcome.series("block.velocity", 1);
                let mut worst = [0.0f64; 2];
                for ((x, v), y) in places.iter().zip(&speeds).zip(&truth) {
                    worst[0] = worst[0].max((x - y[0]).abs() / (tolerance * (1.0 + y[0].abs())));
                    worst[1] = worst[1].max((v - y[1]).abs() / (tolerance * (1.0 + fastest)));
                }
                assert!(
                    worst[0] <= 30.0 && worst[1] <= 60.0,
                    "{code:?} at {tolerance:e}, {regular:e} m/s: {worst:?} tolerances"
                );
            }
        }
    }
}
