//! The rows of P that move with the bodies, and their derivatives.

use super::parametrization::Parametrization;
use super::relatives::{Relatives, WIDEST};
use crate::system::{State, System};
use crate::threads::Threads;
use holonom_linalg::add_entries;
use std::sync::Arc;

/// Rows of an n-column matrix with entries in the columns of two bodies each.
#[derive(Debug, Clone)]
pub struct BodyRows {
    rows: usize,
    per_body: usize,
    /// 2·per_body per row.
    values: Vec<f64>,
    /// Entries that can differ from zero: place in the values, row, column.
    entries: Arc<[(u32, u32, u32)]>,
}

impl BodyRows {
    /// Zero rows for the relative coordinates of a parametrization; none for another one.
    pub fn new(system: &dyn System, parametrization: &Parametrization) -> Self {
        let sizes = system.structure().sizes;
        let n = sizes.per_body;
        let rows = parametrization.relatives().map_or(0, |r| r.rows.len());
        let mut out =
            Self { rows, per_body: n, values: vec![0.0; rows * 2 * n], entries: Arc::default() };
        let mut entries = Vec::new();
        let Some(relatives) = parametrization.relatives() else { return out };
        // What vanishes at a generic configuration vanishes everywhere.
        let generic: Vec<f64> = (0..sizes.coordinates)
            .map(|i| 0.2 + (0.618_033_988_749_895 * (i + 1) as f64).fract())
            .collect();
        out.evaluate(system, parametrization, &generic);
        for (row, (group, _)) in relatives.rows.iter().enumerate() {
            for (side, body) in system.relative_groups()[*group].bodies.into_iter().enumerate() {
                let Some(body) = body else { continue };
                for (at, i) in ((2 * row + side) * n..).zip(sizes.of_body(body)) {
                    if out.values[at] != 0.0 {
                        entries.push([at, row, i].map(|x| x as u32).into());
                    }
                }
            }
        }
        out.values.fill(0.0);
        out.entries = entries.into();
        out
    }

    /// Gives up the room of the values until they are evaluated.
    pub(super) fn release(&mut self) {
        self.values = Vec::new();
    }

    /// Number of rows.
    #[allow(clippy::len_without_is_empty, reason = "a matrix")]
    pub fn len(&self) -> usize {
        self.rows
    }

    /// All entries that can differ from zero: place in the values, row, column.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, usize)> + Clone + '_ {
        self.entries.iter().map(|&(at, row, j)| (at as usize, row as usize, j as usize))
    }

    /// Takes over the values of rows for the same coordinates.
    pub fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
    }

    /// All values.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// The value at a place of [`BodyRows::entries`].
    pub fn value(&self, at: usize) -> f64 {
        self.values[at]
    }

    /// Makes the rows those of P.
    pub fn evaluate(&mut self, system: &dyn System, parametrization: &Parametrization, q: &[f64]) {
        let Some(relatives) = parametrization.relatives() else { return };
        let n = self.per_body;
        self.values.resize(self.rows * 2 * n, 0.0);
        let mut gradient = [0.0; WIDEST];
        for (group, range) in relatives.runs() {
            let gradient = &mut gradient[..system.relative_groups()[group].rows * 2 * n];
            system.relative_gradient(group, &relatives.references[group], q, gradient);
            for k in range {
                let row = &gradient[relatives.rows[k].1 * 2 * n..][..2 * n];
                self.values[k * 2 * n..(k + 1) * 2 * n].copy_from_slice(row);
            }
        }
    }

    /// Makes the rows (P q̇)_q and those of `bend` (v̈)_q at fixed q̈.
    pub fn evaluate_blocks(
        &mut self,
        bend: &mut Self,
        system: &dyn System,
        parametrization: &Parametrization,
        state: &State,
        threads: &Threads,
    ) {
        let Some(relatives) = parametrization.relatives() else { return };
        let at = Moving { relatives, system, state, threads, width: 2 * self.per_body };
        at.blocks(0, &mut self.values, &mut bend.values);
    }

    /// Y += α A X, X with k columns, both by rows.
    pub fn multiply_many_add(&self, alpha: f64, x: &[f64], k: usize, y: &mut [f64]) {
        let entries = self.entries().map(|(at, row, j)| (row, j, alpha * self.values[at]));
        add_entries(entries, x, k, y);
    }

    /// X += α Aᵀ Y, Y with k columns, both by rows.
    pub fn multiply_transposed_many_add(&self, alpha: f64, y: &[f64], k: usize, x: &mut [f64]) {
        let entries = self.entries().map(|(at, row, j)| (j, row, alpha * self.values[at]));
        add_entries(entries, y, k, x);
    }
}

/// Rows of the smallest piece of work that threads share.
const GRAIN: usize = 32;

/// Where derivatives of rows are taken.
struct Moving<'a> {
    relatives: &'a Relatives,
    system: &'a dyn System,
    state: &'a State,
    threads: &'a Threads,
    width: usize,
}

impl Moving<'_> {
    /// (P q̇)_q and (v̈)_q of the rows from `first` on, which begin a group.
    fn blocks(&self, first: usize, a0: &mut [f64], a1: &mut [f64]) {
        let (rows, width) = (&self.relatives.rows, self.width);
        let count = a0.len() / width;
        if count > GRAIN && self.threads.are_several() {
            let mut half = count / 2;
            while half < count && rows[first + half].0 == rows[first + half - 1].0 {
                half += 1;
            }
            if half < count {
                let (a0, later_a0) = a0.split_at_mut(half * width);
                let (a1, later_a1) = a1.split_at_mut(half * width);
                self.threads.join(
                    || self.blocks(first, a0, a1),
                    || self.blocks(first + half, later_a0, later_a1),
                );
                return;
            }
        }
        let (mut of_a0, mut of_a1) = ([0.0; WIDEST], [0.0; WIDEST]);
        let mut last = None;
        let targets = a0.chunks_exact_mut(width).zip(a1.chunks_exact_mut(width));
        for (&(group, row), (a0, a1)) in rows[first..].iter().zip(targets) {
            let size = self.system.relative_groups()[group].rows * width;
            if last.replace(group) != Some(group) {
                let reference = &self.relatives.references[group];
                let (of_a0, of_a1) = (&mut of_a0[..size], &mut of_a1[..size]);
                self.system.relative_blocks(group, reference, self.state, of_a0, of_a1);
            }
            a0.copy_from_slice(&of_a0[row * width..(row + 1) * width]);
            a1.copy_from_slice(&of_a1[row * width..(row + 1) * width]);
        }
    }
}
