//! From a model to a system in Cartesian coordinates.

use super::cartesian::Cartesian;
use super::cartesian_planar::Planar;
use super::cartesian_spatial::Spatial;
use super::forest::{self, PlacedEdges, ResistanceLaw};
use super::placed::{Elements, Part, PlacedBody, PlacedConstraint, PlacedForce, Slots};
use super::quantities::Channels;
use super::space::Space;
use super::structure::{JointRows, Sizes, Structure};
use super::turns::Turns;
use super::{ExtraBlock, LawArgument, Measure, System};
use crate::elements::{ConstraintElement, ForceElement};
use crate::model::{BodyIndex, Dimension, ForceKind, Model};
use crate::topology::Forest;
use crate::watch::{NAMED, checkpoint, stage};
use holonom_linalg::BlockPattern;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Most parts of a system that are evaluated at the same time, and bodies of the smallest.
const PARTS: usize = 16;
const SMALLEST_PART: usize = 32;

/// Compiles a model in Cartesian coordinates.
pub fn compile(model: &Model) -> Arc<dyn System> {
    stage("compiling", || -> Arc<dyn System> {
        match model.dimension {
            Dimension::Planar => Arc::new(build::<Planar, 2, 3, 3>(model, None, None)),
            Dimension::Spatial => Arc::new(build::<Spatial, 3, 7, 6>(model, None, None)),
        }
    })
}

/// Compiles a model along a forest that was found for one that differs in numbers only.
pub fn compile_along(model: &Model, forest: &Forest) -> Arc<dyn System> {
    match model.dimension {
        Dimension::Planar => Arc::new(build::<Planar, 2, 3, 3>(model, None, Some(forest))),
        Dimension::Spatial => Arc::new(build::<Spatial, 3, 7, 6>(model, None, Some(forest))),
    }
}

/// Assembles numbers, places and patterns of a model; patterns and forest of `base` are shared where the
/// model has the same structure.
pub(super) fn build<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    model: &Model,
    base: Option<&Cartesian<S, D, N, W>>,
    forest: Option<&Forest>,
) -> Cartesian<S, D, N, W> {
    let center = |body: BodyIndex| body.map_or([0.0; 3], |b| model.bodies[b].center_of_mass);
    let bodies: Vec<PlacedBody> = model
        .bodies
        .iter()
        .map(|b| PlacedBody {
            name: b.name.clone(),
            mass: b.mass,
            inertia: b.inertia,
            center: b.center_of_mass,
            markers: b.markers.clone(),
        })
        .collect();
    let mut constraints = Vec::with_capacity(model.joints.len() + model.drivers.len());
    let mut row = 0;
    let joints = model.joints.iter().map(|j| {
        let [first, second] = j.frames.map(|f| f.body);
        let ends = [first, second];
        let element = S::joint(j, ends.map(center));
        (&j.name, "joint", [first, second], element, Vec::new())
    });
    let drivers = model.drivers.iter().map(|d| {
        let [first, second] = d.frames.map(|f| f.body);
        let element = S::driver(d, [center(first), center(second)]);
        (&d.name, "driver", [first, second], element, d.motion.breakpoints())
    });
    for (name, kind, ends, element, breakpoints) in joints.chain(drivers) {
        checkpoint(NAMED);
        let rows = element.rows();
        constraints.push(PlacedConstraint {
            name: name.clone(),
            kind,
            element,
            bodies: ends,
            row,
            breakpoints,
            turns: None,
        });
        row += rows;
    }
    let (mut extra_states, mut extra_squares, mut windings) = (0, 0, 0);
    let mut forces = Vec::with_capacity(model.forces.len());
    for f in &model.forces {
        checkpoint(NAMED);
        let ends = S::force_bodies(f);
        let element = S::force(f, ends.map(center));
        let count = element.extra_states();
        let extra = ExtraBlock { first: extra_states, count, square: extra_squares };
        (extra_states, extra_squares) = (extra.states().end, extra.own().end);
        let turns = match &f.kind {
            ForceKind::Rsda { frames, .. } if element.counts_turns() => {
                Some(Turns::new(post_increment(&mut windings), frames, model))
            }
            _ => None,
        };
        forces.push(PlacedForce { name: f.name.clone(), element, bodies: ends, extra, turns });
    }
    for (c, joint) in constraints.iter_mut().zip(&model.joints) {
        if c.element.counts_turns() {
            c.turns = Some(Turns::new(post_increment(&mut windings), &joint.frames, model));
        }
    }
    let normalization_start = row;
    let sizes = Sizes {
        bodies: bodies.len(),
        coordinates: N * bodies.len(),
        per_body: N,
        translations: D,
        rows: row + if S::NORMALIZED { bodies.len() } else { 0 },
        joint_rows: row,
        extra_states,
        windings,
    };
    let base = base
        .filter(|b| b.same_structure(&constraints, &forces))
        .filter(|b| b.structure.sizes == sizes && b.tree.offered == forest::offered(model));
    let mut gravity = model.gravity;
    gravity[D..].fill(0.0);
    let rows: Vec<(usize, usize)> = constraints.iter().map(|c| (c.row, c.element.rows())).collect();
    let joint_windings: Vec<Option<usize>> =
        constraints.iter().map(|c| c.turns.as_ref().map(|t| t.index)).collect();
    let known = forest.or(base.map(|b| &b.tree.forest));
    let mut built = forest::build::<S, D, N, W>(model, center, &rows, &joint_windings, known);
    // Rows of P have the places of the body that carries the axes first.
    let base = base.filter(|b| b.tree.in_second_axes == built.tree.in_second_axes);
    let (structure, slots) = match base {
        Some(base) => (base.structure.clone(), base.slots.clone()),
        None => {
            let walk = built.tree.forest.walk();
            let (structure, slots) =
                patterns::<S, D, N, W>(sizes, normalization_start, &constraints, &forces, &walk);
            (Arc::new(structure), Arc::new(slots))
        }
    };
    let untold = tell_turns(model, &built.tree, &mut constraints, &mut forces);
    built.tree.untold_turns.extend(untold);
    let resistance = |e: &super::ElasticLoop| ResistanceLaw::of(&model.forces[e.force]);
    let resistances = built.tree.elastic.iter().filter_map(resistance).collect();
    let knots = forces.iter().enumerate().flat_map(|(force, f)| {
        let of_force = f.element.knots().into_iter().enumerate();
        let measure = match &model.forces[force].kind {
            ForceKind::Rsda { .. } | ForceKind::Torque { .. } => Measure::Angle,
            ForceKind::Tsda { .. }
            | ForceKind::Maxwell { .. }
            | ForceKind::Bushing { .. }
            | ForceKind::Tyre(_)
            | ForceKind::PointForce { .. } => Measure::Length,
        };
        let others = of_force.len() - f.element.velocities();
        of_force.map(move |(index, knots)| LawArgument {
            force,
            index,
            measure,
            is_velocity: index >= others,
            knots,
        })
    });
    let arguments = knots.collect();
    let edges = PlacedEdges::along(&built.tree, &built.edges);
    Cartesian {
        arguments,
        structure,
        slots,
        bodies,
        constraints,
        forces,
        tree: Arc::new(built.tree),
        groups: built.groups,
        relatives: built.relatives,
        edges,
        resistances,
        gravity,
        length: model.characteristic_length(),
        channels: Channels::default(),
    }
}

/// Lets angles of forces follow the joints of the forest about the same axis; returns the bodies of
/// the angles whose turns neither a driver nor the forest tells.
fn tell_turns<C, F>(
    model: &Model,
    tree: &super::Tree,
    constraints: &mut [PlacedConstraint<C>],
    forces: &mut [PlacedForce<F>],
) -> Vec<[BodyIndex; 2]> {
    // Only joints between the same two bodies can tell turns.
    let pair = |[a, b]: [BodyIndex; 2]| (a.min(b), a.max(b));
    let mut leaders: BTreeMap<_, Vec<(usize, usize)>> = BTreeMap::new();
    let mut leads = vec![false; constraints.len()];
    for edge in &tree.edges {
        if let (super::EdgeSource::Joint(joint), Some(winding)) = (edge.source, edge.winding) {
            leads[joint] = true;
            leaders.entry(pair(constraints[joint].bodies)).or_default().push((joint, winding));
        }
    }
    let mut untold = Vec::new();
    for (placed, force) in forces.iter_mut().zip(&model.forces) {
        let (Some(turns), ForceKind::Rsda { frames, .. }) = (&mut placed.turns, &force.kind) else {
            continue;
        };
        let mut follow = |&(joint, winding): &(usize, usize)| {
            turns.follow(model, frames, &model.joints[joint].frames, winding)
        };
        let near = leaders.get(&pair(placed.bodies)).map_or(&[][..], Vec::as_slice);
        if !near.iter().any(&mut follow) && !turns.is_driven() {
            untold.push(placed.bodies);
        }
    }
    for (joint, placed) in constraints.iter().enumerate() {
        let Some(turns) = &placed.turns else { continue };
        if !turns.is_driven() && !leads[joint] {
            untold.push(placed.bodies);
        }
    }
    untold
}

fn post_increment(counter: &mut usize) -> usize {
    *counter += 1;
    *counter - 1
}

/// Numbers the blocks of all patterns.
fn patterns<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    sizes: Sizes,
    normalization_start: usize,
    constraints: &[PlacedConstraint<S::Constraint>],
    forces: &[PlacedForce<S::Force>],
    walk: &[usize],
) -> (Structure, Slots) {
    let mut position = vec![0; sizes.bodies];
    walk.iter().enumerate().for_each(|(at, &body)| position[body] = at as u32);
    // Places are named in the order in which their blocks are handed out again below.
    let mut jacobian = Vec::new();
    let mut stiffness = Vec::new();
    let mut mass = Vec::new();
    for b in 0..sizes.bodies {
        stiffness.push((b * N, b * N, N, N));
        mass.push((b * N, b * N, D, D));
        mass.push((b * N + D, b * N + D, N - D, N - D));
    }
    for c in constraints {
        for b in c.bodies.into_iter().flatten() {
            jacobian.push((c.row, b * N, c.element.rows(), N));
        }
    }
    if S::NORMALIZED {
        for b in 0..sizes.bodies {
            jacobian.push((normalization_start + b, b * N + D, 1, N - D));
        }
    }
    let of_constraints = constraints.iter().map(|c| (c.bodies, c.element.couples()));
    let pairs = of_constraints.chain(forces.iter().map(|f| (f.bodies, true)));
    for (ends, coupled) in pairs {
        for i in ends.into_iter().flatten() {
            let others = ends.into_iter().flatten().filter(|j| coupled || *j == i);
            stiffness.extend(others.map(|j| (i * N, j * N, N, N)));
        }
    }
    // Values stand in the order of the walk: a block belongs to the last of its bodies.
    let later = |ends: [Option<usize>; 2]| ends.into_iter().flatten().map(|b| position[b]).max();
    let mut row_owner = vec![0; sizes.rows];
    for c in constraints {
        row_owner[c.row..c.row + c.element.rows()].fill(later(c.bodies).unwrap_or_default());
    }
    for (owner, position) in row_owner[normalization_start..].iter_mut().zip(&position) {
        *owner = *position;
    }
    let of_row = |block: &Place| row_owner[block.0];
    let of_pair = |block: &Place| position[block.0 / N].max(position[block.1 / N]);
    let (constraint_pattern, ids) =
        BlockPattern::new(sizes.rows, sizes.coordinates, &in_order(&jacobian, of_row));
    let mut jacobian_ids = ids.into_iter().skip(jacobian.len());
    let square = sizes.coordinates;
    let (stiffness_pattern, ids) =
        BlockPattern::new(square, square, &in_order(&stiffness, of_pair));
    let mut stiffness_ids = ids.into_iter().skip(stiffness.len());
    let (mass_pattern, mass_ids) = BlockPattern::new(square, square, &mass);
    let mut place = |b: Option<usize>| b.and_then(|_| jacobian_ids.next());
    let mut slots = Slots {
        jacobian: constraints.iter().map(|c| c.bodies.map(&mut place)).collect(),
        normalization: Vec::new(),
        diagonal: stiffness_ids.by_ref().take(sizes.bodies).collect(),
        mass: mass_ids.chunks_exact(2).map(|ids| [ids[0], ids[1]]).collect(),
        ..Slots::default()
    };
    slots.normalization = jacobian_ids.collect();
    let mut place = |ends: [Option<usize>; 2], coupled: bool| {
        ends.map(|i| {
            let mut next = |_| stiffness_ids.next();
            ends.map(|j| i.and(j).filter(|_| coupled || i == j).and_then(&mut next))
        })
    };
    slots.constraint_pairs =
        constraints.iter().map(|c| place(c.bodies, c.element.couples())).collect();
    slots.force_pairs = forces.iter().map(|f| place(f.bodies, true)).collect();
    let ends = |pattern: &BlockPattern, owner: &dyn Fn(&Place) -> u32| -> Vec<usize> {
        let mut ends = vec![0; sizes.bodies];
        let mut at = 0;
        for place in pattern.shapes() {
            at += place.2 * place.3;
            ends[owner(&place) as usize] = at;
        }
        let mut last = 0;
        ends.into_iter()
            .map(|end| {
                last = end.max(last);
                last
            })
            .collect()
    };
    let of_k = ends(&stiffness_pattern, &of_pair);
    let of_g = ends(&constraint_pattern, &of_row);
    let size = sizes.bodies.div_ceil(PARTS).max(SMALLEST_PART);
    let mut parts: Vec<Part> = (0..sizes.bodies)
        .step_by(size)
        .map(|first| {
            let end = sizes.bodies.min(first + size);
            let elements = Elements::default();
            Part { elements, end: [end, of_k[end - 1], of_g[end - 1]] }
        })
        .collect();
    let mut rest = Elements::default();
    let part_of = |ends: [Option<usize>; 2]| {
        let [a, b] = ends.map(|body| body.map(|body| position[body] as usize / size));
        if a.is_some() && b.is_some() && a != b { None } else { a.or(b) }
    };
    for (k, c) in constraints.iter().enumerate() {
        let to = part_of(c.bodies).map_or(&mut rest, |part| &mut parts[part].elements);
        to.constraints.push(k as u32);
    }
    for (k, f) in forces.iter().enumerate() {
        let to = part_of(f.bodies).map_or(&mut rest, |part| &mut parts[part].elements);
        to.forces.push(k as u32);
    }
    let walk = walk.iter().map(|&body| body as u32).collect();
    (slots.walk, slots.position, slots.parts, slots.rest) = (walk, position, parts, rest);
    let mut row_measure = vec![Measure::Angle; sizes.rows];
    for c in constraints {
        for k in 0..c.element.rows() {
            if c.element.row_kind(k).is_length() {
                row_measure[c.row + k] = Measure::Length;
            }
        }
    }
    let joints = constraints.iter().zip(&slots.jacobian).map(|(c, blocks)| JointRows {
        row: c.row,
        rows: c.element.rows(),
        bodies: c.bodies,
        blocks: *blocks,
    });
    let with_states = forces.iter().filter(|f| f.extra.count > 0);
    let structure = Structure {
        sizes,
        joints: joints.collect(),
        constraint_pattern,
        mass_pattern,
        stiffness_pattern,
        forces: forces.iter().map(|f| f.bodies).collect(),
        extra_bodies: with_states.clone().flat_map(|f| vec![f.bodies; f.extra.count]).collect(),
        extra_blocks: with_states.map(|f| f.extra).collect(),
        row_measure,
        normalization_start,
    };
    (structure, slots)
}

/// First row and column, rows and columns of a block.
type Place = (usize, usize, usize, usize);

/// The blocks in the order of their owners, then once more as they are.
fn in_order(blocks: &[Place], owner: impl Fn(&Place) -> u32) -> Vec<Place> {
    let mut all = blocks.to_vec();
    all.sort_by_key(owner);
    all.extend(blocks);
    all
}
