//! The equations of one joint, driver or force between two bodies, with their derivative blocks.
//!
//! A joint or driver sees the poses and rates of its first and second body as arrays of N coordinates:
//! planar N = 3 (x, y, angle), spatial N = 7 (r, Euler parameters); r is the centre of mass. A force sees
//! how they stand and move ([`body`]). The ground passes the identity pose and zero rates. An element knows
//! nothing of other bodies, of numbering, integration or files.

mod angle;
pub mod body;
pub mod constraint;
mod drivers;
mod forces;
mod joints;
pub mod kinematics;
mod measure;
pub mod motion;
pub mod planar;
pub mod relative;
pub mod row;
pub(crate) mod space;
pub mod spatial;
#[cfg(test)]
mod tests;
mod turning;
mod vector_function;

use crate::math::Real;
use body::Body;
use motion::MotionRows;
use row::RowKind;

pub use forces::road_height;

/// Rows of one constraint against the coordinates of its two bodies: `[side][row][coordinate]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowBlocks<T, const N: usize>(pub [[[T; N]; 6]; 2]);

/// Blocks between the coordinates of two bodies: `[side][side][row][column]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairBlocks<T, const N: usize>(pub [[[[T; N]; N]; 2]; 2]);

/// Services of a constraint between two bodies, Φ = u(q) − s(t) with u one to six rows.
///
/// `w`, `v` are vectors over the coordinates of both bodies; G = u_q; H_k is the Hessian of row k.
/// Outputs are overwritten; rows from [`rows`](Self::rows) on are zero. All derivatives are exact
/// for every q, also where Euler parameters are not of unit length.
pub trait ConstraintElement<const N: usize> {
    /// Number of rows, 1 to 6.
    fn rows(&self) -> usize;
    /// What row `row` prescribes.
    fn row_kind(&self, row: usize) -> RowKind;
    /// u(q): metres, or direction cosines.
    fn value<T: Real>(&self, q: [&[T; N]; 2], u: &mut [T; 6]);
    /// G.
    fn jacobian<T: Real>(&self, q: [&[T; N]; 2], out: &mut RowBlocks<T, N>);
    /// G v.
    fn rate<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]);
    /// u, G v, and G a + (G v)_q v, from the same vectors.
    fn value_and_rates<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
    ) -> [[T; 6]; 3];
    /// (G w)_q: row k is wᵀ H_k.
    fn directional<T: Real>(&self, q: [&[T; N]; 2], w: [&[T; N]; 2], out: &mut RowBlocks<T, N>);
    /// (G v)_q v.
    fn curvature<T: Real>(&self, q: [&[T; N]; 2], v: [&[T; N]; 2], out: &mut [T; 6]);
    /// (G v)_q, and (G a)_q + ((G v)_q v)_q with v and a constant: what velocities and accelerations make of the rows.
    fn rate_blocks<T: Real>(
        &self,
        q: [&[T; N]; 2],
        v: [&[T; N]; 2],
        a: [&[T; N]; 2],
        out: &mut [RowBlocks<T, N>; 2],
    );
    /// Σ c_k H_k, symmetric.
    fn hessian<T: Real>(&self, q: [&[T; N]; 2], c: &[T; 6], out: &mut PairBlocks<T, N>);
    /// Whether that can differ from zero between the two bodies.
    fn couples(&self) -> bool;
    /// s, ṡ, s̈, s⃛ of a driver at time t; `None` for a joint.
    fn drive(&self, t: f64) -> Option<[f64; 4]>;
    /// Whether that is more than a constant.
    fn is_driven(&self) -> bool;
    /// u from how the bodies stand and move; not for angles, whose turns a stance does not tell.
    fn on_motions(&self) -> Option<&dyn MotionRows>;
    /// Whether u is an angle whose whole turns have no meaning: then u − s(t) is to be reduced to
    /// (−π, π].
    fn wraps(&self) -> bool;
    /// The joint's point on the second body, m, body axes, from its centre of mass: the place to
    /// which reaction force and torque refer.
    fn point_on_second(&self) -> [f64; 3];
    /// Relative coordinates of the joint and their rates, offered as channels.
    fn quantities(&self) -> &'static [Quantity];
    /// Whether a relative coordinate is an angle that a pose tells up to whole turns only.
    fn counts_turns(&self) -> bool;
    /// The joint's angle on the branch nearest to `winding`, rad; 0 for joints without one.
    fn angle(&self, q: [&[f64; N]; 2], winding: f64) -> f64;
    /// Value of quantity `index`; an angle is that on the branch nearest to `winding`.
    fn quantity(
        &self,
        index: usize,
        q: [&[f64; N]; 2],
        v: [&[f64; N]; 2],
        winding: f64,
        out: &mut [f64],
    );
}

/// Scalars of one force along which its law has local features, at most.
pub const MOST_ARGUMENTS: usize = 4;

/// Where a scalar stands along which a force law has local features.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LawPlace {
    /// Its value.
    pub value: f64,
    /// Its rate; 0 for a velocity, whose rate would take accelerations.
    pub rate: f64,
    /// How fast the direction may turn that it depends on, rad/s.
    pub turning: f64,
    /// Up to which size of a velocity the law has no feature as things stand; 0 for others.
    pub smooth: f64,
}

/// What a force sees.
#[derive(Debug, Clone, Copy)]
pub struct ForceInput<'a, T, const D: usize, const N: usize, const W: usize> {
    /// Time, s.
    pub t: T,
    /// The first and the second body.
    pub bodies: [Body<T, D, N, W>; 2],
    /// Extra states of the element.
    pub z: &'a [T],
    /// Angle (rad) at the last accepted step of an element that counts turns: the element takes the
    /// branch of its angle nearest to it. Ignored by the others.
    pub winding: f64,
}

impl<T, const D: usize, const N: usize, const W: usize> ForceInput<'_, T, D, N, W> {
    #[inline(always)]
    fn pair(&self) -> [&Body<T, D, N, W>; 2] {
        [&self.bodies[0], &self.bodies[1]]
    }

    #[inline(always)]
    fn twists(&self) -> [&[T; W]; 2] {
        [&self.bodies[0].twist, &self.bodies[1].twist]
    }
}

/// Force (N) and moment about the centre of mass (N m) on the first and the second body, ground axes; or numbers on the
/// displacements or twists of both.
pub type Wrenches<T, const W: usize> = [[T; W]; 2];

/// A force with its derivatives. δξ is the displacement of a body as [`Body`] has its twist, y the twist; each is
/// taken with the components of the other one fixed. Derivatives of wrenches w are those of −w, as they resist.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForceBlocks<T, const W: usize> {
    /// w.
    pub wrenches: Wrenches<T, W>,
    /// −w_ξ, `[felt][moved][row][column]`.
    pub k: PairBlocks<T, W>,
    /// −w_y.
    pub c: PairBlocks<T, W>,
    /// Whether w depends on twists: c is zero else.
    pub damped: bool,
    /// −w_t.
    pub t: Wrenches<T, W>,
}

/// What the extra states of one force do, and what is done to them: derivatives as in [`ForceBlocks`], of as many states as the
/// element has.
#[derive(Debug)]
pub struct ExtraRows<'a, T, const W: usize> {
    /// −w_z, state by state.
    pub force: &'a mut [Wrenches<T, W>],
    /// ż_ξ.
    pub by_displacement: &'a mut [Wrenches<T, W>],
    /// ż_y.
    pub by_twist: &'a mut [Wrenches<T, W>],
    /// ż_z, by rows.
    pub own: &'a mut [T],
    /// ż_t.
    pub time: &'a mut [T],
}

/// Energy terms of a force: its power is −d(potential)/dt − dissipated + supplied.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energy {
    /// Potential energy, J (extra states' springs included).
    pub potential: f64,
    /// Dissipated power, W, not negative for dissipative elements.
    pub dissipated: f64,
    /// Power supplied from outside (applied forces, road), W.
    pub supplied: f64,
}

/// Measure of an extra state's errors, see [`ForceElement::extra_state_scales`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtraStateScale {
    /// Whether the state is an angle, rad; else a length, m.
    pub angle: bool,
    /// The error that counts like one.
    pub one: f64,
}

/// A named quantity that an element can compute.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Quantity {
    /// Name within the item: `length`, `force`, …
    pub name: &'static str,
    /// SI unit.
    pub unit: &'static str,
    /// `""`, `"ground"`, `"first"` or `"along"`.
    pub frame: &'static str,
    /// Number of components.
    pub size: usize,
}

/// Services of a force between two bodies.
pub trait ForceElement<const D: usize, const N: usize, const W: usize> {
    /// Number of extra states z, 0 where the element is unloaded.
    fn extra_states(&self) -> usize {
        0
    }
    /// Of each the error that counts like a metre or a metre per second of the element's points, or a radian or a radian per
    /// second between its bodies, whichever is the smaller error of the force.
    fn extra_state_scales(&self) -> Vec<ExtraStateScale> {
        Vec::new()
    }
    /// Whether the element counts turns (see [`ForceInput::winding`]).
    fn counts_turns(&self) -> bool {
        false
    }
    /// Whether the law turned over between two configurations of its bodies: a jump.
    fn turned_over(&self, _from: [&[f64; N]; 2], _to: [&[f64; N]; 2]) -> bool {
        false
    }
    /// The angle that is kept as winding, rad; 0 for elements that do not count turns.
    fn angle(&self, _bodies: [&Body<f64, D, N, W>; 2], _winding: f64) -> f64 {
        0.0
    }
    /// Wrenches and ż.
    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, D, N, W>,
        wrenches: &mut Wrenches<T, W>,
        z_rate: &mut [T],
    );
    /// Wrenches and their derivatives, those by extra states excepted.
    fn blocks<T: Real>(&self, input: &ForceInput<T, D, N, W>, out: &mut ForceBlocks<T, W>);
    /// Derivatives by extra states and of their rates.
    fn extra_rows<T: Real>(&self, _input: &ForceInput<T, D, N, W>, _out: &mut ExtraRows<'_, T, W>) {
    }
    /// Energy terms.
    fn energy(&self, input: &ForceInput<f64, D, N, W>) -> Energy;
    /// Quantities offered as channels.
    fn quantities(&self) -> &'static [Quantity];
    /// Value of quantity `index`, `size` components.
    fn quantity(&self, index: usize, input: &ForceInput<f64, D, N, W>, out: &mut [f64]);
    /// Times at which the element's time functions have a kink, s.
    fn breakpoints(&self) -> Vec<f64> {
        Vec::new()
    }
    /// Longest step from here that does not jump over a local feature of the law that lies ahead, s: spares a step that
    /// would be refused.
    fn longest_step(&self, _input: &ForceInput<f64, D, N, W>) -> f64 {
        f64::INFINITY
    }
    /// Knots, increasing, of each scalar along which the law has local features: the deformation of a law through a
    /// table, what a tyre is pressed in, its way along a road with an obstacle, the velocities of its slip. None of them
    /// for a line whose law is smooth: that has a local feature where it is short.
    fn knots(&self) -> Vec<Vec<f64>> {
        Vec::new()
    }
    /// How many of these scalars are velocities, the last ones.
    fn velocities(&self) -> usize {
        0
    }
    /// Where these scalars stand, in their order.
    fn arguments(&self, _input: &ForceInput<f64, D, N, W>, _out: &mut [LawPlace]) {}
    /// What the law makes of the scalar, in whatever unit: the measure of what a step may pass over.
    fn profile(&self, _index: usize, _argument: f64) -> f64 {
        0.0
    }
}

impl<T: Real, const N: usize> RowBlocks<T, N> {
    /// All entries zero.
    #[inline(always)]
    pub fn zero() -> Self {
        Self([[[T::zero(); N]; 6]; 2])
    }

    #[inline(always)]
    fn set(&mut self, row: usize, values: &[[T; N]; 2]) {
        for side in 0..2 {
            self.0[side][row] = values[side];
        }
    }
}

impl<T: Real, const N: usize> PairBlocks<T, N> {
    /// All entries zero.
    pub fn zero() -> Self {
        Self([[[[T::zero(); N]; N]; 2]; 2])
    }

    /// All entries in one row.
    pub fn entries(&self) -> &[T] {
        self.0.as_flattened().as_flattened().as_flattened()
    }

    fn entries_mut(&mut self) -> &mut [T] {
        self.0.as_flattened_mut().as_flattened_mut().as_flattened_mut()
    }

    /// Makes it factor · a bᵀ.
    #[inline(always)]
    fn set_outer(&mut self, factor: T, a: &[[T; N]; 2], b: &[[T; N]; 2]) {
        for s in 0..2 {
            for i in 0..N {
                let f = factor * a[s][i];
                for t in 0..2 {
                    for j in 0..N {
                        self.0[s][t][i][j] = f * b[t][j];
                    }
                }
            }
        }
    }

    /// Adds factor · a bᵀ.
    #[inline(always)]
    fn add_outer(&mut self, factor: T, a: &[[T; N]; 2], b: &[[T; N]; 2]) {
        for s in 0..2 {
            for i in 0..N {
                let f = factor * a[s][i];
                for t in 0..2 {
                    for j in 0..N {
                        self.0[s][t][i][j] += f * b[t][j];
                    }
                }
            }
        }
    }
}

impl<T: Real, const W: usize> ForceBlocks<T, W> {
    /// All entries zero.
    pub fn zero() -> Self {
        let o = [[T::zero(); W]; 2];
        Self { wrenches: o, k: PairBlocks::zero(), c: PairBlocks::zero(), damped: false, t: o }
    }

    /// All entries zero but those of w and k, which are still to be set, as are those of c where w is damped: most blocks
    /// are full, and to clear them first costs a good part of what making them does.
    #[inline(always)]
    fn begin(&mut self, damped: bool) {
        self.t = [[T::zero(); W]; 2];
        self.damped = damped;
        if !damped {
            self.c = PairBlocks::zero();
        }
    }

    /// Adds the blocks of another force between the same bodies.
    #[inline(always)]
    pub fn add(&mut self, other: &Self) {
        #[inline(always)]
        fn add_up<T: Real>(to: &mut [T], from: &[T]) {
            to.iter_mut().zip(from).for_each(|(to, from)| *to += *from);
        }
        add_up(self.wrenches.as_flattened_mut(), other.wrenches.as_flattened());
        add_up(self.k.entries_mut(), other.k.entries());
        add_up(self.t.as_flattened_mut(), other.t.as_flattened());
        if other.damped {
            self.damped = true;
            add_up(self.c.entries_mut(), other.c.entries());
        }
    }
}

/// The blocks of one row each.
#[inline(always)]
fn set_first<T: Real, const N: usize>(rows: &[[[T; N]; 2]; 2], out: &mut [RowBlocks<T, N>; 2]) {
    for (out, row) in out.iter_mut().zip(rows) {
        *out = RowBlocks::zero();
        out.set(0, row);
    }
}

/// aᵀb over the numbers of both bodies.
#[inline(always)]
fn product<T: Real, const N: usize>(a: &[[T; N]; 2], b: [&[T; N]; 2]) -> T {
    crate::math::vector::dot(&a[0], b[0]) + crate::math::vector::dot(&a[1], b[1])
}
