//! Algorithm 4: the composite inertia matrix, factored without fill, and the rows of what closes loops.

use super::algebra::Algebra;
use super::closures::{Closure, Origin};
use super::engine::{Edge, Engine, dot};
use super::inertia::Inertia;
use crate::reduction::relatives::Source;
use holonom_linalg::{BranchedCholesky, BranchedPlan, CutRows};
use std::sync::Arc;

/// The composite inertia matrix with the rows of cut joints and of drivers on the tree, and its factors by Algorithm 4.
#[derive(Debug, Clone)]
pub(super) struct Branched {
    pub(super) factors: BranchedCholesky<1>,
    /// Coordinate at each place of the plan, and place of each coordinate.
    order: Vec<usize>,
    place: Vec<usize>,
    /// Coordinates that drivers tell: row of the driver, sign, places of the coordinate and of the row in the plan.
    driven: Vec<(usize, f64, usize, usize)>,
    /// First row of the plan of each closure, where it is a joint's.
    cuts: Vec<Option<usize>>,
    mass: Vec<[f64; 1]>,
    rows: Vec<[f64; 1]>,
    force: Vec<[f64; 1]>,
    tau: Vec<[f64; 1]>,
}

impl Branched {
    pub(super) fn new(edges: &[Edge], closures: &[Closure], sources: &[Source]) -> Self {
        let bodies = edges.iter().map(|edge| edge.body + 1).max().unwrap_or_default();
        let mut node = vec![None; bodies];
        for (at, edge) in edges.iter().enumerate() {
            node[edge.body] = Some(at);
        }
        let node_of = |body: Option<usize>| body.and_then(|b| node[b]);
        let parents: Vec<_> = edges.iter().map(|edge| node_of(edge.base)).collect();
        let sizes: Vec<_> = edges.iter().map(|edge| edge.range.len()).collect();
        let (mut cuts, mut places) = (Vec::new(), Vec::new());
        for closure in closures {
            let is_joint = matches!(closure.origin, Origin::Joint(_)) && !closure.rows.is_empty();
            places.push(is_joint.then_some(cuts.len()));
            if is_joint {
                let nodes = closure.ends.map(node_of);
                cuts.push(CutRows { nodes, rows: closure.rows.len() });
            }
        }
        let mut told = Vec::new();
        for (at, edge) in edges.iter().enumerate() {
            for k in edge.range.clone() {
                if let Source::Driven(row, sign, _) = sources[k] {
                    told.push((row, sign, k, cuts.len()));
                    cuts.push(CutRows { nodes: [Some(at), None], rows: 1 });
                }
            }
        }
        let plan = BranchedPlan::new(&parents, &sizes, &cuts);
        let mut order = vec![0; plan.len()];
        for (at, edge) in edges.iter().enumerate() {
            for (place, k) in plan.coordinates(at).zip(edge.range.clone()) {
                order[place] = k;
            }
        }
        let mut place = vec![0; order.len()];
        order.iter().enumerate().for_each(|(at, &k)| place[k] = at);
        let (n, m) = (plan.len(), plan.rows());
        let driven = told
            .into_iter()
            .map(|(row, sign, k, cut)| (row, sign, place[k], plan.cut_rows(cut).start))
            .collect();
        let cuts = places.into_iter().map(|cut| cut.map(|cut| plan.cut_rows(cut).start)).collect();
        Self {
            order,
            place,
            driven,
            cuts,
            mass: vec![[0.0]; plan.places()],
            rows: vec![[0.0]; n * plan.width()],
            force: vec![[0.0]; n],
            tau: vec![[0.0]; m],
            factors: BranchedCholesky::new(Arc::new(plan)),
        }
    }

    /// Coordinates n, constraint rows m, and entries of the factor of the composite inertia matrix.
    pub(super) fn sizes(&self) -> [usize; 3] {
        let plan = self.factors.plan();
        [plan.len(), plan.rows(), plan.entries()]
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Accelerations and multipliers by Algorithm 4; the wrenches are those at zero accelerations.
    pub(super) fn branch(&mut self, t: f64, q: &[f64], v: &[f64], lambda: &mut [f64]) -> bool {
        self.evaluate_wrenches_anew(q, v);
        self.gather();
        self.gather_inertias(q);
        self.evaluate_second_residual(None, t, &[], [q, v]);
        let mut branched = self.branched.take().expect("made where something closes loops");
        let plan = branched.factors.plan().clone();
        let width = plan.width();
        for (edge, own) in self.edges.iter().zip(&self.articulated) {
            for k in edge.range.clone() {
                let b = edge.body;
                let felt = own.inertia.times(&self.own_columns[k]);
                self.felt[k] = A::moved(&felt, &self.center[b], &self.origin[b]);
            }
        }
        for (c, &k) in branched.order.iter().enumerate() {
            branched.force[c][0] = -self.along[k];
            for (place, &at) in plan.column(c).zip(plan.path(c)) {
                let column = &self.columns[branched.order[at as usize]];
                branched.mass[place][0] = dot(&self.felt[k], column);
            }
        }
        branched.rows.fill([0.0]);
        for (closure, first) in self.closures.all.iter().zip(&branched.cuts) {
            let Some(first) = first else { continue };
            for r in 0..closure.rows.len() {
                for (&(k, _), entry) in closure.path.iter().zip(closure.entries(r)) {
                    let x = self.closures.matrix[entry];
                    branched.rows[branched.place[k] * width + first + r][0] = x;
                }
                branched.tau[first + r][0] = -self.rows[closure.first + r];
            }
        }
        for &(row, sign, c, at) in &branched.driven {
            branched.rows[c * width + at][0] = 1.0;
            branched.tau[at][0] = sign * self.system.drive(row, t)[2];
        }
        let Branched { factors, mass, rows, force, tau, .. } = &mut *branched;
        let served = factors.factor(mass).is_ok() && factors.factor_rows(rows).is_ok();
        if served {
            factors.solve(force, tau);
            for (&k, x) in branched.order.iter().zip(&branched.force) {
                self.accelerations[k] = x[0];
            }
            for (closure, first) in self.closures.all.iter().zip(&branched.cuts) {
                let Some(first) = first else { continue };
                for (r, (_, row)) in closure.rows.iter().enumerate() {
                    lambda[*row] = branched.tau[first + r][0];
                }
            }
            for &(row, sign, _, at) in &branched.driven {
                lambda[row] = sign * branched.tau[at][0];
            }
        }
        self.branched = Some(branched);
        served
    }
}
