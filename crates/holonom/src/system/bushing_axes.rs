//! Which of its two bodies carries the axes that the deformations of a bushing are measured along.
//!
//! A stiff force holds a deformation in balance with its load, and formulas leave the least error on it where it rests. Loads rest
//! in the part whose centre of mass swings about the bushings, which its turning makes, or in the one that it swings against,
//! the weight. Equations: `docs/theory/reduction.md` (31a)-(31d).

use crate::math::matrix::{Matrix3, inverse, product, skew, transposed};
use crate::math::vector::{difference, dot, scaled, sum};
use crate::model::{BodyIndex, ForceKind, JointKind, Model};
use std::array::from_fn;
use std::collections::BTreeMap;

/// Distance of a centre of mass from the axis, in radii of gyration, below which a part is balanced and bears its weight.
const BALANCED: f64 = 1e-2;
/// Part by which loads differ that are alike.
const ALIKE: f64 = 1e-2;
/// Part of a law that a turn of one radian may change: beyond it, even ForRadau takes more steps along axes that turn against
/// those of the law than along these.
const SAME: f64 = 0.25;
/// Part of the stiffness about all axes that is added, for those that nothing resists.
const NONE_RESISTS: f64 = 1e-9;

/// Stiffness and damping of a bushing with its branches about a point, in ground axes of the design configuration.
struct Bushing {
    /// Its place among the forces, its bodies, and the point.
    force: usize,
    ends: [BodyIndex; 2],
    point: [f64; 3],
    laws: [Law; 2],
}

/// A symmetric 6×6 matrix in 3×3 blocks of displacements and rotations.
#[derive(Clone, Copy, Default)]
struct Law {
    along: Matrix3,
    mixed: Matrix3,
    around: Matrix3,
}

/// What no joint lets turn against each other, and the ground.
struct Part {
    /// Least depth in the forest, and the first body with it.
    rank: (usize, BodyIndex),
    /// kg; m in ground axes of the design configuration; kg m² about there. Infinite of what holds to the ground.
    mass: f64,
    center: [f64; 3],
    inertia: Option<Matrix3>,
}

/// Whether each force element is a bushing whose deformations are measured along axes of the second body. Bodies have a
/// `depth` in the forest, the ground 0.
pub(super) fn in_second_axes(model: &Model, depth: impl Fn(BodyIndex) -> usize) -> Vec<bool> {
    let mut out = vec![false; model.forces.len()];
    let bushings: Vec<Bushing> = (0..out.len()).filter_map(|k| Bushing::of(model, k)).collect();
    if bushings.is_empty() {
        return out;
    }
    let part_of = parts_of(model);
    let part = |body: BodyIndex| part_of[body.map_or(0, |b| b + 1)];
    let parts = Part::all(model, part, depth);
    let mut pairs: BTreeMap<[usize; 2], Vec<&Bushing>> = BTreeMap::new();
    for bushing in &bushings {
        let mut ends = bushing.ends.map(part);
        ends.sort_unstable_by_key(|&end| parts[end].rank);
        pairs.entry(ends).or_default().push(bushing);
    }
    for (ends, bushings) in pairs {
        let chosen = carrier(ends.map(|end| &parts[end]), &bushings).map(|at| ends[at]);
        for bushing in bushings {
            let [first, second] = bushing.ends.map(part);
            out[bushing.force] = chosen == Some(second) && first != second;
        }
    }
    out
}

/// The part that carries the axes of all bushings between two, of which the first is nearer to the root; `None` where those
/// of the law stay.
fn carrier(parts: [&Part; 2], bushings: &[&Bushing]) -> Option<usize> {
    let summed = |law: usize, about: &[f64; 3]| {
        bushings.iter().fold(Law::default(), |sum, bushing| {
            sum.plus(1.0, &bushing.laws[law].about(&difference(&bushing.point, about)))
        })
    };
    let middle = bushings.iter().fold([0.0; 3], |sum_, bushing| sum(&sum_, &bushing.point));
    let middle = scaled(&middle, (bushings.len() as f64).recip());
    let [springs, dampers] = [0, 1].map(|law| summed(law, &middle));
    // The lighter part vibrates or creeps on them: with `square` and at `rate` what resists rotations and rates is compared.
    let light = parts.into_iter().filter(|part| part.mass > 0.0 && part.inertia.is_some());
    let light = light.min_by(|a, b| a.mass.total_cmp(&b.mass))?;
    let arm = difference(&light.center, &middle);
    let square = light.inertia.map_or(0.0, |j| trace(&j)) / light.mass + dot(&arm, &arm);
    let square = if square > 0.0 { square } else { 1.0 };
    let size = |law: &Law| trace(&law.along) + trace(&law.around) / square;
    let rate = (size(&springs) / light.mass).sqrt().min(size(&springs) / size(&dampers));
    let rate = if rate > 0.0 { rate } else { 1.0 };
    let law = springs.plus(rate, &dampers);

    let turns = Turns::of(&law);
    let swings = parts.map(|part| turns.swing(part, &middle));
    let [near, far] = [swings[0].load(&swings[1]), swings[1].load(&swings[0])];
    let (mut changes, mut size) = (0.0, 0.0);
    for (law, weight) in bushings.iter().flat_map(|b| b.laws.iter().zip([1.0, rate * rate])) {
        changes += weight * law.square_by(square, |block| turns.change(block));
        size += weight * law.square_by(square, squared);
    }
    // So that what is not finite leaves the law's axes.
    let is_same = changes <= SAME * SAME * size;
    is_same.then_some(usize::from(far > near * (1.0 + ALIKE)))
}

/// The turns that a law resists least.
struct Turns {
    /// Mean of n nᵀ over unit turns n, with trace 1.
    mean: Matrix3,
    /// Displacement at the point of the law per turn.
    along: Matrix3,
}

impl Turns {
    /// Turns about the centre of a law, where they take least.
    fn of(law: &Law) -> Self {
        let softly = |m: &Matrix3| {
            let size = trace(m);
            inverse(&plus(m, if size > 0.0 { NONE_RESISTS * size } else { 1.0 }, &UNITS))
        };
        let along = product(&softly(&law.along), &law.mixed).map(|row| row.map(|x| -x));
        let resistance = plus(&law.around, 1.0, &product(&transposed(&law.mixed), &along));
        let mean = softly(&resistance);
        let size = trace(&mean);
        Self { mean: mean.map(|row| scaled(&row, size.recip())), along }
    }

    /// Mean of nᵀ Q n.
    fn mean(&self, q: &Matrix3) -> f64 {
        self.mean.iter().zip(q).map(|(a, b)| dot(a, b)).sum()
    }

    /// Mean of |ñ B − B ñ|².
    fn change(&self, block: &Matrix3) -> f64 {
        let changes = UNITS.map(|unit| {
            let turn = skew(&unit);
            plus(&product(&turn, block), -1.0, &product(block, &turn))
        });
        let dots =
            |a: &Matrix3, b: &Matrix3| -> f64 { a.iter().zip(b).map(|(a, b)| dot(a, b)).sum() };
        self.mean(&changes.map(|a| changes.map(|b| dots(&a, &b))))
    }

    /// How a part swings in these turns of a law about `point`.
    fn swing(&self, part: &Part, point: &[f64; 3]) -> Swing {
        let Some(inertia) = &part.inertia else {
            return Swing { mass: 0.0, inertia: f64::INFINITY, distance: 0.0 };
        };
        // Displacement of the centre of mass per turn.
        let arm = skew(&difference(&part.center, point));
        let moved = plus(&self.along, -1.0, &arm);
        let square = self.mean(&product(&transposed(&moved), &moved)).max(0.0);
        let inertia = self.mean(inertia) + part.mass * square;
        let is_balanced = part.mass * square <= BALANCED * BALANCED * inertia;
        let distance = if is_balanced { 0.0 } else { square.sqrt() };
        Swing { mass: part.mass, inertia, distance }
    }
}

/// How a part swings about the bushings that hold it.
struct Swing {
    mass: f64,
    /// kg m² about the axis of its turns; m from there to its centre of mass.
    inertia: f64,
    distance: f64,
}

impl Swing {
    /// The load that its turning makes, against that of the other part where they turn against each other: N at one rad/s.
    fn load(&self, other: &Self) -> f64 {
        if self.distance == 0.0 {
            return 0.0;
        }
        let share = if other.inertia.is_finite() {
            other.inertia / (self.inertia + other.inertia)
        } else {
            1.0
        };
        self.mass * self.distance * share * share
    }
}

impl Bushing {
    fn of(model: &Model, force: usize) -> Option<Self> {
        let ForceKind::Bushing { frames, stiffness, damping, branches } = &model.forces[force].kind
        else {
            return None;
        };
        let axes = transposed(&from_fn(|k| model.design_axis(&frames[0], k)));
        let mut laws = [stiffness, damping].map(|m| Law::of(m, &axes));
        for branch in branches {
            laws[0] = laws[0].plus(1.0, &Law::of(&branch.stiffness, &axes));
            laws[1] = laws[1].plus(1.0, &Law::of(&branch.damping, &axes));
        }
        let point = model.design_place(frames[0].body, frames[0].point);
        Some(Self { force, ends: frames.map(|frame| frame.body), point, laws })
    }
}

impl Law {
    /// The symmetric part of a matrix along `axes`, the columns.
    fn of(m: &[[f64; 6]; 6], axes: &Matrix3) -> Self {
        let block = |row: usize, column: usize| {
            let block =
                from_fn(|i| from_fn(|j| 0.5 * (m[row + i][column + j] + m[column + j][row + i])));
            product(&product(axes, &block), &transposed(axes))
        };
        Self { along: block(0, 0), mixed: block(0, 3), around: block(3, 3) }
    }

    /// This law at a point, for displacements where that is seen at `arm`.
    fn about(&self, arm: &[f64; 3]) -> Self {
        // d = t + n × arm.
        let moved = skew(arm).map(|row| row.map(|x| -x));
        let mixed = plus(&self.mixed, 1.0, &product(&self.along, &moved));
        let coupled = product(&transposed(&moved), &self.mixed);
        let levers = product(&transposed(&moved), &product(&self.along, &moved));
        let around = plus(&plus(&self.around, 1.0, &levers), 1.0, &coupled);
        Self { along: self.along, mixed, around: plus(&around, 1.0, &transposed(&coupled)) }
    }

    fn plus(&self, factor: f64, other: &Self) -> Self {
        Self {
            along: plus(&self.along, factor, &other.along),
            mixed: plus(&self.mixed, factor, &other.mixed),
            around: plus(&self.around, factor, &other.around),
        }
    }

    /// A square over all blocks, rotations as displacements at a distance of the given square.
    fn square_by(&self, square: f64, of: impl Fn(&Matrix3) -> f64) -> f64 {
        of(&self.along) + (2.0 * of(&self.mixed) + of(&self.around) / square) / square
    }
}

impl Part {
    /// All parts, by the places in `part`.
    fn all(
        model: &Model,
        part: impl Fn(BodyIndex) -> usize,
        depth: impl Fn(BodyIndex) -> usize,
    ) -> Vec<Self> {
        let none = || Self {
            rank: (usize::MAX, None),
            mass: 0.0,
            center: [0.0; 3],
            inertia: Some([[0.0; 3]; 3]),
        };
        let mut parts: Vec<Self> =
            std::iter::repeat_with(none).take(model.bodies.len() + 1).collect();
        let ground = part(None);
        parts[ground] = Self { rank: (0, None), inertia: None, ..none() };
        let held = |body: &usize| part(Some(*body)) != ground;
        let bodies: Vec<usize> = (0..model.bodies.len()).filter(held).collect();
        let center = |b: usize| model.design_place(Some(b), model.bodies[b].center_of_mass);
        for &b in &bodies {
            let part = &mut parts[part(Some(b))];
            part.rank = part.rank.min((depth(Some(b)), Some(b)));
            part.mass += model.bodies[b].mass;
        }
        for &b in &bodies {
            let part = &mut parts[part(Some(b))];
            let share = if part.mass > 0.0 { model.bodies[b].mass / part.mass } else { 0.0 };
            part.center = sum(&part.center, &scaled(&center(b), share));
        }
        for &b in &bodies {
            let part = &mut parts[part(Some(b))];
            let mass = model.bodies[b].mass;
            let axes = transposed(&UNITS.map(|unit| model.design_turned(Some(b), unit)));
            let own = product(&product(&axes, &model.bodies[b].inertia), &transposed(&axes));
            let arm = skew(&difference(&center(b), &part.center));
            let swung = product(&transposed(&arm), &arm);
            part.inertia = part.inertia.map(|sum| plus(&plus(&sum, 1.0, &own), mass, &swung));
        }
        parts
    }
}

/// Of the ground and of each body, the part that it belongs to.
fn parts_of(model: &Model) -> Vec<usize> {
    let mut above: Vec<usize> = (0..=model.bodies.len()).collect();
    for joint in &model.joints {
        if matches!(joint.kind, JointKind::Fixed | JointKind::Translational) {
            let [a, b] = joint.frames.map(|f| top(&mut above, f.body.map_or(0, |b| b + 1)));
            above[a.max(b)] = a.min(b);
        }
    }
    (0..above.len()).map(|k| top(&mut above, k)).collect()
}

/// The first that `k` belongs with.
fn top(above: &mut [usize], mut k: usize) -> usize {
    while above[k] != k {
        above[k] = above[above[k]];
        k = above[k];
    }
    k
}

const UNITS: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

fn plus(a: &Matrix3, factor: f64, b: &Matrix3) -> Matrix3 {
    from_fn(|i| from_fn(|j| a[i][j] + factor * b[i][j]))
}

fn trace(m: &Matrix3) -> f64 {
    m[0][0] + m[1][1] + m[2][2]
}

fn squared(m: &Matrix3) -> f64 {
    m.iter().map(|row| dot(row, row)).sum()
}
