//! What the independent variables are.

use super::relatives::Relatives;
use crate::system::{Measure, State, System};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// What the independent variables are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub enum Projection {
    /// Coordinate partitioning: the independent coordinates, ascending.
    Selection(Vec<usize>),
    /// Tangent plane: ndof×n by rows, orthonormal on scaled coordinates.
    Basis(Vec<f64>),
    /// Relative coordinates of a spanning forest.
    Relative(Box<Relatives>),
}

/// Which rows and coordinates a parametrization uses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Parametrization {
    /// Rows of independent constraints, ascending.
    pub kept: Arc<[usize]>,
    /// Redundant rows, ascending.
    pub dropped: Vec<usize>,
    /// v(q).
    pub projection: Projection,
    /// Number of degrees of freedom.
    pub ndof: usize,
    /// Smallest accepted pivot over the first: small near a singular configuration.
    #[serde(skip)]
    pub pivot_ratio: f64,
}

impl Parametrization {
    /// The coordinate that independent variable `k` is, or moves most; for a relative coordinate the first
    /// one of a body that it moves.
    pub fn coordinate(&self, system: &dyn System, k: usize) -> usize {
        let sizes = system.structure().sizes;
        let n = sizes.coordinates;
        match &self.projection {
            Projection::Selection(independent) => independent[k],
            Projection::Basis(rows) => largest_index(&rows[k * n..(k + 1) * n]),
            Projection::Relative(relatives) => {
                let group = &system.relative_groups()[relatives.rows[k].0];
                let [first, second] = group.bodies;
                let turns = usize::from(group.kind.turns());
                second.or(first).map_or(0, |body| {
                    [sizes.translations_of(body), sizes.rotations_of(body)][turns].start
                })
            }
        }
    }

    /// Name of independent variable `k`, for messages and reports.
    pub fn name(&self, system: &dyn System, k: usize) -> String {
        match &self.projection {
            Projection::Relative(relatives) => relatives.name(system, k),
            _ => system.coordinate_name(self.coordinate(system, k)),
        }
    }

    /// Whether independent variable `k` is a length or an angle.
    pub fn measure(&self, system: &dyn System, k: usize) -> Measure {
        match &self.projection {
            Projection::Relative(relatives) => relatives.measure(system, k),
            _ => system.structure().coordinate_measure(self.coordinate(system, k)),
        }
    }

    /// Rows of P that do not move.
    pub fn linear(&self) -> usize {
        if let Projection::Relative(_) = self.projection { 0 } else { self.ndof }
    }

    /// The relative coordinates, if v is made of them.
    pub fn relatives(&self) -> Option<&Relatives> {
        match &self.projection {
            Projection::Relative(relatives) => Some(relatives),
            _ => None,
        }
    }

    /// Whether v(q), up to references, and the kept rows are the same.
    pub fn same_as(&self, other: &Self) -> bool {
        let same = match (&self.projection, &other.projection) {
            (Projection::Relative(a), Projection::Relative(b)) => a.same_as(b),
            (a, b) => a == b,
        };
        same && self.kept == other.kept
    }

    /// v = v(q).
    pub fn positions(&self, system: &dyn System, q: &[f64], v: &mut [f64]) {
        match &self.projection {
            Projection::Relative(relatives) => relatives.positions(system, q, v),
            _ => self.project(q, v),
        }
    }

    /// v̇ = P(q) q̇.
    pub fn rates(&self, system: &dyn System, q: &[f64], v: &[f64], rates: &mut [f64]) {
        match &self.projection {
            Projection::Relative(relatives) => relatives.rates(system, q, v, rates),
            _ => self.project(v, rates),
        }
    }

    /// Curvature (P q̇)_q q̇ of v(q), so that v̈ = P q̈ + curvature.
    pub fn curvature(&self, system: &dyn System, q: &[f64], rates: &[f64], out: &mut [f64]) {
        match &self.projection {
            Projection::Relative(relatives) => relatives.curvature(system, q, rates, out),
            _ => out.fill(0.0),
        }
    }

    /// (P q̇)_q δq.
    pub fn rate_change(&self, system: &dyn System, state: &State, dq: &[f64], out: &mut [f64]) {
        match &self.projection {
            Projection::Relative(relatives) => relatives.rate_change(system, state, dq, out),
            _ => out.fill(0.0),
        }
    }

    /// v̈ = P(q) q̈ + curvature.
    pub fn accelerations(
        &self,
        system: &dyn System,
        q: &[f64],
        v: &[f64],
        a: &[f64],
        p_rate: &mut [f64],
    ) {
        self.rates(system, q, a, p_rate);
        if let Projection::Relative(relatives) = &self.projection {
            relatives.add_curvature(system, q, v, p_rate);
        }
    }

    /// The rows of P that do not move, times x; the others are left alone.
    pub fn project(&self, x: &[f64], p: &mut [f64]) {
        match &self.projection {
            Projection::Selection(independent) => {
                for (out, &i) in p.iter_mut().zip(independent) {
                    *out = x[i];
                }
            }
            Projection::Basis(rows) => {
                for (out, row) in p.iter_mut().zip(rows.chunks_exact(x.len())) {
                    *out = row.iter().zip(x).map(|(a, b)| a * b).sum();
                }
            }
            Projection::Relative(_) => {}
        }
    }
}

/// Index of the entry of largest magnitude.
pub fn largest_index(x: &[f64]) -> usize {
    (0..x.len()).fold(0, |best, i| if x[i].abs() > x[best].abs() { i } else { best })
}
