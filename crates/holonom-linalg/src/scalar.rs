//! What entries of a matrix may be: real or complex.

use num_complex::Complex64;
use std::ops::{Add, Mul, Sub};

mod sealed {
    use crate::lanes::Arithmetic;
    use num_complex::Complex64;

    pub trait Sealed {
        /// x − a b.
        fn minus_product<A: Arithmetic>(self, a: Self, b: Self) -> Self;
    }

    impl Sealed for f64 {
        #[inline(always)]
        fn minus_product<A: Arithmetic>(self, a: f64, b: f64) -> f64 {
            A::multiply_add(-a, b, self)
        }
    }

    impl Sealed for Complex64 {
        #[inline(always)]
        fn minus_product<A: Arithmetic>(self, a: Self, b: Self) -> Self {
            let re = self.re.minus_product::<A>(a.re, b.re);
            let im = self.im.minus_product::<A>(a.re, b.im);
            Self::new(A::multiply_add(a.im, b.im, re), im.minus_product::<A>(a.im, b.re))
        }
    }
}

/// A real or complex number, [`f64`] or [`Complex64`].
pub trait Scalar:
    sealed::Sealed
    + std::fmt::Debug
    + Copy
    + Send
    + Sync
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + 'static
{
    /// Zero.
    const ZERO: Self;

    /// |x|, or |Re x| + |Im x|, which is within √2 of the modulus and needs no root.
    fn size(self) -> f64;

    /// The size with the sign of a real number.
    fn signed_size(self) -> f64;

    /// x times a real number.
    fn scaled(self, factor: f64) -> Self;

    /// 1/x.
    fn reciprocal(self) -> Self;
}

impl Scalar for f64 {
    const ZERO: Self = 0.0;

    #[inline(always)]
    fn size(self) -> f64 {
        self.abs()
    }

    fn signed_size(self) -> f64 {
        self
    }

    #[inline(always)]
    fn scaled(self, factor: f64) -> Self {
        self * factor
    }

    #[inline(always)]
    fn reciprocal(self) -> Self {
        1.0 / self
    }
}

impl Scalar for Complex64 {
    const ZERO: Self = Complex64::new(0.0, 0.0);

    #[inline(always)]
    fn size(self) -> f64 {
        self.re.abs() + self.im.abs()
    }

    fn signed_size(self) -> f64 {
        self.size()
    }

    #[inline(always)]
    fn scaled(self, factor: f64) -> Self {
        self * factor
    }

    /// Without the overflow and underflow of |x|² (Smith, *Algorithm 116*, CACM 5, 1962).
    #[inline(always)]
    fn reciprocal(self) -> Self {
        if self.re.abs() >= self.im.abs() {
            let ratio = self.im / self.re;
            let denominator = self.re + self.im * ratio;
            Complex64::new(1.0 / denominator, -ratio / denominator)
        } else {
            let ratio = self.re / self.im;
            let denominator = self.re * ratio + self.im;
            Complex64::new(ratio / denominator, -1.0 / denominator)
        }
    }
}
