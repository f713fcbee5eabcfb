use super::quantity;
use crate::elements::body::{Body, Link, Rigid, angular};
use crate::elements::space::{Spatial, Triad, euler};
use crate::elements::{
    Energy, ExtraRows, ExtraStateScale, ForceBlocks, ForceElement, ForceInput, PairBlocks,
    Quantity, Wrenches,
};
use crate::math::Real;
use crate::math::spatial::{conjugate, cross, euler_parameters, product};
use crate::math::vector::{add_scaled, difference, dot, lift, sum};
use crate::model;

const QUANTITIES: &[Quantity] = &[
    quantity("deformation", "m, rad", "first", 6),
    quantity("force", "N", "first", 3),
    quantity("torque", "N m", "first", 3),
    quantity("branch_force", "N", "first", 3),
    quantity("branch_torque", "N m", "first", 3),
];
/// Of these, what a bushing without branches has.
const ELASTIC: usize = 3;

/// Displacements that it can tell apart: r_j − r_i, φ_i, φ_j.
const PACKED: usize = 9;
type Packed<T> = [[T; PACKED]; 6];

/// Linear 6×6 bushing between two frames; acts at the second frame's point.
///
/// ```text
/// u = (d, e),   d_k = a_kᵀx,   e_k = 2 sign(ε₀) ε_k,   W = K u + C u̇,   w = −u_ξᵀ W
/// −w_ξ = u_ξᵀ (K u_ξ + C u̇_ξ) + Σ W_k (u_kξᵀ)_ξ,   −w_y = u_ξᵀ C u_ξ
/// ```
///
/// x is the link of the points, a_k = f, g, h of the first frame, ε the Euler parameters of the second frame against it.
/// With ρ = ω_j − ω_i, b the arm of the second point from the first centre of mass and ε as a vector in space,
///
/// ```text
/// u̇_k = a_kᵀy,  y = ẋ − ω_i × x               u̇_3+k = j_kᵀρ,  j_k = sign(ε₀) (ε₀ a_k − a_k × ε)
/// δd_k = a_kᵀ(δr_j − δr_i) − (b × a_k)ᵀδφ_i + (s_j × a_k)ᵀδφ_j     δe_k = j_kᵀ(δφ_j − δφ_i)
/// ```
///
/// With C = 0 the force is the gradient of ½ uᵀK u, so it is conservative at every amplitude. The moment on the second body
/// about its point is −sign(ε₀) (ε₀ I + ε̃) W_e in axes of the first frame. e turns over at half a turn, where the moment is
/// smooth unless W_e has parts of displacements or of branches, or W_d parts of rotations.
///
/// Branches of springs K_b and dampers C_b in series make it viscoelastic (generalized Maxwell model; with one branch the
/// standard linear solid). The extra states z_b are the extensions of their springs, in the directions in which these are:
///
/// ```text
/// W = K u + C u̇ + Σ K_b z_b      ż_b = u̇ − C_b⁻¹K_b z_b
/// −w_z = u_ξᵀ K_b,   ż_ξ = u̇_ξ,   ż_y = u_ξ,   ż_z = −C_b⁻¹K_b
/// ```
///
/// Source: virtual work; Euler parameters after Haug (1989), 9.3; branches after J. D. Ferry, *Viscoelastic Properties of
/// Polymers* (1980), chapter 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Bushing {
    points: [[f64; 3]; 2],
    /// f, g, h of the first frame.
    axes: [[f64; 3]; 3],
    /// Euler parameters of the frames in their bodies.
    frames: [[f64; 4]; 2],
    stiffness: [[f64; 6]; 6],
    damping: [[f64; 6]; 6],
    damped: bool,
    /// Whether loads change with the sign of e: where displacements and rotations make each other's, or branches remember it.
    jumps: bool,
    branches: Vec<Branch>,
}

/// A spring and a damper in series, on the directions of the spring.
#[derive(Debug, Clone, PartialEq)]
struct Branch {
    /// Place of its first state among those of the bushing.
    first: usize,
    directions: Vec<usize>,
    /// K_b by rows.
    stiffness: Vec<f64>,
    /// C_b⁻¹K_b by rows, 1/s.
    relaxation: Vec<f64>,
    /// Of each state the error that counts like one of its rate.
    scales: Vec<f64>,
}

impl Branch {
    fn new(first: usize, branch: &model::Branch) -> Self {
        let directions: Vec<usize> = branch.directions().collect();
        let part = |matrix: &[[f64; 6]; 6]| -> Vec<f64> {
            directions.iter().flat_map(|&i| directions.iter().map(move |&j| matrix[i][j])).collect()
        };
        let stiffness = part(&branch.stiffness);
        let scale = |&k: &usize| branch.damping[k][k] / branch.stiffness[k][k];
        let scales = directions.iter().map(scale).collect();
        let relaxation = solved(part(&branch.damping), stiffness.clone());
        Self { first, directions, stiffness, relaxation, scales }
    }

    /// Its states, with the direction of each.
    fn states(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (self.first..).zip(self.directions.iter().copied())
    }

    /// A z of a matrix over its directions, in place `row`.
    #[inline(always)]
    fn product<T: Real>(&self, matrix: &[f64], row: usize, z: &[T]) -> T {
        let n = self.directions.len();
        let row = matrix[row * n..].iter().zip(&z[self.first..]).take(n);
        row.fold(T::zero(), |sum, (a, z)| sum + *z * *a)
    }
}

/// A⁻¹B of a positive definite A, both by rows.
fn solved(mut a: Vec<f64>, mut b: Vec<f64>) -> Vec<f64> {
    let n = a.len().isqrt();
    for k in 0..n {
        for i in (0..n).filter(|&i| i != k) {
            let multiple = a[i * n + k] / a[k * n + k];
            for j in 0..n {
                a[i * n + j] -= multiple * a[k * n + j];
                b[i * n + j] -= multiple * b[k * n + j];
            }
        }
    }
    b.iter().enumerate().map(|(at, x)| x / a[at / n * (n + 1)]).collect()
}

/// The bushing in one configuration; vectors in axes of the ground, ε in those of the first frame too.
struct Deformation<T> {
    link: Link<T, 3>,
    /// a_k.
    axes: [[T; 3]; 3],
    /// b.
    arm: [T; 3],
    sign: f64,
    epsilon: [T; 4],
    epsilon_in_space: [T; 3],
    /// y and ρ.
    speed: [T; 3],
    spin: [T; 3],
    u: [T; 6],
    rate: [T; 6],
}

/// Σ c_k a_k.
#[inline(always)]
fn combined<T: Real>(c: &[T], axes: &[[T; 3]; 3]) -> [T; 3] {
    std::array::from_fn(|d| c[0] * axes[0][d] + c[1] * axes[1][d] + c[2] * axes[2][d])
}

impl Bushing {
    pub(in crate::elements) fn new(
        frames: &[Triad<3>; 2],
        stiffness: &[[f64; 6]; 6],
        damping: &[[f64; 6]; 6],
        branches: &[model::Branch],
    ) -> Self {
        let turned = frames.map(|frame| {
            let columns = frame.axes;
            euler_parameters(&std::array::from_fn(|row| columns.map(|axis| axis[row])))
        });
        let points = [frames[0].point, frames[1].point];
        let damped = damping.iter().flatten().any(|&c| c != 0.0);
        let couples = |m: &[[f64; 6]; 6]| {
            (0..6).any(|i| (0..6).any(|j| (i < 3) != (j < 3) && m[i][j] != 0.0))
        };
        let jumps = [stiffness, damping].into_iter().any(couples)
            || branches.iter().any(|branch| branch.directions().any(|direction| direction >= 3));
        let (axes, stiffness, damping) = (frames[0].axes, *stiffness, *damping);
        let mut first = 0;
        let branch = |branch: &model::Branch| {
            let branch = Branch::new(first, branch);
            first += branch.directions.len();
            branch
        };
        let branches = branches.iter().map(branch).collect();
        Self { points, axes, frames: turned, stiffness, damping, damped, jumps, branches }
    }

    /// Euler parameters of the second frame against the first.
    #[inline(always)]
    fn orientation<T: Real>(&self, poses: [&[T; 7]; 2]) -> [T; 4] {
        let [pi, pj] =
            [0, 1].map(|side| product(&euler(poses[side]), &lift::<T, 4>(&self.frames[side])));
        product(&conjugate(&pi), &pj)
    }

    #[inline(always)]
    fn deformation<T: Real>(&self, bodies: [&Body<T, 3, 7, 6>; 2]) -> Deformation<T> {
        let link = Link::new(&self.points, bodies);
        let axes = [0, 1, 2].map(|k| bodies[0].turn(&self.axes[k]));
        let epsilon = self.orientation(bodies.map(|body| &body.pose));
        let sign = 1.0_f64.copysign(epsilon[0].value());
        let [first, second] = bodies.map(|body| angular(&body.twist));
        let spin = difference(&second, &first);
        let speed = difference(&link.speed::<Spatial, 7, 6>(bodies), &cross(&first, &link.x));
        let epsilon_in_space = combined(&epsilon[1..], &axes);
        let mut out = Deformation {
            arm: sum(&link.arms[0], &link.x),
            link,
            axes,
            sign,
            epsilon,
            epsilon_in_space,
            speed,
            spin,
            u: [T::zero(); 6],
            rate: [T::zero(); 6],
        };
        for k in 0..3 {
            out.u[k] = dot(&axes[k], &out.link.x);
            out.u[3 + k] = epsilon[1 + k] * (2.0 * sign);
            out.rate[k] = dot(&axes[k], &speed);
            out.rate[3 + k] = dot(&out.turning_row(k), &spin);
        }
        out
    }

    /// W.
    #[inline(always)]
    fn load<T: Real>(&self, at: &Deformation<T>, z: &[T]) -> [T; 6] {
        let mut load = self.parallel_load(&at.u, &at.rate);
        if !self.branches.is_empty() {
            self.add_branches(z, &mut load);
        }
        load
    }

    /// Adds Σ K_b z_b.
    fn add_branches<T: Real>(&self, z: &[T], load: &mut [T; 6]) {
        for branch in &self.branches {
            for (row, &k) in branch.directions.iter().enumerate() {
                load[k] += branch.product(&branch.stiffness, row, z);
            }
        }
    }

    /// K u + C u̇.
    #[inline(always)]
    fn parallel_load<T: Real>(&self, u: &[T; 6], rate: &[T; 6]) -> [T; 6] {
        let mut load = [T::zero(); 6];
        for i in 0..6 {
            for j in 0..6 {
                load[i] += u[j] * self.stiffness[i][j] + rate[j] * self.damping[i][j];
            }
        }
        load
    }
}

impl<T: Real> Deformation<T> {
    /// j_k.
    #[inline(always)]
    fn turning_row(&self, k: usize) -> [T; 3] {
        let x = cross(&self.axes[k], &self.epsilon_in_space);
        std::array::from_fn(|d| (self.epsilon[0] * self.axes[k][d] - x[d]) * self.sign)
    }

    /// Force on the second body and moment about its point, W_e as a vector in space, and the wrenches.
    #[inline(always)]
    fn wrenches(&self, load: &[T; 6]) -> ([[T; 3]; 3], [[T; 6]; 2]) {
        let force = combined(&load[..3], &self.axes).map(|x| -x);
        let turning = combined(&load[3..], &self.axes);
        let x = cross(&self.epsilon_in_space, &turning);
        let moment: [T; 3] =
            std::array::from_fn(|d| (self.epsilon[0] * turning[d] + x[d]) * -self.sign);
        let mut first = Spatial::wrench(&force, &self.arm).map(|x| -x);
        let mut second = Spatial::wrench(&force, &self.link.arms[1]);
        for d in 0..3 {
            first[3 + d] -= moment[d];
            second[3 + d] += moment[d];
        }
        ([force, moment, turning], [first, second])
    }

    /// u_ξ.
    #[inline(always)]
    fn rows(&self) -> Packed<T> {
        let o = [T::zero(); 3];
        std::array::from_fn(|k| {
            if k < 3 {
                let a = &self.axes[k];
                pack(a, &cross(a, &self.arm), &cross(&self.link.arms[1], a))
            } else {
                let j = self.turning_row(k - 3);
                pack(&o, &j.map(|x| -x), &j)
            }
        })
    }

    /// u̇_ξ at fixed twists.
    #[inline(always)]
    fn rate_rows(&self, first_spin: &[T; 3]) -> Packed<T> {
        let (o, spin) = ([T::zero(); 3], &self.spin);
        let along = dot(spin, &self.epsilon_in_space);
        std::array::from_fn(|k| {
            let a = &self.axes[k % 3];
            let across = cross(a, spin);
            if k < 3 {
                let second = cross(&self.link.arms[1], &across);
                return pack(&cross(first_spin, a), &cross(a, &self.speed), &second);
            }
            let j = self.turning_row(k - 3);
            let about = dot(a, spin);
            let half: [T; 3] = std::array::from_fn(|d| {
                let straight = along * a[d] - about * self.epsilon_in_space[d];
                let bent = self.epsilon[0] * across[d] - self.epsilon[k - 2] * spin[d];
                (straight + bent) * (0.5 * self.sign)
            });
            let carried = cross(&j, spin);
            pack(&o, &difference(&carried, &half), &half)
        })
    }

    /// Σ W_k (u_kξᵀ)_ξ: forces, moments on the first and on the second body.
    #[inline(always)]
    fn bend(&self, [force, moment, turning]: &[[T; 3]; 3]) -> [[T; PACKED]; PACKED] {
        let mut out = [[T::zero(); PACKED]; PACKED];
        let (e, arm, own) = (&self.epsilon_in_space, &self.arm, &self.link.arms[1]);
        let half = 0.5 * self.sign;
        let along = dot(e, turning);
        let (by_arm, by_own) = (dot(arm, force), dot(own, force));
        let [f, n, w] = [force, moment, turning].map(tilde);
        for r in 0..3 {
            for c in 0..3 {
                let mut h = e[r] * turning[c] - turning[r] * e[c] - self.epsilon[0] * w[r][c];
                let mut carried = -(force[r] * arm[c]);
                let mut swing = own[r] * force[c];
                let mut own_carried = force[r] * own[c];
                if r == c {
                    h -= along;
                    carried += by_arm;
                    swing -= by_own;
                    own_carried -= by_own;
                }
                h *= half;
                out[r][3 + c] = f[r][c];
                out[3 + r][c] = -f[r][c];
                out[3 + r][3 + c] = h - n[r][c] + carried;
                out[3 + r][6 + c] = swing - h;
                out[6 + r][3 + c] = own_carried + n[r][c] - h;
                out[6 + r][6 + c] = h - swing;
            }
        }
        out
    }
}

/// ã.
#[inline(always)]
fn tilde<T: Real>(a: &[T; 3]) -> [[T; 3]; 3] {
    let o = T::zero();
    [[o, -a[2], a[1]], [a[2], o, -a[0]], [-a[1], a[0], o]]
}

#[inline(always)]
fn pack<T: Real>(a: &[T; 3], b: &[T; 3], c: &[T; 3]) -> [T; PACKED] {
    [a[0], a[1], a[2], b[0], b[1], b[2], c[0], c[1], c[2]]
}

/// out += M rows, skipping the zeros of M (most bushings are diagonal).
#[inline(always)]
fn add_product<T: Real>(m: &[[f64; 6]; 6], rows: &Packed<T>, out: &mut Packed<T>) {
    for i in 0..6 {
        for j in 0..6 {
            if m[i][j] != 0.0 {
                add_scaled(&mut out[i], T::from(m[i][j]), &rows[j]);
            }
        }
    }
}

/// out += leftᵀ right.
#[inline(always)]
fn add_square<T: Real>(left: &Packed<T>, right: &Packed<T>, out: &mut [[T; PACKED]; PACKED]) {
    for k in 0..6 {
        // Rows of rotations do not depend on places.
        for r in if k < 3 { 0 } else { 3 }..PACKED {
            add_scaled(&mut out[r], left[k][r], &right[k]);
        }
    }
}

/// Where a packed number goes: body and place there; those of r_j − r_i go to the first body too, with a minus.
#[inline(always)]
fn unpack<T: Real>(square: &[[T; PACKED]; PACKED]) -> PairBlocks<T, 6> {
    let mut out = PairBlocks::zero();
    for r in 0..3 {
        let [force, first, second] = [r, 3 + r, 6 + r].map(|r| unpack_row(&square[r]));
        for moved in 0..2 {
            out.0[0][moved][r] = force[moved].map(|x| -x);
            out.0[1][moved][r] = force[moved];
            out.0[0][moved][3 + r] = first[moved];
            out.0[1][moved][3 + r] = second[moved];
        }
    }
    out
}

#[inline(always)]
fn unpack_row<T: Real>(x: &[T; PACKED]) -> Wrenches<T, 6> {
    [[-x[0], -x[1], -x[2], x[3], x[4], x[5]], [x[0], x[1], x[2], x[6], x[7], x[8]]]
}

impl ForceElement<3, 7, 6> for Bushing {
    fn extra_states(&self) -> usize {
        self.branches.iter().map(|branch| branch.directions.len()).sum()
    }

    fn extra_state_scales(&self) -> Vec<ExtraStateScale> {
        let scales = self.branches.iter().flat_map(|b| b.directions.iter().zip(&b.scales));
        scales.map(|(k, scale)| ExtraStateScale { angle: *k >= 3, one: scale.min(1.0) }).collect()
    }

    fn turned_over(&self, from: [&[f64; 7]; 2], to: [&[f64; 7]; 2]) -> bool {
        self.jumps && {
            let [before, after] = [from, to].map(|poses| self.orientation(poses));
            // Both signs are one orientation: the nearer one.
            before[0] * after[0] * dot(&before, &after) < 0.0
        }
    }

    fn evaluate<T: Real>(
        &self,
        input: &ForceInput<T, 3, 7, 6>,
        wrenches: &mut Wrenches<T, 6>,
        z_rate: &mut [T],
    ) {
        let at = self.deformation(input.pair());
        *wrenches = at.wrenches(&self.load(&at, input.z)).1;
        for branch in &self.branches {
            for (row, (state, k)) in branch.states().enumerate() {
                z_rate[state] = at.rate[k] - branch.product(&branch.relaxation, row, input.z);
            }
        }
    }

    fn blocks<T: Real>(&self, input: &ForceInput<T, 3, 7, 6>, out: &mut ForceBlocks<T, 6>) {
        *out = ForceBlocks::zero();
        let at = self.deformation(input.pair());
        let (acting, wrenches) = at.wrenches(&self.load(&at, input.z));
        out.wrenches = wrenches;
        let rows = at.rows();
        let mut weighted = [[T::zero(); PACKED]; 6];
        add_product(&self.stiffness, &rows, &mut weighted);
        out.damped = self.damped;
        if self.damped {
            let rate_rows = at.rate_rows(&angular(&input.bodies[0].twist));
            add_product(&self.damping, &rate_rows, &mut weighted);
            let mut damped = [[T::zero(); PACKED]; 6];
            add_product(&self.damping, &rows, &mut damped);
            let mut square = [[T::zero(); PACKED]; PACKED];
            add_square(&rows, &damped, &mut square);
            out.c = unpack(&square);
        }
        let mut square = at.bend(&acting);
        add_square(&rows, &weighted, &mut square);
        out.k = unpack(&square);
    }

    fn extra_rows<T: Real>(&self, input: &ForceInput<T, 3, 7, 6>, out: &mut ExtraRows<'_, T, 6>) {
        let (at, count) = (self.deformation(input.pair()), out.time.len());
        let rows = at.rows();
        let rate_rows = at.rate_rows(&angular(&input.bodies[0].twist));
        out.time.fill(T::zero());
        out.own.fill(T::zero());
        for branch in &self.branches {
            let n = branch.directions.len();
            for (row, (state, k)) in branch.states().enumerate() {
                let mut force = [T::zero(); PACKED];
                for (column, &other) in branch.directions.iter().enumerate() {
                    let (of, at) = (row * n + column, state * count + branch.first + column);
                    add_scaled(&mut force, T::from(branch.stiffness[of]), &rows[other]);
                    out.own[at] = T::from(-branch.relaxation[of]);
                }
                out.force[state] = unpack_row(&force);
                out.by_displacement[state] = unpack_row(&rate_rows[k]);
                out.by_twist[state] = unpack_row(&rows[k]);
            }
        }
    }

    fn energy(&self, input: &ForceInput<f64, 3, 7, 6>) -> Energy {
        let Deformation { u, rate, .. } = self.deformation(input.pair());
        let zero = [0.0; 6];
        let mut out = Energy {
            potential: 0.5 * dot(&u, &self.parallel_load(&u, &zero)),
            dissipated: dot(&rate, &self.parallel_load(&zero, &rate)),
            supplied: 0.0,
        };
        for branch in &self.branches {
            for (row, (state, _)) in branch.states().enumerate() {
                let force = branch.product(&branch.stiffness, row, input.z);
                out.potential += 0.5 * force * input.z[state];
                out.dissipated += force * branch.product(&branch.relaxation, row, input.z);
            }
        }
        out
    }

    fn quantities(&self) -> &'static [Quantity] {
        if self.branches.is_empty() { &QUANTITIES[..ELASTIC] } else { QUANTITIES }
    }

    fn quantity(&self, index: usize, input: &ForceInput<f64, 3, 7, 6>, out: &mut [f64]) {
        let at = self.deformation(input.pair());
        if index == 0 {
            out[..6].copy_from_slice(&at.u);
            return;
        }
        let mut load = [0.0; 6];
        if index < ELASTIC {
            load = self.load(&at, input.z);
        } else {
            self.add_branches(input.z, &mut load);
        }
        let ([force, moment, _], _) = at.wrenches(&load);
        let vector = if index % 2 == 1 { force } else { moment };
        for k in 0..3 {
            out[k] = dot(&at.axes[k], &vector);
        }
    }
}
