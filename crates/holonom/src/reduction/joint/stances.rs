//! How bodies stand and move, for the rows of closures.

use super::algebra::Algebra;
use super::closures::Closure;
use super::engine::{Engine, pose};
use crate::math::vector::difference;
use crate::system::{Motion, Stance};

impl<A: Algebra<N, W>, const N: usize, const W: usize> Engine<A, N, W> {
    /// How all bodies stand at q.
    pub(super) fn stand(&mut self, q: &[f64]) {
        if self.stood == q {
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

    /// How the bodies at the ends of a closure move, and for `displacements` of bodies and `changes` of their twists.
    pub(super) fn motions_of(
        &self,
        closure: &Closure,
        displacements: &[[f64; W]],
        changes: &[[f64; W]],
    ) -> [Motion; 2] {
        let mut out = [Motion::default(); 2];
        for (out, end) in out.iter_mut().zip(closure.ends) {
            let Some(b) = end else { continue };
            let arm = difference(&self.stances[b].place, &self.origin[b]);
            *out = A::motion(&arm, &self.twist[b], [&displacements[b], &changes[b]]);
        }
        out
    }
}
