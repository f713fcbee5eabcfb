//! Rows between two bodies from how these stand and move in ground axes: each row as a wrench on either body, without
//! the way through the coordinates of their poses (`docs/theory/elements.md` (22a)-(22e)).

use super::measure::{Dot, Measure};
use super::space::{Space, euler};
use super::vector_function::Vector;
use crate::math::spatial::{cross, rotation_matrix};
use crate::math::vector::{add_scaled, difference, dot, scaled, sum};

/// How a body stands: its centre of mass, m, and its axes in those of the ground, `[row][column]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Stance {
    /// Centre of mass, m.
    pub place: [f64; 3],
    /// A.
    pub axes: [[f64; 3]; 3],
}

impl Stance {
    /// The ground.
    pub const GROUND: Self =
        Self { place: [0.0; 3], axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] };

    /// At (r, Euler parameters).
    #[inline(always)]
    pub fn spatial(q: &[f64; 7]) -> Self {
        Self { place: [q[0], q[1], q[2]], axes: rotation_matrix(&euler(q)) }
    }

    /// At (x, y, angle).
    #[inline(always)]
    pub fn planar(q: &[f64; 3]) -> Self {
        let (sin, cos) = q[2].sin_cos();
        Self {
            place: [q[0], q[1], 0.0],
            axes: [[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]],
        }
    }

    /// A a.
    #[inline(always)]
    pub fn turn(&self, a: &[f64; 3]) -> [f64; 3] {
        let [x, y, z] = &self.axes;
        [dot(x, a), dot(y, a), dot(z, a)]
    }
}

/// What moves a body: of the centre of mass, and angular; ground axes.
pub type Field = [[f64; 3]; 2];

/// How a body moves, and a variation of that; where this is the motion itself in time, changes are accelerations.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Motion {
    /// Velocity of the centre of mass, m/s, and ω, rad/s.
    pub velocity: Field,
    /// By what the body is displaced.
    pub displacement: Field,
    /// By what its velocities change.
    pub change: Field,
}

/// A vector x with ẋ, δx and δẋ.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Varied {
    pub(super) x: [f64; 3],
    pub(super) rate: [f64; 3],
    pub(super) moved: [f64; 3],
    pub(super) change: [f64; 3],
}

impl Motion {
    /// That of the ground.
    pub const REST: Self =
        Self { velocity: [[0.0; 3]; 2], displacement: [[0.0; 3]; 2], change: [[0.0; 3]; 2] };

    /// A vector that is fixed in the body.
    #[inline(always)]
    fn carry(&self, x: [f64; 3]) -> Varied {
        let (rate, moved) = (cross(&self.velocity[1], &x), cross(&self.displacement[1], &x));
        let change = sum(&cross(&self.change[1], &x), &cross(&self.velocity[1], &moved));
        Varied { x, rate, moved, change }
    }

    /// The point at an arm from the centre of mass.
    #[inline(always)]
    fn carry_point(&self, arm: [f64; 3]) -> Varied {
        let Varied { x, rate, moved, change } = self.carry(arm);
        Varied {
            x,
            rate: sum(&self.velocity[0], &rate),
            moved: sum(&self.displacement[0], &moved),
            change: sum(&self.change[0], &change),
        }
    }
}

/// Force and moment about the centre of mass, ground axes.
pub type Wrench = [[f64; 3]; 2];

/// Rows u(q) that are known from how two bodies stand and move.
pub trait MotionRows {
    /// u.
    fn value_at(&self, bodies: [&Stance; 2], u: &mut [f64; 6]);

    /// Wrenches of the rows on both bodies: u̇ is their power.
    fn wrenches(&self, bodies: [&Stance; 2], out: &mut [[Wrench; 2]; 6]);

    /// δu̇; ü where the variation is the motion itself.
    fn rate_changes(&self, bodies: [&Stance; 2], motions: [&Motion; 2], u: &mut [f64; 6]);
}

/// The link between two points: arms from the centres of mass, and their difference.
#[derive(Clone, Copy, Default)]
pub(super) struct Link {
    pub(super) arms: [[f64; 3]; 2],
    pub(super) x: [f64; 3],
}

/// The same in three dimensions.
#[inline(always)]
pub(super) fn lifted<const D: usize>(a: &[f64; D]) -> [f64; 3] {
    let mut out = [0.0; 3];
    out[..D].copy_from_slice(a);
    out
}

impl Link {
    #[inline(always)]
    pub(super) fn new<const D: usize>(points: &[[f64; D]; 2], bodies: [&Stance; 2]) -> Self {
        let arms = [bodies[0].turn(&lifted(&points[0])), bodies[1].turn(&lifted(&points[1]))];
        // Centres first: far from the origin their difference is exact where arms are not.
        let between = difference(&bodies[1].place, &bodies[0].place);
        Self { arms, x: sum(&between, &difference(&arms[1], &arms[0])) }
    }

    #[inline(always)]
    pub(super) fn carried(&self, motions: [&Motion; 2]) -> Varied {
        let first = motions[0].carry_point(self.arms[0]);
        let second = motions[1].carry_point(self.arms[1]);
        Varied {
            x: self.x,
            rate: difference(&second.rate, &first.rate),
            moved: difference(&second.moved, &first.moved),
            change: difference(&second.change, &first.change),
        }
    }

    /// Adds those of cᵀδd.
    #[inline(always)]
    pub(super) fn add_wrenches(&self, c: &[f64; 3], out: &mut [Wrench; 2]) {
        add_scaled(&mut out[0][0], -1.0, c);
        add_scaled(&mut out[0][1], -1.0, &cross(&self.arms[0], c));
        add_scaled(&mut out[1][0], 1.0, c);
        add_scaled(&mut out[1][1], 1.0, &cross(&self.arms[1], c));
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> Measure<S, D, N, R> {
    #[inline(always)]
    pub(super) fn link_at(&self, bodies: [&Stance; 2]) -> Link {
        if self.uses_link { Link::new(&self.points, bodies) } else { Link::default() }
    }
}

impl<const D: usize> Vector<D> {
    #[inline(always)]
    fn stands(&self, bodies: [&Stance; 2], link: &Link) -> [f64; 3] {
        match self {
            Self::First(a) => bodies[0].turn(&lifted(a)),
            Self::Second(a) => bodies[1].turn(&lifted(a)),
            Self::Link => link.x,
        }
    }

    #[inline(always)]
    fn varies(&self, bodies: [&Stance; 2], motions: [&Motion; 2], link: &Varied) -> Varied {
        match self {
            Self::First(a) => motions[0].carry(bodies[0].turn(&lifted(a))),
            Self::Second(a) => motions[1].carry(bodies[1].turn(&lifted(a))),
            Self::Link => *link,
        }
    }

    /// Adds the wrenches of cᵀδx, x being this vector.
    #[inline(always)]
    fn add_wrenches(&self, x: &[f64; 3], c: &[f64; 3], link: &Link, out: &mut [Wrench; 2]) {
        match self {
            Self::First(_) => add_scaled(&mut out[0][1], 1.0, &cross(x, c)),
            Self::Second(_) => add_scaled(&mut out[1][1], 1.0, &cross(x, c)),
            Self::Link => link.add_wrenches(c, out),
        }
    }
}

impl<S: Space<D, N, R>, const D: usize, const N: usize, const R: usize> MotionRows
    for Measure<S, D, N, R>
{
    fn value_at(&self, bodies: [&Stance; 2], u: &mut [f64; 6]) {
        let link = self.link_at(bodies);
        if self.coincide {
            u[..D].copy_from_slice(&link.x[..D]);
        }
        for (row, Dot { x, y, scale, offset }) in (self.first_dot()..).zip(&self.dots) {
            u[row] = (dot(&x.stands(bodies, &link), &y.stands(bodies, &link)) - offset) * scale;
        }
    }

    fn wrenches(&self, bodies: [&Stance; 2], out: &mut [[Wrench; 2]; 6]) {
        let link = self.link_at(bodies);
        out[..self.rows()].fill([[[0.0; 3]; 2]; 2]);
        if self.coincide {
            for (d, out) in out[..D].iter_mut().enumerate() {
                let mut along = [0.0; 3];
                along[d] = 1.0;
                link.add_wrenches(&along, out);
            }
        }
        for (out, dot) in out[self.first_dot()..].iter_mut().zip(&self.dots) {
            let (x, y) = (dot.x.stands(bodies, &link), dot.y.stands(bodies, &link));
            dot.x.add_wrenches(&x, &scaled(&y, dot.scale), &link, out);
            dot.y.add_wrenches(&y, &scaled(&x, dot.scale), &link, out);
        }
    }

    fn rate_changes(&self, bodies: [&Stance; 2], motions: [&Motion; 2], u: &mut [f64; 6]) {
        let link = self.link_at(bodies);
        let carried = if self.uses_link { link.carried(motions) } else { Varied::default() };
        if self.coincide {
            u[..D].copy_from_slice(&carried.change[..D]);
        }
        for (row, Dot { x, y, scale, .. }) in (self.first_dot()..).zip(&self.dots) {
            let (x, y) = (x.varies(bodies, motions, &carried), y.varies(bodies, motions, &carried));
            let straight = dot(&x.x, &y.change) + dot(&x.change, &y.x);
            u[row] = (straight + dot(&x.rate, &y.moved) + dot(&x.moved, &y.rate)) * scale;
        }
    }
}
