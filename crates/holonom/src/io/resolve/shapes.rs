//! Shapes of bodies, and mass, centre of mass and inertia where they have a density.

use std::sync::Arc;

use super::geometry::{
    IDENTITY, Mat3, Vec3, distance, planar_rotation, spatial_rotation, triad, unit,
};
use super::orientations::Turned;
use crate::error::{Code, Diagnostic, Severity, shown};
use crate::io::limits;
use crate::io::schema::{self, Dimension, Inertia, Placing, Vector};
use crate::math::Solid;
use crate::model::{Shape, ShapeKind, Surface};

/// Mass (kg), centre of mass (m, body axes) and inertia about it (kg m², body axes).
pub(super) struct Weight {
    pub(super) mass: f64,
    pub(super) center_of_mass: Vec3,
    pub(super) inertia: Mat3,
}

/// The shapes of a body, without those that have errors.
pub(super) fn shapes(
    name: &str,
    body: &schema::Body,
    dimension: Dimension,
    errors: &mut Vec<Diagnostic>,
) -> Vec<Shape> {
    let mut out = Vec::with_capacity(body.shapes.len());
    for (own, shape) in &body.shapes {
        let item = format!("bodies.{name}.shapes.{own}");
        out.extend(Reader { item: &item, dimension, errors }.shape(own, shape));
    }
    out
}

/// What the body weighs: as it states, or by the density of its shapes.
pub(super) fn weight(
    name: &str,
    body: &schema::Body,
    shapes: &[Shape],
    dimension: Dimension,
    errors: &mut Vec<Diagnostic>,
) -> Weight {
    let item = format!("bodies.{name}");
    let dense = || body.shapes.iter().filter_map(|(own, s)| Some((own, s.placing().density?)));
    let stated = [
        ("mass", body.mass.is_some()),
        ("inertia", body.inertia.is_some()),
        ("center_of_mass", body.center_of_mass.is_some()),
    ];
    if let Some((first, _)) = dense().next() {
        for (field, _) in stated.iter().filter(|(_, stated)| *stated) {
            let path = format!("{item}.{field}");
            let message = format!("`{path}` is stated, and the shape `{first}` has a density");
            let error = Diagnostic::new(Code::ConflictingFields, path, message);
            errors.push(error.help(
                "mass, centre of mass and inertia follow from the shapes: leave it out, or the densities",
            ));
        }
        return by_density(&item, dense(), shapes, dimension, errors);
    }
    for (field, _) in stated.iter().take(2).filter(|(_, stated)| !stated) {
        let message = format!("`{item}` has no `{field}`, and no shape of it has a `density`");
        let error = Diagnostic::new(Code::MissingField, format!("{item}.{field}"), message);
        errors.push(error.help("state it, or the density of the shapes, from which it follows"));
    }
    Weight {
        mass: body.mass.unwrap_or_default(),
        center_of_mass: body.center_of_mass.map_or([0.0; 3], Vector::components),
        inertia: match body.inertia {
            Some(Inertia::Planar(j)) => [[0.0; 3], [0.0; 3], [0.0, 0.0, j]],
            Some(Inertia::Spatial(tensor)) => tensor,
            None => [[0.0; 3]; 3],
        },
    }
}

fn by_density<'a>(
    item: &str,
    dense: impl Iterator<Item = (&'a String, f64)>,
    shapes: &[Shape],
    dimension: Dimension,
    errors: &mut Vec<Diagnostic>,
) -> Weight {
    let mut whole = Solid::default();
    for (own, density) in dense {
        let path = format!("{item}.shapes.{own}.density");
        if !(density.is_finite() && density > 0.0) {
            let message =
                format!("`{path}` is {} kg/m³; expected a positive number", shown(density));
            errors.push(Diagnostic::new(Code::OutOfRange, path, message));
            continue;
        }
        let Some(shape) = shapes.iter().find(|shape| shape.name == *own) else { continue };
        match shape.solid() {
            Ok(solid) if solid.volume > 0.0 => whole = whole.with(&solid.times(density)),
            // Sizes that are not positive are reported as such.
            Ok(_) if !matches!(shape.kind, ShapeKind::Mesh(_)) => {}
            Ok(_) => {
                let message =
                    format!("`{item}.shapes.{own}` encloses no volume; it cannot have a density");
                errors.push(Diagnostic::new(Code::Mesh, path, message));
            }
            Err(open) => {
                let ShapeKind::Mesh(surface) = &shape.kind else { continue };
                let [a, b] = open.ends.map(|i| surface.vertices[i].map(shown).join(", "));
                let [forth, back] = open.triangles;
                let message = format!(
                    "`{item}.shapes.{own}` is not closed: along the edge from ({a}) to ({b}) lie \
                     {forth} triangles of one orientation and {back} of the other"
                );
                let error = Diagnostic::new(Code::Mesh, path, message).help(
                    "close the surface, or leave `density` out and state mass and inertia of the body",
                );
                errors.push(error);
            }
        }
    }
    let [x, y, z] = whole.centroid;
    let inertia = whole.inertia();
    match dimension {
        Dimension::Planar => Weight {
            mass: whole.volume,
            center_of_mass: [x, y, 0.0],
            inertia: [[0.0; 3], [0.0; 3], [0.0, 0.0, inertia[2][2]]],
        },
        Dimension::Spatial => Weight { mass: whole.volume, center_of_mass: [x, y, z], inertia },
    }
}

struct Reader<'a> {
    item: &'a str,
    dimension: Dimension,
    errors: &'a mut Vec<Diagnostic>,
}

impl Reader<'_> {
    fn refuse(&mut self, code: Code, field: &str, message: String, help: &str) {
        let path = format!("{}.{field}", self.item);
        self.errors.push(Diagnostic::new(code, path, message).help(help));
    }

    fn shape(&mut self, name: &str, shape: &schema::Shape) -> Option<Shape> {
        let placing = shape.placing();
        let (position, axes) = self.place(&placing)?;
        let color = match placing.color {
            None => None,
            Some(text) => Some(self.color(text)?),
        };
        let (kind, position, axes) = match shape {
            schema::Shape::Box(one) => (ShapeKind::Box { size: one.size }, position, axes),
            schema::Shape::Sphere(one) => {
                (ShapeKind::Sphere { radius: one.radius }, position, axes)
            }
            schema::Shape::Cylinder(one) => {
                let long = self.long(&placing, one.length, one.points_in_body.as_ref())?;
                let (length, position, axes) = long.unwrap_or((0.0, position, axes));
                let length = one.length.unwrap_or(length);
                (ShapeKind::Cylinder { radius: one.radius, length }, position, axes)
            }
            schema::Shape::Capsule(one) => {
                let long = self.long(&placing, one.length, one.points_in_body.as_ref())?;
                let (length, position, axes) = long.unwrap_or((0.0, position, axes));
                let length = one.length.unwrap_or(length);
                (ShapeKind::Capsule { radius: one.radius, length }, position, axes)
            }
            schema::Shape::Mesh(one) => {
                (ShapeKind::Mesh(Arc::new(self.surface(one)?)), position, axes)
            }
        };
        Some(Shape { name: name.to_owned(), kind, position, axes, color, opacity: placing.opacity })
    }

    /// Position and axes as stated.
    fn place(&mut self, placing: &Placing<'_>) -> Option<(Vec3, Mat3)> {
        let mut position = placing.position.map_or([0.0; 3], Vector::components);
        if self.dimension == Dimension::Planar {
            position[2] = placing.level;
            return Some((position, placing.angle.map_or(IDENTITY, planar_rotation)));
        }
        let before = self.errors.len();
        let p = Turned::of_shape(placing).euler_parameters(self.item, self.errors);
        let is_error = |found: &Diagnostic| found.code.severity() == Severity::Error;
        if self.errors[before..].iter().any(is_error) {
            return None;
        }
        Some((position, p.map_or(IDENTITY, spatial_rotation)))
    }

    /// Length, middle and axes of what lies between two points, if they are stated; `None` where something
    /// is wrong.
    #[allow(clippy::option_option, reason = "stated or not, and right or wrong")]
    fn long(
        &mut self,
        placing: &Placing<'_>,
        length: Option<f64>,
        points: Option<&[Vector; 2]>,
    ) -> Option<Option<(f64, Vec3, Mat3)>> {
        let Some(points) = points else {
            if length.is_some() {
                return Some(None);
            }
            let message = format!("`{}` has no `length`", self.item);
            let help = "give `length`, or `points_in_body` in its place";
            self.refuse(Code::MissingField, "length", message, help);
            return None;
        };
        let also = [
            ("length", length.is_some()),
            ("position", placing.position.is_some()),
            ("angle", placing.angle.is_some()),
            ("euler_parameters", placing.euler_parameters.is_some()),
            ("axis_angle", placing.axis_angle.is_some()),
            ("yaw_pitch_roll", placing.yaw_pitch_roll.is_some()),
            ("euler_angles", placing.euler_angles.is_some()),
        ];
        if let Some((field, _)) = also.into_iter().find(|(_, stated)| *stated) {
            let message = format!("`{}` has both `points_in_body` and `{field}`", self.item);
            self.refuse(Code::ConflictingFields, field, message, "leave one of them out");
            return None;
        }
        let [a, b] = points.map(Vector::components);
        let Some(along) = unit([0, 1, 2].map(|k| b[k] - a[k])) else {
            let message = format!("the two points of `{}` coincide", self.item);
            self.refuse(Code::CoincidentPoints, "points_in_body", message, "");
            return None;
        };
        let mut middle = [0, 1, 2].map(|k| 0.5 * (a[k] + b[k]));
        middle[2] += placing.level;
        Some(Some((distance(a, b), middle, triad(along, [0.0, 0.0, 1.0]))))
    }

    fn color(&mut self, text: &str) -> Option<[u8; 3]> {
        let digits = text.strip_prefix('#').filter(|d| d.len() == 6 && d.is_ascii());
        let part = |k: usize| u8::from_str_radix(digits?.get(2 * k..2 * k + 2)?, 16).ok();
        let color = (part(0), part(1), part(2));
        if let (Some(red), Some(green), Some(blue)) = color
            && !text.contains('+')
        {
            return Some([red, green, blue]);
        }
        let shown: String = text.chars().take(40).collect();
        let message = format!("`{}.color` is {shown:?}; expected \"#rrggbb\"", self.item);
        self.refuse(Code::OutOfRange, "color", message, "write it like \"#8797a5\"");
        None
    }

    fn surface(&mut self, mesh: &schema::Mesh) -> Option<Surface> {
        let item = self.item;
        if mesh.file.is_some() {
            let (message, help) = if mesh.vertices.is_some() || mesh.faces.is_some() {
                (format!("`{item}` has both `file` and `vertices`"), "leave one of them out")
            } else {
                // It was set by path, or a pattern makes its name: only plain names are read.
                let help = "write the name of the file plainly, beside the body";
                (format!("`{item}.file` was not read"), help)
            };
            self.refuse(Code::Mesh, "file", message, help);
            return None;
        }
        let (Some(vertices), Some(faces)) = (&mesh.vertices, &mesh.faces) else {
            let message = format!("`{item}` has no `file`");
            let help = "give `file`, or `vertices` and `faces` in its place";
            self.refuse(Code::MissingField, "file", message, help);
            return None;
        };
        if faces.len() > limits::MESH_TRIANGLES {
            let (count, most) = (faces.len(), limits::MESH_TRIANGLES);
            let message = format!("`{item}` has {count} triangles; at most {most} are accepted");
            let help = "a coarser mesh serves for pictures, and for inertia, too";
            self.refuse(Code::TooLarge, "faces", message, help);
            return None;
        }
        if !(mesh.scale.is_finite() && mesh.scale > 0.0) {
            let message =
                format!("`{item}.scale` is {}; expected a positive number", shown(mesh.scale));
            self.refuse(Code::OutOfRange, "scale", message, "");
            return None;
        }
        let beyond = |face: &[u32; 3]| face.iter().any(|&i| i as usize >= vertices.len());
        if let Some(k) = faces.iter().position(beyond) {
            let message = format!(
                "`{item}.faces[{k}]` names a point beyond the {} there are",
                vertices.len()
            );
            self.refuse(Code::Mesh, &format!("faces[{k}]"), message, "points are counted from 0");
            return None;
        }
        Some(Surface {
            vertices: vertices.iter().map(|v| v.map(|x| mesh.scale * x)).collect(),
            faces: faces.iter().map(|face| face.map(|i| i as usize)).collect(),
        })
    }
}
