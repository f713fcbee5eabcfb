//! Seeded random numbers, rotations and a dense solver: nothing of the engine.

pub(crate) type V3 = [f64; 3];
pub(crate) type M3 = [[f64; 3]; 3];

pub(crate) const IDENTITY: M3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// A small deterministic generator (splitmix64).
#[derive(Debug, Clone)]
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        let mut out = Self(seed ^ 0x5851_f42d_4c95_7f2d);
        out.next();
        out
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * (self.next() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// The logarithm is uniform.
    pub(crate) fn logarithmic(&mut self, low: f64, high: f64) -> f64 {
        self.range(low.ln(), high.ln()).exp()
    }

    /// Uniform in 0 … n − 1.
    pub(crate) fn below(&mut self, n: usize) -> usize {
        (self.next() % n as u64) as usize
    }

    pub(crate) fn chance(&mut self, probability: f64) -> bool {
        self.range(0.0, 1.0) < probability
    }

    pub(crate) fn one_of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.below(choices.len())]
    }

    /// A unit vector; in the plane without z.
    pub(crate) fn unit(&mut self, planar: bool) -> V3 {
        loop {
            let z = if planar { 0.0 } else { self.range(-1.0, 1.0) };
            let a = [self.range(-1.0, 1.0), self.range(-1.0, 1.0), z];
            if (0.1..1.0).contains(&norm(&a)) {
                return unit(&a);
            }
        }
    }

    /// A vector of a length between the two, in any direction.
    pub(crate) fn vector(&mut self, planar: bool, low: f64, high: f64) -> V3 {
        let length = self.range(low, high);
        self.unit(planar).map(|x| x * length)
    }

    /// A rotation about any axis, or about z.
    pub(crate) fn rotation(&mut self, planar: bool) -> M3 {
        let angle = self.range(-3.0, 3.0);
        let axis = if planar { [0.0, 0.0, 1.0] } else { self.unit(false) };
        turn(&axis.map(|x| x * angle))
    }
}

pub(crate) fn add(a: &V3, b: &V3) -> V3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub(crate) fn sub(a: &V3, b: &V3) -> V3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub(crate) fn scale(a: &V3, s: f64) -> V3 {
    a.map(|x| x * s)
}

pub(crate) fn dot(a: &V3, b: &V3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: &V3, b: &V3) -> V3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: &V3) -> f64 {
    dot(a, a).sqrt()
}

pub(crate) fn unit(a: &V3) -> V3 {
    scale(a, 1.0 / norm(a))
}

/// A unit vector perpendicular to `a`.
pub(crate) fn perpendicular(a: &V3) -> V3 {
    let helper = if a[0].abs() < 0.6 { [1.0, 0.0, 0.0] } else { [0.0, 1.0, 0.0] };
    unit(&cross(a, &helper))
}

pub(crate) fn transpose(m: &M3) -> M3 {
    std::array::from_fn(|i| std::array::from_fn(|j| m[j][i]))
}

pub(crate) fn apply(m: &M3, a: &V3) -> V3 {
    m.map(|row| dot(&row, a))
}

pub(crate) fn product(a: &M3, b: &M3) -> M3 {
    let columns = transpose(b);
    a.map(|row| columns.map(|column| dot(&row, &column)))
}

/// Rotation by a rotation vector (Rodrigues).
pub(crate) fn turn(vector: &V3) -> M3 {
    let angle = norm(vector);
    let (s, c) = if angle < 1e-8 {
        (1.0, 0.5)
    } else {
        (angle.sin() / angle, (1.0 - angle.cos()) / (angle * angle))
    };
    let [x, y, z] = *vector;
    let w = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]];
    let ww = product(&w, &w);
    std::array::from_fn(|i| std::array::from_fn(|j| IDENTITY[i][j] + s * w[i][j] + c * ww[i][j]))
}

/// sin φ times the axis of a rotation by φ.
pub(crate) fn sine_vector(r: &M3) -> V3 {
    [0.5 * (r[2][1] - r[1][2]), 0.5 * (r[0][2] - r[2][0]), 0.5 * (r[1][0] - r[0][1])]
}

/// Euler parameters of a rotation by less than π.
pub(crate) fn euler_parameters(r: &M3) -> [f64; 4] {
    let e0 = 0.5 * (1.0 + r[0][0] + r[1][1] + r[2][2]).max(0.0).sqrt();
    let p = scale(&sine_vector(r), 0.5 / e0);
    let length = (e0 * e0 + dot(&p, &p)).sqrt();
    [e0, p[0], p[1], p[2]].map(|x| x / length)
}

/// Solves A x = b by Gaussian elimination; vanishing pivots give zeros.
pub(crate) fn solve(mut a: Vec<Vec<f64>>, b: &[f64]) -> Vec<f64> {
    let n = b.len();
    a.iter_mut().zip(b).for_each(|(row, b)| row.push(*b));
    for p in 0..n {
        let best = (p..n).max_by(|&i, &j| a[i][p].abs().total_cmp(&a[j][p].abs()));
        a.swap(p, best.unwrap_or(p));
        let (above, below) = a.split_at_mut(p + 1);
        let pivot = &above[p];
        if pivot[p].abs() < 1e-300 {
            continue;
        }
        for row in below {
            let factor = row[p] / pivot[p];
            for k in p..=n {
                row[k] -= factor * pivot[k];
            }
        }
    }
    let mut x = vec![0.0; n];
    for p in (0..n).rev() {
        let sum: f64 = (p + 1..n).map(|j| a[p][j] * x[j]).sum();
        x[p] = if a[p][p].abs() < 1e-300 { 0.0 } else { (a[p][n] - sum) / a[p][p] };
    }
    x
}

/// Rank by complete pivoting: pivots below `tolerance` times the first are dependent rows; also the
/// smallest kept pivot over the first.
pub(crate) fn rank(rows: &[Vec<f64>], tolerance: f64) -> (usize, f64) {
    let mut a = rows.to_vec();
    let n = a.first().map_or(0, Vec::len);
    let mut ratio = 1.0;
    let mut first = 0.0;
    for p in 0..a.len().min(n) {
        let mut best = (p, p);
        for i in p..a.len() {
            for j in p..n {
                if a[i][j].abs() > a[best.0][best.1].abs() {
                    best = (i, j);
                }
            }
        }
        a.swap(p, best.0);
        a.iter_mut().for_each(|row| row.swap(p, best.1));
        let pivot = a[p][p].abs();
        if p == 0 {
            first = pivot;
        }
        if pivot <= tolerance * first || pivot == 0.0 {
            return (p, ratio);
        }
        ratio = pivot / first;
        for i in p + 1..a.len() {
            let factor = a[i][p] / a[p][p];
            for j in p..n {
                let change = factor * a[p][j];
                a[i][j] -= change;
            }
        }
    }
    (a.len().min(n), ratio)
}
