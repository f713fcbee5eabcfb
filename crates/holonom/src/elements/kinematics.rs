//! An edge of the spanning forest: the relative coordinates it offers, and the pose of one of its bodies
//! from that of the other and their values.
//!
//! ```text
//! A_j = A_i E(x)     r_j + A_j s_j = r_i + A_i s_i + d(x)
//! ```
//!
//! E is made from the relative orientation of the last anchor, so that signs of Euler parameters and
//! branches of joints that can be assembled in several ways stay what they were (`docs/theory/elements.md` (21)).

use super::angle::PlanarAngle;
use super::measure::{Dot, Measure};
use super::motion::{Stance, lifted};
use super::relative::{Reference, Relative};
use super::space::{Planar, Space, Spatial, Triad, euler};
use crate::math::spatial::{conjugate, cross, product};
use crate::math::turn::exponential;
use crate::math::vector::{difference, dot, sum};
use crate::model::JointKind;
use serde::{Deserialize, Serialize};

/// Where an edge stood when its references were last moved.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Anchor {
    /// Orientation of the second body against the first, or of the child against the ground where the
    /// edge does not resist turning: Euler parameters, in the plane an angle (rad) in the first entry.
    pub orientation: [f64; 4],
    /// Values of the relative coordinates.
    pub x: [f64; 6],
}

/// How the second point lies from the first.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Link<const D: usize> {
    /// At the same place.
    Coincides,
    /// At a distance along an axis of the first body.
    Slides([f64; D]),
    /// Anywhere, by components along axes of the first body.
    Components([[f64; D]; D]),
    /// At a length that is a coordinate, or a constant, in a direction of the ground.
    Line(Option<f64>),
}

/// How the second body is turned against the first.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Turns<const D: usize> {
    /// Not at all.
    Rigid,
    /// About an axis of the first body.
    About([f64; D]),
    /// About an axis of the first and one of the second body.
    Cross([[f64; D]; 2]),
    /// By any rotation, along axes of the first body.
    Any([[f64; D]; D]),
    /// By any rotation of the child against the ground.
    Free,
}

/// Bodies that a group of coordinates is between.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    /// The bodies of the edge.
    Both,
    /// The ground and the child.
    GroundAndChild,
}

/// The kinematics of an edge in one set of relative coordinates.
#[derive(Debug, Clone, PartialEq)]
pub struct Kinematics<S, const D: usize, const N: usize, const R: usize> {
    points: [[f64; D]; 2],
    link: Link<D>,
    turns: Turns<D>,
    space: std::marker::PhantomData<S>,
}

/// Kinematics with the coordinates they take, in the order of `x`.
pub type Form<S, const D: usize, const N: usize, const R: usize> =
    (Kinematics<S, D, N, R>, Vec<(Relative<S, D, N, R>, Between)>);

impl<S, const D: usize, const N: usize, const R: usize> Kinematics<S, D, N, R> {
    fn new(frames: &[Triad<D>; 2], link: Link<D>, turns: Turns<D>) -> Self {
        let points = [frames[0].point, frames[1].point];
        Self { points, link, turns, space: std::marker::PhantomData }
    }
}

/// How the outer body of an edge moves against the inner one: a column for each rate, in ground axes.
///
/// Rates are those of the coordinates, but for a rotation vector, whose rates are the components of the
/// relative angular velocity along its axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct EdgeScrews {
    /// Body that carries the outer one; none where the coordinates are those against the ground.
    pub base: Option<usize>,
    /// Body in whose axes the columns are constant, the ground if none.
    pub first: Option<usize>,
    /// Whether the outer body is the second one.
    pub outward: bool,
    /// Number of columns.
    pub count: usize,
    /// The point that rotations are about, m.
    pub center: [f64; 3],
    /// Velocity of the second body's point there against the first, and angular velocity.
    pub columns: [[[f64; 3]; 2]; 6],
    /// A column is carried along by those of lower stages.
    pub stage: [u8; 6],
    /// First of three columns of a rotation vector.
    pub rotation: Option<usize>,
}

/// Services of an edge of the forest.
pub trait EdgeKinematics<const N: usize> {
    /// How a body stands at a pose.
    fn stance(q: &[f64; N]) -> Stance;

    /// Columns for how first and second body stand; `false` where no such columns exist (lines). Which bodies
    /// these are is left to the caller. Columns beyond their number stay what they were.
    fn screws(&self, bodies: [&Stance; 2], child: &Stance, out: &mut EdgeScrews) -> bool;

    /// Whether coordinates are those of the child against the ground.
    fn is_free(&self) -> bool;

    /// Which of its groups of coordinates is a direction, where the edge is a line.
    fn direction(&self) -> Option<usize>;

    /// Pose of the child from that of its parent, and how both stand. The reference is that of the direction, and is read
    /// where there is one.
    fn place(
        &self,
        x: &[f64],
        reference: &Reference,
        anchor: &Anchor,
        parent: (&[f64; N], &Stance),
        parent_is_first: bool,
    ) -> ([f64; N], Stance);

    /// The orientation of an [`Anchor`] at the poses of first body, second body and child.
    fn orientation(&self, q: [&[f64; N]; 2], child: &[f64; N]) -> [f64; 4];
}

impl<S, const D: usize, const N: usize, const R: usize> EdgeKinematics<N> for Kinematics<S, D, N, R>
where
    S: Orientation<D, N, R>,
{
    fn is_free(&self) -> bool {
        matches!((self.turns, self.link), (Turns::Free, Link::Components(_)))
    }

    fn stance(q: &[f64; N]) -> Stance {
        S::stance(q)
    }

    #[inline(always)]
    fn screws(&self, [first, second]: [&Stance; 2], child: &Stance, out: &mut EdgeScrews) -> bool {
        let free = self.is_free();
        (out.count, out.rotation) = (0, None);
        out.center = if free {
            child.place
        } else {
            sum(&second.place, &S::turned(second, &self.points[1]))
        };
        let mut push = |linear, angular, stage| {
            (out.columns[out.count], out.stage[out.count]) = ([linear, angular], stage);
            out.count += 1;
        };
        let rest = [0.0; 3];
        let in_ground = |axis: &[f64; D]| if free { lifted(axis) } else { S::turned(first, axis) };
        match &self.link {
            Link::Coincides => {}
            Link::Slides(axis) => push(in_ground(axis), rest, 0),
            Link::Components(axes) => {
                axes.iter().for_each(|axis| push(in_ground(axis), rest, 0));
            }
            Link::Line(_) => return false,
        }
        match &self.turns {
            Turns::Rigid => {}
            Turns::About(axis) => push(rest, S::turning_axis(first, axis), 1),
            Turns::Cross([inner, outer]) => {
                push(rest, S::turning_axis(first, inner), 1);
                push(rest, S::turning_axis(second, outer).map(|x| -x), 2);
            }
            Turns::Any(axes) => {
                axes[..2 * D - 3].iter().for_each(|a| push(rest, S::turning_axis(first, a), 1));
            }
            Turns::Free => {
                let (ground, axes) = (const { &Stance::GROUND }, unit_axes::<D>());
                axes[..2 * D - 3].iter().for_each(|a| push(rest, S::turning_axis(ground, a), 1));
            }
        }
        if D == 3 && matches!(self.turns, Turns::Any(_) | Turns::Free) {
            out.rotation = Some(if matches!(self.link, Link::Components(_)) { D } else { 0 });
        }
        true
    }

    fn orientation(&self, q: [&[f64; N]; 2], child: &[f64; N]) -> [f64; 4] {
        if self.turns == Turns::Free { S::orientation(child) } else { S::relative_orientation(q) }
    }

    fn direction(&self) -> Option<usize> {
        match self.link {
            Link::Line(fixed) => Some(usize::from(fixed.is_none())),
            _ => None,
        }
    }

    #[inline(always)]
    fn place(
        &self,
        x: &[f64],
        reference: &Reference,
        anchor: &Anchor,
        (parent, stance): (&[f64; N], &Stance),
        parent_is_first: bool,
    ) -> ([f64; N], Stance) {
        let (link, x_turn, at) = match self.link {
            Link::Coincides => ([0.0; D], x, 0),
            Link::Slides(axis) => (axis.map(|a| a * x[0]), &x[1..], 1),
            Link::Components(axes) => {
                let mut d = [0.0; D];
                for (x, axis) in x.iter().zip(&axes) {
                    d = sum(&d, &axis.map(|a| a * x));
                }
                (d, &x[D..], D)
            }
            Link::Line(fixed) => {
                let own = usize::from(fixed.is_none());
                let length = fixed.unwrap_or(x[0]);
                let unit = S::direction(&x[own..], reference);
                let used = own + D - 1;
                (unit.map(|u| u * length), &x[used..], used)
            }
        };
        let change = |k: usize| x_turn[k] - anchor.x[at + k];
        let relative = match self.turns {
            Turns::Rigid => anchor.orientation,
            Turns::About(axis) => S::chain(&S::about(&axis, change(0)), &anchor.orientation),
            Turns::Cross([first, second]) => {
                let turned = S::chain(&S::about(&first, change(0)), &anchor.orientation);
                S::chain(&turned, &S::about(&second, -change(1)))
            }
            Turns::Any(_) | Turns::Free => {
                let mut theta: [f64; 3] =
                    std::array::from_fn(|k| if k < x_turn.len() { change(k) } else { 0.0 });
                if let (3, Turns::Any(axes)) = (D, self.turns) {
                    let along = |i: usize| (0..D).map(|k| axes[k][i] * theta[k]).sum();
                    theta = std::array::from_fn(along);
                }
                S::chain(&S::exponential(&theta), &anchor.orientation)
            }
        };
        if self.is_free() {
            // Against the ground, whatever body the edge hangs on.
            let mut child = S::oriented(&relative);
            child[..D].copy_from_slice(&link);
            return (child, S::stance(&child));
        }
        let mut child = if self.turns == Turns::Free {
            S::oriented(&relative)
        } else if parent_is_first {
            S::second_from_first(parent, &relative)
        } else {
            S::first_from_second(parent, &relative)
        };
        let mut placed = S::stance(&child);
        let (first, second) = if parent_is_first { (stance, &placed) } else { (&placed, stance) };
        let arms = [S::turned(first, &self.points[0]), S::turned(second, &self.points[1])];
        // Centres first: far from the origin their difference is exact where arms are not.
        let mut offset = difference(&arms[0], &arms[1]);
        match self.link {
            Link::Coincides => {}
            Link::Line(_) => offset = sum(&lifted(&link), &offset),
            Link::Slides(_) | Link::Components(_) => {
                offset = sum(&S::turned(first, &link), &offset);
            }
        }
        for k in 0..D {
            child[k] = if parent_is_first { parent[k] + offset[k] } else { parent[k] - offset[k] };
            placed.place[k] = child[k];
        }
        (child, placed)
    }
}

/// What kinematics ask of a space: orientations as Euler parameters, in the plane an angle.
pub trait Orientation<const D: usize, const N: usize, const R: usize>: Space<D, N, R> {
    /// Orientation of the second body against the first.
    fn relative_orientation(q: [&[f64; N]; 2]) -> [f64; 4];
    /// Orientation of a body against the ground.
    fn orientation(q: &[f64; N]) -> [f64; 4];
    /// Rotation about an axis.
    fn about(axis: &[f64; D], angle: f64) -> [f64; 4];
    /// Rotation by a rotation vector.
    fn exponential(theta: &[f64; 3]) -> [f64; 4];
    /// One rotation after the other, axes turning along.
    fn chain(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4];
    /// A pose of this orientation at the origin.
    fn oriented(orientation: &[f64; 4]) -> [f64; N];
    /// Orientation of the second body.
    fn second_from_first(first: &[f64; N], relative: &[f64; 4]) -> [f64; N];
    /// Orientation of the first body.
    fn first_from_second(second: &[f64; N], relative: &[f64; 4]) -> [f64; N];
    /// The direction of these coordinates.
    fn direction(x: &[f64], reference: &Reference) -> [f64; D];
    /// How a body stands at a pose.
    fn stance(q: &[f64; N]) -> Stance;
    /// A vector of a body in ground axes.
    fn turned(body: &Stance, vector: &[f64; D]) -> [f64; 3];
    /// A rotation axis of a body in ground axes; in the plane the normal of the plane.
    fn turning_axis(body: &Stance, axis: &[f64; D]) -> [f64; 3];
    /// The coordinates of a joint as an edge.
    fn joint_form(kind: &JointKind, frames: &[Triad<D>; 2]) -> Form<Self, D, N, R>;
    /// The direction of the line between two points.
    fn line(points: [[f64; D]; 2]) -> Self::Direction;
    /// The relative orientation of two bodies, along axes of the first, its own if none.
    fn rotation(axes: Option<&[[f64; D]; D]>) -> Self::Rotation;
}

impl Orientation<2, 3, 1> for Planar {
    fn relative_orientation(q: [&[f64; 3]; 2]) -> [f64; 4] {
        [q[1][2] - q[0][2], 0.0, 0.0, 0.0]
    }

    fn orientation(q: &[f64; 3]) -> [f64; 4] {
        [q[2], 0.0, 0.0, 0.0]
    }

    fn about(_axis: &[f64; 2], angle: f64) -> [f64; 4] {
        [angle, 0.0, 0.0, 0.0]
    }

    fn exponential(theta: &[f64; 3]) -> [f64; 4] {
        [theta[0], 0.0, 0.0, 0.0]
    }

    fn chain(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
        [a[0] + b[0], 0.0, 0.0, 0.0]
    }

    fn oriented(orientation: &[f64; 4]) -> [f64; 3] {
        [0.0, 0.0, orientation[0]]
    }

    fn second_from_first(first: &[f64; 3], relative: &[f64; 4]) -> [f64; 3] {
        [0.0, 0.0, first[2] + relative[0]]
    }

    fn first_from_second(second: &[f64; 3], relative: &[f64; 4]) -> [f64; 3] {
        [0.0, 0.0, second[2] - relative[0]]
    }

    fn direction(x: &[f64], _reference: &Reference) -> [f64; 2] {
        let (sin, cos) = x[0].sin_cos();
        [cos, sin]
    }

    fn stance(q: &[f64; 3]) -> Stance {
        Stance::planar(q)
    }

    #[inline(always)]
    fn turned(body: &Stance, [x, y]: &[f64; 2]) -> [f64; 3] {
        let [[a, b, _], [c, d, _], _] = &body.axes;
        [a * x + b * y, c * x + d * y, 0.0]
    }

    fn turning_axis(_body: &Stance, _axis: &[f64; 2]) -> [f64; 3] {
        [0.0, 0.0, 1.0]
    }

    fn joint_form(kind: &JointKind, frames: &[Triad<2>; 2]) -> Form<Self, 2, 3, 1> {
        let angle = || (Relative::Angle(PlanarAngle::new(frames)), Between::Both);
        let [along, _] = frames[0].axes;
        let new = |link, turns| Kinematics::new(frames, link, turns);
        match kind {
            JointKind::Revolute => (new(Link::Coincides, Turns::About([0.0; 2])), vec![angle()]),
            JointKind::Translational => {
                let slide = Relative::link(points(frames), &[along]);
                (new(Link::Slides(along), Turns::Rigid), vec![(slide, Between::Both)])
            }
            JointKind::Distance { length } => line_form(frames, Some(*length)),
            _ => (new(Link::Coincides, Turns::Rigid), Vec::new()),
        }
    }

    fn line(points: [[f64; 2]; 2]) -> Self::Direction {
        Self::Direction::between(points)
    }

    fn rotation(_axes: Option<&[[f64; 2]; 2]>) -> PlanarAngle {
        PlanarAngle::of_bodies()
    }
}

impl Orientation<3, 7, 4> for Spatial {
    fn relative_orientation(q: [&[f64; 7]; 2]) -> [f64; 4] {
        unit(&product(&conjugate(&euler(q[0])), &euler(q[1])))
    }

    fn orientation(q: &[f64; 7]) -> [f64; 4] {
        unit(&euler(q))
    }

    fn about(axis: &[f64; 3], angle: f64) -> [f64; 4] {
        let (sin, cos) = (0.5 * angle).sin_cos();
        [cos, sin * axis[0], sin * axis[1], sin * axis[2]]
    }

    fn exponential(theta: &[f64; 3]) -> [f64; 4] {
        exponential(theta)
    }

    fn chain(a: &[f64; 4], b: &[f64; 4]) -> [f64; 4] {
        product(a, b)
    }

    fn oriented(orientation: &[f64; 4]) -> [f64; 7] {
        let [a, b, c, d] = unit(orientation);
        [0.0, 0.0, 0.0, a, b, c, d]
    }

    fn second_from_first(first: &[f64; 7], relative: &[f64; 4]) -> [f64; 7] {
        Self::oriented(&product(&euler(first), relative))
    }

    fn first_from_second(second: &[f64; 7], relative: &[f64; 4]) -> [f64; 7] {
        Self::oriented(&product(&euler(second), &conjugate(relative)))
    }

    fn direction(x: &[f64], reference: &Reference) -> [f64; 3] {
        let u = [reference[0], reference[1], reference[2]];
        let b = [reference[3], reference[4], reference[5]];
        let c = cross(&u, &b);
        let turn: [f64; 3] = std::array::from_fn(|k| x[0] * b[k] + x[1] * c[k]);
        crate::math::spatial::rotate(&exponential(&turn), &u)
    }

    fn stance(q: &[f64; 7]) -> Stance {
        Stance::spatial(q)
    }

    #[inline(always)]
    fn turned(body: &Stance, vector: &[f64; 3]) -> [f64; 3] {
        body.turn(vector)
    }

    fn turning_axis(body: &Stance, axis: &[f64; 3]) -> [f64; 3] {
        body.turn(axis)
    }

    fn joint_form(kind: &JointKind, frames: &[Triad<3>; 2]) -> Form<Self, 3, 7, 4> {
        let both = |relative| (relative, Between::Both);
        let new = |link, turns| Kinematics::new(frames, link, turns);
        let [h, h_second] = [frames[0].axes[2], frames[1].axes[2]];
        let angle = || both(Relative::Angle(<Self as Space<3, 7, 4>>::Angle::new(frames)));
        let slide = || both(Relative::link(points(frames), &[h]));
        match kind {
            JointKind::Fixed => (new(Link::Coincides, Turns::Rigid), Vec::new()),
            JointKind::Revolute => (new(Link::Coincides, Turns::About(h)), vec![angle()]),
            JointKind::Translational => (new(Link::Slides(h), Turns::Rigid), vec![slide()]),
            JointKind::Cylindrical => {
                (new(Link::Slides(h), Turns::About(h)), vec![slide(), angle()])
            }
            JointKind::Universal => {
                type Angle = <Spatial as Space<3, 7, 4>>::Angle;
                let first = both(Relative::Angle(Angle::of_axis(frames, 2)));
                let second = both(Relative::Angle(Angle::of_cross(frames)));
                (new(Link::Coincides, Turns::Cross([h, h_second])), vec![first, second])
            }
            JointKind::Spherical => {
                let any = both(Relative::Rotation(Self::rotation(None)));
                (new(Link::Coincides, Turns::Any(unit_axes())), vec![any])
            }
            JointKind::Distance { length } => line_form(frames, Some(*length)),
        }
    }

    fn line(points: [[f64; 3]; 2]) -> Self::Direction {
        Self::Direction::new(points)
    }

    fn rotation(axes: Option<&[[f64; 3]; 3]>) -> Self::Rotation {
        use super::turning::SpatialRotation;
        axes.map_or_else(SpatialRotation::new, SpatialRotation::along)
    }
}

fn unit_axes<const D: usize>() -> [[f64; D]; D] {
    std::array::from_fn(|k| std::array::from_fn(|j| f64::from(u8::from(j == k))))
}

fn unit(p: &[f64; 4]) -> [f64; 4] {
    let inverse = dot(p, p).sqrt().recip();
    p.map(|x| x * inverse)
}

fn points<const D: usize>(frames: &[Triad<D>; 2]) -> [[f64; D]; 2] {
    [frames[0].point, frames[1].point]
}

/// Length (where it is not fixed) and direction of a line, and the child's own rotation.
pub(crate) fn line_form<S, const D: usize, const N: usize, const R: usize>(
    frames: &[Triad<D>; 2],
    fixed: Option<f64>,
) -> Form<S, D, N, R>
where
    S: Orientation<D, N, R>,
{
    let mut coordinates = Vec::new();
    if fixed.is_none() {
        coordinates.push((Relative::length(points(frames)), Between::Both));
    }
    coordinates.push((Relative::Direction(S::line(points(frames))), Between::Both));
    coordinates.push((Relative::Rotation(S::rotation(None)), Between::GroundAndChild));
    (Kinematics::new(frames, Link::Line(fixed), Turns::Free), coordinates)
}

/// The deformations of a bushing along axes of its frame on the first body: translation and rotation.
pub(crate) fn bushing_form<S, const D: usize, const N: usize, const R: usize>(
    frames: &[Triad<D>; 2],
) -> Form<S, D, N, R>
where
    S: Orientation<D, N, R>,
{
    let axes = frames[0].axes;
    let link = Relative::link(points(frames), &axes);
    let coordinates =
        vec![(link, Between::Both), (Relative::Rotation(S::rotation(Some(&axes))), Between::Both)];
    (Kinematics::new(frames, Link::Components(axes), Turns::Any(axes)), coordinates)
}

/// A free body: its centre of mass in ground axes, and its rotation.
pub(crate) fn free_form<S, const D: usize, const N: usize, const R: usize>() -> Form<S, D, N, R>
where
    S: Orientation<D, N, R>,
{
    let axes: [[f64; D]; D] = unit_axes();
    let frame = Triad { point: [0.0; D], axes };
    let dots = axes.iter().map(|axis| Dot::along(*axis)).collect();
    let place = Relative::Displacement(Measure::new([[0.0; D]; 2], false, dots));
    let coordinates = vec![
        (place, Between::GroundAndChild),
        (Relative::Rotation(S::rotation(None)), Between::GroundAndChild),
    ];
    (Kinematics::new(&[frame, frame], Link::Components(axes), Turns::Free), coordinates)
}
