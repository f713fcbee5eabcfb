//! When corrections of positions end, and why they have failed: what recoveries in Cartesian and in joint coordinates have in common.

use crate::error::EvaluationFailure;
use crate::system::System;

/// Corrections that contract more slowly than this are refused as a way to another branch.
pub(super) const CONTRACTION_LIMIT: f64 = 0.5;
/// The first one where corrections are slow, others where they do not contract at all.
pub(super) const MAX_FACTORIZATIONS: u32 = 3;
pub(super) const MAX_CORRECTIONS: u32 = 40;
/// What corrections may move, rad or characteristic lengths: other branches, and other turns, are a few radians away.
pub(super) const FARTHEST: f64 = 1.0;
/// Corrections of this size may be noise where the residual is.
pub(super) const NOISY_CORRECTION: f64 = 1e-9;

/// Residuals that the last digits of the coordinates `q` leave: they are differences of places in the ground.
pub(super) fn round_off(q: &[f64]) -> f64 {
    64.0 * f64::EPSILON * q.iter().fold(1.0f64, |m, x| if x.abs() > m { x.abs() } else { m })
}

/// The tangent turns a joint in a loop by `turned`, rad: that the loop closes tells no whole turns.
pub(super) fn turned_too_far(turned: f64) -> EvaluationFailure {
    EvaluationFailure::new(
        "simulation/branch",
        format!(
            "a joint of a loop would turn by {turned:.1} rad at once, more than half a turn, of which the closed loop does \
             not tell the direction"
        ),
    )
}

/// A coordinate, by its name and number, ends too far from where the tangent led.
pub(super) fn another_branch((name, coordinate): (&str, usize)) -> EvaluationFailure {
    let message =
        format!("`{name}` would leave the branch of the mechanism that was followed so far");
    EvaluationFailure::new("simulation/branch", message).of_coordinate(coordinate)
}

/// Corrections that do not fall.
pub(super) struct Unclosed<'a> {
    /// s.
    pub(super) t: f64,
    /// The largest residual of a joint, with its row.
    pub(super) worst: Option<(usize, f64)>,
    /// The size of the last correction.
    pub(super) correction: f64,
    /// What it moves most, by name and number.
    pub(super) moved: (&'a str, usize),
}

impl Unclosed<'_> {
    /// Nothing is left of the residuals.
    pub(super) fn undetermined(&self) -> EvaluationFailure {
        let Self { t, correction, moved: (name, coordinate), .. } = self;
        let message = format!(
            "the joints are closed at t = {t:.6} s, but leave `{name}` undetermined: corrections of \
             {correction:.2e} do not fall"
        );
        EvaluationFailure::new("simulation/singular-configuration", message)
            .of_coordinate(*coordinate)
    }

    /// Residuals are left.
    pub(super) fn open(&self, system: &dyn System) -> EvaluationFailure {
        let Self { t, worst, correction, moved: (name, coordinate) } = self;
        let residual = match worst {
            Some((row, size)) => format!("{:.2e}, is in {}", size.abs(), system.row_name(*row)),
            None => "0, is in no joint".to_owned(),
        };
        let message = format!(
            "the joints could not be closed at t = {t:.6} s; the largest residual, {residual}; the \
             last correction, {correction:.2e}, was of `{name}`"
        );
        EvaluationFailure::new("simulation/position-recovery", message)
            .of_row(worst.map(|(row, _)| row))
            .of_coordinate(*coordinate)
    }
}
