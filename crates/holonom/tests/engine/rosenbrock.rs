//! ForRosen, which has one matrix and iterates nothing: what that cannot tell.

use crate::common::integrate::tight;
use crate::common::table::{implicit, times};
use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes, Status};

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
    for (regular, tolerances) in [(1e-2, &[1e-3, 1e-4][..]), (1e-3, &[1e-4])] {
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
            for &tolerance in tolerances {
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

#[test] // independent truth: the spring gives way by less than F/k = 20 nm, so the body goes where the driver does
fn what_a_step_leaves_in_a_stiff_damper_stops_no_run() {
    for [stiffness, damping] in [[1e7, 1e7], [1e9, 1e9], [1e11, 1e11], [1e11, 1e10]] {
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
cart = {{ mass = 1.0, inertia = 1.0, position = [0.0, 0.0] }}
load = {{ mass = 1.0, inertia = 1.0, position = [1.0, 0.0] }}
[joints]
way = {{ type = "translational", between = ["ground", "cart"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
own = {{ type = "translational", between = ["ground", "load"], point = [1.0, 0.0], axis = [1.0, 0.0] }}
[forces.spring]
type = "tsda"
between = ["cart", "load"]
points = [[0.0, 0.0], [1.0, 0.0]]
stiffness = {stiffness:e}
damping = {damping:e}
free_length = 1.0
[drivers.motor]
joint = "way"
coordinate = "translation"
motion = {{ type = "harmonic", amplitude = 0.2, angular_frequency = 10.0 }}
[initial.bodies]
cart = {{ velocity = [2.0, 0.0] }}
load = {{ velocity = [2.0, 0.0] }}
"#
        ));
        for tolerance in [1e-2, 2e-3, 1e-3, 1e-4, 1e-5] {
            let asked = Options {
                channels: vec!["load.position".to_owned()],
                output: OutputTimes::Interval(0.02),
                ..options(Code::ForRosen, tolerance, 3.0)
            };
            let outcome = run_model(&model, &asked);
            let status = outcome.summary.status;
            assert_eq!(status, Status::Completed, "{stiffness:e} {damping:e} {tolerance:e}");
            for (x, t) in outcome.series("load.position", 0).iter().zip(outcome.times()) {
                let off = (x - 1.0 - 0.2 * (10.0 * t).sin()).abs() / tolerance;
                assert!(off <= 30.0, "{stiffness:e} {damping:e} {tolerance:e}: {off} at {t} s");
            }
        }
    }
}
