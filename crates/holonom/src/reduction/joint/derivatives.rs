//! M̂, M̂₁ and M̂₂ with what extra states and explicit time add, by first variations of the recursions.
//!
//! Equations: `docs/theory/joint.md` (13)-(23).

use super::ReducedDerivatives;
use super::algebra::Algebra;
use super::closures::{Closure, Closures, Origin};
use super::engine::{Edge, Engine, add, dot, pose, pose_mut};
use super::interactions::{EndRow, Interaction, OwnWrench};
use super::own_motion::OwnMotion;
use super::varied::{Mover, Plan, Varied};
use crate::reduction::parametrization::Parametrization;
use crate::reduction::relatives::Source;
use crate::system::{DerivativeBlocks, State, Structure};
use std::collections::BTreeMap;

/// Room for derivatives, and those of the motion of each part at the state at hand.
#[derive(Debug, Clone)]
pub(super) struct Derivatives<const W: usize> {
    /// By independent variables; and what time moves by drivers.
    pub(super) movers: Vec<Mover>,
    pub(super) time: Mover,
    pub(super) own: Vec<OwnWrench<W>>,
    pub(super) interactions: Vec<Interaction<W>>,
    /// By the body that moves: places among the interactions.
    pub(super) by_moved: Vec<Vec<usize>>,
    /// Of each force, and of each closure, between two bodies: the place of its pair among the interactions, first what
    /// the body of lower number feels, then the other one.
    pub(super) of_forces: Vec<Option<usize>>,
    pub(super) of_closures: Vec<Option<usize>>,
    /// What explicit time adds to the wrenches on bodies, about their places, with the sign of a resistance.
    pub(super) time_wrench: Vec<[f64; W]>,
    /// Ends of each row of the closures, and the row on their motions.
    pub(super) ends: Vec<[Option<usize>; 2]>,
    pub(super) end_rows: Vec<[EndRow<W>; 2]>,
    pub(super) motions: Vec<OwnMotion<W>>,
    /// Accelerations of edges as their carriers see them, by bodies.
    pub(super) accelerations: Vec<[f64; W]>,
    /// Of each extra state and end, about the reference point: its force, and the row of its rate on displacement and twist.
    pub(super) extra: Vec<[[[f64; W]; 3]; 2]>,
    /// What closures exert on poses.
    pub(super) force: Vec<f64>,
    pub(super) varied: Varied<W>,
}

impl<const W: usize> Derivatives<W> {
    fn new(
        structure: &Structure,
        edges: &[Edge],
        closures: &Closures,
        sources: &[Source],
        ndof: usize,
    ) -> Self {
        let (sizes, n) = (structure.sizes, sources.len());
        let bodies = sizes.bodies;
        let (mut interactions, mut by_moved) = (Vec::new(), vec![Vec::new(); bodies]);
        let mut known = BTreeMap::new();
        let mut place = |ends: [Option<usize>; 2]| {
            let [Some(a), Some(b)] = ends else { return None };
            let [inner, outer] = [a.min(b), a.max(b)];
            let first = *known.entry([inner, outer]).or_insert_with(|| {
                for pair in [[inner, outer], [outer, inner]] {
                    by_moved[pair[1]].push(interactions.len());
                    interactions.push(Interaction {
                        bodies: pair,
                        acts: false,
                        by: [[[0.0; W]; W]; 2],
                    });
                }
                interactions.len() - 2
            });
            Some(first)
        };
        let of_forces = structure.forces.iter().map(|ends| place(*ends)).collect();
        let is_joint = |closure: &Closure| {
            matches!(closure.origin, Origin::Joint(_)) && !closure.rows.is_empty()
        };
        let of_closures = closures.all.iter();
        let of_closures =
            of_closures.map(|c| if is_joint(c) { place(c.ends) } else { None }).collect();
        let mut ends = vec![[None; 2]; closures.rows()];
        for closure in closures.all.iter().filter(|closure| !closure.rows.is_empty()) {
            ends[closure.first..][..closure.rows.len()].fill(closure.ends);
        }
        let mut felt_by = vec![Vec::new(); bodies];
        for Interaction { bodies: [feels, moved], .. } in &interactions {
            felt_by[*moved].push(*feels);
        }
        let plan = Plan { edges, closures, sources, felt_by: &felt_by };
        Self {
            movers: (0..ndof).map(|p| Mover::of(p, &plan)).collect(),
            time: Mover::of_time(&plan),
            own: vec![OwnWrench::NONE; bodies],
            interactions,
            by_moved,
            of_forces,
            of_closures,
            time_wrench: vec![[0.0; W]; bodies],
            end_rows: vec![[EndRow::NONE; 2]; ends.len()],
            ends,
            motions: vec![OwnMotion::NONE; n],
            accelerations: vec![[0.0; W]; bodies],
            extra: vec![[[[0.0; W]; 3]; 2]; sizes.extra_states],
            force: vec![0.0; sizes.coordinates],
            varied: Varied::new(n, bodies, closures.rows()),
        }
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    pub(super) fn make_room_for_derivatives(&mut self) {
        if self.derivatives.is_none() {
            self.derivatives = Some(Box::new(Derivatives::new(
                self.system.structure(),
                &self.edges,
                &self.closures,
                &self.sources,
                self.zero_rates.len(),
            )));
        }
    }

    /// All blocks at the state whose accelerations were the last to be evaluated.
    pub(super) fn linearize_motion(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        blocks: &mut DerivativeBlocks,
        out: &mut ReducedDerivatives<'_>,
    ) {
        self.make_room_for_derivatives();
        let Some(mut at) = self.derivatives.take() else { return };
        self.evaluate_parts(parametrization, state, blocks, &mut at);
        self.closures.evaluate_maps();
        out.clear();
        let (ndof, n) = (at.movers.len(), state.q.len());
        for p in 0..ndof {
            let mover = std::mem::take(&mut at.movers[p]);
            self.vary_positions(&mover, &mut at);
            self.vary_rates(&mover, None, &mut at);
            self.vary_accelerations(&mover, None, &mut at);
            self.vary_accelerations_by_rate(&mover, &mut at);
            self.vary_wrenches(&mover, &mut at);
            self.gather_changes(&mover, &mut at);
            let targets = [&mut *out.mass, &mut *out.damping, &mut *out.stiffness];
            for (along, target) in at.varied.along.iter().zip(targets) {
                self.project_by_maps(&mover, along, |row, x| target[row * ndof + p] += x);
            }
            let [displaced, moved, _] = &at.varied.bodies;
            let ends = self.system.structure().extra_bodies.iter().zip(&at.extra);
            for (k, (ends, rows)) in ends.enumerate() {
                for (end, [_, by_x, by_rate]) in ends.iter().zip(rows) {
                    let Some(b) = *end else { continue };
                    let along = dot(by_rate, &displaced[b]);
                    out.extra_velocity[k * ndof + p] += along;
                    out.extra_position[k * ndof + p] +=
                        dot(by_x, &displaced[b]) + dot(by_rate, &moved[b]);
                }
            }
            let (dq, dv) = out.columns[2 * n * p..2 * n * (p + 1)].split_at_mut(n);
            for &e in &mover.edges {
                let b = self.edges[e].body;
                let (q, o) = (pose(&state.q, b), &self.origin[b]);
                let along = A::rates(q, o, &displaced[b]);
                let own = A::rates(q, o, &moved[b]);
                let bent = A::rates_change(&along, &self.twist[b]);
                *pose_mut(dq, b) = along;
                *pose_mut::<N>(dv, b) = std::array::from_fn(|i| own[i] + bent[i]);
            }
            self.rest(&mover, &mut at);
            at.movers[p] = mover;
        }
        let all = std::mem::take(&mut at.time);
        for (k, ends) in self.system.structure().extra_bodies.iter().enumerate() {
            let felt = &mut at.varied.felt;
            felt.iter_mut().for_each(|felt| felt.fill([0.0; W]));
            for (end, [force, ..]) in ends.iter().zip(&at.extra[k]) {
                let Some(b) = *end else { continue };
                felt[0][b] = *force;
            }
            self.gather_changes(&all, &mut at);
            let target = &mut out.force_extra[k * ndof..(k + 1) * ndof];
            self.project_by_maps(&all, &at.varied.along[0], |row, x| target[row] += x);
        }
        self.rest(&all, &mut at);
        at.time = all;
        self.derivatives = Some(at);
    }

    /// M̂ v̈_t = −ψ_t and ż_t, at the state of the last [`Engine::linearize_motion`].
    pub(super) fn vary_time(
        &mut self,
        state: &State,
        blocks: &DerivativeBlocks,
        force: &mut [f64],
        z_rate: &mut [f64],
    ) {
        let Some(mut at) = self.derivatives.take() else { return };
        let mover = std::mem::take(&mut at.time);
        self.vary_positions_with_time(&mover, state.t, &mut at);
        self.vary_rates(&mover, Some(state.t), &mut at);
        self.vary_accelerations(&mover, Some(state.t), &mut at);
        self.vary_wrenches(&mover, &mut at);
        for (b, felt) in at.varied.felt[2].iter_mut().enumerate() {
            add(felt, 1.0, &A::moved(&at.time_wrench[b], &at.own[b].place, &self.origin[b]));
        }
        self.gather_changes(&mover, &mut at);
        force.fill(0.0);
        self.project_by_maps(&mover, &at.varied.along[2], |row, x| force[row] -= x);
        let [displaced, moved, _] = &at.varied.bodies;
        let ends = self.system.structure().extra_bodies.iter().zip(&at.extra);
        for ((out, time), (ends, rows)) in z_rate.iter_mut().zip(&blocks.extra_time).zip(ends) {
            *out = *time;
            for (end, [_, by_x, by_rate]) in ends.iter().zip(rows) {
                let Some(b) = *end else { continue };
                *out += dot(by_x, &displaced[b]) + dot(by_rate, &moved[b]);
            }
        }
        self.rest(&mover, &mut at);
        at.time = mover;
        self.derivatives = Some(at);
    }

    /// Derivatives of each body, pair, edge and closure.
    fn evaluate_parts(
        &mut self,
        parametrization: &Parametrization,
        state: &State,
        blocks: &mut DerivativeBlocks,
        at: &mut Derivatives<W>,
    ) {
        let State { q, a, lambda, .. } = state;
        at.force.fill(0.0);
        self.evaluate_end_rows(parametrization, state, &mut at.end_rows, &mut at.force);
        self.evaluate_interactions(state, at, blocks);
        self.stand(q);
        self.evaluate_wrenches(q, a);
        self.add_closure_forces(q, lambda);
        self.gather();
        self.evaluate_own_motions(&mut at.motions, &mut at.accelerations);
    }
}
