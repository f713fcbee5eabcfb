//! How far a step of the assembly goes.
//!
//! Rows of joints are linear in how far bodies slide; what bends them is how far bodies and rods turn. So a
//! step turns nothing by more than [`FURTHEST`] and slides as far as joints are open, and as turning by so much
//! takes along. Sizes are those of vectors: a common rotation of the model changes none of them.

use super::closing::scale;
use crate::system::{Measure, RowKind, System};
use holonom_linalg::BlockMatrix;

/// By how much a step may turn a body (rad, |δp|) or a rod (against its length).
const FURTHEST: f64 = 0.5;
/// How many times as far a step with less turning has to go to be preferred to the shortest, and how many times the
/// turning that must be it may have: what bodies have to turn in both decides nothing by its round-off.
const WORTH: f64 = 2.0;
/// Lengths are measured in no more characteristic lengths than these: beyond, the rank of rows that turn bodies only
/// would be lost.
const MOST_LENGTHS: f64 = 1e5;
/// Turning by less, against how far bodies slide, is round-off.
const NO_TURN: f64 = 1e-9;

/// How far a step slides and turns the body that it slides and turns most, lengths against the characteristic one.
fn largest(system: &dyn System, step: &[f64]) -> [f64; 2] {
    let sizes = system.structure().sizes;
    let norm = |x: &[f64]| x.iter().map(|x| x * x).sum::<f64>().sqrt();
    step.chunks_exact(sizes.per_body).fold([0.0, 0.0], |[slid, turned]: [f64; 2], x| {
        let (r, p) = x.split_at(sizes.translations);
        [slid.max(scale(system, 0) * norm(r)), turned.max(norm(p))]
    })
}

/// A step shortened until it slides and turns no body by more than [`FURTHEST`]; what only slides is as long as it is.
pub(super) fn short(system: &dyn System, mut step: Vec<f64>) -> Vec<f64> {
    let [slid, turned] = largest(system, &step);
    let longest = slid.max(turned);
    if longest > FURTHEST && turned > NO_TURN * slid {
        step.iter_mut().for_each(|x| *x *= FURTHEST / longest);
    }
    step
}

/// The step from `q` that goes for all of the residual where it can without turning anything by more than [`FURTHEST`],
/// and for part of it elsewhere. `solve` gives the shortest step with lengths measured in so many characteristic
/// lengths, `g` is G(q), `open` by how much joints are open, m.
pub(super) fn step(
    system: &dyn System,
    q: &[f64],
    g: &BlockMatrix,
    open: f64,
    solve: impl Fn(f64) -> Option<Vec<f64>>,
) -> Option<Vec<f64>> {
    let mut step = solve(1.0)?;
    let [slid, turned] = largest(system, &step);
    if slid.max(turned) <= FURTHEST {
        return Some(step);
    }
    let furthest =
        scale(system, 0) * open + FURTHEST * (scale(system, 0) * lever(system, g)).max(1.0);
    let part = |step: &[f64]| {
        let [slid, turned] = largest(system, step);
        if turned <= NO_TURN * slid {
            return 1.0;
        }
        (FURTHEST / turned).min(furthest / slid).min(1.0)
    };
    // Over a long way the shortest step turns bodies where sliding them would do: steps with all of the residual lie
    // between it and one for which that way is short.
    if slid > FURTHEST && turned > FURTHEST {
        let mut other = solve((slid / FURTHEST).min(MOST_LENGTHS))?;
        let allowed = FURTHEST.max(WORTH * largest(system, &other)[1]);
        let way = part_within(system, allowed, &other, &step);
        for (other, x) in other.iter_mut().zip(&step) {
            *other += way * (x - *other);
        }
        if part(&other) > WORTH * part(&step) {
            step = other;
        }
    }
    let shortened = part(&step);
    step.iter_mut().for_each(|x| *x *= shortened);
    let turned = rods_turn(system, q, g, &step);
    if turned > FURTHEST {
        step.iter_mut().for_each(|x| *x *= FURTHEST / turned);
    }
    Some(step)
}

/// Rows in metres of each joint and driver. Together their sizes do not depend on the axes that they are taken along.
fn rows_in_metres(system: &dyn System) -> impl Iterator<Item = impl Iterator<Item = usize>> {
    let structure = system.structure();
    structure.joints.iter().map(|joint| {
        let rows = joint.row..joint.row + joint.rows;
        rows.filter(|&row| structure.row_measure[row] == Measure::Length)
    })
}

/// By how much the joint or driver is open that is so most, m.
pub(super) fn most_open(system: &dyn System, residual: &[f64]) -> f64 {
    let squares = rows_in_metres(system).map(|rows| rows.map(|row| residual[row].powi(2)).sum());
    squares.fold(0.0f64, f64::max).sqrt()
}

/// The longest arm by which turning a body moves a joint, m.
fn lever(system: &dyn System, g: &BlockMatrix) -> f64 {
    let structure = system.structure();
    // Per row: the squares of its gradient to places and to orientations.
    let mut squares = vec![[0.0, 0.0]; structure.sizes.rows];
    for ((row, i), x) in g.entries(0, 0).into_iter().zip(g.values()) {
        let turns = structure.coordinate_measure(i) == Measure::Angle;
        squares[row][usize::from(turns)] += x * x;
    }
    let arms = rows_in_metres(system).map(|rows| {
        let [slide, turn] = rows.fold([0.0, 0.0], |[slide, turn]: [f64; 2], row| {
            [slide + squares[row][0], turn + squares[row][1]]
        });
        if slide > 0.0 { turn / slide } else { 0.0 }
    });
    arms.fold(0.0, f64::max).sqrt()
}

/// The largest part, at most 1, of the way from `from` to `to` on which no body turns by more than `allowed`.
fn part_within(system: &dyn System, allowed: f64, from: &[f64], to: &[f64]) -> f64 {
    let sizes = system.structure().sizes;
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let bodies = from.chunks_exact(sizes.per_body).zip(to.chunks_exact(sizes.per_body));
    bodies.fold(1.0, |part: f64, (from, to)| {
        let (from, to) = (&from[sizes.translations..], &to[sizes.translations..]);
        if dot(to, to) <= allowed * allowed {
            return part;
        }
        // |from + part (to − from)|² = allowed².
        let way: Vec<f64> = to.iter().zip(from).map(|(to, from)| to - from).collect();
        let (a, b) = (dot(&way, &way), dot(from, &way));
        let c = (dot(from, from) - allowed * allowed).min(0.0);
        part.min(((b * b - a * c).sqrt() - b) / a)
    })
}

/// By how much the step from `q` changes the vector between the ends of a rod at most, against the larger one of its
/// length and the distance of its ends: the gradient of its row to a place is that vector, in lengths of the rod.
fn rods_turn(system: &dyn System, q: &[f64], g: &BlockMatrix, step: &[f64]) -> f64 {
    let structure = system.structure();
    let sizes = structure.sizes;
    let is_rod: Vec<bool> =
        (0..sizes.joint_rows).map(|row| system.row_item(row).1 == RowKind::Distance).collect();
    if !is_rod.contains(&true) {
        return 0.0;
    }
    let there: Vec<f64> = q.iter().zip(step).map(|(q, x)| q - x).collect();
    let mut next = structure.constraint_pattern.zeros();
    system.constraint_jacobian(&there, &mut next);
    // Per row: the squares of the vector and of its change, as often as the rod has bodies, and their number.
    let mut rods = vec![[0.0; 3]; sizes.joint_rows];
    for (((row, i), x), y) in g.entries(0, 0).into_iter().zip(g.values()).zip(next.values()) {
        if row < sizes.joint_rows && is_rod[row] && i % sizes.per_body < sizes.translations {
            let [vector, change, bodies] = &mut rods[row];
            *vector += x * x;
            *change += (y - x) * (y - x);
            *bodies += 1.0 / sizes.translations as f64;
        }
    }
    let turns = rods.iter().filter(|[.., bodies]| *bodies > 0.0);
    turns
        .fold(0.0, |most, [vector, change, bodies]| most.max((change / vector.max(*bodies)).sqrt()))
}
