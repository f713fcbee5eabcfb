//! A square matrix over the coordinates of all bodies with a fixed pattern, and its factors: by blocks of
//! bodies where it has the shape of the forest, else by a sparse LU.

use crate::system::System;
use holonom_linalg::{
    BlockForest, ForestLu, Pivots, SingularMatrix, SparseLu, SparsePattern, scale_rows,
};
use std::sync::Arc;

/// Growth of numbers in the elimination that costs no digit worth a look.
const HARMLESS_GROWTH: f64 = 1e3;
/// Relative errors of a solution that are let pass, and that one refinement takes to round-off.
const HARMLESS_ERROR: f64 = 1e-13;
const REFINED_ERROR: f64 = 1e-8;

/// Values and factors.
#[derive(Debug, Clone)]
pub(super) struct Square {
    pub(super) values: Vec<f64>,
    factors: Factors,
}

#[derive(Debug, Clone)]
enum Factors {
    Forest(ForestLu),
    Sparse(Box<Sparse>),
}

#[derive(Debug, Clone)]
struct Sparse {
    pattern: Arc<SparsePattern>,
    /// None before the first factorisation.
    lu: Option<SparseLu>,
    /// Room for several right-hand sides at a time is kept.
    lanes: bool,
    /// Solutions need refinement: the frozen pivots let numbers grow.
    refine: bool,
    probe: Vec<f64>,
    product: Vec<f64>,
}

impl Square {
    /// A zero matrix with entries at these (row, column), and where each stands among the values.
    pub(super) fn new(system: &dyn System, entries: &[(usize, usize)]) -> (Self, Vec<usize>) {
        let sizes = system.structure().sizes;
        let tree = &system.tree().forest;
        let forest =
            BlockForest::find(sizes.per_body, &tree.parent, &tree.walk(), entries.iter().copied());
        if let Some(forest) = forest {
            let slots = entries.iter().map(|&(i, j)| forest.slot(i, j)).collect();
            let values = vec![0.0; forest.values()];
            let factors = Factors::Forest(ForestLu::new(Arc::new(forest)));
            return (Self { values, factors }, slots);
        }
        let n = sizes.coordinates;
        let (pattern, slots) = SparsePattern::new(n, n, entries);
        let values = vec![0.0; pattern.len()];
        let factors = Factors::Sparse(Box::new(Sparse {
            pattern: Arc::new(pattern),
            lu: None,
            lanes: false,
            refine: false,
            probe: vec![0.0; n],
            product: vec![0.0; n],
        }));
        (Self { values, factors }, slots)
    }

    /// The shape of the forest, where it has that, with E and F of every block among the values.
    pub(super) fn forest(&self) -> Option<&Arc<BlockForest>> {
        match &self.factors {
            Factors::Forest(lu) => Some(lu.forest()),
            Factors::Sparse(_) => None,
        }
    }

    /// Makes room for several right-hand sides at a time, for who solves for them in a step.
    pub(super) fn reserve_lanes(&mut self) {
        match &mut self.factors {
            Factors::Forest(lu) => lu.reserve_lanes(),
            Factors::Sparse(sparse) => {
                sparse.lanes = true;
                if let Some(lu) = &mut sparse.lu {
                    lu.reserve_lanes();
                }
            }
        }
    }

    /// Gives up the room of values and factors, where factoring again with no more than values gives the same.
    pub(super) fn release(&mut self) {
        if let Factors::Forest(lu) = &mut self.factors {
            self.values = Vec::new();
            lu.release();
        }
    }

    /// Makes room for values again where it was given up.
    pub(super) fn restore(&mut self) {
        if let Factors::Forest(lu) = &self.factors {
            self.values.resize(lu.forest().values(), 0.0);
        }
    }

    /// Factors the matrix of the present values, by the pivots chosen before while they serve; returns the
    /// number of symbolic analyses made.
    pub(super) fn factor(&mut self) -> Result<u64, SingularMatrix> {
        match &mut self.factors {
            Factors::Forest(lu) => lu.factor(&self.values).map(|()| 0),
            Factors::Sparse(sparse) => sparse.factor(&self.values),
        }
    }

    /// Takes over the values and factors of a matrix with the same pattern.
    pub(super) fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
        match (&mut self.factors, &other.factors) {
            (Factors::Forest(to), Factors::Forest(from)) => to.copy_from(from),
            (Factors::Sparse(to), Factors::Sparse(from)) => to.copy_from(from, &self.values),
            (to, from) => *to = from.clone(),
        }
    }

    /// Solves in place.
    pub(super) fn solve(&mut self, b: &mut [f64]) {
        match &mut self.factors {
            Factors::Forest(lu) => lu.solve_many(&self.values, b, 1),
            Factors::Sparse(sparse) if sparse.refine => {
                let Sparse { pattern, lu, .. } = &mut **sparse;
                factored(lu).solve_refined(pattern, &self.values, b);
            }
            Factors::Sparse(sparse) => factored(&mut sparse.lu).solve(b),
        }
    }

    /// Solves in place, or with the transpose, for k right-hand sides, by rows, which count times the first scales; those of
    /// solutions come times the second.
    pub(super) fn solve_scaled_many(
        &mut self,
        b: &mut [f64],
        k: usize,
        transposed: bool,
        scales: [&[f64]; 2],
    ) {
        match &mut self.factors {
            Factors::Forest(lu) => {
                scale_rows(scales[0], k, b);
                if transposed {
                    lu.solve_transposed_many(&self.values, b, k);
                } else {
                    lu.solve_many(&self.values, b, k);
                }
                scale_rows(scales[1], k, b);
            }
            Factors::Sparse(sparse) => {
                factored(&mut sparse.lu).solve_scaled_many(b, k, transposed, scales);
            }
        }
    }

    /// Solves with the transpose in place.
    pub(super) fn solve_transposed(&mut self, b: &mut [f64]) {
        match &mut self.factors {
            Factors::Forest(lu) => lu.solve_transposed_many(&self.values, b, 1),
            Factors::Sparse(sparse) => factored(&mut sparse.lu).solve_transposed(b),
        }
    }

    /// The present pivots of a sparse LU whose solutions are not refined.
    pub(super) fn pivots(&self) -> Option<Pivots> {
        match &self.factors {
            Factors::Sparse(sparse) if !sparse.refine => sparse.lu.as_ref().map(SparseLu::pivots),
            _ => None,
        }
    }

    /// Makes columns of right-hand sides, a bit for each that can differ from zero in a row, those of solutions by
    /// [`Square::pivots`].
    pub(super) fn reach(&self, transposed: bool, columns: &mut [u32], room: &mut Vec<u32>) {
        if let Factors::Sparse(sparse) = &self.factors
            && let Some(lu) = &sparse.lu
        {
            lu.reach(transposed, columns, room);
        }
    }

    /// Whether solutions are refined one by one, which those for several right-hand sides are not.
    pub(super) fn refines(&self) -> bool {
        matches!(&self.factors, Factors::Sparse(sparse) if sparse.refine)
    }

    /// Estimate of the condition number, 1-norm.
    pub(super) fn condition(&mut self) -> f64 {
        match &mut self.factors {
            Factors::Forest(lu) => lu.condition_estimate(&self.values),
            Factors::Sparse(sparse) => {
                let Sparse { pattern, lu, .. } = &mut **sparse;
                factored(lu).condition_estimate(pattern, &self.values)
            }
        }
    }

    /// Entries that a solve reads.
    pub(super) fn fill(&self) -> usize {
        match &self.factors {
            Factors::Forest(lu) => lu.fill(),
            Factors::Sparse(sparse) => sparse.lu.as_ref().map_or(0, SparseLu::fill),
        }
    }

    /// Sign of the determinant.
    pub(super) fn determinant_sign(&self) -> f64 {
        match &self.factors {
            Factors::Forest(lu) => lu.determinant_sign(),
            Factors::Sparse(sparse) => sparse.lu.as_ref().map_or(0.0, SparseLu::determinant_sign),
        }
    }
}

fn factored(lu: &mut Option<SparseLu>) -> &mut SparseLu {
    lu.as_mut().expect("factored before it is solved with")
}

impl Sparse {
    fn factor(&mut self, values: &[f64]) -> Result<u64, SingularMatrix> {
        if let Some(lu) = &mut self.lu
            && lu.refactor(values).is_ok()
            && self.pivots_serve(values)
        {
            return Ok(0);
        }
        self.refine = false;
        let mut lu = SparseLu::analyze_for_many(&self.pattern, values)?;
        if self.lanes {
            lu.reserve_lanes();
        }
        self.lu = Some(lu);
        Ok(1)
    }

    fn copy_from(&mut self, other: &Self, values: &[f64]) {
        // Factoring again allocates nothing; a copy of the factors would.
        let refactored = self.lu.as_mut().is_some_and(|lu| lu.refactor(values).is_ok());
        if !(refactored && self.pivots_serve(values)) {
            self.lu.clone_from(&other.lu);
            self.refine = other.refine;
        }
    }

    /// Whether the frozen pivots solve accurately, where they let numbers grow: tried on the
    /// right-hand side whose solution is one everywhere.
    fn pivots_serve(&mut self, values: &[f64]) -> bool {
        self.refine = false;
        let lu = factored(&mut self.lu);
        if lu.growth() <= HARMLESS_GROWTH {
            return true;
        }
        self.probe.fill(1.0);
        self.product.fill(0.0);
        self.pattern.multiply_add(values, 1.0, &self.probe, &mut self.product);
        lu.solve(&mut self.product);
        let error = self.product.iter().fold(0.0f64, |m, x| m.max((x - 1.0).abs()));
        self.refine = error > HARMLESS_ERROR;
        error <= REFINED_ERROR
    }
}
