//! Kernels over several right-hand sides at a time.
//!
//! The numbers of one row for `W` right-hand sides lie side by side, so that a loop over `W`
//! becomes vector instructions.

/// How this processor multiplies and adds.
pub trait Arithmetic {
    /// a b + c, rounded once where the processor has an instruction for that.
    fn multiply_add(a: f64, b: f64, c: f64) -> f64;
}

impl<S: pulp::Simd> Arithmetic for S {
    #[inline(always)]
    fn multiply_add(a: f64, b: f64, c: f64) -> f64 {
        // Without such an instruction a function would be called.
        if S::IS_SCALAR { a * b + c } else { a.mul_add(b, c) }
    }
}

/// That of any processor, for what is not compiled anew for the one at hand.
pub(crate) type Plain = pulp::Scalar;

/// A kernel for columns `from..from + W` of its right-hand sides.
pub(crate) trait LaneKernel {
    fn run<A: Arithmetic, const W: usize>(&mut self, from: usize);
}

/// Most columns that are taken together.
pub(crate) const MOST_LANES: usize = 24;

/// Runs the kernel over `k` columns in groups, with the widest vectors this processor has.
pub(crate) fn run_lanes(k: usize, kernel: &mut impl LaneKernel) {
    pulp::Arch::new().dispatch(Groups { k, kernel });
}

struct Groups<'a, K> {
    k: usize,
    kernel: &'a mut K,
}

impl<K: LaneKernel> pulp::WithSimd for Groups<'_, K> {
    type Output = ();

    // A closure in place of this type would be compiled for the plain processor.
    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) {
        let mut from = 0;
        while from < self.k {
            let rest = self.k - from;
            // As few groups as possible, of about equal width; 18 columns in one group take two
            // thirds of the time of 16 and 2.
            let width = rest.div_ceil(rest.div_ceil(MOST_LANES));
            from += match width {
                24.. => self.group::<S, 24>(from),
                22.. => self.group::<S, 22>(from),
                20.. => self.group::<S, 20>(from),
                18.. => self.group::<S, 18>(from),
                16.. => self.group::<S, 16>(from),
                14.. => self.group::<S, 14>(from),
                12.. => self.group::<S, 12>(from),
                10.. => self.group::<S, 10>(from),
                8.. => self.group::<S, 8>(from),
                6.. => self.group::<S, 6>(from),
                4.. => self.group::<S, 4>(from),
                2.. => self.group::<S, 2>(from),
                _ => self.group::<S, 1>(from),
            };
        }
    }
}

impl<K: LaneKernel> Groups<'_, K> {
    #[inline(always)]
    fn group<A: Arithmetic, const W: usize>(&mut self, from: usize) -> usize {
        self.kernel.run::<A, W>(from);
        W
    }
}

/// Columns `from..from + W` of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn lanes<T, const W: usize>(x: &[T], k: usize, i: usize, from: usize) -> &[T; W] {
    x[i * k + from..].first_chunk().expect("the matrix has this row")
}

/// Columns `from..from + W` of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn lanes_mut<T, const W: usize>(
    x: &mut [T],
    k: usize,
    i: usize,
    from: usize,
) -> &mut [T; W] {
    x[i * k + from..].first_chunk_mut().expect("the matrix has this row")
}

/// A kernel for `width` columns of its right-hand sides from `from` on, four by four: H times the first ones, and the last
/// four, which may be some of these once more. What is written must therefore be read before.
pub(crate) trait QuadKernel {
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize);
    /// For all columns of a group from `from` on; of some parts fewer may do.
    #[inline(always)]
    fn run_group<A: Arithmetic>(&mut self, from: usize, group: Span)
    where
        Self: Sized,
    {
        group.run::<A>(from, self);
    }
    /// The same for all W columns, where there are fewer than four.
    fn run_few<const W: usize>(&mut self);
}

/// Runs the kernel over `k` columns in groups, with the widest vectors this processor has.
pub(crate) fn run_quads(k: usize, kernel: &mut impl QuadKernel) {
    match k {
        0 => {}
        1 => kernel.run_few::<1>(),
        2 => kernel.run_few::<2>(),
        3 => kernel.run_few::<3>(),
        _ => pulp::Arch::new().dispatch(Quads { k, kernel }),
    }
}

struct Quads<'a, K> {
    k: usize,
    kernel: &'a mut K,
}

impl<K: QuadKernel> pulp::WithSimd for Quads<'_, K> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let mut from = 0;
        while from < self.k {
            let rest = self.k - from;
            let width = rest.div_ceil(rest.div_ceil(MOST_LANES));
            self.kernel.run_group::<S>(from, Span::of_width(width));
            from += width;
        }
    }
}

/// Columns of a group that a `QuadKernel` takes: the first ones, four by four, and the four that end somewhere.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    heads: u8,
    end: u8,
}

impl Span {
    /// Most columns of a matrix that has spans.
    pub const MOST: usize = MOST_LANES;

    /// The narrowest with these columns, a bit for each; it may have others.
    pub fn of(columns: u32) -> Self {
        let length = |columns: u32| 32 - columns.leading_zeros();
        if columns == 0 {
            return Self { heads: 0, end: 0 };
        }
        let end = length(columns).max(4);
        let before = columns & ((1 << (end - 4)) - 1);
        Self { heads: length(before).div_ceil(4) as u8, end: end as u8 }
    }

    #[inline(always)]
    fn of_width(width: usize) -> Self {
        Self { heads: (width.div_ceil(4) - 1) as u8, end: width as u8 }
    }

    #[inline(always)]
    pub(crate) fn run<A: Arithmetic>(self, from: usize, kernel: &mut impl QuadKernel) {
        let width = usize::from(self.end);
        match self.heads {
            _ if width == 0 => {}
            0 => kernel.run::<A, 0>(from, width),
            1 => kernel.run::<A, 1>(from, width),
            2 => kernel.run::<A, 2>(from, width),
            3 => kernel.run::<A, 3>(from, width),
            4 => kernel.run::<A, 4>(from, width),
            _ => kernel.run::<A, 5>(from, width),
        }
    }
}

/// Numbers of a row side by side, as a [`QuadKernel`] takes them.
pub(crate) type Quad = [f64; 4];

/// What a [`QuadKernel`] takes of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn quads<const H: usize>(
    x: &[f64],
    k: usize,
    i: usize,
    [from, width]: [usize; 2],
) -> (&[Quad; H], &Quad) {
    let row = &x[i * k + from..][..width];
    let heads = row.as_chunks().0.first_chunk();
    (heads.expect("so many columns"), row.last_chunk().expect("four columns"))
}

/// Rows of a matrix from `first` on; by a loop, as what makes arrays may be compiled for the plain processor.
#[inline(always)]
pub(crate) fn rows_of<const H: usize, const N: usize>(
    x: &[f64],
    k: usize,
    first: usize,
    at: [usize; 2],
) -> [(&[Quad; H], &Quad); N] {
    // Taken off the rest one after the other: that takes less than to look where each begins.
    let (row, mut rest) = x[first * k..].split_at(k);
    let mut rows = [quads(row, k, 0, at); N];
    for i in 1..N {
        let (row, after) = rest.split_at(k);
        rows[i] = quads(row, k, 0, at);
        rest = after;
    }
    rows
}

/// For every column what tells whether it has numbers but zeros, of either sign.
#[inline(always)]
pub(crate) fn marks<const N: usize, const M: usize>(a: &[[f64; M]; N]) -> [u64; M] {
    let mut bits = [0; M];
    for row in a {
        for j in 0..M {
            bits[j] |= row[j].to_bits();
        }
    }
    for j in 0..M {
        bits[j] <<= 1;
    }
    bits
}

/// Y += α AᵀX for M rows of Y, with which `y` begins. Columns of zeros, which joints and what acts on or moves few bodies leave
/// in great number, are passed over.
#[inline(always)]
pub(crate) fn add_transposed<A: Arithmetic, const H: usize, const N: usize, const M: usize>(
    alpha: f64,
    (a, marks): (&[[f64; M]; N], &[u64; M]),
    x: &[(&[Quad; H], &Quad); N],
    y: &mut [f64],
    k: usize,
    at: [usize; 2],
) {
    let mut rest = y;
    for j in 0..M {
        let (row, after) = std::mem::take(&mut rest).split_at_mut(k);
        rest = after;
        if marks[j] != 0 {
            let mut column = [0.0; N];
            for i in 0..N {
                column[i] = alpha * a[i][j];
            }
            add_column::<A, H, N>(&column, x, row, k, 0, at);
        }
    }
}

/// Adds to row `i` of Y the rows `x`, each times its number in `column`.
#[inline(always)]
pub(crate) fn add_column<A: Arithmetic, const H: usize, const N: usize>(
    column: &[f64; N],
    x: &[(&[Quad; H], &Quad); N],
    y: &mut [f64],
    k: usize,
    i: usize,
    at: [usize; 2],
) {
    let (heads, end) = quads::<H>(y, k, i, at);
    let (mut heads, mut end) = (*heads, *end);
    for j in 0..N {
        for h in 0..H {
            add_multiple::<A>(&mut heads[h], column[j], &x[j].0[h]);
        }
        add_multiple::<A>(&mut end, column[j], x[j].1);
    }
    set_quads((&heads, &end), y, k, i, at);
}

/// Makes these the numbers of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn set_quads<const H: usize>(
    (heads, end): (&[Quad; H], &Quad),
    y: &mut [f64],
    k: usize,
    i: usize,
    [from, width]: [usize; 2],
) {
    let row = &mut y[i * k + from..][..width];
    *row.as_chunks_mut().0.first_chunk_mut().expect("so many columns") = *heads;
    *row.last_chunk_mut().expect("four columns") = *end;
}

/// Adds a multiple of sums to row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn add_quads<A: Arithmetic, const H: usize>(
    alpha: f64,
    (sums, end): (&[Quad; H], &Quad),
    y: &mut [f64],
    k: usize,
    i: usize,
    [from, width]: [usize; 2],
) {
    let (new_heads, new_end) = quads::<H>(y, k, i, [from, width]);
    // Copies, of which it is known that they do not overlap.
    let (mut new_heads, mut new_end, sums) = (*new_heads, *new_end, *sums);
    for h in 0..H {
        add_multiple::<A>(&mut new_heads[h], alpha, &sums[h]);
    }
    add_multiple::<A>(&mut new_end, alpha, end);
    set_quads((&new_heads, &new_end), y, k, i, [from, width]);
}

/// out += a x.
#[inline(always)]
pub(crate) fn add_multiple<A: Arithmetic>(out: &mut Quad, a: f64, x: &Quad) {
    for l in 0..4 {
        out[l] = A::multiply_add(a, x[l], out[l]);
    }
}

/// Work with a few numbers at a time, like those of two bodies.
pub trait Wide {
    /// To be compiled into its place, as all that it calls.
    fn run<A: Arithmetic>(self);
}

/// Does the work with the widest vectors this processor has.
pub fn run_wide(work: impl Wide) {
    pulp::Arch::new().dispatch(Dispatched(work));
}

struct Dispatched<W>(W);

impl<W: Wide> pulp::WithSimd for Dispatched<W> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        self.0.run::<S>();
    }
}

/// Multiplies every row of X (by rows, k columns) by its number in `scales`.
///
/// # Panics
/// If X has not a row for every number.
pub fn scale_rows(scales: &[f64], k: usize, x: &mut [f64]) {
    assert_eq!(x.len(), scales.len() * k, "a row for every number");
    run_quads(k, &mut RowScaling { scales, k, x });
}

struct RowScaling<'a> {
    scales: &'a [f64],
    k: usize,
    x: &'a mut [f64],
}

impl QuadKernel for RowScaling<'_> {
    #[inline(always)]
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize) {
        for (row, scale) in self.x.chunks_exact_mut(self.k).zip(self.scales) {
            let row = &mut row[from..][..width];
            let mut end: Quad = *row.last_chunk().expect("four columns");
            let heads: Option<&mut [Quad; H]> = row.as_chunks_mut().0.first_chunk_mut();
            for head in heads.expect("so many columns") {
                head.iter_mut().for_each(|x| *x *= scale);
            }
            end.iter_mut().for_each(|x| *x *= scale);
            *row.last_chunk_mut().expect("four columns") = end;
        }
    }

    fn run_few<const W: usize>(&mut self) {
        let (rows, _) = self.x.as_chunks_mut::<W>();
        for (row, scale) in rows.iter_mut().zip(self.scales) {
            row.iter_mut().for_each(|x| *x *= scale);
        }
    }
}

/// Adds a·(row j of X) to row i of Y for every entry (i, j, a) of a matrix, in their order; X and Y by rows with k columns.
///
/// # Panics
/// If there is no such row.
pub fn add_entries(
    entries: impl Iterator<Item = (usize, usize, f64)> + Clone,
    x: &[f64],
    k: usize,
    y: &mut [f64],
) {
    run_quads(k, &mut EntryProduct { entries, x, k, y });
}

struct EntryProduct<'a, E> {
    entries: E,
    x: &'a [f64],
    k: usize,
    y: &'a mut [f64],
}

impl<E: Iterator<Item = (usize, usize, f64)> + Clone> QuadKernel for EntryProduct<'_, E> {
    #[inline(always)]
    fn run<A: Arithmetic, const H: usize>(&mut self, from: usize, width: usize) {
        let (at, mut entries) = ([from, width], self.entries.clone());
        let mut next = entries.next();
        // Those one after the other that take the same row of X.
        while let Some((_, row, _)) = next {
            let (heads, end) = quads::<H>(self.x, self.k, row, at);
            let (heads, end) = (*heads, *end);
            while let Some((i, _, a)) = next.filter(|next| next.1 == row) {
                add_quads::<A, H>(a, (&heads, &end), self.y, self.k, i, at);
                next = entries.next();
            }
        }
    }

    fn run_few<const W: usize>(&mut self) {
        let ((x, _), (y, _)) = (self.x.as_chunks::<W>(), self.y.as_chunks_mut::<W>());
        for (i, j, a) in self.entries.clone() {
            y[i].iter_mut().zip(&x[j]).for_each(|(y, x)| *y += a * x);
        }
    }
}

/// Σ aᵢ bᵢ over as many entries as both have, in eight interleaved sums, so that additions need not wait for each other.
#[inline(always)]
pub fn dot(a: &[f64], b: &[f64]) -> f64 {
    let n = a.len().min(b.len());
    let (a, b) = (&a[..n], &b[..n]);
    if a.len() < 8 {
        return a.iter().zip(b).map(|(a, b)| a * b).sum();
    }
    let mut sums = [0.0; 8];
    let (a_chunks, a_rest) = a.as_chunks::<8>();
    let (b_chunks, b_rest) = b.as_chunks::<8>();
    for (a, b) in a_chunks.iter().zip(b_chunks) {
        for s in 0..8 {
            sums[s] += a[s] * b[s];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    let [s0, s1, s2, s3, s4, s5, s6, s7] = sums;
    ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7)) + rest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn noise(n: usize) -> Vec<f64> {
        (0..n).map(|i| ((i * i + 1) as f64).sin()).collect()
    }

    #[test] // truth: plain loops, with the same products and sums, all of them rounded twice or all of them once
    fn rows_are_scaled_and_added_for_any_number_of_columns() {
        let scales = noise(7);
        let entries = [(0, 3, 0.5), (4, 3, -1.5), (0, 0, 2.0), (2, 6, 0.25), (0, 3, 1.0)];
        for k in 0..60 {
            let start = noise(7 * k);
            let mut x = start.clone();
            scale_rows(&scales, k, &mut x);
            assert!((0..7 * k).all(|at| x[at] == start[at] * scales[at / k]), "{k} columns");
            let mut y = noise(5 * k);
            let (mut twice, mut once) = (y.clone(), y.clone());
            add_entries(entries.into_iter(), &x, k, &mut y);
            for (i, j, a) in entries {
                for c in 0..k {
                    let x = x[j * k + c];
                    twice[i * k + c] += a * x;
                    once[i * k + c] = a.mul_add(x, once[i * k + c]);
                }
            }
            assert!(y == twice || y == once, "{k} columns");
        }
    }
}
