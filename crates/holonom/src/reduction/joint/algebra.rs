//! Motions and forces of bodies about a fixed point, in a plane and in space.
//!
//! A twist is the velocity of the body-fixed point that passes the reference point O, then the angular velocity; a wrench
//! the force, then the moment about O. No transformation stands between bodies then (`docs/theory/joint.md` (1)-(6);
//! thesis (3.133)).

use super::inertia::{Inertia, PlanarInertia, SpatialInertia};
use crate::math::spatial::{cross, e_times, e_transposed_times};
use crate::math::vector::{difference, dot, sum};
use crate::system::{Motion, Stance, Wrench};

/// Twists and wrenches of `W` numbers for poses of `N` coordinates.
pub(super) trait Algebra<const N: usize, const W: usize>:
    std::fmt::Debug + Clone + Send + Sync + 'static
{
    /// Symmetric matrices that make wrenches of rates of twists.
    type Inertia: Inertia<W>;

    /// Twist about a point of the velocity there with an angular velocity.
    fn screw(linear: &[f64; 3], angular: &[f64; 3]) -> [f64; W];

    /// Rate of a twist that is fixed in what moves with twist `a`.
    fn cross(a: &[f64; W], b: &[f64; W]) -> [f64; W];

    /// Rate of a wrench that is fixed in what moves with twist `a`: its power with b changes by −wᵀ(a × b).
    fn cross_dual(a: &[f64; W], w: &[f64; W]) -> [f64; W];

    /// Reference point at a pose.
    fn center(q: &[f64; N]) -> [f64; 3];

    /// q̇ of a twist, or δq of a displacement.
    fn rates(q: &[f64; N], o: &[f64; 3], y: &[f64; W]) -> [f64; N];

    /// q̈ of a twist with rates q̇ = `v`, and its rate.
    fn second_rates(
        q: &[f64; N],
        v: &[f64; N],
        o: &[f64; 3],
        y: &[f64; W],
        yd: &[f64; W],
    ) -> [f64; N];

    /// Change of [`Algebra::rates`] at a fixed twist with a displacement by δq.
    fn rates_change(dq: &[f64; N], y: &[f64; W]) -> [f64; N];

    /// What a row on q̈ is on the twist by which that of q̇ = `v` moves in [`Algebra::second_rates`].
    fn row_on_bend(v: &[f64; N], row: &[f64; N]) -> [f64; W];

    /// How a body stands at a pose.
    fn stance(q: &[f64; N]) -> Stance;

    /// How a body moves with a twist, is displaced, and its twist changes; its centre of mass at `arm` from the point that
    /// they refer to.
    fn motion(arm: &[f64; 3], y: &[f64; W], dy: [&[f64; W]; 2]) -> Motion;

    /// A wrench about the centre of mass, about a point from which that is at `arm`.
    fn about(w: &Wrench, arm: &[f64; 3]) -> [f64; W];

    /// Wrench of a generalized force on the pose, or the row on twists of one on q̇.
    fn wrench(q: &[f64; N], o: &[f64; 3], force: &[f64; N]) -> [f64; W];

    /// Change of [`Algebra::wrench`] of a generalized force that stays the same, with the pose.
    fn wrench_change(dq: &[f64; N], force: &[f64; N]) -> [f64; W];

    /// Change of a wrench about a fixed point as the place that it acts at is displaced.
    fn shifted(by: &[f64; W], w: &[f64; W]) -> [f64; W];

    /// What a row on velocities is on displacements −δx by which what moves with twist `y` gets other ones: ω × its part.
    fn carried(y: &[f64; W], row: &[f64; W]) -> [f64; W];

    /// A wrench about another point.
    fn moved(w: &[f64; W], from: &[f64; 3], to: &[f64; 3]) -> [f64; W];

    /// A twist about another point.
    fn moved_twist(y: &[f64; W], from: &[f64; 3], to: &[f64; 3]) -> [f64; W];

    /// Bounds of the diagonal of an inertia about another point.
    fn moved_sizes(sizes: &[f64; W], from: &[f64; 3], to: &[f64; 3]) -> [f64; W];

    /// A wrench with its moments multiplied.
    fn scaled(w: &[f64; W], factor: f64) -> [f64; W];

    /// Inertia about the centre of mass, given in axes of the body, in axes of the ground.
    fn turned(inertia: &[[f64; 3]; 3], stance: &Stance) -> [[f64; 3]; 3];

    /// Sizes of the force and of the moment that a wrench is the sum of: components of one vector turn into each other.
    fn sizes(terms: &[f64; W]) -> [f64; 2];

    /// Size of what such a wrench does along a twist.
    fn size_along(y: &[f64; W], sizes: &[f64; 2]) -> f64;

    /// Inertia of a body times the rate of a twist, velocities left out; here and below from that about the centre of mass
    /// in axes of the ground.
    fn inertia_times(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        q: &[f64; N],
        o: &[f64; 3],
        yd: &[f64; W],
    ) -> [f64; W];

    /// The same about the centre of mass.
    fn inertia_about_center(mass: f64, inertia: &[[f64; 3]; 3], yd: &[f64; W]) -> [f64; W];

    /// What the turning of a body exerts, −ω × J ω, about its centre of mass.
    fn turning(inertia: &[[f64; 3]; 3], y: &[f64; W]) -> [f64; W];

    /// Wrench about the centre of mass, as [`Algebra::wrench`].
    fn wrench_about_center(q: &[f64; N], force: &[f64; N]) -> [f64; W];

    /// The wrench that accelerates a body: rate of momentum without the gyroscopic part, which counts among the
    /// forces, for q and q̈ and the rate of its twist.
    fn inertia_force(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        motion: [&[f64; N]; 2],
        o: &[f64; 3],
        yd: &[f64; W],
    ) -> [f64; W];
}

/// In space: three of a velocity, three of an angular velocity.
#[derive(Debug, Clone)]
pub(super) struct Spatial;

/// In a plane.
#[derive(Debug, Clone)]
pub(super) struct Planar;

#[inline(always)]
pub(super) fn parts(y: &[f64; 6]) -> ([f64; 3], [f64; 3]) {
    ([y[0], y[1], y[2]], [y[3], y[4], y[5]])
}

#[inline(always)]
pub(super) fn joined(a: &[f64; 3], b: &[f64; 3]) -> [f64; 6] {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
}

#[inline(always)]
fn place(q: &[f64; 7]) -> [f64; 3] {
    [q[0], q[1], q[2]]
}

#[inline(always)]
fn euler(q: &[f64; 7]) -> [f64; 4] {
    [q[3], q[4], q[5], q[6]]
}

/// ½ Eᵀ(p) ω.
#[inline(always)]
fn euler_rate(p: &[f64; 4], w: &[f64; 3]) -> [f64; 4] {
    e_transposed_times(p, w).map(|x| 0.5 * x)
}

#[inline(always)]
fn pose(r: &[f64; 3], p: &[f64; 4]) -> [f64; 7] {
    [r[0], r[1], r[2], p[0], p[1], p[2], p[3]]
}

impl Algebra<7, 6> for Spatial {
    type Inertia = SpatialInertia;

    #[inline(always)]
    fn screw(linear: &[f64; 3], angular: &[f64; 3]) -> [f64; 6] {
        joined(linear, angular)
    }

    #[inline(always)]
    fn cross(a: &[f64; 6], b: &[f64; 6]) -> [f64; 6] {
        let ((av, aw), (bv, bw)) = (parts(a), parts(b));
        joined(&sum(&cross(&aw, &bv), &cross(&av, &bw)), &cross(&aw, &bw))
    }

    #[inline(always)]
    fn cross_dual(a: &[f64; 6], w: &[f64; 6]) -> [f64; 6] {
        let ((av, aw), (f, n)) = (parts(a), parts(w));
        joined(&cross(&aw, &f), &sum(&cross(&av, &f), &cross(&aw, &n)))
    }

    #[inline(always)]
    fn center(q: &[f64; 7]) -> [f64; 3] {
        place(q)
    }

    #[inline(always)]
    fn rates(q: &[f64; 7], o: &[f64; 3], y: &[f64; 6]) -> [f64; 7] {
        let (v, w) = parts(y);
        let v = sum(&v, &cross(&w, &difference(&place(q), o)));
        pose(&v, &euler_rate(&euler(q), &w))
    }

    #[inline(always)]
    fn second_rates(
        q: &[f64; 7],
        v: &[f64; 7],
        o: &[f64; 3],
        y: &[f64; 6],
        yd: &[f64; 6],
    ) -> [f64; 7] {
        let ((_, w), (a, alpha)) = (parts(y), parts(yd));
        let mut a = sum(&a, &cross(&alpha, &difference(&place(q), o)));
        a = sum(&a, &cross(&w, &place(v)));
        let p = sum(&euler_rate(&euler(q), &alpha), &euler_rate(&euler(v), &w));
        pose(&a, &p)
    }

    #[inline(always)]
    fn rates_change(dq: &[f64; 7], y: &[f64; 6]) -> [f64; 7] {
        let (_, w) = parts(y);
        pose(&cross(&w, &place(dq)), &euler_rate(&euler(dq), &w))
    }

    fn row_on_bend(v: &[f64; 7], row: &[f64; 7]) -> [f64; 6] {
        let turn = e_times(&euler(v), &euler(row)).map(|x| 0.5 * x);
        joined(&[0.0; 3], &sum(&turn, &cross(&place(v), &place(row))))
    }

    fn stance(q: &[f64; 7]) -> Stance {
        Stance::spatial(q)
    }

    #[inline(always)]
    fn motion(arm: &[f64; 3], y: &[f64; 6], [displaced, changed]: [&[f64; 6]; 2]) -> Motion {
        let field = |y: &[f64; 6]| {
            let (v, w) = parts(y);
            [sum(&v, &cross(&w, arm)), w]
        };
        let (velocity, displacement) = (field(y), field(displaced));
        let [straight, turning] = field(changed);
        let change = [sum(&straight, &cross(&velocity[1], &displacement[0])), turning];
        Motion { velocity, displacement, change }
    }

    #[inline(always)]
    fn about([f, n]: &Wrench, arm: &[f64; 3]) -> [f64; 6] {
        joined(f, &sum(n, &cross(arm, f)))
    }

    #[inline(always)]
    fn wrench(q: &[f64; 7], o: &[f64; 3], force: &[f64; 7]) -> [f64; 6] {
        let f = place(force);
        let moment = e_times(&euler(q), &euler(force)).map(|x| 0.5 * x);
        joined(&f, &sum(&moment, &cross(&difference(&place(q), o), &f)))
    }

    fn wrench_change(dq: &[f64; 7], force: &[f64; 7]) -> [f64; 6] {
        let turn = e_times(&euler(dq), &euler(force)).map(|x| 0.5 * x);
        joined(&[0.0; 3], &sum(&turn, &cross(&place(dq), &place(force))))
    }

    #[inline(always)]
    fn shifted(by: &[f64; 6], w: &[f64; 6]) -> [f64; 6] {
        joined(&[0.0; 3], &cross(&parts(by).0, &parts(w).0))
    }

    #[inline(always)]
    fn carried(y: &[f64; 6], row: &[f64; 6]) -> [f64; 6] {
        joined(&cross(&parts(y).1, &parts(row).0), &[0.0; 3])
    }

    #[inline(always)]
    fn moved(w: &[f64; 6], from: &[f64; 3], to: &[f64; 3]) -> [f64; 6] {
        let (f, n) = parts(w);
        joined(&f, &sum(&n, &cross(&difference(from, to), &f)))
    }

    #[inline(always)]
    fn moved_twist(y: &[f64; 6], from: &[f64; 3], to: &[f64; 3]) -> [f64; 6] {
        let (v, w) = parts(y);
        joined(&sum(&v, &cross(&w, &difference(to, from))), &w)
    }

    fn moved_sizes(sizes: &[f64; 6], from: &[f64; 3], to: &[f64; 3]) -> [f64; 6] {
        let (linear, angular) = parts(sizes);
        let arm = difference(from, to);
        let by = 2.0 * arm.iter().map(|x| x * x).sum::<f64>() * linear.iter().sum::<f64>();
        joined(&linear, &angular.map(|x| 2.0 * x + by))
    }

    fn scaled(w: &[f64; 6], factor: f64) -> [f64; 6] {
        let (f, n) = parts(w);
        joined(&f, &n.map(|x| factor * x))
    }

    fn turned(inertia: &[[f64; 3]; 3], Stance { axes: a, .. }: &Stance) -> [[f64; 3]; 3] {
        let half = a.map(|row| times(inertia, &row)); // A J, J being symmetric
        let mut out = [[0.0; 3]; 3];
        for i in 0..3 {
            for j in 0..=i {
                out[i][j] = dot(&half[i], &a[j]);
                out[j][i] = out[i][j];
            }
        }
        out
    }

    fn sizes(terms: &[f64; 6]) -> [f64; 2] {
        let (f, n) = parts(terms);
        [f, n].map(|x| x[0] + x[1] + x[2])
    }

    fn size_along(y: &[f64; 6], [f, n]: &[f64; 2]) -> f64 {
        let [v, w] = Self::sizes(&y.map(f64::abs));
        v * f + w * n
    }

    #[inline(always)]
    fn inertia_times(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        q: &[f64; 7],
        o: &[f64; 3],
        yd: &[f64; 6],
    ) -> [f64; 6] {
        let (a, alpha) = parts(yd);
        let arm = difference(&place(q), o);
        let f = sum(&a, &cross(&alpha, &arm)).map(|x| mass * x);
        joined(&f, &sum(&times(inertia, &alpha), &cross(&arm, &f)))
    }

    #[inline(always)]
    fn inertia_about_center(mass: f64, inertia: &[[f64; 3]; 3], yd: &[f64; 6]) -> [f64; 6] {
        let (a, alpha) = parts(yd);
        joined(&a.map(|x| mass * x), &times(inertia, &alpha))
    }

    #[inline(always)]
    fn turning(inertia: &[[f64; 3]; 3], y: &[f64; 6]) -> [f64; 6] {
        let (_, w) = parts(y);
        joined(&[0.0; 3], &cross(&times(inertia, &w), &w))
    }

    #[inline(always)]
    fn wrench_about_center(q: &[f64; 7], force: &[f64; 7]) -> [f64; 6] {
        joined(&place(force), &e_times(&euler(q), &euler(force)).map(|x| 0.5 * x))
    }

    #[inline(always)]
    fn inertia_force(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        [q, a]: [&[f64; 7]; 2],
        o: &[f64; 3],
        yd: &[f64; 6],
    ) -> [f64; 6] {
        let f = place(a).map(|x| mass * x);
        let arm = difference(&place(q), o);
        joined(&f, &sum(&times(inertia, &parts(yd).1), &cross(&arm, &f)))
    }
}

#[inline(always)]
fn times(a: &[[f64; 3]; 3], x: &[f64; 3]) -> [f64; 3] {
    a.map(|row| dot(&row, x))
}

/// ω × a.
#[inline(always)]
fn across(w: f64, a: &[f64; 2]) -> [f64; 2] {
    [-w * a[1], w * a[0]]
}

#[inline(always)]
fn moment(arm: &[f64; 2], f: &[f64; 2]) -> f64 {
    arm[0] * f[1] - arm[1] * f[0]
}

#[inline(always)]
fn arm(q: &[f64; 3], o: &[f64; 3]) -> [f64; 2] {
    [q[0] - o[0], q[1] - o[1]]
}

impl Algebra<3, 3> for Planar {
    type Inertia = PlanarInertia;

    #[inline(always)]
    fn screw(linear: &[f64; 3], angular: &[f64; 3]) -> [f64; 3] {
        [linear[0], linear[1], angular[2]]
    }

    #[inline(always)]
    fn cross(a: &[f64; 3], b: &[f64; 3]) -> [f64; 3] {
        let ([x, y], [u, v]) = (across(a[2], &[b[0], b[1]]), across(b[2], &[a[0], a[1]]));
        [x - u, y - v, 0.0]
    }

    #[inline(always)]
    fn cross_dual(a: &[f64; 3], w: &[f64; 3]) -> [f64; 3] {
        let [x, y] = across(a[2], &[w[0], w[1]]);
        [x, y, moment(&[a[0], a[1]], &[w[0], w[1]])]
    }

    #[inline(always)]
    fn center(q: &[f64; 3]) -> [f64; 3] {
        [q[0], q[1], 0.0]
    }

    #[inline(always)]
    fn rates(q: &[f64; 3], o: &[f64; 3], y: &[f64; 3]) -> [f64; 3] {
        let [u, v] = across(y[2], &arm(q, o));
        [y[0] + u, y[1] + v, y[2]]
    }

    #[inline(always)]
    fn second_rates(
        q: &[f64; 3],
        v: &[f64; 3],
        o: &[f64; 3],
        y: &[f64; 3],
        yd: &[f64; 3],
    ) -> [f64; 3] {
        let ([a, b], [c, d]) = (across(yd[2], &arm(q, o)), across(y[2], &[v[0], v[1]]));
        [yd[0] + a + c, yd[1] + b + d, yd[2]]
    }

    #[inline(always)]
    fn rates_change(dq: &[f64; 3], y: &[f64; 3]) -> [f64; 3] {
        let [u, v] = across(y[2], &[dq[0], dq[1]]);
        [u, v, 0.0]
    }

    fn row_on_bend(v: &[f64; 3], row: &[f64; 3]) -> [f64; 3] {
        [0.0, 0.0, moment(&[v[0], v[1]], &[row[0], row[1]])]
    }

    fn stance(q: &[f64; 3]) -> Stance {
        Stance::planar(q)
    }

    #[inline(always)]
    fn motion(arm: &[f64; 3], y: &[f64; 3], [displaced, changed]: [&[f64; 3]; 2]) -> Motion {
        let field = |y: &[f64; 3]| {
            let [u, v] = across(y[2], &[arm[0], arm[1]]);
            [[y[0] + u, y[1] + v, 0.0], [0.0, 0.0, y[2]]]
        };
        let (velocity, displacement) = (field(y), field(displaced));
        let [straight, turning] = field(changed);
        let [u, v] = across(y[2], &[displacement[0][0], displacement[0][1]]);
        let change = [[straight[0] + u, straight[1] + v, 0.0], turning];
        Motion { velocity, displacement, change }
    }

    #[inline(always)]
    fn about([f, n]: &Wrench, arm: &[f64; 3]) -> [f64; 3] {
        [f[0], f[1], n[2] + moment(&[arm[0], arm[1]], &[f[0], f[1]])]
    }

    #[inline(always)]
    fn wrench(q: &[f64; 3], o: &[f64; 3], force: &[f64; 3]) -> [f64; 3] {
        let [x, y, n] = *force;
        [x, y, n + moment(&arm(q, o), &[x, y])]
    }

    fn wrench_change(dq: &[f64; 3], force: &[f64; 3]) -> [f64; 3] {
        [0.0, 0.0, moment(&[dq[0], dq[1]], &[force[0], force[1]])]
    }

    #[inline(always)]
    fn shifted(by: &[f64; 3], w: &[f64; 3]) -> [f64; 3] {
        [0.0, 0.0, moment(&[by[0], by[1]], &[w[0], w[1]])]
    }

    #[inline(always)]
    fn carried(y: &[f64; 3], row: &[f64; 3]) -> [f64; 3] {
        let [u, v] = across(y[2], &[row[0], row[1]]);
        [u, v, 0.0]
    }

    #[inline(always)]
    fn moved(w: &[f64; 3], from: &[f64; 3], to: &[f64; 3]) -> [f64; 3] {
        [w[0], w[1], w[2] + moment(&[from[0] - to[0], from[1] - to[1]], &[w[0], w[1]])]
    }

    #[inline(always)]
    fn moved_twist(y: &[f64; 3], from: &[f64; 3], to: &[f64; 3]) -> [f64; 3] {
        let [u, v] = across(y[2], &[to[0] - from[0], to[1] - from[1]]);
        [y[0] + u, y[1] + v, y[2]]
    }

    fn moved_sizes(sizes: &[f64; 3], from: &[f64; 3], to: &[f64; 3]) -> [f64; 3] {
        let arm = [from[0] - to[0], from[1] - to[1]];
        let by = 2.0 * arm.iter().map(|x| x * x).sum::<f64>() * (sizes[0] + sizes[1]);
        [sizes[0], sizes[1], 2.0 * sizes[2] + by]
    }

    fn scaled(w: &[f64; 3], factor: f64) -> [f64; 3] {
        [w[0], w[1], factor * w[2]]
    }

    fn turned(inertia: &[[f64; 3]; 3], _: &Stance) -> [[f64; 3]; 3] {
        *inertia
    }

    fn sizes(terms: &[f64; 3]) -> [f64; 2] {
        [terms[0] + terms[1], terms[2]]
    }

    fn size_along(y: &[f64; 3], [f, n]: &[f64; 2]) -> f64 {
        (y[0].abs() + y[1].abs()) * f + y[2].abs() * n
    }

    #[inline(always)]
    fn inertia_times(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        q: &[f64; 3],
        o: &[f64; 3],
        yd: &[f64; 3],
    ) -> [f64; 3] {
        let arm = arm(q, o);
        let [u, v] = across(yd[2], &arm);
        let f = [mass * (yd[0] + u), mass * (yd[1] + v)];
        [f[0], f[1], inertia[2][2] * yd[2] + moment(&arm, &f)]
    }

    #[inline(always)]
    fn inertia_about_center(mass: f64, inertia: &[[f64; 3]; 3], yd: &[f64; 3]) -> [f64; 3] {
        [mass * yd[0], mass * yd[1], inertia[2][2] * yd[2]]
    }

    #[inline(always)]
    fn turning(_: &[[f64; 3]; 3], _: &[f64; 3]) -> [f64; 3] {
        [0.0; 3]
    }

    #[inline(always)]
    fn wrench_about_center(_: &[f64; 3], force: &[f64; 3]) -> [f64; 3] {
        *force
    }

    #[inline(always)]
    fn inertia_force(
        mass: f64,
        inertia: &[[f64; 3]; 3],
        [q, a]: [&[f64; 3]; 2],
        o: &[f64; 3],
        yd: &[f64; 3],
    ) -> [f64; 3] {
        let f = [mass * a[0], mass * a[1]];
        [f[0], f[1], inertia[2][2] * yd[2] + moment(&arm(q, o), &f)]
    }
}
