//! Blocks of four numbers of each of `W` systems.

use super::plan::BLOCK;
use crate::error::NotPositiveDefinite;
use crate::lanes::Arithmetic;
use std::array;

/// Pivots below this part of their diagonal entry are round-off.
const NEGLIGIBLE: f64 = 16.0 * f64::EPSILON;

/// Numbers of `W` systems of one topology side by side.
pub(super) type Lanes<const W: usize> = [f64; W];

/// Four numbers of each system that stand side by side in a row or column; a loop over them becomes vector
/// instructions, along the row for one system.
pub(super) type Block<const W: usize> = [Lanes<W>; BLOCK];

/// Four rows of four numbers.
pub(super) type Tile<const W: usize> = [Block<W>; BLOCK];

/// Inverses of a pivot and of its root.
pub(super) struct Pivot<const W: usize> {
    pub inverse: Lanes<W>,
    pub root: Lanes<W>,
}

#[inline(always)]
pub(super) fn pivot<const W: usize>(
    pivot: &Lanes<W>,
    given: &Lanes<W>,
    index: usize,
) -> Result<Pivot<W>, NotPositiveDefinite> {
    for (&pivot, given) in pivot.iter().zip(given) {
        // Written so that a NaN fails; the inverse of what is not normal may overflow.
        let good = pivot > NEGLIGIBLE * given && pivot.is_normal();
        if !good {
            return Err(NotPositiveDefinite { index, pivot });
        }
    }
    let inverse = pivot.map(|x| 1.0 / x);
    // Root and inverse do not wait for each other.
    let root = array::from_fn(|w| pivot[w].sqrt() * inverse[w]);
    Ok(Pivot { inverse, root })
}

/// What a block of an eliminated column changes in blocks of the coordinates above.
#[inline(always)]
pub(super) fn spread<A: Arithmetic, const W: usize>(
    targets: &mut [Block<W>],
    factors: &[Lanes<W>],
    block: Block<W>,
) {
    // By fours, or the compiler would gather the first numbers of four blocks, the second ones, and so on.
    let (tiles, rest) = targets.as_chunks_mut::<BLOCK>();
    let (fours, others) = factors.as_chunks::<BLOCK>();
    for (tile, four) in tiles.iter_mut().zip(fours) {
        for k in 0..BLOCK {
            subtract_scaled::<A, W>(&mut tile[k], &four[k], &block);
        }
    }
    for (x, factor) in rest.iter_mut().zip(others) {
        subtract_scaled::<A, W>(x, factor, &block);
    }
}

#[inline(always)]
pub(super) fn take<const W: usize>(x: &mut Block<W>) -> Block<W> {
    std::mem::replace(x, [[0.0; W]; BLOCK])
}

#[inline(always)]
pub(super) fn sum<const W: usize>(x: &Block<W>, y: &Block<W>) -> Block<W> {
    array::from_fn(|i| array::from_fn(|w| x[i][w] + y[i][w]))
}

#[inline(always)]
pub(super) fn scaled<const W: usize>(x: &Block<W>, factor: &Lanes<W>) -> Block<W> {
    array::from_fn(|i| array::from_fn(|w| x[i][w] * factor[w]))
}

#[inline(always)]
pub(super) fn add_scaled<A: Arithmetic, const W: usize>(
    x: &mut Block<W>,
    factor: &Lanes<W>,
    y: &Block<W>,
) {
    for i in 0..BLOCK {
        for w in 0..W {
            x[i][w] = A::multiply_add(factor[w], y[i][w], x[i][w]);
        }
    }
}

#[inline(always)]
pub(super) fn subtract_scaled<A: Arithmetic, const W: usize>(
    x: &mut Block<W>,
    factor: &Lanes<W>,
    y: &Block<W>,
) {
    for i in 0..BLOCK {
        subtract_product::<A, W>(&mut x[i], factor, &y[i]);
    }
}

#[inline(always)]
pub(super) fn add_products<A: Arithmetic, const W: usize>(
    sum: &mut Block<W>,
    x: &Block<W>,
    y: &Block<W>,
) {
    for i in 0..BLOCK {
        for w in 0..W {
            sum[i][w] = A::multiply_add(x[i][w], y[i][w], sum[i][w]);
        }
    }
}

#[inline(always)]
pub(super) fn subtract_sum<const W: usize>(x: &mut Lanes<W>, block: &Block<W>) {
    for w in 0..W {
        x[w] -= (block[0][w] + block[1][w]) + (block[2][w] + block[3][w]);
    }
}

#[inline(always)]
pub(super) fn multiply<const W: usize>(x: &mut Lanes<W>, y: &Lanes<W>) {
    for w in 0..W {
        x[w] *= y[w];
    }
}

#[inline(always)]
pub(super) fn subtract_product<A: Arithmetic, const W: usize>(
    x: &mut Lanes<W>,
    a: &Lanes<W>,
    b: &Lanes<W>,
) {
    for w in 0..W {
        x[w] = A::multiply_add(-a[w], b[w], x[w]);
    }
}
