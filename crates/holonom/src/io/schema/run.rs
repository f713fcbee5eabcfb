//! Outputs and run defaults.

use crate::model::{
    Accelerations, Coordinates, JacobianSource, ParametrizationKind, Profile, Representation,
};
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
    /// Time between two outputs, positive. Default: 1/200 of the run.
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
    /// One number for all parts, or some of them. Default: 1e-4.
    pub(crate) tolerance: Option<Tolerance>,
    /// Name of a code (`ForSDIRK`) or of a family of methods (`first_order`). Default: `ForRadau`.
    pub(crate) method: Option<String>,
    /// Formula within a family of methods.
    pub(crate) formula: Option<String>,
    /// Step size of a run without step-size control, positive; not beside `max_step` or `initial_step`, and replaced where a call states one
    /// of these.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) fixed_step: Option<f64>,
    /// Largest step size, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) max_step: Option<f64>,
    /// First step size, positive.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) initial_step: Option<f64>,
    /// Largest number of attempted steps, refused ones included. Default: 10,000,000.
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
    pub(crate) parametrization: Option<ParametrizationKind>,
    /// Where the integration Jacobian comes from; analytic unless stated.
    pub(crate) jacobian: Option<JacobianSource>,
    /// How the integration Jacobian is represented; by predicted cost unless stated.
    pub(crate) newton: Option<Representation>,
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
