//! A body on a stiff radial spring turns about a pivot: steps and errors must not grow with the
//! stiffness, and a run that ends well must be right.

use crate::common::{Outcome, model_of, options, try_run};
use holonom::method::{CODES, Code};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Options, OutputTimes, Status};

const TOLERANCE: f64 = 1e-4;
const GRAVITY: f64 = 9.81;
/// Inertia of arm and body about their centres, kg m².
const INERTIA: f64 = 0.02;
const END: f64 = 1.0;
const ROWS: usize = 50;
/// Angle of the arm from the horizontal and its rate at the start, rad, rad/s.
const START: [f64; 2] = [0.3, 4.0];

/// Elongation, its rate, angle and angular velocity.
type Polar = [f64; 4];

/// Polar equations of motion with the elongation e = r − 1 m as the unknown:
/// ë = r θ̇² − g sin θ − k e − c ė, (J + r²) θ̈ = −2 r ė θ̇ − g r cos θ, m = 1 kg.
fn rate(x: &Polar, k: f64, c: f64, inertia: f64) -> Polar {
    let [e, u, angle, w] = *x;
    let r = 1.0 + e;
    let radial = r * w * w - GRAVITY * angle.sin() - k * e - c * u;
    let turning = (-2.0 * r * u * w - GRAVITY * r * angle.cos()) / (inertia + r * r);
    [u, radial, w, turning]
}

/// The start on the slow manifold: k e + c ė balances the radial force F, and ė = Ḟ / k.
fn slow_start(k: f64, c: f64, inertia: f64) -> Polar {
    let [angle, w] = START;
    let (mut e, mut u) = (0.0, 0.0);
    for _ in 0..20 {
        let r = 1.0 + e;
        let turning = rate(&[e, u, angle, w], k, c, inertia)[3];
        let force = r * w * w - GRAVITY * angle.sin();
        u = (u * w * w + 2.0 * r * w * turning - GRAVITY * angle.cos() * w) / k;
        e = (force - c * u) / k;
    }
    [e, u, angle, w]
}

/// Radau IIA of order 5 with full Newton iterations: the polar equations at `ROWS` equal times.
fn truth(k: f64, c: f64, inertia: f64) -> Vec<Polar> {
    let s = 6.0f64.sqrt();
    let a = [
        [(88.0 - 7.0 * s) / 360.0, (296.0 - 169.0 * s) / 1800.0, (-2.0 + 3.0 * s) / 225.0],
        [(296.0 + 169.0 * s) / 1800.0, (88.0 + 7.0 * s) / 360.0, (-2.0 - 3.0 * s) / 225.0],
        [(16.0 - s) / 36.0, (16.0 + s) / 36.0, 1.0 / 9.0],
    ];
    let steps = 40;
    let h = END / (ROWS * steps) as f64;
    let mut x = slow_start(k, c, inertia);
    let mut rows = vec![x];
    for _ in 0..ROWS {
        for _ in 0..steps {
            let mut stages = [x; 3];
            for _ in 0..6 {
                let f = stages.map(|x| rate(&x, k, c, inertia));
                let mut matrix = vec![vec![0.0; 13]; 12];
                for i in 0..3 {
                    for n in 0..4 {
                        let row = &mut matrix[4 * i + n];
                        row[12] = x[n] - stages[i][n];
                        row[4 * i + n] = 1.0;
                        for j in 0..3 {
                            row[12] += h * a[i][j] * f[j][n];
                            for m in 0..4 {
                                row[4 * j + m] -=
                                    h * a[i][j] * slope(&stages[j], n, m, k, c, inertia);
                            }
                        }
                    }
                }
                let change = solve(matrix);
                for (i, stage) in stages.iter_mut().enumerate() {
                    for n in 0..4 {
                        stage[n] += change[4 * i + n];
                    }
                }
            }
            x = stages[2];
        }
        rows.push(x);
    }
    rows
}

/// ∂rate_n/∂x_m.
fn slope(x: &Polar, n: usize, m: usize, k: f64, c: f64, inertia: f64) -> f64 {
    let [e, u, angle, w] = *x;
    let r = 1.0 + e;
    let mass = inertia + r * r;
    let turning = rate(x, k, c, inertia)[3];
    match (n, m) {
        (0, 1) | (2, 3) => 1.0,
        (1, 0) => w * w - k,
        (1, 1) => -c,
        (1, 2) => -GRAVITY * angle.cos(),
        (1, 3) => 2.0 * r * w,
        (3, 0) => (-2.0 * u * w - GRAVITY * angle.cos() - 2.0 * r * turning) / mass,
        (3, 1) => -2.0 * r * w / mass,
        (3, 2) => GRAVITY * r * angle.sin() / mass,
        (3, 3) => -2.0 * r * u / mass,
        _ => 0.0,
    }
}

/// Gaussian elimination of an augmented matrix.
fn solve(mut a: Vec<Vec<f64>>) -> Vec<f64> {
    let n = a.len();
    for p in 0..n {
        let best = (p..n).max_by(|&i, &j| a[i][p].abs().total_cmp(&a[j][p].abs())).unwrap();
        a.swap(p, best);
        let (above, below) = a.split_at_mut(p + 1);
        for row in below {
            let factor = row[p] / above[p][p];
            for (x, y) in row.iter_mut().zip(&above[p]).skip(p) {
                *x -= factor * y;
            }
        }
    }
    let mut x = vec![0.0; n];
    for p in (0..n).rev() {
        let sum: f64 = (p + 1..n).map(|j| a[p][j] * x[j]).sum();
        x[p] = (a[p][n] - sum) / a[p][p];
    }
    x
}

/// The body on the arm's slider.
fn slider(k: f64, c: f64) -> Model {
    let [e, u, angle, w] = slow_start(k, c, INERTIA);
    let r = 1.0 + e;
    let (sin, cos) = angle.sin_cos();
    model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -{GRAVITY}]
[bodies]
arm = {{ mass = 0.1, inertia = 0.01, position = [0.0, 0.0] }}
body = {{ mass = 1.0, inertia = 0.01, position = [1.0, 0.0] }}
[joints]
pivot = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0] }}
slide = {{ type = "translational", between = ["arm", "body"], point = [0.0, 0.0], axis = [1.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "body"], points_in_body = [[0.0, 0.0], [0.0, 0.0]], stiffness = {k:e}, damping = {c:e}, free_length = 1.0 }}
[initial.bodies]
arm = {{ angle = {angle:e}, angular_velocity = {w:e} }}
body = {{ position = [{:e}, {:e}], angle = {angle:e}, velocity = [{:e}, {:e}], angular_velocity = {w:e} }}
"#,
        r * cos,
        r * sin,
        u * cos - r * w * sin,
        u * sin + r * w * cos,
    ))
}

fn implicit() -> impl Iterator<Item = Code> {
    CODES.iter().filter(|i| !i.code.is_explicit()).map(|i| i.code)
}

/// Largest error of position and velocity of the body against the polar equations, over the
/// tolerance.
fn error(outcome: &Outcome, truth: &[Polar]) -> f64 {
    let mut worst = 0.0f64;
    let all = |channel: &str| [0, 1].map(|i| outcome.series(channel, i));
    let (position, velocity) = (all("body.position"), all("body.velocity"));
    for (row, x) in truth.iter().enumerate().take(position[0].len()) {
        let [e, u, angle, w] = *x;
        let (r, (sin, cos)) = (1.0 + e, angle.sin_cos());
        let p = [r * cos, r * sin];
        let v = [u * cos - r * w * sin, u * sin + r * w * cos];
        for i in 0..2 {
            worst = worst.max((position[i][row] - p[i]).abs() / (1.0 + p[i].abs()));
            worst = worst.max((velocity[i][row] - v[i]).abs() / (1.0 + v[i].abs()));
        }
    }
    worst / TOLERANCE
}

fn with_rows(code: Code) -> Options {
    Options {
        channels: ["body.position", "body.velocity"].map(String::from).to_vec(),
        output: OutputTimes::Interval(END / ROWS as f64),
        ..options(code, TOLERANCE, END)
    }
}

/// The body on the spring alone, tied to nothing else.
fn swing(k: f64, c: f64, spatial: bool) -> Model {
    let [e, u, angle, w] = slow_start(k, c, 0.0);
    let r = 1.0 + e;
    let (sin, cos) = angle.sin_cos();
    let (p, v) = ([r * cos, r * sin], [u * cos - r * w * sin, u * sin + r * w * cos]);
    if spatial {
        return model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, -{GRAVITY}, 0.0]
[bodies]
body = {{ mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.015]], position = [1.0, 0.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "body"], points_in_body = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]], stiffness = {k:e}, damping = {c:e}, free_length = 1.0 }}
[initial.bodies]
body = {{ position = [{:e}, {:e}, 0.0], velocity = [{:e}, {:e}, 0.0], angular_velocity = [1.0, 0.5, 2.0] }}
"#,
            p[0], p[1], v[0], v[1],
        ));
    }
    model_of(&format!(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, -{GRAVITY}]
[bodies]
body = {{ mass = 1.0, inertia = 0.01, position = [1.0, 0.0] }}
[forces]
spring = {{ type = "tsda", between = ["ground", "body"], points_in_body = [[0.0, 0.0], [0.0, 0.0]], stiffness = {k:e}, damping = {c:e}, free_length = 1.0 }}
[initial.bodies]
body = {{ position = [{:e}, {:e}], velocity = [{:e}, {:e}], angular_velocity = 1.0 }}
"#,
        p[0], p[1], v[0], v[1],
    ))
}

/// Powers of ten of the stiffness, N/m.
#[cfg(feature = "long")]
const POWERS: &[i32] = &[3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
#[cfg(not(feature = "long"))]
const POWERS: &[i32] = &[3, 4, 6, 9, 12];

/// Accepted steps and error of a run that ended well, and in another chart than the default without a
/// warning.
type Run = Option<(u64, f64)>;

fn sweep(
    choice: ParametrizationKind,
    code: Code,
    damping: f64,
    inertia: f64,
    build: impl Fn(f64, f64) -> Model,
) -> Vec<Run> {
    let run = |&power: &i32| {
        let k = 10f64.powi(power);
        let c = damping * k;
        let truth = truth(k, c, inertia);
        let options = Options { max_steps: 4000, parametrization: choice, ..with_rows(code) };
        let outcome = try_run(&build(k, c), &options);
        let summary = &outcome.summary;
        let vouched = choice == ParametrizationKind::default() || summary.warnings.is_empty();
        let completed = summary.status == Status::Completed && vouched;
        completed.then(|| (summary.statistics.steps, error(&outcome, &truth)))
    };
    POWERS.iter().map(run).collect()
}

/// From 1e4 N/m on the steps vary by less than a factor of two, and no error exceeds `allowed`.
#[track_caller]
fn assert_independent_of_stiffness(what: &str, code: Code, runs: &[Run], allowed: f64) {
    let name = code.info().name;
    let all: Vec<(u64, f64)> = runs
        .iter()
        .zip(POWERS)
        .map(|(run, power)| run.unwrap_or_else(|| panic!("{what}, {name}: failed at 1e{power}")))
        .collect();
    for ((_, error), power) in all.iter().zip(POWERS) {
        assert!(*error <= allowed, "{what}, {name}: {error:.1} tolerances at 1e{power} N/m");
    }
    let steps = || all.iter().zip(POWERS).filter(|(_, p)| **p >= 4).map(|((steps, _), _)| *steps);
    let (least, most) = (steps().min().unwrap(), steps().max().unwrap());
    assert!(most < 2 * least, "{what}, {name}: {least} to {most} steps");
}

/// A run that ends well is right to within `allowed` tolerances.
#[track_caller]
fn assert_honest(what: &str, code: Code, runs: &[Run], allowed: f64) {
    for (run, power) in runs.iter().zip(POWERS) {
        let Some((steps, error)) = run else { continue };
        let name = code.info().name;
        assert!(
            *error <= allowed,
            "{what}, {name}: {error:.1} tolerances at 1e{power} N/m as a success of {steps} steps"
        );
    }
}

#[test] // independent truth: the polar equations of motion
fn a_damped_slider_needs_steps_that_do_not_know_its_stiffness() {
    for code in implicit() {
        let runs = sweep(ParametrizationKind::default(), code, 0.1, INERTIA, slider);
        assert_independent_of_stiffness("slider", code, &runs, 30.0);
    }
}

#[test] // independent truth: the polar equations of motion
fn an_undamped_slider_is_right_or_fails() {
    for code in implicit() {
        let runs = sweep(ParametrizationKind::default(), code, 0.0, INERTIA, slider);
        assert_honest("slider", code, &runs, 60.0);
    }
}

#[test] // independent truth: the polar equations of motion without the arm
fn a_body_on_a_spring_alone_is_right() {
    for code in implicit() {
        for damping in [0.1, 0.0] {
            for spatial in [false, true] {
                let what = if spatial { "spring in space" } else { "spring in the plane" };
                let build = |k, c| swing(k, c, spatial);
                let runs = sweep(ParametrizationKind::default(), code, damping, 0.0, build);
                assert_honest(what, code, &runs, 60.0);
                // Below 1e4 N/m the spring is not yet stiff against the turning.
                assert!(runs[1..].iter().all(Option::is_some), "{what}, {code:?}: {runs:?}");
            }
        }
    }
}

#[test] // independent truth: the polar equations of motion
fn other_charts_are_right_or_warned() {
    for code in implicit() {
        for choice in [ParametrizationKind::Partitioning, ParametrizationKind::TangentPlane] {
            for damping in [0.1, 0.0] {
                let runs = sweep(choice, code, damping, INERTIA, slider);
                assert_honest(choice.name(), code, &runs, 100.0);
            }
        }
    }
}

/// Inertia of the arm that carries the bushing, kg m².
const ARM: f64 = 0.01;

/// The body on a bushing at the end of an arm that turns.
fn on_bushing(k: f64, c: f64) -> Model {
    let [angle, w] = START;
    let (sin, cos) = angle.sin_cos();
    let (p, v) = ([cos, sin], [-w * sin, w * cos]);
    let (half_sin, half_cos) = (0.5 * angle).sin_cos();
    model_of(&format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, -{GRAVITY}, 0.0]
[bodies]
arm = {{ mass = 0.1, inertia = [[0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, {ARM}]], position = [0.0, 0.0, 0.0] }}
body = {{ mass = 1.0, inertia = [[0.01, 0.0, 0.0], [0.0, 0.02, 0.0], [0.0, 0.0, 0.015]], position = [1.0, 0.0, 0.0] }}
[joints]
pivot = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 0.0, 1.0] }}
[forces]
bushing = {{ type = "bushing", between = ["arm", "body"], point = [1.0, 0.0, 0.0], stiffness = [{k:e}, {k:e}, {k:e}], damping = [{c:e}, {c:e}, {c:e}] }}
[initial.bodies]
arm = {{ euler_parameters = [{half_cos:e}, 0.0, 0.0, {half_sin:e}], angular_velocity = [0.0, 0.0, {w:e}] }}
body = {{ position = [{:e}, {:e}, 0.0], velocity = [{:e}, {:e}, 0.0], angular_velocity = [1.0, 0.5, 2.0] }}
"#,
        p[0], p[1], v[0], v[1],
    ))
}

#[test] // independent truth: the polar equations of motion with the arm
fn a_body_on_a_damped_bushing_that_turns_is_right() {
    for code in implicit() {
        for k in [1e8, 1e10, 1e12] {
            let truth = truth(k, 0.1 * k, ARM);
            let options = Options { max_steps: 4000, ..with_rows(code) };
            let outcome = try_run(&on_bushing(k, 0.1 * k), &options);
            assert_eq!(outcome.summary.status, Status::Completed, "{code:?} at {k:e} N/m");
            let error = error(&outcome, &truth);
            assert!(error <= 30.0, "{code:?} at {k:e} N/m: {error:.1} tolerances");
        }
    }
}
