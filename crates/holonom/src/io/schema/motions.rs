//! Functions of time and tables.

use schemars::JsonSchema;
use serde::Deserialize;

use super::item;

/// A number (constant) or a [function of time](#functions-of-time).
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(untagged)]
#[schemars(title = "motion")]
pub(crate) enum Motion {
    Number(f64),
    Function(TimeFunction),
}

/// A function of time has a `type` and the fields of that type. Values carry the unit of the field that they stand in.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(tag = "type", rename_all = "snake_case")]
#[schemars(title = "Functions of time")]
pub(crate) enum TimeFunction {
    Constant(Constant),
    Polynomial(Polynomial),
    Harmonic(Harmonic),
    SmoothStep(SmoothStep),
    Table(TableFunction),
}

/// A constant; the same as the number alone.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Constant {
    /// The value.
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) value: f64,
}

/// c0 + c1 s + c2 s² + … with s = t − `start`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Polynomial {
    /// c0, c1, c2, …; at least one. Of c1 the unit is divided by s, of c2 by s², and so on.
    #[schemars(length(min = 1), extend("x-unit" = "of the field"))]
    pub(crate) coefficients: Vec<f64>,
    /// Time from which s counts.
    #[serde(default)]
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) start: f64,
}

/// `offset` + `amplitude` sin(`angular_frequency` t + `phase`).
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct Harmonic {
    /// Amplitude.
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) amplitude: f64,
    /// Angular frequency, 2π times the frequency.
    #[schemars(extend("x-unit" = "rad/s"))]
    pub(crate) angular_frequency: f64,
    /// Phase.
    #[serde(default)]
    #[schemars(extend("x-unit" = "rad"))]
    pub(crate) phase: f64,
    /// Mean value.
    #[serde(default)]
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) offset: f64,
}

/// From one value to another by a polynomial of degree five, with two continuous derivatives.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct SmoothStep {
    /// Value until `start`.
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) from: f64,
    /// Value from `end` on.
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) to: f64,
    /// Where the change begins.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) start: f64,
    /// Where the change ends, after `start`.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) end: f64,
}

/// A cubic spline with two continuous derivatives through a table of times and values, natural at
/// its ends; the table must cover the run. Give `table`, or `x` and `y`.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct TableFunction {
    /// Name of a table of the model.
    pub(crate) table: Option<String>,
    /// Times, increasing.
    #[schemars(extend("x-unit" = "s"))]
    pub(crate) x: Option<Vec<f64>>,
    /// Values at these times.
    #[schemars(extend("x-unit" = "of the field"))]
    pub(crate) y: Option<Vec<f64>>,
}

item! {
    /// A table of two columns. Force laws go through it by a monotone cubic with one continuous
    /// derivative, continued linearly outside; motions by a cubic spline with two.
    #[schemars(title = "Tables")]
    struct DataTable {
        /// Abscissas, increasing, two or more: extension (m) or angle (rad) of a law, time (s) of a
        /// motion; in the units of the field that uses the table.
        pub(crate) x: Vec<f64>,
        /// Ordinates, as many as `x`.
        pub(crate) y: Vec<f64>,
    }
}
