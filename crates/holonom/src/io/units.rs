//! Units of a file: numbers are converted to SI while the file is checked, each by the unit that the
//! schema states beside its field.

use std::f64::consts::PI;

use super::tree::Node;
use crate::model::StatedUnits;

/// SI units per unit as a quotient of two numbers, exact wherever the unit is defined by a decimal number.
type Ratio = (f64, f64);

const LENGTHS: &[(&str, Ratio)] = &[
    ("m", (1.0, 1.0)),
    ("mm", (1.0, 1e3)),
    ("cm", (1.0, 1e2)),
    ("km", (1e3, 1.0)),
    ("um", (1.0, 1e6)),
    ("in", (254.0, 1e4)),
    ("ft", (3048.0, 1e4)),
    ("yd", (9144.0, 1e4)),
];
const ANGLES: &[(&str, Ratio)] =
    &[("rad", (1.0, 1.0)), ("mrad", (1.0, 1e3)), ("deg", (PI, 180.0)), ("turn", (2.0 * PI, 1.0))];
const MASSES: &[(&str, Ratio)] = &[
    ("kg", (1.0, 1.0)),
    ("g", (1.0, 1e3)),
    ("mg", (1.0, 1e6)),
    ("t", (1e3, 1.0)),
    ("lb", (45_359_237.0, 1e8)),
    ("slug", (0.453_592_37 * 9.806_65, 0.3048)),
];
const FORCES: &[(&str, Ratio)] = &[
    ("N", (1.0, 1.0)),
    ("mN", (1.0, 1e3)),
    ("kN", (1e3, 1.0)),
    ("MN", (1e6, 1.0)),
    ("kgf", (980_665.0, 1e5)),
    ("lbf", (0.453_592_37 * 9.806_65, 1.0)),
];
/// Field of `units`, the SI unit, and what may stand in its place.
pub(super) const QUANTITIES: [(&str, &str, &[(&str, Ratio)]); 4] = [
    ("length", "m", LENGTHS),
    ("angle", "rad", ANGLES),
    ("mass", "kg", MASSES),
    ("force", "N", FORCES),
];

/// Of a value whose unit is that of the field it stands in.
pub(super) const OF_THE_FIELD: &str = "of the field";
/// Of the columns of a law, whose field has the unit "y over x".
const ABSCISSA: &str = "abscissa of the field";
const ORDINATE: &str = "ordinate of the field";

/// Units of a file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Units {
    /// For each of [`QUANTITIES`] the unit's name and ratio.
    chosen: [(&'static str, Ratio); 4],
}

impl Units {
    /// Those that a file states; what is not stated, or not known, is SI.
    pub(super) fn of(root: &Node) -> Self {
        let stated = root.field("units");
        let chosen = QUANTITIES.map(|(field, si, known)| {
            let word = stated.and_then(|units| units.field(field)?.text()).unwrap_or(si);
            *known.iter().find(|(name, _)| *name == word).unwrap_or(&known[0])
        });
        Self { chosen }
    }

    /// Which of them a file states.
    pub(super) fn stated(root: &Node) -> StatedUnits {
        let [length, angle, mass] = ["length", "angle", "mass"]
            .map(|field| root.field("units").is_some_and(|units| units.field(field).is_some()));
        StatedUnits { length, angle, mass }
    }

    pub(super) fn are_si(&self) -> bool {
        self.chosen.iter().all(|(_, ratio)| *ratio == (1.0, 1.0))
    }

    /// `x`, given in the unit that stands for `unit` in this file, in SI.
    pub(super) fn to_si(&self, unit: &str, x: f64) -> f64 {
        let (mut number, mut divisor) = (1.0, 1.0);
        let (above, below) = unit.split_once('/').unwrap_or((unit, ""));
        for (part, inverse) in [(above, false), (below, true)] {
            for symbol in part.split(' ') {
                let power =
                    [('²', 2), ('³', 3)].into_iter().find(|(end, _)| symbol.ends_with(*end));
                let (symbol, power) = power.map_or((symbol, 1), |(end, n)| {
                    (symbol.strip_suffix(end).unwrap_or(symbol), n)
                });
                let (n, d) = self.chosen_for(symbol).map_or((1.0, 1.0), |(_, ratio)| ratio);
                let (n, d) = if inverse { (d, n) } else { (n, d) };
                number *= n.powi(power);
                divisor *= d.powi(power);
            }
        }
        x * number / divisor
    }

    /// The name of the unit that stands for `unit` in this file.
    pub(super) fn name(&self, unit: &str) -> String {
        let mut out = String::with_capacity(unit.len());
        for piece in unit.split_inclusive([' ', '/', '²', '³', ',']) {
            let symbol = piece.trim_end_matches([' ', '/', '²', '³', ',']);
            out += self.chosen_for(symbol).map_or(symbol, |(name, _)| name);
            out += &piece[symbol.len()..];
        }
        out
    }

    fn chosen_for(&self, symbol: &str) -> Option<(&'static str, Ratio)> {
        let at = QUANTITIES.iter().position(|(_, si, _)| *si == symbol)?;
        Some(self.chosen[at])
    }
}

/// The unit of a field within a value whose own unit is `outer`.
pub(super) fn within<'a>(unit: Option<&'a str>, outer: Option<&'a str>) -> Option<&'a str> {
    let columns = outer.and_then(|outer| outer.split_once(" over "));
    match unit {
        Some(OF_THE_FIELD) => outer,
        Some(ABSCISSA) => columns.map(|(_, x)| x),
        Some(ORDINATE) => columns.map(|(y, _)| y),
        unit => unit,
    }
}

/// Of a matrix over (translation, rotation), whose blocks have units of their own, that of the entry at
/// the end of `path`.
pub(super) fn entry<'a>(unit: &'a str, path: &str) -> &'a str {
    let mut blocks = unit.split(", ");
    let (Some(first), Some(mixed), Some(last)) = (blocks.next(), blocks.next(), blocks.next())
    else {
        return unit;
    };
    let mut indices = path.rsplit('[').map(|index| index.trim_end_matches(']').parse::<usize>());
    match (indices.next(), indices.next()) {
        (Some(Ok(column)), Some(Ok(row))) if row < 3 && column < 3 => first,
        (Some(Ok(column)), Some(Ok(row))) if row >= 3 && column >= 3 => last,
        _ => mixed,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn units(chosen: [&str; 4]) -> Units {
        let find = |k: usize| {
            let known = QUANTITIES[k].2;
            *known.iter().find(|(name, _)| *name == chosen[k]).unwrap()
        };
        Units { chosen: [find(0), find(1), find(2), find(3)] }
    }

    #[test] // independent truth: conversion factors of handbooks
    fn derived_units_follow_from_their_parts() {
        let metric = units(["mm", "deg", "t", "N"]);
        for (unit, x, expected) in [
            ("m", 300.0, 0.3),
            ("N/m", 25.0, 25_000.0),
            ("N s/m", 0.4, 400.0),
            ("kg m²", 2.0, 2e-3),
            ("m/s²", -9810.0, -9.81),
            ("rad", 180.0, std::f64::consts::PI),
            ("N m/rad", 1000.0, 180.0 / std::f64::consts::PI),
            ("s", 2.0, 2.0),
            ("kg/m³", 7.85e-9, 7850.0),
        ] {
            assert!((metric.to_si(unit, x) - expected).abs() <= 4e-16 * expected.abs(), "{unit}");
        }
        assert_eq!(metric.name("kg m²"), "t mm²");
        assert_eq!(metric.name("N m s/rad"), "N mm s/deg");
        let imperial = units(["in", "rad", "lb", "lbf"]);
        assert!((imperial.to_si("N/m", 1.0) - 175.126_835_246_476_2).abs() < 1e-12);
        assert!((imperial.to_si("kg m²", 1.0) - 2.926_396_534_292e-4).abs() < 1e-12);
        assert!(
            (units(["ft", "rad", "slug", "lbf"]).to_si("kg", 1.0) - 14.593_902_937_206_36).abs()
                < 1e-12
        );
    }

    #[test]
    fn entries_of_matrices_have_the_units_of_their_blocks() {
        let unit = "N/m, N, N m";
        assert_eq!(entry(unit, "forces.b.stiffness_matrix[2][0]"), "N/m");
        assert_eq!(entry(unit, "forces.b.stiffness_matrix[2][3]"), "N");
        assert_eq!(entry(unit, "forces.b.stiffness_matrix[5][3]"), "N m");
        assert_eq!(entry("kg", "bodies.a.mass"), "kg");
    }
}
