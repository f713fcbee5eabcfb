//! What the user described: named bodies, joints, forces and drivers in SI units. Plain data after
//! validation: every number finite, every reference an index, every point fixed in its body.
//!
//! Poses, points and axes are stored with three components also for planar models, where the third
//! component of a point is 0 and frames turn about z only, so that one set of types serves both.

mod branches;
mod plausibility;
mod shapes;
mod validation;
mod words;

use crate::math::{planar, spatial, vector};

pub use crate::math::{MonotoneCubic, TableError, TimeFunction};

pub use plausibility::{
    MotionTable, StatedUnits, changing_motions, force_frequencies, force_ramps, frequencies,
    implausible, implausible_angle, motion_tables,
};
pub use shapes::{Shape, ShapeKind, Surface};
pub use validation::{FARTHEST, validate};
pub use words::{
    Accelerations, Coordinates, JacobianSource, ParametrizationKind, Profile, Representation,
};

/// Planar models move in x-y and turn about z; spatial models use Euler parameters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Dimension {
    /// Coordinates x, y, angle per body.
    Planar,
    /// Coordinates x, y, z and four Euler parameters per body.
    Spatial,
}

/// Index into [`Model::bodies`]; `None` is the ground.
pub type BodyIndex = Option<usize>;

/// A validated model.
#[derive(Debug, Clone, PartialEq)]
pub struct Model {
    /// Title for reports; may be empty.
    pub title: String,
    /// Planar or spatial.
    pub dimension: Dimension,
    /// Acceleration of gravity, m/s², ground axes.
    pub gravity: [f64; 3],
    /// Moving bodies in file order.
    pub bodies: Vec<Body>,
    /// Joints in file order.
    pub joints: Vec<Joint>,
    /// Forces in file order.
    pub forces: Vec<Force>,
    /// Prescribed motions in file order.
    pub drivers: Vec<Driver>,
    /// Stated initial state.
    pub initial: Initial,
    /// Channels and interval asked for by the file.
    pub outputs: Outputs,
    /// Defaults of a run stated by the file.
    pub simulation: SimulationDefaults,
}

/// Distances from centres of mass below this part of the radius of gyration are none.
const NO_ARM: f64 = 1e-6;

impl Model {
    /// Root mean square distance of the points of joints and drivers from their bodies' centres of
    /// mass, m, which does not depend on where the model stands. Points that stand on these centres, but
    /// perhaps for the last digits of a file, say nothing of the size of a model: then it is the radius of
    /// gyration of the bodies, and 1 m where they have none.
    pub fn characteristic_length(&self) -> f64 {
        let frames = self.joints.iter().flat_map(|j| &j.frames);
        let frames = frames.chain(self.drivers.iter().flat_map(|d| &d.frames));
        let (mut sum, mut count) = (0.0, 0.0f64);
        for Frame { body, point, .. } in frames {
            if let Some(b) = body {
                let center = &self.bodies[*b].center_of_mass;
                sum += point.iter().zip(center).map(|(p, c)| (p - c).powi(2)).sum::<f64>();
                count += 1.0;
            }
        }
        let arm = (sum / count.max(1.0)).sqrt();
        let (mut inertia, mut mass) = (0.0, 0.0);
        for body in &self.bodies {
            mass += body.mass;
            inertia += match self.dimension {
                Dimension::Planar => body.inertia[2][2],
                Dimension::Spatial => (0..3).map(|k| body.inertia[k][k]).sum::<f64>() / 3.0,
            };
        }
        let gyration = if mass > 0.0 { (inertia / mass).sqrt() } else { 0.0 };
        if arm > NO_ARM * gyration {
            arm
        } else if gyration > 0.0 {
            gyration
        } else {
            1.0
        }
    }

    /// Axis f, g or h (0, 1, 2) of a frame in the design configuration, ground axes.
    pub fn design_axis(&self, frame: &Frame, k: usize) -> [f64; 3] {
        self.design_turned(frame.body, frame.axes.map(|row| row[k]))
    }

    /// Distance of the points of two frames in the design configuration, m.
    pub fn design_distance(&self, frames: &[Frame; 2]) -> f64 {
        let [first, second] =
            frames.each_ref().map(|frame| self.design_place(frame.body, frame.point));
        vector::difference(&second, &first).iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    /// A point in the axes of a body, from its origin, in the design configuration, ground axes.
    pub(crate) fn design_place(&self, body: BodyIndex, point: [f64; 3]) -> [f64; 3] {
        let origin = body.map_or([0.0; 3], |b| self.bodies[b].position);
        vector::sum(&origin, &self.design_turned(body, point))
    }

    /// A vector in the axes of a body in the design configuration, in ground axes.
    pub(crate) fn design_turned(&self, body: BodyIndex, a: [f64; 3]) -> [f64; 3] {
        match body.map(|b| self.bodies[b].orientation) {
            Some(Orientation::EulerParameters(p)) => spatial::rotate(&p, &a),
            Some(Orientation::Angle(angle)) => {
                let [x, y] = planar::rotate(angle, &[a[0], a[1]]);
                [x, y, a[2]]
            }
            None => a,
        }
    }
}

/// A rigid body. The body frame's origin and axes are the user's; inertia is about the centre of
/// mass in body axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// Unique name.
    pub name: String,
    /// Mass, kg, not negative.
    pub mass: f64,
    /// Inertia tensor about the centre of mass, body axes, kg m²; planar models use `[2][2]` only.
    pub inertia: [[f64; 3]; 3],
    /// Position of the body origin in the design configuration, m, ground axes.
    pub position: [f64; 3],
    /// Orientation in the design configuration.
    pub orientation: Orientation,
    /// Centre of mass, m, body axes, from the body origin.
    pub center_of_mass: [f64; 3],
    /// Named points of the body, m, body axes, from the body origin.
    pub markers: Vec<(String, [f64; 3])>,
    /// What the body looks like; mass and inertia have taken their part of it already.
    pub shapes: Vec<Shape>,
}

/// Orientation of a body frame against ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Orientation {
    /// Angle about z, rad; not reduced modulo a turn.
    Angle(f64),
    /// Euler parameters (e0, e1, e2, e3) of unit length.
    EulerParameters([f64; 4]),
}

/// A point and axes fixed in a body (or in the ground).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frame {
    /// The body.
    pub body: BodyIndex,
    /// Point, m, body axes, from the body origin (not from the centre of mass).
    pub point: [f64; 3],
    /// Columns are the frame's unit axes f, g, h in body axes: `axes[row][column]`.
    pub axes: [[f64; 3]; 3],
}

/// A joint between `frames[0]` (first) and `frames[1]` (second).
#[derive(Debug, Clone, PartialEq)]
pub struct Joint {
    /// Unique name.
    pub name: String,
    /// Kind and its own numbers.
    pub kind: JointKind,
    /// Frames on the first and the second body.
    pub frames: [Frame; 2],
}

/// Kinds of joints. Spatial joints use axis h (column 2) of the frames, planar translational joints
/// axis f (column 0).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JointKind {
    /// No relative motion.
    Fixed,
    /// Turns about h (planar: about z).
    Revolute,
    /// Slides along h (planar: along f), no turning.
    Translational,
    /// Slides along and turns about h. Spatial.
    Cylindrical,
    /// Points coincide; h of the first stays perpendicular to h of the second. Spatial.
    Universal,
    /// Points coincide. Spatial.
    Spherical,
    /// The two points keep this distance, m, positive.
    Distance {
        /// Distance, m.
        length: f64,
    },
}

/// A prescribed relative motion (absolute when the first frame is the ground's).
#[derive(Debug, Clone, PartialEq)]
pub struct Driver {
    /// Unique name.
    pub name: String,
    /// What is prescribed.
    pub kind: DriverKind,
    /// Frames on the first and the second body; they may belong to a joint's axis.
    pub frames: [Frame; 2],
    /// The prescribed value over time, m or rad.
    pub motion: TimeFunction,
}

/// What a driver prescribes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum DriverKind {
    /// Displacement of the second point from the first along h of the first frame (planar: f), m.
    Translation,
    /// Angle of the second frame from the first about h of the first frame (planar: z), rad.
    Rotation,
}

/// A force element.
#[derive(Debug, Clone, PartialEq)]
pub struct Force {
    /// Unique name.
    pub name: String,
    /// Kind and its own numbers.
    pub kind: ForceKind,
}

/// Kinds of forces. Signs: second relative to first; tension positive.
#[allow(clippy::large_enum_variant, reason = "read once when the system is compiled")]
#[derive(Debug, Clone, PartialEq)]
pub enum ForceKind {
    /// Translational spring-damper along the line of two points:
    /// f = law(l − free_length) + damping · l̇.
    Tsda {
        /// Points on the first and the second body.
        frames: [Frame; 2],
        /// Elastic law of the extension.
        law: ElasticLaw,
        /// N s/m.
        damping: f64,
        /// m, not negative.
        free_length: f64,
    },
    /// Rotational spring-damper about h (planar: z): torque on the second from the first is
    /// −[law(θ − free_angle) + damping · θ̇], opposite on the first.
    Rsda {
        /// Frames on the first and the second body.
        frames: [Frame; 2],
        /// Elastic law of the angle.
        law: ElasticLaw,
        /// N m s/rad.
        damping: f64,
        /// rad.
        free_angle: f64,
    },
    /// A spring and a damper in series along the line of two points. Extra state: the spring's
    /// extension z (m), f = stiffness z, ż = l̇ − f / damping.
    Maxwell {
        /// Points on the first and the second body.
        frames: [Frame; 2],
        /// N/m, positive.
        stiffness: f64,
        /// N s/m, positive.
        damping: f64,
        /// m, not negative.
        free_length: f64,
    },
    /// Linear 6×6 bushing: u = (d, e), d the translation of the second frame's point in the first
    /// frame (m), e = 2 sign(e0) (e1, e2, e3) of the relative Euler parameters (rad); wrench from
    /// ½ uᵀ K u and C u̇, and from the springs of its branches. Spatial.
    Bushing {
        /// Frames on the first and the second body.
        frames: [Frame; 2],
        /// Symmetric, positive semidefinite; N/m, N, N m/rad. Boxed, as that of dampers: other forces are much smaller.
        stiffness: Box<[[f64; 6]; 6]>,
        /// Symmetric, positive semidefinite; N s/m, N s, N m s/rad.
        damping: Box<[[f64; 6]; 6]>,
        /// Beside these, springs and dampers in series.
        branches: Vec<Branch>,
    },
    /// Smooth vertical tyre with optional lateral force, at a wheel centre. Spatial.
    Tyre(Tyre),
    /// A force at a point of one body; with `reaction` the opposite force acts on that body at the
    /// same place in space.
    PointForce {
        /// Body and point.
        frame: Frame,
        /// Components over time, N.
        force: [TimeFunction; 3],
        /// Axes of the components.
        axes: ForceAxes,
    },
    /// A torque on one body; with `reaction` the opposite torque acts on that body.
    Torque {
        /// Body that the torque acts on.
        body: BodyIndex,
        /// Body that carries the opposite torque, if stated.
        reaction: BodyIndex,
        /// Components over time, N m; planar models use the third only.
        torque: [TimeFunction; 3],
        /// Axes of the components (`Body`: of `body`).
        axes: ForceAxes,
    },
}

/// Axes in which components of an applied force or torque are given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ForceAxes {
    /// Fixed ground axes.
    Ground,
    /// Axes of the body acted on (a following force).
    Body,
}

/// Elastic part of a force law, a function of extension (m) or angle (rad) from the free value.
#[derive(Debug, Clone, PartialEq)]
pub enum ElasticLaw {
    /// Stiffness, N/m or N m/rad.
    Linear(f64),
    /// Monotone C1 cubic through a table, N or N m; continued linearly outside. Boxed: few laws are tables.
    Table(Box<MonotoneCubic>),
}

/// Smooth tyre of the vehicle models. With δ = radius − (z − h(x)) of the wheel centre (x, y, z) and
/// road height h: s = (δ + √(δ²+ε²))/2, σ = (1 + δ/√(δ²+ε²))/2, F_z = stiffness·s + damping·σ·δ̇
/// upwards at the wheel centre; lateral force as in [`LateralTyre`].
#[derive(Debug, Clone, PartialEq)]
pub struct Tyre {
    /// Body and wheel centre.
    pub frame: Frame,
    /// Unloaded radius, m.
    pub radius: f64,
    /// N/m.
    pub stiffness: f64,
    /// N s/m.
    pub damping: f64,
    /// Length ε of the smoothed contact onset, m, positive.
    pub smoothing: f64,
    /// Road under the wheel.
    pub road: Road,
    /// Lateral force, if any.
    pub lateral: Option<LateralTyre>,
}

/// Lateral tyre force F_y = −cornering_stiffness · α · σ along l, with t the horizontal unit vector
/// perpendicular to the wheel axis e (t = unit(e_y, −e_x, 0)), l = (−t_y, t_x, 0),
/// α = atan2(v·l, √((v·t)² + v₀²)); it acts at the wheel centre − (radius − s) z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LateralTyre {
    /// N/rad.
    pub cornering_stiffness: f64,
    /// v₀, m/s, positive.
    pub regularization_speed: f64,
    /// Wheel axis, unit vector in body axes.
    pub axis: [f64; 3],
}

/// Height of the road under a wheel centre as a function of x.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Road {
    /// h = height.
    Flat {
        /// m.
        height: f64,
    },
    /// h = height (1 − ξ²)³ for |ξ| < 1, ξ = (x − center)/half_length, else 0. C2.
    SmoothBump {
        /// m.
        height: f64,
        /// m, positive.
        half_length: f64,
        /// x of the crest, m.
        center: f64,
    },
    /// Path of a rigid wheel over a half cylinder: h = √((R + radius)² − (x − center)²) − R where
    /// positive, with R the tyre's unloaded radius.
    HalfCylinder {
        /// Radius of the half cylinder, m.
        radius: f64,
        /// x of its axis, m.
        center: f64,
    },
}

/// A branch of a viscoelastic bushing: a spring and a damper in series over the bushing's deformation u. Extra states: the
/// extensions z of the spring in its directions; wrench from K z, ż = u̇ − C⁻¹K z.
#[derive(Debug, Clone, PartialEq)]
pub struct Branch {
    /// Name within the bushing.
    pub name: String,
    /// Symmetric, positive semidefinite; N/m, N, N m/rad.
    pub stiffness: [[f64; 6]; 6],
    /// Symmetric; positive definite on the directions of the spring, zero on others; N s/m, N s, N m s/rad.
    pub damping: [[f64; 6]; 6],
}

impl Branch {
    /// Directions in which there is a spring: one extra state each.
    pub fn directions(&self) -> impl Iterator<Item = usize> + '_ {
        (0..6).filter(|&k| self.stiffness[k].iter().any(|x| *x != 0.0))
    }
}

/// Stated initial state. What is `None` follows from the joints.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Initial {
    /// How stated values are treated.
    pub assembly: Assembly,
    /// One entry per body, in the order of [`Model::bodies`]; none where nothing is stated of any.
    pub bodies: Vec<InitialBody>,
    /// Stated relative coordinates of joints.
    pub joints: Vec<InitialCoordinate>,
    /// Initial extra states by force name; unstated ones start unloaded.
    pub extra_states: Vec<(String, InitialExtraState)>,
}

/// Stated initial extra states of one force.
#[derive(Debug, Clone, PartialEq)]
pub enum InitialExtraState {
    /// Extension of the spring of a Maxwell element, m.
    Spring(f64),
    /// Extensions of the springs of branches in their six directions, m and rad, by name.
    Branches(Vec<(String, [f64; 6])>),
}

/// How stated initial values are treated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Assembly {
    /// Kept; a residual above 1e-6 is refused.
    #[default]
    Keep,
    /// Guesses that may move.
    Adjust,
}

/// Stated initial values of one body; velocities in ground axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct InitialBody {
    /// Position of the body origin, m.
    pub position: Option<[f64; 3]>,
    /// Orientation.
    pub orientation: Option<Orientation>,
    /// Velocity of the body origin, m/s.
    pub velocity: Option<[f64; 3]>,
    /// Angular velocity, rad/s, ground axes; planar models use the third component.
    pub angular_velocity: Option<[f64; 3]>,
}

/// A stated relative coordinate of a joint, or its rate.
#[derive(Debug, Clone, PartialEq)]
pub struct InitialCoordinate {
    /// The joint, by its place in [`Model::joints`].
    pub joint: usize,
    /// Name of the field that states it: `angle`, `angles[1]`, `velocity`, …
    pub field: String,
    /// Displacement along h (planar: f), or angle about h (planar: z) of the first of `frames`.
    pub kind: DriverKind,
    /// Whether `value` is the rate of the coordinate.
    pub is_rate: bool,
    /// m or rad, m/s or rad/s.
    pub value: f64,
    /// Frames between which it is measured: those of the joint, of a universal joint about one of its
    /// axes.
    pub frames: [Frame; 2],
}

/// Channels and interval asked for by the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Outputs {
    /// Channel names `item.quantity`.
    pub channels: Vec<String>,
    /// Time between outputs, s.
    pub interval: Option<f64>,
}

/// Defaults of a run stated by the file.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SimulationDefaults {
    /// s.
    pub start_time: Option<f64>,
    /// s.
    pub end_time: Option<f64>,
    /// Tolerances.
    pub tolerance: Option<Tolerance>,
    /// Name of a code or family.
    pub method: Option<String>,
    /// Formula within a family.
    pub formula: Option<String>,
    /// Fixed step size, s.
    pub fixed_step: Option<f64>,
    /// Largest step size, s.
    pub max_step: Option<f64>,
    /// First step size, s.
    pub initial_step: Option<f64>,
    /// Largest number of steps.
    pub max_steps: Option<u64>,
    /// Largest wall time of a run with its assembly, s.
    pub max_seconds: Option<f64>,
    /// Re-partitioning factor α.
    pub repartition_factor: Option<f64>,
    /// Whether dense output is stored.
    pub dense_output: Option<bool>,
    /// What the independent variables are.
    pub parametrization: Option<ParametrizationKind>,
    /// Where the integration Jacobian comes from.
    pub jacobian: Option<JacobianSource>,
    /// How it is represented.
    pub newton: Option<Representation>,
    /// Where accelerations and multipliers come from.
    pub accelerations: Option<Accelerations>,
    /// Which coordinates recoveries and derivatives go through.
    pub coordinates: Option<Coordinates>,
    /// Joints that are no edges of the spanning forest, by their places in [`Model::joints`].
    pub cut: Vec<usize>,
    /// Choices that go with a code.
    pub profile: Option<Profile>,
}

/// Tolerances of a run; 1e-4 unless stated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    /// Relative part: of the movement since the start (positions) or of the value (velocities).
    pub relative: f64,
    /// Absolute part of translations, m and m/s.
    pub translation: f64,
    /// Absolute part of rotations, rad and rad/s.
    pub rotation: f64,
}

impl Default for Tolerance {
    fn default() -> Self {
        Self::uniform(1e-4)
    }
}

impl Tolerance {
    /// The same number for all three parts.
    pub fn uniform(value: f64) -> Self {
        Self { relative: value, translation: value, rotation: value }
    }

    /// The largest of the three parts.
    pub fn largest(&self) -> f64 {
        self.relative.max(self.translation).max(self.rotation)
    }
}
