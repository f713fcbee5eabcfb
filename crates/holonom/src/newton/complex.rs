//! The dense matrix with a complex γh.

use super::blocks::{ReducedBlocks, reversed};
use super::extra::Elimination;
use crate::system::Structure;
use holonom_linalg::{Complex64, DenseComplexLu, SingularMatrix, dot};

/// Π = M̂ + γh M̂₁' + γ²h² M̂₂' with a complex γh, factored; the equations are those of
/// [`super::ReducedMatrix`].
#[derive(Debug, Clone)]
pub(super) struct ComplexSolver {
    gamma_h: Complex64,
    /// With the last variable first, as the real factor.
    lu: DenseComplexLu,
    pi: Vec<Complex64>,
    extra: Elimination<Complex64>,
    v: Vec<Complex64>,
    z: Vec<Complex64>,
}

impl ComplexSolver {
    pub(super) fn new(ndof: usize, structure: &Structure) -> Self {
        let zeros = |n: usize| vec![Complex64::new(0.0, 0.0); n];
        Self {
            gamma_h: Complex64::new(0.0, 0.0),
            lu: DenseComplexLu::new(ndof),
            pi: zeros(ndof * ndof),
            extra: Elimination::new(structure),
            v: zeros(ndof),
            z: zeros(structure.sizes.extra_states),
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
        self.extra.factor(gamma_h, &b.extra_extra, [&b.extra_position, &b.extra_velocity]);
        for k in 0..self.z.len() {
            let range = k * ndof..(k + 1) * ndof;
            let (zeta, by_p, by_v) = (
                &b.force_extra[range.clone()],
                &self.extra.by_position[range.clone()],
                &self.extra.by_velocity[range],
            );
            for (effect, (by_p, by_v)) in self.v.iter_mut().zip(by_p.iter().zip(by_v)) {
                *effect = square * (by_v + gamma_h * by_p);
            }
            for i in 0..ndof {
                let row = &mut self.pi[(ndof - 1 - i) * ndof..(ndof - i) * ndof];
                for (pi, effect) in row.iter_mut().rev().zip(&self.v) {
                    *pi += effect * zeta[i];
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
        for (k, z) in self.z.iter_mut().enumerate() {
            let by_p = times(&b.extra_position[k * ndof..(k + 1) * ndof], x, y);
            *z = at(x, y, 2 * ndof + k) + gamma_h * by_p;
        }
        self.extra.solve(&mut self.z);
        for (k, z) in self.z.iter().enumerate() {
            for (v, zeta) in self.v.iter_mut().zip(&b.force_extra[k * ndof..]) {
                *v -= gamma_h * z * zeta;
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
        for (k, z) in self.z.iter_mut().enumerate() {
            let range = k * ndof..(k + 1) * ndof;
            let by_p = times(&b.extra_position[range.clone()], x, y);
            let by_v = times(&b.extra_velocity[range], &x[ndof..], &y[ndof..]);
            *z = at(x, y, 2 * ndof + k) + gamma_h * (by_p + by_v);
        }
        self.extra.solve(&mut self.z);
        for (k, z) in self.z.iter().enumerate() {
            (x[2 * ndof + k], y[2 * ndof + k]) = (z.re, z.im);
        }
    }
}
