//! What turns about no fixed axis: a top, bodies that tumble freely, bodies started far from their design
//! orientation.

use crate::common::integrate::space::{
    Pose, Vector, cross, dot, pose, pose_rate, product, scaled, sum, turn, turned, unturned, vector,
};
use crate::common::integrate::{dop853, tight};
use crate::common::table::{
    Bounds, Case, DEFAULT, Kind, TOLERANCES, Table, Truth, all_codes, error, implicit, line,
    measure, run_everything, times, truth,
};
use crate::common::{model_of, options, run_model};
use holonom::method::{Code, DEFAULT_CODE};
use holonom::simulation::{Options, OutputTimes};
use std::f64::consts::TAU;

/// A body with principal axes that turns about a point: Euler parameters and angular velocity in body axes.
#[derive(Debug, Clone, Copy)]
struct Body {
    mass: f64,
    /// Principal moments about the centre of mass, kg m².
    inertia: Vector,
    /// Centre of mass from the fixed point, body axes, m; zero for a free body.
    arm: Vector,
    /// m/s².
    gravity: Vector,
}

impl Body {
    /// Euler's equations about the fixed point, for a centre of mass on a principal axis through it.
    fn rate(&self, y: &[f64]) -> Vec<f64> {
        let (p, w) = (pose(&y[..4]), vector(&y[4..7]));
        let moments = self.moments();
        let weight = scaled(unturned(p, self.gravity), self.mass);
        let torque =
            sum(cross(self.arm, weight), cross(std::array::from_fn(|i| moments[i] * w[i]), w));
        let mut out = pose_rate(p, w).to_vec();
        out.extend((0..3).map(|i| torque[i] / moments[i]));
        out
    }

    /// Moments about the fixed point.
    fn moments(&self) -> Vector {
        let far = dot(&self.arm, &self.arm);
        std::array::from_fn(|i| self.inertia[i] + self.mass * (far - self.arm[i] * self.arm[i]))
    }

    fn energy(&self, y: &[f64]) -> f64 {
        let moments = self.moments();
        let turning: f64 = (0..3).map(|i| 0.5 * moments[i] * y[4 + i] * y[4 + i]).sum();
        turning - self.mass * dot(&self.gravity, &turned(pose(&y[..4]), self.arm))
    }

    fn truths(&self, start: &[f64], times: &[f64]) -> Vec<Truth> {
        let rows = tight(&|_, y| self.rate(y), start, times);
        for y in &rows {
            let drift = self.energy(y) - self.energy(start);
            assert!(drift.abs() < 1e-9 * (1.0 + self.energy(start).abs()), "energy {drift:e}");
        }
        let place = |y: &Vec<f64>| turned(pose(&y[..4]), self.arm).to_vec();
        let speed =
            |y: &Vec<f64>| turned(pose(&y[..4]), cross(vector(&y[4..7]), self.arm)).to_vec();
        vec![
            truth("body.position", Kind::Point, rows.iter().map(place)),
            truth("body.euler_parameters", Kind::Orientation, rows.iter().map(|y| y[..4].to_vec())),
            truth("body.velocity", Kind::Velocity, rows.iter().map(speed)),
            truth("body.angular_velocity", Kind::Velocity, rows.iter().map(|y| ground(y))),
        ]
    }

    /// The model, drawn in the orientation `design` and started in `start`.
    fn text(&self, design: Pose, start: &[f64], joint: bool) -> String {
        let p = pose(&start[..4]);
        let [a, b, c] = self.inertia;
        let w = vector(&start[4..7]);
        let joint = if joint {
            let arm = self.arm.map(|x| 0.0 - x);
            format!(
                "[joints]\npivot = {{ type = \"spherical\", between = [\"ground\", \"body\"], \
                 points_in_body = [[0.0, 0.0, 0.0], {arm:?}] }}"
            )
        } else {
            String::new()
        };
        format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = {:?}
[bodies]
body = {{ mass = {:?}, inertia = [[{a:e}, 0.0, 0.0], [0.0, {b:e}, 0.0], [0.0, 0.0, {c:e}]], position = {:?}, euler_parameters = {design:?} }}
{joint}
[initial.bodies]
body = {{ position = {:?}, euler_parameters = {p:?}, velocity = {:?}, angular_velocity = {:?} }}
"#,
            self.gravity,
            self.mass,
            turned(design, self.arm),
            turned(p, self.arm),
            turned(p, cross(w, self.arm)),
            turned(p, w),
        )
    }
}

/// Angular velocity in ground axes.
fn ground(y: &[f64]) -> Vec<f64> {
    turned(pose(&y[..4]), vector(&y[4..7])).to_vec()
}

const NO_TURN: Pose = [1.0, 0.0, 0.0, 0.0];

/// A start of Euler parameters and angular velocity in body axes.
fn start(p: Pose, w: Vector) -> Vec<f64> {
    p.iter().chain(&w).copied().collect()
}

const TOP: Body = Body {
    mass: 0.5,
    inertia: [4e-4, 4e-4, 5e-4],
    arm: [0.0, 0.0, 0.05],
    gravity: [0.0, 0.0, -9.81],
};

#[test] // independent truth: Euler's equations of the heavy top by DOP853
fn a_spinning_top_keeps_the_tolerance() {
    let y = start(turn([0.3, 0.0, 0.0]), [0.0, 0.0, 24.0 * TAU]);
    let truths = TOP.truths(&y, &times(2.0, 40));
    let case = Case::new(&TOP.text(NO_TURN, &y, true), 2.0, truths);
    let mut table = Table::new("spinning top of 48 turns");
    run_everything(&mut table, "top", &case);
    table.finish();
}

#[test] // independent truth: Euler's equations by DOP853; without a torque about the axis of symmetry its spin is constant
fn slender_bodies_keep_the_tolerance() {
    let mut table = Table::new("slender bodies");
    let weight = [0.0, 0.0, -9.81];
    for (name, inertia, arm, gravity, w) in [
        ("rod on a ball", [8.33e-5, 0.0833, 0.0833], [0.5, 0.0, 0.0], weight, [0.0, 0.2, 2.5]),
        ("ball on an arm", [1e-3, 1e-3, 1e-3], [1.0, 0.0, 0.0], weight, [0.0, 0.0, 2.0]),
        ("wire on a ball", [1e-6, 0.0833, 0.0833], [0.5, 0.0, 0.0], weight, [1.0, 0.5, 2.5]),
        ("rod in flight", [1e-3, 1.0, 1.0], [0.0; 3], [0.0; 3], [3.0, 1.0, 0.5]),
    ] {
        let body = Body { mass: 1.0, inertia, arm, gravity };
        let y = start(turn([0.1, 0.2, 0.3]), w);
        let case = Case::new(
            &body.text(NO_TURN, &y, gravity != [0.0; 3]),
            3.0,
            body.truths(&y, &times(3.0, 30)),
        );
        run_everything(&mut table, name, &case);
    }
    table.finish();
}

#[test] // independent truth: no torque acts about the axis of any rod
fn slender_rods_on_each_other_do_not_begin_to_spin() {
    let rods = r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[patterns.c]
over.i = { from = 0, to = 2 }
bodies."a{i}" = { mass = 0.2, inertia = [[4.2e-6, 0.0, 0.0], [0.0, 4.2e-3, 0.0], [0.0, 0.0, 4.2e-3]], position = ["=(i + 0.5)*0.5", 0.0, 0.0] }
joints."j{i}" = { type = "spherical", between = ["a{i - 1}", "a{i}"], point = ["=i*0.5", 0.0, 0.0] }
initial.bodies."a{i}" = { angular_velocity = [0.0, 0.0, "=1 + 0.3*i"] }
[joints]
j0 = { between = ["ground", "a0"] }
"#;
    for code in all_codes() {
        let order_2 = matches!(code, Code::SspTrap | Code::InflTrap);
        for tolerance in if order_2 { [1e-3, 1e-4] } else { [1e-4, 1e-6] } {
            let names = ["a0", "a1", "a2"];
            let channels = names
                .iter()
                .flat_map(|a| [format!("{a}.angular_velocity"), format!("{a}.euler_parameters")]);
            let options = Options {
                channels: channels.collect(),
                output: OutputTimes::Interval(0.02),
                ..options(code, tolerance, 1.0)
            };
            let run = run_model(&model_of(rods), &options);
            for name in names {
                let series = |quantity: &str, k| run.series(&format!("{name}.{quantity}"), k);
                let w: Vec<_> = (0..3).map(|k| series("angular_velocity", k)).collect();
                let p: Vec<_> = (0..4).map(|k| series("euler_parameters", k)).collect();
                let spin = (0..w[0].len()).map(|row| {
                    let turned = unturned(
                        pose(&[0, 1, 2, 3].map(|k| p[k][row])),
                        [w[0][row], w[1][row], w[2][row]],
                    );
                    turned[0].abs()
                });
                let worst = spin.fold(0.0, f64::max) / tolerance;
                assert!(
                    worst < 60.0,
                    "{code:?} at {tolerance:e}: {name} spins, {worst:.1} tolerances"
                );
            }
            let steps = run.summary.statistics.steps;
            let most = if order_2 { 20_000 } else { 1_000 };
            assert!(steps < most, "{code:?} at {tolerance:e}: {steps} steps");
        }
    }
}

#[test] // independent truth: Euler's equations by DOP853; what disturbs the turn grows some hundred- to thousandfold
fn a_turn_about_the_middle_axis_is_right_or_warned_of() {
    const WRONG: f64 = 100.0;
    let mut table = Table::new("turns about the middle axis");
    for (inertia, w, end) in [
        ([13.1, 20.46, 28.16], [5.7e-4, 8.193, -3.64e-3], 2.42),
        ([0.3776, 0.6726, 1.0014], [2.7e-4, 4.148, 8.0e-4], 3.66),
        ([181.5, 309.8, 422.2], [-8.3e-3, 15.6, -1.7e-3], 1.16),
        ([1014.0, 1484.0, 1807.0], [-0.134, 84.43, 0.165], 0.22),
    ] {
        let body = Body { mass: 1.0, inertia, arm: [0.0; 3], gravity: [0.0; 3] };
        let y = start(NO_TURN, w);
        let truths = body.truths(&y, &times(end, 100));
        let case = Case::new(&body.text(NO_TURN, &y, false), end, truths);
        for code in implicit().into_iter().chain([Code::Dop853]) {
            for &tolerance in &[1e-4, 1e-5, 1e-6] {
                if matches!(code, Code::SspTrap | Code::InflTrap) && tolerance < 1e-4 {
                    continue;
                }
                let run = measure(&case, DEFAULT, code, tolerance);
                // What iterations leave at the start must not be all that the default code is off by.
                let most = if code == DEFAULT_CODE { 20.0 } else { WRONG };
                let bounds = Bounds {
                    position: most,
                    velocity: 2.0 * most,
                    or_warned: code != DEFAULT_CODE,
                    or_stopped: false,
                };
                let line = line(&format!("{:.1} rad/s", w[1]), DEFAULT, code);
                table.run(&line, &format!("{tolerance:.0e}"), &run, bounds);
            }
        }
    }
    table.finish();
}

#[test] // independent truth: Euler's equations by DOP853
fn growth_in_steps_that_only_their_turn_limits_is_warned_of() {
    // DOP853 takes the same steps at all tolerances: so would a second run that may take as long ones.
    let inertia = [1.343735, 1.464425, 1.700006];
    let body = Body { mass: 1.0, inertia, arm: [0.0; 3], gravity: [0.0; 3] };
    let y = start(NO_TURN, [4.195e-7, 8.958939, -4.67e-8]);
    let truths = body.truths(&y, &times(40.0, 100));
    let case = Case::new(&body.text(NO_TURN, &y, false), 40.0, truths);
    let mut table = Table::new("forty seconds about the middle axis");
    for code in all_codes() {
        for tolerance in [1e-3, 1e-4, 1e-5] {
            let run = measure(&case, DEFAULT, code, tolerance);
            let bounds =
                Bounds { position: 100.0, velocity: 200.0, or_warned: true, or_stopped: false };
            table.run(&line("", DEFAULT, code), &format!("{tolerance:.0e}"), &run, bounds);
        }
    }
    table.finish();
}

#[test] // independent truth: a turn about a principal axis is steady, whatever carries it
fn a_body_that_turns_steadily_is_exact() {
    let body = Body {
        mass: 2.0,
        inertia: [1.0, 2.0, 2.8],
        arm: [0.0, 0.0, 0.0],
        gravity: [0.0, 0.0, 0.0],
    };
    let mut table = Table::new("bodies that turn steadily");
    for (name, joint) in [("free", false), ("on a ball joint", true)] {
        let askew = turn([0.2, 0.1, 0.3]);
        let y = start(askew, [0.0, 0.0, 5.0]);
        let times = times(10.0, 20);
        let rows =
            times.iter().map(|t| start(product(askew, turn([0.0, 0.0, 5.0 * t])), [0.0, 0.0, 5.0]));
        let rows: Vec<_> = rows.collect();
        let truths = vec![
            truth("body.euler_parameters", Kind::Orientation, rows.iter().map(|y| y[..4].to_vec())),
            truth("body.angular_velocity", Kind::Velocity, rows.iter().map(|y| ground(y))),
        ];
        let case = Case::new(&body.text(NO_TURN, &y, joint), 10.0, truths);
        for code in all_codes() {
            for tolerance in [1e-2, 1e-3, 1e-4, 1e-6] {
                let run = measure(&case, DEFAULT, code, tolerance);
                let bound = 1e-9 / tolerance;
                let bounds = Bounds {
                    position: bound,
                    velocity: bound,
                    or_warned: false,
                    or_stopped: false,
                };
                let line = line(name, DEFAULT, code);
                table.run(&line, &format!("{tolerance:.0e}"), &run, bounds);
            }
        }
    }
    table.finish();
}

/// Numbers in [−1, 1) from a seed (SplitMix64).
fn random(seed: &mut u64) -> f64 {
    *seed = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let mut z = *seed;
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

fn median(mut values: Vec<f64>) -> f64 {
    values.sort_by(f64::total_cmp);
    f64::midpoint(values[(values.len() - 1) / 2], values[values.len() / 2])
}

#[test] // independent truth: DOP853 on Euler parameters and body rates, tight; as a yardstick at the same tolerance
fn what_tumbles_freely_is_as_exact_as_an_explicit_code_of_order_eight() {
    let body = Body {
        mass: 1.0,
        inertia: [1.0, 2.0, 2.8],
        arm: [0.0, 0.0, 0.0],
        gravity: [0.0, 0.0, 0.0],
    };
    let (end, mut seed) = (10.0, 7);
    let spins: Vec<Vec<f64>> = (0..10)
        .map(|_| {
            let mut next = || std::array::from_fn(|_| random(&mut seed));
            let p = turn(scaled(next(), 2.0));
            start(p, scaled(next(), 5.0))
        })
        .collect();
    let mut table = Table::new("free bodies against DOP853");
    for &tolerance in TOLERANCES {
        // The norm of the engine: half the length of the parts, relative to the start of a step.
        let mut yardstick = Vec::new();
        let mut cases = Vec::new();
        for y0 in &spins {
            let rows = body.truths(y0, &[0.0, end]);
            let norm = |e: &[f64], y: &[f64]| {
                let cosine = dot(&y[..4], &y0[..4]).abs().min(1.0);
                let turned = 2.0 * dot(&e[..4], &e[..4]).sqrt() / (1.0 + 2.0 * cosine.acos());
                let rate = dot(&e[4..], &e[4..]).sqrt() / (1.0 + dot(&y[4..], &y[4..]).sqrt());
                0.5 * turned.hypot(rate) / tolerance
            };
            let (found, _) = dop853(&|_, y| body.rate(y), y0, &[end], &norm);
            let found = &found[0];
            let against = |truth: &Truth, found: &[f64]| {
                error(truth.kind, tolerance, found, &truth.rows[1], &truth.rows[0])
            };
            let p = pose(&found[..4]);
            yardstick.push(against(&rows[1], &p).max(against(&rows[3], &ground(found))));
            cases.push(Case::new(&body.text(NO_TURN, y0, false), end, rows));
        }
        let yardstick = median(yardstick);
        table.note("DOP853", format!("{tolerance:.0e} {yardstick:.2}"));
        for code in all_codes() {
            let runs: Vec<_> =
                cases.iter().map(|case| measure(case, DEFAULT, code, tolerance)).collect();
            let completed = runs.iter().all(|run| run.completed);
            let found = median(runs.iter().map(|run| run.position.max(run.velocity)).collect());
            let steps = median(runs.iter().map(|run| run.steps as f64).collect());
            let line = line("free body", DEFAULT, code);
            table.note(&line, format!("{tolerance:.0e} {found:.2} ({steps} steps)"));
            let allowed = if code == Code::ForRadau { 2.0 } else { 10.0 };
            table.claim(completed && found <= allowed * yardstick, || {
                format!("{line} at {tolerance:.0e}: {:.1} times DOP853's error", found / yardstick)
            });
        }
    }
    table.finish();
}

#[test] // independent truth: Euler's equations, which know no design orientation
fn a_body_started_a_radian_off_its_design_is_as_exact_as_on_it() {
    let free = Body {
        mass: 1.0,
        inertia: [1.0, 2.0, 2.8],
        arm: [0.0, 0.0, 0.0],
        gravity: [0.0, 0.0, 0.0],
    };
    let pendulum = Body { arm: [0.4, 0.0, 0.0], gravity: [0.0, 0.0, -9.81], ..free };
    let mut table = Table::new("a radian off the design");
    let p = turn([0.2, 0.1, 0.3]);
    for (name, body, joint) in [("free", free, false), ("on a ball joint", pendulum, true)] {
        let y = start(p, [3.0, 1.0, 2.5]);
        let truths = body.truths(&y, &times(5.0, 20));
        for code in all_codes() {
            let line = line(name, DEFAULT, code);
            for &tolerance in TOLERANCES {
                let on = Case::new(&body.text(p, &y, joint), 5.0, truths.clone());
                let on = measure(&on, DEFAULT, code, tolerance);
                table.run(&line, &format!("{tolerance:.0e}"), &on, Bounds::usual());
                for axis in [[1.0, 0.0, 0.0], [0.6, 0.0, -0.8], [0.0, -1.0, 0.0]] {
                    let design = product(p, turn(axis));
                    let off = Case::new(&body.text(design, &y, joint), 5.0, truths.clone());
                    let off = measure(&off, DEFAULT, code, tolerance);
                    table.run(&line, "off", &off, Bounds::usual());
                    let alike = off.position <= 1.5 * on.position + 0.5
                        && off.velocity <= 1.5 * on.velocity + 0.5;
                    table.claim(alike, || {
                        format!(
                            "{line} at {tolerance:.0e}, {axis:?}: {:.1}/{:.1} instead of {:.1}/{:.1}",
                            off.position, off.velocity, on.position, on.velocity
                        )
                    });
                }
            }
        }
    }
    table.finish();
}

#[test] // a tableau is only as good as its digits: order 8, and more on a linear problem
fn the_yardstick_has_order_eight() {
    let rate = |_: f64, y: &[f64]| vec![y[1], -y[0]];
    let error = |tolerance: f64| {
        let norm = |e: &[f64], _: &[f64]| dot(e, e).sqrt() / tolerance;
        let (rows, steps) = dop853(&rate, &[0.0, 1.0], &[10.0], &norm);
        ((rows[0][0] - 10f64.sin()).hypot(rows[0][1] - 10f64.cos()), steps as f64)
    };
    let (coarse, fine) = (error(1e-5), error(1e-10));
    let order = (coarse.0 / fine.0).ln() / (fine.1 / coarse.1).ln();
    assert!(order > 7.5, "order {order:.2}: {coarse:?} {fine:?}");
}
