//! Stiff problems with published or closed-form solutions, on every implicit stepper, and the paths
//! that only stiff problems take.

use crate::formula::{RADAU_IIA_5, ROSENBROCK_NYSTROM_4, SDIRK4_15, SDIRK4_16};
use crate::method::radau::RadauStepper;
use crate::method::rosenbrock::RosenbrockStepper;
use crate::method::sdirk::SdirkStepper;
use crate::method::stepper::{Rejection, Stepper, StepperOptions};
use crate::method::test_systems::{
    DenseOde, distance, prothero_robinson, robertson, run, run_with, van_der_pol,
};

type Build = fn(usize, StepperOptions) -> Box<dyn Stepper>;

const SDIRK: Build = |n, o| Box::new(SdirkStepper::new(&SDIRK4_15, n, o));
const IMPLICIT: [(&str, Build); 4] = [
    ("SDIRK4/15", SDIRK),
    ("SDIRK4/16", |n, o| Box::new(SdirkStepper::new(&SDIRK4_16, n, o))),
    ("Rosenbrock", |n, o| Box::new(RosenbrockStepper::new(&ROSENBROCK_NYSTROM_4, n, o))),
    ("Radau", |n, o| Box::new(RadauStepper::new(&RADAU_IIA_5, n, o))),
];

fn profiles() -> [(&'static str, StepperOptions); 2] {
    [("thesis", StepperOptions::thesis()), ("improved", StepperOptions::improved(1e-6))]
}

/// Runs `ode` with every implicit stepper in both profiles.
fn on_all(
    ode: fn() -> DenseOde,
    (rtol, atol): (f64, f64),
    w0: &[f64],
    end: f64,
    check: impl Fn(&str, &[f64], u64),
) {
    for (name, build) in IMPLICIT {
        for (profile, options) in profiles() {
            let mut ode = ode().with_tolerance(rtol, atol);
            let mut stepper = build(w0.len(), options);
            let run = run(&mut *stepper, &mut ode, 0.0, w0, end, None);
            let attempts = run.accepted + run.rejected() as u64;
            check(&format!("{name}, {profile}"), &run.w, attempts);
        }
    }
}

#[test] // truth: Hairer & Wanner, Solving ODEs II, and their test set: y₁(2) for ε = 1e-6
fn van_der_pol_with_mu_1e3() {
    for tolerance in [1e-4, 1e-6] {
        let ode = || van_der_pol(1e-6);
        on_all(ode, (tolerance, tolerance), &[2.0, -0.66], 2.0, |name, w, attempts| {
            let error = (w[0] - 1.706_167_732_170_48).abs();
            assert!(error < 200.0 * tolerance, "{name} at {tolerance:e}: error {error:e}");
            assert!(attempts < 3000, "{name} at {tolerance:e}: {attempts} attempts");
        });
    }
}

#[test] // truth: the singular limit ln y − y²/2 = t + C with jumps from ±1 to ∓2, O(ε^⅔) away
fn van_der_pol_with_mu_1e6() {
    let ode = || van_der_pol(1e-12);
    on_all(ode, (1e-6, 1e-6), &[2.0, -0.66], 2.0, |name, w, attempts| {
        let half_period = 1.5 - 2_f64.ln();
        let constant = 2_f64.ln() - 2.0 + 2.0 - 2.0 * half_period;
        // Newton for ln y − y²/2 = constant on the branch y > 1.
        let limit =
            (0..50).fold(1.7_f64, |y, _| y - (y.ln() - 0.5 * y * y - constant) / (1.0 / y - y));
        assert!((w[0] - limit).abs() < 1e-4, "{name}: {} instead of {limit}", w[0]);
        assert!(attempts < 8000, "{name}: {attempts} attempts");
    });
}

#[test] // truth: Mazzia & Magherini, Test Set for IVP Solvers, solution at t = 1e11
fn robertson_over_eleven_decades_of_time() {
    let published =
        [0.208_334_014_970_125_5e-7, 0.833_336_077_033_471_3e-13, 0.999_999_979_166_505];
    on_all(robertson, (1e-6, 1e-12), &[1.0, 0.0, 0.0], 1e11, |name, w, attempts| {
        for (w, published) in w.iter().zip(published) {
            let error = (w / published - 1.0).abs();
            assert!(error < 2e-4, "{name}: {w:e} instead of {published:e}");
        }
        assert!(attempts < 800, "{name}: {attempts} attempts");
    });
}

#[test] // truth: y = sin t for every λ
fn prothero_robinson_is_not_limited_by_lambda() {
    for lambda in [-1e4, -1e6, -1e8] {
        for (name, build) in IMPLICIT {
            let mut ode = prothero_robinson(lambda).with_tolerance(1e-5, 1e-5);
            let mut stepper = build(1, StepperOptions::default());
            let run = run(&mut *stepper, &mut ode, 0.0, &[0.0], 10.0, None);
            let error = (run.w[0] - 10_f64.sin()).abs();
            assert!(error < 5e-4, "{name} with λ = {lambda:e}: error {error:e}");
            // An explicit formula would need some |λ| · 10 / 3.3 steps.
            assert!(run.accepted < 300, "{name} with λ = {lambda:e}: {} steps", run.accepted);
        }
    }
}

#[test] // truth: the closed form of the overdamped oscillator, off and on its slow motion
fn an_oscillator_with_damping_1e6() {
    const C: f64 = 1e6; // ẍ + C ẋ + C x = 0
    let slow = -2.0 * C / (C + (C * C - 4.0 * C).sqrt());
    let fast = C / slow;
    for start in [[1.0, slow], [1.0, 0.0], [0.0, 1.0]] {
        let part = (start[1] - fast * start[0]) / (slow - fast); // of the slow motion
        let ode = || {
            DenseOde::new(
                2,
                |_, w, g| (g[0], g[1]) = (w[1], -C * (w[0] + w[1])),
                |_, _| vec![vec![0.0, 1.0], vec![-C, -C]],
            )
        };
        on_all(ode, (1e-6, 1e-6), &start, 5.0, |name, w, attempts| {
            let exact = part * (5.0 * slow).exp();
            let error = distance(w, &[exact, slow * exact]);
            assert!(error < 1e-5, "{name} from {start:?}: error {error:e}");
            assert!(attempts < 500, "{name} from {start:?}: {attempts} attempts");
        });
    }
}

#[test] // truth: the exact solution; the linearization is wrong on purpose
fn a_diverging_iteration_makes_the_step_shorter() {
    for factor in [-2.9, 0.0] {
        let mut ode = DenseOde::new(
            1,
            |_, y, g| g[0] = -100.0 * y[0],
            move |_, _| vec![vec![-100.0 * factor]],
        );
        let mut stepper = SDIRK(1, StepperOptions::thesis());
        let run =
            run_with(&mut *stepper, &mut ode, 0.0, &[1.0], 0.1, Some(0.1), |_, _, report, _, h| {
                if let Some(Rejection::NewtonDivergence | Rejection::NewtonSlow) = report.cause {
                    assert!(report.next_step <= 0.8 * h && report.next_step > 0.0);
                    assert!(report.error.is_infinite() && report.contraction > 0.0);
                }
            });
        let diverged = run.causes.iter().filter(|c| **c == Rejection::NewtonDivergence).count();
        assert!(diverged > 0, "factor {factor}: {:?}", run.causes);
        assert!((run.w[0] - (-10_f64).exp()).abs() < 1e-5, "factor {factor}: {:?}", run.w);
    }
}

#[test] // truth: with J = 0 in place of −λ corrections of a stage fall by γhλ
fn contraction_is_told() {
    const LAMBDA: f64 = 10.0;
    let mut ode = DenseOde::new(1, |_, y, g| g[0] = -LAMBDA * y[0], |_, _| vec![vec![0.0]])
        .with_tolerance(0.0, 1e-3);
    let options = StepperOptions { fixed_step: true, ..StepperOptions::thesis() };
    let mut stepper = SDIRK(1, options);
    let run = run(&mut *stepper, &mut ode, 0.0, &[1.0], 1.0, Some(0.05));
    let told = stepper.statistics().contractions;
    assert_eq!(told.count, 5 * run.accepted, "stages");
    let factor = SDIRK4_15.gamma * 0.05 * LAMBDA;
    for found in [told.mean(), told.largest] {
        assert!((found - factor).abs() < 1e-6, "{found} in place of {factor}");
    }
}

#[test]
fn a_fast_iteration_keeps_linearization_and_factors() {
    // Linear with constant J: one linearization serves until steps are ten times as long, or for 0.2 · 1e-6^(−1/4) of them.
    let mut ode = prothero_robinson(-1e3);
    let mut stepper = SDIRK(1, StepperOptions::improved(1e-6));
    let run = run(&mut *stepper, &mut ode, 0.0, &[0.0], 10.0, None);
    assert!(run.accepted > 20);
    let (first, longest) = (run.steps[0], run.steps.iter().fold(0.0f64, |m, h| m.max(*h)));
    let decades = (longest / first).log10().ceil() as u64;
    let most = decades.max(1) + run.accepted / 7;
    assert!(ode.linearizations <= most, "{} of {most}", ode.linearizations);
    assert!(ode.factorizations < run.accepted, "{} of {}", ode.factorizations, run.accepted);
}

#[test]
fn an_old_linearization_is_renewed_before_the_step_is_shortened() {
    // J jumps from −1 to −1e5 at t = 1, smoothly within 1e-3: the old J cannot serve there.
    let rate = |t: f64| 1.0 + 0.5e5 * (1.0 + ((t - 1.0) / 1e-3).tanh());
    let mut ode = DenseOde::new(
        1,
        move |t, y, g| g[0] = -rate(t) * (y[0] - t),
        move |t, _| vec![vec![-rate(t)]],
    );
    let options = StepperOptions { reuse_contraction: 0.5, ..StepperOptions::improved(1e-6) };
    let mut stepper = SDIRK(1, options);
    let mut renewed = 0;
    let mut before = 0;
    let run = run_with(&mut *stepper, &mut ode, 0.0, &[0.0], 2.0, None, |_, ode, report, _, _| {
        let iterations = u64::from(report.iterations);
        assert!(ode.linearizations <= before + 1, "at most one linearization per attempt");
        renewed += u64::from(ode.linearizations > before && iterations > 5);
        before = ode.linearizations;
    });
    assert!(renewed > 0 && ode.linearizations < run.accepted);
    assert!((run.w[0] - (2.0 - 1e-5)).abs() < 1e-6, "{:?}", run.w);
}

#[test] // truth: y = sin t; the iteration stagnates at round-off of a sum that cancels
fn noise_of_an_evaluation_is_not_divergence() {
    // Evaluated with an error of about 1e-12, as through constraints; tolerance 1e-11.
    let mut ode = DenseOde::new(
        1,
        |t, y, g| {
            let noise = 1e-9 * ((y[0] * 1e13).sin() + (t * 1e13).cos());
            g[0] = -1e3 * (y[0] - t.sin()) + t.cos() + noise;
        },
        |_, _| vec![vec![-1e3]],
    )
    .with_tolerance(0.0, 1e-9);
    let mut stepper = SDIRK(1, StepperOptions::default());
    let run = run(&mut *stepper, &mut ode, 0.0, &[0.0], 1.0, Some(1e-2));
    assert!(run.causes.iter().all(|c| *c == Rejection::ErrorTooLarge), "{:?}", run.causes);
    assert!((run.w[0] - 1_f64.sin()).abs() < 1e-8, "{:e}", run.w[0] - 1_f64.sin());
}
