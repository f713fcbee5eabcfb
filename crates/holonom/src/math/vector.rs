//! Vectors as arrays.

use super::Real;

/// Constants as scalars of a kernel.
#[inline(always)]
pub fn lift<T: Real, const D: usize>(a: &[f64; D]) -> [T; D] {
    a.map(T::from)
}

/// aᵀb.
#[inline(always)]
pub fn dot<T: Real, const D: usize>(a: &[T; D], b: &[T; D]) -> T {
    let mut sum = a[0] * b[0];
    for k in 1..D {
        sum += a[k] * b[k];
    }
    sum
}

/// a factor.
#[inline(always)]
pub fn scaled<T: Real, const D: usize>(a: &[T; D], factor: T) -> [T; D] {
    a.map(|x| x * factor)
}

/// a + b.
#[inline(always)]
pub fn sum<T: Real, const D: usize>(a: &[T; D], b: &[T; D]) -> [T; D] {
    std::array::from_fn(|k| a[k] + b[k])
}

/// a − b.
#[inline(always)]
pub fn difference<T: Real, const D: usize>(a: &[T; D], b: &[T; D]) -> [T; D] {
    std::array::from_fn(|k| a[k] - b[k])
}

/// a += factor b.
#[inline(always)]
pub fn add_scaled<T: Real, const D: usize>(a: &mut [T; D], factor: T, b: &[T; D]) {
    for k in 0..D {
        a[k] += factor * b[k];
    }
}

/// The larger one, a NaN if one of them is.
pub fn larger(a: f64, b: f64) -> f64 {
    if (a >= b) | a.is_nan() { a } else { b }
}

/// Whether two vectors of one length are the same numbers. Where they are as a rule: several are compared at once, with no way
/// out in between.
pub fn same_bits(a: &[f64], b: &[f64]) -> bool {
    let differs = |(a, b): (&f64, &f64)| a.to_bits() ^ b.to_bits();
    a.iter().zip(b).map(differs).fold(0, |all, bits| all | bits) == 0
}
