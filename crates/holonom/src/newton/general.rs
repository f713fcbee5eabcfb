//! A sparse sum of the mechanism's matrices and its factors, real and complex, in an order found from the pattern.

use super::blocks::ReducedBlocks;
use super::sparse_pattern::{Nonzeros, Shape, Sum, SumPattern};
use super::units::Units;
use crate::reduction::{BodyRows, Manifold, disturb};
use crate::system::State;
use holonom_linalg::{Complex64, FrozenLu, SingularMatrix, SparseLu};

/// What is found at the first linearization, and again when another entry appears; with the numbers of the last one.
#[derive(Debug, Clone)]
pub(super) struct GeneralElimination {
    shape: Shape,
    nonzeros: Nonzeros,
    pattern: SumPattern,
    /// G and the moving rows of P of the linearization.
    jacobian: Vec<f64>,
    moving: BodyRows,
    values: Vec<f64>,
    units: Units,
    lu: FrozenLu,
    complex: Option<ComplexFactor>,
}

/// The factor for a complex γh, with the pivots of the real one.
#[derive(Debug, Clone)]
struct ComplexFactor {
    lu: SparseLu<Complex64>,
    values: Vec<Complex64>,
}

/// Growth of numbers in the elimination from which solutions are refined.
const HARMLESS_GROWTH: f64 = 1e4;
/// What refinement may leave of the relative error before pivots are chosen anew.
const ACCURACY: f64 = 1e-9;

impl GeneralElimination {
    /// At a complete state, where the blocks are evaluated.
    pub(super) fn new(
        shape: Shape,
        manifold: &Manifold,
        state: &State,
        blocks: &mut ReducedBlocks,
    ) -> Self {
        // What vanishes by chance at this state does not at a generic one.
        let mut nonzeros = Nonzeros::new(shape, blocks);
        let mut generic = state.clone();
        let State { q, v, a, lambda, z, .. } = &mut generic;
        for (round, x) in [q, v, a, lambda, z].into_iter().enumerate() {
            let here = x.clone();
            disturb(&here, round as u32 + 1, x);
        }
        blocks.evaluate_system(manifold, &generic);
        nonzeros.observe(blocks);
        blocks.evaluate_system(manifold, state);
        nonzeros.observe(blocks);
        let pattern = SumPattern::new(shape, manifold, &state.q, &nonzeros);
        let mut new = Self {
            shape,
            nonzeros,
            values: vec![0.0; pattern.len()],
            units: Units::new(manifold, &state.q),
            pattern,
            jacobian: Vec::new(),
            moving: manifold.chart().moving().clone(),
            lu: FrozenLu::new(HARMLESS_GROWTH, ACCURACY),
            complex: None,
        };
        new.take(manifold);
        new
    }

    /// Another complete state, where the blocks have been evaluated.
    pub(super) fn linearize(&mut self, manifold: &Manifold, state: &State, blocks: &ReducedBlocks) {
        if self.nonzeros.observe(blocks) {
            self.pattern = SumPattern::new(self.shape, manifold, &state.q, &self.nonzeros);
            self.values.resize(self.pattern.len(), 0.0);
            self.lu.forget();
            self.complex = None;
        }
        self.take(manifold);
    }

    fn take(&mut self, manifold: &Manifold) {
        self.jacobian.clear();
        self.jacobian.extend_from_slice(manifold.jacobian().values());
        self.moving.copy_from(manifold.chart().moving());
    }

    /// Sums and factors; returns the number of symbolic analyses made.
    pub(super) fn factor(&mut self, sum: &Sum<'_, f64>) -> Result<u64, SingularMatrix> {
        self.pattern.fill(sum, &self.jacobian, &self.moving, &mut self.values);
        let units = || Some(self.units.of(self.shape));
        let analysed = self.lu.factor(self.pattern.pattern(), &self.values, units)?;
        if analysed {
            self.complex = None;
        }
        Ok(u64::from(analysed))
    }

    /// The same with complex coefficients, after the real ones.
    pub(super) fn factor_complex(
        &mut self,
        sum: &Sum<'_, Complex64>,
    ) -> Result<(), SingularMatrix> {
        let real = self.lu.factors().expect("the real factor comes first");
        let complex = self.complex.get_or_insert_with(|| ComplexFactor {
            lu: real.complex(),
            values: vec![Complex64::new(0.0, 0.0); self.values.len()],
        });
        self.pattern.fill(sum, &self.jacobian, &self.moving, &mut complex.values);
        self.lu.factor_complex(&mut complex.lu, &complex.values)
    }

    /// A solution in place of its right-hand side.
    pub(super) fn solve(&mut self, right: &mut [f64]) {
        self.lu.solve(self.pattern.pattern(), &self.values, right);
    }

    /// The same with the complex factor.
    pub(super) fn solve_complex(&mut self, right: &mut [Complex64]) {
        let ComplexFactor { lu, values } =
            self.complex.as_mut().expect("factored before it is solved with");
        self.lu.solve_complex(lu, self.pattern.pattern(), values, right);
    }
}
