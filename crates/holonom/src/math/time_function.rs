//! Functions of time with three derivatives.

use super::{Real, Spline, TableError};

/// A function of time for drivers and applied forces.
#[derive(Debug, Clone, PartialEq)]
pub enum TimeFunction {
    /// A constant.
    Constant(f64),
    /// Σ cₖ (t − start)ᵏ.
    Polynomial {
        /// cₖ, from k = 0.
        coefficients: Vec<f64>,
        /// s.
        start: f64,
    },
    /// offset + amplitude · sin(ω t + phase).
    Harmonic {
        /// Amplitude.
        amplitude: f64,
        /// ω, rad/s.
        angular_frequency: f64,
        /// rad.
        phase: f64,
        /// Mean value.
        offset: f64,
    },
    /// From `from` before `start` to `to` after `end` by the quintic 10 s³ − 15 s⁴ + 6 s⁵, C2.
    SmoothStep {
        /// Value before `start`.
        from: f64,
        /// Value after `end`.
        to: f64,
        /// s.
        start: f64,
        /// s, later than `start`.
        end: f64,
    },
    /// C2 spline through a table.
    Table {
        /// The spline. Boxed: every driver, applied force and angle has room for its motion.
        spline: Box<Spline>,
        /// Where the table is written, for messages: `tables.lift`; may be empty.
        name: String,
    },
}

impl TimeFunction {
    /// C2 spline through a table; `name` says in messages where it is written.
    ///
    /// # Errors
    /// As [`Spline::new`].
    pub fn table(times: Vec<f64>, values: Vec<f64>, name: &str) -> Result<Self, TableError> {
        let spline = Box::new(Spline::new(times, values)?);
        Ok(Self::Table { spline, name: name.to_owned() })
    }

    /// Value and first three derivatives at `t`.
    pub fn derivatives(&self, t: f64) -> [f64; 4] {
        match self {
            Self::Constant(value) => [*value, 0.0, 0.0, 0.0],
            Self::Polynomial { coefficients, start } => {
                let s = t - start;
                let mut d = [0.0; 4];
                // Horner for the value and its derivatives at once.
                for c in coefficients.iter().rev() {
                    d[3] = d[3] * s + 3.0 * d[2];
                    d[2] = d[2] * s + 2.0 * d[1];
                    d[1] = d[1] * s + d[0];
                    d[0] = d[0] * s + c;
                }
                d
            }
            Self::Harmonic { amplitude, angular_frequency: w, phase, offset } => {
                let (sin, cos) = (w * t + phase).sin_cos();
                [
                    offset + amplitude * sin,
                    amplitude * w * cos,
                    -amplitude * w * w * sin,
                    -amplitude * w * w * w * cos,
                ]
            }
            Self::SmoothStep { from, to, start, end } => {
                let length = end - start;
                let s = (t - start) / length;
                let rise = to - from;
                if s <= 0.0 {
                    [*from, 0.0, 0.0, 0.0]
                } else if s >= 1.0 {
                    [*to, 0.0, 0.0, 0.0]
                } else {
                    [
                        from + rise * s * s * s * (10.0 + s * (-15.0 + 6.0 * s)),
                        rise * s * s * (30.0 + s * (-60.0 + 30.0 * s)) / length,
                        rise * s * (60.0 + s * (-180.0 + 120.0 * s)) / length.powi(2),
                        rise * (60.0 + s * (-360.0 + 360.0 * s)) / length.powi(3),
                    ]
                }
            }
            Self::Table { spline, .. } => spline.derivatives(t),
        }
    }

    /// Value and slope at `t`, with their dependence on `t` where the scalar carries one.
    pub fn value_and_slope<T: Real>(&self, t: T) -> (T, T) {
        let d = self.derivatives(t.value());
        let beyond = t - t.value();
        (beyond * d[1] + d[0], beyond * d[2] + d[1])
    }

    /// Times at which a third or lower derivative jumps; the run makes them step boundaries.
    pub fn breakpoints(&self) -> Vec<f64> {
        match self {
            Self::Constant(_) | Self::Polynomial { .. } | Self::Harmonic { .. } => Vec::new(),
            Self::SmoothStep { start, end, .. } => vec![*start, *end],
            Self::Table { spline, .. } => spline.knots().to_vec(),
        }
    }

    /// Whether the function does not change with time.
    pub fn is_constant(&self) -> bool {
        matches!(self, Self::Constant(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test] // independent truth: central differences
    fn derivatives_are_the_derivatives() {
        let functions = [
            TimeFunction::Polynomial { coefficients: vec![1.0, -2.0, 0.5, 0.7, -0.3], start: 0.2 },
            TimeFunction::Harmonic {
                amplitude: 2.0,
                angular_frequency: 3.0,
                phase: 0.4,
                offset: 1.0,
            },
            TimeFunction::SmoothStep { from: 1.0, to: -2.0, start: 0.0, end: 2.0 },
        ];
        let h = 1e-5;
        for f in &functions {
            for t in [0.3, 0.9, 1.7] {
                let d = f.derivatives(t);
                let (a, b) = (f.derivatives(t + h), f.derivatives(t - h));
                for k in 0..3 {
                    let difference = (a[k] - b[k]) / (2.0 * h);
                    assert!((d[k + 1] - difference).abs() < 1e-6, "{f:?} {t} {k}");
                }
            }
        }
    }

    #[test]
    fn smooth_step_joins_its_ends_with_two_derivatives() {
        let f = TimeFunction::SmoothStep { from: 1.0, to: 3.0, start: 0.0, end: 2.0 };
        for (t, value) in [(1e-9, 1.0), (2.0 - 1e-9, 3.0)] {
            let d = f.derivatives(t);
            assert!((d[0] - value).abs() < 1e-12 && d[1].abs() < 1e-6 && d[2].abs() < 1e-6);
        }
    }
}
