//! The dense matrix of order ndof.

use super::blocks::{reversed, singular_mass};
use super::complex::ComplexSolver;
use super::linearization::Linearization;
use super::matrix::{FirstOrderMatrix, Matrix, MatrixOptions};
use crate::error::EvaluationFailure;
use crate::reduction::{Manifold, Point};
use holonom_linalg::{Complex64, DenseLu, SingularMatrix, add_product};

/// Π = M̂ + γh M̂₁' + βh² M̂₂' of the reduced equations, dense.
///
/// ```text
/// M̂₁' = M̂₁ + γh Ẑ E⁻¹ ż_v̇   M̂₂' = M̂₂ + γh Ẑ E⁻¹ ż_v   E = I − γh ż_z   b = M̂ r_v − γh Ẑ E⁻¹ r_z
/// Π δv = b − γh M̂₂' r_p   δp = r_p + γh δv   δz = E⁻¹(r_z + γh (ż_v δp + ż_v̇ δv))
/// ```
///
/// Source: `docs/theory/newton.md` (1)-(6); thesis (3.103)-(3.105), with the extra states eliminated first.
#[derive(Debug, Clone)]
pub struct ReducedMatrix {
    /// Of Π with the last variable first: what is far from the root is eliminated before what it hangs on, so that branches
    /// do not fill each other's places.
    lu: DenseLu,
    mass_lu: DenseLu,
    /// Allocated at the first complex factorization: most formulas need none.
    complex: Option<Box<ComplexSolver>>,
    pi: Vec<f64>,
    m1: Vec<f64>,
    m2: Vec<f64>,
    felt: Vec<f64>,
}

impl ReducedMatrix {
    /// x ← Π⁻¹ x.
    fn solve_last_first(&self, x: &mut [f64]) {
        if !x.is_empty() {
            x.reverse();
            self.lu.solve(x);
            x.reverse();
        }
    }
}

impl Matrix for ReducedMatrix {
    fn new(manifold: &Manifold, _q: &[f64], _options: &MatrixOptions) -> Self {
        let ndof = manifold.chart().ndof();
        Self {
            lu: DenseLu::new(ndof),
            mass_lu: DenseLu::new(ndof),
            complex: None,
            pi: vec![0.0; ndof * ndof],
            m1: vec![0.0; ndof * ndof],
            m2: vec![0.0; ndof * ndof],
            felt: vec![0.0; ndof],
        }
    }

    fn goes_along(&self) -> bool {
        true
    }

    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point) {
        if point.manifold.linearizes() {
            parts.evaluate_along(point);
            return;
        }
        parts.along = false;
        parts.blocks.evaluate(&mut point.manifold, &point.state);
        parts.evaluate_maps(point.manifold.chart_mut());
    }

    fn take_blocks(&mut self, _parts: &Linearization, _manifold: &Manifold) {} // it has no others

    fn factor(&mut self, parts: &Linearization) -> Result<u64, SingularMatrix> {
        let (ndof, b) = (self.felt.len(), &parts.blocks);
        let (gamma_h, beta_h2) = (parts.gamma_h, parts.beta_h2);
        self.m1.copy_from_slice(&b.damping);
        self.m2.copy_from_slice(&b.stiffness);
        for k in 0..b.extra_extra.states() {
            let range = k * ndof..(k + 1) * ndof;
            let (zeta, by_p, by_v) = (
                &b.force_extra[range.clone()],
                &parts.extra.by_position[range.clone()],
                &parts.extra.by_velocity[range],
            );
            for i in 0..ndof {
                let scale = gamma_h * zeta[i];
                for j in 0..ndof {
                    self.m1[i * ndof + j] += scale * by_v[j];
                    self.m2[i * ndof + j] += scale * by_p[j];
                }
            }
        }
        let pi = self.pi.iter_mut().rev();
        for (((pi, m), m1), m2) in pi.zip(&b.mass).zip(&self.m1).zip(&self.m2) {
            *pi = m + gamma_h * m1 + beta_h2 * m2;
        }
        if ndof > 0 {
            self.lu.factor(&self.pi).map_err(|e| reversed(&e, ndof))?;
        }
        Ok(0)
    }

    fn respond(
        &mut self,
        parts: &mut Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        rate.fill(0.0);
        add_product(&self.m1, -1.0, v, rate);
        add_product(&self.m2, -1.0, p, rate);
        for (k, z) in z.iter().enumerate() {
            for (a, zeta) in rate.iter_mut().zip(&parts.blocks.force_extra[k * p.len()..]) {
                *a -= zeta * *z;
            }
        }
        self.solve_last_first(rate);
    }

    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        self.felt.fill(0.0);
        add_product(&parts.blocks.mass, 1.0, v, &mut self.felt);
        v.copy_from_slice(&self.felt);
    }
}

impl FirstOrderMatrix for ReducedMatrix {
    fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]) {
        let ndof = rate.len();
        rate.iter_mut().for_each(|r| *r = -*r);
        for (k, z) in z.iter().enumerate() {
            for (r, zeta) in rate.iter_mut().zip(&parts.blocks.force_extra[k * ndof..]) {
                *r -= zeta * *z;
            }
        }
        self.solve_last_first(rate);
    }

    fn solve(&mut self, parts: &mut Linearization, p: &mut [f64], v: &mut [f64], z: &[f64]) {
        let (ndof, gh, b) = (p.len(), parts.gamma_h, &parts.blocks);
        // v ← b − γh M̂₂' r_p
        for (k, z) in z.iter().enumerate() {
            let scale = -gh * z;
            for (out, zeta) in v.iter_mut().zip(&b.force_extra[k * ndof..]) {
                *out += scale * zeta;
            }
        }
        add_product(&self.m2, -gh, p, v);
        self.solve_last_first(v);
        for (p, v) in p.iter_mut().zip(v) {
            *p += gh * *v;
        }
    }

    fn factor_complex(
        &mut self,
        parts: &Linearization,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix> {
        let (ndof, structure) = (self.felt.len(), parts.system.structure());
        let new = || Box::new(ComplexSolver::new(ndof, structure));
        let solver = self.complex.get_or_insert_with(new);
        solver.factor(&parts.blocks, gamma_h)
    }

    fn solve_complex(&mut self, parts: &mut Linearization, x: &mut [f64], y: &mut [f64]) {
        let solver = self.complex.as_mut().expect("factored before");
        solver.solve(&parts.blocks, x, y);
    }

    fn time_derivative(
        &mut self,
        parts: &mut Linearization,
        point: &mut Point,
        v_rate: &mut [f64],
        z_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        let (manifold, state) = (&mut point.manifold, &point.state);
        if parts.along {
            manifold.time_derivative(state, &parts.blocks.blocks, v_rate, z_rate);
        } else {
            parts.blocks.time_derivative(manifold, state, v_rate, z_rate);
        }
        if !v_rate.is_empty() {
            self.mass_lu.factor(&parts.blocks.mass).map_err(|e| singular_mass(&e))?;
            self.mass_lu.solve(v_rate);
        }
        Ok(())
    }
}
