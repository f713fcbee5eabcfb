//! One kernel for every angle: t(c, n) = 2 atan2(|n|, c) n/|n|, homogeneous of degree 0.
//!
//! The rotation vector of Euler parameters is t(e₀, ε), the turn from a unit vector u₀ to d is
//! ½ t(u₀·d, u₀×d). With u = n·n/2 it is f(c, u) n; every partial of f with a c is rational, those in
//! u follow
//!
//! ```text
//! f⁽ᵏ⁺¹⁾ = (pₖ − (2k+1) f⁽ᵏ⁾)/|n|²     p = 2c/N², −4c/N⁴, 16c/N⁶     N² = c² + |n|²
//! ```
//!
//! which loses digits like |n|⁻⁶: near n = 0 a series takes its place (`docs/theory/math.md` (7)-(14)).

use super::Real;
use super::spatial::cross;
use super::vector::dot;

/// Below this |n|/c the series serves: the recursion would lose the third derivatives before.
const SERIES_BELOW: f64 = 0.3;
/// Terms of the series: 0.09¹⁸ is far below round-off.
const TERMS: usize = 18;
/// aⱼ j(j−1)…(j−k+1), aⱼ = (−1)ʲ/(2j+1), of the k-th derivative.
const SERIES: [[f64; TERMS]; 4] = {
    let mut out = [[0.0; TERMS]; 4];
    let mut j = 0;
    while j < TERMS {
        let mut falling = if j % 2 == 0 { 1.0 } else { -1.0 };
        let mut k = 0;
        while k < 4 {
            out[k][j] = falling / (2 * j + 1) as f64;
            falling *= j as f64 - k as f64;
            k += 1;
        }
        j += 1;
    }
    out
};

/// t and its partial derivatives at one point (c, n). Directions are (change of c, change of n).
#[derive(Debug, Clone, Copy)]
pub struct Turn<T> {
    n: [T; 3],
    f: T,
    u: T,
    uu: T,
    uuu: T,
    c: T,
    cc: T,
    cu: T,
    ccc: T,
    ccu: T,
    cuu: T,
}

#[inline(always)]
fn tail<T: Real>(a: &[T; 4]) -> [T; 3] {
    [a[1], a[2], a[3]]
}

impl<T: Real> Turn<T> {
    /// The kernel at x = (c, n).
    pub fn new(x: &[T; 4]) -> Self {
        let (c, n) = (x[0], tail(x));
        let square = dot(&n, &n);
        let total = c * c + square;
        let inverse = total.recip();
        let (inverse2, inverse3) = (inverse * inverse, inverse * inverse * inverse);
        let near =
            c.value() > 0.0 && square.value() < SERIES_BELOW * SERIES_BELOW * c.value() * c.value();
        let [f, u, uu, uuu] = if near {
            let y = square / (c * c);
            let (mut scale, step) = (c.recip() * 2.0, (c * c).recip() * 2.0);
            let mut out = [T::zero(); 4];
            for (k, out) in out.iter_mut().enumerate() {
                // Horner's scheme of Σⱼ aⱼ j(j−1)…(j−k+1) yʲ⁻ᵏ.
                let mut sum = T::zero();
                for a in SERIES[k][k..].iter().rev() {
                    sum = sum * y + *a;
                }
                *out = sum * scale;
                scale *= step;
            }
            out
        } else {
            let length = square.sqrt();
            let over = square.recip();
            let f = length.atan2(c) * 2.0 / length;
            let u = (c * inverse * 2.0 - f) * over;
            let uu = (c * inverse2 * -4.0 - u * 3.0) * over;
            [f, u, uu, (c * inverse3 * 16.0 - uu * 5.0) * over]
        };
        Self {
            n,
            f,
            u,
            uu,
            uuu,
            c: inverse * -2.0,
            cc: c * inverse2 * 4.0,
            cu: inverse2 * 4.0,
            ccc: inverse2 * 4.0 - c * c * inverse3 * 16.0,
            ccu: c * inverse3 * -16.0,
            cuu: inverse3 * -16.0,
        }
    }

    /// t.
    #[inline(always)]
    pub fn value(&self) -> [T; 3] {
        self.n.map(|n| n * self.f)
    }

    /// Change of f along a.
    #[inline(always)]
    fn slope(&self, a: &[T; 4]) -> T {
        self.c * a[0] + self.u * dot(&self.n, &tail(a))
    }

    /// Second change of f along a and b.
    #[inline(always)]
    fn bend(&self, a: &[T; 4], b: &[T; 4]) -> T {
        let (along_a, along_b) = (dot(&self.n, &tail(a)), dot(&self.n, &tail(b)));
        self.cc * a[0] * b[0]
            + self.cu * (a[0] * along_b + b[0] * along_a)
            + self.uu * along_a * along_b
            + self.u * dot(&tail(a), &tail(b))
    }

    /// t′ a.
    #[inline(always)]
    pub fn first(&self, a: &[T; 4]) -> [T; 3] {
        let slope = self.slope(a);
        std::array::from_fn(|k| self.f * a[k + 1] + slope * self.n[k])
    }

    /// t″ a b.
    #[inline(always)]
    pub fn second(&self, a: &[T; 4], b: &[T; 4]) -> [T; 3] {
        let (by_a, by_b, bend) = (self.slope(a), self.slope(b), self.bend(a, b));
        std::array::from_fn(|k| by_a * b[k + 1] + by_b * a[k + 1] + bend * self.n[k])
    }

    /// Changes of f along all arguments.
    #[inline(always)]
    fn slopes(&self) -> [T; 4] {
        let [x, y, z] = self.n;
        [self.c, self.u * x, self.u * y, self.u * z]
    }

    /// Second changes of f along a and all arguments.
    #[inline(always)]
    fn bends(&self, a: &[T; 4]) -> [T; 4] {
        let along = dot(&self.n, &tail(a));
        let mut out = [self.cc * a[0] + self.cu * along; 4];
        for k in 0..3 {
            let n = self.n[k];
            out[k + 1] = self.cu * (a[0] * n) + self.uu * along * n + self.u * a[k + 1];
        }
        out
    }

    /// t′, `[row][argument]`.
    #[inline(always)]
    pub fn first_matrix(&self) -> [[T; 4]; 3] {
        self.matrix(&self.slopes(), &[T::zero(); 4], &[T::zero(); 4], self.f)
    }

    /// t″ a.
    #[inline(always)]
    pub fn second_matrix(&self, a: &[T; 4]) -> [[T; 4]; 3] {
        self.matrix(&self.bends(a), a, &self.slopes(), self.slope(a))
    }

    /// t‴ a a.
    #[inline(always)]
    pub fn third_matrix(&self, a: &[T; 4]) -> [[T; 4]; 3] {
        let (a0, along, aa) = (a[0], dot(&self.n, &tail(a)), dot(&tail(a), &tail(a)));
        let start = self.ccc * a0 * a0 + self.ccu * (a0 * along * 2.0);
        let mut third = [start + self.cuu * (along * along) + self.cu * aa; 4];
        for k in 0..3 {
            let (n, ab) = (self.n[k], a[k + 1]);
            third[k + 1] = self.ccu * (a0 * a0 * n)
                + self.uuu * along * along * n
                + self.cuu * (a0 * along * n * 2.0)
                + self.cu * (a0 * ab * 2.0)
                + self.uu * (aa * n + along * ab * 2.0);
        }
        self.matrix(&third, a, &self.bends(a).map(|x| x * 2.0), self.bend(a, a))
    }

    /// n rᵀ + ā sᵀ + d (0 I) with the last three entries ā of a.
    #[inline(always)]
    fn matrix(&self, r: &[T; 4], a: &[T; 4], s: &[T; 4], d: T) -> [[T; 4]; 3] {
        let mut out = [[T::zero(); 4]; 3];
        for k in 0..3 {
            for l in 0..4 {
                out[k][l] = s[l] * a[k + 1] + r[l] * self.n[k];
            }
            out[k][k + 1] += d;
        }
        out
    }
}

/// Euler parameters of a rotation vector, rad: t of them is the vector again, up to a whole turn.
pub fn exponential(theta: &[f64; 3]) -> [f64; 4] {
    let half = 0.5 * dot(theta, theta).sqrt();
    let (sin, cos) = half.sin_cos();
    let scale = if half > 1e-8 { 0.5 * sin / half } else { 0.5 * (1.0 - half * half / 6.0) };
    [cos, scale * theta[0], scale * theta[1], scale * theta[2]]
}

/// J of ω = J(θ) θ̇, the angular velocity in the axes that θ is given in, and its derivatives at one rotation vector:
/// I + (1 − cos|θ|)/|θ|² θ̃ + (|θ| − sin|θ|)/|θ|³ θ̃².
///
/// With s = θ·θ and cₖ = Σⱼ (−s)ʲ/(k+2j)! it is J a = a + c₂ θ×a + c₃ θ×(θ×a), and cₖ' = ½(k cₖ₊₂ − cₖ₊₁).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TurnRate {
    theta: [f64; 3],
    /// c₂ and c₃ with their first two derivatives.
    c: [[f64; 2]; 3],
}

/// Terms of the series of c₆ and c₇: up to a whole turn what is left is below round-off.
const RATE_TERMS: usize = 17;
/// The same up to 1 rad.
const RATE_TERMS_NEAR: usize = 8;
/// 1/(6+2j)! and 1/(7+2j)!.
const RATE_SERIES: [[f64; 2]; RATE_TERMS] = {
    let mut out = [[1.0 / 720.0, 1.0 / 5040.0]; RATE_TERMS];
    let mut j = 1;
    while j < RATE_TERMS {
        let next = (6 + 2 * j) as f64;
        out[j][0] = out[j - 1][0] / (next * (next - 1.0));
        out[j][1] = out[j - 1][1] / (next * (next + 1.0));
        j += 1;
    }
    out
};

impl TurnRate {
    /// At a rotation vector of at most a whole turn.
    pub fn new(theta: &[f64; 3]) -> Self {
        let s = dot(theta, theta);
        // Σⱼ (−s)ʲ/(k+2j)! by Horner's scheme, for both at once.
        let (mut c6, mut c7) = (0.0, 0.0);
        let terms = if s < 1.0 { RATE_TERMS_NEAR } else { RATE_TERMS };
        for [a, b] in RATE_SERIES[..terms].iter().rev() {
            (c6, c7) = (a - s * c6, b - s * c7);
        }
        let (c4, c5) = (1.0 / 24.0 - s * c6, 1.0 / 120.0 - s * c7);
        let (c2, c3) = (0.5 - s * c4, 1.0 / 6.0 - s * c5);
        let slope = |k: f64, two_up: f64, one_up: f64| 0.5 * (k * two_up - one_up);
        let (c4_s, c5_s) = (slope(4.0, c6, c5), slope(5.0, c7, c6));
        let (c2_s, c3_s) = (slope(2.0, c4, c3), slope(3.0, c5, c4));
        let bend = [slope(2.0, c4_s, c3_s), slope(3.0, c5_s, c4_s)];
        Self { theta: *theta, c: [[c2, c3], [c2_s, c3_s], bend] }
    }

    /// a θ×x + b θ×(θ×x).
    fn turned(&self, [a, b]: [f64; 2], x: &[f64; 3]) -> [f64; 3] {
        let once = cross(&self.theta, x);
        let twice = cross(&self.theta, &once);
        std::array::from_fn(|i| a * once[i] + b * twice[i])
    }

    /// The change of [`TurnRate::turned`] with θ.
    fn turned_by(&self, [a, b]: [f64; 2], d: &[f64; 3], x: &[f64; 3]) -> [f64; 3] {
        let once = cross(d, x);
        let (outer, inner) = (cross(d, &cross(&self.theta, x)), cross(&self.theta, &once));
        std::array::from_fn(|i| a * once[i] + b * (outer[i] + inner[i]))
    }

    /// J.
    pub fn matrix(&self) -> [[f64; 3]; 3] {
        let ([x, y, z], [c2, c3]) = (self.theta, self.c[0]);
        let diagonal = 1.0 - c3 * dot(&self.theta, &self.theta);
        let turn = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
        let square = |i: usize, k: usize| c2 * turn[i][k] + c3 * self.theta[i] * self.theta[k];
        std::array::from_fn(|i| {
            std::array::from_fn(|k| square(i, k) + if i == k { diagonal } else { 0.0 })
        })
    }

    /// J x.
    pub fn times(&self, x: &[f64; 3]) -> [f64; 3] {
        let turned = self.turned(self.c[0], x);
        std::array::from_fn(|i| x[i] + turned[i])
    }

    /// (J x)_θ d.
    pub fn first(&self, d: &[f64; 3], x: &[f64; 3]) -> [f64; 3] {
        let along = 2.0 * dot(&self.theta, d);
        let (a, b) = (self.turned(self.c[1], x), self.turned_by(self.c[0], d, x));
        std::array::from_fn(|i| along * a[i] + b[i])
    }

    /// (J x)_θθ d e.
    pub fn second(&self, d: &[f64; 3], e: &[f64; 3], x: &[f64; 3]) -> [f64; 3] {
        let [by_d, by_e] = [d, e].map(|d| 2.0 * dot(&self.theta, d));
        let plain = self.turned(self.c[1], x);
        let twice = self.turned(self.c[2], x);
        let (of_d, of_e) = (self.turned_by(self.c[1], d, x), self.turned_by(self.c[1], e, x));
        let (inner, outer) = (cross(d, &cross(e, x)), cross(e, &cross(d, x)));
        let product = 2.0 * dot(d, e);
        std::array::from_fn(|i| {
            product * plain[i]
                + by_d * by_e * twice[i]
                + by_d * of_e[i]
                + by_e * of_d[i]
                + self.c[0][1] * (inner[i] + outer[i])
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Random, richardson};
    use num_dual::Dual64;

    /// |n|/c that the checks go through; both sides of the series' end among them.
    const RATIOS: [f64; 8] = [0.0, 1e-9, 1e-4, 0.29, 0.31, 1.0, 14.0, -3.0];

    fn point(random: &mut Random, ratio: f64) -> [f64; 4] {
        let (unit, size) = (random.unit::<3>(), random.range(0.5, 1.5));
        let c = size / (1.0 + ratio * ratio).sqrt() * ratio.signum();
        let n = unit.map(|x| x * c.abs() * ratio.abs());
        [c, n[0], n[1], n[2]]
    }

    fn close(found: &[f64; 3], expected: &[f64; 3], tolerance: f64, what: &str) {
        let size = expected.iter().fold(1.0f64, |m, x| m.max(x.abs()));
        for (a, b) in found.iter().zip(expected) {
            assert!((a - b).abs() <= tolerance * size, "{what}: {a} {b}");
        }
    }

    #[test] // independent truth: dual numbers through the derivative below, and atan2 itself
    fn derivatives_agree_with_dual_numbers_on_both_sides_of_the_series() {
        let mut random = Random::new(5);
        for ratio in RATIOS {
            for _ in 0..20 {
                let x = point(&mut random, ratio);
                let (a, b): ([f64; 4], [f64; 4]) = (random.array(1.0), random.array(1.0));
                let turn = Turn::new(&x);
                let length = (x[1] * x[1] + x[2] * x[2] + x[3] * x[3]).sqrt();
                let angle = 2.0 * length.atan2(x[0]);
                let found = turn.value();
                let size = found.iter().map(|t| t * t).sum::<f64>().sqrt();
                assert!((size - angle).abs() < 1e-14, "|t| at {ratio}");
                // Derivatives of t at n = 0 by dual numbers need the series: both branches are used.
                let at: [Dual64; 4] = std::array::from_fn(|k| Dual64::new(x[k], b[k]));
                let lifted = a.map(Dual64::from);
                let dual = Turn::new(&at);
                let eps = |t: [Dual64; 3]| t.map(|x| x.eps);
                close(&turn.first(&b), &eps(dual.value()), 1e-12, "first");
                close(&turn.second(&a, &b), &eps(dual.first(&lifted)), 1e-11, "second");
                let third = eps(dual.second(&lifted, &lifted));
                let times = |m: [[f64; 4]; 3]| m.map(|row| dot(&row, &b));
                close(&times(turn.third_matrix(&a)), &third, 1e-10, "third");
                close(&times(turn.first_matrix()), &turn.first(&b), 1e-14, "rows of the first");
                let second = times(turn.second_matrix(&a));
                close(&second, &turn.second(&a, &b), 1e-14, "rows of the second");
            }
        }
    }

    #[test] // independent truth: Richardson differences of atan2(|n|, c) n/|n|
    fn the_first_derivative_is_that_of_the_angle() {
        let mut random = Random::new(6);
        for ratio in [0.05, 0.29, 0.31, 2.0, -3.0] {
            let x = point(&mut random, ratio);
            let b: [f64; 4] = random.array(1.0);
            let plain = |s: f64| {
                let y: [f64; 4] = std::array::from_fn(|k| x[k] + s * b[k]);
                let length = (y[1] * y[1] + y[2] * y[2] + y[3] * y[3]).sqrt();
                let angle = 2.0 * length.atan2(y[0]);
                vec![angle * y[1] / length, angle * y[2] / length, angle * y[3] / length]
            };
            let expected = richardson(1e-4, plain);
            let expected = [expected[0], expected[1], expected[2]];
            close(&Turn::new(&x).first(&b), &expected, 1e-8, "first");
        }
    }

    #[test] // independent truth: t(exp θ) = θ, and ω = 2 G ṗ of Euler parameters by differences
    fn the_exponential_inverts_the_kernel_and_has_the_stated_rate() {
        let mut random = Random::new(7);
        for size in [0.0, 1e-9, 5e-3, 0.02, 1.0, 3.0, 3.2, 6.0] {
            let unit = random.unit::<3>();
            let theta = unit.map(|x| x * size);
            let p = exponential(&theta);
            close(&Turn::new(&p).value(), &theta, 1e-14, "inverse");
            let rate: [f64; 3] = random.array(1.0);
            let moved =
                |s: f64| exponential(&std::array::from_fn(|k| theta[k] + s * rate[k])).to_vec();
            let slope = richardson(1e-4, moved);
            let pd = [slope[0], slope[1], slope[2], slope[3]];
            // exp θ turns the second frame against the first: ω in the first axes is 2 E ṗ.
            let expected = crate::math::spatial::e_times(&p, &pd).map(|x| 2.0 * x);
            let found = TurnRate::new(&theta).times(&rate);
            close(&found, &expected, 1e-8, "rate");
        }
    }

    #[test] // independent truth: Richardson differences of J itself
    fn derivatives_of_the_rate_are_those_of_differences() {
        let mut random = Random::new(8);
        for size in [0.0, 1e-6, 0.1, 1.0, 3.0, 4.7] {
            let theta = random.unit::<3>().map(|x| x * size);
            let [d, e, x]: [[f64; 3]; 3] = std::array::from_fn(|_| random.array(1.0));
            let moved = |s: f64, by: &[f64; 3]| -> [f64; 3] {
                std::array::from_fn(|k| theta[k] + s * by[k])
            };
            let three = |v: Vec<f64>| [v[0], v[1], v[2]];
            let at = TurnRate::new(&theta);
            let slope = richardson(1e-3, |s| TurnRate::new(&moved(s, &d)).times(&x).to_vec());
            close(&at.first(&d, &x), &three(slope), 1e-10, "first");
            let slope = richardson(1e-3, |s| TurnRate::new(&moved(s, &e)).first(&d, &x).to_vec());
            close(&at.second(&d, &e, &x), &three(slope), 1e-10, "second");
        }
    }
}
