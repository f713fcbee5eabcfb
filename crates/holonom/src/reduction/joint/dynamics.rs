//! Accelerations and multipliers: articulated bodies where nothing closes loops, Algorithm 4 elsewhere.

use super::algebra::Algebra;
use super::closures::{Closure, Origin};
use super::directions::Directions;
use super::engine::{Edge, Engine, add, dot, pose};
use crate::reduction::relatives::Source;
use crate::system::{EdgeSource, State};
use holonom_linalg::{BranchedCholesky, BranchedPlan, CutRows};
use std::sync::Arc;

/// What a solution may leave of the forces, against their size, before other solvers are asked.
const ACCURACY: f64 = 1e-9;
/// Most rows of joint and driver of an edge.
const MOST_ROWS: usize = 7;

/// The composite inertia matrix with the rows of cut joints and of drivers on the tree, and its factors by Algorithm 4.
#[derive(Debug, Clone)]
pub(super) struct Branched {
    factors: BranchedCholesky<1>,
    /// Coordinate at each place of the plan.
    order: Vec<usize>,
    /// Coordinates that drivers tell: row of the driver, sign, place of the row.
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
        let (n, m) = (plan.len(), plan.rows());
        let driven = told
            .into_iter()
            .map(|(row, sign, k, cut)| (row, sign, k, plan.cut_rows(cut).start))
            .collect();
        let cuts = places.into_iter().map(|cut| cut.map(|cut| plan.cut_rows(cut).start)).collect();
        Self {
            order,
            driven,
            cuts,
            mass: vec![[0.0]; plan.entries()],
            rows: vec![[0.0]; n * m],
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

/// Articulated inertia of an edge: U = K B, the factor of BᵀU, and BᵀU's right-hand side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Articulated<const W: usize> {
    inertia: [[f64; W]; W],
    felt: [[f64; W]; 6],
    pivots: [[f64; 6]; 6],
    force: [f64; 6],
}

impl<const W: usize> Articulated<W> {
    pub(super) fn zero() -> Self {
        Self { inertia: [[0.0; W]; W], felt: [[0.0; W]; 6], pivots: [[0.0; 6]; 6], force: [0.0; 6] }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Inertia of every body about its reference point, by rows.
    fn evaluate_inertias(&mut self, q: &[f64]) {
        for (b, (mass, inertia)) in self.inertias.iter().enumerate() {
            let own = &mut self.articulated[b].inertia;
            for (k, row) in own.iter_mut().enumerate() {
                let unit = std::array::from_fn(|i| f64::from(u8::from(i == k)));
                *row = A::inertia_times(*mass, inertia, pose(q, b), &self.origin[b], &unit);
            }
        }
    }

    /// Wrenches of inertia and forces of every body for the present rates of twists.
    pub(super) fn evaluate_wrenches(&mut self, force: &[f64], q: &[f64], a: &[f64]) {
        for (b, (mass, inertia)) in self.inertias.iter().enumerate() {
            let (q, o) = (pose(q, b), &self.origin[b]);
            let mut wrench =
                A::inertia_force(*mass, inertia, q, pose(a, b), o, &self.twist_rate[b]);
            add(&mut wrench, -1.0, &A::wrench(q, o, pose(force, b)));
            self.wrench[b] = wrench;
        }
    }

    /// q̈ and the multipliers of closures and drivers for forces Q; `false` where no or too few digits are left.
    pub(super) fn accelerations_of(&mut self, force: &[f64], state: &mut State) -> bool {
        let State { t, q, v, a, lambda, .. } = state;
        lambda.fill(0.0);
        if self.directions.is_some() {
            return self.follow_directions(*t, force, [q, v], a, lambda);
        }
        self.accelerations.fill(0.0);
        self.evaluate_bias();
        self.evaluate_twist_rates(q, v, a);
        self.evaluate_wrenches(force, q, a);
        let served = if self.is_plain_tree {
            self.evaluate_inertias(q);
            self.articulate()
        } else {
            self.branch(*t, q, v, a, lambda)
        };
        if !served {
            return false;
        }
        self.evaluate_twist_rates(q, v, a);
        self.evaluate_wrenches(force, q, a);
        self.add_closure_forces(q, lambda);
        self.is_balanced(lambda)
    }

    /// Accelerations by M̂, then multipliers of what closes loops and of drivers on the tree.
    fn follow_directions(
        &mut self,
        t: f64,
        force: &[f64],
        [q, v]: [&[f64]; 2],
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> bool {
        if !self.evaluate_directions(q) {
            return false;
        }
        let mut accelerations = std::mem::take(&mut self.accelerations);
        self.zero_rates.fill(0.0);
        self.tell(t, Some(2), &self.zero_rates, &mut accelerations);
        self.accelerations = accelerations;
        self.evaluate_bias();
        self.evaluate_twist_rates(q, v, a);
        if self.closures.rows() > 0 {
            // Deformations stay as they are for now, whatever that is.
            self.rows.fill(0.0);
            self.evaluate_rate_residual(None, t, 2, &[], [q, v, a]);
            self.closures.solve(&mut self.rows);
            for (x, &k) in self.rows.iter().zip(&self.closures.dependent) {
                self.accelerations[k] = *x;
            }
            self.evaluate_twist_rates(q, v, a);
        }
        self.evaluate_wrenches(force, q, a);
        self.gather();
        self.accelerate_along();
        self.evaluate_twist_rates(q, v, a);
        self.evaluate_wrenches(force, q, a);
        let before = self.largest_wrench();
        self.gather();
        let mut left = std::mem::take(&mut self.zero_rates);
        self.project(&mut left);
        self.tell_multipliers(lambda);
        let served = self.is_small(&left, before.max(self.largest_wrench()));
        self.zero_rates = left;
        served
    }

    /// Multipliers of closures and of drivers on the tree, after [`Engine::project`].
    pub(super) fn tell_multipliers(&self, lambda: &mut [f64]) {
        for closure in &self.closures.all {
            if let Origin::Joint(_) = closure.origin {
                for (y, (_, row)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    lambda[*row] = -y;
                }
            }
        }
        for (along, source) in self.along.iter().zip(&self.sources) {
            if let Source::Driven(row, sign, _) = source {
                lambda[*row] = -sign * along;
            }
        }
    }

    fn largest_wrench(&self) -> f64 {
        self.wrench.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()))
    }

    /// Whether forces on coordinates are round-off of the wrenches they are made of.
    fn is_small(&self, left: &[f64], wrench: f64) -> bool {
        let length = self.system.characteristic_length().max(1.0);
        let most = ACCURACY * length * wrench.max(f64::MIN_POSITIVE);
        left.iter().all(|x| x.abs() <= most)
    }

    /// Accelerations of a tree; the wrenches are those at zero accelerations.
    fn articulate(&mut self) -> bool {
        for edge in self.edges.iter().rev() {
            let (b, n) = (edge.body, edge.range.len());
            let mut own = self.articulated[b];
            let columns = &self.columns[edge.range.clone()];
            for (felt, column) in own.felt.iter_mut().zip(columns) {
                for (out, row) in felt.iter_mut().zip(&own.inertia) {
                    *out = dot(row, column);
                }
            }
            for i in 0..n {
                own.force[i] = -dot(&columns[i], &self.wrench[b]);
                for j in 0..=i {
                    own.pivots[i][j] = dot(&columns[i], &own.felt[j]);
                }
            }
            if !factor(&mut own.pivots, n) {
                return false;
            }
            if let Some(base) = edge.base {
                // K − U (BᵀU)⁻¹Uᵀ, and the wrench with what the edge's own forces make of it.
                let mut half = own.felt;
                for w in 0..W {
                    for i in 0..n {
                        let mut x = half[i][w];
                        for j in 0..i {
                            x -= own.pivots[i][j] * half[j][w];
                        }
                        half[i][w] = x / own.pivots[i][i];
                    }
                }
                let mut rate = own.force;
                substitute(&own.pivots, n, &mut rate);
                let mut wrench = self.wrench[b];
                for (felt, rate) in own.felt.iter().zip(&rate).take(n) {
                    add(&mut wrench, *rate, felt);
                }
                add(&mut self.wrench[base], 1.0, &wrench);
                for (i, (out, row)) in
                    self.articulated[base].inertia.iter_mut().zip(&own.inertia).enumerate()
                {
                    add(out, 1.0, row);
                    for half in half.iter().take(n) {
                        add(out, -half[i], half);
                    }
                }
            }
            self.articulated[b] = own;
        }
        for edge in &self.edges {
            let own = &self.articulated[edge.body];
            let mut motion = edge.base.map_or([0.0; W], |base| self.motion[base]);
            let n = edge.range.len();
            let mut rate = own.force;
            for (rate, felt) in rate.iter_mut().zip(&own.felt).take(n) {
                *rate -= dot(felt, &motion);
            }
            substitute(&own.pivots, n, &mut rate);
            for (k, rate) in edge.range.clone().zip(rate) {
                self.accelerations[k] = rate;
                add(&mut motion, rate, &self.columns[k]);
            }
            self.motion[edge.body] = motion;
        }
        true
    }

    /// Accelerations and multipliers by Algorithm 4; the wrenches are those at zero accelerations.
    fn branch(&mut self, t: f64, q: &[f64], v: &[f64], a: &[f64], lambda: &mut [f64]) -> bool {
        self.gather();
        self.evaluate_inertias(q);
        for edge in self.edges.iter().rev() {
            if let Some(base) = edge.base {
                let own = self.articulated[edge.body].inertia;
                for (out, row) in self.articulated[base].inertia.iter_mut().zip(&own) {
                    add(out, 1.0, row);
                }
            }
        }
        self.evaluate_rate_residual(None, t, 2, &[], [q, v, a]);
        let mut branched = self.branched.take().expect("made where something closes loops");
        let (plan, m) = (branched.factors.plan().clone(), branched.tau.len());
        for edge in &self.edges {
            for k in edge.range.clone() {
                let composite = &self.articulated[edge.body].inertia;
                let felt = &mut self.felt[k];
                for (out, row) in felt.iter_mut().zip(composite) {
                    *out = dot(row, &self.columns[k]);
                }
            }
        }
        for (c, &k) in branched.order.iter().enumerate() {
            branched.force[c][0] = -self.along[k];
            let mut up = Some(c);
            for place in plan.column(c) {
                let Some(at) = up else { break };
                branched.mass[place][0] = dot(&self.felt[k], &self.columns[branched.order[at]]);
                up = plan.above(at);
            }
        }
        branched.rows.fill([0.0]);
        let n = self.sources.len();
        for (closure, first) in self.closures.all.iter().zip(&branched.cuts) {
            let Some(first) = first else { continue };
            for r in 0..closure.rows.len() {
                let line = &self.closures.matrix[(closure.first + r) * n..][..n];
                for (c, &k) in branched.order.iter().enumerate() {
                    branched.rows[c * m + first + r][0] = line[k];
                }
                branched.tau[first + r][0] = -self.rows[closure.first + r];
            }
        }
        for &(row, sign, k, at) in &branched.driven {
            let c = branched.order.iter().position(|&other| other == k).unwrap_or_default();
            branched.rows[c * m + at][0] = 1.0;
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

    /// Adds what the joints that close loops exert to the wrenches of their bodies.
    fn add_closure_forces(&mut self, q: &[f64], lambda: &[f64]) {
        let mut rest = self.gradients.as_slice();
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            if let Origin::Deformations(_) = closure.origin {
                continue;
            }
            for (row, global) in &closure.rows {
                let own = &gradient[row * 2 * N..][..2 * N];
                for (side, own) in own.chunks_exact(N).enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    let felt = A::wrench(pose(q, b), &self.origin[b], pose(own, 0));
                    add(&mut self.wrench[b], lambda[*global], &felt);
                }
            }
        }
    }

    /// Whether forces on the coordinates cancel, those of drivers included; leaves the wrenches through the edges.
    fn is_balanced(&mut self, lambda: &[f64]) -> bool {
        let before = self.largest_wrench();
        self.gather();
        for (k, source) in self.sources.iter().enumerate() {
            if let Source::Driven(row, sign, _) = source {
                self.along[k] += sign * lambda[*row];
            }
        }
        self.is_small(&self.along, before.max(self.largest_wrench()))
    }

    /// Multipliers of the joints and drivers of the tree and of the normalizations, beside those of the closures, for the
    /// present rates of twists.
    pub(super) fn tree_multipliers(&mut self, force: &[f64], state: &mut State) {
        let State { q, a, lambda, .. } = state;
        self.evaluate_wrenches(force, q, a);
        self.add_closure_forces(q, lambda);
        self.gather();
        let system = self.system.clone();
        let (tree, structure) = (system.tree(), system.structure());
        // Generalized forces that the joints' own leave, for the normalizations.
        self.generalized.copy_from_slice(force);
        let mut gradients = [[0.0; 6 * 14]; 2];
        let mut places = [0; 2];
        for edge in &self.edges {
            let described = &tree.edges[edge.at];
            let EdgeSource::Joint(joint) = described.source else { continue };
            let driver = described
                .driver
                .and_then(|(row, ..)| structure.joints.iter().position(|placed| placed.row == row));
            let o = A::center(pose(q, edge.body));
            let mut felt = [[0.0; W]; MOST_ROWS];
            let mut rows = [0; MOST_ROWS];
            let mut count = 0;
            let both = [Some(joint), driver];
            for (joint, gradient) in both.into_iter().flatten().zip(&mut gradients) {
                places[usize::from(count > 0)] = joint;
                let placed = &structure.joints[joint];
                let gradient = &mut gradient[..placed.rows * 2 * N];
                system.joint_gradient(joint, q, gradient);
                let side = usize::from(placed.bodies[1] == Some(edge.body));
                for (k, own) in gradient.chunks_exact(2 * N).enumerate() {
                    felt[count] = A::wrench(pose(q, edge.body), &o, pose(own, side));
                    rows[count] = placed.row + k;
                    count += 1;
                }
            }
            let length = system.characteristic_length();
            let wrench = A::moved(&self.wrench[edge.body], &self.origin[edge.body], &o);
            let weigh = |w: &[f64; W]| A::scaled(w, 1.0 / length);
            let (felt, wrench) = (felt.map(|w| weigh(&w)), weigh(&wrench));
            let mut square = [[0.0; MOST_ROWS]; MOST_ROWS];
            let mut right = [0.0; MOST_ROWS];
            for i in 0..count {
                right[i] = -dot(&felt[i], &wrench);
                for j in 0..=i {
                    square[i][j] = dot(&felt[i], &felt[j]);
                }
            }
            if factor(&mut square, count) {
                let once = right;
                substitute(&square, count, &mut right);
                // Once more with what is left: the square has lost half the digits.
                let mut left = wrench;
                for (felt, x) in felt.iter().zip(&right).take(count) {
                    add(&mut left, *x, felt);
                }
                let mut again = once;
                for (again, felt) in again.iter_mut().zip(&felt).take(count) {
                    *again = -dot(felt, &left);
                }
                substitute(&square, count, &mut again);
                for k in 0..count {
                    lambda[rows[k]] = right[k] + again[k];
                }
            }
            for (gradient, joint) in
                gradients.iter().zip(places).take(both.iter().flatten().count())
            {
                let placed = &structure.joints[joint];
                let rows = gradient.chunks_exact(2 * N).take(placed.rows).enumerate();
                for (k, own) in rows {
                    subtract::<N>(
                        &mut self.generalized,
                        placed.bodies,
                        lambda[placed.row + k],
                        own,
                    );
                }
            }
        }
        if structure.normalization_start == structure.sizes.rows {
            return;
        }
        let mut rest = self.gradients.as_slice();
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            if let Origin::Joint(_) = closure.origin {
                for (row, global) in &closure.rows {
                    let own = &gradient[row * 2 * N..][..2 * N];
                    subtract::<N>(&mut self.generalized, closure.ends, lambda[*global], own);
                }
            }
        }
        let first = structure.sizes.translations;
        for b in 0..structure.sizes.bodies {
            let (p, force) = (&q[b * N + first..(b + 1) * N], &self.generalized[b * N + first..]);
            let along = p.iter().zip(force).map(|(p, f)| p * f).sum::<f64>();
            lambda[structure.normalization_start + b] = 0.5 * along;
        }
    }

    /// Makes room for accelerations.
    pub(super) fn plan_accelerations(&mut self) {
        let driven = self.sources.iter().any(|source| matches!(source, Source::Driven(..)));
        let cut =
            self.closures.all.iter().any(|closure| {
                matches!(closure.origin, Origin::Joint(_)) && !closure.rows.is_empty()
            });
        self.is_plain_tree = !driven && !cut;
        if self.is_plain_tree {
            return;
        }
        let (bodies, ndof) = (self.inertias.len(), self.zero_rates.len());
        let directions = Directions::new(&self.edges, &self.closures, &self.sources, bodies, ndof);
        let branched = Branched::new(&self.edges, &self.closures.all, &self.sources);
        let operations = branched.factors.plan().operations().total().multiplications as f64;
        // Algorithm 4 goes through short runs of numbers: one of its operations takes the time of three.
        if directions.operations() <= 3.0 * operations {
            self.directions = Some(Box::new(directions));
        } else {
            self.branched = Some(Box::new(branched));
        }
    }

    pub(super) fn matrix_sizes(&self) -> [usize; 3] {
        let branched = Branched::new(&self.edges, &self.closures.all, &self.sources);
        branched.sizes()
    }
}

/// Takes λ times a row from the forces on its two bodies.
fn subtract<const N: usize>(out: &mut [f64], ends: [Option<usize>; 2], lambda: f64, row: &[f64]) {
    for (own, body) in row.chunks_exact(N).zip(ends) {
        let Some(b) = body else { continue };
        for (out, x) in out[b * N..].iter_mut().zip(own) {
            *out -= lambda * x;
        }
    }
}

/// Cholesky factor of the leading block of a matrix whose lower triangle is given.
fn factor<const M: usize>(a: &mut [[f64; M]; M], n: usize) -> bool {
    for i in 0..n {
        let given = a[i][i];
        for j in 0..=i {
            let mut x = a[i][j];
            for k in 0..j {
                x -= a[i][k] * a[j][k];
            }
            if i == j {
                if x.is_nan() || x <= 32.0 * f64::EPSILON * given {
                    return false;
                }
                a[i][i] = x.sqrt();
            } else {
                a[i][j] = x / a[j][j];
            }
        }
    }
    true
}

fn substitute<const M: usize>(l: &[[f64; M]; M], n: usize, b: &mut [f64; M]) {
    for i in 0..n {
        for j in 0..i {
            b[i] -= l[i][j] * b[j];
        }
        b[i] /= l[i][i];
    }
    for i in (0..n).rev() {
        for j in i + 1..n {
            b[i] -= l[j][i] * b[j];
        }
        b[i] /= l[i][i];
    }
}
