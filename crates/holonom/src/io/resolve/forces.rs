//! Forces and roads.

use super::geometry::Vec3;
use super::places::{plain_frame, plain_frames};
use super::{Choice, Context};
use crate::error::{Code, shown};
use crate::io::names::suggest;
use crate::io::schema::{self, Components};
use crate::model::TimeFunction;
use crate::model::{Branch, Force, ForceAxes, ForceKind, LateralTyre, Road, Tyre};
use crate::watch::{NAMED, checkpoint};

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
    fn acts(&mut self, item: &str, stated: bool) {
        if !stated {
            let message = format!("`{item}` has neither `stiffness`, nor a law, nor `damping`");
            let help = "give at least one of them, or switch the item off with `enabled = false`";
            self.refuse(Code::MissingField, format!("{item}.stiffness"), message, help);
        }
    }

    fn tsda(&mut self, item: &str, f: &'a schema::Tsda) -> Option<ForceKind> {
        let bodies = self.between(item, &f.between)?;
        let points = self.two_points(item, bodies, f.points.as_ref(), f.points_in_body.as_ref());
        let law = self.law(item, f.stiffness, ("force", f.force.as_ref()));
        let elastic = f.stiffness.is_some() || f.force.is_some();
        self.acts(item, elastic || f.damping.is_some());
        if elastic && f.free_length.is_none() {
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
        self.acts(item, f.stiffness.is_some() || f.torque.is_some() || f.damping.is_some());
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
        let stiffness = self.matrix(
            item,
            ("stiffness", f.stiffness),
            ("rotational_stiffness", f.rotational_stiffness),
            ("stiffness_matrix", f.stiffness_matrix),
        );
        let damping = self.matrix(
            item,
            ("damping", f.damping),
            ("rotational_damping", f.rotational_damping),
            ("damping_matrix", f.damping_matrix),
        );
        let diagonals = [f.stiffness, f.rotational_stiffness, f.damping, f.rotational_damping];
        let matrices = [f.stiffness_matrix, f.damping_matrix];
        let stated = diagonals.iter().any(Option::is_some) || matrices.iter().any(Option::is_some);
        self.acts(item, stated || !f.branches.is_empty());
        let branches = f.branches.iter().map(|(name, branch)| {
            let item = &format!("{item}.branches.{name}");
            Branch {
                name: name.clone(),
                stiffness: self.matrix(
                    item,
                    ("stiffness", branch.stiffness),
                    ("rotational_stiffness", branch.rotational_stiffness),
                    ("stiffness_matrix", branch.stiffness_matrix),
                ),
                damping: self.matrix(
                    item,
                    ("damping", branch.damping),
                    ("rotational_damping", branch.rotational_damping),
                    ("damping_matrix", branch.damping_matrix),
                ),
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

    /// A 6×6 matrix from its diagonal or as stated.
    fn matrix(
        &mut self,
        item: &str,
        (along_name, along): (&str, Option<[f64; 3]>),
        (about_name, about): (&str, Option<[f64; 3]>),
        (matrix_name, matrix): (&str, Option<[[f64; 6]; 6]>),
    ) -> [[f64; 6]; 6] {
        if let Some(matrix) = matrix {
            for (name, stated) in [(along_name, along), (about_name, about)] {
                if stated.is_some() {
                    let path = format!("{item}.{name}");
                    let message = format!("`{item}` has both `{matrix_name}` and `{name}`");
                    self.refuse(Code::ConflictingFields, path, message, "leave one of them out");
                }
            }
            return matrix;
        }
        let mut out = [[0.0; 6]; 6];
        for (offset, name, stated) in [(0, along_name, along), (3, about_name, about)] {
            for (i, value) in stated.unwrap_or_default().into_iter().enumerate() {
                if value < 0.0 {
                    let path = format!("{item}.{name}[{i}]");
                    let message =
                        format!("`{path}` is {}; expected a number not below zero", shown(value));
                    let help = "a negative one would feed energy into the motion";
                    self.refuse(Code::OutOfRange, path, message, help);
                }
                out[offset + i][offset + i] = value.abs(); // a refused value is reported once
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
        let force = self.components(&format!("{item}.force"), &f.force, ("direction", f.direction));
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
            (Components::Along(motion), true) => {
                let zero = TimeFunction::Constant(0.0);
                [zero.clone(), zero, self.motion(&path, motion, 1.0)?]
            }
            (Components::Planar(_), _) => {
                let message =
                    format!("`{path}` has 2 entries; expected a number or a function of time");
                let help = "this model is planar: a torque is about z";
                self.refuse(Code::WrongDimension, path, message, help);
                return None;
            }
            (components, _) => self.components(&path, components, ("axis", f.axis))?,
        };
        Some(ForceKind::Torque { body, reaction, torque, axes: axes(f.axes) })
    }

    /// Components over time, or one function along a direction.
    fn components(
        &mut self,
        path: &str,
        components: &Components,
        (field, direction): (&str, Option<schema::Vector>),
    ) -> Option<[TimeFunction; 3]> {
        let item = path.rsplit_once('.').map_or(path, |(item, _)| item);
        match (components, direction) {
            (Components::Along(motion), Some(direction)) => {
                let along: Vec3 = self.direction(&format!("{item}.{field}"), direction)?;
                let [x, y, z] = along.map(|c| self.motion(path, motion, c));
                Some([x?, y?, z?])
            }
            (Components::Along(_), None) => {
                let message =
                    format!("`{item}` has no `{field}` for the one number or function of `{path}`");
                let help = format!("give `{field}`, or write `{path}` as a list of components");
                self.refuse(Code::MissingField, format!("{item}.{field}"), message, &help);
                None
            }
            (_, Some(_)) => {
                let message = format!("`{item}` has components in `{path}`, yet has `{field}`");
                let at = format!("{item}.{field}");
                self.refuse(Code::ConflictingFields, at, message, "leave one of them out");
                None
            }
            (Components::Planar([x, y]), None) => {
                let x = self.motion(&format!("{path}[0]"), x, 1.0);
                let y = self.motion(&format!("{path}[1]"), y, 1.0);
                Some([x?, y?, TimeFunction::Constant(0.0)])
            }
            (Components::Spatial(list), None) => {
                let mut entry = |i: usize| self.motion(&format!("{path}[{i}]"), &list[i], 1.0);
                let [x, y, z] = [entry(0), entry(1), entry(2)];
                Some([x?, y?, z?])
            }
        }
    }

    /// Roads are checked whether they are used or not.
    fn roads(&mut self) {
        let file = self.file;
        for (name, road) in &file.roads {
            let (field, value) = match road {
                schema::Road::Flat(_) => continue,
                schema::Road::SmoothBump(r) => ("half_length", r.half_length),
                schema::Road::HalfCylinder(r) => ("radius", r.radius),
            };
            if value <= 0.0 {
                let path = format!("roads.{name}.{field}");
                let message = format!("`{path}` is {} m; expected a positive number", shown(value));
                self.refuse(Code::OutOfRange, path, message, "");
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
