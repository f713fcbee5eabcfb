//! The chart that a run goes on with, and why there may be none.

use super::options::Options;
use crate::error::EvaluationFailure;
use crate::reduction::{Chart, Manifold, Parametrization, choose, choose_by_condition};
use crate::system::{State, System};

/// The chart of the chosen parametrization at a state; `None` if it is the one that
/// the manifold has.
///
/// # Errors
/// `simulation/singular-configuration`, also where the number of independent constraints changes.
pub(super) fn new_chart(
    options: &Options,
    manifold: &Manifold,
    state: &State,
) -> Result<Option<Chart>, EvaluationFailure> {
    let system = manifold.system().as_ref();
    let mut g = system.structure().constraint_pattern.zeros();
    system.constraint_jacobian(&state.q, &mut g);
    let new = choose(options.parametrization, manifold, state, &g)?;
    let old = manifold.chart().parametrization();
    if new.same_as(old) {
        return Ok(None);
    }
    if new.ndof != old.ndof {
        return Err(rank_change(system, old, &new));
    }
    manifold.chart().with_parametrization(system, new, &state.q, &g).map(Some)
}

/// The chart that condition alone asks for at a state; `None` if the present one, which stiff forces ask for, is nearly as good.
pub(super) fn chart_by_condition(
    options: &Options,
    manifold: &Manifold,
    state: &State,
) -> Option<Chart> {
    let system = manifold.system().as_ref();
    let mut g = system.structure().constraint_pattern.zeros();
    system.constraint_jacobian(&state.q, &mut g);
    let new = choose_by_condition(manifold, state, &g)?;
    let present = manifold.chart().parametrization().clone();
    let chart = |parametrization| {
        manifold.chart().with_parametrization(system, parametrization, &state.q, &g).ok()
    };
    let (present, mut new) = (chart(present), chart(new)?);
    let most = options.repartition_factor() * new.condition();
    present.is_none_or(|mut present| present.condition() > most).then_some(new)
}

/// Drivers that a message names.
const DRIVERS_SHOWN: usize = 4;

/// Names the dropped row with the largest residual, m, rad, m/s or rad/s, and the drivers that move: they may prescribe what
/// joints lock.
pub(super) fn no_longer_redundant(
    system: &dyn System,
    dropped: &[usize],
    state: &State,
) -> Option<EvaluationFailure> {
    let rows = system.structure().sizes.rows;
    let (mut phi, mut rate) = (vec![0.0; rows], vec![0.0; rows]);
    system.position_constraints(state.t, &state.q, &mut phi);
    system.velocity_constraints(state.t, &state.q, &state.v, &mut rate);
    let size = |row: usize| phi[row].abs().max(rate[row].abs());
    let &worst = dropped.iter().max_by(|&&a, &&b| size(a).total_cmp(&size(b)))?;
    let message = format!(
        "{} was redundant and is not any more at t = {:.6} s: residual {:.2e}",
        system.row_name(worst),
        state.t,
        size(worst)
    );
    let joints = system.structure().joints.iter();
    let moves = |row: usize| system.drive(row, state.t)[1..].iter().any(|rate| *rate != 0.0);
    let driven = joints.map(|joint| joint.row).filter(|row| moves(*row));
    let names: Vec<&str> = driven.take(DRIVERS_SHOWN).map(|row| system.row_item(row).0).collect();
    let failure = match names.join("`, `") {
        none if none.is_empty() => {
            EvaluationFailure::new("simulation/singular-configuration", message)
        }
        names => EvaluationFailure::new(
            "simulation/contradiction",
            format!("{message}; drivers that move there, which joints may hold: `{names}`"),
        ),
    };
    Some(failure.of_row(Some(worst)))
}

fn rank_change(
    system: &dyn System,
    old: &Parametrization,
    new: &Parametrization,
) -> EvaluationFailure {
    let (more, fewer) = if new.ndof > old.ndof { (old, new) } else { (new, old) };
    let row = more.kept.iter().find(|r| !fewer.kept.contains(r));
    let name = row.map_or(String::new(), |&r| format!(" ({})", system.row_name(r)));
    EvaluationFailure::new(
        "simulation/singular-configuration",
        format!(
            "the number of independent constraints changes from {} to {}{name}",
            old.kept.len(),
            new.kept.len()
        ),
    )
    .of_row(row.copied())
}
