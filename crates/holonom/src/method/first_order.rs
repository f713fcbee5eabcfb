//! The first-order reduction: w = (v, v̇, z) on the constraint manifold as an [`Ode`].

use super::complex_solver::ComplexSolver;
use super::differences::{Differences, JacobianSource};
use super::ode::{Complex64, EvaluationFailure, LinearizedOde, Ode};
use super::second_order::SecondOrder;
use super::state_space_method::AccelerationBuffers;
use super::weights::Weights;
use crate::reduction::{Chart, Manifold, Point, ReducedBlocks};
use crate::system::State;
use holonom_linalg::{DenseLu, SingularMatrix};

/// ẇ = (v̇, v̈(t, v, v̇, z), ż), with the solve (I − γhJ)⁻¹ by one matrix of order ndof:
///
/// ```text
/// Π = M̂ + γh M̂₁' + γ²h² M̂₂'      M̂₁' = M̂₁ + γh Ẑ E⁻¹ ż_v̇   M̂₂' = M̂₂ + γh Ẑ E⁻¹ ż_v
/// E = I − γh ż_z                   b = M̂ r_v − γh Ẑ E⁻¹ r_z
/// Π δp = M̂ r_p + γh (M̂₁' r_p + b)   Π δv = b − γh M̂₂' r_p   δz = E⁻¹(r_z + γh (ż_v δp + ż_v̇ δv))
/// ```
///
/// Source: `docs/theory/method.md` (1)-(6); thesis (3.103)-(3.105), with the extra states eliminated first.
#[derive(Debug, Clone)]
pub struct FirstOrder {
    /// The stages' point.
    pub(super) point: Point,
    /// [G; P] at the linearization point: weights and norms.
    pub(super) start: Chart,
    pub(super) blocks: ReducedBlocks,
    /// Buffers of a Jacobian by differences; none with the analytic one.
    differences: Option<Box<Differences>>,
    pub(super) weights: Weights,
    pub(super) linearized: bool,
    /// Norms use D and q̇_v at fixed v̇ of the linearization, where they are small enough.
    maps: bool,
    /// q̇_v at fixed v̇, n×ndof.
    pub(super) rate_map: Vec<f64>,
    /// (t, w) of the last full evaluation; NaN if none is current.
    at: Vec<f64>,
    pub(super) at_time: f64,
    pub(super) gamma_h: f64,
    pub(super) lu: DenseLu,
    mass_lu: DenseLu,
    /// Allocated at the first complex factorization: most formulas need none.
    complex: Option<Box<ComplexSolver>>,
    pi: Vec<f64>,
    pub(super) m1: Vec<f64>,
    pub(super) m2: Vec<f64>,
    pub(super) inverse_e: Vec<f64>,
    b1: Vec<f64>,
    b2: Vec<f64>,
    dq: Vec<f64>,
    dv: Vec<f64>,
    rows: Vec<f64>,
    rates: Vec<f64>,
    /// For stages that are solved for accelerations.
    pub(super) stage: AccelerationBuffers,
}

impl FirstOrder {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State) -> Self {
        let s = manifold.system().structure().sizes;
        let ndof = manifold.chart().ndof();
        Self {
            start: manifold.chart().clone(),
            blocks: ReducedBlocks::new(&manifold),
            differences: None,
            weights,
            linearized: false,
            maps: false,
            rate_map: vec![0.0; s.coordinates * ndof],
            at: vec![f64::NAN; 2 * ndof + s.extra_states],
            at_time: f64::NAN,
            gamma_h: 0.0,
            lu: DenseLu::new(ndof),
            mass_lu: DenseLu::new(ndof),
            complex: None,
            pi: vec![0.0; ndof * ndof],
            m1: vec![0.0; ndof * ndof],
            m2: vec![0.0; ndof * ndof],
            inverse_e: vec![0.0; s.extra_states],
            b1: vec![0.0; ndof],
            b2: vec![0.0; ndof],
            dq: vec![0.0; s.coordinates],
            dv: vec![0.0; s.coordinates],
            rows: vec![0.0; s.rows],
            rates: vec![0.0; ndof],
            stage: AccelerationBuffers::new(ndof, &s),
            point: Point::new(manifold, state),
        }
    }

    /// Where the integration Jacobian comes from; analytic unless said otherwise.
    pub fn set_jacobian(&mut self, source: JacobianSource) {
        self.differences = match source {
            JacobianSource::Analytic => None,
            JacobianSource::Differences => Some(Box::new(Differences::new(&self.point.manifold))),
        };
    }

    /// The point of the last evaluation.
    pub fn point(&self) -> &Point {
        &self.point
    }

    /// The same, for changes of the parametrization.
    pub fn point_mut(&mut self) -> &mut Point {
        &mut self.point
    }

    /// The energy ledger is not part of w.
    pub fn integrates_powers(&self) -> bool {
        false
    }

    /// References have been moved at the state last evaluated: its independent variables are now `w`.
    pub fn references_moved(&mut self, w: &[f64]) {
        self.at_time = self.point.state.t;
        self.at.copy_from_slice(w);
    }

    /// The state that the next step starts from: weights and windings follow it.
    pub fn begin_step(&mut self, state: &State) {
        // Recoveries go on from here, not from a stage of the step before.
        self.point.begin_step(state);
        self.weights.set(state);
        if self.weights.are_independent() {
            self.set_independent_weights(state);
        }
        if !self.linearized {
            self.start.copy_from(self.point.manifold.chart());
        }
    }

    fn set_independent_weights(&mut self, state: &State) {
        let mut w = std::mem::take(&mut self.stage.trial);
        self.pack(state, &mut w);
        let system = self.point.manifold.system();
        let parametrization = self.point.manifold.chart().parametrization();
        let measure = |k: usize| parametrization.measure(system.as_ref(), k);
        self.weights.set_independent(&w, measure, parametrization.ndof);
        self.stage.trial = w;
    }

    /// w of a state.
    pub fn pack(&self, state: &State, w: &mut [f64]) {
        let ndof = self.point.manifold.chart().ndof();
        let (positions, rest) = w.split_at_mut(ndof);
        let (rates, z) = rest.split_at_mut(ndof);
        self.point.manifold.independent_state(state, positions, rates);
        z.copy_from_slice(&state.z);
    }

    /// Recovers the state at (t, w) with accelerations (`full`) or without, starting from the
    /// configuration of the last evaluation.
    ///
    /// # Errors
    /// As [`Ode::derivative`].
    pub fn evaluate(&mut self, t: f64, w: &[f64], full: bool) -> Result<&State, EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        let (positions, rest) = w.split_at(ndof);
        let (rates, z) = rest.split_at(ndof);
        self.at_time = f64::NAN;
        self.point.evaluate(t, positions, rates, z, full)?;
        if full {
            self.at_time = t;
            self.at.copy_from_slice(w);
        }
        Ok(&self.point.state)
    }

    /// Whether the integration Jacobian is one by differences.
    pub(super) fn uses_differences(&self) -> bool {
        self.differences.is_some()
    }

    /// Makes factors, M, accelerations and multipliers those of (t, w), the start of the step.
    pub(super) fn return_to(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        if t != self.at_time || w != self.at {
            self.point.return_to_anchor();
            self.evaluate(t, w, true)?;
        }
        self.point.complete();
        Ok(())
    }

    /// After a re-parametrization by [`Manifold::set_chart`]: sizes may differ.
    pub fn reparametrized(&mut self) {
        let ndof = self.point.manifold.chart().ndof();
        self.start = self.point.manifold.chart().clone();
        self.blocks = ReducedBlocks::new(&self.point.manifold);
        self.rate_map = self.blocks.d.clone();
        self.linearized = false;
        self.lu = DenseLu::new(ndof);
        self.mass_lu = DenseLu::new(ndof);
        self.complex = None;
        if let Some(differences) = &mut self.differences {
            **differences = Differences::new(&self.point.manifold);
        }
        self.at.resize(2 * ndof + self.point.state.z.len(), f64::NAN);
        self.at.fill(f64::NAN);
        for matrix in [&mut self.pi, &mut self.m1, &mut self.m2] {
            matrix.resize(ndof * ndof, 0.0);
        }
        for vector in [&mut self.b1, &mut self.b2, &mut self.rates] {
            vector.resize(ndof, 0.0);
        }
        self.stage.resize(ndof);
    }

    /// J = g_w at the last linearization, by rows; for analysis, not for steps.
    ///
    /// # Errors
    /// When M̂ is singular.
    pub fn jacobian(&mut self) -> Result<Vec<f64>, EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        let (n, b) = (self.dimension(), &self.blocks);
        let mut j = vec![0.0; n * n];
        for k in 0..ndof {
            j[k * n + ndof + k] = 1.0;
        }
        if ndof > 0 {
            self.mass_lu.factor(&b.mass).map_err(|e| singular_mass(&e))?;
        }
        for column in 0..n {
            let mut force: Vec<f64> = (0..ndof)
                .map(|row| -match column {
                    c if c < ndof => b.stiffness[row * ndof + c],
                    c if c < 2 * ndof => b.damping[row * ndof + c - ndof],
                    c => b.force_extra[(c - 2 * ndof) * ndof + row],
                })
                .collect();
            if ndof > 0 {
                self.mass_lu.solve(&mut force);
            }
            for (row, x) in force.iter().enumerate() {
                j[(ndof + row) * n + column] = *x;
            }
        }
        for k in 0..b.extra_extra.len() {
            let row = &mut j[(2 * ndof + k) * n..(2 * ndof + k + 1) * n];
            row[..ndof].copy_from_slice(&b.extra_position[k * ndof..(k + 1) * ndof]);
            row[ndof..2 * ndof].copy_from_slice(&b.extra_velocity[k * ndof..(k + 1) * ndof]);
            row[2 * ndof + k] = b.extra_extra[k];
        }
        Ok(j)
    }

    /// Reduced blocks of the last linearization.
    pub fn blocks(&self) -> &ReducedBlocks {
        &self.blocks
    }

    /// The velocity entries r_v of a change of w become M̂ r_v.
    fn weigh(&mut self, x: &mut [f64]) {
        let ndof = self.point.manifold.chart().ndof();
        let v = &mut x[ndof..2 * ndof];
        self.b2.fill(0.0);
        multiply_add(&self.blocks.mass, 1.0, v, &mut self.b2);
        v.copy_from_slice(&self.b2);
    }

    /// Factors M̂ + γh M̂₁' + βh² M̂₂': Π for β = γ², and Ψ of the state-space method.
    pub(super) fn factor_matrix(
        &mut self,
        gamma_h: f64,
        beta_h2: f64,
    ) -> Result<(), EvaluationFailure> {
        self.gamma_h = gamma_h;
        let ndof = self.point.manifold.chart().ndof();
        let b = &self.blocks;
        self.m1.copy_from_slice(&b.damping);
        self.m2.copy_from_slice(&b.stiffness);
        for k in 0..b.extra_extra.len() {
            self.inverse_e[k] = 1.0 / (1.0 - gamma_h * b.extra_extra[k]);
            let range = k * ndof..(k + 1) * ndof;
            let (zeta, by_p, by_v) = (
                &b.force_extra[range.clone()],
                &b.extra_position[range.clone()],
                &b.extra_velocity[range],
            );
            for i in 0..ndof {
                let scale = gamma_h * zeta[i] * self.inverse_e[k];
                for j in 0..ndof {
                    self.m1[i * ndof + j] += scale * by_v[j];
                    self.m2[i * ndof + j] += scale * by_p[j];
                }
            }
        }
        for (((pi, m), m1), m2) in self.pi.iter_mut().zip(&b.mass).zip(&self.m1).zip(&self.m2) {
            *pi = m + gamma_h * m1 + beta_h2 * m2;
        }
        if ndof == 0 {
            return Ok(());
        }
        self.lu.factor(&self.pi).map_err(|e| EvaluationFailure {
            code: "simulation/singular-jacobian",
            message: format!(
                "the integration Jacobian is singular at step coefficient {gamma_h:.1e} s: {e}"
            ),
        })
    }
}

impl Ode for FirstOrder {
    fn dimension(&self) -> usize {
        2 * self.point.manifold.chart().ndof() + self.point.state.z.len()
    }

    fn second_order_split(&self) -> usize {
        self.point.manifold.chart().ndof()
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        require_finite(t, w)?;
        self.evaluate(t, w, true)?;
        g[..ndof].copy_from_slice(&w[ndof..2 * ndof]);
        self.point.manifold.independent_acceleration(&self.point.state, &mut g[ndof..2 * ndof]);
        g[2 * ndof..].copy_from_slice(&self.point.z_rate);
        Ok(())
    }

    /// On all coordinates: δq = D δp, δq̇ = D δṗ − S A₀ δq.
    fn norm(&mut self, change: &[f64]) -> f64 {
        if self.weights.are_independent() {
            return self.weights.independent_norm(change, None);
        }
        let ndof = self.point.manifold.chart().ndof();
        let (dp, rest) = change.split_at(ndof);
        if self.linearized && self.maps {
            let maps = self.blocks.d.chunks_exact(ndof.max(1));
            let maps = maps.zip(self.rate_map.chunks_exact(ndof.max(1)));
            for ((dq, dv), (d, j)) in self.dq.iter_mut().zip(&mut self.dv).zip(maps) {
                *dq = dot(d, dp);
                *dv = dot(d, &rest[..ndof]) + dot(j, dp);
            }
        } else {
            self.rows.fill(0.0);
            self.start.solve(&self.rows, dp, &mut self.dq);
            self.rates.copy_from_slice(&rest[..ndof]);
            if self.linearized {
                self.blocks.blocks.a0.multiply_add(-1.0, &self.dq, &mut self.rows);
                let moving = &mut self.rates[self.start.parametrization().linear()..];
                self.blocks.turning.multiply_many_add(-1.0, &self.dq, 1, moving);
            }
            self.start.solve(&self.rows, &self.rates, &mut self.dv);
        }
        self.weights.norm(&self.dq, &self.dv, &change[2 * ndof..])
    }

    /// With the factors of the last evaluation, which was at the end of the step or next to it: those of
    /// the start hide what a chart that degrades makes of an error.
    fn error_norm(&mut self, error: &[f64], w_end: &[f64]) -> f64 {
        if self.weights.are_independent() {
            return self.weights.independent_norm(error, Some(w_end));
        }
        let ndof = self.point.manifold.chart().ndof();
        let (dp, rest) = error.split_at(ndof);
        let (rate, extra) = rest.split_at(ndof);
        let Self { point, dq, dv, rows, rates, .. } = self;
        point.spread(dp, rate, dq, dv, rows, rates);
        self.weights.norm(&self.dq, &self.dv, extra)
    }
}

impl LinearizedOde for FirstOrder {
    fn linearize(&mut self, t: f64, w: &[f64], _g: &[f64]) -> Result<(), EvaluationFailure> {
        if let Some(mut differences) = self.differences.take() {
            let outcome = differences.evaluate(self, t, w);
            self.differences = Some(differences);
            outcome?;
            (self.linearized, self.maps) = (true, true);
            return Ok(());
        }
        self.return_to(t, w)?;
        self.blocks.evaluate(&mut self.point.manifold, &self.point.state);
        let chart = self.point.manifold.chart_mut();
        self.maps = 3 * self.blocks.d.len() <= 8 * chart.fill();
        if self.maps {
            self.blocks.rate_map(chart, &mut self.rate_map);
        } else {
            self.start.copy_from(chart);
        }
        self.linearized = true;
        Ok(())
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.factor_matrix(gamma_h, gamma_h * gamma_h)
    }

    fn factor_complex(&mut self, gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        let (ndof, extra) = (self.point.manifold.chart().ndof(), self.point.state.z.len());
        let solver = self.complex.get_or_insert_with(|| Box::new(ComplexSolver::new(ndof, extra)));
        solver.factor(&self.blocks, gamma_h).map_err(|e| singular_jacobian(gamma_h.norm(), &e))
    }

    /// Velocity entries are forces, −ψ with the slope's accelerations: written as M̂ (v̈ − f) the change of M̂
    /// within the step would multiply stiff forces.
    fn defect(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &[f64],
        defect: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        require_finite(t, w)?;
        self.evaluate(t, w, false)?;
        let (rates, rest) = slope[ndof..].split_at(ndof);
        let (positions, forces) = defect.split_at_mut(ndof);
        let (forces, z) = forces.split_at_mut(ndof);
        for ((out, v), s) in positions.iter_mut().zip(&w[ndof..]).zip(slope) {
            *out = v - s;
        }
        let (manifold, state) = (&mut self.point.manifold, &mut self.point.state);
        manifold.reduced_residual(state, rates, &mut self.point.z_rate, forces);
        forces.iter_mut().for_each(|x| *x = -*x);
        for ((out, rate), s) in z.iter_mut().zip(&self.point.z_rate).zip(rest) {
            *out = rate - s;
        }
        Ok(())
    }

    fn solve_complex(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.weigh(x);
        self.weigh(y);
        self.solve_complex_defect(x, y);
    }

    fn solve_complex_defect(&mut self, x: &mut [f64], y: &mut [f64]) {
        let solver = self.complex.as_mut().expect("factored before");
        solver.solve(&self.blocks, x, y);
    }

    fn solve(&mut self, x: &mut [f64]) {
        self.weigh(x);
        self.solve_defect(x);
    }

    fn solve_defect(&mut self, x: &mut [f64]) {
        let ndof = self.point.manifold.chart().ndof();
        let gh = self.gamma_h;
        let (p, rest) = x.split_at_mut(ndof);
        let (v, z) = rest.split_at_mut(ndof);
        let b = &self.blocks;
        // b₂ = M̂ r_v − γh Ẑ E⁻¹ r_z
        self.b2.copy_from_slice(v);
        for (k, z) in z.iter().enumerate() {
            let scale = -gh * self.inverse_e[k] * z;
            for (out, zeta) in self.b2.iter_mut().zip(&b.force_extra[k * ndof..]) {
                *out += scale * zeta;
            }
        }
        // Π δp = M̂ r_p + γh (M̂₁' r_p + b₂)        Π δv = b₂ − γh M̂₂' r_p
        for (out, b2) in self.b1.iter_mut().zip(&self.b2) {
            *out = gh * b2;
        }
        multiply_add(&b.mass, 1.0, p, &mut self.b1);
        multiply_add(&self.m1, gh, p, &mut self.b1);
        multiply_add(&self.m2, -gh, p, &mut self.b2);
        if ndof > 0 {
            self.lu.solve(&mut self.b1);
            self.lu.solve(&mut self.b2);
        }
        p.copy_from_slice(&self.b1);
        v.copy_from_slice(&self.b2);
        for (k, z) in z.iter_mut().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by = dot(&b.extra_position[range.clone()], p) + dot(&b.extra_velocity[range], v);
            *z = self.inverse_e[k] * (*z + gh * by);
        }
    }

    fn second_order(&mut self) -> Option<&mut dyn SecondOrder> {
        Some(self)
    }

    fn time_derivative(&mut self, g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        g_t.fill(0.0);
        let (head, z) = g_t.split_at_mut(2 * ndof);
        let force = &mut head[ndof..];
        self.blocks.time_derivative(&mut self.point.manifold, &self.point.state, force, z);
        if ndof > 0 {
            self.mass_lu.factor(&self.blocks.mass).map_err(|e| singular_mass(&e))?;
            self.mass_lu.solve(force);
        }
        Ok(())
    }
}

/// Refuses an iterate that is not a number.
pub(super) fn require_finite(t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
    if w.iter().sum::<f64>().is_finite() {
        return Ok(());
    }
    Err(EvaluationFailure {
        code: "simulation/not-finite",
        message: format!("the iteration ran away at t = {t:.6} s"),
    })
}

fn singular_jacobian(gamma_h: f64, e: &SingularMatrix) -> EvaluationFailure {
    EvaluationFailure {
        code: "simulation/singular-jacobian",
        message: format!(
            "the integration Jacobian is singular at step coefficient {gamma_h:.1e} s: {e}"
        ),
    }
}

fn singular_mass(e: &SingularMatrix) -> EvaluationFailure {
    EvaluationFailure {
        code: "simulation/singular-mass",
        message: format!("the reduced mass matrix is singular: {e}"),
    }
}

/// y += α A x for a square A by rows.
pub(super) fn multiply_add(a: &[f64], alpha: f64, x: &[f64], y: &mut [f64]) {
    if x.is_empty() {
        return;
    }
    for (row, y) in a.chunks_exact(x.len()).zip(y) {
        *y += alpha * dot(row, x);
    }
}

pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| x * y).sum()
}
