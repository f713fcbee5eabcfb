use super::{law, quantity};
use crate::elements::angle::on_branch;
use crate::elements::body::{Body, angular};
use crate::elements::space::Triad;
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, LawPlace, PairBlocks, Quantity, Wrenches,
    product,
};
use crate::math::Real;
use crate::math::spatial::cross;
use crate::math::vector::{difference, dot, scaled};
use crate::model::ElasticLaw;
use std::fmt::Debug;

const QUANTITIES: &[Quantity] = &[
    quantity("angle", "rad", "", 1),
    quantity("rate", "rad/s", "", 1),
    quantity("torque", "N m", "along", 1),
];

/// Angle θ of the second frame from the first one, rad, as two bodies have it between them.
pub trait Between<const D: usize, const N: usize, const W: usize>:
    Debug + Clone + PartialEq
{
    /// Whether only the principal value in (−π, π] is known from how bodies stand.
    const COUNTS_TURNS: bool;

    /// θ; the principal value where turns must be counted.
    fn value<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2]) -> T;

    /// Rows of θ̇ on both twists, and of δθ on displacements.
    fn rows<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2]) -> [[T; W]; 2];

    /// Rows of δθ̇ on displacements.
    fn rate_rows<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2]) -> [[T; W]; 2];

    /// out += c times the changes of [`rows`](Self::rows) with displacements.
    fn add_bend<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2], c: T, out: &mut PairBlocks<T, W>);

    /// θ on the branch nearest to `winding`.
    fn nearest<T: Real>(&self, bodies: [&Body<T, D, N, W>; 2], winding: f64) -> T {
        let angle = self.value(bodies);
        if Self::COUNTS_TURNS { on_branch(angle, winding) } else { angle }
    }
}

/// θ = θ_j − θ_i + offset; exact over any number of turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct InPlane {
    offset: f64,
}

impl InPlane {
    pub(in crate::elements) fn new(frames: &[Triad<2>; 2]) -> Self {
        let [i, j] = frames.map(|frame| frame.axes[0][1].atan2(frame.axes[0][0]));
        Self { offset: j - i }
    }
}

impl Between<2, 3, 3> for InPlane {
    const COUNTS_TURNS: bool = false;

    fn value<T: Real>(&self, [i, j]: [&Body<T, 2, 3, 3>; 2]) -> T {
        j.pose[2] - i.pose[2] + self.offset
    }

    fn rows<T: Real>(&self, _: [&Body<T, 2, 3, 3>; 2]) -> [[T; 3]; 2] {
        let (o, one) = (T::zero(), T::one());
        [[o, o, -one], [o, o, one]]
    }

    fn rate_rows<T: Real>(&self, _: [&Body<T, 2, 3, 3>; 2]) -> [[T; 3]; 2] {
        [[T::zero(); 3]; 2]
    }

    fn add_bend<T: Real>(&self, _: [&Body<T, 2, 3, 3>; 2], _: T, _: &mut PairBlocks<T, 3>) {}
}

/// Twist of the second frame from the first about their axes h_i and h_j, that is the angle about the axis of the swing and
/// twist of one rotation; f, g are those of the first frame, d, e those of the second one, all turned along:
///
/// ```text
/// c = fᵀd + gᵀe,  s = gᵀd − fᵀe,  θ = atan2(s, c)
/// n = (h_i + h_j) / (1 + h_iᵀh_j),   δθ = nᵀδρ,  δρ = δφ_j − δφ_i
/// δn = δφ_i × n + B δρ,   B = −(h̃_j + n (h_j × h_i)ᵀ) / (1 + h_iᵀh_j)
/// ```
///
/// It depends on the axes alone, not on what is across them, and is the same seen from either body. Undefined where the axes
/// are opposite; on a revolute or cylindrical axis n = h.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AboutAxis {
    frames: [[[f64; 3]; 3]; 2],
}

impl AboutAxis {
    pub(in crate::elements) fn new(frames: &[Triad<3>; 2]) -> Self {
        Self { frames: [frames[0].axes, frames[1].axes] }
    }

    /// h_i and h_j.
    #[inline(always)]
    fn axes<T: Real>(&self, [i, j]: [&Body<T, 3, 7, 6>; 2]) -> [[T; 3]; 2] {
        [i.turn(&self.frames[0][2]), j.turn(&self.frames[1][2])]
    }

    /// n.
    #[inline(always)]
    fn normal<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> [T; 3] {
        let [first, second] = self.axes(bodies);
        let part = part(&first, &second);
        std::array::from_fn(|k| (first[k] + second[k]) * part)
    }

    /// B.
    #[inline(always)]
    fn bend<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> [[T; 3]; 3] {
        let [first, second] = self.axes(bodies);
        let part = part(&first, &second);
        let across = cross(&second, &first);
        let [x, y, z] = second;
        let o = T::zero();
        let tilde = [[o, -z, y], [z, o, -x], [-y, x, o]];
        std::array::from_fn(|k| {
            let n = (first[k] + second[k]) * part;
            std::array::from_fn(|l| -(tilde[k][l] + n * across[l]) * part)
        })
    }
}

/// 1 / (1 + h_iᵀh_j), which grows without bound as the axes become opposite.
#[inline(always)]
fn part<T: Real>(first: &[T; 3], second: &[T; 3]) -> T {
    (dot(first, second) + 1.0 + f64::MIN_POSITIVE).recip()
}

#[inline(always)]
fn moment<T: Real>(n: &[T; 3]) -> [T; 6] {
    let o = T::zero();
    [o, o, o, n[0], n[1], n[2]]
}

impl Between<3, 7, 6> for AboutAxis {
    const COUNTS_TURNS: bool = true;

    fn value<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> T {
        let [i, j] = bodies;
        let [f, g, _] = self.frames[0].map(|axis| i.turn(&axis));
        let [d, e, _] = self.frames[1].map(|axis| j.turn(&axis));
        (dot(&g, &d) - dot(&f, &e)).atan2(dot(&f, &d) + dot(&g, &e))
    }

    fn rows<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> [[T; 6]; 2] {
        let n = self.normal(bodies);
        [moment(&n.map(|x| -x)), moment(&n)]
    }

    /// ρ̇ᵀδn with ρ̇ = ω_j − ω_i.
    fn rate_rows<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> [[T; 6]; 2] {
        let [i, j] = bodies.map(|body| angular(&body.twist));
        let spin = difference(&j, &i);
        let bend = self.bend(bodies);
        let second: [T; 3] = std::array::from_fn(|l| {
            bend[0][l] * spin[0] + bend[1][l] * spin[1] + bend[2][l] * spin[2]
        });
        let first = difference(&cross(&self.normal(bodies), &spin), &second);
        [moment(&first), moment(&second)]
    }

    fn add_bend<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2], c: T, out: &mut PairBlocks<T, 6>) {
        let n = scaled(&self.normal(bodies), c);
        let [x, y, z] = n;
        let o = T::zero();
        // δφ × n.
        let turn = [[o, z, -y], [-z, o, x], [y, -x, o]];
        let bend = self.bend(bodies);
        for k in 0..3 {
            for l in 0..3 {
                let second = bend[k][l] * c;
                let first = turn[k][l] - second;
                for (felt, sign) in [(0, -1.0), (1, 1.0)] {
                    out.0[felt][0][3 + k][3 + l] += first * sign;
                    out.0[felt][1][3 + k][3 + l] += second * sign;
                }
            }
        }
    }
}

/// Rotational spring-damper, planar or about h. Its torque t resists growing θ:
/// it acts as −t on the second body.
///
/// ```text
/// t = law(θ − θ₀) + c θ̇,   w = −t θ_ξᵀ
/// −w_ξ = t (θ_ξᵀ)_ξ + θ_ξᵀ (law' θ_ξ + c θ̇_ξ),   −w_y = c θ_ξᵀ θ_ξ
/// ```
///
/// Source: Haug (1989), 4.3 and 11.2.
#[derive(Debug, Clone, PartialEq)]
pub struct Rsda<A> {
    angle: A,
    law: ElasticLaw,
    damping: f64,
    free_angle: f64,
}

impl<A> Rsda<A> {
    pub(in crate::elements) fn new(
        angle: A,
        law: ElasticLaw,
        damping: f64,
        free_angle: f64,
    ) -> Self {
        Self { angle, law, damping, free_angle }
    }

    /// t and law'.
    #[inline(always)]
    fn torque<T: Real>(&self, angle: T, rate: T) -> (T, T) {
        let (torque, slope) = law::value_and_slope(&self.law, angle - self.free_angle);
        (torque + rate * self.damping, slope)
    }
}

impl<A: Between<D, N, W>, const D: usize, const N: usize, const W: usize> ForceElement<D, N, W>
    for Rsda<A>
{
    fn counts_turns(&self) -> bool {
        A::COUNTS_TURNS
    }

    fn angle(&self, bodies: [&Body<f64, D, N, W>; 2], winding: f64) -> f64 {
        if A::COUNTS_TURNS { self.angle.nearest(bodies, winding) } else { 0.0 }
    }

    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, D, N, W>,
        wrenches: &mut Wrenches<T, W>,
        _z_rate: &mut [T],
    ) {
        let rows = self.angle.rows(input.pair());
        let angle = self.angle.nearest(input.pair(), input.winding);
        let (torque, _) = self.torque(angle, product(&rows, input.twists()));
        *wrenches = rows.map(|row| scaled(&row, -torque));
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>) {
        *out = ForceBlocks::zero();
        let rows = self.angle.rows(input.pair());
        let angle = self.angle.nearest(input.pair(), input.winding);
        let (torque, slope) = self.torque(angle, product(&rows, input.twists()));
        out.wrenches = rows.map(|row| scaled(&row, -torque));
        self.angle.add_bend(input.pair(), torque, &mut out.k);
        out.k.add_outer(slope, &rows, &rows);
        out.damped = self.damping != 0.0;
        if out.damped {
            let damping = T::from(self.damping);
            out.k.add_outer(damping, &rows, &self.angle.rate_rows(input.pair()));
            out.c.add_outer(damping, &rows, &rows);
        }
    }

    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy {
        let angle = self.angle.nearest(input.pair(), input.winding);
        let rate = product(&self.angle.rows(input.pair()), input.twists());
        Energy {
            potential: law::energy(&self.law, angle - self.free_angle),
            dissipated: self.damping * rate * rate,
            supplied: 0.0,
        }
    }

    fn knots(&self) -> Vec<Vec<f64>> {
        law::knots(&self.law)
    }

    fn arguments(&self, input: &ForceInput<f64, D, N, W>, out: &mut [LawPlace]) {
        let angle = self.angle.nearest(input.pair(), input.winding);
        let rate = product(&self.angle.rows(input.pair()), input.twists());
        let place = LawPlace { value: angle - self.free_angle, rate, ..LawPlace::default() };
        out.iter_mut().for_each(|out| *out = place);
    }

    fn profile(&self, _: usize, argument: f64) -> f64 {
        law::value_and_slope(&self.law, argument).0
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]) {
        let angle = self.angle.nearest(input.pair(), input.winding);
        let rate = product(&self.angle.rows(input.pair()), input.twists());
        out[0] = match index {
            0 => angle,
            1 => rate,
            _ => self.torque(angle, rate).0,
        };
    }
}
