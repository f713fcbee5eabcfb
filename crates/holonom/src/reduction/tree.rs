//! Choice of the relative coordinates that are independent.
//!
//! On a tree they are all coordinates of its edges: nothing is pivoted. Drivers on an edge remove their own
//! coordinate. Joints that close loops are eliminated, each cluster of loops that share edges by
//! itself: with A the rows of the closures in the coordinates of the cluster and N an orthonormal basis of
//! null(A),
//!
//! - deformations of stiff force elements come first, by their frequency² g M⁻¹gᵀ max(k, c/h) on the
//!   mechanism, h a tenth of the time in which the motion changes, each if it is independent of those before;
//! - coordinates of the forest fill up, the nearest to the root among those that are about as well
//!   conditioned as the best.
//!
//! Equations: `docs/theory/reduction.md` (27)-(35).

use super::chart::Chart;
use super::parametrization::{Parametrization, Projection};
use super::partitioning::RANK_TOLERANCE;
use super::relatives::{Relatives, Source};
use crate::error::EvaluationFailure;
use crate::system::{Anchor, Measure, Resistance, State, System};
use holonom_linalg::{BlockMatrix, Cholesky, full_pivot_elimination, orthonormal_null_space_qr};
use std::sync::Arc;

/// A force element is stiff if the square of its frequency is more than this times that of the motion:
/// it then keeps its deformation small and sets the pace if its direction turns.
const STIFF: f64 = 100.0;
/// Steps per unit of the motion's pace that an element's damper is judged by.
const STEPS: f64 = 10.0;
/// Amplitude of a stiff spring, against its length, up to which its direction is a coordinate.
const LARGEST_AMPLITUDE: f64 = 0.25;
/// Part of a deformation that must be independent of those taken before.
const INDEPENDENT: f64 = 0.1;
/// The coordinate nearest to the root is taken if it is as independent as this part of the best: the
/// inverse of the growth of the condition at which the choice is made again.
const NEARLY_BEST: f64 = 0.4;
/// Entries of A below this are round-off.
const NEGLIGIBLE: f64 = 1e-11;

/// A coordinate of the forest.
#[derive(Debug, Clone, Copy)]
struct Coordinate {
    edge: usize,
    at: usize,
    group: usize,
    row: usize,
}

/// The relative coordinates that are independent at a state with Jacobian `g`; `nonzero` tells which of its
/// values can differ from zero.
///
/// # Errors
/// `simulation/singular-configuration`.
pub(super) fn choose_tree(
    system: &dyn System,
    nonzero: &Arc<[bool]>,
    state: &State,
    g: &BlockMatrix,
) -> Result<Parametrization, EvaluationFailure> {
    let tree = system.tree();
    let rows = system.structure().sizes.rows;
    let pace = pace(system, state);
    let forms = forms(system, state, pace);
    let coordinates = coordinates(system, &forms);
    let mut relatives = at_state(system, state, forms, &coordinates);
    let mut closing = vec![false; rows];
    for closure in &tree.closures {
        closing[closure.row..closure.row + closure.rows].fill(true);
    }
    let driven: Vec<Option<usize>> = coordinates
        .iter()
        .map(|c| tree.edges[c.edge].driver.filter(|d| d.1 == c.at).map(|d| d.0))
        .collect();

    let clusters = clusters(system, state, pace);
    let mut choice = Selection {
        kept: (0..rows).filter(|&row| !closing[row]).collect(),
        rows: Vec::new(),
        pivot_ratio: 1.0,
    };
    let in_cluster = |c: &Coordinate| clusters.of_edge[c.edge].is_some();
    for (c, driven) in coordinates.iter().zip(&driven) {
        if driven.is_none() && !in_cluster(c) {
            choice.rows.push((c.group, c.row));
        }
    }
    if clusters.count > 0 {
        // All coordinates of the forest are independent where loops are open and drivers gone.
        let prescribing: Vec<usize> = driven.iter().flatten().copied().collect();
        let open = Parametrization {
            kept: choice.kept.iter().copied().filter(|row| !prescribing.contains(row)).collect(),
            dropped: Vec::new(),
            projection: Projection::Relative(Box::new(Relatives {
                rows: coordinates.iter().map(|c| (c.group, c.row)).collect(),
                ..relatives.clone()
            })),
            ndof: coordinates.len(),
            pivot_ratio: 1.0,
        };
        let mut chart = Chart::new(system, open, &state.q, g, nonzero)?;
        let edge_of = edge_of_body(system);
        for cluster in 0..clusters.count {
            let columns: Vec<usize> = (0..coordinates.len())
                .filter(|&k| {
                    clusters.of_edge[coordinates[k].edge] == Some(cluster) && driven[k].is_none()
                })
                .collect();
            let edges: Vec<bool> = clusters.of_edge.iter().map(|c| *c == Some(cluster)).collect();
            let relatives = &relatives;
            Cluster {
                system,
                state,
                g,
                pace,
                coordinates: &coordinates,
                relatives,
                columns,
                edges,
                edge_of: &edge_of,
            }
            .select(&mut chart, &mut choice)?;
        }
    }
    choice.kept.sort_unstable();
    choice.rows.sort_unstable();
    let dropped = (0..rows).filter(|row| choice.kept.binary_search(row).is_err()).collect();
    let groups = system.relative_groups();
    relatives.moves = choice.rows.iter().any(|(group, _)| groups[*group].reach.is_finite());
    relatives.has_alternatives =
        clusters.count > 0 || tree.edges.iter().any(|edge| edge.forms.len() > 1);
    for (k, c) in coordinates.iter().enumerate() {
        let source = &mut relatives.sources[c.edge][c.at];
        *source = match (driven[k], choice.rows.binary_search(&(c.group, c.row))) {
            (Some(row), _) => {
                let sign = tree.edges[c.edge].driver.map_or(1.0, |d| d.2);
                let value = relatives.anchors[c.edge].x[c.at];
                Source::Driven(row, sign, value - sign * system.prescribed(row, state.t))
            }
            (None, Ok(at)) => Source::Independent(at),
            (None, Err(_)) => Source::Dependent,
        };
    }
    let sources = coordinates.iter().map(|c| relatives.sources[c.edge][c.at]);
    relatives.exact = sources.into_iter().all(|source| source != Source::Dependent);
    relatives.rows = choice.rows;
    Ok(Parametrization {
        kept: choice.kept,
        dropped,
        ndof: relatives.rows.len(),
        projection: Projection::Relative(Box::new(relatives)),
        pivot_ratio: choice.pivot_ratio,
    })
}

/// Rows and independent coordinates chosen so far.
struct Selection {
    kept: Vec<usize>,
    rows: Vec<(usize, usize)>,
    pivot_ratio: f64,
}

/// The pace of the motion, 1/s: how fast bodies turn, or fall through the size of the model.
fn pace(system: &dyn System, state: &State) -> f64 {
    let length = system.characteristic_length();
    let mut pace = (system.gravity() / length).sqrt();
    for b in 0..system.structure().sizes.bodies {
        let body = system.body(b, &state.q, &state.v);
        pace = pace.max(norm(&body.angular_velocity));
    }
    pace.max(f64::MIN_POSITIVE)
}

/// Stiffness that counts at a pace: N/m or N m/rad.
fn effective(resistance: &Resistance, pace: f64) -> f64 {
    let damper = resistance.damping * STEPS * pace;
    if resistance.in_series {
        let sum = resistance.stiffness + damper;
        return if sum > 0.0 { resistance.stiffness * damper / sum } else { 0.0 };
    }
    resistance.stiffness.max(damper)
}

/// The form of each edge: a spring's direction is a coordinate while it is stiff enough to keep its length.
fn forms(system: &dyn System, state: &State, pace: f64) -> Vec<usize> {
    let tree = system.tree();
    let mut forms = vec![0; tree.edges.len()];
    let edge_of = edge_of_body(system);
    for (elastic, spring) in tree.elastic.iter().enumerate() {
        let [body] = spring.path[..] else { continue };
        let edge = edge_of[body];
        if !spring.is_edge || tree.edges[edge].forms.len() < 2 {
            continue;
        }
        let group = spring.groups[0];
        let bodies = system.relative_groups()[group].bodies;
        let (mut value, mut gradient) = ([0.0], [0.0; 14]);
        let n = system.structure().sizes.per_body;
        system.relative_value(group, &[0.0; 6], &state.q, &mut value);
        let [length] = value;
        let stiffness = effective(&system.resistance(elastic, 0, length), pace);
        let inverse: f64 = bodies.iter().flatten().map(|&b| 1.0 / system.mass(b)).sum();
        let square = stiffness * inverse;
        let stiff = square > STIFF * pace * pace && length > 0.0 && {
            system.relative_gradient(group, &[0.0; 6], &state.q, &mut gradient[..2 * n]);
            let mut rate = 0.0;
            for (row, body) in gradient.chunks_exact(n).zip(bodies) {
                if let Some(b) = body {
                    let v = &state.v[b * n..(b + 1) * n];
                    rate += row.iter().zip(v).map(|(a, x)| a * x).sum::<f64>();
                }
            }
            let free = system.free_length(elastic);
            let amplitude = (length - free).abs()
                + rate.abs() / square.sqrt()
                + (system.gravity() + pace * pace * length) / square;
            amplitude < LARGEST_AMPLITUDE * length
        };
        forms[edge] = usize::from(!stiff);
    }
    forms
}

fn coordinates(system: &dyn System, forms: &[usize]) -> Vec<Coordinate> {
    let mut out = Vec::new();
    for (edge, (tree, form)) in system.tree().edges.iter().zip(forms).enumerate() {
        let mut at = 0;
        for &group in &tree.forms[*form] {
            for row in 0..system.relative_groups()[group].rows {
                out.push(Coordinate { edge, at, group, row });
                at += 1;
            }
        }
    }
    out
}

/// Relative coordinates with references and anchors at a state; angles are on the branches of its windings.
fn at_state(
    system: &dyn System,
    state: &State,
    forms: Vec<usize>,
    coordinates: &[Coordinate],
) -> Relatives {
    let tree = system.tree();
    let groups = system.relative_groups();
    let mut relatives = Relatives {
        rows: Vec::new(),
        sources: vec![[Source::Dependent; 6]; tree.edges.len()],
        references: vec![[0.0; 6]; groups.len()],
        anchors: vec![Anchor::default(); tree.edges.len()],
        exact: true,
        has_alternatives: false,
        moves: false,
        forms,
    };
    let mut x = vec![[0.0; 6]; tree.edges.len()];
    for c in coordinates {
        if let Some(winding) = tree.edges[c.edge].winding
            && groups[c.group].kind == crate::system::RelativeKind::Angle
        {
            x[c.edge][c.at] = state.winding[winding];
        }
    }
    relatives.move_references(system, &state.q, None, &mut x, true);
    for elastic in &tree.elastic {
        for &group in elastic.groups.iter().filter(|_| !elastic.is_edge) {
            let reference = &mut relatives.references[group];
            *reference = system.moved_reference(group, &state.q, reference);
        }
    }
    relatives
}

/// Loops that share edges of the forest.
struct Clusters {
    of_edge: Vec<Option<usize>>,
    count: usize,
}

fn clusters(system: &dyn System, state: &State, pace: f64) -> Clusters {
    let tree = system.tree();
    let edge_of = edge_of_body(system);
    let mut parent: Vec<usize> = (0..tree.edges.len()).collect();
    let mut closed = vec![false; tree.edges.len()];
    let mut tie = |path: &[usize]| {
        for body in path {
            closed[edge_of[*body]] = true;
        }
        for pair in path.windows(2) {
            let (a, b) = (root(&mut parent, edge_of[pair[0]]), root(&mut parent, edge_of[pair[1]]));
            parent[a.max(b)] = a.min(b);
        }
    };
    for closure in &tree.closures {
        tie(&closure.path);
    }
    for (elastic, force) in tree.elastic.iter().enumerate() {
        if !force.is_edge && could_be_stiff(system, state, elastic, pace) {
            tie(&force.path);
        }
    }
    let mut number = vec![None; tree.edges.len()];
    let mut count = 0;
    let of_edge = (0..tree.edges.len())
        .map(|edge| {
            closed[edge].then(|| {
                *number[root(&mut parent, edge)].get_or_insert_with(|| {
                    count += 1;
                    count - 1
                })
            })
        })
        .collect();
    Clusters { of_edge, count }
}

/// The edge that places each body.
fn edge_of_body(system: &dyn System) -> Vec<usize> {
    let edges = &system.tree().edges;
    let mut out = vec![0; edges.len()];
    for (at, edge) in edges.iter().enumerate() {
        out[edge.body] = at;
    }
    out
}

fn root(parent: &mut [usize], mut at: usize) -> usize {
    while parent[at] != at {
        parent[at] = parent[parent[at]];
        at = parent[at];
    }
    at
}

/// Whether a force element would be stiff if its bodies were free: they can only be slower.
fn could_be_stiff(system: &dyn System, state: &State, elastic: usize, pace: f64) -> bool {
    let sizes = system.structure().sizes;
    let (n, d) = (sizes.per_body, sizes.translations);
    let mut first = 0;
    for &group in &system.tree().elastic[elastic].groups {
        let info = &system.relative_groups()[group];
        let reference = [0.0; 6];
        let (mut values, mut gradient) = ([0.0; 3], [0.0; 42]);
        let reference = system.moved_reference(group, &state.q, &reference);
        system.relative_value(group, &reference, &state.q, &mut values[..info.rows]);
        let gradient = &mut gradient[..info.rows * 2 * n];
        system.relative_gradient(group, &reference, &state.q, gradient);
        for (row, gradient) in gradient.chunks_exact(2 * n).enumerate() {
            let stiffness = effective(&system.resistance(elastic, first + row, values[row]), pace);
            let mut mobility = 0.0;
            for (side, body) in info.bodies.into_iter().enumerate() {
                let Some(body) = body else { continue };
                let part = &gradient[side * n..(side + 1) * n];
                let scale = if n - d == 1 { 1.0 } else { 0.25 };
                mobility += norm(&part[..d]).powi(2) / system.mass(body)
                    + scale * norm(&part[d..]).powi(2) / system.least_inertia(body);
            }
            let strength = stiffness * mobility;
            if stiffness > 0.0 && (strength.is_nan() || strength > STIFF * pace * pace) {
                return true;
            }
        }
        first += info.rows;
    }
    false
}

/// A cluster of loops whose coordinates are chosen together.
struct Cluster<'a> {
    system: &'a dyn System,
    state: &'a State,
    g: &'a BlockMatrix,
    pace: f64,
    coordinates: &'a [Coordinate],
    relatives: &'a Relatives,
    /// Coordinates that are not driven.
    columns: Vec<usize>,
    /// Edges of the cluster, and the edge of each body.
    edges: Vec<bool>,
    edge_of: &'a [usize],
}

impl Cluster<'_> {
    fn scale(&self, group: usize) -> f64 {
        if self.system.relative_groups()[group].kind.turns() {
            1.0
        } else {
            self.system.characteristic_length()
        }
    }

    fn contains(&self, path: &[usize]) -> bool {
        path.iter().any(|body| self.edges[self.edge_of[*body]])
    }

    fn select(&self, chart: &mut Chart, choice: &mut Selection) -> Result<(), EvaluationFailure> {
        let (system, count) = (self.system, self.columns.len());
        let structure = system.structure();
        let n = structure.sizes.coordinates;
        // Columns of D, one coordinate after the other.
        let mut d = vec![vec![0.0; n]; count];
        let (none, mut unit) = (vec![0.0; structure.sizes.rows], vec![0.0; self.coordinates.len()]);
        for (column, &k) in d.iter_mut().zip(&self.columns) {
            unit[k] = 1.0;
            chart.solve(&none, &unit, column);
            unit[k] = 0.0;
        }
        let scales: Vec<f64> =
            self.columns.iter().map(|&k| self.scale(self.coordinates[k].group)).collect();

        // A, scaled to pure numbers.
        let tree = system.tree();
        let rows: Vec<usize> = (tree.closures.iter())
            .filter(|closure| self.contains(&closure.path))
            .flat_map(|closure| closure.row..closure.row + closure.rows)
            .collect();
        let mut a = vec![0.0; rows.len() * count];
        let mut product = vec![0.0; structure.sizes.rows];
        for (k, (column, scale)) in d.iter().zip(&scales).enumerate() {
            product.fill(0.0);
            self.g.multiply_add(1.0, column, &mut product);
            for (i, &row) in rows.iter().enumerate() {
                let length = match structure.row_measure[row] {
                    Measure::Length => system.characteristic_length(),
                    Measure::Angle => 1.0,
                };
                let x = product[row] * scale / length;
                a[i * count + k] = if x.abs() > NEGLIGIBLE { x } else { 0.0 };
            }
        }
        let mut work = a.clone();
        let pivots = full_pivot_elimination(rows.len(), count, &mut work, &[], RANK_TOLERANCE);
        let rank = pivots.rank;
        if let (Some(first), Some(last)) = (pivots.pivots.first(), pivots.pivots[..rank].last()) {
            choice.pivot_ratio = choice.pivot_ratio.min((last / first).abs());
        }
        let mut kept: Vec<usize> = pivots.row_order[..rank].to_vec();
        kept.sort_unstable();
        choice.kept.extend(kept.iter().map(|&i| rows[i]));
        let free = count - rank;
        if free == 0 {
            return Ok(());
        }
        let basis = if rank == 0 {
            (0..count * count).map(|i| f64::from(u8::from(i / count == i % count))).collect()
        } else {
            let a: Vec<f64> =
                kept.iter().flat_map(|&i| &a[i * count..(i + 1) * count]).copied().collect();
            orthonormal_null_space_qr(rank, count, &a).map_err(|error| {
                EvaluationFailure::new(
                    "simulation/singular-configuration",
                    format!("the free motions of a loop were not found: {error}"),
                )
            })?
        };
        let mut taken = Taken { basis: &basis, free, orthonormal: Vec::new() };

        let mut candidates = self.candidates(&d, &scales, &basis, free);
        for candidate in &mut candidates {
            self.simplify(candidate);
        }
        candidates.sort_by(|a, b| b.strength.total_cmp(&a.strength).then(a.row.cmp(&b.row)));
        for candidate in &candidates {
            if taken.len() < free
                && !choice.rows.contains(&candidate.row)
                && taken.independence(&candidate.gradient) > INDEPENDENT
            {
                taken.add(&candidate.gradient);
                choice.rows.push(candidate.row);
            }
        }
        let mut order: Vec<usize> = (0..count).collect();
        let depth = |k: usize| {
            let body = tree.edges[self.coordinates[self.columns[k]].edge].body;
            tree.forest.depth[body]
        };
        order.sort_by_key(|&k| (depth(k), k));
        let unit = |k: usize| {
            let mut row = vec![0.0; count];
            row[k] = 1.0;
            row
        };
        while taken.len() < free {
            let independence: Vec<f64> =
                order.iter().map(|&k| taken.independence(&unit(k))).collect();
            let best = independence.iter().copied().fold(0.0, f64::max);
            let Some(at) = independence.iter().position(|x| *x >= NEARLY_BEST * best) else {
                break;
            };
            let c = self.coordinates[self.columns[order[at]]];
            taken.add(&unit(order[at]));
            choice.rows.push((c.group, c.row));
        }
        Ok(())
    }

    /// A deformation that one coordinate of the forest makes alone, by structure, has no direction that
    /// could turn: the coordinate itself serves, which is regular where a length vanishes.
    fn simplify(&self, candidate: &mut Candidate) {
        let tree = self.system.tree();
        let path = &tree.elastic[candidate.elastic].path;
        let mut makers = (0..self.columns.len())
            .filter(|&k| path.contains(&tree.edges[self.coordinates[self.columns[k]].edge].body));
        if let (Some(only), None) = (makers.next(), makers.next()) {
            let c = self.coordinates[self.columns[only]];
            candidate.row = (c.group, c.row);
            candidate.gradient.fill(0.0);
            candidate.gradient[only] = 1.0;
        }
    }

    /// Deformations of stiff force elements with their gradients, scaled, in the coordinates of the cluster.
    fn candidates(
        &self,
        d: &[Vec<f64>],
        scales: &[f64],
        basis: &[f64],
        free: usize,
    ) -> Vec<Candidate> {
        let (system, state, count) = (self.system, self.state, d.len());
        let n = system.structure().sizes.per_body;
        let mut mass = system.structure().mass_pattern.clone();
        system.mass_matrix(&state.q, &mut mass);
        // Motions that the closures leave free, in coordinates of the bodies, and their inertia.
        let motions: Vec<Vec<f64>> = (0..free)
            .map(|j| {
                let mut motion = vec![0.0; state.q.len()];
                for (k, column) in d.iter().enumerate() {
                    let factor = basis[k * free + j] * scales[k];
                    motion.iter_mut().zip(column).for_each(|(out, x)| *out += factor * x);
                }
                motion
            })
            .collect();
        let mut inertia = vec![0.0; free * free];
        for (j, motion) in motions.iter().enumerate() {
            let mut force = vec![0.0; state.q.len()];
            mass.multiply_add(1.0, motion, &mut force);
            for (i, other) in motions.iter().enumerate() {
                inertia[i * free + j] = other.iter().zip(&force).map(|(a, b)| a * b).sum();
            }
        }
        let mut cholesky = Cholesky::new(free);
        let massive = cholesky.factor(&inertia).is_ok();
        let mut out = Vec::new();
        for (elastic, force) in system.tree().elastic.iter().enumerate() {
            if !self.contains(&force.path) {
                continue;
            }
            let mut first = 0;
            for &group in &force.groups {
                let info = &system.relative_groups()[group];
                let reference = &self.relatives.references[group];
                let (mut values, mut gradient) = ([0.0; 3], [0.0; 42]);
                system.relative_value(group, reference, &state.q, &mut values[..info.rows]);
                let gradient = &mut gradient[..info.rows * 2 * n];
                system.relative_gradient(group, reference, &state.q, gradient);
                for (row, gradient) in gradient.chunks_exact(2 * n).enumerate() {
                    let along = |x: &[f64]| -> f64 {
                        let sides = gradient.chunks_exact(n).zip(info.bodies);
                        let part = |(g, body): (&[f64], Option<usize>)| -> f64 {
                            body.map_or(0.0, |b| {
                                let x = &x[b * n..(b + 1) * n];
                                g.iter().zip(x).map(|(a, b)| a * b).sum()
                            })
                        };
                        sides.map(part).sum()
                    };
                    let reduced: Vec<f64> = motions.iter().map(|m| along(m)).collect();
                    let mut response = reduced.clone();
                    let mobility = if massive {
                        cholesky.solve(&mut response);
                        reduced.iter().zip(&response).map(|(a, b)| a * b).sum()
                    } else {
                        f64::INFINITY
                    };
                    let resistance = system.resistance(elastic, first + row, values[row]);
                    let stiffness = effective(&resistance, self.pace);
                    let strength = if stiffness > 0.0 { stiffness * mobility } else { 0.0 };
                    if strength > STIFF * self.pace * self.pace {
                        let scale = self.scale(group);
                        let gradient: Vec<f64> =
                            (0..count).map(|k| along(&d[k]) * scales[k] / scale).collect();
                        out.push(Candidate { elastic, row: (group, row), strength, gradient });
                    }
                }
                first += info.rows;
            }
        }
        out
    }
}

struct Candidate {
    elastic: usize,
    row: (usize, usize),
    strength: f64,
    gradient: Vec<f64>,
}

/// Rows taken so far, orthonormal in the free motions.
struct Taken<'a> {
    basis: &'a [f64],
    free: usize,
    orthonormal: Vec<Vec<f64>>,
}

impl Taken<'_> {
    fn len(&self) -> usize {
        self.orthonormal.len()
    }

    /// What of a row is left in the free motions beside those taken.
    fn rest(&self, row: &[f64]) -> Vec<f64> {
        let mut out: Vec<f64> = (0..self.free)
            .map(|j| row.iter().enumerate().map(|(k, x)| x * self.basis[k * self.free + j]).sum())
            .collect();
        for taken in &self.orthonormal {
            let along: f64 = taken.iter().zip(&out).map(|(a, b)| a * b).sum();
            out.iter_mut().zip(taken).for_each(|(x, t)| *x -= along * t);
        }
        out
    }

    /// Its size against that of the row.
    fn independence(&self, row: &[f64]) -> f64 {
        let size = norm(row);
        if size > 0.0 { norm(&self.rest(row)) / size } else { 0.0 }
    }

    fn add(&mut self, row: &[f64]) {
        let mut rest = self.rest(row);
        let size = norm(&rest);
        rest.iter_mut().for_each(|x| *x /= size);
        self.orthonormal.push(rest);
    }
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}
