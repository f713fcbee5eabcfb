//! Where a run can be taken up again, to go the very way it would have gone.

use super::carried_error::CarriedError;
use super::checks::{RunError, check_numbers};
use super::dense::ChartRecord;
use super::drift::Drift;
use super::energy_scale::EnergyScale;
use super::ledger::Quadrature;
use super::slowness::Named;
use super::statistics::{EnergySummary, Statistics};
use crate::method::stepper::StepperStatistics;
use crate::reduction::RecoveryCounters;
use crate::system::{State, System};
use serde::{Deserialize, Serialize};

/// All that a run knows after an accepted step: state, chart, step size, the history of a multistep formula,
/// and what it has counted. Every so many steps a run forgets everything else, so that
/// [`resume`](super::resume) from here gives the same numbers to the last bit.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    pub(super) state: State,
    pub(super) chart: ChartRecord,
    /// (v, v̇, z), and what else the formula integrates.
    pub(super) w: Vec<f64>,
    /// Of a multistep formula.
    pub(super) history: Vec<f64>,
    pub(super) pace: Pace,
    /// Of [G; P] when the chart was chosen.
    #[serde(with = "unbounded")]
    pub(super) condition: f64,
    /// First time of the run, s.
    pub(super) started: f64,
    /// Coordinates there, from which movements are measured; none in checkpoints of before.
    #[serde(default)]
    pub(super) origin: Vec<f64>,
    /// Whether it began with the model's initial state.
    pub(super) assembled: bool,
    /// Rows so far, and the time of the last one, s.
    pub(super) rows: (usize, Option<f64>),
    pub(super) start_residuals: (f64, f64),
    pub(super) counters: RecoveryCounters,
    pub(super) work: StepperStatistics,
    pub(super) statistics: Statistics,
    /// None in checkpoints of before.
    #[serde(default)]
    pub(super) turned_over: Option<(usize, f64)>,
    pub(super) energy: EnergySummary,
    pub(super) kinetic_range: (f64, f64),
    pub(super) energy_scale: EnergyScale,
    pub(super) drift: Drift,
    #[serde(default)]
    pub(super) quadrature: Quadrature,
    pub(super) carried: Option<CarriedError>,
    pub(super) limits: Vec<Named>,
}

/// How a run goes on.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(super) struct Pace {
    /// Proposed length of the next step, s.
    pub(super) next: f64,
    /// Longest step that has not just been refused, s; for what has no degree of freedom.
    #[serde(with = "unbounded")]
    pub(super) longest: f64,
    /// Attempted steps so far.
    pub(super) attempts: u64,
}

impl Checkpoint {
    /// When it was made, s.
    pub fn time(&self) -> f64 {
        self.state.t
    }

    /// First time of the run, s.
    pub fn started(&self) -> f64 {
        self.started
    }

    /// Whether the run began with the model's initial state, not with a given one.
    pub fn assembled(&self) -> bool {
        self.assembled
    }

    /// Coordinates at the start of the run, as far as they are known.
    pub(super) fn origin(&self) -> Option<&[f64]> {
        let carried = self.carried.as_ref().map(|carried| &carried.milestones.start.q);
        let known = Some(&self.origin).filter(|origin| !origin.is_empty());
        known.or(carried).map(Vec::as_slice)
    }

    /// As text, which holds every number to its last bit.
    pub fn to_text(&self) -> String {
        serde_json::json!(self).to_string()
    }

    /// A checkpoint of the text of one.
    ///
    /// # Errors
    /// [`RunError::Checkpoint`] where it is none.
    pub fn from_text(text: &str) -> Result<Self, RunError> {
        serde_json::from_str(text).map_err(|e| RunError::Checkpoint { reason: e.to_string() })
    }

    /// Refuses a checkpoint of another model. That its numbers are those of a run cannot be seen.
    pub(super) fn check(&self, system: &dyn System) -> Result<(), RunError> {
        check_numbers(system, &self.state).map_err(|_| foreign())?;
        let finite = |x: &[f64]| x.iter().all(|x| x.is_finite());
        let Pace { next, longest, .. } = self.pace;
        let origin = &self.origin;
        let placed = origin.is_empty() || origin.len() == self.state.q.len() && finite(origin);
        let numbers = finite(&self.w) && finite(&self.history) && next.is_finite() && placed;
        let chart = self.chart.q == self.state.q && self.chart.fits(system);
        if numbers && chart && next > 0.0 && longest > 0.0 && self.started <= self.state.t {
            return Ok(());
        }
        Err(foreign())
    }
}

/// A checkpoint of another model, code or version.
pub(super) fn foreign() -> RunError {
    RunError::Checkpoint { reason: "it is not one of this model, method and version".to_owned() }
}

/// Infinity as null.
mod unbounded {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    #[expect(clippy::trivially_copy_pass_by_ref, reason = "as serde asks for it")]
    pub(super) fn serialize<S: Serializer>(x: &f64, to: S) -> Result<S::Ok, S::Error> {
        Some(*x).filter(|x| x.is_finite()).serialize(to)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
        Ok(Option::deserialize(from)?.unwrap_or(f64::INFINITY))
    }
}
