//! Points and axes of items, given in one of three ways, become points and axes of bodies.

use super::geometry::{Mat3, Vec3, column, dot, triad, turned_least, unit};
use super::{Choice, Context};
use crate::error::Code;
use crate::io::names::suggest;
use crate::io::schema::{Place, Vector};
use crate::model::{BodyIndex, Frame};

/// A point or axis per body, in body axes.
pub(super) type Pair = [Vec3; 2];

impl<'a> Context<'a> {
    /// A point in body axes of `body`, which a marker must belong to.
    fn place_on(&mut self, path: &str, place: &Place, body: BodyIndex) -> Option<Vec3> {
        match place {
            Place::At(point) => Some(self.pose(body).point_to_body(point.components())),
            Place::Marker(name) => {
                let (owner, point) = self.marker(path, name)?;
                if Some(owner) != body {
                    let wanted = self.name(body);
                    let message =
                        format!("`{path}` is the marker `{name}`; expected a point of `{wanted}`");
                    let help = "the order of the points is the order of `between`";
                    self.refuse(Code::UnknownName, path, message, help);
                    return None;
                }
                Some(point)
            }
        }
    }

    /// Body and point, in body axes, of the marker `"body.marker"`.
    fn marker(&mut self, path: &str, name: &str) -> Option<(usize, Vec3)> {
        let Some((body, marker)) = name.split_once('.') else {
            let message = format!("`{path}` is the text {name:?}; expected a point or a marker");
            self.refuse(Code::WrongType, path, message, "markers are written \"body.marker\"");
            return None;
        };
        let owner = self.moving_body(path, body)?;
        if let Some(&point) = self.poses[owner].markers.get(marker) {
            return Some((owner, point));
        }
        let message = format!("`{path}` names the marker `{marker}`, which `{body}` does not have");
        let help = suggest(
            &self.errors,
            marker,
            "markers",
            self.poses[owner].markers.keys().map(String::as_str),
        );
        self.refuse(Code::UnknownName, path, message, &help);
        None
    }

    /// One point shared by two bodies in the design configuration, or a point of each.
    pub(super) fn shared_point(
        &mut self,
        item: &str,
        bodies: [BodyIndex; 2],
        point: Option<&'a Place>,
        in_body: Option<&'a [Vector; 2]>,
    ) -> Option<Pair> {
        match self.one_of(item, ("point", point), ("points_in_body", in_body))? {
            Choice::Second(points) => Some(points.map(Vector::components)),
            Choice::First(Place::At(point)) => {
                let point = point.components();
                Some(bodies.map(|body| self.pose(body).point_to_body(point)))
            }
            Choice::First(Place::Marker(name)) => {
                let path = format!("{item}.point");
                let (owner, point) = self.marker(&path, name)?;
                if !bodies.contains(&Some(owner)) {
                    let [first, second] = bodies.map(|body| self.name(body));
                    let message = format!(
                        "`{path}` is the marker `{name}`; expected a point of `{first}` or `{second}`"
                    );
                    let help = "name a marker of one of the two bodies";
                    self.refuse(Code::UnknownName, path, message, help);
                    return None;
                }
                let ground = self.pose(Some(owner)).point_to_ground(point);
                Some(bodies.map(|body| {
                    if body == Some(owner) { point } else { self.pose(body).point_to_body(ground) }
                }))
            }
        }
    }

    /// A point on the first and a point on the second body.
    pub(super) fn two_points(
        &mut self,
        item: &str,
        bodies: [BodyIndex; 2],
        points: Option<&'a [Place; 2]>,
        in_body: Option<&'a [Vector; 2]>,
    ) -> Option<Pair> {
        match self.one_of(item, ("points", points), ("points_in_body", in_body))? {
            Choice::Second(points) => Some(points.map(Vector::components)),
            Choice::First([first, second]) => {
                let first = self.place_on(&format!("{item}.points[0]"), first, bodies[0]);
                let second = self.place_on(&format!("{item}.points[1]"), second, bodies[1]);
                Some([first?, second?])
            }
        }
    }

    /// A point of one body.
    pub(super) fn one_point(
        &mut self,
        item: &str,
        body: usize,
        point: Option<&'a Place>,
        in_body: Option<&'a Vector>,
    ) -> Option<Vec3> {
        match self.one_of(item, ("point", point), ("point_in_body", in_body))? {
            Choice::First(place) => self.place_on(&format!("{item}.point"), place, Some(body)),
            Choice::Second(point) => Some(point.components()),
        }
    }

    /// A unit vector along what the user gave.
    pub(super) fn direction(&mut self, path: &str, vector: Vector) -> Option<Vec3> {
        let direction = unit(vector.components());
        if direction.is_none() {
            let message = format!("`{path}` has length zero; expected a direction");
            self.refuse(
                Code::ZeroAxis,
                path,
                message,
                "give a vector along the axis, of any length",
            );
        }
        direction
    }

    /// An axis on each body, unit vectors in ground axes of the design configuration.
    pub(super) fn shared_axis(
        &mut self,
        item: &str,
        bodies: [BodyIndex; 2],
        axis: Option<&'a Vector>,
        in_body: Option<&'a [Vector; 2]>,
    ) -> Option<Pair> {
        match self.one_of(item, ("axis", axis), ("axes_in_body", in_body))? {
            Choice::First(&axis) => {
                let axis = self.direction(&format!("{item}.axis"), axis)?;
                Some([axis, axis])
            }
            Choice::Second(&axes) => self.axes_of_bodies(item, bodies, axes),
        }
    }

    /// `axes_in_body` in ground axes of the design configuration.
    pub(super) fn axes_of_bodies(
        &mut self,
        item: &str,
        bodies: [BodyIndex; 2],
        axes: [Vector; 2],
    ) -> Option<Pair> {
        let first = self.direction(&format!("{item}.axes_in_body[0]"), axes[0]);
        let second = self.direction(&format!("{item}.axes_in_body[1]"), axes[1]);
        let (first, second) = (first?, second?);
        Some([
            self.pose(bodies[0]).direction_to_ground(first),
            self.pose(bodies[1]).direction_to_ground(second),
        ])
    }

    /// Frames with axes given in ground axes of the design configuration.
    pub(super) fn frames(
        &self,
        bodies: [BodyIndex; 2],
        points: Pair,
        axes: [Mat3; 2],
    ) -> [Frame; 2] {
        [0, 1].map(|side| Frame {
            body: bodies[side],
            point: points[side],
            axes: self.pose(bodies[side]).axes_to_body(&axes[side]),
        })
    }

    /// Frames about an axis: h along it, f of the second that of the first turned as little as the axes ask for, so that the
    /// relative angle, a twist where the axes differ, is zero in the design configuration.
    pub(super) fn frames_about(
        &self,
        bodies: [BodyIndex; 2],
        points: Pair,
        axes: Pair,
    ) -> [Frame; 2] {
        let first = triad(axes[0], axes[0]);
        let f = turned_least(axes, column(&first, 0));
        self.frames(bodies, points, [first, triad(axes[1], f)])
    }

    /// Frames of a twist: the axis has the direction stated for the first body, also where that for the second one is opposite.
    pub(super) fn frames_of_twist(&self, mut frames: [Frame; 2]) -> [Frame; 2] {
        let [first, second] =
            frames.map(|frame| self.pose(frame.body).direction_to_ground(column(&frame.axes, 2)));
        if dot(first, second) < 0.0 {
            for row in &mut frames[1].axes {
                (row[1], row[2]) = (-row[1], -row[2]);
            }
        }
        frames
    }
}

/// Frames with axes parallel to the body axes.
pub(super) fn plain_frames(bodies: [BodyIndex; 2], points: Pair) -> [Frame; 2] {
    [0, 1].map(|side| plain_frame(bodies[side], points[side]))
}

/// A frame with axes parallel to the body axes.
pub(super) fn plain_frame(body: BodyIndex, point: Vec3) -> Frame {
    Frame { body, point, axes: super::geometry::IDENTITY }
}
