//! The reduced matrices of one state: M̂, M̂₁, M̂₂ by three solves with [G; P], and what extra states
//! and explicit time add to them.

use super::zeros::Zeros;
use crate::error::EvaluationFailure;
use crate::reduction::{BodyRows, Chart, Manifold, ReducedDerivatives};
use crate::system::{DerivativeBlocks, ExtraSquares, State};
use crate::threads::Threads;
use holonom_linalg::{DenseLu, SingularMatrix, gram_add, gram_spans_add};

/// D, M̂, M̂₁, M̂₂ and the blocks of extra states at one state.
///
/// ```text
/// Y = SᵀMᵀD   W = Sᵀ(CᵀD − A₂ᵀY)   A₂ = 2A₀
/// M̂ = DᵀMD    M̂₁ = DᵀCD − YᵀA₂D    M̂₂ = DᵀKD − YᵀA₁D − WᵀA₀D
/// v̈_v̇ = −M̂⁻¹M̂₁   v̈_v = −M̂⁻¹M̂₂
/// ```
///
/// Where P moves with the bodies, its rows count among those of G: [A₀; (P q̇)_q] stands for A₀,
/// [A₁; (v̈)_q] for A₁ and [S D] for S; the products with D then stand below Y and W.
///
/// Derivation: `docs/theory/reduction.md` (11)-(26).
///
/// Extra states z: Ẑ = DᵀF_z, v̈_z = −M̂⁻¹Ẑ, ż_v = g_q D + g_q̇ q̇_v, ż_v̇ = g_q̇ D, q̇_v = −S A₀ D.
/// Matrices are square of order ndof, by rows.
#[derive(Debug, Clone)]
pub struct ReducedBlocks {
    /// n×ndof.
    pub d: Vec<f64>,
    /// M̂.
    pub mass: Vec<f64>,
    /// M̂₁.
    pub damping: Vec<f64>,
    /// M̂₂.
    pub stiffness: Vec<f64>,
    /// Ẑ, ndof per extra state: column k at `k * ndof`.
    pub force_extra: Vec<f64>,
    /// ż_v, row k at `k * ndof`.
    pub extra_position: Vec<f64>,
    /// ż_v̇, row k at `k * ndof`.
    pub extra_velocity: Vec<f64>,
    /// ż_z.
    pub extra_extra: ExtraSquares,
    /// All blocks in the system's coordinates.
    pub blocks: DerivativeBlocks,
    /// (P q̇)_q of the rows of P that move.
    pub turning: BodyRows,
    /// (v̈)_q of them at fixed q̈.
    pub turning_rate: BodyRows,
    /// Where D, Y and W are zero.
    zeros: Zeros,
    x: Vec<f64>,
    /// Y and W, with room for the right-hand sides that they come from.
    y: Vec<f64>,
    w: Vec<f64>,
    transposed: Vec<f64>,
    coordinates: Vec<f64>,
    rows: Vec<f64>,
    /// Effects of explicit time, which few formulas ask for: they have room from the first time on.
    q_t: Vec<f64>,
    v_t: Vec<f64>,
    a_t: Vec<f64>,
    independent: Vec<f64>,
}

impl ReducedBlocks {
    /// Buffers for a manifold's present parametrization.
    pub fn new(manifold: &Manifold, threads: &Threads) -> Self {
        Self::sized(manifold, manifold.chart().ndof(), threads)
    }

    /// Without what is dense of order ndof: only the system's own blocks and the rows of P can be
    /// evaluated, and explicit time.
    pub fn of_system(manifold: &Manifold, threads: &Threads) -> Self {
        Self::sized(manifold, 0, threads)
    }

    fn sized(manifold: &Manifold, ndof: usize, threads: &Threads) -> Self {
        let structure = manifold.system().structure();
        let s = structure.sizes;
        let nz = s.extra_states;
        let turning = manifold.chart().moving().clone();
        Self {
            d: vec![0.0; s.coordinates * ndof],
            mass: vec![0.0; ndof * ndof],
            damping: vec![0.0; ndof * ndof],
            stiffness: vec![0.0; ndof * ndof],
            force_extra: vec![0.0; nz * ndof],
            extra_position: vec![0.0; nz * ndof],
            extra_velocity: vec![0.0; nz * ndof],
            extra_extra: ExtraSquares::new(&structure.extra_blocks),
            blocks: structure.derivative_blocks(threads),
            turning_rate: turning.clone(),
            turning,
            zeros: Zeros::default(),
            x: vec![0.0; s.coordinates * ndof],
            y: vec![0.0; s.rows.max(s.coordinates) * ndof],
            w: vec![0.0; s.rows.max(s.coordinates) * ndof],
            transposed: vec![0.0; ndof * ndof],
            coordinates: vec![0.0; s.coordinates],
            rows: vec![0.0; s.rows],
            q_t: Vec::new(),
            v_t: Vec::new(),
            a_t: Vec::new(),
            independent: vec![0.0; manifold.chart().ndof()],
        }
    }

    /// Evaluates everything at `state`, whose accelerations the manifold has just computed (its
    /// factor of [G; P] and its M belong to the state).
    pub fn evaluate(&mut self, manifold: &mut Manifold, state: &State) {
        let ndof = manifold.chart().ndof();
        self.evaluate_blocks(manifold, state);
        if ndof == 0 {
            return;
        }
        self.zeros.update(manifold, &self.blocks, &self.turning);
        // X = MD: Y = SᵀX, M̂ = DᵀX (M and M̂ are symmetric).
        let (n, m) = (self.d.len(), self.blocks.a0.n_rows());
        let Self { d, blocks, turning, zeros, w, x, .. } = self;
        let product = &mut self.y[..n];
        product.fill(0.0);
        manifold.mass().multiply_transposed_spans_add(1.0, d, ndof, &zeros.mass, product);
        let chart = manifold.chart_mut();
        chart.solve_transposed_many(m, &mut self.y, &mut self.mass);
        let y = &self.y[..m * ndof];
        // X = CᵀD − 2A₀ᵀY: W = SᵀX, M̂₁ᵀ = DᵀX.
        let product = &mut w[..n];
        product.fill(0.0);
        blocks.damping.multiply_transposed_spans_add(1.0, d, ndof, &zeros.forces, product);
        blocks.a0.multiply_transposed_spans_add(-2.0, y, ndof, &zeros.y, product);
        let moving = chart.parametrization().linear() * ndof..;
        // M̂ is symmetric: its last rows are those below Y.
        let mass = &self.mass[moving.clone()];
        turning.multiply_transposed_many_add(-2.0, mass, ndof, product);
        chart.solve_transposed_many(m, w, &mut self.transposed);
        transpose(ndof, &self.transposed, &mut self.damping);
        // M̂₂ᵀ = Dᵀ(KᵀD − A₁ᵀY − A₀ᵀW).
        x.fill(0.0);
        blocks.stiffness.multiply_transposed_spans_add(1.0, d, ndof, &zeros.forces, x);
        blocks.a1.multiply_transposed_spans_add(-1.0, y, ndof, &zeros.y, x);
        blocks.a0.multiply_transposed_spans_add(-1.0, &w[..m * ndof], ndof, &zeros.w, x);
        self.turning_rate.multiply_transposed_many_add(-1.0, mass, ndof, x);
        turning.multiply_transposed_many_add(-1.0, &self.transposed[moving], ndof, x);
        self.stiffness.fill(0.0);
        gram_spans_add(n / ndof, ndof, x, d, &zeros.d, &mut self.stiffness);
        self.evaluate_extra_states(manifold);
    }

    /// The reduced matrices along the tree at `state`, whose accelerations came in joint coordinates, and columns of q_v and q̇_v
    /// for one variable after the other. D is not evaluated, nor are K, C and the rows of
    /// constraints and extra states among the blocks.
    pub fn evaluate_along(&mut self, manifold: &mut Manifold, state: &State, columns: &mut [f64]) {
        let blocks = &mut self.blocks;
        let mut out = ReducedDerivatives {
            mass: &mut self.mass,
            damping: &mut self.damping,
            stiffness: &mut self.stiffness,
            force_extra: &mut self.force_extra,
            extra_position: &mut self.extra_position,
            extra_velocity: &mut self.extra_velocity,
            columns,
        };
        let threads = blocks.threads().clone();
        threads.share(|| manifold.linearize(state, blocks, &mut out));
        self.take_extra_squares();
    }

    /// D and the blocks of the system alone, at a state as for [`ReducedBlocks::evaluate`].
    pub fn evaluate_blocks(&mut self, manifold: &mut Manifold, state: &State) {
        manifold.chart_mut().null_space(&mut self.d);
        self.evaluate_system(manifold, state);
    }

    /// The blocks of the system and the rows of P alone.
    pub fn evaluate_system(&mut self, manifold: &Manifold, state: &State) {
        let (system, parametrization) = (manifold.system(), manifold.chart().parametrization());
        let Self { blocks, turning, turning_rate, .. } = self;
        let threads = blocks.threads().clone();
        threads.share(|| {
            system.derivative_blocks(state, blocks);
            turning.evaluate_blocks(
                turning_rate,
                system.as_ref(),
                parametrization,
                state,
                &threads,
            );
        });
    }

    /// q̇_v at fixed v̇ (n×ndof): −[S D] of the stacked A₀ D, at the state of the last
    /// [`ReducedBlocks::evaluate`].
    pub fn rate_map(&mut self, chart: &mut Chart, out: &mut [f64]) {
        let ndof = chart.ndof();
        let rows = &mut self.w[..self.blocks.a0.n_rows() * ndof];
        rows.fill(0.0);
        self.blocks.a0.multiply_many_add(-1.0, &self.d, ndof, rows);
        let moving = &mut self.transposed[..self.turning.len() * ndof];
        moving.fill(0.0);
        self.turning.multiply_many_add(-1.0, &self.d, ndof, moving);
        chart.solve_rows_many(rows, moving, ndof, out);
    }

    /// D and M̂ alone at `state`; the caller fills in the other reduced matrices.
    pub fn evaluate_mass(&mut self, manifold: &mut Manifold) {
        let ndof = manifold.chart().ndof();
        manifold.chart_mut().null_space(&mut self.d);
        self.mass.fill(0.0);
        if ndof > 0 {
            self.x.fill(0.0);
            manifold.mass().multiply_many_add(1.0, &self.d, ndof, &mut self.x);
            gram_add(self.d.len() / ndof, ndof, &self.d, &self.x, &mut self.mass);
        }
    }

    /// Degrees of freedom.
    pub(super) fn order(&self) -> usize {
        self.independent.len()
    }

    /// J = g_w of ẇ = g(t, w), w = (v, v̇, z), by rows; for analysis, not for steps.
    ///
    /// # Errors
    /// When M̂ is singular.
    pub fn jacobian(&self) -> Result<Vec<f64>, EvaluationFailure> {
        let ndof = self.independent.len();
        let n = 2 * ndof + self.extra_extra.states();
        let mut j = vec![0.0; n * n];
        for k in 0..ndof {
            j[k * n + ndof + k] = 1.0;
        }
        let mut mass = DenseLu::new(ndof);
        if ndof > 0 {
            mass.factor(&self.mass).map_err(|e| singular_mass(&e))?;
        }
        for column in 0..n {
            let mut force: Vec<f64> = (0..ndof)
                .map(|row| -match column {
                    c if c < ndof => self.stiffness[row * ndof + c],
                    c if c < 2 * ndof => self.damping[row * ndof + c - ndof],
                    c => self.force_extra[(c - 2 * ndof) * ndof + row],
                })
                .collect();
            if ndof > 0 {
                mass.solve(&mut force);
            }
            for (row, x) in force.iter().enumerate() {
                j[(ndof + row) * n + column] = *x;
            }
        }
        for k in 0..self.extra_extra.states() {
            let row = &mut j[(2 * ndof + k) * n..(2 * ndof + k + 1) * n];
            row[..ndof].copy_from_slice(&self.extra_position[k * ndof..(k + 1) * ndof]);
            row[ndof..2 * ndof].copy_from_slice(&self.extra_velocity[k * ndof..(k + 1) * ndof]);
            self.extra_extra.row(k).for_each(|(l, x)| row[2 * ndof + l] = x);
        }
        Ok(j)
    }

    /// ż_z of the last evaluation of the system's blocks.
    pub(super) fn take_extra_squares(&mut self) {
        self.extra_extra.values.copy_from_slice(&self.blocks.extra_extra.values);
    }

    fn evaluate_extra_states(&mut self, manifold: &mut Manifold) {
        let system = manifold.system().clone();
        let structure = system.structure();
        let ndof = manifold.chart().ndof();
        let linear = manifold.chart().parametrization().linear();
        self.take_extra_squares();
        for k in 0..structure.sizes.extra_states {
            let range = k * ndof..(k + 1) * ndof;
            let place = |source: &[f64], target: &mut [f64]| {
                target.fill(0.0);
                structure.extra_entries(k).for_each(|(at, j)| target[j] += source[at]);
            };
            place(&self.blocks.force_extra, &mut self.coordinates);
            multiply_transposed(&self.d, &self.coordinates, &mut self.force_extra[range.clone()]);
            // ż_v̇ = Dᵀg_q̇ᵀ and, with s = Sᵀg_q̇ᵀ, ż_v = Dᵀ(g_qᵀ − A₀ᵀs).
            place(&self.blocks.extra_velocity, &mut self.coordinates);
            manifold.chart_mut().solve_transposed(
                &self.coordinates,
                &mut self.rows,
                &mut self.extra_velocity[range.clone()],
            );
            place(&self.blocks.extra_position, &mut self.coordinates);
            self.blocks.a0.multiply_transposed_add(-1.0, &self.rows, &mut self.coordinates);
            let moving = range.start + linear..range.end;
            let s = &self.extra_velocity[moving];
            self.turning.multiply_transposed_many_add(-1.0, s, 1, &mut self.coordinates);
            multiply_transposed(&self.d, &self.coordinates, &mut self.extra_position[range]);
        }
    }

    /// M̂ v̈_t and ż_t, the effect of explicit time at fixed v, v̇, z, at the state of the last
    /// [`ReducedBlocks::evaluate`].
    ///
    /// ```text
    /// q_t = S ν   q̇_t = −S[−ν_t + A₀ q_t]   a = −S[−τ_t + A₁ q_t + A₂ q̇_t]
    /// M̂ v̈_t = −Dᵀ(M a + K q_t + C q̇_t + F_t)   ż_t = g_q q_t + g_q̇ q̇_t + g_t
    /// ```
    pub fn time_derivative(
        &mut self,
        manifold: &mut Manifold,
        state: &State,
        force: &mut [f64],
        z_t: &mut [f64],
    ) {
        let system = manifold.system().clone();
        let structure = system.structure();
        for x in [&mut self.q_t, &mut self.v_t, &mut self.a_t] {
            x.resize(structure.sizes.coordinates, 0.0);
        }
        system.velocity_rhs(state.t, &mut self.rows);
        let linear = manifold.chart().parametrization().linear();
        self.independent.fill(0.0);
        manifold.chart_mut().solve(&self.rows, &self.independent, &mut self.q_t);
        self.rows.copy_from_slice(&self.blocks.velocity_rhs_time);
        self.blocks.a0.multiply_add(-1.0, &self.q_t, &mut self.rows);
        let moving = &mut self.independent[linear..];
        self.turning.multiply_many_add(-1.0, &self.q_t, 1, moving);
        manifold.chart_mut().solve(&self.rows, &self.independent, &mut self.v_t);
        self.rows.copy_from_slice(&self.blocks.acceleration_rhs_time);
        self.blocks.a1.multiply_add(-1.0, &self.q_t, &mut self.rows);
        self.blocks.a0.multiply_add(-2.0, &self.v_t, &mut self.rows);
        let moving = &mut self.independent[linear..];
        moving.fill(0.0);
        self.turning_rate.multiply_many_add(-1.0, &self.q_t, 1, moving);
        self.turning.multiply_many_add(-2.0, &self.v_t, 1, moving);
        manifold.chart_mut().solve(&self.rows, &self.independent, &mut self.a_t);
        self.coordinates.copy_from_slice(&self.blocks.force_time);
        manifold.mass().multiply_add(1.0, &self.a_t, &mut self.coordinates);
        self.blocks.stiffness.multiply_add(1.0, &self.q_t, &mut self.coordinates);
        self.blocks.damping.multiply_add(1.0, &self.v_t, &mut self.coordinates);
        manifold.chart_mut().solve_transposed(&self.coordinates, &mut self.rows, force);
        force.iter_mut().for_each(|x| *x = -*x);
        for (k, out) in z_t.iter_mut().enumerate() {
            *out = self.blocks.extra_time[k]
                + self.blocks.extra_rate(structure, k, &self.q_t, &self.v_t);
        }
    }
}

/// y = Dᵀ x for D (n×ndof) by rows.
fn multiply_transposed(d: &[f64], x: &[f64], y: &mut [f64]) {
    y.fill(0.0);
    if y.is_empty() {
        return;
    }
    for (row, x) in d.chunks_exact(y.len()).zip(x) {
        for (out, d) in y.iter_mut().zip(row) {
            *out += d * x;
        }
    }
}

fn transpose(n: usize, a: &[f64], out: &mut [f64]) {
    for i in 0..n {
        for j in 0..n {
            out[j * n + i] = a[i * n + j];
        }
    }
}

pub(super) fn singular_mass(e: &SingularMatrix) -> EvaluationFailure {
    EvaluationFailure::new(
        "simulation/singular-mass",
        format!("the reduced mass matrix is singular: {e}"),
    )
}

/// The same of a matrix of order n whose last variable comes first.
pub(super) fn reversed(e: &SingularMatrix, n: usize) -> SingularMatrix {
    SingularMatrix { row: n - 1 - e.row, column: n - 1 - e.column, pivot: e.pivot }
}
