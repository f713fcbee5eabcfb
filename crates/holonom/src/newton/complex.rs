//! The dense matrix with a complex γh.

use super::blocks::{ReducedBlocks, reversed};
use holonom_linalg::{Complex64, DenseComplexLu, SingularMatrix, dot};

/// Π = M̂ + γh M̂₁' + γ²h² M̂₂' with a complex γh, factored; the equations are those of
/// [`super::ReducedMatrix`].
#[derive(Debug, Clone)]
pub(super) struct ComplexSolver {
    gamma_h: Complex64,
    /// With the last variable first, as the real factor.
    lu: DenseComplexLu,
    pi: Vec<Complex64>,
    inverse_e: Vec<Complex64>,
    v: Vec<Complex64>,
}

impl ComplexSolver {
    pub(super) fn new(ndof: usize, extra_states: usize) -> Self {
        let zeros = |n: usize| vec![Complex64::new(0.0, 0.0); n];
        Self {
            gamma_h: Complex64::new(0.0, 0.0),
            lu: DenseComplexLu::new(ndof),
            pi: zeros(ndof * ndof),
            inverse_e: zeros(extra_states),
            v: zeros(ndof),
        }
    }

    /// Number of degrees of freedom.
    pub(super) fn ndof(&self) -> usize {
        self.v.len()
    }

    /// Forms and factors Π.
    pub(super) fn factor(
        &mut self,
        b: &ReducedBlocks,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix> {
        self.gamma_h = gamma_h;
        let ndof = self.ndof();
        let square = gamma_h * gamma_h;
        let parts = b.mass.iter().zip(b.damping.iter().zip(&b.stiffness));
        for (pi, (m, (m1, m2))) in self.pi.iter_mut().rev().zip(parts) {
            *pi = m + gamma_h * m1 + square * m2;
        }
        for (k, inverse_e) in self.inverse_e.iter_mut().enumerate() {
            *inverse_e = (1.0 - gamma_h * b.extra_extra[k]).inv();
            let range = k * ndof..(k + 1) * ndof;
            let (zeta, by_p, by_v) = (
                &b.force_extra[range.clone()],
                &b.extra_position[range.clone()],
                &b.extra_velocity[range],
            );
            for i in 0..ndof {
                let scale = square * *inverse_e * zeta[i];
                let row = &mut self.pi[(ndof - 1 - i) * ndof..(ndof - i) * ndof];
                for (j, pi) in row.iter_mut().rev().enumerate() {
                    *pi += scale * (by_v[j] + gamma_h * by_p[j]);
                }
            }
        }
        if ndof == 0 {
            return Ok(());
        }
        self.lu.factor(&self.pi).map_err(|e| reversed(&e, ndof))
    }

    /// x + iy ← (I − γh J)⁻¹ (x + iy), the velocity entries of x and y multiplied by M̂ already.
    pub(super) fn solve(&mut self, b: &ReducedBlocks, x: &mut [f64], y: &mut [f64]) {
        let (ndof, gamma_h) = (self.ndof(), self.gamma_h);
        let at = |x: &[f64], y: &[f64], i: usize| Complex64::new(x[i], y[i]);
        let times = |row: &[f64], x: &[f64], y: &[f64]| Complex64::new(dot(row, x), dot(row, y));
        // M̂₂' r_p without the part by extra states, which goes along with r_z.
        for (i, v) in self.v.iter_mut().enumerate() {
            let row = &b.stiffness[i * ndof..(i + 1) * ndof];
            *v = at(x, y, ndof + i) - gamma_h * times(row, x, y);
        }
        for (k, inverse_e) in self.inverse_e.iter().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by_p = gamma_h * times(&b.extra_position[range.clone()], x, y);
            let scale = gamma_h * inverse_e * (at(x, y, 2 * ndof + k) + by_p);
            for (v, zeta) in self.v.iter_mut().zip(&b.force_extra[range]) {
                *v -= scale * zeta;
            }
        }
        self.v.reverse();
        self.lu.solve(&mut self.v);
        self.v.reverse();
        for (i, v) in self.v.iter().enumerate() {
            let p = at(x, y, i) + gamma_h * v;
            (x[i], y[i]) = (p.re, p.im);
            (x[ndof + i], y[ndof + i]) = (v.re, v.im);
        }
        for (k, inverse_e) in self.inverse_e.iter().enumerate() {
            let (range, j) = (k * ndof..(k + 1) * ndof, 2 * ndof + k);
            let by_p = times(&b.extra_position[range.clone()], x, y);
            let by_v = times(&b.extra_velocity[range], &x[ndof..], &y[ndof..]);
            let z = inverse_e * (at(x, y, j) + gamma_h * (by_p + by_v));
            (x[j], y[j]) = (z.re, z.im);
        }
    }
}
