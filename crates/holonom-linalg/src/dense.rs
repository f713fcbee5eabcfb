use std::mem::MaybeUninit;

use faer::dyn_stack::{MemStack, StackReq};
use faer::linalg::cholesky::llt::factor as llt;
use faer::linalg::lu::partial_pivoting::factor as lu;
use faer::linalg::triangular_solve;
use faer::{MatMut, MatRef, Par, Spec};

use crate::error::{NotPositiveDefinite, SingularMatrix};
use crate::few_rows;
use crate::gram::gram_add;
use crate::lanes::{Arithmetic, Wide, dot, run_wide};

/// A pivot below this fraction of the numbers it is made of is cancellation noise.
pub(crate) const NEGLIGIBLE: f64 = 32.0 * f64::EPSILON;

/// Up to this size a plain elimination takes less time than the way into the library.
const SMALL: usize = 32;

/// LU factorisation with pivoting of a dense n×n matrix; its storage is reused.
///
/// A matrix by rows is its transpose by columns, so it is Aᵀ that is factored, P Aᵀ = L U, and
/// pivots are exchanged among the columns of A.
#[derive(Debug, Clone)]
pub struct DenseLu {
    n: usize,
    /// L without its unit diagonal and U, by columns.
    factors: Vec<f64>,
    /// Of the diagonal of U.
    inverses: Vec<f64>,
    permutation: Vec<usize>,
    inverse_permutation: Vec<usize>,
    /// The permutation as exchanges of position p with `exchanges[p] ≥ p`, in order.
    exchanges: Vec<usize>,
    scratch: Vec<MaybeUninit<u8>>,
}

impl DenseLu {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        make_product_buffer();
        let need = lu::lu_in_place_scratch::<usize, f64>(n, n, Par::Seq, Spec::default());
        Self {
            n,
            factors: vec![0.0; n * n],
            inverses: vec![0.0; n],
            permutation: vec![0; n],
            inverse_permutation: vec![0; n],
            exchanges: vec![0; n],
            scratch: room(need),
        }
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Factors `a` (n×n by rows).
    ///
    /// # Errors
    /// [`SingularMatrix`] at the first pivot that does not exceed round-off or is not finite. The
    /// factors must not be used then.
    ///
    /// # Panics
    /// If `a` has not n² entries.
    pub fn factor(&mut self, a: &[f64]) -> Result<(), SingularMatrix> {
        let n = self.n;
        self.factors.copy_from_slice(a);
        let (factors, permutation) = (&mut self.factors, &mut self.permutation);
        let few =
            few_rows::eliminate(factors, permutation, &mut self.exchanges, &mut self.inverses);
        if let Some(outcome) = few {
            return outcome.map_err(|row| {
                let (column, pivot) = (permutation[row], factors[row * n + row]);
                SingularMatrix { row, column, pivot }
            });
        }
        if n <= SMALL {
            run_wide(Elimination { a: factors, permutation });
        } else {
            lu::lu_in_place(
                MatMut::from_column_major_slice_mut(factors, n, n),
                permutation,
                &mut self.inverse_permutation,
                Par::Seq,
                MemStack::new(&mut self.scratch),
                Spec::default(),
            );
        }
        for p in 0..n {
            // Column p of U: what is left of row p of A.
            let column = &self.factors[p * n..=p * n + p];
            // Sizes are in the order of their bits, and above all is what is no number.
            let peak = column.iter().fold(0, |m: u64, u| m.max(u.abs().to_bits()));
            let peak = f64::from_bits(peak);
            if !(column[p].abs() > NEGLIGIBLE * peak && peak.is_finite()) {
                let column_of_a = self.permutation[p];
                return Err(SingularMatrix { row: p, column: column_of_a, pivot: column[p] });
            }
            self.inverses[p] = column[p].recip();
        }
        // From here on the inverse permutation keeps track of where each entry has gone.
        let (place, entry_at) = (&mut self.inverse_permutation, &mut self.exchanges);
        for p in 0..n {
            place[p] = p;
            entry_at[p] = p;
        }
        for p in 0..n {
            let from = place[self.permutation[p]];
            let moved = entry_at[p];
            entry_at[from] = moved;
            place[moved] = from;
            entry_at[p] = from; // position p is settled: its room holds the exchange
        }
        Ok(())
    }

    /// Takes over the factors of another matrix of as many rows.
    ///
    /// # Panics
    /// If it has not as many.
    pub fn copy_from(&mut self, other: &Self) {
        self.factors.copy_from_slice(&other.factors);
        self.inverses.copy_from_slice(&other.inverses);
        self.permutation.copy_from_slice(&other.permutation);
        self.inverse_permutation.copy_from_slice(&other.inverse_permutation);
        self.exchanges.copy_from_slice(&other.exchanges);
    }

    /// Sign of det A of the matrix last factored.
    pub fn determinant_sign(&self) -> f64 {
        let exchanged = self.exchanges.iter().enumerate().filter(|(p, from)| p != *from).count();
        let pivots = (0..self.n).map(|k| self.factors[k * self.n + k].signum());
        pivots.fold(if exchanged % 2 == 0 { 1.0 } else { -1.0 }, |sign, pivot| sign * pivot)
    }

    /// Solves A x = b in place.
    ///
    /// # Panics
    /// If `b` has not n entries.
    pub fn solve(&self, b: &mut [f64]) {
        let n = self.n;
        assert_eq!(b.len(), n, "right-hand side of a matrix of {n} rows");
        if few_rows::solve(&self.factors, &self.inverses, &self.permutation, b).is_some() {
            return;
        }
        run_wide(Substitution { factors: &self.factors, inverses: &self.inverses, b: &mut *b });
        for p in (0..n).rev() {
            b.swap(p, self.exchanges[p]);
        }
    }

    /// Solves A X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&self, b: &mut [f64], k: usize) {
        if k == 1 {
            return self.solve(b);
        }
        let n = self.n;
        assert_eq!(b.len(), n * k, "right-hand sides have as many rows as the matrix");
        if few_rows::solve_many(&self.factors, &self.inverses, &self.permutation, b).is_some() {
            return;
        }
        if n <= SMALL && k > 0 {
            for i in 0..n {
                let (known, rest) = b.split_at_mut(i * k);
                let own = &mut rest[..k];
                let row = &self.factors[i * n..i * n + i];
                for (x, known) in row.iter().zip(known.chunks_exact(k)) {
                    subtract(own, *x, known);
                }
                own.iter_mut().for_each(|x| *x *= self.inverses[i]);
            }
            for i in (0..n).rev() {
                let (rest, known) = b.split_at_mut((i + 1) * k);
                let own = &mut rest[i * k..];
                let row = &self.factors[i * n + i + 1..(i + 1) * n];
                for (x, known) in row.iter().zip(known.chunks_exact(k)) {
                    subtract(own, *x, known);
                }
            }
        } else {
            let factors = MatRef::from_column_major_slice(&self.factors, n, n).transpose();
            let mut x = MatMut::from_row_major_slice_mut(&mut *b, n, k);
            triangular_solve::solve_lower_triangular_in_place(factors, x.as_mut(), Par::Seq);
            triangular_solve::solve_unit_upper_triangular_in_place(factors, x, Par::Seq);
        }
        for p in (0..n).rev() {
            swap_rows(b, k, p, self.exchanges[p]);
        }
    }

    /// Solves Aᵀ x = b in place.
    ///
    /// # Panics
    /// If `b` has not n entries.
    pub fn solve_transposed(&self, b: &mut [f64]) {
        let n = self.n;
        assert_eq!(b.len(), n, "right-hand side of a matrix of {n} rows");
        if few_rows::solve_transposed(&self.factors, &self.inverses, &self.permutation, b).is_some()
        {
            return;
        }
        for p in 0..n {
            b.swap(p, self.exchanges[p]);
        }
        // Columns of L, then of U.
        for i in 0..n {
            let (known, rest) = b.split_at_mut(i + 1);
            subtract(rest, known[i], &self.factors[i * n + i + 1..(i + 1) * n]);
        }
        for i in (0..n).rev() {
            let (rest, known) = b.split_at_mut(i);
            known[0] *= self.inverses[i];
            subtract(rest, known[0], &self.factors[i * n..i * n + i]);
        }
    }

    /// Solves Aᵀ X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_transposed_many(&self, b: &mut [f64], k: usize) {
        if k == 1 {
            return self.solve_transposed(b);
        }
        let n = self.n;
        assert_eq!(b.len(), n * k, "right-hand sides of a matrix of {n} rows");
        for p in 0..n {
            swap_rows(b, k, p, self.exchanges[p]);
        }
        let factors = MatRef::from_column_major_slice(&self.factors, n, n);
        let mut x = MatMut::from_row_major_slice_mut(b, n, k);
        triangular_solve::solve_unit_lower_triangular_in_place(factors, x.as_mut(), Par::Seq);
        triangular_solve::solve_upper_triangular_in_place(factors, x, Par::Seq);
    }
}

/// Factors a matrix by columns and tells which row each pivot came from.
struct Elimination<'a> {
    a: &'a mut [f64],
    permutation: &'a mut [usize],
}

impl Wide for Elimination<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { a, permutation } = self;
        let n = permutation.len();
        (0..n).for_each(|p| permutation[p] = p);
        for p in 0..n {
            let column = &a[p * n..(p + 1) * n];
            let (mut at, mut largest) = (p, column[p].abs());
            for i in p + 1..n {
                if column[i].abs() > largest {
                    (at, largest) = (i, column[i].abs());
                }
            }
            if at != p {
                permutation.swap(p, at);
                for column in a.chunks_exact_mut(n) {
                    column.swap(p, at);
                }
            }
            let (known, rest) = a.split_at_mut((p + 1) * n);
            let lower = &mut known[p * n + p..];
            let inverse = lower[0].recip();
            for x in &mut lower[1..] {
                *x *= inverse;
            }
            for column in rest.chunks_exact_mut(n) {
                let factor = column[p];
                // Branches of a tree have nothing to do with each other.
                if factor != 0.0 {
                    subtract_by_fours::<A>(&mut column[p + 1..], factor, &lower[1..]);
                }
            }
        }
    }
}

/// out −= factor · x, by fours, as both are short.
#[inline(always)]
fn subtract_by_fours<A: Arithmetic>(out: &mut [f64], factor: f64, x: &[f64]) {
    let (fours, last) = x.as_chunks::<4>();
    let (out_fours, out_last) = out.as_chunks_mut::<4>();
    for (out, x) in out_fours.iter_mut().zip(fours) {
        for l in 0..4 {
            out[l] = A::multiply_add(-factor, x[l], out[l]);
        }
    }
    for (out, x) in out_last.iter_mut().zip(last) {
        *out = A::multiply_add(-factor, *x, *out);
    }
}

/// Factor of a symmetric matrix whose lower triangle is given by columns; returns how many pivots are positive. Each column
/// takes what those before it leave of it, by fours: columns are short.
#[inline(always)]
fn eliminate_symmetric<A: Arithmetic>(a: &mut [f64], n: usize) -> usize {
    for p in 0..n {
        let (known, rest) = a.split_at_mut(p * n);
        let own = &mut rest[p..n];
        for column in known.chunks_exact(n) {
            let factor = column[p];
            // What hangs on other branches of a tree is zero.
            if factor != 0.0 {
                subtract_by_fours::<A>(own, factor, &column[p..]);
            }
        }
        if own[0].is_nan() || own[0] <= 0.0 {
            return p;
        }
        own[0] = own[0].sqrt();
        let inverse = own[0].recip();
        for x in &mut own[1..] {
            *x *= inverse;
        }
    }
    n
}

/// [`eliminate_symmetric`] with the widest vectors there are, and how many pivots it has `done`.
struct SymmetricElimination<'a> {
    a: &'a mut [f64],
    n: usize,
    done: &'a mut usize,
}

impl Wide for SymmetricElimination<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        *self.done = eliminate_symmetric::<A>(self.a, self.n);
    }
}

/// Solution with both factors of a matrix by rows.
struct Substitution<'a> {
    factors: &'a [f64],
    inverses: &'a [f64],
    b: &'a mut [f64],
}

impl Wide for Substitution<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { factors, inverses, b } = self;
        let n = b.len();
        for i in 0..n {
            let known = dot(&factors[i * n..i * n + i], &b[..i]);
            b[i] = (b[i] - known) * inverses[i];
        }
        for i in (0..n).rev() {
            b[i] -= dot(&factors[i * n + i + 1..(i + 1) * n], &b[i + 1..]);
        }
    }
}

/// y += α A x for a matrix by rows.
pub fn add_product(a: &[f64], alpha: f64, x: &[f64], y: &mut [f64]) {
    run_wide(Product { a, alpha, x, y });
}

struct Product<'a> {
    a: &'a [f64],
    alpha: f64,
    x: &'a [f64],
    y: &'a mut [f64],
}

impl Wide for Product<'_> {
    #[inline(always)]
    fn run<A: Arithmetic>(self) {
        let Self { a, alpha, x, y } = self;
        for (row, y) in a.chunks_exact(x.len().max(1)).zip(y) {
            *y += alpha * dot(row, x);
        }
    }
}

fn subtract(out: &mut [f64], factor: f64, x: &[f64]) {
    out.iter_mut().zip(x).for_each(|(out, x)| *out -= factor * x);
}

fn swap_rows(b: &mut [f64], k: usize, p: usize, q: usize) {
    if p != q {
        let (upper, lower) = b.split_at_mut(q * k);
        upper[p * k..(p + 1) * k].swap_with_slice(&mut lower[..k]);
    }
}

/// Cholesky factorisation A = L Lᵀ of a dense symmetric positive definite n×n matrix.
#[derive(Debug, Clone)]
pub struct Cholesky {
    n: usize,
    /// L by columns.
    factor: Vec<f64>,
    work: Vec<f64>,
    scratch: Vec<MaybeUninit<u8>>,
}

impl Cholesky {
    /// Room for an n×n matrix.
    pub fn new(n: usize) -> Self {
        make_product_buffer();
        let need = llt::cholesky_in_place_scratch::<f64>(n, Par::Seq, Spec::default());
        Self { n, factor: vec![0.0; n * n], work: vec![0.0; n], scratch: room(need) }
    }

    /// Number of rows and columns.
    pub fn n(&self) -> usize {
        self.n
    }

    /// Factors the symmetric matrix `a` (n×n by rows), of which only entries (i, j ≥ i) are read.
    ///
    /// # Errors
    /// [`NotPositiveDefinite`] at the first pivot that is not above round-off of its diagonal
    /// entry. The factor must not be used then.
    ///
    /// # Panics
    /// If `a` has not n² entries.
    pub fn factor(&mut self, a: &[f64]) -> Result<(), NotPositiveDefinite> {
        let n = self.n;
        self.factor.copy_from_slice(a);
        let done = if n <= SMALL {
            let mut done = 0;
            run_wide(SymmetricElimination { a: &mut self.factor, n, done: &mut done });
            done
        } else {
            let outcome = llt::cholesky_in_place(
                MatMut::from_column_major_slice_mut(&mut self.factor, n, n),
                llt::LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.scratch),
                Spec::default(),
            );
            outcome.map_or_else(|llt::LltError::NonPositivePivot { index }| index, |_| n)
        };
        for i in 0..done {
            let pivot = self.factor[i * n + i].powi(2);
            // Written so that a NaN fails.
            let good = pivot > NEGLIGIBLE * a[i * n + i] && pivot.is_finite();
            if !good {
                return Err(NotPositiveDefinite { index: i, pivot });
            }
        }
        if done < n {
            return Err(NotPositiveDefinite { index: done, pivot: self.pivot_after(done, a) });
        }
        Ok(())
    }

    /// What elimination with the first `p` rows leaves of the diagonal entry of row `p`.
    fn pivot_after(&mut self, p: usize, a: &[f64]) -> f64 {
        let n = self.n;
        let mut pivot = a[p * n + p];
        for i in 0..p {
            // Row p of L, by columns of L.
            let mut l = a[i * n + p];
            for j in 0..i {
                l -= self.factor[j * n + i] * self.work[j];
            }
            self.work[i] = l / self.factor[i * n + i];
            pivot -= self.work[i] * self.work[i];
        }
        pivot
    }

    /// Solves A x = b in place.
    ///
    /// # Panics
    /// If `b` has not n entries.
    pub fn solve(&self, b: &mut [f64]) {
        self.solve_many(b, 1);
    }

    /// Solves A X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_many(&self, b: &mut [f64], k: usize) {
        self.solve_lower(b, k);
        self.solve_upper(b, k);
    }

    /// Solves L X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_lower(&self, b: &mut [f64], k: usize) {
        let n = self.n;
        if k == 1 && n <= SMALL {
            for p in 0..n {
                let (known, rest) = b.split_at_mut(p + 1);
                known[p] /= self.factor[p * n + p];
                subtract(rest, known[p], &self.factor[p * n + p + 1..(p + 1) * n]);
            }
            return;
        }
        let l = MatRef::from_column_major_slice(&self.factor, self.n, self.n);
        let x = MatMut::from_row_major_slice_mut(b, self.n, k);
        triangular_solve::solve_lower_triangular_in_place(l, x, Par::Seq);
    }

    /// Solves Lᵀ X = B in place; `b` is n×k by rows.
    ///
    /// # Panics
    /// If `b` has not n·k entries.
    pub fn solve_upper(&self, b: &mut [f64], k: usize) {
        let n = self.n;
        if k == 1 && n <= SMALL {
            for p in (0..n).rev() {
                let column = &self.factor[p * n + p..(p + 1) * n];
                b[p] = (b[p] - dot(&column[1..], &b[p + 1..])) / column[0];
            }
            return;
        }
        let l = MatRef::from_column_major_slice(&self.factor, self.n, self.n);
        let x = MatMut::from_row_major_slice_mut(b, self.n, k);
        triangular_solve::solve_upper_triangular_in_place(l.transpose(), x, Par::Seq);
    }
}

/// Scratch memory of that size.
fn room(need: StackReq) -> Vec<MaybeUninit<u8>> {
    vec![MaybeUninit::uninit(); need.unaligned_bytes_required()]
}

/// Lets faer make the buffer of its matrix product, one for each thread, which it does at the first
/// product of some size; set-up is the time for it. (Without AVX2 it makes one at each product.)
fn make_product_buffer() {
    let n = 32;
    let a = vec![0.0; n * n];
    gram_add(n, n, &a, &a, &mut vec![0.0; n * n]);
}
