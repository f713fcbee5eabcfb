//! Integrators that share nothing with the engine, and minimal-coordinate equations of motion for them: what
//! the engine's runs are held against.

use num_dual::{Dual2_64, Dual64, DualNum, HyperDual64};

/// Right-hand side y' = f(t, y).
pub(crate) type Rate<'a> = dyn Fn(f64, &[f64]) -> Vec<f64> + 'a;

/// Rows of the tableau of DOP853: Hairer, Nørsett, Wanner, *Solving ODEs I*, 2nd ed., section II.5 and code
/// `dop853.f`; pairs (column, coefficient).
#[rustfmt::skip]
const A: [&[(usize, f64)]; 12] = [
    &[],
    &[(0, 0.05260015195876773)],
    &[(0, 0.0197250569845379), (1, 0.0591751709536137)],
    &[(0, 0.02958758547680685), (2, 0.08876275643042054)],
    &[(0, 0.2413651341592667), (2, -0.8845494793282861), (3, 0.924834003261792)],
    &[(0, 0.037037037037037035), (3, 0.17082860872947386), (4, 0.12546768756682242)],
    &[(0, 0.037109375), (3, 0.17025221101954405), (4, 0.06021653898045596), (5, -0.017578125)],
    &[(0, 0.03709200011850479), (3, 0.17038392571223998), (4, 0.10726203044637328), (5, -0.015319437748624402), (6, 0.008273789163814023)],
    &[(0, 0.6241109587160757), (3, -3.3608926294469414), (4, -0.868219346841726), (5, 27.59209969944671), (6, 20.154067550477894), (7, -43.48988418106996)],
    &[(0, 0.47766253643826434), (3, -2.4881146199716677), (4, -0.590290826836843), (5, 21.230051448181193), (6, 15.279233632882423), (7, -33.28821096898486), (8, -0.020331201708508627)],
    &[(0, -0.9371424300859873), (3, 5.186372428844064), (4, 1.0914373489967295), (5, -8.149787010746927), (6, -18.52006565999696), (7, 22.739487099350505), (8, 2.4936055526796523), (9, -3.0467644718982196)],
    &[(0, 2.273310147516538), (3, -10.53449546673725), (4, -2.0008720582248625), (5, -17.9589318631188), (6, 27.94888452941996), (7, -2.8589982771350235), (8, -8.87285693353063), (9, 12.360567175794303), (10, 0.6433927460157636)],
];
/// Weights of order 8.
#[rustfmt::skip]
const B: &[(usize, f64)] = &[(0, 0.054293734116568765), (5, 4.450312892752409), (6, 1.8915178993145003), (7, -5.801203960010585), (8, 0.3111643669578199), (9, -0.1521609496625161), (10, 0.20136540080403034), (11, 0.04471061572777259)];
/// Nodes.
#[rustfmt::skip]
const NODES: [f64; 12] = [0.0, 0.05260015195876773, 0.0789002279381516, 0.1183503419072274, 0.2816496580927726, 0.3333333333333333, 0.25, 0.3076923076923077, 0.6512820512820513, 0.6, 0.8571428571428571, 1.0];
/// What the embedded formula of order 3 has other than order 8.
const E3: [(usize, f64); 3] =
    [(0, 0.2440944881889764), (8, 0.7338466882816118), (11, 0.022058823529411766)];
/// Difference to the embedded formula of order 5.
#[rustfmt::skip]
const E5: &[(usize, f64)] = &[(0, 0.01312004499419488), (5, -1.2251564463762044), (6, -0.4957589496572502), (7, 1.6643771824549864), (8, -0.35032884874997366), (9, 0.3341791187130175), (10, 0.08192320648511571), (11, -0.022355307863886294)];

/// y + h Σ c k.
fn combine(y: &[f64], h: f64, terms: &[(usize, f64)], k: &[Vec<f64>]) -> Vec<f64> {
    let mut out = y.to_vec();
    for &(j, c) in terms {
        for (x, k) in out.iter_mut().zip(&k[j]) {
            *x += h * c * k;
        }
    }
    out
}

/// DOP853 from t = 0 with its own step control; `norm(error, y)` is 1 on tolerance. States at `times`, which
/// steps end at, and the number of steps.
pub(crate) fn dop853(
    rate: &Rate,
    start: &[f64],
    times: &[f64],
    norm: &dyn Fn(&[f64], &[f64]) -> f64,
) -> (Vec<Vec<f64>>, usize) {
    let zero = vec![0.0; start.len()];
    let (mut t, mut y, mut h) = (0.0, start.to_vec(), 1e-3);
    let (mut rows, mut steps) = (Vec::new(), 0);
    for &end in times {
        while t < end {
            let last = t + h * (1.0 + 1e-9) >= end;
            let step = if last { end - t } else { h };
            let mut k: Vec<Vec<f64>> = Vec::new();
            for (row, node) in A.iter().zip(NODES) {
                k.push(rate(t + node * step, &combine(&y, step, row, &k)));
            }
            let next = combine(&y, step, B, &k);
            let five = norm(&combine(&zero, step, E5, &k), &y);
            let mut three = combine(&zero, step, B, &k);
            three = combine(&three, -step, &E3, &k);
            let three = norm(&three, &y);
            let error = five * five / (five * five + 0.01 * three * three).sqrt().max(1e-300);
            let ratio = (0.9 * error.max(1e-30).powf(-0.125)).clamp(0.333, 6.0);
            if error <= 1.0 {
                (t, y) = (if last { end } else { t + step }, next);
                steps += 1;
                h = if last { h.max(step * ratio) } else { step * ratio };
            } else {
                h = step * ratio.min(1.0);
                assert!(h > 1e-14, "the truth's step vanishes at {t} s");
            }
        }
        rows.push(y.clone());
    }
    (rows, steps)
}

/// DOP853 as far as double precision goes.
pub(crate) fn tight(rate: &Rate, start: &[f64], times: &[f64]) -> Vec<Vec<f64>> {
    let norm = |error: &[f64], y: &[f64]| {
        error.iter().zip(y).fold(0.0f64, |m, (e, y)| m.max(e.abs() / (1e-13 + 1e-13 * y.abs())))
    };
    dop853(rate, start, times, &norm).0
}

/// Gaussian elimination with row pivoting; `a` row by row.
pub(crate) fn solve(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for p in 0..n {
        let best = (p..n).max_by(|&i, &j| a[i][p].abs().total_cmp(&a[j][p].abs())).unwrap();
        a.swap(p, best);
        b.swap(p, best);
        let (above, below) = a.split_at_mut(p + 1);
        for (i, row) in below.iter_mut().enumerate() {
            let factor = row[p] / above[p][p];
            if factor != 0.0 {
                for (x, y) in row.iter_mut().zip(&above[p]).skip(p) {
                    *x -= factor * y;
                }
                b[p + 1 + i] -= factor * b[p];
            }
        }
    }
    for p in (0..n).rev() {
        let sum: f64 = (p + 1..n).map(|j| a[p][j] * b[j]).sum();
        b[p] = (b[p] - sum) / a[p][p];
    }
    b
}

/// Radau IIA of order 5 from t = 0: steps that grow by a quarter from `first` to `longest`, so that a
/// transient at the start is resolved; Newton iterations to round-off. States at `times`.
pub(crate) fn radau(
    rate: &Rate,
    start: &[f64],
    times: &[f64],
    first: f64,
    longest: f64,
) -> Vec<Vec<f64>> {
    let (mut t, mut y, mut h) = (0.0, start.to_vec(), first);
    let mut rows = Vec::new();
    for &end in times {
        while t < end {
            let left = end - t;
            // Equal steps to the next row once the longest is reached.
            let step =
                if h < longest { h.min(left) } else { left / (left / longest - 1e-9).ceil() };
            y = radau_step(rate, t, &y, step);
            t = if (end - t - step).abs() < 1e-12 * end { end } else { t + step };
            h = (1.25 * h).min(longest);
        }
        rows.push(y.clone());
    }
    rows
}

fn radau_step(rate: &Rate, t: f64, y: &[f64], h: f64) -> Vec<f64> {
    let s = 6.0f64.sqrt();
    let a = [
        [(88.0 - 7.0 * s) / 360.0, (296.0 - 169.0 * s) / 1800.0, (-2.0 + 3.0 * s) / 225.0],
        [(296.0 + 169.0 * s) / 1800.0, (88.0 + 7.0 * s) / 360.0, (-2.0 - 3.0 * s) / 225.0],
        [(16.0 - s) / 36.0, (16.0 + s) / 36.0, 1.0 / 9.0],
    ];
    let nodes = [(4.0 - s) / 10.0, (4.0 + s) / 10.0, 1.0];
    let n = y.len();
    let slope = jacobian(rate, t, y);
    let mut matrix = vec![vec![0.0; 3 * n]; 3 * n];
    for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
        for (p, q) in (0..n).flat_map(|p| (0..n).map(move |q| (p, q))) {
            let unit = f64::from(u8::from(i == j && p == q));
            matrix[n * i + p][n * j + q] = unit - h * a[i][j] * slope[p][q];
        }
    }
    let mut stages = [y.to_vec(), y.to_vec(), y.to_vec()];
    let mut before = f64::INFINITY;
    for _ in 0..12 {
        let f: Vec<_> = (0..3).map(|i| rate(t + nodes[i] * h, &stages[i])).collect();
        let mut residual = vec![0.0; 3 * n];
        for (i, p) in (0..3).flat_map(|i| (0..n).map(move |p| (i, p))) {
            let sum: f64 = (0..3).map(|j| a[i][j] * f[j][p]).sum();
            residual[n * i + p] = y[p] - stages[i][p] + h * sum;
        }
        let change = solve(matrix.clone(), residual);
        for (i, p) in (0..3).flat_map(|i| (0..n).map(move |p| (i, p))) {
            stages[i][p] += change[n * i + p];
        }
        let size = change.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        if size == 0.0 || size > 0.5 * before {
            break;
        }
        before = size;
    }
    stages[2].clone()
}

/// ∂f/∂y by central differences.
fn jacobian(rate: &Rate, t: f64, y: &[f64]) -> Vec<Vec<f64>> {
    let n = y.len();
    let mut out = vec![vec![0.0; n]; n];
    for q in 0..n {
        let (mut low, mut high, step) = (y.to_vec(), y.to_vec(), 1e-6);
        low[q] -= step;
        high[q] += step;
        let (low, high) = (rate(t, &low), rate(t, &high));
        for p in 0..n {
            out[p][q] = (high[p] - low[p]) / (2.0 * step);
        }
    }
    out
}

/// A number of the engine's or a dual one.
pub(crate) trait Scalar: DualNum<Primitive = f64> + Copy {}
impl<T: DualNum<Primitive = f64> + Copy> Scalar for T {}

/// Accelerations of minimal coordinates from them and their rates.
pub(crate) type Accelerations<'a> = dyn Fn(&[f64], &[f64]) -> Vec<f64> + 'a;

/// A mechanism in minimal coordinates by its energies.
pub(crate) trait Lagrange {
    /// Number of coordinates.
    fn size(&self) -> usize;
    /// Kinetic minus potential energy.
    fn lagrangian<T: Scalar>(&self, q: &[T], v: &[T]) -> T;
    /// Rayleigh's function: half the power of the dampers.
    fn dissipation<T: Scalar>(&self, q: &[T], v: &[T]) -> T;
}

fn unit(i: usize, k: usize) -> f64 {
    f64::from(u8::from(i == k))
}

fn constants<T: Scalar>(x: &[f64]) -> Vec<T> {
    x.iter().map(|&x| T::from(x)).collect()
}

/// Partial derivative of a function by its entry `i`.
fn partial(i: usize, x: &[f64], function: impl Fn(&[Dual64]) -> Dual64) -> f64 {
    let moved: Vec<_> = x.iter().enumerate().map(|(k, &x)| Dual64::new(x, unit(i, k))).collect();
    function(&moved).eps
}

/// L_vv a = L_q − L_vq v − R_v, with exact derivatives by dual numbers.
pub(crate) fn lagrange<L: Lagrange>(l: &L, q: &[f64], v: &[f64]) -> Vec<f64> {
    let n = l.size();
    let second = |x: &[f64], one: &dyn Fn(usize) -> f64, two: &dyn Fn(usize) -> f64| -> Vec<_> {
        (0..n).map(|k| HyperDual64::new(x[k], one(k), two(k), 0.0)).collect()
    };
    let none = |_: usize| 0.0;
    let mut matrix = vec![vec![0.0; n]; n];
    let mut right = vec![0.0; n];
    for i in 0..n {
        for j in i..n {
            let rates = second(v, &|k| unit(i, k), &|k| unit(j, k));
            matrix[i][j] = l.lagrangian(&second(q, &none, &none), &rates).eps1eps2;
            matrix[j][i] = matrix[i][j];
        }
        let (moved, rates) = (second(q, &none, &|k| v[k]), second(v, &|k| unit(i, k), &none));
        right[i] = partial(i, q, |q| l.lagrangian(q, &constants(v)))
            - partial(i, v, |v| l.dissipation(&constants(q), v))
            - l.lagrangian(&moved, &rates).eps1eps2;
    }
    solve(matrix, right)
}

/// A planar mechanism in minimal coordinates: what its bodies' places are, and its energies.
pub(crate) trait Planar {
    /// Number of coordinates.
    fn size(&self) -> usize;
    /// Mass and moment of inertia of each body.
    fn masses(&self) -> Vec<[f64; 2]>;
    /// Centre of mass and angle of each body.
    fn poses<T: Scalar>(&self, q: &[T]) -> Vec<[T; 3]>;
    /// Potential energy but for gravity.
    fn potential<T: Scalar>(&self, q: &[T]) -> T;
    /// Rayleigh's function: half the power of the dampers.
    fn dissipation<T: Scalar>(&self, q: &[T], v: &[T]) -> T;
}

/// Gravity of the planar mechanisms, along −y, m/s².
pub(crate) const GRAVITY: f64 = 9.81;

/// Dᵀm (D a + (D v)˙) = −V_q − R_v + Dᵀm g with D = ∂(poses)/∂q, by dual numbers.
pub(crate) fn planar<P: Planar>(p: &P, q: &[f64], v: &[f64]) -> Vec<f64> {
    let n = p.size();
    let flat = |poses: Vec<[Dual64; 3]>| poses.concat().iter().map(|x| x.eps).collect::<Vec<_>>();
    let slopes: Vec<Vec<f64>> = (0..n)
        .map(|i| {
            let q: Vec<_> = (0..n).map(|k| Dual64::new(q[k], unit(i, k))).collect();
            flat(p.poses(&q))
        })
        .collect();
    let along: Vec<_> = q.iter().zip(v).map(|(&q, &v)| Dual2_64::new(q, v, 0.0)).collect();
    let bent: Vec<f64> = p.poses(&along).concat().iter().map(|x| x.v2).collect();
    let mass: Vec<f64> = p.masses().iter().flat_map(|[m, j]| [*m, *m, *j]).collect();
    let mut matrix = vec![vec![0.0; n]; n];
    let mut right = vec![0.0; n];
    for i in 0..n {
        for j in 0..n {
            matrix[i][j] = (0..mass.len()).map(|b| slopes[i][b] * mass[b] * slopes[j][b]).sum();
        }
        let load = |b: usize| if b % 3 == 1 { -GRAVITY } else { 0.0 } - bent[b];
        let inertial: f64 = (0..mass.len()).map(|b| slopes[i][b] * mass[b] * load(b)).sum();
        right[i] = inertial
            - partial(i, q, |q| p.potential(q))
            - partial(i, v, |v| p.dissipation(&constants(q), v));
    }
    solve(matrix, right)
}

/// Places and velocities of the bodies of a planar mechanism at (q, v).
pub(crate) fn motions<P: Planar>(p: &P, y: &[f64]) -> Vec<[[f64; 3]; 2]> {
    let (q, v) = y.split_at(p.size());
    let along: Vec<_> = q.iter().zip(v).map(|(&q, &v)| Dual64::new(q, v)).collect();
    p.poses(&along).iter().map(|pose| [pose.map(|x| x.re), pose.map(|x| x.eps)]).collect()
}

/// x, y turned by an angle.
pub(crate) fn spun<T: Scalar>(angle: T, [x, y]: [T; 2]) -> [T; 2] {
    let (s, c) = angle.sin_cos();
    [c * x - s * y, s * x + c * y]
}

/// The rate of (q, v).
pub(crate) fn rate<'a>(accelerations: &'a Accelerations) -> impl Fn(f64, &[f64]) -> Vec<f64> + 'a {
    move |_, y| {
        let (q, v) = y.split_at(y.len() / 2);
        v.iter().copied().chain(accelerations(q, v)).collect()
    }
}

/// Moves the stiff coordinates of y = (q, v) and their rates onto the slow manifold of the other entries as they
/// are: each round takes rates and accelerations of the stiff coordinates from the manifold of the round before,
/// as it is passed along the motion. `heavy` dampers make deformations slow themselves: they stay at their
/// balance with slow forces, and only their rates follow.
pub(crate) fn slow_start(
    accelerations: &Accelerations,
    stiff: &[usize],
    heavy: bool,
    y: &[f64],
) -> Vec<f64> {
    let found = if heavy {
        let balanced = slow(accelerations, stiff, false, y, 1);
        slow(accelerations, stiff, true, &balanced, 4)
    } else {
        slow(accelerations, stiff, false, y, 4)
    };
    // What is too soft for the motion has no slow manifold: any start will do.
    let is_one = found.iter().all(|x| x.is_finite());
    if is_one { found } else { slow(accelerations, stiff, false, y, 0) }
}

fn slow(
    accelerations: &Accelerations,
    stiff: &[usize],
    heavy: bool,
    y: &[f64],
    rounds: usize,
) -> Vec<f64> {
    let n = y.len() / 2;
    let mut y = y.to_vec();
    if rounds == 0 {
        for &i in stiff {
            if !heavy {
                y[i] = 0.0;
            }
            y[n + i] = 0.0;
        }
        return y;
    }
    let before = |y: &[f64]| slow(accelerations, stiff, heavy, y, rounds - 1);
    y = before(&y);
    let mut along = rate(accelerations)(0.0, &y);
    for &i in stiff {
        if !heavy {
            along[i] = 0.0;
        }
        along[n + i] = 0.0;
    }
    let step = 2e-3 / (1.0 + y[n..].iter().fold(0.0f64, |m, v| m.max(v.abs())));
    let at = |s: f64| {
        if rounds == 1 {
            return y.clone(); // the manifold of round 0 is flat
        }
        let moved: Vec<f64> = y.iter().zip(&along).map(|(y, d)| y + s * step * d).collect();
        before(&moved)
    };
    let [a, b, c, d] = [-2.0, -1.0, 1.0, 2.0].map(at);
    let change = |i: usize| (a[i] - 8.0 * b[i] + 8.0 * c[i] - d[i]) / (12.0 * step);
    let wanted: Vec<f64> = stiff.iter().map(|&i| change(n + i)).collect();
    if !heavy {
        for &i in stiff {
            y[n + i] = change(i);
        }
    }
    // Newton on the coordinates (heavy: rates) for the wanted accelerations.
    let place = |i: usize| if heavy { n + i } else { i };
    let found = |y: &[f64]| {
        let a = accelerations(&y[..n], &y[n..]);
        stiff.iter().map(|&i| a[i]).collect::<Vec<_>>()
    };
    for _ in 0..3 {
        let now = found(&y);
        let mut matrix = vec![vec![0.0; stiff.len()]; stiff.len()];
        for (column, &i) in stiff.iter().enumerate() {
            let mut moved = y.clone();
            moved[place(i)] += 1e-7;
            for (row, (high, low)) in found(&moved).iter().zip(&now).enumerate() {
                matrix[row][column] = (high - low) / 1e-7;
            }
        }
        let residual = wanted.iter().zip(&now).map(|(w, a)| w - a).collect();
        for (&i, change) in stiff.iter().zip(solve(matrix, residual)) {
            y[place(i)] += change;
        }
    }
    y
}

/// Vectors and Euler parameters of the truths.
pub(crate) mod space {
    pub(crate) type Vector = [f64; 3];
    /// Euler parameters.
    pub(crate) type Pose = [f64; 4];

    pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    pub(crate) fn cross(a: Vector, b: Vector) -> Vector {
        [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
    }

    pub(crate) fn sum(a: Vector, b: Vector) -> Vector {
        [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
    }

    pub(crate) fn scaled(a: Vector, s: f64) -> Vector {
        a.map(|x| x * s)
    }

    /// The product of two turns.
    pub(crate) fn product(p: Pose, r: Pose) -> Pose {
        let (a, b) = ([p[1], p[2], p[3]], [r[1], r[2], r[3]]);
        let v = sum(sum(scaled(b, p[0]), scaled(a, r[0])), cross(a, b));
        [p[0] * r[0] - dot(&a, &b), v[0], v[1], v[2]]
    }

    /// The turn by the length of a vector about it.
    pub(crate) fn turn(w: Vector) -> Pose {
        let angle = dot(&w, &w).sqrt();
        let s = if angle == 0.0 { 0.5 } else { (0.5 * angle).sin() / angle };
        [(0.5 * angle).cos(), s * w[0], s * w[1], s * w[2]]
    }

    /// A vector of body axes in ground axes.
    pub(crate) fn turned(p: Pose, x: Vector) -> Vector {
        let r = product(product(p, [0.0, x[0], x[1], x[2]]), [p[0], -p[1], -p[2], -p[3]]);
        [r[1], r[2], r[3]]
    }

    /// A vector of ground axes in body axes.
    pub(crate) fn unturned(p: Pose, x: Vector) -> Vector {
        turned([p[0], -p[1], -p[2], -p[3]], x)
    }

    /// Unit Euler parameters out of four entries.
    pub(crate) fn pose(p: &[f64]) -> Pose {
        let size = dot(p, p).sqrt();
        [p[0] / size, p[1] / size, p[2] / size, p[3] / size]
    }

    pub(crate) fn vector(x: &[f64]) -> Vector {
        [x[0], x[1], x[2]]
    }

    /// Rate of Euler parameters for an angular velocity in body axes.
    pub(crate) fn pose_rate(p: Pose, w: Vector) -> Pose {
        product(p, [0.0, w[0], w[1], w[2]]).map(|x| 0.5 * x)
    }
}
