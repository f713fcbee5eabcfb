//! The relative coordinates of a system: those of the edges of its spanning forest, and the deformations
//! of its force elements.

use super::bushing_axes::in_second_axes;
use super::space::Space;
use super::turns::{Along, along};
use crate::elements::kinematics::Between;
use crate::elements::relative::{RelativeElement, RelativeKind};
use crate::model::{
    BodyIndex, Branch, Dimension, DriverKind, ElasticLaw, Force, ForceKind, JointKind, Model,
};
use crate::topology::{Edge, Forest};
use crate::watch::{NAMED, checkpoint};
use std::ops::Range;

/// One to three relative coordinates of two bodies.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeGroup {
    /// Name of the joint, force or body they belong to.
    pub name: String,
    /// First and second body; of a bushing's deformations, the one first that carries their axes.
    pub bodies: [Option<usize>; 2],
    /// What they are.
    pub kind: RelativeKind,
    /// Number of coordinates.
    pub rows: usize,
    /// Largest turn from the reference at which they are regular, rad.
    pub reach: f64,
    /// Whether they are a rotation along other axes than those of the first body.
    pub has_own_axes: bool,
}

/// What an edge of the forest is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EdgeSource {
    /// A joint, by its place in the model.
    Joint(usize),
    /// A force element, by its place in the model.
    Force(usize),
    /// Nothing: the root of a component that is not tied to the ground.
    Free,
}

/// An edge of the spanning forest: how a body is placed against its parent.
#[derive(Debug, Clone, PartialEq)]
pub struct TreeEdge {
    /// The body at its outer end.
    pub body: usize,
    /// The body at its inner end.
    pub parent: Option<usize>,
    /// What it is.
    pub source: EdgeSource,
    /// Name of the joint or force, or of a free body.
    pub name: String,
    /// Groups that can serve as its coordinates. A spring has two sets of them: length, direction and rotation where it is
    /// stiff, else those of a free body; the second of others is empty.
    pub forms: [Range<usize>; 2],
    /// Winding that follows its angle.
    pub winding: Option<usize>,
    /// A driver that prescribes one of its coordinates: row of the driver, coordinate within the form and
    /// sign of the coordinate against the driven one.
    pub driver: Option<(usize, usize, f64)>,
}

impl TreeEdge {
    /// How many sets of groups can serve as its coordinates.
    pub fn form_count(&self) -> usize {
        1 + usize::from(!self.forms[1].is_empty())
    }
}

/// A row or rows that close loops of the forest.
#[derive(Debug, Clone, PartialEq)]
pub struct Closure {
    /// First constraint row.
    pub row: usize,
    /// Number of rows.
    pub rows: usize,
    /// The bodies that it ties; the loop is closed by the way between them through the forest.
    pub ends: [Option<usize>; 2],
}

/// A force element with the deformations that it resists.
#[derive(Debug, Clone, PartialEq)]
pub struct ElasticLoop {
    /// Place of the force in the model.
    pub force: usize,
    /// Groups of its deformations.
    pub groups: Vec<usize>,
    /// Its bodies; of a bushing, the one first that carries the axes.
    pub ends: [Option<usize>; 2],
    /// Whether it is an edge of the forest itself.
    pub is_edge: bool,
}

/// What resists a deformation that changes at a rate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Resistance {
    /// Stiffness that counts at the rate, N/m or N m/rad: that of the spring or of the damper beside it, the larger.
    pub stiffness: f64,
    /// How far its spring draws it back, m or rad: to where it is unloaded, or as far as the damper beside it lets it come
    /// meanwhile.
    pub drawn: f64,
}

/// Everything about the forest that parameter values leave alone.
#[derive(Debug, Clone, PartialEq)]
pub struct Tree {
    /// The forest; edges by their place in [`Tree::edges`] are those of `forest.order`.
    pub forest: Forest,
    /// Edges, parents before children.
    pub edges: Vec<TreeEdge>,
    /// Joints and drivers that close loops.
    pub closures: Vec<Closure>,
    /// Force elements.
    pub elastic: Vec<ElasticLoop>,
    /// Force elements that can be edges: numbers of a model decide which, and a forest serves another model only if they are
    /// the same.
    pub offered: Vec<usize>,
    /// Bushings, by their places in the model, whose deformations are measured along axes of the second body.
    pub in_second_axes: Vec<usize>,
    /// Bodies of angles whose turns no edge of the forest tells.
    pub untold_turns: Vec<[Option<usize>; 2]>,
    /// Bodies of joints in loops that count turns.
    pub turns_in_loops: Vec<[Option<usize>; 2]>,
}

/// A group with its functions.
#[derive(Debug, Clone)]
pub(super) struct PlacedRelative<E> {
    pub(super) bodies: [Option<usize>; 2],
    pub(super) element: E,
}

/// Kinematics of an edge, one per form, with which body is first and which one it places.
#[derive(Debug, Clone)]
pub(super) struct PlacedEdge<K> {
    pub(super) kinematics: Vec<K>,
    pub(super) bodies: [Option<usize>; 2],
    pub(super) body: usize,
    pub(super) parent: Option<usize>,
}

/// Kinematics of all edges by their places in the tree. In memory they follow each other as in the walk along the forest, in which
/// bodies are placed.
#[derive(Debug, Clone)]
pub(super) struct PlacedEdges<K> {
    edges: Vec<PlacedEdge<K>>,
    /// Of each edge among them.
    at: Vec<u32>,
}

impl<K: Clone> PlacedEdges<K> {
    pub(super) fn along(tree: &Tree, edges: &[PlacedEdge<K>]) -> Self {
        let mut edge_of_body = vec![0; tree.forest.parent.len()];
        edges.iter().enumerate().for_each(|(at, edge)| edge_of_body[edge.body] = at);
        let mut at = vec![0; edges.len()];
        let walk = tree.forest.walk().into_iter().enumerate();
        let edges = walk.map(|(place, body)| {
            let edge = edge_of_body[body];
            at[edge] = place as u32;
            edges[edge].clone()
        });
        Self { edges: edges.collect(), at }
    }
}

impl<K> std::ops::Index<usize> for PlacedEdges<K> {
    type Output = PlacedEdge<K>;

    fn index(&self, edge: usize) -> &PlacedEdge<K> {
        &self.edges[self.at[edge] as usize]
    }
}

/// What [`build`] finds.
pub(super) struct Built<R, K> {
    pub(super) tree: Tree,
    pub(super) groups: Vec<RelativeGroup>,
    pub(super) relatives: Vec<PlacedRelative<R>>,
    pub(super) edges: Vec<PlacedEdge<K>>,
}

/// Distance joints come after all others, forces after all joints.
const DISTANCE_CLASS: u32 = 100;
const FORCE_CLASS: u32 = 200;

fn class_of(kind: &JointKind, planar: bool) -> u32 {
    match kind {
        JointKind::Fixed => 0,
        JointKind::Revolute | JointKind::Translational => 1,
        JointKind::Cylindrical | JointKind::Universal => 2,
        JointKind::Spherical => 3,
        JointKind::Distance { .. } => DISTANCE_CLASS + u32::from(planar),
    }
}

/// Whether the length of a line could be a coordinate that it resists: not where nothing but a spring draws it to zero, where
/// a line has no direction.
fn keeps_length(kind: &ForceKind) -> bool {
    match kind {
        ForceKind::Tsda { law: ElasticLaw::Linear(_), damping, free_length, .. } => {
            *free_length > 0.0 || *damping > 0.0
        }
        ForceKind::Tsda { .. } => true,
        ForceKind::Maxwell { free_length, .. } => *free_length > 0.0,
        _ => false,
    }
}

/// Stiffness of a force element that can be an edge, N/m.
fn edge_stiffness(force: &Force) -> Option<f64> {
    let initial = |law: &ElasticLaw| match law {
        ElasticLaw::Linear(stiffness) => *stiffness,
        ElasticLaw::Table(table) => table.value_and_slope(0.0).1,
    };
    match &force.kind {
        ForceKind::Tsda { law, .. } if keeps_length(&force.kind) => Some(initial(law)),
        ForceKind::Maxwell { stiffness, .. } if keeps_length(&force.kind) => Some(*stiffness),
        ForceKind::Bushing { stiffness, branches, .. } => {
            let along = |k: usize| {
                stiffness[k][k] + branches.iter().map(|branch| branch.stiffness[k][k]).sum::<f64>()
            };
            Some((0..3).map(along).fold(0.0, f64::max))
        }
        _ => None,
    }
}

/// Force elements that can be edges.
pub(super) fn offered(model: &Model) -> Vec<usize> {
    let forces = model.forces.iter().enumerate();
    forces.filter(|(_, force)| edge_stiffness(force).is_some()).map(|(k, _)| k).collect()
}

/// Edges of the graph: joints in file order, then forces that can be edges, with their places.
fn graph(model: &Model) -> (Vec<Edge>, Vec<EdgeSource>) {
    let planar = model.dimension == Dimension::Planar;
    let mass = |body: BodyIndex| body.map(|b| model.bodies[b].mass);
    let mut cut = vec![false; model.joints.len()];
    model.simulation.cut.iter().for_each(|&joint| cut[joint] = true);
    let mut edges = Vec::new();
    let mut sources = Vec::new();
    for (k, joint) in model.joints.iter().enumerate() {
        let ends = joint.frames.map(|f| f.body);
        let class = if cut[k] { Edge::CUT } else { class_of(&joint.kind, planar) };
        edges.push(Edge { ends, class, strength: 0.0 });
        sources.push(EdgeSource::Joint(k));
    }
    for (k, force) in model.forces.iter().enumerate() {
        let (Some(stiffness), Some(frames)) = (edge_stiffness(force), frames_of(force)) else {
            continue;
        };
        let ends = frames.map(|f| f.body);
        let inverse: f64 = ends.into_iter().filter_map(mass).map(|m| 1.0 / m.max(1e-300)).sum();
        edges.push(Edge { ends, class: FORCE_CLASS, strength: stiffness * inverse });
        sources.push(EdgeSource::Force(k));
    }
    (edges, sources)
}

/// Frames of a force element between two bodies.
fn frames_of(force: &Force) -> Option<[crate::model::Frame; 2]> {
    match &force.kind {
        ForceKind::Tsda { frames, .. }
        | ForceKind::Rsda { frames, .. }
        | ForceKind::Maxwell { frames, .. }
        | ForceKind::Bushing { frames, .. } => Some(*frames),
        _ => None,
    }
}

/// Groups and edges of a model; the forest of `base`, whose model differs in numbers only, serves again.
/// `rows` are the first rows of joints and drivers, `windings` those of the joints.
pub(super) fn build<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    model: &Model,
    center: impl Fn(BodyIndex) -> [f64; 3],
    rows: &[(usize, usize)],
    windings: &[Option<usize>],
    base: Option<&Forest>,
) -> Built<S::Relative, S::Kinematics> {
    let (graph_edges, sources) = graph(model);
    let forest = base.cloned().unwrap_or_else(|| {
        let masses: Vec<f64> = model.bodies.iter().map(|b| b.mass).collect();
        Forest::new(&masses, &graph_edges)
    });
    let depth = |body: BodyIndex| body.map_or(0, |b| forest.depth[b]);
    let in_second = in_second_axes(model, depth);
    // The body that carries the axes comes first.
    let measured_frames = |force: usize| {
        let frames = frames_of(&model.forces[force]);
        frames
            .map(|[first, second]| if in_second[force] { [second, first] } else { [first, second] })
    };
    let mut groups = Vec::new();
    let mut relatives = Vec::new();
    let mut add = |name: &str, bodies: [Option<usize>; 2], element: S::Relative| {
        groups.push(RelativeGroup {
            name: name.to_owned(),
            bodies,
            kind: element.kind(),
            rows: element.rows(),
            reach: element.reach(),
            has_own_axes: element.has_own_axes(),
        });
        relatives.push(PlacedRelative { bodies, element });
        groups.len() - 1
    };
    let mut edges = Vec::with_capacity(forest.order.len());
    let mut placed = Vec::with_capacity(forest.order.len());
    let mut edge_of_force = vec![None; model.forces.len()];
    let mut edge_of_joint = vec![None; model.joints.len()];
    for &body in &forest.order {
        checkpoint(NAMED);
        let source = forest.edge[body].map_or(EdgeSource::Free, |k| sources[k]);
        let (name, ends, forms) = match source {
            EdgeSource::Joint(k) => {
                let joint = &model.joints[k];
                let ends = joint.frames.map(|f| f.body);
                (&joint.name, ends, vec![S::joint_form(joint, ends.map(&center))])
            }
            EdgeSource::Force(k) => {
                let force = &model.forces[k];
                let frames = measured_frames(k).expect("an edge has frames");
                let ends = frames.map(|f| f.body);
                let centers = ends.map(&center);
                let forms = if let ForceKind::Bushing { .. } = force.kind {
                    vec![S::bushing_form(&frames, centers)]
                } else {
                    vec![S::line_form(&frames, centers), S::free_form()]
                };
                (&force.name, ends, forms)
            }
            EdgeSource::Free => {
                (&model.bodies[body].name, [None, Some(body)], vec![S::free_form()])
            }
        };
        let mut kinematics = Vec::with_capacity(forms.len());
        let mut form_groups = [0..0, 0..0];
        for ((kind, coordinates), groups_of_form) in forms.into_iter().zip(&mut form_groups) {
            let place = |(element, between): (S::Relative, Between)| {
                let bodies = match between {
                    Between::Both => ends,
                    Between::GroundAndChild => [None, Some(body)],
                };
                add(name, bodies, element)
            };
            let mut places = coordinates.into_iter().map(place);
            if let Some(first) = places.next() {
                *groups_of_form = first..places.last().unwrap_or(first) + 1;
            }
            kinematics.push(kind);
        }
        let at = edges.len();
        let winding = match source {
            EdgeSource::Joint(k) => {
                edge_of_joint[k] = Some(at);
                windings[k]
            }
            EdgeSource::Force(k) => {
                edge_of_force[k] = Some(at);
                None
            }
            EdgeSource::Free => None,
        };
        edges.push(TreeEdge {
            body,
            parent: forest.parent[body],
            source,
            name: name.clone(),
            forms: form_groups,
            winding,
            driver: None,
        });
        placed.push(PlacedEdge { kinematics, bodies: ends, body, parent: forest.parent[body] });
    }

    let mut edge_of_body = vec![0; model.bodies.len()];
    for (at, edge) in edges.iter().enumerate() {
        edge_of_body[edge.body] = at;
    }
    let mut closures = Vec::new();
    let mut untold_turns = Vec::new();
    for (k, joint) in model.joints.iter().enumerate() {
        if edge_of_joint[k].is_none() {
            let ends = joint.frames.map(|f| f.body);
            closures.push(Closure { row: rows[k].0, rows: rows[k].1, ends });
        }
    }
    let closed_by_joints = closures.len();
    for (k, driver) in model.drivers.iter().enumerate() {
        let ends = driver.frames.map(|f| f.body);
        let (row, count) = rows[model.joints.len() + k];
        if let Some(body) = forest.outer(ends) {
            let edge = &mut edges[edge_of_body[body]];
            if edge.driver.is_none()
                && let EdgeSource::Joint(j) = edge.source
            {
                let joint = &model.joints[j];
                edge.driver =
                    prescribed(model, &joint.kind, &joint.frames, driver.kind, &driver.frames)
                        .map(|(coordinate, sign)| (row, coordinate, sign));
                if edge.driver.is_some() {
                    continue;
                }
            }
        }
        if driver.kind == DriverKind::Rotation {
            untold_turns.push(ends);
        }
        closures.push(Closure { row, rows: count, ends });
    }

    let mut elastic = Vec::new();
    for (k, force) in model.forces.iter().enumerate() {
        checkpoint(NAMED);
        let Some(frames) = measured_frames(k) else { continue };
        let ends = frames.map(|f| f.body);
        let centers = ends.map(&center);
        let edge = edge_of_force[k].map(|at: usize| &edges[at]);
        let own = match (&force.kind, edge) {
            (ForceKind::Bushing { .. }, Some(edge)) => edge.forms[0].clone().collect(),
            (ForceKind::Bushing { .. }, None) => {
                let (_, coordinates) = S::bushing_form(&frames, centers);
                coordinates
                    .into_iter()
                    .map(|(element, _)| add(&force.name, ends, element))
                    .collect()
            }
            (ForceKind::Rsda { .. }, _) => {
                // On a joint about the same axis it is the joint's own coordinate.
                let on_joint = forest.outer(ends).and_then(|body| {
                    let edge: &TreeEdge = &edges[edge_of_body[body]];
                    let EdgeSource::Joint(j) = edge.source else { return None };
                    let (kind, joint) = (&model.joints[j].kind, &model.joints[j].frames);
                    let rotation = DriverKind::Rotation;
                    let (at, _) = prescribed(model, kind, joint, rotation, &frames)?;
                    edge.forms[0].clone().nth(at)
                });
                match on_joint {
                    Some(group) => {
                        elastic.push(ElasticLoop {
                            force: k,
                            groups: vec![group],
                            ends,
                            is_edge: true,
                        });
                        continue;
                    }
                    None => vec![add(&force.name, ends, S::relative_angle(&frames, centers))],
                }
            }
            (_, Some(edge)) => edge.forms[0].clone().take(1).collect(),
            (line, None) if keeps_length(line) => {
                let (_, mut coordinates) = S::line_form(&frames, centers);
                vec![add(&force.name, ends, coordinates.swap_remove(0).0)]
            }
            _ => continue,
        };
        elastic.push(ElasticLoop { force: k, groups: own, ends, is_edge: edge.is_some() });
    }
    let offered = offered(model);
    let turns = |edge: &TreeEdge| {
        let angle = |group: usize| groups[group].kind == RelativeKind::Angle;
        matches!(edge.source, EdgeSource::Joint(_)) && edge.forms[0].clone().any(angle)
    };
    let is_in_loop = within_loops(&edges, &edge_of_body, &closures[..closed_by_joints]);
    let in_loops = edges.iter().zip(is_in_loop).filter(|(edge, is_in)| *is_in && turns(edge));
    let turns_in_loops = in_loops.map(|(edge, _)| [edge.parent, Some(edge.body)]).collect();
    let in_second_axes = (0..in_second.len()).filter(|&k| in_second[k]).collect();
    let tree = Tree {
        forest,
        edges,
        closures,
        elastic,
        offered,
        in_second_axes,
        untold_turns,
        turns_in_loops,
    };
    groups.shrink_to_fit();
    relatives.shrink_to_fit();
    Built { tree, groups, relatives, edges: placed }
}

/// Whether each edge is on the way between the ends of a closure.
fn within_loops(edges: &[TreeEdge], edge_of_body: &[usize], closures: &[Closure]) -> Vec<bool> {
    let mut depth = vec![0u32; edges.len()];
    for (at, edge) in edges.iter().enumerate() {
        depth[at] = edge.parent.map_or(0, |parent| depth[edge_of_body[parent]] + 1);
    }
    let depth_of = |body: Option<usize>| body.map_or(0, |b| depth[edge_of_body[b]] + 1);
    let mut is_in_loop = vec![false; edges.len()];
    // Ways that are known to be in loops are gone along once: each body knows one up to which its way is.
    let mut up_to: Vec<Option<usize>> = edges.iter().map(|edge| Some(edge.body)).collect();
    let top = |up_to: &mut [Option<usize>], from: Option<usize>| {
        let mut at = from;
        while let Some(body) = at
            && up_to[edge_of_body[body]] != at
        {
            let next = up_to[edge_of_body[body]];
            if let Some(next) = next {
                up_to[edge_of_body[body]] = up_to[edge_of_body[next]];
            }
            at = next;
        }
        at
    };
    for closure in closures {
        let [mut a, mut b] = closure.ends.map(|end| top(&mut up_to, end));
        while a != b {
            if depth_of(a) < depth_of(b) {
                std::mem::swap(&mut a, &mut b);
            }
            let Some(body) = a else { break };
            let edge = edge_of_body[body];
            is_in_loop[edge] = true;
            up_to[edge] = edges[edge].parent;
            a = top(&mut up_to, edges[edge].parent);
        }
    }
    is_in_loop
}

/// The coordinate of a joint that a driver prescribes and its sign, if it is one up to a constant.
fn prescribed(
    model: &Model,
    joint: &JointKind,
    joint_frames: &[crate::model::Frame; 2],
    driver: DriverKind,
    driver_frames: &[crate::model::Frame; 2],
) -> Option<(usize, f64)> {
    let planar = model.dimension == Dimension::Planar;
    let axis = if planar && driver == DriverKind::Translation { 0 } else { 2 };
    let Along { order, cosine } = along(model, driver_frames, joint_frames, axis)?;
    let coordinate = match (joint, driver) {
        (JointKind::Revolute, DriverKind::Rotation)
        | (JointKind::Translational | JointKind::Cylindrical, DriverKind::Translation) => 0,
        (JointKind::Cylindrical, DriverKind::Rotation) => 1,
        _ => return None,
    };
    // A displacement along an axis of the first body is not one along that of the second, which may
    // turn against it; signs of rotations change with the order of the bodies.
    if driver == DriverKind::Translation && order < 0.0 && matches!(joint, JointKind::Cylindrical) {
        return None;
    }
    Some((coordinate, order * cosine.signum()))
}

/// The law of a force element along its deformations.
#[derive(Debug, Clone)]
pub(super) enum ResistanceLaw {
    Line(ElasticLaw, f64, f64),
    Angle(ElasticLaw, f64, f64),
    Series(f64, f64, f64),
    /// Stiffness and damping of itself and of its branches, in each direction of its own axes, as they stand in the design
    /// configuration: where deformations turn against these, the law is nearly the same in all.
    Bushing([f64; 6], [f64; 6], Vec<[[f64; 2]; 6]>),
}

/// Stiffness of a spring and a damper in series, at a rate.
fn in_series(stiffness: f64, damping: f64, rate: f64) -> f64 {
    let sum = stiffness + damping * rate;
    if sum > 0.0 { stiffness * damping * rate / sum } else { 0.0 }
}

impl ResistanceLaw {
    pub(super) fn of(force: &Force) -> Option<Self> {
        match &force.kind {
            ForceKind::Tsda { law, damping, free_length, .. } => {
                Some(Self::Line(law.clone(), *damping, *free_length))
            }
            ForceKind::Rsda { law, damping, free_angle, .. } => {
                Some(Self::Angle(law.clone(), *damping, *free_angle))
            }
            ForceKind::Maxwell { stiffness, damping, free_length, .. } => {
                Some(Self::Series(*stiffness, *damping, *free_length))
            }
            ForceKind::Bushing { stiffness, damping, branches, .. } => {
                let both =
                    |b: &Branch| [0, 1, 2, 3, 4, 5].map(|k| [b.stiffness[k][k], b.damping[k][k]]);
                Some(Self::Bushing(
                    std::array::from_fn(|k| stiffness[k][k]),
                    std::array::from_fn(|k| damping[k][k]),
                    branches.iter().map(both).collect(),
                ))
            }
            _ => None,
        }
    }

    /// At the value of a deformation that changes at a rate, 1/s.
    pub(super) fn at(&self, row: usize, value: f64, rate: f64) -> Resistance {
        let parallel = |load: f64, stiffness: f64, damping: f64| {
            let stiffness = stiffness.max(damping * rate);
            Resistance { stiffness, drawn: if load == 0.0 { 0.0 } else { load / stiffness } }
        };
        match self {
            Self::Line(law, damping, free) | Self::Angle(law, damping, free) => {
                let x = value - free;
                let (load, stiffness) = match law {
                    ElasticLaw::Linear(stiffness) => (stiffness * x, *stiffness),
                    ElasticLaw::Table(table) => table.value_and_slope(x),
                };
                parallel(load, stiffness, *damping)
            }
            Self::Series(stiffness, damping, free) => {
                let stiffness = in_series(*stiffness, *damping, rate);
                // All of it, as if the damper had not moved.
                Resistance { stiffness, drawn: value - free }
            }
            Self::Bushing(stiffness, damping, branches) => {
                let of_branch = |b: &[[f64; 2]; 6]| in_series(b[row][0], b[row][1], rate);
                let branches: f64 = branches.iter().map(of_branch).sum();
                let spring = parallel(stiffness[row] * value, stiffness[row], damping[row]);
                Resistance { stiffness: spring.stiffness + branches, ..spring }
            }
        }
    }
}
