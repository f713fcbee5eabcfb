//! Sine and cosine of moderate angles, in line where kernels turn vectors by the thousand.

/// Beyond this magnitude the multiples of π/2 taken off are no longer exact.
const LIMIT: f64 = 1e5;

/// Bits 1 to 33, 34 to 66 and the rest of π/2.
const HALF_PI: [f64; 3] =
    [1.570_796_326_734_125_6, 6.077_100_506_303_966e-11, 2.022_266_248_795_950_6e-21];

/// Adding and taking off this number rounds to the nearest integer.
const ROUND: f64 = 1.5 / f64::EPSILON;

/// (sin x, cos x) to one unit in the last place, the same bits on every machine.
///
/// Source: the kernels of FDLIBM, K. C. Ng, Sun Microsystems (1993): reduction to ±π/4 in two rounds,
/// polynomials of degree 13 and 14.
#[inline(always)]
pub(super) fn sin_cos(x: f64) -> (f64, f64) {
    if x.abs() > LIMIT || x.is_nan() {
        return x.sin_cos();
    }
    let n = (x * std::f64::consts::FRAC_2_PI + ROUND) - ROUND;
    let first = x - n * HALF_PI[0];
    let second = first - n * HALF_PI[1];
    let tail = n * HALF_PI[2] - ((first - second) - n * HALF_PI[1]);
    let y = second - tail;
    let (s, c) = near_zero(y, (second - y) - tail);
    match n as i64 & 3 {
        0 => (s, c),
        1 => (c, -s),
        2 => (-s, -c),
        _ => (-c, s),
    }
}

/// (sin, cos) of y + tail for |y| ≤ π/4.
#[inline(always)]
#[rustfmt::skip] // one polynomial on one line
fn near_zero(y: f64, tail: f64) -> (f64, f64) {
    let z = y * y;
    let w = z * z;
    let r = 8.333_333_333_322_49e-3 + z * (-1.984_126_982_985_795e-4 + z * 2.755_731_370_707_006_8e-6)
        + z * w * (-2.505_076_025_340_686_3e-8 + z * 1.589_690_995_211_55e-10);
    let v = z * y;
    let sine = y - ((z * (0.5 * tail - v * r) - tail) + v * 1.666_666_666_666_663_2e-1);
    let r = z * (4.166_666_666_666_66e-2 + z * (-1.388_888_888_887_411e-3 + z * 2.480_158_728_947_673e-5))
        + w * w * (-2.755_731_435_139_066_3e-7 + z * (2.087_572_321_298_175e-9 + z * -1.135_964_755_778_819_5e-11));
    let half = 0.5 * z;
    let most = 1.0 - half;
    (sine, most + (((1.0 - most) - half) + (z * r - y * tail)))
}

#[cfg(test)]
mod tests {
    use super::sin_cos;

    #[test] // independent truth: the C library
    fn it_agrees_with_the_library_to_a_unit_in_the_last_place() {
        let close = |a: f64, b: f64| (a - b).abs() <= f64::EPSILON * b.abs();
        let mut x = 1e-9f64;
        while x < 2e5 {
            for x in
                [x, -x, (x / std::f64::consts::FRAC_PI_4).round() * std::f64::consts::FRAC_PI_4]
            {
                let ((s, c), (sine, cosine)) = (sin_cos(x), x.sin_cos());
                assert!(
                    close(s, sine) && close(c, cosine),
                    "{x:e}: {s:e} {sine:e}, {c:e} {cosine:e}"
                );
            }
            x *= 1.0003;
        }
        assert_eq!(sin_cos(0.0), (0.0, 1.0));
        assert!(sin_cos(f64::NAN).0.is_nan() && sin_cos(f64::INFINITY).1.is_nan());
    }
}
