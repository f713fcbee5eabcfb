use super::{quantity, supplied};
use crate::elements::{Energy, ForceBlocks, ForceElement, ForceInput, Quantity, Wrenches};
use crate::math::vector::dot;
use crate::math::{Real, TimeFunction};
use crate::model::ForceAxes;

const PLANAR: &[Quantity] = &[quantity("torque", "N m", "ground", 1)];
const SPATIAL: &[Quantity] = &[quantity("torque", "N m", "ground", 3)];

/// Planar torque n(t) on the second body, the opposite on the first.
#[derive(Debug, Clone, PartialEq)]
pub struct PlanarTorque {
    torque: TimeFunction,
}

impl PlanarTorque {
    pub(in crate::elements) fn new(torque: &[TimeFunction; 3]) -> Self {
        Self { torque: torque[2].clone() }
    }
}

impl ForceElement<2, 3, 3> for PlanarTorque {
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, 2, 3, 3>,
        wrenches: &mut Wrenches<T, 3>,
        _z_rate: &mut [T],
    ) {
        *wrenches = moments([self.torque.value_and_slope(input.t).0]);
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, 2, 3, 3>, out: &mut ForceBlocks<T, 3>) {
        *out = ForceBlocks::zero();
        let (torque, rate) = self.torque.value_and_slope(input.t);
        out.wrenches = moments([torque]);
        out.t = moments([-rate]);
    }

    fn energy(&self, input: &ForceInput<f64, 2, 3, 3>) -> Energy {
        supplied(self, input)
    }

    fn quantities(&self) -> &'static [Quantity] {
        PLANAR
    }

    fn quantity(&self, _index: usize, input: &ForceInput<f64, 2, 3, 3>, out: &mut [f64]) {
        out[0] = self.torque.derivatives(input.t)[0];
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.torque.breakpoints()
    }
}

/// Spatial torque n on the second body, the opposite on the first: n(t) in ground axes, or A_j n'(t) in body axes, which
/// turns along, δn = δφ_j × n.
///
/// Source: Haug (1989), 11.2.
#[derive(Debug, Clone, PartialEq)]
pub struct SpatialTorque {
    torque: [TimeFunction; 3],
    axes: ForceAxes,
}

impl SpatialTorque {
    pub(in crate::elements) fn new(torque: &[TimeFunction; 3], axes: ForceAxes) -> Self {
        Self { torque: torque.clone(), axes }
    }

    /// n and its rate in a body at rest, ground axes.
    #[inline(always)]
    fn torque_and_rate<T: Real>(&self, input: &ForceInput<T, 3, 7, 6>) -> [[T; 3]; 2] {
        let mut out = [[T::zero(); 3]; 2];
        for d in 0..3 {
            (out[0][d], out[1][d]) = self.torque[d].value_and_slope(input.t);
        }
        let axes = &input.bodies[1].axes;
        match self.axes {
            ForceAxes::Ground => out,
            ForceAxes::Body => out.map(|x| axes.map(|row| dot(&row, &x))),
        }
    }
}

impl ForceElement<3, 7, 6> for SpatialTorque {
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, 3, 7, 6>,
        wrenches: &mut Wrenches<T, 6>,
        _z_rate: &mut [T],
    ) {
        *wrenches = moments(self.torque_and_rate(input)[0]);
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, 3, 7, 6>, out: &mut ForceBlocks<T, 6>) {
        *out = ForceBlocks::zero();
        let [n, rate] = self.torque_and_rate(input);
        out.wrenches = moments(n);
        out.t = moments(rate.map(|x| -x));
        if self.axes == ForceAxes::Body {
            for (a, b, c) in [(0, 1, 2), (1, 2, 0), (2, 0, 1)] {
                for (felt, n) in [(0, n[c]), (1, -n[c])] {
                    let block = &mut out.k.0[felt][1];
                    block[3 + a][3 + b] = n;
                    block[3 + b][3 + a] = -n;
                }
            }
        }
    }

    fn energy(&self, input: &ForceInput<f64, 3, 7, 6>) -> Energy {
        supplied(self, input)
    }

    fn quantities(&self) -> &'static [Quantity] {
        SPATIAL
    }

    fn quantity(&self, _index: usize, input: &ForceInput<f64, 3, 7, 6>, out: &mut [f64]) {
        out[..3].copy_from_slice(&self.torque_and_rate(input)[0]);
    }

    fn breakpoints(&self) -> Vec<f64> {
        self.torque.iter().flat_map(TimeFunction::breakpoints).collect()
    }
}

/// Wrenches of a moment on the second body and the opposite on the first.
#[inline(always)]
fn moments<T: Real, const M: usize, const W: usize>(n: [T; M]) -> [[T; W]; 2] {
    let mut out = [[T::zero(); W]; 2];
    for (k, n) in n.into_iter().enumerate() {
        out[0][W - M + k] = -n;
        out[1][W - M + k] = n;
    }
    out
}
