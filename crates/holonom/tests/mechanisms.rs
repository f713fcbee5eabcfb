//! Models of the library against their references.

mod common;

use common::{model, reference};
use holonom::method::Code;

/// Fails when a column differs from the reference by more than `allowed`.
#[track_caller]
fn assert_agrees(name: &str, code: Code, tolerance: f64, allowed: impl Fn(&str) -> f64) {
    let reference = reference(name);
    let outcome = reference.run(&model(name), code, tolerance);
    for (column, difference) in reference.differences(&outcome) {
        let allowed = allowed(&column);
        assert!(
            difference <= allowed,
            "{name} by {code:?} at {tolerance:e}: {column} differs by {difference:.2e}, \
             allowed {allowed:.0e}"
        );
    }
}

#[test] // independent truth: Jacobi elliptic functions
fn the_simple_pendulum_follows_its_exact_solution() {
    for code in common::ALL_CODES {
        assert_agrees("simple_pendulum", code, 1e-9, |_| 1e-6);
    }
}

#[test] // independent truth: minimal coordinates, Radau IIA and DOP853
fn the_stiff_double_pendulum_follows_minimal_coordinates() {
    for name in ["double_pendulum", "double_pendulum_w10", "double_pendulum_rest"] {
        assert_agrees(name, Code::ForSdirk, 1e-9, |_| 1e-7);
    }
}

#[test] // independent truth: 30-digit extrapolation of the published equations
fn andrews_has_its_reference_end_values() {
    let reference = reference("andrews");
    let outcome = reference.run(&model("andrews"), Code::ForSdirk, 1e-10);
    for (((column, _), expected), (_, difference)) in
        reference.columns.iter().zip(&reference.values).zip(reference.differences(&outcome))
    {
        let digits = if column.ends_with("velocity") { 6 } else { 8 };
        let allowed = 0.5 * 10f64.powi(-digits) * expected[0].abs();
        assert!(difference <= allowed, "{column}: {difference:.2e}, allowed {allowed:.2e}");
    }
}

#[test] // independent truth: one equation in the crank angle, DOP853
fn the_slider_crank_follows_its_minimal_coordinate() {
    for code in common::ALL_CODES {
        assert_agrees("slider_crank", code, 1e-8, |_| 1e-5);
    }
}
