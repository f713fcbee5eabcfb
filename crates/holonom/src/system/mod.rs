//! The equations of motion in one choice of generalized coordinates.
//!
//! A [`System`] answers what every method asks, in the symbols of `docs/theory/system.md` (1)-(12):
//! Φ, G, ν, τ, M, Q and the derivative blocks of F = M q̈ + Gᵀλ − Q. It never changes while it
//! runs; all buffers belong to the caller.

mod bushing_axes;
mod cartesian;
mod cartesian_bodies;
mod cartesian_derivatives;
mod cartesian_directory;
mod cartesian_planar;
mod cartesian_spatial;
mod compile;
mod forest;
mod passage;
mod placed;
mod quantities;
mod space;
mod structure;
mod turns;

pub use compile::{compile, compile_along};
pub use forest::{Closure, EdgeSource, ElasticLoop, RelativeGroup, Resistance, Tree, TreeEdge};
pub use quantities::{BodyQuantity, Channel, ChannelSource, EnergyQuantity, Sample, diagnostics};
pub use structure::{
    DerivativeBlocks, ExtraBlock, ExtraSquares, JointRows, Sizes, Structure, WrenchBlocks,
};

pub(crate) use turns::driver_of_angle;

use crate::model::Model;

pub use crate::elements::kinematics::{Anchor, EdgeScrews};
pub use crate::elements::motion::{Motion, MotionRows, Stance, Wrench};
pub use crate::elements::relative::{Reference, RelativeKind};
pub use crate::elements::row::RowKind;
pub use crate::elements::{ExtraStateScale, LawPlace};
use holonom_linalg::BlockMatrix;
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// A state of a system: everything that a run needs to go on from here.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub struct State {
    /// Time, s.
    pub t: f64,
    /// Generalized coordinates.
    pub q: Vec<f64>,
    /// Generalized velocities.
    pub v: Vec<f64>,
    /// Generalized accelerations.
    pub a: Vec<f64>,
    /// Multipliers, one per constraint row (0 for redundant rows).
    pub lambda: Vec<f64>,
    /// Extra states of elements, m or rad.
    pub z: Vec<f64>,
    /// Angles of forces and joints that count turns, at the last accepted step, rad.
    pub winding: Vec<f64>,
    /// Energy bookkeeping since the start of the run.
    pub ledger: Ledger,
}

/// Energy bookkeeping of a run, J.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Ledger {
    /// Kinetic plus potential energy at the start.
    pub initial: f64,
    /// Energy dissipated since the start.
    pub dissipated: f64,
    /// Work of drivers and applied forces since the start.
    pub supplied: f64,
}

impl Ledger {
    /// Total − initial + dissipated − supplied, J: zero for an exact solution.
    pub fn imbalance(&self, energy: &EnergyBalance) -> f64 {
        energy.kinetic + energy.potential - self.initial + self.dissipated - self.supplied
    }
}

impl State {
    /// A state of zeros for a system of the given sizes.
    pub fn zeros(sizes: &Sizes) -> Self {
        Self {
            t: 0.0,
            q: vec![0.0; sizes.coordinates],
            v: vec![0.0; sizes.coordinates],
            a: vec![0.0; sizes.coordinates],
            lambda: vec![0.0; sizes.rows],
            z: vec![0.0; sizes.extra_states],
            winding: vec![0.0; sizes.windings],
            ledger: Ledger::default(),
        }
    }

    /// Number of numbers: time, coordinates with rates, multipliers, extra states, windings, ledger.
    pub(crate) fn width(&self) -> usize {
        let parts = [&self.q, &self.v, &self.a, &self.lambda, &self.z, &self.winding];
        4 + parts.into_iter().map(Vec::len).sum::<usize>()
    }

    /// Copies another state of the same sizes without allocating.
    pub fn copy_from(&mut self, other: &Self) {
        self.t = other.t;
        self.q.copy_from_slice(&other.q);
        self.v.copy_from_slice(&other.v);
        self.a.copy_from_slice(&other.a);
        self.lambda.copy_from_slice(&other.lambda);
        self.z.copy_from_slice(&other.z);
        self.winding.copy_from_slice(&other.winding);
        self.ledger = other.ledger;
    }
}

/// Mechanical energy and the powers that change it.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct EnergyBalance {
    /// Kinetic energy, J.
    pub kinetic: f64,
    /// Potential energy of gravity and elastic elements, J.
    pub potential: f64,
    /// Power dissipated by forces, W.
    pub dissipated: f64,
    /// Power supplied by drivers and applied forces, W.
    pub supplied: f64,
}

/// A scalar along which a force law has local features: deformation of a law through a table, deflection of a
/// tyre, its way along a road with an obstacle, velocities of its slip.
#[derive(Debug, Clone, PartialEq)]
pub struct LawArgument {
    /// Place of the force among those of the system.
    pub(crate) force: usize,
    /// Place among the arguments of that force.
    pub(crate) index: usize,
    /// What it measures.
    pub measure: Measure,
    /// Whether it is a velocity.
    pub is_velocity: bool,
    /// Values between which the law is smooth, increasing; none for a line that has a cusp only.
    pub knots: Vec<f64>,
}

/// What a coordinate or row measures, which decides its scale.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Measure {
    /// Metres.
    Length,
    /// Radians or direction cosines.
    Angle,
}

/// The equations of motion in one choice of coordinates: n coordinates, m constraint rows (redundant ones
/// included). Blocks and right-hand sides are overwritten. Arrays have the lengths of [`Sizes`].
pub trait Equations: std::fmt::Debug + Send + Sync {
    /// Sizes and patterns.
    fn structure(&self) -> &Structure;

    /// Length that makes translations comparable with rotations, m.
    fn characteristic_length(&self) -> f64;

    /// Φ(q, t). Angle rows of drivers are wrapped to (−π, π].
    fn position_constraints(&self, t: f64, q: &[f64], phi: &mut [f64]);

    /// G q̇ − ν.
    fn velocity_constraints(&self, t: f64, q: &[f64], v: &[f64], phi_rate: &mut [f64]);

    /// G = Φ_q.
    fn constraint_jacobian(&self, q: &[f64], g: &mut BlockMatrix);

    /// ν with G q̇ = ν.
    fn velocity_rhs(&self, t: f64, nu: &mut [f64]);

    /// τ with G q̈ = τ.
    fn acceleration_rhs(&self, t: f64, q: &[f64], v: &[f64], tau: &mut [f64]);

    /// M(q).
    fn mass_matrix(&self, q: &[f64], m: &mut BlockMatrix);

    /// Q(t, q, q̇, z) with velocity-quadratic terms, and ż.
    fn forces(&self, state: &State, force: &mut [f64], z_rate: &mut [f64]);

    /// Wrenches of gravity and forces on the bodies, per body force (N) and moment about its centre of mass (N m), ground
    /// axes, in the plane three numbers; and ż. Inertia has no part in them.
    fn wrenches(&self, state: &State, wrenches: &mut [f64], z_rate: &mut [f64]);

    /// Shows the derivatives of each force on the motions of its bodies, by its place in [`Structure::forces`]; what extra states
    /// do on motions, among themselves and with time goes into `extra`.
    fn wrench_blocks(
        &self,
        state: &State,
        extra: &mut DerivativeBlocks,
        look: &mut dyn FnMut(usize, &WrenchBlocks<'_>),
    );

    /// All derivative blocks at `state`, whose accelerations and multipliers must be current.
    fn derivative_blocks(&self, state: &State, out: &mut DerivativeBlocks);

    /// A₀ δq = ((G q̇)_q δq).
    fn rate_change(&self, q: &[f64], v: &[f64], dq: &[f64], out: &mut [f64]);

    /// Energies and powers; driver power uses the multipliers of `state`.
    fn energy(&self, state: &State) -> EnergyBalance;

    /// Whether there are drivers, whose power takes multipliers.
    fn has_drivers(&self) -> bool;

    /// Whether one of them is to move at any time.
    fn has_moving_drivers(&self) -> bool;

    /// Whether one of them moves at a time: only then has its multiplier a power.
    fn drivers_move(&self, t: f64) -> bool;

    /// s(t) of the driver with this row, m or rad.
    fn prescribed(&self, row: usize, t: f64) -> f64 {
        self.drive(row, t)[0]
    }

    /// s, ṡ, s̈ and s⃛ of the driver with this row; zeros for a joint's.
    fn drive(&self, row: usize, t: f64) -> [f64; 4];

    /// s, ṡ, s̈ and s⃛ of a driver by its place in [`Structure::joints`]; none for a joint.
    fn joint_drive(&self, joint: usize, t: f64) -> Option<[f64; 4]>;

    /// Φ of one joint or driver, by its place in [`Structure::joints`].
    fn joint_value(&self, joint: usize, t: f64, q: &[f64], phi: &mut [f64; 6]);

    /// G of one joint or driver: row by row over the coordinates of its first and its second body.
    fn joint_gradient(&self, joint: usize, q: &[f64], out: &mut [f64]);

    /// (G q̇)_q q̇ of one joint or driver.
    fn joint_curvature(&self, joint: usize, q: &[f64], v: &[f64], out: &mut [f64; 6]);

    /// Rows of one joint or driver, without what a driver prescribes, from how its bodies stand and move, where these
    /// tell them.
    fn joint_on_motions(&self, joint: usize) -> Option<&dyn MotionRows>;

    /// (G q̇)_q of one joint or driver, and (G q̈ + (G q̇)_q q̇)_q, in the layout of the gradient.
    fn joint_blocks(&self, joint: usize, state: &State, a0: &mut [f64], a1: &mut [f64]);

    /// (Gᵀλ)_q of one joint or driver between the coordinates of its bodies, `[side][side][row][column]`.
    fn joint_hessian(&self, joint: usize, state: &State, out: &mut [f64]);

    /// Size of the acceleration of gravity, m/s².
    fn gravity(&self) -> f64;

    /// Current angle of each joint and force that counts turns, into `winding`, whose old content is
    /// the branch to stay near; the angle of a driver follows its motion.
    fn update_windings(&self, t: f64, q: &[f64], winding: &mut [f64]);

    /// The winding that counts the turns of a joint's angle, by the place of the joint in the model.
    fn winding_of_joint(&self, joint: usize) -> Option<usize>;

    /// The first force whose law turned over between two configurations: a bushing, twisted through half a turn.
    fn turned_over(&self, from: &[f64], to: &[f64]) -> Option<usize>;

    /// For each extra state the error that counts like a metre or a metre per second, or like a radian or one per second.
    fn extra_state_scales(&self) -> Vec<ExtraStateScale>;

    /// Times at which forces or drivers have a kink, sorted, s.
    fn breakpoints(&self) -> Vec<f64>;

    /// Longest step from a state that does not jump over a local feature of a force that lies ahead, such as a bump of
    /// the road under a smooth ride, s.
    fn longest_step(&self, state: &State) -> f64;

    /// Scalars along which forces have local features, such as a stop or a bump of the road.
    fn law_arguments(&self) -> &[LawArgument];

    /// Where one of them stands at a state.
    fn law_place(&self, argument: &LawArgument, state: &State) -> LawPlace;

    /// Where all of them stand.
    fn law_places(&self, state: &State, out: &mut Vec<LawPlace>);

    /// What the law makes of a value of the scalar, in whatever unit.
    fn law_profile(&self, argument: &LawArgument, value: f64) -> f64;
}

/// The bodies behind the coordinates: their motion, inertia, and relative coordinates along the spanning forest.
pub trait Bodies {
    /// State in the coordinates of this system of the model's stated poses and rates:
    /// the body's origin position, orientation, velocity, angular velocity in ground axes.
    fn set_body(&self, body: usize, pose: &BodyPose, q: &mut [f64], v: &mut [f64]);

    /// The inverse of [`Bodies::set_body`].
    fn body(&self, body: usize, q: &[f64], v: &[f64]) -> BodyPose;

    /// Mass of a body, kg.
    fn mass(&self, body: usize) -> f64;

    /// Inertia tensor of a body about its centre of mass, body axes, kg m²; planar: `[2][2]` only.
    fn inertia(&self, body: usize) -> [[f64; 3]; 3];

    /// A lower bound of the inertia of a body about any axis through its centre of mass, kg m².
    fn least_inertia(&self, body: usize) -> f64;

    /// The spanning forest with the relative coordinates of its edges.
    fn tree(&self) -> &Tree;

    /// Groups of relative coordinates: those of the edges and deformations of force elements.
    fn relative_groups(&self) -> &[RelativeGroup];

    /// Values of the coordinates of a group, m or rad; angles on the branch of the reference.
    fn relative_value(&self, group: usize, reference: &Reference, q: &[f64], out: &mut [f64]);

    /// Their gradients, row by row over the coordinates of the first and the second body (2·per_body).
    fn relative_gradient(&self, group: usize, reference: &Reference, q: &[f64], out: &mut [f64]);

    /// (s_q q̇)_q q̇: what s̈ has beside s_q q̈, m/s² or rad/s².
    fn relative_curvature(
        &self,
        group: usize,
        reference: &Reference,
        q: &[f64],
        v: &[f64],
        out: &mut [f64],
    );

    /// (s_q q̇)_q, in the layout of the gradient.
    fn relative_rate_gradient(
        &self,
        group: usize,
        reference: &Reference,
        q: &[f64],
        v: &[f64],
        out: &mut [f64],
    );

    /// Coordinates of a group from how its bodies stand and move, where these tell them.
    fn relative_on_motions(&self, group: usize) -> Option<&dyn MotionRows>;

    /// (s_q q̇)_q and (s̈)_q at fixed q̈, in the layout of the gradient.
    fn relative_blocks(
        &self,
        group: usize,
        reference: &Reference,
        state: &State,
        a0: &mut [f64],
        a1: &mut [f64],
    );

    /// The reference of a group that suits a configuration.
    fn moved_reference(&self, group: usize, q: &[f64], old: &Reference) -> Reference;

    /// Orientation of an [`Anchor`] of an edge at a configuration.
    fn anchor_orientation(&self, edge: usize, form: usize, q: &[f64]) -> [f64; 4];

    /// Writes the pose of the outer body of an edge: from that of the inner one, the coordinates `x` and, for a line,
    /// the reference of its direction among those of all groups. Where `stances` tell how bodies stand, that of the outer
    /// body is written, too.
    fn place(
        &self,
        edge: usize,
        form: usize,
        x: &[f64],
        references: &[Reference],
        anchor: &Anchor,
        q: &mut [f64],
        stances: Option<&mut [Stance]>,
    );

    /// How the outer body of an edge moves against the inner one, for how bodies stand; `false` for the
    /// direction of a line. Columns beyond their number stay what they were, and so do the bodies.
    fn edge_screws(
        &self,
        edge: usize,
        form: usize,
        stances: &[Stance],
        out: &mut EdgeScrews,
    ) -> bool;

    /// The same at a configuration, with the bodies.
    fn edge_screws_at(&self, edge: usize, form: usize, q: &[f64], out: &mut EdgeScrews) -> bool;

    /// What an elastic loop of the tree sets against its deformation `row` at a value that changes at a rate, 1/s: dampers
    /// count by it.
    fn resistance(&self, elastic: usize, row: usize, value: f64, rate: f64) -> Resistance;
}

/// Names of coordinates, rows and elements, and the channels that can be computed from a state.
pub trait Directory {
    /// Channels that can be computed from a state: a list that is long and made when it is first asked for.
    fn channels(&self) -> &[Channel];

    /// One of them by name, without that list.
    fn channel_named(&self, name: &str) -> Option<Channel>;

    /// Value of a channel at a state; `out` has the channel's size.
    fn channel(&self, channel: &Channel, sample: &Sample<'_>, out: &mut [f64]);

    /// The mobile parts of a body's coordinates for messages: `name.x`, `name.e2`, …
    fn coordinate_name(&self, coordinate: usize) -> String;

    /// Name of the body that a coordinate belongs to.
    fn coordinate_item(&self, coordinate: usize) -> &str;

    /// Names of the forces on the body of a coordinate, the stiffest at `state` first; for messages.
    fn forces_on(&self, coordinate: usize, state: &State) -> Vec<&str>;

    /// Names of the drivers and forces with a kink at a time (s), to round-off; for messages.
    fn kinks_at(&self, t: f64) -> Vec<&str>;

    /// The joint or driver and row, for messages: `joint `guide`, rotation about z`.
    fn row_name(&self, row: usize) -> String;

    /// Name of the joint, driver or body that a row belongs to, and what the row prescribes.
    fn row_item(&self, row: usize) -> (&str, RowKind);
}

/// What a method may ask of a system.
pub trait System: Equations + Bodies + Directory {
    /// A system for a model that differs in numbers only, sharing patterns; `None` if it differs in
    /// more.
    fn with_values(&self, model: &Model) -> Option<Arc<dyn System>>;
}

/// Position and motion of a body frame in ground axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyPose {
    /// Body origin, m.
    pub position: [f64; 3],
    /// Euler parameters (spatial) or angle in the first entry (planar, rad).
    pub orientation: [f64; 4],
    /// Velocity of the body origin, m/s.
    pub velocity: [f64; 3],
    /// Angular velocity, rad/s.
    pub angular_velocity: [f64; 3],
}
