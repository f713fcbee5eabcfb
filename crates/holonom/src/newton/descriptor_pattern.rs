//! Where the entries of the descriptor form's matrix come from: its pattern, found once.

use crate::reduction::{
    BodyRows, Manifold, Projection, structural_nonzeros, structural_null_space,
};
use crate::system::System;
use holonom_linalg::{BlockMatrix, BlockPattern, SparsePattern};

/// The pattern with the source of every entry.
#[derive(Debug, Clone)]
pub(super) struct DescriptorPattern {
    pub(super) pattern: SparsePattern,
    /// (value of M, slot).
    mass: Vec<(u32, u32)>,
    /// (value of G, slot in G, slot in Gᵀ).
    jacobian: Vec<(u32, u32, u32)>,
    /// (entry of the (n+m)×ndof parts, slot).
    parts: Vec<(u32, u32)>,
    /// Constant entries of P and −1: (slot, value).
    constants: Vec<(u32, f64)>,
    /// (value of the moving rows of P, slot).
    moving: Vec<(u32, u32)>,
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

        let mut entries = Vec::new();
        let mut mass_sources = Vec::new();
        for (at, entry) in structure.mass_pattern.entries(0, 0).into_iter().enumerate() {
            if m_nonzero[at] {
                entries.push(entry);
                mass_sources.push(at as u32);
            }
        }
        let mut jacobian_sources = Vec::new();
        for (at, (row, j)) in structure.constraint_pattern.entries(0, 0).into_iter().enumerate() {
            if let Some(i) = place[n + row].filter(|_| g_nonzero[at]) {
                entries.extend([(i, j), (j, i)]);
                jacobian_sources.push(at as u32);
            }
        }
        let first_own = n + rank;
        let mut constants = Vec::new();
        let columns: Vec<usize> = match &parametrization.projection {
            Projection::Selection(independent) => {
                independent.iter().copied().chain(first_own..first_own + moving_rows).collect()
            }
            Projection::Basis(rows) => {
                for (k, row) in rows.chunks_exact(n).enumerate() {
                    entries.extend((0..n).map(|j| (first_own + k, j)));
                    constants.extend_from_slice(row);
                }
                (first_own..first_own + ndof).collect()
            }
            Projection::Relative(_) => (first_own..first_own + ndof).collect(),
        };
        let owned = columns.iter().filter(|c| **c >= first_own).count();
        let size = first_own + owned;
        for k in first_own..size {
            entries.push((k, k));
            constants.push(-1.0);
        }
        let mut moving_sources = Vec::new();
        for (at, row, column) in manifold.chart().moving().entries() {
            entries.push((size - moving_rows + row, column));
            moving_sources.push(at as u32);
        }
        place.extend((size - moving_rows..size).map(Some));
        let part = if reduced {
            reduced_nonzeros(manifold, m)
        } else {
            part_nonzeros(system, manifold, q)
        };
        let mut part_sources = Vec::new();
        for (at, _) in part.iter().enumerate().filter(|(_, nonzero)| **nonzero) {
            if let Some(i) = place[at / ndof] {
                entries.push((i, columns[at % ndof]));
                part_sources.push(at as u32);
            }
        }

        let (pattern, slots) = SparsePattern::new(size, size, &entries);
        let mut slots = slots.into_iter().map(|slot| slot as u32);
        let mut next = || slots.next().expect("a slot for every entry");
        // In the order in which they were listed.
        let mass = mass_sources.into_iter().map(|at| (at, next())).collect();
        let jacobian = jacobian_sources.into_iter().map(|at| (at, next(), next())).collect();
        let constants = constants.into_iter().map(|x| (next(), x)).collect();
        let moving = moving_sources.into_iter().map(|at| (at, next())).collect();
        let parts = part_sources.into_iter().map(|at| (at, next())).collect();
        let own = (first_own, ndof - owned);
        Self { pattern, mass, jacobian, parts, constants, moving, own, size }
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
        values.fill(0.0);
        for &(at, slot) in &self.mass {
            values[slot as usize] += mass.values()[at as usize];
        }
        for &(at, lower, upper) in &self.jacobian {
            values[lower as usize] += jacobian[at as usize];
            values[upper as usize] += jacobian[at as usize];
        }
        for &(slot, x) in &self.constants {
            values[slot as usize] += x;
        }
        for &(at, slot) in &self.moving {
            values[slot as usize] += moving.value(at as usize);
        }
        for &(at, slot) in &self.parts {
            values[slot as usize] += parts[at as usize];
        }
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
    let per_body = structure.sizes.per_body;
    for ends in &structure.extra_bodies {
        let coordinates = || ends.iter().flatten().flat_map(|b| b * per_body..(b + 1) * per_body);
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
