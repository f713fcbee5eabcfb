//! Planar Cartesian coordinates: (x, y, θ) of the centre of mass per body.

use super::BodyPose;
use super::passage::Direct;
use super::space::{FormOf, Space};
use crate::elements::body::{Body, Rigid};
use crate::elements::kinematics::{self, Kinematics, Orientation};
use crate::elements::planar::{Constraint, Force};
use crate::elements::relative;
use crate::elements::space::{self, triads};
use crate::math::planar::rotate;
use crate::model;

/// Marker of the planar space.
pub(super) struct Planar;

fn turn(angle: f64, s: &[f64; 3]) -> [f64; 3] {
    let [x, y] = rotate(angle, &[s[0], s[1]]);
    [x, y, 0.0]
}

impl Space<2, 3, 3> for Planar {
    type Constraint = Constraint;
    type Force = Force;
    type Relative = relative::PlanarRelative;
    type Kinematics = Kinematics<space::Planar, 2, 3, 1>;
    type Passage = Direct;
    const GROUND: [f64; 3] = [0.0; 3];
    const NORMALIZED: bool = false;

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

    fn joint_form(joint: &model::Joint, centers: [[f64; 3]; 2]) -> FormOf<Self, 2, 3, 3> {
        space::Planar::joint_form(&joint.kind, &triads(&joint.frames, &centers))
    }

    fn line_form(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, 2, 3, 3> {
        kinematics::line_form(&triads(frames, &centers), None)
    }

    fn bushing_form(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, 2, 3, 3> {
        kinematics::bushing_form(&triads(frames, &centers))
    }

    fn free_form() -> FormOf<Self, 2, 3, 3> {
        kinematics::free_form()
    }

    fn relative_angle(frames: &[model::Frame; 2], centers: [[f64; 3]; 2]) -> Self::Relative {
        relative::PlanarRelative::angle(&triads(frames, &centers))
    }

    #[inline(always)]
    fn moving(q: &[f64; 3], v: &[f64; 3]) -> Body<f64, 2, 3, 3> {
        space::Planar::body(q, v)
    }

    fn rotational_mass(inertia: &[[f64; 3]; 3], _: &[f64; 3], out: &mut [f64]) {
        out[0] = inertia[2][2];
    }

    fn gyroscopic_force(_: &[[f64; 3]; 3], _: &[f64; 3], _: &[f64; 3], _: &mut [f64]) {}

    fn inertia_blocks(
        _: &[[f64; 3]; 3],
        _: &[f64; 3],
        _: &[f64; 3],
        _: &[f64; 3],
        _: &mut [f64],
        _: &mut [f64],
    ) {
    }

    fn least_inertia(inertia: &[[f64; 3]; 3]) -> f64 {
        inertia[2][2]
    }

    fn kinetic_rotation(inertia: &[[f64; 3]; 3], _: &[f64; 3], v: &[f64; 3]) -> f64 {
        0.5 * inertia[2][2] * v[2] * v[2]
    }

    fn set_body(center: &[f64; 3], pose: &BodyPose, q: &mut [f64], v: &mut [f64]) {
        let arm = turn(pose.orientation[0], center);
        let w = pose.angular_velocity[2];
        q.copy_from_slice(&[
            pose.position[0] + arm[0],
            pose.position[1] + arm[1],
            pose.orientation[0],
        ]);
        v.copy_from_slice(&[pose.velocity[0] - w * arm[1], pose.velocity[1] + w * arm[0], w]);
    }

    fn body(center: &[f64; 3], q: &[f64; 3], v: &[f64; 3]) -> BodyPose {
        let arm = turn(q[2], center);
        BodyPose {
            position: [q[0] - arm[0], q[1] - arm[1], 0.0],
            orientation: [q[2], 0.0, 0.0, 0.0],
            velocity: [v[0] + v[2] * arm[1], v[1] - v[2] * arm[0], 0.0],
            angular_velocity: [0.0, 0.0, v[2]],
        }
    }

    fn body_acceleration(
        center: &[f64; 3],
        q: &[f64; 3],
        v: &[f64; 3],
        a: &[f64; 3],
    ) -> ([f64; 3], [f64; 3]) {
        let arm = turn(q[2], center);
        let w2 = v[2] * v[2];
        let linear = [a[0] + a[2] * arm[1] + w2 * arm[0], a[1] - a[2] * arm[0] + w2 * arm[1], 0.0];
        (linear, [0.0, 0.0, a[2]])
    }

    fn wrench(_: &[f64; 3], generalized: &[f64; 3]) -> ([f64; 3], [f64; 3]) {
        ([generalized[0], generalized[1], 0.0], [0.0, 0.0, generalized[2]])
    }

    fn rotate(q: &[f64; 3], s: &[f64; 3]) -> [f64; 3] {
        turn(q[2], s)
    }

    fn coordinate_names() -> [&'static str; 3] {
        ["x", "y", "angle"]
    }
}
