//! What bodies look like.

use std::sync::Arc;

use crate::math::{OpenEdge, Solid};

/// A shape fixed in a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// Name, unique in its body.
    pub name: String,
    /// Kind and its own numbers.
    pub kind: ShapeKind,
    /// Its middle (of a surface its origin), m, body axes, from the body origin.
    pub position: [f64; 3],
    /// Columns are its own axes in body axes: `axes[row][column]`.
    pub axes: [[f64; 3]; 3],
    /// Red, green, blue; `None` is the body's own.
    pub color: Option<[u8; 3]>,
    /// From 0 to 1.
    pub opacity: f64,
}

/// Kinds of shapes.
#[derive(Debug, Clone, PartialEq)]
pub enum ShapeKind {
    /// A box.
    Box {
        /// Edges, m.
        size: [f64; 3],
    },
    /// A cylinder along its own z.
    Cylinder {
        /// m.
        radius: f64,
        /// m.
        length: f64,
    },
    /// A ball.
    Sphere {
        /// m.
        radius: f64,
    },
    /// A cylinder along its own z with half a ball at either end.
    Capsule {
        /// m.
        radius: f64,
        /// Of the cylinder, m.
        length: f64,
    },
    /// Triangles.
    Mesh(Arc<Surface>),
}

/// A surface of triangles.
#[derive(Debug, Clone, PartialEq)]
pub struct Surface {
    /// m, axes of the shape.
    pub vertices: Vec<[f64; 3]>,
    /// Indices of the corners of each triangle.
    pub faces: Vec<[usize; 3]>,
}

impl Shape {
    /// Volume, centroid and second moments in body axes, from the body origin.
    ///
    /// # Errors
    /// An edge at which a surface is not closed.
    pub fn solid(&self) -> Result<Solid, OpenEdge> {
        let own = match &self.kind {
            ShapeKind::Box { size } => Solid::cuboid(*size),
            ShapeKind::Cylinder { radius, length } => Solid::cylinder(*radius, *length),
            ShapeKind::Sphere { radius } => Solid::sphere(*radius),
            ShapeKind::Capsule { radius, length } => Solid::capsule(*radius, *length),
            ShapeKind::Mesh(surface) => Solid::enclosed(&surface.vertices, &surface.faces)?,
        };
        Ok(own.placed(&self.axes, self.position))
    }
}
