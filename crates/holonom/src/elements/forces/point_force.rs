use std::marker::PhantomData;

use super::quantity;
use crate::elements::space::{Space, from_center, leading};
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, ForceOutput, Quantity, product,
};
use crate::math::vector::lift;
use crate::math::{Real, TimeFunction};
use crate::model::{ForceAxes, Frame};

const PLANAR: &[Quantity] = &[quantity("force", "N", "ground", 2)];
const SPATIAL: &[Quantity] = &[quantity("force", "N", "ground", 3)];

/// A force at a point x = r + A s of the second body, planar or spatial.
///
/// ```text
/// F = F'(t) in ground axes or A F'(t) in body axes,   Q_r = F,   Q_rot = BᵀF,   B = (A s)_rot
/// −Q_q = −(BᵀF)_rot − D_xᵀ F_q
/// ```
///
/// Source: Haug (1989), 11.2.
#[derive(Debug, Clone, PartialEq)]
pub struct PointForce<S, const D: usize, const N: usize, const R: usize> {
    point: [f64; D],
    force: [TimeFunction; 3],
    axes: ForceAxes,
    space: PhantomData<S>,
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> PointForce<S, D, N, R> {
    pub(in crate::elements) fn new(
        frame: &Frame,
        force: &[TimeFunction; 3],
        axes: ForceAxes,
        centers: &[[f64; 3]; 2],
    ) -> Self {
        let point = leading(&from_center(&frame.point, &centers[1]));
        Self { point, force: force.clone(), axes, space: PhantomData }
    }

    /// Components of F and of its time derivative in their own axes.
    #[inline(always)]
    fn components<T: Real>(&self, t: T) -> ([T; D], [T; D]) {
        let mut out = ([T::zero(); D], [T::zero(); D]);
        for d in 0..D {
            (out.0[d], out.1[d]) = self.force[d].value_and_slope(t);
        }
        out
    }

    /// Components in ground axes.
    #[inline(always)]
    fn in_ground<T: Real>(&self, q: &[T; N], components: &[T; D]) -> [T; D] {
        match self.axes {
            ForceAxes::Ground => *components,
            ForceAxes::Body => S::rotate(q, components),
        }
    }

    /// D_xᵀ F with B = (A s)_rot.
    #[inline(always)]
    fn generalized<T: Real>(slope: &[[T; R]; D], force: &[T; D]) -> [T; N] {
        let mut row = [T::zero(); N];
        row[..D].copy_from_slice(force);
        for d in 0..D {
            for k in 0..R {
                row[D + k] += slope[d][k] * force[d];
            }
        }
        row
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> ForceElement<N>
    for PointForce<S, D, N, R>
{
    fn evaluate<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceOutput<T, N>) {
        let q = input.q[1];
        let force = self.in_ground(q, &self.components(input.t).0);
        *out = ForceOutput::zero();
        out.q[1] = Self::generalized(&S::slope(q, &lift(&self.point)), &force);
    }

    fn blocks<T: Real>(&self, input: &ForceInput<'_, T, N>, out: &mut ForceBlocks<T, N>) {
        *out = ForceBlocks::zero();
        let q = input.q[1];
        let (components, rates) = self.components(input.t);
        let (force, rate) = (self.in_ground(q, &components), self.in_ground(q, &rates));
        let arm = lift(&self.point);
        let slope = S::slope(q, &arm);
        out.t[1] = Self::generalized(&slope, &rate).map(|x| -x);
        let bend = S::bend(q, &arm, &force);
        let k = &mut out.k.0[1][1];
        for i in 0..R {
            for j in 0..R {
                k[D + i][D + j] -= bend[i][j];
            }
        }
        if self.axes == ForceAxes::Body {
            let turn = S::slope(q, &components); // F_rot
            for j in 0..R {
                let column: [T; N] = Self::generalized(&slope, &turn.map(|row| row[j]));
                for i in 0..N {
                    k[i][D + j] -= column[i];
                }
            }
        }
    }

    fn energy(&self, input: &ForceInput<'_, f64, N>) -> Energy {
        let mut out = ForceOutput::zero();
        self.evaluate(input, &mut out);
        Energy { supplied: product(&out.q, input.v), ..Energy::default() }
    }

    fn quantities(&self) -> &'static [Quantity] {
        if D == 2 { PLANAR } else { SPATIAL }
    }

    fn quantity(&self, _index: usize, input: &ForceInput<'_, f64, N>, out: &mut [f64]) {
        let force = self.in_ground(input.q[1], &self.components(input.t).0);
        out[..D].copy_from_slice(&force);
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.force.iter().flat_map(TimeFunction::breakpoints).collect()
    }
}
