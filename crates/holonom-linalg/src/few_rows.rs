//! LU factors of the smallest matrices, by loops whose lengths the compiler knows: a loop of a mechanism has a few rows,
//! and is closed several times in each evaluation.

use crate::dense::NEGLIGIBLE;
use crate::lanes::{lanes, lanes_mut};

/// What a kernel for the size `$n` returns; none where there is none of it.
macro_rules! by_size {
    ($n:expr, $kernel:ident($($argument:expr),*)) => {
        match $n {
            1 => Some($kernel::<1>($($argument),*)),
            2 => Some($kernel::<2>($($argument),*)),
            3 => Some($kernel::<3>($($argument),*)),
            4 => Some($kernel::<4>($($argument),*)),
            5 => Some($kernel::<5>($($argument),*)),
            6 => Some($kernel::<6>($($argument),*)),
            7 => Some($kernel::<7>($($argument),*)),
            8 => Some($kernel::<8>($($argument),*)),
            _ => None,
        }
    };
}

/// Factors by columns, L without its unit diagonal and U, of a matrix by columns; tells which row each pivot came from and
/// which row each one was exchanged with, and inverts the diagonal of U. The first pivot that is cancellation noise or no
/// number is an error. None, and nothing is done, where the matrix is too large.
pub(crate) fn eliminate(
    a: &mut [f64],
    permutation: &mut [usize],
    exchanges: &mut [usize],
    inverses: &mut [f64],
) -> Option<Result<(), usize>> {
    by_size!(permutation.len(), eliminate_of(a, permutation, exchanges, inverses))
}

/// Solves with Uᵀ and Lᵀ of such factors and puts entries where their pivots came from; `inverses` are those of the diagonal.
pub(crate) fn solve(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) -> Option<()> {
    by_size!(b.len(), solve_of(factors, inverses, permutation, b))
}

/// The same for all columns of `b`, by rows.
pub(crate) fn solve_many(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) -> Option<()> {
    by_size!(inverses.len(), solve_many_of(factors, inverses, permutation, b))
}

/// Takes entries from where their pivots came from and solves with L and U.
pub(crate) fn solve_transposed(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) -> Option<()> {
    by_size!(b.len(), solve_transposed_of(factors, inverses, permutation, b))
}

fn eliminate_of<const N: usize>(
    a: &mut [f64],
    permutation: &mut [usize],
    exchanges: &mut [usize],
    inverses: &mut [f64],
) -> Result<(), usize> {
    let (columns, _) = a.as_chunks_mut::<N>();
    let columns: &mut [[f64; N]; N] = columns.try_into().expect("a square matrix");
    let permutation: &mut [usize; N] = permutation.try_into().expect("as many rows");
    let exchanges: &mut [usize; N] = exchanges.try_into().expect("as many rows");
    let inverses: &mut [f64; N] = inverses.try_into().expect("as many pivots");
    *permutation = std::array::from_fn(|p| p);
    for p in 0..N {
        let mut at = p;
        for i in p + 1..N {
            if columns[p][i].abs() > columns[p][at].abs() {
                at = i;
            }
        }
        exchanges[p] = at;
        if at != p {
            permutation.swap(p, at);
            columns.iter_mut().for_each(|column| column.swap(p, at));
        }
        inverses[p] = columns[p][p].recip();
        for i in p + 1..N {
            columns[p][i] *= inverses[p];
        }
        let lower = columns[p];
        for column in &mut columns[p + 1..] {
            let factor = column[p];
            for i in p + 1..N {
                column[i] -= factor * lower[i];
            }
        }
    }
    // Column p of U is what is left of row p of the transposed matrix.
    for (p, column) in columns.iter().enumerate() {
        let (mut peak, mut is_finite) = (0.0f64, true);
        for u in &column[..=p] {
            peak = peak.max(u.abs());
            is_finite &= u.is_finite();
        }
        if !(is_finite && column[p].abs() > NEGLIGIBLE * peak) {
            return Err(p);
        }
    }
    Ok(())
}

fn solve_of<const N: usize>(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) {
    let (columns, _) = factors.as_chunks::<N>();
    let columns: &[[f64; N]; N] = columns.try_into().expect("a square matrix");
    let inverses: &[f64; N] = inverses.try_into().expect("as many pivots");
    let permutation: &[usize; N] = permutation.try_into().expect("as many rows");
    let b: &mut [f64; N] = b.try_into().expect("as many right-hand sides");
    let mut x = *b;
    for i in 0..N {
        for j in 0..i {
            x[i] -= columns[i][j] * x[j];
        }
        x[i] *= inverses[i];
    }
    for i in (0..N).rev() {
        for j in i + 1..N {
            x[i] -= columns[i][j] * x[j];
        }
    }
    for (x, &at) in x.iter().zip(permutation) {
        b[at] = *x;
    }
}

fn solve_many_of<const N: usize>(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) {
    let k = b.len() / N;
    for from in (0..k & !1).step_by(2) {
        solve_columns::<N, 2>(factors, inverses, permutation, b, k, from);
    }
    if k % 2 == 1 {
        solve_columns::<N, 1>(factors, inverses, permutation, b, k, k - 1);
    }
}

/// L columns of k from this one on.
#[inline(always)]
fn solve_columns<const N: usize, const L: usize>(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
    k: usize,
    from: usize,
) {
    let (columns, _) = factors.as_chunks::<N>();
    let columns: &[[f64; N]; N] = columns.try_into().expect("a square matrix");
    let inverses: &[f64; N] = inverses.try_into().expect("as many pivots");
    let permutation: &[usize; N] = permutation.try_into().expect("as many rows");
    let mut x: [[f64; L]; N] = std::array::from_fn(|i| *lanes(b, k, i, from));
    for i in 0..N {
        for j in 0..i {
            for l in 0..L {
                x[i][l] -= columns[i][j] * x[j][l];
            }
        }
        x[i] = x[i].map(|x| x * inverses[i]);
    }
    for i in (0..N).rev() {
        for j in i + 1..N {
            for l in 0..L {
                x[i][l] -= columns[i][j] * x[j][l];
            }
        }
    }
    for (x, &at) in x.iter().zip(permutation) {
        *lanes_mut(b, k, at, from) = *x;
    }
}

fn solve_transposed_of<const N: usize>(
    factors: &[f64],
    inverses: &[f64],
    permutation: &[usize],
    b: &mut [f64],
) {
    let (columns, _) = factors.as_chunks::<N>();
    let columns: &[[f64; N]; N] = columns.try_into().expect("a square matrix");
    let inverses: &[f64; N] = inverses.try_into().expect("as many pivots");
    let permutation: &[usize; N] = permutation.try_into().expect("as many rows");
    let b: &mut [f64; N] = b.try_into().expect("as many right-hand sides");
    let mut x = permutation.map(|at| b[at]);
    for i in 0..N {
        for j in i + 1..N {
            x[j] -= columns[i][j] * x[i];
        }
    }
    for i in (0..N).rev() {
        x[i] *= inverses[i];
        for j in 0..i {
            x[j] -= columns[i][j] * x[i];
        }
    }
    *b = x;
}
