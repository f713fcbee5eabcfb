//! Cholesky factorisation of a symmetric positive definite matrix of small blocks within its envelope.

mod graph;
mod ordering;
mod plan;
mod substitution;

pub use graph::{BlockGraph, LARGEST_BLOCK};
pub use ordering::{gibbs_king, least_degree, least_envelope, reverse_cuthill_mckee};
pub use plan::EnvelopePlan;

use crate::dense::NEGLIGIBLE;
use crate::error::NotPositiveDefinite;
use crate::lanes::{MOST_LANES, run_lanes};
use std::sync::Arc;
use substitution::{Lanes, SolveOne};

/// L of P B Pᵀ = L Lᵀ, in the envelope of B: fill stays inside it.
///
/// The symbolic part is [`EnvelopePlan`], made once; [`factor`](Self::factor) and the solves allocate
/// nothing (the first solve with several right-hand sides makes room for them).
///
/// ```text
/// L(i,j) = (B(i,j) − Σ L(i,k) L(j,k)ᵀ) L(j,j)⁻ᵀ      max(f(i), f(j)) ≤ k < j,  f(i) = i − β(i)
/// L(i,i) = chol(B(i,i) − Σ L(i,k) L(i,k)ᵀ)           f(i) ≤ k < i
/// ```
///
/// Source: A. George, J. W. Liu, *Computer Solution of Large Sparse Positive Definite Systems* (1981),
/// chapter 4, by blocks.
#[derive(Debug, Clone)]
pub struct EnvelopeCholesky {
    plan: Arc<EnvelopePlan>,
    numbers: Vec<f64>,
    /// Inverse diagonal of L.
    inverse: Vec<f64>,
    work: Vec<f64>,
    least_pivot: f64,
}

/// Calls a function that is generic over the rows of a block, and over the lanes that hold them.
macro_rules! by_lanes {
    ($rows:expr, $function:ident($($argument:expr),*)) => {
        match $rows {
            1 => $function::<1, 1>($($argument),*),
            2 => $function::<2, 2>($($argument),*),
            3 => $function::<3, 4>($($argument),*),
            4 => $function::<4, 4>($($argument),*),
            5 => $function::<5, 8>($($argument),*),
            _ => $function::<6, 8>($($argument),*),
        }
    };
}

/// Calls a function that is generic over the rows of a block.
macro_rules! by_rows {
    ($rows:expr, $function:ident $(::<$own:tt, $lanes:tt>)? ($($argument:expr),*)) => {
        match $rows {
            1 => $function::<$($own, $lanes,)? 1>($($argument),*),
            2 => $function::<$($own, $lanes,)? 2>($($argument),*),
            3 => $function::<$($own, $lanes,)? 3>($($argument),*),
            4 => $function::<$($own, $lanes,)? 4>($($argument),*),
            5 => $function::<$($own, $lanes,)? 5>($($argument),*),
            _ => $function::<$($own, $lanes,)? 6>($($argument),*),
        }
    };
}
use by_rows;

impl EnvelopeCholesky {
    /// Room for the factors of matrices with this plan.
    pub fn new(plan: Arc<EnvelopePlan>) -> Self {
        let n = plan.n();
        let (inverse, work) = (vec![0.0; n], vec![0.0; n]);
        Self { numbers: vec![0.0; plan.len()], inverse, work, least_pivot: 1.0, plan }
    }

    /// The plan.
    pub fn plan(&self) -> &EnvelopePlan {
        &self.plan
    }

    /// Factors the matrix with these values, placed as [`EnvelopePlan::block`] says; what no block of the
    /// matrix covers is zero.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] at the first pivot that is not above round-off of its diagonal entry, with
    /// its row of the matrix. The factor must not be used then.
    ///
    /// # Panics
    /// If there are not as many values as the plan places.
    pub fn factor(&mut self, values: &[f64]) -> Result<(), NotPositiveDefinite> {
        let plan = &*self.plan;
        assert_eq!(values.len(), plan.len(), "one value for each place of the envelope");
        let (numbers, inverse) = (&mut self.numbers[..], &mut self.inverse[..]);
        self.least_pivot =
            pulp::Arch::new().dispatch(Factorization { plan, values, numbers, inverse })?;
        Ok(())
    }

    /// Smallest pivot of the last factorisation over its diagonal entry of B: about so many digits of a
    /// solution are lost. The condition of B with a diagonal of ones is not below its inverse.
    pub fn least_pivot(&self) -> f64 {
        self.least_pivot
    }

    /// Solves B x = b in place.
    ///
    /// # Panics
    /// If `b` has not n entries.
    pub fn solve(&mut self, b: &mut [f64]) {
        let plan = &*self.plan;
        assert_eq!(b.len(), plan.n(), "right-hand side of a matrix of {} rows", plan.n());
        let work = &mut self.work[..plan.n()];
        for (w, &row) in work.iter_mut().zip(&plan.row_at) {
            *w = b[row];
        }
        let (numbers, inverse) = (&self.numbers[..], &self.inverse[..]);
        pulp::Arch::new().dispatch(SolveOne { plan, numbers, inverse, x: &mut *work });
        for (w, &row) in work.iter().zip(&plan.row_at) {
            b[row] = *w;
        }
    }

    /// Solves B X = F in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&mut self, b: &mut [f64], k: usize) {
        if k == 1 {
            return self.solve(b);
        }
        let n = self.plan.n();
        assert_eq!(b.len(), n * k, "right-hand sides of a matrix of {n} rows");
        let room = n * k.min(MOST_LANES);
        if self.work.len() < room {
            self.work.resize(room, 0.0);
        }
        let (numbers, inverse) = (&self.numbers[..], &self.inverse[..]);
        run_lanes(k, &mut Lanes { plan: &self.plan, numbers, inverse, work: &mut self.work, b, k });
    }
}

/// A factorisation with the widest vectors this processor has.
struct Factorization<'a> {
    plan: &'a EnvelopePlan,
    values: &'a [f64],
    numbers: &'a mut [f64],
    inverse: &'a mut [f64],
}

impl pulp::WithSimd for Factorization<'_> {
    type Output = Result<f64, NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) -> Self::Output {
        let Self { plan, values, numbers, inverse } = self;
        let mut least = 1.0f64;
        for p in 0..plan.order.len() {
            let (done, rest) = numbers.split_at_mut(plan.offset[p]);
            let values = &values[plan.offset[p]..plan.offset[p + 1]];
            let row = &mut rest[..values.len()];
            let rows = plan.begin[p + 1] - plan.begin[p];
            least = least.min(by_lanes!(rows, factor_row(plan, p, values, done, inverse, row))?);
        }
        Ok(least)
    }
}

/// Block row `p` of L from that of B and the rows before it; returns its smallest pivot over the diagonal
/// entry of B.
#[inline(always)]
fn factor_row<const W: usize, const P: usize>(
    plan: &EnvelopePlan,
    p: usize,
    values: &[f64],
    done: &[f64],
    inverse: &mut [f64],
    row: &mut [f64],
) -> Result<f64, NotPositiveDefinite> {
    let (values, _) = values.as_chunks::<W>();
    let (row, _) = row.as_chunks_mut::<W>();
    let start = plan.begin[plan.first[p]];
    let begin = plan.begin[p];
    for j in plan.first[p]..p {
        let (j_start, j_begin, j_end) =
            (plan.begin[plan.first[j]], plan.begin[j], plan.begin[j + 1]);
        let common = start.max(j_start);
        let rows = j_end - j_begin;
        let block = &done[plan.offset[j] + (common - j_start) * rows..plan.offset[j + 1]];
        let (left, right) = row.split_at_mut(j_begin - start);
        let left = &left[common - start..];
        let (values, right) = (&values[j_begin - start..j_end - start], &mut right[..rows]);
        let inverse = &inverse[j_begin..j_end];
        by_rows!(rows, off_diagonal::<W, P>(values, left, block, inverse, right));
    }
    let (left, right) = row.split_at_mut(begin - start);
    let values = &values[begin - start..];
    let mut a: [[f64; W]; W] = std::array::from_fn(|d| values[d]);
    for x in left.iter() {
        for d in 0..W {
            for w in d..W {
                a[d][w] -= x[d] * x[w];
            }
        }
    }
    let mut least = 1.0f64;
    for d in 0..W {
        let pivot = a[d][d];
        // Written so that a NaN fails.
        let good = pivot > NEGLIGIBLE * values[d][d] && pivot.is_finite();
        if !good {
            return Err(NotPositiveDefinite { index: plan.row_at[begin + d], pivot });
        }
        least = least.min(pivot / values[d][d]);
        let scale = 1.0 / pivot.sqrt();
        inverse[begin + d] = scale;
        for w in d..W {
            a[d][w] *= scale;
        }
        for next in d + 1..W {
            for w in next..W {
                a[next][w] -= a[d][next] * a[d][w];
            }
        }
        right[d] = a[d];
    }
    Ok(least)
}

/// One block of S rows left of the diagonal: W rows of B, minus products with what is `left` of it, times
/// L(j,j)⁻ᵀ, in P lanes. `block` is block row j of L from the first common column on.
#[inline(always)]
fn off_diagonal<const W: usize, const P: usize, const S: usize>(
    values: &[[f64; W]],
    left: &[[f64; W]],
    block: &[f64],
    inverse: &[f64],
    out: &mut [[f64; W]],
) {
    let (block, _) = block.as_chunks::<S>();
    let mut a: [[f64; P]; S] = std::array::from_fn(|s| widen(&values[s]));
    for (x, l) in left.iter().zip(block) {
        let x: [f64; P] = widen(x);
        for s in 0..S {
            for w in 0..P {
                a[s][w] -= l[s] * x[w];
            }
        }
    }
    let diagonal = &block[left.len()..];
    for s in 0..S {
        for w in 0..P {
            a[s][w] *= inverse[s];
        }
        let x = a[s];
        for next in s + 1..S {
            for w in 0..P {
                a[next][w] -= diagonal[s][next] * x[w];
            }
        }
        out[s].copy_from_slice(&x[..W]);
    }
}

/// Numbers in lanes, with zeros in the rest.
#[inline(always)]
fn widen<const W: usize, const P: usize>(x: &[f64; W]) -> [f64; P] {
    std::array::from_fn(|w| if w < W { x[w] } else { 0.0 })
}
