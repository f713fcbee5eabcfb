//! Error weights on what tied bodies do against each other.

use crate::math::spatial::{conjugate, cross, e_times, product, rotate_back};
use crate::math::vector::{difference, dot, same_bits, sum};
use crate::model::Tolerance;
use crate::system::{State, Structure};
use std::f64::consts::TAU;

/// Tolerances that two bodies may be off against each other, since each of them may be by one.
const OF_TWO: f64 = 2.0;

/// The norm of `docs/theory/method.md` (9a) to (9c): motions of tied bodies against each other, so that what
/// travels or turns as a whole is as exact within as what stands.
#[derive(Debug, Clone, Default)]
pub(super) struct Ties {
    planar: bool,
    pairs: Vec<Tie>,
    /// Of the bodies of a model in space, and the coordinates and velocities that they are at.
    motions: Vec<Motion>,
    at: [Vec<f64>; 2],
    changes: Vec<Change>,
}

/// Two bodies that a joint or force ties. The motion of the second is seen from axes that move with the first.
#[derive(Debug, Clone, Default)]
struct Tie {
    bodies: [usize; 2],
    /// Place and orientation of the second body in axes of the first when the run started; of an orientation in
    /// the plane the first number is the angle.
    start: ([f64; 3], [f64; 4]),
    /// Inverse squares of the tolerances of place, orientation, velocity and angular velocity.
    weights: [f64; 4],
    /// How the second body is and moves against the first, in space.
    against: Against,
}

/// Place, velocity and angular velocity of the second of two bodies against the first, components in ground axes.
#[derive(Debug, Clone, Copy, Default)]
struct Against {
    link: [f64; 3],
    velocity: [f64; 3],
    angular_velocity: [f64; 3],
}

/// Where a body in space is and how it moves, ground axes.
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    place: [f64; 3],
    velocity: [f64; 3],
    angular_velocity: [f64; 3],
    /// Euler parameters and their rates.
    p: [f64; 4],
    p_rate: [f64; 4],
}

/// A change of it; turns are rotation vectors.
#[derive(Debug, Clone, Copy, Default)]
struct Change {
    place: [f64; 3],
    turn: [f64; 3],
    velocity: [f64; 3],
    angular_velocity: [f64; 3],
}

impl Ties {
    /// The ties of a run that starts at `start`.
    pub(super) fn new(structure: &Structure, start: &State) -> Self {
        let body = |coordinate: usize| structure.sizes.place_of(coordinate).0;
        let coupled = structure.stiffness_pattern.shapes().map(|(i, j, ..)| [body(i), body(j)]);
        let joined = structure.joints.iter().filter_map(|joint| match joint.bodies {
            [Some(first), Some(second)] => Some([first, second]),
            _ => None,
        });
        let pairs = coupled.chain(joined).filter(|[first, second]| first != second);
        let mut pairs: Vec<_> = pairs.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        Self::of(pairs, structure.sizes.is_planar(), structure.sizes.bodies, start)
    }

    fn of(pairs: Vec<[usize; 2]>, planar: bool, bodies: usize, start: &State) -> Self {
        let bodies = if planar || pairs.is_empty() { 0 } else { bodies };
        let mut out = Self {
            planar,
            pairs: pairs.into_iter().map(|bodies| Tie { bodies, ..Tie::default() }).collect(),
            motions: vec![Motion::default(); bodies],
            at: [vec![f64::NAN; 7 * bodies], vec![f64::NAN; 7 * bodies]],
            changes: vec![Change::default(); bodies],
        };
        out.move_to([&start.q, &start.v]);
        for tie in &mut out.pairs {
            tie.start = if planar {
                let seen = Flat::new(tie.bodies, [&start.q, &start.v]);
                ([seen.place[0], seen.place[1], 0.0], [seen.angle, 0.0, 0.0, 0.0])
            } else {
                seen(tie.bodies.map(|body| &out.motions[body]))
            };
        }
        out
    }

    /// Takes the scales of the state that a step starts from.
    pub(super) fn set(&mut self, state: &State, tolerance: &Tolerance) {
        let at = [&*state.q, &*state.v];
        self.move_to(at);
        let Tolerance { relative, translation, rotation } = *tolerance;
        for tie in &mut self.pairs {
            let (place, orientation) = tie.start;
            let [moved, turned, speed, spin] = if self.planar {
                let flat = Flat::new(tie.bodies, at);
                let angle = (flat.angle - orientation[0]).abs() % TAU;
                [
                    size(&[flat.place[0] - place[0], flat.place[1] - place[1]]),
                    angle.min(TAU - angle),
                    size(&flat.velocity),
                    flat.angular_velocity.abs(),
                ]
            } else {
                let bodies = tie.bodies.map(|body| &self.motions[body]);
                let (now, turn) = seen(bodies);
                [
                    size(&difference(&now, &place)),
                    2.0 * dot(&turn, &orientation).abs().min(1.0).acos(),
                    size(&tie.against.velocity),
                    size(&tie.against.angular_velocity),
                ]
            };
            tie.weights = [
                translation + relative * moved,
                rotation + relative * turned,
                translation + relative * speed,
                rotation + relative * spin,
            ]
            .map(|scale| (OF_TWO * scale).powi(-2));
        }
    }

    /// Weighted norm of a change of coordinates and velocities at `at` (q, q̇): the largest over the ties; 0 without
    /// ties.
    pub(super) fn norm(&mut self, at: [&[f64]; 2], change: [&[f64]; 2]) -> f64 {
        self.move_to(at);
        self.spread(change);
        let mut largest = 0.0f64;
        for tie in &self.pairs {
            let squares = if self.planar {
                flat_changes(tie.bodies, at, change)
            } else {
                let turning = &self.motions[tie.bodies[0]].angular_velocity;
                changes(turning, &tie.against, tie.bodies.map(|body| &self.changes[body]))
            };
            let square = dot(&squares, &tie.weights);
            if square.is_nan() || square > largest {
                largest = square;
            }
        }
        0.5 * largest.sqrt()
    }

    fn move_to(&mut self, [q, v]: [&[f64]; 2]) {
        // The same as a rule: the iterations of a step, and its stages, ask at one place.
        let [known_q, known_v] = &mut self.at;
        if self.motions.is_empty() || (same_bits(known_q, q) && same_bits(known_v, v)) {
            return;
        }
        known_q.copy_from_slice(q);
        known_v.copy_from_slice(v);
        for (motion, (q, v)) in
            self.motions.iter_mut().zip(q.as_chunks::<7>().0.iter().zip(v.as_chunks::<7>().0))
        {
            let [p, p_rate] = [parameters(q), parameters(v)];
            *motion = Motion {
                place: [q[0], q[1], q[2]],
                velocity: [v[0], v[1], v[2]],
                angular_velocity: e_times(&p, &p_rate).map(|x| 2.0 * x),
                p,
                p_rate,
            };
        }
        for tie in &mut self.pairs {
            tie.against = against(tie.bodies.map(|body| &self.motions[body]));
        }
    }

    fn spread(&mut self, [dq, dv]: [&[f64]; 2]) {
        let bodies = self.changes.iter_mut().zip(&self.motions);
        for ((out, motion), (dq, dv)) in
            bodies.zip(dq.as_chunks::<7>().0.iter().zip(dv.as_chunks::<7>().0))
        {
            let [dp, dp_rate] = [parameters(dq), parameters(dv)];
            let rate = sum(&e_times(&motion.p, &dp_rate), &e_times(&dp, &motion.p_rate));
            *out = Change {
                place: [dq[0], dq[1], dq[2]],
                turn: e_times(&motion.p, &dp).map(|x| 2.0 * x),
                velocity: [dv[0], dv[1], dv[2]],
                angular_velocity: rate.map(|x| 2.0 * x),
            };
        }
    }
}

/// Euler parameters among the coordinates of a body in space.
fn parameters(x: &[f64; 7]) -> [f64; 4] {
    [x[3], x[4], x[5], x[6]]
}

/// Place and orientation of the second body in axes of the first.
fn seen([first, second]: [&Motion; 2]) -> ([f64; 3], [f64; 4]) {
    let link = difference(&second.place, &first.place);
    (rotate_back(&first.p, &link), product(&conjugate(&first.p), &second.p))
}

/// The second body against the first.
fn against([first, second]: [&Motion; 2]) -> Against {
    let link = difference(&second.place, &first.place);
    let carried = cross(&first.angular_velocity, &link);
    Against {
        link,
        velocity: difference(&difference(&second.velocity, &first.velocity), &carried),
        angular_velocity: difference(&second.angular_velocity, &first.angular_velocity),
    }
}

/// Squares of the changes of place, orientation, velocity and angular velocity that the first body sees, which turns with this
/// angular velocity.
fn changes(
    turning: &[f64; 3],
    Against { link, velocity, angular_velocity }: &Against,
    [first, second]: [&Change; 2],
) -> [f64; 4] {
    // What is seen from axes that turn with the first body changes by their turn as well.
    let seen = |change: &[f64; 3], of: &[f64; 3]| difference(change, &cross(&first.turn, of));
    let moved = difference(&second.place, &first.place);
    let carried = sum(&cross(&first.angular_velocity, link), &cross(turning, &moved));
    let faster = difference(&difference(&second.velocity, &first.velocity), &carried);
    let spun = difference(&second.angular_velocity, &first.angular_velocity);
    [
        seen(&moved, link),
        difference(&second.turn, &first.turn),
        seen(&faster, velocity),
        seen(&spun, angular_velocity),
    ]
    .map(|x| dot(&x, &x))
}

/// The second of two bodies in the plane in axes of the first; the velocity in ground axes.
struct Flat {
    place: [f64; 2],
    angle: f64,
    velocity: [f64; 2],
    angular_velocity: f64,
}

impl Flat {
    fn new(bodies: [usize; 2], [q, v]: [&[f64]; 2]) -> Self {
        let ([x, y, angle], turned) = apart(bodies, q);
        let ([u, w, angular_velocity], spin) = apart(bodies, v);
        let (sin, cos) = turned.sin_cos();
        Self {
            place: [cos * x + sin * y, cos * y - sin * x],
            angle,
            velocity: [u + spin * y, w - spin * x],
            angular_velocity,
        }
    }
}

/// Coordinates, or their rates or changes, of two bodies in the plane: the difference, and the angle of the first.
#[inline(always)]
fn apart([first, second]: [usize; 2], x: &[f64]) -> ([f64; 3], f64) {
    let (bodies, _) = x.as_chunks::<3>();
    let (a, b) = (&bodies[first], &bodies[second]);
    ([b[0] - a[0], b[1] - a[1], b[2] - a[2]], a[2])
}

/// As [`changes`], in the plane.
#[inline(always)]
fn flat_changes(bodies: [usize; 2], [q, v]: [&[f64]; 2], [dq, dv]: [&[f64]; 2]) -> [f64; 4] {
    let (link, _) = apart(bodies, q);
    let (speed, spin) = apart(bodies, v);
    let (moved, turn) = apart(bodies, dq);
    let (faster, spun) = apart(bodies, dv);
    let velocity = [speed[0] + spin * link[1], speed[1] - spin * link[0]];
    let place = [moved[0] + turn * link[1], moved[1] - turn * link[0]];
    let rate = [
        faster[0] + spun * link[1] + spin * moved[1] + turn * velocity[1],
        faster[1] - spun * link[0] - spin * moved[0] - turn * velocity[0],
    ];
    [dot(&place, &place), moved[2] * moved[2], dot(&rate, &rate), faster[2] * faster[2]]
}

fn size<const D: usize>(x: &[f64; D]) -> f64 {
    dot(x, x).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::spatial::e_transposed_times;
    use crate::math::turn::exponential;

    const TOLERANCE: Tolerance = Tolerance { relative: 0.1, translation: 1e-3, rotation: 2e-3 };

    /// Places, orientations, velocities and angular velocities (ground axes) of two bodies as coordinates.
    fn state(bodies: [([f64; 3], [f64; 4], [f64; 3], [f64; 3]); 2]) -> State {
        let (mut q, mut v) = (Vec::new(), Vec::new());
        for (place, p, velocity, angular_velocity) in bodies {
            q.extend(place.iter().chain(&p));
            v.extend(velocity);
            v.extend(e_transposed_times(&p, &angular_velocity.map(|x| 0.5 * x)));
        }
        State { q, v, ..State::default() }
    }

    fn ties(start: &State) -> Ties {
        Ties::of(vec![[0, 1]], false, 2, start)
    }

    fn two(turn: f64) -> State {
        state([
            (
                [0.3, -0.2, 0.5],
                exponential(&[0.4 + turn, 0.2, -0.7]),
                [3.0, 1.0, -2.0],
                [9.0, 4.0, -7.0],
            ),
            (
                [1.1, 0.6, -0.4],
                exponential(&[-0.3, 0.9 + turn, 0.1]),
                [2.0, -1.0, 1.0],
                [8.0, -3.0, 2.0],
            ),
        ])
    }

    /// What an observer on the first body sees of the second: place, Euler parameters, velocity and angular
    /// velocity in its axes.
    fn observed(state: &State) -> ([f64; 3], [f64; 4], [f64; 3], [f64; 3]) {
        let mut ties = ties(state);
        ties.move_to([&state.q, &state.v]);
        let [first, second] = [&ties.motions[0], &ties.motions[1]];
        let back = |x: &[f64; 3]| rotate_back(&first.p, x);
        let link = difference(&second.place, &first.place);
        let spin = difference(&second.angular_velocity, &first.angular_velocity);
        // The rate of what the observer measures, by differences along the motion.
        let h = 1e-6;
        let place_at = |t: f64| {
            let moved = |m: &Motion| -> [f64; 3] {
                std::array::from_fn(|k| m.place[k] + t * m.velocity[k])
            };
            let turn = exponential(&first.angular_velocity.map(|x| x * t));
            let p = product(&turn, &first.p);
            rotate_back(&p, &difference(&moved(second), &moved(first)))
        };
        let velocity = difference(&place_at(h), &place_at(-h)).map(|x| x / (2.0 * h));
        (back(&link), product(&conjugate(&first.p), &second.p), velocity, back(&spin))
    }

    #[test] // independent truth: differences of what an observer on the first body measures
    fn changes_are_those_that_an_observer_on_the_first_body_sees() {
        let (start, here) = (two(0.0), two(0.6));
        let mut ties = ties(&start);
        ties.set(&here, &TOLERANCE);
        let changed = |e: f64| {
            let mut out = here.clone();
            for k in 0..14 {
                let wave = |phase: f64| (1.3 * k as f64 + phase).sin();
                out.q[k] += e * wave(0.2);
                out.v[k] += e * wave(1.1);
            }
            out
        };
        // Tangent to unit Euler parameters, at position and velocity level.
        let project = |mut state: State| {
            for b in [3, 10] {
                let size = state.q[b..b + 4].iter().map(|x| x * x).sum::<f64>().sqrt();
                state.q[b..b + 4].iter_mut().for_each(|x| *x /= size);
                let along: f64 = (0..4).map(|k| state.q[b + k] * state.v[b + k]).sum();
                (0..4).for_each(|k| state.v[b + k] -= along * state.q[b + k]);
            }
            state
        };
        let e = 1e-6;
        let [plus, minus] = [e, -e].map(|e| project(changed(e)));
        let slope = |a: &[f64], b: &[f64]| -> Vec<f64> {
            a.iter().zip(b).map(|(a, b)| (a - b) / (2.0 * e)).collect()
        };
        let (dq, dv) = (slope(&plus.q, &minus.q), slope(&plus.v, &minus.v));
        let found = ties.norm([&here.q, &here.v], [&dq, &dv]);

        let [a, b] = [observed(&plus), observed(&minus)];
        let (then, now) = (observed(&start), observed(&here));
        let length = |x: Vec<f64>| x.iter().map(|x| x * x).sum::<f64>().sqrt();
        let apart = |a: &[f64; 3], b: &[f64; 3]| size(&difference(a, b));
        let turned = 2.0 * dot(&then.1, &now.1).abs().acos();
        let parts = [
            length(slope(&a.0, &b.0)) / (1e-3 + 0.1 * apart(&now.0, &then.0)),
            2.0 * length(slope(&a.1, &b.1)) / (2e-3 + 0.1 * turned),
            length(slope(&a.2, &b.2)) / (1e-3 + 0.1 * size(&now.2)),
            length(slope(&a.3, &b.3)) / (2e-3 + 0.1 * size(&now.3)),
        ];
        let truth = 0.5 * length(parts.to_vec()) / OF_TWO;
        assert!((found / truth - 1.0).abs() < 1e-6, "{found} {truth}");
    }

    #[test] // independent truth: bodies that are one rigid body move against each other by nothing
    fn what_moves_as_one_has_no_norm() {
        let here = two(0.0);
        let mut ties = ties(&here);
        ties.set(&here, &TOLERANCE);
        // Places r turn about the ground's origin by δφ and shift by δr; both velocities are those of one body.
        let (turn, shift) = ([0.2, -0.5, 0.3], [0.7, 0.1, -0.4]);
        let (mut dq, mut dv) = (Vec::new(), Vec::new());
        for motion in &ties.motions {
            let place = sum(&cross(&turn, &motion.place), &shift);
            dq.extend(place);
            dq.extend(e_transposed_times(&motion.p, &turn.map(|x| 0.5 * x)));
            dv.extend(cross(&turn, &motion.velocity));
            dv.extend(e_transposed_times(&motion.p_rate, &turn.map(|x| 0.5 * x)));
        }
        let norm = ties.norm([&here.q, &here.v], [&dq, &dv]);
        assert!(norm < 1e-11, "{norm}");
    }

    #[test] // independent truth: the same bodies in space
    fn the_plane_is_a_part_of_space() {
        let turned = |angle: f64| exponential(&[0.0, 0.0, angle]);
        let bodies = [([0.3, -0.2], 0.4, [3.0, 1.0], 9.0), ([1.1, 0.6], 2.9, [2.0, -1.0], -4.0)];
        let (mut flat, mut deep) = (State::default(), Vec::new());
        for ([x, y], angle, [u, w], spin) in bodies {
            flat.q.extend([x, y, angle]);
            flat.v.extend([u, w, spin]);
            deep.push(([x, y, 0.0], turned(angle), [u, w, 0.0], [0.0, 0.0, spin]));
        }
        let deep = state([deep[0], deep[1]]);
        let later = |flat: &State, deep: &State| {
            let (mut flat, mut deep) = (flat.clone(), deep.clone());
            for (b, turn) in [0.5, -4.0].into_iter().enumerate() {
                flat.q[3 * b] += 0.7;
                deep.q[7 * b] += 0.7;
                flat.q[3 * b + 2] += turn;
                let p = product(&turned(turn), &parameters(&deep.q.as_chunks().0[b]));
                deep.q[7 * b + 3..][..4].copy_from_slice(&p);
                let rate = e_transposed_times(&p, &[0.0, 0.0, 0.5 * flat.v[3 * b + 2]]);
                deep.v[7 * b + 3..][..4].copy_from_slice(&rate);
            }
            (flat, deep)
        };
        let mut both = [Ties::of(vec![[0, 1]], true, 2, &flat), ties(&deep)];
        let (flat, deep) = later(&flat, &deep);
        both[0].set(&flat, &TOLERANCE);
        both[1].set(&deep, &TOLERANCE);
        let (dq, dv) = ([0.1, -0.3, 0.2, 0.4, 0.5, -0.7], [2.0, 1.0, -1.5, 0.3, -2.0, 0.8]);
        let (mut deep_dq, mut deep_dv) = (Vec::new(), Vec::new());
        for b in [0, 1] {
            let [p, rate] = [&deep.q, &deep.v].map(|x| parameters(&x.as_chunks().0[b]));
            let half = |x: f64| [0.0, 0.0, 0.5 * x];
            let dp = e_transposed_times(&p, &half(dq[3 * b + 2]));
            // δṗ = ½ Eᵀ(p) δω + ½ Eᵀ(δp) ω with ω = 2 E(p) ṗ
            let own = e_transposed_times(&p, &half(dv[3 * b + 2]));
            let carried = e_transposed_times(&dp, &e_times(&p, &rate));
            deep_dq.extend([dq[3 * b], dq[3 * b + 1], 0.0].iter().chain(&dp));
            deep_dv.extend([dv[3 * b], dv[3 * b + 1], 0.0]);
            deep_dv.extend((0..4).map(|k| own[k] + carried[k]));
        }
        let here = both[0].norm([&flat.q, &flat.v], [&dq, &dv]);
        let there = both[1].norm([&deep.q, &deep.v], [&deep_dq, &deep_dv]);
        assert!((here / there - 1.0).abs() < 1e-7, "{here} {there}");
    }
}
