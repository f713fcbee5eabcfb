//! What a finished run warns of.

use super::energy_scale::EnergyScale;
use super::options::Options;
use super::statistics::{EnergySummary, RunWarning, Statistics};
use crate::error::shown;
use crate::reduction::{ChosenVelocity, ParametrizationKind};
use crate::system::System;

/// Share of the energy moved that may be missing without a warning, however tight the tolerance.
const LARGEST_IMBALANCE: f64 = 0.005;
/// The same in relative tolerances: a run within its tolerance may be several of them off.
const TOLERANCES: f64 = 10.0;
/// Tolerances that bodies may be behind by the energy that is missing.
const LARGEST_DRIFT: f64 = 30.0;
/// Code of missing energy.
const IMBALANCE: &str = "simulation/energy-imbalance";
/// Redundant constraints that a warning names.
const REDUNDANT_SHOWN: usize = 8;
/// Chosen velocities that a warning names.
const CHOSEN_SHOWN: usize = 8;

/// Warnings of a run with the redundant rows `dropped` that need no second run.
pub(super) fn warnings(
    system: &dyn System,
    dropped: &[usize],
    ndof: usize,
    s: &Statistics,
) -> Vec<RunWarning> {
    let mut out = Vec::new();
    if !dropped.is_empty() {
        out.push(redundancy(system, dropped));
        if s.residual_ratio > 1.0 {
            let message = format!(
                "joints are violated by up to {:.1e} m (or as direction cosines) in position and {:.1e} m/s in \
                 velocity, {:.1e} times the bound: redundant constraints contradict each other by that much; check \
                 their points and axes",
                s.position_residual, s.velocity_residual, s.residual_ratio
            );
            out.push(RunWarning { code: "simulation/contradiction", message });
        }
    }
    if dropped.is_empty() && s.residual_ratio > 1.0 {
        let message = format!(
            "joints are violated by up to {:.1e} m (or as direction cosines) in position and {:.1e} m/s in velocity, \
             {:.1e} times the bound: lengths, angles or rates are so large that numbers have no more digits for them; \
             place the model near the origin, and look for a quantity in wrong units",
            s.position_residual, s.velocity_residual, s.residual_ratio
        );
        out.push(RunWarning { code: "simulation/residuals", message });
    }
    if ndof == 0 && !system.has_drivers() {
        let message = "there are no degrees of freedom and no drivers, so nothing moves; where a mechanism should, \
                       axes or points of its joints are not as parallel or as flat as they are meant to be"
            .into();
        out.push(RunWarning { code: "simulation/immobile", message });
    }
    let limited = s.stiff_steps > (s.steps / 10).max(s.rejected_evaluation) && s.stiff_steps > 50;
    // What is prescribed altogether is limited by the drivers alone.
    if limited && ndof > 0 {
        let message = "the explicit code was limited by stability, not accuracy: an implicit \
                           one (ForRadau) will be much faster"
            .into();
        out.push(RunWarning { code: "simulation/stiff", message });
    }
    out
}

/// Says which force turned over and when, s.
pub(super) fn turned_over(force: &str, t: f64) -> RunWarning {
    let message = format!(
        "bushing `{force}` is twisted through half a turn, by t = {t:.6} s for the first time: loads of its branches, and those \
         that couple displacements and rotations, turn over there at once, and how far the run is from its tolerance \
         beyond is not known; such bushings are for small rotations, and what turns farther needs a joint"
    );
    RunWarning { code: "simulation/turned-over", message }
}

/// Part of the energy that moved from which on what is missing of it is told, by the relative tolerance.
pub(super) fn missing_share(tolerance: f64) -> f64 {
    LARGEST_IMBALANCE.max(TOLERANCES * tolerance)
}

/// What the energy of a run says that is missing. Equations: `docs/theory/simulation.md` (4), (4a), (4b).
#[derive(Debug)]
pub(super) struct MissingEnergy {
    /// What is told whatever the motion is: energies are wrong.
    pub(super) told: Option<RunWarning>,
    /// What is told unless a second run finds the motion right, and potentials that differ by less than so many joules: so
    /// much may be missing of what does not count.
    pub(super) asked: Option<(RunWarning, f64)>,
}

impl MissingEnergy {
    /// Of a run whose energies are measured by `scale`; `drift` is that of [`super::drift`], in tolerances.
    pub(super) fn new(
        e: &EnergySummary,
        scale: &EnergyScale,
        negligible: f64,
        drift: f64,
        options: &Options,
    ) -> Self {
        let share = missing_share(options.tolerance.relative);
        let warning = |message| RunWarning { code: IMBALANCE, message };
        let allowed = (share * e.moved).max(negligible);
        if e.largest_imbalance > allowed {
            let warning = warning(missing(e, share));
            return if e.largest_imbalance > share * scale.all() {
                Self { told: Some(warning), asked: None }
            } else {
                Self { told: None, asked: Some((warning, allowed)) }
            };
        }
        let is_behind = drift > LARGEST_DRIFT;
        let asked = is_behind.then(|| (warning(behind(e, drift, options)), f64::INFINITY));
        Self { told: None, asked }
    }
}

/// Says that more than a `share` of the energy that moved is missing.
fn missing(e: &EnergySummary, share: f64) -> String {
    // Where that is what counts, not the least share.
    let relative = if share > LARGEST_IMBALANCE { ", ten relative tolerances" } else { "" };
    format!(
        "the energy balance does not close: {:.1e} J are missing of {:.1e} J that moved, more than {:.2} %{relative}; \
         the motion or forces of stiff elements may be wrong: tighten the tolerance, compare with another code, or \
         measure the error with `certify`",
        e.largest_imbalance,
        e.moved,
        100.0 * share
    )
}

/// Says how far what turns is behind by the energy that is missing.
fn behind(e: &EnergySummary, drift: f64, options: &Options) -> String {
    let coordinates = if options.parametrization == ParametrizationKind::Tree {
        ""
    } else {
        " use tree coordinates,"
    };
    format!(
        "the energy balance does not close: {:.1e} J are missing of {:.1e} J that moved; in what turns many times \
         this adds up to about {drift:.0} tolerances of an angle or of a place along a path, and to more where small \
         errors grow: tighten the tolerance,{coordinates} or measure the error with `certify`",
        e.largest_imbalance, e.moved
    )
}

/// Says which initial velocities nothing determines.
pub(super) fn chosen(chosen: &[ChosenVelocity]) -> Option<RunWarning> {
    let shown: Vec<String> = (chosen.iter().take(CHOSEN_SHOWN))
        .map(|c| format!("`{}` {} {}", c.coordinate, shown(c.rate), c.unit))
        .collect();
    let more = match chosen.len().saturating_sub(CHOSEN_SHOWN) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let message = format!(
        "nothing states or determines these initial velocities, which were chosen with least change from \
         rest: {}{more}; state them under [initial.joints] or [initial.bodies], zeros included",
        shown.join(", ")
    );
    (!chosen.is_empty()).then_some(RunWarning { code: "model/not-stated", message })
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
