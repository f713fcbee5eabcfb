//! What a finished run warns of.

use super::statistics::{EnergySummary, RunWarning, Statistics};
use crate::system::System;

/// Share of the energy that may be missing without a warning.
const LARGEST_IMBALANCE: f64 = 0.05;
/// Redundant constraints that a warning names.
const REDUNDANT_SHOWN: usize = 8;

/// Warnings of a run with the redundant rows `dropped` and at most `most_kinetic` joules of kinetic
/// energy.
pub(super) fn warnings(
    system: &dyn System,
    dropped: &[usize],
    s: &Statistics,
    e: &EnergySummary,
    most_kinetic: f64,
) -> Vec<RunWarning> {
    let mut out = Vec::new();
    if !dropped.is_empty() {
        out.push(redundancy(system, dropped));
    }
    if s.stiff_steps > (s.steps / 10).max(s.rejected_evaluation) && s.stiff_steps > 50 {
        let message = "the explicit code was limited by stability, not accuracy: an implicit \
                           one (ForRadau) will be much faster"
            .into();
        out.push(RunWarning { code: "simulation/stiff", message });
    }
    // The kinetic energy, not its range, which is mere error where it should be constant.
    let scale = most_kinetic.max(e.dissipated.abs()).max(e.supplied.abs());
    if e.largest_imbalance > LARGEST_IMBALANCE * scale {
        let message = format!(
            "the energy balance does not close: {:.1e} J are missing of {scale:.1e} J; the \
                 motion or forces of stiff elements may be wrong: tighten the tolerance, or \
                 compare with another code",
            e.largest_imbalance
        );
        out.push(RunWarning { code: "simulation/energy-imbalance", message });
    }
    out
}

/// Names redundant constraints and says what that means for reactions.
fn redundancy(system: &dyn System, dropped: &[usize]) -> RunWarning {
    let shown: Vec<String> =
        dropped.iter().take(REDUNDANT_SHOWN).map(|&row| system.row_name(row)).collect();
    let more = match dropped.len().saturating_sub(REDUNDANT_SHOWN) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    let message = format!(
        "constraints are redundant ({}{more}): reactions are not unique there, and those stored are \
         the ones of minimum norm",
        shown.join("; ")
    );
    RunWarning { code: "simulation/redundant", message }
}
