//! Which force elements are stiff against the motion, and how they would vibrate in the mechanism.

use crate::system::{Measure, RelativeKind, Resistance, State, System};
use holonom_linalg::{BlockMatrix, DenseLu, SparseLu, SparsePattern};

/// A force element is stiff if the square of its frequency is more than this times that of the motion:
/// it then keeps its deformation small and sets the pace if its direction turns.
pub(super) const STIFF: f64 = 100.0;
/// Steps per unit of the motion's pace that an element's damper is judged by.
pub(super) const STEPS: f64 = 10.0;
/// What constraints that depend on others are softened by, against the size of their rows.
const SOFTENED: f64 = 1e-12;

/// Matrices of so many rows are factored faster as dense ones: a search for pivots in a sparse one costs about 10⁵ operations a row.
const DENSE: usize = 300;

/// The pace of the motion, 1/s: how fast bodies turn, or fall through the size of the model.
pub(super) fn pace(system: &dyn System, state: &State) -> f64 {
    let length = system.characteristic_length();
    let mut pace = (system.gravity() / length).sqrt();
    for b in 0..system.structure().sizes.bodies {
        let body = system.body(b, &state.q, &state.v);
        pace = pace.max(norm(&body.angular_velocity));
    }
    pace.max(f64::MIN_POSITIVE)
}

/// Part of a length beyond which it would have to be drawn in if it is to be no coordinate, as it could vanish.
const VANISHING: f64 = 0.75;

/// Whether a deformation that changes at a rate stays away from where it is singular while the element stops it, `square` being
/// that of its frequency: only lengths can vanish.
pub(super) fn stays_regular(
    kind: RelativeKind,
    [value, rate]: [f64; 2],
    resistance: &Resistance,
    square: f64,
) -> bool {
    let inwards = resistance.drawn + (-rate).max(0.0) / square.sqrt();
    kind != RelativeKind::Length || inwards < VANISHING * value
}

/// Rate of a relative coordinate, from its gradient over its two bodies.
pub(super) fn rate_along(gradient: &[f64], bodies: [Option<usize>; 2], v: &[f64]) -> f64 {
    let n = gradient.len() / 2;
    let of_body = |(part, body): (&[f64], Option<usize>)| {
        let own = body.map_or(&[][..], |b| &v[b * n..(b + 1) * n]);
        part.iter().zip(own).map(|(a, x)| a * x).sum::<f64>()
    };
    gradient.chunks_exact(n).zip(bodies).map(of_body).sum()
}

/// Whether a force element would be stiff if its bodies were free: they can only be slower.
pub(super) fn could_be_stiff(
    system: &dyn System,
    state: &State,
    elastic: usize,
    pace: f64,
) -> bool {
    let sizes = system.structure().sizes;
    let n = sizes.per_body;
    let mut first = 0;
    for &group in &system.tree().elastic[elastic].groups {
        let info = &system.relative_groups()[group];
        let reference = [0.0; 6];
        let (mut values, mut gradient) = ([0.0; 3], [0.0; 42]);
        let reference = system.moved_reference(group, &state.q, &reference);
        system.relative_value(group, &reference, &state.q, &mut values[..info.rows]);
        let gradient = &mut gradient[..info.rows * 2 * n];
        system.relative_gradient(group, &reference, &state.q, gradient);
        for (row, gradient) in gradient.chunks_exact(2 * n).enumerate() {
            let resistance = system.resistance(elastic, first + row, values[row], STEPS * pace);
            let stiffness = resistance.stiffness;
            let mut mobility = 0.0;
            for (side, body) in info.bodies.into_iter().enumerate() {
                let Some(body) = body else { continue };
                let part = &gradient[side * n..(side + 1) * n];
                let scale = sizes.angle_factor().powi(-2);
                let [r, p] = part.split_at(sizes.translations).into();
                mobility += norm(r).powi(2) / system.mass(body)
                    + scale * norm(p).powi(2) / system.least_inertia(body);
            }
            let strength = stiffness * mobility;
            let motion = [values[row], rate_along(gradient, info.bodies, &state.v)];
            if stiffness > 0.0
                && (strength.is_nan() || strength > STIFF * pace * pace)
                && stays_regular(info.kind, motion, &resistance, strength)
            {
                return true;
            }
        }
        first += info.rows;
    }
    false
}

/// Mobilities g M⁻¹gᵀ on the mechanism of several gradients: the inverse of the inertia that each feels where
/// nothing but constraints holds it, 1/kg or 1/(kg m²).
///
/// With the constraints' multipliers they are gᵀ[M Gᵀ; G −ε]⁻¹g, and only the places of the inverse that
/// belong to the bodies of a gradient are evaluated, all at once. ε = 1e-12 does for rows that others imply.
///
/// Each gradient belongs to two bodies and has `per_body` entries for either. All are infinite where no mass
/// is behind a motion.
pub(super) fn mobilities(
    system: &dyn System,
    q: &[f64],
    g: &BlockMatrix,
    gradients: &[([Option<usize>; 2], Vec<f64>)],
) -> Vec<f64> {
    let structure = system.structure();
    let (n, m) = (structure.sizes.coordinates, structure.sizes.rows);
    let length = system.characteristic_length();
    let scale_of = |measure| if measure == Measure::Length { length } else { 1.0 };
    let scale: Vec<f64> = (0..n).map(|i| scale_of(structure.coordinate_measure(i))).collect();
    let mut mass = structure.mass_pattern.zeros();
    system.mass_matrix(q, &mut mass);
    let heaviest = (mass.entries(0, 0).into_iter().zip(mass.values()))
        .fold(0.0f64, |most, ((i, j), x)| most.max((x * scale[i] * scale[j]).abs()));
    let mut entries: Vec<(usize, usize)> = (0..m).map(|k| (n + k, n + k)).collect();
    let mut numbers = vec![-SOFTENED; m];
    for ((i, j), x) in mass.entries(0, 0).into_iter().zip(mass.values()) {
        if *x != 0.0 {
            entries.push((i, j));
            numbers.push(x * scale[i] * scale[j] / heaviest);
        }
    }
    for ((row, j), x) in g.entries(0, 0).into_iter().zip(g.values()) {
        if *x != 0.0 {
            entries.extend([(n + row, j), (j, n + row)]);
            numbers.extend([x * scale[j] / scale_of(structure.row_measure[row]); 2]);
        }
    }
    // Places of the inverse that are asked for.
    let columns = |bodies: &[Option<usize>; 2]| -> Vec<(usize, usize)> {
        let sides = bodies.iter().enumerate();
        let side = |(side, body): (usize, &Option<usize>)| {
            body.map(|b| (side * structure.sizes.per_body..).zip(structure.sizes.of_body(b)))
        };
        sides.filter_map(side).flatten().collect()
    };
    let matrix = (entries.iter().copied()).zip(numbers.iter().copied());
    if n + m <= DENSE
        && let Some(lu) = dense(n + m, matrix)
    {
        let mobility = |(bodies, gradient): &([Option<usize>; 2], Vec<f64>)| {
            let mut along = vec![0.0; n + m];
            for (at, i) in columns(bodies) {
                along[i] += gradient[at] * scale[i];
            }
            let mut moved = along.clone();
            lu.solve(&mut moved);
            along.iter().zip(moved).map(|(a, x)| a * x).sum::<f64>() / heaviest
        };
        return gradients.iter().map(mobility).collect();
    }
    let stored = entries.len();
    for (bodies, gradient) in gradients {
        let mut used = columns(bodies);
        used.retain(|(at, _)| gradient[*at] != 0.0);
        entries.extend(used.iter().flat_map(|(_, i)| used.iter().map(|(_, j)| (*j, *i))));
    }
    let (pattern, slots) = SparsePattern::new(n + m, n + m, &entries);
    let mut values = vec![0.0; pattern.len()];
    for (slot, x) in slots.iter().zip(numbers) {
        values[*slot] += x;
    }
    let Ok(lu) = SparseLu::analyze(&pattern, &values) else {
        return vec![f64::INFINITY; gradients.len()];
    };
    let inverse = lu.inverse_entries(&pattern);
    let mut asked = slots[stored..].iter();
    let mobility = |(bodies, gradient): &([Option<usize>; 2], Vec<f64>)| {
        let mut used = columns(bodies);
        used.retain(|(at, _)| gradient[*at] != 0.0);
        let sized = |(at, i): &(usize, usize)| gradient[*at] * scale[*i];
        let mut sum = 0.0;
        for a in &used {
            for b in &used {
                sum += sized(a) * sized(b) * asked.next().map_or(0.0, |slot| inverse[*slot]);
            }
        }
        sum / heaviest
    };
    gradients.iter().map(mobility).collect()
}

/// The factors of a matrix of n rows, if it has any.
fn dense(n: usize, entries: impl Iterator<Item = ((usize, usize), f64)>) -> Option<DenseLu> {
    let mut a = vec![0.0; n * n];
    entries.for_each(|((i, j), x)| a[i * n + j] += x);
    let mut lu = DenseLu::new(n);
    lu.factor(&a).ok()?;
    Some(lu)
}

fn norm(x: &[f64]) -> f64 {
    x.iter().map(|v| v * v).sum::<f64>().sqrt()
}
