//! How wrenches on bodies change with the motions of bodies, and rows of closures with those of their ends.

use super::algebra::Algebra;
use super::closures::Origin;
use super::derivatives::Derivatives;
use super::engine::{BodyInertia, Engine, add, pose, pose_mut};
use super::residuals::{MOST_ROWS, gradient_of};
use crate::reduction::parametrization::Parametrization;
use crate::system::{DerivativeBlocks, State, WrenchBlocks};

/// A matrix by columns.
pub(super) type Columns<const W: usize> = [[f64; W]; W];

/// A x.
#[inline(always)]
pub(super) fn times<const W: usize>(a: &Columns<W>, x: &[f64; W]) -> [f64; W] {
    let mut out = [0.0; W];
    for (column, x) in a.iter().zip(x) {
        add(&mut out, *x, column);
    }
    out
}

/// The wrench on a body by its own motion, about its place.
#[derive(Debug, Clone, Copy)]
pub(super) struct OwnWrench<const W: usize> {
    pub(super) place: [f64; 3],
    /// By how it is displaced, and by its twist.
    pub(super) stiffness: Columns<W>,
    pub(super) damping: Columns<W>,
}

impl<const W: usize> OwnWrench<W> {
    pub(super) const NONE: Self =
        Self { place: [0.0; 3], stiffness: [[0.0; W]; W], damping: [[0.0; W]; W] };
}

/// The wrench on one body by the displacement and the twist of another one, about their places.
#[derive(Debug, Clone, Copy)]
pub(super) struct Interaction<const W: usize> {
    /// The body that feels it, and the one that moves.
    pub(super) bodies: [usize; 2],
    /// Whether there is any.
    pub(super) acts: bool,
    pub(super) by: [Columns<W>; 2],
}

impl<const W: usize> Derivatives<W> {
    /// What body `a` feels by the displacement and by the twist of `b`, about their places.
    fn between(&mut self, [a, b]: [usize; 2], pair: Option<usize>) -> [&mut Columns<W>; 2] {
        match pair {
            Some(first) if a != b => {
                let Interaction { acts, by: [by_x, by_twist], .. } =
                    &mut self.interactions[first + usize::from(a > b)];
                *acts = true;
                [by_x, by_twist]
            }
            _ => {
                let OwnWrench { stiffness, damping, .. } = &mut self.own[a];
                [stiffness, damping]
            }
        }
    }
}

/// A row on how one end of a closure is displaced, on its twist, and on the rate of that, about the reference point.
#[derive(Debug, Clone, Copy)]
pub(super) struct EndRow<const W: usize> {
    /// Of the rate.
    pub(super) rate: [[f64; W]; 2],
    /// Of the second derivative.
    pub(super) second: [[f64; W]; 3],
}

impl<const W: usize> EndRow<W> {
    pub(super) const NONE: Self = Self { rate: [[0.0; W]; 2], second: [[0.0; W]; 3] };
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// Rows on changes of a pose, its rates and its second rates, on those of twists: δq = T δξ, δq̇ = T δŶ + …
    pub(super) fn on_twists(
        &self,
        b: usize,
        [q, v]: [&[f64]; 2],
        [by_q, by_v, by_a]: [&[f64; N]; 3],
    ) -> [[f64; W]; 3] {
        let (q, v, o): (&[f64; N], &[f64; N], _) = (pose(q, b), pose(v, b), &self.origin[b]);
        let (y, yd) = (&self.twist[b], &self.twist_rate[b]);
        // The changes of T are skew: a transpose is the negative.
        let less = |x: &[f64; N], y: [f64; N]| std::array::from_fn(|i| x[i] - y[i]);
        let by_v: [f64; N] = less(by_v, A::rates_change(by_a, y));
        let by_q: [f64; N] =
            less(&less(by_q, A::rates_change(by_a, yd)), A::rates_change(&by_v, y));
        let mut on_twist = A::wrench(q, o, &by_v);
        add(&mut on_twist, 1.0, &A::row_on_bend(v, by_a));
        [A::wrench(q, o, &by_q), on_twist, A::wrench(q, o, by_a)]
    }

    /// Rows of all closures on the motions of their ends, and what their multipliers exert, as generalized forces, into
    /// `force`.
    pub(super) fn evaluate_end_rows(
        &self,
        parametrization: &Parametrization,
        state: &State,
        rows: &mut [[EndRow<W>; 2]],
        force: &mut [f64],
    ) {
        let (system, relatives) = (self.system.as_ref(), Self::relatives(parametrization));
        let [mut gradient, mut bend, mut bend_rate] = [[0.0; MOST_ROWS * 14]; 3];
        for closure in self.closures.all.iter().filter(|closure| !closure.rows.is_empty()) {
            let [gradient, bend, bend_rate] =
                [&mut gradient, &mut bend, &mut bend_rate].map(|x| &mut x[..closure.count * 2 * N]);
            gradient_of(system, Some(parametrization), closure.origin, &state.q, gradient);
            match closure.origin {
                Origin::Joint(joint) => system.joint_blocks(joint, state, bend, bend_rate),
                Origin::Deformations(group) => {
                    let reference = &relatives.references[group];
                    system.relative_blocks(group, reference, state, bend, bend_rate);
                }
            }
            for (out, &(row, global)) in rows[closure.first..].iter_mut().zip(&closure.rows) {
                for (side, end) in closure.ends.iter().enumerate() {
                    let Some(b) = *end else { continue };
                    let own = |x: &[f64]| -> [f64; N] { *pose(&x[row * 2 * N..], side) };
                    let (g, first, second) = (own(gradient), own(bend), own(bend_rate));
                    let at = [&*state.q, &*state.v];
                    let twice = first.map(|x| 2.0 * x);
                    out[side].second = self.on_twists(b, at, [&second, &twice, &g]);
                    let mut turned = first;
                    add(&mut turned, -1.0, &A::rates_change(&g, &self.twist[b]));
                    let on_shift = A::wrench(pose(&state.q, b), &self.origin[b], &turned);
                    out[side].rate = [on_shift, out[side].second[2]];
                    if let Origin::Joint(_) = closure.origin {
                        let (lambda, force) = (state.lambda[global], pose_mut(force, b));
                        add::<N>(force, lambda, &g);
                    }
                }
            }
        }
    }

    /// What the wrenches of inertia, forces and closures change by with the motions of bodies; of extra states what concerns
    /// themselves and time into `blocks`.
    pub(super) fn evaluate_interactions(
        &self,
        state: &State,
        at: &mut Derivatives<W>,
        blocks: &mut DerivativeBlocks,
    ) {
        at.time_wrench.fill([0.0; W]);
        for (b, own) in at.own.iter_mut().enumerate() {
            self.evaluate_inertia(b, state, own);
            for (column, unit) in own.stiffness.iter_mut().zip(units::<W>()) {
                add(column, -1.0, &A::shifted(&unit, &self.applied[b]));
            }
        }
        for one in &mut at.interactions {
            (one.acts, one.by) = (false, [[[0.0; W]; W]; 2]);
        }
        self.system.wrench_blocks(state, blocks, &mut |force, own| {
            self.add_force_blocks(force, own, at);
        });
        self.tell_extra_states(&blocks.extra_motion, at);
        self.add_closure_blocks(state, at);
    }

    /// Derivatives of a force.
    fn add_force_blocks(&self, force: usize, own: &WrenchBlocks<'_>, at: &mut Derivatives<W>) {
        let bodies = self.system.structure().forces[force];
        let (stiffness, _) = own.stiffness.as_chunks::<W>();
        let damping = own.damping.map(|damping| damping.as_chunks::<W>().0);
        for felt in 0..2 {
            let Some(a) = bodies[felt] else { continue };
            add(
                &mut at.time_wrench[a],
                1.0,
                own.time[felt * W..].first_chunk().expect("W numbers"),
            );
            for moved in 0..2 {
                let Some(b) = bodies[moved] else { continue };
                let rows = (2 * felt + moved) * W..(2 * felt + moved + 1) * W;
                let [by_x, by_twist] = at.between([a, b], at.of_forces[force]);
                for (i, row) in stiffness[rows.clone()].iter().enumerate() {
                    by_x.iter_mut().zip(row).for_each(|(column, x)| column[i] += x);
                }
                let Some(damping) = damping else { continue };
                for (i, row) in damping[rows].iter().enumerate() {
                    by_twist.iter_mut().zip(row).for_each(|(column, x)| column[i] += x);
                    // The velocity of a place changes as it is displaced, the twist being that of a point at rest.
                    let carried = A::carried(&self.twist[b], row);
                    by_x.iter_mut().zip(&carried).for_each(|(column, x)| column[i] -= x);
                }
            }
        }
    }

    /// Rows of extra states about the reference points of their bodies.
    fn tell_extra_states(&self, motion: &[Vec<f64>; 3], at: &mut Derivatives<W>) {
        let ends = self.system.structure().extra_bodies.as_flattened().iter();
        for (k, (end, out)) in ends.zip(at.extra.as_flattened_mut()).enumerate() {
            let Some(b) = *end else { continue };
            let own = |x: &Vec<f64>| -> [f64; W] { *x[k * W..].first_chunk().expect("W numbers") };
            let [force, mut by_x, by_twist] = motion.each_ref().map(own);
            add(&mut by_x, -1.0, &A::carried(&self.twist[b], &by_twist));
            *out = [force, by_x, by_twist].map(|w| A::moved(&w, &at.own[b].place, &self.origin[b]));
        }
    }

    /// What the multipliers of the joints that close loops exert, as rows turn with the bodies.
    fn add_closure_blocks(&self, state: &State, at: &mut Derivatives<W>) {
        for &b in &self.ends {
            let (q, acting): (&[f64; N], _) = (pose(&state.q, b), pose(&at.force, b));
            let OwnWrench { place, stiffness, .. } = &mut at.own[b];
            for (column, unit) in stiffness.iter_mut().zip(units::<W>()) {
                add(column, 1.0, &A::wrench_change(&A::rates(q, place, &unit), acting));
            }
        }
        let mut hessian = [0.0; 4 * 49];
        let hessian = &mut hessian[..4 * N * N];
        for (c, closure) in self.closures.all.iter().enumerate() {
            let (Origin::Joint(joint), false) = (closure.origin, closure.rows.is_empty()) else {
                continue;
            };
            self.system.joint_hessian(joint, state, hessian);
            for (felt, a) in closure.ends.iter().enumerate() {
                for (moved, b) in closure.ends.iter().enumerate() {
                    let (Some(a), Some(b)) = (*a, *b) else { continue };
                    let block = &hessian[(2 * felt + moved) * N * N..][..N * N];
                    if block.iter().all(|x| *x == 0.0) {
                        continue;
                    }
                    let (q, other): (&[f64; N], &[f64; N]) = (pose(&state.q, a), pose(&state.q, b));
                    let rows: [[f64; W]; N] =
                        std::array::from_fn(|i| A::wrench_about_center(other, pose(block, i)));
                    let [by_x, _] = at.between([a, b], at.of_closures[c]);
                    for (j, column) in by_x.iter_mut().enumerate() {
                        let own = A::wrench_about_center(q, &rows.map(|row| row[j]));
                        add(column, 1.0, &own);
                    }
                }
            }
        }
    }

    /// (19): the equations of Newton and Euler, varied as the body sees them.
    fn evaluate_inertia(&self, b: usize, state: &State, out: &mut OwnWrench<W>) {
        let BodyInertia { mass, turned, .. } = &self.inertias[b];
        let q: &[f64; N] = pose(&state.q, b);
        out.place = A::center(q);
        let about = |y: &[f64; W]| A::moved_twist(y, &self.origin[b], &out.place);
        let (y, yd) = (about(&self.twist[b]), about(&self.twist_rate[b]));
        let inertia = |y: &[f64; W]| A::inertia_about_center(*mass, turned, y);
        let momentum = inertia(&y);
        let mut wrench = inertia(&yd);
        add(&mut wrench, 1.0, &A::cross_dual(&y, &momentum));
        for (out, unit) in out.damping.iter_mut().zip(&units::<W>()) {
            *out = A::cross_dual(unit, &momentum);
            add(out, 1.0, &A::cross_dual(&y, &inertia(unit)));
        }
        for (column, unit) in out.stiffness.iter_mut().zip(&units::<W>()) {
            *column = A::cross_dual(unit, &wrench);
            add(column, -1.0, &inertia(&A::cross(unit, &yd)));
            add(column, -1.0, &times(&out.damping, &A::cross(unit, &y)));
        }
    }
}

fn units<const W: usize>() -> Columns<W> {
    std::array::from_fn(|j| std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 }))
}
