//! Choice of independent coordinates where the forest's coordinates are tied by closed loops.
//!
//! Rows over the coordinates of the bodies on loops are on offer: constraints first, then deformations of
//! stiff force elements by their frequency in the mechanism times what is left of them, then coordinates of the
//! forest, the nearest to the root first. [`independent_rows`] takes as many as there are coordinates. No path through the forest
//! is followed and no column of D is made: a row has entries at its two bodies only.
//!
//! Equations: `docs/theory/reduction.md` (30)-(35).

use super::relatives::{Relatives, WIDEST};
use super::stiffness::{STEPS, STIFF, could_be_stiff, mobilities, rate_along, stays_regular};
use super::tree::Coordinate;
use crate::error::EvaluationFailure;
use crate::system::{Measure, Resistance, State, System, Tree};
use holonom_linalg::{BlockMatrix, Claim, OfferedRow, independent_rows};
use std::collections::BTreeMap;

/// A row is taken only if this part of the best of its kind is left of it: the inverse of the growth of the condition
/// at which the choice is made again.
const NEARLY_BEST: f64 = 0.4;
/// Entries of scaled rows below this are round-off.
const NEGLIGIBLE: f64 = 1e-14;
/// Rows of the forest itself are taken before those that close its loops, which are then the redundant ones.
const FOREST: Claim = Claim::Required(0);
const CLOSURE: Claim = Claim::Required(1);

/// The loops of a system at a state.
pub(super) struct Loops<'a> {
    system: &'a dyn System,
    state: &'a State,
    pace: f64,
    /// Bodies whose edges are on loops of joints, drivers or forces that could be stiff.
    closed: Vec<bool>,
    /// Force elements that could be stiff and deform such an edge.
    elastic: Vec<usize>,
}

/// What is chosen.
pub(super) struct Selection {
    /// Independent coordinates on loops: group and row.
    pub(super) independent: Vec<(usize, usize)>,
    /// Constraint rows that others imply, ascending.
    pub(super) redundant: Vec<usize>,
    /// The least part of a constraint row that was left when it was taken.
    pub(super) pivot_ratio: f64,
}

/// What a row on offer is.
enum Offered {
    Constraint(usize),
    Coordinate(usize, usize),
}

/// A deformation of a stiff force element.
struct Deformation {
    elastic: usize,
    group: usize,
    row: usize,
    value: f64,
    resistance: Resistance,
    strength: f64,
    gradient: Vec<f64>,
}

impl<'a> Loops<'a> {
    /// Deformations of forces are preferred where they are stiff, if that is to be `heeded`.
    pub(super) fn new(system: &'a dyn System, state: &'a State, pace: f64, heeded: bool) -> Self {
        let tree = system.tree();
        let mut closed = vec![false; tree.edges.len()];
        let mut ways = Ways::new(tree);
        let mut close = |ends| {
            let mut way = Ways::between(ends);
            while let Some(body) = ways.next(&mut way) {
                closed[body] = true;
                ways.skip(body);
            }
        };
        tree.closures.iter().for_each(|closure| close(closure.ends));
        let mut elastic: Vec<usize> = (0..tree.elastic.len())
            .filter(|&k| heeded && could_be_stiff(system, state, k, pace))
            .collect();
        for force in elastic.iter().map(|&k| &tree.elastic[k]).filter(|force| !force.is_edge) {
            close(force.ends);
        }
        elastic.retain(|&k| {
            let force = &tree.elastic[k];
            !force.is_edge || tree.forest.outer(force.ends).is_some_and(|body| closed[body])
        });
        Self { system, state, pace, closed, elastic }
    }

    /// Whether there is a loop.
    pub(super) fn any(&self) -> bool {
        self.closed.contains(&true)
    }

    /// Whether the edge of a body is on a loop.
    pub(super) fn closed(&self, body: usize) -> bool {
        self.closed[body]
    }

    /// Chooses among the coordinates of the edges on loops, of which those with a driver are none.
    ///
    /// # Errors
    /// `simulation/singular-configuration`.
    pub(super) fn select(
        &self,
        g: &BlockMatrix,
        coordinates: &[Coordinate],
        driven: &[Option<usize>],
        relatives: &Relatives,
        rank_tolerance: f64,
    ) -> Result<Selection, EvaluationFailure> {
        let (system, tree) = (self.system, self.system.tree());
        let sizes = system.structure().sizes;
        let mut place = vec![None; sizes.bodies];
        let bodies: Vec<usize> = (0..sizes.bodies).filter(|&b| self.closed[b]).collect();
        for (at, &body) in bodies.iter().enumerate() {
            place[body] = Some(at);
        }
        let mut free: Vec<(usize, &Coordinate)> = (coordinates.iter().zip(driven))
            .filter(|(_, driven)| driven.is_none())
            .map(|(c, _)| (tree.edges[c.edge].body, c))
            .filter(|(body, _)| self.closed[*body])
            .collect();

        let (mut offered, mut rows) = (Vec::new(), Vec::new());
        self.offer_constraints(g, &place, &mut offered, &mut rows);
        let mut alone = Makers::new(tree, &free);
        // The strongest that each coordinate makes alone.
        let mut made = BTreeMap::new();
        for deformation in self.deformations(g, relatives) {
            let force = &tree.elastic[deformation.elastic];
            let (group, row) = (deformation.group, deformation.row);
            let weight = deformation.strength.sqrt();
            if let Some(c) = alone.only(force.ends) {
                made.entry((c.group, c.row)).or_insert(weight);
            } else {
                offered.push(Offered::Coordinate(group, row));
                let claim = Claim::Preferred(weight);
                rows.push(self.row(group, &deformation.gradient, &place, claim));
            }
        }
        free.sort_by_key(|(body, _)| tree.forest.depth[*body]);
        for (_, c) in free {
            let gradient = self.gradient(c.group, c.row, relatives);
            offered.push(Offered::Coordinate(c.group, c.row));
            let claim = match made.get(&(c.group, c.row)) {
                Some(weight) => Claim::PreferredInTurn(*weight),
                None => Claim::InTurn(STIFF.sqrt() * self.pace),
            };
            rows.push(self.row(c.group, &gradient, &place, claim));
        }

        let found =
            independent_rows(bodies.len(), sizes.per_body, &rows, rank_tolerance, NEARLY_BEST);
        let found = found.map_err(|e| {
            let (place, own) = sizes.place_of(e.column);
            let column = sizes.of_body(bodies[place]).start + own;
            let name = system.coordinate_name(column);
            EvaluationFailure::new(
                "simulation/singular-configuration",
                format!("the loops leave coordinate `{name}` undetermined here"),
            )
            .of_coordinate(column)
        })?;
        let mut out = Selection {
            independent: Vec::new(),
            redundant: Vec::new(),
            pivot_ratio: found.least_left,
        };
        for k in found.taken {
            if let Offered::Coordinate(group, row) = offered[k] {
                out.independent.push((group, row));
            }
        }
        for k in found.redundant {
            if let Offered::Constraint(row) = offered[k] {
                out.redundant.push(row);
            }
        }
        out.redundant.sort_unstable();
        Ok(out)
    }

    /// Rows of G that hold the edges on loops or close them, over the bodies of these edges: all others go
    /// along with the body that they hang on.
    fn offer_constraints(
        &self,
        g: &BlockMatrix,
        place: &[Option<usize>],
        offered: &mut Vec<Offered>,
        rows: &mut Vec<OfferedRow>,
    ) {
        let (system, tree) = (self.system, self.system.tree());
        let structure = system.structure();
        let mut ends = vec![[None; 2]; structure.sizes.rows];
        let mut entries = vec![Vec::new(); structure.sizes.rows];
        for ((row, column), x) in g.entries(0, 0).into_iter().zip(g.values()) {
            let (body, own) = structure.sizes.place_of(column);
            match ends[row] {
                [None, _] => ends[row][0] = Some(body),
                [Some(first), None] if first != body => ends[row][1] = Some(body),
                _ => {}
            }
            let length = self.length(structure.row_measure[row]);
            self.push(place, body, own, x / length, &mut entries[row]);
        }
        let mut closing = vec![false; structure.sizes.rows];
        for closure in &tree.closures {
            closing[closure.row..closure.row + closure.rows].fill(true);
        }
        for (row, entries) in entries.into_iter().enumerate() {
            let body =
                if ends[row][1].is_none() { ends[row][0] } else { tree.forest.outer(ends[row]) };
            if closing[row] || body.is_some_and(|body| self.closed[body]) {
                offered.push(Offered::Constraint(row));
                let claim = if closing[row] { CLOSURE } else { FOREST };
                rows.push(OfferedRow { entries, claim });
            }
        }
    }

    /// Deformations that are stiff against the motion, the strongest first, which decides between equals.
    fn deformations(&self, g: &BlockMatrix, relatives: &Relatives) -> Vec<Deformation> {
        let (system, q) = (self.system, &self.state.q);
        let mut out = Vec::new();
        let mut gradients = Vec::new();
        for &elastic in &self.elastic {
            let mut first = 0;
            for &group in &system.tree().elastic[elastic].groups {
                let info = &system.relative_groups()[group];
                let mut values = [0.0; 3];
                let reference = &relatives.references[group];
                system.relative_value(group, reference, q, &mut values[..info.rows]);
                for row in 0..info.rows {
                    let rate = STEPS * self.pace;
                    let resistance = system.resistance(elastic, first + row, values[row], rate);
                    if resistance.stiffness > 0.0 {
                        let gradient = self.gradient(group, row, relatives);
                        gradients.push((info.bodies, gradient.clone()));
                        let value = values[row];
                        let strength = 0.0; // with the mobility, below
                        out.push(Deformation {
                            elastic,
                            group,
                            row,
                            value,
                            resistance,
                            strength,
                            gradient,
                        });
                    }
                }
                first += info.rows;
            }
        }
        if out.is_empty() {
            return out;
        }
        let mobilities = mobilities(system, q, g, &gradients);
        for (d, mobility) in out.iter_mut().zip(mobilities) {
            d.strength = d.resistance.stiffness * mobility;
        }
        out.retain(|d| {
            let info = &system.relative_groups()[d.group];
            let motion = [d.value, rate_along(&d.gradient, info.bodies, &self.state.v)];
            d.strength > STIFF * self.pace * self.pace
                && stays_regular(info.kind, motion, &d.resistance, d.strength)
        });
        let name = |d: &Deformation| (d.group, d.row);
        out.sort_by(|a, b| b.strength.total_cmp(&a.strength).then(name(a).cmp(&name(b))));
        out
    }

    /// Gradient of a relative coordinate over its two bodies.
    fn gradient(&self, group: usize, row: usize, relatives: &Relatives) -> Vec<f64> {
        let n = self.system.structure().sizes.per_body;
        let mut gradient = [0.0; WIDEST];
        let gradient = &mut gradient[..self.system.relative_groups()[group].rows * 2 * n];
        let reference = &relatives.references[group];
        self.system.relative_gradient(group, reference, &self.state.q, gradient);
        gradient[row * 2 * n..(row + 1) * 2 * n].to_vec()
    }

    /// The row of a relative coordinate, of pure numbers.
    fn row(
        &self,
        group: usize,
        gradient: &[f64],
        place: &[Option<usize>],
        claim: Claim,
    ) -> OfferedRow {
        let info = &self.system.relative_groups()[group];
        let n = gradient.len() / 2;
        let length = self.length(if info.kind.turns() { Measure::Angle } else { Measure::Length });
        let mut entries = Vec::new();
        for (part, body) in gradient.chunks_exact(n).zip(info.bodies) {
            for (i, x) in part.iter().enumerate() {
                if let Some(body) = body {
                    self.push(place, body, i, x / length, &mut entries);
                }
            }
        }
        OfferedRow { entries, claim }
    }

    fn length(&self, measure: Measure) -> f64 {
        if measure == Measure::Length { self.system.characteristic_length() } else { 1.0 }
    }

    /// Adds the entry of a body's coordinate, in units of the length or of a radian.
    fn push(
        &self,
        place: &[Option<usize>],
        body: usize,
        at: usize,
        x: f64,
        entries: &mut Vec<(usize, f64)>,
    ) {
        let Some(block) = place[body] else { return };
        let sizes = self.system.structure().sizes;
        let unit = if at < sizes.translations {
            self.system.characteristic_length()
        } else {
            sizes.angle_factor().recip()
        };
        if (x * unit).abs() > NEGLIGIBLE {
            entries.push((sizes.of_body(block).start + at, x * unit));
        }
    }
}

/// Ways through a forest, of which parts can be skipped: bodies by number plus one, the ground is 0.
struct Ways {
    parent: Vec<usize>,
    depth: Vec<usize>,
    /// Itself, or a node above if it is skipped.
    above: Vec<usize>,
}

impl Ways {
    fn new(tree: &Tree) -> Self {
        let forest = &tree.forest;
        let node = |body: Option<usize>| body.map_or(0, |b| b + 1);
        Self {
            parent: [0].into_iter().chain(forest.parent.iter().map(|p| node(*p))).collect(),
            depth: [0].into_iter().chain(forest.depth.iter().copied()).collect(),
            above: (0..=forest.parent.len()).collect(),
        }
    }

    /// Leaves a body out of all ways from now on.
    fn skip(&mut self, body: usize) {
        self.above[body + 1] = self.parent[body + 1];
    }

    /// The way between two bodies, as its two ends.
    fn between(ends: [Option<usize>; 2]) -> [usize; 2] {
        ends.map(|body| body.map_or(0, |b| b + 1))
    }

    /// The next body on a way, from below.
    fn next(&mut self, way: &mut [usize; 2]) -> Option<usize> {
        *way = way.map(|node| self.find(node));
        let deeper = usize::from(self.depth[way[0]] < self.depth[way[1]]);
        let node = way[deeper];
        let body = (way[0] != way[1]).then(|| node - 1)?;
        way[deeper] = self.parent[node];
        Some(body)
    }

    fn find(&mut self, mut node: usize) -> usize {
        while self.above[node] != node {
            self.above[node] = self.above[self.above[node]];
            node = self.above[node];
        }
        node
    }
}

/// Which coordinates move two bodies against each other.
struct Makers<'a> {
    ways: Ways,
    at: Vec<Vec<&'a Coordinate>>,
}

impl<'a> Makers<'a> {
    fn new(tree: &Tree, free: &[(usize, &'a Coordinate)]) -> Self {
        let mut at = vec![Vec::new(); tree.edges.len()];
        for (body, c) in free {
            at[*body].push(*c);
        }
        let mut ways = Ways::new(tree);
        (0..at.len()).filter(|&body| at[body].is_empty()).for_each(|body| ways.skip(body));
        Self { ways, at }
    }

    /// The coordinate that alone, by structure, moves two bodies against each other. A deformation that it
    /// makes has no direction that could turn: the coordinate itself serves, which is regular where a length
    /// vanishes.
    fn only(&mut self, ends: [Option<usize>; 2]) -> Option<&'a Coordinate> {
        let mut way = Ways::between(ends);
        let body = self.ways.next(&mut way)?;
        let alone = self.at[body].len() == 1 && self.ways.next(&mut way).is_none();
        alone.then(|| self.at[body][0])
    }
}
