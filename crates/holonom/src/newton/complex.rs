//! The dense matrix with a complex γh.

use super::blocks::ReducedBlocks;
use holonom_linalg::{Complex64, DenseComplexLu, SingularMatrix};

/// Π = M̂ + γh M̂₁' + γ²h² M̂₂' with a complex γh, factored; the equations are those of
/// [`super::ReducedMatrix`].
#[derive(Debug, Clone)]
pub(super) struct ComplexSolver {
    gamma_h: Complex64,
    lu: DenseComplexLu,
    pi: Vec<Complex64>,
    /// γh M̂₁' and γ²h² M̂₂'.
    m1: Vec<Complex64>,
    m2: Vec<Complex64>,
    inverse_e: Vec<Complex64>,
    p: Vec<Complex64>,
    b1: Vec<Complex64>,
    b2: Vec<Complex64>,
}

impl ComplexSolver {
    pub(super) fn new(ndof: usize, extra_states: usize) -> Self {
        let zeros = |n: usize| vec![Complex64::new(0.0, 0.0); n];
        Self {
            gamma_h: Complex64::new(0.0, 0.0),
            lu: DenseComplexLu::new(ndof),
            pi: zeros(ndof * ndof),
            m1: zeros(ndof * ndof),
            m2: zeros(ndof * ndof),
            inverse_e: zeros(extra_states),
            p: zeros(ndof),
            b1: zeros(ndof),
            b2: zeros(ndof),
        }
    }

    /// Number of degrees of freedom.
    pub(super) fn ndof(&self) -> usize {
        self.p.len()
    }

    /// Forms and factors Π.
    pub(super) fn factor(
        &mut self,
        b: &ReducedBlocks,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix> {
        self.gamma_h = gamma_h;
        let ndof = self.ndof();
        for (m1, x) in self.m1.iter_mut().zip(&b.damping) {
            *m1 = gamma_h * x;
        }
        for (m2, x) in self.m2.iter_mut().zip(&b.stiffness) {
            *m2 = gamma_h * gamma_h * x;
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
                let scale = gamma_h * gamma_h * *inverse_e * zeta[i];
                for j in 0..ndof {
                    self.m1[i * ndof + j] += scale * by_v[j];
                    self.m2[i * ndof + j] += scale * gamma_h * by_p[j];
                }
            }
        }
        for (((pi, m), m1), m2) in self.pi.iter_mut().zip(&b.mass).zip(&self.m1).zip(&self.m2) {
            *pi = m + m1 + m2;
        }
        if ndof == 0 { Ok(()) } else { self.lu.factor(&self.pi) }
    }

    /// x + iy ← (I − γh J)⁻¹ (x + iy), the velocity entries of x and y multiplied by M̂ already.
    pub(super) fn solve(&mut self, b: &ReducedBlocks, x: &mut [f64], y: &mut [f64]) {
        let ndof = self.ndof();
        let at = |i: usize| Complex64::new(x[i], y[i]);
        for (i, p) in self.p.iter_mut().enumerate() {
            *p = at(i);
        }
        for i in 0..ndof {
            let mut sum = at(ndof + i);
            for (k, inverse_e) in self.inverse_e.iter().enumerate() {
                sum -= self.gamma_h * inverse_e * at(2 * ndof + k) * b.force_extra[k * ndof + i];
            }
            self.b2[i] = sum;
        }
        for i in 0..ndof {
            let range = i * ndof..(i + 1) * ndof;
            let (m, m1, m2) = (&b.mass[range.clone()], &self.m1[range.clone()], &self.m2[range]);
            let mut first = self.gamma_h * self.b2[i];
            let mut second = Complex64::new(0.0, 0.0);
            for (j, p) in self.p.iter().enumerate() {
                first += (m1[j] + m[j]) * p;
                second += m2[j] * p;
            }
            self.b1[i] = first;
            self.b2[i] -= second / self.gamma_h;
        }
        if ndof > 0 {
            self.lu.solve(&mut self.b1);
            self.lu.solve(&mut self.b2);
        }
        for (k, inverse_e) in self.inverse_e.iter().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let (by_p, by_v) = (&b.extra_position[range.clone()], &b.extra_velocity[range]);
            let mut by = Complex64::new(0.0, 0.0);
            for i in 0..ndof {
                by += self.b1[i] * by_p[i] + self.b2[i] * by_v[i];
            }
            let j = 2 * ndof + k;
            let z = inverse_e * (Complex64::new(x[j], y[j]) + self.gamma_h * by);
            (x[j], y[j]) = (z.re, z.im);
        }
        for (i, (p, v)) in self.b1.iter().zip(&self.b2).enumerate() {
            (x[i], y[i]) = (p.re, p.im);
            (x[ndof + i], y[ndof + i]) = (v.re, v.im);
        }
    }
}
