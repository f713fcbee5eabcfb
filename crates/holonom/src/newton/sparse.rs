//! The sparse matrix: inflated, or simplified where that may serve, for any number of bodies.

use super::chosen::prefers_simplified;
use super::descriptor::{Unknowns, add_extra_force};
use super::extra::Elimination as ExtraElimination;
use super::forest::{ForestElimination, Right};
use super::general::GeneralElimination;
use super::linearization::Linearization;
use super::matrix::{DescriptorForm, FirstOrderMatrix, Matrix, MatrixOptions};
use super::simplified::Simplified;
use super::sparse_pattern::{Shape, Sum};
use crate::error::EvaluationFailure;
use crate::model::Representation;
use crate::reduction::{Manifold, Point};
use crate::watch::checkpoint;
use holonom_linalg::{BlockMatrix, Complex64, Scalar, SingularMatrix};

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
/// Where the simplified matrix is in use it answers in place of this.
///
/// Equations: `docs/theory/newton.md` (11)-(14).
#[derive(Debug, Clone)]
pub struct SparseMatrix {
    n: usize,
    /// First entry of a right-hand side that belongs to a row of P, in each of the first three groups.
    rank: usize,
    elimination: Elimination,
    /// None where only the matrix itself is good enough, or costs no more.
    simplified: Option<Box<Simplified>>,
    /// Whether that one is made at the next linearization, and whether it was at the last.
    simplify: bool,
    is_simplified: bool,
    /// Other pivots are wanted than those of the forest.
    unfit: bool,
    /// M of the linearization.
    mass: BlockMatrix,
    /// f₁ and f₂ in the rows of P, f₄, and ρ of a solution.
    given: [Vec<f64>; 2],
    force: Vec<f64>,
    rate: Vec<f64>,
    /// A right-hand side and its solution with all entries, where an elimination is general, and δq, δq̇ and δq̈ where
    /// these are unknowns, too.
    wide: Vec<f64>,
    change: Vec<f64>,
    complex: Option<Box<ComplexSide>>,
    rows: Vec<f64>,
    extended: Vec<f64>,
}

/// How the matrix is factored.
#[derive(Debug, Clone)]
enum Elimination {
    /// From the leaves of the forest inwards.
    Forest(ForestElimination),
    /// In an order found from the pattern, which is there from the first linearization on.
    General(Option<Box<GeneralElimination>>),
}

/// What a complex γh has beside the factor.
#[derive(Debug, Clone)]
pub(super) struct ComplexSide {
    pub(super) gamma_h: Complex64,
    pub(super) extra: ExtraElimination<Complex64>,
    pub(super) z: Vec<Complex64>,
    given: Vec<Complex64>,
    force: Vec<Complex64>,
    rate: Vec<Complex64>,
    wide: Vec<Complex64>,
    /// For extra states.
    change: Vec<Complex64>,
}

impl Matrix for SparseMatrix {
    fn new(manifold: &Manifold, _q: &[f64], options: &MatrixOptions) -> Self {
        let structure = manifold.system().structure();
        let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
        let parametrization = manifold.chart().parametrization();
        let simplified = !options.exact
            && match options.representation {
                Representation::Simplified => true,
                Representation::Auto => prefers_simplified(manifold),
                Representation::Dense | Representation::Sparse => false,
            };
        Self {
            n,
            rank: parametrization.kept.len(),
            elimination: match ForestElimination::new(manifold, &options.threads) {
                Some(forest) => Elimination::Forest(forest),
                None => Elimination::General(None),
            },
            simplified: simplified.then(|| Box::new(Simplified::new(manifold))),
            simplify: false,
            is_simplified: false,
            unfit: false,
            mass: structure.mass_pattern.zeros(),
            given: [0, 1].map(|_| vec![0.0; parametrization.ndof]),
            force: vec![0.0; n],
            rate: vec![0.0; parametrization.ndof],
            wide: Vec::new(),
            change: Vec::new(),
            complex: None,
            rows: vec![0.0; m],
            extended: vec![0.0; n],
        }
    }

    fn is_reduced(&self) -> bool {
        false
    }

    fn simplify(&mut self, simplify: bool) {
        self.simplify = simplify && self.simplified.is_some();
    }

    fn is_simplified(&self) -> bool {
        self.is_simplified
    }

    fn linearize(&mut self, parts: &mut Linearization, point: &mut Point) {
        let (manifold, state) = (&point.manifold, &point.state);
        let (blocks, chart) = (&mut parts.blocks, &mut parts.chart);
        let threads = blocks.blocks.threads().clone();
        checkpoint(8 * self.n);
        self.is_simplified = self.simplify;
        let (unfit, ()) = threads.share(|| {
            let Self { mass, elimination, is_simplified, .. } = self;
            let copies = || {
                mass.values_mut().copy_from_slice(manifold.mass().values());
                chart.copy_from(manifold.chart());
            };
            let linearize = || {
                let Elimination::Forest(forest) = elimination else { return false };
                if *is_simplified {
                    return false;
                }
                blocks.evaluate_system(manifold, state);
                let rows = [manifold.jacobian().values(), manifold.chart().moving().values()];
                forest.linearize(rows, blocks).is_err()
            };
            threads.join(linearize, copies)
        });
        if let (Elimination::Forest(_), false) = (&self.elimination, self.is_simplified) {
            self.unfit |= unfit;
            if self.unfit {
                self.elimination = Elimination::General(None);
            }
        }
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            simplified.linearize(manifold, state, blocks);
        } else if let Elimination::General(elimination) = &mut self.elimination {
            if let Some(elimination) = elimination {
                blocks.evaluate_system(manifold, state);
                elimination.linearize(manifold, state, blocks);
            } else {
                let new = GeneralElimination::new(Shape::Inflated, manifold, state, blocks);
                *elimination = Some(Box::new(new));
                self.wide.resize(4 * self.n, 0.0);
            }
        }
        parts.blocks.take_extra_squares();
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
            extra: &parts.extra,
        };
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.factor(&sum);
        }
        match &mut self.elimination {
            Elimination::Forest(forest) => {
                let outcome = forest.factor(&sum);
                self.unfit |= outcome.is_err();
                outcome.map(|()| 0)
            }
            Elimination::General(elimination) => {
                elimination.as_mut().expect("linearized before it is factored").factor(&sum)
            }
        }
    }

    /// Right-hand sides f₁ = [0; δv/βh²], f₂ = [0; δv̇/γh], f₄ = −F_z δz.
    fn respond(
        &mut self,
        parts: &mut Linearization,
        p: &[f64],
        v: &[f64],
        z: &[f64],
        rate: &mut [f64],
    ) {
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.respond(parts, &self.mass, p, v, z, rate);
        }
        for (given, (x, scale)) in
            self.given.iter_mut().zip([(p, parts.beta_h2), (v, parts.gamma_h)])
        {
            given.iter_mut().zip(x).for_each(|(out, x)| *out = x / scale);
        }
        self.force.fill(0.0);
        add_extra_force(parts, None, |k| -z[k], &mut self.force, 1);
        self.solve_right([true; 2]);
        rate.copy_from_slice(&self.rate);
    }

    /// M̂ v = Dᵀ M D v.
    fn weigh(&mut self, parts: &mut Linearization, v: &mut [f64]) {
        let forest = match &self.elimination {
            Elimination::Forest(forest) if !self.is_simplified => Some(forest),
            _ => None,
        };
        self.rows.fill(0.0);
        match forest {
            Some(forest) => forest.spread(v, &mut self.extended),
            None => parts.chart.solve(&self.rows, v, &mut self.extended),
        }
        self.force.fill(0.0);
        self.mass.multiply_add(1.0, &self.extended, &mut self.force);
        match forest {
            Some(forest) => forest.gather(&mut self.force, v),
            None => parts.chart.solve_transposed(&self.force, &mut self.rows, v),
        }
    }
}

impl FirstOrderMatrix for SparseMatrix {
    /// f₄ = −Pᵀψ − F_z δz.
    fn correct(&mut self, parts: &Linearization, z: &[f64], rate: &mut [f64]) {
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.correct(parts, z, rate);
        }
        parts.chart.extend(rate, &mut self.force);
        self.force.iter_mut().for_each(|x| *x = -*x);
        let scale = |k| -z.get(k).copied().unwrap_or(0.0);
        add_extra_force(parts, None, scale, &mut self.force, 1);
        self.solve_right([false; 2]);
        rate.copy_from_slice(&self.rate);
    }

    /// ρ stands for δv̇ itself: f₁ = [0; r_p/γh], f₄ = Pᵀ(M̂ r_v) − γh F_z r_z with E⁻¹ r_z for r_z.
    fn solve(&mut self, parts: &mut Linearization, p: &mut [f64], v: &mut [f64], z: &[f64]) {
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.solve(parts, p, v, z);
        }
        let gh = parts.gamma_h;
        parts.chart.extend(v, &mut self.force);
        self.given[0].iter_mut().zip(&*p).for_each(|(out, p)| *out = p / gh);
        add_extra_force(parts, None, |k| -gh * z[k], &mut self.force, 1);
        self.solve_right([true, false]);
        v.copy_from_slice(&self.rate);
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
        let side = self.complex.get_or_insert_with(|| {
            Box::new(ComplexSide {
                gamma_h,
                extra: ExtraElimination::new(parts.system.structure()),
                z: vec![zero; parts.blocks.extra_extra.states()],
                given: Vec::new(),
                force: Vec::new(),
                rate: Vec::new(),
                wide: Vec::new(),
                change: Vec::new(),
            })
        });
        side.gamma_h = gamma_h;
        let blocks = &parts.blocks.blocks;
        let rates = [&blocks.extra_position, &blocks.extra_velocity].map(|rows| &rows[..]);
        side.extra.factor(gamma_h, &parts.blocks.extra_extra, rates);
        let sum = Sum {
            mass: &self.mass,
            blocks: &parts.blocks,
            gamma_h,
            beta_h2: gamma_h * gamma_h,
            ratio: gamma_h,
            extra: &side.extra,
        };
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.factor_complex(&sum);
        }
        side.force.resize(self.n, zero);
        side.given.resize(self.rate.len(), zero);
        side.rate.resize(self.rate.len(), zero);
        match &mut self.elimination {
            Elimination::Forest(forest) => {
                let change = if side.z.is_empty() { 0 } else { 3 * self.n };
                side.change.resize(change, zero);
                let outcome = forest.factor_complex(&sum);
                self.unfit |= outcome.is_err();
                outcome
            }
            Elimination::General(elimination) => {
                side.wide.resize(4 * self.n, zero);
                elimination.as_mut().expect("linearized before").factor_complex(&sum)
            }
        }
    }

    fn solve_complex(&mut self, parts: &mut Linearization, x: &mut [f64], y: &mut [f64]) {
        let (n, ndof) = (self.n, self.rate.len());
        let side = self.complex.as_mut().expect("factored before");
        let at = |x: &[f64], y: &[f64], i: usize| Complex64::new(x[i], y[i]);
        side.z.iter_mut().enumerate().for_each(|(k, z)| *z = at(x, y, 2 * ndof + k));
        side.extra.solve(&mut side.z);
        if let Some(simplified) = self.simplified.as_mut().filter(|_| self.is_simplified) {
            return simplified.solve_complex(parts, side, x, y);
        }
        let ComplexSide { gamma_h: gh, extra, z, given, force, rate, wide, change } = &mut **side;
        let gh = *gh;
        for (k, given) in given.iter_mut().enumerate() {
            *given = at(x, y, k) / gh;
        }
        for (source, imaginary) in [(&*x, false), (&*y, true)] {
            parts.chart.extend(&source[ndof..2 * ndof], &mut self.extended);
            for (out, value) in force.iter_mut().zip(&self.extended) {
                if imaginary {
                    out.im = *value;
                } else {
                    out.re = *value;
                }
            }
        }
        let structure = parts.system.structure();
        for (k, z) in z.iter().enumerate() {
            let scale = gh * z;
            for (at, j) in structure.extra_entries(k) {
                force[j] -= scale * parts.blocks.blocks.force_extra[at];
            }
        }
        match &mut self.elimination {
            Elimination::Forest(forest) => {
                let change = (!z.is_empty()).then_some(&mut **change);
                forest.solve_complex(Right { given: [Some(given), None], force, rate, change });
            }
            Elimination::General(elimination) => {
                widen(self.rank, [Some(given), None], force, wide);
                elimination.as_mut().expect("factored before").solve_complex(wide);
                rate.copy_from_slice(&wide[3 * n + self.rank..]);
            }
        }
        if !z.is_empty() {
            // δq = γh x and δq̇ = y here, and x = δq/βh², y = δq̇/γh where w is δv̈.
            let (change, scales) = match self.elimination {
                Elimination::Forest(_) => (change, [gh.inv(); 2]),
                Elimination::General(_) => (wide, [gh, Complex64::new(1.0, 0.0)]),
            };
            let (dq, dv) = change.split_at_mut(n);
            dq.iter_mut().for_each(|x| *x *= scales[0]);
            let dv = &mut dv[..n];
            dv.iter_mut().for_each(|x| *x *= scales[1]);
            for (k, z) in z.iter().enumerate() {
                let z = z + gh * extra.rate(structure, k, dq, dv);
                (x[2 * ndof + k], y[2 * ndof + k]) = (z.re, z.im);
            }
        }
        for (k, v) in rate.iter().enumerate() {
            let p = at(x, y, k) + gh * v;
            (x[k], y[k]) = (p.re, p.im);
            (x[ndof + k], y[ndof + k]) = (v.re, v.im);
        }
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
    fn correct_unknowns(&mut self, parts: &mut Linearization, z: &[f64], x: &mut Unknowns) {
        for (out, x) in self.force.iter_mut().zip(&x.force) {
            *out = -x;
        }
        add_extra_force(parts, None, |k| -z[k], &mut self.force, 1);
        if let Elimination::Forest(_) = self.elimination {
            return self.correct_tree(parts, x);
        }
        let (n, kept) = (self.n, &parts.chart.parametrization().kept);
        widen(self.rank, [None; 2], &self.force, &mut self.wide);
        let rows = &mut self.wide[2 * n..3 * n];
        for (out, &row) in rows.iter_mut().zip(&**kept) {
            *out = -x.rows[row];
        }
        for (out, x) in rows[self.rank..].iter_mut().zip(&x.rate) {
            *out = -x;
        }
        self.solve_general();
        x.force.copy_from_slice(&self.wide[2 * n..3 * n]);
        x.rows.fill(0.0);
        for (solved, &row) in self.wide[3 * n..].iter().zip(&**kept) {
            x.rows[row] = *solved;
        }
        x.rate.copy_from_slice(&self.rate);
    }
}

impl SparseMatrix {
    /// ρ of f₁ and f₂, as far as there are such entries, and f₄.
    fn solve_right(&mut self, is_given: [bool; 2]) {
        let Self { given, force, rate, .. } = self;
        let given = [0, 1].map(|level| is_given[level].then_some(&*given[level]));
        if let Elimination::Forest(forest) = &mut self.elimination {
            return forest.solve(Right { given, force, rate, change: None });
        }
        widen(self.rank, given, force, &mut self.wide);
        self.solve_general();
    }

    fn solve_general(&mut self) {
        let Elimination::General(elimination) = &mut self.elimination else { return };
        elimination.as_mut().expect("factored before").solve(&mut self.wide);
        self.rate.copy_from_slice(&self.wide[3 * self.n + self.rank..]);
    }

    /// f₃ is fulfilled by accelerations alone, and what the solution leaves of f₄ is Gᵀδλ: a tree keeps neither inverses
    /// nor H for these.
    fn correct_tree(&mut self, parts: &mut Linearization, x: &mut Unknowns) {
        let Elimination::Forest(forest) = &mut self.elimination else { return };
        let (n, gh) = (self.n, parts.gamma_h);
        x.rows.iter_mut().chain(&mut x.rate).for_each(|x| *x = -*x);
        parts.chart.solve(&x.rows, &x.rate, &mut x.force);
        self.mass.multiply_add(-1.0, &x.force, &mut self.force);
        self.extended.copy_from_slice(&self.force);
        self.change.resize(3 * n, 0.0);
        forest.solve(Right {
            given: [None; 2],
            force: &mut self.force,
            rate: &mut self.rate,
            change: Some(&mut self.change),
        });
        let (dq, rest) = self.change.split_at(n);
        let (dv, da) = rest.split_at(n);
        let left = &mut self.extended;
        let blocks = &parts.blocks.blocks;
        self.mass.multiply_add(-1.0, da, left);
        blocks.damping.multiply_add(-1.0, dv, left);
        blocks.stiffness.multiply_add(-1.0, dq, left);
        let structure = parts.system.structure();
        let by_change = |k: usize| -gh * parts.extra.rate(structure, k, dq, dv);
        add_extra_force(parts, None, by_change, left, 1);
        parts.chart.solve_transposed(left, &mut x.rows, &mut x.rate);
        x.force.iter_mut().zip(da).for_each(|(out, a)| *out += a);
        x.rate.copy_from_slice(&self.rate);
    }
}

/// A right-hand side with all its entries.
fn widen<T: Scalar>(rank: usize, given: [Option<&[T]>; 2], force: &[T], wide: &mut [T]) {
    let n = force.len();
    wide[..3 * n].fill(T::ZERO);
    for (level, given) in given.into_iter().enumerate() {
        let Some(given) = given else { continue };
        wide[level * n + rank..][..given.len()].copy_from_slice(given);
    }
    wide[3 * n..].copy_from_slice(force);
}
