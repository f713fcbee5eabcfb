//! Matrices with the structure of a vehicle: 14 bodies of 7 coordinates (position, Euler
//! parameters), 80 constraint rows.

use holonom_linalg::{SparsePattern, full_pivot_elimination};

const BODIES: usize = 14;
const PER_BODY: usize = 7;
const N: usize = BODIES * PER_BODY;

/// A matrix under construction: entries with their numbers.
#[derive(Default)]
struct Triplets {
    entries: Vec<(usize, usize)>,
    values: Vec<f64>,
}

impl Triplets {
    fn push(&mut self, i: usize, j: usize, value: f64) {
        self.entries.push((i, j));
        self.values.push(value);
    }

    fn compress(&self, n: usize) -> (SparsePattern, Vec<f64>) {
        let (pattern, slots) = SparsePattern::new(n, n, &self.entries);
        let mut values = vec![0.0; pattern.len()];
        for (&slot, v) in slots.iter().zip(&self.values) {
            values[slot] += v;
        }
        (pattern, values)
    }
}

/// Deterministic numbers in (−1, 1).
struct Noise(u64);

impl Noise {
    fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }
}

/// Constraint Jacobian of a double-wishbone vehicle: chassis 0, rack 1, upper arms 2–5, lower arms
/// 6–9, wheel carriers 10–13; 14 norms of Euler parameters and 66 joint rows, each over all the
/// coordinates of its two bodies.
fn constraint_rows(noise: &mut Noise) -> Triplets {
    let mut joints = vec![(0, 1, 6)];
    for corner in 0..4 {
        let (upper, lower, carrier) = (2 + corner, 6 + corner, 10 + corner);
        joints.extend([(0, upper, 5), (0, lower, 5), (upper, carrier, 1), (lower, carrier, 3)]);
        joints.push((usize::from(corner < 2), carrier, 1));
    }
    let mut g = Triplets::default();
    let mut row = 0;
    for body in 0..BODIES {
        for c in 3..PER_BODY {
            g.push(row, body * PER_BODY + c, noise.next());
        }
        row += 1;
    }
    for (first, second, rows) in joints {
        for _ in 0..rows {
            for body in [first, second] {
                for c in 0..PER_BODY {
                    g.push(row, body * PER_BODY + c, noise.next());
                }
            }
            row += 1;
        }
    }
    assert_eq!(row, 80);
    g
}

/// [M Gᵀ; G 0] with mass blocks of rank 6: singular without the constraints.
pub(crate) fn saddle() -> (SparsePattern, Vec<f64>) {
    let mut noise = Noise(7);
    let g = constraint_rows(&mut noise);
    let mut a = Triplets::default();
    for body in 0..BODIES {
        let factor: Vec<f64> = (0..6 * PER_BODY).map(|_| 3.0 * noise.next()).collect();
        for i in 0..PER_BODY {
            for j in 0..PER_BODY {
                let value = (0..6).map(|k| factor[k * PER_BODY + i] * factor[k * PER_BODY + j]);
                a.push(body * PER_BODY + i, body * PER_BODY + j, value.sum());
            }
        }
    }
    for (&(i, j), &v) in g.entries.iter().zip(&g.values) {
        a.push(N + i, j, v);
        a.push(j, N + i, v);
    }
    a.compress(N + 80)
}

/// [G; P] with unit rows for the 18 coordinates that complete pivoting leaves independent.
pub(crate) fn constraints_and_partition() -> (SparsePattern, Vec<f64>) {
    let mut a = constraint_rows(&mut Noise(7));
    let mut dense = vec![0.0; 80 * N];
    for (&(i, j), v) in a.entries.iter().zip(&a.values) {
        dense[i * N + j] = *v;
    }
    let order = full_pivot_elimination(80, N, &mut dense, &[], 1e-10);
    for (p, &j) in order.column_order[80..].iter().enumerate() {
        a.push(80 + p, j, 1.0);
    }
    a.compress(N)
}
