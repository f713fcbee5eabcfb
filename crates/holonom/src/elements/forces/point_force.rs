use std::marker::PhantomData;

use super::{quantity, supplied};
use crate::elements::body::Rigid;
use crate::elements::space::{from_center, leading};
use crate::elements::{Energy, ForceBlocks, ForceElement, ForceInput, Quantity, Wrenches};
use crate::math::vector::dot;
use crate::math::{Real, TimeFunction};
use crate::model::{ForceAxes, Frame};

const PLANAR: &[Quantity] = &[quantity("force", "N", "ground", 2)];
const SPATIAL: &[Quantity] = &[quantity("force", "N", "ground", 3)];

/// A force at a point of the second body with the arm a = A s, planar or spatial.
///
/// ```text
/// F = F'(t) in ground axes or A F'(t) in body axes,   w = (F, a × F)
/// −w_φ δφ = −(0, (δφ × a) × F) − (δF, a × δF),   δF = δφ × F in body axes
/// ```
///
/// Source: Haug (1989), 11.2.
#[derive(Debug, Clone, PartialEq)]
pub struct PointForce<S, const D: usize, const N: usize, const W: usize> {
    point: [f64; D],
    force: [TimeFunction; 3],
    axes: ForceAxes,
    space: PhantomData<S>,
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> PointForce<S, D, N, W> {
    pub(in crate::elements) fn new(
        frame: &Frame,
        force: &[TimeFunction; 3],
        axes: ForceAxes,
        centers: &[[f64; 3]; 2],
    ) -> Self {
        let point = leading(&from_center(&frame.point, &centers[1]));
        Self { point, force: force.clone(), axes, space: PhantomData }
    }

    /// F and its rate in a body at rest, ground axes.
    #[inline(always)]
    fn force_and_rate<T: Real>(&self, input: &ForceInput<T, D, N, W>) -> [[T; D]; 2] {
        let mut out = [[T::zero(); D]; 2];
        for d in 0..D {
            (out[0][d], out[1][d]) = self.force[d].value_and_slope(input.t);
        }
        let axes = &input.bodies[1].axes;
        match self.axes {
            ForceAxes::Ground => out,
            ForceAxes::Body => out.map(|x| axes.map(|row| dot(&row, &x))),
        }
    }
}

impl<S: Rigid<D, N, W>, const D: usize, const N: usize, const W: usize> ForceElement<D, N, W>
    for PointForce<S, D, N, W>
{
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, D, N, W>,
        wrenches: &mut Wrenches<T, W>,
        _z_rate: &mut [T],
    ) {
        let [force, _] = self.force_and_rate(input);
        wrenches[0] = [T::zero(); W];
        wrenches[1] = S::wrench(&force, &input.bodies[1].turn(&self.point));
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>) {
        *out = ForceBlocks::zero();
        let [force, rate] = self.force_and_rate(input);
        let arm = input.bodies[1].turn(&self.point);
        out.wrenches[1] = S::wrench(&force, &arm);
        out.t[1] = S::wrench(&rate, &arm).map(|x| -x);
        let k = &mut out.k.0[1][1];
        S::add_swing(&arm, &force, -1.0, k);
        if self.axes == ForceAxes::Body {
            for column in D..W {
                let mut unit = [T::zero(); W];
                unit[column] = T::one();
                let change = S::wrench(&S::spin(&unit, &force), &arm);
                for (row, x) in k.iter_mut().zip(change) {
                    row[column] -= x;
                }
            }
        }
    }

    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy {
        supplied(self, input)
    }

    fn quantities(&self) -> &'static [Quantity] {
        if D == 2 { PLANAR } else { SPATIAL }
    }

    fn quantity(&self, _index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]) {
        out[..D].copy_from_slice(&self.force_and_rate(input)[0]);
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.force.iter().flat_map(TimeFunction::breakpoints).collect()
    }
}
