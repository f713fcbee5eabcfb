//! Dense output of implicit formulas.

use super::stepper::add_scaled;

/// w(θ) of coefficients from θ⁰ on, one after the other; the same bits as those of the stepper that wrote
/// them, if it is an implicit one.
pub fn interpolate(coefficients: &[f64], theta: f64, w: &mut [f64]) {
    if w.is_empty() {
        return;
    }
    let (start, powers) = coefficients.split_at(w.len());
    w.copy_from_slice(start);
    add_powers(powers.chunks_exact(w.len()), theta, w);
}

/// w ← w + Σⱼ θʲ powers[j−1].
fn add_powers<'a>(powers: impl Iterator<Item = &'a [f64]>, theta: f64, w: &mut [f64]) {
    let mut power = 1.0;
    for coefficient in powers {
        power *= theta;
        add_scaled(w, power, coefficient);
    }
}

/// Solution over one step: w(θ) = start + Σⱼ θʲ powers[j−1], 0 ≤ θ ≤ 1.
#[derive(Debug, Clone)]
pub struct Segment {
    /// Length of the step, s.
    pub(super) step: f64,
    start: Vec<f64>,
    powers: Vec<Vec<f64>>,
}

impl Segment {
    /// Polynomials of `degree` for `dimension` unknowns.
    pub(super) fn new(dimension: usize, degree: usize) -> Self {
        Self { step: 0.0, start: vec![0.0; dimension], powers: vec![vec![0.0; dimension]; degree] }
    }

    /// Starts a step of length `h` from `w`, as a constant.
    pub(super) fn begin(&mut self, h: f64, w: &[f64]) {
        self.step = h;
        self.start.copy_from_slice(w);
        self.powers.iter_mut().for_each(|power| power.fill(0.0));
    }

    /// Adds x times the polynomial with the coefficients scale · weights.
    pub(super) fn add(&mut self, scale: f64, weights: &[f64], x: &[f64]) {
        for (power, weight) in self.powers.iter_mut().zip(weights) {
            add_scaled(power, scale * weight, x);
        }
    }

    /// Makes entry `i` linear.
    pub(super) fn set_linear(&mut self, i: usize, change: f64) {
        self.powers[0][i] = change;
    }

    /// Makes entry `i` the cubic with this change over the step and h ẇ at both ends.
    pub(super) fn set_cubic(&mut self, i: usize, change: f64, [first, last]: [f64; 2]) {
        self.powers[0][i] = first;
        self.powers[1][i] = 3.0 * change - 2.0 * first - last;
        self.powers[2][i] = first + last - 2.0 * change;
    }

    /// Makes entry `i` the quintic with this change over the step, h ẇ and h² ẅ at both ends.
    pub(super) fn set_quintic(&mut self, i: usize, change: f64, slope: [f64; 2], bend: [f64; 2]) {
        self.powers[0][i] = slope[0];
        self.powers[1][i] = 0.5 * bend[0];
        // What the parabola from the start lacks at the end.
        let gap = change - slope[0] - 0.5 * bend[0];
        let turn = slope[1] - slope[0] - bend[0];
        let bend = bend[1] - bend[0];
        self.powers[2][i] = 10.0 * gap - 4.0 * turn + 0.5 * bend;
        self.powers[3][i] = -15.0 * gap + 7.0 * turn - bend;
        self.powers[4][i] = 6.0 * gap - 3.0 * turn + 0.5 * bend;
    }

    /// Adds x in the middle and nothing at the ends.
    pub(super) fn bulge(&mut self, x: &[f64]) {
        self.add(4.0, &[1.0, -1.0], x);
    }

    /// w(θ).
    pub(super) fn interpolate(&self, theta: f64, w: &mut [f64]) {
        w.copy_from_slice(&self.start);
        add_powers(self.powers.iter().map(Vec::as_slice), theta, w);
    }

    /// Number of powers.
    pub(super) fn degree(&self) -> usize {
        self.powers.len()
    }

    /// The coefficients from θ⁰ on, one after the other.
    pub(super) fn write(&self, coefficients: &mut [f64]) {
        let all = std::iter::once(&self.start).chain(&self.powers);
        for (out, coefficient) in coefficients.chunks_exact_mut(self.start.len().max(1)).zip(all) {
            out.copy_from_slice(coefficient);
        }
    }

    /// w(1 + s/h) − w(1): the polynomial continued by `s` beyond the end of the step.
    pub(super) fn continue_by(&self, s: f64, change: &mut [f64]) {
        change.fill(0.0);
        let theta = 1.0 + s / self.step;
        let mut power = 1.0;
        for coefficient in &self.powers {
            power *= theta;
            add_scaled(change, power - 1.0, coefficient);
        }
    }

    /// The slope ẇ by `s` beyond the end of the step.
    pub(super) fn slope_beyond(&self, s: f64, slope: &mut [f64]) {
        slope.fill(0.0);
        let theta = 1.0 + s / self.step;
        let mut weight = 1.0 / self.step;
        for (j, coefficient) in self.powers.iter().enumerate() {
            add_scaled(slope, (j + 1) as f64 * weight, coefficient);
            weight *= theta;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // truth: polynomials and their derivatives
    fn reproduces_lines_cubics_and_quintics_inside_and_beyond_a_step() {
        let x = |t: f64| t.powi(5) - 2.0 * t.powi(3) + t;
        let v = |t: f64| 5.0 * t.powi(4) - 6.0 * t * t + 1.0;
        let a = |t: f64| 20.0 * t.powi(3) - 12.0 * t;
        let y = |t: f64| 3.0 * t.powi(3) - t * t + 7.0;
        let y_rate = |t: f64| 9.0 * t * t - 2.0 * t;
        let z = |t: f64| 2.0 - 3.0 * t;
        let (t0, h) = (0.4, 0.7);
        let t1 = t0 + h;
        let mut segment = Segment::new(3, 5);
        segment.begin(h, &[x(t0), y(t0), z(t0)]);
        let bends = [h * h * a(t0), h * h * a(t1)];
        segment.set_quintic(0, x(t1) - x(t0), [h * v(t0), h * v(t1)], bends);
        segment.set_cubic(1, y(t1) - y(t0), [h * y_rate(t0), h * y_rate(t1)]);
        segment.set_linear(2, z(t1) - z(t0));
        let (mut w, mut change) = ([0.0; 3], [0.0; 3]);
        for theta in [0.0, 0.3, 0.6, 1.0] {
            let t = t0 + theta * h;
            segment.interpolate(theta, &mut w);
            for (w, truth) in w.iter().zip([x(t), y(t), z(t)]) {
                assert!((w - truth).abs() < 1e-14, "{w} instead of {truth} at θ = {theta}");
            }
            // Beyond the end the terms of the quintic grow as 2⁵.
            segment.continue_by(theta * h, &mut change);
            segment.slope_beyond(theta * h, &mut w);
            let t = t1 + theta * h;
            for (slope, truth) in w.iter().zip([v(t), y_rate(t), -3.0]) {
                assert!((slope - truth).abs() < 1e-11, "{slope} instead of {truth} at t = {t}");
            }
            for (change, truth) in change.iter().zip([x(t) - x(t1), y(t) - y(t1), z(t) - z(t1)]) {
                assert!((change - truth).abs() < 1e-12, "{change} instead of {truth} at t = {t}");
            }
        }
    }
}
