//! Rotations of the plane.

use super::Real;

/// A(θ) a.
#[inline(always)]
pub fn rotate<T: Real>(angle: T, a: &[T; 2]) -> [T; 2] {
    let (s, c) = angle.sine_cosine();
    [c * a[0] - s * a[1], s * a[0] + c * a[1]]
}

/// R a: a turned by a right angle, so that ∂(A a)/∂θ = R A a.
#[inline(always)]
pub fn quarter_turn<T: Real>(a: &[T; 2]) -> [T; 2] {
    [-a[1], a[0]]
}
