//! A path to what is far: all that is open becomes less together. Equation: `docs/theory/reduction.md` (51a).

use super::corrections::Solver;
use super::least_change::{FURTHEST, OFTEN, Solve, USUAL, Unknowns, largest, limited, size};
use crate::system::{Measure, State};
use holonom_linalg::BlockMatrix;
use std::cmp::Ordering::{Equal, Less};
use std::f64::consts::TAU;

/// Corrections back to a path are at most so large against the one before, the first against the way that was gone.
const CONTRACTION: f64 = 0.3;
/// Corrections by less, against the way that was gone, end them.
const NEAR_PATH: f64 = 1e-2;
/// Over a long way lengths are measured in no more characteristic ones: beyond, the rank of rows that only turn bodies would
/// be lost.
const MOST_LENGTHS: f64 = 1e5;
/// Part of a path that is too short to go on, against the longest one; the first may be shorter by that once more.
const SHORTEST: f64 = 1e-3;
/// Paths one after the other that lead no nearer, and parts of all of them.
const IN_VAIN: usize = 4;
const MOST_TRIES: usize = 500;

impl Solver<'_> {
    /// Goes along the path on which Φ(q) is a smaller and smaller part of what it is at first, least change all the way
    /// (D. F. Davidenko, Dokl. Akad. Nauk SSSR 88 (1953) 601): each part is closed before the next. Where the path turns
    /// back, as at a dead point, another one begins beyond.
    pub(super) fn follow(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        phi: &mut [f64],
    ) {
        let mut first = vec![0.0; phi.len()];
        let (mut tries, mut in_vain, mut least) = (0, 0, f64::INFINITY);
        loop {
            let open = self.left(state, &mut first);
            in_vain = if open < 0.9 * least { 0 } else { in_vain + 1 };
            if in_vain == IN_VAIN {
                return;
            }
            least = least.min(open);
            // Over a long way least change would turn bodies where sliding them will do.
            let step = self.least_change(&state.q, unknowns, g, &first, USUAL);
            let Some(step) = step else { return };
            let lengths = (largest(self.system, &step, 1.0)[0] / FURTHEST).clamp(1.0, MOST_LENGTHS);
            let by = Solve { lengths, ..OFTEN };
            let (mut left, mut longest, mut usual) = (1.0, 1.0f64, 0.0f64);
            while left > 0.0 {
                let from = state.q.clone();
                let tangent = self.least_change(&from, unknowns, g, &first, by);
                let Some(tangent) = tangent else { return };
                let [_, turned] = largest(self.system, &tangent, lengths);
                if !turned.is_finite() {
                    return;
                }
                // Equal parts of what is left, so that no remainder is too short.
                let mut part = left / (left / longest.min(FURTHEST / turned)).ceil().max(1.0);
                let shortest = SHORTEST * if usual > 0.0 { usual } else { SHORTEST }.min(part);
                loop {
                    tries += 1;
                    if tries > MOST_TRIES {
                        return;
                    }
                    let step: Vec<f64> = tangent.iter().map(|x| part * x).collect();
                    self.subtract(state, unknowns, &step);
                    if self.return_to_path(
                        state,
                        unknowns,
                        g,
                        phi,
                        (&first, left - part),
                        (&step, by),
                    ) {
                        break;
                    }
                    state.q.copy_from_slice(&from);
                    part *= 0.5;
                    if part <= shortest {
                        break;
                    }
                }
                if part <= shortest {
                    self.subtract(state, unknowns, &limited(self.system, tangent, lengths));
                    break;
                }
                usual = usual.max(part);
                longest = 2.0 * part;
                left = if part < left { left - part } else { 0.0 };
            }
            if left == 0.0 {
                return;
            }
        }
    }

    /// Corrects a state that has gone a step along a path until it is on it again, where only the part `left` of `first` is;
    /// whether corrections are small, against that step, and become so.
    fn return_to_path(
        &self,
        state: &mut State,
        unknowns: &Unknowns,
        g: &mut BlockMatrix,
        phi: &mut [f64],
        (first, left): (&[f64], f64),
        (step, by): (&[f64], Solve),
    ) -> bool {
        let way = size(self.system, step, by.lengths);
        let mut before = way;
        loop {
            self.system.position_constraints(state.t, &state.q, phi);
            phi.iter_mut().zip(first).for_each(|(x, first)| *x -= left * first);
            self.reduce_turns(state.t, phi);
            let step = self.least_change(&state.q, unknowns, g, phi, by);
            let Some(step) = step else { return false };
            let length = size(self.system, &step, by.lengths);
            // No comparison holds for what is not a number.
            if !matches!(length.partial_cmp(&(CONTRACTION * before)), Some(Less | Equal)) {
                return false;
            }
            self.subtract(state, unknowns, &step);
            if length <= NEAR_PATH * way {
                return true;
            }
            before = length;
        }
    }

    /// Takes what drivers of angles leave modulo a turn, as Φ has it.
    fn reduce_turns(&self, t: f64, left: &mut [f64]) {
        let structure = self.system.structure();
        for (k, joint) in structure.joints.iter().enumerate() {
            let driven = self.system.joint_drive(k, t).is_some();
            if driven && structure.row_measure[joint.row] == Measure::Angle {
                let x = &mut left[joint.row];
                *x -= TAU * (*x / TAU).round();
            }
        }
    }
}
