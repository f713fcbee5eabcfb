//! Joints, drivers and forces of planar models: poses (x, y, θ) of centres of mass.

use super::body::Body;
use super::forces::rsda::InPlane;
use super::forces::{self, by_variant};
use super::space::{Planar, triads};
use super::{
    Energy, ExtraRows, ExtraStateScale, ForceBlocks, ForceElement, ForceInput, Quantity, Wrenches,
};
use super::{constraint, drivers, joints};
use crate::math::Real;
use crate::model::{self, BodyIndex, DriverKind, ForceKind, JointKind};

/// A planar joint or driver.
pub type Constraint = constraint::Constraint<Planar, 2, 3, 1>;

impl Constraint {
    /// The equations of a joint; `centers` are the centres of mass of its first and second body, m,
    /// body axes, from the body origin (zero for the ground).
    ///
    /// # Panics
    /// If the joint is spatial only; a validated planar model has none.
    pub fn joint(joint: &model::Joint, centers: [[f64; 3]; 2]) -> Self {
        let frames = triads(&joint.frames, &centers);
        match joint.kind {
            JointKind::Fixed => joints::fixed::planar(&frames),
            JointKind::Revolute => joints::revolute::planar(&frames),
            JointKind::Translational => joints::translational::planar(&frames),
            JointKind::Distance { length } => joints::distance::of_any_dimension(&frames, length),
            JointKind::Cylindrical | JointKind::Universal | JointKind::Spherical => {
                unreachable!("joint `{}` is spatial, the model planar", joint.name)
            }
        }
    }

    /// The equation of a driver; `centers` as in [`joint`](Self::joint).
    pub fn driver(driver: &model::Driver, centers: [[f64; 3]; 2]) -> Self {
        let frames = triads(&driver.frames, &centers);
        let motion = driver.motion.clone();
        match driver.kind {
            DriverKind::Translation => drivers::translation::planar(&frames, motion),
            DriverKind::Rotation => drivers::rotation::planar(&frames, motion),
        }
    }
}

type Tsda = forces::tsda::Tsda<Planar, 2, 3, 3>;
type Maxwell = forces::maxwell::Maxwell<Planar, 2, 3, 3>;
type Rsda = forces::rsda::Rsda<InPlane>;
type PointForce = forces::point_force::PointForce<Planar, 2, 3, 3>;
type Torque = forces::torque::PlanarTorque;

/// A planar force.
#[derive(Debug, Clone, PartialEq)]
pub enum Force {
    /// Translational spring-damper.
    Tsda(Tsda),
    /// Rotational spring-damper.
    Rsda(Rsda),
    /// Spring and damper in series.
    Maxwell(Maxwell),
    /// Force at a point.
    PointForce(PointForce),
    /// Torque.
    Torque(Torque),
}

impl Force {
    /// The equations of a force; `centers` are the centres of mass of [`bodies`](Self::bodies), m,
    /// body axes, from the body origin (zero for the ground).
    ///
    /// # Panics
    /// If the force is spatial only; a validated planar model has none.
    pub fn new(force: &model::Force, centers: [[f64; 3]; 2]) -> Self {
        match &force.kind {
            ForceKind::Tsda { frames, law, damping, free_length } => Self::Tsda(Tsda::new(
                &triads(frames, &centers),
                law.clone(),
                *damping,
                *free_length,
            )),
            ForceKind::Rsda { frames, law, damping, free_angle } => Self::Rsda(Rsda::new(
                InPlane::new(&triads(frames, &centers)),
                law.clone(),
                *damping,
                *free_angle,
            )),
            ForceKind::Maxwell { frames, stiffness, damping, free_length } => Self::Maxwell(
                Maxwell::new(&triads(frames, &centers), *stiffness, *damping, *free_length),
            ),
            ForceKind::PointForce { frame, force, axes } => {
                Self::PointForce(PointForce::new(frame, force, *axes, &centers))
            }
            ForceKind::Torque { torque, .. } => Self::Torque(Torque::new(torque)),
            ForceKind::Bushing { .. } | ForceKind::Tyre(_) => {
                unreachable!("force `{}` is spatial, the model planar", force.name)
            }
        }
    }

    /// First and second body. For a force on one body the second is acted on and the first carries
    /// the reaction; it is the ground where there is none.
    pub fn bodies(force: &model::Force) -> [BodyIndex; 2] {
        forces::bodies(force)
    }
}

by_variant!(Force, [2, 3, 3], Tsda, Rsda, Maxwell, PointForce, Torque);

/// The pose of the ground.
pub const GROUND: [f64; 3] = [0.0; 3];
