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
    Driver, DriverKind, Frame, InitialBody, InitialCoordinate, JointKind, Model, TimeFunction,
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
    edge.source != EdgeSource::Free && edge.form_count() == 1
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
        for group in edge.forms[0].clone() {
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

/// Gives planar bodies the whole turns that drivers begin with: a pose does not tell them, springs do. What is fixed to a
/// driven body, or only hangs on it, turns along; what is in a loop keeps its angle, as it does where the driver has come there.
pub(super) fn turn(system: &dyn System, model: &Model, design: &[f64], state: &mut State) {
    let (sizes, tree) = (system.structure().sizes, system.tree());
    let at = |body: usize| sizes.rotations_of(body).start;
    let rotations = model.drivers.iter().filter(|driver| driver.kind == DriverKind::Rotation);
    let mut turns = Turns::new(sizes.bodies);
    let mut any = false;
    for driver in rotations.filter(|_| sizes.is_planar()) {
        let [first, second] = driver.frames.map(|frame| {
            let turned = frame.body.map_or(0.0, |body| state.q[at(body)]);
            turned + frame.axes[1][0].atan2(frame.axes[0][0])
        });
        let (wanted, _) = driver.motion.value_and_slope(state.t);
        let whole = ((wanted - (second - first)) / TAU).round();
        any |= whole != 0.0;
        turns.tie(driver.frames.map(|frame| frame.body), whole);
    }
    if !any {
        return;
    }
    // What cannot turn or is stated goes before what only hangs there.
    let between = |q: &[f64], [first, second]: [Option<usize>; 2]| {
        let angle = |body: Option<usize>| body.map_or(0.0, |body| q[at(body)]);
        angle(second) - angle(first)
    };
    let whole = |wanted: f64, bodies| ((wanted - between(&state.q, bodies)) / TAU).round();
    for joint in &model.joints {
        if matches!(joint.kind, JointKind::Fixed | JointKind::Translational) {
            let bodies = joint.frames.map(|frame| frame.body);
            turns.tie(bodies, whole(between(design, bodies), bodies));
        }
    }
    for c in stated(model, Level::Position).into_iter().filter(|c| c.kind == DriverKind::Rotation) {
        let bodies = c.frames.map(|frame| frame.body);
        turns.tie(bodies, whole(c.value, bodies));
    }
    for (body, own) in model.initial.bodies.iter().enumerate() {
        if own.orientation.is_some() {
            turns.tie([None, Some(body)], 0.0);
        }
    }
    let loops = loops(model, &tree.edges, &tree.forest.depth);
    for edge in tree.edges.iter().filter(|edge| carries(edge) && !loops[edge.body]) {
        turns.tie([edge.parent, Some(edge.body)], 0.0);
    }
    for body in 0..sizes.bodies {
        turns.tie([None, Some(body)], 0.0);
        state.q[at(body)] += TAU * turns.of(Some(body)).1;
    }
}

/// Whether the edge of the forest that carries a body is part of a loop of joints.
fn loops(model: &Model, edges: &[TreeEdge], depth: &[usize]) -> Vec<bool> {
    let mut parents = vec![None; depth.len()];
    let mut closes = vec![true; model.joints.len()];
    for edge in edges {
        parents[edge.body] = edge.parent;
        if let EdgeSource::Joint(joint) = edge.source {
            closes[joint] = false;
        }
    }
    let mut out = vec![false; depth.len()];
    for (joint, _) in model.joints.iter().zip(closes).filter(|(_, closes)| *closes) {
        let [mut a, mut b] = joint.frames.map(|frame| frame.body);
        let height = |body: Option<usize>| body.map_or(0, |body| depth[body]);
        while a != b {
            let outer = if height(a) >= height(b) { &mut a } else { &mut b };
            let Some(body) = *outer else { break };
            out[body] = true;
            *outer = parents[body];
        }
    }
    out
}

/// Turns of bodies against each other, and the ground, as far as they are tied: the body that one hangs on, and its turns
/// more than that one's.
struct Turns(Vec<Option<(Option<usize>, f64)>>);

impl Turns {
    fn new(bodies: usize) -> Self {
        Self(vec![None; bodies])
    }

    /// What a body hangs on in the end, and its turns against that.
    fn of(&self, mut body: Option<usize>) -> (Option<usize>, f64) {
        let mut turns = 0.0;
        while let Some((next, more)) = body.and_then(|body| self.0[body]) {
            (body, turns) = (next, turns + more);
        }
        (body, turns)
    }

    /// The second body has so many turns more than the first one, unless they are tied already.
    fn tie(&mut self, [first, second]: [Option<usize>; 2], turns: f64) {
        let ((a, of_first), (b, of_second)) = (self.of(first), self.of(second));
        let more = of_first + turns - of_second;
        match (a, b) {
            (a, Some(b)) if a != Some(b) => self.0[b] = Some((a, more)),
            (Some(a), None) => self.0[a] = Some((None, -more)),
            _ => {}
        }
    }
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
    let planar = system.structure().sizes.is_planar();
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
            system.velocity_constraints(state.t, &state.q, &state.v, &mut residuals);
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
