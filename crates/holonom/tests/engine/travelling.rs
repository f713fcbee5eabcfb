//! What travels or turns as a whole is as exact within as what stands.
//!
//! Truth: two bodies of reduced mass μ on a spring k and a damper c vibrate against each other by
//! x = e^(−δt) (x₀ cos ωt + (v₀ + δ x₀)/ω sin ωt), δ = c/2μ, ω² = k/μ − δ², however fast their centre of mass is.

use crate::common::table::all_codes;
use crate::common::{model_of, options, run_model};
use holonom::method::Code;
use holonom::simulation::{Options, OutputTimes};

const END: f64 = 3.0;
const STIFFNESS: f64 = 400.0;
const DAMPING: f64 = 2.0;
const RATE: f64 = 0.15;

/// Velocity of the second body against the first, which start unstrained at [`RATE`].
fn relative_rate(t: f64, reduced_mass: f64) -> f64 {
    let decay = DAMPING / (2.0 * reduced_mass);
    let omega = (STIFFNESS / reduced_mass - decay * decay).sqrt();
    let (sin, cos) = (omega * t).sin_cos();
    RATE * (-decay * t).exp() * (cos - decay / omega * sin)
}

/// On rails in the plane.
fn carriages(speed: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
a = {{ mass = 10.0, inertia = 1.0, position = [0.0, 0.0] }}
b = {{ mass = 6.0, inertia = 1.0, position = [1.0, 0.0] }}
[joints]
rail_a = {{ type = "translational", between = ["ground", "a"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
rail_b = {{ type = "translational", between = ["ground", "b"], point = [1.0, 0.0], axis = [1.0, 0.0] }}
[forces]
coupling = {{ type = "tsda", between = ["a", "b"], points = [[0.0, 0.0], [1.0, 0.0]], stiffness = {STIFFNESS:?}, damping = {DAMPING:?}, free_length = 1.0 }}
[initial.bodies]
a = {{ velocity = [{speed:?}, 0.0] }}
b = {{ velocity = [{:?}, 0.0] }}
"#,
        speed + RATE
    )
}

/// Two stages of a rocket in flight, a bushing between them.
fn stages(speed: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
a = {{ mass = 10.0, inertia = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], position = [0.0, 0.0, 0.0] }}
b = {{ mass = 6.0, inertia = [[1.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 2.0]], position = [2.0, 0.0, 0.0] }}
[forces.interstage]
type = "bushing"
between = ["a", "b"]
point = [1.0, 0.0, 0.0]
stiffness = [{STIFFNESS:?}, 900.0, 900.0]
damping = [{DAMPING:?}, 9.0, 9.0]
rotational_stiffness = [900.0, 900.0, 900.0]
rotational_damping = [9.0, 9.0, 9.0]
[initial.bodies]
a = {{ velocity = [{speed:?}, {speed:?}, {speed:?}] }}
b = {{ velocity = [{:?}, {speed:?}, {speed:?}] }}
"#,
        speed + RATE
    )
}

/// Two discs on a line of shafts.
fn shaft(speed: f64) -> String {
    format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
a = {{ mass = 10.0, inertia = [[6.0, 0.0, 0.0], [0.0, 6.0, 0.0], [0.0, 0.0, 10.0]], position = [0.0, 0.0, 0.0] }}
b = {{ mass = 6.0, inertia = [[4.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 6.0]], position = [0.0, 0.0, 1.0] }}
[joints]
bearing_a = {{ type = "revolute", between = ["ground", "a"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
bearing_b = {{ type = "revolute", between = ["ground", "b"], point = [0.0, 0.0, 1.0], axis = [0.0, 0.0, 1.0] }}
[forces]
torsion = {{ type = "rsda", between = ["a", "b"], axis = [0.0, 0.0, 1.0], stiffness = {STIFFNESS:?}, damping = {DAMPING:?} }}
[initial.bodies]
a = {{ angular_velocity = [0.0, 0.0, {speed:?}] }}
b = {{ angular_velocity = [0.0, 0.0, {:?}] }}
"#,
        speed + RATE
    )
}

#[test]
fn vibrations_do_not_know_of_travel() {
    let reduced_mass = 10.0 * 6.0 / 16.0;
    let models: [(&str, fn(f64) -> String, f64, [&str; 2], usize); 3] = [
        ("carriages", carriages, 30.0, ["a.velocity", "b.velocity"], 0),
        ("stages", stages, 300.0, ["a.velocity", "b.velocity"], 0),
        ("shaft", shaft, 300.0, ["a.angular_velocity", "b.angular_velocity"], 2),
    ];
    for (name, build, speed, channels, component) in models {
        let [standing, travelling] = [0.0, speed].map(|speed| model_of(&build(speed)));
        for code in all_codes() {
            let mut all = [0.0; 2];
            for tolerance in [1e-3, 1e-4, 1e-6] {
                let options = Options {
                    channels: channels.map(str::to_owned).to_vec(),
                    output: OutputTimes::Interval(END / 60.0),
                    ..options(code, tolerance, END)
                };
                let [stands, travels] =
                    [&standing, &travelling].map(|model| run_model(model, &options));
                let [a, b] = channels.map(|channel| travels.series(channel, component));
                let off = travels.times().iter().zip(a.iter().zip(&b)).map(|(t, (a, b))| {
                    let truth = relative_rate(*t, reduced_mass);
                    (b - a - truth).abs() / (tolerance * (1.0 + RATE))
                });
                let worst = off.fold(0.0, f64::max);
                let steps = [&stands, &travels].map(|run| run.summary.statistics.steps as f64);
                assert!(worst < 30.0, "{name}, {code:?}, {tolerance:e}: {worst:.1} tolerances");
                // Two bodies may be off against each other by two tolerances, which need fewer steps than one.
                // DEABM's steps double or stay, so that where they double is chance.
                let more = if code == Code::Deabm { 1.15 } else { 1.05 };
                assert!(
                    steps[1] > 0.8 * steps[0] - 2.0 && steps[1] < more * steps[0] + 2.0,
                    "{name}, {code:?}, {tolerance:e}: {steps:?} steps"
                );
                all.iter_mut().zip(steps).for_each(|(all, steps)| *all += steps);
            }
            assert!(
                all[1] < 1.05 * all[0] + 2.0,
                "{name}, {code:?}: {all:?} steps at all tolerances"
            );
        }
    }
}
