//! Where the entries of the descriptor form's matrix come from: its pattern, found once.

use crate::reduction::{
    BodyRows, Manifold, Projection, structural_nonzeros, structural_null_space,
};
use crate::system::System;
use holonom_linalg::{Assembly, BlockMatrix, BlockPattern, SparsePattern, Terms};

/// Matrices whose values stand in it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Mass,
    Jacobian,
    /// P, where it does not move, and −1.
    Constant,
    Moving,
    /// The (n+m)×ndof parts.
    Part,
}

/// The pattern with the source of every entry.
#[derive(Debug, Clone)]
pub(super) struct DescriptorPattern {
    pub(super) pattern: SparsePattern,
    assembly: Assembly<Source>,
    constants: Vec<f64>,
    /// Unknowns before the entries of v̈ that are their own, and the first of these entries.
    pub(super) own: (usize, usize),
    /// Number of unknowns.
    pub(super) size: usize,
}

impl DescriptorPattern {
    /// For the manifold's present parametrization; `reduced` for parts made of M̂₁ and M̂₂.
    pub(super) fn new(manifold: &Manifold, q: &[f64], reduced: bool) -> Self {
        let system = manifold.system().as_ref();
        let structure = system.structure();
        let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
        let parametrization = manifold.chart().parametrization();
        let (ndof, kept) = (parametrization.ndof, &parametrization.kept);
        let (rank, linear) = (kept.len(), parametrization.linear());
        let moving_rows = ndof - linear;
        let (g_nonzero, m_nonzero) = structural_nonzeros(system, q);
        let mut place: Vec<Option<usize>> = (0..n).map(Some).collect();
        place.resize(n + m, None);
        for (k, &row) in kept.iter().enumerate() {
            place[n + row] = Some(n + k);
        }

        let mut terms = Terms::default();
        let mass = structure.mass_pattern.entries(0, 0).into_iter().enumerate();
        terms.add(Source::Mass, mass.filter(|(at, _)| m_nonzero[*at]));
        let jacobian = structure.constraint_pattern.entries(0, 0).into_iter().enumerate();
        let jacobian = jacobian.filter(|(at, _)| g_nonzero[*at]).filter_map(|(at, (row, j))| {
            let i = place[n + row]?;
            Some([(at, (i, j)), (at, (j, i))])
        });
        terms.add(Source::Jacobian, jacobian.flatten());
        let first_own = n + rank;
        let mut constants = vec![-1.0];
        let columns: Vec<usize> = match &parametrization.projection {
            Projection::Selection(independent) => {
                independent.iter().copied().chain(first_own..first_own + moving_rows).collect()
            }
            Projection::Basis(rows) => {
                let places = (0..ndof).flat_map(|k| (0..n).map(move |j| (first_own + k, j)));
                terms.add(Source::Constant, (1..).zip(places));
                constants.extend_from_slice(rows);
                (first_own..first_own + ndof).collect()
            }
            Projection::Relative(_) => (first_own..first_own + ndof).collect(),
        };
        let owned = columns.iter().filter(|c| **c >= first_own).count();
        let size = first_own + owned;
        terms.add(Source::Constant, (first_own..size).map(|k| (0, (k, k))));
        let moving = manifold.chart().moving().entries();
        let first_moving = size - moving_rows;
        terms.add(
            Source::Moving,
            moving.map(|(at, row, column)| (at, (first_moving + row, column))),
        );
        place.extend((size - moving_rows..size).map(Some));
        let part = if reduced {
            reduced_nonzeros(manifold, m)
        } else {
            part_nonzeros(system, manifold, q)
        };
        let part = part.iter().enumerate().filter(|(_, nonzero)| **nonzero);
        let part = part.filter_map(|(at, _)| Some((at, (place[at / ndof]?, columns[at % ndof]))));
        terms.add(Source::Part, part);

        let (pattern, slots) = SparsePattern::new(size, size, terms.places());
        let own = (first_own, ndof - owned);
        Self { pattern, assembly: terms.in_slots(&slots), constants, own, size }
    }

    /// Sums the entries.
    pub(super) fn fill(
        &self,
        mass: &BlockMatrix,
        jacobian: &[f64],
        moving: &BodyRows,
        parts: &[f64],
        values: &mut [f64],
    ) {
        let of = |source| {
            let source = match source {
                Source::Mass => mass.values(),
                Source::Jacobian => jacobian,
                Source::Constant => &self.constants[..],
                Source::Moving => moving.values(),
                Source::Part => parts,
            };
            (source, 1.0)
        };
        self.assembly.sum(of, values);
    }
}

/// Which entries of the (n+m)×ndof parts can differ from zero: a coordinate that no q_k moves in any
/// configuration has no derivative by it either, so 𝒥 has the pattern of D.
fn part_nonzeros(system: &dyn System, manifold: &Manifold, q: &[f64]) -> Vec<bool> {
    let structure = system.structure();
    let (n, m, k) = (structure.sizes.coordinates, structure.sizes.rows, manifold.chart().ndof());
    let d = structural_null_space(system, manifold.chart(), q);
    let moving = manifold.chart().moving();
    let mut nonzero = vec![false; (n + m + moving.len()) * k];
    for (_, row, j) in moving.entries() {
        for column in 0..k {
            nonzero[(n + m + row) * k + column] |= d[j * k + column];
        }
    }
    let mut propagate = |matrix: &BlockPattern, first: usize| {
        for (i, j) in matrix.entries(first, 0) {
            for column in 0..k {
                nonzero[i * k + column] |= d[j * k + column];
            }
        }
    };
    propagate(&structure.stiffness_pattern, 0);
    propagate(&structure.constraint_pattern, n);
    // F_z times the effect of v on z: all coordinates of an element's bodies move with all others.
    for state in 0..structure.sizes.extra_states {
        let coordinates = || structure.extra_entries(state).map(|(_, j)| j);
        for column in 0..k {
            if coordinates().any(|j| d[j * k + column]) {
                coordinates().for_each(|i| nonzero[i * k + column] = true);
            }
        }
    }
    nonzero
}

/// The same where parts are made of M̂₁ and M̂₂: the independent coordinates, or all for a tangent
/// plane.
fn reduced_nonzeros(manifold: &Manifold, m: usize) -> Vec<bool> {
    let parametrization = manifold.chart().parametrization();
    let (n, k) = (manifold.system().structure().sizes.coordinates, parametrization.ndof);
    let moving = manifold.chart().moving();
    let mut nonzero = vec![false; (n + m + moving.len()) * k];
    for (_, _, i) in moving.entries() {
        nonzero[i * k..(i + 1) * k].fill(true);
    }
    match &parametrization.projection {
        Projection::Selection(independent) => {
            for i in independent {
                nonzero[i * k..(i + 1) * k].fill(true);
            }
        }
        Projection::Basis(_) => nonzero[..n * k].fill(true),
        Projection::Relative(_) => {}
    }
    nonzero
}
