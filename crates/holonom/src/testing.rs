//! Helpers of tests: seeded random numbers and differences that are independent of any derivative.

/// A small deterministic generator (splitmix64).
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Entries uniform in ±size.
    pub(crate) fn array<const D: usize>(&mut self, size: f64) -> [f64; D] {
        std::array::from_fn(|_| self.range(-size, size))
    }

    /// A unit vector.
    pub(crate) fn unit<const D: usize>(&mut self) -> [f64; D] {
        loop {
            let a: [f64; D] = self.array(1.0);
            let length = a.iter().map(|x| x * x).sum::<f64>().sqrt();
            if (0.1..1.0).contains(&length) {
                return a.map(|x| x / length);
            }
        }
    }
}

/// Derivative at 0 of `f` by central differences with steps h and h/2, extrapolated: error O(h⁴).
pub(crate) fn richardson(h: f64, f: impl Fn(f64) -> Vec<f64>) -> Vec<f64> {
    let (a, b, c, d) = (f(h), f(-h), f(0.5 * h), f(-0.5 * h));
    (0..a.len())
        .map(|k| {
            let (coarse, fine) = ((a[k] - b[k]) / (2.0 * h), (c[k] - d[k]) / h);
            (4.0 * fine - coarse) / 3.0
        })
        .collect()
}

/// Number of seeded random states per block: 50, or 1,000 with the feature `long`.
pub(crate) fn random_states() -> usize {
    if cfg!(feature = "long") { 1000 } else { 50 }
}
