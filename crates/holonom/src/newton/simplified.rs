//! The simplified matrix: all of the force, and nothing of how joints and independent variables turn.

use super::blocks::ReducedBlocks;
use super::descriptor::add_extra_force;
use super::general::GeneralElimination;
use super::linearization::Linearization;
use super::sparse::ComplexSide;
use super::sparse_pattern::{Shape, Sum};
use crate::reduction::{Chart, Manifold};
use crate::system::State;
use holonom_linalg::{BlockMatrix, Complex64, SingularMatrix};

/// Newton's matrix without Ã₀ and Ã₁, unknowns a = Dρ and δλ:
///
/// ```text
/// (M + γh C + βh² K) a + Gᵀ δλ = f        G a = 0        ρ = P a
/// ```
///
/// It is (M̂ + γh DᵀCD + βh² DᵀKD) ρ = Dᵀf: I − γhJ' with a J' that has all of the force. Iterations with it contract by what it
/// leaves out; what needs J itself is corrected by residuals with J. Extra states are eliminated as in the inflated matrix.
///
/// Equations: `docs/theory/newton.md` (22)-(25).
#[derive(Debug, Clone)]
pub(super) struct Simplified {
    n: usize,
    elimination: Option<GeneralElimination>,
    /// Of f and G a.
    right: Vec<f64>,
    complex_right: Vec<Complex64>,
    /// δq, δq̇, δq̈ of all coordinates.
    spread: [Vec<f64>; 3],
    rows: Vec<f64>,
    rates: Vec<f64>,
    change: Vec<f64>,
}

/// Solves to one with J: what the matrix leaves out is then left to the second power, which is less than an estimate tells.
const PASSES: usize = 2;

impl Simplified {
    /// For the manifold's present parametrization.
    pub(super) fn new(manifold: &Manifold) -> Self {
        let structure = manifold.system().structure();
        let (n, parametrization) =
            (structure.sizes.coordinates, manifold.chart().parametrization());
        Self {
            n,
            elimination: None,
            right: vec![0.0; n + parametrization.kept.len()],
            complex_right: Vec::new(),
            spread: std::array::from_fn(|_| vec![0.0; n]),
            rows: vec![0.0; structure.sizes.rows],
            rates: vec![0.0; parametrization.ndof],
            change: vec![0.0; parametrization.ndof],
        }
    }

    /// Evaluates the blocks at a complete state.
    pub(super) fn linearize(
        &mut self,
        manifold: &Manifold,
        state: &State,
        blocks: &mut ReducedBlocks,
    ) {
        if let Some(elimination) = &mut self.elimination {
            blocks.evaluate_system(manifold, state);
            elimination.linearize(manifold, state, blocks);
        } else {
            let shape = Shape::Simplified;
            self.elimination = Some(GeneralElimination::new(shape, manifold, state, blocks));
        }
    }

    fn elimination(&mut self) -> &mut GeneralElimination {
        self.elimination.as_mut().expect("linearized before it is factored")
    }

    /// Sums and factors; returns the number of symbolic analyses made.
    pub(super) fn factor(&mut self, sum: &Sum<'_, f64>) -> Result<u64, SingularMatrix> {
        self.elimination().factor(sum)
    }

    /// The same with complex coefficients, after the real ones.
    pub(super) fn factor_complex(
        &mut self,
        sum: &Sum<'_, Complex64>,
    ) -> Result<(), SingularMatrix> {
        self.complex_right.resize(self.right.len(), Complex64::new(0.0, 0.0));
        self.elimination().factor_complex(sum)
    }

    /// P a of the last solution.
    fn solved_rate(&mut self, chart: &Chart, rate: &mut [f64]) {
        self.elimination.as_mut().expect("factored before").solve(&mut self.right);
        project(chart, &self.right[..self.n], rate);
    }

    /// ψ and then δv̈ in `rate`: f = −Pᵀψ − F_z δz.
    pub(super) fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]) {
        let (force, rows) = self.right.split_at_mut(self.n);
        rows.fill(0.0);
        parts.chart.extend(rate, force);
        force.iter_mut().for_each(|x| *x = -*x);
        add_extra_force(parts, None, |k| -z.get(k).copied().unwrap_or(0.0), force, 1);
        self.solved_rate(&parts.chart, rate);
    }

    /// ρ stands for δv̇: f = Pᵀ(M̂ r_v) − γh (K D r_p + F_z (r_z + γh E⁻¹ g_q D r_p)) with E⁻¹ r_z for r_z.
    pub(super) fn solve(
        &mut self,
        parts: &mut Linearization,
        p: &mut [f64],
        v: &mut [f64],
        z: &[f64],
    ) {
        let gh = parts.gamma_h;
        let [dq, dv, _] = &mut self.spread;
        self.rows.fill(0.0);
        parts.chart.solve(&self.rows, p, dq);
        dv.fill(0.0);
        let (force, rows) = self.right.split_at_mut(self.n);
        rows.fill(0.0);
        parts.chart.extend(v, force);
        parts.blocks.blocks.stiffness.multiply_add(-gh, dq, force);
        let scale = |k| -gh * (z[k] + gh * extra_rate(parts, k, dq, dv));
        add_extra_force(parts, None, scale, force, 1);
        self.solved_rate(&parts.chart, v);
        for (p, v) in p.iter_mut().zip(v) {
            *p += gh * *v;
        }
    }

    /// The same with the complex factor, the extra states included; velocity entries are M̂ r_v.
    pub(super) fn solve_complex(
        &mut self,
        parts: &mut Linearization,
        side: &mut ComplexSide,
        x: &mut [f64],
        y: &mut [f64],
    ) {
        let Self { n, elimination, complex_right: right, spread, rows, rates, .. } = self;
        let (n, ndof, gh) = (*n, rates.len(), side.gamma_h);
        let (zero, unit) = (Complex64::new(0.0, 0.0), Complex64::new(0.0, 1.0));
        let [re, im, product] = spread;
        rows.fill(0.0);
        right.fill(zero);
        for (source, dq, direction) in
            [(&*x, &mut *re, Complex64::new(1.0, 0.0)), (&*y, &mut *im, unit)]
        {
            parts.chart.extend(&source[ndof..2 * ndof], product);
            for (out, force) in right.iter_mut().zip(&*product) {
                *out += direction * force;
            }
            parts.chart.solve(rows, &source[..ndof], dq);
            product.fill(0.0);
            parts.blocks.blocks.stiffness.multiply_add(1.0, dq, product);
            for (out, force) in right.iter_mut().zip(&*product) {
                *out -= direction * gh * force;
            }
        }
        let (structure, blocks) = (parts.system.structure(), &parts.blocks.blocks);
        for k in 0..structure.sizes.extra_states {
            // r_z + γh E⁻¹ g_q D r_p, which the last lines need too.
            for (at, j) in structure.extra_entries(k) {
                side.z[k] += gh * Complex64::new(re[j], im[j]) * side.extra.by_position[at];
            }
            for (at, j) in structure.extra_entries(k) {
                right[j] -= gh * side.z[k] * blocks.force_extra[at];
            }
        }
        elimination.as_mut().expect("factored before").solve_complex(right);
        for k in 0..structure.sizes.extra_states {
            let mut z = side.z[k];
            for (at, j) in structure.extra_entries(k) {
                let by = gh * side.extra.by_position[at] + side.extra.by_velocity[at];
                z += gh * by * right[j];
            }
            (x[2 * ndof + k], y[2 * ndof + k]) = (z.re, z.im);
        }
        for (imaginary, out) in [(false, &mut *x), (true, &mut *y)] {
            for (a, solved) in product.iter_mut().zip(&right[..n]) {
                *a = if imaginary { solved.im } else { solved.re };
            }
            project(&parts.chart, product, &mut out[ndof..2 * ndof]);
        }
        for k in 0..ndof {
            let change = gh * Complex64::new(x[ndof + k], y[ndof + k]);
            x[k] += change.re;
            y[k] += change.im;
        }
    }

    /// δv̈ = −Ψ⁻¹ (M̂₁' δv̇ + M̂₂' δv + Ẑ δz) into `rate`, with Ψ, M̂₁' and M̂₂' of J itself: its residuals are solved for with
    /// this matrix.
    pub(super) fn respond(
        &mut self,
        parts: &mut Linearization,
        mass: &BlockMatrix,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        rate.fill(0.0);
        for _ in 0..PASSES {
            self.residual(parts, mass, p, v, z, rate);
            let mut change = std::mem::take(&mut self.change);
            self.solved_rate(&parts.chart, &mut change);
            rate.iter_mut().zip(&change).for_each(|(out, x)| *out += x);
            self.change = change;
        }
    }

    /// f = −(M δq̈ + C δq̇ + K δq + F_z δz) of δv + βh² ρ, δv̇ + γh ρ and ρ, which (11) to (13) spread over all coordinates.
    fn residual(
        &mut self,
        parts: &mut Linearization,
        mass: &BlockMatrix,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &[f64],
    ) {
        let [dq, dv, da] = &mut self.spread;
        let (rows, rates) = (&mut self.rows, &mut self.rates);
        let linear = parts.chart.parametrization().linear();
        let (blocks, gh, bh2) = (&parts.blocks, parts.gamma_h, parts.beta_h2);
        rows.fill(0.0);
        sum(p, bh2, rate, rates);
        parts.chart.solve(rows, rates, dq);
        blocks.blocks.a0.multiply_add(-1.0, dq, rows);
        sum(v, gh, rate, rates);
        blocks.turning.multiply_many_add(-1.0, dq, 1, &mut rates[linear..]);
        parts.chart.solve(rows, rates, dv);
        rows.fill(0.0);
        blocks.blocks.a1.multiply_add(-1.0, dq, rows);
        blocks.blocks.a0.multiply_add(-2.0, dv, rows);
        rates.copy_from_slice(rate);
        blocks.turning_rate.multiply_many_add(-1.0, dq, 1, &mut rates[linear..]);
        blocks.turning.multiply_many_add(-2.0, dv, 1, &mut rates[linear..]);
        parts.chart.solve(rows, rates, da);
        let (force, rows) = self.right.split_at_mut(self.n);
        force.fill(0.0);
        rows.fill(0.0);
        mass.multiply_add(-1.0, da, force);
        parts.blocks.blocks.damping.multiply_add(-1.0, dv, force);
        parts.blocks.blocks.stiffness.multiply_add(-1.0, dq, force);
        let scale = |k| -(z[k] + gh * extra_rate(parts, k, dq, dv));
        add_extra_force(parts, None, scale, force, 1);
    }
}

/// out = x + α y.
fn sum(x: &[f64], alpha: f64, y: &[f64], out: &mut [f64]) {
    for ((out, x), y) in out.iter_mut().zip(x).zip(y) {
        *out = x + alpha * y;
    }
}

/// E⁻¹ (g_q δq + g_q̇ δq̇) of an extra state.
fn extra_rate(parts: &Linearization, k: usize, dq: &[f64], dv: &[f64]) -> f64 {
    parts.extra.rate(parts.system.structure(), k, dq, dv)
}

/// p = P x.
fn project(chart: &Chart, x: &[f64], p: &mut [f64]) {
    let parametrization = chart.parametrization();
    parametrization.project(x, p);
    let moving = &mut p[parametrization.linear()..];
    moving.fill(0.0);
    chart.moving().multiply_many_add(1.0, x, 1, moving);
}
