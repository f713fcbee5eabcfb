//! Viscoelastic bushings: springs and dampers in series beside a bushing's own, each direction of a spring with an extra state.

use crate::common::{model_of, options, run_from, run_model};
use holonom::analysis::spectrum;
use holonom::io::{Document, Syntax};
use holonom::method::{CODES, Code};
use holonom::model::{ForceKind, Model};
use holonom::newton::Representation;
use holonom::reduction::Coordinates;
use holonom::simulation::{Options, OutputTimes, Problem};
use serde_json::json;

/// Roots −A and −B ± iΩ of s³ + (k₁/c₁) s² + (k₀ + k₁)/m s + k₀k₁/(m c₁), 1/s.
const A: f64 = 3.0;
const B: f64 = 1.5;
const OMEGA: f64 = 11.0;

/// A mass of 1 kg on a standard linear solid along the first axis of the bushing, with its spring extended by `z`.
fn solid(z: f64) -> (Model, [f64; 2]) {
    let [p, q, r] = [A + 2.0 * B, 2.0 * A * B + B * B + OMEGA * OMEGA, A * (B * B + OMEGA * OMEGA)];
    let k0 = r / p;
    let k1 = q - k0;
    let c1 = k1 / p;
    let text = format!(
        r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, 0.0]
[bodies]
mass = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.3, 0.4, 0.0] }}
[joints]
rail = {{ type = "translational", between = ["ground", "mass"], point = [0.0, 0.0, 0.0], axis = [0.6, 0.8, 0.0] }}
[forces.solid]
type = "bushing"
between = ["ground", "mass"]
point = [0.3, 0.4, 0.0]
axes = [[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0]]
stiffness = [{k0:?}, 0.0, 0.0]
branches = {{ only = {{ stiffness = [{k1:?}, 0.0, 0.0], damping = [{c1:?}, 0.0, 0.0] }} }}
[initial.extra_states]
solid = {{ only = {{ extension = [{z:?}, 0.0, 0.0] }} }}
[initial.joints]
rail = {{ displacement = 0.0, velocity = 1.0 }}
"#
    );
    (model_of(&text), [k0, k1])
}

/// x and its rate after time t from 0, at 1 m/s.
fn of_solid(k1: f64, z: f64, t: f64) -> [f64; 2] {
    // P e^(−At) + e^(−Bt) (Q cos Ωt + R sin Ωt) with x(0) = 0, ẋ(0) = 1, ẍ(0) = −k₁ z; Q = −P.
    let p = (2.0 * B - k1 * z) / ((A - B).powi(2) + OMEGA * OMEGA);
    let r = (1.0 + (A - B) * p) / OMEGA;
    let (sin, cos) = (OMEGA * t).sin_cos();
    let (slow, fast) = ((-A * t).exp(), (-B * t).exp());
    let swing = -p * cos + r * sin;
    let turned = OMEGA * (p * sin + r * cos);
    [p * slow + fast * swing, -A * p * slow + fast * (turned - B * swing)]
}

#[test] // independent truth: the closed solution of the third-order equation
fn a_mass_on_a_standard_linear_solid_follows_its_closed_solution() {
    for z in [0.0, 0.05] {
        let (model, [k0, k1]) = solid(z);
        for info in CODES {
            let tolerance = if info.code.is_trapezoidal() { 1e-5 } else { 1e-7 };
            let options = Options {
                output: OutputTimes::Interval(0.1),
                channels: ["mass.position", "mass.velocity", "solid.force", "solid.branch_force"]
                    .map(String::from)
                    .into(),
                ..options(info.code, tolerance, 2.0)
            };
            let run = run_model(&model, &options);
            assert_eq!((run.summary.ndof, run.summary.end.z.len()), (1, 1));
            let [x, v, force, branch] =
                ["mass.position", "mass.velocity", "solid.force", "solid.branch_force"]
                    .map(|channel| run.series(channel, 0));
            for (k, &t) in run.times().iter().enumerate() {
                let [place, speed] = of_solid(k1, z, t);
                // What the branch's spring holds back: m ẍ = −k₀ x − k₁ z, by a difference of the closed solution.
                let rate = (of_solid(k1, z, t + 1e-5)[1] - of_solid(k1, z, t - 1e-5)[1]) / 2e-5;
                let errors = [
                    x[k] - 0.3 - 0.6 * place,
                    v[k] - 0.6 * speed,
                    (force[k] - rate) / (k0 + k1),
                    (branch[k] - rate - k0 * place) / (k0 + k1),
                ];
                for (what, error) in errors.iter().enumerate() {
                    let limit = 30.0 * tolerance;
                    assert!(error.abs() < limit, "{}, {what} at {t}: {error:.1e}", info.name);
                }
            }
            let energy = &run.summary.energy;
            assert!(energy.largest_imbalance < 30.0 * tolerance, "{}: {energy:?}", info.name);
            let last = run.summary.end.z[0];
            let lost = 0.5 + 0.5 * k1 * z * z
                - 0.5 * of_solid(k1, z, 2.0)[1].powi(2)
                - 0.5 * k0 * of_solid(k1, z, 2.0)[0].powi(2)
                - 0.5 * k1 * last * last;
            let ledger = run.summary.end.ledger.dissipated;
            assert!((ledger - lost).abs() < 30.0 * tolerance, "{}: {ledger} of {lost}", info.name);
        }
    }
}

#[test] // independent truth: the roots that stiffnesses and damping were made for
fn the_spectrum_of_a_standard_linear_solid_is_its_three_roots() {
    let problem = Problem::new(solid(0.0).0);
    let found = spectrum(problem.assemble().unwrap()).unwrap().values;
    for (z, root) in found.iter().zip([(-B, OMEGA), (-B, -OMEGA), (-A, 0.0)]) {
        assert!((z.0 - root.0).hypot(z.1 - root.1) < 1e-9, "{found:?}");
    }
    assert_eq!(found.len(), 3);
}

type Matrix = [[f64; 6]; 6];

/// A positive definite matrix with all its couplings.
fn coupled(size: f64, lever: f64, seed: f64) -> Matrix {
    let raw = |i: usize, j: usize| (seed + 3.7 * i as f64 + 1.3 * j as f64).sin();
    let unit = |i: usize| if i < 3 { 1.0 } else { lever };
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            let square: f64 = (0..6).map(|k| raw(i, k) * raw(j, k)).sum();
            let own = if i == j { 2.0 } else { 0.0 };
            size * unit(i) * unit(j) * (square + own)
        })
    })
}

/// Own springs and dampers of a bushing, and those of its branch.
struct Laws {
    stiffness: Matrix,
    damping: Matrix,
    branch: [Matrix; 2],
}

impl Laws {
    fn new() -> Self {
        Self {
            stiffness: coupled(120.0, 0.4, 0.3),
            damping: coupled(0.5, 0.4, 1.1),
            branch: [coupled(200.0, 0.4, 2.0), coupled(12.0, 0.4, 2.9)],
        }
    }

    fn model(&self) -> Model {
        let Self { stiffness, damping, branch: [branch_stiffness, branch_damping] } = self;
        model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
body = {{ mass = 2.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.25]], position = [0.0, 0.0, 0.0] }}
[forces.mount]
type = "bushing"
between = ["ground", "body"]
point = [0.2, -0.1, 0.3]
stiffness_matrix = {stiffness:?}
damping_matrix = {damping:?}
[forces.mount.branches.only]
stiffness_matrix = {branch_stiffness:?}
damping_matrix = {branch_damping:?}
[initial.bodies]
body = {{ angular_velocity = [1.0, -2.0, 3.0], velocity = [0.1, 0.0, 0.2] }}
"#
        ))
    }

    /// Place, Euler parameters, velocity, angular velocity in axes of the body, and extensions after `end` from the same start,
    /// by classical Runge-Kutta with steps of 1e-4 s.
    fn truth(&self, end: f64) -> [f64; 19] {
        let mut y = [0.0; 19];
        y[3] = 1.0;
        y[7..13].copy_from_slice(&[0.1, 0.0, 0.2, 1.0, -2.0, 3.0]);
        let steps = (end / 1e-4).round() as usize;
        let h = end / steps as f64;
        let along = |y: &[f64; 19], k: &[f64; 19], s: f64| -> [f64; 19] {
            std::array::from_fn(|i| y[i] + s * k[i])
        };
        for _ in 0..steps {
            let k1 = self.rates(&y);
            let k2 = self.rates(&along(&y, &k1, 0.5 * h));
            let k3 = self.rates(&along(&y, &k2, 0.5 * h));
            let k4 = self.rates(&along(&y, &k3, h));
            y = std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * (k2[i] + k3[i]) + k4[i]));
        }
        y
    }

    /// Newton and Euler with the wrench of virtual work.
    fn rates(&self, y: &[f64; 19]) -> [f64; 19] {
        const ARM: [f64; 3] = [0.2, -0.1, 0.3];
        let (p, v, w): ([f64; 4], [f64; 3], [f64; 3]) =
            ([y[3], y[4], y[5], y[6]], [y[7], y[8], y[9]], [y[10], y[11], y[12]]);
        let e = [p[1], p[2], p[3]];
        let turn = |x: [f64; 3]| -> [f64; 3] {
            let t = cross(e, x);
            let u = cross(e, t);
            std::array::from_fn(|k| x[k] + 2.0 * (p[0] * t[k] + u[k]))
        };
        let (arm, spin) = (turn(ARM), turn(w));
        let (carried, across) = (cross(spin, arm), cross(spin, e));
        let (mut u, mut rate) = ([0.0; 6], [0.0; 6]);
        for k in 0..3 {
            u[k] = y[k] + arm[k] - ARM[k];
            rate[k] = v[k] + carried[k];
            u[3 + k] = 2.0 * p[0].signum() * e[k];
            rate[3 + k] = p[0].signum() * (p[0] * spin[k] + across[k]);
        }
        let z: [f64; 6] = std::array::from_fn(|k| y[13 + k]);
        let [branch_stiffness, branch_damping] = &self.branch;
        let held = times(branch_stiffness, &z);
        let (elastic, damped) = (times(&self.stiffness, &u), times(&self.damping, &rate));
        let load: [f64; 6] = std::array::from_fn(|k| elastic[k] + damped[k] + held[k]);
        let crept = solved(*branch_damping, held);
        let (force, turning) = ([-load[0], -load[1], -load[2]], [load[3], load[4], load[5]]);
        let (of_force, bent) = (cross(arm, force), cross(e, turning));
        let moment: [f64; 3] =
            std::array::from_fn(|k| of_force[k] - p[0].signum() * (p[0] * turning[k] + bent[k]));
        // Into axes of the body: the conjugate turns back.
        let back = |x: [f64; 3]| -> [f64; 3] {
            let t = cross(e, x);
            let u = cross(e, t);
            std::array::from_fn(|k| x[k] - 2.0 * (p[0] * t[k] - u[k]))
        };
        let (moment, inertia) = (back(moment), [0.1, 0.2, 0.25]);
        let momentum: [f64; 3] = std::array::from_fn(|k| inertia[k] * w[k]);
        let gyroscopic = cross(w, momentum);
        let mut out = [0.0; 19];
        let dot = e[0] * w[0] + e[1] * w[1] + e[2] * w[2];
        let across = cross(e, w);
        out[3] = -0.5 * dot;
        for k in 0..3 {
            out[k] = v[k];
            out[4 + k] = 0.5 * (p[0] * w[k] + across[k]);
            out[7 + k] = force[k] / 2.0 - if k == 2 { 9.81 } else { 0.0 };
            out[10 + k] = (moment[k] - gyroscopic[k]) / inertia[k];
        }
        for k in 0..6 {
            out[13 + k] = rate[k] - crept[k];
        }
        out
    }
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

fn times(a: &Matrix, x: &[f64; 6]) -> [f64; 6] {
    a.map(|row| row.iter().zip(x).map(|(a, x)| a * x).sum())
}

/// A⁻¹x by elimination.
fn solved(mut a: Matrix, mut x: [f64; 6]) -> [f64; 6] {
    for k in 0..6 {
        for i in (0..6).filter(|&i| i != k) {
            let multiple = a[i][k] / a[k][k];
            for j in 0..6 {
                a[i][j] -= multiple * a[k][j];
            }
            x[i] -= multiple * x[k];
        }
    }
    std::array::from_fn(|k| x[k] / a[k][k])
}

/// Largest difference of a run's end from the truth.
fn off(found: &[f64; 19], q: &[f64], z: &[f64]) -> f64 {
    let pairs = found[..7].iter().zip(q).chain(found[13..].iter().zip(z));
    pairs.fold(0.0, |m, (a, b)| m.max((a - b).abs()))
}

#[test] // independent truth: Newton and Euler by Runge-Kutta, with their own kinematics of the bushing
fn a_body_on_a_coupled_viscoelastic_bushing_moves_as_its_equations_say() {
    let laws = Laws::new();
    let (model, truth) = (laws.model(), laws.truth(1.0));
    let coordinates = [Coordinates::Cartesian, Coordinates::Joint];
    for info in CODES {
        let tolerance = if info.code.is_trapezoidal() { 1e-5 } else { 1e-7 };
        for coordinates in coordinates {
            for newton in
                [Representation::Dense, Representation::Sparse, Representation::Simplified]
            {
                if newton == Representation::Simplified && info.code.needs_full_jacobian() {
                    continue;
                }
                let options = Options { coordinates, newton, ..options(info.code, tolerance, 1.0) };
                let run = run_model(&model, &options);
                let end = &run.summary.end;
                let error = off(&truth, &end.q, &end.z);
                let name = info.name;
                assert!(error < 60.0 * tolerance, "{name}, {newton:?}: {error:.1e}");
                let energy = &run.summary.energy;
                assert!(energy.largest_imbalance < 300.0 * tolerance, "{name}: {energy:?}");
            }
        }
    }
}

#[test] // truth: the run that is not interrupted
fn a_run_goes_on_from_a_state_with_branches() {
    let model = Laws::new().model();
    let whole = run_model(&model, &options(Code::ForRadau, 1e-8, 1.0)).summary.end;
    let half = run_model(&model, &options(Code::ForRadau, 1e-8, 0.37)).summary.end;
    assert_eq!(half.z.len(), 6);
    let rest = run_from(&model, &options(Code::ForRadau, 1e-8, 1.0), Some(&half)).summary.end;
    for (a, b) in whole.q.iter().chain(&whole.z).zip(rest.q.iter().chain(&rest.z)) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
}

#[test] // truth: the stiff bushing, to which dampers that hardly move come near, and its own springs, to which fast ones do
fn branches_of_long_and_of_short_times_are_springs_and_nothing() {
    let body = |more: &str, stiffness: f64| {
        model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
arm = {{ mass = 2.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.25]], position = [0.4, 0.0, 0.0] }}
tip = {{ mass = 1.0, inertia = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1]], position = [0.9, 0.0, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "arm"], point = [0.0, 0.0, 0.0], axis = [0.0, 1.0, 0.0] }}
[forces]
rubber = {{ type = "bushing", between = ["arm", "tip"], point = [0.9, 0.0, 0.0], stiffness = {:?}, rotational_stiffness = [500.0, 500.0, 500.0]{more} }}
"#,
            [stiffness; 3]
        ))
    };
    let branch = |damping: f64| {
        let (k, c) = ([3.0e6; 3], [damping; 3]);
        body(&format!(", branches = {{ only = {{ stiffness = {k:?}, damping = {c:?} }} }}"), 1.0e6)
    };
    let end = |model: &Model, code: Code| run_model(model, &options(code, 1e-5, 0.5)).summary;
    for info in CODES.iter().filter(|info| !info.code.is_explicit()) {
        for (found, truth) in [(branch(3.0e12), body("", 4.0e6)), (branch(3.0e-3), body("", 1.0e6))]
        {
            let (found, truth) = (end(&found, info.code), end(&truth, info.code));
            assert_eq!(found.end.z.len(), 3);
            for (a, b) in found.end.q.iter().zip(&truth.end.q) {
                assert!((a - b).abs() < 1e-3, "{}: {a} {b}", info.name);
            }
            // A stiff branch is an independent variable as a stiff spring is.
            let (steps, least) = (found.statistics.steps, truth.statistics.steps);
            assert!(steps <= 4 * least.max(30), "{}: {steps} for {least}", info.name);
        }
    }
}

#[test] // truth: the branches that are stated, and the directions in which they have springs
fn branches_are_read_and_checked() {
    let document = |branches: &str| {
        let text = format!(
            "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, 0.0]\n[bodies]\nb = {{ mass = 1.0, inertia = [[1.0, \
             0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], position = [0.0, 0.0, 0.0] }}\n[forces.mount]\ntype = \
             \"bushing\"\nbetween = [\"ground\", \"b\"]\npoint = [0.0, 0.0, 0.0]\n{branches}\n"
        );
        let mut none = |_: &str| Err("no other file".to_owned());
        Document::parse(&text, Syntax::Toml, "model.toml", &mut none).unwrap()
    };
    let read = |branches: &str| {
        document(branches).build().map(|(model, _)| model).map_err(|errors| errors.render())
    };
    let model = read(
        "branches.slow = { stiffness = [1.0, 0.0, 3.0], damping = [4.0, 0.0, 5.0] }\nbranches.fast = { \
         rotational_stiffness = [0.0, 7.0, 0.0], rotational_damping = [0.0, 0.5, 0.0] }\n[initial.extra_states.mount]\nfast = \
         { rotation = [0.0, 0.25, 0.0] }",
    );
    let model = model.unwrap();
    let ForceKind::Bushing { branches, .. } = &model.forces[0].kind else { panic!() };
    let directions: Vec<Vec<usize>> = branches.iter().map(|b| b.directions().collect()).collect();
    assert_eq!(directions, [vec![0, 2], vec![4]]);
    let problem = Problem::new(model);
    assert_eq!(problem.assemble().unwrap().state.z, [0.0, 0.0, 0.25]);
    // What no file states can be set.
    let plain =
        document("branches.slow = { stiffness = [1.0, 0.0, 3.0], damping = [4.0, 0.0, 5.0] }");
    let set = |branch: &str| {
        let path = format!("initial.extra_states.mount.{branch}.extension");
        plain.with_values(&[(path.as_str(), json!([0.1, 0.0, 0.2]))])
    };
    let set_model = set("slow").unwrap().build().unwrap().0;
    assert_eq!(Problem::new(set_model).assemble().unwrap().state.z, [0.1, 0.2]);
    let errors = set("slwo").unwrap_err().render();
    assert!(errors.contains("did you mean `slow`?"), "{errors}");
    for (branches, expected) in [
        (
            "branches.a = { stiffness = [1.0, 0.0, 0.0] }",
            "`forces.mount.branches.a.damping[0]` is 0",
        ),
        (
            "branches.a = { stiffness = [1.0, 0.0, 0.0], damping = [1.0, 0.0, 0.0], rotational_damping = [0.0, 2.0, 0.0] }",
            "`forces.mount.branches.a.rotational_stiffness[1]` is 0",
        ),
        (
            "branches.a = { damping = [1.0, 0.0, 0.0] }",
            "`forces.mount.branches.a` has no stiffness",
        ),
        (
            "branches.a = { stiffness = [1.0, -1.0, 0.0], damping = [1.0, 1.0, 0.0] }",
            "`forces.mount.branches.a.stiffness[1]` is -1",
        ),
        ("branches.a = { stifness = [1.0, 1.0, 0.0] }", "has no field `stifness`"),
        (
            "branches.a = { stiffness = [1.0, 1.0, 0.0], damping_matrix = [[1.0, 1.0, 0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.0, \
             0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.0, \
             0.0], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0]] }",
            "`forces.mount.branches.a.damping_matrix` is not positive definite",
        ),
        (
            "branches.a = { stiffness = [1.0, 0.0, 0.0], damping = [1.0, 0.0, 0.0] }\n[initial.extra_states]\nmount = 0.5",
            "`initial.extra_states.mount` is a number; expected a table",
        ),
        (
            "branches.a = { stiffness = [1.0, 0.0, 0.0], damping = [1.0, 0.0, 0.0] }\n[initial.extra_states.mount]\nb = { \
             extension = [0.5, 0.0, 0.0] }",
            "names the branch `b`, which is not there",
        ),
        (
            "branches.a = { stiffness = [1.0, 0.0, 0.0], damping = [1.0, 0.0, 0.0] }\n[initial.extra_states.mount]\na = { \
             extension = [0.5, 0.25, 0.0] }",
            "`initial.extra_states.mount.a.extension[1]` is 0.25; expected 0",
        ),
    ] {
        let errors = read(branches).unwrap_err();
        assert!(errors.contains(expected), "{errors}");
    }
}
