//! The run loop: steps, output, limits, re-parametrization, diagnosis.

use super::checks::{RunError, check_options, check_tables, find_channels, set_accelerations};
use super::clock::{Elapsed, Stopwatch};
use super::dense::{ChartRecord, STEP_POWERS, Segments};
use super::diagnosis::{Stop, Suspects, diagnose};
use super::drift::Drift;
use super::energy_scale::EnergyScale;
use super::ledger::{StepPowers, powers};
use super::options::Options;
use super::output::{CHUNK_STEPS, Output};
use super::problem::Problem;
use super::recorder::{Inside, Recorder};
use super::reparametrization::{new_chart, no_longer_redundant};
use super::statistics::{EnergySummary, RunWarning, Statistics, Status, StopReason};
use super::step_length::{self, clip, smallest_step};
use super::trajectory::{EventKind, EventRecord, Flow, Sink, StepOutcome, StepRecord};
use super::warnings::warnings;
use crate::error::EvaluationFailure;
use crate::method::stepper::{Rejection, StepReport, Stepper, initial_step};
use crate::method::{StateSpace, build_state_space, build_stepper};
use crate::newton::MatrixOptions;
use crate::reduction::assembly::{AssemblyError, PROJECTED};
use crate::reduction::{Chart, Choice};
use crate::system::{EnergyBalance, State, System};
use crate::watch::{checkpoint, stage, within};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// A position residual may reach this times max(1, L).
const POSITION_RESIDUAL_BOUND: f64 = 1e-10;
/// A velocity residual may reach this times max(1, ‖q̇‖∞).
const VELOCITY_RESIDUAL_BOUND: f64 = 1e-10;
/// The partition is left alone while the condition of [G; P] is below this.
const CONDITION_FLOOR: f64 = 10.0;
/// Relative coordinates are chosen anew when the condition of [G; P] has grown by this factor: on a circle
/// limits of 2.5, 10 and 100 cost 178, 314 and 676 steps.
const TREE_GROWTH: f64 = 2.5;
/// Largest change of a direction or rotation in a step of an explicit formula, rad.
const EXPLICIT_TURN: f64 = 0.9;
/// References of directions and rotations move at every step; those of a multistep formula, whose history
/// would have to move along, when they are this far, rad.
const MULTISTEP_TURN: f64 = 1.5;
/// A tangent plane is renewed when the condition of [G; P] has grown by this factor at least.
const TANGENT_GROWTH: f64 = 2.0;
pub(super) const MAX_REJECTIONS: u32 = 60;
/// Numbers per coordinate in whose time a form of the equations is copied, about.
const COPIED: usize = 500;
const POLL: Duration = Duration::from_millis(50);
const FLUSH: Duration = Duration::from_millis(500);

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
    let begun = Stopwatch::start();
    let limit = Duration::try_from_secs_f64(options.max_seconds).ok();
    let mut run = within(limit, || set_up(problem, options, from, sink, begun))
        .map_err(|given_up| RunError::given_up(given_up, options))??;
    let looped = Stopwatch::start();
    let left = limit.map(|limit| limit.saturating_sub(begun.passed()));
    let stop = within(left, || stage("running", || run.advance()))
        .unwrap_or_else(|given_up| Err(Stop::from(given_up)));
    let (status, stop) = run.finish(stop);
    let took = looped.elapsed() - run.sink_time;
    run.statistics.run_seconds = took.wall.as_secs_f64();
    run.statistics.run_cpu_seconds = took.processor.as_secs_f64();
    Ok(Summary {
        status,
        stop,
        ndof: run.form.point().manifold.chart().ndof(),
        statistics: run.statistics,
        energy: run.energy,
        end: run.state,
        warnings: run.warnings,
    })
}

/// Everything that a run needs before its first step; it was asked for at `begun`.
fn set_up<'a>(
    problem: &Problem,
    options: &'a Options,
    from: Option<&State>,
    sink: &'a mut dyn Sink,
    begun: Stopwatch,
) -> Result<Run<'a>, RunError> {
    let system = problem.system().clone();
    // Copies of what is large take time, too.
    let copied = || checkpoint(COPIED * system.structure().sizes.coordinates);
    let given = from.map(|state| problem.start_from(state)).transpose()?;
    let start = from.map_or(problem.model().simulation.start_time.unwrap_or(0.0), |state| state.t);
    check_options(options, start, system.characteristic_length())?;
    check_tables(problem.model(), start, options.end_time)?;
    let (mut manifold, mut state) = match given {
        Some(given) => given,
        None => {
            let assembled = problem.assemble()?;
            (assembled.manifold.clone(), assembled.state.clone())
        }
    };

    if let Some(chart) = new_chart(options, &manifold, &state)
        .map_err(|failure| RunError::Assembly(AssemblyError::Evaluation(failure)))?
    {
        manifold.set_chart(chart);
    }
    set_accelerations(options, &mut manifold)?;
    let energy = system.energy(&state);
    if from.is_none() {
        state.ledger.initial = energy.kinetic + energy.potential;
    }
    let channels = find_channels(&system, &options.channels)?;
    let (code, profile, tolerance) = (options.code, options.profile, options.tolerance);
    copied();
    let mut form = build_state_space(code, profile, manifold, tolerance, &state);
    copied();
    let matrix = MatrixOptions {
        source: options.jacobian,
        representation: options.newton,
        threads: options.threads.clone(),
    };
    if matrix != MatrixOptions::default() {
        form.set_matrix(matrix);
    }
    let dimension = form.dimension();
    let fixed = options.fixed_step.is_some();
    let stepper = build_stepper(
        code,
        profile,
        form.as_mut(),
        tolerance,
        options.newmark,
        fixed,
        options.max_step,
    );
    let assembly = begun.elapsed();
    let statistics = Statistics {
        assembly_seconds: assembly.wall.as_secs_f64(),
        assembly_cpu_seconds: assembly.processor.as_secs_f64(),
        smallest_step: f64::INFINITY,
        ..Statistics::default()
    };
    let mut output = Output::new(options, &state, channels);
    if options.stores_dense_output() {
        let powers = if form.integrates_powers() { 0 } else { STEP_POWERS };
        output.chunk.dense = Segments::with_room(
            system.as_ref(),
            &state,
            dimension,
            stepper.largest_degree(),
            powers,
        );
    }
    copied();
    Ok(Run {
        options,
        condition_reference: 0.0,
        start_residuals: (0.0, 0.0),
        energy: EnergySummary { start: energy, ..EnergySummary::default() },
        kinetic_range: (energy.kinetic, energy.kinetic),
        energy_scale: EnergyScale::new(problem.model(), system.as_ref(), &state),
        drift: Drift::new(system.structure().sizes.bodies),
        powers: StepPowers { at: [[0.0; 2], [0.0; 2], powers(&energy)] },
        middle: None,
        output,
        recorder: Recorder::new(form.point(), dimension, form.integrates_powers()),
        w: vec![0.0; dimension],
        g: vec![0.0; dimension],
        w_end: vec![0.0; dimension],
        g_end: vec![0.0; dimension],
        scratch: [vec![0.0; dimension], vec![0.0; dimension]],
        row: state.clone(),
        state,
        form,
        stepper,
        statistics,
        warnings: Vec::new(),
        sink,
        begun,
        last_poll: Instant::now(),
        last_flush: Instant::now(),
        sink_time: Elapsed::default(),
        system,
    })
}

/// Everything of one run.
struct Run<'a> {
    options: &'a Options,
    system: Arc<dyn System>,
    form: Box<dyn StateSpace>,
    stepper: Box<dyn Stepper>,
    state: State,
    row: State,
    recorder: Recorder,
    w: Vec<f64>,
    g: Vec<f64>,
    w_end: Vec<f64>,
    g_end: Vec<f64>,
    scratch: [Vec<f64>; 2],
    condition_reference: f64,
    /// Residuals at the start, position and velocity: redundant rows may contradict each other a little.
    start_residuals: (f64, f64),
    statistics: Statistics,
    energy: EnergySummary,
    kinetic_range: (f64, f64),
    energy_scale: EnergyScale,
    drift: Drift,
    powers: StepPowers,
    /// Powers in the middle of the step just accepted, if they are known.
    middle: Option<[f64; 2]>,
    output: Output,
    warnings: Vec<RunWarning>,
    sink: &'a mut dyn Sink,
    begun: Stopwatch,
    last_poll: Instant,
    last_flush: Instant,
    sink_time: Elapsed,
}

impl Run<'_> {
    fn advance(&mut self) -> Result<(), Stop> {
        let end = self.options.end_time;
        self.form.begin_step(&self.state);
        self.form.pack(&self.state, &mut self.w);
        self.record_chart();
        self.evaluate_slope().map_err(|f| failed(f, 0.0))?;
        self.condition_reference = self.form.point_mut().manifold.chart_mut().condition();
        self.start_residuals = self.form.point_mut().manifold.residuals(&self.state);
        self.form.point_mut().manifold.minimum_norm_multipliers(&mut self.state.lambda);
        while self.output.time() <= self.state.t {
            self.output.push(self.system.as_ref(), &self.state);
        }
        let breakpoints = self.system.breakpoints();
        let span = end - self.state.t;
        let kinematic = self.form.point().manifold.chart().ndof() == 0;
        let fixed = self.options.fixed_step.is_some();
        let mut longest = f64::INFINITY;
        let mut h = self.first_step().map_err(|f| failed(f, 0.0))?;
        let mut attempts = 0;
        let mut rejections = 0;
        let mut repartitioned = false;
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
            if !fixed {
                let tree = self.options.parametrization == Choice::Tree;
                h = h.min(step_length::longest(self.system.as_ref(), &self.state, tree));
                if self.stepper.explicit() {
                    h = h.min(self.explicit_turn());
                }
                if kinematic {
                    let most = step_length::kinematic(self.system.as_ref(), &self.state, span);
                    h = h.min(most).min(longest);
                }
            }
            let (step, reaches) = clip(t, h, next, fixed);
            let mut report = self.stepper.attempt(self.form.as_mut(), t, step, &self.w, &self.g);
            let t_end = if reaches { next } else { t + step };
            let mut rejection = report.cause.take();
            if report.accepted {
                rejection = self.accept(t, step, t_end).err().map(Rejection::Evaluation);
            }
            self.record(t, step, &report, rejection.as_ref());
            if let Some(cause) = rejection {
                rejections += 1;
                let retry = if report.accepted { 0.5 * step } else { report.next_step };
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
                if !fixed {
                    h = retry;
                    longest = retry;
                }
                continue;
            }
            (rejections, repartitioned) = (0, false);
            let energy = self.emit(t, step)?;
            self.account(step, &energy);
            h = self.options.fixed_step.unwrap_or(report.next_step);
            // What has just been refused is approached again by doubling.
            longest *= 2.0;
            if reaches && next < end {
                self.note(EventKind::Breakpoint);
                self.stepper.restart();
                self.form.begin_step(&self.state);
                h = self.first_step().map_err(|f| failed(f, 0.0))?;
            } else {
                self.check_partition().map_err(|f| failed(f, step))?;
            }
            self.flush_if_due()?;
        }
        Ok(())
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
        self.form.point_mut().complete();
        self.check_residuals().inspect_err(|_| self.stepper.discard())?;
        self.find_middle(t, step);
        Ok(())
    }

    /// Powers in the middle of the accepted step, where the ledger needs them.
    fn find_middle(&mut self, t: f64, step: f64) {
        if self.form.integrates_powers() {
            return;
        }
        // Driver power needs multipliers; without drivers the recovery is enough.
        let full = self.system.has_drivers();
        let stepper = &mut self.stepper;
        let interpolate = &mut |theta: f64, w: &mut [f64]| stepper.interpolate(theta, w);
        let middle = self.recorder.state(interpolate, t, step, 0.5, full);
        // The middle of an accepted step failing is rare; the trapezoid serves.
        self.middle = middle.ok().map(|middle| powers(&self.system.energy(middle)));
        self.recorder.begin_step(self.form.point(), &self.state);
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
        self.form.point_mut().manifold.minimum_norm_multipliers(&mut self.row.lambda);
        std::mem::swap(&mut self.row, &mut self.state);
        let t_end = self.state.t;
        // `self.row` is now the state at the start, `self.state` the one at the end.
        self.system.update_windings(t_end, &self.state.q, &mut self.state.winding);
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
                self.flush()?;
                self.poll(step)?;
            }
        }
        while self.output.time() <= t_end {
            self.output.push(self.system.as_ref(), &self.state);
        }
        self.w.copy_from_slice(&self.w_end);
        self.g.copy_from_slice(&self.g_end);
        self.move_references().map_err(|f| failed(f, step))?;
        self.form.begin_step(&self.state);
        self.recorder.begin_step(self.form.point(), &self.state);
        self.statistics.output_seconds += begun.elapsed().as_secs_f64();
        Ok(energy)
    }

    /// Measures relative orientations and directions from the new state, whose independent variables and
    /// slope are read anew.
    fn move_references(&mut self) -> Result<(), EvaluationFailure> {
        let point = self.form.point_mut();
        let ndof = point.manifold.chart().ndof();
        let turn = if self.stepper.multistep() { MULTISTEP_TURN } else { 0.0 };
        if !point.move_references(&self.w[..ndof], turn)? {
            return Ok(());
        }
        if self.stepper.multistep() {
            self.stepper.restart();
            self.record_chart();
        }
        self.form.pack(&self.state, &mut self.w);
        let (rates, rest) = self.g.split_at_mut(ndof);
        rates.copy_from_slice(&self.w[ndof..2 * ndof]);
        self.form.point().manifold.independent_acceleration(&self.state, &mut rest[..ndof]);
        self.form.references_moved(&self.w);
        Ok(())
    }

    /// Longest step of an explicit formula, s: what is about to tumble swings about a steady turn as fast as
    /// it turns, which no error shows before it has grown.
    fn explicit_turn(&self) -> f64 {
        let manifold = &self.form.point().manifold;
        let Some(relatives) = manifold.chart().parametrization().relatives() else {
            return f64::INFINITY;
        };
        let ndof = manifold.chart().ndof();
        EXPLICIT_TURN / relatives.turning(self.system.as_ref(), &self.w[ndof..2 * ndof])
    }

    /// Step sizes and energy of the new state.
    fn account(&mut self, step: f64, energy: &EnergyBalance) {
        let s = &mut self.statistics;
        s.smallest_step = s.smallest_step.min(step);
        s.largest_step = s.largest_step.max(step);
        let ledger = &self.state.ledger;
        let imbalance = energy.kinetic + energy.potential - ledger.initial + ledger.dissipated
            - ledger.supplied;
        let e = &mut self.energy;
        e.largest_imbalance = e.largest_imbalance.max(imbalance.abs());
        let (low, high) = self.kinetic_range;
        self.kinetic_range = (low.min(energy.kinetic), high.max(energy.kinetic));
        let (system, tolerance) = (self.system.as_ref(), &self.options.tolerance);
        self.energy_scale.take(system, &self.state, energy);
        let part = self.energy_scale.part_of_velocities(imbalance);
        self.drift.follow(system, &self.state, step, part, tolerance);
    }

    /// Chooses another partition when the present one has become ill-conditioned.
    fn check_partition(&mut self) -> Result<(), EvaluationFailure> {
        let condition = self.form.point_mut().manifold.chart_mut().condition();
        if let Some(last) = self.output.chunk.steps.last_mut() {
            last.condition = condition;
        }
        let factor = self.options.repartition_factor;
        let limit = match self.options.parametrization {
            Choice::Tree => {
                let parametrization = self.form.point().manifold.chart().parametrization();
                if !parametrization.relatives().is_some_and(|r| r.has_alternatives) {
                    return Ok(());
                }
                TREE_GROWTH * self.condition_reference
            }
            Choice::Partitioning => (factor * self.condition_reference).max(CONDITION_FLOOR),
            // A tangent plane can always be renewed, and is best near its point of contact.
            _ => factor.max(TANGENT_GROWTH) * self.condition_reference,
        };
        if condition > limit {
            self.repartition(condition)?;
        }
        Ok(())
    }

    /// New partition at the present state.
    fn repartition(&mut self, condition: f64) -> Result<(), EvaluationFailure> {
        match new_chart(self.options, &self.form.point().manifold, &self.state)? {
            Some(chart) => self.set_chart(chart),
            None => {
                self.condition_reference = condition;
                Ok(())
            }
        }
    }

    fn set_chart(&mut self, chart: Chart) -> Result<(), EvaluationFailure> {
        self.statistics.reparametrizations += 1;
        self.note(EventKind::Reparametrization);
        self.recorder.set_chart(chart.clone());
        self.form.point_mut().manifold.set_chart(chart);
        self.form.reparametrized();
        if self.stepper.explicit() {
            self.stepper.restart();
        }
        self.stepper.invalidate(false);
        self.form.begin_step(&self.state);
        self.recorder.begin_step(self.form.point(), &self.state);
        self.form.pack(&self.state, &mut self.w);
        self.record_chart();
        self.evaluate_slope()?;
        self.condition_reference = self.form.point_mut().manifold.chart_mut().condition();
        Ok(())
    }

    /// Hands out the chart of the next steps, for dense output.
    fn record_chart(&mut self) {
        if self.options.stores_dense_output() {
            let parametrization = self.form.point().manifold.chart().parametrization();
            let chart = ChartRecord {
                t: self.state.t,
                q: self.state.q.clone(),
                forest: self.system.tree().forest.clone(),
                parametrization: parametrization.clone(),
                follows: !self.stepper.multistep(),
            };
            self.output.chunk.dense.push_chart(self.system.as_ref(), chart);
        }
    }

    /// After a failed recovery: another partition at the step's start, if there is a better one.
    fn repartition_at_start(&mut self) -> Result<(), EvaluationFailure> {
        self.form.begin_step(&self.state);
        self.form.pack(&self.state, &mut self.w);
        self.evaluate_slope()?;
        let condition = self.form.point_mut().manifold.chart_mut().condition();
        self.repartition(condition)
    }

    fn record(&mut self, t: f64, h: f64, report: &StepReport, rejection: Option<&Rejection>) {
        let outcome = match rejection {
            None => StepOutcome::Accepted,
            Some(Rejection::ErrorTooLarge) => StepOutcome::Error,
            Some(Rejection::NewtonDivergence | Rejection::NewtonSlow) => StepOutcome::Newton,
            Some(_) => StepOutcome::Evaluation,
        };
        let s = &mut self.statistics;
        match outcome {
            StepOutcome::Accepted => s.steps += 1,
            StepOutcome::Error => s.rejected_error += 1,
            StepOutcome::Newton => s.rejected_newton += 1,
            StepOutcome::Evaluation => s.rejected_evaluation += 1,
        }
        self.output.chunk.steps.push(StepRecord {
            t,
            h,
            error: report.error,
            outcome,
            iterations: report.iterations,
            order: self.stepper.order(),
            condition: 0.0,
        });
    }

    fn note(&mut self, kind: EventKind) {
        self.output.chunk.events.push(EventRecord { t: self.state.t, kind });
    }

    fn poll(&mut self, h: f64) -> Result<(), Stop> {
        if self.begun.passed().as_secs_f64() > self.options.max_seconds {
            return Err(Stop::MaxSeconds);
        }
        if self.last_poll.elapsed() < POLL {
            return Ok(());
        }
        let begun = Stopwatch::start();
        let flow = self.sink.progress(self.state.t, h, self.statistics.steps);
        self.last_poll = Instant::now();
        self.sink_time += begun.elapsed();
        match flow {
            Flow::Continue => Ok(()),
            Flow::Interrupt => Err(Stop::Interrupted),
        }
    }

    fn flush_if_due(&mut self) -> Result<(), Stop> {
        let chunk = &self.output.chunk;
        let full =
            self.output.is_full() || chunk.steps.len() >= CHUNK_STEPS || chunk.dense.is_full();
        if full || self.last_flush.elapsed() >= FLUSH {
            self.flush()?;
        }
        Ok(())
    }

    fn flush(&mut self) -> Result<(), Stop> {
        let begun = Stopwatch::start();
        self.statistics.outputs += self.output.chunk.time.len() as u64;
        let result = self.sink.chunk(&self.output.chunk).map_err(Stop::Sink);
        self.output.chunk.clear();
        self.last_flush = Instant::now();
        self.sink_time += begun.elapsed();
        result
    }

    /// Flushes, completes the statistics and says why the run ended.
    fn finish(&mut self, stop: Result<(), Stop>) -> (Status, StopReason) {
        if stop.is_err() {
            self.output.push_last(self.system.as_ref(), &self.state);
        }
        let flushed = self.flush();
        let counters = self.form.point().manifold.counters;
        let stepper = *self.stepper.statistics();
        let s = &mut self.statistics;
        s.evaluations = stepper.derivatives;
        s.jacobians = stepper.linearizations;
        s.factorizations = stepper.factorizations;
        s.iterations = stepper.iterations;
        s.stiff_steps = stepper.stiff_steps;
        s.recoveries = counters.recoveries;
        s.corrections = counters.corrections;
        s.constraint_factorizations = counters.factorizations;
        s.accelerations = counters.accelerations;
        s.analyses = self.form.point().manifold.analyses();
        if s.steps == 0 {
            s.smallest_step = 0.0;
        }
        let energy = self.system.energy(&self.state);
        let ledger = self.state.ledger;
        let e = &mut self.energy;
        e.end = energy;
        e.dissipated = ledger.dissipated;
        e.supplied = ledger.supplied;
        e.imbalance = energy.kinetic + energy.potential - ledger.initial + ledger.dissipated
            - ledger.supplied;
        e.range = self.kinetic_range.1 - self.kinetic_range.0;
        e.moved = self.energy_scale.moved();
        let dropped = &self.form.point().manifold.chart().parametrization().dropped;
        let (system, tolerance) = (self.system.as_ref(), &self.options.tolerance);
        let negligible = self.energy_scale.negligible(system, tolerance);
        self.warnings =
            warnings(system, dropped, s, e, negligible, self.drift.largest(), tolerance);
        let stop = match (stop, flushed) {
            (Err(Stop::Sink(message)), _) | (Ok(()), Err(Stop::Sink(message))) => {
                Err(Stop::Sink(message))
            }
            (stop, _) => stop,
        };
        let suspects = match &stop {
            // A search that is given up finds nothing; the run is told as it ended.
            Err(Stop::Failed { .. }) => within(None, || {
                Suspects::find(self.form.as_mut(), self.stepper.as_ref(), &self.state)
            })
            .unwrap_or_default(),
            _ => Suspects::default(),
        };
        diagnose(stop, self.state.t, self.options, &suspects, self.system.as_ref())
    }
}

fn failed(failure: EvaluationFailure, step_size: f64) -> Stop {
    Stop::Failed { cause: Some(Rejection::Evaluation(failure)), step_size }
}
