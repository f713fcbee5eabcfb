//! What an imbalance of the energy ledger is measured against.

use crate::model::{Model, Tolerance};
use crate::system::{EnergyBalance, State, System};
use crate::topology::Shape;
use serde::{Deserialize, Serialize};

/// Part of the energies summed up that is round-off of their sum.
const ROUND_OFF: f64 = 1e-12;
/// Absolute tolerances that a run may be off without a word.
const ALLOWED: f64 = 10.0;

/// The energy that moves in a run: the largest kinetic energy, dissipation, supply and range of the
/// potential.
///
/// A group of bodies that no joint ties to the ground may travel. Its kinetic energy counts in the
/// frame that moves with the velocity of its centre of mass at the start, so that an imbalance weighs
/// the same in a vehicle that stands and in one that drives. The ledger itself knows no such frame.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct EnergyScale {
    travelling: Vec<Travelling>,
    kinetic: f64,
    potential: Option<(f64, f64)>,
    dissipated: f64,
    supplied: f64,
    /// Largest sum of all terms by their size, J.
    sum: f64,
    /// The largest kinetic energy against the ground, what has been supplied last, and all that went to and fro, J.
    #[serde(default)]
    against_ground: f64,
    #[serde(default)]
    last_supplied: f64,
    #[serde(default)]
    exchanged: f64,
}

/// A group of bodies that no joint ties to the ground.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Travelling {
    /// First coordinate and mass (kg) of each body.
    bodies: Vec<(usize, f64)>,
    mass: f64,
    /// Of the centre of mass at the start, m/s.
    velocity: [f64; 3],
}

impl Travelling {
    /// Momentum, kg m/s: the first coordinates of a body are those of its centre of mass.
    fn momentum(&self, state: &State, translations: usize) -> [f64; 3] {
        let mut sum = [0.0; 3];
        for (first, mass) in &self.bodies {
            for (sum, v) in sum.iter_mut().zip(&state.v[*first..first + translations]) {
                *sum += mass * v;
            }
        }
        sum
    }

    /// Kinetic energy against the ground minus that in the moving frame, V·P − ½ m V², J.
    fn excess(&self, state: &State, translations: usize) -> f64 {
        let momentum = self.momentum(state, translations);
        let along: f64 = momentum.iter().zip(&self.velocity).map(|(p, v)| p * v).sum();
        let square: f64 = self.velocity.iter().map(|v| v * v).sum();
        along - 0.5 * self.mass * square
    }
}

impl EnergyScale {
    /// The scale of a run that starts at `start`.
    pub(super) fn new(model: &Model, system: &dyn System, start: &State) -> Self {
        let sizes = system.structure().sizes;
        let ends: Vec<_> = model.joints.iter().map(|j| j.frames.map(|f| f.body)).collect();
        let mut travelling = Vec::new();
        for group in Shape::new(sizes.bodies, &ends).floating {
            let own = |&b: &usize| (sizes.of_body(b).start, model.bodies[b].mass);
            let bodies: Vec<(usize, f64)> = group.iter().map(own).collect();
            let mass = bodies.iter().map(|(_, mass)| mass).sum();
            let mut group = Travelling { bodies, mass, velocity: [0.0; 3] };
            if mass > 0.0 {
                group.velocity = group.momentum(start, sizes.translations).map(|p| p / mass);
                travelling.push(group);
            }
        }
        let mut scale = Self { travelling, ..Self::default() };
        scale.take(system, start, &system.energy(start));
        scale
    }

    /// Whether another one is of the same bodies.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        let bodies =
            |scale: &Self| scale.travelling.iter().map(|t| t.bodies.clone()).collect::<Vec<_>>();
        bodies(self) == bodies(other)
    }

    /// Takes an accepted state with its energy.
    pub(super) fn take(&mut self, system: &dyn System, state: &State, energy: &EnergyBalance) {
        let translations = system.structure().sizes.translations;
        let excess: f64 = self.travelling.iter().map(|t| t.excess(state, translations)).sum();
        self.kinetic = self.kinetic.max(energy.kinetic - excess);
        self.against_ground = self.against_ground.max(energy.kinetic);
        let (low, high) = self.potential.unwrap_or((energy.potential, energy.potential));
        self.potential = Some((low.min(energy.potential), high.max(energy.potential)));
        let ledger = &state.ledger;
        self.dissipated = self.dissipated.max(ledger.dissipated.abs());
        self.supplied = self.supplied.max(ledger.supplied.abs());
        self.exchanged += (ledger.supplied - self.last_supplied).abs();
        self.last_supplied = ledger.supplied;
        let terms =
            [energy.kinetic, energy.potential, ledger.initial, ledger.dissipated, ledger.supplied];
        self.sum = self.sum.max(terms.iter().map(|term| term.abs()).sum());
    }

    /// The part of the velocities that an imbalance tells of: an energy E that is off by δE comes with velocities
    /// off by δE / 2E.
    pub(super) fn part_of_velocities(&self, imbalance: f64) -> f64 {
        let moved = self.moved();
        let tells = moved > 0.0 && imbalance.abs() > ROUND_OFF * self.sum;
        if tells { imbalance / (2.0 * moved) } else { 0.0 }
    }

    /// The energy that has moved, J.
    pub(super) fn moved(&self) -> f64 {
        let (low, high) = self.potential.unwrap_or_default();
        // Kinetic energy is not negative: its range is no larger than its largest value.
        self.kinetic.max(high - low).max(self.dissipated).max(self.supplied)
    }

    /// All energy that has been there, J: the kinetic one against the ground, the range of the potential, what was dissipated, and what
    /// was supplied to and fro.
    pub(super) fn all(&self) -> f64 {
        let (low, high) = self.potential.unwrap_or_default();
        self.against_ground.max(self.kinetic) + (high - low) + self.dissipated + self.exchanged
    }

    /// An imbalance that says nothing, J: what the sum of the terms cannot tell from none, and what
    /// bodies at rest have when they are [`ALLOWED`] absolute tolerances off in place and velocity.
    pub(super) fn negligible(&self, system: &dyn System, tolerance: &Tolerance) -> f64 {
        let off = ALLOWED * tolerance.translation;
        let per_mass = system.gravity() * off + 0.5 * off * off;
        let mass: f64 = (0..system.structure().sizes.bodies).map(|b| system.mass(b)).sum();
        (ROUND_OFF * self.sum).max(mass * per_mass)
    }
}
