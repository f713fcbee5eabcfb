//! Loops that have no dependent coordinate in common, and are closed apart.

use super::closures::{Closure, Origin};
use crate::reduction::relatives::Source;
use holonom_linalg::DenseLu;

/// A number of a cluster's own matrix: its place there and in [`Closures::matrix`](super::closures::Closures::matrix), and what it is scaled by.
#[derive(Debug, Clone, Copy)]
pub(super) struct Entry {
    pub(super) at: usize,
    pub(super) from: usize,
    pub(super) scale: f64,
}

/// Closures whose dependent coordinates are their own: loops with no coordinate in common are solved apart.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Its rows, and the places of its dependent coordinates in [`Closures::dependent`](super::closures::Closures::dependent).
    pub(super) rows: Vec<usize>,
    pub(super) dependent: Vec<usize>,
    pub(super) row_scale: Vec<f64>,
    pub(super) column_scale: Vec<f64>,
    /// Whether corrections of its positions go on, the largest one of the last and of the time before, lengths over the
    /// characteristic length, and the largest residual before it.
    pub(super) is_open: bool,
    pub(super) size: f64,
    pub(super) before: f64,
    pub(super) residual: f64,
    /// A correction that is round-off of its coordinates.
    pub(super) noise: f64,
    /// Independent variables that move its dependent coordinates: as coordinates, or as deformations of a row.
    pub(super) free: Vec<(usize, Free)>,
    pub(super) square: Vec<f64>,
    /// Its numbers, and those of the right-hand sides of [`Closures::evaluate_maps`](super::closures::Closures::evaluate_maps).
    pub(super) square_entries: Vec<Entry>,
    pub(super) map_entries: Vec<Entry>,
    pub(super) inverse: Vec<f64>,
    pub(super) lu: DenseLu,
    /// Dependent coordinates by independent variables, by rows; see [`Closures::evaluate_maps`](super::closures::Closures::evaluate_maps).
    pub(super) map: Vec<f64>,
}

/// How an independent variable moves a cluster.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Free {
    /// As this coordinate.
    Coordinate(usize),
    /// As what this row measures.
    Row(usize),
}

/// Clusters of closures; `None` where one has not as many rows as dependent coordinates.
pub(super) fn clusters(
    all: &[Closure],
    dependent: &[usize],
    sources: &[Source],
) -> Option<Vec<Cluster>> {
    // Each closure's cluster is the first closure it is tied to by a dependent coordinate.
    let mut cluster: Vec<usize> = (0..all.len()).collect();
    let mut owner = vec![None; sources.len()];
    for (at, closure) in all.iter().enumerate() {
        let own = closure.path.iter().map(|(k, _)| *k);
        for k in own.filter(|&k| sources[k] == Source::Dependent) {
            let other = *owner[k].get_or_insert(at);
            let (from, to) = (cluster[at].max(cluster[other]), cluster[at].min(cluster[other]));
            cluster.iter_mut().filter(|c| **c == from).for_each(|c| *c = to);
        }
    }
    let mut out = Vec::new();
    for first in 0..all.len() {
        let own = || all.iter().zip(&cluster).filter(|(_, c)| **c == first).map(|(own, _)| own);
        let rows: Vec<usize> = own().flat_map(|c| c.first..c.first + c.rows.len()).collect();
        if rows.is_empty() {
            continue;
        }
        let (mut columns, mut free) = (Vec::new(), Vec::new());
        for closure in own() {
            for &(k, _) in &closure.path {
                match sources[k] {
                    Source::Dependent => columns.push(dependent.binary_search(&k).ok()?),
                    Source::Independent(p) => free.push((p, Free::Coordinate(k))),
                    Source::Driven(..) => {}
                }
            }
            if let Origin::Deformations(_) = closure.origin {
                for (at, (_, p)) in closure.rows.iter().enumerate() {
                    free.push((*p, Free::Row(closure.first + at)));
                }
            }
        }
        columns.sort_unstable();
        columns.dedup();
        free.sort_unstable_by_key(|(p, _)| *p);
        free.dedup();
        let n = rows.len();
        if columns.len() != n {
            return None;
        }
        out.push(Cluster {
            square: vec![0.0; n * n],
            square_entries: Vec::new(),
            map_entries: Vec::new(),
            inverse: vec![0.0; n * n],
            lu: DenseLu::new(n),
            map: vec![0.0; n * free.len()],
            row_scale: Vec::new(),
            column_scale: Vec::new(),
            is_open: true,
            size: 0.0,
            before: 0.0,
            residual: 0.0,
            noise: 0.0,
            rows,
            dependent: columns,
            free,
        });
    }
    let solved: usize = out.iter().map(|c| c.rows.len()).sum();
    (solved == dependent.len()).then_some(out)
}

impl Cluster {
    /// Changes of its dependent coordinates, in their order, that make up for residuals of its rows among those of all.
    pub(super) fn make_up(&self, r: &[f64], changes: &mut [f64]) {
        for (out, (&row, scale)) in changes.iter_mut().zip(self.rows.iter().zip(&self.row_scale)) {
            *out = -r[row] * scale;
        }
        self.lu.solve(changes);
        changes.iter_mut().zip(&self.column_scale).for_each(|(x, scale)| *x *= scale);
    }

    /// Changes of its dependent coordinates, by their places among all, after a solution.
    pub(super) fn changes<'a>(&'a self, r: &'a [f64]) -> impl Iterator<Item = (usize, f64)> + 'a {
        self.dependent.iter().map(|&at| (at, r[at]))
    }

    /// Derivatives of each dependent coordinate by the independent variables.
    pub(super) fn map_rows(&self) -> impl Iterator<Item = &[f64]> {
        self.map.chunks_exact(self.free.len().max(1))
    }

    /// Where its own numbers come from, and their scales.
    pub(super) fn find_entries(
        &mut self,
        all: &[Closure],
        dependent: &[usize],
        row_scale: &[f64],
        column_scale: &[f64],
    ) {
        let (n, free) = (self.rows.len(), self.free.len());
        self.row_scale = self.rows.iter().map(|&row| row_scale[row]).collect();
        self.column_scale = self.dependent.iter().map(|&at| column_scale[dependent[at]]).collect();
        for closure in all {
            for at in 0..closure.rows.len() {
                let row = closure.first + at;
                let Some(own) = self.rows.iter().position(|&other| other == row) else { continue };
                for (&(k, _), from) in closure.path.iter().zip(closure.entries(at)) {
                    if let Some(c) = self.dependent.iter().position(|&at| dependent[at] == k) {
                        let scale = row_scale[row] * column_scale[k];
                        self.square_entries.push(Entry { at: own * n + c, from, scale });
                    }
                    let kind = Free::Coordinate(k);
                    if let Some(c) = self.free.iter().position(|(_, other)| *other == kind) {
                        let scale = -row_scale[row];
                        self.map_entries.push(Entry { at: own * free + c, from, scale });
                    }
                }
            }
        }
    }
}
