//! Seeded random mechanisms: a run that ends well without a warning is right.
//!
//! The environment changes what is run and shown: `HOLONOM_SEEDS=100..600` or `=17,22` takes other seeds, `HOLONOM_TABLE=1` prints a line per suspicious run and the counts per kind of model,
//! `HOLONOM_DUMP=folder` writes the model files of the defects there, `HOLONOM_TOLERANCE=1e-2` asks for another tolerance.

#![allow(clippy::print_stdout, reason = "all counts are printed")]

use crate::common::options;
use crate::random::Mechanism;
use crate::random::numbers::Random;
use holonom::io::{Document, Syntax};
use holonom::method::{CODES, Code, CodeInfo};
use holonom::model::Model;
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Memory, Options, OutputTimes, Problem, RunError, Status, run};
use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

/// Unless the environment asks for another one.
const TOLERANCE: f64 = 1e-4;
/// Part of it, and the largest, of tight runs.
const TIGHT: [f64; 2] = [1e-3, 1e-7];
/// Tolerances by which a run may be off without a warning.
const WRONG: f64 = 100.0;
/// Tolerances within which a warning is not deserved.
const RIGHT: f64 = 30.0;
/// Tolerances within which two tight runs confirm each other.
const TRUSTED: f64 = 10.0;
/// Change of a speed at the start, and its growth in a chaotic motion.
const NUDGE: f64 = 1e-7;
const CHAOTIC: f64 = 1e4;
/// Rate of decay or vibration times span up to which an explicit code is asked.
const EXPLICIT: f64 = 2e3;
const EXPLICIT_TRUTH: f64 = 5e3;
const MAX_STEPS: u64 = 10_000;
/// Of all tight runs of a mechanism together.
const MAX_STEPS_OF_TRUTH: u64 = 20_000;
/// Far more than any of the runs needs: a guard against an endless one.
const MAX_SECONDS: f64 = 60.0;
const ROWS: f64 = 20.0;
/// Rates up to which mechanisms are judged, rad/s: beyond, a phase makes tolerances of anything.
const FASTEST: f64 = 50.0;

#[cfg(feature = "long")]
const SEEDS: u64 = 5000;
#[cfg(not(feature = "long"))]
const SEEDS: u64 = 200;
/// Of the mechanisms whose bodies force elements alone tie.
#[cfg(feature = "long")]
const SEEDS_ADRIFT: u64 = 200;
#[cfg(not(feature = "long"))]
const SEEDS_ADRIFT: u64 = 60;

/// Of those with stops.
#[cfg(feature = "long")]
const SEEDS_WITH_STOPS: u64 = 600;
#[cfg(not(feature = "long"))]
const SEEDS_WITH_STOPS: u64 = 60;

/// The mechanism of a seed and a change of its speeds.
type Draw = fn(u64, f64) -> Mechanism;

/// Coordinates and velocities of all bodies over the output times.
type Rows = [Vec<f64>; 2];

/// How a run came out.
#[derive(Debug, Clone)]
enum Ending {
    /// Rows, the codes of warnings about accuracy, steps, and the largest rate of turning, rad/s.
    Completed(Rows, Vec<&'static str>, u64, f64),
    Ended(String),
    Panicked,
}

/// One of the runs under test.
#[derive(Debug, Clone)]
struct Trial {
    code: &'static str,
    ending: String,
    completed: bool,
    warned: bool,
    /// Tolerances; infinite if there is none.
    error: f64,
}

#[derive(Debug, Clone, PartialEq)]
enum Verdict {
    Decided,
    Chaotic,
    /// Its forces make it turn faster than [`FASTEST`].
    TooFast,
    Undecided,
    /// Refused before it starts.
    Refused(String),
}

#[derive(Debug, Clone)]
struct Finding {
    seed: u64,
    traits: Vec<String>,
    freedom: usize,
    verdict: Verdict,
    trials: Vec<Trial>,
    /// Codes of the tight runs and how they ended.
    truths: Vec<String>,
    panics: usize,
    /// Of a nudge at the start, where it was asked for.
    growth: Option<f64>,
    /// Of all its runs, s.
    seconds: f64,
}

impl Finding {
    fn defects(&self) -> impl Iterator<Item = &Trial> {
        let decided = self.verdict == Verdict::Decided;
        self.trials.iter().filter(move |t| decided && t.completed && !t.warned && t.error > WRONG)
    }
}

fn tolerance() -> f64 {
    let asked = std::env::var("HOLONOM_TOLERANCE").ok();
    asked.map_or(TOLERANCE, |text| text.parse().expect("HOLONOM_TOLERANCE is a number"))
}

fn model_of(mechanism: &Mechanism) -> Result<Model, String> {
    let mut none = |_: &str| Err("no other file".to_owned());
    Document::parse(&mechanism.text(), Syntax::Toml, "model.toml", &mut none)
        .and_then(|document| document.build())
        .map(|(model, _)| model)
        .map_err(|errors| errors.render())
}

fn attempt(problem: &Problem, options: &Options, planar: bool) -> Result<Ending, RunError> {
    let outcome = catch_unwind(AssertUnwindSafe(|| {
        let mut rows = Memory::default();
        run(problem, options, None, &mut rows).map(|summary| (summary, rows))
    }));
    let Ok(outcome) = outcome else { return Ok(Ending::Panicked) };
    let (summary, rows) = outcome?;
    if summary.status != Status::Completed {
        return Ok(Ending::Ended(summary.stop.code.to_owned()));
    }
    // Redundant rows and the cost of an explicit code say nothing about accuracy.
    let about_accuracy =
        |code: &&str| !matches!(*code, "simulation/redundant" | "simulation/stiff");
    let steps = summary.statistics.steps;
    let warnings = summary.warnings.iter().map(|w| w.code).filter(about_accuracy).collect();
    let fastest = fastest(&rows.all.v, planar);
    Ok(Ending::Completed([rows.all.q, rows.all.v], warnings, steps, fastest))
}

/// Largest rate of turning among all bodies and rows, rad/s.
fn fastest(v: &[f64], planar: bool) -> f64 {
    v.chunks_exact(size(planar)).map(|v| speeds(v, planar)[1]).fold(0.0, f64::max)
}

/// Numbers per body.
fn size(planar: bool) -> usize {
    if planar { 3 } else { 7 }
}

fn length(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|x| x * x).sum::<f64>().sqrt()
}

/// Speed, m/s, and rate of turning, rad/s, of a body.
fn speeds(v: &[f64], planar: bool) -> [f64; 2] {
    let (linear, turning) = v.split_at(if planar { 2 } else { 3 });
    let turns = if planar { 1.0 } else { 2.0 };
    [length(linear.iter().copied()), turns * length(turning.iter().copied())]
}

/// Largest distance of two runs in tolerances: per body |δr| over tol (1 + movement) and the angle
/// over tol (1 + turning), movement and turning those of the truth since the start; half as many of velocities over
/// tol (1 + the largest that the body has).
fn distance(rows: &Rows, truth: &Rows, bodies: usize, planar: bool) -> f64 {
    let (size, d) = (size(planar), if planar { 2 } else { 3 });
    if rows[0].len() != truth[0].len() {
        return f64::INFINITY;
    }
    let apart = |a: &[f64], b: &[f64]| length(a.iter().zip(b).map(|(x, y)| x - y));
    let minus = |b: &[f64]| b.iter().map(|x| -x).collect::<Vec<_>>();
    let flipped = |a: &[f64], b: &[f64]| !planar && apart(a, &minus(b)) < apart(a, b);
    let turn = |a: &[f64], b: &[f64]| {
        if planar {
            return (a[0] - b[0]).abs();
        }
        2.0 * apart(a, b).min(apart(a, &minus(b)))
    };
    let mut largest = vec![[0.0f64; 2]; bodies];
    for (place, v) in truth[1].chunks_exact(size).enumerate() {
        let (largest, now) = (&mut largest[place % bodies], speeds(v, planar));
        *largest = [0, 1].map(|k| largest[k].max(now[k]));
    }
    let mut worst = 0.0f64;
    let of = |rows: &Rows, place: usize| -> [Vec<f64>; 2] {
        [0, 1].map(|level| rows[level][place * size..][..size].to_vec())
    };
    for place in 0..truth[0].len() / size {
        let ([x, mut u], [y, v]) = (of(rows, place), of(truth, place));
        if flipped(&x[d..], &y[d..]) {
            u[d..].iter_mut().for_each(|u| *u = -*u);
        }
        let start = &truth[0][(place % bodies) * size..][..size];
        let moved = apart(&y[..d], &start[..d]);
        let turned = turn(&y[d..], &start[d..]).min(std::f64::consts::PI);
        let change: Vec<f64> = u.iter().zip(&v).map(|(u, v)| u - v).collect();
        let (change, largest) = (speeds(&change, planar), largest[place % bodies]);
        let errors = [
            apart(&x[..d], &y[..d]) / (1.0 + moved),
            turn(&x[d..], &y[d..]) / (1.0 + turned),
            0.5 * change[0] / (1.0 + largest[0]),
            0.5 * change[1] / (1.0 + largest[1]),
        ];
        for error in errors {
            worst = if error.is_nan() { f64::INFINITY } else { worst.max(error) };
        }
    }
    worst / tolerance()
}

/// Pairs of codes of unlike families and formulas.
fn pairs(explicit: bool) -> Vec<[&'static CodeInfo; 2]> {
    let mut out = Vec::new();
    for (i, a) in CODES.iter().enumerate() {
        for b in &CODES[..i] {
            let allowed = explicit || (!a.code.is_explicit() && !b.code.is_explicit());
            if allowed && a.family != b.family && a.formula != b.formula {
                out.push([a, b]);
            }
        }
    }
    out
}

/// Options of the tight runs, in the order in which they are asked.
fn truths(seed: u64, nonstiff: bool, used: &[&CodeInfo; 2], span: f64) -> Vec<Options> {
    let other = |k: u64| {
        use ParametrizationKind::{Partitioning, TangentPlane, TangentPlaneSvd};
        [TangentPlane, Partitioning, TangentPlaneSvd][(seed / 3 + k) as usize % 3]
    };
    let codes: &[(Code, f64)] = if nonstiff {
        &[(Code::Dopri5, 1.0), (Code::Deabm, 0.1), (Code::ForRadau, 1.0)]
    } else {
        &[(Code::ForRadau, 1.0), (Code::ForSdirk, 0.1), (Code::SspSdirk16, 1.0)]
    };
    // Another code than those under test where there is one.
    let mut order: Vec<(Code, f64)> = codes.to_vec();
    order.sort_by_key(|(code, _)| used.iter().any(|u| u.code == *code));
    order
        .iter()
        .enumerate()
        .map(|(k, &(code, part))| Options {
            parametrization: other(k as u64),
            output: OutputTimes::Interval(span / ROWS),
            max_seconds: MAX_SECONDS,
            ..options(code, part * TIGHT[1].min(TIGHT[0] * tolerance()), span)
        })
        .collect()
}

fn examine(seed: u64, draw: Draw) -> Finding {
    let mechanism = draw(seed, 0.0);
    let mut out = Finding {
        seed,
        traits: mechanism.traits(),
        freedom: mechanism.freedom,
        verdict: Verdict::Decided,
        trials: Vec::new(),
        truths: Vec::new(),
        panics: 0,
        growth: None,
        seconds: 0.0,
    };
    let model = match model_of(&mechanism) {
        Ok(model) => model,
        Err(message) => panic!("seed {seed} is no model: {message}\n{}", mechanism.text()),
    };
    let (bodies, planar, span) = (model.bodies.len(), mechanism.planar, mechanism.span);
    let problem = Problem::new(model);
    let stiffness = mechanism.fastest * span;
    let pairs = pairs(stiffness < EXPLICIT);
    let pair = pairs[Random::new(seed ^ 0xa5a5).below(pairs.len())];

    let mut results = Vec::new();
    for info in pair {
        let options = Options {
            output: OutputTimes::Interval(span / ROWS),
            max_steps: MAX_STEPS,
            max_seconds: MAX_SECONDS,
            ..options(info.code, tolerance(), span)
        };
        match attempt(&problem, &options, planar) {
            Ok(ending) => results.push((info, ending)),
            Err(error) => {
                out.verdict = Verdict::Refused(error.to_string());
                return out;
            }
        }
    }

    // One tight run decides where all agree with it; otherwise two must confirm each other.
    let against = |truth: &Rows| -> f64 {
        let completed = results.iter().filter_map(|(_, ending)| match ending {
            Ending::Completed(rows, ..) => Some(distance(rows, truth, bodies, planar)),
            _ => None,
        });
        completed.fold(0.0, f64::max)
    };
    let any = results.iter().any(|(_, ending)| matches!(ending, Ending::Completed(..)));
    let mut tight: Vec<(Options, Rows)> = Vec::new();
    let mut truth = None;
    let mut left = MAX_STEPS_OF_TRUTH;
    for options in truths(seed, stiffness < EXPLICIT_TRUTH, &pair, span) {
        if !any || left == 0 {
            break;
        }
        let options = Options { max_steps: left, ..options };
        let name = options.code.info().name;
        let ending =
            attempt(&problem, &options, planar).unwrap_or_else(|e| Ending::Ended(e.to_string()));
        match ending {
            Ending::Completed(rows, _, steps, _) => {
                left = left.saturating_sub(steps);
                out.truths.push(format!("{name} {}", options.parametrization.name()));
                if tight.is_empty() && against(&rows) <= RIGHT {
                    truth = Some((options, rows));
                    break;
                }
                let confirmed = tight
                    .iter()
                    .find(|(_, other)| distance(&rows, other, bodies, planar) <= TRUSTED);
                if let Some((options, rows)) = confirmed {
                    truth = Some((options.clone(), rows.clone()));
                    break;
                }
                tight.push((options, rows));
            }
            Ending::Ended(code) => {
                left /= 2;
                out.truths.push(format!("{name} {code}"));
            }
            Ending::Panicked => {
                out.panics += 1;
                out.truths.push(format!("{name} panicked"));
            }
        }
    }
    let largest = truth.as_ref().map_or(0.0, |(_, rows)| against(rows));
    // Sensitive to its start? Asked of what is off, and of what has no truth.
    if any && (truth.is_none() || largest > WRONG) {
        out.verdict = if truth.is_none() { Verdict::Undecided } else { Verdict::Decided };
        let asked = truth.clone().or_else(|| tight.first().cloned());
        if let Some((options, rows)) = asked {
            let nudged = model_of(&draw(seed, NUDGE)).expect("the same model");
            if let Ok(Ending::Completed(other, ..)) =
                attempt(&Problem::new(nudged), &options, planar)
            {
                let growth = distance(&other, &rows, bodies, planar) * tolerance() / NUDGE;
                out.growth = Some(growth);
                if growth > CHAOTIC {
                    out.verdict = Verdict::Chaotic;
                }
            }
        }
    }
    let rate = results.iter().map(|(_, ending)| match ending {
        Ending::Completed(.., rate) => *rate,
        _ => 0.0,
    });
    if rate.fold(0.0, f64::max) > FASTEST {
        out.verdict = Verdict::TooFast;
    }
    for (info, ending) in results {
        let (ending, completed, warned, error) = match ending {
            Ending::Completed(rows, warnings, ..) => {
                let error = truth.as_ref().map(|(_, t)| distance(&rows, t, bodies, planar));
                let warned = !warnings.is_empty();
                (warnings.join(" "), true, warned, error.unwrap_or(f64::NAN))
            }
            Ending::Ended(code) => (code, false, false, f64::INFINITY),
            Ending::Panicked => {
                out.panics += 1;
                ("panicked".to_owned(), false, false, f64::INFINITY)
            }
        };
        out.trials.push(Trial { code: info.name, ending, completed, warned, error });
    }
    out
}

fn seeds(count: u64) -> Vec<u64> {
    let Ok(text) = std::env::var("HOLONOM_SEEDS") else { return (0..count).collect() };
    let number = |s: &str| -> u64 { s.trim().parse().expect("`first..end` or seeds with commas") };
    match text.split_once("..") {
        Some((first, end)) => (number(first)..number(end)).collect(),
        None => text.split(',').map(number).collect(),
    }
}

fn all(seeds: &[u64], draw: Draw) -> Vec<Finding> {
    let next = AtomicUsize::new(0);
    let found = Mutex::new(Vec::new());
    let work = || {
        loop {
            let Some(&seed) = seeds.get(next.fetch_add(1, Ordering::Relaxed)) else { return };
            let begun = Instant::now();
            let mut finding = examine(seed, draw);
            finding.seconds = begun.elapsed().as_secs_f64();
            found.lock().expect("no panic").push(finding);
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..2 {
            scope.spawn(work);
        }
    });
    let mut found = found.into_inner().expect("no panic");
    found.sort_by_key(|f| f.seed);
    found
}

/// Counts over all findings.
#[derive(Debug, Default)]
struct Counts {
    mechanisms: usize,
    refused: usize,
    chaotic: usize,
    too_fast: usize,
    undecided: usize,
    runs: usize,
    completed: usize,
    panics: usize,
    right: usize,
    warned_though_right: usize,
    wrong_but_warned: usize,
    between: usize,
    defects: usize,
}

impl Counts {
    fn of(findings: &[Finding]) -> Self {
        let mut out = Self { mechanisms: findings.len(), ..Self::default() };
        for finding in findings {
            out.panics += finding.panics;
            match finding.verdict {
                Verdict::Refused(_) => out.refused += 1,
                Verdict::Chaotic => out.chaotic += 1,
                Verdict::TooFast => out.too_fast += 1,
                Verdict::Undecided => out.undecided += 1,
                Verdict::Decided => {}
            }
            for trial in &finding.trials {
                out.runs += 1;
                out.completed += usize::from(trial.completed);
                if finding.verdict != Verdict::Decided || !trial.completed {
                    continue;
                }
                if trial.error <= RIGHT {
                    out.right += 1;
                    out.warned_though_right += usize::from(trial.warned);
                } else if trial.error <= WRONG {
                    out.between += 1;
                } else {
                    out.wrong_but_warned += usize::from(trial.warned);
                }
            }
            out.defects += finding.defects().count();
        }
        out
    }
}

/// Runs, runs that did not complete and defects per trait or code.
fn print_kinds(findings: &[Finding]) {
    let mut kinds: BTreeMap<&str, [usize; 4]> = BTreeMap::new();
    for finding in findings {
        let undecided = usize::from(finding.verdict == Verdict::Undecided);
        for name in &finding.traits {
            let row = kinds.entry(name).or_default();
            row[0] += finding.trials.len();
            row[1] += finding.trials.iter().filter(|t| !t.completed).count();
            row[2] += undecided * finding.trials.len();
            row[3] += finding.defects().count();
        }
        for trial in &finding.trials {
            let row = kinds.entry(trial.code).or_default();
            row[0] += 1;
            row[1] += usize::from(!trial.completed);
            row[2] += undecided;
        }
        for trial in finding.defects() {
            kinds.entry(trial.code).or_default()[3] += 1;
        }
    }
    let mut rows: Vec<_> = kinds.into_iter().collect();
    rows.sort_by(|a, b| (b.1[3] * a.1[0]).cmp(&(a.1[3] * b.1[0])));
    println!("{:28} {:>6} {:>8} {:>9} {:>7}", "kind", "runs", "stopped", "undecided", "defects");
    for (name, [runs, stopped, undecided, defects]) in rows {
        let share = 100.0 * defects as f64 / runs.max(1) as f64;
        println!("{name:28} {runs:6} {stopped:8} {undecided:9} {defects:7}  {share:5.1} %");
    }
}

fn print_table(findings: &[Finding]) {
    for finding in findings {
        let Finding { seed, freedom, verdict, truths, traits, seconds, .. } = finding;
        let suspicious = finding.trials.iter().any(|t| !t.completed || t.warned || t.error > RIGHT)
            || *seconds > 0.5;
        if *verdict == Verdict::Decided && !suspicious {
            continue;
        }
        let trials: Vec<String> = finding
            .trials
            .iter()
            .map(|t| format!("{} {:.1} {}", t.code, t.error, t.ending))
            .collect();
        println!(
            "seed {seed}: {seconds:.2} s, {verdict:?}, ndof {freedom}; {}; truths {}; {}",
            trials.join(", "),
            truths.join(", "),
            traits.join(", ")
        );
    }
    print_kinds(findings);
}

fn dump(findings: &[Finding], draw: Draw, folder: &str) {
    std::fs::create_dir_all(folder).expect("the folder of HOLONOM_DUMP");
    for finding in findings.iter().filter(|f| f.defects().next().is_some()) {
        let file = format!("{folder}/{}.toml", finding.seed);
        std::fs::write(file, draw(finding.seed, 0.0).text()).expect("a writable folder");
    }
}

#[test] // independent truth: runs a thousand times tighter, by other codes on another parametrization
fn a_random_mechanism_is_right_or_warned_of_or_fails() {
    no_wrong_success(SEEDS, Mechanism::new, 20);
}

#[test] // independent truth: likewise
fn bodies_that_forces_alone_tie_are_right_or_warned_of_or_fail() {
    no_wrong_success(SEEDS_ADRIFT, Mechanism::adrift, 20);
}

#[test] // independent truth: likewise
fn mechanisms_with_stops_are_right_or_warned_of_or_fail() {
    // What strikes is off for moments by as much as it changes: the second run sees some of them.
    no_wrong_success(SEEDS_WITH_STOPS, Mechanism::with_stops, 30);
}

#[test] // independent truth: likewise
fn mechanisms_that_were_off_are_right_or_warned_of() {
    // By up to 18,000 tolerances without a warning: errors that grew, and 911 on another branch of its loops.
    let seeds = [
        286, 348, 444, 672, 911, 1092, 1225, 1600, 1712, 1802, 2510, 2569, 2706, 2785, 2863, 2940,
        4829, 5611,
    ];
    let with_stops = [43, 97, 129, 327, 348, 379, 2169, 2225, 3165];
    let mut findings = all(&seeds, Mechanism::new);
    findings.extend(all(&with_stops, Mechanism::with_stops));
    for finding in findings {
        let off: Vec<_> = finding.defects().collect();
        assert!(off.is_empty(), "seed {}: {off:?}", finding.seed);
    }
}

/// Warnings may accompany `in_vain` of a thousand right runs.
fn no_wrong_success(count: u64, draw: Draw, in_vain: usize) {
    let findings = all(&seeds(count), draw);
    let counts = Counts::of(&findings);
    println!("{counts:?}");
    for finding in &findings {
        for trial in finding.defects() {
            println!(
                "defect: seed {}, {} on {}: {:.0} tolerances, a nudge grows {:.0}-fold ({})",
                finding.seed,
                trial.code,
                ParametrizationKind::default().name(),
                trial.error,
                finding.growth.unwrap_or(f64::NAN),
                finding.truths.join(", "),
            );
        }
    }
    if std::env::var_os("HOLONOM_TABLE").is_some() {
        print_table(&findings);
    }
    if let Ok(folder) = std::env::var("HOLONOM_DUMP") {
        dump(&findings, draw, &folder);
    }
    let Counts { mechanisms, runs, .. } = counts;
    assert_eq!(counts.panics, 0, "panics");
    assert_eq!(counts.defects, 0, "wrong runs without a warning");
    assert!(10 * counts.refused < mechanisms, "{} refused", counts.refused);
    assert!(20 * counts.chaotic <= mechanisms, "{} chaotic", counts.chaotic);
    assert!(20 * counts.too_fast <= mechanisms, "{} too fast", counts.too_fast);
    assert!(20 * counts.undecided <= mechanisms, "{} undecided", counts.undecided);
    assert!(100 * counts.completed >= 95 * runs, "{} of {runs} runs complete", counts.completed);
    assert!(
        1000 * counts.warned_though_right <= in_vain * counts.right,
        "{} of {} right runs are warned of",
        counts.warned_though_right,
        counts.right
    );
}

#[test] // independent truth: a repetition, and another seed
fn a_seed_is_a_mechanism() {
    let text = |seed| Mechanism::new(seed, 0.0).text();
    assert_eq!(text(3), text(3));
    assert_ne!(text(3), text(4));
}

#[test] // independent truth: the names of the model file
fn the_mechanisms_have_every_joint_force_and_driver() {
    let texts: String = (0..300).map(|seed| Mechanism::new(seed, 0.0).text()).collect();
    let joints =
        ["fixed", "revolute", "translational", "cylindrical", "universal", "spherical", "distance"];
    let forces = ["tsda", "rsda", "maxwell", "bushing", "tyre", "point_force", "torque"];
    let motions = ["polynomial", "harmonic", "smooth_step", "table"];
    for name in joints.iter().chain(&forces).chain(&motions) {
        assert!(texts.contains(&format!("type = \"{name}\"")), "no {name}");
    }
    for coordinate in ["rotation", "translation"] {
        assert!(texts.contains(&format!("coordinate = \"{coordinate}\"")), "no {coordinate}");
    }
}
