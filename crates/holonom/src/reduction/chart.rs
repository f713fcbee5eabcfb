//! The factored matrix [G; P] of one parametrization, and the only solves made with it.

use super::body_rows::BodyRows;
use super::parametrization::{Parametrization, Projection, largest_index};
use super::recent::RecentPoints;
use super::relatives::Relatives;
use super::square::Square;
use crate::error::EvaluationFailure;
use crate::system::{Measure, System};
use holonom_linalg::{Assembly, BlockForest, BlockMatrix, Pivots, Terms};
use std::sync::Arc;

/// Enough to tell the smallest singular value from the next where the matrix is nearly singular.
const INVERSE_ITERATIONS: u32 = 4;

/// [G; P] with kept rows, scaled to pure numbers, factored with a fixed pattern.
///
/// Rows in metres are divided by the characteristic length and columns of translations multiplied by
/// it, so that pivoting and condition compare metres with radians fairly; the scaling never shows
/// outside.
#[derive(Debug, Clone)]
pub struct Chart {
    parametrization: Parametrization,
    matrix: Square,
    /// Of entries of G that can differ from zero and of rows of P that move, with their scale.
    assembly: Assembly<(Source, f64)>,
    row_scale: Arc<[f64]>,
    column_scale: Arc<[f64]>,
    /// Rows of P that move.
    moving: BodyRows,
    work: Vec<f64>,
    nonzero: Arc<[bool]>,
    /// Symbolic analyses made for this chart.
    analyses: u64,
}

/// Matrices whose values stand in it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Jacobian,
    Moving,
}

/// What a configuration makes of a chart: numbers and factors, with their pivots.
#[derive(Debug, Clone)]
pub(super) struct Factors {
    matrix: Square,
    moving: BodyRows,
}

fn scale_of(measure: Measure, length: f64) -> f64 {
    match measure {
        Measure::Length => length,
        Measure::Angle => 1.0,
    }
}

/// The scaled matrix by blocks of bodies, for who goes along the forest.
#[derive(Debug, Clone, Copy)]
pub(super) struct BodyBlocks<'a> {
    /// E and F of every body, of the configuration last factored.
    pub(super) values: &'a [f64],
    pub(super) row_scale: &'a [f64],
    pub(super) column_scale: &'a [f64],
    /// Rows of G; those of P come after them.
    pub(super) kept: &'a [usize],
}

impl Chart {
    /// Analyses and factors [G; P] at a configuration `q` with Jacobian `g`; `nonzero` tells which stored
    /// values of G can differ from zero.
    ///
    /// # Errors
    /// When the matrix is singular there.
    pub fn new(
        system: &dyn System,
        parametrization: Parametrization,
        q: &[f64],
        g: &BlockMatrix,
        nonzero: &Arc<[bool]>,
    ) -> Result<Self, EvaluationFailure> {
        let structure = system.structure();
        let length = system.characteristic_length();
        let n = structure.sizes.coordinates;
        let rank = parametrization.kept.len();
        let column_scale: Vec<f64> =
            (0..n).map(|i| scale_of(structure.coordinate_measure(i), length)).collect();
        let mut row_scale: Vec<f64> = parametrization
            .kept
            .iter()
            .map(|&r| 1.0 / scale_of(structure.row_measure[r], length))
            .collect();
        let mut position = vec![usize::MAX; structure.sizes.rows];
        for (k, &row) in parametrization.kept.iter().enumerate() {
            position[row] = k;
        }
        let mut terms = Terms::default();
        for (at, (row, column)) in g.entries(0, 0).into_iter().enumerate() {
            let k = position[row];
            if nonzero[at] && k != usize::MAX {
                let scale = row_scale[k] * column_scale[column];
                terms.add((Source::Jacobian, scale), [(at, (k, column))]);
            }
        }
        let mut constants = Vec::new();
        match &parametrization.projection {
            Projection::Selection(independent) => {
                for (k, &i) in independent.iter().enumerate() {
                    row_scale.push(1.0 / column_scale[i]);
                    constants.push(((rank + k, i), 1.0));
                }
            }
            Projection::Basis(rows) => {
                for (k, row) in rows.chunks_exact(n).enumerate() {
                    row_scale.push(1.0);
                    let row = row.iter().enumerate().filter(|(_, x)| **x != 0.0);
                    constants.extend(row.map(|(i, x)| ((rank + k, i), x * column_scale[i])));
                }
            }
            Projection::Relative(_) => {}
        }
        let constant_places = terms.keep(constants.iter().map(|(place, _)| *place));
        let moving = BodyRows::new(system, &parametrization);
        let scales: Vec<f64> = (0..moving.len())
            .map(|k| 1.0 / scale_of(parametrization.measure(system, k), length))
            .collect();
        for (at, k, column) in moving.entries() {
            let scale = column_scale[column] * scales[k];
            terms.add((Source::Moving, scale), [(at, (rank + k, column))]);
        }
        row_scale.extend(scales);
        let (mut matrix, slots) = Square::new(system, terms.places());
        for (slot, (_, x)) in slots[constant_places].iter().zip(constants) {
            matrix.values[*slot] = x;
        }
        let mut chart = Self {
            parametrization,
            matrix,
            assembly: terms.in_slots(&slots),
            row_scale: row_scale.into(),
            column_scale: column_scale.into(),
            moving,
            work: vec![0.0; n],
            nonzero: nonzero.clone(),
            analyses: 0,
        };
        chart.refactor(system, q, g)?;
        Ok(chart)
    }

    /// The chart of another parametrization of the same system, at a configuration `q` with Jacobian
    /// `g`.
    ///
    /// # Errors
    /// When the matrix is singular there.
    pub fn with_parametrization(
        &self,
        system: &dyn System,
        parametrization: Parametrization,
        q: &[f64],
        g: &BlockMatrix,
    ) -> Result<Self, EvaluationFailure> {
        Self::new(system, parametrization, q, g, &self.nonzero)
    }

    /// A copy with this chart's pattern, scales and pivots for other numbers of the same structure, with the same bodies of
    /// relative coordinates in the same order;
    /// `None` if the parametrization is another one.
    ///
    /// # Errors
    /// When the matrix is singular there.
    pub fn with_values(
        &self,
        system: &dyn System,
        parametrization: &Parametrization,
        q: &[f64],
        g: &BlockMatrix,
    ) -> Result<Option<Self>, EvaluationFailure> {
        if !self.parametrization.same_as(parametrization) {
            return Ok(None);
        }
        let mut chart = self.clone();
        chart.analyses = 0;
        chart.parametrization = parametrization.clone();
        chart.refactor(system, q, g)?;
        Ok(Some(chart))
    }

    /// The rows of P that move, of the configuration last factored.
    pub fn moving(&self) -> &BodyRows {
        &self.moving
    }

    /// Which stored values of G can differ from zero.
    pub(super) fn nonzero(&self) -> &Arc<[bool]> {
        &self.nonzero
    }

    /// Symbolic analyses made for this chart.
    pub fn analyses(&self) -> u64 {
        self.analyses
    }

    /// Makes room for several right-hand sides at a time, for who solves for them in a step.
    pub fn reserve_lanes(&mut self) {
        self.matrix.reserve_lanes();
    }

    /// The matrix by blocks of bodies, where it has the shape of the forest.
    pub(super) fn body_blocks(&self) -> Option<BodyBlocks<'_>> {
        self.matrix.forest().map(|_| BodyBlocks {
            values: &self.matrix.values,
            row_scale: &self.row_scale,
            column_scale: &self.column_scale,
            kept: &self.parametrization.kept,
        })
    }

    /// The shape of the forest, where the matrix has that.
    pub fn forest(&self) -> Option<&Arc<BlockForest>> {
        self.matrix.forest()
    }

    /// Which rows and coordinates are used.
    pub fn parametrization(&self) -> &Parametrization {
        &self.parametrization
    }

    /// Number of degrees of freedom.
    pub fn ndof(&self) -> usize {
        self.parametrization.ndof
    }

    /// The relative coordinates, if v is made of them.
    pub(super) fn relatives_mut(&mut self) -> Option<&mut Relatives> {
        match &mut self.parametrization.projection {
            Projection::Relative(relatives) => Some(relatives),
            _ => None,
        }
    }

    /// Factors [G; P] for a new configuration with the frozen pivots; picks new ones when they no longer serve.
    ///
    /// # Errors
    /// When the matrix is singular.
    pub fn refactor(
        &mut self,
        system: &dyn System,
        q: &[f64],
        g: &BlockMatrix,
    ) -> Result<(), EvaluationFailure> {
        self.matrix.restore();
        self.moving.evaluate(system, &self.parametrization, q);
        let of = |(source, scale)| match source {
            Source::Jacobian => (g.values(), scale),
            Source::Moving => (self.moving.values(), scale),
        };
        self.assembly.write(of, &mut self.matrix.values);
        self.analyses += self.matrix.factor().map_err(|e| singular(system, e))?;
        Ok(())
    }

    /// Gives up the room of numbers that the next [`Chart::refactor`] makes anew.
    pub(super) fn release(&mut self) {
        // Constants among the rows of P are written once.
        if self.parametrization.linear() == 0 {
            self.matrix.release();
            self.moving.release();
        }
    }

    /// x = Pᵀ p, P of the configuration last factored.
    pub fn extend(&self, p: &[f64], x: &mut [f64]) {
        x.fill(0.0);
        let (linear, moving) = p.split_at(self.parametrization.linear());
        match &self.parametrization.projection {
            Projection::Selection(independent) => {
                for (p, &i) in linear.iter().zip(independent) {
                    x[i] = *p;
                }
            }
            Projection::Basis(rows) => {
                for (p, row) in linear.iter().zip(rows.chunks_exact(x.len())) {
                    for (out, a) in x.iter_mut().zip(row) {
                        *out += a * p;
                    }
                }
            }
            Projection::Relative(_) => {}
        }
        self.moving.multiply_transposed_many_add(1.0, moving, 1, x);
    }

    /// A copy of the factors at hand.
    fn factors(&self) -> Factors {
        Factors { matrix: self.matrix.clone(), moving: self.moving.clone() }
    }

    /// Whether recoveries of positions iterate: relative coordinates of a tree tell them at once.
    pub(super) fn iterates(&self) -> bool {
        !self.parametrization.relatives().is_some_and(|relatives| relatives.exact)
    }

    /// Room for configurations recovered lately.
    pub(super) fn recent_points(&self, coordinates: usize, edges: usize) -> RecentPoints<Factors> {
        RecentPoints::new(self.iterates(), || self.factors(), coordinates, edges)
    }

    /// Exchanges the factors at hand for others of this chart.
    pub(super) fn exchange(&mut self, other: &mut Factors) {
        std::mem::swap(&mut self.matrix, &mut other.matrix);
        std::mem::swap(&mut self.moving, &mut other.moving);
    }

    /// Takes over the numbers of another chart of the same parametrization.
    pub fn copy_from(&mut self, other: &Self) {
        self.moving.copy_from(&other.moving);
        self.matrix.copy_from(&other.matrix);
    }

    /// x = S r + D p: solves [G; P] x = [r; p]. `rows` has all m rows; dropped ones are not read.
    pub fn solve(&mut self, rows: &[f64], p: &[f64], x: &mut [f64]) {
        let rank = self.parametrization.kept.len();
        for (k, &row) in self.parametrization.kept.iter().enumerate() {
            self.work[k] = rows[row] * self.row_scale[k];
        }
        for (k, &value) in p.iter().enumerate() {
            self.work[rank + k] = value * self.row_scale[rank + k];
        }
        self.matrix.solve(&mut self.work);
        for ((out, y), scale) in x.iter_mut().zip(&self.work).zip(&*self.column_scale) {
            *out = y * scale;
        }
    }

    /// rows = Sᵀ x and p = Dᵀ x; dropped rows are set to zero.
    pub fn solve_transposed(&mut self, x: &[f64], rows: &mut [f64], p: &mut [f64]) {
        let rank = self.parametrization.kept.len();
        for ((y, x), scale) in self.work.iter_mut().zip(x).zip(&*self.column_scale) {
            *y = x * scale;
        }
        self.matrix.solve_transposed(&mut self.work);
        rows.fill(0.0);
        for (k, &row) in self.parametrization.kept.iter().enumerate() {
            rows[row] = self.work[k] * self.row_scale[k];
        }
        for (k, out) in p.iter_mut().enumerate() {
            *out = self.work[rank + k] * self.row_scale[rank + k];
        }
    }

    /// The pivots of the factors, where their pattern tells zeros of solutions: of a sparse LU that needs no refinement.
    pub fn pivots(&self) -> Option<Pivots> {
        self.matrix.pivots()
    }

    /// Columns in which coordinates differ from zero that solve for rows with these columns, by a bit for each; with the
    /// transpose columns of rows for coordinates. Rows are the kept ones of G and those of P. Only where there are
    /// [`pivots`](Self::pivots).
    pub fn reach(&self, transposed: bool, columns: &mut [u32], room: &mut Vec<u32>) {
        self.matrix.reach(transposed, columns, room);
    }

    /// D, n×ndof by rows, into `d`.
    pub fn null_space(&mut self, d: &mut [f64]) {
        let (rank, ndof) = (self.parametrization.kept.len(), self.ndof());
        if self.matrix.refines() {
            for k in 0..ndof {
                self.work.fill(0.0);
                self.work[rank + k] = self.row_scale[rank + k];
                self.matrix.solve(&mut self.work);
                for ((row, y), scale) in
                    d.chunks_exact_mut(ndof).zip(&self.work).zip(&*self.column_scale)
                {
                    row[k] = y * scale;
                }
            }
            return;
        }
        d.fill(0.0);
        for k in 0..ndof {
            d[(rank + k) * ndof + k] = 1.0;
        }
        self.matrix.solve_scaled_many(d, ndof, false, [&self.row_scale, &self.column_scale]);
    }

    /// X = S R + D [0; Q] for R (m×k, by rows) and Q (moving rows×k) into `x` (n×k); dropped rows
    /// are not read.
    pub fn solve_rows_many(&mut self, rows: &[f64], moving: &[f64], k: usize, x: &mut [f64]) {
        if k == 0 {
            return;
        }
        x.fill(0.0);
        for (out, &row) in x.chunks_exact_mut(k).zip(&*self.parametrization.kept) {
            out.copy_from_slice(&rows[row * k..(row + 1) * k]);
        }
        x[(self.row_scale.len() - self.moving.len()) * k..].copy_from_slice(moving);
        self.matrix.solve_scaled_many(x, k, false, [&self.row_scale, &self.column_scale]);
    }

    /// p = DᵀX (ndof×ndof), and SᵀX (m×ndof) in place of X (n×ndof): `x`, which has room for both, begins with them.
    pub fn solve_transposed_many(&mut self, m: usize, x: &mut [f64], p: &mut [f64]) {
        let (rank, ndof) = (self.parametrization.kept.len(), self.ndof());
        if ndof == 0 {
            return;
        }
        let own = &mut x[..self.row_scale.len() * ndof];
        self.matrix.solve_scaled_many(own, ndof, true, [&self.column_scale, &self.row_scale]);
        p.copy_from_slice(&own[rank * ndof..]);
        if rank == m {
            return; // none is dropped
        }
        // Kept rows are in their order: none is overwritten before it has been moved.
        let mut end = m * ndof;
        for (k, &row) in self.parametrization.kept.iter().enumerate().rev() {
            let at = row * ndof;
            if k < row {
                x.copy_within(k * ndof..(k + 1) * ndof, at);
            }
            x[at + ndof..end].fill(0.0);
            end = at;
        }
        x[..end].fill(0.0);
    }

    /// Estimate of the condition number of the scaled matrix, 1-norm.
    pub fn condition(&mut self) -> f64 {
        self.matrix.condition()
    }

    /// Row and coordinate with the largest part in the singular vectors of the smallest singular
    /// value: what becomes undetermined near a singular configuration. By inverse iteration.
    pub fn weakest(&mut self) -> (Option<usize>, usize) {
        let mut row = None;
        self.work.fill(1.0);
        for _ in 0..INVERSE_ITERATIONS {
            self.matrix.solve_transposed(&mut self.work);
            row = Some(largest_index(&self.work[..self.parametrization.kept.len()]));
            normalize(&mut self.work);
            self.matrix.solve(&mut self.work);
            normalize(&mut self.work);
        }
        (row.and_then(|k| self.parametrization.kept.get(k).copied()), largest_index(&self.work))
    }

    /// Entries stored in the factors.
    pub fn fill(&self) -> usize {
        self.matrix.fill()
    }

    /// Sign of det [G; P].
    pub fn determinant_sign(&self) -> f64 {
        self.matrix.determinant_sign()
    }
}

fn normalize(x: &mut [f64]) {
    let size = x.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    if size.is_normal() {
        x.iter_mut().for_each(|v| *v /= size);
    }
}

fn singular(system: &dyn System, e: holonom_linalg::SingularMatrix) -> EvaluationFailure {
    EvaluationFailure::new(
        "simulation/singular-configuration",
        format!(
            "the joints leave coordinate `{}` undetermined here",
            system.coordinate_name(e.column)
        ),
    )
    .of_coordinate(e.column)
}
