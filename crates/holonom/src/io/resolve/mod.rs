//! From the checked file to the model: names become indices, points and axes become frames fixed in
//! bodies, tables become functions.

mod drivers;
mod forces;
mod geometry;
mod initial;
mod joints;
mod motions;
mod orientations;
mod places;
mod shapes;

use indexmap::IndexMap;

use self::geometry::{Pose, Vec3, planar_rotation, spatial_rotation};
use self::orientations::Turned;
use super::names::suggest;
use super::schema::{self, Dimension, ModelFile};
use crate::error::{Code, Diagnostic};
use crate::model;
use crate::watch::{NAMED, checkpoint};

/// Builds the model, without what has errors, and lists the errors and warnings with their paths.
pub(super) fn model(file: &ModelFile) -> (model::Model, Vec<Diagnostic>) {
    let mut errors = Vec::new();
    let mut bodies = Vec::with_capacity(file.bodies.len());
    let mut poses = IndexMap::with_capacity(file.bodies.len());
    for (name, body) in &file.bodies {
        checkpoint(NAMED);
        let (body, pose) = rigid_body(name, body, file.dimension, &mut errors);
        poses.insert(
            name.as_str(),
            Placed { pose, markers: body.markers.iter().cloned().collect() },
        );
        bodies.push(body);
    }
    let mut context = Context { file, poses, errors };
    let joints = context.joints();
    let drivers = context.drivers(&joints);
    let model = model::Model {
        title: file.title.clone().unwrap_or_default(),
        dimension: match file.dimension {
            Dimension::Planar => model::Dimension::Planar,
            Dimension::Spatial => model::Dimension::Spatial,
        },
        gravity: file.gravity.map_or([0.0; 3], schema::Vector::components),
        forces: context.forces(),
        initial: context.initial(&joints),
        outputs: context.outputs(),
        simulation: context.simulation(&joints),
        bodies,
        joints,
        drivers,
    };
    (model, context.errors)
}

/// A body with its design pose and its markers in body axes.
struct Placed {
    pose: Pose,
    markers: IndexMap<String, Vec3>,
}

struct Context<'a> {
    file: &'a ModelFile,
    poses: IndexMap<&'a str, Placed>,
    errors: Vec<Diagnostic>,
}

impl<'a> Context<'a> {
    fn planar(&self) -> bool {
        self.file.dimension == Dimension::Planar
    }

    fn refuse(&mut self, code: Code, path: impl Into<String>, message: String, help: &str) {
        self.errors.push(Diagnostic::new(code, path, message).help(help));
    }

    fn pose(&self, body: model::BodyIndex) -> Pose {
        body.map_or(Pose::GROUND, |i| self.poses[i].pose)
    }

    fn name(&self, body: model::BodyIndex) -> &'a str {
        body.and_then(|i| self.poses.get_index(i)).map_or("ground", |(name, _)| name)
    }

    /// A body by name; `"ground"` is the ground. `None` when there is no such body.
    fn body(&mut self, path: &str, name: &str) -> Option<model::BodyIndex> {
        if name == "ground" {
            return Some(None);
        }
        if let Some(index) = self.poses.get_index_of(name) {
            return Some(Some(index));
        }
        let message = format!("`{path}` names the body `{name}`, which is not there");
        let known = self.poses.keys().copied().chain(["ground"]);
        let help = suggest(&self.errors, name, "bodies", known);
        self.refuse(Code::UnknownName, path, message, &help);
        None
    }

    /// A body that can move.
    fn moving_body(&mut self, path: &str, name: &str) -> Option<usize> {
        let body = self.body(path, name)?;
        if body.is_none() {
            let message = format!("`{path}` is the ground; expected a body that can move");
            self.refuse(Code::UnknownName, path, message, "");
        }
        body
    }

    fn between(&mut self, item: &str, names: &[String; 2]) -> Option<[model::BodyIndex; 2]> {
        let first = self.body(&format!("{item}.between[0]"), &names[0]);
        let second = self.body(&format!("{item}.between[1]"), &names[1]);
        let (first, second) = (first?, second?);
        if first == second {
            let path = format!("{item}.between");
            let message = format!("`{path}` connects `{}` with itself", names[0]);
            self.refuse(Code::SameBody, path, message, "name two different bodies");
            return None;
        }
        Some([first, second])
    }

    /// Exactly one of two fields: both and none are errors.
    fn one_of<A, B>(
        &mut self,
        item: &str,
        (first_name, first): (&str, Option<&'a A>),
        (second_name, second): (&str, Option<&'a B>),
    ) -> Option<Choice<'a, A, B>> {
        match (first, second) {
            (Some(a), None) => Some(Choice::First(a)),
            (None, Some(b)) => Some(Choice::Second(b)),
            (Some(_), Some(_)) => {
                let message = format!(
                    "`{item}` has both `{first_name}` and `{second_name}`; expected one of them"
                );
                let path = format!("{item}.{second_name}");
                self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
                None
            }
            (None, None) => {
                let message = format!("`{item}` has no `{first_name}`");
                let help = format!("give `{first_name}`, or `{second_name}` in its place");
                self.refuse(Code::MissingField, format!("{item}.{first_name}"), message, &help);
                None
            }
        }
    }
}

enum Choice<'a, A, B> {
    First(&'a A),
    Second(&'a B),
}

fn rigid_body(
    name: &str,
    body: &schema::Body,
    dimension: Dimension,
    errors: &mut Vec<Diagnostic>,
) -> (model::Body, Pose) {
    let (orientation, rotation) = match dimension {
        Dimension::Planar => (model::Orientation::Angle(body.angle), planar_rotation(body.angle)),
        Dimension::Spatial => {
            let stated = Turned::of_body(body);
            let p = stated.euler_parameters(&format!("bodies.{name}"), errors);
            let p = p.unwrap_or([1.0, 0.0, 0.0, 0.0]);
            (model::Orientation::EulerParameters(p), spatial_rotation(p))
        }
    };
    let position = body.position.components();
    let pose = Pose { origin: position, rotation };
    let mut markers = Vec::with_capacity(body.markers.len());
    for (marker, place) in &body.markers {
        let path = format!("bodies.{name}.markers.{marker}");
        match (place.point, place.point_in_body) {
            (Some(point), None) => {
                markers.push((marker.clone(), pose.point_to_body(point.components())));
            }
            (None, Some(point)) => markers.push((marker.clone(), point.components())),
            (Some(_), Some(_)) => {
                let message = format!("`{path}` has both `point` and `point_in_body`");
                let error = Diagnostic::new(Code::ConflictingFields, path, message);
                errors.push(error.help("leave one of them out"));
            }
            (None, None) => {
                let message = format!("`{path}` has no `point`");
                let error = Diagnostic::new(Code::MissingField, format!("{path}.point"), message);
                errors.push(error.help("give `point`, or `point_in_body` in its place"));
            }
        }
    }
    let shapes = shapes::shapes(name, body, dimension, errors);
    let weight = shapes::weight(name, body, &shapes, dimension, errors);
    let body = model::Body {
        name: name.to_owned(),
        mass: weight.mass,
        inertia: weight.inertia,
        position,
        orientation,
        center_of_mass: weight.center_of_mass,
        markers,
        shapes,
    };
    (body, pose)
}
