//! Force elements, applied forces and roads.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::Deserialize;

use super::{Motion, Place, Vector, item};

/// A force has a `type` and the fields of that type.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[allow(clippy::large_enum_variant, reason = "lives for the reading of a file only")]
#[schemars(title = "Forces")]
pub(crate) enum Force {
    Tsda(Tsda),
    Rsda(Rsda),
    Maxwell(Maxwell),
    #[schemars(extend("x-dimension" = "spatial"))]
    Bushing(Bushing),
    #[schemars(extend("x-dimension" = "spatial"))]
    Tyre(Tyre),
    PointForce(PointForce),
    Torque(Torque),
}

/// An elastic law through a table. Give `table`, or `x` and `y`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Elastic law")]
pub(crate) struct Law {
    /// Name of a table of the model.
    pub(crate) table: Option<String>,
    /// Extensions (m) or angles (rad) from the free value, increasing.
    #[schemars(extend("x-unit" = "abscissa of the field"))]
    pub(crate) x: Option<Vec<f64>>,
    /// Tension (N) or torque (N m) there.
    #[schemars(extend("x-unit" = "ordinate of the field"))]
    pub(crate) y: Option<Vec<f64>>,
}

item! {
    /// Translational spring and damper along the line of two points. Tension
    /// f = `stiffness` (l − `free_length`) + `damping` l̇, with l the length; or a law through a table
    /// in place of the stiffness.
    struct Tsda {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Point on the first and point on the second body, ground axes in the design configuration,
        /// or markers of these bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points: Option<[Place; 2]>,
        /// Instead of `points`: the same two points, each in its own body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Stiffness, not negative. Default: none.
        #[schemars(extend("x-unit" = "N/m"))]
        pub(crate) stiffness: Option<f64>,
        /// Instead of `stiffness`: tension (N) over extension l − `free_length` (m).
        #[schemars(extend("x-unit" = "N over m"))]
        pub(crate) force: Option<Law>,
        /// Damping, not negative. Default: none.
        #[schemars(extend("x-unit" = "N s/m"))]
        pub(crate) damping: Option<f64>,
        /// Length without elastic force, not negative; needed where there is a stiffness or a law.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) free_length: Option<f64>,
    }
}

item! {
    /// Rotational spring and damper. Torque on the second body
    /// −[`stiffness` (θ − `free_angle`) + `damping` θ̇], the opposite on the first. θ is the angle of
    /// the second body from the first and counts turns: in planar models the difference of the body
    /// angles (of the ground: 0), in spatial models the [twist about the axis](#rules), zero in the design configuration.
    struct Rsda {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Direction of the axis, ground axes in the design configuration; any length but zero.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axis: Option<Vector>,
        /// Instead of `axis`: the axis on the first and on the second body, each in its own body axes.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axes_in_body: Option<[Vector; 2]>,
        /// Stiffness, not negative. Default: none.
        #[schemars(extend("x-unit" = "N m/rad"))]
        pub(crate) stiffness: Option<f64>,
        /// Instead of `stiffness`: torque (N m) over θ − `free_angle` (rad).
        #[schemars(extend("x-unit" = "N m over rad"))]
        pub(crate) torque: Option<Law>,
        /// Damping, not negative. Default: none.
        #[schemars(extend("x-unit" = "N m s/rad"))]
        pub(crate) damping: Option<f64>,
        /// Angle without elastic torque.
        #[serde(default)]
        #[schemars(extend("x-unit" = "rad"))]
        pub(crate) free_angle: f64,
    }
}

item! {
    /// A spring and a damper in series along the line of two points (Maxwell element). Its extra
    /// state z is the extension of the spring: tension f = `stiffness` z, ż = l̇ − f / `damping`.
    struct Maxwell {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Point on the first and point on the second body, ground axes in the design configuration,
        /// or markers of these bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points: Option<[Place; 2]>,
        /// Instead of `points`: the same two points, each in its own body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// Stiffness of the spring, positive.
        #[schemars(extend("x-unit" = "N/m"))]
        pub(crate) stiffness: f64,
        /// Damping of the damper, positive.
        #[schemars(extend("x-unit" = "N s/m"))]
        pub(crate) damping: f64,
        /// Length without force from which `damper_extension` counts; not negative.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) free_length: f64,
    }
}

item! {
    /// Linear bushing of six components: translation d (m) of the second point in the bushing axes of
    /// the first body, rotation e (rad, 2 sign(e0) (e1, e2, e3) of the relative Euler parameters).
    /// Both are zero in the design configuration where `point` is given. At half a turn e changes its
    /// sign at once: loads of branches, and those that couple displacements and rotations, jump there, which
    /// a run warns of.
    struct Bushing {
        /// First and second body; `"ground"` is one of them at most.
        pub(crate) between: [String; 2],
        /// Where the bushing is, ground axes in the design configuration, or a marker of one of the two
        /// bodies.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the bushing's point on the first and on the second body, each in its own
        /// body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) points_in_body: Option<[Vector; 2]>,
        /// First and second axis of the bushing, perpendicular, ground axes in the design
        /// configuration; the third completes a right-handed triad. Default: ground axes.
        pub(crate) axes: Option<[Vector; 2]>,
        /// Stiffness along the three axes, not negative. Default: zero.
        #[schemars(extend("x-unit" = "N/m"))]
        pub(crate) stiffness: Option<[f64; 3]>,
        /// Stiffness about the three axes, not negative. Default: zero.
        #[schemars(extend("x-unit" = "N m/rad"))]
        pub(crate) rotational_stiffness: Option<[f64; 3]>,
        /// Damping along the three axes, not negative. Default: zero.
        #[schemars(extend("x-unit" = "N s/m"))]
        pub(crate) damping: Option<[f64; 3]>,
        /// Damping about the three axes, not negative. Default: zero.
        #[schemars(extend("x-unit" = "N m s/rad"))]
        pub(crate) rotational_damping: Option<[f64; 3]>,
        /// Instead of `stiffness` and `rotational_stiffness`: the symmetric, positive semidefinite
        /// matrix over (d, e), with e in rad always.
        #[schemars(extend("x-unit" = "N/m, N, N m"))]
        pub(crate) stiffness_matrix: Option<[[f64; 6]; 6]>,
        /// Instead of `damping` and `rotational_damping`: the symmetric, positive semidefinite matrix
        /// over (ḋ, ė), with ė in rad/s always.
        #[schemars(extend("x-unit" = "N s/m, N s, N m s"))]
        pub(crate) damping_matrix: Option<[[f64; 6]; 6]>,
        /// Springs and dampers in series, by name, which act beside these: a viscoelastic bushing (generalized Maxwell
        /// model; with one branch the standard linear solid). Where one has a spring it has a damper.
        #[serde(default)]
        pub(crate) branches: IndexMap<String, Branch>,
    }
}

/// A spring and a damper in series over the deformation u = (d, e) of a bushing. Its extra states z are the extensions of the
/// spring in the directions that it has: wrench from K z, ż = u̇ − C⁻¹K z, with the matrices K of `stiffness` and C of
/// `damping`; in each direction a force relaxes within C/K.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Branches of bushings")]
pub(crate) struct Branch {
    /// Stiffness of the springs along the three axes, not negative. Default: zero.
    #[schemars(extend("x-unit" = "N/m"))]
    pub(crate) stiffness: Option<[f64; 3]>,
    /// Stiffness of the springs about the three axes, not negative. Default: zero.
    #[schemars(extend("x-unit" = "N m/rad"))]
    pub(crate) rotational_stiffness: Option<[f64; 3]>,
    /// Damping of the dampers along the three axes, positive where the stiffness is. Default: zero.
    #[schemars(extend("x-unit" = "N s/m"))]
    pub(crate) damping: Option<[f64; 3]>,
    /// Damping of the dampers about the three axes, positive where the stiffness is. Default: zero.
    #[schemars(extend("x-unit" = "N m s/rad"))]
    pub(crate) rotational_damping: Option<[f64; 3]>,
    /// Instead of `stiffness` and `rotational_stiffness`: the symmetric, positive semidefinite matrix over (d, e), with e
    /// in rad always.
    #[schemars(extend("x-unit" = "N/m, N, N m"))]
    pub(crate) stiffness_matrix: Option<[[f64; 6]; 6]>,
    /// Instead of `damping` and `rotational_damping`: the symmetric matrix over (ḋ, ė), with ė in rad/s always, positive
    /// definite where the stiffness is not zero.
    #[schemars(extend("x-unit" = "N s/m, N s, N m s"))]
    pub(crate) damping_matrix: Option<[[f64; 6]; 6]>,
}

item! {
    /// Smooth vertical tyre at a wheel centre. With δ = `radius` − (z − h(x)) and ε = `smoothing`:
    /// s = (δ + √(δ² + ε²))/2, σ = (1 + δ/√(δ² + ε²))/2, F_z = `stiffness` s + `damping` σ δ̇.
    struct Tyre {
        /// Body that carries the wheel.
        pub(crate) on: String,
        /// Wheel centre, ground axes in the design configuration, or a marker of the body.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the wheel centre in body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point_in_body: Option<Vector>,
        /// Unloaded radius, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) radius: f64,
        /// Vertical stiffness, not negative.
        #[schemars(extend("x-unit" = "N/m"))]
        pub(crate) stiffness: f64,
        /// Vertical damping, not negative.
        #[serde(default)]
        #[schemars(extend("x-unit" = "N s/m"))]
        pub(crate) damping: f64,
        /// Length over which contact sets in, positive.
        #[serde(default = "millimetre")]
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) smoothing: f64,
        /// Name of the road of the model under the wheel.
        pub(crate) road: String,
        /// Lateral force. Default: none.
        pub(crate) lateral: Option<Lateral>,
    }
}

fn millimetre() -> f64 {
    1e-3
}

/// Lateral force of a tyre, −`cornering_stiffness` α σ sideways at the contact point, with the slip
/// angle α = atan2(v_side, √(v_forward² + `regularization_speed`²)) of the wheel centre's velocity.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Lateral tyre force")]
pub(crate) struct Lateral {
    /// Lateral force by slip angle, not negative.
    #[schemars(extend("x-unit" = "N/rad"))]
    pub(crate) cornering_stiffness: f64,
    /// Speed below which the slip angle fades, positive.
    #[schemars(extend("x-unit" = "m/s"))]
    pub(crate) regularization_speed: f64,
    /// Axis of the wheel, ground axes in the design configuration, pointing left; any length but zero.
    pub(crate) axis: Option<Vector>,
    /// Instead of `axis`: the axis in body axes.
    pub(crate) axis_in_body: Option<Vector>,
}

item! {
    /// A force at a point of a body, over time.
    struct PointForce {
        /// Body that the force acts on.
        pub(crate) on: String,
        /// Point of the body, ground axes in the design configuration, or a marker of the body.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point: Option<Place>,
        /// Instead of `point`: the point in body axes.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) point_in_body: Option<Vector>,
        /// Components, each a number or a function of time; or one of them along `direction`.
        #[schemars(extend("x-unit" = "N"))]
        pub(crate) force: Components,
        /// Direction of a force given by one number or function, in `axes`; any length but zero.
        pub(crate) direction: Option<Vector>,
        /// Axes of the components and of `direction`: of the ground, or of the body (a following
        /// force).
        #[serde(default)]
        pub(crate) axes: Axes,
    }
}

item! {
    #[allow(clippy::struct_field_names, reason = "names of the file")]
    /// A torque on a body, over time. Give `on`, or `between` for a motor: the torque acts on the
    /// second body and the opposite on the first.
    struct Torque {
        /// Body that the torque acts on.
        pub(crate) on: Option<String>,
        /// Instead of `on`: the body that carries the opposite torque, and the body acted on.
        pub(crate) between: Option<[String; 2]>,
        /// Planar: a number or a function of time, about z. Spatial: components, each a number or a
        /// function of time; or one of them about `axis`.
        #[schemars(extend("x-unit" = "N m"))]
        pub(crate) torque: TorqueComponents,
        /// Axis of a torque given by one number or function, in `axes`; any length but zero.
        #[schemars(extend("x-dimension" = "spatial"))]
        pub(crate) axis: Option<Vector>,
        /// Axes of the components and of `axis`: of the ground, or of the body acted on.
        #[serde(default)]
        pub(crate) axes: Axes,
    }
}

/// Components over time, or one function along a direction: a [motion](#values) along the direction
/// stated beside it, or a list of motions, one per axis.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "components")]
pub(crate) enum Components {
    Along(Motion),
    #[schemars(extend("x-dimension" = "planar"))]
    Planar([Motion; 2]),
    #[schemars(extend("x-dimension" = "spatial"))]
    Spatial([Motion; 3]),
}

/// A [motion](#values), in planar models about z, in spatial ones about the axis stated beside it; or a list of
/// motions, one per axis.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "torque components")]
pub(crate) enum TorqueComponents {
    About(Motion),
    #[schemars(extend("x-dimension" = "spatial"))]
    Spatial([Motion; 3]),
}

/// Axes of components.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, serde::Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Axes {
    #[default]
    Ground,
    Body,
}

/// A road profile is a height over x, the same for all y. It has a `type` and the fields of that
/// type.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(title = "Roads")]
pub(crate) enum Road {
    Flat(Flat),
    SmoothBump(SmoothBump),
    HalfCylinder(HalfCylinder),
}

item! {
    /// A plane.
    struct Flat {
        /// Height.
        #[serde(default)]
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) height: f64,
    }
}

item! {
    /// A bump h = `height` (1 − ξ²)³ for |ξ| < 1, ξ = (x − `center`)/`half_length`, on the plane z = 0;
    /// two continuous derivatives.
    struct SmoothBump {
        /// Height of the crest.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) height: f64,
        /// Half the length, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) half_length: f64,
        /// x of the crest.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) center: f64,
    }
}

item! {
    /// The path of a rigid wheel that rolls over a half cylinder lying on the plane z = 0:
    /// h = √((R + `radius`)² − (x − `center`)²) − R where positive, with R the radius of the tyre.
    struct HalfCylinder {
        /// Radius of the half cylinder, positive.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) radius: f64,
        /// x of its axis.
        #[schemars(extend("x-unit" = "m"))]
        pub(crate) center: f64,
    }
}
