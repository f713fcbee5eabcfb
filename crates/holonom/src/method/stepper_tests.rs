//! What every stepper owes its caller, run on all of them.

use crate::formula::{DOP853, DOPRI5, RADAU_IIA_5, ROSENBROCK_NYSTROM_4, SDIRK4_15, SDIRK4_16};
use crate::method::adams::AdamsStepper;
use crate::method::explicit_rk::ExplicitRungeKuttaStepper;
use crate::method::interpolate;
use crate::method::ode::Ode;
use crate::method::radau::RadauStepper;
use crate::method::rosenbrock::RosenbrockStepper;
use crate::method::sdirk::SdirkStepper;
use crate::method::stepper::{Rejection, Stepper, StepperOptions, initial_step};
use crate::method::test_systems::{
    DenseOde, distance, failure, kepler, kepler_solution, non_autonomous, non_autonomous_solution,
    run, run_with, van_der_pol,
};

struct Member {
    name: &'static str,
    order: f64,
    embedded: f64,
    /// Order of the global error of dense output.
    dense: f64,
    /// Steps with which the order is visible, asymptotic and above round-off: of the non-autonomous system and Kepler's.
    steps: [u32; 2],
    /// How far below and above its order what is seen may be.
    within: [f64; 2],
    build: fn(usize, StepperOptions) -> Box<dyn Stepper>,
}

const SDIRK15: Member = Member {
    name: "SDIRK4/15",
    order: 4.0,
    embedded: 3.0,
    dense: 4.0,
    steps: [160; 2],
    within: [0.2; 2],
    build: |n, o| Box::new(SdirkStepper::new(&SDIRK4_15, n, o)),
};
const SDIRK16: Member = Member {
    name: "SDIRK4/16",
    build: |n, o| Box::new(SdirkStepper::new(&SDIRK4_16, n, o)),
    ..SDIRK15
};
const ROSENBROCK: Member = Member {
    name: "Rosenbrock-Nyström 4",
    build: |n, o| Box::new(RosenbrockStepper::new(&ROSENBROCK_NYSTROM_4, n, o)),
    ..SDIRK15
};
const RADAU: Member = Member {
    name: "Radau IIA 5",
    order: 5.0,
    steps: [40; 2],
    build: |n, o| Box::new(RadauStepper::new(&RADAU_IIA_5, n, o)),
    ..SDIRK15
};
const EXPLICIT: Member = Member {
    name: "DOPRI5",
    order: 5.0,
    embedded: 4.0,
    dense: 5.0,
    steps: [60; 2],
    within: [0.2; 2],
    build: |n, o| Box::new(ExplicitRungeKuttaStepper::new(&DOPRI5, n, o)),
};
const EXPLICIT8: Member = Member {
    name: "DOP853",
    order: 8.0,
    embedded: 7.0,
    dense: 8.0,
    steps: [16, 10],
    within: [0.4, 0.7],
    build: |n, o| Box::new(ExplicitRungeKuttaStepper::new(&DOP853, n, o)),
};
const ADAMS: Member = Member {
    name: "Adams",
    order: f64::NAN,
    embedded: f64::NAN,
    dense: f64::NAN,
    steps: [0; 2],
    within: [f64::NAN; 2],
    build: |n, o| Box::new(AdamsStepper::new(n, o)),
};
const ONE_STEP: [&Member; 6] = [&SDIRK15, &SDIRK16, &ROSENBROCK, &RADAU, &EXPLICIT, &EXPLICIT8];
const ALL: [&Member; 7] = [&SDIRK15, &SDIRK16, &ROSENBROCK, &RADAU, &EXPLICIT, &EXPLICIT8, &ADAMS];

fn fixed() -> StepperOptions {
    StepperOptions { fixed_step: true, ..StepperOptions::thesis() }
}

/// Largest error at step ends, inside the steps, and the estimate of the first step, with a fixed
/// step; truth is the exact solution.
fn errors(
    member: &Member,
    ode: &mut DenseOde,
    (t0, t1): (f64, f64),
    steps: u32,
    exact: fn(f64) -> [f64; 4],
) -> [f64; 3] {
    let mut stepper = (member.build)(4, fixed());
    let mut found = [0.0, 0.0, f64::NAN];
    let h = (t1 - t0) / f64::from(steps);
    let mut inside = [0.0; 4];
    run_with(&mut *stepper, ode, t0, &exact(t0), t1, Some(h), |stepper, _, report, t, h| {
        assert!(report.accepted, "{}: {:?}", member.name, report.cause);
        if found[2].is_nan() {
            found[2] = report.error;
        }
        found[0] = distance(stepper.end().w, &exact(t + h)).max(found[0]);
        for theta in [0.25, 0.5, 0.75] {
            stepper.interpolate(theta, &mut inside);
            found[1] = distance(&inside, &exact(t + theta * h)).max(found[1]);
        }
    });
    found
}

#[test]
fn one_step_formulas_have_their_orders() {
    let systems: [(&str, fn() -> DenseOde, fn(f64) -> [f64; 4], (f64, f64)); 2] = [
        ("non-autonomous", non_autonomous, non_autonomous_solution, (0.5, 1.5)),
        ("Kepler", kepler, kepler_solution, (0.0, 3.0)),
    ];
    for (place, (system, ode, exact, span)) in systems.into_iter().enumerate() {
        for member in ONE_STEP {
            let coarse = errors(member, &mut ode(), span, member.steps[place], exact);
            let fine = errors(member, &mut ode(), span, 2 * member.steps[place], exact);
            let seen: [f64; 3] = std::array::from_fn(|i| (coarse[i] / fine[i]).log2());
            for (what, seen, order, above) in [
                ("solution", seen[0], member.order, 1.0),
                ("dense output", seen[1], member.dense, 2.0),
                ("estimate", seen[2], member.embedded + 1.0, 1.0),
            ] {
                let name = member.name;
                assert!(
                    (order - member.within[0]..order + above * member.within[1]).contains(&seen),
                    "{name} on {system}, {what}: order {seen:.3} instead of {order}"
                );
            }
        }
    }
}

#[test] // truth: the exact solution
fn errors_follow_the_tolerance() {
    for member in ALL {
        let mut last = f64::INFINITY;
        for exponent in [3, 5, 7, 9] {
            let tolerance = 10_f64.powi(-exponent);
            let mut ode = kepler().with_tolerance(tolerance, tolerance);
            let mut stepper = (member.build)(4, StepperOptions::default());
            let run = run(&mut *stepper, &mut ode, 0.0, &kepler_solution(0.0), 3.0, None);
            let error = distance(&run.w, &kepler_solution(3.0));
            let name = member.name;
            assert!(error < 200.0 * tolerance, "{name} at {tolerance:e}: error {error:e}");
            assert!(error < 0.3 * last, "{name} at {tolerance:e}: error {error:e} after {last:e}");
            last = error;
        }
    }
}

#[test]
fn dense_output_passes_through_both_ends() {
    for member in ALL {
        let mut ode = kepler();
        let mut stepper = (member.build)(4, StepperOptions::default());
        let mut start = kepler_solution(0.0).to_vec();
        let mut inside = vec![0.0; 4];
        run_with(
            &mut *stepper,
            &mut ode,
            0.0,
            &kepler_solution(0.0),
            3.0,
            None,
            |s, _, report, _, _| {
                if report.accepted {
                    // The interpolant of Adams formulas meets the start within the tolerance.
                    let allowed = if member.name == "Adams" { 2e-6 } else { 1e-14 };
                    s.interpolate(0.0, &mut inside);
                    let gap = distance(&inside, &start);
                    assert!(gap < allowed, "{}: {gap:e} at the start", member.name);
                    s.interpolate(1.0, &mut inside);
                    let end = s.end().w.to_vec();
                    assert!(distance(&inside, &end) < 1e-13, "{}", member.name);
                    let mut coefficients = vec![0.0; 4 * (s.largest_degree() + 1)];
                    let degree = s.polynomial(&mut coefficients);
                    coefficients.truncate(4 * (degree + 1));
                    for theta in [0.0, 0.3, 0.8, 1.0] {
                        s.interpolate(theta, &mut inside);
                        let mut same = [0.0; 4];
                        interpolate(&coefficients, theta, &mut same);
                        let apart = distance(&inside, &same);
                        assert!(apart < 1e-14, "{}: polynomials are {apart:e} off", member.name);
                    }
                    start = end;
                }
            },
        );
    }
}

#[test]
fn a_discarded_step_leaves_no_trace() {
    for member in ALL {
        let steps = |detour: bool| {
            let mut ode = kepler();
            let mut stepper = (member.build)(4, StepperOptions::thesis());
            let mut w = kepler_solution(0.0).to_vec();
            let mut g = vec![0.0; 4];
            ode.derivative(0.0, &w, &mut g).unwrap();
            stepper.restart();
            let (mut t, mut h) = (0.0, 1e-3);
            for _ in 0..20 {
                ode.set_weights(&w);
                if detour {
                    assert!(stepper.attempt(&mut ode, t, 0.3 * h, &w, &g).accepted);
                    stepper.discard();
                }
                let shorter = 0.7 * h;
                let report = stepper.attempt(&mut ode, t, shorter, &w, &g);
                h = report.next_step;
                if report.accepted {
                    t += shorter;
                    w.copy_from_slice(stepper.end().w);
                    g.copy_from_slice(stepper.end().slope);
                }
            }
            let mut middle = vec![0.0; 4];
            stepper.interpolate(0.5, &mut middle);
            (t, w, middle)
        };
        let (straight, detour) = (steps(false), steps(true));
        assert_eq!(straight, detour, "{}", member.name);
        let error = distance(&straight.1, &kepler_solution(straight.0));
        assert!(straight.0 > 0.1 && error < 1e-4, "{}: {straight:?}, {error:e}", member.name);
    }
}

#[test]
fn statistics_agree_with_what_the_system_counted() {
    for member in ALL {
        let mut ode = van_der_pol(1e-2).with_tolerance(1e-5, 1e-5);
        let mut stepper = (member.build)(2, StepperOptions::default());
        run(&mut *stepper, &mut ode, 0.0, &[2.0, -0.66], 2.0, None);
        let s = stepper.statistics();
        let name = member.name;
        // The run itself evaluated at the start and for the first step.
        assert_eq!(s.derivatives + 2, ode.derivatives, "{name}");
        assert_eq!(
            (s.linearizations, s.factorizations, s.solves),
            (ode.linearizations, ode.factorizations, ode.solves),
            "{name}"
        );
        assert_eq!(stepper.explicit(), ode.linearizations == 0, "{name}");
    }
}

#[test]
fn a_repeated_attempt_does_not_linearize_again() {
    for member in [&SDIRK15, &SDIRK16, &ROSENBROCK, &RADAU] {
        let mut ode = van_der_pol(1e-4).with_tolerance(1e-4, 1e-4);
        let mut stepper = (member.build)(2, StepperOptions::thesis());
        let mut accepted = 0;
        let run = run_with(
            &mut *stepper,
            &mut ode,
            0.0,
            &[2.0, -0.66],
            2.0,
            Some(0.5), // far too long
            |_, ode, report, _, _| {
                // One linearization per start of a step, however many attempts it takes.
                assert_eq!(ode.linearizations, accepted + 1, "{}", member.name);
                accepted += u64::from(report.accepted);
            },
        );
        let s = stepper.statistics();
        assert!(run.rejected() > 5, "{}: {:?}", member.name, run.causes);
        assert!(s.factorizations > s.linearizations, "{}", member.name);
    }
}

/// ẏ = −1/(2y), y = √(1 − t); not evaluable farther than 1e-3 from the solution, as dependent
/// coordinates are when a stage lies too far from the constraints.
fn root() -> DenseOde {
    DenseOde::fallible(
        1,
        |t, y, g| {
            if (y[0] - (1.0 - t).max(0.0).sqrt()).abs() > 1e-3 {
                return Err(failure("test/outside"));
            }
            g[0] = -0.5 / y[0];
            Ok(())
        },
        |_, y| vec![vec![0.5 / (y[0] * y[0])]],
    )
}

#[test] // truth: the exact solution
fn failed_evaluations_make_the_step_shorter() {
    for member in ALL {
        let mut ode = root();
        let mut stepper = (member.build)(1, StepperOptions::default());
        let run = run_with(
            &mut *stepper,
            &mut ode,
            0.0,
            &[1.0],
            0.9639,
            Some(0.95),
            |_, _, report, _, h| {
                assert!(report.accepted || report.next_step < h);
                assert_eq!(report.accepted, report.cause.is_none());
            },
        );
        let outside = |cause: &Rejection| matches!(cause, Rejection::Evaluation(f) if f.code == "test/outside");
        let name = member.name;
        assert!(run.causes.iter().any(outside), "{name}: {:?}", run.causes);
        assert!((run.w[0] - 0.19).abs() < 1e-4, "{name}: {:?}", run.w);
    }
}

#[test]
fn a_singular_matrix_makes_the_step_shorter() {
    // 1 − γhJ = 0 exactly for SDIRK4/16 with h = 1.
    let mut ode = DenseOde::new(1, |_, y, g| g[0] = 4.0 * y[0], |_, _| vec![vec![4.0]]);
    let mut stepper = (SDIRK16.build)(1, StepperOptions::default());
    let run = run(&mut *stepper, &mut ode, 0.0, &[1.0], 2.0, Some(1.0));
    assert!(matches!(&run.causes[0], Rejection::SingularMatrix(f) if f.code == "test/singular"));
    assert!((run.w[0] / 8_f64.exp() - 1.0).abs() < 1e-4);
}

#[test]
fn runs_repeat_bit_for_bit() {
    for member in ALL {
        let once = || {
            let mut ode = van_der_pol(1e-2);
            let mut stepper = (member.build)(2, StepperOptions::default());
            let run = run(&mut *stepper, &mut ode, 0.0, &[2.0, -0.66], 2.0, None);
            (run.w, run.steps)
        };
        assert_eq!(once(), once(), "{}", member.name);
    }
}

#[test]
fn steps_stay_below_the_largest_step() {
    for member in ALL {
        let options = StepperOptions { max_step: 0.05, ..StepperOptions::default() };
        let mut stepper = (member.build)(4, options);
        let run = run(&mut *stepper, &mut kepler(), 0.0, &kepler_solution(0.0), 3.0, Some(0.01));
        let longest = run.steps.iter().copied().fold(0.0, f64::max);
        assert!(longest <= 0.05 * (1.0 + 1e-9) && run.accepted >= 60, "{}: {longest}", member.name);
    }
}

#[test] // a kinematic run: all motion is prescribed, nothing is integrated
fn systems_without_unknowns_just_advance_in_time() {
    for member in ALL {
        let mut ode = DenseOde::new(0, |_, _, _| (), |_, _| Vec::new());
        let options = StepperOptions { max_step: 0.5, ..StepperOptions::default() };
        let mut stepper = (member.build)(0, options);
        let run = run(&mut *stepper, &mut ode, 0.0, &[], 10.0, None);
        assert_eq!(run.rejected(), 0, "{}", member.name);
        assert!((20..40).contains(&run.accepted), "{}: {} steps", member.name, run.accepted);
    }
}

#[test]
fn the_first_step_avoids_failures_and_does_not_depend_on_the_origin() {
    let first = |offset: f64, allowed: f64| {
        let mut ode = DenseOde::fallible(
            1,
            move |t, y, g| {
                g[0] = -3.0 * (y[0] - offset);
                if t > allowed { Err(failure("test/late")) } else { Ok(()) }
            },
            |_, _| vec![vec![-3.0]],
        )
        .with_tolerance(0.0, 1e-6);
        ode.set_weights(&[0.0]);
        let mut scratch = [vec![0.0], vec![0.0]];
        initial_step(&mut ode, 3, 0.0, &[offset + 1.0], &[-3.0], 1.0, &mut scratch)
    };
    // τ = 1/3 s, slope 3e6 tolerances per second.
    let expected = (0.01 / (3e6 / 3.0_f64)).powf(0.25) / 3.0;
    for (offset, allowed) in [(0.0, 1.0), (1e4, 1.0), (0.0, 1e-12)] {
        let h = first(offset, allowed).unwrap();
        assert!((h / expected - 1.0).abs() < 1e-2, "{h} instead of {expected}");
    }
    assert_eq!(first(0.0, -1.0), Err(failure("test/late")));
}
