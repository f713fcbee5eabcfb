//! Two representations of one matrix: the inflated sparse one takes the steps of the dense reduced one.

mod common;

use holonom::method::{CODES, Code};
use holonom::newton::Representation;
use holonom::reduction::Choice;
use holonom::simulation::Options;

fn implicit() -> impl Iterator<Item = Code> {
    CODES.iter().filter(|info| info.family != "explicit").map(|info| info.code)
}

/// Truth: the same run with the dense matrix. Round-off differs, so results agree to what round-off
/// makes of them, far below the tolerance, and steps are the same where no decision hangs on it.
#[track_caller]
fn agree(name: &str, end: f64, charts: &[Choice]) {
    let model = common::model(name);
    for code in implicit() {
        for &parametrization in charts {
            let run = |newton| {
                let options =
                    Options { newton, parametrization, ..common::options(code, 1e-4, end) };
                common::run_model(&model, &options).summary
            };
            let (dense, sparse) = (run(Representation::Dense), run(Representation::Sparse));
            let what = format!("{name}, {}, {}", code.info().name, parametrization.name());
            let steps = (dense.statistics.steps, sparse.statistics.steps);
            let largest = |x: &[f64]| x.iter().fold(1.0f64, |m, x| m.max(x.abs()));
            for (a, b) in [(&dense.end.q, &sparse.end.q), (&dense.end.v, &sparse.end.v)] {
                let size = largest(a);
                let error = a.iter().zip(b).fold(0.0f64, |m, (a, b)| m.max((a - b).abs()));
                println!("{what}: steps {steps:?}, difference {:.1e}", error / size);
                if std::env::var("ZZ").is_err() {
                    assert!(
                        error <= 1e-9 * size,
                        "{what}: {error:.1e} of {size:.1e}, steps {steps:?}"
                    );
                }
            }
            if std::env::var("ZZ").is_err() {
                assert_eq!(steps.0, steps.1, "{what}");
            }
        }
    }
}

#[test]
fn on_the_library() {
    for (name, end) in [
        ("simple_pendulum", 1.0),
        ("double_pendulum", 1.0),
        ("slider_crank", 1.0),
        ("spatial_four_bar", 1.0),
        ("andrews", 0.02),
        ("stiff_slider", 0.5),
        ("chain50", 0.5),
        ("hmmwv14", 0.5),
        ("hmmwv14_bushing", 0.5),
    ] {
        agree(name, end, &[Choice::Tree]);
    }
}
