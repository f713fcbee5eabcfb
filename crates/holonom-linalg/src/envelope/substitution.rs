//! Forward and backward substitution with an envelope factor.

use super::{EnvelopePlan, by_rows};
use crate::lanes::{LaneKernel, lanes, lanes_mut};

/// L Lᵀ x = b in place, in the order of the plan.
pub(super) struct SolveOne<'a> {
    pub(super) plan: &'a EnvelopePlan,
    pub(super) numbers: &'a [f64],
    pub(super) inverse: &'a [f64],
    pub(super) x: &'a mut [f64],
}

impl pulp::WithSimd for SolveOne<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { plan, numbers, inverse, x } = self;
        let blocks = plan.order.len();
        for p in 0..blocks {
            by_rows!(plan.begin[p + 1] - plan.begin[p], forward(plan, p, numbers, inverse, x));
        }
        for p in (0..blocks).rev() {
            by_rows!(plan.begin[p + 1] - plan.begin[p], backward(plan, p, numbers, inverse, x));
        }
    }
}

/// Columns of block row `p` left of the diagonal and in the diagonal block.
#[inline(always)]
fn columns<'a, const W: usize>(
    plan: &EnvelopePlan,
    p: usize,
    numbers: &'a [f64],
) -> (&'a [[f64; W]], &'a [[f64; W]]) {
    let (row, _) = numbers[plan.offset[p]..plan.offset[p + 1]].as_chunks::<W>();
    row.split_at(row.len() - W)
}

#[inline(always)]
fn forward<const W: usize>(
    plan: &EnvelopePlan,
    p: usize,
    numbers: &[f64],
    inverse: &[f64],
    x: &mut [f64],
) {
    let (left, diagonal) = columns::<W>(plan, p, numbers);
    let (before, own) = x.split_at_mut(plan.begin[p]);
    let before = &before[plan.begin[plan.first[p]]..];
    let own: &mut [f64; W] = own.first_chunk_mut().expect("the rows of the block");
    let mut a = *own;
    for (l, x) in left.iter().zip(before) {
        for w in 0..W {
            a[w] -= l[w] * x;
        }
    }
    for d in 0..W {
        a[d] *= inverse[plan.begin[p] + d];
        for w in d + 1..W {
            a[w] -= diagonal[d][w] * a[d];
        }
    }
    *own = a;
}

#[inline(always)]
fn backward<const W: usize>(
    plan: &EnvelopePlan,
    p: usize,
    numbers: &[f64],
    inverse: &[f64],
    x: &mut [f64],
) {
    let (left, diagonal) = columns::<W>(plan, p, numbers);
    let (before, own) = x.split_at_mut(plan.begin[p]);
    let before = &mut before[plan.begin[plan.first[p]]..];
    let own: &mut [f64; W] = own.first_chunk_mut().expect("the rows of the block");
    let mut a = *own;
    for d in (0..W).rev() {
        for w in d + 1..W {
            a[d] -= diagonal[d][w] * a[w];
        }
        a[d] *= inverse[plan.begin[p] + d];
    }
    for (l, x) in left.iter().zip(before) {
        let mut sum = 0.0;
        for w in 0..W {
            sum += l[w] * a[w];
        }
        *x -= sum;
    }
    *own = a;
}

/// Substitution with several right-hand sides.
pub(super) struct Lanes<'a> {
    pub(super) plan: &'a EnvelopePlan,
    pub(super) numbers: &'a [f64],
    pub(super) inverse: &'a [f64],
    pub(super) work: &'a mut [f64],
    pub(super) b: &'a mut [f64],
    pub(super) k: usize,
}

impl LaneKernel for Lanes<'_> {
    #[inline(always)]
    fn run<const K: usize>(&mut self, from: usize) {
        let plan = self.plan;
        let (x, _) = self.work[..plan.n() * K].as_chunks_mut::<K>();
        for (x, &row) in x.iter_mut().zip(&plan.row_at) {
            *x = *lanes(self.b, self.k, row, from);
        }
        for p in 0..plan.order.len() {
            let (start, begin, end) = (plan.begin[plan.first[p]], plan.begin[p], plan.begin[p + 1]);
            let rows = end - begin;
            let numbers = &self.numbers[plan.offset[p]..];
            for r in 0..rows {
                let mut a = x[begin + r];
                for c in start..begin + r {
                    let l = numbers[(c - start) * rows + r];
                    for w in 0..K {
                        a[w] -= l * x[c][w];
                    }
                }
                x[begin + r] = a.map(|a| a * self.inverse[begin + r]);
            }
        }
        for p in (0..plan.order.len()).rev() {
            let (start, begin, end) = (plan.begin[plan.first[p]], plan.begin[p], plan.begin[p + 1]);
            let rows = end - begin;
            let numbers = &self.numbers[plan.offset[p]..];
            for r in (0..rows).rev() {
                let a = x[begin + r].map(|a| a * self.inverse[begin + r]);
                x[begin + r] = a;
                for c in start..begin + r {
                    let l = numbers[(c - start) * rows + r];
                    for w in 0..K {
                        x[c][w] -= l * a[w];
                    }
                }
            }
        }
        for (x, &row) in x.iter().zip(&plan.row_at) {
            *lanes_mut(self.b, self.k, row, from) = *x;
        }
    }
}
