//! H Hᵀ, H y and Hᵀλ by the bodies of joints, for each number of rows of a joint.

/// One body of a joint. Its part of H is stored by columns: the rows of a joint lie side by side.
#[derive(Debug, Clone, Copy)]
pub(super) struct Side {
    pub(super) body: usize,
    /// Reduced rows of the joint.
    pub(super) begin: usize,
    pub(super) rows: usize,
    /// Rows of H before these.
    pub(super) h: usize,
}

/// What two joints, or one with itself, have from a body they share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Product {
    /// Rows of H before those of the earlier and of the later joint.
    pub(super) left: u32,
    pub(super) right: u32,
    pub(super) rows: u16,
    pub(super) columns: u16,
    /// First value of the block, and how far its rows are apart.
    pub(super) target: u32,
    pub(super) stride: u32,
    pub(super) diagonal: bool,
    /// Nothing is there yet.
    pub(super) first: bool,
}

/// Calls a function that is generic over the rows of a joint.
macro_rules! by_rows {
    ($rows:expr, $function:ident $(::<$($own:tt),*>)? ($($argument:expr),*)) => {
        match $rows {
            1 => $function::<$($($own,)*)? 1>($($argument),*),
            2 => $function::<$($($own,)*)? 2>($($argument),*),
            3 => $function::<$($($own,)*)? 3>($($argument),*),
            4 => $function::<$($($own,)*)? 4>($($argument),*),
            5 => $function::<$($($own,)*)? 5>($($argument),*),
            _ => $function::<$($($own,)*)? 6>($($argument),*),
        }
    };
}
pub(super) use by_rows;

/// D columns of W rows of H.
#[inline(always)]
fn part<const D: usize, const W: usize>(h: &[f64], rows_before: usize) -> &[[f64; W]; D] {
    let (columns, _) = h[rows_before * D..][..D * W].as_chunks::<W>();
    columns.first_chunk().expect("the columns of H")
}

/// To be written.
#[inline(always)]
pub(super) fn part_mut<const D: usize, const W: usize>(
    h: &mut [f64],
    rows_before: usize,
) -> &mut [[f64; W]; D] {
    let (columns, _) = h[rows_before * D..][..D * W].as_chunks_mut::<W>();
    columns.first_chunk_mut().expect("the columns of H")
}

/// H Hᵀ by blocks.
pub(super) fn multiply<const D: usize>(products: &[Product], h: &[f64], values: &mut [f64]) {
    for p in products {
        by_rows!(p.columns, multiply_columns::<D>(p, h, values));
    }
}

#[inline(always)]
fn multiply_columns<const D: usize, const W: usize>(p: &Product, h: &[f64], values: &mut [f64]) {
    by_rows!(p.rows, multiply_block::<D, W>(p, h, values));
}

#[inline(always)]
fn multiply_block<const D: usize, const W: usize, const R: usize>(
    p: &Product,
    h: &[f64],
    values: &mut [f64],
) {
    let left = part::<D, R>(h, p.left as usize);
    let right = part::<D, W>(h, p.right as usize);
    let values = &mut values[p.target as usize..];
    for r in 0..R {
        let line: &mut [f64; W] =
            values[r * p.stride as usize..].first_chunk_mut().expect("a row of the block");
        let mut sum = if p.first { [0.0; W] } else { *line };
        for d in 0..D {
            for w in 0..W {
                sum[w] += left[d][r] * right[d][w];
            }
        }
        *line = sum;
    }
}

/// b += H y.
pub(super) fn add_products<const D: usize>(sides: &[Side], h: &[f64], y: &[f64], b: &mut [f64]) {
    let (y, _) = y.as_chunks::<D>();
    for side in sides {
        by_rows!(side.rows, add_product::<D>(side, h, &y[side.body], b));
    }
}

#[inline(always)]
fn add_product<const D: usize, const W: usize>(
    side: &Side,
    h: &[f64],
    y: &[f64; D],
    b: &mut [f64],
) {
    let h = part::<D, W>(h, side.h);
    let b: &mut [f64; W] = b[side.begin..].first_chunk_mut().expect("the rows of the joint");
    for d in 0..D {
        for w in 0..W {
            b[w] += h[d][w] * y[d];
        }
    }
}

/// y −= Hᵀ λ.
pub(super) fn subtract_reactions<const D: usize>(
    sides: &[Side],
    h: &[f64],
    lambda: &[f64],
    y: &mut [f64],
) {
    let (y, _) = y.as_chunks_mut::<D>();
    for side in sides {
        by_rows!(side.rows, subtract_reaction::<D>(side, h, lambda, &mut y[side.body]));
    }
}

#[inline(always)]
fn subtract_reaction<const D: usize, const W: usize>(
    side: &Side,
    h: &[f64],
    lambda: &[f64],
    y: &mut [f64; D],
) {
    let h = part::<D, W>(h, side.h);
    let lambda: &[f64; W] = lambda[side.begin..].first_chunk().expect("the rows of the joint");
    for d in 0..D {
        for w in 0..W {
            y[d] -= h[d][w] * lambda[w];
        }
    }
}
