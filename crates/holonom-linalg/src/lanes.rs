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
                24.. => self.group::<24>(from),
                22.. => self.group::<22>(from),
                20.. => self.group::<20>(from),
                18.. => self.group::<18>(from),
                16.. => self.group::<16>(from),
                14.. => self.group::<14>(from),
                12.. => self.group::<12>(from),
                10.. => self.group::<10>(from),
                8.. => self.group::<8>(from),
                6.. => self.group::<6>(from),
                4.. => self.group::<4>(from),
                2.. => self.group::<2>(from),
                _ => self.group::<1>(from),
            };
        }
    }
}

impl<K: LaneKernel> Groups<'_, K> {
    #[inline(always)]
    fn group<const W: usize>(&mut self, from: usize) -> usize {
        self.kernel.run::<W>(from);
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

/// Σ aᵢ bᵢ in eight interleaved sums, so that additions need not wait for each other.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
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
