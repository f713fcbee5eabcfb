//! Closing the joints with least change of what is free.

mod conflict;
mod corrections;
mod least_change;
mod path;

use super::assembly::{AssemblyError, PROJECTED, unit_of_row};
use super::stated_joints::{Level, conditions, stated};
use crate::model::{Assembly, DriverKind, InitialBody, InitialCoordinate, Model};
use crate::system::{State, System, driver_of_angle};
use conflict::{SHOWN, open};
use corrections::Solver;
use least_change::Unknowns;
use std::f64::consts::PI;
use std::sync::Arc;

pub(super) use conflict::contradiction;
pub use conflict::{Conflict, FrameAxes};
pub(super) use least_change::scale;

/// What is left of less than this of a row's own residual is round-off: it depends on no others.
const REDUNDANT: f64 = 1e-8;

/// The state with its positions or velocities closed: first what is not stated, with the stated
/// coordinates of joints as conditions, then all to remove what is left. With the largest residual of the
/// stated values.
pub(super) fn closed(
    system: &Arc<dyn System>,
    model: &Model,
    level: Level,
    from: &State,
) -> Result<(State, f64), AssemblyError> {
    let coordinates = stated(model, level);
    let number = usize::from(level != Level::Position);
    let keep = model.initial.assembly == Assembly::Keep;
    let attempt = |count: usize| Attempt::new(system, model, level, from, &coordinates[..count]);
    let all = attempt(coordinates.len());
    if all.residual <= PROJECTED {
        let contradicted = coordinates.iter().find_map(|c| other_turns(model, c, from.t));
        return match contradicted.filter(|_| keep) {
            Some(error) => Err(error),
            None => Ok((all.finished(model, level), all.residual)),
        };
    }
    let plain = attempt(0);
    if plain.residual <= PROJECTED {
        if !keep {
            // What the conditions have reached serves as a guess.
            let near = Attempt::new(system, model, level, &all.state, &[]);
            let better = if near.residual <= PROJECTED { near } else { plain };
            return Ok((better.finished(model, level), all.residual));
        }
        // The first condition that cannot be kept together with those before it.
        for (count, c) in coordinates.iter().enumerate() {
            let failed = attempt(count + 1);
            if failed.residual <= PROJECTED {
                continue;
            }
            let (field, value) = (c.field.clone(), c.value);
            return Err(AssemblyError::StatedJoint {
                field,
                value,
                item: model.joints[c.joint].name.clone(),
                unit: unit(c),
                row: failed.told(model, level, &coordinates[..=count]),
                residual: failed.residual,
                row_unit: unit_of_row(failed.system.as_ref(), failed.row, number),
            });
        }
    }
    // What cannot be closed with everything free is no fault of what is stated.
    let everything = Unknowns::all(system.as_ref());
    let stated_only = plain.state.clone();
    let mut state = plain.state;
    let (mut left, mut worst) = (plain.residual, plain.row);
    if plain.has_stated {
        state = from.clone();
        (left, worst) = solve(system.as_ref(), model, level, &mut state, &everything);
    }
    if left <= PROJECTED {
        let (row, residual) = told_by_joints(system.as_ref(), level, stated_only)
            .filter(|found| found.1 > PROJECTED)
            .unwrap_or((plain.row, plain.residual));
        return Err(AssemblyError::Inconsistent {
            level: if level == Level::Position { "positions" } else { "velocities" },
            row: system.row_name(row),
            item: system.row_item(row).0.to_owned(),
            residual,
            unit: unit_of_row(system.as_ref(), row, number),
            allowed: PROJECTED,
        });
    }
    let open = open(system.as_ref(), model, level, &state);
    let found = match level {
        // The row that is open most where the iteration has stopped, of those that contradict each other.
        Level::Position => {
            let mut phi = vec![0.0; system.structure().sizes.rows];
            system.position_constraints(state.t, &state.q, &mut phi);
            let rows = Conflict::taking_part(&open);
            rows.max_by(|a, b| phi[*a].abs().total_cmp(&phi[*b].abs())).map(|row| (row, phi[row]))
        }
        Level::Velocity => {
            open.iter().copied().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()))
        }
    };
    let found = found.map(|(row, residual)| (row, residual.abs()));
    let (worst, residual) = found.filter(|found| found.1 > PROJECTED).unwrap_or((worst, left));
    let rows = Conflict::rows(system.as_ref(), &open, level, worst);
    let axes = FrameAxes::of(system.as_ref(), rows.iter().take(SHOWN).chain([&worst]));
    let others = Conflict::named(system.as_ref(), &rows);
    let (row, item) = (system.row_name(worst), system.row_item(worst).0.to_owned());
    let unit = unit_of_row(system.as_ref(), worst, number);
    Err(match level {
        Level::Position => AssemblyError::Unreachable { row, item, residual, unit, others, axes },
        Level::Velocity => {
            let level = "velocity";
            let residual = residual / share_left(system.as_ref(), &state.q, worst);
            AssemblyError::Contradiction { level, row, item, residual, unit, others }
        }
    })
}

/// The row of joints and drivers that is open most, and by how much, once Euler parameters are of size one: these may give way
/// to joints before joints do.
fn told_by_joints(system: &dyn System, level: Level, mut state: State) -> Option<(usize, f64)> {
    let sizes = &system.structure().sizes;
    for b in (0..sizes.bodies).filter(|_| !sizes.is_planar()) {
        let range = sizes.rotations_of(b);
        let (p, rate) = (&mut state.q[range.clone()], &mut state.v[range]);
        let size = p.iter().map(|x| x * x).sum::<f64>().sqrt();
        p.iter_mut().for_each(|x| *x /= size);
        let along: f64 = p.iter().zip(&*rate).map(|(x, y)| x * y).sum();
        rate.iter_mut().zip(&*p).for_each(|(y, x)| *y -= along * x);
    }
    let mut open = vec![0.0; sizes.rows];
    match level {
        Level::Position => system.position_constraints(state.t, &state.q, &mut open),
        Level::Velocity => system.velocity_constraints(state.t, &state.q, &state.v, &mut open),
    }
    let rows = open[..sizes.joint_rows].iter().map(|x| x.abs()).enumerate();
    rows.max_by(|a, b| a.1.total_cmp(&b.1))
}

/// A stated angle that is whole turns away from what a driver makes of it: a configuration does not tell these.
fn other_turns(model: &Model, c: &InitialCoordinate, t: f64) -> Option<AssemblyError> {
    if c.kind != DriverKind::Rotation || c.is_rate {
        return None;
    }
    let (driver, sign, offset) = driver_of_angle(model, &c.frames)?;
    let (motion, _) = driver.motion.value_and_slope(t);
    let residual = sign * motion + offset - c.value;
    (residual.abs() > PI).then(|| AssemblyError::StatedJoint {
        field: c.field.clone(),
        value: c.value,
        item: model.joints[c.joint].name.clone(),
        unit: unit(c),
        row: format!("driver `{}`, which counts turns", driver.name),
        residual: residual.abs(),
        row_unit: "rad",
    })
}

fn unit(c: &InitialCoordinate) -> &'static str {
    match (c.kind, c.is_rate) {
        (DriverKind::Translation, false) => "m",
        (DriverKind::Translation, true) => "m/s",
        (DriverKind::Rotation, false) => "rad",
        (DriverKind::Rotation, true) => "rad/s",
    }
}

/// The unstated closed to the joints and some conditions.
struct Attempt {
    /// With the conditions as drivers.
    system: Arc<dyn System>,
    state: State,
    residual: f64,
    row: usize,
    /// Whether something is not free.
    has_stated: bool,
}

impl Attempt {
    fn new(
        system: &Arc<dyn System>,
        model: &Model,
        level: Level,
        from: &State,
        coordinates: &[&InitialCoordinate],
    ) -> Self {
        let system = conditions(model, coordinates, from.t).unwrap_or_else(|| Arc::clone(system));
        let mut state = from.clone();
        let free = unknowns(system.as_ref(), model, level);
        let has_stated = free.free.len() < system.structure().sizes.coordinates;
        let (residual, row) = solve(system.as_ref(), model, level, &mut state, &free);
        // No comparison holds for a residual that is not a number.
        let residual = if residual.is_nan() { f64::INFINITY } else { residual };
        Self { system, state, residual, row, has_stated }
    }

    /// What the worst row is to the user, who stated the coordinates and no drivers of their names.
    fn told(&self, model: &Model, level: Level, coordinates: &[&InitialCoordinate]) -> String {
        let first = self.system.structure().sizes.joint_rows - coordinates.len();
        let Some(other) = self.row.checked_sub(first).and_then(|k| coordinates.get(k)) else {
            return self.system.row_name(self.row);
        };
        if coordinates.last().is_some_and(|last| !std::ptr::eq(*last, *other)) {
            let joint = &model.joints[other.joint].name;
            return format!("the stated {} of joint `{joint}`", other.field);
        }
        let is_stated = |body: &usize| {
            model.initial.bodies.get(*body).is_some_and(|own| match level {
                Level::Position => own.position.is_some() || own.orientation.is_some(),
                Level::Velocity => own.velocity.is_some() || own.angular_velocity.is_some(),
            })
        };
        let bodies: Vec<String> = (other.frames.iter().filter_map(|frame| frame.body))
            .filter(is_stated)
            .map(|body| format!("body `{}`", model.bodies[body].name))
            .collect();
        if bodies.is_empty() {
            return "what else is stated".to_owned();
        }
        format!("what is stated of {}", bodies.join(" and "))
    }

    /// The state with what is left of the residual removed.
    fn finished(&self, model: &Model, level: Level) -> State {
        let mut state = self.state.clone();
        let everything = Unknowns::all(self.system.as_ref());
        solve(self.system.as_ref(), model, level, &mut state, &everything);
        state
    }
}

/// What is left of a row's own residual where it contradicts others: they share what they differ by.
fn share_left(system: &dyn System, q: &[f64], row: usize) -> f64 {
    let mut g = system.structure().constraint_pattern.zeros();
    system.constraint_jacobian(q, &mut g);
    let mut alone = vec![0.0; system.structure().sizes.rows];
    alone[row] = 1.0;
    let left = contradiction(system, q, &g, &alone).get(row).copied();
    left.filter(|left| *left > REDUNDANT).unwrap_or(1.0)
}

/// Closes positions or velocities over `unknowns`; the largest residual left and its row.
fn solve(
    system: &dyn System,
    model: &Model,
    level: Level,
    state: &mut State,
    unknowns: &Unknowns,
) -> (f64, usize) {
    let solver = Solver { system, model };
    let mut g = system.structure().constraint_pattern.zeros();
    if level == Level::Position {
        return solver.close(state, unknowns, &mut g);
    }
    system.constraint_jacobian(&state.q, &mut g);
    solver.close_velocities(state, unknowns, &g)
}

/// Coordinates that are not stated; all of them where stated values are guesses.
pub(super) fn unknowns(system: &dyn System, model: &Model, level: Level) -> Unknowns {
    let sizes = system.structure().sizes;
    let keep = model.initial.assembly == Assembly::Keep;
    let none = InitialBody::default();
    let mut out = Unknowns { free: Vec::new(), coupled: Vec::new() };
    for (b, body) in model.bodies.iter().enumerate() {
        let own = model.initial.bodies.get(b).unwrap_or(&none);
        let (translation, rotation) = match level {
            _ if !keep => (false, false),
            Level::Position => (own.position.is_some(), own.orientation.is_some()),
            Level::Velocity => (own.velocity.is_some(), own.angular_velocity.is_some()),
        };
        if !translation {
            out.free.extend(sizes.translations_of(b));
        }
        if !rotation {
            out.free.extend(sizes.rotations_of(b));
        }
        if translation && !rotation && body.center_of_mass.iter().any(|c| *c != 0.0) {
            out.coupled.push(b);
        }
    }
    out
}
