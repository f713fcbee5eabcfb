//! The bodies of a Cartesian system: motions, inertia, and relative coordinates along its forest.

use super::cartesian::Cartesian;
use super::forest::{RelativeGroup, Tree};
use super::space::Space;
use super::{Bodies, BodyPose, MotionRows, Resistance, Stance, State};
use crate::elements::RowBlocks;
use crate::elements::kinematics::{Anchor, EdgeKinematics, EdgeScrews};
use crate::elements::relative::{Reference, RelativeElement};
use holonom_linalg::{Arithmetic, Wide, run_wide};

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Bodies
    for Cartesian<S, D, N, W>
{
    fn set_body(&self, body: usize, pose: &BodyPose, q: &mut [f64], v: &mut [f64]) {
        let range = body * N..(body + 1) * N;
        S::set_body(&self.bodies[body].center, pose, &mut q[range.clone()], &mut v[range]);
    }

    fn body(&self, body: usize, q: &[f64], v: &[f64]) -> BodyPose {
        S::body(&self.bodies[body].center, Self::pose(q, Some(body)), Self::rate(v, Some(body)))
    }

    fn mass(&self, body: usize) -> f64 {
        self.bodies[body].mass
    }

    fn inertia(&self, body: usize) -> [[f64; 3]; 3] {
        self.bodies[body].inertia
    }

    fn least_inertia(&self, body: usize) -> f64 {
        S::least_inertia(&self.bodies[body].inertia)
    }

    fn tree(&self) -> &Tree {
        &self.tree
    }

    fn relative_groups(&self) -> &[RelativeGroup] {
        &self.groups
    }

    fn relative_value(&self, group: usize, reference: &Reference, q: &[f64], out: &mut [f64]) {
        let mut u = [0.0; 6];
        self.relatives[group].element.value(self.relative_pair(group, q), reference, &mut u);
        out.copy_from_slice(&u[..out.len()]);
    }

    fn relative_gradient(&self, group: usize, reference: &Reference, q: &[f64], out: &mut [f64]) {
        let mut rows = RowBlocks::zero();
        self.relatives[group].element.jacobian(self.relative_pair(group, q), reference, &mut rows);
        set(&rows, out);
    }

    fn relative_curvature(
        &self,
        group: usize,
        reference: &Reference,
        q: &[f64],
        v: &[f64],
        out: &mut [f64],
    ) {
        let mut u = [0.0; 6];
        let (q, v) = (self.relative_pair(group, q), self.relative_rates(group, v));
        self.relatives[group].element.curvature(q, v, reference, &mut u);
        out.copy_from_slice(&u[..out.len()]);
    }

    fn relative_rate_gradient(
        &self,
        group: usize,
        reference: &Reference,
        q: &[f64],
        v: &[f64],
        out: &mut [f64],
    ) {
        let mut rows = RowBlocks::zero();
        let (q, v) = (self.relative_pair(group, q), self.relative_rates(group, v));
        self.relatives[group].element.directional(q, v, reference, &mut rows);
        set(&rows, out);
    }

    fn relative_on_motions(&self, group: usize) -> Option<&dyn MotionRows> {
        self.relatives[group].element.on_motions()
    }

    fn relative_blocks(
        &self,
        group: usize,
        reference: &Reference,
        state: &State,
        a0: &mut [f64],
        a1: &mut [f64],
    ) {
        let element = &self.relatives[group].element;
        let q = self.relative_pair(group, &state.q);
        let (v, a) = (self.relative_rates(group, &state.v), self.relative_rates(group, &state.a));
        let mut rows = [RowBlocks::zero(); 2];
        run_wide(OfRelative { element, at: [q, v, a], reference, rows: &mut rows });
        set(&rows[0], a0);
        set(&rows[1], a1);
    }

    fn moved_reference(&self, group: usize, q: &[f64], old: &Reference) -> Reference {
        self.relatives[group].element.reference(self.relative_pair(group, q), old)
    }

    fn anchor_orientation(&self, edge: usize, form: usize, q: &[f64]) -> [f64; 4] {
        let placed = &self.edges[edge];
        let child = Self::pose(q, Some(placed.body));
        placed.kinematics[form].orientation(Self::pair(q, placed.bodies), child)
    }

    fn place(
        &self,
        edge: usize,
        form: usize,
        x: &[f64],
        references: &[Reference],
        anchor: &Anchor,
        q: &mut [f64],
        stances: Option<&mut [Stance]>,
    ) {
        let placed = &self.edges[edge];
        let first = placed.bodies[0] == placed.parent;
        let parent = Self::pose(q, placed.parent);
        let own;
        let stands = match (&stances, placed.parent) {
            (_, None) => const { &Stance::GROUND },
            (Some(stances), Some(b)) => &stances[b],
            (None, Some(_)) => {
                own = S::Kinematics::stance(parent);
                &own
            }
        };
        let from = (parent, stands);
        let kinematics = &placed.kinematics[form];
        let first_group = || self.tree.edges[edge].forms[form].start;
        let direction = kinematics.direction().map(|own| &references[first_group() + own]);
        let reference = direction.unwrap_or(const { &[0.0; 6] });
        let (child, stance) = kinematics.place(x, reference, anchor, from, first);
        q[placed.body * N..(placed.body + 1) * N].copy_from_slice(&child);
        if let Some(stances) = stances {
            stances[placed.body] = stance;
        }
    }

    fn edge_screws(
        &self,
        edge: usize,
        form: usize,
        stances: &[Stance],
        out: &mut EdgeScrews,
    ) -> bool {
        let stance = |body: Option<usize>| body.map_or(const { &Stance::GROUND }, |b| &stances[b]);
        let placed = &self.edges[edge];
        let child = &stances[placed.body];
        placed.kinematics[form].screws(placed.bodies.map(stance), child, out)
    }

    fn edge_screws_at(&self, edge: usize, form: usize, q: &[f64], out: &mut EdgeScrews) -> bool {
        let placed = &self.edges[edge];
        let kinematics = &placed.kinematics[form];
        if kinematics.is_free() {
            (out.base, out.first, out.outward) = (None, None, true);
        } else {
            (out.base, out.first) = (placed.parent, placed.bodies[0]);
            out.outward = placed.bodies[0] == placed.parent;
        }
        let stance = |body| S::Kinematics::stance(Self::pose(q, body));
        let [first, second] = placed.bodies.map(stance);
        kinematics.screws([&first, &second], &stance(Some(placed.body)), out)
    }

    fn resistance(&self, elastic: usize, row: usize, value: f64, rate: f64) -> Resistance {
        self.resistances[elastic].at(row, value, rate)
    }
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Cartesian<S, D, N, W> {
    fn relative_pair<'a>(&self, group: usize, q: &'a [f64]) -> [&'a [f64; N]; 2] {
        Self::pair(q, self.relatives[group].bodies)
    }

    fn relative_rates<'a>(&self, group: usize, v: &'a [f64]) -> [&'a [f64; N]; 2] {
        Self::rates(v, self.relatives[group].bodies)
    }
}

/// The blocks of relative coordinates.
struct OfRelative<'a, E, const N: usize> {
    element: &'a E,
    /// q, q̇ and q̈ of both bodies.
    at: [[&'a [f64; N]; 2]; 3],
    reference: &'a Reference,
    rows: &'a mut [RowBlocks<f64, N>; 2],
}

impl<E: RelativeElement<N>, const N: usize> Wide for OfRelative<'_, E, N> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let [q, v, a] = self.at;
        self.element.rate_blocks(q, v, a, self.reference, self.rows);
    }
}

/// Entries of rows over the coordinates of two bodies, row by row.
pub(super) fn set<const N: usize>(rows: &RowBlocks<f64, N>, out: &mut [f64]) {
    for (k, out) in out.chunks_exact_mut(2 * N).enumerate() {
        for (side, out) in out.chunks_exact_mut(N).enumerate() {
            out.copy_from_slice(&rows.0[side][k]);
        }
    }
}
