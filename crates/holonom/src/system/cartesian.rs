//! Cartesian coordinates, planar or spatial: assembly of Φ, M, Q and all blocks from the elements.

use super::cartesian_bodies::set;
use super::cartesian_derivatives::set_rows;
use super::compile::build;
use super::forest::{PlacedEdges, PlacedRelative, RelativeGroup, ResistanceLaw, Tree};
use super::passage::Passage;
use super::placed::{PlacedBody, PlacedConstraint, PlacedForce, Slots};
use super::quantities::Channels;
use super::space::Space;
use super::turns::Turns;
use super::{
    DerivativeBlocks, EnergyBalance, Equations, ExtraStateScale, LawArgument, MotionRows, State,
    Structure, System, WrenchBlocks,
};
use crate::elements::body::Body;
use crate::elements::{
    ConstraintElement, ForceBlocks, ForceElement, ForceInput, LawPlace, MOST_ARGUMENTS, PairBlocks,
    RowBlocks,
};
use crate::model::{Dimension, Model};
use crate::watch::checkpoint;
use holonom_linalg::BlockMatrix;
use std::sync::Arc;

/// The system.
pub(super) struct Cartesian<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> {
    pub(super) structure: Arc<Structure>,
    pub(super) slots: Arc<Slots>,
    pub(super) bodies: Vec<PlacedBody>,
    pub(super) constraints: Vec<PlacedConstraint<S::Constraint>>,
    pub(super) forces: Vec<PlacedForce<S::Force>>,
    pub(super) tree: Arc<Tree>,
    pub(super) groups: Vec<RelativeGroup>,
    /// Their functions.
    pub(super) relatives: Vec<PlacedRelative<S::Relative>>,
    /// Kinematics of the edges of the tree.
    pub(super) edges: PlacedEdges<S::Kinematics>,
    /// Laws of the force elements of the tree.
    pub(super) resistances: Vec<ResistanceLaw>,
    /// Scalars along which forces have local features.
    pub(super) arguments: Vec<LawArgument>,
    pub(super) gravity: [f64; 3],
    pub(super) length: f64,
    pub(super) channels: Channels,
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Cartesian<S, D, N, W> {
    const REST: [f64; N] = [0.0; N];

    /// Numbers that an evaluation of all elements takes, about; for checkpoints.
    fn numbers(&self) -> usize {
        16 * N * (self.bodies.len() + self.constraints.len() + self.forces.len())
    }

    pub(super) fn pose(q: &[f64], body: Option<usize>) -> &[f64; N] {
        match body {
            Some(b) => q[b * N..].first_chunk().expect("a body has N coordinates"),
            None => const { &S::GROUND },
        }
    }

    pub(super) fn rate(v: &[f64], body: Option<usize>) -> &[f64; N] {
        match body {
            Some(b) => v[b * N..].first_chunk().expect("a body has N coordinates"),
            None => const { &Self::REST },
        }
    }

    pub(super) fn pair(q: &[f64], bodies: [Option<usize>; 2]) -> [&[f64; N]; 2] {
        [Self::pose(q, bodies[0]), Self::pose(q, bodies[1])]
    }

    pub(super) fn rates(v: &[f64], bodies: [Option<usize>; 2]) -> [&[f64; N]; 2] {
        [Self::rate(v, bodies[0]), Self::rate(v, bodies[1])]
    }

    /// Body as forces see it.
    #[inline(always)]
    pub(super) fn moving(q: &[f64], v: &[f64], body: Option<usize>) -> Body<f64, D, N, W> {
        S::moving(Self::pose(q, body), Self::rate(v, body))
    }

    #[inline(always)]
    pub(super) fn input<'a>(
        force: &PlacedForce<S::Force>,
        state: &'a State,
    ) -> ForceInput<'a, f64, D, N, W> {
        // One by one: a map of what is so large is not compiled into place.
        let bodies = [
            Self::moving(&state.q, &state.v, force.bodies[0]),
            Self::moving(&state.q, &state.v, force.bodies[1]),
        ];
        let mut input = ForceInput { t: state.t, bodies, z: &[], winding: 0.0 };
        Self::tell_own(force, state, &mut input);
        input
    }

    /// What a force has for itself.
    #[inline(always)]
    pub(super) fn tell_own<'a>(
        force: &PlacedForce<S::Force>,
        state: &'a State,
        input: &mut ForceInput<'a, f64, D, N, W>,
    ) {
        input.z = &state.z[force.extra.states()];
        input.winding =
            force.turns.as_ref().map_or(0.0, |turns| turns.near(state.t, &state.winding));
    }

    /// Wrenches of gravity and forces, `stride` numbers per body of which the first W are used, and ż.
    fn add_up_wrenches(&self, state: &State, stride: usize, out: &mut [f64], z_rate: &mut [f64]) {
        checkpoint(self.numbers());
        out.fill(0.0);
        for (body, out) in self.bodies.iter().zip(out.chunks_exact_mut(stride)) {
            for (out, g) in out[..D].iter_mut().zip(&self.gravity) {
                *out = body.mass * g;
            }
        }
        let mut wrenches = [[0.0; W]; 2];
        let mut bodies = [None; 2];
        let ground = Self::moving(&state.q, &state.v, None);
        let mut input = ForceInput { t: state.t, bodies: [ground; 2], z: &[], winding: 0.0 };
        for f in &self.forces {
            // Neighbours in the model often share a body: along a chain the second of one is the first of the next.
            if bodies[0] != f.bodies[0] && bodies[1] == f.bodies[0] {
                bodies.swap(0, 1);
                input.bodies.swap(0, 1);
            }
            for side in 0..2 {
                if bodies[side] != f.bodies[side] {
                    bodies[side] = f.bodies[side];
                    input.bodies[side] = Self::moving(&state.q, &state.v, bodies[side]);
                }
            }
            Self::tell_own(f, state, &mut input);
            f.element.evaluate(&input, &mut wrenches, &mut z_rate[f.extra.states()]);
            for (body, w) in bodies.iter().zip(&wrenches) {
                let Some(b) = *body else { continue };
                out[b * stride..][..W].iter_mut().zip(w).for_each(|(out, x)| *out += x);
            }
        }
    }

    /// How changes of the poses of two bodies move these.
    #[inline(always)]
    pub(super) fn passages(state: &State, bodies: [Option<usize>; 2]) -> [S::Passage; 2] {
        let at = |b| S::Passage::at(Self::pose(&state.q, b), Self::rate(&state.v, b));
        [at(bodies[0]), at(bodies[1])]
    }

    /// Whether elements join the same bodies in the same places, so that patterns can be shared.
    pub(super) fn same_structure(
        &self,
        constraints: &[PlacedConstraint<S::Constraint>],
        forces: &[PlacedForce<S::Force>],
    ) -> bool {
        let index = |turns: &Option<Turns>| turns.as_ref().map(|t| t.index);
        let same_constraint = |a: &PlacedConstraint<S::Constraint>,
                               b: &PlacedConstraint<S::Constraint>| {
            (a.bodies, a.row, a.kind, &a.name) == (b.bodies, b.row, b.kind, &b.name)
                && index(&a.turns) == index(&b.turns)
        };
        let same_force = |a: &PlacedForce<S::Force>, b: &PlacedForce<S::Force>| {
            (a.bodies, a.extra, &a.name) == (b.bodies, b.extra, &b.name)
                && index(&a.turns) == index(&b.turns)
        };
        self.constraints.len() == constraints.len()
            && self.forces.len() == forces.len()
            && self.constraints.iter().zip(constraints).all(|(a, b)| same_constraint(a, b))
            && self.forces.iter().zip(forces).all(|(a, b)| same_force(a, b))
    }

    /// ‖Φ‖∞, ‖G q̇ − ν‖∞ and ‖G q̈ − τ‖∞ over all rows, redundant ones included.
    pub(super) fn largest_residuals(&self, state: &State) -> [f64; 3] {
        let mut largest = [0.0f64; 3];
        for c in &self.constraints {
            let q = Self::pair(&state.q, c.bodies);
            let [v, a] = [&state.v, &state.a].map(|rates| Self::rates(rates, c.bodies));
            let rows = c.element.rows();
            let mut u = c.element.value_and_rates(q, v, a);
            if let Some(drive) = c.element.drive(state.t) {
                Self::take_drive(c, &drive, &mut u[0]);
                u[1][0] -= drive[1];
                u[2][0] -= drive[2];
            }
            for (largest, u) in largest.iter_mut().zip(&u) {
                *largest = u[..rows].iter().fold(*largest, |m, x| m.max(x.abs()));
            }
        }
        if S::NORMALIZED {
            let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
            for b in 0..self.bodies.len() {
                let (q, v) = (Self::pose(&state.q, Some(b)), Self::rate(&state.v, Some(b)));
                let (e, rate) = (&q[D..], &v[D..]);
                let bend = dot(e, &Self::rate(&state.a, Some(b))[D..]) + dot(rate, rate);
                let u = [dot(e, e) - 1.0, 2.0 * dot(e, rate), 2.0 * bend];
                largest = std::array::from_fn(|level| largest[level].max(u[level].abs()));
            }
        }
        largest
    }

    /// Φ of one constraint.
    fn constraint_value(
        c: &PlacedConstraint<S::Constraint>,
        t: f64,
        q: [&[f64; N]; 2],
        u: &mut [f64; 6],
    ) {
        c.element.value(q, u);
        if let Some(drive) = c.element.drive(t) {
            Self::take_drive(c, &drive, u);
        }
    }

    /// Takes what a driver prescribes from its coordinate; angles up to whole turns.
    fn take_drive(c: &PlacedConstraint<S::Constraint>, drive: &[f64; 4], u: &mut [f64; 6]) {
        u[0] -= drive[0];
        if c.element.wraps() {
            u[0] -= (u[0] / std::f64::consts::TAU).round() * std::f64::consts::TAU;
        }
    }

    /// Multipliers of one constraint's rows.
    pub(super) fn multipliers(
        constraint: &PlacedConstraint<S::Constraint>,
        lambda: &[f64],
    ) -> [f64; 6] {
        let rows = constraint.element.rows();
        // One by one: what is copied as a whole is waited for when it is read at once.
        std::array::from_fn(|k| if k < rows { lambda[constraint.row + k] } else { 0.0 })
    }

    /// Force and torque on the second body by the first, at the joint's point, ground axes: −Gᵀλ.
    pub(super) fn reaction(
        constraint: &PlacedConstraint<S::Constraint>,
        state: &State,
    ) -> ([f64; 3], [f64; 3]) {
        // The second side carries the reaction even where it is the ground.
        let q = Self::pair(&state.q, constraint.bodies);
        let mut g = RowBlocks([[[0.0; N]; 6]; 2]);
        constraint.element.jacobian(q, &mut g);
        let lambda = Self::multipliers(constraint, &state.lambda);
        let mut generalized = [0.0; N];
        for (row, l) in g.0[1].iter().zip(lambda).take(constraint.element.rows()) {
            for (out, entry) in generalized.iter_mut().zip(row) {
                *out -= entry * l;
            }
        }
        let (force, about_center) = S::wrench(q[1], &generalized);
        let arm = S::rotate(q[1], &constraint.element.point_on_second());
        let moment = cross(arm, force);
        let torque = std::array::from_fn(|k| about_center[k] - moment[k]);
        (force, torque)
    }
}

pub(super) fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> std::fmt::Debug
    for Cartesian<S, D, N, W>
{
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Cartesian").field("sizes", &self.structure.sizes).finish_non_exhaustive()
    }
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> Equations
    for Cartesian<S, D, N, W>
{
    fn structure(&self) -> &Structure {
        &self.structure
    }

    fn characteristic_length(&self) -> f64 {
        self.length
    }

    fn position_constraints(&self, t: f64, q: &[f64], phi: &mut [f64]) {
        checkpoint(self.numbers());
        let mut u = [0.0; 6];
        for c in &self.constraints {
            Self::constraint_value(c, t, Self::pair(q, c.bodies), &mut u);
            let rows = c.element.rows();
            phi[c.row..c.row + rows].copy_from_slice(&u[..rows]);
        }
        if S::NORMALIZED {
            let start = self.structure.normalization_start;
            for (row, body) in phi[start..].iter_mut().zip(q.chunks_exact(N)) {
                *row = body[D..].iter().map(|e| e * e).sum::<f64>() - 1.0;
            }
        }
    }

    fn velocity_constraints(&self, t: f64, q: &[f64], v: &[f64], phi_rate: &mut [f64]) {
        checkpoint(self.numbers());
        let mut rate = [0.0; 6];
        for c in &self.constraints {
            c.element.rate(Self::pair(q, c.bodies), Self::rates(v, c.bodies), &mut rate);
            rate[0] -= c.element.drive(t).map_or(0.0, |s| s[1]);
            let rows = c.element.rows();
            phi_rate[c.row..c.row + rows].copy_from_slice(&rate[..rows]);
        }
        if S::NORMALIZED {
            let start = self.structure.normalization_start;
            let bodies = q.chunks_exact(N).zip(v.chunks_exact(N));
            for (row, (q, v)) in phi_rate[start..].iter_mut().zip(bodies) {
                *row = 2.0 * q[D..].iter().zip(&v[D..]).map(|(e, rate)| e * rate).sum::<f64>();
            }
        }
    }

    fn constraint_jacobian(&self, q: &[f64], g: &mut BlockMatrix) {
        checkpoint(self.numbers());
        let mut rows = RowBlocks([[[0.0; N]; 6]; 2]);
        for (c, slots) in self.constraints.iter().zip(&self.slots.jacobian) {
            c.element.jacobian(Self::pair(q, c.bodies), &mut rows);
            set_rows(&mut g.blocks_mut(), slots, c.element.rows(), &rows);
        }
        for (id, body) in self.slots.normalization.iter().zip(q.chunks_exact(N)) {
            for (out, e) in g.block_mut(*id).iter_mut().zip(&body[D..]) {
                *out = 2.0 * e;
            }
        }
    }

    fn velocity_rhs(&self, t: f64, nu: &mut [f64]) {
        nu.fill(0.0);
        for c in &self.constraints {
            if let Some(s) = c.element.drive(t) {
                nu[c.row] = s[1];
            }
        }
    }

    fn acceleration_rhs(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]) {
        checkpoint(self.numbers());
        let mut curvature = [0.0; 6];
        for c in &self.constraints {
            c.element.curvature(Self::pair(q, c.bodies), Self::rates(v, c.bodies), &mut curvature);
            let rows = c.element.rows();
            for (out, u) in tau[c.row..c.row + rows].iter_mut().zip(curvature) {
                *out = -u;
            }
            if let Some(s) = c.element.drive(t) {
                tau[c.row] += s[2];
            }
        }
        if S::NORMALIZED {
            let start = self.structure.normalization_start;
            for (row, body) in tau[start..].iter_mut().zip(v.chunks_exact(N)) {
                *row = -2.0 * body[D..].iter().map(|e| e * e).sum::<f64>();
            }
        }
    }

    fn mass_matrix(&self, q: &[f64], m: &mut BlockMatrix) {
        checkpoint(self.numbers());
        for (b, (body, ids)) in self.bodies.iter().zip(&self.slots.mass).enumerate() {
            let block = m.block_mut(ids[0]);
            for k in 0..D {
                block[k * D + k] = body.mass;
            }
            S::rotational_mass(&body.inertia, Self::pose(q, Some(b)), m.block_mut(ids[1]));
        }
    }

    fn forces(&self, state: &State, force: &mut [f64], z_rate: &mut [f64]) {
        self.add_up_wrenches(state, N, force, z_rate);
        for (b, (body, out)) in self.bodies.iter().zip(force.chunks_exact_mut(N)).enumerate() {
            let (q, v) = (Self::pose(&state.q, Some(b)), Self::rate(&state.v, Some(b)));
            let w: [f64; W] = *out.first_chunk().expect("N is not less than W");
            out.copy_from_slice(&S::Passage::at(q, v).force(&w));
            S::gyroscopic_force(&body.inertia, q, v, out);
        }
    }

    fn wrenches(&self, state: &State, wrenches: &mut [f64], z_rate: &mut [f64]) {
        self.add_up_wrenches(state, W, wrenches, z_rate);
    }

    fn wrench_blocks(
        &self,
        state: &State,
        extra: &mut DerivativeBlocks,
        look: &mut dyn FnMut(usize, &WrenchBlocks<'_>),
    ) {
        checkpoint(8 * self.numbers());
        let mut blocks = ForceBlocks::zero();
        for (k, f) in self.forces.iter().enumerate() {
            let input = Self::input(f, state);
            f.element.blocks(&input, &mut blocks);
            if f.extra.count > 0 {
                f.element.extra_rows(&input, &mut extra.extra_rows(f.extra));
            }
            let shown = WrenchBlocks {
                stiffness: blocks.k.entries(),
                damping: blocks.damped.then(|| blocks.c.entries()),
                time: blocks.t.as_flattened(),
            };
            look(k, &shown);
        }
    }

    fn derivative_blocks(&self, state: &State, out: &mut DerivativeBlocks) {
        checkpoint(8 * self.numbers());
        self.add_up(state, out);
    }

    fn rate_change(&self, q: &[f64], v: &[f64], dq: &[f64], out: &mut [f64]) {
        checkpoint(self.numbers());
        let mut rows = RowBlocks([[[0.0; N]; 6]; 2]);
        for c in &self.constraints {
            let (pair, rates) = (Self::pair(q, c.bodies), Self::rates(v, c.bodies));
            c.element.directional(pair, rates, &mut rows);
            let change = Self::rates(dq, c.bodies);
            for (k, out) in out[c.row..c.row + c.element.rows()].iter_mut().enumerate() {
                *out = (0..2)
                    .map(|side| {
                        let row = rows.0[side][k].iter().zip(change[side]);
                        row.map(|(a, x)| a * x).sum::<f64>()
                    })
                    .sum();
            }
        }
        if S::NORMALIZED {
            let start = self.structure.normalization_start;
            let bodies = v.chunks_exact(N).zip(dq.chunks_exact(N));
            for (out, (v, dq)) in out[start..].iter_mut().zip(bodies) {
                *out = 2.0 * v[D..].iter().zip(&dq[D..]).map(|(a, b)| a * b).sum::<f64>();
            }
        }
    }

    fn energy(&self, state: &State) -> EnergyBalance {
        let mut out = EnergyBalance::default();
        for (b, body) in self.bodies.iter().enumerate() {
            let (q, v) = (Self::pose(&state.q, Some(b)), Self::rate(&state.v, Some(b)));
            let speed: f64 = v[..D].iter().map(|x| x * x).sum();
            out.kinetic += 0.5 * body.mass * speed + S::kinetic_rotation(&body.inertia, q, v);
            for k in 0..D {
                out.potential -= body.mass * self.gravity[k] * q[k];
            }
        }
        for f in &self.forces {
            let e = f.element.energy(&Self::input(f, state));
            out.potential += e.potential;
            out.dissipated += e.dissipated;
            out.supplied += e.supplied;
        }
        for c in &self.constraints {
            if let Some(s) = c.element.drive(state.t) {
                // The driver acts with −Gᵀλ; its power is −λᵀG q̇ = −λ ν.
                out.supplied -= state.lambda[c.row] * s[1];
            }
        }
        out
    }

    fn has_drivers(&self) -> bool {
        self.constraints.iter().any(|c| c.element.drive(0.0).is_some())
    }

    fn has_moving_drivers(&self) -> bool {
        self.constraints.iter().any(|c| c.element.is_driven())
    }

    fn drivers_move(&self, t: f64) -> bool {
        self.constraints.iter().any(|c| c.element.drive(t).is_some_and(|s| s[1] != 0.0))
    }

    fn drive(&self, row: usize, t: f64) -> [f64; 4] {
        let at = self.constraints.partition_point(|c| c.row <= row) - 1;
        self.constraints[at].element.drive(t).unwrap_or_default()
    }

    fn joint_drive(&self, joint: usize, t: f64) -> Option<[f64; 4]> {
        self.constraints[joint].element.drive(t)
    }

    fn joint_value(&self, joint: usize, t: f64, q: &[f64], phi: &mut [f64; 6]) {
        let c = &self.constraints[joint];
        Self::constraint_value(c, t, Self::pair(q, c.bodies), phi);
    }

    fn joint_gradient(&self, joint: usize, q: &[f64], out: &mut [f64]) {
        let c = &self.constraints[joint];
        let mut rows = RowBlocks::zero();
        c.element.jacobian(Self::pair(q, c.bodies), &mut rows);
        set(&rows, out);
    }

    fn joint_curvature(&self, joint: usize, q: &[f64], v: &[f64], out: &mut [f64; 6]) {
        let c = &self.constraints[joint];
        c.element.curvature(Self::pair(q, c.bodies), Self::rates(v, c.bodies), out);
    }

    fn joint_on_motions(&self, joint: usize) -> Option<&dyn MotionRows> {
        self.constraints[joint].element.on_motions()
    }

    fn joint_blocks(&self, joint: usize, state: &State, a0: &mut [f64], a1: &mut [f64]) {
        let c = &self.constraints[joint];
        let q = Self::pair(&state.q, c.bodies);
        let (v, a) = (Self::rates(&state.v, c.bodies), Self::rates(&state.a, c.bodies));
        let mut rows = [RowBlocks::zero(); 2];
        c.element.rate_blocks(q, v, a, &mut rows);
        set(&rows[0], a0);
        set(&rows[1], a1);
    }

    fn joint_hessian(&self, joint: usize, state: &State, out: &mut [f64]) {
        let c = &self.constraints[joint];
        let (q, lambda) = (Self::pair(&state.q, c.bodies), Self::multipliers(c, &state.lambda));
        let mut pairs = PairBlocks::zero();
        c.element.hessian(q, &lambda, &mut pairs);
        out.copy_from_slice(pairs.entries());
    }

    fn gravity(&self) -> f64 {
        self.gravity.iter().map(|g| g * g).sum::<f64>().sqrt()
    }

    fn update_windings(&self, t: f64, q: &[f64], winding: &mut [f64]) {
        for f in &self.forces {
            if let Some(turns) = &f.turns {
                let near = turns.near(t, winding);
                let bodies = f.bodies.map(|body| S::moving(Self::pose(q, body), &Self::REST));
                winding[turns.index] = f.element.angle([&bodies[0], &bodies[1]], near);
            }
        }
        for c in &self.constraints {
            if let Some(turns) = &c.turns {
                let near = turns.near(t, winding);
                winding[turns.index] = c.element.angle(Self::pair(q, c.bodies), near);
            }
        }
    }

    fn turned_over(&self, from: &[f64], to: &[f64]) -> Option<usize> {
        self.forces.iter().position(|f| {
            let [from, to] = [from, to].map(|q| Self::pair(q, f.bodies));
            f.element.turned_over(from, to)
        })
    }

    fn winding_of_joint(&self, joint: usize) -> Option<usize> {
        self.constraints[joint].turns.as_ref().map(|turns| turns.index)
    }

    fn extra_state_scales(&self) -> Vec<ExtraStateScale> {
        self.forces.iter().flat_map(|f| f.element.extra_state_scales()).collect()
    }

    fn breakpoints(&self) -> Vec<f64> {
        let mut all: Vec<f64> = self.forces.iter().flat_map(|f| f.element.breakpoints()).collect();
        all.extend(self.constraints.iter().flat_map(|c| &c.breakpoints));
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    }

    fn longest_step(&self, state: &State) -> f64 {
        let steps = self.forces.iter().map(|f| f.element.longest_step(&Self::input(f, state)));
        steps.fold(f64::INFINITY, f64::min)
    }

    fn law_arguments(&self) -> &[LawArgument] {
        &self.arguments
    }

    fn law_place(&self, argument: &LawArgument, state: &State) -> LawPlace {
        let force = &self.forces[argument.force];
        let mut places = [LawPlace::default(); MOST_ARGUMENTS];
        force.element.arguments(&Self::input(force, state), &mut places[..=argument.index]);
        places[argument.index]
    }

    fn law_places(&self, state: &State, out: &mut Vec<LawPlace>) {
        out.clear();
        out.resize(self.arguments.len(), LawPlace::default());
        let mut rest = &mut out[..];
        for arguments in self.arguments.chunk_by(|a, b| a.force == b.force) {
            let force = &self.forces[arguments[0].force];
            let (own, others) = rest.split_at_mut(arguments.len());
            force.element.arguments(&Self::input(force, state), own);
            rest = others;
        }
    }

    fn law_profile(&self, argument: &LawArgument, value: f64) -> f64 {
        self.forces[argument.force].element.profile(argument.index, value)
    }
}

impl<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize> System
    for Cartesian<S, D, N, W>
{
    fn with_values(&self, model: &Model) -> Option<Arc<dyn System>> {
        if (model.dimension == Dimension::Planar) != (D == 2) {
            return None;
        }
        let system = build(model, Some(self), None);
        Arc::ptr_eq(&system.structure, &self.structure).then(|| Arc::new(system) as Arc<dyn System>)
    }
}
