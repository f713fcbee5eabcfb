//! Displacements among the independent variables: rows of P that turn with the bodies.

use super::chart::{Parametrization, Projection};
use super::manifold::Manifold;
use super::partitioning::TRANSLATION_BIAS;
use super::reduced_blocks::ReducedBlocks;
use crate::error::EvaluationFailure;
use crate::system::{Measure, State, System};
use holonom_linalg::{BlockMatrix, Cholesky, full_pivot_elimination};

/// Rows of an n-column matrix with entries in the columns of two bodies each.
#[derive(Debug, Clone)]
pub struct BodyRows {
    bodies: Vec<[Option<usize>; 2]>,
    per_body: usize,
    /// 2·per_body per row.
    values: Vec<f64>,
}

impl BodyRows {
    /// Zero rows for the displacements `chosen`.
    pub fn new(system: &dyn System, chosen: &[usize]) -> Self {
        let per_body = system.structure().sizes.per_body;
        Self {
            bodies: chosen.iter().map(|&k| system.displacements()[k].bodies).collect(),
            per_body,
            values: vec![0.0; chosen.len() * 2 * per_body],
        }
    }

    /// Number of rows.
    #[allow(clippy::len_without_is_empty, reason = "a matrix")]
    pub fn len(&self) -> usize {
        self.bodies.len()
    }

    /// Entries of row `k`: the coordinates of its first and its second body.
    pub fn row_mut(&mut self, k: usize) -> &mut [f64] {
        let width = 2 * self.per_body;
        &mut self.values[k * width..(k + 1) * width]
    }

    /// All entries: place in the values, row, column.
    pub fn entries(&self) -> impl Iterator<Item = (usize, usize, usize)> + '_ {
        let n = self.per_body;
        self.bodies.iter().enumerate().flat_map(move |(row, ends)| {
            (0..2).flat_map(move |side| {
                ends[side].into_iter().flat_map(move |body| {
                    (0..n).map(move |i| ((2 * row + side) * n + i, row, body * n + i))
                })
            })
        })
    }

    /// Takes over the values of rows for the same displacements.
    pub fn copy_from(&mut self, other: &Self) {
        self.values.copy_from_slice(&other.values);
    }

    /// The value at a place of [`BodyRows::entries`].
    pub fn value(&self, at: usize) -> f64 {
        self.values[at]
    }

    /// Makes the rows s_q of the displacements `chosen`.
    pub fn evaluate(&mut self, system: &dyn System, chosen: &[usize], q: &[f64]) {
        for (row, &k) in chosen.iter().enumerate() {
            system.displacement_gradient(k, q, self.row_mut(row));
        }
    }

    /// Y += α A X, X with k columns, both by rows.
    pub fn multiply_many_add(&self, alpha: f64, x: &[f64], k: usize, y: &mut [f64]) {
        for (at, row, column) in self.entries() {
            let scale = alpha * self.values[at];
            let source = &x[column * k..(column + 1) * k];
            for (out, x) in y[row * k..(row + 1) * k].iter_mut().zip(source) {
                *out += scale * x;
            }
        }
    }

    /// X += α Aᵀ Y, Y with k columns, both by rows.
    pub fn multiply_transposed_many_add(&self, alpha: f64, y: &[f64], k: usize, x: &mut [f64]) {
        for (at, row, column) in self.entries() {
            let scale = alpha * self.values[at];
            let source = &y[row * k..(row + 1) * k];
            for (out, y) in x[column * k..(column + 1) * k].iter_mut().zip(source) {
                *out += scale * y;
            }
        }
    }
}

/// A spring is followed by its elongation where its stiffness is more than this times what else acts
/// along it.
const STIFF: f64 = 100.0;
/// The same for a bushing, which holds all directions of a point: short of this the iterations follow
/// it as well in coordinates, with fewer rejections.
const STIFF_BUSHING: f64 = 1e6;
/// It must not be longer or shorter than its free length by more than this part of it, nor move as
/// if it soon were: short springs turn fast and have no direction where their ends meet.
const LARGEST_STRAIN: f64 = 0.05;
/// A displacement takes the place of a coordinate if it moves with it at least by this much, as a
/// pure number, and apart from the other displacements.
const LEAST_MOVEMENT: f64 = 1e-2;

/// Lets displacements s(q) take the place of independent coordinates of a partition, at a state with
/// Jacobian `g`: those of all joints that slide along an axis that turns, and those along which a
/// spring or bushing is stiff. Stiff forces along them are then linear in v and keep their direction,
/// however far the bodies turn during a step; in coordinates of the ground their direction is off by
/// the angle of the step, and what they do across it grows with the stiffness.
///
/// With r = s_q D, u = M̂⁻¹rᵀ / √(r M̂⁻¹ rᵀ), R = M̂₂ at q̇ = 0 without the springs and Ω the turning of
/// the spring, it is stiff if
///
/// ```text
/// uᵀ K̂_spring u > 100 (|uᵀ R u| + Ω²)      (10⁶ and without Ω for a bushing)
/// ```
///
/// which compares squares of frequencies and so depends neither on units nor on a step.
///
/// # Errors
/// `simulation/singular-configuration`.
pub(super) fn take_displacements(
    parametrization: &mut Parametrization,
    manifold: &Manifold,
    state: &State,
    g: &BlockMatrix,
) -> Result<(), EvaluationFailure> {
    let system = manifold.system().as_ref();
    let Projection::Selection(independent) = &parametrization.projection else { return Ok(()) };
    let (n, ndof) = (state.q.len(), parametrization.ndof);
    if system.displacements().is_empty() || ndof == 0 {
        return Ok(());
    }
    let chart =
        manifold.chart().with_parametrization(system, parametrization.clone(), &state.q, g)?;
    let mut trial = manifold.clone();
    trial.set_chart(chart);
    let mut d = vec![0.0; n * ndof];
    trial.chart_mut().null_space(&mut d);
    // s_q D of every displacement.
    let all: Vec<usize> = (0..system.displacements().len()).collect();
    let mut gradients = BodyRows::new(system, &all);
    gradients.evaluate(system, &all, &state.q);
    let mut rows = vec![0.0; all.len() * ndof];
    gradients.multiply_many_add(1.0, &d, ndof, &mut rows);
    let mut rates = vec![0.0; all.len()];
    gradients.multiply_many_add(1.0, &state.v, 1, &mut rates);
    let stiff = stiff_springs(&mut trial, state, &rows, &rates);

    let length = system.characteristic_length();
    let scale: Vec<f64> = independent
        .iter()
        .map(|&i| match system.structure().coordinate_measure(i) {
            Measure::Length => TRANSLATION_BIAS,
            Measure::Angle => 1.0 / length,
        })
        .collect();
    let mut candidates = Vec::new();
    let mut a = Vec::new();
    for (k, row) in rows.chunks_exact(ndof).enumerate() {
        if !stiff[k] {
            continue;
        }
        let size = |(x, s): (&f64, &f64)| (x * s).abs();
        let largest = row.iter().zip(&scale).map(size).fold(0.0, f64::max);
        // In a loop a joint that slides has dead points, which rotations may be free of: it takes the
        // place of translations.
        let joint = system.displacement_stiffness(k, &state.q).is_none();
        let is_length = |i: usize| system.structure().coordinate_measure(i) == Measure::Length;
        let moved =
            row.iter().zip(&scale).zip(independent).filter(|(_, i)| !joint || is_length(**i));
        if moved.map(|(x, _)| size(x)).fold(0.0, f64::max) > LEAST_MOVEMENT {
            candidates.push(k);
            a.extend(row.iter().zip(&scale).map(|(x, s)| x * s / largest));
        }
    }
    let pivots = full_pivot_elimination(candidates.len(), ndof, &mut a, &[], LEAST_MOVEMENT);
    let replaced = &pivots.column_order[..pivots.rank];
    let kept = (0..ndof).filter(|k| !replaced.contains(k)).map(|k| independent[k]).collect();
    let mut taken: Vec<usize> =
        pivots.row_order[..pivots.rank].iter().map(|&row| candidates[row]).collect();
    taken.sort_unstable();
    parametrization.projection = Projection::Selection(kept);
    parametrization.displacements = taken;
    Ok(())
}

/// Which displacements are stiff, or belong to joints; `rows` holds s_q D, `rates` ṡ.
fn stiff_springs(manifold: &mut Manifold, state: &State, rows: &[f64], rates: &[f64]) -> Vec<bool> {
    let system = manifold.system().clone();
    let ndof = manifold.chart().ndof();
    let displacements = system.displacements();
    let stiffness: Vec<Option<f64>> =
        (0..displacements.len()).map(|k| system.displacement_stiffness(k, &state.q)).collect();
    let mut stiff: Vec<bool> = stiffness.iter().map(Option::is_none).collect();
    if stiffness.iter().all(Option::is_none) {
        return stiff;
    }
    manifold.evaluate_mass(&state.q);
    let mut reduced = ReducedBlocks::new(manifold);
    // Without velocities the dampers of the springs themselves do not count as something else.
    let mut at_rest = state.clone();
    at_rest.v.fill(0.0);
    reduced.evaluate(manifold, &at_rest);
    let mut cholesky = Cholesky::new(ndof);
    if cholesky.factor(&reduced.mass).is_err() {
        return stiff;
    }
    // Per spring: its stiffness, u, and uᵀ K̂_spring u.
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let mut springs = Vec::new();
    for (k, row) in rows.chunks_exact(ndof).enumerate() {
        let mut u = row.to_vec();
        cholesky.solve(&mut u);
        let mobility = dot(row, &u);
        if let Some(constant) = stiffness[k]
            && constant * mobility > 0.0
        {
            u.iter_mut().for_each(|x| *x /= mobility.sqrt());
            springs.push((k, constant, u, constant * mobility));
        }
    }
    for (k, _, u, own) in &springs {
        let mut rest: f64 =
            (0..ndof).map(|i| u[i] * dot(&reduced.stiffness[i * ndof..(i + 1) * ndof], u)).sum();
        for (j, constant, ..) in &springs {
            rest -= constant * dot(&rows[j * ndof..(j + 1) * ndof], u).powi(2);
        }
        let elongation = system.displacement(*k, &state.q).abs();
        let length = displacements[*k].length;
        let strain = (elongation + rates[*k].abs() / own.sqrt()) / length;
        let turning = system.displacement_curvature(*k, &state.q, &state.v) / length;
        let required = if length.is_finite() { STIFF } else { STIFF_BUSHING };
        stiff[*k] = *own > required * (rest.abs() + turning.abs()) && strain < LARGEST_STRAIN;
    }
    stiff
}
