//! What methods use: linearize, factor, solve.

use super::alignment::Alignment;
use super::blocks::ReducedBlocks;
use super::descriptor::Unknowns;
use super::differences::Differences;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions};
use crate::error::EvaluationFailure;
use crate::model::{JacobianSource, Representation};
use crate::reduction::{Chart, Manifold, Point};
use holonom_linalg::{Complex64, SingularMatrix};

/// The integration Jacobian of a form of the equations, in the representation `M`.
///
/// Changes are those of w = (v, v̇, z). Equations: `docs/theory/newton.md`.
#[derive(Debug, Clone)]
pub struct Newton<M> {
    options: MatrixOptions,
    parts: Linearization,
    /// None where the derivatives of the equations are used.
    differences: Option<Box<Differences>>,
    matrix: M,
    alignment: Alignment,
    rate: Vec<f64>,
    felt: Vec<f64>,
    turned: Vec<f64>,
}

impl<M: Matrix> Newton<M> {
    /// For the manifold's present parametrization, whose factors belong to the configuration `q`.
    pub fn new(manifold: &Manifold, q: &[f64], options: MatrixOptions) -> Self {
        let matrix = M::new(manifold, q, &options);
        Self {
            parts: Linearization::new(manifold, matrix.is_reduced(), &options.threads),
            differences: match options.source {
                JacobianSource::Analytic => None,
                JacobianSource::Differences => Some(Box::new(Differences::new(manifold))),
            },
            options,
            matrix,
            alignment: Alignment::new(manifold, q),
            rate: vec![0.0; manifold.chart().ndof()],
            felt: vec![0.0; manifold.chart().ndof()],
            turned: vec![0.0; manifold.chart().ndof()],
        }
    }

    /// Where the parts come from.
    pub fn source(&self) -> JacobianSource {
        self.options.source
    }

    /// What was asked for.
    pub fn options(&self) -> MatrixOptions {
        self.options.clone()
    }

    /// The representation in use.
    pub fn representation(&self) -> Representation {
        if self.matrix.is_reduced() { Representation::Dense } else { Representation::Sparse }
    }

    /// From the next linearization on the matrix may leave out of the Jacobian what slows iterations little. Filtered errors
    /// are those of the Jacobian itself all the same.
    pub fn simplify(&mut self, simplify: bool) {
        self.matrix.simplify(simplify);
    }

    /// Whether the last linearization has left that out.
    pub fn is_simplified(&self) -> bool {
        self.matrix.is_simplified()
    }

    /// Reduced blocks of the last linearization, as far as the representation has them.
    pub fn blocks(&self) -> &ReducedBlocks {
        &self.parts.blocks
    }

    /// Whether there has been a linearization.
    pub fn is_linearized(&self) -> bool {
        self.parts.made
    }

    /// Coordinates and velocities of the last linearization.
    pub fn linearized_at(&self) -> Option<[&[f64]; 2]> {
        self.parts.made.then(|| [&*self.parts.q, &*self.parts.v])
    }

    /// A step starts where this is the chart: changes are measured there until the first linearization.
    pub fn begin_step(&mut self, chart: &Chart) {
        self.parts.begin_step(chart);
    }

    /// Whether a linearization at this point goes along the tree, and asks for no multipliers of its joints.
    pub fn goes_along(&self, manifold: &Manifold) -> bool {
        self.differences.is_none() && self.matrix.goes_along() && manifold.linearizes()
    }

    /// Linearizes at a point, complete unless it goes along the tree there, whose independent variables, rates and extra states are `w`, and
    /// leaves it evaluated there.
    ///
    /// # Errors
    /// Where a neighbouring point for differences cannot be evaluated; the point is then elsewhere.
    pub fn linearize(&mut self, point: &mut Point, w: &[f64]) -> Result<(), EvaluationFailure> {
        if !self.goes_along(&point.manifold) {
            point.manifold.catch_up()?;
        }
        self.parts.q.copy_from_slice(&point.state.q);
        self.parts.v.copy_from_slice(&point.state.v);
        self.alignment.begin(&point.manifold, &point.state.q);
        if let Some(differences) = &mut self.differences {
            self.parts.take_differences(differences, point, w)?;
            self.matrix.take_blocks(&self.parts, &point.manifold);
        } else {
            self.matrix.linearize(&mut self.parts, point);
            self.parts.made = true;
        }
        Ok(())
    }

    /// Factors M̂ + γh M̂₁' + βh² M̂₂'; returns the number of symbolic analyses made.
    ///
    /// # Errors
    /// When the matrix is singular.
    pub fn factor(&mut self, gamma_h: f64, beta_h2: f64) -> Result<u64, EvaluationFailure> {
        self.parts.set_coefficients(gamma_h, beta_h2);
        self.matrix.factor(&self.parts).map_err(|e| singular_jacobian(gamma_h, &e))
    }

    /// Whether stages see the matrix turned, see [`Newton::align`].
    pub fn aligns(&self) -> bool {
        self.alignment.is_needed()
    }

    /// A stage is at this configuration: the matrix turns along with its bodies. Where one has a small inertia about an
    /// axis, its forces would otherwise be told from those of the others by the direction of that axis at the linearization.
    pub fn align(&mut self, stage: usize, manifold: &Manifold, q: &[f64]) {
        self.alignment.follow(stage, manifold, q);
    }

    /// Forces ψ of a stage as the matrix takes them.
    pub fn take_forces(&mut self, stage: usize, psi: &mut [f64]) {
        self.alignment.take_forces(stage, psi);
    }

    /// A change of v, or of v̇, that the matrix gives, as the stage takes it.
    pub fn turn(&mut self, stage: usize, change: &mut [f64]) {
        self.alignment.turn(stage, change);
    }

    /// The inverse of [`Newton::turn`].
    pub fn turn_back(&mut self, stage: usize, change: &mut [f64]) {
        self.alignment.turn_back(stage, change);
    }

    /// Multiplies an error (e_p, e_v, e_z) by (I − γhJ)⁻¹ with one solve: with ẽ_p = e_p + (β/γ)h e_v,
    /// Ψ a = −(M̂₁' e_v + M̂₂' ẽ_p + Ẑ E⁻¹ e_z), the result is ẽ_p + βh² a, e_v + γh a, and
    /// E⁻¹(e_z + γh (ż_v · + ż_v̇ ·)).
    pub fn filter(&mut self, error: &mut [f64]) {
        let ndof = self.rate.len();
        let (gh, bh2) = (self.parts.gamma_h, self.parts.beta_h2);
        let (head, ez) = error.split_at_mut(2 * ndof);
        let (ep, ev) = head.split_at_mut(ndof);
        for (p, v) in ep.iter_mut().zip(&*ev) {
            *p += bh2 / gh * v;
        }
        self.parts.extra.solve(ez);
        self.matrix.respond(&mut self.parts, ep, ev, ez, &mut self.rate);
        for ((p, v), a) in ep.iter_mut().zip(&mut *ev).zip(&self.rate) {
            *p += bh2 * a;
            *v += gh * a;
        }
        self.parts.add_effect_on_extra_states(ep, ev, ez);
    }

    /// A change of w on all coordinates: δq = D δv, δq̇ = D δv̇ − S A₀ δq, at the linearization.
    pub fn spread(&mut self, change: &[f64], dq: &mut [f64], dv: &mut [f64]) {
        let (p, rest) = change.split_at(self.rate.len());
        self.parts.spread(p, &rest[..self.rate.len()], dq, dv);
    }

    /// v̇ ← M̂ v̇ for rates v̇.
    pub fn weigh_rates(&mut self, rates: &mut [f64]) {
        self.matrix.weigh(&mut self.parts, rates);
    }
}

impl<M: FirstOrderMatrix> Newton<M> {
    /// One correction of a stage: from ψ in `rate` and z̃ + γh ż − z in the last entries of `change`, δv̈
    /// and its effect (βh² δv̈, γh δv̈, δz).
    pub fn correct(&mut self, rate: &mut [f64], change: &mut [f64]) {
        let dz = &mut change[2 * rate.len()..];
        self.parts.extra.solve(dz);
        self.matrix.correct(&self.parts, dz, rate);
        self.parts.effect(rate, change);
    }

    /// Takes from the forces of a stage what the change of M̂ since the linearization makes of them:
    /// ψ ← ψ − (M̂ − M̂₀) Ψ⁻¹ψ with M̂ of the last residual of `manifold`, turned as the matrix is.
    pub fn respond_to_mass(&mut self, stage: usize, manifold: &mut Manifold, psi: &mut [f64]) {
        self.rate.copy_from_slice(psi);
        self.matrix.correct(&self.parts, &[], &mut self.rate);
        self.turned.copy_from_slice(&self.rate);
        self.alignment.turn(stage, &mut self.turned);
        manifold.reduced_mass_times(&self.turned, &mut self.felt);
        self.alignment.take_forces(stage, &mut self.felt);
        self.matrix.weigh(&mut self.parts, &mut self.rate);
        for ((psi, now), then) in psi.iter_mut().zip(&self.felt).zip(&self.rate) {
            *psi += now - then;
        }
    }

    /// x ← (I − γhJ)⁻¹ x, with M̂ r_v in the velocity entries.
    pub fn solve(&mut self, x: &mut [f64]) {
        let (p, rest) = x.split_at_mut(self.rate.len());
        let (v, z) = rest.split_at_mut(self.rate.len());
        self.parts.extra.solve(z);
        self.matrix.solve(&mut self.parts, p, v, z);
        self.parts.add_effect_on_extra_states(p, v, z);
    }

    /// Factors I − γhJ for a complex γh, beside the real factor.
    ///
    /// # Errors
    /// When the matrix is singular.
    pub fn factor_complex(&mut self, gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        let outcome = self.matrix.factor_complex(&self.parts, gamma_h);
        outcome.map_err(|e| singular_jacobian(gamma_h.norm(), &e))
    }

    /// x + iy ← (I − γhJ)⁻¹ (x + iy), with M̂ r_v in the velocity entries.
    pub fn solve_complex(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.matrix.solve_complex(&mut self.parts, x, y);
    }

    /// The velocity entries r_v of a change of w become M̂ r_v.
    pub fn weigh(&mut self, x: &mut [f64]) {
        let ndof = self.rate.len();
        self.matrix.weigh(&mut self.parts, &mut x[ndof..2 * ndof]);
    }

    /// g_t of ẇ = g(t, w) at the point of the last linearization.
    ///
    /// # Errors
    /// When M̂ is singular.
    pub fn time_derivative(
        &mut self,
        point: &mut Point,
        g_t: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        g_t.fill(0.0);
        let (head, z) = g_t.split_at_mut(2 * self.rate.len());
        let v_rate = &mut head[self.rate.len()..];
        self.matrix.time_derivative(&mut self.parts, point, v_rate, z)
    }
}

impl<M: DescriptorForm> Newton<M> {
    /// One correction of a stage with q̈ and λ as unknowns too: residuals in `x` and z̃ + γh ż − z in the
    /// last entries of `change` become corrections.
    pub fn correct_unknowns(&mut self, x: &mut Unknowns, change: &mut [f64]) {
        let dz = &mut change[2 * x.rate.len()..];
        self.parts.extra.solve(dz);
        self.matrix.correct_unknowns(&mut self.parts, dz, x);
        self.parts.effect(&x.rate, change);
    }

    /// The residuals that reduced forces ψ are: (Pᵀψ, 0, 0) with P of the matrix, for which DᵀPᵀ = 1.
    pub fn extend(&self, psi: &[f64], x: &mut Unknowns) {
        self.parts.chart.extend(psi, &mut x.force);
        x.rows.fill(0.0);
        x.rate.fill(0.0);
    }
}

fn singular_jacobian(gamma_h: f64, e: &SingularMatrix) -> EvaluationFailure {
    EvaluationFailure::new(
        "simulation/singular-jacobian",
        format!("the integration Jacobian is singular at step coefficient {gamma_h:.1e} s: {e}"),
    )
}
