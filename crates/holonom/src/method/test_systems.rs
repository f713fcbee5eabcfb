//! Small systems with exact dense Jacobians, and a bare run loop, for the tests of the steppers.

use crate::method::ode::{Complex64, EvaluationFailure, LinearizedOde, Ode};
use crate::method::stepper::{Rejection, StepReport, Stepper, initial_step};
use holonom_linalg::DenseComplexLu;

type Slope = Box<dyn Fn(f64, &[f64], &mut [f64]) -> Result<(), EvaluationFailure>>;
type Jacobian = Box<dyn Fn(f64, &[f64]) -> Vec<Vec<f64>>>;
type TimeSlope = Box<dyn Fn(f64, &[f64], &mut [f64])>;

/// ẇ = g(t, w) with g_w and g_t given, weights atol + rtol |w| and counted calls.
pub(crate) struct DenseOde {
    n: usize,
    slope: Slope,
    jacobian: Jacobian,
    time_slope: TimeSlope,
    pub(crate) atol: f64,
    pub(crate) rtol: f64,
    pub(crate) split: usize,
    pub(crate) derivatives: u64,
    pub(crate) linearizations: u64,
    pub(crate) factorizations: u64,
    pub(crate) solves: u64,
    weights: Vec<f64>,
    point: (f64, Vec<f64>),
    j: Vec<Vec<f64>>,
    lu: Vec<Vec<f64>>,
    rows: Vec<usize>,
    complex: DenseComplexLu,
}

impl DenseOde {
    pub(crate) fn fallible(
        n: usize,
        slope: impl Fn(f64, &[f64], &mut [f64]) -> Result<(), EvaluationFailure> + 'static,
        jacobian: impl Fn(f64, &[f64]) -> Vec<Vec<f64>> + 'static,
    ) -> Self {
        Self {
            n,
            slope: Box::new(slope),
            jacobian: Box::new(jacobian),
            time_slope: Box::new(|_, _, g_t| g_t.fill(0.0)),
            atol: 1e-6,
            rtol: 1e-6,
            split: 0,
            derivatives: 0,
            linearizations: 0,
            factorizations: 0,
            solves: 0,
            weights: vec![1.0; n],
            point: (0.0, vec![0.0; n]),
            j: Vec::new(),
            lu: Vec::new(),
            rows: Vec::new(),
            complex: DenseComplexLu::new(n),
        }
    }

    pub(crate) fn new(
        n: usize,
        slope: impl Fn(f64, &[f64], &mut [f64]) + 'static,
        jacobian: impl Fn(f64, &[f64]) -> Vec<Vec<f64>> + 'static,
    ) -> Self {
        let slope = move |t: f64, w: &[f64], g: &mut [f64]| {
            slope(t, w, g);
            Ok(())
        };
        Self::fallible(n, slope, jacobian)
    }

    pub(crate) fn with_time_slope(mut self, f: impl Fn(f64, &[f64], &mut [f64]) + 'static) -> Self {
        self.time_slope = Box::new(f);
        self
    }

    pub(crate) fn with_tolerance(mut self, rtol: f64, atol: f64) -> Self {
        (self.rtol, self.atol) = (rtol, atol);
        self
    }

    pub(crate) fn with_split(mut self, split: usize) -> Self {
        self.split = split;
        self
    }

    /// Weights atol + rtol |w| for the step from `w`.
    pub(crate) fn set_weights(&mut self, w: &[f64]) {
        for (weight, w) in self.weights.iter_mut().zip(w) {
            *weight = self.atol + self.rtol * w.abs();
        }
    }
}

impl Ode for DenseOde {
    fn dimension(&self) -> usize {
        self.n
    }

    fn derivative(&mut self, t: f64, w: &[f64], g: &mut [f64]) -> Result<(), EvaluationFailure> {
        self.derivatives += 1;
        (self.slope)(t, w, g)
    }

    fn norm(&mut self, change: &[f64]) -> f64 {
        let sum: f64 = change.iter().zip(&self.weights).map(|(c, s)| (c / s).powi(2)).sum();
        (sum / self.n.max(1) as f64).sqrt()
    }

    fn second_order_split(&self) -> usize {
        self.split
    }
}

impl LinearizedOde for DenseOde {
    fn linearize(&mut self, t: f64, w: &[f64]) -> Result<(), EvaluationFailure> {
        self.linearizations += 1;
        self.j = (self.jacobian)(t, w);
        self.point = (t, w.to_vec());
        Ok(())
    }

    fn factor(&mut self, gamma_h: f64) -> Result<(), EvaluationFailure> {
        self.factorizations += 1;
        let n = self.n;
        self.lu = (0..n)
            .map(|i| (0..n).map(|k| f64::from(i == k) - gamma_h * self.j[i][k]).collect())
            .collect();
        self.rows = (0..n).collect();
        for k in 0..n {
            let p = (k..n).max_by(|&a, &b| self.lu[a][k].abs().total_cmp(&self.lu[b][k].abs()));
            let p = p.unwrap_or(k);
            if self.lu[p][k] == 0.0 {
                return Err(failure("test/singular"));
            }
            self.lu.swap(k, p);
            self.rows.swap(k, p);
            for i in k + 1..n {
                self.lu[i][k] /= self.lu[k][k];
                for c in k + 1..n {
                    self.lu[i][c] -= self.lu[i][k] * self.lu[k][c];
                }
            }
        }
        Ok(())
    }

    fn solve(&mut self, x: &mut [f64]) {
        self.solves += 1;
        let mut y: Vec<f64> = self.rows.iter().map(|&i| x[i]).collect();
        for i in 0..self.n {
            for k in 0..i {
                y[i] -= self.lu[i][k] * y[k];
            }
        }
        for i in (0..self.n).rev() {
            for k in i + 1..self.n {
                y[i] -= self.lu[i][k] * y[k];
            }
            y[i] /= self.lu[i][i];
        }
        x.copy_from_slice(&y);
    }

    fn factor_complex(&mut self, gamma_h: Complex64) -> Result<(), EvaluationFailure> {
        self.factorizations += 1;
        let entry = |e: usize| {
            let (i, k) = (e / self.n, e % self.n);
            f64::from(i == k) - gamma_h * self.j[i][k]
        };
        let a: Vec<_> = (0..self.n * self.n).map(entry).collect();
        self.complex.factor(&a).map_err(|_| failure("test/singular"))
    }

    fn solve_complex(&mut self, x: &mut [f64], y: &mut [f64]) {
        self.solves += 1;
        let mut b: Vec<_> = x.iter().zip(&*y).map(|(&x, &y)| Complex64::new(x, y)).collect();
        self.complex.solve(&mut b);
        for (i, b) in b.into_iter().enumerate() {
            (x[i], y[i]) = (b.re, b.im);
        }
    }

    fn time_derivative(&mut self, g_t: &mut [f64]) -> Result<(), EvaluationFailure> {
        (self.time_slope)(self.point.0, &self.point.1, g_t);
        Ok(())
    }
}

pub(crate) fn failure(code: &'static str) -> EvaluationFailure {
    EvaluationFailure::new(code, code)
}

/// What a run did.
#[derive(Debug, Default)]
pub(crate) struct Run {
    pub(crate) w: Vec<f64>,
    pub(crate) accepted: u64,
    pub(crate) causes: Vec<Rejection>,
    pub(crate) steps: Vec<f64>,
}

impl Run {
    pub(crate) fn rejected(&self) -> usize {
        self.causes.len()
    }
}

/// Runs from `t0` to `end`. `each` sees every report, with the stepper, after an acceptance also
/// the start time and the step.
pub(crate) fn run_with(
    stepper: &mut dyn Stepper,
    ode: &mut DenseOde,
    t0: f64,
    w0: &[f64],
    end: f64,
    first: Option<f64>,
    mut each: impl FnMut(&mut dyn Stepper, &mut DenseOde, &StepReport, f64, f64),
) -> Run {
    let n = w0.len();
    let (mut t, mut w, mut g) = (t0, w0.to_vec(), vec![0.0; n]);
    ode.derivative(t, &w, &mut g).unwrap();
    ode.set_weights(&w);
    stepper.restart();
    let mut h = first.unwrap_or_else(|| {
        let mut scratch = [vec![0.0; n], vec![0.0; n]];
        initial_step(ode, stepper.starting_order(), t, &w, &g, end - t0, &mut scratch).unwrap()
    });
    let mut run = Run::default();
    while t < end {
        assert!(run.accepted + (run.causes.len() as u64) < 2_000_000, "no end at t = {t}, h = {h}");
        assert!(
            h > 1e-15 * t.abs().max(1e-10),
            "step vanishes at t = {t}: {:?}",
            run.causes.last()
        );
        let last = t + h * (1.0 + 1e-10) >= end;
        let step = if last { end - t } else { h };
        ode.set_weights(&w);
        let report = stepper.attempt(ode, t, step, &w, &g);
        if report.accepted {
            let norm = &mut |x: &[f64]| x.iter().fold(0.0f64, |most, x| most.max(x.abs()));
            stepper.complete_step(&mut |t, w, g| ode.derivative(t, w, g), norm).unwrap();
        }
        each(stepper, ode, &report, t, step);
        h = report.next_step;
        if report.accepted {
            run.accepted += 1;
            run.steps.push(step);
            t = if last { end } else { t + step };
            let reached = stepper.end();
            w.copy_from_slice(reached.w);
            g.copy_from_slice(reached.slope);
        } else {
            run.causes.push(report.cause.clone().unwrap());
        }
    }
    run.w = w;
    run
}

/// Runs from `t0` to `end` and returns what happened.
pub(crate) fn run(
    stepper: &mut dyn Stepper,
    ode: &mut DenseOde,
    t0: f64,
    w0: &[f64],
    end: f64,
    first: Option<f64>,
) -> Run {
    run_with(stepper, ode, t0, w0, end, first, |_, _, _, _, _| ())
}

/// Largest scaled difference.
pub(crate) fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

/// Van der Pol's equation in the stiff scaling: ẏ₂ = μ² [(1 − y₁²) y₂ − y₁/μ²…] of Hairer & Wanner:
/// y₁' = y₂, ε y₂' = (1 − y₁²) y₂ − y₁.
pub(crate) fn van_der_pol(eps: f64) -> DenseOde {
    DenseOde::new(
        2,
        move |_, y, g| {
            g[0] = y[1];
            g[1] = ((1.0 - y[0] * y[0]) * y[1] - y[0]) / eps;
        },
        move |_, y| {
            let row = vec![(-2.0 * y[0] * y[1] - 1.0) / eps, (1.0 - y[0] * y[0]) / eps];
            vec![vec![0.0, 1.0], row]
        },
    )
}

/// Robertson's reaction.
pub(crate) fn robertson() -> DenseOde {
    DenseOde::new(
        3,
        |_, y, g| {
            g[0] = -0.04 * y[0] + 1e4 * y[1] * y[2];
            g[2] = 3e7 * y[1] * y[1];
            g[1] = -g[0] - g[2];
        },
        |_, y| {
            vec![
                vec![-0.04, 1e4 * y[2], 1e4 * y[1]],
                vec![0.04, -1e4 * y[2] - 6e7 * y[1], -1e4 * y[1]],
                vec![0.0, 6e7 * y[1], 0.0],
            ]
        },
    )
}

/// y' = λ (y − sin t) + cos t with y(0) = 0: the solution is sin t for every λ.
pub(crate) fn prothero_robinson(lambda: f64) -> DenseOde {
    DenseOde::new(
        1,
        move |t, y, g| g[0] = lambda * (y[0] - t.sin()) + t.cos(),
        move |_, _| vec![vec![lambda]],
    )
    .with_time_slope(move |t, _, g_t| g_t[0] = -lambda * t.cos() - t.sin())
}

/// A smooth nonlinear system with explicit time dependence and the solution x = exp(sin t²),
/// y = exp(5 sin t²), z = sin t² + 1, u = cos t²: ẋ = 2t y^(1/5) u, ẏ = 10 t exp(5(z − 1)) u,
/// ż = 2tu, u̇ = −2t ln x.
pub(crate) fn non_autonomous() -> DenseOde {
    let slope = |t: f64, w: &[f64], g: &mut [f64]| {
        g[0] = 2.0 * t * w[1].powf(0.2) * w[3];
        g[1] = 10.0 * t * (5.0 * (w[2] - 1.0)).exp() * w[3];
        g[2] = 2.0 * t * w[3];
        g[3] = -2.0 * t * w[0].ln();
    };
    DenseOde::new(4, slope, |t, w| {
        let e = (5.0 * (w[2] - 1.0)).exp();
        vec![
            vec![0.0, 0.4 * t * w[1].powf(-0.8) * w[3], 0.0, 2.0 * t * w[1].powf(0.2)],
            vec![0.0, 0.0, 50.0 * t * e * w[3], 10.0 * t * e],
            vec![0.0, 0.0, 0.0, 2.0 * t],
            vec![-2.0 * t / w[0], 0.0, 0.0, 0.0],
        ]
    })
    .with_time_slope(move |t, w, g_t| {
        slope(t, w, g_t); // every slope is proportional to t
        for g in g_t.iter_mut() {
            *g /= t;
        }
    })
}

/// Exact solution of [`non_autonomous`].
pub(crate) fn non_autonomous_solution(t: f64) -> [f64; 4] {
    let (s, c) = (t * t).sin_cos();
    [s.exp(), (5.0 * s).exp(), s + 1.0, c]
}

/// Plane pendulum φ̈ = −sin φ: w = (φ, φ̇).
pub(crate) fn pendulum() -> DenseOde {
    DenseOde::new(
        2,
        |_, w, g| {
            g[0] = w[1];
            g[1] = -w[0].sin();
        },
        |_, w| vec![vec![0.0, 1.0], vec![-w[0].cos(), 0.0]],
    )
    .with_split(1)
}

/// Excentricity of [`kepler`].
const KEPLER_E: f64 = 0.3;

/// Kepler's problem, r̈ = −r/|r|³: w = (x, y, ẋ, ẏ).
pub(crate) fn kepler() -> DenseOde {
    DenseOde::new(
        4,
        |_, w, g| {
            let cube = w[0].hypot(w[1]).powi(3);
            (g[0], g[1], g[2], g[3]) = (w[2], w[3], -w[0] / cube, -w[1] / cube);
        },
        |_, w| {
            let r = w[0].hypot(w[1]);
            let k =
                |i: usize, j: usize| 3.0 * w[i] * w[j] / r.powi(5) - f64::from(i == j) / r.powi(3);
            vec![
                vec![0.0, 0.0, 1.0, 0.0],
                vec![0.0, 0.0, 0.0, 1.0],
                vec![k(0, 0), k(0, 1), 0.0, 0.0],
                vec![k(1, 0), k(1, 1), 0.0, 0.0],
            ]
        },
    )
    .with_split(2)
}

/// Solution of [`kepler`] from the pericentre, by Kepler's equation t = E − e sin E.
pub(crate) fn kepler_solution(t: f64) -> [f64; 4] {
    let e = KEPLER_E;
    let mut anomaly = t;
    for _ in 0..50 {
        anomaly -= (anomaly - e * anomaly.sin() - t) / (1.0 - e * anomaly.cos());
    }
    let (s, c) = anomaly.sin_cos();
    let b = (1.0 - e * e).sqrt();
    let rate = 1.0 / (1.0 - e * c);
    [c - e, b * s, -s * rate, b * c * rate]
}
