//! Which rows contradict each other, as messages name them.

use super::corrections::Solver;
use super::least_change::{USUAL, Unknowns, least_change};
use crate::model::Model;
use crate::reduction::stated_joints::Level;
use crate::system::{State, System};
use holonom_linalg::BlockMatrix;

/// Constraints that contradict one of them, one row of each.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Conflict(pub Vec<String>);

/// Constraints that a message names.
pub(super) const SHOWN: usize = 6;
/// Parts of the largest entry below which a row takes no part in a contradiction: where the iteration of a closure has stopped, which it does not
/// do at once, and where equations are linear. A driver on a small lever is little beside lengths.
const PART_OPEN: f64 = 0.05;
const PART_LINEAR: f64 = 1e-4;

impl Conflict {
    /// Those that with `row` take part in a [`contradiction`].
    pub(in crate::reduction) fn of(system: &dyn System, left: &[f64], row: usize) -> Self {
        Self::named(system, &Self::rows_of(system, left, PART_LINEAR, row))
    }

    pub(super) fn named(system: &dyn System, rows: &[usize]) -> Self {
        Self(rows.iter().map(|&k| system.row_name(k)).collect())
    }

    /// The rows of what a closure has left.
    pub(super) fn taking_part(left: &[f64]) -> impl Iterator<Item = usize> {
        Self::above(left, PART_OPEN)
    }

    fn above(left: &[f64], part: f64) -> impl Iterator<Item = usize> {
        let most = left.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        left.iter().enumerate().filter(move |(_, x)| x.abs() > part * most).map(|(k, _)| k)
    }

    /// One row of each that takes part in what a closure of positions or velocities has left.
    pub(super) fn rows(system: &dyn System, left: &[f64], level: Level, row: usize) -> Vec<usize> {
        let part = if level == Level::Position { PART_OPEN } else { PART_LINEAR };
        Self::rows_of(system, left, part, row)
    }

    fn rows_of(system: &dyn System, left: &[f64], part: f64, row: usize) -> Vec<usize> {
        let mut largest: Vec<(&str, usize)> = Vec::new();
        for k in Self::above(left, part) {
            let item = system.row_item(k).0;
            match largest.last_mut() {
                Some((last, at)) if *last == item => {
                    if left[k].abs() > left[*at].abs() {
                        *at = k;
                    }
                }
                _ => largest.push((item, k)),
            }
        }
        let own = system.row_item(row).0;
        let others = largest.into_iter().filter(|(item, _)| *item != own);
        others.map(|(_, k)| k).collect()
    }
}

/// Axes of frames of joints that the names of rows speak of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FrameAxes {
    /// None, but perhaps those of the ground.
    None,
    /// f and g.
    Planar,
    /// f, g and h.
    Spatial,
}

impl FrameAxes {
    pub(super) fn of<'a>(system: &dyn System, mut rows: impl Iterator<Item = &'a usize>) -> Self {
        let of_frame = |&row: &usize| {
            let motion = system.row_item(row).1.motion();
            motion.is_some_and(|(_, axis)| axis.of_frame().is_some())
        };
        match system.structure().sizes.translations {
            _ if !rows.any(of_frame) => Self::None,
            2 => Self::Planar,
            _ => Self::Spatial,
        }
    }
}

impl std::fmt::Display for Conflict {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let shown = self.0[..self.0.len().min(SHOWN)].join("; ");
        match self.0.len().saturating_sub(SHOWN) {
            _ if shown.is_empty() => f.write_str("the other joints"),
            0 => f.write_str(&shown),
            more => write!(f, "{shown}; and {more} more"),
        }
    }
}

/// What stays open of joints and drivers, whatever small change is made: beside a state, or of its velocities.
pub(super) fn open(system: &dyn System, model: &Model, level: Level, state: &State) -> Vec<f64> {
    let mut residual = vec![0.0; system.structure().sizes.rows];
    let mut g = system.structure().constraint_pattern.zeros();
    if level == Level::Position {
        let mut beside = state.clone();
        let solver = Solver { system, model };
        solver.settle(&mut beside, &Unknowns::all(system), &mut g, &mut residual);
        system.position_constraints(state.t, &beside.q, &mut residual);
        // That Euler parameters have unit length is no constraint of the user.
        residual.truncate(system.structure().sizes.joint_rows);
        return residual;
    }
    system.constraint_jacobian(&state.q, &mut g);
    system.velocity_rhs(state.t, &mut residual);
    g.multiply_add(-1.0, &state.v, &mut residual);
    contradiction(system, &state.q, &g, &residual)
}

/// What is left of a residual when no small change of the coordinates makes it smaller, by rows of joints and
/// drivers: Gᵀ n = 0, so that rows with n ≠ 0 depend on each other, and do not agree.
pub(in crate::reduction) fn contradiction(
    system: &dyn System,
    q: &[f64],
    g: &BlockMatrix,
    residual: &[f64],
) -> Vec<f64> {
    let mut left = residual.to_vec();
    if let Some(x) = least_change(system, g, residual, &Unknowns::all(system), q, USUAL) {
        g.multiply_add(-1.0, &x, &mut left);
    }
    // That Euler parameters have unit length is no constraint of the user.
    left.truncate(system.structure().sizes.joint_rows);
    left
}
