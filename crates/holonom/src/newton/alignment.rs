//! Matrices that turn along with bodies. Equations: `docs/theory/newton.md`, "Bodies that turn".

use crate::math::matrix::{Matrix3, inverse, times};
use crate::math::spatial::{g_transposed_times, rotation_matrix};
use crate::math::vector::{difference, dot, sum};
use crate::reduction::{Manifold, Source};
use crate::system::{EdgeScrews, EdgeSource, RelativeKind};

/// Stages that are corrected together, at most.
const STAGES: usize = 3;

type Vector3 = [f64; 3];

/// Bodies that turn freely among the independent variables, how they stood at the linearization, and how they stand at
/// each stage.
#[derive(Debug, Clone, Default)]
pub(super) struct Alignment {
    /// Those bodies and what carries them, inner ones first.
    nodes: Vec<Node>,
    base: Vec<Pose>,
    stages: [Vec<Pose>; STAGES],
    /// Angular velocities of bodies in ground axes, or moments, at both configurations.
    carried: Vec<[Vector3; 2]>,
}

/// An edge of the forest.
#[derive(Debug, Clone)]
struct Node {
    edge: usize,
    form: usize,
    body: usize,
    inner: Option<usize>,
    /// The rotation vector of a body that turns freely.
    rotation: Option<Rotation>,
    /// Other independent variables, each with its place among the columns of the edge.
    others: Vec<(usize, usize)>,
}

/// A rotation vector θ: W θ̇ is the angular velocity of the outer body in its own axes, against the inner one.
#[derive(Debug, Clone, Copy)]
struct Rotation {
    /// Place of θ among the independent variables.
    first: usize,
    group: usize,
    /// Place of the outer body among the two of the group.
    side: usize,
}

/// A node at a configuration.
#[derive(Debug, Clone, Copy, Default)]
struct Pose {
    /// Orientation A of the outer body.
    turned: Matrix3,
    /// W and W⁻¹.
    w: Matrix3,
    rates: Matrix3,
    /// Angular velocities of the other variables, ground axes.
    columns: [Vector3; 6],
}

impl Node {
    fn pose(&self, manifold: &Manifold, q: &[f64]) -> Pose {
        let (system, mut out) = (manifold.system(), Pose::default());
        let p = std::array::from_fn(|i| q[7 * self.body + 3 + i]);
        let relatives = manifold.chart().parametrization().relatives();
        if let (Some(rotation), Some(relatives)) = (&self.rotation, relatives) {
            let mut gradient = [0.0; 3 * 14];
            let reference = &relatives.references[rotation.group];
            system.relative_gradient(rotation.group, reference, q, &mut gradient);
            for c in 0..3 {
                let axis = std::array::from_fn(|i| if i == c { 0.5 } else { 0.0 });
                let rate: [f64; 4] = g_transposed_times(&p, &axis);
                for (row, gradient) in out.rates.iter_mut().zip(gradient.chunks_exact(14)) {
                    let own = &gradient[7 * rotation.side + 3..7 * rotation.side + 7];
                    row[c] = own.iter().zip(&rate).map(|(a, b)| a * b).sum();
                }
            }
            (out.turned, out.w) = (rotation_matrix(&p), inverse(&out.rates));
        } else {
            let mut screws = EdgeScrews::default();
            system.edge_screws_at(self.edge, self.form, q, &mut screws);
            let sign = if screws.outward { 1.0 } else { -1.0 };
            out.columns = screws.columns.map(|[_, angular]| angular.map(|x| sign * x));
        }
        out
    }
}

impl Alignment {
    pub(super) fn new(manifold: &Manifold, q: &[f64]) -> Self {
        let system = manifold.system();
        let Some(relatives) = manifold.chart().parametrization().relatives() else {
            return Self::default();
        };
        let (tree, bodies) = (system.tree(), system.structure().sizes.bodies);
        let mut nodes: Vec<Node> = Vec::new();
        let mut screws = EdgeScrews::default();
        for (at, (edge, &form)) in tree.edges.iter().zip(&*relatives.forms).enumerate() {
            let known = system.edge_screws_at(at, form, q, &mut screws);
            let inner = if known { screws.base } else { edge.parent };
            let mut node =
                Node { edge: at, form, body: edge.body, inner, rotation: None, others: Vec::new() };
            let mut column = 0;
            for group in edge.forms[form].clone() {
                let info = &system.relative_groups()[group];
                let own = (column..column + info.rows).filter_map(|c| {
                    let Source::Independent(k) = relatives.sources[at][c] else { return None };
                    Some((k, c))
                });
                let own: Vec<_> = own.collect();
                column += info.rows;
                // What a bushing holds turns little, and is stiff along axes of its variables; a spring holds no rotation.
                let held = matches!(edge.source, EdgeSource::Force(_)) && edge.form_count() == 1;
                if !held && info.kind == RelativeKind::Rotation && own.len() == 3 {
                    let side = usize::from(info.bodies[1] == Some(edge.body));
                    node.rotation = Some(Rotation { first: own[0].0, group, side });
                    node.inner = info.bodies[1 - side];
                } else if known && info.kind.turns() {
                    node.others.extend(own);
                }
            }
            nodes.push(node);
        }
        // What carries none of them is left out.
        let mut carries = vec![false; bodies];
        for node in nodes.iter().rev() {
            carries[node.body] |= node.rotation.is_some();
            if let (true, Some(inner)) = (carries[node.body], node.inner) {
                carries[inner] = true;
            }
        }
        nodes.retain(|node| carries[node.body]);
        nodes.shrink_to_fit();
        let poses = || vec![Pose::default(); nodes.len()];
        Self {
            base: poses(),
            stages: std::array::from_fn(|_| poses()),
            carried: vec![[[0.0; 3]; 2]; if nodes.is_empty() { 0 } else { bodies }],
            nodes,
        }
    }

    /// Whether there is anything to turn.
    pub(super) fn is_needed(&self) -> bool {
        !self.nodes.is_empty()
    }

    /// The matrix is that of this configuration.
    pub(super) fn begin(&mut self, manifold: &Manifold, q: &[f64]) {
        for (node, pose) in self.nodes.iter().zip(&mut self.base) {
            *pose = node.pose(manifold, q);
        }
    }

    /// A stage is at this configuration.
    pub(super) fn follow(&mut self, stage: usize, manifold: &Manifold, q: &[f64]) {
        for (node, pose) in self.nodes.iter().zip(&mut self.stages[stage]) {
            *pose = node.pose(manifold, q);
        }
    }

    /// δ ← T δ: a change of independent variables or of their rates that the matrix gives, at a stage.
    pub(super) fn turn(&mut self, stage: usize, change: &mut [f64]) {
        let Self { nodes, base, stages, carried } = self;
        spread(nodes, [base, &stages[stage]], carried, change);
    }

    /// δ ← T⁻¹ δ.
    pub(super) fn turn_back(&mut self, stage: usize, change: &mut [f64]) {
        let Self { nodes, base, stages, carried } = self;
        spread(nodes, [&stages[stage], base], carried, change);
    }

    /// ψ ← Tᵀψ: forces of a stage as the matrix takes them.
    pub(super) fn take_forces(&mut self, stage: usize, psi: &mut [f64]) {
        let Self { nodes, base, stages, carried } = self;
        let nodes = nodes.iter().zip(base.iter().zip(&stages[stage]));
        nodes.clone().for_each(|(node, _)| carried[node.body] = [[0.0; 3]; 2]);
        for (node, (from, to)) in nodes.rev() {
            let [before, after] = carried[node.body];
            let mut inner = [before, after];
            for &(k, c) in &node.others {
                psi[k] += dot(&from.columns[c], &before) + dot(&to.columns[c], &after);
            }
            if let Some(Rotation { first, .. }) = node.rotation {
                let moment = times_transposed(&to.rates, &vector(psi, first));
                let own = sum(
                    &moment,
                    &sum(
                        &times_transposed(&to.turned, &after),
                        &times_transposed(&from.turned, &before),
                    ),
                );
                psi[first..first + 3].copy_from_slice(&times_transposed(&from.w, &own));
                inner = [times(&from.turned, &own), times(&to.turned, &moment).map(|x| -x)];
            }
            if let Some(body) = node.inner {
                let [before, after] = carried[body];
                carried[body] = [sum(&before, &inner[0]), sum(&after, &inner[1])];
            }
        }
    }
}

/// Rates that give the bodies that turn freely the same angular velocities in their own axes at another configuration.
fn spread(nodes: &[Node], [from, to]: [&[Pose]; 2], carried: &mut [[Vector3; 2]], x: &mut [f64]) {
    for (node, (from, to)) in nodes.iter().zip(from.iter().zip(to)) {
        let [mut before, mut after] = node.inner.map_or([[0.0; 3]; 2], |body| carried[body]);
        for &(k, c) in &node.others {
            before = sum(&before, &from.columns[c].map(|a| a * x[k]));
            after = sum(&after, &to.columns[c].map(|a| a * x[k]));
        }
        if let Some(Rotation { first, .. }) = node.rotation {
            let own =
                sum(&times_transposed(&from.turned, &before), &times(&from.w, &vector(x, first)));
            let against = difference(&own, &times_transposed(&to.turned, &after));
            x[first..first + 3].copy_from_slice(&times(&to.rates, &against));
            (before, after) = (times(&from.turned, &own), times(&to.turned, &own));
        }
        carried[node.body] = [before, after];
    }
}

fn vector(x: &[f64], first: usize) -> Vector3 {
    [x[first], x[first + 1], x[first + 2]]
}

fn times_transposed(a: &Matrix3, x: &Vector3) -> Vector3 {
    std::array::from_fn(|j| a[0][j] * x[0] + a[1][j] * x[1] + a[2][j] * x[2])
}
