//! Kernels over several right-hand sides at a time.
//!
//! The numbers of one row for `W` right-hand sides lie side by side, so that a loop over `W`
//! becomes vector instructions. Multiplications and additions are never fused here: results are
//! the same bits on every processor.

/// A kernel for columns `from..from + W` of its right-hand sides.
pub(crate) trait LaneKernel {
    fn run<const W: usize>(&mut self, from: usize);
}

/// Most columns that are taken together.
pub(crate) const MOST_LANES: usize = 16;

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
    fn with_simd<S: pulp::Simd>(self, _: S) {
        let mut from = 0;
        while self.k - from >= MOST_LANES {
            self.kernel.run::<MOST_LANES>(from);
            from += MOST_LANES;
        }
        if self.k - from >= 8 {
            self.kernel.run::<8>(from);
            from += 8;
        }
        if self.k - from >= 4 {
            self.kernel.run::<4>(from);
            from += 4;
        }
        if self.k - from >= 2 {
            self.kernel.run::<2>(from);
            from += 2;
        }
        if self.k > from {
            self.kernel.run::<1>(from);
        }
    }
}

/// Columns `from..from + W` of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn lanes<const W: usize>(x: &[f64], k: usize, i: usize, from: usize) -> &[f64; W] {
    x[i * k + from..].first_chunk().expect("the matrix has this row")
}

/// Columns `from..from + W` of row `i` of a matrix with `k` columns.
#[inline(always)]
pub(crate) fn lanes_mut<const W: usize>(
    x: &mut [f64],
    k: usize,
    i: usize,
    from: usize,
) -> &mut [f64; W] {
    x[i * k + from..].first_chunk_mut().expect("the matrix has this row")
}

/// Σ aᵢ bᵢ in eight interleaved sums, so that additions need not wait for each other.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
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
