//! Euler parameters p = (e0, e) and the rotation A(p) = E Gᵀ, homogeneous of degree two: exact
//! derivatives for every p, also where |p| ≠ 1.
//!
//! E = [−e, ẽ + e0 I], G = [−e, −ẽ + e0 I], ω = 2 E ṗ (ground axes), ω' = 2 G ṗ (body axes).
//! Source: E. J. Haug, *Computer Aided Kinematics and Dynamics of Mechanical Systems* (1989), 9.3.

use super::Real;
use super::vector::dot;

/// a × b.
#[inline(always)]
pub fn cross<T: Real>(a: &[T; 3], b: &[T; 3]) -> [T; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

#[inline(always)]
fn parts<T: Real>(p: &[T; 4]) -> (T, [T; 3]) {
    (p[0], [p[1], p[2], p[3]])
}

/// A(p) a = (e0² − eᵀe) a + 2 e (eᵀa) + 2 e0 e × a.
#[inline(always)]
pub fn rotate<T: Real>(p: &[T; 4], a: &[T; 3]) -> [T; 3] {
    let (e0, e) = parts(p);
    let (s, t, x) = (e0 * e0 - dot(&e, &e), dot(&e, a) * 2.0, cross(&e, a));
    let u = e0 * 2.0;
    std::array::from_fn(|k| s * a[k] + t * e[k] + u * x[k])
}

/// A(p), `[row][column]`.
pub fn rotation_matrix<T: Real>(p: &[T; 4]) -> [[T; 3]; 3] {
    let (e0, e) = parts(p);
    let s = e0 * e0 - dot(&e, &e);
    let mut a: [[T; 3]; 3] = std::array::from_fn(|i| std::array::from_fn(|j| e[i] * e[j] * 2.0));
    for i in 0..3 {
        a[i][i] += s;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let t = e0 * e[i] * 2.0;
        a[k][j] += t;
        a[j][k] -= t;
    }
    a
}

/// A(p)ᵀ a: ground components to body components (of a unit p).
#[inline(always)]
pub fn rotate_back<T: Real>(p: &[T; 4], a: &[T; 3]) -> [T; 3] {
    rotate(&conjugate(p), a)
}

/// B(p, a) = ∂(A(p) a)/∂p, linear in p and in a; B(p, a) w = B(w, a) p and A a = ½ B p.
#[inline(always)]
pub fn slope<T: Real>(p: &[T; 4], a: &[T; 3]) -> [[T; 4]; 3] {
    let f = p[0] * 2.0;
    let e = [p[1] * 2.0, p[2] * 2.0, p[3] * 2.0];
    let x = cross(&e, a);
    let s = dot(&e, a);
    let fa = [f * a[0], f * a[1], f * a[2]];
    // 2 [e aᵀ − a eᵀ + (eᵀa) I − e0 ã]
    let (z, y, w) =
        (e[0] * a[1] - a[0] * e[1], e[0] * a[2] - a[0] * e[2], e[1] * a[2] - a[1] * e[2]);
    [
        [fa[0] + x[0], s, z + fa[2], y - fa[1]],
        [fa[1] + x[1], -z - fa[2], s, w + fa[0]],
        [fa[2] + x[2], -y + fa[1], -w - fa[0], s],
    ]
}

/// K(a, c) = ∂(B(p, a)ᵀ c)/∂p: symmetric, independent of p; cᵀA(p) a = ½ pᵀK p.
#[inline(always)]
pub fn bend<T: Real>(a: &[T; 3], c: &[T; 3]) -> [[T; 4]; 4] {
    let c = [c[0] * 2.0, c[1] * 2.0, c[2] * 2.0];
    let s = dot(a, &c);
    let x = cross(a, &c);
    let m = |i: usize, j: usize| a[i] * c[j] + c[i] * a[j];
    let (m01, m02, m12) = (m(0, 1), m(0, 2), m(1, 2));
    [
        [s, x[0], x[1], x[2]],
        [x[0], m(0, 0) - s, m01, m02],
        [x[1], m01, m(1, 1) - s, m12],
        [x[2], m02, m12, m(2, 2) - s],
    ]
}

/// E(p) w; with w = ṗ half the angular velocity in ground axes.
#[inline(always)]
pub fn e_times<T: Real>(p: &[T; 4], w: &[T; 4]) -> [T; 3] {
    let ((e0, e), (w0, w)) = (parts(p), parts(w));
    let x = cross(&e, &w);
    std::array::from_fn(|k| e0 * w[k] - e[k] * w0 + x[k])
}

/// G(p) w; with w = ṗ half the angular velocity in body axes.
#[inline(always)]
pub fn g_times<T: Real>(p: &[T; 4], w: &[T; 4]) -> [T; 3] {
    let ((e0, e), (w0, w)) = (parts(p), parts(w));
    let x = cross(&e, &w);
    std::array::from_fn(|k| e0 * w[k] - e[k] * w0 - x[k])
}

/// E(p)ᵀ n: twice this is the generalized force of the torque n in ground axes.
#[inline(always)]
pub fn e_transposed_times<T: Real>(p: &[T; 4], n: &[T; 3]) -> [T; 4] {
    let (e0, e) = parts(p);
    let x = cross(n, &e);
    [-dot(&e, n), e0 * n[0] + x[0], e0 * n[1] + x[1], e0 * n[2] + x[2]]
}

/// G(p)ᵀ n: twice this is the generalized force of the torque n in body axes.
#[inline(always)]
pub fn g_transposed_times<T: Real>(p: &[T; 4], n: &[T; 3]) -> [T; 4] {
    let (e0, e) = parts(p);
    let x = cross(&e, n);
    [-dot(&e, n), e0 * n[0] + x[0], e0 * n[1] + x[1], e0 * n[2] + x[2]]
}

/// ∂(E(p)ᵀ n)/∂p, independent of p.
#[inline(always)]
pub fn e_transposed_slope<T: Real>(n: &[T; 3]) -> [[T; 4]; 4] {
    let o = T::zero();
    [
        [o, -n[0], -n[1], -n[2]],
        [n[0], o, -n[2], n[1]],
        [n[1], n[2], o, -n[0]],
        [n[2], -n[1], n[0], o],
    ]
}

/// ∂(G(p)ᵀ n)/∂p, independent of p.
#[inline(always)]
pub fn g_transposed_slope<T: Real>(n: &[T; 3]) -> [[T; 4]; 4] {
    let o = T::zero();
    [
        [o, -n[0], -n[1], -n[2]],
        [n[0], o, n[2], -n[1]],
        [n[1], -n[2], o, n[0]],
        [n[2], n[1], -n[0], o],
    ]
}

/// Euler parameters of the opposite rotation.
#[inline(always)]
pub fn conjugate<T: Real>(p: &[T; 4]) -> [T; 4] {
    [p[0], -p[1], -p[2], -p[3]]
}

/// Euler parameters of the rotation A(a) A(b).
#[inline(always)]
pub fn product<T: Real>(a: &[T; 4], b: &[T; 4]) -> [T; 4] {
    let ((a0, a), (b0, b)) = (parts(a), parts(b));
    let x = cross(&a, &b);
    [
        a0 * b0 - dot(&a, &b),
        a0 * b[0] + b0 * a[0] + x[0],
        a0 * b[1] + b0 * a[1] + x[1],
        a0 * b[2] + b0 * a[2] + x[2],
    ]
}

/// Euler parameters (unit, e0 not negative) of a rotation matrix `[row][column]`.
///
/// The largest of the four is taken from the diagonal, so none is divided by a small number.
pub fn euler_parameters(a: &[[f64; 3]; 3]) -> [f64; 4] {
    let trace = a[0][0] + a[1][1] + a[2][2];
    // 4 e_k² for k = 0..3
    let squares = [
        1.0 + trace,
        1.0 + 2.0 * a[0][0] - trace,
        1.0 + 2.0 * a[1][1] - trace,
        1.0 + 2.0 * a[2][2] - trace,
    ];
    let mut largest = 0;
    for k in 1..4 {
        if squares[k] > squares[largest] {
            largest = k;
        }
    }
    let mut p = [0.0; 4];
    if largest == 0 {
        p = [squares[0], a[2][1] - a[1][2], a[0][2] - a[2][0], a[1][0] - a[0][1]];
    } else {
        let i = largest - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        p[0] = a[k][j] - a[j][k];
        p[1 + i] = squares[largest];
        p[1 + j] = a[i][j] + a[j][i];
        p[1 + k] = a[i][k] + a[k][i];
    }
    let length = p.iter().map(|x| x * x).sum::<f64>().sqrt();
    let sign = if p[0] < 0.0 { -1.0 } else { 1.0 };
    p.map(|x| sign * x / length)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Random;

    fn times(m: &[[f64; 4]; 3], w: &[f64; 4]) -> [f64; 3] {
        std::array::from_fn(|i| dot(&m[i], w))
    }

    #[test] // independent truth: the definitions A = E Gᵀ and ω = 2 E ṗ with Ȧ a = ω × A a
    fn toolbox_identities_hold_for_every_p() {
        let mut random = Random::new(11);
        for _ in 0..100 {
            let p: [f64; 4] = random.array(1.5);
            let w: [f64; 4] = random.array(2.0);
            let a: [f64; 3] = random.array(1.0);
            let c: [f64; 3] = random.array(1.0);
            // A a = E Gᵀ a
            let expected = e_times(&p, &g_transposed_times(&p, &a));
            let matrix = rotation_matrix(&p);
            let turned = rotate(&p, &a);
            let b = slope(&p, &a);
            let half = times(&b, &p);
            let (bw, wb) = (times(&b, &w), times(&slope(&w, &a), &p));
            let k = bend(&a, &c);
            for i in 0..3 {
                assert!((turned[i] - expected[i]).abs() < 1e-13);
                assert!((turned[i] - dot(&matrix[i], &a)).abs() < 1e-13);
                assert!((turned[i] - 0.5 * half[i]).abs() < 1e-13, "A a = ½ B p");
                assert!((bw[i] - wb[i]).abs() < 1e-12, "B(p,a) w = B(w,a) p");
            }
            let quadratic: f64 = (0..4).map(|i| p[i] * dot(&k[i], &p)).sum();
            assert!((0.5 * quadratic - dot(&c, &turned)).abs() < 1e-12, "cᵀA a = ½ pᵀK p");
            // rigid rotation: (A a)˙ = ω × A a for unit p and ṗ perpendicular to p
            let length = dot(&p, &p).sqrt();
            let u = p.map(|x| x / length);
            let along = dot(&u, &w);
            let rate: [f64; 4] = std::array::from_fn(|i| w[i] - along * u[i]);
            let omega = e_times(&u, &rate).map(|x| 2.0 * x);
            let (found, expected) = (times(&slope(&u, &a), &rate), cross(&omega, &rotate(&u, &a)));
            let back = rotate(&u, &g_times(&u, &rate).map(|x| 2.0 * x));
            for i in 0..3 {
                assert!((found[i] - expected[i]).abs() < 1e-12);
                assert!((omega[i] - back[i]).abs() < 1e-12, "ω = A ω'");
            }
            // Eᵀ and Gᵀ are transposes of E and G
            assert!(
                (dot(&e_transposed_times(&p, &a), &w) - dot(&a, &e_times(&p, &w))).abs() < 1e-12
            );
            assert!(
                (dot(&g_transposed_times(&p, &a), &w) - dot(&a, &g_times(&p, &w))).abs() < 1e-12
            );
            for i in 0..4 {
                let (e, g) = (e_transposed_times(&p, &a)[i], g_transposed_times(&p, &a)[i]);
                assert!((dot(&e_transposed_slope(&a)[i], &p) - e).abs() < 1e-12);
                assert!((dot(&g_transposed_slope(&a)[i], &p) - g).abs() < 1e-12);
            }
        }
    }

    #[test] // independent truth: the rotation matrices of products and of the found parameters
    fn parameters_come_back_from_matrices_and_products_compose() {
        let mut random = Random::new(12);
        for _ in 0..200 {
            let (p, q) = (random.unit::<4>(), random.unit::<4>());
            let found = euler_parameters(&rotation_matrix(&p));
            let sign = if p[0] < 0.0 { -1.0 } else { 1.0 };
            for i in 0..4 {
                assert!((found[i] - sign * p[i]).abs() < 1e-14);
            }
            let a: [f64; 3] = random.array(1.0);
            let (one, two) = (rotate(&product(&p, &q), &a), rotate(&p, &rotate(&q, &a)));
            let back = rotate_back(&p, &rotate(&p, &a));
            for i in 0..3 {
                assert!((one[i] - two[i]).abs() < 1e-14);
                assert!((back[i] - a[i]).abs() < 1e-14);
            }
        }
        let half_turn = [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]];
        assert_eq!(euler_parameters(&half_turn), [0.0, 0.0, 1.0, 0.0]);
    }
}
