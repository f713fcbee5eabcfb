//! Adams formulas against an independent code, and what happens to their history.

use crate::method::adams::AdamsStepper;
use crate::method::ode::Ode;
use crate::method::stepper::{Stepper, StepperOptions};
use crate::method::test_systems::{
    DenseOde, distance, kepler, kepler_solution, pendulum, run, run_with, van_der_pol,
};

/// The restricted three-body problem of Arenstorf: one closed orbit.
fn arenstorf() -> (DenseOde, [f64; 4], f64) {
    const MU: f64 = 0.012277471;
    let slope = |_: f64, y: &[f64], g: &mut [f64]| {
        let (a, b) = (y[0] + MU, y[0] - 1.0 + MU);
        let (d1, d2) = (a.hypot(y[1]).powi(3), b.hypot(y[1]).powi(3));
        let (m1, m2) = ((1.0 - MU) / d1, MU / d2);
        g[0] = y[2];
        g[1] = y[3];
        g[2] = y[0] + 2.0 * y[3] - m1 * a - m2 * b;
        g[3] = y[1] - 2.0 * y[2] - (m1 + m2) * y[1];
    };
    let start = [0.994, 0.0, 0.0, -2.0015851063790825];
    (DenseOde::new(4, slope, |_, _| Vec::new()), start, 17.06521656015796)
}

fn stepper(n: usize) -> AdamsStepper {
    AdamsStepper::new(n, StepperOptions::default())
}

/// Evaluations and error of SciPy's VODE (method "adams", order 12, both tolerances equal) at
/// 1e-3, 1e-4, …: an independent code of the same kind.
const VODE_PENDULUM: [(u64, f64); 8] = [
    (147, 7.88e-2),
    (255, 1.25e-2),
    (250, 3.19e-4),
    (340, 1.53e-5),
    (410, 9.25e-6),
    (576, 1.48e-6),
    (644, 2.77e-8),
    (852, 2.17e-8),
];
const VODE_ARENSTORF: [(u64, f64); 8] = [
    (244, 1.80),
    (320, 1.46),
    (517, 0.878),
    (689, 0.204),
    (860, 5.48e-3),
    (1155, 5.08e-4),
    (1482, 1.42e-4),
    (1826, 1.25e-5),
];

#[test] // truth: the closed orbit of Arenstorf; the pendulum at t = 20 by DOP853 at 2.5e-14
fn needs_no_more_evaluations_than_another_code() {
    let (orbit, start, period) = arenstorf();
    let problems = [
        ("Arenstorf", orbit, start.to_vec(), period, start.to_vec(), VODE_ARENSTORF),
        (
            "pendulum",
            pendulum(),
            vec![2.0, 0.0],
            20.0,
            vec![-1.6445675165126934, -0.827577840943059],
            VODE_PENDULUM,
        ),
    ];
    for (name, mut ode, start, end, truth, others) in problems {
        // Work against error at three tolerances per decade.
        let mut work = Vec::new();
        for third in 6..=36 {
            let tolerance = 10_f64.powf(-f64::from(third) / 3.0);
            ode = ode.with_tolerance(tolerance, tolerance);
            ode.derivatives = 0;
            let run = run(&mut stepper(start.len()), &mut ode, 0.0, &start, end, None);
            work.push((ode.derivatives, distance(&run.w, &truth)));
        }
        // Where the other code follows the solution at all, whose size is 1.
        let follows: Vec<_> = (3..).zip(others).filter(|(_, other)| other.1 < 0.5).collect();
        assert!(follows.len() >= 5, "{name}: {}", follows.len());
        for (exponent, (evaluations, error)) in follows {
            let at_equal_tolerance = work[3 * (exponent - 2)].0;
            let at_equal_error = work.iter().filter(|w| w.1 <= error).map(|w| w.0).min();
            let found = at_equal_error.unwrap_or(u64::MAX).max(at_equal_tolerance);
            assert!(
                10 * found <= 13 * evaluations,
                "{name} at 1e-{exponent}: {at_equal_tolerance} at equal tolerance, \
                 {at_equal_error:?} at equal error, the other code {evaluations}"
            );
        }
    }
}

#[test] // truth: the integral, arsinh
fn an_abrupt_change_between_smooth_ones_is_as_exact_as_they_are() {
    for sharpness in [1e-2, 1e-3, 1e-4] {
        for tolerance in [1e-4, 1e-6, 1e-8] {
            // What passes a point at a small distance; it comes from and goes to where nothing happens.
            let slope = move |t: f64, _: &[f64], g: &mut [f64]| {
                g[0] = 1.0 / (t - 1.0).hypot(sharpness);
            };
            let mut ode =
                DenseOde::new(1, slope, |_, _| Vec::new()).with_tolerance(tolerance, tolerance);
            let found = run(&mut stepper(1), &mut ode, 0.0, &[0.0], 2.0, None);
            let truth = 2.0 * (1.0 / sharpness).asinh();
            let off = (found.w[0] - truth).abs() / (tolerance * (1.0 + truth));
            assert!(off < 10.0, "{sharpness:e} at {tolerance:e}: {off} tolerances");
        }
    }
}

#[test]
fn orders_follow_the_tolerance() {
    let mean_order = |tolerance: f64| {
        let mut ode = kepler().with_tolerance(tolerance, tolerance);
        let (mut sum, mut count) = (0.0, 0.0);
        let start = kepler_solution(0.0);
        run_with(&mut stepper(4), &mut ode, 0.0, &start, 12.0, None, |s, _, _, _, _| {
            assert!((1..=12).contains(&s.order()));
            sum += f64::from(s.order());
            count += 1.0;
        });
        sum / count
    };
    let orders = [mean_order(1e-3), mean_order(1e-7), mean_order(1e-11)];
    assert!(orders[0] + 1.0 < orders[1] && orders[1] + 1.0 < orders[2], "{orders:?}");
}

#[test] // truth: the exact solution between the steps
fn dense_output_is_as_good_as_the_steps() {
    let tolerance = 1e-8;
    let mut ode = kepler().with_tolerance(tolerance, tolerance);
    let (mut ends, mut inside) = (0.0_f64, 0.0_f64);
    let mut w = [0.0; 4];
    let start = kepler_solution(0.0);
    run_with(&mut stepper(4), &mut ode, 0.0, &start, 6.0, None, |s, _, report, t, h| {
        if report.accepted {
            ends = ends.max(distance(s.end().w, &kepler_solution(t + h)));
            for theta in [0.1, 0.5, 0.9] {
                s.interpolate(theta, &mut w);
                inside = inside.max(distance(&w, &kepler_solution(t + theta * h)));
            }
        }
    });
    assert!(inside < 2.0 * ends && ends < 100.0 * tolerance, "{inside:e}, {ends:e}");
}

/// Runs Kepler's problem with a caller that changes each accepted state.
fn run_changed(change: impl Fn(&mut [f64]), evaluate: bool) -> (u64, Vec<f64>) {
    let mut ode = kepler().with_tolerance(1e-8, 1e-8);
    let mut stepper = stepper(4);
    let (mut t, mut h) = (0.0, 1e-4);
    let (mut w, mut g) = (kepler_solution(0.0), [0.0; 4]);
    ode.derivative(t, &w, &mut g).unwrap();
    stepper.restart();
    let mut attempts = 0;
    while t < 6.0 {
        ode.set_weights(&w);
        let step = f64::min(h, 6.0 - t);
        let report = stepper.attempt(&mut ode, t, step, &w, &g);
        attempts += 1;
        h = report.next_step;
        if report.accepted {
            t += step;
            w.copy_from_slice(stepper.end().w);
            g.copy_from_slice(stepper.end().slope);
            change(&mut w);
            if evaluate {
                ode.derivative(t, &w, &mut g).unwrap();
            }
        }
    }
    (attempts, w.to_vec())
}

#[test] // truth: the exact solution
fn a_caller_may_project_accepted_states() {
    let (plain, _) = run_changed(|_| (), false);
    // Velocities scaled to the exact energy, as a projection onto an invariant does.
    let project = |w: &mut [f64]| {
        let kinetic = -0.5 + 1.0 / w[0].hypot(w[1]);
        let factor = (2.0 * kinetic).sqrt() / w[2].hypot(w[3]);
        w[2] *= factor;
        w[3] *= factor;
    };
    for evaluate in [true, false] {
        let (attempts, w) = run_changed(project, evaluate);
        let error = distance(&w, &kepler_solution(6.0));
        assert!(error < 1e-6, "evaluated again: {evaluate}, error {error:e}");
        assert!(attempts * 10 < plain * 12, "{attempts} attempts instead of {plain}");
    }
}

#[test]
fn stiffness_is_reported() {
    let options = StepperOptions { caution: 4.0, ..StepperOptions::default() };
    let mut stiff = AdamsStepper::new(2, options);
    let taken = run(&mut stiff, &mut van_der_pol(1e-3), 0.0, &[2.0, -0.66], 0.5, None).accepted;
    let found = stiff.statistics();
    // As warned of.
    assert!(found.stiff_steps > taken / 10 && found.stiff_steps > 50, "{found:?}");
    let mut smooth = AdamsStepper::new(4, options);
    let taken = run(&mut smooth, &mut kepler(), 0.0, &kepler_solution(0.0), 60.0, None).accepted;
    assert!(taken > 500, "{taken}");
    assert_eq!(smooth.statistics().stiff_steps, 0);
}
