//! The inflated matrix: sparse with the graph of the mechanism, for any number of bodies.

use super::blocks::ReducedBlocks;
use super::descriptor::{Unknowns, add_extra_force};
use super::forest::ForestElimination;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions};
use super::sparse_pattern::{InflatedPattern, Nonzeros, Sum};
use crate::error::EvaluationFailure;
use crate::reduction::{BodyRows, Manifold, Point, disturb};
use crate::system::State;
use crate::watch::checkpoint;
use holonom_linalg::{BlockMatrix, Complex64, SingularMatrix, SparseLu};

/// Newton's matrix with D never formed. Unknowns x = δq/βh², y = δq̇/γh, a = δq̈, δλ and ρ = δv̈:
///
/// ```text
/// G̃ x                              − [0; ρ] = f₁
/// G̃ y + (βh²/γh) Ã₀ x              − [0; ρ] = f₂
/// G̃ a + βh² Ã₁ x + 2γh Ã₀ y        − [0; ρ] = f₃
/// M a + γh C y + βh² K x + Gᵀ δλ            = f₄
/// ```
///
/// with G̃ = [G; P] and Ã₀, Ã₁ its curvature, the rows of P included. Eliminating all but ρ gives
/// (M̂ + γh M̂₁ + βh² M̂₂) ρ = Dᵀf₄ + …: the iterates are those of the dense matrix. Extra states are
/// eliminated beforehand: they add γh βh² F_z E⁻¹ g_q to βh² K and γ²h² F_z E⁻¹ g_q̇ to γh C.
///
/// Equations: `docs/theory/newton.md` (11)-(14).
#[derive(Debug, Clone)]
pub struct SparseMatrix {
    n: usize,
    /// First entry of a right-hand side that belongs to a row of P, in each of the first three groups.
    rank: usize,
    elimination: Elimination,
    /// Other pivots are wanted than those of the forest.
    unfit: bool,
    /// M of the linearization.
    mass: BlockMatrix,
    right: Vec<f64>,
    complex: Option<Box<ComplexFactor>>,
    force: Vec<f64>,
    rows: Vec<f64>,
    rate: Vec<f64>,
    extended: Vec<f64>,
}

/// How the matrix is factored.
#[derive(Debug, Clone)]
enum Elimination {
    /// From the leaves of the forest inwards.
    Forest(ForestElimination),
    /// In an order found from the pattern, which is there from the first linearization on.
    General(Option<Box<Plan>>),
}

/// What is found at the first linearization, and again when another entry appears.
#[derive(Debug, Clone)]
struct Plan {
    nonzeros: Nonzeros,
    pattern: InflatedPattern,
    /// G and the moving rows of P of the linearization.
    jacobian: Vec<f64>,
    moving: BodyRows,
    values: Vec<f64>,
    lu: Option<SparseLu>,
    /// Relative error that the last refinement left, and the one with fresh pivots; NaN until there is one.
    left: f64,
    fresh: f64,
}

/// The factor for a complex γh.
#[derive(Debug, Clone)]
struct ComplexFactor {
    gamma_h: Complex64,
    /// None where the forest is eliminated.
    lu: Option<SparseLu<Complex64>>,
    values: Vec<Complex64>,
    right: Vec<Complex64>,
    inverse_e: Vec<Complex64>,
}

/// Growth of numbers in the elimination from which solutions are refined.
const HARMLESS_GROWTH: f64 = 1e4;
/// What refinement may leave of the relative error before pivots are chosen anew, where fresh ones left not
/// much less.
const ACCURACY: f64 = 1e-9;
const WORSE_THAN_FRESH: f64 = 100.0;

impl Matrix for SparseMatrix {
    fn new(manifold: &Manifold, _q: &[f64], options: &MatrixOptions) -> Self {
        let structure = manifold.system().structure();
        let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
        let parametrization = manifold.chart().parametrization();
        Self {
            n,
            rank: parametrization.kept.len(),
            elimination: match ForestElimination::new(manifold, &options.threads) {
                Some(forest) => Elimination::Forest(forest),
                None => Elimination::General(None),
            },
            unfit: false,
            mass: structure.mass_pattern.zeros(),
            right: vec![0.0; 4 * n],
            complex: None,
            force: vec![0.0; n],
            rows: vec![0.0; m],
            rate: vec![0.0; parametrization.ndof],
            extended: vec![0.0; n],
        }
    }

    fn is_reduced(&self) -> bool {
        false
    }

    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point) {
        let (manifold, state) = (&point.manifold, &point.state);
        let (blocks, chart) = (&mut parts.blocks, &mut parts.chart);
        let threads = blocks.blocks.threads().clone();
        checkpoint(8 * self.n);
        let (unfit, ()) = threads.share(|| {
            let Self { mass, elimination, .. } = self;
            let copies = || {
                mass.values_mut().copy_from_slice(manifold.mass().values());
                chart.copy_from(manifold.chart());
            };
            let linearize = || {
                let Elimination::Forest(forest) = elimination else { return false };
                blocks.evaluate_system(manifold, state);
                let rows = [manifold.jacobian().values(), manifold.chart().moving().values()];
                forest.linearize(rows, blocks).is_err()
            };
            threads.join(linearize, copies)
        });
        if let Elimination::Forest(_) = &mut self.elimination {
            self.unfit |= unfit;
            if self.unfit {
                (self.elimination, self.complex) = (Elimination::General(None), None);
            }
        }
        if let Elimination::General(plan) = &mut self.elimination {
            if plan.is_none() {
                *plan = Some(Box::new(Plan::new(manifold, state, blocks)));
            } else {
                blocks.evaluate_system(manifold, state);
            }
            let plan = plan.as_mut().expect("made above");
            if plan.nonzeros.observe(blocks) {
                plan.pattern = InflatedPattern::new(manifold, &state.q, &plan.nonzeros);
                (plan.lu, self.complex) = (None, None);
            }
            plan.jacobian.copy_from_slice(manifold.jacobian().values());
            plan.moving.copy_from(manifold.chart().moving());
            plan.values.resize(plan.pattern.pattern.len(), 0.0);
        }
        parts.blocks.extra_extra.copy_from_slice(&parts.blocks.blocks.extra_extra);
    }

    /// Differences are taken of dense blocks only.
    fn take_blocks(&mut self, _parts: &Linearization, _manifold: &Manifold) {}

    fn factor(&mut self, parts: &Linearization) -> Result<u64, SingularMatrix> {
        let sum = Sum {
            mass: &self.mass,
            blocks: &parts.blocks,
            gamma_h: parts.gamma_h,
            beta_h2: parts.beta_h2,
            ratio: parts.beta_h2 / parts.gamma_h,
            inverse_e: &parts.inverse_e,
        };
        let plan = match &mut self.elimination {
            Elimination::Forest(forest) => {
                let outcome = forest.factor(parts.system.structure(), &sum);
                self.unfit |= outcome.is_err();
                return outcome.map(|()| 0);
            }
            Elimination::General(plan) => plan.as_mut().expect("linearized before it is factored"),
        };
        let Plan { pattern, jacobian, moving, values, .. } = &mut **plan;
        pattern.fill(&sum, jacobian, moving, values);
        if let Some(lu) = &mut plan.lu
            && plan.left <= ACCURACY.max(WORSE_THAN_FRESH * plan.fresh)
            && lu.refactor(&plan.values).is_ok()
        {
            return Ok(0);
        }
        (plan.lu, plan.left, plan.fresh, self.complex) = (None, 0.0, f64::NAN, None);
        plan.lu = Some(SparseLu::analyze_for_many(&plan.pattern.pattern, &plan.values)?);
        Ok(1)
    }

    /// Right-hand sides f₁ = [0; δv/βh²], f₂ = [0; δv̇/γh], f₄ = −F_z δz.
    fn respond(
        &mut self,
        parts: &Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        self.right.fill(0.0);
        for (level, (x, scale)) in [(p, parts.beta_h2), (v, parts.gamma_h)].into_iter().enumerate()
        {
            let first = level * self.n + self.rank;
            for (out, x) in self.right[first..first + x.len()].iter_mut().zip(x) {
                *out = x / scale;
            }
        }
        add_extra_force(parts, None, |k| -z[k], &mut self.right[3 * self.n..], 1);
        self.solve_right(parts, false);
        rate.copy_from_slice(self.solved_rate());
    }
}

impl FirstOrderMatrix for SparseMatrix {
    /// f₄ = −Pᵀψ − F_z δz.
    fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]) {
        parts.chart.extend(rate, &mut self.extended);
        self.right.fill(0.0);
        let force = &mut self.right[3 * self.n..];
        for (out, x) in force.iter_mut().zip(&self.extended) {
            *out = -x;
        }
        add_extra_force(parts, None, |k| -z.get(k).copied().unwrap_or(0.0), force, 1);
        self.solve_right(parts, false);
        rate.copy_from_slice(self.solved_rate());
    }

    /// ρ stands for δv̇ itself: f₁ = [0; r_p/γh], f₄ = Pᵀ(M̂ r_v) − γh F_z E⁻¹ r_z.
    fn solve(&mut self, parts: &Linearization, p: &mut [f64], v: &mut [f64], z: &[f64]) {
        let gh = parts.gamma_h;
        parts.chart.extend(v, &mut self.extended);
        self.right.fill(0.0);
        for (out, p) in self.right[self.rank..].iter_mut().zip(&*p) {
            *out = p / gh;
        }
        let force = &mut self.right[3 * self.n..];
        force.copy_from_slice(&self.extended);
        add_extra_force(parts, None, |k| -gh * parts.inverse_e[k] * z[k], force, 1);
        self.solve_right(parts, false);
        v.copy_from_slice(self.solved_rate());
        for (p, v) in p.iter_mut().zip(v) {
            *p += gh * *v;
        }
    }

    fn factor_complex(
        &mut self,
        parts: &Linearization,
        gamma_h: Complex64,
    ) -> Result<(), SingularMatrix> {
        let zero = Complex64::new(0.0, 0.0);
        let solver = self.complex.get_or_insert_with(|| {
            let (lu, values) = match &self.elimination {
                Elimination::Forest(_) => (None, Vec::new()),
                Elimination::General(plan) => {
                    let plan = plan.as_ref().expect("the real factor comes first");
                    let real = plan.lu.as_ref().expect("the real factor comes first");
                    (Some(real.complex()), vec![zero; plan.values.len()])
                }
            };
            Box::new(ComplexFactor {
                gamma_h,
                values,
                lu,
                right: vec![zero; 4 * self.n],
                inverse_e: vec![zero; parts.inverse_e.len()],
            })
        });
        solver.gamma_h = gamma_h;
        for (out, by_z) in solver.inverse_e.iter_mut().zip(&parts.blocks.extra_extra) {
            *out = (1.0 - gamma_h * by_z).inv();
        }
        let sum = Sum {
            mass: &self.mass,
            blocks: &parts.blocks,
            gamma_h,
            beta_h2: gamma_h * gamma_h,
            ratio: gamma_h,
            inverse_e: &solver.inverse_e,
        };
        match (&mut self.elimination, &mut solver.lu) {
            (Elimination::General(Some(plan)), Some(lu)) => {
                plan.pattern.fill(&sum, &plan.jacobian, &plan.moving, &mut solver.values);
                let outcome = lu.refactor(&solver.values);
                if outcome.is_err() {
                    // Pivots of the real matrix that do not serve here: the next real factor chooses others.
                    plan.left = f64::INFINITY;
                }
                outcome
            }
            (Elimination::Forest(forest), _) => {
                let outcome = forest.factor_complex(parts.system.structure(), &sum);
                self.unfit |= outcome.is_err();
                outcome
            }
            _ => unreachable!("linearized and factored for real coefficients before"),
        }
    }

    fn solve_complex(&mut self, parts: &Linearization, x: &mut [f64], y: &mut [f64]) {
        let (n, ndof) = (self.n, self.rate.len());
        let solver = self.complex.as_mut().expect("factored before");
        let gh = solver.gamma_h;
        let at = |x: &[f64], y: &[f64], i: usize| Complex64::new(x[i], y[i]);
        let right = &mut solver.right;
        right.fill(Complex64::new(0.0, 0.0));
        for k in 0..ndof {
            right[self.rank + k] = at(x, y, k) / gh;
        }
        for (source, imaginary) in [(&*x, false), (&*y, true)] {
            parts.chart.extend(&source[ndof..2 * ndof], &mut self.extended);
            for (out, value) in right[3 * n..].iter_mut().zip(&self.extended) {
                if imaginary {
                    out.im = *value;
                } else {
                    out.re = *value;
                }
            }
        }
        let structure = parts.system.structure();
        let (blocks, per_body) = (&parts.blocks.blocks, structure.sizes.per_body);
        for (k, ends) in structure.extra_bodies.iter().enumerate() {
            let scale = gh * solver.inverse_e[k] * at(x, y, 2 * ndof + k);
            for (side, body) in ends.iter().enumerate() {
                let Some(b) = body else { continue };
                for i in 0..per_body {
                    let force = blocks.force_extra[(2 * k + side) * per_body + i];
                    right[3 * n + b * per_body + i] -= scale * force;
                }
            }
        }
        match (&mut self.elimination, &mut solver.lu) {
            (Elimination::Forest(forest), _) => forest.solve_complex(right, &parts.blocks),
            (_, Some(lu)) if lu.growth() <= HARMLESS_GROWTH => lu.solve(right),
            (Elimination::General(Some(plan)), Some(lu)) => {
                let left = lu.solve_refined(&plan.pattern.pattern, &solver.values, right);
                plan.left = plan.left.max(left);
            }
            _ => unreachable!("factored before"),
        }
        let (dq, dv) = right.split_at_mut(n);
        if !solver.inverse_e.is_empty() {
            // δq = γh x and δq̇ = y here.
            dq.iter_mut().for_each(|x| *x *= gh);
        }
        for (k, ends) in structure.extra_bodies.iter().enumerate() {
            let j = 2 * ndof + k;
            let by = blocks.extra_rate(k, ends, per_body, dq, &dv[..n]);
            let z = solver.inverse_e[k] * (at(x, y, j) + gh * by);
            (x[j], y[j]) = (z.re, z.im);
        }
        for k in 0..ndof {
            let v = right[3 * n + self.rank + k];
            let p = at(x, y, k) + gh * v;
            (x[k], y[k]) = (p.re, p.im);
            (x[ndof + k], y[ndof + k]) = (v.re, v.im);
        }
    }

    /// M̂ v = Dᵀ M D v.
    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        self.rows.fill(0.0);
        parts.chart.solve(&self.rows, v, &mut self.extended);
        self.force.fill(0.0);
        self.mass.multiply_add(1.0, &self.extended, &mut self.force);
        parts.chart.solve_transposed(&self.force, &mut self.rows, v);
    }

    fn time_derivative(
        &mut self,
        parts: &mut Linearization,
        point: &mut Point,
        v_rate: &mut [f64],
        z_rate: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        parts.blocks.time_derivative(&mut point.manifold, &point.state, v_rate, z_rate);
        parts.chart.extend(v_rate, &mut self.extended);
        point.manifold.respond(&point.state.q, &self.extended, v_rate)
    }
}

impl DescriptorForm for SparseMatrix {
    /// f₃ and f₄ are the residuals.
    fn correct_unknowns(&mut self, parts: &Linearization, z: &[f64], x: &mut Unknowns) {
        let (n, parametrization) = (self.n, parts.chart.parametrization());
        self.right.fill(0.0);
        let (rows, force) = self.right[2 * n..].split_at_mut(n);
        for (out, x) in force.iter_mut().zip(&x.force) {
            *out = -x;
        }
        add_extra_force(parts, None, |k| -z[k], force, 1);
        for (out, &row) in rows.iter_mut().zip(&*parametrization.kept) {
            *out = -x.rows[row];
        }
        for (out, x) in rows[self.rank..].iter_mut().zip(&x.rate) {
            *out = -x;
        }
        self.solve_right(parts, true);
        x.force.copy_from_slice(&self.right[2 * n..3 * n]);
        x.rows.fill(0.0);
        for (solved, &row) in self.right[3 * n..].iter().zip(&*parametrization.kept) {
            x.rows[row] = *solved;
        }
        x.rate.copy_from_slice(self.solved_rate());
    }
}

impl SparseMatrix {
    /// ρ of the last solution.
    fn solved_rate(&self) -> &[f64] {
        &self.right[3 * self.n + self.rank..]
    }

    fn solve_right(&mut self, parts: &Linearization, multipliers: bool) {
        let plan = match &mut self.elimination {
            Elimination::Forest(forest) => {
                return forest.solve(&mut self.right, &parts.blocks, multipliers);
            }
            Elimination::General(plan) => {
                plan.as_mut().expect("linearized before it is solved with")
            }
        };
        let lu = plan.lu.as_mut().expect("factored before it is solved with");
        if lu.growth() <= HARMLESS_GROWTH {
            lu.solve(&mut self.right);
        } else {
            plan.left = lu.solve_refined(&plan.pattern.pattern, &plan.values, &mut self.right);
            if plan.fresh.is_nan() {
                plan.fresh = plan.left;
            }
        }
    }
}

impl Plan {
    /// At a complete state, where the blocks are evaluated.
    fn new(manifold: &Manifold, state: &State, blocks: &mut ReducedBlocks) -> Self {
        // What vanishes by chance at this state does not at a generic one.
        let mut nonzeros = Nonzeros::new(blocks);
        let mut generic = state.clone();
        for (round, x) in [&mut generic.q, &mut generic.v, &mut generic.a, &mut generic.lambda]
            .into_iter()
            .enumerate()
        {
            let here = x.clone();
            disturb(&here, round as u32 + 1, x);
        }
        blocks.evaluate_system(manifold, &generic);
        nonzeros.observe(blocks);
        blocks.evaluate_system(manifold, state);
        nonzeros.observe(blocks);
        let pattern = InflatedPattern::new(manifold, &state.q, &nonzeros);
        Self {
            nonzeros,
            pattern,
            jacobian: manifold.jacobian().values().to_vec(),
            moving: manifold.chart().moving().clone(),
            values: Vec::new(),
            lu: None,
            left: 0.0,
            fresh: f64::NAN,
        }
    }
}
