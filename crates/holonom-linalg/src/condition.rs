//! How near to singular a factored matrix is.

/// Estimate of ‖A‖₁‖A⁻¹‖₁ from the sums of magnitudes of A's columns in `x`, which is scratch afterwards, and
/// solves in place with A or, where told so, its transpose. Never above the true number (but for
/// round-off), seldom below a third of it.
///
/// Source: Hager (1984), Higham, *ACM Trans. Math. Softw.* 14 (1988), algorithm 674.
pub(crate) fn condition_estimate(x: &mut [f64], mut solve: impl FnMut(&mut [f64], bool)) -> f64 {
    let n = x.len();
    if n == 0 {
        return 1.0;
    }
    let norm = x.iter().fold(0.0f64, |m, v| m.max(*v));
    x.fill(1.0 / n as f64);
    let mut inverse_norm = 0.0f64;
    let mut last = usize::MAX;
    for _ in 0..5 {
        solve(x, false);
        let size: f64 = x.iter().map(|v| v.abs()).sum();
        if size <= inverse_norm {
            break;
        }
        inverse_norm = size;
        for v in &mut *x {
            *v = v.signum();
        }
        solve(x, true);
        let at = (0..n).fold(0, |m, i| if x[i].abs() > x[m].abs() { i } else { m });
        if at == last {
            break;
        }
        last = at;
        x.fill(0.0);
        x[at] = 1.0;
    }
    // A second lower bound that is not fooled by cancellation in the first.
    for (i, x) in x.iter_mut().enumerate() {
        let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
        *x = sign * (1.0 + i as f64 / (n.max(2) - 1) as f64);
    }
    solve(x, false);
    let size: f64 = x.iter().map(|v| v.abs()).sum();
    norm * inverse_norm.max(2.0 * size / (3.0 * n as f64))
}
