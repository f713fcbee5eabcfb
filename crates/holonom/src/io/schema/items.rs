//! Parameters, bodies, joints, drivers and the initial state.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::{Motion, Place, Rotational, Shape, Vector, item};

/// A number with a name.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[allow(dead_code, reason = "values are put in place while the file is checked")]
#[schemars(title = "Parameters")]
pub(crate) struct Parameter {
    /// The number, in the unit of the fields that use it; as an expression it may use other parameters.
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
        /// Mass; zero is allowed where the other bodies give the motion a mass. Left out where `shapes` have a
        /// density.
        #[schemars(extend("x-unit" = "kg", "x-unless" = "shapes"))]
        pub(crate) mass: Option<f64>,
        /// Inertia about the centre of mass: spatial models the full tensor in body axes
        /// (off-diagonal entries are minus the products of inertia), planar models the moment about z. Left out
        /// where `shapes` have a density.
        #[schemars(extend("x-unit" = "kg m²", "x-unless" = "shapes"))]
        pub(crate) inertia: Option<Inertia>,
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
        /// Instead of `euler_parameters`: the turn about one axis.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axis_angle: Option<AxisAngle>,
        /// Instead of `euler_parameters`: yaw about z, then pitch about the turned y axis, then roll
        /// about the turned x axis.
        #[schemars(extend("x-unit" = "rad", "x-dimension" = "spatial"))]
        pub(crate) yaw_pitch_roll: Option<[f64; 3]>,
        /// Instead of `euler_parameters`: three turns about body axes, one after the other.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) euler_angles: Option<EulerAngles>,
        /// Centre of mass from the body origin, body axes. Default: the body origin.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) center_of_mass: Option<Vector>,
        /// Named points of the body, used as `"body.marker"` wherever a point is asked for.
        #[serde(default)]
        pub(crate) markers: IndexMap<String, Marker>,
        /// What the body looks like, by names that are its own. Default: drawn from its joints and points.
        #[serde(default)]
        pub(crate) shapes: IndexMap<String, Shape>,
    }
}

/// A turn about one axis.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Axis and angle")]
pub(crate) struct AxisAngle {
    /// The axis, ground axes (the same numbers in body axes); any length but zero.
    pub(crate) axis: [f64; 3],
    /// The turn, right-handed about the axis.
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) angle: f64,
}

/// Three turns, each about an axis of the body as the turns before have left it.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Euler angles")]
pub(crate) struct EulerAngles {
    /// The axes in the order of the turns. About axes of the ground the order is the reverse.
    pub(crate) sequence: Sequence,
    /// The turns in the same order.
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) angles: [f64; 3],
}

/// Axes of three turns, no two neighbours alike.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Sequence {
    Xyz,
    Xzy,
    Yxz,
    Yzx,
    Zxy,
    Zyx,
    Xyx,
    Xzx,
    Yxy,
    Yzy,
    Zxz,
    Zyz,
}

impl Sequence {
    /// x, y, z as 0, 1, 2.
    pub(crate) fn axes(self) -> [usize; 3] {
        match self {
            Self::Xyz => [0, 1, 2],
            Self::Xzy => [0, 2, 1],
            Self::Yxz => [1, 0, 2],
            Self::Yzx => [1, 2, 0],
            Self::Zxy => [2, 0, 1],
            Self::Zyx => [2, 1, 0],
            Self::Xyx => [0, 1, 0],
            Self::Xzx => [0, 2, 0],
            Self::Yxy => [1, 0, 1],
            Self::Yzy => [1, 2, 1],
            Self::Zxz => [2, 0, 2],
            Self::Zyz => [2, 1, 2],
        }
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
        /// What is prescribed: a displacement along an axis (m) or an angle about it (rad), in spatial models
        /// the [twist](#rules).
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
        #[schemars(extend("x-unit" = "m or rad", "x-unit-by" = "coordinate"))]
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
    /// Stated coordinates of single joints, by name.
    #[serde(default)]
    pub(crate) joints: IndexMap<String, InitialJoint>,
    /// Extra states by the name of their force: extension of the spring of a Maxwell element, m, or of those of the
    /// branches of a bushing, by their names. Default: the force is zero.
    #[serde(default)]
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) extra_states: IndexMap<String, ExtraState>,
}

/// Extension of a spring, or of the springs of branches by name.
#[derive(Debug, Clone, Deserialize, Serialize, JsonSchema)]
#[serde(untagged)]
pub(crate) enum ExtraState {
    Spring(f64),
    Branches(IndexMap<String, InitialBranch>),
}

/// Stated extra states of one branch of a bushing. Where it has no spring they are zero.
#[derive(Debug, Clone, Copy, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Initial branches")]
pub(crate) struct InitialBranch {
    /// Extension of the springs along the three axes. Default: zero.
    #[serde(default)]
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) extension: [f64; 3],
    /// Rotation of the springs about the three axes. Default: zero.
    #[serde(default)]
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) rotation: [f64; 3],
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
    /// Instead of `euler_parameters`: the turn about one axis.
    #[schemars(extend("x-dimension" = "spatial"))]
    pub(crate) axis_angle: Option<AxisAngle>,
    /// Instead of `euler_parameters`: yaw about z, then pitch about the turned y axis, then roll about
    /// the turned x axis.
    #[schemars(extend("x-unit" = "rad", "x-dimension" = "spatial"))]
    pub(crate) yaw_pitch_roll: Option<[f64; 3]>,
    /// Instead of `euler_parameters`: three turns about body axes, one after the other.
    #[schemars(extend("x-dimension" = "spatial"))]
    pub(crate) euler_angles: Option<EulerAngles>,
    /// Velocity of the body origin, ground axes.
    #[schemars(extend("x-unit" = "m/s"))]
    pub(crate) velocity: Option<Vector>,
    /// Angular velocity, ground axes.
    #[schemars(extend("x-unit" = "rad/s"))]
    pub(crate) angular_velocity: Option<Rotational>,
}

/// Stated relative coordinates of one joint and their rates, of the second body relative to the first.
/// They are measured as the joint's channels are. Bodies further out are carried along.
#[derive(Debug, Clone, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Initial state of a joint")]
pub(crate) struct InitialJoint {
    /// Angle of a revolute or cylindrical joint; whole turns count.
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) angle: Option<f64>,
    /// Rate of that angle.
    #[schemars(extend("x-unit" = "rad/s"))]
    pub(crate) angular_velocity: Option<f64>,
    /// Displacement of a translational or cylindrical joint.
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) displacement: Option<f64>,
    /// Rate of that displacement.
    #[schemars(extend("x-unit" = "m/s"))]
    pub(crate) velocity: Option<f64>,
    /// Angles of a universal joint, about its first and about its second axis; zero in the design
    /// configuration.
    #[schemars(extend("x-unit" = "rad", "x-dimension" = "spatial"))]
    pub(crate) angles: Option<[f64; 2]>,
    /// Rates of these angles.
    #[schemars(extend("x-unit" = "rad/s", "x-dimension" = "spatial"))]
    pub(crate) angular_velocities: Option<[f64; 2]>,
}
