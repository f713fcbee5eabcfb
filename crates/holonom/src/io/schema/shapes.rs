//! Shapes of bodies.

use schemars::JsonSchema;
use serde::Deserialize;

use super::{AxisAngle, EulerAngles, Vector, item};

/// What a body looks like in pictures, placed in body axes. Where shapes have a `density`, mass, centre of mass
/// and inertia of the body follow from these, and the body states none of them; where such shapes overlap, each
/// counts.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(title = "Shapes")]
pub(crate) enum Shape {
    Box(Cuboid),
    Cylinder(Cylinder),
    Sphere(Sphere),
    Capsule(Capsule),
    Mesh(Mesh),
}

/// How a shape is placed and what all shapes have.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Placing<'a> {
    pub(crate) position: Option<Vector>,
    pub(crate) angle: Option<f64>,
    pub(crate) level: f64,
    pub(crate) euler_parameters: Option<[f64; 4]>,
    pub(crate) axis_angle: Option<AxisAngle>,
    pub(crate) yaw_pitch_roll: Option<[f64; 3]>,
    pub(crate) euler_angles: Option<EulerAngles>,
    pub(crate) density: Option<f64>,
    pub(crate) color: Option<&'a str>,
    pub(crate) opacity: f64,
}

fn one() -> f64 {
    1.0
}

/// Adds the fields that every shape has.
macro_rules! shape {
    ($(#[$meta:meta])* struct $name:ident { $($body:tt)* }) => {
        item! {
            $(#[$meta])*
            struct $name {
                $($body)*
                /// Middle of the shape, body axes; of a mesh its own origin. Default: the body origin.
                #[schemars(extend("x-unit" = "m"))]
                pub(crate) position: Option<Vector>,
                /// Turn of the shape about z, from the body axes.
                #[schemars(extend("x-unit" = "rad", "x-dimension" = "planar"))]
                pub(crate) angle: Option<f64>,
                /// Middle of the shape along z: what lies before what in pictures.
                #[serde(default)]
                #[schemars(extend("x-unit" = "m", "x-dimension" = "planar"))]
                pub(crate) level: f64,
                /// Turn of the shape from the body axes: Euler parameters of unit length.
                #[schemars(extend("x-dimension" = "spatial"))]
                pub(crate) euler_parameters: Option<[f64; 4]>,
                /// Instead of `euler_parameters`: the turn about one axis, body axes.
                #[schemars(extend("x-dimension" = "spatial"))]
                pub(crate) axis_angle: Option<AxisAngle>,
                /// Instead of `euler_parameters`: yaw about z, then pitch about the turned y axis, then roll
                /// about the turned x axis.
                #[schemars(extend("x-unit" = "rad", "x-dimension" = "spatial"))]
                pub(crate) yaw_pitch_roll: Option<[f64; 3]>,
                /// Instead of `euler_parameters`: three turns about axes of the shape, one after the other.
                #[schemars(extend("x-dimension" = "spatial"))]
                pub(crate) euler_angles: Option<EulerAngles>,
                /// Density, positive: the body's mass, centre of mass and inertia follow from it. Default: the
                /// shape has no part in them.
                #[schemars(extend("x-unit" = "kg/m³"))]
                pub(crate) density: Option<f64>,
                /// Colour in pictures, `"#rrggbb"`. Default: that of the body.
                pub(crate) color: Option<String>,
                /// From 0, not seen at all, to 1.
                #[serde(default = "one")]
                pub(crate) opacity: f64,
            }
        }

        impl $name {
            fn placing(&self) -> Placing<'_> {
                Placing {
                    position: self.position,
                    angle: self.angle,
                    level: self.level,
                    euler_parameters: self.euler_parameters,
                    axis_angle: self.axis_angle,
                    yaw_pitch_roll: self.yaw_pitch_roll,
                    euler_angles: self.euler_angles,
                    density: self.density,
                    color: self.color.as_deref(),
                    opacity: self.opacity,
                }
            }
        }
    };
}

shape! {
    /// A box.
    struct Cuboid {
        /// Edges along its own x, y and z, positive; of planar models, too.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) size: [f64; 3],
    }
}

shape! {
    /// A circular cylinder along its own z. Give `length`, or `points_in_body`.
    struct Cylinder {
        /// Radius, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) radius: f64,
        /// Length, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) length: Option<f64>,
        /// Instead of `length`, position and turn: the middles of its two ends, body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
    }
}

shape! {
    /// A ball.
    struct Sphere {
        /// Radius, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) radius: f64,
    }
}

shape! {
    /// A cylinder along its own z with half a ball at either end. Give `length`, or `points_in_body`.
    struct Capsule {
        /// Radius, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) radius: f64,
        /// Length of the cylinder, between the centres of the balls, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) length: Option<f64>,
        /// Instead of `length`, position and turn: the centres of its two balls, body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
    }
}

shape! {
    /// A surface of triangles. Give `file`, or `vertices` and `faces`, which take its place in the model that was
    /// read. A mesh with a density is closed: every edge belongs to two triangles of one orientation.
    struct Mesh {
        /// Path, relative to this file, of an STL file, binary or text. Its numbers are in this file's
        /// unit of length.
        pub(crate) file: Option<String>,
        /// Points.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) vertices: Option<Vec<[f64; 3]>>,
        /// Triangles by their points, counted from 0; seen from outside they run counter-clockwise.
        pub(crate) faces: Option<Vec<[u32; 3]>>,
        /// Factor of all points, positive.
        #[serde(default = "one")]
        pub(crate) scale: f64,
    }
}

impl Shape {
    pub(crate) fn placing(&self) -> Placing<'_> {
        match self {
            Self::Box(shape) => shape.placing(),
            Self::Cylinder(shape) => shape.placing(),
            Self::Sphere(shape) => shape.placing(),
            Self::Capsule(shape) => shape.placing(),
            Self::Mesh(shape) => shape.placing(),
        }
    }
}
