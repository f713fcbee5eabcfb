//! Units.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Units of the numbers of a file. A number is converted by the unit that its table on this page names,
/// with `m`, `rad`, `kg` and `N` replaced by the units stated here: with `length = "mm"` a stiffness is in
/// N/mm. Time is in seconds always.
#[derive(Debug, Clone, Copy, Default, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "Units")]
#[allow(dead_code, reason = "applied while the file is checked")]
pub(crate) struct Units {
    /// In place of m.
    #[serde(default)]
    pub(crate) length: Length,
    /// In place of rad.
    #[serde(default)]
    pub(crate) angle: Angle,
    /// In place of kg.
    #[serde(default)]
    pub(crate) mass: Mass,
    /// In place of N; it does not follow from the others.
    #[serde(default)]
    pub(crate) force: ForceUnit,
}

/// Names of units, as files write them.
macro_rules! names {
    ($($(#[$meta:meta])* $name:ident { $first:ident = $si:literal $(, $variant:ident = $word:literal)* })+) => {$(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize, JsonSchema)]
        pub(crate) enum $name {
            #[default]
            #[serde(rename = $si)]
            $first,
            $(#[serde(rename = $word)] $variant,)*
        }

        #[cfg(test)]
        impl $name {
            const WORDS: &[&str] = &[$si $(, $word)*];
        }
    )+};
}

names! {
    /// Units of length.
    Length { M = "m", Mm = "mm", Cm = "cm", Km = "km", Um = "um", In = "in", Ft = "ft", Yd = "yd" }
    /// Units of angles.
    Angle { Rad = "rad", Mrad = "mrad", Deg = "deg", Turn = "turn" }
    /// Units of mass.
    Mass { Kg = "kg", G = "g", Mg = "mg", T = "t", Lb = "lb", Slug = "slug" }
    /// Units of force.
    ForceUnit { N = "N", MilliN = "mN", Kn = "kN", MegaN = "MN", Kgf = "kgf", Lbf = "lbf" }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::units::QUANTITIES;

    #[test] // the words of the schema and the numbers behind them stand in two files
    fn every_unit_of_the_schema_has_a_factor() {
        let words = [Length::WORDS, Angle::WORDS, Mass::WORDS, ForceUnit::WORDS];
        for ((field, _, known), words) in QUANTITIES.iter().zip(words) {
            let names: Vec<&str> = known.iter().map(|(name, _)| *name).collect();
            assert_eq!(names, words, "{field}");
        }
    }
}
