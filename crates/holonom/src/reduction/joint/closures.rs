//! What closes loops: rows of cut joints, and deformations that are independent variables.

use super::clusters::{Cluster, Free, clusters};
use crate::math::vector::larger;
use crate::reduction::parametrization::Parametrization;
use crate::reduction::relatives::{Relatives, Source};
use crate::system::{Measure, System};
use holonom_linalg::{DenseLu, SingularMatrix};
use std::ops::Range;

/// Where the rows of a closure come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Origin {
    /// A joint or driver, by its place in the structure.
    Joint(usize),
    /// A group of relative coordinates.
    Deformations(usize),
}

/// Rows between two bodies.
#[derive(Debug, Clone)]
pub(super) struct Closure {
    pub(super) origin: Origin,
    pub(super) ends: [Option<usize>; 2],
    /// Rows of the element that are in use, each with its constraint row or independent variable.
    pub(super) rows: Vec<(usize, usize)>,
    /// Place of the first of them among all.
    pub(super) first: usize,
    /// Number of rows of the element.
    pub(super) count: usize,
    /// Coordinates between the bodies, each with the end that it moves.
    pub(super) path: Vec<(usize, usize)>,
    /// Its cluster; none where no row is in use.
    pub(super) cluster: Option<usize>,
    /// Where the entries of its rows begin in [`Closures::matrix`]: a column for each coordinate of the path.
    pub(super) start: usize,
}

impl Closure {
    /// Entries of its row `at` along the path.
    pub(super) fn entries(&self, at: usize) -> impl Iterator<Item = usize> {
        (self.start + at..).step_by(self.rows.len()).take(self.path.len())
    }

    /// r += N x for its R rows.
    fn multiply_add<const R: usize>(&self, matrix: &[f64], x: &[f64], r: &mut [f64]) {
        let mut sums = [0.0; R];
        for (column, &(k, _)) in matrix.as_chunks::<R>().0.iter().zip(&self.path) {
            let x = x[k];
            for i in 0..R {
                sums[i] += column[i] * x;
            }
        }
        r.iter_mut().zip(sums).for_each(|(r, sum)| *r += sum);
    }

    /// x −= Nᵀ y.
    fn subtract_transposed<const R: usize>(&self, matrix: &[f64], y: &[f64], x: &mut [f64]) {
        let y: &[f64; R] = y.first_chunk().expect("R rows");
        for (column, &(k, _)) in matrix.as_chunks::<R>().0.iter().zip(&self.path) {
            for i in 0..R {
                x[k] -= column[i] * y[i];
            }
        }
    }

    /// x += |N|ᵀ |y|.
    fn add_sizes<const R: usize>(&self, matrix: &[f64], y: &[f64], x: &mut [f64]) {
        let y: &[f64; R] = y.first_chunk().expect("R rows");
        for (column, &(k, _)) in matrix.as_chunks::<R>().0.iter().zip(&self.path) {
            for i in 0..R {
                x[k] += (column[i] * y[i]).abs();
            }
        }
    }
}

/// Calls what is made for the number of rows of a closure.
macro_rules! by_rows {
    ($closure:expr, $kernel:ident, $($argument:expr),*) => {
        match $closure.rows.len() {
            1 => $closure.$kernel::<1>($($argument),*),
            2 => $closure.$kernel::<2>($($argument),*),
            3 => $closure.$kernel::<3>($($argument),*),
            4 => $closure.$kernel::<4>($($argument),*),
            5 => $closure.$kernel::<5>($($argument),*),
            6 => $closure.$kernel::<6>($($argument),*),
            _ => {}
        }
    };
}

/// All of them, with the matrix N of their rows over the coordinates and the factors of its dependent columns, scaled to
/// pure numbers.
#[derive(Debug, Clone)]
pub(super) struct Closures {
    pub(super) all: Vec<Closure>,
    /// Columns of the dependent coordinates.
    pub(super) dependent: Vec<usize>,
    /// Those that are angles, of which a configuration tells no turns.
    pub(super) angles: Vec<usize>,
    pub(super) clusters: Vec<Cluster>,
    /// Entries of all rows along the paths of their closures, see [`Closure::entries`].
    pub(super) matrix: Vec<f64>,
    pub(super) column_scale: Vec<f64>,
    work: Vec<f64>,
    right: Vec<f64>,
}

/// What a configuration makes of closures.
#[derive(Debug, Clone)]
pub(super) struct Numbers {
    matrix: Vec<f64>,
    factors: Vec<DenseLu>,
}

impl Closures {
    /// `path` lists the coordinates of the edges from a body to its root, each with its body.
    pub(super) fn new(
        system: &dyn System,
        parametrization: &Parametrization,
        relatives: &Relatives,
        coordinates: &[(Source, Measure)],
        path: impl Fn(Option<usize>) -> Vec<Range<usize>>,
    ) -> Option<Self> {
        let structure = system.structure();
        let length = system.characteristic_length();
        let scale = |measure: Measure| if measure == Measure::Length { length } else { 1.0 };
        let between = |ends: [Option<usize>; 2]| {
            let [a, b] = ends.map(&path);
            let only = |own: &[Range<usize>], other: &[Range<usize>], end: usize| {
                let own = own.iter().filter(|range| !other.contains(range));
                own.flat_map(|range| range.clone().map(|k| (k, end))).collect::<Vec<_>>()
            };
            let mut out = only(&a, &b, 0);
            out.extend(only(&b, &a, 1));
            out
        };
        let (mut all, mut row_scale, mut start) = (Vec::new(), Vec::new(), 0);
        for closure in &system.tree().closures {
            let joint = structure.joints.iter().position(|joint| joint.row == closure.row)?;
            let kept = (0..closure.rows)
                .map(|k| (k, closure.row + k))
                .filter(|(_, row)| parametrization.kept.binary_search(row).is_ok());
            let rows: Vec<_> = kept.collect();
            let first = row_scale.len();
            row_scale.extend(rows.iter().map(|r| 1.0 / scale(structure.row_measure[r.1])));
            let (ends, count) = (closure.ends, closure.rows);
            let path = between(ends);
            let used = rows.len() * path.len();
            let (origin, cluster) = (Origin::Joint(joint), None);
            all.push(Closure { origin, ends, rows, first, count, path, cluster, start });
            start += used;
        }
        let own: Vec<usize> = coordinates
            .iter()
            .filter_map(|(source, _)| match source {
                Source::Independent(k) => Some(*k),
                _ => None,
            })
            .collect();
        for (group, range) in relatives.runs() {
            let rows: Vec<_> =
                range.filter(|k| !own.contains(k)).map(|k| (relatives.rows[k].1, k)).collect();
            if rows.is_empty() {
                continue;
            }
            let info = &system.relative_groups()[group];
            let measure = if info.kind.turns() { Measure::Angle } else { Measure::Length };
            let first = row_scale.len();
            row_scale.extend(rows.iter().map(|_| 1.0 / scale(measure)));
            let (ends, count) = (info.bodies, info.rows);
            let path = between(ends);
            let used = rows.len() * path.len();
            let origin = Origin::Deformations(group);
            let cluster = None;
            all.push(Closure { origin, ends, rows, first, count, path, cluster, start });
            start += used;
        }
        let dependent: Vec<usize> =
            (0..coordinates.len()).filter(|&k| coordinates[k].0 == Source::Dependent).collect();
        let angles = dependent.iter().copied();
        let angles = angles.filter(|&k| coordinates[k].1 == Measure::Angle).collect();
        let rows = row_scale.len();
        if dependent.len() != rows {
            return None;
        }
        let sources: Vec<Source> = coordinates.iter().map(|c| c.0).collect();
        let column_scale: Vec<f64> = coordinates.iter().map(|(_, m)| scale(*m)).collect();
        let mut clusters = clusters(&all, &dependent, &sources)?;
        for cluster in &mut clusters {
            cluster.find_entries(&all, &dependent, &row_scale, &column_scale);
        }
        for closure in all.iter_mut().filter(|closure| !closure.rows.is_empty()) {
            closure.cluster =
                clusters.iter().position(|cluster| cluster.rows.contains(&closure.first));
        }
        Some(Self {
            clusters,
            all,
            dependent,
            angles,
            matrix: vec![0.0; start],
            column_scale,
            work: vec![0.0; rows],
            right: vec![0.0; rows],
        })
    }

    pub(super) fn rows(&self) -> usize {
        self.dependent.len()
    }

    /// Rows of the largest cluster.
    pub(super) fn largest(&self) -> usize {
        self.clusters.iter().map(|cluster| cluster.rows.len()).max().unwrap_or(0)
    }

    /// A copy of the numbers at hand.
    pub(super) fn numbers(&self) -> Numbers {
        let factors = self.clusters.iter().map(|cluster| cluster.lu.clone()).collect();
        Numbers { matrix: self.matrix.clone(), factors }
    }

    /// Exchanges the numbers at hand for others.
    pub(super) fn exchange(&mut self, other: &mut Numbers) {
        std::mem::swap(&mut self.matrix, &mut other.matrix);
        for (cluster, lu) in self.clusters.iter_mut().zip(&mut other.factors) {
            std::mem::swap(&mut cluster.lu, lu);
        }
    }

    /// Takes over the numbers at hand of the same closures elsewhere.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.matrix.copy_from_slice(&other.matrix);
        for (own, other) in self.clusters.iter_mut().zip(&other.clusters) {
            own.square.copy_from_slice(&other.square);
            own.lu.copy_from(&other.lu);
        }
    }

    /// Factors the dependent columns.
    ///
    /// # Errors
    /// With the place of the coordinate in `dependent`.
    pub(super) fn factor(&mut self) -> Result<(), SingularMatrix> {
        for cluster in &mut self.clusters {
            for entry in &cluster.square_entries {
                cluster.square[entry.at] = self.matrix[entry.from] * entry.scale;
            }
            cluster.lu.factor(&cluster.square).map_err(|mut e| {
                e.column = cluster.dependent[e.column];
                e
            })?;
        }
        Ok(())
    }

    pub(super) fn determinant_sign(&self) -> f64 {
        self.clusters.iter().map(|cluster| cluster.lu.determinant_sign()).product()
    }

    /// 1-norm of the scaled matrix times that of its inverse.
    pub(super) fn condition(&mut self) -> f64 {
        let mut norms = [1.0f64; 2];
        for cluster in &mut self.clusters {
            let n = cluster.rows.len();
            cluster.inverse.fill(0.0);
            (0..n).for_each(|k| cluster.inverse[k * n + k] = 1.0);
            cluster.lu.solve_many(&mut cluster.inverse, n);
            for (norm, a) in norms.iter_mut().zip([&cluster.square, &cluster.inverse]) {
                for j in 0..n {
                    let column = a.chunks_exact(n).map(|row| row[j].abs()).sum::<f64>();
                    *norm = if column.is_nan() { f64::INFINITY } else { norm.max(column) };
                }
            }
        }
        norms[0] * norms[1]
    }

    /// r += N x.
    pub(super) fn multiply_add(&self, x: &[f64], r: &mut [f64]) {
        for closure in &self.all {
            let (matrix, r) = (&self.matrix[closure.start..], &mut r[closure.first..]);
            by_rows!(closure, multiply_add, matrix, x, r);
        }
    }

    /// x −= Nᵀ y.
    pub(super) fn subtract_transposed(&self, y: &[f64], x: &mut [f64]) {
        for closure in &self.all {
            let (matrix, y) = (&self.matrix[closure.start..], &y[closure.first..]);
            by_rows!(closure, subtract_transposed, matrix, y, x);
        }
    }

    /// x += |N|ᵀ |y|.
    pub(super) fn add_sizes(&self, y: &[f64], x: &mut [f64]) {
        for closure in &self.all {
            let (matrix, y) = (&self.matrix[closure.start..], &y[closure.first..]);
            by_rows!(closure, add_sizes, matrix, y, x);
        }
    }

    /// Changes `x` of the dependent coordinates for those of the independent variables, by the maps.
    pub(super) fn follow(&self, p: &[f64], x: &mut [f64]) {
        for cluster in &self.clusters {
            for (&at, row) in cluster.dependent.iter().zip(cluster.map_rows()) {
                let changes =
                    row.iter().zip(&cluster.free).map(|(by, (variable, _))| by * p[*variable]);
                x[self.dependent[at]] = changes.sum();
            }
        }
    }

    /// Adds to forces on the independent variables those along the dependent coordinates, by the maps.
    pub(super) fn follow_transposed(&self, along: &[f64], out: &mut [f64]) {
        for cluster in &self.clusters {
            for (&at, row) in cluster.dependent.iter().zip(cluster.map_rows()) {
                let force = along[self.dependent[at]];
                for (by, (variable, _)) in row.iter().zip(&cluster.free) {
                    out[*variable] += by * force;
                }
            }
        }
    }

    /// All clusters are to be corrected.
    pub(super) fn open(&mut self) {
        self.clusters.iter_mut().for_each(|cluster| cluster.is_open = true);
    }

    /// Whether the positions of a closure are still corrected.
    pub(super) fn is_open(&self, closure: &Closure) -> bool {
        closure.cluster.is_some_and(|cluster| self.clusters[cluster].is_open)
    }

    /// Keeps the largest residual of each open cluster; returns that of all of these.
    pub(super) fn keep_residuals(&mut self, r: &[f64]) -> f64 {
        let mut largest = 0.0;
        for cluster in self.clusters.iter_mut().filter(|cluster| cluster.is_open) {
            let sizes = cluster.rows.iter().map(|&row| r[row].abs());
            cluster.residual = sizes.fold(0.0, larger);
            largest = larger(largest, cluster.residual);
        }
        largest
    }

    /// Residuals of all rows become changes of the dependent coordinates that make up for them.
    pub(super) fn solve(&mut self, r: &mut [f64]) {
        self.solve_where(r, |_| true);
    }

    /// The same for open clusters; others have no changes.
    pub(super) fn solve_open(&mut self, r: &mut [f64]) {
        self.work.fill(0.0);
        self.solve_where(r, |cluster| cluster.is_open);
    }

    /// Into `x` the changes of the dependent coordinates of one cluster that make up for residuals of its rows.
    pub(super) fn solve_cluster(&mut self, cluster: usize, r: &[f64], x: &mut [f64]) {
        let cluster = &self.clusters[cluster];
        let right = &mut self.right[..cluster.rows.len()];
        cluster.make_up(r, right);
        for (change, &at) in right.iter().zip(&cluster.dependent) {
            x[self.dependent[at]] = *change;
        }
    }

    fn solve_where(&mut self, r: &mut [f64], takes_part: impl Fn(&Cluster) -> bool) {
        for cluster in self.clusters.iter().filter(|cluster| takes_part(cluster)) {
            let right = &mut self.right[..cluster.rows.len()];
            cluster.make_up(r, right);
            for (change, &at) in right.iter().zip(&cluster.dependent) {
                self.work[at] = *change;
            }
        }
        r.copy_from_slice(&self.work);
    }

    /// y with N_uᵀ y = r for forces r on the dependent coordinates.
    pub(super) fn solve_transposed(&mut self, r: &mut [f64]) {
        for cluster in &self.clusters {
            let right = &mut self.right[..cluster.rows.len()];
            for (out, (&at, scale)) in
                right.iter_mut().zip(cluster.dependent.iter().zip(&cluster.column_scale))
            {
                *out = r[at] * scale;
            }
            cluster.lu.solve_transposed(right);
            for (y, (&row, scale)) in right.iter().zip(cluster.rows.iter().zip(&cluster.row_scale))
            {
                self.work[row] = y * scale;
            }
        }
        r.copy_from_slice(&self.work);
    }

    /// Derivatives of the dependent coordinates of all clusters by the independent variables.
    pub(super) fn evaluate_maps(&mut self) {
        for cluster in &mut self.clusters {
            let free = cluster.free.len();
            if free == 0 {
                continue;
            }
            cluster.map.fill(0.0);
            for entry in &cluster.map_entries {
                cluster.map[entry.at] = self.matrix[entry.from] * entry.scale;
            }
            for ((out, &row), scale) in
                cluster.map.chunks_exact_mut(free).zip(&cluster.rows).zip(&cluster.row_scale)
            {
                let own = cluster.free.iter().position(|(_, kind)| *kind == Free::Row(row));
                if let Some(column) = own {
                    out[column] = *scale;
                }
            }
            cluster.lu.solve_many(&mut cluster.map, free);
            let scales = &cluster.column_scale;
            for (row, scale) in cluster.map.chunks_exact_mut(free).zip(scales) {
                row.iter_mut().for_each(|x| *x *= scale);
            }
        }
    }

    /// Cluster, place in its map, of a dependent coordinate.
    pub(super) fn place(&self, k: usize) -> Option<(usize, usize)> {
        let at = self.dependent.binary_search(&k).ok()?;
        self.clusters.iter().enumerate().find_map(|(c, cluster)| {
            Some((c, cluster.dependent.iter().position(|&other| other == at)?))
        })
    }
}
