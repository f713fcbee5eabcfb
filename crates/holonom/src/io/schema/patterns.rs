//! Patterns.

use indexmap::IndexMap;
use schemars::JsonSchema;
use serde::Deserialize;

use super::{Body, DataTable, Driver, ExtraState, Force, InitialBody, InitialJoint, Joint, item};

item! {
    /// Items that are written once and repeated over one or more indices. Names, and texts that name
    /// other items, hold whole numbers in braces, `link_{i - 1}`; numbers are expressions of the
    /// indices and of parameters, `"=i*length"`.
    #[schemars(title = "Patterns")]
    #[allow(dead_code, reason = "written out before the file is checked")]
    struct Pattern {
        /// The indices by name, with their ranges; the last one runs fastest.
        pub(crate) over: IndexMap<String, Range>,
        /// Repeated bodies.
        #[serde(default)]
        pub(crate) bodies: IndexMap<String, Body>,
        /// Repeated joints.
        #[serde(default)]
        pub(crate) joints: IndexMap<String, Joint>,
        /// Repeated forces.
        #[serde(default)]
        pub(crate) forces: IndexMap<String, Force>,
        /// Repeated drivers.
        #[serde(default)]
        pub(crate) drivers: IndexMap<String, Driver>,
        /// Repeated tables.
        #[serde(default)]
        pub(crate) tables: IndexMap<String, DataTable>,
        /// Repeated states at the start of the run.
        #[serde(default)]
        pub(crate) initial: RepeatedInitial,
        /// Repeated channels.
        #[serde(default)]
        pub(crate) outputs: RepeatedOutputs,
    }
}

/// Values of an index: whole numbers, both ends included. `to` one below `from` is no repetition.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Ranges")]
#[allow(dead_code, reason = "used while patterns are written out")]
pub(crate) struct Range {
    /// First value; expressions may use the indices before this one.
    pub(crate) from: f64,
    /// Last value, alike.
    pub(crate) to: f64,
}

/// Initial states that are repeated.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Repeated initial state")]
#[allow(dead_code, reason = "written out before the file is checked")]
pub(crate) struct RepeatedInitial {
    /// Stated values of single bodies, by name.
    #[serde(default)]
    pub(crate) bodies: IndexMap<String, InitialBody>,
    /// Stated coordinates of single joints, by name.
    #[serde(default)]
    pub(crate) joints: IndexMap<String, InitialJoint>,
    /// Extra states by the name of their force.
    #[serde(default)]
    pub(crate) extra_states: IndexMap<String, ExtraState>,
}

/// Outputs that are repeated.
#[derive(Debug, Clone, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Repeated outputs")]
#[allow(dead_code, reason = "written out before the file is checked")]
pub(crate) struct RepeatedOutputs {
    /// Channels, added to those of the file.
    #[serde(default)]
    pub(crate) channels: Vec<String>,
}
