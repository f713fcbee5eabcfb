//! Turns within a step whose forces no stage sees. Equations: `docs/theory/simulation.md` (6c).

use super::Run;
use crate::error::EvaluationFailure;
use crate::simulation::recorder::Recorder;
use std::f64::consts::{FRAC_PI_2, PI, TAU};

/// Largest turn of an angle in a step whose stages see what goes round with it, rad.
const SEEN: f64 = 2.0;
/// Turn of a step that is to see it, rad.
const LOOKED_AT: f64 = 1.5;
/// Tolerances of a motion that goes round with an angle and is left alone.
const UNSEEN: f64 = 0.1;
/// Angles that turn so many times faster than another one are held when that one is turned.
const FASTER: f64 = 2.0;
/// Steps that an angle limits before it is looked at again.
const STEPS: u32 = 16;

/// What is known of angles of any size among the independent variables.
#[derive(Debug, Clone, Default)]
pub(super) struct Turning {
    /// Steps that each of them is yet to limit.
    limiting: Vec<u32>,
    /// How variables move where an angle turns by one radian.
    direction: Vec<f64>,
    /// Slopes at the end of the attempt, a quarter of a turn, half a turn and a whole one further.
    here: Vec<f64>,
    turned: [Vec<f64>; 3],
    /// What goes round.
    motion: Vec<f64>,
}

impl Turning {
    /// Of so many unknowns.
    pub(super) fn new(dimension: usize) -> Self {
        let room = || vec![0.0; dimension];
        Self {
            limiting: vec![0; dimension],
            direction: room(),
            here: room(),
            turned: [room(), room(), room()],
            motion: room(),
        }
    }

    /// Nothing is known, as at a start.
    pub(super) fn forget(&mut self) {
        self.limiting.fill(0);
    }

    /// The wave a(φ) = A cos φ + B sin φ + C + D φ of accelerations, whose place is φ = 0, as a motion at `rate`; the trend D is
    /// known or not there.
    fn find_motion(&mut self, ndof: usize, rate: f64, has_trend: bool) {
        let Self { here, turned: [quarter, half, whole], motion, .. } = self;
        motion.fill(0.0);
        for i in 0..ndof {
            let at = ndof + i;
            let trend = if has_trend { whole[at] - here[at] } else { 0.0 };
            let half = half[at] - here[at] - 0.5 * trend;
            let quarter = quarter[at] - here[at] - 0.25 * trend;
            // −2A and B − A
            motion[i] = (0.5 * half).hypot(quarter - 0.5 * half) / (rate * rate);
            motion[at] = rate * motion[i];
        }
    }
}

impl Run<'_> {
    /// The longest step, s, in which stages see what goes round with the angles that matter.
    pub(super) fn longest_turning(&self) -> f64 {
        let ndof = self.form.second_order_split();
        let rates = &self.w[ndof..2 * ndof];
        let limited = self.turning.limiting.iter().zip(rates).filter(|(steps, _)| **steps > 0);
        limited.map(|(_, rate)| LOOKED_AT / rate.abs()).fold(f64::INFINITY, f64::min)
    }

    /// A step has been accepted that such angles may have limited.
    pub(super) fn has_turned(&mut self) {
        self.turning.limiting.iter_mut().for_each(|steps| *steps = steps.saturating_sub(1));
    }

    /// The part of the attempt over `step` up to `t_end` that is allowed by an angle which turned by more than stages see, where
    /// what goes round with it matters.
    pub(super) fn unseen_turn(&mut self, t_end: f64, step: f64) -> Option<f64> {
        let ndof = self.form.second_order_split();
        if !(0..ndof).any(|k| self.turn(k, step) > SEEN && self.is_endless(k)) {
            return None;
        }
        let mut turning = std::mem::take(&mut self.turning);
        let mut part: Option<f64> = None;
        // The steps themselves have just been there.
        if self.recorder.slope_at(t_end, &self.w_end, &mut turning.here).is_ok() {
            for k in 0..ndof {
                let turn = self.turn(k, step);
                if turn <= SEEN || !self.is_endless(k) {
                    continue;
                }
                // What cannot be told may matter.
                if self.moves_by(&mut turning, t_end, k, turn / step).is_ok_and(|by| by <= UNSEEN) {
                    continue;
                }
                turning.limiting[k] = STEPS;
                part = Some(part.unwrap_or(1.0).min(LOOKED_AT / turn));
            }
        }
        self.turning = turning;
        self.recorder.begin_again(&self.state);
        part
    }

    /// How far variable `k` moves in the attempt, by its rates at both ends.
    fn turn(&self, k: usize, step: f64) -> f64 {
        let rate = self.form.second_order_split() + k;
        0.5 * step * (self.w[rate].abs() + self.w_end[rate].abs())
    }

    /// Whether it is an angle of any size.
    fn is_endless(&self, k: usize) -> bool {
        let relatives = self.form.point().manifold.chart().parametrization().relatives();
        relatives.is_some_and(|relatives| relatives.is_endless_angle(self.system.as_ref(), k))
    }

    /// The motion, in tolerances, that goes round with angle `k` at `rate`, rad/s. What turns more slowly or as fast turns
    /// along: discs on one shaft do not wind it up.
    ///
    /// # Errors
    /// Where the mechanism cannot be evaluated at other angles.
    fn moves_by(
        &mut self,
        turning: &mut Turning,
        t: f64,
        k: usize,
        rate: f64,
    ) -> Result<f64, EvaluationFailure> {
        let ndof = self.form.second_order_split();
        let own = self.w_end[ndof + k];
        turning.direction.fill(0.0);
        for i in 0..ndof {
            let other = self.w_end[ndof + i];
            if other.abs() <= FASTER * own.abs() && self.is_endless(i) {
                turning.direction[i] = other / own.abs();
            }
        }
        turning.direction[k] = own.signum();
        let w_end = &self.w_end;
        let at = &mut self.scratch[0];
        let mut slope = |recorder: &mut Recorder, by: f64, along: &[f64], slope: &mut [f64]| {
            for ((at, w), along) in at.iter_mut().zip(w_end).zip(along) {
                *at = w + by * along;
            }
            recorder.slope_at(t, at, slope)
        };
        let recorder = &mut self.recorder;
        for (angle, there) in [FRAC_PI_2, PI].into_iter().zip(&mut turning.turned) {
            slope(recorder, angle, &turning.direction, there)?;
        }
        turning.find_motion(ndof, rate, false);
        if self.form.error_norm(&turning.motion, w_end) <= UNSEEN {
            return Ok(0.0);
        }
        // What does not come back after a turn, as the torque of a spring, is no wave; stages see it.
        slope(recorder, TAU, &turning.direction, &mut turning.turned[2])?;
        turning.find_motion(ndof, rate, true);
        // Stiff elements allow less of it: the acceleration against it.
        let Turning { here, turned: [there, ..], motion, .. } = turning;
        motion[ndof..].fill(0.0);
        slope(recorder, 1.0, motion, there)?;
        for i in 0..ndof {
            let (moved, against) = (motion[i], (there[ndof + i] - here[ndof + i]).abs());
            if moved > 0.0 {
                motion[i] = moved / (1.0 + against / (moved * rate * rate));
            }
            motion[ndof + i] = rate * motion[i];
        }
        Ok(self.form.error_norm(motion, w_end))
    }
}
