//! Piecewise cubics through tables: monotone C1 for force laws, C2 for motions.

use super::Real;

/// Why a table cannot be interpolated.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TableError {
    /// Lengths differ or fewer than two points.
    #[error("a table needs two or more points and as many values; it has {points} and {values}")]
    Size {
        /// Number of abscissas.
        points: usize,
        /// Number of ordinates.
        values: usize,
    },
    /// Abscissas must increase.
    #[error("abscissas must increase; entry {index} is {value} after {before}")]
    Order {
        /// Index of the offending entry.
        index: usize,
        /// Its value.
        value: f64,
        /// The value before it.
        before: f64,
    },
    /// Entries must be finite.
    #[error("entry {index} is not a finite number")]
    NotFinite {
        /// Index of the offending entry.
        index: usize,
    },
}

fn check(x: &[f64], y: &[f64]) -> Result<(), TableError> {
    if x.len() != y.len() || x.len() < 2 {
        return Err(TableError::Size { points: x.len(), values: y.len() });
    }
    if let Some(index) = x.iter().zip(y).position(|(a, b)| !a.is_finite() || !b.is_finite()) {
        return Err(TableError::NotFinite { index });
    }
    match x.windows(2).position(|w| w[1] <= w[0]) {
        Some(i) => Err(TableError::Order { index: i + 1, value: x[i + 1], before: x[i] }),
        None => Ok(()),
    }
}

/// Index of the interval that holds `x`; the first or last one outside.
fn interval(knots: &[f64], x: f64) -> usize {
    knots.partition_point(|&k| k <= x).clamp(1, knots.len() - 1) - 1
}

/// Monotone C1 cubic through a table, continued linearly outside.
///
/// Source: F. N. Fritsch, J. Butland, *A method for constructing local monotone piecewise cubic
/// interpolants*, SIAM J. Sci. Stat. Comput. 5 (1984); three-point end slopes as in PCHIP.
#[derive(Debug, Clone, PartialEq)]
pub struct MonotoneCubic {
    x: Vec<f64>,
    y: Vec<f64>,
    slope: Vec<f64>,
    /// ∫ from x[0] to x[i].
    area: Vec<f64>,
}

impl MonotoneCubic {
    /// # Errors
    /// [`TableError`] when sizes differ, abscissas do not increase or an entry is not finite.
    pub fn new(x: Vec<f64>, y: Vec<f64>) -> Result<Self, TableError> {
        check(&x, &y)?;
        let n = x.len();
        let h: Vec<f64> = x.windows(2).map(|w| w[1] - w[0]).collect();
        let d: Vec<f64> = (0..n - 1).map(|i| (y[i + 1] - y[i]) / h[i]).collect();
        let mut slope = vec![d[0]; n];
        if n > 2 {
            for i in 1..n - 1 {
                slope[i] = if d[i - 1] * d[i] <= 0.0 {
                    0.0
                } else {
                    let (a, b) = (2.0 * h[i] + h[i - 1], h[i] + 2.0 * h[i - 1]);
                    (a + b) / (a / d[i - 1] + b / d[i])
                };
            }
            slope[0] = end_slope(h[0], h[1], d[0], d[1]);
            slope[n - 1] = end_slope(h[n - 2], h[n - 3], d[n - 2], d[n - 3]);
        }
        let mut area = vec![0.0; n];
        for i in 0..n - 1 {
            area[i + 1] = area[i]
                + h[i] * (y[i] + y[i + 1]) / 2.0
                + h[i] * h[i] * (slope[i] - slope[i + 1]) / 12.0;
        }
        Ok(Self { x, y, slope, area })
    }

    /// Abscissas.
    pub fn knots(&self) -> &[f64] {
        &self.x
    }

    /// Ordinates at the knots.
    pub fn values(&self) -> &[f64] {
        &self.y
    }

    /// Value and slope at `x`.
    pub fn value_and_slope<T: Real>(&self, x: T) -> (T, T) {
        let at = x.value();
        let last = self.x.len() - 1;
        if at < self.x[0] || at > self.x[last] {
            let i = if at < self.x[0] { 0 } else { last };
            let s = T::from(self.slope[i]);
            return ((x - self.x[i]) * s + self.y[i], s);
        }
        let i = interval(&self.x, at);
        let h = self.x[i + 1] - self.x[i];
        let (y0, y1) = (self.y[i], self.y[i + 1]);
        let (m0, m1) = (self.slope[i] * h, self.slope[i + 1] * h);
        let s = (x - self.x[i]) / h;
        // y = y0 + s (m0 + s (c2 + s c3))
        let c2 = 3.0 * (y1 - y0) - 2.0 * m0 - m1;
        let c3 = 2.0 * (y0 - y1) + m0 + m1;
        let value = (((s * c3) + c2) * s + m0) * s + y0;
        let slope = (((s * (3.0 * c3)) + 2.0 * c2) * s + m0) / h;
        (value, slope)
    }

    /// ∫ from 0 to `x` (from the first knot where 0 lies before it): the stored energy of a law.
    pub fn integral(&self, x: f64) -> f64 {
        self.area_to(x) - self.area_to(0.0)
    }

    fn area_to(&self, x: f64) -> f64 {
        let last = self.x.len() - 1;
        if x < self.x[0] || x > self.x[last] {
            let i = if x < self.x[0] { 0 } else { last };
            let d = x - self.x[i];
            return self.area[i] + d * (self.y[i] + 0.5 * self.slope[i] * d);
        }
        let i = interval(&self.x, x);
        let h = self.x[i + 1] - self.x[i];
        let (y0, y1) = (self.y[i], self.y[i + 1]);
        let (m0, m1) = (self.slope[i] * h, self.slope[i + 1] * h);
        let s = (x - self.x[i]) / h;
        let c2 = 3.0 * (y1 - y0) - 2.0 * m0 - m1;
        let c3 = 2.0 * (y0 - y1) + m0 + m1;
        self.area[i] + h * s * (y0 + s * (m0 / 2.0 + s * (c2 / 3.0 + s * c3 / 4.0)))
    }
}

/// Three-point end slope that keeps the shape (PCHIP).
fn end_slope(h0: f64, h1: f64, d0: f64, d1: f64) -> f64 {
    let s = ((2.0 * h0 + h1) * d0 - h0 * d1) / (h0 + h1);
    if s * d0 <= 0.0 {
        0.0
    } else if d0 * d1 <= 0.0 && s.abs() > 3.0 * d0.abs() {
        3.0 * d0
    } else {
        s
    }
}

/// C2 cubic through a table with natural ends; constant continuation is refused by the caller, who
/// sees to it that the table covers the run, so the end cubics simply continue.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    x: Vec<f64>,
    y: Vec<f64>,
    second: Vec<f64>,
}

impl Spline {
    /// # Errors
    /// As [`MonotoneCubic::new`].
    pub fn new(x: Vec<f64>, y: Vec<f64>) -> Result<Self, TableError> {
        check(&x, &y)?;
        let n = x.len();
        let mut second = vec![0.0; n];
        // Tridiagonal system of the second derivatives, eliminated downwards.
        let mut factor = vec![0.0; n];
        for i in 1..n - 1 {
            let (h0, h1) = (x[i] - x[i - 1], x[i + 1] - x[i]);
            let right = 6.0 * ((y[i + 1] - y[i]) / h1 - (y[i] - y[i - 1]) / h0);
            let pivot = 2.0 * (h0 + h1) - h0 * factor[i - 1];
            factor[i] = h1 / pivot;
            second[i] = (right - h0 * second[i - 1]) / pivot;
        }
        for i in (1..n - 1).rev() {
            second[i] -= factor[i] * second[i + 1];
        }
        Ok(Self { x, y, second })
    }

    /// Abscissas.
    pub fn knots(&self) -> &[f64] {
        &self.x
    }

    /// Value and first three derivatives at `x`.
    pub fn derivatives(&self, x: f64) -> [f64; 4] {
        let i = interval(&self.x, x);
        let h = self.x[i + 1] - self.x[i];
        let (y0, y1, m0, m1) = (self.y[i], self.y[i + 1], self.second[i], self.second[i + 1]);
        let d = x - self.x[i];
        let b = (y1 - y0) / h - h * (2.0 * m0 + m1) / 6.0;
        let c3 = (m1 - m0) / h;
        [y0 + d * (b + d * (m0 / 2.0 + d * c3 / 6.0)), b + d * (m0 + d * c3 / 2.0), m0 + d * c3, c3]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: the cubic itself, and central differences
    fn monotone_cubic_passes_through_its_table_and_its_slope_is_its_derivative() {
        let x = vec![-0.2, -0.1, 0.05, 0.1, 0.3];
        let y = vec![-9.0, -2.0, 0.0, 0.5, 7.0];
        let law = MonotoneCubic::new(x.clone(), y.clone()).unwrap();
        for (a, b) in x.iter().zip(&y) {
            assert!((law.value_and_slope(*a).0 - b).abs() < 1e-12);
        }
        let h = 1e-6;
        for k in 0..140 {
            let at = -0.35 + 0.0051 * f64::from(k);
            let (_, slope) = law.value_and_slope(at);
            let difference =
                (law.value_and_slope(at + h).0 - law.value_and_slope(at - h).0) / (2.0 * h);
            assert!((slope - difference).abs() < 1e-3, "{at}: {slope} {difference}");
            let area = (law.integral(at + h) - law.integral(at - h)) / (2.0 * h);
            assert!((law.value_and_slope(at).0 - area).abs() < 1e-7, "{at}");
            assert!(slope >= 0.0, "monotone data give a monotone law");
        }
    }

    #[test] // independent truth: sin and its derivatives
    fn spline_follows_a_smooth_function_with_its_derivatives() {
        let x: Vec<f64> = (0..=200).map(|i| f64::from(i) * std::f64::consts::PI / 100.0).collect();
        let y = x.iter().map(|v| v.sin()).collect();
        let spline = Spline::new(x, y).unwrap();
        for k in 1..60 {
            let t = 0.1 * f64::from(k) + 0.013;
            let d = spline.derivatives(t);
            assert!((d[0] - t.sin()).abs() < 1e-8);
            assert!((d[1] - t.cos()).abs() < 1e-5);
            assert!((d[2] + t.sin()).abs() < 1e-3);
        }
    }

    #[test]
    fn tables_that_cannot_serve_are_refused() {
        assert!(matches!(
            MonotoneCubic::new(vec![0.0, 0.0], vec![1.0, 2.0]),
            Err(TableError::Order { index: 1, .. })
        ));
        assert!(matches!(Spline::new(vec![0.0], vec![1.0]), Err(TableError::Size { .. })));
        assert!(matches!(
            MonotoneCubic::new(vec![0.0, 1.0], vec![1.0, f64::NAN]),
            Err(TableError::NotFinite { index: 1 })
        ));
    }
}
