//! Channels: named outputs with unit, frame and shape, computed from a state on demand.

use super::cartesian::Cartesian;
use super::space::Space;
use super::{EnergyBalance, Equations, State};
use crate::elements::{ConstraintElement, ForceElement};
use std::cell::OnceCell;
use std::sync::OnceLock;

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

/// What channels belong to.
#[derive(Debug, Clone, Copy)]
pub(super) enum Item {
    Body(u32),
    Constraint(u32),
    Force(u32),
}

/// Channels of a system, as far as they have been asked for.
#[derive(Debug, Default)]
pub(super) struct Channels {
    all: OnceLock<Vec<Channel>>,
    /// In the order of their names.
    items: OnceLock<Vec<Item>>,
}

impl Channels {
    /// All of them: a dozen to a body.
    pub(super) fn all<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
        &self,
        system: &Cartesian<S, D, N, W>,
    ) -> &[Channel] {
        self.all.get_or_init(|| {
            let mut all = Vec::new();
            for item in items(system) {
                add_channels(system, item, &mut all);
            }
            all.extend(diagnostics());
            all.shrink_to_fit();
            all
        })
    }

    /// One of them.
    pub(super) fn named<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
        &self,
        system: &Cartesian<S, D, N, W>,
        name: &str,
    ) -> Option<Channel> {
        let items = self.items.get_or_init(|| {
            let mut items: Vec<Item> = items(system).collect();
            items.sort_by_key(|&item| name_of(system, item));
            items
        });
        let (wanted, _) = name.split_once('.')?;
        let mut own = Vec::new();
        match items.binary_search_by(|&item| name_of(system, item).cmp(wanted)) {
            Ok(at) => add_channels(system, items[at], &mut own),
            Err(_) => own = diagnostics(),
        }
        own.into_iter().find(|channel| channel.name == name)
    }
}

fn items<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    system: &Cartesian<S, D, N, W>,
) -> impl Iterator<Item = Item> {
    let numbers = |n: usize| 0..n as u32;
    let bodies = numbers(system.bodies.len()).map(Item::Body);
    let constraints = numbers(system.constraints.len()).map(Item::Constraint);
    bodies.chain(constraints).chain(numbers(system.forces.len()).map(Item::Force))
}

fn name_of<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    system: &Cartesian<S, D, N, W>,
    item: Item,
) -> &str {
    match item {
        Item::Body(b) => &system.bodies[b as usize].name,
        Item::Constraint(k) => &system.constraints[k as usize].name,
        Item::Force(k) => &system.forces[k as usize].name,
    }
}

/// Channels of an item.
fn add_channels<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    system: &Cartesian<S, D, N, W>,
    item: Item,
    out: &mut Vec<Channel>,
) {
    let (vector, angular) = (shape(D), if D == 2 { shape(1) } else { shape(3) });
    let own = name_of(system, item);
    let mut add = |quantity: &str, unit, frame, shape, source| {
        out.push(Channel { name: format!("{own}.{quantity}"), unit, frame, shape, source });
    };
    match item {
        Item::Body(b) => {
            let b = b as usize;
            let mut motion = |quantity: &str, unit, shape, kind| {
                add(quantity, unit, "ground", shape, ChannelSource::Body(b, kind));
            };
            motion("position", "m", vector, BodyQuantity::Position);
            if D == 2 {
                motion("angle", "rad", angular, BodyQuantity::Orientation);
            } else {
                motion("euler_parameters", "", shape(4), BodyQuantity::Orientation);
                motion("yaw_pitch_roll", "rad", vector, BodyQuantity::YawPitchRoll);
            }
            motion("velocity", "m/s", vector, BodyQuantity::Velocity);
            motion("angular_velocity", "rad/s", angular, BodyQuantity::AngularVelocity);
            motion("acceleration", "m/s^2", vector, BodyQuantity::Acceleration);
            motion("angular_acceleration", "rad/s^2", angular, BodyQuantity::AngularAcceleration);
            for (k, (marker, _)) in system.bodies[b].markers.iter().enumerate() {
                for (quantity, unit, kind) in [
                    ("position", "m", BodyQuantity::Position),
                    ("velocity", "m/s", BodyQuantity::Velocity),
                ] {
                    let source = ChannelSource::Marker(b, k, kind);
                    add(&format!("{marker}.{quantity}"), unit, "ground", vector, source);
                }
            }
        }
        Item::Constraint(k) => {
            let k = k as usize;
            add("force", "N", "ground", vector, ChannelSource::ReactionForce(k));
            add("torque", "N m", "ground", angular, ChannelSource::ReactionTorque(k));
            let quantities = system.constraints[k].element.quantities();
            for (i, quantity) in quantities.iter().enumerate() {
                let (size, source) = (shape(quantity.size), ChannelSource::Joint(k, i));
                add(quantity.name, quantity.unit, quantity.frame, size, source);
            }
        }
        Item::Force(k) => {
            let k = k as usize;
            for (i, quantity) in system.forces[k].element.quantities().iter().enumerate() {
                let (size, source) = (shape(quantity.size), ChannelSource::Force(k, i));
                add(quantity.name, quantity.unit, quantity.frame, size, source);
            }
        }
    }
}

/// Channels that every run stores: the energy ledger and residuals.
pub fn diagnostics() -> Vec<Channel> {
    let scalar = |name: String, unit, source| {
        let (frame, shape) = ("", shape(1));
        Channel { name, unit, frame, shape, source }
    };
    let energy = [
        ("kinetic", EnergyQuantity::Kinetic),
        ("potential", EnergyQuantity::Potential),
        ("dissipated", EnergyQuantity::Dissipated),
        ("driver_work", EnergyQuantity::DriverWork),
        ("total", EnergyQuantity::Total),
        ("imbalance", EnergyQuantity::Imbalance),
    ];
    let energy = energy
        .map(|(name, kind)| scalar(format!("energy.{name}"), "J", ChannelSource::Energy(kind)));
    let levels = [("position", "m"), ("velocity", "m/s"), ("acceleration", "m/s^2")];
    let residuals = levels.into_iter().enumerate().map(|(level, (name, unit))| {
        scalar(format!("constraint.{name}"), unit, ChannelSource::Residual(level))
    });
    energy.into_iter().chain(residuals).collect()
}

/// Value of one channel.
pub(super) fn evaluate_channel<
    S: Space<D, N, W>,
    const D: usize,
    const N: usize,
    const W: usize,
>(
    system: &Cartesian<S, D, N, W>,
    channel: &Channel,
    sample: &Sample<'_>,
    out: &mut [f64],
) {
    let state = sample.state;
    let pair = |bodies: [Option<usize>; 2]| {
        let q = bodies.map(|b| Cartesian::<S, D, N, W>::pose(&state.q, b));
        (q, bodies.map(|b| Cartesian::<S, D, N, W>::rate(&state.v, b)))
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
            let (force, _) = Cartesian::<S, D, N, W>::reaction(&system.constraints[k], state);
            out.copy_from_slice(&force[..out.len()]);
        }
        ChannelSource::ReactionTorque(k) => {
            let (_, torque) = Cartesian::<S, D, N, W>::reaction(&system.constraints[k], state);
            copy_angular(&torque, out);
        }
        ChannelSource::Joint(k, i) => {
            let c = &system.constraints[k];
            let (q, v) = pair(c.bodies);
            let near = c.turns.as_ref().map_or(0.0, |turns| turns.near(state.t, &state.winding));
            c.element.quantity(i, q, v, near, out);
        }
        ChannelSource::Force(k, i) => {
            let f = &system.forces[k];
            f.element.quantity(i, &Cartesian::<S, D, N, W>::input(f, state), out);
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
                EnergyQuantity::Imbalance => ledger.imbalance(balance()),
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

fn motion<S: Space<D, N, W>, const D: usize, const N: usize, const W: usize>(
    _: &Cartesian<S, D, N, W>,
    body: usize,
    center: &[f64; 3],
    kind: BodyQuantity,
    state: &State,
    out: &mut [f64],
) {
    let q = Cartesian::<S, D, N, W>::pose(&state.q, Some(body));
    let v = Cartesian::<S, D, N, W>::rate(&state.v, Some(body));
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
            let a = Cartesian::<S, D, N, W>::rate(&state.a, Some(body));
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
