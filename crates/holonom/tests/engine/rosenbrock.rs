//! ForRosen, which has one matrix and iterates nothing: what that cannot tell.

use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes, Status};

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
