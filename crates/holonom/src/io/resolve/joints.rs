//! Joints.

use super::geometry::{IDENTITY, cross, distance, dot, planar_axes, triad};
use super::places::plain_frames;
use super::{Choice, Context};
use crate::error::Code;
use crate::io::schema::{self, Vector};
use crate::model::{Frame, Joint, JointKind};
use crate::watch::{NAMED, checkpoint};

/// Largest cosine between axes that count as perpendicular.
const PERPENDICULAR: f64 = 1e-6;

impl<'a> Context<'a> {
    pub(super) fn joints(&mut self) -> Vec<Joint> {
        let file = self.file;
        let joints = file.joints.iter().filter_map(|(name, joint)| {
            checkpoint(NAMED);
            let (kind, frames) = self.joint(&format!("joints.{name}"), joint)?;
            Some(Joint { name: name.clone(), kind, frames })
        });
        joints.collect()
    }

    fn joint(&mut self, item: &str, joint: &'a schema::Joint) -> Option<(JointKind, [Frame; 2])> {
        match joint {
            schema::Joint::Fixed(j) => Some((JointKind::Fixed, self.point_joint(item, j)?)),
            schema::Joint::Spherical(j) => Some((JointKind::Spherical, self.point_joint(item, j)?)),
            schema::Joint::Revolute(j) => Some((JointKind::Revolute, self.revolute(item, j)?)),
            schema::Joint::Translational(j) => {
                Some((JointKind::Translational, self.axis_joint(item, j)?))
            }
            schema::Joint::Cylindrical(j) => {
                Some((JointKind::Cylindrical, self.axis_joint(item, j)?))
            }
            schema::Joint::Universal(j) => Some((JointKind::Universal, self.universal(item, j)?)),
            schema::Joint::Distance(j) => self.distance(item, j),
        }
    }

    /// Axes of both frames are the ground axes in the design configuration.
    fn point_joint(&mut self, item: &str, j: &'a schema::PointJoint) -> Option<[Frame; 2]> {
        let bodies = self.between(item, &j.between);
        let points =
            self.shared_point(item, bodies?, j.point.as_ref(), j.points_in_body.as_ref())?;
        Some(self.frames(bodies?, points, [IDENTITY; 2]))
    }

    fn revolute(&mut self, item: &str, j: &'a schema::Revolute) -> Option<[Frame; 2]> {
        let bodies = self.between(item, &j.between)?;
        let points = self.shared_point(item, bodies, j.point.as_ref(), j.points_in_body.as_ref());
        if self.planar() {
            return Some(plain_frames(bodies, points?));
        }
        let axes = self.shared_axis(item, bodies, j.axis.as_ref(), j.axes_in_body.as_ref());
        Some(self.frames_about(bodies, points?, axes?))
    }

    fn axis_joint(&mut self, item: &str, j: &'a schema::AxisJoint) -> Option<[Frame; 2]> {
        let bodies = self.between(item, &j.between)?;
        let points = self.shared_point(item, bodies, j.point.as_ref(), j.points_in_body.as_ref());
        let axes = self.shared_axis(item, bodies, j.axis.as_ref(), j.axes_in_body.as_ref());
        let (points, axes) = (points?, axes?);
        if self.planar() {
            return Some(self.frames(bodies, points, axes.map(planar_axes)));
        }
        Some(self.frames_about(bodies, points, axes))
    }

    fn universal(&mut self, item: &str, j: &'a schema::Universal) -> Option<[Frame; 2]> {
        let bodies = self.between(item, &j.between)?;
        let points = self.shared_point(item, bodies, j.point.as_ref(), j.points_in_body.as_ref());
        let axes = match self.one_of(
            item,
            ("axes", j.axes.as_ref()),
            ("axes_in_body", j.axes_in_body.as_ref()),
        )? {
            Choice::Second(&axes) => self.axes_of_bodies(item, bodies, axes)?,
            Choice::First(&[first, second]) => {
                let path = format!("{item}.axes");
                let first = self.direction(&format!("{path}[0]"), first);
                let second = self.direction(&format!("{path}[1]"), second);
                let axes = [first?, second?];
                self.perpendicular(&path, axes)?;
                axes
            }
        };
        // f along the common perpendicular of both axes.
        let f = cross(axes[0], axes[1]);
        Some(self.frames(bodies, points?, axes.map(|h| triad(h, f))))
    }

    /// Refuses two unit vectors that are not perpendicular.
    pub(super) fn perpendicular(&mut self, path: &str, [a, b]: [[f64; 3]; 2]) -> Option<()> {
        let angle = dot(a, b).clamp(-1.0, 1.0).acos().to_degrees();
        if dot(a, b).abs() <= PERPENDICULAR {
            return Some(());
        }
        let message = format!("the two `{path}` enclose {angle:.4} degrees; expected 90");
        self.refuse(
            Code::NotPerpendicular,
            path,
            message,
            "choose the second axis perpendicular to the first",
        );
        None
    }

    fn distance(&mut self, item: &str, j: &'a schema::Distance) -> Option<(JointKind, [Frame; 2])> {
        let bodies = self.between(item, &j.between)?;
        let points = self.two_points(item, bodies, j.points.as_ref(), j.points_in_body.as_ref())?;
        let [a, b] = [0, 1].map(|side| self.pose(bodies[side]).point_to_ground(points[side]));
        let design = distance(a, b);
        let length = j.length.unwrap_or(design);
        if j.length.is_none() && design < 1e-12 {
            let at = if j.points.is_some() { "points" } else { "points_in_body" };
            let message =
                format!("the two points of `{item}` coincide; expected a positive distance");
            let help = "use a spherical (planar: revolute) joint to hold two points together";
            self.refuse(Code::CoincidentPoints, format!("{item}.{at}"), message, help);
            return None;
        }
        Some((JointKind::Distance { length }, plain_frames(bodies, points)))
    }

    /// Both axes of a bushing or of a similar element, or ground axes.
    pub(super) fn two_axes(
        &mut self,
        item: &str,
        axes: Option<[Vector; 2]>,
    ) -> Option<[[f64; 3]; 3]> {
        let Some([first, second]) = axes else { return Some(IDENTITY) };
        let path = format!("{item}.axes");
        let first = self.direction(&format!("{path}[0]"), first);
        let second = self.direction(&format!("{path}[1]"), second);
        let axes = [first?, second?];
        self.perpendicular(&path, axes)?;
        super::geometry::triad_of_first_two(axes[0], axes[1])
    }
}
