//! The integration Jacobian of the descriptor form: sparse, with a pattern analysed once.

use super::first_order::dot;
use crate::error::EvaluationFailure;
use crate::reduction::{
    BodyRows, Manifold, Parametrization, Projection, ReducedBlocks, structural_nonzeros,
    structural_null_space,
};
use crate::system::{State, System};
use holonom_linalg::{BlockMatrix, SingularMatrix, SparseLu, SparsePattern};

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
pub(super) struct DescriptorMatrix {
    ndof: usize,
    coordinates: usize,
    /// Whether the parts are made of M̂₁ and M̂₂.
    reduced: bool,
    /// Kept rows of G, in order.
    kept: Vec<usize>,
    pattern: SparsePattern,
    values: Vec<f64>,
    lu: Option<SparseLu>,
    /// Relative error that the last refinement left.
    left: f64,
    /// (value of M, slot).
    mass_slots: Vec<(u32, u32)>,
    /// (value of G, slot in G, slot in Gᵀ).
    jacobian_slots: Vec<(u32, u32, u32)>,
    /// (entry of the (n+m)×ndof parts, slot).
    part_slots: Vec<(u32, u32)>,
    /// Constant entries of P and −1: (slot, value).
    constants: Vec<(u32, f64)>,
    /// (value of the moving rows of P, slot).
    moving_slots: Vec<(u32, u32)>,
    /// Unknowns before the entries of v̈ that are their own, and the first of these entries.
    own: (usize, usize),
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
}

/// Growth of numbers in the elimination from which solutions are refined; before, corrections keep half
/// their digits and the iteration makes up for the rest.
const HARMLESS_GROWTH: f64 = 1e8;
/// What refinement may leave of the relative error before pivots are chosen anew.
const ACCURACY: f64 = 1e-6;

impl DescriptorMatrix {
    /// Finds the pattern for the manifold's present parametrization; `reduced` for parts made of M̂₁
    /// and M̂₂.
    pub(super) fn new(manifold: &Manifold, q: &[f64], reduced: bool) -> Self {
        let system = manifold.system().as_ref();
        let structure = system.structure();
        let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
        let parametrization = manifold.chart().parametrization();
        let (ndof, kept) = (parametrization.ndof, parametrization.kept.clone());
        let (rank, linear) = (kept.len(), parametrization.linear());
        let moving_rows = ndof - linear;
        let (g_nonzero, m_nonzero) = structural_nonzeros(system, q);
        let mut place: Vec<Option<usize>> = (0..n).map(Some).collect();
        place.resize(n + m, None);
        for (k, &row) in kept.iter().enumerate() {
            place[n + row] = Some(n + k);
        }

        let mut entries = Vec::new();
        let mut mass_sources = Vec::new();
        for (at, entry) in structure.mass_pattern.entries(0, 0).into_iter().enumerate() {
            if m_nonzero[at] {
                entries.push(entry);
                mass_sources.push(at as u32);
            }
        }
        let mut jacobian_sources = Vec::new();
        for (at, (row, j)) in structure.constraint_pattern.entries(0, 0).into_iter().enumerate() {
            if let Some(i) = place[n + row].filter(|_| g_nonzero[at]) {
                entries.extend([(i, j), (j, i)]);
                jacobian_sources.push(at as u32);
            }
        }
        let first_own = n + rank;
        let mut constants = Vec::new();
        let columns: Vec<usize> = match &parametrization.projection {
            Projection::Selection(independent) => {
                independent.iter().copied().chain(first_own..first_own + moving_rows).collect()
            }
            Projection::Basis(rows) => {
                for (k, row) in rows.chunks_exact(n).enumerate() {
                    entries.extend((0..n).map(|j| (first_own + k, j)));
                    constants.extend_from_slice(row);
                }
                (first_own..first_own + ndof).collect()
            }
            Projection::Relative(_) => (first_own..first_own + ndof).collect(),
        };
        let owned = columns.iter().filter(|c| **c >= first_own).count();
        let size = first_own + owned;
        for k in first_own..size {
            entries.push((k, k));
            constants.push(-1.0);
        }
        let moving = manifold.chart().moving().clone();
        let mut moving_sources = Vec::new();
        for (at, row, column) in moving.entries() {
            entries.push((size - moving_rows + row, column));
            moving_sources.push(at as u32);
        }
        place.extend((size - moving_rows..size).map(Some));
        let part = if reduced {
            reduced_nonzeros(manifold, m)
        } else {
            part_nonzeros(system, manifold, q)
        };
        let mut part_sources = Vec::new();
        for (at, _) in part.iter().enumerate().filter(|(_, nonzero)| **nonzero) {
            if let Some(i) = place[at / ndof] {
                entries.push((i, columns[at % ndof]));
                part_sources.push(at as u32);
            }
        }

        let (pattern, slots) = SparsePattern::new(size, size, &entries);
        let mut slots = slots.into_iter().map(|slot| slot as u32);
        let mut next = || slots.next().expect("a slot for every entry");
        let mass_slots = mass_sources.into_iter().map(|at| (at, next())).collect();
        let jacobian_slots = jacobian_sources.into_iter().map(|at| (at, next(), next())).collect();
        let constants = constants.into_iter().map(|x| (next(), x)).collect();
        let moving_slots = moving_sources.into_iter().map(|at| (at, next())).collect();
        let part_slots = part_sources.into_iter().map(|at| (at, next())).collect();
        let dense = || vec![0.0; (n + m + moving_rows) * ndof];
        Self {
            ndof,
            coordinates: n,
            reduced,
            kept,
            values: vec![0.0; pattern.len()],
            pattern,
            lu: None,
            left: 0.0,
            mass_slots,
            jacobian_slots,
            part_slots,
            constants,
            moving_slots,
            own: (first_own, ndof - owned),
            moving,
            mass: structure.mass_pattern.clone(),
            jacobian: structure.constraint_pattern.values().to_vec(),
            by_rate: dense(),
            by_position: dense(),
            sum: dense(),
            rate_by_position: vec![0.0; n * ndof],
            right: vec![0.0; size],
        }
    }

    /// Evaluates the parts at a state whose accelerations the manifold has just computed; D and the
    /// derivatives of extra states go into `reduced`.
    pub(super) fn linearize(
        &mut self,
        manifold: &mut Manifold,
        state: &State,
        reduced: &mut ReducedBlocks,
    ) {
        let (n, k) = (self.coordinates, self.ndof);
        self.mass.values_mut().copy_from_slice(manifold.mass().values());
        self.jacobian.copy_from_slice(manifold.jacobian().values());
        self.moving.copy_from(manifold.chart().moving());
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
    }

    /// Takes the parts from the reduced matrices at the state where the manifold's M and G are.
    pub(super) fn take_reduced(&mut self, manifold: &Manifold, reduced: &ReducedBlocks) {
        self.mass.values_mut().copy_from_slice(manifold.mass().values());
        self.jacobian.copy_from_slice(manifold.jacobian().values());
        self.moving.copy_from(manifold.chart().moving());
        let (k, parametrization) = (self.ndof, manifold.chart().parametrization());
        for (source, target) in
            [(&reduced.damping, &mut self.by_rate), (&reduced.stiffness, &mut self.by_position)]
        {
            target.fill(0.0);
            for column in 0..k {
                let entry = |row: usize| source[row * k + column];
                let out = &mut target[column..];
                add_extended(parametrization, &self.moving, entry, out, k, self.coordinates);
            }
        }
    }

    /// ż_v = g_q D + g_q̇ 𝒥 and ż_v̇ = g_q̇ D.
    fn reduce_extra_states(&self, system: &dyn System, reduced: &mut ReducedBlocks) {
        let structure = system.structure();
        let (per_body, k) = (structure.sizes.per_body, self.ndof);
        reduced.extra_extra.copy_from_slice(&reduced.blocks.extra_extra);
        reduced.extra_position.fill(0.0);
        reduced.extra_velocity.fill(0.0);
        for (e, ends) in structure.extra_bodies.iter().enumerate() {
            let range = e * k..(e + 1) * k;
            for (side, body) in ends.iter().enumerate() {
                let Some(body) = body else { continue };
                for i in 0..per_body {
                    let at = (2 * e + side) * per_body + i;
                    let by_q = reduced.blocks.extra_position[at];
                    let by_v = reduced.blocks.extra_velocity[at];
                    let row = (body * per_body + i) * k;
                    let (d, j) = (&reduced.d[row..row + k], &self.rate_by_position[row..row + k]);
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
    }

    /// Adds Σ scale(e)·F_z of the extra states to the first n entries of `out`, `stride` apart.
    pub(super) fn add_extra_force(
        &self,
        manifold: &Manifold,
        reduced: &ReducedBlocks,
        scale: impl Fn(usize) -> f64,
        out: &mut [f64],
        stride: usize,
    ) {
        let moving = self.reduced.then_some(&self.moving);
        add_extra_force(manifold, reduced, moving, scale, out, stride);
    }

    /// Sums the parts and factors; `inverse_e` is E⁻¹. The second result tells whether pivots were
    /// chosen anew.
    pub(super) fn factor(
        &mut self,
        manifold: &Manifold,
        reduced: &ReducedBlocks,
        inverse_e: &[f64],
        gamma_h: f64,
        beta_h2: f64,
    ) -> Result<bool, SingularMatrix> {
        for ((sum, rate), position) in self.sum.iter_mut().zip(&self.by_rate).zip(&self.by_position)
        {
            *sum = gamma_h * rate + beta_h2 * position;
        }
        let k = self.ndof;
        for column in 0..if inverse_e.is_empty() { 0 } else { k } {
            let scale = |e: usize| {
                let at = e * k + column;
                let effect =
                    beta_h2 * reduced.extra_position[at] + gamma_h * reduced.extra_velocity[at];
                gamma_h * inverse_e[e] * effect
            };
            let out = &mut self.sum[column..];
            let moving = self.reduced.then_some(&self.moving);
            add_extra_force(manifold, reduced, moving, scale, out, k);
        }
        self.values.fill(0.0);
        for &(at, slot) in &self.mass_slots {
            self.values[slot as usize] += self.mass.values()[at as usize];
        }
        for &(at, lower, upper) in &self.jacobian_slots {
            self.values[lower as usize] += self.jacobian[at as usize];
            self.values[upper as usize] += self.jacobian[at as usize];
        }
        for &(slot, x) in &self.constants {
            self.values[slot as usize] += x;
        }
        for &(at, slot) in &self.moving_slots {
            self.values[slot as usize] += self.moving.value(at as usize);
        }
        for &(at, slot) in &self.part_slots {
            self.values[slot as usize] += self.sum[at as usize];
        }
        if let Some(lu) = &mut self.lu
            && self.left <= ACCURACY
            && lu.refactor(&self.values).is_ok()
        {
            return Ok(false);
        }
        (self.lu, self.left) = (None, 0.0);
        self.lu = Some(SparseLu::analyze(&self.pattern, &self.values)?);
        Ok(true)
    }

    /// (δq̈, δλ, δv̈) = −Ψ⁻¹ (force, rows, rate); dropped rows are not read and get δλ = 0.
    pub(super) fn solve(
        &mut self,
        manifold: &Manifold,
        force: &mut [f64],
        rows: &mut [f64],
        rate: &mut [f64],
    ) {
        let n = self.coordinates;
        let (first, from) = self.own;
        self.right.fill(0.0);
        for (out, x) in self.right.iter_mut().zip(&*force) {
            *out = -x;
        }
        for (out, &row) in self.right[n..].iter_mut().zip(&self.kept) {
            *out = -rows[row];
        }
        for (out, x) in self.right[first..].iter_mut().zip(&rate[from..]) {
            *out = -x;
        }
        let lu = self.lu.as_mut().expect("factored before it is solved with");
        if lu.growth() <= HARMLESS_GROWTH {
            lu.solve(&mut self.right);
        } else {
            self.left = lu.solve_refined(&self.pattern, &self.values, &mut self.right);
        }
        force.copy_from_slice(&self.right[..n]);
        rows.fill(0.0);
        for (x, &row) in self.right[n..].iter().zip(&self.kept) {
            rows[row] = *x;
        }
        manifold.chart().parametrization().project(force, rate);
        rate[from..].copy_from_slice(&self.right[first..]);
    }

    /// (force, rows, v_rate) = Ψ₁ δv̇ + Ψ₂ δv.
    pub(super) fn respond(
        &self,
        position: &[f64],
        rate: &[f64],
        force: &mut [f64],
        rows: &mut [f64],
        v_rate: &mut [f64],
    ) {
        let k = self.ndof;
        v_rate.fill(0.0);
        let own = &mut v_rate[k - self.moving.len()..];
        for (i, out) in force.iter_mut().chain(rows).chain(own).enumerate() {
            let range = i * k..(i + 1) * k;
            *out =
                dot(&self.by_rate[range.clone()], rate) + dot(&self.by_position[range], position);
        }
    }
}

/// Which entries of the (n+m)×ndof parts can differ from zero: a coordinate that no q_k moves in any
/// configuration has no derivative by it either, so 𝒥 has the pattern of D.
fn part_nonzeros(system: &dyn System, manifold: &Manifold, q: &[f64]) -> Vec<bool> {
    let structure = system.structure();
    let (n, m, k) = (structure.sizes.coordinates, structure.sizes.rows, manifold.chart().ndof());
    let d = structural_null_space(system, manifold.chart(), q);
    let moving = manifold.chart().moving();
    let mut nonzero = vec![false; (n + m + moving.len()) * k];
    for (_, row, j) in moving.entries() {
        for column in 0..k {
            nonzero[(n + m + row) * k + column] |= d[j * k + column];
        }
    }
    let mut propagate = |matrix: &BlockMatrix, first: usize| {
        for (i, j) in matrix.entries(first, 0) {
            for column in 0..k {
                nonzero[i * k + column] |= d[j * k + column];
            }
        }
    };
    propagate(&structure.stiffness_pattern, 0);
    propagate(&structure.constraint_pattern, n);
    // F_z times the effect of v on z: all coordinates of an element's bodies move with all others.
    let per_body = structure.sizes.per_body;
    for ends in &structure.extra_bodies {
        let coordinates = || ends.iter().flatten().flat_map(|b| b * per_body..(b + 1) * per_body);
        for column in 0..k {
            if coordinates().any(|j| d[j * k + column]) {
                coordinates().for_each(|i| nonzero[i * k + column] = true);
            }
        }
    }
    nonzero
}

/// The same where parts are made of M̂₁ and M̂₂: the independent coordinates, or all for a tangent
/// plane.
fn reduced_nonzeros(manifold: &Manifold, m: usize) -> Vec<bool> {
    let parametrization = manifold.chart().parametrization();
    let (n, k) = (manifold.system().structure().sizes.coordinates, parametrization.ndof);
    let moving = manifold.chart().moving();
    let mut nonzero = vec![false; (n + m + moving.len()) * k];
    for (_, _, i) in moving.entries() {
        nonzero[i * k..(i + 1) * k].fill(true);
    }
    match &parametrization.projection {
        Projection::Selection(independent) => {
            for i in independent {
                nonzero[i * k..(i + 1) * k].fill(true);
            }
        }
        Projection::Basis(_) => nonzero[..n * k].fill(true),
        Projection::Relative(_) => {}
    }
    nonzero
}

/// Adds Pᵀ p, with the moving rows, to the first n entries of `out`, `stride` apart.
fn add_extended(
    parametrization: &Parametrization,
    moving: &BodyRows,
    p: impl Fn(usize) -> f64,
    out: &mut [f64],
    stride: usize,
    n: usize,
) {
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
            for (k, row) in rows.chunks_exact(n).enumerate() {
                for (i, x) in row.iter().enumerate() {
                    out[i * stride] += x * p(k);
                }
            }
        }
        Projection::Relative(_) => {}
    }
}

fn add_extra_force(
    manifold: &Manifold,
    reduced: &ReducedBlocks,
    moving: Option<&BodyRows>,
    scale: impl Fn(usize) -> f64,
    out: &mut [f64],
    stride: usize,
) {
    let structure = manifold.system().structure();
    let sizes = structure.sizes;
    for (e, ends) in structure.extra_bodies.iter().enumerate() {
        let scale = scale(e);
        if let Some(moving) = moving {
            let parametrization = manifold.chart().parametrization();
            let force = |k: usize| scale * reduced.force_extra[e * parametrization.ndof + k];
            add_extended(parametrization, moving, force, out, stride, sizes.coordinates);
            continue;
        }
        for (side, body) in ends.iter().enumerate() {
            let Some(body) = body else { continue };
            for i in 0..sizes.per_body {
                let at = (2 * e + side) * sizes.per_body + i;
                let row = body * sizes.per_body + i;
                out[row * stride] += scale * reduced.blocks.force_extra[at];
            }
        }
    }
}

pub(super) fn singular(e: &SingularMatrix, gamma_h: f64) -> EvaluationFailure {
    EvaluationFailure {
        code: "simulation/singular-jacobian",
        message: format!(
            "the integration Jacobian is singular at step coefficient {gamma_h:.1e} s: {e}"
        ),
    }
}
