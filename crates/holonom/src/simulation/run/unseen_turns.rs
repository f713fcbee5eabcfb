//! Turns within a step whose forces no stage sees. Equations: `docs/theory/simulation.md` (6c), (6e).

use super::Run;
use crate::error::EvaluationFailure;
use crate::simulation::step_length;
use crate::system::{LawPlace, System};
use std::f64::consts::TAU;

/// Largest turn of an angle in a step whose stages see what goes round with it, rad.
const SEEN: f64 = 2.0;
/// Turn of a step that is to see it, rad.
const LOOKED_AT: f64 = 1.5;
/// Tolerances of a motion that goes round with an angle and is left alone, or that a force seen at one phase makes in a step.
const UNSEEN: f64 = 0.1;
/// Angles that turn so many times faster or more slowly than another one are held when that one is turned.
const FASTER: f64 = 2.0;
/// Steps for which is known what turns of an angle are allowed, and how much its rate may change meanwhile.
const STEPS: u32 = 16;
const SAME: f64 = 0.25;
/// What a step may be longer than it was to be, to end at a kink or at a time of few digits, as a part of it.
const STRETCHED: f64 = 0.02;
/// The part of a turn whose multiples are spread most evenly over it.
const GOLDEN: f64 = 0.618_033_988_749_895;
/// Places around an angle, in turns: waves of few periods to a turn differ there.
const PLACES: [f64; 2] = [0.3, 0.62];
/// Places around it at which arguments of laws are looked at, and the part of their range that these may miss on a wave of up to two
/// periods to a turn.
const PLACES_OF_LAWS: u32 = 16;
const MISSED: f64 = 0.1;

/// What is known of an angle for some steps.
#[derive(Debug, Clone, Copy, Default)]
struct Known {
    steps: u32,
    /// Largest turn in a step, rad.
    allowed: f64,
    /// rad/s.
    rate: f64,
}

/// An angle that time tells.
#[derive(Debug, Clone, Copy)]
enum Prescribed {
    /// Of a joint that turns and closes no loop, by the row of its driver.
    Driven(usize),
    /// The phase of harmonic forces of an angular frequency, rad/s.
    Phase(f64),
}

/// What is known of angles of any size, and room to look at them: first those among the independent variables, by their place, then
/// those that are prescribed.
#[derive(Debug, Clone, Default)]
pub(super) struct UnseenTurns {
    known: Vec<Known>,
    prescribed: Vec<Prescribed>,
    /// How variables move where an angle turns by one radian, and the time that passes, s/rad.
    direction: Vec<f64>,
    passing: f64,
    /// Which angles turn along with the one in question.
    along: Vec<bool>,
    /// Slopes at the end of the attempt, at the places around and a whole turn further.
    here: Vec<f64>,
    around: [Vec<f64>; 2],
    again: Vec<f64>,
    /// What goes round, the same with other signs, the slope there, and the least acceleration against it.
    motion: Vec<f64>,
    signed: Vec<f64>,
    there: Vec<f64>,
    against: Vec<f64>,
    /// Least and largest arguments of laws.
    ranges: Vec<[f64; 2]>,
}

impl UnseenTurns {
    /// Of a system with harmonic forces of these angular frequencies, rad/s, and so many independent variables and unknowns.
    pub(super) fn new(
        system: &dyn System,
        frequencies: &[f64],
        ndof: usize,
        dimension: usize,
    ) -> Self {
        let room = || vec![0.0; dimension];
        let (tree, groups) = (system.tree(), system.relative_groups());
        let driven = tree.edges.iter().filter_map(|edge| {
            let (row, coordinate, _) = edge.driver?;
            let group = &groups[edge.forms[0].clone().nth(coordinate)?];
            (group.kind.turns() && group.reach.is_infinite()).then_some(Prescribed::Driven(row))
        });
        let phases = frequencies.iter().map(|&frequency| Prescribed::Phase(frequency));
        let prescribed: Vec<Prescribed> = driven.chain(phases).collect();
        Self {
            known: vec![Known::default(); ndof + prescribed.len()],
            along: vec![false; ndof + prescribed.len()],
            prescribed,
            direction: room(),
            passing: 0.0,
            here: room(),
            around: [room(), room()],
            again: room(),
            motion: room(),
            signed: room(),
            there: room(),
            against: room(),
            ranges: vec![[0.0; 2]; system.law_arguments().len()],
        }
    }

    /// Whether `k` is the phase of a force.
    fn is_phase(&self, ndof: usize, k: usize) -> bool {
        k.checked_sub(ndof).is_some_and(|at| matches!(self.prescribed[at], Prescribed::Phase(_)))
    }

    /// Nothing is known, as at a start.
    pub(super) fn forget(&mut self) {
        self.known.fill(Known::default());
    }

    /// The wave a(φ) − a(0) = A (cos φ − 1) + B sin φ + D φ of accelerations as a motion at `rate`; the trend D is known or not there.
    fn find_motion(&mut self, ndof: usize, rate: f64, has_trend: bool) {
        let Self { here, around: [first, second], again, motion, .. } = self;
        let [(s1, c1), (s2, c2)] = PLACES.map(|place| (TAU * place).sin_cos());
        let determinant = (c1 - 1.0) * s2 - (c2 - 1.0) * s1;
        motion.fill(0.0);
        for i in 0..ndof {
            let at = ndof + i;
            let trend = if has_trend { again[at] - here[at] } else { 0.0 };
            let first = first[at] - here[at] - PLACES[0] * trend;
            let second = second[at] - here[at] - PLACES[1] * trend;
            let a = (first * s2 - second * s1) / determinant;
            let b = ((c1 - 1.0) * second - (c2 - 1.0) * first) / determinant;
            motion[i] = a.hypot(b) / (rate * rate);
            motion[at] = rate * motion[i];
        }
    }
}

impl Run<'_> {
    /// The longest step, s, in which stages see what goes round with the angles that matter.
    pub(super) fn longest_to_see(&self) -> f64 {
        let (turns, ndof) = (&self.unseen_turns, self.form.second_order_split());
        let is_limited =
            |k: &usize| turns.known[*k].steps > 0 && turns.known[*k].allowed.is_finite();
        let longest = |k: usize| {
            // A part of what keeps out of the pace of a force may keep it.
            let part = if turns.is_phase(ndof, k) { 1.0 } else { self.turn_part };
            part * turns.known[k].allowed / self.rate(turns, k, self.state.t, &self.w).abs()
        };
        (0..turns.known.len()).filter(is_limited).map(longest).fold(f64::INFINITY, f64::min)
    }

    /// The longest step, s, in which Newton's method tells how often driven angles have turned: on the tree the driver tells it.
    pub(super) fn longest_to_tell(&self) -> f64 {
        let times = self.unseen_turns.prescribed.iter().filter_map(|prescribed| match prescribed {
            Prescribed::Driven(row) => {
                Some(step_length::untold_at(self.system.drive(*row, self.state.t)[1]))
            }
            Prescribed::Phase(_) => None,
        });
        times.fold(f64::INFINITY, f64::min)
    }

    /// A step has been accepted.
    pub(super) fn has_turned(&mut self) {
        self.unseen_turns
            .known
            .iter_mut()
            .for_each(|known| known.steps = known.steps.saturating_sub(1));
    }

    /// The part of the attempt over `step` up to `t_end` that is allowed by an angle which turned by more than stages see, where
    /// what goes round with it matters. `next` is the next time at which what is prescribed has a kink.
    pub(super) fn unseen_turn(&mut self, t_end: f64, step: f64, next: f64) -> Option<f64> {
        let count = self.unseen_turns.known.len();
        if !(0..count).any(|k| self.is_to_be_looked_at(&self.unseen_turns, k, t_end, step)) {
            return None;
        }
        let mut turns = std::mem::take(&mut self.unseen_turns);
        let mut part: Option<f64> = None;
        // The steps themselves have just been there.
        if self.recorder.slope_at(t_end, &self.w_end, &mut turns.here).is_ok() {
            for k in 0..count {
                if !self.is_to_be_looked_at(&turns, k, t_end, step) {
                    continue;
                }
                let turn = step * self.mean_rates(&turns, k, t_end)[1];
                let allowed = self.allowed(&mut turns, [t_end, next], k, step);
                if allowed * (1.0 + STRETCHED) < turn {
                    part = Some(part.unwrap_or(1.0).min(allowed / turn));
                }
            }
        }
        self.unseen_turns = turns;
        self.recorder.begin_again(&self.state);
        part
    }

    /// Rate of angle `k` where the unknowns are `w`, rad/s.
    fn rate(&self, turns: &UnseenTurns, k: usize, t: f64, w: &[f64]) -> f64 {
        let ndof = self.form.second_order_split();
        match k.checked_sub(ndof) {
            None => w[ndof + k],
            Some(at) => match turns.prescribed[at] {
                Prescribed::Driven(row) => self.system.drive(row, t)[1],
                Prescribed::Phase(frequency) => frequency,
            },
        }
    }

    /// Mean rate of angle `k` in the attempt by those at its ends, rad/s, and the mean of their sizes.
    fn mean_rates(&self, turns: &UnseenTurns, k: usize, t_end: f64) -> [f64; 2] {
        let first = self.rate(turns, k, self.state.t, &self.w);
        let last = self.rate(turns, k, t_end, &self.w_end);
        [0.5 * (first + last), 0.5 * (first.abs() + last.abs())]
    }

    /// Whether `k` is an angle that turns by more than stages see, by as much as is not known to be allowed.
    fn is_to_be_looked_at(&self, turns: &UnseenTurns, k: usize, t_end: f64, step: f64) -> bool {
        let ([_, rate], known) = (self.mean_rates(turns, k, t_end), &turns.known[k]);
        let is_known = known.steps > 0 && step * rate <= known.allowed * (1.0 + STRETCHED);
        step * rate > SEEN
            && !(is_known && (rate - known.rate).abs() <= SAME * known.rate)
            && self.is_endless(k)
    }

    /// Whether `k` is an angle of any size.
    fn is_endless(&self, k: usize) -> bool {
        let relatives = self.form.point().manifold.chart().parametrization().relatives();
        k >= self.form.second_order_split()
            || relatives.is_some_and(|some| some.is_endless_angle(self.system.as_ref(), k))
    }

    /// The turn of angle `k` in a step, rad, by which what goes round with it does not matter; what cannot be told may. What turns
    /// about as fast turns along: discs on one shaft do not wind it up, and where none of them matters that is known of all.
    fn allowed(
        &mut self,
        turns: &mut UnseenTurns,
        [t_end, next]: [f64; 2],
        k: usize,
        step: f64,
    ) -> f64 {
        let ndof = self.form.second_order_split();
        let [_, own] = self.mean_rates(turns, k, t_end);
        let mut slowest = own;
        turns.direction.fill(0.0);
        turns.passing = 0.0;
        for i in 0..turns.known.len() {
            let [signed, rate] = self.mean_rates(turns, i, t_end);
            let is_like = FASTER * rate >= own && rate <= FASTER * own;
            // A phase goes round alone, and is known by itself.
            let alone = turns.is_phase(ndof, i) || turns.is_phase(ndof, k);
            let along = i == k || !alone && is_like && step * rate > SEEN && self.is_endless(i);
            turns.along[i] = along;
            if !along {
                continue;
            }
            slowest = slowest.min(rate);
            if i >= ndof {
                turns.passing = own.recip();
            } else {
                turns.direction[i] = if i == k { own.copysign(signed) / own } else { signed / own };
            }
        }
        // Times of the run, and none beyond a kink of what is prescribed, if may be.
        let turn = TAU * turns.passing;
        let towards = if t_end + turn <= next { 1.0 } else { -1.0 };
        // Steps that come to be whole turns find the same force again and again.
        let keeps_pace = turns.is_phase(ndof, k);
        let allowed = if towards < 0.0 && t_end - turn < self.started {
            LOOKED_AT
        } else {
            let rate = if keeps_pace { slowest.min(step.recip()) } else { slowest };
            let moved = self.moves_by(turns, t_end, towards, rate);
            let moved = moved.ok().filter(|moved| keeps_pace || *moved <= UNSEEN);
            match moved {
                Some(moved) if !self.passes_knot_around(turns, t_end, towards).unwrap_or(true) => {
                    if keeps_pace {
                        spread(step * own * UNSEEN / moved).max(LOOKED_AT)
                    } else {
                        f64::INFINITY
                    }
                }
                _ => LOOKED_AT,
            }
        };
        for i in 0..turns.known.len() {
            if i == k || allowed * (1.0 + STRETCHED) >= step * own && turns.along[i] {
                let [_, rate] = self.mean_rates(turns, i, t_end);
                turns.known[i] = Known { steps: STEPS, allowed: allowed * rate / own, rate };
            }
        }
        allowed
    }

    /// The motion, in tolerances, that goes round in the direction at `rate`, rad/s, seen ahead or, where `towards` is −1, behind.
    ///
    /// # Errors
    /// Where the mechanism cannot be evaluated elsewhere.
    fn moves_by(
        &mut self,
        turns: &mut UnseenTurns,
        t: f64,
        towards: f64,
        rate: f64,
    ) -> Result<f64, EvaluationFailure> {
        let ndof = self.form.second_order_split();
        let (w_end, recorder, at) = (&self.w_end, &mut self.recorder, &mut self.scratch[0]);
        let mut slope = |by: f64, along: &[f64], passing: f64, slope: &mut [f64]| {
            for ((at, w), along) in at.iter_mut().zip(w_end).zip(along) {
                *at = w + by * along;
            }
            recorder.slope_at(t + by * passing, at, slope)
        };
        let (turn, passing) = (towards * TAU, turns.passing);
        for (place, there) in PLACES.into_iter().zip(&mut turns.around) {
            slope(turn * place, &turns.direction, passing, there)?;
        }
        turns.find_motion(ndof, rate, false);
        let moved = self.form.error_norm(&turns.motion, w_end);
        if moved <= UNSEEN {
            return Ok(moved);
        }
        // What does not come back after a turn, as the torque of a spring, is no wave; stages see it.
        slope(turn, &turns.direction, passing, &mut turns.again)?;
        turns.find_motion(ndof, rate, true);
        // Stiff elements allow less of it, whatever the signs of its parts: askew, they hold one sum of two parts and not the other.
        let UnseenTurns { here, motion, signed, there, against, .. } = turns;
        motion[ndof..].fill(0.0);
        signed[ndof..].fill(0.0);
        against.fill(f64::INFINITY);
        for signs in [0, 1, 2, 3] {
            let mut part = 0u32;
            for (signed, moved) in signed.iter_mut().zip(&motion[..ndof]) {
                let is_negative = (part & signs).count_ones() % 2 == 1;
                *signed = if is_negative { -moved } else { *moved };
                part += u32::from(*moved > 0.0);
            }
            slope(1.0, signed, 0.0, there)?;
            for i in 0..ndof {
                against[i] = against[i].min((there[ndof + i] - here[ndof + i]).abs());
            }
        }
        for i in 0..ndof {
            let moved = motion[i];
            if moved > 0.0 {
                motion[i] = moved / (1.0 + against[i] / (moved * rate * rate));
            }
            motion[ndof + i] = rate * motion[i];
        }
        Ok(self.form.error_norm(motion, w_end))
    }

    /// Whether an argument of a law passes one of its knots as the angles go round: what lasts for a few degrees is in no wave.
    ///
    /// # Errors
    /// Where the mechanism does not go there.
    fn passes_knot_around(
        &mut self,
        turns: &mut UnseenTurns,
        t: f64,
        towards: f64,
    ) -> Result<bool, EvaluationFailure> {
        let system = self.system.as_ref();
        let arguments = system.law_arguments();
        if arguments.iter().all(|argument| argument.knots.is_empty()) {
            return Ok(false);
        }
        let (w_end, recorder, at) = (&self.w_end, &mut self.recorder, &mut self.scratch[0]);
        turns.ranges.fill([f64::INFINITY, f64::NEG_INFINITY]);
        for k in 0..PLACES_OF_LAWS {
            let by = towards * TAU * f64::from(k) / f64::from(PLACES_OF_LAWS);
            for ((at, w), along) in at.iter_mut().zip(w_end).zip(&turns.direction) {
                *at = w + by * along;
            }
            let state = recorder.state_at(t + by * turns.passing, at)?;
            for ([least, largest], argument) in turns.ranges.iter_mut().zip(arguments) {
                let LawPlace { value, smooth, .. } = system.law_place(argument, state);
                if value.abs() >= smooth {
                    (*least, *largest) = (least.min(value), largest.max(value));
                }
            }
        }
        Ok(turns.ranges.iter().zip(arguments).any(|([least, largest], argument)| {
            let missed = MISSED * (largest - least);
            let below = |value: f64| argument.knots.partition_point(|&knot| knot <= value);
            let negligible = self.negligible(argument);
            largest - least > negligible && below(least - missed) < below(largest + missed)
        }))
    }
}

/// The largest turn up to this one, rad, whose repetition finds what goes round at all phases alike.
fn spread(most: f64) -> f64 {
    let whole = (most / TAU - GOLDEN).floor();
    if whole >= 0.0 && whole.is_finite() { TAU * (whole + GOLDEN) } else { most }
}
