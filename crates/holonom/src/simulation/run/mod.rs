//! The run loop: steps, outputs, limits.

mod accepting;
mod carrying;
mod charts;
mod checkpoints;
mod limits;
mod passing;
mod powers;
mod reporting;
mod set_up;
mod unseen_turns;

use crate::error::EvaluationFailure;
use crate::method::EquationForm;
use crate::method::stepper::{Rejection, Stepper, StepperStatistics, initial_step};
use crate::model::{Model, TimeFunction, force_ramps};
use crate::reduction::ParametrizationKind;
use crate::reduction::assembly::AssemblyError;
use crate::simulation::carried_error::{CarriedError, SUSPICIOUS, Stepped};
use crate::simulation::checkpoint::{Checkpoint, Pace, foreign};
use crate::simulation::checks::RunError;
use crate::simulation::clock::{Elapsed, Stopwatch};
use crate::simulation::diagnosis::Stop;
use crate::simulation::drift::Drift;
use crate::simulation::energy_scale::EnergyScale;
use crate::simulation::ledger::{Quadrature, StepPowers};
use crate::simulation::options::Options;
use crate::simulation::output::Output;
use crate::simulation::passage::Way;
use crate::simulation::problem::Problem;
use crate::simulation::recorder::Recorder;
use crate::simulation::second_run;
use crate::simulation::slowness::{LimitedBy, Limits, Slowness};
use crate::simulation::stage_powers::StagePowers;
use crate::simulation::stall::Stall;
use crate::simulation::statistics::{EnergySummary, RunWarning, Statistics, Status, StopReason};
use crate::simulation::step_length::{self, Driven, clip, smallest_step};
use crate::simulation::trajectory::{EventKind, Memory, Sink};
use crate::simulation::warnings::chosen;
use crate::system::{LawPlace, State, System};
use crate::watch::{GivenUp, stage, within};
use accepting::residuals;
use limits::Attempted;
use std::sync::Arc;
use std::time::{Duration, Instant};
use unseen_turns::UnseenTurns;

pub(in crate::simulation) const MAX_REJECTIONS: u32 = 60;
/// Attempts of a step whose ends may be refused for better ones.
const MOST_BETTER: u32 = 4;
/// Attempts of a step whose equations could not be solved from which on its variables may be to blame.
const OFTEN: u32 = 5;
/// Part of a step within which it ends at a knot, and beyond which it goes past it.
const AT_KNOT: f64 = 0.05;
/// Summary of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// How it ended.
    pub status: Status,
    /// Why it ended.
    pub stop: StopReason,
    /// Work and residuals.
    pub statistics: Statistics,
    /// Energy balance.
    pub energy: EnergySummary,
    /// Degrees of freedom.
    pub ndof: usize,
    /// Last accepted state: a run can go on from here.
    pub end: State,
    /// Warnings of the run.
    pub warnings: Vec<RunWarning>,
    /// What limited its steps; see [`Summary::limited_by`].
    pub limits: Limits,
}

impl Summary {
    /// What limited the steps of this run of `system`, by names.
    pub fn limited_by(&self, system: &dyn System) -> LimitedBy {
        self.limits.named(system, &self.end)
    }

    /// What was computed is whole, but what was to be said of it is not known.
    fn interrupt(&mut self) {
        self.status = Status::Interrupted;
        self.stop = StopReason {
            code: "simulation/interrupted",
            message:
                "interrupted at the end, while a second run was to tell how far errors have grown"
                    .to_owned(),
            help: "all rows are there; the same run into the same file, started from it, makes the second one again",
            ..self.stop.clone()
        };
    }
}

/// Runs a problem from its assembled start, or from `from`, to the end time.
///
/// # Errors
/// [`RunError`] when the run cannot start. A run that fails later returns its summary with
/// [`Status::Failed`], and the sink has got the trajectory so far.
pub fn run(
    problem: &Problem,
    options: &Options,
    from: Option<&State>,
    sink: &mut dyn Sink,
) -> Result<Summary, RunError> {
    begin(problem, options, from.map_or(Start::Assembled, Start::At), sink)
}

/// Runs a problem as [`run`], but whatever its errors may have grown to: who compares it with another run sees that.
///
/// # Errors
/// As [`run`].
pub fn repeat(
    problem: &Problem,
    options: &Options,
    from: Option<&State>,
    sink: &mut dyn Sink,
) -> Result<Summary, RunError> {
    let start = from.map_or(Start::Assembled, Start::At);
    once(problem, options, start, RUNNING, sink).map(|(summary, _)| summary)
}

/// Takes up a run of the same problem with the same options: its rows and steps from the checkpoint on are
/// those of the run that made it, to the last bit, and its summary is that of the whole.
///
/// # Errors
/// [`RunError::Checkpoint`] where it is one of another model or method; as [`run`].
pub fn resume(
    problem: &Problem,
    options: &Options,
    checkpoint: &Checkpoint,
    sink: &mut dyn Sink,
) -> Result<Summary, RunError> {
    let along = problem.along(&checkpoint.chart.forest).ok_or_else(foreign)?;
    begin(&along, options, Start::Checkpoint(checkpoint), sink)
}

/// What a run starts from.
#[derive(Clone, Copy)]
pub(in crate::simulation) enum Start<'a> {
    /// The initial state of its model.
    Assembled,
    /// A given state.
    At(&'a State),
    Checkpoint(&'a Checkpoint),
}

/// A run, and a second one where the errors of its steps may have grown beyond what they were allowed.
fn begin(
    problem: &Problem,
    options: &Options,
    start: Start<'_>,
    sink: &mut dyn Sink,
) -> Result<Summary, RunError> {
    let begun = Stopwatch::start();
    let (mut summary, carried) = once(problem, options, start, RUNNING, sink)?;
    let Some(carried) = carried else { return Ok(summary) };
    if summary.status == Status::Completed {
        let limit = Duration::try_from_secs_f64(options.max_seconds).ok();
        let left = || limit.map(|limit| limit.saturating_sub(begun.passed()));
        let checked = Stopwatch::start();
        let look = || stage("checking", || carried.longest_step_to_tell(problem, options));
        let missing =
            |told: bool| carried.missing.as_ref().filter(|_| told).map(|(w, _)| w.clone());
        match within(left(), look) {
            Ok(Some(most)) => {
                let found = second_run::compare(problem, options, &carried, most, left(), sink);
                // Or the second run could not tell.
                let told = found.warning.is_some() || found.potentials_differ;
                summary.warnings.extend(missing(told));
                summary.warnings.extend(found.warning);
                if found.interrupted {
                    summary.interrupt();
                }
            }
            Ok(None) => {}
            Err(given_up) => {
                summary.warnings.extend(missing(true));
                if given_up == GivenUp::Asked {
                    summary.interrupt();
                }
            }
        }
        let took = checked.elapsed();
        summary.statistics.run_seconds += took.wall.as_secs_f64();
        summary.statistics.run_cpu_seconds += took.processor.as_secs_f64();
    } else {
        summary.warnings.extend(carried.missing.map(|(warning, _)| warning));
    }
    Ok(summary)
}

/// What a run is for.
#[derive(Debug, Clone, Copy)]
pub(in crate::simulation) struct Task {
    /// For those who watch.
    pub(in crate::simulation) name: &'static str,
    /// Tolerances up to which its error is followed.
    pub(in crate::simulation) followed: f64,
    /// Part of the turn that bodies may make in a step.
    pub(in crate::simulation) turn_part: f64,
}

const RUNNING: Task = Task { name: "running", followed: SUSPICIOUS, turn_part: 1.0 };

/// A run for a `task`, and what it knows of its error.
pub(in crate::simulation) fn once(
    problem: &Problem,
    options: &Options,
    start: Start<'_>,
    task: Task,
    sink: &mut dyn Sink,
) -> Result<(Summary, Option<CarriedError>), RunError> {
    let begun = Stopwatch::start();
    let limit = Duration::try_from_secs_f64(options.max_seconds).ok();
    let mut run = within(limit, || set_up::set_up(problem, options, start, sink, begun))
        .map_err(|given_up| RunError::given_up(given_up, options))??;
    run.carried.iter_mut().for_each(|carried| carried.follow_up_to(task.followed));
    run.turn_part = task.turn_part;
    run.looped = (Stopwatch::start(), Stopwatch::of_others(&options.threads));
    let left = limit.map(|limit| limit.saturating_sub(begun.passed()));
    let stop = within(left, || stage(task.name, || run.advance()))
        .unwrap_or_else(|given_up| Err(Stop::from(given_up)));
    let (status, stop) = run.finish(stop);
    let longest = run.carried.as_mut().and_then(|carried| carried.longest.as_mut());
    if let (Status::Completed, Some(longest)) = (status, longest) {
        longest.end(&run.form.point().manifold, &run.state, &options.tolerance);
    }
    let mut statistics = run.statistics;
    run.add_times(&mut statistics);
    if run.assembled {
        run.warnings.extend(chosen(problem.chosen_velocities()));
    }
    let chart = run.form.point().manifold.chart().parametrization().clone();
    let summary = Summary {
        status,
        stop,
        ndof: run.form.point().manifold.chart().ndof(),
        statistics,
        energy: run.energy,
        end: run.state,
        warnings: run.warnings,
        limits: Limits { counts: run.slowness, chart },
    };
    Ok((summary, run.carried))
}

/// Refuses what [`run`] refuses, before the first step: choices, channels, tables, the initial state, and
/// equations that cannot be evaluated there. The warnings say what was chosen where nothing is stated.
///
/// # Errors
/// As [`run`].
pub fn check_run(problem: &Problem, options: &Options) -> Result<Vec<RunWarning>, RunError> {
    let mut none = Memory::default();
    let mut run =
        set_up::set_up(problem, options, Start::Assembled, &mut none, Stopwatch::start())?;
    run.form.begin_step(&run.state);
    run.form.pack(&run.state, &mut run.w);
    run.evaluate_slope()
        .map_err(|failure| RunError::Assembly(AssemblyError::Evaluation(failure)))?;
    Ok(chosen(problem.chosen_velocities()).into_iter().collect())
}

/// Everything of one run.
struct Run<'a> {
    options: &'a Options,
    model: &'a Model,
    system: Arc<dyn System>,
    form: Box<dyn EquationForm>,
    stepper: Box<dyn Stepper>,
    state: State,
    row: State,
    recorder: Recorder,
    /// What looks into steps that may pass over something, where forces have laws of such arguments. What it finds
    /// decides on steps, so that it has nothing in common with what writes rows.
    inspector: Option<Recorder>,
    w: Vec<f64>,
    g: Vec<f64>,
    w_end: Vec<f64>,
    g_end: Vec<f64>,
    scratch: [Vec<f64>; 2],
    /// What a step misses of force laws near its end, and further away from it.
    missed: [Vec<f64>; 2],
    /// What the last attempt misses of all laws that it passed over.
    passed: Vec<f64>,
    /// Where arguments of laws stand at the start, in the middle and at the end of the attempt.
    law_places: [Vec<LawPlace>; 3],
    /// Room for a dense output and for the way of a force law's argument.
    coefficients: Vec<f64>,
    way: Way,
    condition_reference: f64,
    unseen_turns: UnseenTurns,
    /// Residuals at the start, position and velocity: redundant rows may contradict each other a little.
    start_residuals: (f64, f64),
    residual_rows: Vec<f64>,
    statistics: Statistics,
    /// The first force that turned over, by its place in the model, and when, s.
    turned_over: Option<(usize, f64)>,
    slowness: Slowness,
    energy: EnergySummary,
    kinetic_range: (f64, f64),
    energy_scale: EnergyScale,
    drivers: Vec<Driven>,
    drift: Drift,
    /// What forces and drivers there are that change with time.
    changing: Vec<&'a TimeFunction>,
    /// Of runs that have one.
    carried: Option<CarriedError>,
    /// Part of the turn that bodies may make in a step.
    turn_part: f64,
    powers: StepPowers,
    /// Whether the present state has its multipliers: what needs them completes it.
    complete: bool,
    /// Whether a law has passed a knot in the step just accepted, or a line its other end.
    passes_knot: bool,
    /// By how much the moment of that comes late, s, where places are a tolerance off; 0 where no force turns round.
    delay: f64,
    /// What it passes over that is small only because the matrix of the step damps it, undamped.
    damped: Vec<passing::PassedOver>,
    /// Powers inside the step just accepted, as far as they are known: as [`StepPowers::through`] takes them.
    inside: Vec<[f64; 2]>,
    quadrature: Quadrature,
    /// Powers at moments in equal distances along the step, with room for all that may be looked at.
    moments: Vec<[f64; 2]>,
    stage_powers: StagePowers,
    stall: Stall,
    output: Output,
    warnings: Vec<RunWarning>,
    sink: &'a mut dyn Sink,
    /// First time of the run, s.
    started: f64,
    /// Coordinates there.
    origin: Vec<f64>,
    /// Whether it began with the model's initial state.
    assembled: bool,
    /// Where it is taken up, until that is done.
    taken_up: Option<&'a Checkpoint>,
    /// Work of the steppers before the present one.
    work_before: StepperStatistics,
    begun: Stopwatch,
    /// The same since the first step, and what other threads had worked before.
    looped: (Stopwatch, Elapsed),
    last_poll: Instant,
    last_flush: Instant,
    sink_time: Elapsed,
}

impl Run<'_> {
    fn advance(&mut self) -> Result<(), Stop> {
        let end = self.options.end_time;
        let Pace { next: mut h, mut longest, mut attempts } = match self.taken_up.take() {
            Some(checkpoint) => self.take_up(checkpoint)?,
            None => self.begin()?,
        };
        let breakpoints = self.system.breakpoints();
        let fixed = self.options.fixed_step.is_some();
        // Formulas that damp nothing let accelerations ring, and a new matrix is made for where these lead.
        let doubts = !self.stepper.explicit() && !self.options.code.is_trapezoidal();
        let ramps = force_ramps(self.model);
        // Attempts of a step that were refused, and those among them whose equations could not be solved.
        let (mut rejections, mut unsolved) = (0, 0);
        let mut repartitioned = false;
        let mut seen = true;
        // Where a step is to end that was refused as it went beyond, and the step from there.
        let mut knot = None;
        // Why the last attempt could not be evaluated.
        let mut unevaluated = None;
        while self.state.t < end {
            self.poll(h)?;
            if attempts >= self.options.max_steps {
                return Err(Stop::MaxSteps);
            }
            attempts += 1;
            let t = self.state.t;
            let (passed, ahead) = breakpoints.split_at(breakpoints.partition_point(|&b| b <= t));
            let next = ahead.first().map_or(end, |&b| b.min(end));
            let turning = self.turning();
            if !fixed {
                let begins_at_kink = passed.last() == Some(&t);
                h = self.longest_admissible(h, longest, next, begins_at_kink, &ramps);
            }
            let (step, reaches) = clip(t, h, next, fixed);
            let t_end = if reaches { next } else { t + step_length::representable(step, t, end) };
            if t_end <= t {
                return Err(Stop::Failed { cause: None, step_size: step });
            }
            let step = t_end - t;
            if let Some(carried) = &self.carried {
                self.stepper.shorten(carried.shortening());
                if doubts {
                    let stepper = self.stepper.as_mut();
                    stepper.reuse_below(carried.trusted_contraction(stepper, (end - t) / step));
                }
            }
            let linearized = self.stepper.statistics().linearizations;
            let mut report = self.stepper.attempt(self.form.as_mut(), t, step, &self.w, &self.g);
            let mut rejection = report.cause.take();
            // Whether a refusal has to do with the largest error.
            let mut blames = true;
            let mut retry = if report.accepted { 0.5 * step } else { report.next_step };
            if !report.accepted && !fixed {
                // Up to a knot of a law nothing may be wrong: tried once, where the formula would not get as far.
                let ahead = if rejections == 0 { self.next_knot(t, step) } else { None };
                let counts = |at: &f64| at - t > retry && t_end - at > AT_KNOT * step;
                knot = ahead.filter(counts).map(|ahead| {
                    let part = std::mem::replace(&mut retry, ahead - t) / step;
                    (ahead, (t_end - ahead) * part)
                });
            }
            if report.accepted {
                // On other charts what is a little before may be worse.
                let tree = self.options.parametrization == ParametrizationKind::Tree;
                let better = rejections < MOST_BETTER && tree && !fixed;
                match self.accept(t, step, t_end, better) {
                    Ok(true) => {}
                    Ok(false) => (rejection, blames) = (Some(Rejection::ErrorTooLarge), false),
                    Err(failure) => rejection = Some(Rejection::Evaluation(failure)),
                }
            }
            let mut growth = f64::INFINITY;
            if report.accepted && rejection.is_none() {
                match self.veto(&Attempted { t, step, t_end, next }, &mut seen) {
                    Ok(most) => growth = most,
                    Err(veto) => {
                        self.stepper.discard();
                        rejection = Some(Rejection::ErrorTooLarge);
                        (report.error, retry, blames) = (veto.error, veto.retry, veto.blames);
                    }
                }
            }
            self.record(t, step, &report, rejection.as_ref());
            let (accepted, change) = (rejection.is_none(), self.stepper.last_change());
            if blames {
                self.slowness.count(accepted, report.error, change, &self.w);
            }
            if let Some(cause) = rejection {
                rejections += 1;
                let lost = matches!(&cause, Rejection::Evaluation(_));
                let before = self.statistics.reparametrizations;
                let solved = lost || matches!(&cause, Rejection::ErrorTooLarge);
                unsolved += u32::from(!solved);
                if (lost || unsolved == OFTEN) && !std::mem::replace(&mut repartitioned, true) {
                    self.reparametrize_at_start().map_err(|f| failed(f, step))?;
                }
                let renewed = self.statistics.reparametrizations > before;
                // A step of prescribed length gets one more chance, with another partition.
                let hopeless = if fixed {
                    !renewed
                } else {
                    rejections >= MAX_REJECTIONS || retry < smallest_step(t, end)
                };
                if hopeless {
                    return Err(Stop::Failed { cause: Some(cause), step_size: step });
                }
                if lost {
                    self.stall.lose();
                    unevaluated = Some(cause);
                }
                if !fixed {
                    h = retry;
                    longest = retry;
                }
                continue;
            }
            (rejections, unsolved, repartitioned, seen) = (0, 0, false, true);
            self.has_turned();
            let moves = self.references_are_to_move();
            if let Some(carried) = &mut self.carried {
                if doubts && self.stepper.statistics().linearizations == linearized {
                    carried.doubt(self.stepper.as_ref(), report.contraction);
                }
                let (stepper, form) = (self.stepper.as_mut(), self.form.as_mut());
                let turn = step * turning;
                let passes_knot = self.passes_knot;
                let (w, slopes) = (&self.w_end[..], [&self.g[..], &self.g_end[..]]);
                let autonomous = are_still(&self.changing, [t, t_end]);
                let delay = self.delay;
                let t = t_end;
                let stepped = Stepped { t, step, w, slopes, autonomous, passes_knot, delay, turn };
                let known = carried.follow(stepper, form, &mut self.scratch[0], stepped);
                if passes_knot {
                    carried.miss(&self.passed);
                }
                if known {
                    carried.look(form, moves);
                } else {
                    // The form may be elsewhere: back to the end of the step.
                    let found = form.derivative(t_end, &self.w_end, &mut self.g_end);
                    found.map_err(|f| failed(f, step))?;
                }
            }
            self.keep_places(t, step, t_end);
            let energy = self.emit(t, step)?;
            if let Some(carried) = &mut self.carried {
                carried.pass(self.statistics.steps, &self.state, self.form.weights());
            }
            self.account(step, &energy);
            if self.stall.step(t_end, self.statistics.largest_step) {
                return Err(Stop::Failed { cause: unevaluated, step_size: step });
            }
            h = self.options.fixed_step.unwrap_or(report.next_step);
            if let Some((_, beyond)) =
                knot.take().filter(|(at, _)| (at - t_end).abs() < AT_KNOT * step)
            {
                h = h.min(beyond);
                self.stepper.begin_trend(h);
            }
            // What has just been refused is approached again by doubling.
            longest = (2.0 * longest).min(growth * step);
            if reaches && next < end {
                self.note(EventKind::Breakpoint);
                self.stepper.restart();
                self.stage_powers.restart();
                self.form.begin_step(&self.state);
                h = self.first_step().map_err(|f| failed(f, 0.0))?;
            } else {
                self.check_parametrization().map_err(|f| failed(f, step))?;
            }
            self.checkpoint_if_due(Pace { next: h, longest, attempts })?;
            self.flush_if_due()?;
        }
        if let Some(carried) = &mut self.carried {
            let t = self.state.t;
            let along = are_still(&self.changing, [t, t]).then_some(&self.g[..]);
            carried.end(self.form.as_mut(), &mut self.scratch[0], (t, &self.w), along);
        }
        Ok(())
    }

    /// First row and first step.
    fn begin(&mut self) -> Result<Pace, Stop> {
        self.form.begin_step(&self.state);
        self.form.pack(&self.state, &mut self.w);
        self.record_chart();
        let chart = self.form.point().manifold.chart().parametrization();
        self.slowness.set_chart(self.system.as_ref(), None, chart, &self.options.tolerance);
        self.evaluate_slope().map_err(|f| failed(f, 0.0))?;
        self.begin_beside();
        if let Some(inspector) = &mut self.inspector {
            inspector.prepare(&self.w, &self.state);
        }
        self.condition_reference = self.form.point_mut().manifold.condition();
        self.start_residuals =
            residuals(self.system.as_ref(), &self.state, &mut self.residual_rows);
        self.form.point_mut().manifold.minimum_norm_multipliers(&mut self.state.lambda);
        while self.output.time() <= self.state.t {
            self.output.push(self.system.as_ref(), &self.state);
        }
        let next = self.first_step().map_err(|f| failed(f, 0.0))?;
        Ok(Pace { next, longest: f64::INFINITY, attempts: 0 })
    }

    /// Adds the times of the run since its first step here.
    fn add_times(&self, statistics: &mut Statistics) {
        let (looped, others) = &self.looped;
        let mut took = looped.elapsed() - self.sink_time;
        took += Stopwatch::of_others(&self.options.threads) - *others;
        statistics.run_seconds += took.wall.as_secs_f64();
        statistics.run_cpu_seconds += took.processor.as_secs_f64();
    }

    /// Slope at the present state; the form's factors then belong to it.
    fn evaluate_slope(&mut self) -> Result<(), EvaluationFailure> {
        self.form.derivative(self.state.t, &self.w, &mut self.g)
    }

    fn first_step(&mut self) -> Result<f64, EvaluationFailure> {
        if let Some(h) = self.options.fixed_step.or(self.options.initial_step) {
            return Ok(h);
        }
        let span = self.options.end_time - self.state.t;
        let order = self.stepper.starting_order();
        let (t, limit) = (self.state.t, self.options.max_step.min(span));
        let h =
            initial_step(self.form.as_mut(), order, t, &self.w, &self.g, limit, &mut self.scratch)?;
        Ok(h.min(limit))
    }

    /// The next step starts at the present state: the form stands there, and what it has factored serves those beside it.
    fn begin_step(&mut self) {
        self.form.begin_step(&self.state);
        self.begin_beside();
    }

    /// The same for what evaluates states inside steps.
    fn begin_beside(&mut self) {
        for recorder in std::iter::once(&mut self.recorder).chain(&mut self.inspector) {
            recorder.begin_step(self.form.point(), &self.state);
        }
    }
}

/// Whether none of them changes at these times.
fn are_still(functions: &[&TimeFunction], times: [f64; 2]) -> bool {
    let is_still = |function: &TimeFunction, t: f64| function.derivatives(t)[1..] == [0.0; 3];
    functions.iter().all(|function| times.iter().all(|&t| is_still(function, t)))
}

fn failed(failure: EvaluationFailure, step_size: f64) -> Stop {
    Stop::Failed { cause: Some(Rejection::Evaluation(failure)), step_size }
}
