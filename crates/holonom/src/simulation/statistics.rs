//! Work, residuals and the reason for the end of a run.

use crate::control::Contractions;
use crate::system::EnergyBalance;
use serde::{Deserialize, Serialize};

/// How a run ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Status {
    /// The end time was reached.
    Completed,
    /// The caller interrupted it.
    Interrupted,
    /// A limit on steps or time was reached.
    Limit,
    /// It could not go on.
    Failed,
}

impl Status {
    /// Name in results.
    pub fn name(self) -> &'static str {
        match self {
            Self::Completed => "completed",
            Self::Interrupted => "interrupted",
            Self::Limit => "limit",
            Self::Failed => "failed",
        }
    }
}

/// Why a run ended.
#[derive(Debug, Clone, PartialEq)]
pub struct StopReason {
    /// Stable code, e.g. `simulation/end-time`, `simulation/newton-divergence`.
    pub code: &'static str,
    /// What happened.
    pub message: String,
    /// Time of the last accepted state, s.
    pub time: f64,
    /// Step size last tried, s.
    pub step_size: f64,
    /// Joint, driver or force concerned, if one is.
    pub item: Option<String>,
    /// Coordinate concerned, `body.x`, if one is.
    pub coordinate: Option<String>,
    /// What to try.
    pub help: &'static str,
}

/// Something about a run that its user should know.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunWarning {
    /// Stable code.
    pub code: &'static str,
    /// What it is, and what to do.
    pub message: String,
}

/// Work of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Statistics {
    /// Accepted steps.
    pub steps: u64,
    /// Attempts rejected for their error.
    pub rejected_error: u64,
    /// Attempts rejected because the iteration failed.
    pub rejected_newton: u64,
    /// Attempts rejected because the equations could not be evaluated.
    pub rejected_evaluation: u64,
    /// Evaluations of the right-hand side by the formula.
    pub evaluations: u64,
    /// Evaluations of the integration Jacobian's parts.
    pub jacobians: u64,
    /// Factorisations of the integration Jacobian.
    pub factorizations: u64,
    /// Those of the simplified matrix, where the sparse one may be that.
    pub simplified_factorizations: u64,
    /// Changes from it to the full matrix: after a failed stage, or where iterations were slow in two steps running.
    pub changes_to_full: u64,
    /// Newton iterations.
    pub iterations: u64,
    /// How these contracted.
    pub contractions: Contractions,
    /// Changes of the parametrization.
    pub reparametrizations: u64,
    /// Recoveries of dependent positions.
    pub recoveries: u64,
    /// Corrections in them.
    pub corrections: u64,
    /// Factorisations of [G; P].
    pub constraint_factorizations: u64,
    /// Symbolic analyses (orderings, patterns), those of assembly included.
    pub analyses: u64,
    /// Solves for accelerations.
    pub accelerations: u64,
    /// Stored output rows.
    pub outputs: u64,
    /// Steps at which an explicit code suspected stiffness.
    pub stiff_steps: u64,
    /// Largest ‖Φ‖∞ at accepted steps, m or direction cosines.
    pub position_residual: f64,
    /// Largest ‖G q̇ − ν‖∞ at accepted steps.
    pub velocity_residual: f64,
    /// Largest ratio of a residual to its bound 1e-10·max(1, L) or 1e-10·max(1, ‖q̇‖∞).
    pub residual_ratio: f64,
    /// Smallest accepted step, s.
    pub smallest_step: f64,
    /// Largest accepted step, s.
    pub largest_step: f64,
    /// Wall time of assembly, s.
    pub assembly_seconds: f64,
    /// Processor time of assembly, s.
    pub assembly_cpu_seconds: f64,
    /// Wall time of the run without its sink, s; a second run, where errors may have grown, is included.
    pub run_seconds: f64,
    /// Processor time of the run's thread without its sink, s, a second run included; 0 where the system does not tell.
    pub run_cpu_seconds: f64,
    /// Part of the wall time spent on output rows, s.
    pub output_seconds: f64,
}

/// Energy at start and end.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EnergySummary {
    /// At the start.
    pub start: EnergyBalance,
    /// At the end.
    pub end: EnergyBalance,
    /// Energy dissipated, J.
    pub dissipated: f64,
    /// Work of drivers and applied forces, J.
    pub supplied: f64,
    /// Imbalance at the start, J: of the run that this one continues, or what a change of the model has brought.
    #[serde(default)]
    pub missing: f64,
    /// What the run has added to it, J.
    pub imbalance: f64,
    /// Largest magnitude of that at accepted steps, J.
    pub largest_imbalance: f64,
    /// Largest minus smallest kinetic energy seen, J.
    pub range: f64,
    /// What the imbalance is measured against: the largest of the kinetic energy, the dissipation, the
    /// supply and the range of the potential, J. Bodies that no joint ties to the ground are seen from
    /// the frame of their centre of mass at the start.
    pub moved: f64,
}
