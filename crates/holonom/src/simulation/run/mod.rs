//! The run loop: steps, outputs, limits.

mod carrying;
mod charts;
mod checkpoints;
mod passing;
mod reporting;
mod set_up;

use crate::error::EvaluationFailure;
use crate::method::StateSpace;
use crate::method::stepper::{Rejection, Stepper, StepperStatistics, initial_step};
use crate::model::{Model, force_ramps};
use crate::reduction::Choice;
use crate::reduction::assembly::{AssemblyError, PROJECTED};
use crate::simulation::carried_error::CarriedError;
use crate::simulation::checkpoint::{Checkpoint, Pace, foreign};
use crate::simulation::checks::RunError;
use crate::simulation::clock::{Elapsed, Stopwatch};
use crate::simulation::diagnosis::Stop;
use crate::simulation::drift::Drift;
use crate::simulation::energy_scale::EnergyScale;
use crate::simulation::ledger::{Quadrature, StepPowers, powers};
use crate::simulation::options::Options;
use crate::simulation::output::Output;
use crate::simulation::passage::{Place, Way};
use crate::simulation::problem::Problem;
use crate::simulation::recorder::{Inside, Recorder};
use crate::simulation::reparametrization::no_longer_redundant;
use crate::simulation::second_run;
use crate::simulation::slowness::{LimitedBy, Limits, Slowness};
use crate::simulation::stall::Stall;
use crate::simulation::statistics::{EnergySummary, RunWarning, Statistics, Status, StopReason};
use crate::simulation::step_length::{self, clip, smallest_step};
use crate::simulation::trajectory::{EventKind, Memory, Sink};
use crate::simulation::warnings::chosen;
use crate::system::{EnergyBalance, State, System};
use crate::watch::{stage, unwatched, within};
use charts::LONGEST_TURN;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A position residual may reach this times max(1, L).
const POSITION_RESIDUAL_BOUND: f64 = 1e-10;
/// A velocity residual may reach this times max(1, ‖q̇‖∞).
const VELOCITY_RESIDUAL_BOUND: f64 = 1e-10;
pub(in crate::simulation) const MAX_REJECTIONS: u32 = 60;
/// Part of the step at which energies would be on tolerance, and the least of one, that follow a step of a run without unknowns.
const SAFE_PART: f64 = 0.9;
const SHORTEST_PART: f64 = 0.1;
/// The shortest step that powers make, as a part of the longest that such a run takes.
const SHORTEST_OF_USUAL: f64 = 1e-3;

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
        self.limits.told(system, &self.end)
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

/// Turn in a step from which what iterations leave counts among carried errors, rad.
const FAR: f64 = 0.3;

/// A run, and a second one where the errors of its steps may have grown beyond what they were allowed.
fn begin(
    problem: &Problem,
    options: &Options,
    start: Start<'_>,
    sink: &mut dyn Sink,
) -> Result<Summary, RunError> {
    let begun = Stopwatch::start();
    let (mut summary, carried) = once(problem, options, start, "running", sink)?;
    if let Some(carried) = carried
        && summary.status == Status::Completed
    {
        let limit = Duration::try_from_secs_f64(options.max_seconds).ok();
        let left = || limit.map(|limit| limit.saturating_sub(begun.passed()));
        let checked = Stopwatch::start();
        // Where this is given up, the run is whole all the same.
        let look = || stage("checking", || carried.longest_step_to_tell(problem, options));
        if let Ok(Some(most)) = within(left(), look) {
            let found =
                second_run::compare(problem, options, &carried.milestones, most, left(), sink);
            summary.warnings.extend(found);
        }
        let took = checked.elapsed();
        summary.statistics.run_seconds += took.wall.as_secs_f64();
        summary.statistics.run_cpu_seconds += took.processor.as_secs_f64();
    }
    Ok(summary)
}

/// A run, under the name of its `task` for those who watch, and what it knows of its error.
pub(in crate::simulation) fn once(
    problem: &Problem,
    options: &Options,
    start: Start<'_>,
    task: &'static str,
    sink: &mut dyn Sink,
) -> Result<(Summary, Option<CarriedError>), RunError> {
    let begun = Stopwatch::start();
    let limit = Duration::try_from_secs_f64(options.max_seconds).ok();
    let mut run = within(limit, || set_up::set_up(problem, options, start, sink, begun))
        .map_err(|given_up| RunError::given_up(given_up, options))??;
    run.looped = (Stopwatch::start(), Stopwatch::of_others(&options.threads));
    let left = limit.map(|limit| limit.saturating_sub(begun.passed()));
    let stop = within(left, || stage(task, || run.advance()))
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
    form: Box<dyn StateSpace>,
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
    /// Arguments of force laws in the middle of the step just accepted, if it is known.
    halfway: Vec<Place>,
    /// Room for a dense output and for the way of a force law's argument.
    coefficients: Vec<f64>,
    way: Way,
    condition_reference: f64,
    /// Residuals at the start, position and velocity: redundant rows may contradict each other a little.
    start_residuals: (f64, f64),
    statistics: Statistics,
    slowness: Slowness,
    energy: EnergySummary,
    kinetic_range: (f64, f64),
    energy_scale: EnergyScale,
    drift: Drift,
    /// Of runs that have one.
    carried: Option<CarriedError>,
    powers: StepPowers,
    /// Whether the present state has its multipliers: what needs them completes it.
    complete: bool,
    /// Whether a law has passed a knot in the step just accepted, or a line its other end.
    passes_knot: bool,
    /// Something that it passes over is small only because the matrix of the step damps it.
    is_damped: bool,
    /// Powers in the middle of the step just accepted, if they are known.
    middle: Option<[f64; 2]>,
    quadrature: Quadrature,
    stall: Stall,
    output: Output,
    warnings: Vec<RunWarning>,
    sink: &'a mut dyn Sink,
    /// First time of the run, s.
    started: f64,
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
        let span = end - self.started;
        let kinematic = self.form.point().manifold.chart().ndof() == 0;
        let fixed = self.options.fixed_step.is_some();
        let relative = self.options.tolerance.relative;
        // Formulas that evaluate forces at the ends of steps alone.
        let ends_only =
            self.stepper.multistep() || self.options.code.info().formula == "trapezoidal";
        let drivers = step_length::drivers(self.system.as_ref(), [self.started, end]);
        let ramps = force_ramps(self.model);
        let mut rejections = 0;
        let mut repartitioned = false;
        let mut seen = true;
        // Why the last attempt could not be evaluated.
        let mut unevaluated = None;
        while self.state.t < end {
            self.poll(h)?;
            if attempts >= self.options.max_steps {
                return Err(Stop::MaxSteps);
            }
            attempts += 1;
            let t = self.state.t;
            let next = breakpoints[breakpoints.partition_point(|&b| b <= t)..]
                .first()
                .map_or(end, |&b| b.min(end));
            let turning = self.turning();
            if !fixed && ends_only && breakpoints.binary_search_by(|b| b.total_cmp(&t)).is_ok() {
                // A curve may begin and end with nothing and be large between.
                h = h.min(0.5 * (next - t));
            }
            if !fixed {
                let tree = self.options.parametrization == Choice::Tree;
                h = h.min(step_length::longest(self.system.as_ref(), &self.state, tree));
                h = h.min(LONGEST_TURN / turning).min(step_length::ramped(&ramps, t, end));
                if !drivers.is_empty() {
                    let most = h.min(next - t);
                    h = step_length::driven(self.system.as_ref(), &drivers, t, most, relative);
                }
                if kinematic {
                    let most = step_length::kinematic(self.system.as_ref(), &self.state, span);
                    h = h.min(most).min(longest);
                }
            }
            let (step, reaches) = clip(t, h, next, fixed);
            let t_end = if reaches { next } else { t + step_length::told(step, t, end) };
            if t_end <= t {
                return Err(Stop::Failed { cause: None, step_size: step });
            }
            let step = t_end - t;
            let mut report = self.stepper.attempt(self.form.as_mut(), t, step, &self.w, &self.g);
            let mut rejection = report.cause.take();
            let mut retry = if report.accepted { 0.5 * step } else { report.next_step };
            if report.accepted {
                rejection = self.accept(t, step, t_end).err().map(Rejection::Evaluation);
            }
            if report.accepted
                && rejection.is_none()
                && let Some(passed) = self.passed_over(t, step, t_end)
            {
                self.stepper.discard();
                (rejection, report.error) = (Some(Rejection::ErrorTooLarge), passed.error);
                // The next attempt ends where it sees what this one did not, the one after that is shorter still.
                let first = std::mem::replace(&mut seen, false);
                retry = (passed.time - t).min(if first { step } else { 0.5 * step });
            }
            let mut growth = f64::INFINITY;
            // Nothing else tells of a bump under a wheel that is driven over it.
            let follows = kinematic || self.passes_knot && self.system.drivers_move(t);
            if report.accepted && rejection.is_none() && follows && !fixed {
                let missed = self.follow_powers(t, step, span);
                growth = (SAFE_PART * missed.powf(-0.25)).max(SHORTEST_PART);
                if missed > 1.0 {
                    self.stepper.discard();
                    (rejection, report.error) = (Some(Rejection::ErrorTooLarge), missed);
                    retry = growth * step;
                }
            }
            self.record(t, step, &report, rejection.as_ref());
            let (accepted, change) = (rejection.is_none(), self.stepper.last_change());
            self.slowness.count(accepted, report.error, change, &self.w);
            if let Some(cause) = rejection {
                rejections += 1;
                let lost = matches!(&cause, Rejection::Evaluation(_));
                let before = self.statistics.reparametrizations;
                if lost && !std::mem::replace(&mut repartitioned, true) {
                    self.repartition_at_start().map_err(|f| failed(f, step))?;
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
            (rejections, repartitioned, seen) = (0, false, true);
            let moves = self.references_are_to_move();
            if let Some(carried) = &mut self.carried {
                let (stepper, form) = (self.stepper.as_mut(), self.form.as_mut());
                let chart = form.point().manifold.chart().parametrization();
                let turn = step * turning;
                // Where matrices do not turn along with bodies, or these turn far.
                let far = chart.relatives().is_none() || turn > FAR;
                let iterated = far.then_some((step, &self.g_end[..]));
                let power = &mut self.scratch[0];
                let ended = (t_end, step, &self.w_end[..]);
                let passes_knot = self.passes_knot;
                let known = carried.follow(
                    stepper,
                    form,
                    report.error,
                    power,
                    iterated,
                    passes_knot,
                    turn,
                    ended,
                );
                if known {
                    carried.look(form, moves);
                } else {
                    // The form may be elsewhere: back to the end of the step.
                    let found = form.derivative(t_end, &self.w_end, &mut self.g_end);
                    found.map_err(|f| failed(f, step))?;
                }
            }
            let energy = self.emit(t, step)?;
            if let Some(carried) = &mut self.carried {
                carried.milestones.pass(self.statistics.steps, &self.state);
            }
            self.account(step, &energy);
            if self.stall.step(t_end, self.statistics.largest_step) {
                return Err(Stop::Failed { cause: unevaluated, step_size: step });
            }
            h = self.options.fixed_step.unwrap_or(report.next_step);
            // What has just been refused is approached again by doubling.
            longest = (2.0 * longest).min(growth * step);
            if reaches && next < end {
                self.note(EventKind::Breakpoint);
                self.stepper.restart();
                self.form.begin_step(&self.state);
                h = self.first_step().map_err(|f| failed(f, 0.0))?;
            } else {
                self.check_partition().map_err(|f| failed(f, step))?;
            }
            self.checkpoint_if_due(Pace { next: h, longest, attempts })?;
            self.flush_if_due()?;
        }
        if let Some(carried) = &mut self.carried {
            carried.end(self.form.as_mut(), &mut self.scratch[0], self.state.t, &self.w);
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
        self.start_residuals = self.form.point_mut().manifold.residuals(&self.state);
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

    /// Takes over the end of an accepted attempt from `t` over `step`: state with accelerations at `t_end`.
    fn accept(&mut self, t: f64, step: f64, t_end: f64) -> Result<(), EvaluationFailure> {
        self.w_end.copy_from_slice(self.stepper.end().w);
        if let Err(failure) = self.form.derivative(t_end, &self.w_end, &mut self.g_end) {
            self.stepper.discard();
            return Err(failure);
        }
        self.check_residuals().inspect_err(|_| self.stepper.discard())?;
        self.find_middle(t, step, t_end);
        Ok(())
    }

    /// Powers in the middle of the accepted step, where the ledger needs them, and arguments of force laws.
    fn find_middle(&mut self, t: f64, step: f64, t_end: f64) {
        self.middle = None;
        self.halfway.clear();
        let powered = !self.form.integrates_powers();
        let looks = self.may_pass_over(t, step, t_end);
        if !powered && !looks {
            return;
        }
        // Driver power needs multipliers; without drivers the recovery is enough.
        let full = powered && self.system.drivers_move(t + 0.5 * step);
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let recorder = match &mut self.inspector {
            Some(inspector) if looks => {
                inspector.begin_again(&self.state);
                inspector
            }
            _ => &mut self.recorder,
        };
        // The middle of an accepted step failing is rare; the trapezoid serves.
        if let Ok(middle) = recorder.state(interpolate, t, step, 0.5, full) {
            let system = self.system.as_ref();
            self.middle = powered.then(|| powers(&system.energy(middle)));
            let arguments = system.law_arguments().iter().filter(|_| looks);
            self.halfway.extend(arguments.map(|a| Place::of(system, a, t + 0.5 * step, middle)));
        }
        self.recorder.begin_again(&self.state);
    }

    /// Powers along the accepted step of a run of `span` seconds, and how many tolerances of its
    /// energies a step of this length misses. Nothing where one cannot look into it.
    fn follow_powers(&mut self, t: f64, step: f64, span: f64) -> f64 {
        // Where a power jumps, nothing else ends the refinement.
        if step < SHORTEST_OF_USUAL * span / step_length::KINEMATIC_STEPS {
            return 0.0;
        }
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let mut at = [self.powers.at[2]; 5];
        for (theta, at) in [0.25, 0.5, 0.75, 1.0].into_iter().zip(&mut at[1..]) {
            let Ok(state) = self.recorder.state(interpolate, t, step, theta, true) else {
                return 0.0;
            };
            *at = powers(&self.system.energy(state));
        }
        // Powers are those of joints that are met to so much.
        let tolerance = self.options.tolerance.relative.max(POSITION_RESIDUAL_BOUND);
        // What turns steadily has powers of round-off only, and what is heavy large ones.
        let negligible =
            self.energy_scale.negligible(self.system.as_ref(), &self.options.tolerance);
        let rate = (tolerance * self.energy_scale.moved()).max(negligible) / span;
        let (middle, missed) = self.quadrature.middle(&at, step, rate, tolerance);
        self.middle = Some(middle);
        missed
    }

    /// Residuals of the state just evaluated, whose Jacobian is at hand.
    ///
    /// Redundant rows are left out of all solves: a row that is no longer redundant, as when a linkage
    /// leaves a flat position, shows by its residual only.
    fn check_residuals(&mut self) -> Result<(), EvaluationFailure> {
        self.row.copy_from(&self.form.point().state);
        let (position, velocity) = self.form.point_mut().manifold.residuals(&self.row);
        let speed = self.row.v.iter().fold(1.0f64, |m, v| m.max(v.abs()));
        let length = self.system.characteristic_length().max(1.0);
        let allowed = [
            10.0 * self.start_residuals.0 + PROJECTED * length,
            10.0 * self.start_residuals.1 + PROJECTED * speed,
        ];
        if position > allowed[0] || velocity > allowed[1] {
            let dropped = &self.form.point().manifold.chart().parametrization().dropped;
            if let Some(failure) = no_longer_redundant(self.system.as_ref(), dropped, &self.row) {
                return Err(failure);
            }
        }
        let s = &mut self.statistics;
        s.position_residual = s.position_residual.max(position);
        s.velocity_residual = s.velocity_residual.max(velocity);
        s.residual_ratio = s
            .residual_ratio
            .max(position / (POSITION_RESIDUAL_BOUND * length))
            .max(velocity / (VELOCITY_RESIDUAL_BOUND * speed));
        Ok(())
    }

    /// Output rows inside the step, then the new state. Returns the energy at its end.
    fn emit(&mut self, t: f64, step: f64) -> Result<EnergyBalance, Stop> {
        let begun = Instant::now();
        // Here a step counts, in whole: nothing is given up before it is among the steps that are stored.
        self.row.copy_from(&self.form.point().state);
        std::mem::swap(&mut self.row, &mut self.state);
        self.complete = false;
        // Powers of drivers are those of their multipliers.
        let t_end = self.state.t;
        if self.system.drivers_move(t_end) || t_end >= self.options.end_time {
            self.take_multipliers();
        }
        self.w.copy_from_slice(&self.w_end);
        self.g.copy_from_slice(&self.g_end);
        // `self.row` is now the state at the start, `self.state` the one at the end.
        self.system.update_windings(t_end, &self.state.q, &mut self.state.winding);
        if let Some(longest) = self.carried.as_mut().and_then(|carried| carried.longest.as_mut()) {
            longest.take(self.options.end_time - self.started, &self.row, &self.state);
        }
        self.powers.at[0] = self.powers.at[2];
        let energy = self.system.energy(&self.state);
        self.powers.at[2] = powers(&energy);
        let ledger = self.row.ledger;
        if !self.form.integrates_powers() {
            let [start, _, end] = self.powers.at;
            let trapezoid = || std::array::from_fn(|k| 0.5 * (start[k] + end[k]));
            self.powers.at[1] = self.middle.unwrap_or_else(trapezoid);
            self.state.ledger = self.powers.advance(&ledger, step, 1.0);
        }
        self.state.ledger.initial = ledger.initial;
        if self.options.stores_dense_output() {
            let powers = (!self.form.integrates_powers()).then_some(&self.powers);
            let dense = &mut self.output.chunk.dense;
            let chart = self.form.point().manifold.chart();
            dense.push(&self.row, chart, step, t_end, powers, self.stepper.as_ref());
        }
        while self.output.time() < t_end {
            let time = self.output.time();
            let powers = self.powers;
            let stepper = &mut self.stepper;
            let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
            let mut inside = Inside { t, step, interpolate, ledger, powers };
            let found = self.recorder.row(&mut inside, time, &mut self.row);
            found.map_err(|f| failed(f, step))?;
            self.output.push(self.system.as_ref(), &self.row);
            // A step may hold any number of rows: they go out in chunks, and the run can be stopped.
            if self.output.is_full() {
                // Its record is not complete before the end of the step.
                let record = self.output.chunk.steps.pop();
                let flushed = self.flush();
                self.output.chunk.steps.extend(record);
                flushed?;
                self.poll(step)?;
            }
        }
        while self.output.time() <= t_end {
            self.take_multipliers();
            self.output.push(self.system.as_ref(), &self.state);
        }
        self.move_references().map_err(|f| failed(f, step))?;
        self.begin_step();
        self.statistics.output_seconds += begun.elapsed().as_secs_f64();
        Ok(energy)
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

    /// Multipliers of the end of the step just accepted, where the form of the equations still stands.
    fn take_multipliers(&mut self) {
        if self.complete {
            return;
        }
        let (point, state) = (self.form.point_mut(), &mut self.state);
        // The step counts by now: a state in part must not be its end.
        unwatched(|| {
            point.complete();
            state.lambda.copy_from_slice(&point.state.lambda);
            point.manifold.minimum_norm_multipliers(&mut state.lambda);
        });
        self.complete = true;
    }

    /// Multipliers of the present state, wherever the form stands; also where the run is given up.
    fn complete_state(&mut self) {
        if !std::mem::replace(&mut self.complete, true) {
            unwatched(|| self.recorder.complete(&self.w, &mut self.state));
        }
    }

    /// Step sizes and energy of the new state.
    fn account(&mut self, step: f64, energy: &EnergyBalance) {
        let s = &mut self.statistics;
        s.smallest_step = s.smallest_step.min(step);
        s.largest_step = s.largest_step.max(step);
        let e = &mut self.energy;
        let imbalance = self.state.ledger.imbalance(energy) - e.missing;
        e.largest_imbalance = e.largest_imbalance.max(imbalance.abs());
        let (low, high) = self.kinetic_range;
        self.kinetic_range = (low.min(energy.kinetic), high.max(energy.kinetic));
        let (system, tolerance) = (self.system.as_ref(), &self.options.tolerance);
        self.energy_scale.take(system, &self.state, energy);
        let part = self.energy_scale.part_of_velocities(imbalance);
        self.drift.follow(system, &self.state, step, part, tolerance);
    }
}

fn failed(failure: EvaluationFailure, step_size: f64) -> Stop {
    Stop::Failed { cause: Some(Rejection::Evaluation(failure)), step_size }
}
