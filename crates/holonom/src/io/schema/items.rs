//! Parameters, bodies, joints, drivers, initial state, outputs and run defaults.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Motion, Place, Rotational, Vector, item};

/// A number with a name.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, reason = "values are put in place while the file is checked")]
#[schemars(title = "Parameters")]
pub(crate) struct Parameter {
    /// The number, in the unit of the fields that use it.
    pub(crate) value: f64,
    /// Unit, for readers.
    pub(crate) unit: Option<String>,
    /// Text for people: what it is, where its value comes from.
    pub(crate) title: Option<String>,
}

item! {
    /// A rigid body. Its frame (origin and axes) is yours to choose; the pose stated here is the
    /// design configuration.
    #[schemars(title = "Bodies")]
    struct Body {
        /// Mass; zero is allowed where the other bodies give the motion a mass.
        #[schemars(extend("x-unit" = "kg"))]
        pub(crate) mass: f64,
        /// Inertia about the centre of mass: spatial models the full tensor in body axes
        /// (off-diagonal entries are minus the products of inertia), planar models the moment about z.
        #[schemars(extend("x-unit" = "kg m²"))]
        pub(crate) inertia: Inertia,
        /// Body origin in the design configuration, ground axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) position: Vector,
        /// Angle of the body's x axis from the ground's in the design configuration; not reduced
        /// modulo a turn.
        #[serde(default)]
        #[schemars(extend("x-unit" = "rad", "x-dimension" = "planar"))]
        pub(crate) angle: f64,
        /// Euler parameters e0, e1, e2, e3 of the body axes in the design configuration, of unit
        /// length. Default: body axes parallel to ground axes.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) euler_parameters: Option<[f64; 4]>,
        /// Centre of mass from the body origin, body axes. Default: the body origin.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) center_of_mass: Option<Vector>,
        /// Named points of the body, used as `"body.marker"` wherever a point is asked for.
        #[serde(default)]
        pub(crate) markers: IndexMap<String, Marker>,
    }
}

/// A named point of a body; give one of the two fields.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Markers")]
pub(crate) struct Marker {
    /// The point in the design configuration, ground axes.
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) point: Option<Vector>,
    /// The point in body axes, from the body origin.
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) point_in_body: Option<Vector>,
}

/// Moment of inertia about z, or the inertia tensor.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum Inertia {
    #[schemars(extend("x-dimension" = "planar"))]
    Planar(f64),
    #[schemars(extend("x-dimension" = "spatial"))]
    Spatial([[f64; 3]; 3]),
}

/// A joint has a `type` and the fields of that type.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(title = "Joints")]
pub(crate) enum Joint {
    /// The second body keeps its design pose relative to the first.
    Fixed(PointJoint),
    Revolute(Revolute),
    /// The second body slides along the axis and does not turn. The relative displacement is that of
    /// the second point from the first along the axis.
    Translational(AxisJoint),
    /// The second body slides along the axis and turns about it. The relative displacement is that of
    /// the second point from the first along the axis, the relative angle is zero in the design
    /// configuration.
    #[schemars(extend("x-dimension" = "spatial"))]
    Cylindrical(AxisJoint),
    #[schemars(extend("x-dimension" = "spatial"))]
    Universal(Universal),
    /// The two bodies share a point and turn freely about it.
    #[schemars(extend("x-dimension" = "spatial"))]
    Spherical(PointJoint),
    Distance(Distance),
}

item! {
    /// A joint at a point.
    struct PointJoint {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Where the joint is, ground axes in the design configuration, or a marker of one of the two
        /// bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the joint's point on the first and on the second body, each in its own
        /// body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
    }
}

item! {
    /// The two bodies share a point and an axis and turn about it (planar: about z). The relative
    /// angle is that of the second body from the first: in planar models the difference of the body
    /// angles, in spatial models zero in the design configuration.
    struct Revolute {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Where the joint is, ground axes in the design configuration, or a marker of one of the two
        /// bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the joint's point on the first and on the second body, each in its own
        /// body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Direction of the axis, ground axes in the design configuration; any length but zero.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axis: Option<Vector>,
        /// Instead of `axis`: the axis on the first and on the second body, each in its own body axes.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axes_in_body: Option<[Vector; 2]>,
    }
}

item! {
    /// A joint along an axis.
    struct AxisJoint {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Where the joint is, ground axes in the design configuration, or a marker of one of the two
        /// bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the joint's point on the first and on the second body, each in its own
        /// body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Direction of the axis, ground axes in the design configuration; any length but zero.
        pub(crate) axis: Option<Vector>,
        /// Instead of `axis`: the axis on the first and on the second body, each in its own body axes.
        pub(crate) axes_in_body: Option<[Vector; 2]>,
    }
}

item! {
    /// The two bodies share a point; an axis of the first stays perpendicular to an axis of the
    /// second (a cardan joint).
    struct Universal {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Where the joint is, ground axes in the design configuration, or a marker of one of the two
        /// bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the joint's point on the first and on the second body, each in its own
        /// body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Axis fixed in the first body and axis fixed in the second, perpendicular, ground axes in
        /// the design configuration; any length but zero.
        pub(crate) axes: Option<[Vector; 2]>,
        /// Instead of `axes`: the same two axes, each in its own body axes.
        pub(crate) axes_in_body: Option<[Vector; 2]>,
    }
}

item! {
    /// A point of the first and a point of the second body keep their distance (a massless rod with
    /// balls at its ends).
    struct Distance {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Point on the first and point on the second body, ground axes in the design configuration,
        /// or markers of these bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points: Option<[Place; 2]>,
        /// Instead of `points`: the same two points, each in its own body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// The distance, positive. Default: as in the design configuration.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) length: Option<f64>,
    }
}

item! {
    /// A displacement or an angle that follows a function of time. Give `joint`, or `between` or `on`
    /// with the geometry.
    #[schemars(title = "Drivers")]
    struct Driver {
        /// What is prescribed: a displacement along an axis (m) or an angle about it (rad).
        pub(crate) coordinate: Coordinate,
        /// A joint whose relative displacement or angle is prescribed.
        pub(crate) joint: Option<String>,
        /// Instead of `joint`: first and second body; the motion is that of the second relative to
        /// the first.
        pub(crate) between: Option<[String; 2]>,
        /// Instead of `joint`: the body that is driven relative to the ground.
        pub(crate) on: Option<String>,
        /// Point of a translation, ground axes in the design configuration, or a marker: where the
        /// displacement is zero.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the point on the first and on the second body, each in its own body
        /// axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Direction of a translation, or axis of a spatial rotation, fixed in the first body, ground
        /// axes in the design configuration. Planar rotations are about z and take none.
        pub(crate) axis: Option<Vector>,
        /// Instead of `axis`: the axis on the first and on the second body, each in its own body axes.
        pub(crate) axes_in_body: Option<[Vector; 2]>,
        /// The prescribed displacement (m, from the first point to the second along the axis) or
        /// angle (rad; spatial: zero in the design configuration, planar: difference of the body
        /// angles).
        pub(crate) motion: Motion,
    }
}

/// What a driver prescribes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Coordinate {
    Translation,
    Rotation,
}

/// State at the start. Stated values are kept (or refused when they contradict the joints); values
/// that are not stated follow from the joints with least change from the design configuration.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Initial state")]
pub(crate) struct Initial {
    /// `keep`: a stated value that violates a joint by more than 1e-6 is refused. `adjust`: stated
    /// values are guesses and may move.
    #[serde(default)]
    pub(crate) assembly: Assembly,
    /// Velocity of every body origin, ground axes, unless `bodies` says otherwise.
    #[schemars(extend("x-unit" = "m/s"))]
    pub(crate) velocity: Option<Vector>,
    /// Angular velocity of every body, ground axes, unless `bodies` says otherwise.
    #[schemars(extend("x-unit" = "rad/s"))]
    pub(crate) angular_velocity: Option<Rotational>,
    /// Stated values of single bodies, by name.
    #[serde(default)]
    pub(crate) bodies: IndexMap<String, InitialBody>,
    /// Extra states by the name of their force: extension of the spring of a Maxwell element, m.
    /// Default: the force is zero.
    #[serde(default)]
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) extra_states: IndexMap<String, f64>,
}

/// How stated initial values are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Assembly {
    #[default]
    Keep,
    Adjust,
}

/// Stated initial values of one body.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Initial state of a body")]
pub(crate) struct InitialBody {
    /// Body origin, ground axes.
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) position: Option<Vector>,
    /// Body angle.
    #[schemars(extend("x-unit" = "rad", "x-dimension" = "planar"))]
    pub(crate) angle: Option<f64>,
    /// Euler parameters e0, e1, e2, e3 of unit length.
    #[schemars(extend("x-dimension" = "spatial"))]
    pub(crate) euler_parameters: Option<[f64; 4]>,
    /// Velocity of the body origin, ground axes.
    #[schemars(extend("x-unit" = "m/s"))]
    pub(crate) velocity: Option<Vector>,
    /// Angular velocity, ground axes.
    #[schemars(extend("x-unit" = "rad/s"))]
    pub(crate) angular_velocity: Option<Rotational>,
}

/// What a run writes.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Outputs")]
pub(crate) struct Outputs {
    /// Channels `item.quantity`; `item.*` stands for all quantities of the item.
    #[serde(default)]
    pub(crate) channels: Vec<String>,
    /// Time between two outputs, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) interval: Option<f64>,
}

/// Defaults of a run; flags of the command and arguments of the call come before them.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Run defaults")]
pub(crate) struct Simulation {
    /// Start. Default: 0.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) start_time: Option<f64>,
    /// End, not before the start.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) end_time: Option<f64>,
    /// One number for all parts, or the parts.
    pub(crate) tolerance: Option<Tolerance>,
    /// Name of a code (`ForSDIRK`) or of a family of methods (`first_order`).
    pub(crate) method: Option<String>,
    /// Formula within a family of methods.
    pub(crate) formula: Option<String>,
    /// Step size of a run without step-size control, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) fixed_step: Option<f64>,
    /// Largest step size, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) max_step: Option<f64>,
    /// First step size, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) initial_step: Option<f64>,
    /// Largest number of steps.
    pub(crate) max_steps: Option<u64>,
    /// Largest wall time of a run with its assembly, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) max_seconds: Option<f64>,
    /// Growth of the condition number at which a partition or a tangent plane is chosen anew, above 1.
    pub(crate) repartition_factor: Option<f64>,
    /// Whether all that states between output times are made of is stored; by default where the code is
    /// implicit.
    pub(crate) dense_output: Option<bool>,
    /// What the independent variables are; unless stated tree, with the profile `thesis` partitioning.
    pub(crate) parametrization: Option<Parametrization>,
    /// Where the integration Jacobian comes from; analytic unless stated.
    pub(crate) jacobian: Option<JacobianSource>,
    /// How the integration Jacobian is represented; by predicted cost unless stated.
    pub(crate) newton: Option<Newton>,
    /// Where accelerations and multipliers come from; by predicted cost unless stated.
    pub(crate) accelerations: Option<Accelerations>,
    /// Choices that go with a code; improved unless stated.
    pub(crate) profile: Option<Profile>,
}

/// What the independent variables are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Parametrization {
    /// Relative coordinates of a spanning forest of the bodies.
    Tree,
    /// Some of the coordinates.
    Partitioning,
    /// Combinations of coordinates along the tangent plane of the constraints, by QR.
    TangentPlane,
    /// The same by singular values.
    TangentPlaneSvd,
}

impl Parametrization {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Tree => "tree",
            Self::Partitioning => "partitioning",
            Self::TangentPlane => "tangent_plane",
            Self::TangentPlaneSvd => "tangent_plane_svd",
        }
    }
}

/// Where the integration Jacobian comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum JacobianSource {
    /// Derivatives of the elements' equations.
    Analytic,
    /// Differences of accelerations; not for ForRosen.
    Differences,
}

impl JacobianSource {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Analytic => "analytic",
            Self::Differences => "differences",
        }
    }
}

/// How the integration Jacobian is represented.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Newton {
    /// By predicted cost.
    Auto,
    /// Of the independent variables alone.
    Dense,
    /// With the graph of the mechanism: its cost grows like the number of bodies.
    Sparse,
}

impl Newton {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Dense => "dense",
            Self::Sparse => "sparse",
        }
    }
}

/// Where accelerations and multipliers come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Accelerations {
    /// By predicted cost.
    Auto,
    /// From body to body along a tree; there are no loops.
    Recursive,
    /// A dense matrix of the independent variables alone.
    NullSpace,
    /// A matrix of the multipliers alone, by blocks of joints; every body needs mass and inertia.
    Reduced,
    /// A sparse matrix of accelerations and multipliers.
    Augmented,
}

impl Accelerations {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Recursive => "recursive",
            Self::NullSpace => "null_space",
            Self::Reduced => "reduced",
            Self::Augmented => "augmented",
        }
    }
}

/// Choices that go with a code.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Profile {
    /// Norm over all coordinates, filtered estimates, reuse of Jacobians.
    Improved,
    /// As in the thesis that the codes come from.
    Thesis,
}

impl Profile {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Improved => "improved",
            Self::Thesis => "thesis",
        }
    }
}

/// Tolerances of a run.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum Tolerance {
    Uniform(f64),
    Parts(ToleranceParts),
}

/// Tolerances by part.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Tolerances")]
pub(crate) struct ToleranceParts {
    /// Relative part: of the movement since the start (positions) or of the value (velocities).
    pub(crate) relative: f64,
    /// Absolute part of translations (m, m/s).
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) translation: f64,
    /// Absolute part of rotations (rad, rad/s).
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) rotation: f64,
}
