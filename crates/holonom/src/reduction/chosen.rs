//! Initial velocities that nothing determines.

use super::assembly::Assembled;
use super::closing::{closed, unknowns};
use super::stated_joints::Level;
use crate::model::{Assembly, Model};
use crate::system::{Measure, RelativeKind, System};
use std::sync::Arc;

/// A velocity below this counts as rest, m/s or rad/s.
const REST: f64 = 1e-9;
/// Part of a disturbance that what is determined may follow by round-off.
const FOLLOWS: f64 = 1e-6;

/// An initial velocity that neither stated values nor joints and drivers determine: the one of least change
/// was taken.
#[derive(Debug, Clone, PartialEq)]
pub struct ChosenVelocity {
    /// The relative coordinate, `slide.displacement`.
    pub coordinate: String,
    /// Its rate.
    pub rate: f64,
    /// m/s or rad/s.
    pub unit: &'static str,
}

/// The chosen velocities that are not zero, by independent coordinate. Whatever follows a disturbance of the
/// unstated velocities is not determined.
pub fn chosen_velocities(
    system: &Arc<dyn System>,
    model: &Model,
    assembled: &Assembled,
) -> Vec<ChosenVelocity> {
    let state = &assembled.state;
    let parametrization = assembled.parametrization();
    let mut rates = vec![0.0; parametrization.ndof];
    parametrization.rates(system.as_ref(), &state.q, &state.v, &mut rates);
    let unknowns = unknowns(system.as_ref(), model, Level::Velocity);
    let rests = rates.iter().all(|rate| rate.abs() <= REST);
    if rests || unknowns.free.is_empty() || model.initial.assembly == Assembly::Adjust {
        return Vec::new();
    }
    let mut disturbance = vec![0.0; state.v.len()];
    for (k, &i) in unknowns.free.iter().enumerate() {
        // Any numbers of which none is a multiple of another by chance.
        disturbance[i] = 0.5 + (0.618_033_988_749_895 * k as f64).fract();
    }
    unknowns.complete(system.as_ref(), &state.q, &mut disturbance);
    let mut disturbed = state.clone();
    disturbed.v.iter_mut().zip(&disturbance).for_each(|(v, change)| *v += change);
    let Ok((disturbed, _)) = closed(system, model, Level::Velocity, &disturbed) else {
        return Vec::new();
    };
    // The centre of mass of such a body, whose displacement it is, moves with a rotation that nothing states; its origin does not.
    let origin_is_stated = |k: usize| {
        parametrization.relatives().is_some_and(|relatives| {
            let group = &system.relative_groups()[relatives.rows[k].0];
            let coupled = |body: &usize| group.bodies == [None, Some(*body)];
            group.kind == RelativeKind::Displacement && unknowns.coupled.iter().any(coupled)
        })
    };
    let mut others = rates.clone();
    parametrization.rates(system.as_ref(), &state.q, &disturbed.v, &mut others);
    (0..parametrization.ndof)
        .filter(|&k| rates[k].abs() > REST && (others[k] - rates[k]).abs() > FOLLOWS)
        .filter(|&k| !origin_is_stated(k))
        .map(|k| ChosenVelocity {
            coordinate: parametrization.name(system.as_ref(), k),
            rate: rates[k],
            unit: match parametrization.measure(system.as_ref(), k) {
                Measure::Length => "m/s",
                Measure::Angle => "rad/s",
            },
        })
        .collect()
}
