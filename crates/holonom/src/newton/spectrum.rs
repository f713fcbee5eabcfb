//! Eigenvalues of the linearized motion.

use super::blocks::ReducedBlocks;
use crate::error::EvaluationFailure;
use crate::math::spatial::cross;
use crate::math::vector::{add_scaled, difference, scaled, sum};
use crate::reduction::{Manifold, Relatives};
use crate::system::{BodyPose, RelativeKind, State, System};
use holonom_linalg::{DecompositionError, eigenvalues};

/// Why there is no spectrum.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SpectrumError {
    /// The equations could not be evaluated.
    #[error(transparent)]
    Evaluation(#[from] EvaluationFailure),
    /// The eigenvalue iteration failed.
    #[error("the eigenvalues could not be computed: {0}")]
    Decomposition(#[from] DecompositionError),
}

/// Small rotations θ in place of rotation vectors x, whose reference goes along with the motion, and, of what is measured from
/// bodies that themselves turn freely, θ and displacements along axes that do not turn with these: in them the linearized
/// equations of rotors that are the same about their axes have constant coefficients. Equations: `docs/theory/newton.md` (26), (27).
#[derive(Debug, Clone, Default)]
pub struct SmallRotations {
    ndof: usize,
    turning: Vec<Turning>,
}

/// Variables of one body: two or three that are neighbours, and Ḣ and Ḧ of them.
#[derive(Debug, Clone)]
struct Turning {
    first: usize,
    count: usize,
    matrices: [Matrix3; 2],
}

type Vector3 = [f64; 3];
type Matrix3 = [[f64; 3]; 3];

impl Turning {
    /// Places of entries with those of Ḣ and Ḧ.
    fn entries(&self) -> impl Iterator<Item = ([usize; 2], [f64; 2])> + '_ {
        let n = self.count;
        (0..n * n).map(move |k| {
            let (r, c) = (k / n, k % n);
            ([self.first + r, self.first + c], self.matrices.map(|matrix| matrix[r][c]))
        })
    }
}

impl SmallRotations {
    /// Of the rotation vectors among the independent variables of a manifold that stands at a complete state, of which three
    /// numbers are independent, or two beside one that stands still against what turns the body, as a driver of its speed, and of
    /// displacements of three.
    pub fn new(manifold: &Manifold, state: &State) -> Self {
        let ndof = manifold.chart().ndof();
        let mut turning = Vec::new();
        if let Some(relatives) = manifold.chart().parametrization().relatives() {
            let groups = manifold.system().relative_groups();
            let mut axes = Axes::new(manifold, relatives, state);
            for (group, range) in relatives.runs() {
                let kind = groups[group].kind;
                let turned = if groups[group].rows == 3 { axes.turn(group) } else { None };
                let own = match kind {
                    _ if is_free(kind, range.len()) => {
                        relatives.motion(manifold.system().as_ref(), group, state)
                    }
                    RelativeKind::Displacement if range.len() == 3 && turned.is_some() => {
                        [[0.0; 3]; 2]
                    }
                    _ => continue,
                };
                let whole = turning_matrices(own, turned.unwrap_or_default());
                let (first, count) = (range.start, range.len());
                let mut matrices = [[[0.0; 3]; 3]; 2];
                for (r, c) in (0..count * count).map(|k| (k / count, k % count)) {
                    let [of_row, of_column] = [r, c].map(|k| relatives.rows[first + k].1);
                    for (matrix, whole) in matrices.iter_mut().zip(&whole) {
                        matrix[r][c] = whole[of_row][of_column];
                    }
                }
                turning.push(Turning { first, count, matrices });
            }
        }
        Self { ndof, turning }
    }

    /// (δθ, δθ̇) become (δx, δẋ).
    pub fn to_vectors(&self, change: &mut [f64]) {
        for ([r, c], [first, _]) in self.entries() {
            change[self.ndof + r] -= first * change[c];
        }
    }

    /// (δẋ, δẍ) of the change (δx, δẋ) become (δθ̇, δθ̈).
    pub fn to_rotations(&self, change: &[f64], rates: &mut [f64]) {
        for ([r, c], [first, second]) in self.entries() {
            let [x, rate] = [change[c], change[self.ndof + c]];
            rates[r] += first * x;
            rates[self.ndof + r] += 2.0 * first * rate + second * x;
        }
    }

    /// J of order n by rows, of (x, ẋ, …), becomes that of (θ, θ̇, …).
    fn change(&self, n: usize, j: &mut [f64]) {
        for ([r, c], [first, second]) in self.entries() {
            j[r * n + c] += first;
            j[(self.ndof + r) * n + c] += second;
            j[(self.ndof + r) * n + self.ndof + c] += 2.0 * first;
        }
        for row in j.chunks_exact_mut(n) {
            for ([r, c], [first, _]) in self.entries() {
                row[c] -= row[self.ndof + r] * first;
            }
        }
    }

    fn entries(&self) -> impl Iterator<Item = ([usize; 2], [f64; 2])> + '_ {
        self.turning.iter().flat_map(Turning::entries)
    }
}

/// Whether so many independent numbers of a rotation let a body tilt: all of them, or those that a driver of its speed leaves.
fn is_free(kind: RelativeKind, count: usize) -> bool {
    kind == RelativeKind::Rotation && count >= 2
}

/// Ḣ and Ḧ, R = H = 1, of a rotation vector with rates ẋ and ẍ, along axes that turn by n and ṅ: (26), (27).
fn turning_matrices([x, x_rate]: [Vector3; 2], [n, n_rate]: [Vector3; 2]) -> [Matrix3; 2] {
    let mut out = [[[0.0; 3]; 3]; 2];
    for c in 0..3 {
        let mut unit = [0.0; 3];
        unit[c] = 1.0;
        let by_vector = scaled(&cross(&x, &unit), 0.5);
        let first = sum(&by_vector, &cross(&n, &unit));
        let mut second = cross(&sum(&scaled(&x_rate, 0.5), &n_rate), &unit);
        add_scaled(&mut second, 2.0 / 3.0, &cross(&x, &by_vector));
        add_scaled(&mut second, 1.0, &cross(&n, &sum(&first, &by_vector)));
        for r in 0..3 {
            out[0][r][c] = first[r];
            out[1][r][c] = second[r];
        }
    }
    out
}

/// The axes along which relative coordinates are measured.
struct Axes<'a> {
    system: &'a dyn System,
    relatives: &'a Relatives,
    state: &'a State,
    /// Of each body the next one inwards, itself included, on whose way to the ground nothing tilts freely.
    carriers: Vec<Option<usize>>,
    /// The configuration, and velocities of one moved body.
    moved: [Vec<f64>; 2],
}

impl<'a> Axes<'a> {
    fn new(manifold: &'a Manifold, relatives: &'a Relatives, state: &'a State) -> Self {
        let system = manifold.system().as_ref();
        let groups = system.relative_groups();
        let mut tilts = vec![false; groups.len()];
        for (group, range) in relatives.runs() {
            tilts[group] = is_free(groups[group].kind, range.len());
        }
        let tree = system.tree();
        let mut carriers = vec![None; system.structure().sizes.bodies];
        for (edge, &form) in tree.edges.iter().zip(&*relatives.forms) {
            let inner = edge.parent.and_then(|parent| carriers[parent]);
            let tilts = edge.forms[form].clone().any(|group| tilts[group]);
            carriers[edge.body] =
                if tilts || inner != edge.parent { inner } else { Some(edge.body) };
        }
        let moved = [state.q.clone(), vec![0.0; state.v.len()]];
        Self { system, relatives, state, carriers, moved }
    }

    /// n and ṅ of a group of three, along its axes: their angular velocity against the carrier of the body in which they are
    /// fixed, and its rate; `None` where that body is the carrier.
    fn turn(&mut self, group: usize) -> Option<[Vector3; 2]> {
        let [first, second] = self.system.relative_groups()[group].bodies;
        let body = first.filter(|&body| self.carriers[body] != first)?;
        let carrier = self.carriers[body];
        let State { q, v, a, .. } = self.state;
        // E(ṗ)ṗ = 0: p̈ gives angular accelerations as ṗ gives angular velocities.
        let [[turning, base], [change, base_change]] = [v, a].map(|v| {
            [Some(body), carrier]
                .map(|b| b.map_or([0.0; 3], |b| self.system.body(b, q, v).angular_velocity))
        });
        let rate = difference(&turning, &base);
        let change = sum(&difference(&change, &base_change), &cross(&turning, &base));
        // What is measured of a motion of the second body tells components along the axes.
        let (moved, sign) = second.map_or((body, -1.0), |second| (second, 1.0));
        Some([rate, change].map(|along| self.components(group, moved, scaled(&along, sign))))
    }

    /// Rates of a group of three where a body turns by, or in displacements moves by, a vector in ground axes.
    fn components(&mut self, group: usize, body: usize, along: Vector3) -> Vector3 {
        let Self { system, relatives, moved: [q, v], .. } = self;
        let still =
            BodyPose { velocity: [0.0; 3], angular_velocity: [0.0; 3], ..system.body(body, q, v) };
        let motion = match system.relative_groups()[group].kind {
            RelativeKind::Rotation => BodyPose { angular_velocity: along, ..still },
            _ => BodyPose { velocity: along, ..still },
        };
        let mut out = [0.0; 3];
        system.set_body(body, &motion, q, v);
        relatives.group_rates(*system, group, (0..3).map(|k| (k, k)), [q, v], &mut out);
        system.set_body(body, &still, q, v);
        out
    }
}

impl ReducedBlocks {
    /// Real and imaginary parts of the eigenvalues of J = g_w, 1/s, in small `rotations`.
    ///
    /// # Errors
    /// [`SpectrumError`].
    pub fn eigenvalues(
        &self,
        rotations: &SmallRotations,
    ) -> Result<Vec<(f64, f64)>, SpectrumError> {
        let mut j = self.jacobian()?;
        let ndof = self.order();
        let n = 2 * ndof + self.extra_extra.states();
        rotations.change(n, &mut j);
        // In time of the fastest vibration all entries are of one size; its square would be round-off in all the others.
        let stiffest = (0..ndof)
            .flat_map(|row| &j[(ndof + row) * n..(ndof + row) * n + ndof])
            .fold(0.0f64, |most, x| most.max(x.abs()));
        let rate = if stiffest > 0.0 && stiffest.is_finite() { stiffest.sqrt() } else { 1.0 };
        let is_rate = |k: usize| (ndof..2 * ndof).contains(&k);
        for (e, x) in j.iter_mut().enumerate() {
            match [is_rate(e / n), is_rate(e % n)] {
                [true, false] => *x /= rate,
                [false, true] => *x *= rate,
                _ => {}
            }
        }
        Ok(eigenvalues(n, &j)?)
    }
}
