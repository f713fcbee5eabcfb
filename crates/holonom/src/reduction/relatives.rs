//! Relative coordinates of a spanning forest as independent variables: their values, and the way from these to
//! a configuration.

use crate::error::EvaluationFailure;
use crate::system::{
    Anchor, Measure, Reference, RelativeGroup, RelativeKind, Stance, State, System, Tree,
};
use serde::{Deserialize, Serialize};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Coordinates of two bodies in space, for three rows.
pub(super) const WIDEST: usize = 3 * 14;
/// Most coordinates of an edge.
const MOST: usize = 6;
/// Part of the regular range of a direction or rotation that a stage may use.
const REACH: f64 = 0.75;

/// Where the value of an edge's coordinate comes from.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub enum Source {
    /// An independent variable.
    Independent(usize),
    /// A driver: row, sign and constant.
    Driven(usize, f64, f64),
    /// The loops it is on.
    Dependent,
}

/// The relative coordinates in use. Copies share what does not move.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Relatives {
    /// Form of each edge of the forest.
    pub forms: Arc<[usize]>,
    /// Group and place within it of each independent variable; those of a group are neighbours.
    pub rows: Arc<[(usize, usize)]>,
    /// Source of each coordinate of each edge.
    pub sources: Arc<[[Source; MOST]]>,
    /// What each group is measured from.
    pub references: Vec<Reference>,
    /// Where each edge stood when references were last moved.
    pub anchors: Vec<Anchor>,
    /// Whether every coordinate of the forest is independent or driven.
    pub exact: bool,
    /// Whether another choice could be better at another configuration.
    pub has_alternatives: bool,
    /// Whether there are groups whose references move.
    pub moves: bool,
}

impl Relatives {
    /// Whether all places are those of a system with this forest.
    pub fn fits(&self, ndof: usize, rows: usize, tree: &Tree, groups: &[RelativeGroup]) -> bool {
        let edges = tree.edges.len();
        self.rows.len() == ndof
            && [self.forms.len(), self.sources.len(), self.anchors.len()] == [edges; 3]
            && self.references.len() == groups.len()
            && tree.edges.iter().zip(&*self.forms).all(|(edge, form)| *form < edge.form_count())
            && self
                .rows
                .iter()
                .all(|(group, row)| groups.get(*group).is_some_and(|g| *row < g.rows))
            && self.sources.iter().flatten().all(|source| match source {
                Source::Independent(k) => *k < ndof,
                Source::Driven(row, ..) => *row < rows,
                Source::Dependent => true,
            })
    }

    /// Whether the same coordinates are independent.
    pub fn same_as(&self, other: &Self) -> bool {
        self.forms == other.forms && self.rows == other.rows
    }

    /// Name of independent variable `k`.
    pub fn name(&self, system: &dyn System, k: usize) -> String {
        let (group, row) = self.rows[k];
        Self::name_of(system, group, row)
    }

    /// Name of a coordinate of a group.
    pub fn name_of(system: &dyn System, index: usize, row: usize) -> String {
        let groups = system.relative_groups();
        let group = &groups[index];
        let kind = match group.kind {
            RelativeKind::Displacement => "displacement",
            RelativeKind::Angle => "angle",
            RelativeKind::Length => "length",
            RelativeKind::Direction => "direction",
            RelativeKind::Rotation => "rotation",
        };
        // The two angles of a universal joint are groups of their own.
        let twin = |other: Option<&RelativeGroup>| {
            other.is_some_and(|other| other.name == group.name && other.kind == group.kind)
        };
        let second = twin(index.checked_sub(1).and_then(|before| groups.get(before)));
        if group.rows > 1 || second || twin(groups.get(index + 1)) {
            format!("{}.{kind}[{}]", group.name, row + usize::from(second))
        } else {
            format!("{}.{kind}", group.name)
        }
    }

    /// Whether independent variable `k` is a length or an angle.
    pub fn measure(&self, system: &dyn System, k: usize) -> Measure {
        if system.relative_groups()[self.rows[k].0].kind.turns() {
            Measure::Angle
        } else {
            Measure::Length
        }
    }

    /// Runs of independent variables that belong to one group: group and their range.
    pub fn runs(&self) -> impl Iterator<Item = (usize, std::ops::Range<usize>)> + '_ {
        let mut at = 0;
        std::iter::from_fn(move || {
            let group = self.rows.get(at)?.0;
            let end = self.rows[at..].iter().position(|r| r.0 != group);
            let range = at..end.map_or(self.rows.len(), |k| at + k);
            at = range.end;
            Some((group, range))
        })
    }

    /// Values of the independent variables; angles on the branch of their reference.
    pub fn positions(&self, system: &dyn System, q: &[f64], v: &mut [f64]) {
        let mut values = [0.0; 3];
        for (group, range) in self.runs() {
            let rows = system.relative_groups()[group].rows;
            system.relative_value(group, &self.references[group], q, &mut values[..rows]);
            for k in range {
                v[k] = values[self.rows[k].1];
            }
        }
    }

    /// Their rates P q̇.
    pub fn rates(&self, system: &dyn System, q: &[f64], v: &[f64], rates: &mut [f64]) {
        for (group, range) in self.runs() {
            self.group_rates(system, group, range.map(|k| (self.rows[k].1, k)), [q, v], rates);
        }
    }

    /// Those of one group, for `rows` of it that are independent variables, each with the place among all.
    pub fn group_rates(
        &self,
        system: &dyn System,
        group: usize,
        rows: impl Iterator<Item = (usize, usize)>,
        [q, v]: [&[f64]; 2],
        rates: &mut [f64],
    ) {
        let n = system.structure().sizes.per_body;
        let info = &system.relative_groups()[group];
        let gradient = &mut [0.0; WIDEST][..info.rows * 2 * n];
        system.relative_gradient(group, &self.references[group], q, gradient);
        for (row, k) in rows {
            rates[k] = times(&gradient[row * 2 * n..][..2 * n], info.bodies, v);
        }
    }

    /// Rates and second derivatives of all numbers of a group of three, m or rad per s and per s².
    pub fn motion(&self, system: &dyn System, group: usize, state: &State) -> [[f64; 3]; 2] {
        let State { q, v, a, .. } = state;
        let mut out = [[0.0; 3]; 2];
        for (out, v) in out.iter_mut().zip([v, a]) {
            self.group_rates(system, group, (0..3).map(|k| (k, k)), [q, v], out);
        }
        self.add_group_curvature(system, group, (0..3).map(|k| (k, k)), [q, v], &mut out[1]);
        out
    }

    /// (P q̇)_q q̇.
    pub fn curvature(&self, system: &dyn System, q: &[f64], v: &[f64], out: &mut [f64]) {
        out.fill(0.0);
        self.add_curvature(system, q, v, out);
    }

    /// out += (P q̇)_q q̇.
    pub fn add_curvature(&self, system: &dyn System, q: &[f64], v: &[f64], out: &mut [f64]) {
        for (group, range) in self.runs() {
            let rows = range.map(|k| (self.rows[k].1, k));
            self.add_group_curvature(system, group, rows, [q, v], out);
        }
    }

    /// That of one group, as [`Relatives::group_rates`].
    pub(super) fn add_group_curvature(
        &self,
        system: &dyn System,
        group: usize,
        rows: impl Iterator<Item = (usize, usize)>,
        [q, v]: [&[f64]; 2],
        out: &mut [f64],
    ) {
        let values = &mut [0.0; 3][..system.relative_groups()[group].rows];
        system.relative_curvature(group, &self.references[group], q, v, values);
        for (row, k) in rows {
            out[k] += values[row];
        }
    }

    /// (P q̇)_q δq.
    pub fn rate_change(&self, system: &dyn System, state: &State, dq: &[f64], out: &mut [f64]) {
        let n = system.structure().sizes.per_body;
        let mut change = [0.0; WIDEST];
        for (group, range) in self.runs() {
            let info = &system.relative_groups()[group];
            let change = &mut change[..info.rows * 2 * n];
            let reference = &self.references[group];
            system.relative_rate_gradient(group, reference, &state.q, &state.v, change);
            for k in range {
                let row = &change[self.rows[k].1 * 2 * n..][..2 * n];
                out[k] = times(row, info.bodies, dq);
            }
        }
    }

    /// Whether the value of a group is known up to whole turns only: not where it is measured from a reference
    /// within its reach.
    fn loses_turns(system: &dyn System, group: usize) -> bool {
        let info = &system.relative_groups()[group];
        info.kind.turns() && info.reach.is_infinite()
    }

    /// Takes differences of angles modulo a turn.
    pub(super) fn reduce_turns(&self, system: &dyn System, difference: &mut [f64]) {
        for ((group, _), x) in self.rows.iter().zip(difference) {
            if Self::loses_turns(system, *group) {
                *x -= TAU * (*x / TAU).round();
            }
        }
    }

    /// Differences of independent angles that are coordinates of edges, from the counted values of these. All
    /// others stand: what a configuration itself tells may have moved since `x` was kept.
    pub(super) fn count_turns(
        &self,
        system: &dyn System,
        x: &[[f64; MOST]],
        p: &[f64],
        difference: &mut [f64],
    ) {
        self.reduce_turns(system, difference);
        for (sources, x) in self.sources.iter().zip(x) {
            for (source, x) in sources.iter().zip(x) {
                if let Source::Independent(k) = source
                    && Self::loses_turns(system, self.rows[*k].0)
                {
                    difference[*k] = x - p[*k];
                }
            }
        }
    }

    /// Values of the coordinates of all edges for the independent variables `p` at time t; the dependent
    /// ones stay at what `x` has.
    ///
    /// # Errors
    /// `simulation/chart-reach` where a direction or rotation is farther from its reference than it is
    /// regular.
    pub(super) fn coordinates(
        &self,
        system: &dyn System,
        t: f64,
        p: &[f64],
        x: &mut [[f64; MOST]],
    ) -> Result<(), EvaluationFailure> {
        let (tree, groups) = (system.tree(), system.relative_groups());
        for ((edge, form), (sources, x)) in
            tree.edges.iter().zip(&*self.forms).zip(self.sources.iter().zip(x))
        {
            let mut at = 0;
            for group in edge.forms[*form].clone() {
                let info = &groups[group];
                let values = &mut x[at..at + info.rows];
                for (source, value) in sources[at..].iter().zip(&mut *values) {
                    match *source {
                        Source::Independent(k) => *value = p[k],
                        Source::Driven(row, sign, constant) => {
                            *value = sign * system.prescribed(row, t) + constant;
                        }
                        Source::Dependent => {}
                    }
                }
                at += info.rows;
                Self::reaches(info, group, values)?;
            }
        }
        Ok(())
    }

    /// Whether a direction or rotation is near enough to its reference.
    ///
    /// # Errors
    /// `simulation/chart-reach`.
    pub(super) fn reaches(
        info: &RelativeGroup,
        group: usize,
        values: &[f64],
    ) -> Result<(), EvaluationFailure> {
        let size = values.iter().map(|v| v * v).sum::<f64>().sqrt();
        if info.reach.is_infinite() || size <= REACH * info.reach {
            return Ok(());
        }
        let message = format!("`{}` would turn by {size:.2} rad within one step", info.name);
        Err(EvaluationFailure::new("simulation/chart-reach", message).of_group(group))
    }

    /// Present values of the dependent coordinates plus their predicted changes −s_q δq, into `x`; returns how far angles among
    /// them turn, rad.
    pub(super) fn predict_dependent(
        &self,
        system: &dyn System,
        q: &[f64],
        correction: &[f64],
        x: &mut [[f64; MOST]],
    ) -> f64 {
        let n = system.structure().sizes.per_body;
        let mut gradient = [0.0; WIDEST];
        let tree = system.tree();
        let mut turned = 0.0f64;
        for ((edge, form), (sources, x)) in
            tree.edges.iter().zip(&*self.forms).zip(self.sources.iter().zip(x))
        {
            let mut at = 0;
            for group in edge.forms[*form].clone() {
                let info = &system.relative_groups()[group];
                if sources[at..at + info.rows].contains(&Source::Dependent) {
                    let reference = &self.references[group];
                    system.relative_value(group, reference, q, &mut x[at..at + info.rows]);
                    let gradient = &mut gradient[..info.rows * 2 * n];
                    system.relative_gradient(group, reference, q, gradient);
                    for (x, row) in x[at..].iter_mut().zip(gradient.chunks_exact(2 * n)) {
                        let change = times(row, info.bodies, correction);
                        *x -= change;
                        if info.kind == RelativeKind::Angle {
                            turned = turned.max(change.abs());
                        }
                    }
                }
                at += info.rows;
            }
        }
        turned
    }

    /// Places all bodies, edge by edge.
    pub(super) fn place(&self, system: &dyn System, x: &[[f64; MOST]], q: &mut [f64]) {
        (0..self.forms.len()).for_each(|edge| self.place_edge(system, edge, x, q, None));
    }

    /// Places the body of an edge, and tells how it stands where it is told how the others do.
    pub(super) fn place_edge(
        &self,
        system: &dyn System,
        edge: usize,
        x: &[[f64; MOST]],
        q: &mut [f64],
        stances: Option<&mut [Stance]>,
    ) {
        let (form, anchor) = (self.forms[edge], &self.anchors[edge]);
        system.place(edge, form, &x[edge], &self.references, anchor, q, stances);
    }

    /// Windings that follow the edges, from the coordinates of [`Relatives::coordinates`].
    pub(super) fn tell_turns(&self, system: &dyn System, x: &[[f64; MOST]], winding: &mut [f64]) {
        let groups = system.relative_groups();
        for ((edge, form), x) in system.tree().edges.iter().zip(&*self.forms).zip(x) {
            let Some(index) = edge.winding else { continue };
            let mut at = 0;
            for group in edge.forms[*form].clone() {
                let info = &groups[group];
                if info.kind == RelativeKind::Angle {
                    winding[index] = x[at];
                }
                at += info.rows;
            }
        }
    }

    /// Groups in use whose references have a history: the normals of directions in space are carried along.
    pub fn carried(&self, system: &dyn System) -> Vec<usize> {
        let groups = system.relative_groups();
        let edges = system.tree().edges.iter().zip(&*self.forms);
        let mut used: Vec<usize> = edges
            .flat_map(|(edge, form)| edge.forms[*form].clone())
            .chain(self.rows.iter().map(|row| row.0))
            .filter(|&k| groups[k].kind == RelativeKind::Direction && groups[k].reach.is_finite())
            .collect();
        used.sort_unstable();
        used.dedup();
        used
    }

    /// Coordinates of the edges at time t for the independent variables `p`; angles on no branch of `p` are
    /// on those of the windings, all else is zero.
    ///
    /// # Errors
    /// As [`Relatives::coordinates`].
    pub(super) fn tell_branches(
        &self,
        system: &dyn System,
        t: f64,
        p: &[f64],
        winding: &[f64],
        x: &mut [[f64; MOST]],
    ) -> Result<(), EvaluationFailure> {
        for ((edge, form), x) in system.tree().edges.iter().zip(&*self.forms).zip(&mut *x) {
            x.fill(0.0);
            let Some(index) = edge.winding else { continue };
            let mut at = 0;
            for group in edge.forms[*form].clone() {
                let info = &system.relative_groups()[group];
                if info.kind == RelativeKind::Angle {
                    x[at] = winding[index];
                }
                at += info.rows;
            }
        }
        self.coordinates(system, t, p, x)
    }

    /// Largest size of the entries of `p`, or of its rates, of a direction or rotation, rad or rad/s.
    pub fn turning(&self, system: &dyn System, p: &[f64]) -> f64 {
        let groups = system.relative_groups();
        let finite = self.runs().filter(|(group, _)| groups[*group].reach.is_finite());
        let squares = finite.map(|(_, range)| range.map(|k| p[k] * p[k]).sum::<f64>());
        squares.fold(0.0, f64::max).sqrt()
    }

    /// Whether independent variable `k` is an angle of any size.
    pub fn is_endless_angle(&self, system: &dyn System, k: usize) -> bool {
        let group = &system.relative_groups()[self.rows[k].0];
        group.kind.turns() && group.reach.is_infinite()
    }

    /// Moves references and anchors to a configuration whose independent variables are `p`, if known, and
    /// whose coordinates of edges are near `x`, which name the branches of angles; those of directions and
    /// rotations only if `turning`.
    pub(super) fn move_references(
        &mut self,
        system: &dyn System,
        q: &[f64],
        p: Option<&[f64]>,
        x: &mut [[f64; MOST]],
        turning: bool,
    ) {
        let groups = system.relative_groups();
        if let Some(p) = p {
            for (k, (group, _)) in self.rows.iter().enumerate() {
                if groups[*group].reach.is_infinite() {
                    self.references[*group][0] = p[k];
                }
            }
        }
        let tree = system.tree();
        // Where all independent variables are coordinates of edges, those of the edges are all there are.
        let mut all = self.exact;
        for (at, (edge, form)) in tree.edges.iter().zip(&*self.forms).enumerate() {
            let stays = |group: usize| groups[group].reach.is_finite() && !turning;
            if edge.forms[*form].clone().any(stays) {
                all = false;
                continue;
            }
            let mut first = 0;
            for group in edge.forms[*form].clone() {
                let info = &groups[group];
                if info.reach.is_infinite() {
                    self.references[group][0] = x[at][first];
                }
                self.references[group] = system.moved_reference(group, q, &self.references[group]);
                let values = &mut x[at][first..first + info.rows];
                system.relative_value(group, &self.references[group], q, values);
                first += info.rows;
            }
            self.anchors[at] =
                Anchor { orientation: system.anchor_orientation(at, *form, q), x: x[at] };
        }
        for (group, _) in &*self.rows {
            if !all && (turning || groups[*group].reach.is_infinite()) {
                let reference = &mut self.references[*group];
                *reference = system.moved_reference(*group, q, reference);
            }
        }
    }
}

/// row · x over the coordinates of two bodies.
fn times(row: &[f64], bodies: [Option<usize>; 2], x: &[f64]) -> f64 {
    let n = row.len() / 2;
    let mut sum = 0.0;
    for (row, body) in row.chunks_exact(n).zip(bodies) {
        if let Some(b) = body {
            sum += row.iter().zip(&x[b * n..(b + 1) * n]).map(|(a, x)| a * x).sum::<f64>();
        }
    }
    sum
}
