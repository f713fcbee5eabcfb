//! Runs against a truth, measured in tolerances, and their table: all cases are run before one fails.

use super::{model_of, options, run_from};
use holonom::method::{CODES, Code, Profile};
use holonom::model::{Model, Tolerance};
use holonom::reduction::ParametrizationKind;
use holonom::simulation::{Options, OutputTimes, Status};
use std::f64::consts::PI;
use std::fmt::Write;

/// Tolerances of the tables.
#[cfg(feature = "long")]
pub(crate) const TOLERANCES: &[f64] = &[1e-3, 1e-4, 1e-6];
#[cfg(not(feature = "long"))]
pub(crate) const TOLERANCES: &[f64] = &[1e-4];

/// Implicit codes.
pub(crate) fn implicit() -> Vec<Code> {
    CODES.iter().filter(|i| !i.code.is_explicit()).map(|i| i.code).collect()
}

/// Every code.
pub(crate) fn all_codes() -> Vec<Code> {
    CODES.iter().map(|i| i.code).collect()
}

/// Independent variables and profile of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Manner {
    pub(crate) name: &'static str,
    /// The engine's default if none.
    pub(crate) choice: Option<ParametrizationKind>,
    pub(crate) profile: Profile,
}

/// What a user gets who asks for nothing.
pub(crate) const DEFAULT: Manner = Manner { name: "", choice: None, profile: Profile::Improved };

/// Everything else, which may be less exact, or say that it is.
pub(crate) const OTHERS: [Manner; 4] = [
    Manner {
        name: "partitioning",
        choice: Some(ParametrizationKind::Partitioning),
        profile: Profile::Improved,
    },
    Manner {
        name: "tangent plane",
        choice: Some(ParametrizationKind::TangentPlane),
        profile: Profile::Improved,
    },
    Manner {
        name: "tangent plane, SVD",
        choice: Some(ParametrizationKind::TangentPlaneSvd),
        profile: Profile::Improved,
    },
    Manner {
        name: "thesis",
        choice: Some(ParametrizationKind::Partitioning),
        profile: Profile::Thesis,
    },
];

/// What a channel is, for its tolerance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Kind {
    /// A point: absolute + relative × movement since the start.
    Point,
    /// Angles, whole turns told apart: absolute + relative × movement, at most π.
    Angle,
    /// Euler parameters of either sign: absolute + relative × angle from the start.
    Orientation,
    /// A velocity: absolute + relative × value.
    Velocity,
}

/// A channel's true values at the output times.
#[derive(Debug, Clone)]
pub(crate) struct Truth {
    pub(crate) channel: &'static str,
    pub(crate) kind: Kind,
    pub(crate) rows: Vec<Vec<f64>>,
}

pub(crate) fn truth(
    channel: &'static str,
    kind: Kind,
    rows: impl IntoIterator<Item = Vec<f64>>,
) -> Truth {
    Truth { channel, kind, rows: rows.into_iter().collect() }
}

/// Attempts that a run may take where `usual` are enough for formulas of higher order: those of order 2 need ten times
/// as many at a hundredth of the tolerance.
pub(crate) fn attempts(code: Code, tolerance: f64, usual: u64) -> u64 {
    let second_order = matches!(code, Code::SspTrap | Code::InflTrap);
    if second_order && tolerance < 1e-5 { 5 * usual } else { usual }
}

/// A model, how long it runs and what is true of it.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) model: Model,
    pub(crate) end: f64,
    pub(crate) truths: Vec<Truth>,
    pub(crate) max_steps: u64,
}

impl Case {
    pub(crate) fn new(text: &str, end: f64, truths: Vec<Truth>) -> Self {
        Self { model: model_of(text), end, truths, max_steps: 20_000 }
    }
}

/// `n + 1` equally spaced times from 0 to `end`, as the engine counts them.
pub(crate) fn times(end: f64, n: usize) -> Vec<f64> {
    (0..=n).map(|k| (k as f64 * (end / n as f64)).min(end)).collect()
}

/// Figures of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Figures {
    /// Largest errors in tolerances.
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    /// Accepted steps.
    pub(crate) steps: u64,
    pub(crate) completed: bool,
    pub(crate) warned: bool,
}

fn length(x: impl Iterator<Item = f64>) -> f64 {
    x.map(|v| v * v).sum::<f64>().sqrt()
}

/// Error of a row in tolerances.
pub(crate) fn error(kind: Kind, tolerance: f64, found: &[f64], x: &[f64], start: &[f64]) -> f64 {
    let distance = |a: &[f64], b: &[f64]| length(a.iter().zip(b).map(|(a, b)| a - b));
    let (error, size) = match kind {
        Kind::Point => (distance(found, x), distance(x, start)),
        Kind::Angle => (distance(found, x), distance(x, start).min(PI)),
        Kind::Velocity => (distance(found, x), length(x.iter().copied())),
        Kind::Orientation => {
            let other: Vec<f64> = x.iter().map(|p| -p).collect();
            let cosine: f64 = x.iter().zip(start).map(|(a, b)| a * b).sum();
            let error = 2.0 * distance(found, x).min(distance(found, &other));
            (error, 2.0 * cosine.abs().min(1.0).acos())
        }
    };
    let error = error / (tolerance * (1.0 + size));
    if error.is_nan() { f64::INFINITY } else { error }
}

/// Runs a case and measures it.
pub(crate) fn measure(case: &Case, manner: Manner, code: Code, tolerance: f64) -> Figures {
    let rows = case.truths[0].rows.len() - 1;
    let options = Options {
        channels: case.truths.iter().map(|truth| truth.channel.to_owned()).collect(),
        output: OutputTimes::Interval(case.end / rows as f64),
        max_steps: attempts(code, tolerance, case.max_steps),
        max_seconds: 60.0, // a guard: runs of order 2 take the most, some seconds each
        profile: manner.profile,
        parametrization: manner.choice.unwrap_or_default(),
        tolerance: Tolerance::uniform(tolerance),
        ..options(code, tolerance, case.end)
    };
    let outcome = run_from(&case.model, &options, None);
    let summary = &outcome.summary;
    let completed = summary.status == Status::Completed;
    let mut figures = Figures {
        position: 0.0,
        velocity: 0.0,
        steps: summary.statistics.steps,
        completed,
        warned: !summary.warnings.is_empty(),
    };
    for (truth, found) in case.truths.iter().zip(&outcome.rows.all.channels) {
        let width = truth.rows[0].len();
        let worst = if truth.kind == Kind::Velocity {
            &mut figures.velocity
        } else {
            &mut figures.position
        };
        // A run that ends early adds the row at which it did.
        let reached = if completed { rows + 1 } else { (found.len() / width).saturating_sub(1) };
        for (found, x) in found.chunks_exact(width).zip(&truth.rows).take(reached) {
            *worst = worst.max(error(truth.kind, tolerance, found, x, &truth.rows[0]));
        }
        assert!(!completed || found.len() == width * (rows + 1), "{}: rows", truth.channel);
    }
    figures
}

/// Bounds in tolerances.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Bounds {
    pub(crate) position: f64,
    pub(crate) velocity: f64,
    /// Whether a run with a warning, or one that says that it failed, may be outside them.
    pub(crate) or_warned: bool,
    /// Whether a run may stop at its limit of steps or say that it failed.
    pub(crate) or_stopped: bool,
}

impl Bounds {
    /// The bounds of every table.
    pub(crate) const fn usual() -> Self {
        Self { position: 30.0, velocity: 60.0, or_warned: false, or_stopped: false }
    }

    /// Those of a manner and a code; `stiff` models excuse ForRosen, whose stages see a stiff force only
    /// through its linearization.
    pub(crate) fn of(manner: Manner, code: Code, stiff: bool) -> Self {
        if manner != DEFAULT {
            Self { position: 100.0, velocity: 100.0, or_warned: true, or_stopped: true }
        } else if stiff && code == Code::ForRosen {
            Self { position: 60.0, velocity: 60.0, or_warned: true, or_stopped: true }
        } else {
            Self::usual()
        }
    }

    pub(crate) fn hold(&self, run: &Figures) -> bool {
        let within = run.position <= self.position && run.velocity <= self.velocity;
        (run.completed && within)
            || (self.or_warned && run.warned)
            || (self.or_stopped && !run.completed)
    }
}

/// A table of runs: a line per case, manner, code; a cell per tolerance or stiffness.
#[derive(Debug, Default)]
pub(crate) struct Table {
    name: String,
    lines: Vec<(String, Vec<String>)>,
    faults: Vec<String>,
    cells: usize,
    outside: usize,
}

impl Table {
    pub(crate) fn new(name: &str) -> Self {
        Self { name: name.to_owned(), ..Self::default() }
    }

    /// A free line of the table.
    pub(crate) fn note(&mut self, line: &str, cell: String) {
        match self.lines.iter_mut().find(|(name, _)| name == line) {
            Some((_, cells)) => cells.push(cell),
            None => self.lines.push((line.to_owned(), vec![cell])),
        }
    }

    /// Something that must not be.
    pub(crate) fn fault(&mut self, text: String) {
        self.faults.push(text);
    }

    /// Takes a claim.
    pub(crate) fn claim(&mut self, holds: bool, text: impl FnOnce() -> String) {
        self.cells += 1;
        if !holds {
            self.fault(text());
        }
    }

    /// Takes a run: errors in position and velocity in tolerances, steps; `!` is out of bounds, `w` warned.
    pub(crate) fn run(&mut self, line: &str, column: &str, run: &Figures, bounds: Bounds) {
        let holds = bounds.hold(run);
        self.cells += 1;
        let mark = if holds { "" } else { "!" };
        let round = |x: f64| match x {
            0.0..9.95 => format!("{x:.1}"),
            0.0..1e4 => format!("{x:.0}"),
            _ => format!("{x:.1e}"),
        };
        let warned = if run.warned { "w" } else { "" };
        let stopped = if run.completed { "" } else { "stopped" };
        let errors = format!("{}/{}", round(run.position), round(run.velocity));
        let cell = format!("{column} {mark}{errors} ({}{warned}{stopped})", run.steps);
        self.outside += usize::from(!holds);
        self.note(line, cell);
    }

    /// Fails with the table if there is a fault. The table stands in `target/tmp` in any case.
    #[track_caller]
    pub(crate) fn finish(self) {
        let mut text = format!(
            "{}: {} of {} out of bounds\n(errors of position / velocity in tolerances, accepted steps; \
             ! out of bounds, w warned)\n",
            self.name,
            self.outside + self.faults.len(),
            self.cells
        );
        for (line, cells) in &self.lines {
            writeln!(text, "{line}: {}", cells.join("  ")).unwrap();
        }
        for fault in &self.faults {
            writeln!(text, "out of bounds: {fault}").unwrap();
        }
        let file = format!("{}/{}.txt", env!("CARGO_TARGET_TMPDIR"), self.name.replace(' ', "_"));
        std::fs::write(&file, &text).unwrap();
        assert!(self.outside == 0 && self.faults.is_empty(), "{text}");
    }
}

/// Runs a case by codes at all tolerances in one manner.
pub(crate) fn run_case(table: &mut Table, name: &str, case: &Case, manner: Manner, codes: &[Code]) {
    for &code in codes {
        let line = line(name, manner, code);
        for &tolerance in TOLERANCES {
            let run = measure(case, manner, code, tolerance);
            table.run(&line, &format!("{tolerance:.0e}"), &run, Bounds::of(manner, code, false));
        }
    }
}

/// The label of a line.
pub(crate) fn line(name: &str, manner: Manner, code: Code) -> String {
    let with = if manner == DEFAULT { String::new() } else { format!(", {}", manner.name) };
    format!("{name}{with}, {}", code.info().name)
}

/// The codes that stand for a manner: with `long` all of them. The thesis has no Radau formula.
pub(crate) fn codes_of(manner: Manner) -> Vec<Code> {
    let thesis = manner.profile == Profile::Thesis;
    if cfg!(feature = "long") {
        return all_codes().into_iter().filter(|c| !thesis || *c != Code::ForRadau).collect();
    }
    vec![if thesis { Code::ForSdirk } else { holonom::method::DEFAULT_CODE }]
}

/// Runs a case that is not stiff: by default with every code; with `long` in every other manner too, otherwise in
/// those with the default code only.
pub(crate) fn run_everything(table: &mut Table, name: &str, case: &Case) {
    run_case(table, name, case, DEFAULT, &all_codes());
    for manner in OTHERS {
        run_case(table, name, case, manner, &codes_of(manner));
    }
}
