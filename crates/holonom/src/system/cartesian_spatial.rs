//! Spatial Cartesian coordinates: r of the centre of mass and Euler parameters p per body.
//!
//! G = [−e  −ẽ + e₀I] gives ω' = 2 G ṗ (body axes), E = [−e  ẽ + e₀I] gives ω = 2 E ṗ (ground axes),
//! A = E Gᵀ homogeneous of degree two. Source: E. J. Haug, *Computer-Aided Kinematics and Dynamics of
//! Mechanical Systems* (1989), chapter 9.

use super::BodyPose;
use super::cartesian::cross;
use super::passage::ByEuler;
use super::space::{FormOf, Space};
use crate::elements::body::{Body, Rigid};
use crate::elements::kinematics::{self, Kinematics, Orientation};
use crate::elements::relative;
use crate::elements::space::{self, triads};
use crate::elements::spatial::{Constraint, Force};
use crate::math::spatial::g_transposed_slope;
use crate::model;

/// Marker of the spatial space.
pub(super) struct Spatial;

type V3 = [f64; 3];
type V4 = [f64; 4];

fn euler(q: &[f64; 7]) -> V4 {
    [q[3], q[4], q[5], q[6]]
}

/// G(p) w.
fn g_times(p: V4, w: V4) -> V3 {
    let (e0, e) = (p[0], [p[1], p[2], p[3]]);
    let c = cross([w[1], w[2], w[3]], e); // −ẽ w
    std::array::from_fn(|k| -e[k] * w[0] + e0 * w[k + 1] + c[k])
}

/// G(p)ᵀ y.
fn g_transposed(p: V4, y: V3) -> V4 {
    let (e0, e) = (p[0], [p[1], p[2], p[3]]);
    let c = cross(e, y); // (−ẽ)ᵀ y = ẽ y
    [
        -(e[0] * y[0] + e[1] * y[1] + e[2] * y[2]),
        e0 * y[0] + c[0],
        e0 * y[1] + c[1],
        e0 * y[2] + c[2],
    ]
}

/// E(p) w.
fn e_times(p: V4, w: V4) -> V3 {
    let (e0, e) = (p[0], [p[1], p[2], p[3]]);
    let c = cross(e, [w[1], w[2], w[3]]);
    std::array::from_fn(|k| -e[k] * w[0] + e0 * w[k + 1] + c[k])
}

/// E(p)ᵀ y.
fn e_transposed(p: V4, y: V3) -> V4 {
    let (e0, e) = (p[0], [p[1], p[2], p[3]]);
    let c = cross(y, e); // ẽᵀ y = y × e
    [
        -(e[0] * y[0] + e[1] * y[1] + e[2] * y[2]),
        e0 * y[0] + c[0],
        e0 * y[1] + c[1],
        e0 * y[2] + c[2],
    ]
}

fn times(j: &[[f64; 3]; 3], x: V3) -> V3 {
    std::array::from_fn(|r| j[r][0] * x[0] + j[r][1] * x[1] + j[r][2] * x[2])
}

/// A(p) s = E Gᵀ s.
pub(super) fn rotate(p: V4, s: &V3) -> V3 {
    e_times(p, g_transposed(p, *s))
}

/// G(p) as rows.
fn g_matrix(p: V4) -> [V4; 3] {
    [[-p[1], p[0], p[3], -p[2]], [-p[2], -p[3], p[0], p[1]], [-p[3], p[2], -p[1], p[0]]]
}

/// 4 G(p)ᵀ J G(w) as rows.
#[inline(always)]
fn inertia_product(j: &[[f64; 3]; 3], p: V4, w: V4) -> [V4; 4] {
    let (left, right) = (g_matrix(p.map(|x| 4.0 * x)), g_matrix(w));
    let mut moved = [[0.0; 4]; 3];
    for row in 0..3 {
        for column in 0..4 {
            moved[row][column] = j[row][0] * right[0][column]
                + j[row][1] * right[1][column]
                + j[row][2] * right[2][column];
        }
    }
    let mut out = [[0.0; 4]; 4];
    for row in 0..4 {
        for column in 0..4 {
            out[row][column] = left[0][row] * moved[0][column]
                + left[1][row] * moved[1][column]
                + left[2][row] * moved[2][column];
        }
    }
    out
}

impl Space<3, 7, 6> for Spatial {
    type Constraint = Constraint;
    type Force = Force;
    type Relative = relative::SpatialRelative;
    type Kinematics = Kinematics<space::Spatial, 3, 7, 4>;
    type Passage = ByEuler<f64>;
    const GROUND: [f64; 7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
    const NORMALIZED: bool = true;

    fn joint(joint: &model::Joint, centers: [[f64; 3]; 2]) -> Constraint {
        Constraint::joint(joint, centers)
    }

    fn driver(driver: &model::Driver, centers: [[f64; 3]; 2]) -> Constraint {
        Constraint::driver(driver, centers)
    }

    fn force(force: &model::Force, centers: [[f64; 3]; 2]) -> Force {
        Force::new(force, centers)
    }

    fn force_bodies(force: &model::Force) -> [model::BodyIndex; 2] {
        Force::bodies(force)
    }

    fn joint_form(joint: &model::Joint, centers: [[f64; 3]; 2]) -> FormOf<Self, 3, 7, 6> {
        space::Spatial::joint_form(&joint.kind, &triads(&joint.frames, &centers))
    }

    fn line_form(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, 3, 7, 6> {
        kinematics::line_form(&triads(frames, &centers), None)
    }

    fn bushing_form(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, 3, 7, 6> {
        kinematics::bushing_form(&triads(frames, &centers))
    }

    fn free_form() -> FormOf<Self, 3, 7, 6> {
        kinematics::free_form()
    }

    fn relative_angle(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> Self::Relative {
        relative::SpatialRelative::angle(&triads(frames, &centers))
    }

    #[inline(always)]
    fn moving(q: &[f64; 7], v: &[f64; 7]) -> Body<f64, 3, 7, 6> {
        space::Spatial::body(q, v)
    }

    fn rotational_mass(inertia: &[[f64; 3]; 3], q: &[f64; 7], out: &mut [f64]) {
        let p = euler(q);
        for (row, target) in inertia_product(inertia, p, p).iter().zip(out.chunks_exact_mut(4)) {
            target.copy_from_slice(row);
        }
    }

    /// 8 Ġᵀ J Ġ p, Ġ = G(ṗ).
    fn gyroscopic_force(inertia: &[[f64; 3]; 3], q: &[f64; 7], v: &[f64; 7], out: &mut [f64]) {
        let (p, pd) = (euler(q), euler(v));
        let f = g_transposed(pd, times(inertia, g_times(pd, p)));
        for (o, x) in out[3..].iter_mut().zip(f) {
            *o += 8.0 * x;
        }
    }

    /// (4GᵀJG a)_p = 4T(JGa) − 4GᵀJG(a); (8ĠᵀJĠp)_p = 8ĠᵀJĠ; (8ĠᵀJĠp)_ṗ = 8T(JĠp) − 8ĠᵀJG.
    #[inline(always)]
    fn inertia_blocks(
        inertia: &[[f64; 3]; 3],
        q: &[f64; 7],
        v: &[f64; 7],
        a: &[f64; 7],
        k: &mut [f64],
        c: &mut [f64],
    ) {
        let (p, pd, pdd) = (euler(q), euler(v), euler(a));
        let t1 = g_transposed_slope(&times(inertia, g_times(p, pdd)));
        let m1 = inertia_product(inertia, p, pdd);
        let m2 = inertia_product(inertia, pd, pd);
        let t3 = g_transposed_slope(&times(inertia, g_times(pd, p)));
        let m3 = inertia_product(inertia, pd, p);
        for row in 0..4 {
            for column in 0..4 {
                let at = (row + 3) * 7 + column + 3;
                k[at] += 4.0 * t1[row][column] - m1[row][column] - 2.0 * m2[row][column];
                c[at] -= 8.0 * t3[row][column] - 2.0 * m3[row][column];
            }
        }
    }

    /// det J / (½ tr J)² of a positive definite J: the other two eigenvalues are at most half their sum each
    /// on average.
    fn least_inertia(inertia: &[[f64; 3]; 3]) -> f64 {
        let [a, b, c] = *inertia;
        let determinant: f64 = cross(b, c).iter().zip(a).map(|(x, y)| x * y).sum();
        let half_trace = 0.5 * (a[0] + b[1] + c[2]);
        (determinant / (half_trace * half_trace)).max(0.0)
    }

    fn kinetic_rotation(inertia: &[[f64; 3]; 3], q: &[f64; 7], v: &[f64; 7]) -> f64 {
        let w = g_times(euler(q), euler(v)); // ω'/2
        let h = times(inertia, w);
        2.0 * (w[0] * h[0] + w[1] * h[1] + w[2] * h[2])
    }

    fn set_body(center: &[f64; 3], pose: &BodyPose, q: &mut [f64], v: &mut [f64]) {
        let p = pose.orientation;
        let arm = rotate(p, center);
        let swing = cross(pose.angular_velocity, arm);
        let pd = e_transposed(p, pose.angular_velocity);
        for k in 0..3 {
            q[k] = pose.position[k] + arm[k];
            v[k] = pose.velocity[k] + swing[k];
        }
        for k in 0..4 {
            q[3 + k] = p[k];
            v[3 + k] = 0.5 * pd[k];
        }
    }

    fn body(center: &[f64; 3], q: &[f64; 7], v: &[f64; 7]) -> BodyPose {
        let p = euler(q);
        let arm = rotate(p, center);
        let half = e_times(p, euler(v));
        let w = half.map(|x| 2.0 * x);
        let swing = cross(w, arm);
        BodyPose {
            position: std::array::from_fn(|k| q[k] - arm[k]),
            orientation: p,
            velocity: std::array::from_fn(|k| v[k] - swing[k]),
            angular_velocity: w,
        }
    }

    fn body_acceleration(
        center: &[f64; 3],
        q: &[f64; 7],
        v: &[f64; 7],
        a: &[f64; 7],
    ) -> ([f64; 3], [f64; 3]) {
        let p = euler(q);
        let arm = rotate(p, center);
        let w = e_times(p, euler(v)).map(|x| 2.0 * x);
        // E(ṗ)ṗ = 0, so the angular acceleration is 2 E p̈.
        let alpha = e_times(p, euler(a)).map(|x| 2.0 * x);
        let (tangential, centripetal) = (cross(alpha, arm), cross(w, cross(w, arm)));
        (std::array::from_fn(|k| a[k] - tangential[k] - centripetal[k]), alpha)
    }

    fn wrench(q: &[f64; 7], generalized: &[f64; 7]) -> ([f64; 3], [f64; 3]) {
        let torque = e_times(euler(q), euler(generalized)).map(|x| 0.5 * x);
        ([generalized[0], generalized[1], generalized[2]], torque)
    }

    fn rotate(q: &[f64; 7], s: &[f64; 3]) -> [f64; 3] {
        rotate(euler(q), s)
    }

    fn coordinate_names() -> [&'static str; 7] {
        ["x", "y", "z", "e0", "e1", "e2", "e3"]
    }
}
