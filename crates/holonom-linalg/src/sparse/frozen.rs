//! An LU that keeps its pivots while they serve.

use crate::complex::Complex64;
use crate::error::SingularMatrix;
use crate::sparse::{SparseLu, SparsePattern};

/// What refinement may leave more than with fresh pivots before these are chosen anew.
const WORSE_THAN_FRESH: f64 = 100.0;

/// A sparse LU with pivots of an earlier matrix of the same pattern, which are chosen anew where they cannot be used or where
/// solutions have shown that they are bad.
///
/// Solutions are refined where numbers have grown in the elimination. What the last refinement has left tells of the
/// pivots, against the `accuracy` that is wanted or what fresh ones have left.
#[derive(Debug, Clone)]
pub struct FrozenLu {
    harmless_growth: f64,
    accuracy: f64,
    lu: Option<SparseLu>,
    /// Relative error that the last refinement has left, and the first one with these pivots; NaN before it.
    left: f64,
    fresh: f64,
}

impl FrozenLu {
    /// Without factors; solutions are refined from this growth of numbers on, to this relative accuracy.
    pub fn new(harmless_growth: f64, accuracy: f64) -> Self {
        Self { harmless_growth, accuracy, lu: None, left: 0.0, fresh: f64::NAN }
    }

    /// Pivots are chosen anew at the next factorisation.
    pub fn forget(&mut self) {
        (self.lu, self.left, self.fresh) = (None, 0.0, f64::NAN);
    }

    /// Whether solutions are as accurate as they can be with pivots of this matrix, as far as is known.
    pub fn serves(&self) -> bool {
        self.left <= self.accuracy.max(WORSE_THAN_FRESH * self.fresh)
    }

    /// Factors a matrix; returns whether pivots were chosen anew, by the [units](SparseLu::analyze_in_units) given, if any.
    ///
    /// # Errors
    /// [`SingularMatrix`] as [`SparseLu::analyze`].
    pub fn factor(
        &mut self,
        pattern: &SparsePattern,
        values: &[f64],
        units: impl FnOnce() -> Option<[Vec<f64>; 2]>,
    ) -> Result<bool, SingularMatrix> {
        let serves = self.serves();
        if let Some(lu) = &mut self.lu
            && serves
            && lu.refactor(values).is_ok()
        {
            return Ok(false);
        }
        self.forget();
        self.lu = Some(match units() {
            Some(units) => SparseLu::analyze_in_units(pattern, values, &units)?,
            None => SparseLu::analyze_for_many(pattern, values)?,
        });
        Ok(true)
    }

    /// Solves A x = b in place for the matrix last factored, of which pattern and values are given.
    ///
    /// # Panics
    /// If none is factored.
    pub fn solve(&mut self, pattern: &SparsePattern, values: &[f64], b: &mut [f64]) {
        let lu = self.lu.as_mut().expect("factored before it is solved with");
        if lu.growth() <= self.harmless_growth {
            lu.solve(b);
            return;
        }
        self.left = lu.solve_refined(pattern, values, b);
        if self.fresh.is_nan() {
            self.fresh = self.left;
        }
    }

    /// Factors that were made last, if any.
    pub fn factors(&self) -> Option<&SparseLu> {
        self.lu.as_ref()
    }

    /// Factors a complex matrix of this pattern with these pivots, in `complex`, once it is made from
    /// [`factors`](Self::factors).
    ///
    /// # Errors
    /// [`SingularMatrix`] where they cannot be used; the next real matrix gets others.
    pub fn factor_complex(
        &mut self,
        complex: &mut SparseLu<Complex64>,
        values: &[Complex64],
    ) -> Result<(), SingularMatrix> {
        complex.refactor(values).inspect_err(|_| self.left = f64::INFINITY)
    }

    /// The same as [`solve`](Self::solve) for it.
    pub fn solve_complex(
        &mut self,
        complex: &mut SparseLu<Complex64>,
        pattern: &SparsePattern,
        values: &[Complex64],
        b: &mut [Complex64],
    ) {
        if complex.growth() <= self.harmless_growth {
            complex.solve(b);
        } else {
            self.left = self.left.max(complex.solve_refined(pattern, values, b));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // truth: x is known, and 1 / ε is the growth of a pivot ε
    fn pivots_stay_until_solutions_show_that_they_are_bad() {
        let (pattern, slots) = SparsePattern::new(2, 2, &[(0, 0), (0, 1), (1, 0), (1, 1)]);
        let solved = |frozen: &mut FrozenLu, a: [f64; 4]| {
            let mut values = [0.0; 4];
            slots.iter().zip(a).for_each(|(slot, a)| values[*slot] = a);
            let analysed = frozen.factor(&pattern, &values, || None).unwrap();
            let mut x = [a[0] + 2.0 * a[1], a[2] + 2.0 * a[3]];
            frozen.solve(&pattern, &values, &mut x);
            (analysed, (x[0] - 1.0).abs().max((x[1] - 2.0).abs()))
        };
        let mut frozen = FrozenLu::new(1e3, 1e-9);
        let (analysed, error) = solved(&mut frozen, [4.0, 1.0, 1.0, 3.0]);
        assert!(analysed && error < 1e-14);
        let (analysed, error) = solved(&mut frozen, [3.0, 1.0, -1.0, 4.0]);
        assert!(!analysed && error < 1e-14);
        // Numbers grow, refinement makes up for it, and pivots stay.
        let (analysed, error) = solved(&mut frozen, [1e-5, 1.0, 1.0, 1.0]);
        assert!(!analysed && error < 1e-12, "{error}");
        assert!(frozen.serves());
        // No pivot any more at all.
        let (analysed, error) = solved(&mut frozen, [0.0, 1.0, 1.0, 0.0]);
        assert!(analysed && error < 1e-14);
        frozen.forget();
        assert!(frozen.factors().is_none());
        // What refinement has left counts, against what is wanted and what fresh pivots have left.
        for (left, fresh, serves) in [
            (1e-10, f64::NAN, true),
            (1e-8, f64::NAN, false),
            (1e-8, 1e-9, true),
            (1e-6, 1e-9, false),
        ] {
            let mut frozen = FrozenLu::new(1e3, 1e-9);
            solved(&mut frozen, [4.0, 1.0, 1.0, 3.0]);
            (frozen.left, frozen.fresh) = (left, fresh);
            assert_eq!(frozen.serves(), serves);
            let (analysed, _) = solved(&mut frozen, [4.0, 1.0, 1.0, 3.0]);
            assert_eq!(analysed, !serves);
            assert_eq!(frozen.left, if serves { left } else { 0.0 });
        }
    }

    #[test] // truth: a complex matrix without a pivot, and one that is the real one
    fn a_complex_matrix_that_its_pivots_do_not_serve_brings_others() {
        let (pattern, _) = SparsePattern::new(1, 1, &[(0, 0)]);
        let mut frozen = FrozenLu::new(1e3, 1e-9);
        assert!(frozen.factor(&pattern, &[2.0], || None).unwrap());
        let mut complex = frozen.factors().unwrap().complex();
        let of = |re, im| [Complex64::new(re, im)];
        frozen.factor_complex(&mut complex, &of(0.0, 2.0)).unwrap();
        let mut x = of(4.0, 0.0);
        frozen.solve_complex(&mut complex, &pattern, &of(0.0, 2.0), &mut x);
        assert_eq!(x, of(0.0, -2.0));
        assert!(frozen.serves() && frozen.factor_complex(&mut complex, &of(0.0, 0.0)).is_err());
        assert!(frozen.factor(&pattern, &[2.0], || None).unwrap());
    }
}
