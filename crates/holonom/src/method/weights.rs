//! Error weights on all coordinates: per body, translation and rotation, position and velocity, against the
//! ground and against the bodies that it is tied to.

use super::ties::Ties;
use crate::math::vector::larger;
use crate::model::Tolerance;
use crate::system::{ExtraStateScale, Measure, Sizes, State, System};
use std::f64::consts::TAU;

/// Inverse squares of the tolerances of one body: translation, rotation, velocity, angular velocity.
type BodyWeights = [f64; 4];

/// The norm of `docs/theory/method.md` (3)-(9c): a change is measured on all coordinates of each body, so that neither the
/// choice of independent coordinates nor the place of the model in space changes it.
///
/// Positions are weighed against absolute + relative × movement since the start, velocities against
/// absolute + relative × value; a change of Euler parameters δp is the angle 2|δp|. The movement of
/// an orientation is the angle to that at the start, at most π, planar as in space. RMS within a body,
/// maximum over bodies, pairs of tied bodies and extra states.
#[derive(Debug, Clone)]
pub struct Weights {
    tolerance: Tolerance,
    start: Vec<f64>,
    sizes: Sizes,
    /// 2 for Euler parameters, 1 for an angle.
    angle_factor: f64,
    bodies: Vec<BodyWeights>,
    extra_scales: Vec<ExtraStateScale>,
    extra: Vec<f64>,
    ties: Ties,
    independent: Option<Independent>,
}

/// The norm of the thesis: root mean square over the entries of w = (v, v̇, z), each against
/// absolute + relative × |w|. Source: thesis (4.6), (4.7).
#[derive(Debug, Clone, Default)]
struct Independent {
    /// |w| at the start of the step.
    size: Vec<f64>,
    absolute: Vec<f64>,
}

fn square(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum()
}

fn length(x: &[f64]) -> f64 {
    square(x).sqrt()
}

impl Weights {
    /// Weights of a run that starts at `start`.
    pub fn new(tolerance: Tolerance, system: &dyn System, start: &State) -> Self {
        let structure = system.structure();
        let ties = Ties::new(structure, start);
        Self::of(tolerance, &structure.sizes, ties, system.extra_state_scales(), start)
    }

    fn of(
        tolerance: Tolerance,
        sizes: &Sizes,
        ties: Ties,
        extra_scales: Vec<ExtraStateScale>,
        start: &State,
    ) -> Self {
        let mut out = Self {
            tolerance,
            start: start.q.clone(),
            sizes: *sizes,
            angle_factor: sizes.angle_factor(),
            bodies: vec![[1.0; 4]; sizes.bodies],
            extra_scales,
            extra: vec![1.0; sizes.extra_states],
            ties,
            independent: None,
        };
        out.set(start);
        out
    }

    /// The same tolerances in the norm of the thesis.
    pub fn of_independent_coordinates(self) -> Self {
        Self { independent: Some(Independent::default()), ..self }
    }

    /// Whether norms are those of the independent coordinates.
    pub fn are_independent(&self) -> bool {
        self.independent.is_some()
    }

    /// Takes the scales of w at the start of a step; `measure` of the independent coordinates.
    pub fn set_independent(&mut self, w: &[f64], measure: impl Fn(usize) -> Measure, ndof: usize) {
        let Tolerance { translation, rotation, .. } = self.tolerance;
        let Some(independent) = &mut self.independent else { return };
        independent.size.resize(w.len(), 0.0);
        independent.absolute.resize(w.len(), 0.0);
        for (i, w) in w.iter().enumerate() {
            independent.size[i] = w.abs();
            let angle = match i.checked_sub(2 * ndof) {
                Some(k) => self.extra_scales[k].angle,
                None => measure(i % ndof) == Measure::Angle,
            };
            independent.absolute[i] = if angle { rotation } else { translation };
        }
    }

    /// Norm of a change of w in the norm of the thesis; `end` is w at the end of the step, if known.
    pub fn independent_norm(&self, change: &[f64], end: Option<&[f64]>) -> f64 {
        let Some(independent) = &self.independent else { return f64::NAN };
        let mut sum = 0.0;
        for (i, change) in change.iter().enumerate() {
            let size = independent.size[i].max(end.map_or(0.0, |end| end[i].abs()));
            sum += (change / (independent.absolute[i] + self.tolerance.relative * size)).powi(2);
        }
        (sum / change.len().max(1) as f64).sqrt()
    }

    /// Takes the scales of the state that a step starts from.
    pub fn set(&mut self, state: &State) {
        let Tolerance { relative, translation, rotation } = self.tolerance;
        let [places, starts, velocities] =
            [&state.q, &self.start, &state.v].map(|x| self.sizes.by_body(x));
        for (((weights, [r, p]), [r0, p0]), [v, w]) in
            self.bodies.iter_mut().zip(places).zip(starts).zip(velocities)
        {
            let moved = r.iter().zip(r0).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
            let turned = if self.sizes.is_planar() {
                let angle = (p[0] - p0[0]).abs() % TAU;
                angle.min(TAU - angle)
            } else {
                let cosine: f64 = p.iter().zip(p0).map(|(x, y)| x * y).sum();
                2.0 * cosine.abs().min(1.0).acos()
            };
            *weights = [
                translation + relative * moved,
                rotation + relative * turned,
                translation + relative * length(v),
                rotation + relative * self.angle_factor * length(w),
            ]
            .map(|scale| scale.powi(-2));
        }
        self.ties.set(state, &self.tolerance);
        let scaled = self.extra_scales.iter().zip(&state.z);
        for (weight, (scale, z)) in self.extra.iter_mut().zip(scaled) {
            let absolute = if scale.angle { rotation } else { translation };
            *weight = scale.one * absolute + relative * z.abs();
        }
    }

    /// Weighted norm of a change of positions, velocities and extra states; 1 is on tolerance. `at` are the
    /// coordinates and velocities that change, where they are known.
    pub fn norm(&mut self, at: Option<[&[f64]; 2]>, [dq, dv]: [&[f64]; 2], dz: &[f64]) -> f64 {
        let largest = if self.sizes.is_planar() {
            largest_square::<3, 2>(dq, dv, &self.bodies)
        } else {
            largest_square::<7, 3>(dq, dv, &self.bodies)
        };
        let mut largest = 0.5 * largest.sqrt();
        if let Some(at) = at {
            largest = larger(largest, self.ties.norm(at, [dq, dv]));
        }
        for (z, scale) in dz.iter().zip(&self.extra) {
            largest = larger(largest, (z / scale).abs());
        }
        largest
    }

    /// A change of positions alone, body by body: the larger of the weighted translation and rotation.
    pub fn displacements(&self, dq: &[f64]) -> impl Iterator<Item = f64> {
        let turns = self.angle_factor * self.angle_factor;
        self.sizes.by_body(dq).zip(&self.bodies).map(move |([r, p], weights)| {
            larger(weights[0] * square(r), weights[1] * turns * square(p)).sqrt()
        })
    }

    /// The largest of these.
    pub fn displacement(&self, dq: &[f64]) -> f64 {
        self.displacements(dq).fold(0.0, larger)
    }

    /// Speed, m/s, and rate of turning, rad/s, of each body.
    pub fn speeds(&self, v: &[f64]) -> impl Iterator<Item = [f64; 2]> {
        let turns = self.angle_factor;
        self.sizes.by_body(v).map(move |[v, w]| [length(v), turns * length(w)])
    }

    /// A change of velocities, body by body, against absolute + relative × its largest speed: the larger of translation and
    /// rotation.
    pub fn velocity_changes(&self, dv: &[f64], largest: &[[f64; 2]]) -> impl Iterator<Item = f64> {
        let Tolerance { relative, translation, rotation } = self.tolerance;
        self.speeds(dv).zip(largest).map(move |([moved, turned], [speed, rate])| {
            let turned = turned / (rotation + relative * rate);
            larger(moved / (translation + relative * speed), turned)
        })
    }
}

/// Largest sum over the bodies of four weighted squares.
fn largest_square<const N: usize, const D: usize>(
    dq: &[f64],
    dv: &[f64],
    bodies: &[BodyWeights],
) -> f64 {
    // An Euler parameter counts as half an angle.
    let turns = if N == 7 { 4.0 } else { 1.0 };
    let mut largest = 0.0f64;
    let changes = dq.as_chunks::<N>().0.iter().zip(dv.as_chunks::<N>().0);
    for ((q, v), weights) in changes.zip(bodies) {
        let squares = weights[0] * square(&q[..D])
            + weights[1] * turns * square(&q[D..])
            + weights[2] * square(&v[..D])
            + weights[3] * turns * square(&v[D..]);
        largest = larger(largest, squares);
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(per_body: usize, translations: usize) -> Sizes {
        Sizes {
            bodies: 1,
            coordinates: per_body,
            per_body,
            translations,
            rows: 0,
            joint_rows: 0,
            extra_states: 0,
            windings: 0,
        }
    }

    #[test] // independent truth: the same turn of a body about z, planar and in space
    fn a_turn_is_weighed_alike_in_the_plane_and_in_space() {
        let tolerance = Tolerance { relative: 1e-2, translation: 1e-3, rotation: 1e-4 };
        let spatial = |angle: f64| {
            let (s, c) = (0.5 * angle).sin_cos();
            State { q: vec![0.0, 0.0, 0.0, c, 0.0, 0.0, s], v: vec![0.0; 7], ..State::default() }
        };
        let planar =
            |angle| State { q: vec![0.0, 0.0, angle], v: vec![0.0; 3], ..State::default() };
        for angle in [0.0, 0.5, 3.0, 3.3, 6.0, 7.0, -4.0, 50.0] {
            let mut flat =
                Weights::of(tolerance, &sizes(3, 2), Ties::default(), Vec::new(), &planar(0.2));
            let mut deep =
                Weights::of(tolerance, &sizes(7, 3), Ties::default(), Vec::new(), &spatial(0.2));
            flat.set(&planar(0.2 + angle));
            deep.set(&spatial(0.2 + angle));
            let norm = flat.norm(None, [&[0.0, 0.0, 1e-3], &[0.0; 3]], &[]);
            let same = deep.norm(None, [&[0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.5e-3], &[0.0; 7]], &[]);
            assert!((norm - same).abs() < 1e-6 * norm, "{angle}: {norm} {same}");
        }
    }
}
