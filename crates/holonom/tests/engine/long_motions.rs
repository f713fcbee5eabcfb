//! Errors that add up over long motions of several variables, which frozen matrices do not show.

use crate::amplified_errors::{WRONG, warned};
use crate::common::integrate::tight;
use crate::common::table::all_codes;
use crate::common::{model_of, options, run_model};
use holonom::model::{Model, Tolerance};
use holonom::simulation::{Options, OutputTimes};
use std::f64::consts::PI;

/// A pendulum of 1 m, kg and 0.01 kg m² on a cart of so many kilograms, on a spring, N/m; it starts this angle from below.
struct Cart {
    mass: f64,
    stiffness: f64,
    angle: f64,
}

impl Cart {
    /// `metre` units of length are a metre.
    fn model(&self, metre: f64) -> Model {
        let Self { mass, stiffness, angle } = self;
        let [gravity, inertia, own, length] =
            [9.81 * metre, metre * metre, 0.01 * metre * metre, 10.0 * metre];
        model_of(&format!(
            r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -{gravity:e}]
[bodies]
cart = {{ mass = {mass:e}, inertia = {inertia:e}, position = [0.0, 0.0] }}
bob = {{ mass = 1.0, inertia = {own:e}, position = [0.0, -{metre:e}] }}
[joints]
guide = {{ type = "translational", between = ["ground", "cart"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
pin = {{ type = "revolute", between = ["cart", "bob"], point = [0.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "cart"], points = [[-{length:e}, 0.0], [0.0, 0.0]], stiffness = {stiffness:e}, free_length = {length:e} }}
[initial.joints]
pin = {{ angle = {angle:e}, angular_velocity = 0.0 }}
guide = {{ velocity = 0.0 }}
"#
        ))
    }

    /// Place and angle, and their rates.
    fn rate(&self, y: &[f64]) -> Vec<f64> {
        let (sin, cos) = y[1].sin_cos();
        let (whole, own) = (self.mass + 1.0, 1.01);
        let forces = [y[3] * y[3] * sin - self.stiffness * y[0], -9.81 * sin];
        let determinant = whole * own - cos * cos;
        vec![
            y[2],
            y[3],
            (forces[0] * own - cos * forces[1]) / determinant,
            (whole * forces[1] - cos * forces[0]) / determinant,
        ]
    }
}

#[test] // independent truth: the equations of cart and pendulum by DOP853
fn a_pendulum_on_a_cart_is_right_or_warned_of_after_minutes() {
    let cart = |mass, stiffness, angle| Cart { mass, stiffness, angle };
    let mut wrong = 0;
    for (cart, end) in [
        (cart(46.0, 59.0, 1.925), 118.0),
        (cart(0.432, 2.191, 1.243), 213.0),
        (cart(0.145, 0.174, 1.602), 150.0),
    ] {
        let times: Vec<f64> = (0..=400).map(|k| f64::from(k) * end / 400.0).collect();
        let truth = tight(&|_, y: &[f64]| cart.rate(y), &[0.0, cart.angle, 0.0, 0.0], &times);
        let model = cart.model(1.0);
        for code in all_codes() {
            for tolerance in [2e-3, 1e-3] {
                let asked = Options {
                    channels: vec!["bob.angle".to_owned()],
                    output: OutputTimes::Interval(end / 400.0),
                    ..options(code, tolerance, end)
                };
                let outcome = run_model(&model, &asked);
                let off =
                    outcome.series("bob.angle", 0).into_iter().zip(&truth).map(|(angle, y)| {
                        let moved = (y[1] - cart.angle).abs().min(PI);
                        (angle - y[1]).abs() / (tolerance * (1.0 + moved))
                    });
                let worst = off.fold(0.0, f64::max);
                assert!(
                    worst <= WRONG || warned(&outcome.summary),
                    "{code:?}, {tolerance:e}, {} kg: {worst} tolerances",
                    cart.mass
                );
                wrong += usize::from(worst > WRONG);
            }
        }
    }
    assert!(wrong > 20, "{wrong} wrong runs");
}

#[test] // independent truth: a unit of length is what somebody chose; powers of two change no digit
fn errors_that_add_up_do_so_alike_in_all_units() {
    let cart = Cart { mass: 46.0, stiffness: 59.0, angle: 1.925 };
    for code in all_codes() {
        let steps = [1.0, 1.0 / 1024.0, 1024.0].map(|metre| {
            let tolerance = Tolerance { translation: 1e-3 * metre, ..Tolerance::uniform(1e-3) };
            let asked = Options { tolerance, ..options(code, 1e-3, 40.0) };
            run_model(&cart.model(metre), &asked).summary.statistics.steps
        });
        assert!(steps.iter().all(|n| *n == steps[0]), "{code:?}: {steps:?} steps");
    }
}
