//! What a dimension supplies to Cartesian coordinates.

use super::BodyPose;
use super::passage::Passage;
use crate::elements::body::Body;
use crate::elements::kinematics::{Between, EdgeKinematics};
use crate::elements::relative::RelativeElement;
use crate::elements::{ConstraintElement, ForceElement};
use crate::model::{BodyIndex, Driver, Force, Frame, Joint};

/// What distinguishes planar from spatial Cartesian coordinates: N per body, D of them translations.
pub(super) trait Space<const D: usize, const N: usize, const W: usize>:
    Send + Sync + Sized + 'static
{
    type Constraint: ConstraintElement<N> + Send + Sync;
    type Force: ForceElement<D, N, W> + Send + Sync;
    type Relative: RelativeElement<N> + std::fmt::Debug + Clone + Send + Sync;
    type Kinematics: EdgeKinematics<N> + std::fmt::Debug + Clone + Send + Sync;
    type Passage: Passage<N, W>;
    /// Pose of the ground.
    const GROUND: [f64; N];
    /// Whether each body has a normalisation row.
    const NORMALIZED: bool;

    fn joint(joint: &Joint, centers: [[f64; 3]; 2]) -> Self::Constraint;
    fn driver(driver: &Driver, centers: [[f64; 3]; 2]) -> Self::Constraint;
    fn force(force: &Force, centers: [[f64; 3]; 2]) -> Self::Force;
    fn force_bodies(force: &Force) -> [BodyIndex; 2];
    /// The relative coordinates of a joint, a line, a bushing, a free body, and the angle about h.
    fn joint_form(joint: &Joint, centers: [[f64; 3]; 2]) -> FormOf<Self, D, N, W>;
    fn line_form(frames: &[Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, D, N, W>;
    fn bushing_form(frames: &[Frame; 2], centers: [[f64; 3]; 2]) -> FormOf<Self, D, N, W>;
    fn free_form() -> FormOf<Self, D, N, W>;
    fn relative_angle(frames: &[Frame; 2], centers: [[f64; 3]; 2]) -> Self::Relative;
    /// A body at a pose with its rates, as forces see it.
    fn moving(q: &[f64; N], v: &[f64; N]) -> Body<f64, D, N, W>;
    /// Rotational block of M, (N−D)×(N−D) row-major at the end of a body's coordinates.
    fn rotational_mass(inertia: &[[f64; 3]; 3], q: &[f64; N], out: &mut [f64]);
    /// Adds velocity-quadratic inertia terms to Q.
    fn gyroscopic_force(inertia: &[[f64; 3]; 3], q: &[f64; N], v: &[f64; N], out: &mut [f64]);
    /// Adds (M a)_q − (gyroscopic)_q to `k` and −(gyroscopic)_q̇ to `c`, both N×N row-major.
    fn inertia_blocks(
        inertia: &[[f64; 3]; 3],
        q: &[f64; N],
        v: &[f64; N],
        a: &[f64; N],
        k: &mut [f64],
        c: &mut [f64],
    );
    /// A lower bound of the inertia about any axis.
    fn least_inertia(inertia: &[[f64; 3]; 3]) -> f64;
    fn kinetic_rotation(inertia: &[[f64; 3]; 3], q: &[f64; N], v: &[f64; N]) -> f64;
    fn set_body(center: &[f64; 3], pose: &BodyPose, q: &mut [f64], v: &mut [f64]);
    fn body(center: &[f64; 3], q: &[f64; N], v: &[f64; N]) -> BodyPose;
    /// Velocity and angular velocity rates (ground axes) of the body origin for accelerations `a`.
    fn body_acceleration(
        center: &[f64; 3],
        q: &[f64; N],
        v: &[f64; N],
        a: &[f64; N],
    ) -> ([f64; 3], [f64; 3]);
    /// Force and torque (ground axes, about the centre of mass) equivalent to a generalized force.
    fn wrench(q: &[f64; N], generalized: &[f64; N]) -> ([f64; 3], [f64; 3]);
    /// A point of a body, relative to its centre of mass, turned into ground axes.
    fn rotate(q: &[f64; N], s: &[f64; 3]) -> [f64; 3];
    fn coordinate_names() -> [&'static str; N];
}

/// Kinematics of an edge with its coordinates.
pub(super) type FormOf<S, const D: usize, const N: usize, const W: usize> =
    (<S as Space<D, N, W>>::Kinematics, Vec<(<S as Space<D, N, W>>::Relative, Between)>);
