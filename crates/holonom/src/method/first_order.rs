//! The first-order reduction: w = (v, v̇, z) on the constraint manifold as an [`Ode`].

use super::acceleration_buffers::AccelerationBuffers;
use super::ode::{Complex64, EvaluationFailure, LinearizedOde, Ode, SecondOrder, require_finite};
use super::weights::Weights;
use crate::model::Tolerance;
use crate::newton::{
    FirstOrderMatrix, JacobianSource, Matrix, MatrixOptions, Newton, ReducedMatrix, Representation,
    SmallRotations, SpectrumError,
};
use crate::reduction::{Manifold, Point};
use crate::system::State;

/// ẇ = (v̇, v̈(t, v, v̇, z), ż), linearized by a matrix `M`.
#[derive(Debug, Clone)]
pub struct FirstOrder<M = ReducedMatrix> {
    /// The stages' point.
    pub(super) point: Point,
    pub(super) newton: Newton<M>,
    weights: Weights,
    /// (t, w) of the last full evaluation; NaN if none is current.
    at: Vec<f64>,
    pub(super) at_time: f64,
    /// Whether the matrix has been turned halfway through the step to the state last evaluated.
    halfway: bool,
    dq: Vec<f64>,
    dv: Vec<f64>,
    rows: Vec<f64>,
    rates: Vec<f64>,
    /// Defects and residuals are accelerations.
    pub(super) by_accelerations: bool,
    /// For stages that are solved for accelerations.
    pub(super) stage: AccelerationBuffers,
}

impl FirstOrder {
    /// With the dense reduced matrix, at a consistent state whose factors the manifold holds.
    pub fn new(manifold: Manifold, weights: Weights, state: &State) -> Self {
        Self::with_matrix(manifold, weights, state)
    }

    /// Real and imaginary parts, 1/s, of the eigenvalues of J = g_w at a consistent state whose factors the manifold
    /// holds.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues(
        manifold: Manifold,
        state: &State,
    ) -> Result<Vec<(f64, f64)>, SpectrumError> {
        Self::for_eigenvalues(manifold, state).eigenvalues_at(state)
    }

    /// The same of J in small rotations in place of rotation vectors.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues_of_rotations(
        manifold: Manifold,
        state: &State,
    ) -> Result<Vec<(f64, f64)>, SpectrumError> {
        let rotations = SmallRotations::new(&manifold, state);
        Self::for_eigenvalues(manifold, state).eigenvalues_in(&rotations, state)
    }

    /// A form whose weights are nobody's, at a consistent state whose factors the manifold holds.
    fn for_eigenvalues(manifold: Manifold, state: &State) -> Self {
        let tolerance = Tolerance::uniform(1.0);
        let weights = Weights::new(tolerance, manifold.system().as_ref(), state);
        Self::new(manifold, weights, state)
    }

    /// The same eigenvalues where the manifold stands now.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues_at(&mut self, state: &State) -> Result<Vec<(f64, f64)>, SpectrumError> {
        self.eigenvalues_in(&SmallRotations::default(), state)
    }

    fn eigenvalues_in(
        &mut self,
        rotations: &SmallRotations,
        state: &State,
    ) -> Result<Vec<(f64, f64)>, SpectrumError> {
        let mut w = vec![0.0; self.dimension()];
        self.pack(state, &mut w);
        self.linearize(state.t, &w)?;
        self.newton.blocks().eigenvalues(rotations)
    }

    /// Moves to a state with independent variables `p`, where rotation vectors are measured from.
    ///
    /// # Errors
    /// As [`Manifold::stand_at`].
    pub fn stand_at(&mut self, state: &State, p: &[f64]) -> Result<(), EvaluationFailure> {
        let State { t, q, winding, .. } = state;
        let manifold = &mut self.point.manifold;
        manifold.stand_at(*t, q, p, winding, true, std::iter::empty())?;
        self.forget_evaluation();
        self.begin_step(state);
        Ok(())
    }
}

impl<M: Matrix> FirstOrder<M> {
    /// Starts at a consistent state whose factors the manifold holds.
    pub fn with_matrix(mut manifold: Manifold, weights: Weights, state: &State) -> Self {
        let s = manifold.system().structure().sizes;
        let ndof = manifold.chart().ndof();
        Self {
            newton: new_matrix(&mut manifold, &state.q, MatrixOptions::default()),
            weights,
            at: vec![f64::NAN; 2 * ndof + s.extra_states],
            at_time: f64::NAN,
            halfway: false,
            dq: vec![0.0; s.coordinates],
            dv: vec![0.0; s.coordinates],
            rows: vec![0.0; s.rows],
            rates: vec![0.0; ndof],
            by_accelerations: false,
            stage: AccelerationBuffers::new(ndof, &s),
            point: Point::new(manifold, state),
        }
    }

    /// Which matrix is used; the default one unless said otherwise.
    pub fn set_matrix(&mut self, options: MatrixOptions) {
        self.newton = new_matrix(&mut self.point.manifold, &self.point.anchor, options);
        self.halfway = false;
    }

    /// The integration Jacobian.
    pub fn newton(&self) -> &Newton<M> {
        &self.newton
    }

    /// The point of the last evaluation.
    pub fn point(&self) -> &Point {
        &self.point
    }

    /// The same, for changes of the parametrization.
    pub fn point_mut(&mut self) -> &mut Point {
        self.halfway = false;
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

    /// A change of w on the coordinates and velocities of all bodies, with the factors of the last evaluation.
    pub fn spread(&mut self, change: &[f64]) -> [&[f64]; 2] {
        let Self { point, dq, dv, rows, rates, .. } = self;
        point.spread(change, dq, dv, rows, rates);
        [dq, dv]
    }

    /// The part of it on coordinates.
    pub fn displace(&mut self, change: &[f64]) -> &[f64] {
        let Self { point, dq, rows, rates, .. } = self;
        point.displace(&change[..rates.len()], dq, rows);
        dq
    }

    /// Error weights at the start of the step.
    pub fn weights(&self) -> &Weights {
        &self.weights
    }

    /// The state that the next step starts from: weights and windings follow it.
    pub fn begin_step(&mut self, state: &State) {
        // Recoveries go on from here, not from a stage of the step before.
        self.point.begin_step(state);
        self.halfway = false;
        self.weights.set(state);
        if self.weights.are_independent() {
            self.set_independent_weights(state);
        }
        if !self.newton.is_linearized() {
            self.newton.begin_step(self.point.manifold.chart_mut());
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
        (self.at_time, self.halfway) = (f64::NAN, false);
        self.point.evaluate(t, positions, rates, z, full)?;
        if full {
            self.at_time = t;
            self.at.copy_from_slice(w);
        }
        Ok(&self.point.state)
    }

    /// The last evaluation is none of the present equations.
    fn forget_evaluation(&mut self) {
        self.at_time = f64::NAN;
        self.at.fill(f64::NAN);
    }

    /// Linearizes at (t, w).
    pub(super) fn linearize_at(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        self.return_to(t, w)?;
        let outcome = self.newton.linearize(&mut self.point, w);
        if outcome.is_err() {
            self.at_time = f64::NAN;
        }
        outcome
    }

    /// Linearizes at (t, w) with the accelerations of `slope` and the multipliers that belong to them; by
    /// differences, with those that the equations give.
    pub(super) fn linearize_by(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &[f64],
    ) -> Result<(), EvaluationFailure> {
        if self.newton.source() == JacobianSource::Differences {
            return self.linearize_at(t, w);
        }
        let ndof = self.point.manifold.chart().ndof();
        require_finite(t, w)?;
        self.evaluate(t, w, false)?;
        let (state, z_rate) = (&mut self.point.state, &mut self.point.z_rate);
        let rates = &slope[ndof..2 * ndof];
        self.point.manifold.reduced_residual(state, rates, z_rate, &mut self.rates);
        if !self.newton.goes_along(&self.point.manifold) {
            self.point.manifold.complete_residual(state);
        }
        self.newton.linearize(&mut self.point, w)
    }

    /// Makes factors, M, accelerations and multipliers those of (t, w).
    fn return_to(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        if t != self.at_time || w != self.at {
            self.point.return_to_anchor();
            self.evaluate(t, w, true)?;
        }
        if !self.newton.goes_along(&self.point.manifold) {
            self.point.complete();
        }
        Ok(())
    }

    /// After a re-parametrization by [`Manifold::set_chart`]: sizes may differ.
    pub fn reparametrized(&mut self) {
        let ndof = self.point.manifold.chart().ndof();
        self.set_matrix(self.newton.options());
        self.at.resize(2 * ndof + self.point.state.z.len(), f64::NAN);
        self.forget_evaluation();
        self.rates.resize(ndof, 0.0);
        self.stage.resize(ndof);
    }

    /// Turns a change of w from where the matrix belongs to this stage.
    pub(super) fn turn_to(&mut self, stage: usize, change: &mut [f64]) {
        let (positions, rest) = change.split_at_mut(self.rates.len());
        self.newton.turn(stage, positions);
        self.newton.turn(stage, rest);
    }

    /// Turns a change of w to where the matrix belongs, and the first stage with it, from halfway through the step: there the
    /// matrix is right to the second order of the turn.
    pub(super) fn turn_from_halfway(&mut self, change: &mut [f64]) {
        if !std::mem::replace(&mut self.halfway, true) {
            let Point { manifold, state, anchor, .. } = &self.point;
            let per_body = manifold.system().structure().sizes.per_body;
            let between = self.dq.chunks_exact_mut(per_body);
            let ends = anchor.chunks_exact(per_body).zip(state.q.chunks_exact(per_body));
            between.zip(ends).for_each(|(out, (a, b))| halfway(a, b, out));
            self.newton.align(0, manifold, &self.dq);
        }
        let (positions, rest) = change.split_at_mut(self.rates.len());
        self.newton.turn_back(0, positions);
        self.newton.turn_back(0, rest);
    }

    /// Factors M̂ + γh M̂₁' + βh² M̂₂': Π for β = γ², and Ψ of the state-space method.
    pub(super) fn factor_matrix(
        &mut self,
        gamma_h: f64,
        beta_h2: f64,
    ) -> Result<(), EvaluationFailure> {
        self.point.manifold.counters.analyses += self.newton.factor(gamma_h, beta_h2)?;
        Ok(())
    }
}

/// A matrix, with room in the manifold for the solves that it takes.
pub(super) fn new_matrix<M: Matrix>(
    manifold: &mut Manifold,
    q: &[f64],
    options: MatrixOptions,
) -> Newton<M> {
    let newton = Newton::new(manifold, q, options);
    if newton.representation() == Representation::Dense {
        manifold.reserve_lanes();
    }
    newton
}

impl<M: Matrix> Ode for FirstOrder<M> {
    fn dimension(&self) -> usize {
        2 * self.point.manifold.chart().ndof() + self.point.state.z.len()
    }

    fn second_order_split(&self) -> usize {
        self.point.manifold.chart().ndof()
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        require_finite(t, w)?;
        if t != self.at_time || w != self.at {
            self.evaluate(t, w, true)?;
        }
        g[..ndof].copy_from_slice(&w[ndof..2 * ndof]);
        let Point { manifold, state, .. } = &mut self.point;
        manifold.independent_acceleration_anew(state, &mut g[ndof..2 * ndof]);
        g[2 * ndof..].copy_from_slice(&self.point.z_rate);
        Ok(())
    }

    /// On all coordinates, with the factors of the linearization.
    fn norm(&mut self, change: &[f64]) -> f64 {
        if self.weights.are_independent() {
            return self.weights.independent_norm(change, None);
        }
        self.newton.spread(change, &mut self.dq, &mut self.dv);
        let extra = &change[2 * self.rates.len()..];
        self.weights.norm(self.newton.linearized_at(), [&self.dq, &self.dv], extra)
    }

    /// With the factors of the last evaluation, which was at the end of the step or next to it: those of
    /// the start hide what a chart that degrades makes of an error.
    fn error_norm(&mut self, error: &[f64], w_end: &[f64]) -> f64 {
        if self.weights.are_independent() {
            return self.weights.independent_norm(error, Some(w_end));
        }
        self.spread(error);
        let extra = &error[2 * self.rates.len()..];
        let state = &self.point.state;
        self.weights.norm(Some([&state.q, &state.v]), [&self.dq, &self.dv], extra)
    }
}

impl<M: FirstOrderMatrix> LinearizedOde for FirstOrder<M> {
    fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        self.linearize_at(t, w)
    }

    fn linearize_ahead(
        &mut self,
        t: f64,
        w: &[f64],
        slope: &[f64],
    ) -> Result<(), EvaluationFailure> {
        self.linearize_by(t, w, slope)
    }

    fn simplify(&mut self, simplify: bool) {
        self.newton.simplify(simplify);
    }

    fn is_simplified(&self) -> bool {
        self.newton.is_simplified()
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.factor_matrix(gamma_h, gamma_h * gamma_h)
    }

    fn factor_complex(&mut self, gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        self.newton.factor_complex(gamma_h)
    }

    fn has_accelerations(&self) -> bool {
        true
    }

    fn take_accelerations(&mut self, take: bool) {
        self.by_accelerations = take;
    }

    /// Velocity entries are forces, −ψ with the slope's accelerations: written as M̂ (v̈ − f) the change of M̂
    /// within the step would multiply stiff forces. By accelerations they are M̂₀ (f − v̈), M̂₀ of the linearization, which
    /// does not feel how M̂ changes.
    fn defect(
        &mut self,
        stage: usize,
        t: f64,
        w: &[f64],
        slope: &[f64],
        defect: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let ndof = self.point.manifold.chart().ndof();
        require_finite(t, w)?;
        self.evaluate(t, w, self.by_accelerations)?;
        let (rates, rest) = slope[ndof..].split_at(ndof);
        let (positions, forces) = defect.split_at_mut(ndof);
        let (forces, z) = forces.split_at_mut(ndof);
        for ((out, v), s) in positions.iter_mut().zip(&w[ndof..]).zip(slope) {
            *out = v - s;
        }
        let (manifold, state) = (&mut self.point.manifold, &mut self.point.state);
        self.newton.align(stage, manifold, &state.q);
        self.newton.turn_back(stage, positions);
        if self.by_accelerations {
            residual_rates(manifold, state, rates, forces);
            self.newton.turn_back(stage, forces);
            self.newton.weigh_rates(forces);
        } else {
            manifold.reduced_residual(state, rates, &mut self.point.z_rate, forces);
            self.newton.take_forces(stage, forces);
            self.newton.respond_to_mass(stage, manifold, forces);
        }
        forces.iter_mut().for_each(|x| *x = -*x);
        for ((out, rate), s) in z.iter_mut().zip(&self.point.z_rate).zip(rest) {
            *out = rate - s;
        }
        Ok(())
    }

    fn turns(&self) -> bool {
        self.newton.aligns()
    }

    fn turn(&mut self, stage: usize, change: &mut [f64]) {
        self.turn_to(stage, change);
    }

    fn turn_back(&mut self, change: &mut [f64]) {
        self.turn_from_halfway(change);
    }

    fn solve_complex(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.newton.weigh(x);
        self.newton.weigh(y);
        self.newton.solve_complex(x, y);
    }

    fn solve_complex_defect(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.newton.solve_complex(x, y);
    }

    fn solve(&mut self, x: &mut [f64]) {
        if self.newton.is_simplified() {
            self.newton.filter(x);
            return;
        }
        self.newton.weigh(x);
        self.newton.solve(x);
    }

    fn solve_defect(&mut self, x: &mut [f64]) {
        self.newton.solve(x);
    }

    fn second_order(&mut self) -> Option<&mut dyn SecondOrder> {
        Some(self)
    }

    fn time_derivative(&mut self, g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        self.newton.time_derivative(&mut self.point, g_t)
    }
}

/// v̈ − f of a stage with the accelerations `rates` and those f of the equations, which have been evaluated.
pub(super) fn residual_rates(
    manifold: &mut Manifold,
    state: &State,
    rates: &[f64],
    out: &mut [f64],
) {
    manifold.independent_acceleration_anew(state, out);
    for (out, rate) in out.iter_mut().zip(rates) {
        *out = rate - *out;
    }
}

/// The pose of a body halfway between two others, (r, Euler parameters) or (x, y, angle).
fn halfway(a: &[f64], b: &[f64], out: &mut [f64]) {
    let dot: f64 = a.iter().zip(b).skip(3).map(|(a, b)| a * b).sum();
    let sign = if dot < 0.0 { -1.0 } else { 1.0 };
    for (k, (out, (a, b))) in out.iter_mut().zip(a.iter().zip(b)).enumerate() {
        *out = 0.5 * (a + if k < 3 { *b } else { sign * b });
    }
    let turned = &mut out[3..];
    let length = turned.iter().map(|x| x * x).sum::<f64>().sqrt();
    turned.iter_mut().for_each(|x| *x /= length);
}
