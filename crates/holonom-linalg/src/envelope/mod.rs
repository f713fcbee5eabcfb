//! Root-free Cholesky factorisation of a symmetric positive definite matrix of small blocks within its envelope.

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
use plan::Line;
use std::sync::Arc;
use substitution::{Lanes, SolveOne, within};

/// L and D of P B Pᵀ = L D Lᵀ, in the envelope of B: fill stays inside it. L has ones on its diagonal, D is
/// diagonal: what Cholesky's factor is without square roots, as stable, and rows wait for each other less long.
///
/// The symbolic part is [`EnvelopePlan`], made once; [`factor`](Self::factor) and the solves allocate
/// nothing (the first solve with several right-hand sides makes room for them).
///
/// ```text
/// L(i,j) D(j) = (B(i,j) − Σ L(i,k) D(k) L(j,k)ᵀ) L(j,j)⁻ᵀ      max(f(i), f(j)) ≤ k < j,  f(i) = i − β(i)
/// L(i,i) D(i) L(i,i)ᵀ = B(i,i) − Σ L(i,k) D(k) L(i,k)ᵀ         f(i) ≤ k < i
/// ```
///
/// Source: A. George, J. W. Liu, *Computer Solution of Large Sparse Positive Definite Systems* (1981),
/// chapter 4, by blocks.
#[derive(Debug, Clone)]
pub struct EnvelopeCholesky {
    plan: Arc<EnvelopePlan>,
    numbers: Vec<f64>,
    /// D⁻¹.
    inverse: Vec<f64>,
    /// Diagonal of B.
    diagonal: Vec<f64>,
    work: Vec<f64>,
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
        let (inverse, diagonal, work) = (vec![1.0; n], vec![1.0; n], vec![0.0; n]);
        Self { numbers: vec![0.0; plan.len()], inverse, diagonal, work, plan }
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
        self.work.fill(0.0);
        self.factor_forward(values, None)
    }

    /// Factors the matrix and solves B x = b in place: substitution inwards goes along with the elimination.
    ///
    /// # Errors
    /// As [`factor`](Self::factor).
    ///
    /// # Panics
    /// If there are not as many values as the plan places, or `b` has not n entries.
    pub fn factor_solve(
        &mut self,
        values: &[f64],
        b: &mut [f64],
    ) -> Result<(), NotPositiveDefinite> {
        if self.plan.natural {
            self.factor_forward(values, Some(b))?;
        } else {
            self.gather(b);
            self.factor_forward(values, None)?;
        }
        self.substitute(b, false);
        Ok(())
    }

    /// L⁻¹ times `b`, or what is at work, along with the factorisation.
    fn factor_forward(
        &mut self,
        values: &[f64],
        b: Option<&mut [f64]>,
    ) -> Result<(), NotPositiveDefinite> {
        let Self { plan, numbers, inverse, diagonal, work } = self;
        let x = b.unwrap_or(&mut work[..plan.n()]);
        assert_eq!(values.len(), plan.len(), "one value for each place of the envelope");
        assert_eq!(x.len(), plan.n(), "right-hand side of a matrix of {} rows", plan.n());
        pulp::Arch::new().dispatch(Factorization { plan, values, numbers, inverse, diagonal, x })
    }

    /// Diagonal of the matrix that was factored last, in the order of the plan.
    pub fn diagonal(&self) -> &[f64] {
        &self.diagonal
    }

    /// Smallest pivot of the last factorisation over its diagonal entry of B: about so many digits of a
    /// solution are lost. The condition of B with a diagonal of ones is not below its inverse.
    pub fn least_pivot(&self) -> f64 {
        let parts = self.inverse.iter().zip(&self.diagonal).map(|(inverse, b)| 1.0 / (inverse * b));
        parts.fold(1.0, f64::min)
    }

    /// Solves B x = b in place.
    ///
    /// # Panics
    /// If `b` has not n entries.
    pub fn solve(&mut self, b: &mut [f64]) {
        let n = self.plan.n();
        assert_eq!(b.len(), n, "right-hand side of a matrix of {n} rows");
        if !self.plan.natural {
            self.gather(b);
        }
        self.substitute(b, true);
    }

    fn gather(&mut self, b: &[f64]) {
        for (w, &row) in self.work.iter_mut().zip(&self.plan.row_at) {
            *w = b[row];
        }
    }

    /// Solves for `b`, or what is at work where the order is another one, into `b`.
    fn substitute(&mut self, b: &mut [f64], forward: bool) {
        let Self { plan, numbers, inverse, work, .. } = self;
        let n = plan.n();
        let x = if plan.natural { &mut b[..n] } else { &mut work[..n] };
        pulp::Arch::new().dispatch(SolveOne { plan, numbers, inverse, x, forward });
        if !plan.natural {
            for (w, &row) in work.iter().zip(&plan.row_at) {
                b[row] = *w;
            }
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

/// A factorisation with the widest vectors this processor has; `x` becomes L⁻¹x.
struct Factorization<'a> {
    plan: &'a EnvelopePlan,
    values: &'a [f64],
    numbers: &'a mut [f64],
    inverse: &'a mut [f64],
    diagonal: &'a mut [f64],
    x: &'a mut [f64],
}

impl pulp::WithSimd for Factorization<'_> {
    type Output = Result<(), NotPositiveDefinite>;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) -> Self::Output {
        for line in &self.plan.lines {
            by_lanes!(line.rows, factor_line(&mut self, line))?;
        }
        Ok(())
    }
}

/// One block row of L from that of B and the rows before it.
#[inline(always)]
fn factor_line<const W: usize, const P: usize>(
    at: &mut Factorization,
    line: &Line,
) -> Result<(), NotPositiveDefinite> {
    let (done, rest) = at.numbers.split_at_mut(line.offset);
    let (values, _) = at.values[line.values()].as_chunks::<W>();
    let (row, _) = rest[..values.len() * W].as_chunks_mut::<W>();
    for before in &at.plan.lines[line.first..] {
        if before.begin == line.begin {
            break;
        }
        by_rows!(before.rows, off_diagonal::<W, P>(line, before, values, done, row));
    }
    let (x_before, x) = at.x[line.start..].split_at_mut(line.left());
    let x: &mut [f64; W] = x.first_chunk_mut().expect("the rows of the block");
    let (before, inverse) = at.inverse[line.start..].split_at_mut(line.left());
    let inverse: &mut [f64; W] = inverse.first_chunk_mut().expect("the rows of the block");
    let (left, own) = row.split_at_mut(line.left());
    let own: &mut [[f64; W]; W] = own.first_chunk_mut().expect("a diagonal block");
    let values: &[[f64; W]; W] = values.last_chunk().expect("a diagonal block");
    let mut a: [[f64; P]; W] = std::array::from_fn(|d| widen(&values[d]));
    let mut right: [f64; P] = widen(x);
    // Until here D is in the blocks left of the diagonal.
    for ((l, inverse), x) in left.iter_mut().zip(before).zip(x_before) {
        let with_d = *l;
        let without: [f64; P] = widen(&with_d.map(|l| l * *inverse));
        for w in 0..P {
            right[w] -= without[w] * *x;
        }
        for d in 0..W {
            for w in lanes_from(d)..P {
                a[d][w] -= with_d[d] * without[w];
            }
        }
        l.copy_from_slice(&without[..W]);
    }
    let pivots = eliminate(&mut a, own, inverse);
    x.copy_from_slice(&right[..W]);
    *x = within(own, *x);
    let diagonal: &mut [f64; W] =
        at.diagonal[line.begin..].first_chunk_mut().expect("the rows of the block");
    *diagonal = std::array::from_fn(|d| values[d][d]);
    for d in 0..W {
        // Written so that a NaN fails.
        let good = pivots[d] > NEGLIGIBLE * diagonal[d] && pivots[d].is_finite();
        if !good {
            let index = at.plan.row_at[line.begin + d];
            return Err(NotPositiveDefinite { index, pivot: pivots[d] });
        }
    }
    Ok(())
}

/// L(i,i) and the inverse of D(i); returns D(i). Pivots come in pairs, so that their two divisions need not wait for
/// each other: the second pivot is the determinant over the first one, with no more cancellation than in itself.
#[inline(always)]
fn eliminate<const W: usize, const P: usize>(
    a: &mut [[f64; P]; W],
    l: &mut [[f64; W]; W],
    inverse: &mut [f64; W],
) -> [f64; W] {
    let mut pivots = [0.0; W];
    for pair in 0..W.div_ceil(2) {
        let d = 2 * pair;
        let first = a[d];
        pivots[d] = first[d];
        inverse[d] = 1.0 / first[d];
        l[d] = std::array::from_fn(|w| first[w] * inverse[d]);
        if d + 1 < W {
            let determinant = first[d] * a[d + 1][d + 1] - first[d + 1] * first[d + 1];
            pivots[d + 1] = determinant * inverse[d];
            inverse[d + 1] = first[d] / determinant;
            subtract(a, d + 1, &l[d], &first);
            let second = a[d + 1];
            l[d + 1] = std::array::from_fn(|w| second[w] * inverse[d + 1]);
            subtract(a, d + 2, &l[d + 1], &second);
        }
    }
    pivots
}

/// A row of L times that of D Lᵀ from the rows that are left of a diagonal block.
#[inline(always)]
fn subtract<const W: usize, const P: usize>(
    a: &mut [[f64; P]; W],
    from: usize,
    l: &[f64; W],
    with_d: &[f64; P],
) {
    for next in from..W {
        for w in lanes_from(next)..P {
            a[next][w] -= l[next] * with_d[w];
        }
    }
}

/// First lane of the vector that holds the diagonal entry of row `d`: what stands before it is not read.
#[inline(always)]
fn lanes_from(d: usize) -> usize {
    d - d % 4
}

/// One block of S rows left of the diagonal: W rows of B, minus products with what is left of it, times
/// L(j,j)⁻ᵀ, in P lanes.
#[inline(always)]
fn off_diagonal<const W: usize, const P: usize, const S: usize>(
    line: &Line,
    before: &Line,
    values: &[[f64; W]],
    done: &[f64],
    row: &mut [[f64; W]],
) {
    let common = line.start.max(before.start);
    let columns = before.begin - common;
    let from = before.offset + (common - before.start) * S;
    let (block, _) = done[from..][..(columns + S) * S].as_chunks::<S>();
    let (block, diagonal) = block.split_at(columns);
    let at = before.begin - line.start;
    let (left, out) = row.split_at_mut(at);
    let left = &left[common - line.start..];
    let out: &mut [[f64; W]; S] = out.first_chunk_mut().expect("a block");
    let values: &[[f64; W]; S] = values[at..].first_chunk().expect("a block");
    let diagonal: &[[f64; S]; S] = diagonal.first_chunk().expect("a diagonal block");
    let mut a: [[f64; P]; S] = std::array::from_fn(|s| widen(&values[s]));
    for (x, l) in left.iter().zip(block) {
        let x: [f64; P] = widen(x);
        for s in 0..S {
            for w in 0..P {
                a[s][w] -= l[s] * x[w];
            }
        }
    }
    for s in 0..S {
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
