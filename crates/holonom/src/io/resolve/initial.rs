//! Initial state, outputs and defaults of a run.

use indexmap::{IndexMap, IndexSet};

use super::Context;
use super::orientations::Turned;
use crate::error::Code;
use crate::io::channels::PATTERN;
use crate::io::names::{nearest, suggest};
use crate::io::schema::{self, Rotational, Tolerance as Stated, Vector};
use crate::model::{
    Assembly, DriverKind, Frame, Initial, InitialBody, InitialCoordinate, InitialExtraState, Joint,
    JointKind, Orientation, Outputs, SimulationDefaults, Tolerance,
};
use crate::simulation::{UnknownWord, unknown_method};

/// What joints have, as help.
const HAVE: &str = "revolute joints have `angle` and `angular_velocity`, translational ones `displacement` \
    and `velocity`, cylindrical ones all four, universal ones `angles` and `angular_velocities`";

/// Field, kind, whether it is a rate, and value of what is stated of a joint.
fn coordinates(
    stated: &schema::InitialJoint,
) -> impl Iterator<Item = (&'static str, DriverKind, bool, f64)> {
    let [first, second] = [0, 1].map(|k| stated.angles.map(|angles| angles[k]));
    let [first_rate, second_rate] = [0, 1].map(|k| stated.angular_velocities.map(|rates| rates[k]));
    [
        ("displacement", DriverKind::Translation, false, stated.displacement),
        ("velocity", DriverKind::Translation, true, stated.velocity),
        ("angle", DriverKind::Rotation, false, stated.angle),
        ("angular_velocity", DriverKind::Rotation, true, stated.angular_velocity),
        ("angles[0]", DriverKind::Rotation, false, first),
        ("angles[1]", DriverKind::Rotation, false, second),
        ("angular_velocities[0]", DriverKind::Rotation, true, first_rate),
        ("angular_velocities[1]", DriverKind::Rotation, true, second_rate),
    ]
    .into_iter()
    .filter_map(|(field, kind, is_rate, value)| Some((field, kind, is_rate, value?)))
}

/// Frames between which a field of `initial.joints` is measured; `None` where the joint has no such
/// coordinate.
fn frames_of(joint: &Joint, field: &str, kind: DriverKind) -> Option<[Frame; 2]> {
    let entry = field.split_once('[').map(|(_, at)| at);
    match (joint.kind, kind, entry) {
        (JointKind::Universal, _, Some(entry)) => {
            Some(universal_frames(&joint.frames, entry.starts_with('0')))
        }
        (JointKind::Revolute | JointKind::Cylindrical, DriverKind::Rotation, None)
        | (JointKind::Translational | JointKind::Cylindrical, DriverKind::Translation, None) => {
            Some(joint.frames)
        }
        _ => None,
    }
}

/// Frames whose angle is that of a universal joint about its first or second axis. The joint's axes h
/// lie across each other with f of both frames along their common perpendicular, so that in the design
/// configuration the second h is −g of the first frame, and the first h is g of the second.
fn universal_frames([first, second]: &[Frame; 2], about_first: bool) -> [Frame; 2] {
    let turned = |frame: &Frame, columns: [(usize, f64); 3]| Frame {
        axes: frame.axes.map(|row| columns.map(|(column, sign)| sign * row[column])),
        ..*frame
    };
    if about_first {
        [
            turned(first, [(1, -1.0), (0, 1.0), (2, 1.0)]),
            turned(second, [(2, 1.0), (0, 1.0), (1, 1.0)]),
        ]
    } else {
        // Seen from the second body, about −h, so that the sign is that of the second against the first.
        [
            turned(second, [(1, 1.0), (0, 1.0), (2, -1.0)]),
            turned(first, [(2, 1.0), (0, 1.0), (1, 1.0)]),
        ]
    }
}

impl Context<'_> {
    pub(super) fn initial(&mut self, joints: &[Joint]) -> Initial {
        let stated = &self.file.initial;
        for name in stated.bodies.keys() {
            self.moving_body(&format!("initial.bodies.{name}"), name);
        }
        let mut bodies = Vec::with_capacity(self.file.bodies.len());
        for name in self.file.bodies.keys() {
            let body = stated.bodies.get(name);
            let velocity = body.and_then(|b| b.velocity).or(stated.velocity);
            let turning = body.and_then(|b| b.angular_velocity).or(stated.angular_velocity);
            bodies.push(InitialBody {
                position: body.and_then(|b| b.position).map(Vector::components),
                orientation: body.and_then(|b| self.initial_orientation(name, b)),
                velocity: velocity.map(Vector::components),
                angular_velocity: turning.map(Rotational::components),
            });
        }
        if bodies.iter().all(|stated| *stated == InitialBody::default()) {
            bodies.clear();
        }
        Initial {
            assembly: match stated.assembly {
                schema::Assembly::Keep => Assembly::Keep,
                schema::Assembly::Adjust => Assembly::Adjust,
            },
            bodies,
            joints: self.initial_joints(joints),
            extra_states: self.extra_states(),
        }
    }

    fn initial_orientation(&mut self, name: &str, b: &schema::InitialBody) -> Option<Orientation> {
        let path = format!("initial.bodies.{name}");
        let stated = Turned::of_initial(b).euler_parameters(&path, &mut self.errors);
        stated.map(Orientation::EulerParameters).or(b.angle.map(Orientation::Angle))
    }

    fn initial_joints(&mut self, joints: &[Joint]) -> Vec<InitialCoordinate> {
        let file = self.file;
        let places: IndexMap<&str, usize> =
            joints.iter().enumerate().map(|(at, joint)| (joint.name.as_str(), at)).collect();
        let mut out = Vec::new();
        for (name, stated) in &file.initial.joints {
            let path = format!("initial.joints.{name}");
            if !self.names_joint(&path, name) {
                continue;
            }
            // Absent: the joint has errors of its own.
            let Some(&at) = places.get(name.as_str()) else { continue };
            for (field, kind, is_rate, value) in coordinates(stated) {
                if let Some(frames) = frames_of(&joints[at], field, kind) {
                    let field = field.to_owned();
                    out.push(InitialCoordinate { joint: at, field, kind, is_rate, value, frames });
                    continue;
                }
                let stem = field.split('[').next().unwrap_or_default();
                let message = format!("the joint `{name}` of `{path}` has no `{stem}`");
                let help = HAVE;
                self.refuse(Code::ConflictingFields, format!("{path}.{stem}"), message, help);
                if field.ends_with(']') {
                    break; // said of both entries
                }
            }
        }
        out
    }

    /// Whether there is a joint of this name; refuses it otherwise.
    fn names_joint(&mut self, path: &str, name: &str) -> bool {
        let joints = &self.file.joints;
        if joints.contains_key(name) {
            return true;
        }
        let message = format!("`{path}` names the joint `{name}`, which is not there");
        let help = suggest(&self.errors, name, "joints", joints.keys().map(String::as_str));
        self.refuse(Code::UnknownName, path, message, &help);
        false
    }

    /// Extensions of the springs of a bushing's branches.
    fn branches(
        &mut self,
        path: &str,
        bushing: &schema::Bushing,
        stated: &IndexMap<String, schema::InitialBranch>,
    ) -> Vec<(String, [f64; 6])> {
        let mut out = Vec::new();
        for (name, branch) in stated {
            if bushing.branches.contains_key(name) {
                let ([x, y, z], [a, b, c]) = (branch.extension, branch.rotation);
                out.push((name.clone(), [x, y, z, a, b, c]));
                continue;
            }
            let path = format!("{path}.{name}");
            let message = format!("`{path}` names the branch `{name}`, which is not there");
            let names = bushing.branches.keys().map(String::as_str);
            let help = suggest(&self.errors, name, "branches", names);
            self.refuse(Code::UnknownName, path, message, &help);
        }
        out
    }

    fn extra_states(&mut self) -> Vec<(String, InitialExtraState)> {
        let file = self.file;
        let mut out = Vec::new();
        for (name, stated) in &file.initial.extra_states {
            let path = format!("initial.extra_states.{name}");
            match (file.forces.get(name), stated) {
                (Some(schema::Force::Maxwell(_)), schema::ExtraState::Spring(x)) => {
                    out.push((name.clone(), InitialExtraState::Spring(*x)));
                }
                (Some(schema::Force::Bushing(f)), schema::ExtraState::Branches(stated))
                    if !f.branches.is_empty() =>
                {
                    let branches = self.branches(&path, f, stated);
                    out.push((name.clone(), InitialExtraState::Branches(branches)));
                }
                (Some(schema::Force::Maxwell(_)), _) => {
                    let message = format!("`{path}` is a table; expected a number (m)");
                    let help = "the extension of the spring of the Maxwell element";
                    self.refuse(Code::WrongType, path, message, help);
                }
                (Some(schema::Force::Bushing(f)), _) if !f.branches.is_empty() => {
                    let message = format!("`{path}` is a number; expected a table");
                    let help = "name branches of the bushing, each with `extension` and `rotation`";
                    self.refuse(Code::WrongType, path, message, help);
                }
                (Some(_), _) => {
                    let message = format!("the force `{name}` in `{path}` has no extra state");
                    let help = "extra states belong to forces of type \"maxwell\" and to bushings \
                                with branches";
                    self.refuse(Code::UnknownName, path, message, help);
                }
                (None, _) => {
                    let message = format!("`{path}` names the force `{name}`, which is not there");
                    let help = suggest(
                        &self.errors,
                        name,
                        "forces",
                        file.forces.keys().map(String::as_str),
                    );
                    self.refuse(Code::UnknownName, path, message, &help);
                }
            }
        }
        out
    }

    /// Channels are `item.quantity`; that the item exists is checked here, the quantity where the model is compiled:
    /// [`crate::io::Document::check_channels`].
    pub(super) fn outputs(&mut self) -> Outputs {
        let file = self.file;
        let known: IndexSet<&str> = ["energy", "constraint", "*"]
            .into_iter()
            .chain(file.bodies.keys().map(String::as_str))
            .chain(file.joints.keys().map(String::as_str))
            .chain(file.forces.keys().map(String::as_str))
            .chain(file.drivers.keys().map(String::as_str))
            .collect();
        for (i, channel) in file.outputs.channels.iter().enumerate() {
            let path = format!("outputs.channels[{i}]");
            let Some((item, quantity)) = channel.split_once('.') else {
                let message = format!("`{path}` is {channel:?}; expected \"item.quantity\"");
                let help = "such as \"chassis.position\" or \"energy.total\"";
                self.refuse(Code::WrongType, path, message, help);
                continue;
            };
            let is_pattern = item.contains(PATTERN);
            if !known.contains(item) && !is_pattern {
                let message = format!("`{path}` names the item `{item}`, which is not there");
                let help = suggest(&self.errors, item, "items", known.iter().copied());
                self.refuse(Code::UnknownName, path, message, &help);
            } else if quantity.is_empty() {
                let message = format!("`{path}` is {channel:?}; expected \"item.quantity\"");
                self.refuse(Code::WrongType, path, message, "`item.*` stands for all quantities");
            }
        }
        Outputs { channels: file.outputs.channels.clone(), interval: file.outputs.interval }
    }

    /// What a tolerance in parts does not state is what a run takes that states none.
    fn tolerance(&mut self, stated: Stated) -> Tolerance {
        let parts = match stated {
            Stated::Uniform(value) => return Tolerance::uniform(value),
            Stated::Parts(parts) => parts,
        };
        let schema::ToleranceParts { relative, translation, rotation } = parts;
        if [relative, translation, rotation] == [None; 3] {
            let message = "`simulation.tolerance` is empty".to_owned();
            let help =
                "give one of `relative`, `translation` and `rotation`, or one number for all";
            self.refuse(Code::MissingField, "simulation.tolerance", message, help);
        }
        let usual = Tolerance::default();
        Tolerance {
            relative: relative.unwrap_or(usual.relative),
            translation: translation.unwrap_or(usual.translation),
            rotation: rotation.unwrap_or(usual.rotation),
        }
    }

    pub(super) fn simulation(&mut self, joints: &[Joint]) -> SimulationDefaults {
        let file = self.file;
        let stated = &file.simulation;
        let mut cut = Vec::new();
        for (i, name) in stated.cut.iter().enumerate() {
            let path = format!("simulation.cut[{i}]");
            if self.names_joint(&path, name) {
                // Absent: the joint has errors of its own.
                cut.extend(joints.iter().position(|joint| joint.name == *name));
            }
        }
        let beside = [("max_step", stated.max_step), ("initial_step", stated.initial_step)];
        for (field, _) in beside.iter().filter(|(_, step)| stated.fixed_step.and(*step).is_some()) {
            let path = format!("simulation.{field}");
            let message =
                format!("`simulation` has both `fixed_step` and `{field}`; expected one of them");
            self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
        }
        let unknown = unknown_method(stated.method.as_deref(), stated.formula.as_deref());
        if let Some(UnknownWord { option, word, known }) = unknown {
            let path = format!("simulation.{option}");
            let words =
                known.iter().map(|word| format!("\"{word}\"")).collect::<Vec<_>>().join(", ");
            let message = format!("`{path}` is {word:?}; expected one of {words}");
            let meant = nearest(&word, known);
            let help = meant.map_or(String::new(), |word| format!("did you mean \"{word}\"?"));
            self.refuse(Code::UnknownChoice, path, message, &help);
        }
        SimulationDefaults {
            start_time: stated.start_time,
            end_time: stated.end_time,
            tolerance: stated.tolerance.map(|tolerance| self.tolerance(tolerance)),
            method: stated.method.clone(),
            formula: stated.formula.clone(),
            fixed_step: stated.fixed_step,
            max_step: stated.max_step,
            initial_step: stated.initial_step,
            max_steps: stated.max_steps,
            max_seconds: stated.max_seconds,
            repartition_factor: stated.repartition_factor,
            dense_output: stated.dense_output,
            parametrization: stated.parametrization,
            jacobian: stated.jacobian,
            newton: stated.newton,
            accelerations: stated.accelerations,
            coordinates: stated.coordinates,
            cut,
            profile: stated.profile,
        }
    }
}
