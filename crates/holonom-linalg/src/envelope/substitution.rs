//! Forward and backward substitution with an envelope factor.

use super::plan::Line;
use super::{EnvelopePlan, by_rows};
use crate::lanes::{Arithmetic, LaneKernel, lanes, lanes_mut};

/// L D Lᵀ x = b in place, in the order of the plan; what [`forward`] does may have been done.
pub(super) struct SolveOne<'a> {
    pub(super) plan: &'a EnvelopePlan,
    pub(super) numbers: &'a [f64],
    pub(super) inverse: &'a [f64],
    pub(super) x: &'a mut [f64],
    pub(super) forward: bool,
}

impl pulp::WithSimd for SolveOne<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let Self { plan, numbers, inverse, x, .. } = self;
        if self.forward {
            for line in &plan.lines {
                by_rows!(line.rows, forward(line, numbers, x));
            }
        }
        for (x, inverse) in x.iter_mut().zip(inverse) {
            *x *= inverse;
        }
        for line in plan.lines.iter().rev() {
            by_rows!(line.rows, backward(line, numbers, x));
        }
    }
}

/// What a block row takes part in: its columns left of the diagonal and in the diagonal block, and of a vector the
/// part before it in its envelope, and its own.
#[inline(always)]
fn parts<'a, const W: usize>(
    line: &Line,
    numbers: &'a [f64],
    x: &'a mut [f64],
) -> (&'a [[f64; W]], &'a [[f64; W]; W], &'a mut [f64], &'a mut [f64; W]) {
    let (row, _) = numbers[line.values()].as_chunks::<W>();
    let (left, diagonal) = row.split_last_chunk().expect("a diagonal block");
    let (before, own) = x[line.start..].split_at_mut(line.left());
    (left, diagonal, before, own.first_chunk_mut().expect("the rows of the block"))
}

#[inline(always)]
fn forward<const W: usize>(line: &Line, numbers: &[f64], x: &mut [f64]) {
    let (left, diagonal, before, own) = parts::<W>(line, numbers, x);
    let mut a = *own;
    for (l, x) in left.iter().zip(before) {
        for w in 0..W {
            a[w] -= l[w] * *x;
        }
    }
    *own = within(diagonal, a);
}

/// Forward substitution within a diagonal block.
#[inline(always)]
pub(super) fn within<const W: usize>(diagonal: &[[f64; W]; W], mut a: [f64; W]) -> [f64; W] {
    for d in 0..W {
        for w in d + 1..W {
            a[w] -= diagonal[d][w] * a[d];
        }
    }
    a
}

#[inline(always)]
fn backward<const W: usize>(line: &Line, numbers: &[f64], x: &mut [f64]) {
    let (left, diagonal, before, own) = parts::<W>(line, numbers, x);
    let mut a = *own;
    for d in (0..W).rev() {
        for w in (d + 1..W).rev() {
            a[d] -= diagonal[d][w] * a[w];
        }
    }
    // What is known first is subtracted first.
    for (l, x) in left.iter().zip(before) {
        for w in (0..W).rev() {
            *x -= l[w] * a[w];
        }
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
    fn run<A: Arithmetic, const K: usize>(&mut self, from: usize) {
        let plan = self.plan;
        let (x, _) = self.work[..plan.n() * K].as_chunks_mut::<K>();
        for (x, &row) in x.iter_mut().zip(&plan.row_at) {
            *x = *lanes(self.b, self.k, row, from);
        }
        for line in &plan.lines {
            let numbers = &self.numbers[line.offset..];
            for r in 0..line.rows {
                let mut a = x[line.begin + r];
                for c in line.start..line.begin + r {
                    let l = numbers[(c - line.start) * line.rows + r];
                    for w in 0..K {
                        a[w] = A::multiply_add(-l, x[c][w], a[w]);
                    }
                }
                x[line.begin + r] = a;
            }
        }
        for (x, inverse) in x.iter_mut().zip(self.inverse) {
            *x = x.map(|x| x * inverse);
        }
        for line in plan.lines.iter().rev() {
            let numbers = &self.numbers[line.offset..];
            for r in (0..line.rows).rev() {
                let a = x[line.begin + r];
                for c in line.start..line.begin + r {
                    let l = numbers[(c - line.start) * line.rows + r];
                    for w in 0..K {
                        x[c][w] = A::multiply_add(-l, a[w], x[c][w]);
                    }
                }
            }
        }
        for (x, &row) in x.iter().zip(&plan.row_at) {
            *lanes_mut(self.b, self.k, row, from) = *x;
        }
    }
}
