//! How far what turns is behind, as the energy that is missing tells. Equations: `docs/theory/simulation.md` (4a), (4b).

use crate::model::Tolerance;
use crate::system::{State, System};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Part of its largest speed from which a point has a direction.
const SLOW: f64 = 1e-3;

/// Bodies and their paths along a run.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Drift {
    bodies: Vec<Turning>,
    largest: f64,
}

impl Drift {
    /// Of so many bodies.
    pub(super) fn new(bodies: usize) -> Self {
        Self { bodies: vec![Turning::default(); bodies], largest: 0.0 }
    }

    /// Whether another one is of as many bodies.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        self.bodies.len() == other.bodies.len()
    }

    /// Takes a step of length `h` that ends at `state`, whose velocities are off by `part`. What turns with ω is behind
    /// by ∫ ω part dt: far more than its velocity when it turns many times. What swings to and fro cancels out.
    pub(super) fn follow(
        &mut self,
        system: &dyn System,
        state: &State,
        h: f64,
        part: f64,
        tolerance: &Tolerance,
    ) {
        let allowed = tolerance.rotation + tolerance.relative * PI;
        for (body, turning) in self.bodies.iter_mut().enumerate() {
            let pose = system.body(body, &state.q, &state.v);
            let behind = turning.rotation.add(pose.angular_velocity.map(|w| w * h), part);
            let along = turning.follow_path(pose.velocity, h, part, tolerance);
            self.largest = self.largest.max(behind / allowed).max(along);
        }
    }

    /// The largest error of an angle or of a place on a path, in its tolerances.
    pub(super) fn largest(&self) -> f64 {
        self.largest
    }
}

/// An angle about an axis that moves little, rad, and what of it missing energy makes.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Angle {
    turned: [f64; 3],
    behind: [f64; 3],
}

impl Angle {
    /// Adds a small turn of which a part is missing; returns how far the angle is behind, rad. In less than a
    /// turn nothing adds up.
    fn add(&mut self, turn: [f64; 3], part: f64) -> f64 {
        for k in 0..3 {
            self.turned[k] += turn[k];
            self.behind[k] += part * turn[k];
        }
        if length(self.turned) > TAU { length(self.behind) } else { 0.0 }
    }
}

/// How a body and the direction of its path turn.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
struct Turning {
    rotation: Angle,
    path: Angle,
    velocity: [f64; 3],
    /// Largest speed so far, m/s.
    fastest: f64,
}

impl Turning {
    /// The same for the point that moves with `velocity`; returns how far it is behind, in tolerances of its
    /// position: on a path of radius r by the angle times r, and its movement is 2r.
    fn follow_path(&mut self, velocity: [f64; 3], h: f64, part: f64, tolerance: &Tolerance) -> f64 {
        let (before, speed) = (std::mem::replace(&mut self.velocity, velocity), length(velocity));
        self.fastest = self.fastest.max(speed);
        let along: f64 = before.iter().zip(&velocity).map(|(a, b)| a * b).sum();
        // What comes to rest or turns back has no direction in between.
        if along <= 0.0 || speed < SLOW * self.fastest {
            return 0.0;
        }
        let [a, b] = [before, velocity];
        let normal =
            [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
        let across = length(normal);
        if across == 0.0 {
            return 0.0;
        }
        let angle = across.atan2(along);
        let behind = self.path.add(normal.map(|x| x * angle / across), part);
        let radius = speed * h / angle;
        behind * radius / (tolerance.translation + 2.0 * tolerance.relative * radius)
    }
}

fn length(x: [f64; 3]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}
