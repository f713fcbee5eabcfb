//! Outputs and run defaults.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

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
    /// One number for all parts, or some of them.
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
    #[schemars(range(min = 1))]
    pub(crate) max_steps: Option<u64>,
    /// Largest wall time of a run with its assembly, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) max_seconds: Option<f64>,
    /// Growth of the condition number at which independent variables are chosen anew, above 1; by default 2.5 on the tree, 1.25 for a
    /// partition, 2 for a tangent plane.
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
    /// Which coordinates recoveries and derivatives go through; unless stated joint for trees, and
    /// for models with loops of up to 200 degrees of freedom where few loops hang together.
    pub(crate) coordinates: Option<Coordinates>,
    /// Joints that close loops of the spanning forest, by name; which others do is chosen by the fewest relative
    /// coordinates. A body that nothing else ties is free then. A joint that is not
    /// `enabled` is not there and cannot be named.
    #[serde(default)]
    pub(crate) cut: Vec<String>,
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
    /// The sparse one without how joints turn, while iterations with it contract.
    Simplified,
    /// The sparse one with all of it.
    Inflated,
}

impl Newton {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Dense => "dense",
            Self::Sparse => "sparse",
            Self::Simplified => "simplified",
            Self::Inflated => "inflated",
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

/// Which coordinates recoveries and derivatives go through.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Coordinates {
    /// Joint for trees, and for models with loops of up to 200 degrees of freedom where few loops hang together; else
    /// Cartesian.
    Auto,
    /// Poses of bodies, with equations for every joint.
    Cartesian,
    /// Relative coordinates along the spanning tree, with equations for what closes loops.
    Joint,
}

impl Coordinates {
    /// Name in files and options.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Auto => "auto",
            Self::Cartesian => "cartesian",
            Self::Joint => "joint",
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

/// Tolerances by part; at least one is stated, and what is not is 1e-4.
#[derive(Debug, Clone, Copy, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Tolerances")]
pub(crate) struct ToleranceParts {
    /// Relative part: of the movement since the start (positions) or of the value (velocities).
    pub(crate) relative: Option<f64>,
    /// Absolute part of translations (m, m/s).
    #[schemars(extend("x-unit" = "m"))]
    pub(crate) translation: Option<f64>,
    /// Absolute part of rotations (rad, rad/s).
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) rotation: Option<f64>,
}
