//! Products and the inverse of 3×3 matrices, in rows.

use super::spatial::cross;
use super::vector::dot;

/// Three rows.
pub type Matrix3 = [[f64; 3]; 3];

/// A x.
pub fn times(a: &Matrix3, x: &[f64; 3]) -> [f64; 3] {
    a.each_ref().map(|row| dot(row, x))
}

/// Aᵀ.
pub fn transposed(a: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| a[j][i]))
}

/// A B.
pub fn product(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    let columns = transposed(b);
    a.map(|row| columns.map(|column| dot(&row, &column)))
}

/// A⁻¹ by cofactors; not finite where A is singular.
pub fn inverse(a: &Matrix3) -> Matrix3 {
    let rows = [cross(&a[1], &a[2]), cross(&a[2], &a[0]), cross(&a[0], &a[1])];
    let over = dot(&a[0], &rows[0]).recip();
    transposed(&rows.map(|row| row.map(|x| x * over)))
}

/// ñ: ñ x = n × x.
pub fn skew(n: &[f64; 3]) -> Matrix3 {
    [[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]]
}
