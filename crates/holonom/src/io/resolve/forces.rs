//! Forces and roads.

use super::geometry::Vec3;
use super::places::{plain_frame, plain_frames};
use super::{Choice, Context};
use crate::error::{Code, shown};
use crate::io::names::suggest;
use crate::io::schema::{self, Components, Motion, TorqueComponents};
use crate::model::{Branch, Force, ForceAxes, ForceKind, LateralTyre, Road, Tyre};
use crate::model::{FARTHEST, TimeFunction};
use crate::watch::{NAMED, checkpoint};

/// Units along and about the axes of a bushing.
const STIFFNESS: [&str; 2] = ["N/m", "N m/rad"];
const DAMPING: [&str; 2] = ["N s/m", "N m s/rad"];
const NOTHING: TimeFunction = TimeFunction::Constant(0.0);

/// What a bushing states along its axes, about them, and as a whole.
type StatedMatrix = (Option<[f64; 3]>, Option<[f64; 3]>, Option<[[f64; 6]; 6]>);

impl<'a> Context<'a> {
    pub(super) fn forces(&mut self) -> Vec<Force> {
        self.tables();
        self.roads();
        let file = self.file;
        let forces = file.forces.iter().filter_map(|(name, force)| {
            checkpoint(NAMED);
            let kind = self.force(&format!("forces.{name}"), force)?;
            Some(Force { name: name.clone(), kind })
        });
        forces.collect()
    }

    fn force(&mut self, item: &str, force: &'a schema::Force) -> Option<ForceKind> {
        match force {
            schema::Force::Tsda(f) => self.tsda(item, f),
            schema::Force::Rsda(f) => self.rsda(item, f),
            schema::Force::Maxwell(f) => {
                let bodies = self.between(item, &f.between)?;
                let points =
                    self.two_points(item, bodies, f.points.as_ref(), f.points_in_body.as_ref())?;
                Some(ForceKind::Maxwell {
                    frames: plain_frames(bodies, points),
                    stiffness: f.stiffness,
                    damping: f.damping,
                    free_length: f.free_length,
                })
            }
            schema::Force::Bushing(f) => self.bushing(item, f),
            schema::Force::Tyre(f) => self.tyre(item, f),
            schema::Force::PointForce(f) => self.point_force(item, f),
            schema::Force::Torque(f) => self.torque(item, f),
        }
    }

    /// An element of which nothing is said is a mistake; one that is zero may be varied.
    fn acts(&mut self, item: &str, stated: &[(&str, bool)]) {
        if stated.iter().all(|(_, stated)| !stated) {
            let fields: Vec<_> = stated.iter().map(|(field, _)| format!("`{field}`")).collect();
            let message = format!("`{item}` has none of {}", fields.join(", "));
            let help = "give at least one of them, or switch the item off with `enabled = false`";
            self.refuse(Code::MissingField, format!("{item}.stiffness"), message, help);
        }
    }

    fn tsda(&mut self, item: &str, f: &'a schema::Tsda) -> Option<ForceKind> {
        let bodies = self.between(item, &f.between)?;
        let points = self.two_points(item, bodies, f.points.as_ref(), f.points_in_body.as_ref());
        let law = self.law(item, f.stiffness, ("force", f.force.as_ref()));
        let [stiffness, force] = [f.stiffness.is_some(), f.force.is_some()];
        let damping = ("damping", f.damping.is_some());
        self.acts(item, &[("stiffness", stiffness), ("force", force), damping]);
        if (stiffness || force) && f.free_length.is_none() {
            let message = format!("`{item}` has no `free_length`; expected a number (m)");
            let help = "the length at which the elastic force is zero";
            self.refuse(Code::MissingField, format!("{item}.free_length"), message, help);
        }
        Some(ForceKind::Tsda {
            frames: plain_frames(bodies, points?),
            law: law?,
            damping: f.damping.unwrap_or(0.0),
            free_length: f.free_length.unwrap_or(0.0),
        })
    }

    fn rsda(&mut self, item: &str, f: &'a schema::Rsda) -> Option<ForceKind> {
        let bodies = self.between(item, &f.between)?;
        let law = self.law(item, f.stiffness, ("torque", f.torque.as_ref()));
        let [stiffness, torque] = [f.stiffness.is_some(), f.torque.is_some()];
        let damping = ("damping", f.damping.is_some());
        self.acts(item, &[("stiffness", stiffness), ("torque", torque), damping]);
        let points = [[0.0; 3]; 2];
        let frames = if self.planar() {
            plain_frames(bodies, points)
        } else {
            let axes = self.shared_axis(item, bodies, f.axis.as_ref(), f.axes_in_body.as_ref())?;
            self.frames_of_twist(self.frames_about(bodies, points, axes))
        };
        Some(ForceKind::Rsda {
            frames,
            law: law?,
            damping: f.damping.unwrap_or(0.0),
            free_angle: f.free_angle,
        })
    }

    fn bushing(&mut self, item: &str, f: &'a schema::Bushing) -> Option<ForceKind> {
        let bodies = self.between(item, &f.between)?;
        let points = self.shared_point(item, bodies, f.point.as_ref(), f.points_in_body.as_ref());
        let axes = self.two_axes(item, f.axes);
        let stiffness = (f.stiffness, f.rotational_stiffness, f.stiffness_matrix);
        let damping = (f.damping, f.rotational_damping, f.damping_matrix);
        let stated = [
            ("stiffness", stiffness.0.is_some()),
            ("rotational_stiffness", stiffness.1.is_some()),
            ("stiffness_matrix", stiffness.2.is_some()),
            ("damping", damping.0.is_some()),
            ("rotational_damping", damping.1.is_some()),
            ("damping_matrix", damping.2.is_some()),
            ("branches", !f.branches.is_empty()),
        ];
        self.acts(item, &stated);
        let stiffness = self.matrix(item, "stiffness", STIFFNESS, stiffness);
        let damping = self.matrix(item, "damping", DAMPING, damping);
        let branches = f.branches.iter().map(|(name, b)| {
            let item = &format!("{item}.branches.{name}");
            let stiffness = (b.stiffness, b.rotational_stiffness, b.stiffness_matrix);
            let damping = (b.damping, b.rotational_damping, b.damping_matrix);
            Branch {
                name: name.clone(),
                stiffness: self.matrix(item, "stiffness", STIFFNESS, stiffness),
                damping: self.matrix(item, "damping", DAMPING, damping),
            }
        });
        let branches = branches.collect();
        let axes = axes?;
        Some(ForceKind::Bushing {
            frames: self.frames(bodies, points?, [axes; 2]),
            stiffness: Box::new(stiffness),
            damping: Box::new(damping),
            branches,
        })
    }

    /// A 6×6 matrix from its diagonal, whose halves have units of their own, or as stated.
    fn matrix(
        &mut self,
        item: &str,
        name: &str,
        units: [&str; 2],
        (along, about, matrix): StatedMatrix,
    ) -> [[f64; 6]; 6] {
        let halves = [(name.to_owned(), along), (format!("rotational_{name}"), about)];
        if let Some(matrix) = matrix {
            for (half, stated) in halves {
                if stated.is_some() {
                    let path = format!("{item}.{half}");
                    let message = format!("`{item}` has both `{name}_matrix` and `{half}`");
                    self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
                }
            }
            return matrix;
        }
        let mut out = [[0.0; 6]; 6];
        for (k, (half, stated)) in halves.into_iter().enumerate() {
            let unit = units[k];
            for (i, value) in stated.unwrap_or_default().into_iter().enumerate() {
                if value < 0.0 {
                    let path = format!("{item}.{half}[{i}]");
                    let value = shown(value);
                    let message =
                        format!("`{path}` is {value} {unit}; expected a number not below zero");
                    let help = "a negative one would feed energy into the motion";
                    self.refuse(Code::OutOfRange, path, message, help);
                }
                out[3 * k + i][3 * k + i] = value.abs(); // a refused value is reported once
            }
        }
        out
    }

    fn tyre(&mut self, item: &str, f: &'a schema::Tyre) -> Option<ForceKind> {
        let body = self.moving_body(&format!("{item}.on"), f.on.as_ref())?;
        let point = self.one_point(item, body, f.point.as_ref(), f.point_in_body.as_ref());
        let road = self.file.roads.get(&f.road).map(road);
        if road.is_none() {
            let path = format!("{item}.road");
            let message = format!("`{path}` names the road `{}`, which is not there", f.road);
            let help =
                suggest(&self.errors, &f.road, "roads", self.file.roads.keys().map(String::as_str));
            self.refuse(Code::UnknownName, path, message, &help);
        }
        let lateral = match &f.lateral {
            None => None,
            Some(lateral) => Some(self.lateral(&format!("{item}.lateral"), body, lateral)?),
        };
        Some(ForceKind::Tyre(Tyre {
            frame: plain_frame(Some(body), point?),
            radius: f.radius,
            stiffness: f.stiffness,
            damping: f.damping,
            smoothing: f.smoothing,
            road: road?,
            lateral,
        }))
    }

    fn lateral(&mut self, path: &str, body: usize, f: &'a schema::Lateral) -> Option<LateralTyre> {
        let axis = match self.one_of(
            path,
            ("axis", f.axis.as_ref()),
            ("axis_in_body", f.axis_in_body.as_ref()),
        )? {
            Choice::First(&axis) => {
                let axis = self.direction(&format!("{path}.axis"), axis)?;
                self.pose(Some(body)).direction_to_body(axis)
            }
            Choice::Second(&axis) => self.direction(&format!("{path}.axis_in_body"), axis)?,
        };
        Some(LateralTyre {
            cornering_stiffness: f.cornering_stiffness,
            regularization_speed: f.regularization_speed,
            axis,
        })
    }

    fn point_force(&mut self, item: &str, f: &'a schema::PointForce) -> Option<ForceKind> {
        let body = self.moving_body(&format!("{item}.on"), f.on.as_ref())?;
        let point = self.one_point(item, body, f.point.as_ref(), f.point_in_body.as_ref());
        let path = format!("{item}.force");
        let force = match &f.force {
            Components::Along(motion) => self.along(&path, motion, ("direction", f.direction)),
            Components::Planar(list) => self.each(&path, list, ("direction", f.direction)),
            Components::Spatial(list) => self.each(&path, list, ("direction", f.direction)),
        };
        Some(ForceKind::PointForce {
            frame: plain_frame(Some(body), point?),
            force: force?,
            axes: axes(f.axes),
        })
    }

    fn torque(&mut self, item: &str, f: &'a schema::Torque) -> Option<ForceKind> {
        let [reaction, body] =
            match self.one_of(item, ("on", f.on.as_ref()), ("between", f.between.as_ref()))? {
                Choice::First(name) => [None, Some(self.moving_body(&format!("{item}.on"), name)?)],
                Choice::Second(names) => self.between(item, names)?,
            };
        let path = format!("{item}.torque");
        let torque = match (&f.torque, self.planar()) {
            (TorqueComponents::About(motion), true) => {
                [NOTHING, NOTHING, self.motion(&path, motion, 1.0)?]
            }
            (TorqueComponents::About(motion), false) => {
                self.along(&path, motion, ("axis", f.axis))?
            }
            (TorqueComponents::Spatial(list), _) => self.each(&path, list, ("axis", f.axis))?,
        };
        Some(ForceKind::Torque { body, reaction, torque, axes: axes(f.axes) })
    }

    /// Components of one function along a direction.
    fn along(
        &mut self,
        path: &str,
        motion: &Motion,
        (field, direction): (&str, Option<schema::Vector>),
    ) -> Option<[TimeFunction; 3]> {
        let item = path.rsplit_once('.').map_or(path, |(item, _)| item);
        let Some(direction) = direction else {
            let message =
                format!("`{item}` has no `{field}` for the one number or function of `{path}`");
            let help = format!("give `{field}`, or write `{path}` as a list of components");
            self.refuse(Code::MissingField, format!("{item}.{field}"), message, &help);
            return None;
        };
        let [x, y, z]: Vec3 = self.direction(&format!("{item}.{field}"), direction)?;
        // What is wrong with the function is said once, of the first.
        let x = self.motion(path, motion, x)?;
        Some([x, self.motion(path, motion, y)?, self.motion(path, motion, z)?])
    }

    /// Components over time, one by one; what a planar list does not have is zero.
    fn each(
        &mut self,
        path: &str,
        list: &[Motion],
        (field, direction): (&str, Option<schema::Vector>),
    ) -> Option<[TimeFunction; 3]> {
        if direction.is_some() {
            let item = path.rsplit_once('.').map_or(path, |(item, _)| item);
            let message = format!("`{item}` has components in `{path}`, yet has `{field}`");
            let at = format!("{item}.{field}");
            self.refuse(Code::ConflictingFields, at, message, "leave one of them out");
            return None;
        }
        let [x, y, z] = [0, 1, 2].map(|k| match list.get(k) {
            Some(motion) => self.motion(&format!("{path}[{k}]"), motion, 1.0),
            None => Some(NOTHING),
        });
        Some([x?, y?, z?])
    }

    /// Roads are checked whether they are used or not.
    fn roads(&mut self) {
        let file = self.file;
        for (name, road) in &file.roads {
            let lengths = match road {
                schema::Road::Flat(r) => vec![("height", r.height, false)],
                schema::Road::SmoothBump(r) => vec![
                    ("height", r.height, false),
                    ("half_length", r.half_length, true),
                    ("center", r.center, false),
                ],
                schema::Road::HalfCylinder(r) => {
                    vec![("radius", r.radius, true), ("center", r.center, false)]
                }
            };
            for (field, value, is_positive) in lengths {
                let (expected, help) = match value {
                    x if is_positive && x <= 0.0 => ("a positive number", ""),
                    x if x.abs() > FARTHEST => ("at most 1e9 m in size", "lengths are in metres"),
                    _ => continue,
                };
                let path = format!("roads.{name}.{field}");
                let message = format!("`{path}` is {} m; expected {expected}", shown(value));
                self.refuse(Code::OutOfRange, path, message, help);
            }
        }
    }
}

fn axes(axes: schema::Axes) -> ForceAxes {
    match axes {
        schema::Axes::Ground => ForceAxes::Ground,
        schema::Axes::Body => ForceAxes::Body,
    }
}

fn road(road: &schema::Road) -> Road {
    match road {
        schema::Road::Flat(r) => Road::Flat { height: r.height },
        schema::Road::SmoothBump(r) => {
            Road::SmoothBump { height: r.height, half_length: r.half_length, center: r.center }
        }
        schema::Road::HalfCylinder(r) => Road::HalfCylinder { radius: r.radius, center: r.center },
    }
}
