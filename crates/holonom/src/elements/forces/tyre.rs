use super::{quantity, road};
use crate::elements::body::{Body, Rigid, angular};
use crate::elements::space::{Spatial, from_center};
use crate::elements::{
    Energy, ForceBlocks, ForceElement, ForceInput, LawPlace, Quantity, Wrenches,
};
use crate::math::Real;
use crate::math::spatial::cross;
use crate::math::vector::{dot, sum};
use crate::model;

const QUANTITIES: &[Quantity] = &[
    quantity("deflection", "m", "", 1),
    quantity("vertical_force", "N", "ground", 1),
    quantity("lateral_force", "N", "along", 1),
];

/// Smooth tyre on a road, between the ground and the second body; laws in [`model::Tyre`].
///
/// With x the wheel centre, a its arm from the centre of mass, h the road height, t and l the horizontal unit vectors along
/// and across the wheel and ψ its heading (dl = t dψ, dt = −l dψ):
///
/// ```text
/// δ = R − (z − h),  dδ = h_x dx − dz,  dδ̇ = h_xx ẋ dx + h_x dẋ − dż
/// F = (0, 0, F_z) + F_y l,  n = arm F_y t with arm = R − s: moment of F_y l about the wheel centre
/// w = (F, a × F + n),   dx = dr + dφ × a,   dẋ = dv + dω × a + ω × (dφ × a)
/// −dw = −(dF, a × dF + dn + (dφ × a) × F)
/// ```
///
/// The power of the lateral force counts as dissipated; the share of its moment may be of either
/// sign.
#[derive(Debug, Clone, PartialEq)]
pub struct Tyre {
    center: [f64; 3],
    law: model::Tyre,
    has_obstacle: bool,
}

/// On displacement or twist of the wheel's body.
type Row<T> = [T; 6];

/// Wheel centre, deflection and vertical force.
struct Contact<T> {
    arm: [T; 3],
    x: T,
    speed: [T; 3],
    road_slope: T,
    road_curvature: T,
    deflection: T,
    rate: T,
    /// s, σ = ds/dδ, dσ/dδ.
    onset: [T; 3],
    vertical: T,
}

/// Scalars along which the law has local features.
#[derive(Debug, Clone, Copy)]
enum Scalar {
    Deflection,
    /// Of the wheel centre along the road.
    Way,
    /// Velocities of the slip.
    Across,
    Along,
}

/// Heading of the wheel and lateral force.
struct Lateral<T> {
    t: [T; 3],
    l: [T; 3],
    heading_gradient: Row<T>,
    along: T,
    across: T,
    regular: T,
    slip: T,
    force: T,
}

impl Tyre {
    pub(in crate::elements) fn new(tyre: &model::Tyre, centers: &[[f64; 3]; 2]) -> Self {
        let has_obstacle = road::knots(&tyre.road, tyre.radius).is_some();
        let center = from_center(&tyre.frame.point, &centers[1]);
        Self { center, law: tyre.clone(), has_obstacle }
    }

    #[inline(always)]
    fn contact<T: Real>(&self, body: &Body<T, 3, 7, 6>) -> Contact<T> {
        let law = &self.law;
        let arm = body.turn(&self.center);
        let spin = Spatial::spin(&body.twist, &arm);
        let speed: [T; 3] = std::array::from_fn(|k| body.twist[k] + spin[k]);
        let [x, _, z] = sum(&body.place(), &arm);
        let [height, road_slope, road_curvature] = road::height(&law.road, law.radius, x);
        let deflection = -(z - height) + law.radius;
        let rate = road_slope * speed[0] - speed[2];
        let square = deflection * deflection + law.smoothing * law.smoothing;
        let root = square.sqrt();
        let half_square = 0.5 * law.smoothing * law.smoothing;
        // (δ + root) / 2, without cancellation where the wheel is off the road
        let s = if deflection.value() < 0.0 {
            (root - deflection).recip() * half_square
        } else {
            (deflection + root) * 0.5
        };
        let onset = [s, s / root, (square * root).recip() * half_square];
        let vertical = onset[0] * law.stiffness + onset[1] * rate * law.damping;
        Contact { arm, x, speed, road_slope, road_curvature, deflection, rate, onset, vertical }
    }

    #[inline(always)]
    fn lateral<T: Real>(
        law: &model::LateralTyre,
        body: &Body<T, 3, 7, 6>,
        contact: &Contact<T>,
    ) -> Lateral<T> {
        let e = body.turn(&law.axis);
        // the smallest number keeps a wheel that lies flat free of 0/0
        let horizontal = (e[0] * e[0] + e[1] * e[1] + f64::MIN_POSITIVE).sqrt();
        let o = T::zero();
        let l = [e[0] / horizontal, e[1] / horizontal, o];
        let t = [l[1], -l[0], o];
        let [a, b, c] = cross(&e, &t).map(|x| x / horizontal);
        let heading_gradient = [o, o, o, a, b, c];
        let (along, across) = (dot(&contact.speed, &t), dot(&contact.speed, &l));
        let v0 = law.regularization_speed;
        let regular = (along * along + v0 * v0).sqrt();
        let slip = across.atan2(regular);
        let force = slip * contact.onset[1] * -law.cornering_stiffness;
        Lateral { t, l, heading_gradient, along, across, regular, slip, force }
    }

    /// What a place among the arguments of the law is.
    fn scalar(&self, index: usize) -> Scalar {
        let way = usize::from(self.has_obstacle);
        match index {
            0 => Scalar::Deflection,
            1 if way == 1 => Scalar::Way,
            _ if index == 1 + way => Scalar::Across,
            _ => Scalar::Along,
        }
    }

    /// Moment arm of the lateral force below the wheel centre.
    #[inline(always)]
    fn arm<T: Real>(&self, contact: &Contact<T>) -> T {
        -contact.onset[0] + self.law.radius
    }

    /// F and n.
    #[inline(always)]
    fn force_and_moment<T: Real>(
        &self,
        contact: &Contact<T>,
        lateral: Option<&Lateral<T>>,
    ) -> ([T; 3], [T; 3]) {
        let mut out = ([T::zero(); 3], [T::zero(); 3]);
        if let Some(lateral) = lateral {
            let moment = self.arm(contact) * lateral.force;
            out = (lateral.l.map(|x| x * lateral.force), lateral.t.map(|x| x * moment));
        }
        out.0[2] += contact.vertical;
        out
    }

    fn with_lateral<T: Real>(
        &self,
        body: &Body<T, 3, 7, 6>,
        contact: &Contact<T>,
    ) -> Option<Lateral<T>> {
        self.law.lateral.as_ref().map(|law| Self::lateral(law, body, contact))
    }
}

impl<T: Real> Contact<T> {
    /// (F, a × F + n).
    #[inline(always)]
    fn wrench(&self, force: &[T; 3], moment: &[T; 3]) -> Row<T> {
        let mut out = Spatial::wrench(force, &self.arm);
        for k in 0..3 {
            out[3 + k] += moment[k];
        }
        out
    }

    /// block −= rows of (F, a × F + n) for rows of F and n.
    #[inline(always)]
    fn subtract(&self, force: &[Row<T>; 3], moment: &[Row<T>; 2], block: &mut [Row<T>; 6]) {
        let mut rows = Spatial::wrenches(force, &self.arm);
        for (row, moment) in rows[3..].iter_mut().zip(moment) {
            *row = sum(row, moment);
        }
        for (out, row) in block.iter_mut().zip(&rows) {
            for (out, x) in out.iter_mut().zip(row) {
                *out -= *x;
            }
        }
    }
}

/// a x + b y.
#[inline(always)]
fn combine<T: Real>(a: T, x: &Row<T>, b: T, y: &Row<T>) -> Row<T> {
    std::array::from_fn(|k| a * x[k] + b * y[k])
}

impl ForceElement<3, 7, 6> for Tyre {
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, 3, 7, 6>,
        wrenches: &mut Wrenches<T, 6>,
        _z_rate: &mut [T],
    ) {
        let body = &input.bodies[1];
        let contact = self.contact(body);
        let lateral = self.with_lateral(body, &contact);
        let (force, moment) = self.force_and_moment(&contact, lateral.as_ref());
        *wrenches = [[T::zero(); 6], contact.wrench(&force, &moment)];
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, 3, 7, 6>, out: &mut ForceBlocks<T, 6>) {
        *out = ForceBlocks::zero();
        let (law, body) = (&self.law, &input.bodies[1]);
        let contact = self.contact(body);
        let lateral = self.with_lateral(body, &contact);
        let (force, moment) = self.force_and_moment(&contact, lateral.as_ref());
        out.wrenches[1] = contact.wrench(&force, &moment);
        out.damped = true;
        let o = T::zero();
        let one = T::one();
        // Rows of dx, and of dẋ on displacements.
        let units = [[one, o, o], [o, one, o], [o, o, one]];
        let d = units.map(|unit| Spatial::wrench(&unit, &contact.arm));
        let spin = angular(&body.twist);
        let speed_gradient = units.map(|unit| {
            let [a, b, c] = cross(&contact.arm, &cross(&unit, &spin));
            [o, o, o, a, b, c]
        });
        let deflection_gradient = combine(contact.road_slope, &d[0], -one, &d[2]);
        let mut rate_gradient =
            combine(contact.road_slope, &speed_gradient[0], -one, &speed_gradient[2]);
        let climb = contact.road_curvature * contact.speed[0];
        for k in 0..6 {
            rate_gradient[k] += climb * d[0][k];
        }
        // vertical force
        let [_, sigma, sigma_slope] = contact.onset;
        let by_rate = sigma * law.damping;
        let by_deflection = sigma * law.stiffness + sigma_slope * contact.rate * law.damping;
        let mut force_q = [[o; 6]; 3];
        let mut force_v = [[o; 6]; 3];
        force_q[2] = combine(by_deflection, &deflection_gradient, by_rate, &rate_gradient);
        force_v[2] = deflection_gradient.map(|x| x * by_rate);
        let (k, c) = (&mut out.k.0[1][1], &mut out.c.0[1][1]);
        if let (Some(side), Some(lateral_law)) = (&lateral, &law.lateral) {
            let Lateral { t, l, heading_gradient, along, across, regular, slip, .. } = side;
            let project = |u: &[T; 3], rows: &[Row<T>; 3]| -> Row<T> {
                std::array::from_fn(|k| u[0] * rows[0][k] + u[1] * rows[1][k])
            };
            // slip angle: α = atan2(across, regular)
            let square = (*regular * *regular + *across * *across).recip();
            let (by_across, by_along) = (*regular * square, -*across * square * *along / *regular);
            let across_q = combine(one, &project(l, &speed_gradient), *along, heading_gradient);
            let along_q = combine(one, &project(t, &speed_gradient), -*across, heading_gradient);
            let slip_q = combine(by_across, &across_q, by_along, &along_q);
            let slip_v = combine(by_across, &project(l, &d), by_along, &project(t, &d));
            let stiffness = T::from(-lateral_law.cornering_stiffness);
            let side_q = combine(
                stiffness * sigma,
                &slip_q,
                stiffness * *slip * sigma_slope,
                &deflection_gradient,
            );
            let side_v = slip_v.map(|x| x * stiffness * sigma);
            let arm = self.arm(&contact);
            let mut moment_q = [[o; 6]; 2];
            let mut moment_v = [[o; 6]; 2];
            let lever = combine(arm, &side_q, -side.force * sigma, &deflection_gradient);
            for x in 0..2 {
                force_q[x] = combine(l[x], &side_q, side.force * t[x], heading_gradient);
                force_v[x] = side_v.map(|y| y * l[x]);
                moment_q[x] = combine(t[x], &lever, -arm * side.force * l[x], heading_gradient);
                moment_v[x] = side_v.map(|y| y * t[x] * arm);
            }
            contact.subtract(&force_q, &moment_q, k);
            contact.subtract(&force_v, &moment_v, c);
        } else {
            // Only the third row of F varies.
            for i in 0..6 {
                for j in 0..6 {
                    k[i][j] -= d[2][i] * force_q[2][j];
                    c[i][j] -= d[2][i] * force_v[2][j];
                }
            }
        }
        Spatial::add_swing(&contact.arm, &force, -1.0, k);
    }

    fn energy(&self, input: &ForceInput<f64, 3, 7, 6>) -> Energy {
        let law = &self.law;
        let contact = self.contact(&input.bodies[1]);
        let (delta, epsilon) = (contact.deflection, law.smoothing);
        let [s, sigma, _] = contact.onset;
        // ∫ s dδ from 0
        let area = 0.5 * delta * s + 0.25 * epsilon * epsilon * (delta / epsilon).asinh();
        let mut dissipated = law.damping * sigma * contact.rate * contact.rate;
        if let Some(lateral) = self.with_lateral(&input.bodies[1], &contact) {
            let spin = angular(&input.bodies[1].twist);
            let moment = self.arm(&contact) * lateral.force;
            dissipated -= lateral.force * lateral.across + moment * dot(&spin, &lateral.t);
        }
        Energy {
            potential: law.stiffness * area,
            dissipated,
            supplied: contact.vertical * contact.road_slope * contact.speed[0],
        }
    }

    fn longest_step(&self, input: &ForceInput<f64, 3, 7, 6>) -> f64 {
        let contact = self.contact(&input.bodies[1]);
        road::time_into_obstacle(&self.law.road, self.law.radius, contact.x, contact.speed[0])
    }

    /// Deflection, whose sign tells contact, the wheel centre's way along the road where that has an obstacle, and the velocities
    /// across and along the wheel.
    fn knots(&self) -> Vec<Vec<f64>> {
        let obstacle = road::knots(&self.law.road, self.law.radius);
        let slip = |law: &model::LateralTyre| {
            let v0 = law.regularization_speed;
            [vec![-v0, v0], vec![0.0]]
        };
        let velocities = self.law.lateral.as_ref().map(slip).into_iter().flatten();
        std::iter::once(vec![0.0]).chain(obstacle).chain(velocities).collect()
    }

    fn velocities(&self) -> usize {
        if self.law.lateral.is_some() { 2 } else { 0 }
    }

    fn arguments(&self, input: &ForceInput<f64, 3, 7, 6>, out: &mut [LawPlace]) {
        let body = &input.bodies[1];
        let contact = self.contact(body);
        let lateral = self.with_lateral(body, &contact);
        // A wheel off the road slips without a force.
        let loaded = contact.deflection > 0.0;
        let velocity = |value: f64, smooth: f64| {
            let smooth = if loaded { smooth } else { f64::INFINITY };
            LawPlace { value, smooth, ..LawPlace::default() }
        };
        for (index, out) in out.iter_mut().enumerate() {
            *out = match (self.scalar(index), &self.law.lateral, &lateral) {
                // The force is straight in the velocity across up to 45° of slip.
                (Scalar::Across, _, Some(side)) => velocity(side.across, side.regular),
                // Next to 90° it has an edge in the one along.
                (Scalar::Along, Some(law), Some(side)) => {
                    let v0 = law.regularization_speed;
                    velocity(side.along, if side.across.abs() > v0 { v0 } else { f64::INFINITY })
                }
                (Scalar::Way, ..) => {
                    LawPlace { value: contact.x, rate: contact.speed[0], ..LawPlace::default() }
                }
                _ => LawPlace {
                    value: contact.deflection,
                    rate: contact.rate,
                    ..LawPlace::default()
                },
            };
        }
    }

    fn profile(&self, index: usize, argument: f64) -> f64 {
        match self.scalar(index) {
            Scalar::Deflection => argument.max(0.0),
            Scalar::Way => road::height(&self.law.road, self.law.radius, argument)[0],
            Scalar::Across => {
                let law = self.law.lateral.as_ref();
                law.map_or(0.0, |law| argument.atan2(law.regularization_speed))
            }
            Scalar::Along => argument.abs(),
        }
    }

    fn quantities(&self) -> &'static [Quantity] {
        QUANTITIES
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, 3, 7, 6>, out: &mut [f64]) {
        let contact = self.contact(&input.bodies[1]);
        out[0] = match index {
            0 => contact.deflection,
            1 => contact.vertical,
            _ => self.with_lateral(&input.bodies[1], &contact).map_or(0.0, |lateral| lateral.force),
        };
    }
}
