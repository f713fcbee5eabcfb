//! What a run refuses before it starts.

use super::options::{Options, OutputTimes};
use super::output::OUTPUT_SLACK;
use super::step_length::smallest_step;
use crate::error::{printable, shown};
use crate::method::{Code, Newmark, UnknownMethod};
use crate::model::{Model, MotionTable, Tolerance, motion_tables};
use crate::newton::{JacobianSource, Representation};
use crate::reduction::accelerations::{Accelerations, Refusal};
use crate::reduction::assembly::{AssemblyError, PROJECTED, unit_of_row};
use crate::reduction::{Coordinates, Manifold, ParametrizationKind, largest_index};
use crate::system::{Channel, State, System};
use crate::watch::GivenUp;
use std::sync::Arc;

/// Smallest tolerance: a step's error cannot be told from the round-off of its arithmetic below.
pub(super) const SMALLEST_TOLERANCE: f64 = 1e-13;
/// Last time at which a run may end, s.
const LATEST: f64 = 1e12;
/// Largest number of output rows of a run.
const MOST_ROWS: f64 = 1e7;
/// Largest matrix of all constraints by all coordinates that a parametrization may make dense, GB.
const MOST_GIGABYTES: f64 = 2.0;

/// Why a run could not start.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RunError {
    /// No consistent start.
    #[error(transparent)]
    Assembly(#[from] AssemblyError),
    /// A channel that does not exist.
    #[error("unknown channel `{name}`{}", nearest.as_ref().map_or(String::new(), |n| format!("; did you mean `{n}`?")))]
    UnknownChannel {
        /// What was asked for.
        name: String,
        /// The channel nearest in name.
        nearest: Option<String>,
    },
    /// Whoever watches this thread asked for it before the first step.
    #[error("interrupted before the first step")]
    Interrupted,
    /// The time was over before the first step.
    #[error("`max_seconds` = {limit} reached before the first step")]
    MaxSeconds {
        /// s.
        limit: f64,
    },
    /// No such code.
    #[error(transparent)]
    UnknownMethod(#[from] UnknownMethod),
    /// A word that an option does not know.
    #[error("unknown {option} `{word}`; known are {known}")]
    Word {
        /// Name of the option.
        option: &'static str,
        /// What it was given.
        word: String,
        /// The words it knows.
        known: String,
    },
    /// Nothing says when the run ends.
    #[error("there is no end time; give `end_time`, or state it in the model's [simulation]")]
    NoEndTime,
    /// A start time that is not that of the state to start from.
    #[error("`start_time` is {} s, but the state is at {} s", shown(*stated), shown(*from))]
    StartTime {
        /// s.
        stated: f64,
        /// s.
        from: f64,
    },
    /// An option out of range.
    #[error("`{option}` is {}; it must be {rule}", shown(*value))]
    Option {
        /// Name of the option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it must be.
        rule: &'static str,
    },
    /// A parametrization whose dense matrices would not fit into memory.
    #[error(
        "`parametrization = \"{name}\"` takes dense matrices of {gigabytes:.1} GB for this model; at most {MOST_GIGABYTES} GB are allowed"
    )]
    Parametrization {
        /// Its name.
        name: &'static str,
        /// Size of one of them.
        gigabytes: f64,
    },
    /// An end before the start.
    #[error("`end_time` is {} s; the run starts at {} s, and cannot end before", shown(*end), shown(*start))]
    EndTime {
        /// s.
        end: f64,
        /// s.
        start: f64,
    },
    /// A step, or the time between two rows, that is lost in the round-off of times.
    #[error(
        "`{option}` is {step:e} s; from {} s to {} s what is shorter than {least:.1e} s is lost in round-off",
        shown(*start),
        shown(*end)
    )]
    Step {
        /// Name of the option.
        option: &'static str,
        /// s.
        step: f64,
        /// s.
        start: f64,
        /// s.
        end: f64,
        /// s.
        least: f64,
    },
    /// A tolerance that no arithmetic can keep.
    #[error(
        "`{option}` is {value:e}, below the round-off of the computation; at least {least:.1e} can be kept"
    )]
    Tolerance {
        /// Name of the part.
        option: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value accepted.
        least: f64,
    },
    /// An output time that the run does not reach, or that is out of order.
    #[error("`output_times[{index}]` is {} s; it must {rule}", shown(*value))]
    OutputTime {
        /// Index in the list.
        index: usize,
        /// Its value, s.
        value: f64,
        /// What it must do.
        rule: String,
    },
    /// An output interval that asks for too many rows.
    #[error(
        "`interval` = {} s asks for {} output rows; at most {MOST_ROWS:.0} are stored",
        shown(*interval),
        if *rows < 1e15 { format!("{rows:.0}") } else { format!("{rows:.0e}") }
    )]
    TooManyRows {
        /// s.
        interval: f64,
        /// Rows from start to end.
        rows: f64,
    },
    /// A motion that is not known for the whole run.
    #[error(
        "the table `{name}` of `{path}` reaches from {} s to {} s, the run from {} s to {} s",
        shown(*first),
        shown(*last),
        shown(*start),
        shown(*end)
    )]
    ShortTable {
        /// Where the table is written.
        name: String,
        /// Path of the motion.
        path: String,
        /// First time of the table, s.
        first: f64,
        /// Last time of the table, s.
        last: f64,
        /// Start of the run, s.
        start: f64,
        /// End of the run, s.
        end: f64,
    },
    /// The code needs an exact Jacobian.
    #[error(
        "`jacobian` is differences; {code} needs the exact Jacobian, without which it loses its \
         order; use analytic, or another code"
    )]
    InexactJacobian {
        /// Name of the code.
        code: &'static str,
    },
    /// Differences are taken of the dense Jacobian only.
    #[error(
        "`newton` is {newton} and `jacobian` is differences, which make dense matrices; use `newton` auto, \
         or `jacobian` analytic"
    )]
    SparseDifferences {
        /// What was stated.
        newton: &'static str,
    },
    /// The code needs the full Jacobian.
    #[error(
        "`newton` is simplified, which leaves out part of the Jacobian; {code} needs the full one"
    )]
    SimplifiedJacobian {
        /// Name of the code.
        code: &'static str,
    },
    /// Accelerations cannot be computed as stated.
    #[error("`accelerations` is {stated}, which cannot be here: {reason}; use auto")]
    Accelerations {
        /// The option.
        stated: &'static str,
        /// Why not, with the name of the body.
        reason: String,
    },
    /// Joint coordinates do not serve.
    #[error("`coordinates` is joint, which cannot be here: {reason}")]
    Coordinates {
        /// Why not.
        reason: String,
    },
    /// A checkpoint that is none of this run.
    #[error("the run cannot be taken up at its checkpoint: {reason}")]
    Checkpoint {
        /// What is wrong with it.
        reason: String,
    },
    /// A start state of another model.
    #[error("the start state has {found} {what}, the model {expected}")]
    StartState {
        /// Which array.
        what: &'static str,
        /// Length found.
        found: usize,
        /// Length expected.
        expected: usize,
    },
    /// A start state with a number that is none.
    #[error("the start state is not finite: its {what}[{index}] is {value}")]
    StateNotFinite {
        /// Which array.
        what: &'static str,
        /// Index in it.
        index: usize,
        /// The entry.
        value: f64,
    },
    /// A start state that contradicts a joint.
    #[error(
        "the start state contradicts {row}: {level} residual {residual:.3e} {unit}, allowed {allowed:.1e}"
    )]
    InconsistentState {
        /// `position` or `velocity`.
        level: &'static str,
        /// Joint and row.
        row: String,
        /// Name of the joint, driver or body.
        item: String,
        /// What is left of it.
        residual: f64,
        /// m, rad, m/s or rad/s.
        unit: &'static str,
        /// Largest residual that is projected away.
        allowed: f64,
    },
}

impl RunError {
    pub(super) fn given_up(given_up: GivenUp, options: &Options) -> Self {
        match given_up {
            GivenUp::Asked => Self::Interrupted,
            GivenUp::OutOfTime => Self::MaxSeconds { limit: options.max_seconds },
        }
    }

    /// Stable code.
    pub fn code(&self) -> &'static str {
        match self {
            Self::Assembly(error) => error.code(),
            Self::UnknownChannel { .. } => "simulation/unknown-channel",
            Self::Interrupted => "simulation/interrupted",
            Self::MaxSeconds { .. } => "simulation/max-seconds",
            Self::UnknownMethod(_) => "simulation/unknown-method",
            Self::StartState { .. }
            | Self::StateNotFinite { .. }
            | Self::InconsistentState { .. } => "simulation/start-state",
            Self::ShortTable { .. } => "simulation/short-table",
            Self::Checkpoint { .. } => "simulation/checkpoint",
            _ => "simulation/option",
        }
    }

    /// The item of the model concerned, if one is.
    pub fn item(&self) -> Option<&str> {
        match self {
            Self::Assembly(error) => error.item(),
            Self::InconsistentState { item, .. } => Some(item),
            Self::ShortTable { path, .. } => Some(path),
            _ => None,
        }
    }

    /// What to try.
    pub fn help(&self) -> &'static str {
        match self {
            Self::Assembly(error) => error.help(),
            Self::StartState { .. } => "pass a state of the same model, as a result stores it",
            Self::StateNotFinite { .. } => "pass a state as a result stores it",
            Self::Checkpoint { .. } => {
                "start from its last state, or from the beginning: the checkpoint is of another run or version"
            }
            Self::InconsistentState { .. } => {
                "pass a state of this very model, as a result stores it at that time; where \
                 lengths, joints or drivers have changed, state initial values in the model instead"
            }
            Self::ShortTable { .. } => "extend the table, or let the run begin and end within it",
            Self::MaxSeconds { .. } => "raise `max_seconds`",
            Self::Tolerance { .. } => "ask for less, 1e-10 for a reference",
            Self::OutputTime { .. } => "leave the time out, or change the span of the run",
            Self::TooManyRows { .. } => "ask for a longer interval",
            Self::UnknownChannel { .. } => {
                "channels are `item.quantity`, such as `chassis.position`; `item.*` stands for all of an item"
            }
            Self::Interrupted => "run it again; there is nothing to keep before the first step",
            Self::UnknownMethod(_) => "leave `method` and `formula` out for the default, ForRadau",
            Self::Word { .. } => "choose one of the known words, or leave the option out",
            Self::NoEndTime => {
                "state `end_time`, s, in the call or under [simulation] of the model"
            }
            Self::StartTime { .. } => {
                "leave `start_time` out: the run begins at the time of the state"
            }
            Self::EndTime { .. } => "give an `end_time` that lies later",
            Self::Step { .. } => "leave it out for its default, or take a longer one",
            Self::Parametrization { .. } => {
                "state `parametrization = \"tree\"`, the default, which keeps no dense matrix"
            }
            Self::Option { .. } => "change the option, or leave it out for its default",
            Self::InexactJacobian { .. } | Self::SparseDifferences { .. } => {
                "leave `jacobian` out for the analytic one"
            }
            Self::SimplifiedJacobian { .. } => "leave `newton` out, or name another code",
            Self::Accelerations { .. } => "leave `accelerations` out",
            Self::Coordinates { .. } => "leave `coordinates` out",
        }
    }
}

/// What Newmark's numbers must be beside other formulas.
pub(super) const NOT_NEWMARK: &str = "left out: it is for SspTrap and InflTrap";

/// The smallest tolerance of a model of characteristic length `length`, m.
pub(super) fn smallest_tolerance(length: f64) -> Tolerance {
    // Of a small mechanism in metres.
    let translation = SMALLEST_TOLERANCE * length.min(1.0);
    Tolerance { translation, ..Tolerance::uniform(SMALLEST_TOLERANCE) }
}

/// Checks choices of a run from `start`, s; `length` is the model's characteristic length, m.
pub(super) fn check_options(options: &Options, start: f64, length: f64) -> Result<(), RunError> {
    let refuse = |option, value, rule| Err(RunError::Option { option, value, rule });
    let positive = |option, value: f64| {
        if value > 0.0 { Ok(()) } else { refuse(option, value, "positive") }
    };
    let (stated, least) = (options.tolerance, smallest_tolerance(length));
    for (option, value, least) in [
        ("tolerance.relative", stated.relative, least.relative),
        ("tolerance.translation", stated.translation, least.translation),
        ("tolerance.rotation", stated.rotation, least.rotation),
    ] {
        if !(value > 0.0 && value.is_finite()) {
            return refuse(option, value, "positive and finite");
        }
        if value < least {
            return Err(RunError::Tolerance { option, value, least });
        }
    }
    positive("max_step", options.max_step)?;
    positive("initial_step", options.initial_step.unwrap_or(1.0))?;
    positive("fixed_step", options.fixed_step.unwrap_or(1.0))?;
    if let Some(Newmark { gamma, beta }) = options.newmark {
        if !options.code.is_trapezoidal() {
            return refuse("newmark_gamma", gamma, NOT_NEWMARK);
        }
        if !(0.5..=1.0).contains(&gamma) {
            return refuse("newmark_gamma", gamma, "from 0.5 to 1");
        }
        if !(2.0 * beta >= gamma && beta <= 1.0) {
            return refuse("newmark_beta", beta, "from newmark_gamma/2 to 1: less is not A-stable");
        }
        if gamma != 0.5 && options.fixed_step.is_none() {
            let rule = "0.5 without a `fixed_step`: at order 1 there is no estimate of the error";
            return refuse("newmark_gamma", gamma, rule);
        }
    }
    let factor = options.repartition_factor();
    if !(factor.is_finite() && factor > 1.0) {
        return refuse("repartition_factor", factor, "above 1");
    }
    positive("max_seconds", options.max_seconds)?;
    if options.max_steps == 0 {
        return refuse("max_steps", 0.0, "at least 1");
    }
    let end = options.end_time;
    if end.is_nan() || end.abs() > LATEST {
        return refuse(
            "end_time",
            end,
            "within 1e12 s of zero: beyond, steps are lost in round-off",
        );
    }
    if end < start {
        return Err(RunError::EndTime { end, start });
    }
    let interval = match &options.output {
        OutputTimes::Interval(interval) => {
            positive("interval", *interval)?;
            let rows = (end - start) / interval + 1.0;
            if rows > MOST_ROWS {
                return Err(RunError::TooManyRows { interval: *interval, rows });
            }
            Some(*interval)
        }
        OutputTimes::Listed(times) => {
            check_output_times(times, start, end)?;
            None
        }
    };
    // A first step is taken at the start, others anywhere up to the end, and a run of no length has one row.
    let at_start = smallest_step(start, end);
    let anywhere = at_start.max(smallest_step(end, end));
    let interval = interval.filter(|_| start < end);
    for (option, step, least) in [
        ("initial_step", options.initial_step, at_start),
        ("fixed_step", options.fixed_step, anywhere),
        ("interval", interval, anywhere),
    ] {
        if let Some(step) = step.filter(|&step| step < least) {
            return Err(RunError::Step { option, step, start, end, least });
        }
    }
    if options.jacobian == JacobianSource::Differences && options.code == Code::ForRosen {
        return Err(RunError::InexactJacobian { code: options.code.info().name });
    }
    if options.jacobian == JacobianSource::Differences && options.newton.is_sparse() {
        return Err(RunError::SparseDifferences { newton: options.newton.name() });
    }
    // Explicit codes, which only carry their errors by a matrix, take the whole one.
    let explicit = options.code.is_explicit();
    if options.newton == Representation::Simplified
        && options.code.needs_full_jacobian()
        && !explicit
    {
        return Err(RunError::SimplifiedJacobian { code: options.code.info().name });
    }
    Ok(())
}

/// Refuses a parametrization whose matrices, made of all constraints by all coordinates, are too large.
pub(super) fn check_parametrization(
    choice: ParametrizationKind,
    system: &dyn System,
) -> Result<(), RunError> {
    let sizes = &system.structure().sizes;
    let gigabytes = 8e-9 * sizes.rows as f64 * sizes.coordinates as f64;
    if choice != ParametrizationKind::Tree && gigabytes > MOST_GIGABYTES {
        return Err(RunError::Parametrization { name: choice.name(), gigabytes });
    }
    Ok(())
}

/// Lets accelerations come from where the options say.
pub(super) fn set_accelerations(
    options: &Options,
    manifold: &mut Manifold,
) -> Result<(), RunError> {
    let stated = options.accelerations;
    if stated == manifold.accelerator().stated() {
        return Ok(());
    }
    manifold.set_accelerations(stated).map_err(|refusal| RunError::Accelerations {
        stated: stated.name(),
        reason: why(manifold.system().as_ref(), refusal),
    })
}

/// Lets recoveries go through the coordinates that the options say, at the configuration `q` of the manifold.
pub(super) fn set_coordinates(
    options: &Options,
    manifold: &mut Manifold,
    q: &[f64],
) -> Result<(), RunError> {
    let refused = |reason: &str| Err(RunError::Coordinates { reason: reason.to_owned() });
    let stated = options.accelerations != Accelerations::Auto;
    match options.coordinates {
        Coordinates::Cartesian => {}
        Coordinates::Auto => {
            let dense = !options.newton.is_sparse();
            let explicit = options.code.is_explicit();
            if !stated
                && dense
                && let Some(together) = pays(manifold, explicit)
            {
                manifold.use_joint_coordinates(q, together);
            }
        }
        Coordinates::Joint if stated => {
            return refused("`accelerations` states a way of the Cartesian form");
        }
        Coordinates::Joint if manifold.chart().parametrization().relatives().is_none() => {
            return refused("it goes with `parametrization` tree");
        }
        Coordinates::Joint => {
            if !manifold.use_joint_coordinates(q, usize::MAX) {
                return refused(
                    "the direction of a distance joint or of a stiff spring is a coordinate of the tree, which is no joint \
                     coordinate",
                );
            }
        }
    }
    Ok(())
}

/// How many equations that close loops may be solved together where joint coordinates cost less; `None` where they do not
/// anyway. A rule from measurements (`benchmarks/coordinates`): on trees they take 0.45 to 0.85 of the time, whether or not drivers
/// move them. Where loops are closed their matrices are dense: up to 30 equations in a plane and 120 in space,
/// and as many freedoms as a dense mass matrix is worth at each evaluation, which implicit codes have more use for.
fn pays(manifold: &Manifold, explicit: bool) -> Option<usize> {
    let relatives = manifold.chart().parametrization().relatives()?;
    if relatives.exact {
        return Some(usize::MAX);
    }
    let planar = manifold.system().structure().sizes.is_planar();
    let freedoms = if explicit { LARGEST_EXPLICIT } else { LARGEST_IMPLICIT };
    let together = if planar { TOGETHER_IN_A_PLANE } else { TOGETHER_IN_SPACE };
    let equations: usize =
        manifold.system().tree().closures.iter().map(|closure| closure.rows).sum();
    (manifold.chart().ndof() <= freedoms && equations <= EQUATIONS).then_some(together)
}

/// Degrees of freedom of a model with loops, and equations that are solved together, up to which dense matrices cost less.
const LARGEST_EXPLICIT: usize = 100;
const LARGEST_IMPLICIT: usize = 200;
const TOGETHER_IN_A_PLANE: usize = 30;
const TOGETHER_IN_SPACE: usize = 120;
/// Equations up to which it is found out which of them are solved together.
const EQUATIONS: usize = 1000;

/// Why there is no reduced matrix, or no null space, in words of the model.
pub(super) fn why(system: &dyn System, refusal: Refusal) -> String {
    let name = |body: usize| system.coordinate_item(system.structure().sizes.of_body(body).start);
    match refusal {
        Refusal::Massless { body } => {
            format!("body `{}` has no mass, or no inertia about some axis", name(body))
        }
        Refusal::Normalization { body } => {
            let name = name(body);
            format!("the normalization of the Euler parameters of body `{name}` is redundant")
        }
        Refusal::Loops => refusal.to_string(),
        Refusal::Large { numbers } => {
            format!("its matrix would have {numbers:.1e} numbers")
        }
    }
}

fn check_output_times(times: &[f64], start: f64, end: f64) -> Result<(), RunError> {
    // Ends of a computed grid may miss those of the run by round-off.
    let slack = OUTPUT_SLACK * start.abs().max(end.abs());
    let mut before = f64::NEG_INFINITY;
    for (index, &value) in times.iter().enumerate() {
        let time = value.clamp(start, end);
        let rule = if !(start - slack..=end + slack).contains(&value) {
            format!("lie in the run, from {start} s to {end} s")
        } else if time <= before {
            "come after the one before".to_owned()
        } else {
            before = time;
            continue;
        };
        return Err(RunError::OutputTime { index, value, rule });
    }
    Ok(())
}

/// Refuses a run that outlasts a motion's table: a cubic continued beyond its last point is no data.
pub(super) fn check_tables(model: &Model, start: f64, end: f64) -> Result<(), RunError> {
    match motion_tables(model).into_iter().find(|table| !table.covers(start, end)) {
        None => Ok(()),
        Some(MotionTable { path, name, first, last }) => {
            Err(RunError::ShortTable { name, path, first, last, start, end })
        }
    }
}

/// Refuses a start state that is not one of the system, or contradicts a joint or driver by more than
/// [`PROJECTED`] times max(1, L) m or max(1, ‖q̇‖∞).
pub(super) fn check_state(system: &dyn System, state: &State) -> Result<(), RunError> {
    check_numbers(system, state)?;
    let sizes = system.structure().sizes;
    let mut residual = vec![0.0; sizes.rows];
    let refuse = |level, residual: &[f64], allowed: f64| {
        let worst = largest_index(residual);
        match residual.get(worst) {
            Some(&residual) if residual.abs() > allowed || residual.is_nan() => {
                let (row, item) = (system.row_name(worst), system.row_item(worst).0.to_owned());
                let unit = unit_of_row(system, worst, usize::from(level == "velocity"));
                Err(RunError::InconsistentState { level, row, item, residual, unit, allowed })
            }
            _ => Ok(()),
        }
    };
    system.position_constraints(state.t, &state.q, &mut residual);
    refuse("position", &residual, PROJECTED * system.characteristic_length().max(1.0))?;
    system.velocity_constraints(state.t, &state.q, &state.v, &mut residual);
    let speed = state.v.iter().fold(1.0f64, |m, v| m.max(v.abs()));
    refuse("velocity", &residual, PROJECTED * speed)
}

/// Refuses a state of other sizes, or with numbers that are not finite.
pub(super) fn check_numbers(system: &dyn System, state: &State) -> Result<(), RunError> {
    let sizes = system.structure().sizes;
    for (what, values, expected) in [
        ("coordinates", &state.q, sizes.coordinates),
        ("velocities", &state.v, sizes.coordinates),
        ("accelerations", &state.a, sizes.coordinates),
        ("multipliers", &state.lambda, sizes.rows),
        ("extra states", &state.z, sizes.extra_states),
        ("windings", &state.winding, sizes.windings),
    ] {
        if values.len() != expected {
            return Err(RunError::StartState { what, found: values.len(), expected });
        }
        if let Some(index) = values.iter().position(|x| !x.is_finite()) {
            return Err(RunError::StateNotFinite { what, index, value: values[index] });
        }
    }
    let ledger = &state.ledger;
    for (what, value) in [
        ("time", state.t),
        ("initial energy", ledger.initial),
        ("dissipated energy", ledger.dissipated),
        ("supplied energy", ledger.supplied),
    ] {
        if !value.is_finite() {
            return Err(RunError::StateNotFinite { what, index: 0, value });
        }
    }
    Ok(())
}

pub(super) fn find_channels(
    system: &Arc<dyn System>,
    names: &[String],
) -> Result<Vec<Channel>, RunError> {
    names
        .iter()
        .map(|name| {
            let nearest = || nearest(name, system.channels());
            let unknown = || RunError::UnknownChannel { name: printable(name), nearest: nearest() };
            system.channel_named(name).ok_or_else(unknown)
        })
        .collect()
}

/// The channel whose name is most like a misspelled one, if any is.
fn nearest(name: &str, all: &[Channel]) -> Option<String> {
    let score = |other: &str| strsim::jaro_winkler(name, other);
    all.iter()
        .map(|c| (score(&c.name), &c.name))
        .filter(|(s, _)| *s > 0.7)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, n)| n.clone())
}
