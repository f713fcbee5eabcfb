//! How wrenches on bodies change with the motions of bodies, and rows of closures with those of their ends.

use super::algebra::Algebra;
use super::closures::Origin;
use super::derivatives::Derivatives;
use super::engine::{BodyInertia, Engine, add, pose, pose_mut};
use super::residuals::{MOST_ROWS, gradient_of};
use crate::reduction::parametrization::Parametrization;
use crate::system::{DerivativeBlocks, State};

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
    /// Where the block begins among the values of K and C.
    pub(super) offset: usize,
    /// Whether there is any.
    pub(super) acts: bool,
    pub(super) by: [Columns<W>; 2],
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

    /// Wrenches of inertia and of the forces in `blocks`; `force` is what else acts on the poses than inertia does, with
    /// the sign of a resistance.
    pub(super) fn evaluate_interactions(
        &self,
        state: &State,
        blocks: &DerivativeBlocks,
        force: &[f64],
        out: &mut Derivatives<W>,
    ) {
        let [k, c] = [blocks.stiffness.values(), blocks.damping.values()];
        let own = out.own.iter_mut().zip(&out.diagonal).enumerate();
        for (b, (own, &offset)) in own {
            self.evaluate_inertia(b, state, own);
            let q: &[f64; N] = pose(&state.q, b);
            let acting = pose(force, b);
            for (column, unit) in own.stiffness.iter_mut().zip(units::<W>()) {
                let dq = A::rates(q, &own.place, &unit);
                add(column, 1.0, &A::wrench_change(&dq, acting));
            }
            if let Some([by_x, by_rate]) = self.on_bodies([b, b], state, offset, [k, c]) {
                for (out, x) in [(&mut own.stiffness, by_x), (&mut own.damping, by_rate)] {
                    out.iter_mut().zip(&x).for_each(|(out, x)| add(out, 1.0, x));
                }
            }
        }
        for one in &mut out.interactions {
            let by = self.on_bodies(one.bodies, state, one.offset, [k, c]);
            one.acts = by.is_some();
            if let Some(by) = by {
                one.by = by;
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

    /// Blocks of K and C on displacements and twists, about the places of the bodies; none where they vanish.
    fn on_bodies(
        &self,
        [a, b]: [usize; 2],
        state: &State,
        offset: usize,
        [k, c]: [&[f64]; 2],
    ) -> Option<[Columns<W>; 2]> {
        let [k, c] = [k, c].map(|values| &values[offset..offset + N * N]);
        let [is_elastic, is_viscous] = [k, c].map(|block| block.iter().any(|x| *x != 0.0));
        if !is_elastic && !is_viscous {
            return None;
        }
        let (felt, moved): (&[f64; N], &[f64; N]) = (pose(&state.q, a), pose(&state.q, b));
        let mut rows = [[[0.0; W]; N]; 2];
        for i in 0..N {
            let mut by_q: [f64; N] = *pose(k, i);
            if is_viscous {
                let by_v: &[f64; N] = pose(c, i);
                // The change of T is a turn: no point matters.
                add(&mut by_q, -1.0, &A::rates_change(by_v, &self.twist[b]));
                rows[1][i] = A::wrench_about_center(moved, by_v);
            }
            rows[0][i] = A::wrench_about_center(moved, &by_q);
        }
        let on_felt = |rows: &[[f64; W]; N]| -> Columns<W> {
            std::array::from_fn(|j| A::wrench_about_center(felt, &rows.map(|row| row[j])))
        };
        let by_twist = if is_viscous { on_felt(&rows[1]) } else { [[0.0; W]; W] };
        Some([on_felt(&rows[0]), by_twist])
    }
}

fn units<const W: usize>() -> Columns<W> {
    std::array::from_fn(|j| std::array::from_fn(|i| if i == j { 1.0 } else { 0.0 }))
}
