//! Recursions along the tree.

use super::JointForm;
use super::algebra::Algebra;
use super::closures::{Closures, Origin};
use super::directions::Directions;
use super::dynamics::{Articulated, Branched};
use crate::error::EvaluationFailure;
use crate::math::turn::TurnRate;
use crate::reduction::parametrization::Parametrization;
use crate::reduction::relatives::{Relatives, Source};
use crate::system::{Measure, State, System};
use std::f64::consts::TAU;
use std::marker::PhantomData;
use std::ops::Range;
use std::sync::Arc;

const MAX_CORRECTIONS: usize = 40;
/// Corrections that contract more slowly than this are refused as a way to another branch.
const CONTRACTION_LIMIT: f64 = 0.5;
/// Contraction from which the closures are factored anew.
const SLOW: f64 = 0.05;
/// Corrections of this size may be noise where the residual is.
const NOISY_CORRECTION: f64 = 1e-9;

/// An edge of the tree, without numbers that change.
#[derive(Debug, Clone)]
pub(super) struct Edge {
    /// Place among the edges of the forest, and the form in use.
    pub(super) at: usize,
    form: usize,
    pub(super) body: usize,
    pub(super) base: Option<usize>,
    pub(super) first: Option<usize>,
    pub(super) outward: bool,
    /// Its coordinates among all.
    pub(super) range: Range<usize>,
    pub(super) stage: [u8; 6],
    pub(super) rotation: Option<usize>,
}

/// Joint coordinates with twists and wrenches of `W` numbers.
#[derive(Debug, Clone)]
pub(super) struct Engine<A, const N: usize, const W: usize> {
    pub(super) system: Arc<dyn System>,
    pub(super) edges: Vec<Edge>,
    /// Per coordinate: where it comes from, and the row of the driver that tells it.
    pub(super) sources: Vec<Source>,
    names: Vec<(usize, usize)>,
    pub(super) closures: Closures,
    /// Root of each body's tree.
    root: Vec<usize>,
    /// Reference point of each body.
    pub(super) origin: Vec<[f64; 3]>,
    /// Columns for rates as in [`EdgeScrews`](crate::system::EdgeScrews), and for the coordinates' own.
    pub(super) screws: Vec<[f64; W]>,
    pub(super) columns: Vec<[f64; W]>,
    pub(super) turning: Vec<Option<TurnRate>>,
    pub(super) rates: Vec<f64>,
    pub(super) accelerations: Vec<f64>,
    pub(super) twist: Vec<[f64; W]>,
    pub(super) twist_rate: Vec<[f64; W]>,
    /// Ḃ ẋ of each edge.
    bias: Vec<[f64; W]>,
    /// Of each body, or of all that hangs on it.
    pub(super) wrench: Vec<[f64; W]>,
    pub(super) inertias: Vec<(f64, [[f64; 3]; 3])>,
    pub(super) articulated: Vec<Articulated<W>>,
    /// Composite inertia times the columns.
    pub(super) felt: Vec<[f64; W]>,
    pub(super) branched: Option<Box<Branched>>,
    pub(super) directions: Option<Box<Directions<W>>>,
    /// Whether nothing closes loops and no driver stands on the tree.
    pub(super) is_plain_tree: bool,
    /// Gradients of the closures over the coordinates of their bodies.
    pub(super) gradients: Vec<f64>,
    /// Scratch: rows of the closures, coordinates, motions of bodies.
    pub(super) rows: Vec<f64>,
    pub(super) along: Vec<f64>,
    pub(super) generalized: Vec<f64>,
    pub(super) zero_rates: Vec<f64>,
    before: Vec<f64>,
    pub(super) change: Vec<f64>,
    pub(super) motion: Vec<[f64; W]>,
    pub(super) rate_change: Vec<f64>,
    pub(super) bias_change: Vec<[f64; W]>,
    pub(super) twist_change: Vec<[f64; W]>,
    algebra: PhantomData<A>,
}

pub(super) fn dot<const W: usize>(a: &[f64; W], b: &[f64; W]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

pub(super) fn add<const W: usize>(out: &mut [f64; W], factor: f64, x: &[f64; W]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out += factor * x);
}

pub(super) fn pose<const N: usize>(q: &[f64], body: usize) -> &[f64; N] {
    q[body * N..].first_chunk().expect("a body has N coordinates")
}

pub(super) fn pose_mut<const N: usize>(q: &mut [f64], body: usize) -> &mut [f64; N] {
    q[body * N..].first_chunk_mut().expect("a body has N coordinates")
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    pub(super) fn new(
        system: &Arc<dyn System>,
        parametrization: &Parametrization,
        q: &[f64],
    ) -> Option<Self> {
        let relatives = parametrization.relatives()?;
        let (tree, groups) = (system.tree(), system.relative_groups());
        let bodies = system.structure().sizes.bodies;
        let mut edges = Vec::new();
        let (mut coordinates, mut names) = (Vec::new(), Vec::new());
        let mut edge_of = vec![None; bodies];
        let mut root: Vec<usize> = (0..bodies).collect();
        for (at, (edge, &form)) in tree.edges.iter().zip(&relatives.forms).enumerate() {
            let screws = system.edge_screws(at, form, q)?;
            let start = coordinates.len();
            for &group in &edge.forms[form] {
                let info = &groups[group];
                let measure = if info.kind.turns() { Measure::Angle } else { Measure::Length };
                for row in 0..info.rows {
                    coordinates.push((relatives.sources[at][coordinates.len() - start], measure));
                    names.push((group, row));
                }
            }
            if coordinates.len() - start != screws.count {
                return None;
            }
            if let Some(base) = screws.base {
                root[edge.body] = root[base];
            }
            edge_of[edge.body] = Some(edges.len());
            edges.push(Edge {
                at,
                form,
                body: edge.body,
                base: screws.base,
                first: screws.first,
                outward: screws.outward,
                range: start..coordinates.len(),
                stage: screws.stage,
                rotation: screws.rotation,
            });
        }
        let path = |mut body: Option<usize>| {
            let mut out = Vec::new();
            while let Some(edge) = body.and_then(|b| edge_of[b]) {
                let edge: &Edge = &edges[edge];
                if !edge.range.is_empty() {
                    out.push(edge.range.clone());
                }
                body = edge.base;
            }
            out
        };
        let closures =
            Closures::new(system.as_ref(), parametrization, relatives, &coordinates, path)?;
        let (n, rows) = (coordinates.len(), closures.rows());
        let zeros = || vec![[0.0; W]; bodies];
        let mut out = Self {
            system: system.clone(),
            sources: coordinates.iter().map(|c| c.0).collect(),
            names,
            root,
            origin: vec![[0.0; 3]; bodies],
            screws: vec![[0.0; W]; n],
            columns: vec![[0.0; W]; n],
            turning: vec![None; edges.len()],
            rates: vec![0.0; n],
            accelerations: vec![0.0; n],
            twist: zeros(),
            twist_rate: zeros(),
            wrench: zeros(),
            bias: vec![[0.0; W]; edges.len()],
            inertias: (0..bodies).map(|b| (system.mass(b), system.inertia(b))).collect(),
            gradients: vec![0.0; closures.all.iter().map(|c| c.count * 2 * N).sum()],
            rows: vec![0.0; rows],
            along: vec![0.0; n],
            generalized: vec![0.0; system.structure().sizes.coordinates],
            zero_rates: vec![0.0; parametrization.ndof],
            articulated: vec![Articulated::zero(); bodies],
            felt: vec![[0.0; W]; n],
            branched: None,
            directions: None,
            is_plain_tree: false,
            before: vec![0.0; n],
            change: vec![0.0; n],
            motion: zeros(),
            rate_change: vec![0.0; n],
            bias_change: vec![[0.0; W]; edges.len()],
            twist_change: zeros(),
            algebra: PhantomData,
            closures,
            edges,
        };
        out.plan_accelerations();
        Some(out)
    }

    fn relatives(parametrization: &Parametrization) -> &Relatives {
        parametrization.relatives().expect("the parametrization that it was made for")
    }

    /// Columns of all coordinates at q, with the reference points of the trees there.
    fn evaluate_columns(&mut self, x: &[[f64; 6]], q: &[f64]) {
        for (origin, root) in self.origin.iter_mut().zip(&self.root) {
            *origin = A::center(pose(q, *root));
        }
        for (edge, turning) in self.edges.iter().zip(&mut self.turning) {
            let Some(screws) = self.system.edge_screws(edge.at, edge.form, q) else { continue };
            let sign = if edge.outward { 1.0 } else { -1.0 };
            let o = &self.origin[edge.body];
            let own = &mut self.screws[edge.range.clone()];
            for (out, [linear, angular]) in own.iter_mut().zip(&screws.columns) {
                *out = A::screw(linear, angular, &screws.center, o).map(|x| sign * x);
            }
            let columns = &mut self.columns[edge.range.clone()];
            columns.copy_from_slice(own);
            if let Some(start) = edge.rotation {
                let theta = [x[edge.at][start], x[edge.at][start + 1], x[edge.at][start + 2]];
                let rate = turning.insert(TurnRate::new(&theta));
                for k in 0..3 {
                    let unit = std::array::from_fn(|i| f64::from(u8::from(i == k)));
                    let mut column = [0.0; W];
                    for (x, screw) in rate.times(&unit).iter().zip(&own[start..]) {
                        add(&mut column, *x, screw);
                    }
                    columns[start + k] = column;
                }
            }
        }
    }

    /// N at q.
    fn evaluate_closures(&mut self, parametrization: &Parametrization, q: &[f64]) {
        let n = self.closures.coordinates;
        let Closures { all, matrix, .. } = &mut self.closures;
        let mut rest = self.gradients.as_mut_slice();
        for closure in all.iter() {
            let (gradient, later) = rest.split_at_mut(closure.count * 2 * N);
            rest = later;
            gradient_of(self.system.as_ref(), parametrization, closure.origin, q, gradient);
            for (at, (row, _)) in closure.rows.iter().enumerate() {
                let line = &mut matrix[(closure.first + at) * n..][..n];
                let own = &gradient[row * 2 * N..][..2 * N];
                let mut felt = [[0.0; W]; 2];
                for (side, felt) in felt.iter_mut().enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    *felt = A::wrench(pose(q, b), &self.origin[b], pose(own, side));
                }
                for (range, side) in &closure.path {
                    for k in range.clone() {
                        line[k] = dot(&felt[*side], &self.columns[k]);
                    }
                }
            }
        }
    }

    /// Residuals of the closures at a configuration: Φ, and deformations less what they should be.
    fn evaluate_residual(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        q: &[f64],
    ) {
        let relatives = Self::relatives(parametrization);
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            match closure.origin {
                Origin::Joint(joint) => self.system.joint_value(joint, t, q, &mut value),
                Origin::Deformations(group) => {
                    let reference = &relatives.references[group];
                    self.system.relative_value(group, reference, q, &mut value[..closure.count]);
                    for &(row, k) in &closure.rows {
                        value[row] -= p[k];
                        if counts_turns(self.system.as_ref(), group) {
                            value[row] -= TAU * (value[row] / TAU).round();
                        }
                    }
                }
            }
            for (out, (row, _)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = value[*row];
            }
        }
    }

    /// Moves the dependent coordinates by what the closures' residuals ask for; returns the largest change, lengths over
    /// the characteristic length.
    fn correct(&mut self, x: &mut [[f64; 6]]) -> f64 {
        self.closures.solve(&mut self.rows);
        let mut largest = 0.0f64;
        for (change, &k) in self.rows.iter().zip(&self.closures.dependent) {
            largest = keep_larger(largest, (change / self.closures.column_scale[k]).abs());
            self.along[k] = *change;
        }
        for edge in &self.edges {
            for (out, k) in x[edge.at].iter_mut().zip(edge.range.clone()) {
                if self.sources[k] == Source::Dependent {
                    *out += self.along[k];
                }
            }
        }
        if largest.is_finite() { largest } else { f64::INFINITY }
    }

    /// Largest difference of the coordinates to those in `before`, lengths over the characteristic length.
    fn distance(&self, x: &[[f64; 6]]) -> f64 {
        let mut largest = 0.0f64;
        for edge in &self.edges {
            for (x, k) in x[edge.at].iter().zip(edge.range.clone()) {
                let change = (x - self.before[k]) / self.closures.column_scale[k];
                largest = keep_larger(largest, change.abs());
            }
        }
        largest
    }

    fn keep_coordinates(&mut self, x: &[[f64; 6]]) {
        for edge in &self.edges {
            for (x, k) in x[edge.at].iter().zip(edge.range.clone()) {
                self.before[k] = *x;
            }
        }
    }

    /// Twists for `rates`.
    fn evaluate_twists(&mut self) {
        for edge in &self.edges {
            let mut twist = edge.base.map_or([0.0; W], |base| self.twist[base]);
            for k in edge.range.clone() {
                add(&mut twist, self.rates[k], &self.columns[k]);
            }
            self.twist[edge.body] = twist;
        }
    }

    /// Rates as the screws have them: of a rotation vector the angular velocity.
    pub(super) fn screw_rates(&self, edge: &Edge, at: usize, x_rate: &[f64]) -> [f64; 6] {
        let mut out = [0.0; 6];
        out[..edge.range.len()].copy_from_slice(&x_rate[edge.range.clone()]);
        if let (Some(start), Some(turning)) = (edge.rotation, &self.turning[at]) {
            let rate = [out[start], out[start + 1], out[start + 2]];
            out[start..start + 3].copy_from_slice(&turning.times(&rate));
        }
        out
    }

    /// Ḃ ẋ of an edge.
    fn bias(&self, at: usize) -> [f64; W] {
        let edge = &self.edges[at];
        let mut out = [0.0; W];
        let carrier = edge.first.map(|first| &self.twist[first]);
        let rates = self.screw_rates(edge, at, &self.rates);
        let sign = if edge.outward { 1.0 } else { -1.0 };
        let screws = &self.screws[edge.range.clone()];
        let mut own = [0.0; W];
        for (k, (screw, rate)) in screws.iter().zip(&rates).enumerate() {
            if let Some(carrier) = carrier {
                add(&mut out, *rate, &A::cross(carrier, screw));
            }
            for (j, inner) in screws.iter().enumerate().take(k) {
                if edge.stage[j] < edge.stage[k] {
                    add(&mut own, rate * rates[j], &A::cross(inner, screw));
                }
            }
        }
        add(&mut out, sign, &own);
        if let (Some(start), Some(turning)) = (edge.rotation, &self.turning[at]) {
            let first = edge.range.start + start;
            let rate = [self.rates[first], self.rates[first + 1], self.rates[first + 2]];
            for (x, screw) in turning.first(&rate, &rate).iter().zip(&screws[start..]) {
                add(&mut out, *x, screw);
            }
        }
        out
    }

    /// Ḃ ẋ of all edges.
    pub(super) fn evaluate_bias(&mut self) {
        for at in 0..self.edges.len() {
            self.bias[at] = self.bias(at);
        }
    }

    /// Rates of the twists for `accelerations`, and q̈.
    pub(super) fn evaluate_twist_rates(&mut self, q: &[f64], v: &[f64], a: &mut [f64]) {
        for at in 0..self.edges.len() {
            let edge = &self.edges[at];
            let mut rate = edge.base.map_or([0.0; W], |base| self.twist_rate[base]);
            add(&mut rate, 1.0, &self.bias[at]);
            for k in edge.range.clone() {
                add(&mut rate, self.accelerations[k], &self.columns[k]);
            }
            let b = edge.body;
            self.twist_rate[b] = rate;
            let (y, o) = (&self.twist[b], &self.origin[b]);
            *pose_mut(a, b) = A::second_rates(pose(q, b), pose(v, b), o, y, &rate);
        }
    }

    /// Wrenches of bodies become those of all that hangs on them, and forces on the coordinates.
    pub(super) fn gather(&mut self) {
        for edge in self.edges.iter().rev() {
            let wrench = self.wrench[edge.body];
            for k in edge.range.clone() {
                self.along[k] = dot(&self.columns[k], &wrench);
            }
            if let Some(base) = edge.base {
                add(&mut self.wrench[base], 1.0, &wrench);
            }
        }
    }

    /// Dᵀ of the forces on the coordinates; leaves y of the closures in `rows`.
    pub(super) fn project(&mut self, out: &mut [f64]) {
        for (r, &k) in self.rows.iter_mut().zip(&self.closures.dependent) {
            *r = self.along[k];
        }
        self.closures.solve_transposed(&mut self.rows);
        self.closures.subtract_transposed(&self.rows, &mut self.along);
        for (k, source) in self.sources.iter().enumerate() {
            if let Source::Independent(at) = source {
                out[*at] = self.along[k];
            }
        }
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (y, (_, k)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    out[*k] = *y;
                }
            }
        }
    }

    /// Dependent entries of `x`, which are zero, from the others, for rows with right-hand sides −`rows`.
    fn complete(&mut self, x: &mut [f64]) {
        self.closures.multiply_add(x, &mut self.rows);
        self.closures.solve(&mut self.rows);
        for (value, &k) in self.rows.iter().zip(&self.closures.dependent) {
            x[k] = *value;
        }
    }

    /// Entries of x that are independent variables, or told by drivers: `level` 1 for rates, 2 for accelerations, none
    /// for changes at a fixed time.
    pub(super) fn tell(&self, t: f64, level: Option<usize>, p: &[f64], x: &mut [f64]) {
        for (x, source) in x.iter_mut().zip(&self.sources) {
            *x = match (*source, level) {
                (Source::Independent(k), _) => p[k],
                (Source::Driven(row, sign, _), Some(level)) => {
                    sign * self.system.drive(row, t)[level]
                }
                _ => 0.0,
            };
        }
    }

    /// D p, with zero residuals of the joints.
    pub(super) fn multiply_null_space(&mut self, p: &[f64], x: &mut [f64]) {
        self.tell(0.0, None, p, x);
        self.rows.fill(0.0);
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (out, (_, k)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                    *out = -p[*k];
                }
            }
        }
        self.complete(x);
    }

    /// Residuals of the closures' rates (`level` 1) or accelerations (2), `a` being q̇ or q̈ of all bodies, v their q̇.
    pub(super) fn evaluate_rate_residual(
        &mut self,
        parametrization: Option<&Parametrization>,
        t: f64,
        level: usize,
        p: &[f64],
        [q, v, a]: [&[f64]; 3],
    ) {
        let relatives = parametrization.map(Self::relatives);
        let mut rest = self.gradients.as_slice();
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            let (gradient, later) = rest.split_at(closure.count * 2 * N);
            rest = later;
            value.fill(0.0);
            match closure.origin {
                Origin::Joint(joint) => {
                    if level == 2 {
                        self.system.joint_curvature(joint, q, v, &mut value);
                    }
                    let row = self.system.structure().joints[joint].row;
                    value[0] -= self.system.drive(row, t)[level];
                }
                Origin::Deformations(group) => {
                    // Without references deformations are left out.
                    let Some(relatives) = relatives else { continue };
                    if level == 2 {
                        let (reference, out) =
                            (&relatives.references[group], &mut value[..closure.count]);
                        self.system.relative_curvature(group, reference, q, v, out);
                    }
                    for (row, k) in &closure.rows {
                        value[*row] -= p[*k];
                    }
                }
            }
            for (out, (row, _)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                *out = value[*row];
                let own = &gradient[row * 2 * N..][..2 * N];
                for (side, own) in own.chunks_exact(N).enumerate() {
                    let Some(b) = closure.ends[side] else { continue };
                    *out += own.iter().zip(pose::<N>(a, b)).map(|(g, a)| g * a).sum::<f64>();
                }
            }
        }
    }

    fn failure(&self, t: f64, q: &[f64], correction: f64) -> EvaluationFailure {
        let system = self.system.as_ref();
        let mut worst = (0.0f64, None);
        let mut value = [0.0; 6];
        for closure in &self.closures.all {
            let Origin::Joint(joint) = closure.origin else { continue };
            system.joint_value(joint, t, q, &mut value);
            for &(k, row) in &closure.rows {
                if value[k].abs() > worst.0 || value[k].is_nan() {
                    worst = (value[k].abs(), Some(row));
                }
            }
        }
        let residual = match worst.1 {
            Some(row) => format!("{:.2e}, is in {}", worst.0, system.row_name(row)),
            None => "0, is in no joint".to_owned(),
        };
        let (group, row) = self.closures.dependent.first().map_or((0, 0), |&k| self.names[k]);
        EvaluationFailure::new("simulation/position-recovery", format!(
                "the joints could not be closed at t = {t:.6} s; the largest residual, {residual}; the \
                 last correction, {correction:.2e}, was of `{}` and others on its loops",
                Relatives::name_of(system, group, row)
            )).of_row(worst.1)
    }
}

/// Gradient of a closure over the coordinates of its two bodies.
fn gradient_of(
    system: &dyn System,
    parametrization: &Parametrization,
    origin: Origin,
    q: &[f64],
    out: &mut [f64],
) {
    match origin {
        Origin::Joint(joint) => system.joint_gradient(joint, q, out),
        Origin::Deformations(group) => {
            let Some(relatives) = parametrization.relatives() else { return };
            system.relative_gradient(group, &relatives.references[group], q, out);
        }
    }
}

/// Whether a coordinate is known up to whole turns only.
fn counts_turns(system: &dyn System, group: usize) -> bool {
    let info = &system.relative_groups()[group];
    info.kind.turns() && info.reach.is_infinite()
}

/// Maximum that does not pass over NaN.
fn keep_larger(a: f64, b: f64) -> f64 {
    if b.is_nan() || b > a { b } else { a }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> JointForm for Engine<A, N, W> {
    fn boxed(&self) -> Box<dyn JointForm> {
        Box::new(self.clone())
    }

    fn recover_position(
        &mut self,
        parametrization: &Parametrization,
        t: f64,
        p: &[f64],
        x: &mut [[f64; 6]],
        q: &mut [f64],
    ) -> Result<u64, EvaluationFailure> {
        let system = self.system.clone();
        let relatives = Self::relatives(parametrization);
        self.keep_coordinates(x);
        relatives.coordinates(system.as_ref(), t, p, x)?;
        if self.closures.rows() == 0 {
            relatives.place(system.as_ref(), x, q);
            return Ok(0);
        }
        // The tangent at the configuration last factored.
        let mut change = std::mem::take(&mut self.change);
        for edge in &self.edges {
            for (x, k) in x[edge.at].iter().zip(edge.range.clone()) {
                change[k] = x - self.before[k];
            }
        }
        self.rows.fill(0.0);
        for closure in &self.closures.all {
            if let Origin::Deformations(group) = closure.origin {
                let mut value = [0.0; 6];
                let reference = &relatives.references[group];
                system.relative_value(group, reference, q, &mut value[..closure.count]);
                for (out, (row, k)) in self.rows[closure.first..].iter_mut().zip(&closure.rows) {
                    let mut step = value[*row] - p[*k];
                    if counts_turns(system.as_ref(), group) {
                        step -= TAU * (step / TAU).round();
                    }
                    *out = step;
                }
            }
        }
        self.complete(&mut change);
        for edge in &self.edges {
            for (x, k) in x[edge.at].iter_mut().zip(edge.range.clone()) {
                if self.sources[k] == Source::Dependent {
                    *x += change[k];
                }
            }
        }
        self.change = change;
        let predicted = self.distance(x);
        let largest = x.iter().flatten().fold(1.0f64, |m, x| m.max(x.abs()));
        let noise = 8.0 * f64::EPSILON * largest;
        self.keep_coordinates(x);
        relatives.place(system.as_ref(), x, q);
        let (mut before, mut fresh) = (predicted, false);
        for count in 1..=MAX_CORRECTIONS {
            self.evaluate_residual(parametrization, t, p, q);
            let residual = self.rows.iter().fold(0.0f64, |m, x| keep_larger(m, x.abs()));
            let size = self.correct(x);
            relatives.place(system.as_ref(), x, q);
            let rate = size / before;
            let ends = size <= noise || (count > 1 && 4.0 * rate * size <= 0.1 * f64::EPSILON);
            let stalls = count > 1 && rate > CONTRACTION_LIMIT;
            let is_noise = before <= 1e3 * noise
                || (size <= NOISY_CORRECTION && residual <= 64.0 * f64::EPSILON * largest);
            if ends || (stalls && is_noise) {
                if self.distance(x) <= 0.5 * predicted + 1e3 * noise.max(size) {
                    return Ok(count as u64);
                }
                return Err(EvaluationFailure::new(
                    "simulation/branch",
                    "a coordinate would leave the branch of the mechanism that was followed so far",
                ));
            }
            if (stalls && fresh) || !size.is_finite() {
                return Err(self.failure(t, q, size));
            }
            if count > 1 && rate > SLOW && !fresh {
                self.factor(parametrization, x, q)?;
                fresh = true;
            }
            before = size;
        }
        Err(self.failure(t, q, before))
    }

    fn read(&self, parametrization: &Parametrization, q: &[f64], x: &mut [[f64; 6]]) {
        let (system, relatives) = (self.system.as_ref(), Self::relatives(parametrization));
        for edge in &self.edges {
            let mut at = 0;
            for &group in &system.tree().edges[edge.at].forms[edge.form] {
                let rows = system.relative_groups()[group].rows;
                let mut value = [0.0; 3];
                let reference = &relatives.references[group];
                system.relative_value(group, reference, q, &mut value[..rows]);
                for (x, value) in x[edge.at][at..at + rows].iter_mut().zip(value) {
                    let counted = if counts_turns(system, group) { *x } else { value };
                    *x = value + TAU * ((counted - value) / TAU).round();
                }
                at += rows;
            }
        }
    }

    fn factor(
        &mut self,
        parametrization: &Parametrization,
        x: &[[f64; 6]],
        q: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.evaluate_columns(x, q);
        self.evaluate_closures(parametrization, q);
        self.closures.factor().map_err(|e| {
            let (group, row) = self.names[self.closures.dependent[e.column]];
            let name = Relatives::name_of(self.system.as_ref(), group, row);
            let message =
                format!("the joints leave `{name}` undetermined here (pivot {:.1e})", e.pivot);
            EvaluationFailure::new("simulation/singular-configuration", message).of_group(group)
        })
    }

    fn determinant_sign(&self) -> f64 {
        self.closures.determinant_sign()
    }

    fn condition(&mut self) -> f64 {
        self.closures.condition()
    }

    fn recover_velocity(&mut self, t: f64, p_rate: &[f64], v: &mut [f64], q: &[f64]) {
        let mut rates = std::mem::take(&mut self.rates);
        self.tell(t, Some(1), p_rate, &mut rates);
        self.rows.fill(0.0);
        for closure in &self.closures.all {
            let rows = self.rows[closure.first..].iter_mut().zip(&closure.rows);
            match closure.origin {
                Origin::Joint(joint) => {
                    let first = self.system.structure().joints[joint].row;
                    for (out, (row, _)) in rows.filter(|(_, (row, _))| *row == 0) {
                        *out = -self.system.drive(first + row, t)[1];
                    }
                }
                Origin::Deformations(_) => rows.for_each(|(out, (_, k))| *out = -p_rate[*k]),
            }
        }
        self.complete(&mut rates);
        self.rates = rates;
        self.evaluate_twists();
        for edge in &self.edges {
            let b = edge.body;
            *pose_mut(v, b) = A::rates(pose(q, b), &self.origin[b], &self.twist[b]);
        }
    }

    fn residual(
        &mut self,
        parametrization: &Parametrization,
        force: &[f64],
        p_rate: &[f64],
        state: &mut State,
        psi: &mut [f64],
    ) {
        let State { t, q, v, a, lambda, .. } = state;
        let mut accelerations = std::mem::take(&mut self.accelerations);
        self.tell(*t, Some(2), p_rate, &mut accelerations);
        self.accelerations = accelerations;
        self.evaluate_bias();
        self.evaluate_twist_rates(q, v, a);
        if self.closures.rows() > 0 {
            self.evaluate_rate_residual(Some(parametrization), *t, 2, p_rate, [q, v, a]);
            self.closures.solve(&mut self.rows);
            for (x, &k) in self.rows.iter().zip(&self.closures.dependent) {
                self.accelerations[k] = *x;
            }
            self.evaluate_twist_rates(q, v, a);
        }
        self.evaluate_wrenches(force, q, a);
        self.gather();
        self.project(psi);
        lambda.fill(0.0);
        self.tell_multipliers(lambda);
    }

    fn mass_times(&mut self, p: &[f64], q: &[f64], out: &mut [f64]) {
        let mut change = std::mem::take(&mut self.change);
        self.multiply_null_space(p, &mut change);
        for edge in &self.edges {
            let mut motion = edge.base.map_or([0.0; W], |base| self.motion[base]);
            for k in edge.range.clone() {
                add(&mut motion, change[k], &self.columns[k]);
            }
            let b = edge.body;
            self.motion[b] = motion;
            let (mass, inertia) = &self.inertias[b];
            self.wrench[b] = A::inertia_times(*mass, inertia, pose(q, b), &self.origin[b], &motion);
        }
        self.change = change;
        self.gather();
        self.project(out);
    }

    fn accelerate(&mut self, force: &[f64], state: &mut State) -> bool {
        self.accelerations_of(force, state)
    }

    fn independent_acceleration(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        p_rate: &mut [f64],
    ) {
        let still = std::mem::take(&mut self.zero_rates);
        let State { t, q, v, a, .. } = state;
        self.evaluate_rate_residual(Some(parametrization), *t, 2, &still, [q, v, a]);
        self.zero_rates = still;
        for (k, source) in self.sources.iter().enumerate() {
            if let Source::Independent(at) = source {
                p_rate[*at] = self.accelerations[k];
            }
        }
        for closure in &self.closures.all {
            if let Origin::Deformations(_) = closure.origin {
                for (x, (_, k)) in self.rows[closure.first..].iter().zip(&closure.rows) {
                    p_rate[*k] = *x;
                }
            }
        }
    }

    fn complete_multipliers(&mut self, force: &[f64], state: &mut State) {
        self.tree_multipliers(force, state);
    }

    fn spread(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        [dp, dp_rate]: [&[f64]; 2],
        [dq, dv]: [&mut [f64]; 2],
    ) {
        self.displace(dp, &state.q, dq);
        self.displace_rates(parametrization, state, dp_rate, dq, dv);
    }

    fn sizes(&self) -> [usize; 3] {
        self.matrix_sizes()
    }
}
