//! The errors of steps, carried along with the motion. Equations: `docs/theory/simulation.md` (11), (12).

use super::carried_explicitly::{MOST_EVALUATIONS, MOST_WAITING, Serving};
use super::options::Options;
use super::problem::Problem;
use super::statistics::RunWarning;
use super::unseen_growth::LongestStep;
use crate::method::stepper::Stepper;
use crate::method::{EquationForm, Weights};
use crate::system::State;
use serde::{Deserialize, Serialize};
use std::f64::consts::{FRAC_PI_2, PI};

/// Tolerances from which a second run is asked: a fifth of what is warned of, since the carried error is up to a few times
/// too small.
pub(super) const SUSPICIOUS: f64 = 10.0;
/// Velocities may be this many times as many tolerances off as places.
pub(super) const VELOCITIES: f64 = 2.0;
/// Of what is as fast as one radian to a step, the error of Radau's formula is this to the second of its estimate.
const TURNED: f64 = 0.17;
/// Tolerances from which steps become shorter, and the power of what is carried by which they do: 1.7 times before it is
/// suspicious.
const NOTABLE: f64 = 5.0;
const SHORTENING: f64 = 0.75;
/// Tolerances of a velocity that one of a place may make at once, unseen.
const FELT: f64 = 0.1;
/// Error of the start, in tolerances: what grows to be suspicious from there grows some thousandfold. Three times as much would
/// ask for second runs of Andrews' mechanism, in vain.
const SEED: f64 = 0.003;
/// States on its way, least and most, that a run keeps for the comparison with a second one, beside that at its end.
const MILESTONES: [usize; 2] = [8, 1024];
/// Parts of a run at whose ends it is compared at least, where there is room for twice as many states: what has moved and is
/// back when a long step ends has moved.
const PARTS: f64 = 32.0;
/// Coordinates of all of them, so that checkpoints stay small.
const COORDINATES: usize = 20_000;

/// An error of the present state.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Carried {
    /// In w.
    pub(super) error: Vec<f64>,
    /// On coordinates and, where these are asked for, velocities.
    pub(super) spread: [Vec<f64>; 2],
}

/// A step just accepted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stepped<'a> {
    /// Its end, s.
    pub(super) t: f64,
    /// Its length, s.
    pub(super) step: f64,
    /// Its end.
    pub(super) w: &'a [f64],
    /// Slopes of the equations at its start and its end.
    pub(super) slopes: [&'a [f64]; 2],
    /// Whether time takes no part in the equations there.
    pub(super) autonomous: bool,
    /// Whether laws may have passed knots in it.
    pub(super) passes_knot: bool,
    /// By how much the moment comes late at which the force of a line turns round, s, where places are a tolerance off; 0 where
    /// none does.
    pub(super) delay: f64,
    /// By which bodies that turn freely turn in it, rad.
    pub(super) turn: f64,
}

/// What a run knows of its error: that of its present state, as far as it is estimated, and how large it has been.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct CarriedError {
    /// The sum of the estimates, and that of estimates whose signs make them add up: an estimate is the error of another
    /// formula, which may change its sign where that of the motion does not.
    pub(super) sums: [Carried; 2],
    pub(super) serving: Serving,
    #[serde(default = "of_before")]
    seeded: bool,
    /// The largest rate lately of each independent variable.
    pub(super) rates: Vec<f64>,
    /// Whether the motion may have made more of it than any matrix tells.
    #[serde(default)]
    hidden: bool,
    /// What its rates count times as lengths.
    #[serde(skip)]
    pub(super) arms: Vec<f64>,
    /// The largest of all rates so far, and of theirs, as lengths: m/s, m/s².
    #[serde(default)]
    pub(super) fastest: [f64; 2],
    /// Of the place of a body, in its tolerances, or of its velocity, in its wider ones: there, and the largest of all.
    present: f64,
    largest: f64,
    /// Tolerances up to which it is followed.
    #[serde(default = "up_to_suspicious")]
    followed: f64,
    /// By which power of e what is carried may be too small, as matrices served steps that they were not made for.
    #[serde(default)]
    unsure: f64,
    /// How many times shorter steps are to be.
    #[serde(default = "as_long_as_before")]
    shortening: f64,
    pub(super) milestones: Milestones,
    /// Largest speed, m/s, and rate of turning, rad/s, of each body so far.
    pub(super) speeds: Vec<[f64; 2]>,
    /// Room for a change of w.
    #[serde(skip)]
    pub(super) room: Vec<f64>,
    /// γh times the slope that iterations have left at the end of a step.
    #[serde(skip)]
    left: Vec<f64>,
    /// Whether the error stands on coordinates and velocities as it is.
    #[serde(skip)]
    spread: bool,
    /// What is told of missing energy unless a second run finds the motion right, and potentials that differ by less than so
    /// many joules.
    #[serde(skip)]
    pub(super) missing: Option<(RunWarning, f64)>,
    /// Of runs that are not too large.
    #[serde(default)]
    pub(super) longest: Option<LongestStep>,
}

/// Of checkpoints that do not say: what they carry has begun.
fn of_before() -> bool {
    true
}

fn as_long_as_before() -> f64 {
    1.0
}

fn up_to_suspicious() -> f64 {
    SUSPICIOUS
}

impl CarriedError {
    /// Of a run with `ndof` independent variables and `dimension` unknowns that begins at `start`, without an error.
    pub(super) fn new([ndof, dimension]: [usize; 2], weights: &Weights, start: &State) -> Self {
        let n = start.q.len();
        let none = || Carried { error: vec![0.0; dimension], spread: [vec![0.0; n], vec![0.0; n]] };
        Self {
            sums: [none(), none()],
            // What the first steps leave is little.
            serving: Serving { most: MOST_EVALUATIONS, ..Serving::NEW },
            seeded: false,
            rates: Vec::with_capacity(dimension),
            hidden: false,
            arms: Vec::with_capacity(dimension),
            fastest: [0.0; 2],
            present: 0.0,
            largest: 0.0,
            followed: SUSPICIOUS,
            unsure: 0.0,
            shortening: 1.0,
            milestones: Milestones::new(start),
            speeds: weights.speeds(&start.v).collect(),
            room: vec![0.0; dimension],
            left: Vec::with_capacity(dimension),
            spread: false,
            missing: None,
            longest: LongestStep::new([ndof, dimension], start),
        }
    }

    /// Whether it can be one of a run of so many `bodies` with `ndof` independent variables and `dimension` unknowns, whose
    /// states have as many numbers as `state`.
    pub(super) fn fits(&self, [ndof, dimension]: [usize; 2], bodies: usize, state: &State) -> bool {
        let Self { sums, milestones, rates, speeds, .. } = self;
        let Milestones { start, times, places, velocities, .. } = milestones;
        let n = state.q.len();
        let fits = |Carried { error, spread: [dq, dv] }: &Carried| {
            error.len() == dimension && dq.len() == n && dv.len() == n
        };
        sums.iter().all(fits)
            && [start.q.len(), start.v.len()] == [n; 2]
            && start.z.len() == state.z.len()
            && start.winding.len() == state.winding.len()
            && [places.len(), velocities.len()] == [n * times.len(); 2]
            && times.len() <= Milestones::room(n)
            && milestones.every > 0
            && speeds.len() == bodies
            && rates.len() <= dimension
            && self.serving.steps <= MOST_WAITING
            && self.longest.as_ref().is_none_or(|step| step.fits(ndof, state))
    }

    /// Whether it may be several tolerances.
    pub(super) fn is_suspicious(&self) -> bool {
        self.largest > SUSPICIOUS || self.hidden
    }

    /// Whether the motion may have made more of it than it tells.
    pub(super) fn is_hidden(&self) -> bool {
        self.hidden
    }

    /// Follows it up to so many tolerances, where it is more than suspicious.
    pub(super) fn follow_up_to(&mut self, tolerances: f64) {
        self.followed = tolerances;
    }

    /// Whether it is more than it is followed to.
    pub(super) fn is_beyond(&self) -> bool {
        self.largest > self.followed
    }

    /// How many times shorter the next step is to be, so that no more is added up than is tolerated. Source:
    /// `docs/theory/simulation.md` (11c).
    pub(super) fn shortening(&self) -> f64 {
        self.shortening
    }

    /// The contraction that iterations of `stepper` may have with the matrix of another step, so that over the rest of the run, `steps`
    /// like the next one, what is carried cannot have missed that it became suspicious. Source:
    /// `docs/theory/simulation.md` (12b).
    pub(super) fn trusted_contraction(&self, stepper: &dyn Stepper, steps: f64) -> f64 {
        if self.is_beyond() {
            return f64::INFINITY;
        }
        let left = (self.followed / self.present.max(SEED)).ln() - self.unsure;
        stepper.filter_part() * left.max(0.0) / steps
    }

    /// A step was iterated with the matrix of another one and this contraction.
    pub(super) fn doubt(&mut self, stepper: &dyn Stepper, contraction: f64) {
        self.unsure += contraction / stepper.filter_part();
    }

    /// The longest step, s, by which a second run is to tell, if it is suspicious, energy is missing that lets fear for what
    /// turns, or steps may not have shown what grows.
    pub(super) fn longest_step_to_tell(&self, problem: &Problem, options: &Options) -> Option<f64> {
        let started = self.milestones.start.t;
        let longest = self.longest.as_ref();
        let hidden = longest.and_then(|step| step.hides_growth(problem, options, started));
        let asked = self.is_suspicious() || self.missing.is_some();
        hidden.or(asked.then_some(f64::INFINITY))
    }

    /// The equations are set up anew: there is no matrix of theirs.
    pub(super) fn forget_matrix(&mut self) {
        self.serving.known = false;
    }

    /// The run has come to `state` by its step of this number, counted from 1.
    pub(super) fn pass(&mut self, step: u64, state: &State, weights: &Weights) {
        for (largest, present) in self.speeds.iter_mut().zip(weights.speeds(&state.v)) {
            *largest = std::array::from_fn(|k| largest[k].max(present[k]));
        }
        self.milestones.pass(step, state);
    }

    /// Independent variables have got another meaning: nothing is known of their rates.
    pub(super) fn forget_variables(&mut self) {
        self.forget_matrix();
        self.rates.clear();
        self.arms.clear();
        self.longest.iter_mut().for_each(LongestStep::forget_variables);
    }

    /// Takes the error over the step just accepted. Where there is no matrix to carry it with, it is suspicious, and the form may be
    /// elsewhere: false.
    pub(super) fn follow(
        &mut self,
        stepper: &mut dyn Stepper,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        stepped: Stepped<'_>,
    ) -> bool {
        if self.is_beyond() {
            return true;
        }
        self.spread = false;
        let Stepped { step, slopes: [first, last], .. } = stepped;
        let ndof = form.second_order_split();
        self.rates.resize(ndof, 0.0);
        self.take_slopes(form, stepped.slopes);
        if !std::mem::replace(&mut self.seeded, true) {
            self.seed(form, power);
        }
        if stepper.explicit() {
            self.part_with_longer_steps(form, power, stepped);
        }
        self.hidden |= self.is_turned_round(form, stepped);
        let since = stepped.t - self.milestones.start.t;
        let ahead = self.begin_along(stepped.along(first), since);
        if !stepper.explicit() {
            // What iterations have left: where nothing else is left of a motion that dies away, it is what may grow.
            let part = stepper.filter_part() * step;
            let slopes = last.iter().zip(stepper.end().slope);
            self.left.clear();
            self.left.extend(slopes.map(|(g, s)| part * (g - s)));
            let [rest @ .., highest] = transfer(stepper.filter_part());
            for Carried { error, .. } in &mut self.sums {
                // By Horner's rule in S − I; S of what is left with the last of it.
                let products = power.iter_mut().zip(&*error);
                products.for_each(|(x, e)| *x = highest * e);
                for (j, c) in rest.into_iter().enumerate().rev() {
                    power.clone_into(&mut self.room);
                    if j == 0 {
                        add(power, 1.0, &self.left);
                    }
                    stepper.filter(form, power);
                    let before = self.room.iter().zip(&*error);
                    power.iter_mut().zip(before).for_each(|(x, (y, e))| *x += c * e - y);
                }
                error.copy_from_slice(power);
            }
        }
        self.add_along(ahead, stepped.along(last));
        let change = stepper.last_change();
        let [mut errors, mut rates] = [0.0; 2];
        for (k, (largest, arm)) in self.rates.iter_mut().zip(&self.arms).enumerate() {
            *largest = largest.max(stepped.w[ndof + k].abs());
            let error = arm * change[ndof + k].abs();
            errors += error * error;
            rates += error * arm * *largest;
        }
        // At the knot of a law, or beside the other end of a line, no formula has its order.
        let part = if stepped.passes_knot {
            stepper.error_at_kinks()
        } else {
            // Zero where there is no error.
            let share = errors / rates.max(errors).max(f64::MIN_POSITIVE);
            let kept = kept_part(stepper.orders_of_error(), share);
            self.rates.iter_mut().for_each(|rate| *rate *= kept);
            true_part(stepper.orders_of_error(), share, stepped.turn)
        };
        let part = stepper.own_error().map_or(part, |own| {
            let size = form.norm(change);
            if size > 0.0 { part.max(form.norm(own) / size) } else { part }
        });
        // What an error along the motion makes is known, whatever its sign: the rest decides.
        let ahead = self.leave_out(stepped.along(last), since);
        let [sum, other] = &mut self.sums;
        add(&mut sum.error, part, change);
        // By rates: errors of places last, those of rates become more.
        let rates = other.error[ndof..].iter().zip(&change[ndof..]);
        let product = rates.zip(&self.arms).map(|((e, d), arm)| arm * arm * e * d).sum();
        add(&mut other.error, part.copysign(product), change);
        self.add_along(ahead, stepped.along(last));
        let known =
            !stepper.explicit() || self.carry_if_due(stepper.evaluations(), form, power, stepped);
        if !known {
            self.lose();
        }
        known
    }

    /// Whether the force of a line turned round in the step just accepted, at once, so that what comes late by an error of place
    /// makes one of velocities that counts: no matrix tells of it. Source: `docs/theory/simulation.md` (12d).
    fn is_turned_round(&mut self, form: &mut dyn EquationForm, stepped: Stepped<'_>) -> bool {
        let Stepped { delay, slopes: [first, last], .. } = stepped;
        if delay == 0.0 {
            return false;
        }
        let ndof = form.second_order_split();
        self.room.fill(0.0);
        for k in ndof..2 * ndof {
            self.room[k] = delay * (last[k] - first[k]);
        }
        form.norm(&self.room) > FELT
    }

    /// Takes what the step just followed is known to have missed of force laws.
    pub(super) fn miss(&mut self, missed: &[f64]) {
        if !self.is_beyond() {
            self.sums.iter_mut().for_each(|Carried { error, .. }| add(error, 1.0, missed));
        }
    }

    /// Takes what waits for a matrix to the end of a run by an explicit formula, which is at (`t`, `w`).
    pub(super) fn end(
        &mut self,
        form: &mut dyn EquationForm,
        power: &mut [f64],
        (t, w): (f64, &[f64]),
        along: Option<&[f64]>,
    ) {
        if self.serving.steps == 0 || self.is_beyond() {
            return;
        }
        if form.linearize(t, w).is_ok() && self.carry_over(form, power, along).is_some() {
            self.look(form, false);
        } else {
            self.lose();
        }
    }

    /// Keeps it on coordinates and velocities, by which independent variables with another meaning are told, if it is not
    /// kept there already; the form is at the present state.
    pub(super) fn spread(&mut self, form: &mut dyn EquationForm) {
        if self.is_beyond() || std::mem::replace(&mut self.spread, true) {
            return;
        }
        for Carried { error, spread } in &mut self.sums {
            take(spread, form.spread(error));
        }
    }

    /// It is not known any more.
    fn lose(&mut self) {
        self.present = f64::MAX;
        self.largest = f64::MAX;
    }

    /// How large it is at the end of the step that was followed last. Where independent variables are about to get another
    /// meaning, it `moves` along, and is kept on velocities, too.
    pub(super) fn look(&mut self, form: &mut dyn EquationForm, moves: bool) {
        if self.is_beyond() {
            return;
        }
        self.present = 0.0;
        self.spread = moves;
        for Carried { error, spread } in &mut self.sums {
            if moves {
                take(spread, form.spread(error));
            } else {
                // What the change of places does to velocities is little beside them.
                let rates = &error[form.second_order_split()..];
                spread[1].copy_from_slice(form.displace(rates));
                spread[0].copy_from_slice(form.displace(error));
            }
            let weights = form.weights();
            let changes = weights.velocity_changes(&spread[1], &self.speeds);
            // What is not a number stays.
            let larger = |a: f64, b: f64| if a >= b || a.is_nan() { a } else { b };
            let size =
                changes.map(|c| c / VELOCITIES).fold(weights.displacement(&spread[0]), larger);
            if size.is_finite() && error.iter().sum::<f64>().is_finite() {
                self.present = self.present.max(size);
            } else {
                self.present = f64::MAX;
                error.fill(0.0);
                spread.iter_mut().for_each(|spread| spread.fill(0.0));
            }
        }
        self.largest = self.largest.max(self.present);
        // What leaps, as at an impact, is not made less by shorter steps.
        if !self.is_beyond() {
            let notable = self.present.min(SUSPICIOUS) / NOTABLE;
            self.shortening = notable.powf(SHORTENING).max(1.0);
        }
    }
}

impl CarriedError {
    /// A run starts from values that are known to no more than a part of the tolerance, whatever they are.
    fn seed(&mut self, form: &mut dyn EquationForm, change: &mut [f64]) {
        // What grows may hide from one direction, hardly from two.
        for (Carried { error, .. }, phase) in self.sums.iter_mut().zip([0.0, FRAC_PI_2]) {
            for (k, x) in change.iter_mut().enumerate() {
                *x = (1.0 + k as f64 + phase).sin();
            }
            for level in change.chunks_exact_mut(self.arms.len().max(1)).take(2) {
                level.iter_mut().zip(&self.arms).for_each(|(x, arm)| *x /= arm);
            }
            let size = form.norm(change);
            if size > 0.0 && size.is_finite() {
                add(error, SEED / size, change);
            }
        }
    }
}

fn take(spread: &mut [Vec<f64>; 2], change: [&[f64]; 2]) {
    for (spread, change) in spread.iter_mut().zip(change) {
        spread.copy_from_slice(change);
    }
}

pub(super) fn add(y: &mut [f64], a: f64, x: &[f64]) {
    y.iter_mut().zip(x).for_each(|(y, x)| *y += a * x);
}

/// Coefficients of the powers of s = (1 − γz)⁻¹ − 1 in an approximation of eᶻ of fourth order that vanishes at infinity:
/// eᶻ is a series in s of Laguerre polynomials. Source: `docs/theory/simulation.md` (12).
fn transfer(gamma: f64) -> [f64; 6] {
    let m = 1.0 / gamma;
    let mut laguerre = [1.0, -m, 0.0, 0.0, 0.0];
    for k in 1..4 {
        let j = k as f64;
        laguerre[k + 1] = ((2.0 * j - m) * laguerre[k] - (j - 1.0) * laguerre[k - 1]) / (j + 1.0);
    }
    let [l0, l1, l2, l3, l4] = laguerre;
    [l0, -l1, l2, -l3, l4, laguerre.iter().sum()]
}

/// Part of an estimate that is the error of a formula of order p whose estimate is that of order p̂, where the estimates of
/// rates are `share` of the largest that their variables had. What swings about a steady turn is as fast as that, however
/// little is seen of it: bodies turn by `turn` rad in the step. Source: `docs/theory/simulation.md` (11).
fn true_part([order, estimated]: [u32; 2], share: f64, turn: f64) -> f64 {
    let orders = order.saturating_sub(estimated);
    let exponent = f64::from(orders) / f64::from(estimated + 1);
    let part = share.powf(exponent).max((TURNED * turn).powi(orders as i32));
    part.min(1.0)
}

/// What is left after a step of the largest rate lately, where estimates of rates are `share` of those: half a period ago was another
/// motion. Source: `docs/theory/simulation.md` (11).
fn kept_part([_, estimated]: [u32; 2], share: f64) -> f64 {
    let turned = share.powf(f64::from(estimated + 1).recip()) / TURNED;
    1.0 - turned.min(1.0) / PI
}

/// Where a run began and has been.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Milestones {
    pub(super) start: State,
    pub(super) times: Vec<f64>,
    /// Rows of coordinates.
    pub(super) places: Vec<f64>,
    /// Rows of velocities.
    pub(super) velocities: Vec<f64>,
    /// Steps from one to the next.
    every: u64,
}

impl Milestones {
    fn new(start: &State) -> Self {
        let rows = Self::room(start.q.len()) + 1;
        Self {
            start: start.clone(),
            times: Vec::with_capacity(rows),
            places: Vec::with_capacity(rows * start.q.len()),
            velocities: Vec::with_capacity(rows * start.v.len()),
            every: 1,
        }
    }

    /// Most of them, of `n` coordinates each; an even number.
    fn room(n: usize) -> usize {
        let [least, most] = MILESTONES;
        (COORDINATES / n.max(1)).clamp(least, most) / 2 * 2
    }

    /// Takes the end of a run's step of this number, counted from 1. Where there is no more room, every other one is
    /// left out.
    pub(super) fn pass(&mut self, step: u64, state: &State) {
        if !step.is_multiple_of(self.every) {
            return;
        }
        let n = state.q.len();
        let half = Self::room(n) / 2;
        if self.times.len() == 2 * half {
            self.every *= 2;
            for kept in 0..half {
                let from = 2 * kept + 1;
                self.times[kept] = self.times[from];
                for rows in [&mut self.places, &mut self.velocities] {
                    rows.copy_within(from * n..(from + 1) * n, kept * n);
                }
            }
            self.times.truncate(half);
            for rows in [&mut self.places, &mut self.velocities] {
                rows.truncate(half * n);
            }
            if !step.is_multiple_of(self.every) {
                return;
            }
        }
        self.push(state);
    }

    /// Parts of a step of a run until `end`, s, at whose ends a comparison is to be made; none where there is no room for them.
    pub(super) fn parts(&self, step: f64, end: f64) -> u32 {
        let room = Self::room(self.start.q.len());
        // As many are left to the ends of steps.
        let all = PARTS.min(0.5 * room as f64);
        let has_room = self.every == 1 && self.times.len() < room;
        if has_room { (all * step / (end - self.start.t)).ceil() as u32 } else { 0 }
    }

    /// Takes a state within a step, where there is room.
    pub(super) fn pass_inside(&mut self, state: &State) {
        if self.times.len() < Self::room(state.q.len()) {
            self.push(state);
        }
    }

    /// Takes the end of the run.
    pub(super) fn end(&mut self, state: &State) {
        if self.times.last() != Some(&state.t) {
            self.push(state);
        }
    }

    fn push(&mut self, state: &State) {
        self.times.push(state.t);
        self.places.extend_from_slice(&state.q);
        self.velocities.extend_from_slice(&state.v);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::newton::Complex64;

    #[test] // independent truth: the exponential function
    fn errors_are_carried_to_fourth_order_and_no_vibration_grows() {
        for gamma in [0.25, 4.0 / 15.0, 0.274_888_829_595_68, 0.5, 0.572_816_062_482_134_9] {
            let growth = |z: Complex64| -> Complex64 {
                let s = (Complex64::new(1.0, 0.0) - gamma * z).inv() - 1.0;
                transfer(gamma).iter().rev().fold(Complex64::new(0.0, 0.0), |sum, c| sum * s + c)
            };
            for direction in [Complex64::new(-1.0, 0.0), Complex64::new(0.0, 1.0)] {
                let off = |h: f64| (growth(h * direction) - (h * direction).exp()).norm();
                let order = (off(1e-1) / off(5e-2)).log2();
                assert!(order > 4.5, "γ = {gamma}: {order}");
            }
            let vibrations =
                (0..100).map(|k| growth(Complex64::new(0.0, 1.1f64.powi(k - 40))).norm());
            assert!(vibrations.fold(0.0, f64::max) < 1.0 + 1e-12, "γ = {gamma}");
            assert!(growth(Complex64::new(-1e9, 0.0)).norm() < 1e-8);
        }
    }

    #[test] // truth: (1 − x/π)^(π/x) is near 1/e, and estimates that are those of Radau's formula by hλ
    fn half_a_period_later_a_third_of_a_rate_is_left() {
        for turned in [0.05, 0.3, 1.0f64] {
            let share = (TURNED * turned).powi(4);
            let left = kept_part([5, 3], share).powf(PI / turned);
            assert!((0.25..0.4).contains(&left), "{turned} rad: {left}");
        }
        assert!(kept_part([5, 3], 1.0) > 0.5, "a step forgets no more than one of a radian");
        assert_eq!(kept_part([5, 3], 0.0), 1.0);
    }

    #[test] // independent truth: the definition
    fn milestones_spread_over_the_run() {
        let state = |t: u64| State {
            t: t as f64,
            q: vec![t as f64, -1.0],
            v: vec![-(t as f64), 1.0],
            ..State::default()
        };
        let mut milestones = Milestones::new(&state(0));
        for step in 1..=4000 {
            milestones.pass(step, &state(step));
            assert!(milestones.times.len() <= MILESTONES[1]);
        }
        milestones.end(&state(4000));
        let known: Vec<f64> = (1..=1000).map(|k| 4.0 * f64::from(k)).collect();
        assert_eq!(milestones.times, known);
        assert_eq!(milestones.places, known.iter().flat_map(|&t| [t, -1.0]).collect::<Vec<_>>());
        assert_eq!(
            milestones.velocities,
            known.iter().flat_map(|&t| [-t, 1.0]).collect::<Vec<_>>()
        );
    }
}
