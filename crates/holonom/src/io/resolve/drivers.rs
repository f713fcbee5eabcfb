//! Drivers.

use indexmap::IndexMap;

use super::Context;
use super::geometry::planar_axes;
use super::places::plain_frames;
use crate::error::Code;
use crate::io::names::suggest;
use crate::io::schema::{self, Coordinate};
use crate::model::{BodyIndex, Driver, DriverKind, Frame, Joint, JointKind};

impl<'a> Context<'a> {
    pub(super) fn drivers(&mut self, joints: &[Joint]) -> Vec<Driver> {
        let file = self.file;
        let joints: IndexMap<&str, &Joint> = joints.iter().map(|j| (j.name.as_str(), j)).collect();
        let mut out = Vec::with_capacity(file.drivers.len());
        for (name, driver) in &file.drivers {
            let item = format!("drivers.{name}");
            let frames = self.driver_frames(&item, driver, &joints);
            let motion = self.motion(&format!("{item}.motion"), &driver.motion, 1.0);
            let kind = match driver.coordinate {
                Coordinate::Translation => DriverKind::Translation,
                Coordinate::Rotation => DriverKind::Rotation,
            };
            if let (Some(frames), Some(motion)) = (frames, motion) {
                let twists = kind == DriverKind::Rotation && !self.planar();
                let frames = if twists { self.frames_of_twist(frames) } else { frames };
                out.push(Driver { name: name.clone(), kind, frames, motion });
            }
        }
        out
    }

    fn driver_frames(
        &mut self,
        item: &str,
        driver: &'a schema::Driver,
        joints: &IndexMap<&str, &Joint>,
    ) -> Option<[Frame; 2]> {
        match (&driver.joint, driver.between.as_ref(), driver.on.as_ref()) {
            (Some(joint), None, None) => self.frames_of_joint(item, driver, joint, joints),
            (None, Some(names), None) => {
                let bodies = self.between(item, names)?;
                self.own_frames(item, driver, bodies)
            }
            (None, None, Some(name)) => {
                let body = self.moving_body(&format!("{item}.on"), name)?;
                self.own_frames(item, driver, [None, Some(body)])
            }
            (None, None, None) => {
                let message = format!("`{item}` does not say what it drives");
                let help = "give `joint`, or `between` or `on` with the geometry";
                self.refuse(Code::MissingField, format!("{item}.joint"), message, help);
                None
            }
            _ => {
                let message = format!("`{item}` has more than one of `joint`, `between` and `on`");
                self.refuse(Code::ConflictingFields, item, message, "leave the others out");
                None
            }
        }
    }

    fn frames_of_joint(
        &mut self,
        item: &str,
        driver: &schema::Driver,
        joint: &str,
        joints: &IndexMap<&str, &Joint>,
    ) -> Option<[Frame; 2]> {
        let stated = [
            ("point", driver.point.is_some()),
            ("points_in_body", driver.points_in_body.is_some()),
            ("axis", driver.axis.is_some()),
            ("axes_in_body", driver.axes_in_body.is_some()),
        ];
        for (field, _) in stated.iter().filter(|(_, stated)| *stated) {
            let message = format!("`{item}` takes its geometry from `{joint}`, yet has `{field}`");
            let path = format!("{item}.{field}");
            self.refuse(Code::ConflictingFields, path, message, "leave the field out");
        }
        let path = format!("{item}.joint");
        let known = &self.file.joints;
        if !known.contains_key(joint) {
            let message = format!("`{path}` names the joint `{joint}`, which is not there");
            let help = suggest(&self.errors, joint, "joints", known.keys().map(String::as_str));
            self.refuse(Code::UnknownName, path, message, &help);
            return None;
        }
        let joint = joints.get(joint)?; // absent: it has errors of its own
        let (slides, turns) = match joint.kind {
            JointKind::Translational => (true, false),
            JointKind::Revolute => (false, true),
            JointKind::Cylindrical => (true, true),
            _ => (false, false),
        };
        let (possible, what) = match driver.coordinate {
            Coordinate::Translation => (slides, "displacement along an axis"),
            Coordinate::Rotation => (turns, "angle about an axis"),
        };
        if possible {
            return Some(joint.frames);
        }
        let path = format!("{item}.coordinate");
        let message = format!("the joint `{}` of `{item}` has no {what}", joint.name);
        let help = "translation: translational or cylindrical joints; rotation: revolute or cylindrical joints";
        self.refuse(Code::ConflictingFields, path, message, help);
        None
    }

    fn own_frames(
        &mut self,
        item: &str,
        driver: &'a schema::Driver,
        bodies: [BodyIndex; 2],
    ) -> Option<[Frame; 2]> {
        let rotation = driver.coordinate == Coordinate::Rotation;
        let has_point = driver.point.is_some() || driver.points_in_body.is_some();
        let points = if rotation && !has_point {
            Some([[0.0; 3]; 2])
        } else {
            self.shared_point(item, bodies, driver.point.as_ref(), driver.points_in_body.as_ref())
        };
        if rotation && self.planar() {
            for (field, stated) in
                [("axis", driver.axis.is_some()), ("axes_in_body", driver.axes_in_body.is_some())]
            {
                if stated {
                    let path = format!("{item}.{field}");
                    let message = format!(
                        "`{item}` is a planar rotation, which is about z, yet has `{field}`"
                    );
                    self.refuse(Code::WrongDimension, path, message, "leave the field out");
                }
            }
            return Some(plain_frames(bodies, points?));
        }
        let axes =
            self.shared_axis(item, bodies, driver.axis.as_ref(), driver.axes_in_body.as_ref())?;
        let points = points?;
        Some(if self.planar() {
            self.frames(bodies, points, axes.map(planar_axes))
        } else {
            self.frames_about(bodies, points, axes)
        })
    }
}
