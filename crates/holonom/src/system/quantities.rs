//! Channels: named outputs with unit, frame and shape, computed from a state on demand.

use super::cartesian::Cartesian;
use super::space::Space;
use super::{EnergyBalance, Equations, State};
use crate::elements::ForceElement;
use crate::watch::{NAMED, checkpoint};
use std::cell::OnceCell;

/// A named output.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// `item.quantity`.
    pub name: String,
    /// SI unit; empty for pure numbers.
    pub unit: &'static str,
    /// Axes of the components: `ground`, `first`, `along`, or empty.
    pub frame: &'static str,
    /// Shape of one sample; empty for a scalar.
    pub shape: &'static [usize],
    /// Where it comes from.
    pub source: ChannelSource,
}

impl Channel {
    /// Number of components.
    pub fn size(&self) -> usize {
        self.shape.iter().product()
    }
}

/// A state that channels are computed at: what several of them share is computed once.
#[derive(Debug)]
pub struct Sample<'a> {
    state: &'a State,
    energy: OnceCell<EnergyBalance>,
    residuals: OnceCell<[f64; 3]>,
}

impl<'a> Sample<'a> {
    /// A state with accelerations and multipliers.
    pub fn new(state: &'a State) -> Self {
        Self { state, energy: OnceCell::new(), residuals: OnceCell::new() }
    }
}

/// Where a channel comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ChannelSource {
    /// A body's motion.
    Body(usize, BodyQuantity),
    /// A marker's motion: body, marker.
    Marker(usize, usize, BodyQuantity),
    /// Reaction force of a joint or driver on its second body.
    ReactionForce(usize),
    /// Reaction torque of a joint or driver on its second body, at the joint's point.
    ReactionTorque(usize),
    /// Relative coordinate of a joint.
    Joint(usize, usize),
    /// Quantity of a force element.
    Force(usize, usize),
    /// Energy term.
    Energy(EnergyQuantity),
    /// Largest constraint residual at position, velocity or acceleration level (0, 1, 2).
    Residual(usize),
}

/// Quantities of a body or marker.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BodyQuantity {
    /// Position of the body origin or marker.
    Position,
    /// Angle (planar) or Euler parameters (spatial).
    Orientation,
    /// Yaw, pitch, roll about z, y', x''.
    YawPitchRoll,
    /// Velocity.
    Velocity,
    /// Angular velocity.
    AngularVelocity,
    /// Acceleration.
    Acceleration,
    /// Angular acceleration.
    AngularAcceleration,
}

/// Energy terms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EnergyQuantity {
    /// Kinetic energy.
    Kinetic,
    /// Potential energy.
    Potential,
    /// Energy dissipated since the start.
    Dissipated,
    /// Work of drivers and applied forces since the start.
    DriverWork,
    /// Kinetic plus potential.
    Total,
    /// Total − total at the start + dissipated − driver work: zero for an exact solution.
    Imbalance,
}

/// Shape of samples of so many components, few as they are.
fn shape(components: usize) -> &'static [usize] {
    static SIZES: [usize; 8] = [0, 1, 2, 3, 4, 5, 6, 7];
    if components == 1 { &[] } else { &SIZES[components..=components] }
}

/// All channels of a system.
#[derive(Debug)]
pub(super) struct Channels {
    pub(super) all: Vec<Channel>,
    /// In the order of their names.
    by_name: Vec<u32>,
}

impl Channels {
    pub(super) fn of<S: Space<D, N>, const D: usize, const N: usize>(
        system: &Cartesian<S, D, N>,
    ) -> Self {
        let all = list(system);
        let mut by_name: Vec<u32> = (0..all.len() as u32).collect();
        by_name.sort_by_key(|&at| all[at as usize].name.as_str());
        Self { all, by_name }
    }

    pub(super) fn named(&self, name: &str) -> Option<&Channel> {
        let channel = |at: &u32| &self.all[*at as usize];
        let at = self.by_name.binary_search_by(|at| channel(at).name.as_str().cmp(name)).ok()?;
        Some(channel(&self.by_name[at]))
    }
}

fn list<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
) -> Vec<Channel> {
    let (vector, angular) = (shape(D), if D == 2 { shape(1) } else { shape(3) });
    let mut all = Vec::new();
    let mut add = |name: String, unit, frame, shape, source| {
        all.push(Channel { name, unit, frame, shape, source });
    };
    for (b, body) in system.bodies.iter().enumerate() {
        checkpoint(4 * NAMED);
        let mut motion = |quantity: &str, unit, frame, shape, kind| {
            let source = ChannelSource::Body(b, kind);
            add(format!("{}.{quantity}", body.name), unit, frame, shape, source);
        };
        motion("position", "m", "ground", vector, BodyQuantity::Position);
        if D == 2 {
            motion("angle", "rad", "ground", angular, BodyQuantity::Orientation);
        } else {
            motion("euler_parameters", "", "ground", shape(4), BodyQuantity::Orientation);
            motion("yaw_pitch_roll", "rad", "ground", vector, BodyQuantity::YawPitchRoll);
        }
        motion("velocity", "m/s", "ground", vector, BodyQuantity::Velocity);
        motion("angular_velocity", "rad/s", "ground", angular, BodyQuantity::AngularVelocity);
        motion("acceleration", "m/s^2", "ground", vector, BodyQuantity::Acceleration);
        let kind = BodyQuantity::AngularAcceleration;
        motion("angular_acceleration", "rad/s^2", "ground", angular, kind);
        for (k, (marker, _)) in body.markers.iter().enumerate() {
            for (quantity, unit, kind) in [
                ("position", "m", BodyQuantity::Position),
                ("velocity", "m/s", BodyQuantity::Velocity),
            ] {
                let name = format!("{}.{marker}.{quantity}", body.name);
                add(name, unit, "ground", vector, ChannelSource::Marker(b, k, kind));
            }
        }
    }
    for (k, c) in system.constraints.iter().enumerate() {
        checkpoint(NAMED);
        let force = ChannelSource::ReactionForce(k);
        add(format!("{}.force", c.name), "N", "ground", vector, force);
        let torque = ChannelSource::ReactionTorque(k);
        add(format!("{}.torque", c.name), "N m", "ground", angular, torque);
        for (i, quantity) in S::joint_quantities(&c.element).iter().enumerate() {
            let (size, source) = (shape(quantity.size), ChannelSource::Joint(k, i));
            let name = format!("{}.{}", c.name, quantity.name);
            add(name, quantity.unit, quantity.frame, size, source);
        }
    }
    for (k, f) in system.forces.iter().enumerate() {
        checkpoint(NAMED);
        for (i, quantity) in f.element.quantities().iter().enumerate() {
            let (size, source) = (shape(quantity.size), ChannelSource::Force(k, i));
            let name = format!("{}.{}", f.name, quantity.name);
            add(name, quantity.unit, quantity.frame, size, source);
        }
    }
    for (name, kind) in [
        ("kinetic", EnergyQuantity::Kinetic),
        ("potential", EnergyQuantity::Potential),
        ("dissipated", EnergyQuantity::Dissipated),
        ("driver_work", EnergyQuantity::DriverWork),
        ("total", EnergyQuantity::Total),
        ("imbalance", EnergyQuantity::Imbalance),
    ] {
        add(format!("energy.{name}"), "J", "", shape(1), ChannelSource::Energy(kind));
    }
    for (level, (name, unit)) in
        [("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s^2")].into_iter().enumerate()
    {
        add(format!("constraint.{name}"), unit, "", shape(1), ChannelSource::Residual(level));
    }
    all.shrink_to_fit();
    all
}

/// Value of one channel.
pub(super) fn evaluate_channel<S: Space<D, N>, const D: usize, const N: usize>(
    system: &Cartesian<S, D, N>,
    channel: &Channel,
    sample: &Sample<'_>,
    out: &mut [f64],
) {
    let state = sample.state;
    let pair = |bodies: [Option<usize>; 2]| {
        let q = bodies.map(|b| Cartesian::<S, D, N>::pose(&state.q, b));
        (q, bodies.map(|b| Cartesian::<S, D, N>::rate(&state.v, b)))
    };
    match channel.source {
        ChannelSource::Body(b, kind) => {
            motion(system, b, &system.bodies[b].center, kind, state, out);
        }
        ChannelSource::Marker(b, k, kind) => {
            let (center, point) = (&system.bodies[b].center, &system.bodies[b].markers[k].1);
            // A marker is an origin from which the centre of mass lies at center − point.
            let arm = std::array::from_fn(|i| center[i] - point[i]);
            motion(system, b, &arm, kind, state, out);
        }
        ChannelSource::ReactionForce(k) => {
            let (force, _) = Cartesian::<S, D, N>::reaction(&system.constraints[k], state);
            out.copy_from_slice(&force[..out.len()]);
        }
        ChannelSource::ReactionTorque(k) => {
            let (_, torque) = Cartesian::<S, D, N>::reaction(&system.constraints[k], state);
            copy_angular(&torque, out);
        }
        ChannelSource::Joint(k, i) => {
            let c = &system.constraints[k];
            let (q, v) = pair(c.bodies);
            let near = c.turns.as_ref().map_or(0.0, |turns| turns.near(state.t, &state.winding));
            S::joint_quantity(&c.element, i, q, v, near, out);
        }
        ChannelSource::Force(k, i) => {
            let f = &system.forces[k];
            f.element.quantity(i, &Cartesian::<S, D, N>::input(f, state), out);
        }
        ChannelSource::Energy(kind) => {
            let balance = || sample.energy.get_or_init(|| system.energy(state));
            let total = || balance().kinetic + balance().potential;
            let ledger = &state.ledger;
            out[0] = match kind {
                EnergyQuantity::Kinetic => balance().kinetic,
                EnergyQuantity::Potential => balance().potential,
                EnergyQuantity::Dissipated => ledger.dissipated,
                EnergyQuantity::DriverWork => ledger.supplied,
                EnergyQuantity::Total => total(),
                EnergyQuantity::Imbalance => {
                    total() - ledger.initial + ledger.dissipated - ledger.supplied
                }
            };
        }
        ChannelSource::Residual(level) => {
            out[0] = sample.residuals.get_or_init(|| system.largest_residuals(state))[level];
        }
    }
}

/// Planar angular quantities are scalars about z.
fn copy_angular(vector: &[f64; 3], out: &mut [f64]) {
    if out.len() == 1 {
        out[0] = vector[2];
    } else {
        out.copy_from_slice(vector);
    }
}

fn motion<S: Space<D, N>, const D: usize, const N: usize>(
    _: &Cartesian<S, D, N>,
    body: usize,
    center: &[f64; 3],
    kind: BodyQuantity,
    state: &State,
    out: &mut [f64],
) {
    let q = Cartesian::<S, D, N>::pose(&state.q, Some(body));
    let v = Cartesian::<S, D, N>::rate(&state.v, Some(body));
    let pose = S::body(center, q, v);
    match kind {
        BodyQuantity::Position => out.copy_from_slice(&pose.position[..D]),
        BodyQuantity::Orientation => {
            let count = out.len();
            out.copy_from_slice(&pose.orientation[..count]);
        }
        BodyQuantity::YawPitchRoll => out.copy_from_slice(&yaw_pitch_roll(pose.orientation)),
        BodyQuantity::Velocity => out.copy_from_slice(&pose.velocity[..D]),
        BodyQuantity::AngularVelocity => copy_angular(&pose.angular_velocity, out),
        BodyQuantity::Acceleration | BodyQuantity::AngularAcceleration => {
            let a = Cartesian::<S, D, N>::rate(&state.a, Some(body));
            let (linear, angular) = S::body_acceleration(center, q, v, a);
            if kind == BodyQuantity::Acceleration {
                out.copy_from_slice(&linear[..D]);
            } else {
                copy_angular(&angular, out);
            }
        }
    }
}

/// Angles about z, y', x'' of unit Euler parameters, rad; pitch is positive nose down for x forward.
fn yaw_pitch_roll([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (x * y + w * z)).atan2(w * w + x * x - y * y - z * z),
        (2.0 * (w * y - x * z)).clamp(-1.0, 1.0).asin(),
        (2.0 * (y * z + w * x)).atan2(w * w - x * x - y * y + z * z),
    ]
}
