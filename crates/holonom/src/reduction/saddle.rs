//! Accelerations and multipliers from the index-1 system [M Gᵀ; G 0] (q̈, λ) = (Q, τ).

use crate::error::EvaluationFailure;
use crate::system::{Measure, System};
use holonom_linalg::{Assembly, BlockMatrix, BlockPattern, FrozenLu, SparsePattern, Terms};
use std::sync::Arc;

/// The sparse saddle-point matrix with a fixed pattern and frozen pivots. Most accelerations come from elsewhere: the
/// pattern is placed at the first solve.
#[derive(Debug, Clone)]
pub struct Saddle {
    nonzero_g: Arc<[bool]>,
    nonzero_m: Arc<[bool]>,
    kept: Arc<[usize]>,
    pattern: SparsePattern,
    values: Vec<f64>,
    mass: BlockMatrix,
    /// Of values of M or G, with their scale.
    assembly: Assembly<(Source, f64)>,
    /// Congruence scaling: coordinates by the characteristic length, rows by their kind and mass.
    scale: Arc<[f64]>,
    lu: FrozenLu,
    work: Vec<f64>,
    coordinates: usize,
    analyses: u64,
}

/// Matrices whose values stand in it.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Source {
    Mass,
    Jacobian,
}

/// Solutions are always refined, and frozen pivots serve while that comes this far.
const ALWAYS: f64 = 0.0;
const ACCURACY: f64 = 1e-13;

/// Operations of the elimination per stored entry, about, for matrices of mechanisms.
const ELIMINATION: f64 = 6.0;

impl Saddle {
    /// For these rows of G and entries that can differ from zero; placed and analysed at the first solve.
    pub fn new(
        system: &dyn System,
        q: &[f64],
        kept: &[usize],
        nonzero_g: &Arc<[bool]>,
        nonzero_m: &Arc<[bool]>,
    ) -> Self {
        let structure = system.structure();
        let length = system.characteristic_length();
        let n = structure.sizes.coordinates;
        let mut mass = structure.mass_pattern.zeros();
        system.mass_matrix(q, &mut mass);
        let mut scale: Vec<f64> = (0..n)
            .map(|i| match structure.coordinate_measure(i) {
                Measure::Length => length,
                Measure::Angle => 1.0,
            })
            .collect();
        // A multiplier scale that gives the scaled G the size of the scaled M, so that pivots may
        // come from either.
        let mut mean = 0.0;
        for ((i, j), x) in mass.entries(0, 0).into_iter().zip(mass.values()) {
            if i == j {
                mean += x.abs() * scale[i] * scale[i] / n as f64;
            }
        }
        let mean = if mean > 0.0 { mean } else { 1.0 };
        for row in &structure.row_measure {
            scale.push(mean / if *row == Measure::Length { length } else { 1.0 });
        }
        Self {
            nonzero_g: nonzero_g.clone(),
            nonzero_m: nonzero_m.clone(),
            kept: kept.into(),
            pattern: SparsePattern::new(0, 0, &[]).0,
            values: Vec::new(),
            mass,
            assembly: Assembly::none(),
            scale: scale.into(),
            lu: FrozenLu::new(ALWAYS, ACCURACY),
            work: Vec::new(),
            coordinates: n,
            analyses: 0,
        }
    }

    /// A copy with this matrix's pattern, scales and pivots for other numbers of the same structure.
    pub fn with_values(&self) -> Self {
        Self { analyses: 0, ..self.clone() }
    }

    /// Symbolic analyses made for this matrix.
    pub fn analyses(&self) -> u64 {
        self.analyses
    }

    /// Rows of G in use.
    pub fn rows(&self) -> &[usize] {
        &self.kept
    }

    /// Uses other rows of G from now on; the pattern is placed anew at the next solve.
    pub fn set_rows(&mut self, kept: &[usize]) {
        self.kept = kept.into();
        self.lu.forget();
        self.pattern = SparsePattern::new(0, 0, &[]).0;
    }

    fn place(&mut self, g: &BlockMatrix) {
        let n = self.coordinates;
        let mut position = vec![usize::MAX; g.n_rows()];
        for (k, &row) in self.kept.iter().enumerate() {
            position[row] = n + k;
        }
        let mut terms = Terms::default();
        for (at, (i, j)) in self.mass.entries(0, 0).into_iter().enumerate() {
            if self.nonzero_m[at] {
                let scale = self.scale[i] * self.scale[j];
                terms.add((Source::Mass, scale), [(at, (i, j))]);
            }
        }
        for (at, (row, j)) in g.entries(0, 0).into_iter().enumerate() {
            let k = position[row];
            if self.nonzero_g[at] && k != usize::MAX {
                let scale = self.scale[n + row] * self.scale[j];
                terms.add((Source::Jacobian, scale), [(at, (k, j)), (at, (j, k))]);
            }
        }
        let size = self.order();
        let (pattern, slots) = SparsePattern::new(size, size, terms.places());
        self.assembly = terms.in_slots(&slots);
        self.values = vec![0.0; pattern.len()];
        self.pattern = pattern;
        self.work = vec![0.0; size];
        self.lu.forget();
    }

    /// M where it was last evaluated.
    pub fn mass(&self) -> &BlockMatrix {
        &self.mass
    }

    /// Evaluates M at q without factoring anything.
    pub fn evaluate_mass(&mut self, system: &dyn System, q: &[f64]) -> &BlockMatrix {
        self.mass.restore();
        system.mass_matrix(q, &mut self.mass);
        &self.mass
    }

    /// Gives up the room of M until it is evaluated.
    pub fn release_mass(&mut self) {
        self.mass.release();
    }

    /// Takes M as evaluated elsewhere.
    pub fn set_mass(&mut self, mass: &BlockMatrix) {
        self.mass.values_mut().copy_from_slice(mass.values());
    }

    /// Pivots are chosen anew at the next solve.
    pub fn forget_pivots(&mut self) {
        self.lu.forget();
    }

    /// Predicted operations of one solve with M and G of these patterns, in multiplications.
    pub(super) fn cost(mass: &BlockPattern, g: &BlockPattern) -> f64 {
        ELIMINATION * (mass.len() + 2 * g.len()) as f64
    }

    /// Order of the matrix.
    pub fn order(&self) -> usize {
        self.coordinates + self.kept.len()
    }

    /// Multiplications of a factorisation, a solve and one refinement with the pivots last chosen, about:
    /// half of the additions and multiplications.
    pub fn multiplications(&self) -> Option<usize> {
        self.lu.factors().map(|lu| lu.operations() / 2 + 2 * lu.fill() + self.pattern.len())
    }

    /// Solves for accelerations and multipliers at the configuration of `g` and of the last
    /// [`Saddle::evaluate_mass`]; dropped rows get λ = 0.
    ///
    /// # Errors
    /// `simulation/singular-mass` naming the coordinate that no mass and no joint determines.
    pub fn solve(
        &mut self,
        system: &dyn System,
        g: &BlockMatrix,
        force: &[f64],
        tau: &[f64],
        a: &mut [f64],
        lambda: &mut [f64],
    ) -> Result<(), EvaluationFailure> {
        self.load(g);
        let n = self.coordinates;
        let mut analysed = false;
        while !analysed {
            analysed = self
                .lu
                .factor(&self.pattern, &self.values, || None)
                .map_err(|e| singular(system, e, n))?;
            self.analyses += u64::from(analysed);
            self.right_side(force, tau);
            self.lu.solve(&self.pattern, &self.values, &mut self.work);
            if self.lu.serves() {
                break;
            }
        }
        self.hand_out(a, lambda);
        Ok(())
    }

    /// Puts M and G, scaled, into their places.
    pub(super) fn load(&mut self, g: &BlockMatrix) {
        if self.pattern.n_rows() != self.order() {
            self.place(g);
        }
        let of = |(source, scale)| match source {
            Source::Mass => (self.mass.values(), scale),
            Source::Jacobian => (g.values(), scale),
        };
        self.assembly.write(of, &mut self.values);
    }

    /// The scaled matrix with all its zeros, by rows.
    pub(super) fn write_dense(&self, matrix: &mut [f64]) {
        let n = self.pattern.n_rows();
        matrix.fill(0.0);
        for i in 0..n {
            for (slot, j) in self.pattern.row(i) {
                matrix[i * n + j] = self.values[slot];
            }
        }
    }

    /// The scaled right-hand side, to be solved in place.
    pub(super) fn right_side(&mut self, force: &[f64], tau: &[f64]) -> &mut [f64] {
        for ((w, f), s) in self.work.iter_mut().zip(force).zip(&*self.scale) {
            *w = f * s;
        }
        for (k, &row) in self.kept.iter().enumerate() {
            self.work[self.coordinates + k] = tau[row] * self.scale[self.coordinates + row];
        }
        &mut self.work
    }

    /// Pattern, values and right-hand side of the scaled system.
    #[cfg(feature = "general-sparse")]
    pub(super) fn parts(&mut self) -> (&SparsePattern, &[f64], &mut [f64]) {
        (&self.pattern, &self.values, &mut self.work)
    }

    /// Accelerations and multipliers from the scaled solution.
    pub(super) fn hand_out(&self, a: &mut [f64], lambda: &mut [f64]) {
        for ((out, w), s) in a.iter_mut().zip(&self.work).zip(&*self.scale) {
            *out = w * s;
        }
        lambda.fill(0.0);
        let n = self.coordinates;
        for (k, &row) in self.kept.iter().enumerate() {
            lambda[row] = self.work[n + k] * self.scale[n + row];
        }
    }
}

pub(super) fn singular(
    system: &dyn System,
    e: holonom_linalg::SingularMatrix,
    coordinates: usize,
) -> EvaluationFailure {
    let failure = |what: &str| {
        let message = format!("the accelerations are not determined: {what}");
        EvaluationFailure::new("simulation/singular-mass", message)
    };
    if e.column >= coordinates {
        return failure("the constraints are dependent");
    }
    let name = system.coordinate_name(e.column);
    failure(&format!("coordinate `{name}` has no mass or inertia behind it"))
        .of_coordinate(e.column)
}
