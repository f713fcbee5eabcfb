//! The shortest step that takes a residual away, and how long steps are.

use crate::system::{Measure, System};
use crate::watch::checkpoint;
use holonom_linalg::{BlockMatrix, least_norm, sparse_least_norm};

/// How a least change is found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Solve {
    /// Characteristic lengths in which lengths are measured.
    pub(super) lengths: f64,
    /// Relative rank tolerance.
    pub(super) rank: f64,
    /// Whether rows of lengths count by the characteristic length there; else in metres.
    pub(super) alike: bool,
    /// Beyond about as many operations it comes from a sparse matrix, which knows no rank but damps what depends on other
    /// rows.
    pub(super) dense: f64,
}

/// For a few solves, for those of rates, for many, and for steps that make a residual smaller where it cannot vanish.
pub(super) const USUAL: Solve = Solve { lengths: 1.0, rank: 1e-10, alike: false, dense: 1e8 };
pub(super) const RATES: Solve = Solve { alike: true, ..USUAL };
pub(super) const OFTEN: Solve = Solve { dense: 1e6, ..USUAL };
pub(super) const PLAIN: Solve = Solve { rank: 1e-2, ..OFTEN };
/// By how much a step may turn a body, rad (|δp|), or slide it, characteristic lengths, where it turns it, too.
pub(super) const FURTHEST: f64 = 0.5;

/// Free coordinates, and bodies whose origin is stated while their orientation is free and their centre of mass lies
/// elsewhere.
pub(in crate::reduction) struct Unknowns {
    pub(in crate::reduction) free: Vec<usize>,
    /// Such bodies: their translations follow their orientations.
    pub(in crate::reduction) coupled: Vec<usize>,
}

impl Unknowns {
    /// All coordinates.
    pub(super) fn all(system: &dyn System) -> Self {
        Self { free: (0..system.structure().sizes.coordinates).collect(), coupled: Vec::new() }
    }

    fn couplings(&self, system: &dyn System, q: &[f64]) -> Vec<(usize, Vec<f64>)> {
        self.coupled.iter().map(|&b| (b, coupling(system, b, q))).collect()
    }

    /// Makes a change of the free coordinates at q one of all: coupled translations follow.
    pub(in crate::reduction) fn complete(&self, system: &dyn System, q: &[f64], x: &mut [f64]) {
        follow(system, &self.couplings(system, q), x);
    }
}

/// Minimum-norm x over the free unknowns with G x = r, as [`Solve`] says; coupled translations follow their orientations.
pub(super) fn least_change(
    system: &dyn System,
    g: &BlockMatrix,
    r: &[f64],
    unknowns: &Unknowns,
    q: &[f64],
    by: Solve,
) -> Option<Vec<f64>> {
    let sizes = system.structure().sizes;
    let (m, n, k) = (sizes.rows, sizes.coordinates, unknowns.free.len());
    checkpoint(m * k);
    let couplings = unknowns.couplings(system, q);
    let mut column = vec![None; n];
    for (at, &i) in unknowns.free.iter().enumerate() {
        column[i] = Some(at);
    }
    let measure = |i: usize| system.structure().coordinate_measure(i);
    let weights: Vec<f64> =
        unknowns.free.iter().map(|&i| unit(system, measure(i), by.lengths)).collect();
    let mut coupled = vec![None; sizes.bodies];
    for (b, w) in &couplings {
        coupled[*b] = Some(w);
    }
    let mut entries = Vec::new();
    for ((row, i), x) in g.entries(0, 0).into_iter().zip(g.values()) {
        let mut add = |i: usize, x: f64| {
            if let Some(at) = column[i] {
                entries.push((row, at, x * weights[at]));
            }
        };
        add(i, *x);
        let (body, place) = sizes.place_of(i);
        if let (Some(w), true) = (coupled[body], place < sizes.translations) {
            let turns = sizes.rotations_of(body);
            let factors = &w[place * turns.len()..];
            turns.zip(factors).for_each(|(i, factor)| add(i, x * factor));
        }
    }
    let solution = if (m * m) as f64 * k as f64 <= by.dense {
        let scale =
            |row: &Measure| if by.alike { 1.0 / unit(system, *row, by.lengths) } else { 1.0 };
        let scales: Vec<f64> = system.structure().row_measure.iter().map(scale).collect();
        let mut a = vec![0.0; m * k];
        for (row, at, x) in entries {
            a[row * k + at] += scales[row] * x;
        }
        let r: Vec<f64> = r.iter().zip(&scales).map(|(r, scale)| r * scale).collect();
        least_norm(m, k, &a, &r, by.rank).ok()?.x
    } else {
        sparse_least_norm(m, k, &entries, r).ok()?
    };
    let mut x = vec![0.0; n];
    for ((&i, y), w) in unknowns.free.iter().zip(&solution).zip(&weights) {
        x[i] = y * w;
    }
    follow(system, &couplings, &mut x);
    Some(x)
}

/// Moves the translations in a change `x` of coordinates with the orientations that they are coupled to.
fn follow(system: &dyn System, couplings: &[(usize, Vec<f64>)], x: &mut [f64]) {
    let sizes = system.structure().sizes;
    for (b, w) in couplings {
        let turns = sizes.rotations_of(*b).len();
        let (translation, rotation) = x[sizes.of_body(*b)].split_at_mut(sizes.translations);
        for (x, w) in translation.iter_mut().zip(w.chunks_exact(turns)) {
            *x = w.iter().zip(&*rotation).map(|(w, x)| w * x).sum();
        }
    }
}

/// ∂(A c)/∂p of a body, a row for each translation; A is quadratic in the Euler parameters, so central
/// differences are exact for them and accurate to 1e-10 for an angle.
fn coupling(system: &dyn System, body: usize, q: &[f64]) -> Vec<f64> {
    let sizes = system.structure().sizes;
    let (d, turns) = (sizes.translations, sizes.rotations_of(body));
    let n = turns.len();
    let h = 1e-5;
    let arm = |shift: f64, c: usize| {
        let mut moved = q.to_vec();
        moved[turns.start + c] += shift;
        let rest = vec![0.0; q.len()];
        let pose = system.body(body, &moved, &rest);
        let r = &moved[sizes.translations_of(body)];
        [
            r[0] - pose.position[0],
            r[1] - pose.position[1],
            r.get(2).unwrap_or(&0.0) - pose.position[2],
        ]
    };
    let mut w = vec![0.0; d * n];
    for c in 0..n {
        let (plus, minus) = (arm(h, c), arm(-h, c));
        for i in 0..d {
            w[i * n + c] = (plus[i] - minus[i]) / (2.0 * h);
        }
    }
    w
}

/// What makes changes of a coordinate comparable: 1/m for lengths.
pub(in crate::reduction) fn scale(system: &dyn System, coordinate: usize) -> f64 {
    weight(system, coordinate, 1.0)
}

/// Euclidean norm.
fn norm(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// What makes changes of a coordinate comparable, lengths measured in so many characteristic ones.
fn weight(system: &dyn System, coordinate: usize, lengths: f64) -> f64 {
    1.0 / unit(system, system.structure().coordinate_measure(coordinate), lengths)
}

/// What of a measure compares with a radian, lengths measured in so many characteristic ones.
fn unit(system: &dyn System, measure: Measure, lengths: f64) -> f64 {
    match measure {
        Measure::Length => lengths * system.characteristic_length(),
        Measure::Angle => 1.0,
    }
}

/// Size of a step.
pub(super) fn size(system: &dyn System, step: &[f64], lengths: f64) -> f64 {
    let entries = step.iter().enumerate().map(|(i, x)| (weight(system, i, lengths) * x).powi(2));
    entries.sum::<f64>().sqrt()
}

/// A step shortened until it slides and turns no body by more than [`FURTHEST`].
pub(super) fn limited(system: &dyn System, mut step: Vec<f64>, lengths: f64) -> Vec<f64> {
    let [slid, turned] = largest(system, &step, lengths);
    let longest = slid.max(turned);
    if longest > FURTHEST {
        step.iter_mut().for_each(|x| *x *= FURTHEST / longest);
    }
    step
}

/// How far a step slides and turns the body that it slides and turns most, lengths measured in so many characteristic ones:
/// sizes of vectors, which a common rotation of the model does not change.
pub(super) fn largest(system: &dyn System, step: &[f64], lengths: f64) -> [f64; 2] {
    let sizes = system.structure().sizes;
    sizes.by_body(step).fold([0.0, 0.0], |[slid, turned]: [f64; 2], [r, p]| {
        [slid.max(scale(system, 0) / lengths * norm(r)), turned.max(norm(p))]
    })
}
