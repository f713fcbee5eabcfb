//! Stated relative coordinates of joints as conditions of the assembly.
//!
//! A stated value is what a driver prescribes: conditions are the drivers of an auxiliary system in the
//! same coordinates, one for positions and one for velocities. Beforehand the forest is walked from the
//! ground outwards, so that bodies beyond a stated joint are carried along with it.

use super::assembly::{Adjustment, MOVED};
use crate::math::planar;
use crate::math::spatial::{cross, rotate};
use crate::math::vector::{difference, scaled, sum};
use crate::model::{
    Driver, DriverKind, Frame, InitialBody, InitialCoordinate, Model, TimeFunction,
};
use crate::system::{Anchor, BodyPose, EdgeSource, RelativeKind, State, System, TreeEdge, compile};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Which of the stated values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    Position,
    Velocity,
}

/// The coordinates stated at a level.
pub(super) fn stated(model: &Model, level: Level) -> Vec<&InitialCoordinate> {
    let wanted = level == Level::Velocity;
    model.initial.joints.iter().filter(|c| c.is_rate == wanted).collect()
}

/// The system of the model with the coordinates as drivers, whose rows are the last ones of joints and
/// drivers; none where there are none.
pub(super) fn conditions(
    model: &Model,
    coordinates: &[&InitialCoordinate],
    t: f64,
) -> Option<Arc<dyn System>> {
    if coordinates.is_empty() {
        return None;
    }
    let mut model = model.clone();
    model.drivers.extend(coordinates.iter().map(|c| {
        let coefficients = if c.is_rate { vec![0.0, c.value] } else { vec![c.value] };
        Driver {
            name: model.joints[c.joint].name.clone(),
            kind: c.kind,
            frames: c.frames,
            motion: TimeFunction::Polynomial { coefficients, start: t },
        }
    }));
    Some(compile(&model))
}

/// Whether a body stays where it is stated to be.
fn stays(model: &Model, body: usize) -> bool {
    let stated = |b: &InitialBody| b.position.is_some() || b.orientation.is_some();
    model.initial.bodies.get(body).is_some_and(stated)
}

/// Whether a body moves with its parent: along joints and bushings, not along springs.
fn carries(edge: &TreeEdge) -> bool {
    edge.source != EdgeSource::Free && edge.forms.len() == 1
}

/// What is stated of the joint of an edge at a level.
fn of_edge<'a>(model: &'a Model, edge: &TreeEdge, level: Level) -> Vec<&'a InitialCoordinate> {
    let EdgeSource::Joint(joint) = edge.source else { return Vec::new() };
    stated(model, level).into_iter().filter(|c| c.joint == joint).collect()
}

/// Places bodies along the forest with the stated coordinates of its joints, and those beyond as they
/// were against their parents in the design configuration; bodies whose own pose is stated stay.
pub(super) fn place(system: &dyn System, model: &Model, design: &[f64], state: &mut State) {
    let groups = system.relative_groups();
    let mut references = vec![[0.0; 6]; groups.len()];
    let mut moved = vec![false; model.bodies.len()];
    for (at, edge) in system.tree().edges.iter().enumerate() {
        let own = of_edge(model, edge, Level::Position);
        let carried = carries(edge) && edge.parent.is_some_and(|parent| moved[parent]);
        if own.is_empty() && !carried {
            continue;
        }
        moved[edge.body] = true;
        if stays(model, edge.body) {
            continue;
        }
        let mut x = [0.0; 6];
        let mut wanted = x;
        let mut first = 0;
        for &group in &edge.forms[0] {
            let info = &groups[group];
            let reference = system.moved_reference(group, design, &[0.0; 6]);
            let range = first..first + info.rows;
            system.relative_value(group, &reference, design, &mut x[range.clone()]);
            wanted[range.clone()].copy_from_slice(&x[range]);
            let kind = match info.kind {
                RelativeKind::Displacement => Some(DriverKind::Translation),
                RelativeKind::Angle => Some(DriverKind::Rotation),
                _ => None,
            };
            // Angles of a universal joint have frames of their own: the iteration finds them.
            let fits = |c: &&&InitialCoordinate| {
                Some(c.kind) == kind && c.frames == model.joints[c.joint].frames
            };
            if let (1, Some(c)) = (info.rows, own.iter().find(fits)) {
                wanted[first] = c.value;
            }
            references[group] = reference;
            first += info.rows;
        }
        let anchor = Anchor { orientation: system.anchor_orientation(at, 0, design), x };
        system.place(at, 0, &wanted[..first], &references, &anchor, &mut state.q, None);
    }
}

/// Gives planar bodies the whole turns that drivers begin with, and those beyond them in the forest likewise: a pose does not
/// tell them, springs do.
pub(super) fn turn(system: &dyn System, model: &Model, state: &mut State) {
    let structure = system.structure();
    let sizes = &structure.sizes;
    if sizes.translations != 2 {
        return;
    }
    let angle = |q: &[f64], body: usize| q[body * sizes.per_body + sizes.translations];
    for driver in model.drivers.iter().filter(|driver| driver.kind == DriverKind::Rotation) {
        let turned = driver.frames.map(|f| f.body.map_or(0.0, |body| angle(&state.q, body)));
        let axes = driver.frames.map(|f| f.axes[1][0].atan2(f.axes[0][0]));
        let within = (axes[1] - axes[0]).sin().atan2((axes[1] - axes[0]).cos());
        let (wanted, _) = driver.motion.value_and_slope(state.t);
        let turns = ((wanted - (turned[1] - turned[0] + within)) / TAU).round();
        let [first, second] = driver.frames.map(|frame| frame.body);
        // The second one turns, unless the first one is beyond it.
        let of =
            |body: Option<usize>| body.map(|body| beyond(&system.tree().edges, body, sizes.bodies));
        let apart = |turning: &Vec<bool>| first.is_none_or(|first| !turning[first]);
        let (turning, turns) = match of(second).filter(apart) {
            Some(turning) => (turning, turns),
            None => (of(first).unwrap_or_default(), -turns),
        };
        for (body, _) in turning.iter().enumerate().filter(|(_, turns)| **turns) {
            state.q[body * sizes.per_body + sizes.translations] += turns * TAU;
        }
    }
}

/// Whether bodies move with one of them, it included.
fn beyond(edges: &[TreeEdge], body: usize, bodies: usize) -> Vec<bool> {
    let mut out = vec![false; bodies];
    out[body] = true;
    for edge in edges {
        out[edge.body] |= carries(edge) && edge.parent.is_some_and(|parent| out[parent]);
    }
    out
}

/// Lets angles of the joints count the turns that are stated.
pub(super) fn wind(system: &dyn System, model: &Model, state: &mut State) {
    for c in stated(model, Level::Position) {
        if let (DriverKind::Rotation, Some(winding)) = (c.kind, system.winding_of_joint(c.joint)) {
            state.winding[winding] = c.value;
        }
    }
}

/// Gives bodies beyond a joint of stated rate the velocities with which they are carried along, where
/// their own are not stated.
pub(super) fn carry(system: &dyn System, model: &Model, state: &mut State) {
    let none = InitialBody::default();
    let planar = system.structure().sizes.translations == 2;
    let ground = BodyPose {
        position: [0.0; 3],
        orientation: if planar { [0.0; 4] } else { [1.0, 0.0, 0.0, 0.0] },
        velocity: [0.0; 3],
        angular_velocity: [0.0; 3],
    };
    let turned = |pose: &BodyPose, a: [f64; 3]| {
        if planar {
            let [x, y] = planar::rotate(pose.orientation[0], &[a[0], a[1]]);
            [x, y, a[2]]
        } else {
            rotate(&pose.orientation, &a)
        }
    };
    let mut moves = vec![false; model.bodies.len()];
    let mut q = state.q.clone();
    for edge in &system.tree().edges {
        let rates = of_edge(model, edge, Level::Velocity);
        let carried = carries(edge) && edge.parent.is_some_and(|parent| moves[parent]);
        if rates.is_empty() && !carried {
            continue;
        }
        let pose_of =
            |body: Option<usize>| body.map_or(ground, |b| system.body(b, &state.q, &state.v));
        let parent = pose_of(edge.parent);
        let mut pose = pose_of(Some(edge.body));
        let arm = difference(&pose.position, &parent.position);
        let mut velocity = sum(&parent.velocity, &cross(&parent.angular_velocity, &arm));
        let mut turning = parent.angular_velocity;
        for c in rates {
            let column = if planar && c.kind == DriverKind::Translation { 0 } else { 2 };
            let axis =
                |frame: &Frame| turned(&pose_of(frame.body), frame.axes.map(|row| row[column]));
            let sign = if c.frames[1].body == Some(edge.body) { 1.0 } else { -1.0 };
            let rate = scaled(&axis(&c.frames[0]), sign * c.value);
            if c.kind == DriverKind::Translation {
                velocity = sum(&velocity, &rate);
                continue;
            }
            let [_, Frame { body, point, .. }] = c.frames;
            let second = pose_of(body);
            let point = sum(&second.position, &turned(&second, point));
            turning = sum(&turning, &rate);
            velocity = sum(&velocity, &cross(&rate, &difference(&pose.position, &point)));
        }
        let own = model.initial.bodies.get(edge.body).unwrap_or(&none);
        if own.velocity.is_none() {
            pose.velocity = velocity;
        }
        if own.angular_velocity.is_none() {
            pose.angular_velocity = turning;
        }
        system.set_body(edge.body, &pose, &mut q, &mut state.v);
        moves[edge.body] = true;
    }
}

/// How far stated coordinates of joints moved, where that is more than round-off.
pub(super) fn moved(model: &Model, state: &State) -> Vec<Adjustment> {
    let mut out: Vec<Adjustment> = Vec::new();
    for level in [Level::Position, Level::Velocity] {
        let coordinates = stated(model, level);
        let Some(system) = conditions(model, &coordinates, state.t) else { continue };
        let sizes = system.structure().sizes;
        let mut residuals = vec![0.0; sizes.rows];
        if level == Level::Position {
            system.position_constraints(state.t, &state.q, &mut residuals);
        } else {
            let mut g = system.structure().constraint_pattern.zeros();
            system.constraint_jacobian(&state.q, &mut g);
            system.velocity_rhs(state.t, &mut residuals);
            g.multiply_add(-1.0, &state.v, &mut residuals);
        }
        let own = &residuals[sizes.joint_rows - coordinates.len()..sizes.joint_rows];
        for (c, residual) in coordinates.iter().zip(own).filter(|(_, x)| x.abs() > MOVED) {
            let item = &model.joints[c.joint].name;
            if out.last().is_none_or(|last| last.item != *item) {
                out.push(Adjustment { item: item.clone(), ..Adjustment::default() });
            }
            let Some(last) = out.last_mut() else { continue };
            let entry = match (c.kind, c.is_rate) {
                (DriverKind::Translation, false) => &mut last.translation,
                (DriverKind::Rotation, false) => &mut last.rotation,
                (DriverKind::Translation, true) => &mut last.velocity,
                (DriverKind::Rotation, true) => &mut last.angular_velocity,
            };
            *entry = entry.max(residual.abs());
        }
    }
    out
}
