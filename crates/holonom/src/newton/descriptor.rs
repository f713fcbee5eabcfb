//! The matrix of the descriptor form: sparse, with a pattern analysed once.

use super::blocks::ReducedBlocks;
use super::descriptor_pattern::DescriptorPattern;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, Matrix, MatrixOptions};
use super::units::Units;
use crate::model::JacobianSource;
use crate::reduction::{BodyRows, Manifold, Point, Projection};
use crate::system::{DerivativeBlocks, Structure, System};
use holonom_linalg::{BlockMatrix, FrozenLu, SingularMatrix, dot};

/// Ψ = Ψ₀ + γh Ψ₁ + βh² Ψ₂ of the unknowns (q̈, λ), with D the null space of G, δv̈ = P δq̈:
///
/// ```text
/// Ψ₀ = [M Gᵀ; G 0]   Ψ₁ = [C D; A₂ D] P   Ψ₂ = [K D + C 𝒥; A₁ D + A₂ 𝒥] P
/// 𝒥 = −S A₀ D        A₂ = 2A₀
/// ```
///
/// The corrections fill the columns of independent coordinates. Where P is not a selection, v̈ becomes
/// an unknown of its own with the rows P q̈ − v̈ = 0, so that nothing fills n columns; rows of
/// moving rows of P have parts of Ψ₁ and Ψ₂ too, with (P q̇)_q for A₀ and (v̈)_q for A₁. Extra states are
/// eliminated: they add γh F_z E⁻¹ (βh² ż_v + γh ż_v̇).
///
/// The parts do not depend on h and serve again after a rejection. From a Jacobian by differences
/// only M̂₁ and M̂₂ are known: Pᵀ M̂₁ and Pᵀ M̂₂ take the place of the upper blocks, which leaves v̈
/// the same, as DᵀPᵀ = 1.
/// Source: thesis section 3.3, (3.76), (3.81)-(3.83).
#[derive(Debug, Clone)]
pub struct DescriptorMatrix {
    ndof: usize,
    coordinates: usize,
    /// Whether the parts are made of M̂₁ and M̂₂.
    reduced: bool,
    pattern: DescriptorPattern,
    values: Vec<f64>,
    units: Units,
    lu: FrozenLu,
    /// M, G and the moving rows of P of the linearization.
    mass: BlockMatrix,
    jacobian: Vec<f64>,
    moving: BodyRows,
    /// Parts of Ψ₁ and Ψ₂ before P: (n+m+moving rows)×ndof by rows.
    by_rate: Vec<f64>,
    by_position: Vec<f64>,
    sum: Vec<f64>,
    /// 𝒥, n×ndof.
    rate_by_position: Vec<f64>,
    right: Vec<f64>,
    response: Unknowns,
}

/// Residuals or corrections of the descriptor form.
#[derive(Debug, Clone, Default)]
pub struct Unknowns {
    /// Of M q̈ + Gᵀλ − Q = 0; of q̈.
    pub force: Vec<f64>,
    /// Of G q̈ − τ = 0; of λ.
    pub rows: Vec<f64>,
    /// Of the rows that define v̈; of v̈.
    pub rate: Vec<f64>,
}

impl Unknowns {
    /// Zeros for a manifold's present parametrization.
    pub fn new(manifold: &Manifold) -> Self {
        let sizes = manifold.system().structure().sizes;
        Self {
            force: vec![0.0; sizes.coordinates],
            rows: vec![0.0; sizes.rows],
            rate: vec![0.0; manifold.chart().ndof()],
        }
    }

    /// All entries in order.
    pub fn iter(&self) -> impl Iterator<Item = &f64> {
        self.force.iter().chain(&self.rows).chain(&self.rate)
    }
}

/// Growth of numbers in the elimination from which solutions are refined; before, corrections keep half
/// their digits and the iteration makes up for the rest.
const HARMLESS_GROWTH: f64 = 1e8;
/// What refinement may leave of the relative error before pivots are chosen anew.
const ACCURACY: f64 = 1e-6;

impl Matrix for DescriptorMatrix {
    fn new(manifold: &Manifold, q: &[f64], options: &MatrixOptions) -> Self {
        let structure = manifold.system().structure();
        let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
        let reduced = options.source == JacobianSource::Differences;
        let pattern = DescriptorPattern::new(manifold, q, reduced);
        let moving = manifold.chart().moving().clone();
        let ndof = manifold.chart().ndof();
        let dense = || vec![0.0; (n + m + moving.len()) * ndof];
        Self {
            ndof,
            coordinates: n,
            reduced,
            values: vec![0.0; pattern.pattern.len()],
            units: Units::new(manifold, q),
            lu: FrozenLu::new(HARMLESS_GROWTH, ACCURACY),
            mass: structure.mass_pattern.zeros(),
            jacobian: vec![0.0; structure.constraint_pattern.len()],
            by_rate: dense(),
            by_position: dense(),
            sum: dense(),
            rate_by_position: vec![0.0; n * ndof],
            right: vec![0.0; pattern.size],
            response: Unknowns::new(manifold),
            pattern,
            moving,
        }
    }

    /// D and the derivatives of extra states are all it needs of the reduced blocks.
    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point) {
        let (manifold, state, reduced) = (&mut point.manifold, &point.state, &mut parts.blocks);
        let (n, k) = (self.coordinates, self.ndof);
        self.take_constants(manifold);
        let system = manifold.system().clone();
        reduced.evaluate_blocks(manifold, state);
        let m = system.structure().sizes.rows;
        let (blocks, d) = (&reduced.blocks, &reduced.d);
        self.by_rate.fill(0.0);
        self.by_position.fill(0.0);
        let (rate_force, rate_rows) = self.by_rate.split_at_mut(n * k);
        let (rate_rows, rate_own) = rate_rows.split_at_mut(m * k);
        let (force, rows) = self.by_position.split_at_mut(n * k);
        let (rows, own) = rows.split_at_mut(m * k);
        blocks.a0.multiply_many_add(-1.0, d, k, rate_rows);
        reduced.turning.multiply_many_add(-1.0, d, k, rate_own);
        let j = &mut self.rate_by_position;
        manifold.chart_mut().solve_rows_many(rate_rows, rate_own, k, j);
        rate_rows.iter_mut().chain(&mut *rate_own).for_each(|x| *x *= -2.0);
        blocks.damping.multiply_many_add(1.0, d, k, rate_force);
        blocks.stiffness.multiply_many_add(1.0, d, k, force);
        blocks.damping.multiply_many_add(1.0, j, k, force);
        blocks.a1.multiply_many_add(1.0, d, k, rows);
        blocks.a0.multiply_many_add(2.0, j, k, rows);
        reduced.turning_rate.multiply_many_add(1.0, d, k, own);
        reduced.turning.multiply_many_add(2.0, j, k, own);
        self.reduce_extra_states(system.as_ref(), reduced);
        parts.chart.copy_from(point.manifold.chart());
    }

    fn take_blocks(&mut self, parts: &Linearization, manifold: &Manifold) {
        self.take_constants(manifold);
        let reduced = &parts.blocks;
        for (source, target) in
            [(&reduced.damping, &mut self.by_rate), (&reduced.stiffness, &mut self.by_position)]
        {
            target.fill(0.0);
            for column in 0..self.ndof {
                let entry = |row: usize| source[row * self.ndof + column];
                add_extended(parts, &self.moving, entry, &mut target[column..], self.ndof);
            }
        }
    }

    fn factor(&mut self, parts: &Linearization) -> Result<u64, SingularMatrix> {
        let (gamma_h, beta_h2) = (parts.gamma_h, parts.beta_h2);
        for ((sum, rate), position) in self.sum.iter_mut().zip(&self.by_rate).zip(&self.by_position)
        {
            *sum = gamma_h * rate + beta_h2 * position;
        }
        let k = self.ndof;
        for column in 0..if parts.extra.is_empty() { 0 } else { k } {
            let scale = |e: usize| {
                let (at, extra) = (e * k + column, &parts.extra);
                gamma_h * (beta_h2 * extra.by_position[at] + gamma_h * extra.by_velocity[at])
            };
            let moving = self.reduced.then_some(&self.moving);
            add_extra_force(parts, moving, scale, &mut self.sum[column..], k);
        }
        let (mass, moving) = (&self.mass, &self.moving);
        self.pattern.fill(mass, &self.jacobian, moving, &self.sum, &mut self.values);
        let units = || Some(self.units.of_descriptor(self.pattern.own.1));
        let analysed = self.lu.factor(&self.pattern.pattern, &self.values, units)?;
        Ok(u64::from(analysed))
    }

    fn respond(
        &mut self,
        parts: &mut Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        let k = self.ndof;
        let mut x = std::mem::take(&mut self.response);
        // Ψ₁ δv̇ + Ψ₂ δv
        x.rate.fill(0.0);
        let own = &mut x.rate[k - self.moving.len()..];
        for (i, out) in x.force.iter_mut().chain(&mut x.rows).chain(own).enumerate() {
            let range = i * k..(i + 1) * k;
            *out = dot(&self.by_rate[range.clone()], v) + dot(&self.by_position[range], p);
        }
        let effect = |e: usize| z[e] + parts.gamma_h * parts.extra.reduced_rate(e, p, v);
        let moving = self.reduced.then_some(&self.moving);
        add_extra_force(parts, moving, effect, &mut x.force, 1);
        self.solve(parts, &mut x);
        rate.copy_from_slice(&x.rate);
        self.response = x;
    }

    /// M̂ v = Dᵀ M D v.
    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        let Unknowns { force, rows, .. } = &mut self.response;
        let weighed = &mut self.right[..self.coordinates];
        rows.fill(0.0);
        parts.chart.solve(rows, v, force);
        weighed.fill(0.0);
        self.mass.multiply_add(1.0, force, weighed);
        parts.chart.solve_transposed(weighed, rows, v);
    }
}

impl DescriptorForm for DescriptorMatrix {
    fn correct_unknowns(&mut self, parts: &mut Linearization, z: &[f64], x: &mut Unknowns) {
        let moving = self.reduced.then_some(&self.moving);
        add_extra_force(parts, moving, |e| z[e], &mut x.force, 1);
        self.solve(parts, x);
    }
}

impl DescriptorMatrix {
    /// M, G and the moving rows of P where the manifold is.
    fn take_constants(&mut self, manifold: &Manifold) {
        self.mass.values_mut().copy_from_slice(manifold.mass().values());
        self.jacobian.copy_from_slice(manifold.jacobian().values());
        self.moving.copy_from(manifold.chart().moving());
    }

    /// ż_v = g_q D + g_q̇ 𝒥 and ż_v̇ = g_q̇ D.
    fn reduce_extra_states(&self, system: &dyn System, reduced: &mut ReducedBlocks) {
        let structure = system.structure();
        let k = self.ndof;
        reduced.take_extra_squares();
        reduced.extra_position.fill(0.0);
        reduced.extra_velocity.fill(0.0);
        for e in 0..structure.sizes.extra_states {
            let range = e * k..(e + 1) * k;
            for (at, coordinate) in structure.extra_entries(e) {
                let by_q = reduced.blocks.extra_position[at];
                let by_v = reduced.blocks.extra_velocity[at];
                let row = coordinate * k..(coordinate + 1) * k;
                let (d, j) = (&reduced.d[row.clone()], &self.rate_by_position[row]);
                let position = &mut reduced.extra_position[range.clone()];
                for ((x, d), j) in position.iter_mut().zip(d).zip(j) {
                    *x += by_q * d + by_v * j;
                }
                for (x, d) in reduced.extra_velocity[range.clone()].iter_mut().zip(d) {
                    *x += by_v * d;
                }
            }
        }
    }

    /// x ← −Ψ⁻¹ x; dropped rows are not read and get δλ = 0.
    fn solve(&mut self, parts: &Linearization, x: &mut Unknowns) {
        let n = self.coordinates;
        let (first, from) = self.pattern.own;
        let parametrization = parts.chart.parametrization();
        self.right.fill(0.0);
        for (out, x) in self.right.iter_mut().zip(&x.force) {
            *out = -x;
        }
        for (out, &row) in self.right[n..].iter_mut().zip(&*parametrization.kept) {
            *out = -x.rows[row];
        }
        for (out, x) in self.right[first..].iter_mut().zip(&x.rate[from..]) {
            *out = -x;
        }
        self.lu.solve(&self.pattern.pattern, &self.values, &mut self.right);
        x.force.copy_from_slice(&self.right[..n]);
        x.rows.fill(0.0);
        for (solved, &row) in self.right[n..].iter().zip(&*parametrization.kept) {
            x.rows[row] = *solved;
        }
        parametrization.project(&x.force, &mut x.rate);
        x.rate[from..].copy_from_slice(&self.right[first..]);
    }
}

/// Adds Pᵀ p, with the `moving` rows, to the first n entries of `out`, `stride` apart.
fn add_extended(
    parts: &Linearization,
    moving: &BodyRows,
    p: impl Fn(usize) -> f64,
    out: &mut [f64],
    stride: usize,
) {
    let parametrization = parts.chart.parametrization();
    for (at, row, column) in moving.entries() {
        out[column * stride] += moving.value(at) * p(parametrization.linear() + row);
    }
    match &parametrization.projection {
        Projection::Selection(independent) => {
            for (k, i) in independent.iter().enumerate() {
                out[i * stride] += p(k);
            }
        }
        Projection::Basis(rows) => {
            let n = parts.system.structure().sizes.coordinates;
            for (k, row) in rows.chunks_exact(n).enumerate() {
                for (i, x) in row.iter().enumerate() {
                    out[i * stride] += x * p(k);
                }
            }
        }
        Projection::Relative(_) => {}
    }
}

/// Adds Σ scale(e)·F_z of the extra states, or Pᵀ Ẑ where `moving` rows are given, to the first n entries of
/// `out`, `stride` apart.
pub(super) fn add_extra_force(
    parts: &Linearization,
    moving: Option<&BodyRows>,
    scale: impl Fn(usize) -> f64,
    out: &mut [f64],
    stride: usize,
) {
    let (structure, reduced) = (parts.system.structure(), &parts.blocks);
    let Some(moving) = moving else {
        add_force_of_extra_states(structure, &reduced.blocks, scale, out, stride);
        return;
    };
    let ndof = parts.chart.ndof();
    for e in 0..structure.extra_bodies.len() {
        let scale = scale(e);
        let force = |k: usize| scale * reduced.force_extra[e * ndof + k];
        add_extended(parts, moving, force, out, stride);
    }
}

/// Adds Σ scale(e)·F_z to n entries of `out`, `stride` apart.
pub(super) fn add_force_of_extra_states(
    structure: &Structure,
    blocks: &DerivativeBlocks,
    scale: impl Fn(usize) -> f64,
    out: &mut [f64],
    stride: usize,
) {
    for e in 0..structure.sizes.extra_states {
        let scale = scale(e);
        for (at, j) in structure.extra_entries(e) {
            out[j * stride] += scale * blocks.force_extra[at];
        }
    }
}
