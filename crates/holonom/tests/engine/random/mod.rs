//! Seeded random mechanisms as model text: planar and spatial, trees and loops, every joint, force
//! and driver of the model file, stiffnesses log-uniform in 1 … 1e10 N/m.
//!
//! The configuration is drawn first and joints are placed on it, so every loop is closed. Speeds are
//! those of the tree of joints, moved by least change onto what loops, drivers and settled force
//! elements allow; settled elements carry the force that leaves their ends without relative
//! acceleration, so that a stiff one starts on its slow manifold.

#![allow(dead_code, reason = "each binary uses a part of it")]

mod draw;
mod kinematics;
pub(crate) mod numbers;
mod text;
mod traits;

use numbers::{M3, V3, add, norm, scale, sub};

/// A random mechanism.
#[derive(Debug, Clone)]
pub(crate) struct Mechanism {
    pub(crate) seed: u64,
    pub(crate) planar: bool,
    gravity: V3,
    bodies: Vec<Body>,
    joints: Vec<Joint>,
    elements: Vec<Element>,
    loads: Vec<Load>,
    drivers: Vec<Driver>,
    /// Height of the road under tyres.
    road: Option<f64>,
    /// A run worth looking at, s.
    pub(crate) span: f64,
    /// Estimate of its fastest vibration and decay, 1/s.
    pub(crate) fastest: f64,
    /// Degrees of freedom.
    pub(crate) freedom: usize,
    /// Whether most bodies float, tied by force elements alone, and whatever ties them names either first.
    adrift: bool,
}

/// A rigid body in the design configuration; also its mass points, which have its inertia.
#[derive(Debug, Clone)]
struct Body {
    mass: f64,
    center: V3,
    /// Columns: principal axes.
    principal: M3,
    /// ∫ x² dm along them, kg m².
    moments: V3,
    /// Columns: body axes.
    axes: M3,
    /// From the centre of mass to the body origin, ground axes.
    origin: V3,
    /// Turn of a planar body, rad.
    angle: f64,
    velocity: V3,
    angular_velocity: V3,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Floating,
    Fixed,
    Revolute,
    Translational,
    Cylindrical,
    Universal,
    Spherical,
    Distance,
}

/// First and second body; none is the ground.
type Between = [Option<usize>; 2];

#[derive(Debug, Clone)]
struct Joint {
    kind: Kind,
    between: Between,
    /// Points on the first and on the second body: the same but for a distance joint.
    points: [V3; 2],
    /// Axes on the first and on the second body: the same but for a universal joint.
    axes: [V3; 2],
    /// Its place among the coordinates of the tree; none closes a loop.
    coordinates: Option<(usize, usize)>,
    /// Whether the model file names its second body first.
    reversed: bool,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Law {
    Tsda,
    Maxwell,
    Rsda,
    /// Whether it resists turning, too.
    Bushing(bool),
}

/// A spring with a damper.
#[derive(Debug, Clone)]
struct Element {
    law: Law,
    between: Between,
    points: [V3; 2],
    /// Columns: bushing axes; the third is the axis of an rsda.
    axes: M3,
    /// N/m, N m/rad for an rsda.
    stiffness: f64,
    /// Rotational stiffness of a bushing over its stiffness, m².
    lever: f64,
    /// Damping over stiffness, s.
    damping: f64,
    rotational_damping: f64,
    settled: bool,
    /// Elastic forces at the start.
    preload: Vec<f64>,
    /// Of the branch of a viscoelastic bushing: stiffness over that of the bushing, and relaxation time, s.
    branch: Option<[f64; 2]>,
    /// Deformation to either side without force, m or rad: a stop beyond it, unloaded at the start.
    gap: Option<f64>,
}

#[derive(Debug, Clone)]
enum Load {
    Force { on: usize, point: V3, axes: &'static str, motions: Vec<Motion> },
    Torque { between: Between, axis: V3, axes: &'static str, motion: Motion },
    Tyre { on: usize, point: V3, radius: f64, stiffness: f64, damping: f64, lateral: Option<V3> },
}

#[derive(Debug, Clone)]
struct Driver {
    joint: usize,
    /// The driven coordinate of the tree.
    coordinate: usize,
    rotation: bool,
    /// Stated by its own geometry in place of the joint.
    explicit: bool,
    motion: Motion,
}

#[derive(Debug, Clone)]
enum Motion {
    Constant(f64),
    /// Coefficients.
    Polynomial(Vec<f64>),
    /// Amplitude, angular frequency, offset.
    Harmonic(f64, f64, f64),
    /// From, to, start, end.
    Step(f64, f64, f64, f64),
    /// Spacing of the times and three values.
    Table(f64, [f64; 3]),
}

impl Motion {
    /// Value, rate and second derivative at t = 0.
    fn start(&self) -> [f64; 3] {
        match self {
            Self::Constant(value) => [*value, 0.0, 0.0],
            Self::Polynomial(c) => {
                let c = |k: usize| c.get(k).copied().unwrap_or(0.0);
                [c(0), c(1), 2.0 * c(2)]
            }
            Self::Harmonic(amplitude, w, offset) => [*offset, amplitude * w, 0.0],
            Self::Step(from, ..) => [*from, 0.0, 0.0],
            // The natural spline through three values.
            Self::Table(h, [a, b, c]) => [*a, (b - a) / h - (a - 2.0 * b + c) / (4.0 * h), 0.0],
        }
    }
}

/// Longest span, s.
const LONGEST: f64 = 5.0;
/// Stiffness of an element that is not soft, N/m.
const STIFF: f64 = 1e4;

impl Mechanism {
    fn at(&self, body: Option<usize>) -> V3 {
        body.map_or([0.0; 3], |b| self.bodies[b].center)
    }

    fn has_loops(&self) -> bool {
        self.joints.iter().any(|j| j.coordinates.is_none())
    }

    /// The floating body that a body is joined to; none where joints tie it to the ground.
    fn root(&self, mut body: usize) -> Option<usize> {
        while let Some(parent) = self.joints[body].between[0] {
            body = parent;
        }
        (self.joints[body].kind == Kind::Floating).then_some(body)
    }

    fn angle_between(&self, between: Between) -> f64 {
        let angle = |b: Option<usize>| b.map_or(0.0, |b| self.bodies[b].angle);
        angle(between[1]) - angle(between[0])
    }

    /// Largest angular velocity at the start, rad/s.
    pub(crate) fn speed(&self) -> f64 {
        self.bodies.iter().map(|b| norm(&b.angular_velocity)).fold(0.0, f64::max)
    }

    /// Inertia tensor of a body about its centre, body axes.
    fn inertia(body: &Body) -> M3 {
        let r = numbers::product(&numbers::transpose(&body.axes), &body.principal);
        let [a, b, c] = body.moments;
        let diagonal = [b + c, a + c, a + b];
        let tensor: M3 = std::array::from_fn(|i| {
            std::array::from_fn(|j| (0..3).map(|k| r[i][k] * diagonal[k] * r[j][k]).sum())
        });
        std::array::from_fn(|i| std::array::from_fn(|j| 0.5 * (tensor[i][j] + tensor[j][i])))
    }

    fn origin(body: &Body) -> V3 {
        add(&body.center, &body.origin)
    }

    fn in_body(&self, body: Option<usize>, point: &V3) -> V3 {
        match body {
            None => *point,
            Some(b) => {
                let body = &self.bodies[b];
                let from = sub(point, &Self::origin(body));
                numbers::apply(&numbers::transpose(&body.axes), &from)
            }
        }
    }

    fn center_of_mass(body: &Body) -> V3 {
        numbers::apply(&numbers::transpose(&body.axes), &scale(&body.origin, -1.0))
    }
}
