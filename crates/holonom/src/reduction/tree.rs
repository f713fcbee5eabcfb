//! Choice of the relative coordinates that are independent.
//!
//! On a tree they are all coordinates of its edges: nothing is pivoted. Drivers on an edge remove their own
//! coordinate. Where joints or stiff forces close loops, [`Loops`] chooses.
//!
//! Equations: `docs/theory/reduction.md` (27)-(35).

use super::loops::Loops;
use super::parametrization::{Parametrization, Projection};
use super::relatives::{Relatives, Source};
use super::stiffness::{STEPS, STIFF, pace, rate_along};
use crate::error::EvaluationFailure;
use crate::system::{Anchor, RelativeKind, State, System};
use holonom_linalg::BlockMatrix;
use std::sync::Arc;

/// Amplitude of a stiff spring, against its length, up to which its direction is a coordinate.
const LARGEST_AMPLITUDE: f64 = 0.25;

/// A coordinate of the forest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coordinate {
    pub(super) edge: usize,
    pub(super) at: usize,
    pub(super) group: usize,
    pub(super) row: usize,
}

/// The relative coordinates that are independent at a state with Jacobian `g`. Directions have the axes that they have in
/// `present`: which of the two to keep is a question about these. With less than `rank_tolerance` left, a constraint is redundant.
/// Where stiffness is not `heeded`, condition alone decides.
///
/// # Errors
/// `simulation/singular-configuration`.
pub(super) fn choose_tree(
    system: &dyn System,
    state: &State,
    g: &BlockMatrix,
    present: Option<&Relatives>,
    rank_tolerance: f64,
    heeded: bool,
) -> Result<Parametrization, EvaluationFailure> {
    let tree = system.tree();
    let rows = system.structure().sizes.rows;
    let pace = pace(system, state);
    let forms = forms(system, state, pace);
    let coordinates = coordinates(system, &forms);
    let mut relatives = at_state(system, state, forms, &coordinates, present);
    let driven: Vec<Option<usize>> = coordinates
        .iter()
        .map(|c| tree.edges[c.edge].driver.filter(|d| d.1 == c.at).map(|d| d.0))
        .collect();

    let loops = Loops::new(system, state, pace, heeded);
    let mut choice = loops.select(g, &coordinates, &driven, &relatives, rank_tolerance)?;
    for (c, driven) in coordinates.iter().zip(&driven) {
        if driven.is_none() && !loops.closed(tree.edges[c.edge].body) {
            choice.independent.push((c.group, c.row));
        }
    }
    choice.independent.sort_unstable();
    let dropped = choice.redundant;
    let kept = (0..rows).filter(|row| dropped.binary_search(row).is_err()).collect();
    let groups = system.relative_groups();
    relatives.moves = choice.independent.iter().any(|(group, _)| groups[*group].reach.is_finite());
    relatives.has_alternatives =
        !heeded || loops.any() || tree.edges.iter().any(|edge| edge.form_count() > 1);
    let sources = Arc::make_mut(&mut relatives.sources);
    for (k, c) in coordinates.iter().enumerate() {
        let source = &mut sources[c.edge][c.at];
        *source = match (driven[k], choice.independent.binary_search(&(c.group, c.row))) {
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
    relatives.rows = choice.independent.into();
    Ok(Parametrization {
        kept,
        dropped,
        ndof: relatives.rows.len(),
        projection: Projection::Relative(Box::new(relatives)),
        pivot_ratio: choice.pivot_ratio,
    })
}

/// The form of each edge: a spring's direction is a coordinate while it is stiff enough to keep its length.
fn forms(system: &dyn System, state: &State, pace: f64) -> Vec<usize> {
    let tree = system.tree();
    let mut forms = vec![0; tree.edges.len()];
    let edge_of = edge_of_body(system);
    for (elastic, spring) in tree.elastic.iter().enumerate() {
        let Some(body) = tree.forest.outer(spring.ends) else { continue };
        let edge = edge_of[body];
        if !spring.is_edge || tree.edges[edge].form_count() < 2 {
            continue;
        }
        let group = spring.groups[0];
        let bodies = system.relative_groups()[group].bodies;
        let (mut value, mut gradient) = ([0.0], [0.0; 14]);
        let n = system.structure().sizes.per_body;
        system.relative_value(group, &[0.0; 6], &state.q, &mut value);
        let [length] = value;
        let resistance = system.resistance(elastic, 0, length, STEPS * pace);
        let stiffness = resistance.stiffness;
        let inverse: f64 = bodies.iter().flatten().map(|&b| 1.0 / system.mass(b)).sum();
        let square = stiffness * inverse;
        let stiff = square > STIFF * pace * pace && length > 0.0 && {
            system.relative_gradient(group, &[0.0; 6], &state.q, &mut gradient[..2 * n]);
            let rate = rate_along(&gradient[..2 * n], bodies, &state.v);
            let amplitude = resistance.drawn.abs()
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
        for group in tree.forms[*form].clone() {
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
    present: Option<&Relatives>,
) -> Relatives {
    let tree = system.tree();
    let groups = system.relative_groups();
    let reference = |group: usize| {
        let has_axes = groups[group].kind == RelativeKind::Direction;
        present.filter(|_| has_axes).map_or([0.0; 6], |present| present.references[group])
    };
    let mut relatives = Relatives {
        rows: Arc::default(),
        sources: vec![[Source::Dependent; 6]; tree.edges.len()].into(),
        references: (0..groups.len()).map(reference).collect(),
        anchors: vec![Anchor::default(); tree.edges.len()],
        exact: true,
        has_alternatives: false,
        moves: false,
        forms: forms.into(),
    };
    let mut x = vec![[0.0; 6]; tree.edges.len()];
    for c in coordinates {
        if let Some(winding) = tree.edges[c.edge].winding
            && groups[c.group].kind == RelativeKind::Angle
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

/// The edge that places each body.
fn edge_of_body(system: &dyn System) -> Vec<usize> {
    let edges = &system.tree().edges;
    let mut out = vec![0; edges.len()];
    for (at, edge) in edges.iter().enumerate() {
        out[edge.body] = at;
    }
    out
}
