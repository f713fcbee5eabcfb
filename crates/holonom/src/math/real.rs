//! The sealed scalar of the element kernels.

/// Scalar of element kernels: `f64` in every run, a dual number where a derivative is checked.
///
/// Sealed by being implemented here only: kernels written over it must stay free of branches that
/// depend on data, so that a lane type can join later.
pub trait Real: num_dual::DualNum<Primitive = f64> + Copy {
    /// The real part.
    fn value(self) -> f64;

    /// (sin, cos).
    fn sine_cosine(self) -> (Self, Self);
}

impl Real for f64 {
    fn value(self) -> f64 {
        self
    }

    #[inline(always)]
    fn sine_cosine(self) -> (Self, Self) {
        super::trigonometry::sin_cos(self)
    }
}

impl Real for num_dual::Dual64 {
    fn value(self) -> f64 {
        self.re
    }

    fn sine_cosine(self) -> (Self, Self) {
        num_dual::DualNum::sin_cos(&self)
    }
}
