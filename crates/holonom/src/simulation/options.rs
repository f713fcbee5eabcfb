//! Choices for one run.

use super::step_length::smallest_step;
use crate::method::{Code, DEFAULT_CODE, Newmark, Profile};
use crate::model::Tolerance;
use crate::newton::{JacobianSource, Representation};
use crate::reduction::accelerations::Accelerations;
use crate::reduction::{Coordinates, ParametrizationKind};
use crate::threads::Threads;

/// Steps between checkpoints of explicit codes, which take many cheap ones.
const EXPLICIT_STEPS: u64 = 10_000;
/// Steps between checkpoints of implicit codes.
const IMPLICIT_STEPS: u64 = 1_000;

/// When states are stored.
#[derive(Debug, Clone, PartialEq)]
pub enum OutputTimes {
    /// Every so many seconds from the start, and at the end.
    Interval(f64),
    /// At these times, ascending.
    Listed(Vec<f64>),
}

impl OutputTimes {
    /// 200 intervals from `start` to `end`, s; the ends alone where times do not tell so many apart.
    pub fn between(start: f64, end: f64) -> Self {
        let interval = (end - start) / 200.0;
        if interval >= smallest_step(end, end) {
            Self::Interval(interval)
        } else if end > start {
            Self::Listed(vec![start, end])
        } else {
            Self::Listed(vec![start])
        }
    }
}

/// Choices for one run.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// s.
    pub end_time: f64,
    /// Error tolerances.
    pub tolerance: Tolerance,
    /// Method and formula.
    pub code: Code,
    /// Choices that go with it.
    pub profile: Profile,
    /// When states are stored.
    pub output: OutputTimes,
    /// Names of channels stored with the states.
    pub channels: Vec<String>,
    /// Fixed step, s: no error control.
    pub fixed_step: Option<f64>,
    /// Largest step, s.
    pub max_step: f64,
    /// First step, s; found by the code if absent.
    pub initial_step: Option<f64>,
    /// Largest number of attempted steps.
    pub max_steps: u64,
    /// Accepted steps from one checkpoint to the next: there a run goes on from the present state, chart and
    /// step size alone, so that one that is taken up there goes the same way. Unless stated, a number that
    /// costs nothing measurable.
    pub checkpoint_steps: Option<u64>,
    /// Largest wall time from the call of the run on, its assembly included, s.
    pub max_seconds: f64,
    /// Another member of Newmark's family in place of the trapezoidal rule, for its codes.
    pub newmark: Option<Newmark>,
    /// What the independent variables are.
    pub parametrization: ParametrizationKind,
    /// Where the integration Jacobian comes from.
    pub jacobian: JacobianSource,
    /// How the integration Jacobian is represented.
    pub newton: Representation,
    /// Where accelerations and multipliers come from.
    pub accelerations: Accelerations,
    /// Which coordinates recoveries and derivatives go through.
    pub coordinates: Coordinates,
    /// Who shares the work on the integration Jacobian of large models; results do not depend on it.
    pub threads: Threads,
    /// Independent variables are chosen anew when the condition of [G; P] has grown by this factor; that of the
    /// parametrization unless stated.
    pub repartition_factor: Option<f64>,
    /// Whether steps are handed out with what the states inside them are made of; unless stated, those of
    /// implicit codes are. Explicit ones may take millions of steps.
    pub dense_output: Option<bool>,
}

impl Options {
    /// Defaults up to `end_time`: those that a run from 0 s takes unless told otherwise.
    pub fn new(end_time: f64) -> Self {
        Self {
            end_time,
            tolerance: Tolerance::default(),
            code: DEFAULT_CODE,
            profile: Profile::default(),
            output: OutputTimes::between(0.0, end_time),
            channels: Vec::new(),
            fixed_step: None,
            max_step: f64::INFINITY,
            initial_step: None,
            max_steps: 10_000_000,
            checkpoint_steps: None,
            max_seconds: f64::INFINITY,
            newmark: None,
            parametrization: ParametrizationKind::default(),
            jacobian: JacobianSource::default(),
            newton: Representation::default(),
            accelerations: Accelerations::default(),
            coordinates: Coordinates::default(),
            threads: Threads::default(),
            repartition_factor: None,
            dense_output: None,
        }
    }

    /// Accepted steps from one checkpoint to the next.
    pub(super) fn steps_between_checkpoints(&self) -> u64 {
        let explicit = self.code.is_explicit();
        self.checkpoint_steps.unwrap_or(if explicit { EXPLICIT_STEPS } else { IMPLICIT_STEPS })
    }

    /// Growth of the condition of [G; P] at which independent variables are chosen anew. On a circle limits of 2.5, 10 and 100
    /// cost 178, 314 and 676 steps on the tree; a tangent plane can always be renewed, and is best near its point of contact.
    pub fn repartition_factor(&self) -> f64 {
        self.repartition_factor.unwrap_or(match self.parametrization {
            ParametrizationKind::Tree => 2.5,
            ParametrizationKind::Partitioning => 1.25,
            ParametrizationKind::TangentPlane | ParametrizationKind::TangentPlaneSvd => 2.0,
        })
    }

    /// Whether steps are handed out with what the states inside them are made of.
    pub fn stores_dense_output(&self) -> bool {
        self.dense_output.unwrap_or(!self.code.is_explicit())
    }
}
