//! How the motion of an edge against its inner body changes with the edge's own coordinates.

use super::algebra::Algebra;
use super::engine::{Edge, Engine, add, dot};

/// Changes with one coordinate of an edge, in what its columns are constant in but for their own turning; ground axes, about
/// the reference point (`docs/theory/joint.md` (14), (15), (18)).
#[derive(Debug, Clone, Copy)]
pub(super) struct OwnMotion<const W: usize> {
    /// Of B ẋ, with the coordinate.
    pub(super) rate: [f64; W],
    /// Of the acceleration, with the coordinate and with its rate.
    pub(super) acceleration: [[f64; W]; 2],
    /// Of the forces along the coordinates of the edge, with the coordinate.
    pub(super) force: [f64; 6],
    /// Of the force along the coordinate, with a displacement of what carries it.
    pub(super) tilt: [f64; W],
}

impl<const W: usize> OwnMotion<W> {
    pub(super) const NONE: Self =
        Self { rate: [0.0; W], acceleration: [[0.0; W]; 2], force: [0.0; 6], tilt: [0.0; W] };
}

impl Edge {
    /// Whether its columns change with its own coordinates.
    pub(super) fn bends(&self) -> bool {
        self.nested || self.rotation.is_some()
    }
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// All of them by coordinates, and by bodies the accelerations of their edges as the carriers see them; the wrenches are
    /// those of all that hangs on the bodies.
    pub(super) fn evaluate_own_motions(
        &self,
        motions: &mut [OwnMotion<W>],
        accelerations: &mut [[f64; W]],
    ) {
        for (at, edge) in self.edges.iter().enumerate() {
            let (own, wrench) = (&mut motions[edge.range.clone()], &self.wrench[edge.body]);
            if edge.first.is_some() {
                for (motion, column) in own.iter_mut().zip(&self.columns[edge.range.clone()]) {
                    motion.tilt = A::cross_dual(column, wrench);
                }
            }
            accelerations[edge.body] = if edge.bends() {
                self.bend(at, own)
            } else {
                let mut sum = [0.0; W];
                edge.range.clone().for_each(|k| {
                    add(&mut sum, self.accelerations[k], &self.columns[k]);
                });
                sum
            };
        }
    }

    /// Those of an edge whose columns turn with its coordinates; returns its acceleration.
    fn bend(&self, at: usize, motions: &mut [OwnMotion<W>]) -> [f64; W] {
        let edge = &self.edges[at];
        let (n, first, b) = (edge.range.len(), edge.range.start, edge.body);
        let (center, origin) = (&self.center[b], &self.origin[b]);
        let screws = &self.screws[edge.range.clone()];
        let wrench = A::moved(&self.wrench[b], origin, center);
        let sign = if edge.outward { 1.0 } else { -1.0 };
        // How columns of lower stages turn the others.
        let mut turns = [[[0.0; W]; 6]; 6];
        for (k, screw) in screws.iter().enumerate() {
            for (j, inner) in screws.iter().enumerate().take(k) {
                if edge.stage[j] < edge.stage[k] {
                    turns[j][k] = A::cross(inner, screw).map(|x| sign * x);
                }
            }
        }
        let turned = |rates: &[f64; 6], k: usize| {
            let mut out = [0.0; W];
            for j in 0..k {
                add(&mut out, rates[j], &turns[j][k]);
            }
            out
        };
        let rotation = edge.rotation.and_then(|start| Some((start, self.turning[at].as_ref()?)));
        let three = |x: &[f64], start: usize| {
            [x[first + start], x[first + start + 1], x[first + start + 2]]
        };
        let rates = self.screw_rates(at, &self.rates);
        let mut second = self.screw_rates(at, &self.accelerations);
        if let Some((start, turn)) = rotation {
            let rate = three(&self.rates, start);
            add_three(&mut second, start, turn.first(&rate, &rate));
        }
        // Screw rates of a unit rate of each coordinate.
        let units: [[f64; 6]; 6] = std::array::from_fn(|m| {
            let mut out = unit(m);
            if let Some((start, turn)) = rotation
                && (start..start + 3).contains(&m)
            {
                out = [0.0; 6];
                add_three(&mut out, start, turn.times(&unit(m - start)));
            }
            out
        });
        let all_turned = |rates: &[f64; 6]| {
            let mut out = [[0.0; W]; 6];
            if edge.nested {
                (1..n).for_each(|k| out[k] = turned(rates, k));
            }
            out
        };
        let turning = all_turned(&rates);
        let mut acceleration = [0.0; W];
        for (k, screw) in screws.iter().enumerate() {
            add(&mut acceleration, rates[k], &turning[k]);
            add(&mut acceleration, second[k], screw);
        }
        for (m, motion) in motions.iter_mut().enumerate() {
            let [mut by_x, mut second_by_x, mut second_by_rate] = [[0.0; 6]; 3];
            let own = rotation.filter(|(start, _)| (*start..start + 3).contains(&m));
            if let Some((start, turn)) = own {
                let (axis, rate) = (unit(m - start), three(&self.rates, start));
                let with_x = turn.first(&axis, &rate);
                add_three(&mut by_x, start, with_x);
                add_three(&mut second_by_x, start, turn.second(&axis, &rate, &rate));
                let accelerated = turn.first(&axis, &three(&self.accelerations, start));
                add_three(&mut second_by_x, start, accelerated);
                add_three(&mut second_by_rate, start, with_x);
                add_three(&mut second_by_rate, start, turn.first(&rate, &axis));
            }
            let (moved, also_turned) = (all_turned(&units[m]), all_turned(&by_x));
            let [mut rate, mut with_x, mut with_rate] = [[0.0; W]; 3];
            for (k, screw) in screws.iter().enumerate() {
                add(&mut rate, by_x[k], screw);
                add(&mut with_x, second_by_x[k], screw);
                add(&mut with_rate, second_by_rate[k], screw);
                if !edge.nested {
                    continue;
                }
                add(&mut rate, rates[k], &moved[k]);
                add(&mut with_x, by_x[k], &turning[k]);
                add(&mut with_x, rates[k], &also_turned[k]);
                add(&mut with_x, second[k], &moved[k]);
                let (mut lower, mut lower_moved) = ([0.0; W], [0.0; W]);
                for j in (0..k).filter(|&j| edge.stage[j] < edge.stage[k]) {
                    add(&mut lower, sign * rates[j], &screws[j]);
                    add(&mut lower_moved, sign * rates[j], &moved[j]);
                }
                add(&mut with_x, rates[k], &A::cross(&lower_moved, screw));
                add(&mut with_x, rates[k], &A::cross(&lower, &moved[k]));
                add(&mut with_rate, units[m][k], &turning[k]);
                add(&mut with_rate, rates[k], &moved[k]);
            }
            let powers: [f64; 6] = std::array::from_fn(|k| dot(&moved[k], &wrench));
            let own_powers: [f64; 6] =
                std::array::from_fn(|k| screws.get(k).map_or(0.0, |screw| dot(screw, &wrench)));
            for c in 0..n {
                motion.force[c] = dot(&units[c], &powers);
                let other = own.filter(|(start, _)| (*start..start + 3).contains(&c));
                if let Some((start, turn)) = other {
                    let bend = turn.first(&unit(m - start), &unit(c - start));
                    for (x, power) in bend.iter().zip(&own_powers[start..]) {
                        motion.force[c] += x * power;
                    }
                }
            }
            let about = |y: &[f64; W]| A::moved_twist(y, center, origin);
            motion.rate = about(&rate);
            motion.acceleration = [about(&with_x), about(&with_rate)];
        }
        A::moved_twist(&acceleration, center, origin)
    }
}

/// The unit vector k.
fn unit<const M: usize>(k: usize) -> [f64; M] {
    std::array::from_fn(|i| if i == k { 1.0 } else { 0.0 })
}

fn add_three(out: &mut [f64; 6], start: usize, x: [f64; 3]) {
    out[start..start + 3].iter_mut().zip(x).for_each(|(out, x)| *out += x);
}
