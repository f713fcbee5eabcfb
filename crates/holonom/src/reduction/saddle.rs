//! Accelerations and multipliers from the index-1 system [M Gᵀ; G 0] (q̈, λ) = (Q, τ).

use crate::error::EvaluationFailure;
use crate::system::{Measure, System};
use holonom_linalg::{BlockMatrix, BlockPattern, SparseLu, SparsePattern};
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
    /// (value of M, slot, scale).
    mass_copies: Arc<[(u32, u32, f64)]>,
    /// (value of G, slot in G, slot in Gᵀ, scale).
    jacobian_copies: Arc<[(u32, u32, u32, f64)]>,
    /// Congruence scaling: coordinates by the characteristic length, rows by their kind and mass.
    scale: Arc<[f64]>,
    lu: Option<SparseLu>,
    work: Vec<f64>,
    coordinates: usize,
    /// What refinement left with fresh pivots.
    fresh: f64,
    analyses: u64,
}

/// Frozen pivots serve while refinement comes this far, or not much less far than with fresh ones.
const ACCURACY: f64 = 1e-13;
const WORSE_THAN_FRESH: f64 = 100.0;

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
            mass_copies: Arc::default(),
            jacobian_copies: Arc::default(),
            scale: scale.into(),
            lu: None,
            work: Vec::new(),
            coordinates: n,
            fresh: 0.0,
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
        self.lu = None;
        self.pattern = SparsePattern::new(0, 0, &[]).0;
    }

    fn place(&mut self, g: &BlockMatrix) {
        let n = self.coordinates;
        let mut position = vec![usize::MAX; g.n_rows()];
        for (k, &row) in self.kept.iter().enumerate() {
            position[row] = n + k;
        }
        let mut entries = Vec::new();
        let mut masses = Vec::new();
        for (at, (i, j)) in self.mass.entries(0, 0).into_iter().enumerate() {
            if self.nonzero_m[at] {
                entries.push((i, j));
                masses.push((at, self.scale[i] * self.scale[j]));
            }
        }
        let mut jacobians = Vec::new();
        for (at, (row, j)) in g.entries(0, 0).into_iter().enumerate() {
            if self.nonzero_g[at] && position[row] != usize::MAX {
                entries.push((position[row], j));
                entries.push((j, position[row]));
                jacobians.push((at, self.scale[n + row] * self.scale[j]));
            }
        }
        let size = self.order();
        let (pattern, slots) = SparsePattern::new(size, size, &entries);
        self.values = vec![0.0; pattern.len()];
        self.pattern = pattern;
        self.mass_copies = masses
            .iter()
            .zip(&slots)
            .map(|(&(at, scale), &slot)| (at as u32, slot as u32, scale))
            .collect();
        self.jacobian_copies = jacobians
            .iter()
            .zip(slots[masses.len()..].chunks_exact(2))
            .map(|(&(at, scale), s)| (at as u32, s[0] as u32, s[1] as u32, scale))
            .collect();
        self.work = vec![0.0; size];
        self.lu = None;
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
        self.lu = None;
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
        let solves = |lu: &SparseLu| 2 * lu.fill() + self.pattern.len();
        self.lu.as_ref().map(|lu| lu.operations() / 2 + solves(lu))
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
        let frozen = self.lu.as_mut().is_some_and(|lu| lu.refactor(&self.values).is_ok());
        let served = frozen && {
            let left = self.solve_factored(force, tau);
            left <= ACCURACY.max(WORSE_THAN_FRESH * self.fresh)
        };
        if !served {
            self.analyses += 1;
            let analysis = SparseLu::analyze_for_many(&self.pattern, &self.values);
            self.lu = Some(analysis.map_err(|e| singular(system, e, n))?);
            self.fresh = self.solve_factored(force, tau);
        }
        self.hand_out(a, lambda);
        Ok(())
    }

    /// Puts M and G, scaled, into their places.
    pub(super) fn load(&mut self, g: &BlockMatrix) {
        if self.pattern.n_rows() != self.order() {
            self.place(g);
        }
        for &(at, slot, scale) in &*self.mass_copies {
            self.values[slot as usize] = self.mass.values()[at as usize] * scale;
        }
        for &(at, lower, upper, scale) in &*self.jacobian_copies {
            let x = g.values()[at as usize] * scale;
            self.values[lower as usize] = x;
            self.values[upper as usize] = x;
        }
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

    /// Scaled solution into `work`; returns its relative error as far as the refinement tells.
    fn solve_factored(&mut self, force: &[f64], tau: &[f64]) -> f64 {
        self.right_side(force, tau);
        let lu = self.lu.as_mut().expect("analysed before");
        lu.solve_refined(&self.pattern, &self.values, &mut self.work)
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
