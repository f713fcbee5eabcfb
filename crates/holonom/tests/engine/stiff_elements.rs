//! Rotational springs, bushings and springs from soft to nearly rigid, on bodies at rest, swinging and turning:
//! errors within bounds, and steps that do not know the stiffness.

use crate::common::integrate::radau;
use crate::common::table::{
    Bounds, Case, DEFAULT, Figures, Kind, OTHERS, TOLERANCES, Table, attempts, codes_of, error,
    implicit, line, measure,
};
use crate::common::{model_of, options, run_model, try_run};
use crate::stiff_systems::Motion::{self, Swinging, Turning};
use crate::stiff_systems::{
    Build, Stiffness, bushed, elbow, four_bar, hinge, planar_spring, spatial_spring, three,
};
use holonom::method::{Code, DEFAULT_CODE, Profile};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Options, OutputTimes, Status};
use std::fmt::Write as _;

/// Powers of ten of the stiffness, N/m or N m/rad.
#[cfg(feature = "long")]
const POWERS: &[i32] = &[3, 4, 5, 6, 7, 8, 9, 10, 11, 12];
#[cfg(not(feature = "long"))]
const POWERS: &[i32] = &[6, 9];

/// Motion, damping over stiffness in seconds, and whether the run starts on the slow manifold. Off it without
/// damping, a stiff oscillation would have to be followed for ever.
#[cfg(feature = "long")]
const STARTS: &[(Motion, f64, bool)] = &[
    (Motion::Rest, 0.0, true),
    (Motion::Rest, 1e-3, true),
    (Motion::Rest, 0.1, true),
    (Motion::Rest, 1e-3, false),
    (Motion::Rest, 0.1, false),
    (Swinging, 0.0, true),
    (Swinging, 1e-3, true),
    (Swinging, 0.1, true),
    (Swinging, 1e-3, false),
    (Swinging, 0.1, false),
    (Turning, 0.0, true),
    (Turning, 1e-3, true),
    (Turning, 0.1, true),
    (Turning, 1e-3, false),
    (Turning, 0.1, false),
];
#[cfg(not(feature = "long"))]
const STARTS: &[(Motion, f64, bool)] =
    &[(Swinging, 0.0, true), (Swinging, 1e-3, false), (Turning, 0.1, true)];

/// Steps above which ratios of step counts mean something: near a state of rest a few more cost nothing.
const FEW: u64 = 10;

/// Bounds of a run on a stiff element. The trapezoidal rule does not damp what is off the slow manifold: it may
/// say that it needs more steps than allowed here.
fn bounds(code: Code, on: bool) -> Bounds {
    let usual = Bounds::of(DEFAULT, code, true);
    let trapezoidal = matches!(code, Code::SspTrap | Code::InflTrap);
    Bounds { or_stopped: trapezoidal && !on, ..usual }
}

/// The sweep over stiffnesses of one element in all motions.
fn sweep(table: &mut Table, name: &str, build: Build) {
    for &(motion, seconds, on) in STARTS {
        let stiff = |power: i32| Stiffness { k: 10f64.powi(power), seconds, on };
        let cases: Vec<_> =
            POWERS.iter().map(|&power| (power, build(&stiff(power), motion))).collect();
        let start = if on { "" } else { ", off the slow manifold" };
        let name = format!("{name}, {motion:?}, {seconds:e} s{start}");
        for code in implicit() {
            for &tolerance in TOLERANCES {
                let line = format!("{} {tolerance:.0e}", line(&name, DEFAULT, code));
                let mut steps = Vec::new();
                for (power, case) in &cases {
                    let max_steps = if tolerance < 1e-5 { 30_000 } else { 6000 };
                    let case = Case { max_steps, ..case.clone() };
                    let run = measure(&case, DEFAULT, code, tolerance);
                    table.run(&line, &format!("1e{power}"), &run, bounds(code, on));
                    if *power >= 4 && run.completed {
                        steps.push(run.steps.max(FEW));
                    }
                }
                let (least, most) = (steps.iter().min(), steps.iter().max());
                if let (Some(&least), Some(&most), true) = (least, most, on && seconds > 0.0) {
                    table
                        .claim(2 * most < 5 * least, || format!("{line}: {least} to {most} steps"));
                }
            }
        }
        for manner in OTHERS {
            let codes = if cfg!(feature = "long") {
                vec![Code::ForRadau, Code::ForSdirk, Code::SspTrap, Code::InflSdirk]
            } else {
                codes_of(manner)
            };
            for code in codes {
                for (power, case) in &cases {
                    // A model that is too stiff for these charts costs steps: enough to see it.
                    let case = Case { max_steps: 1000, ..case.clone() };
                    let run = measure(&case, manner, code, 1e-4);
                    let line = format!("{} 1e-4", line(&name, manner, code));
                    table.run(&line, &format!("1e{power}"), &run, Bounds::of(manner, code, true));
                }
            }
        }
    }
}

#[test] // independent truth: minimal coordinates, Radau IIA
fn rotational_springs_keep_the_tolerance() {
    let mut table = Table::new("rotational springs");
    sweep(&mut table, "elbow", elbow);
    table.finish();
}

#[test] // independent truth: minimal coordinates, Radau IIA
fn bushings_keep_the_tolerance() {
    let mut table = Table::new("bushings");
    sweep(&mut table, "bushing", bushed);
    table.finish();
}

#[test] // independent truth: minimal coordinates, Radau IIA
fn the_matrix_of_a_transient_is_not_believed_after_it() {
    let mut table = Table::new("nearly rigid bushings off the slow manifold");
    // 0.1 m/s is stopped within 1e-11 s, at 1e10 m/s².
    for (k, seconds) in [(1e11, 0.1), (1e12, 1e-3)] {
        let case = bushed(&Stiffness { k, seconds, on: false }, Swinging);
        let case = Case { max_steps: 6000, ..case };
        for code in implicit() {
            for tolerance in [1e-3, 1e-4] {
                let run = measure(&case, DEFAULT, code, tolerance);
                let line = format!("{} {tolerance:.0e}", line("bushing", DEFAULT, code));
                table.run(&line, &format!("{k:.0e}"), &run, bounds(code, false));
            }
        }
    }
    table.finish();
}

#[test] // independent truth: Lagrange's equations in six coordinates, Radau IIA
fn hinges_of_two_bushings_keep_the_tolerance() {
    let mut table = Table::new("hinges of two bushings");
    sweep(&mut table, "hinge of bushings", hinge);
    table.finish();
}

#[test] // independent truth: Lagrange's equations in six coordinates, Radau IIA; by estimates alone they are 40 to 82 off
fn sdirk_codes_know_where_stiffness_takes_their_order() {
    let mut table = Table::new("a turning hinge of two bushings");
    let case = hinge(&Stiffness { k: 1e7, seconds: 0.0, on: true }, Turning);
    for code in implicit().into_iter().filter(|code| code.info().formula.starts_with("sdirk")) {
        let run = measure(&case, DEFAULT, code, 1e-6);
        let line = line("hinge of bushings", DEFAULT, code);
        table.run(&line, "1e7", &run, bounds(code, true));
    }
    table.finish();
}

#[test] // independent truth: minimal coordinates, Radau IIA
fn springs_keep_the_tolerance() {
    let mut table = Table::new("springs");
    sweep(&mut table, "spring in the plane", planar_spring);
    sweep(&mut table, "spring in space", spatial_spring);
    table.finish();
}

#[test] // independent truth of the errors: minimal coordinates, Radau IIA
fn loops_of_bushings_take_as_many_steps_at_any_stiffness() {
    let mut table = Table::new("steps at 1e9 and 1e6 N per m");
    let cases: [(&str, Build, Motion); 5] = [
        ("four-bar with bushed coupler", four_bar, Swinging),
        ("four-bar with bushed coupler", four_bar, Turning),
        ("body bushed to a crank", bushed, Turning),
        ("hinge of bushings", hinge, Swinging),
        ("hinge of bushings", hinge, Turning),
    ];
    for (name, build, motion) in cases {
        let dampings: &[f64] = if cfg!(feature = "long") { &[1e-3, 0.1] } else { &[0.1] };
        for &seconds in dampings {
            let [soft, stiff] =
                [1e6, 1e9].map(|k| build(&Stiffness { k, seconds, on: true }, motion));
            for code in implicit() {
                for &tolerance in TOLERANCES {
                    let name = format!("{name}, {motion:?}, {seconds:e} s");
                    let line = format!("{} {tolerance:.0e}", line(&name, DEFAULT, code));
                    let run = |case: &Case| measure(case, DEFAULT, code, tolerance);
                    let runs: [Figures; 2] = [run(&soft), run(&stiff)];
                    let bounds = Bounds::of(DEFAULT, code, true);
                    table.run(&line, "1e6", &runs[0], bounds);
                    table.run(&line, "1e9", &runs[1], bounds);
                    let few = 2 * runs[1].steps <= 3 * runs[0].steps.max(FEW);
                    table.claim(few, || {
                        format!("{line}: {} steps instead of {}", runs[1].steps, runs[0].steps)
                    });
                }
            }
        }
    }
    table.finish();
}

#[test] // independent truth: x = p (t − c/k)/k under a force p t, after a transient of 1 ms
fn rows_between_steps_are_as_good_as_their_ends_beside_a_stiff_spring() {
    let model = model_of(
        r#"
holonom = 1
dimension = "planar"
gravity = [0.0, 0.0]
[bodies]
slider = { mass = 1.0, inertia = 0.01, position = [0.0, 0.0] }
[joints]
slide = { type = "translational", between = ["ground", "slider"], point = [0.0, 0.0], axis = [1.0, 0.0] }
[forces]
stop = { type = "tsda", between = ["ground", "slider"], points = [[1.0, 0.0], [0.0, 0.0]], stiffness = 1e6, damping = 1e3, free_length = 1.0 }
push = { type = "point_force", on = "slider", point = [0.0, 0.0], direction = [1.0, 0.0], force = { type = "polynomial", coefficients = [0.0, 200.0] } }
"#,
    );
    for code in implicit() {
        for tolerance in [1e-4, 1e-6, 1e-8] {
            let options = Options {
                channels: ["slider.position", "slider.velocity"].map(String::from).to_vec(),
                output: OutputTimes::Interval(0.01),
                max_steps: 100_000,
                ..options(code, tolerance, 1.0)
            };
            let outcome = run_model(&model, &options);
            let series = ["slider.position", "slider.velocity"].map(|name| outcome.series(name, 0));
            for (k, t) in outcome.times().iter().enumerate().filter(|(_, t)| **t > 0.05) {
                let off = [2e-4 * (t - 1e-3), 2e-4].map(|x| x / tolerance);
                let off = [0, 1].map(|i| (series[i][k] / tolerance - off[i]).abs());
                let right = off[0] < 1.0 && off[1] < 5.0;
                assert!(right, "{code:?} {tolerance:e}, t = {t}: {off:?} tolerances");
            }
        }
    }
}

/// A four-bar about a skew axis whose coupler is held by bushings, or by hinges, at both ends; bodies are drawn along the
/// ground's axes, or along that axis.
fn skew_four_bar(axis: [f64; 3], bushed: Option<f64>) -> String {
    let add = |a: [f64; 3], b: [f64; 3], by: f64| std::array::from_fn(|k| a[k] + by * b[k]);
    let cross = |a: [f64; 3], b: [f64; 3]| -> [f64; 3] {
        std::array::from_fn(|k| a[(k + 1) % 3] * b[(k + 2) % 3] - a[(k + 2) % 3] * b[(k + 1) % 3])
    };
    let unit = |a: [f64; 3]| a.map(|x| x / a.iter().map(|x| x * x).sum::<f64>().sqrt());
    let h = unit(axis);
    let b = unit(cross([0.0, 1.0, 0.3], h));
    let c = cross(h, b);
    let in_plane = |x: f64, y: f64| -> [f64; 3] { add(b.map(|b| x * b), c, y) };
    // Lengths 0.3, 0.9 and 0.7 m over a base of 1 m.
    let (crank, far): ([f64; 3], [f64; 3]) = (in_plane(0.18, 0.24), in_plane(1.0, 0.0));
    let d = (0.82f64.powi(2) + 0.24f64.powi(2)).sqrt();
    let along = (0.81 - 0.49 + d * d) / (2.0 * d);
    let up = (0.81 - along * along).sqrt();
    let (u, v) = (0.82 / d, -0.24 / d);
    let pin = in_plane(0.18 + along * u - up * v, 0.24 + along * v + up * u);
    let body = |name: &str, mass: f64, [p, q]: [[f64; 3]; 2]| {
        let rod: [f64; 3] = add(q, p, -1.0);
        let square: f64 = rod.iter().map(|x| x * x).sum();
        let row = |i: usize| -> [f64; 3] {
            std::array::from_fn(|j| {
                let own = f64::from(u8::from(i == j));
                mass * ((own * square - rod[i] * rod[j]) / 12.0 + 1e-3 * own)
            })
        };
        let center: [f64; 3] = add(p, rod, 0.5);
        format!(
            "{name} = {{ mass = {mass:.1}, inertia = {:?}, position = {center:?} }}\n",
            [0, 1, 2].map(row)
        )
    };
    let o = [0.0; 3];
    let bodies = body("crank", 1.5, [o, crank])
        + &body("coupler", 1.0, [crank, pin])
        + &body("rocker", 0.8, [far, pin]);
    let hinge = |name: &str, bodies: &str, point: [f64; 3]| {
        format!(
            "{name} = {{ type = \"revolute\", between = {bodies}, point = {point:?}, axis = {h:?} }}\n"
        )
    };
    let mut joints =
        hinge("near", r#"["ground", "crank"]"#, o) + &hinge("base", r#"["rocker", "ground"]"#, far);
    let mut forces = String::new();
    for (name, bodies, point) in
        [("one", r#"["crank", "coupler"]"#, crank), ("two", r#"["coupler", "rocker"]"#, pin)]
    {
        match bushed {
            None => joints += &hinge(name, bodies, point),
            Some(k) => {
                let _ = writeln!(
                    forces,
                    "{name} = {{ type = \"bushing\", between = {bodies}, point = {point:?}, axes = [{b:?}, {c:?}], stiffness = {}, \
                     damping = {}, rotational_stiffness = [{r:e}, {r:e}, 0.0], rotational_damping = [{w:e}, {w:e}, 0.0] }}",
                    three(k),
                    three(0.1 * k),
                    r = 0.1 * k,
                    w = 0.01 * k
                );
            }
        }
    }
    format!(
        "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, -9.81, 0.0]\n[bodies]\n{bodies}[joints]\n{joints}[forces]\n{forces}"
    )
}

#[test] // independent truth: the linkage with hinges by DEABM, and that steps do not depend on how bodies are drawn
fn loops_of_bushings_do_not_depend_on_the_axes_of_bodies() {
    let end = 2.0;
    for axis in [[0.0, 0.0, 1.0], [0.2, 0.1, 1.0], [-1.0, 0.7, 0.4]] {
        let rigid =
            skew_four_bar(axis, None) + "[initial.joints]\nnear = { angular_velocity = 9.0 }\n";
        let names = ["crank", "coupler", "rocker"];
        let channels =
            names.iter().flat_map(|b| [format!("{b}.velocity"), format!("{b}.angular_velocity")]);
        let asked = |times: &[f64], options: Options| Options {
            channels: channels.clone().chain(["coupler.position".into()]).collect(),
            output: OutputTimes::Listed(times.to_vec()),
            ..options
        };
        let truth =
            run_model(&model_of(&rigid), &asked(&[0.0, end], options(Code::Deabm, 1e-9, end)));
        let mut start = "[initial.bodies]\n".to_owned();
        for (name, rates) in names.iter().zip(truth.rows.all.channels.chunks_exact(2)) {
            let [v, w] = [&rates[0][..3], &rates[1][..3]];
            let _ = writeln!(start, "{name} = {{ velocity = {v:?}, angular_velocity = {w:?} }}");
        }
        for k in [1e6, 1e9, 1e12] {
            let model = model_of(&(skew_four_bar(axis, Some(k)) + &start));
            let outcome = run_model(&model, &asked(&[0.0, end], options(DEFAULT_CODE, 1e-4, end)));
            let s = &outcome.summary.statistics;
            // Up to 1,389 steps and 1,135 refused iterations about a skew axis when deformations turned along the axes of bodies.
            assert!(s.steps < 150, "{axis:?} {k:e}: {} steps", s.steps);
            assert!(s.rejected_newton < 10, "{axis:?} {k:e}: {} refused", s.rejected_newton);
            if k > 1e7 {
                let [found, x] = [&outcome, &truth].map(|o| &o.rows.all.channels[6]);
                let off = error(Kind::Point, 1e-4, &found[3..], &x[3..], &x[..3]);
                assert!(off < 30.0, "{axis:?} {k:e}: {off} tolerances");
            }
        }
    }
}

/// The library's spatial four-bar with a bushing in place of its ball joint, started where the ball joint puts it.
fn spatial_four_bar(k: f64, c: f64) -> Model {
    let text = include_str!("../../../../models/spatial_four_bar/model.toml");
    let bodies = ["crank", "coupler", "rocker"];
    let quantities = ["position", "euler_parameters", "velocity", "angular_velocity"];
    let names = bodies.iter().flat_map(|b| quantities.iter().map(move |q| format!("{b}.{q}")));
    let start = Options {
        channels: names.collect(),
        output: OutputTimes::Listed(vec![0.0]),
        ..options(DEFAULT_CODE, 1e-4, 1e-3)
    };
    let rows = run_model(&model_of(text), &start).rows.all.channels;
    let initial: Vec<String> = bodies
        .iter()
        .zip(rows.chunks_exact(4))
        .map(|(body, rows)| {
            let stated: Vec<_> =
                quantities.iter().zip(rows).map(|(q, row)| format!("{q} = {row:?}")).collect();
            format!("{body} = {{ {} }}", stated.join(", "))
        })
        .collect();
    let initial = initial.join("\n");
    let bushing = format!(
        "ball = {{ type = \"bushing\", between = [\"crank\", \"coupler\"], point = [0.2, 0.0, 0.0], \
         stiffness = {}, damping = {} }}",
        three(k),
        three(c),
    );
    let mut lines = Vec::new();
    for line in text.lines() {
        // Without the ball joint and the stated rate of the crank.
        if !line.starts_with("ball") && !line.starts_with("crank = { angular") {
            lines.push(line);
        }
        match line {
            "[forces]" => lines.push(&bushing),
            "[initial.bodies]" => lines.push(&initial),
            _ => {}
        }
    }
    model_of(&lines.join("\n"))
}

#[test] // independent truth: the linkage with its ball joint by DEABM; 1e9 N/m yield less than 1e-6 m
fn a_spatial_loop_with_a_bushing_takes_as_many_steps_at_any_stiffness() {
    let mut table = Table::new("steps of a spatial four-bar with a bushing");
    let asked = |options: Options| Options {
        channels: vec!["coupler.position".into()],
        output: OutputTimes::Listed(vec![0.0, 1.0]),
        ..options
    };
    let rigid = crate::common::model("spatial_four_bar");
    let truth = run_model(&rigid, &asked(options(Code::Deabm, 1e-9, 1.0))).rows.all.channels;
    for seconds in [1e-3, 0.1] {
        let models = [1e6, 1e9].map(|k| spatial_four_bar(k, seconds * k));
        for code in implicit() {
            for &tolerance in TOLERANCES {
                let max_steps = attempts(code, tolerance, 6000);
                let options = Options { max_steps, ..asked(options(code, tolerance, 1.0)) };
                let runs = [0, 1].map(|i| try_run(&models[i], &options));
                let [soft, stiff] = [0, 1].map(|i| runs[i].summary.statistics.steps);
                let done = runs.iter().all(|run| run.summary.status == Status::Completed);
                let line = format!("{} {tolerance:.0e}", line("spatial four-bar", DEFAULT, code));
                table.note(&line, format!("{seconds:e} s: 1e6 ({soft}) 1e9 ({stiff})"));
                table.claim(done && 2 * stiff <= 3 * soft.max(FEW), || {
                    format!("{line}: {stiff} steps instead of {soft}, completed {done}")
                });
                let found = &runs[1].rows.all.channels[0];
                let (start, end) = truth[0].split_at(3);
                let off = error(Kind::Point, tolerance, &found[found.len() - 3..], end, start);
                table.claim(off < Bounds::of(DEFAULT, code, true).position, || {
                    format!("{line}: {off:.1} tolerances from the linkage with a ball joint")
                });
            }
        }
    }
    table.finish();
}

#[test] // independent truth: a rotation that is stiff about all axes yields less than one that is about one
fn a_bushing_that_is_stiff_about_one_axis_takes_few_steps_on_a_turning_body() {
    let steps = |rotational: [f64; 3]| {
        let model = model_of(&format!(
            r#"
holonom = 1
dimension = "spatial"
gravity = [0.0, 0.0, -9.81]
[bodies]
hub = {{ mass = 2.0, inertia = [[0.02, 0.0, 0.0], [0.0, 0.03, 0.0], [0.0, 0.0, 0.04]], position = [0.0, 0.0, 0.0] }}
rod = {{ mass = 1.0, inertia = [[0.0003, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.01]], position = [0.2, 0.0, 0.0] }}
[joints]
hinge = {{ type = "revolute", between = ["ground", "hub"], point = [0.0, 0.0, 0.2], axis = [0.0, 0.0, 1.0] }}
[forces]
mount = {{ type = "bushing", between = ["hub", "rod"], point = [0.0, 0.0, 0.0], stiffness = [1e4, 1e4, 1e4],
  damping = [1e2, 1e2, 1e2], rotational_stiffness = {rotational:?}, rotational_damping = {:?} }}
[initial.bodies]
hub = {{ angular_velocity = [0.0, 0.0, 3.0] }}
"#,
            rotational.map(|k| 0.01 * k),
        ));
        run_model(&model, &options(DEFAULT_CODE, 1e-3, 5.0)).summary.statistics.steps
    };
    // Its matrix is not turned with the rod: 579 steps, and 376 refused, where it was.
    let [mixed, soft] = [steps([5.0, 5.0, 1e5]), steps([5.0; 3])];
    assert!(mixed <= 2 * soft, "{mixed} steps, {soft} where it is soft about all axes");
}

#[test] // reference of the library: two equations in elongation and angle
fn the_profile_of_the_thesis_is_right_on_the_stiff_slider_or_says_so() {
    let model = crate::common::model("stiff_slider");
    let reference = crate::common::reference("stiff_slider");
    let mut table = Table::new("stiff slider in the profile of the thesis");
    let end = *reference.times.last().unwrap();
    let mut channels: Vec<String> =
        reference.columns.iter().map(|(name, _)| name.clone()).collect();
    channels.dedup();
    // The thesis has no Radau formula.
    for code in implicit().into_iter().filter(|code| *code != Code::ForRadau) {
        for tolerance in [1e-2, 1e-3, 1e-4, 1e-6] {
            let options = Options {
                profile: Profile::Thesis,
                parametrization: ParametrizationKind::Partitioning,
                channels: channels.clone(),
                output: OutputTimes::Listed(reference.times.clone()),
                max_steps: 20_000,
                ..options(code, tolerance, end)
            };
            let outcome = try_run(&model, &options);
            let completed = outcome.summary.status == Status::Completed;
            let mut run = Figures {
                position: 0.0,
                velocity: 0.0,
                steps: outcome.summary.statistics.steps,
                completed,
                warned: !outcome.summary.warnings.is_empty(),
            };
            if completed {
                for (column, difference) in reference.differences(&outcome) {
                    if column.contains("velocity") {
                        run.velocity = run.velocity.max(difference / tolerance);
                    } else {
                        run.position = run.position.max(difference / tolerance);
                    }
                }
            }
            let bounds =
                Bounds { position: 100.0, velocity: 200.0, or_warned: true, or_stopped: true };
            table.run(code.info().name, &format!("{tolerance:.0e}"), &run, bounds);
        }
    }
    table.finish();
}

/// A body, its centre 0.3 m beyond the point that a strong damper with a weak spring or none holds, 1 m from the ground's.
fn damped([stiffness, damping, free]: [f64; 3]) -> Model {
    model_of(&format!(
        "holonom = 1\ndimension = \"planar\"\ngravity = [0.0, -9.81]\n[bodies]\nb = {{ mass = 1.0, inertia = 0.1, \
         position = [1.3, 0.0] }}\n[forces]\nd = {{ type = \"tsda\", between = [\"ground\", \"b\"], points = [[0.0, 0.0], \
         [1.0, 0.0]], stiffness = {stiffness:?}, damping = {damping:?}, free_length = {free:?} }}\n"
    ))
}

/// (x, y, angle) and rates of [`damped`], by hand.
fn damped_rate([stiffness, damping, free]: [f64; 3]) -> impl Fn(f64, &[f64]) -> Vec<f64> {
    move |_, s| {
        let arm = [-0.3 * s[2].cos(), -0.3 * s[2].sin()];
        let at = [s[0] + arm[0], s[1] + arm[1]];
        let speed = [s[3] - s[5] * arm[1], s[4] + s[5] * arm[0]];
        let length = at[0].hypot(at[1]);
        let rate = (at[0] * speed[0] + at[1] * speed[1]) / length;
        let pull = stiffness * (length - free) + damping * rate;
        let force = [-pull * at[0] / length, -pull * at[1] / length];
        let moment = arm[0] * force[1] - arm[1] * force[0];
        vec![s[3], s[4], s[5], force[0], force[1] - 9.81, moment / 0.1]
    }
}

#[test] // independent truth: equations by hand, by Radau IIA with short steps
fn what_a_strong_damper_holds_takes_no_more_steps_than_on_a_rod() {
    let times: Vec<f64> = (0..=10).map(|k| 0.2 * f64::from(k)).collect();
    let mut few = 0;
    for law in [[0.0, 1e5, 0.0], [0.0, 1e5, 1.0], [0.0, 1e7, 0.0], [30.0, 1e6, 0.0]] {
        let model = damped(law);
        let start = [1.3, 0.0, 0.0, 0.0, 0.0, 0.0];
        let truth = radau(&damped_rate(law), &start, &times[1..], 1e-9, 1e-3);
        for code in implicit() {
            let options = Options {
                channels: ["b.position", "b.angle", "b.velocity"].map(str::to_owned).to_vec(),
                output: OutputTimes::Listed(times.clone()),
                ..options(code, 1e-4, 2.0)
            };
            let run = run_model(&model, &options);
            let channels = [("b.position", 0), ("b.position", 1), ("b.angle", 0)];
            let velocities = [("b.velocity", 0), ("b.velocity", 1)];
            for (k, (name, component)) in channels.into_iter().chain(velocities).enumerate() {
                let found = run.series(name, component);
                let off = found[1..]
                    .iter()
                    .zip(&truth)
                    .map(|(x, y)| (x - y[k]).abs() / (1.0 + y[k].abs()));
                let off = off.fold(0.0, f64::max) / 1e-4;
                assert!(
                    off < if k < 3 { 30.0 } else { 60.0 },
                    "{law:?}, {code:?}: {name} {off:.0}"
                );
            }
            let steps = run.summary.statistics.steps;
            if code == DEFAULT_CODE {
                // A damper alone has no free length: what is stated changes no step.
                few = if few == 0 { steps } else { few };
                assert!(steps < 2 * few && few < 100, "{law:?}: {steps} steps, {few} at first");
            }
        }
    }
}

/// Two discs on a shaft of bushings between two bearings in housings on soft ones, that a motor runs up to 250 rad/s.
fn shaft_on_bushings() -> Model {
    let body = |name: &str, mass: f64, [about, across]: [f64; 2], x: f64| {
        format!(
            "{name} = {{ mass = {mass:?}, position = [{x:?}, 0.0, 0.0], inertia = [[{about:?}, 0.0, 0.0], [0.0, {across:?}, 0.0], [0.0, 0.0, {across:?}]] }}\n"
        )
    };
    let shaft = |name: &str, first: &str, second: &str, x: f64| {
        format!(
            "{name} = {{ type = \"bushing\", between = [\"{first}\", \"{second}\"], point = [{x:?}, 0.0, 0.0], \
             stiffness = [1e8, 4e6, 4e6], damping = [1000.0, 40.0, 40.0], \
             rotational_stiffness = [8e4, 1e5, 1e5], rotational_damping = [2.0, 1.0, 1.0] }}\n"
        )
    };
    let mount = |name: &str, housing: &str, x: f64| {
        format!(
            "{name} = {{ type = \"bushing\", between = [\"ground\", \"{housing}\"], point = [{x:?}, 0.0, 0.0], \
             stiffness = [1e6, 9e5, 1.4e6], damping = [300.0, 250.0, 400.0], \
             rotational_stiffness = [1e4, 1e4, 1e4], rotational_damping = [10.0, 10.0, 10.0] }}\n"
        )
    };
    let bearing = |name: &str, kind: &str, housing: &str, end: &str, x: f64| {
        format!(
            "{name} = {{ type = \"{kind}\", between = [\"{housing}\", \"{end}\"], point = [{x:?}, 0.0, 0.0], axis = [1.0, 0.0, 0.0] }}\n"
        )
    };
    model_of(&[
        "holonom = 1\ndimension = \"spatial\"\ngravity = [0.0, 0.0, -9.81]\n[bodies]\n",
        &body("left", 3.0, [0.01, 0.01], 0.0),
        &body("first", 20.0, [0.6, 0.32], 0.3),
        &body("second", 15.0, [0.3, 0.17], 0.6),
        &body("right", 3.0, [0.01, 0.01], 0.9),
        &body("left_housing", 8.0, [0.05, 0.05], 0.0),
        &body("right_housing", 8.0, [0.05, 0.05], 0.9),
        "[joints]\n",
        &bearing("left_bearing", "revolute", "left_housing", "left", 0.0),
        &bearing("right_bearing", "cylindrical", "right_housing", "right", 0.9),
        "[forces]\n",
        &shaft("shaft_1", "left", "first", 0.15),
        &shaft("shaft_2", "first", "second", 0.45),
        &shaft("shaft_3", "second", "right", 0.75),
        &mount("left_mount", "left_housing", 0.0),
        &mount("right_mount", "right_housing", 0.9),
        "motor = { type = \"torque\", on = \"left\", axes = \"body\", torque = [60.0, 0.0, 0.0] }\n",
    ].concat())
}

#[test] // independent truth: what is less exact is to cost no more
fn loose_tolerances_cost_no_more_where_iterations_limit_steps() {
    let model = shaft_on_bushings();
    let evaluations = [1e-1, 1e-2, 1e-3].map(|tolerance| {
        let outcome = run_model(&model, &options(Code::ForRadau, tolerance, 4.0));
        outcome.summary.statistics.evaluations
    });
    let [loosest, loose, tight] = evaluations;
    assert!(loosest.max(loose) < tight * 6 / 5, "{evaluations:?}");
}
