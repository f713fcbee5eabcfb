//! How bodies stand and move, for the rows of closures.

use super::algebra::Algebra;
use super::closures::Closure;
use super::engine::{Engine, pose};
use crate::math::vector::{difference, same_bits};
use crate::system::{Motion, Stance};

/// What varies how bodies move.
#[derive(Debug, Clone, Copy)]
pub(super) enum Variation {
    /// The motion itself: displacements are velocities, changes accelerations.
    OfTime,
    /// A change of the independent variables and their rates; see [`Engine::displace`].
    OfVariables,
}

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// How all bodies stand at q.
    pub(super) fn stand(&mut self, q: &[f64]) {
        if same_bits(&self.stood, q) {
            return;
        }
        self.stood.copy_from_slice(q);
        for (b, stance) in self.stances.iter_mut().enumerate() {
            *stance = A::stance(pose(q, b));
        }
    }

    /// How the bodies at the ends of a closure stand.
    pub(super) fn stances_of(&self, closure: &Closure) -> [&Stance; 2] {
        let stance = |end: Option<usize>| match end {
            Some(b) => &self.stances[b],
            None => const { &Stance::GROUND },
        };
        [stance(closure.ends[0]), stance(closure.ends[1])]
    }

    /// How the bodies at the ends of closures move, with a variation of that.
    pub(super) fn evaluate_motions(&mut self, variation: Variation) {
        let (displacements, changes) = match variation {
            Variation::OfTime => (&self.twist, &self.twist_rate),
            Variation::OfVariables => (&self.motion, &self.twist_change),
        };
        for &b in &self.ends {
            let arm = difference(&self.stances[b].place, &self.origin[b]);
            self.motions[b] = A::motion(&arm, &self.twist[b], [&displacements[b], &changes[b]]);
        }
    }

    /// How those at the ends of one do.
    pub(super) fn motions_of(&self, closure: &Closure) -> [&Motion; 2] {
        let motion = |end: Option<usize>| match end {
            Some(b) => &self.motions[b],
            None => const { &Motion::REST },
        };
        [motion(closure.ends[0]), motion(closure.ends[1])]
    }
}
