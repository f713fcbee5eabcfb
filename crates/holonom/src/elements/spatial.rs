//! Joints, drivers and forces of spatial models: poses (r, Euler parameters) of centres of mass.

use super::body::Body;
use super::forces::rsda::AboutAxis;
use super::forces::{self, by_variant};
use super::space::{Spatial, triads};
use super::{
    Energy, ExtraRows, ExtraStateScale, ForceBlocks, ForceElement, ForceInput, Quantity, Wrenches,
};
use super::{constraint, drivers, joints};
use crate::math::Real;
use crate::model::{self, BodyIndex, DriverKind, ForceKind, JointKind};

/// A spatial joint or driver.
pub type Constraint = constraint::Constraint<Spatial, 3, 7, 4>;

impl Constraint {
    /// The equations of a joint; `centers` are the centres of mass of its first and second body, m,
    /// body axes, from the body origin (zero for the ground).
    pub fn joint(joint: &model::Joint, centers: [[f64; 3]; 2]) -> Self {
        let frames = triads(&joint.frames, &centers);
        match joint.kind {
            JointKind::Fixed => joints::fixed::spatial(&frames),
            JointKind::Revolute => joints::revolute::spatial(&frames),
            JointKind::Translational => joints::translational::spatial(&frames),
            JointKind::Cylindrical => joints::cylindrical::spatial(&frames),
            JointKind::Universal => joints::universal::spatial(&frames),
            JointKind::Spherical => joints::spherical::spatial(&frames),
            JointKind::Distance { length } => joints::distance::of_any_dimension(&frames, length),
        }
    }

    /// The equation of a driver; `centers` as in [`joint`](Self::joint).
    pub fn driver(driver: &model::Driver, centers: [[f64; 3]; 2]) -> Self {
        let frames = triads(&driver.frames, &centers);
        let motion = driver.motion.clone();
        match driver.kind {
            DriverKind::Translation => drivers::translation::spatial(&frames, motion),
            DriverKind::Rotation => drivers::rotation::spatial(&frames, motion),
        }
    }
}

type Tsda = forces::tsda::Tsda<Spatial, 3, 7, 6>;
type Maxwell = forces::maxwell::Maxwell<Spatial, 3, 7, 6>;
type Rsda = forces::rsda::Rsda<AboutAxis>;
type Bushing = forces::bushing::Bushing;
type Tyre = forces::tyre::Tyre;
type PointForce = forces::point_force::PointForce<Spatial, 3, 7, 6>;
type Torque = forces::torque::SpatialTorque;

/// A spatial force.
#[derive(Debug, Clone, PartialEq)]
pub enum Force {
    /// Translational spring-damper.
    Tsda(Tsda),
    /// Rotational spring-damper.
    Rsda(Rsda),
    /// Spring and damper in series.
    Maxwell(Maxwell),
    /// Linear 6×6 bushing.
    Bushing(Box<Bushing>),
    /// Tyre on a road.
    Tyre(Box<Tyre>),
    /// Force at a point.
    PointForce(PointForce),
    /// Torque.
    Torque(Torque),
}

impl Force {
    /// The equations of a force; `centers` are the centres of mass of [`bodies`](Self::bodies), m,
    /// body axes, from the body origin (zero for the ground).
    pub fn new(force: &model::Force, centers: [[f64; 3]; 2]) -> Self {
        match &force.kind {
            ForceKind::Tsda { frames, law, damping, free_length } => Self::Tsda(Tsda::new(
                &triads(frames, &centers),
                law.clone(),
                *damping,
                *free_length,
            )),
            ForceKind::Rsda { frames, law, damping, free_angle } => Self::Rsda(Rsda::new(
                AboutAxis::new(&triads(frames, &centers)),
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
            ForceKind::Torque { torque, axes, .. } => Self::Torque(Torque::new(torque, *axes)),
            ForceKind::Bushing { frames, stiffness, damping, branches } => {
                let frames = triads(frames, &centers);
                Self::Bushing(Box::new(Bushing::new(&frames, stiffness, damping, branches)))
            }
            ForceKind::Tyre(tyre) => Self::Tyre(Box::new(Tyre::new(tyre, &centers))),
        }
    }

    /// First and second body. For a force on one body the second is acted on and the first carries
    /// the reaction; it is the ground where there is none.
    pub fn bodies(force: &model::Force) -> [BodyIndex; 2] {
        forces::bodies(force)
    }
}

by_variant!(Force, [3, 7, 6], Tsda, Rsda, Maxwell, Bushing, Tyre, PointForce, Torque);

/// The pose of the ground.
pub const GROUND: [f64; 7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];
