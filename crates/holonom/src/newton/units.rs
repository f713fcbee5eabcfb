//! Units in which the numbers of a mechanism are of one size, whatever it is measured in: without them the masses of a
//! small one are round-off beside its joints.

use super::sparse_pattern::Shape;
use crate::reduction::Manifold;
use crate::system::Measure;

/// Lengths of coordinates, rows and rates, and the largest mass.
///
/// A mechanism's length L is the unit of what is a length, 1 rad that of what is an angle, and the unit of mass is the
/// largest entry of M where δq are measured in these: M, G and P are of the size of 1 then.
#[derive(Debug, Clone)]
pub(super) struct Units {
    /// Of coordinates, of kept rows of G, and of independent coordinates.
    coordinates: Vec<f64>,
    rows: Vec<f64>,
    rates: Vec<f64>,
    mass: f64,
}

impl Units {
    /// Of a manifold's system in its present parametrization, with the mass matrix at q.
    pub(super) fn new(manifold: &Manifold, q: &[f64]) -> Self {
        let system = manifold.system().as_ref();
        let (structure, parametrization) = (system.structure(), manifold.chart().parametrization());
        let length = system.characteristic_length();
        let of = |measure| if measure == Measure::Length { length } else { 1.0 };
        let coordinates: Vec<f64> =
            (0..structure.sizes.coordinates).map(|i| of(structure.coordinate_measure(i))).collect();
        let mut mass = structure.mass_pattern.zeros();
        system.mass_matrix(q, &mut mass);
        let entries = mass.entries(0, 0).into_iter().zip(mass.values());
        let heaviest = entries.fold(0.0f64, |most, ((i, j), x)| {
            most.max((x * coordinates[i] * coordinates[j]).abs())
        });
        Self {
            rows: parametrization.kept.iter().map(|&r| of(structure.row_measure[r])).collect(),
            rates: (0..parametrization.ndof)
                .map(|k| of(parametrization.measure(system, k)))
                .collect(),
            coordinates,
            mass: if heaviest > 0.0 { heaviest } else { 1.0 },
        }
    }

    /// Factors of the equations and of the unknowns of the descriptor form, of whose independent accelerations those from
    /// `own` on are unknowns of their own.
    pub(super) fn of_descriptor(&self, own: usize) -> [Vec<f64>; 2] {
        let [mut rows, mut columns] = self.of(Shape::Simplified);
        rows.extend(self.rates[own..].iter().map(|x| 1.0 / x));
        columns.extend(&self.rates[own..]);
        [rows, columns]
    }

    /// The same of the inflated or the simplified matrix.
    pub(super) fn of(&self, shape: Shape) -> [Vec<f64>; 2] {
        let forces = self.coordinates.iter().map(|x| x / self.mass);
        let held = || self.rows.iter().map(|x| 1.0 / x);
        let multipliers = self.rows.iter().map(|x| self.mass / x);
        match shape {
            Shape::Inflated => {
                let level = || held().chain(self.rates.iter().map(|x| 1.0 / x));
                let changes = [&self.coordinates; 3].into_iter().flatten().copied();
                [
                    level().chain(level()).chain(level()).chain(forces).collect(),
                    changes.chain(multipliers).chain(self.rates.iter().copied()).collect(),
                ]
            }
            Shape::Simplified => [
                forces.chain(held()).collect(),
                self.coordinates.iter().copied().chain(multipliers).collect(),
            ],
        }
    }
}
