//! Error weights on what tied bodies do against each other.

use crate::math::spatial::{conjugate, cross, e_times, product, rotate_back};
use crate::math::vector::{difference, dot, sum};
use crate::model::Tolerance;
use crate::system::{State, Structure};

/// Tolerances that two bodies may be off against each other, since each of them may be by one.
const OF_TWO: f64 = 2.0;

/// Where a body is and how it moves, ground axes.
#[derive(Debug, Clone, Copy, Default)]
struct Motion {
    place: [f64; 3],
    velocity: [f64; 3],
    angular_velocity: [f64; 3],
    /// Euler parameters and their rates; in the plane an angle.
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

/// Two bodies that a joint or force ties. The motion of the second is seen from axes that move with the first.
#[derive(Debug, Clone, Default)]
struct Tie {
    bodies: [usize; 2],
    /// Place and orientation of the second body in axes of the first when the run started.
    start: ([f64; 3], [f64; 4]),
    /// Of place, orientation, velocity and angular velocity.
    scales: [f64; 4],
}

/// The norm of `docs/theory/method.md` (9a) to (9c): motions of tied bodies
/// against each other, so that what travels or turns as a whole is as exact within as what stands.
#[derive(Debug, Clone, Default)]
pub(super) struct Ties {
    planar: bool,
    pairs: Vec<Tie>,
    motions: Vec<Motion>,
    changes: Vec<Change>,
}

impl Ties {
    /// The ties of a run that starts at `start`.
    pub(super) fn new(structure: &Structure, start: &State) -> Self {
        let n = structure.sizes.per_body;
        let coupled = structure.stiffness_pattern.shapes().map(|(i, j, ..)| [i / n, j / n]);
        let joined = structure.joints.iter().filter_map(|joint| match joint.bodies {
            [Some(first), Some(second)] => Some([first, second]),
            _ => None,
        });
        let pairs = coupled.chain(joined).filter(|[first, second]| first != second);
        let mut pairs: Vec<_> = pairs.map(|[a, b]| [a.min(b), a.max(b)]).collect();
        pairs.sort_unstable();
        pairs.dedup();
        let mut out = Self {
            planar: structure.sizes.translations == 2,
            pairs: pairs.into_iter().map(|bodies| Tie { bodies, ..Tie::default() }).collect(),
            motions: vec![Motion::default(); structure.sizes.bodies],
            changes: vec![Change::default(); structure.sizes.bodies],
        };
        out.move_to([&start.q, &start.v]);
        for tie in &mut out.pairs {
            tie.start = seen(out.planar, tie.bodies.map(|body| &out.motions[body]));
        }
        out
    }

    fn move_to(&mut self, [q, v]: [&[f64]; 2]) {
        let n = if self.planar { 3 } else { 7 };
        let coordinates = q.chunks_exact(n).zip(v.chunks_exact(n));
        for (motion, (q, v)) in self.motions.iter_mut().zip(coordinates) {
            *motion = if self.planar {
                Motion {
                    place: [q[0], q[1], 0.0],
                    velocity: [v[0], v[1], 0.0],
                    angular_velocity: [0.0, 0.0, v[2]],
                    p: [q[2], 0.0, 0.0, 0.0],
                    p_rate: [0.0; 4],
                }
            } else {
                let [p, p_rate] = [parameters(q), parameters(v)];
                Motion {
                    place: [q[0], q[1], q[2]],
                    velocity: [v[0], v[1], v[2]],
                    angular_velocity: e_times(&p, &p_rate).map(|x| 2.0 * x),
                    p,
                    p_rate,
                }
            };
        }
    }

    /// Takes the scales of the state that a step starts from.
    pub(super) fn set(&mut self, state: &State, tolerance: &Tolerance) {
        if self.pairs.is_empty() {
            return;
        }
        self.move_to([&state.q, &state.v]);
        let Tolerance { relative, translation, rotation } = *tolerance;
        for tie in &mut self.pairs {
            let [first, second] = tie.bodies.map(|body| &self.motions[body]);
            let (place, orientation) = seen(self.planar, [first, second]);
            let moved = size(&difference(&place, &tie.start.0));
            let turned = 2.0 * dot(&orientation, &tie.start.1).abs().min(1.0).acos();
            let (_, velocity, angular_velocity) = against([first, second]);
            tie.scales = [
                translation + relative * moved,
                rotation + relative * turned,
                translation + relative * size(&velocity),
                rotation + relative * size(&angular_velocity),
            ]
            .map(|scale| OF_TWO * scale);
        }
    }

    /// Weighted norm of a change of coordinates and velocities at `at` (q, q̇): the largest over the ties; 0 without
    /// ties.
    pub(super) fn norm(&mut self, at: [&[f64]; 2], change: [&[f64]; 2]) -> f64 {
        if self.pairs.is_empty() {
            return 0.0;
        }
        self.move_to(at);
        self.spread(change);
        let mut largest = 0.0f64;
        for tie in &self.pairs {
            let motions = tie.bodies.map(|body| &self.motions[body]);
            let (link, velocity, angular_velocity) = against(motions);
            let [first, second] = tie.bodies.map(|body| &self.changes[body]);
            // What is seen from axes that turn with the first body changes by their turn as well.
            let seen =
                |change: &[f64; 3], of: &[f64; 3]| difference(change, &cross(&first.turn, of));
            let moved = difference(&second.place, &first.place);
            let carried = sum(
                &cross(&first.angular_velocity, &link),
                &cross(&motions[0].angular_velocity, &moved),
            );
            let faster = difference(&second.velocity, &first.velocity);
            let parts = [
                seen(&moved, &link),
                difference(&second.turn, &first.turn),
                seen(&difference(&faster, &carried), &velocity),
                seen(
                    &difference(&second.angular_velocity, &first.angular_velocity),
                    &angular_velocity,
                ),
            ];
            let squares =
                parts.iter().zip(&tie.scales).map(|(x, scale)| dot(x, x) / (scale * scale));
            let norm = 0.5 * squares.sum::<f64>().sqrt();
            if norm.is_nan() || norm > largest {
                largest = norm;
            }
        }
        largest
    }

    fn spread(&mut self, [dq, dv]: [&[f64]; 2]) {
        let n = if self.planar { 3 } else { 7 };
        let changes = dq.chunks_exact(n).zip(dv.chunks_exact(n));
        let bodies = self.changes.iter_mut().zip(&self.motions);
        for ((out, motion), (dq, dv)) in bodies.zip(changes) {
            *out = if self.planar {
                Change {
                    place: [dq[0], dq[1], 0.0],
                    turn: [0.0, 0.0, dq[2]],
                    velocity: [dv[0], dv[1], 0.0],
                    angular_velocity: [0.0, 0.0, dv[2]],
                }
            } else {
                let [dp, dp_rate] = [parameters(dq), parameters(dv)];
                let rate = sum(&e_times(&motion.p, &dp_rate), &e_times(&dp, &motion.p_rate));
                Change {
                    place: [dq[0], dq[1], dq[2]],
                    turn: e_times(&motion.p, &dp).map(|x| 2.0 * x),
                    velocity: [dv[0], dv[1], dv[2]],
                    angular_velocity: rate.map(|x| 2.0 * x),
                }
            };
        }
    }
}

/// Place, velocity and angular velocity of the second body against the first, components in ground axes.
fn against([first, second]: [&Motion; 2]) -> ([f64; 3], [f64; 3], [f64; 3]) {
    let link = difference(&second.place, &first.place);
    let carried = cross(&first.angular_velocity, &link);
    let velocity = difference(&difference(&second.velocity, &first.velocity), &carried);
    (link, velocity, difference(&second.angular_velocity, &first.angular_velocity))
}

/// Euler parameters among the coordinates of a body in space.
fn parameters(x: &[f64]) -> [f64; 4] {
    [x[3], x[4], x[5], x[6]]
}

/// Place and orientation of the second body in axes of the first.
fn seen(planar: bool, motions: [&Motion; 2]) -> ([f64; 3], [f64; 4]) {
    let link = difference(&motions[1].place, &motions[0].place);
    let [first, second] = motions.map(|motion| {
        if planar {
            let (sin, cos) = (0.5 * motion.p[0]).sin_cos();
            [cos, 0.0, 0.0, sin]
        } else {
            motion.p
        }
    });
    (rotate_back(&first, &link), product(&conjugate(&first), &second))
}

fn size(x: &[f64; 3]) -> f64 {
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
        let mut out = Ties {
            planar: false,
            pairs: vec![Tie { bodies: [0, 1], ..Tie::default() }],
            motions: vec![Motion::default(); 2],
            changes: vec![Change::default(); 2],
        };
        out.move_to([&start.q, &start.v]);
        out.pairs[0].start = seen(false, [&out.motions[0], &out.motions[1]]);
        out
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
}
